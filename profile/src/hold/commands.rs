//! The rule by which a hold executes each command once, at most.
//!
//! # Numbers
//!
//! A command's sequence number is *new* if it is 1 to 32767 ahead of the last number that the hold acknowledged to the
//! writer; 0 stands for that number at the hold's start. The hold acknowledges each command with a new number, whether
//! it executed or refused the command, or found it unknown or too old. From then on, this number and those behind it
//! are not new. So a command is executed once at most and in order, even if uplinks are lost, repeated, delayed or
//! reordered. A writer's next number must follow the [acknowledged](super::Acknowledged) one.
//!
//! # Age
//!
//! The bytes of an answer do not show how old an uplink is, because its timestamp is on the writer's clock. The DPR
//! hands on only uplinks that it stored at most [1 s](super::COMMAND_AGE_MS) ago. The hold also judges the progress of
//! each writer's timestamps on its own clock:
//!
//! - A timestamp that is later than the writer's last one (by less than 2³¹ ms) is *fresh*.
//! - The first timestamp after the hold's start, or one that is earlier than the writer's last, may belong to an old
//!   uplink. A new command that comes with it waits for a later timestamp.
//! - A timestamp that has been the same for more than 1 s is too old, and so is a new command that comes with it.
//!
//! The hold cannot tell how long the first uplink after a pause took to reach the DPR. The writer's own radio link must
//! bound that delay.
use bytemuck::{Pod, Zeroable};

use super::{Acknowledged, Answer, COMMAND_AGE_MS, Outcome};
use crate::{
    Uplink,
    criticality::{BaseStation, FlightController, Function, WritesUplink},
    wire::{F32Le, U16Le, U32Le},
};

/// The size of a command, bytes. A command is at the beginning of an uplink's payload.
pub const COMMAND_SIZE: usize = size_of::<WireCommand>();

/// The commands that a maker's hold accepts, as they are encoded on the wire.
pub trait Words: Sized {
    /// The command's word, which is not 0, and its value; 0.0 if the command needs no value.
    fn encode(&self) -> (u16, f32);

    /// The command with this word and this value; `None` if the word is unknown.
    fn decode(word: u16, value: f32) -> Option<Self>;
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct WireCommand {
    number: U16Le,
    word: U16Le,
    value: F32Le,
    reserved: U32Le,
}

const _: () = assert!(COMMAND_SIZE == 12 && COMMAND_SIZE <= Uplink::PAYLOAD);

impl WireCommand {
    pub(super) fn new<C: Words>(number: u16, command: &C) -> Self {
        let (word, value) = command.encode();
        Self { number: U16Le::new(number), word: U16Le::new(word), value: F32Le::new(value), reserved: U32Le::new(0) }
    }

    fn of(payload: &[u8; Uplink::PAYLOAD]) -> Self {
        let (command, _) = payload.split_at(COMMAND_SIZE);
        *bytemuck::from_bytes(command)
    }

    fn command<C: Words>(&self) -> Option<C> {
        C::decode(self.word.get(), self.value.get()).filter(|_| self.reserved.get() == 0)
    }
}

/// What a hold did with a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Executed {
    /// The command was carried out.
    Done,
    /// The hold's own limits forbid the command, and nothing was done.
    Refused,
}

/// The timestamp of a writer's uplink, and the instant at which the hold first received it.
#[derive(Clone, Copy, Debug)]
struct Seen {
    timestamp: u32,
    since_ms: u64,
    is_later: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Age {
    Fresh,
    Unknown,
    TooOld,
}

#[derive(Clone, Copy, Debug, Default)]
struct Memory {
    acknowledged: Acknowledged,
    seen: Option<Seen>,
}

impl Memory {
    fn age(&mut self, timestamp: u32, now_ms: u64) -> Age {
        let seen = match self.seen {
            Some(seen) if seen.timestamp == timestamp => seen,
            before => {
                let is_later = before.is_some_and(|before| timestamp.wrapping_sub(before.timestamp) <= u32::MAX / 2);
                Seen { timestamp, since_ms: now_ms, is_later }
            }
        };
        self.seen = Some(seen);
        // Not covered: only this line, the limit of the subtraction at 0: `since_ms` is an earlier value of the same
        // clock, which does not go back.
        if now_ms.saturating_sub(seen.since_ms) > u64::from(COMMAND_AGE_MS) {
            Age::TooOld
        } else if seen.is_later {
            Age::Fresh
        } else {
            Age::Unknown
        }
    }

