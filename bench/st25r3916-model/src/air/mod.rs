//! The air between a poller and a listener: it determines when a frame is received, and with which errors.
//!
//! | covered | source |
//! |---|---|
//! | field coupling, both ways; the listener's loss of the field | the two antennas face each other |
//! | frames by event: start, further bytes, end; each with its instant | [`crate::Chip`] emits them |
//! | seeded faults of the poller's frames: [`AirFaults`] | the errors of IEC 61784-3 (corruption, loss, |
//! | | repetition, delay) |
//! | frames that meet at the listener's antenna | see below |
//!
//! | left out | why |
//! |---|---|
//! | propagation time | 1 ns at 30 cm |
//! | answers; only their number is counted | a link that has answers carries them by an [`AnswerPath`] |
//!
//! # Frames that meet
//!
//! At most one frame is on the air at the listener's antenna.
//!
//! - A repeated or delayed frame never begins during another frame. It waits until 0.3 ms after the end of that frame.
//! - The poller's own frame does not wait. If it begins during another frame, that frame breaks off, and the poller's
//!   frame is not received because its sync is masked. The same happens to two frames of the poller if
//!   [`AirFaults::scatter_ns`] makes them overlap.
//! - A frame without the poller's carrier is lost. If the carrier goes off during a frame, the frame breaks off.
//!
//! # Time
//!
//! [`Air::from_poller`], [`Air::set_faults`] and [`Air::advance`] must be called in order of time. The instants may lie
//! ahead of the listener's time, because [`Chip::hear`] accepts such events. Later events wait in the air, and the
//! caller must call [`Air::advance`] at [`Air::next_event`]. Without faults no event waits.

mod account;
mod answers;
mod faults;
mod flight;

pub use account::{Counters, Heard, LastFrame, Origin, SentFrame};
pub use answers::{AnswerFaults, AnswerPath, ForeignCard};
pub use faults::AirFaults;

use crate::Chip;
use crate::event::{AirEvent, Chunk, FrameStart};
use crate::rng::SplitMix;
use account::{Account, Fault, Outcome};
use faults::{burst, invert, sync_errors, within};
use flight::{Flight, Later, Sending, expected_bits};

/// The shortest gap, ns, between two frames of the link. A frame that waits for another one keeps this gap.
const GAP_NS: u64 = 300_000;

/// The air between one poller and one listener.
#[derive(Clone, Debug)]
pub struct Air {
    faults: AirFaults,
    rng: SplitMix,
    field: bool,
    sending: Option<Sending>,
    on_air: Option<(u64, Flight)>,
    /// The frames that have not begun at the listener's antenna, in the order in which the air received them.
    waiting: Vec<Flight>,
    /// For each LEN, the last frame that the poller sent whole while [`AirFaults::frozen`] was off.
    whole: Vec<Vec<u8>>,
    next_id: u64,
    account: Account,
}

impl Air {
    /// Returns an air with `faults` from time 0 on; `seed` determines all random values.
    pub fn new(seed: u64, faults: AirFaults) -> Self {
        let mut air = Self {
            faults: AirFaults::default(),
            rng: SplitMix::new(seed),
            field: false,
            sending: None,
            on_air: None,
            waiting: vec![],
            whole: vec![],
            next_id: 0,
            account: Account::default(),
        };
        air.set_faults(0, faults, &mut |_, _| {});
        air
    }

    /// Changes the faults from `at` (virtual ns) on. A frame that the poller began before keeps the earlier faults, but
    /// a field that goes off breaks it off. What the listener receives is passed to `hears`.
    pub fn set_faults(&mut self, at: u64, faults: AirFaults, hears: &mut dyn FnMut(u64, &AirEvent)) {
        self.advance(at, hears);
        let was_off = std::mem::replace(&mut self.faults, faults).field_off;
        if faults.field_off && !was_off {
            self.break_off(at, hears);
            self.account.inject(at, Fault::FieldOff);
            if self.field {
                hears(at, &AirEvent::FieldOff);
            }
        } else if was_off && !faults.field_off && self.field {
            hears(at, &AirEvent::FieldOn);
        }
    }

