//! Runs the whole link in real time, with the base station's page.
//!
//! Both firmwares run on the bench, and the bench's flight controller reads the DPR. It offers each undamaged image to
//! the forwarder of [`base_station::carrier::mavlink`], which has the budget of a fast telemetry radio. The forwarder's
//! messages go through a UDP socket to the station and the page of `horus-base serve`, in this process.
//!
//! **Pace.** After every 10 ms of virtual time this module waits until real time has come as far, and then sends the
//! messages of these 10 ms. So no message is early, and each is up to 10 ms late. If the machine is too slow, the run
//! reports how far it is behind.
//!
//! **Clock.** At pace 1 the station reads the system's clock. At any other pace the bench sets the station's clock,
//! because HORUS's clock would differ from the system's.
//!
//! **Panel.** A second address serves the panel ([`panel`]), which injects faults into the running flight and shows
//! both boards' logs.
//!
//! **The way back.** With `--uplink` the page sends signed uplinks through the same socket to the flight controller,
//! which receives them with [`base_station::carrier::mavlink::Inbound`], writes them to the DPR, and forwards what the
//! DPR then shows. With `--hold` an active hold is beside the DPR, and the page commands it in the same way. With
//! `--loss` messages are lost in both directions, drawn from the seed.

mod panel;
#[cfg(test)]
mod tests;

use std::hash::{BuildHasher, RandomState};
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::{Context, Result, anyhow, bail};
use base_station::carrier::mavlink::voice::SYSTEM as STATION;
use base_station::carrier::mavlink::{Forwarder, Inbound, Key, Rates, Receiver, Signer, Verifier, Voice};
use base_station::intake::Kind;
use base_station::live::server::Server;
use base_station::live::{self, Clock, Station, Time, lines};
use base_station::{Bundle, Change, DroneId, Place};
use bench::faults::{Faults, Rng};
use bench::sim::{Images, Observer, Outcome, Setup};

use crate::sim::table;
use crate::{LiveArgs, firmware};
use panel::Panel;
use profile::Uplink;

const SYSTEM: u8 = 1;

const COMPONENT: u8 = 1;

const RATES: Rates = Rates { bytes_per_s: 6_000, period_us: 100_000, standard_us: 0 };

/// The length of a step of the run, virtual ns. The run can end only between steps.
const PIECE: u64 = bench::panel::PIECE_NS;

/// The greatest time by which a run may be behind real time: a period of the forwarder, or a quarter of the age from
/// which the page calls a position old.
const HELD: Duration = Duration::from_millis(100);

/// The time after the last sent message in which messages may still arrive.
const ARRIVES_WITHIN: Duration = Duration::from_secs(2);

const LOCAL: Ipv4Addr = Ipv4Addr::LOCALHOST;

const LONGEST: f64 = 86_400.0;

pub(crate) fn live(args: &LiveArgs) -> Result<ExitCode> {
    crate::sim::no_upsets(&args.faults)?;
    crate::sim::needs_hold(&args.faults, args.hold)?;
    let uplinks: Option<Speaks> = args.uplink.then_some(Voice::with_uplinks);
    let speaks = if args.hold { Some(Voice::with_commands as Speaks) } else { uplinks };
    let mut page = Page::start(args.port, args.pace, speaks, tell)?.with_loss(args.loss, args.seed);
    println!("http://{}/", page.server.address());
    let panel = page.panel.serve((LOCAL, args.panel_port).into(), page.server.address());
    let panel =
        panel.with_context(|| format!("no panel on {LOCAL}:{}; --panel-port takes another", args.panel_port))?;
    println!("http://{}/  breaks things, on the bench's side of the wire", panel.address());
    let (horus, dpr, hold) = firmware::build_link(args.gps, args.hold)?;
    let duration_ns = (args.seconds.unwrap_or(LONGEST) * 1e9).round() as u64;
    let faults = Faults::drawn(&args.faults, args.gps.0, args.seed, duration_ns);
    let setup =
        Setup { seed: args.seed, faults, writes: true, ..Setup::new(Images { horus, dpr }, args.gps.0, duration_ns) };
    let setup = Setup { relays: args.uplink || args.hold, hold, ..setup };
    let began = Instant::now();
    let mut outcome = page.run(&setup)?;
    let wall = began.elapsed().as_secs_f64();
    outcome.report.speed.times_real_time = outcome.report.virtual_seconds / wall;
    let shown = page.settle();
    print!("{}{}\n{shown}{}", table(&outcome.report), outcome.base, page.pace());
    match outcome.report.violations.len() {
        0 if shown.is_whole() => Ok(ExitCode::SUCCESS),
        0 => bail!("the page has not got what was sent"),
        violations => bail!("{violations} violation(s)"),
    }
}

