//! A receiver on I2C: its events come by interrupt, and its bytes come in by DMA
//!
//! # Design
//!
//! [`horus_tx_fw::ddc`] decides what follows from each event; this file has the registers. Only events and errors raise
//! interrupts, not the buffer (ITEVTEN, ITERREN; not ITBUFEN). So a message goes out byte by byte on BTF, with the
//! clock held in between. A DMA stream reads, with LAST to refuse the last byte, and raises an interrupt at its end.
//!
//! After a START or STOP was requested, CR1 is not written before the peripheral has carried the request out. A write
//! could request the START or STOP twice (RM0090, "I2C", control register 1).
//!
//! During a recovery of the bus, SWRST is set from when the pins are disconnected until they are given back.
//!
//! # Errata (ES0206 rev 24, section "I2C") of the peripheral
//!
//! - Erratum "spurious bus error in controller mode": BERR is cleared and ignored; a truly broken transaction ends at
//!   the tick.
//! - Erratum "start cannot be generated after a misplaced stop": only SWRST helps. A transaction whose START does not
//!   come has not ended by the tick, and the tick then resets the peripheral.
//! - Erratum "mismatch on the set-up time of a repeated start": it concerns standard mode from 88 kHz on, and this bus
//!   runs in fast mode.
//! - Erratum "data valid time violated without OVR": it concerns a target that transmits, and this peripheral is the
//!   controller.
//! - Erratum about rise times of SDA and SCL when the bus's supply is above the part's: it does not apply, because the
//!   pull-ups go to the part's 3.3 V.
//!
//! `unsafe` is used here for shared access to the peripheral's register block, for values without an enumeration, and
//! to start the DMA stream.
#![allow(unsafe_code)]

use core::{
    ops::Range,
    sync::atomic::{compiler_fence, AtomicU8, Ordering},
};

use firmware_common::memory;
use horus_tx_fw::{
    ddc::{Bus, Ddc, Events, Order, Received, MOST, STEP_US},
    source::{Busy, Message, Source, Vector},
    timing,
};
use stm32f4xx_hal::pac::{self, i2c1};

use super::{
    buffers,
    dma::{self, Direction, Transfer},
    gpio,
    registers::Registers,
    steps::Steps,
    HORUS_TELEMETRY,
};
use crate::board::DdcPort;

/// The memory that the DMA stream writes. At most one receiver is on I2C (the board's table asserts it).
static BYTES: [AtomicU8; MOST] = [const { AtomicU8::new(0) }; MOST];

/// Returns the memory that DMA writes. Messages to the receiver are sent without DMA.
pub(super) fn memory() -> Range<u32> {
    memory::span(&BYTES)
}

pub struct DdcSource {
    index: usize,
    port: &'static DdcPort,
    registers: Registers<i2c1::RegisterBlock>,
    ddc: Ddc,
    steps: Steps,
}

impl DdcSource {
    pub fn new(index: usize, port: &'static DdcPort, rcc: &mut pac::RCC) -> Self {
        (port.enable)(rcc);
        gpio::open_drain(port.scl);
        gpio::open_drain(port.sda);
        let source = Self {
            index,
            port,
            registers: Registers::at((port.registers)()),
            ddc: Ddc::new(),
            steps: Steps::new(&port.timer, rcc),
        };
        source.set_up();
        source
    }

