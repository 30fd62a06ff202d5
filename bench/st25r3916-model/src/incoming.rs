//! A frame that is being received: its bytes and their instants.
//!
//! The reception of an NFC-F frame ends after LEN + 2 bytes or at the end of the signal, whichever comes first. No
//! document says how silicon determines it.

use crate::clock::{bits_in, bits_ns};
use crate::event::{Chunk, FrameStart, Technology};

#[derive(Clone, Debug)]
pub(crate) struct Incoming {
    pub(crate) frame: FrameStart,
    start: u64,
    /// Whether the receiver has accepted the frame and raised I_rxs.
    pub(crate) locked: bool,
    deposited: usize,
    next_byte: u64,
    /// The instant at which the signal ended, ns, and the number of data bits up to then; `None` before the end.
    ended: Option<(u64, u32)>,
    latency: u64,
}

impl Incoming {
    /// Returns a frame whose first bit was at `start`, ns. Each of its bytes reaches the FIFO `latency` ns after the
    /// byte's end.
    pub(crate) fn new(frame: FrameStart, start: u64, latency: u64) -> Self {
        Self { frame, start, locked: false, deposited: 0, next_byte: 0, ended: None, latency }
    }

    fn instant(&self, bytes: usize) -> u64 {
        let bits = u64::from(self.frame.header_bits) + u64::from(self.frame.byte_bits) * bytes as u64;
        self.start.saturating_add(bits_ns(bits, self.frame.bit_as))
    }

    pub(crate) fn header_end(&self) -> u64 {
        self.instant(0)
    }

    /// Returns the instant, ns, from which the decoder must run to detect the frame.
    pub(crate) fn sync_start(&self) -> u64 {
        let bits = match self.frame.technology {
            Technology::NfcF => self.frame.header_bits.saturating_sub(16),
            Technology::NfcA => 0,
        };
        self.start.saturating_add(bits_ns(u64::from(bits), self.frame.bit_as))
    }

    pub(crate) fn has_ended(&self) -> bool {
        self.ended.is_some()
    }

    pub(crate) fn more(&mut self, chunk: &Chunk) {
        self.frame.chunk.data.extend_from_slice(&chunk.data);
        self.frame.chunk.parity_error |= chunk.parity_error;
        self.next_byte = 0;
    }

    /// Records that the signal ended at `at` after `bits` data bits. Zero bits complete the last byte.
    pub(crate) fn ends(&mut self, at: u64, bits: u32) {
        self.ended = Some((at, bits));
        let data = &mut self.frame.chunk.data;
        data.truncate(bits.div_ceil(8) as usize);
        if !bits.is_multiple_of(8)
            && let Some(last) = data.get_mut(bits as usize / 8)
        {
            *last &= match self.frame.technology {
                Technology::NfcF => !(0xFF >> (bits % 8)),
                Technology::NfcA => !(0xFF << (bits % 8)),
            };
        }
    }

    /// Records a loss of the signal at `at`. Returns false if the frame's header was incomplete, so that no frame is
    /// detected.
    pub(crate) fn stops(&mut self, at: u64) -> bool {
        let air = bits_in(at.saturating_sub(self.start), self.frame.bit_as);
        if !self.locked && air < u64::from(self.frame.header_bits) {
            return false;
        }
        let bytes = air.saturating_sub(u64::from(self.frame.header_bits)) / u64::from(self.frame.byte_bits.max(1));
        let bytes = usize::try_from(bytes).unwrap_or(usize::MAX).min(self.frame.chunk.data.len());
        self.frame.chunk.data.truncate(bytes.max(self.deposited));
        self.ended = Some((at, 8 * bytes as u32));
        true
    }

    /// Returns the number of bytes, CRC included, that LEN of an NFC-F frame announces; `None` for NFC-A.
    fn limit(&self) -> Option<usize> {
        match self.frame.technology {
            Technology::NfcF => self.frame.chunk.data.first().map(|&len| usize::from(len.max(1)) + 2),
            Technology::NfcA => None,
        }
    }

    /// Returns the number of bytes known so far that may reach the FIFO. In NFC-F it is at most the number that LEN
    /// announces.
    fn available(&self) -> usize {
        let n = self.frame.chunk.data.len();
        self.limit().map_or(n, |l| n.min(l))
    }

    pub(crate) fn data(&self) -> &[u8] {
        &self.frame.chunk.data[..self.available()]
    }

    /// Whether every announced byte was received. NFC-A announces no length: its frame is complete when the signal has
    /// ended.
    pub(crate) fn whole(&self) -> bool {
        match (self.limit(), self.ended) {
            (Some(limit), None) => self.frame.chunk.data.len() >= limit,
            (Some(limit), Some((_, bits))) => self.frame.chunk.data.len() >= limit && bits as usize >= 8 * limit,
            (None, ended) => ended.is_some(),
        }
    }

    /// Returns fifo_lb, the bits in an incomplete last byte, or 0. ST's driver (RFAL) reads it for every technology.
    pub(crate) fn last_bits(&self) -> u8 {
        match self.ended {
            // Bits behind the bytes that LEN announces do not count.
            Some((_, bits)) if (bits as usize).div_ceil(8) <= self.available() => (bits % 8) as u8,
            _ => 0,
        }
    }

    /// Returns the instant at which the receiver has completed the frame, ns; `None` while the end is not known.
    pub(crate) fn done_at(&self) -> Option<u64> {
        let end = match (self.whole(), self.limit(), self.ended) {
            (true, Some(limit), _) => self.instant(limit),
            (_, _, Some((at, _))) => at,
            _ => return None,
        };
        Some(end.saturating_add(self.latency))
    }

    /// Returns the instant at which this frame brings the FIFO from `level` to `full` bytes, ns; `None` if it does not.
    pub(crate) fn reaches(&self, full: usize, level: usize) -> Option<u64> {
        let byte = self.deposited + full.checked_sub(level)?;
        (self.locked && byte <= self.available()).then(|| self.instant(byte).saturating_add(self.latency))
    }

    /// Returns the number of bytes that have become due for the FIFO since the last call of [`Incoming::take_due`].
    pub(crate) fn due(&self, now: u64) -> usize {
        if !self.locked || now < self.next_byte {
            return 0;
        }
        let elapsed = now.saturating_sub(self.start).saturating_sub(self.latency);
        let bits = bits_in(elapsed, self.frame.bit_as).saturating_sub(u64::from(self.frame.header_bits));
        let bytes = bits / u64::from(self.frame.byte_bits.max(1));
        let most = self.available().max(self.deposited);
        usize::try_from(bytes).unwrap_or(usize::MAX).clamp(self.deposited, most) - self.deposited
    }

    pub(crate) fn take_due(&mut self, now: u64) -> &[u8] {
        let (from, due) = (self.deposited, self.due(now));
        if due != 0 {
            self.deposited += due;
            self.next_byte = self.instant(self.deposited + 1).saturating_add(self.latency);
        }
        &self.frame.chunk.data[from..from + due]
    }

    /// Returns the bytes that remain at the end of reception. The last byte may be among them, because instants are
    /// rounded to ns.
    pub(crate) fn take_rest(&mut self) -> &[u8] {
        let from = self.deposited;
        self.deposited = self.available().max(from);
        &self.frame.chunk.data[from..self.deposited]
    }
}
