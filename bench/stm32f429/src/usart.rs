//! USART1 to USART3, USART6, UART4, UART5, UART7 and UART8 (RM0090 chapter 30).
//!
//! | Covered | Manual |
//! |---|---|
//! | Baud rate from `BRR` and `OVER8`, 8 and 9 bits, parity, 0.5 to 2 stop bits | 30.3.2 to 30.3.4, 30.3.7 |
//! | Transmitter: `TXE`, `TC` with both ways to clear it, the idle frame that `TE` sends | 30.3.2 |
//! | Receiver: three samples or `ONEBIT`; `RXNE`, `NF`, `FE`, `PE`, `ORE`, `IDLE`, the read sequences | 30.3.3 |
//! | Half duplex, DMA requests, interrupts | 30.3.10, 30.3.13, 30.4 |
//!
//! **Left out, each a finding when it is used:** LIN, smartcard, IrDA, the synchronous clock, the mute mode, RTS and
//! CTS, sending a break. A level that is driven onto RX without being a frame is not seen.
//!
//! # Reception
//!
//! A frame from outside is a waveform, which the receiver samples at instants of its own: from the start bit's falling
//! edge on at the 8th, 9th and 10th sixteenth of each of its bits (OVER8: 4th to 6th eighth). Another baud rate, parity
//! or length on the line thus gives the bytes and the flags that it gives on silicon. A byte is there at the last
//! sample of its stop bit. After that the receiver looks for the next falling edge. What it samples later than the last
//! frame it was told of is an idle line.
//!
//! `IDLE` rises a whole frame and a bit after the end of the last stop bit: the bit is ours, so that a frame that is
//! told of at its end is in time.

use std::collections::VecDeque;

use bench_seam::{Cycle, FindingKind, NEVER, UartFrame, UartParity};
use cortex_m4::Width;

use crate::cx::{Clocks, Cx, Peripheral, Signal, UartPin, Wires};

const PE: u32 = 1 << 0;
const FE: u32 = 1 << 1;
const NF: u32 = 1 << 2;
const ORE: u32 = 1 << 3;
const IDLE: u32 = 1 << 4;
const RXNE: u32 = 1 << 5;
const TC: u32 = 1 << 6;
const TXE: u32 = 1 << 7;

const SBK: u32 = 1 << 0;
const RWU: u32 = 1 << 1;
const RE: u32 = 1 << 2;
const TE: u32 = 1 << 3;
const IDLEIE: u32 = 1 << 4;
const RXNEIE: u32 = 1 << 5;
const TCIE: u32 = 1 << 6;
const TXEIE: u32 = 1 << 7;
const PEIE: u32 = 1 << 8;
const PS: u32 = 1 << 9;
const PCE: u32 = 1 << 10;
const M: u32 = 1 << 12;
const UE: u32 = 1 << 13;
const OVER8: u32 = 1 << 15;

const CLKEN: u32 = 1 << 11;
const LINEN: u32 = 1 << 14;

const EIE: u32 = 1 << 0;
const IREN: u32 = 1 << 1;
const HDSEL: u32 = 1 << 3;
const SCEN: u32 = 1 << 5;
const DMAR: u32 = 1 << 6;
const DMAT: u32 = 1 << 7;
const RTSE: u32 = 1 << 8;
const CTSE: u32 = 1 << 9;
const ONEBIT: u32 = 1 << 11;

/// Fractional bits of a length in cycles.
const FRACTION: u32 = 12;

/// A frame on the receiver's line.
#[derive(Clone, Copy, Debug)]
struct Wave {
    begins: Cycle,
    /// The end of its stop bits.
    ends: Cycle,
    /// Length of a bit in cycles, with [`FRACTION`] bits behind the point.
    bit: u64,
    /// The levels of its bits, start bit first at bit 0; all that follow are ones.
    levels: u32,
}

impl Wave {
    fn level(&self, at: Cycle) -> bool {
        let index = ((at - self.begins) << FRACTION) / self.bit;
        index > 31 || self.levels >> index & 1 != 0
    }

