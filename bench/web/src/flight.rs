//! A flight: the bench, the flight controller's radio, the base station and the panel.

use std::io::BufWriter;

use base_station::carrier::mavlink::{Forwarder, Rates};
use base_station::intake::{Carried, Kind as CarriedKind};
use base_station::station::StationData;
use base_station::station::state::{self, State, With};
use base_station::{Bundle, Place};
use bench::faults::{Faults, Kind};
use bench::panel::{PIECE_NS, Panel};
use bench::sim::{Debugged, Images, Observer, Programs, Setup};
use bench::trace::Mark;
use cortex_m4::Fast;
use serde::{Deserialize, Serialize};

use crate::digest::LogDigest;
use crate::wires::Wires;

/// The number of receivers with which the firmwares are built.
pub const RECEIVERS: usize = 3;

const SYSTEM: u8 = 1;

const COMPONENT: u8 = 1;

/// The budget of a fast telemetry radio, as in `cargo xtask live`.
const RATES: Rates = Rates { bytes_per_s: 6_000, period_us: 100_000, standard_us: 0 };

/// The interval at which the base station updates its alarms, µs.
const TICK_US: u64 = 20_000;

const STEP_NS: u64 = 10_000_000;

/// The settings of a flight in the address of the page, named like the options of `cargo xtask sim`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Wanted {
    /// The seed, a whole number.
    pub seed: String,
    /// The kinds of faults that are drawn from the seed, separated by commas.
    pub faults: String,
    /// The length of the flight, s.
    pub seconds: String,
    /// Whether an active hold is beside the DPR.
    pub hold: bool,
}

impl Wanted {
    /// Returns the setup of the flight.
    ///
    /// # Errors
    ///
    /// [`String`] that states which setting is impossible.
    pub fn setup(&self) -> Result<Setup, String> {
        let Self { seed, faults, seconds, hold } = self;
        let seed = seed.parse().map_err(|error| format!("seed={seed}: {error}"))?;
        let seconds = seconds.parse::<f64>().ok().filter(|seconds| (1.0..=86_400.0).contains(seconds));
        let seconds = seconds.ok_or_else(|| format!("seconds={}: expected 1 to 86400", self.seconds))?;
        let named = faults.split(',').filter(|name| !name.is_empty());
        let kinds = named.map(|name| name.parse().map_err(|error| format!("faults={name}: {error}")));
        let kinds = kinds.collect::<Result<Vec<Kind>, String>>()?;
        if let Some(kind) = kinds.iter().find(|kind| kind.is_upset()) {
            return Err(format!("faults={kind}: upsets are tried on copies of the bench, by `cargo xtask sim`"));
        }
        if kinds.contains(&Kind::Hold) && !hold {
            return Err("faults=hold: there is none without hold in the address".into());
        }
        let duration_ns = (seconds * 1e9).round() as u64;
        let faults = Faults::drawn(&kinds, RECEIVERS, seed, duration_ns);
        // The firmwares are in memory, so there are no files of them.
        let images = Images { horus: "horus".into(), dpr: "dpr".into() };
        Ok(Setup { seed, faults, writes: true, wires: true, ..Setup::new(images, RECEIVERS, duration_ns) })
    }

    /// Returns the command line that makes the same flight.
    #[must_use]
    pub fn command(&self) -> String {
        let Self { seed, faults, seconds, hold } = self;
        let faults = if faults.is_empty() { String::new() } else { format!(" --faults {faults}") };
        let hold = if *hold { " --hold" } else { "" };
        format!("cargo xtask sim --seed {seed}{faults} --seconds {seconds}{hold} --events run.log && sha256sum run.log")
    }
}

/// What became of a step.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Stepped {
    /// The instant that the flight has reached, virtual ms.
    pub now_ms: f64,
    /// Whether the panel has changed the flight.
    pub changed: bool,
    /// The outcome, once the flight is over.
    pub outcome: Option<Verdict>,
}

/// The outcome of a flight.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Verdict {
    /// The SHA-256 of the event log that the command of the same flight writes.
    pub digest: String,
    /// The violations that the judge found.
    pub violations: Vec<String>,
}

/// What is around the bench.
struct Ground {
    forwarder: Forwarder,
    station: StationData,
    begun_us: u64,
    panel: Panel,
    wires: Wires,
}

