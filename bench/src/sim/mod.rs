//! Runs the whole link in virtual time: both boards, the air, the receivers, the flight controller and the base
//! station.
//!
//! The two ELF files run unchanged, as on the boards. This module adds what is connected to the boards' pins and
//! antennas. From the boards' RAM it reads only the log and the counters of the telemetry, as a debug probe could.
//!
//! The connection between the boards is one-way and takes no time. HORUS may therefore run ahead on a thread of its own
//! with exact results, but the DPR never runs ahead of HORUS. [`Bench`] holds the whole bench as plain data.

mod board_events;
pub mod coverage;
mod debugged;
mod downstream;
#[cfg(feature = "runs")]
pub mod flips;
mod hold;
mod hold_board;
mod marks;
pub mod phases;
#[cfg(feature = "plot")]
mod picture;
#[cfg(feature = "runs")]
pub mod processors;
mod recorder;
#[cfg(feature = "speed")]
pub mod speed;
pub mod telemetry;
mod upstream;

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use bench_judge::{Event, Findings, Header, Log, LogWriter, Verdict};
use cortex_m4::{Cost, Fast};
#[cfg(feature = "runs")]
use cortex_m4::{Optimistic, Pessimistic};
use emulator_part::Part;
use gnss_sim::{Flight, LogError, Port, Receiver};
use nrf52840::{Nrf52840, Settings};
use profile::Uplink;
use st25r3916_model::Chip;
/// The settings of a front end's chip.
pub use st25r3916_model::{BrokenFrame, Config as FrontEndConfig};
use stm32f429::{Oscillators, Stm32f429};

use crate::boards::{self, Dpr, Horus};
use crate::faults::{Faults, Rng};
use crate::report::{self, Report};
use crate::trace::{self, Mark, TaskWatch, Trace};
use crate::world::flight_controller::{self, Schedule};
use crate::world::{BaseStation, FlightController};
pub use debugged::Debugged;
use downstream::{Ended, Link, Surroundings};
use emulator_node::{self as node, Board, Clock, Firmware, Leader, Node, Relay, Threads};
use hold::Beside;
use phases::{Phase, Sweep, Sweeping};
use upstream::Receivers;

/// The interval at which the caller receives the run's progress and the log lines, virtual ns.
const STEP: u64 = 10_000_000;

/// The shortest time, ns, from the end of a piece of the run to the beginning of a fault that is added there. The last
/// instruction of a board may exceed the end of the piece.
pub const AHEAD_NS: u64 = 100_000;

/// The two firmwares' ELF files.
#[derive(Clone, Debug)]
pub struct Images {
    /// HORUS's ELF file.
    pub horus: PathBuf,
    /// The DPR's ELF file.
    pub dpr: PathBuf,
}

/// The firmwares of a run, as they are loaded into the boards.
#[derive(Clone, Debug)]
pub struct Programs {
    /// HORUS's firmware.
    pub horus: Firmware,
    /// The DPR's firmware.
    pub dpr: Firmware,
    /// The firmware of the active hold, if there is one.
    pub hold: Option<Firmware>,
}

impl Programs {
    /// Reads the ELF files of `setup`.
    ///
    /// # Errors
    ///
    /// An ELF file cannot be read.
    pub fn read(setup: &Setup) -> Result<Self, Error> {
        Ok(Self {
            horus: Firmware::read(&setup.images.horus)?,
            dpr: Firmware::read(&setup.images.dpr)?,
            hold: setup.hold.as_deref().map(Firmware::read).transpose()?,
        })
    }
}

/// The memory that both boards keep without supply ([`emulator_debug_port::Wire::kept`]).
#[derive(Clone, Debug)]
pub struct Flashed {
    /// HORUS's memory.
    pub horus: Vec<u8>,
    /// The DPR's memory.
    pub dpr: Vec<u8>,
}

/// The errors of the crystals, parts per billion; positive values are fast.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Crystals {
    /// The error of both crystals on HORUS's board: the microcontroller's and the front end's.
    pub horus_ppb: i64,
    /// The error of both crystals on the DPR's board: the microcontroller's and the front end's.
    pub dpr_ppb: i64,
    /// The error of the flight controller's crystal.
    pub flight_controller_ppb: i64,
    /// The error of both crystals on the hold's board: the microcontroller's and the front end's.
    pub hold_ppb: i64,
}

