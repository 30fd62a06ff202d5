//! Judges restarts, findings, misuse, load, the firmwares' fault counters and the bench's lateness.
//!
//! # When a fault counter is a violation
//!
//! A fault counter that is not zero is a violation only if nothing in the log explains the faults:
//!
//! | explained by | because |
//! |---|---|
//! | an injected fault, as far as [`complaints`] says | the bench caused it |
//! | a start of HORUS, for the DPR's counters | a frame was cut off |
//! | the field going off while HORUS runs | HORUS brings its front end up again, and the DPR loses frames |
//! | a frame that reached the DPR's antenna changed or not at all, for the DPR's counters | no board is at fault |
//!
//! A board's counters start from zero at its start. An explanation from before the start does not count any more.
//!
//! | board | counter | counts |
//! |---|---|---|
//! | HORUS | `frames_skipped` | slots that passed without a frame to fire |
//! | HORUS | `rf_faults` | faults of the front end |
//! | HORUS | `cycle_overruns` | ticks at which the task of the cycle before had not ended |
//! | HORUS | a line's `overruns` | bytes of a receiver that were lost |
//! | DPR | `scrub_faults` | stuck bits found by scrubs |
//! | DPR | `rf_faults` | faults of the front end, frames that began but were not delivered |
//! | DPR | `overruns` | frames lost because commit and scrub were late by a cycle |
//! | DPR | `images_expired` | images that none replaced in time |
//!
//! The name of a counter of a receiver's line may begin with the line and a full stop, as in `lines.0.overruns`.
//!
//! # A board that hangs
//!
//! If the bench stops a board's core, the board's watchdog must restart the board within the watchdog's longest time.
//! This is not required if the board restarts for another reason or loses its supply first. The watchdog's restart is
//! no violation. Until it comes, misuse of the board's front end is not reported.
//!
//! A board with a dead task ([`Disturbance::DeadTask`]) is judged like a board that hangs, with two differences. Its
//! watchdog may be fed once more, because the dead task may have checked in just before. Misuse of its front end is
//! reported, because the other tasks still run.

use std::collections::BTreeMap;

use super::Rule;
use crate::disturbance::{complaints, front_end_use};
use crate::{Board, Cause, Context, Disturbance, Event, Figures, Findings, Header, Violation, What, bounds};

#[derive(Clone, Copy)]
struct Of {
    horus: Violation,
    dpr: Violation,
}

impl Of {
    const RESTARTED: Self = Self { horus: Violation::HorusRestarted, dpr: Violation::DprRestarted };
    const STAYS_HUNG: Self = Self { horus: Violation::HorusStaysHung, dpr: Violation::DprStaysHung };
    const FINDING: Self = Self { horus: Violation::HorusFinding, dpr: Violation::DprFinding };
    const OVERLOADED: Self = Self { horus: Violation::HorusOverloaded, dpr: Violation::DprOverloaded };
    const COMPLAINS: Self = Self { horus: Violation::HorusComplains, dpr: Violation::DprComplains };

    fn board(self, board: Board) -> Violation {
        match board {
            Board::Horus => self.horus,
            Board::Dpr => self.dpr,
        }
    }
}

#[derive(Clone, Debug)]
struct Complaint {
    board: Board,
    at: u64,
    name: String,
    value: u32,
}

/// The rule that judges restarts, findings, misuse, load and counters of both boards; see the [module](self).
#[derive(Clone, Debug)]
pub struct Boards {
    /// The share of the DPR's processor time, in ten thousandths, that the hold's port may take.
    hold_load: u32,
    injected: BTreeMap<String, u64>,
    /// For HORUS and for the DPR, whether the log explains the faults counted since the last start.
    explained: [bool; 2],
    /// The boards that have met a core fault and have not restarted yet, each with the instant (ns) and the fault in
    /// words.
    faulted: Vec<(Board, u64, String)>,
    /// The board and the instant, ns, of the last restart that was not asked for.
    restarted: Option<(Board, u64)>,
    /// The instant, ns, by which each hung board must have restarted; `None` after a late restart was reported.
    restart_due: [Option<u64>; 2],
    /// For each board, two values: how long its core has been stopped in all, ns, and the instant, ns, since which it
    /// is stopped at present.
    stopped: [(u64, Option<u64>); 2],
    field: bool,
    /// The last whole frame that HORUS sent, until the frame reaches the antenna.
    on_the_way: Option<Vec<u8>>,
    complaints: Vec<Complaint>,
}