    /// The first falling edge at `from` or later.
    fn falling(&self, from: Cycle) -> Option<Cycle> {
        let mut edges = !self.levels & (self.levels << 1 | 1);
        // Mostly the first edge is wanted, or the frame is over.
        let at = |index: u32| self.begins + (u64::from(index) * self.bit).div_ceil(1 << FRACTION);
        if edges == 0 || at(31 - edges.leading_zeros()) < from {
            return None;
        }
        loop {
            let found = at(edges.trailing_zeros());
            if found >= from {
                return Some(found);
            }
            edges &= edges - 1;
        }
    }
}

/// What the transmitter shifts out.
#[derive(Clone, Copy, Debug)]
struct Sending {
    /// `None`: an idle frame.
    data: Option<u16>,
    ends: Cycle,
}

/// One USART or UART.
#[derive(Clone, Debug)]
pub(crate) struct Usart {
    number: u8,
    sr: u32,
    brr: u32,
    cr1: u32,
    cr2: u32,
    cr3: u32,
    gtpr: u32,
    tdr: u16,
    rdr: u16,
    /// The flags that the last read of SR showed: what the read or write of DR that follows clears.
    shown: u32,
    /// Core cycles of a PCLK cycle, and of a bit; 0 where BRR is no baud rate.
    pclk: u32,
    bit: u64,
    /// A bit in picoseconds, 0 while it is not known.
    bit_ps: u64,
    sending: Option<Sending>,
    /// What is on the line, oldest first.
    waves: VecDeque<Wave>,
    /// The bit length of the last wave in picoseconds and in cycles: the conversion is slow.
    known_bit: (u64, u64),
    /// The start bit's edge of the frame being received.
    receiving: Option<Cycle>,
    /// No start bit is recognised before this.
    look_from: Cycle,
    /// When the line will have been idle for a frame.
    idle_at: Cycle,
    due: Cycle,
}

impl Usart {
    /// USART`number` or UART`number`.
    pub(crate) fn new(number: u8) -> Self {
        Self {
            number,
            sr: TXE | TC,
            brr: 0,
            cr1: 0,
            cr2: 0,
            cr3: 0,
            gtpr: 0,
            tdr: 0,
            rdr: 0,
            shown: 0,
            pclk: 1,
            bit: 0,
            bit_ps: 0,
            sending: None,
            waves: VecDeque::new(),
            known_bit: (0, 0),
            receiving: None,
            look_from: 0,
            idle_at: NEVER,
            due: NEVER,
        }
    }

    fn is_on(&self, enable: u32) -> bool {
        self.cr1 & (UE | enable) == UE | enable && self.bit != 0
    }

    /// Bits between the start and the stop, parity included.
    fn data_bits(&self) -> u32 {
        if self.cr1 & M != 0 { 9 } else { 8 }
    }

    fn stop_halves(&self) -> u8 {
        match self.cr2 >> 12 & 3 {
            0 => 2,
            1 => 1,
            2 => 4,
            _ => 3,
        }
    }

    fn set_bit(&mut self) {
        let divider = if self.cr1 & OVER8 != 0 { (self.brr >> 4) * 8 + (self.brr & 7) } else { self.brr };
        // Below 1.0 in USARTDIV the generator gives nothing (30.3.4).
        let least = if self.cr1 & OVER8 != 0 { 8 } else { 16 };
        self.bit = if divider < least { 0 } else { u64::from(divider) * u64::from(self.pclk) };
        self.bit_ps = 0;
    }

    // Transmitter --------------------------------------------------------------------------------------------------

    /// Length of a frame that is sent, in cycles.
    fn frame_cycles(&self) -> u64 {
        (self.bit * (2 * (1 + u64::from(self.data_bits())) + u64::from(self.stop_halves()))) / 2
    }

    fn send_next(&mut self, from: Cycle) {
        if self.sending.is_some() || self.sr & TXE != 0 || !self.is_on(TE) {
            return;
        }
        self.sr |= TXE;
        self.sr &= !TC;
        let ends = from + self.frame_cycles();
        self.sending = Some(Sending { data: Some(self.tdr), ends });
        if self.cr3 & HDSEL != 0 && self.is_on(RE) {
            // The receiver hears what is sent.
            let levels = self.levels(self.tdr);
            self.waves.push_back(Wave { begins: from, ends, bit: self.bit << FRACTION, levels });
            self.find_start();
        }
    }

