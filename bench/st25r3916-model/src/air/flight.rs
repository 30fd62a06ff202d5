//! One frame on its way from the poller's antenna to the listener's: what the poller sent of it, and what the air does
//! to it.

use std::collections::VecDeque;

use super::account::{Fault, Heard, Origin, SentFrame};
use super::faults::AirFaults;
use crate::event::{Chunk, FrameStart, Technology};

/// The number of bits in NFC-A's end of communication: a logic 0 and a bit without modulation.
const NFC_A_TRAILER_BITS: u32 = 2;
/// The number of bytes of an NFC-F frame that its LEN does not count, which are those of the CRC-16.
const CRC_BYTES: usize = 2;

/// Returns the number of bytes of an NFC-F frame, CRC included, by its LEN `first`; `None` for NFC-A, which has no LEN.
fn announced(technology: Technology, first: Option<&u8>) -> Option<usize> {
    match technology {
        Technology::NfcF => first.map(|&len| usize::from(len.max(1)) + CRC_BYTES),
        Technology::NfcA => None,
    }
}

/// Returns the number of data bits that a frame is expected to have, as known at its start.
pub(super) fn expected_bits(start: &FrameStart) -> u64 {
    let data = &start.chunk.data;
    8 * announced(start.technology, data.first()).unwrap_or(data.len()) as u64
}

/// The frame that the poller is sending.
#[derive(Clone, Debug)]
pub(super) struct Sending {
    pub(super) id: u64,
    pub(super) started_ns: u64,
    /// The start of the frame with its bytes so far, without the air's effects.
    start: FrameStart,
}

impl Sending {
    pub(super) fn new(id: u64, started_ns: u64, start: FrameStart) -> Self {
        Self { id, started_ns, start }
    }

    /// Returns the number of the frame's bytes that the poller has given to the air so far.
    pub(super) fn len(&self) -> usize {
        self.start.chunk.data.len()
    }

    pub(super) fn more(&mut self, chunk: &Chunk) {
        self.start.chunk.data.extend_from_slice(&chunk.data);
    }

    /// Returns the number of the frame's data bits that were on the air by `at`.
    pub(super) fn bits_by(&self, at: u64) -> u32 {
        let bits = self.start.data_bits_in(at.saturating_sub(self.started_ns)).min(8 * self.len() as u64);
        u32::try_from(bits).unwrap_or(u32::MAX)
    }

    /// Returns the frame as the poller sent it, for a frame that ends at `at` after `bits` data bits.
    ///
    /// A frame is whole when every bit that the poller gave to the air was sent, and when the frame is complete by its
    /// own format: an NFC-F frame by the number of bytes in its LEN, an NFC-A frame by its end of communication, which
    /// is missing if the frame breaks off.
    pub(super) fn ended(self, at: u64, bits: u32) -> SentFrame {
        let Self { started_ns, mut start, .. } = self;
        let data = &mut start.chunk.data;
        let whole = match announced(start.technology, data.first()) {
            Some(bytes) => bits as usize >= 8 * data.len().max(bytes),
            None => {
                let air = start.header_bits + bits / 8 * start.byte_bits + bits % 8 + NFC_A_TRAILER_BITS;
                start.technology == Technology::NfcA
                    && bits.div_ceil(8) as usize >= data.len()
                    && crate::clock::bits_in(at.saturating_sub(started_ns), start.bit_as) >= u64::from(air)
            }
        };
        if !whole {
            data.truncate(bits as usize / 8);
        }
        let bytes = std::mem::take(data);
        SentFrame { started_ns, ended_ns: at, bits_per_second: start.bits_per_second, bytes, whole }
    }
}

/// An event of a frame after its start: further bytes, or the end.
#[derive(Clone, Debug)]
pub(super) enum Later {
    Bytes(Chunk),
    End { bits: u32, whole: bool },
}

/// A frame on its way to the listener. The times of its later events count from its first bit, because that bit may be
/// delayed.
#[derive(Clone, Debug)]
pub(super) struct Flight {
    pub(super) id: u64,
    pub(super) origin: Origin,
    /// The faults that were in force when the poller began the frame. They determine what happens to the frame until
    /// its end.
    pub(super) faults: AirFaults,
    /// When the frame's first bit is due at the listener, ns; `None` while the frame waits for another frame to end.
    pub(super) due: Option<u64>,
    /// The frame as the listener receives it, with the bytes that are known so far.
    pub(super) start: FrameStart,
    /// The positions of the data bits that a burst inverts in the frame.
    pub(super) burst: Vec<u64>,
    /// The frame's events after its start, in order, each with the time from the frame's first bit, ns. Events after
    /// the frame's end are ignored.
    pub(super) later: VecDeque<(u64, Later)>,
    /// Whether the frame carries the bytes of an earlier frame, so that further bytes from the poller are ignored.
    pub(super) frozen: bool,
    /// Whether the air has changed a bit of the frame.
    pub(super) changed: bool,
    /// The faults in the frame, each with the time from the frame's first bit to the first bit that the fault concerns,
    /// ns.
    pub(super) marks: VecDeque<(u64, Fault)>,
}

impl Flight {
    /// Returns a frame that the listener receives as the poller sends it, from `at` on.
    pub(super) fn new(id: u64, faults: AirFaults, at: u64, start: FrameStart) -> Self {
        Self {
            id,
            origin: Origin::Poller,
            faults,
            due: Some(at),
            start,
            burst: vec![],
            later: VecDeque::new(),
            frozen: false,
            changed: false,
            marks: VecDeque::new(),
        }
    }

    /// Returns a repetition of this frame as it was received. The repetition begins at `due` and takes `took` ns.
    pub(super) fn again(self, id: u64, due: u64, took: u64, bits: u32) -> Self {
        let later = VecDeque::from([(took, Later::End { bits, whole: true })]);
        let (origin, burst, marks) = (Origin::Repeated, vec![], VecDeque::new());
        Self { id, origin, due: Some(due), later, burst, marks, ..self }
    }

    /// Returns the instant of the frame's next event, for a frame whose first bit was at `began`.
    pub(super) fn next(&self, began: u64) -> Option<u64> {
        self.later.front().map(|(after, _)| began.saturating_add(*after))
    }

    /// Records a fault in the frame, `after` ns from the frame's first bit.
    pub(super) fn mark(&mut self, after: u64, fault: Fault) {
        let place = self.marks.partition_point(|(other, _)| *other <= after);
        self.marks.insert(place, (after, fault));
    }

    /// Cuts the frame after the first `bytes` of the bytes that it has now.
    pub(super) fn cut(&mut self, bytes: usize) {
        self.start.chunk.data.truncate(bytes);
        let end = self.start.until_byte(bytes);
        let bits = u32::try_from(8 * bytes).unwrap_or(u32::MAX);
        self.later.push_back((end, Later::End { bits, whole: false }));
    }

    /// Returns the received frame, which began at `began` and ended at `ended_ns` after `bits` data bits.
    pub(super) fn heard(&self, began: u64, ended_ns: u64, bits: u32, whole: bool) -> Heard {
        let mut bytes = self.start.chunk.data.clone();
        if !whole {
            bytes.truncate(bits as usize / 8);
        }
        Heard { started_ns: began, ended_ns, bytes, whole, origin: self.origin }
    }
}
