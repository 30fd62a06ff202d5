//! One frame: its begin and end, the order of its bits, the CRC, and its effect at the end (RM0090 28.3.3 to 28.3.7).

use super::*;

impl Spi {
    pub(super) fn begin(&mut self, from: Cycle) {
        if self.flight.is_some() {
            return;
        }
        let crc_next = self.cr1 & (CRCEN | CRCNEXT) == CRCEN | CRCNEXT && !self.crc_done;
        let on = self.cr1 & (SPE | MSTR) == SPE | MSTR;
        let (data, is_crc) = if !on {
            self.sr &= !BSY;
            return;
        } else if self.receives_only() {
            (0, crc_next && self.sr & BSY != 0)
        } else if self.sr & TXE == 0 {
            self.sr |= TXE;
            (self.tx, false)
        } else if crc_next && self.sr & BSY != 0 {
            (self.tx_crc, true)
        } else {
            self.sr &= !BSY;
            return;
        };
        self.crc_done |= is_crc;
        self.sr |= BSY;
        let sck = u64::from(self.pclk << ((self.cr1 >> 3 & 7) + 1));
        let ends = from + u64::from(self.bits()) * sck;
        self.flight = Some(Flight { data: data & self.mask(), begins: from, ends, is_crc });
        self.due = ends;
    }

    pub(super) fn edge(&self, now: Cycle) -> Cycle {
        // The frame begins at a PCLK edge. A PCLK cycle is a power of two of core cycles.
        let step = u64::from(self.pclk);
        (now + step - 1) & !(step - 1)
    }

    /// Converts between the bits of a frame and their order on the wire.
    fn ordered(&self, data: u16) -> u32 {
        if self.cr1 & LSBFIRST == 0 {
            u32::from(data)
        } else {
            u32::from(data.reverse_bits() >> (16 - u32::from(self.bits())))
        }
    }

    fn crc(&self, mut crc: u16, travelled: u32) -> u16 {
        let bits = self.bits();
        let top = bits - 1;
        for bit in (0..bits).rev() {
            let feed = (crc >> top & 1) ^ (travelled >> bit & 1) as u16;
            crc = (crc << 1 ^ if feed != 0 { self.crc_polynomial } else { 0 }) & self.mask();
        }
        crc
    }

    pub(super) fn finish_frame<W: Wires>(&mut self, flight: Flight, cx: &mut Cx, wires: &mut W) {
        let one_line = self.cr1 & BIDIMODE != 0;
        let mosi = cx.pins(self.signal(SpiPin::Mosi));
        let miso = if one_line { mosi[0] } else { cx.pins(self.signal(SpiPin::Miso))[0] };
        let sends = !self.receives_only();
        let travels = self.ordered(flight.data);
        let frame = SpiFrame {
            sck: cx.pins(self.signal(SpiPin::Sck)),
            mosi: if sends { mosi } else { [None; 2] },
            miso: if one_line && sends { None } else { miso },
            mode: match self.cr1 & (CPOL | CPHA) {
                0 => SpiMode::Mode0,
                CPHA => SpiMode::Mode1,
                CPOL => SpiMode::Mode2,
                _ => SpiMode::Mode3,
            },
            bits: self.bits(),
            data: travels,
            begins: flight.begins,
            ends: flight.ends,
        };
        let answer = wires.spi(&frame);
        if self.cr1 & CRCEN != 0 && sends && !flight.is_crc {
            self.tx_crc = self.crc(self.tx_crc, travels);
        }
        if self.sends_only() {
            return;
        }
        let came = match (answer, frame.miso) {
            (_, None) => 0,
            (Some(bits), Some(_)) => bits & u32::from(self.mask()),
            (None, Some(pin)) => u32::from(if cx.pads.level(pin) { self.mask() } else { 0 }),
        };
        let received = self.ordered(came as u16) as u16;
        if self.cr1 & CRCEN != 0 {
            if !flight.is_crc {
                self.rx_crc = self.crc(self.rx_crc, came);
            } else if received != self.rx_crc {
                self.sr |= CRCERR;
            }
        }
        if self.sr & RXNE != 0 {
            // The unread data stays, and the new data is lost (RM0090 28.3.10).
            self.sr |= OVR;
            self.overrun_read = false;
        } else {
            self.rx = received;
            self.sr |= RXNE;
        }
    }

    pub(super) fn drop_flight(&mut self) {
        self.flight = None;
        self.due = NEVER;
        self.sr &= !BSY;
    }
}