/// The setup of a run.
#[derive(Clone, Debug)]
pub struct Setup {
    /// The two ELF files, which must be built for the number of receivers in `gps`.
    pub images: Images,
    /// The ELF file of an active hold; `None` for no hold. With a hold, the DPR's ELF file must have the second port.
    pub hold: Option<PathBuf>,
    /// The contents of the boards' flash, which must already contain the programs of these ELF files. `None` loads the
    /// programs.
    pub flashed: Option<Flashed>,
    /// The number of receivers in the profile: 1, 2, 3 or 5.
    pub gps: usize,
    /// The length of the run, virtual ns.
    pub duration_ns: u64,
    /// The clock, which determines how long the cores' instructions take.
    pub clock: Clock,
    /// The number of threads, which does not change the outcome.
    pub threads: Threads,
    /// The seed that determines all random values.
    pub seed: u64,
    /// The recorded logs of receiver 1, of receiver 2 and so on. A receiver without a recording observes the generated
    /// flight.
    pub recordings: Vec<Option<PathBuf>>,
    /// The number of solutions a second of every generated receiver. A receiver then refuses any other period.
    pub receiver_hz: Option<u32>,
    /// Whether every generated receiver starts with its factory settings.
    pub factory_settings: bool,
    /// The errors of the crystals.
    pub crystals: Crystals,
    /// The settings of both boards' front ends. Their crystals, seeds and supplies are set elsewhere.
    pub front_ends: FrontEndConfig,
    /// The injected faults.
    pub faults: Faults,
    /// Whether the flight controller writes uplinks and commands. It then also reads the whole map now and then.
    pub writes: bool,
    /// Whether the base station's uplinks come from [`Observer::uplink`]. Otherwise the flight controller generates
    /// them.
    pub relays: bool,
    /// A sweep of transactions through every phase relative to a frame's end. It replaces the flight controller's
    /// transactions in each control cycle.
    pub sweep: Option<Sweep>,
    /// The trace file of the wires and the tasks, ending in `.vcd` or `.fst`.
    pub trace: Option<PathBuf>,
    /// The file that stores the event log.
    pub log: Option<PathBuf>,
    /// The SVG file of the flight's picture. A bench without the feature `plot` ignores it.
    pub plot: Option<PathBuf>,
    /// Whether the observer gets the changes of the wires.
    pub wires: bool,
}

impl Setup {
    /// Returns a setup without faults: fast clock, both threads, seed 1, generated flight, crystals with ordinary
    /// errors.
    #[must_use]
    pub fn new(images: Images, gps: usize, duration_ns: u64) -> Self {
        Self {
            images,
            hold: None,
            flashed: None,
            gps,
            duration_ns,
            clock: Clock::Fast,
            threads: Threads::Two,
            seed: 1,
            recordings: vec![],
            receiver_hz: None,
            factory_settings: false,
            crystals: Crystals { horus_ppb: 8_000, dpr_ppb: -12_000, flight_controller_ppb: 25_000, hold_ppb: 17_000 },
            front_ends: on_the_link(FrontEndConfig::default()),
            faults: Faults::none(),
            writes: false,
            relays: false,
            sweep: None,
            trace: None,
            log: None,
            plot: None,
            wires: false,
        }
    }
}

/// The observer of a run, which may end the run early. The time that its functions take does not change the results.
pub trait Observer {
    /// The run has reached the instant `virtual_ns`.
    fn progress(&mut self, virtual_ns: u64);

    /// A board logged a line.
    fn log(&mut self, board: &str, line: &str);

    /// The flight controller has read an undamaged image in a transaction that ended at `virtual_ns`. Images come in
    /// order, and before [`progress`](Self::progress) is called for that instant.
    fn image(&mut self, virtual_ns: u64, image: &[u8]) {
        let _ = (virtual_ns, image);
    }

    /// The flight controller has read an intact Port-Status and the base station's uplink after it (128 bytes), if
    /// [`Setup::writes`] is set.
    fn port(&mut self, virtual_ns: u64, port: &[u8]) {
        let _ = (virtual_ns, port);
    }

    /// The flight controller has read the 64 bytes at the place of the hold's object. The place may be vacant. This is
    /// called only with a hold and with [`Setup::writes`].
    fn hold(&mut self, virtual_ns: u64, object: &[u8]) {
        let _ = (virtual_ns, object);
    }

