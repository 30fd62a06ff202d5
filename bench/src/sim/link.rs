//! What is between and beside the boards, as the scheduler sees it, and what it notes for the report.

use std::collections::VecDeque;
use std::ops::Range;

use cortex_m4::{Bound, Cost};
use dpr_fw::telemetry::Telemetry as DprTelemetry;
use gnss_sim::{Burst, Receiver};
use horus_tx_fw::telemetry::Telemetry as HorusTelemetry;
use nrf52840::SpisEvent;
use profile::air::{CRC_BYTES, LEN_BYTES};
use profile::sequence::SEARCH_CYCLES;
use profile::{Layout, Object, ReportedPosition};
use st25r3916_model::{Air, AirEvent};

use super::boards::{Dpr, Horus};
use super::front_end::Crossing;
use super::ledger::{Ledger, Seen, bounds, ms};
use super::phases::{Edge, Event, Phase, Sweeping};
use super::trace::{self, Mark, Wire};
use crate::engine::{Board, Downstream, LogLine, Node, Upstream};
use crate::report::{self, Report, Reported};
use crate::world::flight_controller::{Action, Outcome, Placed, Transaction};
use crate::world::{BaseStation, FlightController};

/// The front ends' SPI clocks as the firmwares set them, for the trace, Hz.
const HORUS_SPI_HZ: u32 = horus_tx_fw::timing::SPI_HZ;
const DPR_SPI_HZ: u32 = 8_000_000;

/// The SSI's clock, for the trace, Hz.
const SSI_HZ: u32 = profile::ssi::timing::MAX_CLOCK_HZ;

/// How many bytes of an SSI transaction cross together. The DPR's memory is read and written when the last of them has
/// been clocked: EasyDMA is up to this many microseconds late, but no event is.
const RUN: usize = 16;

/// A receiver and what it sends next.
#[derive(Clone, Debug)]
struct Feed {
    receiver: Receiver,
    upcoming: Option<Burst>,
    /// When its next burst begins.
    next: Option<u64>,
    /// When its last valid position had arrived.
    solution: Option<u64>,
}

impl Feed {
    fn new(mut receiver: Receiver) -> Self {
        let upcoming = receiver.next();
        let next = upcoming.as_ref().map(|burst| burst.at_ns);
        Self { receiver, upcoming, next, solution: None }
    }
}

/// What stands beside HORUS: its receivers, and the antenna that takes what its front end emits.
#[derive(Clone, Debug)]
pub(super) struct Receivers {
    feeds: Vec<Feed>,
}

impl Receivers {
    pub(super) fn new(receivers: Vec<Receiver>) -> Self {
        Self { feeds: receivers.into_iter().map(Feed::new).collect() }
    }
}

/// What is told of the HORUS board as it runs ahead.
#[derive(Debug)]
pub(super) struct Notes {
    lines: Vec<LogLine>,
    /// When HORUS gave its front end the transmit command.
    transmits: Vec<u64>,
    /// When its 10 ms timer ticked.
    ticks: Vec<u64>,
    /// For each receiver, when its last valid position had arrived.
    solutions: Vec<Option<u64>>,
    /// What crossed between the part and its front end; nothing unless there is a trace.
    crossings: Vec<(u64, Crossing)>,
}

impl<C: Cost> Upstream<Horus, C> for Receivers {
    type Message = AirEvent;
    type Notes = Notes;

    fn leave(&mut self, node: &mut Node<Horus, C>, sent: &mut Vec<(u64, AirEvent)>) {
        node.board_mut(|board| sent.extend(board.front_end.take_air()));
    }

    fn notes(&mut self, node: &mut Node<Horus, C>) -> Notes {
        let (transmits, crossings, ticks) = node.board_mut(|board| {
            (board.front_end.take_transmits(), board.front_end.take_crossings(), board.take_ticks())
        });
        let solutions = self.feeds.iter().map(|feed| feed.solution).collect();
        Notes { lines: node.take_log(), transmits, ticks, solutions, crossings }
    }

