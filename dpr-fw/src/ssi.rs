//! What the flight controller asks for, and how much it may ask.
//!
//! # Design
//!
//! A transaction shows the window that the transaction before it asked for, and the image from its start if that asked
//! for nothing. A request is eight bytes with a CRC; eight bytes 0x00, or 0xFF (an undriven line), ask for nothing.
//! Anything else (a damaged request, one that reaches beyond the image) is counted as an access violation, and the next
//! transaction shows the image from its start. What follows the request is the uplink area: it has its place in the
//! receive memory, so it changes nothing else, and it is not evaluated yet.
//!
//! The SSI interrupt stands above all others, so a flight controller that selects and deselects the DPR in a loop could
//! keep the RFID side from running. The peripheral reports the end of granted transactions only: [`Budget`] counts
//! those, and when they are used up the buffer is not granted again until the next image is published. Meanwhile the
//! flight controller reads 0xFF.

use core::ops::Range;

use profile::ssi::{self, Parsed, REQUEST_SIZE};

/// Bytes that a transaction can bring in: request and one uplink object of 64 bytes. What else is clocked in is dropped
/// by the peripheral.
pub const RECEIVE_BYTES: usize = REQUEST_SIZE + 64;

/// What a transaction asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    /// Nothing, or a window of the image.
    Granted,
    /// What it may not have.
    Violation,
}

/// The windows of an image of `LEN` bytes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Windows<const LEN: usize> {
    next: Option<ssi::Request>,
}

impl<const LEN: usize> Windows<LEN> {
    /// The whole image.
    #[must_use]
    pub const fn new() -> Self {
        Self { next: None }
    }

    /// A transaction is over, in which `mosi` came in. Its request decides what the next one shows.
    pub fn transaction(&mut self, mosi: &[u8]) -> Asked {
        let (asked, next) = match mosi.first_chunk() {
            Some(request) => match ssi::parse(request, LEN) {
                Ok(Parsed::Nothing) => (Asked::Granted, None),
                Ok(Parsed::Window(request)) => (Asked::Granted, Some(request)),
                Err(_) => (Asked::Violation, None),
            },
            // Too short for a request, but a line that nobody drives asks for nothing, however long.
            None if [0x00, 0xFF].iter().any(|idle| mosi.iter().all(|byte| byte == idle)) => (Asked::Granted, None),
            None => (Asked::Violation, None),
        };
        self.next = next;
        asked
    }

    /// The bytes of the image that the next transaction shows.
    #[must_use]
    pub fn window(&self) -> Range<usize> {
        self.next.map_or(0..LEN, |request| {
            let start = usize::from(request.offset);
            start..start + usize::from(request.length)
        })
    }
}

/// Transactions that are granted between two publications: 10 ms apart, a control cycle of 1 ms needs ten. At 3 µs of
/// interrupt each, a runaway flight controller takes less than 1 % of the processor.
pub const BUDGET: u32 = 32;

/// How many transactions may still be granted.
#[derive(Clone, Copy, Debug)]
pub struct Budget(u32);

impl Default for Budget {
    fn default() -> Self {
        Self::new()
    }
}

impl Budget {
    /// [`BUDGET`].
    #[must_use]
    pub const fn new() -> Self {
        Self(BUDGET)
    }

    /// Uses one. Tells whether it was the last.
    pub fn spend(&mut self) -> bool {
        self.0 = self.0.saturating_sub(1);
        self.0 == 0
    }

    /// Whether another may be granted.
    #[must_use]
    pub const fn is_left(&self) -> bool {
        self.0 > 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use profile::ssi::{encode, Request};
    use proptest::prelude::*;

    #[test]
    fn a_transaction_brings_in_a_request_of_8_bytes_and_an_uplink_object_of_64() {
        assert_eq!(RECEIVE_BYTES, 8 + 64);
    }

    #[test]
    fn a_request_opens_its_window_for_one_transaction() {
        let mut windows = Windows::<276>::new();
        assert_eq!(windows.window(), 0..276);
        let mut mosi = [0; RECEIVE_BYTES];
        mosi[..8].copy_from_slice(&encode(Request { offset: 96, length: 180 }));
        assert_eq!(windows.transaction(&mosi), Asked::Granted);
        assert_eq!(windows.window(), 96..276);
        assert_eq!(windows.transaction(&[0; RECEIVE_BYTES]), Asked::Granted);
        assert_eq!(windows.window(), 0..276);
    }

    #[test]
    fn bytes_beyond_the_request_change_nothing() {
        let mut mosi = [0xA5; RECEIVE_BYTES];
        mosi[..8].fill(0);
        let mut windows = Windows::<276>::new();
        assert_eq!(windows.transaction(&mosi), Asked::Granted);
        assert_eq!(windows.window(), 0..276);
    }

    #[test]
    fn a_transaction_too_short_for_a_request_may_only_show_an_idle_line() {
        let mut windows = Windows::<276>::new();
        assert_eq!(windows.transaction(&[]), Asked::Granted);
        assert_eq!(windows.transaction(&[0; 7]), Asked::Granted);
        assert_eq!(windows.transaction(&[0xFF; 3]), Asked::Granted);
        assert_eq!(windows.transaction(&[0, 0, 1]), Asked::Violation);
        assert_eq!(windows.transaction(&[0xFF, 0x00]), Asked::Violation);
    }

    #[test]
    fn a_line_that_nobody_drives_asks_for_nothing_and_takes_a_window_back() {
        for idle in [0x00, 0xFF] {
            let mut windows = Windows::<276>::new();
            assert_eq!(windows.transaction(&encode(Request { offset: 96, length: 60 })), Asked::Granted);
            assert_eq!(windows.window(), 96..156);
            assert_eq!(windows.transaction(&[idle; RECEIVE_BYTES]), Asked::Granted);
            assert_eq!(windows.window(), 0..276);
        }
    }

    #[test]
    fn a_refused_request_takes_a_window_back() {
        let mut windows = Windows::<276>::new();
        windows.transaction(&encode(Request { offset: 96, length: 60 }));
        assert_eq!(windows.transaction(&encode(Request { offset: 200, length: 77 })), Asked::Violation);
        assert_eq!(windows.window(), 0..276);
    }

    proptest! {
        #[test]
        fn whatever_is_clocked_in_the_window_lies_in_the_image(
            offset: u16, length: u16, damage: bool, garbage: [u8; 8],
        ) {
            let mut windows = Windows::<156>::new();
            let mosi = if damage { garbage } else { encode(Request { offset, length }) };
            let asked = windows.transaction(&mosi);
            let window = windows.window();
            prop_assert!(window.start < window.end && window.end <= 156);
            if !damage {
                let inside = length > 0 && usize::from(offset) + usize::from(length) <= 156;
                // (0, 0) has a CRC that is not zero, so it is a request, for nothing at all.
                prop_assert_eq!(asked, if inside || mosi == [0xFF; 8] { Asked::Granted } else { Asked::Violation });
            }
        }
    }

    #[test]
    fn the_budget_ends_after_its_transactions_and_says_so_at_the_last() {
        let mut budget = Budget::new();
        for _ in 1..BUDGET {
            assert!(!budget.spend());
            assert!(budget.is_left());
        }
        assert!(budget.spend());
        assert!(!budget.is_left());
    }
}
