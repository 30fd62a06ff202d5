//! Frames: out of the FIFO onto the air, and from the air into the FIFO.
//!
//! A frame costs a handful of events, not one per byte. When a frame starts, everything then in the FIFO goes onto the
//! air as one chunk; bytes loaded later follow as further chunks, each just before the air needs it; which byte has
//! left the FIFO, or entered the other chip's, is arithmetic on the clock done when somebody looks ([`Chip::settle`]).
//!
//! | covered | DS13541 |
//! |---|---|
//! | NFC-F at 212 and 424 kbit/s, poller: preamble 48 to 96 bits (07), sync, | 4.4 Transmit commands; 4.5 register |
//! | LEN = ntx + 1, CRC-16 | 07, 22, 23 |
//! | NFC-A at 106 kbit/s, poller: frames with parity, incomplete last bytes, REQA, WUPA, | the same; register 05 |
//! | CRC_A |  |
//! | FIFO: sending while loading, water level on the way down (below 200) and up (300), underflow breaks the | FIFO |
//! | frame off |  |
//! | reception by a poller (answers, mask-receive timer) and by a target: fixed NFC-F (03 | Receiver, Passive target |
//! | = A0) or bit rate detection (03 = C0 with NFC-F or NFC-A) |  |
//! | I_rxs at the sync, FIFO emptied then, bytes as they come, I_rxe; CRC, parity and | Interrupt interface; |
//! | framing errors; re-arming by D1 | Passive target |
//! | automatic SENSF_RES, slot 0, to a SENSF_REQ for its system code (passive target memory 15, 16); | Passive target |
//! | load modulation by C4 of a target |  |
//! | start of transmission scattered around its mean | recorded, see `Config::transmit_scatter_ns` |
//! | FIFO cleared or read in mid-frame: the transmission | FIFO; silicon sends what is loaded in time |
//! | underflows at its next byte | instead, if anything is |
//!
//! | left out | why |
//! |---|---|
//! | NFC-B, NFC-V, topaz, NFCIP-1, stream modes, higher rates of | the link is NFC-F; asked for, they are |
//! | NFC-A | reported |
//! | NFC-A target with its anticollision, TSN slots other than 0 | the listener never answers |
//! | collisions of two answers | one listener |
//! | signal strength, noise, gain, squelch | the air is digital; errors come from its fault model |
//!
//! An NFC-F frame ends when LEN + 2 bytes are in, or when the signal ends before that. Which of the two counts when
//! they disagree is not documented; the first to happen does here.

use crate::chip::{Due, RX_EN, TARGET, irq, reg};
use crate::clock::{bits_in, bits_ns};
use crate::crc;
use crate::{AirEvent, BrokenFrame, Chip, Chunk, FrameStart, Kind, Technology};

/// FIFO level below which a transmission raises I_wl.
const LEVEL_TX: usize = 200;
/// FIFO level at which a reception raises I_wl.
const LEVEL_RX: usize = 300;
/// Carrier cycles per bit at 106 kbit/s.
const CYCLES_106: u64 = 128;
/// From the end of a SENSF_REQ to the answer's first slot: 512 × 64 carrier cycles (ISO 18092, 2.417 ms).
const ANSWER_DELAY_CYCLES: u64 = 512 * 64;

/// A frame on its way out.
#[derive(Clone, Debug)]
pub(crate) struct Outgoing {
    technology: Technology,
    bits_per_second: u32,
    bit_as: u64,
    header_bits: u32,
    /// Bits a byte takes on the air: 9 with parity.
    byte_bits: u32,
    trailer_bits: u32,
    /// Whole bytes from the FIFO.
    whole: usize,
    /// Bits of an incomplete last byte from the FIFO.
    last_bits: u32,
    /// Bytes the chip puts before the FIFO's.
    prefix: Vec<u8>,
    with_crc: bool,
    /// An answer: load modulation.
    answer: bool,
    /// An answer without a load modulator: nothing reaches the air.
    silent: bool,

