//! All drones of which something arrives.

use core::fmt;
use std::collections::BTreeMap;
use std::net::SocketAddr;

use crate::carrier::published::Name;
use crate::{Bundle, Change, Drone, Verdict};

/// How many drones are kept. Further ones are counted and not shown, so that strangers cannot fill the memory.
pub const MAX_DRONES: usize = 4_096;

/// Which drone it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum DroneId {
    /// By its MAVLink system id. Several carriers that bring objects of one system id bring those of one drone.
    System(u32),
    /// By where its datagrams come from.
    Address(SocketAddr),
    /// By the name of the line that it is at the other end of: the number of a serial port without MAVLink.
    Line(u16),
    /// By its name, since another base station hears it.
    Named(Name),
}

impl fmt::Display for DroneId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::System(id) => write!(f, "{id}"),
            Self::Address(address) => write!(f, "{address}"),
            Self::Line(number) => write!(f, "line{number}"),
            Self::Named(name) => f.write_str(name.as_str()),
        }
    }
}

/// All drones. See the [module](self).
#[derive(Clone, Debug, Default)]
pub struct Fleet {
    drones: BTreeMap<DroneId, Drone>,
    refused: u64,
}

impl Fleet {
    /// Takes a message's objects, which arrived at `at_us`. Answers what was found of each, in their order; nothing if
    /// there is no room for another drone, or if it is one that was not heard before and brought nothing intact.
    pub fn take(&mut self, id: DroneId, at_us: u64, bundle: &Bundle<'_>) -> Vec<Verdict> {
        if let Some(drone) = self.drones.get_mut(&id) {
            return drone.take_bundle(at_us, bundle);
        }
        // Only an intact object shows that there is a drone at all.
        let mut drone = Drone::new(at_us);
        let verdicts = drone.take_bundle(at_us, bundle);
        let known = verdicts.iter().any(|verdict| verdict.is_intact());
        if known && self.drones.len() < MAX_DRONES {
            self.drones.insert(id, drone);
            return verdicts;
        }
        self.refused += u64::from(known);
        if known { vec![] } else { verdicts }
    }

    /// What is known of a drone.
    #[must_use]
    pub fn get(&self, id: DroneId) -> Option<&Drone> {
        self.drones.get(&id)
    }

    /// All drones, in the order of their ids.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (DroneId, &Drone)> {
        self.drones.iter().map(|(id, drone)| (*id, drone))
    }

    /// Brings every drone's alarms up to `now_us`. Answers what changed.
    pub fn tick(&mut self, now_us: u64) -> Vec<(DroneId, Change)> {
        let of = |(id, drone): (&DroneId, &mut Drone)| {
            let id = *id;
            drone.tick(now_us).into_iter().map(move |change| (id, change))
        };
        self.drones.iter_mut().flat_map(of).collect()
    }

    /// Messages with intact objects that were refused because there are [`MAX_DRONES`] already.
    #[must_use]
    pub const fn refused(&self) -> u64 {
        self.refused
    }
}

#[cfg(test)]
mod tests {
    use profile::{GpsValues, Profile, ReportedValues};

    use super::*;

    fn profile(timestamp: u32) -> Profile<1> {
        Profile::seal(&ReportedValues::absent(timestamp), &[GpsValues::absent(timestamp)])
    }

    #[test]
    fn drones_are_kept_apart_and_strangers_make_none() {
        let mut fleet = Fleet::default();
        let (first, second) = (profile(500), profile(10));
        let take = |fleet: &mut Fleet, id, bytes: &[u8]| fleet.take(id, 0, &Bundle::datagram(bytes).unwrap());
        assert_eq!(take(&mut fleet, DroneId::System(1), first.as_bytes()), [Verdict::New; 2]);
        assert_eq!(take(&mut fleet, DroneId::System(2), second.as_bytes()), [Verdict::New; 2]);
        assert!(take(&mut fleet, DroneId::System(3), &[7; 124]).iter().all(|verdict| !verdict.is_intact()));
        assert_eq!(fleet.iter().map(|(id, _)| id).collect::<Vec<_>>(), [DroneId::System(1), DroneId::System(2)]);
        assert_eq!(fleet.get(DroneId::System(2)).and_then(Drone::timestamp), Some(10));
    }

    #[test]
    fn there_are_never_more_than_the_most() {
        let mut fleet = Fleet::default();
        let sent = profile(10);
        for id in 0..MAX_DRONES as u32 + 3 {
            fleet.take(DroneId::System(id), 0, &Bundle::datagram(sent.as_bytes()).unwrap());
        }
        assert_eq!((fleet.iter().len(), fleet.refused()), (MAX_DRONES, 3));
    }
}
