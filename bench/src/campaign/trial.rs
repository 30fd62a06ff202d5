//! One trial: a fault on a copy of the bench, and what became of it.

use bench_judge::{Board, Event, Violation, What};
use cortex_m4::Cost;
use emulator_node::Threads;

use super::class::{self, Class, Reading};
use super::scope::Scope;
use crate::faults::plan::LENGTH;
use crate::faults::{AirFaults, Fault, Faults, Kind, Rng, Upset, name_of};
use crate::sim::{Bench, SharedHorus};

/// The length of a cycle of HORUS, virtual ns.
pub const CYCLE: u64 = 10_000_000;

const MILLISECOND: u64 = 1_000_000;

/// The number of trials whose faults begin at one instant. The bench reaches that instant once, and is copied for each
/// of these trials.
const PER_INSTANT: u64 = 16;

/// The time for which a copy of the bench runs after an upset, ns. A watchdog resets its board within 200 ms, and the
/// board's cycles are accepted 40 ms later.
const AFTER_UPSET: u64 = 400_000_000;

/// The time for which a copy of the bench runs after the end of a fault of the air, of a line, of an oscillator or of
/// the flight controller, ns. The recovery takes three cycles.
const AFTER_LINE: u64 = 100_000_000;

/// The time for which a copy of the bench runs after the end of any other fault, ns. A board and a front end may have
/// to start.
const AFTER_FAULT: u64 = 600_000_000;

/// A copy of the bench that has no position at its planned end runs on for at most this time, ns. A receiver that lost
/// its settings sends positions again within this time.
const EXTENSION: u64 = 1_500_000_000;

/// The step in which a copy runs on, ns.
const STEP: u64 = 10 * CYCLE;

/// The longest time from the beginning of a trial to its end, ns.
pub(super) const LONGEST: u64 = 8_000_000_000;

/// The numbers of the random streams for the instants and for the trials. Smaller numbers belong to faults that are
/// drawn into a run.
const INSTANTS: u64 = 1 << 40;
const TRIALS: u64 = 2 << 40;

/// A trial before it runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The number of the trial in its campaign, from 1.
    pub number: u64,
    /// The kind of fault.
    pub kind: Kind,
    /// The board that is upset; `None` unless the kind is an upset.
    pub board: Option<Board>,
    /// The instant, virtual ns, at which the bench is copied and the first fault begins.
    pub at: u64,
    /// The planned end of the trial, virtual ns, a multiple of a millisecond. The trial is longer if there is no
    /// position then.
    pub end: u64,
    faults: Faults,
    rng: Rng,
}

impl Plan {
    /// The plans of the trials in `scope`. Together these trials have at least `cycles` cycles.
    pub fn all(scope: &Scope, cycles: u64) -> impl Iterator<Item = Self> {
        let mut left = cycles;
        let plans = (1..).map(|number| Self::new(scope, number));
        plans.map_while(move |plan| {
            let goes_on = left > 0;
            left = left.saturating_sub(plan.cycles());
            goes_on.then_some(plan)
        })
    }

    /// The plan of the trial `number`.
    #[must_use]
    pub fn new(scope: &Scope, number: u64) -> Self {
        let nth = number.saturating_sub(1);
        let kinds = scope.kinds.len().max(1) as u64;
        let kind = scope.kinds.get((nth % kinds) as usize).copied().unwrap_or(Kind::Air);
        let board = if (nth / kinds).is_multiple_of(2) { Board::Horus } else { Board::Dpr };
        let latest = super::EARLIEST + scope.seconds * 1_000_000_000;
        let at = Rng::stream(scope.seed, INSTANTS + nth / PER_INSTANT).between(super::EARLIEST, latest);
        let mut rng = Rng::stream(scope.seed, TRIALS + number);
        let faults = match kind {
            _ if kind.is_upset() => Faults::none(),
            Kind::Bits => {
                let until = at + rng.between(LENGTH.0, LENGTH.1);
                let air = AirFaults { bit_error: scope.bit_error, ..AirFaults::default() };
                Faults::none().with(at, until, Fault::Air(air))
            }
            kind => Faults::one(kind, scope.gps, &mut rng, at),
        };
        let over = faults.episodes().iter().map(|episode| episode.until).max().unwrap_or(at);
        let after = match kind {
            _ if kind.is_upset() => AFTER_UPSET,
            Kind::Bits | Kind::Spi | Kind::Drift | Kind::FlightController => AFTER_LINE,
            _ => AFTER_FAULT,
        };
        let end = (over + after).next_multiple_of(MILLISECOND);
        Self { number, kind, board: kind.is_upset().then_some(board), at, end, faults, rng }
    }

