//! The air between a poller and a listener: who hears what, when, and how damaged.
//!
//! | covered | source |
//! |---|---|
//! | field coupling, both ways | the two antennas face each other |
//! | frames by event: start, further bytes, end; each with its instant | [`crate::Chip`] emits them |
//! | seeded faults of the poller's frames: inverted data bits, a | the fault model of the link's tests; a hit in |
//! | lost frame, a frame that breaks off | the sync loses the frame |
//!
//! | left out | why |
//! |---|---|
//! | propagation time | 1 ns at 30 cm |
//! | faults of answers | the link has none: an answer is counted, and is a violation to its user |
//! | bursts and their correlation | a burst is a truncation or several bit errors here; objects have their own CRCs |

use crate::Chip;
use crate::clock::bits_ns;
use crate::rng::SplitMix;

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

/// What the air does to the poller's frames; each a probability, 0 to 1. The default is clean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// That a bit, of the sync or of the data, is inverted.
    pub bit_error: f64,
    /// That a frame is not heard at all.
    pub lost: f64,
    /// That a frame breaks off after a random number of its bytes.
    pub truncated: f64,
}

/// What the air has carried from poller to listener. A frame is in exactly one of delivered, damaged, lost once it has
/// ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Frames the poller began.
    pub sent: u64,
    /// Frames that reached the listener whole and unchanged.
    pub delivered: u64,
    /// Frames that reached it changed or cut short.
    pub damaged: u64,
    /// Frames that did not reach it.
    pub lost: u64,
    /// Bits inverted.
    pub bit_errors: u64,
    /// Frames the listener sent: load modulation, an answer.
    pub answers: u64,
}

/// The last frame of the poller that ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LastFrame {
    /// First bit on the air, ns.
    pub start_ns: u64,
    /// End of the last bit, ns.
    pub end_ns: u64,
    /// Nominal bit rate, bit/s.
    pub bits_per_second: u32,
    /// Data bits: LEN, payload and CRC of NFC-F.
    pub data_bits: u32,
}

/// What becomes of the frame that is on the air.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    Whole,
    Damaged,
    /// Cut after so many bytes; the end has been told.
    Cut,
    Lost,
}

#[derive(Clone, Copy, Debug)]
struct Passing {
    start_ns: u64,
    bits_per_second: u32,
    /// Bytes the poller has announced, whatever became of them on the way.
    announced: usize,
    fate: Fate,
}

/// The air between one poller and one listener.
#[derive(Clone, Debug)]
pub struct Air {
    faults: Faults,
    rng: SplitMix,
    passing: Option<Passing>,
    counters: Counters,
    last: Option<LastFrame>,
}

impl Air {
    /// The air with these faults, reproducible from `seed`.
    pub fn new(seed: u64, faults: Faults) -> Self {
        Self { faults, rng: SplitMix::new(seed), passing: None, counters: Counters::default(), last: None }
    }

    /// Changes the faults; the frame on the air keeps its fate.
    pub fn set_faults(&mut self, faults: Faults) {
        self.faults = faults;
    }

    /// Moves what each chip has emitted to the other, until both are silent. Call it when either
    /// [`has_air`](Chip::has_air).
    pub fn carry(&mut self, poller: &mut Chip, listener: &mut Chip) {
        while poller.has_air() || listener.has_air() {
            for (at, event) in poller.take_air() {
                self.from_poller(at, event, |at, event| listener.hear(at, event));
            }
            for (at, event) in listener.take_air() {
                self.from_listener(at, &event);
                poller.hear(at, &event);
            }
        }
    }

