//! Why bytes were not accepted.
use core::{error::Error, fmt};

/// Why bytes were not accepted. Where several reasons hold, the first in this order is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Rejection {
    /// Not as long as what is expected here.
    Length,
    /// The frame CRC does not fit the bytes.
    Crc,
    /// The CRC over latitude and longitude does not fit them, though the frame CRC does.
    PositionCrc,
    /// Intact, but another object than the one whose place this is.
    Identifier,
    /// Intact, but asks for bytes outside the image.
    Window,
}

impl fmt::Display for Rejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Length => "wrong length",
            Self::Crc => "frame CRC does not match",
            Self::PositionCrc => "position CRC does not match",
            Self::Identifier => "another object's identifier",
            Self::Window => "window outside the image",
        })
    }
}

impl Error for Rejection {}
