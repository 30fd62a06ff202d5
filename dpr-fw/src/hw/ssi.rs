//! The SSI: SPIS1, the FRESH pin, the expiry of the image in hardware, and the pause after a transaction.
//!
//! `tests/interleavings/board/port.rs` models these register accesses in the same order and explores every order of
//! events. A change of this file needs the same change there.

use core::{
    ops::Range,
    sync::atomic::{compiler_fence, Ordering},
};

use dpr_fw::{
    port::areas::{HandedOver, SsiEnd, Transaction},
    publish::{Doorbell, Events, Ssi, EXPIRY_AGAIN_US, EXPIRY_US},
    ssi::{Asked, SignOfLife, PAUSE_US, RECEIVE_BYTES},
    task::Task,
    triple::{Filling, Received},
};
use nrf52840_hal::pac;

use super::{take_event, time::PRESCALER, AreaBuffer, ImageBuffer, DPR_TELEMETRY};
use crate::board::{
    call, call_step, SsiPins, EXPIRY_COMPARES, FRESH_CHANNEL, PAUSE_COMPARE, PULSE_COMPARE, SSI_SELECT_PIN,
};

/// The length of the FRESH pulse, µs: long enough for a pin interrupt of the flight controller and for an optocoupler
/// of 1 Mbit/s. The pulse may be one µs shorter.
const FRESH_US: u32 = 2;

/// The operations on the SSI that other tasks than the SSI task may use. They only read registers and make single
/// writes to task registers, so they are allowed at any time.
#[derive(Clone, Copy)]
pub(crate) struct SsiDoorbell;

impl SsiDoorbell {
    /// Whether the SSI is set up. Until it is, the tasks of SPIS1 must not be triggered.
    pub(crate) fn is_enabled() -> bool {
        // SAFETY: the pointer to the peripheral is valid for ever, and reading a register races with nothing.
        let spis = unsafe { &*pac::SPIS1::ptr() };
        spis.enable.read().enable().is_enabled()
    }

    /// Whether the SPIS owns the buffers. After a request for the semaphore, that means that a transaction is in
    /// progress.
    fn is_under_way() -> bool {
        // SAFETY: the pointer to the peripheral is valid for ever, and only a read-only register is read, which races
        // with nothing.
        let holder = unsafe { &*pac::SPIS1::ptr() }.semstat.read().semstat();
        holder.is_spis() || holder.is_cpupending()
    }

    fn call() {
        call(Task::ssi_end);
    }

    /// Ends the pause after a transaction, so that END and ACQUIRED call the SSI task again. If either has come
    /// meanwhile, it calls the task at once. Only the task of TIMER3 calls this function, at the SSI task's priority.
    /// If the SSI task has begun another pause, it has cleared the compare event, and nothing is done.
    pub(crate) fn end_pause() {
        // SAFETY: the pointers to both peripherals are valid for ever. Only this task and the SSI task use the event,
        // and they do not interrupt each other; INTENSET changes only the bits that are written.
        let (spis, pause) = unsafe { (&*pac::SPIS1::ptr(), &*pac::TIMER3::ptr()) };
        if take_event!(pause.events_compare[PAUSE_COMPARE]) {
            spis.intenset.write(|w| w.end().set().acquired().set());
        }
    }

    /// Calls both tasks of the SSI so that they check in, unless transactions call them anyway.
    pub(crate) fn ask_for_sign_of_life(sign: &mut SignOfLife) {
        // SAFETY: the pointer to the port is valid for ever, and reading its input register races with nothing.
        let levels = unsafe { &*pac::P1::ptr() }.in_.read().bits();
        let is_selected = levels & 1 << SSI_SELECT_PIN == 0;
        if sign.is_due(DPR_TELEMETRY.ssi_transactions.get(), is_selected) {
            Self::call();
            call(Task::ssi_pause);
        }
    }
}

impl Doorbell for SsiDoorbell {
    fn request(&mut self) -> bool {
        // SAFETY: the pointer to the peripheral is valid for ever; only a task register is written and a read-only one
        // read, which races with nothing.
        let spis = unsafe { &*pac::SPIS1::ptr() };
        // SAFETY: 1 is a valid value of a task register.
        spis.tasks_acquire.write(|w| unsafe { w.bits(1) });
        let is_under_way = Self::is_under_way();
        // The end of a transaction calls the SSI task by the event END, and an earlier call would only delay the task.
        // Between transactions no event may come, so the task is called here.
        if !is_under_way {
            Self::call();
        }
        is_under_way
    }

