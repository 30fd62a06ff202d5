//! USART1 to USART3, USART6, UART4, UART5, UART7 and UART8 (RM0090 chapter 30).
//!
//! | Module | Covered | Manual |
//! |---|---|---|
//! | this one | Baud rate from `BRR` and `OVER8`, 8 and 9 bits, parity, 0.5 to 2 stop bits | 30.3.2 to 30.3.4, 30.3.7 |
//! | `transmitter` | `TXE`, `TC` with both ways of clearing it, the idle frame that `TE` sends | 30.3.2 |
//! | `receiver` | three samples or `ONEBIT`; `RXNE`, `NF`, `FE`, `PE`, `ORE`, `IDLE`, clearing sequences | 30.3.3 |
//! | this one | Half duplex, DMA requests, interrupts | 30.3.10, 30.3.13, 30.4 |
//!
//! **Left out, each a finding when it is used:** LIN, smartcard, IrDA, the synchronous clock, the mute mode, RTS and
//! CTS, sending a break. A level on RX that is not part of a frame is ignored.
//!
//! # Reception
//!
//! A frame from outside is a waveform. The receiver samples each bit at its own rate, counted from the start bit's
//! falling edge: at the 8th, 9th and 10th sixteenth (OVER8: 4th to 6th eighth). A sender with another baud rate, parity
//! or length therefore gives the bytes and flags of silicon. A byte is available at the last sample of its stop bit.
//! Then the receiver looks for the next falling edge.
//!
//! `IDLE` rises a whole frame and one bit after the last stop bit. The extra bit is not in the manual: a frame reaches
//! the receiver only at its end, and the extra bit lets it come in time.

mod receiver;
#[cfg(test)]
mod tests;
mod transmitter;

use std::collections::VecDeque;

use cortex_m4::Width;
use emulator_part::{Cycle, FindingKind, NEVER, UartFrame, UartParity};

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

/// The number of fractional bits of a length in cycles.
const FRACTION: u32 = 12;

#[derive(Clone, Copy, Debug)]
struct Wave {
    begins: Cycle,
    ends: Cycle,
    /// The length of a bit in cycles, as a fixed-point number with [`FRACTION`] fractional bits.
    bit: u64,
    /// The levels of the frame's bits, with the start bit at bit 0. All bits above the frame are ones.
    levels: u32,
}

#[derive(Clone, Copy, Debug)]
struct Sending {
    /// The data of the frame; `None` for an idle frame.
    data: Option<u16>,
    ends: Cycle,
}

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
    /// The flags that the last read of SR returned. An access to DR clears these flags.
    shown: u32,
    /// The core cycles of a PCLK cycle.
    pclk: u32,
    bit: u64,
    bit_ps: u64,
    sending: Option<Sending>,
    waves: VecDeque<Wave>,
    /// The last waveform's bit length, in picoseconds and in cycles. It is kept because the conversion is slow.
    known_bit: (u64, u64),
    /// The cycle at which the start bit of the present frame fell.
    receiving: Option<Cycle>,
    look_from: Cycle,
    idle_at: Cycle,
    due: Cycle,
}

impl Usart {
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

    /// Whether a frame with data is being sent, during which M must not change (RM0090 30.6.4). The idle frame that
    /// `TE` sends does not count.
    fn sends_data(&self) -> bool {
        self.sending.is_some_and(|sending| sending.data.is_some())
    }

    /// The number of bits between start and stop bit, with parity.
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
        // A USARTDIV below 1.0 gives no clock (RM0090 30.3.4).
        let least = if self.cr1 & OVER8 != 0 { 8 } else { 16 };
        self.bit = if divider < least { 0 } else { u64::from(divider) * u64::from(self.pclk) };
        self.bit_ps = 0;
    }

    fn plan(&mut self) {
        let sends = self.sending.map_or(NEVER, |sending| sending.ends);
        let receives = self.receiving.map_or(NEVER, |edge| edge + self.sampled_after());
        self.due = sends.min(receives).min(self.idle_at);
    }

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
        if changed & (M | OVER8) != 0 && self.sends_data() {
            cx.find(FindingKind::Misuse, "the frame format changed while a frame is under way");
        }
        self.set_bit();
        self.switched(before, cx);
    }

    fn switched(&mut self, before: (bool, bool), cx: &mut Cx) {
        let (sends, receives) = (self.is_on(TE), self.is_on(RE));
        if sends != before.0 {
            let drives = sends && self.cr3 & HDSEL == 0;
            cx.output(Signal::Uart(self.number, UartPin::Tx), drives.then_some(true));
            if sends {
                // The transmitter first sends an idle frame (RM0090 30.3.2).
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
            // Written zeros clear CTS, LBD, TC and RXNE.
            0x00 => self.sr &= value | !(RXNE | TC | 0x300),
            0x04 => {
                self.tdr = value as u16 & 0x1FF;
                self.sr &= !(TXE | self.shown & (TC | PE));
                self.shown &= !TC;
                self.send_next(cx.now);
            }
            0x08 => {
                let before = (self.is_on(TE), self.is_on(RE));
                if self.sends_data() && self.brr != value & 0xFFFF {
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
        // The line keeps its timing in seconds, so its cycles change with the clock.
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
