//! Tests that sealed values are read back unchanged: values, status words, freshness, and texts for people.
use std::error::Error;

use profile::{
    FixType, Freshness, GpsObject, GpsStatus, GpsValues, HorusState, Identifier, LinkStatus, LinkStatusBits,
    LinkValues, Object, Profile, Rejection, ReportedPosition, ReportedStatus, ReportedValues, ResetReason, air,
    freshness, image::Image, ssi,
};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngSeed};

use crate::support;

use support::{reference, seeds};

fn seeded(cases: u32) -> Config {
    Config { cases, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..Config::default() }
}

fn gps_bits(values: &GpsValues) -> (u32, u16, [u64; 3], [u32; 6]) {
    let [x, y, z] = values.acceleration;
    (
        values.timestamp,
        values.status.bits(),
        [values.latitude, values.longitude, values.altitude].map(f64::to_bits),
        [values.pitch, values.yaw, values.roll, x, y, z].map(f32::to_bits),
    )
}

fn reported_bits(values: &ReportedValues) -> (u32, u16, [u64; 3], [u32; 6]) {
    let [x, y, z] = values.acceleration;
    (
        values.timestamp,
        values.status.bits(),
        [values.latitude, values.longitude, values.altitude].map(f64::to_bits),
        [values.pitch, values.yaw, values.roll, x, y, z].map(f32::to_bits),
    )
}

fn gps_values(timestamp: u32, status: u16, f64s: [u64; 3], f32s: [u32; 6]) -> GpsValues {
    let [latitude, longitude, altitude] = f64s.map(f64::from_bits);
    let [pitch, yaw, roll, x, y, z] = f32s.map(f32::from_bits);
    GpsValues {
        timestamp,
        status: GpsStatus::from_bits(status),
        latitude,
        longitude,
        altitude,
        pitch,
        yaw,
        roll,
        acceleration: [x, y, z],
    }
}

fn any_f64() -> impl Strategy<Value = u64> {
    prop_oneof![
        any::<u64>(),
        Just(0x7FF8_0000_0000_0000), // quiet NaN
        Just(0x7FF0_0000_0000_0001), // signalling NaN
        Just(0xFFF8_DEAD_BEEF_CAFE), // quiet NaN with sign and payload
        Just(0x8000_0000_0000_0000), // -0
        Just(0x0000_0000_0000_0001), // subnormal
        Just(0x7FF0_0000_0000_0000), // infinity
    ]
}

fn any_f32() -> impl Strategy<Value = u32> {
    prop_oneof![
        any::<u32>(),
        Just(0x7FC0_0000),
        Just(0x7F80_0001),
        Just(0xFFC0_BEEF),
        Just(0x8000_0000),
        Just(0x0000_0001),
        Just(0x7F80_0000),
    ]
}

