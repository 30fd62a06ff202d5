//! The DPR's surroundings with their faults (air, flight controller, base station), and the event log.

use std::collections::VecDeque;
use std::sync::Arc;

use base_station_core::alarm::{Alarm, Alarms};
use bench_judge::{Board as Side, Bytes, Disturbance, Event, Findings, Header, Log, SsiEvent, Verdict, What};
use cortex_m4::Cost;
use cortex_m4::coverage::Record;
use gnss_sim::Flight;
use nrf52840::SpisEvent;
use profile::Uplink;
use profile::ssi::client::AGE_UNKNOWN;
use profile::uplink::Written;
use st25r3916_model::{Air, AirEvent, AirFaults, Counters};

use super::board_events::{BoardEvents, injected};
use super::hold::Beside;
use super::marks::{DPR_SPI_HZ, HORUS_SPI_HZ, SSI_HZ, bus, of_tasks};
use super::phases::{Edge, Phase, PhaseEvent, Sweeping};
use super::recorder::Recorder;
use super::upstream::Notes;
use crate::boards::{Dpr, Horus};
use crate::faults::wires::Wires;
use crate::faults::{BaseFault, Episode, Fault, Faults, Timeline, Turn};
use crate::report;
use crate::trace::{self, Mark, TaskWatch, Wire, Word};
use crate::world::flight_controller::{Placed, Stats};
use crate::world::ssi::{Progress, Transaction};
use crate::world::{BaseStation, FlightController};
use emulator_node::{Downstream, LogLine, Node};

/// The longest interval between two records of the base station's display, ns.
const STATION_EVERY: u64 = 100_000_000;

#[derive(Clone, Copy, Debug)]
enum Seen {
    /// The DPR restarted, so that its SPIS has no buffers until the firmware provides them.
    Restart,
    Fresh(bool),
    Spis(SpisEvent),
}

#[derive(Clone, Debug)]
pub(super) struct Link<C: Cost> {
    air: Air,
    /// The active hold; `None` without one.
    hold: Option<Beside<C>>,
    /// The instant, ns, up to which the air has all its inputs. It is up to a millisecond ahead of the DPR.
    air_at: u64,
    flight_controller: FlightController,
    base: BaseStation,
    base_faults: Vec<BaseFault>,
    wires: Wires,
    faults: Timeline,
    /// The present faults of the air, each with the instant (ns) of its beginning. Only the newest one has an effect.
    air_faults: Vec<(u64, AirFaults)>,
    dpr_events: BoardEvents,
    recorder: Recorder,
    /// The instant of a rise of FRESH that is not recorded yet, because the announced image is still unknown.
    announced: Option<u64>,
    /// The beginning, ns, of HORUS's unfinished transaction with a receiver. The transaction's bytes are logged when it
    /// ends.
    untold_since: u64,
    /// The bytes that a transaction would read if it began now; `None` if that is not possible.
    offer: Option<Vec<u8>>,
    /// The instant at which the base station's display was last recorded, ns, and the alarms at that instant.
    station: (u64, Alarms),
    restarts: usize,
    selected: bool,
    deselected: u64,
    trace: Option<Vec<Mark>>,
    tasks: Option<TaskWatch>,
    sweeping: Option<Sweeping>,
    /// HORUS's log lines from instants that the DPR has yet to reach, because HORUS runs ahead.
    horus_lines: VecDeque<LogLine>,
}

/// The initial values of a [`Link`].
pub(super) struct Surroundings<C: Cost> {
    pub(super) header: Header,
    pub(super) flight: Option<Arc<Flight>>,
    pub(super) flight_controller: FlightController,
    pub(super) base: BaseStation,
    pub(super) traced: bool,
    pub(super) logged: bool,
    pub(super) sweeping: Option<Sweeping>,
    pub(super) hold: Option<Beside<C>>,
}

pub(super) struct Ended {
    pub(super) verdict: Verdict,
    pub(super) log: Log,
    pub(super) base: BaseStation,
    pub(super) phases: Vec<Phase>,
}

