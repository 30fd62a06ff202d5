//! The events of the active hold. No rule of HORUS's link reads one of them.

use serde::{Deserialize, Serialize};

use crate::event::{Bytes, Cause};

/// A frame on the air between hold and DPR. Its event's instant is the end of the frame's last bit.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HoldFrame {
    /// The instant, ns, at which the frame's first preamble bit began.
    pub started: u64,
    /// The bytes of the frame: LEN, payload and CRC-16.
    pub bytes: Bytes,
    /// Whether all bytes that LEN announces were on the air.
    pub whole: bool,
}

/// Something that the active hold did, or that was done to it. The variants are in the order of one exchange.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HoldEvent {
    /// The hold's supply goes on or off.
    Power {
        /// Whether the supply goes on.
        on: bool,
    },
    /// The hold's microcontroller restarts.
    Reset {
        /// The cause of the reset.
        cause: Cause,
        /// Whether the bench reset the board on purpose, by the pin or the supply.
        asked: bool,
    },
    /// The hold's front end switched its carrier.
    Field {
        /// Whether the carrier is on.
        on: bool,
    },
    /// The hold's front end has sent a frame.
    Sent(HoldFrame),
    /// A frame has ended at the antenna of the DPR's second front end, as it arrived there.
    Heard(HoldFrame),
    /// The DPR's second front end has sent an answer.
    Answered(HoldFrame),
    /// An answer has ended at the hold's antenna, as it arrived there.
    AnswerHeard(HoldFrame),
    /// The lock's pin was driven to another level.
    Lock {
        /// Whether the payload is locked.
        locked: bool,
    },
    /// The heater's and cooler's work since the last event of this kind, and the true state of the payload.
    Payload {
        /// The share of the time in which the heater was on, in ten thousandths.
        heater: u16,
        /// The share of the time in which the cooler was on, in ten thousandths.
        cooler: u16,
        /// The temperature in the box, m°C.
        temperature: i32,
        /// The relative humidity in the box, in thousandths of a per cent.
        humidity: u32,
        /// The last instant, ns, at which the heater was on.
        heated: Option<u64>,
        /// The instant, ns, at which the climate sensor last sent a whole measurement with the right CRCs.
        measured: Option<u64>,
    },
    /// The DPR's second front end was used against its data sheet.
    PortMisuse {
        /// The misuse in words.
        text: String,
    },
    /// The hold's microcontroller, front end or sensors were misused, or the bench acted on the hold too late.
    Finding {
        /// The finding in words.
        text: String,
    },
}