proptest! {
    #![proptest_config(seeded(2048))]

    #[test]
    fn what_is_sealed_verifies_and_reads_the_same_to_the_last_bit(
        timestamp: u32,
        status: u16,
        f64s in [any_f64(), any_f64(), any_f64()],
        f32s in [any_f32(), any_f32(), any_f32(), any_f32(), any_f32(), any_f32()],
        receiver in 1_usize..=5,
    ) {
        let values = gps_values(timestamp, status, f64s, f32s);
        let sealed = GpsObject::seal(Identifier::gps(receiver), &values);
        let verified = GpsObject::verify(sealed.as_bytes(), Identifier::gps(receiver));
        let read = verified.map(|object| gps_bits(&object.values()));
        prop_assert_eq!(read, Ok((timestamp, status & GpsStatus::USED, f64s, f32s)));

        let reported = ReportedValues {
            timestamp,
            status: ReportedStatus::from_bits(status),
            latitude: values.latitude,
            longitude: values.longitude,
            altitude: values.altitude,
            pitch: values.pitch,
            yaw: values.yaw,
            roll: values.roll,
            acceleration: values.acceleration,
        };
        let sealed = ReportedPosition::seal(&reported);
        let verified = ReportedPosition::verify(sealed.as_bytes());
        let read = verified.map(|object| reported_bits(&object.values()));
        prop_assert_eq!(read, Ok((timestamp, status & ReportedStatus::USED, f64s, f32s)));
    }

    #[test]
    fn link_status_reads_as_it_was_sealed(
        timestamp: u32, status: u16, counters: [u32; 4], age_100us: u16, access_violations: u16,
    ) {
        let [objects_accepted, objects_rejected, frames_received, frames_missed] = counters;
        let values = LinkValues {
            timestamp,
            status: LinkStatusBits::from_bits(status),
            objects_accepted,
            objects_rejected,
            frames_received,
            frames_missed,
            age_100us,
            access_violations,
        };
        let sealed = LinkStatus::seal(&values);
        prop_assert_eq!(LinkStatus::verify(sealed.as_bytes()).map(LinkStatus::values), Ok(values));
    }

    #[test]
    fn a_status_keeps_the_bits_that_have_a_meaning_and_no_other(bits: u16) {
        prop_assert_eq!(GpsStatus::from_bits(bits).bits(), bits);
        prop_assert_eq!(ReportedStatus::from_bits(bits).bits(), bits);
        prop_assert_eq!(LinkStatusBits::from_bits(bits).bits(), bits & 0xF7FF);
    }

    #[test]
    fn every_number_of_cycles_forward_is_fresh_and_wrapping_changes_nothing(
        previous: u32, cycles in 1_u32..=(u32::MAX / 2) / 10,
    ) {
        let now = previous.wrapping_add(cycles * 10);
        prop_assert_eq!(freshness(Some(previous), now), Freshness::Fresh { missed: cycles - 1 });
    }

    #[test]
    fn back_is_a_restart_and_a_part_of_a_cycle_is_irregular(previous: u32, step in 1_u32..=u32::MAX / 2) {
        let back = freshness(Some(previous), previous.wrapping_sub(step));
        prop_assert_eq!(back, Freshness::Restarted);
        let forward = freshness(Some(previous), previous.wrapping_add(step));
        prop_assert_eq!(forward == Freshness::Irregular, !step.is_multiple_of(10));
        prop_assert_eq!(forward.is_fresh(), step.is_multiple_of(10));
        prop_assert!(!back.is_fresh());
    }

    #[test]
    fn any_eight_bytes_are_a_request_or_are_refused(request: [u8; 8], image_len: usize) {
        support::invariants::ssi_request(&request);
        let _ = ssi::parse(&request, image_len);
    }

    #[test]
    fn a_request_that_lies_in_the_image_is_understood(
        offset in 0_u16..396, length in 1_u16..=396, n in prop::sample::select(vec![1_usize, 2, 3, 5]),
    ) {
        let image_len = 96 + 60 * n;
        let request = ssi::Request { offset, length };
        let expected = if request.window().end <= image_len {
            Ok(ssi::Parsed::Window(request))
        } else {
            Err(Rejection::Window)
        };
        prop_assert_eq!(ssi::parse(&ssi::encode(request), image_len), expected);
    }
}

#[test]
fn timestamps_wrap_without_a_gap() {
    assert_eq!(freshness(Some(4_294_967_290), 4), Freshness::Fresh { missed: 0 });
    assert_eq!(freshness(Some(4_294_967_290), 0), Freshness::Irregular);
    assert_eq!(freshness(Some(4), 4_294_967_290), Freshness::Restarted);
}

#[test]
fn the_first_timestamp_is_fresh_and_a_repeated_one_is_not() {
    for timestamp in [0, 1, 10, u32::MAX] {
        assert_eq!(freshness(None, timestamp), Freshness::First);
        assert!(Freshness::First.is_fresh());
        assert_eq!(freshness(Some(timestamp), timestamp), Freshness::Frozen);
        assert!(!Freshness::Frozen.is_fresh());
    }
    assert_eq!(freshness(Some(60_000), 0), Freshness::Restarted);
    assert!(!Freshness::Restarted.is_fresh());
}

