//! Transactions, readiness, FRESH, and what is torn or damaged.
//!
//! | file | asks |
//! |---|---|
//! | `service` | whether transactions are made, and whether the DPR serves them in time |
//! | `fresh` | whether each rise of FRESH is borne out, and whether each image that is read was announced |
//! | `damage` | what a place holds that is neither an intact object nor vacant |
//! | `latency` | how soon after its tick and its last bit a cycle is readable |
//!
//! # One cause, one violation
//!
//! - A DPR without supply, or in its start-up time, is asked for nothing. A transaction that began before the DPR's
//!   last start is not judged.
//! - A DPR that the bench has hang owes nothing from then on until its next start: what ends, becomes due or is asked
//!   for while it hangs it cannot serve. What had waited too long by then is told, and what is read meanwhile has to be
//!   right as ever. A DPR with a dead task owes nothing either: any of its tasks may be one that gets the SSI ready.
//! - The time for which the processor keeps the SSI's buffers is [`Violation::NotReady`] if the end of a transaction
//!   gave them to it, and [`Violation::HeldBack`] otherwise. Transactions that meet the DPR busy because of it are not
//!   counted again, unless nothing is readable for longer than [`bounds::EXPIRY`]: then it is
//!   [`Violation::Silent`] alone.
//! - A single transaction that reads 0xFF throughout may be one that met the DPR busy: as it put an image in, which
//!   FRESH tells within [`bounds::SSI_READY`], so soon after another one, with the image's time over, or with the
//!   transactions spent that it grants between two images. Any other is [`Violation::Unserved`].
//! - An unsound image is [`Violation::FreshUnreadable`] if FRESH announced these bytes; if it became unsound later, or
//!   FRESH rose while nothing could be read yet, it is what the transaction found: torn, misplaced, or damaged, in this
//!   order, and one of them for each transaction.
//! - While [`Excuse::Service`] holds the flight controller is owed no service, and what it reads by the wrong clocks is
//!   not looked at here: what it reads as valid still has to be, which is the rule of [`super::shown`]. No image may be
//!   later for it.
//! - A transaction that ends within [`SSI_PAUSE`](crate::bounds::SSI_PAUSE) after the DPR was ready again after the one
//!   before is owed service from the end of that time on.
//! - What is unsound while [`Excuse::UnsoundImage`] holds is not looked at here: a check that finds it is all that is
//!   asked. That it is not valid is for [`super::shown`] to ask. Nor is it held against the DPR that it replaces such
//!   an image by one that tells the same.
//! - A transaction that brings an older image than the one announced is [`Violation::FreshNotNew`], but for one whose
//!   objects are older than what was read before: that is [`Violation::Regression`], of another rule.
//! - How soon a frame is readable that began while [`Excuse::Latency`] holds is not asked. One that began while
//!   [`Excuse::Length`] holds has the time of one whose LEN was damaged on the air. Of one that began while
//!   [`Excuse::Hearing`] holds and came again it is asked from the last time it came: the DPR may have missed the
//!   first.
//! - A cycle that is readable too late after its last bit is not also a sample that is readable too late. One that is
//!   read before FRESH has risen for it is [`Violation::FreshMissing`] or [`Violation::LateReadable`], whichever is
//!   seen first.

mod damage;
mod fresh;
mod latency;
mod service;

use super::Rule;
use crate::disturbance::Excuse;
use crate::read::Reading;
use crate::{Board, Context, Disturbance, Event, Figures, Findings, Header, SsiEvent, Violation, What, bounds};
use damage::Damage;
use fresh::Claims;
use latency::Cycles;
use service::Service;

/// See the [module](self).
#[derive(Clone, Debug)]
pub struct Ssi {
    service: Service,
    claims: Claims,
    damage: Damage,
    cycles: Cycles,
    /// Since when FRESH is high, ns.
    high_since: Option<u64>,
}

impl Rule for Ssi {
    fn new(_header: &Header) -> Self {
        Self {
            service: Service::new(),
            claims: Claims::default(),
            damage: Damage::default(),
            cycles: Cycles::default(),
            high_since: None,
        }
    }

    fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
        let at = event.at;
        let disturbances = context.disturbances();
        self.service.pass(at, disturbances, findings);
        let dpr = context.running(Board::Dpr);
        match &event.what {
            What::Hung { board: Board::Dpr } if dpr.hung == Some(at) => self.service.hang(at, findings),
            What::Injected { disturbs: Disturbance::DeadTask { board: Board::Dpr, .. }, .. }
                if dpr.dead == Some(at) =>
            {
                self.service.hang(at, findings);
            }
            _ => {}
        }
        if disturbances.excuse(Excuse::Service, at) {
            self.service.misused();
        }
        match &event.what {
            What::Power { board: Board::Dpr, on } => {
                self.restart();
                self.service.power(at, *on);
            }
            What::Reset { board: Board::Dpr, .. } => {
                self.restart();
                self.service.reset(at);
            }
            What::Injected { disturbs, .. } if disturbs.may_take(Excuse::Latency) => self.cycles.front_end_fails(at),
            What::Answer => findings.add(Violation::Answered, at, || "the DPR's front end sent".into()),
            What::Tick => self.cycles.tick(at),
            What::Sent { started, .. } => {
                if let Some(frame) = context.frame() {
                    self.cycles.sent(context.layout(), frame, *started);
                }
            }
            What::Heard { started, whole: true, bytes } if !disturbances.excuse(Excuse::Latency, *started) => {
                if let Some(frame) = context.frame() {
                    let may_be_missed = disturbances.excuse(Excuse::Hearing, *started);
                    let len = bytes.first().copied().filter(|_| !disturbances.excuse(Excuse::Length, *started));
                    self.cycles.heard(context.layout(), frame, len, (*started, at), may_be_missed);
                }
            }
            _ if context.running(Board::Dpr).powered => self.take_ssi(event, context, findings),
            _ => {}
        }
    }

    fn finish(&mut self, context: &Context, findings: &mut Findings, figures: &mut Figures) {
        self.service.finish(context.now(), context.disturbances(), findings);
        figures.ready_ns = self.service.figure();
        figures.sample_to_readable = self.cycles.sample_to_readable();
        figures.last_bit_to_readable = self.cycles.last_bit_to_readable();
    }
}

impl Ssi {
    /// Takes an event of the SSI of a DPR that has a supply.
    fn take_ssi(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
        let at = event.at;
        let unsound = |at| context.disturbances().excuse(Excuse::UnsoundImage, at);
        match &event.what {
            What::Fresh { high, offered } => {
                self.pulse(at, *high, findings);
                let offered = offered.as_ref().map(|bytes| {
                    let offset = context.window().offset();
                    Reading::of(context.layout(), at, at, offset, bytes)
                });
                // Of an image of which a bit was hit it cannot be told which it is.
                let hit = offered.as_ref().is_some_and(|offered| unsound(at) && !offered.is_sound());
                if *high {
                    let excused = self.service.rise(at, offered.is_some()) || hit;
                    let known = offered.as_ref().filter(|_| !hit);
                    self.claims.rise(at, known, excused, &mut self.cycles, context.disturbances(), findings);
                } else if !hit {
                    self.claims.fall(offered.as_ref(), &mut self.cycles, context.disturbances(), findings);
                }
            }
            What::Ssi(SsiEvent::Held) => self.service.held(at),
            What::Ssi(SsiEvent::Released) => self.service.released(at, findings),
            What::Ssi(SsiEvent::Ready) => self.service.ready(at, findings),
            What::Ssi(SsiEvent::Busy) => self.service.busy(),
            What::Selected => self.service.selected(at),
            What::Transaction { .. } => {
                if let Some(reading) = context.reading() {
                    self.transaction(reading, context, findings);
                }
            }
            _ => {}
        }
    }

    /// FRESH rises or falls.
    fn pulse(&mut self, at: u64, high: bool, findings: &mut Findings) {
        if let Some(since) = self.high_since.take().filter(|since| !high && at < since + bounds::FRESH_WIDTH) {
            findings.add(Violation::FreshShort, since, || format!("{} ns", at - since));
        }
        self.high_since = high.then_some(at);
    }

    fn transaction(&mut self, reading: &Reading, context: &Context, findings: &mut Findings) {
        let whole = reading.selected >= context.running(Board::Dpr).since;
        self.service.transaction(reading, whole, findings);
        // A transaction that began before the DPR's last start is not judged.
        let disturbances = context.disturbances();
        if !whole || disturbances.excuse(Excuse::Service, reading.selected) {
            return;
        }
        if disturbances.excuse(Excuse::UnsoundImage, reading.selected) && !reading.is_sound() {
            return;
        }
        if self.claims.has_condemned(&reading.miso) {
            return;
        }
        let spliced = self.claims.is_spliced(reading);
        if !self.damage.find(reading, spliced, &self.cycles, context.layout(), findings) {
            self.claims.transaction(reading, &mut self.cycles, context.disturbances(), findings);
        }
        self.damage.remember(reading);
    }

    fn restart(&mut self) {
        self.claims = Claims::default();
        self.damage = Damage::default();
        self.high_since = None;
    }
}
