//! Finds a receiver's messages in the bytes of its line.
//!
//! This module is written from the u-blox 8 / M8 receiver description (UBX-13003221), chapter UBX Protocol, from
//! docs/design.md#validity, and from decision 15 (when a position is valid).

use std::f64::consts::PI;

use gnss_sim::ubx::{CLASS_ESF, CLASS_NAV, EsfIns, NavAtt, NavPvt, OVERHEAD, SYNC, checksum};
use profile::{ABSENT_F32, ABSENT_F64};

use crate::bounds;

/// The length of the longest message, bytes, that HORUS certainly receives; its buffer has 256 bytes.
const LONGEST: usize = 256;

/// The numbers of one message, and the status bits that follow from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct MessageContent {
    /// The status bits of a GPS object while the message is young enough.
    pub(super) status: u16,
    /// The numbers that a GPS object shows while the message is young enough, as bits. An invalid number is NaN.
    pub(super) values: [u64; 3],
    /// The numbers that the message itself states, valid or not, as bits.
    pub(super) raw: [u64; 3],
    /// The velocity and accuracy; `None` without a valid position.
    pub(super) motion: Option<Motion>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Motion {
    /// The velocity north, east and down, mm/s.
    pub(super) velocity: [i32; 3],
    /// The stated accuracies, horizontal and vertical, mm.
    pub(super) accuracy: [u32; 2],
}

impl Motion {
    /// Returns whether HORUS may use a position with this velocity and these accuracies. The speed must be at most 200
    /// m/s. The accuracies must be stated, at most 30 m horizontally and, except for a 2D fix, at most 50 m vertically
    /// (decision 15).
    fn is_credible(self, fix: u8) -> bool {
        let squares: i64 = self.velocity.iter().map(|axis| i64::from(*axis).pow(2)).sum();
        let limits = bounds::WORST_ACCURACY_MM;
        squares <= i64::from(bounds::FASTEST_MM_S).pow(2)
            && self
                .accuracy
                .iter()
                .zip(limits)
                .take(if fix == 2 { 1 } else { 2 })
                .all(|(stated, limit)| (1..=limit).contains(stated))
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// NAV-PVT, with latitude, longitude and altitude.
    Position,
    /// NAV-ATT, with pitch, yaw and roll.
    Attitude,
    /// ESF-INS, with the accelerations along x, y and z.
    Acceleration,
}

impl Kind {
    pub(super) const ALL: [Self; 3] = [Self::Position, Self::Attitude, Self::Acceleration];

    /// Returns the bits of a GPS object's status that follow from this kind of message.
    pub(super) const fn mask(self) -> u16 {
        match self {
            Self::Position => 0x0F | 1 << 4 | STALE,
            Self::Attitude => 1 << 5,
            Self::Acceleration => 1 << 6,
        }
    }

    /// Returns the status bit that calls the values of this kind of message valid.
    pub(super) const fn valid(self) -> u16 {
        match self {
            Self::Position => 1 << 4,
            Self::Attitude => 1 << 5,
            Self::Acceleration => 1 << 6,
        }
    }

    /// Returns the bits of the NaN that stands for an absent number of this kind of message.
    pub(super) const fn absent(self) -> u64 {
        match self {
            Self::Position => ABSENT_F64.to_bits(),
            Self::Attitude | Self::Acceleration => ABSENT_F32.to_bits() as u64,
        }
    }
}

/// The status bit of a solution that is older than the receiver's period allows.
pub(super) const STALE: u16 = 1 << 8;

/// A message with a right checksum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Message {
    /// The instant, ns, at which the message's first byte began.
    pub(super) begun: u64,
    /// The instant, ns, at which the message's last byte had arrived.
    pub(super) arrived: u64,
    /// Whether HORUS must have received the message. It need not if the line was disturbed or the bytes may belong to a
    /// longer message.
    pub(super) sure: bool,
    /// The kind, the time of week (ms) and the content; `None` for a kind that HORUS does not read.
    pub(super) said: Option<(Kind, u32, MessageContent)>,
}

