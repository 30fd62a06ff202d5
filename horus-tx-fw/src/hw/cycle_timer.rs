//! TIM2: the tick every 10 ms, the slots, and the command that fires a frame
//!
//! # Design
//!
//! Prescaler 1 and reload 719 999 make exactly 10 ms of the 72 MHz; the HAL would round. The interrupt of tick (update)
//! and slots (compares) has the highest priority and shares only single words with other tasks, so no lock ever masks
//! it. The same instructions send a slot's command every time, before all other work.
//!
//! The timer itself makes the pin TICK fall with each tick: channel 3 in PWM mode 2 (RM0090, "TIMx_CCMR2") is active
//! from its compare value to the update. So an observer sees the tick without any delay by the processor.
//!
//! From `FrontEndPort::arm` to the slot only the slot's interrupt uses the SPI; [`ARMED`] says for which slot.
//!
//! # Errata (ES0206 rev 24) of the peripherals used here
//!
//! - 2.7.3: a second compare match right after CCR changed may be missed. Measure: CCR never changes.
//!
//! `unsafe` is used here for shared access to the timer's register block.
#![allow(unsafe_code)]

use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::{syst::SystClkSource, SYST};
use horus_tx_fw::{
    flow, timing,
    transmitter::{Slot, Ticket},
    FRAMES,
};
use stm32f4xx_hal::{
    pac::{self, RCC},
    rcc::Enable,
};

use super::{
    gpio::{self, Pull, Speed},
    radio::{self, ARMED},
    HORUS_TELEMETRY,
};
use crate::board;

/// The number of ticks so far, which only the cycle timer's interrupt writes.
static TICKS: AtomicU32 = AtomicU32::new(0);
/// The number of the last tick whose cycle has ended.
static ENDED: AtomicU32 = AtomicU32::new(0);
/// The result of the last slot, for the front end's task: `PASSED | FIRED? | frame << 8 | response`.
static SLOT: AtomicU32 = AtomicU32::new(0);
const PASSED: u32 = 1 << 31;
const FIRED: u32 = 1 << 30;

/// The compare channel that drives the pin TICK, counted from 0.
const TICK_CHANNEL: usize = 2;

fn tim2() -> &'static pac::tim2::RegisterBlock {
    // SAFETY: a register block is always there, and every access through it is volatile; only the timer's own interrupt
    // and its set-up write its registers.
    unsafe { &*pac::TIM2::ptr() }
}

/// Switches the timer's clock on, so that [`now_ms`] can be called. It returns 0 until the timer is started.
pub fn enable_clock(rcc: &mut RCC) {
    pac::TIM2::enable(rcc);
}

pub struct CycleTimer(());

#[derive(Clone, Copy, PartialEq, Eq)]
pub enum CycleEvent {
    /// The slot of this frame, counted from 0, has passed, so the task `rf_slot` has work.
    Slot(usize),
    /// The tick has come, so the task `cycle` has work.
    Tick,
}

impl CycleTimer {
    /// Sets the timer up without starting it. The timer's clock must be on ([`enable_clock`]).
    pub fn new(_timer: pac::TIM2) -> Self {
        let timer = tim2();
        timer.psc().write(|w| w.psc().set(0));
        timer.arr().write(|w| w.arr().set(timing::PERIOD_TICKS - 1));
        for (channel, ticks) in timing::SLOT_TICKS.into_iter().enumerate() {
            timer.ccr(channel).write(|w| w.ccr().set(ticks));
        }
        const { assert!(FRAMES <= TICK_CHANNEL, "a slot has the channel of the pin TICK") };
        timer.ccr(TICK_CHANNEL).write(|w| w.ccr().set(timing::PERIOD_TICKS - timing::TICK_PULSE_TICKS));
        timer.ccmr2_output().write(|w| w.oc3m().pwm_mode2());
        timer.ccer().write(|w| w.cc3e().set_bit());
        gpio::enable_ports();
        gpio::alternate(board::TICK, Speed::Low, Pull::None);
        // The prescaler is loaded now by an update event, which must not count as a tick.
        timer.cr1().write(|w| w.urs().set_bit());
        timer.egr().write(|w| w.ug().set_bit());
        timer.sr().write(|w| w.uif().clear());
        timer.dier().write(|w| {
            for channel in 0..FRAMES {
                w.ccie(channel as u8).set_bit();
            }
            w.uie().set_bit()
        });
        Self(())
    }