    /// First bit on the air, ns.
    start: u64,
    pub(crate) started: bool,
    /// All that went onto the air so far, for the CRC.
    sent: Vec<u8>,
    /// FIFO bytes announced to the air.
    announced: usize,
    /// Of these, taken from the FIFO.
    consumed: usize,
    /// When the next announced byte leaves the FIFO, ns.
    next_byte: u64,
    /// The FIFO was disturbed: what was announced and is still in it is not sent, the frame underflows.
    cut: bool,
}

impl Outgoing {
    /// FIFO bytes, an incomplete one counted.
    fn total(&self) -> usize {
        self.whole + usize::from(self.last_bits != 0)
    }

    /// When FIFO byte `i` starts on the air.
    fn byte_start(&self, i: usize) -> u64 {
        let bits = u64::from(self.header_bits) + u64::from(self.byte_bits) * (self.prefix.len() + i) as u64;
        self.start.saturating_add(bits_ns(bits, self.bit_as))
    }

    /// Announced FIFO bytes whose turn has come.
    fn due_bytes(&self, now: u64) -> usize {
        if !self.started || now < self.next_byte {
            return self.consumed;
        }
        let bits = bits_in(now.saturating_sub(self.start), self.bit_as);
        let into = bits.saturating_sub(u64::from(self.header_bits)) / u64::from(self.byte_bits);
        let begun = (into + 1).saturating_sub(self.prefix.len() as u64);
        usize::try_from(begun).unwrap_or(usize::MAX).clamp(self.consumed, self.announced)
    }

    /// Data bits and air bits of the whole frame.
    fn lengths(&self) -> (u32, u64) {
        let bytes = self.prefix.len() + self.whole + if self.with_crc { 2 } else { 0 };
        let data = u64::from(self.byte_bits.min(8)) * bytes as u64 + u64::from(self.last_bits);
        let air = u64::from(self.header_bits)
            + u64::from(self.byte_bits) * bytes as u64
            + u64::from(self.last_bits)
            + u64::from(self.trailer_bits);
        (u32::try_from(data).unwrap_or(u32::MAX), air)
    }
}

/// A frame on its way in, from the moment it is heard.
#[derive(Clone, Debug)]
pub(crate) struct Incoming {
    frame: FrameStart,
    start: u64,
    /// The receiver took it: I_rxs was raised.
    pub(crate) locked: bool,
    /// Bytes in the FIFO.
    deposited: usize,
    /// When the next byte reaches the FIFO, ns.
    next_byte: u64,
    /// The signal's end and the data bits until then.
    ended: Option<(u64, u32)>,
    latency: u64,
}

impl Incoming {
    fn instant(&self, bytes: usize) -> u64 {
        let bits = u64::from(self.frame.header_bits) + u64::from(self.frame.byte_bits) * bytes as u64;
        self.start.saturating_add(bits_ns(bits, self.frame.bit_as))
    }

    /// Bytes the frame says it has: LEN and CRC of NFC-F.
    fn limit(&self) -> Option<usize> {
        match self.frame.technology {
            Technology::NfcF => self.frame.chunk.data.first().map(|&len| usize::from(len.max(1)) + 2),
            Technology::NfcA => None,
        }
    }

    /// Bytes that may reach the FIFO.
    fn available(&self) -> usize {
        let n = self.frame.chunk.data.len();
        self.limit().map_or(n, |l| n.min(l))
    }

    fn due_bytes(&self, now: u64) -> usize {
        if !self.locked || now < self.next_byte {
            return self.deposited;
        }
        let elapsed = now.saturating_sub(self.start).saturating_sub(self.latency);
        let bits = bits_in(elapsed, self.frame.bit_as).saturating_sub(u64::from(self.frame.header_bits));
        let bytes = bits / u64::from(self.frame.byte_bits.max(1));
        usize::try_from(bytes).unwrap_or(usize::MAX).clamp(self.deposited, self.available().max(self.deposited))
    }

    fn whole(&self) -> bool {
        match (self.limit(), self.ended) {
            (Some(limit), None) => self.frame.chunk.data.len() >= limit,
            (Some(limit), Some((_, bits))) => self.frame.chunk.data.len() >= limit && bits as usize >= 8 * limit,
            (None, ended) => ended.is_some(),
        }
    }
}

impl Chip {
    // --- lazy FIFO ---