    /// Returns an uplink of the base station that has arrived by radio, if any. This is called after
    /// [`progress`](Self::progress).
    fn uplink(&mut self, virtual_ns: u64) -> Option<Uplink> {
        let _ = virtual_ns;
        None
    }

    /// Receives the changes of the wires since the last call, if [`Setup::wires`] is set. They may be slightly out of
    /// order.
    fn wires(&mut self, marks: &[Mark]) {
        let _ = marks;
    }

    /// The length of a piece of the run, virtual ns: a multiple of 10 ms. By default the run has one piece.
    fn piece_ns(&self) -> u64 {
        u64::MAX
    }

    /// Whether the run ends now. This is called after each piece of the run.
    fn ends(&mut self) -> bool {
        false
    }

    /// Returns faults to add to the run. This is called after each piece, which ended at `virtual_ns`. No episode may
    /// begin earlier than [`AHEAD_NS`] after that instant.
    fn faults(&mut self, virtual_ns: u64) -> Faults {
        let _ = virtual_ns;
        Faults::none()
    }
}

impl Observer for () {
    fn progress(&mut self, _virtual_ns: u64) {}
    fn log(&mut self, _board: &str, _line: &str) {}
}

/// The outcome of a run that an observer followed.
#[derive(Debug)]
pub struct Outcome {
    /// The figures of the run, except [`crate::report::Speed`], which the caller must fill in.
    pub report: Report,
    /// The judge's verdict on the event log.
    pub verdict: Verdict,
    /// The base station, with its history.
    pub base: BaseStation,
    /// Every log line of both boards, each with its board.
    pub logs: Vec<(&'static str, String)>,
    /// The outcome of each phase of [`Setup::sweep`]; empty without a sweep.
    pub phases: Vec<Phase>,
}

/// The reason why a run could not begin.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// An ELF file cannot be loaded, or a board failed.
    #[error(transparent)]
    Engine(#[from] node::Error),
    /// A receiver's recording cannot be played.
    #[error(transparent)]
    Recording(#[from] LogError),
    /// The trace file cannot be written.
    #[error(transparent)]
    Trace(#[from] trace::Error),
    /// The event log cannot be written.
    #[error("the event log cannot be written to {}", path.display())]
    Log {
        /// The file that cannot be written.
        path: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// The picture of the flight cannot be drawn.
    #[error("the flight cannot be drawn into {}", path.display())]
    Plot {
        /// The file that cannot be written.
        path: PathBuf,
        /// The error of the operating system or the drawing library.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}

/// The whole bench: boards, front ends, air, receivers, flight controller and base station. A clone continues exactly
/// as the original does, byte for byte.
#[derive(Clone, Debug)]
pub struct Bench<C: Cost = Fast> {
    relay: Relay<Horus, Dpr, Receivers, Link<C>, C>,
    /// The HORUS that runs in place of this bench's own, and the number of its reports that this bench has heard.
    behind: Option<(SharedHorus<C>, usize)>,
}

/// HORUS's board with its surroundings at one instant, which runs on once for several copies of a bench
/// ([`Bench::run_behind`]).
#[derive(Clone, Debug)]
pub struct SharedHorus<C: Cost = Fast>(Arc<Mutex<Leader<Horus, Receivers, C>>>);

/// The outcome of a finished [`Bench`].
#[derive(Debug)]
pub struct Finished {
    /// The figures.
    pub report: Report,
    /// The judge's verdict on the event log.
    pub verdict: Verdict,
    /// The event log, if [`Bench::keep_log`] was called.
    pub log: Log,
    /// The base station, with its history.
    pub base: BaseStation,
    /// The outcome of each phase of [`Setup::sweep`].
    pub phases: Vec<Phase>,
}

/// Returns a board at power-on with this program, which is loaded or already in the memory that the board kept.
#[inline(never)]
fn switched_on<B: Board, C: Cost>(
    mut part: B::Part,
    board: B,
    firmware: &Firmware,
    kept: Option<&Vec<u8>>,
) -> Result<Node<B, C>, Error>
where
    B::Part: emulator_debug_port::Debugged,
{
    let Some(kept) = kept else { return Ok(Node::new(part, board, firmware)?) };
    emulator_debug_port::restore(&mut part, kept)
        .ok_or(node::Error::OtherFlash { part: <B::Part as Part>::NAME, length: kept.len() })?;
    Ok(Node::programmed_with(part, board, firmware)?)
}

impl<C: Cost> Bench<C> {
    /// Returns the bench at power-on.
    ///
    /// # Errors
    ///
    /// An ELF file cannot be loaded, or a recording cannot be played.
    #[inline(never)]
    pub fn new(setup: &Setup) -> Result<Self, Error> {
        Self::with(setup, &Programs::read(setup)?)
    }

    /// Returns the bench at power-on with these firmwares in place of the ELF files of `setup`.
    ///
    /// # Errors
    ///
    /// A firmware does not fit into its board, or a recording cannot be played.
    #[inline(never)]
    pub fn with(setup: &Setup, programs: &Programs) -> Result<Self, Error> {
        let flight = Arc::new(Flight::new(setup.seed, setup.duration_ns as f64 / 1e9));
        let receivers = receivers(setup, &flight)?;
        let recorded = setup.recordings.iter().any(Option::is_some);
        let traced = setup.trace.is_some() || setup.wires;
        let Crystals { horus_ppb, dpr_ppb, flight_controller_ppb, hold_ppb } = setup.crystals;
        // ST's expansion boards supply the front end's chip from the 5 V of their header.
        let chip = |crystal_ppb, seed| {
            Chip::new(FrontEndConfig { crystal_ppb, seed, vdd_mv: 5000, ..setup.front_ends.clone() })
        };
        let oscillators = Oscillators { hse_ppb: horus_ppb, ..Oscillators::default() };
        let stm32 = Stm32f429::new(oscillators).with_brown_out_level_3();
        let nrf = |ppb, seed| Nrf52840::new(Settings { hfxo_ppb: ppb, lfxo_ppb: ppb, seed, ..Settings::default() });
        let mut horus = Horus::new(chip(horus_ppb, setup.seed), setup.gps, traced);
        horus.receivers.attend();
        for (index, receiver) in receivers.iter().enumerate() {
            horus.receivers.listen_at(index, receiver.bit_rate());
        }
        let mut dpr = Dpr::new(chip(dpr_ppb, !setup.seed), traced);
        let mut hold = None;
        if let Some(firmware) = &programs.hold {
            let [port, own, of_hold] = [1, 2, 3].map(|stream| Rng::stream(setup.seed, 0x4100 + stream).word());
            let front_ends = FrontEndConfig { answers: true, ..setup.front_ends.clone() };
            let port = Chip::new(FrontEndConfig { crystal_ppb: dpr_ppb, seed: port, vdd_mv: 5000, ..front_ends });
            dpr = dpr.with_hold_port(port);
            let board = boards::Hold::new(chip(hold_ppb, own), of_hold);
            hold = Some(Beside::new(switched_on(nrf(hold_ppb, of_hold), board, firmware, None)?, setup.seed));
        }
        let mut config = flight_controller::Config {
            crystal_ppb: flight_controller_ppb,
            writes: setup.writes && setup.sweep.is_none(),
            relays: setup.relays,
            hold: hold.as_ref().map(|_| setup.seed),
            ..flight_controller::Config::new(setup.gps)
        };
        let sweeping = setup.sweep.clone().map(|sweep| {
            config.schedule = Schedule::Placed;
            Sweeping::new(sweep, setup.gps)
        });
        let clock = C::NAME.to_owned();
        let header = Header { version: Header::VERSION, gps: setup.gps, seed: setup.seed, clock, hold: hold.is_some() };
        let surroundings = Surroundings {
            header,
            flight: (!recorded).then_some(flight),
            flight_controller: FlightController::new(config),
            base: BaseStation::new(setup.gps),
            traced,
            logged: setup.log.is_some() || setup.plot.is_some(),
            sweeping,
            hold,
        };
        let flashed = |part: fn(&Flashed) -> &Vec<u8>| setup.flashed.as_ref().map(part);
        let a = switched_on(stm32, horus, &programs.horus, flashed(|flashed| &flashed.horus))?;
        let mut b = switched_on(nrf(dpr_ppb, setup.seed), dpr, &programs.dpr, flashed(|flashed| &flashed.dpr))?;
        b.input(|part, _, _| part.wire_spis(boards::SSI));
        let upstream = Receivers::new(receivers, config.layout(), &setup.faults, setup.seed);
        let relay = Relay { a, b, upstream, downstream: Link::new(surroundings, &setup.faults) };
        Ok(Self { relay, behind: None })
    }

    /// Keeps the event log from now on, for [`Finished::log`].
    pub fn keep_log(&mut self) {
        self.relay.downstream.keep_log();
    }

    /// Takes the event log since [`Bench::keep_log`] or the last call.
    pub fn take_log(&mut self) -> Vec<Event> {
        self.relay.downstream.take_log()
    }

    /// Runs the bench to `end` (virtual ns), and calls `each` every 10 ms with instant, DPR and surroundings.
    ///
    /// # Errors
    ///
    /// Passes on the errors of `each`.
    fn run<E>(
        &mut self,
        end: u64,
        threads: Threads,
        mut each: impl FnMut(u64, &mut Node<Dpr, C>, &mut Link<C>) -> Result<(), E>,
    ) -> Result<(), E> {
        let each = |reached, dpr: &mut Node<Dpr, C>, link: &mut Link<C>| {
            link.come_to(reached, dpr);
            each(reached, dpr, link)
        };
        match &mut self.behind {
            None => self.relay.run(end, STEP, threads, each),
            Some((horus, heard)) => self.relay.run_behind(&horus.0, heard, (end, STEP), each),
        }
    }

    /// Returns HORUS's board as it is now, for copies of this bench in which nothing else happens to HORUS.
    #[must_use]
    #[inline(never)]
    pub fn share_horus(&self) -> SharedHorus<C> {
        let Relay { a, upstream, .. } = &self.relay;
        SharedHorus(Arc::new(Mutex::new(Leader::new(a.clone(), upstream.clone()))))
    }

    /// Lets `horus`, which was made at this instant, run from now on in place of the bench's own HORUS. The bench's own
    /// stands still, and its counters and its load at the end of the run are those of now. Nothing passes back to
    /// HORUS, so the run is otherwise the same; it has to end at a multiple of a millisecond.
    pub fn run_behind(&mut self, horus: &SharedHorus<C>) {
        self.behind = Some((horus.clone(), 0));
    }

    #[inline(never)]
    fn trace(&mut self, path: &Path) -> Result<Trace, trace::Error> {
        let Relay { a, b, upstream, downstream } = &mut self.relay;
        let horus = TaskWatch::new(a, horus_tx_fw::task::TASKS);
        let dpr = TaskWatch::new(b, dpr_fw::task::TASKS);
        let trace = Trace::create(path, horus.tasks(), dpr.tasks())?;
        upstream.watch_tasks(horus);
        downstream.watch_tasks(dpr);
        Ok(trace)
    }

    /// Runs to `end` (virtual ns) without an observer.
    #[inline(never)]
    pub fn run_to(&mut self, end: u64, threads: Threads) {
        let run = self.run(end, threads, |_, dpr, link| {
            dpr.take_log();
            link.hold_lines();
            link.take_marks(dpr);
            link.take_images();
            link.take_ports();
            link.take_holds();
            Ok::<_, std::convert::Infallible>(())
        });
        let Ok(()) = run;
    }

    /// The instant that both boards have reached, ns.
    #[must_use]
    pub fn now(&self) -> u64 {
        self.relay.a.now().max(self.relay.b.now())
    }

    /// HORUS's board.
    #[must_use]
    pub fn horus(&self) -> &Node<Horus, C> {
        &self.relay.a
    }

    /// The DPR's board.
    #[must_use]
    pub fn dpr(&self) -> &Node<Dpr, C> {
        &self.relay.b
    }

    /// Returns the violations found so far. The last few milliseconds of the run are not judged yet.
    #[must_use]
    pub fn findings(&self) -> &Findings {
        self.relay.downstream.findings()
    }

    /// Adds faults to those of the setup. Each episode must begin after [`Bench::now`].
    pub fn add_faults(&mut self, faults: &Faults) {
        self.relay.upstream.add_faults(faults);
        self.relay.downstream.add_faults(faults);
    }

    /// Ends the run at `reached` (virtual ns), and returns its outcome.
    #[must_use]
    #[inline(never)]
    pub fn finish(self, reached: u64) -> Finished {
        let Relay { a, mut b, downstream, .. } = self.relay;
        let header = downstream.header().clone();
        let around = (downstream.air(), downstream.stats(), downstream.hold_figures());
        let evidence = downstream::evidence(&a, &b, header.gps);
        let Ended { verdict, log, base, phases } = downstream.finish(reached, evidence, &mut b);
        let report = report(&header, reached, &verdict, (&a, &b), around, &base);
        Finished { report, verdict, log, base, phases }
    }
}

#[inline(never)]
fn report<C: Cost>(
    header: &Header,
    reached: u64,
    verdict: &Verdict,
    (horus, dpr): (&Node<Horus, C>, &Node<Dpr, C>),
    (air, stats, hold): (st25r3916_model::Counters, flight_controller::Stats, Option<report::Hold>),
    base: &BaseStation,
) -> Report {
    let figures = verdict.figures.clone();
    let of_dpr = |name| u64::from(telemetry::of_dpr(dpr, name).unwrap_or(0));
    // Four digits of the load are enough.
    let load = |load: f64| (load * 1e4).round() / 1e4;
    Report {
        seed: header.seed,
        clock: C::NAME,
        virtual_seconds: reached as f64 / 1e9,
        gps: header.gps,
        speed: report::Speed::default(),
        horus: report::Horus {
            frames_sent: figures.frames_sent,
            period_ns: figures.period_ns,
            tick_to_command_ns: figures.tick_to_command_ns,
            tick_to_air_ns: figures.tick_to_air_ns,
            load: load(horus.usage().load()),
        },
        air: report::Air {
            bit_rate: figures.bit_rate,
            air_time_ns: figures.air_time_ns,
            frames_delivered: air.delivered,
            frames_damaged: air.damaged,
            frames_lost: air.lost,
        },
        dpr: report::Dpr {
            since_ns: dpr.resets().last().map_or(0, |reset| reset.at),
            objects_accepted: of_dpr("objects_accepted"),
            objects_rejected: of_dpr("objects_rejected"),
            frames_missed: of_dpr("frames_missed"),
            scrubs: of_dpr("scrubs"),
            scrub_faults: of_dpr("scrub_faults"),
            load: load(dpr.usage().load()),
        },
        latency_ns: report::Latency {
            sample_to_readable: figures.sample_to_readable,
            last_bit_to_readable: figures.last_bit_to_readable,
        },
        ssi: report::Ssi {
            transactions: stats.transactions,
            fresh: stats.fresh,
            repeated: stats.repeated,
            busy: stats.busy,
            bad_crc: stats.bad_crc,
            ready_ns: figures.ready_ns,
        },
        reported: report::Reported {
            valid_cycles: figures.valid_cycles,
            invalid_since_ns: figures.invalid_since_ns,
            last_solution_ns: figures.last_solution_ns,
        },
        voter: figures.voter.into(),
        base: report::Base { profiles: base.drone().counts().messages, bad_crc: base.drone().counts().bad_crc },
        hold,
        faults: figures.faults,
        violations: verdict.violations.iter().map(ToString::to_string).collect(),
    }
}

/// Runs the link.
///
/// # Errors
///
/// An ELF file cannot be loaded, a recording cannot be played, or a trace cannot be written.
#[cfg(feature = "runs")]
pub fn run(setup: &Setup, observer: &mut dyn Observer) -> Result<Outcome, Error> {
    match setup.clock {
        Clock::Fast => run_on::<Fast>(setup, observer),
        Clock::Optimistic => run_on::<Optimistic>(setup, observer),
        Clock::Pessimistic => run_on::<Pessimistic>(setup, observer),
    }
}

#[cfg(feature = "runs")]
#[inline(never)]
fn run_on<C: Cost>(setup: &Setup, observer: &mut dyn Observer) -> Result<Outcome, Error> {
    let mut bench = Bench::<C>::new(setup)?;
    let mut kept = Outputs::begin(setup, &mut bench)?;
    let mut end = 0;
    while end < setup.duration_ns {
        end = end.saturating_add(observer.piece_ns().max(STEP)).min(setup.duration_ns);
        bench.run(end, setup.threads, |reached, dpr, link| kept.take(reached, dpr, link, observer))?;
        if observer.ends() {
            break;
        }
        bench.add_faults(&observer.faults(end));
    }
    kept.finish(bench, end)
}

struct Outputs {
    setup: Setup,
    trace: Option<Trace>,
    stored: Option<LogWriter<Box<dyn Write>>>,
    #[cfg(feature = "plot")]
    plotted: Option<picture::Picture>,
    logs: Vec<(&'static str, String)>,
}

impl Outputs {
    #[inline(never)]
    fn begin<C: Cost>(setup: &Setup, bench: &mut Bench<C>) -> Result<Self, Error> {
        let trace = setup.trace.as_deref().map(|path| bench.trace(path)).transpose()?;
        let unwritten = |source| unwritten(setup, source);
        let stored = match &setup.log {
            Some(path) => {
                let file = File::create(path).map_err(unwritten)?;
                let header = bench.relay.downstream.header();
                let file: Box<dyn Write> = Box::new(BufWriter::new(file));
                Some(LogWriter::new(file, header).map_err(unwritten)?)
            }
            None => None,
        };
        Ok(Self {
            trace,
            stored,
            #[cfg(feature = "plot")]
            plotted: setup.plot.as_deref().map(|path| picture::Picture::create(path, setup)).transpose()?,
            setup: setup.clone(),
            logs: vec![],
        })
    }

    #[inline(never)]
    fn take<C: Cost>(
        &mut self,
        reached: u64,
        dpr: &mut Node<Dpr, C>,
        link: &mut Link<C>,
        observer: &mut dyn Observer,
    ) -> Result<(), Error> {
        let lines = link.horus_lines(reached).map(|line| ("horus", line)).collect::<Vec<_>>().into_iter();
        let lines = lines.chain(dpr.take_log().into_iter().map(|line| ("dpr", line)));
        for (board, line) in lines.chain(link.hold_lines().into_iter().map(|line| ("hold", line))) {
            let line = line.to_string();
            observer.log(board, &line);
            self.logs.push((board, line));
        }
        let marks = link.take_marks(dpr);
        observer.wires(&marks);
        if let Some(trace) = &mut self.trace {
            trace.take(marks);
            trace.flush_before(reached)?;
        }
        for event in link.take_log() {
            if let Some(stored) = &mut self.stored {
                stored.take(&event).map_err(|source| unwritten(&self.setup, source))?;
            }
            #[cfg(feature = "plot")]
            if let Some(plotted) = &mut self.plotted {
                plotted.take(&event);
            }
        }
        for (at, image) in link.take_images() {
            observer.image(at, &image);
        }
        for (at, port) in link.take_ports() {
            observer.port(at, &port);
        }
        for (at, hold) in link.take_holds() {
            observer.hold(at, &hold);
        }
        observer.progress(reached);
        if let Some(uplink) = observer.uplink(reached) {
            link.write(&uplink);
        }
        Ok(())
    }

    #[inline(never)]
    fn finish<C: Cost>(self, bench: Bench<C>, reached: u64) -> Result<Outcome, Error> {
        let Self { setup, trace, stored, logs, .. } = self;
        let Finished { report, verdict, log, base, phases } = bench.finish(reached);
        if let Some(trace) = trace {
            trace.finish()?;
        }
        let unwritten = |source| unwritten(&setup, source);
        if let Some(mut stored) = stored {
            for event in &log.events {
                stored.take(event).map_err(unwritten)?;
            }
            stored.finish().map_err(unwritten)?;
        }
        #[cfg(feature = "plot")]
        if let Some(mut plotted) = self.plotted {
            log.events.iter().for_each(|event| plotted.take(event));
            plotted.write(&setup)?;
        }
        Ok(Outcome { report, verdict, base, logs, phases })
    }
}

fn unwritten(setup: &Setup, source: std::io::Error) -> Error {
    Error::Log { path: setup.log.clone().unwrap_or_default(), source }
}

/// Returns `config` with the setting that frames are lost if the chip's registers are unsuitable for them.
#[must_use]
pub fn on_the_link(config: FrontEndConfig) -> FrontEndConfig {
    FrontEndConfig { unsuited_chain_receives: false, unsuited_modulation_reaches: false, ..config }
}

fn receivers(setup: &Setup, flight: &Arc<Flight>) -> Result<Vec<Receiver>, LogError> {
    (1..=setup.gps)
        .map(|index| match setup.recordings.get(index - 1) {
            Some(Some(path)) => Ok(Receiver::recorded(Arc::new(gnss_sim::Log::open(path)?))),
            _ => {
                let receiver = Receiver::generated(index, setup.seed, flight.clone()).connected_by(Port::OF[index - 1]);
                let receiver = match setup.receiver_hz {
                    Some(hz) => receiver.with_fixed_period(1_000 / hz),
                    None => receiver,
                };
                Ok(if setup.factory_settings { receiver.with_factory_settings() } else { receiver })
            }
        })
        .collect()
}
