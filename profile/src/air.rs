//! Air frames: which objects travel together.
use crate::{GpsObject, Profile, Rejection, ReportedPosition};

/// The longest payload of an NFC-F frame, bytes: LEN counts itself, and 255 is its largest value.
pub const MAX_PAYLOAD: usize = 254;

/// The longest payload that HORUS sends, bytes.
pub const LONGEST_PAYLOAD: usize = 244;

/// Air frames per cycle for a profile of `receivers` receivers: 1 or 2.
#[must_use]
pub const fn frames(receivers: usize) -> usize {
    if receivers <= 3 { 1 } else { 2 }
}

/// Which objects of a profile a frame carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Place {
    first: usize,
    count: usize,
}

impl Place {
    /// Where frame `frame` (from 0) of a profile of `N` receivers belongs; `None` if there is no such frame.
    #[must_use]
    pub const fn of_frame<const N: usize>(frame: usize) -> Option<Self> {
        let objects = Profile::<N>::OBJECTS;
        match (frame, frames(N)) {
            (0, 1) => Some(Self {
                first: 0,
                count: objects,
            }),
            (0, _) => Some(Self { first: 0, count: 3 }),
            (1, 2) => Some(Self {
                first: 3,
                count: objects - 3,
            }),
            _ => None,
        }
    }

    /// The index of the first object: 0 is Reported-Position, 1 to 5 are GPS1 to GPS5.
    #[must_use]
    pub const fn first(self) -> usize {
        self.first
    }

    /// How many objects.
    #[must_use]
    pub const fn count(self) -> usize {
        self.count
    }

    /// Payload, bytes.
    #[must_use]
    pub const fn length(self) -> usize {
        if self.first == 0 {
            ReportedPosition::SIZE + (self.count - 1) * GpsObject::SIZE
        } else {
            self.count * GpsObject::SIZE
        }
    }

    /// Where the payload lies in the profile: its first byte.
    #[must_use]
    pub const fn offset(self) -> usize {
        if self.first == 0 {
            0
        } else {
            ReportedPosition::SIZE + (self.first - 1) * GpsObject::SIZE
        }
    }
}

/// The frames of `profile` in the order they are sent, each a payload.
pub fn split<const N: usize>(profile: &Profile<N>) -> impl Iterator<Item = &[u8]> {
    let mut rest = profile.as_bytes();
    (0..frames(N))
        .filter_map(Place::of_frame::<N>)
        .filter_map(move |place| {
            let (payload, after) = rest.split_at_checked(place.length())?;
            rest = after;
            Some(payload)
        })
}

/// Which objects of a profile of `N` receivers `payload` carries, told by its length.
///
/// # Errors
///
/// [`Rejection::Length`] if no frame of such a profile is that long.
pub fn place<const N: usize>(payload: &[u8]) -> Result<Place, Rejection> {
    (0..frames(N))
        .filter_map(Place::of_frame::<N>)
        .find(|place| place.length() == payload.len())
        .ok_or(Rejection::Length)
}

/// The objects of `payload`, each with its index in the profile, for [`Object::verify`](crate::Object::verify).
///
/// # Errors
///
/// [`Rejection::Length`] if no frame of a profile of `N` receivers is that long.
pub fn objects<const N: usize>(
    payload: &[u8],
) -> Result<impl Iterator<Item = (usize, &[u8])>, Rejection> {
    let place = place::<N>(payload)?;
    let mut rest = payload;
    Ok(
        (place.first..place.first + place.count).filter_map(move |index| {
            let size = if index == 0 {
                ReportedPosition::SIZE
            } else {
                GpsObject::SIZE
            };
            let (object, after) = rest.split_at_checked(size)?;
            rest = after;
            Some((index, object))
        }),
    )
}