impl Observer for Ground {
    fn progress(&mut self, virtual_ns: u64) {
        self.panel.progress(virtual_ns);
        self.wires.progress(virtual_ns);
        let now_us = virtual_ns / 1_000;
        let at_us = self.begun_us + now_us;
        while let Some(bytes) = self.forwarder.poll(now_us, at_us) {
            let carried = Carried { at_us, kind: CarriedKind::MavlinkDatagrams, line: 0, from: String::new(), bytes };
            self.station.take(&carried, |_, _, _| {});
        }
        if now_us.is_multiple_of(TICK_US) {
            self.tick(at_us);
        }
    }

    fn image(&mut self, _: u64, image: &[u8]) {
        if let Some(bundle) = Bundle::datagram(image) {
            self.forwarder.offer(&bundle);
        }
    }

    fn hold(&mut self, _: u64, object: &[u8]) {
        if let Some(bundle) = Bundle::new(Place::Hold, 1, object) {
            self.forwarder.offer(&bundle);
        }
    }

    fn log(&mut self, board: &str, line: &str) {
        self.panel.log(board, line);
    }

    fn wires(&mut self, marks: &[Mark]) {
        self.wires.take(marks);
    }
}

impl Ground {
    fn tick(&mut self, now_us: u64) {
        self.station.tick(now_us.max(self.station.now_us));
        self.station.look();
    }
}

/// A flight that may be over.
pub struct Flight {
    wanted: Wanted,
    run: Option<Debugged<Fast>>,
    ground: Ground,
    digest: LogDigest,
    now_ns: u64,
    last: Stepped,
}

impl Flight {
    /// Begins a flight at `unix_us`, µs since 1970.
    ///
    /// # Errors
    ///
    /// [`String`] that states why there is no such flight.
    pub fn begin(wanted: &Wanted, programs: &Programs, unix_us: u64) -> Result<Self, String> {
        let setup = wanted.setup()?;
        if wanted.hold != programs.hold.is_some() {
            return Err("the firmware of the hold goes with a hold".into());
        }
        let digest = LogDigest::default();
        let log = BufWriter::with_capacity(1 << 16, digest.clone());
        let run = Debugged::with(&setup, programs, Box::new(log)).map_err(|error| error.to_string())?;
        let ground = Ground {
            forwarder: Forwarder::new(SYSTEM, COMPONENT, RATES),
            station: StationData::default(),
            begun_us: unix_us,
            panel: Panel::new(setup.gps, setup.duration_ns),
            wires: Wires::default(),
        };
        Ok(Self { wanted: wanted.clone(), run: Some(run), ground, digest, now_ns: 0, last: Stepped::default() })
    }

    /// Returns what was wanted.
    #[must_use]
    pub const fn wanted(&self) -> &Wanted {
        &self.wanted
    }

    /// Returns the panel.
    pub const fn panel(&mut self) -> &mut Panel {
        &mut self.ground.panel
    }

    /// Simulates 10 ms of the flight, or nothing if the flight is over.
    ///
    /// # Errors
    ///
    /// Returns in words what ended the run.
    pub fn step(&mut self) -> Result<Stepped, String> {
        let Some(run) = &mut self.run else { return Ok(self.last.clone()) };
        run.run(&mut self.ground).map_err(|error| error.to_string())?;
        self.now_ns = (self.now_ns + STEP_NS).min(run.end());
        if run.is_over() {
            let outcome = self.run.take().map(Debugged::finish).transpose().map_err(|error| error.to_string())?;
            let Some(outcome) = outcome else { return Ok(self.last.clone()) };
            self.last.outcome = Some(Verdict { digest: self.digest.hex(), violations: outcome.report.violations });
        } else if self.now_ns.is_multiple_of(PIECE_NS) {
            let faults = self.ground.panel.faults(run.now());
            self.last.changed |= faults != Faults::none();
            run.add_faults(&faults);
        }
        self.last.now_ms = self.now_ns as f64 / 1e6;
        Ok(self.last.clone())
    }

    /// Returns the state for the page, `after_us` after the end of the flight.
    pub fn state(&mut self, drone: Option<&str>, with: With, after_us: u64) -> State {
        if self.run.is_none() {
            self.ground.tick(self.ground.begun_us + self.now_ns / 1_000 + after_us);
        }
        state::state(&self.ground.station, 0, None, drone, drone.unwrap_or_default(), with)
    }

    /// Returns the wires of the last 100 ms in the format of `wires.js`.
    pub fn wires(&mut self) -> Vec<u8> {
        self.ground.wires.bytes()
    }
}
