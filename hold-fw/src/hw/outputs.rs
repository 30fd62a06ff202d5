//! Drives heater and cooler (PWM0) and the lock.
//!
//! PWM0 repeats one pair of duties until the next pair is given. While PWM0 is disabled, the GPIO drives its pins low,
//! so heater and cooler are off.

use core::sync::atomic::{compiler_fence, Ordering};

use embedded_hal::digital::{OutputPin, PinState};
use hold_fw::{climate::Duty, state};
use nrf52840_hal::{
    gpio::{Output, Pin, PushPull},
    pac,
};

use crate::board::OutputPins;

/// The number of counts in a PWM period of 1 ms.
const TOP: u16 = 1_000;
/// The bit of a duty that makes the pin high from the start of the period until the duty's count (PS v1.7, 6.17).
const HIGH_FIRST: u16 = 1 << 15;

/// The duties that the PWM's DMA reads, one for each of four channels.
pub(crate) type Memory = [u16; 4];

pub(crate) struct Outputs {
    pwm: pac::PWM0,
    lock: Pin<Output<PushPull>>,
    duties: &'static mut Memory,
}

impl Outputs {
    pub(super) fn new(pwm: pac::PWM0, pins: OutputPins, duties: &'static mut Memory) -> Self {
        let OutputPins { heater, cooler, lock } = pins;
        for (select, pin) in pwm.psel.out.iter().zip([heater, cooler]) {
            // SAFETY: the selector is that of an output, which the PWM owns from now on.
            select.write(|w| unsafe { w.bits(pin.psel_bits()) });
        }
        // 16 MHz / 2^4 gives a count of 1 µs.
        pwm.prescaler.write(|w| w.prescaler().div_16());
        // SAFETY: the field has 15 bits and takes 3..=32767 (PS v1.7, 6.17).
        pwm.countertop.write(|w| unsafe { w.countertop().bits(TOP) });
        pwm.decoder.write(|w| w.load().individual().mode().refresh_count());
        // SAFETY: the pointer is that of `duties`, which `self` owns for ever.
        pwm.seq0.ptr.write(|w| unsafe { w.bits(duties.as_ptr() as u32) });
        // SAFETY: the count is the number of `duties`.
        pwm.seq0.cnt.write(|w| unsafe { w.bits(duties.len() as u32) });
        pwm.seq0.refresh.reset();
        pwm.enable.write(|w| w.enable().enabled());
        let mut outputs = Self { pwm, lock, duties };
        outputs.play(Duty::default());
        outputs
    }

    fn play(&mut self, duty: Duty) {
        let [heater, cooler] = duty.counts(TOP);
        // The DMA may read the duties between the two stores. So the output that goes off is stored first, and heater
        // and cooler are never on at once.
        if heater == 0 {
            (self.duties[0], self.duties[1]) = (HIGH_FIRST, cooler | HIGH_FIRST);
        } else {
            (self.duties[1], self.duties[0]) = (HIGH_FIRST, heater | HIGH_FIRST);
        }
        compiler_fence(Ordering::SeqCst);
        // SAFETY: 1 is a valid value of a task register.
        self.pwm.tasks_seqstart[0].write(|w| unsafe { w.bits(1) });
    }

    pub(crate) fn apply(&mut self, wanted: state::Outputs) {
        self.play(Duty::of(wanted.output));
        let Ok(()) = self.lock.set_state(if wanted.locked { PinState::High } else { PinState::Low });
    }
}

/// Switches heater and cooler off. This may be called before they are set up. All interrupts must be masked for good.
pub(super) fn off() {
    // SAFETY: a register block is always there, and no task runs any more.
    let pwm = unsafe { &*pac::PWM0::ptr() };
    pwm.enable.write(|w| w.enable().disabled());
}
