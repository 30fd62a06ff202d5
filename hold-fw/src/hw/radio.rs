//! Drives the front end's SPI (SPIM0), chip select, IRQ pin and timer.
//!
//! Every operation starts something and returns. Two users share the SPI and never use it at once: from
//! [`FrontEndPort::arm`] to the slot only the slot's interrupt, otherwise only the front end's tasks, which all have
//! one priority.

use core::sync::atomic::{compiler_fence, AtomicU32, Ordering};

use embedded_hal::digital::{InputPin, OutputPin};
use hold_fw::{
    exchange::{FrontEndPort, Ticket},
    task::Task,
};
use nrf52840_hal::{gpiote::Gpiote, pac};
use profile::hold::HoldObject;
use st25r3916::{
    command,
    executor::{Failed, Port},
    listener::{BUFFER, PAYLOAD_OFFSET},
    Exchange, Short,
};

use super::{now_us, take_event};
use crate::board::{call, RfPins, WAIT_COMPARE};

/// The most polls until SPIM0 has stopped. SPIM0 stops at the end of the present byte, so within 1 µs.
const STOP_POLLS: u32 = 1_000;
/// The shortest delay, µs. With a shorter one, the counter could pass the compare value before that value is set.
const SHORTEST_US: u32 = 2;
/// The number of bytes that the chip returns during a command. They come before the data.
const LEAD: usize = 1;

/// The ticket for the next slot, as a word; 0 if there is none.
static ARMED: AtomicU32 = AtomicU32::new(0);
const SELECT: u32 = 1 << 12;

/// The greatest number of polls for the end of a one-byte transfer. They take longer than the 1 µs in which one byte is
/// sent.
const BYTE_POLLS: u32 = 50;

/// Sends the transmit command for the frame of beat `beat`, if its [`Ticket`] is armed. [`FrontEndPort::arm`] has set
/// the transfer up. The chip executes a command when chip select rises, so this function waits for the end of the
/// transfer. The event of that end stays set, and so calls the task `rf_spi` afterwards.
#[inline(always)]
pub(super) fn fire(beat: u32) {
    if !Ticket::is_due(ARMED.load(Ordering::Acquire), beat) {
        return;
    }
    ARMED.store(0, Ordering::Relaxed);
    // SAFETY: a register block is always there, and from `arm` to the ticket's end only this function uses the SPI and
    // chip select; OUTCLR and OUTSET change only the pins whose bits are ones.
    let (port, spim) = unsafe { (&*pac::P1::ptr(), &*pac::SPIM0::ptr()) };
    // SAFETY: the bit is that of chip select.
    port.outclr.write(|w| unsafe { w.bits(SELECT) });
    // SAFETY: 1 is a valid value of a task register; `arm` has set up pointers and counts.
    spim.tasks_start.write(|w| unsafe { w.bits(1) });
    // Not covered: an end at another poll than the usual one, or at none: the SPIM of the bench takes the same time for
    // each byte, and the compiler has unrolled the polls.
    for _ in 0..BYTE_POLLS {
        if spim.events_end.read().bits() != 0 {
            break;
        }
    }
    // SAFETY: the bit is that of chip select.
    port.outset.write(|w| unsafe { w.bits(SELECT) });
}

/// The interrupt that the rising edge of the front end's IRQ pin raises.
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

pub(crate) struct Memory {
    /// The bytes to send: a short transfer, or the load command and the bytes of the frame.
    send: [u8; LEAD + HoldObject::SIZE],
    /// The bytes that come in during a short transfer. `answer` is separate, because the driver makes short transfers
    /// between the read of an answer and its report.
    short: [u8; Short::MAX],
    /// The byte that the chip returns during the read command, and then the answer.
    answer: [u8; LEAD + BUFFER],
}

