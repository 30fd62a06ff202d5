//! Compares bytes written by hand from the layout tables with the crate and with a CRC computed bit by bit.
use profile::{
    ABSENT_F32, ABSENT_F64, FixType, GpsObject, GpsStatus, GpsValues, HorusState, Identifier, LinkStatus,
    LinkStatusBits, LinkValues, Profile, ReportedPosition, ReportedStatus, ReportedValues, ResetReason, crc,
    image::{self, Image},
    ssi::{self, Request},
};

use crate::support;

use support::reference;

#[rustfmt::skip]
const GPS1: [u8; 60] = [
    0xCE, 0x04, 0x00, 0x00,                         // 1230 ms
    0x01, 0x48,                                     // 0x4801: GPS1
    0x93, 0x08,                                     // 3D fix, position valid, heard, 50 ms old
    0x00, 0x00, 0x00, 0x00, 0x00, 0xC0, 0x47, 0x40, // 47.5°
    0x00, 0x00, 0x00, 0x00, 0x00, 0x80, 0x21, 0x40, // 8.75°
    0x00, 0x00, 0x00, 0x00, 0x00, 0xD4, 0x7E, 0x40, // 493.25 m
    0x00, 0x00, 0x00, 0x3F,                         // pitch 0.5 rad
    0x00, 0x00, 0xC0, 0x3F,                         // yaw 1.5 rad
    0x00, 0x00, 0x80, 0xBE,                         // roll -0.25 rad
    0x00, 0x00, 0x80, 0x3F,                         // x 1 m/s²
    0x00, 0x00, 0xC0, 0x7F,                         // y not known
    0x00, 0x00, 0x00, 0xC0,                         // z -2 m/s²
    0xDC, 0x40, 0xC5, 0xA8,                         // frame CRC 0xDC40C5A8
];

#[rustfmt::skip]
const REPORTED_POSITION: [u8; 64] = [
    0xD8, 0x04, 0x00, 0x00,                         // 1240 ms
    0x00, 0x48,                                     // 0x4800: Reported-Position
    0x0B, 0x41,                                     // 3 agree, position valid, monitoring, watchdog reset
    0x00, 0x00, 0x00, 0x00, 0x00, 0xC0, 0x47, 0xC0, // -47.5°
    0x00, 0x00, 0x00, 0x00, 0x00, 0x80, 0x21, 0x40, // 8.75°
    0x3F, 0x14, 0xF6, 0x5D,                         // position CRC 0x3F14F65D
    0x00, 0x00, 0x00, 0x00, 0x00, 0xD4, 0x7E, 0x40, // 493.25 m
    0x00, 0x00, 0x00, 0x3F,                         // pitch 0.5 rad
    0x00, 0x00, 0xC0, 0x3F,                         // yaw 1.5 rad
    0x00, 0x00, 0x80, 0xBE,                         // roll -0.25 rad
    0x00, 0x00, 0x80, 0x3F,                         // x 1 m/s²
    0x00, 0x00, 0xC0, 0x7F,                         // y not known
    0x00, 0x00, 0x00, 0xC0,                         // z -2 m/s²
    0x4E, 0x8E, 0xA9, 0x67,                         // frame CRC 0x4E8EA967
];

#[rustfmt::skip]
const LINK_STATUS: [u8; 32] = [
    0x88, 0x13, 0x00, 0x00, // 5000 ms
    0x00, 0x44,             // 0x4400: Link-Status
    0x03, 0x00,             // link up, all accepted
    0xA0, 0x0F, 0x00, 0x00, // 4000 objects accepted
    0x01, 0x00, 0x00, 0x00, // 1 object rejected
    0xE8, 0x03, 0x00, 0x00, // 1000 frames received
    0x02, 0x00, 0x00, 0x00, // 2 frames missed
    0x35, 0x00,             // 5.3 ms old
    0x07, 0x00,             // 7 access violations
    0x54, 0xE4, 0x41, 0x52, // frame CRC 0x54E44152
];

const REQUEST: [u8; 8] = [0x20, 0x00, 0x40, 0x00, 0x6E, 0x68, 0x69, 0x5A];