    /// The bits between start and stop with the parity that is set up.
    fn with_parity(&self, data: u16) -> u16 {
        let bits = self.data_bits();
        let mask = (1_u16 << bits) - 1;
        if self.cr1 & PCE == 0 {
            return data & mask;
        }
        let data = data & (mask >> 1);
        let odd = data.count_ones() & 1 != 0;
        data | u16::from(odd != (self.cr1 & PS != 0)) << (bits - 1)
    }

    fn levels(&self, data: u16) -> u32 {
        u32::MAX << (1 + self.data_bits()) | u32::from(self.with_parity(data)) << 1
    }

    fn finish_sending<W: Wires>(&mut self, sent: Sending, cx: &mut Cx, wires: &mut W) {
        let Some(data) = sent.data else { return };
        if self.bit_ps == 0 {
            self.bit_ps = cx.clocks.ps(self.bit);
        }
        let parity = match self.cr1 & (PCE | PS) {
            PCE => UartParity::Even,
            bits if bits & PCE != 0 => UartParity::Odd,
            _ => UartParity::None,
        };
        let bits = self.data_bits() as u8 - u8::from(parity != UartParity::None);
        let frame = UartFrame {
            data: data & ((1 << bits) - 1),
            bits,
            parity,
            stop_halves: self.stop_halves(),
            bit_ps: self.bit_ps,
        };
        for pin in cx.pins(Signal::Uart(self.number, UartPin::Tx)).into_iter().flatten() {
            wires.uart(sent.ends, pin, &frame);
        }
    }

    // Receiver -----------------------------------------------------------------------------------------------------

    /// A frame comes in on the RX pin; its start bit's edge is at `begins`.
    pub(crate) fn receive(&mut self, begins: Cycle, frame: &UartFrame, cx: &mut Cx) {
        if !self.is_on(RE) {
            return;
        }
        if self.known_bit.0 != frame.bit_ps {
            let cycles = cx.clocks.cycles_of_ps(frame.bit_ps.saturating_mul(1 << FRACTION));
            self.known_bit = (frame.bit_ps, cycles.max(1));
        }
        let bit = self.known_bit.1;
        let mut data = u32::from(frame.data) & ((1 << frame.bits) - 1);
        let mut bits = u32::from(frame.bits);
        if frame.parity != UartParity::None {
            let odd = data.count_ones() & 1 != 0;
            data |= u32::from(odd != (frame.parity == UartParity::Odd)) << bits;
            bits += 1;
        }
        let halves = 2 * (1 + u64::from(bits)) + u64::from(frame.stop_halves);
        let ends = begins + ((halves * bit) >> (FRACTION + 1));
        self.waves.push_back(Wave { begins, ends, bit, levels: u32::MAX << (1 + bits) | data << 1 });
        self.find_start();
        // A frame that is told of at its end has been sampled by now.
        while self.receiving.is_some_and(|edge| edge + self.sampled_after() <= cx.now) {
            self.finish_receiving();
        }
        self.plan();
    }

    /// Cycles from the start bit's edge to the last sample of the stop bit.
    fn sampled_after(&self) -> u64 {
        self.bit * u64::from(1 + self.data_bits()) + self.bit * 10 / 16
    }

    fn level(&self, at: Cycle) -> bool {
        // Frames on one line do not overlap; of two that do, a low level wins.
        self.waves.iter().all(|wave| at < wave.begins || at >= wave.ends || wave.level(at))
    }

    /// Looks for a falling edge where the receiver waits for one.
    fn find_start(&mut self) {
        if self.receiving.is_some() {
            return;
        }
        let from = self.look_from;
        while self.waves.front().is_some_and(|wave| wave.ends <= from) {
            self.waves.pop_front();
        }
        self.receiving = self.waves.iter().find_map(|wave| wave.falling(from));
        if self.receiving.is_some_and(|edge| edge < self.idle_at) {
            self.idle_at = NEVER;
        }
    }

