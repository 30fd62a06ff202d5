//! Campaigns of upsets. Each upset is tried on its own copy of a bench, and its effect is put into a class.
//!
//! A campaign runs a [`Subject`] and copies it at several instants. At each, one copy is the reference and has no
//! upset, and each trial has a copy with an upset. The trial's class follows from a comparison of what the judge
//! reports and the flight controller reads in the two.
//!
//! | class | what the flight controller read |
//! |---|---|
//! | masked | the same as without the upset |
//! | detected | different data, but no invalid data as valid |
//! | dangerous | invalid data as valid |

use std::fmt;

use bench_judge::{Verdict, Violation};
use rayon::prelude::*;

use super::{Board, Kind, Rng, Targets, Upset, name_of};

/// A bench that upsets are tried on.
pub trait Subject: Clone + Send {
    /// Runs the bench to `at` (virtual ns).
    fn run_to(&mut self, at: u64);

    /// The memory that the firmware of `board` uses at present.
    fn targets(&self, board: Board) -> Targets;

    /// Applies `upset` to `board` now.
    fn upset(&mut self, board: Board, upset: Upset);

    /// Runs this copy for `for_ns` from now, on this thread alone, and returns the outcome.
    fn outcome(self, for_ns: u64) -> RunOutcome;
}

/// The outcome of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunOutcome {
    /// The judge's verdict.
    pub verdict: Verdict,
    /// A digest of all bytes that the flight controller has read, and of the instants at which it read them.
    pub read_digest: u64,
}

/// The settings of a campaign.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// The kinds of upset, which the trials use in turn. Kinds of fault that are not upsets are ignored.
    pub kinds: Vec<Kind>,
    /// The boards, which the trials upset in turn.
    pub boards: Vec<Board>,
    /// The number of trials.
    pub count: usize,
    /// The number of trials at each instant, at least 1. They share one run without an upset as their reference.
    pub per_instant: usize,
    /// The range, virtual ns, from which the instants of the upsets are drawn.
    pub between: (u64, u64),
    /// How long each copy runs after its upset, ns.
    pub for_ns: u64,
    /// The seed of the instants and upsets.
    pub seed: u64,
}

/// The class of an upset's effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Class {
    /// The upset changed nothing that the flight controller read.
    Masked,
    /// The flight controller read other bytes than without the upset, but no invalid data were shown as valid.
    Detected,
    /// Invalid data were shown as valid.
    Dangerous,
}

impl Class {
    /// All classes, from harmless to dangerous.
    pub const ALL: [Self; 3] = [Self::Masked, Self::Detected, Self::Dangerous];

    /// The class's name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Masked => "masked",
            Self::Detected => "detected",
            Self::Dangerous => "dangerous",
        }
    }

    /// Returns the class of a trial. `outcome` is the trial's, and `reference` that of the same bench without an upset.
    #[must_use]
    pub fn of(reference: &RunOutcome, outcome: &RunOutcome) -> Self {
        let of_outcome = &outcome.verdict.violations;
        let before = |violation: Violation| {
            let broken = reference.verdict.violations.iter().find(|broken| broken.violation == violation);
            broken.map_or(0, |broken| broken.count)
        };
        if of_outcome.iter().any(|broken| is_dangerous(broken.violation) && broken.count > before(broken.violation)) {
            return Self::Dangerous;
        }
        let same = of_outcome.len() == reference.verdict.violations.len()
            && of_outcome.iter().all(|broken| broken.count == before(broken.violation))
            && outcome.read_digest == reference.read_digest;
        if same { Self::Masked } else { Self::Detected }
    }
}

/// Whether `violation` means that invalid data were shown as valid to the flight controller or at the base station.
///
/// A wrong content of an object counts too, because the judge does not report whether the object was shown. Wrong flags
/// of Link-Status, a wrong state of HORUS, a wrong timestamp and a wrong uplink count because readers act on them.
#[must_use]
pub const fn is_dangerous(violation: Violation) -> bool {
    matches!(
        violation,
        Violation::ContentWrong
            | Violation::StatusWrong
            | Violation::ReportedWrong
            | Violation::VoteWrong
            | Violation::ExclusionWrong
            | Violation::ShownNeverSent
            | Violation::ShownOutOfSequence
            | Violation::ShownStale
            | Violation::ShownExpired
            | Violation::Regression
            | Violation::Torn
            | Violation::LinkAge
            | Violation::LinkFlags
            | Violation::StateWrong
            | Violation::TimestampWrong
            | Violation::UplinkWrong
            | Violation::PositionOff
            | Violation::ClientWrong
            | Violation::ClientAge
            | Violation::StationAge
            | Violation::BaseInvalid
            | Violation::BaseMixed
    )
}

