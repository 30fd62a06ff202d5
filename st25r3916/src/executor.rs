//! The executor: carries out either machine's steps through a port whose every operation only starts something.
//!
//! Three interrupts drive it: a transfer has ended, the IRQ pin has risen, the timer has run out. Each of them calls
//! [`Executor::poll`], which asks the port what is the case rather than trusting which interrupt came. So an edge of
//! the IRQ pin that is lost or reported twice, or an interrupt that comes late, does no harm, and whoever polls now and
//! then without a reason repairs what a lost edge could have left waiting.
//!
//! Nothing waits here: a call ends when a transfer or the timer runs, or with an event. Every transfer has a bound,
//! [`TRANSFER_US`]; one that does not end is reported to the machine as failed, and the machine brings the chip up
//! again.

use core::num::NonZeroUsize;

use crate::machine::{Input, Short, Step, Transfer};
use crate::{Listener, ListenerEvent, Poller, PollerEvent};

/// The longest transfer, in microseconds: 258 bytes at 8 MHz take 258 µs; with margin.
pub const TRANSFER_US: u32 = 1_000;

/// Steps without a transfer or a wait before a call gives the processor back. The machines need two.
const STEPS: u32 = 8;
/// How long a machine that exceeds that is left alone, in microseconds.
const PAUSE_US: u32 = 1_000;

/// What an executor drives: [`Poller`] or [`Listener`].
pub trait Machine {
    /// What it tells its owner.
    type Event;

    /// Takes one input, gives the next step.
    fn step(&mut self, input: Input<'_>) -> Step<Self::Event>;
}

impl Machine for Poller {
    type Event = PollerEvent;

    fn step(&mut self, input: Input<'_>) -> Step<PollerEvent> {
        Self::step(self, input)
    }
}

impl Machine for Listener {
    type Event = ListenerEvent;

    fn step(&mut self, input: Input<'_>) -> Step<ListenerEvent> {
        Self::step(self, input)
    }
}

/// A transfer that the hardware did not complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Failed;

/// The hardware that an executor needs. Every operation starts something and returns at once.
pub trait Port {
    /// Starts this transfer, full duplex, chip select low from first to last bit.
    fn start_short(&mut self, short: &Short);

    /// Starts a [`Transfer::Load`]; false where there are no such bytes. A listener needs none.
    fn start_load(&mut self, offset: usize, len: usize) -> bool {
        let _ = (offset, len);
        false
    }

    /// Starts a [`Transfer::Read`]; false where there is no such place. A poller needs none.
    fn start_read(&mut self, offset: usize, len: usize) -> bool {
        let _ = (offset, len);
        false
    }

    /// Whether the transfer has ended, well or not. If so chip select is high again, and this is not asked again before
    /// the next one.
    fn ended(&mut self) -> bool;

    /// What the transfer that ended has clocked in, as [`Input::Done`] describes it.
    ///
    /// # Errors
    ///
    /// [`Failed`] if it went wrong or was shorter than asked for.
    fn response(&self) -> Result<&[u8], Failed>;

    /// Stops a transfer that does not end; chip select is high afterwards.
    fn abort(&mut self);

    /// Whether the IRQ pin is high.
    fn irq_is_high(&mut self) -> bool;

    /// Starts the timer: `us` µs from now, or a little more. It replaces what was started before.
    fn start_timer(&mut self, us: u32);

    /// Whether that time is over.
    fn elapsed(&mut self) -> bool;
}

/// What an executor waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Waiting {
    /// The end of a transfer.
    Transfer,
    /// The IRQ pin or the timer, whichever comes first.
    IrqOrTime,
    /// The timer.
    Time,
    /// The timer, after an event.
    Later,
    /// The owner has been given an event and has not gone on yet.
    Owner,
}

/// A machine and its port.
#[derive(Debug)]
pub struct Executor<M, P> {
    machine: M,
    port: P,
    waiting: Waiting,
    /// The transfer that runs is a load.
    loading: bool,
    /// Where the read that runs ends in the frame, if one runs.
    reading_to: Option<NonZeroUsize>,
    /// How many bytes of the frame the read that has just ended has completed, if one has.
    arrived: Option<NonZeroUsize>,
}

