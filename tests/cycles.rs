//! Time in core cycles.

use core::hint::black_box;

use cortex_m::peripheral::{DCB, DWT};

/// A running cycle counter.
pub struct Cycles(DWT);

/// The least and the greatest time that something took.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
pub struct Taken {
    /// Cycles of the fastest call.
    pub min: u32,
    /// Cycles of the slowest call.
    pub max: u32,
}

impl Cycles {
    /// Starts the counter.
    pub fn start(mut dcb: DCB, mut dwt: DWT) -> Self {
        dcb.enable_trace();
        dwt.set_cycle_count(0);
        dwt.enable_cycle_counter();
        Self(dwt)
    }

    /// The cycles one call takes, the reading of the counter included (a few).
    pub fn of<T>(&self, work: impl FnOnce() -> T) -> u32 {
        let began = self.0.cyccnt.read();
        black_box(work());
        self.0.cyccnt.read().wrapping_sub(began)
    }

    /// The cycles that the same work takes over several inputs. Each is run once before it is timed, so that a board's
    /// flash cache is warm for all of them alike.
    pub fn over<I, T>(&self, inputs: impl IntoIterator<Item = I>, mut work: impl FnMut(&I) -> T) -> Taken {
        let mut taken = Taken { min: u32::MAX, max: 0 };
        for input in inputs {
            black_box(work(black_box(&input)));
            let cycles = self.of(|| work(black_box(&input)));
            taken = Taken { min: taken.min.min(cycles), max: taken.max.max(cycles) };
        }
        taken
    }
}

impl Taken {
    /// Panics unless the slowest call kept the bound and the data made no difference beyond `spread` cycles.
    pub fn assert(self, what: &str, bound: u32, spread: u32) {
        defmt::info!("{=str}: {=u32}..{=u32} cycles of at most {=u32}", what, self.min, self.max, bound);
        // Below this the work was not done: the optimiser removed it or the counter stands still.
        defmt::assert!(self.min >= 16, "{=str} took {=u32} cycles, which is no work at all", what, self.min);
        defmt::assert!(self.max <= bound, "{=str} took {=u32} cycles, more than {=u32}", what, self.max, bound);
        defmt::assert!(self.max - self.min <= spread, "{=str} depends on its data: {}", what, self);
    }

    /// Panics if the fastest call took less than `bound`: then some of the work was not done.
    pub fn assert_at_least(self, what: &str, bound: u32) {
        defmt::info!("{=str}: {=u32}..{=u32} cycles of at least {=u32}", what, self.min, self.max, bound);
        defmt::assert!(self.min >= bound, "{=str} took {=u32} cycles, less than {=u32}", what, self.min, bound);
    }
}
