//! TIM2: the tick every 10 ms, the slots, and the command that fires a frame
//!
//! # Design
//!
//! Prescaler 1 and reload 719 999 make exactly 10 ms of the 72 MHz; the HAL would round. The interrupt of tick (update)
//! and slots (compares) has the highest priority. It shares only single words with other tasks, so no lock ever masks
//! it. In a slot, the same instructions always send the command before all other work.
//!
//! The timer itself makes the pin TICK fall with each tick: channel 3 in PWM mode 2 (RM0090, "TIMx_CCMR2") is active
//! from its compare value to the update. So an observer sees the tick without any delay by the processor.
//!
//! From `FrontEndPort::arm` to the slot, only the slot's interrupt uses the SPI. Meanwhile [`ARMED`] holds the ticket,
//! which names the slot.
//!
//! # Errata (ES0206 rev 24) of the peripherals used here
//!
//! - ES0206 2.7.3: a second compare match right after CCR changed may be missed. Workaround: CCR never changes.
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

/// The number of ticks so far. Only the interrupt of the cycle timer writes it.
static TICKS: AtomicU32 = AtomicU32::new(0);
/// The number of the last tick whose cycle of work has ended.
static ENDED: AtomicU32 = AtomicU32::new(0);
/// The result of the last slot, for the task `rf_slot`, as the word `PASSED | FIRED? | frame << 8 | response`.
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

/// Switches the timer's clock on, so that [`now_ms`] can be called. Until the timer is started, [`now_ms`] returns 0.
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
        // An update event loads the prescaler now. This event must not count as a tick.
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
                // The handler waits only here, for one byte time, because chip select must not rise before the byte's
                // end.
                // Not covered: the later polls of the SPI, which only an SPI that hangs needs, as in `radio::take`.
                let response = radio::take();
                // Not covered: the later polls of the SPI, as in `radio::deselect`.
                radio::deselect();
                ARMED.store(0, Ordering::Release);
                HORUS_TELEMETRY.record_fire(left.wrapping_sub(timing::SLOT_TICKS[frame]));
                report |= FIRED | u32::from(response);
            }
            // A slot before the first tick belongs to no cycle, so it has nothing to send and is not counted.
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
    // Not covered: a second try of the exclusive access: the only task that could interrupt it next runs 3 ms later.
    let word = SLOT.swap(0, Ordering::Acquire);
    (word & PASSED != 0).then_some(Slot {
        frame: (word >> 8 & 0xFF) as usize,
        fired: (word & FIRED != 0).then_some((word & 0xFF) as u8),
    })
}

/// Returns the milliseconds since the first tick's cycle began (wraps). The result never steps back
/// ([`timing::now_ms`]).
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

/// Calls `log` with all interrupts masked, unless that would delay a slot or the next tick. Returns whether `log` was
/// called.
pub fn when_quiet(log: impl FnOnce()) -> bool {
    cortex_m::interrupt::free(|_| {
        let quiet = is_quiet();
        if quiet {
            log();
        }
        quiet
    })
}