impl Memory {
    pub(crate) const EMPTY: Self =
        Self { send: [0; LEAD + HoldObject::SIZE], short: [0; Short::MAX], answer: [0; LEAD + BUFFER] };
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Transfer {
    Nothing,
    Short(usize),
    /// Returns the bytes that come after the one that the chip returns during the command.
    Read(usize),
}

/// The front end's port: SPIM0, chip select, IRQ pin and compare 0 of the timer.
pub struct RfPort {
    spim: pac::SPIM0,
    timer: pac::TIMER0,
    pins: RfPins,
    memory: &'static mut Memory,
    frame: [u8; HoldObject::SIZE],
    transfer: Transfer,
    timer_from: u32,
    timer_us: u32,
}

impl RfPort {
    pub(super) fn new(spim: pac::SPIM0, timer: pac::TIMER0, pins: RfPins, memory: &'static mut Memory) -> Self {
        // SAFETY: the selector is that of the clock pin, which `pins` owns and has configured (PS v1.7, 6.25.2).
        spim.psel.sck.write(|w| unsafe { w.bits(pins.clock.psel_bits()) });
        // SAFETY: the selector is that of the MOSI pin, which `pins` owns.
        spim.psel.mosi.write(|w| unsafe { w.bits(pins.mosi.psel_bits()) });
        // SAFETY: the selector is that of the MISO pin, which `pins` owns.
        spim.psel.miso.write(|w| unsafe { w.bits(pins.miso.psel_bits()) });
        spim.frequency.write(|w| w.frequency().m8());
        // SPIM0 works in SPI mode 1: the clock is low when idle, and data are taken at the trailing edge.
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
            memory,
            frame: [0; HoldObject::SIZE],
            transfer: Transfer::Nothing,
            timer_from: 0,
            timer_us: u32::MAX,
        }
    }

    /// Clears the event of a delay that is over. The executor compares the time instead of using this event.
    pub(crate) fn clear_timer(&mut self) {
        take_event!(self.timer.events_compare[WAIT_COMPARE]);
    }

    /// Sets SPIM0 up to send `send` bytes of its memory, and to receive the bytes of `transfer`.
    fn set_up(&mut self, send: usize, transfer: Transfer) {
        self.transfer = transfer;
        let send = send.min(self.memory.send.len()) as u16;
        let (into, receive): (&mut [u8], _) = match transfer {
            Transfer::Nothing => (&mut [], 0),
            Transfer::Short(len) => (&mut self.memory.short, len),
            Transfer::Read(len) => (&mut self.memory.answer, LEAD + len),
        };
        let (into, receive) = (into.as_mut_ptr() as u32, receive.min(into.len()) as u16);
        // SAFETY: (all four) `self` owns the memory for ever, the counts are at most its lengths, and nobody else
        // accesses it until the transfer has ended or was stopped.
        self.spim.txd.ptr.write(|w| unsafe { w.ptr().bits(self.memory.send.as_ptr() as u32) });
        // SAFETY: as above.
        self.spim.txd.maxcnt.write(|w| unsafe { w.maxcnt().bits(send) });
        // SAFETY: as above.
        self.spim.rxd.ptr.write(|w| unsafe { w.ptr().bits(into) });
        // SAFETY: as above.
        self.spim.rxd.maxcnt.write(|w| unsafe { w.maxcnt().bits(receive) });
        self.spim.events_end.reset();
        // The fence keeps the compiler from moving a write to a buffer behind the start of the DMA.
        compiler_fence(Ordering::SeqCst);
    }

    fn start(&mut self, send: usize, transfer: Transfer) {
        self.set_up(send, transfer);
        // Not covered: only this line, the other port: the pin's port is a constant, for which the HAL asks at each
        // access.
        let Ok(()) = self.pins.select.set_low();
        // SAFETY: 1 is a valid value of a task register.
        self.spim.tasks_start.write(|w| unsafe { w.bits(1) });
    }

    fn finish(&mut self) {
        // Not covered: only this line, the other port, as in `start`; and the copy of this function in `abort`.
        let Ok(()) = self.pins.select.set_high();
        compiler_fence(Ordering::SeqCst);
    }
}

impl Port for RfPort {
    fn start_short(&mut self, short: &Short) {
        let bytes = short.bytes();
        self.memory.send[..bytes.len()].copy_from_slice(bytes);
        self.start(bytes.len(), Transfer::Short(bytes.len()));
    }

