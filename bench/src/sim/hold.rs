//! Simulates the active hold: its board, and the air between the hold and the DPR's second front end.
//!
//! # Time
//!
//! The hold and the DPR are simulated in turn, each some time ahead of the other ([`Beside::lead`], [`REACTION`]). The
//! result is exact, because neither chip reacts to an event on the air within that time:
//!
//! - A chip reacts to a byte or to the end of a frame after 4.72 µs (`nfc_f_latency_ns`), and to a carrier after 10 µs
//!   (`field_detect_ns`).
//! - A chip reacts to a frame only after preamble and sync: 64 bits, or 151 µs.
//!
//! While the DPR answers, the steps are only a few microseconds long. Otherwise the hold is 150 µs ahead.

use std::sync::Arc;

use bench_judge::{Bytes, Cause, HoldEvent, HoldFrame, What};
use cortex_m4::Cost;
use cortex_m4::coverage::Record;
use profile::HoldStatus;
use profile::criticality::{ActiveLoad, Writer};
use st25r3916_model::{Air, AirEvent, AirFaults, AnswerFaults, AnswerPath, Chip, ForeignCard};

use super::board_events::cause;
use super::hold_board;
use super::recorder::Recorder;
use crate::boards::front_end::FrontEnd;
use crate::boards::{Dpr, Hold};
use crate::faults::hold::{Break, Impostor};
use crate::faults::image::Repair;
use crate::faults::{HoldFault, ImageFault};
use crate::payload::Payload;
use crate::report;
use crate::world::flight_controller::{Fates, HoldUser};
use emulator_node::{LogLine, Node};

/// The least time from an event on the air to a reaction of the receiving chip, ns: the receiver's latency, less the
/// time by which a board's last instruction may exceed a step.
const REACTION: u64 = 3_700;

/// The least time from the DPR's transmit command to a reaction of the hold's chip, ns: preamble and sync (150.9 µs)
/// and [`REACTION`].
const BEFORE_AN_ANSWER: u64 = 150_000;

/// The number of HORUS's last frames that are kept for a hostile sender.
const OF_HORUS: usize = 8;

/// The interval between two records of the payload's true state, ns.
const PAYLOAD_EVERY: u64 = 100_000_000;

/// The hold, and the air between it and the DPR's second front end.
#[derive(Clone, Debug)]
pub(super) struct Beside<C: Cost> {
    node: Node<Hold, C>,
    /// The path of the hold's frames to the DPR.
    air: Air,
    /// The path of the DPR's answers to the hold.
    answers: AnswerPath,
    /// The instant, ns, up to which the hold has been simulated.
    reached: u64,
    /// The answer that the DPR is sending: the instant of its first bit (ns), and its bytes so far.
    answering: Option<(u64, Vec<u8>)>,
    answer_faults: AnswerFaults,
    /// The hostile sender in place of the hold, and whether it stops after its present frame.
    impostor: Option<(Impostor, bool)>,
    /// The last frames of HORUS, which a hostile sender may repeat.
    of_horus: Vec<Vec<u8>>,
    crosstalk: bool,
    /// The original contents of memory, which are restored when a fault ends.
    repairs: Vec<(HoldFault, Repair)>,
    broken: Option<Break>,
    /// Whether a frame of the hold is on the air.
    sending: bool,
    /// The number of restarts of the hold that are in the log.
    restarts: usize,
    findings: usize,
    /// The instant of the next record of the payload, ns.
    payload_at: u64,
    payload_from: u64,
}

impl<C: Cost> Beside<C> {
    pub(super) fn new(node: Node<Hold, C>, seed: u64) -> Self {
        Self {
            node,
            air: Air::new(seed ^ 0x41, AirFaults::default()),
            answers: AnswerPath::new(seed ^ 0x42, AnswerFaults::default()),
            reached: 0,
            answering: None,
            answer_faults: AnswerFaults::default(),
            impostor: None,
            of_horus: vec![],
            crosstalk: false,
            repairs: vec![],
            broken: None,
            sending: false,
            restarts: 0,
            findings: 0,
            payload_at: PAYLOAD_EVERY,
            payload_from: 0,
        }
    }

    #[cfg(feature = "runs")]
    pub(super) fn node(&mut self) -> &mut Node<Hold, C> {
        &mut self.node
    }

