//! Traffic of a receiver's bus in the event log's form: groups of bytes that follow one another without a gap.

/// The ends of bytes are rounded to whole ns. So in a group of equally long bytes, the end of a byte may deviate by
/// this much, ns.
const ROUNDING: u64 = 40;

/// Bytes of a receiver that HORUS's microcontroller read over a bus without a gap between them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadBytes {
    /// The receiver's index, from 0.
    pub receiver: usize,
    /// The instant at which the first byte began, ns.
    pub at: u64,
    /// The duration of each byte, ns.
    pub byte_ns: u64,
    /// The bytes as the microcontroller read them. A fault of the bus may have changed them.
    pub bytes: Vec<u8>,
    /// Whether the microcontroller read all bytes as the receiver sent them, in a transaction that ended correctly.
    pub clean: bool,
    /// The instant at which the receiver's buffer received the bytes, ns.
    pub since: u64,
}

#[derive(Clone, Debug, Default)]
pub(super) struct Crossings {
    /// The bytes of the unfinished transaction, each with its beginning and end (ns), its value, and the instant (ns)
    /// at which it came into the receiver's buffer.
    open: Vec<(u64, u64, u8, u64)>,
    /// Whether the bus changed a byte of the unfinished transaction, so that HORUS need not use the bytes.
    spoilt: bool,
    done: Vec<Vec<(u64, u64, u8, u64)>>,
    clean: Vec<bool>,
}

impl Crossings {
    pub(super) fn byte(&mut self, from: u64, to: u64, byte: u8, since: u64) {
        self.open.push((from, to, byte, since));
    }

    pub(super) fn spoil(&mut self) {
        self.spoilt = true;
    }

    pub(super) fn spoil_open(&mut self) {
        self.spoilt |= !self.open.is_empty();
    }

    pub(super) fn end(&mut self) {
        let clean = !std::mem::take(&mut self.spoilt);
        if !self.open.is_empty() {
            self.done.push(std::mem::take(&mut self.open));
            self.clean.push(clean);
        }
    }

    pub(super) fn since(&self) -> u64 {
        self.open.first().map_or(u64::MAX, |(from, ..)| *from)
    }

    pub(super) fn take(&mut self, receiver: usize) -> Vec<ReadBytes> {
        let mut given: Vec<ReadBytes> = vec![];
        for (bytes, clean) in self.done.drain(..).zip(self.clean.drain(..)) {
            let first = given.len();
            for (from, to, byte, since) in bytes {
                match given[first..].last_mut() {
                    Some(run) if run.since == since && run.continues(from, to) => run.bytes.push(byte),
                    _ => given.push(ReadBytes {
                        receiver,
                        at: from,
                        byte_ns: to - from,
                        bytes: vec![byte],
                        clean,
                        since,
                    }),
                }
            }
        }
        given
    }
}

impl ReadBytes {
    fn continues(&self, from: u64, to: u64) -> bool {
        let nth = |number: usize| self.at + number as u64 * self.byte_ns;
        from.abs_diff(nth(self.bytes.len())) <= ROUNDING && to.abs_diff(nth(self.bytes.len() + 1)) <= ROUNDING
    }
}
