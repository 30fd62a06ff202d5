//! The base station: where profiles end up.
//!
//! It trusts nothing on the way (black channel): each object is accepted by its own CRCs, identifier and place, or
//! is not. It keeps what it showed, so that a test can compare it, to the last bit, with what the receivers said.

use core::fmt;
use std::collections::VecDeque;

use profile::ssi::Request;
use profile::ssi::client::{Shown, View};
use profile::{
    Freshness, GpsValues, HorusState, Layout, MAX_RECEIVERS, Object, Rejection, ReportedValues, freshness, image,
};

use super::framing::Deframer;

/// How many profiles the history holds; older ones are dropped. Eleven minutes.
pub const HISTORY: usize = 65_536;

/// A position as it was shown. What is not known is NaN.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Position {
    /// Degrees north.
    pub latitude: f64,
    /// Degrees east.
    pub longitude: f64,
    /// Metres above the ellipsoid.
    pub altitude: f64,
    /// Whether its object's status says that it is valid.
    pub valid: bool,
}

/// One profile as it was shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Entry {
    /// When its last byte arrived, ns.
    pub at_ns: u64,
    /// ms since HORUS start.
    pub timestamp: u32,
    /// Reported-Position, if that object was accepted.
    pub reported: Option<Position>,
    /// GPS1 to GPS5, if accepted.
    pub gps: [Option<Position>; MAX_RECEIVERS],
}

/// Totals since reset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Profiles received: frames of a profile's length.
    pub profiles: u64,
    /// Objects whose frame or position CRC did not fit, vacant places apart.
    pub bad_crc: u64,
    /// Intact objects in another object's place.
    pub misplaced: u64,
    /// Places of objects with nothing in them: HORUS sent it, the DPR did not accept it.
    pub vacant: u64,
    /// Frames that were damaged or of another length.
    pub bad_frames: u64,
    /// Profiles whose accepted objects carry different timestamps.
    pub mixed: u64,
    /// Profiles that are new data of a running HORUS.
    pub fresh: u64,
    /// Cycles of HORUS in between that did not arrive.
    pub missed: u64,
    /// Profiles with the timestamp of the one before.
    pub frozen: u64,
    /// Profiles whose timestamp had jumped back.
    pub restarted: u64,
    /// Profiles whose timestamp had advanced by no multiple of the cycle.
    pub irregular: u64,
}

/// A profile that arrived.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Arrival {
    /// Its bytes as they arrived.
    pub profile: Vec<u8>,
    /// Which of its objects the base station shows: bit 0 Reported-Position, bit n GPSn.
    pub shown: u8,
}

/// A base station. See the [module](self).
#[derive(Debug, Clone)]
pub struct BaseStation {
    layout: Layout,
    deframer: Deframer,
    counts: Counts,
    previous: Option<u32>,
    freshness: Option<Freshness>,
    reported: Option<ReportedValues>,
    gps: [Option<GpsValues>; MAX_RECEIVERS],
    history: VecDeque<Entry>,
}

impl BaseStation {
    /// A base station for profiles of so many receivers.
    ///
    /// # Panics
    ///
    /// If there is no profile for so many.
    #[must_use]
    pub fn new(receivers: usize) -> Self {
        let layout = Layout::for_receivers(receivers);
        let layout = layout.unwrap_or_else(|| panic!("there is no profile of {receivers} receivers"));
        Self {
            layout,
            deframer: Deframer::new(layout.profile_len()),
            counts: Counts::default(),
            previous: None,
            freshness: None,
            reported: None,
            gps: [None; MAX_RECEIVERS],
            history: VecDeque::new(),
        }
    }

