//! GNSS receivers: UART in, DMA into a ring, for ever
//!
//! # Design
//!
//! Each receiver's bytes are written into a ring by a circular DMA stream. Three things make the firmware look how far
//! it has come: the line is idle, half or all of the ring is full, and every tick. Where a receiver is connected is the
//! board's table's matter ([`board::RECEIVER_PORTS`]).
//!
//! # Errata (ES0206 rev 24) of what is used here
//!
//! - 2.11.1: an idle frame may go unseen if the receiver's clock deviates. Here: idle only makes it faster: half and
//!   whole laps of the ring, and every tick, look too.
//!
//! `unsafe` here: shared access to the UARTs' register blocks, the baud rate, and the DMA stream's start.
#![allow(unsafe_code)]

use core::sync::atomic::{AtomicU32, AtomicU8, Ordering};

use horus_tx_fw::{
    ring::{Span, Writer},
    telemetry::Line,
    timing, RECEIVERS,
};
use stm32f4xx_hal::pac::{self, uart4};

use super::{
    dma::{self, Direction, Transfer},
    gpio::{self, Pull, Speed},
    HORUS_TELEMETRY,
};
use crate::board::{ReceiverPort, RECEIVER_PORTS};

/// Bytes of each receiver's ring: 11 ms at 460 800 baud, so half of it lasts for more than the 5 ms that the slowest of
/// the tasks in between takes.
pub const RING: usize = 512;

static RINGS: [[AtomicU8; RING]; RECEIVERS] = [const { [const { AtomicU8::new(0) }; RING] }; RECEIVERS];

/// Bytes ever written into each ring.
static WRITTEN: [AtomicU32; RECEIVERS] = [const { AtomicU32::new(0) }; RECEIVERS];

const _: () = assert!(RING.is_power_of_two());

fn port(index: usize) -> &'static ReceiverPort {
    const PORTS: &[ReceiverPort; profile::MAX_RECEIVERS] = &RECEIVER_PORTS;
    &PORTS[index]
}

fn uart(index: usize) -> &'static uart4::RegisterBlock {
    // SAFETY: the table holds addresses of register blocks of UARTs, or of USARTs, which begin with the same registers;
    // those are always there, every access is volatile, and each is used by one line alone.
    unsafe { &*port(index).uart }
}

/// The DMA side of one receiver's line.
pub struct GnssLine {
    index: usize,
    writer: Writer,
}

impl GnssLine {
    /// Sets up the receivers that are fitted, clocks and pins included, and starts them.
    pub fn all(rcc: &mut pac::RCC) -> [Self; RECEIVERS] {
        gpio::enable_ports();
        dma::enable();
        core::array::from_fn(|index| Self::new(index, rcc))
    }

    fn new(index: usize, rcc: &mut pac::RCC) -> Self {
        let line = Self { index, writer: Writer::new() };
        let ReceiverPort { enable, rx, bus_hz, .. } = port(index);
        // A line that is not connected reads idle.
        gpio::alternate(*rx, Speed::Low, Pull::Up);
        enable(rcc);
        // SAFETY: the stream has not been used since the reset, which leaves it off.
        unsafe { line.start_ring() };
        let uart = uart(index);
        // 16 times oversampling: BRR is the divider itself, nearest (36 MHz: 78, 0.16 % fast).
        let divider = (bus_hz + timing::GNSS_BAUD / 2) / timing::GNSS_BAUD;
        // SAFETY: any 16-bit value is a divider; this one is within 1 % of the baud rate wanted.
        uart.brr().write(|w| unsafe { w.bits(divider as u16) });
        uart.cr3().write(|w| w.dmar().set_bit().eie().set_bit());
        uart.cr1().write(|w| w.ue().set_bit().re().set_bit().idleie().set_bit());
        line
    }

    /// Starts the stream at the ring's start.
    ///
    /// # Safety
    ///
    /// The stream is off.
    unsafe fn start_ring(&self) {
        let stream = port(self.index).stream;
        dma::clear_flags(stream);
        let transfer = Transfer {
            peripheral: uart(self.index).dr().as_ptr() as u32,
            memory: RINGS[self.index].as_ptr() as u32,
            len: RING,
            direction: Direction::In { circular: true, advance: true },
        };
        // SAFETY: `peripheral` is the data register of the UART to which the table's stream and channel belong; the
        // ring is a static of `RING` atomic bytes, whose reader takes any content (a checksum decides); the stream is
        // off, as the caller vouches, and its flags are clear.
        unsafe { dma::start(stream, &transfer) };
    }

    fn telemetry(&self) -> &'static Line {
        &HORUS_TELEMETRY.lines[self.index]
    }

    /// Serves the UART's interrupt: idle line, or an error.
    pub fn uart_interrupt(&mut self) {
        let uart = uart(self.index);
        let flags = uart.sr().read();
        if flags.fe().bit_is_set() || flags.nf().bit_is_set() || flags.ore().bit_is_set() {
            self.telemetry().uart_errors.add(1);
        }
        // Reading SR, then DR, clears all of these (RM0090 "USART", status register). The line has been idle for a
        // whole frame, or its byte was bad, so the byte read here is not one the DMA wants.
        let _ = uart.dr().read();
        self.count_written();
    }

    /// Serves the stream's interrupt: half or whole lap, or called by the cycle.
    pub fn stream_interrupt(&mut self) {
        let stream = port(self.index).stream;
        dma::clear_flags(stream);
        if !dma::is_on(stream) {
            // A transfer error stops a circular stream. It begins at the ring's start again, as the writer must; what
            // was in between does not pass a checksum.
            self.telemetry().uart_errors.add(1);
            self.writer.advance(RING, RING);
            // SAFETY: the stream is off.
            unsafe { self.start_ring() };
        }
        self.count_written();
    }

    /// Publishes how many bytes the stream has written by now.
    fn count_written(&mut self) {
        let written = self.writer.advance(dma::left(port(self.index).stream), RING);
        WRITTEN[self.index].store(written, Ordering::Release);
    }
}

/// Bytes that receiver `index` has ever sent, wraps.
pub fn written(index: usize) -> u32 {
    WRITTEN[index].load(Ordering::Acquire)
}

/// Copies `span` of receiver `index`'s ring out.
pub fn copy_out(index: usize, span: Span, into: &mut [u8]) -> &[u8] {
    let len = span.len.min(into.len());
    let (into, _) = into.split_at_mut(len);
    for (to, from) in into.iter_mut().zip(&RINGS[index][span.start..]) {
        *to = from.load(Ordering::Relaxed);
    }
    into
}
