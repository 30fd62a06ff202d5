//! What a run of the link showed: the figures, and what it broke.
//!
//! Everything here is a function of the images, the seed and the flags, so two runs give the same bytes, but for
//! [`Speed`], which is the host's. Times are virtual nanoseconds. Figures that contain processor time hold for the
//! run's clock ([`Report::clock`]): on the fast one they are estimates, the other two bound what silicon takes.

use std::collections::BTreeMap;

pub use bench_judge::{Exclusion, Faults, Max, Quantiles, Span};
use serde::Serialize;

use crate::faults::{Campaign, Class, name_of};

/// How fast the host ran it: the one part of a report that differs between runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Speed {
    /// Virtual time over wall time.
    pub times_real_time: f64,
}

/// The sending side.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Horus {
    /// Frames whose preamble went on the air.
    pub frames_sent: u64,
    /// Between the first frames of two cycles in a row.
    pub period_ns: Option<Span>,
    /// From the 10 ms timer's tick to the transmit command of the cycle's first frame: chip select rising after its
    /// byte. Its jitter is the firmware's.
    pub tick_to_command_ns: Option<Span>,
    /// From the same tick to the first preamble bit of the cycle's first frame. Its jitter is the firmware's and the
    /// scatter with which the front end starts.
    pub tick_to_air_ns: Option<Span>,
    /// The part of the time in which the core was awake.
    pub load: f64,
}

/// Between the antennas.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Air {
    /// Bits per second of the last frame.
    pub bit_rate: u64,
    /// From the first preamble bit to the last bit of the longest frame.
    pub air_time_ns: u64,
    /// Frames that arrived whole.
    pub frames_delivered: u64,
    /// Frames that arrived with at least one wrong bit.
    pub frames_damaged: u64,
    /// Frames that did not arrive.
    pub frames_lost: u64,
}

/// The receiving side, by the DPR's own counters.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Dpr {
    /// Objects that passed CRC, identifier and freshness.
    pub objects_accepted: u64,
    /// Objects that did not.
    pub objects_rejected: u64,
    /// Expirations of the missed-frame deadline.
    pub frames_missed: u64,
    /// Receive buffers scrubbed.
    pub scrubs: u64,
    /// Scrubs that found a bit stuck.
    pub scrub_faults: u64,
    /// The part of the time in which the core was awake.
    pub load: f64,
}

/// How old data is when it can be read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Latency {
    /// From the tick that stamps the objects to the image that holds them being what the next SSI transaction gets.
    pub sample_to_readable: Option<Quantiles>,
    /// From the cycle's last bit on the air to the same.
    pub last_bit_to_readable: Option<Max>,
}

/// The flight controller's port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Ssi {
    /// Transactions of the flight controller.
    pub transactions: u64,
    /// Transactions that brought a profile not seen before.
    pub fresh: u64,
    /// Transactions that brought the last profile again.
    pub repeated: u64,
    /// Transactions that met the DPR busy and read 0xFF throughout.
    pub busy: u64,
    /// Transactions in which something that claimed to be valid failed its CRC.
    pub bad_crc: u64,
    /// From CSN rising to the DPR being able to serve the next transaction.
    pub ready_ns: Option<Max>,
}

/// Reported-Position as the flight controller read it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Reported {
    /// Cycles of HORUS whose Reported-Position was read and had a valid position.
    pub valid_cycles: u64,
    /// When chip select fell for the first of the transactions that brought no valid position any more, ns; `None` if
    /// the last one brought one, or none ever did.
    pub invalid_since_ns: Option<u64>,
    /// For each receiver in turn, when the last byte of its last valid position had arrived at HORUS, ns; `None` if it
    /// sent none.
    pub last_solution_ns: Vec<Option<u64>>,
}

/// What HORUS's voter did, over the profiles that HORUS sent.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Voter {
    /// Cycles in which so many receivers agree.
    pub agree: BTreeMap<u64, u64>,
    /// Cycles with fewer than are fitted.
    pub degraded: u64,
    /// Cycles without a position.
    pub none: u64,
    /// How far Reported-Position was from the flight at worst, along the ground, m; `None` if there was no position, or
    /// a recording was played.
    pub max_error_m: Option<f64>,
    /// Who was excluded, in order of their beginnings: the first thousand.
    pub exclusions: Vec<Exclusion>,
}

impl From<bench_judge::Voter> for Voter {
    fn from(bench_judge::Voter { agree, degraded, none, worst_mm, exclusions }: bench_judge::Voter) -> Self {
        Self { agree, degraded, none, max_error_m: worst_mm.map(|mm| mm as f64 / 1e3), exclusions }
    }
}

/// The far end of the radio.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Base {
    /// Profiles received.
    pub profiles: u64,
    /// Objects that failed a CRC there.
    pub bad_crc: u64,
}

/// What upsets of one kind on one board came to.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct UpsetClasses {
    /// Nothing that the flight controller could see.
    pub masked: usize,
    /// Something, but nothing invalid was shown as valid.
    pub detected: usize,
    /// Something invalid was shown as valid.
    pub dangerous: usize,
}

/// What upsets came to.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Upsets {
    /// By board and kind, as `dpr ram`.
    pub classes: BTreeMap<String, UpsetClasses>,
    /// The dangerous ones in words: when, where, what was violated. The run's seed reproduces them.
    pub dangerous: Vec<String>,
}

impl From<&Campaign> for Upsets {
    fn from(campaign: &Campaign) -> Self {
        let mut upsets = Self::default();
        for trial in &campaign.trials {
            let name = format!("{} {}", name_of(trial.board), trial.upset.kind());
            let classes = upsets.classes.entry(name).or_default();
            *match trial.class {
                Class::Masked => &mut classes.masked,
                Class::Detected => &mut classes.detected,
                Class::Dangerous => &mut classes.dangerous,
            } += 1;
        }
        upsets.dangerous = campaign.dangerous().map(ToString::to_string).collect();
        upsets
    }
}

/// A run of the link.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// The seed of everything random.
    pub seed: u64,
    /// What the cores' time costs: `fast`, `optimistic` or `pessimistic`. The last two bound what silicon takes.
    pub clock: &'static str,
    /// How long the run was.
    pub virtual_seconds: f64,
    /// Receivers in the profile.
    pub gps: usize,
    /// How fast the host ran it.
    pub speed: Speed,
    /// The sending side.
    pub horus: Horus,
    /// Between the antennas.
    pub air: Air,
    /// The receiving side.
    pub dpr: Dpr,
    /// How old data is when it can be read.
    pub latency_ns: Latency,
    /// The flight controller's port.
    pub ssi: Ssi,
    /// Reported-Position as the flight controller read it.
    pub reported: Reported,
    /// HORUS's voter.
    pub voter: Voter,
    /// The far end of the radio.
    pub base: Base,
    /// What was done wrong on purpose, and what came of it.
    pub faults: Faults,
    /// What upsets of RAM, flash and registers came to, where they were tried.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub upsets: Option<Upsets>,
    /// What was violated, in words.
    pub violations: Vec<String>,
}