    /// The number of cycles of HORUS up to the planned end.
    #[must_use]
    pub fn cycles(&self) -> u64 {
        (self.end - self.at).div_ceil(CYCLE)
    }

    /// The name of the trial's row in a table: the kind of fault and, for an upset, the board.
    #[must_use]
    pub fn row(&self) -> String {
        match self.board {
            Some(board) => format!("{} {}", self.kind, name_of(board)),
            None => self.kind.to_string(),
        }
    }

    /// Begins the fault in `bench`, a copy of the bench at the instant [`Plan::at`].
    pub(super) fn begin<C: Cost>(mut self, mut bench: Bench<C>) -> Begun<C> {
        let mut words: Vec<String> = self.faults.episodes().iter().map(|it| it.fault.name()).collect();
        if let Some(board) = self.board {
            let upset = match board {
                Board::Horus => Upset::drawn_on(self.kind, &mut self.rng, bench.horus()),
                Board::Dpr => Upset::drawn_on(self.kind, &mut self.rng, bench.dpr()),
            };
            if let Some(upset) = upset {
                words.push(upset.to_string());
                let now = bench.now();
                self.faults = Faults::none().with(now, now, Fault::Upset(board, upset));
            }
        }
        bench.add_faults(&self.faults);
        bench.keep_log();
        Begun { plan: self, words: words.join(", "), bench }
    }
}

/// A trial that has begun and not run yet.
pub(super) struct Begun<C: Cost> {
    plan: Plan,
    words: String,
    bench: Bench<C>,
}

impl<C: Cost> Begun<C> {
    /// Whether the fault disturbs HORUS or what is beside it. In all other trials of one instant HORUS does the same.
    pub(super) fn disturbs_horus(&self) -> bool {
        self.plan.faults.timeline(true).next_at() != u64::MAX
    }

    /// Lets `horus` run in place of this trial's own HORUS.
    pub(super) fn run_behind(&mut self, horus: &SharedHorus<C>) {
        self.bench.run_behind(horus);
    }

    /// Runs the trial to its end. `reference` has the readings of the run without a fault.
    pub(super) fn run(self, reference: &[Reading]) -> Trial {
        let Self { plan, words, mut bench } = self;
        let mut end = plan.end;
        let mut seen = Seen::default();
        loop {
            bench.run_to(end, Threads::One);
            seen.take(&bench.take_log());
            if class::flies(&seen.readings) || end >= plan.end + EXTENSION {
                break;
            }
            end += STEP;
        }
        let finished = bench.finish(end);
        seen.take(&finished.log.events);
        let is_within = |reading: &&Reading| (plan.at..=end).contains(&reading.at);
        let reference: Vec<Reading> = reference.iter().filter(is_within).copied().collect();
        seen.readings.retain(|reading| (plan.at..=end).contains(&reading.at));
        let violations: Vec<Violation> = finished.verdict.kinds().collect();
        let class_of = if plan.board.is_some() { Class::of_upset } else { Class::of };
        Trial {
            number: plan.number,
            row: plan.row(),
            is_upset: plan.board.is_some(),
            at: plan.at,
            fault: words,
            cycles: (end - plan.at).div_ceil(CYCLE),
            readings: seen.readings.len() as u64,
            injected: seen.injected,
            class: class_of(&reference, &seen.readings, &violations),
            violations: finished.verdict.violations.iter().map(ToString::to_string).collect(),
        }
    }
}

#[derive(Default)]
struct Seen {
    readings: Vec<Reading>,
    injected: bool,
}

impl Seen {
    fn take(&mut self, events: &[Event]) {
        self.readings.extend(Reading::of(events));
        self.injected |= events.iter().any(|event| matches!(event.what, What::Injected { .. }));
    }
}

