//! The first instructions after a reset ([`firmware_common::start`]): the reasons of the reset, then the watchdog.
//!
//! RESETREAS collects reasons until each is cleared by writing a one (PS v1.7, 5.3.7.8). All are cleared before the
//! watchdog starts. Otherwise a restart by it could show the bit of the reset pin, too, and no other would count
//! (anomaly 136).
//!
//! The watchdog runs on over a soft reset and a lockup, with its registers locked. Otherwise it is set up here in
//! assembler, since the HAL's code cannot run before statics are set up; the HAL recovers its handle later.

use firmware_common::start::RESET_FLAGS;

/// The watchdog resets the part after 100 ms, which is eight deadlines without a check-in.
const WATCHDOG_TICKS: u32 = 32_768 / 10;

/// The value of CONFIG (PS v1.7, 6.36). The watchdog runs while the processor sleeps (bit 0). It also runs while a
/// debugger halts the processor (bit 3), unless the build allows a debugger to stop it.
const CONFIG: u32 = if cfg!(feature = "debugger-stops-watchdog") { 0b0001 } else { 0b1001 };

firmware_common::install_start!(
    [
        // The reasons of the reset are in POWER.RESETREAS, which is cleared here.
        "ldr r0, =0x40000400",
        "ldr r1, [r0]",
        "str r1, [r0]",
        // The registers of the WDT are RUNSTATUS, then CRV, CONFIG and RREN, then TASKS_START.
        "ldr r0, =0x40010000",
        "ldr r2, [r0, #0x400]",
        "cbnz r2, 2f",
        "movw r2, {ticks}",
        "str r2, [r0, #0x504]",
        "movs r2, {config}",
        "str r2, [r0, #0x50C]",
        "movs r2, #1",
        "str r2, [r0, #0x508]",
        "str r2, [r0]",
        "2:",
        "ldr r0, ={flags}",
        "str r1, [r0]",
    ]
    ticks = const WATCHDOG_TICKS,
    config = const CONFIG,
    flags = sym RESET_FLAGS,
);