    pub(super) fn set_record(&mut self, record: &Arc<Record>) {
        self.node.set_record(record.clone());
    }

    /// The instant, ns, up to which the DPR may be simulated before the next call of [`Beside::act`].
    pub(super) fn next_at(&self) -> u64 {
        (self.reached + REACTION).min(self.air.next_event().unwrap_or(u64::MAX))
    }

    /// Returns the time, ns, for which the hold may be simulated ahead of the DPR.
    fn lead(&self, dpr: &Node<Dpr, C>) -> u64 {
        let answers = dpr.board().hold_port.as_ref().is_some_and(|port| port.chip().is_transmitting());
        // The DPR's answer cuts off the answer of a foreign card.
        if answers || self.answering.is_some() || self.answers.next_event().is_some() {
            REACTION
        } else {
            BEFORE_AN_ANSWER
        }
    }

    /// Simulates the hold as far as the rules of the [module](self) allow, now that the DPR has reached `at` (ns).
    pub(super) fn act(&mut self, at: u64, dpr: &mut Node<Dpr, C>, recorder: &mut Recorder) {
        if at >= self.reached + REACTION {
            let to = at + self.lead(dpr);
            loop {
                self.emitted(dpr, recorder);
                self.impose(dpr, recorder);
                let now = self.node.now();
                self.answer(now.min(at));
                if now >= to {
                    break;
                }
                let due = self.answers.next_event().filter(|due| *due > now).unwrap_or(u64::MAX);
                let imposed = self.impostor.as_ref().map_or(u64::MAX, |(impostor, _)| impostor.next_at());
                self.node.advance(to.min(due).min(imposed));
            }
            self.reached = to;
        }
        let Self { air, .. } = self;
        dpr.board_mut(|board| {
            air.advance(at, &mut |at, event| hear(board, at, event));
        });
        self.note_air(recorder);
    }

    /// Passes what the hold has emitted to the DPR's second front end.
    fn emitted(&mut self, dpr: &mut Node<Dpr, C>, recorder: &mut Recorder) {
        if !self.node.board().front_end.has_air() {
            return;
        }
        for (at, event) in self.node.board_mut(|board| board.front_end.take_air()) {
            // The hold completes a frame that it began before the hostile sender.
            let goes_on = self.sending && matches!(event, AirEvent::Bytes(_) | AirEvent::FrameEnd { .. });
            if self.broken != Some(Break::Mute) && (self.impostor.is_none() || goes_on) {
                self.sending = matches!(event, AirEvent::FrameStart(_) | AirEvent::Bytes(_));
                self.carry(at, event, dpr, recorder);
            }
        }
    }

    /// Passes an event at the hold's antenna to the DPR's second front end.
    fn carry(&mut self, at: u64, event: AirEvent, dpr: &mut Node<Dpr, C>, recorder: &mut Recorder) {
        let Self { node, air, answers, crosstalk, broken, .. } = self;
        let is_field = matches!(event, AirEvent::FieldOn | AirEvent::FieldOff);
        if is_field {
            recorder.note(at, What::Hold(HoldEvent::Field { on: event == AirEvent::FieldOn }));
        }
        node.board_mut(|board| answers.from_poller(at, &event, &mut |at, event| board.front_end.hear(at, event)));
        dpr.board_mut(|board| {
            if *crosstalk && !is_field {
                board.front_end.hear(at, &event);
            }
            air.from_poller(at, event, &mut |at, event| {
                if *broken != Some(Break::PortDeaf) {
                    hear(board, at, event);
                }
            });
        });
        self.note_air(recorder);
    }

    /// Passes what a hostile sender has emitted up to the hold's present instant to the DPR.
    fn impose(&mut self, dpr: &mut Node<Dpr, C>, recorder: &mut Recorder) {
        let now = self.node.now();
        while let Some((impostor, ends)) = self.impostor.as_mut().filter(|(impostor, _)| impostor.next_at() <= now) {
            let Some((at, event)) = impostor.take(&self.of_horus, !*ends) else { break };
            self.carry(at, event, dpr, recorder);
        }
        let over = |(impostor, ends): &(Impostor, bool)| *ends && impostor.next_at() == u64::MAX;
        if let Some((impostor, _)) = self.impostor.take_if(|it| over(it)) {
            let carrier = self.node.board().front_end.chip().field_on();
            if impostor.carrier() != carrier {
                let event = if carrier { AirEvent::FieldOn } else { AirEvent::FieldOff };
                self.carry(now, event, dpr, recorder);
            }
        }
    }

