//! What a tick makes of what the receivers said.

mod ubx;

use horus_tx_fw::{
    cycle::{timestamp, Cycle},
    receiver::{Receiver, Solution},
    transmitter::Ticket,
};
use profile::{Freshness, GpsObject, GpsValues, HorusState, Identifier, Profile, ReportedPosition, ReportedValues};
use proptest::prelude::*;
use ubx::{esf_ins, nav_att, NavPvt};

fn heard(messages: &[Vec<u8>], now: u32) -> Solution {
    let mut receiver = Receiver::new();
    for byte in messages.concat() {
        receiver.receive(&[byte], now);
    }
    *receiver.solution()
}

fn read<const N: usize>(profile: &Profile<N>) -> (ReportedValues, [GpsValues; N]) {
    let reading = profile.verify();
    assert!(reading.complete(), "every object is sealed and in its place");
    (
        reading.reported.map(ReportedPosition::values).expect("complete"),
        reading.gps.map(|object| object.map(GpsObject::values).expect("complete")),
    )
}

/// Every value is the design's NaN, bit for bit.
fn assert_absent(values: &GpsValues, timestamp: u32) {
    let absent = GpsValues { status: values.status, ..GpsValues::absent(timestamp) };
    let sealed = |values| *GpsObject::seal(Identifier::gps(1), values).as_bytes();
    assert_eq!(sealed(values), sealed(&absent));
}

fn all(now: u32) -> Solution {
    heard(
        &[NavPvt::GOOD.bytes(), nav_att(1_000, [100, 200, 300], [1, 1, 1]), esf_ins(1_000, [true; 3], [1, 2, 3])],
        now,
    )
}

#[test]
fn every_tick_is_ten_milliseconds_after_the_one_before_it() {
    let mut previous = timestamp(0);
    assert_eq!(previous, 0);
    let near_the_wrap = u32::MAX / 10 - 3;
    for tick in (1..1_000).chain(near_the_wrap..near_the_wrap + 10).chain(u32::MAX - 3..=u32::MAX) {
        if tick == near_the_wrap || tick == u32::MAX - 3 {
            previous = timestamp(tick - 1);
        }
        let now = timestamp(tick);
        assert_eq!(profile::freshness(Some(previous), now), Freshness::Fresh { missed: 0 });
        previous = now;
    }
    assert_eq!(timestamp(0).wrapping_sub(timestamp(u32::MAX)), 10, "where the ticks wrap, too");
}

#[test]
fn a_silent_receiver_is_absent_from_its_object() {
    let (reported, [gps]) = read(&Cycle::new().fill(7, &[Solution::default()]));
    assert_absent(&gps, 70);
    assert_eq!(gps.status.bits(), 1 << 8, "nothing but: older than its period allows");
    assert_eq!(reported.status.state(), Some(HorusState::Starting));
    assert!(reported.status.degraded() && !reported.status.position_valid());
    assert_eq!(reported.status.receivers_agreeing(), 0);
}

#[test]
fn reported_position_is_gps1_and_says_that_it_stands_alone() {
    let other = heard(&[NavPvt { latitude: 1, longitude: 2, ..NavPvt::GOOD }.bytes()], 70);
    let (reported, gps) = read(&Cycle::new().fill(7, &[all(70), other, other]));
    assert_eq!(reported.timestamp, 70);
    assert!(gps.iter().all(|gps| gps.timestamp == 70));
    assert_eq!(reported.latitude.to_bits(), gps[0].latitude.to_bits());
    assert_eq!(reported.longitude.to_bits(), 8.729_123_4f64.to_bits());
    assert_eq!(reported.altitude, 512.345);
    assert_eq!(reported.acceleration, [0.01, 0.02, 0.03]);
    // One agrees, position, attitude and acceleration valid, degraded, monitoring.
    assert_eq!(reported.status.bits(), 0b001_0111_1001 & 0x7F | 1 << 8);
    // 3D fix, position, attitude, acceleration, heard.
    assert_eq!(gps[0].status.bits(), 0xF3);
    assert_eq!(gps[1].status.bits(), 0x93);
}

