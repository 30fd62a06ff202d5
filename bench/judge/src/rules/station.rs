//! Judges the age and the alarms that the base station states about the drone.
//!
//! The base station states the age of the Reported-Position that it shows, which is the newest one that arrived. This
//! rule compares that age with HORUS's tick. It also judges the alarms that follow from the age, from a silence and
//! from Reported-Position's status:
//!
//! | alarm | holds if |
//! |---|---|
//! | `silent` | no profile that the base station can show has arrived for [`bounds::STATION_SILENT`] |
//! | `stale` | the Reported-Position shown is older than [`bounds::STATION_STALE`], or there is none |
//! | `no-agreement` | Reported-Position says that its position is not valid |
//! | `emergency-fired`, `motors-cut`, `switched-to-redundant`, `inputs-contradict` | Reported-Position states this |
//! | `degraded`, `no-crystal`, `horus-memory-fault` | Reported-Position states this |
//!
//! At a limit of time the judge accepts an alarm as well as its absence. No age is required while HORUS runs without
//! its crystal.
//!
//! The station need not show a profile that does not continue the sequence, because it may come from another sender.
//! The judge therefore requires a value only after profiles have arrived in sequence for [`bounds::STATION_SETTLES`],
//! or after [`bounds::CLIENT_FINDS`] profiles at the beginning of a run.
//!
//! The station recognises a new start of HORUS only if the timestamps step back or the reason of the last reset changes
//! (docs/base-station.md). Otherwise the station may take a sample to be older than it is, by the time for which HORUS
//! did not run.

use std::collections::VecDeque;

use profile::{CYCLE_MS, HorusState, Layout, Object, ReportedStatus, ResetReason};

use super::Rule;
use crate::read::Frame;
use crate::{Board, Context, Event, Findings, Header, Violation, What, bounds};

const TICKS: usize = 256;

/// The sample that arrived last, from whose timestamp the station computes the ages of later samples.
#[derive(Clone, Copy, Debug)]
struct Last {
    timestamp: u32,
    reason: Option<ResetReason>,
    /// The sample's tick, ns, and the number of HORUS's starts at that tick.
    tick: (u64, u64),
    /// The error, ns, by which the station may overstate the ages of this sample and of later ones.
    late: u64,
}

/// The newest Reported-Position that arrived.
#[derive(Clone, Copy, Debug)]
struct Newest {
    timestamp: u32,
    status: ReportedStatus,
    /// The sample's tick, and the error by which the station may overstate the sample's age, ns; `None` if not known.
    tick: Option<(u64, u64)>,
    /// The number of consecutive profiles in sequence up to this one, and the arrival, ns, of the first of them.
    row: (u32, u64),
    /// Whether this sequence of profiles began with the first profile of the run.
    first: bool,
    at: u64,
}

/// The rule that judges the base station's ages and alarms; see the [module](self).
#[derive(Clone, Debug)]
pub struct Station {
    layout: Layout,
    tick: Option<u64>,
    starts: u64,
    /// The Reported-Positions that HORUS sent, each with its timestamp (ms), its tick (ns) and the number of HORUS's
    /// starts at that tick.
    sent: VecDeque<(u32, (u64, u64))>,
    newest: Option<Newest>,
    last: Option<Last>,
    /// The instant, ns, at which the station last received a profile that it can show.
    arrived: u64,
    /// The alarm or the age that was wrong in the last statement. It is not reported again while it stays wrong.
    told: Option<&'static str>,
}

impl Rule for Station {
    fn new(header: &Header) -> Self {
        Self {
            layout: Layout::for_receivers(header.gps).expect("a profile has 1, 2, 3 or 5 receivers"),
            tick: None,
            starts: 0,
            sent: VecDeque::new(),
            newest: None,
            last: None,
            arrived: 0,
            told: None,
        }
    }

    fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
        match &event.what {
            What::Tick => self.tick = Some(event.at),
            What::Reset { board: Board::Horus, .. } => self.starts += 1,
            What::Sent { whole: true, .. } => {
                let stamp = context.frame().filter(|frame| frame.number == Some(0)).and_then(Frame::timestamp);
                if let (Some(stamp), Some(tick)) = (stamp, self.tick) {
                    if self.sent.len() == TICKS {
                        self.sent.pop_front();
                    }
                    self.sent.push_back((stamp, (tick, self.starts)));
                }
            }
            What::Arrived { profile, shown } => self.arrived(event.at, profile, *shown),
            What::Station { age_us, alarms } => {
                let wrong = self.wrong_alarm(event.at, alarms).map(|name| (Violation::StationAlarm, name));
                let wrong =
                    wrong.or_else(|| self.is_age_wrong(event.at, *age_us).then_some((Violation::StationAge, "age")));
                let before = std::mem::replace(&mut self.told, wrong.map(|(_, name)| name));
                if let Some((violation, name)) = wrong.filter(|(_, name)| before != Some(name)) {
                    findings.add(violation, event.at, || format!("{name}: it says {age_us:?} µs and {alarms:?}"));
                }
            }
            _ => {}
        }
    }
}

impl Station {
    fn arrived(&mut self, at: u64, profile: &[u8], shown: u8) {
        if shown == 0 {
            return;
        }
        self.arrived = at;
        let bytes = self.layout.in_profile(0).and_then(|place| profile.get(place)).unwrap_or_default();
        let Ok(Object::Reported(object)) = Object::verify(0, bytes) else { return };
        let values = object.values();
        let follows = |before: Newest| {
            let step = values.timestamp.wrapping_sub(before.timestamp);
            // The flight controller may leave up to three cycles unread between two forwarded profiles.
            step > 0 && step % CYCLE_MS == 0 && step <= 4 * CYCLE_MS
        };
        let before = self.newest.filter(|before| follows(*before));
        let row = before.map_or((1, at), |before| (before.row.0 + 1, before.row.1));
        let first = before.map_or(self.newest.is_none(), |before| before.first);
        let tick = self.sent.iter().rfind(|(stamp, _)| *stamp == values.timestamp).copied();
        let tick = tick.map(|(_, tick)| (tick.0, self.late(values.timestamp, values.status.reset_reason(), tick)));
        self.newest = Some(Newest { timestamp: values.timestamp, status: values.status, tick, row, first, at });
    }

    /// Records that a sample has arrived. Returns how much, ns, the station may overstate the sample's age.
    fn late(&mut self, timestamp: u32, reason: Option<ResetReason>, tick: (u64, u64)) -> u64 {
        let step = |last: Last| timestamp.wrapping_sub(last.timestamp);
        let goes_on = self.last.filter(|last| step(*last).cast_signed() >= 0 && last.reason == reason);
        let late = goes_on.map_or(0, |last| match last.tick.1 == tick.1 {
            true => last.late,
            false => (last.late + tick.0 - last.tick.0).saturating_sub(u64::from(step(last)) * 1_000_000),
        });
        self.last = Some(Last { timestamp, reason, tick, late });
        late
    }

    /// Returns the Reported-Position that the station certainly shows; `None` if it may show another.
    fn shown(&self) -> Option<Newest> {
        self.newest.filter(|newest| {
            let (count, since) = newest.row;
            newest.first && count >= bounds::CLIENT_FINDS || newest.at - since >= bounds::STATION_SETTLES
        })
    }

    /// Returns the true age, ns, of the sample that is shown at the instant `at`, and the greatest age that the station
    /// may state.
    fn ages(&self, at: u64) -> Option<[u64; 2]> {
        let shown = self.shown().filter(|shown| !shown.status.without_crystal())?;
        let (tick, late) = shown.tick?;
        Some([at - tick, at - tick + late])
    }

    fn is_age_wrong(&self, at: u64, told_us: Option<u64>) -> bool {
        let is_off = |told: u64| move |age: u64| age.abs_diff(told.saturating_mul(1_000)) > bounds::STATION_AGE_OFF;
        self.ages(at).is_some_and(|ages| told_us.is_none_or(|told| ages.into_iter().all(is_off(told))))
    }

