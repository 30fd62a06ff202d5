//! The flight controller as a reader of the active hold, and the commands to it: those of the flight controller, and
//! those of the base station where the flight controller generates its uplinks.
//!
//! Each writer sends one command after the other, drawn from the seed: set-points inside and outside any sensible
//! limits, lock, unlock, clear, and words that no hold knows. In between, some uplinks repeat a number that the hold
//! has acknowledged, or one before it, with another command, which the hold must not execute.

use profile::criticality::{BaseStation, FlightController, WritesUplink};
use profile::hold::{Acknowledged, COMMAND_SIZE, HoldCommand, Sender, Sent, Words};
use profile::ssi::client::{HoldReport, HoldShown, HoldTrack, Shown, View};
use profile::{HoldStatus, Uplink};

use crate::faults::Rng;

/// The shortest and the longest time from the end of one command to the next one, ms.
const PAUSE: (u64, u64) = (300, 2_000);
/// The time after which a writer gives a command up, ms.
const PATIENCE: u64 = 1_500;

/// A word that no hold knows.
struct Unknown(u16);

impl Words for Unknown {
    fn encode(&self) -> (u16, f32) {
        (self.0, 1.0)
    }

    fn decode(_word: u16, _value: f32) -> Option<Self> {
        None
    }
}

/// What became of a writer's commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fates {
    /// The commands that were sent.
    pub sent: u64,
    /// Those of them that the hold has acknowledged.
    pub acknowledged: u64,
    /// Those that the writer has given up, or that were lost with a restart of the hold.
    pub lost: u64,
}

/// One writer of commands.
#[derive(Clone, Debug)]
struct Line<W> {
    sender: Sender<W>,
    /// The instant of the next command or of giving the present one up, ms on the flight controller's clock.
    next_ms: u64,
    /// The number that the hold last acknowledged.
    acknowledged: Option<Acknowledged>,
    fates: Fates,
}

impl<W: WritesUplink> Line<W> {
    fn new() -> Self {
        Self { sender: Sender::new(), next_ms: 0, acknowledged: None, fates: Fates::default() }
    }

    /// Takes the acknowledgement from an object of the hold; `restarted` says that its timestamp went back.
    fn observe(&mut self, object: &HoldStatus, restarted: bool, now_ms: u64, rng: &mut Rng) {
        let waited = matches!(self.sender.sent(), Sent::Waiting(_));
        self.sender.observe(object.as_object());
        self.acknowledged = (!restarted).then(|| object.as_object().acknowledged::<W>());
        if waited && !matches!(self.sender.sent(), Sent::Waiting(_)) {
            match self.sender.sent() {
                Sent::Answered(..) => self.fates.acknowledged += 1,
                _ => self.fates.lost += 1,
            }
            self.next_ms = now_ms + rng.between(PAUSE.0, PAUSE.1);
        }
    }

    /// Puts what the writer commands at `now_ms` into the payload of its uplink.
    fn fill(&mut self, payload: &mut [u8; Uplink::PAYLOAD], now_ms: u64, rng: &mut Rng) {
        if now_ms >= self.next_ms {
            if matches!(self.sender.sent(), Sent::Waiting(_)) {
                self.sender.give_up();
                self.fates.lost += 1;
                self.next_ms = now_ms + rng.between(PAUSE.0, PAUSE.1);
            } else if self.send(rng).is_some() {
                self.fates.sent += 1;
                self.next_ms = now_ms + PATIENCE;
            }
        }
        self.sender.fill(payload);
        let idle = !matches!(self.sender.sent(), Sent::Waiting(_));
        if let Some(last) = self.acknowledged.filter(|_| idle && rng.one_in(4)) {
            let number = last.number().wrapping_sub(rng.below(4) as u16);
            let word = 1 + rng.below(5) as u16;
            payload[..2].copy_from_slice(&number.to_le_bytes());
            payload[2..4].copy_from_slice(&word.to_le_bytes());
            payload[4..8].copy_from_slice(&5.0_f32.to_le_bytes());
        }
    }

    fn send(&mut self, rng: &mut Rng) -> Option<u16> {
        let command = match rng.below(10) {
            0..4 => HoldCommand::SetPoint(rng.between(10, 300) as f32 / 10.0),
            4 => HoldCommand::SetPoint([-300.0, 300.0, f32::NAN, f32::INFINITY][rng.below(4) as usize]),
            5 | 6 => HoldCommand::Lock,
            7 => HoldCommand::Unlock,
            8 => HoldCommand::ClearShock,
            _ => return self.sender.send(&Unknown(rng.between(5, 65_535) as u16)),
        };
        self.sender.send(&command)
    }
}

/// Reads the hold and commands it.
#[derive(Clone, Debug)]
pub struct HoldUser {
    rng: Rng,
    track: HoldTrack,
    last: Option<HoldReport>,
    /// The timestamp of the last object.
    timestamp: Option<u32>,
    base: Line<BaseStation>,
    own: Line<FlightController>,
    /// Whether it commands the hold; otherwise it only reads.
    commands: bool,
    /// The number of readings of the whole map in which there was a valid Hold-Status, and of those without one.
    pub shown: (u64, u64),
}

impl HoldUser {
    /// A reader whose commands follow from `seed`.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let rng = Rng::stream(seed, 0x4100);
        let (base, own) = (Line::new(), Line::new());
        Self { rng, track: HoldTrack::new(), last: None, timestamp: None, base, own, commands: true, shown: (0, 0) }
    }

    /// A reader without commands: those of the base station come by radio.
    #[must_use]
    pub fn silent() -> Self {
        Self { commands: false, ..Self::new(0) }
    }

    /// Takes the hold's object from a transaction that began at `own_us` on the flight controller's clock.
    pub fn read(&mut self, view: &View<'_>, own_us: u64) {
        let report = self.track.read(view, own_us);
        if view.hold().is_some() && !view.is_busy() {
            *if report.shown == HoldShown::Valid { &mut self.shown.0 } else { &mut self.shown.1 } += 1;
        }
        self.last = Some(report);
        if let Some(Shown::Intact(object)) = view.hold() {
            let restarted = self.timestamp.replace(object.timestamp()).is_some_and(|last| last > object.timestamp());
            self.base.observe(object, restarted, own_us / 1_000, &mut self.rng);
            self.own.observe(object, restarted, own_us / 1_000, &mut self.rng);
        }
    }

    /// Puts commands into the payload of an uplink of `W` that is written at `own_ms` on the flight controller's clock.
    pub fn fill<W: WritesUplink>(&mut self, payload: &mut [u8; Uplink::PAYLOAD], own_ms: u64) {
        if !self.commands {
            payload[..COMMAND_SIZE].fill(0);
        } else if W::INDEX == BaseStation::INDEX {
            self.base.fill(payload, own_ms, &mut self.rng);
        } else {
            self.own.fill(payload, own_ms, &mut self.rng);
        }
    }

    /// What was known of the hold after the last transaction.
    #[must_use]
    pub fn last(&self) -> Option<&HoldReport> {
        self.last.as_ref()
    }

    /// What became of the commands of base station and flight controller.
    #[must_use]
    pub fn fates(&self) -> [Fates; 2] {
        [self.base.fates, self.own.fates]
    }
}
