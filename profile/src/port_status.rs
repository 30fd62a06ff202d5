//! Port-Status: the DPR's report about its SSI port: uplinks, commands, access violations, self-test.
//!
//! # Access violations
//!
//! In a transaction the flight controller may write a [request](crate::ssi), after it one
//! [object](crate::uplink::Written), and nothing after that. Each of these three *parts* (request, object, rest) is
//! judged separately. A part is *idle* if all of its received bytes are 0x00 or all are 0xFF; that is no violation.
//! Every other part that the DPR does not accept counts once, under the first of these kinds ([`Violation`]) that holds
//! for it:
//!
//! | kind | part | meaning |
//! |---|---|---|
//! | `RequestDamaged` | request | eight bytes came in, and their CRC is wrong |
//! | `WindowOutside` | request | intact, but the window is empty or reaches beyond the map |
//! | `TooShort` | request, object | the transaction ended in the middle of the part |
//! | `UplinkDamaged` | object | 64 bytes came in, and their CRC is wrong |
//! | `UplinkIdentifier` | object | intact, but no one may write such an object here |
//! | `CommandUnknown` | object | a command with an unknown word, or with reserved bytes that are not zero |
//! | `UplinkNotNewer` | object | an uplink or a command whose timestamp is not [newer](crate::Uplink) |
//! | `CommandBusy` | object | a self-test while one is under way; its timestamp counts as seen |
//! | `TooMany` | – | see below |
//! | `TooLong` | rest | MOSI is driven after the object: the eight bytes there are not idle |
//!
//! A transaction of more than 80 bytes is no violation, because a long read clocks as many bytes in. The DPR's
//! peripheral drops the bytes after the 80th, which are not judged.
//!
//! `TooMany` concerns whole transactions. It counts once when the budget of transactions between two images is used up;
//! further transactions read 0xFF, and their writes are ignored. It also counts once for each object that is dropped
//! because the objects of two earlier transactions still wait to be judged. An object that is idle by its identifier
//! and status does not count.
//!
//! So one transaction counts up to four times: for its request, its object and its rest, and for `TooMany` if it is the
//! last that is granted. A transaction whose object is dropped counts once for `TooMany`, and once more if it is the
//! last that is granted. Link-Status's [`access_violations`](crate::LinkValues::access_violations) is the total of all
//! kinds since the DPR's start; no command clears it. The counters show a transaction from the first image that is
//! published after the DPR has judged it, which may be the image after next.
use core::{mem::offset_of, ops::Range};

use bytemuck::{Pod, Zeroable};

use crate::{
    Identifier, PortStatusBits, Rejection,
    criticality::{MayWrite, Writer, object},
    object_macro::object,
    wire::{CrcBe, U16Le, U32Le},
};

/// A kind of access violation: see the [module](self).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Violation {
    /// A request with a wrong CRC.
    RequestDamaged,
    /// An intact request for an empty window, or for one that reaches beyond the map.
    WindowOutside,
    /// A transaction that ended in the middle of a request or of an object.
    TooShort,
    /// An object with a wrong CRC.
    UplinkDamaged,
    /// An intact object that no one may write over the SSI.
    UplinkIdentifier,
    /// An uplink or a command that is repeated or old.
    UplinkNotNewer,
    /// A command that the DPR does not know, or with reserved bytes that are not zero.
    CommandUnknown,
    /// A self-test that is requested while another is under way.
    CommandBusy,
    /// More transactions, or more objects, than the DPR grants.
    TooMany,
    /// The flight controller drove MOSI after the object's last byte.
    TooLong,
}

impl Violation {
    /// Every kind, in the order of the counters in Port-Status.
    pub const ALL: [Self; 10] = [
        Self::RequestDamaged,
        Self::WindowOutside,
        Self::TooShort,
        Self::UplinkDamaged,
        Self::UplinkIdentifier,
        Self::UplinkNotNewer,
        Self::CommandUnknown,
        Self::CommandBusy,
        Self::TooMany,
        Self::TooLong,
    ];

    /// Returns the kind of violation that counts for a rejected [request](crate::ssi::parse).
    #[must_use]
    pub const fn of_request(rejection: Rejection) -> Self {
        // Not covered: only this line, the arm for a wrong length: the port hands all bytes of the request's size to
        // the parser, and counts a shorter request before.
        match rejection {
            Rejection::Window => Self::WindowOutside,
            Rejection::Length => Self::TooShort,
            _ => Self::RequestDamaged,
        }
    }

