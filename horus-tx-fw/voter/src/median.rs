//! Medians of those values that count, with the same work whichever they are.

use crate::{first, has};

/// The median of `values` among those in the mask; of an even number the mean of the middle two. Of none it says
/// nothing.
pub(crate) fn median<const N: usize>(values: [f32; N], among: u8) -> f32 {
    median_and_spread(values, among).0
}

/// The same, and how far apart the least and the greatest of them are.
pub(crate) fn median_and_spread<const N: usize>(values: [f32; N], among: u8) -> (f32, f32) {
    let [least, low, high, most] = ordered(values, among, f32::INFINITY);
    // Halves, not their sum: that of two large ones would be infinite.
    (0.5 * low + 0.5 * high, most - least)
}

/// The middle two of `values` among those in the mask, twice the same of an odd number; of none it says nothing. No
/// value is above `greatest`.
pub(crate) fn middle_two<T: Copy + PartialOrd, const N: usize>(values: [T; N], among: u8, greatest: T) -> [T; 2] {
    let [_, low, high, _] = ordered(values, among, greatest);
    [low, high]
}

/// The least, the middle two and the greatest of `values` among those in the mask.
fn ordered<T: Copy + PartialOrd, const N: usize>(values: [T; N], among: u8, greatest: T) -> [T; 4] {
    let mut sorted = values;
    let mut count = 0;
    for (index, value) in sorted.iter_mut().enumerate() {
        let counts = has(among, index);
        *value = if counts { *value } else { greatest };
        count += usize::from(counts);
    }
    // Odd-even transposition: N rounds of neighbours put N values in order.
    for round in 0..N {
        for low in (round % 2..N - 1).step_by(2) {
            let (a, b) = (sorted[low], sorted[low + 1]);
            let swap = b < a;
            sorted[low] = if swap { b } else { a };
            sorted[low + 1] = if swap { a } else { b };
        }
    }
    let at = |wanted: usize| {
        sorted.iter().enumerate().fold(greatest, |found, (index, value)| if index == wanted { *value } else { found })
    };
    [sorted[0], at(count.saturating_sub(1) / 2), at(count / 2), at(count.saturating_sub(1))]
}

/// The first of the angles in the mask, rad, and how far each of all is from it, within half a turn.
pub(crate) fn about_first<const N: usize>(angles: [f32; N], among: u8) -> (f32, [f32; N]) {
    let reference = first(among, &angles);
    (reference, angles.map(|angle| turned(angle - reference, -core::f32::consts::PI)))
}

/// `angle`, rad, by whole turns into the turn that begins at `from`. What lies in it, both ends included, stays as
/// it is, to the bit.
pub(crate) fn turned(angle: f32, from: f32) -> f32 {
    let turns = (angle - from) * (1.0 / core::f32::consts::TAU);
    let whole = turns as i32;
    let beyond = if turns > 0.0 { whole as f32 >= turns } else { whole as f32 > turns };
    angle - (whole - i32::from(beyond)) as f32 * core::f32::consts::TAU
}
