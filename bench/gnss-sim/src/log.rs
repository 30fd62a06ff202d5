//! A UBX log recorded from a real receiver, as a byte source.
//!
//! # The contents
//!
//! All bytes of the file are played in their order: UBX, NMEA, RTCM, damaged messages and noise. The log is parsed only
//! to find out *when* its bytes were sent.
//!
//! # The timing
//!
//! A receiver sends one burst for each navigation epoch, and every UBX NAV message has its epoch (`iTOW`, GPS time of
//! week in ms). The file is divided where a message begins a new epoch, and the pieces are sent at the intervals of
//! their `iTOW`:
//!
//! - The bytes before the first epoch, and the first epoch, are sent [`FIRST_BURST_NS`] after reset.
//! - A NAV message with a right checksum and a later `iTOW` begins the next epoch. A roll-over of the week counts as
//!   later. A step longer than [`GAP_MAX_MS`], as in a tunnel, is shortened to that length.
//! - A NAV-PVT whose `iTOW` is *not* later begins an epoch too, [`PERIOD_WITHOUT_TIME_MS`] after the one before. Such
//!   messages come from a receiver without the time. Other late messages begin no epoch.
//! - Bytes of any other kind belong to the epoch before them.
//! - A burst never starts before the burst ahead of it has left the UART.
//!
//! # The positions
//!
//! [`Log::positions`] lists the valid positions: NAV-PVT messages of 92 bytes (protocol version 15 and later) with a
//! right checksum, `gnssFixOK` set, `invalidLlh` clear, and a fix that has a position. A log without such a position is
//! refused with the reason.

use std::fs::File;
use std::io::{self, Read};
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::ubx::{self, Frame, NavPvt, WEEK_MS};

/// The instant at which a log's first byte is sent, ns after reset. HORUS has started by then and receives it.
pub const FIRST_BURST_NS: u64 = 100_000_000;

/// The longest pause between two epochs, ms. A longer pause in the log is shortened to it.
pub const GAP_MAX_MS: u32 = 5_000;

/// The pause before an epoch whose time of week is not later than that of the epoch before, ms.
pub const PERIOD_WITHOUT_TIME_MS: u32 = 1_000;

/// The length of the longest log that is read, bytes: more than a day at 1 Mbit/s.
pub const LENGTH_MAX: u64 = 1 << 30;

/// The reason why a log cannot be played.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The file cannot be opened or read.
    #[error(
        "{}: cannot be read; give the path of a file that a u-blox receiver's output was recorded to",
        path.display()
    )]
    Unreadable {
        /// The path of the file.
        path: PathBuf,
        /// The operating system's error.
        source: io::Error,
    },
    /// The file has no bytes.
    #[error("{}: is empty. Record a receiver's output to it first, with NAV-PVT enabled", path.display())]
    Empty {
        /// The path of the file.
        path: PathBuf,
    },
    /// The file is longer than [`LENGTH_MAX`].
    #[error("{}: is longer than {LENGTH_MAX} bytes. Cut a shorter recording out of it", path.display())]
    TooLong {
        /// The path of the file.
        path: PathBuf,
    },
    /// The file holds no valid NAV-PVT position.
    #[error(
        "{}: holds no position: among its {} bytes are {} whole UBX messages ({} NAV-PVT, none with a valid fix), \
         {} NMEA sentences, {} RTCM messages, and {} bytes that belong to none. HORUS reads positions from UBX-NAV-PVT \
         (92 bytes, protocol version 15 or later): enable that message in the receiver, let it get a fix, and record \
         again",
        path.display(), counts.bytes, counts.ubx, counts.nav_pvt, counts.nmea, counts.rtcm, counts.unknown_bytes
    )]
    NoPosition {
        /// The path of the file.
        path: PathBuf,
        /// The contents of the log.
        counts: LogCounts,
    },
}

/// The contents of a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LogCounts {
    /// The length of the log, bytes.
    pub bytes: usize,
    /// The number of UBX messages with a right checksum.
    pub ubx: usize,
    /// The number of NAV-PVT messages, whether or not their position is valid.
    pub nav_pvt: usize,
    /// The number of NMEA sentences with a right checksum.
    pub nmea: usize,
    /// The number of RTCM 3 messages with a right CRC.
    pub rtcm: usize,
    /// The number of bytes that belong to no whole message, such as noise and damaged or incomplete messages.
    pub unknown_bytes: usize,
}

/// A position in a NAV-PVT message of the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct RecordedPosition {
    /// GPS time of week, ms.
    pub itow_ms: u32,
    /// Longitude, 1e-7 deg.
    pub longitude_1e7: i32,
    /// Latitude, 1e-7 deg.
    pub latitude_1e7: i32,
    /// Height above the ellipsoid, mm.
    pub height_mm: i32,
}

