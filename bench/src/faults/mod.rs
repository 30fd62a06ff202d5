//! Injected faults and their instants.
//!
//! [`Faults`] holds the faults of a run, for tests and for `cargo xtask sim --faults`: a list of [`Episode`]s, each a
//! [`Fault`] from one instant to another. Tests write episodes by hand; [`Faults::drawn`] draws them from a seed.
//!
//! | file | what it disturbs | where it acts |
//! |---|---|---|
//! | `st25r3916_model::AirFaults` | frames between the antennas | the air |
//! | [`receivers`] | what a GNSS receiver sends, its line, its bus | the receivers' interfaces on HORUS's board |
//! | [`state_inputs`] | HORUS's state inputs | HORUS's pins |
//! | [`front_end`] | HORUS's front end | its antenna, its chip select |
//! | [`chip`] | either front end's chip | its interrupts, its SPI, a bit of its registers |
//! | [`flight_controller`] | how the flight controller uses the SSI | the SSI's pins |
//! | [`wires`] | the signals between boards and world | FRESH, TICK, MISO, the radio |
//! | [`base`] | which objects the base station shows | what it reports of a profile |
//! | [`buffer`] | a bit of the DPR's receive or image buffers, once or for a while | the part's RAM |
//! | [`power`] | supply and reset of a board | the part and its front end |
//! | [`Fault::Hang`] | a board's core, which executes nothing more until its watchdog restarts it | the core |
//! | [`Fault::DeadTask`] | a task of a board, whose interrupt is off while the rest runs | the core |
//! | [`upset`] | a bit of RAM, flash or a register | the part's memory, its peripherals, the core |
//! | [`Fault::Drift`] | the oscillators of a microcontroller, which run faster or slower | the part's clocks |
//! | [`hold`], [`hold_board`] | the active hold, its sensors, and the air between it and the DPR | beside the DPR |
//! | [`image`] | instructions of a firmware in flash, or its variables | the image, before the run or in mid-run |
//!
//! [`plan`] draws episodes from a seed. Upsets are not drawn into a run, because [`crate::campaign`] tries each of them
//! on a copy of the bench.
//!
//! # Where to add a fault
//!
//! Most faults are variants of an enumeration in one of this folder's files (`ReceiverFault`, `PowerFault` and so on).
//! The fault's effect is in the same file. A line in [`plan`] makes `--faults` draw the fault.
//!
//! A fault of a new kind is a variant of [`Fault`] with its name, its side of the link ([`Fault::is_upstream`]) and its
//! disturbance ([`Fault::disturbs`]). The disturbance tells the judge what to excuse ([`bench_judge::disturbance`]).
//! Three files apply episodes: `sim/upstream.rs`, `sim/downstream.rs` and `sim/board_events.rs`. `panel.rs` lists the
//! faults that the panel of `cargo xtask live` offers.

pub mod base;
pub mod buffer;
pub mod chip;
pub mod flight_controller;
pub mod front_end;
pub mod hold;
pub mod hold_board;
pub mod image;
pub mod plan;
pub mod power;
pub mod receivers;
pub mod rng;
pub mod state_inputs;
pub mod upset;
pub mod wires;

use std::collections::VecDeque;

pub use base::BaseFault;
use bench_judge::disturbance::Harm;
pub use bench_judge::{Board, Disturbance};
pub use buffer::{BufferFault, Buffers};
pub use chip::{ChipFault, RegisterBit};
use emulator_part::Part;
pub use flight_controller::Conduct;
pub use front_end::{Emission, FrontEndFault};
pub use hold::HoldFault;
pub use hold_board::{HoldBoardFault, SensorFault};
pub use image::ImageFault;
use nrf52840::Nrf52840;
pub use plan::{Kind, UnknownKind};
pub use power::PowerFault;
pub use receivers::{Absurd, BusFault, LineFaults, OnLine, ReceiverFault};
pub use rng::Rng;
pub use st25r3916_model::AirFaults;
pub use state_inputs::InputFault;
use stm32f429::Stm32f429;
pub use upset::{RECEIVED, Targets, Upset};
pub use wires::{WireFault, Wires};

