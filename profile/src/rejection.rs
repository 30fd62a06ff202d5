//! The reasons why received bytes are not accepted.
use core::{error::Error, fmt, hint::black_box};

/// The reason why received bytes are not accepted.
///
/// If several reasons hold, the result is the first in the order of the variants. Later versions may add reasons.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Rejection {
    /// The number of bytes is wrong for this object or request.
    Length,
    /// The frame CRC is wrong: the bytes are damaged, scrubbed, or were never written.
    Crc,
    /// The frame CRC is right, but the CRC over latitude and longitude is wrong: the sender had a fault when it sealed
    /// the object.
    PositionCrc,
    /// The bytes are an intact object, but not the expected one.
    Identifier,
    /// The bytes are an intact request for a window that is not in the map.
    Window,
    /// The bytes are an intact command with an unknown word, or with reserved bytes that are not zero.
    Command,
    /// The object is intact, but has the timestamp of the last accepted one.
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

/// The findings of all checks of one object or request.
///
/// Every check is made, whatever the other checks found. So the time for the checks does not depend on the bytes.
#[derive(Clone, Copy, Default)]
pub(crate) struct Findings {
    faults: u8,
}

impl Findings {
    pub(crate) const fn new() -> Self {
        Self { faults: 0 }
    }

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

    /// Returns `accepted` if every check was good. Otherwise returns the first reason for a rejection.
    #[inline]
    pub(crate) fn judge<T>(self, accepted: T) -> Result<T, Rejection> {
        // `black_box` keeps the optimiser from moving a CRC's computation into the branch that needs its result.
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
