//! The hold's settings of the patrol ([`firmware_common::patrol`]), and what the hold does about a fault that the
//! patrol finds. In the patrol the idle loop verifies all memory in use, a slice at a time.
//!
//! | what a slice finds | consequence |
//! |---|---|
//! | flash differs from the program that was built | the output is off, Hold-Status says *memory fault* |
//! | a RAM word does not hold what is written to it, also at the start | the output is off, *memory fault* as well |
//! | a guard word has changed | safe state, [`Cause::GuardWord`] |
//!
//! After a fault of flash or of RAM the hold goes on until its next start, with its output off, so that it can report
//! the fault. A program that is found changed at the start is not run.

use firmware_common::{
    last_stop::Cause,
    patrol::{Rate, Slice},
};

use crate::telemetry::Telemetry;

/// The number of words of flash and of RAM that a slice verifies.
pub const RATE: Rate = Rate { flash_words: 16, code_words: 0, ram_words: 4 };

/// The sizes of the program's flash, and of the RAM for stack and statics, bytes (`memory.x`).
const FLASH_BYTES: u32 = 65_536;
const RAM_BYTES: u32 = 32_768;

/// The longest time from a bit flip in flash until the patrol finds it, µs: two passes over 64 KiB of flash.
pub const FLASH_DETECT_US: u32 = RATE.flash_detect_us(FLASH_BYTES);

/// The longest time until the patrol finds a stuck bit in the RAM in use, µs: one pass over that RAM.
pub const RAM_DETECT_US: u32 = RATE.ram_pass_us(RAM_BYTES);

const _: () = assert!(FLASH_DETECT_US <= 5_200_000 && RAM_DETECT_US <= 5_200_000);

/// What the hold does about a fault of its memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Consequence {
    /// No fault was found.
    None,
    /// The hold goes on, but with its output off.
    MemoryFault,
    /// The hold stops for this cause. The second value is the detail that is logged with the cause.
    Stop(Cause, u32),
}

/// Counts the faults that a slice has found, and returns what the hold does about them.
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
