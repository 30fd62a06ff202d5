use profile::criticality::{BaseStation, Dpr, Writer};
use profile::{
    FixType, GpsObject, GpsStatus, Identifier, LinkStatusBits, Profile, ReportedStatus, ResetReason, UplinkValues,
};
use proptest::prelude::*;

use super::*;

const CYCLE: u64 = 10_000;

fn gps(timestamp: u32, longitude: f64) -> GpsValues {
    GpsValues {
        status: GpsStatus::new()
            .with_fix_type(FixType::Fix3D)
            .with_position_valid(true)
            .with_heard(true)
            .with_solution_age_ms(Some(80)),
        latitude: -47.497_9,
        longitude,
        altitude: 470.125,
        ..GpsValues::absent(timestamp)
    }
}

fn status() -> ReportedStatus {
    ReportedStatus::new()
        .with_position_valid(true)
        .with_attitude_valid(true)
        .with_receivers_agreeing(3)
        .with_state(HorusState::Monitoring)
}

fn profile_with(timestamp: u32, status: ReportedStatus) -> Profile<3> {
    let reported = ReportedValues {
        status,
        latitude: -47.497_9,
        longitude: 8.728_9,
        altitude: 470.125,
        pitch: -0.1,
        roll: 0.05,
        yaw: -1.0,
        ..ReportedValues::absent(timestamp)
    };
    let silent = GpsValues::absent(timestamp);
    Profile::seal(&reported, &[gps(timestamp, 8.728_9), gps(timestamp, f64::from(87_289_001) / 1e7), silent])
}

fn profile(timestamp: u32) -> Profile<3> {
    profile_with(timestamp, status())
}

fn take(drone: &mut Drone, at_us: u64, bytes: &[u8]) -> Vec<Verdict> {
    drone.take_bundle(at_us, &Bundle::datagram(bytes).unwrap())
}

fn codes(drone: &mut Drone, now_us: u64) -> Vec<&'static str> {
    drone.tick(now_us);
    drone.raised().map(|raised| raised.alarm.code()).collect()
}

fn link(timestamp: u32, status: LinkStatusBits) -> LinkStatus {
    LinkStatus::seal(&LinkValues { timestamp, status, ..LinkValues::default() })
}

#[test]
fn what_was_sealed_is_held_to_the_last_bit() {
    let mut drone = Drone::new(0);
    for cycle in 0..3_u32 {
        let verdicts = take(&mut drone, u64::from(cycle) * CYCLE, profile(cycle * 10).as_bytes());
        assert_eq!(verdicts, [Verdict::New; 4]);
    }
    let held = drone.gps(2).unwrap();
    assert_eq!((held.timestamp, held.arrived_us, held.age_us(25_000)), (20, 20_000, 5_000));
    assert_eq!(held.values.longitude.to_bits(), 8.728_900_1_f64.to_bits());
    assert_eq!(held.values.latitude.to_bits(), (-47.497_9_f64).to_bits());
    assert!(drone.gps(3).unwrap().values.latitude.is_nan());
    assert_eq!(drone.reported().unwrap().values.altitude.to_bits(), 470.125_f64.to_bits());
    assert!(drone.gps(0).is_none() && drone.gps(4).is_none() && drone.gps(9).is_none());
    assert_eq!(drone.counts(), Counts { messages: 3, new: 12, ..Counts::default() });
    assert_eq!(drone.receivers(), 3);
}

#[test]
fn each_verdict_has_a_name_of_its_own() {
    let rejections = [Rejection::Length, Rejection::Crc, Rejection::PositionCrc, Rejection::Identifier];
    let verdicts =
        [Verdict::New, Verdict::Duplicate, Verdict::Older, Verdict::OutOfSequence, Verdict::Vacant].into_iter();
    let names: Vec<_> = verdicts.chain(rejections.map(Verdict::Rejected)).map(Verdict::code).collect();
    assert_eq!(
        names,
        ["new", "duplicate", "older", "out-of-sequence", "vacant", "length", "crc", "position-crc", "identifier"]
    );
}

