//! The reasons for which received bytes are not accepted.
use core::{error::Error, fmt, hint::black_box};

/// The reason why received bytes were not accepted.
///
/// Where several reasons hold, it is the first in this order. Later versions may add more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Rejection {
    /// The length is wrong for this place.
    Length,
    /// The frame CRC does not fit: damaged, scrubbed, or never written.
    Crc,
    /// The frame CRC fits, but that over latitude and longitude does not: the sender had a fault when it sealed the
    /// object.
    PositionCrc,
    /// It is intact, but another object than the one that belongs here.
    Identifier,
    /// It is an intact request for bytes outside the map.
    Window,
    /// It is an intact command with an unknown word, or with reserved bytes that are not zero.
    Command,
    /// It is intact, and has the timestamp of the one before it.
    Repeated,
}

impl fmt::Display for Rejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Length => "wrong length",
            Self::Crc => "frame CRC does not match",
            Self::PositionCrc => "position CRC does not match",
            Self::Identifier => "identifier of another object",
            Self::Window => "window not inside the map",
            Self::Command => "unknown command",
            Self::Repeated => "the same timestamp again",
        })
    }
}

impl Error for Rejection {}

/// The findings of all checks of one object or request, gathered before any decision.
///
/// Each check is made and recorded whatever the others found, so the time for judging bytes does not depend on them.
#[derive(Clone, Copy, Default)]
pub(crate) struct Findings {
    faults: u8,
}

impl Findings {
    pub(crate) const fn new() -> Self {
        Self { faults: 0 }
    }

    /// Records `rejection` unless `good`.
    #[inline]
    pub(crate) fn check(self, good: bool, rejection: Rejection) -> Self {
        let bit = match rejection {
            Rejection::Length => 0,
            Rejection::Crc => 1,
            Rejection::PositionCrc => 2,
            Rejection::Identifier => 3,
            Rejection::Window => 4,
            Rejection::Command => 5,
            Rejection::Repeated => 6,
        };
        Self { faults: self.faults | u8::from(!good) << bit }
    }

    /// Returns `accepted` if every check was good, or else the first reason against it.
    #[inline]
    pub(crate) fn judge<T>(self, accepted: T) -> Result<T, Rejection> {
        // The optimiser must not see through this, because it could move a CRC into the branch that needs its result.
        match black_box(self.faults).trailing_zeros() {
            0 => Err(Rejection::Length),
            1 => Err(Rejection::Crc),
            2 => Err(Rejection::PositionCrc),
            3 => Err(Rejection::Identifier),
            4 => Err(Rejection::Window),
            5 => Err(Rejection::Command),
            6 => Err(Rejection::Repeated),
            _ => Ok(accepted),
        }
    }
}
