//! Time: the 16 MHz peripheral clock and the 32.768 kHz clock as exact functions of the virtual clock (PS 5.4).
//!
//! | covered | PS |
//! |---|---|
//! | PCLK16M from HFINT until HFXO has started, then from the crystal with its error | 5.4 |
//! | LFCLK from LFRC, LFXO or synthesised from HFCLK, each with its error | 5.4 |
//!
//! An instant is a whole nanosecond and a tick of 16 MHz lasts 62.5: counts are therefore computed from where the clock
//! last changed its rate, in integers, and never by adding up rounded periods, so nothing drifts however long a run
//! lasts.
//!
//! Left out: temperature and ageing (an error is a constant of the run), and the phase between PCLK16M and the core
//! clock, because the core retires instructions on a clock of its own.

/// Nanoseconds in a second, and parts in a billion.
const GIGA: u128 = 1_000_000_000;

/// The rate of PCLK16M, in Hz, which TIMER, SPIM and UARTE count.
pub(crate) const PCLK16M: u64 = 16_000_000;
/// The rate of LFCLK, in Hz.
pub(crate) const LFCLK: u64 = 32_768;

/// A clock of a nominal rate and an error, counting since it last changed either.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Oscillator {
    hz: u64,
    ppb: i64,
    /// The instant, in ns, and the count there.
    anchor: (u64, u64),
    /// How far it was into the next tick there, in 10^-18 of one.
    phase: u128,
}

impl Oscillator {
    pub(crate) fn new(hz: u64, ppb: i64, at: u64) -> Self {
        assert!(ppb.unsigned_abs() < 500_000_000, "an error of {ppb} ppb is no clock");
        Self { hz, ppb, anchor: (at, 0), phase: 0 }
    }

    /// Ticks in 10^18 ns.
    fn rate(&self) -> u128 {
        u128::from(self.hz) * u128::from(1_000_000_000_u64.wrapping_add_signed(self.ppb))
    }

    /// Ticks since the anchor, in 10^-18.
    fn run(&self, at: u64) -> u128 {
        self.phase + u128::from(at.saturating_sub(self.anchor.0)) * self.rate()
    }

    /// The ticks counted by `at`, which is not before the last change of rate.
    pub(crate) fn ticks(&self, at: u64) -> u64 {
        self.anchor.1 + (self.run(at) / (GIGA * GIGA)) as u64
    }

    /// The first instant at which `tick` has been counted.
    pub(crate) fn instant(&self, tick: u64) -> u64 {
        let ticks = u128::from(tick.saturating_sub(self.anchor.1));
        self.anchor.0 + (ticks * GIGA * GIGA).saturating_sub(self.phase).div_ceil(self.rate()) as u64
    }

    /// Goes on counting with another error from `at`.
    pub(crate) fn retune(&mut self, at: u64, ppb: i64) {
        let phase = self.run(at) % (GIGA * GIGA);
        self.anchor = (at, self.ticks(at));
        self.phase = phase;
        self.ppb = ppb;
    }
}

/// Both clocks as the peripherals see them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Clocks {
    /// PCLK16M.
    pub(crate) hf: Oscillator,
    /// LFCLK while it runs.
    pub(crate) lf: Option<Oscillator>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tick_is_counted_at_its_own_instant_and_not_a_nanosecond_before() {
        for ppb in [-40_000, 0, 20_001] {
            let clock = Oscillator::new(PCLK16M, ppb, 17);
            for tick in [1, 2, 3, 15_999_999, 16_000_000, 160_000_000_001] {
                let at = clock.instant(tick);
                assert_eq!(clock.ticks(at), tick, "{ppb} ppb");
                assert_eq!(clock.ticks(at - 1), tick - 1, "{ppb} ppb");
            }
        }
    }

    #[test]
    fn an_error_in_ppb_is_that_many_nanoseconds_in_a_second() {
        let fast = Oscillator::new(PCLK16M, 20_000, 0);
        assert_eq!(fast.instant(PCLK16M), 1_000_000_000 - 20_000 + 1);
        let slow = Oscillator::new(LFCLK, -20_000, 0);
        assert_eq!(slow.instant(LFCLK), 1_000_000_000 + 20_001);
    }

    #[test]
    fn a_change_of_nothing_moves_no_tick() {
        let clock = Oscillator::new(LFCLK, 12_345, 5);
        let mut touched = clock;
        for at in [17, 30_000, 1_000_003, 77_777_777] {
            touched.retune(at, 12_345);
        }
        for tick in 3_000..3_100 {
            assert_eq!(touched.instant(tick), clock.instant(tick));
        }
    }

    #[test]
    fn a_change_of_rate_keeps_the_count() {
        let mut clock = Oscillator::new(PCLK16M, 0, 0);
        clock.retune(1_000_000, 15_000_000);
        assert_eq!(clock.ticks(1_000_000), 16_000);
        assert_eq!(clock.ticks(2_000_000), 16_000 + 16_240);
    }
}
