//! The base station, which receives the profiles at the end of the link.
//!
//! The crate [`base_station`], which a real base station also runs, judges, keeps and shows the profiles. This module
//! adds the receiving end of the radio and a history of the shown positions for tests.

use core::fmt;
use std::collections::VecDeque;

use base_station::carrier::stream::Deframer;
use base_station::{Bundle, Drone, Intact};
use profile::ssi::client::Shown;
use profile::{Layout, MAX_RECEIVERS, Object};

/// The number of profiles in the history, those of eleven minutes. Older profiles are dropped.
pub const HISTORY: usize = 65_536;

/// A position as the base station showed it. Unknown values are NaN.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Position {
    /// The latitude, degrees north.
    pub latitude: f64,
    /// The longitude, degrees east.
    pub longitude: f64,
    /// The height, metres above the ellipsoid.
    pub altitude: f64,
    /// Whether the object's status marks the position as valid.
    pub valid: bool,
    /// Whether the object's status marks the attitude as valid.
    pub oriented: bool,
}

/// One profile as the base station showed it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Entry {
    /// The instant at which the profile's last byte arrived, ns.
    pub at_ns: u64,
    /// The timestamp of the objects, ms since HORUS's start.
    pub timestamp: u32,
    /// Reported-Position, if that object was accepted.
    pub reported: Option<Position>,
    /// GPS1 to GPS5, each `None` if that object was not accepted.
    pub gps: [Option<Position>; MAX_RECEIVERS],
}

/// A profile that arrived at the base station.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Arrival {
    /// The bytes of the profile as they arrived.
    pub profile: Vec<u8>,
    /// The objects that the base station treats as valid: bit 0 is Reported-Position, bit n is GPSn.
    pub shown: u8,
}

/// A base station. The [module](self) describes it.
#[derive(Debug, Clone)]
pub struct BaseStation {
    layout: Layout,
    deframer: Deframer,
    drone: Drone,
    bad_frames: u64,
    history: VecDeque<Entry>,
    arrived_ns: u64,
}

impl BaseStation {
    /// Returns a base station for profiles with `receivers` receivers.
    ///
    /// # Panics
    ///
    /// Panics if `receivers` is not a number of receivers that a profile can have.
    #[must_use]
    pub fn new(receivers: usize) -> Self {
        let layout = Layout::for_receivers(receivers);
        let layout = layout.unwrap_or_else(|| panic!("there is no profile of {receivers} receivers"));
        Self {
            layout,
            deframer: Deframer::new(layout.profile_len()),
            drone: Drone::new(0),
            bad_frames: 0,
            history: VecDeque::new(),
            arrived_ns: 0,
        }
    }

    /// Takes bytes that arrived at `at_ns` (ns). Returns the profiles that these bytes completed.
    pub fn receive(&mut self, at_ns: u64, bytes: &[u8]) -> Vec<Arrival> {
        let mut arrivals = vec![];
        self.arrived_ns = at_ns;
        for byte in bytes {
            let Some(frame) = self.deframer.push(*byte) else { continue };
            let layout = self.layout;
            match frame.as_ref().ok().and_then(|frame| Bundle::profile(layout, frame)) {
                Some(bundle) => {
                    let shown = self.profile(at_ns, &bundle);
                    arrivals.push(Arrival { profile: bundle.bytes().to_vec(), shown });
                }
                None => self.bad_frames += 1,
            }
        }
        arrivals
    }

    /// The state of the drone.
    #[must_use]
    pub fn drone(&self) -> &Drone {
        &self.drone
    }

    /// The number of frames on the radio link that were damaged or had a wrong length.
    #[must_use]
    pub fn bad_frames(&self) -> u64 {
        self.bad_frames
    }

    /// The last [`HISTORY`] profiles with at least one intact object, the oldest first.
    pub fn history(&self) -> impl DoubleEndedIterator<Item = &Entry> + ExactSizeIterator {
        self.history.iter()
    }

