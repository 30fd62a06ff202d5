//! Drives a front end's SPI (a SPIM), chip select, IRQ pin and timer.
//!
//! HORUS's front end and the hold's front end have one [`Port`] each. [`Wiring`] covers the differences.

use core::{
    convert::Infallible,
    sync::atomic::{compiler_fence, Ordering},
};

use dpr_fw::{
    rf::{self, LEAD},
    task::Task,
    triple::Filling,
};
use embedded_hal::digital::{InputPin, OutputPin};
use nrf52840_hal::{
    gpio::{Output, Pin, PushPull},
    gpiote::Gpiote,
    pac, spim,
    timer::{self, Instance as _},
};
use st25r3916::{
    command,
    executor::{self, Failed},
    Short,
};

use super::{now_us, take_event, time::SHORTEST_US, ReceiveBuffer};
use crate::board::{call, RfPins, EDGE_CAPTURE, WAIT_COMPARE};

/// The most polls until a SPIM has stopped. A SPIM stops at the end of the present byte, so within 1 µs.
const STOP_POLLS: u32 = 1_000;

pub(crate) struct RfEdge(Gpiote);

impl RfEdge {
    pub(super) fn new(gpiote: Gpiote) -> Self {
        Self(gpiote)
    }

    /// Clears the interrupt of the IRQ's edge. No edge is lost, because the driver reads the level of the pin.
    pub(crate) fn clear(&mut self) {
        let channel = self.0.channel0();
        take_event!(*channel.event());
    }
}

pub(crate) trait Wiring {
    type Spim: spim::Instance;
    /// The timer for the driver's delays, which also takes the time of the IRQ's edge. It counts µs.
    type Timer: timer::Instance;
    type Select: OutputPin<Error = Infallible>;
    type Sends: Sends;
    const TIMER_TASK: Task;
    fn now_us() -> u32;
}

/// The bytes that a front end sends over the air, and the timer that may start sending them.
pub(crate) trait Sends {
    /// Puts the FIFO load command before the `len` bytes at `offset` of the bytes to send. Returns the command with
    /// these bytes, or `None` if they do not exist.
    fn load(&mut self, offset: usize, len: usize) -> Option<&[u8]>;
    /// Whether the present transfer is already set up, and a timer starts it instead of the port.
    fn is_armed(&self) -> bool;
    /// Counts the bytes of a transfer.
    fn carries(&mut self, bytes: usize);
    /// Called when the present transfer has ended or is about to be stopped. After that, no timer may start that
    /// transfer.
    fn disarm(&mut self);
    /// Returns the time limit of a transfer that may take `us` from its start. The limit counts from `now_us`.
    fn limit_us(&self, us: u32, now_us: u32) -> u32;
    /// Is called if the SPIM does not stop. The SPIM may still write to its buffers, so they are never released.
    fn does_not_stop(&mut self);
}

/// HORUS's front end, which sends nothing.
pub(crate) struct Horus;

impl Wiring for Horus {
    type Spim = pac::SPIM0;
    type Timer = pac::TIMER0;
    type Select = Pin<Output<PushPull>>;
    type Sends = ();
    const TIMER_TASK: Task = Task::rf_timer;

    fn now_us() -> u32 {
        now_us()
    }
}

impl Sends for () {
    fn load(&mut self, _offset: usize, _len: usize) -> Option<&[u8]> {
        None
    }
    fn is_armed(&self) -> bool {
        false
    }
    fn carries(&mut self, _bytes: usize) {}
    fn disarm(&mut self) {}
    fn limit_us(&self, us: u32, _now_us: u32) -> u32 {
        us
    }
    fn does_not_stop(&mut self) {
        // A SPIM that never stops could overwrite a frame, so the DPR enters the safe state.
        panic!("SPIM0 does not stop");
    }
}

#[derive(Clone, Copy)]
enum Transfer {
    None,
    Short {
        len: usize,
    },
    /// A read of the FIFO. The chip's first byte overwrites the byte before `offset` in the buffer, whose value was
    /// `kept`.
    Read {
        offset: usize,
        len: usize,
        kept: u8,
    },
}

