//! Driver for ST's ST25R3916 and ST25R3916B NFC front ends: NFC-F poller and listener
#![no_std]
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

pub mod blocking;
mod bring_up;
pub mod command;
pub mod listener;
mod machine;
pub mod poller;
pub mod register;
mod status;

pub use listener::{Dropped, FrameFlags, Listener, ListenerConfig, ListenerCounters, ListenerEvent, ReadMode};
pub use machine::{Fault, Input, Short, Step, Transfer};
pub use poller::{Poller, PollerConfig, PollerCounters, PollerEvent, Receiver, SendError};

/// The longest wait for a stable oscillator, in microseconds (typically 0.7 ms).
pub const OSCILLATOR_MICROS: u32 = 10_000;
/// The longest wait for the regulator adjustment, in microseconds (at most 5 ms in the data
/// sheet).
pub const REGULATOR_MICROS: u32 = 6_000;
/// The longest time from a frame's sync (I_rxs) to its end (I_rxe), in microseconds: 257 bytes
/// take 4.852 ms.
pub const FRAME_MICROS: u32 = 6_000;

/// Which part answered, from its identity register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Variant {
    /// ST25R3916.
    A,
    /// ST25R3916B.
    B,
}

/// The chip's supply voltage (VDD).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Supply {
    /// 4.1 V to 5.5 V.
    #[default]
    Volts5,
    /// 2.4 V to 3.6 V: sets `sup3V`.
    Volts3,
}

/// The air time of a frame at 424 kbit/s, first preamble bit to last CRC bit, in nanoseconds,
/// rounded up.
///
/// 48 bits of preamble, 16 of sync, then LEN, `payload` bytes and CRC-16; a bit is 32 carrier
/// periods of 13.56 MHz. 244 bytes: 4.814 ms; 254 bytes: 5.003 ms.
#[must_use]
pub const fn air_time_ns(payload: usize) -> u64 {
    let bits = 64 + 8 * (payload as u64 + 3);
    (bits * 32 * 100_000).div_ceil(1_356)
}
