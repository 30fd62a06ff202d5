//! Turns a carrier's bytes into the state of all drones, for arriving and for played-back data.

use std::collections::BTreeMap;
use std::net::SocketAddr;

use profile::Layout;

use crate::carrier::mavlink::{Receiver, Verifier};
use crate::carrier::published::{Name, Published};
use crate::carrier::stream::Deframer;
use crate::{Bundle, Change, DroneId, Fleet, Place, Source, Verdict, Who};

/// The greatest length of a datagram with objects, bytes: more than an Ethernet frame. Longer datagrams are refused
/// unread.
pub const MAX_DATAGRAM: usize = 2_048;

/// The form in which a line brings objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Kind {
    /// The line brings MAVLink in datagrams.
    MavlinkDatagrams = 1,
    /// The line brings MAVLink in a byte stream.
    MavlinkStream = 2,
    /// The line brings profiles, images or maps in datagrams.
    Datagrams = 3,
    /// The line brings profiles, images or maps in a byte stream, in frames that end with a zero byte.
    Stream = 4,
    /// The line brings messages that another base station published.
    Published = 5,
}

impl Kind {
    /// Returns the kind of line that has this number in a recording.
    #[must_use]
    pub const fn of(number: u8) -> Option<Self> {
        match number {
            1 => Some(Self::MavlinkDatagrams),
            2 => Some(Self::MavlinkStream),
            3 => Some(Self::Datagrams),
            4 => Some(Self::Stream),
            5 => Some(Self::Published),
            _ => None,
        }
    }
}

/// Bytes that arrived together, with their origin.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Carried {
    /// The instant at which the bytes arrived, µs since 1970. It never goes back from one arrival to the next.
    pub at_us: u64,
    /// The form of the bytes.
    pub kind: Kind,
    /// The number of the line, which stands for a socket or port.
    pub line: u16,
    /// The source of a datagram, or the drone of a published message, `STATION/DRONE`; otherwise empty.
    pub from: String,
    /// The bytes that arrived.
    pub bytes: Vec<u8>,
}

/// The verdict on one object that arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Judged {
    /// The drone that the object is from.
    pub drone: DroneId,
    /// The kind of the object.
    pub place: Place,
    /// The verdict on the object.
    pub verdict: Verdict,
}

#[derive(Debug)]
enum Line {
    Mavlink(Box<Receiver>),
    Stream(Deframer),
    Messages,
}

/// All lines, and all drones from which messages arrive on them.
#[derive(Debug, Default)]
pub struct Intake {
    fleet: Fleet,
    verifier: Option<Verifier>,
    lines: BTreeMap<(u16, u8), Line>,
    damaged: u64,
    oversized: u64,
}

/// Totals of the messages that were refused before their drone was known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Refused {
    /// The number of messages that were not signed with this station's key, or were replayed.
    pub unsigned: u64,
    /// The number of TUNNEL messages whose payload type or length fits no objects.
    pub malformed: u64,
    /// The number of TUNNEL messages with a wrong MAVLink checksum.
    pub bad_crc: u64,
    /// The number of datagrams of MAVLink 1, which has no TUNNEL.
    pub version_1: u64,
    /// The number of MAVLink messages without objects, which are no error.
    pub foreign: u64,
    /// The number of datagrams and frames without MAVLink that have the length of no profile, image or map.
    pub damaged: u64,
    /// The number of datagrams longer than [`MAX_DATAGRAM`].
    pub oversized: u64,
}

impl Intake {
    /// Returns an intake without drones. With a verifier it accepts only signed MAVLink messages.
    #[must_use]
    pub fn new(verifier: Option<Verifier>) -> Self {
        Self { verifier, ..Self::default() }
    }

    /// Judges the objects in bytes that arrived, keeps those that are accepted, and returns the verdicts.
    pub fn take(&mut self, carried: &Carried) -> Vec<Judged> {
        self.take_if(carried, |_, _| true)
    }

