//! Tests what is judged of the profiles at the base station. Each test changes a flawless log in one way.

use crate::common;

use bench_judge::{Log, Violation, Violation::*, What, bounds};
use common::*;

/// Returns a flawless log, and the index of an event that forwards a profile. The profile's arrival is the next event.
fn forwarding(gps: usize) -> (Plan, Log, usize) {
    let plan = Plan::new(gps, 40);
    let log = plan.log();
    let forwarded = log.events.iter().enumerate().filter(|(_, event)| matches!(event.what, What::Forwarded { .. }));
    let place = forwarded.map(|(place, _)| place).nth(15).unwrap();
    assert!(matches!(log.events[place + 1].what, What::Arrived { .. }));
    (plan, log, place)
}

fn arrived(log: &mut Log, place: usize) -> (&mut Vec<u8>, &mut u8) {
    match &mut log.events[place].what {
        What::Arrived { profile, shown } => (&mut profile.0, shown),
        other => panic!("{other:?}"),
    }
}

fn kinds(log: &Log) -> Vec<Violation> {
    judged(log).kinds().collect()
}

#[test]
fn a_profile_must_arrive_within_100_ms_or_it_is_missed() {
    let (_, log, place) = forwarding(3);
    let at = log.events[place].at;
    let mut lost = log.clone();
    lost.events.remove(place + 1);
    assert_eq!(found(&lost), [(BaseMissed, 1)]);
    assert_eq!(judged(&lost).violations[0].first_at, at);
    let late = |by: u64| {
        let mut log = log.clone();
        log.events[place + 1].at += by;
        sort(&mut log);
        found(&log)
    };
    assert_eq!(late(bounds::DOWNLINK), []);
    assert_eq!(late(bounds::DOWNLINK + 1), [(BaseMissed, 1), (BaseChanged, 1)]);
    let mut log = log;
    let last = log.events.iter().rposition(|event| matches!(event.what, What::Arrived { .. })).unwrap();
    let at = log.events.remove(last).at;
    assert_eq!(found(&log), [(BaseMissed, 1)]);
    log.events.retain(|event| event.at <= at && event.what != What::End);
    insert(&mut log, at, What::End);
    assert_eq!(found(&log), [(BaseMissed, 1)]);
}

#[test]
fn a_profile_changed_on_its_way_is_not_missed_too() {
    for gps in [1, 2, 3, 5] {
        let (plan, log, place) = forwarding(gps);
        for byte in (0..plan.layout.profile_len()).step_by(11) {
            let mut log = log.clone();
            let (profile, shown) = arrived(&mut log, place + 1);
            profile[byte] ^= 0x10;
            let hit = (0..plan.layout.objects()).find(|index| plan.layout.in_profile(*index).unwrap().contains(&byte));
            *shown &= !(1 << hit.unwrap());
            assert_eq!(found(&log), [(BaseChanged, 1)], "{gps} {byte}");
        }
        let mut log = log;
        let (profile, shown) = arrived(&mut log, place + 1);
        profile.truncate(100);
        *shown = 1;
        assert_eq!(found(&log), [(BaseChanged, 1)], "{gps}");
    }
}

#[test]
fn a_change_explains_one_missing_profile_of_its_time_and_no_other() {
    let (_, log, place) = forwarding(3);
    // In the changed log, a forwarded profile is missing, and a changed one arrives.
    let spoilt = |log: &Log, place: usize| {
        let mut what = log.events[place].what.clone();
        if let What::Arrived { profile, shown } = &mut what {
            profile.0[200] ^= 1;
            *shown &= 0b0111;
        }
        what
    };
    for (before, violations) in
        [(150_000_000, [(BaseMissed, 1), (BaseChanged, 1)]), (1_000, [(BaseMissed, 1), (BaseChanged, 1)])]
    {
        let mut log = log.clone();
        let what = spoilt(&log, place + 1);
        let at = log.events.remove(place + 1).at - before;
        insert(&mut log, at, what);
        assert_eq!(found(&log), violations, "{before}");
    }
    let mut log = log;
    let what = spoilt(&log, place + 1);
    log.events[place + 1].what = what;
    let next = (place + 2..).find(|next| matches!(log.events[*next].what, What::Arrived { .. })).unwrap();
    log.events.remove(next);
    assert_eq!(found(&log), [(BaseMissed, 1), (BaseChanged, 1)]);
}

