//! Judges the active hold and the DPR's second port: the DPR must show what the hold sent, and the hold must do what
//! was commanded.
//!
//! | what is judged | compared with | violation |
//! |---|---|---|
//! | the hold's frames come every 100 ms | – | `HoldSilent`, `HoldEarly` |
//! | the object in the map | frames at the DPR's second antenna, of at most 300 ms ago | `HoldShown` |
//! | it is there | the last whole frame there | `HoldHidden` |
//! | an answer, its instant, its uplinks | that frame, and what was written within 1 s | `HoldAnswer` |
//! | there is an answer | a frame that was shown | `HoldUnanswered` |
//! | acknowledgements, set-point and lock in Hold-Status | commands that came | `HoldCommand` |
//! | a command is acknowledged | one that came three times, each later | `HoldIgnores` |
//! | heater, cooler, lock; temperature, humidity, supply | Hold-Status; the box | `HoldOutput` |
//! | restarts, findings | – | `HoldComplains` |
//!
//! The shown objects and the contents of answers are always judged. All other requirements do not hold for some time
//! after a disturbance ([`Calm`]).

use std::collections::VecDeque;

use profile::criticality::{BaseStation, FlightController};
use profile::hold::{Acknowledged, Answer, Outcome};
use profile::{HoldObject, HoldStatus, HoldValues, Layout, Uplink};

use super::{Rule, is_later, ms};
use crate::disturbance::Excuse;
use crate::read::is_vacant;
use crate::{Board, Calm, Cause, Context, Event, Findings, Header, HoldEvent, HoldFrame, Violation, What, bounds};

const MS: u64 = 1_000_000;

/// The longest time between two frames of the hold, ns: a period and a half.
pub const LONGEST_GAP: u64 = 150 * MS;
/// The shortest time between the beginnings of two frames of the hold, ns: its period, less 1 % for its clock.
pub const SHORTEST_GAP: u64 = 99 * MS;
/// The longest time from power-on to the first frame, ns.
pub const FIRST_FRAME: u64 = 300 * MS;
/// The longest time for which the DPR shows an object after its frame, ns: 300 ms, the time to the next publication,
/// and the expiry of the image.
pub const SHOWN_FOR: u64 = 300 * MS + bounds::FRAME_DEADLINE + bounds::PUBLICATION_PESSIMISTIC + bounds::EXPIRY;
/// The longest time from the end of a frame until its object is shown, ns: two publications.
pub const SHOWN_WITHIN: u64 = 26 * MS;
/// The shortest time for which an object is shown, if no newer one comes, ns.
pub const SHOWN_AT_LEAST: u64 = 280 * MS;
/// The earliest and the latest beginning of an answer after the end of the hold's frame, ns (docs/design.md#exchange;
/// guard time of NFC-F).
pub const ANSWERS: (u64, u64) = (197_000, 3_000_000);
/// The greatest age of an uplink in an answer, ns: 1 s, and the time until a stored uplink is handed over.
pub const UPLINK_AGE: u64 = 1_000 * MS + 110 * MS;
/// The set-points, °C, that the hold accepts; it refuses every other one.
pub const SET_POINTS: std::ops::RangeInclusive<f32> = 2.0..=40.0;
/// The shortest time, ns, after which the hold may reject a command with an unchanged timestamp: one second less an
/// exchange.
pub const TOO_OLD: u64 = 900 * MS;
/// The ages of a stored uplink, ns, at which an undisturbed DPR must send it in the answer.
pub const STORED: (u64, u64) = (30 * MS, 900 * MS);
/// The largest errors of temperature (°C), humidity (%) and supply (V) in Hold-Status: twice those of the sensor's data
/// sheet, and the change between two measurements.
pub const STATED: (f32, f32, f32) = (0.8, 5.0, 0.1);
/// The front end's report if it begins to answer after the hold's carrier has gone off.
const OVERTAKEN: &str = "transmission without a field";
/// The supply of the bench's hold, V.
const SUPPLY: f32 = 3.0;

/// A command as it came to the hold.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Came {
    at: u64,
    timestamp: u32,
    number: u16,
    word: u16,
    value: f32,
    is_plain: bool,
}

