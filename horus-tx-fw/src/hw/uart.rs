//! A receiver on a UART: its bytes come in by DMA into a ring, and messages go out byte by byte
//!
//! # Design
//!
//! A circular DMA stream writes the receiver's bytes into its ring. The firmware checks how far the stream has come
//! when the line is idle, when half or all of the ring is full, and at every tick.
//!
//! An interrupt for each byte sends a message, one byte every 22 µs; messages are rare and short. A message to a
//! receiver with factory settings goes out at the factory's rate. HORUS receives nothing until the message's last bit
//! is out, and then sets the usual rate again.
//!
//! # Errata (ES0206 rev 24) of the peripheral
//!
//! - ES0206 2.11.1: an idle frame may go undetected if the receiver's clock deviates. Workaround: an idle line only
//!   makes HORUS check the stream earlier. HORUS also checks the stream when the ring is half or fully written, and at
//!   every tick.
//!
//! `unsafe` is used here for shared access to the UARTs' register blocks, to write the baud rate, and to start the DMA
//! stream.
#![allow(unsafe_code)]

use horus_tx_fw::{
    ring::Writer,
    source::{Busy, Message, Rate, Source, Vector, RING},
    telemetry::Line,
    timing,
};
use stm32f4xx_hal::pac::{self, uart4};

use super::{
    buffers,
    dma::{self, Direction, Transfer},
    gpio::{self, Pull, Speed},
    registers::Registers,
    HORUS_TELEMETRY,
};
use crate::board::UartPort;

pub struct UartSource {
    index: usize,
    port: &'static UartPort,
    registers: Registers<uart4::RegisterBlock>,
    writer: Writer,
    /// The message that is being sent, and the number of its bytes that were sent.
    outgoing: Option<(Message, usize)>,
}

impl UartSource {
    pub fn new(index: usize, port: &'static UartPort, rcc: &mut pac::RCC) -> Self {
        let source =
            Self { index, port, registers: Registers::at((port.registers)()), writer: Writer::new(), outgoing: None };
        // A line that is not connected reads as idle, because of the pull-up.
        gpio::alternate(port.rx, Speed::Low, Pull::Up);
        // Not covered: the copies for other ports, as in `hw/gpio.rs`.
        gpio::alternate(port.tx, Speed::Low, Pull::Up);
        (port.enable)(rcc);
        // SAFETY: the stream has not been used since the reset, which leaves it off.
        unsafe { source.start_ring() };
        source.set_rate(Rate::Usual);
        let uart = source.uart();
        uart.cr3().write(|w| w.dmar().set_bit().eie().set_bit());
        uart.cr1().write(|w| w.ue().set_bit().re().set_bit().te().set_bit().idleie().set_bit());
        source
    }

