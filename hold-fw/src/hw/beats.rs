//! Raises the beats and the slot (TIMER1), and sends the frame in the slot.
//!
//! A *beat* comes every [`BEAT_MS`] ms; every [`BEATS`]th beat is a tick, the start of a cycle. The *slot* is the
//! instant in each cycle at which the frame is sent. TIMER1 counts µs and clears itself at each beat, so the beats do
//! not drift. Its interrupt has the highest priority, and no lock masks it. In each cycle the same instructions run
//! from the interrupt to the transmit command, so the command comes a constant time after the tick.

use core::sync::atomic::{AtomicU32, Ordering};

use firmware_common::nrf52840::COUNTER_PRESCALER;
use hold_fw::timing::{BEATS, BEAT_MS, SLOT_US};
use nrf52840_hal::pac;

use super::{radio, take_event};
use crate::board::{BEAT_COMPARE, SLOT_COMPARE};

/// The number of beats so far. Only the interrupt of TIMER1 writes it.
static COUNT: AtomicU32 = AtomicU32::new(0);

pub(crate) fn beat() -> u32 {
    COUNT.load(Ordering::Relaxed)
}

pub(crate) fn tick() -> u32 {
    beat() / BEATS
}

/// What has raised the interrupt of TIMER1.
pub(crate) enum Beat {
    /// A beat has begun; `is_tick` is true if this beat is a tick.
    Began { is_tick: bool },
    /// The slot of a beat.
    Slot,
    /// Nothing, which never happens.
    Nothing,
}

pub(crate) struct Beats(pac::TIMER1);

impl Beats {
    pub(super) fn new(timer: pac::TIMER1) -> Self {
        timer.bitmode.write(|w| w.bitmode()._32bit());
        // SAFETY: the field has four bits and takes 0..=9 (PS v1.7, 6.30).
        timer.prescaler.write(|w| unsafe { w.prescaler().bits(COUNTER_PRESCALER) });
        // SAFETY: the compare registers take any value.
        timer.cc[BEAT_COMPARE].write(|w| unsafe { w.bits(1_000 * BEAT_MS) });
        // SAFETY: as above.
        timer.cc[SLOT_COMPARE].write(|w| unsafe { w.bits(SLOT_US) });
        timer.shorts.write(|w| w.compare0_clear().enabled());
        timer.intenset.write(|w| w.compare0().set().compare1().set());
        Self(timer)
    }

    /// Starts the beats. The first one comes [`BEAT_MS`] ms later.
    pub(crate) fn start(&mut self) {
        // The first beat increments the count from this value to 0, the number of a tick.
        COUNT.store(u32::MAX, Ordering::Relaxed);
        // SAFETY: 1 is a valid value of a task register.
        self.0.tasks_start.write(|w| unsafe { w.bits(1) });
    }

    /// Handles the interrupt of TIMER1. In the slot it sends the loaded frame. The compare value of the slot also
    /// matches in the beats that are no tick. No frame is due in these beats.
    #[inline(always)]
    pub(crate) fn interrupt(&mut self) -> Beat {
        let is_slot = take_event!(self.0.events_compare[SLOT_COMPARE]);
        if is_slot {
            radio::fire(beat());
        }
        if take_event!(self.0.events_compare[BEAT_COMPARE]) {
            let count = beat().wrapping_add(1);
            COUNT.store(count, Ordering::Relaxed);
            return Beat::Began { is_tick: count.is_multiple_of(BEATS) };
        }
        if is_slot {
            Beat::Slot
        } else {
            Beat::Nothing
        }
    }
}
