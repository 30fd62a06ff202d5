//! Judges which objects transactions read as valid: is one missing, out of sequence or too old?
//!
//! An object or a cycle is *shown* if a transaction reads it as valid. The references are what HORUS put on the air
//! ([`crate::truth`]), and how much of it reached the DPR's antenna ([`crate::expectation`]).
//!
//! # Which violation is which
//!
//! An object that was read as valid is judged by the first of these rows that applies:
//!
//! | the object | violation |
//! |---|---|
//! | HORUS never sent these bytes as this object | `ShownNeverSent` |
//! | no frame that may be shown brought it: it was out of sequence, or not at the antenna | `ShownOutOfSequence` |
//! | its image has expired | `ShownExpired` |
//! | the deadline after the last frame has passed | `ShownStale` |
//! | HORUS sent it before another object of its kind that was already shown | `Regression` |
//!
//! Stale data that stay in the image expire later. Data that are both stale and expired are reported only as expired.
//!
//! `NotShown` means that no transaction shows a cycle that must be shown. `Vacant` means that an object is missing
//! although other objects of its cycle are shown.
//!
//! If an object's bytes are reported as a violation of the table or, by rule `ssi`, as damage, neither `NotShown` nor
//! `Vacant` is reported for the object. Rule `ssi` also judges whether a transaction may read 0xFF throughout.
//!
//! # A DPR that hangs
//!
//! While the bench has stopped the DPR's core, until the DPR's next start, nothing new must be shown. Data whose
//! deadline had not passed when the core stopped may stay until their image expires: hardware withdraws an expired
//! image without the processor. A DPR with a dead task is judged in the same way, but may show what it receives.
//!
//! # Limits
//!
//! - After a received frame that brought nothing to show, the previous image may stay. It is reported only after its
//!   deadline, or after 25 ms.
//! - A transaction longer than a second is not judged, because the frames that it may have read are no longer kept.
//! - While [`Excuse::Hearing`] holds, a cycle that reached the antenna may be shown but need not be. When an
//!   [`Excuse::Withdrawal`] begins, a cycle need not be shown any more, unless a transaction has already failed to show
//!   it.

mod recovery;
#[cfg(test)]
pub(crate) mod synthetic;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use profile::Layout;
use recovery::Recovery;

use super::{Rule, ms};
use crate::disturbance::Excuse;
use crate::expectation::{Certainty, Delivery};
use crate::read::{Placed, Reading, State, Values};
use crate::truth::KEPT;
use crate::{Board, Context, Event, Figures, Findings, Header, Violation, What, bounds};

/// The greatest number of cycles that are kept for a transaction that has not ended.
const WAITING: usize = 16;

#[derive(Clone, Debug)]
struct Due {
    frame: Delivery,
    timestamp: u32,
    /// The objects of the cycle that must be shown; bit n is object n.
    objects: u8,
    /// The instant, ns, from which on each transaction has to show the cycle.
    from: u64,
    /// The instant, ns, until which each transaction has to show the cycle.
    until: u64,
    /// The beginning, ns, of the first transaction that had to show the cycle but did not.
    asked: Option<u64>,
    /// Whether a transaction showed the cycle, or another violation was reported in its place.
    answered: bool,
}

/// An object as it was last shown.
#[derive(Clone, Debug)]
struct LastShown {
    bytes: Vec<u8>,
    /// The instant, ns, at which the object's image expired.
    expired: u64,
}

/// Data that were shown after their deadline but before they expired.
#[derive(Clone, Debug)]
struct Stale {
    at: u64,
    words: String,
    serial: u64,
}

/// The rule that judges which objects are shown; see the [module](self).
#[derive(Clone, Debug)]
pub struct Shown {
    layout: Layout,
    publication: u64,
    recovery: Recovery,
    deliveries: VecDeque<Delivery>,
    due: VecDeque<Due>,
    known: Vec<Option<LastShown>>,
    /// For each object, the serial number of the latest frame from which the object was shown.
    youngest: Vec<u64>,
    stale: Option<Stale>,
    selected: Option<u64>,
    invalid_shown_valid: u64,
    valid_cycle: Option<u32>,
    valid_cycles: u64,
    invalid_since: Option<u64>,
}

