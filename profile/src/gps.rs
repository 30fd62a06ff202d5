//! GPS1 to GPS5: each receiver's solution for position, attitude and acceleration (paper, Table 3).
use core::mem::offset_of;

use bytemuck::{Pod, Zeroable};

use crate::{
    ABSENT_F32, ABSENT_F64, GpsStatus, Identifier, Rejection, crc,
    object_macro::object,
    wire::{CrcBe, F32Le, F64Le, U16Le, U32Le},
};

/// A receiver's solution in plain numbers.
///
/// A missing value is NaN ([`ABSENT_F64`], [`ABSENT_F32`]), and its status bit is clear. NaN equals nothing, so compare
/// [sealed objects](GpsObject) to compare all bits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GpsValues {
    /// The timestamp of the cycle, ms since HORUS's start, wraps; equal in all objects of a profile.
    pub timestamp: u32,
    /// The validity of the values, and the receiver's state.
    pub status: GpsStatus,
    /// The latitude, degrees, WGS-84, north positive, -90 to 90.
    pub latitude: f64,
    /// The longitude, degrees, WGS-84, east positive, -180 to 180.
    pub longitude: f64,
    /// The altitude, m above the WGS-84 ellipsoid (not above mean sea level).
    pub altitude: f64,
    /// The pitch, rad, nose up positive, -π/2 to π/2.
    pub pitch: f32,
    /// The yaw, rad, clockwise from true north.
    pub yaw: f32,
    /// The roll, rad, right side down positive.
    pub roll: f32,
    /// The acceleration, m/s² along x, y, z of the body frame: front, right, down. Gravity is removed.
    pub acceleration: [f32; 3],
}

impl GpsValues {
    /// Returns the values at `timestamp`, ms, of a receiver that never had a solution. Every value is NaN and every
    /// status bit is clear, except the bits of the solution's age, which say that there was none.
    #[must_use]
    pub const fn absent(timestamp: u32) -> Self {
        Self {
            timestamp,
            status: GpsStatus::new().with_solution_age_ms(None),
            latitude: ABSENT_F64,
            longitude: ABSENT_F64,
            altitude: ABSENT_F64,
            pitch: ABSENT_F32,
            yaw: ABSENT_F32,
            roll: ABSENT_F32,
            acceleration: [ABSENT_F32; 3],
        }
    }
}

/// A GPS object of 60 bytes. The last four bytes are the frame CRC of the other 56.
#[derive(Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct GpsObject {
    timestamp: U32Le,
    identifier: U16Le,
    status: U16Le,
    latitude: F64Le,
    longitude: F64Le,
    altitude: F64Le,
    pitch: F32Le,
    yaw: F32Le,
    roll: F32Le,
    acceleration: [F32Le; 3],
    crc: CrcBe,
}

object!(GpsObject, 60 bytes, status: GpsStatus, timestamp: "ms since HORUS start, wraps.", also shown: []);

const _: () = {
    assert!(offset_of!(GpsObject, latitude) == 8);
    assert!(offset_of!(GpsObject, longitude) == 16);
    assert!(offset_of!(GpsObject, altitude) == 24);
    assert!(offset_of!(GpsObject, pitch) == 32);
    assert!(offset_of!(GpsObject, yaw) == 36);
    assert!(offset_of!(GpsObject, roll) == 40);
    assert!(offset_of!(GpsObject, acceleration) == 44);
};

impl GpsObject {
    /// Seals `values` in an object with its CRC.
    ///
    /// `identifier` should be one of [`Identifier::GPS`]; no profile accepts an object with another one.
    #[must_use]
    pub fn seal(identifier: Identifier, values: &GpsValues) -> Self {
        Self {
            timestamp: U32Le::new(values.timestamp),
            identifier: U16Le::new(identifier.0),
            status: U16Le::new(values.status.bits()),
            latitude: F64Le::new(values.latitude),
            longitude: F64Le::new(values.longitude),
            altitude: F64Le::new(values.altitude),
            pitch: F32Le::new(values.pitch),
            yaw: F32Le::new(values.yaw),
            roll: F32Le::new(values.roll),
            acceleration: values.acceleration.map(F32Le::new),
            crc: CrcBe::UNSEALED,
        }
        .sealed()
    }

    /// The GPS object in `bytes`, if it is intact and has the `expected` identifier.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if `bytes` are not 60, [`Rejection::Crc`] if they are damaged, [`Rejection::Identifier`]
    /// if they are another object.
    ///
    /// ```
    /// use profile::{GpsObject, GpsValues, Identifier, Rejection};
    ///
    /// let sealed = GpsObject::seal(Identifier::gps(1), &GpsValues::absent(0));
    /// assert_eq!(GpsObject::verify(sealed.as_bytes(), Identifier::gps(1)), Ok(&sealed));
    /// assert_eq!(GpsObject::verify(sealed.as_bytes(), Identifier::gps(2)), Err(Rejection::Identifier));
    /// ```
    pub fn verify(bytes: &[u8], expected: Identifier) -> Result<&Self, Rejection> {
        let (object, findings) = Self::look(bytes)?;
        findings.check(object.identifier() == expected, Rejection::Identifier).judge(object)
    }

    /// Does the same as [`verify`](Self::verify), with the frame CRC already `begun` over the first of `bytes`.
    ///
    /// # Errors
    ///
    /// The errors are those of [`verify`](Self::verify).
    pub fn verify_begun(bytes: &[u8], expected: Identifier, begun: crc::Begun) -> Result<&Self, Rejection> {
        // Not covered: only this line, the wrong length: `Early::advance` of the DPR cuts the bytes to the object's
        // size before.
        let bytes: &[u8; Self::SIZE] = bytes.try_into().map_err(|_| Rejection::Length)?;
        let (object, findings) = Self::found(bytes, begun.is_intact(bytes));
        findings.check(object.identifier() == expected, Rejection::Identifier).judge(object)
    }

    /// The contents of the GPS object in plain numbers, unchanged to the last bit.
    #[must_use]
    pub fn values(&self) -> GpsValues {
        GpsValues {
            timestamp: self.timestamp.get(),
            status: self.status(),
            latitude: self.latitude.get(),
            longitude: self.longitude.get(),
            altitude: self.altitude.get(),
            pitch: self.pitch.get(),
            yaw: self.yaw.get(),
            roll: self.roll.get(),
            acceleration: self.acceleration.map(F32Le::get),
        }
    }
}
