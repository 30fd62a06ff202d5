//! TIM2: the tick every 10 ms, the slots, and the command that fires a frame
//!
//! # Design
//!
//! Prescaler 1 and reload 719 999 make exactly 10 ms of the 72 MHz; the HAL's rounding of a frequency would not. The
//! update is the tick, the compare channels are the slots. The interrupt of both has the highest priority and shares
//! nothing with other tasks but single words, so no lock ever masks it: a slot's command leaves by the same
//! instructions every time, and everything else comes after it.
//!
//! The pin TICK falls with each tick, by the timer itself: channel 3 in PWM mode 2 (RM0090, "TIMx_CCMR2") is active
//! from its compare value to the update. So whoever watches the board from outside sees the tick and not what the
//! processor makes of it. The pin rests low until the timer runs, since the counter then stands at 0.
//!
//! Between `FrontEndPort::arm` and the slot the SPI is the slot's; the word in [`ARMED`] says for which slot.
//!
//! # Errata (ES0206 rev 24) of what is used here
//!
//! - 2.7.3: a second compare match right after CCR changed may be missed. Here: CCR never changes.
//!
//! `unsafe` here: shared access to the timer's register block.
#![allow(unsafe_code)]

use core::sync::atomic::{AtomicU32, Ordering};

use horus_tx_fw::{
    timing,
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

/// The ticks so far; written by the cycle timer's interrupt alone.
static TICKS: AtomicU32 = AtomicU32::new(0);
/// The tick whose cycle has ended.
static ENDED: AtomicU32 = AtomicU32::new(0);
/// What the last slot came to, for the radio's task: `PASSED | FIRED? | frame << 8 | response`.
static SLOT: AtomicU32 = AtomicU32::new(0);
const PASSED: u32 = 1 << 31;
const FIRED: u32 = 1 << 30;

/// The compare channel that drives the pin TICK, from 0.
const TICK_CHANNEL: usize = 2;

fn tim2() -> &'static pac::tim2::RegisterBlock {
    // SAFETY: a register block is always there, and every access through it is volatile; outside the timer's own
    // interrupt and its set-up it is only read.
    unsafe { &*pac::TIM2::ptr() }
}

/// Switches the timer's clock on, so that [`now_ms`] can be called (it reads 0 until the timer is started).
pub fn enable_clock(rcc: &mut RCC) {
    pac::TIM2::enable(rcc);
}

/// TIM2: the 10 ms cycle and its slots.
pub struct CycleTimer(());

/// What the cycle timer's interrupt was for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum CycleEvent {
    /// A slot has passed: the radio's task has something to do.
    Slot,
    /// The tick: the cycle's task has.
    Tick,
}

impl CycleTimer {
    /// Sets the timer up, stopped. Its clock must be on ([`enable_clock`]).
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
        // Load the prescaler now, and do not call that a tick.
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

    /// Starts the first cycle.
    pub fn start(&mut self) {
        tim2().cr1().modify(|_, w| w.cen().set_bit());
    }

    /// Serves the timer's interrupt. A slot's command leaves first, by the same instructions every time; everything
    /// else comes after it.
    #[inline(always)]
    pub fn interrupt(&mut self) -> CycleEvent {
        let flags = tim2().sr().read();
        for frame in 0..FRAMES {
            if flags.ccif(frame as u8).bit_is_set() {
                self.slot(frame);
                return CycleEvent::Slot;
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
                // One byte time, the only wait at this priority: chip select has to rise after it.
                let response = radio::take();
                radio::deselect();
                ARMED.store(0, Ordering::Release);
                HORUS_TELEMETRY.record_fire(left.wrapping_sub(timing::SLOT_TICKS[frame]));
                report |= FIRED | u32::from(response);
            }
            // Before the first tick no cycle has begun that could have anything to send.
            None if tick == 0 => {}
            None => HORUS_TELEMETRY.frames_skipped.add(1),
        }
        SLOT.store(report, Ordering::Release);
        tim2().sr().write(|w| w.ccif(frame as u8).clear());
    }
}

/// The number of the tick that is being served.
pub fn tick() -> u32 {
    TICKS.load(Ordering::Relaxed)
}

/// Notes that the cycle of `tick` has ended.
pub fn cycle_ended(tick: u32) {
    ENDED.store(tick, Ordering::Relaxed);
}

/// Takes what the last slot came to; `None` if that was taken before.
pub fn take_slot() -> Option<Slot> {
    let word = SLOT.swap(0, Ordering::Acquire);
    (word & PASSED != 0).then_some(Slot {
        frame: (word >> 8 & 0xFF) as usize,
        fired: (word & FIRED != 0).then_some((word & 0xFF) as u8),
    })
}

/// Milliseconds since the first tick's cycle began, wraps. It never steps back ([`timing::now_ms`]).
pub fn now_ms() -> u32 {
    let before = tick();
    let count = tim2().cnt().read().cnt().bits();
    let due = tim2().sr().read().uif().bit_is_set();
    timing::now_ms(before, count, due, tick())
}

/// Whether the rest of the cycle has no slot and no tick left that a few microseconds of work could delay.
pub fn is_quiet() -> bool {
    timing::quiet(tim2().cnt().read().cnt().bits())
}

/// Runs `log` if the rest of the cycle has no slot and no tick left that it could delay, and tells whether it did. A
/// log message masks all interrupts while it is written; the check and the message are one such section.
pub fn when_quiet(log: impl FnOnce()) -> bool {
    cortex_m::interrupt::free(|_| {
        let quiet = is_quiet();
        if quiet {
            log();
        }
        quiet
    })
}
