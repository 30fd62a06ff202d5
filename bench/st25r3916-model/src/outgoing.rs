//! A frame that is being sent: its contents, and the instants of its bits.

use crate::clock::{CYCLES_106, bit_cycles, bits_in, bits_ns, rate_of};
use crate::core::Core;
use crate::crc;
use crate::event::{Chunk, FrameStart, Technology};
use crate::registers::reg;
use crate::report::Kind;

#[derive(Clone, Debug)]
pub(crate) struct Outgoing {
    /// The frame on the air. Its chunk has the bytes that the chip sends in front, and the bytes from the FIFO that the
    /// model of the air already has, without the CRC.
    frame: FrameStart,
    trailer_bits: u32,
    /// The number of bytes that the chip sends in front of those from the FIFO.
    prefix: usize,
    /// The number of whole bytes that the frame takes from the FIFO.
    whole: usize,
    /// The number of bits in an incomplete last byte from the FIFO, or 0.
    last_bits: u32,
    with_crc: bool,
    /// Whether the frame does not reach the air, for lack of a load modulator or because of unsuitable settings.
    pub(crate) silent: bool,

    start: u64,
    started: bool,
    /// The number of bytes from the FIFO that the model of the air already has. Some of them may still be in the FIFO.
    announced: usize,
    /// The number of bytes that the model of the air has and that have left the FIFO.
    consumed: usize,
    next_byte: u64,
    /// Whether the controller cleared or read the FIFO during the frame, which then breaks off by an underflow.
    cut: bool,
}

impl Outgoing {
    /// Returns a frame with `cycles` carrier cycles per bit, which begins with the bytes `prefix`.
    fn new(core: &Core, technology: Technology, cycles: u64, prefix: Vec<u8>) -> Self {
        let frame = FrameStart {
            technology,
            bits_per_second: rate_of(cycles),
            bit_as: core.clock().cycles_as(cycles),
            header_bits: 64,
            byte_bits: 8,
            load_modulation: false,
            chunk: Chunk::default(),
        };
        let mut frame = Self {
            frame,
            trailer_bits: 0,
            prefix: prefix.len(),
            whole: 0,
            last_bits: 0,
            with_crc: false,
            silent: false,
            start: 0,
            started: false,
            announced: 0,
            consumed: 0,
            next_byte: 0,
            cut: false,
        };
        frame.frame.chunk.data = prefix;
        frame
    }

    /// Returns the frame that the registers describe, for C4 and C5; `None` with a finding for a setting not modelled.
    pub(crate) fn described(core: &mut Core, with_crc: bool) -> Option<Self> {
        let length = core.registers().a16(reg::TRANSMIT_LENGTH);
        let (whole, last_bits) = (usize::from(length >> 3), u32::from(length & 0x07));
        let target = core.target();
        let rate = core.a(reg::BIT_RATE) >> 4;
        let technology = match (target, core.operation_mode()) {
            (false, 1) => Technology::NfcA,
            (false, 3) | (true, 4) => Technology::NfcF,
            _ => {
                core.note(Kind::UnmodelledMode(core.a(reg::MODE)));
                return None;
            }
        };
        let refused = match technology {
            Technology::NfcA if whole == 0 && last_bits == 0 => Some(Kind::EmptyFrame),
            Technology::NfcA if rate != 0 => Some(Kind::UnmodelledBitRate(core.a(reg::BIT_RATE))),
            Technology::NfcF if rate != 1 && rate != 2 => Some(Kind::UnmodelledBitRate(core.a(reg::BIT_RATE))),
            _ => None,
        };
        if let Some(kind) = refused {
            core.note(kind);
            return None;
        }
        let mut frame = match technology {
            Technology::NfcA => {
                let parity = core.a(reg::ISO14443A) & 0x80 == 0;
                Self { last_bits, ..Self::new(core, technology, bit_cycles(rate), vec![]) }.nfc_a(8 + u32::from(parity))
            }
            Technology::NfcF => {
                if whole > 254 {
                    core.note(Kind::FrameTooLong(length >> 3));
                }
                let len = ((whole + 1) & 0xFF) as u8;
                let mut frame = Self::new(core, technology, bit_cycles(rate), vec![len]);
                // f_p selects a preamble of 48, 64, 80 or 96 bits; a sync of 16 bits follows.
                frame.frame.header_bits = 48 + 16 * u32::from(core.a(reg::PREAMBLE) & 0x03) + 16;
                frame
            }
        };
        frame.whole = whole;
        frame.with_crc = with_crc && last_bits == 0;
        frame.frame.load_modulation = target;
        Some(frame)
    }

