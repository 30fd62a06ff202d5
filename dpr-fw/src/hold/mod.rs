//! The second port of the DPR: receives the hold's frames and answers with both uplinks (cargo feature `hold`).
//!
//! # Design
//!
//! The hold's front end has an antenna, an SPI, a timer and receive buffers of its own. Its tasks have the lowest
//! priority above `idle`, so the hold cannot delay a task of HORUS's port. All three tasks of the second port
//! (`hold_spi`, `hold_irq` and `hold_timer`) call [`Responder::serve`].
//!
//! | step | where |
//! |---|---|
//! | The driver's [`Answerer`](st25r3916::Answerer) receives a frame into a cleared buffer. | [`Responder`] |
//! | The frame is accepted or rejected. An accepted object waits for the next image. | [`Shared::receive`] |
//! | The answer gets each uplink that is intact and recent, and zeros for any other. | [`Shared::answer`] |
//! | A timer starts the answer [`ANSWER_US`] after the frame's end, without a task. | [`AnswerPort::arm`] |
//! | The task `port` puts the object and the hold's bits of Port-Status into the next image. | [`Shared::show`] |
//!
//! The hold's tasks share [`Shared`] with the task `port` only. So they never mask the tasks that receive HORUS's
//! frames or serve the SSI.
//!
//! A rejected frame gets no answer: it is damaged, repeated, or does not come from a hold.
//!
//! # Bounds
//!
//! [`Budget`] limits the work of the second port whatever its front end does. When the budget is used up, the port
//! *rests*: until the window of the budget is over, the interrupts of the SPI, of the timer and of the IRQ's edge are
//! masked. The port's tasks are still called to check in, once a cycle like all others, so the hold cannot make the
//! watchdog bite. The first such call after the end of the window unmasks the interrupts.
//!
//! An SPI that does not stop might write to its buffers for ever. Then the second port and its buffers are out of use
//! until the next start, and HORUS's port goes on. (On HORUS's port the same fault leads to the safe state.)

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
use st25r3916::{answerer::EARLIEST_US, Short};

use crate::rf::LEAD;

/// The time from the end of the hold's frame, as the chip reports it, to the answer's transmit command, µs.
///
/// In this time the DPR reads and checks the hold's frame, and loads the answer's first bytes. That takes 0.3 ms.
/// HORUS's tasks have higher priorities and take 0.6 ms in each cycle.
pub const ANSWER_US: u32 = 2_000;
const _: () = assert!(ANSWER_US >= EARLIEST_US && ANSWER_US + 100 <= ANSWER_WINDOW_US);

/// The memory of an answer. Before the answer are [`LEAD`] bytes and a byte for the load command.
pub type AnswerMemory = [u32; (LEAD + 1 + Answer::SIZE) / 4];

/// The memory that DMA reaches for the second port's SPI, except the receive buffers.
#[derive(Debug)]
pub struct SpiMemory {
    /// The bytes that a short transfer sends, or the command of a read.
    pub tx: [u8; Short::MAX],
    /// The bytes that come in during a short transfer.
    pub rx: [u8; Short::MAX],
    /// The answer that is sent.
    pub answer: AnswerMemory,
}

impl SpiMemory {
    /// The memory at the start, all zeros.
    pub const NEW: Self = Self { tx: [0; Short::MAX], rx: [0; Short::MAX], answer: [0; (LEAD + 1 + Answer::SIZE) / 4] };
}

const _: () = assert!((LEAD + 1).is_multiple_of(4) && Answer::SIZE.is_multiple_of(4));
