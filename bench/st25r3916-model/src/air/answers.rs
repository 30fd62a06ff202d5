//! The path of answers from a listener to its poller.
//!
//! | covered | source |
//! |---|---|
//! | answers by event, on the poller's carrier; an answer breaks off when the carrier goes off | load modulation |
//! | seeded faults of answers, as of the poller's frames: lost, late, damaged, cut, repeated | [`AirFaults`] |
//! | a foreign card that answers the poller's frames, and its collisions with the listener's answers | see below |
//!
//! | left out | why |
//! |---|---|
//! | strength of the modulation, coupling, noise | the air is digital |
//! | the signal of two answers that collide | no receiver can decode it; both answers are lost or break off |
//!
//! An [`Air`] of its own, in which the listener is the sender, carries the answers. The owner of an [`AnswerPath`]
//! passes to it what either chip emits. A link without answers needs no [`AnswerPath`].
//!
//! # A foreign card
//!
//! A foreign card answers a frame of the poller with a whole NFC-F frame of random bytes. If two answers collide, the
//! earlier one breaks off, and the later one is lost because its sync is masked.

use super::faults::within;
use super::{Air, AirFaults, Counters, Heard, SentFrame};
use crate::Chip;
use crate::clock::{Clock, bits_ns};
use crate::crc;
use crate::event::{AirEvent, Chunk, FrameStart, Technology};
use crate::rng::SplitMix;

/// A card in the poller's field that does not belong to the link.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ForeignCard {
    /// Probability that the foreign card answers a frame of the poller.
    pub answers: f64,
    /// The shortest and longest time from the end of the poller's frame to the first bit of the card's answer, ns.
    pub after_ns: (u64, u64),
    /// The number of payload bytes in the card's answer, at most 254.
    pub payload: u8,
}

/// The faults of a link's answers. The default has no faults.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AnswerFaults {
    /// The faults of all answers, including those of a foreign card. [`AirFaults::field_off`] suppresses all answers.
    pub way: AirFaults,
    /// A foreign card in the poller's field.
    pub foreign: ForeignCard,
}

/// The path of the answers from one listener to its poller.
#[derive(Clone, Debug)]
pub struct AnswerPath {
    air: Air,
    foreign: ForeignCard,
    rng: SplitMix,
    due: Option<u64>,
    /// The foreign card's present answer: its end, ns, and its number of data bits.
    foreign_ends: Option<(u64, u32)>,
    /// Whether the listener's present answer is on the air, or was lost in a collision (`false`); `None` without an
    /// answer.
    answering: Option<bool>,
    collisions: u64,
    foreign_answers: u64,
}

/// Returns a function that passes only frames to `hears`, because the carrier is the poller's own.
fn frames(hears: &mut dyn FnMut(u64, &AirEvent)) -> impl FnMut(u64, &AirEvent) {
    |at, event| {
        if !matches!(event, AirEvent::FieldOn | AirEvent::FieldOff) {
            hears(at, event);
        }
    }
}

impl AnswerPath {
    /// Returns a path with `faults` from time 0 on; `seed` determines all random values.
    pub fn new(seed: u64, faults: AnswerFaults) -> Self {
        Self {
            air: Air::new(seed, faults.way),
            foreign: faults.foreign,
            rng: SplitMix::new(seed.wrapping_add(1)),
            due: None,
            foreign_ends: None,
            answering: None,
            collisions: 0,
            foreign_answers: 0,
        }
    }

    /// Changes the faults from `at` (virtual ns) on. What the poller receives until then is passed to `hears`.
    pub fn set_faults(&mut self, at: u64, faults: AnswerFaults, hears: &mut dyn FnMut(u64, &AirEvent)) {
        self.advance(at, hears);
        self.foreign = faults.foreign;
        self.air.set_faults(at, faults.way, &mut frames(hears));
    }

    /// Takes an event that the poller emitted at `at` (virtual ns). What the poller receives is passed to `hears`.
    pub fn from_poller(&mut self, at: u64, event: &AirEvent, hears: &mut dyn FnMut(u64, &AirEvent)) {
        self.advance(at, hears);
        match event {
            AirEvent::FieldOn => self.air.from_poller(at, AirEvent::FieldOn, &mut frames(hears)),
            AirEvent::FieldOff => {
                (self.due, self.foreign_ends) = (None, None);
                self.answering = self.answering.map(|_| false);
                self.air.from_poller(at, AirEvent::FieldOff, &mut frames(hears));
            }
            AirEvent::FrameEnd { .. } if self.rng.hit(self.foreign.answers) => {
                self.due = Some(at.saturating_add(within(&mut self.rng, self.foreign.after_ns)));
            }
            AirEvent::FrameStart(_) | AirEvent::Bytes(_) | AirEvent::FrameEnd { .. } => {}
        }
    }

