//! Decides which window the flight controller reads next, and how many transactions it may make.
//!
//! # Design
//!
//! A transaction shows the window of the [map](profile::map) that the previous transaction asked for. If the previous
//! one made no valid request, it shows the map from its start. A request is eight bytes with a CRC; eight bytes 0x00 or
//! 0xFF (an undriven line) are no request.
//!
//! Only the request is judged here, because the next transaction waits for the result. The port task, of low priority,
//! judges the other bytes ([`port`](crate::port)).
//!
//! The SSI interrupt has the highest priority, so a flight controller that selects and deselects the DPR in a loop
//! could keep the RFID side from running. The peripheral reports the end of every granted transaction, even of one
//! without bytes. Two bounds hold for granted transactions:
//!
//! - The pause [`PAUSE_US`]: after the task has served the end of one transaction, the end of the next does not call it
//!   before this time is over. A timer unmasks the events that call the task. Meanwhile the shortcut from END to
//!   ACQUIRE has taken the buffers from the peripheral, so the flight controller reads 0xFF. So the task runs at most
//!   once between the last bit of a frame and its image, whatever the flight controller does.
//! - [`Budget`] counts the granted transactions. When it is used up, no more are granted until the next image is
//!   published. This bounds the load of the SSI task and of the port task.

use core::ops::Range;

use profile::{
    ssi::{self, Parsed, REQUEST_SIZE},
    Uplink, Violation,
};

/// The number of bytes after the object that must stay idle, since a transaction may write only one object.
pub const BEYOND_BYTES: usize = 8;

/// The number of bytes that a transaction can bring in. The peripheral drops all later bytes.
pub const RECEIVE_BYTES: usize = REQUEST_SIZE + Uplink::SIZE + BEYOND_BYTES;

/// The memory for the bytes that a transaction brings in.
pub type ReceiveArea = [u32; RECEIVE_BYTES / 4];

const _: () = assert!(RECEIVE_BYTES.is_multiple_of(4));

/// The request that a transaction made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    /// The transaction made no request.
    Nothing,
    /// The transaction asked for a window of the map.
    Window,
    /// The transaction was too short for a request. Whether that is a violation depends on the bytes that it brought.
    Short,
    /// The transaction made a damaged or forbidden request.
    Refused(Violation),
}

/// The window of a map of `LEN` bytes that the next transaction shows.
#[derive(Clone, Copy, Debug, Default)]
pub struct Windows<const LEN: usize> {
    next: Option<ssi::Request>,
}

impl<const LEN: usize> Windows<LEN> {
    /// Returns the state in which the next transaction shows the whole map.
    #[must_use]
    pub const fn new() -> Self {
        Self { next: None }
    }

    /// Records the end of a transaction during which the bytes `mosi` came in. The request in them decides what the
    /// next transaction shows.
    pub fn transaction(&mut self, mosi: &[u8]) -> Asked {
        let (asked, next) = match mosi.first_chunk().map(|request| ssi::parse(request, LEN)) {
            Some(Ok(Parsed::Nothing)) => (Asked::Nothing, None),
            Some(Ok(Parsed::Window(request))) => (Asked::Window, Some(request)),
            Some(Err(rejection)) => (Asked::Refused(Violation::of_request(rejection)), None),
            None => (Asked::Short, None),
        };
        self.next = next;
        asked
    }

    /// Returns the bytes of the map that the next transaction shows.
    #[must_use]
    pub fn window(&self) -> Range<usize> {
        self.next.map_or(0..LEN, |request| {
            let start = usize::from(request.offset);
            start..start + usize::from(request.length)
        })
    }
}

/// The pause after the end of a transaction, µs, in which the end of another transaction does not call the SSI task. It
/// is longer than the time from a frame's last bit to its image, even if the SSI task runs once in that time
/// (docs/timing.md#sums). The pause begins when the SSI task has served a transaction. It is over before another
/// transaction of 96 bytes can end with the least spacing ([`ssi::timing::SPACING_NS`]).
pub const PAUSE_US: u32 = 95;

