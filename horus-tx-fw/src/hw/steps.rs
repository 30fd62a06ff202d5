//! A one-shot timer, which raises one interrupt after a number of µs
//!
//! # Errata (ES0206 rev 24) of the timers
//!
//! - ES0206 2.7.3 concerns compare channels, which are not used here.
//!
//! `unsafe` is used here for shared access to the timers' register blocks.
#![allow(unsafe_code)]

use horus_tx_fw::timing;
use stm32f4xx_hal::pac::{self, tim3};

use super::registers::Registers;
use crate::board::Timer;

pub(super) struct Steps(Registers<tim3::RegisterBlock>);

impl Steps {
    /// Sets the timer up to count µs, without starting it.
    pub(super) fn new(timer: &Timer, rcc: &mut pac::RCC) -> Self {
        (timer.enable)(rcc);
        let steps = Self(Registers::at((timer.registers)()));
        let registers = steps.registers();
        registers.psc().write(|w| w.psc().set((timing::TICKS_PER_US - 1) as u16));
        registers.cr1().write(|w| w.urs().set_bit());
        // An update loads the prescaler now, without raising an interrupt.
        registers.egr().write(|w| w.ug().set_bit());
        registers.sr().write(|w| w.uif().clear());
        registers.dier().write(|w| w.uie().set_bit());
        steps
    }

    fn registers(&self) -> &'static tim3::RegisterBlock {
        // SAFETY: the board's table holds the address of a timer's register block, which is always there; every access
        // is volatile, and only one source uses each timer.
        unsafe { self.0.get() }
    }

    /// Starts the timer, whose interrupt comes in `us` µs, never earlier.
    pub(super) fn start(&self, us: u16) {
        let timer = self.registers();
        timer.cr1().write(|w| w.urs().set_bit());
        timer.cnt().write(|w| w.cnt().set(0));
        // The timer's update comes ARR + 1 counts after the start, so the time is never shorter than requested.
        timer.arr().write(|w| w.arr().set(us.max(1)));
        timer.sr().write(|w| w.uif().clear());
        timer.cr1().write(|w| w.urs().set_bit().opm().set_bit().cen().set_bit());
    }

    pub(super) fn stop(&self) {
        self.registers().cr1().write(|w| w.urs().set_bit());
        self.registers().sr().write(|w| w.uif().clear());
    }

    /// Returns whether the timer's time is over, and clears the timer's flag.
    pub(super) fn is_over(&self) -> bool {
        let over = self.registers().sr().read().uif().bit_is_set();
        if over {
            self.registers().sr().write(|w| w.uif().clear());
        }
        over
    }
}
