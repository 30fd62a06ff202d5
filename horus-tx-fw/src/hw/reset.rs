//! Resets: their reason, and how many the watchdog has made
//!
//! `unsafe` here: the section of memory that the start leaves as it is.
#![allow(unsafe_code)]

use core::sync::atomic::{AtomicU32, Ordering};

use horus_tx_fw::reset;
use profile::ResetReason;
use stm32f4xx_hal::pac;

use super::HORUS_TELEMETRY;

/// Survives every reset but that of the supply: `MAGIC`, then the watchdog's resets so far.
#[link_section = ".uninit.RESETS"]
static RESETS: [AtomicU32; 2] = [const { AtomicU32::new(0) }; 2];
const MAGIC: u32 = 0x484F_5255;

/// Reads the reset flags and clears them, counts the watchdog's resets since the supply came on, and gives the reason
/// of this start. To be called once.
pub fn note_reason(rcc: &pac::RCC) -> ResetReason {
    let reason = reset::reason(rcc.csr().read().bits());
    rcc.csr().modify(|_, w| w.rmvf().set_bit());
    let [magic, count] = &RESETS;
    // What the memory holds after the supply came on is arbitrary.
    if magic.load(Ordering::Relaxed) != MAGIC || reason == ResetReason::PowerOn {
        magic.store(MAGIC, Ordering::Relaxed);
        count.store(0, Ordering::Relaxed);
    }
    if reason == ResetReason::Watchdog {
        count.fetch_add(1, Ordering::Relaxed);
    }
    HORUS_TELEMETRY.watchdog_resets.set(count.load(Ordering::Relaxed));
    HORUS_TELEMETRY.reset_reason.set(reason as u32);
    reason
}