#[test]
fn a_profile_that_was_never_forwarded_or_arrives_twice_is_a_violation() {
    let (_, log, place) = forwarding(3);
    let mut twice = log.clone();
    let again = log.events[place + 1].clone();
    insert(&mut twice, again.at + 5_000_000, again.what.clone());
    assert_eq!(found(&twice), [(BaseChanged, 1)]);
    let mut invented = log.clone();
    let profile = profile(3, 7_000);
    insert(&mut invented, again.at, What::Arrived { profile: profile.into(), shown: 0b1111 });
    assert_eq!(found(&invented), [(BaseChanged, 1)]);
}

#[test]
fn profiles_may_overtake_each_other() {
    let (_, log, place) = forwarding(3);
    let mut log = log;
    log.events[place + 1].at += 30_000_000;
    sort(&mut log);
    assert_eq!(found(&log), []);
}

#[test]
fn what_is_forwarded_must_be_what_a_transaction_read() {
    let (_, log, place) = forwarding(3);
    let old = log.events.iter().find(|event| matches!(event.what, What::Forwarded { .. })).unwrap().what.clone();
    let What::Forwarded { profile: old } = old else { unreachable!("it is forwarded") };
    for profile in [profile(3, 7_000), old.to_vec()] {
        let mut log = log.clone();
        for event in &mut log.events[place..=place + 1] {
            match &mut event.what {
                What::Forwarded { profile: other } | What::Arrived { profile: other, .. } => {
                    other.0.clone_from(&profile);
                }
                _ => {}
            }
        }
        assert_eq!(found(&log), [(BaseChanged, 1)]);
    }
}

#[test]
fn what_was_read_busy_or_in_part_cannot_be_forwarded() {
    let (plan, log, place) = forwarding(3);
    let read = log.events[..place].iter().rposition(|event| matches!(event.what, What::Transaction { .. })).unwrap();
    let mut part = log.clone();
    miso(&mut part, read).truncate(plan.layout.image_len() - 1);
    assert_eq!(found(&part), [(BaseChanged, 1)]);
    let mut silent = log.clone();
    miso(&mut silent, read).fill(0xFF);
    for event in &mut silent.events[place..=place + 1] {
        match &mut event.what {
            What::Forwarded { profile } => profile.0.fill(0xFF),
            What::Arrived { profile, shown } => {
                profile.0.fill(0xFF);
                *shown = 0;
            }
            _ => {}
        }
    }
    assert_eq!(found(&silent), [(BaseChanged, 1)]);
}

#[test]
fn the_base_station_may_not_show_an_invalid_object() {
    let (plan, log, place) = forwarding(3);
    for index in 0..plan.layout.objects() {
        let mut log = log.clone();
        let (profile, _) = arrived(&mut log, place + 1);
        profile[plan.layout.in_profile(index).unwrap().start + 20] ^= 1;
        // The judge reports two violations: the bytes changed on the way, and the base station shows the changed
        // object.
        assert_eq!(found(&log), [(BaseChanged, 1), (BaseInvalid, 1)], "{index}");
    }
    for index in plan.layout.objects()..8 {
        let mut log = log.clone();
        *arrived(&mut log, place + 1).1 |= 1 << index;
        assert_eq!(found(&log), [(BaseInvalid, 1)], "{index}");
    }
    // In the changed log, two objects of the profile have changed places.
    let mut log = log;
    let (profile, _) = arrived(&mut log, place + 1);
    let second = profile[124..184].to_vec();
    profile.copy_within(64..124, 124);
    profile[64..124].copy_from_slice(&second);
    assert_eq!(found(&log), [(BaseChanged, 1), (BaseInvalid, 1)]);
}

