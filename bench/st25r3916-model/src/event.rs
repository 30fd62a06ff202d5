//! The events on the air: the carrier and its frames.
//!
//! A frame is a start event, events with further bytes if the sender does not know all bytes at the start, and an end
//! event. Each event has its instant in virtual ns.

use crate::clock::{bits_in, bits_ns};

/// The coding and modulation of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Technology {
    /// NFC-A, which is ISO 14443-A.
    NfcA,
    /// NFC-F (FeliCa).
    NfcF,
}

/// Bytes on the air, in order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Chunk {
    /// The chunk's bytes in their order on the air. In NFC-F a frame begins with LEN and ends with a CRC-16.
    pub data: Vec<u8>,
    /// Whether a parity bit of the chunk's bytes is wrong (NFC-A only).
    pub parity_error: bool,
}

/// The start of a frame, at its first preamble bit (NFC-F) or its start of communication (NFC-A).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameStart {
    /// The coding and modulation of the frame.
    pub technology: Technology,
    /// The frame's nominal bit rate, bit/s.
    pub bits_per_second: u32,
    /// The duration of a bit by the sender's crystal, attoseconds (10⁻¹⁸ s).
    pub bit_as: u64,
    /// The number of bits on the air before the frame's first data bit.
    pub header_bits: u32,
    /// The number of bits on the air for each byte: 8, or 9 with parity.
    pub byte_bits: u32,
    /// Whether the frame is an answer, which a listener sends by load modulation.
    pub load_modulation: bool,
    /// The bytes of the frame that are known at its start, usually all.
    pub chunk: Chunk,
}

impl FrameStart {
    pub(crate) fn until_byte(&self, i: usize) -> u64 {
        self.until_bit(8 * i as u64)
    }

    pub(crate) fn until_bit(&self, bit: u64) -> u64 {
        let air = u64::from(self.header_bits) + bit / 8 * u64::from(self.byte_bits) + bit % 8;
        bits_ns(air, self.bit_as)
    }

    pub(crate) fn data_bits_in(&self, ns: u64) -> u64 {
        let air = bits_in(ns, self.bit_as).saturating_sub(u64::from(self.header_bits));
        let per = u64::from(self.byte_bits.max(1));
        air / per * 8 + (air % per).min(8)
    }
}

/// An event on the air.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AirEvent {
    /// The emitting chip has switched its carrier on.
    FieldOn,
    /// The emitting chip has switched its carrier off.
    FieldOff,
    /// A frame begins.
    FrameStart(FrameStart),
    /// The frame goes on with these bytes. The event comes no later than their first bit.
    Bytes(Chunk),
    /// The frame ends. The instant of the event is the end of the last bit.
    FrameEnd {
        /// The number of data bits after the header, without parity bits. A frame that broke off has fewer than
        /// announced.
        bits: u32,
    },
}