fn gps_values() -> GpsValues {
    GpsValues {
        timestamp: 1230,
        status: GpsStatus::new()
            .with_fix_type(FixType::Fix3D)
            .with_position_valid(true)
            .with_heard(true)
            .with_solution_age_ms(Some(74)),
        latitude: 47.5,
        longitude: 8.75,
        altitude: 493.25,
        pitch: 0.5,
        yaw: 1.5,
        roll: -0.25,
        acceleration: [1.0, ABSENT_F32, -2.0],
    }
}

fn reported_values() -> ReportedValues {
    ReportedValues {
        timestamp: 1240,
        status: ReportedStatus::new()
            .with_receivers_agreeing(3)
            .with_position_valid(true)
            .with_state(HorusState::Monitoring)
            .with_reset_reason(ResetReason::Watchdog),
        latitude: -47.5,
        longitude: 8.75,
        altitude: 493.25,
        pitch: 0.5,
        yaw: 1.5,
        roll: -0.25,
        acceleration: [1.0, ABSENT_F32, -2.0],
    }
}

#[test]
fn the_check_values_are_those_of_the_published_polynomials() {
    assert_eq!(crc::frame(b"123456789"), 0x12D3_A0B1);
    assert_eq!(crc::position(b"123456789"), 0xEA87_07AB);
    assert_eq!(reference::crc(reference::FRAME, b"123456789"), 0x12D3_A0B1);
    assert_eq!(reference::crc(reference::POSITION, b"123456789"), 0xEA87_07AB);
    assert_eq!((crc::FRAME.check, crc::POSITION.check), (0x12D3_A0B1, 0xEA87_07AB));
}

#[test]
fn koopmans_notation_names_the_same_polynomials() {
    // Koopman's notation omits the constant term, which is 1; the usual notation omits x³².
    assert_eq!(0xF8C9_140A_u32 << 1 | 1, crc::FRAME.poly);
    assert_eq!(0x9D7F_97D6_u32 << 1 | 1, crc::POSITION.poly);
}

// Shows OBJ-7.
#[test]
fn a_gps_object_is_these_bytes() {
    assert_eq!(GPS1[56..], reference::crc(reference::FRAME, &GPS1[..56]).to_be_bytes());
    let sealed = GpsObject::seal(Identifier::gps(1), &gps_values());
    assert_eq!(sealed.as_bytes(), &GPS1);
    assert_eq!(GpsObject::verify(&GPS1, Identifier::gps(1)), Ok(&sealed));
    assert_eq!(sealed.crc(), 0xDC40_C5A8);
}

#[test]
fn these_bytes_are_a_gps_object() {
    let object = GpsObject::verify(&GPS1, Identifier::gps(1)).expect("valid");
    assert_eq!((object.timestamp(), object.identifier()), (1230, Identifier(0x4801)));
    let (read, written) = (object.values(), gps_values());
    assert_eq!(read.status, written.status);
    assert_eq!((read.latitude, read.longitude, read.altitude), (47.5, 8.75, 493.25));
    assert_eq!((read.pitch, read.yaw, read.roll), (0.5, 1.5, -0.25));
    assert_eq!((read.acceleration[0], read.acceleration[2]), (1.0, -2.0));
    assert_eq!(read.acceleration[1].to_bits(), 0x7FC0_0000);
}

// Shows OBJ-7.
#[test]
fn reported_position_is_these_bytes() {
    let position = reference::crc(reference::POSITION, &REPORTED_POSITION[8..24]);
    assert_eq!(REPORTED_POSITION[24..28], position.to_be_bytes());
    let frame = reference::crc(reference::FRAME, &REPORTED_POSITION[..60]);
    assert_eq!(REPORTED_POSITION[60..], frame.to_be_bytes());
    let sealed = ReportedPosition::seal(&reported_values());
    assert_eq!(sealed.as_bytes(), &REPORTED_POSITION);
    assert_eq!(ReportedPosition::verify(&REPORTED_POSITION), Ok(&sealed));
    assert_eq!((sealed.position_crc(), sealed.crc()), (0x3F14_F65D, 0x4E8E_A967));
}

