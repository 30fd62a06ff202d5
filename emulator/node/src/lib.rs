//! Nodes: real firmware images on emulated microcontrollers, in virtual time.
//!
//! A [`Node`] is one board: a Cortex-M4 ([`cortex_m4`]), the models of its part ([`emulator_part::Part`]) and what is
//! wired around the part ([`Board`]). [`Node::advance`] runs it to an instant. A [`Pair`] keeps two nodes in lock-step,
//! with whatever passes between them. A [`Relay`] runs two nodes, one of which only sends and the other only receives,
//! on one thread or on two. A run is a function of the images, the board and the caller's inputs: nothing depends on
//! wall-clock time, randomness or the order of threads. All state is plain data: a clone that is run on does what the
//! original does.
//!
//! ```
//! use emulator_node::{Clock, Event, Firmware, Limits, Target};
//!
//! // The stack's top, the reset vector, and a loop: adds r0, #1; b to it.
//! let words = [0x2000_4000_u32, 0x0800_0009, 0xE7FD_3001];
//! let image = words.iter().flat_map(|word| word.to_le_bytes()).collect();
//! let firmware = Firmware::raw("a loop", vec![(0x0800_0000, image)]);
//! let limits = Limits { virtual_time: 1_000_000, ..Limits::default() };
//! let outcome = Target::Horus.run(Clock::Optimistic, &firmware, limits, |event| {
//!     if let Event::Line(line) = event {
//!         println!("{line}");
//!     }
//! })?;
//! // A millisecond of 16 MHz: each turn takes three cycles, as on silicon at best.
//! assert!(outcome.findings.is_empty());
//! assert!((10_600..10_700).contains(&outcome.instructions), "{}", outcome.instructions);
//! # Ok::<(), emulator_node::Error>(())
//! ```
//!
//! # Time
//! Virtual time is `u64` nanoseconds from power-on, and it is the same for all boards. Inside a board, time is counted
//! in cycles of its core, whose rate follows from its crystals and its clock tree ([`emulator_part::Timebase`]). Models
//! act at their exact cycles. The core acts at instruction boundaries, so whatever involves the core is late by at most
//! one instruction.
//!
//! # How a run shows what is not modelled
//! An access to an address where the part has nothing faults, as on silicon. An access to a register without a model,
//! to a peripheral whose clock is off, or to a state that the manual forbids makes a [`Finding`] with the instruction
//! that did it. A run with findings has not passed.
#![forbid(unsafe_code)]

mod access_port;
mod board;
mod debugger;
mod digest;
mod error;
mod finding;
mod firmware;
mod hold;
mod input;
mod leads;
mod memory;
mod pair;
mod probe;
mod relay;
mod report;
mod reset;
mod rtt;
mod run;
mod semihosting;
mod side;
mod stack;
mod start;
mod step;
mod tasks;
mod usage;

use std::collections::BTreeSet;

use cortex_m4::{Core, Cost, Fast};

pub use board::{Bare, Board, Input, View};
pub use digest::Digest;
pub use error::Error;
pub use finding::{Finding, FindingKind};
pub use firmware::{Firmware, Symbol};
use hold::Hold;
pub use hold::{Halt, Resume};
pub use leads::{Connected, Drive, Leads, PinEdge, Sending, SentByte};
pub use pair::{Between, Lookahead, Nothing, Pair, Sent};
pub use probe::PROBE_PERIOD;
pub use relay::{Course, Downstream, Relay, Threads, Upstream, Way};
pub use reset::{FromOutside, ResetAt};
pub use rtt::{LogLevel, LogLine};
pub use run::Running;
pub use run::{Clock, Event, Limits, Outcome, Target, run, run_connected};
use side::Side;
pub use stack::Stack;
pub use usage::{LineEdge, Usage};

/// One board that runs one firmware: a core, its part, the chips around it, and the clock between them.
///
/// [`Node::advance`] runs the core until an instant is reached. Events of the part and of the board that are due before
/// that happen on the way, each at its own instant. The part counts cycles of its core; an [`emulator_part::Timebase`]
/// converts cycles into the bench's nanoseconds and follows the part's clock tree. A node is plain data: a clone that
/// is run on does what the original does.
#[derive(Clone, Debug)]
pub struct Node<B: Board, C: Cost = Fast> {
    core: Core<C>,
    side: Side<B>,
    firmware: Firmware,
    semihosting: bool,
    exit: Option<u32>,
    traps: Traps,
    /// The debugger's settings and requests for the core.
    hold: Hold,
    /// Whether the part has its supply.
    powered: bool,
    /// The lowest supply voltage since the supply began to hold the part in reset, in µV.
    lowest: u32,
    /// Whether a debugger has powered the debug domain.
    debugged: bool,
    /// Whether the part was told (by `Part::halts`) that the core is halted for debug.
    told_halt: bool,
    /// The active exception from each instant (ns) on; `None` if exceptions are not recorded.
    tasks: Option<Vec<(u64, u16)>>,
    resets: Vec<ResetAt>,
    probe_at: u64,
    log_block: Option<Symbol>,
    /// The instant, virtual ns, at which the RAM is next searched for the log's control block, if the image does not
    /// say where the block is.
    search_at: u64,
    log: rtt::Channels,
    lines: Vec<LogLine>,
    console: rtt::Text,
    findings: Vec<Finding>,
    reported: BTreeSet<(FindingKind, String)>,
}

/// The instructions at which the node stops to report an event of the firmware, before the firmware continues.
#[derive(Clone, Debug, Default)]
struct Traps {
    default_handler: BTreeSet<u64>,
    panic: BTreeSet<u64>,
}
