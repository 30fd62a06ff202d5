//! I2C1 to I2C3 as masters (RM0090 chapter 27).
//!
//! | Covered | Manual |
//! |---|---|
//! | Start, repeated start, stop, seven-bit addresses, transmitter and receiver, their sequences | 27.3.3 |
//! | `SB`, `ADDR`, `TXE`, `RXNE`, `BTF`, `AF` and their clearing; the clock held low until software acts | 27.6.6 |
//! | `ACK`, `POS`, `SWRST`, `PE`; a bit's length from `CCR`, `DUTY`, `F/S` | 27.6.1, 27.6.8 |
//! | A clock that a peripheral stretches, DMA requests, both interrupts | 27.3.7, 27.4 |
//! | `LAST`: when the DMA has one byte left (EOT_1), the byte after that transfer is not acknowledged | 27.3.7 |
//! | `BUSY` follows the lines, also with `PE` clear; a start waits until the bus is free | 27.6.7 |
//! | A clock that another device holds low: the step continues only when the clock is released | 27.3.3 |
//! | `ARLO`: another device turns a one into a zero, which ends the transfer at that bit | 27.3.4 |
//! | `BERR`: an edge of SDA while SCL is high within a byte; the transfer goes on | 27.3.4, ES0206 2.9.6 |
//! | A start that software requests before an unexpected stop is never generated | ES0206 2.9.2 |
//!
//! **Left out, each a finding when it is used:** slave mode, ten-bit addresses, SMBus, PEC, the general call. `TRISE`
//! does not lengthen a bit. The filters (`FLTR`, 50 ns) pass every pulse. A `BERR` without a cause (ES0206 2.9.6)
//! happens only if a test requests it.
//!
//! `steps` models transfers, `lines` the effect of other devices, and this module the registers.
//!
//! # Lines
//!
//! The pads do not have the levels that this I2C drives, since the board gets a transfer in steps ([`I2cEvent`]). They
//! have the levels of the board, with its pull-ups, and of pins that software drives. A line that is low is therefore
//! held by another device, and sets `BUSY`. A stop (SDA rises while SCL is high) and `SWRST` clear `BUSY`. If another
//! device only releases SCL, or if `PE` or `ARLO` cut a transfer short, `BUSY` stays set until software resets the I2C.
//!
//! Every step (start, address or data byte with acknowledge, stop) is one event at its end.

mod lines;
mod steps;
#[cfg(test)]
mod tests;

use cortex_m4::Width;
use emulator_part::{Cycle, FindingKind, I2cAnswer, I2cEvent, NEVER};

use crate::cx::{Clocks, Cx, I2cPin, Peripheral, Signal, Wires};

const PE: u32 = 1 << 0;
const SMBUS: u32 = 1 << 1;
const ENPEC: u32 = 1 << 5;
const ENGC: u32 = 1 << 6;
const START: u32 = 1 << 8;
const STOP: u32 = 1 << 9;
const ACK: u32 = 1 << 10;
const POS: u32 = 1 << 11;
const SWRST: u32 = 1 << 15;

const ITERREN: u32 = 1 << 8;
const ITEVTEN: u32 = 1 << 9;
const ITBUFEN: u32 = 1 << 10;
const DMAEN: u32 = 1 << 11;
const LAST: u32 = 1 << 12;

const SB: u32 = 1 << 0;
const ADDR: u32 = 1 << 1;
const BTF: u32 = 1 << 2;
const RXNE: u32 = 1 << 6;
const TXE: u32 = 1 << 7;
const BERR: u32 = 1 << 8;
const ARLO: u32 = 1 << 9;
const AF: u32 = 1 << 10;

const MSL: u32 = 1 << 0;
const BUSY: u32 = 1 << 1;
const TRA: u32 = 1 << 2;

/// The bits F/S and DUTY of CCR.
const FAST: u32 = 1 << 15;
const DUTY: u32 = 1 << 14;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Start,
    Address(u8),
    Write(u8),
    Read,
    Stop,
}

