//! The times of a cycle.
//!
//! A timer raises a *beat* every 25 ms. The first beat of a cycle is the *tick*, at which the firmware takes its
//! sample. The *slot*, a constant time after the tick, is the instant at which the firmware sends the transmit command
//! for the frame. So the time from the tick to the frame's first bit does not depend on the data or on how long the
//! work before the slot takes.
//!
//! In the diagram, `fill, seal, load head` is the task `cycle`, and `sensors` is the task that reads the sensors.
//!
//! ```text
//! tick k       slot                                      beat 1      beat 2      beat 3      tick k+1
//!   |-- fill, seal, load head --|== frame == answer ==|    | sensors   |           | sensors   |
//! ```

use profile::hold;

/// The time between two beats, ms. Each task checks in at least three times within the watchdog's 100 ms.
pub const BEAT_MS: u32 = 25;

/// The number of beats in a cycle.
pub const BEATS: u32 = hold::PERIOD_MS / BEAT_MS;

/// The number of cycles in a second.
pub const CYCLES_PER_SECOND: u32 = 1_000 / hold::PERIOD_MS;

/// The time from the tick to the transmit command, µs. In between, the firmware fills and seals Hold-Status and loads
/// the first 16 bytes, which takes about 0.1 ms at most.
pub const SLOT_US: u32 = 500;

const _: () = {
    assert!(BEATS * BEAT_MS == hold::PERIOD_MS);
    // An exchange ends before the next beat, which calls the task `sensors`.
    assert!(SLOT_US as u64 * 1_000 + hold::EXCHANGE_NS < BEAT_MS as u64 * 1_000_000);
};

/// Returns the timestamp of cycle `tick`, ms since the start; it wraps.
#[must_use]
pub const fn timestamp(tick: u32) -> u32 {
    tick.wrapping_mul(hold::PERIOD_MS)
}
