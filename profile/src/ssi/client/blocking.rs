//! The client on an SPI device of [embedded-hal 1.0](embedded_hal), each call to its end.
//!
//! The device is configured by whoever makes it: mode 0, most significant bit first, a clock that
//! [`timing`](crate::ssi::timing) allows. Between two readings chip select stays high for at least
//! [`GAP_NS`](crate::ssi::timing::GAP_NS).
use embedded_hal::spi::{Operation, SpiDevice};

use super::{Client, Failed, MAX_MAP, Report, View};
use crate::ssi::timing::{CSN_HOLD_NS, CSN_SETUP_NS};

/// A DPR on an SPI device.
#[derive(Debug)]
pub struct Dpr<Spi> {
    spi: Spi,
    client: Client,
    buffer: [u8; MAX_MAP],
    /// Bytes that the last transaction brought.
    brought: usize,
}

impl<Spi: SpiDevice> Dpr<Spi> {
    /// A DPR that has not been read yet.
    #[must_use]
    pub const fn new(spi: Spi, client: Client) -> Self {
        Self { spi, client, buffer: [0; MAX_MAP], brought: 0 }
    }

    /// One transaction. `now_us` is the present on the flight controller's monotonic clock, `fresh_us` when the last
    /// edge of FRESH came, if the line is wired; both µs.
    ///
    /// # Errors
    ///
    /// The bus's. The report then is that of a transaction that brought nothing, and ages what is shown:
    /// [`Failed::report`].
    pub fn read(&mut self, now_us: u64, fresh_us: Option<u64>) -> Result<Report, Failed<Spi::Error>> {
        self.brought = 0;
        // The buffer has room for the longest transaction of any configuration.
        let bytes = self.client.begin(&mut self.buffer).unwrap_or(0);
        let (buffer, _) = self.buffer.split_at_mut(bytes);
        let transferred = self.spi.transaction(&mut [
            Operation::DelayNs(CSN_SETUP_NS),
            Operation::TransferInPlace(buffer),
            Operation::DelayNs(CSN_HOLD_NS),
        ]);
        match transferred {
            Ok(()) => {
                self.brought = bytes;
                Ok(self.client.end(buffer, now_us, fresh_us))
            }
            Err(bus) => Err(Failed { bus, report: self.client.end(&[], now_us, fresh_us) }),
        }
    }

    /// The objects that the last transaction brought.
    #[must_use]
    pub fn view(&self) -> View<'_> {
        let (brought, _) = self.buffer.split_at(self.brought);
        self.client.view(brought)
    }

    /// The client, to ask for a window or to write an object.
    pub const fn client(&mut self) -> &mut Client {
        &mut self.client
    }

    /// The SPI device again.
    #[must_use]
    pub fn release(self) -> Spi {
        self.spi
    }
}