fn key() -> Key {
    let mut bytes = [0; 32];
    for chunk in bytes.chunks_mut(8) {
        // The system seeds `RandomState` with new random numbers each time.
        chunk.copy_from_slice(&RandomState::new().hash_one(()).to_le_bytes());
    }
    Key::new(bytes)
}

fn unix_us() -> u64 {
    let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(unix.as_micros()).unwrap_or_default()
}

fn tell(_: DroneId, change: Change) {
    eprintln!("{} {}", if change.raised { "ALARM" } else { "over " }, change.alarm);
}

/// The numbers of sent and of arrived messages with objects, and of objects with a wrong CRC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Shown {
    sent: u64,
    arrived: u64,
    bad_crc: u64,
}

impl Shown {
    const fn is_whole(self) -> bool {
        self.arrived == self.sent && self.bad_crc == 0
    }
}

impl std::fmt::Display for Shown {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { sent, arrived, bad_crc } = self;
        writeln!(f, "page                  {sent} messages with objects sent, {arrived} arrived, {bad_crc} bad CRC")
    }
}

/// A function that permits a [`Voice`] to send uplinks, or commands too.
type Speaks = fn(Voice) -> Voice;

struct Page {
    server: Server,
    station: Station,
    forwarder: Forwarder,
    socket: UdpSocket,
    to: SocketAddr,
    /// Virtual time divided by real time; 0 for as fast as possible.
    pace: f64,
    /// The virtual time of the flight, µs, for a station without the system's clock.
    passed_us: Arc<AtomicU64>,
    /// The real time at which the second step of the run began. The first step also loads the programs.
    began: Option<Instant>,
    behind: Duration,
    sent: u64,
    unsent: Option<std::io::Error>,
    panel: Panel,
    inbound: Option<Inbound>,
    loss: (u64, Rng),
}

impl Page {
    fn start(
        port: u16,
        pace: f64,
        speaks: Option<Speaks>,
        told: impl FnMut(DroneId, Change) + Send + 'static,
    ) -> Result<Self> {
        let passed_us = Arc::new(AtomicU64::new(0));
        let clock = if pace == 1.0 { Clock::begin() } else { Clock::told(Arc::clone(&passed_us)) };
        // The station ends with its inlet, and the inlet ends with this process.
        let key = speaks.map(|_| key());
        let verifier = || key.clone().map(Verifier::new);
        let (inlet, station, _) = live::start(verifier(), None, Time::Clock(clock.clone()), told);
        if let (Some(key), Some(speaks)) = (&key, speaks) {
            station.speak(speaks(Voice::new(STATION, Some(Signer::new(key.clone(), STATION)))));
        }
        let to = lines::udp((LOCAL, 0).into(), Kind::MavlinkDatagrams, 0, clock, inlet);
        let to = to.context("cannot listen on UDP")?;
        let server = Server::start(station.clone(), (LOCAL, port).into());
        let server = server.with_context(|| format!("cannot serve a page on {LOCAL}:{port}; --port takes another"))?;
        let socket = UdpSocket::bind((LOCAL, 0)).context("cannot send on UDP")?;
        socket.set_nonblocking(true).context("cannot wait for nothing on UDP")?;
        let forwarder = Forwarder::new(SYSTEM, COMPONENT, RATES);
        let forwarder = match &key {
            Some(key) => forwarder.signed(Signer::new(key.clone(), COMPONENT)),
            None => forwarder,
        };
        let inbound = verifier().map(|verifier| Inbound::new(SYSTEM, verifier));
        let (began, behind) = (None, Duration::ZERO);
        let panel = Panel::default();
        Ok(Self {
            server,
            station,
            forwarder,
            socket,
            to,
            pace,
            passed_us,
            began,
            behind,
            sent: 0,
            unsent: None,
            panel,
            inbound,
            loss: (0, Rng::new(1)),
        })
    }

