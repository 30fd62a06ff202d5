//! The SPI slave's state: chip select, the meaning and the output of the next byte, and the controller's clock.
//!
//! The instant of a byte's first clock edge follows from the clock rate: it is eight periods before the byte's end (SPI
//! mode 1; the last edge is half a period before the end). If the rate is not known, 10 MHz is assumed, the part's
//! highest: the first edge of a slower clock lies earlier, so the IRQ pin may have fallen earlier than the instant
//! given.

use crate::report::Space;

/// The part's highest SPI clock, Hz, which is assumed where the controller's rate is unknown.
pub(crate) const MAX_HZ: u32 = 10_000_000;
/// The number of SPI clock periods from a byte's first rising edge to its end.
const PERIODS: u64 = 8;

/// The meaning of the next byte of a transfer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum State {
    /// The next byte is a mode byte.
    #[default]
    Mode,
    /// A prefix was received: the next byte is the mode byte of a register access in the given space.
    Prefix(Space),
    /// The address of a register write was received; the next byte is the first value.
    WriteFirst(Space, u8),
    Write(Space, u8),
    Read(Space, u8),
    Load,
    /// The FIFO is being read; the flag is true when the FIFO had a byte to shift out.
    ReadFifo(bool),
    LoadTarget(u8),
    ReadTarget(u8),
    /// The rest of the transfer is ignored.
    Ignore,
}

/// The SPI slave.
#[derive(Clone, Debug, Default)]
pub(crate) struct Spi {
    pub(crate) selected: bool,
    pub(crate) state: State,
    /// The byte that the slave shifts out next.
    pub(crate) out: u8,
    /// Whether a transmit command (C4 to C7) has come in the present transfer.
    pub(crate) commanded: bool,
    /// When the last byte ended, or when chip select fell if no byte has followed, ns.
    pub(crate) last_byte: u64,
    /// The rate of the controller's SPI clock, Hz; 0 when it is unknown.
    hz: u32,
    /// The number of bits and the duration (ns) of the last frame from which the clock rate was derived; an equal frame
    /// has the same rate.
    span: (u8, u64),
}

impl Spi {
    /// Resets the slave when the supply goes off. The clock rate is kept, because it is the controller's.
    pub(crate) fn power_off(&mut self) {
        *self = Self { hz: self.hz, span: self.span, ..Self::default() };
    }

    /// The rate of the controller's SPI clock, Hz; 0 when it is unknown.
    pub(crate) fn hz(&self) -> u32 {
        self.hz
    }

    pub(crate) fn set_hz(&mut self, hz: u32) {
        self.hz = hz;
    }

    /// Derives the SPI clock rate from a frame of `bits` bits that took `ns`. A change of at most one percent is
    /// ignored.
    pub(crate) fn took(&mut self, bits: u8, ns: u64) {
        if self.span == (bits, ns) {
            return;
        }
        self.span = (bits, ns);
        let hz = u32::try_from(u64::from(bits.max(1)) * 1_000_000_000 / ns.max(1)).unwrap_or(u32::MAX);
        if hz.abs_diff(self.hz) > self.hz / 100 {
            self.hz = hz;
        }
    }

    /// Returns the instant that is `fall_ns` after the first rising clock edge of the byte that ends at `now`, ns.
    pub(crate) fn after_first_edge(&self, now: u64, fall_ns: u64) -> u64 {
        let hz = u64::from(if self.hz == 0 { MAX_HZ } else { self.hz });
        let before_end = (PERIODS * 1_000_000_000 / hz).saturating_sub(fall_ns);
        // Even with a wrong clock rate, the result must not lie before the end of the previous byte.
        now.saturating_sub(before_end).max(self.last_byte).min(now)
    }
}
