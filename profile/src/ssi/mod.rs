//! The request by which a flight controller selects what it reads next.
//!
//! SSI is SPI mode 0, most significant bit first, with the flight controller as controller. There is one transaction in
//! each control cycle, full duplex: while the DPR sends the window of the last request, it receives the request for the
//! next transaction:
//!
//! | bytes | request (8) |
//! |---|---|
//! | 0..2 | u16 offset, the first byte of the [map](crate::map) to show |
//! | 2..4 | u16 length, bytes |
//! | 4..8 | [frame CRC](crate::crc) over 0..4 |
//!
//! Eight bytes 0x00 are an empty request. So are eight bytes 0xFF, which the DPR reads from an undriven MOSI line. A
//! request holds for one transaction: after an empty one, the next transaction reads the whole map from its start.
//!
//! After the request the flight controller may write one [object](crate::uplink::Written) of 64 bytes, an uplink or a
//! command. [`port_status`](crate::port_status) defines how the DPR judges what was written.
//!
//! Neither form of the empty request can be mistaken for a request of a window. Eight bytes 0x00 are no valid request,
//! because the CRC of four bytes 0x00 is not 0. Eight bytes 0xFF have a valid CRC, but ask for 65535 bytes from offset
//! 65535, and no map is that long. (0xFFFFFFFF XOR four bytes 0xFF is 0, and the final XOR turns 0 into four bytes
//! 0xFF. Bytes 0xFF have a valid CRC at no other length.)
//!
//! # Timing
//!
//! A flight controller must keep the following bounds at the DPR's pins, behind the isolator. [`timing`] has the
//! numbers as constants.
//!
//! | what | bound | source |
//! |---|---|---|
//! | SCK | ≤ 8 MHz, each level ≥ 30 ns | nRF52840 PS v1.7, SPIS timing specifications |
//! | CSN falls to first SCK edge | ≥ 1 µs | same: 1 µs while the high-frequency clock runs, which the DPR never stops |
//! | last SCK edge to CSN rises | ≥ 2 µs | same |
//! | SCK edge to MISO valid | ≤ 19 ns | same |
//! | MOSI valid before and after the SCK edge | ≥ 59 ns, ≥ 20 ns | same |
//! | CSN rises to CSN falls | ≥ 10 µs | this project: see below |
//!
//! `docs/hardware.md` says which bounds were checked against the product specification again, and what they mean for
//! isolators.
//!
//! The DPR needs up to 10 µs after a transaction to accept the request and to pass the next buffer to its SPI
//! peripheral, which by itself needs CSN high for 0.3 µs. A transaction that begins earlier reads 0xFF throughout,
//! which no CRC accepts, and its request is lost. One transaction in each control cycle keeps this bound with a wide
//! margin.
//!
//! An isolator delays SCK on its way in and MISO on its way out. MISO must arrive before the flight controller samples
//! it, half a period after the edge that shifted it out. So half a period must be at least the sum of two delays of the
//! isolator, the DPR's 19 ns, and the set-up time of the flight controller's input: [`timing::max_clock_hz`]. For
//! optical isolators that frequency is well below 8 MHz.
//!
//! [`client`] is the flight controller's end of this protocol.
use core::ops::Range;

use crate::{Rejection, crc, rejection::Findings};

pub mod client;

/// The size of a request, bytes.
pub const REQUEST_SIZE: usize = 8;

/// Bounds of the signals on the SSI. The [module's](self) section "Timing" has their sources.
pub mod timing {
    /// The highest SCK frequency, Hz.
    pub const MAX_CLOCK_HZ: u32 = 8_000_000;
    /// The shortest time from CSN falling to the first SCK edge, ns.
    pub const CSN_SETUP_NS: u32 = 1_000;
    /// The shortest time from the last SCK edge to CSN rising, ns.
    pub const CSN_HOLD_NS: u32 = 2_000;
    /// The shortest time for which CSN must be high so that the next transaction is answered, ns.
    pub const GAP_NS: u32 = 10_000;
    /// The shortest time from the end of one transaction to the end of the next, ns, so that the DPR answers the
    /// transaction after them. It is the time of a transaction of 96 bytes at [`MAX_CLOCK_HZ`] with the gap before it.
    /// So a flight controller that reads at least 96 bytes always keeps this bound.
    pub const SPACING_NS: u32 = GAP_NS + CSN_SETUP_NS + 96 * 8 * (1_000_000_000 / MAX_CLOCK_HZ) + CSN_HOLD_NS;
    /// The longest time from the SCK edge that shifts a bit out to that bit on MISO, ns.
    pub const MISO_VALID_NS: u32 = 19;
    /// The shortest time for which MOSI must be valid before the SCK edge that samples it, ns.
    pub const MOSI_SETUP_NS: u32 = 59;
    /// The shortest time for which MOSI must be valid after the SCK edge that samples it, ns.
    pub const MOSI_HOLD_NS: u32 = 20;