    fn next_at(&self) -> u64 {
        self.feeds.iter().filter_map(|feed| feed.next).min().unwrap_or(u64::MAX)
    }

    fn act(&mut self, at: u64, node: &mut Node<Horus, C>) {
        for (index, feed) in self.feeds.iter_mut().enumerate() {
            if feed.next.is_none_or(|next| next > at) {
                continue;
            }
            if let Some(burst) = feed.upcoming.take() {
                feed.solution = feed.receiver.last_solution_ns(&burst).or(feed.solution);
                let now = node.now();
                node.board_mut(|board| board.send(now, index, &burst.bytes));
            }
            feed.upcoming = feed.receiver.next();
            feed.next = feed.upcoming.as_ref().map(|burst| burst.at_ns);
        }
    }
}

/// The air, the DPR's surroundings, and what the run notes.
#[derive(Clone, Debug)]
pub(super) struct Link {
    air: Air,
    /// Bytes of the frame that is on the air: LEN, payload, CRC-16.
    frame: Vec<u8>,
    longest_frame_ns: u64,
    frame_started: u64,
    layout: Layout,
    flight_controller: FlightController,
    /// When the flight controller next does something.
    acts_at: u64,
    /// How many bytes the flight controller is clocking.
    clocking: usize,
    /// When the DPR's pin saw chip select fall last: at the first boundary of its instructions from when it was due,
    /// ns.
    selected: u64,
    base: BaseStation,
    ledger: Ledger,
    reported: Reported,
    /// The last cycle whose Reported-Position was read and valid.
    valid_cycle: Option<u32>,
    /// What goes into a trace, while there is one.
    trace: Option<Vec<Mark>>,
    sweeping: Option<Sweeping>,
    /// What HORUS logged as it ran ahead.
    horus_lines: VecDeque<LogLine>,
}

impl Link {
    pub(super) fn new(
        air: Air,
        flight_controller: FlightController,
        base: BaseStation,
        traced: bool,
        sweeping: Option<Sweeping>,
    ) -> Self {
        let layout = flight_controller.config().layout();
        Self {
            air,
            frame: vec![],
            longest_frame_ns: 0,
            frame_started: 0,
            acts_at: flight_controller.next_at(),
            layout,
            flight_controller,
            clocking: 0,
            selected: 0,
            base,
            ledger: Ledger::new(layout),
            reported: Reported::default(),
            valid_cycle: None,
            trace: traced.then(Vec::new),
            sweeping,
            horus_lines: VecDeque::new(),
        }
    }

    /// What HORUS had logged by `now`.
    pub(super) fn horus_lines(&mut self, now: u64) -> impl Iterator<Item = LogLine> {
        std::iter::from_fn(move || self.horus_lines.pop_front_if(|line| line.at <= now))
    }

    /// The base station, and what a sweep brought.
    pub(super) fn into_parts(self) -> (BaseStation, Vec<Phase>) {
        (self.base, self.sweeping.map(Sweeping::into_phases).unwrap_or_default())
    }

    /// What happened on the wires since the last call, for the trace.
    ///
    /// The DPR's pins are looked at first, with or without a trace: a change of FRESH since the flight controller's
    /// last action must be in the trace before what comes after it, and a trace must not change what is noted when.
    pub(super) fn take_marks<C: Cost>(&mut self, dpr: &mut Node<Dpr, C>) -> Vec<Mark> {
        self.watch_dpr(dpr);
        let Some(trace) = &mut self.trace else { return vec![] };
        let crossings = dpr.board_mut(|board| board.front_end.take_crossings());
        trace_bus(trace, crossings, trace::DPR, [Wire::DprCs, Wire::DprIrq], DPR_SPI_HZ);
        std::mem::take(trace)
    }

    fn mark(&mut self, at: u64, wire: Wire, level: bool) {
        if let Some(trace) = &mut self.trace {
            trace.push(Mark::Level(at, wire, level));
        }
    }

