//! The SPI slave's state: chip select, the meaning and the output of the next byte, and the controller's clock.
//!
//! The first clock edge of a byte follows from the clock's rate: it is eight periods before the byte's end (SPI mode 1;
//! the last edge is half a period before the end). If the rate is not known, it is taken as 10 MHz, the part's highest:
//! the IRQ pin has then fallen by the instant given, perhaps earlier.

use crate::report::Space;

/// The part's highest SPI clock, Hz, which is assumed where the controller's rate is unknown.
pub(crate) const MAX_HZ: u32 = 10_000_000;
/// Periods of the SPI clock from a byte's first rising edge to its end.
const PERIODS: u64 = 8;

/// The meaning of the next byte of a transfer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum State {
    /// The next byte is a mode byte.
    #[default]
    Mode,
    /// A prefix came: the next byte is a register mode byte of that space.
    Prefix(Space),
    /// A write's address came, but not its first value.
    WriteFirst(Space, u8),
    Write(Space, u8),
    Read(Space, u8),
    Load,
    /// The value is true when a byte was available for output.
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
    /// The output of the next byte.
    pub(crate) out: u8,
    /// Whether a transmit command came in this transfer.
    pub(crate) commanded: bool,
    /// End of the last byte, or the fall of chip select, ns.
    pub(crate) last_byte: u64,
    /// The controller's clock, Hz; 0 when it is unknown.
    hz: u32,
    /// Bits and length (ns) of the last frame that set the clock; an equal frame has the same clock.
    span: (u8, u64),
}

impl Spi {
    /// Resets the slave without a supply; the clock's rate remains, because it is the controller's.
    pub(crate) fn power_off(&mut self) {
        *self = Self { hz: self.hz, span: self.span, ..Self::default() };
    }

    /// The controller's clock, Hz; 0 when it is unknown.
    pub(crate) fn hz(&self) -> u32 {
        self.hz
    }

    pub(crate) fn set_hz(&mut self, hz: u32) {
        self.hz = hz;
    }

    /// Derives the clock, to a hundredth, from a frame of `bits` bits that took `ns`.
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

    /// The first rising clock edge of the byte that ends at `now`, plus `fall_ns`.
    pub(crate) fn after_first_edge(&self, now: u64, fall_ns: u64) -> u64 {
        let hz = u64::from(if self.hz == 0 { MAX_HZ } else { self.hz });
        let before_end = (PERIODS * 1_000_000_000 / hz).saturating_sub(fall_ns);
        // A wrong clock rate must not place the byte before the one that it follows.
        now.saturating_sub(before_end).max(self.last_byte).min(now)
    }
}