    /// One bit by its three samples: the level, and whether they differ.
    fn sample(&self, begins: Cycle) -> (bool, bool) {
        let eighths = |n: u64| begins + self.bit * n / 16;
        let (a, b, c) = if self.cr1 & OVER8 != 0 { (8, 10, 12) } else { (15, 17, 19) };
        // The middle of the 8th, 9th and 10th sixteenth, or of the 4th, 5th and 6th eighth.
        let at = |n: u64| if self.cr1 & OVER8 != 0 { eighths(n - 1) } else { begins + self.bit * n / 32 };
        if self.cr3 & ONEBIT != 0 {
            return (self.level(at(b)), false);
        }
        let ones = u8::from(self.level(at(a))) + u8::from(self.level(at(b))) + u8::from(self.level(at(c)));
        (ones >= 2, ones == 1 || ones == 2)
    }

    /// The bits of the frame whose start bit began at `edge`: data with parity, the stop bit, noise. `None`: it was no
    /// start bit.
    fn sampled(&self, edge: Cycle) -> Option<(u16, bool, bool)> {
        let bits = self.data_bits();
        if let Some(wave) = self.waves.front()
            && wave.begins == edge
            && self.waves.get(1).is_none_or(|next| next.begins >= edge + self.sampled_after())
        {
            // Where the sender's bits drift by less than 5/16 of a bit until the stop bit, every sample is inside the
            // bit that it is meant for.
            let drift = wave.bit.abs_diff(self.bit << FRACTION) * u64::from(bits + 2);
            if drift * 16 < (self.bit * 5) << FRACTION {
                let word = wave.levels >> 1;
                return Some((word as u16 & ((1 << bits) - 1), word >> bits & 1 != 0, false));
            }
        }
        let (start, mut noise) = self.sample(edge);
        if start {
            return None;
        }
        let mut word = 0;
        for index in 0..bits {
            let (level, differ) = self.sample(edge + self.bit * u64::from(1 + index));
            word |= u16::from(level) << index;
            noise |= differ;
        }
        let (stop, differ) = self.sample(edge + self.bit * u64::from(1 + bits));
        Some((word, stop, noise | differ))
    }

    fn finish_receiving(&mut self) {
        let Some(edge) = self.receiving.take() else { return };
        while self.waves.front().is_some_and(|wave| wave.ends <= edge) {
            self.waves.pop_front();
        }
        let Some((word, stop, noise)) = self.sampled(edge) else {
            self.look_from = edge + self.bit * 10 / 16;
            self.find_start();
            return;
        };
        self.look_from = edge + self.sampled_after();
        self.idle_at = edge + self.bit * u64::from(2 * (2 + self.data_bits()) + 1);
        if self.sr & RXNE != 0 {
            self.sr |= ORE;
        } else {
            self.rdr = word;
            self.sr |= RXNE;
            if noise {
                self.sr |= NF;
            }
            if !stop {
                self.sr |= FE;
            }
            if self.cr1 & PCE != 0 && (word.count_ones() & 1 != 0) != (self.cr1 & PS != 0) {
                self.sr |= PE;
            }
        }
        self.find_start();
    }

    fn plan(&mut self) {
        let sends = self.sending.map_or(NEVER, |sending| sending.ends);
        let receives = self.receiving.map_or(NEVER, |edge| edge + self.sampled_after());
        self.due = sends.min(receives).min(self.idle_at);
    }

    // Registers ----------------------------------------------------------------------------------------------------

    fn write_cr1(&mut self, value: u32, cx: &mut Cx) {
        if value & RWU != 0 {
            cx.find(FindingKind::Unmodelled, "the mute mode (CR1.RWU)");
        }
        if value & SBK != 0 {
            cx.find(FindingKind::Unmodelled, "sending a break (CR1.SBK)");
        }
        let before = (self.is_on(TE), self.is_on(RE));
        let changed = self.cr1 ^ value;
        self.cr1 = value & 0xBFFE;
        if changed & (M | OVER8) != 0 && self.sending.is_some() {
            cx.find(FindingKind::Misuse, "the frame format changed while a frame is under way");
        }
        self.set_bit();
        self.switched(before, cx);
    }