    /// Takes bytes that arrived at `at_ns`. Answers the profiles that they completed.
    pub fn receive(&mut self, at_ns: u64, bytes: &[u8]) -> Vec<Arrival> {
        let mut arrivals = vec![];
        for byte in bytes {
            match self.deframer.push(*byte) {
                None => {}
                Some(Ok(frame)) if frame.len() == self.layout.profile_len() => {
                    let shown = self.profile(at_ns, &frame);
                    arrivals.push(Arrival { profile: frame, shown });
                }
                Some(_) => self.counts.bad_frames += 1,
            }
        }
        arrivals
    }

    /// Totals.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// What it showed, oldest first: every profile with an accepted object, the last [`HISTORY`] of them.
    pub fn history(&self) -> impl DoubleEndedIterator<Item = &Entry> + ExactSizeIterator {
        self.history.iter()
    }

    /// Reported-Position of the last profile, if it was accepted.
    #[must_use]
    pub fn reported(&self) -> Option<&ReportedValues> {
        self.reported.as_ref()
    }

    /// What receiver `receiver`, counted from 1, said in the last profile, if it was accepted.
    #[must_use]
    pub fn gps(&self, receiver: usize) -> Option<&GpsValues> {
        self.gps.get(receiver.checked_sub(1)?)?.as_ref()
    }

    /// What the last profile's timestamp said after the one before it.
    #[must_use]
    pub fn freshness(&self) -> Option<Freshness> {
        self.freshness
    }

    /// Takes a profile. Answers which of its objects it shows: bit 0 Reported-Position, bit n GPSn.
    fn profile(&mut self, at_ns: u64, bytes: &[u8]) -> u8 {
        let mut shown = 0;
        self.counts.profiles += 1;
        self.reported = None;
        self.gps = [None; MAX_RECEIVERS];
        let mut timestamp = None;
        let mut mixed = false;
        let layout = self.layout;
        // What was forwarded is the profile's part of the image; its length was checked.
        let offset = u16::try_from(image::REPORTED_POSITION).expect("a small offset");
        let length = u16::try_from(bytes.len()).expect("a profile has at most 364 bytes");
        let view = View::new(layout, Request { offset, length }, bytes);
        for index in 0..layout.objects() {
            let object = match view.object(index) {
                Some(Shown::Intact(object)) => object,
                Some(Shown::Vacant) => {
                    self.counts.vacant += 1;
                    continue;
                }
                Some(Shown::Damaged(Rejection::Identifier)) => {
                    self.counts.misplaced += 1;
                    continue;
                }
                Some(Shown::Damaged(_)) | None => {
                    self.counts.bad_crc += 1;
                    continue;
                }
            };
            mixed |= *timestamp.get_or_insert(object.timestamp()) != object.timestamp();
            shown |= 1 << index;
            match object {
                Object::Reported(object) => self.reported = Some(object.values()),
                // Object 0 is Reported-Position, and no profile has more than five others.
                Object::Gps(object) => self.gps[index - 1] = Some(object.values()),
            }
        }
        self.counts.mixed += u64::from(mixed);
        let Some(timestamp) = timestamp else {
            return shown;
        };
        let judged = freshness(self.previous, timestamp);
        match judged {
            Freshness::First => self.counts.fresh += 1,
            Freshness::Fresh { missed } => {
                self.counts.fresh += 1;
                self.counts.missed += u64::from(missed);
            }
            Freshness::Frozen => self.counts.frozen += 1,
            Freshness::Restarted => self.counts.restarted += 1,
            Freshness::Irregular => self.counts.irregular += 1,
        }
        self.previous = Some(timestamp);
        self.freshness = Some(judged);
        if self.history.len() == HISTORY {
            self.history.pop_front();
        }
        self.history.push_back(Entry {
            at_ns,
            timestamp,
            reported: self.reported.as_ref().map(|values| Position {
                latitude: values.latitude,
                longitude: values.longitude,
                altitude: values.altitude,
                valid: values.status.position_valid(),
            }),
            gps: self.gps.map(|values| {
                values.map(|values| Position {
                    latitude: values.latitude,
                    longitude: values.longitude,
                    altitude: values.altitude,
                    valid: values.status.position_valid(),
                })
            }),
        });
        shown
    }
}