// Shows WAY-4.
const _: () = assert!(PAUSE_US * 1_000 + ssi::timing::GAP_NS < ssi::timing::SPACING_NS);

/// The number of transactions that are granted between two publications. A control cycle of 1 ms needs ten in 10 ms.
/// Each takes 7 µs of interrupt, and 10 to 20 µs of the port task, so the processor's load stays below a tenth whatever
/// the flight controller does (on the bench's fast clock: `bench/tests/babble.rs`, `ports.rs`).
pub const BUDGET: u32 = 16;

/// The number of transactions that may still be granted until the next image is published.
#[derive(Clone, Copy, Debug)]
pub struct Budget(u32);

impl Default for Budget {
    fn default() -> Self {
        Self::new()
    }
}

impl Budget {
    /// Returns a budget of [`BUDGET`] transactions.
    #[must_use]
    pub const fn new() -> Self {
        Self(BUDGET)
    }

    /// Uses one transaction up, and returns whether it was the last.
    pub fn spend(&mut self) -> bool {
        // Not covered: only this line, the limit at 0: a transaction is granted only while the budget is left.
        self.0 = self.0.saturating_sub(1);
        self.0 == 0
    }

    /// Whether another transaction may be granted.
    #[must_use]
    pub const fn is_left(&self) -> bool {
        self.0 > 0
    }
}

/// Decides when the SSI task is called only to check in, because no transaction has called it for a cycle. A
/// transaction in progress postpones the call, which might delay the transaction's end. It does so for at most
/// [`SignOfLife::MOST`] cycles, because a flight controller that never deselects the DPR must not make the watchdog
/// bite.
#[derive(Clone, Copy, Debug, Default)]
pub struct SignOfLife {
    transactions: u32,
    waited: u32,
}

impl SignOfLife {
    /// The number of cycles, of 12.5 ms at most, for which the SSI task is not called during a transaction. The call
    /// comes in the cycle after these, after 50 ms at most: half of the watchdog's 100 ms.
    pub const MOST: u32 = 3;

    /// Returns the state at the start. The start has taken up to a third of the watchdog's time. So a transaction that
    /// is in progress at the start is waited for during one cycle only.
    #[must_use]
    pub const fn new() -> Self {
        Self { transactions: 0, waited: Self::MOST - 1 }
    }

