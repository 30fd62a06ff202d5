//! Time in core cycles, and the bounds that it is held against.
//!
//! A suite is built for one [`Clock`], and each bound is stated for each of them ([`Bounds`]).

use core::hint::black_box;

use cortex_m::peripheral::{DCB, DWT};

/// What a core cycle is worth where the suite runs: one of the bench's clocks (`emulator/cortex-m4/src/cost.rs`), or
/// hardware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// The bench: one cycle for each halfword of code.
    Fast,
    /// The bench: the least of the TRM's tables.
    Optimistic,
    /// The bench: the most of the TRM's tables, with every wait state.
    Pessimistic,
    /// A board. No silicon is slower than the pessimistic clock, so its bounds hold.
    Hardware,
}

/// The clock for which the suite was built: `cargo xtask test` sets the variable for a run on the bench.
pub const CLOCK: Clock = match option_env!("ON_TARGET_CLOCK") {
    None => Clock::Hardware,
    Some(name) => match name.as_bytes() {
        b"fast" => Clock::Fast,
        b"optimistic" => Clock::Optimistic,
        b"pessimistic" => Clock::Pessimistic,
        _ => panic!("ON_TARGET_CLOCK: fast, optimistic or pessimistic"),
    },
};

/// What a board's flash cache and prefetch may add to the spread, cycles: where code lies in the lines of the flash and
/// what was fetched before decide about a few wait states. The bench has none on its fast and optimistic clocks.
const HARDWARE_SPREAD: u32 = 64;

/// The most cycles that something may take, on each clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bounds {
    /// On [`Clock::Fast`].
    pub fast: u32,
    /// On [`Clock::Optimistic`].
    pub optimistic: u32,
    /// On [`Clock::Pessimistic`] and [`Clock::Hardware`].
    pub pessimistic: u32,
    /// The most by which data may change it, on each of the bench's clocks; `u32::MAX` where the bound alone counts.
    pub spread: u32,
}

/// Bounds for fast, optimistic and pessimistic, of something that data may change by `spread` cycles.
#[must_use]
pub const fn bounds(fast: u32, optimistic: u32, pessimistic: u32, spread: u32) -> Bounds {
    Bounds { fast, optimistic, pessimistic, spread }
}

impl Bounds {
    /// For [`CLOCK`].
    #[must_use]
    pub const fn here(self) -> u32 {
        match CLOCK {
            Clock::Fast => self.fast,
            Clock::Optimistic => self.optimistic,
            Clock::Pessimistic | Clock::Hardware => self.pessimistic,
        }
    }

    /// The spread that is allowed on [`CLOCK`].
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

    /// The cycles one call takes, the reading of the counter included (a few), and what it gave.
    pub fn timed<T>(&self, work: impl FnOnce() -> T) -> (u32, T) {
        let began = self.0.cyccnt.read();
        let result = black_box(work());
        (self.0.cyccnt.read().wrapping_sub(began), result)
    }

    /// The cycles one call takes.
    pub fn of<T>(&self, work: impl FnOnce() -> T) -> u32 {
        self.timed(work).0
    }

    /// The cycles that the same work takes over several inputs. Each is run once before it is timed, so that a board's
    /// flash cache is warm for all of them alike.
    pub fn over<I, T>(&self, inputs: impl IntoIterator<Item = I>, mut work: impl FnMut(&I) -> T) -> Taken {
        self.over_prepared(inputs, |_| (), |input, ()| work(input))
    }

    /// The same for work that changes what it works on: `prepare` makes that anew for each input, untimed.
    #[inline(always)]
    pub fn over_prepared<I, S, T>(
        &self,
        inputs: impl IntoIterator<Item = I>,
        mut prepare: impl FnMut(&I) -> S,
        mut work: impl FnMut(&I, &mut S) -> T,
    ) -> Taken {
        let mut taken = Taken::NONE;
        // Called in one place, so that every input and both turns run the same copy of the code.
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
    /// Nothing was timed yet.
    pub const NONE: Self = Self { min: u32::MAX, max: 0 };

    /// One more call took `cycles`.
    pub fn note(&mut self, cycles: u32) {
        *self = Self { min: self.min.min(cycles), max: self.max.max(cycles) };
    }

    /// By how much the data changed it, cycles.
    #[must_use]
    pub const fn spread(self) -> u32 {
        self.max.saturating_sub(self.min)
    }

    /// Panics unless the slowest call kept the bound and the data made no difference beyond the spread allowed.
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
        // Below this the work was not done: the optimiser removed it or the counter stands still.
        defmt::assert!(self.min >= 4, "{=str} took {=u32} cycles, which is no work at all", what, self.min);
        defmt::assert!(self.max <= bound, "{=str} took {=u32} cycles, more than {=u32}", what, self.max, bound);
        defmt::assert!(self.spread() <= spread, "{=str} depends on its data: {}", what, self);
    }

    /// Panics if the fastest call took less than `bound`: then some of the work was not done.
    pub fn assert_at_least(self, what: &str, bound: u32) {
        defmt::info!("{=str}: {=u32}..{=u32} cycles of at least {=u32}", what, self.min, self.max, bound);
        defmt::assert!(self.min >= bound, "{=str} took {=u32} cycles, less than {=u32}", what, self.min, bound);
    }
}

/// Shows that a dependence on data is noticed: compares two arrays and stops at the first difference.
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
    // Two instructions for each byte at least, which is more than any spread that a suite allows.
    defmt::assert!(taken.spread() >= 2 * (LENGTH as u32 - 1), "a dependence on data was not seen: {}", taken);
    let same = cycles.over([differing_at(7); 3], compare);
    defmt::assert!(same.spread() <= bounds(0, 0, 0, 16).spread_here(), "a spread where there is none: {}", same);
}
