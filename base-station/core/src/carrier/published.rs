//! Defines the messages that base stations exchange through a broker (decision 19).
//!
//! One message holds the objects of one drone that arrived at one instant, unchanged, and the publishing station's
//! verdict on each. A subscriber judges the objects again. All numbers are little-endian.
//!
//! | offset | what |
//! |---|---|
//! | 0 | u8 number of the first object: 0 Link-Status to 6 GPS5, 7 Port-Status, 8 uplink, 9 Hold-Status |
//! | 1 | u8 number n of successive objects from there |
//! | 2 | u64 instant at which they arrived at the publishing station, µs since 1970 by its clock |
//! | 10 | n × u8 verdict on each object ([`VERDICTS`]) |
//! | 10 + n | the objects |
//!
//! The topic is `horus/1/STATION/DRONE`: the version of this format, the publishing station's name, and that station's
//! name for the drone. Two stations may receive two drones with one MAVLink system id, so a subscriber calls a drone
//! `STATION/DRONE`.

use core::fmt;

use profile::Rejection;

use crate::{Bundle, DroneId, Place, Verdict};

/// The beginning that all topics have in common.
pub const TOPICS: &str = "horus/1";

/// The verdicts on objects. The number of a verdict in a message is its index here; 255 stands for any other rejection.
pub const VERDICTS: [Verdict; 9] = [
    Verdict::New,
    Verdict::Duplicate,
    Verdict::Older,
    Verdict::OutOfSequence,
    Verdict::Vacant,
    Verdict::Rejected(Rejection::Length),
    Verdict::Rejected(Rejection::Crc),
    Verdict::Rejected(Rejection::PositionCrc),
    Verdict::Rejected(Rejection::Identifier),
];

const HEAD: usize = 10;

/// The length of the longest message, bytes. It has every object but the hold's, which always travels alone.
pub const MAX_MESSAGE: usize = HEAD + (Place::COUNT - 1) + 32 + 64 + 5 * 60 + 2 * 64;

/// The greatest number of characters in a station's name.
pub const MAX_STATION: usize = 32;

const MAX_NAME: usize = 96;

/// The name of a drone that another station receives: `STATION/DRONE`.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Name {
    text: [u8; MAX_NAME],
}

impl Name {
    /// Returns the name in this text: a station's name, a slash and a drone's name; `None` if the text is too long or
    /// is no such name.
    #[must_use]
    pub fn new(name: &str) -> Option<Self> {
        let (station, drone) = name.split_once('/')?;
        let is_drone = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | ':' | '-' | '[' | ']');
        if !is_station(station) || drone.is_empty() || !drone.chars().all(is_drone) {
            return None;
        }
        let mut text = [0; MAX_NAME];
        text.get_mut(..name.len())?.copy_from_slice(name.as_bytes());
        Some(Self { text })
    }

    /// Returns the name of the drone in this topic.
    #[must_use]
    pub fn of_topic(topic: &str) -> Option<Self> {
        Self::new(topic.strip_prefix(TOPICS)?.strip_prefix('/')?)
    }

    /// Returns the name as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        let end = self.text.iter().position(|byte| *byte == 0).unwrap_or(MAX_NAME);
        core::str::from_utf8(&self.text[..end]).unwrap_or_default()
    }
}

impl fmt::Debug for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.as_str())
    }
}

/// Returns whether this is a valid station's name: 1 to [`MAX_STATION`] letters, digits, dots, hyphens and underscores,
/// none of which has a meaning in topics.
#[must_use]
pub fn is_station(name: &str) -> bool {
    let is_known = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '-' | '_');
    (1..=MAX_STATION).contains(&name.len()) && name.chars().all(is_known)
}

/// Returns the topic of a drone that the station of this name receives.
#[must_use]
pub fn topic(station: &str, drone: DroneId) -> String {
    format!("{TOPICS}/{station}/{drone}")
}

/// The objects of one drone that arrived at one instant at the publishing station.
#[derive(Clone, Copy, Debug)]
pub struct Published<'a> {
    /// The instant at which the objects arrived at the publishing station, µs since 1970 by that station's clock.
    pub at_us: u64,
    /// The objects that arrived.
    pub bundle: Bundle<'a>,
    verdicts: &'a [u8],
}

