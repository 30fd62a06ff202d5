//! Keeps all drones from which messages arrive.
//!
//! **A drone is identified by its id and its sender.** Two drones with one MAVLink system id, or an attacker who forges
//! one, are two senders. Each is judged and shown separately (`7` and `7-2`), and both have the alarm
//! [`TwoSenders`](crate::Alarm::TwoSenders). Messages belong to another sender if they come from elsewhere ([`Source`])
//! or do not continue the earlier ones ([`order`](crate::drone::order)).
//!
//! **The fleet cannot be flooded.** There are at most [`MAX_DRONES`] drones and [`MAX_SENDERS`] senders for each id.
//! When there is no room, a sender of fewer than [`SEARCH_CYCLES`] messages is dropped first. Other senders are dropped
//! only after [`SILENT_US`] of silence, the one with the longest silence first.
//!
//! **A drone whose address changed** becomes a new sender. Its silent earlier sender is dropped after [`RECENT_US`] if
//! both senders' HORUS started at the same instant.

use core::fmt;
use std::collections::BTreeMap;
use std::net::SocketAddr;

use crate::carrier::published::Name;
use crate::drone::order::{SEARCH_CYCLES, SLACK_US};
use crate::drone::{RECENT_US, SILENT_US};
use crate::{Bundle, Change, Drone, Place, Verdict};

/// The greatest number of drones that are kept.
pub const MAX_DRONES: usize = 4_096;

/// The greatest number of senders with one drone's id that are kept.
pub const MAX_SENDERS: u8 = 4;

/// The drone that a message is about, by the id that the message's carrier states.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Who {
    /// The drone's MAVLink system id.
    System(u32),
    /// The address from which the drone's datagrams come.
    Address(SocketAddr),
    /// The number of the serial port without MAVLink over which the drone's messages come.
    Line(u16),
    /// The name under which another base station publishes the drone.
    Named(Name),
}

impl Who {
    /// Returns the id of the drone of the first sender that uses this id.
    #[must_use]
    pub const fn first(self) -> DroneId {
        DroneId { who: self, sender: 1 }
    }
}

impl fmt::Display for Who {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::System(id) => write!(f, "{id}"),
            Self::Address(address) => write!(f, "{address}"),
            Self::Line(number) => write!(f, "line{number}"),
            Self::Named(name) => f.write_str(name.as_str()),
        }
    }
}

/// Identifies a drone: by the id that its carrier states, and by the sender among those that use this id.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct DroneId {
    /// The id that the sender states for its drone.
    pub who: Who,
    /// The number of the sender, from 1, in the order in which the senders of this id appeared.
    pub sender: u8,
}

impl fmt::Display for DroneId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.sender {
            1 => write!(f, "{}", self.who),
            sender => write!(f, "{}-{sender}", self.who),
        }
    }
}

/// The source of a sender's messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Source {
    /// The number of the line over which the messages come.
    pub line: u16,
    /// The address from which the messages come, if the line has addresses.
    pub from: Option<SocketAddr>,
    /// The MAVLink component id in the messages.
    pub component: u8,
    /// Whether each message has a signature of the station's key.
    pub signed: bool,
}

#[derive(Clone, Debug)]
struct Sender {
    source: Source,
    drone: Drone,
}

impl Sender {
    fn worth(&self) -> (bool, u64) {
        (self.drone.counts().messages >= u64::from(SEARCH_CYCLES), self.drone.heard_us())
    }

    fn may_go(&self, at_us: u64) -> bool {
        let (often, heard_us) = self.worth();
        !often || at_us.saturating_sub(heard_us) > SILENT_US
    }
}

/// The drones that are kept. See the [module](self).
#[derive(Clone, Debug, Default)]
pub struct Fleet {
    drones: BTreeMap<DroneId, Sender>,
    refused: u64,
    dropped: u64,
}

impl Fleet {
    /// Passes a message's objects, which arrived at `at_us`, to the drone that sent them. Returns the drone and the
    /// verdict on each object. There are no verdicts if there is no room for another drone, or if an unknown drone
    /// brought no intact object. Hold-Status alone makes neither a new drone nor a second sender of a known one.
    pub fn take(&mut self, who: Who, source: Source, at_us: u64, bundle: &Bundle<'_>) -> (DroneId, Vec<Verdict>) {
        let mine: Vec<DroneId> = self.of(who).filter(|(_, sender)| sender.source == source).map(|(id, _)| id).collect();
        let fits = |id: &&DroneId| self.drones.get(id).is_some_and(|sender| sender.drone.fits(at_us, bundle));
        // If this id and source have a single sender, the message goes to that sender, whose own state then tells
        // whether another sender sent it.
        let fitting = mine.iter().find(|id| mine.len() == 1 || fits(id)).or(mine.first()).copied();
        if bundle.objects().all(|(place, _)| place == Place::Hold) {
            let sender = fitting.and_then(|id| Some((id, self.drones.get_mut(&id)?)));
            let taken = sender.map(|(id, sender)| (id, sender.drone.take_bundle(at_us, bundle)));
            return taken.unwrap_or_else(|| (who.first(), vec![]));
        }
        if let Some((id, sender)) = fitting.and_then(|id| self.drones.get_mut(&id).map(|sender| (id, sender))) {
            let verdicts = sender.drone.take_bundle(at_us, bundle);
            if !sender.drone.met_stranger() {
                self.note_rivals(id, at_us, &verdicts);
                return (id, verdicts);
            }
        }
        let mut drone = Drone::new(at_us);
        let verdicts = drone.take_bundle(at_us, bundle);
        if !verdicts.iter().any(|verdict| verdict.is_intact()) {
            return (who.first(), verdicts);
        }
        match self.room(who, at_us) {
            Some(id) => {
                self.drones.insert(id, Sender { source, drone });
                self.note_rivals(id, at_us, &verdicts);
                (id, verdicts)
            }
            None => {
                self.refused += 1;
                (who.first(), vec![])
            }
        }
    }

