//! Link-Status: the DPR's report about itself and the link.
use core::mem::offset_of;

use bytemuck::{Pod, Zeroable};

use crate::{
    Identifier, LinkStatusBits, Rejection,
    object_macro::object,
    wire::{CrcBe, U16Le, U32Le},
};

/// The contents of Link-Status in plain numbers. Counters count from the DPR's start and wrap unless stated otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkValues {
    /// The timestamp, ms since the DPR's start, wraps.
    pub timestamp: u32,
    /// The state of the link.
    pub status: LinkStatusBits,
    /// Objects of HORUS that the DPR accepted.
    pub objects_accepted: u32,
    /// Objects of HORUS that the DPR rejected.
    pub objects_rejected: u32,
    /// Frames of HORUS that the DPR received, whether their objects were accepted or not.
    pub frames_received: u32,
    /// Frames of HORUS that were due and did not arrive.
    pub frames_missed: u32,
    /// The age of Reported-Position when the image was made, in units of 100 µs; 65535 stands for 6.5535 s or more.
    pub age_100us: u16,
    /// Accesses over the SSI that were refused; the counter saturates at 65535.
    pub access_violations: u16,
}

impl LinkValues {
    /// Converts `age_us`, µs, to units of 100 µs, rounded down, at most 65535, for [`LinkValues::age_100us`].
    ///
    /// ```
    /// assert_eq!(profile::LinkValues::age(5_299), 52);
    /// assert_eq!(profile::LinkValues::age(u32::MAX), u16::MAX);
    /// ```
    #[must_use]
    pub fn age(age_us: u32) -> u16 {
        u16::try_from(age_us / 100).unwrap_or(u16::MAX)
    }
}

/// A Link-Status object of 32 bytes. The last four bytes are the frame CRC of the other 28.
#[derive(Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
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

object!(LinkStatus, 32 bytes, status: LinkStatusBits, timestamp: "ms since DPR start, wraps.", also shown: []);

const _: () = {
    assert!(offset_of!(LinkStatus, objects_accepted) == 8);
    assert!(offset_of!(LinkStatus, objects_rejected) == 12);
    assert!(offset_of!(LinkStatus, frames_received) == 16);
    assert!(offset_of!(LinkStatus, frames_missed) == 20);
    assert!(offset_of!(LinkStatus, age_100us) == 24);
    assert!(offset_of!(LinkStatus, access_violations) == 26);
};

impl LinkStatus {
    /// Seals `values` in an object with its CRC.
    #[must_use]
    pub fn seal(values: &LinkValues) -> Self {
        Self {
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
        }
        .sealed()
    }

    /// The Link-Status in `bytes`, if it is intact.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if `bytes` are not 32, [`Rejection::Crc`] if they are damaged, [`Rejection::Identifier`]
    /// if they are another object.
    pub fn verify(bytes: &[u8]) -> Result<&Self, Rejection> {
        let (object, findings) = Self::look(bytes)?;
        findings.check(object.identifier() == Identifier::LINK_STATUS, Rejection::Identifier).judge(object)
    }

    /// The contents of Link-Status in plain numbers.
    #[must_use]
    pub const fn values(&self) -> LinkValues {
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
}
