//! Tests how a tick makes objects of what the receivers have sent.

use crate::ubx;

use horus_tx_fw::{
    clock::Source,
    cycle::{Cycle, Start},
    receiver::{Receiver, Solution},
    state_inputs::{Levels, INPUTS, SAMPLES_TO_TAKE},
    timing::timestamp,
    transmitter::Ticket,
};
use profile::{
    Freshness, GpsObject, GpsStatus, GpsValues, HorusState, Identifier, Profile, ReportedPosition, ReportedStatus,
    ReportedValues, ResetReason,
};
use proptest::prelude::*;
use ubx::{esf_ins, nav_att, NavPvt};

const INACTIVE: Levels = Levels { active: false, inactive: true };

trait Tick<const N: usize> {
    /// Votes for a tick and fills its profile from `solutions`. The inputs of HORUS's state are inactive and have
    /// settled.
    fn voted_and_filled(&mut self, tick: u32, solutions: &[Solution; N]) -> Profile<N>;
}

impl<const N: usize> Tick<N> for Cycle<N> {
    fn voted_and_filled(&mut self, tick: u32, solutions: &[Solution; N]) -> Profile<N> {
        (0..SAMPLES_TO_TAKE).for_each(|_| self.sample([INACTIVE; INPUTS]));
        self.vote(tick, solutions);
        self.fill(tick, solutions)
    }
}

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
    let (reported, [gps]) = read(&Cycle::new().voted_and_filled(7, &[Solution::default()]));
    assert_absent(&gps, 70);
    assert_eq!(gps.status.bits(), 63 << 10 | 1 << 8, "nothing but: older than its period allows, and never");
    assert_eq!(reported.status.state(), Some(HorusState::Starting));
    assert!(reported.status.degraded() && !reported.status.position_valid());
    assert_eq!(reported.status.receivers_agreeing(), 0);
}

#[test]
fn reported_position_is_the_majoritys_and_the_outvoted_is_excluded() {
    let elsewhere = heard(&[NavPvt { latitude: 1, longitude: 2, ..NavPvt::GOOD }.bytes()], 70);
    let (reported, gps) = read(&Cycle::new().voted_and_filled(7, &[elsewhere, all(70), all(70)]));
    assert_eq!(reported.timestamp, 70);
    assert!(gps.iter().all(|gps| gps.timestamp == 70));
    assert_eq!(reported.latitude.to_bits(), 47.498_765_4f64.to_bits());
    assert_eq!(reported.longitude.to_bits(), 8.729_123_4f64.to_bits());
    assert_eq!(reported.altitude, 512.345);
    assert_eq!(reported.acceleration, [0.01, 0.02, 0.03]);
    assert_eq!([reported.pitch, reported.yaw, reported.roll], [gps[1].pitch, gps[1].yaw, gps[1].roll]);
    assert_eq!(reported.status.bits(), 0b0111_1010 | 1 << 8);
    assert_eq!(gps[0].status.bits(), 0x0293);
    assert_eq!(gps[0].latitude, 1e-7);
    assert_eq!(gps[1].status.bits(), 0xF3);
}

#[test]
fn one_receiver_of_three_gives_no_position() {
    let other = heard(&[NavPvt { longitude: 87_291_334, ..NavPvt::GOOD }.bytes()], 70);
    let (reported, gps) = read(&Cycle::new().voted_and_filled(7, &[all(70), other, other]));
    assert_eq!(reported.status.receivers_agreeing(), 3);
    assert!(!reported.status.degraded());
    assert!((reported.longitude - 8.729_133_4).abs() < 1e-9);
    assert!(gps.iter().all(|gps| !gps.status.excluded()));

    let (reported, gps) = read(&Cycle::new().voted_and_filled(7, &[all(70), Solution::default(), Solution::default()]));
    assert!(gps[0].status.position_valid() && !gps[0].status.excluded());
    assert_eq!(reported.status.bits(), 1 << 6, "degraded, starting, nothing valid");
    let absent = ReportedValues { status: reported.status, ..ReportedValues::absent(70) };
    assert_eq!(ReportedPosition::seal(&reported).as_bytes(), ReportedPosition::seal(&absent).as_bytes());
}