    /// Brings the FIFO up to date: bytes that left for the air, bytes that arrived.
    pub(crate) fn settle(&mut self) {
        if let Some(tx) = &mut self.tx {
            let due = tx.due_bytes(self.now);
            if due != tx.consumed {
                self.fifo.drop_front(due - tx.consumed);
                tx.consumed = due;
                tx.next_byte = tx.byte_start(due);
            }
        }
        let mut lost = false;
        if let Some(rx) = &mut self.rx {
            let due = rx.due_bytes(self.now);
            while rx.deposited < due {
                lost |= !self.fifo.push(rx.frame.chunk.data[rx.deposited]);
                rx.deposited += 1;
                rx.next_byte = rx.instant(rx.deposited + 1).saturating_add(rx.latency);
            }
        }
        if lost {
            self.note(Kind::FifoOverflow);
        }
    }

    /// Bytes in the FIFO now.
    pub(crate) fn fifo_level(&self) -> usize {
        let leaving = self.tx.as_ref().map_or(0, |t| t.due_bytes(self.now) - t.consumed);
        let arriving = self.rx.as_ref().map_or(0, |r| r.due_bytes(self.now) - r.deposited);
        (self.fifo.len().saturating_sub(leaving) + arriving).min(crate::fifo::CAPACITY)
    }

    /// The controller took a byte.
    pub(crate) fn fifo_take(&mut self) {
        self.disturb_transmission();
        self.fifo.drop_front(1);
        // I_wl comes again when the level is reached again.
        if self.fifo.len() + 1 == LEVEL_RX {
            self.plan_receive_level();
        }
    }

    /// The controller loaded a byte.
    pub(crate) fn fifo_loaded(&mut self) {
        if self.fifo.len() == LEVEL_TX {
            self.plan_transmit_level();
        }
    }

    // --- sending ---

    /// C4 and C5.
    pub(crate) fn transmit(&mut self, with_crc: bool) {
        let length = u16::from_be_bytes([self.a[reg::TRANSMIT_LENGTH], self.a[reg::TRANSMIT_LENGTH + 1]]);
        let (whole, last_bits) = (usize::from(length >> 3), u32::from(length & 0x07));
        let mode = self.a[reg::MODE];
        let target = mode & TARGET != 0;
        let rate = self.a[reg::BIT_RATE] >> 4;
        let parity = self.a[reg::ISO14443A] & 0x80 == 0;
        let technology = match (target, (mode >> 3) & 0x0F) {
            (false, 1) => Technology::NfcA,
            (false, 3) | (true, 4) => Technology::NfcF,
            _ => return self.note(Kind::UnmodelledMode(mode)),
        };
        let (header_bits, byte_bits, trailer_bits, prefix) = match technology {
            Technology::NfcA => {
                if whole == 0 && last_bits == 0 {
                    return self.note(Kind::EmptyFrame);
                }
                if rate != 0 {
                    return self.note(Kind::UnmodelledBitRate(self.a[reg::BIT_RATE]));
                }
                // Start of communication; end of communication is a logic 0 and a bit without modulation.
                (1, 8 + u32::from(parity), 2, Vec::new())
            }
            Technology::NfcF => {
                if rate != 1 && rate != 2 {
                    return self.note(Kind::UnmodelledBitRate(self.a[reg::BIT_RATE]));
                }
                if whole > 254 {
                    self.note(Kind::FrameTooLong(length >> 3));
                }
                // f_p: 48, 64, 80 or 96 bits of preamble; then 16 of sync.
                let preamble = 48 + 16 * u32::from(self.a[reg::PREAMBLE] & 0x03);
                (preamble + 16, 8, 0, vec![((whole + 1) & 0xFF) as u8])
            }
        };
        let cycles = CYCLES_106 >> rate;
        self.start_transmission(Outgoing {
            technology,
            bits_per_second: rate_of(cycles),
            bit_as: self.clock.cycles_as(cycles),
            header_bits,
            byte_bits,
            trailer_bits,
            whole,
            last_bits: if technology == Technology::NfcA { last_bits } else { 0 },
            prefix,
            with_crc: with_crc && last_bits == 0,
            answer: target,
            silent: false,
            start: 0,
            started: false,
            sent: Vec::new(),
            announced: 0,
            consumed: 0,
            next_byte: 0,
            cut: false,
        });
    }

