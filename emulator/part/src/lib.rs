//! The interface between a model of a microcontroller and the bench around it.
//!
//! A [`Part`] is one microcontroller without its core: memory, peripherals, interrupt lines, pins. It is plain data and
//! is copied by `Clone`. Everything that leaves the part goes through an [`Outside`], which each call gets, so that
//! dispatch is static. Everything that the outside does to the part is a method call: a pin is driven, or a serial
//! frame arrives.
//!
//! # Time
//! Inside a part, time is counted in its core's clock cycles ([`Cycle`]), since everything in step with the core is
//! then exact. A [`Timebase`] converts cycles into the bench's nanoseconds and back, and changes with the part's clock
//! tree.
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
mod time;
mod wire;

pub use finding::{Finding, FindingKind};
pub use memory::{Flash, Ram, StuckBit};
pub use part::{Clock, Open, Outside, Part, Reset, Supplied};
pub use time::{Cycle, NEVER, Timebase};
pub use wire::{I2cAnswer, I2cEvent, Pad, Pin, SpiFrame, SpiMode, UartFrame, UartParity};