    /// Returns the kind of violation that counts for a rejected [object](crate::uplink::Written::verify).
    #[must_use]
    pub const fn of_object(rejection: Rejection) -> Self {
        // Not covered: only this line, the rejections that a written object cannot have: `Written::verify` does not
        // compare timestamps, since the port does so itself.
        match rejection {
            Rejection::Length => Self::TooShort,
            Rejection::Identifier => Self::UplinkIdentifier,
            Rejection::Command => Self::CommandUnknown,
            _ => Self::UplinkDamaged,
        }
    }

    /// Returns the range of the counter for this kind of violation in Port-Status.
    #[must_use]
    pub const fn place(self) -> Range<usize> {
        let start = offset_of!(PortStatus, violations) + 2 * self.index();
        start..start + 2
    }

    const fn index(self) -> usize {
        match self {
            Self::RequestDamaged => 0,
            Self::WindowOutside => 1,
            Self::TooShort => 2,
            Self::UplinkDamaged => 3,
            Self::UplinkIdentifier => 4,
            Self::UplinkNotNewer => 5,
            Self::CommandUnknown => 6,
            Self::CommandBusy => 7,
            Self::TooMany => 8,
            Self::TooLong => 9,
        }
    }
}

/// Access violations by kind; each counter saturates at 65535.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Violations([u16; Violation::ALL.len()]);

impl Violations {
    /// Counters that are all 0.
    #[must_use]
    pub const fn new() -> Self {
        Self([0; Violation::ALL.len()])
    }

    /// The number of violations of the kind `kind`.
    #[must_use]
    pub fn of(&self, kind: Violation) -> u16 {
        self.0.get(kind.index()).copied().unwrap_or(0)
    }

    /// Counts `times` more violations of the kind `kind`.
    pub fn count(&mut self, kind: Violation, times: u16) {
        // Not covered: only this line, the path without a count: each kind of violation has its place in the array.
        if let Some(count) = self.0.get_mut(kind.index()) {
            *count = count.saturating_add(times);
        }
    }

    /// The sum of the violations of all kinds.
    #[must_use]
    pub fn total(&self) -> u32 {
        self.0.iter().copied().map(u32::from).sum()
    }
}

/// The contents of Port-Status in plain numbers. Counters of u16 saturate at 65535, those of u32 wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PortValues {
    /// The timestamp of Port-Status, ms since the DPR's start, wraps. It is at most one cycle before Link-Status's.
    pub timestamp: u32,
    /// The state of the port.
    pub status: PortStatusBits,
    /// Uplinks that were stored since the DPR's start or since the counters were cleared.
    pub uplinks_accepted: u32,
    /// Commands carried out since the DPR's start, or since a command cleared the counters. That command is included.
    pub commands_carried_out: u32,
    /// The timestamp of the last command that was carried out, ms on the flight controller's clock; 0 if none was.
    pub last_command_timestamp: u32,
    /// The word of the last command that was carried out; 0 if none was.
    pub last_command: u32,
    /// The time since the last uplink of the base station was stored, ms; 65535 stands for a longer time or for none.
    pub base_station_age_ms: u16,
    /// The time since the last uplink of the flight controller was stored, ms; 65535 stands for a longer time or for
    /// none.
    pub flight_controller_age_ms: u16,
    /// Access violations by kind, since the DPR's start or since the counters were cleared.
    pub violations: Violations,
    /// Faults that the DPR's round-the-clock check found in images.
    pub integrity_faults: u16,
    /// Complete passes of the DPR's round-the-clock check over the flash.
    pub flash_passes: u16,
    /// Stuck bits that the DPR's scrubs found in its RAM.
    pub stuck_bits: u16,
    /// Receive buffers and images that the DPR took out of use.
    pub buffers_out_of_use: u16,
    /// The code of the DPR's last entry into the safe state; 0 if there was none since power-on.
    pub last_stop: u32,
}