// Shows GND-2.
#[test]
fn any_damaged_bit_costs_its_object_and_no_other() {
    let good = profile(10);
    for bit in 0..Profile::<3>::SIZE * 8 {
        let mut drone = Drone::new(0);
        let mut bytes = good.as_bytes().to_vec();
        bytes[bit / 8] ^= 0x80 >> (bit % 8);
        let verdicts = take(&mut drone, 0, &bytes);
        let hit = [64, 124, 184, 244].iter().position(|end| bit / 8 < *end);
        for (object, verdict) in verdicts.into_iter().enumerate() {
            let expected = if Some(object) == hit { Verdict::Rejected(Rejection::Crc) } else { Verdict::New };
            assert_eq!(verdict, expected, "bit {bit}");
        }
        assert_eq!(drone.counts().bad_crc, 1);
        assert!(codes(&mut drone, 0).contains(&"damaged"));
    }
}

#[test]
fn vacant_misplaced_and_mixed_objects_are_told_apart() {
    let mut drone = Drone::new(0);
    let mut bytes = profile(10).as_bytes().to_vec();
    bytes[64..124].fill(0xff);
    assert_eq!(take(&mut drone, 0, &bytes)[..2], [Verdict::New, Verdict::Vacant]);

    let mut bytes = profile(20).as_bytes().to_vec();
    bytes.copy_within(124..184, 64);
    assert_eq!(take(&mut drone, 0, &bytes)[1], Verdict::Rejected(Rejection::Identifier));
    assert_eq!((drone.counts().misplaced, drone.counts().bad_crc, drone.counts().mixed), (1, 0, 0));

    let mut bytes = profile(30).as_bytes().to_vec();
    bytes[184..].copy_from_slice(GpsObject::seal(Identifier::GPS[2], &gps(20, 1.0)).as_bytes());
    take(&mut drone, 0, &bytes);
    assert_eq!(drone.counts().mixed, 1);

    // A message with an image of zeros is counted. Such a message has no object to show, so it is no sign of life.
    take(&mut drone, 5_000_000, &[0; 244]);
    assert_eq!((drone.counts().messages, drone.counts().vacant, drone.heard_us()), (4, 5, 0));
}

#[test]
fn an_older_object_fills_a_gap_and_replaces_nothing() {
    let mut drone = Drone::new(0);
    take(&mut drone, 0, profile(5_000).as_bytes());
    let mut without = profile(5_020).as_bytes().to_vec();
    without[64..124].fill(0);
    take(&mut drone, 2 * CYCLE, &without);
    let late = take(&mut drone, 5 * CYCLE, profile(5_010).as_bytes());
    assert_eq!(late, [Verdict::Older, Verdict::New, Verdict::Older, Verdict::Older]);
    assert_eq!((drone.reported().unwrap().timestamp, drone.gps(1).unwrap().timestamp), (5_020, 5_010));
    assert_eq!(drone.gps(1).unwrap().age_us(5 * CYCLE), 40_000 - 6, "it is as old as it is");
    assert_eq!(take(&mut drone, 6 * CYCLE, profile(5_010).as_bytes())[1], Verdict::Duplicate);
    assert_eq!(drone.gps(1).unwrap().arrived_us, 5 * CYCLE);
}

#[test]
fn a_sample_that_the_carrier_held_back_is_old_when_it_arrives() {
    let mut drone = Drone::new(0);
    take(&mut drone, 0, profile(5_000).as_bytes());
    take(&mut drone, 1_500_000, profile(5_100).as_bytes());
    assert!((1_399_000..=1_400_000).contains(&drone.reported().unwrap().age_us(1_500_000)));
    assert_eq!(codes(&mut drone, 1_500_000), ["stale", "receivers-old"]);
}