enum Fate {
    Right {
        /// The serial number of the object's frame.
        serial: u64,
        /// The instant, ns, at which the frame's first preamble bit began.
        started: u64,
    },
    /// The object must not be shown. The fields are the violation, the serial number of the object's frame, and words.
    Wrong(Violation, u64, String),
}

impl Rule for Shown {
    fn new(header: &Header) -> Self {
        let layout = Layout::for_receivers(header.gps).expect("a profile has 1, 2, 3 or 5 receivers");
        Self {
            layout,
            publication: publication(header.worst_case()),
            recovery: Recovery::default(),
            deliveries: VecDeque::new(),
            due: VecDeque::new(),
            known: vec![None; layout.objects()],
            youngest: vec![0; layout.objects()],
            stale: None,
            selected: None,
            invalid_shown_valid: 0,
            valid_cycle: None,
            valid_cycles: 0,
            invalid_since: None,
        }
    }

    fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
        self.recovery.take(event, findings);
        match &event.what {
            What::Selected => self.selected = Some(event.at),
            What::Power { board: Board::Dpr, .. } | What::Reset { board: Board::Dpr, .. } => {
                self.close(event.at, true, findings);
                self.due.clear();
                self.deliveries.clear();
                self.known.fill(None);
            }
            // A cycle whose frame did not have to be readable before the hang need not become readable.
            What::Hung { board: Board::Dpr } => {
                self.due.retain(|due| due.from <= event.at);
                let publication = bounds::LAST_BIT_TO_READABLE.max(self.publication);
                for delivery in &mut self.deliveries {
                    let awaits = awaits_second(self.layout, delivery);
                    if delivery.ended + awaits + publication > event.at {
                        delivery.received = delivery.received.min(Certainty::May);
                    }
                }
            }
            // The DPR may withdraw the image with the disturbed bit before a transaction reads it.
            What::Injected { disturbs, .. } if disturbs.may_take(Excuse::Withdrawal) => {
                self.due.retain(|due| due.asked.is_some());
            }
            // A failing front end loses each frame that the DPR has not read completely.
            What::Injected { disturbs, .. } if disturbs.may_take(Excuse::Hearing) => {
                self.due.retain(|due| due.frame.ended + bounds::STORE_AND_FORWARD <= event.at);
            }
            What::Transaction { .. } => {
                if let Some(reading) = context.reading() {
                    self.read(reading, context, findings);
                }
                self.selected = None;
            }
            _ => {}
        }
        if let Some(delivery) = context.delivery() {
            self.deliver(delivery.clone());
        }
        self.close(event.at, false, findings);
    }

    fn finish(&mut self, context: &Context, findings: &mut Findings, figures: &mut Figures) {
        self.close(context.now(), false, findings);
        self.note_stale(context.now(), None, findings);
        figures.valid_cycles = self.valid_cycles;
        figures.invalid_since_ns = self.invalid_since;
        figures.faults.invalid_shown_valid = self.invalid_shown_valid;
        let longest = self.recovery.finish(context.now(), findings);
        figures.faults.max_recovery_cycles = longest.all;
        figures.faults.max_recovery_cycles_without_bring_up = longest.without_bring_up;
    }
}

impl Shown {
    fn deliver(&mut self, delivery: Delivery) {
        let ended = delivery.ended;
        let kept = |old: &Delivery| ended - old.ended <= KEPT;
        while self.deliveries.front().is_some_and(|old| !kept(old)) {
            self.deliveries.pop_front();
        }
        let objects = delivery.objects.iter().filter(|(.., fate)| *fate == Certainty::Must);
        let mut objects = objects.fold(0, |mask, (index, ..)| mask | 1 << index);
        let mut timestamp = delivery.timestamp;
        if let Some(before) = self.due.back_mut() {
            // Each frame may make the DPR publish a new image, which replaces the one before.
            before.until = before.until.min(ended);
            if delivery.received == Certainty::Must && delivery.completes(&before.frame) {
                objects |= before.objects;
                timestamp = Some(before.timestamp);
                self.due.pop_back();
            }
        }
        if let (Some(timestamp), true) = (timestamp, objects != 0) {
            let from = ended + awaits_second(self.layout, &delivery) + bounds::LAST_BIT_TO_READABLE;
            let until = ended + bounds::FRAME_DEADLINE - bounds::SEQUENCE_BAND;
            let frame = delivery.clone();
            self.due.push_back(Due { frame, timestamp, objects, from, until, asked: None, answered: false });
        }
        self.deliveries.push_back(delivery);
    }