impl<C: Cost> Link<C> {
    pub(super) fn new(with: Surroundings<C>, faults: &Faults) -> Self {
        let seed = with.header.seed;
        let layout = with.flight_controller.config().layout();
        Self {
            air: Air::new(seed, AirFaults::default()),
            hold: with.hold,
            air_at: 0,
            flight_controller: with.flight_controller,
            base: with.base,
            base_faults: vec![],
            wires: Wires::new(layout, seed),
            faults: faults.timeline(false),
            air_faults: vec![],
            dpr_events: BoardEvents::new(Side::Dpr),
            recorder: Recorder::new(with.header, with.flight, with.logged),
            announced: None,
            untold_since: u64::MAX,
            offer: None,
            station: (0, Alarms::none()),
            restarts: 0,
            selected: false,
            deselected: 0,
            trace: with.traced.then(Vec::new),
            tasks: None,
            sweeping: with.sweeping,
            horus_lines: VecDeque::new(),
        }
    }

    pub(super) fn horus_lines(&mut self, now: u64) -> impl Iterator<Item = LogLine> {
        std::iter::from_fn(move || self.horus_lines.pop_front_if(|line| line.at <= now))
    }

    /// Records in `record` which code the hold executes ([`Node::set_record`]).
    pub(super) fn set_hold_record(&mut self, record: &Arc<Record>) {
        if let Some(hold) = &mut self.hold {
            hold.set_record(record);
        }
    }

    pub(super) fn hold_lines(&mut self) -> Vec<LogLine> {
        self.hold.as_mut().map(Beside::take_log).unwrap_or_default()
    }

    /// Returns the header of the run's log.
    pub(super) fn header(&self) -> &Header {
        self.recorder.header()
    }

    pub(super) fn findings(&self) -> &Findings {
        self.recorder.findings()
    }

    pub(super) fn air(&self) -> Counters {
        self.air.counters()
    }

    pub(super) fn stats(&self) -> Stats {
        self.flight_controller.stats()
    }

    #[cfg(feature = "runs")]
    pub(super) fn hold_board(&mut self) -> Option<&mut Node<crate::boards::Hold, C>> {
        self.hold.as_mut().map(Beside::node)
    }

    pub(super) fn hold_figures(&self) -> Option<report::Hold> {
        Some(self.hold.as_ref()?.figures(self.flight_controller.hold()?))
    }

    /// Simulates and judges everything before `reached` (ns), an instant that both boards have passed.
    pub(super) fn come_to(&mut self, reached: u64, dpr: &mut Node<Dpr, C>) {
        self.watch_dpr(dpr);
        self.advance_air(reached, dpr);
        self.recorder.extend(self.dpr_events.take());
        self.note_station(reached);
        let mut known = reached.min(self.announced.unwrap_or(u64::MAX)).min(self.untold_since);
        if let Some(hold) = &mut self.hold {
            known = known.min(hold.watch(reached, dpr, &mut self.recorder));
        }
        self.recorder.release(known);
    }

    /// Records what the base station displays at `now` (ns), if a record is due or the alarms have changed.
    fn note_station(&mut self, now: u64) {
        let drone = self.base.drone();
        let calm = self.base_faults.contains(&BaseFault::Calm);
        let alarms = if calm { Alarms::none() } else { drone.alarms_at(now / 1_000) };
        if now < self.station.0 + STATION_EVERY && alarms == self.station.1 {
            return;
        }
        let young = self.base_faults.contains(&BaseFault::Young);
        let age_us = drone.reported().map(|held| if young { 0 } else { held.age_us(now / 1_000) });
        self.station = (now, alarms);
        let alarms = alarms.iter().map(|alarm: Alarm| alarm.code().to_owned()).collect();
        self.recorder.note(now, What::Station { age_us, alarms });
    }

    pub(super) fn keep_log(&mut self) {
        self.recorder.keep();
    }

    pub(super) fn add_faults(&mut self, faults: &Faults) {
        self.faults.add(faults.timeline(false));
    }

    pub(super) fn take_log(&mut self) -> Vec<Event> {
        self.recorder.take_kept()
    }

    pub(super) fn take_images(&mut self) -> Vec<(u64, Vec<u8>)> {
        self.flight_controller.take_images()
    }

    /// Takes each Port-Status with the base station's uplink that the flight controller has read since the last call.
    /// Each reading has its instant (ns).
    pub(super) fn take_ports(&mut self) -> Vec<(u64, Vec<u8>)> {
        self.flight_controller.take_ports()
    }

