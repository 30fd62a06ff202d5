//! UBX messages that are encoded by hand from the interface description (u-blox F9 HPG, UBX-NAV and UBX-ESF chapters),
//! independently of the parser under test.
#![allow(dead_code, unreachable_pub, reason = "each test file uses its own part of this")]

/// Makes a whole message: sync, class, identifier, length, payload, checksum.
pub fn message(class: u8, id: u8, payload: &[u8]) -> Vec<u8> {
    let length = u16::try_from(payload.len()).expect("a UBX payload has a 16-bit length");
    let mut message = vec![0xB5, 0x62, class, id];
    message.extend(length.to_le_bytes());
    message.extend(payload);
    let (mut a, mut b) = (0u8, 0u8);
    for byte in &message[2..] {
        a = a.wrapping_add(*byte);
        b = b.wrapping_add(a);
    }
    message.extend([a, b]);
    message
}

/// The values of NAV-PVT that the tests set. Its payload has 92 bytes.
#[derive(Clone, Copy, Debug)]
pub struct NavPvt {
    pub itow: u32,
    pub fix: u8,
    pub flags: u8,
    pub flags3: u8,
    pub longitude: i32,
    pub latitude: i32,
    pub height: i32,
    /// The velocity, mm/s north, east, down.
    pub velocity: [i32; 3],
    /// The accuracies, mm, horizontal and vertical.
    pub accuracies: [u32; 2],
}

impl NavPvt {
    pub const GOOD: Self = Self {
        itow: 1_000,
        fix: 3,
        flags: 1,
        flags3: 0,
        longitude: 87_291_234,
        latitude: 474_987_654,
        height: 512_345,
        velocity: [0; 3],
        accuracies: [1_500, 2_500],
    };

    pub fn at(itow: u32) -> Self {
        Self { itow, ..Self::GOOD }
    }

    pub fn bytes(&self) -> Vec<u8> {
        let mut payload = [0u8; 92];
        payload[0..4].copy_from_slice(&self.itow.to_le_bytes());
        payload[20] = self.fix;
        payload[21] = self.flags;
        payload[24..28].copy_from_slice(&self.longitude.to_le_bytes());
        payload[28..32].copy_from_slice(&self.latitude.to_le_bytes());
        payload[32..36].copy_from_slice(&self.height.to_le_bytes());
        // The height above mean sea level differs from the height above the ellipsoid, so that a mix-up of the two
        // fails a test.
        payload[36..40].copy_from_slice(&(self.height.wrapping_sub(48_000)).to_le_bytes());
        for (at, accuracy) in (40..).step_by(4).zip(self.accuracies) {
            payload[at..at + 4].copy_from_slice(&accuracy.to_le_bytes());
        }
        for (at, velocity) in (48..).step_by(4).zip(self.velocity) {
            payload[at..at + 4].copy_from_slice(&velocity.to_le_bytes());
        }
        payload[78] = self.flags3;
        message(0x01, 0x07, &payload)
    }
}

/// Returns a NAV-ATT message with 32 bytes of payload: angles roll, pitch, heading in 1e-5 degrees, then their
/// accuracies.
pub fn nav_att(itow: u32, angles: [i32; 3], accuracies: [u32; 3]) -> Vec<u8> {
    let mut payload = [0u8; 32];
    payload[0..4].copy_from_slice(&itow.to_le_bytes());
    for (at, angle) in (8..).step_by(4).zip(angles) {
        payload[at..at + 4].copy_from_slice(&angle.to_le_bytes());
    }
    for (at, accuracy) in (20..).step_by(4).zip(accuracies) {
        payload[at..at + 4].copy_from_slice(&accuracy.to_le_bytes());
    }
    message(0x01, 0x05, &payload)
}

/// Returns ESF-INS, with 36 bytes of payload: `valid` flags x, y and z; accelerations are in 1e-2 m/s².
pub fn esf_ins(itow: u32, valid: [bool; 3], accelerations: [i32; 3]) -> Vec<u8> {
    let mut payload = [0u8; 36];
    let bits = valid.into_iter().enumerate().fold(1u32, |bits, (axis, valid)| bits | u32::from(valid) << (11 + axis));
    payload[0..4].copy_from_slice(&bits.to_le_bytes());
    payload[8..12].copy_from_slice(&itow.to_le_bytes());
    for (at, acceleration) in (24..).step_by(4).zip(accelerations) {
        payload[at..at + 4].copy_from_slice(&acceleration.to_le_bytes());
    }
    message(0x10, 0x15, &payload)
}

pub const NMEA: &[u8] = b"$GNGGA,083559.00,4729.92592,N,00843.74740,E,1,12,0.71,464.2,M,48.0,M,,*4B\r\n";
