//! Keeps the last minutes of every drone, for a page that is opened later.
//!
//! Each sample has the drone's position. It also has the greatest age of the data and the least number of agreeing
//! receivers since the last sample, so that a brief fault shows. Samples are stored every [`PERIOD_US`] and kept for
//! [`KEPT_US`].
//!
//! **Bound.** Each drone has 602 samples of at most [`SAMPLE_BYTES`] bytes: 58 kB for a drone, 58 MB for a thousand,
//! and 237 MB for the greatest number of drones that are kept ([`MAX_DRONES`](crate::fleet::MAX_DRONES)). A drone with
//! an active hold has as many [samples of the hold](HoldSample), 25 kB more. Positions are in 1e-7 degrees (1 cm),
//! since they are only drawn.

use std::collections::{BTreeMap, VecDeque};

use profile::MAX_RECEIVERS;

use crate::drone::hold::Presence;
use crate::drone::{OLD_US, STALE_US};
use crate::{Drone, DroneId, Fleet};

/// The time from one sample to the next, µs.
pub const PERIOD_US: u64 = 1_000_000;

/// The time for which samples are kept, µs.
pub const KEPT_US: u64 = 600_000_000;

const SAMPLES: usize = (KEPT_US / PERIOD_US) as usize + 2;

/// The greatest size of a sample, bytes.
pub const SAMPLE_BYTES: usize = 96;

const _: () = assert!(size_of::<Sample>() <= SAMPLE_BYTES);

const LOOK_US: u64 = 20_000;

type Place = [i32; 2];

/// The state of a drone at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// The instant of the sample, µs of the station's clock.
    pub at_us: u64,
    voted: Option<Place>,
    gps: [Option<Place>; MAX_RECEIVERS],
    /// The reported height, m; NaN if it was invalid or stale.
    height: f32,
    age: f32,
    agree: Option<u8>,
}

impl Sample {
    fn of(drone: &Drone, now_us: u64) -> Self {
        let reported = drone.reported();
        let young = reported.filter(|held| held.age_us(now_us) <= STALE_US);
        let valid = young.filter(|held| held.values.status.position_valid()).map(|held| &held.values);
        let gps = |receiver: usize| {
            let held = drone.gps(receiver + 1).filter(|held| held.age_us(now_us) <= OLD_US)?;
            held.values.status.position_valid().then(|| place(held.values.latitude, held.values.longitude))
        };
        Self {
            at_us: now_us,
            voted: valid.map(|values| place(values.latitude, values.longitude)),
            gps: std::array::from_fn(gps),
            height: valid.map_or(f32::NAN, |values| values.altitude as f32),
            age: reported.map_or(f32::NAN, |held| held.age_us(now_us) as f32 / 1e6),
            agree: young.map(|held| held.values.status.receivers_agreeing()),
        }
    }

    /// Returns the reported latitude and longitude, degrees, if they were valid and not stale.
    #[must_use]
    pub fn voted(&self) -> Option<[f64; 2]> {
        self.voted.map(degrees)
    }

    /// Returns the latitude and longitude, degrees, of the first `receivers` receivers; `None` for a receiver whose
    /// position was invalid or old.
    pub fn gps(&self, receivers: usize) -> impl Iterator<Item = Option<[f64; 2]>> {
        self.gps.into_iter().take(receivers).map(|place| place.map(degrees))
    }

    /// Returns the reported height, m.
    #[must_use]
    pub fn height(&self) -> Option<f32> {
        Some(self.height).filter(|height| !height.is_nan())
    }

    /// Returns the greatest age of the reported position since the last sample, s.
    #[must_use]
    pub fn age(&self) -> Option<f32> {
        Some(self.age).filter(|age| !age.is_nan())
    }

    /// Returns the least number of agreeing receivers since the last sample. Times at which the position was stale or
    /// missing do not count.
    #[must_use]
    pub const fn agree(&self) -> Option<u8> {
        self.agree
    }
}

/// Converts degrees to 1e-7 degrees. An i32 suffices, because valid objects have at most 180 degrees and no NaN.
fn place(latitude: f64, longitude: f64) -> Place {
    [latitude, longitude].map(|degrees| (degrees * 1e7).round() as i32)
}

fn degrees(place: Place) -> [f64; 2] {
    place.map(|part| f64::from(part) / 1e7)
}

/// What a drone's active hold reported at an instant; NaN where it was not known, or not present.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HoldSample {
    /// The instant of the sample, µs of the station's clock.
    pub at_us: u64,
    /// The temperature, °C.
    pub temperature: f32,
    /// The set-point of the temperature, °C.
    pub set_point: f32,
    /// The output, -1 (cooling) to 1 (heating).
    pub output: f32,
    /// The vibration along x, y, z, m/s².
    pub vibration: [f32; 3],
}

const _: () = assert!(size_of::<HoldSample>() * SAMPLES <= 25_000);

impl HoldSample {
    /// Returns a drone's sample of its hold; `None` if no Hold-Status has ever arrived from the drone.
    fn of(drone: &Drone, now_us: u64) -> Option<Self> {
        let hold = drone.hold()?;
        let held = hold.held()?;
        let nothing = Self {
            at_us: now_us,
            temperature: f32::NAN,
            set_point: f32::NAN,
            output: f32::NAN,
            vibration: [f32::NAN; 3],
        };
        let v = &held.values;
        let present = Self {
            temperature: v.temperature,
            set_point: v.set_point,
            output: v.output,
            vibration: v.vibration,
            ..nothing
        };
        Some(if hold.presence(now_us) == Presence::Valid { present } else { nothing })
    }
}

