//! The clocks: which oscillator HORUS runs on, and what happens when the oscillator fails
//!
//! # Design
//!
//! [`horus_tx_fw::clock`] chooses the external clock (HSE) or the internal oscillator (HSI). This file switches HSE on
//! and waits for it before the HAL sets up the clock tree, since the HAL waits for HSE without a bound.
//!
//! **Clock security system.** From the moment at which HSE is ready, hardware compares it with HSI. When HSE fails, the
//! hardware switches HSE and the PLL off, lets the processor run on HSI's 16 MHz, and raises the non-maskable interrupt
//! (RM0090 "Reset and clock control", clock security system). The clock is then nine times too slow, so neither the
//! cycle nor the baud rates hold. Therefore the board enters the safe state: field off, then reset by the watchdog,
//! which has its own oscillator (LSI). At the next start HORUS runs on HSI, with all dividers as they should be.
//!
//! # Errata (ES0206 rev 24) of the peripherals used here
//!
//! - ES0206 2.2.7: a peripheral does not answer for some cycles after its clock is enabled. Workaround: the HAL's
//!   `enable` waits for the write (DSB) before it returns.
//!
//! `unsafe` is used here for the exception handler, and for its access to RCC.
#![allow(unsafe_code)]

use cortex_m::asm;
use cortex_m_rt::exception;
use firmware_common::{
    last_stop::{self, Cause, Stop},
    safe_state,
};
use horus_tx_fw::{
    clock::{self, Source},
    timing,
};
use stm32f4xx_hal::{
    pac,
    prelude::*,
    rcc::{Config, Rcc},
};

use super::HORUS_TELEMETRY;

/// Sets the clock tree up, from HSE if it is there, otherwise from HSI. It takes [`clock::START_MAX_MS`] and the PLL's
/// lock time at most. The HAL waits for the PLL without a bound: if the PLL never gets ready, the watchdog resets the
/// part, and the record of the last stop states the cause ([`Cause::ClockStart`], with the PLL's source as its detail).
///
/// # Panics
///
/// Panics if the clock tree differs from the one from which the timing was derived.
pub fn start(rcc: pac::RCC) -> (Rcc, Source) {
    let source = start_external(&rcc);
    HORUS_TELEMETRY.without_crystal.set(u32::from(source == Source::Internal));
    let config = match source {
        // The ST-LINK feeds its 8 MHz (MCO) into OSC_IN, because the board has no crystal for the part.
        Source::External => Config::hse(clock::EXTERNAL_HZ.Hz()).bypass_hse_oscillator(),
        Source::Internal => Config::hsi(),
    };
    let config = config
        .sysclk(timing::CORE_HZ.Hz())
        .hclk(timing::CORE_HZ.Hz())
        .pclk1(timing::APB1_HZ.Hz())
        .pclk2(timing::APB2_HZ.Hz());
    // Not covered: the dividers of other clocks in the HAL, and the over-drive for more than 168 MHz: all frequencies
    // are constants.
    let rcc = last_stop::unless_over(&Stop::new(Cause::ClockStart, 0, source as u32), || rcc.freeze(config));
    // Not covered: a clock that differs, which leads to the panic: all frequencies are constants.
    assert!(
        rcc.clocks.hclk() == timing::CORE_HZ.Hz::<1, 1>()
            && rcc.clocks.timclk1() == timing::TIMER_HZ.Hz::<1, 1>()
            && rcc.clocks.pclk1() == timing::APB1_HZ.Hz::<1, 1>()
            && rcc.clocks.pclk2() == timing::APB2_HZ.Hz::<1, 1>(),
        "the clock tree is not the one the timing was derived for"
    );
    (rcc, source)
}

/// Switches HSE on, and the clock security system once HSE is ready. If HSE does not get ready in time, switches HSE
/// off again.
fn start_external(rcc: &pac::RCC) -> Source {
    // The bypass of HSE can only be chosen while HSE is off (RM0090, RCC_CR).
    rcc.cr().modify(|_, w| w.hsebyp().bypassed());
    rcc.cr().modify(|_, w| w.hseon().on());
    let source = clock::choose(|| rcc.cr().read().hserdy().is_ready(), || asm::delay(clock::PAUSE_CYCLES));
    match source {
        Source::External => rcc.cr().modify(|_, w| w.csson().on()),
        Source::Internal => rcc.cr().modify(|_, w| w.hseon().off()),
    };
    source
}

/// Stops HORUS because HSE has failed. No other event raises the non-maskable interrupt on this part.
// SAFETY: the handler does not return, so no state of the code that it interrupted is used again.
#[exception]
unsafe fn NonMaskableInt() -> ! {
    // SAFETY: a register block is always there, and every access is volatile; no other code writes CIR.
    let rcc = unsafe { &*pac::RCC::ptr() };
    // The flag is cleared, because the exception is raised again and again until then (RM0090, clock security system).
    let failed = rcc.cir().read().cssf().bit_is_set();
    rcc.cir().write(|w| w.cssc().set_bit());
    let stop = || Stop::new(Cause::Clock, safe_state::active_exception(), u32::from(failed));
    safe_state::enter(super::safe_state, stop, |_| {
        if failed {
            defmt::error!("the external clock has failed");
        } else {
            defmt::error!("non-maskable interrupt, but not from the clock security system");
        }
    })
}
