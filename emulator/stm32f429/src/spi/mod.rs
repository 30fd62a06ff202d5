//! SPI1 to SPI6 (RM0090 chapter 28).
//!
//! | Covered | Manual |
//! |---|---|
//! | Master: two lines, `RXONLY`, `BIDIMODE`, 8 and 16 bits, `LSBFIRST`, `CPOL`, `CPHA`, `BR` | 28.3.3, 28.3.5 |
//! | `TXE`, `RXNE`, `BSY`, `OVR` with data and shift register, back-to-back frames | 28.3.7, 28.3.10 |
//! | Slave select by software and by the pin, `SSOE`, `MODF` with its clearing sequence | 28.3.1, 28.3.10 |
//! | The CRC unit: `CRCNEXT`, `CRCERR` | 28.3.6 |
//! | DMA requests, interrupts | 28.3.9, 28.3.11 |
//!
//! **Left out, each a finding when it is used:** slave mode (nothing outside the part clocks it), I2S, the TI frame
//! format, the CRC that the end of a DMA transfer sends.
//!
//! `frame` models the shift register, and this module the registers.
//!
//! # Time
//!
//! A byte that is written while the shift register is empty moves there at once, and `TXE` is set before the next
//! access. The frame begins at the next PCLK edge and lasts one SCK period for each bit. Then the received data is
//! available. If the data register holds another byte, its frame follows without a gap.

mod frame;
#[cfg(test)]
mod tests;

use cortex_m4::Width;
use emulator_part::{Cycle, FindingKind, NEVER, SpiFrame, SpiMode};

use crate::cx::{Clocks, Cx, Peripheral, Signal, SpiPin, Wires};

/// The offset of the data register.
pub(crate) const DATA: u32 = 0x0C;

const CPHA: u32 = 1 << 0;
const CPOL: u32 = 1 << 1;
const MSTR: u32 = 1 << 2;
const BR: u32 = 7 << 3;
const SPE: u32 = 1 << 6;
const LSBFIRST: u32 = 1 << 7;
const SSI: u32 = 1 << 8;
const SSM: u32 = 1 << 9;
const RXONLY: u32 = 1 << 10;
const DFF: u32 = 1 << 11;
const CRCNEXT: u32 = 1 << 12;
const CRCEN: u32 = 1 << 13;
const BIDIOE: u32 = 1 << 14;
const BIDIMODE: u32 = 1 << 15;

const RXDMAEN: u32 = 1 << 0;
const TXDMAEN: u32 = 1 << 1;
const SSOE: u32 = 1 << 2;
const FRF: u32 = 1 << 4;
const ERRIE: u32 = 1 << 5;
const RXNEIE: u32 = 1 << 6;
const TXEIE: u32 = 1 << 7;

const RXNE: u32 = 1 << 0;
const TXE: u32 = 1 << 1;
const CRCERR: u32 = 1 << 4;
const MODF: u32 = 1 << 5;
const OVR: u32 = 1 << 6;
const BSY: u32 = 1 << 7;

const I2SMOD: u32 = 1 << 11;

#[derive(Clone, Copy, Debug)]
struct Flight {
    data: u16,
    begins: Cycle,
    ends: Cycle,
    is_crc: bool,
}

#[derive(Clone, Debug)]
pub(crate) struct Spi {
    number: u8,
    cr1: u32,
    cr2: u32,
    sr: u32,
    tx: u16,
    rx: u16,
    crc_polynomial: u16,
    rx_crc: u16,
    tx_crc: u16,
    i2scfgr: u32,
    i2spr: u32,
    flight: Option<Flight>,
    due: Cycle,
    pclk: u32,
    /// Whether the CRC that CRCNEXT requests was sent.
    crc_done: bool,
    /// Whether DR was read, the first step to clear OVR.
    overrun_read: bool,
    fault_read: bool,
}

impl Spi {
    pub(crate) fn new(number: u8) -> Self {
        Self {
            number,
            cr1: 0,
            cr2: 0,
            sr: TXE,
            tx: 0,
            rx: 0,
            crc_polynomial: 7,
            rx_crc: 0,
            tx_crc: 0,
            i2scfgr: 0,
            i2spr: 2,
            flight: None,
            due: NEVER,
            pclk: 1,
            crc_done: false,
            overrun_read: false,
            fault_read: false,
        }
    }

    fn signal(&self, pin: SpiPin) -> Signal {
        Signal::Spi(self.number, pin)
    }

    fn bits(&self) -> u8 {
        if self.cr1 & DFF != 0 { 16 } else { 8 }
    }

    fn mask(&self) -> u16 {
        if self.cr1 & DFF != 0 { 0xFFFF } else { 0xFF }
    }

    /// Whether the mode only receives. If so, SCK runs although no data is sent.
    fn receives_only(&self) -> bool {
        if self.cr1 & BIDIMODE != 0 { self.cr1 & BIDIOE == 0 } else { self.cr1 & RXONLY != 0 }
    }