    /// Passes an event at HORUS's antenna at `at` (ns) to the DPR's second front end, if there is crosstalk.
    pub(super) fn overhear(&mut self, at: u64, event: &AirEvent, dpr: &mut Node<Dpr, C>) {
        if self.crosstalk && !matches!(event, AirEvent::FieldOn | AirEvent::FieldOff) {
            dpr.board_mut(|board| hear(board, at, event));
        }
    }

    /// Keeps a frame of HORUS, which a hostile sender may repeat.
    pub(super) fn keep(&mut self, frame: &[u8]) {
        if self.of_horus.len() == OF_HORUS {
            self.of_horus.remove(0);
        }
        self.of_horus.push(frame.to_vec());
    }

    /// Begins or ends a fault of the hold, when the DPR has reached `at` (ns).
    pub(super) fn turn(
        &mut self,
        at: u64,
        fault: &HoldFault,
        begins: bool,
        dpr: &mut Node<Dpr, C>,
        recorder: &mut Recorder,
    ) {
        // A fault begins at the instant that the DPR has reached, or at the one that the hold has reached, whichever is
        // later.
        let from = at.max(self.node.now());
        match *fault {
            HoldFault::Frames(way) => {
                let way = if begins { way } else { AirFaults::default() };
                let air = &mut self.air;
                dpr.board_mut(|board| air.set_faults(from, way, &mut |at, event| hear(board, at, event)));
            }
            HoldFault::Answers(way) => {
                self.answer_faults.way = if begins { way } else { AirFaults::default() };
                self.set_answer_faults(from);
            }
            HoldFault::Port(fault) => {
                let turn = if begins { FrontEnd::begin_chip_fault } else { FrontEnd::end_chip_fault };
                dpr.board_mut(|board| board.hold_port.iter_mut().for_each(|port| turn(port, fault)));
            }
            HoldFault::Foreign(card) => {
                self.answer_faults.foreign = if begins { card } else { ForeignCard::default() };
                self.set_answer_faults(from);
            }
            HoldFault::Power(power) => {
                let was = self.node.is_powered();
                if begins {
                    power.begin(&mut self.node);
                } else {
                    power.end(&mut self.node);
                }
                let on = self.node.is_powered();
                if on != was {
                    recorder.note(from, What::Hold(HoldEvent::Power { on }));
                }
            }
            HoldFault::Hang if begins && self.node.is_powered() && !self.node.is_hung() => self.node.hang(),
            HoldFault::Hang => {}
            HoldFault::Hostile(hostile, seed) if begins => {
                let carrier = self.node.board().front_end.chip().field_on();
                self.impostor = Some((Impostor::new(hostile, seed, from, carrier), false));
            }
            HoldFault::Hostile(..) => {
                if let Some((_, ends)) = &mut self.impostor {
                    *ends = true;
                }
            }
            HoldFault::Silent(sensor) => self.payload(|payload| payload.silence(begins.then_some(sensor))),
            HoldFault::Lies(sensor, seed) => self.payload(|payload| payload.make_lie(begins.then_some((sensor, seed)))),
            HoldFault::BusStuck => self.payload(|payload| payload.hold_sda(begins)),
            HoldFault::Board(damage) => {
                let done = if begins {
                    let repair = hold_board::begin(damage, &mut self.node);
                    repair.map(|repair| self.repairs.push((*fault, repair)))
                } else {
                    hold_board::end(damage, &mut self.node);
                    let place = self.repairs.iter().position(|(of, _)| of == fault);
                    place.map_or(Ok(()), |place| self.repairs.remove(place).1.mend(&mut self.node))
                };
                if let Err(error) = done {
                    let text = format!("a fault could not be injected: {error}");
                    recorder.note(from, What::Hold(HoldEvent::Finding { text }));
                }
            }
            HoldFault::Sensors(fault) => self.payload(|payload| payload.turn(from, fault, begins)),
            HoldFault::Crosstalk => self.crosstalk = begins,
            HoldFault::Constant { of, value } => {
                if begins && let Err(error) = (ImageFault::Constant { of, value }).apply(&mut self.node) {
                    recorder.note(from, What::Hold(HoldEvent::Finding { text: error.to_string() }));
                }
            }
            HoldFault::Broken(what) => {
                self.broken = begins.then_some(what);
                if begins && what == Break::Misuse {
                    recorder.note(from, What::Hold(HoldEvent::Finding { text: "a misuse".into() }));
                }
                if what == Break::Lock
                    && let Some(locked) = self.node.board().outputs().locked
                {
                    recorder.note(from, What::Hold(HoldEvent::Lock { locked: locked != begins }));
                }
            }
        }
    }

