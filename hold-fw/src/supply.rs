//! Converts the SAADC's counts of the supply voltage.
//!
//! With a gain of 1/6 and the internal reference of 0.6 V the full scale is 3.6 V, and the resolution is 12 bits
//! (PS v1.7, 6.23.7).

use core::ops::Range;

/// The full scale of the SAADC, V, and the number of steps in it.
const FULL_SCALE: f32 = 3.6;
const STEPS: i16 = 4_096;

/// The limits of the supply, V. The lower limit is above the voltage at which the hold stops. The upper limit is the
/// highest voltage that the nRF52840 bears (PS v1.7, 5.3.1), and itself counts as outside.
pub const LIMITS: Range<f32> = 2.9..FULL_SCALE;

/// The lowest plausible result, V: the hold stops below 2.57 V, so a lower result is an error of the measurement.
const LOWEST: f32 = 2.5;

/// Returns the supply voltage, V, of a conversion's result; `None` if the result is too low to be right.
///
/// The greatest count stands for its own voltage and for all higher ones. It counts as the full scale, which is outside
/// of [`LIMITS`].
#[must_use]
pub fn volts(count: i16) -> Option<f32> {
    let count = if count >= STEPS - 1 { STEPS } else { count };
    let volts = f32::from(count) * (FULL_SCALE / f32::from(STEPS));
    // Not covered: a result that is too low: the supply supervisor resets the hold before.
    (volts > LOWEST).then_some(volts)
}