    /// Takes a profile and returns its valid objects: bit 0 is Reported-Position, bit n is GPSn.
    fn profile(&mut self, at_ns: u64, bundle: &Bundle<'_>) -> u8 {
        let verdicts = self.drone.take_bundle(at_ns / 1_000, bundle);
        let mut shown = 0;
        let mut entry = Entry { at_ns, timestamp: 0, reported: None, gps: [None; MAX_RECEIVERS] };
        for (index, ((place, bytes), verdict)) in bundle.objects().zip(verdicts).enumerate() {
            let Shown::Intact(Intact::Object(object)) = place.judge(bytes) else { continue };
            shown |= u8::from(verdict.is_intact()) << index;
            entry.timestamp = object.timestamp();
            match object {
                Object::Reported(object) => {
                    let values = object.values();
                    entry.reported = Some(Position {
                        latitude: values.latitude,
                        longitude: values.longitude,
                        altitude: values.altitude,
                        valid: values.status.position_valid(),
                        oriented: values.status.attitude_valid(),
                    });
                }
                Object::Gps(object) => {
                    let values = object.values();
                    // Object 0 is Reported-Position. Every other object belongs to one of up to five receivers.
                    entry.gps[index - 1] = Some(Position {
                        latitude: values.latitude,
                        longitude: values.longitude,
                        altitude: values.altitude,
                        valid: values.status.position_valid(),
                        oriented: values.status.attitude_valid(),
                    });
                }
            }
        }
        if shown != 0 {
            if self.history.len() == HISTORY {
                self.history.pop_front();
            }
            self.history.push_back(entry);
        }
        shown
    }
}

/// Prints the state at the latest arrival: one line for each object, the alarms, and the figures of the link.
impl fmt::Display for BaseStation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {} bad frames", self.drone.words(self.arrived_ns / 1_000), self.bad_frames)
    }
}

#[cfg(test)]
mod tests {
    use base_station::carrier::stream;
    use profile::{GpsValues, Profile, ReportedValues};

    use super::*;

    fn send(base: &mut BaseStation, at_ns: u64, bytes: &[u8]) -> Vec<Arrival> {
        let mut line = Vec::new();
        stream::encode(bytes, &mut line);
        base.receive(at_ns, &line)
    }

    fn profile(timestamp: u32) -> Profile<1> {
        let values = GpsValues { latitude: 47.497_9, longitude: 8.728_9, ..GpsValues::absent(timestamp) };
        Profile::seal(&ReportedValues::absent(timestamp), &[values])
    }

    #[test]
    fn what_was_sealed_is_in_the_history_to_the_last_bit() {
        let mut base = BaseStation::new(1);
        let arrived = send(&mut base, 20_000_000, profile(20).as_bytes());
        assert_eq!(arrived, [Arrival { profile: profile(20).as_bytes().to_vec(), shown: 0b11 }]);
        let last = base.history().next_back().expect("a profile");
        assert_eq!((last.at_ns, last.timestamp), (20_000_000, 20));
        assert_eq!(last.gps[0].map(|shown| shown.longitude.to_bits()), Some(8.728_9_f64.to_bits()));
        assert!(last.reported.is_some_and(|absent| !absent.valid && absent.latitude.is_nan()));
        assert_eq!(last.gps[1], None);
        assert_eq!(base.drone().timestamp(), Some(20));
    }

    #[test]
    fn a_damaged_object_is_not_valid_and_the_others_are() {
        let mut base = BaseStation::new(1);
        let mut bytes = profile(10).as_bytes().to_vec();
        bytes[100] ^= 1;
        assert_eq!(send(&mut base, 0, &bytes)[0].shown, 0b01);
        assert_eq!(send(&mut base, 0, &[0; 124])[0].shown, 0);
        assert_eq!((base.history().len(), base.drone().counts().bad_crc), (1, 1));
    }

    #[test]
    fn what_is_no_profile_is_counted_and_dropped() {
        let mut base = BaseStation::new(1);
        send(&mut base, 0, &[1; 184]);
        base.receive(0, &[9, 9, 0]);
        base.receive(0, &[7; 10_000]);
        base.receive(0, &[0]);
        send(&mut base, 0, profile(10).as_bytes());
        assert_eq!((base.bad_frames(), base.drone().counts().messages), (3, 1));
        assert!(base.to_string().ends_with("0 vacant, 3 bad frames"), "{base}");
    }

    #[test]
    fn the_history_is_bounded() {
        let mut base = BaseStation::new(1);
        let mut line = Vec::new();
        stream::encode(profile(0).as_bytes(), &mut line);
        for at in 0..HISTORY as u64 + 5 {
            base.receive(at, &line);
        }
        assert_eq!(base.history().len(), HISTORY);
        assert_eq!(base.history().next().map(|entry| entry.at_ns), Some(5));
    }
}
