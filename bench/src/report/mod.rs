//! The figures and violations of a run of the link.
//!
//! The report is a function of the programs, the seed and the flags, except for [`Speed`], which is that of the host.
//! Times are virtual nanoseconds. The run's clock ([`Report::clock`]) determines all processor times. On the fast clock
//! they are estimates; the other two clocks give bounds for silicon.

use std::collections::BTreeMap;

pub use bench_judge::{Exclusion, Faults, Max, Quantiles, Span};
use serde::Serialize;

/// The speed of the host. No other part of a report differs between two equal runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Speed {
    /// The run's virtual time divided by the wall time that the run took.
    pub times_real_time: f64,
}

/// The figures of HORUS, the sending side.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Horus {
    /// The number of frames whose preamble went on the air.
    pub frames_sent: u64,
    /// The time between the first frames of two successive cycles, ns.
    pub period_ns: Option<Span>,
    /// The time from the tick to the transmit command of the cycle's first frame (rise of chip select), ns.
    pub tick_to_command_ns: Option<Span>,
    /// The time from the tick to the first preamble bit of the cycle's first frame, ns.
    pub tick_to_air_ns: Option<Span>,
    /// The fraction of the time in which HORUS's core was awake.
    pub load: f64,
}

/// The figures of the air between the antennas.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Air {
    /// The bit rate of the last frame, bit/s.
    pub bit_rate: u64,
    /// The time from the first preamble bit to the last bit of the longest frame, ns.
    pub air_time_ns: u64,
    /// The number of frames that arrived whole.
    pub frames_delivered: u64,
    /// The number of frames that arrived with at least one wrong bit.
    pub frames_damaged: u64,
    /// The number of frames that did not arrive.
    pub frames_lost: u64,
}

/// The figures of the DPR, from its own counters.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Dpr {
    /// The instant of the DPR's last start, ns, from which the DPR's counters count.
    pub since_ns: u64,
    /// The number of objects that passed CRC, identifier and freshness.
    pub objects_accepted: u64,
    /// The number of objects that failed CRC, identifier or freshness.
    pub objects_rejected: u64,
    /// The number of times that the DPR's deadline for the next frame passed without a frame.
    pub frames_missed: u64,
    /// The number of receive buffers scrubbed.
    pub scrubs: u64,
    /// The number of scrubs that found a stuck bit.
    pub scrub_faults: u64,
    /// The fraction of the time in which the DPR's core was awake.
    pub load: f64,
}

/// The times until the flight controller can read new data.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Latency {
    /// The time from the objects' timestamp until the next transaction could read their image, ns.
    pub sample_to_readable: Option<Quantiles>,
    /// The time from the cycle's last bit on the air until the next transaction could read the cycle's image, ns.
    pub last_bit_to_readable: Option<Max>,
}

/// The figures of the flight controller's SSI transactions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Ssi {
    /// The number of transactions of the flight controller.
    pub transactions: u64,
    /// The number of transactions with a new profile.
    pub fresh: u64,
    /// The number of transactions with a profile that an earlier transaction had already read.
    pub repeated: u64,
    /// The number of transactions that read only 0xFF, because the DPR was busy.
    pub busy: u64,
    /// The number of transactions in which an object that is marked valid failed its CRC.
    pub bad_crc: u64,
    /// The time from the end of a transaction until the DPR can serve the next one, ns.
    pub ready_ns: Option<Max>,
}

/// The figures of Reported-Position as the flight controller reads it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Reported {
    /// The number of HORUS's cycles whose Reported-Position was read with a valid position.
    pub valid_cycles: u64,
    /// The instant, ns, at which the run's final transactions without a valid position began; `None` if the last
    /// transaction read a valid position.
    pub invalid_since_ns: Option<u64>,
    /// The instant, ns, at which each receiver's last valid position had arrived at HORUS; `None` without a valid
    /// position.
    pub last_solution_ns: Vec<Option<u64>>,
}

/// The figures of HORUS's voter, over all profiles that HORUS sent.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Voter {
    /// The number of cycles, by the number of receivers that agree.
    pub agree: BTreeMap<u64, u64>,
    /// The number of cycles in which not all receivers agree.
    pub degraded: u64,
    /// The number of cycles in which the voter had no position.
    pub none: u64,
    /// The largest horizontal error of Reported-Position, m; `None` without a position or a true position.
    pub max_error_m: Option<f64>,
    /// The voter's first thousand exclusions of a receiver, in order of their beginnings.
    pub exclusions: Vec<Exclusion>,
}

impl From<bench_judge::Voter> for Voter {
    fn from(bench_judge::Voter { agree, degraded, none, worst_mm, exclusions }: bench_judge::Voter) -> Self {
        Self { agree, degraded, none, max_error_m: worst_mm.map(|mm| mm as f64 / 1e3), exclusions }
    }
}

/// The figures of the base station.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Base {
    /// The number of profiles received.
    pub profiles: u64,
    /// The number of objects whose CRC failed at the base station.
    pub bad_crc: u64,
}

/// The commands of one writer to the active hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Commands {
    /// The number of commands sent.
    pub sent: u64,
    /// The number of commands that the hold has acknowledged.
    pub acknowledged: u64,
    /// The number of commands that the writer has given up, or that were lost when the hold restarted.
    pub lost: u64,
}

/// The figures of the active hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Hold {
    /// The number of frames that the hold has sent.
    pub frames_sent: u64,
    /// The number of the hold's frames that arrived at the DPR's antenna whole and unchanged.
    pub frames_delivered: u64,
    /// The number of answers on the air, including those of a foreign card.
    pub answers_sent: u64,
    /// The number of answers that arrived at the hold's antenna whole and unchanged.
    pub answers_delivered: u64,
    /// The number of transactions that read a valid Hold-Status.
    pub read: u64,
    /// The number of transactions that read the hold's object but found no valid Hold-Status.
    pub vacant: u64,
    /// The base station's commands to the hold.
    pub base_station: Commands,
    /// The flight controller's commands to the hold.
    pub flight_controller: Commands,
    /// The fraction of the time in which the hold's core was awake.
    pub load: f64,
}

/// The figures and violations of a run of the link.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// The seed of all random values.
    pub seed: u64,
    /// The clock: `fast`, `optimistic` or `pessimistic`. The last two bound the times of silicon.
    pub clock: &'static str,
    /// The length of the run, virtual seconds.
    pub virtual_seconds: f64,
    /// The number of receivers in the profile.
    pub gps: usize,
    /// The host's speed.
    pub speed: Speed,
    /// HORUS's figures.
    pub horus: Horus,
    /// The figures of the air between the antennas.
    pub air: Air,
    /// The DPR's figures.
    pub dpr: Dpr,
    /// The time until the flight controller can read the data.
    pub latency_ns: Latency,
    /// The figures of the flight controller's SSI transactions.
    pub ssi: Ssi,
    /// The figures of Reported-Position as the flight controller reads it.
    pub reported: Reported,
    /// The figures of HORUS's voter.
    pub voter: Voter,
    /// The figures of the base station.
    pub base: Base,
    /// The figures of the active hold, if the run has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hold: Option<Hold>,
    /// The injected faults and their consequences.
    pub faults: Faults,
    /// The violations as text.
    pub violations: Vec<String>,
}