    /// What the poller emitted: noted, then through the air to the listener.
    fn emitted<C: Cost>(&mut self, at: u64, event: AirEvent, node: &mut Node<Dpr, C>) {
        match &event {
            AirEvent::FieldOn => self.mark(at, Wire::Field, true),
            AirEvent::FieldOff => self.mark(at, Wire::Field, false),
            AirEvent::FrameStart(start) => {
                self.frame.clone_from(&start.chunk.data);
                self.frame_started = at;
                self.ledger.frame_started(at);
                self.mark(at, Wire::Frame, true);
                self.place_transactions(at);
            }
            AirEvent::Bytes(chunk) => self.frame.extend_from_slice(&chunk.data),
            AirEvent::FrameEnd { .. } => {
                let took = at - self.frame_started;
                self.longest_frame_ns = self.longest_frame_ns.max(took);
                if let (Some(sweeping), Some(&len)) = (&mut self.sweeping, self.frame.first()) {
                    sweeping.frame_took(len, took);
                }
                let end = self.frame.len().saturating_sub(CRC_BYTES).max(LEN_BYTES);
                self.ledger.frame_ended(at, self.frame.get(LEN_BYTES..end).unwrap_or_default());
                self.mark(at, Wire::Frame, false);
            }
        }
        let air = &mut self.air;
        node.board_mut(|board| air.from_poller(at, event, |at, event| board.front_end.hear(at, event)));
    }

    /// A frame began at `at`: the transactions that a sweep wants around its end are placed.
    fn place_transactions(&mut self, at: u64) {
        let (Some(sweeping), Some(&len)) = (&mut self.sweeping, self.frame.first()) else { return };
        let config = *self.flight_controller.config();
        for (edge, instant, bytes) in sweeping.frame_started(at, len) {
            let bytes = bytes.unwrap_or(config.image_len());
            let at_ns = match edge {
                Edge::Falls => instant,
                Edge::Rises => instant - config.transaction_ns(bytes),
            };
            self.flight_controller.place(Placed { at_ns, bytes });
        }
        if self.clocking == 0 {
            self.acts_at = self.flight_controller.next_at();
        }
    }

    /// Notes what happened for the phase that is being swept.
    fn note_phase(&mut self, at: u64, event: Event) {
        if let Some(phase) = self.sweeping.as_mut().and_then(Sweeping::phase) {
            let after = i64::try_from(at).unwrap_or(i64::MAX) - i64::try_from(phase.frame_ended).unwrap_or(i64::MAX);
            phase.events.push((after, event));
        }
    }

    /// What the DPR's pins and its SPIS showed since the last look.
    fn watch_dpr<C: Cost>(&mut self, node: &mut Node<Dpr, C>) {
        for (at, level) in node.board_mut(Dpr::take_fresh) {
            self.mark(at, Wire::Fresh, level);
            if level {
                self.ledger.fresh(at);
            }
            self.note_phase(at, if level { Event::FreshRises } else { Event::FreshFalls });
        }
        for (cycle, _, event) in node.input(|part, _, _| part.take_spis_events()) {
            let at = node.ns(cycle);
            match event {
                SpisEvent::Held => self.ledger.held(at),
                SpisEvent::Released => self.ledger.released(at),
                SpisEvent::Ready => self.ledger.ready(at),
                SpisEvent::Busy | SpisEvent::End { .. } => {}
            }
            self.note_phase(at, Event::Spis(event));
        }
    }

    /// What the flight controller does next, and when: bytes in runs of some.
    fn plan<C: Cost>(&mut self, node: &Node<Dpr, C>) {
        self.clocking = self.flight_controller.bytes_left().min(RUN).min(node.part().ssi_quiet());
        self.acts_at = match self.clocking {
            0 => self.flight_controller.next_at(),
            bytes => self.flight_controller.clocked_at(bytes),
        };
    }