impl<'a> Published<'a> {
    /// Reads a message; `None` if it is malformed.
    #[must_use]
    pub fn read(message: &'a [u8]) -> Option<Self> {
        let ([first, count], rest) = message.split_first_chunk()?;
        let (at_us, rest) = rest.split_first_chunk()?;
        let (verdicts, objects) = rest.split_at_checked(usize::from(*count))?;
        let first = *Place::ALL.get(usize::from(*first))?;
        let bundle = Bundle::new(first, usize::from(*count), objects)?;
        Some(Self { at_us: u64::from_le_bytes(*at_us), bundle, verdicts })
    }

    /// Returns the publishing station's verdict on each object; `None` for a rejection that has no number.
    pub fn verdicts(&self) -> impl Iterator<Item = Option<Verdict>> + use<'a> {
        self.verdicts.iter().map(|number| VERDICTS.get(usize::from(*number)).copied())
    }
}

/// Returns the message for objects of a drone that arrived at `at_us`, µs since 1970, with the verdict on each object.
#[must_use]
pub fn message(at_us: u64, bundle: &Bundle<'_>, verdicts: &[Verdict]) -> Vec<u8> {
    let first = bundle.objects().next().map_or(0, |(place, _)| place.index());
    let number = |verdict: &Verdict| VERDICTS.iter().position(|known| known == verdict).unwrap_or(255) as u8;
    let mut message = vec![first as u8, verdicts.len() as u8];
    message.extend(at_us.to_le_bytes());
    message.extend(verdicts.iter().map(number));
    message.extend(bundle.bytes());
    message
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_longest_message_holds_every_object() {
        let bytes: Vec<u8> = (0..524_u32).map(|index| index as u8).collect();
        let bundle = Bundle::from_first(Place::LinkStatus, &bytes).unwrap();
        assert_eq!(message(0, &bundle, &VERDICTS).len(), MAX_MESSAGE);
    }

    #[test]
    fn a_name_is_a_station_and_a_drone() {
        for name in ["north/7", "a.b-c_9/127.0.0.1:5000", "n/[fe80::1]:65535", "n/line2"] {
            let read = Name::of_topic(&format!("{TOPICS}/{name}")).unwrap();
            assert_eq!((read.as_str(), read), (name, Name::new(name).unwrap()));
        }
        let long = format!("{}/7", "n".repeat(MAX_STATION + 1));
        let longer = format!("n/{}", "7".repeat(MAX_NAME));
        for name in
            ["", "/", "n/", "/7", "n", "n/7/8", "n/#", "+/7", "n /7", "n/\0", "n/é", "n/north/7", &long, &longer]
        {
            assert!(Name::new(name).is_none(), "{name}");
        }
        for topic in ["", "horus/1", "horus/1/", "horus/2/n/7", "horus/1n/7", "horus/1/n/7/8"] {
            assert!(Name::of_topic(topic).is_none(), "{topic}");
        }
    }

    proptest! {
        #[test]
        fn what_is_published_is_read(
            at_us in any::<u64>(), first in 0..10_usize, count in 1..10_usize, seed in any::<u8>(),
            found in prop::collection::vec(0..VERDICTS.len(), 9),
        ) {
            // Hold-Status, the last object, always travels alone.
            let count = count.min(9_usize.saturating_sub(first).max(1));
            let places = Place::ALL.iter().skip(first).take(count);
            let bytes: Vec<u8> = (0..places.map(|place| place.size()).sum()).map(|at| at as u8 ^ seed).collect();
            let bundle = Bundle::from_first(Place::ALL[first], &bytes).unwrap();
            let verdicts: Vec<_> = found.iter().take(bundle.objects().count()).map(|at| VERDICTS[*at]).collect();
            let sent = message(at_us, &bundle, &verdicts);
            let read = Published::read(&sent).unwrap();
            prop_assert_eq!(read.at_us, at_us);
            prop_assert_eq!(read.bundle.objects().collect::<Vec<_>>(), bundle.objects().collect::<Vec<_>>());
            prop_assert_eq!(read.verdicts().collect::<Option<Vec<_>>>(), Some(verdicts));
            for end in 0..sent.len() {
                prop_assert!(Published::read(&sent[..end]).is_none(), "cut off");
            }
            prop_assert!(Published::read(&[&sent[..], &[0]].concat()).is_none(), "a byte too many");
        }

        #[test]
        fn anything_may_be_published(bytes in prop::collection::vec(any::<u8>(), 0..500), topic in ".{0,60}") {
            let _ = Published::read(&bytes).map(|published| published.verdicts().count());
            let _ = Name::of_topic(&topic);
        }
    }
}
