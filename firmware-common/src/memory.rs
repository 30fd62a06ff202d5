//! Memory as the linker has laid it out, word by word: the program in flash, code in RAM, guard words, RAM in use.
//!
//! Everything here is a load or a store of one word at an address between two symbols of the linker script. Loads are
//! instructions in assembly, not reads through a reference: on the nRF52840 flash begins at address 0, to which no Rust
//! reference may point, and what other tasks or a bit flip change meanwhile must not be undefined behaviour.
#![allow(unsafe_code)]

use core::{arch::asm, ops::Range};

/// The address of a linker symbol.
macro_rules! address {
    ($symbol:ident) => {{
        extern "C" {
            static $symbol: u32;
        }
        &raw const $symbol as u32
    }};
}
pub(crate) use address;

/// The word at `address`, which must be one of the part's memory and open to loads.
#[must_use]
pub fn load(address: u32) -> u32 {
    let word: u32;
    // SAFETY: a load from memory changes nothing, and every word of it may be read. It is not `pure`: what is read may
    // have changed since the last time.
    unsafe {
        asm!("ldr {0}, [{1}]", out(reg) word, in(reg) address, options(readonly, nostack, preserves_flags));
    }
    word
}

/// The word at `address` of flash, past the memory protection unit, which may have it shut.
///
/// Under FAULTMASK the unit does not apply (MPU_CTRL.HFNMIENA = 0, ARMv7-M ARM B3.5.5), and nothing runs but NMI; it
/// lasts for one load. The barrier makes sure that the load is judged at the raised priority (B5.2.1).
#[must_use]
pub fn load_shut(address: u32) -> u32 {
    let word: u32;
    // SAFETY: as `load`; FAULTMASK was clear before, since the callers are tasks, and is clear after it.
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

/// Stores `word` at `address`, which must be a guard's.
pub(crate) fn store(address: u32, word: u32) {
    // SAFETY: the caller, the patrol, stores into memory alone that the linker gave to no object of the program.
    unsafe { (address as *mut u32).write_volatile(word) };
}

/// Inverts the word of RAM at `address` and the one behind it and restores them; the bits that did not read as they
/// were written. All interrupts are masked meanwhile; see [`patrol::ram`](crate::patrol::ram) for how long, and for the
/// order of the accesses.
pub(crate) fn exercise(address: u32) -> u32 {
    let wrong: u32;
    // SAFETY: both words are RAM, which the caller's layout says. Nothing sees them inverted: interrupts are masked,
    // the instructions between use no memory but them, and what DMA reaches is left out by the layout. They are
    // restored from registers. PRIMASK was clear before, since the caller is a task in thread mode, and is clear after
    // it.
    unsafe {
        asm!(
            "cpsid i",
            "ldr {c0}, [{at}]",
            "ldr {c1}, [{at}, #4]",
            // Up: read the contents, write the complement.
            "ldr {wrong}, [{at}]",
            "eors {wrong}, {c0}",
            "mvns {c0}, {c0}",
            "str {c0}, [{at}]",
            "ldr {read}, [{at}, #4]",
            "eors {read}, {c1}",
            "orrs {wrong}, {read}",
            "mvns {c1}, {c1}",
            "str {c1}, [{at}, #4]",
            // Down: read the complement, write the contents.
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

/// Where `object` is.
pub fn span<T: ?Sized>(object: &T) -> Range<u32> {
    let start = (&raw const *object).cast::<u8>() as u32;
    start..start + size_of_val(object) as u32
}

/// The program in flash: from the vector table up to its CRC.
#[must_use]
pub fn program() -> Range<u32> {
    address!(__vector_table)..address!(__program_crc)
}

/// The word behind the program, which holds its CRC.
#[must_use]
pub fn stored_crc() -> u32 {
    load(address!(__program_crc))
}

/// Whether `len` bytes from `address` on are whole words of the stack.
#[must_use]
pub fn is_stack(address: u32, len: u32) -> bool {
    let end = address!(_stack_end);
    let (offset, size) = (address.wrapping_sub(end), address!(_stack_start) - end);
    address.is_multiple_of(4) && offset < size && size - offset >= len
}
