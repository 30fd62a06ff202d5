//! Judges whether the position that HORUS sends is where the aircraft was, and whether HORUS sends a position at all.
//!
//! In a run of simulated receivers, the log has the aircraft's true position at each tick ([`What::Aircraft`]). A valid
//! Reported-Position has to lie within [`bounds::POSITION_OFF_M`] of where the aircraft was in the last
//! [`bounds::POSITION_OLDEST`].
//!
//! A disturbed receiver may agree with the others, so [`bounds::AGREEMENT_M`] is added to the limit of the error while
//! any receiver is disturbed. Nothing is required while a quorum of receivers is disturbed, or one of two receivers, or
//! the only one.
//!
//! A position that is missing for [`bounds::POSITION_WITHIN`] is reported, unless another violation in this time
//! explains it.

use std::collections::VecDeque;

use gnss_sim::{Geodetic, TangentPlane};
use profile::ReportedValues;

use super::Rule;
use crate::disturbance::Excuse;
use crate::read::{State, Values};
use crate::{Board, Context, Event, Figures, Findings, Header, Violation, What, bounds};

/// The violations that explain why HORUS sends no position.
const EXPLAIN: &[Violation] = &[
    Violation::NotRead,
    Violation::NotConfigured,
    Violation::VoteMissing,
    Violation::ReportedWrong,
    Violation::ContentWrong,
    Violation::StatusWrong,
    Violation::ExclusionWrong,
    Violation::NoTick,
    Violation::TickIrregular,
    Violation::NoFrame,
    Violation::CommandWithoutFrame,
    Violation::SentInvalid,
    Violation::SentNotWhole,
    Violation::HorusRestarted,
    Violation::HorusStaysHung,
];

/// The aircraft's position at an instant.
#[derive(Clone, Copy, Debug)]
struct Truth {
    at: u64,
    place: Geodetic,
}

/// The rule that judges whether there is a position and whether it is right; see the [module](self).
#[derive(Clone, Debug)]
pub struct Position {
    receivers: usize,
    truths: VecDeque<Truth>,
    /// The instant, ns, since which HORUS has sent no valid position.
    waits_since: u64,
    /// The number of violations that explain a missing position, as found at the instant `waits_since`.
    explained: u64,
    told: bool,
    worst_mm: Option<u64>,
}

impl Rule for Position {
    fn new(header: &Header) -> Self {
        Self {
            receivers: header.gps,
            truths: VecDeque::new(),
            waits_since: 0,
            explained: 0,
            told: false,
            worst_mm: None,
        }
    }

    fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
        let at = event.at;
        match &event.what {
            What::Power { board: Board::Horus, .. } | What::Reset { board: Board::Horus, .. } => {
                self.wait(at, findings);
            }
            What::Aircraft { latitude, longitude, height } => {
                let degrees = |billionths: i64| billionths as f64 / 1e9;
                let place = Geodetic {
                    latitude: degrees(*latitude),
                    longitude: degrees(*longitude),
                    height: *height as f64 / 1e3,
                };
                self.truths.push_back(Truth { at, place });
                while self.truths.pop_front_if(|truth| truth.at + bounds::POSITION_OLDEST < at).is_some() {}
                if self.disturbed(at, context) >= bounds::quorum(self.receivers)
                    || context.running(Board::Horus).hung.is_some()
                {
                    self.wait(at, findings);
                }
                self.missing(at, findings);
            }
            What::Sent { started, whole: true, .. } => {
                let object = context.frame().and_then(|frame| frame.objects.first());
                if let Some(State::Valid { values: Values::Reported(values), .. }) = object.map(|it| &it.state)
                    && values.status.position_valid()
                {
                    self.wait(at, findings);
                    self.sent(*started, values, context, findings);
                }
            }
            _ => {}
        }
    }

    fn finish(&mut self, context: &Context, findings: &mut Findings, figures: &mut Figures) {
        if !self.truths.is_empty() {
            self.missing(context.now(), findings);
        }
        figures.voter.worst_mm = self.worst_mm;
    }
}

impl Position {
    /// Returns the number of receivers that may state a wrong position at the instant `at`, ns.
    fn disturbed(&self, at: u64, context: &Context) -> usize {
        let disturbances = context.disturbances();
        (0..self.receivers).filter(|receiver| disturbances.excuse_of(*receiver, Excuse::Position, at)).count()
    }

    fn wait(&mut self, at: u64, findings: &Findings) {
        (self.waits_since, self.explained, self.told) = (at, explaining(findings), false);
    }

