//! Runs the machines by polling, with an [`SpiDevice`], an [`InputPin`] for the IRQ pin, and a [`DelayNs`].
//!
//! This module is for bring-up on a bench, examples and small hosts. Every call returns after a bounded time.
//!
//! ```no_run
//! # fn demo<S, P, D>(spi: S, irq: P, delay: D) -> Result<(), st25r3916::blocking::Error<S::Error, P::Error>>
//! # where S: embedded_hal::spi::SpiDevice, P: embedded_hal::digital::InputPin, D: embedded_hal::delay::DelayNs {
//! use st25r3916::{PollerConfig, blocking::Poller};
//!
//! let mut poller = Poller::new(spi, irq, delay, PollerConfig::new());
//! let variant = poller.bring_up()?;
//! poller.send(b"one frame")?;
//! # let _ = variant;
//! # Ok(())
//! # }
//! ```

use embedded_hal::delay::DelayNs;
use embedded_hal::digital::InputPin;
use embedded_hal::spi::{Operation, SpiDevice};

use crate::executor::{Executor, Failed, Machine, Port};
use crate::listener::{self, BUFFER, ListenerConfig, ListenerCounters, ListenerEvent, PAYLOAD_OFFSET};
use crate::machine::{Fault, Input, Short};
use crate::poller::{self, PollerConfig, PollerCounters, PollerEvent, SendError};
use crate::{Variant, command};

/// The polling interval of the IRQ pin, µs.
pub const POLL_US: u32 = 10;

/// The reason why a blocking call failed. The next call brings the chip back into operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Error<S, P> {
    /// The SPI bus failed.
    Spi(S),
    /// The IRQ pin could not be read.
    Pin(P),
    /// The chip failed.
    Fault(Fault),
    /// The payload is empty or longer than [`poller::MAX_PAYLOAD`].
    Length,
}

#[derive(Clone, Copy, Debug)]
enum Made {
    Short(usize),
    Loaded,
    Read { offset: usize, len: usize },
    Failed,
}

/// The SPI device, the IRQ pin and the delay, as the port of an executor.
#[derive(Debug)]
struct Wires<SPI: SpiDevice, IRQ: InputPin, DELAY> {
    spi: SPI,
    irq: IRQ,
    delay: DELAY,
    response: [u8; Short::MAX],
    frame: [u8; BUFFER],
    made: Made,
    left_us: u32,
    /// The last error of the SPI device or of the IRQ pin, until the caller takes it.
    error: Option<Error<SPI::Error, IRQ::Error>>,
}

impl<SPI: SpiDevice, IRQ: InputPin, DELAY: DelayNs> Wires<SPI, IRQ, DELAY> {
    const fn new(spi: SPI, irq: IRQ, delay: DELAY) -> Self {
        let (response, frame) = ([0; Short::MAX], [0; BUFFER]);
        Self { spi, irq, delay, response, frame, made: Made::Failed, left_us: 0, error: None }
    }

    fn made(&mut self, result: Result<Made, SPI::Error>) {
        self.made = result.unwrap_or_else(|error| {
            self.error = Some(Error::Spi(error));
            Made::Failed
        });
    }

    /// Waits for the time that is left of the started timer, at most `most_us`. Returns the time waited, µs.
    fn pass(&mut self, most_us: u32) -> u32 {
        let us = self.left_us.min(most_us);
        self.delay.delay_us(us);
        self.left_us -= us;
        us
    }
}

impl<SPI: SpiDevice, IRQ: InputPin, DELAY: DelayNs> Port for Wires<SPI, IRQ, DELAY> {
    fn start_short(&mut self, short: &Short) {
        let bytes = short.bytes();
        let (used, _) = self.response.split_at_mut(bytes.len());
        used.copy_from_slice(bytes);
        let result = self.spi.transfer_in_place(used);
        self.made(result.map(|()| Made::Short(bytes.len())));
    }

