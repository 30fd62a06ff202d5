//! The state of a station: what has arrived, what is kept of it, and how the kept data are formatted for the page.
//!
//! This module has neither clock nor I/O, so that `live` and a page without a server can both use it.

pub mod history;
mod hold;
pub mod state;

use std::collections::VecDeque;

use crate::carrier::mavlink::Voice;
use crate::carrier::mavlink::commander::CommandRecord;
use crate::intake::{Carried, Intake, Judged, Kind};
use crate::recording::{Made, Trouble};
use crate::{Bundle, Change, DroneId, Verdict};
use history::History;

/// The number of alarm changes that are kept for the page.
pub const KEPT_CHANGES: usize = 100;

/// The number of commands to holds that are kept for the page.
pub const KEPT_COMMANDS: usize = 100;

/// The state of a station.
#[derive(Debug, Default)]
pub struct StationData {
    /// All lines and drones from which data arrive.
    pub intake: Intake,
    /// The last minutes of all drones.
    pub history: History,
    /// The alarms of all drones that began or ended, the newest last: at most [`KEPT_CHANGES`].
    pub alarms: VecDeque<(DroneId, Change)>,
    /// The station's commands to holds with their present states, the newest last: at most [`KEPT_COMMANDS`].
    pub commands: VecDeque<CommandRecord>,
    /// The lines that do not work, each with its error.
    pub lines: Vec<(String, String)>,
    /// The files of the recording, if there is one.
    pub recording: Option<Made>,
    /// The reason why nothing is recorded although it should be.
    pub recorder: Option<Trouble>,
    /// The station's own messages, if enabled.
    pub voice: Option<Voice>,
    /// The instant, µs, up to which the state is complete.
    pub now_us: u64,
}

impl StationData {
    /// Judges what arrived on a line, and keeps what is accepted. `told` gets the objects of each message of a known
    /// drone, with the verdicts.
    pub fn take(&mut self, carried: &Carried, told: impl FnMut(DroneId, &Bundle<'_>, &[Verdict])) -> Vec<Judged> {
        let judged = self.intake.take_each(carried, |_, _| true, told);
        self.now_us = self.now_us.max(carried.at_us);
        self.look();
        if let (Some(voice), Kind::MavlinkDatagrams, Ok(from)) = (&mut self.voice, carried.kind, carried.from.parse()) {
            voice.heard(carried.line, from, carried.at_us);
        }
        judged
    }

    /// Brings the state to `now_us`, and returns the alarms that began or ended. The history stays as it is.
    pub fn tick(&mut self, now_us: u64) -> Vec<(DroneId, Change)> {
        self.now_us = now_us;
        let changes = self.intake.tick(now_us);
        for (drone, change) in &changes {
            self.note(*drone, *change);
        }
        changes
    }

    pub(crate) fn note(&mut self, drone: DroneId, change: Change) {
        if self.alarms.len() == KEPT_CHANGES {
            self.alarms.pop_front();
        }
        self.alarms.push_back((drone, change));
    }

    #[cfg(feature = "command")]
    pub(crate) fn note_command(&mut self, told: CommandRecord) {
        if let Some(known) = self.commands.iter_mut().find(|known| known.is_of(&told)) {
            *known = told;
            return;
        }
        if self.commands.len() == KEPT_COMMANDS {
            self.commands.pop_front();
        }
        self.commands.push_back(told);
    }

    /// Adds to the history what is due now.
    pub fn look(&mut self) {
        self.history.look(self.now_us, self.intake.fleet());
    }
}
