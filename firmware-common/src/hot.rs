//! Code that runs from RAM: its copy from flash, before anything of it runs.
//!
//! Chosen by the feature `hot`.
//!
//! A firmware's linker script places the section `.hot` (the DPR's does, `dpr-fw/hot.x`). On the nRF52840 it is fetched
//! at 0x0080_0000 and written at 0x2000_0000, the data address of the same bytes (PS v1.7, 4.2). The reset handler of
//! cortex-m-rt calls `__pre_init` before it sets up statics, from flash, and no function of the section runs before.
//! Assembler, since Rust code may not run before statics are set up, and since a compiler may call the section's own
//! `memcpy`. The barriers at the end: what was stored is in memory before an instruction is fetched from there (ARMv7-M
//! ARM, A3.8).

/// From the address at which code in RAM is fetched to the one at which it is written (nRF52840 PS v1.7, 4.2).
pub const DATA_ADDRESS: usize = 0x2000_0000 - 0x0080_0000;

#[cfg(all(target_os = "none", feature = "hot"))]
#[allow(unsafe_code)]
mod copy {
    core::arch::global_asm!(
        ".section .text.__pre_init, \"ax\", %progbits",
        ".global __pre_init",
        ".type __pre_init, %function",
        ".thumb_func",
        "__pre_init:",
        "push {{r4, r5, r6, lr}}",
        "ldr r0, =__sihot",
        "ldr r1, =__shot + {data_address}",
        "ldr r2, =__ehot + {data_address}",
        "2:",
        "cmp r1, r2",
        "beq 3f",
        "ldmia r0!, {{r3, r4, r5, r6}}",
        "stmia r1!, {{r3, r4, r5, r6}}",
        "b 2b",
        "3:",
        "dsb",
        "isb",
        "pop {{r4, r5, r6, pc}}",
        ".ltorg",
        ".size __pre_init, . - __pre_init",
        ".text",
        data_address = const super::DATA_ADDRESS,
    );
}
