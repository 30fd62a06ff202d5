//! A receiver on SPI: one transfer in each cycle by DMA, in both directions at once
//!
//! # Design
//!
//! [`horus_tx_fw::spi`] decides what happens when; this file has the registers. A timer times chip select's set-up and
//! hold times, so no code waits. Chip select rises one hold time after the last byte has come in, when the SPI has long
//! ended its last bit (RM0090 "SPI", disabling).
//!
//! # Errata (ES0206 rev 24) of the peripheral
//!
//! - ES0206 2.12.1, 2.12.5: BSY may stay high when the SPI is disabled, or after a transfer in some modes, which are
//!   not used here. Workaround: the SPI stays enabled, and no code waits for BSY.
//! - ES0206 2.12.4: the last bit may be corrupted in controller mode with delayed SCK feedback. Workaround: the pin of
//!   SCK has the fastest output speed setting, and SCK runs at 0.56 MHz of the 45 MHz allowed.
//!
//! `unsafe` is used here for shared access to the peripheral's register block, and to start the DMA streams.
#![allow(unsafe_code)]

use core::{
    cell::Cell,
    ops::Range,
    sync::atomic::{compiler_fence, AtomicU32, Ordering},
};

use firmware_common::memory;
use horus_tx_fw::{
    source::{Busy, Message, Source, Vector},
    spi::{Filter, Order, Polling, FILLER, HOLD_US, SETUP_US, TRANSFER},
    timing,
};
use stm32f4xx_hal::pac::{self, spi1};

use super::{
    buffers,
    dma::{self, Direction, Transfer},
    gpio::{self, Pull, Speed},
    registers::Registers,
    steps::Steps,
    HORUS_TELEMETRY,
};
use crate::board::SpiPort;

const WORDS: usize = TRANSFER / 4;
const FILLER_WORD: u32 = u32::from_ne_bytes([FILLER; 4]);

/// The memory that the DMA streams write and read. At most one receiver is on SPI (the board's table asserts it).
static IN: [AtomicU32; WORDS] = [const { AtomicU32::new(FILLER_WORD) }; WORDS];
static OUT: [AtomicU32; WORDS] = [const { AtomicU32::new(FILLER_WORD) }; WORDS];

pub(super) fn memory() -> [Range<u32>; 2] {
    [memory::span(&IN), memory::span(&OUT)]
}

// The stated SPI clock must agree with `set_up`, which divides the bus clock by 128.
const _: () = assert!(timing::GNSS_SPI_HZ * 128 == timing::APB2_HZ);

pub struct SpiSource {
    index: usize,
    port: &'static SpiPort,
    registers: Registers<spi1::RegisterBlock>,
    polling: Polling,
    filter: Filter,
    steps: Steps,
    /// Whether `OUT` holds a message, which the next transfer sends.
    has_message: bool,
}

impl SpiSource {
    pub fn new(index: usize, port: &'static SpiPort, rcc: &mut pac::RCC) -> Self {
        (port.enable)(rcc);
        // Not covered: the copies for other ports, as in `hw/gpio.rs`.
        gpio::output(port.chip_select, Speed::Low, true);
        // Not covered: the copies for other ports, as in `hw/gpio.rs`.
        gpio::alternate(port.sck, Speed::VeryHigh, Pull::None);
        // Without a receiver, the pull-up makes the SPI line read like that of a receiver without data.
        gpio::alternate(port.miso, Speed::Low, Pull::Up);
        // Not covered: the copies for other ports, as in `hw/gpio.rs`.
        gpio::alternate(port.mosi, Speed::Low, Pull::None);
        let steps = Steps::new(&port.timer, rcc);
        let source = Self {
            index,
            port,
            registers: Registers::at((port.registers)()),
            polling: Polling::new(),
            filter: Filter::new(),
            steps,
            has_message: false,
        };
        source.set_up();
        source
    }