/// A fault. It lasts as long as its [`Episode`], or it occurs once, at the episode's beginning.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// A fault of the air between the link's two antennas.
    Air(AirFaults),
    /// A fault of a receiver, counted from 0, or of its line.
    Receiver(usize, ReceiverFault),
    /// A fault of a state input: 0 is the relay, 1 the motor cut, 2 the emergency measure.
    Input(usize, InputFault),
    /// A fault of HORUS's front end.
    FrontEnd(FrontEndFault),
    /// A fault of a board's front-end chip, or of a line to it.
    Chip(Board, ChipFault),
    /// A bit of a register of a board's front-end chip flips. The number is the bit's index in [`RegisterBit::all_of`],
    /// modulo the number of bits. The firmware must have corrected the bit when the episode ends.
    Flip(Board, u64),
    /// A misuse of the SSI by the flight controller.
    FlightController(Conduct),
    /// A fault of a wire.
    Wire(WireFault),
    /// A fault of the base station.
    Base(BaseFault),
    /// A fault of a board's supply or reset pin.
    Power(Board, PowerFault),
    /// A board's core hangs: it executes nothing and takes no interrupt, but its peripherals and DMA continue
    /// ([`emulator_node::Node::hang`]). Only the board's own watchdog ends the hang.
    Hang(Board),
    /// A task of a board is dead, because its interrupt is off. The number is the task's index in [`tasks_of`]. The
    /// board's watchdog ends the fault, because the task does not check in. A board that has not enabled its
    /// interrupts, hangs or has no supply is not affected.
    DeadTask(Board, u8),
    /// A task of a board runs once although nothing has called it: its interrupt becomes pending. The number is the
    /// task's index in [`tasks_of`]. A task that is a step of its board's cycle ([`is_step`]) makes the board stop; any
    /// other finds no work. A board that has not enabled its interrupts, hangs or has no supply is not affected.
    Spurious(Board, u8),
    /// A drift of the external oscillators of a board's microcontroller: the parts per billion that are added to the
    /// oscillators' earlier error.
    Drift(Board, i64),
    /// An upset of a bit of a board.
    Upset(Board, Upset),
    /// A fault of a bit of the DPR's buffers.
    Buffer(BufferFault),
    /// Damage to a board's program. The program is repaired at the episode's end.
    Image(Board, ImageFault),
    /// A fault of the active hold.
    Hold(HoldFault),
}

