//! The supply: what happens when it is too low for 144 MHz
//!
//! # Design
//!
//! At 144 MHz flash needs four wait states from 2.7 V on and more below (RM0090, table "Number of wait states according
//! to CPU clock frequency"). With a lower supply the processor may read wrong instructions and carry them out. Three
//! measures prevent that:
//!
//! | supply | consequence | cause |
//! |---|---|---|
//! | falls below 2.95 to 3.09 V | safe state: field off; [`Cause::Supply`] | the interrupt of the voltage detector |
//! | falls below 2.75 to 2.88 V | reset, for as long as it lasts | the part: brown-out level 3 in its option bytes |
//! | any, if another brown-out level is set | safe state at the start; [`Cause::BrownOutLevel`] | [`brown_out_level`] |
//!
//! Thresholds: DS9405, "Embedded reset and power control block characteristics". The detector is set to its highest
//! level, because no other level is above the brown-out level in every part. The board's regulator gives 3.3 V ± 2 %.
//! That is above the level from which the detector accepts the supply again (3.07 to 3.21 V).
//!
//! A part as delivered has no brown-out reset above 1.7 V; `cargo xtask flash horus` sets the level. In a safe state
//! the watchdog resets the part, which stops again at each start until the supply is high enough.
//!
//! The voltage detector's interrupt has the highest priority, which no lock masks. Its handler shares no data and does
//! not return.
//!
//! `unsafe` is used here for the exception handler, to unmask its interrupt, and for registers that nothing else uses.
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

/// The bit of the voltage detector's EXTI line (RM0090, "External interrupt/event line mapping").
const LINE: u32 = 1 << 16;

/// Returns the brown-out level in the option bytes as this start has loaded them.
pub fn brown_out_level() -> u32 {
    // SAFETY: a register block is always there, and this code only reads a register, which has no side effect.
    supply::brown_out_level(unsafe { &*pac::FLASH::ptr() }.optcr().read().bits())
}

/// Switches the voltage detector and its interrupt on. Returns whether the supply is too low already.
pub fn watch(rcc: &mut Rcc) -> bool {
    pac::PWR::enable(rcc);
    // SAFETY: register blocks are always there, and no other code uses PWR or this line of EXTI.
    let (exti, pwr) = unsafe { (&*pac::EXTI::ptr(), &*pac::PWR::ptr()) };
    // The detector's output rises when the supply falls. The interrupt is enabled before the detector is switched on,
    // so that a supply that is already too low raises it as well.
    // SAFETY: RM0090 defines the line's bit in this register.
    exti.rtsr().modify(|r, w| unsafe { w.bits(r.bits() | LINE) });
    // SAFETY: RM0090 defines the line's bit in this register.
    exti.imr().modify(|r, w| unsafe { w.bits(r.bits() | LINE) });
    // SAFETY: RM0090 defines the detector's bits in this register.
    pwr.cr().modify(|r, w| unsafe { w.bits(r.bits() | DETECTOR) });
    asm::dsb();
    // SAFETY: the interrupt's handler shares no data with other code.
    unsafe { NVIC::unmask(Interrupt::PVD) };
    pwr.csr().read().pvdo().bit_is_set()
}

pub fn stop() -> ! {
    let stop = || Stop::new(Cause::Supply, safe_state::active_exception(), supply::DETECTOR_MV);
    safe_state::enter(super::safe_state, stop, |stop| super::log_stop("supply", stop))
}

#[interrupt]
fn PVD() -> ! {
    stop()
}