    /// Takes the bytes that the flight controller has read at the place of the hold's object since the last call. Each
    /// reading has its instant (ns).
    pub(super) fn take_holds(&mut self) -> Vec<(u64, Vec<u8>)> {
        self.flight_controller.take_holds()
    }

    pub(super) fn write(&mut self, uplink: &Uplink) {
        self.flight_controller.write(Written::BaseStation(uplink));
    }

    pub(super) fn watch_tasks(&mut self, tasks: TaskWatch) {
        self.tasks = Some(tasks);
    }

    /// Takes the signals of the wires since the last call, for the trace; empty without a trace.
    pub(super) fn take_marks(&mut self, dpr: &mut Node<Dpr, C>) -> Vec<Mark> {
        let Some(trace) = &mut self.trace else { return vec![] };
        let crossings = dpr.board_mut(|board| board.front_end.take_crossings());
        bus(trace, crossings, trace::DPR, [Wire::DprCs, Wire::DprIrq], DPR_SPI_HZ);
        if let Some(tasks) = &mut self.tasks {
            trace.extend(of_tasks(trace::Board::Dpr, tasks.take(dpr)));
        }
        std::mem::take(trace)
    }

    /// Ends the run at the instant `end` (ns).
    pub(super) fn finish(mut self, end: u64, evidence: Vec<What>, dpr: &mut Node<Dpr, C>) -> Ended {
        self.come_to(end, dpr);
        self.offered(None);
        for what in evidence {
            self.recorder.note(end, what);
        }
        let (verdict, log) = self.recorder.finish(end);
        let phases = self.sweeping.map(Sweeping::into_phases).unwrap_or_default();
        Ended { verdict, log, base: self.base, phases }
    }

    fn mark(&mut self, at: u64, wire: Wire, level: bool) {
        if let Some(trace) = &mut self.trace {
            trace.push(Mark::Level(at, wire, level));
        }
    }

    fn mark_word(&mut self, at: u64, word: Word, value: Option<u64>) {
        if let Some(trace) = &mut self.trace {
            trace.push(Mark::Word(at, word, value));
        }
    }

    // ---- the air

    /// Records an event that the poller emitted, and passes it through the air to the listener.
    fn emitted(&mut self, at: u64, event: AirEvent, node: &mut Node<Dpr, C>) {
        match &event {
            AirEvent::FieldOn | AirEvent::FieldOff => {
                let on = event == AirEvent::FieldOn;
                self.recorder.note(at, What::Field { on });
                self.mark(at, Wire::Field, on);
            }
            AirEvent::FrameStart(start) => {
                self.mark(at, Wire::Frame, true);
                if let Some(timestamp) = start.chunk.data.get(1..5).and_then(|bytes| bytes.try_into().ok()) {
                    self.mark_word(at, Word::FrameTimestamp, Some(u64::from(u32::from_le_bytes(timestamp))));
                }
                if let Some(&len) = start.chunk.data.first() {
                    self.place_transactions(at, len);
                }
            }
            AirEvent::Bytes(_) => {}
            AirEvent::FrameEnd { .. } => {
                self.mark(at, Wire::Frame, false);
                self.mark_word(at, Word::FrameTimestamp, None);
            }
        }
        self.air_at = self.air_at.max(at);
        if let Some(hold) = &mut self.hold {
            hold.overhear(at, &event, node);
        }
        let Self { air, recorder, .. } = self;
        node.board_mut(|board| {
            air.from_poller(at, event, &mut |at, event| {
                note_field(recorder, at, event);
                board.front_end.hear(at, event);
            });
        });
        self.note_air();
    }

    /// Advances the air to `to` (ns), up to which the poller has emitted everything. Passes on the frames that the air
    /// delays or repeats.
    fn advance_air(&mut self, to: u64, node: &mut Node<Dpr, C>) {
        let Self { air, recorder, .. } = self;
        node.board_mut(|board| {
            air.advance(to, &mut |at, event| {
                note_field(recorder, at, event);
                board.front_end.hear(at, event);
            });
        });
        self.note_air();
    }