    fn sends_only(&self) -> bool {
        self.cr1 & (BIDIMODE | BIDIOE) == BIDIMODE | BIDIOE
    }

    /// The slave select input (RM0090 28.3.1). A pin that is not connected is low.
    fn select_is_high(&self, cx: &Cx) -> bool {
        if self.cr1 & SSM != 0 { self.cr1 & SSI != 0 } else { cx.pads.input(self.signal(SpiPin::Nss)).unwrap_or(false) }
    }

    fn check_mode_fault(&mut self, cx: &mut Cx) {
        let output = self.cr1 & SSM == 0 && self.cr2 & SSOE != 0;
        if self.cr1 & (SPE | MSTR) == SPE | MSTR && !output && !self.select_is_high(cx) {
            self.cr1 &= !(SPE | MSTR);
            self.sr |= MODF;
            self.fault_read = false;
            self.drop_flight();
        }
    }

    /// Drives the levels that the pins have between frames.
    fn drive(&self, before: (u32, u32), cx: &mut Cx) {
        let driven = |cr1: u32| cr1 & (SPE | MSTR) == SPE | MSTR;
        let on = driven(self.cr1);
        if driven(before.0) != on || (on && (before.0 ^ self.cr1) & CPOL != 0) {
            cx.output(self.signal(SpiPin::Sck), on.then_some(self.cr1 & CPOL != 0));
        }
        let sends = |cr1: u32| driven(cr1) && cr1 & (BIDIMODE | BIDIOE) != BIDIMODE && cr1 & RXONLY == 0;
        if sends(before.0) != sends(self.cr1) {
            cx.output(self.signal(SpiPin::Mosi), sends(self.cr1).then_some(false));
        }
        let selects = |cr1: u32, cr2: u32| driven(cr1) && cr1 & SSM == 0 && cr2 & SSOE != 0;
        let now = selects(self.cr1, self.cr2);
        if selects(before.0, before.1) != now {
            cx.output(self.signal(SpiPin::Nss), now.then_some(false));
        }
    }

    fn write_cr1(&mut self, value: u32, cx: &mut Cx) {
        let mut value = value & 0xFFFF;
        if self.sr & MODF != 0 {
            // While MODF is set, SPE and MSTR cannot be set. This write of CR1 ends the sequence that clears MODF.
            value &= !(SPE | MSTR);
            if self.fault_read {
                self.sr &= !MODF;
            }
        }
        let before = self.cr1;
        let changed = before ^ value;
        let busy = self.sr & BSY != 0;
        if busy && changed & (CPHA | CPOL | MSTR | BR | LSBFIRST | BIDIMODE | RXONLY) != 0 {
            cx.find(FindingKind::Misuse, "CR1 changed while a frame is under way");
        }
        if before & value & SPE != 0 && changed & (DFF | CRCEN) != 0 {
            cx.find(FindingKind::Misuse, "CR1.DFF or CRCEN changed while the SPI is enabled");
        }
        if value & (SPE | MSTR) == SPE && before & SPE == 0 {
            cx.find(FindingKind::Unmodelled, "slave mode: nothing is received or sent");
        }
        if value & CRCEN != 0 && before & CRCEN == 0 {
            (self.rx_crc, self.tx_crc) = (0, 0);
            self.crc_done = false;
        }
        if value & CRCNEXT != 0 && before & CRCNEXT == 0 {
            self.crc_done = false;
        }
        self.cr1 = value;
        self.check_mode_fault(cx);
        if before & !self.cr1 & SPE != 0 && busy && !(before & MSTR != 0 && self.receives_only()) {
            // A receive-only mode may be stopped at the end of a frame (RM0090 28.3.8). Other modes must not be stopped
            // during a frame.
            if self.sr & MODF == 0 {
                cx.find(FindingKind::Misuse, "disabled while a frame is under way: the frame is lost");
            }
            self.drop_flight();
        }
        self.drive((before, self.cr2), cx);
        self.begin(self.edge(cx.now));
    }

    /// Whether a frame of a byte has ended and the next one has begun. Both DMA requests are then active, and nothing
    /// else is.
    #[inline]
    pub(crate) fn awaits_dma(&self) -> bool {
        self.cr1 & (DFF | CRCEN) == 0
            && self.cr2 & (RXDMAEN | TXDMAEN | RXNEIE | TXEIE) == RXDMAEN | TXDMAEN
            && self.sr & (RXNE | TXE | OVR | MODF | CRCERR) == RXNE | TXE
            && self.flight.is_some()
    }

    /// Returns the byte that was received, as a read of DR does while [`Spi::awaits_dma`].
    #[inline]
    pub(crate) fn take_byte(&mut self) -> u32 {
        self.sr &= !RXNE;
        self.overrun_read = false;
        u32::from(self.rx & 0xFF)
    }

    /// Writes the byte of the frame after the present one, as a write of DR does while [`Spi::awaits_dma`].
    #[inline]
    pub(crate) fn put_byte(&mut self, value: u32) {
        self.tx = (value & 0xFF) as u16;
        self.sr &= !TXE;
    }

