//! Selects, in the flight controller, which objects are sent when.
//!
//! HORUS sends 100 profiles of 244 bytes a second, 24 kB/s; a telemetry radio carries 1 to 6 kB/s. So the forwarder
//! keeps the newest object of each kind and sends what its budget allows, never an object older than one that it has
//! sent.
//!
//! - These objects share a message: {Link-Status, Reported-Position}, {GPS1, GPS2}, {GPS3, GPS4}, {GPS5} and, as the
//!   answer to an uplink ([`inbound`](super::inbound)), {Port-Status, uplink}. Hold-Status is alone. A missing object
//!   is left out, or is zeros if it is between others.
//! - Each message is sent once a period. If the budget does not suffice, Reported-Position is sent before every one of
//!   the other messages. The others take turns.
//! - An object that is unchanged in the next image is not sent again.
//!
//! The budget fills by the permitted bytes per second, up to the bytes of a tenth of a second or of one message,
//! whichever is more. So the radio's own queue stays short.

use mavlink::consts::v2::{IFLAG_SIGNED, SIGNATURE_SIZE};
use mavlink::dialects::common::MavMessage;
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MessageData};
use profile::ReportedPosition;
use profile::ssi::client::Shown;

use super::signing::{self, Signer};
use super::standard;
use super::tunnel::Tunnel;
use crate::{Bundle, Place};

/// The objects that share a message: the first object, and the number of objects.
const UNITS: [(Place, usize); 6] = [
    (Place::LinkStatus, 2),
    (Place::Gps(1), 2),
    (Place::Gps(3), 2),
    (Place::Gps(5), 1),
    (Place::PortStatus, 2),
    (Place::Hold, 1),
];

const LONGEST: u64 = 12 + Tunnel::ENCODED_LEN as u64 + SIGNATURE_SIZE as u64;

const HEARTBEAT_US: u64 = 1_000_000;

const FRESH_US: u64 = 1_000_000;

/// The rates at which the forwarder sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rates {
    /// The bytes per second that are sent over the link, at least 100.
    pub bytes_per_s: u32,
    /// The shortest time from one message of a kind to the next, µs.
    pub period_us: u64,
    /// The time from one standard position message to the next, µs; with 0, neither standard messages nor HEARTBEAT are
    /// sent. Ground stations show standard messages beside the vehicle's own position, so the user must enable them.
    pub standard_us: u64,
}

/// The default rates: 10 Hz within 3 kB/s, without standard messages.
impl Default for Rates {
    fn default() -> Self {
        Self { bytes_per_s: 3_000, period_us: 100_000, standard_us: 0 }
    }
}

#[derive(Clone, Copy, Debug)]
struct Newest {
    bytes: [u8; ReportedPosition::SIZE],
    fresh: bool,
}

/// Selects and encodes objects in a flight controller. See the [module](self).
#[derive(Clone, Debug)]
pub struct Forwarder {
    system: u8,
    component: u8,
    rates: Rates,
    signer: Option<Signer>,
    newest: [Option<Newest>; Place::COUNT],
    /// The instant, µs, at which each message of [`UNITS`] is due next: one period after the last time that it was due,
    /// even if it was sent late.
    due_us: [u64; UNITS.len()],
    others_turn: bool,
    /// The budget, in millionths of a byte, and the instant, µs, for which it was calculated.
    bucket: (u64, u64),
    heartbeat_us: Option<u64>,
    reported: (bool, Option<u64>),
    standard_us: Option<u64>,
    standard: Vec<MavMessage>,
    /// The MAVLink sequence numbers of the flight controller's component and of the component for standard messages.
    sequences: [u8; 2],
}

impl Forwarder {
    /// Returns a forwarder of a flight controller with this system and component id.
    #[must_use]
    pub fn new(system: u8, component: u8, rates: Rates) -> Self {
        Self {
            system,
            component,
            rates,
            signer: None,
            newest: [None; Place::COUNT],
            due_us: [0; UNITS.len()],
            others_turn: false,
            bucket: (0, 0),
            heartbeat_us: None,
            reported: (false, None),
            standard_us: None,
            standard: vec![],
            sequences: [0; 2],
        }
    }

    /// Makes the forwarder sign everything that it sends.
    #[must_use]
    pub fn signed(mut self, signer: Signer) -> Self {
        self.signer = Some(signer);
        self
    }

    /// Stores the objects that were read from the DPR, without judging them. Empty objects are ignored.
    pub fn offer(&mut self, bundle: &Bundle<'_>) {
        for (place, from) in bundle.objects() {
            if matches!(place.judge(from), Shown::Vacant) {
                continue;
            }
            let mut bytes = [0; ReportedPosition::SIZE];
            for (to, from) in bytes.iter_mut().zip(from) {
                *to = *from;
            }
            let newest = &mut self.newest[place.index()];
            if newest.is_none_or(|newest| newest.bytes != bytes) {
                *newest = Some(Newest { bytes, fresh: true });
                self.reported.0 |= place == Place::Reported;
            }
        }
    }

