//! Command: an action that the flight controller requests of the DPR.
use core::mem::offset_of;

use bytemuck::{Pod, Zeroable};

use crate::{
    Identifier, Rejection, UplinkStatus,
    criticality::{MayWrite, Writer, object},
    object_macro::object,
    wire::{CrcBe, U16Le, U32Le},
};

/// An action that the flight controller requests of the DPR by writing a defined word (paper, section 2.1).
///
/// A command acts only on the DPR. The link to HORUS is one-way, and no object written over the SSI changes an object
/// of HORUS or a counter of Link-Status.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Command {
    /// Sets the counters of uplinks, commands and access violations in Port-Status to 0, then counts this command as
    /// carried out. The total of access violations in Link-Status and the counters of faults are not cleared.
    ClearCounters,
    /// Begins one whole check of the flash and of the RAM in use, in spare processor time. Refused while another such
    /// check is in progress.
    SelfTest,
}

impl Command {
    /// Every command.
    pub const ALL: [Self; 2] = [Self::ClearCounters, Self::SelfTest];

    /// The command's word: in the order of the bytes on the wire, the ASCII text `CLRC` or `TEST`.
    #[must_use]
    pub const fn word(self) -> u32 {
        match self {
            Self::ClearCounters => u32::from_le_bytes(*b"CLRC"),
            Self::SelfTest => u32::from_le_bytes(*b"TEST"),
        }
    }

    /// The command with this word; `None` if no command has it.
    #[must_use]
    pub fn from_word(word: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|command| command.word() == word)
    }
}

/// The contents of a command object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommandValues {
    /// The timestamp, ms on the flight controller's clock, wraps. It must be later than the last command's.
    pub timestamp: u32,
    /// The command's [word](Command::word).
    pub word: u32,
}

/// A command object of 64 bytes. The last four bytes are the frame CRC of the other 60.
///
/// | bytes | |
/// |---|---|
/// | 0..4 | u32 timestamp of the flight controller, ms |
/// | 4..6 | u16 [identifier](Identifier::COMMAND) |
/// | 6..8 | u16 status, not evaluated |
/// | 8..12 | u32 [word](Command::word) |
/// | 12..60 | zero |
/// | 60..64 | [frame CRC](crate::crc) over 0..60 |
///
/// A command is written where an [uplink](crate::Uplink) would be. Its timestamp must be later than the last command's,
/// by the rule for uplinks; otherwise the command is refused. The DPR carries a command out once and does not store it.
/// [Port-Status](crate::PortStatus) names the last command that was carried out. A flight controller that has restarted
/// may have to send its first command three times, each time with a later timestamp.
#[derive(Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct CommandObject {
    timestamp: U32Le,
    identifier: U16Le,
    status: U16Le,
    word: U32Le,
    reserved: [u8; 48],
    crc: CrcBe,
}

object!(
    CommandObject, 64 bytes, status: UplinkStatus, timestamp: "ms on the flight controller's clock, wraps.",
    also shown: []
);

const _: () = {
    assert!(offset_of!(CommandObject, word) == 8);
    assert!(offset_of!(CommandObject, reserved) == 12);
};

impl CommandObject {
    /// Seals `command` in an object with its CRC; `timestamp` is in ms on the flight controller's clock.
    #[must_use]
    pub fn seal<W: MayWrite<object::Command>>(_writer: Writer<W>, timestamp: u32, command: Command) -> Self {
        Self {
            timestamp: U32Le::new(timestamp),
            identifier: U16Le::new(Identifier::COMMAND.0),
            status: U16Le::new(0),
            word: U32Le::new(command.word()),
            reserved: [0; 48],
            crc: CrcBe::UNSEALED,
        }
        .sealed()
    }

    /// The command object in `bytes`, if it is intact and contains a command that the DPR knows.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if `bytes` are not 64, [`Rejection::Crc`] if they are damaged, [`Rejection::Identifier`]
    /// if they are another object, [`Rejection::Command`] if the word is unknown or a reserved byte is not zero.
    pub fn verify(bytes: &[u8]) -> Result<&Self, Rejection> {
        let (object, findings) = Self::look(bytes)?;
        findings
            .check(object.identifier() == Identifier::COMMAND, Rejection::Identifier)
            .check(object.command().is_some(), Rejection::Command)
            .judge(object)
    }

    /// The command, if its word is known and its reserved bytes are zero.
    #[must_use]
    pub fn command(&self) -> Option<Command> {
        let clear = self.reserved == [0; 48];
        Command::from_word(self.word.get()).filter(|_| clear)
    }

    /// The contents of the command object in plain numbers.
    #[must_use]
    pub const fn values(&self) -> CommandValues {
        CommandValues { timestamp: self.timestamp.get(), word: self.word.get() }
    }
}
