//! The client on an SPI device of [embedded-hal-async 1.0](embedded_hal_async): the asynchronous form of
//! [`blocking`](super::blocking).
//!
//! The caller configures the device: mode 0, most significant bit first, a clock that [`timing`](crate::ssi::timing)
//! allows. Between two readings chip select stays high for at least [`GAP_NS`](crate::ssi::timing::GAP_NS).
use embedded_hal_async::spi::{Operation, SpiDevice};

use super::{Client, Failed, MAX_MAP, Report, View};
use crate::ssi::timing::{CSN_HOLD_NS, CSN_SETUP_NS};

/// A DPR that is read through an SPI device.
#[derive(Debug)]
pub struct Dpr<Spi> {
    spi: Spi,
    client: Client,
    buffer: [u8; MAX_MAP],
    brought: usize,
}

impl<Spi: SpiDevice> Dpr<Spi> {
    /// A client for the DPR on this SPI device.
    #[must_use]
    pub const fn new(spi: Spi, client: Client) -> Self {
        Self { spi, client, buffer: [0; MAX_MAP], brought: 0 }
    }

    /// Makes one transaction. `now_us` is the present instant on the flight controller's monotonic clock, `fresh_us`
    /// the instant of the last edge of FRESH, if that line is wired; both µs. If the future is dropped before its end,
    /// the next call sends the same bytes again.
    ///
    /// # Errors
    ///
    /// The error of the bus. [`Failed::report`] is then the report of a transaction without data. Its position has
    /// become older.
    pub async fn read(&mut self, now_us: u64, fresh_us: Option<u64>) -> Result<Report, Failed<Spi::Error>> {
        self.brought = 0;
        // `begin` cannot fail here, because the buffer has room for the longest transaction.
        let bytes = self.client.begin(&mut self.buffer).unwrap_or(0);
        let (buffer, _) = self.buffer.split_at_mut(bytes);
        let transferred = self
            .spi
            .transaction(&mut [
                Operation::DelayNs(CSN_SETUP_NS),
                Operation::TransferInPlace(buffer),
                Operation::DelayNs(CSN_HOLD_NS),
            ])
            .await;
        match transferred {
            Ok(()) => {
                self.brought = bytes;
                Ok(self.client.end(buffer, now_us, fresh_us))
            }
            Err(bus) => Err(Failed { bus, report: self.client.end(&[], now_us, fresh_us) }),
        }
    }

    /// The objects that the last transaction read.
    #[must_use]
    pub fn view(&self) -> View<'_> {
        let (brought, _) = self.buffer.split_at(self.brought);
        self.client.view(brought)
    }

    /// The client. By it a window is requested or an object is written.
    pub const fn client(&mut self) -> &mut Client {
        &mut self.client
    }

    /// Returns the SPI device.
    #[must_use]
    pub fn release(self) -> Spi {
        self.spi
    }
}