#[test]
fn a_position_is_brought_to_the_tick_by_its_velocity() {
    let moving = NavPvt { velocity: [10_000, 0, -2_000], ..NavPvt::GOOD };
    // At the tick the receiver's position is 110 ms old: 60 ms since its arrival, and the latency of 50 ms. So it is
    // moved 1.1 m north and 0.22 m up.
    let (reported, [gps]) = read(&Cycle::new().voted_and_filled(7, &[heard(&[moving.bytes()], 10)]));
    assert_eq!(gps.latitude, 47.498_765_4);
    assert!(((reported.latitude - gps.latitude) * 111_180.0 - 1.1).abs() < 1e-3);
    assert!((reported.altitude - 512.565).abs() < 1e-3);
    assert_eq!(reported.longitude, gps.longitude);
}

#[test]
fn a_vote_is_shown_at_its_own_tick_alone() {
    let mut cycle = Cycle::new();
    let shown = |profile: Profile<1>| read(&profile).0.status;
    assert!(!shown(cycle.fill(6, &[all(60)])).position_valid(), "before the first vote");
    (0..SAMPLES_TO_TAKE).for_each(|_| cycle.sample([INACTIVE; INPUTS]));
    cycle.vote(7, &[all(60)]);
    let silent = [Solution::default()];
    assert!(shown(cycle.fill(7, &silent)).position_valid(), "of what was said until the vote");
    assert!(!shown(cycle.fill(8, &[all(60)])).position_valid(), "a tick later");
    assert_eq!(shown(cycle.fill(8, &silent)).state(), Some(HorusState::PositionLost));
}

#[test]
fn an_attitude_that_lacks_an_angle_is_absent_from_reported_position() {
    let partial = heard(&[NavPvt::GOOD.bytes(), nav_att(1_000, [100, 200, 300], [1, 0, 1])], 70);
    let (reported, [gps]) = read(&Cycle::new().voted_and_filled(7, &[partial]));
    assert!(gps.roll.is_finite() && gps.pitch.is_nan());
    assert!(!reported.status.attitude_valid());
    assert!([reported.pitch, reported.yaw, reported.roll].iter().all(|angle| angle.is_nan()));
}

#[test]
fn without_a_majority_of_altitudes_horus_is_degraded() {
    let fix = |fix| heard(&[NavPvt { fix, ..NavPvt::GOOD }.bytes()], 70);
    let of = |solutions: &[Solution; 3]| read(&Cycle::new().voted_and_filled(7, solutions)).0;
    let reported = of(&[fix(2), fix(3), fix(2)]);
    assert_eq!((reported.status.receivers_agreeing(), reported.status.position_valid()), (3, true));
    assert!(reported.status.degraded());
    assert_eq!(reported.altitude.to_bits(), profile::ABSENT_F64.to_bits());
    let reported = of(&[fix(3), fix(3), fix(2)]);
    assert!(!reported.status.degraded());
    assert_eq!(reported.altitude, 512.345);
    let (alone, _) = read(&Cycle::new().voted_and_filled(7, &[fix(2)]));
    assert!(alone.status.degraded() && alone.status.position_valid() && alone.altitude.is_nan());
}

#[test]
fn an_attitude_of_one_of_three_is_absent_from_reported_position() {
    let bare = heard(&[NavPvt::GOOD.bytes()], 70);
    let (reported, _) = read(&Cycle::new().voted_and_filled(7, &[all(70), bare, bare]));
    assert!(!reported.status.attitude_valid() && !reported.status.acceleration_valid());
    let values = [[reported.pitch, reported.yaw, reported.roll], reported.acceleration].concat();
    assert!(values.iter().all(|value| value.to_bits() == profile::ABSENT_F32.to_bits()));
}