#[derive(Clone, Copy, Debug)]
struct Crossing {
    from: u64,
    to: u64,
    clean: bool,
}

#[derive(Clone, Debug, Default)]
pub(super) struct Reader {
    /// The received bytes from the first one that may begin an incomplete message.
    bytes: Vec<u8>,
    crossings: Vec<Crossing>,
    /// The instant, ns, at which the last byte of the line had arrived.
    last: Option<u64>,
    /// The number of bytes at the beginning of `bytes` that HORUS may take for a part of an earlier, damaged message.
    /// HORUS may find messages that begin in these bytes late or not at all.
    doubtful: usize,
}

impl Reader {
    /// Processes `bytes`, of which the first begins at the instant `at`, ns, and each takes `byte_ns`. `clean` means
    /// that the line was undisturbed. Passes each message that ends within `bytes` to `found`.
    pub(super) fn feed(&mut self, at: u64, byte_ns: u64, bytes: &[u8], clean: bool, mut found: impl FnMut(Message)) {
        if self.last.is_some_and(|last| at > last + bounds::SILENCE_ENDS) {
            self.bytes.clear();
            self.crossings.clear();
            self.doubtful = 0;
        }
        let before = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        let crossing = |from| Crossing { from, to: from + byte_ns, clean };
        self.crossings.extend((0..bytes.len() as u64).map(|number| crossing(at + number * byte_ns)));

        self.last = self.crossings.last().map(|byte| byte.to).or(self.last);

        // If a message is incomplete or has a wrong length, HORUS may wait for an end that never comes.
        let (mut doubtful, mut waiting) = (self.doubtful, 0);
        let (mut open, mut start) = (None, 0);
        while let Some(rest) = self.bytes.get(start..).filter(|rest| !rest.is_empty()) {
            let claim = Claim::of(rest);
            let end = match claim {
                Claim::None => start + 1,
                Claim::Open(length) => {
                    open = open.or(Some(start));
                    waiting = waiting.max(start + length);
                    start + 1
                }
                Claim::Wrong(length) => {
                    doubtful = doubtful.max(start + length);
                    start + 1
                }
                Claim::Right(length) => start + length,
            };
            if let (Claim::Right(_), true) = (claim, end > before) {
                let crossings = &self.crossings[start..end];
                let flows = |pair: &[Crossing]| pair[1].from <= pair[0].to + bounds::SILENCE_MAY_END;
                let undisturbed = crossings.iter().all(|byte| byte.clean) && crossings.windows(2).all(flows);
                found(Message {
                    begun: crossings.first().map_or(at, |byte| byte.from),
                    arrived: crossings.last().map_or(at, |byte| byte.to),
                    sure: undisturbed && start >= doubtful.max(waiting),
                    said: said(&self.bytes[start..end]),
                });
            }
            start = end;
        }
        let done = open.unwrap_or(self.bytes.len());
        self.doubtful = if clean { doubtful } else { doubtful.max(self.bytes.len() + LONGEST) }.saturating_sub(done);
        self.bytes.drain(..done);
        self.crossings.drain(..done);
    }
}

/// What a string of bytes begins with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Claim {
    /// No message.
    None,
    /// The beginning of an incomplete message, which has at least this many bytes.
    Open(usize),
    /// A message of this many bytes that has a wrong checksum or is too long for HORUS. HORUS waits for the end of such
    /// a message.
    Wrong(usize),
    /// A complete message of this many bytes.
    Right(usize),
}