impl Came {
    fn of(uplink: &Uplink, at: u64) -> Option<Self> {
        let payload = uplink.values().payload;
        let [n0, n1, w0, w1, v0, v1, v2, v3, rest @ ..] = payload;
        let word = u16::from_le_bytes([w0, w1]);
        (word != 0).then(|| Self {
            at,
            timestamp: uplink.timestamp(),
            number: u16::from_le_bytes([n0, n1]),
            word,
            value: f32::from_le_bytes([v0, v1, v2, v3]),
            is_plain: rest.iter().take(4).all(|byte| *byte == 0),
        })
    }
}

fn is_newer(number: u16, than: u16) -> bool {
    (1..=u16::MAX / 2).contains(&number.wrapping_sub(than))
}

/// What came from one writer.
#[derive(Clone, Debug, Default)]
struct Writer {
    /// The commands that came in the last three seconds.
    came: VecDeque<Came>,
    /// The last new command, and how many uplinks with different timestamps have brought it.
    insists: Option<(Came, u32)>,
}

impl Writer {
    /// Returns the longest time, ns, for which this command came in uplinks with one and the same timestamp.
    fn heard_for(&self, number: u16) -> u64 {
        let of = self.came.iter().filter(|came| came.number == number);
        let since = |last: &Came| self.came.iter().find(|came| came.timestamp == last.timestamp).map(|came| came.at);
        of.filter_map(|last| Some(last.at - since(last)?)).max().unwrap_or(0)
    }
}

/// The rule; see the [module](self).
#[derive(Clone, Debug)]
pub struct Hold {
    layout: Option<Layout>,
    calm: Calm,
    /// The instant, ns, at which the hold last sent a whole Hold-Status, or at which it was switched on.
    sent: u64,
    has_sent: bool,
    /// The instant, ns, at which the frame of the last whole Hold-Status began.
    began: u64,
    /// The last three statuses in successive periods, the newest last.
    statuses: VecDeque<HoldValues>,
    /// The frames that came to the DPR.
    frames: VecDeque<Arrived>,
    /// The last frame that the DPR is known to have accepted since its start, because it answered or showed the frame:
    /// its instant (ns) and the timestamp of its object.
    accepted: Option<(u64, u32)>,
    /// The objects that the flight controller wrote in the last two seconds.
    written: VecDeque<Written>,
    writers: [Writer; 2],
    /// The last Hold-Status before a restart of the hold. The first Hold-Status after the restart must agree with it.
    kept: Option<HoldValues>,
    /// The instant, ns, of the last change of the lock's pin, and the level since then.
    lock: Option<(u64, bool)>,
}

#[derive(Clone, Debug)]
struct Written {
    /// The end of the transaction, ns.
    at: u64,
    object: Vec<u8>,
    /// The number of the writer, if the object is an intact uplink.
    writer: Option<usize>,
    /// Whether the DPR served the transaction.
    stored: bool,
}

#[derive(Clone, Debug)]
struct Arrived {
    at: u64,
    payload: Vec<u8>,
    is_new: bool,
    answered: bool,
    shown: bool,
}

impl Rule for Hold {
    fn new(header: &Header) -> Self {
        Self {
            layout: header.hold.then(|| header.layout()),
            calm: Calm::default(),
            sent: 0,
            has_sent: false,
            began: 0,
            statuses: VecDeque::new(),
            frames: VecDeque::new(),
            accepted: None,
            written: VecDeque::new(),
            writers: [Writer::default(), Writer::default()],
            kept: None,
            lock: None,
        }
    }

    fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
        if self.layout.is_none() {
            return;
        }
        let at = event.at;
        let before = self.calm;
        self.calm.take(event);
        match &event.what {
            What::Transaction { mosi, .. } => {
                self.read(context, findings);
                if let Some(object) = mosi.get(8..72) {
                    let of = [
                        Uplink::verify::<BaseStation>(object).is_ok(),
                        Uplink::verify::<FlightController>(object).is_ok(),
                    ];
                    let writer = of.iter().position(|is_of| *is_of);
                    let stored = context.reading().is_some_and(|reading| !reading.silent);
                    self.written.push_back(Written { at, object: object.to_vec(), writer, stored });
                }
                while self.written.front().is_some_and(|written| written.at + 2 * UPLINK_AGE < at) {
                    self.written.pop_front();
                }
            }
            What::Hold(HoldEvent::Reset { cause, asked: false }) if at >= before.sends() => {
                findings.add(Violation::HoldComplains, at, || format!("it restarted: {cause:?}"));
                self.restarted(at, true);
            }
            What::Hold(event) => self.hold(at, event, context, findings),
            // A DPR that starts accepts any object, also the one that it accepted last.
            What::Reset { board: Board::Dpr, .. } | What::Power { board: Board::Dpr, .. } => self.accepted = None,
            What::End => self.silent(at, findings),
            _ => {}
        }
    }
}

impl Hold {
    fn hold(&mut self, at: u64, event: &HoldEvent, context: &Context, findings: &mut Findings) {
        match event {
            HoldEvent::Power { .. } => self.restarted(at, false),
            HoldEvent::Reset { cause, .. } => self.restarted(at, *cause != Cause::PowerOn),
            HoldEvent::Finding { text } => findings.add(Violation::HoldComplains, at, || text.clone()),
            // The hold's carrier may go off just when an answer begins. The DPR cannot detect that in time.
            HoldEvent::PortMisuse { text } if at < self.calm.sends() && text.contains(OVERTAKEN) => {}
            // A DPR that hangs loads no more bytes of its answer.
            HoldEvent::PortMisuse { .. } if context.running(Board::Dpr).hung.is_some() => {}
            HoldEvent::PortMisuse { .. } if context.disturbances().excuse(Excuse::DprFrontEndUse, at) => {}
            HoldEvent::PortMisuse { text } => findings.add(Violation::FrontEndMisuse, at, || text.clone()),
            HoldEvent::Field { .. } => {}
            HoldEvent::Sent(frame) => self.sent(at, frame, findings),
            HoldEvent::Heard(frame) => self.heard(at, frame),
            HoldEvent::Answered(frame) => self.answered(frame, context, findings),
            HoldEvent::AnswerHeard(frame) => self.answer_heard(at, frame),
            HoldEvent::Lock { locked } => self.lock = Some((at, *locked)),
            HoldEvent::Payload { heater, cooler, temperature, humidity, .. } => {
                self.payload(at, [*heater, *cooler], (*temperature, *humidity), findings);
            }
        }
    }

    /// Takes a restart of the hold. The hold keeps lock, set-point and acknowledgements if its RAM `keeps` its
    /// contents.
    fn restarted(&mut self, at: u64, keeps: bool) {
        // A hold that sent nothing in its last period may have executed several commands.
        let was_heard = self.has_sent && at <= self.sent + LONGEST_GAP;
        self.kept = self.statuses.back().copied().filter(|_| keeps && was_heard);
        (self.sent, self.has_sent) = (at, false);
        self.statuses.clear();
        for writer in &mut self.writers {
            writer.insists = None;
            if !keeps {
                writer.came.clear();
            }
        }
    }

    fn silent(&mut self, at: u64, findings: &mut Findings) {
        let longest = if self.has_sent { LONGEST_GAP } else { FIRST_FRAME };
        if at > self.sent.max(self.calm.sends()) + longest {
            let since = self.sent;
            findings.add(Violation::HoldSilent, at, || format!("no Hold-Status since {}", ms(since)));
        }
    }

