//! The test of the RAM at the start, before any data are stored in it.
//!
//! # Design
//!
//! [`start`](crate::start) calls `__test_memory` after the board's first instructions, before statics and code in RAM
//! are set up. The test is in assembler and uses only registers, since a stack or a static would lie in the tested
//! memory.
//!
//! | RAM | test |
//! |---|---|
//! | stack, `.data`, `.bss`; the RAM for code (`hot`) | March C-, which leaves the RAM filled with zeros |
//! | from `.uninit`, in which some statics outlive a reset, to the end | inverted and restored, two words at a time |
//!
//! March C- (A. J. van de Goor, *Testing Semiconductor Memories*, 1991) visits every word six times:
//!
//! ```text
//!   up (write 0); up (read 0, write 1); up (read 1, write 0);
//!   down (read 0, write 1); down (read 1, write 0); up (read 0)
//! ```
//!
//! The march finds all stuck-at, transition and address decoder faults, and all unlinked coupling faults between bits
//! of different words. It gives all bits of a word the same value, so it misses bits of one word that change together;
//! the [test at run time](crate::patrol::ram) finds those.
//!
//! A reset in the middle of the test costs the contents of two words of `.uninit`, where all data have a CRC.
//!
//! # Time
//!
//! A word takes [`HORUS_CYCLES`] or [`DPR_CYCLES`] at most, on the pessimistic clock. HORUS's 32 KiB take 20.5 ms at
//! most (16 MHz, flash without a wait state). The DPR's 32 KiB and 64 KiB of code take 23.9 ms at most (64 MHz, with
//! wait states). The watchdog already runs then, but its first period is longer: at least 340 ms (HORUS) and 98 ms
//! (DPR).
//!
//! # Result
//!
//! [`take`] returns the result once. Memory that was not tested at this start does not count as sound.

use core::sync::atomic::{AtomicU32, Ordering};

/// The word that the test stores at its end if it found no fault. Otherwise it stores this word combined by exclusive
/// or with the address of the faulty block of 32 bytes. No block has the address 0.
pub const TESTED: u32 = 0x4D61_7263;

#[cfg_attr(target_os = "none", allow(unsafe_code))] // The attributes name symbol and section, which are not checked.
#[cfg_attr(target_os = "none", no_mangle, link_section = ".uninit.MEMORY_TEST")]
static MEMORY_TEST: AtomicU32 = AtomicU32::new(0);

/// The result of the memory test at this start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Every word of the memory holds what is written to it.
    Sound,
    /// A word among the 32 bytes from this address on does not hold what is written to it.
    Faulty(u32),
    /// The test has left no result.
    NotTested,
}

impl Outcome {
    const fn of(result: u32) -> Self {
        match result ^ TESTED {
            0 => Self::Sound,
            // A faulty address lies in RAM, so it begins with the hexadecimal digit 2. Any other value did not come
            // from the test.
            address if address >> 28 == 2 => Self::Faulty(address),
            _ => Self::NotTested,
        }
    }

    /// Returns the address of the fault; 0 if the memory was not tested, `None` if the memory is sound.
    #[must_use]
    pub const fn fault(self) -> Option<u32> {
        match self {
            Self::Sound => None,
            Self::Faulty(address) => Some(address),
            Self::NotTested => Some(0),
        }
    }
}

/// Returns the result of this start's test once. A second call returns that no test was done, and so does a later start
/// that ends before its test.
pub fn take() -> Outcome {
    // Not covered: a second try of the exclusive access: no interrupt is enabled yet.
    Outcome::of(MEMORY_TEST.swap(0, Ordering::Relaxed))
}

/// The most processor cycles that the test of a word of HORUS's memory takes.
pub const HORUS_CYCLES: u32 = 40;
/// The most processor cycles that the test of a word of the DPR's memory takes.
pub const DPR_CYCLES: u32 = 62;

/// Returns the longest time, µs, of a test of `bytes` at `mhz` with `cycles` for each word.
#[must_use]
pub const fn longest_us(bytes: u32, cycles: u32, mhz: u32) -> u32 {
    (bytes / 4 * cycles).div_ceil(mhz)
}

const _: () = assert!(longest_us(32 * 1024, HORUS_CYCLES, 16) <= 20_500);
const _: () = assert!(longest_us(96 * 1024, DPR_CYCLES, 64) <= 23_900);

