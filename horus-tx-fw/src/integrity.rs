//! Verifies the integrity of HORUS's flash and RAM, and judges the findings
//!
//! # Design
//!
//! The idle loop does a [slice](firmware_common::patrol) of work every 2.5 ms. Each slice is in the part of the cycle
//! in which it can delay neither a slot nor a tick ([`timing::quiet`](crate::timing::quiet)).
//!
//! | finding | consequence |
//! |---|---|
//! | flash differs from the program that was built | safe state: the field is off, [`Cause::Flash`] |
//! | a guard word has changed | safe state, [`Cause::GuardWord`] |
//! | RAM in use does not hold what is written to it | safe state, [`Cause::Ram`]; also at the start |
//!
//! Besides these checks, each task verifies the [checked](firmware_common::checked) states that it uses: receivers,
//! solutions and the state of the vote. A flipped bit in one of them is a [`Cause::Ram`] at once.
//!
//! HORUS has no code in RAM. A profile is sealed in every cycle, and its objects' CRCs protect it from then on. Values
//! that are computed before the sealing have no CRC, so HORUS sends nothing once its RAM is faulty.
//!
//! # Time to detect
//!
//! The bounds are [`FLASH_DETECT_US`], [`GUARD_DETECT_US`] and [`RAM_DETECT_US`]. They hold while the idle loop runs;
//! if it does not run for 100 ms, the watchdog resets the part.

use firmware_common::{
    last_stop::Cause,
    patrol::{Rate, Slice, SLICE_US},
};
use profile::CYCLE_MS;

use crate::telemetry::Telemetry;

/// The number of words that a slice of memory checks verifies. This takes about 1 % of the processor's time on the
/// pessimistic clock.
pub const RATE: Rate = Rate { flash_words: 16, code_words: 0, ram_words: 6 };

/// The size of the program's flash, bytes, as in `memory.x`.
pub(crate) const FLASH_BYTES: u32 = 112 * 1024;
const RAM_BYTES: u32 = 32 * 1024;

/// The longest time that a slice may have to wait for the quiet part of the next cycle, µs.
const WAIT_US: u32 = 1_000 * CYCLE_MS;

/// The longest time from a flipped bit in flash until the field is off, µs: two passes over all 112 KiB of flash.
pub const FLASH_DETECT_US: u32 = RATE.flash_detect_us(FLASH_BYTES) + WAIT_US;

/// The longest time from the change of a guard word until the field is off, µs.
pub const GUARD_DETECT_US: u32 = SLICE_US + WAIT_US;

/// The longest time from a bit of RAM in use that gets stuck until the field is off, µs: one pass over that RAM.
pub const RAM_DETECT_US: u32 = RATE.ram_pass_us(RAM_BYTES) + WAIT_US;

// Shows SAFE-4, SAFE-5.
const _: () = assert!(FLASH_DETECT_US <= 9_100_000 && RAM_DETECT_US <= 3_500_000);

/// Counts what a slice of memory checks has found. Returns cause and detail of a finding that requires the safe state.
pub fn judge(slice: &Slice, telemetry: &Telemetry) -> Option<(Cause, u32)> {
    telemetry.ram_errors.add(u32::from(slice.ram.is_some()));
    telemetry.ram_passes.add(u32::from(slice.ram_pass.is_some()));
    telemetry.flash_passes.add(u32::from(slice.flash.is_some()));
    let guard = slice.guard.map(|guard| (Cause::GuardWord, guard));
    let changed = slice.flash.filter(|flash| !flash.is_intact()).map(|flash| (Cause::Flash, flash.computed));
    guard.or(changed).or(slice.ram.map(|address| (Cause::Ram, address)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_common::program::Comparison;

    // Shows SAFE-8.
    #[test]
    fn changed_flash_and_guard_words_and_faulty_ram_are_causes_to_stop() {
        let telemetry = Telemetry::new();
        let of = |slice| judge(&slice, &telemetry);
        assert_eq!(of(Slice::default()), None);
        let intact = Comparison { computed: 5, expected: 5 };
        assert_eq!(of(Slice { flash: Some(intact), ram_pass: Some(true), ..Slice::default() }), None);
        let faulty = Slice { ram: Some(0x2000_0040), ram_pass: Some(false), ..Slice::default() };
        assert_eq!(of(faulty), Some((Cause::Ram, 0x2000_0040)));
        let changed = Slice { flash: Some(Comparison { expected: 6, ..intact }), ..Slice::default() };
        assert_eq!(of(Slice { ram: Some(4), ..changed }), Some((Cause::Flash, 5)));
        assert_eq!(of(Slice { guard: Some(2), ..changed }), Some((Cause::GuardWord, 2)));
        let counts = [&telemetry.flash_passes, &telemetry.ram_passes, &telemetry.ram_errors]
            .map(firmware_common::counter::Counter::get);
        assert_eq!(counts, [3, 2, 2]);
    }
}