#[test]
fn a_jump_of_the_position_is_reported_a_second_later() {
    let mut cycle = Cycle::new();
    let far = NavPvt { latitude: NavPvt::GOOD.latitude + 100_000, ..NavPvt::GOOD };
    let mut reported = |tick: u32, message: NavPvt| {
        let solution = heard(&[message.bytes()], timestamp(tick));
        read(&cycle.voted_and_filled(tick, &[solution])).0
    };
    assert!(reported(1, NavPvt::GOOD).status.position_valid());
    for tick in 2..102 {
        let held = reported(tick, far);
        assert!(!held.status.position_valid() && held.status.degraded(), "tick {tick}");
        assert_eq!((held.status.receivers_agreeing(), held.latitude.is_nan()), (0, true));
    }
    assert!((reported(102, far).latitude - 47.508_765_4).abs() < 1e-9);
}

#[test]
fn one_receiver_of_one_is_not_degraded() {
    let (reported, _) = read(&Cycle::new().voted_and_filled(7, &[all(70)]));
    assert!(!reported.status.degraded());
    assert_eq!(reported.status.receivers_agreeing(), 1);
}

#[test]
fn horus_monitors_only_while_it_has_a_position() {
    let mut cycle = Cycle::new();
    let state = |cycle: &mut Cycle<1>, tick, solution| read(&cycle.voted_and_filled(tick, &[solution])).0.status;
    assert_eq!(state(&mut cycle, 1, Solution::default()).state(), Some(HorusState::Starting));
    assert_eq!(state(&mut cycle, 2, all(20)).state(), Some(HorusState::Monitoring));
    let lost = state(&mut cycle, 3, Solution::default());
    assert_eq!(lost.state(), Some(HorusState::PositionLost));
    assert!(!lost.position_valid());
    assert_eq!(state(&mut cycle, 4, all(40)).state(), Some(HorusState::Monitoring));
}

#[test]
fn an_active_input_is_the_state_with_a_position_and_without() {
    let motors_cut = Levels { active: true, inactive: false };
    let silent = Solution::default();
    for (earlier, solution, before) in [
        (silent, all(70), HorusState::Monitoring),
        (silent, silent, HorusState::Starting),
        (all(60), silent, HorusState::PositionLost),
    ] {
        let mut cycle = Cycle::new();
        cycle.vote(6, &[earlier]);
        let state = |cycle: &mut Cycle<1>| read(&cycle.fill(7, &[solution])).0.status.state();
        (0..SAMPLES_TO_TAKE).for_each(|_| cycle.sample([INACTIVE; INPUTS]));
        cycle.vote(7, &[solution]);
        assert_eq!(state(&mut cycle), Some(before));
        (1..SAMPLES_TO_TAKE).for_each(|_| cycle.sample([INACTIVE, motors_cut, INACTIVE]));
        cycle.vote(7, &[solution]);
        assert_eq!(state(&mut cycle), Some(before), "two samples are not taken");
        cycle.sample([INACTIVE, motors_cut, INACTIVE]);
        cycle.vote(7, &[solution]);
        assert_eq!(state(&mut cycle), Some(HorusState::MotorsCut));
    }
}

/// Returns the status of Reported-Position and of GPS1 at a tick. The solution that `arrived` returns is `age` ms old
/// then.
fn status_at(arrived: impl Fn(u32) -> Solution, age: u32) -> (ReportedStatus, GpsStatus) {
    // The tick is fixed and the solution's arrival varies, so that every age in ms is possible.
    let tick = 1_000;
    let (reported, [gps]) = read(&Cycle::new().voted_and_filled(tick, &[arrived(timestamp(tick) - age)]));
    (reported.status, gps.status)
}

