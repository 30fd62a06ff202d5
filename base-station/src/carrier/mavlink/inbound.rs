//! The flight controller's side of the way back: it selects the base station's uplinks that are written to the DPR, and
//! determines when an answer is due.
//!
//! # Design
//!
//! An uplink comes as a TUNNEL message to this system: payload type 0xC200, one object of 64 bytes, signed with the key
//! that station and drone share. A message that is not signed, is for another system, is replayed, or holds no intact
//! uplink of the base station, is counted and not written.
//!
//! The base station sends the same object again until it gets an answer, because either way loses messages. The object
//! is written once, and again only while the DPR does not show it: the DPR refuses to store the same object twice.
//!
//! **The answer** is the DPR's own state: Port-Status and the uplink, as they are in its map. It is due once for each
//! message that brought the uplink, at once if the DPR shows it, otherwise [`SHOWN_AFTER_US`] after it was passed on to
//! be written. The map's port is read when [`reads_port`](Inbound::reads_port) returns true.
//!
//! This module has no clock and no I/O: its caller passes datagrams or bytes in, and writes with
//! [`profile::ssi::client::Client::write`].

use profile::Uplink;
use profile::criticality::BaseStation;

use super::receiver::{Received, Receiver};
use super::signing::Verifier;
use crate::Place;

/// The time after which a written uplink shows in the map, µs: the control cycle that writes it, up to two images of 10
/// ms, and another cycle that reads it.
pub const SHOWN_AFTER_US: u64 = 40_000;

/// Totals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Counts {
    /// The number of times that an uplink was passed on to be written.
    pub written: u64,
    /// Messages that brought an uplink which the DPR showed already.
    pub repeated: u64,
    /// Signed messages for another system, or without an intact uplink of the base station.
    pub foreign: u64,
}

/// The state that a flight controller keeps about incoming uplinks. See the [module](self).
#[derive(Debug)]
pub struct Inbound {
    system: u8,
    receiver: Receiver,
    /// The last uplink, and whether the DPR has shown it.
    last: Option<(Uplink, bool)>,
    /// The instant at which the next answer is due, µs.
    due_us: Option<u64>,
    counts: Counts,
}

impl Inbound {
    /// For a flight controller with this system id; it accepts what `verifier` accepts.
    #[must_use]
    pub fn new(system: u8, verifier: Verifier) -> Self {
        let receiver = Receiver::new(Some(verifier));
        Self { system, receiver, last: None, due_us: None, counts: Counts::default() }
    }

    /// Takes a datagram. Returns the uplink that must be written now, if there is one. `now_us` is µs of a clock that
    /// does not go back; `unix_us`, µs since 1970, is only used for signatures.
    pub fn datagram(&mut self, now_us: u64, unix_us: u64, bytes: &[u8]) -> Option<Uplink> {
        let received = self.receiver.datagram(unix_us, bytes);
        self.take(now_us, &received)
    }

    /// Takes the next bytes of a stream, and otherwise does the same as [`datagram`](Self::datagram).
    pub fn stream(&mut self, now_us: u64, unix_us: u64, bytes: &[u8]) -> Option<Uplink> {
        let received = self.receiver.stream(unix_us, bytes);
        self.take(now_us, &received)
    }

    fn take(&mut self, now_us: u64, received: &[Received]) -> Option<Uplink> {
        let mut to_write = None;
        for received in received {
            let Some(uplink) = self.uplink(received) else {
                self.counts.foreign += 1;
                continue;
            };
            match self.last {
                Some((last, true)) if last == uplink => {
                    self.counts.repeated += 1;
                    self.due_us = Some(now_us);
                }
                _ => {
                    self.counts.written += 1;
                    self.last = Some((uplink, false));
                    self.due_us = Some(now_us.saturating_add(SHOWN_AFTER_US));
                    to_write = Some(uplink);
                }
            }
        }
        to_write
    }

    /// The uplink in a message, if it is one for this system.
    fn uplink(&self, received: &Received) -> Option<Uplink> {
        let bundle = received.bundle().filter(|_| received.target() == self.system)?;
        let (Place::Uplink, bytes) = bundle.objects().next()? else { return None };
        Uplink::verify::<BaseStation>(bytes).ok().copied()
    }

    /// Whether Port-Status and the uplink of the base station must be read from the map at present.
    #[must_use]
    pub const fn reads_port(&self) -> bool {
        self.due_us.is_some()
    }

    /// Takes Port-Status and the base station's uplink, 128 bytes of the map, as read at `now_us`. Returns whether they
    /// must be forwarded as the answer to an uplink.
    pub fn read(&mut self, now_us: u64, port: &[u8]) -> bool {
        let shown = port.get(profile::PortStatus::SIZE..);
        let is_shown = self.last.as_mut().is_some_and(|(last, was_shown)| {
            *was_shown |= shown == Some(last.as_bytes().as_slice());
            *was_shown
        });
        let is_due = self.due_us.is_some_and(|due_us| is_shown || now_us >= due_us);
        if is_due {
            self.due_us = None;
        }
        is_due
    }

    /// Totals.
    #[must_use]
    pub const fn counts(&self) -> Counts {
        self.counts
    }

    /// Totals of the received messages, including the unsigned ones.
    #[must_use]
    pub const fn received(&self) -> super::receiver::Counts {
        self.receiver.counts()
    }
}