/// The last state, for a person: a line per object, then what came of the link.
impl fmt::Display for BaseStation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.previous {
            None => writeln!(f, "no profile received")?,
            Some(ms) => writeln!(
                f,
                "{} s after HORUS start: {}",
                f64::from(ms) / 1e3,
                match self.freshness {
                    Some(Freshness::Fresh { missed: 0 } | Freshness::First) | None => "fresh".to_owned(),
                    Some(Freshness::Fresh { missed }) => format!("fresh, {missed} cycles missed before it"),
                    Some(Freshness::Frozen) => "HORUS repeats its timestamp".to_owned(),
                    Some(Freshness::Restarted) => "HORUS has started again".to_owned(),
                    Some(Freshness::Irregular) => "timestamp off the 10 ms grid".to_owned(),
                }
            )?,
        }
        write!(f, "  Reported  ")?;
        match &self.reported {
            None => writeln!(f, "not received")?,
            Some(v) => {
                row(f, v.status.position_valid(), [v.latitude, v.longitude, v.altitude], [v.pitch, v.roll, v.yaw])?;
                let state = match v.status.state() {
                    Some(HorusState::Starting) => "starting",
                    Some(HorusState::Monitoring) => "monitoring",
                    Some(HorusState::OutsideRange) => "OUTSIDE THE RANGE",
                    Some(HorusState::SwitchedToRedundant) => "SWITCHED TO REDUNDANT FLIGHT CONTROLLER",
                    Some(HorusState::MotorsCut) => "MOTORS CUT",
                    Some(HorusState::EmergencyFired) => "EMERGENCY MEASURE FIRED",
                    Some(HorusState::InputsContradict) => "STATE UNKNOWN: INPUTS CONTRADICT",
                    None => "in an unknown state",
                };
                let degraded = if v.status.degraded() { ", degraded" } else { "" };
                let agreeing = v.status.receivers_agreeing();
                writeln!(f, "  {state}, {agreeing} of {} agree{degraded}", self.layout.receivers())?;
            }
        }
        for (place, values) in self.gps.iter().take(self.layout.receivers()).enumerate() {
            write!(f, "  GPS{}      ", place + 1)?;
            match values {
                None => writeln!(f, "not received")?,
                Some(v) => {
                    row(f, v.status.position_valid(), [v.latitude, v.longitude, v.altitude], [v.pitch, v.roll, v.yaw])?;
                    let notes =
                        [(!v.status.heard(), "silent"), (v.status.stale(), "stale"), (v.status.excluded(), "excluded")];
                    for (_, note) in notes.into_iter().filter(|(applies, _)| *applies) {
                        write!(f, "  {note}")?;
                    }
                    writeln!(f)?;
                }
            }
        }
        let Counts { profiles, bad_crc, misplaced, vacant, bad_frames, missed, .. } = self.counts;
        write!(
            f,
            "  {profiles} profiles, {missed} cycles missed, {bad_crc} bad CRC, {misplaced} misplaced, {vacant} vacant, \
             {bad_frames} bad frames"
        )
    }
}

/// Position and attitude of one object, in degrees and metres, without the end of the line.
fn row(
    f: &mut fmt::Formatter<'_>,
    valid: bool,
    [latitude, longitude, altitude]: [f64; 3],
    attitude: [f32; 3],
) -> fmt::Result {
    if !valid {
        return write!(f, "no position");
    }
    let (north, east) = (if latitude < 0.0 { 'S' } else { 'N' }, if longitude < 0.0 { 'W' } else { 'E' });
    write!(f, "{:11.7}° {north} {:12.7}° {east} {altitude:9.3} m", latitude.abs(), longitude.abs())?;
    let [pitch, roll, yaw] = attitude.map(f32::to_degrees);
    if pitch.is_nan() {
        return Ok(());
    }
    write!(f, "  pitch {pitch:5.1}° roll {roll:5.1}° yaw {:5.1}°", yaw.rem_euclid(360.0))
}

