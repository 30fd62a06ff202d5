//! Measures the speed of the bench.
//!
//! The measurement is part of this crate, so that the compiler optimises it like [`super::run`], whatever the options
//! of the caller.

use std::hint::black_box;

use cpu_time::ThreadTime;

use emulator_node::Threads;

use super::{Bench, Error, Setup};

/// The number of runs of the bench and of the [`yardstick`]. The shortest run of each counts, because other work on the
/// machine delayed it least.
const RUNS: usize = 5;

/// The number of copies of the running bench that are timed. The shortest time counts.
const COPIES: usize = 100;

/// The cost of one virtual second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speed {
    /// The time that this machine takes for a virtual second, s.
    pub seconds: f64,
    /// The number of instructions that HORUS's core executes in a virtual second.
    pub horus: f64,
    /// The number of instructions that the DPR's core executes in a virtual second.
    pub dpr: f64,
    /// The time that a copy of the whole bench takes, s.
    pub copy: f64,
    /// The time of the yardstick, s: a fixed piece of work that no change of this project makes faster or slower.
    pub yardstick: f64,
}

impl Speed {
    /// The time that a virtual second takes, as a multiple of the yardstick's time.
    #[must_use]
    pub fn yardsticks(&self) -> f64 {
        self.seconds / self.yardstick
    }
}

/// A fixed piece of work that no change of this project makes faster or slower: a chain of loads and multiplications in
/// which each step waits for the one before. How the compiler places the loop in memory does not matter to it, as it
/// does to a loop that the processor's front end limits. A time divided by the yardstick's time can be compared between
/// machines, even if a machine has other work.
fn yardstick() {
    let table: [u32; 256] = std::array::from_fn(|index| (index as u32).wrapping_mul(0x9E37_79B9));
    let table = black_box(table);
    let mut value = 1_u32;
    for _ in 0..6_000_000 {
        value = (value ^ table[(value & 0xFF) as usize]).wrapping_mul(0x01C6_7F4D).rotate_left(7);
    }
    black_box(value);
}

/// Returns the processor time that this thread takes for `work`, s.
fn seconds(work: impl FnOnce()) -> f64 {
    let began = ThreadTime::now();
    work();
    began.elapsed().as_secs_f64()
}

/// Runs the bench on the fast clock and on one thread to its end, and measures the part from `warm_up_ns` on.
///
/// # Errors
///
/// The errors are those of [`Bench::new`].
pub fn speed(setup: &Setup, warm_up_ns: u64) -> Result<Speed, Error> {
    let mut warm: Bench = Bench::new(setup)?;
    warm.run_to(warm_up_ns, Threads::One);
    let virtual_seconds = setup.duration_ns.saturating_sub(warm_up_ns) as f64 / 1e9;
    let copy = (0..COPIES).map(|_| {
        let mut copy = None;
        seconds(|| copy = Some(warm.clone()))
    });
    let copy = copy.fold(f64::INFINITY, f64::min);
    let instructions = |bench: &Bench| [bench.horus().instructions(), bench.dpr().instructions()];
    let before = instructions(&warm);
    let (mut link, mut fixed, mut after) = (f64::INFINITY, f64::INFINITY, before);
    for _ in 0..RUNS {
        let mut bench = warm.clone();
        fixed = fixed.min(seconds(yardstick));
        link = link.min(seconds(|| bench.run_to(setup.duration_ns, Threads::One)));
        after = instructions(&bench);
    }
    let each = |board: usize| (after[board] - before[board]) as f64 / virtual_seconds;
    Ok(Speed { seconds: link / virtual_seconds, horus: each(0), dpr: each(1), copy, yardstick: fixed })
}
