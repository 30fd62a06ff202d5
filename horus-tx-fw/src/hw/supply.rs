//! The supply: what happens when it is too low for 144 MHz
//!
//! # Design
//!
//! At 144 MHz flash needs four wait states from 2.7 V on and more below (RM0090, table "Number of wait states according
//! to CPU clock frequency"). Below that the processor may read instructions wrongly and go on. Three things keep it
//! from that:
//!
//! | supply | what | by |
//! |---|---|---|
//! | falls below 2.95 to 3.09 V | safe state: field off; [`Cause::Supply`] | the voltage detector's interrupt |
//! | falls below 2.75 to 2.88 V | reset, for as long as it lasts | the part: brown-out level 3 in its option bytes |
//! | any, with another level there | safe state at the start; [`Cause::BrownOutLevel`] | [`brown_out_level`] |
//!
//! Thresholds: DS9405, "Embedded reset and power control block characteristics". The detector is set to its highest
//! level: it is the only one that is above the brown-out level in every part. The board's regulator gives 3.3 V ± 2 %,
//! which is above the level from which the detector is content again (3.07 to 3.21 V).
//!
//! A part as delivered has no brown-out reset above 1.7 V; `cargo xtask flash horus` sets the level. The supply that is
//! too low already when the detector is switched on is a reason to stop too. In a safe state the watchdog restarts the
//! part, which stops again until the supply is sound.
//!
//! The interrupt has the highest priority there is, which no lock masks, and is no task: it shares nothing and does not
//! return.
//!
//! `unsafe` here: the exception handler, unmasking its interrupt, and registers that nothing else uses.
#![allow(unsafe_code)]

use cortex_m::{asm, peripheral::NVIC};
use firmware_common::{
    last_stop::{Cause, Stop},
    safe_state,
};
use horus_tx_fw::supply::{self, DETECTOR};
use stm32f4xx_hal::{
    pac::{self, interrupt, Interrupt},
    rcc::{Enable, Rcc},
};

/// The detector's line of EXTI (RM0090, "External interrupt/event line mapping").
const LINE: u32 = 1 << 16;

/// The brown-out level in the option bytes as this start has loaded them.
pub fn brown_out_level() -> u32 {
    // SAFETY: a register block is always there; a register without side effect is read.
    supply::brown_out_level(unsafe { &*pac::FLASH::ptr() }.optcr().read().bits())
}

/// Switches the voltage detector and its interrupt on; whether the supply is below it already.
pub fn watch(rcc: &mut Rcc) -> bool {
    pac::PWR::enable(rcc);
    // SAFETY: register blocks are always there, and nothing else uses PWR or this line of EXTI.
    let (exti, pwr) = unsafe { (&*pac::EXTI::ptr(), &*pac::PWR::ptr()) };
    // The interrupt first: what the detector finds when it is switched on must not be lost. Its output rises when the
    // supply falls.
    // SAFETY: the line's bit is one that RM0090 has in this register.
    exti.rtsr().modify(|r, w| unsafe { w.bits(r.bits() | LINE) });
    // SAFETY: as above.
    exti.imr().modify(|r, w| unsafe { w.bits(r.bits() | LINE) });
    // SAFETY: the detector's bits are those that RM0090 has in this register.
    pwr.cr().modify(|r, w| unsafe { w.bits(r.bits() | DETECTOR) });
    asm::dsb();
    // SAFETY: its handler shares nothing.
    unsafe { NVIC::unmask(Interrupt::PVD) };
    pwr.csr().read().pvdo().bit_is_set()
}

/// Stops: the supply is too low.
pub fn stop() -> ! {
    let stop = || Stop::new(Cause::Supply, safe_state::active_exception(), supply::DETECTOR_MV);
    safe_state::enter(super::safe_state, stop, |stop| super::log_stop("supply", stop))
}

#[interrupt]
fn PVD() -> ! {
    stop()
}