impl Rule for Boards {
    fn new(header: &Header) -> Self {
        Self {
            hold_load: if header.hold { bounds::HOLD_LOAD_PER_10_000 } else { 0 },
            injected: BTreeMap::new(),
            explained: [false; 2],
            faulted: vec![],
            restarted: None,
            restart_due: [None; 2],
            stopped: [(0, None); 2],
            field: false,
            on_the_way: None,
            complaints: vec![],
        }
    }

    fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
        let at = event.at;
        self.pass(at, findings);
        match &event.what {
            What::Hung { board } if context.running(*board).hung == Some(at) => {
                let longest = watchdog_longest(*board, at - context.running(*board).since);
                self.restart_by(*board, at + longest);
                self.stopped[*board as usize].1 = Some(at);
            }
            What::Power { board, .. } => {
                self.restart_due[*board as usize] = None;
                self.starts(*board, at);
            }
            What::Reset { board, cause, asked } => {
                self.restart_due[*board as usize] = None;
                self.starts(*board, at);
                let ends_hang = context.running(*board).ended_hang && *cause == Cause::Watchdog;
                if !asked && !ends_hang {
                    self.restarted = Some((*board, at));
                    // A restart that follows from a core fault is reported, so the core fault itself is not.
                    let ended_so = |(of, fault_at, _): &(Board, u64, String)| {
                        of == board && at <= fault_at + bounds::WATCHDOG_LONGEST
                    };
                    self.faulted.retain(|fault| !ended_so(fault));
                    findings.add(Of::RESTARTED.board(*board), at, || format!("{cause:?}"));
                }
            }
            What::Injected { kind, disturbs, .. } => {
                match self.injected.get_mut(kind) {
                    Some(count) => *count += 1,
                    None => _ = self.injected.insert(kind.clone(), 1),
                }
                if let Disturbance::DeadTask { board, .. } = *disturbs
                    && context.running(board).dead == Some(at)
                {
                    let longest = watchdog_longest(board, at - context.running(board).since);
                    self.restart_by(board, at + longest + bounds::CHECKED_IN[board as usize]);
                }
            }
            What::Field { on } => {
                if std::mem::replace(&mut self.field, *on) && !on {
                    self.explained = [true; 2];
                }
            }
            What::Sent { bytes, whole, .. } => {
                // The frame that HORUS sent before never reached the antenna, so the air lost it.
                self.explained[Board::Dpr as usize] |= self.on_the_way.is_some();
                self.on_the_way = whole.then(|| bytes.to_vec());
            }
            What::Heard { bytes, whole, .. } => {
                let as_sent = self.on_the_way.take().is_some_and(|sent| sent == bytes.0);
                self.explained[Board::Dpr as usize] |= !whole || !as_sent;
            }
            // A lock-up's restart is logged before the finding of the lock-up, so the core has restarted already.
            What::Finding { board, fault: true, text } => {
                if self.restarted != Some((*board, at)) {
                    self.faulted.push((*board, at, text.clone()));
                }
            }
            What::Finding { board, text, .. } => findings.add(Of::FINDING.board(*board), at, || text.clone()),
            // A firmware that cannot read from its front end cannot know the front end's state.
            What::Misuse { board, .. } if context.disturbances().excuse(front_end_use(*board), at) => {}
            What::Misuse { board, .. } if context.running(*board).hung.is_some() => {}
            What::Misuse { board, text } => {
                findings.add(Violation::FrontEndMisuse, at, || format!("{board:?}: {text}"));
            }
            What::Load { board, per_10_000 } => {
                self.goes_on(*board, at);
                let no_load = self.stopped[*board as usize].0 + context.running(*board).starts * start_work(*board);
                let port = if *board == Board::Dpr { self.hold_load } else { 0 };
                let bound = u64::from(bounds::LOAD_PER_10_000 + port) + 10_000 * no_load / at.max(1);
                if u64::from(*per_10_000) > bound && at >= bounds::LOAD_FROM {
                    findings.add(Of::OVERLOADED.board(*board), at, || {
                        format!("{per_10_000} of 10000, the bound is {bound}")
                    });
                }
            }
            What::Counter { board, name, value: None } => {
                findings.add(Violation::NoTelemetry, at, || format!("{board:?} has no counter {name}"));
            }
            What::Counter { board, name, value: Some(value) } => {
                if *value > 0 && counts_faults(*board, name) {
                    self.complaints.push(Complaint { board: *board, at, name: name.clone(), value: *value });
                }
            }
            What::Late { board, text } => {
                findings.add(Violation::Late, at, || format!("{board:?}: {text}"));
            }
            _ => {}
        }
    }

    fn finish(&mut self, context: &Context, findings: &mut Findings, figures: &mut Figures) {
        figures.faults.injected = std::mem::take(&mut self.injected);
        for (board, at, text) in self.faulted.drain(..) {
            findings.add(Of::FINDING.board(board), at, || text);
        }
        for Complaint { board, at, name, value } in self.complaints.drain(..) {
            if self.explained[board as usize] || context.disturbances().excuse(complaints(board), at) {
                continue;
            }
            findings.add(Of::COMPLAINS.board(board), at, || format!("{name} = {value}"));
        }
    }
}