#[test]
fn a_restarted_horus_is_shown_from_its_third_cycle_on() {
    let mut drone = Drone::new(0);
    take(&mut drone, 0, profile(100_000).as_bytes());
    for (cycle, expected) in [Verdict::OutOfSequence, Verdict::OutOfSequence, Verdict::New].into_iter().enumerate() {
        let at = 500_000 + cycle as u64 * CYCLE;
        let mut bytes = profile(30 + 10 * cycle as u32).as_bytes().to_vec();
        bytes[184..].fill(0);
        assert_eq!(take(&mut drone, at, &bytes)[..3], [expected; 3]);
        assert!(codes(&mut drone, at).contains(&"out-of-sequence"));
    }
    assert_eq!((drone.timestamp(), drone.counts().restarts), (Some(50), 1));
    assert!(drone.gps(3).is_none(), "of the HORUS that does not run any more");
    assert_eq!(codes(&mut drone, 900_000), ["out-of-sequence", "restarted"]);
    assert!(!codes(&mut drone, 520_000 + RECENT_US + 1).contains(&"restarted"));
}

#[test]
fn a_new_reset_reason_is_a_restart_even_if_timestamps_go_on() {
    let again = status().with_reset_reason(ResetReason::Watchdog);
    let taken = |status: ReportedStatus, first: std::ops::Range<usize>| {
        let mut drone = Drone::new(0);
        (1..=27).for_each(|cycle| drop(take(&mut drone, u64::from(cycle) * CYCLE, profile(10 * cycle).as_bytes())));
        let (at, sent) = (1_270_000, profile_with(280, status));
        if !first.is_empty() {
            drone.take(Place::Gps(1), at, &sent.as_bytes()[first]);
        }
        let mut bytes = sent.as_bytes().to_vec();
        bytes[184..].fill(0);
        let verdicts = take(&mut drone, at, &bytes);
        assert_eq!(verdicts[0], Verdict::New);
        drone
    };
    for first in [0..0, 64..124] {
        let mut drone = taken(again, first);
        assert_eq!(drone.reported().unwrap().age_us(1_270_000), 0);
        assert_eq!((drone.counts().restarts, drone.gps(3)), (1, None), "what was before is forgotten");
        assert_eq!(codes(&mut drone, 1_270_000), ["restarted", "horus-unasked-reset"]);
    }
    let drone = taken(status(), 0..0);
    assert!((989_000..=990_000).contains(&drone.reported().unwrap().age_us(1_270_000)));
    assert_eq!(drone.counts().restarts, 0);
}

#[test]
fn a_late_message_from_before_a_restart_is_older() {
    let mut drone = Drone::new(0);
    take(&mut drone, 0, profile(60_000).as_bytes());
    let again = status().with_reset_reason(ResetReason::Watchdog);
    take(&mut drone, 60_020_000, profile_with(60_020, again).as_bytes());
    assert_eq!(take(&mut drone, 60_030_000, profile(60_010).as_bytes())[0], Verdict::Older);
    assert_eq!((drone.timestamp(), drone.counts().restarts), (Some(60_020), 1));
}

#[test]
fn alarms_come_with_the_time_and_go_with_newer_data() {
    let mut drone = Drone::new(0);
    assert_eq!(codes(&mut drone, 0), ["stale"], "nothing was received yet");
    take(&mut drone, 1_000, profile(10).as_bytes());
    assert_eq!(codes(&mut drone, 1_000), [""; 0]);
    assert_eq!(codes(&mut drone, 1_000 + STALE_US), [""; 0]);
    assert_eq!(codes(&mut drone, 1_001 + STALE_US), ["stale"]);
    assert_eq!(codes(&mut drone, 1_000 + SILENT_US), ["stale"]);
    assert_eq!(codes(&mut drone, 1_001 + SILENT_US), ["silent", "stale"]);
    let since: Vec<_> = drone.raised().map(|raised| raised.since_us).collect();
    assert_eq!(since, [1_001 + SILENT_US, 1_001 + STALE_US]);
    take(&mut drone, 2_001_000, profile(2_010).as_bytes());
    let went = drone.tick(2_001_000);
    assert_eq!(
        went.iter().map(|change| (change.alarm, change.raised)).collect::<Vec<_>>(),
        [(Alarm::Silent, false), (Alarm::Stale, false)]
    );
}