// Shows REC-1.
#[test]
fn a_position_is_valid_for_one_period_and_150_ms() {
    // After a single message the receiver's period is not known yet, so one second is assumed.
    for (age, valid) in
        [(0, true), (1_050, true), (1_149, true), (1_150, true), (1_151, false), (1_152, false), (9_000, false)]
    {
        let (reported, gps) = status_at(all, age);
        assert_eq!(gps.position_valid(), valid, "GPS1 at {age} ms");
        assert_eq!(reported.position_valid(), valid, "Reported-Position at {age} ms");
        assert_eq!(reported.receivers_agreeing(), u8::from(valid), "at {age} ms");
        assert_eq!(gps.attitude_valid() && reported.attitude_valid(), valid, "attitude at {age} ms");
        assert_eq!(gps.acceleration_valid() && reported.acceleration_valid(), valid, "acceleration at {age} ms");
    }
}

// Shows REC-2.
#[test]
fn a_solution_is_stale_after_one_period_and_50_ms() {
    for (age, stale) in [(0, false), (1_000, false), (1_049, false), (1_050, true), (1_051, true), (5_000, true)] {
        assert_eq!(status_at(all, age).1.stale(), stale, "at {age} ms");
    }
}

// Shows REC-3.
#[test]
fn a_receiver_is_heard_for_250_ms() {
    assert!(status_at(all, 250).1.heard() && !status_at(all, 251).1.heard());
}

#[test]
fn each_kind_of_message_ages_by_its_own_period() {
    // The receiver sends the position at 10 Hz, attitude at 2 Hz and acceleration at 5 Hz. The last three messages
    // arrive together.
    let arrived = |last: u32| {
        let mut receiver = Receiver::new();
        for (period, kind) in [(100, 0), (500, 1), (200, 2)] {
            for back in [2, 1, 0].map(|steps| steps * period) {
                let (itow, now) = (100_000 - back, last - back);
                let message = match kind {
                    0 => NavPvt::at(itow).bytes(),
                    1 => nav_att(itow, [100, 200, 300], [1; 3]),
                    _ => esf_ins(itow, [true; 3], [1, 2, 3]),
                };
                assert_eq!(receiver.receive(&message[..60.min(message.len())], now), 60.min(message.len()));
                receiver.receive(&message[60.min(message.len())..], now);
            }
        }
        *receiver.solution()
    };
    let valid_until = |is_valid: fn(GpsStatus, ReportedStatus) -> bool| {
        (0..2_000)
            .take_while(|age| {
                let (reported, gps) = status_at(arrived, *age);
                is_valid(gps, reported)
            })
            .last()
    };
    assert_eq!(valid_until(|gps, reported| gps.position_valid() && reported.position_valid()), Some(250));
    assert_eq!(valid_until(|gps, _| gps.attitude_valid()), Some(650));
    assert_eq!(valid_until(|gps, _| gps.acceleration_valid()), Some(350));
    // A receiver's attitude and acceleration count only while the receiver agrees on the position.
    assert_eq!(valid_until(|_, reported| reported.attitude_valid() && reported.acceleration_valid()), Some(250));
    assert_eq!(valid_until(|gps, _| !gps.stale()), Some(149));
}

#[test]
fn what_is_not_valid_any_more_is_absent_from_both_objects() {
    let solution = all(0);
    let (reported, [gps]) = read(&Cycle::new().voted_and_filled(116, &[solution]));
    assert_absent(&gps, 1_160);
    assert_eq!(gps.status.bits(), 46 << 10 | 1 << 8, "1150 ms old, and stale");
    let absent = ReportedValues { status: reported.status, ..ReportedValues::absent(1_160) };
    assert_eq!(ReportedPosition::seal(&reported).as_bytes(), ReportedPosition::seal(&absent).as_bytes());
}

