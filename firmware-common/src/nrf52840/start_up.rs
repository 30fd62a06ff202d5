//! The first instructions after a reset ([`start`](crate::start)): they save the reset reasons and start the watchdog.
//!
//! RESETREAS collects reasons until each is cleared by writing a one (PS v1.7, 5.3.7.8). All are cleared before the
//! watchdog starts, so after a watchdog reset only the watchdog's bit is set, even if the firmware had not reached
//! `hw::init`. Otherwise an earlier bit of the reset pin would hide that of the watchdog (anomaly 136).
//!
//! After a soft reset or a lockup the watchdog still runs with its registers locked, so it is left as it is. Otherwise
//! it is started in assembler, because the HAL's code cannot run before statics are set up. The HAL's handle is
//! recovered from the running watchdog later.

/// Installs the first instructions of a firmware for the nRF52840. The watchdog resets the part 100 ms after its last
/// feed. The watchdog counts while the processor sleeps and, unless `$debugger_stops` is true, while a debugger halts
/// it.
#[macro_export]
macro_rules! install_nrf52840_start {
    ($debugger_stops:expr) => {
        $crate::install_start!(
            [
                // POWER.RESETREAS holds the reset reasons.
                "ldr r0, =0x40000400",
                "ldr r1, [r0]",
                "str r1, [r0]",
                // The WDT's registers are used in this order: RUNSTATUS, CRV, CONFIG, RREN, TASKS_START.
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
            // In CONFIG (PS v1.7, 6.36), bit 0 makes the watchdog count while the processor sleeps, bit 3 while a
            // debugger halts it.
            config = const if $debugger_stops { 0b0001 } else { 0b1001 },
            flags = sym $crate::start::RESET_FLAGS,
        );
    };
}
