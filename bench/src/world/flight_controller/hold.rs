//! The flight controller reads the hold's object and sends commands to the hold. It also sends the base station's
//! commands if it generates the base station's uplinks.
//!
//! Each writer sends one command after the other, drawn from the seed: set-points (also impossible ones), lock, unlock,
//! clear, and unknown commands. Some uplinks have another command with the number of an acknowledged one, or with an
//! older number. The hold must not execute these.

use profile::criticality::{BaseStation, FlightController, WritesUplink};
use profile::hold::{Acknowledged, COMMAND_SIZE, HoldCommand, Sender, Sent, Words};
use profile::ssi::client::{HoldReport, HoldShown, HoldTrack, Shown, View};
use profile::{HoldStatus, Uplink};

use crate::faults::Rng;

/// The shortest and the longest time, ms, from the end of one command to the next one.
const PAUSE: (u64, u64) = (300, 2_000);
/// The time, ms, after which a writer gives up a command without an acknowledgement.
const PATIENCE: u64 = 1_500;

/// A command word that no hold accepts.
struct Unknown(u16);

impl Words for Unknown {
    fn encode(&self) -> (u16, f32) {
        (self.0, 1.0)
    }

    fn decode(_word: u16, _value: f32) -> Option<Self> {
        None
    }
}

/// The outcomes of a writer's commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fates {
    /// The number of commands that were sent.
    pub sent: u64,
    /// The number of commands that the hold has acknowledged.
    pub acknowledged: u64,
    /// The number of commands that the writer gave up, or that were lost when the hold restarted.
    pub lost: u64,
}

/// One writer of commands to the hold.
#[derive(Clone, Debug)]
struct Line<W> {
    sender: Sender<W>,
    /// The instant, ms on the flight controller's clock, at which the writer sends its next command or gives up the
    /// present one.
    next_ms: u64,
    /// The number of the command that the hold acknowledged last.
    acknowledged: Option<Acknowledged>,
    fates: Fates,
}

impl<W: WritesUplink> Line<W> {
    fn new() -> Self {
        Self { sender: Sender::new(), next_ms: 0, acknowledged: None, fates: Fates::default() }
    }

    /// Takes the acknowledgement from an object of the hold. `restarted` says that the object's timestamp went back.
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

    /// Puts the writer's command at the instant `now_ms`, if any, into the payload of an uplink.
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

/// The flight controller's reader of the hold's object, and sender of commands to the hold.
#[derive(Clone, Debug)]
pub struct HoldUser {
    rng: Rng,
    track: HoldTrack,
    last: Option<HoldReport>,
    /// The timestamp of the hold's last object.
    timestamp: Option<u32>,
    base: Line<BaseStation>,
    own: Line<FlightController>,
    /// Whether the flight controller sends commands to the hold.
    commands: bool,
    /// The number of transactions that read the whole map with a valid Hold-Status, and the number of those without
    /// one.
    pub shown: (u64, u64),
}

impl HoldUser {
    /// Returns a user of the hold that reads its object and sends commands, drawn from `seed`.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let rng = Rng::stream(seed, 0x4100);
        let (base, own) = (Line::new(), Line::new());
        Self { rng, track: HoldTrack::new(), last: None, timestamp: None, base, own, commands: true, shown: (0, 0) }
    }

    /// Returns a user of the hold that sends no commands, because the base station's commands come by radio.
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

    /// Puts a command into the payload of an uplink of writer `W`. The uplink is written at `own_ms` on the flight
    /// controller's clock.
    pub fn fill<W: WritesUplink>(&mut self, payload: &mut [u8; Uplink::PAYLOAD], own_ms: u64) {
        if !self.commands {
            payload[..COMMAND_SIZE].fill(0);
        } else if W::INDEX == BaseStation::INDEX {
            self.base.fill(payload, own_ms, &mut self.rng);
        } else {
            self.own.fill(payload, own_ms, &mut self.rng);
        }
    }

    /// The hold's state in the last transaction.
    #[must_use]
    pub fn last(&self) -> Option<&HoldReport> {
        self.last.as_ref()
    }

    /// The outcomes of the base station's commands and of the flight controller's commands.
    #[must_use]
    pub fn fates(&self) -> [Fates; 2] {
        [self.base.fates, self.own.fates]
    }
}
