//! Traffic of a receiver's bus in the event log's form: groups of bytes that follow one another without a gap.

/// The tolerance, ns, with which a byte continues a group of bytes of equal length. The ends of bytes are recorded in
/// whole nanoseconds, but the period of the bus's clock need not be a whole number of nanoseconds.
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

/// The bus traffic of one receiver that has not been reported yet.
#[derive(Clone, Debug, Default)]
pub(super) struct Crossings {
    /// The bytes of the transaction under way, each as the instants of its beginning and end (ns), its value, and the
    /// instant (ns) at which the receiver's buffer received it.
    open: Vec<(u64, u64, u8, u64)>,
    /// Whether a byte of the transaction under way differs from the byte that the receiver sent. HORUS need not
    /// interpret such a transaction.
    spoilt: bool,
    done: Vec<Vec<(u64, u64, u8, u64)>>,
    clean: Vec<bool>,
}

impl Crossings {
    /// Records a byte that was transferred from `from` to `to` (ns) and that the receiver's buffer received at `since`
    /// (ns).
    pub(super) fn byte(&mut self, from: u64, to: u64, byte: u8, since: u64) {
        self.open.push((from, to, byte, since));
    }

    /// Marks the transaction under way as one that HORUS need not interpret.
    pub(super) fn spoil(&mut self) {
        self.spoilt = true;
    }

    /// Marks the transaction under way as one that HORUS need not interpret, if any byte has been transferred in it.
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

    /// The instant of the oldest traffic that has not been reported yet, ns; `u64::MAX` for none.
    pub(super) fn since(&self) -> u64 {
        self.open.first().map_or(u64::MAX, |(from, ..)| *from)
    }

    /// Takes the traffic of the transactions that have ended, as bytes of receiver `receiver` (from 0).
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
    /// Whether a byte from `from` to `to` (ns) follows the group's last byte without a gap and takes as long as the
    /// group's bytes.
    fn continues(&self, from: u64, to: u64) -> bool {
        let nth = |number: usize| self.at + number as u64 * self.byte_ns;
        from.abs_diff(nth(self.bytes.len())) <= ROUNDING && to.abs_diff(nth(self.bytes.len() + 1)) <= ROUNDING
    }
}
