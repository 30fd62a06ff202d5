//! Verifies all memory that the firmware uses, in slices by the idle loop ([`firmware_common::patrol`]).
//!
//! | finding | consequence |
//! |---|---|
//! | flash differs from the program that was built | the output is off, Hold-Status says *memory fault* |
//! | RAM in use does not hold what is written to it, also at the start | the same |
//! | a guard word has changed | safe state, [`Cause::GuardWord`] |
//!
//! The hold goes on after the first two, so that somebody learns of them, and keeps the output off until its next
//! start. A program that differs at the start is not run at all.

use firmware_common::{
    last_stop::Cause,
    patrol::{Rate, Slice},
};

use crate::telemetry::Telemetry;

/// The number of words that a slice verifies.
pub const RATE: Rate = Rate { flash_words: 16, code_words: 0, ram_words: 4 };

/// The sizes (`memory.x`), bytes: the program's flash, and the RAM for stack and statics.
const FLASH_BYTES: u32 = 64 * 1024;
const RAM_BYTES: u32 = 32 * 1024;

/// The longest time until a flipped bit in flash is found, µs: two passes over all 64 KiB of flash.
pub const FLASH_DETECT_US: u32 = RATE.flash_detect_us(FLASH_BYTES);

/// The longest time until a bit of RAM in use that gets stuck is found, µs: one pass over that RAM.
pub const RAM_DETECT_US: u32 = RATE.ram_pass_us(RAM_BYTES);

const _: () = assert!(FLASH_DETECT_US <= 5_200_000 && RAM_DETECT_US <= 5_200_000);

/// The consequence of what a slice found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Consequence {
    /// Nothing was found.
    None,
    /// The memory is faulty, and the hold goes on with its output off.
    MemoryFault,
    /// The hold stops for this cause with this detail.
    Stop(Cause, u32),
}

/// Counts what a slice found, and returns what follows.
pub fn judge(slice: &Slice, telemetry: &Telemetry) -> Consequence {
    let changed = slice.flash.is_some_and(|flash| !flash.is_intact());
    telemetry.flash_passes.add(u32::from(slice.flash.is_some()));
    telemetry.flash_faults.add(u32::from(changed));
    telemetry.ram_passes.add(u32::from(slice.ram_pass.is_some()));
    telemetry.ram_errors.add(u32::from(slice.ram.is_some()));
    match slice.guard {
        Some(guard) => Consequence::Stop(Cause::GuardWord, guard),
        None if changed || slice.ram.is_some() => Consequence::MemoryFault,
        None => Consequence::None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_common::{counter::Counter, program::Comparison};

    #[test]
    fn changed_memory_is_a_fault_and_a_changed_guard_a_stop() {
        let telemetry = Telemetry::new();
        let of = |slice| judge(&slice, &telemetry);
        let intact = Comparison { computed: 5, expected: 5 };
        let changed = Slice { flash: Some(Comparison { expected: 6, ..intact }), ..Slice::default() };
        assert_eq!(of(Slice { flash: Some(intact), ram_pass: Some(true), ..Slice::default() }), Consequence::None);
        assert_eq!(of(Slice { ram: Some(0x2000_0040), ..Slice::default() }), Consequence::MemoryFault);
        assert_eq!(of(changed), Consequence::MemoryFault);
        assert_eq!(of(Slice { guard: Some(2), ..changed }), Consequence::Stop(Cause::GuardWord, 2));
        let counts = [&telemetry.flash_passes, &telemetry.flash_faults, &telemetry.ram_passes, &telemetry.ram_errors];
        assert_eq!(counts.map(Counter::get), [3, 2, 1, 1]);
    }
}
