//! Commands of the base station to drones' active holds: numbered, repeated until the hold acknowledges them, and
//! followed until their outcome is known.
//!
//! The rule is the profile's ([`Sender`]): a command is in each of the station's uplinks to that drone, each with a
//! later timestamp, until Hold-Status acknowledges its number. One command is under way for each drone. A command that
//! is given up after [`GIVES_UP_US`], or that meets a restart of the hold, is lost: it was executed once or not at all.
//! The first Hold-Status that does not continue the earlier ones ends the repetition, since it may be of a hold that
//! restarted and no longer knows what it acknowledged. If the command is acknowledged after that, its state changes
//! once more.
//!
//! The hold acknowledges numbers and does not know which station sent one. So only one station commands a drone's hold.
//! A station that has just started first waits for [`SETTLES_US`]. Otherwise the hold could acknowledge an uplink of
//! the station's earlier run, and the station could take that for the answer to its own command.

use std::collections::BTreeMap;

use profile::Uplink;
use profile::criticality::BaseStation;
use profile::hold::{HoldCommand, Outcome, Sender, Sent};

use super::not_sent::NotSent;
use crate::drone::hold::{HoldState, Presence};
use crate::{Drone, DroneId, Fleet};

/// The time from one uplink with a waiting command to the next, µs: two periods of the hold.
pub const AGAIN_US: u64 = 200_000;

/// How long a command is repeated without an acknowledgement, µs.
pub const GIVES_UP_US: u64 = 5_000_000;

/// The time from the station's first Hold-Status of a drone to its first command, µs: twice the
/// [age](profile::hold::COMMAND_AGE_MS) at which the DPR no longer hands an uplink to the hold.
pub const SETTLES_US: u64 = 2_000 * profile::hold::COMMAND_AGE_MS as u64;

/// The state of a command to a hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CommandState {
    /// The command is sent, and its outcome is not known.
    Pending,
    /// The hold has executed the command.
    Done,
    /// The hold's own limits forbid the command.
    Refused,
    /// The hold does not know the command's word.
    Unknown,
    /// The hold received the command too late.
    TooOld,
    /// The command is not sent any more. It was executed once or not at all.
    Lost,
}

impl CommandState {
    /// Every state.
    pub const ALL: [Self; 6] = [Self::Pending, Self::Done, Self::Refused, Self::Unknown, Self::TooOld, Self::Lost];

    /// Returns the name of the state for programs.
    #[must_use]
    pub const fn code(self) -> &'static str {
        match self {
            Self::Pending => "pending",
            Self::Done => "done",
            Self::Refused => "refused",
            Self::Unknown => "unknown",
            Self::TooOld => "too-old",
            Self::Lost => "lost",
        }
    }

    fn of(sent: Sent) -> Self {
        match sent {
            Sent::Nothing | Sent::Waiting(_) => Self::Pending,
            Sent::Lost(_) => Self::Lost,
            Sent::Answered(_, Outcome::Done) => Self::Done,
            Sent::Answered(_, Outcome::Refused) => Self::Refused,
            Sent::Answered(_, Outcome::TooOld) => Self::TooOld,
            Sent::Answered(_, Outcome::Nothing | Outcome::Unknown) => Self::Unknown,
        }
    }
}

/// A command to a drone's hold, with its state.
#[derive(Clone, Debug, PartialEq)]
pub struct CommandRecord {
    /// The name of the drone.
    pub drone: String,
    /// The sequence number of the command.
    pub number: u16,
    /// The command.
    pub command: HoldCommand,
    /// The state of the command to the hold.
    pub state: CommandState,
    /// The instant at which the command was given, µs.
    pub since_us: u64,
    /// The instant at which the command reached this state, µs.
    pub at_us: u64,
}

impl CommandRecord {
    /// Returns whether `other` is the same command, perhaps in another state.
    #[must_use]
    pub fn is_of(&self, other: &Self) -> bool {
        (self.number, self.since_us) == (other.number, other.since_us) && self.drone == other.drone
    }
}

/// Returns the command of this name (`set-point`, `lock`, `unlock`, `clear-shock`); `value`, °C, is that of a
/// set-point. `None` if there is no such command, or if a set-point has no value or another command has one.
#[must_use]
pub fn command(name: &str, value: Option<f32>) -> Option<HoldCommand> {
    match (name, value) {
        ("set-point", Some(celsius)) => Some(HoldCommand::SetPoint(celsius)),
        ("lock", None) => Some(HoldCommand::Lock),
        ("unlock", None) => Some(HoldCommand::Unlock),
        ("clear-shock", None) => Some(HoldCommand::ClearShock),
        _ => None,
    }
}