    /// Returns an alarm that is given wrongly, or that is missing.
    fn wrong_alarm(&self, at: u64, alarms: &[String]) -> Option<&'static str> {
        let holds = |name: &str| alarms.iter().any(|alarm| alarm == name);
        let after = |age: u64, limit: u64| match age {
            age if age > limit + bounds::STATION_AGE_OFF => Some(true),
            age if age + bounds::STATION_AGE_OFF < limit => Some(false),
            _ => None,
        };
        // After a silence the station may accept profiles late and so end its alarm late.
        let silent =
            after(at - self.arrived, bounds::STATION_SILENT).filter(|silent| *silent || self.shown().is_some());
        let stale = self.ages(at).map(|ages| ages.map(|age| after(age, bounds::STATION_STALE)));
        let stale = stale.and_then(|[stale, late]| stale.filter(|_| stale == late));
        let status = self.shown().map(|shown| shown.status);
        let says = |of: fn(ReportedStatus) -> bool| status.map(of);
        let is_in = |state: HorusState| status.map(|status| status.state() == Some(state));
        let wanted = [
            ("silent", silent),
            ("stale", stale),
            ("no-agreement", says(|status| !status.position_valid())),
            ("emergency-fired", is_in(HorusState::EmergencyFired)),
            ("motors-cut", is_in(HorusState::MotorsCut)),
            ("switched-to-redundant", is_in(HorusState::SwitchedToRedundant)),
            ("inputs-contradict", is_in(HorusState::InputsContradict)),
            ("degraded", says(ReportedStatus::degraded)),
            ("no-crystal", says(ReportedStatus::without_crystal)),
            ("horus-memory-fault", says(ReportedStatus::memory_fault)),
        ];
        wanted
            .into_iter()
            .find(|(name, wanted)| wanted.is_some_and(|wanted| wanted != holds(name)))
            .map(|(name, _)| name)
    }
}

#[cfg(test)]
mod tests {
    use profile::ReportedValues;

    use super::*;
    use crate::testing::{self, Events, MS, found, header, silent_gps, silent_reported};

    type Change = Box<dyn Fn(ReportedStatus) -> ReportedStatus>;

    const CYCLES: u64 = 10;
    /// The instant, ns, of the last cycle's tick.
    const TICK: u64 = testing::FIRST_TICK + (CYCLES - 1) * bounds::CYCLE;
    const ARRIVED: u64 = TICK + 8 * MS;

    fn names(alarms: &[&str]) -> Vec<String> {
        alarms.iter().map(|name| (*name).to_owned()).collect()
    }

    /// Returns the violations if [`CYCLES`] cycles arrive with the status from `of`, and the station makes the
    /// statements in `says`.
    fn broken(
        of: impl Fn(ReportedStatus) -> ReportedStatus,
        cycles: u64,
        says: &[(u64, Option<u64>, &[&str])],
    ) -> Vec<(Violation, u64)> {
        broken_after(8 * MS, of, cycles, says)
    }

    fn broken_after(
        takes: u64,
        of: impl Fn(ReportedStatus) -> ReportedStatus,
        cycles: u64,
        says: &[(u64, Option<u64>, &[&str])],
    ) -> Vec<(Violation, u64)> {
        let mut log = Events::new(1);
        for n in CYCLES - cycles..CYCLES {
            let stamp = (n as u32 + 1) * CYCLE_MS;
            let silent = silent_reported(stamp);
            let status = of(silent.status.with_degraded(false).with_position_valid(true));
            let values = ReportedValues { status, ..silent };
            let tick = testing::FIRST_TICK + n * bounds::CYCLE;
            log.cycle_of(tick, &values, &[silent_gps(stamp)]);
            let profile = testing::objects(&values, &[silent_gps(stamp)]).concat();
            log.add(tick + takes, What::Arrived { profile: profile.into(), shown: 0b11 });
        }
        for (at, age, alarms) in says {
            let age_us = age.map(|age| age / 1_000);
            log.add(*at, What::Station { age_us, alarms: names(alarms) });
        }
        let found = found(Station::new(&header(1)), &log.log()).0;
        found.into_iter().map(|(violation, count, _)| (violation, count)).collect()
    }

    const fn same(status: ReportedStatus) -> ReportedStatus {
        status
    }

    const ALARM: [(Violation, u64); 1] = [(Violation::StationAlarm, 1)];
    const AGE: [(Violation, u64); 1] = [(Violation::StationAge, 1)];

    #[test]
    fn the_age_is_that_of_the_newest_sample_within_a_bound() {
        let at = ARRIVED + 200 * MS;
        let told = |age| broken(same, CYCLES, &[(at, age, &[])]);
        let (true_age, off) = (at - TICK, bounds::STATION_AGE_OFF);
        for (age, expected) in [
            (Some(true_age - off), vec![]),
            (Some(true_age - off - 1_000), AGE.into()),
            (Some(true_age + off), vec![]),
            (Some(true_age + off + 1_000), AGE.into()),
            (None, AGE.into()),
        ] {
            assert_eq!(told(age), expected, "{age:?}");
        }
        let few = u64::from(bounds::CLIENT_FINDS) - 1;
        assert_eq!(broken(same, few, &[(at, Some(0), &[])]), []);
        assert_eq!(broken(|it| it.with_without_crystal(true), CYCLES, &[(at, Some(0), &["no-crystal"])]), []);
    }