    /// The highest SCK frequency, Hz, at most [`MAX_CLOCK_HZ`], through an isolator that delays each signal by up to
    /// `isolator_ns`. The flight controller's MISO input needs `setup_ns` before the sampling edge.
    ///
    /// SCK is assumed to be high and low for equal times.
    ///
    /// ```
    /// use profile::ssi::timing::{MAX_CLOCK_HZ, max_clock_hz};
    ///
    /// assert_eq!(max_clock_hz(0, 10), MAX_CLOCK_HZ);
    /// // 2 x 40 ns + 19 ns + 10 ns = 109 ns is half of 4.587 MHz's period.
    /// assert_eq!(max_clock_hz(40, 10), 4_587_155);
    /// ```
    #[must_use]
    pub const fn max_clock_hz(isolator_ns: u32, setup_ns: u32) -> u32 {
        let half_period_ns = isolator_ns.saturating_mul(2).saturating_add(MISO_VALID_NS).saturating_add(setup_ns);
        let clock_hz = 500_000_000 / half_period_ns;
        if clock_hz <= MAX_CLOCK_HZ { clock_hz } else { MAX_CLOCK_HZ }
    }
}

/// The window of the map that the next transaction shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Request {
    /// The offset of the window's first byte in the map.
    pub offset: u16,
    /// The length of the window in bytes, at least one.
    pub length: u16,
}

impl Request {
    /// The range of the window in the map.
    #[must_use]
    pub fn window(self) -> Range<usize> {
        let offset = usize::from(self.offset);
        offset..offset + usize::from(self.length)
    }

    /// Whether the window has at least one byte and lies in a map of `map_len` bytes.
    #[must_use]
    #[expect(clippy::as_conversions, reason = "both widen, and usize::from is not const")]
    pub const fn is_inside(self, map_len: usize) -> bool {
        self.length > 0 && self.offset as usize + self.length as usize <= map_len
    }
}

/// The meaning of an accepted request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Parsed {
    /// The request is empty, so the next transaction reads the whole map.
    Nothing,
    /// The request is for this window, which lies in the map.
    Window(Request),
}

/// Parses the request in `bytes`, for a map of `map_len` bytes.
///
/// # Errors
///
/// [`Rejection::Crc`] if the request is damaged; [`Rejection::Window`] if its window is empty or not in the map.
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
pub fn parse(bytes: &[u8; REQUEST_SIZE], map_len: usize) -> Result<Parsed, Rejection> {
    let [offset_low, offset_high, length_low, length_high, ..] = *bytes;
    let request = Request {
        offset: u16::from_le_bytes([offset_low, offset_high]),
        length: u16::from_le_bytes([length_low, length_high]),
    };
    let inside = request.is_inside(map_len);
    let nothing = matches!(u64::from_ne_bytes(*bytes), 0 | u64::MAX);
    Findings::new()
        .check(crc::frame_intact(bytes) | nothing, Rejection::Crc)
        .check(inside || nothing, Rejection::Window)
        .judge(if nothing { Parsed::Nothing } else { Parsed::Window(request) })
}

/// Encodes `request` with its CRC.
#[must_use]
pub fn encode(request: Request) -> [u8; REQUEST_SIZE] {
    let [o0, o1] = request.offset.to_le_bytes();
    let [l0, l1] = request.length.to_le_bytes();
    let [c0, c1, c2, c3] = crc::frame(&[o0, o1, l0, l1]).to_be_bytes();
    [o0, o1, l0, l1, c0, c1, c2, c3]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_maximum_clock_leaves_time_for_two_passes_of_the_isolator() {
        for isolator in (0..300).step_by(7) {
            for setup in [0, 5, 10, 40] {
                let needed = u64::from(2 * isolator + timing::MISO_VALID_NS + setup);
                let clock = u64::from(timing::max_clock_hz(isolator, setup));
                assert!(2 * needed * clock <= 1_000_000_000, "{isolator} {setup}");
                let faster = clock + 1;
                assert!(faster > u64::from(timing::MAX_CLOCK_HZ) || 2 * needed * faster > 1_000_000_000);
            }
        }
        assert_eq!(timing::max_clock_hz(u32::MAX, u32::MAX), 0);
    }

    #[test]
    fn a_window_must_hold_a_byte_and_lie_within_the_image() {
        let parsed = |offset, length| parse(&encode(Request { offset, length }), 276);
        for (offset, length) in [(0, 1), (0, 276), (275, 1), (96, 180)] {
            assert_eq!(parsed(offset, length), Ok(Parsed::Window(Request { offset, length })));
        }
        for (offset, length) in [(0, 0), (96, 0), (276, 0), (0, 277), (276, 1), (96, 181), (u16::MAX, 1)] {
            assert_eq!(parsed(offset, length), Err(Rejection::Window), "{offset}, {length}");
        }
    }

    // Shows SSI-4.
    #[test]
    fn a_request_with_any_wrong_bit_is_rejected() {
        assert_eq!(parse(&[0x00; 8], 276), Ok(Parsed::Nothing));
        assert_eq!(parse(&[0xFF; 8], 276), Ok(Parsed::Nothing));
        let request = u64::from_le_bytes(encode(Request { offset: 32, length: 64 }));
        for bit in 0..64 {
            let damaged = (request ^ 1 << bit).to_le_bytes();
            assert_eq!(parse(&damaged, 276).err(), Some(Rejection::Crc), "bit {bit}");
        }
    }

    #[test]
    fn the_table_of_isolators_in_the_documentation_is_what_the_formula_gives() {
        let table = [(100, 2_180_000), (55, 3_590_000), (40, 4_580_000), (22, 6_840_000), (16, 8_000_000)];
        for (isolator, clock) in table {
            let allowed = timing::max_clock_hz(isolator, 10);
            assert!((clock..clock + 10_000).contains(&allowed), "{isolator} ns: {allowed} Hz");
        }
    }
}
