//! Judges how soon after a disturbance the flight controller reads an object that HORUS sent after the disturbance.
//!
//! In this module a disturbance is one of these:
//!
//! - an injected fault that ends,
//! - a restart of either board,
//! - a supply that goes off or on,
//! - a frame that arrives at the DPR's antenna late, or not as HORUS sent it,
//! - a hang that the bench causes; it ends when the board restarts, by its watchdog or otherwise.
//!
//! After a disturbance the link must recover within [`bounds::RECOVERY_CYCLES`] cycles, or within
//! [`bounds::BRING_UP_CYCLES`] cycles if a front end has to be brought up again. Disturbances that overlap, or that
//! begin before the recovery from another one, count as one: it ends with the last of them and has the latest of their
//! limits.
//!
//! A late recovery is not reported if another violation explains it ([`keeps_from_reading`]).

use crate::{Event, Findings, Violation, What, bounds};

/// Disturbances that end in this last part of a run, ns, are not measured, because a recovery may take as long.
const TAIL: u64 = 400_000_000;

/// Several disturbances that count as one, because the link did not recover between them.
#[derive(Clone, Copy, Debug)]
struct Causes {
    /// The instant, ns, at which the last of the disturbances ended.
    since: u64,
    /// The instant, ns, by which the link must have recovered.
    due: u64,
    /// Whether a front end must be brought up again after one of the disturbances.
    bring_up: bool,
    /// The number of violations that can explain a late recovery, counted at the beginning of the first disturbance.
    told: u64,
}

/// The longest recoveries, in cycles of 10 ms, rounded up. A recovery lasts from a disturbance's end until an object
/// that HORUS sent after that end was read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Longest {
    pub(super) all: Option<u64>,
    /// The longest recovery that needed no bring-up of a front end.
    pub(super) without_bring_up: Option<u64>,
}

#[derive(Clone, Debug, Default)]
pub(super) struct Recovery {
    /// The disturbances from which the link has not recovered.
    causes: Option<Causes>,
    /// Whether the present recovery was already reported as late.
    late: bool,
    /// Whether HORUS has no supply, and whether the DPR has none.
    off: [bool; 2],
    hung: [bool; 2],
    /// The disturbances of the last [`TAIL`] from which the link has recovered, each with the start (ns) of the first
    /// transaction that read a new object.
    recent: Vec<(Causes, u64)>,
    /// The last frame that HORUS sent: the instant, ns, of its first bit, and its bytes.
    sent: Option<(u64, Vec<u8>)>,
    longest: Longest,
}

impl Recovery {
    pub(super) fn take(&mut self, event: &Event, findings: &mut Findings) {
        self.settle(event.at, findings);
        match &event.what {
            // From a fault that never ends the link cannot recover, so the fault is not measured.
            What::Injected { disturbs, until, .. } if *until < u64::MAX => {
                let bring_up = disturbs.brings_up();
                self.cause((*until).max(event.at), bring_up, findings);
            }
            What::Hung { board } => {
                self.hung[*board as usize] = true;
                self.cause(event.at, true, findings);
            }
            What::Reset { board, .. } => {
                self.hung[*board as usize] = false;
                self.cause(event.at, true, findings);
            }
            // The power-on at the beginning of the run is no disturbance.
            What::Power { board, on } if event.at > 0 => {
                self.off[*board as usize] = !on;
                self.hung[*board as usize] = false;
                self.cause(event.at, true, findings);
            }
            What::Sent { started, bytes, .. } => self.sent = Some((*started, bytes.to_vec())),
            What::Heard { started, bytes, .. } => {
                let as_sent =
                    |(sent, was): &(u64, Vec<u8>)| started.abs_diff(*sent) <= bounds::AIR_DELAY && was[..] == bytes[..];
                if !self.sent.as_ref().is_some_and(as_sent) {
                    self.cause(event.at, false, findings);
                }
            }
            _ => {}
        }
    }

    fn cause(&mut self, end: u64, bring_up: bool, findings: &Findings) {
        let cycles = if bring_up { bounds::BRING_UP_CYCLES } else { bounds::RECOVERY_CYCLES };
        let due = end.saturating_add(cycles * bounds::CYCLE);
        let causes = self.causes.get_or_insert_with(|| {
            self.late = false;
            Causes { since: end, due, bring_up, told: told(findings) }
        });
        causes.since = causes.since.max(end);
        causes.due = causes.due.max(due);
        causes.bring_up |= bring_up;
    }

