//! Air frames: their objects, and their time on the air.
//!
//! # Design
//!
//! An NFC-F frame (ISO/IEC 18092, 424 kbit/s) is 48 bits of preamble, 16 of sync, LEN, the payload and a CRC-16; the
//! RFID chips add and remove all but the payload. The payload consists only of whole objects. The link has no header of
//! its own, so received bytes are deposited unchanged, and errors of a header cannot occur.
//!
//! | receivers | frame | objects | payload, bytes | [air time](air_time_ns), ms |
//! |---|---|---|---|---|
//! | 1 | 1 of 1 | Reported-Position, GPS1 | 124 | 2.549 |
//! | 2 | 1 of 1 | Reported-Position, GPS1, GPS2 | 184 | 3.681 |
//! | 3 | 1 of 1 | Reported-Position, GPS1, GPS2, GPS3 | 244 | 4.814 |
//! | 5 | 1 of 2 | Reported-Position, GPS1, GPS2 | 184 | 3.681 |
//! | 5 | 2 of 2 | GPS3, GPS4, GPS5 | 180 | 3.606 |
//!
//! The length of a frame determines its place in the profile, because no two frames of one profile have the same
//! length; each object's identifier confirms the place when the object is [verified](crate::Object::verify). Only a
//! length that no frame has rejects a frame. The CRC-16 rejects nothing: damage to GPS3 leaves Reported-Position.
//!
//! # Example
//!
//! ```
//! use profile::{GpsValues, Object, Profile, Rejection, ReportedValues, air, image::Image};
//!
//! let profile = Profile::<5>::seal(&ReportedValues::absent(70), &[GpsValues::absent(70); 5]);
//! let mut image = Image::<5>::EMPTY;
//! for payload in air::split(&profile) {
//!     for (index, bytes) in air::objects::<5>(payload)? {
//!         image.deposit(Object::verify(index, bytes)?)?;
//!     }
//! }
//! assert_eq!(image.profile(), &profile);
//! # Ok::<(), Rejection>(())
//! ```
use core::iter::FusedIterator;

use crate::{GpsObject, Identifier, Profile, Rejection, ReportedPosition};

/// The longest payload that an NFC-F frame can have, bytes: LEN is one byte and counts itself.
pub const MAX_PAYLOAD: usize = 254;

/// The longest payload of any profile's frames, bytes: that of three receivers.
pub const LONGEST_PAYLOAD: usize = Profile::<3>::SIZE;

/// The number of bytes before the payload that count in LEN: LEN itself.
pub const LEN_BYTES: usize = 1;

/// The number of bytes after the payload: the CRC-16, which the chips add and check.
pub const CRC_BYTES: usize = 2;

/// The shortest time between the end of a frame and the start of the next frame, µs. Within it the listener reads the
/// first frame from its FIFO and re-arms.
pub const MIN_GAP_US: u32 = 300;

const _: () = assert!(LONGEST_PAYLOAD <= MAX_PAYLOAD);

/// The number of bits of a frame beside the payload: preamble, sync, LEN, CRC-16.
const OVERHEAD_BITS: u64 = 48 + 16 + 8 + 16;

/// The number of 13.56 MHz carrier periods in a bit: 423.75 kbit/s.
const BIT_CARRIER_PERIODS: u64 = 32;

/// The number of ns in 678 carrier periods, the shortest time that is a whole number both of ns and of periods.
const NS_PER_678_PERIODS: u64 = 50_000;

/// The air time of a frame with `payload` bytes, from the first preamble bit to the last bit of the CRC-16: ns, rounded
/// to nearest.
///
/// ```
/// assert_eq!(profile::air::air_time_ns(244), 4_814_159);
/// ```
#[must_use]
pub const fn air_time_ns(payload: u8) -> u64 {
    let bits = OVERHEAD_BITS + 8 * u64::from_le_bytes([payload, 0, 0, 0, 0, 0, 0, 0]);
    (bits * BIT_CARRIER_PERIODS * NS_PER_678_PERIODS + 339) / 678
}

/// The [`air_time_ns`] of a payload, which must not be longer than [`LONGEST_PAYLOAD`]: µs, rounded up.
const fn air_time_us(payload: usize) -> u32 {
    let [payload, ..] = payload.to_le_bytes();
    let [b0, b1, b2, b3, ..] = air_time_ns(payload).div_ceil(1_000).to_le_bytes();
    u32::from_le_bytes([b0, b1, b2, b3])
}

/// The time from the tick, at which HORUS takes the sample, to the transmit command of frame number `frame` of its
/// cycle, for a profile of `N` receivers: µs; `None` if there is no such frame. HORUS keeps these slots whatever the
/// data, so the DPR can derive the age of a sample from the end of its frame.
///
/// | receivers | frame 1 | frame 2 |
/// |---|---|---|
/// | 1 | 70 | – |
/// | 2 | 80 | – |
/// | 3 | 100 | – |
/// | 5 | 120 | 4130 |
///
/// `horus-tx-fw` derives each slot from the work that has to be done before it, and asserts that these values hold.
#[must_use]
pub const fn send_slot_us<const N: usize>(frame: usize) -> Option<u32> {
    match (N, frame) {
        (1, 0) => Some(70),
        (2, 0) => Some(80),
        (3, 0) => Some(100),
        (5, 0) => Some(120),
        (5, 1) => Some(4130),
        _ => None,
    }
}