#[test]
fn each_status_flag_is_the_bit_that_the_layout_gives_it() {
    let gps = GpsStatus::new();
    let flags = [
        (gps.with_position_valid(true), 4),
        (gps.with_attitude_valid(true), 5),
        (gps.with_acceleration_valid(true), 6),
        (gps.with_heard(true), 7),
        (gps.with_stale(true), 8),
        (gps.with_excluded(true), 9),
    ];
    for (status, bit) in flags {
        assert_eq!(status.bits(), 1 << bit);
        let flags = [
            status.position_valid(),
            status.attitude_valid(),
            status.acceleration_valid(),
            status.heard(),
            status.stale(),
            status.excluded(),
        ];
        assert_eq!(flags, [4, 5, 6, 7, 8, 9].map(|flag| flag == bit));
    }

    let reported = ReportedStatus::new();
    let flags = [
        (reported.with_position_valid(true), 3),
        (reported.with_attitude_valid(true), 4),
        (reported.with_acceleration_valid(true), 5),
        (reported.with_degraded(true), 6),
        (reported.with_without_crystal(true), 7),
        (reported.with_memory_fault(true), 12),
    ];
    for (status, bit) in flags {
        assert_eq!(status.bits(), 1 << bit);
        let flags = [
            status.position_valid(),
            status.attitude_valid(),
            status.acceleration_valid(),
            status.degraded(),
            status.without_crystal(),
            status.memory_fault(),
        ];
        assert_eq!(flags, [3, 4, 5, 6, 7, 12].map(|flag| flag == bit));
    }

    let link = LinkStatusBits::new();
    let flags = [
        (link.with_link_up(true), 0),
        (link.with_all_accepted(true), 1),
        (link.with_horus_frozen(true), 2),
        (link.with_horus_restarted(true), 3),
        (link.with_ram_fault(true), 4),
        (link.with_front_end_fault(true), 5),
        (link.with_unasked_reset(true), 6),
        (link.with_uplink_rejected(true), 7),
        (link.with_out_of_sequence(true), 8),
        (link.with_horus_clock_implausible(true), 9),
        (link.with_flash_fault(true), 10),
        (link.with_no_field(true), 15),
    ];
    for (status, bit) in flags {
        assert_eq!(status.bits(), 1 << bit);
        let flags = [
            status.link_up(),
            status.all_accepted(),
            status.horus_frozen(),
            status.horus_restarted(),
            status.ram_fault(),
            status.front_end_fault(),
            status.unasked_reset(),
            status.uplink_rejected(),
            status.out_of_sequence(),
            status.horus_clock_implausible(),
            status.flash_fault(),
            status.no_field(),
        ];
        assert_eq!(flags, [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 15].map(|flag| flag == bit));
    }
}

#[test]
fn each_reset_reason_has_its_code_and_its_flag_unasked() {
    use ResetReason::{BrownOutOrOther, Lockup, Pin, PowerOn, Software, Watchdog};
    let reasons = [
        (PowerOn, 0, false),
        (Pin, 1, false),
        (Watchdog, 2, true),
        (Lockup, 3, true),
        (Software, 4, false),
        (BrownOutOrOther, 5, true),
    ];
    for (reason, code, unasked) in reasons {
        let status = LinkStatusBits::new().with_link_up(true).with_reset_reason(reason);
        assert_eq!(status.bits(), code << 12 | u16::from(unasked) << 6 | 1);
        assert_eq!((status.reset_reason(), status.unasked_reset()), (Some(reason), unasked));
        assert_eq!(status.with_reset_reason(PowerOn), LinkStatusBits::new().with_link_up(true));
    }
    for reserved in [6, 7] {
        assert_eq!(LinkStatusBits::from_bits(reserved << 12).reset_reason(), None);
    }
}