impl Fault {
    /// Returns the fault's name in the event log.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Air(_) => "air".into(),
            Self::Receiver(receiver, fault) => format!("receiver {} {}", receiver + 1, fault.name()),
            Self::Input(input, fault) => format!("input {}", fault.name(*input)),
            Self::FrontEnd(fault) => format!("poller {}", fault.name()),
            Self::Chip(board, fault) => format!("{} front end {}", name_of(*board), fault.name()),
            Self::Flip(board, _) => format!("{} front end register flips", name_of(*board)),
            Self::FlightController(conduct) => format!("flight controller {}", conduct.name()),
            Self::Wire(fault) => format!("wire {}", fault.name()),
            Self::Base(fault) => format!("base station {}", fault.name()),
            Self::Power(board, fault) => format!("power {} {}", name_of(*board), fault.name()),
            Self::Hang(board) => format!("hang {}", name_of(*board)),
            Self::DeadTask(board, task) => {
                let name = tasks_of(*board).get(usize::from(*task)).map_or("none", |(name, _)| name);
                format!("dead task {} {name}", name_of(*board))
            }
            Self::Spurious(board, task) => {
                let name = tasks_of(*board).get(usize::from(*task)).map_or("none", |(name, _)| name);
                format!("spurious interrupt {} {name}", name_of(*board))
            }
            Self::Drift(board, ppb) => format!("{} oscillators {:+.1} ppm", name_of(*board), *ppb as f64 / 1e3),
            Self::Upset(board, upset) => format!("{} {}", upset.name(), name_of(*board)),
            Self::Buffer(fault) => format!("buffer dpr {}", fault.name()),
            Self::Image(board, fault) => format!("image {} {}", name_of(*board), fault.name()),
            Self::Hold(fault) => format!("hold {}", fault.name()),
        }
    }

    /// The disturbance of the link that this fault causes. The judge excuses violations according to it.
    #[must_use]
    pub const fn disturbs(&self) -> Disturbance {
        match *self {
            Self::Air(_) => Disturbance::Air,
            Self::Receiver(receiver, _) => Disturbance::Receiver { receiver },
            Self::Input(input, _) => Disturbance::Input { input },
            Self::FrontEnd(_) => Disturbance::Emission,
            Self::Chip(board, fault) => Disturbance::FrontEnd { board, harm: fault.harm() },
            Self::Flip(board, _) => Disturbance::FrontEnd { board, harm: Harm::Deaf },
            Self::FlightController(conduct) => Disturbance::FlightController { conduct: conduct.disturbs() },
            Self::Wire(fault) => Disturbance::Wire { wire: fault.wire() },
            Self::Base(_) => Disturbance::BaseStation,
            Self::Power(board, fault) => fault.disturbs(board),
            Self::Hang(board) => Disturbance::Hang { board },
            Self::DeadTask(board, task) => Disturbance::DeadTask { board, task },
            Self::Spurious(board, task) if is_step(board, task) => Disturbance::Hang { board },
            Self::Spurious(board, _) => Disturbance::Spurious { board },
            Self::Drift(board, _) => Disturbance::Drift { board },
            Self::Upset(board, upset) => Disturbance::Memory { board, memory: upset.memory() },
            Self::Buffer(fault) => Disturbance::Memory { board: Board::Dpr, memory: fault.memory() },
            Self::Image(board, _) => Disturbance::Code { board },
            Self::Hold(fault) => fault.disturbs(),
        }
    }

    /// Whether the fault acts on HORUS's side of the link. The bench simulates that side ahead of the DPR's.
    #[must_use]
    pub fn is_upstream(&self) -> bool {
        match self {
            Self::Receiver(..) | Self::Input(..) | Self::FrontEnd(_) => true,
            Self::Air(_) | Self::FlightController(_) | Self::Base(_) | Self::Buffer(_) | Self::Hold(_) => false,
            Self::Wire(fault) => fault.is_upstream(),
            Self::Chip(board, _)
            | Self::Flip(board, _)
            | Self::Power(board, _)
            | Self::Hang(board)
            | Self::DeadTask(board, _)
            | Self::Spurious(board, _)
            | Self::Drift(board, _)
            | Self::Upset(board, _)
            | Self::Image(board, _) => *board == Board::Horus,
        }
    }
}

/// Returns a board's name in the event log.
#[must_use]
pub fn name_of(board: Board) -> &'static str {
    match board {
        Board::Horus => "horus",
        Board::Dpr => "dpr",
    }
}

/// The tasks of a board's firmware, each as its name and its interrupt vector.
#[must_use]
pub fn tasks_of(board: Board) -> &'static [(&'static str, &'static str)] {
    match board {
        Board::Horus => horus_tx_fw::task::TASKS,
        Board::Dpr => dpr_fw::task::TASKS,
    }
}

/// Returns whether the task at index `task` of [`tasks_of`] is a step of its board's cycle. If such a task runs
/// although nothing has called it, the board stops.
#[must_use]
pub const fn is_step(board: Board, task: u8) -> bool {
    let task = task as usize;
    match board {
        Board::Horus => task < horus_tx_fw::task::Task::ALL.len() && horus_tx_fw::task::Task::ALL[task].is_step(),
        Board::Dpr => task < dpr_fw::task::Task::ALL.len() && dpr_fw::task::Task::ALL[task].is_step(),
    }
}

/// The interrupt number of the task at index `task` of [`tasks_of`]; `None` if there is no such task.
#[must_use]
pub fn interrupt_of(board: Board, task: u8) -> Option<u16> {
    let (_, vector) = tasks_of(board).get(usize::from(task))?;
    let exception = match board {
        Board::Horus => Stm32f429::exception(vector),
        Board::Dpr => Nrf52840::exception(vector),
    };
    exception?.checked_sub(FIRST_INTERRUPT)
}