    /// What follows from the transmitter or the receiver being switched on or off.
    fn switched(&mut self, before: (bool, bool), cx: &mut Cx) {
        let (sends, receives) = (self.is_on(TE), self.is_on(RE));
        if sends != before.0 {
            let drives = sends && self.cr3 & HDSEL == 0;
            cx.output(Signal::Uart(self.number, UartPin::Tx), drives.then_some(true));
            if sends {
                // TE sends an idle frame first (30.3.2).
                self.sending = Some(Sending { data: None, ends: cx.now + self.frame_cycles() });
            } else if let Some(Sending { data: Some(_), .. }) = self.sending.take() {
                cx.find(FindingKind::Misuse, "the transmitter was disabled while it sent: the frame is lost");
            }
        }
        if receives != before.1 {
            self.waves.clear();
            self.receiving = None;
            self.idle_at = NEVER;
            self.look_from = cx.now;
        }
    }

    fn read_register(&self, offset: u32) -> Option<u32> {
        Some(match offset {
            0x00 => self.sr,
            0x04 => u32::from(self.rdr),
            0x08 => self.brr,
            0x0C => self.cr1,
            0x10 => self.cr2,
            0x14 => self.cr3,
            0x18 => self.gtpr,
            _ => return None,
        })
    }
}

impl Peripheral for Usart {
    fn read(&mut self, offset: u32, _: Width, cx: &mut Cx) -> u32 {
        let register = offset & !3;
        let Some(value) = self.read_register(register) else {
            cx.find_value(FindingKind::Undefined, "no register at offset", offset);
            return 0;
        };
        if register == 0x00 {
            self.shown = value;
        } else if register == 0x04 {
            self.sr &= !(RXNE | self.shown & (PE | FE | NF | ORE | IDLE));
            self.shown &= TC;
        }
        value >> (8 * (offset & 3))
    }

    fn write(&mut self, offset: u32, width: Width, value: u32, cx: &mut Cx) {
        let value = crate::lanes(width, value);
        match offset & !3 {
            // Written zeros clear CTS, LBD, TC and RXNE, the rest is read-only.
            0x00 => self.sr &= value | !(RXNE | TC | 0x300),
            0x04 => {
                self.tdr = value as u16 & 0x1FF;
                self.sr &= !(TXE | self.shown & (TC | PE));
                self.shown &= !TC;
                self.send_next(cx.now);
            }
            0x08 => {
                let before = (self.is_on(TE), self.is_on(RE));
                if self.sending.is_some_and(|sending| sending.data.is_some()) && self.brr != value & 0xFFFF {
                    cx.find(FindingKind::Misuse, "BRR changed while a frame is under way");
                }
                self.brr = value & 0xFFFF;
                self.set_bit();
                if self.bit == 0 && self.cr1 & UE != 0 {
                    cx.find(FindingKind::Misuse, "BRR is below 1.0: there is no baud rate");
                }
                self.switched(before, cx);
            }
            0x0C => self.write_cr1(value, cx),
            0x10 => {
                if value & LINEN != 0 {
                    cx.find(FindingKind::Unmodelled, "LIN mode (CR2.LINEN)");
                }
                if value & CLKEN != 0 {
                    cx.find(FindingKind::Unmodelled, "the synchronous clock (CR2.CLKEN)");
                }
                self.cr2 = value & 0x7F6F;
            }
            0x14 => {
                if value & (IREN | SCEN) != 0 {
                    cx.find(FindingKind::Unmodelled, "IrDA or smartcard mode (CR3.IREN, SCEN)");
                }
                if value & (RTSE | CTSE) != 0 {
                    cx.find(FindingKind::Unmodelled, "flow control (CR3.RTSE, CTSE): it stops nothing");
                }
                self.cr3 = value & 0xFFF;
            }
            0x18 => self.gtpr = value & 0xFFFF,
            _ => cx.find_value(FindingKind::Undefined, "no register at offset", offset),
        }
        self.plan();
    }

    fn peek(&self, offset: u32, _: &mut Cx) -> u32 {
        self.read_register(offset & !3).unwrap_or(0)
    }

    fn due(&self) -> Cycle {
        self.due
    }

