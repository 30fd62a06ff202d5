//! The front end's hardware: SPIM0, chip select, the IRQ pin, and the driver's timer.

use core::sync::atomic::{compiler_fence, Ordering};

use dpr_fw::{
    rf::{self, LEAD},
    task::Task,
    triple::Filling,
};
use embedded_hal::digital::{InputPin, OutputPin};
use nrf52840_hal::{gpiote::Gpiote, pac};
use st25r3916::{
    command,
    executor::{Failed, Port},
    Short,
};

use super::{now_us, take_event, time::SHORTEST_US, ReceiveBuffer};
use crate::board::{call, RfPins, EDGE_CAPTURE, WAIT_COMPARE};

/// The number of polls within which SPIM0 must have stopped. It stops at the end of a byte, within 1 µs.
const STOP_POLLS: u32 = 1_000;

pub(crate) struct RfEdge(Gpiote);

impl RfEdge {
    pub(super) fn new(gpiote: Gpiote) -> Self {
        Self(gpiote)
    }

    /// Clears the interrupt. The driver then reads the pin's level, not the edge.
    pub(crate) fn clear(&mut self) {
        let channel = self.0.channel0();
        take_event!(*channel.event());
    }
}

/// The SPI transfer with the front end that runs, or else the last one.
#[derive(Clone, Copy)]
enum Transfer {
    None,
    Short {
        len: usize,
    },
    /// A read of the FIFO. It overwrites the byte of the buffer before `offset`, whose value is `kept`.
    Read {
        offset: usize,
        len: usize,
        kept: u8,
    },
}

/// The hardware of the RFID side, with the receive buffer that is being written.
pub(crate) struct RfPort {
    spim: pac::SPIM0,
    timer: pac::TIMER0,
    pins: RfPins,
    tx: &'static mut [u8; Short::MAX],
    rx: &'static mut [u8; Short::MAX],
    receive: Option<Filling<ReceiveBuffer>>,
    transfer: Transfer,
    running: bool,
    timer_from: u32,
    timer_us: u32,
}

