//! The same machines, run to completion on an [`SpiDevice`], an IRQ [`InputPin`] and a [`DelayNs`].
//!
//! For bring-up on a bench, examples and small hosts. The IRQ pin is polled every
//! [`POLL_US`]; every call returns after a bounded time.
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

use crate::Variant;
use crate::command;
use crate::listener::{self, BUFFER, ListenerConfig, ListenerCounters, ListenerEvent};
use crate::machine::{Fault, Input, Short, Step, Transfer};
use crate::poller::{self, PollerConfig, PollerCounters, PollerEvent, SendError};

/// How often the IRQ pin is looked at, in microseconds.
pub const POLL_US: u32 = 10;

/// Why a blocking call failed. The next call recovers the chip by itself.
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

/// What an executor needs: the wires and the step outstanding.
#[derive(Debug)]
struct Executor<SPI, IRQ, DELAY> {
    spi: SPI,
    irq: IRQ,
    delay: DELAY,
    /// The response to the last short transfer.
    response: [u8; Short::MAX],
}

/// What carrying out a step came to.
enum Outcome {
    Input(Given),
    /// The caller's time is over before the wait is; so many microseconds of it are left.
    Unfinished(u32),
}

/// An [`Input`] without its borrow.
#[derive(Clone, Copy)]
enum Given {
    Start,
    Short(usize),
    Loaded,
    Read { offset: usize, len: usize },
    Irq,
    Timeout,
}

impl<SPI: SpiDevice, IRQ: InputPin, DELAY: DelayNs> Executor<SPI, IRQ, DELAY> {
    fn carry_out<E>(
        &mut self,
        step: &Step<E>,
        payload: &[u8],
        buffer: &mut [u8],
        budget_us: &mut u32,
    ) -> Result<Outcome, Error<SPI::Error, IRQ::Error>> {
        Ok(Outcome::Input(match *step {
            Step::Event(_) => Given::Start,
            Step::Transfer(transfer) => self.transfer(transfer, payload, buffer).map_err(Error::Spi)?,
            Step::Wait { us } => {
                let mut left_us = us;
                loop {
                    if self.irq.is_high().map_err(Error::Pin)? {
                        break Given::Irq;
                    }
                    if left_us == 0 {
                        break Given::Timeout;
                    }
                    if *budget_us == 0 {
                        return Ok(Outcome::Unfinished(left_us));
                    }
                    let slice_us = left_us.min(POLL_US);
                    self.delay.delay_us(slice_us);
                    left_us -= slice_us;
                    *budget_us = budget_us.saturating_sub(slice_us);
                }
            }
            Step::Delay { us } => {
                self.delay.delay_us(us);
                *budget_us = budget_us.saturating_sub(us);
                Given::Timeout
            }
        }))
    }

    fn transfer(&mut self, transfer: Transfer, payload: &[u8], buffer: &mut [u8]) -> Result<Given, SPI::Error> {
        Ok(match transfer {
            Transfer::Short(short) => {
                let bytes = short.bytes();
                let (used, _) = self.response.split_at_mut(bytes.len());
                used.copy_from_slice(bytes);
                self.spi.transfer_in_place(used)?;
                Given::Short(bytes.len())
            }
            Transfer::Load { offset, len } => {
                let data = payload.get(offset..offset + len).unwrap_or(&[]);
                self.spi.transaction(&mut [Operation::Write(&[command::FIFO_LOAD]), Operation::Write(data)])?;
                Given::Loaded
            }
            Transfer::Read { offset, len } => {
                let data = buffer.get_mut(offset..offset + len).unwrap_or(&mut []);
                self.spi.transaction(&mut [Operation::Write(&[command::FIFO_READ]), Operation::Read(data)])?;
                Given::Read { offset, len }
            }
        })
    }

    fn input<'a>(&'a self, given: Given, buffer: &'a [u8]) -> Input<'a> {
        match given {
            Given::Start => Input::Start,
            Given::Short(len) => Input::Done(self.response.get(..len).unwrap_or(&[])),
            Given::Loaded => Input::Done(&[]),
            Given::Read { offset, len } => Input::Done(buffer.get(offset..offset + len).unwrap_or(&[])),
            Given::Irq => Input::Irq,
            Given::Timeout => Input::Timeout,
        }
    }
}

/// A poller that blocks.
#[derive(Debug)]
pub struct Poller<SPI, IRQ, DELAY> {
    machine: poller::Poller,
    executor: Executor<SPI, IRQ, DELAY>,
}

impl<SPI: SpiDevice, IRQ: InputPin, DELAY: DelayNs> Poller<SPI, IRQ, DELAY> {
    /// A poller on these wires. Nothing is sent yet.
    pub const fn new(spi: SPI, irq: IRQ, delay: DELAY, config: PollerConfig) -> Self {
        Self { machine: poller::Poller::new(config), executor: Executor { spi, irq, delay, response: [0; Short::MAX] } }
    }

