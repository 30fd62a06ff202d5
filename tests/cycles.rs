//! Measures the time of work in core cycles and compares it with bounds.
//!
//! A suite of on-target tests is built for one [`Clock`], and each bound is stated for each clock ([`Bounds`]).

use core::hint::black_box;

use cortex_m::peripheral::{DCB, DWT};

/// The clock on which a suite runs, which gives the cost of a core cycle: one of the bench's clocks
/// (`emulator/cortex-m4/src/cost.rs`), or that of hardware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// The bench counts one cycle for each halfword of code.
    Fast,
    /// The bench counts the least cycles in the TRM's tables for each instruction.
    Optimistic,
    /// The bench counts the most cycles in the TRM's tables for each instruction, with every wait state.
    Pessimistic,
    /// The suite runs on a board. The bounds of the pessimistic clock apply, because no silicon is slower.
    Hardware,
}

/// The clock for which the suite was built. `cargo xtask test` sets the environment variable for a run on the bench;
/// without it the clock is that of hardware.
pub const CLOCK: Clock = match option_env!("ON_TARGET_CLOCK") {
    None => Clock::Hardware,
    Some(name) => match name.as_bytes() {
        b"fast" => Clock::Fast,
        b"optimistic" => Clock::Optimistic,
        b"pessimistic" => Clock::Pessimistic,
        _ => panic!("ON_TARGET_CLOCK: fast, optimistic or pessimistic"),
    },
};

/// The cycles by which a board's flash cache and prefetch may increase the difference between the slowest and the
/// fastest call. A few wait states depend on where code lies in the flash, and on what was fetched before. The bench's
/// fast and optimistic clocks have no such states.
const HARDWARE_SPREAD: u32 = 64;

/// The most cycles that some work may take, on each clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bounds {
    /// The bound on [`Clock::Fast`], in cycles.
    pub fast: u32,
    /// The bound on [`Clock::Optimistic`], in cycles.
    pub optimistic: u32,
    /// The bound on [`Clock::Pessimistic`] and [`Clock::Hardware`], in cycles.
    pub pessimistic: u32,
    /// The most cycles by which different data may change the time on the bench; `u32::MAX` if only the bound is
    /// checked.
    pub spread: u32,
}

/// Returns the bounds for the fast, optimistic and pessimistic clock, and by how much the data may change the time, in
/// cycles.
#[must_use]
pub const fn bounds(fast: u32, optimistic: u32, pessimistic: u32, spread: u32) -> Bounds {
    Bounds { fast, optimistic, pessimistic, spread }
}

impl Bounds {
    /// Returns the bound of the work for [`CLOCK`], in cycles.
    #[must_use]
    pub const fn here(self) -> u32 {
        match CLOCK {
            Clock::Fast => self.fast,
            Clock::Optimistic => self.optimistic,
            Clock::Pessimistic | Clock::Hardware => self.pessimistic,
        }
    }

    /// Returns by how many cycles the data may change the time of the work, for [`CLOCK`].
    #[must_use]
    pub const fn spread_here(self) -> u32 {
        match CLOCK {
            Clock::Hardware => self.spread.saturating_add(HARDWARE_SPREAD),
            _ => self.spread,
        }
    }
}

/// A running cycle counter.
pub struct Cycles(DWT);

/// The least and the greatest time that some work took.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
pub struct Taken {
    /// The number of cycles of the fastest call.
    pub min: u32,
    /// The number of cycles of the slowest call.
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

    /// Returns the cycles of one call of `work`, including a few for the reading of the counter, and its result.
    pub fn timed<T>(&self, work: impl FnOnce() -> T) -> (u32, T) {
        let began = self.0.cyccnt.read();
        let result = black_box(work());
        (self.0.cyccnt.read().wrapping_sub(began), result)
    }

    /// Returns the cycles that one call of `work` takes.
    pub fn of<T>(&self, work: impl FnOnce() -> T) -> u32 {
        self.timed(work).0
    }