impl Claim {
    fn of(bytes: &[u8]) -> Self {
        let sync = bytes.iter().zip(SYNC).take_while(|(byte, sync)| **byte == *sync).count();
        match bytes {
            _ if sync < SYNC.len().min(bytes.len()) => Self::None,
            [_, _, _, _, low, high, ..] => {
                let length = usize::from(u16::from_le_bytes([*low, *high])) + OVERHEAD;
                match bytes.get(SYNC.len()..length) {
                    _ if length > LONGEST => Self::Wrong(LONGEST),
                    None => Self::Open(length),
                    Some(checked) => match checked.split_last_chunk::<2>() {
                        Some((covered, sum)) if checksum(covered) == *sum && checked[0] != 0 => Self::Right(length),
                        _ => Self::Wrong(length),
                    },
                }
            }
            _ => Self::Open(OVERHEAD),
        }
    }
}

fn said(message: &[u8]) -> Option<(Kind, u32, MessageContent)> {
    let (class, id) = (message[2], message[3]);
    let payload = &message[6..message.len() - 2];
    let unsigned = |at: usize| u32::from_le_bytes([payload[at], payload[at + 1], payload[at + 2], payload[at + 3]]);
    let signed = |at: usize| unsigned(at).cast_signed();
    match (class, id, payload.len()) {
        (CLASS_NAV, NavPvt::ID, NavPvt::PAYLOAD) => {
            let (longitude, latitude, height) = (signed(24), signed(28), signed(32));
            let fix = match payload[20] {
                fix @ 0..=5 => fix,
                _ => 0,
            };
            let motion =
                Motion { velocity: [signed(48), signed(52), signed(56)], accuracy: [unsigned(40), unsigned(44)] };
            let valid = payload[21] & NavPvt::FLAG_FIX_OK != 0
                && payload[78] & NavPvt::FLAG3_INVALID_LLH == 0
                && matches!(fix, 2..=4)
                && latitude.unsigned_abs() <= 900_000_000
                && longitude.unsigned_abs() <= 1_800_000_000
                // A 2D fix has no altitude.
                && (fix == 2 || bounds::ALTITUDE_MM.contains(&height))
                && motion.is_credible(fix);
            let altitude = if fix == 2 { ABSENT_F64 } else { f64::from(height) / 1e3 };
            let raw = [f64::from(latitude) / 1e7, f64::from(longitude) / 1e7, altitude].map(f64::to_bits);
            let values = if valid { raw } else { [ABSENT_F64.to_bits(); 3] };
            let status = u16::from(fix) | u16::from(valid) << 4;
            Some((Kind::Position, unsigned(0), MessageContent { status, values, raw, motion: valid.then_some(motion) }))
        }
        (CLASS_NAV, NavAtt::ID, NavAtt::PAYLOAD) => {
            // An accuracy of 0 means that the angle is not known.
            let angle = |at: usize| match unsigned(at + 12) {
                0 => ABSENT_F32,
                _ => (f64::from(signed(at)) * (PI / 180.0 / 1e5)) as f32,
            };
            let [roll, pitch, yaw] = [angle(8), angle(12), angle(16)];
            Some((Kind::Attitude, unsigned(0), MessageContent::of_f32([pitch, yaw, roll], Kind::Attitude)))
        }
        (CLASS_ESF, EsfIns::ID, EsfIns::PAYLOAD) => {
            let axis = |number: usize| match unsigned(0) >> (11 + number) & 1 {
                0 => ABSENT_F32,
                _ => (f64::from(signed(24 + 4 * number)) / 1e2) as f32,
            };
            Some((
                Kind::Acceleration,
                unsigned(8),
                MessageContent::of_f32([axis(0), axis(1), axis(2)], Kind::Acceleration),
            ))
        }
        _ => None,
    }
}

impl MessageContent {
    pub(super) const fn nothing(kind: Kind) -> Self {
        let absent = [kind.absent(); 3];
        Self { status: 0, values: absent, raw: absent, motion: None }
    }

    fn of_f32(values: [f32; 3], kind: Kind) -> Self {
        let status = if values.iter().any(|value| value.is_nan()) { 0 } else { kind.valid() };
        let raw = values.map(|value| u64::from(value.to_bits()));
        Self { status, values: raw, raw, motion: None }
    }
}
