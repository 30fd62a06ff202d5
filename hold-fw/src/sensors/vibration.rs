//! Computes vibration and shocks from the samples of an accelerometer.
//!
//! The *vibration* along an axis is the standard deviation of the samples of the last second. The mean, which includes
//! gravity, is thus left out. A *shock* is the greatest distance of a sample from that mean. All sums are integers, so
//! adding and removing samples causes no rounding error.

use super::SAMPLES_PER_SECOND;

/// The number of times in a second that the sensor's FIFO is read.
pub const READINGS: usize = 20;

/// The fewest samples in a second from which a result is computed. The sensor's clock may be 10 % slow (LIS3DH data
/// sheet, 2.1), and a reading may come late.
const FEWEST: u32 = SAMPLES_PER_SECOND * 17 / 20;

/// One sample: the accelerations along x, y and z in units of [`DIGIT`].
pub type Sample = [i16; 3];

/// The acceleration of one digit, m/s²: 16 mg in the range of 8 g with 10 bits (LIS3DH and LIS2DH12 data sheets, table
/// "mechanical characteristics").
pub const DIGIT: f32 = 0.016 * 9.806_65;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Sums {
    samples: u32,
    sum: [i64; 3],
    squares: [i64; 3],
}

impl Sums {
    fn of(samples: &[Sample]) -> Self {
        let mut sums = Self::default();
        for sample in samples {
            sums.samples += 1;
            for (axis, value) in sample.iter().enumerate() {
                sums.sum[axis] += i64::from(*value);
                sums.squares[axis] += i64::from(*value) * i64::from(*value);
            }
        }
        sums
    }
}

/// The sums over the samples of the last second, and the greatest shock.
#[derive(Clone, Debug, Default)]
pub struct Vibration {
    readings: [Sums; READINGS],
    next: usize,
    greatest: Option<f32>,
}

impl Vibration {
    /// Returns the state without a sample.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds the samples of one reading and removes those of the reading a second ago.
    pub fn take(&mut self, samples: &[Sample]) {
        // The mean is that of the samples of the second before the new ones. So a shock does not move the mean from
        // which it is measured.
        if let Some(total) = self.total() {
            let count = total.samples as f32;
            let mean = total.sum.map(|sum| sum as f32 / count);
            let squares = samples.iter().map(|sample| {
                (0..3).map(|axis| f32::from(sample[axis]) - mean[axis]).map(|distance| distance * distance).sum::<f32>()
            });
            // Not covered: the result of `max` for a NaN, which no square of these integers is; and no samples, since
            // `take` gets at least one.
            let shock = DIGIT * libm::sqrtf(squares.fold(0.0, f32::max));
            // Not covered: the result of `max` for a NaN, as above.
            self.greatest = Some(self.greatest.unwrap_or(0.0).max(shock));
        }
        self.readings[self.next] = Sums::of(samples);
        self.next = (self.next + 1) % READINGS;
    }

    /// Removes all samples after a fault of the sensor. The greatest shock stays.
    pub fn clear(&mut self) {
        self.readings = [Sums::default(); READINGS];
    }

    /// Returns the vibration along x, y and z, m/s²; `None` without samples of about a second.
    #[must_use]
    pub fn rms(&self) -> Option<[f32; 3]> {
        let total = self.total()?;
        let count = i64::from(total.samples);
        Some([0, 1, 2].map(|axis| {
            let scatter = count * total.squares[axis] - total.sum[axis] * total.sum[axis];
            DIGIT * libm::sqrtf(scatter as f32) / count as f32
        }))
    }

    /// Returns the greatest shock since the last call, m/s²; `None` if no shock could be measured.
    pub fn take_greatest(&mut self) -> Option<f32> {
        self.greatest.take()
    }

    fn total(&self) -> Option<Sums> {
        let mut total = Sums::default();
        for reading in &self.readings {
            total.samples += reading.samples;
            for axis in 0..3 {
                total.sum[axis] += reading.sum[axis];
                total.squares[axis] += reading.squares[axis];
            }
        }
        (total.samples >= FEWEST).then_some(total)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn second(of: impl Fn(usize) -> Sample) -> Vibration {
        let mut vibration = Vibration::new();
        let samples: Vec<Sample> = (0..400).map(of).collect();
        samples.chunks(20).for_each(|reading| vibration.take(reading));
        vibration
    }

    #[test]
    fn gravity_alone_is_no_vibration_and_a_sine_has_its_rms() {
        assert_eq!(second(|_| [0, -3, 62]).rms(), Some([0.0; 3]));
        let sine = |n: usize| (100.0 * (n as f64 * std::f64::consts::TAU * 50.0 / 400.0).sin()).round() as i16;
        let [x, y, z] = second(|n| [sine(n), 0, 62 + sine(n)]).rms().unwrap();
        let expected = 100.0 / 2.0_f32.sqrt() * DIGIT;
        assert!((x - expected).abs() < 0.01 * expected && y == 0.0 && (z - x).abs() < 1e-3, "{x} {y} {z}");
    }

    #[test]
    fn the_vibration_is_unknown_until_a_second_of_samples_is_there() {
        let mut vibration = Vibration::new();
        for reading in 0..17 {
            assert_eq!(vibration.rms(), None, "{reading}");
            vibration.take(&[[1, 2, 3]; 20]);
        }
        assert!(vibration.rms().is_some());
        vibration.clear();
        assert_eq!(vibration.rms(), None);
        // Each reading drops the samples of a second ago, even if the reading brings no sample.
        let mut vibration = second(|_| [0, 0, 62]);
        (0..4).for_each(|_| vibration.take(&[]));
        assert_eq!(vibration.rms(), None);
    }

    #[test]
    fn a_second_after_it_a_shock_is_kept_as_greatest_only() {
        let mut vibration = second(|_| [0, 0, 62]);
        let _ = vibration.take_greatest();
        vibration.take(&[[300, 400, 62]]);
        assert!(vibration.rms().unwrap()[0] > 0.0);
        for _ in 0..READINGS {
            vibration.take(&[[0, 0, 62]; 20]);
        }
        assert_eq!(vibration.rms(), Some([0.0; 3]));
        let greatest = vibration.take_greatest().unwrap();
        assert!((greatest - 500.0 * DIGIT).abs() < 0.1, "{greatest}");
        assert_eq!(vibration.take_greatest(), None);
    }

    proptest! {
        #[test]
        fn the_rms_is_that_of_the_definition(
            samples in prop::collection::vec([-512_i16..512, -512_i16..512, -512_i16..512], 340..640)
        ) {
            let mut vibration = Vibration::new();
            samples.chunks(32).for_each(|reading| vibration.take(reading));
            let rms = vibration.rms().unwrap();
            for axis in 0..3 {
                let values: Vec<f64> = samples.iter().map(|sample| f64::from(sample[axis])).collect();
                let mean = values.iter().sum::<f64>() / values.len() as f64;
                let square = values.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>();
                let expected = (square / values.len() as f64).sqrt() * f64::from(DIGIT);
                prop_assert!((f64::from(rms[axis]) - expected).abs() < 1e-4 * expected + 1e-4);
            }
        }
    }
}