    /// Judges like [`take`](Self::take), but only objects for which `wanted` is true. So a playback judges only the
    /// objects that were judged during the recording.
    pub fn take_if(&mut self, carried: &Carried, wanted: impl Fn(Who, Place) -> bool) -> Vec<Judged> {
        self.take_each(carried, wanted, |_, _, _| {})
    }

    /// Judges like [`take_if`](Self::take_if). The function `told` gets the objects and verdicts of each message of a
    /// known drone.
    pub fn take_each(
        &mut self,
        carried: &Carried,
        wanted: impl Fn(Who, Place) -> bool,
        mut told: impl FnMut(DroneId, &Bundle<'_>, &[Verdict]),
    ) -> Vec<Judged> {
        let Self { fleet, verifier, lines, damaged, oversized } = self;
        let Carried { at_us, kind, line, from, bytes } = carried;
        let mut judged = vec![];
        if matches!(kind, Kind::MavlinkDatagrams | Kind::Datagrams) && bytes.len() > MAX_DATAGRAM {
            *oversized += 1;
            return judged;
        }
        let from_address: Option<SocketAddr> = from.parse().ok();
        let plain = Source { line: *line, from: from_address, ..Source::default() };
        let mut judge = |who: Who, source: Source, bundle: &Bundle<'_>| {
            if bundle.objects().all(|(place, _)| wanted(who, place)) {
                let (drone, verdicts) = fleet.take(who, source, *at_us, bundle);
                if fleet.get(drone).is_some() {
                    told(drone, bundle, &verdicts);
                }
                let found = bundle.objects().zip(verdicts);
                judged.extend(found.map(|((place, _), verdict)| Judged { drone, place, verdict }));
            }
        };
        let of_kind = || match kind {
            Kind::MavlinkDatagrams | Kind::MavlinkStream => Line::Mavlink(Box::new(Receiver::new(verifier.clone()))),
            Kind::Datagrams | Kind::Published => Line::Messages,
            Kind::Stream => Line::Stream(Deframer::new(LONGEST)),
        };
        match lines.entry((*line, *kind as u8)).or_insert_with(of_kind) {
            Line::Mavlink(receiver) => {
                let received = match kind {
                    Kind::MavlinkDatagrams => receiver.datagram(*at_us, bytes),
                    _ => receiver.stream(*at_us, bytes),
                };
                for received in received {
                    if let Some(bundle) = received.bundle() {
                        let component = received.component;
                        let source = Source { component, signed: verifier.is_some(), ..plain };
                        judge(received.who(), source, &bundle);
                    }
                }
            }
            Line::Messages => {
                let message = match kind {
                    Kind::Published => Name::new(from)
                        .zip(Published::read(bytes))
                        .map(|(name, published)| (Who::Named(name), vec![published.bundle])),
                    _ => from_address.map(Who::Address).zip(all(bytes)),
                };
                match message {
                    Some((who, bundles)) => bundles.iter().for_each(|bundle| judge(who, plain, bundle)),
                    None => *damaged += 1,
                }
            }
            Line::Stream(deframer) => {
                for frame in bytes.iter().filter_map(|byte| deframer.push(*byte)) {
                    match frame.as_deref().ok().and_then(all) {
                        Some(bundles) => bundles.iter().for_each(|bundle| judge(Who::Line(*line), plain, bundle)),
                        None => *damaged += 1,
                    }
                }
            }
        }
        judged
    }

    /// Updates every drone's alarms to `now_us`. Returns the alarms that began or ended.
    pub fn tick(&mut self, now_us: u64) -> Vec<(DroneId, Change)> {
        self.fleet.tick(now_us)
    }

    /// Returns all drones.
    #[must_use]
    pub const fn fleet(&self) -> &Fleet {
        &self.fleet
    }

    /// Returns whether only signed MAVLink is accepted.
    #[must_use]
    pub const fn is_signed(&self) -> bool {
        self.verifier.is_some()
    }

