//! States the priority, deadline and arrivals of each task, with their sources.
//!
//! A test compares the names and vectors with the firmwares' tables of tasks. Every search checks the statements: a
//! task that is released too often, never runs or has another priority is an error.

use dpr_fw::ssi::PAUSE_US;

use crate::analysis::Arrivals;

const US: u64 = 1_000;
const MS: u64 = 1_000_000;

/// The shortest time, ns, between the ends of two transactions that call `ssi_end`.
const PAUSE: u64 = PAUSE_US as u64 * US;

/// A window, ns, that is shorter than the shortest cycle of HORUS. Without its crystal HORUS's oscillator is up to 5 %
/// fast, and a task may come 0.1 ms earlier in its cycle than in the cycle before.
const CYCLE: u64 = 9_400 * US;

/// A group of tasks that follow from one chain of causes. The tasks have fixed phases to each other, but any phase to
/// the tasks of another group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// The cycle of HORUS and the cycle of the hold; on the DPR, HORUS's frames.
    Cycle,
    /// The flight controller's transactions.
    Ssi,
    /// The objects that the flight controller writes.
    Port,
    /// The exchange with the hold.
    Hold,
    /// The receivers, whose messages are independent of each other.
    Gnss,
    /// The parser of the receivers' bytes.
    Parse,
}

/// How the demand of a group is bounded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bounded {
    /// The bound is the greatest demand that was observed in any window.
    Measured,
    /// The bound follows from the stated arrivals of each task and its longest observed execution.
    Stated,
}

impl Group {
    /// Returns how the delay by this group is bounded for tasks of other groups.
    #[must_use]
    pub const fn on_others(self) -> Bounded {
        match self {
            Self::Cycle | Self::Port | Self::Hold | Self::Parse => Bounded::Measured,
            Self::Ssi | Self::Gnss => Bounded::Stated,
        }
    }

    /// Returns how the delay by this group is bounded for the group's own tasks. They have fixed phases if they follow
    /// from one chain of causes.
    #[must_use]
    pub const fn on_itself(self) -> Bounded {
        match self {
            Self::Gnss => Bounded::Stated,
            _ => Bounded::Measured,
        }
    }
}

/// The statements about a task.
#[derive(Clone, Debug)]
pub struct Stated {
    /// The task's name.
    pub name: &'static str,
    /// The task's interrupt vector.
    pub vector: &'static str,
    /// The task's priority in the firmware, 1 for the least urgent.
    pub level: u8,
    /// The priority number of the task's exception; a lower number is more urgent.
    pub priority: i16,
    /// The task's group.
    pub group: Group,
    /// The longest time from the task's release to its end, ns.
    pub deadline: u64,
    /// The source of the deadline.
    pub why: &'static str,
    /// The upper bound of the task's releases.
    pub arrivals: Arrivals,
    /// The source of these arrivals.
    pub source: &'static str,
    /// Whether the task is a step of a driver that has only one transfer or wait at a time.
    pub is_step: bool,
    /// The vector of a task that is called together with this one. It is given only if it distinguishes this row from
    /// another row of the same task.
    pub together: Option<&'static str>,
    /// Whether no code outside the tasks masks all interrupts at the task's release. Code that masks them keeps away
    /// from ticks and slots (`timing::quiet` in horus-tx-fw).
    pub in_quiet: bool,
}

/// The statements about a board's tasks.
#[derive(Clone, Debug)]
pub struct Table {
    /// The board's name.
    pub board: &'static str,
    /// The board's tasks, the most urgent first.
    pub tasks: Vec<Stated>,
    /// Whether the board is HORUS's or the DPR's, whose loads docs/design.md#timing bounds.
    pub is_of_the_link: bool,
    /// The longest window, ns, in which the demand of a group is measured.
    pub horizon: u64,
}

