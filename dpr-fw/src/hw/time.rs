//! The µs counter (TIMER0) and the deadline of the next frame (TIMER1).

use dpr_fw::intake::Timer;
use nrf52840_hal::{pac, timer::Instance};

use super::take_event;
use crate::board::NOW_CAPTURE;

/// The prescaler of timers that count microseconds: 16 MHz / 2^4.
pub(super) const PRESCALER: u8 = 4;
/// The shortest time from now to a compare value, µs: the counter could pass a nearer value before it is set.
pub(super) const SHORTEST_US: u32 = 2;

/// Starts a timer, which counts µs in 32 bits from zero and never stops.
pub(super) fn start(timer: &impl Instance) {
    let timer = timer.as_timer0();
    timer.bitmode.write(|w| w.bitmode()._32bit());
    // SAFETY: the field has four bits and takes 0..=9 (PS v1.7, 6.30).
    timer.prescaler.write(|w| unsafe { w.prescaler().bits(PRESCALER) });
    // SAFETY: 1 is a valid value of a task register. The counter is cleared before it is started.
    timer.tasks_clear.write(|w| unsafe { w.bits(1) });
    // SAFETY: 1 is a valid value of a task register.
    timer.tasks_start.write(|w| unsafe { w.bits(1) });
}

/// Returns the µs counter's value; any task may call this. It wraps after 71 minutes.
pub(crate) fn now_us() -> u32 {
    // SAFETY: the pointer to the peripheral is valid for ever, and only this function uses this capture register. If
    // another task preempts between the two accesses and captures too, the value that is read is later than this call's
    // own capture, but still lies within the time of this call.
    let timer = unsafe { &*pac::TIMER0::ptr() };
    // SAFETY: 1 is a valid value of a task register.
    timer.tasks_capture[NOW_CAPTURE].write(|w| unsafe { w.bits(1) });
    timer.cc[NOW_CAPTURE].read().bits()
}

/// The deadline of the next frame, in TIMER1, which counts the µs since it was set.
pub(crate) struct Deadline(pac::TIMER1);

impl Deadline {
    pub(super) fn new(timer: pac::TIMER1) -> Self {
        timer.bitmode.write(|w| w.bitmode()._32bit());
        // SAFETY: the field has four bits and takes 0..=9 (PS v1.7, 6.30).
        timer.prescaler.write(|w| unsafe { w.prescaler().bits(PRESCALER) });
        timer.intenset.write(|w| w.compare0().set());
        // SAFETY: 1 is a valid value of a task register.
        timer.tasks_start.write(|w| unsafe { w.bits(1) });
        Self(timer)
    }

    /// Clears the interrupt of a deadline that has passed.
    pub(crate) fn clear(&mut self) {
        take_event!(self.0.events_compare[0]);
    }
}

impl Timer for Deadline {
    fn now_us(&self) -> u32 {
        now_us()
    }

    fn set(&mut self, at_us: u32) {
        let left_us = at_us.wrapping_sub(now_us()).cast_signed();
        // The compare value is set before the counter is cleared: otherwise a task preempted in between could let the
        // counter pass a near value, and the next match would be 71 minutes later. An early interrupt does no harm.
        // SAFETY: the compare register takes any value.
        self.0.cc[0].write(|w| unsafe { w.bits(left_us.max(0).cast_unsigned().max(SHORTEST_US)) });
        // SAFETY: 1 is a valid value of a task register.
        self.0.tasks_clear.write(|w| unsafe { w.bits(1) });
    }
}