    /// The bytes that the flight controller has clocked cross the SSI.
    fn exchange<C: Cost>(&mut self, node: &mut Node<Dpr, C>) {
        let Self { flight_controller, trace, clocking, .. } = self;
        let bytes = std::mem::take(clocking);
        let (first, last) = (flight_controller.clocked_at(1), flight_controller.clocked_at(bytes));
        let mosi = flight_controller.upcoming(bytes);
        let miso = node.ssi_exchange(first, last, &mosi);
        for miso in miso {
            let ends = trace.is_some().then(|| flight_controller.clocked_at(1));
            let (_, Action::Byte(mosi)) = flight_controller.act() else { unreachable!("that many bytes are left") };
            flight_controller.miso(miso);
            if let (Some(trace), Some(ends)) = (trace.as_mut(), ends) {
                trace.push(Mark::Byte(ends, trace::SSI, mosi, miso, SSI_HZ));
            }
        }
    }

    /// The flight controller's transaction is over: what it brought is judged and passed on.
    fn transaction_over(&mut self, at: u64) {
        let before = self.ledger.violations.counts();
        self.judge_transaction(at);
        let Some(phase) = self.sweeping.as_mut().and_then(Sweeping::phase) else { return };
        let after = self.ledger.violations.counts();
        let broken = after.into_iter().filter(|(kind, count)| before.get(kind).is_none_or(|before| before < count));
        phase.violations.extend(broken.map(|(kind, _)| kind));
    }

    fn judge_transaction(&mut self, at: u64) {
        self.base.receive(at, &self.flight_controller.take_downlink());
        let Some(transaction) = self.flight_controller.last() else { return };
        let mut seen = Seen { selected: self.selected, objects: vec![] };
        if transaction.outcome != Outcome::Busy {
            for index in 0..self.layout.objects() {
                let bytes = self.layout.in_image(index).and_then(|place| within(transaction, place));
                if let Some(Ok(object)) = bytes.map(|bytes| Object::verify(index, bytes)) {
                    seen.objects.push((object.identifier(), object.timestamp(), object.as_bytes().to_vec()));
                }
            }
        }
        self.reported_position();
        let Some(transaction) = self.flight_controller.last() else { return };
        if transaction.torn {
            self.ledger.violations.add("a torn read", || format!("the transaction of {}", ms(transaction.selected_ns)));
        }
        self.ledger.busy(transaction.selected_ns, transaction.outcome == Outcome::Busy);
        if let Some((offset, rejection)) = transaction.damage {
            let at = ms(transaction.selected_ns);
            self.ledger.violations.add("damaged data in the image", || format!("{rejection} at offset {offset}, {at}"));
        }
        self.ledger.transaction(&seen);
    }

    /// Notes whether the transaction that is over brought a valid Reported-Position.
    fn reported_position(&mut self) {
        let Some(transaction) = self.flight_controller.last() else { return };
        let Self { layout, reported, valid_cycle, .. } = self;
        let place = layout.in_image(0).and_then(|place| within(transaction, place));
        // A transaction that met the DPR busy, or read another part of the image, tells nothing.
        let (Some(bytes), false) = (place, transaction.outcome == Outcome::Busy) else { return };
        match ReportedPosition::verify(bytes) {
            Ok(position) if position.values().status.position_valid() => {
                reported.valid_cycles +=
                    u64::from(valid_cycle.replace(position.timestamp()) != Some(position.timestamp()));
                reported.invalid_since_ns = None;
            }
            _ if valid_cycle.is_some() => {
                reported.invalid_since_ns.get_or_insert(transaction.selected_ns);
            }
            _ => {}
        }
    }