#[test]
fn what_horus_says_of_itself_is_an_alarm() {
    let says = |status: ReportedStatus| {
        let mut drone = Drone::new(0);
        take(&mut drone, 0, profile_with(10, status).as_bytes());
        codes(&mut drone, 0)
    };
    assert_eq!(says(status().with_state(HorusState::OutsideRange)), ["outside-range"]);
    assert_eq!(says(status().with_state(HorusState::SwitchedToRedundant)), ["switched-to-redundant"]);
    assert_eq!(says(status().with_state(HorusState::MotorsCut)), ["motors-cut"]);
    assert_eq!(says(status().with_state(HorusState::EmergencyFired)), ["emergency-fired"]);
    assert_eq!(says(status().with_state(HorusState::InputsContradict)), ["inputs-contradict"]);
    let lost = status().with_state(HorusState::PositionLost).with_position_valid(false);
    assert_eq!(says(lost), ["position-lost", "no-agreement"]);
    assert_eq!(says(status().with_memory_fault(true)), ["horus-memory-fault"]);
    for reason in [ResetReason::Watchdog, ResetReason::Lockup, ResetReason::BrownOutOrOther] {
        assert_eq!(says(status().with_reset_reason(reason)), ["horus-unasked-reset"], "{reason:?}");
    }
    for reason in [ResetReason::PowerOn, ResetReason::Pin, ResetReason::Software] {
        assert_eq!(says(status().with_reset_reason(reason)), [""; 0], "{reason:?}");
    }
    assert_eq!(says(status().with_degraded(true)), ["degraded"]);
    assert_eq!(says(status().with_position_valid(false)), ["no-agreement"]);
    assert_eq!(says(status().with_without_crystal(true)), ["no-crystal"]);
}

#[test]
fn an_impossible_position_is_an_alarm_and_not_shown() {
    let says = |change: fn(&mut ReportedValues)| {
        let mut drone = Drone::new(0);
        let reported =
            ReportedValues { status: status(), latitude: 47.0, longitude: 8.0, ..ReportedValues::absent(10) };
        let mut reported = ReportedValues { altitude: 470.0, ..reported };
        reported.status = reported.status.with_attitude_valid(false);
        change(&mut reported);
        take(&mut drone, 0, Profile::seal(&reported, &[gps(10, 8.0)]).as_bytes());
        let values = drone.reported().unwrap().values;
        assert_eq!(values.status.position_valid(), values.latitude.is_finite() && values.longitude.is_finite());
        assert!(values.status.position_valid() || values.altitude.is_nan());
        codes(&mut drone, 0)
    };
    assert_eq!(says(|_| {}), [""; 0]);
    assert_eq!(says(|reported| reported.altitude = f64::NAN), [""; 0], "a 2D fix");
    assert_eq!(says(|reported| reported.latitude = 91.0), ["implausible"]);
    assert_eq!(says(|reported| reported.longitude = 500.0), ["implausible"]);
    assert_eq!(says(|reported| reported.latitude = f64::NAN), ["implausible"]);
    assert_eq!(says(|reported| reported.altitude = 1e300), ["implausible"]);
    assert_eq!(says(|reported| reported.altitude = f64::NEG_INFINITY), ["implausible"]);
    let none = |reported: &mut ReportedValues| {
        (reported.latitude, reported.status) = (91.0, reported.status.with_position_valid(false));
    };
    assert_eq!(says(none), ["no-agreement"], "HORUS says itself that it is none");
    let mut drone = Drone::new(0);
    take(
        &mut drone,
        0,
        Profile::seal(
            &ReportedValues { status: status(), latitude: 47.0, longitude: 8.0, ..ReportedValues::absent(10) },
            &[gps(10, 181.0)],
        )
        .as_bytes(),
    );
    assert!(codes(&mut drone, 0).contains(&"receiver-implausible"));
    assert!(!drone.gps(1).unwrap().values.status.position_valid());
}

#[test]
fn a_state_that_has_no_name_is_an_alarm() {
    let mut drone = Drone::new(0);
    assert!(!codes(&mut drone, 0).contains(&"unknown-state"));
    let unnamed = ReportedStatus::from_bits(status().bits() | 0x0F00);
    take(&mut drone, 0, profile_with(10, unnamed).as_bytes());
    assert_eq!(codes(&mut drone, 0), ["unknown-state"]);
}