/// SPIM, chip select, IRQ pin and timer of a front end, with the receive buffer that is being written.
pub(crate) struct Port<W: Wiring> {
    pub(super) spim: W::Spim,
    pub(super) timer: W::Timer,
    pub(super) sends: W::Sends,
    pins: RfPins<W::Select>,
    tx: &'static mut [u8; Short::MAX],
    rx: &'static mut [u8; Short::MAX],
    receive: Option<Filling<ReceiveBuffer>>,
    transfer: Transfer,
    running: bool,
    timer_from: u32,
    timer_us: u32,
}

pub(crate) type RfPort = Port<Horus>;

impl<W: Wiring> Port<W> {
    pub(super) fn new(
        spim: W::Spim,
        timer: W::Timer,
        sends: W::Sends,
        pins: RfPins<W::Select>,
        tx: &'static mut [u8; Short::MAX],
        rx: &'static mut [u8; Short::MAX],
        receive: Filling<ReceiveBuffer>,
    ) -> Self {
        // SAFETY: (all four) each value is the selector of a pin that `pins` owns and that is configured as PS v1.7,
        // 6.25.2 wants it.
        spim.psel.sck.write(|w| unsafe { w.bits(pins.clock.psel_bits()) });
        // SAFETY: the selector is that of the MOSI pin, which `pins` owns.
        spim.psel.mosi.write(|w| unsafe { w.bits(pins.mosi.psel_bits()) });
        // SAFETY: the selector is that of the MISO pin, which `pins` owns.
        spim.psel.miso.write(|w| unsafe { w.bits(pins.miso.psel_bits()) });
        spim.frequency.write(|w| w.frequency().m8());
        // SPIM0 and SPIM2 work in SPI mode 1: the clock is low between transfers, and data are taken at the trailing
        // edge.
        spim.config.write(|w| w.order().msb_first().cpha().trailing().cpol().active_high());
        // SAFETY: any byte may be sent beyond the end of the transmit buffer.
        spim.orc.write(|w| unsafe { w.orc().bits(0) });
        spim.intenset.write(|w| w.end().set());
        spim.enable.write(|w| w.enable().enabled());
        timer.as_timer0().intenset.write(|w| w.compare0().set());
        Self {
            spim,
            timer,
            sends,
            pins,
            tx,
            rx,
            receive: Some(receive),
            transfer: Transfer::None,
            running: false,
            timer_from: 0,
            timer_us: u32::MAX,
        }
    }

    /// Sets the SPIM up to send `send` bytes from `from` and to receive `receive` bytes at `into`. Then selects the
    /// chip.
    ///
    /// # Safety
    ///
    /// `from` must be valid for `send` bytes of RAM. `into` must be valid for `receive` bytes that are owned by `self`
    /// until the transfer has ended or was stopped.
    unsafe fn set_up(&mut self, from: *const u8, send: usize, into: *mut u8, receive: usize) {
        // SAFETY: (pointers and counts) the caller guarantees that both pointers are valid. Counts fit 16 bits.
        self.spim.txd.ptr.write(|w| unsafe { w.ptr().bits(from as u32) });
        // SAFETY: the caller guarantees that `from` is valid for `send` bytes, a number that fits 16 bits.
        self.spim.txd.maxcnt.write(|w| unsafe { w.maxcnt().bits(send as u16) });
        // SAFETY: the caller guarantees that `into` is valid for `receive` bytes until the transfer has ended.
        self.spim.rxd.ptr.write(|w| unsafe { w.ptr().bits(into as u32) });
        // SAFETY: the caller guarantees that `into` is valid for `receive` bytes, a number that fits 16 bits.
        self.spim.rxd.maxcnt.write(|w| unsafe { w.maxcnt().bits(receive as u16) });
        self.spim.events_end.reset();
        // Not covered: only this line, the comparison of both lengths: the direction in which each kind of transfer is
        // longer is a constant.
        self.sends.carries(send.max(receive));
        self.running = true;
        // The fence keeps the compiler from moving a write to a buffer behind the start of the DMA.
        compiler_fence(Ordering::SeqCst);
        // Not covered: only this line, the other port: the pin's port is a constant, for which the HAL asks at each
        // access.
        let Ok(()) = self.pins.select.set_low();
    }