#[derive(Clone, Debug)]
struct Track {
    samples: VecDeque<Sample>,
    hold: VecDeque<HoldSample>,
    age: f32,
    agree: Option<u8>,
}

/// The last minutes of all drones.
#[derive(Clone, Debug, Default)]
pub struct History {
    tracks: BTreeMap<DroneId, Track>,
    looked_us: Option<u64>,
}

impl History {
    /// Stores a sample of each drone whose sample is due.
    pub fn look(&mut self, now_us: u64, fleet: &Fleet) {
        if self.looked_us.is_some_and(|looked_us| now_us < looked_us + LOOK_US) {
            return;
        }
        self.looked_us = Some(now_us);
        if self.tracks.len() > fleet.iter().len() {
            self.tracks.retain(|id, _| fleet.get(*id).is_some());
        }
        for (id, drone) in fleet.iter() {
            let track = self.tracks.entry(id).or_insert(Track {
                samples: VecDeque::with_capacity(SAMPLES),
                hold: VecDeque::new(),
                age: f32::NAN,
                agree: None,
            });
            let sample = Sample::of(drone, now_us);
            track.age = track.age.max(sample.age);
            track.agree = [track.agree, sample.agree].into_iter().flatten().min();
            if track.samples.back().is_none_or(|last| now_us >= last.at_us + PERIOD_US) {
                track.samples.push_back(Sample { age: track.age, agree: track.agree, ..sample });
                (track.age, track.agree) = (f32::NAN, None);
                track.hold.extend(HoldSample::of(drone, now_us));
                while track.samples.front().is_some_and(|first| first.at_us + KEPT_US < now_us) {
                    track.samples.pop_front();
                }
                while track.hold.front().is_some_and(|first| first.at_us + KEPT_US < now_us) {
                    track.hold.pop_front();
                }
            }
        }
    }

    /// Returns a drone's samples, the oldest first.
    pub fn of(&self, id: DroneId) -> impl Iterator<Item = &Sample> {
        self.tracks.get(&id).into_iter().flat_map(|track| &track.samples)
    }

    /// Returns the samples of a drone's hold, the oldest first.
    pub fn of_hold(&self, id: DroneId) -> impl Iterator<Item = &HoldSample> {
        self.tracks.get(&id).into_iter().flat_map(|track| &track.hold)
    }
}

#[cfg(test)]
mod tests {
    use profile::{GpsStatus, GpsValues, Profile, ReportedStatus, ReportedValues};

    use super::*;
    use crate::{Bundle, Source, Who};

    const ID: DroneId = Who::System(1).first();

    fn take(fleet: &mut Fleet, ms: u32, agree: u8) {
        let (latitude, longitude, altitude) = (47.123_456_74 + f64::from(ms) * 1e-9, -8.5, 470.25);
        let status = ReportedStatus::new().with_position_valid(true).with_receivers_agreeing(agree);
        let reported = ReportedValues { status, latitude, longitude, altitude, ..ReportedValues::absent(ms) };
        let status = GpsStatus::new().with_position_valid(true).with_heard(true);
        let gps = GpsValues { status, latitude, longitude, altitude, ..GpsValues::absent(ms) };
        let sent = Profile::seal(&reported, &[gps, GpsValues::absent(ms), gps]);
        fleet.take(ID.who, Source::default(), u64::from(ms) * 1_000, &Bundle::datagram(sent.as_bytes()).unwrap());
    }

    fn flown(seconds: u32) -> History {
        let (mut history, mut fleet) = (History::default(), Fleet::default());
        for ms in (0..=seconds * 1_000).step_by(20) {
            if ms % 100 == 0 && !(5_000..6_500).contains(&ms) {
                take(&mut fleet, ms, if ms == 3_100 { 2 } else { 3 });
            }
            history.look(u64::from(ms) * 1_000, &fleet);
        }
        history
    }

    #[test]
    fn each_second_has_a_sample_with_the_worst_of_the_second_before() {
        let history = flown(8);
        let samples: Vec<_> = history.of(ID).collect();
        assert_eq!(
            samples.iter().map(|sample| sample.at_us / 1_000).collect::<Vec<_>>(),
            [0, 1_000, 2_000, 3_000, 4_000, 5_000, 6_000, 7_000, 8_000]
        );
        let agree: Vec<_> = samples.iter().map(|sample| sample.agree()).collect();
        assert_eq!(agree, [3, 3, 3, 3, 2, 3, 3, 3, 3].map(Some));
        let ages: Vec<_> = samples.iter().map(|sample| (sample.age().unwrap() * 100.0).round()).collect();
        assert_eq!(ages, [0.0, 8.0, 8.0, 8.0, 8.0, 10.0, 110.0, 158.0, 8.0]);
        assert_eq!(samples[6].voted(), None, "it was stale");
        assert_eq!((samples[6].height(), samples[7].height()), (None, Some(470.25)));
        assert_eq!(samples[8].voted(), Some([47.123_464_7, -8.5]), "to 1e-7 degrees");
        let gps: Vec<_> = samples[8].gps(3).map(|place| place.is_some()).collect();
        assert_eq!(gps, [true, false, true]);
    }

    #[test]
    fn ten_minutes_are_kept_and_no_more() {
        let history = flown(700);
        let kept: Vec<_> = history.of(ID).map(|sample| sample.at_us / PERIOD_US).collect();
        assert_eq!((kept.len(), kept.first(), kept.last()), (601, Some(&100), Some(&700)));
        assert_eq!(history.of(Who::System(2).first()).count(), 0);
    }
}
