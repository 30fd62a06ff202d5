//! Converts the probability of an undetected error to a rate per hour, and compares it with the limits of safety
//! integrity levels.
//!
//! # Residual error rate
//!
//! HORUS sends a profile 100 times a second and repeats none. Every object is judged separately, so the residual errors
//! of its objects add up:
//!
//! > Λ(p) = 360 000 / h · (P_ud, Reported-Position(p) + n P_ud, GPS(p))
//!
//! Reported-Position counts with its frame CRC only; its position CRC can only lower the figure. This holds for one
//! receiver of the data, a sink in IEC 61784-3. For several sinks that act independently, the figure is multiplied by
//! their number (the standard's m).
//!
//! # Bounds
//!
//! IEC 61508-1 bounds the dangerous failures per hour of a function in continuous mode: below 1e-6 for SIL 2, 1e-7 for
//! SIL 3, 1e-8 for SIL 4. IEC 61784-3 allots 1 % of them to a communication channel.
//!
//! # Error interval limit
//!
//! A sink that enters its safe state at a second detected error within an interval T keeps the rate of detected errors
//! below 1 / T on any channel. For each undetected error, 1 / P_re,cond - 1 are detected, so there are fewer residual
//! errors than
//!
//! > 1 / T · max P_re,cond / (1 - P_re,cond)
//!
//! at *any* bit error rate, if errors are independent. OPC UA Safety uses intervals of 6, 60 and 600 minutes for SIL 2,
//! 3 and 4 (OPC 10000-15, 9.4, table 39). The price is availability: on a worse channel the function stops.
use crate::ErrorCurve;

/// The number of profiles per hour: one every 10 ms.
pub const CYCLES_PER_HOUR: f64 = 3_600_000.0 / profile::CYCLE_MS as f64;

/// The upper bound of P_re,cond in OPC UA Safety (OPC 10000-15, 9.3).
pub const OPC_UA_SAFETY_CONDITIONAL: f64 = 4.0e-10;

/// The possible numbers of receivers in a profile.
pub const RECEIVERS: [usize; 4] = [1, 2, 3, 5];

/// A safety integrity level (IEC 61508).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sil {
    /// SIL 2.
    Two,
    /// SIL 3.
    Three,
    /// SIL 4.
    Four,
}

impl Sil {
    /// The safety integrity levels that the residual error rates are compared with.
    pub const ALL: [Self; 3] = [Self::Two, Self::Three, Self::Four];

    /// The number of the level: 2, 3 or 4.
    #[must_use]
    pub const fn number(self) -> u32 {
        match self {
            Self::Two => 2,
            Self::Three => 3,
            Self::Four => 4,
        }
    }

    /// The level's limit for a communication channel, residual errors per hour: 1 % of the function's dangerous
    /// failures.
    #[must_use]
    pub const fn channel_limit(self) -> f64 {
        match self {
            Self::Two => 1e-8,
            Self::Three => 1e-9,
            Self::Four => 1e-10,
        }
    }

    /// OPC UA Safety's error interval limit for the level, minutes.
    #[must_use]
    pub const fn error_interval_minutes(self) -> u32 {
        match self {
            Self::Two => 6,
            Self::Three => 60,
            Self::Four => 600,
        }
    }
}

/// The objects of a profile, with their error curves.
#[derive(Clone, Copy, Debug)]
pub struct ProfileCurves<'a> {
    /// The error curve of Reported-Position's frame CRC.
    pub reported: &'a ErrorCurve,
    /// The error curve of a GPS object's frame CRC.
    pub gps: &'a ErrorCurve,
    /// The number of GPS objects.
    pub receivers: usize,
}

impl ProfileCurves<'_> {
    /// Λ, the number of residual errors per hour, at a bit error rate of `p`.
    #[must_use]
    pub fn residual_per_hour(&self, p: f64) -> f64 {
        CYCLES_PER_HOUR * (self.reported.undetected(p) + self.receivers as f64 * self.gps.undetected(p))
    }

    /// The number of objects per hour that arrive damaged and are rejected, at a bit error rate of `p`.
    #[must_use]
    pub fn rejected_per_hour(&self, p: f64) -> f64 {
        let damaged = self.reported.damaged(p) + self.receivers as f64 * self.gps.damaged(p);
        CYCLES_PER_HOUR * damaged - self.residual_per_hour(p)
    }

    /// The most residual errors per hour at any bit error rate, if at most one object is rejected every `minutes`
    /// minutes.
    #[must_use]
    pub fn residual_per_hour_limited(&self, minutes: f64) -> f64 {
        let conditional = self.reported.conditional_maximum().value.max(self.gps.conditional_maximum().value);
        60.0 / minutes * conditional / (1.0 - conditional)
    }

    /// The bit error rate up to which the residual errors per hour do not exceed `limit`; `None` if they never do up to
    /// 0.5.
    #[must_use]
    pub fn holds_up_to(&self, limit: f64) -> Option<f64> {
        crossing(|p| self.residual_per_hour(p), limit)
    }

    /// The bit error rate at which, on average, one object is rejected every `minutes` minutes.
    #[must_use]
    pub fn one_rejected_per(&self, minutes: f64) -> Option<f64> {
        crossing(|p| self.rejected_per_hour(p), 60.0 / minutes)
    }
}

/// The least bit error rate, from 1e-15 up, at which the function exceeds `limit`, rounded down.
fn crossing(function: impl Fn(f64) -> f64, limit: f64) -> Option<f64> {
    let steps = (1..).map(|step| 1e-15 * 10_f64.powf(f64::from(step) / 100.0)).take_while(|p| *p < 0.5).chain([0.5]);
    let mut low = 1e-15;
    for p in steps {
        if function(p) > limit {
            let mut high = p;
            for _ in 0..60 {
                let middle = f64::midpoint(low, high);
                if function(middle) > limit { high = middle } else { low = middle }
            }
            return Some(low);
        }
        low = p;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crossings_are_found_or_denied() {
        let found = crossing(|p| p * p, 1e-6).unwrap();
        assert!((found / 1e-3 - 1.0).abs() < 1e-9);
        assert_eq!(crossing(|p| p, 0.5), None);
        let bump = crossing(|p| if (1e-5..1e-4).contains(&p) { 2.0 } else { p }, 0.25).unwrap();
        assert!((bump / 1e-5 - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_hundred_profiles_a_second() {
        assert_eq!(CYCLES_PER_HOUR, 360_000.0);
    }
}
