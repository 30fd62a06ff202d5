//! The whole link in virtual time: both images, the air, the receivers, the flight controller and the base station.
//!
//! Nothing here reaches into a firmware to make the link work. The two ELF files run as they would on the boards; what
//! this module adds stands on the boards' pins and antennas. What it reads from their RAM (the log, the telemetry
//! counters) is what a debug probe would read.
//!
//! What passes between the boards is one-way and takes no time: the poller's chip emits, the listener's hears. So HORUS
//! may run ahead on a thread of its own and never the DPR, and both are exact. [`Bench`] is all of it as plain data.

pub mod boards;
pub mod front_end;
pub mod ledger;
mod link;
pub mod phases;
pub mod trace;

use std::path::PathBuf;
use std::sync::Arc;

use cortex_m4::{Cost, Fast, Optimistic, Pessimistic};
use gnss_sim::{Flight, Log, LogError, Receiver};
use nrf52840::{Nrf52840, Settings};
pub use st25r3916_model::Faults;
use st25r3916_model::{Air, Chip, Config};

use stm32f429::{Oscillators, Stm32f429};

use crate::engine::{self, Clock, Firmware, Node, Relay, Threads};
use crate::report::Report;
use crate::world::flight_controller::{self, Schedule};
use crate::world::{BaseStation, FlightController};
use boards::{Dpr, Horus};
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
    /// What processor time costs.
    pub clock: Clock,
    /// On how many threads. The outcome is the same.
    pub threads: Threads,
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

/// The whole bench: both boards, their front ends, the air, the receivers, the flight controller and the base station.
/// A clone that is run on does, byte for byte, what the original does.
#[derive(Clone, Debug)]
pub struct Bench<C: Cost = Fast> {
    relay: Relay<Horus, Dpr, Receivers, Link, C>,
    seed: u64,
    gps: usize,
}

impl<C: Cost> Bench<C> {
    /// The bench at power-on.
    ///
    /// # Errors
    ///
    /// An image that cannot be loaded, or a recording that cannot be played.
    pub fn new(setup: &Setup) -> Result<Self, Error> {
        let receivers = receivers(setup)?;
        let watched = setup.trace.is_some();
        let Crystals { horus_ppb, dpr_ppb, flight_controller_ppb } = setup.crystals;
        // The expansion boards run the chip from the 5 V of their header.
        let chip = |crystal_ppb, seed| Chip::new(Config { crystal_ppb, seed, vdd_mv: 5000, ..Config::default() });
        let stm32 = Stm32f429::new(Oscillators { hse_ppb: horus_ppb, ..Oscillators::default() });
        let nrf =
            Nrf52840::new(Settings { hfxo_ppb: dpr_ppb, lfxo_ppb: dpr_ppb, seed: setup.seed, ..Settings::default() });
        let horus = Horus::new(chip(horus_ppb, setup.seed), setup.gps, watched);
        let dpr = Dpr::new(chip(dpr_ppb, !setup.seed), watched);
        let mut config = flight_controller::Config {
            crystal_ppb: flight_controller_ppb,
            ..flight_controller::Config::new(setup.gps)
        };
        let sweeping = setup.sweep.clone().map(|sweep| {
            config.schedule = Schedule::Placed;
            Sweeping::new(sweep, setup.gps)
        });
        let link = Link::new(
            Air::new(setup.seed, setup.faults),
            FlightController::new(config),
            BaseStation::new(setup.gps),
            watched,
            sweeping,
        );
        let a = Node::new(stm32, horus, &Firmware::read(&setup.images.horus)?)?;
        let mut b = Node::new(nrf, dpr, &Firmware::read(&setup.images.dpr)?)?;
        b.input(|part, _, _| part.wire_ssi(boards::SSI));
        let relay = Relay { a, b, upstream: Receivers::new(receivers), downstream: link };
        Ok(Self { relay, seed: setup.seed, gps: setup.gps })
    }

    /// Runs to `end` (virtual ns). `each` is called every 10 ms of virtual time with the instant, the DPR and what is
    /// around it.
    ///
    /// # Errors
    ///
    /// What `each` answers.
    fn run<E>(
        &mut self,
        end: u64,
        threads: Threads,
        each: impl FnMut(u64, &mut Node<Dpr, C>, &mut Link) -> Result<(), E>,
    ) -> Result<(), E> {
        self.relay.run(end, STEP, threads, each)
    }

    /// Runs to `end` (virtual ns) with nobody watching.
    pub fn run_to(&mut self, end: u64, threads: Threads) {
        let run = self.run(end, threads, |_, dpr, link| {
            dpr.take_log();
            link.take_marks(dpr);
            Ok::<_, std::convert::Infallible>(())
        });
        let Ok(()) = run;
    }

    /// The HORUS board.
    #[must_use]
    pub fn horus(&self) -> &Node<Horus, C> {
        &self.relay.a
    }

    /// The DPR.
    #[must_use]
    pub fn dpr(&self) -> &Node<Dpr, C> {
        &self.relay.b
    }

    /// The figures of the run so far, which has come to `reached` (virtual ns), and the end of the bench.
    #[must_use]
    pub fn finish(mut self, reached: u64) -> (Report, BaseStation, Vec<Phase>) {
        let Relay { a, b, downstream, .. } = &mut self.relay;
        let mut report = downstream.report(a, b, reached);
        report.seed = self.seed;
        report.clock = C::NAME;
        report.virtual_seconds = reached as f64 / 1e9;
        report.gps = self.gps;
        let (base, phases) = self.relay.downstream.into_parts();
        (report, base, phases)
    }
}

/// Runs the link.
///
/// # Errors
///
/// An image that cannot be loaded, a recording that cannot be played, or a trace that cannot be written.
pub fn run(setup: &Setup, observer: &mut dyn Observer) -> Result<Outcome, Error> {
    match setup.clock {
        Clock::Fast => run_on::<Fast>(setup, observer),
        Clock::Optimistic => run_on::<Optimistic>(setup, observer),
        Clock::Pessimistic => run_on::<Pessimistic>(setup, observer),
    }
}

fn run_on<C: Cost>(setup: &Setup, observer: &mut dyn Observer) -> Result<Outcome, Error> {
    let trace_error = |source| Error::Trace { path: setup.trace.clone().unwrap_or_default(), source };
    let mut bench = Bench::<C>::new(setup)?;
    let mut trace = setup.trace.as_deref().map(Trace::create).transpose().map_err(trace_error)?;
    let mut logs = vec![];
    bench.run(setup.duration_ns, setup.threads, |reached, dpr, link| {
        let lines = link.horus_lines(reached).map(|line| ("horus", line)).collect::<Vec<_>>().into_iter();
        for (board, line) in lines.chain(dpr.take_log().into_iter().map(|line| ("dpr", line))) {
            let line = line.to_string();
            observer.log(board, &line);
            logs.push((board, line));
        }
        let marks = link.take_marks(dpr);
        if let Some(trace) = &mut trace {
            trace.take(marks);
            trace.flush_before(reached).map_err(trace_error)?;
        }
        observer.progress(reached);
        Ok::<_, Error>(())
    })?;
    let (report, base, phases) = bench.finish(setup.duration_ns);
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