#[derive(Clone, Debug)]
pub(crate) struct I2c {
    number: u8,
    cr1: u32,
    cr2: u32,
    oar1: u32,
    oar2: u32,
    sr1: u32,
    sr2: u32,
    ccr: u32,
    trise: u32,
    fltr: u32,
    data: u8,
    /// The received byte that is still in the shift register (BTF of a receiver).
    shifted: u8,
    /// The present step. While the bus stretches the clock, the bus's answer is already known.
    step: Option<(Step, Option<I2cAnswer>)>,
    began: Cycle,
    low_since: Option<Cycle>,
    /// The bits of the step, from bit 0, that were sampled while SDA was held low.
    low: u16,
    /// Whether [`I2c::due`] is the instant at which arbitration is lost.
    loses: bool,
    /// The cycles that a step has still to last while another device holds it. The device holds SCL or, for a stop,
    /// SDA.
    held: Option<u64>,
    due: Cycle,
    /// Whether the DMA has signalled EOT_1. If so, the next byte is not acknowledged.
    is_last: bool,
    /// Whether an unexpected stop came while a start was requested. If so, the start is never generated.
    start_lost: bool,
    /// Whether SR1 was read, the first step of the clearing sequences.
    status_read: bool,
    held_ack: bool,
    /// Whether the receiver acknowledged the last byte. If so, the transfer goes on.
    goes_on: bool,
    pclk: u32,
}

impl I2c {
    pub(crate) fn new(number: u8) -> Self {
        Self {
            number,
            cr1: 0,
            cr2: 0,
            oar1: 0,
            oar2: 0,
            sr1: 0,
            sr2: 0,
            ccr: 0,
            trise: 2,
            fltr: 0,
            data: 0,
            shifted: 0,
            step: None,
            began: 0,
            low_since: None,
            low: 0,
            loses: false,
            held: None,
            due: NEVER,
            is_last: false,
            start_lost: false,
            status_read: false,
            held_ack: false,
            goes_on: false,
            pclk: 1,
        }
    }

    /// Sets `BERR` without any cause (ES0206 2.9.6).
    pub(crate) fn spurious_bus_error(&mut self) {
        if self.cr1 & PE != 0 {
            self.sr1 |= BERR;
        }
    }

    fn write_data(&mut self, value: u8, cx: &mut Cx) {
        if self.sr1 & SB != 0 {
            if self.status_read && self.step.is_none() {
                self.sr1 &= !SB;
                if value & 0xF8 == 0xF0 {
                    cx.find(FindingKind::Unmodelled, "a ten-bit address");
                }
                self.begin(Step::Address(value), cx.now, cx);
            }
            return;
        }
        self.data = value;
        self.sr1 &= !(TXE | BTF);
        self.go_on(cx.now, cx);
    }

    fn read_data(&mut self, cx: &mut Cx) -> u32 {
        let data = self.data;
        if self.sr1 & BTF != 0 && self.sr2 & TRA == 0 {
            self.data = self.shifted;
            self.sr1 &= !BTF;
            self.go_on(cx.now, cx);
        } else {
            self.sr1 &= !RXNE;
        }
        u32::from(data)
    }

    fn read_sr2(&mut self, cx: &mut Cx) -> u32 {
        let value = self.sr2;
        if self.sr1 & ADDR != 0 && self.status_read {
            self.sr1 &= !ADDR;
            self.goes_on = true;
            if self.sr2 & TRA != 0 {
                self.sr1 |= TXE;
            }
            self.go_on(cx.now, cx);
        }
        value
    }

    fn write_cr1(&mut self, value: u32, cx: &mut Cx) {
        if value & SWRST != 0 {
            *self = Self { pclk: self.pclk, cr1: SWRST, ..Self::new(self.number) };
            return;
        }
        if self.cr1 & SWRST != 0 {
            self.look_at_lines(cx);
        }
        if value & (SMBUS | ENPEC | ENGC) != 0 {
            cx.find(FindingKind::Unmodelled, "SMBus, PEC or the general call");
        }
        self.cr1 = value & 0xBFFB;
        if value & PE == 0 {
            self.cr1 &= !(START | STOP | ACK);
            self.sr1 = 0;
            // The transfer was cut short without a stop, so BUSY stays set.
            self.sr2 &= BUSY;
            self.abandon();
            self.start_lost = false;
            return;
        }
        if value & START != 0 {
            let megahertz = u64::from(self.cr2 & 0x3F);
            if megahertz != cx.clocks.pclk1_hz() / 1_000_000 {
                cx.find(FindingKind::Misuse, "CR2.FREQ is not PCLK1's frequency");
            }
            if self.ccr & 0xFFF == 0 {
                cx.find(FindingKind::Misuse, "CCR is zero");
            }
        }
        if value & ACK != 0 && self.oar1 & 0xFE != 0 {
            cx.find(FindingKind::Unmodelled, "an own address: nothing answers to it (slave mode)");
        }
        self.go_on(cx.now, cx);
    }
}

