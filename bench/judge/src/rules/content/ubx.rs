//! Finds what a receiver said in the bytes of its line.
//!
//! Written from the u-blox 8 / M8 receiver description (UBX-13003221), chapter UBX Protocol, from
//! docs/design.md#validity, and from decision 15, which says what a receiver must state for its position to be valid.

use std::f64::consts::PI;

use gnss_sim::ubx::{CLASS_ESF, CLASS_NAV, EsfIns, NavAtt, NavPvt, OVERHEAD, SYNC, checksum};
use profile::{ABSENT_F32, ABSENT_F64};

use crate::bounds;

/// The longest message of which it is certain that HORUS takes it, bytes: its buffer has 256.
const LONGEST: usize = 256;

/// What one kind of message says: three numbers as their bits, and what they do to the status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Said {
    /// Bits of the status while the message is young enough.
    pub(super) status: u16,
    /// The numbers while the message is young enough: NaN for what is not valid.
    pub(super) values: [u64; 3],
    /// The numbers as the message has them, valid or not.
    pub(super) raw: [u64; 3],
    /// Of a valid position: how it moves, and how good it is.
    pub(super) motion: Option<Motion>,
}

/// What a NAV-PVT message with a valid position says beside the position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Motion {
    /// North, east, down, mm/s.
    pub(super) velocity: [i32; 3],
    /// The accuracies that it states, horizontal and vertical, mm.
    pub(super) accuracy: [u32; 2],
}

impl Motion {
    /// Whether HORUS may use a position that moves so and is so good: up to 200 m/s, and an accuracy that is stated, of
    /// at most 30 m horizontally and, unless it is a 2D fix, 50 m vertically (decision 15).
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

/// Which kind of message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// NAV-PVT: latitude, longitude, altitude.
    Position,
    /// NAV-ATT: pitch, yaw, roll.
    Attitude,
    /// ESF-INS: x, y, z.
    Acceleration,
}

impl Kind {
    pub(super) const ALL: [Self; 3] = [Self::Position, Self::Attitude, Self::Acceleration];

    /// The bits of a GPS object's status that follow from this kind of message.
    pub(super) const fn mask(self) -> u16 {
        match self {
            Self::Position => 0x0F | 1 << 4 | STALE,
            Self::Attitude => 1 << 5,
            Self::Acceleration => 1 << 6,
        }
    }

    /// The bit that says that the values are valid.
    pub(super) const fn valid(self) -> u16 {
        match self {
            Self::Position => 1 << 4,
            Self::Attitude => 1 << 5,
            Self::Acceleration => 1 << 6,
        }
    }

    /// The bits of a number that is not known.
    pub(super) const fn absent(self) -> u64 {
        match self {
            Self::Position => ABSENT_F64.to_bits(),
            Self::Attitude | Self::Acceleration => ABSENT_F32.to_bits() as u64,
        }
    }
}

/// The status bit of a solution that is older than its receiver's period allows.
pub(super) const STALE: u16 = 1 << 8;

/// A message with a right checksum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Message {
    /// When its first byte began, ns.
    pub(super) begun: u64,
    /// When its last byte had crossed the line, ns.
    pub(super) arrived: u64,
    /// HORUS must have read it: no byte of it was disturbed, and nothing before it looks like a message that is longer.
    pub(super) sure: bool,
    /// Its kind, its time of week (ms), and what it says; nothing of a kind that HORUS does not read.
    pub(super) said: Option<(Kind, u32, Said)>,
}

#[derive(Clone, Copy, Debug)]
struct Crossing {
    /// When the byte began.
    from: u64,
    /// When it had crossed.
    to: u64,
    clean: bool,
}

/// Finds messages in the bytes of one line.
#[derive(Clone, Debug, Default)]
pub(super) struct Reader {
    /// From the first byte on that may begin a message which is not complete.
    bytes: Vec<u8>,
    crossings: Vec<Crossing>,
    /// When the last byte had crossed.
    last: Option<u64>,
    /// So many bytes may belong to a message that was begun before them and never ends right: HORUS may find what is in
    /// them later, or never.
    doubtful: usize,
}

impl Reader {
    /// The line carries `bytes` from `at` on, each for `byte_ns`, all of them `clean` or not; `found` is given what
    /// messages end in them.
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

        // Until where what was begun before keeps HORUS waiting: what ended wrongly, and what has not ended.
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
            // What ended in the bytes of before was found then.
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

/// What the first of some bytes claims.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Claim {
    /// They begin no message.
    None,
    /// They begin one that is not complete, so many bytes long, or longer if its length is not there yet.
    Open(usize),
    /// They begin one that is too long for HORUS, or whose checksum is wrong; it keeps HORUS waiting for so many bytes.
    Wrong(usize),
    /// They begin with one, so many bytes long.
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
                    // Zeros have the checksum zero. There is no class 0.
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

/// What a whole message says, if HORUS reads its kind.
fn said(message: &[u8]) -> Option<(Kind, u32, Said)> {
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
            // The float64 nearest to the decimal number: one division of two exact ones.
            let altitude = if fix == 2 { ABSENT_F64 } else { f64::from(height) / 1e3 };
            let raw = [f64::from(latitude) / 1e7, f64::from(longitude) / 1e7, altitude].map(f64::to_bits);
            let values = if valid { raw } else { [ABSENT_F64.to_bits(); 3] };
            let status = u16::from(fix) | u16::from(valid) << 4;
            Some((Kind::Position, unsigned(0), Said { status, values, raw, motion: valid.then_some(motion) }))
        }
        (CLASS_NAV, NavAtt::ID, NavAtt::PAYLOAD) => {
            // An accuracy of 0 says that the angle is not known.
            let angle = |at: usize| match unsigned(at + 12) {
                0 => ABSENT_F32,
                _ => (f64::from(signed(at)) * (PI / 180.0 / 1e5)) as f32,
            };
            let [roll, pitch, yaw] = [angle(8), angle(12), angle(16)];
            Some((Kind::Attitude, unsigned(0), Said::of_f32([pitch, yaw, roll], Kind::Attitude)))
        }
        (CLASS_ESF, EsfIns::ID, EsfIns::PAYLOAD) => {
            let axis = |number: usize| match unsigned(0) >> (11 + number) & 1 {
                0 => ABSENT_F32,
                _ => (f64::from(signed(24 + 4 * number)) / 1e2) as f32,
            };
            Some((Kind::Acceleration, unsigned(8), Said::of_f32([axis(0), axis(1), axis(2)], Kind::Acceleration)))
        }
        _ => None,
    }
}

impl Said {
    /// Nothing.
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
