//! A frame on its way from the poller's antenna to the listener's.

use std::collections::VecDeque;

use super::account::{Fault, Heard, Origin, SentFrame};
use super::faults::AirFaults;
use crate::event::{Chunk, FrameStart, Technology};

const NFC_A_TRAILER_BITS: u32 = 2;
/// The number of CRC bytes, which LEN of an NFC-F frame does not count.
const CRC_BYTES: usize = 2;

/// Returns the number of bytes, with the CRC, of an NFC-F frame whose LEN is `first`; `None` for NFC-A.
fn announced(technology: Technology, first: Option<&u8>) -> Option<usize> {
    match technology {
        Technology::NfcF => first.map(|&len| usize::from(len.max(1)) + CRC_BYTES),
        Technology::NfcA => None,
    }
}

/// Returns the number of data bits in the whole frame, as announced at the start of the frame.
pub(super) fn expected_bits(start: &FrameStart) -> u64 {
    let data = &start.chunk.data;
    8 * announced(start.technology, data.first()).unwrap_or(data.len()) as u64
}

#[derive(Clone, Debug)]
pub(super) struct Sending {
    pub(super) id: u64,
    pub(super) started_ns: u64,
    start: FrameStart,
}

impl Sending {
    pub(super) fn new(id: u64, started_ns: u64, start: FrameStart) -> Self {
        Self { id, started_ns, start }
    }

    pub(super) fn len(&self) -> usize {
        self.start.chunk.data.len()
    }

    pub(super) fn more(&mut self, chunk: &Chunk) {
        self.start.chunk.data.extend_from_slice(&chunk.data);
    }

    pub(super) fn bits_by(&self, at: u64) -> u32 {
        let bits = self.start.data_bits_in(at.saturating_sub(self.started_ns)).min(8 * self.len() as u64);
        u32::try_from(bits).unwrap_or(u32::MAX)
    }

    /// Returns the frame as the poller sent it, which ends at `at` after `bits` data bits. It is whole if the poller
    /// sent the bytes that LEN announces (NFC-F) or the end of communication (NFC-A).
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

#[derive(Clone, Debug)]
pub(super) enum Later {
    Bytes(Chunk),
    End { bits: u32, whole: bool },
}

/// A frame on its way to the listener. The instants of its events count from its first bit, which may be delayed.
#[derive(Clone, Debug)]
pub(super) struct Flight {
    pub(super) id: u64,
    pub(super) origin: Origin,
    pub(super) faults: AirFaults,
    /// The instant at which the frame's first bit reaches the listener, ns; `None` while the frame waits for another
    /// one.
    pub(super) due: Option<u64>,
    /// The frame as the listener receives it. It has the bytes that are known so far.
    pub(super) start: FrameStart,
    pub(super) burst: Vec<u64>,
    /// The frame's events after its start, each with the time from its first bit, ns. Events after the frame's end are
    /// ignored.
    pub(super) later: VecDeque<(u64, Later)>,
    /// Whether the frame carries the bytes of an earlier frame. If so, the poller's further bytes are ignored.
    pub(super) frozen: bool,
    pub(super) changed: bool,
    /// The faults in the frame, each with the time, ns, from the frame's first bit to the first bit with the fault.
    pub(super) marks: VecDeque<(u64, Fault)>,
}

impl Flight {
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

    /// Returns a repetition of the received frame that begins at `due` and takes `took` ns.
    pub(super) fn again(self, id: u64, due: u64, took: u64, bits: u32) -> Self {
        let later = VecDeque::from([(took, Later::End { bits, whole: true })]);
        let (origin, burst, marks) = (Origin::Repeated, vec![], VecDeque::new());
        Self { id, origin, due: Some(due), later, burst, marks, ..self }
    }

    pub(super) fn next(&self, began: u64) -> Option<u64> {
        self.later.front().map(|(after, _)| began.saturating_add(*after))
    }

    pub(super) fn mark(&mut self, after: u64, fault: Fault) {
        let place = self.marks.partition_point(|(other, _)| *other <= after);
        self.marks.insert(place, (after, fault));
    }

    pub(super) fn cut(&mut self, bytes: usize) {
        self.start.chunk.data.truncate(bytes);
        let end = self.start.until_byte(bytes);
        let bits = u32::try_from(8 * bytes).unwrap_or(u32::MAX);
        self.later.push_back((end, Later::End { bits, whole: false }));
    }

    /// Returns the received frame, which lasted from `began` to `ended_ns` and has `bits` data bits.
    pub(super) fn heard(&self, began: u64, ended_ns: u64, bits: u32, whole: bool) -> Heard {
        let mut bytes = self.start.chunk.data.clone();
        if !whole {
            bytes.truncate(bits as usize / 8);
        }
        Heard { started_ns: began, ended_ns, bytes, whole, origin: self.origin }
    }
}