    fn note_air(&mut self) {
        for frame in self.air.take_sent() {
            if let Some(sweeping) = &mut self.sweeping
                && let Some(&len) = frame.bytes.first()
            {
                sweeping.frame_took(len, frame.ended_ns - frame.started_ns);
            }
            if let Some(hold) = self.hold.as_mut().filter(|_| frame.whole) {
                hold.keep(&frame.bytes);
            }
            let what = What::Sent {
                started: frame.started_ns,
                bit_rate: frame.bits_per_second,
                bytes: Bytes(frame.bytes),
                whole: frame.whole,
            };
            self.recorder.note(frame.ended_ns, what);
        }
        for frame in self.air.take_heard() {
            let what = What::Heard { started: frame.started_ns, bytes: Bytes(frame.bytes), whole: frame.whole };
            self.recorder.note(frame.ended_ns, what);
            if self.wires.answers() {
                self.recorder.note(frame.ended_ns, What::Answer);
            }
        }
        for (at, kind) in self.air.take_injected() {
            self.recorder
                .note(at, What::Injected { kind: format!("air {kind}"), disturbs: Disturbance::Air, until: at });
        }
    }

    /// Places the transactions of a sweep around the end of a frame that began at `at` (ns) and has this LEN.
    fn place_transactions(&mut self, at: u64, len: u8) {
        let Some(sweeping) = &mut self.sweeping else { return };
        let config = *self.flight_controller.config();
        for (edge, instant, bytes) in sweeping.frame_started(at, len) {
            let bytes = bytes.unwrap_or(config.image_len());
            let at_ns = match edge {
                Edge::Falls => instant,
                Edge::Rises => instant - config.transaction_ns(bytes),
            };
            self.flight_controller.place(Placed { at_ns, bytes });
        }
    }

    fn note_phase(&mut self, at: u64, event: PhaseEvent) {
        if let Some(phase) = self.sweeping.as_mut().and_then(Sweeping::phase) {
            let after = i64::try_from(at).unwrap_or(i64::MAX) - i64::try_from(phase.frame_ended).unwrap_or(i64::MAX);
            phase.events.push((after, event));
        }
    }

    /// Records the events of the DPR's pins and its SPIS since the last call.
    fn watch_dpr(&mut self, node: &mut Node<Dpr, C>) {
        let changes = node.board_mut(Dpr::take_fresh);
        let spis = node.input(|part, _, _| part.take_spis_events());
        let mut offers = node.input(|part, _, _| part.take_spis_offers()).into_iter();
        let mut seen: Vec<(u64, Seen)> = vec![];
        for (at, level) in changes {
            seen.extend(self.wires.fresh(at, level).map(|(at, level)| (at, Seen::Fresh(level))));
        }
        seen.extend(node.resets()[self.restarts..].iter().map(|reset| (reset.at, Seen::Restart)));
        self.restarts = node.resets().len();
        // If FRESH rises at the instant of an event of the SPIS, the rise is recorded first.
        seen.extend(spis.into_iter().map(|(cycle, _, event)| (node.ns(cycle), Seen::Spis(event))));
        seen.sort_by_key(|(at, _)| *at);
        for (at, what) in seen {
            match what {
                Seen::Restart => {
                    self.offered(None);
                    self.offer = None;
                }
                Seen::Fresh(high) => self.fresh_changed(at, high),
                Seen::Spis(event) => {
                    self.note_phase(at, PhaseEvent::Spis(event));
                    if event == SpisEvent::Ready {
                        let offered = offers.next().map(|(_, image)| image).unwrap_or_default();
                        self.offer = Some(offered.clone());
                        if self.announced.is_some_and(|rose| rose <= at) {
                            self.offered(Some(offered));
                        }
                    } else {
                        self.offer = None;
                    }
                    let what = match event {
                        SpisEvent::Held => SsiEvent::Held,
                        SpisEvent::Released => SsiEvent::Released,
                        SpisEvent::Ready => SsiEvent::Ready,
                        SpisEvent::Busy => SsiEvent::Busy,
                        SpisEvent::End { .. } => continue,
                    };
                    self.recorder.note(at, What::Ssi(what));
                }
            }
        }
        self.dpr_events.watch(node);
    }

    fn fresh_changed(&mut self, at: u64, high: bool) {
        self.mark(at, Wire::Fresh, high);
        self.note_phase(at, if high { PhaseEvent::FreshRises } else { PhaseEvent::FreshFalls });
        if high {
            self.offered(None);
            self.announced = Some(at);
            // FRESH rose during a transaction, or at the instant of its end.
            if self.selected || at <= self.deselected {
                self.offered(None);
            } else if self.offer.is_some() {
                // The SPIS already has the image that FRESH announces.
                self.offered(self.offer.clone());
            }
        } else {
            self.recorder.note(at, What::Fresh { high, offered: None });
        }
    }