    fn uart(&self) -> &'static uart4::RegisterBlock {
        // SAFETY: the table holds addresses of register blocks of UARTs, or of USARTs, which begin with the same
        // registers. They are always there, every access is volatile, and only one source uses each.
        unsafe { self.registers.get() }
    }

    fn set_rate(&self, rate: Rate) {
        let baud = match rate {
            Rate::Usual => timing::GNSS_BAUD,
            Rate::Factory => timing::FACTORY_BAUD,
        };
        // With 16 times oversampling, BRR is the divider of the bus clock to the nearest integer (36 MHz: 78, 0.16 %
        // fast; 938, 0.05 % slow).
        let divider = (self.port.bus_hz + baud / 2) / baud;
        // SAFETY: any 16-bit value is a divider; this one is within 1 % of the wanted baud rate.
        self.uart().brr().write(|w| unsafe { w.bits(divider as u16) });
    }

    /// Sets the baud rate of a UART that is on, by switching it off and on.
    fn change_rate(&self, rate: Rate) {
        // The UART is off while its rate changes, because the rate must not change during a byte (RM0090 "USART",
        // fractional baud rate generation).
        self.uart().cr1().modify(|_, w| w.ue().clear_bit());
        self.set_rate(rate);
        self.uart().cr1().modify(|_, w| w.ue().set_bit());
    }

    /// Starts the DMA stream, which writes from the start of the receiver's ring.
    ///
    /// # Safety
    ///
    /// The stream is off.
    unsafe fn start_ring(&self) {
        let stream = self.port.stream;
        dma::clear_flags(stream);
        let transfer = Transfer {
            peripheral: self.uart().dr().as_ptr() as u32,
            memory: buffers::ring(self.index).memory().as_ptr() as u32,
            len: RING,
            direction: Direction::In { circular: true, advance: true },
        };
        // SAFETY: `peripheral` is the data register of the UART to which the stream and channel of the board's table
        // belong; the ring is a static of `RING` atomic bytes, whose reader accepts any content (a checksum decides);
        // the caller guarantees that the stream is off, and its flags are clear.
        unsafe { dma::start(stream, &transfer) };
    }

    fn telemetry(&self) -> &'static Line {
        &HORUS_TELEMETRY.lines[self.index]
    }

    fn uart_interrupt(&mut self) {
        let uart = self.uart();
        let flags = uart.sr().read();
        let is_bad = flags.fe().bit_is_set() || flags.nf().bit_is_set() || flags.ore().bit_is_set();
        if is_bad {
            self.telemetry().uart_errors.add(1);
        }
        if is_bad || flags.idle().bit_is_set() {
            // Reading SR, then DR, clears all of these flags (RM0090 "USART", status register). The DMA stream does not
            // lose a byte by this read: either the line has been idle for a whole frame, or its last byte was bad.
            let _ = uart.dr().read();
        }
        self.send(flags.txe().bit_is_set(), flags.tc().bit_is_set());
    }

    /// Sends the next byte of the message if the previous one has left the data register. Ends the message when its
    /// last bit is out.
    fn send(&mut self, is_empty: bool, is_complete: bool) {
        let uart = self.uart();
        let Some((message, sent)) = &mut self.outgoing else { return };
        match message.bytes().get(*sent) {
            Some(byte) if is_empty => {
                *sent += 1;
                // SAFETY: every byte may be sent.
                uart.dr().write(|w| unsafe { w.bits(u16::from(*byte)) });
            }
            Some(_) => {}
            // The flag TC is cleared before the last byte is written, because until then it reports the end of an
            // earlier byte.
            None if is_complete => {
                let rate = message.rate();
                self.outgoing = None;
                // Both interrupts of the transmitter are switched off. The interrupt of the empty data register may
                // still be on after the last bit.
                uart.cr1().modify(|_, w| w.txeie().clear_bit().tcie().clear_bit());
                if rate != Rate::Usual {
                    self.change_rate(Rate::Usual);
                }
            }
            None => {
                uart.cr1().modify(|_, w| w.txeie().clear_bit().tcie().set_bit());
            }
        }
    }

    /// Checks how many bytes the DMA stream has written, and restarts a stream that has stopped.
    fn look(&mut self) {
        let stream = self.port.stream;
        dma::clear_flags(stream);
        if !dma::is_on(stream) {
            // A transfer error stops a circular stream. The restarted stream writes from the ring's start, so the count
            // of its bytes restarts too. A message that the error has cut fails its checksum.
            self.telemetry().uart_errors.add(1);
            self.writer.advance(RING, RING);
            // SAFETY: the stream is off.
            unsafe { self.start_ring() };
        }
    }

    /// Publishes the number of bytes that the DMA stream has written so far.
    fn count_written(&mut self) {
        let written = self.writer.advance(dma::left(self.port.stream), RING);
        buffers::ring(self.index).set_written(written);
    }
}

impl Source for UartSource {
    fn poll(&mut self) {
        self.look();
        // Not covered: the ring of a receiver beyond the last, as in `hw/buffers.rs`.
        self.count_written();
    }

    fn interrupt(&mut self, vector: Vector) {
        // Not covered: only this line, the interrupt of a timer, which a UART does not have.
        match vector {
            Vector::Peripheral => self.uart_interrupt(),
            Vector::Stream => self.look(),
            Vector::Timer => {}
        }
        // Not covered: the ring of a receiver beyond the last, as in `hw/buffers.rs`.
        self.count_written();
    }

    fn transmit(&mut self, message: &Message) -> Result<(), Busy> {
        // Not covered: a message under way: it is out after 5.2 ms at most, before the next tick.
        if self.outgoing.is_some() {
            return Err(Busy);
        }
        if message.rate() != Rate::Usual {
            self.change_rate(message.rate());
        }
        self.outgoing = Some((*message, 0));
        self.uart().cr1().modify(|_, w| w.txeie().set_bit());
        Ok(())
    }
}
