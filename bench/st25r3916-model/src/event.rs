//! The events on the air: the carrier and its frames.
//!
//! A frame is a start, further bytes if it grows while it is sent, and an end, each with its instant in virtual ns.

use crate::clock::{bits_in, bits_ns};

/// The coding and modulation of a frame.
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
    /// Bits that a byte takes: 8, or 9 with parity.
    pub byte_bits: u32,
    /// True for a listener's load modulation: an answer.
    pub load_modulation: bool,
    /// The part of the frame that is known when it starts; usually all of it.
    pub chunk: Chunk,
}

impl FrameStart {
    /// The time from the frame's first bit to the first bit of its byte `i`, ns.
    pub(crate) fn until_byte(&self, i: usize) -> u64 {
        self.until_bit(8 * i as u64)
    }

    /// The time from the frame's first bit to its data bit `bit`, counted in the order of the air, ns.
    pub(crate) fn until_bit(&self, bit: u64) -> u64 {
        let air = u64::from(self.header_bits) + bit / 8 * u64::from(self.byte_bits) + bit % 8;
        bits_ns(air, self.bit_as)
    }

    /// The number of data bits that have passed `ns` after the frame's first bit.
    pub(crate) fn data_bits_in(&self, ns: u64) -> u64 {
        let air = bits_in(ns, self.bit_as).saturating_sub(u64::from(self.header_bits));
        let per = u64::from(self.byte_bits.max(1));
        air / per * 8 + (air % per).min(8)
    }
}

/// An event on the air.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AirEvent {
    /// The emitter's carrier is on.
    FieldOn,
    /// The emitter's carrier is off.
    FieldOff,
    /// A frame begins.
    FrameStart(FrameStart),
    /// More bytes of the frame on the air, before they are due.
    Bytes(Chunk),
    /// The frame ends; the event's instant is the end of its last bit.
    FrameEnd {
        /// Data bits after the header, without parity bits. They are fewer than the announced bytes when the frame
        /// broke off.
        bits: u32,
    },
}
