//! The sets of receivers that agree with each other, and which of these sets wins.

use crate::{MOST_RECEIVERS, has};

const SETS: usize = 1 << MOST_RECEIVERS;

/// The number of parts of a metre in which accuracies are counted. At the largest accuracy, a float32 still resolves
/// one part.
const PARTS_PER_METRE: f32 = (1 << 20) as f32;
/// The greatest accuracy that is counted, in parts of a metre: 64 m. A candidate's accuracy is below 43 m, and larger
/// ones are reduced to this value.
const MOST_PARTS: u32 = (1 << 26) - 1;
const SUM_BITS: u32 = 29;

/// The weight that each member adds to a set. A lower receiver number adds a little more, always less than 2^8.
const MEMBER: u32 = 1 << 16;
const KEPT: u32 = 1 << 8;

/// Returns the set that wins; 0 if no receiver is eligible. A set counts only if it consists of receivers in `eligible`
/// of which each pair agrees. The set with the most members wins. Among equal sets the one with the most receivers of
/// `last` wins, then the one with the least sum of `accuracies` (m), then the one with the lower receiver numbers.
///
/// `friends[i]` are the receivers that agree with receiver `i`, including itself. Every set is examined once, made from
/// a smaller set by adding the receiver with the highest number.
pub(crate) fn winner<const N: usize>(friends: &[u8; N], eligible: u8, last: u8, accuracies: &[f32; N]) -> u8 {
    let mut weights = [0; N];
    let mut parts = [0; N];
    for index in 0..N {
        weights[index] = MEMBER + u32::from(has(last, index)) * KEPT + (1 << (MOST_RECEIVERS - 1 - index));
        parts[index] = ((accuracies[index] * PARTS_PER_METRE) as u32).min(MOST_PARTS);
    }
    // Each set has three values: the receivers that agree with all its members, its weight, and its sum of accuracies.
    let mut common = [eligible; SETS];
    let mut weight = [0_u32; SETS];
    let mut sum = [0_u32; SETS];
    let (mut best, mut best_rank) = (0, 0);
    for index in 0..N {
        // Sets are ordered by their highest receiver: all sets of lower receivers precede those whose highest receiver
        // is `index`.
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
