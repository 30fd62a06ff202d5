//! The object that a hold sends. Its layout is the same for every maker.
use core::mem::offset_of;

use bytemuck::{Pod, Zeroable};

use crate::{
    Identifier, Rejection, UplinkStatus,
    criticality::{MayWrite, Writer, WritesUplink, object},
    object_macro::object,
    wire::{CrcBe, U16Le, U32Le},
};

/// What became of a command to the hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Outcome {
    /// No command has come since the hold's start.
    Nothing,
    /// The command was carried out.
    Done,
    /// The hold's own limits forbid the command.
    Refused,
    /// The command's word is unknown, or its reserved bytes are not zero.
    Unknown,
    /// The uplink that carried the command was too old: it had the same timestamp for more than
    /// [`COMMAND_AGE_MS`](super::COMMAND_AGE_MS).
    TooOld,
}

impl Outcome {
    const fn from_code(code: u16) -> Option<Self> {
        match code {
            0 => Some(Self::Nothing),
            1 => Some(Self::Done),
            2 => Some(Self::Refused),
            3 => Some(Self::Unknown),
            4 => Some(Self::TooOld),
            _ => None,
        }
    }

    /// The code of the outcome on the wire.
    #[must_use]
    pub const fn code(self) -> u16 {
        match self {
            Self::Nothing => 0,
            Self::Done => 1,
            Self::Refused => 2,
            Self::Unknown => 3,
            Self::TooOld => 4,
        }
    }
}

/// The acknowledgement of a writer's last command: its sequence number and its outcome.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Acknowledged {
    number: u16,
    code: u16,
}

impl Acknowledged {
    /// The acknowledgement of command `number`.
    #[must_use]
    pub const fn new(number: u16, outcome: Outcome) -> Self {
        Self { number, code: outcome.code() }
    }

    /// The sequence number of the acknowledged command; 0 if there was none.
    #[must_use]
    pub const fn number(self) -> u16 {
        self.number
    }

    /// The outcome of the acknowledged command; `None` for a reserved code.
    #[must_use]
    pub const fn outcome(self) -> Option<Outcome> {
        Outcome::from_code(self.code)
    }

    /// The code of the outcome on the wire; it may be reserved.
    #[must_use]
    pub const fn code(self) -> u16 {
        self.code
    }
}

#[derive(Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct WireAcknowledged {
    number: U16Le,
    code: U16Le,
}

impl WireAcknowledged {
    pub(super) const fn new(acknowledged: Acknowledged) -> Self {
        Self { number: U16Le::new(acknowledged.number), code: U16Le::new(acknowledged.code) }
    }

    pub(super) const fn get(self) -> Acknowledged {
        Acknowledged { number: self.number.get(), code: self.code.get() }
    }
}

/// The contents of a hold's object. Its maker defines what `status`, `values` and `more` mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HoldObjectValues {
    /// The timestamp, ms since the hold's start, wraps. It is one [period](super::PERIOD_MS) later in each object.
    pub timestamp: u32,
    /// The status word, which the maker defines.
    pub status: UplinkStatus,
    /// The values before the acknowledgements, which the maker defines.
    pub values: [u8; HoldObject::VALUES],
    /// The acknowledgements of the last command of each writer, in the order of [`WritesUplink::INDEX`].
    pub acknowledged: [Acknowledged; 2],
    /// The values behind the acknowledgements, which the maker defines.
    pub more: [u8; HoldObject::MORE],
}

/// The object of any maker's hold, 64 bytes. The last four bytes are the frame CRC of the other 60.
///
/// The DPR and the [`Sender`](super::Sender) of commands read only the fields that are the same for every maker:
///
/// | bytes | |
/// |---|---|
/// | 0..4 | u32 timestamp of the hold, ms |
/// | 4..6 | u16 identifier, 0x4100 to 0x41FF, which names the maker's layout |
/// | 6..8 | u16 status |
/// | 8..44 | 36 bytes of the maker's values |
/// | 44..46, 46..48 | u16 sequence number of the base station's last command, u16 its [outcome](Outcome) |
/// | 48..50, 50..52 | the same for the flight controller |
/// | 52..60 | 8 more bytes of the maker's values |
/// | 60..64 | [frame CRC](crate::crc) over 0..60 |
#[derive(Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct HoldObject {
    timestamp: U32Le,
    identifier: U16Le,
    status: U16Le,
    values: [u8; HoldObject::VALUES],
    acknowledged: [WireAcknowledged; 2],
    more: [u8; HoldObject::MORE],
    crc: CrcBe,
}

object!(HoldObject, 64 bytes, status: UplinkStatus, timestamp: "ms since the hold's start, wraps.", also shown: []);

const _: () = {
    assert!(offset_of!(HoldObject, values) == 8);
    assert!(offset_of!(HoldObject, acknowledged) == HoldObject::ACKNOWLEDGED);
    assert!(offset_of!(HoldObject, more) == 52);
};

impl HoldObject {
    /// The number of bytes of the maker's values before the acknowledgements.
    pub const VALUES: usize = 36;

    /// The number of bytes of the maker's values behind the acknowledgements.
    pub const MORE: usize = 8;

    /// The offset of the acknowledgements.
    pub const ACKNOWLEDGED: usize = 44;

    /// Seals `values` in an object with `identifier`, which names the maker's layout.
    ///
    /// # Panics
    ///
    /// Panics if `identifier` is not one [of the active load](Identifier::is_active_load).
    #[must_use]
    pub fn seal<W: MayWrite<object::Hold>>(
        _writer: Writer<W>,
        identifier: Identifier,
        values: &HoldObjectValues,
    ) -> Self {
        assert!(identifier.is_active_load(), "{identifier} is no identifier of an active load");
        Self {
            timestamp: U32Le::new(values.timestamp),
            identifier: U16Le::new(identifier.0),
            status: U16Le::new(values.status.bits()),
            values: values.values,
            acknowledged: values.acknowledged.map(WireAcknowledged::new),
            more: values.more,
            crc: CrcBe::UNSEALED,
        }
        .sealed()
    }

    /// The object in `bytes`, if it is intact and its identifier is one of a hold, of any maker.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if `bytes` are not 64, [`Rejection::Crc`] if they are damaged, [`Rejection::Identifier`]
    /// if they are another object.
    pub fn verify(bytes: &[u8]) -> Result<&Self, Rejection> {
        let (object, findings) = Self::look(bytes)?;
        findings.check(object.identifier().is_active_load(), Rejection::Identifier).judge(object)
    }

    /// The contents of the object in plain numbers.
    #[must_use]
    pub fn values(&self) -> HoldObjectValues {
        HoldObjectValues {
            timestamp: self.timestamp.get(),
            status: self.status(),
            values: self.values,
            acknowledged: self.acknowledged.map(WireAcknowledged::get),
            more: self.more,
        }
    }

    /// The acknowledgement, in this object, of the last command of role `W`.
    #[must_use]
    pub fn acknowledged<W: WritesUplink>(&self) -> Acknowledged {
        let [base_station, flight_controller] = self.acknowledged;
        if W::INDEX == 0 { base_station.get() } else { flight_controller.get() }
    }
}