    fn announce(&mut self) {
        // SAFETY: the pointer to the peripheral is valid for ever, and the task register acts only on FRESH's channel.
        let gpiote = unsafe { &*pac::GPIOTE::ptr() };
        // SAFETY: the pointer to the peripheral is valid for ever, and only this file uses TIMER2.
        let timer = unsafe { &*pac::TIMER2::ptr() };
        // SAFETY: 1 is a valid value of a task register.
        gpiote.tasks_set[FRESH_CHANNEL].write(|w| unsafe { w.bits(1) });
        // SAFETY: 1 is a valid value of a task register.
        timer.tasks_clear.write(|w| unsafe { w.bits(1) });
        // The expiry timer was just cleared, and its next compare is 25 ms away. So a compare event that is set now is
        // an old one.
        timer.events_compare[EXPIRY_COMPARES[0]].reset();
    }
}

/// SPIS1 with its timers, the image that it streams, and the area that it receives into.
pub(crate) struct SsiPort {
    spis: pac::SPIS1,
    timer: pac::TIMER2,
    pause: pac::TIMER3,
    /// The pins belong to this type, so no other code configures them.
    _pins: SsiPins,
    /// The area that receives the next transaction's bytes; `None` only within `hand_over`.
    area: Option<Filling<AreaBuffer>>,
    areas: SsiEnd<'static, AreaBuffer>,
    /// The number of bytes that came in during the last transaction.
    received: usize,
    image: Option<Received<ImageBuffer, ()>>,
    granted: bool,
}

impl SsiPort {
    /// Enables the SPIS, but leaves the buffers with the processor, so that every transaction reads 0xFF.
    pub(super) fn new(
        spis: pac::SPIS1,
        (timer, pause): (pac::TIMER2, pac::TIMER3),
        pins: SsiPins,
        (area, areas): (Filling<AreaBuffer>, SsiEnd<'static, AreaBuffer>),
    ) -> Self {
        timer.bitmode.write(|w| w.bitmode()._32bit());
        // SAFETY: the field has four bits and takes 0..=9 (PS v1.7, 6.30).
        timer.prescaler.write(|w| unsafe { w.prescaler().bits(PRESCALER) });
        for (compare, us) in EXPIRY_COMPARES.into_iter().zip([EXPIRY_US, EXPIRY_US + EXPIRY_AGAIN_US]) {
            // SAFETY: the compare register takes any value.
            timer.cc[compare].write(|w| unsafe { w.bits(us) });
        }
        // SAFETY: the compare register takes any value.
        timer.cc[PULSE_COMPARE].write(|w| unsafe { w.bits(FRESH_US) });
        // The expiry timer runs from now on. Its compares do no harm before the first image.
        // SAFETY: 1 is a valid value of a task register.
        timer.tasks_start.write(|w| unsafe { w.bits(1) });
        pause.bitmode.write(|w| w.bitmode()._32bit());
        // SAFETY: the field has four bits and takes 0..=9 (PS v1.7, 6.30).
        pause.prescaler.write(|w| unsafe { w.prescaler().bits(PRESCALER) });
        // SAFETY: the compare register takes any value.
        pause.cc[PAUSE_COMPARE].write(|w| unsafe { w.bits(PAUSE_US) });
        pause.shorts.write(|w| w.compare0_stop().enabled());
        pause.intenset.write(|w| w.compare0().set());
        // SAFETY: (all four) each value is the selector of a pin that `pins` owns and that is configured as an input
        // (PS v1.7, 6.26.4); the peripheral itself configures MISO.
        spis.psel.sck.write(|w| unsafe { w.bits(pins.clock.psel_bits()) });
        // SAFETY: the selector is that of the MOSI pin, which `pins` owns.
        spis.psel.mosi.write(|w| unsafe { w.bits(pins.mosi.psel_bits()) });
        // SAFETY: the selector is that of the MISO pin, which `pins` owns.
        spis.psel.miso.write(|w| unsafe { w.bits(pins.miso.psel_bits()) });
        // SAFETY: the selector is that of the chip select pin, which `pins` owns.
        spis.psel.csn.write(|w| unsafe { w.bits(pins.select.psel_bits()) });
        spis.config.write(|w| w.order().msb_first().cpha().leading().cpol().active_high());
        // SAFETY: the default character may be any byte. 0xFF is used, since no CRC accepts 0xFF throughout.
        spis.def.write(|w| unsafe { w.def().bits(0xFF) });
        // SAFETY: the over-read character may be any byte.
        spis.orc.write(|w| unsafe { w.orc().bits(0xFF) });
        // SAFETY: this is the length of every receive area (`ReceiveArea`), and it fits 16 bits.
        spis.rxd.maxcnt.write(|w| unsafe { w.maxcnt().bits(RECEIVE_BYTES as u16) });
        spis.shorts.write(|w| w.end_acquire().enabled());
        spis.intenset.write(|w| w.end().set().acquired().set());
        spis.enable.write(|w| w.enable().enabled());
        Self { spis, timer, pause, _pins: pins, area: Some(area), areas, received: 0, image: None, granted: false }
    }
}

impl Ssi for SsiPort {
    type Buffer = ImageBuffer;

