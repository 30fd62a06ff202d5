//! The active hold: the second, non-critical function on the same DPR (paper, sections 1 and 2.1; Table 1).
//!
//! # Design
//!
//! A payload unit with a microcontroller of its own sends one object, [Hold-Status](HoldStatus), in each
//! [period](PERIOD_MS), and gets at most one [`Answer`]: both [uplinks](crate::Uplink), in which base station and
//! flight controller command it. The DPR puts Hold-Status into the [map](crate::map), behind both uplinks. HORUS's
//! function shares nothing with the hold and does not depend on it (docs/design.md#active-hold).
//!
//! **The exchange.** The hold's frame is one [`HoldObject`], the answer is one [`Answer`], both NFC-F at 424 kbit/s. A
//! frame or an answer that fails is lost and is not repeated; the next period brings the next one.
//!
//! | frame | payload, bytes | air time, ms |
//! |---|---|---|
//! | {Hold-Status} | 64 | 1.416 |
//! | {uplink of the base station, uplink of the flight controller} | 128 | 2.624 |
//!
//! **Commands.** A command is the first [12 bytes](COMMAND_SIZE) of an uplink's payload; the writer may use the rest.
//!
//! | bytes of the payload | |
//! |---|---|
//! | 0..2 | u16 sequence number |
//! | 2..4 | u16 word; 0: there is no command |
//! | 4..8 | f32 value |
//! | 8..12 | zero |
//!
//! [`Commands`] is the hold's rule by which it executes each command at most once. [`Sender`] is for the writer of
//! commands: it numbers them, repeats them until they are acknowledged, and reports which are lost.
//!
//! **Makers.** [`HoldStatus`] and [`HoldCommand`] are this project's example, in one file. The rest of this module is
//! the same for every maker: docs/profiles.md shows how another maker replaces that file.

mod answer;
mod climate;
mod commands;
mod intake;
mod object;
mod sender;

pub use answer::Answer;
pub use climate::{HoldCommand, HoldStatus, HoldStatusBits, HoldValues};
pub use commands::{COMMAND_SIZE, Commands, Executed, Words};
pub use intake::Intake;
pub use object::{Acknowledged, HoldObject, HoldObjectValues, Outcome};
pub use sender::{Sender, Sent};

use crate::air;

/// The time between two frames of the hold, ms: every timestamp exceeds the timestamp before it by this.
pub const PERIOD_MS: u32 = 100;

/// The time after the end of the hold's frame within which the answer begins, µs. Then the hold stops waiting for it.
pub const ANSWER_WINDOW_US: u32 = 3_000;

/// The time after which the DPR no longer shows a hold's object if no newer one came, ms: three periods.
pub const EXPIRY_MS: u32 = 3 * PERIOD_MS;

/// The greatest age of an uplink that the DPR hands to the hold, and of a command that the hold executes, ms.
pub const COMMAND_AGE_MS: u32 = 1_000;

/// The air time of the hold's frame, ns.
pub const FRAME_NS: u64 = air::air_time_ns(64);

/// The air time of the answer, ns.
pub const ANSWER_NS: u64 = air::air_time_ns(128);

/// The longest time that one exchange takes, ns: the frame, the window, and an answer that begins at the window's end.
#[expect(clippy::as_conversions, reason = "it widens, and u64::from is not const")]
pub const EXCHANGE_NS: u64 = FRAME_NS + 1_000 * ANSWER_WINDOW_US as u64 + ANSWER_NS;

#[expect(clippy::as_conversions, reason = "it widens, and u64::from is not const")]
const _: () = {
    assert!(HoldObject::SIZE == 64 && Answer::SIZE == 128);
    assert!(Answer::SIZE <= air::MAX_PAYLOAD);
    // The remaining nine tenths of a period are for the hold's own work and for a clock that deviates.
    assert!(EXCHANGE_NS <= 1_000_000 * PERIOD_MS as u64 / 10);
};