#[test]
fn a_flag_can_be_cleared_and_its_neighbours_stay() {
    let all = GpsStatus::from_bits(0xFFFF);
    assert_eq!(all.with_heard(false).bits(), !(1 << 7));
    assert_eq!(all.with_fix_type(FixType::NoFix).bits(), 0xFFF0);
    assert_eq!(all.with_solution_age_ms(Some(0)).bits(), 0x03FF);
    let all = ReportedStatus::from_bits(0xFFFF);
    assert_eq!(all.with_degraded(false).bits(), !(1 << 6));
    assert_eq!(all.with_state(HorusState::Starting).bits(), 0xF0FF);
    assert_eq!(all.with_receivers_agreeing(0).bits(), 0xFFF8);
    assert_eq!(all.with_reset_reason(ResetReason::PowerOn).bits(), 0x1FFF);
}

#[test]
fn codes_read_as_they_were_written_and_reserved_ones_as_none() {
    for code in 0..=15 {
        let status = GpsStatus::from_bits(u16::from(code));
        assert_eq!(status.fix_type(), FixType::from_ubx(code));
        assert_eq!(status.fix_type().is_some(), code <= 5);
        if let Some(fix) = status.fix_type() {
            assert_eq!(GpsStatus::new().with_fix_type(fix), status);
        }
        let status = ReportedStatus::from_bits(u16::from(code) << 8);
        assert_eq!(status.state().is_some(), code <= 7);
        if let Some(state) = status.state() {
            assert_eq!(ReportedStatus::new().with_state(state), status);
        }
    }
    for receivers in 0..=u8::MAX {
        let status = ReportedStatus::new().with_receivers_agreeing(receivers);
        assert_eq!(status.receivers_agreeing(), receivers.min(7));
        assert_eq!(status.bits() & !0x0007, 0);
    }
}

#[test]
fn identifiers_and_object_numbers_name_each_other() {
    assert_eq!(Identifier::of_object(0), Some(Identifier::REPORTED_POSITION));
    for (index, gps) in (1..).zip(Identifier::GPS) {
        assert_eq!(gps, Identifier::gps(index));
        assert_eq!(Identifier::of_object(index), Some(gps));
    }
    assert_eq!(Identifier::of_object(6), None);
    for word in 0..=u16::MAX {
        let identifier = Identifier(word);
        if let Some(index) = identifier.object() {
            assert_eq!(Identifier::of_object(index), Some(identifier));
        }
        assert_eq!(identifier.object().is_some(), (0x4800..=0x4805).contains(&word));
    }
}

fn a_profile_crosses_the_air_for<const N: usize>() {
    let profile = seeds::profile::<N>(1_230);
    let payloads: Vec<_> = air::split(&profile).collect();
    assert_eq!(payloads.len(), air::frames(N));
    assert_eq!(payloads.concat(), profile.as_bytes(), "whole objects, in order, and nothing else");
    let mut image = Image::<N>::EMPTY;
    for (frame, payload) in payloads.iter().enumerate() {
        assert!(payload.len() <= air::LONGEST_PAYLOAD);
        let place = air::place::<N>(payload).expect("a frame of this profile");
        assert_eq!(air::Place::of_frame::<N>(frame), Some(place));
        assert_eq!(&profile.as_bytes()[place.offset()..place.offset() + place.length()], *payload);
        for (index, bytes) in air::objects::<N>(payload).expect("a frame of this profile") {
            assert_eq!(&profile.as_bytes()[Profile::<N>::place(index).expect("its object")], bytes);
            image.deposit(Object::verify(index, bytes).expect("intact")).expect("has a place");
        }
    }
    assert_eq!(image.profile(), &profile);
    assert!(image.verify().profile.complete());
    assert_eq!(air::Place::of_frame::<N>(payloads.len()), None);

    let longest = [0x5A; air::MAX_PAYLOAD + 1];
    for length in 0..=longest.len() {
        let expected = payloads.iter().any(|payload| payload.len() == length);
        assert_eq!(air::place::<N>(&longest[..length]).is_ok(), expected, "{length} bytes");
        assert_eq!(air::objects::<N>(&longest[..length]).is_ok(), expected, "{length} bytes");
    }
}