    pub(super) fn set_up_short(&mut self, short: &Short) {
        let len = short.bytes().len();
        *self.tx = *short.padded();
        self.transfer = Transfer::Short { len };
        let (from, into) = (self.tx.as_ptr(), self.rx.as_mut_ptr());
        // SAFETY: `self` owns `tx` and `rx` for ever, at least `len` bytes; nobody reads `rx` before the transfer has
        // ended.
        unsafe { self.set_up(from, len, into, len) };
    }

    fn start(&mut self) {
        // SAFETY: 1 is a valid value of a task register.
        self.spim.tasks_start.write(|w| unsafe { w.bits(1) });
    }

    /// Ends a transfer that is complete or was stopped. Its buffers then belong to the processor again.
    pub(super) fn finish(&mut self) {
        self.sends.disarm();
        // Not covered: only this line, the other port, as in `set_up`; and the copy of this function in `abort`.
        let Ok(()) = self.pins.select.set_high();
        compiler_fence(Ordering::SeqCst);
        self.running = false;
        // Not covered: a read without its receive buffer, which is missing only within `exchange`; and the copies of
        // this function in `abort` and for a frame that is armed too late (`hw/hold.rs`).
        if let (Transfer::Read { offset, kept, .. }, Some(receive)) = (self.transfer, &mut self.receive) {
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(receive.memory().as_mut_slice());
            bytes[LEAD + offset - 1] = kept;
        }
    }
}

impl<W: Wiring> executor::Port for Port<W> {
    fn start_short(&mut self, short: &Short) {
        if !self.sends.is_armed() {
            self.set_up_short(short);
            self.start();
        }
    }

    fn start_load(&mut self, offset: usize, len: usize) -> bool {
        let Some(bytes) = self.sends.load(offset, len) else { return false };
        let (from, send) = (bytes.as_ptr(), bytes.len());
        self.transfer = Transfer::Short { len: 0 };
        let into = self.rx.as_mut_ptr();
        // SAFETY: the bytes are in memory that `sends` owns for ever, and nothing is received.
        unsafe { self.set_up(from, send, into, 0) };
        self.start();
        true
    }

    fn start_read(&mut self, offset: usize, len: usize) -> bool {
        // Not covered: a read without a receive buffer, which is missing only within `exchange`, and that puts one
        // back.
        let Some(receive) = &mut self.receive else { return false };
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(receive.memory().as_mut_slice());
        let place = LEAD + offset - 1;
        // The slice begins one byte before the data, where the byte goes that the chip returns during the command.
        let into = &mut bytes[place..place + 1 + len];
        self.transfer = Transfer::Read { offset, len, kept: into[0] };
        self.tx[0] = command::FIFO_READ;
        let (from, into) = (self.tx.as_ptr(), into.as_mut_ptr());
        // SAFETY: `self` owns `tx`, which has a byte. The slice was just checked to lie in the receive buffer, which
        // stays in `self` until the transfer has ended: `exchange` refuses to replace it before.
        unsafe { self.set_up(from, 1, into, len + 1) };
        self.start();
        true
    }

    fn ended(&mut self) -> bool {
        // Not covered: only this line, no transfer: the executor asks only while one runs.
        if !self.running || !take_event!(self.spim.events_end) {
            return false;
        }
        self.finish();
        true
    }