    /// C6 and C7: a short frame of seven bits.
    pub(crate) fn transmit_short(&mut self, byte: u8) {
        let mode = self.a[reg::MODE];
        if mode & TARGET != 0 || (mode >> 3) & 0x0F != 1 {
            return self.note(Kind::UnmodelledMode(mode));
        }
        self.start_transmission(Outgoing {
            technology: Technology::NfcA,
            bits_per_second: rate_of(CYCLES_106),
            bit_as: self.clock.cycles_as(CYCLES_106),
            header_bits: 1,
            byte_bits: 7,
            trailer_bits: 2,
            whole: 0,
            last_bits: 0,
            prefix: vec![byte],
            with_crc: false,
            answer: false,
            silent: false,
            start: 0,
            started: false,
            sent: Vec::new(),
            announced: 0,
            consumed: 0,
            next_byte: 0,
            cut: false,
        });
    }

    fn start_transmission(&mut self, mut frame: Outgoing) {
        if self.tx.is_some() {
            return self.note(Kind::TransmitWhileBusy);
        }
        if frame.answer {
            if !self.outside {
                return self.note(Kind::TransmitWithoutField);
            }
            frame.silent = !self.load_modulator();
            self.note(Kind::LoadModulation);
        } else if !self.field {
            return self.note(Kind::TransmitWithoutField);
        }
        // Half duplex: what was being received is gone, what comes during the transmission is not heard.
        self.abort_reception();
        self.cancel(Due::NoResponse);
        self.fifo.clear_flags();
        let (mean, half) = (self.config.transmit_latency_ns, self.config.transmit_scatter_ns / 2);
        let half = half.min(mean);
        frame.start = self.now.saturating_add(mean - half).saturating_add(self.rng.up_to(2 * half));
        let start = frame.start;
        self.tx = Some(frame);
        self.plan(Due::TxStart, start);
    }

    pub(crate) fn transmission_starts(&mut self) {
        let Some(tx) = &mut self.tx else { return };
        tx.started = true;
        tx.next_byte = tx.byte_start(0);
        let mut data = tx.prefix.clone();
        let n = tx.total().min(self.fifo.len());
        data.extend((0..n).filter_map(|i| self.fifo.peek(i)));
        tx.announced = n;
        let chunk = self.chunk_sent(data);
        let Some(tx) = &self.tx else { return };
        let start = FrameStart {
            technology: tx.technology,
            bits_per_second: tx.bits_per_second,
            bit_as: tx.bit_as,
            header_bits: tx.header_bits,
            byte_bits: tx.byte_bits,
            load_modulation: tx.answer,
            chunk,
        };
        if !tx.silent {
            self.emit(AirEvent::FrameStart(start));
        }
        self.plan_transmit_level();
        self.plan_transmission();
    }

    /// Records what goes onto the air; adds the CRC behind the last FIFO byte.
    fn chunk_sent(&mut self, mut data: Vec<u8>) -> Chunk {
        if let Some(tx) = &mut self.tx {
            tx.sent.extend_from_slice(&data);
            if tx.announced == tx.total() && tx.with_crc {
                let crc = match tx.technology {
                    Technology::NfcF => crc::nfc_f(&tx.sent),
                    Technology::NfcA => crc::nfc_a(&tx.sent),
                };
                data.extend_from_slice(&crc);
            }
        }
        Chunk { data, parity_error: false }
    }

    fn plan_transmission(&mut self) {
        let Some(tx) = &self.tx else { return };
        if tx.announced == tx.total() {
            let end = tx.start.saturating_add(bits_ns(tx.lengths().1, tx.bit_as));
            self.plan(Due::TxEnd, end);
        } else {
            let at = tx.byte_start(tx.announced);
            self.plan(Due::TxMore, at);
        }
    }

