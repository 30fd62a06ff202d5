//! The first instructions after a reset ([`firmware_common::start`]): the flags of the reset, then the watchdog
//!
//! # Design
//!
//! The watchdog's registers are written here and not by the HAL. The HAL's code cannot run before statics are set up,
//! and its prescaler for 100 ms counts in steps of 8 ms. The order is that of RM0090 21.3. The key 0xCCCC starts the
//! watchdog, and LSI with it. The key 0x5555 opens the reload register, whose value takes up to 5 periods of LSI to
//! reach the watchdog's own clock. The prescaler keeps its reset value, 4. Until `init` feeds the watchdog, it counts
//! from the reset value of the reload register ([`timing::FIRST_WATCHDOG_MS`]).
//!
//! The reset flags in RCC_CSR collect until RMVF clears all of them (RM0090 6.3.21). They are cleared before the
//! watchdog starts. Otherwise the flags of power-on and of brown-out could hide the watchdog's flag at the next
//! restart.
//!
//! A start after power-on destroys the record of excluded receivers here ([`horus_tx_fw::exclusions`]), since memory
//! can outlive a short loss of the supply. The flags overwrite the record's first word, and no record begins with them.

use firmware_common::start::RESET_FLAGS;
use horus_tx_fw::timing;

use super::reset::EXCLUSIONS;

firmware_common::install_start!(
    [
        // The part's reset flags are in RCC_CSR, whose bit RMVF clears them.
        "ldr r0, =0x40023874",
        "ldr r1, [r0]",
        "orr r2, r1, #0x01000000",
        "str r2, [r0]",
        // The registers of the watchdog (IWDG) are written in the order KR, KR, RLR.
        "ldr r0, =0x40003000",
        "movw r2, #0xCCCC",
        "str r2, [r0]",
        "movw r2, #0x5555",
        "str r2, [r0]",
        "movw r2, {reload}",
        "str r2, [r0, #8]",
        "ldr r0, ={flags}",
        "str r1, [r0]",
        // The flag of power-on is PORRSTF.
        "ldr r0, ={exclusions}",
        "tst r1, #0x08000000",
        "it ne",
        "strne r1, [r0]",
    ]
    reload = const timing::WATCHDOG_RELOAD,
    flags = sym RESET_FLAGS,
    exclusions = sym EXCLUSIONS,
);