    /// Passes the emissions of each chip to the other until neither emits more, and advances the air to the poller's
    /// time. The caller must do this when [`has_air`](Chip::has_air) is true for either chip, and at
    /// [`Air::next_event`].
    pub fn carry(&mut self, poller: &mut Chip, listener: &mut Chip) {
        loop {
            for (at, event) in poller.take_air() {
                self.from_poller(at, event, &mut |at, event| listener.hear(at, event));
            }
            for (at, event) in listener.take_air() {
                self.from_listener(at, &event);
                poller.hear(at, &event);
            }
            self.advance(poller.now(), &mut |at, event| listener.hear(at, event));
            if !poller.has_air() && !listener.has_air() {
                return;
            }
        }
    }

    /// Takes an event that the poller emitted at `at` (virtual ns), for callers that do not use [`Air::carry`]. `hears`
    /// is the listener.
    pub fn from_poller(&mut self, at: u64, event: AirEvent, hears: &mut dyn FnMut(u64, &AirEvent)) {
        match event {
            AirEvent::FieldOn | AirEvent::FieldOff => {
                self.advance(at, hears);
                self.field = event == AirEvent::FieldOn;
                if !self.field {
                    self.sending_breaks_off(at, hears);
                    self.break_off(at, hears);
                }
                if !self.faults.field_off {
                    hears(at, &event);
                }
            }
            AirEvent::FrameStart(frame) => {
                self.advance(at, hears);
                self.sending_breaks_off(at, hears);
                self.frame_started(at, frame);
            }
            // The events that are due at `at` depend on a frame's end, so the end is recorded first.
            AirEvent::Bytes(chunk) => self.frame_goes_on(at, chunk),
            AirEvent::FrameEnd { bits } => self.frame_ended(at, bits),
        }
        self.advance(at, hears);
    }

    /// Counts an event that the listener emitted, for callers that do not use [`Air::carry`]. The caller must pass the
    /// event to the poller.
    pub fn from_listener(&mut self, _at: u64, event: &AirEvent) {
        if matches!(event, AirEvent::FrameStart(_)) {
            self.account.counters.answers += 1;
        }
    }

    /// Returns the instant at which the listener next receives a waiting event, virtual ns; `None` if no event waits.
    pub fn next_event(&self) -> Option<u64> {
        let on_air = self.on_air.as_ref().and_then(|(began, flight)| flight.next(*began));
        let waiting = self.waiting.iter().filter_map(|flight| flight.due).min();
        on_air.into_iter().chain(waiting).min()
    }

    /// Passes the events up to and including `to` (virtual ns) to `hears`. The poller must have reached `to`.
    pub fn advance(&mut self, to: u64, hears: &mut dyn FnMut(u64, &AirEvent)) {
        loop {
            let ends = self.on_air.as_ref().and_then(|(began, flight)| flight.next(*began));
            let begins = (0..self.waiting.len()).filter_map(|i| Some((self.waiting[i].due?, i))).min();
            match (ends, begins) {
                // Two frames do not collide if one begins at the instant at which the other ends.
                (Some(at), _) if at <= to && begins.is_none_or(|(due, _)| at <= due) => self.goes_on(hears),
                (_, Some((due, index))) if due <= to => self.begins(due, index, hears),
                _ => break,
            }
        }
        self.publish_marks(to);
    }

    /// Returns the counters of the frames so far.
    pub fn counters(&self) -> Counters {
        self.account.counters
    }

    /// Returns the last frame of the poller that has ended.
    pub fn last_frame(&self) -> Option<LastFrame> {
        self.account.last
    }

    /// Returns the frames that the poller sent since the last call, in order of their ends.
    pub fn take_sent(&mut self) -> Vec<SentFrame> {
        std::mem::take(&mut self.account.sent)
    }

    /// Returns the frames that reached the listener's antenna since the last call, in order of their ends.
    pub fn take_heard(&mut self) -> Vec<Heard> {
        std::mem::take(&mut self.account.heard)
    }

    /// Returns the faults that were injected since the last call, in order of time, each as its instant (virtual ns)
    /// and kind. The kinds are "bit error" (one entry per bit), "burst", "lost", "cut", "repeated", "delayed",
    /// "scatter", "field off" and "frozen".
    ///
    /// A bit error or a burst has the instant at which its first wrong bit reaches the listener. A cut has the instant
    /// at which the frame ends at the listener. A repetition has the instant of its own first bit there. All other
    /// faults, and an error in the sync, have the instant at which the poller sent the frame's first bit.
    pub fn take_injected(&mut self) -> Vec<(u64, &'static str)> {
        std::mem::take(&mut self.account.injected)
    }