#[test]
fn a_profile_of_any_supported_number_of_receivers_crosses_the_air() {
    a_profile_crosses_the_air_for::<1>();
    a_profile_crosses_the_air_for::<2>();
    a_profile_crosses_the_air_for::<3>();
    a_profile_crosses_the_air_for::<5>();
}

#[test]
fn a_hit_on_one_object_costs_that_object_only() {
    let profile = seeds::profile::<3>(70);
    for (hit, place) in reference::places(3).into_iter().enumerate() {
        let damaged = reference::flipped(profile.as_bytes(), [8 * place.start + 100]);
        for (index, bytes) in air::objects::<3>(&damaged).expect("a whole frame") {
            assert_eq!(Object::verify(index, bytes).is_ok(), index != hit);
        }
    }
}

#[test]
fn the_second_frame_in_the_firsts_place_is_rejected_object_by_object() {
    let profile = seeds::profile::<5>(70);
    let first = &profile.as_bytes()[..180];
    for (index, bytes) in air::objects::<5>(first).expect("as long as the second frame") {
        assert!(Object::verify(index, bytes).is_err());
    }
    let gps1 = &profile.as_bytes()[64..124];
    let exchanged = [gps1, gps1, gps1].concat();
    for (index, bytes) in air::objects::<5>(&exchanged).expect("as long as the second frame") {
        assert_eq!(Object::verify(index, bytes), Err(Rejection::Identifier));
    }
}

#[test]
fn slot_and_air_time_give_the_age_at_a_frames_end() {
    assert_eq!(air::age_at_end_us::<1>(0), Some(70 + 2_549));
    assert_eq!(air::age_at_end_us::<2>(0), Some(80 + 3_682));
    assert_eq!(air::age_at_end_us::<3>(0), Some(100 + 4_815));
    assert_eq!(air::age_at_end_us::<5>(0), Some(120 + 3_682));
    assert_eq!(air::age_at_end_us::<5>(1), Some(4_130 + 3_606));
    assert_eq!((air::age_at_end_us::<3>(1), air::age_at_end_us::<5>(2)), (None, None));
}

#[test]
fn air_time_is_that_of_424_kbit_per_second() {
    // On the air a frame has 48 + 16 + 8 + 8 * payload + 16 bits, each of 32 periods of 13.56 MHz.
    for (payload, nanoseconds) in [(124, 2_548_673), (184, 3_681_416), (244, 4_814_159), (180, 3_605_900)] {
        assert_eq!(air::air_time_ns(payload), nanoseconds);
    }
    // Both frames of a profile of five receivers and the gap between them must fit in 10 ms.
    let both = air::air_time_ns(184) + air::air_time_ns(180) + 1_000 * u64::from(air::MIN_GAP_US);
    assert!(both < 10_000_000);
}

