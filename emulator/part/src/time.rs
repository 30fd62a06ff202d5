//! Cycles of a part's core and the bench's nanoseconds.

/// A count of a part's core clock cycles, from power-on. It goes on through resets and sleep.
pub type Cycle = u64;

/// A cycle that never comes.
pub const NEVER: Cycle = u64::MAX;

/// Fractional bits of a period.
const FRACTION: u32 = 32;

/// The bench's time of a part's cycles: a straight line that begins anew whenever the part's core clock changes.
///
/// A period is held in 2⁻³² ns. At 144 MHz that makes a crystal wrong by less than 2·10⁻¹¹, a hundred-thousandth of
/// what a crystal is off by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timebase {
    /// A cycle and its instant, in 2⁻³² ns.
    cycle: Cycle,
    instant: u128,
    /// Of one cycle, in 2⁻³² ns.
    period: u64,
}

impl Timebase {
    /// Cycle 0 is at 0 ns. A core at `hz` whose source is `ppb` parts per billion fast (negative: slow).
    ///
    /// # Panics
    ///
    /// If the rate is zero or below.
    #[must_use]
    pub fn new(hz: u64, ppb: i64) -> Self {
        Self { cycle: 0, instant: 0, period: period(hz, ppb) }
    }

    /// From `cycle` on the core runs at `hz`, `ppb` parts per billion fast.
    ///
    /// # Panics
    ///
    /// If the rate is zero or below.
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

    /// When `cycle` begins, in whole nanoseconds, rounded down. [`NEVER`] stays `u64::MAX`.
    #[must_use]
    pub fn ns(&self, cycle: Cycle) -> u64 {
        if cycle == NEVER {
            return u64::MAX;
        }
        u64::try_from(self.fine(cycle) >> FRACTION).unwrap_or(u64::MAX)
    }

    /// The first cycle that begins at `ns` or later. `u64::MAX` stays [`NEVER`].
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

    /// How long `cycles` last at the present rate, in nanoseconds, rounded down.
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

/// The period of `hz`, `ppb` parts per billion fast, in 2⁻³² ns, to the nearest.
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