/// Plays a log of GPS1, byte by byte, through parser and cycle as the firmware runs them. Returns how long after the
/// last solution's arrival Reported-Position was valid, ms.
fn valid_after_the_end(period: u32, solutions: u32, repeats_its_last: bool) -> u32 {
    let mut receiver = Receiver::new();
    let mut cycle = Cycle::new();
    let last = 500 + (solutions - 1) * period;
    let mut valid_at = None;
    for tick in 0..(last + 4_000) / 10 {
        let now = timestamp(tick);
        let epoch = now.checked_sub(500).filter(|since| since % period == 0).map(|since| since / period);
        let message = match epoch {
            Some(epoch) if epoch < solutions => NavPvt::at(1_000_000 + epoch * period).bytes(),
            Some(_) if repeats_its_last => NavPvt::at(1_000_000 + (solutions - 1) * period).bytes(),
            _ => Vec::new(),
        };
        for bytes in message.chunks(64) {
            receiver.receive(bytes, now);
        }
        receiver.receive(&[], now);
        let (reported, [gps]) = read(&cycle.voted_and_filled(tick, &[*receiver.solution()]));
        assert_eq!(reported.status.position_valid(), gps.status.position_valid());
        assert_eq!(reported.status.position_valid(), reported.latitude.is_finite());
        if reported.status.position_valid() {
            assert!(valid_at.is_none_or(|before| before + 10 == now), "valid without a gap");
            valid_at = Some(now);
        }
    }
    valid_at.expect("it was valid") - last
}

#[test]
fn reported_position_turns_invalid_in_time_after_the_last_solution() {
    // Ticks are 10 ms apart, so the last tick with a valid position is exactly at the age limit.
    assert_eq!(valid_after_the_end(1_000, 5, false), 1_150, "1 Hz");
    assert_eq!(valid_after_the_end(200, 20, false), 350, "5 Hz");
    assert_eq!(valid_after_the_end(100, 40, false), 250, "10 Hz");
}

#[test]
fn reported_position_turns_invalid_if_gps1_repeats_its_last_solution() {
    assert_eq!(valid_after_the_end(1_000, 5, true), 1_150);
    assert_eq!(valid_after_the_end(100, 40, true), 250);
}

#[test]
fn a_2d_fix_gives_latitude_and_longitude_but_no_altitude() {
    let solution = heard(&[NavPvt { fix: 2, ..NavPvt::GOOD }.bytes()], 70);
    let (reported, [gps]) = read(&Cycle::new().voted_and_filled(7, &[solution]));
    assert!(gps.status.position_valid() && reported.status.position_valid());
    assert_eq!(gps.latitude, 47.498_765_4);
    assert_eq!(reported.longitude, 8.729_123_4);
    assert_eq!(gps.altitude.to_bits(), profile::ABSENT_F64.to_bits());
    assert_eq!(reported.altitude.to_bits(), profile::ABSENT_F64.to_bits());
    let (_, [three_d]) = read(&Cycle::new().voted_and_filled(7, &[heard(&[NavPvt::GOOD.bytes()], 70)]));
    assert_eq!(three_d.altitude, 512.345);
}

#[test]
fn without_a_crystal_only_its_flag_in_reported_position_changes() {
    let start = Start { clock: Source::Internal, ..Start::default() };
    let (mut with, mut without) = (Cycle::new(), Cycle::after(start));
    for (tick, solution) in [(1, Solution::default()), (2, all(20)), (3, all(20)), (4_000, all(20))] {
        let (expected, expected_gps) = read(&with.voted_and_filled(tick, &[solution]));
        let (reported, gps) = read(&without.voted_and_filled(tick, &[solution]));
        assert!(!expected.status.without_crystal() && reported.status.without_crystal());
        let same = ReportedValues { status: reported.status.with_without_crystal(false), ..reported };
        assert_eq!(ReportedPosition::seal(&same).as_bytes(), ReportedPosition::seal(&expected).as_bytes());
        let sealed = |values| *GpsObject::seal(Identifier::gps(1), values).as_bytes();
        assert_eq!(sealed(&gps[0]), sealed(&expected_gps[0]));
    }
    assert_eq!(Cycle::<1>::new(), Cycle::after(Start { clock: Source::External, ..start }));
}

