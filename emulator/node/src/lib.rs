//! Nodes: real firmware images on emulated microcontrollers, in virtual time.
//!
//! A [`Node`] is one board: a Cortex-M4 ([`cortex_m4`]), the models of its part ([`emulator_part::Part`]) and the chips
//! around the part ([`Board`]). [`Node::advance`] runs the node to an instant. A [`Pair`] keeps two nodes in lock-step.
//! A [`Relay`] runs a sender and a receiver, on one thread or on two. A run depends only on the images, the boards and
//! the caller's inputs, and not on wall-clock time or threads. All state is plain data, and a clone runs on as the
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
//! let outcome = Target::Stm32f429.run(Clock::Optimistic, &firmware, limits, |event| {
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
//! Virtual time is `u64` nanoseconds from power-on, the same for all boards. Inside a board, time is counted in cycles
//! of its core, whose rate follows from crystals and clock tree ([`emulator_part::Timebase`]). Models act at their
//! exact cycles. The core acts between instructions, so it is late by at most one instruction.
//!
//! # How a run shows what is not modelled
//! An access to an address where the part has nothing faults, as on silicon. Some accesses make a [`Finding`] that
//! names the instruction: those to a register without a model, to a peripheral whose clock is off, or into a state that
//! the manual forbids. A run with findings has not passed.
#![forbid(unsafe_code)]

mod access_port;
mod any;
mod board;
mod coverage;
mod debugger;
mod digest;
mod error;
mod finding;
mod firmware;
mod hold;
mod input;
mod leads;
mod memory;
#[cfg(feature = "pack")]
mod packed;
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

use cortex_m4::{Core, Cost, Fast, Scheduled};

pub use any::{AnyNode, AnyRun};
pub use board::{Bare, Board, Input, View};
pub use digest::Digest;
pub use error::Error;
pub use finding::{Finding, FindingKind};
pub use firmware::{Firmware, Symbol};
use hold::Hold;
pub use hold::{Halt, Resume};
pub use leads::{Connected, Drive, DrivenEdge, Leads, PinEdge, Sending, SentByte};
pub use pair::{Between, Lookahead, Nothing, Pair, Sent};
pub use probe::PROBE_PERIOD;
pub use relay::{Course, Downstream, Leader, Relay, Threads, Upstream, Way};
pub use reset::{FromOutside, ResetAt};
pub use rtt::{LogLevel, LogLine};
pub use run::Running;
pub use run::{Clock, Event, Limits, Outcome, Target, run};
use side::Side;
pub use stack::Stack;
pub use usage::{LineEdge, Usage};

/// One board that runs one firmware: a core, its part, the chips around it, and the clock between them.
///
/// [`Node::advance`] runs the core until an instant is reached. Events of the part and of the board happen on the way,
/// each at its own instant. A node is plain data, and its clone runs on as the original does.
#[derive(Clone, Debug)]
pub struct Node<B: Board, C: Cost = Fast> {
    core: Core<C>,
    side: Side<B>,
    firmware: Firmware,
    semihosting: bool,
    exit: Option<u32>,
    traps: Traps,
    hold: Hold,
    powered: bool,
    /// The lowest voltage of the supply, in µV, since it last fell below the voltage at which the part is held in
    /// reset.
    lowest: u32,
    debugged: bool,
    told_halt: bool,
    /// The exceptions that became active, each with its instant in ns; `None` while they are not recorded.
    tasks: Option<Vec<(u64, u16)>>,
    /// The events that decide which exception runs, each with its instant in ns; `None` if they are not recorded.
    schedule: Option<Vec<(u64, Scheduled)>>,
    resets: Vec<ResetAt>,
    probe_at: u64,
    log_block: Option<Symbol>,
    /// The virtual instant, in ns, at which RAM is next searched for the log's control block.
    search_at: u64,
    log: rtt::Channels,
    lines: Vec<LogLine>,
    console: rtt::Text,
    findings: Vec<Finding>,
    reported: BTreeSet<(FindingKind, String)>,
}

/// The addresses of the instructions before which the node stops to report an event of the firmware.
#[derive(Clone, Debug, Default)]
struct Traps {
    default_handler: BTreeSet<u64>,
    panic: BTreeSet<u64>,
}
