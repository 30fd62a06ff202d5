use profile::{GpsValues, HorusState, LinkStatus, LinkValues, Profile, ReportedStatus, ReportedValues};

use super::*;
use crate::{Alarm, Place};

const SECOND: u64 = 1_000_000;

const BEGIN: u64 = 1_000 * SECOND;

fn profile_in(timestamp: u32, state: HorusState) -> Profile<1> {
    let status = ReportedStatus::new().with_position_valid(true).with_state(state);
    let (latitude, longitude) = (47.0, 8.0);
    let reported = ReportedValues { status, latitude, longitude, ..ReportedValues::absent(timestamp) };
    Profile::seal(&reported, &[GpsValues::absent(timestamp)])
}

fn profile(timestamp: u32) -> Profile<1> {
    profile_in(timestamp, HorusState::Monitoring)
}

fn source(port: u16) -> Source {
    Source { from: Some(SocketAddr::from(([10, 0, 0, 1], port))), ..Source::default() }
}

fn take(fleet: &mut Fleet, system: u32, port: u16, at_us: u64, sent: &Profile<1>) -> (String, Vec<Verdict>) {
    let bundle = Bundle::datagram(sent.as_bytes()).unwrap();
    let (id, verdicts) = fleet.take(Who::System(system), source(port), at_us, &bundle);
    (id.to_string(), verdicts)
}

fn names(fleet: &Fleet) -> Vec<String> {
    fleet.iter().map(|(id, _)| id.to_string()).collect()
}

fn has(fleet: &Fleet, name: &str, now_us: u64, alarm: Alarm) -> bool {
    let (_, drone) = fleet.iter().find(|(id, _)| id.to_string() == name).unwrap();
    drone.alarms_at(now_us).has(alarm)
}

#[test]
fn drones_are_kept_apart_and_strangers_make_none() {
    let mut fleet = Fleet::default();
    assert_eq!(take(&mut fleet, 1, 1, 0, &profile(500)).1, [Verdict::New; 2]);
    assert_eq!(take(&mut fleet, 2, 1, 0, &profile(10)).1, [Verdict::New; 2]);
    let nothing = Bundle::datagram(&[7; 124]).unwrap();
    let (_, verdicts) = fleet.take(Who::System(3), source(1), 0, &nothing);
    assert!(verdicts.iter().all(|verdict| !verdict.is_intact()));
    assert_eq!(names(&fleet), ["1", "2"]);
    assert_eq!(fleet.get(Who::System(2).first()).and_then(Drone::timestamp), Some(10));
    assert!(!has(&fleet, "1", 0, Alarm::TwoSenders));
}

#[test]
fn two_drones_with_one_system_id_are_two_and_both_say_so() {
    for ahead in [3_600_000, 0] {
        let mut fleet = Fleet::default();
        for tenth in 0..30_u32 {
            let at = BEGIN + 100_000 * u64::from(tenth);
            assert_eq!(take(&mut fleet, 7, 1, at, &profile(100 * tenth + ahead)).1, [Verdict::New; 2]);
            let other = profile_in(100 * tenth, HorusState::EmergencyFired);
            assert_eq!(take(&mut fleet, 7, 2, at, &other), ("7-2".into(), vec![Verdict::New; 2]));
        }
        assert_eq!(names(&fleet), ["7", "7-2"]);
        let sources = fleet.iter().map(|(id, _)| fleet.source(id));
        assert!(sources.eq([1, 2].map(|port| Some(source(port)))));
        for name in ["7", "7-2"] {
            assert!(has(&fleet, name, BEGIN + 3 * SECOND, Alarm::TwoSenders));
            assert_eq!(has(&fleet, name, BEGIN + 3 * SECOND, Alarm::EmergencyFired), name == "7-2");
        }
        assert!(
            !has(&fleet, "7", BEGIN + 3 * SECOND + RECENT_US, Alarm::TwoSenders),
            "the other has been quiet for long"
        );
        for tenth in 30..250 {
            take(&mut fleet, 7, 1, BEGIN + 100_000 * u64::from(tenth), &profile(100 * tenth + ahead));
        }
        assert!(!has(&fleet, "7", BEGIN + 25 * SECOND, Alarm::TwoSenders), "and one that goes on is alone");
    }
}