    fn i2c(&self) -> &'static i2c1::RegisterBlock {
        // SAFETY: the table holds the address of an I2C peripheral's register block, which is always there; every
        // access is volatile, and only this source uses the peripheral.
        unsafe { self.registers.get() }
    }

    /// Sets the peripheral up after a reset: fast mode with a low time of 2 µs and a high time of 1 µs, so 333 kHz.
    fn set_up(&self) {
        let i2c = self.i2c();
        let mhz = self.port.bus_hz / 1_000_000;
        i2c.cr1().write(|w| w);
        // SAFETY: the bus's frequency is 36 MHz, and 2 to 50 may be written (RM0090 "I2C", control register 2).
        i2c.cr2().write(|w| unsafe { w.freq().bits(mhz as u8) });
        // With DUTY 0, SCL is low for twice the time in CCR, and high for the time in CCR.
        let ccr = (timing::GNSS_I2C_LOW_NS / 2 * mhz).div_ceil(1_000);
        // SAFETY: the value is 36, and 1 to 4095 may be written in fast mode with DUTY 0.
        i2c.ccr().write(|w| unsafe { w.f_s().set_bit().ccr().bits(ccr as u16) });
        // The rise time of SCL and SDA is 300 ns in fast mode (RM0090 "I2C", TRISE).
        // SAFETY: the value is 11, and at most 63 may be written.
        i2c.trise().write(|w| unsafe { w.bits((mhz * 300 / 1_000 + 1) as u16) });
        i2c.cr1().write(|w| w.pe().set_bit().ack().set_bit());
    }

    fn bus(&self) -> Bus {
        let pending = self.i2c().cr1().read();
        Bus {
            scl: gpio::is_high(self.port.scl.pin),
            sda: gpio::is_high(self.port.sda.pin),
            busy: self.i2c().sr2().read().busy().bit_is_set()
                || pending.start().bit_is_set()
                || pending.stop().bit_is_set(),
        }
    }

    /// Returns the peripheral's status, and clears its error flags.
    fn take_events(&self) -> Events {
        let sr1 = self.i2c().sr1().read();
        let events = Events {
            started: sr1.sb().bit_is_set(),
            addressed: sr1.addr().bit_is_set(),
            byte_sent: sr1.btf().bit_is_set(),
            refused: sr1.af().bit_is_set(),
            arbitration_lost: sr1.arlo().bit_is_set(),
            bus_error: sr1.berr().bit_is_set(),
        };
        // Writing zeros clears the error flags, bits 8 to 15. All other bits are read-only.
        const ERRORS: u16 = 0xDF00;
        if sr1.bits() & ERRORS != 0 {
            // SAFETY: only the flags that were seen are cleared, and reserved bit 13 is written as 0.
            self.i2c().sr1().write(|w| unsafe { w.bits(!sr1.bits() & ERRORS) });
        }
        events
    }

    fn carry_out(&mut self, order: Order) {
        let i2c = self.i2c();
        match order {
            Order::Nothing => {}
            Order::Start => {
                let cr2 = i2c.cr2();
                cr2.modify(|_, w| w.dmaen().clear_bit().last().clear_bit().itevten().set_bit().iterren().set_bit());
                i2c.cr1().modify(|_, w| w.start().set_bit());
            }
            Order::Put(byte) => self.put(byte),
            Order::PutAddressed(byte) => {
                self.clear_addressed();
                self.put(byte);
            }
            Order::Receive(len) => {
                i2c.cr2().modify(|_, w| w.itevten().clear_bit().dmaen().set_bit().last().set_bit());
                self.receive(len.min(MOST));
                self.clear_addressed();
            }
            Order::Stop => {
                self.mute();
                i2c.cr1().modify(|_, w| w.stop().set_bit());
            }
            Order::Mute => self.mute(),
            Order::Release => {
                self.mute();
                // If the DMA stream does not stop, the next recovery of the bus tries again. Its bytes are not used
                // until then.
                let _ = dma::stop(self.port.stream);
                dma::clear_flags(self.port.stream);
                i2c.cr1().write(|w| w.swrst().set_bit());
                for pin in [self.port.scl.pin, self.port.sda.pin] {
                    gpio::write(pin, true);
                    gpio::drive(pin);
                }
                self.steps.start(STEP_US);
            }
            Order::Drive { scl, sda } => {
                // Not covered: the copies for pins of other ports, as in `hw/gpio.rs`.
                gpio::write(self.port.scl.pin, scl);
                gpio::write(self.port.sda.pin, sda);
                self.steps.start(STEP_US);
            }
            Order::Rejoin => {
                self.steps.stop();
                gpio::connect(self.port.scl.pin);
                gpio::connect(self.port.sda.pin);
                self.set_up();
            }
        }
    }

    fn put(&self, byte: u8) {
        self.i2c().dr().write(|w| w.dr().set(byte));
    }

    /// Clears ADDR by reading SR2. SR1, which has to be read before, has been read already.
    fn clear_addressed(&self) {
        let _ = self.i2c().sr2().read();
    }

    fn mute(&self) {
        let cr2 = self.i2c().cr2();
        cr2.modify(|_, w| w.itevten().clear_bit().iterren().clear_bit().dmaen().clear_bit().last().clear_bit());
    }

    fn receive(&self, len: usize) {
        // Not covered: only this line, a stream that did not stop: that of the bench stops at once, as in `dma::stop`.
        if dma::is_on(self.port.stream) {
            // A stream that did not stop is not started again. No byte is received then, and the transaction ends at
            // the tick.
            return;
        }
        dma::clear_flags(self.port.stream);
        let transfer = Transfer {
            peripheral: self.i2c().dr().as_ptr() as u32,
            memory: BYTES.as_ptr() as u32,
            len,
            direction: Direction::In { circular: false, advance: true },
        };
        // SAFETY: the data register is that of the peripheral to which the stream and channel of the board's table
        // belong; `BYTES` has `MOST` atomic bytes, which `len` does not exceed; the stream is off, its flags are clear.
        unsafe { dma::start(self.port.stream, &transfer) };
    }

    fn stream_interrupt(&mut self) {
        let flags = dma::flags(self.port.stream);
        if !flags.has_error() && !flags.is_complete() {
            // The task was called only to check in for the watchdog. A transfer that ends from now on leaves its flag
            // set, which calls the task again.
            return;
        }
        dma::clear_flags(self.port.stream);
        if flags.has_error() {
            // Not covered: an error of the stream, as in `Ddc::stream_failed`.
            let order = self.ddc.stream_failed();
            self.carry_out(order);
        } else {
            compiler_fence(Ordering::Acquire);
            let first = [&BYTES[0], &BYTES[1], &BYTES[2]].map(|byte| byte.load(Ordering::Relaxed));
            let Received { stream, then } = self.ddc.received(first);
            self.push(stream);
            self.carry_out(then);
        }
    }

    /// Puts a range of the bytes that DMA has written into the receiver's ring.
    fn push(&self, bytes: Range<usize>) {
        // Not covered: only this line, a range whose end lies before its beginning: `Ddc` returns none.
        let bytes = BYTES.iter().skip(bytes.start).take(bytes.len());
        // Not covered: the end of the buffer within the range, since the longest read fits into it; and the copies of
        // the loop for lengths that no read has.
        buffers::ring(self.index).push(bytes.map(|byte| byte.load(Ordering::Relaxed)));
    }
}