    fn of(&self, who: Who) -> impl Iterator<Item = (DroneId, &Sender)> {
        let all = who.first()..=DroneId { who, sender: u8::MAX };
        self.drones.range(all).map(|(id, sender)| (*id, sender))
    }

    fn note_rivals(&mut self, id: DroneId, at_us: u64, verdicts: &[Verdict]) {
        if !verdicts.iter().any(|verdict| verdict.is_intact()) {
            return;
        }
        let heard = |sender: &Sender| at_us.saturating_sub(sender.drone.heard_us()) <= RECENT_US;
        let rivals: Vec<_> = self.of(id.who).filter(|(_, sender)| heard(sender)).map(|(rival, _)| rival).collect();
        if rivals.iter().any(|rival| *rival != id) {
            for rival in rivals {
                if let Some(sender) = self.drones.get_mut(&rival) {
                    sender.drone.note_rival(at_us);
                }
            }
        }
    }

    fn room(&mut self, who: Who, at_us: u64) -> Option<DroneId> {
        let least = |senders: &mut dyn Iterator<Item = (DroneId, &Sender)>| {
            senders
                .filter(|(_, sender)| sender.may_go(at_us))
                .min_by_key(|(_, sender)| sender.worth())
                .map(|(id, _)| id)
        };
        if self.of(who).count() >= usize::from(MAX_SENDERS) {
            let id = least(&mut self.of(who))?;
            self.drop_one(id);
        } else if self.drones.len() >= MAX_DRONES {
            let id = least(&mut self.drones.iter().map(|(id, sender)| (*id, sender)))?;
            self.drop_one(id);
        }
        (1..=MAX_SENDERS).map(|sender| DroneId { who, sender }).find(|id| !self.drones.contains_key(id))
    }

    fn drop_one(&mut self, id: DroneId) {
        self.drones.remove(&id);
        self.dropped += 1;
    }

    /// Returns the state of a drone.
    #[must_use]
    pub fn get(&self, id: DroneId) -> Option<&Drone> {
        self.drones.get(&id).map(|sender| &sender.drone)
    }

    /// Returns the source of a drone's messages.
    #[must_use]
    pub fn source(&self, id: DroneId) -> Option<Source> {
        self.drones.get(&id).map(|sender| sender.source)
    }

    /// Returns all drones, in the order of their ids.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (DroneId, &Drone)> {
        self.drones.iter().map(|(id, sender)| (*id, &sender.drone))
    }

    /// Updates every drone's alarms to `now_us`. Returns the alarms that began or ended.
    pub fn tick(&mut self, now_us: u64) -> Vec<(DroneId, Change)> {
        let moved: Vec<_> = self.drones.iter().filter(|(id, sender)| self.has_moved(**id, sender, now_us)).collect();
        let moved: Vec<_> = moved.into_iter().map(|(id, _)| *id).collect();
        let mut changes = vec![];
        for id in moved {
            let raised =
                self.drones.remove(&id).into_iter().flat_map(|sender| sender.drone.raised().collect::<Vec<_>>());
            changes.extend(raised.map(|over| (id, Change { alarm: over.alarm, raised: false, at_us: now_us })));
        }
        for (id, sender) in &mut self.drones {
            changes.extend(sender.drone.tick(now_us).into_iter().map(|change| (*id, change)));
        }
        changes
    }

    /// Returns whether a sender is silent while another sender with its id continues the data of the same HORUS.
    fn has_moved(&self, id: DroneId, sender: &Sender, now_us: u64) -> bool {
        let silent = |sender: &Sender, span_us| now_us.saturating_sub(sender.drone.heard_us()) > span_us;
        let same = |other: &Sender| {
            let started = sender.drone.started_us().zip(other.drone.started_us());
            started.is_some_and(|(one, other)| one.abs_diff(other) <= SLACK_US)
        };
        silent(sender, RECENT_US)
            && self.of(id.who).any(|(other, goes_on)| other != id && !silent(goes_on, SILENT_US) && same(goes_on))
    }

    /// Returns the number of messages with intact objects that were refused because the fleet was full.
    #[must_use]
    pub const fn refused(&self) -> u64 {
        self.refused
    }

    /// Returns the number of drones that were dropped to make room for others.
    #[must_use]
    pub const fn dropped(&self) -> u64 {
        self.dropped
    }
}

#[cfg(test)]
mod tests;
