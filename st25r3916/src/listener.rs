//! The listener: receives NFC-F frames, never answers.

use crate::machine::{Fault, Input, Step};
use crate::{Supply, Variant};

/// Bytes the caller's receive buffer must have: LEN (one byte, ≤ 255) counts itself and the
/// payload; the CRC-16 follows.
pub const BUFFER: usize = 257;
/// Where the payload starts in the receive buffer; the byte before it is LEN.
pub const PAYLOAD_OFFSET: usize = 1;

/// When a listener reads the FIFO.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ReadMode {
    /// After the frame's end (I_rxe), all at once.
    StoreAndForward,
    /// While the frame arrives, at instants computed from the bit rate and the frame's own LEN, so
    /// that few bytes are left when it ends.
    #[default]
    WhileFilling,
}

/// How a listener is brought up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ListenerConfig {
    /// The chip's supply voltage.
    pub supply: Supply,
    /// When the FIFO is read.
    pub read_mode: ReadMode,
    /// With nothing on air, the chip is checked this often, in microseconds.
    pub supervision_micros: u32,
}

impl ListenerConfig {
    /// 5 V supply, reads while the frame arrives, checks an idle chip every 100 ms.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            supply: Supply::Volts5,
            read_mode: ReadMode::WhileFilling,
            supervision_micros: 100_000,
        }
    }
}

impl Default for ListenerConfig {
    fn default() -> Self {
        Self::new()
    }
}

/// What the chip said about a frame. None of it rejects a frame by itself: the payload carries
/// its own checks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FrameFlags(u8);

impl FrameFlags {
    /// I_crc: the frame's CRC-16 is wrong, or the interrupt was read late.
    pub const CRC: Self = Self(0x01);
    /// I_par, I_err1 or I_err2: parity or framing error.
    pub const FRAMING: Self = Self(0x02);
    /// The FIFO ran over.
    pub const OVERFLOW: Self = Self(0x04);
    /// The FIFO was read beyond its content.
    pub const UNDERFLOW: Self = Self(0x08);
    /// LEN does not agree with the number of bytes received.
    pub const LENGTH: Self = Self(0x10);
    /// The last byte is not whole.
    pub const PARTIAL: Self = Self(0x20);

    /// No flag at all.
    #[must_use]
    pub const fn empty() -> Self {
        Self(0)
    }

    /// Whether the chip found nothing wrong.
    #[must_use]
    pub const fn is_clean(self) -> bool {
        self.0 == 0
    }

    /// Whether every flag of `other` is set.
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Both sets together.
    #[must_use]
    pub const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// The bits as above, for a log or a counter.
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.0
    }
}

/// Why a frame that began is not delivered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Dropped {
    /// I_rxs, but no I_rxe within [`crate::FRAME_MICROS`].
    NoEnd,
    /// The field went off under it.
    FieldLost,
    /// Too short to hold LEN, one payload byte and the CRC-16.
    Runt,
    /// Longer than LEN can say.
    TooLong,
    /// Another frame began before this one was read.
    Overrun,
}

/// What a listener reports. The frame buffer may be swapped by the caller on any event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ListenerEvent {
    /// The chip is configured, checked and listens.
    Listening,
    /// A frame is in the buffer: `buffer[1..1 + len]` is its payload. Given before the chip is
    /// re-armed: [`Input::Start`] re-arms it.
    Frame {
        /// Payload length in bytes, 1..=254, from the number of bytes received.
        len: usize,
        /// What the chip said about it.
        flags: FrameFlags,
    },
    /// A frame began but is not delivered.
    Dropped(Dropped),
    /// The poller's field is there.
    FieldOn,
    /// The poller's field is gone.
    FieldOff,
    /// The chip is lost; [`Input::Start`] brings it up again.
    Fault(Fault),
}

/// The listener machine.
#[derive(Clone, Debug)]
pub struct Listener {
    config: ListenerConfig,
    variant: Option<Variant>,
}

impl Listener {
    /// A listener that has not spoken to its chip yet. The first [`Input::Start`] begins bring-up.
    #[must_use]
    pub const fn new(config: ListenerConfig) -> Self {
        Self {
            config,
            variant: None,
        }
    }

    /// Which part answered the last bring-up.
    #[must_use]
    pub const fn variant(&self) -> Option<Variant> {
        self.variant
    }

    /// Takes one input, gives the next step.
    pub fn step(&mut self, input: Input<'_>) -> Step<ListenerEvent> {
        let _ = (input, self.config);
        Step::Delay { micros: 1000 }
    }
}