#[test]
fn every_value_has_an_age_and_an_alarm_of_its_own() {
    let mut drone = Drone::new(0);
    let bytes = [link(7, LinkStatusBits::new().with_link_up(true)).as_bytes(), profile(10).as_bytes()].concat();
    take(&mut drone, 0, &bytes);
    for cycle in 1..=250_u32 {
        let at = CYCLE * u64::from(cycle);
        drone.take(Place::Reported, at, &profile(10 + 10 * cycle).as_bytes()[..64]);
        let expected: &[&str] = if at <= OLD_US { &[] } else { &["receivers-old", "link-status-old"] };
        assert_eq!(codes(&mut drone, at), expected, "{at}");
    }
    let at = 251 * CYCLE;
    take(&mut drone, at, &profile(2_520).as_bytes()[..184]);
    assert_eq!(codes(&mut drone, at), ["receivers-old", "link-status-old"]);
    take(&mut drone, at + CYCLE, profile(2_530).as_bytes());
    assert_eq!(codes(&mut drone, at + CYCLE), ["link-status-old"]);
    assert!(!codes(&mut drone, at + 2 * SILENT_US).contains(&"receivers-old"), "silent says it all");
}

#[test]
fn what_is_not_believed_is_no_sign_of_life() {
    let mut drone = Drone::new(0);
    take(&mut drone, 0, profile(70_000).as_bytes());
    take(&mut drone, SILENT_US + 1, profile(5).as_bytes());
    assert!(codes(&mut drone, SILENT_US + 1).contains(&"silent"));
}

#[test]
fn what_the_dpr_says_is_an_alarm() {
    let says = |bits: LinkStatusBits| {
        let mut drone = Drone::new(0);
        let bytes = [link(7, bits).as_bytes().as_slice(), profile(10).as_bytes()].concat();
        take(&mut drone, 0, &bytes);
        codes(&mut drone, 0)
    };
    let up = LinkStatusBits::new().with_link_up(true).with_all_accepted(true);
    assert_eq!(says(up), [""; 0]);
    assert_eq!(says(up.with_link_up(false)), ["link-down"]);
    assert_eq!(says(up.with_link_up(false).with_no_field(true)), ["link-down", "no-field"]);
    assert_eq!(says(up.with_horus_frozen(true)), ["frozen"]);
    assert_eq!(says(up.with_horus_restarted(true)), ["restarted"]);
    assert_eq!(says(up.with_ram_fault(true)), ["ram-fault"]);
    assert_eq!(says(up.with_front_end_fault(true)), ["front-end-fault"]);
    assert_eq!(says(up.with_reset_reason(ResetReason::Watchdog)), ["unasked-reset"]);
    assert_eq!(says(up.with_out_of_sequence(true)), ["out-of-sequence"]);
    assert_eq!(says(up.with_horus_clock_implausible(true)), ["clock-implausible"]);
    assert_eq!(says(up.with_flash_fault(true)), ["flash-fault"]);
}

#[test]
fn a_sample_that_keeps_arriving_is_frozen_and_a_duplicate_is_not() {
    let mut drone = Drone::new(0);
    let at = |repeat: u64| 100_000_000 + repeat * CYCLE;
    for repeat in 0..100_u64 {
        take(&mut drone, at(repeat), profile(10).as_bytes());
        let frozen = codes(&mut drone, at(repeat)).contains(&"frozen");
        assert_eq!(frozen, repeat * CYCLE >= FROZEN_US + 3 * CYCLE, "{repeat}");
    }
    take(&mut drone, at(100), profile(20).as_bytes());
    assert!(!codes(&mut drone, at(100)).contains(&"frozen"));
}