/// The number of the exception that is interrupt 0, ARMv7-M ARM table B1-4.
pub(crate) const FIRST_INTERRUPT: u16 = 16;

/// A fault and its duration.
#[derive(Clone, Debug, PartialEq)]
pub struct Episode {
    /// The instant at which the episode begins, virtual ns.
    pub at: u64,
    /// The instant at which the fault ends, ns: [`Episode::at`] without a duration, `u64::MAX` for never.
    pub until: u64,
    /// The fault.
    pub fault: Fault,
}

/// All faults of a run. The default has none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Faults {
    episodes: Vec<Episode>,
}

impl Faults {
    /// A run without faults.
    #[must_use]
    pub fn none() -> Self {
        Self::default()
    }

    /// Returns the faults of a run in which the air has `faults` all the time.
    #[must_use]
    pub fn of_air(faults: AirFaults) -> Self {
        Self::none().with(0, u64::MAX, Fault::Air(faults))
    }

    /// Adds an episode, and returns the faults with it.
    #[must_use]
    pub fn with(mut self, at: u64, until: u64, fault: Fault) -> Self {
        self.add(Episode { at, until, fault });
        self
    }

    /// Adds an episode.
    pub fn add(&mut self, episode: Episode) {
        let place = self.episodes.partition_point(|other| other.at <= episode.at);
        self.episodes.insert(place, episode);
    }

    /// The episodes of the run, in order of their beginnings.
    #[must_use]
    pub fn episodes(&self) -> &[Episode] {
        &self.episodes
    }

    /// Returns the timeline of the episodes on HORUS's side (`upstream`) or on the DPR's side.
    #[must_use]
    pub fn timeline(&self, upstream: bool) -> Timeline {
        let mine = self.episodes.iter().filter(|episode| episode.fault.is_upstream() == upstream);
        let mut turns: Vec<(u64, Turn)> = vec![];
        for episode in mine {
            turns.push((episode.at, Turn::Begins(episode.clone())));
            if let Fault::Power(_, PowerFault::Sag(seed)) = episode.fault {
                let volts = power::shape(seed).into_iter().map(|(after, microvolts)| (episode.at + after, microvolts));
                turns.extend(volts.map(|(at, microvolts)| (at, Turn::Supply { microvolts, seed })));
            }
            if episode.until > episode.at && episode.until != u64::MAX {
                turns.push((episode.until, Turn::Ends(episode.clone())));
            }
        }
        turns.sort_by_key(|(at, _)| *at);
        Timeline { turns: turns.into() }
    }
}

/// The beginning or end of an episode, or a change of a supply's voltage within it.
#[derive(Clone, Debug, PartialEq)]
pub enum Turn {
    /// The episode begins.
    Begins(Episode),
    /// The voltage of a sagging supply changes.
    Supply {
        /// The new voltage, µV.
        microvolts: u32,
        /// The episode's seed.
        seed: u64,
    },
    /// The episode ends.
    Ends(Episode),
}

/// The beginnings, changes and ends of episodes, in order of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Timeline {
    turns: VecDeque<(u64, Turn)>,
}

impl Timeline {
    /// Returns the instant of the first entry, ns; `u64::MAX` if there is none.
    #[must_use]
    pub fn next_at(&self) -> u64 {
        self.turns.front().map_or(u64::MAX, |(at, _)| *at)
    }

    /// Adds the entries of another timeline, in order of time.
    pub fn add(&mut self, other: Self) {
        for (at, turn) in other.turns {
            let place = self.turns.partition_point(|(before, _)| *before <= at);
            self.turns.insert(place, (at, turn));
        }
    }

    /// Takes the first entry if it is due at `now` (ns) or earlier.
    pub fn take(&mut self, now: u64) -> Option<Turn> {
        self.turns.pop_front_if(|(at, _)| *at <= now).map(|(_, turn)| turn)
    }
}