    fn missing(&mut self, at: u64, findings: &mut Findings) {
        let due = self.waits_since + bounds::POSITION_WITHIN;
        if at > due && !std::mem::replace(&mut self.told, true) && explaining(findings) == self.explained {
            findings.add(Violation::NoPosition, due, || format!("none since {:.3} ms", self.waits_since as f64 / 1e6));
        }
    }

    fn sent(&mut self, started: u64, values: &ReportedValues, context: &Context, findings: &mut Findings) {
        let mut before = self.truths.iter().rev().filter(|truth| truth.at <= started);
        let Some(now) = before.clone().next().copied() else { return };
        let shown = Geodetic { latitude: values.latitude, longitude: values.longitude, height: now.place.height };
        let away = |truth: &Truth| {
            let [north, east, _] = TangentPlane::new(truth.place).to_ned(shown);
            let up = if values.altitude.is_nan() { 0.0 } else { values.altitude - truth.place.height };
            [libm::hypot(north, east), up.abs()]
        };
        let [along, _] = away(&now);
        self.worst_mm = self.worst_mm.max(Some((along * 1e3).round() as u64));
        let disturbed = self.disturbed(now.at, context);
        let [more_along, more_up] = match disturbed {
            0 => [0.0; 2],
            _ if self.receivers < 3 || disturbed >= bounds::quorum(self.receivers) => return,
            _ => bounds::AGREEMENT_M.map(|(_, most)| most),
        };
        let [off_along, off_up] = bounds::POSITION_OFF_M;
        let near = |truth: &Truth| {
            let [along, up] = away(truth);
            along <= off_along + more_along && up <= off_up + more_up
        };
        if !before.any(near) {
            let [along, up] = away(&now);
            findings.add(Violation::PositionOff, now.at, || format!("{along:.1} m, {up:.1} m in height"));
        }
    }
}

