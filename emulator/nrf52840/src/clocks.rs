//! The 16 MHz peripheral clock and the 32.768 kHz clock as exact functions of the core's cycles (PS 5.4).
//!
//! | covered | PS |
//! |---|---|
//! | the core at 64 MHz and PCLK16M at a quarter of it, in phase; both from HFINT until HFXO has started | 5.4 |
//! | LFCLK from LFRC, LFXO or synthesised from HFCLK, each with its own error | 5.4 |
//!
//! HFINT and HFXO also clock the core. Their error changes the length of a core cycle, and PCLK16M is always four core
//! cycles. LFCLK has its own oscillator, so its rate in core cycles changes whenever either source changes. Counts are
//! computed in integers from the last change, so that no error accumulates.
//!
//! Left out: temperature and ageing. An error is constant over a run.
use emulator_part::Cycle;

pub(crate) const CYCLES_PER_TICK: u64 = 4;

/// The core cycles in `ns` nanoseconds, rounded up, of a clock without error.
pub(crate) const fn cycles(ns: u64) -> u64 {
    (ns as u128 * 64).div_ceil(1000) as u64
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Pclk16m;

impl Pclk16m {
    #[inline]
    pub(crate) const fn ticks(self, at: Cycle) -> u64 {
        at / CYCLES_PER_TICK
    }

    /// The core cycle at which PCLK16M reaches `tick`.
    #[inline]
    pub(crate) const fn instant(self, tick: u64) -> Cycle {
        tick * CYCLES_PER_TICK
    }
}

/// LFCLK, which counts on from the last change of its rate.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lfclk {
    lf_ppb: i64,
    hf_ppb: i64,
    /// The cycle, and the count of ticks, at the last change of rate.
    anchor: (Cycle, u64),
    /// The fraction of a tick that had passed at the last change of rate, in units of 1 / [`Lfclk::den`] of a tick.
    phase: u128,
}

/// Returns a billion plus `ppb`: the rate of a clock with this error (positive if fast), in billionths of the exact
/// rate.
fn scale(ppb: i64) -> u64 {
    1_000_000_000_u64.wrapping_add_signed(ppb)
}

impl Lfclk {
    /// Makes a clock that starts at `at`. The errors of LFCLK and of the core's clock are in parts per billion,
    /// positive if fast.
    pub(crate) fn new(lf_ppb: i64, hf_ppb: i64, at: Cycle) -> Self {
        assert!(lf_ppb.unsigned_abs() < 500_000_000, "an error of {lf_ppb} ppb is no clock");
        Self { lf_ppb, hf_ppb, anchor: (at, 0), phase: 0 }
    }

    /// The numerator of the number of ticks per core cycle. Without errors the fraction is 32768 / 64 000 000 = 8 /
    /// 15625.
    fn num(&self) -> u128 {
        8 * u128::from(scale(self.lf_ppb))
    }

    fn den(&self) -> u128 {
        15_625 * u128::from(scale(self.hf_ppb))
    }

    fn run(&self, at: Cycle) -> u128 {
        self.phase + u128::from(at.saturating_sub(self.anchor.0)) * self.num()
    }

    /// The number of ticks at `at`, which must not be before the last change of rate.
    pub(crate) fn ticks(&self, at: Cycle) -> u64 {
        self.anchor.1 + (self.run(at) / self.den()) as u64
    }

    /// The first cycle at which the count has reached `tick`.
    pub(crate) fn instant(&self, tick: u64) -> Cycle {
        let ticks = u128::from(tick.saturating_sub(self.anchor.1));
        self.anchor.0 + (ticks * self.den()).saturating_sub(self.phase).div_ceil(self.num()) as u64
    }

    /// Changes the errors of both clocks at `at`.
    pub(crate) fn retune(&mut self, at: Cycle, lf_ppb: i64, hf_ppb: i64) {
        let (den, phase) = (self.den(), self.run(at) % self.den());
        self.anchor = (at, self.ticks(at));
        (self.lf_ppb, self.hf_ppb) = (lf_ppb, hf_ppb);
        self.phase = phase * self.den() / den;
    }

    pub(crate) fn ppb(&self) -> i64 {
        self.lf_ppb
    }
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Clocks {
    pub(crate) hf: Pclk16m,
    /// How much faster than 64 MHz the core's clock is, in parts per billion.
    pub(crate) hf_ppb: i64,
    pub(crate) lf: Option<Lfclk>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tick_is_counted_at_its_own_cycle_and_not_one_before() {
        for (lf, hf) in [(0, 0), (-40_000, 20_001), (2_000_000, 15_000_000)] {
            let clock = Lfclk::new(lf, hf, 17);
            for tick in [1, 2, 3, 32_767, 32_768, 160_000_000_001] {
                let at = clock.instant(tick);
                assert_eq!(clock.ticks(at), tick, "{lf} {hf} ppb");
                assert_eq!(clock.ticks(at - 1), tick - 1, "{lf} {hf} ppb");
            }
        }
    }

    #[test]
    fn a_second_of_an_exact_crystal_is_sixty_four_million_cycles() {
        assert_eq!(Lfclk::new(0, 0, 0).instant(32_768), 64_000_000);
        assert_eq!(Lfclk::new(20_000, 20_000, 0).instant(32_768), 64_000_000);
    }

    #[test]
    fn a_change_of_nothing_moves_no_tick() {
        let clock = Lfclk::new(12_345, 0, 5);
        let mut touched = clock;
        for at in [17, 30_000, 1_000_003, 77_777_777] {
            touched.retune(at, 12_345, 0);
        }
        for tick in 40_000..40_100 {
            assert_eq!(touched.instant(tick), clock.instant(tick));
        }
    }

    #[test]
    fn a_change_of_the_core_clock_keeps_the_count() {
        let mut clock = Lfclk::new(0, 0, 0);
        let at = clock.instant(1_000);
        clock.retune(at, 0, 15_000_000);
        assert_eq!(clock.ticks(at), 1_000);
        // A fast core needs more of its cycles for a tick of LFCLK.
        assert_eq!(clock.instant(1_000 + 32_768) - at, 64_000_000 * 1_015 / 1_000);
    }
}