#[test]
fn two_drones_behind_one_router_are_two_as_well() {
    let mut fleet = Fleet::default();
    for tenth in 0..30_u32 {
        let at = 100_000 * u64::from(tenth);
        take(&mut fleet, 7, 1, at, &profile(100 * tenth + 3_600_000));
        take(&mut fleet, 7, 1, at, &profile_in(100 * tenth + 60_000, HorusState::EmergencyFired));
    }
    assert_eq!(names(&fleet), ["7", "7-2"]);
    assert!(has(&fleet, "7-2", 3 * SECOND, Alarm::EmergencyFired) && has(&fleet, "7", 3 * SECOND, Alarm::TwoSenders));
    for name in ["7", "7-2"] {
        assert!(!has(&fleet, name, 2_950_000, Alarm::Stale), "{name}");
    }
}

#[test]
fn one_sample_with_two_contents_is_of_two_senders() {
    let mut fleet = Fleet::default();
    take(&mut fleet, 7, 1, 0, &profile(500));
    assert_eq!(take(&mut fleet, 7, 1, 1, &profile(500)).1, [Verdict::Duplicate; 2]);
    assert!(!has(&fleet, "7", 1, Alarm::TwoSenders));
    let forged = profile_in(500, HorusState::EmergencyFired);
    assert_eq!(take(&mut fleet, 7, 1, 2, &forged).1, [Verdict::OutOfSequence, Verdict::Duplicate]);
    assert!(has(&fleet, "7", 2, Alarm::TwoSenders) && !has(&fleet, "7", 2, Alarm::EmergencyFired));
}

#[test]
fn forged_messages_from_a_drones_own_address_blind_nobody() {
    let mut fleet = Fleet::default();
    let mut at = 0;
    for tenth in 0..600_u32 {
        at = 100_000 * u64::from(tenth);
        assert_eq!(take(&mut fleet, 7, 1, at, &profile(60_000 + 100 * tenth)).1, [Verdict::New; 2], "{tenth}");
        match tenth {
            100 => drop(take(&mut fleet, 7, 1, at + 1, &profile(60_000 + 100 * tenth + 1_900))),
            200 => (0..3).for_each(|burst| {
                take(&mut fleet, 7, 1, at + burst, &profile(9_000_000 + 10 * burst as u32));
            }),
            _ => {}
        }
        assert!(fleet.get(Who::System(7).first()).unwrap().reported().unwrap().age_us(at) < 20_000, "{tenth}");
    }
    assert_eq!((names(&fleet), has(&fleet, "7", at, Alarm::Stale)), (vec!["7".to_owned()], false));
    let lost = at + SECOND;
    for burst in 0..3 {
        take(&mut fleet, 7, 1, lost + burst, &profile(9_000_000 + 10 * burst as u32));
    }
    let back = (0..5_u32).map(|tenth| {
        let at = lost + SECOND + 100_000 * u64::from(tenth);
        take(&mut fleet, 7, 1, at, &profile(60_000 + (at / 100_000) as u32 * 100)).1[0]
    });
    let back: Vec<_> = back.collect();
    assert_eq!(back[2..], [Verdict::New; 3], "{back:?}");
    assert_eq!(names(&fleet), ["7", "7-2"]);
}