    fn advance<W: Wires>(&mut self, cx: &mut Cx, wires: &mut W) {
        while self.due <= cx.now {
            if let Some(sent) = self.sending.filter(|sending| sending.ends <= self.due) {
                self.sending = None;
                self.finish_sending(sent, cx, wires);
                self.send_next(sent.ends);
                if self.sending.is_none() {
                    self.sr |= TC;
                }
            }
            if self.receiving.is_some_and(|edge| edge + self.sampled_after() <= self.due) {
                self.finish_receiving();
            }
            if self.idle_at <= self.due {
                self.idle_at = NEVER;
                self.sr |= IDLE;
            }
            self.plan();
        }
    }

    fn irq(&self) -> u32 {
        let pairs = [(TXEIE, TXE), (TCIE, TC), (RXNEIE, RXNE | ORE), (IDLEIE, IDLE), (PEIE, PE)];
        let errors = self.cr3 & (EIE | DMAR) == EIE | DMAR && self.sr & (FE | NF | ORE) != 0;
        u32::from(errors || pairs.iter().any(|&(enable, flags)| self.cr1 & enable != 0 && self.sr & flags != 0))
    }

    #[inline]
    fn dma(&self) -> u32 {
        let receives = self.cr3 & DMAR != 0 && self.sr & RXNE != 0;
        let sends = self.cr3 & DMAT != 0 && self.sr & TXE != 0 && self.cr1 & TE != 0;
        u32::from(receives) | u32::from(sends) << 1
    }

    fn clocks_changed(&mut self, old: &Clocks, cx: &mut Cx) {
        let apb2 = matches!(self.number, 1 | 6);
        self.pclk = if apb2 { cx.clocks.pclk2 } else { cx.clocks.pclk1 };
        let was = self.bit;
        self.set_bit();
        if let Some(sending) = &mut self.sending
            && was != 0
        {
            sending.ends = cx.now + sending.ends.saturating_sub(cx.now) * self.bit / was;
        }
        // The line goes on in its own time, of which core cycles are now a different number.
        let (new_hz, old_hz) = (u128::from(cx.clocks.hclk_hz), u128::from(old.hclk_hz.max(1)));
        let scaled = |cycles: u64| (u128::from(cycles) * new_hz / old_hz) as u64;
        let moved = |at: Cycle| {
            if at == NEVER {
                NEVER
            } else if at >= cx.now {
                cx.now + scaled(at - cx.now)
            } else {
                cx.now.saturating_sub(scaled(cx.now - at))
            }
        };
        for wave in &mut self.waves {
            wave.begins = moved(wave.begins);
            wave.ends = moved(wave.ends);
            wave.bit = scaled(wave.bit).max(1);
        }
        self.receiving = self.receiving.map(moved);
        self.look_from = moved(self.look_from);
        self.idle_at = moved(self.idle_at);
        self.known_bit = (0, 0);
        self.plan();
    }

