//! The timer TIMER1, which watches the deadline of the next frame.

use dpr_fw::intake::Timer;
pub(super) use firmware_common::nrf52840::COUNTER_PRESCALER as PRESCALER;
use nrf52840_hal::pac;

use super::{now_us, take_event};
/// The shortest time from now to a compare value, µs. The counter could pass a nearer value before it is set.
pub(super) const SHORTEST_US: u32 = 2;

/// The deadline of the next frame. It is kept in TIMER1, which counts the µs since the deadline was set.
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

    pub(crate) fn clear(&mut self) -> bool {
        take_event!(self.0.events_compare[0])
    }
}

impl Timer for Deadline {
    fn now_us(&self) -> u32 {
        now_us()
    }

    fn set(&mut self, at_us: u32) {
        let left_us = at_us.wrapping_sub(now_us()).cast_signed();
        // The compare value is set before the counter is cleared. In the other order a task that preempts in between
        // could let the counter pass a near value, and the next match would be 71 minutes later. An early interrupt
        // does no harm.
        // SAFETY: the compare register takes any value.
        self.0.cc[0].write(|w| unsafe { w.bits(left_us.max(0).cast_unsigned().max(SHORTEST_US)) });
        // SAFETY: 1 is a valid value of a task register.
        self.0.tasks_clear.write(|w| unsafe { w.bits(1) });
    }
}
