//! Uplink: an object that the flight controller or, through it, the base station writes into the DPR.
use core::mem::offset_of;

use bytemuck::{Pod, Zeroable};

use crate::{
    Command, CommandObject, Identifier, Rejection,
    criticality::{Writer, WritesUplink},
    object_macro::object,
    wire::{CrcBe, U16Le, U32Le},
};

/// The status of an uplink. The DPR keeps all of its bits, which the writer and the readers define.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct UplinkStatus(u16);

impl UplinkStatus {
    /// The status from the wire.
    #[must_use]
    pub const fn from_bits(bits: u16) -> Self {
        Self(bits)
    }

    /// The status for the wire.
    #[must_use]
    pub const fn bits(self) -> u16 {
        self.0
    }
}

/// The contents of an uplink.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UplinkValues {
    /// The timestamp, ms on the writer's clock, wraps. It must be later than that of the writer's last uplink.
    pub timestamp: u32,
    /// The status bits, which the writer and the readers define.
    pub status: UplinkStatus,
    /// The writer's data; the DPR passes them on unchanged.
    pub payload: [u8; Uplink::PAYLOAD],
}

impl Default for UplinkValues {
    fn default() -> Self {
        Self { timestamp: 0, status: UplinkStatus::default(), payload: [0; Uplink::PAYLOAD] }
    }
}

/// An uplink object of 64 bytes. The last four bytes are the frame CRC of the other 60.
///
/// | bytes | |
/// |---|---|
/// | 0..4 | u32 timestamp of the writer, ms |
/// | 4..6 | u16 identifier, which names the writer |
/// | 6..8 | u16 status |
/// | 8..60 | 52 bytes that the DPR does not read |
/// | 60..64 | [frame CRC](crate::crc) over 0..60 |
///
/// # What the DPR accepts
///
/// The DPR stores an uplink in the [map](crate::map), unchanged, under three conditions. Its CRC is right. Its
/// identifier is one of the two writers'. Its timestamp is *newer* than that of the writer's last stored uplink: less
/// than 2³¹ ms later, so that timestamps may wrap. A writer's first uplink after the DPR's own start counts as newer.
///
/// Any other uplink is refused and has no effect. A writer that has restarted counts from 0 again, so its uplinks are
/// older. When three uplinks in a row are each newer than the one before, the third is stored, and the DPR drops the
/// writer's earlier timestamps. So no single repeated or delayed uplink is stored as a new one. A whole recording that
/// is replayed in order looks like a restarted writer; the writer's radio link or the flight controller must prevent
/// that.
///
/// An uplink that no newer one replaces within [`Uplink::EXPIRY_MS`] becomes zeros, and the writer's bit in
/// [Port-Status](crate::PortStatus) is cleared.
#[derive(Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Uplink {
    timestamp: U32Le,
    identifier: U16Le,
    status: U16Le,
    payload: [u8; Uplink::PAYLOAD],
    crc: CrcBe,
}

object!(Uplink, 64 bytes, status: UplinkStatus, timestamp: "ms on the writer's clock, wraps.", also shown: []);

const _: () = assert!(offset_of!(Uplink, payload) == 8);

impl Uplink {
    /// The number of bytes that the writer may use freely.
    pub const PAYLOAD: usize = 52;

    /// The time after which an uplink is no longer shown if its writer sends no newer one, ms.
    pub const EXPIRY_MS: u32 = 500;

    /// Seals `values` in an uplink of role `W` with its CRC.
    #[must_use]
    pub fn seal<W: WritesUplink>(_writer: Writer<W>, values: &UplinkValues) -> Self {
        Self {
            timestamp: U32Le::new(values.timestamp),
            identifier: U16Le::new(W::IDENTIFIER.0),
            status: U16Le::new(values.status.bits()),
            payload: values.payload,
            crc: CrcBe::UNSEALED,
        }
        .sealed()
    }

    /// The object in `bytes`, if it is intact and the uplink of role `W`.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if `bytes` are not 64, [`Rejection::Crc`] if they are damaged, [`Rejection::Identifier`]
    /// if they are another object.
    pub fn verify<W: WritesUplink>(bytes: &[u8]) -> Result<&Self, Rejection> {
        // Not covered: only this line, the error: the callers pass an array of an uplink's size, so only `findings`
        // below can reject.
        let (object, findings) = Self::look(bytes)?;
        findings.check(object.identifier() == W::IDENTIFIER, Rejection::Identifier).judge(object)
    }

    /// The contents of the uplink in plain numbers.
    #[must_use]
    pub const fn values(&self) -> UplinkValues {
        UplinkValues { timestamp: self.timestamp.get(), status: self.status(), payload: self.payload }
    }
}

/// An object that was written after a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Written<'a> {
    /// An uplink of the base station.
    BaseStation(&'a Uplink),
    /// An uplink of the flight controller.
    FlightController(&'a Uplink),
    /// A command with its object.
    Command(Command, &'a CommandObject),
}

impl<'a> Written<'a> {
    /// The object in `bytes`, if it is intact and may be written over the SSI.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if `bytes` are not 64, [`Rejection::Crc`] if they are damaged, [`Rejection::Identifier`]
    /// if they are an object that no one may write over the SSI, [`Rejection::Command`] if they are an unknown command.
    pub fn verify(bytes: &'a [u8]) -> Result<Self, Rejection> {
        let (uplink, findings) = Uplink::look(bytes)?;
        let command: &CommandObject = bytemuck::must_cast_ref(uplink);
        findings.judge(())?;
        match uplink.identifier() {
            Identifier::UPLINK_BASE_STATION => Ok(Self::BaseStation(uplink)),
            Identifier::UPLINK_FLIGHT_CONTROLLER => Ok(Self::FlightController(uplink)),
            Identifier::COMMAND => Ok(Self::Command(command.command().ok_or(Rejection::Command)?, command)),
            _ => Err(Rejection::Identifier),
        }
    }
}