    fn frame_started(&mut self, at: u64, frame: FrameStart) {
        self.account.counters.sent += 1;
        let id = self.new_id();
        self.sending = Some(Sending::new(id, at, frame.clone()));
        if self.faults.field_off || self.is_lost(at, &frame) {
            return self.account.over(Origin::Poller, Outcome::Lost);
        }
        let Self { faults, rng, account, whole, .. } = self;
        let mut flight = Flight::new(id, *faults, at, frame);
        if faults.frozen
            && let Some(old) = whole.iter().find(|old| old.first() == flight.start.chunk.data.first())
        {
            flight.start.chunk.data.clone_from(old);
            (flight.frozen, flight.changed) = (true, true);
            account.inject(at, Fault::Frozen);
        }
        flight.burst = burst(rng, faults, expected_bits(&flight.start));
        if let Some(&first) = flight.burst.first() {
            flight.mark(flight.start.until_bit(first), Fault::Burst);
        }
        let mut chunk = std::mem::take(&mut flight.start.chunk);
        damage(rng, &mut flight, 0, &mut chunk);
        flight.start.chunk = chunk;
        if rng.hit(faults.truncated) {
            let bytes = rng.below(flight.start.chunk.data.len());
            flight.cut(bytes);
            flight.mark(flight.start.until_byte(bytes), Fault::Cut);
        }
        if rng.hit(faults.delayed) {
            flight.due = Some(at.saturating_add(within(rng, faults.delay_ns)));
            flight.origin = Origin::Delayed;
            account.inject(at, Fault::Delayed);
        } else {
            let later = rng.up_to(faults.scatter_ns);
            if later > 0 {
                flight.due = Some(at.saturating_add(later));
                account.inject(at, Fault::Scatter);
            }
        }
        self.waiting.push(flight);
    }

    fn frame_goes_on(&mut self, at: u64, mut chunk: Chunk) {
        let Self { rng, sending, on_air, waiting, .. } = self;
        let Some(sending) = sending else { return };
        let (first, after) = (sending.len(), at.saturating_sub(sending.started_ns));
        sending.more(&chunk);
        if let Some(flight) = flight_of(on_air, waiting, sending.id).filter(|flight| !flight.frozen) {
            damage(rng, flight, first, &mut chunk);
            flight.later.push_back((after, Later::Bytes(chunk)));
        }
    }

    fn frame_ended(&mut self, at: u64, bits: u32) {
        let Some(sending) = self.sending.take() else { return };
        let (id, start_ns) = (sending.id, sending.started_ns);
        let sent = sending.ended(at, bits);
        let bits_per_second = sent.bits_per_second;
        self.account.last = Some(LastFrame { start_ns, end_ns: at, bits_per_second, data_bits: bits });
        if let Some(flight) = flight_of(&mut self.on_air, &mut self.waiting, id) {
            flight.later.push_back((at.saturating_sub(start_ns), Later::End { bits, whole: sent.whole }));
        }
        if sent.whole && !self.faults.frozen {
            match self.whole.iter_mut().find(|old| old.first() == sent.bytes.first()) {
                Some(old) => old.clone_from(&sent.bytes),
                None => self.whole.push(sent.bytes.clone()),
            }
        }
        self.account.sent.push(sent);
    }

    /// Ends the poller's present frame at `at`, because the poller's next frame begins or its carrier goes off.
    fn sending_breaks_off(&mut self, at: u64, hears: &mut dyn FnMut(u64, &AirEvent)) {
        if let Some(sending) = &self.sending {
            let bits = sending.bits_by(at);
            self.frame_ended(at, bits);
            self.advance(at, hears);
        }
    }

    fn is_lost(&mut self, at: u64, frame: &FrameStart) -> bool {
        let Self { faults, rng, account, .. } = self;
        if rng.hit(faults.lost) {
            account.inject(at, Fault::Lost);
            return true;
        }
        let wrong = sync_errors(rng, faults, frame);
        (0..wrong).for_each(|_| account.inject(at, Fault::BitError));
        wrong != 0
    }

