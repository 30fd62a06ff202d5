//! An interpreter of the Arm Cortex-M4 with FPU.
//!
//! The interpreter implements ARMv7E-M with the DSP extension and FPv4-SP, as the ARMv7-M Architecture Reference Manual
//! (DDI 0403E, here called "ARM ARM") and the Cortex-M4 Technical Reference Manual (100166, "TRM") describe them. The
//! core does no I/O: the part around it is a [`Bus`]. Its state is plain data, so a [`Core`] is copied by `Clone`.
//!
//! Time is counted in core clock cycles. A type parameter, a [`Cost`], says what an instruction costs: [`Fast`],
//! [`Optimistic`] or [`Pessimistic`].
//!
//! ```
//! use cortex_m4::{Access, Bound, Bus, BusError, Config, Core, Exit, Fast, Register, Signals, Width};
//!
//! /// 1 KiB of memory at 0, and nothing else.
//! struct Memory {
//!     bytes: [u8; 1024],
//!     signals: Signals,
//! }
//!
//! impl Bus for Memory {
//!     fn read(&mut self, access: &Access) -> Result<u32, BusError> {
//!         let from = access.address as usize;
//!         let bytes = self.bytes.get(from..from + access.width.bytes() as usize).ok_or(BusError)?;
//!         Ok(bytes.iter().rev().fold(0, |value, byte| value << 8 | u32::from(*byte)))
//!     }
//!
//!     fn write(&mut self, access: &Access, value: u32) -> Result<(), BusError> {
//!         let (from, length) = (access.address as usize, access.width.bytes() as usize);
//!         let bytes = self.bytes.get_mut(from..from + length).ok_or(BusError)?;
//!         bytes.copy_from_slice(&value.to_le_bytes()[..length]);
//!         Ok(())
//!     }
//!
//!     fn fetch(&mut self, address: u32) -> Result<u16, BusError> {
//!         let bytes = self.bytes.get(address as usize..).and_then(|bytes| bytes.first_chunk());
//!         bytes.map(|bytes| u16::from_le_bytes(*bytes)).ok_or(BusError)
//!     }
//!
//!     fn is_constant(&self, _: u32) -> bool {
//!         true
//!     }
//!
//!     fn due(&self) -> u64 {
//!         u64::MAX
//!     }
//!
//!     fn advance(&mut self, _: u64) {}
//!
//!     fn signals(&mut self) -> &mut Signals {
//!         &mut self.signals
//!     }
//!
//!     fn wait_states(&mut self, _: &Access, _: Bound) -> u32 {
//!         0
//!     }
//!
//!     fn bit_banding(&self) -> bool {
//!         false
//!     }
//! }
//!
//! let mut memory = Memory { bytes: [0; 1024], signals: Signals::default() };
//! // The stack's top, the reset vector, and: movs r0, #6; movs r1, #7; muls r0, r1; b to itself.
//! let words = [0x400_u32, 0x9, 0x2107_2006, 0xE7FE_4348];
//! for (place, word) in memory.bytes.chunks_exact_mut(4).zip(words) {
//!     place.copy_from_slice(&word.to_le_bytes());
//! }
//! let config = Config {
//!     lines: 16,
//!     priority_bits: 4,
//!     vector_table: 0,
//!     systick_calibration: 0,
//!     systick_reference: 0,
//!     mpu_regions: 0,
//! };
//! let mut core = Core::<Fast>::new(config);
//! core.reset(&mut memory);
//! assert_eq!(core.run(&mut memory, 100), Exit::Until);
//! assert_eq!(core.register(Register::R(0)), 42);
//! ```
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
mod flags;
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
pub use watch::Scheduled;
pub use watchpoint::{Watched, Watchpoint};