/// A Port-Status object of 64 bytes. The last four bytes are the frame CRC of the other 60.
///
/// | bytes | | bytes | |
/// |---|---|---|---|
/// | 0..4 | u32 timestamp of the DPR, ms | 26..28 | u16 age of the flight controller's uplink, ms |
/// | 4..6 | u16 identifier | 28..48 | u16 access violations of each [kind](Violation::ALL) |
/// | 6..8 | u16 [status](PortStatusBits) | 48..50 | u16 integrity faults |
/// | 8..12 | u32 uplinks accepted | 50..52 | u16 passes over the flash |
/// | 12..16 | u32 commands carried out | 52..54 | u16 stuck bits |
/// | 16..20 | u32 timestamp of the last command, ms | 54..56 | u16 buffers out of use |
/// | 20..24 | u32 word of the last command | 56..60 | u32 reason of the last safe state |
/// | 24..26 | u16 age of the base station's uplink, ms | 60..64 | [frame CRC](crate::crc) over 0..60 |
#[derive(Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct PortStatus {
    timestamp: U32Le,
    identifier: U16Le,
    status: U16Le,
    uplinks_accepted: U32Le,
    commands_carried_out: U32Le,
    last_command_timestamp: U32Le,
    last_command: U32Le,
    base_station_age_ms: U16Le,
    flight_controller_age_ms: U16Le,
    violations: [U16Le; Violation::ALL.len()],
    integrity_faults: U16Le,
    flash_passes: U16Le,
    stuck_bits: U16Le,
    buffers_out_of_use: U16Le,
    last_stop: U32Le,
    crc: CrcBe,
}

object!(
    PortStatus, 64 bytes, status: PortStatusBits, timestamp: "ms since DPR start, wraps.", also shown: []
);

const _: () = {
    assert!(offset_of!(PortStatus, uplinks_accepted) == 8);
    assert!(offset_of!(PortStatus, commands_carried_out) == 12);
    assert!(offset_of!(PortStatus, last_command_timestamp) == 16);
    assert!(offset_of!(PortStatus, last_command) == 20);
    assert!(offset_of!(PortStatus, base_station_age_ms) == 24);
    assert!(offset_of!(PortStatus, flight_controller_age_ms) == 26);
    assert!(offset_of!(PortStatus, violations) == 28);
    assert!(offset_of!(PortStatus, integrity_faults) == 48);
    assert!(offset_of!(PortStatus, flash_passes) == 50);
    assert!(offset_of!(PortStatus, stuck_bits) == 52);
    assert!(offset_of!(PortStatus, buffers_out_of_use) == 54);
    assert!(offset_of!(PortStatus, last_stop) == 56);
};

impl PortStatus {
    /// Seals `values` in an object with its CRC.
    #[must_use]
    pub fn seal<W: MayWrite<object::PortStatus>>(_writer: Writer<W>, values: &PortValues) -> Self {
        Self {
            timestamp: U32Le::new(values.timestamp),
            identifier: U16Le::new(Identifier::PORT_STATUS.0),
            status: U16Le::new(values.status.bits()),
            uplinks_accepted: U32Le::new(values.uplinks_accepted),
            commands_carried_out: U32Le::new(values.commands_carried_out),
            last_command_timestamp: U32Le::new(values.last_command_timestamp),
            last_command: U32Le::new(values.last_command),
            base_station_age_ms: U16Le::new(values.base_station_age_ms),
            flight_controller_age_ms: U16Le::new(values.flight_controller_age_ms),
            violations: values.violations.0.map(U16Le::new),
            integrity_faults: U16Le::new(values.integrity_faults),
            flash_passes: U16Le::new(values.flash_passes),
            stuck_bits: U16Le::new(values.stuck_bits),
            buffers_out_of_use: U16Le::new(values.buffers_out_of_use),
            last_stop: U32Le::new(values.last_stop),
            crc: CrcBe::UNSEALED,
        }
        .sealed()
    }

    /// The Port-Status in `bytes`, if it is intact.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if `bytes` are not 64, [`Rejection::Crc`] if they are damaged, [`Rejection::Identifier`]
    /// if they are another object.
    pub fn verify(bytes: &[u8]) -> Result<&Self, Rejection> {
        let (object, findings) = Self::look(bytes)?;
        findings.check(object.identifier() == Identifier::PORT_STATUS, Rejection::Identifier).judge(object)
    }

    /// The contents of Port-Status in plain numbers.
    #[must_use]
    pub fn values(&self) -> PortValues {
        PortValues {
            timestamp: self.timestamp.get(),
            status: self.status(),
            uplinks_accepted: self.uplinks_accepted.get(),
            commands_carried_out: self.commands_carried_out.get(),
            last_command_timestamp: self.last_command_timestamp.get(),
            last_command: self.last_command.get(),
            base_station_age_ms: self.base_station_age_ms.get(),
            flight_controller_age_ms: self.flight_controller_age_ms.get(),
            violations: Violations(self.violations.map(U16Le::get)),
            integrity_faults: self.integrity_faults.get(),
            flash_passes: self.flash_passes.get(),
            stuck_bits: self.stuck_bits.get(),
            buffers_out_of_use: self.buffers_out_of_use.get(),
            last_stop: self.last_stop.get(),
        }
    }
}