    fn read_register(&self, offset: u32) -> Option<u32> {
        Some(match offset {
            0x00 => self.cr1,
            0x04 => self.cr2,
            0x08 => self.sr,
            0x0C => u32::from(self.rx & self.mask()),
            0x10 => u32::from(self.crc_polynomial),
            0x14 => u32::from(self.rx_crc),
            0x18 => u32::from(self.tx_crc),
            0x1C => self.i2scfgr,
            0x20 => self.i2spr,
            _ => return None,
        })
    }
}

impl Peripheral for Spi {
    #[inline]
    fn read(&mut self, offset: u32, _: Width, cx: &mut Cx) -> u32 {
        let register = offset & !3;
        let Some(value) = self.read_register(register) else {
            cx.find_value(FindingKind::Undefined, "no register at offset", offset);
            return 0;
        };
        if register == 0x08 {
            self.fault_read |= value & MODF != 0;
            if self.overrun_read {
                self.sr &= !OVR;
                self.overrun_read = false;
            }
        } else if register == 0x0C {
            self.sr &= !RXNE;
            self.overrun_read = self.sr & OVR != 0;
        }
        value >> (8 * (offset & 3))
    }

    #[inline]
    fn write(&mut self, offset: u32, width: Width, value: u32, cx: &mut Cx) {
        let value = crate::lanes(width, value);
        match offset & !3 {
            0x00 => self.write_cr1(value, cx),
            0x04 => {
                if value & FRF != 0 {
                    cx.find(FindingKind::Unmodelled, "the TI frame format (CR2.FRF)");
                }
                if value & TXDMAEN != 0 && self.cr1 & CRCEN != 0 {
                    cx.find(FindingKind::Unmodelled, "the CRC at the end of a DMA transfer: it is not sent");
                }
                let before = self.cr2;
                self.cr2 = value & 0xF7;
                self.check_mode_fault(cx);
                self.drive((self.cr1, before), cx);
            }
            // In SR, software can only clear CRCERR.
            0x08 => self.sr &= value | !CRCERR,
            0x0C => {
                self.tx = value as u16 & self.mask();
                self.sr &= !TXE;
                if self.flight.is_none() {
                    self.begin(self.edge(cx.now));
                }
            }
            0x10 => self.crc_polynomial = value as u16,
            0x14 | 0x18 => {}
            0x1C => {
                if value & I2SMOD != 0 {
                    cx.find(FindingKind::Unmodelled, "I2S mode");
                }
                self.i2scfgr = value & 0xFBF;
            }
            0x20 => self.i2spr = value & 0x3FF,
            _ => cx.find_value(FindingKind::Undefined, "no register at offset", offset),
        }
    }

    fn peek(&self, offset: u32, _: &mut Cx) -> u32 {
        self.read_register(offset & !3).unwrap_or(0)
    }

    #[inline]
    fn due(&self) -> Cycle {
        self.due
    }

    #[inline]
    fn advance<W: Wires>(&mut self, cx: &mut Cx, wires: &mut W) {
        while self.due <= cx.now {
            let Some(flight) = self.flight.take() else { break };
            self.due = NEVER;
            self.finish_frame(flight, cx, wires);
            self.begin(flight.ends);
        }
    }

    fn irq(&self) -> u32 {
        let errors = self.cr2 & ERRIE != 0 && self.sr & (OVR | MODF | CRCERR) != 0;
        let receives = self.cr2 & RXNEIE != 0 && self.sr & RXNE != 0;
        let sends = self.cr2 & TXEIE != 0 && self.sr & TXE != 0;
        u32::from(errors || receives || sends)
    }

    #[inline]
    fn dma(&self) -> u32 {
        let receives = self.cr2 & RXDMAEN != 0 && self.sr & RXNE != 0;
        let sends = self.cr2 & TXDMAEN != 0 && self.sr & TXE != 0;
        u32::from(receives) | u32::from(sends) << 1
    }

    fn clocks_changed(&mut self, old: &Clocks, cx: &mut Cx) {
        let apb2 = matches!(self.number, 1 | 4 | 5 | 6);
        self.pclk = if apb2 { cx.clocks.pclk2 } else { cx.clocks.pclk1 };
        if let Some(flight) = &mut self.flight {
            let was = u64::from(if apb2 { old.pclk2 } else { old.pclk1 });
            let left = flight.ends.saturating_sub(cx.now).div_ceil(was);
            flight.ends = cx.now + left * u64::from(self.pclk);
            self.due = flight.ends;
        }
    }

    fn reset(&mut self) {
        *self = Self { pclk: self.pclk, ..Self::new(self.number) };
    }

    fn input(&mut self, signal: Signal, _: bool, cx: &mut Cx) {
        if signal == self.signal(SpiPin::Nss) {
            let before = self.cr1;
            self.check_mode_fault(cx);
            self.drive((before, self.cr2), cx);
        }
    }
}