    fn sent(&mut self, at: u64, frame: &HoldFrame, findings: &mut Findings) {
        let Some(status) = payload(frame).and_then(|payload| HoldStatus::verify(payload).ok()) else { return };
        self.silent(at, findings);
        let is_first = !self.has_sent;
        let before = std::mem::replace(&mut self.began, frame.started);
        if !is_first && frame.started >= self.calm.sends() && frame.started < before + SHORTEST_GAP {
            findings.add(Violation::HoldEarly, at, || format!("{} after the last one", ms(frame.started - before)));
        }
        (self.sent, self.has_sent) = (at, true);
        let values = status.values();
        let before = self.statuses.back().copied().filter(|last| last.timestamp.wrapping_add(100) == values.timestamp);
        if before.is_none() {
            self.statuses.clear();
        }
        // Only the first Hold-Status after a restart must agree with the kept one. A later Hold-Status may already
        // follow a command.
        let kept = self.kept.take().filter(|_| is_first && values.timestamp == 0);
        if let Some(before) = before.or(kept) {
            self.commanded(at, &before, &values, findings);
        }
        for (index, acknowledged) in values.acknowledged.into_iter().enumerate() {
            let writer = &mut self.writers[index];
            let Some((came, times)) = writer.insists else { continue };
            if !is_newer(came.number, acknowledged.number()) {
                writer.insists = None;
            } else if times >= 3 && at >= self.calm.sends() {
                writer.insists = None;
                findings.add(Violation::HoldIgnores, at, || format!("{} came {times} times", told(index, &came)));
            }
        }
        if let (Some(before), Some((since, locked))) = (before, self.lock)
            && since + LONGEST_GAP < at
            && before.status.locked() == values.status.locked()
            && values.status.locked() != locked
        {
            findings.add(Violation::HoldOutput, at, || format!("its lock's pin says {locked}"));
        }
        self.statuses.push_back(values);
        if self.statuses.len() > 3 {
            self.statuses.pop_front();
        }
    }

    /// Compares two successive statuses with the commands that came between them.
    fn commanded(&self, at: u64, before: &HoldValues, now: &HoldValues, findings: &mut Findings) {
        let mut expected = (before.set_point, before.status.locked());
        for (index, (old, new)) in before.acknowledged.into_iter().zip(now.acknowledged).enumerate() {
            if old == new {
                continue;
            }
            let number = new.number();
            let last = self.writers[index].came.iter().rev().find(|came| came.number == number);
            let is_right = last.is_some_and(|came| {
                is_newer(number, old.number()) && is_outcome_of(came, new, self.writers[index].heard_for(number))
            });
            if !is_right {
                let words = last.map_or("no such command came".to_owned(), |came| told(index, came));
                findings.add(Violation::HoldCommand, at, || format!("it acknowledges {old:?}, then {new:?}: {words}"));
                return;
            }
            if let (Some(Outcome::Done), Some(came)) = (new.outcome(), last) {
                match came.word {
                    1 => expected.0 = came.value,
                    2 => expected.1 = true,
                    3 => expected.1 = false,
                    _ => {}
                }
            }
        }
        let (set_point, locked) = (now.set_point, now.status.locked());
        if (set_point.to_bits(), locked) != (expected.0.to_bits(), expected.1) {
            findings.add(Violation::HoldCommand, at, || {
                format!("set-point {set_point}, locked {locked}, which should be {expected:?}")
            });
        }
    }

    fn heard(&mut self, at: u64, frame: &HoldFrame) {
        // The object has a CRC of its own, so the DPR may take it from a frame whose length byte is damaged.
        let end = frame.bytes.len().saturating_sub(2);
        let payload = frame.bytes.get(1..end).filter(|_| frame.whole).unwrap_or_default().to_vec();
        let object = HoldObject::verify(&payload).ok().map(HoldObject::timestamp);
        let is_new = object.is_some() && object != self.accepted.map(|(_, timestamp)| timestamp);
        self.frames.push_back(Arrived { at, payload, is_new, answered: false, shown: false });
        while self.frames.front().is_some_and(|frame| frame.at + 2 * SHOWN_FOR < at) {
            self.frames.pop_front();
        }
    }

    /// Notes that the DPR, which has run since `since` (ns), accepted the frame with this number.
    fn accept(&mut self, index: usize, since: u64) {
        let Some(frame) = self.frames.get(index).filter(|frame| frame.at >= since) else { return };
        let Ok(object) = HoldObject::verify(&frame.payload) else { return };
        if self.accepted.is_none_or(|(at, _)| at <= frame.at) {
            self.accepted = Some((frame.at, object.timestamp()));
        }
    }

