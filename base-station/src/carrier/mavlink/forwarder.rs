//! The flight controller's side: which objects go when.
//!
//! # Design
//!
//! A radio carries less than HORUS sends: 100 profiles of 244 bytes a second are 24 kB/s, a telemetry radio carries 1
//! to 6. So the forwarder keeps the newest object of each kind and sends what its budget allows, always the newest,
//! never what is older than something that it has sent.
//!
//! - Objects that share a message: {Link-Status, Reported-Position}, {GPS1, GPS2}, {GPS3, GPS4}, {GPS5}, and, where it
//!   is offered as the answer to an uplink ([`inbound`](super::inbound)), {Port-Status, uplink}. None is ever split. A
//!   place that is vacant is left out, or zeros if it is between others.
//! - Each message goes once a period. If the budget does not suffice for that, Reported-Position goes before
//!   every message of the others, which take turns: the position is twice as often new as the fastest receiver.
//! - What is in the image again is not sent again.
//!
//! The budget is a bucket that fills by the bytes per second and holds what a tenth of a second brings, or one message:
//! so the radio's own queue stays short, and what it sends is not old by then.

use mavlink::consts::v2::{IFLAG_SIGNED, SIGNATURE_SIZE};
use mavlink::dialects::common::MavMessage;
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MessageData};
use profile::ReportedPosition;
use profile::ssi::client::Shown;

use super::signing::{self, Signer};
use super::standard;
use super::tunnel::Tunnel;
use crate::{Bundle, Place};

/// Which objects share a message: the first of them, and how many.
const UNITS: [(Place, usize); 5] =
    [(Place::LinkStatus, 2), (Place::Gps(1), 2), (Place::Gps(3), 2), (Place::Gps(5), 1), (Place::PortStatus, 2)];

/// The longest message, bytes: its frame and a full TUNNEL.
const LONGEST: u64 = 12 + Tunnel::ENCODED_LEN as u64 + SIGNATURE_SIZE as u64;

/// HEARTBEAT goes once a second, as the protocol has it, µs.
const HEARTBEAT_US: u64 = 1_000_000;

/// HEARTBEAT says HORUS's state for so long after the last new Reported-Position, µs.
const FRESH_US: u64 = 1_000_000;

/// How much is sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rates {
    /// Bytes per second over the link, at least 100.
    pub bytes_per_s: u32,
    /// From one message of a kind to the next at the earliest, µs.
    pub period_us: u64,
    /// From one standard position to the next, µs; none are sent if it is 0, nor HEARTBEAT. Ground stations show them
    /// beside what the vehicle says of itself, so whoever wants that says so.
    pub standard_us: u64,
}

/// 10 Hz within 3 kB/s, and no standard messages.
impl Default for Rates {
    fn default() -> Self {
        Self { bytes_per_s: 3_000, period_us: 100_000, standard_us: 0 }
    }
}

/// The newest bytes of one object.
#[derive(Clone, Copy, Debug)]
struct Newest {
    bytes: [u8; ReportedPosition::SIZE],
    /// They were not sent yet.
    fresh: bool,
}

/// A forwarder. See the [module](self).
#[derive(Clone, Debug)]
pub struct Forwarder {
    system: u8,
    component: u8,
    rates: Rates,
    signer: Option<Signer>,
    newest: [Option<Newest>; Place::COUNT],
    /// When each unit is due: one period after it was due last, however late it then went.
    due_us: [u64; UNITS.len()],
    /// Reported-Position went last, so it is the others' turn.
    others_turn: bool,
    /// Bytes that may be sent, in millionths, and when that was so.
    bucket: (u64, u64),
    heartbeat_us: Option<u64>,
    /// A new Reported-Position was offered since the last poll; and when the last poll was that found one.
    reported: (bool, Option<u64>),
    standard_us: Option<u64>,
    standard: Vec<MavMessage>,
    /// Of the flight controller's component, and of the one for standard messages.
    sequences: [u8; 2],
}

impl Forwarder {
    /// A forwarder of a flight controller with this system and component id.
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

    /// Signs all that it sends.
    #[must_use]
    pub fn signed(mut self, signer: Signer) -> Self {
        self.signer = Some(signer);
        self
    }

    /// Takes what was read of the DPR: objects as they are, none of them judged. What is vacant replaces nothing.
    pub fn offer(&mut self, bundle: &Bundle<'_>) {
        for (place, from) in bundle.objects() {
            if matches!(place.judge(from), Shown::Vacant) {
                continue;
            }
            let mut bytes = [0; ReportedPosition::SIZE];
            // No object is longer than Reported-Position.
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

    /// The next message that may go at `now_us`, µs of a clock that does not go back; to be called until there is none.
    /// `unix_us`, µs since 1970, is for signatures alone.
    pub fn poll(&mut self, now_us: u64, unix_us: u64) -> Option<Vec<u8>> {
        if std::mem::take(&mut self.reported.0) {
            self.reported.1 = Some(now_us);
        }
        let (held, at_us) = self.bucket;
        let brought = now_us.saturating_sub(at_us).saturating_mul(u64::from(self.rates.bytes_per_s));
        let most = LONGEST.max(u64::from(self.rates.bytes_per_s) / 10).saturating_mul(1_000_000);
        self.bucket = (held.saturating_add(brought).min(most), now_us);
        // Whatever goes next must fit: otherwise short messages would go before long ones.
        if self.bucket.0 < LONGEST * 1_000_000 {
            return None;
        }
        let message = self.next_standard(now_us).or_else(|| self.next_tunnel(now_us))?;
        let bytes = self.finish(message, unix_us);
        self.bucket.0 = self.bucket.0.saturating_sub(bytes.len() as u64 * 1_000_000);
        Some(bytes)
    }

    /// HEARTBEAT, or a standard message of the newest Reported-Position, if one is due.
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

    /// The next objects that are due, the newest of each.
    fn next_tunnel(&mut self, now_us: u64) -> Option<Outgoing> {
        let is_due = |unit: usize| {
            let fresh = |place: Place| self.newest[place.index()].is_some_and(|newest| newest.fresh);
            now_us >= self.due_us[unit] && self.places(unit).any(fresh)
        };
        // Of the other messages the one that is due longest.
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

    /// As on the wire.
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

/// A message that is to go.
enum Outgoing {
    Standard(MavMessage),
    Tunnel(Tunnel),
}

const _: () = assert!(Tunnel::ENCODED_LEN == 133);
