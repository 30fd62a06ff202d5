//! Selects, in the flight controller, which of the base station's uplinks are written to the DPR, and when an answer is
//! due.
//!
//! An uplink comes as a TUNNEL message to this system: payload type 0xC200, one object of 64 bytes, signed with the key
//! that station and drone share. Messages that are not signed, are for another system, are replayed, or hold no intact
//! uplink of the base station are counted and not written.
//!
//! Messages may be lost in both directions, so the base station repeats the object until an answer comes. The flight
//! controller writes the object once, and writes it again only while the DPR does not show it.
//!
//! **The answer** is Port-Status and the uplink, from the DPR's map. Each message with the uplink gets one answer: at
//! once if the DPR shows the uplink, and otherwise [`SHOWN_AFTER_US`] after the uplink was passed on to be written. The
//! flight controller reads this part of the map while [`reads_port`](Inbound::reads_port) returns true.
//!
//! This module does no I/O: its caller passes bytes in, and writes uplinks with
//! [`profile::ssi::client::Client::write`].

use profile::Uplink;
use profile::criticality::BaseStation;

use super::receiver::{Received, Receiver};
use super::signing::Verifier;
use crate::Place;

/// The time after which the map shows an uplink that was passed on to be written, µs: a control cycle for writing, up
/// to two images of 10 ms, and a control cycle for reading.
pub const SHOWN_AFTER_US: u64 = 40_000;

/// Totals of the uplinks that a flight controller received.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Counts {
    /// The number of times that an uplink was passed on to be written over the SSI.
    pub written: u64,
    /// The number of messages whose uplink the DPR already showed when the message came.
    pub repeated: u64,
    /// The number of signed messages for another system, or without an intact uplink of the base station.
    pub foreign: u64,
}

/// A flight controller's state about incoming uplinks. See the [module](self).
#[derive(Debug)]
pub struct Inbound {
    system: u8,
    receiver: Receiver,
    last: Option<(Uplink, bool)>,
    due_us: Option<u64>,
    counts: Counts,
}

impl Inbound {
    /// Returns the state of a flight controller with this system id. The state accepts messages that `verifier`
    /// accepts.
    #[must_use]
    pub fn new(system: u8, verifier: Verifier) -> Self {
        let receiver = Receiver::new(Some(verifier));
        Self { system, receiver, last: None, due_us: None, counts: Counts::default() }
    }

    /// Processes a datagram. Returns the uplink that must be written now, if any. `now_us` is µs on a clock that does
    /// not go back; `unix_us`, µs since 1970, is only used for signatures.
    pub fn datagram(&mut self, now_us: u64, unix_us: u64, bytes: &[u8]) -> Option<Uplink> {
        let received = self.receiver.datagram(unix_us, bytes);
        self.take(now_us, &received)
    }

    /// Processes the next bytes of a stream, like [`datagram`](Self::datagram).
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

    fn uplink(&self, received: &Received) -> Option<Uplink> {
        let bundle = received.bundle().filter(|_| received.target() == self.system)?;
        let (Place::Uplink, bytes) = bundle.objects().next()? else { return None };
        Uplink::verify::<BaseStation>(bytes).ok().copied()
    }

    /// Returns whether Port-Status and the base station's uplink must be read from the map now.
    #[must_use]
    pub const fn reads_port(&self) -> bool {
        self.due_us.is_some()
    }

    /// Processes Port-Status and the base station's uplink, 128 bytes of the map that were read at `now_us`. Returns
    /// whether to forward them as the answer.
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

    /// Returns the totals of received uplinks.
    #[must_use]
    pub const fn counts(&self) -> Counts {
        self.counts
    }

    /// Returns the totals of received messages, including the unsigned ones.
    #[must_use]
    pub const fn received(&self) -> super::receiver::Counts {
        self.receiver.counts()
    }
}
