//! The controller's side of the SPI: frames of any length, in any mode, at any rate.
//!
//! The chip uses mode 1 and whole bytes (DS13541, SPI interface: idle low, both sides sample on the falling edge).
//! Another polarity or phase shifts bits, and an incomplete byte is lost.

use super::Chip;
use crate::report::Kind;

/// An SPI mode: the polarity and phase of the clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpiMode {
    /// The clock is idle low, and bits are sampled on its first edge.
    Mode0,
    /// The clock is idle low, and bits are sampled on its second edge; this is the chip's own mode.
    Mode1,
    /// The clock is idle high, and bits are sampled on its first edge.
    Mode2,
    /// The clock is idle high, and bits are sampled on its second edge.
    Mode3,
}

/// A frame of bits that an SPI controller clocks without a pause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpiFrame {
    /// The instant of the frame's first clock edge, virtual ns.
    pub begins_ns: u64,
    /// The instant at which the frame's last bit ends, virtual ns.
    pub ends_ns: u64,
    /// Polarity and phase of the clock.
    pub mode: SpiMode,
    /// The number of bits in the frame, 1 to 32.
    pub bits: u8,
    /// The bits on MOSI, as the low `bits` bits of this value, the most significant first.
    pub mosi: u32,
}

impl Chip {
    /// Transfers a frame and returns the bits on MISO, in the order of [`SpiFrame::mosi`]. `each` is called for every
    /// whole byte. Its arguments are the chip, the instant at which the eighth clock ended (virtual ns), the byte to
    /// the chip, and the byte from the chip.
    ///
    /// The frame also sets the controller's clock rate, as [`Chip::spi_clock_hz`] does.
    pub fn clock_frame(&mut self, frame: &SpiFrame, mut each: impl FnMut(&mut Self, u64, u8, u8)) -> u32 {
        let SpiFrame { begins_ns, ends_ns, mode, mosi, .. } = *frame;
        let (bits, span) = (u64::from(frame.bits.max(1)), ends_ns.saturating_sub(begins_ns));
        self.spi.took(frame.bits, span);
        if bits == 8 && mode == SpiMode::Mode1 {
            // A whole byte in the chip's own SPI mode, the usual case, need not be transferred bit by bit.
            let miso = self.transfer(ends_ns, mosi as u8);
            each(self, ends_ns, mosi as u8, miso);
            return u32::from(miso);
        }
        if mode != SpiMode::Mode1 {
            self.advance(begins_ns);
            self.core.note(Kind::WrongSpiMode(mode as u8));
        }
        let sent = |bit: u64| mosi >> (bits - 1 - bit) & 1 != 0;
        let (mut answer, mut last, mut bit) = (0_u32, self.last_bits, 0);
        while bit < bits {
            let many = (bits - bit).min(8);
            let mut byte = 0_u8;
            for nth in bit..bit + many {
                // In mode 3 MOSI changes on the edge on which the chip samples, so the chip reads the previous bit.
                let seen = if mode == SpiMode::Mode3 { std::mem::replace(&mut last.0, sent(nth)) } else { sent(nth) };
                byte = byte << 1 | u8::from(seen);
            }
            bit += many;
            let at = begins_ns + span * bit / bits;
            if many < 8 {
                // An incomplete byte is lost when chip select rises.
                self.advance(at);
                self.core.note(Kind::BitsLost(many as u8));
                answer <<= many;
                break;
            }
            let miso = self.transfer(at, byte);
            each(self, at, byte, miso);
            for nth in (0..8).rev() {
                let driven = miso >> nth & 1 != 0;
                // The chip changes MISO on the rising edge. A controller that samples on that edge (modes 0 and 3), or
                // on the falling edge before it (mode 2), reads the previous bit.
                let read = if mode == SpiMode::Mode1 { driven } else { std::mem::replace(&mut last.1, driven) };
                answer = answer << 1 | u32::from(read);
            }
        }
        self.last_bits = last;
        answer
    }

    /// Sets the controller's SPI clock, Hz, for the instants of the IRQ pin. Above 10 MHz transfers are findings.
    pub fn spi_clock_hz(&mut self, hz: u32) {
        self.spi.set_hz(hz);
    }
}