impl<M: Machine, P: Port> Executor<M, P> {
    /// Nothing has happened yet; [`Executor::resume`] begins the bring-up.
    pub const fn new(machine: M, port: P) -> Self {
        Self { machine, port, waiting: Waiting::Owner, loading: false, reading_to: None, arrived: None }
    }

    /// The machine, to look at.
    pub const fn machine(&self) -> &M {
        &self.machine
    }

    /// The port, to swap its buffer while an event is in hand.
    pub const fn port(&mut self) -> &mut P {
        &mut self.port
    }

    /// Whether a FIFO load is under way: the bytes under it must not change.
    pub const fn is_loading(&self) -> bool {
        self.loading
    }

    /// Whether the timer is what it waits for, or the IRQ pin: nothing happens before one of them does.
    pub const fn is_waiting(&self) -> bool {
        matches!(self.waiting, Waiting::IrqOrTime | Waiting::Time | Waiting::Later)
    }

    /// How many bytes of the frame that is being received are in the buffer, LEN included: once for each read, when it
    /// has ended. `None` while more are read, since the buffer must not be looked at then.
    pub fn take_arrived(&mut self) -> Option<usize> {
        self.arrived.take().filter(|_| self.reading_to.is_none()).map(NonZeroUsize::get)
    }

    /// Takes note of what has happened and goes on as far as possible; with an event if there is one, after which the
    /// owner calls [`Executor::resume`], [`Executor::go_on`] or [`Executor::resume_later`].
    pub fn poll(&mut self) -> Option<M::Event> {
        let step = match self.waiting {
            Waiting::Transfer if self.port.ended() => {
                self.loading = false;
                self.arrived = self.reading_to.take();
                let input = self.port.response().map_or(Input::Failed, Input::Done);
                self.machine.step(input)
            }
            Waiting::Transfer if self.port.elapsed() => {
                self.loading = false;
                self.reading_to = None;
                self.port.abort();
                self.machine.step(Input::Failed)
            }
            Waiting::IrqOrTime if self.port.irq_is_high() => self.machine.step(Input::Irq),
            Waiting::IrqOrTime | Waiting::Time if self.port.elapsed() => self.machine.step(Input::Timeout),
            Waiting::Later if self.port.elapsed() => self.machine.step(Input::Start),
            Waiting::Later | Waiting::Transfer | Waiting::IrqOrTime | Waiting::Time | Waiting::Owner => return None,
        };
        self.carry_out(step)
    }

    /// Goes on after an event.
    pub fn resume(&mut self) -> Option<M::Event> {
        self.go_on(|machine| machine.step(Input::Start))
    }

    /// Goes on after an event with the step that the owner has the machine take. While something is under way nothing
    /// happens: the step that is outstanding would be lost.
    pub fn go_on(&mut self, take: impl FnOnce(&mut M) -> Step<M::Event>) -> Option<M::Event> {
        if self.waiting != Waiting::Owner {
            return None;
        }
        let step = take(&mut self.machine);
        self.carry_out(step)
    }

    /// Goes on after an event, but only `us` µs later.
    pub fn resume_later(&mut self, us: u32) {
        self.wait(Waiting::Later, us);
    }

    fn carry_out(&mut self, mut step: Step<M::Event>) -> Option<M::Event> {
        for _ in 0..STEPS {
            step = match step {
                Step::Transfer(transfer) => {
                    // The transfer first: its bound can be set while it runs.
                    if self.start(transfer) {
                        self.wait(Waiting::Transfer, TRANSFER_US);
                        return None;
                    }
                    self.machine.step(Input::Failed)
                }
                Step::Wait { us } => {
                    self.wait(Waiting::IrqOrTime, us);
                    // The pin is a level: it may be high already, or again, and then no edge comes.
                    if !self.port.irq_is_high() {
                        return None;
                    }
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
        self.wait(Waiting::Time, PAUSE_US);
        None
    }

    /// Whether the port could start it.
    fn start(&mut self, transfer: Transfer) -> bool {
        match transfer {
            Transfer::Short(short) => {
                self.port.start_short(&short);
                true
            }
            Transfer::Read { offset, len } => {
                let started = self.port.start_read(offset, len);
                self.reading_to = NonZeroUsize::new(offset + len).filter(|_| started);
                started
            }
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
