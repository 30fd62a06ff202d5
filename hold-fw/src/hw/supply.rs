//! Measures the supply: the SAADC converts VDD once in each cycle, and no task waits for it.
//!
//! The SAADC can select VDD as an internal input. With a gain of 1/6 and the internal reference of 0.6 V its full scale
//! is 3.6 V (PS v1.7, 6.23.7).

use core::sync::atomic::{compiler_fence, Ordering};

use nrf52840_hal::pac;

use super::take_event;

/// The full scale, V; `STEPS` is its number of steps with a resolution of 12 bits.
const FULL_SCALE: f32 = 3.6;
const STEPS: f32 = 4_096.0;

pub(crate) type Memory = [i16; 1];

pub(crate) struct SupplyMeter {
    saadc: pac::SAADC,
    result: &'static mut Memory,
}

impl SupplyMeter {
    pub(super) fn new(saadc: pac::SAADC, result: &'static mut Memory) -> Self {
        saadc.resolution.write(|w| w.val()._12bit());
        saadc.oversample.write(|w| w.oversample().bypass());
        saadc.samplerate.write(|w| w.mode().task());
        saadc.ch[0].pselp.write(|w| w.pselp().vdd());
        saadc.ch[0].config.write(|w| w.gain().gain1_6().refsel().internal().tacq()._10us().mode().se());
        // SAFETY: the pointer is that of `result`, which `self` owns for ever.
        saadc.result.ptr.write(|w| unsafe { w.ptr().bits(result.as_mut_ptr() as u32) });
        // SAFETY: the count is that of the one value in `result`.
        saadc.result.maxcnt.write(|w| unsafe { w.maxcnt().bits(1) });
        saadc.enable.write(|w| w.enable().enabled());
        let mut meter = Self { saadc, result };
        meter.start();
        meter
    }

    fn start(&mut self) {
        compiler_fence(Ordering::SeqCst);
        // SAFETY: 1 is a valid value of a task register.
        self.saadc.tasks_start.write(|w| unsafe { w.bits(1) });
        // SAFETY: as above.
        self.saadc.tasks_sample.write(|w| unsafe { w.bits(1) });
    }

    /// Returns the supply voltage, V, of the cycle before, and starts the next conversion. `None` if the conversion has
    /// not ended, or if its result is below 2.5 V.
    pub(crate) fn take(&mut self) -> Option<f32> {
        let ended = take_event!(self.saadc.events_end);
        compiler_fence(Ordering::SeqCst);
        let volts = f32::from(self.result[0]) * (FULL_SCALE / STEPS);
        self.result[0] = 0;
        self.start();
        // The hold stops below 2.57 V, so a lower result is an error of the measurement.
        (ended && volts > 2.5).then_some(volts)
    }
}
