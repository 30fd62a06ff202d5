//! Link-Status: what the DPR says about itself and the link.
use core::mem::{offset_of, size_of};

use bytemuck::{Pod, Zeroable};

use crate::{
    Identifier, LinkStatusBits, Rejection, crc,
    wire::{CrcBe, U16Le, U32Le},
};

/// What Link-Status carries, in plain numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkValues {
    /// ms since DPR start, wraps.
    pub timestamp: u32,
    /// How the link does.
    pub status: LinkStatusBits,
    /// Objects accepted since DPR start, wraps.
    pub objects_accepted: u32,
    /// Objects rejected since DPR start, wraps.
    pub objects_rejected: u32,
    /// Frames received since DPR start, wraps.
    pub frames_received: u32,
    /// Frames missed since DPR start, wraps.
    pub frames_missed: u32,
    /// Age of Reported-Position when the image was made, 100 µs, saturating.
    pub age_100us: u16,
    /// Accesses over SSI that were refused, since DPR start.
    pub access_violations: u16,
}

impl LinkValues {
    /// `micros` µs as an age in units of 100 µs, rounded down, 65535 if it is more.
    #[must_use]
    pub fn age(micros: u32) -> u16 {
        u16::try_from(micros / 100).unwrap_or(u16::MAX)
    }
}

/// Link-Status object, 32 bytes.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct LinkStatus {
    timestamp: U32Le,
    identifier: U16Le,
    status: U16Le,
    objects_accepted: U32Le,
    objects_rejected: U32Le,
    frames_received: U32Le,
    frames_missed: U32Le,
    age_100us: U16Le,
    access_violations: U16Le,
    crc: CrcBe,
}

const _: () = {
    assert!(size_of::<LinkStatus>() == LinkStatus::SIZE && align_of::<LinkStatus>() == 1);
    assert!(offset_of!(LinkStatus, crc) == 28);
};

impl LinkStatus {
    /// Bytes.
    pub const SIZE: usize = 32;

    /// All zero, as a buffer is before anything has been put there: does not verify.
    pub const EMPTY: Self = bytemuck::zeroed();

    /// The object that carries `values`, CRC computed.
    #[must_use]
    pub fn seal(values: &LinkValues) -> Self {
        let mut object = Self {
            timestamp: U32Le::new(values.timestamp),
            identifier: U16Le::new(Identifier::LINK_STATUS.0),
            status: U16Le::new(values.status.bits()),
            objects_accepted: U32Le::new(values.objects_accepted),
            objects_rejected: U32Le::new(values.objects_rejected),
            frames_received: U32Le::new(values.frames_received),
            frames_missed: U32Le::new(values.frames_missed),
            age_100us: U16Le::new(values.age_100us),
            access_violations: U16Le::new(values.access_violations),
            crc: CrcBe::UNSEALED,
        };
        let [covered @ .., _, _, _, _] = object.as_bytes();
        object.crc = CrcBe::new(crc::frame(covered));
        object
    }

    /// The object in `bytes`, if it is intact and Link-Status.
    ///
    /// # Errors
    ///
    /// [`Rejection`] says why not.
    pub fn verify(bytes: &[u8]) -> Result<&Self, Rejection> {
        let bytes: &[u8; Self::SIZE] = bytes.try_into().map_err(|_| Rejection::Length)?;
        let object: &Self = bytemuck::must_cast_ref(bytes);
        let intact = crc::frame_intact(bytes);
        let in_place = object.identifier() == Identifier::LINK_STATUS;
        if !intact {
            Err(Rejection::Crc)
        } else if !in_place {
            Err(Rejection::Identifier)
        } else {
            Ok(object)
        }
    }

    /// The values it carries.
    #[must_use]
    pub fn values(&self) -> LinkValues {
        LinkValues {
            timestamp: self.timestamp.get(),
            status: self.status(),
            objects_accepted: self.objects_accepted.get(),
            objects_rejected: self.objects_rejected.get(),
            frames_received: self.frames_received.get(),
            frames_missed: self.frames_missed.get(),
            age_100us: self.age_100us.get(),
            access_violations: self.access_violations.get(),
        }
    }

    /// Which object it says it is.
    #[must_use]
    pub const fn identifier(&self) -> Identifier {
        Identifier(self.identifier.get())
    }

    /// ms since DPR start, wraps.
    #[must_use]
    pub const fn timestamp(&self) -> u32 {
        self.timestamp.get()
    }

    /// Its status bits.
    #[must_use]
    pub const fn status(&self) -> LinkStatusBits {
        LinkStatusBits::from_bits(self.status.get())
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