    fn spi(&self) -> &'static spi1::RegisterBlock {
        // SAFETY: the table holds the address of an SPI's register block, which is always there; every access is
        // volatile, and only this source uses the SPI.
        unsafe { self.registers.get() }
    }

    fn set_up(&self) {
        self.spi().cr1().write(|w| {
            w.cpol().idle_low();
            w.cpha().first_edge();
            w.mstr().master();
            w.br().div128();
            w.ssm().enabled();
            w.ssi().slave_not_selected();
            w.spe().enabled()
        });
    }

    fn carry_out(&mut self, order: Order) {
        match order {
            Order::Nothing => {}
            // Not covered: this arm, of which `poll` has a copy of its own: no other caller selects the receiver.
            Order::Select => {
                gpio::write(self.port.chip_select, false);
                self.steps.start(SETUP_US);
            }
            Order::Transfer => self.transfer(),
            Order::Hold => {
                self.finish();
                self.steps.start(HOLD_US);
            }
            Order::Finish => {
                gpio::write(self.port.chip_select, true);
                self.take();
                self.clear_out();
            }
            Order::Abort => {
                self.steps.stop();
                // If a DMA stream does not stop, `transfer` does not start it, and the next tick tries again.
                let _ = (dma::stop(self.port.stream_out), dma::stop(self.port.stream_in));
                self.finish();
                gpio::write(self.port.chip_select, true);
                self.spi().cr1().modify(|_, w| w.spe().disabled());
                let _ = self.spi().dr8().read();
                let _ = self.spi().sr().read();
                self.set_up();
                self.filter = Filter::new();
                self.clear_out();
            }
        }
    }

    /// Disconnects the SPI's requests from both DMA streams, which must be off, and clears the streams' flags.
    fn finish(&self) {
        self.spi().cr2().write(|w| w);
        dma::clear_flags(self.port.stream_in);
        dma::clear_flags(self.port.stream_out);
    }

    fn transfer(&self) {
        let (stream_in, stream_out) = (self.port.stream_in, self.port.stream_out);
        if dma::is_on(stream_in) || dma::is_on(stream_out) {
            return;
        }
        self.finish();
        let peripheral = self.spi().dr().as_ptr() as u32;
        let incoming = Transfer {
            peripheral,
            memory: IN.as_ptr() as u32,
            len: TRANSFER,
            direction: Direction::In { circular: false, advance: true },
        };
        let outgoing = Transfer { peripheral, memory: OUT.as_ptr() as u32, len: TRANSFER, direction: Direction::Out };
        self.spi().cr2().write(|w| w.rxdmaen().set_bit());
        // SAFETY: the data register is that of the peripheral to which the streams and channels of the board's table
        // belong; both memories are statics of `TRANSFER` atomic bytes; the streams are off, and their flags are clear.
        unsafe {
            dma::start(stream_in, &incoming);
            dma::start(stream_out, &outgoing);
        }
        self.spi().cr2().write(|w| w.rxdmaen().set_bit().txdmaen().set_bit());
    }

    /// Puts the bytes that have come in, without filler, into the ring. Most of a transfer is filler, which is skipped
    /// four bytes at a time.
    fn take(&mut self) {
        compiler_fence(Ordering::Acquire);
        let is_old = self.polling.is_old();
        let filter = Cell::from_mut(&mut self.filter);
        let words = IN.iter().map(|word| word.load(Ordering::Relaxed)).filter(|word| {
            let mut state = filter.get();
            let is_filler = *word == FILLER_WORD && state.skips();
            filter.set(state);
            !is_filler
        });
        let bytes = words.flat_map(u32::to_ne_bytes).filter(|byte| {
            let mut state = filter.get();
            let is_kept = state.keeps(*byte);
            filter.set(state);
            is_kept
        });
        let brought = if is_old {
            bytes.count() > 0
        } else {
            buffers::ring(self.index).push(bytes);
            true
        };
        self.polling.read(brought, self.filter.has_nothing_more());
    }

    fn clear_out(&mut self) {
        if core::mem::take(&mut self.has_message) {
            OUT.iter().for_each(|word| word.store(FILLER_WORD, Ordering::Relaxed));
        }
    }

    fn stream_interrupt(&mut self) {
        let incoming = dma::flags(self.port.stream_in);
        // Not covered: an error of a stream. It has one only at an address without memory: all addresses are those of
        // statics, and cannot change while the stream is on (RM0090, DMA_SxPAR and DMA_SxM0AR).
        let has_error = incoming.has_error() || dma::flags(self.port.stream_out).has_error();
        // Not covered: only this line, an error of a stream, as above.
        if !has_error && !incoming.is_complete() {
            // The task was called only to check in for the watchdog. A transfer that ends from now on leaves its flag
            // set, which calls the task again.
            return;
        }
        // Not covered: the copy of this for an error of a stream.
        dma::clear_flags(self.port.stream_in);
        // Not covered: the copy of this for an error of a stream.
        dma::clear_flags(self.port.stream_out);
        let order = if has_error {
            // Not covered: an error of a stream, as above.
            self.polling.failed()
        } else {
            // The last byte comes in after the last one was sent, so the outgoing DMA stream has ended too.
            // Not covered: the end of a transfer that has not begun: the stream is off then.
            self.polling.transferred()
        };
        self.carry_out(order);
    }
}

impl Source for SpiSource {
    fn poll(&mut self) {
        let order = self.polling.poll();
        self.carry_out(order);
        // Not covered: only this line, the telemetry of a receiver beyond the last, as in `hw/buffers.rs`.
        let line = &HORUS_TELEMETRY.sources[self.index];
        line.recoveries.set(self.polling.recoveries());
        line.timed_out.set(self.polling.timed_out());
    }

    fn interrupt(&mut self, vector: Vector) {
        // Not covered: only this line, the interrupt of the peripheral: no row of the board's table has one for SPI.
        match vector {
            Vector::Peripheral => {}
            Vector::Stream => self.stream_interrupt(),
            Vector::Timer => {
                if self.steps.is_over() {
                    // Not covered: only this line, the end of a time outside of a transfer: the timer runs only within
                    // one.
                    let order = self.polling.elapsed();
                    self.carry_out(order);
                }
            }
        }
    }

    fn transmit(&mut self, message: &Message) -> Result<(), Busy> {
        if !self.polling.is_idle() || self.has_message {
            return Err(Busy);
        }
        // Not covered: other lengths: those of the configuration messages leave one or three bytes behind words of
        // four.
        for (word, bytes) in OUT.iter().zip(message.bytes().chunks(4)) {
            let mut four = [FILLER; 4];
            four[..bytes.len()].copy_from_slice(bytes);
            word.store(u32::from_ne_bytes(four), Ordering::Relaxed);
        }
        self.has_message = true;
        Ok(())
    }
}
