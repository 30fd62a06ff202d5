//! The first instructions after a reset ([`start`](crate::start)): the reasons of the reset, then the watchdog.
//!
//! RESETREAS collects reasons until each is cleared by writing a one (PS v1.7, 5.3.7.8). All are cleared before the
//! watchdog starts. So a restart by the watchdog shows the watchdog's bit alone, even if the start before never reached
//! `hw::init`: if the bit of the reset pin were still set, no other would count (anomaly 136).
//!
//! The watchdog runs on over a soft reset and a lockup. Its registers are then locked until another reset, and it
//! cannot be changed, so it is left as it is. Otherwise it is set up in assembler and not by the HAL, whose code cannot
//! run before statics are set up; the HAL's handle is recovered from the running peripheral.

/// Installs the first instructions of a firmware for the nRF52840. The watchdog resets the part 100 ms after it was
/// last fed. It runs on while the processor sleeps and, unless `$debugger_stops` is true, while a debugger halts it.
#[macro_export]
macro_rules! install_nrf52840_start {
    ($debugger_stops:expr) => {
        $crate::install_start!(
            [
                // The reasons of the reset are in POWER.RESETREAS.
                "ldr r0, =0x40000400",
                "ldr r1, [r0]",
                "str r1, [r0]",
                // The registers of the WDT are RUNSTATUS, then CRV, RREN and CONFIG, then TASKS_START.
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
            ticks = const 32_768 / 10,
            // CONFIG (PS v1.7, 6.36): bit 0 for a sleeping processor, bit 3 for one that a debugger halts.
            config = const if $debugger_stops { 0b0001 } else { 0b1001 },
            flags = sym $crate::start::RESET_FLAGS,
        );
    };
}
