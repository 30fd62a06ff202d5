//! Which receivers agree with each other, and which set of them wins.

use crate::{MOST_RECEIVERS, has};

/// Sets of [`MOST_RECEIVERS`] receivers.
const SETS: usize = 1 << MOST_RECEIVERS;

/// An accuracy is counted in so many parts of a metre: what a float32 resolves at the largest.
const PARTS_PER_METRE: f32 = (1 << 20) as f32;
/// The largest accuracy that is told from a larger one, those parts: 64 m. A candidate's is below 43 m.
const MOST_PARTS: u32 = (1 << 26) - 1;
/// Bits of a sum of [`MOST_RECEIVERS`] of them.
const SUM_BITS: u32 = 29;

/// What a receiver adds to a set: one member, one of the set that won last if it was of that, and its place, in which a
/// lower number weighs more.
const MEMBER: u32 = 1 << 16;
const KEPT: u32 = 1 << 8;

/// The set that wins, 0 if no receiver is eligible: of those in `eligible` in which each pair agrees the one with the
/// most members, then the most of `last`, then the smallest sum of `accuracies` (m), then the lower numbers.
///
/// `friends[i]` are those who agree with receiver `i`, itself included. Every set is looked at, none twice, and each is
/// made of a smaller one by adding its lowest receiver.
pub(crate) fn winner<const N: usize>(friends: &[u8; N], eligible: u8, last: u8, accuracies: &[f32; N]) -> u8 {
    let mut weights = [0; N];
    let mut parts = [0; N];
    for index in 0..N {
        weights[index] = MEMBER + u32::from(has(last, index)) * KEPT + (1 << (MOST_RECEIVERS - 1 - index));
        parts[index] = ((accuracies[index] * PARTS_PER_METRE) as u32).min(MOST_PARTS);
    }
    // Of each set: its common friends, its weight, its sum.
    let mut common = [eligible; SETS];
    let mut weight = [0_u32; SETS];
    let mut sum = [0_u32; SETS];
    let (mut best, mut best_rank) = (0, 0);
    for index in 0..N {
        // The sets whose highest receiver is this one follow those of the receivers below it.
        let top = 1 << index;
        for rest in 0..top {
            let set = rest | top;
            common[set] = common[rest] & friends[index];
            weight[set] = weight[rest] + weights[index];
            sum[set] = sum[rest] + parts[index];
            let heavier = u64::from(weight[set] >> 8) << (SUM_BITS + 8);
            let closer = u64::from((1 << SUM_BITS) - 1 - sum[set]) << 8;
            let rank = heavier | closer | u64::from(weight[set] & 0xFF);
            let better = (common[set] as usize & set == set) & (rank > best_rank);
            best = if better { set } else { best };
            best_rank = if better { rank } else { best_rank };
        }
    }
    best as u8
}