    /// The figures of the whole run, which took `duration` ns.
    pub(super) fn report<C: Cost>(
        &mut self,
        horus: &mut Node<Horus, C>,
        dpr: &mut Node<Dpr, C>,
        duration: u64,
    ) -> Report {
        self.watch_dpr(dpr);
        let worst = C::BOUND == Some(Bound::Worst);
        let jitter = if worst { bounds::TICK_TO_COMMAND_JITTER_PESSIMISTIC } else { bounds::TICK_TO_COMMAND_JITTER };
        self.ledger.judge(duration, jitter);
        let counters = self.air.counters();
        let stats = self.flight_controller.stats();
        let base = self.base.counts();
        let dpr_counter = |dpr: &Node<Dpr, C>, at| counter(dpr, "DPR_TELEMETRY", at);
        let mut report = Report {
            horus: report::Horus {
                frames_sent: self.ledger.frames_sent(),
                period_ns: self.ledger.period(),
                tick_to_command_ns: self.ledger.tick_to_command(),
                tick_to_air_ns: self.ledger.tick_to_air(),
                load: rounded(horus.usage().load()),
            },
            air: report::Air {
                bit_rate: self.air.last_frame().map_or(0, |frame| u64::from(frame.bits_per_second)),
                air_time_ns: self.longest_frame_ns,
                frames_delivered: counters.delivered,
                frames_damaged: counters.damaged,
                frames_lost: counters.lost,
            },
            dpr: report::Dpr {
                objects_accepted: dpr_counter(dpr, std::mem::offset_of!(DprTelemetry, objects_accepted)),
                objects_rejected: dpr_counter(dpr, std::mem::offset_of!(DprTelemetry, objects_rejected)),
                frames_missed: dpr_counter(dpr, std::mem::offset_of!(DprTelemetry, frames_missed)),
                scrubs: dpr_counter(dpr, std::mem::offset_of!(DprTelemetry, scrubs)),
                scrub_faults: dpr_counter(dpr, std::mem::offset_of!(DprTelemetry, scrub_faults)),
                load: rounded(dpr.usage().load()),
            },
            latency_ns: report::Latency {
                sample_to_readable: self.ledger.sample_to_readable(),
                last_bit_to_readable: self.ledger.last_bit_to_readable(),
            },
            ssi: report::Ssi {
                transactions: stats.transactions,
                fresh: stats.fresh,
                repeated: stats.repeated,
                busy: stats.busy,
                bad_crc: stats.bad_crc,
                ready_ns: self.ledger.ready_after(),
            },
            reported: self.reported.clone(),
            base: report::Base { profiles: base.profiles, bad_crc: base.bad_crc },
            ..Report::default()
        };
        self.judge_boards(horus, dpr, &report);
        report.violations = std::mem::take(&mut self.ledger.violations).into_words();
        report
    }

    /// What the boards themselves must answer for.
    fn judge_boards<C: Cost>(&mut self, horus: &mut Node<Horus, C>, dpr: &mut Node<Dpr, C>, report: &Report) {
        let violations = &mut self.ledger.violations;
        for finding in horus.take_findings() {
            violations.add("HORUS", || finding.to_string());
        }
        for finding in dpr.take_findings() {
            violations.add("DPR", || finding.to_string());
        }
        for reset in horus.resets() {
            violations.add("HORUS restarted", || format!("{:?} at {}", reset.cause, ms(reset.at)));
        }
        for reset in dpr.resets() {
            violations.add("the DPR restarted", || format!("{:?} at {}", reset.cause, ms(reset.at)));
        }
        let chips =
            [("HORUS front end", horus.board().front_end.chip()), ("DPR front end", dpr.board().front_end.chip())];
        for (kind, chip) in chips {
            for misuse in chip.reports() {
                violations.add(kind, || misuse.to_string());
            }
        }
        if self.air.counters().answers > 0 {
            violations.add("the listener answered", || format!("{} times", self.air.counters().answers));
        }
        // Without its counters a firmware would pass the checks below unchecked.
        let images = [("HORUS", horus.address_of("HORUS_TELEMETRY")), ("the DPR", dpr.address_of("DPR_TELEMETRY"))];
        for (board, telemetry) in images {
            if let Err(missing) = telemetry {
                violations.add("an image without telemetry", || format!("{board}: {missing}"));
            }
        }
        let horus_counts = [
            ("HORUS skipped frames", std::mem::offset_of!(HorusTelemetry, frames_skipped)),
            ("HORUS front end faults", std::mem::offset_of!(HorusTelemetry, rf_faults)),
            ("HORUS cycles overran", std::mem::offset_of!(HorusTelemetry, cycle_overruns)),
        ];
        for (kind, at) in horus_counts {
            let count = counter(horus, "HORUS_TELEMETRY", at);
            if count > 0 {
                violations.add(kind, || count.to_string());
            }
        }
        // Every cycle that arrived whole is accepted whole, but for those with which the sequence is found and one that
        // may still be on its way through the DPR at the end.
        let (objects, frames) = (self.layout.objects() as u64, self.layout.frames() as u64);
        let due = (report.air.frames_delivered / frames).saturating_sub(u64::from(SEARCH_CYCLES) + 1) * objects;
        if report.air.frames_damaged + report.air.frames_lost == 0 && report.dpr.objects_accepted < due {
            violations.add("objects lost in the DPR", || format!("{} of {due} accepted", report.dpr.objects_accepted));
        }
        if report.dpr.scrub_faults > 0 {
            violations.add("a scrub found a stuck bit", || report.dpr.scrub_faults.to_string());
        }
    }
}