    #[test]
    fn a_sample_that_arrives_late_keeps_its_own_age() {
        let at = ARRIVED + 200 * MS;
        let told = |age| broken_after(38 * MS, same, CYCLES, &[(at, Some(age), &[])]);
        assert_eq!((told(at - TICK), told(0)), (vec![], AGE.into()));
    }

    #[test]
    fn what_comes_after_another_sequence_is_shown_for_certain_after_a_while() {
        let settles = bounds::STATION_SETTLES / bounds::CYCLE;
        let found = |cycles: u64| {
            let mut station = Station::new(&header(1));
            let mut arrive = |at: u64, stamp: u32| {
                let values = silent_reported(stamp);
                let profile = testing::objects(&values, &[silent_gps(stamp)]).concat();
                station.arrived(at, &profile, 0b11);
            };
            arrive(0, 90_000);
            (1..=cycles).for_each(|n| arrive(n * bounds::CYCLE, n as u32 * CYCLE_MS));
            station.wrong_alarm(cycles * bounds::CYCLE, &[]).is_some()
        };
        assert_eq!((found(settles), found(settles + 1)), (false, true), "no alarm, and there is no position");
    }

    #[test]
    fn up_to_three_cycles_that_were_not_read_break_no_sequence() {
        let found = |step: u32| {
            let mut station = Station::new(&header(1));
            for n in 0..bounds::CLIENT_FINDS {
                let stamp = 100 + n * step;
                let profile = testing::objects(&silent_reported(stamp), &[silent_gps(stamp)]).concat();
                station.arrived(u64::from(n) * bounds::CYCLE, &profile, 0b11);
            }
            station.wrong_alarm(u64::from(bounds::CLIENT_FINDS) * bounds::CYCLE, &[]).is_some()
        };
        let steps = [0, 5, 10, 15, 20, 40, 45, 50];
        assert_eq!(steps.map(found), [false, false, true, false, true, true, false, false]);
    }

    #[test]
    fn silence_and_staleness_are_told_within_a_bound_of_their_limits() {
        let off = bounds::STATION_AGE_OFF;
        let alarms = |at: u64, alarms: &[&str]| broken(same, CYCLES, &[(at, Some(at - TICK), alarms)]);
        let stale = TICK + bounds::STATION_STALE;
        for (at, without, with) in [
            (stale - off - 1, vec![], ALARM.into()),
            (stale - off, vec![], vec![]),
            (stale + off, vec![], vec![]),
            (stale + off + 1, ALARM.into(), vec![]),
        ] {
            assert_eq!((alarms(at, &[]), alarms(at, &["stale"])), (without, with), "{at}");
        }
        let silent = ARRIVED + bounds::STATION_SILENT;
        for (at, without, with) in [
            (silent - off - 1, vec![], ALARM.into()),
            (silent - off, vec![], vec![]),
            (silent + off, vec![], vec![]),
            (silent + off + 1, ALARM.into(), vec![]),
        ] {
            assert_eq!((alarms(at, &["stale"]), alarms(at, &["stale", "silent"])), (without, with), "{at}");
        }
    }

    #[test]
    fn an_alarm_holds_exactly_while_reported_position_reports_it() {
        let states = [
            (HorusState::EmergencyFired, "emergency-fired"),
            (HorusState::MotorsCut, "motors-cut"),
            (HorusState::SwitchedToRedundant, "switched-to-redundant"),
            (HorusState::InputsContradict, "inputs-contradict"),
        ];
        let says = |of: &dyn Fn(ReportedStatus) -> ReportedStatus, alarms: &[&str]| {
            broken(of, CYCLES, &[(ARRIVED + MS, Some(9 * MS), alarms)])
        };
        let mut of: Vec<(Change, &str)> = vec![
            (Box::new(|it| it.with_position_valid(false)), "no-agreement"),
            (Box::new(|it| it.with_degraded(true)), "degraded"),
            (Box::new(|it| it.with_without_crystal(true)), "no-crystal"),
            (Box::new(|it| it.with_memory_fault(true)), "horus-memory-fault"),
        ];
        for (state, name) in states {
            of.push((Box::new(move |it: ReportedStatus| it.with_state(state)), name));
        }
        for (of, name) in of {
            assert_eq!(says(&of, &[name]), [], "{name}");
            assert_eq!(says(&of, &[]), ALARM, "{name}");
            assert_eq!(says(&same, &[name]), ALARM, "{name}");
        }
        assert_eq!(says(&same, &["restarted", "damaged"]), [], "those are not judged");
    }