impl RfPort {
    pub(super) fn new(
        spim: pac::SPIM0,
        timer: pac::TIMER0,
        pins: RfPins,
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
        // The SPIM works in mode 1: the clock is low between transfers, and data are taken at the trailing edge.
        spim.config.write(|w| w.order().msb_first().cpha().trailing().cpol().active_high());
        // SAFETY: any byte may be sent beyond the end of the transmit buffer.
        spim.orc.write(|w| unsafe { w.orc().bits(0) });
        spim.intenset.write(|w| w.end().set());
        spim.enable.write(|w| w.enable().enabled());
        timer.intenset.write(|w| w.compare0().set());
        Self {
            spim,
            timer,
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

    /// Starts SPIM0, which sends `tx[..send]` and receives `receive` bytes at `into`.
    ///
    /// # Safety
    ///
    /// `into` must be valid for `receive` bytes of RAM that `self` owns until the transfer has ended or was stopped.
    unsafe fn start(&mut self, send: usize, into: *mut u8, receive: usize) {
        // SAFETY: (pointers and counts) `self` owns `tx`, and the callers see to it that `send` is at most its length;
        // the caller guarantees that `into` is valid. Counts fit 16 bits.
        self.spim.txd.ptr.write(|w| unsafe { w.ptr().bits(self.tx.as_ptr() as u32) });
        // SAFETY: the caller guarantees that `send` is at most the length of `tx`, which fits 16 bits.
        self.spim.txd.maxcnt.write(|w| unsafe { w.maxcnt().bits(send as u16) });
        // SAFETY: the caller guarantees that `into` is valid for `receive` bytes until the transfer has ended.
        self.spim.rxd.ptr.write(|w| unsafe { w.ptr().bits(into as u32) });
        // SAFETY: the caller guarantees that `into` is valid for `receive` bytes, a number that fits 16 bits.
        self.spim.rxd.maxcnt.write(|w| unsafe { w.maxcnt().bits(receive as u16) });
        self.spim.events_end.reset();
        self.running = true;
        // All writes to the buffers must be in memory before the DMA reads or overwrites it.
        compiler_fence(Ordering::SeqCst);
        let Ok(()) = self.pins.select.set_low();
        // SAFETY: 1 is a valid value of a task register.
        self.spim.tasks_start.write(|w| unsafe { w.bits(1) });
    }

    /// Ends a transfer that is complete or was stopped, so that its buffers belong to the processor again.
    fn finish(&mut self) {
        let Ok(()) = self.pins.select.set_high();
        compiler_fence(Ordering::SeqCst);
        self.running = false;
        if let (Transfer::Read { offset, kept, .. }, Some(receive)) = (self.transfer, &mut self.receive) {
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(receive.memory().as_mut_slice());
            bytes[LEAD + offset - 1] = kept;
        }
    }
}

impl Port for RfPort {
    fn start_short(&mut self, short: &Short) {
        let len = short.bytes().len();
        *self.tx = *short.padded();
        self.transfer = Transfer::Short { len };
        let into = self.rx.as_mut_ptr();
        // SAFETY: `self` owns `rx` for ever, at least `len` bytes; nobody reads it before the transfer has ended.
        unsafe { self.start(len, into, len) };
    }

    fn start_read(&mut self, offset: usize, len: usize) -> bool {
        let Some(receive) = &mut self.receive else { return false };
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(receive.memory().as_mut_slice());
        let place = LEAD + offset - 1;
        // The slice has one byte more than the data, for the byte that is received while the command is sent.
        let into = &mut bytes[place..place + 1 + len];
        self.transfer = Transfer::Read { offset, len, kept: into[0] };
        self.tx[0] = command::FIFO_READ;
        let into = into.as_mut_ptr();
        // SAFETY: the slice was just checked to lie in the receive buffer, which stays in `self` until the transfer has
        // ended: `exchange` refuses to replace it before.
        unsafe { self.start(1, into, len + 1) };
        true
    }

    fn ended(&mut self) -> bool {
        if !self.running || !take_event!(self.spim.events_end) {
            return false;
        }
        self.finish();
        true
    }

    fn response(&self) -> Result<&[u8], Failed> {
        let received = usize::from(self.spim.rxd.amount.read().amount().bits());
        match (self.transfer, &self.receive) {
            (Transfer::Short { len }, _) if received == len => Ok(&self.rx[..len]),
            (Transfer::Read { offset, len, .. }, Some(receive)) if received == len + 1 => {
                let bytes: &[u8] = bytemuck::cast_slice(receive.peek().as_slice());
                Ok(&bytes[LEAD + offset..LEAD + offset + len])
            }
            _ => Err(Failed),
        }
    }

    fn abort(&mut self) {
        self.spim.events_stopped.reset();
        // SAFETY: 1 is a valid value of a task register.
        self.spim.tasks_stop.write(|w| unsafe { w.bits(1) });
        let stopped = (0..STOP_POLLS).any(|_| self.spim.events_stopped.read().bits() != 0);
        // Until the event STOPPED the peripheral may still write to the buffers (PS v1.7, 6.25, "Low power": wait for
        // it). A peripheral that never stops could overwrite a frame, so the DPR enters the safe state.
        assert!(stopped, "SPIM0 does not stop");
        self.spim.events_end.reset();
        self.finish();
        self.transfer = Transfer::None;
    }

    fn irq_is_high(&mut self) -> bool {
        let Ok(high) = self.pins.irq.is_high();
        high
    }

    fn start_timer(&mut self, us: u32) {
        let us = us.max(SHORTEST_US);
        self.timer_from = now_us();
        self.timer_us = us;
        // SAFETY: the compare register takes any value.
        self.timer.cc[WAIT_COMPARE].write(|w| unsafe { w.bits(self.timer_from.wrapping_add(us)) });
        self.timer.events_compare[WAIT_COMPARE].reset();
        if now_us().wrapping_sub(self.timer_from) >= us {
            // If the task was preempted for long, the counter has passed the compare value, and no interrupt comes.
            call(Task::rf_timer);
        }
    }

    fn elapsed(&mut self) -> bool {
        take_event!(self.timer.events_compare[WAIT_COMPARE]);
        now_us().wrapping_sub(self.timer_from) >= self.timer_us
    }
}

impl rf::FrontEndPort for RfPort {
    type Buffer = ReceiveBuffer;

    fn exchange(&mut self, with: impl FnOnce(Filling<ReceiveBuffer>) -> Filling<ReceiveBuffer>) {
        assert!(!self.running, "the receive buffer is being written");
        self.receive = self.receive.take().map(with);
    }

    fn arrived(&self, len: usize) -> &[u8] {
        match &self.receive {
            Some(receive) if !self.running || !matches!(self.transfer, Transfer::Read { .. }) => {
                let bytes: &[u8] = bytemuck::cast_slice(receive.peek().as_slice());
                bytes.get(LEAD..LEAD + len).unwrap_or(&[])
            }
            _ => &[],
        }
    }

    fn irq_edge_us(&mut self) -> u32 {
        self.timer.cc[EDGE_CAPTURE].read().bits()
    }
}