    fn start_load(&mut self, offset: usize, len: usize) -> bool {
        let Some(data) = self.frame.get(offset..offset + len) else { return false };
        let load = &mut [Operation::Write(&[command::FIFO_LOAD]), Operation::Write(data)];
        let result = self.spi.transaction(load);
        self.made(result.map(|()| Made::Loaded));
        true
    }

    fn start_read(&mut self, offset: usize, len: usize) -> bool {
        let Some(data) = self.frame.get_mut(offset..offset + len) else { return false };
        let result = self.spi.transaction(&mut [Operation::Write(&[command::FIFO_READ]), Operation::Read(data)]);
        self.made(result.map(|()| Made::Read { offset, len }));
        true
    }

    fn ended(&mut self) -> bool {
        true
    }

    fn response(&self) -> Result<&[u8], Failed> {
        let bytes = match self.made {
            Made::Short(len) => self.response.get(..len),
            Made::Loaded => Some(&[][..]),
            Made::Read { offset, len } => self.frame.get(offset..offset + len),
            Made::Failed => None,
        };
        bytes.ok_or(Failed)
    }

    fn abort(&mut self) {}

    fn irq_is_high(&mut self) -> bool {
        self.irq.is_high().unwrap_or_else(|error| {
            self.error = Some(Error::Pin(error));
            false
        })
    }

    fn start_timer(&mut self, us: u32) {
        self.left_us = us;
    }

    fn elapsed(&mut self) -> bool {
        self.left_us == 0
    }
}

type Next<E, S, P> = Result<Option<E>, Error<S, P>>;

type Blocking<M, SPI, IRQ, DELAY> = Executor<M, Wires<SPI, IRQ, DELAY>>;

/// Returns `event` if there is one, else waits for the machine's next event. Returns `None` after `limit_us` of
/// waiting, µs, without an event.
fn next<M: Machine, SPI: SpiDevice, IRQ: InputPin, DELAY: DelayNs>(
    executor: &mut Blocking<M, SPI, IRQ, DELAY>,
    mut event: Option<M::Event>,
    limit_us: Option<u32>,
) -> Next<M::Event, SPI::Error, IRQ::Error> {
    let mut spent_us = 0_u32;
    loop {
        let waits = executor.is_waiting();
        // A failed transfer also becomes an event, but the recorded error of the SPI device or pin says more.
        if (event.is_some() || waits)
            && let Some(error) = executor.port().error.take()
        {
            return Err(error);
        }
        if event.is_some() {
            return Ok(event);
        }
        if waits {
            let left_us = limit_us.map_or(POLL_US, |limit_us| limit_us.saturating_sub(spent_us).min(POLL_US));
            if left_us == 0 {
                return Ok(None);
            }
            spent_us = spent_us.saturating_add(executor.port().pass(left_us));
        }
        event = executor.poll();
    }
}

/// A poller whose calls block.
#[derive(Debug)]
pub struct Poller<SPI: SpiDevice, IRQ: InputPin, DELAY>(Blocking<poller::Poller, SPI, IRQ, DELAY>);

impl<SPI: SpiDevice, IRQ: InputPin, DELAY: DelayNs> Poller<SPI, IRQ, DELAY> {
    /// Returns a poller that has not accessed its chip yet.
    pub const fn new(spi: SPI, irq: IRQ, delay: DELAY, config: PollerConfig) -> Self {
        Self(Executor::new(poller::Poller::new(config), Wires::new(spi, irq, delay)))
    }

    /// The counts of what has happened since this poller was made.
    pub const fn counters(&self) -> PollerCounters {
        self.0.machine().counters()
    }

    /// Brings the chip up, or checks the chip if that was done before. This is a single attempt, which takes about 0.3
    /// s at most.
    ///
    /// # Errors
    /// The error that stopped the bring-up. The next call tries again after a back-off of 1 ms to 64 ms.
    pub fn bring_up(&mut self) -> Result<Variant, Error<SPI::Error, IRQ::Error>> {
        self.go_on(|machine| machine.step(Input::Start))?;
        self.0.machine().variant().ok_or(Error::Fault(Fault::Executor))
    }

