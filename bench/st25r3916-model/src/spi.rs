//! The SPI slave's state: chip select, what the next byte means, what it shifts out, and the controller's clock.
//!
//! Which edge of the clock was a byte's first follows from the clock's rate: eight periods before the byte's end (SPI
//! mode 1; the last edge is half a period before the end). If the rate is not told, 10 MHz is taken, the part's
//! highest: the IRQ pin has then fallen by the instant given, perhaps earlier.

use crate::report::Space;

/// The part's highest SPI clock, Hz: assumed where the controller's rate was not told.
pub(crate) const MAX_HZ: u32 = 10_000_000;
/// Periods of the SPI clock from a byte's first rising edge to its end.
const PERIODS: u64 = 8;

/// What the next byte of a transfer means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum State {
    /// The next byte is a mode byte.
    #[default]
    Mode,
    /// A prefix came: the next byte is a register mode byte of that space.
    Prefix(Space),
    /// A write's address came, its first value has not.
    WriteFirst(Space, u8),
    Write(Space, u8),
    Read(Space, u8),
    Load,
    /// True when a byte was there to be shifted out.
    ReadFifo(bool),
    LoadTarget(u8),
    ReadTarget(u8),
    /// The rest of the transfer means nothing.
    Ignore,
}

/// The slave.
#[derive(Clone, Debug, Default)]
pub(crate) struct Spi {
    pub(crate) selected: bool,
    pub(crate) state: State,
    /// What the next byte shifts out.
    pub(crate) out: u8,
    /// A command to transmit came in this transfer.
    pub(crate) commanded: bool,
    /// End of the last byte, or the fall of chip select, ns.
    pub(crate) last_byte: u64,
    /// The controller's clock, Hz; 0 when it was not told.
    hz: u32,
    /// Bits and length (ns) of the last frame that told the clock: another of the same has the same.
    span: (u8, u64),
}

impl Spi {
    /// The supply is gone; the clock's rate is the controller's.
    pub(crate) fn power_off(&mut self) {
        *self = Self { hz: self.hz, span: self.span, ..Self::default() };
    }

    /// The controller's clock, Hz; 0 when it was not told.
    pub(crate) fn hz(&self) -> u32 {
        self.hz
    }

    pub(crate) fn set_hz(&mut self, hz: u32) {
        self.hz = hz;
    }

    /// A frame of `bits` bits took `ns`: that tells the clock, to a hundredth.
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

    /// The first rising clock edge of the byte that ends at `now`, and `fall_ns` later.
    pub(crate) fn after_first_edge(&self, now: u64, fall_ns: u64) -> u64 {
        let hz = u64::from(if self.hz == 0 { MAX_HZ } else { self.hz });
        let before_end = (PERIODS * 1_000_000_000 / hz).saturating_sub(fall_ns);
        // A clock that was told wrongly cannot put the byte before the one it follows.
        now.saturating_sub(before_end).max(self.last_byte).min(now)
    }
}