    fn new_id(&mut self) -> u64 {
        self.next_id += 1;
        self.next_id
    }

    fn begins(&mut self, due: u64, index: usize, hears: &mut dyn FnMut(u64, &AirEvent)) {
        let straight = self.waiting[index].origin == Origin::Poller;
        if self.on_air.is_some() && !straight {
            self.waiting[index].due = None;
            return;
        }
        let flight = self.waiting.remove(index);
        if !self.field || self.faults.field_off {
            return self.account.over(flight.origin, Outcome::Lost);
        }
        if self.on_air.is_some() {
            self.account.counters.collisions += 1;
            self.account.over(flight.origin, Outcome::Lost);
            return self.break_off(due, hears);
        }
        if flight.origin == Origin::Repeated {
            self.account.inject(due, Fault::Repeated);
        }
        hears(due, &AirEvent::FrameStart(flight.start.clone()));
        self.on_air = Some((due, flight));
    }

    fn goes_on(&mut self, hears: &mut dyn FnMut(u64, &AirEvent)) {
        let Some((began, flight)) = &mut self.on_air else { return };
        let Some((after, later)) = flight.later.pop_front() else { return };
        let at = began.saturating_add(after);
        match later {
            Later::Bytes(chunk) => {
                flight.start.chunk.data.extend_from_slice(&chunk.data);
                flight.start.chunk.parity_error |= chunk.parity_error;
                hears(at, &AirEvent::Bytes(chunk));
            }
            Later::End { bits, whole } => {
                hears(at, &AirEvent::FrameEnd { bits });
                self.over(at, bits, whole);
            }
        }
    }

    fn break_off(&mut self, at: u64, hears: &mut dyn FnMut(u64, &AirEvent)) {
        let Some((began, flight)) = &self.on_air else { return };
        let bits = flight.start.data_bits_in(at.saturating_sub(*began)).min(8 * flight.start.chunk.data.len() as u64);
        let bits = u32::try_from(bits).unwrap_or(u32::MAX);
        hears(at, &AirEvent::FrameEnd { bits });
        self.over(at, bits, false);
    }

    fn over(&mut self, at: u64, bits: u32, whole: bool) {
        self.publish_marks(at);
        let Some((began, flight)) = self.on_air.take() else { return };
        self.account.heard.push(flight.heard(began, at, bits, whole));
        let outcome = if whole && !flight.changed { Outcome::Delivered } else { Outcome::Damaged };
        self.account.over(flight.origin, outcome);
        for waits in self.waiting.iter_mut().filter(|other| other.due.is_none()) {
            waits.due = Some(at.saturating_add(GAP_NS));
        }
        if whole && flight.origin != Origin::Repeated && self.rng.hit(flight.faults.repeated) {
            let due = at.saturating_add(within(&mut self.rng, flight.faults.repeat_after_ns));
            let id = self.new_id();
            self.waiting.push(flight.again(id, due, at - began, bits));
        }
    }

    fn publish_marks(&mut self, to: u64) {
        let Some((began, flight)) = &mut self.on_air else { return };
        while let Some((after, fault)) = flight.marks.pop_front_if(|(after, _)| began.saturating_add(*after) <= to) {
            self.account.inject(began.saturating_add(after), fault);
        }
    }
}

/// Applies the bit errors and the burst of `flight` to `chunk`, whose first byte is byte `first` of the frame.
fn damage(rng: &mut SplitMix, flight: &mut Flight, first: usize, chunk: &mut Chunk) {
    let before = chunk.clone();
    for bit in invert(rng, &flight.faults, flight.start.technology, &flight.burst, first, chunk) {
        flight.mark(flight.start.until_bit(bit), Fault::BitError);
    }
    flight.changed |= *chunk != before;
}

/// Returns the poller's frame with the number `id`; `None` if it has already ended at the listener.
fn flight_of<'a>(on_air: &'a mut Option<(u64, Flight)>, waiting: &'a mut [Flight], id: u64) -> Option<&'a mut Flight> {
    let on_air = on_air.iter_mut().map(|(_, flight)| flight);
    on_air.chain(waiting).find(|flight| flight.id == id)
}