    /// Executes and acknowledges the command in `uplink` if its number is new. A command whose age is not known waits.
    fn take<C: Words>(&mut self, uplink: &Uplink, now_ms: u64, execute: impl FnOnce(C) -> Executed) {
        let age = self.age(uplink.timestamp(), now_ms);
        let command = WireCommand::of(&uplink.values().payload);
        let number = command.number.get();
        if command.word.get() == 0 || !is_newer(number, self.acknowledged.number()) {
            return;
        }
        // Not covered: only this line, in the copy for the base station, an uplink that is seen with one timestamp for
        // more than a second: the DPR hands an uplink on for a second at most. The copy for the flight controller has
        // it.
        let outcome = match (age, command.command()) {
            (Age::Unknown, _) => return,
            (Age::TooOld, _) => Outcome::TooOld,
            (Age::Fresh, None) => Outcome::Unknown,
            (Age::Fresh, Some(command)) => match execute(command) {
                Executed::Done => Outcome::Done,
                Executed::Refused => Outcome::Refused,
            },
        };
        self.acknowledged = Acknowledged::new(number, outcome);
    }
}

pub(super) const fn is_newer(number: u16, than: u16) -> bool {
    let ahead = number.wrapping_sub(than);
    ahead != 0 && ahead <= u16::MAX / 2
}

/// The rule by which a hold executes each command once at most, with its state.
///
/// The rule is in docs/design.md#commands-to-the-hold.
///
/// ```
/// use profile::criticality::{BaseStation, Writer};
/// use profile::hold::{Acknowledged, Answer, Commands, Executed, HoldCommand, Outcome, Sender};
/// # use profile::criticality::ActiveLoad;
/// # use profile::{HoldStatus, HoldValues, Uplink, UplinkValues};
/// # let mut sender = Sender::<BaseStation>::new();
/// # sender.observe(HoldStatus::seal(Writer::<ActiveLoad>::claim(), &HoldValues::absent(0)).as_object());
/// # sender.send(&HoldCommand::SetPoint(4.5));
///
/// let mut commands = Commands::new();
/// let mut set_point = 20.0;
/// for period in 0..5 {
///     // The base station writes an uplink in each period, with the same command until it is acknowledged.
///     # let mut values = UplinkValues { timestamp: 100 * period, ..UplinkValues::default() };
///     # sender.fill(&mut values.payload);
///     # let mut answer = Answer::EMPTY;
///     # let base_station = Writer::<BaseStation>::claim();
///     # answer.set_uplink(base_station, Uplink::seal(base_station, &values));
///     let mut executed = 0;
///     commands.take(&answer, 100 * u64::from(period), |_, command| match command {
///         HoldCommand::SetPoint(celsius) if (2.0..=8.0).contains(&celsius) => {
///             (set_point, executed) = (celsius, 1);
///             Executed::Done
///         }
///         _ => Executed::Refused,
///     });
///     // The first uplink alone does not show that its writer still writes; the second does.
///     assert_eq!(executed, u8::from(period == 1));
/// }
/// assert_eq!(set_point, 4.5);
/// assert_eq!(commands.acknowledged(), [Acknowledged::new(1, Outcome::Done), Acknowledged::default()]);
/// ```
#[derive(Clone, Debug, Default)]
pub struct Commands {
    base_station: Memory,
    flight_controller: Memory,
}

impl Commands {
    /// The state after power-on of a hold that has acknowledged no command.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The state of a hold that has kept its acknowledgements through a reset, in the order of [`WritesUplink::INDEX`].
    /// A hold that lost them could execute a command twice: once before the reset and once after it.
    #[must_use]
    pub const fn resume(acknowledged: [Acknowledged; 2]) -> Self {
        let [base_station, flight_controller] = acknowledged;
        Self {
            base_station: Memory { acknowledged: base_station, seen: None },
            flight_controller: Memory { acknowledged: flight_controller, seen: None },
        }
    }

    /// Executes each new command in `answer`, the base station's first, if its uplink is fresh. `now_ms` is the time
    /// since the hold's start. `execute` gets the writer and the command, and enforces the hold's limits.
    ///
    /// To be called for each answer. A missing or damaged uplink changes nothing.
    pub fn take<C: Words>(&mut self, answer: &Answer, now_ms: u64, mut execute: impl FnMut(Function, C) -> Executed) {
        // Both uplinks are verified before either command is executed, so that the work does not depend on the
        // commands.
        let uplinks = (answer.uplink::<BaseStation>(), answer.uplink::<FlightController>());
        // Not covered: only this line, in the path behind an uplink of another size, which no answer has:
        // `Answer::uplink` takes constant parts of it.
        if let Ok(uplink) = uplinks.0 {
            // Not covered: only this line, the outcome of a command that is too old, as in `Memory::take`.
            self.base_station.take(uplink, now_ms, |command| execute(Function::BaseStation, command));
        }
        if let Ok(uplink) = uplinks.1 {
            self.flight_controller.take(uplink, now_ms, |command| execute(Function::FlightController, command));
        }
    }

    /// The acknowledgements to send in the next Hold-Status, in the order of [`WritesUplink::INDEX`].
    #[must_use]
    pub const fn acknowledged(&self) -> [Acknowledged; 2] {
        [self.base_station.acknowledged, self.flight_controller.acknowledged]
    }
}

const _: () = assert!(BaseStation::INDEX == 0 && FlightController::INDEX == 1);

#[cfg(test)]
mod tests;
