//! The whole link in virtual time: both images, the air, the receivers, the flight controller and the base station.
//!
//! Nothing here reaches into a firmware to make the link work. The two ELF files run as they would on the boards; what
//! this module adds stands on the boards' pins and antennas. What it reads from their RAM (the log, the telemetry
//! counters) is what a debug probe would read.
//!
//! What passes between the boards is one-way and takes no time: the poller's chip emits, the listener's hears. So HORUS
//! runs ahead on a thread of its own and never the DPR, and both are exact.

pub mod boards;
pub mod front_end;
pub mod ledger;
mod link;
pub mod phases;
pub mod trace;

use std::path::PathBuf;
use std::sync::Arc;

use gnss_sim::{Flight, Log, LogError, Receiver};
use nrf52840_model::{Nrf52840, Settings};
pub use st25r3916_model::Faults;
use st25r3916_model::{Air, Chip, Config};

use crate::engine::{self, Firmware, Node, Relay};
use crate::report::Report;
use crate::stm32f427::{Oscillators, Stm32f427Part};
use crate::world::flight_controller::{self, Schedule};
use crate::world::{BaseStation, FlightController};
use boards::{Dpr, Horus};
use front_end::FrontEnd;
use link::{Link, Receivers};
use phases::{Phase, Sweep, Sweeping};
use trace::Trace;

/// How often the caller hears of progress and gets the log, in virtual nanoseconds.
const STEP: u64 = 10_000_000;

/// The two images.
#[derive(Clone, Debug)]
pub struct Images {
    /// The HORUS side's ELF file.
    pub horus: PathBuf,
    /// The DPR's ELF file.
    pub dpr: PathBuf,
}

/// Errors of the crystals, parts per billion, positive is fast.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Crystals {
    /// HORUS board: the microcontroller's and the front end's.
    pub horus_ppb: i64,
    /// DPR board: the microcontroller's and the front end's.
    pub dpr_ppb: i64,
    /// The flight controller's.
    pub flight_controller_ppb: i64,
}

/// What to run.
#[derive(Clone, Debug)]
pub struct Setup {
    /// The two images, built for this number of receivers.
    pub images: Images,
    /// Receivers in the profile: 1, 2, 3 or 5.
    pub gps: usize,
    /// How long, in virtual nanoseconds.
    pub duration_ns: u64,
    /// Seed of everything random.
    pub seed: u64,
    /// For each receiver in turn, a recorded log to play instead of the generated flight.
    pub recordings: Vec<Option<PathBuf>>,
    /// The crystals' errors.
    pub crystals: Crystals,
    /// What the air does to frames.
    pub faults: Faults,
    /// Instead of the flight controller's own cycle: transactions in every phase to a frame's end.
    pub sweep: Option<Sweep>,
    /// Where to write the wires as a VCD.
    pub trace: Option<PathBuf>,
}

/// Who watches a run.
pub trait Observer {
    /// The run has come this far, in virtual nanoseconds.
    fn progress(&mut self, virtual_ns: u64);

    /// A board logged a line.
    fn log(&mut self, board: &str, line: &str);
}

/// Nobody watches.
impl Observer for () {
    fn progress(&mut self, _virtual_ns: u64) {}
    fn log(&mut self, _board: &str, _line: &str) {}
}

