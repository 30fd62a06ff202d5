//! A suite for the DPR's board that fails, to show how a failure looks to the person who runs a suite.
//!
//! `xtask/tests/failing_suite.rs` runs this suite; `cargo xtask test` does not. The first start ends in a watchdog
//! reset, as for a suite that is started while the watchdog of an earlier program runs. The second start ends in a test
//! that fails.
#![no_std]
#![no_main]

use defmt_rtt as _;
use nrf52840_hal::pac; // this crate also brings the interrupt vectors
use panic_probe as _;

struct Start {
    watchdog: pac::WDT,
    bitten: bool,
}

// The start code must not start the watchdog, because the suite would not feed it.
firmware_common::install_start!([]);

#[defmt_test::tests]
mod tests {
    use super::{pac, Start};

    /// The watchdog's timeout, in periods of its 32 768 Hz clock: 50 ms.
    const TIMEOUT: u32 = 1637;

    /// The delay after the watchdog's reset, in cycles of the 64 MHz core: 50 ms.
    const AGAIN: u32 = 3_200_000;

    #[init]
    fn init() -> Start {
        let device = defmt::unwrap!(pac::Peripherals::take());
        firmware_common::nrf52840::open_debug_port(&device.FICR, &device.UICR);
        let reason = device.POWER.resetreas.read();
        // SAFETY: bits of RESETREAS are cleared by writing ones; the written bits are those just read, so every bit is
        // defined.
        device.POWER.resetreas.write(|w| unsafe { w.bits(reason.bits()) });
        Start { watchdog: device.WDT, bitten: reason.dog().is_detected() }
    }

    #[test]
    fn the_watchdog_bites_once(start: &mut Start) {
        if start.bitten {
            // The watchdog's reset has also cleared a debugger's breakpoints and settings. During this delay the runner
            // makes them again.
            cortex_m::asm::delay(AGAIN);
            return;
        }
        // SAFETY: 15 to 2^32 - 1 are the defined values of this register, and TIMEOUT is one of them.
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