    fn payload(&mut self, change: impl FnOnce(&mut Payload)) {
        self.node.board_mut(|board| change(&mut board.payload));
    }

    fn set_answer_faults(&mut self, from: u64) {
        let Self { node, answers, answer_faults, .. } = self;
        node.board_mut(|board| {
            answers.set_faults(from, *answer_faults, &mut |at, event| board.front_end.hear(at, event));
        });
    }

    /// Passes what the DPR's second front end has emitted to the hold.
    pub(super) fn answered(&mut self, dpr: &mut Node<Dpr, C>, recorder: &mut Recorder) {
        if !dpr.board().hold_port.as_ref().is_some_and(FrontEnd::has_air) {
            return;
        }
        let emitted = dpr.board_mut(|board| board.hold_port.as_mut().map(FrontEnd::take_air));
        let is_mute = self.broken == Some(Break::PortMute);
        for (at, event) in emitted.into_iter().flatten().filter(|_| !is_mute) {
            match &event {
                AirEvent::FrameStart(start) => self.answering = Some((at, start.chunk.data.clone())),
                AirEvent::Bytes(chunk) => {
                    if let Some((_, bytes)) = &mut self.answering {
                        bytes.extend_from_slice(&chunk.data);
                    }
                }
                AirEvent::FrameEnd { bits } => {
                    if let Some((started, mut bytes)) = self.answering.take() {
                        let sent = usize::try_from(bits / 8).unwrap_or(usize::MAX);
                        bytes.truncate(sent);
                        let whole = bytes.first().is_some_and(|len| bytes.len() == usize::from(*len) + 2);
                        if self.broken == Some(Break::Uplinks) {
                            bytes.iter_mut().skip(9).take(4).for_each(|byte| *byte ^= 0x5A);
                        }
                        let frame = HoldFrame { started, bytes: Bytes(bytes), whole };
                        recorder.note(at, What::Hold(HoldEvent::Answered(frame)));
                    }
                }
                AirEvent::FieldOn | AirEvent::FieldOff => {}
            }
            let Self { node, answers, broken, .. } = self;
            node.board_mut(|board| {
                answers.from_listener(at, event, &mut |at, event| {
                    if *broken != Some(Break::Deaf) {
                        board.front_end.hear(at, event);
                    }
                });
            });
        }
        self.note_air(recorder);
    }

    /// Passes delayed, repeated and foreign answers up to `to` (ns) to the hold.
    fn answer(&mut self, to: u64) {
        if self.answers.next_event().is_some_and(|next| next <= to) {
            let Self { node, answers, .. } = self;
            node.board_mut(|board| answers.advance(to, &mut |at, event| board.front_end.hear(at, event)));
        }
    }

    /// Records the frames and answers on the air since the last call.
    fn note_air(&mut self, recorder: &mut Recorder) {
        let mut note = |at, what| recorder.note(at, What::Hold(what));
        for mut sent in self.air.take_sent() {
            if self.broken == Some(Break::SetPoint) {
                change_set_point(&mut sent.bytes);
            }
            let frame = HoldFrame { started: sent.started_ns, bytes: Bytes(sent.bytes), whole: sent.whole };
            note(sent.ended_ns, HoldEvent::Sent(frame));
        }
        for heard in self.air.take_heard() {
            let frame = HoldFrame { started: heard.started_ns, bytes: Bytes(heard.bytes), whole: heard.whole };
            note(heard.ended_ns, HoldEvent::Heard(frame));
        }
        // The log has the faults of the air as episodes, and the answers as the DPR's chip sent them.
        self.air.take_injected();
        self.answers.take_injected();
        self.answers.take_sent();
        for heard in self.answers.take_heard() {
            let frame = HoldFrame { started: heard.started_ns, bytes: Bytes(heard.bytes), whole: heard.whole };
            note(heard.ended_ns, HoldEvent::AnswerHeard(frame));
        }
    }