    #[test]
    fn after_a_restart_of_horus_ages_may_follow_the_earlier_clock() {
        const AWAY: u64 = 1_000 * MS;
        let settles = bounds::STATION_SETTLES / bounds::CYCLE;
        let told_after = |earlier: bool, starts: bool, first: u32, reason: ResetReason, age: u64, alarms: &[&str]| {
            let mut log = Events::new(1);
            let mut cycle = |tick: u64, stamp: u32, reason: ResetReason| {
                let silent = silent_reported(stamp);
                let status = silent.status.with_position_valid(true).with_degraded(false).with_reset_reason(reason);
                let values = ReportedValues { status, ..silent };
                log.cycle_of(tick, &values, &[silent_gps(stamp)]);
                let profile = testing::objects(&values, &[silent_gps(stamp)]).concat();
                log.add(tick + 8 * MS, What::Arrived { profile: profile.into(), shown: 0b11 });
            };
            if earlier {
                cycle(testing::FIRST_TICK - bounds::CYCLE, 90_000, ResetReason::PowerOn);
            }
            (0..CYCLES).for_each(|n| {
                cycle(testing::FIRST_TICK + n * bounds::CYCLE, (n as u32 + 1) * CYCLE_MS, ResetReason::PowerOn);
            });
            let again = |n: u64| TICK + AWAY + n * bounds::CYCLE;
            (0..=settles).for_each(|n| cycle(again(n), first + n as u32 * CYCLE_MS, reason));
            log.reset(testing::FIRST_TICK - MS, Board::Horus, true);
            if starts {
                log.reset(TICK + AWAY / 2, Board::Horus, true);
            }
            let at = again(settles) + 9 * MS;
            log.add(at, What::Station { age_us: Some((9 * MS + age) / 1_000), alarms: names(alarms) });
            let found = found(Station::new(&header(1)), &log.log()).0;
            found.into_iter().map(|(violation, count, _)| (violation, count)).collect::<Vec<_>>()
        };
        let told = |starts, first, reason, age, alarms: &[&str]| told_after(false, starts, first, reason, age, alarms);
        let same = ResetReason::PowerOn;
        let late = AWAY - 10 * MS;
        assert_eq!(told_after(true, true, 110, same, late, &["stale"]), [], "the first clock does not count any more");
        assert_eq!(told(true, 110, same, late, &["stale"]), []);
        assert_eq!(told(true, 100, same, AWAY, &["stale"]), [], "it has run for as long");
        assert_eq!(told(true, 110, same, 0, &[]), [], "it knows better");
        assert_eq!(told(true, 110, same, late / 2, &["stale"]), AGE, "neither");
        assert_eq!(told(true, 510, same, late - 400 * MS, &["stale"]), [], "it has run for longer");
        assert_eq!(told(true, 510, same, late, &["stale"]), AGE);
        assert_eq!(told(false, 1_100, same, 0, &[]), []);
        assert_eq!(told(false, 1_100, same, 0, &["stale"]), ALARM, "it was not away");
        assert_eq!(told(true, 110, ResetReason::Watchdog, late, &["stale"]), ALARM, "it says so");
        assert_eq!(told(true, 10, same, late, &["stale"]), ALARM, "its timestamps do");
    }

    #[test]
    fn what_stays_wrong_is_told_once() {
        let at = ARRIVED + MS;
        let wrong = (at, Some(9 * MS), &["degraded"][..]);
        assert_eq!(broken(same, CYCLES, &[wrong, (at + 1, Some(9 * MS), &["degraded"])]), ALARM);
        let again = [wrong, (at + 1, Some(9 * MS), &[]), (at + 2, Some(9 * MS), &["degraded"])];
        assert_eq!(broken(same, CYCLES, &again), [(Violation::StationAlarm, 2)]);
    }
}
