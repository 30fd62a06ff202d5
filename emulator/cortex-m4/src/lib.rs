//! An interpreter of the Arm Cortex-M4 with FPU.
//!
//! ARMv7E-M with the DSP extension and FPv4-SP, as the ARMv7-M Architecture Reference Manual (DDI 0403E, "ARM ARM" in
//! what follows) and the Cortex-M4 Technical Reference Manual (100166, "TRM") describe them. The core does no I/O: the
//! part around it is a [`Bus`]. Its state is plain data, and a [`Core`] is copied by `Clone`.
//!
//! Time is a count of core clock cycles. What an instruction costs is a type parameter, a [`Cost`]: [`Fast`],
//! [`Optimistic`] or [`Pessimistic`].
#![forbid(unsafe_code)]

mod bus;
mod code;
mod core;
mod cost;
mod decode;
mod describe;
mod exception;
mod execute;
mod fault;
mod fp;
mod memory;
mod op;
mod run;
mod signals;
mod special;
mod system;
mod watch;
mod watchpoint;

pub use self::core::{Config, Core, Exit, Register};
pub use bus::{Access, Bound, Bus, BusError, Purpose, Width};
pub use cost::{Cost, Fast, Optimistic, Pessimistic};
pub use describe::describe;
pub use fault::Fault;
pub use signals::Signals;
pub use watchpoint::{Watched, Watchpoint};