    /// The air needs a byte that was not in the FIFO when the last chunk went.
    pub(crate) fn transmission_goes_on(&mut self) {
        self.settle();
        let Some(tx) = &mut self.tx else { return };
        let n = (tx.total() - tx.announced).min(self.fifo.len());
        if n == 0 || tx.cut {
            self.fifo.underflow = true;
            self.note(Kind::TransmitUnderflow);
            self.break_off_transmission();
            self.transmission_over();
            return;
        }
        let data: Vec<u8> = (0..n).filter_map(|i| self.fifo.peek(i)).collect();
        tx.announced += n;
        tx.next_byte = tx.byte_start(tx.consumed);
        let silent = tx.silent;
        let chunk = self.chunk_sent(data);
        if !silent {
            self.emit(AirEvent::Bytes(chunk));
        }
        self.settle();
        self.plan_transmit_level();
        self.plan_transmission();
    }

    /// The FIFO is about to be cleared or read by the controller. A transmission that still has to take bytes out of it
    /// does not get them: from its next byte on the FIFO is empty.
    pub(crate) fn disturb_transmission(&mut self) {
        let Some(tx) = &mut self.tx else { return };
        if tx.consumed == tx.total() {
            return;
        }
        if tx.started && tx.announced > tx.consumed {
            tx.announced = tx.consumed;
            tx.cut = true;
            let at = tx.byte_start(tx.consumed);
            self.cancel(Due::TxEnd);
            self.plan(Due::TxMore, at);
        }
        self.note(Kind::FifoDisturbed);
    }

    pub(crate) fn transmission_ends(&mut self) {
        self.settle();
        let Some(tx) = self.tx.take() else { return };
        if !tx.silent {
            self.emit(AirEvent::FrameEnd { bits: tx.lengths().0 });
        }
        self.statistics.sent += 1;
        self.transmission_over();
    }

    fn transmission_over(&mut self) {
        self.cancel(Due::TxLevel);
        if self.a[reg::OPERATION] & RX_EN != 0 {
            self.raise(irq::TXE);
            self.start_mask_receive();
            self.start_no_response();
        } else if self.config.txe_with_rx_off {
            self.raise(irq::TXE);
        }
    }

    /// The signal stops where it is.
    fn break_off_transmission(&mut self) {
        self.settle();
        for d in [Due::TxStart, Due::TxMore, Due::TxLevel, Due::TxEnd] {
            self.cancel(d);
        }
        let Some(tx) = self.tx.take() else { return };
        if tx.started && !tx.silent {
            let air = bits_in(self.now.saturating_sub(tx.start), tx.bit_as).saturating_sub(u64::from(tx.header_bits));
            let per = u64::from(tx.byte_bits);
            let data = (air / per) * 8 + (air % per).min(8);
            self.emit(AirEvent::FrameEnd { bits: u32::try_from(data).unwrap_or(u32::MAX).min(tx.lengths().0) });
        }
    }

    /// Stop, field off, supply off: a frame on the air breaks off, without an interrupt.
    pub(crate) fn abort_transmission(&mut self) {
        if self.tx.is_some() {
            self.break_off_transmission();
        }
    }

    /// I_wl on the way down: when the byte leaves that leaves fewer than 200.
    fn plan_transmit_level(&mut self) {
        self.settle();
        let level = self.fifo.len();
        if let Some(tx) = &self.tx
            && tx.started
            && level >= LEVEL_TX
        {
            let last = tx.consumed + level - LEVEL_TX;
            if last < tx.total() {
                let at = tx.byte_start(last);
                self.plan(Due::TxLevel, at);
            }
        }
    }

    pub(crate) fn transmit_level(&mut self) {
        self.settle();
        if self.fifo.len() < LEVEL_TX {
            self.raise(irq::WL);
        } else {
            self.plan_transmit_level();
        }
    }

    // --- receiving ---