/// A trial that has been run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Trial {
    /// The number of the trial in its campaign, from 1.
    pub number: u64,
    /// The name of the trial's row, see [`Plan::row`].
    pub row: String,
    /// Whether the fault is an upset. The judge excuses few consequences of an upset.
    pub is_upset: bool,
    /// The instant at which the fault began, virtual ns.
    pub at: u64,
    /// The fault in words.
    pub fault: String,
    /// The number of cycles that the trial ran.
    pub cycles: u64,
    /// The number of transactions that the flight controller read.
    pub readings: u64,
    /// Whether the event log has the injection of the fault.
    pub injected: bool,
    /// The class of the fault's effect.
    pub class: Class,
    /// The violations of the judge's rules, in words.
    pub violations: Vec<String>,
}

impl std::fmt::Display for Trial {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { number, row, fault, class, .. } = self;
        write!(f, "trial {number}, {row}, at {:.6} ms: {fault}: {}", self.at as f64 / 1e6, class.name())?;
        if self.violations.is_empty() { Ok(()) } else { write!(f, ": {}", self.violations.join("; ")) }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use emulator_node::Clock;

    use super::*;

    fn scope(kinds: &[Kind]) -> Scope {
        Scope { kinds: kinds.to_vec(), seed: 5, gps: 3, clock: Clock::Fast, bit_error: 0.25, seconds: 20 }
    }

    #[test]
    fn a_longer_campaign_begins_with_the_trials_of_a_shorter_one() {
        let scope = scope(&Kind::ALL);
        let of = |cycles| Plan::all(&scope, cycles).collect::<Vec<_>>();
        let (short, long) = (of(3_000), of(30_000));
        assert!(long.len() > 5 * short.len());
        assert_eq!(short, long[..short.len()]);
        assert_eq!(short, (1..=short.len() as u64).map(|number| Plan::new(&scope, number)).collect::<Vec<_>>());
        let cycles = |plans: &[Plan]| plans.iter().map(Plan::cycles).sum::<u64>();
        assert!(cycles(&short) >= 3_000 && cycles(&short[..short.len() - 1]) < 3_000);
    }

    #[test]
    fn kinds_take_turns_and_every_upset_hits_either_board() {
        let kinds = [Kind::Air, Kind::Ram, Kind::Peripherals];
        let rows: Vec<String> = (1..=6).map(|number| Plan::new(&scope(&kinds), number).row()).collect();
        assert_eq!(rows, ["air", "ram horus", "peripherals horus", "air", "ram dpr", "peripherals dpr"]);
    }

    #[test]
    fn faults_begin_at_the_copy_and_end_before_the_trial_does() {
        let kinds: Vec<Kind> = Kind::ALL.into_iter().filter(|kind| !kind.needs_hold()).collect();
        for plan in Plan::all(&scope(&kinds), 30_000) {
            assert!((super::super::EARLIEST..=20_500_000_000).contains(&plan.at), "{plan:?}");
            assert!(plan.end - plan.at + EXTENSION <= LONGEST, "{plan:?}");
            assert_eq!(plan.faults.episodes().is_empty(), plan.kind.is_upset(), "{plan:?}");
            assert!(plan.faults.episodes().first().is_none_or(|first| first.at == plan.at), "{plan:?}");
            assert!(plan.faults.episodes().iter().all(|it| it.until + AFTER_LINE <= plan.end), "{plan:?}");
        }
    }

    #[test]
    fn bit_errors_have_the_given_rate() {
        let plan = Plan::new(&scope(&[Kind::Bits]), 1);
        let [episode] = plan.faults.episodes() else { panic!("{plan:?}") };
        assert_eq!(episode.fault, Fault::Air(AirFaults { bit_error: 0.25, ..AirFaults::default() }));
    }

    #[test]
    fn another_seed_draws_other_trials_and_neighbours_share_an_instant() {
        let instants = |seed| {
            let scope = Scope { seed, ..scope(&[Kind::Ram]) };
            (1..=2 * PER_INSTANT).map(|number| Plan::new(&scope, number).at).collect::<BTreeSet<_>>()
        };
        assert_eq!(instants(5).len(), 2);
        assert!(instants(5).is_disjoint(&instants(6)));
    }
}
