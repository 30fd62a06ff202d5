//! A behavioural model of the ST25R3916 (DS12484) and ST25R3916B (DS13541): SPI bytes with chip select, the IRQ pin,
//! the air, virtual time.
//!
//! The model needs no microcontroller. A bench passes bytes and instants to a chip and reads its IRQ pin; two chips
//! face each other through [`Air`]. A chip behaves as the data sheet specifies, also when misused: everything that the
//! model does not cover, and everything that the data sheet does not allow, is in [`Chip::reports`] with its first
//! instant and count, and is never silently zero. Where the documents are silent or contradict themselves, [`Config`]
//! has a switch or a measured value; this crate's tests replay two recordings of silicon against the model.
//!
//! # Use
//!
//! Time is `u64` nanoseconds and does not go back. Before reading [`Chip::irq`] at an instant,
//! [`advance`](Chip::advance) the chip to that instant; a bench with nothing to do may skip to
//! [`next_event`](Chip::next_event). [`Chip::transfer`] transfers one byte and is called with the instant at which the
//! byte's last clock ends: register values and FIFO bytes are read at the end of the byte before, as on silicon, and
//! writes take effect at the end of their own byte. One effect comes earlier: reading an interrupt register moves the
//! IRQ pin at the first clock edge of the byte read. [`Chip::take_irq_edges`] gives the pin's changes with their own
//! instants, [`Chip::irq_since`] the instant of the last one. Between events a chip costs no time, and a byte costs a
//! few nanoseconds and no allocation; a frame allocates a few times.
//!
//! Two chips may be advanced alternately in steps of up to a microsecond: an air event that lies slightly before the
//! receiving chip's time keeps its own instant for the arithmetic of its bits, and receiver latencies (several
//! microseconds) cover the difference.
//!
//! The start of a transmission scatters, as on silicon, by the generator that [`Config::seed`] seeds: two chips of one
//! bench need different seeds. A test that needs exact instants sets [`Config::transmit_scatter_ns`] to 0.
//!
//! ```
//! use st25r3916_model::{Chip, Config};
//!
//! let mut chip = Chip::new(Config::default());
//! let mut exchange = |now, bytes: &[u8]| {
//!     chip.select(now);
//!     let miso: Vec<u8> = bytes.iter().map(|&b| chip.transfer(now, b)).collect();
//!     chip.deselect(now);
//!     miso
//! };
//! assert_eq!(exchange(0, &[0x7F, 0]), [0, 0x31]); // identity: ST25R3916B
//! exchange(1_000, &[0x02, 0x80]); // oscillator on
//! assert_eq!(chip.next_event(), Some(701_000));
//! chip.advance(701_000);
//! assert!(chip.irq()); // I_osc
//! ```
//!
//! # Modules
//!
//! Each module's documentation starts with what the module covers, by data sheet section, and what it leaves out and
//! why. A module does not use modules that are listed above it:
//!
//! - `air`: two chips and what is between them; [`AnswerPath`] carries the answers of a link that has answers.
//! - `chip`: the parts of a chip put together; SPI bytes, register accesses and commands.
//! - `transmitter`, `receiver` (frames, one each at a time), `field` (carriers), `timers`, `fifo`, `spi` (the slave's
//!   state); `receive_chain`, `modulation`, `load_modulation` and `supply` (settings that the board or the technology
//!   contradicts).
//! - `core`: the common base: time and deadlines (`schedule`), `registers` (map, reset values and contents),
//!   `interrupts` (pending bits and the IRQ pin), findings (`report`).
#![forbid(unsafe_code)]

mod air;
mod chip;
mod clock;
mod config;
mod core;
mod crc;
mod event;
mod field;
mod fifo;
mod incoming;
mod interrupts;
mod load_modulation;
mod modulation;
mod outgoing;
mod receive_chain;
mod receiver;
mod registers;
mod report;
mod rng;
mod schedule;
mod spi;
mod supply;
mod timers;
mod transmitter;

pub use crate::core::Statistics;
pub use air::{Air, AirFaults, AnswerFaults, AnswerPath, Counters, ForeignCard, Heard, LastFrame, Origin, SentFrame};
pub use chip::{Chip, SpiFrame, SpiMode};
pub use config::{BrokenFrame, Config, Variant};
pub use crc::nfc_f;
pub use event::{AirEvent, Chunk, FrameStart, Technology};
pub use interrupts::{IrqEdge, Withheld};
pub use report::{Kind, Report, Space};
