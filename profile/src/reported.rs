//! Reported-Position, the position that holds for the sampling period (paper, Table 2).
use core::mem::offset_of;

use bytemuck::{Pod, Zeroable};

use crate::{
    ABSENT_F32, ABSENT_F64, Identifier, Rejection, ReportedStatus, crc,
    object_macro::object,
    rejection::Findings,
    wire::{CrcBe, F32Le, F64Le, U16Le, U32Le},
};

/// The contents of Reported-Position in plain numbers.
///
/// A missing value is NaN ([`ABSENT_F64`], [`ABSENT_F32`]), and its status bit is clear. NaN equals nothing, so compare
/// [sealed objects](ReportedPosition) to compare all bits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReportedValues {
    /// The timestamp of the cycle, ms since HORUS's start, wraps. It is one [cycle](crate::CYCLE_MS) later in each
    /// profile.
    pub timestamp: u32,
    /// The validity of the values, the number of agreeing receivers, and HORUS's state.
    pub status: ReportedStatus,
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

impl ReportedValues {
    /// The values of a starting HORUS at `timestamp`, ms: every value is NaN, every status bit clear.
    #[must_use]
    pub const fn absent(timestamp: u32) -> Self {
        Self {
            timestamp,
            status: ReportedStatus::new(),
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

/// Latitude and longitude with their own CRC: a codeword of 20 bytes within the object's codeword.
#[derive(Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
struct Position {
    latitude: F64Le,
    longitude: F64Le,
    crc: CrcBe,
}

impl Position {
    fn seal(latitude: f64, longitude: f64) -> Self {
        let mut position =
            Self { latitude: F64Le::new(latitude), longitude: F64Le::new(longitude), crc: CrcBe::UNSEALED };
        let [covered @ .., _, _, _, _] = position.as_bytes();
        position.crc = CrcBe::new(crc::position(covered));
        position
    }

    const fn as_bytes(&self) -> &[u8; 20] {
        bytemuck::must_cast_ref(self)
    }
}

/// A Reported-Position object of 64 bytes. The last four bytes are the frame CRC of the other 60.
#[derive(Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct ReportedPosition {
    timestamp: U32Le,
    identifier: U16Le,
    status: U16Le,
    position: Position,
    altitude: F64Le,
    pitch: F32Le,
    yaw: F32Le,
    roll: F32Le,
    acceleration: [F32Le; 3],
    crc: CrcBe,
}

object!(
    ReportedPosition, 64 bytes, status: ReportedStatus, timestamp: "ms since HORUS start, wraps.",
    also shown: [position_crc]
);

const _: () = {
    assert!(offset_of!(ReportedPosition, position.latitude) == 8);
    assert!(offset_of!(ReportedPosition, position.longitude) == 16);
    assert!(offset_of!(ReportedPosition, position.crc) == 24);
    assert!(offset_of!(ReportedPosition, altitude) == 28);
    assert!(offset_of!(ReportedPosition, pitch) == 36);
    assert!(offset_of!(ReportedPosition, yaw) == 40);
    assert!(offset_of!(ReportedPosition, roll) == 44);
    assert!(offset_of!(ReportedPosition, acceleration) == 48);
};

impl ReportedPosition {
    /// Seals `values` in an object with both CRCs.
    #[must_use]
    pub fn seal(values: &ReportedValues) -> Self {
        Self {
            timestamp: U32Le::new(values.timestamp),
            identifier: U16Le::new(Identifier::REPORTED_POSITION.0),
            status: U16Le::new(values.status.bits()),
            position: Position::seal(values.latitude, values.longitude),
            altitude: F64Le::new(values.altitude),
            pitch: F32Le::new(values.pitch),
            yaw: F32Le::new(values.yaw),
            roll: F32Le::new(values.roll),
            acceleration: values.acceleration.map(F32Le::new),
            crc: CrcBe::UNSEALED,
        }
        .sealed()
    }

    /// The Reported-Position in `bytes`, if it is intact by both CRCs.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if `bytes` are not 64, [`Rejection::Crc`] if they are damaged, [`Rejection::PositionCrc`]
    /// if only the position CRC is wrong, [`Rejection::Identifier`] if they are another object.
    ///
    /// ```
    /// use profile::{Rejection, ReportedPosition, ReportedValues};
    ///
    /// let sealed = ReportedPosition::seal(&ReportedValues::absent(0));
    /// assert_eq!(ReportedPosition::verify(sealed.as_bytes()), Ok(&sealed));
    /// assert_eq!(ReportedPosition::verify(&[0xFF; ReportedPosition::SIZE]), Err(Rejection::Crc));
    /// ```
    pub fn verify(bytes: &[u8]) -> Result<&Self, Rejection> {
        let (object, findings) = Self::look(bytes)?;
        object.judge(findings)
    }

    /// Does the same as [`verify`](Self::verify), with the frame CRC already `begun` over the first of `bytes`.
    ///
    /// # Errors
    ///
    /// The errors are those of [`verify`](Self::verify).
    pub fn verify_begun(bytes: &[u8], begun: crc::Begun) -> Result<&Self, Rejection> {
        // Not covered: only this line, the wrong length: `Early::advance` of the DPR cuts the bytes to the object's
        // size before.
        let bytes: &[u8; Self::SIZE] = bytes.try_into().map_err(|_| Rejection::Length)?;
        let (object, findings) = Self::found(bytes, begun.is_intact(bytes));
        object.judge(findings)
    }

    fn judge(&self, findings: Findings) -> Result<&Self, Rejection> {
        findings
            .check(crc::position_intact(self.position.as_bytes()), Rejection::PositionCrc)
            .check(self.identifier() == Identifier::REPORTED_POSITION, Rejection::Identifier)
            .judge(self)
    }

    /// The contents of Reported-Position in plain numbers, unchanged to the last bit.
    #[must_use]
    pub fn values(&self) -> ReportedValues {
        ReportedValues {
            timestamp: self.timestamp.get(),
            status: self.status(),
            latitude: self.position.latitude.get(),
            longitude: self.position.longitude.get(),
            altitude: self.altitude.get(),
            pitch: self.pitch.get(),
            yaw: self.yaw.get(),
            roll: self.roll.get(),
            acceleration: self.acceleration.map(F32Le::get),
        }
    }

    /// The position CRC in the object; it may be wrong.
    #[must_use]
    pub const fn position_crc(&self) -> u32 {
        self.position.crc.get()
    }
}
