//! The vibration of the payload: rotors, frame, shocks, and gravity. Every value follows from seed and instant, so
//! instants can be queried in any order.

use std::f64::consts::TAU;

use crate::faults::Rng;

/// Standard gravity, m/s².
pub const GRAVITY: f64 = 9.80665;

/// The vibration has at most one shock in each period of this length, ns.
const PIECE: u64 = 4_000_000_000;
/// The time at the beginning of each [`PIECE`] in which no shock comes, ns.
const CALM: u64 = 2_000_000_000;

/// A sinusoidal part of the vibration.
#[derive(Clone, Copy, Debug)]
struct Wave {
    hertz: f64,
    phase: f64,
    /// The amplitudes along x, y, z, m/s².
    amplitudes: [f64; 3],
}

/// A shock, whose acceleration over time is half a sine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shock {
    /// The instant at which the shock begins, ns.
    pub at: u64,
    /// The shock's length, ns.
    pub length: u64,
    /// The greatest acceleration along x, y, z, m/s².
    pub peak: [f64; 3],
}

/// The vibration that the payload feels.
#[derive(Clone, Debug)]
pub struct Vibration {
    seed: u64,
    waves: Vec<Wave>,
}

impl Vibration {
    /// Returns a vibration that is drawn from `seed`.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut rng = Rng::new(seed);
        let mut within = move |least: f64, most: f64| least + (most - least) * rng.below(1_000_001) as f64 / 1e6;
        let rotor = within(70.0, 110.0);
        let waves = [(rotor, 1.5), (2.0 * rotor, 0.5), (within(12.0, 25.0), 0.8), (within(3.0, 6.0), 0.4)];
        let waves = waves.map(|(hertz, most)| Wave {
            hertz,
            phase: within(0.0, TAU),
            amplitudes: [(); 3].map(|()| within(0.2, 1.0) * most),
        });
        Self { seed, waves: waves.to_vec() }
    }

    /// Returns the shock in the period that contains `at` (ns), if there is one.
    #[must_use]
    pub fn shock(&self, at: u64) -> Option<Shock> {
        let piece = at / PIECE;
        let mut rng = Rng::stream(self.seed, piece + 1);
        if rng.one_in(3) {
            return None;
        }
        let length = rng.between(6_000_000, 15_000_000);
        let at = piece * PIECE + rng.between(CALM, PIECE - length);
        let most = rng.between(10, 60) as f64;
        let peak = [(); 3].map(|()| most * (rng.below(2_001) as f64 / 1_000.0 - 1.0));
        Some(Shock { at, length, peak })
    }

    /// Returns the acceleration at `at` (ns) along x, y, z, m/s², behind a first-order low-pass filter with its -3 dB
    /// point at `bandwidth` (Hz). A payload at rest measures gravity along z.
    #[must_use]
    pub fn acceleration(&self, at: u64, bandwidth: f64) -> [f64; 3] {
        let passes = |hertz: f64| 1.0 / (hertz / bandwidth).hypot(1.0);
        let seconds = at as f64 / 1e9;
        let mut sum = [0.0, 0.0, GRAVITY];
        for wave in &self.waves {
            let sine = (TAU * wave.hertz * seconds + wave.phase).sin() * passes(wave.hertz);
            for (sum, amplitude) in sum.iter_mut().zip(wave.amplitudes) {
                *sum += amplitude * sine;
            }
        }
        if let Some(shock) = self.shock(at)
            && (shock.at..shock.at + shock.length).contains(&at)
        {
            let half = TAU / 2.0 * (at - shock.at) as f64 / shock.length as f64;
            let share = half.sin() * passes(0.5e9 / shock.length as f64);
            for (sum, peak) in sum.iter_mut().zip(shock.peak) {
                *sum += peak * share;
            }
        }
        sum
    }

    /// Returns the root mean square of the vibration along x, y, z, m/s², behind a low-pass filter with its -3 dB point
    /// at `bandwidth` (Hz). Gravity and shocks do not count.
    #[must_use]
    pub fn rms(&self, bandwidth: f64) -> [f64; 3] {
        [0, 1, 2].map(|axis| {
            let square = |wave: &Wave| (wave.amplitudes[axis] / (wave.hertz / bandwidth).hypot(1.0)).powi(2) / 2.0;
            self.waves.iter().map(square).sum::<f64>().sqrt()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stated_rms_is_that_of_the_samples() {
        let vibration = Vibration::new(5);
        for bandwidth in [44.0, 200.0, 1e9] {
            let mut square = [0.0; 3];
            for n in 0..20_000_u64 {
                let sample = vibration.acceleration(n * 97_000, bandwidth);
                square = [0, 1, 2].map(|a| square[a] + (sample[a] - if a == 2 { GRAVITY } else { 0.0 }).powi(2));
            }
            for (axis, rms) in vibration.rms(bandwidth).into_iter().enumerate() {
                let measured = (square[axis] / 20_000.0).sqrt();
                assert!((measured - rms).abs() < 0.03, "{bandwidth} Hz, axis {axis}: {measured}, {rms}");
            }
        }
    }

    #[test]
    fn a_shock_is_seen_at_its_middle_and_not_beside_it() {
        let vibration = Vibration::new(9);
        let shocks: Vec<_> = (0..40).filter_map(|piece| vibration.shock(piece * PIECE)).collect();
        assert!((15..40).contains(&shocks.len()), "{}", shocks.len());
        let calm = Vibration { waves: vec![], ..vibration };
        for shock in shocks {
            assert!(shock.at >= CALM);
            let seen = calm.acceleration(shock.at + shock.length / 2, 1e9);
            assert!((seen[0] - shock.peak[0]).abs() < 1e-6 && (seen[2] - GRAVITY - shock.peak[2]).abs() < 1e-6);
            assert_eq!(calm.acceleration(shock.at + shock.length, 1e9), [0.0, 0.0, GRAVITY]);
        }
    }
}