    /// Records the events of the hold's board and of the DPR's second front end since the last call. Returns the
    /// instant, ns, up to which all events of the hold are known.
    pub(super) fn watch(&mut self, reached: u64, dpr: &mut Node<Dpr, C>, recorder: &mut Recorder) -> u64 {
        let node = &mut self.node;
        for reset in &node.resets()[self.restarts..] {
            let cause = cause(reset.cause);
            let asked = matches!(cause, Cause::PowerOn | Cause::Pin | Cause::BrownOut);
            recorder.note(reset.at, What::Hold(HoldEvent::Reset { cause, asked }));
        }
        self.restarts = node.resets().len();
        for finding in &node.findings()[self.findings..] {
            recorder.note(finding.at, What::Hold(HoldEvent::Finding { text: finding.to_string() }));
        }
        self.findings = node.findings().len();
        let (misuses, reports, locked) = node.board_mut(|board| {
            let misuses: Vec<_> = board.payload.take_misuses().collect();
            (misuses, board.front_end.with(Chip::take_reports), board.take_locked())
        });
        let reports = reports.into_iter().map(|report| (report.first_ns, report.to_string()));
        for (at, text) in misuses.into_iter().map(|text| (reached, text)).chain(reports) {
            recorder.note(at, What::Hold(HoldEvent::Finding { text }));
        }
        for (at, locked) in locked {
            recorder.note(at, What::Hold(HoldEvent::Lock { locked }));
        }
        if dpr.board().hold_port.as_ref().is_some_and(|port| !port.chip().reports().is_empty()) {
            let reports = dpr.board_mut(|board| board.hold_port.as_mut().map(|port| port.with(Chip::take_reports)));
            for report in reports.into_iter().flatten() {
                let text = format!("the DPR's second front end: {report}");
                recorder.note(report.first_ns, What::Hold(HoldEvent::PortMisuse { text }));
            }
        }
        if self.payload_at <= reached {
            self.payload_at += PAYLOAD_EVERY;
            let now = self.node.now();
            let climate = |board: &mut Hold| (board.payload.climate.air(now), board.payload.climate.take_on(now));
            let (air, on) = self.node.board_mut(climate);
            let took = now - std::mem::replace(&mut self.payload_from, now);
            let [heater, cooler] = on.map(|on| (on * 10_000 / took.max(1)) as u16);
            let (temperature, humidity) = ((air.temperature * 1e3) as i32, (air.humidity * 1e3) as u32);
            let payload = &self.node.board().payload;
            let (heated, measured) = (payload.climate.heated(), payload.measured());
            let event = HoldEvent::Payload { heater, cooler, temperature, humidity, heated, measured };
            recorder.note(reached, What::Hold(event));
        }
        reached.min(self.reached)
    }

    /// The figures of the run so far.
    pub(super) fn figures(&self, user: &HoldUser) -> report::Hold {
        let (frames, answers) = (self.air.counters(), self.answers.counters());
        let [base_station, flight_controller] =
            user.fates().map(|Fates { sent, acknowledged, lost }| report::Commands { sent, acknowledged, lost });
        report::Hold {
            frames_sent: frames.sent,
            frames_delivered: frames.delivered,
            answers_sent: answers.sent,
            answers_delivered: answers.delivered,
            read: user.shown.0,
            vacant: user.shown.1,
            base_station,
            flight_controller,
            load: (self.node.usage().load() * 1e4).round() / 1e4,
        }
    }

    pub(super) fn take_log(&mut self) -> Vec<LogLine> {
        self.node.take_log()
    }
}

/// Passes `event` of the air to the DPR's second front end at `at` (ns).
fn hear(board: &mut Dpr, at: u64, event: &AirEvent) {
    if let Some(port) = &mut board.hold_port {
        port.hear(at, event);
    }
}

fn change_set_point(frame: &mut [u8]) {
    let Some(place) = frame.get_mut(1..1 + HoldStatus::SIZE) else { return };
    let Ok(mut values) = HoldStatus::verify(place).map(HoldStatus::values) else { return };
    values.set_point += 0.5;
    place.copy_from_slice(HoldStatus::seal(Writer::<ActiveLoad>::claim(), &values).as_bytes());
}