#[test]
fn every_reported_position_says_why_horus_last_started() {
    for reason in [ResetReason::PowerOn, ResetReason::Pin, ResetReason::Watchdog, ResetReason::BrownOutOrOther] {
        let mut cycle = Cycle::<1>::after(Start { reason, ..Start::default() });
        let unvoted = read(&cycle.fill(0, &[Solution::default()])).0;
        let voted = read(&cycle.voted_and_filled(1, &[all(10)])).0;
        assert_eq!([unvoted, voted].map(|reported| reported.status.reset_reason()), [Some(reason); 2]);
    }
}

// Shows STA-7.
#[test]
fn a_memory_fault_is_told_from_the_vote_after_it_on() {
    let mut cycle = Cycle::new();
    let told = |profile: Profile<1>| read(&profile).0.status.memory_fault();
    assert!(!told(cycle.voted_and_filled(1, &[all(10)])));
    cycle.found_memory_fault();
    assert!(!told(cycle.fill(1, &[all(10)])), "sealed before");
    for tick in 2..5 {
        assert!(told(cycle.voted_and_filled(tick, &[all(10)])));
    }
    assert!(told(cycle.fill(9, &[all(10)])), "without a vote");
}

// Shows SAFE-17.
#[test]
fn a_count_of_ticks_with_a_flipped_bit_is_not_the_votes() {
    let mut cycle = Cycle::<3>::new();
    assert!(cycle.has_voted_for(0) && cycle.has_voted_for(77), "no vote yet");
    cycle.vote(77, &[Solution::default(); 3]);
    assert!(cycle.has_voted_for(77));
    for bit in 0..32 {
        assert!(!cycle.has_voted_for(77 ^ 1 << bit));
    }
}

#[test]
fn who_was_excluded_before_a_restart_is_from_the_first_tick_on() {
    let mut before = Cycle::new();
    let elsewhere = |now| heard(&[NavPvt { latitude: 1, ..NavPvt::GOOD }.bytes()], now);
    before.vote(1, &[all(10), all(10), elsewhere(10)]);
    assert_eq!(before.excluded(), 0b100);
    let excluded = |profile: &Profile<3>| read(profile).1.map(|gps| gps.status.excluded());

    let start = Start { excluded: before.excluded(), ..Start::default() };
    let mut after = Cycle::<3>::after(start);
    assert_eq!(excluded(&after.fill(0, &[Solution::default(); 3])), [false, false, true]);
    // The excluded receiver agrees from now on, and stays excluded for a second, the last tick included.
    for tick in 1..=101 {
        let profile = after.voted_and_filled(tick, &[all(10 * tick), all(10 * tick), all(10 * tick)]);
        assert_eq!(excluded(&profile), [false, false, true], "tick {tick}");
    }
    let profile = after.voted_and_filled(102, &[all(1_020), all(1_020), all(1_020)]);
    assert_eq!(excluded(&profile), [false; 3]);
}

// Shows REC-4.
#[test]
fn a_solution_tells_its_age_in_steps_of_25_ms() {
    let told = |age| status_at(all, age).1.solution_age_ms();
    for (age, ms) in [(0, 0), (24, 0), (25, 25), (1_549, 1_525), (1_550, 1_550), (9_000, 1_550)] {
        assert_eq!(told(age), Some(ms), "{age} ms");
    }
    let (_, [came_since]) = read(&Cycle::new().voted_and_filled(7, &[all(75)]));
    assert_eq!(came_since.status.solution_age_ms(), Some(0));
    let (_, [never]) = read(&Cycle::new().voted_and_filled(7, &[Solution::default()]));
    assert_eq!(never.status.solution_age_ms(), None);
    let (_, [no_position]) = read(&Cycle::new().voted_and_filled(7, &[heard(&[nav_att(1, [1; 3], [1; 3])], 70)]));
    assert_eq!(no_position.status.solution_age_ms(), None);
}

