//! The engine: real firmware images on emulated microcontrollers, in virtual time.
//!
//! A [`Node`] is one board: a Cortex-M4 ([`cortex_m4`]), the models of its part ([`bench_seam::Part`]) and what is
//! wired around it ([`Board`]), stepped to an instant by [`Node::advance`]. A [`Pair`] keeps two of them in lock-step
//! with whatever passes between; a [`Relay`] runs two of which one only speaks and the other only hears, on one thread
//! or on two. Everything is a function of the images, the board and what the caller puts in: no wall clock, no
//! randomness, nothing that hangs on which thread comes first. All of it is plain data: a clone that is run on does
//! what the original does.
//!
//! # Time
//! Virtual time is `u64` nanoseconds from power-on, one time for all boards. Inside a board, time is counted in cycles
//! of its core, whose rate is what its crystals and its clock tree make of it ([`bench_seam::Timebase`]). Models act at
//! their exact cycles. The core acts on instruction boundaries, so an instant the core takes part in is late by at most
//! one instruction.
//!
//! # What stops a run from lying
//! An access where the part has nothing faults, as on silicon. An access to a register without a model, to a peripheral
//! whose clock is off, or to a state the manual forbids is a [`Finding`] with the instruction that did it. A run with
//! findings is not a passed run.

mod board;
mod finding;
mod firmware;
mod memory;
mod node;
mod pair;
mod relay;
mod rtt;
mod run;

pub use board::{Bare, Board, Input, View};
pub use finding::{Finding, FindingKind};
pub use firmware::{Firmware, Symbol};
pub use node::{FromOutside, LineEdge, Node, PROBE_PERIOD, ResetAt, Usage};
pub use pair::{Between, Lookahead, Nothing, Pair, Sent};
pub use relay::{Downstream, Relay, Threads, Upstream};
pub use rtt::{LogLevel, LogLine};
pub use run::{Clock, Event, Limits, Outcome, Target, run};

/// What the engine cannot do, as opposed to what a firmware does wrong.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The firmware image cannot be read.
    #[error("cannot read the firmware image: {0}")]
    Firmware(String),
    /// A segment of the image lies where the part has no memory.
    #[error(
        "{firmware} places {length} bytes at {address:#010x}, where the {part} has no memory: is it \
         linked for this part?"
    )]
    Placement {
        /// The image.
        firmware: String,
        /// The part.
        part: &'static str,
        /// The segment's first address.
        address: u64,
        /// Its length in bytes.
        length: usize,
    },
    /// The image has no such symbol.
    #[error("{firmware} has no symbol {symbol}: is it the right image, and is the symbol `#[no_mangle]` and used?")]
    NoSymbol {
        /// The image.
        firmware: String,
        /// The name asked for.
        symbol: String,
    },
    /// An address or symbol asked for is not in memory.
    #[error("{length} bytes at {address:#010x} are not memory of the target")]
    NotMemory {
        /// The first address.
        address: u64,
        /// How many bytes were asked for.
        length: usize,
    },
    /// Where the part's core looks for its vectors at reset, the image has none.
    #[error(
        "{firmware} has no vector table at {address:#010x}, where the {part} starts from, and begins at \
         {begins:#010x}: is it an image for this part, without a bootloader?"
    )]
    NoVectors {
        /// The image.
        firmware: String,
        /// The part.
        part: &'static str,
        /// Where the table should be.
        address: u64,
        /// The lowest address that the image fills.
        begins: u64,
    },
}

/// FNV-1a, 64 bits: a digest that is the same on every host and release.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Digest(u64);

impl Digest {
    const OFFSET: u64 = 0xCBF2_9CE4_8422_2325;
    const PRIME: u64 = 0x0000_0100_0000_01B3;

    pub(crate) fn new() -> Self {
        Self(Self::OFFSET)
    }

    pub(crate) fn bytes(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(Self::PRIME);
        }
    }

    pub(crate) fn word(&mut self, word: u64) {
        self.bytes(&word.to_le_bytes());
    }

    pub(crate) fn finish(self) -> u64 {
        self.0
    }
}
