//! Finds, in the base station, the objects in arriving MAVLink.
//!
//! Other messages, other payload types, MAVLink 1 and bytes that are no MAVLink have no effect. After a frame with a
//! wrong checksum, the search continues at that frame's second byte. After a frame with a missing or wrong signature,
//! it continues at the signature: the message may have been cut off before the signature, which the checksum does not
//! cover.

use std::fmt;

use mavlink::consts::v2::{
    IFLAG_SIGNED, IFLAG_SYSID32, INCOMPAT_FLAGS_OFFSET, MIN_HEADER_SIZE, SIGNATURE_SIZE, SUPPORTED_IFLAGS,
    SYSID32_EXTRA_HEADER_SIZE,
};
use mavlink::consts::{CHECKSUM_SIZE, MAX_FRAME_SIZE, PAYLOAD_LEN_OFFSET, STX_SIZE};
use mavlink::dialects::common::MavMessage;
use mavlink::{MAV_STX, MAV_STX_V2, MAVLinkV2MessageRaw, MavlinkVersion, MessageData};

use super::signing::{self, Verifier};
use super::tunnel::Tunnel;
use crate::{Bundle, Who};

/// A received message that carries objects.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Received {
    /// MAVLink's system id, which identifies the drone.
    pub system: u32,
    /// The MAVLink component id of the sender.
    pub component: u8,
    tunnel: Tunnel,
}

impl Received {
    /// Returns the id of the drone that sent the message.
    #[must_use]
    pub const fn who(&self) -> Who {
        Who::System(self.system)
    }

    /// Returns the MAVLink system for which the message is; 0 means all systems.
    #[must_use]
    pub const fn target(&self) -> u8 {
        self.tunnel.target_system
    }

    /// Returns the objects in the message.
    #[must_use]
    pub fn bundle(&self) -> Option<Bundle<'_>> {
        self.tunnel.bundle()
    }
}

/// Totals of the messages that were received over MAVLink.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Counts {
    /// The number of messages with objects.
    pub tunnels: u64,
    /// The number of intact messages without objects.
    pub foreign: u64,
    /// The number of messages with objects that were refused: not signed, wrongly signed, or replayed.
    pub unsigned: u64,
    /// The number of TUNNEL messages whose payload type or length fits no objects.
    pub malformed: u64,
    /// The number of TUNNEL messages with a wrong checksum.
    pub bad_crc: u64,
    /// The number of datagrams of MAVLink 1, which has no TUNNEL.
    pub version_1: u64,
}

/// A receiver of one link. See the [module](self).
#[derive(Default)]
pub struct Receiver {
    held: Vec<u8>,
    verifier: Option<Verifier>,
    counts: Counts,
}

impl fmt::Debug for Receiver {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Receiver").field("counts", &self.counts).finish_non_exhaustive()
    }
}

impl Receiver {
    /// Returns a receiver. With a verifier it accepts only signed messages.
    #[must_use]
    pub fn new(verifier: Option<Verifier>) -> Self {
        Self { verifier, ..Self::default() }
    }

    /// Processes a datagram of whole messages, and returns the messages with objects. `unix_us`, µs since 1970, is only
    /// used for signatures.
    pub fn datagram(&mut self, unix_us: u64, bytes: &[u8]) -> Vec<Received> {
        let (mut received, mut at) = (vec![], 0);
        self.counts.version_1 += u64::from(bytes.first() == Some(&MAV_STX));
        while at < bytes.len() {
            at = self.all(unix_us, bytes, at, &mut received);
            // A message in a datagram cannot continue in the next datagram. So the search goes on at the next byte.
            at += 1;
        }
        received
    }

    /// Processes the next bytes of a stream and returns the messages with objects that they complete.
    pub fn stream(&mut self, unix_us: u64, bytes: &[u8]) -> Vec<Received> {
        let mut held = std::mem::take(&mut self.held);
        held.extend(bytes);
        let mut received = vec![];
        let read = self.all(unix_us, &held, 0, &mut received);
        held.drain(..read);
        self.held = held;
        received
    }