#[cfg(target_os = "none")]
#[allow(unsafe_code)]
mod test {
    // The registers are: r0 start, r1 end, r2 the block of 32 bytes, r3 zeros, r4 ones, r5 the word read, r6 the faulty
    // block. Ranges are whole blocks (`guards.x`, `hot.x`) except the last, which is tested in pairs of words.
    core::arch::global_asm!(
        ".macro visit offset, expected, written",
        "ldr r5, [r2, #\\offset]",
        "cmp r5, \\expected",
        "bne 9f",
        "str \\written, [r2, #\\offset]",
        ".endm",
        ".macro visit_up expected, written",
        "2:",
        ".irp offset, 0, 4, 8, 12, 16, 20, 24, 28",
        "visit \\offset, \\expected, \\written",
        ".endr",
        "adds r2, #32",
        "cmp r2, r1",
        "blo 2b",
        ".endm",
        ".macro visit_down expected, written",
        "2:",
        "subs r2, #32",
        ".irp offset, 28, 24, 20, 16, 12, 8, 4, 0",
        "visit \\offset, \\expected, \\written",
        ".endr",
        "cmp r2, r0",
        "bhi 2b",
        ".endm",
        ".section .text.__march, \"ax\", %progbits",
        ".type __march, %function",
        ".thumb_func",
        "__march:",
        "cmp r0, r1",
        "bhs 3f",
        "mov r2, r0",
        "2:",
        ".irp offset, 0, 4, 8, 12, 16, 20, 24, 28",
        "str r3, [r2, #\\offset]",
        ".endr",
        "adds r2, #32",
        "cmp r2, r1",
        "blo 2b",
        "mov r2, r0",
        "visit_up r3, r4",
        "mov r2, r0",
        "visit_up r4, r3",
        "visit_down r3, r4",
        "mov r2, r1",
        "visit_down r4, r3",
        // The last visit reads each word once more, and writes the value that the word already has.
        "visit_up r3, r3",
        "3:",
        "bx lr",
        "9:",
        "mov r6, r2",
        "bx lr",
        ".size __march, . - __march",
    );
    core::arch::global_asm!(
        ".section .text.__test_memory, \"ax\", %progbits",
        ".global __test_memory",
        ".type __test_memory, %function",
        ".thumb_func",
        "__test_memory:",
        "mov r7, lr",
        "movs r3, #0",
        "mvns r4, r3",
        "movs r6, #0",
        "ldr r0, =__ram_start",
        "ldr r1, =__suninit",
        "bl __march",
    );
    #[cfg(feature = "hot")]
    core::arch::global_asm!(
        ".section .text.__test_memory, \"ax\", %progbits",
        "ldr r0, =__shot + {data_address}",
        "ldr r1, =__ehot + {data_address}",
        "bl __march",
        data_address = const crate::start::DATA_ADDRESS,
    );
    core::arch::global_asm!(
        ".section .text.__test_memory, \"ax\", %progbits",
        // Registers r3 and r4 hold the contents of two words, which are tested upwards and then downwards.
        "ldr r0, =__suninit",
        "ldr r1, =__ram_end",
        "4:",
        "ldrd r3, r4, [r0]",
        "ldr r5, [r0]",
        "cmp r5, r3",
        "bne 9f",
        "mvns r3, r3",
        "str r3, [r0]",
        "ldr r5, [r0, #4]",
        "cmp r5, r4",
        "bne 9f",
        "mvns r4, r4",
        "str r4, [r0, #4]",
        "ldr r5, [r0, #4]",
        "cmp r5, r4",
        "bne 9f",
        "mvns r4, r4",
        "str r4, [r0, #4]",
        "ldr r5, [r0]",
        "cmp r5, r3",
        "bne 9f",
        "mvns r3, r3",
        "str r3, [r0]",
        "ldr r5, [r0, #4]",
        "cmp r5, r4",
        "bne 9f",
        "ldr r5, [r0]",
        "cmp r5, r3",
        "bne 9f",
        "adds r0, #8",
        "cmp r0, r1",
        "blo 4b",
        "b 5f",
        "9:",
        "bic r6, r0, #31",
        "5:",
        "ldr r5, ={tested}",
        "eors r5, r6",
        "ldr r0, =MEMORY_TEST",
        "str r5, [r0]",
        "bx r7",
        ".ltorg",
        ".size __test_memory, . - __test_memory",
        ".text",
        tested = const super::TESTED,
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_the_test_stores_is_an_outcome() {
        assert_eq!(Outcome::of(TESTED), Outcome::Sound);
        assert_eq!(Outcome::of(TESTED ^ 0x2000_7FE0), Outcome::Faulty(0x2000_7FE0));
        for nothing in [0, u32::MAX, !TESTED, TESTED ^ 1, TESTED ^ 0x0800_0000] {
            assert_eq!(Outcome::of(nothing), Outcome::NotTested, "{nothing:#x}");
        }
        let faults = [Outcome::Sound, Outcome::Faulty(0x2000_0020), Outcome::NotTested].map(Outcome::fault);
        assert_eq!(faults, [None, Some(0x2000_0020), Some(0)]);
    }

    #[test]
    fn an_outcome_is_taken_once_and_absence_is_none() {
        MEMORY_TEST.store(TESTED, Ordering::Relaxed);
        assert_eq!((take(), take()), (Outcome::Sound, Outcome::NotTested));
    }
}
