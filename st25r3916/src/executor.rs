//! The executor carries out a machine's steps through a [`Port`] to the hardware.
//!
//! Three interrupts drive the executor: a transfer has ended, the IRQ pin has risen, or the timer has run out. Each of
//! them calls [`Executor::poll`], which reads the port's state and does not rely on which interrupt came. So a late
//! interrupt and an edge that is reported twice do no harm. If an edge of the IRQ pin can be lost, poll also without an
//! interrupt now and then.
//!
//! The executor never blocks: a call returns with an event, or when a transfer or the timer runs. A transfer that does
//! not end within [`TRANSFER_US`] is reported to the machine as failed, and the machine brings the chip up again.

use core::num::NonZeroUsize;

use crate::machine::{Input, Short, Step, Transfer};
use crate::{Answerer, AnswererEvent, Exchange, ExchangeEvent, Listener, ListenerEvent, Poller, PollerEvent};

/// The longest duration of a transfer, µs. A transfer of 258 bytes takes 258 µs at 8 MHz; the rest is margin.
pub const TRANSFER_US: u32 = 1_000;

/// An executor's call returns after this number of steps in a row without a transfer or a wait. The state machines take
/// at most two such steps in a row.
const STEPS: u32 = 8;
/// The pause, µs, after a call that took [`STEPS`] steps without a transfer or a wait.
const PAUSE_US: u32 = 1_000;

/// The machine that an executor drives: [`Poller`], [`Listener`], [`Exchange`] or [`Answerer`].
pub trait Machine {
    /// The machine's events for its owner.
    type Event;

    /// Takes one input and returns the machine's next step.
    fn step(&mut self, input: Input<'_>) -> Step<Self::Event>;
}

impl Machine for Poller {
    type Event = PollerEvent;

    fn step(&mut self, input: Input<'_>) -> Step<PollerEvent> {
        // Not covered: in the copy for the poller, a transfer that has failed, as in `poll`.
        Self::step(self, input)
    }
}

impl Machine for Listener {
    type Event = ListenerEvent;

    fn step(&mut self, input: Input<'_>) -> Step<ListenerEvent> {
        Self::step(self, input)
    }
}

impl Machine for Exchange {
    type Event = ExchangeEvent;

    fn step(&mut self, input: Input<'_>) -> Step<ExchangeEvent> {
        Self::step(self, input)
    }
}

impl Machine for Answerer {
    type Event = AnswererEvent;

    fn step(&mut self, input: Input<'_>) -> Step<AnswererEvent> {
        Self::step(self, input)
    }
}

/// A transfer that the hardware did not complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Failed;

/// The hardware that an executor needs. Every operation returns at once.
pub trait Port {
    /// Starts this full-duplex transfer, with chip select low from its first to its last bit.
    fn start_short(&mut self, short: &Short);

    /// Starts a [`Transfer::Load`]. Returns false if the payload does not have these bytes. A listener needs no loads.
    fn start_load(&mut self, offset: usize, len: usize) -> bool {
        let _ = (offset, len);
        false
    }

    /// Starts a [`Transfer::Read`]. Returns false if the buffer does not have these bytes. A poller needs no reads.
    fn start_read(&mut self, offset: usize, len: usize) -> bool {
        let _ = (offset, len);
        false
    }

    /// Whether the transfer has ended, with or without success, and chip select is high again. Once this function has
    /// returned true, the executor does not call it again before the next transfer.
    fn ended(&mut self) -> bool;

    /// Returns the bytes that came in during the transfer that has ended, as [`Input::Done`] describes them.
    ///
    /// # Errors
    ///
    /// [`Failed`] if the transfer failed or was too short.
    fn response(&self) -> Result<&[u8], Failed>;

    /// Stops a transfer that does not end; chip select is high afterwards.
    fn abort(&mut self);

    /// Whether the IRQ pin is high.
    fn irq_is_high(&mut self) -> bool;

    /// Starts the timer for `us` µs, or slightly more. An earlier start of the timer is replaced.
    fn start_timer(&mut self, us: u32);

    /// Whether the time of the last [`Port::start_timer`] is over.
    fn elapsed(&mut self) -> bool;
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Waiting {
    Transfer,
    /// The executor waits for the IRQ pin or the end of the timer, whichever comes first.
    IrqOrTime,
    Time,
    /// The executor waits for the end of the timer, and then lets the machine continue after an event.
    Later,
    /// The executor waits for its owner's next call, because it has returned an event.
    Owner,
}

/// The executor of a machine, with its port.
#[derive(Debug)]
pub struct Executor<M, P> {
    machine: M,
    port: P,
    waiting: Waiting,
    loading: bool,
    /// The number of bytes of the frame that the buffer will hold when the present read has ended; `None` between
    /// reads.
    reading_to: Option<NonZeroUsize>,
    /// The number of bytes of the frame that are in the buffer after the read that has just ended; `None` if no read
    /// has.
    arrived: Option<NonZeroUsize>,
}

impl<M: Machine, P: Port> Executor<M, P> {
    /// Returns an executor in its initial state; [`Executor::resume`] begins the bring-up.
    pub const fn new(machine: M, port: P) -> Self {
        Self { machine, port, waiting: Waiting::Owner, loading: false, reading_to: None, arrived: None }
    }

    /// The state machine that the executor drives.
    pub const fn machine(&self) -> &M {
        &self.machine
    }

    /// The port, so that the owner can swap its buffer after an event.
    pub const fn port(&mut self) -> &mut P {
        &mut self.port
    }