    /// Something on the air takes effect now; `at` is when it happened.
    pub(crate) fn heard(&mut self, at: u64, event: AirEvent) {
        match event {
            AirEvent::FieldOn => {
                self.outside = true;
                self.look_for_field();
            }
            AirEvent::FieldOff => {
                self.outside = false;
                self.look_for_field();
                self.signal_lost(at);
            }
            AirEvent::FrameStart(frame) => {
                // One frame after another: an unfinished one has been drowned.
                self.signal_lost(at);
                if self.rx.as_ref().is_some_and(|r| r.locked) {
                    self.statistics.missed += 1;
                    return;
                }
                let latency = match frame.technology {
                    Technology::NfcA => self.config.nfc_a_latency_ns,
                    Technology::NfcF => self.config.nfc_f_latency_ns,
                };
                let to_start = match frame.technology {
                    Technology::NfcA => self.config.nfc_a_start_latency_ns,
                    Technology::NfcF => self.config.nfc_f_latency_ns,
                };
                let rx = Incoming { frame, start: at, locked: false, deposited: 0, next_byte: 0, ended: None, latency };
                let sync = rx.instant(0).saturating_add(to_start);
                self.rx = Some(rx);
                self.plan(Due::RxStart, sync.max(self.now));
            }
            AirEvent::Bytes(chunk) => {
                if let Some(rx) = &mut self.rx
                    && rx.ended.is_none()
                {
                    rx.frame.chunk.data.extend_from_slice(&chunk.data);
                    rx.frame.chunk.parity_error |= chunk.parity_error;
                    rx.next_byte = 0;
                    self.plan_reception_end();
                }
            }
            AirEvent::FrameEnd { bits } => {
                if let Some(rx) = &mut self.rx
                    && rx.ended.is_none()
                {
                    rx.ended = Some((at, bits));
                    rx.frame.chunk.data.truncate(bits.div_ceil(8) as usize);
                    self.plan_reception_end();
                }
            }
        }
    }

    /// The signal of the frame being heard stops at `at`.
    fn signal_lost(&mut self, at: u64) {
        let Some(rx) = &mut self.rx else { return };
        if rx.ended.is_some() {
            return;
        }
        let air = bits_in(at.saturating_sub(rx.start), rx.frame.bit_as);
        if !rx.locked && air < u64::from(rx.frame.header_bits) {
            self.rx = None;
            self.cancel(Due::RxStart);
            self.statistics.missed += 1;
            return;
        }
        let bytes = air.saturating_sub(u64::from(rx.frame.header_bits)) / u64::from(rx.frame.byte_bits.max(1));
        let bytes = usize::try_from(bytes).unwrap_or(usize::MAX).min(rx.frame.chunk.data.len());
        rx.frame.chunk.data.truncate(bytes.max(rx.deposited));
        rx.ended = Some((at, 8 * bytes as u32));
        self.plan_reception_end();
    }

    /// Whether the receiver, as it is set, takes this frame.
    fn takes(&self, rx: &Incoming) -> bool {
        let operation = self.a[reg::OPERATION];
        if !self.powered || !self.osc_ok || operation & RX_EN == 0 || self.tx.is_some() {
            return false;
        }
        // The decoder must have been running when the sync, or the start of communication, began.
        let sync_bits = match rx.frame.technology {
            Technology::NfcF => rx.frame.header_bits.saturating_sub(16),
            Technology::NfcA => 0,
        };
        let sync = rx.start.saturating_add(bits_ns(u64::from(sync_bits), rx.frame.bit_as));
        if self.unmasked_since.is_none_or(|since| since > sync) {
            return false;
        }
        let mode = self.a[reg::MODE];
        let om = (mode >> 3) & 0x0F;
        let rate = self.a[reg::BIT_RATE] & 0x03;
        let right_rate = rate_of(CYCLES_106 >> rate) == rx.frame.bits_per_second;
        if mode & TARGET != 0 {
            if rx.frame.load_modulation || !self.detected {
                return false;
            }
            match rx.frame.technology {
                Technology::NfcF if om == 0x04 => right_rate,
                // Bit rate detection: om3, with om2 for NFC-F and om0 for NFC-A.
                Technology::NfcF => om & 0x08 != 0 && om & 0x04 != 0,
                Technology::NfcA => om & 0x08 != 0 && om & 0x01 != 0,
            }
        } else {
            let right_mode = match rx.frame.technology {
                Technology::NfcA => om == 0x01,
                Technology::NfcF => om == 0x03,
            };
            rx.frame.load_modulation && self.field && !self.masking_receive() && right_mode && right_rate
        }
    }

