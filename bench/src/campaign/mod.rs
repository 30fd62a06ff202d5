//! Campaigns: many short runs with one fault each, on copies of a bench that runs already.
//!
//! A campaign runs the link once without a fault and notes what the flight controller read ([`Reading`]). Then it runs
//! the link again, and copies the bench at instants that the seed determines. Each copy gets one fault and runs on
//! alone, and the effect of the fault has one of these classes ([`Class`]):
//!
//! | class | what the flight controller read |
//! |---|---|
//! | masked | the same, at the same instants, as without the fault |
//! | recovered | something else, nothing invalid as valid; at the end it has new positions again |
//! | stopped | the same, but at the end it has no position, and knows that |
//! | dangerous | invalid data as valid, or a position that stays the same without anything that says so |
//!
//! The seed, the trial's number and the [`Scope`] alone determine a trial. Each trial can therefore be repeated alone,
//! and parts of a campaign from several machines can be joined ([`Tally::merge`]).
//!
//! A fault that was never injected would look masked. A trial without an injected fault in its log is therefore void. A
//! campaign fails if a kind of fault was never injected, or if nothing was read ([`Tally::flaws`]).

mod bound;
mod class;
mod scope;
mod tally;
mod trial;

use cortex_m4::{Cost, Fast, Optimistic, Pessimistic};
use emulator_node::{Clock, Threads};
use rayon::prelude::*;

use crate::faults::Faults;
use crate::sim::coverage::Records;
use crate::sim::{self, Bench, Setup};
use trial::Begun;

pub use bound::clopper_pearson;
pub use class::{Class, Reading};
pub use scope::Scope;
pub use tally::{Counts, MergeError, Shard, Tally};

pub use trial::{CYCLE, Plan, Trial};

/// The earliest instant of a fault, virtual ns: both boards have started, and the position is valid.
const EARLIEST: u64 = 500_000_000;

/// The settings of a campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// What determines each trial.
    pub scope: Scope,
    /// The least number of cycles of HORUS in all trials together. A trial's number of cycles depends on its fault.
    pub cycles: u64,
    /// The number of threads, at least 1.
    pub jobs: usize,
    /// The part of the campaign that is run.
    pub shard: Shard,
}

/// The reason why a campaign could not be run.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The bench cannot begin.
    #[error(transparent)]
    Bench(#[from] sim::Error),
    /// The threads cannot be started.
    #[error("the threads of the campaign cannot be started")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// The run without a fault already violates a rule of the judge, so it is no reference for the trials.
    #[error("the run without a fault already has violations: {0}")]
    Reference(String),
    /// The run without a fault read nothing.
    #[error("the flight controller read no position in the run without a fault")]
    NothingRead,
}

/// Runs the campaign on a link of `setup`, but without the faults, the length and the output files of `setup`. Calls
/// `done` with the cycles of each finished trial. Notes in `records` what the boards execute.
///
/// # Errors
///
/// The bench cannot begin, or the run without a fault has violations or reads nothing.
pub fn run(
    setup: &Setup,
    options: &Options,
    records: Option<&Records>,
    done: &(dyn Fn(u64) + Sync),
) -> Result<Tally, Error> {
    let plans = Plan::all(&options.scope, options.cycles).filter(|plan| options.shard.has(plan.number));
    let trials = trials(setup, options, records, plans.collect(), done)?;
    Ok(Tally::of(&options.scope, options.cycles, options.shard, &trials))
}

/// Runs the trial `number` of the campaign alone.
///
/// # Errors
///
/// The errors are those of [`run`].
pub fn repeat(setup: &Setup, options: &Options, number: u64) -> Result<Trial, Error> {
    let plan = Plan::new(&options.scope, number);
    Ok(trials(setup, options, None, vec![plan], &|_| ())?.remove(0))
}

fn trials(
    setup: &Setup,
    options: &Options,
    records: Option<&Records>,
    plans: Vec<Plan>,
    done: &(dyn Fn(u64) + Sync),
) -> Result<Vec<Trial>, Error> {
    match setup.clock {
        Clock::Fast => trials_on::<Fast>(setup, options, records, plans, done),
        Clock::Optimistic => trials_on::<Optimistic>(setup, options, records, plans, done),
        Clock::Pessimistic => trials_on::<Pessimistic>(setup, options, records, plans, done),
    }
}

fn trials_on<C: Cost>(
    setup: &Setup,
    options: &Options,
    records: Option<&Records>,
    mut plans: Vec<Plan>,
    done: &(dyn Fn(u64) + Sync),
) -> Result<Vec<Trial>, Error> {
    plans.sort_by_key(|plan| (plan.at, plan.number));
    let last = plans.iter().map(|plan| plan.end).max().unwrap_or(0);
    let setup = Setup {
        faults: Faults::none(),
        duration_ns: EARLIEST + options.scope.seconds * 1_000_000_000 + trial::LONGEST,
        sweep: None,
        trace: None,
        log: None,
        plot: None,
        ..setup.clone()
    };
    let threads = if options.jobs > 1 { Threads::Two } else { Threads::One };
    let reference = reference::<C>(&setup, last, threads)?;
    let mut base = Bench::<C>::new(&setup)?;
    if let Some(records) = records {
        base.set_records(records);
    }
    // The iterator creates the copies in the order of their instants and on one thread, because a bench cannot go back
    // in time. All copies of one instant in which nothing happens to HORUS share one HORUS. A trial that is repeated
    // alone has its own, so a difference would show.
    let alone = plans.len() == 1;
    let mut shared = (0, base.share_horus());
    let begun = plans.into_iter().map(|plan| {
        base.run_to(plan.at, Threads::One);
        let at = plan.at;
        let mut begun = plan.begin(base.clone());
        if !alone && !begun.disturbs_horus() {
            if shared.0 != at {
                shared = (at, base.share_horus());
            }
            begun.run_behind(&shared.1);
        }
        begun
    });
    let run = |begun: Begun<C>| {
        let trial = begun.run(&reference);
        done(trial.cycles);
        trial
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.jobs.max(1)).build()?;
    let mut trials: Vec<Trial> = pool.install(|| begun.par_bridge().map(run).collect());
    trials.sort_by_key(|trial| trial.number);
    Ok(trials)
}

/// Returns what the flight controller reads without a fault up to `last` (ns).
fn reference<C: Cost>(setup: &Setup, last: u64, threads: Threads) -> Result<Vec<Reading>, Error> {
    let mut bench = Bench::<C>::new(setup)?;
    bench.keep_log();
    bench.run_to(last, threads);
    let finished = bench.finish(last);
    if !finished.verdict.violations.is_empty() {
        let words: Vec<String> = finished.verdict.violations.iter().map(ToString::to_string).collect();
        return Err(Error::Reference(words.join("; ")));
    }
    let readings: Vec<Reading> = Reading::of(&finished.log.events).collect();
    if last > 0 && !readings.iter().any(|reading| reading.position.is_some()) {
        return Err(Error::NothingRead);
    }
    Ok(readings)
}
