//! What happens on the air, as events: the carrier and the frames on it.
//!
//! A frame is a start, further bytes if it grows while it is sent, and an end, each with its instant in virtual ns.

use crate::clock::{bits_in, bits_ns};

/// How a frame is coded and modulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Technology {
    /// ISO 14443-A.
    NfcA,
    /// NFC-F (FeliCa).
    NfcF,
}

/// Bytes on the air, in order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Chunk {
    /// The bytes as they are received. NFC-F: LEN, payload, CRC-16.
    pub data: Vec<u8>,
    /// Whether a parity bit among them is wrong (NFC-A only).
    pub parity_error: bool,
}

/// A frame begins: the event's instant is its first preamble bit (NFC-F) or its start of communication (NFC-A).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameStart {
    /// Coding.
    pub technology: Technology,
    /// Nominal bit rate, bit/s.
    pub bits_per_second: u32,
    /// One bit on this transmitter's crystal, attoseconds (10⁻¹⁸ s).
    pub bit_as: u64,
    /// Bits before the first data bit.
    pub header_bits: u32,
    /// Bits a byte takes: 8, or 9 with parity.
    pub byte_bits: u32,
    /// True for a listener's load modulation: an answer.
    pub load_modulation: bool,
    /// What is known of the frame when it starts; usually all of it.
    pub chunk: Chunk,
}

impl FrameStart {
    /// From the frame's first bit to the first bit of its byte `i`, ns.
    pub(crate) fn until_byte(&self, i: usize) -> u64 {
        self.until_bit(8 * i as u64)
    }

    /// From the frame's first bit to its data bit `bit`, counted in the order of the air, ns.
    pub(crate) fn until_bit(&self, bit: u64) -> u64 {
        let air = u64::from(self.header_bits) + bit / 8 * u64::from(self.byte_bits) + bit % 8;
        bits_ns(air, self.bit_as)
    }

    /// Data bits that have passed `ns` after the frame's first bit.
    pub(crate) fn data_bits_in(&self, ns: u64) -> u64 {
        let air = bits_in(ns, self.bit_as).saturating_sub(u64::from(self.header_bits));
        let per = u64::from(self.byte_bits.max(1));
        air / per * 8 + (air % per).min(8)
    }
}

/// What happens on the air.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AirEvent {
    /// The emitter's carrier is on.
    FieldOn,
    /// The emitter's carrier is off.
    FieldOff,
    /// A frame begins.
    FrameStart(FrameStart),
    /// More of the frame that is on the air, before its bytes are due.
    Bytes(Chunk),
    /// The frame ends; the event's instant is the end of its last bit.
    FrameEnd {
        /// Data bits after the header, parity bits not counted. Fewer than the bytes announced when the frame broke
        /// off.
        bits: u32,
    },
}
