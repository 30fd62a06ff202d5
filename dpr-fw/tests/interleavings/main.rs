//! Tests the rotation of the receive buffers and the hand-over to the SSI in every order in which tasks, DMA, the
//! flight controller, the air and the timers can meet.
//!
//! # What is explored
//!
//! The real types of the library ([`dpr_fw::triple`], [`dpr_fw::publish`]) run on a model of the hardware
//! ([`hardware`]), in tasks with the firmware's priorities ([`board`]). [`explorer`] tries every continuation wherever
//! more than one is possible, and recognises a state by a digest of everything on which the future depends. Every half
//! of a buffer carries the number of its frame or generation. So the commit task and the SPIS's EasyDMA notice a half
//! that is torn, stale, or not scrubbed.
//!
//! | who | steps |
//! |---|---|
//! | tasks | each critical section, each register access; a higher task runs where it is called and not masked |
//! | flight controller | selects, and deselects at any time, also before it has clocked in a whole request |
//! | EasyDMA | carries each half of a transaction, out and in, and each half of a frame, at any time in between |
//! | air | a frame ends or is lost |
//! | timers | the deadline of the next frame; both compares of the expiry; the end of the pause after a transaction |
//! | RAM | a bit gets stuck; a store that no fence holds back comes late |
//!
//! Two halves stand for all words of a buffer. They suffice, because the processor and EasyDMA both access a buffer
//! from its start to its end. The two therefore meet at a single point of the buffer, with one half before that point
//! and one after it.
//!
//! loom explores threads on the memory model of C11. These tests have no threads: interrupts of one core, which have
//! priorities and run to their end, meet hardware that runs no program.
//!
//! # What is not shown
//!
//! The search considers the order of events, but not their instants. So it also explores orders that cannot happen on
//! silicon, because one step takes longer than another. There are two exceptions: a compare does not come when its
//! timer was just cleared, and the second compare comes later than the SSI task takes. Review, and the bench, which
//! runs the image, show that `hw/ssi.rs` makes the accesses of [`board`]'s port in the same order. A fence cannot be
//! executed, so a missing fence is explored as the late store or early load that it would allow. The budget of
//! transactions is larger than a search can be.

mod board;
mod explorer;
mod hardware;
mod hold;

use board::OneRun;
use explorer::{Counterexample, Explored, Explorer};

const LEN: usize = 4 * dpr_fw::IMAGE_WORDS;
const HALF_BYTES: usize = 4 * (dpr_fw::IMAGE_WORDS / 2);

/// How often each event may happen in a search, and which rule is broken on purpose.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    frames: u8,
    /// The number of deadlines that may pass; each brings an image without objects.
    deadlines: u8,
    transactions: u8,
    expiries: u8,
    /// The number of bits that may get stuck, in any buffer from number `stick_from` on.
    sticks: u8,
    stick_from: usize,
    /// Whether the commit task publishes images: one at the start, and one for each frame and each deadline.
    publishes: bool,
    mutation: Mutation,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mutation {
    None,
    /// Mutation: the newer one of two waiting frames is read first.
    RotationOrder,
    NoScrub,
    /// Mutation: a scrub does not report the stuck bit that it found, so the buffer stays in use.
    FaultyUsedAgain,
    /// Mutation: a store to the image may come after the release of that image.
    NoFenceBeforeRelease,
    /// Mutation: the received bytes may be loaded before the end of the transaction is known.
    NoFenceAfterEnd,
    /// Mutation: FRESH rises when the image is published, before the commit task has taken back the image that the SPIS
    /// has.
    FreshBeforeTaken,
    /// Mutation: FRESH rises after the image is released instead of before.
    FreshAfterRelease,
    /// Mutation: the event END is read before the semaphore.
    EndBeforeSemaphore,
    /// Mutation: an image that was announced during a transaction is released without a check whether it has expired.
    ExpiryNotAskedAgain,
    ReleasedAfterExpiry,
    NoSecondCompare,
    /// Mutation: the event of the expiry timer's compare is cleared before the timer.
    EventClearedBeforeTimer,
    /// Mutation: there is no pause after a transaction, so each end of a transaction calls the SSI task.
    NoPause,
    /// Mutation: a pause begins although its compare is not set, so the pause never ends.
    PauseWithoutEnd,
    /// Mutation: a new pause begins without clearing the event of the previous pause's end, which then ends the new
    /// pause.
    OldPauseEndKept,
}

/// The bounds of the search for images, transactions and expiry: three generations.
const HAND_OVER: Bounds = Bounds {
    frames: 0,
    deadlines: 2,
    transactions: 2,
    expiries: 1,
    sticks: 0,
    stick_from: hardware::RECEIVE,
    publishes: true,
    mutation: Mutation::None,
};

/// The bounds of the search for receive buffers alone: two frames more than there are buffers.
const ROTATION: Bounds = Bounds {
    frames: 5,
    deadlines: 0,
    transactions: 0,
    expiries: 0,
    sticks: 0,
    stick_from: 0,
    publishes: false,
    mutation: Mutation::None,
};