    /// Whether a FIFO load is in progress, during which the payload's bytes must not change.
    pub const fn is_loading(&self) -> bool {
        self.loading
    }

    /// Whether the executor waits only for the timer or the IRQ pin.
    pub const fn is_waiting(&self) -> bool {
        matches!(self.waiting, Waiting::IrqOrTime | Waiting::Time | Waiting::Later)
    }

    /// The number of bytes of the present frame in the buffer, LEN included, returned once for each read that has
    /// ended. `None` while a further read runs, because the buffer must not be read then.
    pub fn take_arrived(&mut self) -> Option<usize> {
        self.arrived.take().filter(|_| self.reading_to.is_none()).map(NonZeroUsize::get)
    }

    /// Evaluates the port's state, and carries out the machine's steps until one waits for the hardware or an event
    /// comes. After an event the owner calls [`Executor::resume`], [`Executor::go_on`] or [`Executor::resume_later`].
    pub fn poll(&mut self) -> Option<M::Event> {
        let step = match self.waiting {
            // Not covered: only this line, in the copy for HORUS, an end without a transfer: the port reports each end
            // once.
            Waiting::Transfer if self.port.ended() => {
                self.loading = false;
                // Not covered: only this line, a read of the FIFO in the copy for HORUS, whose poller asks for none.
                self.arrived = self.reading_to.take();
                // Not covered: only this line, a transfer that has failed: each transfer of the bench ends with all of
                // its bytes.
                let input = self.port.response().map_or(Input::Failed, Input::Done);
                self.machine.step(input)
            }
            // Not covered: a transfer that does not end in time: no SPI of the bench hangs.
            Waiting::Transfer if self.port.elapsed() => {
                self.loading = false;
                self.reading_to = None;
                self.port.abort();
                self.machine.step(Input::Failed)
            }
            Waiting::IrqOrTime if self.port.irq_is_high() => self.machine.step(Input::Irq),
            Waiting::IrqOrTime | Waiting::Time if self.port.elapsed() => self.machine.step(Input::Timeout),
            // Not covered: the executors of the transmitter, of the second port and of the hold never resume later.
            Waiting::Later if self.port.elapsed() => self.machine.step(Input::Start),
            Waiting::Later | Waiting::Transfer | Waiting::IrqOrTime | Waiting::Time | Waiting::Owner => return None,
        };
        self.carry_out(step)
    }

    /// Makes the machine continue after an event, with [`Input::Start`].
    pub fn resume(&mut self) -> Option<M::Event> {
        self.go_on(|machine| machine.step(Input::Start))
    }

    /// Makes the machine continue after an event by calling `take`. Has no effect during a transfer or a wait.
    pub fn go_on(&mut self, take: impl FnOnce(&mut M) -> Step<M::Event>) -> Option<M::Event> {
        // Not covered: a call while the machine waits: each owner calls only after an event.
        if self.waiting != Waiting::Owner {
            return None;
        }
        let step = take(&mut self.machine);
        self.carry_out(step)
    }

    /// Makes the machine continue after an event, with [`Input::Start`], `us` µs later.
    pub fn resume_later(&mut self, us: u32) {
        self.wait(Waiting::Later, us);
    }

    fn carry_out(&mut self, mut step: Step<M::Event>) -> Option<M::Event> {
        // Not covered: only this line, the end of the steps: the machines take two steps at most before they wait.
        for _ in 0..STEPS {
            step = match step {
                Step::Transfer(transfer) => {
                    // Not covered: only this line, a transfer that the port refuses, since the machines ask only for
                    // bytes of their frame.
                    if self.start(transfer) {
                        self.wait(Waiting::Transfer, TRANSFER_US);
                        return None;
                    }
                    // Not covered: a transfer that the port refuses, as above.
                    self.machine.step(Input::Failed)
                }
                Step::Wait { us } => {
                    self.wait(Waiting::IrqOrTime, us);
                    // If the IRQ pin is high already, no edge and so no interrupt will come.
                    if !self.port.irq_is_high() {
                        return None;
                    }
                    // Not covered: the end of the steps behind such a step, as above.
                    self.machine.step(Input::Irq)
                }
                Step::Delay { us } => {
                    self.wait(Waiting::Time, us);
                    return None;
                }
                Step::Event(event) => {
                    self.waiting = Waiting::Owner;
                    self.arrived = None;
                    return Some(event);
                }
            };
        }
        // Not covered: the end of the steps, as above. It keeps a machine that never waits, which only a flipped bit
        // makes of it, from holding up the board.
        self.wait(Waiting::Time, PAUSE_US);
        None
    }

    fn start(&mut self, transfer: Transfer) -> bool {
        // Not covered: only this line, a kind of transfer that this machine does not ask for: a poller reads nothing,
        // and a listener loads nothing.
        match transfer {
            Transfer::Short(short) => {
                // Not covered: a length above that of the longest transfer, which no machine's transfer has.
                self.port.start_short(&short);
                true
            }
            Transfer::Read { offset, len } => {
                let started = self.port.start_read(offset, len);
                // Not covered: only this line, a read that the port refuses, as above.
                self.reading_to = NonZeroUsize::new(offset + len).filter(|_| started);
                started
            }
            // Not covered: a load that a listener does not ask for, and one that the port refuses, as above.
            Transfer::Load { offset, len } => {
                self.loading = self.port.start_load(offset, len);
                self.loading
            }
        }
    }

    fn wait(&mut self, waiting: Waiting, us: u32) {
        self.waiting = waiting;
        self.port.start_timer(us);
    }
}