    /// Whether to call the SSI task so that it checks in, given the number of transactions so far. To be asked once a
    /// cycle.
    pub fn is_due(&mut self, transactions: u32, is_selected: bool) -> bool {
        let has_come = transactions != self.transactions;
        self.transactions = transactions;
        let waits = has_come || is_selected && self.waited < Self::MOST;
        self.waited = if waits && !has_come { self.waited + 1 } else { 0 };
        !waits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use profile::ssi::{encode, Request};
    use proptest::prelude::*;

    #[test]
    fn a_receive_area_holds_a_request_an_object_and_eight_bytes_more() {
        assert_eq!(RECEIVE_BYTES, 8 + 64 + 8);
    }

    // Shows SSI-2.
    #[test]
    fn a_request_opens_its_window_for_one_transaction() {
        let mut windows = Windows::<468>::new();
        assert_eq!(windows.window(), 0..468);
        let mut mosi = [0; RECEIVE_BYTES];
        mosi[..8].copy_from_slice(&encode(Request { offset: 276, length: 192 }));
        assert_eq!(windows.transaction(&mosi), Asked::Window);
        assert_eq!(windows.window(), 276..468);
        assert_eq!(windows.transaction(&[0; RECEIVE_BYTES]), Asked::Nothing);
        assert_eq!(windows.window(), 0..468);
    }

    #[test]
    fn bytes_beyond_the_request_are_not_looked_at() {
        let mut mosi = [0xA5; RECEIVE_BYTES];
        mosi[..8].fill(0);
        let mut windows = Windows::<276>::new();
        assert_eq!(windows.transaction(&mosi), Asked::Nothing);
        assert_eq!(windows.window(), 0..276);
    }

    #[test]
    fn a_transaction_too_short_for_a_request_takes_a_window_back() {
        for short in 0..8 {
            let mut windows = Windows::<276>::new();
            let request = encode(Request { offset: 96, length: 60 });
            assert_eq!(windows.transaction(&request), Asked::Window);
            assert_eq!(windows.window(), 96..156);
            assert_eq!(windows.transaction(&request[..short]), Asked::Short);
            assert_eq!(windows.window(), 0..276);
        }
    }

    #[test]
    fn an_undriven_line_asks_for_nothing_and_ends_the_window() {
        for idle in [0x00, 0xFF] {
            let mut windows = Windows::<276>::new();
            assert_eq!(windows.transaction(&encode(Request { offset: 96, length: 60 })), Asked::Window);
            assert_eq!(windows.window(), 96..156);
            assert_eq!(windows.transaction(&[idle; RECEIVE_BYTES]), Asked::Nothing);
            assert_eq!(windows.window(), 0..276);
        }
    }

    #[test]
    fn a_refused_request_takes_a_window_back_and_says_why() {
        let outside = encode(Request { offset: 200, length: 77 });
        let empty = encode(Request { offset: 0, length: 0 });
        let damaged = [1, 2, 3, 4, 5, 6, 7, 8];
        for (request, violation) in [
            (outside, Violation::WindowOutside),
            (empty, Violation::WindowOutside),
            (damaged, Violation::RequestDamaged),
        ] {
            let mut windows = Windows::<276>::new();
            windows.transaction(&encode(Request { offset: 96, length: 60 }));
            assert_eq!(windows.transaction(&request), Asked::Refused(violation));
            assert_eq!(windows.window(), 0..276);
        }
    }

    proptest! {
        // Shows SSI-3.
        #[test]
        fn whatever_is_clocked_in_the_window_lies_in_the_map(
            offset: u16, length: u16, damage: bool, garbage: [u8; 8],
        ) {
            let mut windows = Windows::<156>::new();
            let mosi = if damage { garbage } else { encode(Request { offset, length }) };
            let asked = windows.transaction(&mosi);
            let window = windows.window();
            prop_assert!(window.start < window.end && window.end <= 156);
            if !damage {
                let inside = length > 0 && usize::from(offset) + usize::from(length) <= 156;
                // A request for no bytes, (0, 0), has a CRC other than zero, so it does not look like an idle line.
                let expected = match inside {
                    true => Asked::Window,
                    false if mosi == [0xFF; 8] => Asked::Nothing,
                    false => Asked::Refused(Violation::WindowOutside),
                };
                prop_assert_eq!(asked, expected);
            }
        }
    }

    #[test]
    fn the_task_is_called_to_check_in_when_no_transaction_calls_it() {
        let mut sign = SignOfLife::new();
        assert!(!sign.is_due(0, true) && sign.is_due(0, true), "one is under way since before the start");
        let mut sign = SignOfLife::new();
        assert!(sign.is_due(0, false) && sign.is_due(0, false), "nobody reads");
        assert!(!sign.is_due(1, false) && !sign.is_due(2, true), "transactions came");
        assert!(sign.is_due(2, false), "and then none");
        for _ in 0..2 {
            assert!((0..SignOfLife::MOST).all(|_| !sign.is_due(2, true)), "one is under way");
            assert!(sign.is_due(2, true), "for too long");
        }
        assert!(!sign.is_due(2, true) && !sign.is_due(3, true));
        assert!((0..SignOfLife::MOST).all(|_| !sign.is_due(3, true)), "another one");
        assert!(sign.is_due(3, true));
    }

    // Shows WAY-3.
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