    /// Judges the hold's place in the map, where the last transaction has read it.
    fn read(&mut self, context: &Context, findings: &mut Findings) {
        let (Some(reading), Some(place)) = (context.reading(), self.layout.and_then(Layout::hold)) else { return };
        let from = place.start.checked_sub(reading.offset);
        let Some(shown) = from.and_then(|from| reading.miso.get(from..from + place.len())) else { return };
        let (at, dpr) = (reading.selected, context.running(Board::Dpr));
        // A start of the DPR cuts a transaction off, and discards what the DPR received before.
        let excused = [Excuse::Service, Excuse::UnsoundImage].iter().any(|it| context.disturbances().excuse(*it, at));
        if reading.silent || at < dpr.since || excused {
            return;
        }
        let came = |frame: &Arrived| (dpr.since..=at).contains(&frame.at);
        let found = self.frames.iter().rposition(|frame| frame.is_new && frame.payload == shown && came(frame));
        if !is_vacant(shown) && found.is_none_or(|index| self.frames[index].at + SHOWN_FOR < at) {
            let since = found.map_or("never came".to_owned(), |index| format!("came at {}", ms(self.frames[index].at)));
            findings.add(Violation::HoldShown, at, || format!("the object {since}"));
            return;
        }
        if let Some(index) = found {
            self.frames[index].shown = true;
            self.accept(index, dpr.since);
        }
        if !dpr.powered {
            return;
        }
        let calm = self.calm.exchanges();
        let due = |frame: &Arrived| {
            frame.is_new && frame.at >= calm && (SHOWN_WITHIN..SHOWN_AT_LEAST).contains(&at.saturating_sub(frame.at))
        };
        let newest = self.frames.iter().rposition(due);
        if newest.is_some_and(|newest| found.is_none_or(|found| found < newest)) {
            let came = newest.map_or(0, |newest| self.frames[newest].at);
            findings.add(Violation::HoldHidden, at, || format!("what came at {} is not shown", ms(came)));
        }
        let unanswered = self
            .frames
            .iter_mut()
            .find(|frame| frame.shown && !frame.answered && frame.at >= calm && frame.at + bounds::CYCLE < at);
        if let Some(frame) = unanswered {
            frame.answered = true;
            let came = frame.at;
            findings.add(Violation::HoldUnanswered, at, || format!("the frame of {}", ms(came)));
        }
    }

    fn answered(&mut self, answer: &HoldFrame, context: &Context, findings: &mut Findings) {
        let at = answer.started;
        let mut wrong = |words: String| findings.add(Violation::HoldAnswer, at, || words);
        let asks = |frame: &Arrived| {
            frame.is_new && !frame.answered && (ANSWERS.0..=ANSWERS.1).contains(&at.saturating_sub(frame.at))
        };
        let Some(index) = self.frames.iter().rposition(asks) else {
            let last = self.frames.back().map_or(0, |frame| frame.at);
            return wrong(format!("no new object of the hold waits for one; the last frame ended at {}", ms(last)));
        };
        self.frames[index].answered = true;
        self.accept(index, context.running(Board::Dpr).since);
        if !answer.whole || context.disturbances().excuse(Excuse::Service, at) {
            return;
        }
        let Some(answer) = payload(answer).and_then(|payload| Answer::read(payload).ok()) else {
            return wrong(format!("it has {} bytes", answer.bytes.len()));
        };
        let intact = [answer.uplink::<BaseStation>().is_ok(), answer.uplink::<FlightController>().is_ok()];
        let calm = self.calm.exchanges().max(context.running(Board::Dpr).since);
        let bytes = answer.as_bytes();
        for (index, place) in [0..64, 64..128].into_iter().enumerate() {
            let uplink = &bytes[place];
            let of_writer = self.written.iter().rev().filter(|written| written.writer == Some(index));
            let due = |written: &&Written| {
                at >= calm
                    && written.at >= calm
                    && written.stored
                    && (STORED.0..=STORED.1).contains(&at.saturating_sub(written.at))
            };
            let oldest = of_writer.clone().find(due).map_or(at.saturating_sub(UPLINK_AGE), |due| due.at);
            let is_right = if is_vacant(uplink) {
                of_writer.clone().find(due).is_none()
            } else {
                intact[index] && of_writer.clone().any(|written| written.object == uplink && written.at >= oldest)
            };
            if !is_right {
                let oldest = ms(oldest);
                return wrong(format!("its uplink {index} is not what its writer wrote at {oldest} or later"));
            }
        }
    }

