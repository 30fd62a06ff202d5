//! The times of a cycle.
//!
//! A timer counts beats. The first beat of a cycle is its *tick*, at which the sample is taken; the *slot*, a constant
//! time later, is the instant at which the frame is fired. Whatever the data were and however long their load took, the
//! time from the tick to the frame's first bit is the same.
//!
//! ```text
//! tick k       slot                                      beat 1      beat 2      beat 3      tick k+1
//!   |-- fill, seal, load head --|== frame == answer ==|    | sensors   |           | sensors   |
//! ```

use profile::hold;

/// The time between two beats, ms. The watchdog has 100 ms, within which each task checks in at least three times.
pub const BEAT_MS: u32 = 25;

/// The number of beats in a cycle.
pub const BEATS: u32 = hold::PERIOD_MS / BEAT_MS;

/// The number of cycles in a second.
pub const CYCLES_PER_SECOND: u32 = 1_000 / hold::PERIOD_MS;

/// The time from the tick to the transmit command, µs. The work before it (to fill and seal one object, and to load 16
/// bytes) takes about 0.1 ms at most.
pub const SLOT_US: u32 = 500;

const _: () = {
    assert!(BEATS * BEAT_MS == hold::PERIOD_MS);
    // The exchange is over before the sensors have their turn.
    assert!(SLOT_US as u64 * 1_000 + hold::EXCHANGE_NS < BEAT_MS as u64 * 1_000_000);
};

/// Returns the time of cycle `tick`, ms since the start; it wraps together with the ticks' own time.
#[must_use]
pub const fn timestamp(tick: u32) -> u32 {
    tick.wrapping_mul(hold::PERIOD_MS)
}
