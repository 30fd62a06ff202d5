//! The interface between the model of a microcontroller and the bench around it.
//!
//! A [`Part`] is one microcontroller without its core: memory, peripherals, interrupt lines, pins. It is plain data and
//! is copied by `Clone`. Each call gets an [`Outside`], to which the part reports everything that leaves it. The
//! outside acts on the part by method calls: it drives a pin, or sends a serial frame.
//!
//! # Time
//! Inside a part, time is counted in its core's clock cycles ([`Cycle`]), so that everything in step with the core is
//! exact. A [`Timebase`] converts cycles into nanoseconds and back, and follows the part's clock tree.
//!
//! ```
//! use emulator_part::UartFrame;
//!
//! // Ten bits at 115 200 bit/s.
//! assert_eq!(UartFrame::eight_n_one(0x55, 115_200).ns(), 86_806);
//! ```
#![forbid(unsafe_code)]

mod finding;
mod memory;
mod part;
mod pins;
mod time;
mod wire;

pub use finding::{Finding, FindingKind};
pub use memory::{Flash, Ram, StuckBit};
pub use part::{Clock, Open, Outside, Part, Reset, Supplied};
pub use pins::Pins;
pub use time::{Cycle, NEVER, Timebase};
pub use wire::{I2cAnswer, I2cEvent, Pad, Pin, SpiFrame, SpiMode, UartFrame, UartParity};