    /// What the poller emitted, for who owns the chips apart: `hears` gets what the listener hears.
    pub fn from_poller(&mut self, at: u64, event: AirEvent, mut hears: impl FnMut(u64, &AirEvent)) {
        match event {
            AirEvent::FieldOn | AirEvent::FieldOff => hears(at, &event),
            AirEvent::FrameStart(mut frame) => {
                self.counters.sent += 1;
                let announced = frame.chunk.data.len();
                let fate = self.fate(&mut frame);
                let bits_per_second = frame.bits_per_second;
                self.passing = Some(Passing { start_ns: at, bits_per_second, announced, fate });
                if fate == Fate::Lost {
                    return;
                }
                let cut_end = (fate == Fate::Cut).then(|| {
                    let bytes = frame.chunk.data.len() as u64;
                    let bits = u64::from(frame.header_bits) + bytes * u64::from(frame.byte_bits);
                    (at.saturating_add(bits_ns(bits, frame.bit_as)), 8 * bytes as u32)
                });
                hears(at, &AirEvent::FrameStart(frame));
                if let Some((end, bits)) = cut_end {
                    hears(end, &AirEvent::FrameEnd { bits });
                }
            }
            AirEvent::Bytes(mut chunk) => {
                if let Some(p) = &mut self.passing {
                    p.announced += chunk.data.len();
                }
                if !self.passing.is_some_and(|p| matches!(p.fate, Fate::Whole | Fate::Damaged)) {
                    return;
                }
                if self.invert(&mut chunk)
                    && let Some(p) = &mut self.passing
                {
                    p.fate = Fate::Damaged;
                }
                hears(at, &AirEvent::Bytes(chunk));
            }
            AirEvent::FrameEnd { bits } => {
                let Some(p) = self.passing.take() else { return };
                self.last = Some(LastFrame {
                    start_ns: p.start_ns,
                    end_ns: at,
                    bits_per_second: p.bits_per_second,
                    data_bits: bits,
                });
                // A poller that breaks off says so by an end before the bytes it has announced.
                let cut = (bits.div_ceil(8) as usize) < p.announced;
                match p.fate {
                    Fate::Whole if cut => self.counters.damaged += 1,
                    Fate::Whole => self.counters.delivered += 1,
                    Fate::Damaged | Fate::Cut => self.counters.damaged += 1,
                    Fate::Lost => self.counters.lost += 1,
                }
                if matches!(p.fate, Fate::Whole | Fate::Damaged) {
                    hears(at, &event);
                }
            }
        }
    }

    /// What the listener emitted, for who owns the chips apart; the poller hears it unchanged.
    pub fn from_listener(&mut self, _at: u64, event: &AirEvent) {
        if matches!(event, AirEvent::FrameStart(_)) {
            self.counters.answers += 1;
        }
    }

    /// What was carried so far.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// The first bit of the frame that is on the air, ns.
    pub fn frame_on_air(&self) -> Option<u64> {
        self.passing.map(|p| p.start_ns)
    }

    /// The last frame of the poller that ended.
    pub fn last_frame(&self) -> Option<LastFrame> {
        self.last
    }

    fn fate(&mut self, frame: &mut FrameStart) -> Fate {
        if self.rng.hit(self.faults.lost) {
            return Fate::Lost;
        }
        // Any error in the 16 bits of the sync and the receiver does not see a frame.
        if self.faults.bit_error > 0.0 && frame.technology == Technology::NfcF {
            let mut hit = 0;
            for _ in 0..16 {
                hit += u64::from(self.rng.hit(self.faults.bit_error));
            }
            self.counters.bit_errors += hit;
            if hit != 0 {
                return Fate::Lost;
            }
        }
        let mut fate = if self.invert(&mut frame.chunk) { Fate::Damaged } else { Fate::Whole };
        if self.rng.hit(self.faults.truncated) {
            let n = frame.chunk.data.len();
            frame.chunk.data.truncate(self.rng.below(n));
            fate = Fate::Cut;
        }
        fate
    }

    /// Inverts bits; true when any was.
    fn invert(&mut self, chunk: &mut Chunk) -> bool {
        if self.faults.bit_error <= 0.0 {
            return false;
        }
        let mut any = false;
        for byte in &mut chunk.data {
            let mut flips = 0u8;
            for bit in 0..8 {
                if self.rng.hit(self.faults.bit_error) {
                    flips |= 1 << bit;
                    self.counters.bit_errors += 1;
                }
            }
            *byte ^= flips;
            any |= flips != 0;
            chunk.parity_error |= flips.count_ones() % 2 == 1;
        }
        any
    }
}
