//! Tests an hour with a hostile neighbour, whose messages come beside those of three true drones. The neighbour's
//! messages are forged, replayed, reordered, truncated, oversized or from many senders. Time is virtual, and the
//! messages are drawn from a seed.

use crate::common;

use std::collections::BTreeMap;

use base_station::alarm::Alarm;
use base_station::carrier::mavlink::{Forwarder, Rates};
use base_station::fleet::MAX_DRONES;
use base_station::intake::{Carried, Intake, Kind};
use base_station::{Bundle, Drone};
use common::{Drawn, image};
use profile::{GpsValues, HorusState, Profile, ReportedStatus, ReportedValues, range};

const SECOND: u64 = 1_000_000;
const BEGIN: u64 = 1_790_000_000_000_000;
const HOUR: u64 = 3_600 * SECOND;
const PERIOD: u64 = 100_000;

/// The system id of each true drone, and how long its HORUS has been running at the beginning, ms.
const TRUE: [(u8, u32); 3] = [(1, 70_000), (2, 3_000_000), (3, 500)];

fn address(system: u32, port: u16) -> String {
    format!("10.0.{}.{}:{port}", system >> 8 & 0xFF, system & 0xFF)
}

fn messages(system: u8, image: &[u8]) -> Vec<Vec<u8>> {
    let mut forwarder = Forwarder::new(system, 1, Rates { bytes_per_s: 1_000_000, period_us: 0, standard_us: 0 });
    forwarder.offer(&Bundle::datagram(image).unwrap());
    std::iter::from_fn(|| forwarder.poll(SECOND, 0)).collect()
}

fn forged(drawn: &mut Drawn, timestamp: u32) -> Vec<u8> {
    let place = [(91.0, 8.0, 470.0), (47.0, f64::NAN, 1.0), (47.0, 500.0, 1.0), (47.0, 8.0, 1e300), (0.0, 0.0, 0.0)];
    let (latitude, longitude, altitude) = place[drawn.below(place.len() as u64) as usize];
    let state = [HorusState::EmergencyFired, HorusState::Monitoring][drawn.below(2) as usize];
    let status = ReportedStatus::new().with_position_valid(true).with_state(state);
    let absent = ReportedValues::absent(timestamp);
    let reported = ReportedValues { status, latitude, longitude, altitude, ..absent };
    let gps = GpsValues { latitude, longitude, altitude, ..GpsValues::absent(timestamp) };
    Profile::<3>::seal(&reported, &[gps; 3]).as_bytes().to_vec()
}

fn is_sound(drone: &Drone) -> bool {
    let valid = |status: bool, [latitude, longitude, altitude]: [f64; 3]| {
        !status || range::is_position(latitude, longitude, altitude)
    };
    drone.reported().is_none_or(|held| {
        let v = &held.values;
        valid(v.status.position_valid(), [v.latitude, v.longitude, v.altitude])
    }) && (1..=5).filter_map(|receiver| drone.gps(receiver)).all(|held| {
        let v = &held.values;
        valid(v.status.position_valid(), [v.latitude, v.longitude, v.altitude])
    })
}

fn memory() -> u64 {
    let pages = std::fs::read_to_string("/proc/self/statm").unwrap();
    pages.split(' ').nth(1).unwrap().parse::<u64>().unwrap() * 4_096
}

struct Hour {
    intake: Intake,
    drawn: Drawn,
    now: u64,
    /// The messages that are still on their way, by the instant of arrival and a serial number, with source and bytes.
    on_the_way: BTreeMap<(u64, u64), (String, Vec<u8>)>,
    count: u64,
    kept: Vec<(String, Vec<u8>)>,
}

impl Hour {
    fn send(&mut self, after: u64, from: String, bytes: Vec<u8>) {
        self.count += 1;
        self.on_the_way.insert((self.now + after, self.count), (from, bytes));
    }

    fn time(&self, began: u32) -> u32 {
        began + u32::try_from((self.now - BEGIN) / 10_000).unwrap() * 10
    }

    fn fly(&mut self, hostile: bool) {
        for (system, began) in TRUE {
            for message in messages(system, &image(self.time(began))) {
                let from = address(system.into(), 14_550);
                if hostile && self.drawn.below(50) == 0 {
                    self.kept.push((from.clone(), message.clone()));
                }
                let late = if hostile && self.drawn.below(20) == 0 { self.drawn.below(900_000) } else { 0 };
                self.send(late, from, message);
            }
        }
        let many = self.kept.len().saturating_sub(500);
        self.kept.drain(..many);
    }

