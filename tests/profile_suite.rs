//! Tests the profile's code on the target. Both boards' suites contain the same code, so each board verifies objects as
//! the other board seals them.

use profile::{crc, GpsObject, GpsStatus, GpsValues, Identifier, Profile, Rejection, ReportedPosition, ReportedValues};

use crate::cycles::{Bounds, Cycles};

/// The number of receivers in the profile of the suites.
pub const RECEIVERS: usize = 3;

const CHECK: &[u8] = b"123456789";

/// Asserts that both CRCs give their check values (docs/design.md#crc: 0x12D3A0B1 and 0xEA8707AB).
pub fn check_values() {
    defmt::assert_eq!(crc::frame(CHECK), 0x12D3_A0B1);
    defmt::assert_eq!(crc::position(CHECK), 0xEA87_07AB);
}

fn values(timestamp: u32) -> GpsValues {
    GpsValues {
        status: GpsStatus::new().with_position_valid(true),
        latitude: 47.497_912_3,
        longitude: 8.729_058_7,
        altitude: 470.25,
        pitch: 0.1,
        yaw: -2.5,
        roll: -0.2,
        acceleration: [0.5, -0.25, 9.75],
        ..GpsValues::absent(timestamp)
    }
}

/// Returns the values of a whole profile.
pub fn inputs(timestamp: u32) -> (ReportedValues, [GpsValues; RECEIVERS]) {
    let gps = values(timestamp);
    let reported =
        ReportedValues { latitude: gps.latitude, longitude: gps.longitude, ..ReportedValues::absent(timestamp) };
    (reported, [gps, values(timestamp), GpsValues::absent(timestamp)])
}

/// Asserts that a sealed profile verifies, and that its values are read back. Absent values are compared bit by bit.
pub fn seal_and_verify() {
    let (reported, gps) = inputs(1230);
    let profile = Profile::<RECEIVERS>::seal(&reported, &gps);
    let reading = profile.verify();
    defmt::assert!(reading.complete());
    let back = defmt::unwrap!(reading.gps[0].ok()).values();
    defmt::assert_eq!(back.latitude.to_bits(), gps[0].latitude.to_bits());
    let absent = defmt::unwrap!(reading.gps[2].ok()).values();
    defmt::assert_eq!(absent.latitude.to_bits(), 0x7FF8_0000_0000_0000);
    defmt::assert_eq!(absent.pitch.to_bits(), 0x7FC0_0000);
}

/// Asserts that every single wrong bit in a sealed object is detected.
pub fn every_wrong_bit_is_found() {
    let (reported, gps) = inputs(1230);
    let object = *GpsObject::seal(Identifier::gps(1), &gps[0]).as_bytes();
    let position = *ReportedPosition::seal(&reported).as_bytes();
    for bit in 0..object.len() * 8 {
        let mut damaged = object;
        damaged[bit / 8] ^= 1 << (bit % 8);
        defmt::assert!(GpsObject::verify(&damaged, Identifier::gps(1)).is_err(), "bit {=usize}", bit);
    }
    for bit in 0..position.len() * 8 {
        let mut damaged = position;
        damaged[bit / 8] ^= 1 << (bit % 8);
        defmt::assert!(ReportedPosition::verify(&damaged).is_err(), "bit {=usize}", bit);
    }
}

/// Asserts that a scrubbed object is rejected, and that an object in the place of another one is rejected, too.
pub fn nothing_but_the_object_in_its_place() {
    for fill in [0x00, 0xFF] {
        defmt::assert!(GpsObject::verify(&[fill; GpsObject::SIZE], Identifier::gps(1)).is_err());
        defmt::assert!(ReportedPosition::verify(&[fill; ReportedPosition::SIZE]).is_err());
    }
    let object = GpsObject::seal(Identifier::gps(2), &values(10));
    defmt::assert!(matches!(GpsObject::verify(object.as_bytes(), Identifier::gps(1)), Err(Rejection::Identifier)));
}

/// Asserts the bounds of the time to seal and to verify a whole profile, in cycles, whatever the data.
pub fn bounds(cycles: &Cycles, seal: Bounds, verify: Bounds) {
    let zeros = (ReportedValues::absent(0), [GpsValues::absent(0); RECEIVERS]);
    let ones = inputs(u32::MAX);
    cycles
        .over([zeros, inputs(10), inputs(1230), ones], |(reported, gps)| Profile::<RECEIVERS>::seal(reported, gps))
        .assert("Profile::seal", seal);

    let good = Profile::<RECEIVERS>::seal(&inputs(10).0, &inputs(10).1);
    let mut bytes = [[0; Profile::<RECEIVERS>::SIZE]; 4];
    bytes[0].copy_from_slice(good.as_bytes());
    bytes[1] = bytes[0];
    bytes[1][9] ^= 1; // the first object is damaged in its position
    bytes[2] = [0xFF; Profile::<RECEIVERS>::SIZE];
    cycles
        .over(bytes, |bytes| Profile::<RECEIVERS>::read(bytes).map(|reading| reading.complete()).unwrap_or(false))
        .assert("Profile::verify", verify);
}