    /// Returns a short frame of seven bits, for C6 and C7; `None` with a finding in another mode than NFC-A's.
    pub(crate) fn short(core: &mut Core, byte: u8) -> Option<Self> {
        if core.target() || core.operation_mode() != 1 {
            core.note(Kind::UnmodelledMode(core.a(reg::MODE)));
            return None;
        }
        Some(Self::new(core, Technology::NfcA, CYCLES_106, vec![byte]).nfc_a(7))
    }

    /// Returns the automatic answer in slot 0, which is a SENSF_RES with the contents of the passive target memory.
    pub(crate) fn automatic_answer(core: &Core) -> Self {
        let rate = match core.a(reg::RATE_DETECTED) >> 4 & 0x03 {
            0 => core.a(reg::BIT_RATE) & 0x03,
            detected => detected,
        };
        // The NFC-F section of the passive target memory has two bytes of system code, then the 19 bytes of the answer.
        let body = &core.registers().target_memory()[17..36];
        let mut prefix = vec![1 + body.len() as u8];
        prefix.extend_from_slice(body);
        prefix.extend_from_slice(&crc::nfc_f(&prefix));
        let mut answer = Self::new(core, Technology::NfcF, bit_cycles(rate), prefix);
        answer.frame.load_modulation = true;
        answer
    }

    /// Adds NFC-A's start of communication (a logic 0) and end of communication.
    fn nfc_a(mut self, byte_bits: u32) -> Self {
        self.frame.header_bits = 1;
        self.frame.byte_bits = byte_bits;
        self.trailer_bits = 2;
        self
    }

    pub(crate) fn technology(&self) -> Technology {
        self.frame.technology
    }

    pub(crate) fn is_answer(&self) -> bool {
        self.frame.load_modulation
    }

    pub(crate) fn starts_at(&mut self, at: u64) {
        self.start = at;
    }

    pub(crate) fn started(&self) -> bool {
        self.started
    }

    fn total(&self) -> usize {
        self.whole + usize::from(self.last_bits != 0)
    }

    /// Returns the number of bytes from the FIFO that the air does not know yet.
    pub(crate) fn missing(&self) -> usize {
        self.total() - self.announced
    }

    pub(crate) fn is_cut(&self) -> bool {
        self.cut
    }

    pub(crate) fn all_taken(&self) -> bool {
        self.consumed == self.total()
    }

    /// Returns the instant at which byte `i` from the FIFO starts on the air, ns.
    fn byte_start(&self, i: usize) -> u64 {
        let bits = u64::from(self.frame.header_bits) + u64::from(self.frame.byte_bits) * (self.prefix + i) as u64;
        self.start.saturating_add(bits_ns(bits, self.frame.bit_as))
    }

    /// Returns the instant at which the next byte leaves the FIFO, ns.
    pub(crate) fn next_taken(&self) -> u64 {
        self.byte_start(self.consumed)
    }

    /// Returns the instant, ns, from which fewer than `below` of the `level` bytes that the FIFO holds now are left;
    /// `None` if there is no such instant.
    pub(crate) fn falls_below(&self, below: usize, level: usize) -> Option<u64> {
        let last = self.consumed + level.checked_sub(below)?;
        (self.started && last < self.total()).then(|| self.byte_start(last))
    }

