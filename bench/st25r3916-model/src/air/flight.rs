//! One frame on its way from the poller's antenna to the listener's: the poller's part of it, and its fate on the way.

use std::collections::VecDeque;

use super::account::{Fault, Heard, Origin, SentFrame};
use super::faults::AirFaults;
use crate::event::{Chunk, FrameStart, Technology};

/// Bits of NFC-A's end of communication: a logic 0 and a bit without modulation.
const NFC_A_TRAILER_BITS: u32 = 2;
/// Bytes of an NFC-F frame that LEN does not count.
const CRC_BYTES: usize = 2;

/// The number of bytes of an NFC-F frame, by its LEN; `None` for NFC-A, which has no length.
fn announced(technology: Technology, first: Option<&u8>) -> Option<usize> {
    match technology {
        Technology::NfcF => first.map(|&len| usize::from(len.max(1)) + CRC_BYTES),
        Technology::NfcA => None,
    }
}

/// The number of data bits of a frame that are known at its start.
pub(super) fn expected_bits(start: &FrameStart) -> u64 {
    let data = &start.chunk.data;
    8 * announced(start.technology, data.first()).unwrap_or(data.len()) as u64
}

/// The frame that the poller is sending.
#[derive(Clone, Debug)]
pub(super) struct Sending {
    pub(super) id: u64,
    pub(super) started_ns: u64,
    /// Its bytes so far, without the air's effects.
    start: FrameStart,
}

impl Sending {
    pub(super) fn new(id: u64, started_ns: u64, start: FrameStart) -> Self {
        Self { id, started_ns, start }
    }

    /// The number of bytes that the poller has given so far.
    pub(super) fn len(&self) -> usize {
        self.start.chunk.data.len()
    }

    pub(super) fn more(&mut self, chunk: &Chunk) {
        self.start.chunk.data.extend_from_slice(&chunk.data);
    }

    /// The number of data bits that were on the air by `at`.
    pub(super) fn bits_by(&self, at: u64) -> u32 {
        let bits = self.start.data_bits_in(at.saturating_sub(self.started_ns)).min(8 * self.len() as u64);
        u32::try_from(bits).unwrap_or(u32::MAX)
    }

    /// The frame that the poller has sent, if it ends at `at` after `bits` data bits.
    ///
    /// A frame is whole when every bit that the poller gave was on the air, and every byte that the frame itself
    /// announces: an NFC-F frame by its LEN, an NFC-A frame by its end of communication, which is missing if it breaks
    /// off.
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

/// An event after a frame's start.
#[derive(Clone, Debug)]
pub(super) enum Later {
    Bytes(Chunk),
    End { bits: u32, whole: bool },
}

/// A frame on its way to the listener. Its instants count from its first bit, whenever that is on the air.
#[derive(Clone, Debug)]
pub(super) struct Flight {
    pub(super) id: u64,
    pub(super) origin: Origin,
    /// The faults when it began: they decide its fate to its end.
    pub(super) faults: AirFaults,
    /// Its first bit at the listener, ns; `None` while it waits for another frame to end.
    pub(super) due: Option<u64>,
    /// The frame as received, as far as it is known.
    pub(super) start: FrameStart,
    /// The data bits that a burst inverts.
    pub(super) burst: Vec<u64>,
    /// The events after its start, in order; later ones than its end are ignored.
    pub(super) later: VecDeque<(u64, Later)>,
    /// It carries the bytes of an earlier frame: the poller's further bytes are ignored.
    pub(super) frozen: bool,
    /// Whether the air has changed a bit of it.
    pub(super) changed: bool,
    /// The faults in it, each with the first bit it concerns.
    pub(super) marks: VecDeque<(u64, Fault)>,
}

impl Flight {
    /// A frame that is received when the poller sends it, from `at` on.
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

    /// Repeats what was received of it in `took` ns, from `due` on.
    pub(super) fn again(self, id: u64, due: u64, took: u64, bits: u32) -> Self {
        let later = VecDeque::from([(took, Later::End { bits, whole: true })]);
        let (origin, burst, marks) = (Origin::Repeated, vec![], VecDeque::new());
        Self { id, origin, due: Some(due), later, burst, marks, ..self }
    }

    /// The instant of its next event, once it is on the air.
    pub(super) fn next(&self, began: u64) -> Option<u64> {
        self.later.front().map(|(after, _)| began.saturating_add(*after))
    }

    /// Marks a fault in it, `after` ns from its first bit.
    pub(super) fn mark(&mut self, after: u64, fault: Fault) {
        let place = self.marks.partition_point(|(other, _)| *other <= after);
        self.marks.insert(place, (after, fault));
    }

    /// Cuts it after `bytes` of its present bytes.
    pub(super) fn cut(&mut self, bytes: usize) {
        self.start.chunk.data.truncate(bytes);
        let end = self.start.until_byte(bytes);
        let bits = u32::try_from(8 * bytes).unwrap_or(u32::MAX);
        self.later.push_back((end, Later::End { bits, whole: false }));
    }

    /// The received frame, which ended at `ended_ns` after `bits` data bits.
    pub(super) fn heard(&self, began: u64, ended_ns: u64, bits: u32, whole: bool) -> Heard {
        let mut bytes = self.start.chunk.data.clone();
        if !whole {
            bytes.truncate(bits as usize / 8);
        }
        Heard { started_ns: began, ended_ns, bytes, whole, origin: self.origin }
    }
}
