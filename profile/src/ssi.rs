//! The request by which a flight controller says what it wants to read next.
//!
//! SSI is SPI mode 0, most significant bit first, with the flight controller as controller; one transaction per control cycle,
//! full duplex. While the DPR shows the window that the transaction before asked for, it takes a request for the next:
//!
//! | bytes | request (8) |
//! |---|---|
//! | 0..2 | u16 offset, the first byte of the [image](crate::image) to show |
//! | 2..4 | u16 length, bytes |
//! | 4..8 | [frame CRC](crate::crc) over 0..4 |
//!
//! Eight bytes 0x00 ask for nothing, and so do eight bytes 0xFF, which is what the DPR reads from a MOSI line that nobody
//! drives. After a transaction that asked for nothing the window is the whole image, from its start: a request holds for
//! one transaction.
//!
//! Neither can be mistaken for a request. The CRC of four bytes 0x00 is not 0. Eight bytes 0xFF do carry a valid CRC
//! (the initial value 0xFFFFFFFF XORed with four bytes 0xFF is 0, of which the final XOR makes four bytes 0xFF), but would
//! ask for 65535 bytes from offset 65535, and no image is that long. No other object has the length at which this happens.
use core::ops::Range;

use crate::{Rejection, crc, rejection::Findings};

/// Bytes of a request.
pub const REQUEST_SIZE: usize = 8;

/// The window of the image that the next transaction shall show.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Request {
    /// Its first byte in the image.
    pub offset: u16,
    /// Its bytes, at least one.
    pub length: u16,
}

impl Request {
    /// Which bytes of the image it is.
    #[must_use]
    pub fn window(self) -> Range<usize> {
        let offset = usize::from(self.offset);
        offset..offset + usize::from(self.length)
    }
}

/// What a request that was accepted asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Parsed {
    /// Nothing: the next transaction shows the whole image, from its start.
    Nothing,
    /// That window, which lies in the image.
    Window(Request),
}

/// The request in `bytes`, to a DPR whose image is `image_len` bytes.
///
/// # Errors
///
/// [`Rejection::Crc`] if it is damaged; [`Rejection::Window`] if the window is empty or does not lie in the image.
///
/// ```
/// use profile::{Rejection, ssi::{self, Parsed, Request}};
///
/// let request = Request { offset: 32, length: 64 };
/// assert_eq!(ssi::parse(&ssi::encode(request), 276), Ok(Parsed::Window(request)));
/// assert_eq!(ssi::parse(&ssi::encode(request), 95), Err(Rejection::Window));
/// assert_eq!(ssi::parse(&[0; 8], 276), Ok(Parsed::Nothing));
/// assert_eq!(ssi::parse(&[0xFF; 8], 276), Ok(Parsed::Nothing));
/// ```
pub fn parse(bytes: &[u8; REQUEST_SIZE], image_len: usize) -> Result<Parsed, Rejection> {
    let [offset_low, offset_high, length_low, length_high, ..] = *bytes;
    let request = Request {
        offset: u16::from_le_bytes([offset_low, offset_high]),
        length: u16::from_le_bytes([length_low, length_high]),
    };
    let inside = request.length > 0 && request.window().end <= image_len;
    let nothing = matches!(u64::from_ne_bytes(*bytes), 0 | u64::MAX);
    Findings::new()
        .check(crc::frame_intact(bytes) | nothing, Rejection::Crc)
        .check(inside | nothing, Rejection::Window)
        .judge(if nothing { Parsed::Nothing } else { Parsed::Window(request) })
}

/// `request` as on the wire, its CRC computed.
#[must_use]
pub fn encode(request: Request) -> [u8; REQUEST_SIZE] {
    let [o0, o1] = request.offset.to_le_bytes();
    let [l0, l1] = request.length.to_le_bytes();
    let [c0, c1, c2, c3] = crc::frame(&[o0, o1, l0, l1]).to_be_bytes();
    [o0, o1, l0, l1, c0, c1, c2, c3]
}
