//! Resets: their reason, the number of resets by the watchdog, and the memory that is kept over a reset
//!
//! `unsafe` is used here for the section of memory that the start leaves as it is.
#![allow(unsafe_code)]

use core::sync::atomic::{AtomicU32, Ordering};

use firmware_common::start::reset_flags;
use horus_tx_fw::{exclusions, reset};
use profile::ResetReason;

use super::HORUS_TELEMETRY;

/// Two words that survive every reset except power-on: `MAGIC`, then the number of resets by the watchdog so far.
#[link_section = ".uninit.RESETS"]
static RESETS: [AtomicU32; 2] = [const { AtomicU32::new(0) }; 2];
const MAGIC: u32 = 0x484F_5255;

/// The record of the excluded receivers, in the form of [`exclusions`].
#[link_section = ".uninit.EXCLUSIONS"]
pub(super) static EXCLUSIONS: [AtomicU32; exclusions::WORDS] = [const { AtomicU32::new(0) }; exclusions::WORDS];

/// Stores the mask of the receivers that are excluded, so that a reset does not lose it.
pub fn keep_exclusions(excluded: u8) {
    for (to, from) in EXCLUSIONS.iter().zip(exclusions::to_words(excluded)) {
        to.store(from, Ordering::Relaxed);
    }
}

/// Returns the receivers that were excluded before this start, whose reason was `reason`.
pub fn kept_exclusions(reason: ResetReason) -> u8 {
    exclusions::from_words(EXCLUSIONS.each_ref().map(|word| word.load(Ordering::Relaxed)), reason)
}

/// Counts resets by the watchdog since the supply came on. Returns the reason of this start. To be called once.
pub fn note_reason() -> ResetReason {
    let reason = reset::reason(reset_flags());
    let [magic, count] = &RESETS;
    // After power-on the memory of these two words holds arbitrary values.
    // Not covered: only this line, causes of a reset that nothing on the board requests, as in `reset::reason`.
    if magic.load(Ordering::Relaxed) != MAGIC || reason == ResetReason::PowerOn {
        magic.store(MAGIC, Ordering::Relaxed);
        count.store(0, Ordering::Relaxed);
    }
    if reason == ResetReason::Watchdog {
        // Not covered: a second try of the exclusive access: no interrupt is enabled yet.
        count.fetch_add(1, Ordering::Relaxed);
    }
    HORUS_TELEMETRY.watchdog_resets.set(count.load(Ordering::Relaxed));
    HORUS_TELEMETRY.reset_reason.set(reason as u32);
    reason
}
