//! Accesses the registers for the start, and reads the µs counter.
#![allow(unsafe_code)]

use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::asm;
use nrf52840_hal::{pac, timer::Instance};
use profile::ResetReason;

use super::{
    crystal,
    debug_port::{self, DebugPort},
    reset,
};
use crate::start;

/// The registers that control access to the debug port (PS v1.7, "Debug and trace").
struct Protection<'a> {
    ficr: &'a pac::FICR,
    uicr: &'a pac::UICR,
}

/// The address of APPROTECT.DISABLE, which the PAC lacks.
const APPROTECT_DISABLE: u32 = 0x4000_0558;

impl debug_port::Registers for Protection<'_> {
    fn variant(&self) -> u32 {
        self.ficr.info.variant.read().bits()
    }

    fn uicr_approtect(&self) -> u32 {
        self.uicr.approtect.read().bits()
    }

    fn disable_protection(&mut self) {
        // SAFETY: this is called only on parts that have the register. It opens the debug port and does nothing else.
        unsafe { (APPROTECT_DISABLE as *mut u32).write_volatile(debug_port::SW_DISABLE) };
    }
}

/// Opens the debug port if the part needs that and UICR allows it ([`debug_port::open`]).
pub fn open_debug_port(ficr: &pac::FICR, uicr: &pac::UICR) -> DebugPort {
    // Not covered: the parts of other revisions than the bench's, and a debug port that UICR locks: the tests of
    // `debug_port` have both.
    debug_port::open(&mut Protection { ficr, uicr })
}

/// A word of RAM that keeps its value over every reset that leaves the RAM powered.
#[link_section = ".uninit.RAM_KEPT"]
static RAM_KEPT: AtomicU32 = AtomicU32::new(0);
/// The value of [`RAM_KEPT`] once the firmware has run since power-on.
const KEPT: u32 = 0x4450_5221;

/// Returns the reason of the last reset. To be called only once, because the first call marks the RAM as kept.
pub fn reset_reason() -> ResetReason {
    let ram_kept = RAM_KEPT.swap(KEPT, Ordering::Relaxed) == KEPT;
    reset::reason(start::reset_flags(), ram_kept)
}

/// Starts the 32 MHz crystal and waits for it, [`crystal::START_MAX_MS`] at most. Returns whether it runs. (The HAL's
/// wait has no limit.)
#[must_use]
pub fn start_crystal(clock: &pac::CLOCK) -> bool {
    // The event HFCLKSTARTED may be left over from an earlier start (anomaly 36), so it is cleared first.
    clock.events_hfclkstarted.reset();
    // SAFETY: 1 is a valid value of a task register.
    clock.tasks_hfclkstart.write(|w| unsafe { w.bits(1) });
    let is_started = || clock.events_hfclkstarted.read().bits() != 0;
    crystal::starts(is_started, || asm::delay(crystal::PAUSE_CYCLES))
}

/// The supply voltage at which a board stops, mV. The part itself needs 1.7 V, but its front end needs 2.4 V (DS13541,
/// operating conditions). The threshold has an error of 5 % at most (PS v1.7, 5.3.8), so it is 2.57 to 2.84 V: always
/// above 2.4 V and below the kit's 3.0 V.
pub const POWER_FAIL_MV: u32 = 2_700;

/// Enables the power-fail comparator and its interrupt, whose handler must not return. Returns whether the supply is
/// already below [`POWER_FAIL_MV`]. In that case the event is raised as well (PS v1.7, 5.3.3). The part's own brown-out
/// reset, at 1.6 V, is always enabled.
#[must_use]
pub fn watch_supply(power: &pac::POWER) -> bool {
    power.events_pofwarn.reset();
    power.intenset.write(|w| w.pofwarn().set());
    power.pofcon.write(|w| w.pof().enabled().threshold().v27());
    // SAFETY: the handler shares nothing, does not return, and has the highest priority, which no lock masks.
    unsafe { cortex_m::peripheral::NVIC::unmask(pac::Interrupt::POWER_CLOCK) };
    power.events_pofwarn.read().bits() != 0
}

/// The prescaler with which a timer counts µs: 16 MHz / 2^4.
pub const COUNTER_PRESCALER: u8 = 4;

/// The capture register by which every timer's present time is read. [`now_us`] uses that of TIMER0.
pub const NOW_CAPTURE: usize = 3;

/// Starts a 32-bit timer that counts µs from zero and never stops.
pub fn start_counter(timer: &impl Instance) {
    let timer = timer.as_timer0();
    timer.bitmode.write(|w| w.bitmode()._32bit());
    // SAFETY: the field has four bits and takes 0..=9 (PS v1.7, 6.30).
    timer.prescaler.write(|w| unsafe { w.prescaler().bits(COUNTER_PRESCALER) });
    // SAFETY: 1 is a valid value of a task register. The counter is cleared before it is started.
    timer.tasks_clear.write(|w| unsafe { w.bits(1) });
    // SAFETY: 1 is a valid value of a task register.
    timer.tasks_start.write(|w| unsafe { w.bits(1) });
}

/// Returns the µs counter (TIMER0). Any task may call this. The counter wraps after 71 minutes.
#[inline]
#[must_use]
pub fn now_us() -> u32 {
    // SAFETY: the pointer is valid for ever, and only this function uses this capture register. A task that preempts
    // between the two accesses may capture a later value. That value still lies within the time of this call.
    let timer = unsafe { &*pac::TIMER0::ptr() };
    // SAFETY: 1 is a valid value of a task register.
    timer.tasks_capture[NOW_CAPTURE].write(|w| unsafe { w.bits(1) });
    timer.cc[NOW_CAPTURE].read().bits()
}
