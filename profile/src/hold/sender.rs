//! The writer's end of the commands to the hold: it numbers commands and repeats them until they are acknowledged.
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
    /// The command with this number is sent in every uplink until the hold acknowledges it.
    Waiting(u16),
    /// The hold has acknowledged the command with this number, with this outcome.
    Answered(u16, Outcome),
    /// The command with this number is no longer sent. It was executed once or not at all. A late acknowledgement
    /// changes the state to [`Answered`](Self::Answered).
    Lost(u16),
}

/// The commands of role `W` to the hold, one at a time.
///
/// Pass each object of the hold that was read to [`Sender::observe`]. Before each uplink is sealed, [`Sender::fill`]
/// puts the command into its payload; each uplink needs a later timestamp. The hold may need two uplinks to see that
/// the first was not an old one, and executes the command once. [`Sender::give_up`] ends the repetition.
#[derive(Clone, Debug)]
pub struct Sender<W> {
    sent: Sent,
    command: [u8; COMMAND_SIZE],
    /// The timestamp of the hold's last object, and the number of the command that this object acknowledges.
    hold: Option<(u32, u16)>,
    number: Option<u16>,
    writer: PhantomData<W>,
}

impl<W: WritesUplink> Sender<W> {
    /// A writer that has not read an object of the hold yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { sent: Sent::Nothing, command: [0; COMMAND_SIZE], hold: None, number: None, writer: PhantomData }
    }

    /// Reads the acknowledgement in an object of the hold. The command that waits is lost if the hold has restarted, or
    /// has acknowledged a later command.
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

    /// Sends `command` from now on and returns its number. Returns `None`, and sends nothing, while another command is
    /// waiting or before an object of the hold was read: the number must follow the acknowledged one.
    pub fn send<C: Words>(&mut self, command: &C) -> Option<u16> {
        let (_, acknowledged) = self.hold.filter(|_| !matches!(self.sent, Sent::Waiting(_)))?;
        let last = self.number.filter(|number| is_newer(*number, acknowledged)).unwrap_or(acknowledged);
        let number = last.wrapping_add(1);
        self.number = Some(number);
        self.command = bytemuck::must_cast(WireCommand::new(number, command));
        self.sent = Sent::Waiting(number);
        Some(number)
    }

    /// Stops sending the command that waits. The command is then lost.
    pub const fn give_up(&mut self) {
        if let Sent::Waiting(number) = self.sent {
            self.sent = Sent::Lost(number);
        }
    }

    /// Puts the command that waits, or zeros if there is none, at the beginning of an uplink's payload.
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