#[test]
fn these_bytes_are_a_reported_position() {
    let object = ReportedPosition::verify(&REPORTED_POSITION).expect("valid");
    assert_eq!((object.timestamp(), object.identifier()), (1240, Identifier(0x4800)));
    let (read, written) = (object.values(), reported_values());
    assert_eq!(read.status, written.status);
    assert_eq!((read.latitude, read.longitude, read.altitude), (-47.5, 8.75, 493.25));
    assert_eq!((read.pitch, read.yaw, read.roll), (0.5, 1.5, -0.25));
    assert_eq!((read.acceleration[0], read.acceleration[2]), (1.0, -2.0));
    assert_eq!(read.acceleration[1].to_bits(), 0x7FC0_0000);
}

// Shows OBJ-7.
#[test]
fn link_status_is_these_bytes() {
    assert_eq!(LINK_STATUS[28..], reference::crc(reference::FRAME, &LINK_STATUS[..28]).to_be_bytes());
    let values = LinkValues {
        timestamp: 5_000,
        status: LinkStatusBits::new().with_link_up(true).with_all_accepted(true),
        objects_accepted: 4_000,
        objects_rejected: 1,
        frames_received: 1_000,
        frames_missed: 2,
        age_100us: LinkValues::age(5_300),
        access_violations: 7,
    };
    let sealed = LinkStatus::seal(&values);
    assert_eq!(sealed.as_bytes(), &LINK_STATUS);
    assert_eq!(LinkStatus::verify(&LINK_STATUS).map(LinkStatus::values), Ok(values));
}

#[test]
fn a_request_is_these_bytes() {
    assert_eq!(REQUEST[4..], reference::crc(reference::FRAME, &REQUEST[..4]).to_be_bytes());
    assert_eq!(ssi::encode(Request { offset: 32, length: 64 }), REQUEST);
}

#[test]
fn a_profile_is_its_objects_and_nothing_else() {
    let reported = ReportedPosition::seal(&reported_values());
    let gps = GpsObject::seal(Identifier::gps(1), &gps_values());
    let profile = Profile::new(reported, [gps]);
    assert_eq!(profile.as_bytes(), [&REPORTED_POSITION[..], &GPS1].concat());
    assert_eq!(Profile::<1>::seal(&reported_values(), &[gps_values()]), profile);
    assert_eq!((profile.reported(), profile.gps()), (&reported, &[gps]));
}

#[test]
fn an_image_is_link_status_and_the_profile() {
    let mut image = Image::<1>::EMPTY;
    image.set_link(*LinkStatus::verify(&LINK_STATUS).expect("valid"));
    image.object_mut(0).expect("Reported-Position").copy_from_slice(&REPORTED_POSITION);
    image.object_mut(1).expect("GPS1").copy_from_slice(&GPS1);
    assert_eq!(image.as_bytes(), [&LINK_STATUS[..], &REPORTED_POSITION, &GPS1].concat());
    assert_eq!((image::LINK_STATUS, image::REPORTED_POSITION, image::GPS), (0, 32, 96));
}

#[test]
fn what_is_not_known_is_the_canonical_quiet_nan() {
    let gps = GpsObject::seal(Identifier::gps(1), &GpsValues::absent(0));
    let reported = ReportedPosition::seal(&ReportedValues::absent(0));
    let (f64_nan, f32_nan) = ([0, 0, 0, 0, 0, 0, 0xF8, 0x7F], [0, 0, 0xC0, 0x7F]);
    assert_eq!(gps.as_bytes()[6..32], [&[0, 0xFC][..], &f64_nan, &f64_nan, &f64_nan].concat());
    assert_eq!(gps.as_bytes()[32..56], f32_nan.repeat(6));
    assert_eq!(reported.as_bytes()[6..24], [&[0, 0][..], &f64_nan, &f64_nan].concat());
    assert_eq!(reported.as_bytes()[28..36], f64_nan);
    assert_eq!(reported.as_bytes()[36..60], f32_nan.repeat(6));
    assert_eq!(ABSENT_F32.to_bits(), 0x7FC0_0000);
    assert_eq!(ABSENT_F64.to_bits(), 0x7FF8_0000_0000_0000);
}