#[test]
fn an_image_has_a_place_for_its_own_objects_only() {
    let five = seeds::profile::<5>(70);
    let mut image = Image::<3>::EMPTY;
    let fourth = five.gps()[3];
    assert_eq!(image.deposit(Object::Gps(&fourth)), Err(Rejection::Identifier));
    let uplink = GpsObject::seal(Identifier::UPLINK_BASE_STATION, &seeds::gps_values(70));
    assert_eq!(image.deposit(Object::Gps(&uplink)), Err(Rejection::Identifier));
    let as_reported = GpsObject::seal(Identifier::REPORTED_POSITION, &seeds::gps_values(70));
    assert_eq!(image.deposit(Object::Gps(&as_reported)), Err(Rejection::Identifier));
    let nothing = Object::Reported(&ReportedPosition::EMPTY);
    assert_eq!(image.deposit(nothing), Err(Rejection::Identifier));
    assert_eq!(image, Image::EMPTY);
    assert_eq!(image.object_mut(4), None);
    assert_eq!(Image::<3>::place(0), Some(32..96));
    assert_eq!(Image::<3>::place(1), Some(96..156));
    assert_eq!(Image::<3>::place(3), Some(216..276));
    assert_eq!(Image::<3>::place(4), None);
    assert_eq!(Image::<3>::place(usize::MAX), None);
    assert_eq!(Profile::<5>::place(5), Some(304..364));
}

#[test]
fn nothing_in_an_empty_image_or_profile_verifies() {
    assert_eq!(Image::<3>::EMPTY.verify().link, Err(Rejection::Crc));
    assert_eq!(Profile::<3>::EMPTY.verify().accepted(), 0);
    assert_eq!(ReportedPosition::verify(ReportedPosition::EMPTY.as_bytes()), Err(Rejection::Crc));
    assert_eq!(LinkStatus::verify(LinkStatus::EMPTY.as_bytes()), Err(Rejection::Crc));
    for identifier in Identifier::GPS {
        assert_eq!(GpsObject::verify(GpsObject::EMPTY.as_bytes(), identifier), Err(Rejection::Crc));
    }
}

#[test]
fn no_profile_has_an_object_number_six() {
    let gps = GpsObject::seal(Identifier(0x4806), &seeds::gps_values(0));
    assert_eq!(Object::verify(6, gps.as_bytes()), Err(Rejection::Identifier));
    assert_eq!(Object::verify(usize::MAX, gps.as_bytes()), Err(Rejection::Identifier));
}

#[test]
fn an_accepted_object_says_what_it_is_whichever_kind() {
    let profile = seeds::profile::<1>(70);
    let sizes = [64, 60];
    for (index, place) in reference::places(1).into_iter().enumerate() {
        let bytes = &profile.as_bytes()[place];
        let object = Object::verify(index, bytes).expect("intact");
        assert_eq!(object.timestamp(), 70);
        assert_eq!(object.identifier().object(), Some(index));
        assert_eq!(object.index(), Some(index));
        assert_eq!(object.as_bytes(), bytes);
        assert_eq!(object.as_bytes().len(), sizes[index]);
    }
}

#[test]
fn an_age_saturates() {
    for (micros, age) in [(0, 0), (99, 0), (100, 1), (6_553_499, 65_534), (6_553_500, 65_535), (u32::MAX, 65_535)] {
        assert_eq!(LinkValues::age(micros), age);
    }
}

#[test]
fn a_person_can_read_what_was_rejected_and_what_was_not() {
    let error: Box<dyn Error> = Box::new(Rejection::PositionCrc);
    assert_eq!(error.to_string(), "position CRC does not match");
    assert_eq!(Rejection::Command.to_string(), "unknown command");
    let names = [0x4800, 0x4803, 0x4400, 0x4401, 0x4200, 0x4300, 0x4301, 0x1234].map(|it| Identifier(it).to_string());
    assert_eq!(
        names,
        [
            "Reported-Position",
            "GPS3",
            "Link-Status",
            "Port-Status",
            "uplink from the base station",
            "uplink from the flight controller",
            "command to the DPR",
            "object 0x1234",
        ]
    );
    let mut image = Image::<1>::EMPTY;
    let profile = seeds::profile::<1>(1_230);
    image.deposit(Object::Reported(profile.reported())).expect("has a place");
    let shown = format!("{image:?}");
    assert!(shown.contains("timestamp: 1230") && shown.contains("latitude: 47.4979123"), "{shown}");
}
