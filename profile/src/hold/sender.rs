//! The end of a writer of commands to the hold: it numbers commands and repeats them until they are acknowledged.
use core::marker::PhantomData;

use super::{
    COMMAND_SIZE, HoldObject, Outcome, Words,
    commands::{WireCommand, is_newer},
};
use crate::{Uplink, criticality::WritesUplink};

/// The state of the last command that was sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Sent {
    /// No command was sent.
    #[default]
    Nothing,
    /// The command with this number is put in every uplink, and is not acknowledged yet.
    Waiting(u16),
    /// The hold has acknowledged the command with this number; this is final.
    Answered(u16, Outcome),
    /// The command with this number is no longer sent, and was not acknowledged: it was executed once or not at all. If
    /// its acknowledgement still comes, the state becomes [`Answered`](Self::Answered).
    Lost(u16),
}

/// The commands of role `W` to the hold, one at a time.
///
/// Each object of the hold that was read is passed to [`Sender::observe`], and [`Sender::fill`] puts the command into
/// the payload of every uplink that is written, each with a later timestamp. The hold executes a command once, however
/// often it comes; it may need a second uplink to detect that the first was not an old one. The caller decides how long
/// the command is repeated, and ends that with [`Sender::give_up`].
#[derive(Clone, Debug)]
pub struct Sender<W> {
    sent: Sent,
    /// The bytes of the command that is waiting.
    command: [u8; COMMAND_SIZE],
    /// The timestamp of the last object of the hold, and the number that it acknowledged.
    hold: Option<(u32, u16)>,
    /// The number of the last command that was sent.
    number: Option<u16>,
    writer: PhantomData<W>,
}

impl<W: WritesUplink> Sender<W> {
    /// A writer that has not read an object of the hold yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { sent: Sent::Nothing, command: [0; COMMAND_SIZE], hold: None, number: None, writer: PhantomData }
    }

    /// Takes the acknowledgement from an object of the hold. A waiting command becomes lost if the hold has restarted,
    /// or has acknowledged a later command.
    pub fn observe(&mut self, object: &HoldObject) {
        let acknowledged = object.acknowledged::<W>();
        let behind = self.hold.map_or(0, |(before, _)| before.wrapping_sub(object.timestamp()));
        let restarted = behind != 0 && behind <= u32::MAX / 2;
        self.hold = Some((object.timestamp(), acknowledged.number()));
        let (Sent::Waiting(number) | Sent::Lost(number)) = self.sent else { return };
        self.sent = match acknowledged.outcome() {
            Some(outcome) if acknowledged.number() == number && outcome != Outcome::Nothing => {
                Sent::Answered(number, outcome)
            }
            _ if restarted || is_newer(acknowledged.number(), number) => Sent::Lost(number),
            _ => self.sent,
        };
    }

    /// Sends `command` from now on, and returns its number. Returns `None`, and sends nothing, while another command is
    /// waiting, or before an object of the hold was read, since the number must follow the acknowledged one.
    pub fn send<C: Words>(&mut self, command: &C) -> Option<u16> {
        let (_, acknowledged) = self.hold.filter(|_| !matches!(self.sent, Sent::Waiting(_)))?;
        let last = self.number.filter(|number| is_newer(*number, acknowledged)).unwrap_or(acknowledged);
        let number = last.wrapping_add(1);
        self.number = Some(number);
        self.command = bytemuck::must_cast(WireCommand::new(number, command));
        self.sent = Sent::Waiting(number);
        Some(number)
    }

    /// Stops sending the command that is waiting: it is lost.
    pub const fn give_up(&mut self) {
        if let Sent::Waiting(number) = self.sent {
            self.sent = Sent::Lost(number);
        }
    }

    /// Puts the waiting command, or zeros without one, at the beginning of an uplink's payload. The rest is unchanged.
    pub fn fill(&self, payload: &mut [u8; Uplink::PAYLOAD]) {
        let (place, _) = payload.split_at_mut(COMMAND_SIZE);
        let waiting = matches!(self.sent, Sent::Waiting(_));
        place.copy_from_slice(if waiting { &self.command } else { &[0; COMMAND_SIZE] });
    }

    /// The state of the last command.
    #[must_use]
    pub const fn sent(&self) -> Sent {
        self.sent
    }
}

impl<W: WritesUplink> Default for Sender<W> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests;