    fn is_open(&self) -> bool {
        self.off.contains(&true) || self.hung.contains(&true)
    }

    /// Records a transaction begun at `selected`, ns, that showed an object of a frame begun at `started`, ns.
    pub(super) fn shown(&mut self, started: u64, selected: u64) {
        if self.is_open() {
            return;
        }
        if let Some(causes) = self.causes.take_if(|causes| started > causes.since) {
            self.recent.push((causes, selected));
        }
    }

    /// Measures the recovery from each disturbance that ended at least [`TAIL`] before `now`.
    fn settle(&mut self, now: u64, findings: &mut Findings) {
        let is_over = |causes: &Causes| now >= causes.since.saturating_add(TAIL);
        if let Some(causes) = self.causes
            && !self.late
            && !self.is_open()
            && is_over(&causes)
        {
            self.late = true;
            tell(&causes, None, findings);
        }
        let longest = &mut self.longest;
        self.recent.retain(|(causes, read)| {
            let counts = is_over(causes);
            if counts {
                longest.take(causes, *read);
                if *read > causes.due {
                    tell(causes, Some(*read), findings);
                }
            }
            !counts
        });
    }

    /// Returns the longest recoveries. A recovery that is not complete at the `end` of the run counts until then.
    pub(super) fn finish(&mut self, end: u64, findings: &mut Findings) -> Longest {
        self.settle(end, findings);
        let open = self.is_open();
        if let Some(causes) = self.causes.take().filter(|_| !open)
            && end >= causes.since.saturating_add(TAIL)
        {
            self.longest.take(&causes, end);
        }
        self.longest
    }
}

impl Longest {
    fn take(&mut self, causes: &Causes, read: u64) {
        let cycles = Some(cycles(causes.since, read));
        self.all = self.all.max(cycles);
        if !causes.bring_up {
            self.without_bring_up = self.without_bring_up.max(cycles);
        }
    }
}

fn told(findings: &Findings) -> u64 {
    findings.counts().filter(|(violation, _)| keeps_from_reading(*violation)).map(|(_, count)| count).sum()
}

/// Returns whether this violation means that a sample may be lost on its way to the flight controller.
const fn keeps_from_reading(violation: Violation) -> bool {
    matches!(
        violation,
        Violation::NoTick
            | Violation::TickIrregular
            | Violation::NoFrame
            | Violation::CommandWithoutFrame
            | Violation::BrokenOff
            | Violation::SentNotWhole
            | Violation::SentInvalid
            | Violation::TimestampWrong
            | Violation::FieldDropped
            | Violation::NoTransaction
            | Violation::NeverReady
            | Violation::BusyTwice
            | Violation::Silent
            | Violation::Vacant
            | Violation::NotShown
            | Violation::HorusRestarted
            | Violation::DprRestarted
            | Violation::HorusStaysHung
            | Violation::DprStaysHung
    )
}

/// Reports a late recovery, unless a violation since the beginning of the disturbance explains it.
fn tell(causes: &Causes, read: Option<u64>, findings: &mut Findings) {
    if told(findings) > causes.told {
        return;
    }
    let Causes { since, due, .. } = *causes;
    findings.add(Violation::RecoversLate, due, || {
        let allowed = cycles(since, due);
        let since = since as f64 / 1e6;
        match read {
            Some(read) => format!("{} cycles after {since:.6} ms instead of {allowed}", cycles(causes.since, read)),
            None => format!("not yet {} cycles after {since:.6} ms", TAIL / bounds::CYCLE),
        }
    });
}

