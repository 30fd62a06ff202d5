//! What a model of a microcontroller and the bench around it agree on.
//!
//! A [`Part`] is one microcontroller without its core: memory, peripherals, interrupt lines, pins. It is plain data and
//! is copied by `Clone`. Whatever leaves it goes through an [`Outside`], handed to each call, so that everything is
//! dispatched statically. What comes to it from outside are methods: a pin that is driven, a serial frame that arrives.
//!
//! # Time
//! Inside a part, time is a count of its core's clock cycles ([`Cycle`]), since all that the core is in step with is
//! then exact. [`Timebase`] turns cycles into the bench's nanoseconds and back; it changes with the part's clock tree.
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