impl Source for DdcSource {
    fn poll(&mut self) {
        let under_way = self.ddc.stream_under_way();
        // Errors that came between transactions are dropped. Otherwise the first of them would end the next
        // transaction.
        // Not covered: in the copy for the tick, an error that the interrupt has not taken: no run has one between two
        // transactions.
        let _ = self.take_events();
        let order = self.ddc.poll(self.bus());
        self.carry_out(order);
        if let Some(len) = under_way {
            // Not covered: only this line, more bytes left than were requested: the stream counts down from that
            // number.
            let come = len.saturating_sub(dma::left(self.port.stream));
            self.push(0..come);
        }
        // Not covered: only this line, the telemetry of a receiver beyond the last, as in `hw/buffers.rs`.
        let (counts, line) = (self.ddc.counts(), &HORUS_TELEMETRY.sources[self.index]);
        line.recoveries.set(counts.recoveries);
        line.timed_out.set(counts.timed_out);
        line.refused.set(counts.refused);
    }

    fn interrupt(&mut self, vector: Vector) {
        match vector {
            Vector::Peripheral => {
                let order = self.ddc.event(self.take_events());
                self.carry_out(order);
            }
            // Not covered: an error of the stream, as in `Ddc::stream_failed`, and the end of a read that has not
            // begun.
            Vector::Stream => self.stream_interrupt(),
            Vector::Timer => {
                if self.steps.is_over() {
                    let order = self.ddc.step();
                    self.carry_out(order);
                }
            }
        }
    }

    fn transmit(&mut self, message: &Message) -> Result<(), Busy> {
        self.ddc.transmit(message)
    }
}