#[cfg(test)]
mod tests {
    use profile::{FixType, GpsObject, GpsStatus, Identifier, Profile, ReportedStatus};

    use super::super::framing;
    use super::*;

    fn gps(timestamp: u32, longitude: f64) -> GpsValues {
        GpsValues {
            status: GpsStatus::new().with_fix_type(FixType::Fix3D).with_position_valid(true).with_heard(true),
            latitude: -47.497_9,
            longitude,
            altitude: 470.125,
            ..GpsValues::absent(timestamp)
        }
    }

    fn profile(timestamp: u32) -> Profile<3> {
        let reported = ReportedValues {
            status: ReportedStatus::new()
                .with_position_valid(true)
                .with_attitude_valid(true)
                .with_receivers_agreeing(2)
                .with_degraded(true)
                .with_state(HorusState::Monitoring),
            latitude: -47.497_9,
            longitude: 8.728_9,
            altitude: 470.125,
            pitch: -0.1,
            roll: 0.05,
            yaw: -1.0,
            ..ReportedValues::absent(timestamp)
        };
        let silent = GpsValues::absent(timestamp);
        Profile::seal(&reported, &[gps(timestamp, 8.728_9), gps(timestamp, f64::from(87_289_001) / 1e7), silent])
    }

    fn send(base: &mut BaseStation, at_ns: u64, bytes: &[u8]) {
        let mut line = Vec::new();
        framing::encode(bytes, &mut line);
        base.receive(at_ns, &line);
    }

    #[test]
    fn what_was_sealed_is_shown_to_the_last_bit() {
        let mut base = BaseStation::new(3);
        for cycle in 0..3_u32 {
            send(&mut base, u64::from(cycle) * 10_000_000, profile(cycle * 10).as_bytes());
        }
        assert_eq!(base.history().len(), 3);
        let last = base.history().next_back().expect("three profiles");
        assert_eq!((last.at_ns, last.timestamp), (20_000_000, 20));
        let shown = last.gps[1].expect("accepted");
        assert!(shown.valid);
        assert_eq!(shown.longitude.to_bits(), 8.728_900_1_f64.to_bits());
        assert_eq!(shown.latitude.to_bits(), (-47.497_9_f64).to_bits());
        assert!(last.gps[2].is_some_and(|absent| !absent.valid && absent.latitude.is_nan()));
        assert_eq!(last.gps[3], None);
        assert_eq!(last.reported.map(|r| r.altitude.to_bits()), Some(470.125_f64.to_bits()));
        assert_eq!(base.gps(2).map(|values| values.longitude), Some(8.728_900_1));
        assert!(base.gps(0).is_none() && base.gps(4).is_none() && base.gps(9).is_none());
        let counts = base.counts();
        assert_eq!((counts.profiles, counts.fresh, counts.missed, counts.bad_crc, counts.vacant), (3, 3, 0, 0, 0));
    }

    #[test]
    fn any_damaged_bit_costs_its_object_and_no_other() {
        let mut base = BaseStation::new(3);
        let good = profile(10);
        for bit in 0..Profile::<3>::SIZE * 8 {
            let mut bytes = good.as_bytes().to_vec();
            bytes[bit / 8] ^= 0x80 >> (bit % 8);
            send(&mut base, 0, &bytes);
            assert_eq!(base.counts().bad_crc, bit as u64 + 1, "bit {bit}");
            let hit = [64, 124, 184, 244].iter().position(|end| bit / 8 < *end);
            let accepted =
                [base.reported().is_some(), base.gps(1).is_some(), base.gps(2).is_some(), base.gps(3).is_some()];
            for (object, accepted) in accepted.into_iter().enumerate() {
                assert_eq!(accepted, Some(object) != hit, "bit {bit}");
            }
        }
    }

