//! The active hold: the second, non-critical function on the same DPR (paper, sections 1 and 2.1; Table 1).
//!
//! The hold is a payload unit with its own microcontroller. It sends one object, [Hold-Status](HoldStatus), in each
//! [period](PERIOD_MS). It gets at most one [`Answer`]: the [uplinks](crate::Uplink) in which base station and flight
//! controller command it. The DPR puts Hold-Status into the [map](crate::map), behind both uplinks. HORUS's function
//! does not depend on the hold (docs/design.md#active-hold).
//!
//! **The exchange.** The hold's frame is one [`HoldObject`], the answer one [`Answer`], both NFC-F at 424 kbit/s. A
//! lost frame or answer is not repeated.
//!
//! | frame | payload, bytes | air time, ms |
//! |---|---|---|
//! | {Hold-Status} | 64 | 1.416 |
//! | {uplink of the base station, uplink of the flight controller} | 128 | 2.624 |
//!
//! **Commands.** A command is the first [12 bytes](COMMAND_SIZE) of an uplink's payload. The hold ignores the rest of
//! the payload.
//!
//! | bytes of the payload | |
//! |---|---|
//! | 0..2 | u16 sequence number |
//! | 2..4 | u16 word; 0: there is no command |
//! | 4..8 | f32 value |
//! | 8..12 | zero |
//!
//! [`Commands`] is the hold's rule for executing each command at most once. [`Sender`] numbers a writer's commands,
//! repeats them until they are acknowledged, and reports which are lost.
//!
//! **Makers.** [`HoldStatus`] and [`HoldCommand`] are this project's example, in one file. docs/profiles.md shows how
//! another maker replaces that file; the rest of this module is for every maker.

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

/// The time between two frames of the hold, ms. Their timestamps differ by this time.
pub const PERIOD_MS: u32 = 100;

/// The longest time from the end of the hold's frame to the start of the answer, µs. After it the hold stops waiting.
pub const ANSWER_WINDOW_US: u32 = 3_000;

/// The time after which the DPR no longer shows a hold's object if no newer one came, ms: three periods.
pub const EXPIRY_MS: u32 = 3 * PERIOD_MS;

/// The greatest age of an uplink that the DPR hands to the hold, and of a command that the hold executes, ms.
pub const COMMAND_AGE_MS: u32 = 1_000;

/// The air time of the hold's frame, ns.
pub const FRAME_NS: u64 = air::air_time_ns(64);

/// The air time of the answer, ns.
pub const ANSWER_NS: u64 = air::air_time_ns(128);

/// The longest time that one exchange takes, ns: the frame, [`ANSWER_WINDOW_US`] and the answer.
#[expect(clippy::as_conversions, reason = "it widens, and u64::from is not const")]
pub const EXCHANGE_NS: u64 = FRAME_NS + 1_000 * ANSWER_WINDOW_US as u64 + ANSWER_NS;

#[expect(clippy::as_conversions, reason = "it widens, and u64::from is not const")]
const _: () = {
    assert!(HoldObject::SIZE == 64 && Answer::SIZE == 128);
    assert!(Answer::SIZE <= air::MAX_PAYLOAD);
    // An exchange takes at most a tenth of a period. The hold needs the rest for its own work, and for a deviating
    // clock.
    assert!(EXCHANGE_NS <= 1_000_000 * PERIOD_MS as u64 / 10);
};