    /// Returns the next message that may be sent at `now_us`, µs on a clock that does not go back. Call this until it
    /// returns `None`. `unix_us`, µs since 1970, is only used for signatures.
    pub fn poll(&mut self, now_us: u64, unix_us: u64) -> Option<Vec<u8>> {
        if std::mem::take(&mut self.reported.0) {
            self.reported.1 = Some(now_us);
        }
        let (held, at_us) = self.bucket;
        let brought = now_us.saturating_sub(at_us).saturating_mul(u64::from(self.rates.bytes_per_s));
        let most = LONGEST.max(u64::from(self.rates.bytes_per_s) / 10).saturating_mul(1_000_000);
        self.bucket = (held.saturating_add(brought).min(most), now_us);
        // The budget must always suffice for the longest message. Otherwise short messages would overtake long ones.
        if self.bucket.0 < LONGEST * 1_000_000 {
            return None;
        }
        let message = self.next_standard(now_us).or_else(|| self.next_tunnel(now_us))?;
        let bytes = self.finish(message, unix_us);
        self.bucket.0 = self.bucket.0.saturating_sub(bytes.len() as u64 * 1_000_000);
        Some(bytes)
    }

    fn next_standard(&mut self, now_us: u64) -> Option<Outgoing> {
        let period_us = self.rates.standard_us;
        let due = |last: Option<u64>, period_us| last.is_none_or(|last| now_us.saturating_sub(last) >= period_us);
        if period_us == 0 {
            return None;
        }
        let reported = self.newest[Place::Reported.index()].filter(|_| !self.is_vacant(Place::Reported));
        let values =
            reported.and_then(|newest| ReportedPosition::verify(&newest.bytes).ok().map(ReportedPosition::values));
        if due(self.heartbeat_us, HEARTBEAT_US) {
            self.heartbeat_us = Some(now_us);
            let is_fresh = self.reported.1.is_some_and(|at_us| now_us.saturating_sub(at_us) <= FRESH_US);
            return Some(Outgoing::Standard(standard::heartbeat(values.as_ref().filter(|_| is_fresh))));
        }
        if self.standard.is_empty() && due(self.standard_us, period_us) && reported.is_some_and(|newest| newest.fresh) {
            self.standard_us = Some(now_us);
            self.standard = values.as_ref().map(standard::position).unwrap_or_default();
            self.standard.reverse();
        }
        self.standard.pop().map(Outgoing::Standard)
    }

    fn next_tunnel(&mut self, now_us: u64) -> Option<Outgoing> {
        let is_due = |unit: usize| {
            let fresh = |place: Place| self.newest[place.index()].is_some_and(|newest| newest.fresh);
            now_us >= self.due_us[unit] && self.places(unit).any(fresh)
        };
        // Among the messages without Reported-Position, the one that has been due longest has the first turn.
        let others = (1..UNITS.len()).filter(|unit| is_due(*unit)).min_by_key(|unit| self.due_us[*unit]);
        let unit = match others {
            Some(unit) if self.others_turn || !is_due(0) => unit,
            _ if is_due(0) => 0,
            _ => return None,
        };
        self.others_turn = unit == 0;
        let (due_us, period_us) = (self.due_us[unit], self.rates.period_us);
        let in_time = now_us.saturating_sub(due_us) < period_us;
        self.due_us[unit] = if in_time { due_us } else { now_us }.saturating_add(period_us);
        let fresh: Vec<_> = self.places(unit).filter(|place| !self.is_vacant(*place)).collect();
        let first = *fresh.first()?;
        let mut bytes = vec![];
        for place in &fresh {
            let newest = self.newest[place.index()].as_mut()?;
            newest.fresh = false;
            bytes.extend(&newest.bytes[..place.size()]);
        }
        Tunnel::of(&Bundle::new(first, fresh.len(), &bytes)?).map(Outgoing::Tunnel)
    }

    fn places(&self, unit: usize) -> impl Iterator<Item = Place> + use<> {
        let (first, count) = UNITS[unit];
        Place::ALL.into_iter().skip(first.index()).take(count)
    }

    fn is_vacant(&self, place: Place) -> bool {
        self.newest[place.index()].is_none()
    }

    fn finish(&mut self, message: Outgoing, unix_us: u64) -> Vec<u8> {
        let (component, which) = match message {
            Outgoing::Tunnel(_) => (self.component, 0),
            Outgoing::Standard(_) => (standard::COMPONENT, 1),
        };
        let header =
            MavHeader { system_id: u32::from(self.system), component_id: component, sequence: self.sequences[which] };
        self.sequences[which] = self.sequences[which].wrapping_add(1);
        let mut raw = MAVLinkV2MessageRaw::new();
        match (message, &self.signer) {
            (Outgoing::Standard(message), Some(_)) => raw.serialize_message_for_signing(header, &message),
            (Outgoing::Standard(message), None) => raw.serialize_message(header, &message),
            (Outgoing::Tunnel(message), signer) => {
                if signer.is_some() {
                    *raw.incompatibility_flags_mut() |= IFLAG_SIGNED;
                }
                raw.serialize_message_data(header, &message);
            }
        }
        if let Some(signer) = &mut self.signer {
            signer.sign(signing::timestamp(unix_us), &mut raw);
        }
        raw.raw_bytes().to_vec()
    }
}

enum Outgoing {
    Standard(MavMessage),
    Tunnel(Tunnel),
}

const _: () = assert!(Tunnel::ENCODED_LEN == 133);
