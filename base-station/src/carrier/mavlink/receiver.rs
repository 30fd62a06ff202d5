//! The base station's side: which objects came.
//!
//! Whatever else is on the link changes nothing: other messages, other payload types, MAVLink 1, bytes that are no
//! MAVLink at all. A frame whose checksum does not fit is searched for another one from its second byte on.

use std::collections::VecDeque;
use std::fmt;
use std::io::{self, Read};

use mavlink::dialects::common::MavMessage;
use mavlink::{MAVLinkMessageRaw, MAVLinkV2MessageRaw, MavlinkReader, MavlinkVersion, MessageData};

use super::signing::{self, Verifier};
use super::tunnel::Tunnel;
use crate::{Bundle, DroneId};

/// Objects that came in one message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Received {
    /// MAVLink's system id: which drone it is.
    pub system: u32,
    /// Who sent it.
    pub component: u8,
    tunnel: Tunnel,
}

impl Received {
    /// Which drone it is.
    #[must_use]
    pub const fn id(&self) -> DroneId {
        DroneId::System(self.system)
    }

    /// The objects.
    #[must_use]
    pub fn bundle(&self) -> Option<Bundle<'_>> {
        self.tunnel.bundle()
    }
}

/// Totals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Counts {
    /// Messages with objects.
    pub tunnels: u64,
    /// Intact messages that are none of ours.
    pub foreign: u64,
    /// Messages with objects that were refused: not signed, wrongly signed, or recorded and sent again.
    pub unsigned: u64,
}

/// Bytes that came and were not read yet.
#[derive(Debug, Default)]
struct Pending(VecDeque<u8>);

impl Read for Pending {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        match self.0.read(to)? {
            0 => Err(io::ErrorKind::WouldBlock.into()),
            read => Ok(read),
        }
    }
}

/// A receiver of one link. See the [module](self).
pub struct Receiver {
    stream: MavlinkReader<Pending>,
    verifier: Option<Verifier>,
    counts: Counts,
}

impl fmt::Debug for Receiver {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Receiver").field("counts", &self.counts).finish_non_exhaustive()
    }
}

impl Default for Receiver {
    fn default() -> Self {
        Self::new(None)
    }
}

impl Receiver {
    /// A receiver; with a verifier it takes nothing that is not signed.
    #[must_use]
    pub fn new(verifier: Option<Verifier>) -> Self {
        Self { stream: MavlinkReader::new(Pending::default()), verifier, counts: Counts::default() }
    }

    /// Takes a datagram, which holds whole messages. `unix_us`, µs since 1970, is for signatures alone.
    pub fn datagram(&mut self, unix_us: u64, bytes: &[u8]) -> Vec<Received> {
        // It holds whatever is longest, and no more than the datagram.
        let mut reader = MavlinkReader::with_capacity(0, bytes);
        let mut received = vec![];
        while let Ok(message) = reader.read_raw_message::<MavMessage>(MavlinkVersion::V2) {
            received.extend(self.message(unix_us, &message));
        }
        received
    }

    /// Takes the next bytes of a stream: whole messages, or parts of them.
    pub fn stream(&mut self, unix_us: u64, bytes: &[u8]) -> Vec<Received> {
        self.stream.get_mut().0.extend(bytes);
        let mut received = vec![];
        while let Ok(message) = self.stream.read_raw_message::<MavMessage>(MavlinkVersion::V2) {
            received.extend(self.message(unix_us, &message));
        }
        received
    }

    /// Totals.
    #[must_use]
    pub const fn counts(&self) -> Counts {
        self.counts
    }

    fn message(&mut self, unix_us: u64, message: &MAVLinkMessageRaw) -> Option<Received> {
        let MAVLinkMessageRaw::V2(raw) = message else { return None };
        let received = received(raw);
        if received.is_none() {
            self.counts.foreign += 1;
            return None;
        }
        if let Some(verifier) = &mut self.verifier
            && !verifier.verify(signing::timestamp(unix_us), raw)
        {
            self.counts.unsigned += 1;
            return None;
        }
        self.counts.tunnels += 1;
        received
    }
}

/// The objects in a message, if it is one of ours.
fn received(raw: &MAVLinkV2MessageRaw) -> Option<Received> {
    let tunnel = Tunnel::deser(MavlinkVersion::V2, raw.payload()).ok().filter(|_| raw.message_id() == Tunnel::ID)?;
    tunnel.bundle()?;
    Some(Received { system: raw.system_id(), component: raw.component_id(), tunnel })
}