/// What came of a run.
#[derive(Debug)]
pub struct Outcome {
    /// The figures. [`crate::report::Speed`] is the caller's to fill in: this crate reads no wall clock.
    pub report: Report,
    /// The base station, with what it showed.
    pub base: BaseStation,
    /// Every log line of both boards: board, line.
    pub logs: Vec<(&'static str, String)>,
    /// What came of each phase of [`Setup::sweep`].
    pub phases: Vec<Phase>,
}

/// Why a run could not begin.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// An image or a board.
    #[error(transparent)]
    Engine(#[from] engine::Error),
    /// A receiver's recording.
    #[error(transparent)]
    Recording(#[from] LogError),
    /// The trace file.
    #[error("the trace cannot be written to {}", path.display())]
    Trace {
        /// The file.
        path: PathBuf,
        /// What the operating system says.
        source: std::io::Error,
    },
}

/// Runs the link.
///
/// # Errors
///
/// An image that cannot be loaded, a recording that cannot be played, or a trace that cannot be written.
pub fn run(setup: &Setup, observer: &mut dyn Observer) -> Result<Outcome, Error> {
    let trace_error = |source| Error::Trace { path: setup.trace.clone().unwrap_or_default(), source };
    let receivers = receivers(setup)?;
    let trace = setup.trace.as_deref().map(Trace::create).transpose().map_err(trace_error)?;
    let Crystals { horus_ppb, dpr_ppb, flight_controller_ppb } = setup.crystals;

    // The expansion boards run the chip from the 5 V of their header.
    let chip = |crystal_ppb, seed| Chip::new(Config { crystal_ppb, seed, vdd_mv: 5000, ..Config::default() });
    let poller = FrontEnd::new(chip(horus_ppb, setup.seed), trace.is_some());
    let listener = FrontEnd::new(chip(dpr_ppb, !setup.seed), trace.is_some());
    let stm32 = Stm32f427Part::new(Oscillators { hse_ppb: horus_ppb, ..Oscillators::default() });
    let nrf = Nrf52840::new(Settings { hfxo_ppb: dpr_ppb, lfxo_ppb: dpr_ppb, seed: setup.seed, ..Settings::default() });
    let (horus, lines) = Horus::new(stm32, poller.clone(), setup.gps);
    let horus = Node::new(horus, &Firmware::read(&setup.images.horus)?)?;
    let dpr = Node::new(Dpr::new(nrf, listener.clone()), &Firmware::read(&setup.images.dpr)?)?;

    let mut config =
        flight_controller::Config { crystal_ppb: flight_controller_ppb, ..flight_controller::Config::new(setup.gps) };
    let sweeping = setup.sweep.clone().map(|sweep| {
        config.schedule = Schedule::Placed;
        Sweeping::new(sweep, setup.gps)
    });
    let receivers = Receivers::new(poller.clone(), lines.into_iter().zip(receivers));
    let link = Link::new(
        poller,
        listener,
        Air::new(setup.seed, setup.faults),
        FlightController::new(config),
        BaseStation::new(setup.gps),
        trace,
        sweeping,
    );
    let mut relay = Relay { a: horus, b: dpr, upstream: receivers, downstream: link };
    let mut logs = vec![];
    relay.run(setup.duration_ns, STEP, |reached, dpr, link| {
        let lines = link.horus_lines(reached).map(|line| ("horus", line)).collect::<Vec<_>>().into_iter();
        for (board, line) in lines.chain(dpr.take_log().into_iter().map(|line| ("dpr", line))) {
            let line = line.to_string();
            observer.log(board, &line);
            logs.push((board, line));
        }
        link.flush_trace(dpr).map_err(trace_error)?;
        observer.progress(reached);
        Ok::<_, Error>(())
    })?;
    let Relay { a, b, downstream, .. } = &mut relay;
    let mut report = downstream.report(a, b, setup.duration_ns);
    report.seed = setup.seed;
    report.virtual_seconds = setup.duration_ns as f64 / 1e9;
    report.gps = setup.gps;
    let (base, trace, phases) = relay.downstream.into_parts();
    if let Some(trace) = trace {
        trace.finish().map_err(trace_error)?;
    }
    Ok(Outcome { report, base, logs, phases })
}

/// What each receiver will send.
fn receivers(setup: &Setup) -> Result<Vec<Receiver>, LogError> {
    let flight = Arc::new(Flight::new(setup.seed, setup.duration_ns as f64 / 1e9));
    (1..=setup.gps)
        .map(|index| match setup.recordings.get(index - 1) {
            Some(Some(path)) => Ok(Receiver::recorded(Arc::new(Log::open(path)?))),
            _ => Ok(Receiver::generated(index, setup.seed, flight.clone())),
        })
        .collect()
}