    /// A frame that the receiver should take arrives in a mode or at a rate that is not modelled: that says so.
    fn reception_is_modelled(&mut self, rx: &Incoming) {
        let listening = self.powered && self.osc_ok && self.a[reg::OPERATION] & RX_EN != 0 && self.tx.is_none();
        let mode = self.a[reg::MODE];
        let target = mode & TARGET != 0;
        if !listening || self.unmasked_since.is_none() || target == rx.frame.load_modulation {
            return;
        }
        let rate = self.a[reg::BIT_RATE] & 0x03;
        let rate_modelled = match (target, (mode >> 3) & 0x0F) {
            (false, 0x01) => rate == 0,
            (false, 0x03) | (true, 0x04) => matches!(rate, 1 | 2),
            // Bit rate detection, of NFC-A (om0) and NFC-F (om2): the rate is found.
            (true, 0x09 | 0x0C | 0x0D) => true,
            _ => return self.note(Kind::UnmodelledMode(mode)),
        };
        if !rate_modelled {
            self.note(Kind::UnmodelledBitRate(self.a[reg::BIT_RATE]));
        }
    }

    pub(crate) fn reception_starts(&mut self) {
        let Some(rx) = self.rx.take() else { return };
        self.reception_is_modelled(&rx);
        let takes = self.takes(&rx);
        let passes = !takes || self.receive_chain_suits(rx.frame.technology) || self.config.unsuited_chain_receives;
        if !takes || !passes {
            self.statistics.missed += 1;
            return;
        }
        self.settle();
        if self.fifo.len() != 0 {
            self.statistics.overwritten += 1;
            self.note(Kind::FrameOverwritten);
        }
        self.fifo.clear();
        self.raise(irq::RXS);
        self.cancel(Due::NoResponse);
        self.general_purpose_trigger(2);
        if self.a[reg::MODE] & TARGET != 0 && (self.a[reg::MODE] >> 3) & 0x08 != 0 {
            let rate = match rx.frame.bits_per_second {
                212_000 => 1,
                424_000 => 2,
                _ => 0,
            };
            self.a[reg::RATE_DETECTED] = rate << 4;
            self.raise(irq::NFCT);
        }
        self.rx = Some(Incoming { locked: true, ..rx });
        self.plan_receive_level();
        self.plan_reception_end();
    }

    fn plan_reception_end(&mut self) {
        let Some(rx) = &self.rx else { return };
        if !rx.locked {
            return;
        }
        let end = match (rx.whole(), rx.limit(), rx.ended) {
            (true, Some(limit), _) => rx.instant(limit),
            (_, _, Some((at, _))) => at,
            _ => {
                self.plan_receive_level();
                return self.cancel(Due::RxEnd);
            }
        };
        let at = end.saturating_add(rx.latency).max(self.now);
        self.plan(Due::RxEnd, at);
        self.plan_receive_level();
    }

    /// I_wl on the way up: when the byte arrives that makes 300.
    pub(crate) fn plan_receive_level(&mut self) {
        self.settle();
        let level = self.fifo.len();
        if level >= LEVEL_RX {
            return;
        }
        self.cancel(Due::RxLevel);
        let Some(rx) = &self.rx else { return };
        if rx.locked && rx.deposited + (LEVEL_RX - level) <= rx.available() {
            let at = rx.instant(rx.deposited + LEVEL_RX - level).saturating_add(rx.latency);
            self.plan(Due::RxLevel, at.max(self.now));
        }
    }

    pub(crate) fn receive_level(&mut self) {
        self.settle();
        if self.fifo.len() >= LEVEL_RX {
            self.raise(irq::WL);
        } else {
            self.plan_receive_level();
        }
    }

