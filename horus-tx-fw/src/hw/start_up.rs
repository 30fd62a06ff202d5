//! The first instructions after a reset ([`firmware_common::start`]): the flags of the reset, then the watchdog
//!
//! # Design
//!
//! The watchdog's registers are written here and not by the HAL: its code cannot run before statics are set up, and its
//! choice of the prescaler for 100 ms counts in steps of 8 ms. The order is that of RM0090 21.3: the key 0xCCCC starts
//! the watchdog, and LSI with it; 0x5555 opens the reload register, which takes up to 5 periods of LSI to reach the
//! watchdog's own clock. The prescaler stays as the reset leaves it, 4. Until `init` feeds it, the watchdog counts from
//! the reset value of the reload register ([`timing::FIRST_WATCHDOG_MS`]).
//!
//! RCC_CSR collects flags until RMVF clears all of them (RM0090 6.3.21). Cleared before the watchdog starts, it tells a
//! restart by the watchdog from the start before it, also where that start did not come far: the flags of power-on and
//! of brown-out would hide the watchdog's.
//!
//! A start after power-on forgets here who was excluded ([`horus_tx_fw::exclusions`]): memory outlives a supply that
//! was away for a moment, and if this start is cut off before its first vote, the next one could not tell the record
//! from its own. The flags take the place of its first word, which no record begins with.

use firmware_common::start::RESET_FLAGS;
use horus_tx_fw::timing;

use super::reset::EXCLUSIONS;

firmware_common::install_start!(
    [
        // RCC_CSR, and its bit RMVF.
        "ldr r0, =0x40023874",
        "ldr r1, [r0]",
        "orr r2, r1, #0x01000000",
        "str r2, [r0]",
        // IWDG: KR, KR, RLR.
        "ldr r0, =0x40003000",
        "movw r2, #0xCCCC",
        "str r2, [r0]",
        "movw r2, #0x5555",
        "str r2, [r0]",
        "movw r2, {reload}",
        "str r2, [r0, #8]",
        "ldr r0, ={flags}",
        "str r1, [r0]",
        // PORRSTF: power-on.
        "ldr r0, ={exclusions}",
        "tst r1, #0x08000000",
        "it ne",
        "strne r1, [r0]",
    ]
    reload = const timing::WATCHDOG_RELOAD,
    flags = sym RESET_FLAGS,
    exclusions = sym EXCLUSIONS,
);
