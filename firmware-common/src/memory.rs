//! Access to memory by the linker's symbols: the program in flash, code in RAM, guard words, RAM in use.
//!
//! The addresses come from symbols of the linker script. Loads are instructions in assembly, because Rust's references
//! would not be allowed. On the nRF52840 flash begins at address 0, to which no reference may point. Also other tasks
//! or a bit flip may change a word. Such a change must not be undefined behaviour.
#![allow(unsafe_code)]

use core::{arch::asm, ops::Range};

macro_rules! address {
    ($symbol:ident) => {{
        extern "C" {
            static $symbol: u32;
        }
        &raw const $symbol as u32
    }};
}
pub(crate) use address;

/// Returns the word at `address`, which must be in the part's memory and in a region that allows loads.
#[must_use]
pub fn load(address: u32) -> u32 {
    let word: u32;
    // SAFETY: a load from memory changes nothing, and every word of memory may be read. The assembly is not `pure`,
    // since the word may have changed since the last load.
    unsafe {
        asm!("ldr {0}, [{1}]", out(reg) word, in(reg) address, options(readonly, nostack, preserves_flags));
    }
    word
}

/// Returns the sum of the words at `range`, each added to the sum before it, rotated by one bit ([`checked`]). The
/// range has whole words that may be read. A word costs about 3 cycles.
///
/// [`checked`]: crate::checked
#[inline(never)]
pub(crate) fn sum(range: Range<u32>) -> u32 {
    let mut sum: u32 = 0;
    let mut at = range.start;
    let eights = at + (range.end - at) / 32 * 32;
    // SAFETY: as in `load`; all loads are inside the range, since the loop ends at its last whole eight words.
    unsafe {
        asm!(
            "b 3f",
            "2:",
            "ldm {at}!, {{r0, r1, r2, r3, r4, r5, r8, r9}}",
            "add {sum}, r0, {sum}, ror #31",
            "add {sum}, r1, {sum}, ror #31",
            "add {sum}, r2, {sum}, ror #31",
            "add {sum}, r3, {sum}, ror #31",
            "add {sum}, r4, {sum}, ror #31",
            "add {sum}, r5, {sum}, ror #31",
            "add {sum}, r8, {sum}, ror #31",
            "add {sum}, r9, {sum}, ror #31",
            "3:",
            "cmp {at}, {end}",
            "bne 2b",
            at = inout(reg) at,
            end = in(reg) eights,
            sum = inout(reg) sum,
            out("r0") _,
            out("r1") _,
            out("r2") _,
            out("r3") _,
            out("r4") _,
            out("r5") _,
            out("r8") _,
            out("r9") _,
            options(readonly, nostack)
        );
    }
    // Not covered: only this line, no rest behind the blocks of eight words: nothing that is checked is a whole number
    // of them.
    while at != range.end {
        sum = sum.rotate_left(1).wrapping_add(load(at));
        at += 4;
    }
    sum
}

/// Returns the word at `address` of flash, even if the memory protection unit denies access to it.
///
/// The load is made under FAULTMASK, where the memory protection unit does not apply (MPU_CTRL.HFNMIENA = 0, ARMv7-M
/// ARM B3.5.5) and only NMI can interrupt. The barrier makes sure that the load is made at the raised priority
/// (B5.2.1).
#[must_use]
pub fn load_shut(address: u32) -> u32 {
    let word: u32;
    // SAFETY: a load changes nothing. FAULTMASK was clear before, since the callers are tasks, and is clear afterwards.
    unsafe {
        asm!(
            "cpsid f",
            "isb",
            "ldr {0}, [{1}]",
            "cpsie f",
            out(reg) word,
            in(reg) address,
            options(readonly, nostack, preserves_flags)
        );
    }
    word
}

/// Stores `word` at `address`, which must belong to a guard word.
pub(crate) fn store(address: u32, word: u32) {
    // SAFETY: the caller, the patrol, stores only into memory in which the linker has placed no object of the program.
    unsafe { (address as *mut u32).write_volatile(word) };
}

/// Inverts and restores the word of RAM at `address` and the next one. Returns the bits that did not read as they were
/// written. All interrupts are masked meanwhile; [`patrol::ram`](crate::patrol::ram) says for how long and why.
pub(crate) fn exercise(address: u32) -> u32 {
    let wrong: u32;
    // SAFETY: both words are RAM, as the caller's layout says. No code reads them inverted: interrupts are masked,
    // the instructions in between use no other memory, and the layout leaves out what DMA reaches. The words are
    // restored from registers. PRIMASK was clear before, since the caller is a task in thread mode, and is clear
    // afterwards.
    unsafe {
        asm!(
            "cpsid i",
            "ldr {c0}, [{at}]",
            "ldr {c1}, [{at}, #4]",
            // The first pass over both words, upwards, reads the contents and writes the complement.
            "ldr {wrong}, [{at}]",
            "eors {wrong}, {c0}",
            "mvns {c0}, {c0}",
            "str {c0}, [{at}]",
            "ldr {read}, [{at}, #4]",
            "eors {read}, {c1}",
            "orrs {wrong}, {read}",
            "mvns {c1}, {c1}",
            "str {c1}, [{at}, #4]",
            // The second pass over both words, downwards, reads the complement and writes the contents.
            "ldr {read}, [{at}, #4]",
            "eors {read}, {c1}",
            "orrs {wrong}, {read}",
            "mvns {c1}, {c1}",
            "str {c1}, [{at}, #4]",
            "ldr {read}, [{at}]",
            "eors {read}, {c0}",
            "orrs {wrong}, {read}",
            "mvns {c0}, {c0}",
            "str {c0}, [{at}]",
            "ldr {read}, [{at}]",
            "eors {read}, {c0}",
            "orrs {wrong}, {read}",
            "ldr {read}, [{at}, #4]",
            "cpsie i",
            "eors {read}, {c1}",
            "orrs {wrong}, {read}",
            at = in(reg) address,
            c0 = out(reg) _,
            c1 = out(reg) _,
            read = out(reg) _,
            wrong = out(reg) wrong,
            options(nostack)
        );
    }
    wrong
}

/// Returns the range of addresses of `object`.
pub fn span<T: ?Sized>(object: &T) -> Range<u32> {
    let start = (&raw const *object).cast::<u8>() as u32;
    start..start + size_of_val(object) as u32
}

/// Returns the addresses of the program in flash: from the vector table up to its CRC.
#[must_use]
pub fn program() -> Range<u32> {
    address!(__vector_table)..address!(__program_crc)
}

/// Returns the word that holds the program's CRC, just after the program in flash.
#[must_use]
pub fn stored_crc() -> u32 {
    load(address!(__program_crc))
}

/// Whether `len` bytes from `address` on are whole words inside the stack.
#[must_use]
pub fn is_stack(address: u32, len: u32) -> bool {
    let end = address!(_stack_end);
    let (offset, size) = (address.wrapping_sub(end), address!(_stack_start) - end);
    address.is_multiple_of(4) && offset < size && size - offset >= len
}