    /// Returns the totals of refused messages.
    #[must_use]
    pub fn refused(&self) -> Refused {
        let begin = Refused { damaged: self.damaged, oversized: self.oversized, ..Refused::default() };
        self.lines.values().fold(begin, |all, line| match line {
            Line::Mavlink(receiver) => {
                let more = receiver.counts();
                Refused {
                    unsigned: all.unsigned + more.unsigned,
                    malformed: all.malformed + more.malformed,
                    bad_crc: all.bad_crc + more.bad_crc,
                    version_1: all.version_1 + more.version_1,
                    foreign: all.foreign + more.foreign,
                    ..all
                }
            }
            Line::Stream(_) | Line::Messages => all,
        })
    }
}

/// The length of the longest frame with objects, bytes: that of the map with the most receivers and a hold.
const LONGEST: usize = {
    let [.., layout] = Layout::ALL;
    layout.with_hold().map_len()
};

fn all(bytes: &[u8]) -> Option<Vec<Bundle<'_>>> {
    Some(Bundle::all(bytes)).filter(|bundles| !bundles.is_empty())
}

#[cfg(test)]
mod tests {
    use profile::{GpsValues, Profile, ReportedValues};

    use super::*;
    use crate::carrier::mavlink::{Forwarder, Rates};
    use crate::carrier::{published, stream};

    fn profile(timestamp: u32) -> Profile<3> {
        Profile::seal(&ReportedValues::absent(timestamp), &[GpsValues::absent(timestamp); 3])
    }

    fn carried(kind: Kind, from: &str, bytes: &[u8]) -> Carried {
        Carried { at_us: 1_790_000_000_000_000, kind, line: 2, from: from.into(), bytes: bytes.to_vec() }
    }

    #[test]
    fn every_kind_of_line_brings_the_same_objects() {
        let sent = profile(70_000);
        let mut forwarder = Forwarder::new(9, 1, Rates { bytes_per_s: 100_000, period_us: 0, standard_us: 0 });
        forwarder.offer(&Bundle::datagram(sent.as_bytes()).unwrap());
        let mavlink: Vec<u8> = std::iter::from_fn(|| forwarder.poll(1_000_000, 0)).flatten().collect();
        let mut framed = vec![];
        stream::encode(sent.as_bytes(), &mut framed);
        let published = published::message(5, &Bundle::datagram(sent.as_bytes()).unwrap(), &[Verdict::New; 4]);
        let lines = [
            (carried(Kind::MavlinkDatagrams, "127.0.0.1:9", &mavlink), "9"),
            (carried(Kind::MavlinkStream, "", &mavlink), "9"),
            (carried(Kind::Datagrams, "127.0.0.1:5000", sent.as_bytes()), "127.0.0.1:5000"),
            (carried(Kind::Stream, "", &framed), "line2"),
            (carried(Kind::Published, "north/7", &published), "north/7"),
        ];
        for (carried, name) in lines {
            let mut intake = Intake::default();
            let judged = intake.take(&carried);
            let mut places: Vec<_> = judged.iter().map(|judged| judged.place).collect();
            places.sort_unstable();
            assert_eq!(places, Place::ALL[1..5], "{:?}", carried.kind);
            assert!(judged.iter().all(|judged| judged.verdict == Verdict::New && judged.drone.to_string() == name));
            assert_eq!(intake.take_if(&carried, |_, _| false), []);
            assert!(intake.take(&carried).iter().all(|judged| judged.verdict == Verdict::Duplicate));
        }
    }

    #[test]
    fn foreign_bytes_are_counted_and_change_nothing() {
        let mut intake = Intake::default();
        for bytes in [&b"hello"[..], &[0xFD; 300], &[0; 40], &[]] {
            for kind in (1..).map_while(Kind::of) {
                assert_eq!(intake.take(&carried(kind, "127.0.0.1:5000", bytes)), []);
                assert_eq!(Kind::of(kind as u8), Some(kind));
            }
        }
        assert_eq!((intake.fleet().iter().len(), intake.refused().damaged), (0, 4 + 1 + 4));
    }
}