    /// Records the last rise of FRESH. `image` is what a transaction after that rise would read.
    fn offered(&mut self, image: Option<Vec<u8>>) {
        if let Some(at) = self.announced.take() {
            self.recorder.note(at, What::Fresh { high: true, offered: image.map(Bytes) });
        }
    }

    fn transaction_over(&mut self, Transaction { selected_ns, deselected_ns, mosi, miso, .. }: Transaction) {
        let what = What::Transaction { selected: selected_ns, mosi: Bytes(mosi), miso: Bytes(miso) };
        self.recorder.note(deselected_ns, what);
        if let Some(report) = self.flight_controller.last().map(|last| last.report) {
            let report = self.wires.report(report);
            let position = report.position.map(|values| values.timestamp);
            let age_us = (report.age_us != AGE_UNKNOWN).then_some(report.age_us);
            self.recorder.note(deselected_ns, What::Decided { position, age_us });
        }
        let mut line = self.flight_controller.take_downlink();
        if !self.wires.forwards() {
            return;
        }
        if let Some(profile) = self.flight_controller.last().and_then(|last| last.forwarded.clone()) {
            self.recorder.note(deselected_ns, What::Forwarded { profile: Bytes(profile) });
        }
        if !self.wires.radio(&mut line) {
            return;
        }
        for arrival in self.base.receive(deselected_ns, &line) {
            let layout = self.flight_controller.config().layout();
            let shown = self.base_faults.iter().fold(arrival.shown, |shown, fault| fault.shows(shown, layout));
            let what = What::Arrived { profile: Bytes(arrival.profile), shown };
            self.recorder.note(deselected_ns, what);
        }
    }

    fn turn(&mut self, turn: &Turn, node: &mut Node<Dpr, C>) {
        let now = node.now();
        let (Turn::Begins(episode) | Turn::Ends(episode)) = turn else {
            self.turn_board(turn, node);
            return;
        };
        let Episode { at, fault, .. } = episode;
        let begins = matches!(turn, Turn::Begins(_));
        let of_the_board = matches!(
            fault,
            Fault::Power(..)
                | Fault::Hang(_)
                | Fault::DeadTask(..)
                | Fault::Spurious(..)
                | Fault::Chip(..)
                | Fault::Buffer(_)
                | Fault::Upset(..)
                | Fault::Image(..)
        );
        if begins && !of_the_board {
            self.recorder.note(now, injected(now, episode));
        }
        match fault {
            Fault::Air(faults) => {
                if begins {
                    self.air_faults.push((*at, *faults));
                } else if let Some(place) = self.air_faults.iter().position(|other| *other == (*at, *faults)) {
                    self.air_faults.remove(place);
                }
                let faults = self.air_faults.last().map_or_else(AirFaults::default, |(_, faults)| *faults);
                let Self { air, recorder, .. } = self;
                let from = now.max(self.air_at);
                node.board_mut(|board| {
                    air.set_faults(from, faults, &mut |at, event| {
                        note_field(recorder, at, event);
                        board.front_end.hear(at, event);
                    });
                });
                self.note_air();
            }
            Fault::FlightController(conduct) => {
                self.flight_controller.set_conduct(now, begins.then_some(*conduct));
            }
            Fault::Hold(fault) => {
                if let Some(hold) = &mut self.hold {
                    hold.turn(now, fault, begins, node, &mut self.recorder);
                }
            }
            Fault::Wire(fault) if begins => self.wires.begin(*fault),
            Fault::Wire(fault) => self.wires.end(*fault),
            Fault::Base(fault) if begins => self.base_faults.push(*fault),
            Fault::Base(fault) => {
                if let Some(place) = self.base_faults.iter().position(|other| other == fault) {
                    self.base_faults.remove(place);
                }
            }
            _ => {
                self.turn_board(turn, node);
                if matches!(fault, Fault::Power(..)) {
                    self.offered(None);
                    self.offer = None;
                }
            }
        }
    }

