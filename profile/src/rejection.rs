//! Why received bytes were not accepted.
use core::{error::Error, fmt, hint::black_box};

/// Why received bytes were not accepted.
///
/// Where several reasons hold, it is the first in this order. More may be added.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Rejection {
    /// Not as long as what belongs here.
    Length,
    /// The frame CRC does not fit: damaged, scrubbed, or never written.
    Crc,
    /// The frame CRC fits, that over latitude and longitude does not: the one who sealed it had a fault.
    PositionCrc,
    /// Intact, but another object than the one that belongs here.
    Identifier,
    /// An intact request for bytes that the map does not have.
    Window,
    /// An intact command whose word the DPR does not know, or whose reserved bytes are not zero.
    Command,
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
        })
    }
}

impl Error for Rejection {}

/// What the checks of one object or request found, gathered before anything is decided.
///
/// Each check is made, and put here, whatever the others found: the time it takes to judge bytes does not tell, nor
/// depend on, what they are.
#[derive(Clone, Copy, Default)]
pub(crate) struct Findings {
    faults: u8,
}

impl Findings {
    pub(crate) const fn new() -> Self {
        Self { faults: 0 }
    }

    /// Notes that `rejection` applies unless `good`.
    #[inline]
    pub(crate) fn check(self, good: bool, rejection: Rejection) -> Self {
        let bit = match rejection {
            Rejection::Length => 0,
            Rejection::Crc => 1,
            Rejection::PositionCrc => 2,
            Rejection::Identifier => 3,
            Rejection::Window => 4,
            Rejection::Command => 5,
        };
        Self { faults: self.faults | u8::from(!good) << bit }
    }

    /// `accepted` if every check was good, or else the first reason why not.
    #[inline]
    pub(crate) fn judge<T>(self, accepted: T) -> Result<T, Rejection> {
        // Opaque to the optimiser, which might otherwise move a CRC into the branch that needs its result.
        match black_box(self.faults).trailing_zeros() {
            0 => Err(Rejection::Length),
            1 => Err(Rejection::Crc),
            2 => Err(Rejection::PositionCrc),
            3 => Err(Rejection::Identifier),
            4 => Err(Rejection::Window),
            5 => Err(Rejection::Command),
            _ => Ok(accepted),
        }
    }
}
