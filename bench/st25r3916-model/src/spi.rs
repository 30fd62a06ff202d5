//! The state of the SPI slave.
//!
//! The first clock edge of a byte is eight clock periods before the byte's end. An unknown clock rate is taken as 10
//! MHz, the chip's highest. With a slower clock, silicon's IRQ pin falls earlier than the model's.

use crate::report::Space;

pub(crate) const MAX_HZ: u32 = 10_000_000;
/// The clock periods from a byte's first rising edge to its end.
const PERIODS: u64 = 8;

/// The meaning of the next byte of a transfer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum State {
    #[default]
    Mode,
    /// A prefix has come. The next byte is the mode byte of a register access in this space.
    Prefix(Space),
    /// The address of a register write has come, and the next byte is the first value.
    WriteFirst(Space, u8),
    Write(Space, u8),
    Read(Space, u8),
    Load,
    /// The FIFO is being read. The field says whether it had a byte to shift out.
    ReadFifo(bool),
    LoadTarget(u8),
    ReadTarget(u8),
    /// Further bytes of the transfer are ignored.
    Ignore,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Spi {
    pub(crate) selected: bool,
    pub(crate) state: State,
    pub(crate) out: u8,
    /// Whether this transfer contained a transmit command (C4 to C7).
    pub(crate) commanded: bool,
    /// The instant at which the last byte ended, or chip select fell, ns.
    pub(crate) last_byte: u64,
    /// The rate of the controller's clock, Hz; 0 if it is unknown.
    hz: u32,
    /// The bits and the duration (ns) of the frame that gave the clock rate. An equal frame gives the same rate.
    span: (u8, u64),
}

impl Spi {
    /// Resets the slave without a supply. The clock rate stays, because it is the controller's.
    pub(crate) fn power_off(&mut self) {
        *self = Self { hz: self.hz, span: self.span, ..Self::default() };
    }

    pub(crate) fn hz(&self) -> u32 {
        self.hz
    }

    pub(crate) fn set_hz(&mut self, hz: u32) {
        self.hz = hz;
    }

    /// Calculates the clock rate from a frame of `bits` bits that took `ns`. Changes of up to one percent are ignored.
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

    /// Returns the instant `fall_ns` after the first rising clock edge of the byte that ends at `now`, ns.
    pub(crate) fn after_first_edge(&self, now: u64, fall_ns: u64) -> u64 {
        let hz = u64::from(if self.hz == 0 { MAX_HZ } else { self.hz });
        let before_end = (PERIODS * 1_000_000_000 / hz).saturating_sub(fall_ns);
        // The instant is not before the end of the previous byte, even with a wrong clock rate.
        now.saturating_sub(before_end).max(self.last_byte).min(now)
    }
}