    /// Starts the cycle timer, and SysTick, which measures the times between its interrupts.
    pub fn start(&mut self, systick: &mut SYST) {
        systick.set_clock_source(SystClkSource::External);
        systick.set_reload(flow::COUNTER_TOP);
        systick.clear_current();
        systick.enable_counter();
        tim2().cr1().modify(|_, w| w.cen().set_bit());
    }

    /// Serves the timer's interrupt. A slot's command is sent first, by the same instructions every time.
    #[inline(always)]
    pub fn interrupt(&mut self) -> CycleEvent {
        let flags = tim2().sr().read();
        for frame in 0..FRAMES {
            if flags.ccif(frame as u8).bit_is_set() {
                self.slot(frame);
                return CycleEvent::Slot(frame);
            }
        }
        tim2().sr().write(|w| w.uif().clear());
        let tick = TICKS.load(Ordering::Relaxed).wrapping_add(1);
        if ENDED.load(Ordering::Relaxed) != tick.wrapping_sub(1) {
            HORUS_TELEMETRY.cycle_overruns.add(1);
        }
        TICKS.store(tick, Ordering::Relaxed);
        HORUS_TELEMETRY.cycles.set(tick);
        CycleEvent::Tick
    }

    #[inline(always)]
    fn slot(&mut self, frame: usize) {
        let mut report = PASSED | (frame as u32) << 8;
        let ticket = Ticket::from_word(ARMED.load(Ordering::Acquire));
        let tick = TICKS.load(Ordering::Relaxed);
        match ticket.due(tick, frame) {
            Some(command) => {
                radio::select();
                radio::put(command);
                let left = tim2().cnt().read().cnt().bits();
                // This is the only wait, one byte time: chip select must not rise before the byte's end.
                let response = radio::take();
                radio::deselect();
                ARMED.store(0, Ordering::Release);
                HORUS_TELEMETRY.record_fire(left.wrapping_sub(timing::SLOT_TICKS[frame]));
                report |= FIRED | u32::from(response);
            }
            // Before the first tick no cycle has begun, so there is nothing to send.
            None if tick == 0 => {}
            None => HORUS_TELEMETRY.frames_skipped.add(1),
        }
        SLOT.store(report, Ordering::Release);
        tim2().sr().write(|w| w.ccif(frame as u8).clear());
    }
}

/// Returns the counter that measures the times between slots and ticks ([`flow`]).
#[inline(always)]
pub fn counter() -> u32 {
    flow::counter(SYST::get_current())
}

/// Returns the number of the tick that is being served.
pub fn tick() -> u32 {
    TICKS.load(Ordering::Relaxed)
}

pub fn cycle_ended(tick: u32) {
    ENDED.store(tick, Ordering::Relaxed);
}

pub fn take_slot() -> Option<Slot> {
    let word = SLOT.swap(0, Ordering::Acquire);
    (word & PASSED != 0).then_some(Slot {
        frame: (word >> 8 & 0xFF) as usize,
        fired: (word & FIRED != 0).then_some((word & 0xFF) as u8),
    })
}

/// Returns the milliseconds since the first tick's cycle began (wraps). It never steps back ([`timing::now_ms`]).
pub fn now_ms() -> u32 {
    let before = tick();
    let count = tim2().cnt().read().cnt().bits();
    let due = tim2().sr().read().uif().bit_is_set();
    timing::now_ms(before, count, due, tick())
}

/// Whether a few µs of work would delay neither a slot nor the next tick.
pub fn is_quiet() -> bool {
    timing::quiet(tim2().cnt().read().cnt().bits())
}

/// Runs `log`, with all interrupts masked, if it would delay neither a slot nor the next tick. Returns whether it ran.
pub fn when_quiet(log: impl FnOnce()) -> bool {
    cortex_m::interrupt::free(|_| {
        let quiet = is_quiet();
        if quiet {
            log();
        }
        quiet
    })
}