/// One upset and its outcome.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Trial {
    /// The trial's number in its campaign, from 1. Together with the campaign's seed it identifies the trial.
    pub number: usize,
    /// The campaign's seed.
    pub seed: u64,
    /// The upset's instant, virtual ns.
    pub at: u64,
    /// The board that is upset.
    pub board: Board,
    /// The upset.
    pub upset: Upset,
    /// The class of the upset's effect.
    pub class: Class,
    /// The violations of the trial that did not occur in the reference.
    pub violations: Vec<Violation>,
}

/// A campaign that has been run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Campaign {
    /// The trials of the campaign, in order of their instants.
    pub trials: Vec<Trial>,
}

impl Campaign {
    /// Tries upsets on copies of `subject`, which must be at its beginning.
    #[must_use]
    pub fn run<S: Subject>(mut subject: S, options: &Options) -> Self {
        let kinds: Vec<Kind> = options.kinds.iter().copied().filter(|kind| kind.is_upset()).collect();
        let mut trials = vec![];
        if kinds.is_empty() || options.boards.is_empty() {
            return Self { trials };
        }
        let per_instant = options.per_instant.max(1);
        let instants = options.count.div_ceil(per_instant) as u64;
        let (from, to) = options.between;
        let mut rng = Rng::new(options.seed);
        for instant in 0..instants {
            let part = |nth: u64| from + (u128::from(to - from) * u128::from(nth) / u128::from(instants)) as u64;
            let at = rng.between(part(instant), part(instant + 1).saturating_sub(1).max(part(instant)));
            subject.run_to(at);
            let first = trials.len();
            let drawn = (first..options.count.min(first + per_instant)).filter_map(|nth| {
                let board = options.boards[nth % options.boards.len()];
                let kind = kinds[nth / options.boards.len() % kinds.len()];
                Some((board, Upset::drawn(kind, &mut rng, &subject.targets(board))?))
            });
            let upsets: Vec<(Board, Upset)> = drawn.collect();
            let copies = std::iter::once(None).chain(upsets.iter().copied().map(Some)).map(|upset| {
                let mut copy = subject.clone();
                if let Some((board, upset)) = upset {
                    copy.upset(board, upset);
                }
                copy
            });
            let copies: Vec<S> = copies.collect();
            let mut outcomes: Vec<RunOutcome> =
                copies.into_par_iter().with_max_len(1).map(|copy| copy.outcome(options.for_ns)).collect();
            let reference = outcomes.remove(0);
            let known = |violation| reference.verdict.kinds().any(|of_reference| of_reference == violation);
            for (nth, ((board, upset), outcome)) in (first..).zip(upsets.into_iter().zip(outcomes)) {
                trials.push(Trial {
                    number: nth + 1,
                    seed: options.seed,
                    at,
                    board,
                    upset,
                    class: Class::of(&reference, &outcome),
                    violations: outcome.verdict.kinds().filter(|&violation| !known(violation)).collect(),
                });
            }
        }
        Self { trials }
    }

    /// The number of trials with an upset of `kind` on `board` whose effect is of `class`.
    #[must_use]
    pub fn count(&self, board: Board, kind: Kind, class: Class) -> usize {
        let is_one = |trial: &&Trial| trial.board == board && trial.upset.kind() == kind && trial.class == class;
        self.trials.iter().filter(is_one).count()
    }

    /// The trials that showed invalid data as valid.
    pub fn dangerous(&self) -> impl Iterator<Item = &Trial> + '_ {
        self.trials.iter().filter(|trial| trial.class == Class::Dangerous)
    }
}

impl fmt::Display for Campaign {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<7} {:<10} {:>8} {:>8} {:>9}", "board", "upset", "masked", "detected", "dangerous")?;
        for board in [Board::Horus, Board::Dpr] {
            for kind in Kind::ALL.into_iter().filter(|kind| kind.is_upset()) {
                let [masked, detected, dangerous] = Class::ALL.map(|class| self.count(board, kind, class));
                if masked + detected + dangerous > 0 {
                    let (board, kind) = (name_of(board), kind.word());
                    writeln!(f, "{board:<7} {kind:<10} {masked:>8} {detected:>8} {dangerous:>9}")?;
                }
            }
        }
        self.dangerous().try_for_each(|trial| writeln!(f, "{trial}"))
    }
}