    pub(crate) fn reception_ends(&mut self) {
        self.settle();
        self.cancel(Due::RxLevel);
        let Some(mut rx) = self.rx.take() else { return };
        // The last byte may be a rounding of a nanosecond away.
        let available = rx.available();
        while rx.deposited < available {
            if !self.fifo.push(rx.frame.chunk.data[rx.deposited]) {
                self.note(Kind::FifoOverflow);
            }
            rx.deposited += 1;
        }
        let target = self.a[reg::MODE] & TARGET != 0;
        let broken = !rx.whole();
        if broken {
            self.statistics.broken += 1;
            if self.config.broken_frame == BrokenFrame::NeverEnds {
                self.unmasked_since = None;
                return;
            }
        }
        let data = &rx.frame.chunk.data[..available];
        let last_bits = match rx.ended {
            Some((_, bits)) if rx.frame.technology == Technology::NfcA => (bits % 8) as u8,
            _ => 0,
        };
        let crc_wrong = match data.len().checked_sub(2) {
            Some(n) if last_bits == 0 && !broken => {
                let (body, crc) = data.split_at(n);
                let right = match rx.frame.technology {
                    Technology::NfcF => crc::nfc_f(body),
                    Technology::NfcA => crc::nfc_a(body),
                };
                right.as_slice() != crc
            }
            _ => true,
        };
        self.fifo.last_bits = last_bits;
        let mut raised = irq::RXE;
        if crc_wrong && self.a[reg::AUX] & 0x80 == 0 {
            raised |= irq::CRC;
            self.statistics.crc_errors += 1;
        }
        if broken {
            raised |= irq::ERR1;
        }
        if rx.frame.chunk.parity_error && self.a[reg::ISO14443A] & 0x40 == 0 {
            raised |= irq::PAR;
        }
        // SENSF_REQ: LEN 6, command 0, system code, request code, slots. The system code must be the one in the passive
        // target memory, or FF in the bytes that do not matter (JIS X 6319-4); another is received like any frame.
        let own = &self.pt_memory[15..17];
        let asks_for_own = matches!(*data, [6, 0, code1, code2, ..]
            if [code1, code2].iter().zip(own).all(|(asked, own)| *asked == 0xFF || asked == own));
        let request = target && rx.frame.technology == Technology::NfcF && !crc_wrong && asks_for_own;
        // d_212_424_1r (08, bit 2) keeps the target from answering it.
        if request && self.a[reg::PASSIVE_TARGET] & 0x04 == 0 {
            raised = (raised & !irq::RXE) | irq::RXE_PTA | irq::WU_F;
            let delay = self.clock.cycles(ANSWER_DELAY_CYCLES);
            self.plan_in(Due::Answer, delay);
        }
        self.raise(raised);
        self.statistics.received += 1;
        self.general_purpose_trigger(1);
        if target {
            self.mask_idle();
        }
    }

    /// The receiver lets go of what it was receiving: no interrupt.
    pub(crate) fn abort_reception(&mut self) {
        if self.rx.as_ref().is_some_and(|r| r.locked) {
            self.settle();
            self.rx = None;
            self.cancel(Due::RxLevel);
            self.cancel(Due::RxEnd);
        }
    }

    /// SENSF_RES from the passive target memory, in slot 0.
    pub(crate) fn automatic_answer(&mut self) {
        let rate = match self.a[reg::RATE_DETECTED] >> 4 & 0x03 {
            0 => self.a[reg::BIT_RATE] & 0x03,
            detected => detected,
        };
        let cycles = CYCLES_106 >> rate;
        // NFC-F part of the memory: two bytes of system code, then the 19 bytes of the answer, its request data
        // included.
        let body = &self.pt_memory[17..36];
        let mut prefix = vec![1 + body.len() as u8];
        prefix.extend_from_slice(body);
        prefix.extend_from_slice(&crc::nfc_f(&prefix));
        self.start_transmission(Outgoing {
            technology: Technology::NfcF,
            bits_per_second: rate_of(cycles),
            bit_as: self.clock.cycles_as(cycles),
            header_bits: 64,
            byte_bits: 8,
            trailer_bits: 0,
            whole: 0,
            last_bits: 0,
            prefix,
            with_crc: false,
            answer: true,
            silent: false,
            start: 0,
            started: false,
            sent: Vec::new(),
            announced: 0,
            consumed: 0,
            next_byte: 0,
            cut: false,
        });
    }
}

/// The nominal rate of a bit of so many carrier cycles, bit/s.
fn rate_of(cycles: u64) -> u32 {
    match cycles {
        64 => 212_000,
        32 => 424_000,
        16 => 848_000,
        _ => 106_000,
    }
}
