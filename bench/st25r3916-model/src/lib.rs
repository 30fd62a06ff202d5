//! A behavioural model of the ST25R3916 (DS12484) and ST25R3916B (DS13541): SPI bytes with chip select, the IRQ pin,
//! the air, virtual time.
//!
//! The model needs no microcontroller. A bench passes bytes and instants to a chip and reads its IRQ pin; two chips
//! face each other through [`Air`]. Every use that the model does not cover or that the data sheet does not allow is a
//! finding in [`Chip::reports`], with its first instant and its count. Where the documents are silent or contradict
//! themselves, [`Config`] has a switch or a measured value. This crate's tests replay two recordings of silicon.
//!
//! # Use
//!
//! Time is `u64` nanoseconds and does not go back. [`advance`](Chip::advance) a chip to an instant before reading
//! [`Chip::irq`] at that instant. A bench may skip to [`next_event`](Chip::next_event).
//!
//! [`Chip::transfer`] transfers one byte. It is called with the instant at which the byte's last clock ends. A read
//! takes its value at the end of the byte before, as on silicon, and a write takes effect at the end of its own byte.
//! Only the IRQ pin falls earlier, at the first clock edge of the byte that reads an interrupt register: see
//! [`Chip::take_irq_edges`] and [`Chip::irq_since`].
//!
//! Two chips may be advanced alternately in steps of up to a microsecond. An event may then come slightly before the
//! receiving chip's time. It keeps its own instant for the timing of its bits, and the receiver's latency of several
//! microseconds covers the difference.
//!
//! The start of a transmission scatters at random, as on silicon. Two chips of one bench therefore need different
//! values of [`Config::seed`]. A test that needs exact instants sets [`Config::transmit_scatter_ns`] to 0.
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
//! Each module's documentation starts with what the module covers, by data sheet section, and what it leaves out. A
//! module does not use modules that are listed above it:
//!
//! - `air`: two chips and the air between them; [`AnswerPath`] carries answers.
//! - `chip`: the chip as a whole; SPI bytes, register accesses and commands.
//! - `transmitter`, `receiver` (frames), `field` (carriers), `timers`, `fifo`, `spi` (the slave's state);
//!   `receive_chain`, `modulation`, `load_modulation` and `supply` (settings that do not suit the board or the
//!   technology).
//! - `core`: the common base with time and deadlines (`schedule`), `registers`, `interrupts` and findings (`report`).
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
