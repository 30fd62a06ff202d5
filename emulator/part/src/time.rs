//! The conversion between cycles of a part's core and nanoseconds.

/// A number of core clock cycles since power-on. Resets and sleep do not stop the count.
pub type Cycle = u64;

/// A cycle that never comes.
pub const NEVER: Cycle = u64::MAX;

/// The number of fractional bits of a period in nanoseconds.
const FRACTION: u32 = 32;

/// The relation between a part's cycles and nanoseconds. It is linear between two changes of the core's clock.
///
/// A period is held in units of 2⁻³² ns. At 144 MHz the rounding error is below 2·10⁻¹¹, far less than a crystal's
/// error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timebase {
    cycle: Cycle,
    instant: u128,
    period: u64,
}

impl Timebase {
    /// Makes a timebase whose cycle 0 is at 0 ns, for a core at `hz` whose clock is `ppb` parts per billion fast
    /// (negative: slow).
    ///
    /// # Panics
    ///
    /// Panics if the rate is not positive.
    #[must_use]
    pub fn new(hz: u64, ppb: i64) -> Self {
        Self { cycle: 0, instant: 0, period: period(hz, ppb) }
    }

    /// Changes the rate from `cycle` on to `hz`, with a clock that is `ppb` parts per billion fast.
    ///
    /// # Panics
    ///
    /// Panics if the rate is not positive.
    pub fn change(&mut self, cycle: Cycle, hz: u64, ppb: i64) {
        let period = period(hz, ppb);
        if period != self.period {
            self.instant = self.fine(cycle);
            self.cycle = cycle;
            self.period = period;
        }
    }

    fn fine(&self, cycle: Cycle) -> u128 {
        if cycle >= self.cycle {
            self.instant + u128::from(cycle - self.cycle) * u128::from(self.period)
        } else {
            self.instant.saturating_sub(u128::from(self.cycle - cycle) * u128::from(self.period))
        }
    }

    /// The instant at which `cycle` begins, in whole nanoseconds, rounded down. [`NEVER`] gives `u64::MAX`.
    #[must_use]
    pub fn ns(&self, cycle: Cycle) -> u64 {
        if cycle == NEVER {
            return u64::MAX;
        }
        u64::try_from(self.fine(cycle) >> FRACTION).unwrap_or(u64::MAX)
    }

    /// The first cycle that begins at or after `ns`. `u64::MAX` gives [`NEVER`].
    #[must_use]
    pub fn cycle(&self, ns: u64) -> Cycle {
        if ns == u64::MAX {
            return NEVER;
        }
        let target = u128::from(ns) << FRACTION;
        if target >= self.instant {
            let ahead = (target - self.instant).div_ceil(u128::from(self.period));
            self.cycle.saturating_add(u64::try_from(ahead).unwrap_or(u64::MAX))
        } else {
            let behind = (self.instant - target) / u128::from(self.period);
            self.cycle.saturating_sub(u64::try_from(behind).unwrap_or(u64::MAX))
        }
    }

    /// The length of `cycles` at the present rate, in nanoseconds, rounded down.
    #[must_use]
    pub fn span_ns(&self, cycles: u64) -> u64 {
        u64::try_from((u128::from(cycles) * u128::from(self.period)) >> FRACTION).unwrap_or(u64::MAX)
    }

    /// The length of one cycle in nanoseconds, rounded up.
    #[must_use]
    pub fn cycle_ns(&self) -> u64 {
        (self.period >> FRACTION) + 1
    }
}

/// The period in units of 2⁻³² ns, to the nearest, of a clock of `hz` that is `ppb` parts per billion fast.
fn period(hz: u64, ppb: i64) -> u64 {
    const GIGA: u128 = 1_000_000_000;
    let scale = u128::try_from(1_000_000_000_i64.saturating_add(ppb)).expect("an oscillator that oscillates");
    let rate = u128::from(hz) * scale;
    assert!(rate > 0, "a core that runs");
    u64::try_from((((GIGA * GIGA) << FRACTION) + rate / 2) / rate).expect("above a quarter of a hertz")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cycle_that_begins_at_an_instant_is_found_from_it() {
        for hz in [16_000_000, 64_000_000, 144_000_000, 168_000_000, 180_000_000] {
            for ppb in [-200_000, 0, 777] {
                let base = Timebase::new(hz, ppb);
                for cycle in [0, 1, 2, 3, 1_000_003, 144_000_000_000] {
                    let ns = base.ns(cycle);
                    let found = base.cycle(ns);
                    assert!(found <= cycle && cycle - found <= 1, "{hz} {ppb} {cycle}");
                    assert!(base.ns(base.cycle(ns + 1)) > ns);
                }
            }
        }
    }

    #[test]
    fn a_change_of_rate_keeps_the_instant_of_its_cycle() {
        let mut base = Timebase::new(16_000_000, 0);
        base.change(16_000, 144_000_000, 0);
        assert_eq!(base.ns(16_000), 1_000_000);
        assert_eq!(base.ns(16_000 + 144_000), 2_000_000);
        assert_eq!(base.cycle(1_000_000), 16_000);
    }
}