fn explore(bounds: Bounds) -> Result<Explored, Counterexample> {
    Explorer::explore(|explorer| OneRun::new(explorer, bounds).run())
}

/// Explores all orders, expects no broken rule, and compares the number of states with the documented one.
fn has_no_counterexample(bounds: Bounds, states: usize) {
    let explored = explore(bounds).expect("no rule is broken");
    assert_eq!(explored.states, states, "docs/decisions/0012-exhaustive-interleavings.md gives this number, too");
}

/// Asserts that with this mutation the search finds a run that breaks `rule`.
fn breaks(mutation: Mutation, bounds: Bounds, rule: &str) {
    let counterexample = explore(Bounds { mutation, ..bounds }).expect_err("a rule is broken");
    assert_eq!(counterexample.broken, rule, "{counterexample:?}");
}

// Shows IMG-7.
#[test]
fn a_transaction_reads_the_announced_image_whole_and_in_time_or_nothing() {
    has_no_counterexample(HAND_OVER, 719_412);
}

#[test]
fn three_transactions_each_show_what_the_one_before_has_asked_for() {
    has_no_counterexample(Bounds { deadlines: 1, transactions: 3, expiries: 2, ..HAND_OVER }, 404_381);
}

#[test]
fn an_image_whose_bit_gets_stuck_is_not_filled_again() {
    has_no_counterexample(Bounds { transactions: 1, expiries: 0, sticks: 1, ..HAND_OVER }, 76_398);
}

// Shows IMG-6.
#[test]
fn every_frame_is_received_into_zeros_and_read_once_in_order() {
    has_no_counterexample(ROTATION, 9_641);
}

#[test]
fn a_receive_buffer_whose_bit_gets_stuck_is_not_written_again() {
    has_no_counterexample(Bounds { frames: 4, sticks: 1, stick_from: 0, ..ROTATION }, 33_992);
}

#[test]
fn what_arrives_is_what_the_flight_controller_reads_or_nothing() {
    has_no_counterexample(Bounds { frames: 2, deadlines: 0, transactions: 1, expiries: 0, ..HAND_OVER }, 204_596);
}

#[test]
fn frames_read_in_another_order_are_found() {
    breaks(Mutation::RotationOrder, ROTATION, "frames are not read once each, in their order");
}

#[test]
fn a_missing_scrub_is_found_in_either_set() {
    breaks(Mutation::NoScrub, ROTATION, "a frame is received over old data");
    breaks(Mutation::NoScrub, HAND_OVER, "an image is filled over old data");
}

#[test]
fn a_faulty_buffer_that_is_used_again_is_found_in_either_set() {
    let rule = "a buffer with a stuck bit stays in use";
    breaks(Mutation::FaultyUsedAgain, Bounds { sticks: 1, ..ROTATION }, rule);
    breaks(Mutation::FaultyUsedAgain, Bounds { sticks: 1, expiries: 0, ..HAND_OVER }, rule);
}

#[test]
fn a_missing_fence_before_the_release_is_found() {
    breaks(Mutation::NoFenceBeforeRelease, HAND_OVER, "a transaction reads bytes that are not written");
}

#[test]
fn a_missing_fence_after_the_end_is_found() {
    let rule = "a transaction shows another window than the one before it asked for";
    breaks(Mutation::NoFenceAfterEnd, HAND_OVER, rule);
}

#[test]
fn fresh_before_the_old_image_is_taken_is_found() {
    let rule = "a transaction reads an older image than FRESH has told of";
    breaks(Mutation::FreshBeforeTaken, HAND_OVER, rule);
}

#[test]
fn fresh_after_the_release_is_found() {
    breaks(Mutation::FreshAfterRelease, HAND_OVER, "a transaction reads an image that FRESH has not told of");
}

#[test]
fn to_ask_for_the_end_before_the_semaphore_is_found() {
    let rule = "a transaction shows another window than the one before it asked for";
    breaks(Mutation::EndBeforeSemaphore, HAND_OVER, rule);
}

#[test]
fn an_expiry_that_is_not_checked_again_after_a_transaction_is_found() {
    breaks(Mutation::ExpiryNotAskedAgain, HAND_OVER, "an expired image is readable");
}

#[test]
fn a_release_after_expiry_is_found() {
    breaks(Mutation::ReleasedAfterExpiry, HAND_OVER, "an expired image is readable");
}

#[test]
fn a_missing_second_compare_is_found() {
    breaks(Mutation::NoSecondCompare, HAND_OVER, "an expired image is readable");
}

#[test]
fn a_compare_event_that_is_cleared_before_its_timer_is_found() {
    breaks(Mutation::EventClearedBeforeTimer, HAND_OVER, "the newest image is not readable");
}

#[test]
fn a_transactions_end_that_calls_the_task_within_the_pause_is_found() {
    let rule = "the end of a transaction calls the task within the pause";
    breaks(Mutation::NoPause, HAND_OVER, rule);
    breaks(Mutation::OldPauseEndKept, HAND_OVER, rule);
}

// Shows WAY-4.
#[test]
fn a_pause_without_an_end_is_found() {
    breaks(Mutation::PauseWithoutEnd, HAND_OVER, "a pause has no end");
}