    /// Returns the instant, ns, at which the air needs the next byte from the FIFO; `None` if it has all bytes.
    pub(crate) fn needs_more_at(&self) -> Option<u64> {
        (self.missing() != 0).then(|| self.byte_start(self.announced))
    }

    pub(crate) fn ends_at(&self) -> u64 {
        self.start.saturating_add(bits_ns(self.lengths().1, self.frame.bit_as))
    }

    pub(crate) fn data_bits(&self) -> u32 {
        self.lengths().0
    }

    pub(crate) fn bits_by(&self, now: u64) -> u32 {
        let bits = self.frame.data_bits_in(now.saturating_sub(self.start));
        u32::try_from(bits).unwrap_or(u32::MAX).min(self.data_bits())
    }

    /// Returns the number of data bits in the whole frame, and its number of bits on the air.
    fn lengths(&self) -> (u32, u64) {
        let FrameStart { header_bits, byte_bits, .. } = self.frame;
        let bytes = self.prefix + self.whole + if self.with_crc { 2 } else { 0 };
        let data = u64::from(byte_bits.min(8)) * bytes as u64 + u64::from(self.last_bits);
        let air = u64::from(header_bits)
            + u64::from(byte_bits) * bytes as u64
            + u64::from(self.last_bits)
            + u64::from(self.trailer_bits);
        (u32::try_from(data).unwrap_or(u32::MAX), air)
    }

    /// Returns the number of announced bytes that have left the FIFO since the last call of [`Outgoing::take_due`].
    pub(crate) fn due(&self, now: u64) -> usize {
        if !self.started || now < self.next_byte {
            return 0;
        }
        let bits = bits_in(now.saturating_sub(self.start), self.frame.bit_as);
        let into = bits.saturating_sub(u64::from(self.frame.header_bits)) / u64::from(self.frame.byte_bits);
        let begun = (into + 1).saturating_sub(self.prefix as u64);
        usize::try_from(begun).unwrap_or(usize::MAX).clamp(self.consumed, self.announced) - self.consumed
    }

    /// Returns the number of bytes that have left the FIFO for the air since the last call.
    pub(crate) fn take_due(&mut self, now: u64) -> usize {
        let due = self.due(now);
        if due != 0 {
            self.consumed += due;
            self.next_byte = self.byte_start(self.consumed);
        }
        due
    }

    pub(crate) fn start(&mut self, data: &[u8]) -> FrameStart {
        self.started = true;
        self.next_byte = self.byte_start(0);
        let mut frame = self.frame.clone();
        frame.chunk.data.extend(self.give(data).data);
        frame
    }

    /// Gives further bytes from the FIFO, `data`, to the air, and adds the CRC after the last one.
    pub(crate) fn more(&mut self, data: &[u8]) -> Chunk {
        let chunk = self.give(data);
        self.next_byte = self.byte_start(self.consumed);
        chunk
    }

    fn give(&mut self, data: &[u8]) -> Chunk {
        self.announced += data.len();
        let sent = &mut self.frame.chunk.data;
        sent.extend_from_slice(data);
        let mut chunk = Chunk { data: data.to_vec(), parity_error: false };
        if self.with_crc && self.missing() == 0 {
            let sent = &self.frame.chunk.data;
            chunk.data.extend(match self.frame.technology {
                Technology::NfcF => crc::nfc_f(sent),
                Technology::NfcA => crc::nfc_a(sent),
            });
        }
        chunk
    }

    /// Records that the controller cleared or read the FIFO. Returns whether the FIFO still had bytes that the air
    /// knew.
    pub(crate) fn disturb(&mut self) -> bool {
        let promised = self.started && self.announced > self.consumed;
        if promised {
            self.announced = self.consumed;
            self.cut = true;
        }
        promised
    }
}
