//! A suite for the DPR's board that fails: what a failure looks like to who runs a suite.
//!
//! `xtask/tests/failing_suite.rs` runs it; it is none of those that `cargo xtask test` runs. Its first start ends in a
//! watchdog reset, as a suite's does that meets the watchdog of the image before it; the second ends in a test that
//! fails.
#![no_std]
#![no_main]

#[path = "dpr/protection.rs"]
mod protection;

use defmt_rtt as _;
use nrf52840_hal::pac; // the interrupt vectors too
use panic_probe as _;

/// What this start begins with.
struct Start {
    watchdog: pac::WDT,
    /// The watchdog was why.
    bitten: bool,
}

// No watchdog: a suite feeds none.
firmware_common::install_start!([]);

#[defmt_test::tests]
mod tests {
    use super::{pac, protection, Start};

    /// 50 ms of the 32 768 Hz clock.
    const TIMEOUT: u32 = 1637;

    /// 50 ms of the core's 64 MHz.
    const AGAIN: u32 = 3_200_000;

    #[init]
    fn init() -> Start {
        let device = defmt::unwrap!(pac::Peripherals::take());
        protection::open(&device.FICR, &device.UICR);
        let reason = device.POWER.resetreas.read();
        // SAFETY: bits of RESETREAS are cleared by writing ones; these are the ones just read, so every bit is defined.
        device.POWER.resetreas.write(|w| unsafe { w.bits(reason.bits()) });
        Start { watchdog: device.WDT, bitten: reason.dog().is_detected() }
    }

    #[test]
    fn the_watchdog_bites_once(start: &mut Start) {
        if start.bitten {
            // That reset took what a debugger had set up along. Who shows this suite gets the time to set it up again.
            cortex_m::asm::delay(AGAIN);
            return;
        }
        // SAFETY: 15 to 2^32 - 1 are the defined values.
        start.watchdog.crv.write(|w| unsafe { w.bits(TIMEOUT) });
        start.watchdog.tasks_start.write(|w| w.tasks_start().set_bit());
        loop {
            cortex_m::asm::nop();
        }
    }

    #[test]
    fn one_and_one_are_three() {
        defmt::assert_eq!(1 + 1, 3, "this test is made to fail");
    }

    #[test]
    fn nothing_comes_after_a_test_that_fails() {
        defmt::println!("it went on");
    }
}