    /// Judges each cycle that no transaction after `now` has to show. With `all`, every cycle is judged.
    fn close(&mut self, now: u64, all: bool, findings: &mut Findings) {
        // A transaction that has not ended may still show the cycle.
        let open = |due: &Due, selected: Option<u64>| selected.is_some_and(|selected| selected < due.until);
        while let Some(due) = self.due.front() {
            let over = now > due.until && !open(due, self.selected);
            if !over && !all && self.due.len() <= WAITING {
                return;
            }
            if let (Some(asked), false) = (due.asked, due.answered) {
                let (timestamp, ended) = (due.timestamp, due.frame.ended);
                findings.add(Violation::NotShown, asked, || {
                    format!("{timestamp} ms, whose last bit was at the antenna at {}", ms(ended))
                });
            }
            self.due.pop_front();
        }
    }

    fn read(&mut self, reading: &Reading, context: &Context, findings: &mut Findings) {
        let dpr = context.running(Board::Dpr);
        let forgotten = reading.deselected - reading.selected > KEPT / 2;
        if reading.silent || forgotten || !dpr.powered || reading.selected < dpr.since {
            return;
        }
        self.position(reading);
        let mut wrong: Vec<(Violation, String)> = vec![];
        let mut was_stale = None;
        for placed in reading.objects.iter().filter(|placed| placed.timestamp().is_some()) {
            match self.judge(placed, reading.selected, context) {
                Fate::Right { serial, started } => {
                    self.youngest[placed.index] = serial;
                    self.recovery.shown(started, reading.selected);
                }
                Fate::Wrong(Violation::ShownStale, serial, words) => {
                    self.invalid_shown_valid += 1;
                    was_stale.get_or_insert((serial, words));
                }
                Fate::Wrong(violation, serial, words) => {
                    self.invalid_shown_valid += u64::from(violation != Violation::Regression);
                    if violation == Violation::ShownExpired {
                        self.stale = self.stale.take().filter(|stale| stale.serial != serial);
                    }
                    if wrong.iter().all(|(other, _)| *other != violation) {
                        wrong.push((violation, words));
                    }
                }
            }
        }
        self.note_stale(reading.selected, was_stale.clone(), findings);
        let damaged = matches!(reading.link, Some(Err(_)));
        let answered = was_stale.is_some() || !wrong.is_empty() || damaged;
        for (violation, words) in wrong {
            findings.add(violation, reading.selected, || words);
        }
        self.ask(reading, answered, findings);
    }

    /// Reports stale data that are no longer shown, unless they expired before. `now` has the stale data that are shown
    /// at present.
    fn note_stale(&mut self, at: u64, now: Option<(u64, String)>, findings: &mut Findings) {
        let serial = now.as_ref().map(|(serial, _)| *serial);
        if let Some(gone) = self.stale.take_if(|stale| serial != Some(stale.serial)) {
            findings.add(Violation::ShownStale, gone.at, || gone.words);
        }
        if let (None, Some((serial, words))) = (&self.stale, now) {
            self.stale = Some(Stale { at, words, serial });
        }
    }

    /// Judges whether a transaction that began at `selected` may show this valid object.
    fn judge(&mut self, placed: &Placed, selected: u64, context: &Context) -> Fate {
        let dpr = context.running(Board::Dpr);
        let hung = dpr.hung.or(dpr.dead);
        let index = placed.index;
        let what = || format!("object {index} of {} ms, read at {}", placed.timestamp().unwrap_or(0), ms(selected));
        let sent = context.truth().find(index, &placed.bytes, selected);
        let Some((serial, started)) = sent.map(|sent| (sent.serial, sent.started)) else {
            return Fate::Wrong(Violation::ShownNeverSent, 0, what());
        };
        let Some(expired) = self.expires(placed, selected) else {
            return Fate::Wrong(Violation::ShownOutOfSequence, serial, what());
        };
        self.known[index] = Some(LastShown { bytes: placed.bytes.clone(), expired });
        if selected > expired {
            return Fate::Wrong(Violation::ShownExpired, serial, what());
        }
        let last = self.deliveries.iter().rev().find(|delivery| delivery.ended <= selected);
        let deadline = last.map(|last| last.ended + bounds::FRAME_DEADLINE + self.publication);
        let is_past = |at: u64| deadline.is_none_or(|deadline| at > deadline);
        if is_past(selected) && hung.is_none_or(is_past) {
            return Fate::Wrong(Violation::ShownStale, serial, what());
        }
        if serial < self.youngest[index] {
            return Fate::Wrong(Violation::Regression, serial, what());
        }
        Fate::Right { serial, started }
    }