    /// Counts since the poller was made.
    pub const fn counters(&self) -> PollerCounters {
        self.machine.counters()
    }

    /// Brings the chip up, or, if it is up, checks it: one attempt, at most about 0.3 s.
    ///
    /// # Errors
    /// What stopped it; the next call tries again after a back-off of 1 ms to 64 ms.
    pub fn bring_up(&mut self) -> Result<Variant, Error<SPI::Error, IRQ::Error>> {
        self.run(Step::Event(PollerEvent::Ready), &[])?;
        self.machine.variant().ok_or(Error::Fault(Fault::Executor))
    }

    /// Sends one frame of 1..=254 bytes and returns when the chip has sent it. Brings the chip up
    /// first if it has to.
    ///
    /// # Errors
    /// What stopped it; the frame may or may not have been sent.
    pub fn send(&mut self, payload: &[u8]) -> Result<(), Error<SPI::Error, IRQ::Error>> {
        if !self.machine.is_ready() {
            self.run(Step::Event(PollerEvent::Ready), payload)?;
        }
        let first = match self.machine.prepare(payload.len()) {
            Ok(step) => step,
            Err(SendError::Length) => return Err(Error::Length),
            Err(SendError::NotReady) => return Err(Error::Fault(Fault::Executor)),
        };
        self.run(first, payload)?; // to Prepared
        self.run(Step::Event(PollerEvent::Prepared), payload)?; // to Loaded
        let transmit = Step::Transfer(Transfer::Short(poller::Poller::transmit()));
        self.run(transmit, payload)?; // to Sent
        self.run(Step::Event(PollerEvent::Sent), payload) // checked, Ready again
    }

    /// Carries out `step` and what follows from it, to the next event.
    fn run(&mut self, mut step: Step<PollerEvent>, payload: &[u8]) -> Result<(), Error<SPI::Error, IRQ::Error>> {
        loop {
            let mut unlimited_us = u32::MAX;
            match self.executor.carry_out(&step, payload, &mut [], &mut unlimited_us) {
                Ok(Outcome::Input(given)) => {
                    step = self.machine.step(self.executor.input(given, &[]));
                }
                Ok(Outcome::Unfinished(left_us)) => step = Step::Wait { us: left_us },
                Err(error) => {
                    let _fault = self.machine.step(Input::Failed);
                    return Err(error);
                }
            }
            match step {
                Step::Event(PollerEvent::Fault(fault)) => return Err(Error::Fault(fault)),
                Step::Event(_) => return Ok(()),
                _ => {}
            }
        }
    }
}

/// A listener that blocks.
#[derive(Debug)]
pub struct Listener<SPI, IRQ, DELAY> {
    machine: listener::Listener,
    executor: Executor<SPI, IRQ, DELAY>,
    step: Step<ListenerEvent>,
}

impl<SPI: SpiDevice, IRQ: InputPin, DELAY: DelayNs> Listener<SPI, IRQ, DELAY> {
    /// A listener on these wires. Nothing is sent yet.
    pub const fn new(spi: SPI, irq: IRQ, delay: DELAY, config: ListenerConfig) -> Self {
        Self {
            machine: listener::Listener::new(config),
            executor: Executor { spi, irq, delay, response: [0; Short::MAX] },
            // Any event: its carrying out is the first `Start`.
            step: Step::Event(ListenerEvent::Listening),
        }
    }

    /// Counts since the listener was made.
    pub const fn counters(&self) -> ListenerCounters {
        self.machine.counters()
    }

    /// Which part answered the last bring-up.
    pub const fn variant(&self) -> Option<Variant> {
        self.machine.variant()
    }

    /// Goes on to the next event, or for `limit_us` microseconds of waiting, whichever is first
    /// (`None`: nothing happened). A frame is in `buffer` from its byte
    /// [`listener::PAYLOAD_OFFSET`] on; give the same buffer until an event comes. Faults are events:
    /// the call after one recovers.
    ///
    /// # Errors
    /// The bus or the pin failed; the next call recovers.
    pub fn next(
        &mut self,
        buffer: &mut [u8; BUFFER],
        limit_us: u32,
    ) -> Result<Option<ListenerEvent>, Error<SPI::Error, IRQ::Error>> {
        let mut budget_us = limit_us;
        loop {
            match self.executor.carry_out(&self.step, &[], buffer, &mut budget_us) {
                Ok(Outcome::Input(given)) => {
                    self.step = self.machine.step(self.executor.input(given, buffer));
                }
                Ok(Outcome::Unfinished(left_us)) => {
                    self.step = Step::Wait { us: left_us };
                    return Ok(None);
                }
                Err(error) => {
                    self.step = self.machine.step(Input::Failed);
                    return Err(error);
                }
            }
            if let Step::Event(event) = self.step {
                return Ok(Some(event));
            }
        }
    }
}
