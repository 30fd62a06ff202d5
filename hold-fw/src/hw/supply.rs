//! Measures the supply: the SAADC converts VDD, which is one of its inputs, once in each cycle, and no task waits for
//! it. [`hold_fw::supply`] explains what the counts mean.

use core::{
    mem,
    sync::atomic::{compiler_fence, Ordering},
};

use hold_fw::supply;
use nrf52840_hal::pac;

use super::take_event;

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
    /// not ended, or if its result is too low to be right.
    pub(crate) fn take(&mut self) -> Option<f32> {
        let ended = take_event!(self.saadc.events_end);
        compiler_fence(Ordering::SeqCst);
        let count = mem::take(&mut self.result[0]);
        self.start();
        ended.then(|| supply::volts(count)).flatten()
    }
}