    fn answer_heard(&mut self, at: u64, frame: &HoldFrame) {
        // Each uplink has a CRC of its own, so the hold may take one from an answer whose length byte is damaged.
        let bytes = frame.bytes.get(1..1 + Answer::SIZE).unwrap_or(&[]);
        let Ok(answer) = Answer::read(bytes) else { return };
        let uplinks = [answer.uplink::<BaseStation>(), answer.uplink::<FlightController>()];
        let is_whole = payload(frame).is_some();
        let acknowledged = self.statuses.back().map(|status| status.acknowledged);
        for (index, (writer, uplink)) in self.writers.iter_mut().zip(uplinks).enumerate() {
            let Some(came) = uplink.ok().and_then(|uplink| Came::of(uplink, at)) else { continue };
            writer.came.push_back(came);
            while writer.came.front().is_some_and(|old| old.at + 3_000 * MS < at) {
                writer.came.pop_front();
            }
            // An answer that the air delays may come while the hold does not listen.
            if at < self.calm.sends() {
                writer.insists = None;
                continue;
            }
            let Some(acknowledged) = acknowledged.map(|of_both: [Acknowledged; 2]| of_both[index]) else { continue };
            if is_whole && is_newer(came.number, acknowledged.number()) {
                writer.insists = match writer.insists {
                    Some((last, times)) if last.number == came.number => {
                        let later = is_later(came.timestamp, last.timestamp);
                        Some((came, times + u32::from(later)))
                    }
                    _ => Some((came, 1)),
                };
            }
        }
    }

    fn payload(&self, at: u64, on: [u16; 2], (temperature, humidity): (i32, u32), findings: &mut Findings) {
        // What a silent hold does is not known.
        if at < self.calm.measures() || self.statuses.len() < 3 || self.sent + LONGEST_GAP < at {
            return;
        }
        let outputs = self.statuses.iter().map(|status| status.output);
        let (least, most) = outputs.fold((f32::MAX, f32::MIN), |(least, most), it| (least.min(it), most.max(it)));
        for (on, least, most) in [(on[0], least, most), (on[1], -most, -least)] {
            let on = f32::from(on) / 10_000.0;
            if on < least.max(0.0) - 0.03 || on > most.max(0.0) + 0.03 {
                findings.add(Violation::HoldOutput, at, || format!("on for {on}, stated {least} to {most}"));
            }
        }
        let Some(last) = self.statuses.back().filter(|last| last.status.values_valid()) else { return };
        let stated = [
            (last.temperature - temperature as f32 / 1e3, STATED.0),
            (last.humidity - humidity as f32 / 1e3, STATED.1),
            (last.supply - SUPPLY, STATED.2),
        ];
        if stated.iter().any(|(off, most)| off.abs() > *most) {
            findings.add(Violation::HoldOutput, at, || format!("{last:?}, in truth {temperature} m°C, {humidity}"));
        }
    }
}

/// The payload of a whole frame.
fn payload(frame: &HoldFrame) -> Option<&[u8]> {
    let len = usize::from(*frame.bytes.first()?);
    frame.bytes.get(1..len).filter(|_| frame.whole && frame.bytes.len() == len + 2)
}

fn is_outcome_of(came: &Came, acknowledged: Acknowledged, heard_for: u64) -> bool {
    let known = came.is_plain && (1..=4).contains(&came.word);
    let refused = came.word == 1 && !SET_POINTS.contains(&came.value);
    match acknowledged.outcome() {
        Some(Outcome::Done) => known && !refused,
        Some(Outcome::Refused) => known && refused,
        Some(Outcome::Unknown) => !known,
        Some(Outcome::TooOld) => heard_for >= TOO_OLD,
        Some(Outcome::Nothing) | None => false,
    }
}

fn told(index: usize, came: &Came) -> String {
    let writer = ["the base station", "the flight controller"][index.min(1)];
    let Came { number, word, value, .. } = came;
    format!("command {number} of {writer}, word {word}, value {value}")
}

#[cfg(test)]
mod tests;