/// A row of a table: name, level, group, deadline and its reason, releases (most, within, apart) and their reason.
type Row = (&'static str, u8, Group, u64, &'static str, (u64, u64, u64), &'static str);

const RINGS: &str = "half a ring of 512 bytes at 460 800 bit/s";
const BUS: &str = "the next tick gives up a transfer that has not ended";
const ALIVE: &str = "a call a cycle to check in";
const CHARACTERS: &str = "a character at 460 800 bit/s; one message of settings at a time";
const RELEASED: &str =
    "before it can be called again; its 10 µs to the release of the buffers are a sum (see the sums)";
const FIFO: &str = "the next frame's first bytes: the FIFO holds a whole frame";
const ANSWER: &str = "an answer begins 0.2 ms after the frame at the earliest";
const SPI_END: &str = "the end of an SPI transfer of at least two bytes";

const HORUS: &[Row] = &[
    (
        "slot",
        5,
        Group::Cycle,
        40 * US,
        "timing::REST_STARTS_US",
        (3, CYCLE, 69 * US),
        "tick and slots: timing::SLOT_US",
    ),
    ("rf_spi", 4, Group::Cycle, 120 * US, "timing::BETWEEN_FRAMES_US", (64, CYCLE, 3 * US), SPI_END),
    ("rf_spi_error", 4, Group::Cycle, 10 * MS, "checks in once a cycle", (2, CYCLE, 100 * US), ALIVE),
    ("rf_irq", 4, Group::Cycle, 120 * US, "timing::BETWEEN_FRAMES_US", (8, CYCLE, 20 * US), "the chip's interrupts"),
    ("rf_timer", 4, Group::Cycle, 10 * MS, "checks in once a cycle", (6, CYCLE, 20 * US), "the driver's waits"),
    ("rf_slot", 4, Group::Cycle, 40 * US, "timing::REST_STARTS_US", (3, CYCLE, 3 * MS), "timing::SLOT_US"),
    ("cycle", 3, Group::Cycle, 0, "timing::FILL_US", (1, CYCLE, CYCLE), "design.md#timing"),
    ("vote", 3, Group::Cycle, 9 * MS, "before the next tick", (1, CYCLE, CYCLE), "design.md#timing"),
    ("gnss_tick", 2, Group::Cycle, 5_500 * US, RINGS, (1, CYCLE, CYCLE), "design.md#timing"),
    ("gnss1", 2, Group::Gnss, 5_500 * US, RINGS, (48, CYCLE, 10 * US), CHARACTERS),
    ("gnss1_ring", 2, Group::Gnss, 5_500 * US, RINGS, (4, CYCLE, 5 * US), "half rings, and a call a cycle"),
    ("gnss2", 2, Group::Gnss, 9 * MS, BUS, (48, CYCLE, 10 * US), "a byte at 400 kbit/s; one message"),
    ("gnss2_error", 2, Group::Gnss, 9 * MS, BUS, (4, CYCLE, 5 * US), "bus errors, and a call a cycle"),
    ("gnss2_read", 2, Group::Gnss, 9 * MS, BUS, (6, CYCLE, 100 * US), "reads, and a call a cycle"),
    ("gnss2_step", 2, Group::Gnss, 9 * MS, BUS, (24, CYCLE, 5 * US), "steps of a bus recovery, and a call a cycle"),
    ("gnss3", 2, Group::Gnss, 9 * MS, BUS, (6, CYCLE, 100 * US), "transfers, and a call a cycle"),
    ("gnss3_error", 2, Group::Gnss, 9 * MS, BUS, (4, CYCLE, 5 * US), "errors, and a call a cycle"),
    ("gnss3_step", 2, Group::Gnss, 9 * MS, BUS, (4, CYCLE, 5 * US), "waits around transfers, and a call a cycle"),
    ("gnss4", 2, Group::Gnss, 5_500 * US, RINGS, (48, CYCLE, 10 * US), CHARACTERS),
    ("gnss4_ring", 2, Group::Gnss, 5_500 * US, RINGS, (4, CYCLE, 5 * US), "half rings, and a call a cycle"),
    ("gnss5", 2, Group::Gnss, 5_500 * US, RINGS, (48, CYCLE, 10 * US), CHARACTERS),
    ("gnss5_ring", 2, Group::Gnss, 5_500 * US, RINGS, (4, CYCLE, 5 * US), "half rings, and a call a cycle"),
    ("parse", 1, Group::Parse, 10 * MS, "one cycle", (40, CYCLE, 5 * US), "calls of the sources, and its own"),
];

/// The tasks of HORUS that a tick or a slot calls.
const AT_TICK_OR_SLOT: [&str; 4] = ["slot", "rf_slot", "cycle", "vote"];

/// The DPR's `commit` has two rows, because it does two kinds of work. It prepares an image while a frame arrives, and
/// it publishes the image at the frame's end. Only for the publication it is called together with `scrub`.
const PUBLISHES: &str = "commit, at a frame's end";

const DPR: &[Row] = &[
    (
        "ssi_end",
        6,
        Group::Ssi,
        PAUSE,
        RELEASED,
        (2, PAUSE, 5 * US),
        "an end in 95 µs (design.md#ssi), and a publication",
    ),
    ("ssi_pause", 6, Group::Ssi, PAUSE, RELEASED, (1, PAUSE, PAUSE), "design.md#ssi"),
    ("rf_spi", 5, Group::Cycle, 450 * US, FIFO, (64, CYCLE, 3 * US), SPI_END),
    ("rf_irq", 5, Group::Cycle, 450 * US, FIFO, (8, CYCLE, 20 * US), "the chip's interrupts"),
    ("rf_timer", 5, Group::Cycle, 450 * US, FIFO, (16, CYCLE, 20 * US), "the driver's waits"),
    (
        "commit",
        4,
        Group::Cycle,
        1_900 * US,
        "the rest of the shortest frame behind its first 16 bytes",
        (6, CYCLE, 10 * US),
        "each frame's beginning and end, and a call a cycle",
    ),
    (
        PUBLISHES,
        4,
        Group::Cycle,
        450 * US,
        "gap, preamble and sync of the next frame; FRESH rises before: see the sums",
        (6, CYCLE, 300 * US),
        "frames in a cycle, and early ones (design.md#air-frame)",
    ),
    (
        "deadline",
        4,
        Group::Cycle,
        450 * US,
        "as at a frame's end",
        (3, CYCLE, 20 * US),
        "design.md#publication, and a call a cycle by scrub",
    ),
    (
        "scrub",
        3,
        Group::Cycle,
        9 * MS,
        "the next frame needs the buffer",
        (8, CYCLE, 20 * US),
        "frames in a cycle, and deadlines",
    ),
    (
        "port",
        2,
        Group::Port,
        9 * MS,
        "the next image needs the prepared area",
        (40, CYCLE, 5 * US),
        "transactions and images: dpr-fw/src/ssi.rs, BUDGET",
    ),
    ("hold_spi", 1, Group::Hold, MS, "dpr-fw/src/hold.rs, ANSWER_US", (60, CYCLE, 3 * US), SPI_END),
    ("hold_irq", 1, Group::Hold, MS, "dpr-fw/src/hold.rs, ANSWER_US", (8, CYCLE, 20 * US), "the chip's interrupts"),
    ("hold_timer", 1, Group::Hold, MS, "dpr-fw/src/hold.rs, ANSWER_US", (8, CYCLE, 20 * US), "the driver's waits"),
];

const BEAT: u64 = 25 * MS - 25 * US;

const HOLD: &[Row] = &[
    (
        "slot",
        4,
        Group::Cycle,
        10 * US,
        "hold-fw/src/main.rs",
        (2, BEAT, 400 * US),
        "hold-fw/src/timing.rs: beats and slot",
    ),
    ("rf_spi", 3, Group::Cycle, 200 * US, ANSWER, (80, BEAT, 3 * US), SPI_END),
    ("rf_irq", 3, Group::Cycle, 200 * US, ANSWER, (8, BEAT, 20 * US), "the chip's interrupts"),
    ("rf_timer", 3, Group::Cycle, 200 * US, ANSWER, (8, BEAT, 20 * US), "the driver's waits"),
    ("cycle", 2, Group::Cycle, 300 * US, "hold-fw/src/main.rs", (1, BEAT, BEAT), "a call a beat"),
    ("answer", 2, Group::Cycle, 10 * MS, "hold-fw/src/main.rs", (4, BEAT, 100 * US), "answers, and a call a beat"),
    ("sensors", 1, Group::Cycle, 25 * MS, "the next beat", (1, BEAT, BEAT), "a call a beat"),
];

impl Table {
    /// Returns HORUS's tasks with `gps` receivers.
    #[must_use]
    pub fn horus(gps: usize) -> Self {
        let mut table = Self::new("HORUS", HORUS, horus_tx_fw::task::TASKS, 16, 12 * MS);
        for cycle in table.tasks.iter_mut().filter(|task| task.name == "cycle") {
            cycle.deadline = (10 + 14 * (1 + gps as u64)) * US;
        }
        table
    }

    /// Returns the DPR's tasks, with `hold` also those of its second port.
    #[must_use]
    pub fn dpr(hold: bool) -> Self {
        let rows = if hold { DPR } else { &DPR[..DPR.len() - dpr_fw::task::hold::TASKS.len()] };
        let vectors = [dpr_fw::task::TASKS, if hold { dpr_fw::task::hold::TASKS } else { &[] }].concat();
        Self::new(if hold { "DPR with a hold" } else { "DPR" }, rows, &vectors, 8, 12 * MS)
    }

    /// Returns the hold's tasks.
    #[must_use]
    pub fn hold() -> Self {
        Self::new("hold", HOLD, hold_fw::task::TASKS, 8, 52 * MS)
    }

    /// Returns a board's table. The microcontroller has `levels` priorities.
    fn new(
        board: &'static str,
        rows: &[Row],
        vectors: &[(&'static str, &'static str)],
        levels: i16,
        horizon: u64,
    ) -> Self {
        let vector = |name: &str| {
            let task = name.split(',').next().unwrap_or(name);
            vectors.iter().find(|(of, _)| *of == task).map_or("", |(_, vector)| *vector)
        };
        let row = |&(name, level, group, deadline, why, (most, within, apart), source): &Row| Stated {
            name,
            vector: vector(name),
            level,
            priority: (levels - i16::from(level)) * (256 / levels),
            group,
            deadline,
            why,
            arrivals: Arrivals { most, within, apart },
            source,
            is_step: name.starts_with("rf_") || name.starts_with("hold_"),
            together: (name == PUBLISHES).then(|| vector("scrub")),
            in_quiet: board == "HORUS" && AT_TICK_OR_SLOT.contains(&name),
        };
        Self { board, tasks: rows.iter().map(row).collect(), is_of_the_link: board != "hold", horizon }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_task_of_the_firmwares_is_in_its_table_once() {
        let dpr = [dpr_fw::task::TASKS, dpr_fw::task::hold::TASKS].concat();
        for (table, tasks) in [
            (Table::horus(3), horus_tx_fw::task::TASKS),
            (Table::dpr(false), dpr_fw::task::TASKS),
            (Table::dpr(true), &dpr),
            (Table::hold(), hold_fw::task::TASKS),
        ] {
            let named: Vec<_> =
                table.tasks.iter().filter(|it| it.together.is_none()).map(|it| (it.name, it.vector)).collect();
            assert_eq!(named, tasks, "{}", table.board);
        }
    }
}
