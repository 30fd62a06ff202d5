//! A receiver's UART.
//!
//! The receiver's input tolerates a sender whose bit rate is wrong by 2.5 % (ZED-F9R data sheet, UART specifications).
//! After more than 100 unreadable frames within a second the receiver ignores its input until that second is over
//! (u-blox F9 integration manuals, "UART interfaces").

use std::collections::VecDeque;

use emulator_part::{Pin, UartFrame, UartParity};
use horus_tx_fw::timing::GNSS_BAUD;

use emulator_node::Input;

/// A bit may be longer or shorter by one part in this number, 2.5 %.
const TOLERANCE: u64 = 40;
/// The number of unreadable frames in [`ERROR_WINDOW`] that the receiver accepts. After more it ignores its input until
/// the window ends.
const MOST_ERRORS: u32 = 100;
const ERROR_WINDOW: u64 = 1_000_000_000;

#[derive(Clone, Debug)]
pub(super) struct Uart {
    pub(super) to_part: Pin,
    pub(super) from_part: Pin,
    waiting: VecDeque<UartFrame>,
    free_at: u64,
    /// The duration of a bit at the rate to which the receiver's input is set, ps.
    bit_ps: u64,
    /// The beginning of the present [`ERROR_WINDOW`], ns, and the number of unreadable frames in it.
    errors: (u64, u32),
}

impl Uart {
    pub(super) fn new(to_part: Pin, from_part: Pin) -> Self {
        let bit_ps = UartFrame::eight_n_one(0, GNSS_BAUD).bit_ps;
        Self { to_part, from_part, waiting: VecDeque::new(), free_at: 0, bit_ps, errors: (0, 0) }
    }

    /// Queues `frames` at `at` (ns) and returns the instant, ns, at which the first of them begins.
    pub(super) fn send(&mut self, at: u64, frames: impl IntoIterator<Item = UartFrame>) -> u64 {
        if self.waiting.is_empty() {
            self.free_at = self.free_at.max(at);
        }
        let before: u64 = self.waiting.iter().map(UartFrame::ns).sum();
        self.waiting.extend(frames);
        self.free_at + before
    }

    pub(super) fn listen_at(&mut self, baud: u32) {
        self.bit_ps = UartFrame::eight_n_one(0, baud.max(1)).bit_ps;
    }

    /// Returns the byte that the receiver reads, `Some(None)` for an unreadable frame, or `None` while it ignores its
    /// input.
    pub(super) fn hears(&mut self, at: u64, frame: &UartFrame) -> Option<Option<u8>> {
        if at >= self.errors.0 + ERROR_WINDOW {
            self.errors = (at, 0);
        }
        if self.errors.1 > MOST_ERRORS {
            return None;
        }
        let readable = frame.bits == 8
            && frame.parity == UartParity::None
            && frame.stop_halves >= 2
            && frame.bit_ps.abs_diff(self.bit_ps) * TOLERANCE <= self.bit_ps;
        if !readable {
            self.errors.1 += 1;
        }
        Some(readable.then_some(frame.data as u8))
    }

    pub(super) fn next_at(&self) -> u64 {
        if self.waiting.is_empty() { u64::MAX } else { self.free_at }
    }

    pub(super) fn settle(&mut self, at: u64, inputs: &mut Vec<Input>) {
        while self.free_at <= at
            && let Some(frame) = self.waiting.pop_front()
        {
            inputs.push(Input::Frame(self.to_part, self.free_at, frame));
            self.free_at += frame.ns();
        }
    }
}