    fn turn_board(&mut self, turn: &Turn, node: &mut Node<Dpr, C>) {
        self.dpr_events.turn(node, turn);
        // A DPR without supply offers no image. `watch_dpr` handles all other restarts.
        if !node.is_powered() {
            self.offered(None);
            self.offer = None;
        }
    }
}

fn note_field(recorder: &mut Recorder, at: u64, event: &AirEvent) {
    match event {
        AirEvent::FieldOn => recorder.note(at, What::FieldHeard { on: true }),
        AirEvent::FieldOff => recorder.note(at, What::FieldHeard { on: false }),
        _ => {}
    }
}

impl<C: Cost> Downstream<Dpr, C> for Link<C> {
    type Message = AirEvent;
    type Notes = Notes;

    fn hear(&mut self, at: u64, event: AirEvent, node: &mut Node<Dpr, C>) {
        self.emitted(at, event, node);
    }

    fn noted(&mut self, notes: Notes) {
        self.recorder.extend(notes.events);
        self.untold_since = notes.untold_since;
        self.horus_lines.extend(notes.lines);
        if let Some(trace) = &mut self.trace {
            bus(trace, notes.crossings, trace::HORUS, [Wire::HorusCs, Wire::HorusIrq], HORUS_SPI_HZ);
            trace.extend(notes.marks);
        }
    }

    fn leave(&mut self, node: &mut Node<Dpr, C>) {
        for (at, event) in node.board_mut(|board| board.front_end.take_air()) {
            self.air.from_listener(at, &event);
            if matches!(event, AirEvent::FrameStart(_)) {
                self.recorder.note(at, What::Answer);
            }
        }
        if let Some(hold) = &mut self.hold {
            hold.answered(node, &mut self.recorder);
        }
    }

    fn next_at(&self) -> u64 {
        let air = self.air.next_event().unwrap_or(u64::MAX);
        let hold = self.hold.as_ref().map_or(u64::MAX, Beside::next_at);
        self.flight_controller.next_at().min(self.faults.next_at()).min(air).min(hold)
    }

    fn act(&mut self, at: u64, node: &mut Node<Dpr, C>) {
        if self.air.next_event().is_some_and(|next| next <= at) {
            self.advance_air(at, node);
        }
        if let Some(hold) = self.hold.as_mut().filter(|hold| hold.next_at() <= at) {
            hold.act(at, node, &mut self.recorder);
        }
        while let Some(turn) = self.faults.take(at) {
            self.watch_dpr(node);
            self.turn(&turn, node);
        }
        if self.flight_controller.next_at() > at {
            return;
        }
        if !self.flight_controller.is_clocking() {
            self.watch_dpr(node);
        }
        match self.flight_controller.act(node, &mut self.wires) {
            Some(Progress::Selected(selected)) => {
                self.offered(None);
                self.selected = true;
                self.recorder.note(selected, What::Selected);
                self.mark(at, Wire::SsiCsn, false);
                self.note_phase(selected, PhaseEvent::Selected);
            }
            Some(Progress::Clocked(run)) => {
                if let Some(trace) = &mut self.trace {
                    trace.extend(run.bytes().map(|(at, mosi, miso)| Mark::Byte(at, trace::SSI, mosi, miso, SSI_HZ)));
                }
            }
            Some(Progress::Over(transaction)) => {
                self.selected = false;
                self.deselected = transaction.deselected_ns;
                self.mark(at, Wire::SsiCsn, true);
                self.note_phase(transaction.deselected_ns, PhaseEvent::Deselected);
                if let Some(link) = self.flight_controller.last().and_then(|last| last.link) {
                    self.mark_word(at, Word::LinkStatusAge, Some(u64::from(link.age_100us)));
                }
                self.transaction_over(transaction);
            }
            None => {}
        }
    }
}

/// Reads the counters of both firmwares, and the loads of both cores, at the end of a run.
pub(super) fn evidence<C: Cost>(horus: &Node<Horus, C>, dpr: &Node<Dpr, C>, receivers: usize) -> Vec<What> {
    let mut evidence = vec![];
    evidence.extend(super::telemetry::counters(horus, dpr, receivers));
    let load = |load: f64| (load * 1e4).round() as u32;
    evidence.push(What::Load { board: Side::Horus, per_10_000: load(horus.usage().load()) });
    evidence.push(What::Load { board: Side::Dpr, per_10_000: load(dpr.usage().load()) });
    evidence
}