impl RecordedPosition {
    /// Longitude, degrees: the float64 nearest to the decimal number in the message.
    ///
    /// The value is divided by 1e7, because the division of two exact numbers is rounded correctly; 1e-7 is not exact.
    #[must_use]
    pub fn longitude(&self) -> f64 {
        f64::from(self.longitude_1e7) / 1e7
    }

    /// Latitude, degrees; rounded like [`Self::longitude`].
    #[must_use]
    pub fn latitude(&self) -> f64 {
        f64::from(self.latitude_1e7) / 1e7
    }

    /// Height above the ellipsoid, m; rounded like [`Self::longitude`].
    #[must_use]
    pub fn altitude(&self) -> f64 {
        f64::from(self.height_mm) / 1e3
    }

    /// The position in `frame`, if that is a NAV-PVT message with a valid position.
    #[must_use]
    pub fn from_frame(frame: &Frame<'_>) -> Option<Self> {
        if (frame.class, frame.id) != (ubx::CLASS_NAV, NavPvt::ID) || frame.payload.len() != NavPvt::PAYLOAD {
            return None;
        }
        let word = |offset: usize| -> Option<i32> {
            Some(i32::from_le_bytes(frame.payload.get(offset..offset + 4)?.try_into().ok()?))
        };
        let byte = |offset: usize| frame.payload.get(offset).copied();
        // The fix types are: 1 dead reckoning, 2 2D, 3 3D, 4 GNSS and dead reckoning, 5 time only.
        let fixed = matches!(byte(20)?, 1..=4);
        let ok = byte(21)? & NavPvt::FLAG_FIX_OK != 0 && byte(78)? & NavPvt::FLAG3_INVALID_LLH == 0;
        (fixed && ok).then_some(())?;
        Some(Self {
            itow_ms: word(0)?.cast_unsigned(),
            longitude_1e7: word(24)?,
            latitude_1e7: word(28)?,
            height_mm: word(32)?,
        })
    }
}

/// A recorded log, divided into the bursts in which it is played.
#[derive(Debug, Clone)]
pub struct Log {
    bytes: Vec<u8>,
    bursts: Vec<(u64, Range<usize>)>,
    positions: Vec<RecordedPosition>,
    counts: LogCounts,
}

impl Log {
    /// Reads the log at `path`.
    ///
    /// # Errors
    ///
    /// [`LogError`] if the file cannot be read, is empty, is too long, or holds no position.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, LogError> {
        let path = path.as_ref();
        let unreadable = |source| LogError::Unreadable { path: path.to_owned(), source };
        let mut bytes = Vec::new();
        File::open(path).and_then(|file| file.take(LENGTH_MAX + 1).read_to_end(&mut bytes)).map_err(unreadable)?;
        Self::from_bytes(path, bytes)
    }

    /// Reads the log in `bytes`. `path` names the log in errors.
    ///
    /// # Errors
    ///
    /// [`LogError`], except [`LogError::Unreadable`].
    pub fn from_bytes(path: impl AsRef<Path>, bytes: Vec<u8>) -> Result<Self, LogError> {
        let path = path.as_ref();
        if bytes.is_empty() {
            return Err(LogError::Empty { path: path.to_owned() });
        }
        if bytes.len() as u64 > LENGTH_MAX {
            return Err(LogError::TooLong { path: path.to_owned() });
        }
        let mut counts = LogCounts { bytes: bytes.len(), ..LogCounts::default() };
        let mut positions = Vec::new();
        let mut cutter = Cutter::default();
        let mut at = 0;
        while at < bytes.len() {
            let rest = &bytes[at..];
            at += if let Some(frame) = Frame::at_start_of(rest) {
                counts.ubx += 1;
                let is_pvt = (frame.class, frame.id) == (ubx::CLASS_NAV, NavPvt::ID);
                counts.nav_pvt += usize::from(is_pvt);
                positions.extend(RecordedPosition::from_frame(&frame));
                if let Some(itow) = frame.itow_ms() {
                    cutter.message(at, itow, is_pvt);
                }
                frame.wire_len()
            } else if let Some(length) = nmea_at_start_of(rest) {
                counts.nmea += 1;
                length
            } else if let Some(length) = rtcm_at_start_of(rest) {
                counts.rtcm += 1;
                length
            } else {
                counts.unknown_bytes += 1;
                1
            };
        }
        if positions.is_empty() {
            return Err(LogError::NoPosition { path: path.to_owned(), counts });
        }
        let bursts = cutter.bursts(bytes.len());
        Ok(Self { bytes, bursts, positions, counts })
    }

    /// The valid NAV-PVT positions, in the order of the log.
    #[must_use]
    pub fn positions(&self) -> &[RecordedPosition] {
        &self.positions
    }

    /// The contents of the log.
    #[must_use]
    pub fn counts(&self) -> LogCounts {
        self.counts
    }

    /// Returns all bytes of the log, as recorded.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The bursts in order, each as its instant (ns after reset) and its bytes. There is at least one, and none is
    /// empty.
    pub fn bursts(&self) -> impl ExactSizeIterator<Item = (u64, &[u8])> {
        self.bursts.iter().map(|(at, range)| (*at, &self.bytes[range.clone()]))
    }

    /// Returns the burst with this index, counted from zero.
    #[must_use]
    pub fn burst(&self, index: usize) -> Option<(u64, &[u8])> {
        let (at, range) = self.bursts.get(index)?;
        Some((*at, &self.bytes[range.clone()]))
    }

    /// The time from reset to the last epoch, ns.
    #[must_use]
    pub fn duration_ns(&self) -> u64 {
        self.bursts.last().map_or(0, |(at, _)| *at)
    }
}

