//! Measures the speed of the bench.
//!
//! Generic code is compiled with the options of the crate that names its types. The measurement is therefore in this
//! crate: in a caller that is not optimised, it would measure a slower bench than the one that [`super::run`] runs.

use std::time::Instant;

use super::{Bench, Error, Setup};

/// The number of runs. The shortest one counts, because it was disturbed least by other work on the machine.
const RUNS: usize = 3;

/// The number of copies that are made of the running bench. The shortest time counts.
const COPIES: usize = 100;

/// The wall time and the number of instructions of one virtual second, and the wall time of a copy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speed {
    /// The wall time of a virtual second, s.
    pub seconds: f64,
    /// The number of instructions that HORUS's core executes in a virtual second.
    pub horus: f64,
    /// The number of instructions that the DPR's core executes in a virtual second.
    pub dpr: f64,
    /// The wall time of a copy of the whole bench, s.
    pub copy: f64,
}

/// Runs the bench on the fast clock to its end and measures the time after the first `warm_up_ns`.
///
/// # Errors
///
/// The errors are those of [`Bench::new`].
pub fn speed(setup: &Setup, warm_up_ns: u64) -> Result<Speed, Error> {
    let mut warm: Bench = Bench::new(setup)?;
    warm.run_to(warm_up_ns, setup.threads);
    let seconds = |ns: u64| ns as f64 / 1e9;
    let virtual_seconds = seconds(setup.duration_ns.saturating_sub(warm_up_ns));
    let copy = (0..COPIES).map(|_| {
        let began = Instant::now();
        let copy = warm.clone();
        let took = began.elapsed();
        drop(copy);
        took.as_secs_f64()
    });
    let copy = copy.fold(f64::INFINITY, f64::min);
    let instructions = |bench: &Bench| [bench.horus().instructions(), bench.dpr().instructions()];
    let before = instructions(&warm);
    let (mut least, mut after) = (f64::INFINITY, before);
    for _ in 0..RUNS {
        let mut bench = warm.clone();
        let began = Instant::now();
        bench.run_to(setup.duration_ns, setup.threads);
        least = least.min(began.elapsed().as_secs_f64());
        after = instructions(&bench);
    }
    let each = |board: usize| (after[board] - before[board]) as f64 / virtual_seconds;
    Ok(Speed { seconds: least / virtual_seconds, horus: each(0), dpr: each(1), copy })
}
