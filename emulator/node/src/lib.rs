//! Nodes: real firmware images on emulated microcontrollers, in virtual time.
//!
//! A [`Node`] is one board: a Cortex-M4 ([`cortex_m4`]), the models of its part ([`emulator_part::Part`]) and what is
//! wired around it ([`Board`]), stepped to an instant by [`Node::advance`]. A [`Pair`] keeps two of them in lock-step
//! with whatever passes between; a [`Relay`] runs two of which one only speaks and the other only hears, on one thread
//! or on two. Everything is a function of the images, the board and what the caller puts in: no wall clock, no
//! randomness, nothing that hangs on which thread comes first. All of it is plain data: a clone that is run on does
//! what the original does.
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
//! Virtual time is `u64` nanoseconds from power-on, one time for all boards. Inside a board, time is counted in cycles
//! of its core, whose rate is what its crystals and its clock tree make of it ([`emulator_part::Timebase`]). Models act
//! at their exact cycles. The core acts on instruction boundaries, so an instant the core takes part in is late by at
//! most one instruction.
//!
//! # What stops a run from lying
//! An access where the part has nothing faults, as on silicon. An access to a register without a model, to a peripheral
//! whose clock is off, or to a state the manual forbids is a [`Finding`] with the instruction that did it. A run with
//! findings is not a passed run.
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
pub use leads::{Connected, Drive, Heard, Leads, PinEdge, Sending};
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

/// One board, running one firmware: a core, its part, the chips around it, and the clock between them.
///
/// The core runs until an instant is reached ([`Node::advance`]), and what is due in the part and on the board before
/// that happens on the way, each at its own instant. The part counts cycles of its core; a [`emulator_part::Timebase`]
/// turns them into the bench's nanoseconds and follows the part's clock tree. A node is plain data: a clone that is run
/// on does what the original does.
#[derive(Clone, Debug)]
pub struct Node<B: Board, C: Cost = Fast> {
    core: Core<C>,
    side: Side<B>,
    firmware: Firmware,
    semihosting: bool,
    exit: Option<u32>,
    traps: Traps,
    /// What a debugger wants of the core.
    hold: Hold,
    /// The part has its supply.
    powered: bool,
    /// The lowest that the supply was while it held the part in reset, µV.
    lowest: u32,
    /// A debugger has the debug domain powered.
    debugged: bool,
    /// The part was told that the core is halted for debug.
    told_halt: bool,
    /// Which exception was active from when (ns) on; nothing unless watched.
    tasks: Option<Vec<(u64, u16)>>,
    resets: Vec<ResetAt>,
    probe_at: u64,
    log_block: Option<Symbol>,
    /// When RAM is searched for the block of an image that does not say where it is, virtual ns.
    search_at: u64,
    log: rtt::Channels,
    lines: Vec<LogLine>,
    console: rtt::Text,
    findings: Vec<Finding>,
    reported: BTreeSet<(FindingKind, String)>,
}

/// Instructions the node stops at to report what happened, and goes on from.
#[derive(Clone, Debug, Default)]
struct Traps {
    default_handler: BTreeSet<u64>,
    panic: BTreeSet<u64>,
}