    fn response(&self) -> Result<&[u8], Failed> {
        let received = usize::from(self.spim.rxd.amount.read().amount().bits());
        // Not covered: only this line, a response of fewer bytes than the transfer has, as below, and none: the
        // executor asks only behind a transfer.
        match (self.transfer, &self.receive) {
            // A load of the FIFO, which only the second port makes, receives no bytes. RXD.AMOUNT may then keep an
            // earlier count, so it is not compared.
            (Transfer::Short { len: 0 }, _) if cfg!(feature = "hold") => Ok(&[]),
            // Not covered: only this line, fewer bytes than the transfer has: the SPIM sets END only when all bytes are
            // moved.
            (Transfer::Short { len }, _) if received == len => Ok(&self.rx[..len]),
            (Transfer::Read { offset, len, .. }, Some(receive)) if received == len + 1 => {
                let bytes: &[u8] = bytemuck::cast_slice(receive.peek().as_slice());
                Ok(&bytes[LEAD + offset..LEAD + offset + len])
            }
            _ => Err(Failed),
        }
    }

    // Not covered: a transfer that does not end: it needs an SPIM that hangs, which the bench's model of the SPIM does
    // not.
    fn abort(&mut self) {
        self.sends.disarm();
        self.spim.events_stopped.reset();
        // SAFETY: 1 is a valid value of a task register.
        self.spim.tasks_stop.write(|w| unsafe { w.bits(1) });
        let stopped = (0..STOP_POLLS).any(|_| self.spim.events_stopped.read().bits() != 0);
        // Until the event STOPPED, the SPIM may still write to its buffers (PS v1.7, 6.25, "Low power").
        if !stopped {
            self.sends.does_not_stop();
            return;
        }
        self.spim.events_end.reset();
        self.finish();
        self.transfer = Transfer::None;
    }

    fn irq_is_high(&mut self) -> bool {
        // Not covered: only this line, the other port, as in `set_up`.
        let Ok(high) = self.pins.irq.is_high();
        high
    }

    fn start_timer(&mut self, us: u32) {
        self.timer_from = W::now_us();
        // Not covered: only this line, a wait that is shorter than the shortest: those for a transfer and for time
        // alone are longer.
        let us = self.sends.limit_us(us.max(SHORTEST_US), self.timer_from);
        self.timer_us = us;
        let timer = self.timer.as_timer0();
        // SAFETY: the compare register takes any value.
        timer.cc[WAIT_COMPARE].write(|w| unsafe { w.bits(self.timer_from.wrapping_add(us)) });
        timer.events_compare[WAIT_COMPARE].reset();
        // Not covered: a counter that has passed the compare value already: no task holds this one up for as long as
        // the shortest wait.
        if W::now_us().wrapping_sub(self.timer_from) >= us {
            // If the task was preempted for long, the counter may have passed the compare value already. Then no
            // interrupt would come.
            call(W::TIMER_TASK);
        }
    }

    fn elapsed(&mut self) -> bool {
        take_event!(self.timer.as_timer0().events_compare[WAIT_COMPARE]);
        W::now_us().wrapping_sub(self.timer_from) >= self.timer_us
    }
}

impl<W: Wiring> rf::FrontEndPort for Port<W> {
    type Buffer = ReceiveBuffer;

    fn exchange(&mut self, with: impl FnOnce(Filling<ReceiveBuffer>) -> Filling<ReceiveBuffer>) {
        assert!(!self.running, "the receive buffer is being written");
        // Not covered: only this line, no receive buffer, as in `start_read`.
        self.receive = self.receive.take().map(with);
        // Not covered: only this line, the return without a receive buffer, as above.
    }

    fn arrived(&self, len: usize) -> &[u8] {
        match &self.receive {
            // Not covered: only this line, a read that still runs: the executor reports bytes as arrived only when no
            // read runs.
            Some(receive) if !self.running || !matches!(self.transfer, Transfer::Read { .. }) => {
                let bytes: &[u8] = bytemuck::cast_slice(receive.peek().as_slice());
                bytes.get(LEAD..LEAD + len).unwrap_or(&[])
            }
            _ => &[],
        }
    }

    fn irq_edge_us(&mut self) -> u32 {
        self.timer.as_timer0().cc[EDGE_CAPTURE].read().bits()
    }
}