    /// Sends one frame of 1..=254 bytes, and returns when the chip has sent it. Brings the chip up first if necessary.
    ///
    /// # Errors
    /// The error that stopped the sending. The frame may or may not have been sent.
    pub fn send(&mut self, payload: &[u8]) -> Result<(), Error<SPI::Error, IRQ::Error>> {
        if !self.0.machine().is_ready() {
            self.bring_up()?;
        }
        let mut refused = None;
        if let Some((frame, _)) = self.0.port().frame.split_at_mut_checked(payload.len()) {
            frame.copy_from_slice(payload);
        }
        let prepared = self.go_on(|machine| {
            machine.prepare(payload.len()).unwrap_or_else(|error| {
                refused = Some(error);
                crate::Step::Event(PollerEvent::Ready)
            })
        });
        match refused {
            Some(SendError::Length) => return Err(Error::Length),
            Some(SendError::NotReady) => return Err(Error::Fault(Fault::Executor)),
            None => prepared?,
        }
        self.go_on(|machine| machine.step(Input::Start))?; // to Loaded
        self.0.port().start_short(&poller::Poller::transmit());
        let sent = if self.0.port().response().is_ok() { Input::Done(&[0]) } else { Input::Failed };
        self.go_on(|machine| machine.step(sent))?; // to Sent
        self.go_on(|machine| machine.step(Input::Start)) // checked, Ready again
    }

    /// Makes the poller take one step, and carries out all further steps up to the next event.
    fn go_on(
        &mut self,
        take: impl FnOnce(&mut poller::Poller) -> crate::Step<PollerEvent>,
    ) -> Result<(), Error<SPI::Error, IRQ::Error>> {
        let event = self.0.go_on(take);
        match next(&mut self.0, event, None)? {
            Some(PollerEvent::Fault(fault)) => Err(Error::Fault(fault)),
            _ => Ok(()),
        }
    }
}

/// A listener whose calls block.
#[derive(Debug)]
pub struct Listener<SPI: SpiDevice, IRQ: InputPin, DELAY>(Blocking<listener::Listener, SPI, IRQ, DELAY>);

impl<SPI: SpiDevice, IRQ: InputPin, DELAY: DelayNs> Listener<SPI, IRQ, DELAY> {
    /// Returns a listener that has not accessed its chip yet.
    pub const fn new(spi: SPI, irq: IRQ, delay: DELAY, config: ListenerConfig) -> Self {
        Self(Executor::new(listener::Listener::new(config), Wires::new(spi, irq, delay)))
    }

    /// The counts of what has happened since this listener was made.
    pub const fn counters(&self) -> ListenerCounters {
        self.0.machine().counters()
    }

    /// The chip's type, as the last bring-up read it; `None` before that.
    pub const fn variant(&self) -> Option<Variant> {
        self.0.machine().variant()
    }

    /// Waits for the next event. Returns `None` if no event comes before the waiting has lasted `limit_us`, µs. A fault
    /// is an event too; the next call recovers from it.
    ///
    /// # Errors
    /// The SPI bus or the IRQ pin failed. The next call recovers.
    pub fn next(&mut self, limit_us: u32) -> Result<Option<ListenerEvent>, Error<SPI::Error, IRQ::Error>> {
        // This call resumes the machine after the event of the previous call. If there was no event, the call does
        // nothing.
        let event = self.0.resume();
        next(&mut self.0, event, Some(limit_us))
    }

    /// The first `len` bytes of the receive buffer's payload. Until the next call of [`Listener::next`] these are the
    /// payload of the last [`ListenerEvent::Frame`].
    pub fn payload(&mut self, len: usize) -> &[u8] {
        self.0.port().frame.get(PAYLOAD_OFFSET..PAYLOAD_OFFSET + len).unwrap_or(&[])
    }
}