    fn attack(&mut self) {
        let (system, began) = TRUE[self.drawn.below(3) as usize];
        let own = address(system.into(), 14_550);
        let from =
            if self.drawn.below(2) == 0 { own.clone() } else { address(200, 1_000 + self.drawn.below(50) as u16) };
        let time = self.time(began);
        match self.drawn.below(8) {
            0 => {
                let ahead = [1_900, 10 * self.drawn.below(1 << 24) as u32][self.drawn.below(2) as usize];
                for bytes in messages(system, &forged(&mut self.drawn, time.wrapping_add(ahead))) {
                    self.send(0, from.clone(), bytes);
                }
            }
            1 => {
                let first = 10 * self.drawn.below(1 << 26) as u32;
                for burst in 0..3 {
                    for bytes in messages(system, &forged(&mut self.drawn, first + 10 * burst)) {
                        self.send(u64::from(burst), from.clone(), bytes);
                    }
                }
            }
            2 | 3 => {
                let Some(at) = (self.kept.len() as u64).checked_sub(1).map(|last| self.drawn.below(last + 1)) else {
                    return;
                };
                let (replayed, bytes) = self.kept[at as usize].clone();
                self.send(0, if from == own { replayed } else { from }, bytes);
            }
            4 => {
                let mut bytes = messages(system, &image(time)).swap_remove(0);
                bytes.truncate(self.drawn.below(bytes.len() as u64) as usize);
                self.send(0, from, bytes);
            }
            5 => {
                let length = [2_049, 9_000, 65_507][self.drawn.below(3) as usize];
                self.send(0, from, vec![0xFD; length]);
            }
            6 => {
                let bytes = (0..self.drawn.below(300)).map(|_| self.drawn.next() as u8).collect();
                self.send(0, from, bytes);
            }
            _ => {
                for _ in 0..8 {
                    let (invented, port) = (4 + self.drawn.below(250) as u8, self.drawn.below(60_000) as u16);
                    let time = 10 * self.drawn.below(1 << 20) as u32;
                    let bytes = messages(invented, &forged(&mut self.drawn, time)).swap_remove(0);
                    let from = address(self.drawn.below(65_536) as u32, port);
                    self.send(0, from, bytes);
                }
            }
        }
    }

    fn arrive(&mut self) {
        while let Some(first) = self.on_the_way.first_entry().filter(|first| first.key().0 <= self.now) {
            let at_us = first.key().0;
            let (from, bytes) = first.remove();
            for judged in self.intake.take(&Carried { at_us, kind: Kind::MavlinkDatagrams, line: 0, from, bytes }) {
                if let Some(drone) = self.intake.fleet().get(judged.drone) {
                    assert!(is_sound(drone), "{} at {at_us}: {}", judged.drone, drone.words(at_us));
                }
            }
        }
        if self.now.is_multiple_of(SECOND) {
            self.intake.tick(self.now);
        }
    }

    fn is_shown_true(&self, system: u8, began: u32) -> bool {
        let time = self.time(began);
        let sent = image(time);
        self.intake.fleet().iter().any(|(id, drone)| {
            let own = id.who.to_string() == system.to_string();
            let held = drone.reported().filter(|held| own && held.timestamp == time);
            held.is_some_and(|held| {
                !drone.alarms_at(self.now).has(Alarm::Stale)
                    && held.values.latitude.to_le_bytes() == sent[40..48]
                    && held.values.status.state() == Some(HorusState::Monitoring)
            })
        })
    }
}

#[test]
fn after_a_hostile_hour_the_true_drones_are_shown_true() {
    let intake = Intake::default();
    let (kept, on_the_way) = (vec![], BTreeMap::new());
    let mut hour = Hour { intake, drawn: Drawn(23), now: BEGIN, on_the_way, count: 0, kept };
    let mut after_ten_minutes = 0;
    let (mut shown, mut of) = (0_u32, 0_u32);
    while hour.now < BEGIN + HOUR {
        let hostile = hour.now > BEGIN + 5 * SECOND;
        hour.fly(hostile);
        for _ in 0..if hostile { 4 } else { 0 } {
            hour.attack();
        }
        hour.arrive();
        for (system, began) in TRUE {
            (shown, of) = (shown + u32::from(hour.is_shown_true(system, began)), of + 1);
        }
        if hour.now == BEGIN + 600 * SECOND {
            after_ten_minutes = memory();
        }
        hour.now += PERIOD;
    }
    let grown = memory().saturating_sub(after_ten_minutes);
    hour.on_the_way.clear();
    let ended = hour.now;
    while hour.now <= ended + 2 * SECOND {
        hour.fly(false);
        hour.arrive();
        hour.now += PERIOD;
    }
    hour.now -= PERIOD;
    for (system, began) in TRUE {
        assert!(hour.is_shown_true(system, began), "{system}");
    }
    let fleet = hour.intake.fleet();
    println!(
        "true in {shown} of {of} looks, {} drones, {} dropped, {} refused, {:?}, memory grew by {} kB",
        fleet.iter().len(),
        fleet.dropped(),
        fleet.refused(),
        hour.intake.refused(),
        grown >> 10
    );
    assert!(fleet.iter().len() <= MAX_DRONES && fleet.dropped() > 10_000);
    let refused = hour.intake.refused();
    assert!(refused.oversized > 1_000 && refused.bad_crc + refused.malformed + refused.foreign < 100_000);
    assert!(grown < 16 << 20, "{} kB", grown >> 10);
    let told = TRUE.iter().all(|(system, _)| {
        fleet.iter().any(|(id, drone)| {
            id.who.to_string() == system.to_string() && drone.alarms_at(ended).has(Alarm::TwoSenders)
        })
    });
    assert!(told && f64::from(shown) > 0.5 * f64::from(of), "{shown} of {of}");
}