impl Peripheral for I2c {
    fn read(&mut self, offset: u32, _: Width, cx: &mut Cx) -> u32 {
        let value = match offset & !3 {
            0x10 => self.read_data(cx),
            0x14 => {
                self.status_read = true;
                self.sr1
            }
            0x18 => self.read_sr2(cx),
            register if register <= 0x24 => self.peek(register, cx),
            _ => {
                cx.find_value(FindingKind::Undefined, "no register at offset", offset);
                0
            }
        };
        value >> (8 * (offset & 3))
    }

    fn write(&mut self, offset: u32, width: Width, value: u32, cx: &mut Cx) {
        let value = crate::lanes(width, value) & 0xFFFF;
        if self.cr1 & SWRST != 0 && offset & !3 != 0 {
            cx.find_value(FindingKind::Misuse, "written while CR1.SWRST is set: nothing is kept, offset", offset);
            return;
        }
        match offset & !3 {
            0x00 => self.write_cr1(value, cx),
            0x04 => self.cr2 = value & 0x1F3F,
            0x08 => self.oar1 = value & 0xC3FF,
            0x0C => self.oar2 = value & 0xFF,
            0x10 => self.write_data(value as u8, cx),
            // Written zeros clear the error flags. The other flags have clearing sequences.
            0x14 => self.sr1 &= value | !0xDF00,
            0x18 => {}
            0x1C => {
                if self.cr1 & PE != 0 && value != self.ccr {
                    cx.find(FindingKind::Misuse, "CCR changed while the I2C is enabled");
                }
                self.ccr = value & 0xCFFF;
            }
            0x20 => self.trise = value & 0x3F,
            0x24 => self.fltr = value & 0x1F,
            _ => cx.find_value(FindingKind::Undefined, "no register at offset", offset),
        }
    }

    fn peek(&self, offset: u32, _: &mut Cx) -> u32 {
        match offset & !3 {
            0x00 => self.cr1,
            0x04 => self.cr2,
            0x08 => self.oar1,
            0x0C => self.oar2,
            0x10 => u32::from(self.data),
            0x14 => self.sr1,
            0x18 => self.sr2,
            0x1C => self.ccr,
            0x20 => self.trise,
            0x24 => self.fltr,
            _ => 0,
        }
    }

    fn due(&self) -> Cycle {
        self.due
    }

    fn advance<W: Wires>(&mut self, cx: &mut Cx, wires: &mut W) {
        while self.due <= cx.now {
            self.finish(cx, wires);
        }
    }

    fn irq(&self) -> u32 {
        let buffer = if self.cr2 & ITBUFEN != 0 { TXE | RXNE } else { 0 };
        let event = self.cr2 & ITEVTEN != 0 && self.sr1 & (SB | ADDR | BTF | buffer) != 0;
        let error = self.cr2 & ITERREN != 0 && self.sr1 & (BERR | ARLO | AF) != 0;
        u32::from(event) | u32::from(error) << 1
    }

    fn dma(&self) -> u32 {
        if self.cr2 & DMAEN == 0 {
            return 0;
        }
        u32::from(self.sr1 & RXNE != 0) | u32::from(self.sr1 & TXE != 0) << 1
    }

    fn dma_served(&mut self, bit: u8, left: u32, _: &mut Cx) {
        if bit == 0 && left == 1 && self.cr2 & LAST != 0 {
            self.is_last = true;
        }
    }

    fn clocks_changed(&mut self, old: &Clocks, cx: &mut Cx) {
        self.pclk = cx.clocks.pclk1;
        let scaled = |cycles: u64| cycles * u64::from(self.pclk) / u64::from(old.pclk1.max(1));
        if self.due != NEVER {
            self.due = cx.now + scaled(self.due.saturating_sub(cx.now));
        }
        self.began = cx.now.saturating_sub(scaled(cx.now.saturating_sub(self.began)));
        self.held = self.held.map(scaled);
    }

    fn reset(&mut self) {
        *self = Self { pclk: self.pclk, ..Self::new(self.number) };
    }

    fn input(&mut self, signal: Signal, level: bool, cx: &mut Cx) {
        match signal {
            Signal::I2c(_, I2cPin::Scl) => self.clock_changed(level, cx),
            Signal::I2c(_, I2cPin::Sda) => self.data_changed(level, cx),
            _ => {}
        }
    }
}