#[test]
fn a_very_old_solution_is_told_apart_from_none() {
    let mut receiver = Receiver::new();
    for bytes in NavPvt::GOOD.bytes().chunks(60) {
        receiver.receive(bytes, 0);
    }
    // A minute after the last message its time is dropped. The age must stay at its greatest value then.
    for minute in 1..5 {
        receiver.receive(&[], 60_010 * minute);
        let (_, [gps]) = read(&Cycle::new().voted_and_filled(6_001 * minute, &[*receiver.solution()]));
        assert_eq!(gps.status.solution_age_ms(), Some(GpsStatus::OLDEST_MS));
    }
}

#[test]
fn a_repeated_time_of_week_makes_no_solution_younger() {
    let mut receiver = Receiver::new();
    for at in [0, 100, 200] {
        NavPvt::at(1_000).bytes().chunks(60).for_each(|bytes| _ = receiver.receive(bytes, at));
    }
    let (_, [gps]) = read(&Cycle::new().voted_and_filled(20, &[*receiver.solution()]));
    assert_eq!(gps.status.solution_age_ms(), Some(200));
}

#[test]
fn a_message_between_a_tick_and_its_cycle_is_not_old() {
    let (_, [gps]) = read(&Cycle::new().voted_and_filled(7, &[all(75)]));
    assert!(gps.status.heard() && gps.status.position_valid() && !gps.status.stale());
}

proptest! {
    // Shows OBJ-8.
    #[test]
    fn a_set_bit_and_a_number_always_go_together(
        fix in 0u8..8,
        flags in 0u8..2,
        latitude in any::<i32>(),
        accuracies in any::<[bool; 3]>(),
        axes in any::<[bool; 3]>(),
        age in 0u32..130,
    ) {
        let solution = heard(
            &[
                NavPvt { fix, flags, latitude, ..NavPvt::GOOD }.bytes(),
                nav_att(1_000, [1, 2, 3], accuracies.map(u32::from)),
                esf_ins(1_000, axes, [1, 2, 3]),
            ],
            0,
        );
        let (reported, gps) = read(&Cycle::new().voted_and_filled(age, &[solution; 5]));
        for gps in gps {
            prop_assert_eq!(gps.status.position_valid(), gps.latitude.is_finite());
            prop_assert_eq!(gps.status.position_valid(), gps.longitude.is_finite());
            prop_assert_eq!(gps.status.position_valid() && fix != 2, gps.altitude.is_finite());
            let angles = [gps.pitch, gps.yaw, gps.roll];
            prop_assert_eq!(gps.status.attitude_valid(), angles.iter().all(|angle| angle.is_finite()));
            prop_assert_eq!(gps.status.acceleration_valid(), gps.acceleration.iter().all(|axis| axis.is_finite()));
        }
        prop_assert_eq!(reported.status.position_valid(), gps[0].status.position_valid());
        prop_assert_eq!(reported.status.receivers_agreeing(), 5 * u8::from(gps[0].status.position_valid()));
        prop_assert_eq!(reported.status.position_valid(), reported.latitude.is_finite());
        prop_assert_eq!(reported.status.position_valid() && fix != 2, reported.altitude.is_finite());
        let angles = [reported.pitch, reported.yaw, reported.roll];
        prop_assert!(angles.iter().all(|angle| angle.is_finite() == reported.status.attitude_valid()));
        prop_assert!(reported.acceleration.iter().all(|a| a.is_finite() == reported.status.acceleration_valid()));
    }

    #[test]
    fn a_ticket_is_good_for_its_own_slot_alone(
        tick in any::<u32>(),
        frame in 0usize..2,
        other in any::<u32>(),
        slot in 0usize..2,
    ) {
        let ticket = Ticket::new(tick, frame, 0xC4);
        prop_assert_eq!(ticket.due(tick, frame), Some(0xC4));
        if (tick as u16, frame) != (other as u16, slot) {
            prop_assert_eq!(ticket.due(other, slot), None);
        }
        prop_assert_eq!(Ticket::NONE.due(tick, frame), None);
        prop_assert_eq!(Ticket::from_word(ticket.word()), ticket);
    }
}