#[test]
fn an_object_between_two_cycles_is_not_believed() {
    let mut drone = Drone::new(0);
    assert_eq!(take(&mut drone, 0, profile(70_000).as_bytes()), [Verdict::New; 4]);
    assert_eq!(take(&mut drone, 13_000, profile(70_013).as_bytes()), [Verdict::OutOfSequence; 4]);
    assert_eq!(drone.timestamp(), Some(70_000));
}

#[test]
fn link_status_has_a_clock_of_its_own() {
    let mut drone = Drone::new(0);
    let up = LinkStatusBits::new().with_link_up(true);
    let mut take = |at, timestamp, bits| drone.take(Place::LinkStatus, at, link(timestamp, bits).as_bytes());
    assert_eq!(take(0, 70_003, up), Verdict::New);
    assert_eq!(take(1_000, 70_003, up), Verdict::Duplicate);
    assert_eq!(take(2_000, 69_999, LinkStatusBits::new()), Verdict::Older);
    assert_eq!(take(7_000, 70_011, up), Verdict::New);
    let restart = [10, 21, 29].map(|timestamp| take(300_000, timestamp, up));
    assert_eq!(restart, [Verdict::OutOfSequence, Verdict::OutOfSequence, Verdict::New]);
    assert_eq!(drone.link().unwrap().timestamp, 29);
}

#[test]
fn the_newest_port_status_is_kept_whatever_arrives_after_it() {
    let port = |timestamp, uplinks_accepted| {
        let values = PortValues { timestamp, uplinks_accepted, ..PortValues::default() };
        *PortStatus::seal(Writer::<Dpr>::claim(), &values).as_bytes()
    };
    let uplink = |timestamp| {
        let values = UplinkValues { timestamp, ..UplinkValues::default() };
        *Uplink::seal(Writer::<BaseStation>::claim(), &values).as_bytes()
    };
    let mut drone = Drone::new(0);
    let mut at = 100_000_000;
    let mut take = |drone: &mut Drone, place, bytes: &[u8]| {
        at += 100_000;
        drone.take(place, at, bytes)
    };
    assert_eq!(take(&mut drone, Place::LinkStatus, link(5_000, LinkStatusBits::new()).as_bytes()), Verdict::New);
    assert_eq!(take(&mut drone, Place::PortStatus, &port(5_095, 3)), Verdict::New);
    let held = *drone.port_status().unwrap();
    assert_eq!((held.values.uplinks_accepted, held.timestamp), (3, 5_095));
    assert_eq!((drone.heard_us(), held.arrived_us), (100_200_000, 100_200_000));
    assert!((4_900..=5_000).contains(&held.late_us), "5 ms later than the fastest: {}", held.late_us);
    assert_eq!(take(&mut drone, Place::PortStatus, &port(5_098, 3)), Verdict::New, "by less than a cycle");
    assert_eq!(take(&mut drone, Place::PortStatus, &port(5_098, 3)), Verdict::Duplicate);
    assert_eq!(take(&mut drone, Place::PortStatus, &port(5_000, 9)), Verdict::Older);
    assert!(!drone.alarms_at(101_000_000).has(Alarm::TwoSenders));
    assert_eq!(take(&mut drone, Place::PortStatus, &port(5_098, 9)), Verdict::OutOfSequence, "with another content");
    assert!(drone.alarms_at(101_000_000).has(Alarm::TwoSenders));
    assert_eq!(drone.port_status().unwrap().values.uplinks_accepted, 3);

    let heard_us = drone.heard_us();
    for (timestamp, verdict) in [(9, Verdict::New), (9, Verdict::Duplicate), (7, Verdict::New), (9, Verdict::New)] {
        assert_eq!(take(&mut drone, Place::Uplink, &uplink(timestamp)), verdict);
        assert_eq!(drone.uplink().map(Uplink::timestamp), Some(timestamp));
    }
    assert_eq!(drone.heard_us(), heard_us);
    for timestamp in [10, 110, 210] {
        take(&mut drone, Place::LinkStatus, link(timestamp, LinkStatusBits::new()).as_bytes());
    }
    assert_eq!((drone.port_status(), drone.uplink()), (None, None));
    assert_eq!(take(&mut drone, Place::PortStatus, &port(305, 0)), Verdict::New);
}

