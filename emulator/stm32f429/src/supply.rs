//! The supply supervisors: power-on and power-down reset, brown-out reset, the voltage detector (RM0090 5.2).
//!
//! The thresholds are from DS9405, "Embedded reset and power control block characteristics", which gives a range for
//! each. Here each detector reacts as late as the range allows, so that firmware has the least time between two
//! detectors. The reset's delay after the threshold (0.5 to 3 ms) is left out.

use emulator_part::{Reset, Supplied};

/// The thresholds of a supply that falls, and of one that rises, in µV.
type Threshold = (u32, u32);

const POWER: Threshold = (1_600_000, 1_640_000);
/// Brown-out levels 3, 2 and 1, in the order of `BOR_LEV`.
const BROWN_OUT: [Threshold; 3] = [(2_750_000, 2_850_000), (2_440_000, 2_530_000), (2_130_000, 2_230_000)];
/// The voltage detector's thresholds, by `PWR_CR.PLS`.
const DETECTOR: [Threshold; 8] = [
    (1_980_000, 2_090_000),
    (2_130_000, 2_230_000),
    (2_290_000, 2_390_000),
    (2_440_000, 2_540_000),
    (2_590_000, 2_700_000),
    (2_650_000, 2_860_000),
    (2_850_000, 2_960_000),
    (2_950_000, 3_070_000),
];

/// Bits of `PWR_CR`.
const PVDE: u32 = 1 << 4;

#[derive(Clone, Debug)]
pub(crate) struct Supervisors {
    microvolts: u32,
    /// The cause of the next restart, while the part is held in reset.
    held: Option<Reset>,
    /// `PWR_CSR.PVDO`: whether the supply is below the voltage detector's threshold.
    pub(crate) low: bool,
    /// Whether PVDO has risen since the last check.
    pub(crate) warned: bool,
}

impl Supervisors {
    pub(crate) fn new() -> Self {
        Self { microvolts: 3_300_000, held: None, low: false, warned: false }
    }

    pub(crate) fn microvolts(&self) -> u32 {
        self.microvolts
    }

    /// Changes the supply voltage. `level` is the option `BOR_LEV`.
    pub(crate) fn supply(&mut self, microvolts: u32, level: u32) -> Supplied {
        self.microvolts = microvolts;
        let before = self.held;
        let is_below = |(falls, rises): Threshold, was: bool| microvolts < if was { rises } else { falls };
        self.held = if is_below(POWER, before == Some(Reset::PowerOn)) {
            Some(Reset::PowerOn)
        } else if BROWN_OUT.get(level as usize).is_some_and(|threshold| is_below(*threshold, before.is_some())) {
            Some(before.unwrap_or(Reset::BrownOut))
        } else {
            None
        };
        match (before, self.held) {
            (_, Some(_)) => Supplied::HeldInReset,
            (Some(cause), None) => Supplied::Restarts(cause),
            (None, None) => Supplied::Enough,
        }
    }

    /// Updates the voltage detector. `cr` is the register `PWR_CR`.
    pub(crate) fn detect(&mut self, cr: u32) {
        let (falls, rises) = DETECTOR[(cr >> 5 & 7) as usize];
        let low = cr & PVDE != 0 && self.microvolts < if self.low { rises } else { falls };
        self.warned |= low && !self.low;
        self.low = low;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_brown_out_level_has_100_mv_of_hysteresis() {
        for (level, (falls, rises)) in
            [(0, (2_750_000, 2_850_000)), (1, (2_440_000, 2_530_000)), (2, (2_130_000, 2_230_000))]
        {
            let mut supply = Supervisors::new();
            assert_eq!(supply.supply(falls, level), Supplied::Enough);
            assert_eq!(supply.supply(falls - 1, level), Supplied::HeldInReset);
            assert_eq!(supply.supply(rises - 1, level), Supplied::HeldInReset);
            assert_eq!(supply.supply(rises, level), Supplied::Restarts(Reset::BrownOut));
            assert_eq!(supply.supply(rises, level), Supplied::Enough);
        }
    }

    #[test]
    fn without_a_brown_out_level_only_power_down_resets_the_part() {
        let mut supply = Supervisors::new();
        assert_eq!(supply.supply(1_600_000, 3), Supplied::Enough);
        assert_eq!(supply.supply(1_599_999, 3), Supplied::HeldInReset);
        assert_eq!(supply.supply(1_640_000, 3), Supplied::Restarts(Reset::PowerOn));
        // After a supply of 0 the part restarts as at power-on, whatever the brown-out level is.
        assert_eq!(supply.supply(0, 0), Supplied::HeldInReset);
        assert_eq!(supply.supply(2_849_999, 0), Supplied::HeldInReset);
        assert_eq!(supply.supply(2_850_000, 0), Supplied::Restarts(Reset::PowerOn));
    }

    #[test]
    fn the_detector_warns_once_each_time_the_supply_falls_below_its_threshold() {
        let mut supply = Supervisors::new();
        let cr = 7 << 5 | PVDE;
        for (microvolts, low, warned) in
            [(2_950_000, false, false), (2_949_999, true, true), (3_069_999, true, false), (3_070_000, false, false)]
        {
            supply.supply(microvolts, 0);
            supply.detect(cr);
            assert_eq!((supply.low, std::mem::take(&mut supply.warned)), (low, warned), "{microvolts}");
        }
        supply.supply(1_700_000, 3);
        supply.detect(7 << 5);
        assert!(!supply.low, "it is off");
        supply.detect(cr);
        assert!(supply.low && supply.warned, "it warns of what is low already when it is switched on");
    }
}
