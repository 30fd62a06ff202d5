//! The two objects that HORUS sends.
use core::mem::{offset_of, size_of};

use bytemuck::{Pod, Zeroable};

use crate::{
    GpsStatus, Identifier, Rejection, ReportedStatus, crc,
    wire::{CrcBe, F32Le, F64Le, U16Le, U32Le},
};

/// What a receiver says, in plain numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GpsValues {
    /// ms since HORUS start, wraps.
    pub timestamp: u32,
    /// Which of the values are valid, and how the receiver does.
    pub status: GpsStatus,
    /// Degrees, WGS-84, north positive.
    pub latitude: f64,
    /// Degrees, WGS-84, east positive.
    pub longitude: f64,
    /// m above the WGS-84 ellipsoid.
    pub altitude: f64,
    /// rad, nose up positive.
    pub pitch: f32,
    /// rad from true north, clockwise.
    pub yaw: f32,
    /// rad, right wing down positive.
    pub roll: f32,
    /// m/s², body frame front, right, down, gravity removed.
    pub acceleration: [f32; 3],
}

impl GpsValues {
    /// Nothing known at `timestamp`: every value NaN, every status bit clear.
    #[must_use]
    pub const fn absent(timestamp: u32) -> Self {
        Self {
            timestamp,
            status: GpsStatus::new(),
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

/// What HORUS reports as its position, in plain numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReportedValues {
    /// ms since HORUS start, wraps.
    pub timestamp: u32,
    /// Which of the values are valid, and what HORUS is doing.
    pub status: ReportedStatus,
    /// Degrees, WGS-84, north positive.
    pub latitude: f64,
    /// Degrees, WGS-84, east positive.
    pub longitude: f64,
    /// m above the WGS-84 ellipsoid.
    pub altitude: f64,
    /// rad, nose up positive.
    pub pitch: f32,
    /// rad from true north, clockwise.
    pub yaw: f32,
    /// rad, right wing down positive.
    pub roll: f32,
    /// m/s², body frame front, right, down, gravity removed.
    pub acceleration: [f32; 3],
}

impl ReportedValues {
    /// Nothing known at `timestamp`: every value NaN, every status bit clear (HORUS starting).
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

/// A binary32 that the receiver does not give: the canonical quiet NaN.
pub const ABSENT_F32: f32 = f32::from_bits(0x7FC0_0000);

/// A binary64 that the receiver does not give: the canonical quiet NaN.
pub const ABSENT_F64: f64 = f64::from_bits(0x7FF8_0000_0000_0000);

/// GPS object, 60 bytes.
#[derive(Clone, Copy, Pod, Zeroable)]
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

const _: () = {
    assert!(size_of::<GpsObject>() == GpsObject::SIZE && align_of::<GpsObject>() == 1);
    assert!(offset_of!(GpsObject, crc) == 56);
};

impl GpsObject {
    /// Bytes.
    pub const SIZE: usize = 60;

    /// All zero, as a buffer is before anything has been put there: does not verify.
    pub const EMPTY: Self = bytemuck::zeroed();

    /// The object that carries `values`, CRC computed.
    #[must_use]
    pub fn seal(identifier: Identifier, values: &GpsValues) -> Self {
        let mut object = Self {
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
        };
        let [covered @ .., _, _, _, _] = object.as_bytes();
        object.crc = CrcBe::new(crc::frame(covered));
        object
    }

    /// The object in `bytes`, if it is intact and `expected` here.
    ///
    /// # Errors
    ///
    /// [`Rejection`] says why not.
    pub fn verify(bytes: &[u8], expected: Identifier) -> Result<&Self, Rejection> {
        let bytes: &[u8; Self::SIZE] = bytes.try_into().map_err(|_| Rejection::Length)?;
        let object: &Self = bytemuck::must_cast_ref(bytes);
        let intact = crc::frame_intact(bytes);
        let in_place = object.identifier() == expected;
        if !intact {
            Err(Rejection::Crc)
        } else if !in_place {
            Err(Rejection::Identifier)
        } else {
            Ok(object)
        }
    }

    /// The values it carries, to the last bit.
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

    /// Which object it says it is.
    #[must_use]
    pub const fn identifier(&self) -> Identifier {
        Identifier(self.identifier.get())
    }

    /// ms since HORUS start, wraps.
    #[must_use]
    pub const fn timestamp(&self) -> u32 {
        self.timestamp.get()
    }

    /// Its status bits.
    #[must_use]
    pub const fn status(&self) -> GpsStatus {
        GpsStatus::from_bits(self.status.get())
    }

    /// The CRC it carries, which may be wrong.
    #[must_use]
    pub const fn crc(&self) -> u32 {
        self.crc.get()
    }

    /// As on the wire.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8; Self::SIZE] {
        bytemuck::must_cast_ref(self)
    }
}

/// Reported-Position object, 64 bytes.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct ReportedPosition {
    timestamp: U32Le,
    identifier: U16Le,
    status: U16Le,
    latitude: F64Le,
    longitude: F64Le,
    position_crc: CrcBe,
    altitude: F64Le,
    pitch: F32Le,
    yaw: F32Le,
    roll: F32Le,
    acceleration: [F32Le; 3],
    crc: CrcBe,
}

const _: () = {
    assert!(
        size_of::<ReportedPosition>() == ReportedPosition::SIZE
            && align_of::<ReportedPosition>() == 1
    );
    assert!(offset_of!(ReportedPosition, crc) == 60);
};

impl ReportedPosition {
    /// Bytes.
    pub const SIZE: usize = 64;