    /// Reads the semaphore before the END event. If a transaction ends between the two reads, this call returns its
    /// end, and the next call returns the semaphore. In the other order the task could hand the buffers out again
    /// before it had noticed the transaction (the fault of openthread#5703).
    fn take_events(&mut self) -> Events<'_> {
        take_event!(self.spis.events_acquired);
        let ours = self.spis.semstat.read().semstat().is_cpu();
        let ended = take_event!(self.spis.events_end);
        if ours || ended {
            // Between the end of a transaction and the next release, both buffers belong to the processor.
            compiler_fence(Ordering::SeqCst);
        }
        // Not covered: a call without the semaphore, as in `Server::serve`.
        if ours {
            self.granted = false;
        }
        if !ended {
            return Events { ours, received: None, over_read: false, overflow: false };
        }
        self.spis.intenclr.write(|w| w.end().clear().acquired().clear());
        let status = self.spis.status.read();
        let (over_read, overflow) = (status.overread().is_present(), status.overflow().is_present());
        self.spis.status.write(|w| w.overread().clear().overflow().clear());
        self.received = usize::from(self.spis.rxd.amount.read().amount().bits()).min(RECEIVE_BYTES);
        let area = self.area.as_ref().map_or(&[][..], |area| bytemuck::cast_slice(area.peek().as_slice()));
        // Not covered: only this line, more bytes than the area has: the number of received bytes was cut to the area's
        // size above.
        Events { ours, received: area.get(..self.received), over_read, overflow }
    }

    fn hand_over(&mut self, asked: Asked) -> HandedOver {
        // Not covered: no area: it is missing only within this function, which puts one back.
        let Some(area) = self.area.take() else { return HandedOver::Empty };
        let (next, handed_over) = self.areas.hand_over(area, Transaction { asked, bytes: self.received });
        self.area = Some(next);
        handed_over
    }

    fn pass_on(&mut self) {
        // The counter is cleared before the event. In the other order the event of the previous pause could end this
        // one.
        // SAFETY: 1 is a valid value of a task register.
        self.pause.tasks_clear.write(|w| unsafe { w.bits(1) });
        self.pause.events_compare[PAUSE_COMPARE].reset();
        // SAFETY: 1 is a valid value of a task register. The timer has stopped after the previous pause, or runs.
        self.pause.tasks_start.write(|w| unsafe { w.bits(1) });
        if self.areas.pass_on() {
            call_step(Task::port);
        }
    }

    fn is_expired(&mut self) -> bool {
        self.timer.events_compare[EXPIRY_COMPARES[0]].read().bits() != 0
    }

    fn exchange<R>(
        &mut self,
        with: impl FnOnce(Option<Received<ImageBuffer, ()>>) -> (Option<Received<ImageBuffer, ()>>, R),
    ) -> R {
        assert!(!self.granted, "the image is being streamed");
        let before = self.image.as_ref().map(Received::address);
        let (image, result) = with(self.image.take());
        // Not covered: only this line, no image: `Server` calls this behind a publication, so that there is one from
        // the first call on.
        if let Some(image) = image.as_ref().filter(|image| Some(image.address()) != before) {
            super::integrity::shown(image.memory());
        }
        self.image = image;
        result
    }

    fn load(&mut self, window: Range<usize>) -> bool {
        // Not covered: only this line, no image or no area: an image was published before the processor gets the
        // semaphore, and the area is missing only within `hand_over`.
        let (Some(image), Some(area)) = (&self.image, &mut self.area) else { return false };
        let bytes: &[u8] = bytemuck::cast_slice(image.memory().as_slice());
        let window = &bytes[window];
        // SAFETY: (pointers and count) both buffers are in RAM for ever, and stay in `self` until the processor has the
        // semaphore again, which `exchange` and `take_events` see to; both slices were checked for their length, which
        // fits 16 bits. The peripheral reads the image and writes the receive area, and only between a release and the
        // end of a transaction.
        self.spis.txd.ptr.write(|w| unsafe { w.ptr().bits(window.as_ptr() as u32) });
        // SAFETY: the length is that of the window, which was checked to lie in the image, and fits 16 bits.
        self.spis.txd.maxcnt.write(|w| unsafe { w.maxcnt().bits(window.len() as u16) });
        // SAFETY: the receive area is in RAM for ever and stays in `self` until the processor has the semaphore again.
        self.spis.rxd.ptr.write(|w| unsafe { w.ptr().bits(area.memory().as_mut_ptr() as u32) });
        true
    }

    fn announce(&mut self) {
        SsiDoorbell.announce();
    }

    fn release(&mut self) {
        self.granted = true;
        // All writes to the image must be in memory before the peripheral may read the image.
        compiler_fence(Ordering::SeqCst);
        // SAFETY: 1 is a valid value of a task register.
        self.spis.tasks_release.write(|w| unsafe { w.bits(1) });
    }
}