#[test]
fn one_receiver_of_one_is_not_degraded() {
    let (reported, _) = read(&Cycle::new().fill(7, &[all(70)]));
    assert!(!reported.status.degraded());
    assert_eq!(reported.status.receivers_agreeing(), 1);
}

#[test]
fn horus_goes_on_monitoring_when_its_position_is_lost() {
    let mut cycle = Cycle::new();
    let state = |cycle: &mut Cycle, tick, solution| read(&cycle.fill(tick, &[solution])).0.status;
    assert_eq!(state(&mut cycle, 1, Solution::default()).state(), Some(HorusState::Starting));
    assert_eq!(state(&mut cycle, 2, all(20)).state(), Some(HorusState::Monitoring));
    let lost = state(&mut cycle, 3, Solution::default());
    assert_eq!(lost.state(), Some(HorusState::Monitoring));
    assert!(!lost.position_valid());
}

#[test]
fn a_solution_goes_stale_and_then_is_withdrawn() {
    let solution = all(0);
    let status = |tick| read(&Cycle::new().fill(tick, &[solution])).1[0].status;
    // The period is not known yet: one second is assumed.
    assert!(status(25).heard() && !status(26).heard(), "250 ms");
    assert!(!status(152).stale() && status(153).stale(), "1.5 periods and 20 ms");
    assert!(status(302).position_valid() && !status(303).position_valid(), "3 periods and 20 ms");
    assert!(status(302).attitude_valid() && !status(303).attitude_valid());
    assert!(status(302).acceleration_valid() && !status(303).acceleration_valid());
    let withdrawn = read(&Cycle::new().fill(303, &[solution])).1[0];
    assert_absent(&withdrawn, 3_030);
    assert_eq!(withdrawn.status.bits(), 1 << 8);
}

#[test]
fn a_message_that_came_between_the_tick_and_its_cycle_is_not_old() {
    let (_, [gps]) = read(&Cycle::new().fill(7, &[all(75)]));
    assert!(gps.status.heard() && gps.status.position_valid() && !gps.status.stale());
}

proptest! {
    #[test]
    fn a_set_bit_and_a_number_always_go_together(
        fix in 0u8..8,
        flags in 0u8..2,
        latitude in any::<i32>(),
        accuracies in any::<[bool; 3]>(),
        axes in any::<[bool; 3]>(),
        age in 0u32..400,
    ) {
        let solution = heard(
            &[
                NavPvt { fix, flags, latitude, ..NavPvt::GOOD }.bytes(),
                nav_att(1_000, [1, 2, 3], accuracies.map(u32::from)),
                esf_ins(1_000, axes, [1, 2, 3]),
            ],
            0,
        );
        let (reported, gps) = read(&Cycle::new().fill(age, &[solution; 5]));
        for gps in gps {
            prop_assert_eq!(gps.status.position_valid(), gps.latitude.is_finite());
            prop_assert_eq!(gps.status.position_valid(), gps.longitude.is_finite());
            prop_assert_eq!(gps.status.position_valid(), gps.altitude.is_finite());
            let angles = [gps.pitch, gps.yaw, gps.roll];
            prop_assert_eq!(gps.status.attitude_valid(), angles.iter().all(|angle| angle.is_finite()));
            prop_assert_eq!(gps.status.acceleration_valid(), gps.acceleration.iter().all(|axis| axis.is_finite()));
        }
        prop_assert_eq!(reported.status.position_valid(), gps[0].status.position_valid());
        prop_assert_eq!(reported.status.receivers_agreeing(), u8::from(gps[0].status.position_valid()));
    }

    #[test]
    fn a_ticket_is_good_for_its_own_slot_alone(tick in any::<u32>(), frame in 0usize..2, other in any::<u32>(), slot in 0usize..2) {
        let ticket = Ticket::new(tick, frame, 0xC4);
        prop_assert_eq!(ticket.due(tick, frame), Some(0xC4));
        if (tick as u16, frame) != (other as u16, slot) {
            prop_assert_eq!(ticket.due(other, slot), None);
        }
        prop_assert_eq!(Ticket::NONE.due(tick, frame), None);
        prop_assert_eq!(Ticket::from_word(ticket.word()), ticket);
    }
}