#[test]
fn a_drone_whose_address_changed_is_one_again_after_silence() {
    let mut fleet = Fleet::default();
    let mut went = vec![];
    for tenth in 0..300_u32 {
        let at = 100_000 * u64::from(tenth);
        take(&mut fleet, 7, if tenth < 100 { 1 } else { 2 }, at, &profile(60_000 + 100 * tenth));
        went.extend(fleet.tick(at).into_iter().map(|(id, change)| (id.to_string(), change)));
        let expected: &[&str] = match tenth {
            0..100 => &["7"],
            100..200 => &["7", "7-2"],
            _ => &["7-2"],
        };
        assert_eq!(names(&fleet), expected, "{tenth}");
    }
    let over = |alarm| went.iter().any(|(id, change)| id == "7" && change.alarm == alarm && !change.raised);
    assert!(over(Alarm::Silent) && over(Alarm::Stale), "what was raised of it is over: {went:?}");
    let mut fleet = Fleet::default();
    for tenth in 0..300_u32 {
        let at = 100_000 * u64::from(tenth);
        let (port, timestamp) = if tenth < 100 { (1, 60_000 + 100 * tenth) } else { (2, 100 * tenth) };
        take(&mut fleet, 7, port, at, &profile(timestamp));
        fleet.tick(at);
    }
    assert_eq!(names(&fleet), ["7", "7-2"]);
}

#[test]
fn a_silent_sender_of_unknown_start_is_not_mistaken_for_another() {
    let mut fleet = Fleet::default();
    let link = LinkStatus::seal(&LinkValues::default());
    let alone = Bundle::from_first(Place::LinkStatus, link.as_bytes()).unwrap();
    fleet.take(Who::System(7), source(1), BEGIN, &alone);
    for tenth in 0..150_u32 {
        let at = BEGIN + 100_000 * u64::from(tenth);
        take(&mut fleet, 7, 2, at, &profile(100 * tenth));
        fleet.tick(at);
    }
    assert_eq!(names(&fleet), ["7", "7-2"]);
}

#[test]
fn invented_drones_push_no_speaking_drone_out() {
    let mut fleet = Fleet::default();
    let mut at = 0;
    for tenth in 0..100_u32 {
        at = 100_000 * u64::from(tenth);
        take(&mut fleet, 1, 1, at, &profile(100 * tenth));
        for invented in 0..100 {
            take(&mut fleet, 1_000 + 100 * tenth + invented, 2, at + u64::from(invented), &profile(10));
        }
    }
    assert_eq!((fleet.iter().len(), fleet.dropped()), (MAX_DRONES, 10_001 - MAX_DRONES as u64));
    assert!(!has(&fleet, "1", at, Alarm::Stale));
    assert_eq!(take(&mut fleet, 2, 3, at + 200, &profile(10)).1, [Verdict::New; 2], "a new one finds room");
    for invented in 0..50 {
        take(&mut fleet, 1, 100 + invented, at + 300, &profile(10));
    }
    assert_eq!(fleet.of(Who::System(1)).count(), usize::from(MAX_SENDERS));
    assert!(names(&fleet).contains(&"1".to_owned()) && fleet.refused() == 0);
}

#[test]
fn where_all_speak_no_further_one_is_taken_and_that_is_counted() {
    let mut fleet = Fleet::default();
    for cycle in 0..3_u32 {
        for system in 0..MAX_DRONES as u32 {
            take(&mut fleet, system, 1, BEGIN + 10_000 * u64::from(cycle), &profile(10 * cycle));
        }
    }
    assert_eq!(take(&mut fleet, 9_999, 1, BEGIN + 30_000, &profile(10)).1, []);
    assert_eq!((fleet.refused(), fleet.dropped(), fleet.iter().len()), (1, 0, MAX_DRONES));
    assert_eq!(take(&mut fleet, 9_999, 1, BEGIN + 20_000 + SILENT_US, &profile(10)).1, [], "silent for no longer");
    take(&mut fleet, 5, 1, BEGIN + 2 * SECOND, &profile(2_000));
    assert_eq!(take(&mut fleet, 9_999, 1, BEGIN + 2 * SECOND, &profile(10)).1, [Verdict::New; 2]);
    assert!(fleet.get(Who::System(0).first()).is_none() && fleet.get(Who::System(5).first()).is_some());
}
