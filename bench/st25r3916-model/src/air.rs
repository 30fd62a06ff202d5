//! The air between a poller and a listener.
use crate::Chip;

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
    /// The bytes as they would be received.
    pub data: Vec<u8>,
    /// Whether a parity bit among them is wrong (NFC-A only).
    pub parity_error: bool,
}

/// A frame begins: the event's instant is its first preamble bit (NFC-F) or start of communication (NFC-A).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameStart {
    /// Coding.
    pub technology: Technology,
    /// Nominal bit rate, bit/s.
    pub bits_per_second: u32,
    /// One bit on this transmitter's crystal, attoseconds.
    pub bit_as: u64,
    /// Bits before the first data bit.
    pub header_bits: u32,
    /// True for a listener's load modulation: an answer.
    pub load_modulation: bool,
    /// What is known of the frame when it starts.
    pub chunk: Chunk,
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
    /// More of the frame that is on the air.
    Bytes(Chunk),
    /// The frame ends; the event's instant is the end of its last bit.
    FrameEnd {
        /// Data bits after the header, parity bits not counted.
        bits: u32,
    },
}

/// What the air does to frames; each in 0..=1. The default is clean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// Probability that a data bit is inverted.
    pub bit_error: f64,
    /// Probability that a frame is not heard at all.
    pub lost: f64,
    /// Probability that a frame breaks off at a random byte.
    pub truncated: f64,
}

/// What the air has carried.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Frames the poller sent.
    pub sent: u64,
    /// Frames that reached the listener whole and unchanged.
    pub delivered: u64,
    /// Frames that reached it changed or cut short.
    pub damaged: u64,
    /// Frames that did not reach it.
    pub lost: u64,
    /// Frames the listener sent: load modulation, an answer.
    pub answers: u64,
}

/// The last whole frame of the poller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LastFrame {
    /// First bit on the air, ns.
    pub start_ns: u64,
    /// End of the last bit, ns.
    pub end_ns: u64,
    /// Nominal bit rate, bit/s.
    pub bits_per_second: u32,
}

/// The air between one poller and one listener.
#[derive(Clone, Debug)]
pub struct Air {
    counters: Counters,
    last: Option<LastFrame>,
}

impl Air {
    /// The air with these faults, reproducible from `seed`.
    pub fn new(_seed: u64, _faults: Faults) -> Self {
        Self {
            counters: Counters::default(),
            last: None,
        }
    }
    /// Moves what each chip emitted to the other. Call it whenever either may have emitted something (after `advance` or `transfer`).
    pub fn carry(&mut self, _poller: &mut Chip, _listener: &mut Chip) {}
    /// What was carried so far.
    pub fn counters(&self) -> Counters {
        self.counters
    }
    /// The last whole frame of the poller.
    pub fn last_frame(&self) -> Option<LastFrame> {
        self.last
    }
}