    /// Returns the instant, ns, at which the object's image expires, for a transaction that began at `selected`.
    fn expires(&self, placed: &Placed, selected: u64) -> Option<u64> {
        let mut found = false;
        for delivery in self.deliveries.iter().rev().filter(|delivery| delivery.ended <= selected) {
            let same = |(index, bytes, _): &&(usize, Vec<u8>, _)| *index == placed.index && *bytes == placed.bytes;
            let Some((.., fate)) = delivery.objects.iter().find(same) else { continue };
            found = true;
            let readable = delivery.ended
                + awaits_second(self.layout, delivery)
                + bounds::LAST_BIT_TO_READABLE.max(self.publication);
            if *fate > Certainty::Never {
                return Some(readable + bounds::EXPIRY);
            }
            // A later frame brought the object again, and its image has replaced the earlier one.
            if delivery.received == Certainty::Must && selected > readable {
                return None;
            }
        }
        // A transaction showed this object rightly before. The image still has it, although the record of frames has
        // dropped its frame.
        let known = self.known[placed.index].as_ref().filter(|known| !found && known.bytes == placed.bytes);
        known.map(|known| known.expired)
    }

    /// Judges whether a transaction shows the cycles that it must show. `answered` means that another violation
    /// explains what it reads.
    fn ask(&mut self, reading: &Reading, answered: bool, findings: &mut Findings) {
        let selected = reading.selected;
        for due in &mut self.due {
            let of_cycle = |placed: &&Placed| placed.timestamp() == Some(due.timestamp);
            let shows = reading.objects.iter().any(|placed| of_cycle(&placed));
            due.answered |= shows;
            if selected < due.from || selected >= due.until {
                continue;
            }
            due.answered |= answered;
            let wanted = |placed: &&Placed| due.objects >> placed.index & 1 == 1;
            for placed in reading.objects.iter().filter(wanted) {
                match placed.state {
                    State::Unsound(_) => due.answered = true,
                    State::Vacant if shows => {
                        findings.add(Violation::Vacant, selected, || {
                            format!("object {} of {} ms, read at {}", placed.index, due.timestamp, ms(selected))
                        });
                        break;
                    }
                    _ => {}
                }
            }
            if !shows && reading.objects.iter().any(|placed| wanted(&placed)) {
                due.asked.get_or_insert(selected);
            }
        }
    }

    fn position(&mut self, reading: &Reading) {
        let Some(reported) = reading.objects.iter().find(|placed| placed.index == 0) else { return };
        match &reported.state {
            State::Valid { timestamp, values: Values::Reported(values) } if values.status.position_valid() => {
                self.valid_cycles += u64::from(self.valid_cycle.replace(*timestamp) != Some(*timestamp));
                self.invalid_since = None;
            }
            _ if self.valid_cycle.is_some() => {
                self.invalid_since.get_or_insert(reading.selected);
            }
            _ => {}
        }
    }
}

/// Returns how long, ns, the DPR waits after this frame for the second frame of the cycle.
fn awaits_second(layout: Layout, frame: &Delivery) -> u64 {
    if frame.number + 1 < layout.frames() { bounds::SECOND_FRAME } else { 0 }
}

/// Returns the longest time, ns, from the frame or deadline that causes an image until the image can be read.
#[must_use]
pub fn publication(worst_case: bool) -> u64 {
    if worst_case { bounds::PUBLICATION_PESSIMISTIC } else { bounds::PUBLICATION }
}