#[test]
fn the_base_station_may_not_show_a_vacant_object() {
    let mut plan = Plan::new(3, 40);
    let number = plan.showing(200);
    plan.publications[number].image[96..156].fill(0);
    let ours = [BaseInvalid, BaseHidden, BaseMixed, BaseChanged, BaseMissed];
    let of_base = |log: &Log| kinds(log).into_iter().filter(|kind| ours.contains(kind)).collect::<Vec<_>>();
    let mut log = plan.log();
    assert_eq!(of_base(&log), [BaseInvalid]);
    for event in &mut log.events {
        if let What::Arrived { profile, shown } = &mut event.what
            && profile[64..124] == [0; 60]
        {
            *shown = 0b1101;
        }
    }
    assert_eq!(of_base(&log), []);
}

#[test]
fn a_valid_object_that_is_not_shown_is_a_violation() {
    for gps in [1, 5] {
        let (plan, log, place) = forwarding(gps);
        for index in 0..plan.layout.objects() {
            let mut log = log.clone();
            *arrived(&mut log, place + 1).1 &= !(1 << index);
            assert_eq!(found(&log), [(BaseHidden, 1)], "{index}");
        }
    }
}

#[test]
fn objects_of_two_cycles_shown_as_one_are_a_violation() {
    let (_, log, place) = forwarding(3);
    let mixed = |log: &mut Log, place: usize, index: usize| {
        let (arrived, _) = arrived(log, place);
        let range = if index == 0 { 0..64 } else { index * 60 + 4..index * 60 + 64 };
        let other = profile(3, 150)[range.clone()].to_vec();
        arrived[range].copy_from_slice(&other);
    };
    for index in 0..4 {
        let mut log = log.clone();
        mixed(&mut log, place + 1, index);
        assert_eq!(found(&log), [(BaseMixed, 1)], "{index}");
        *arrived(&mut log, place + 1).1 &= !(1 << index);
        assert_eq!(found(&log), [(BaseChanged, 1)], "{index}");
    }
}

#[test]
fn a_torn_read_that_is_forwarded_and_shown_is_one_violation() {
    let (_, log, place) = forwarding(3);
    let mut log = log;
    let read = log.events[..place].iter().rposition(|event| matches!(event.what, What::Transaction { .. })).unwrap();
    let other = profile(3, 150);
    miso(&mut log, read)[96..156].copy_from_slice(&other[64..124]);
    for event in &mut log.events[place..=place + 1] {
        match &mut event.what {
            What::Forwarded { profile } | What::Arrived { profile, .. } => {
                profile.0[64..124].copy_from_slice(&other[64..124]);
            }
            _ => {}
        }
    }
    assert_eq!(kinds(&log), [Torn]);
    *arrived(&mut log, place + 1).1 = 0b0001;
    assert_eq!(kinds(&log), [Torn]);
}

fn not_forwarded(log: &Log) -> Vec<(u64, u64)> {
    let found = bench_judge::judge(log).violations.into_iter();
    found.filter(|it| it.violation == NotForwarded).map(|it| (it.count, it.first_at)).collect()
}

#[test]
fn a_new_profile_must_be_forwarded_when_it_is_read() {
    let log = Plan::new(3, 40).log();
    // The chosen profile differs from the one that was forwarded before it.
    let of = |place: usize| match &log.events[place].what {
        What::Forwarded { profile } => Some(profile),
        _ => None,
    };
    let places: Vec<usize> = (0..log.events.len()).filter(|place| of(*place).is_some()).collect();
    let place = places.windows(2).filter(|pair| of(pair[0]) != of(pair[1])).nth(9).unwrap()[1];
    let mut kept = log.clone();
    kept.events.drain(place..=place + 1);
    assert_eq!(not_forwarded(&kept), [(1, log.events[place].at)]);
    assert_eq!(not_forwarded(&log), []);
    let at = log.events[place].at;
    let mut late = log;
    late.events[place].at += 1;
    late.events[place + 1].at += 1;
    sort(&mut late);
    assert_eq!(not_forwarded(&late), [(1, at)]);
    insert(&mut kept, 1, injected(MISUSE, u64::MAX));
    assert_eq!(not_forwarded(&kept), []);
}