    /// Takes an event that the listener emitted at `at` (virtual ns). What the poller receives is passed to `hears`.
    pub fn from_listener(&mut self, at: u64, event: AirEvent, hears: &mut dyn FnMut(u64, &AirEvent)) {
        self.advance(at, hears);
        match event {
            AirEvent::FieldOn | AirEvent::FieldOff => return,
            AirEvent::FrameStart(_) => {
                self.answering = Some(self.foreign_ends.is_none());
                if self.foreign_ends.take().is_some() {
                    self.collide(at, hears);
                }
            }
            AirEvent::Bytes(_) | AirEvent::FrameEnd { .. } => {}
        }
        let on_air = self.answering == Some(true);
        if matches!(event, AirEvent::FrameEnd { .. }) {
            self.answering = None;
        }
        if on_air {
            self.air.from_poller(at, event, &mut frames(hears));
        }
    }

    /// Returns the instant at which the poller next receives something, virtual ns; `None` if nothing waits.
    pub fn next_event(&self) -> Option<u64> {
        [self.air.next_event(), self.due, self.foreign_ends.map(|(at, _)| at)].into_iter().flatten().min()
    }

    /// Passes the events up to and including `to` (virtual ns) to `hears`. Both chips must have reached `to`.
    pub fn advance(&mut self, to: u64, hears: &mut dyn FnMut(u64, &AirEvent)) {
        loop {
            let ends = self.foreign_ends.map_or(u64::MAX, |(at, _)| at);
            let begins = self.due.unwrap_or(u64::MAX);
            if ends.min(begins) > to {
                return self.air.advance(to, &mut frames(hears));
            }
            if begins < ends {
                self.due = None;
                self.foreign_begins(begins, hears);
            } else if let Some((at, bits)) = self.foreign_ends.take() {
                self.air.from_poller(at, AirEvent::FrameEnd { bits }, &mut frames(hears));
            }
        }
    }

    /// Passes the poller's emissions over `air` and the listener's over this path, and advances both to the present
    /// instant of the chips.
    pub fn carry(&mut self, air: &mut Air, poller: &mut Chip, listener: &mut Chip) {
        loop {
            for (at, event) in poller.take_air().collect::<Vec<_>>() {
                self.from_poller(at, &event, &mut |at, event| poller.hear(at, event));
                air.from_poller(at, event, &mut |at, event| listener.hear(at, event));
            }
            for (at, event) in listener.take_air().collect::<Vec<_>>() {
                air.from_listener(at, &event);
                self.from_listener(at, event, &mut |at, event| poller.hear(at, event));
            }
            air.advance(poller.now(), &mut |at, event| listener.hear(at, event));
            self.advance(listener.now(), &mut |at, event| poller.hear(at, event));
            if !poller.has_air() && !listener.has_air() {
                return;
            }
        }
    }

    /// Returns the counters of the answers so far. An answer that collided before its first bit is not counted.
    pub fn counters(&self) -> Counters {
        self.air.counters()
    }

    /// Returns the number of times that an answer began during another answer.
    pub fn collisions(&self) -> u64 {
        self.collisions
    }

    /// Returns the number of answers that foreign cards began.
    pub fn foreign_answers(&self) -> u64 {
        self.foreign_answers
    }

    /// Returns the answers of the listener and of a foreign card since the last call, as [`Air::take_sent`] does for
    /// frames. Answers that collided before their first bit are left out.
    pub fn take_sent(&mut self) -> Vec<SentFrame> {
        self.air.take_sent()
    }

    /// Returns the answers that reached the poller's antenna since the last call, as [`Air::take_heard`] does for
    /// frames.
    pub fn take_heard(&mut self) -> Vec<Heard> {
        self.air.take_heard()
    }

    /// Returns the faults that were injected into answers since the last call, in the form of [`Air::take_injected`].
    pub fn take_injected(&mut self) -> Vec<(u64, &'static str)> {
        self.air.take_injected()
    }

    fn collide(&mut self, at: u64, hears: &mut dyn FnMut(u64, &AirEvent)) {
        self.collisions += 1;
        self.air.sending_breaks_off(at, &mut frames(hears));
    }

    fn foreign_begins(&mut self, at: u64, hears: &mut dyn FnMut(u64, &AirEvent)) {
        if self.foreign_ends.is_some() {
            // The foreign card's answer to an earlier frame is still on the air.
            return;
        }
        self.foreign_answers += 1;
        if let Some(on_air) = &mut self.answering {
            if std::mem::take(on_air) {
                self.collide(at, hears);
            }
            return;
        }
        let mut data = vec![self.foreign.payload.saturating_add(1)];
        data.extend((0..self.foreign.payload).map(|_| self.rng.up_to(255) as u8));
        data.extend(crc::nfc_f(&data));
        let (bits, bit_as) = (8 * data.len() as u32, Clock::new(0).cycles_as(32));
        let start = FrameStart {
            technology: Technology::NfcF,
            bits_per_second: 424_000,
            bit_as,
            header_bits: 64,
            byte_bits: 8,
            load_modulation: true,
            chunk: Chunk { data, parity_error: false },
        };
        self.foreign_ends = Some((at.saturating_add(bits_ns(64 + u64::from(bits), bit_as)), bits));
        self.air.from_poller(at, AirEvent::FrameStart(start), &mut frames(hears));
    }
}