/// The age of a cycle's sample at the last bit of the cycle's frame number `frame`: send slot plus air time, µs,
/// rounded up; `None` if a profile of `N` receivers has no such frame.
///
/// ```
/// assert_eq!(profile::air::age_at_end_us::<3>(0), Some(100 + 4_815));
/// ```
#[must_use]
pub const fn age_at_end_us<const N: usize>(frame: usize) -> Option<u32> {
    let (Some(slot), Some(place)) = (send_slot_us::<N>(frame), Place::of_frame::<N>(frame)) else { return None };
    Some(slot + air_time_us(place.length()))
}

/// The number of frames in a cycle for a profile of `receivers` receivers: 1, or 2 if one frame is too short for it.
#[must_use]
pub const fn frames(receivers: usize) -> usize {
    if receivers <= 3 { 1 } else { 2 }
}

/// The objects of a profile that a frame carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Place {
    first: usize,
    count: usize,
}

impl Place {
    /// The objects of frame number `frame`, from 0, of a profile of `N` receivers; `None` if there is no such frame.
    #[must_use]
    pub const fn of_frame<const N: usize>(frame: usize) -> Option<Self> {
        let objects = Profile::<N>::OBJECTS;
        match (frame, frames(N)) {
            (0, 1) => Some(Self { first: 0, count: objects }),
            (0, 2) => Some(Self { first: 0, count: 3 }),
            (1, 2) => Some(Self { first: 3, count: objects - 3 }),
            _ => None,
        }
    }

    /// The number of the frame's first object in its profile: 0 is Reported-Position, 1 to 5 are GPS1 to GPS5.
    #[must_use]
    pub const fn first(self) -> usize {
        self.first
    }

    /// The number of the frame's objects, at least one.
    #[must_use]
    pub const fn count(self) -> usize {
        self.count
    }

    /// The offset of the payload's first byte in the profile.
    #[must_use]
    pub const fn offset(self) -> usize {
        match self.first {
            0 => 0,
            receiver => ReportedPosition::SIZE + (receiver - 1) * GpsObject::SIZE,
        }
    }

    /// The length of the payload, bytes.
    #[must_use]
    pub const fn length(self) -> usize {
        match self.first {
            0 => ReportedPosition::SIZE + (self.count - 1) * GpsObject::SIZE,
            _ => self.count * GpsObject::SIZE,
        }
    }
}

/// The payloads of the frames of `profile`, in the order of sending, as slices of its bytes.
pub fn split<const N: usize>(profile: &Profile<N>) -> impl FusedIterator<Item = &[u8]> {
    let bytes = profile.as_bytes();
    (0..frames(N)).filter_map(|frame| {
        let place = Place::of_frame::<N>(frame)?;
        bytes.get(place.offset()..place.offset() + place.length())
    })
}

/// The objects of a profile of `N` receivers that a frame with `payload` carries, by the payload's length alone.
///
/// # Errors
///
/// [`Rejection::Length`] if no frame of a profile of `N` receivers is that long.
pub fn place<const N: usize>(payload: &[u8]) -> Result<Place, Rejection> {
    (0..frames(N))
        .filter_map(Place::of_frame::<N>)
        .find(|place| place.length() == payload.len())
        .ok_or(Rejection::Length)
}

/// The parts of `payload` that should be objects, each with its number in the profile, for
/// [`Object::verify`](crate::Object::verify).
///
/// # Errors
///
/// [`Rejection::Length`] if no frame of a profile of `N` receivers is that long.
pub fn objects<const N: usize>(payload: &[u8]) -> Result<Objects<'_>, Rejection> {
    let place = place::<N>(payload)?;
    Ok(Objects { next: place.first, rest: payload })
}

/// The objects of a payload; see [`objects`].
#[derive(Clone, Debug)]
pub struct Objects<'a> {
    next: usize,
    rest: &'a [u8],
}

impl<'a> Iterator for Objects<'a> {
    type Item = (usize, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        let size = match Identifier::of_object(self.next)? {
            Identifier::REPORTED_POSITION => ReportedPosition::SIZE,
            _ => GpsObject::SIZE,
        };
        let (object, rest) = self.rest.split_at_checked(size)?;
        let index = self.next;
        self.next += 1;
        self.rest = rest;
        Some((index, object))
    }
}

impl FusedIterator for Objects<'_> {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_bit_of_a_frame_takes_32_carrier_periods() {
        for payload in 0..=u8::MAX {
            let bits = 48 + 16 + 8 * (1 + u64::from(payload) + 2);
            // A time of 50 000 ns is 678 periods of the carrier.
            let exact = bits * 32 * 50_000;
            assert!((678 * air_time_ns(payload)).abs_diff(exact) <= 339, "{payload} bytes");
        }
    }

    #[test]
    fn each_frames_age_at_its_end_is_slot_plus_air_time() {
        fn ages<const N: usize>() -> [Option<u32>; 3] {
            [0, 1, 2].map(age_at_end_us::<N>)
        }
        assert_eq!(ages::<1>(), [Some(70 + 2_549), None, None]);
        assert_eq!(ages::<2>(), [Some(80 + 3_682), None, None]);
        assert_eq!(ages::<3>(), [Some(100 + 4_815), None, None]);
        assert_eq!(ages::<5>(), [Some(120 + 3_682), Some(4_130 + 3_606), None]);
    }
}