    /// Processes every whole message in `bytes` from `at` on. Returns the position of the first incomplete message, or
    /// the end of `bytes`.
    fn all(&mut self, unix_us: u64, bytes: &[u8], mut at: usize, received: &mut Vec<Received>) -> usize {
        while let Some(candidate) = bytes.get(at..) {
            let Some(skipped) = candidate.iter().position(|byte| *byte == MAV_STX_V2) else { break };
            at += skipped;
            match begin(&candidate[skipped..]) {
                Begin::Short => return at,
                Begin::None { bad_crc } => {
                    self.counts.bad_crc += u64::from(bad_crc);
                    at += 1;
                }
                Begin::Message(raw) => {
                    let (taken, is_verified) = self.message(unix_us, &raw);
                    received.extend(taken);
                    let signed = raw.incompatibility_flags() & IFLAG_SIGNED != 0;
                    let again = if signed && !is_verified { SIGNATURE_SIZE } else { 0 };
                    at += raw.raw_bytes().len() - again;
                }
            }
        }
        bytes.len()
    }

    /// Returns the totals of received messages.
    #[must_use]
    pub const fn counts(&self) -> Counts {
        self.counts
    }

    fn message(&mut self, unix_us: u64, raw: &MAVLinkV2MessageRaw) -> (Option<Received>, bool) {
        let Some(received) = received(raw) else {
            let count =
                if raw.message_id() == Tunnel::ID { &mut self.counts.malformed } else { &mut self.counts.foreign };
            *count += 1;
            return (None, false);
        };
        let is_verified = self.verifier.as_mut().map(|verifier| verifier.verify(signing::timestamp(unix_us), raw));
        if is_verified == Some(false) {
            self.counts.unsigned += 1;
            return (None, false);
        }
        self.counts.tunnels += 1;
        (Some(received), is_verified.is_some())
    }
}

enum Begin {
    /// Further bytes are needed to tell whether these bytes are a message.
    Short,
    /// The bytes are no message, or a TUNNEL with a wrong checksum.
    None { bad_crc: bool },
    /// The bytes begin with a message that has a right checksum.
    Message(Box<MAVLinkV2MessageRaw>),
}

fn begin(candidate: &[u8]) -> Begin {
    let (Some(payload), Some(flags)) = (candidate.get(PAYLOAD_LEN_OFFSET), candidate.get(INCOMPAT_FLAGS_OFFSET)) else {
        return Begin::Short;
    };
    if flags & !SUPPORTED_IFLAGS != 0 {
        return Begin::None { bad_crc: false };
    }
    let long_id = if flags & IFLAG_SYSID32 != 0 { SYSID32_EXTRA_HEADER_SIZE } else { 0 };
    let signature = if flags & IFLAG_SIGNED != 0 { SIGNATURE_SIZE } else { 0 };
    let length = STX_SIZE + MIN_HEADER_SIZE + long_id + usize::from(*payload) + CHECKSUM_SIZE + signature;
    let Some(frame) = candidate.get(..length) else { return Begin::Short };
    let mut bytes = [0; MAX_FRAME_SIZE];
    bytes[..length].copy_from_slice(frame);
    let raw = MAVLinkV2MessageRaw::from_bytes_unparsed(bytes);
    if raw.has_valid_crc::<MavMessage>() {
        return Begin::Message(Box::new(raw));
    }
    Begin::None { bad_crc: raw.message_id() == Tunnel::ID }
}

fn received(raw: &MAVLinkV2MessageRaw) -> Option<Received> {
    let tunnel = Tunnel::deser(MavlinkVersion::V2, raw.payload()).ok().filter(|_| raw.message_id() == Tunnel::ID)?;
    tunnel.bundle()?;
    Some(Received { system: raw.system_id(), component: raw.component_id(), tunnel })
}
