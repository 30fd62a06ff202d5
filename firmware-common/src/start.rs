//! The first steps of a start: the watchdog, the reset flags, and the code that runs from RAM.
//!
//! # Design
//!
//! The reset handler of cortex-m-rt calls `__pre_init` before it sets up statics, so `__pre_init` is assembler. A
//! firmware installs it with [`install_start!`](crate::install_start), whose arguments are the board's own first
//! instructions. These instructions use no stack, so damaged memory does not stop them. They do two steps in this
//! order:
//!
//! 1. The reset flags are read and cleared in the part.
//! 2. The watchdog is started.
//!
//! Both parts collect their reset flags until the flags are cleared. Because they are cleared first, the flags of an
//! earlier start are never still set when the watchdog resets the part. [`RESET_FLAGS`] keeps the flags that were read.
//!
//! No RAM except [`RESET_FLAGS`] is used before `__prepare_memory`. `__pre_init` ends with a plain branch to it, so it
//! returns to the reset handler. It [tests](crate::start_test) the RAM. With the feature `hot` it copies the section
//! `.hot` to where its code runs (`dpr-fw/hot.x`). On the nRF52840 that section is fetched at 0x0080_0000 and written
//! at 0x2000_0000, the data address of the same bytes (PS v1.7, 4.2). The copy is assembler too, since a compiler may
//! call the section's own `memcpy`. Barriers after the copy make sure that all is stored before an instruction is
//! fetched from there (ARMv7-M ARM, A3.8).

use core::sync::atomic::{AtomicU32, Ordering};

/// The distance from the address at which code in RAM is fetched to its data address (nRF52840 PS v1.7, 4.2).
pub const DATA_ADDRESS: usize = 0x2000_0000 - 0x0080_0000;

/// The part's reset flags. The first instructions have read them before clearing them in the part.
#[cfg_attr(target_os = "none", allow(unsafe_code))] // The attribute names a section, which the compiler cannot check.
#[cfg_attr(target_os = "none", link_section = ".uninit.RESET_FLAGS")]
pub static RESET_FLAGS: AtomicU32 = AtomicU32::new(0);

/// Returns the part's reset flags at this start. They are valid only with [`install_start!`](crate::install_start).
#[must_use]
pub fn reset_flags() -> u32 {
    RESET_FLAGS.load(Ordering::Relaxed)
}

#[cfg(target_os = "none")]
#[allow(unsafe_code)]
mod memory {
    core::arch::global_asm!(
        ".section .text.__prepare_memory, \"ax\", %progbits",
        ".global __prepare_memory",
        ".type __prepare_memory, %function",
        ".thumb_func",
        "__prepare_memory:",
        // The test changes the memory of the stack, so the stack is not used here.
        "mov r8, lr",
        "bl __test_memory",
        #[cfg(feature = "hot")]
        "ldr r0, =__sihot
         ldr r1, =__shot + {data_address}
         ldr r2, =__ehot + {data_address}
         2:
         cmp r1, r2
         beq 3f
         ldmia r0!, {{r3, r4, r5, r6}}
         stmia r1!, {{r3, r4, r5, r6}}
         b 2b
         3:
         dsb
         isb",
        "bx r8",
        ".ltorg",
        ".size __prepare_memory, . - __prepare_memory",
        ".text",
        #[cfg(feature = "hot")]
        data_address = const super::DATA_ADDRESS,
    );
}

/// Installs `__pre_init`: the instructions in brackets, then the preparation of memory. The instructions must keep the
/// link register and the stack, and end by falling through. The operands of `global_asm!` follow the brackets.
#[macro_export]
macro_rules! install_start {
    ([$($instruction:literal),* $(,)?] $($operands:tt)*) => {
        core::arch::global_asm!(
            ".section .text.__pre_init, \"ax\", %progbits",
            ".global __pre_init",
            ".type __pre_init, %function",
            ".thumb_func",
            "__pre_init:",
            $($instruction,)*
            "b __prepare_memory",
            ".ltorg",
            ".size __pre_init, . - __pre_init",
            ".text",
            $($operands)*
        );
    };
}