impl Boards {
    /// Requires that the watchdog has restarted a hung board by the instant `due`, ns.
    fn restart_by(&mut self, board: Board, due: u64) {
        let restart_due = &mut self.restart_due[board as usize];
        *restart_due = Some(restart_due.map_or(due, |before| before.min(due)));
    }

    /// Records that a board starts or loses its supply; its counters then start from zero.
    fn starts(&mut self, board: Board, at: u64) {
        self.goes_on(board, at);
        self.explained[board as usize] = false;
        self.explained[Board::Dpr as usize] |= board == Board::Horus;
    }

    fn goes_on(&mut self, board: Board, at: u64) {
        let (stopped, since) = &mut self.stopped[board as usize];
        *stopped += since.take().map_or(0, |since| at.saturating_sub(since));
    }

    /// Reports each board that hangs although its watchdog should have restarted it.
    fn pass(&mut self, now: u64, findings: &mut Findings) {
        for board in [Board::Horus, Board::Dpr] {
            if let Some(due) = self.restart_due[board as usize].take_if(|due| now > *due) {
                findings.add(Of::STAYS_HUNG.board(board), due, || "its watchdog should have bitten by now".to_owned());
            }
        }
    }
}

/// Returns the longest time, ns, until the watchdog restarts a board that hangs. The hang began `after_start` ns after
/// the board's start.
const fn watchdog_longest(board: Board, after_start: u64) -> u64 {
    match board {
        Board::Horus if after_start < bounds::WATCHDOG_FED => bounds::FIRST_WATCHDOG_LONGEST,
        Board::Horus => bounds::WATCHDOG_LONGEST,
        Board::Dpr => bounds::DPR_WATCHDOG_LONGEST,
    }
}

const fn start_work(board: Board) -> u64 {
    match board {
        Board::Horus => bounds::HORUS_START_WORK,
        Board::Dpr => bounds::DPR_START_WORK,
    }
}