/// What `transaction` read of the image's bytes `place`, if it read all of them.
fn within(transaction: &Transaction, place: Range<usize>) -> Option<&[u8]> {
    let start = place.start.checked_sub(transaction.offset)?;
    transaction.miso.get(start..start + place.len())
}

/// Puts what crossed between a part and its front end on `trace`.
fn trace_bus(trace: &mut Vec<Mark>, crossings: Vec<(u64, Crossing)>, bus: trace::Bus, [cs, irq]: [Wire; 2], hz: u32) {
    for (at, crossing) in crossings {
        match crossing {
            Crossing::Select(selected) => trace.push(Mark::Level(at, cs, !selected)),
            Crossing::Byte(mosi, miso) => trace.push(Mark::Byte(at, bus, mosi, miso, hz)),
            Crossing::Irq(level) => trace.push(Mark::Level(at, irq, level)),
        }
    }
}

/// A counter of a firmware's telemetry, read from RAM as a debug probe reads it. 0 in an image that has none.
fn counter<B: Board, C: Cost>(node: &Node<B, C>, symbol: &str, offset: usize) -> u64 {
    let mut word = [0; 4];
    let read = node.address_of(symbol).and_then(|address| node.read(address + offset as u64, &mut word));
    read.map_or(0, |()| u64::from(u32::from_le_bytes(word)))
}

/// A load to four digits: what differs beyond that is no information.
fn rounded(load: f64) -> f64 {
    (load * 1e4).round() / 1e4
}

impl<C: Cost> Downstream<Dpr, C> for Link {
    type Message = AirEvent;
    type Notes = Notes;

    fn hear(&mut self, at: u64, event: AirEvent, node: &mut Node<Dpr, C>) {
        self.emitted(at, event, node);
    }

    fn noted(&mut self, Notes { lines, transmits, ticks, solutions, crossings }: Notes) {
        self.reported.last_solution_ns = solutions;
        for at in ticks {
            self.ledger.tick(at);
        }
        for at in transmits {
            self.ledger.commanded(at);
        }
        self.horus_lines.extend(lines);
        if let Some(trace) = &mut self.trace {
            trace_bus(trace, crossings, trace::HORUS, [Wire::HorusCs, Wire::HorusIrq], HORUS_SPI_HZ);
        }
    }

    fn leave(&mut self, node: &mut Node<Dpr, C>) {
        for (at, event) in node.board_mut(|board| board.front_end.take_air()) {
            self.air.from_listener(at, &event);
        }
    }

    fn next_at(&self) -> u64 {
        self.acts_at
    }

    fn act(&mut self, at: u64, node: &mut Node<Dpr, C>) {
        if self.clocking > 0 {
            self.exchange(node);
            self.plan(node);
            return;
        }
        self.watch_dpr(node);
        match self.flight_controller.act() {
            (_, Action::Select) => {
                self.selected = node.now();
                node.ssi_select();
                self.mark(at, Wire::SsiCsn, false);
                self.note_phase(self.selected, Event::Selected);
            }
            (_, Action::Byte(_)) => unreachable!("bytes are clocked in runs"),
            (_, Action::Deselect) => {
                let risen = node.now();
                node.ssi_deselect();
                self.mark(at, Wire::SsiCsn, true);
                self.note_phase(risen, Event::Deselected);
                self.ledger.deselected(risen);
                self.transaction_over(at);
            }
        }
        self.plan(node);
    }
}