    /// All zero, as a buffer is before anything has been put there: does not verify.
    pub const EMPTY: Self = bytemuck::zeroed();

    /// The object that carries `values`, both CRCs computed.
    #[must_use]
    pub fn seal(values: &ReportedValues) -> Self {
        let mut object = Self {
            timestamp: U32Le::new(values.timestamp),
            identifier: U16Le::new(Identifier::REPORTED_POSITION.0),
            status: U16Le::new(values.status.bits()),
            latitude: F64Le::new(values.latitude),
            longitude: F64Le::new(values.longitude),
            position_crc: CrcBe::UNSEALED,
            altitude: F64Le::new(values.altitude),
            pitch: F32Le::new(values.pitch),
            yaw: F32Le::new(values.yaw),
            roll: F32Le::new(values.roll),
            acceleration: values.acceleration.map(F32Le::new),
            crc: CrcBe::UNSEALED,
        };
        let [position @ .., _, _, _, _] = object.position_codeword();
        object.position_crc = CrcBe::new(crc::position(position));
        let [covered @ .., _, _, _, _] = object.as_bytes();
        object.crc = CrcBe::new(crc::frame(covered));
        object
    }

    /// The object in `bytes`, if it is intact and Reported-Position.
    ///
    /// # Errors
    ///
    /// [`Rejection`] says why not.
    pub fn verify(bytes: &[u8]) -> Result<&Self, Rejection> {
        let bytes: &[u8; Self::SIZE] = bytes.try_into().map_err(|_| Rejection::Length)?;
        let object: &Self = bytemuck::must_cast_ref(bytes);
        let intact = crc::frame_intact(bytes);
        let position_intact = crc::position_intact(object.position_codeword());
        let in_place = object.identifier() == Identifier::REPORTED_POSITION;
        if !intact {
            Err(Rejection::Crc)
        } else if !position_intact {
            Err(Rejection::PositionCrc)
        } else if !in_place {
            Err(Rejection::Identifier)
        } else {
            Ok(object)
        }
    }

    /// Latitude, longitude and the CRC over them: 20 bytes.
    fn position_codeword(&self) -> &[u8; 20] {
        let (_, from_latitude) = self
            .as_bytes()
            .split_first_chunk::<8>()
            .unwrap_or((&[0; 8], &[]));
        from_latitude.first_chunk().unwrap_or(&[0; 20])
    }

    /// The values it carries, to the last bit.
    #[must_use]
    pub fn values(&self) -> ReportedValues {
        ReportedValues {
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

    /// Which object it says it is.
    #[must_use]
    pub const fn identifier(&self) -> Identifier {
        Identifier(self.identifier.get())
    }

    /// ms since HORUS start, wraps.
    #[must_use]
    pub const fn timestamp(&self) -> u32 {
        self.timestamp.get()
    }

    /// Its status bits.
    #[must_use]
    pub const fn status(&self) -> ReportedStatus {
        ReportedStatus::from_bits(self.status.get())
    }

    /// The frame CRC it carries, which may be wrong.
    #[must_use]
    pub const fn crc(&self) -> u32 {
        self.crc.get()
    }

    /// The position CRC it carries, which may be wrong.
    #[must_use]
    pub const fn position_crc(&self) -> u32 {
        self.position_crc.get()
    }

    /// As on the wire.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8; Self::SIZE] {
        bytemuck::must_cast_ref(self)
    }
}