/// Returns the number of cycles of 10 ms in the time from `from` to `to`, rounded up; at least one.
fn cycles(from: u64, to: u64) -> u64 {
    to.saturating_sub(from).div_ceil(bounds::CYCLE).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{self, DPR_FRONT_END, HORUS_FRONT_END, IMAGE_BIT, MISUSE};
    use crate::{Board, Disturbance};

    const MS: u64 = 1_000_000;

    fn injected(at: u64, kind: Disturbance, until: u64) -> Event {
        Event { at, what: testing::injected(kind, until) }
    }

    fn judged(events: &[Event], read: u64, others: u64) -> (Vec<Violation>, Longest) {
        let (mut recovery, mut findings) = (Recovery::default(), Findings::default());
        events.iter().for_each(|event| recovery.take(event, &mut findings));
        for at in 0..others {
            findings.add(Violation::NotShown, at, String::new);
        }
        recovery.shown(read - 1, read);
        recovery.take(&injected(read + TAIL, Disturbance::Air, u64::MAX), &mut findings);
        let longest = recovery.finish(read + TAIL, &mut findings);
        (findings.counts().map(|(violation, _)| violation).collect(), longest)
    }

    #[test]
    fn recovery_may_take_five_cycles_or_fifteen_with_a_bring_up() {
        let ends = 100 * MS;
        for (kind, cycles) in [
            (Disturbance::Air, 5),
            (MISUSE, 5),
            (IMAGE_BIT, 5),
            (DPR_FRONT_END, 15),
            (HORUS_FRONT_END, 15),
            (Disturbance::Restart { board: Board::Dpr }, 15),
        ] {
            let cause = [injected(50 * MS, kind, ends)];
            let due = ends + cycles * bounds::CYCLE;
            let (found, longest) = judged(&cause, due, 0);
            let without_bring_up = (cycles == 5).then_some(5);
            assert_eq!((found, longest), (vec![], Longest { all: Some(cycles), without_bring_up }), "{kind:?}");
            assert_eq!(judged(&cause, due + 1, 0).0, [Violation::RecoversLate], "{kind:?}");
            assert_eq!(judged(&cause, due + 1, 1).0, [Violation::NotShown], "{kind:?}");
        }
    }

    #[test]
    fn what_keeps_nothing_from_being_read_hides_no_late_recovery() {
        for (violation, hides) in [
            (Violation::NoFrame, true),
            (Violation::Silent, true),
            (Violation::DprRestarted, true),
            (Violation::StatusWrong, false),
            (Violation::LinkFlags, false),
            (Violation::PortStatusWrong, false),
            (Violation::FrontEndMisuse, false),
        ] {
            let (mut recovery, mut findings) = (Recovery::default(), Findings::default());
            recovery.take(&injected(50 * MS, Disturbance::Air, 100 * MS), &mut findings);
            findings.add(violation, 110 * MS, String::new);
            recovery.shown(300 * MS, 301 * MS);
            recovery.finish(100 * MS + TAIL, &mut findings);
            assert_eq!(findings.count(Violation::RecoversLate), u64::from(!hides), "{violation:?}");
        }
    }

    #[test]
    fn of_causes_that_overlap_each_has_its_own_bound() {
        let front_end = injected(50 * MS, DPR_FRONT_END, 100 * MS);
        let air = |until| injected(60 * MS, Disturbance::Air, until);
        let judged = |until, read| judged(&[front_end.clone(), air(until)], read, 0).0;
        assert_eq!(judged(120 * MS, 250 * MS), []);
        assert_eq!(judged(120 * MS, 250 * MS + 1), [Violation::RecoversLate]);
        assert_eq!(judged(210 * MS, 260 * MS), []);
        assert_eq!(judged(210 * MS, 260 * MS + 1), [Violation::RecoversLate]);
    }

    #[test]
    fn overlapping_causes_count_as_a_bring_up_if_one_needs_it() {
        let front_end = injected(50 * MS, DPR_FRONT_END, 100 * MS);
        let air = injected(60 * MS, Disturbance::Air, 110 * MS);
        let (_, longest) = judged(&[front_end, air], 130 * MS, 0);
        assert_eq!(longest, Longest { all: Some(2), without_bring_up: None });
    }

    #[test]
    fn a_frame_begun_by_the_causes_end_shows_no_recovery() {
        let recovered = |started| {
            let (mut recovery, mut findings) = (Recovery::default(), Findings::default());
            recovery.take(&injected(50 * MS, Disturbance::Air, 100 * MS), &mut findings);
            recovery.shown(started, 105 * MS);
            recovery.shown(110 * MS, 125 * MS);
            recovery.finish(100 * MS + TAIL, &mut findings).all
        };
        assert_eq!(recovered(100 * MS), Some(3));
        assert_eq!(recovered(100 * MS + 1), Some(1));
    }

    #[test]
    fn a_link_that_never_recovers_is_reported_late_once() {
        let found = |off: bool| {
            let (mut recovery, mut findings) = (Recovery::default(), Findings::default());
            recovery.take(&injected(50 * MS, Disturbance::Air, 100 * MS), &mut findings);
            if off {
                let power = What::Power { board: Board::Horus, on: false };
                recovery.take(&Event { at: 60 * MS, what: power }, &mut findings);
            }
            for at in [100 * MS + TAIL - 1, 100 * MS + TAIL, 2 * TAIL, 3 * TAIL] {
                recovery.take(&Event { at, what: What::Tick }, &mut findings);
                assert_eq!(findings.count(Violation::RecoversLate), u64::from(!off && at >= 100 * MS + TAIL));
            }
            let longest = recovery.finish(3 * TAIL, &mut findings).all;
            (longest, findings.into_broken().pop().map(|broken| broken.words))
        };
        let words = "not yet 40 cycles after 100.000000 ms".to_owned();
        assert_eq!(found(false), (Some(cycles(100 * MS, 3 * TAIL)), Some(words)));
        assert_eq!(found(true), (None, None));
    }

    #[test]
    fn recovery_from_a_hang_counts_from_the_boards_restart() {
        let hung = |at, board| Event { at, what: What::Hung { board } };
        let reset = |at, board| Event { at, what: What::Reset { board, cause: crate::Cause::Pin, asked: false } };
        let power = |at, board, on| Event { at, what: What::Power { board, on } };
        for board in [Board::Horus, Board::Dpr] {
            let due = 90 * MS + bounds::BRING_UP_CYCLES * bounds::CYCLE;
            for ends in [reset(90 * MS, board), power(90 * MS, board, true)] {
                let cause = [injected(50 * MS, Disturbance::Hang { board }, 50 * MS), hung(50 * MS, board), ends];
                let (found, longest) = judged(&cause, due, 0);
                let all = Some(bounds::BRING_UP_CYCLES);
                assert_eq!((found, longest), (vec![], Longest { all, without_bring_up: None }));
                assert_eq!(judged(&cause, due + 1, 0).0, [Violation::RecoversLate]);
            }
            let (mut recovery, mut findings) = (Recovery::default(), Findings::default());
            recovery.take(&hung(50 * MS, board), &mut findings);
            recovery.shown(60 * MS, 65 * MS);
            recovery.take(&Event { at: 50 * MS + 2 * TAIL, what: What::Tick }, &mut findings);
            assert_eq!(findings.counts().count(), 0);
            recovery.take(&reset(60 * MS + 2 * TAIL, board), &mut findings);
            recovery.shown(61 * MS + 2 * TAIL, 75 * MS + 2 * TAIL);
            assert_eq!(recovery.finish(60 * MS + 3 * TAIL, &mut findings).all, Some(2));
            let (mut recovery, mut findings) = (Recovery::default(), Findings::default());
            recovery.take(&hung(50 * MS, board), &mut findings);
            let other = if board == Board::Dpr { Board::Horus } else { Board::Dpr };
            recovery.take(&reset(60 * MS, other), &mut findings);
            recovery.shown(61 * MS, 65 * MS);
            assert_eq!(recovery.finish(60 * MS + TAIL, &mut findings).all, None);
            let (mut recovery, mut findings) = (Recovery::default(), Findings::default());
            recovery.take(&power(40 * MS, board, false), &mut findings);
            recovery.take(&hung(50 * MS, board), &mut findings);
            recovery.take(&power(60 * MS, board, true), &mut findings);
            recovery.shown(61 * MS, 65 * MS);
            assert_eq!(recovery.finish(60 * MS + TAIL, &mut findings).all, Some(1));
        }
    }

    #[test]
    fn a_frame_that_arrives_otherwise_than_it_was_sent_is_a_cause() {
        let frame = |started: u64, byte: u8| (started, crate::Bytes(vec![byte]));
        let recovered = |heard: (u64, crate::Bytes)| {
            let (mut recovery, mut findings) = (Recovery::default(), Findings::default());
            let (started, bytes) = frame(50 * MS, 1);
            let sent = What::Sent { started, bit_rate: 424_000, bytes, whole: true };
            recovery.take(&Event { at: 55 * MS, what: sent }, &mut findings);
            let what = What::Heard { started: heard.0, bytes: heard.1, whole: true };
            recovery.take(&Event { at: 55 * MS, what }, &mut findings);
            recovery.shown(61 * MS, 62 * MS);
            recovery.finish(55 * MS + TAIL, &mut findings).all
        };
        assert_eq!(recovered(frame(50 * MS, 1)), None);
        assert_eq!(recovered(frame(50 * MS, 2)), Some(1));
        assert_eq!(recovered(frame(50 * MS + bounds::AIR_DELAY + 1, 1)), Some(1));
    }
}