    fn reset(&mut self) {
        *self = Self { pclk: self.pclk, ..Self::new(self.number) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Rig;

    const SR: u32 = 0x00;
    const DR: u32 = 0x04;
    const BRR: u32 = 0x08;
    const CR1: u32 = 0x0C;
    const CR3: u32 = 0x14;

    /// A receiver and transmitter at 115 107.9 baud of 16 MHz: 139 cycles a bit.
    fn rig() -> Rig<Usart> {
        let mut rig = Rig::new(Usart::new(4));
        rig.connect(Signal::Uart(4, UartPin::Tx), 0, 0);
        rig.write(BRR, 139);
        rig.write(CR1, UE | RE | TE);
        // The idle frame that TE sends.
        rig.run(1390);
        rig
    }

    fn tell(rig: &mut Rig<Usart>, begins: Cycle, frame: &UartFrame) {
        rig.call(|uart, cx| uart.receive(begins, frame, cx));
    }

    #[test]
    fn a_byte_is_received_at_the_last_sample_of_its_stop_bit() {
        let mut rig = rig();
        tell(&mut rig, 2000, &UartFrame::eight_n_one(0x5A, 115_200));
        let sampled = 2000 + 9 * 139 + 86;
        rig.run(sampled - 1);
        assert_eq!(rig.read(SR) & RXNE, 0);
        rig.run(sampled);
        assert_eq!(rig.read(SR) & (RXNE | FE | NF | PE | ORE), RXNE);
        assert_eq!(rig.read(DR), 0x5A);
        assert_eq!(rig.read(SR) & RXNE, 0);
    }

    #[test]
    fn frames_back_to_back_that_are_told_of_at_their_ends_are_all_received_without_an_idle_line() {
        let mut rig = rig();
        let frame = |byte| UartFrame::eight_n_one(byte, 115_200);
        let length = 1389;
        for byte in 0..100_u8 {
            let begins = 2000 + u64::from(byte) * length;
            rig.run(begins + length);
            tell(&mut rig, begins, &frame(byte));
            assert_eq!(rig.read(SR) & (RXNE | IDLE | FE | NF | ORE), RXNE, "{byte}");
            assert_eq!(rig.read(DR), u32::from(byte));
        }
        rig.run(rig.now + 1000);
        assert_eq!(rig.read(SR) & IDLE, 0);
        rig.run(rig.now + 1000);
        assert_ne!(rig.read(SR) & IDLE, 0);
        rig.read(DR);
        assert_eq!(rig.read(SR) & IDLE, 0);
        rig.run(rig.now + 100_000);
        assert_eq!(rig.read(SR) & IDLE, 0, "once for each idle line");
    }

    #[test]
    fn twice_the_baud_rate_on_the_line_gives_another_byte_than_was_sent() {
        let mut rig = rig();
        tell(&mut rig, 2000, &UartFrame::eight_n_one(0x00, 230_400));
        rig.run(10_000);
        // The line is low for four and a half of the receiver's bits, and rises between two samples of the fifth.
        assert_ne!(rig.read(SR) & NF, 0);
        assert_eq!(rig.read(DR), 0xF8);
    }

    #[test]
    fn half_the_baud_rate_on_the_line_gives_a_framing_error() {
        let mut rig = rig();
        tell(&mut rig, 2000, &UartFrame::eight_n_one(0x00, 57_600));
        rig.run(3600);
        assert_eq!(rig.read(SR) & (RXNE | FE), RXNE | FE);
        assert_eq!(rig.read(DR), 0);
        assert_eq!(rig.read(SR) & FE, 0);
    }

    #[test]
    fn a_sender_three_percent_off_is_received_and_one_six_percent_off_is_not() {
        for (baud, right) in [(111_700, true), (118_600, true), (108_300, false), (122_200, false)] {
            let mut rig = rig();
            tell(&mut rig, 2000, &UartFrame::eight_n_one(0x80, baud));
            rig.run(3400);
            let clean = rig.read(SR) & (RXNE | FE | NF) == RXNE && rig.read(DR) == 0x80;
            assert_eq!(clean, right, "{baud}");
        }
    }

    #[test]
    fn a_wrong_parity_is_flagged() {
        let mut rig = rig();
        rig.write(CR1, UE | RE | M | PCE);
        let mut frame = UartFrame::eight_n_one(0x03, 115_200);
        frame.parity = UartParity::Even;
        tell(&mut rig, 2000, &frame);
        rig.run(4000);
        assert_eq!(rig.read(SR) & (RXNE | PE | FE), RXNE);
        assert_eq!(rig.read(DR) & 0xFF, 3);
        frame.parity = UartParity::Odd;
        tell(&mut rig, 5000, &frame);
        rig.run(8000);
        assert_eq!(rig.read(SR) & (RXNE | PE | FE), RXNE | PE);
    }

    #[test]
    fn a_byte_that_is_not_read_in_time_stays_and_the_next_one_is_lost() {
        let mut rig = rig();
        tell(&mut rig, 2000, &UartFrame::eight_n_one(1, 115_200));
        tell(&mut rig, 4000, &UartFrame::eight_n_one(2, 115_200));
        rig.run(6000);
        assert_eq!(rig.read(SR) & (RXNE | ORE), RXNE | ORE);
        assert_eq!(rig.read(DR), 1);
        assert_eq!(rig.read(SR) & (RXNE | ORE), 0);
    }

    #[test]
    fn without_the_receiver_nothing_comes_in() {
        let mut rig = rig();
        rig.write(CR1, UE | TE);
        tell(&mut rig, 2000, &UartFrame::eight_n_one(1, 115_200));
        rig.run(6000);
        assert_eq!(rig.read(SR) & (RXNE | IDLE), 0);
    }

    #[test]
    fn requests_and_error_interrupts_need_the_dma_bit() {
        let mut rig = rig();
        tell(&mut rig, 2000, &UartFrame::eight_n_one(0, 57_600));
        rig.run(3600);
        rig.write(CR3, EIE);
        assert_eq!((rig.instance.dma(), rig.instance.irq()), (0, 0));
        rig.write(CR3, EIE | DMAR);
        assert_eq!((rig.instance.dma(), rig.instance.irq()), (1, 1));
    }

    #[test]
    fn bytes_are_sent_back_to_back_and_tc_rises_after_the_last() {
        let mut rig = rig();
        rig.run(2000);
        rig.write(DR, 0x41);
        assert_eq!(rig.read(SR) & (TXE | TC), TXE);
        rig.write(DR, 0x42);
        assert_eq!(rig.read(SR) & (TXE | TC), 0);
        rig.run(2000 + 2 * 1390 - 1);
        assert_eq!(rig.read(SR) & (TXE | TC), TXE);
        rig.run(2000 + 2 * 1390);
        assert_eq!(rig.read(SR) & (TXE | TC), TXE | TC);
        let sent: Vec<_> = rig.lines.uart.iter().map(|(at, frame)| (*at, frame.data, frame.bit_ps)).collect();
        assert_eq!(sent, [(3390, 0x41, 8_687_500), (4780, 0x42, 8_687_500)]);
    }

    #[test]
    fn the_first_byte_waits_for_the_idle_frame_that_enabling_the_transmitter_sends() {
        let mut rig = Rig::new(Usart::new(1));
        rig.connect(Signal::Uart(1, UartPin::Tx), 0, 0);
        rig.write(BRR, 16);
        rig.write(CR1, UE | TE);
        rig.write(DR, 0x41);
        rig.run(1000);
        assert_eq!(rig.lines.uart[0].0, 320);
    }

    #[test]
    fn without_a_baud_rate_nothing_is_sent() {
        let mut rig = Rig::new(Usart::new(1));
        rig.connect(Signal::Uart(1, UartPin::Tx), 0, 0);
        rig.write(CR1, UE | TE);
        rig.write(DR, 0x41);
        rig.run(100_000);
        assert!(rig.lines.uart.is_empty());
        assert_eq!(rig.read(SR) & TXE, 0);
    }

    #[test]
    fn oversampling_by_eight_takes_three_bits_of_fraction() {
        let mut rig = Rig::new(Usart::new(4));
        rig.connect(Signal::Uart(4, UartPin::Tx), 0, 0);
        rig.write(BRR, 0x113);
        rig.write(CR1, OVER8 | UE | RE | TE);
        rig.run(1390);
        rig.write(DR, 0x41);
        tell(&mut rig, 1390, &UartFrame::eight_n_one(0xC3, 115_200));
        rig.run(4000);
        assert_eq!(rig.lines.uart[0].1.bit_ps, 139 * 62_500);
        assert_eq!((rig.read(SR) & (RXNE | FE | NF), rig.read(DR)), (RXNE, 0xC3));
    }

    #[test]
    fn in_half_duplex_the_receiver_hears_what_is_sent() {
        let mut rig = rig();
        rig.write(CR3, HDSEL);
        rig.write(DR, 0x41);
        rig.run(rig.now + 1390);
        assert_eq!((rig.read(SR) & (RXNE | FE | NF), rig.read(DR)), (RXNE, 0x41));
    }

    #[test]
    fn what_the_reference_sampling_gives_is_what_the_short_way_gives() {
        for baud in [113_000, 114_500, 115_200, 116_000, 117_500] {
            for data in [0x00, 0x01, 0x55, 0x80, 0xAA, 0xFF] {
                let mut rig = rig();
                tell(&mut rig, 2000, &UartFrame::eight_n_one(data, baud));
                let short = rig.instance.sampled(2000);
                // A second wave in the way of the last sample takes the short way away.
                let blank = Wave { begins: 2000, ends: 2000, bit: 1, levels: u32::MAX };
                rig.instance.waves.push_back(blank);
                assert_eq!(rig.instance.sampled(2000), short, "{baud} {data:#x}");
            }
        }
    }
}