    fn start_load(&mut self, offset: usize, len: usize) -> bool {
        // Not covered: bytes beyond the frame: the exchange loads only those of the frame it was prepared for.
        let Some(bytes) = self.frame.get(offset..offset + len) else { return false };
        self.memory.send[0] = command::FIFO_LOAD;
        self.memory.send[LEAD..LEAD + len].copy_from_slice(bytes);
        self.start(LEAD + len, Transfer::Nothing);
        true
    }

    fn start_read(&mut self, offset: usize, len: usize) -> bool {
        // The state machine reads each answer in one piece, from offset 0.
        // Not covered: a read of a part, and one beyond the buffer: the state machine reads each answer in one piece.
        if offset != 0 || len > BUFFER {
            return false;
        }
        // The buffer is cleared, so that an earlier answer is never taken for a new one.
        self.memory.answer.fill(0);
        self.memory.send[0] = command::FIFO_READ;
        self.start(LEAD, Transfer::Read(len));
        true
    }

    fn ended(&mut self) -> bool {
        if !take_event!(self.spim.events_end) {
            return false;
        }
        self.finish();
        true
    }

    fn response(&self) -> Result<&[u8], Failed> {
        let received = usize::from(self.spim.rxd.amount.read().amount().bits());
        let bytes = match self.transfer {
            Transfer::Nothing => Some(&[][..]),
            // Not covered: only this line, fewer bytes than set up: a transfer that has ended has received all of them.
            Transfer::Short(len) => self.memory.short.get(..len).filter(|_| received == len),
            // Not covered: only this line, fewer bytes than set up, as above.
            Transfer::Read(len) => self.memory.answer.get(LEAD..LEAD + len).filter(|_| received == LEAD + len),
        };
        bytes.ok_or(Failed)
    }

    #[inline(never)]
    fn abort(&mut self) {
        self.spim.events_stopped.reset();
        // SAFETY: 1 is a valid value of a task register.
        self.spim.tasks_stop.write(|w| unsafe { w.bits(1) });
        // Not covered: a stop at another poll than the usual one, as in `fire`.
        let stopped = (0..STOP_POLLS).any(|_| self.spim.events_stopped.read().bits() != 0);
        // Until the event STOPPED, the SPIM may still write to its buffers (PS v1.7, 6.25, "Low power").
        assert!(stopped, "SPIM0 does not stop");
        self.spim.events_end.reset();
        self.finish();
    }

    fn irq_is_high(&mut self) -> bool {
        // Not covered: only this line, the other port, as in `start`.
        let Ok(high) = self.pins.irq.is_high();
        high
    }

    fn start_timer(&mut self, us: u32) {
        // Not covered: only this line, a wait that is shorter than the shortest: those for a transfer and for time
        // alone are longer.
        let us = us.max(SHORTEST_US);
        self.timer_from = now_us();
        self.timer_us = us;
        // SAFETY: the compare register takes any value.
        self.timer.cc[WAIT_COMPARE].write(|w| unsafe { w.bits(self.timer_from.wrapping_add(us)) });
        self.timer.events_compare[WAIT_COMPARE].reset();
        // Not covered: a counter that has passed the compare value already: only the slot's interrupt preempts this,
        // and no run has it between the two readings.
        if now_us().wrapping_sub(self.timer_from) >= us {
            // The counter may already have passed the compare value, if the task was preempted for long. Then no
            // interrupt would come.
            call(Task::rf_timer);
        }
    }

    fn elapsed(&mut self) -> bool {
        now_us().wrapping_sub(self.timer_from) >= self.timer_us
    }
}

impl FrontEndPort for RfPort {
    fn deposit(&mut self, frame: &[u8; HoldObject::SIZE]) {
        self.frame = *frame;
    }

    fn arm(&mut self, ticket: Ticket) {
        let command = Exchange::transmit();
        self.memory.send[..command.bytes().len()].copy_from_slice(command.bytes());
        self.set_up(command.bytes().len(), Transfer::Nothing);
        ARMED.store(ticket.word(), Ordering::Release);
    }

    fn disarm(&mut self) -> bool {
        ARMED.swap(0, Ordering::Acquire) != 0
    }

    fn answer(&self, len: usize) -> &[u8] {
        let from = LEAD + PAYLOAD_OFFSET;
        self.memory.answer.get(from..from + len).unwrap_or(&[])
    }
}