    fn with_loss(self, percent: u64, seed: u64) -> Self {
        Self { loss: (percent, Rng::new(seed)), ..self }
    }

    fn loses(&mut self) -> bool {
        let (percent, rng) = &mut self.loss;
        rng.below(100) < *percent
    }

    fn run(&mut self, setup: &Setup) -> Result<Outcome> {
        self.panel.begin(setup.gps, setup.duration_ns);
        let outcome = bench::sim::run(setup, self)?;
        match self.unsent.take() {
            None => Ok(outcome),
            Some(error) => Err(anyhow!(error).context(format!("cannot send to UDP {}", self.to))),
        }
    }

    fn settle(&self) -> Shown {
        let began = Instant::now();
        loop {
            let known = self.station.known();
            let counts = known.intake.fleet().iter().map(|(_, drone)| drone.counts());
            let (arrived, bad_crc) =
                counts.fold((0, 0), |(arrived, bad), counts| (arrived + counts.messages, bad + counts.bad_crc));
            drop(known);
            if arrived >= self.sent || began.elapsed() > ARRIVES_WITHIN {
                return Shown { sent: self.sent, arrived, bad_crc };
            }
            sleep(Duration::from_millis(1));
        }
    }

    fn pace(&self) -> String {
        let behind = self.behind.as_secs_f64() * 1e3;
        let held = match self.pace {
            0.0 => return "pace                  as fast as it goes\n".to_owned(),
            _ if self.behind <= HELD => "held",
            _ => "NOT held",
        };
        format!("pace                  {} x real time, {held}: {behind:.1} ms late at worst\n", self.pace)
    }

    fn wait(&mut self, virtual_ns: u64) {
        if self.pace == 0.0 {
            return;
        }
        let now = Instant::now();
        let passed = Duration::from_nanos(virtual_ns).div_f64(self.pace);
        let due = *self.began.get_or_insert_with(|| now.checked_sub(passed).unwrap_or(now)) + passed;
        self.behind = self.behind.max(now.saturating_duration_since(due));
        sleep(due.saturating_duration_since(now));
    }
}

impl Observer for Page {
    fn image(&mut self, _: u64, image: &[u8]) {
        if let Some(bundle) = Bundle::datagram(image) {
            self.forwarder.offer(&bundle);
        }
    }

    fn progress(&mut self, virtual_ns: u64) {
        self.panel.progress(virtual_ns);
        self.wait(virtual_ns);
        let now_us = virtual_ns / 1_000;
        self.passed_us.store(now_us, Ordering::Relaxed);
        while let Some(message) = self.forwarder.poll(now_us, unix_us()) {
            if self.loses() {
                continue;
            }
            match self.socket.send_to(&message, self.to) {
                Ok(_) => self.sent += Receiver::default().datagram(0, &message).len() as u64,
                Err(error) => self.unsent = Some(error),
            }
        }
    }

    fn port(&mut self, virtual_ns: u64, port: &[u8]) {
        let is_answer = self.inbound.as_mut().is_some_and(|inbound| inbound.read(virtual_ns / 1_000, port));
        if let Some(bundle) = Bundle::new(Place::PortStatus, 2, port).filter(|_| is_answer) {
            self.forwarder.offer(&bundle);
        }
    }

    fn hold(&mut self, _: u64, object: &[u8]) {
        if let Some(bundle) = Bundle::new(Place::Hold, 1, object) {
            self.forwarder.offer(&bundle);
        }
    }

    fn uplink(&mut self, virtual_ns: u64) -> Option<Uplink> {
        let mut bytes = [0; 512];
        let mut to_write = None;
        while let Ok(length) = self.socket.recv(&mut bytes) {
            if !self.loses()
                && let Some(inbound) = &mut self.inbound
            {
                to_write = inbound.datagram(virtual_ns / 1_000, unix_us(), &bytes[..length]).or(to_write);
            }
        }
        to_write
    }

    fn log(&mut self, board: &str, line: &str) {
        self.panel.log(board, line);
    }

    fn piece_ns(&self) -> u64 {
        PIECE
    }

    fn ends(&mut self) -> bool {
        self.unsent.is_some() || self.server.interrupted() || self.panel.is_over()
    }

    fn faults(&mut self, virtual_ns: u64) -> Faults {
        self.panel.faults(virtual_ns)
    }
}
