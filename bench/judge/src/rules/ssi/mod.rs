//! Judges the transactions on the SSI, when the DPR is ready for them, what FRESH announces, and torn or damaged bytes.
//!
//! | file | what it judges |
//! |---|---|
//! | `service` | whether transactions are made, and whether the DPR serves them in time |
//! | `fresh` | whether each rise of FRESH is justified, and whether each image that is read was announced |
//! | `damage` | what is wrong with the bytes of an object that are neither intact nor empty |
//! | `latency` | how soon after its tick and its last bit a cycle is readable |
//!
//! # One cause, one violation
//!
//! - A DPR that has no supply or is starting need not do anything. A transaction that began before the DPR's last start
//!   is not judged.
//! - A DPR that the bench has stopped, or one with a dead task, need not serve anything until its next start. Service
//!   that was overdue before is reported, and the bytes that are read still have to be right.
//! - If the processor keeps the SSI's buffers too long after a transaction, this is [`Violation::NotReady`]; at any
//!   other time it is [`Violation::HeldBack`]. Transactions that find the DPR busy meanwhile are not reported. If
//!   nothing is readable for longer than [`bounds::EXPIRY`], only [`Violation::Silent`] is reported.
//! - A single transaction may read 0xFF throughout if the DPR is busy. The DPR is busy while it puts an image in, which
//!   FRESH announces within [`bounds::SSI_READY`]; just after another transaction; when the image's time is over; or
//!   when it has used its budget of transactions between two images. Any other such transaction is
//!   [`Violation::Unserved`].
//! - An unsound image is [`Violation::FreshUnreadable`] if FRESH announced it. Otherwise the transaction that read the
//!   image is judged as torn, misplaced or damaged, in this order.
//! - While [`Excuse::Service`] holds, the DPR need not serve the flight controller, and damaged bytes are not judged.
//!   The objects that are read as valid still have to be right ([`super::shown`]). The flight controller's misuse does
//!   not excuse a late image.
//! - After a transaction, the DPR pauses for [`SSI_PAUSE`](crate::bounds::SSI_PAUSE) once it is ready again. If the
//!   next transaction ends within this pause, the time until the DPR must be ready counts from the end of the pause.
//! - Bytes that are unsound while [`Excuse::UnsoundImage`] holds only have to be rejected, which [`super::shown`]
//!   judges. The DPR may replace such an image by one with the same content.
//! - A transaction that reads an older image than the announced one is [`Violation::FreshNotNew`]. If its objects are
//!   older than objects read before, another rule reports [`Violation::Regression`] instead.
//! - A frame that began while [`Excuse::Latency`] holds may become readable at any time. A frame that began while
//!   [`Excuse::Length`] holds has as much time as a frame with a damaged LEN. The time of a repeated frame counts from
//!   its last arrival, if it began while [`Excuse::Hearing`] holds.
//! - A cycle that is readable too late after its last bit is not reported again as too late after its tick. A cycle
//!   that is read before FRESH has risen for it is [`Violation::FreshMissing`] or [`Violation::LateReadable`],
//!   whichever is found first.

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

/// The rule that judges the SSI and FRESH; see the [module](self).
#[derive(Clone, Debug)]
pub struct Ssi {
    service: Service,
    claims: Claims,
    damage: Damage,
    cycles: Cycles,
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
    /// Processes an event that comes while the DPR has a supply.
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
                // After a disturbance of the announced image's bits, the judge does not know which image FRESH
                // announced.
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

    /// Judges how long FRESH was high or low before it changed.
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
