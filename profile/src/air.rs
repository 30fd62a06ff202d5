//! Air frames: their objects, and their time on the air.
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
//! No two frames of one profile have the same length. So a frame's length determines which objects it carries, and each
//! object's identifier confirms that when the object is [verified](crate::Object::verify). A frame is rejected only for
//! a length that no frame of the profile has. A wrong CRC-16 does not reject a frame, because damage to one object
//! leaves the others intact.
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

/// The longest payload that an NFC-F frame can have, bytes. LEN is a single byte, which counts itself.
pub const MAX_PAYLOAD: usize = 254;

/// The longest payload of a frame, bytes: the whole profile of three receivers.
pub const LONGEST_PAYLOAD: usize = Profile::<3>::SIZE;

/// The size of a frame's length field LEN, bytes.
pub const LEN_BYTES: usize = 1;

/// The size of a frame's CRC-16, bytes. The RFID chips add and check it.
pub const CRC_BYTES: usize = 2;

/// The shortest time between the end of a frame and the start of the next frame, µs. The listener uses it to read the
/// first frame from its FIFO and to re-arm.
pub const MIN_GAP_US: u32 = 300;

const _: () = assert!(LONGEST_PAYLOAD <= MAX_PAYLOAD);

const OVERHEAD_BITS: u64 = 48 + 16 + 8 + 16;

const BIT_CARRIER_PERIODS: u64 = 32;

/// The length of 678 periods of the carrier, ns: the fewest periods that take a whole number of ns.
const NS_PER_678_PERIODS: u64 = 50_000;

/// The air time of a frame with `payload` bytes, ns, from the first preamble bit to the last bit of the CRC-16.
///
/// ```
/// assert_eq!(profile::air::air_time_ns(244), 4_814_159);
/// ```
#[must_use]
pub const fn air_time_ns(payload: u8) -> u64 {
    let bits = OVERHEAD_BITS + 8 * u64::from_le_bytes([payload, 0, 0, 0, 0, 0, 0, 0]);
    (bits * BIT_CARRIER_PERIODS * NS_PER_678_PERIODS + 339) / 678
}

/// The air time of a frame with a payload of at most [`LONGEST_PAYLOAD`] bytes, µs, rounded up.
const fn air_time_us(payload: usize) -> u32 {
    let [payload, ..] = payload.to_le_bytes();
    let [b0, b1, b2, b3, ..] = air_time_ns(payload).div_ceil(1_000).to_le_bytes();
    u32::from_le_bytes([b0, b1, b2, b3])
}

/// The time, µs, from the tick to the transmit command of frame number `frame` of the cycle, for `N` receivers; `None`
/// if there is no such frame. HORUS samples at the tick, and sends at this time whatever the data. So the DPR can
/// derive the sample's age from the end of its frame.
///
/// | receivers | frame 1 | frame 2 |
/// |---|---|---|
/// | 1 | 70 | – |
/// | 2 | 80 | – |
/// | 3 | 100 | – |
/// | 5 | 120 | 4130 |
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

/// The age of a cycle's sample, µs, rounded up, at the last bit of frame number `frame`: send slot plus air time.
/// `None` if a profile of `N` receivers has no such frame.
///
/// ```
/// assert_eq!(profile::air::age_at_end_us::<3>(0), Some(100 + 4_815));
/// ```
#[must_use]
pub const fn age_at_end_us<const N: usize>(frame: usize) -> Option<u32> {
    let (Some(slot), Some(place)) = (send_slot_us::<N>(frame), Place::of_frame::<N>(frame)) else { return None };
    Some(slot + air_time_us(place.length()))
}

/// The number of frames in a cycle: 2 for five receivers, otherwise 1.
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
        // Not covered: only this line, in the copy for HORUS's transmitter, a frame that the cycle does not have: it
        // asks only for the next one, of which there is one.
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

/// The objects that a frame with `payload` carries, for a profile of `N` receivers. Only the payload's length is used.
///
/// # Errors
///
/// [`Rejection::Length`] if no frame of a profile of `N` receivers is as long as `payload`.
pub fn place<const N: usize>(payload: &[u8]) -> Result<Place, Rejection> {
    (0..frames(N))
        .filter_map(Place::of_frame::<N>)
        .find(|place| place.length() == payload.len())
        .ok_or(Rejection::Length)
}

/// The pieces of `payload` that should be objects, each with its number in the profile, for
/// [`Object::verify`](crate::Object::verify).
///
/// # Errors
///
/// [`Rejection::Length`] if no frame of a profile of `N` receivers is as long as `payload`.
pub fn objects<const N: usize>(payload: &[u8]) -> Result<Objects<'_>, Rejection> {
    let place = place::<N>(payload)?;
    Ok(Objects { next: place.first, rest: payload })
}

/// The iterator that [`objects`] returns.
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