#[test]
fn what_the_dpr_alone_says_fits_if_it_continues_what_it_said() {
    let mut drone = Drone::new(0);
    drone.take(Place::LinkStatus, 0, link(70_003, LinkStatusBits::new()).as_bytes());
    let fits = |at, timestamp| {
        let link = link(timestamp, LinkStatusBits::new());
        drone.fits(at, &Bundle::from_first(Place::LinkStatus, link.as_bytes()).unwrap())
    };
    assert_eq!([70_010, 70_103, 5].map(|timestamp| fits(100_000, timestamp)), [true, true, false]);
    assert!(drone.fits(0, &Bundle::from_first(Place::LinkStatus, &[0; 32]).unwrap()), "nothing contradicts it");
}

#[test]
fn a_message_between_two_cycles_fits_the_dpr_and_not_horus() {
    let mut drone = Drone::new(0);
    take(&mut drone, 0, profile(70_000).as_bytes());
    let fits = |drone: &Drone, timestamp| drone.fits(13_000, &Bundle::datagram(profile(timestamp).as_bytes()).unwrap());
    assert_eq!([70_010, 70_013].map(|timestamp| fits(&drone, timestamp)), [true, false]);
    let port = |timestamp| {
        let values = PortValues { timestamp, ..PortValues::default() };
        *PortStatus::seal(Writer::<Dpr>::claim(), &values).as_bytes()
    };
    drone.take(Place::PortStatus, 0, &port(5_000));
    let fits = |timestamp| drone.fits(13_000, &Bundle::new(Place::PortStatus, 1, &port(timestamp)).unwrap());
    assert_eq!([5_013, 5].map(fits), [true, false]);
}

#[test]
fn a_late_sample_fits_a_horus_without_its_crystal_for_longer() {
    let fits = |without_crystal| {
        let mut drone = Drone::new(0);
        let status = status().with_without_crystal(without_crystal);
        take(&mut drone, 0, profile_with(70_000, status).as_bytes());
        drone.fits(10_000_000, &Bundle::datagram(profile(69_900).as_bytes()).unwrap())
    };
    assert_eq!([false, true].map(fits), [false, true]);
}

#[test]
fn a_late_sample_tells_the_same_start_of_horus() {
    let mut drone = Drone::new(0);
    for tenth in 0..5 {
        take(&mut drone, 100_000 * u64::from(tenth), profile(70_000 + 100 * tenth).as_bytes());
    }
    take(&mut drone, 1_100_000, profile(70_500).as_bytes());
    let started = drone.started_us().unwrap();
    assert!((started + 70_000_000).abs() < 1_000, "{started}");
}

#[test]
fn a_reset_for_a_reason_that_has_no_name_is_no_alarm() {
    let mut drone = Drone::new(0);
    let status = ReportedStatus::from_bits(status().bits() | 0xE000);
    take(&mut drone, 0, profile_with(10, status).as_bytes());
    assert_eq!(drone.reported().unwrap().values.status.reset_reason(), None);
    assert!(!drone.alarms_at(0).has(Alarm::HorusUnaskedReset));
}

#[test]
fn a_clock_counts_as_a_crystals_where_nothing_else_is_said() {
    let (first, second) = (0, 10_100_000);
    let mut drone = Drone::new(0);
    for (at, timestamp) in [(first, 10), (second, 10_010)] {
        drone.take(Place::LinkStatus, at, link(timestamp, LinkStatusBits::new()).as_bytes());
        let object = GpsObject::seal(Identifier::gps(1), &gps(timestamp, 8.0));
        drone.take(Place::Gps(1), at, object.as_bytes());
    }
    let late = [drone.link().unwrap().late_us, drone.gps(1).unwrap().late_us];
    assert_eq!(late, [100_000 - 2_020; 2], "less 200 ppm of 10.1 s");
}