    /// Returns the times that the same work takes over several inputs, in cycles. Each input is run once before it is
    /// timed. So a board's flash cache holds the code for all inputs alike.
    pub fn over<I, T>(&self, inputs: impl IntoIterator<Item = I>, mut work: impl FnMut(&I) -> T) -> Taken {
        self.over_prepared(inputs, |_| (), |input, ()| work(input))
    }

    /// Returns the times like [`Cycles::over`], for work that changes its state. Before each input, `prepare` makes a
    /// new state, which is not timed.
    #[inline(always)]
    pub fn over_prepared<I, S, T>(
        &self,
        inputs: impl IntoIterator<Item = I>,
        mut prepare: impl FnMut(&I) -> S,
        mut work: impl FnMut(&I, &mut S) -> T,
    ) -> Taken {
        let mut taken = Taken::NONE;
        // The work is called at a single place in the code, so that all inputs run the same copy of it.
        let mut turn = |input: &I| {
            let mut state = black_box(prepare(black_box(input)));
            self.of(|| work(black_box(input), black_box(&mut state)))
        };
        for input in inputs {
            for timed in [false, true] {
                let cycles = turn(black_box(&input));
                if timed {
                    taken.note(cycles);
                }
            }
        }
        taken
    }
}

impl Taken {
    /// The state before any call was timed.
    pub const NONE: Self = Self { min: u32::MAX, max: 0 };

    /// Records another call of the work, which took `cycles`.
    pub fn note(&mut self, cycles: u32) {
        *self = Self { min: self.min.min(cycles), max: self.max.max(cycles) };
    }

    /// Returns by how many cycles the time has varied with the data.
    #[must_use]
    pub const fn spread(self) -> u32 {
        self.max.saturating_sub(self.min)
    }

    /// Panics if the slowest call exceeded its bound, or if the data changed the time by more cycles than allowed.
    pub fn assert(self, what: &str, bounds: Bounds) {
        let (bound, spread) = (bounds.here(), bounds.spread_here());
        defmt::info!(
            "{=str}: {=u32}..{=u32} cycles of at most {=u32}, spread {=u32} of at most {=u32}",
            what,
            self.min,
            self.max,
            bound,
            self.spread(),
            spread
        );
        // Below four cycles, the optimiser has removed the work, or the cycle counter stands still.
        defmt::assert!(self.min >= 4, "{=str} took {=u32} cycles, which is no work at all", what, self.min);
        defmt::assert!(self.max <= bound, "{=str} took {=u32} cycles, more than {=u32}", what, self.max, bound);
        defmt::assert!(self.spread() <= spread, "{=str} depends on its data: {}", what, self);
    }

    /// Panics if the fastest call took less than `bound`, because some of the work was left out then.
    pub fn assert_at_least(self, what: &str, bound: u32) {
        defmt::info!("{=str}: {=u32}..{=u32} cycles of at least {=u32}", what, self.min, self.max, bound);
        defmt::assert!(self.min >= bound, "{=str} took {=u32} cycles, less than {=u32}", what, self.min, bound);
    }
}

/// Shows that a dependence on data is detected: a comparison of two arrays stops at the first difference.
pub fn a_dependence_is_seen(cycles: &Cycles) {
    const LENGTH: usize = 64;
    let differing_at = |place: usize| {
        let mut bytes = [0_u8; LENGTH];
        bytes[place] = 1;
        bytes
    };
    let compare = |bytes: &[u8; LENGTH]| bytes.iter().take_while(|byte| black_box(**byte) == 0).count();
    let taken = cycles.over([differing_at(0), differing_at(LENGTH / 2), differing_at(LENGTH - 1)], compare);
    defmt::info!("a comparison that stops early: {=u32}..{=u32} cycles", taken.min, taken.max);
    // A comparison that stops at the first difference varies with the data by at least two instructions for each byte.
    // No suite allows the time of its work to vary by that much.
    defmt::assert!(taken.spread() >= 2 * (LENGTH as u32 - 1), "a dependence on data was not seen: {}", taken);
    let same = cycles.over([differing_at(7); 3], compare);
    defmt::assert!(same.spread() <= bounds(0, 0, 0, 16).spread_here(), "a spread where there is none: {}", same);
}
