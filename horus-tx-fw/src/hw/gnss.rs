//! The sources of the GNSS receivers' bytes, with a type for each kind of interface
//!
//! # Design
//!
//! The board's table says where each receiver is connected ([`crate::board::RECEIVER_PORTS`]). Each kind of interface
//! has a file with a [`Source`] type ([`super::uart`], [`super::ddc`], [`super::spi`]). Every tick and interrupts of
//! one priority serve a source, which puts the received bytes into a ring ([`super::buffers`]).
#![forbid(unsafe_code)]

use horus_tx_fw::{
    configuration::Configuration,
    source::{Busy, Source, Vector},
    RECEIVERS,
};
use stm32f4xx_hal::pac;

use super::{
    buffers::{outbox, ring},
    ddc::DdcSource,
    dma, gpio,
    spi::SpiSource,
    uart::UartSource,
};
use crate::board::{Hardware, ReceiverPort, RECEIVER_PORTS};

const PORTS: &[ReceiverPort; profile::MAX_RECEIVERS] = &RECEIVER_PORTS;

/// Returns the configuration state of receiver `index`, to which no message has been sent yet.
pub fn configuration(index: usize) -> Configuration {
    let port = &PORTS[index];
    Configuration::new(port.hardware.interface(), port.period_ms)
}

enum Kind {
    Uart(UartSource),
    Ddc(DdcSource),
    Spi(SpiSource),
}

pub struct GnssLine {
    index: usize,
    kind: Kind,
}

impl GnssLine {
    /// Sets up the receivers that are fitted, including clocks and pins, and starts them.
    pub fn all(rcc: &mut pac::RCC) -> [Self; RECEIVERS] {
        gpio::enable_ports();
        dma::enable();
        // Not covered: the ends of an array of another length, for which the compiler has left code.
        core::array::from_fn(|index| Self {
            index,
            kind: match &PORTS[index].hardware {
                Hardware::Uart(port) => Kind::Uart(UartSource::new(index, port, rcc)),
                Hardware::Ddc(port) => Kind::Ddc(DdcSource::new(index, port, rcc)),
                Hardware::Spi(port) => Kind::Spi(SpiSource::new(index, port, rcc)),
            },
        })
    }

    /// Whether the receiver is on a bus, and so sends only in the transfers that each tick begins.
    pub fn is_bus(&self) -> bool {
        !matches!(self.kind, Kind::Uart(_))
    }

    fn source(&mut self) -> &mut dyn Source {
        // Not covered: the other kinds of sources: each receiver has one, but the compiler does not know it from the
        // place in the array.
        match &mut self.kind {
            Kind::Uart(source) => source,
            Kind::Ddc(source) => source,
            Kind::Spi(source) => source,
        }
    }

    /// Serves the tick: hands the waiting message to the source, and polls the source.
    pub fn poll(&mut self) {
        let outbox = outbox(self.index);
        if let Some(message) = outbox.peek() {
            if self.source().transmit(&message) != Err(Busy) {
                outbox.clear();
            }
        }
        self.source().poll();
    }

    /// Serves one of the source's interrupts. Returns whether bytes have come.
    pub fn interrupt(&mut self, vector: Vector) -> bool {
        let before = ring(self.index).written();
        self.source().interrupt(vector);
        ring(self.index).written() != before
    }
}
