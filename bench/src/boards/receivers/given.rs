//! What crossed a bus, in the words of the event log: runs of bytes that follow one another without a gap.

/// A byte may end so much earlier or later than its run says, ns: the ends of bytes are whole nanoseconds of a clock
/// whose period is none.
const ROUNDING: u64 = 40;

/// Bytes of a receiver that the part was given, one after the other without a gap.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Given {
    /// Which receiver, from 0.
    pub receiver: usize,
    /// When the first byte began, ns.
    pub at: u64,
    /// What a byte takes, ns.
    pub byte_ns: u64,
    /// The bytes: what the receiver said, or what the bus made of it.
    pub bytes: Vec<u8>,
    /// The part was given all of them as the receiver said them, in a transaction that was ended as it should be.
    pub clean: bool,
    /// Since when they had waited in the receiver, ns.
    pub since: u64,
}

/// What crossed a bus and was not told yet.
#[derive(Clone, Debug, Default)]
pub(super) struct Crossings {
    /// Of the transaction under way: the beginning and the end of each byte (ns), the byte, and since when it has
    /// waited (ns).
    open: Vec<(u64, u64, u8, u64)>,
    /// Something of it is not as the receiver said it.
    spoilt: bool,
    done: Vec<Vec<(u64, u64, u8, u64)>>,
    clean: Vec<bool>,
}

impl Crossings {
    /// A byte has crossed from `from` to `to` (ns), that has waited since `since`, ns.
    pub(super) fn byte(&mut self, from: u64, to: u64, byte: u8, since: u64) {
        self.open.push((from, to, byte, since));
    }

    /// The transaction under way is none that the part must make sense of.
    pub(super) fn spoil(&mut self) {
        self.spoilt = true;
    }

    /// The same, if there is one of which something has crossed.
    pub(super) fn spoil_open(&mut self) {
        self.spoilt |= !self.open.is_empty();
    }

    /// The transaction is over.
    pub(super) fn end(&mut self) {
        let clean = !std::mem::take(&mut self.spoilt);
        if !self.open.is_empty() {
            self.done.push(std::mem::take(&mut self.open));
            self.clean.push(clean);
        }
    }

    /// Since when there is something that was not told, ns; `u64::MAX` for nothing.
    pub(super) fn since(&self) -> u64 {
        self.open.first().map_or(u64::MAX, |(from, ..)| *from)
    }

    /// What crossed in transactions that are over.
    pub(super) fn take(&mut self, receiver: usize) -> Vec<Given> {
        let mut given: Vec<Given> = vec![];
        for (bytes, clean) in self.done.drain(..).zip(self.clean.drain(..)) {
            let first = given.len();
            for (from, to, byte, since) in bytes {
                match given[first..].last_mut() {
                    Some(run) if run.since == since && run.continues(from, to) => run.bytes.push(byte),
                    _ => given.push(Given { receiver, at: from, byte_ns: to - from, bytes: vec![byte], clean, since }),
                }
            }
        }
        given
    }
}

impl Given {
    /// Whether a byte from `from` to `to` (ns) follows without a gap, and takes as long as the others.
    fn continues(&self, from: u64, to: u64) -> bool {
        let nth = |number: usize| self.at + number as u64 * self.byte_ns;
        from.abs_diff(nth(self.bytes.len())) <= ROUNDING && to.abs_diff(nth(self.bytes.len() + 1)) <= ROUNDING
    }
}