fn counts_faults(board: Board, name: &str) -> bool {
    let name = name.rsplit('.').next().unwrap_or(name);
    match board {
        Board::Horus => matches!(name, "frames_skipped" | "rf_faults" | "cycle_overruns" | "overruns"),
        Board::Dpr => matches!(name, "scrub_faults" | "rf_faults" | "overruns" | "images_expired"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Events, HORUS_FRONT_END, IMAGE_BIT, MS, found, header, injected};

    const BOARDS: [Board; 2] = [Board::Horus, Board::Dpr];

    /// Returns a run in which a fault counter above zero has no explanation.
    fn run() -> Events {
        let mut events = Events::flawless(3, 10);
        let heard: Vec<_> = events
            .events
            .iter()
            .filter_map(|event| match &event.what {
                What::Sent { started, bytes, whole, .. } => {
                    Some((event.at, What::Heard { started: *started, bytes: bytes.clone(), whole: *whole }))
                }
                _ => None,
            })
            .collect();
        for (at, what) in heard {
            events.add(at, what);
        }
        events
    }

    fn broken(events: &Events) -> Vec<(Violation, u64, u64)> {
        found(Boards::new(&header(3)), &events.log()).0
    }

    fn counter(board: Board, name: &str, value: Option<u32>) -> What {
        What::Counter { board, name: name.to_owned(), value }
    }

    #[test]
    fn a_flawless_run_has_no_violation() {
        let mut events = run();
        for board in BOARDS {
            events.add(60 * MS, What::Load { board, per_10_000: bounds::LOAD_PER_10_000 });
            events.add(60 * MS, counter(board, "frames_sent", Some(7)));
            events.add(60 * MS, counter(board, "rf_faults", Some(0)));
        }
        let (broken, figures) = found(Boards::new(&header(3)), &events.log());
        assert_eq!(broken, []);
        assert_eq!(figures.faults.injected, BTreeMap::new());
    }

    #[test]
    fn each_violation_is_reported_for_the_board_that_caused_it() {
        let text = || "in words".to_owned();
        let all = |board| {
            [
                What::Reset { board, cause: Cause::Software, asked: false },
                What::Finding { board, fault: false, text: text() },
                What::Misuse { board, text: text() },
                What::Load { board, per_10_000: 2 * bounds::LOAD_PER_10_000 + 1 },
            ]
        };
        let horus =
            [Violation::HorusRestarted, Violation::HorusFinding, Violation::FrontEndMisuse, Violation::HorusOverloaded];
        let dpr = [Violation::DprRestarted, Violation::DprFinding, Violation::FrontEndMisuse, Violation::DprOverloaded];
        for (board, violations) in [(Board::Horus, horus), (Board::Dpr, dpr)] {
            for (what, violation) in all(board).into_iter().zip(violations) {
                let mut events = run();
                events.add(400 * MS, what.clone()).add(410 * MS, what);
                assert_eq!(broken(&events), [(violation, 2, 400 * MS)]);
            }
        }
    }

    #[test]
    fn the_load_leaves_out_starts_and_the_time_of_a_stop() {
        let overloaded = |board, per_10_000, disturb: &dyn Fn(&mut Events)| {
            let mut events = run();
            disturb(&mut events);
            events.add(1_000 * MS, What::Load { board, per_10_000 });
            let of_load = [Violation::HorusOverloaded, Violation::DprOverloaded][board as usize];
            broken(&events).iter().any(|(violation, ..)| *violation == of_load)
        };
        let stopped = |events: &mut Events| {
            events.add(400 * MS, What::Hung { board: Board::Dpr }).reset(500 * MS, Board::Dpr, true);
        };
        let restarted = |events: &mut Events| _ = events.reset(500 * MS, Board::Dpr, true);
        let none = |_: &mut Events| {};
        for (board, beyond, disturb) in [
            (Board::Horus, 400, &none as &dyn Fn(&mut Events)),
            (Board::Horus, 400, &restarted),
            (Board::Dpr, 200, &none),
            (Board::Dpr, 400, &restarted),
            (Board::Dpr, 1_400, &stopped),
        ] {
            let bound = bounds::LOAD_PER_10_000 + beyond;
            assert!(!overloaded(board, bound, disturb), "{board:?} {bound}");
            assert!(overloaded(board, bound + 1, disturb), "{board:?} {bound}");
        }
    }

    #[test]
    fn a_timely_restart_is_reported_in_place_of_a_core_fault() {
        let fault = || What::Finding { board: Board::Dpr, fault: true, text: "20 ms  HardFault: bus error".into() };
        let restart = |board| What::Reset { board, cause: Cause::Watchdog, asked: false };
        let told = |board, after: u64| {
            let mut events = run();
            events.add(30 * MS, fault()).add(30 * MS + after, restart(board));
            broken(&events).into_iter().map(|(violation, ..)| violation).collect::<Vec<_>>()
        };
        assert_eq!(told(Board::Dpr, bounds::WATCHDOG_LONGEST), [Violation::DprRestarted]);
        assert_eq!(told(Board::Dpr, bounds::WATCHDOG_LONGEST + 1), [Violation::DprRestarted, Violation::DprFinding]);
        assert_eq!(told(Board::Horus, 1), [Violation::HorusRestarted, Violation::DprFinding]);
        assert_eq!(told(Board::Dpr, 0), [Violation::DprRestarted]);
        let mut events = run();
        events.add(30 * MS, fault());
        assert_eq!(broken(&events), [(Violation::DprFinding, 1, 30 * MS)]);
    }

    #[test]
    fn a_restart_that_the_bench_asked_for_is_none() {
        let mut events = run();
        for board in BOARDS {
            events.reset(50 * MS, board, true);
        }
        assert_eq!(broken(&events), []);
    }

    const LONGEST: [u64; 2] = [bounds::WATCHDOG_LONGEST, bounds::DPR_WATCHDOG_LONGEST];
    const STAYS: [Violation; 2] = [Violation::HorusStaysHung, Violation::DprStaysHung];
    const RESTARTED: [Violation; 2] = [Violation::HorusRestarted, Violation::DprRestarted];

    /// Returns the violations of a run of 600 ms in which a board hangs at 50 ms, and `what` happens `after` the hang
    /// began.
    fn hung(board: Board, after: u64, what: What) -> Vec<(Violation, u64, u64)> {
        let mut events = run();
        events.add(50 * MS, What::Hung { board }).add(50 * MS + after, what).end(600 * MS);
        broken(&events)
    }

    fn reset(board: Board, cause: Cause) -> What {
        What::Reset { board, cause, asked: false }
    }

    #[test]
    fn the_watchdog_must_reset_a_board_that_hangs_in_time() {
        for (nth, board) in BOARDS.into_iter().enumerate() {
            let longest = LONGEST[nth];
            let bites = || reset(board, Cause::Watchdog);
            let stays = (STAYS[nth], 1, 50 * MS + longest);
            assert_eq!(hung(board, 20 * MS, bites()), []);
            assert_eq!(hung(board, longest, bites()), []);
            assert_eq!(hung(board, longest + 1, bites()), [stays], "told once, and it hung until then");
            assert_eq!(hung(board, 600 * MS, bites()), [stays], "it never comes");
            let mut events = run();
            events.add(70 * MS, bites()).end(600 * MS);
            assert_eq!(broken(&events), [(RESTARTED[nth], 1, 70 * MS)]);
            let other = BOARDS[1 - nth];
            let of_other = (RESTARTED[1 - nth], 1, 70 * MS);
            let mut told = hung(board, 20 * MS, reset(other, Cause::Watchdog));
            told.sort_by_key(|(violation, ..)| *violation == stays.0);
            assert_eq!(told, [of_other, stays]);
        }
    }

    #[test]
    fn a_hang_excuses_one_restart_and_only_by_the_watchdog() {
        for (nth, board) in BOARDS.into_iter().enumerate() {
            for cause in [Cause::Lockup, Cause::Software] {
                assert_eq!(hung(board, 20 * MS, reset(board, cause)), [(RESTARTED[nth], 1, 70 * MS)], "{cause:?}");
            }
            let mut events = run();
            let bites = reset(board, Cause::Watchdog);
            events.add(50 * MS, What::Hung { board }).add(60 * MS, bites.clone()).add(60 * MS + 1, bites);
            assert_eq!(broken(events.end(600 * MS)), [(RESTARTED[nth], 1, 60 * MS + 1)]);
        }
    }

    #[test]
    fn a_hang_ends_with_a_requested_reset_or_a_failed_supply() {
        for board in BOARDS {
            let pin = What::Reset { board, cause: Cause::Pin, asked: true };
            for what in [pin, What::Power { board, on: false }] {
                assert_eq!(hung(board, 20 * MS, what), []);
            }
        }
    }

    #[test]
    fn only_the_first_hang_of_a_powered_board_counts() {
        for (nth, board) in BOARDS.into_iter().enumerate() {
            let mut events = run();
            events.add(40 * MS, What::Power { board, on: false });
            events.add(50 * MS, What::Hung { board }).add(60 * MS, What::Power { board, on: true });
            events.add(70 * MS, reset(board, Cause::Watchdog));
            assert_eq!(broken(events.end(600 * MS)), [(RESTARTED[nth], 1, 70 * MS)]);
            let mut events = run();
            events.add(40 * MS, What::Power { board, on: false }).add(50 * MS, What::Hung { board });
            assert_eq!(broken(events.end(600 * MS)), [], "nothing has to restart it");
            let again = hung(board, 30 * MS, What::Hung { board });
            assert_eq!(again, [(STAYS[nth], 1, 50 * MS + LONGEST[nth])]);
        }
    }

    #[test]
    fn a_dead_task_must_lead_to_a_watchdog_reset_in_time() {
        for (nth, board) in BOARDS.into_iter().enumerate() {
            let dead = |after: u64, what: What| {
                let mut events = run();
                events.add(50 * MS, injected(Disturbance::DeadTask { board, task: 1 }, 50 * MS));
                broken(events.add(50 * MS + after, what).end(600 * MS))
            };
            let longest = LONGEST[nth] + bounds::CHECKED_IN[nth];
            let bites = || reset(board, Cause::Watchdog);
            assert_eq!(dead(longest, bites()), []);
            assert_eq!(dead(longest + 1, bites()), [(STAYS[nth], 1, 50 * MS + longest)], "told once");
            assert_eq!(dead(20 * MS, reset(board, Cause::Lockup)), [(RESTARTED[nth], 1, 70 * MS)]);
            assert_eq!(dead(9 * MS, What::Hung { board })[0], (STAYS[nth], 1, 59 * MS + LONGEST[nth]));
        }
    }

    #[test]
    fn a_hang_excuses_front_end_misuse_until_shortly_after_the_restart() {
        for board in BOARDS {
            let misuse = |at: u64, of: Board| {
                let mut events = run();
                events.add(50 * MS, What::Hung { board });
                events.add(90 * MS, reset(board, Cause::Watchdog));
                events.add(at, What::Misuse { board: of, text: "in words".into() });
                broken(&events).len()
            };
            let over = 90 * MS + bounds::CUT_SHORT - 1;
            for (at, of, told) in [
                (50 * MS - 1, board, 1),
                (50 * MS, board, 0),
                (90 * MS - 1, board, 0),
                (over, board, 0),
                (over + 1, board, 1),
            ] {
                assert_eq!(misuse(at, of), told, "{at}");
            }
            let other = BOARDS[usize::from(board == Board::Horus)];
            assert_eq!(misuse(60 * MS, other), 1);
        }
    }

    #[test]
    fn a_missing_counter_and_a_late_action_are_violations() {
        let mut events = run();
        events.add(60 * MS, counter(Board::Dpr, "scrubs", None));
        assert_eq!(broken(&events), [(Violation::NoTelemetry, 1, 60 * MS)]);
        let mut events = run();
        events.add(60 * MS, What::Late { board: Board::Dpr, text: "5 ns".into() });
        assert_eq!(broken(&events), [(Violation::Late, 1, 60 * MS)]);
    }

    #[test]
    fn every_fault_counter_that_nothing_explains_is_a_complaint_of_its_board() {
        let horus = ["frames_skipped", "rf_faults", "cycle_overruns", "overruns", "lines.2.overruns"];
        let dpr = ["scrub_faults", "rf_faults", "overruns", "images_expired"];
        let horus = horus.map(|name| (Board::Horus, name, Violation::HorusComplains));
        let dpr = dpr.map(|name| (Board::Dpr, name, Violation::DprComplains));
        for (board, name, violation) in horus.into_iter().chain(dpr) {
            let mut events = run();
            events.add(60 * MS, counter(board, name, Some(1)));
            assert_eq!(broken(&events), [(violation, 1, 60 * MS)], "{name}");
        }
    }

    #[test]
    fn counters_that_count_no_faults_are_no_complaint() {
        let mut events = run();
        for name in ["scrub_faults", "images_expired", "frames_sent", "lines.0.damaged", "overruns.bytes"] {
            events.add(60 * MS, counter(Board::Horus, name, Some(1)));
        }
        for name in ["frames_skipped", "cycle_overruns", "frames_missed", "ssi_over_reads"] {
            events.add(60 * MS, counter(Board::Dpr, name, Some(1)));
        }
        assert_eq!(broken(&events), []);
    }

    fn complaining(change: impl FnOnce(&mut Events)) -> Vec<Violation> {
        let mut events = run();
        events.add(100 * MS, counter(Board::Horus, "rf_faults", Some(1)));
        events.add(100 * MS, counter(Board::Dpr, "rf_faults", Some(1)));
        change(&mut events);
        broken(&events).into_iter().map(|(violation, ..)| violation).collect()
    }

    fn frame(at: u64, bytes: &[u8], whole: bool) -> Event {
        let what = What::Heard { started: at, bytes: bytes.to_vec().into(), whole };
        Event { at, what }
    }

    #[test]
    fn a_complaint_that_something_in_the_log_explains_is_no_violation() {
        let both = [Violation::HorusComplains, Violation::DprComplains];
        let (of_horus, of_dpr) = ([both[0]], [both[1]]);
        assert_eq!(complaining(|_| {}), both);
        assert_eq!(complaining(|events| _ = events.field(60 * MS, false)), []);
        assert_eq!(complaining(|events| _ = events.add(9 * MS, What::Power { board: Board::Dpr, on: false })), both);
        assert_eq!(complaining(|events| _ = events.reset(9 * MS, Board::Dpr, true)), both);
        assert_eq!(complaining(|events| _ = events.reset(9 * MS, Board::Horus, true)), of_horus);
        let disturbed = |disturbs| complaining(|events| _ = events.add(9 * MS, injected(disturbs, 9 * MS)));
        assert_eq!(disturbed(Disturbance::Air), of_horus);
        assert_eq!(disturbed(Disturbance::Receiver { receiver: 0 }), of_dpr);
        assert_eq!(disturbed(Disturbance::Input { input: 0 }), both);
        assert_eq!(disturbed(HORUS_FRONT_END), []);
        let late = What::Late { board: Board::Dpr, text: "5 ns".into() };
        let late = complaining(|events| _ = events.add(9 * MS, late));
        assert_eq!(late, [Violation::HorusComplains, Violation::DprComplains, Violation::Late], "beside anything else");
    }

    #[test]
    fn what_explains_a_complaint_does_so_until_the_boards_next_start() {
        for (board, expected) in [(Board::Horus, vec![Violation::HorusComplains]), (Board::Dpr, vec![])] {
            let disturbed = |events: &mut Events| {
                events.add(9 * MS, injected(HORUS_FRONT_END, 9 * MS)).field(60 * MS, false);
                events.reset(70 * MS, board, true);
            };
            let found: Vec<_> =
                complaining(disturbed).into_iter().filter(|it| *it != Violation::DprComplains).collect();
            assert_eq!(found, expected);
        }
        let restarted = |events: &mut Events| {
            events.add(9 * MS, injected(IMAGE_BIT, 9 * MS)).reset(70 * MS, Board::Dpr, true);
        };
        assert_eq!(complaining(restarted), [Violation::HorusComplains, Violation::DprComplains]);
    }

    #[test]
    fn a_disturbed_frame_explains_the_dprs_complaint() {
        let of_horus = [Violation::HorusComplains];
        let is_heard = |event: &Event| matches!(event.what, What::Heard { .. });
        let mut heard = 0;
        let second = |event: &Event| {
            heard += usize::from(is_heard(event));
            is_heard(event) && heard == 2
        };
        assert_eq!(complaining(|events| _ = events.without(second)), of_horus, "lost");
        let changed = |change: fn(&mut What)| {
            complaining(|events| {
                change(
                    &mut events.events.iter_mut().rfind(|event| matches!(event.what, What::Heard { .. })).unwrap().what,
                );
            })
        };
        assert_eq!(
            changed(|what| if let What::Heard { bytes, .. } = what {
                bytes.0[9] ^= 1;
            }),
            of_horus,
            "changed"
        );
        assert_eq!(
            changed(|what| if let What::Heard { whole, .. } = what {
                *whole = false;
            }),
            of_horus,
            "cut short"
        );
        assert_eq!(complaining(|events| events.events.push(frame(101 * MS, &[1], true))), of_horus, "made up");
    }

    #[test]
    fn a_rising_carrier_or_an_unfinished_frame_explains_no_complaint() {
        let both = [Violation::HorusComplains, Violation::DprComplains];
        assert_eq!(complaining(|events| _ = events.field(60 * MS, true)), both);
        assert_eq!(
            complaining(|events| {
                let last = events.events.iter().rposition(|event| matches!(event.what, What::Heard { .. })).unwrap();
                events.events.remove(last);
            }),
            both
        );
    }

    #[test]
    fn a_frame_that_horus_broke_off_is_not_missed_at_the_antenna() {
        let both = [Violation::HorusComplains, Violation::DprComplains];
        let cut = |events: &mut Events| {
            let last = events.events.iter().rposition(|event| matches!(event.what, What::Heard { .. })).unwrap();
            let at = events.events.remove(last).at;
            for event in events.events.iter_mut().filter(|event| event.at == at) {
                if let What::Sent { whole, .. } = &mut event.what {
                    *whole = false;
                }
            }
            let bytes = events.events.iter().find_map(|event| match &event.what {
                What::Sent { bytes, .. } => Some(bytes.clone()),
                _ => None,
            });
            let sent = What::Sent { started: 117 * MS, bit_rate: 424_000, bytes: bytes.clone().unwrap(), whole: true };
            events.add(118 * MS, sent);
            events.events.push(frame(118 * MS, &bytes.unwrap(), true));
        };
        assert_eq!(complaining(cut), both);
    }

    #[test]
    fn injected_faults_are_counted_by_kind() {
        let mut events = run();
        for kind in ["noise", "upset", "noise"] {
            let kind = kind.to_owned();
            events.add(50 * MS, What::Injected { kind, disturbs: Disturbance::Air, until: 50 * MS });
        }
        let (broken, figures) = found(Boards::new(&header(3)), &events.log());
        assert_eq!(broken, []);
        let wanted = [("noise".to_owned(), 2), ("upset".to_owned(), 1)];
        assert_eq!(figures.faults.injected, BTreeMap::from(wanted));
    }
}
