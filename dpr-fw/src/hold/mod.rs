//! The second port of the DPR: the hold's frames come in, and both uplinks go out as the answer (cargo feature `hold`).
//!
//! # Design
//!
//! The hold's front end has an antenna, an SPI, a timer and receive buffers of its own, and its tasks have the lowest
//! priority above idle. So nothing that comes from the hold delays a task of HORUS's. All three tasks of the port
//! `hold_spi`, `hold_irq` and `hold_timer` do the same: they call [`Responder::serve`].
//!
//! | step | where |
//! |---|---|
//! | The driver's [`Answerer`](st25r3916::Answerer) receives a frame into a scrubbed buffer. | [`Responder`] |
//! | The frame is judged. An accepted object waits for the next image. | [`Shared::receive`] |
//! | The uplinks that may be handed on are put into the answer, zeros in place of others. | [`Shared::answer`] |
//! | A timer starts the answer [`ANSWER_US`] after the frame's end, whatever tasks run then. | [`AnswerPort::arm`] |
//! | The port task puts the object and its bits of Port-Status into what the next image shows. | [`Shared::show`] |
//!
//! The hold's tasks share [`Shared`] with the task `port` and with no other. So they never mask a task that a frame of
//! HORUS's or a transaction waits for.
//!
//! Only a frame that is accepted is answered. A frame that is not is no hold's, or the hold repeats itself.
//!
//! # Bounds
//!
//! Whatever the front end does, [`Budget`] bounds the work: when it is used up, the port *rests*. The interrupts of the
//! SPI, of the timer and of the IRQ's edge are masked until the window is over. The port's tasks are still called to
//! check in, once a cycle like all others, and the first such call after the window's end wakes the port. So the
//! watchdog's check-in depends on nothing that the hold does.
//!
//! An SPI that does not stop may write to its buffers for ever. Then the port is out of use until the next start, and
//! its buffers with it; nothing else changes. (HORUS's port ends in the safe state there.)

mod budget;
mod responder;
mod shared;
mod telemetry;
#[cfg(test)]
mod tests;

pub use budget::Budget;
pub use responder::{AnswerPort, Responder};
pub use shared::{Area, Shared, SHOWN};
pub use telemetry::HoldTelemetry;

use profile::hold::{Answer, ANSWER_WINDOW_US};
use st25r3916::answerer::EARLIEST_US;

use crate::rf::LEAD;

/// The time from the end of the hold's frame, as the chip reports it, to the command that starts the answer, µs.
///
/// Until then the frame has to be read and judged and the answer's first bytes loaded. That takes 0.3 ms, and HORUS's
/// tasks, which go before, take 0.6 ms in each cycle.
pub const ANSWER_US: u32 = 2_000;
const _: () = assert!(ANSWER_US >= EARLIEST_US && ANSWER_US + 100 <= ANSWER_WINDOW_US);

/// The memory of an answer, which begins behind [`LEAD`] bytes and a byte for the command that loads it.
pub type AnswerMemory = [u32; (LEAD + 1 + Answer::SIZE) / 4];
/// The memory of an answer before the first one.
pub const ANSWER_MEMORY: AnswerMemory = [0; (LEAD + 1 + Answer::SIZE) / 4];
const _: () = assert!((LEAD + 1).is_multiple_of(4) && Answer::SIZE.is_multiple_of(4));