#[derive(Debug, Default)]
struct Cutter {
    epoch: Option<u32>,
    has_pvt: bool,
    /// Where each epoch but the first begins: the time since the first epoch, ns, and the offset in the log.
    cuts: Vec<(u64, usize)>,
    now_ns: u64,
}

impl Cutter {
    /// Processes a NAV message of the epoch `itow` at `offset` of the log.
    fn message(&mut self, offset: usize, itow: u32, is_pvt: bool) {
        if let Some(epoch) = self.epoch {
            let step = (itow + WEEK_MS - epoch) % WEEK_MS;
            // An `iTOW` more than half a week ahead counts as earlier.
            let ahead = step > 0 && step <= WEEK_MS / 2;
            let pause = if ahead {
                step.min(GAP_MAX_MS)
            } else if is_pvt && (self.has_pvt || step != 0) {
                PERIOD_WITHOUT_TIME_MS
            } else {
                self.has_pvt |= is_pvt;
                return;
            };
            self.now_ns += u64::from(pause) * 1_000_000;
            self.cuts.push((self.now_ns, offset));
        }
        self.epoch = Some(itow);
        self.has_pvt = is_pvt;
    }

    fn bursts(self, length: usize) -> Vec<(u64, Range<usize>)> {
        // Bytes before the first epoch are sent in the first epoch's burst.
        let starts = std::iter::once((0, 0)).chain(self.cuts.iter().copied());
        let ends = self.cuts.iter().map(|(_, offset)| *offset).chain([length]);
        starts.zip(ends).map(|((at, start), end)| (FIRST_BURST_NS + at, start..end)).collect()
    }
}

/// The length of the NMEA sentence with a right checksum at the start of `bytes`, if there is one: `$`, at most 255
/// printable characters (u-blox exceeds the standard's 82), `*hh`, CR and LF.
fn nmea_at_start_of(bytes: &[u8]) -> Option<usize> {
    const LONGEST: usize = 255;
    let body = bytes.strip_prefix(b"$")?;
    let star = body.iter().take(LONGEST).position(|byte| !(b' '..=b'~').contains(byte) || *byte == b'*')?;
    let [b'*', high, low, b'\r', b'\n', ..] = *body.get(star..)? else {
        return None;
    };
    let digit = |c: u8| char::from(c).to_digit(16);
    let told = digit(high)? * 16 + digit(low)?;
    let sum = body[..star].iter().fold(0, |sum, byte| sum ^ byte);
    (told == u32::from(sum)).then_some(1 + star + 5)
}

/// The length of the RTCM 3 message with a right CRC at the start of `bytes`, if there is one (RTCM 10403: 0xD3, 6 zero
/// bits, 10 bits of length, CRC-24Q).
fn rtcm_at_start_of(bytes: &[u8]) -> Option<usize> {
    // The `crc` crate names CRC-24Q (polynomial 0x864CFB, start value 0) after LTE.
    const CRC_24Q: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_24_LTE_A);
    let [0xd3, high, low, ..] = *bytes else {
        return None;
    };
    if high & !0b11 != 0 {
        return None;
    }
    let end = 3 + usize::from(u16::from_be_bytes([high, low]));
    let [a, b, c] = *bytes.get(end..end + 3)? else {
        return None;
    };
    (CRC_24Q.checksum(&bytes[..end]) == u32::from_be_bytes([0, a, b, c])).then_some(end + 3)
}
