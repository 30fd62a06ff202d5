//! The request that the flight controller sends over SSI.
use crate::{Rejection, crc};

/// Bytes of a request.
pub const REQUEST_SIZE: usize = 8;

/// The window that the next transaction shall show.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Request {
    /// First byte of the window in the image.
    pub offset: u16,
    /// Bytes of the window.
    pub length: u16,
}

/// A request that was understood.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Parsed {
    /// Eight zero bytes: asks for nothing.
    Nothing,
    /// Asks for that window in the next transaction.
    Window(Request),
}

/// The request in `bytes` to a DPR whose image is `image_len` bytes.
///
/// # Errors
///
/// [`Rejection::Crc`] if damaged, [`Rejection::Window`] if it does not lie in the image or is empty.
pub fn parse(bytes: &[u8; REQUEST_SIZE], image_len: usize) -> Result<Parsed, Rejection> {
    let [o0, o1, l0, l1, ..] = *bytes;
    let request = Request {
        offset: u16::from_le_bytes([o0, o1]),
        length: u16::from_le_bytes([l0, l1]),
    };
    let intact = crc::frame_intact(bytes);
    let nothing = u64::from_ne_bytes(*bytes) == 0;
    let end = usize::from(request.offset) + usize::from(request.length);
    let inside = request.length > 0 && end <= image_len;
    if nothing {
        Ok(Parsed::Nothing)
    } else if !intact {
        Err(Rejection::Crc)
    } else if !inside {
        Err(Rejection::Window)
    } else {
        Ok(Parsed::Window(request))
    }
}

/// The bytes of `request`, CRC computed.
#[must_use]
pub fn encode(request: Request) -> [u8; REQUEST_SIZE] {
    let [o0, o1] = request.offset.to_le_bytes();
    let [l0, l1] = request.length.to_le_bytes();
    let [c0, c1, c2, c3] = crc::frame(&[o0, o1, l0, l1]).to_be_bytes();
    [o0, o1, l0, l1, c0, c1, c2, c3]
}