impl fmt::Display for Trial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words: Vec<&str> = self.violations.iter().map(|violation| violation.words()).collect();
        let (at, board) = (self.at as f64 / 1e6, name_of(self.board));
        let Self { number, seed, upset, .. } = self;
        write!(f, "seed {seed}, trial {number}: at {at:.6} ms, {board}, {upset}: {}", words.join("; "))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use bench_judge::Broken;

    use super::*;

    const HORUS_RAM: std::ops::Range<u32> = 0x2000_0000..0x2000_0100;
    const DPR_RAM: std::ops::Range<u32> = 0x2000_8000..0x2000_8100;

    /// A bench for the tests without boards. The address of its upset selects the effect: none, other bytes, or an old
    /// object.
    #[derive(Clone, Debug, Default)]
    struct Bench<'a> {
        now: u64,
        upset: Option<(u64, Board, Upset)>,
        outcomes: Option<&'a AtomicUsize>,
    }

    fn broken(violation: Violation, count: u64) -> Broken {
        Broken { violation, count, first_at: 0, words: String::new() }
    }

    fn outcome(violations: &[(Violation, u64)], read_digest: u64) -> RunOutcome {
        let violations = violations.iter().map(|&(violation, count)| broken(violation, count)).collect();
        RunOutcome { verdict: Verdict { violations, ..Verdict::default() }, read_digest }
    }

    impl Subject for Bench<'_> {
        fn run_to(&mut self, at: u64) {
            assert!(at >= self.now, "a bench does not run backwards");
            self.now = at;
        }

        fn targets(&self, board: Board) -> Targets {
            let ram = if board == Board::Horus { HORUS_RAM } else { DPR_RAM };
            Targets { ram: std::iter::once(ram).collect(), flash: std::iter::once(0..0x80).collect() }
        }

        fn upset(&mut self, board: Board, upset: Upset) {
            self.upset = Some((self.now, board, upset));
        }

        fn outcome(self, for_ns: u64) -> RunOutcome {
            assert_eq!(for_ns, 400);
            if let Some(outcomes) = self.outcomes {
                outcomes.fetch_add(1, Ordering::Relaxed);
            }
            // This bench has a violation even without an upset.
            let always = (Violation::ShownStale, 2);
            match self.upset {
                Some((_, _, Upset::Ram { address, .. })) if address % 4 == 1 => outcome(&[always], 8),
                Some((_, _, Upset::Ram { address, .. })) if address % 4 == 2 => {
                    outcome(&[always, (Violation::Regression, 1)], 8)
                }
                _ => outcome(&[always], 7),
            }
        }
    }

    fn options() -> Options {
        Options {
            kinds: vec![Kind::Ram],
            boards: vec![Board::Horus, Board::Dpr],
            count: 200,
            per_instant: 8,
            between: (1_000, 9_000),
            for_ns: 400,
            seed: 3,
        }
    }

    #[test]
    fn an_upset_is_classed_by_what_it_changed() {
        let reference = outcome(&[(Violation::NoFrame, 1)], 7);
        let class = |violations: &[(Violation, u64)], digest| Class::of(&reference, &outcome(violations, digest));
        assert_eq!(class(&[(Violation::NoFrame, 1)], 7), Class::Masked);
        assert_eq!(class(&[(Violation::NoFrame, 1)], 8), Class::Detected);
        assert_eq!(class(&[(Violation::NoFrame, 2)], 7), Class::Detected);
        assert_eq!(class(&[], 7), Class::Detected);
        assert_eq!(class(&[(Violation::NoFrame, 1), (Violation::HorusRestarted, 1)], 7), Class::Detected);
        for violation in [
            Violation::ShownExpired,
            Violation::LinkFlags,
            Violation::StateWrong,
            Violation::TimestampWrong,
            Violation::UplinkWrong,
        ] {
            assert_eq!(class(&[(Violation::NoFrame, 1), (violation, 1)], 7), Class::Dangerous, "{violation:?}");
        }
    }

    #[test]
    fn an_upset_is_dangerous_only_if_it_adds_violations_to_the_reference() {
        let reference = outcome(&[(Violation::Regression, 2)], 7);
        assert_eq!(Class::of(&reference, &outcome(&[(Violation::Regression, 2)], 7)), Class::Masked);
        assert_eq!(Class::of(&reference, &outcome(&[(Violation::Regression, 3)], 7)), Class::Dangerous);
    }

    #[test]
    fn a_campaign_spreads_its_upsets_evenly_over_boards_and_kinds() {
        let options = Options { kinds: vec![Kind::Ram, Kind::Flash, Kind::Registers], count: 201, ..options() };
        let campaign = Campaign::run(Bench::default(), &options);
        assert_eq!(campaign.trials.len(), 201);
        let of = |board, kind| Class::ALL.map(|class| campaign.count(board, kind, class)).iter().sum::<usize>();
        for kind in [Kind::Ram, Kind::Flash, Kind::Registers] {
            assert!((33..=34).contains(&of(Board::Horus, kind)), "{kind}");
            assert!((33..=34).contains(&of(Board::Dpr, kind)), "{kind}");
        }
    }

    #[test]
    fn every_trial_is_classed_by_its_own_copy() {
        let campaign = Campaign::run(Bench::default(), &options());
        for trial in &campaign.trials {
            let Upset::Ram { address, .. } = trial.upset else { panic!("{trial:?}") };
            let ram = if trial.board == Board::Horus { HORUS_RAM } else { DPR_RAM };
            assert!(ram.contains(&address), "{trial:?}");
            let (class, found) = match address % 4 {
                1 => (Class::Detected, vec![]),
                2 => (Class::Dangerous, vec![Violation::Regression]),
                _ => (Class::Masked, vec![]),
            };
            assert_eq!((trial.class, &trial.violations), (class, &found), "{trial:?}");
        }
        assert!(campaign.dangerous().count() > 20);
    }

    #[test]
    fn instants_are_spread_over_the_run_and_shared_by_so_many_trials() {
        let outcomes = AtomicUsize::new(0);
        let campaign = Campaign::run(Bench { outcomes: Some(&outcomes), ..Bench::default() }, &options());
        let mut instants: Vec<u64> = campaign.trials.iter().map(|trial| trial.at).collect();
        assert!(instants.is_sorted());
        instants.dedup();
        assert_eq!(instants.len(), 25);
        // The instants are drawn from one interval of 320 ns each, and each instant has one reference.
        for (nth, at) in instants.iter().enumerate() {
            let from = 1_000 + 320 * nth as u64;
            assert!((from..from + 320).contains(at), "{at}");
        }
        assert_eq!(outcomes.into_inner(), 225);
    }

    #[test]
    fn the_same_seed_tries_the_same_upsets_and_another_seed_others() {
        let run = |seed| Campaign::run(Bench::default(), &Options { seed, ..options() });
        assert_eq!(run(3), run(3));
        assert_ne!(run(3), run(4));
    }

    #[test]
    fn kinds_that_are_no_upsets_are_left_out() {
        let options = Options { kinds: vec![Kind::Air, Kind::Ram, Kind::Power], ..options() };
        let campaign = Campaign::run(Bench::default(), &options);
        assert_eq!(campaign.trials.len(), 200);
        assert!(campaign.trials.iter().all(|trial| trial.upset.kind() == Kind::Ram));
        let none = Campaign::run(Bench::default(), &Options { kinds: vec![Kind::Air], ..options });
        assert_eq!(none, Campaign::default());
    }

    #[test]
    fn a_campaign_in_words_counts_the_classes_and_lists_what_is_dangerous() {
        let trial = |class, violations| Trial {
            number: 7,
            seed: 3,
            at: 1_500_000,
            board: Board::Dpr,
            upset: Upset::Ram { address: 0x2000_8002, bit: 5 },
            class,
            violations,
        };
        let dangerous = trial(Class::Dangerous, vec![Violation::Regression]);
        let trials = vec![trial(Class::Masked, vec![]), trial(Class::Masked, vec![]), dangerous];
        let words = Campaign { trials }.to_string();
        let lines: Vec<&str> = words.lines().collect();
        assert_eq!(lines[1].split_whitespace().collect::<Vec<_>>(), ["dpr", "ram", "2", "0", "1"]);
        assert_eq!(lines[2], "seed 3, trial 7: at 1.500000 ms, dpr, RAM 0x20008002 bit 5: old data shown after new");
        assert_eq!(lines.len(), 3);
    }
}
