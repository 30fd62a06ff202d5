//! Integrity of what HORUS stores
//!
//! # Design
//!
//! The idle loop does a [slice](firmware_common::patrol) of work every 2.5 ms, in that part of the cycle alone in which
//! it can delay neither a slot nor a tick ([`timing::quiet`](crate::timing::quiet)).
//!
//! | finding | what follows |
//! |---|---|
//! | flash is not the one that was built | safe state: the field is off, [`Cause::Flash`] |
//! | a guard word has changed | safe state, [`Cause::GuardWord`] |
//! | free RAM | counted |
//!
//! HORUS has no code in RAM. A profile is sealed from scratch in every cycle and lives for less than one, so there is
//! nothing of it to re-verify; its objects' CRCs and the listener's own check cover the way from the sealing on.
//!
//! # Time to detect
//!
//! [`FLASH_DETECT_US`], [`GUARD_DETECT_US`], [`RAM_PASS_US`]. They hold as long as the idle loop gets its slices; if it
//! does not for 100 ms, the watchdog resets the part.

use firmware_common::{
    last_stop::Cause,
    patrol::{Rate, Slice, SLICE_US},
};
use profile::CYCLE_MS;

use crate::telemetry::Telemetry;

/// Words that a slice verifies: about 1 % of the processor on the pessimistic clock.
pub const RATE: Rate = Rate { flash_words: 16, code_words: 0, march_words: 48 };

/// Bytes of flash and of free RAM, at most: those of `memory.x`.
const FLASH_BYTES: u32 = 96 * 1024;
const FREE_BYTES: u32 = 160 * 1024;

/// A slice may have to wait for the quiet part of the next cycle.
const WAIT_US: u32 = 1_000 * CYCLE_MS;

/// From a flip in flash to the field being off, µs, at most: two passes over the image's whole budget.
pub const FLASH_DETECT_US: u32 = RATE.flash_detect_us(FLASH_BYTES) + WAIT_US;

/// From the change of a guard word to the field being off, µs.
pub const GUARD_DETECT_US: u32 = SLICE_US + WAIT_US;

/// One pass over free RAM, µs: a stuck bit is found within it.
pub const RAM_PASS_US: u32 = RATE.ram_pass_us(FREE_BYTES);

const _: () = assert!(FLASH_DETECT_US <= 7_800_000 && RAM_PASS_US <= 12_800_000);

/// Counts what a slice found, and gives the cause and the detail if it is one to stop for.
pub fn judge(slice: &Slice, telemetry: &Telemetry) -> Option<(Cause, u32)> {
    telemetry.ram_errors.add(slice.ram_errors);
    telemetry.ram_passes.add(u32::from(slice.ram_pass.is_some()));
    telemetry.flash_passes.add(u32::from(slice.flash.is_some()));
    let guard = slice.guard.map(|guard| (Cause::GuardWord, guard));
    let changed = slice.flash.filter(|flash| !flash.is_intact()).map(|flash| (Cause::Flash, flash.computed));
    guard.or(changed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_common::image::Comparison;

    #[test]
    fn changed_flash_and_changed_guard_words_are_causes_to_stop_and_the_rest_is_counted() {
        let telemetry = Telemetry::new();
        let of = |slice| judge(&slice, &telemetry);
        assert_eq!(of(Slice::default()), None);
        let intact = Comparison { computed: 5, expected: 5 };
        assert_eq!(of(Slice { flash: Some(intact), ram_pass: Some(3), ram_errors: 3, ..Slice::default() }), None);
        let changed = Slice { flash: Some(Comparison { expected: 6, ..intact }), ..Slice::default() };
        assert_eq!(of(changed), Some((Cause::Flash, 5)));
        assert_eq!(of(Slice { guard: Some(2), ..changed }), Some((Cause::GuardWord, 2)));
        let counts = [&telemetry.flash_passes, &telemetry.ram_passes, &telemetry.ram_errors]
            .map(firmware_common::counter::Counter::get);
        assert_eq!(counts, [3, 1, 3]);
    }
}
