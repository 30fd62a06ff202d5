//! Faults of a board's supply and reset pin.

use bench_judge::disturbance::{Disturbance, Harm};

use super::Rng;

const MS: u64 = 1_000_000;

/// The voltages, µV, from which a supply can sag: 3.3 V, as on the boards, and the highest that both microcontrollers
/// allow.
pub(crate) const RAILS_UV: [u32; 2] = [3_300_000, 3_600_000];

/// A fault of a board's supply or reset pin. The front end shares the board's supply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PowerFault {
    /// The supply is off from the episode's beginning to its end. RAM then holds noise, which this seed determines.
    Off(u64),
    /// The reset pin is pulled low briefly. RAM keeps its contents, and the front end keeps its registers.
    Pin,
    /// The supply briefly falls below the brown-out threshold. RAM and the front end's registers keep their contents.
    BrownOut,
    /// The watchdog resets the microcontroller, even if it is fed. RAM and the front end's registers keep their
    /// contents.
    Watchdog,
    /// The crystal is dead: HORUS's stops at once, the DPR's fails to start. A board that cannot start without its
    /// crystal is reset by its pin at the episode's end.
    CrystalDead,
    /// The supply sags and recovers in a [`shape`] that this seed determines.
    Sag(u64),
    /// The front end alone is without supply from the episode's beginning to its end, so its registers are lost.
    FrontEndOff,
}

impl PowerFault {
    /// Returns the fault's name in the event log.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Off(_) => "off",
            Self::Pin => "reset pin",
            Self::BrownOut => "brown-out",
            Self::Watchdog => "watchdog",
            Self::CrystalDead => "crystal dead",
            Self::Sag(_) => "sag",
            Self::FrontEndOff => "front end off",
        }
    }

    /// The disturbance of `board` that this fault causes. The judge excuses violations according to it.
    #[must_use]
    pub const fn disturbs(self, board: bench_judge::Board) -> Disturbance {
        match self {
            Self::Off(_) | Self::Sag(_) => Disturbance::Supply { board },
            Self::Pin | Self::BrownOut | Self::Watchdog => Disturbance::Restart { board },
            // A dead crystal is recorded as a hang, because the board may not start.
            Self::CrystalDead => Disturbance::Hang { board },
            Self::FrontEndOff => Disturbance::FrontEnd { board, harm: Harm::Silent },
        }
    }

    /// Whether the fault lasts until the episode's end.
    #[must_use]
    pub const fn lasts(self) -> bool {
        matches!(self, Self::Off(_) | Self::CrystalDead | Self::Sag(_) | Self::FrontEndOff)
    }
}

/// Returns the voltages of a sagging supply, µV, each with its time from the beginning of the sag, ns.
///
/// The voltage goes one to four times to zero, to a voltage between the supervisors' thresholds, or to any other, and
/// then back. A change takes 1, 10 or 100 ms, in steps of at most 20 mV or in one step.
#[must_use]
pub fn shape(seed: u64) -> Vec<(u64, u32)> {
    const STEP_UV: u32 = 20_000;
    let mut rng = Rng::new(seed);
    let mut volts = RAILS_UV[rng.below(2) as usize];
    let mut shape = vec![(0, volts)];
    let mut at = 0;
    let legs = rng.between(1, 4);
    for leg in 0..=legs {
        let to = match rng.below(3) {
            _ if leg == legs => RAILS_UV[0],
            0 => 0,
            1 => rng.between(1_500_000, 3_100_000) as u32,
            _ => rng.between(0, 3_600_000) as u32,
        };
        let takes = [MS, 10 * MS, 100 * MS][rng.below(3) as usize];
        let steps = if rng.one_in(4) { 1 } else { volts.abs_diff(to).div_ceil(STEP_UV).max(1) };
        for step in 1..=steps {
            let part = i64::from(step) * (i64::from(to) - i64::from(volts)) / i64::from(steps);
            let reached = (i64::from(volts) + part) as u32;
            // If the voltage changes in one step, that step comes at the beginning of the time.
            let after = if steps == 1 { 0 } else { takes * u64::from(step) / u64::from(steps) };
            shape.push((at + after, reached));
        }
        (at, volts) = (at + takes, to);
    }
    shape.push((at, RAILS_UV[0]));
    shape
}

/// The duration of a sag, ns.
#[must_use]
pub fn sag_length(seed: u64) -> u64 {
    shape(seed).last().map_or(0, |(at, _)| *at)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shape_follows_from_its_seed_and_ends_at_the_rail() {
        for seed in 0..1_000 {
            let shape = shape(seed);
            assert_eq!(shape, super::shape(seed));
            assert!(shape.is_sorted_by_key(|(at, _)| *at), "{seed}");
            assert_eq!(shape.last(), Some(&(sag_length(seed), RAILS_UV[0])), "{seed}");
            assert!(shape.iter().all(|(_, volts)| *volts <= RAILS_UV[1]), "{seed}");
            assert!((2 * MS..=500 * MS).contains(&sag_length(seed)), "{seed}");
        }
    }

    #[test]
    fn shapes_go_to_nothing_and_stay_between_all_thresholds_fast_and_slowly() {
        let lowest = |seed| shape(seed).iter().map(|(_, volts)| *volts).min().unwrap();
        let count = |range: std::ops::Range<u32>| (0..1_000).filter(|seed| range.contains(&lowest(*seed))).count();
        for range in [0..1, 1..1_570_000, 1_570_000..2_400_000, 2_400_000..2_750_000, 2_750_000..2_950_000] {
            let drawn = count(range.clone());
            assert!(drawn >= 5, "{range:?}: {drawn}");
        }
        for takes in [MS, 10 * MS, 100 * MS] {
            let ramp = |seed: u64| {
                let shape = shape(seed);
                let (zero, _) = shape.iter().find(|(_, volts)| *volts == 0)?;
                Some(*zero == takes && shape.len() > 150)
            };
            assert!((0..1_000).any(|seed| ramp(seed) == Some(true)), "from the rail to nothing in {takes} ns");
        }
    }
}