fn explaining(findings: &Findings) -> u64 {
    findings.counts().filter(|(violation, _)| EXPLAIN.contains(violation)).map(|(_, count)| count).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{self, Events, MS, found, header, injected, silent_gps, silent_reported};
    use crate::{Disturbance, Figures as AllFigures};

    const HOME: (i64, i64, i64) = (47_500_000_000, 8_700_000_000, 500_000);
    /// The number of 1e-9 degrees of latitude in a metre, exact to 0.1 %.
    const METRE: i64 = 8_993;

    fn reported(timestamp: u32, north_mm: i64, up_mm: i64) -> ReportedValues {
        let silent = silent_reported(timestamp);
        let status = silent.status.with_position_valid(true);
        let latitude = (HOME.0 + north_mm * METRE / 1_000) as f64 / 1e9;
        ReportedValues {
            status,
            latitude,
            longitude: HOME.1 as f64 / 1e9,
            altitude: (HOME.2 + up_mm) as f64 / 1e3,
            ..silent
        }
    }

    /// Returns the verdict on a run of `cycles` ticks. `truth` gives the aircraft's position at each tick (mm north),
    /// and `says` the position that HORUS sends.
    fn run(
        gps: usize,
        cycles: u64,
        truth: impl Fn(u64) -> i64,
        says: impl Fn(u64) -> Option<(i64, i64)>,
        events: Vec<(u64, What)>,
    ) -> (Vec<(Violation, u64, u64)>, AllFigures) {
        let mut log = Events::new(gps);
        for number in 1..=cycles {
            let tick = tick(number);
            let (latitude, longitude, height) = (HOME.0 + truth(number) * METRE / 1_000, HOME.1, HOME.2);
            log.add(tick, What::Aircraft { latitude, longitude, height });
            let stamp = number as u32 * 10;
            let values = says(number).map_or(silent_reported(stamp), |(north, up)| reported(stamp, north, up));
            log.cycle_of(tick, &values, &vec![silent_gps(stamp); gps]);
        }
        events.into_iter().for_each(|(at, what)| _ = log.add(at, what));
        found(Position::new(&header(gps)), &log.end(tick(cycles) + 9 * MS).log())
    }

    const fn tick(number: u64) -> u64 {
        testing::FIRST_TICK + (number - 1) * bounds::CYCLE
    }

    fn disturbed(receiver: usize) -> (u64, What) {
        (MS, injected(Disturbance::Receiver { receiver }, 2 * MS))
    }

    #[test]
    fn a_position_is_where_the_aircraft_was_within_a_bound() {
        for (north, up, off) in [(9_980, 0, 0), (10_020, 0, 1), (0, 20_000, 0), (0, -20_000, 0), (0, 20_001, 1)] {
            let (found, figures) = run(1, 1, |_| 0, |_| Some((north, up)), vec![]);
            let wanted = if off == 0 { vec![] } else { vec![(Violation::PositionOff, 1, tick(1))] };
            assert_eq!(found, wanted, "{north} {up}");
            let worst = figures.voter.worst_mm.unwrap() as i64;
            assert!((worst - north).abs() <= north / 500 + 1, "{worst}");
        }
        let flat = |_: u64| Some((0, 0));
        assert_eq!(run(1, 1, |_| 0, flat, vec![]).0, []);
    }

    #[test]
    fn a_position_may_be_as_old_as_a_solution_may_be_valid() {
        let oldest = bounds::POSITION_OLDEST / bounds::CYCLE;
        // In this run the aircraft moves away after the first tick, but HORUS goes on sending the first position.
        let leaves = |number: u64| if number == 1 { 0 } else { 50_000 };
        assert_eq!(run(1, 1 + oldest, leaves, |_| Some((0, 0)), vec![]).0, []);
        let late = run(1, 2 + oldest, leaves, |_| Some((0, 0)), vec![]).0;
        assert_eq!(late, [(Violation::PositionOff, 1, tick(2 + oldest))]);
    }

    #[test]
    fn fewer_disturbed_receivers_than_a_quorum_excuse_what_agreement_allows_alone() {
        for (gps, who, allowed_m) in [
            (1, vec![0], None),
            (2, vec![0], None),
            (3, vec![1], Some(40)),
            (3, vec![0, 1], None),
            (5, vec![0, 3], Some(40)),
            (5, vec![0, 1, 4], None),
            // The disturbed receiver is not fitted.
            (1, vec![1], Some(10)),
        ] {
            let events = || who.iter().map(|receiver| disturbed(*receiver)).collect::<Vec<_>>();
            let off = |metres: i64| run(gps, 1, |_| 0, |_| Some((metres * 1_000, 0)), events()).0.len();
            match allowed_m {
                None => assert_eq!(off(1_000), 0, "{gps} {who:?}"),
                Some(allowed) => assert_eq!((off(allowed - 1), off(allowed + 1)), (0, 1), "{gps} {who:?}"),
            }
        }
    }

    #[test]
    fn a_position_that_is_missing_for_too_long_is_told_once() {
        // The run ends 9 ms after its last tick. A position is due just before that.
        let late = bounds::POSITION_WITHIN / bounds::CYCLE - 1;
        let none = |cycles: u64, events| run(3, cycles, |_| 0, |_| None, events).0;
        assert_eq!(none(late - 1, vec![]), []);
        let told = [(Violation::NoPosition, 1, bounds::POSITION_WITHIN)];
        assert_eq!(none(late, vec![]), told);
        assert_eq!(none(late + 50, vec![]), told);
        let start = What::Reset { board: Board::Horus, cause: crate::Cause::Pin, asked: true };
        assert_eq!(none(late, vec![(50 * MS, start)]), []);
        assert_eq!(none(late, vec![(50 * MS, What::Hung { board: Board::Horus })]), [], "it hangs");
        assert_eq!(none(late, vec![disturbed(0)]), told, "two others are well");
        assert_eq!(none(late, vec![disturbed(0), disturbed(1)]), []);
        // HORUS sends one position, 30 ms after the first tick, and then none. The time without a position counts from
        // that one on.
        let lost = |number: u64| (number == 4).then_some((0, 0));
        assert_eq!(run(3, late, |_| 0, lost, vec![]).0, []);
        assert_eq!(run(3, late + 5, |_| 0, lost, vec![]).0.len(), 1);
    }

    #[test]
    fn a_position_that_something_found_explains_is_not_missed_as_well() {
        let mut position = Position::new(&header(3));
        let mut findings = Findings::default();
        position.wait(0, &findings);
        findings.add(Violation::NotRead, 5, String::new);
        position.missing(bounds::POSITION_WITHIN + 1, &mut findings);
        assert_eq!(findings.counts().count(), 1);
        position.wait(5, &findings);
        findings.add(Violation::LinkAge, 5, String::new);
        position.missing(5 + bounds::POSITION_WITHIN + 1, &mut findings);
        assert_eq!(findings.counts().count(), 3);
    }

    #[test]
    fn a_run_that_knows_no_truth_is_asked_for_nothing() {
        let mut log = Events::flawless(3, 900);
        assert_eq!(found(Position::new(&header(3)), &log.end(9_000 * MS).log()).0, []);
    }
}