#[test]
fn a_person_can_read_it() {
    let mut drone = Drone::new(0);
    assert!(drone.words(0).starts_with("no profile received\n  Reported  not received\n"));
    let degraded = status().with_receivers_agreeing(2).with_degraded(true).with_reset_reason(ResetReason::Software);
    take(&mut drone, 0, profile_with(0, degraded).as_bytes());
    let faulty = status().with_memory_fault(true).with_reset_reason(ResetReason::Software);
    let mut bytes = profile_with(1_230, faulty.with_receivers_agreeing(2).with_degraded(true)).as_bytes().to_vec();
    bytes[130] ^= 1;
    take(&mut drone, 1_230_000, &bytes);
    let expected = "\
1.23 s after HORUS start
  Reported   47.4979000° S    8.7289000° E   470.125 m  pitch  -5.7° roll   2.9° yaw 302.7°  \
monitoring, 2 of 3 agree, degraded, MEMORY FAULT, last reset: software  0.01 s ago
  GPS1       47.4979000° S    8.7289000° E   470.125 m  solution: 75 ms  0.01 s ago
  GPS2       47.4979000° S    8.7289001° E   470.125 m  solution: 75 ms  1.24 s ago
  GPS3      no position  silent  solution: none yet  0.01 s ago
  ALARM     HORUS has found a fault of its memory
  ALARM     what is shown of the receivers is old
  ALARM     fewer receivers agree than the drone has, or on no altitude
  ALARM     damaged data arrived and were rejected
  2 profiles, 122 cycles missed, 1 bad CRC, 0 misplaced, 0 vacant";
    assert_eq!(drone.words(1_240_000), expected);
}

#[derive(Clone, Debug)]
struct Fate {
    copies: u8,
    delays: [u8; 3],
    flips: Option<u16>,
}

fn fate() -> impl Strategy<Value = Fate> {
    let flips = prop_oneof![3 => Just(None), 1 => (0..8 * 244_u16).prop_map(Some)];
    (0..4_u8, [0..90_u8, 0..90, 0..90], flips).prop_map(|(copies, delays, flips)| Fate { copies, delays, flips })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]

    #[test]
    fn loss_duplicates_reordering_and_damage_change_nothing(fates in prop::collection::vec(fate(), 1..150)) {
        // HORUS has been running for so long that a delayed message cannot be mistaken for a restart.
        let start = 600_000;
        let mut arrivals = vec![];
        for (cycle, fate) in fates.iter().enumerate() {
            let timestamp = start + 10 * cycle as u32;
            let mut bytes = profile(timestamp).as_bytes().to_vec();
            if let Some(bit) = fate.flips {
                bytes[usize::from(bit / 8)] ^= 1 << (bit % 8);
            }
            for delay in fate.delays.iter().take(usize::from(fate.copies)) {
                arrivals.push((CYCLE * (cycle as u64 + u64::from(*delay)), timestamp, fate.flips, bytes.clone()));
            }
        }
        arrivals.sort_by_key(|arrival| arrival.0);
        let mut drone = Drone::new(0);
        let mut newest = [None; 4];
        for (at, timestamp, flips, bytes) in arrivals {
            take(&mut drone, at, &bytes);
            let hit = flips.map(|bit| [64, 124, 184, 244].iter().position(|end| bit / 8 < *end).unwrap());
            for (_, newest) in newest.iter_mut().enumerate().filter(|(object, _)| Some(*object) != hit) {
                *newest = (*newest).max(Some(timestamp));
            }
            let shown = [
                drone.reported().map(|held| held.timestamp),
                drone.gps(1).map(|held| held.timestamp),
                drone.gps(2).map(|held| held.timestamp),
                drone.gps(3).map(|held| held.timestamp),
            ];
            prop_assert_eq!(shown, newest);
            prop_assert_eq!(drone.counts().out_of_sequence, 0);
        }
    }

    #[test]
    fn anything_may_arrive(messages in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..400), 0..20)) {
        let mut drone = Drone::new(0);
        for (at, bytes) in messages.iter().enumerate() {
            for place in Place::ALL {
                let verdict = drone.take(place, at as u64, bytes);
                prop_assert!(!verdict.is_intact());
            }
        }
        prop_assert!(drone.words(0).starts_with("no profile received"));
    }
}
