//! Calculates medians of the values that a mask selects, with the same work for every mask.

use crate::{first, has};

/// Returns the median of those `values` that are in the mask; for an even number of them the mean of the middle two.
/// For an empty mask the result means nothing.
pub(crate) fn median<const N: usize>(values: [f32; N], among: u8) -> f32 {
    median_and_spread(values, among).0
}

/// Returns the median as [`median`] does, and the difference between the greatest and the least of the values in the
/// mask.
pub(crate) fn median_and_spread<const N: usize>(values: [f32; N], among: u8) -> (f32, f32) {
    let [least, low, high, most] = ordered(values, among, f32::INFINITY);
    // Each value is halved before the sum, since the sum of two large values would be infinite.
    (0.5 * low + 0.5 * high, most - least)
}

/// Returns the middle two of those `values` that are in the mask; for an odd number of them the middle one twice. For
/// an empty mask the result means nothing. No value may be above `greatest`.
pub(crate) fn middle_two<T: Copy + PartialOrd, const N: usize>(values: [T; N], among: u8, greatest: T) -> [T; 2] {
    let [_, low, high, _] = ordered(values, among, greatest);
    [low, high]
}

/// Returns the least, the middle two and the greatest of those `values` that are in the mask.
fn ordered<T: Copy + PartialOrd, const N: usize>(values: [T; N], among: u8, greatest: T) -> [T; 4] {
    let mut sorted = values;
    let mut count = 0;
    for (index, value) in sorted.iter_mut().enumerate() {
        let counts = has(among, index);
        *value = if counts { *value } else { greatest };
        count += usize::from(counts);
    }
    // This is an odd-even transposition sort: N rounds that compare neighbours sort N values.
    for round in 0..N {
        for low in (round % 2..N - 1).step_by(2) {
            let (a, b) = (sorted[low], sorted[low + 1]);
            let swap = b < a;
            sorted[low] = if swap { b } else { a };
            sorted[low + 1] = if swap { a } else { b };
        }
    }
    // Not covered: index 0 as the upper one of the middle two, which only a mask of fewer than two members has: the
    // callers have no result then, and the compiler has made them skip this.
    let at = |wanted: usize| {
        sorted.iter().enumerate().fold(greatest, |found, (index, value)| if index == wanted { *value } else { found })
    };
    [sorted[0], at(count.saturating_sub(1) / 2), at(count / 2), at(count.saturating_sub(1))]
}

/// Returns the first of the angles in the mask, rad, and the difference of each angle from it, within half a turn.
pub(crate) fn about_first<const N: usize>(angles: [f32; N], among: u8) -> (f32, [f32; N]) {
    let reference = first(among, &angles);
    (reference, angles.map(|angle| turned(angle - reference, -core::f32::consts::PI)))
}

/// Returns `angle`, rad, moved by whole turns into the turn that begins at `from`. An angle that is in that turn
/// already, including both ends, is returned unchanged to the bit.
pub(crate) fn turned(angle: f32, from: f32) -> f32 {
    let turns = (angle - from) * (1.0 / core::f32::consts::TAU);
    let whole = turns as i32;
    let beyond = if turns > 0.0 { whole as f32 >= turns } else { whole as f32 > turns };
    angle - (whole - i32::from(beyond)) as f32 * core::f32::consts::TAU
}
