//! The rule by which a hold executes each command once.
//!
//! # Numbers
//!
//! A command's sequence number is *new* if it is 1 to 32767 ahead of the writer's acknowledged one, so that numbers may
//! wrap; the first after the hold's start is ahead of 0. A new number is executed, refused, or found unknown or too
//! old, and whichever it is, it is acknowledged: from then on neither it nor a number behind it is new. So a command is
//! executed once at most, and in the order of the numbers, whatever is lost, repeated, delayed or exchanged on the way.
//! A writer's next number is therefore one that it derives from the [acknowledged](super::Acknowledged) one.
//!
//! # Age
//!
//! The bytes of an answer do not tell how old an uplink is: its timestamp is on the writer's clock. The DPR hands on
//! only uplinks that it stored at most [1 s](super::COMMAND_AGE_MS) ago. The hold does not rely on that alone; it
//! judges what it can see, the progress of each writer's timestamps on its own clock:
//!
//! - A timestamp that is later than the one before it (by less than 2³¹ ms) is *fresh*: the writer has written since.
//! - The first timestamp after the hold's start, and one that is earlier than the one before it (the writer has
//!   restarted, or an old uplink has come back), proves nothing. A new command in it waits: it is executed when a later
//!   timestamp comes with it.
//! - A timestamp that has been the same for more than 1 s is too old, whether it was fresh or not, and so is a new
//!   command in it.
//!
//! What the hold cannot judge is how long an uplink took to the DPR if it is the first of its writer in a while. The
//! writer's own radio link has to.
use bytemuck::{Pod, Zeroable};

use super::{Acknowledged, Answer, COMMAND_AGE_MS, Outcome};
use crate::{
    Uplink,
    criticality::{BaseStation, FlightController, Function, WritesUplink},
    wire::{F32Le, U16Le, U32Le},
};

/// The size of a command, bytes: the beginning of an uplink's payload.
pub const COMMAND_SIZE: usize = size_of::<WireCommand>();

/// The commands of a maker's hold.
pub trait Words: Sized {
    /// The command's word, which is not 0, and its value; 0.0 if it needs none.
    fn encode(&self) -> (u16, f32);

    /// The command with that word and value; `None` if the word is unknown.
    fn decode(word: u16, value: f32) -> Option<Self>;
}

/// A command on the wire.
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

    /// The command at the beginning of `payload`.
    fn of(payload: &[u8; Uplink::PAYLOAD]) -> Self {
        let (command, _) = payload.split_at(COMMAND_SIZE);
        *bytemuck::from_bytes(command)
    }

    fn command<C: Words>(&self) -> Option<C> {
        C::decode(self.word.get(), self.value.get()).filter(|_| self.reserved.get() == 0)
    }
}

/// What the hold made of a command that it was given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Executed {
    /// It was carried out.
    Done,
    /// The hold's own limits forbid it, and nothing was done.
    Refused,
}

/// A timestamp of a writer on the hold's clock.
#[derive(Clone, Copy, Debug)]
struct Seen {
    timestamp: u32,
    /// When it first came.
    since_ms: u64,
    /// Whether it was later than the one before it.
    is_later: bool,
}

/// What is known of the age of an uplink.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Age {
    Fresh,
    Unknown,
    TooOld,
}

/// What the hold remembers of a writer.
#[derive(Clone, Copy, Debug, Default)]
struct Memory {
    acknowledged: Acknowledged,
    seen: Option<Seen>,
}

impl Memory {
    /// The age of an uplink with `timestamp` that came at `now_ms`.
    fn age(&mut self, timestamp: u32, now_ms: u64) -> Age {
        let seen = match self.seen {
            Some(seen) if seen.timestamp == timestamp => seen,
            before => {
                let is_later = before.is_some_and(|before| timestamp.wrapping_sub(before.timestamp) <= u32::MAX / 2);
                Seen { timestamp, since_ms: now_ms, is_later }
            }
        };
        self.seen = Some(seen);
        if now_ms.saturating_sub(seen.since_ms) > u64::from(COMMAND_AGE_MS) {
            Age::TooOld
        } else if seen.is_later {
            Age::Fresh
        } else {
            Age::Unknown
        }
    }

    /// Executes and acknowledges the command in `uplink`, if there is one whose turn it is.
    fn take<C: Words>(&mut self, uplink: &Uplink, now_ms: u64, execute: impl FnOnce(C) -> Executed) {
        let age = self.age(uplink.timestamp(), now_ms);
        let command = WireCommand::of(&uplink.values().payload);
        let number = command.number.get();
        if command.word.get() == 0 || !is_newer(number, self.acknowledged.number()) {
            return;
        }
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

/// Whether `number` is 1 to 32767 ahead of `than`.
pub(super) const fn is_newer(number: u16, than: u16) -> bool {
    let ahead = number.wrapping_sub(than);
    ahead != 0 && ahead <= u16::MAX / 2
}

/// The hold's memory of the commands that it was given.
///
/// A command's sequence number is *new* if it is 1 to 32767 ahead of the writer's acknowledged one, which is 0 at the
/// hold's start. A new command is executed, refused, or found unknown or too old, and is acknowledged as such; neither
/// it nor one with a number behind it is new afterwards. The age of a command is judged by the progress of its writer's
/// timestamps on the hold's clock (docs/design.md#commands-to-the-hold): later ones are fresh, a timestamp that has
/// been the same for more than [`COMMAND_AGE_MS`] is too old, and the first one, or an earlier one, is unknown, so that
/// its command waits for a later timestamp.
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
    /// The state of a hold whose supply has come on.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The state of a hold that has kept its acknowledgements through a reset, in the order of
    /// [`WritesUplink::INDEX`]. A hold that has lost them may execute a command again that was executed before the
    /// reset and whose acknowledgement never reached the writer.
    #[must_use]
    pub const fn resume(acknowledged: [Acknowledged; 2]) -> Self {
        let [base_station, flight_controller] = acknowledged;
        Self {
            base_station: Memory { acknowledged: base_station, seen: None },
            flight_controller: Memory { acknowledged: flight_controller, seen: None },
        }
    }

    /// Executes each command in `answer` whose turn it is, that of the base station first. `now_ms` is the time since
    /// the hold's start. `execute` gets the writer and the command, and keeps the hold's limits.
    ///
    /// It is called for each answer that came; an uplink in it that is missing or not intact changes nothing.
    pub fn take<C: Words>(&mut self, answer: &Answer, now_ms: u64, mut execute: impl FnMut(Function, C) -> Executed) {
        // Both are verified before a command is executed, so that the work does not depend on the first.
        let uplinks = (answer.uplink::<BaseStation>(), answer.uplink::<FlightController>());
        if let Ok(uplink) = uplinks.0 {
            self.base_station.take(uplink, now_ms, |command| execute(Function::BaseStation, command));
        }
        if let Ok(uplink) = uplinks.1 {
            self.flight_controller.take(uplink, now_ms, |command| execute(Function::FlightController, command));
        }
    }

    /// The acknowledgements for the next Hold-Status, in the order of [`WritesUplink::INDEX`].
    #[must_use]
    pub const fn acknowledged(&self) -> [Acknowledged; 2] {
        [self.base_station.acknowledged, self.flight_controller.acknowledged]
    }
}

const _: () = assert!(BaseStation::INDEX == 0 && FlightController::INDEX == 1);

#[cfg(test)]
mod tests;