    #[test]
    fn vacant_misplaced_and_mixed_objects_are_told_apart() {
        let mut base = BaseStation::new(3);
        let mut bytes = profile(10).as_bytes().to_vec();
        bytes[64..124].fill(0xff);
        send(&mut base, 0, &bytes);
        assert_eq!((base.counts().vacant, base.counts().bad_crc), (1, 0));
        assert!(base.gps(1).is_none());

        let mut bytes = profile(20).as_bytes().to_vec();
        bytes.copy_within(124..184, 64);
        send(&mut base, 0, &bytes);
        assert_eq!((base.counts().misplaced, base.counts().bad_crc), (1, 0));

        let mut bytes = profile(30).as_bytes().to_vec();
        bytes[184..].copy_from_slice(GpsObject::seal(Identifier::GPS[2], &gps(20, 1.0)).as_bytes());
        assert_eq!(base.counts().mixed, 0);
        send(&mut base, 0, &bytes);
        assert_eq!(base.counts().mixed, 1);

        // Nothing at all is a profile, but none to show.
        send(&mut base, 0, &[0; 244]);
        assert_eq!((base.counts().profiles, base.history().len()), (4, 3));
    }

    #[test]
    fn freshness_is_kept() {
        let mut base = BaseStation::new(3);
        for timestamp in [10, 20, 50, 50, 55, 0, 10] {
            send(&mut base, 0, profile(timestamp).as_bytes());
        }
        let counts = base.counts();
        assert_eq!((counts.fresh, counts.missed, counts.frozen, counts.irregular, counts.restarted), (4, 2, 1, 1, 1));
        assert_eq!(base.freshness(), Some(Freshness::Fresh { missed: 0 }));
    }

    #[test]
    fn what_is_no_profile_is_counted_and_dropped() {
        let mut base = BaseStation::new(3);
        send(&mut base, 0, &[1; 184]);
        base.receive(0, &[9, 9, 0]);
        base.receive(0, &[7; 10_000]);
        base.receive(0, &[0]);
        send(&mut base, 0, profile(10).as_bytes());
        assert_eq!((base.counts().bad_frames, base.counts().profiles), (3, 1));
    }

    #[test]
    fn the_history_is_bounded() {
        let mut base = BaseStation::new(1);
        let mut line = Vec::new();
        framing::encode(Profile::<1>::seal(&ReportedValues::absent(0), &[GpsValues::absent(0)]).as_bytes(), &mut line);
        for at in 0..HISTORY as u64 + 5 {
            base.receive(at, &line);
        }
        assert_eq!(base.history().len(), HISTORY);
        assert_eq!(base.history().next().map(|entry| entry.at_ns), Some(5));
    }

    #[test]
    fn a_person_can_read_it() {
        let mut base = BaseStation::new(3);
        assert!(base.to_string().starts_with("no profile received\n  Reported  not received\n"));
        send(&mut base, 0, profile(0).as_bytes());
        let mut bytes = profile(1_230).as_bytes().to_vec();
        bytes[130] ^= 1;
        send(&mut base, 0, &bytes);
        let state = "monitoring, 2 of 3 agree, degraded";
        let expected = format!(
            "\
1.23 s after HORUS start: fresh, 122 cycles missed before it
  Reported   47.4979000° S    8.7289000° E   470.125 m  pitch  -5.7° roll   2.9° yaw 302.7°  {state}
  GPS1       47.4979000° S    8.7289000° E   470.125 m
  GPS2      not received
  GPS3      no position  silent
  2 profiles, 122 cycles missed, 1 bad CRC, 0 misplaced, 0 vacant, 0 bad frames"
        );
        let shown: Vec<_> = base.to_string().lines().map(|line| line.trim_end().to_owned()).collect();
        assert_eq!(shown.join("\n"), expected);
    }
}