/// Returns the name of a command, as [`command`] reads it, and its value if it has one.
#[must_use]
pub const fn name(command: &HoldCommand) -> (&'static str, Option<f32>) {
    match *command {
        HoldCommand::SetPoint(celsius) => ("set-point", Some(celsius)),
        HoldCommand::Lock => ("lock", None),
        HoldCommand::Unlock => ("unlock", None),
        HoldCommand::ClearShock => ("clear-shock", None),
    }
}

#[derive(Debug)]
struct Line {
    sender: Sender<BaseStation>,
    /// The instants at which the first and the newest Hold-Status arrived, µs.
    first_us: u64,
    newest_us: u64,
    /// The instant at which the next uplink is due, µs.
    due_us: u64,
    last: Option<CommandRecord>,
    /// The value of [`HoldState::strange`] at the time when the last command was given.
    strange: u64,
}

/// The commands to all drones' holds. See the [module](self).
#[derive(Debug, Default)]
pub struct Commander {
    lines: BTreeMap<DroneId, Line>,
}

impl Commander {
    /// Begins to send a command to a drone's hold at `now_us`. Returns the command with its number.
    ///
    /// # Errors
    ///
    /// Returns why the command cannot be sent.
    pub fn send(
        &mut self,
        now_us: u64,
        fleet: &Fleet,
        drone: DroneId,
        command: HoldCommand,
    ) -> Result<CommandRecord, NotSent> {
        let hold = fleet.get(drone).ok_or(NotSent::UnknownDrone)?.hold();
        let hold = hold.filter(|hold| hold.presence(now_us) == Presence::Valid).ok_or(NotSent::NoHold)?;
        let line = self.lines.get_mut(&drone).ok_or(NotSent::NoHold)?;
        if now_us.saturating_sub(line.first_us) < SETTLES_US {
            return Err(NotSent::HoldIsNew);
        }
        let number = line.sender.send(&command).ok_or(NotSent::CommandWaits)?;
        let (state, since_us, at_us) = (CommandState::Pending, now_us, now_us);
        let record = CommandRecord { drone: drone.to_string(), number, command, state, since_us, at_us };
        line.last = Some(record.clone());
        (line.due_us, line.strange) = (now_us, hold.strange());
        Ok(record)
    }

    /// Reads the acknowledgements that have arrived until `now_us`, and passes each change of a command's state to
    /// `told`. Returns the drones to which an uplink is due, each with the uplink's payload.
    pub fn tick(
        &mut self,
        now_us: u64,
        fleet: &Fleet,
        mut told: impl FnMut(CommandRecord),
    ) -> Vec<(DroneId, [u8; Uplink::PAYLOAD])> {
        self.lines.retain(|drone, line| fleet.get(*drone).is_some() || matches!(line.sender.sent(), Sent::Waiting(_)));
        for (id, drone) in fleet.iter() {
            let object = drone.hold().and_then(|hold| Some((hold.object()?, hold.held().map(|held| held.arrived_us)?)));
            let Some((object, at_us)) = object else { continue };
            let (sender, last) = (Sender::new(), None);
            let new = Line { sender, first_us: at_us, newest_us: 0, due_us: 0, last, strange: 0 };
            let line = self.lines.entry(id).or_insert(new);
            if line.newest_us < at_us {
                line.newest_us = at_us;
                line.sender.observe(object.as_object());
            }
        }
        let mut due = vec![];
        for (drone, line) in &mut self.lines {
            let Some(last) = &mut line.last else { continue };
            let strange = fleet.get(*drone).and_then(Drone::hold).map_or(line.strange, HoldState::strange);
            if now_us.saturating_sub(last.since_us) > GIVES_UP_US || strange != line.strange {
                line.sender.give_up();
            }
            let state = CommandState::of(line.sender.sent());
            if state != last.state {
                (last.state, last.at_us) = (state, now_us);
                told(last.clone());
            }
            if state == CommandState::Pending && now_us >= line.due_us {
                line.due_us = now_us.saturating_add(AGAIN_US);
                let mut payload = [0; Uplink::PAYLOAD];
                line.sender.fill(&mut payload);
                due.push((*drone, payload));
            }
        }
        due
    }
}

#[cfg(test)]
mod tests;
