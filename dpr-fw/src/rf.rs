//! Carries out the steps of the ST25R3916's listener machine, driven by interrupts.
//!
//! # Design
//!
//! The machine ([`st25r3916::Listener`]) decides what to say to the chip; the [`Port`] starts SPI transfers by EasyDMA and a timer; this
//! executor stands between them. Three interrupts drive it: transfer ended, IRQ pin risen, timer elapsed. All three call
//! [`Executor::poll`], which asks the port what is the case rather than trusting which interrupt came. So a lost edge of the IRQ pin, an edge
//! that is reported twice (anomaly 155) or an interrupt that comes late does no harm, and the cyclic heartbeat that pends the task heals what
//! an edge could have lost.
//!
//! Nothing waits: a poll ends when a transfer or the timer runs. Every transfer has a bound as well, [`TRANSFER_US`]; one that does not end is reported to the
//! machine as failed, and the machine brings the chip up again.
//!
//! A FIFO read puts a meaningless byte in front of the data, clocked in under the command. The port receives it into the byte before the place where
//! the data go: for the first read that is the last of the [`LEAD`] bytes, for later ones the last byte of the chunk before, which the port keeps
//! and puts back. So frames lie where they are wanted without a copy.

use st25r3916::{listener::PAYLOAD_OFFSET, Input, Listener, ListenerEvent, Step, Transfer};

/// Bytes in front of LEN in a receive buffer: room for the byte under the read command, chosen so that the payload is aligned.
pub const LEAD: usize = 3;
const _: () = assert!((LEAD + PAYLOAD_OFFSET).is_multiple_of(4));

/// The longest transfer, µs: 258 bytes at 8 MHz take 258 µs; with margin.
pub const TRANSFER_US: u32 = 1_000;

/// How long the chip is left alone after a frame, µs: the commit takes 50. The next sync is at least 0.45 ms after the end of a frame (0.30 ms
/// between two frames of a cycle, 0.15 ms of preamble and sync), of which reading takes 0.26 ms at worst (store-and-forward) and re-arming 0.03 ms.
pub const REST_US: u32 = 80;

/// Steps without a transfer or a wait before a poll gives the processor back. The machine needs two.
const STEPS: u32 = 8;
/// How long a machine that exceeds that is left alone, µs.
const PAUSE_US: u32 = 1_000;

/// The hardware the executor needs. Its receive buffer is the one that is being written; the owner of the port swaps it
/// on events.
pub trait Port {
    /// Starts a transfer of `bytes`, at most [`st25r3916::Short::MAX`], full duplex, chip select low from first to last bit.
    fn start_short(&mut self, bytes: &[u8]);
    /// Starts a FIFO read of `len` bytes to place `offset` of the receive buffer, counted from LEN.
    fn start_read(&mut self, offset: usize, len: usize);
    /// Whether the transfer has ended. If so chip select is high again, and this is not asked again before the next one.
    fn ended(&mut self) -> bool;
    /// What the transfer that ended has clocked in, without the byte under a read command.
    ///
    /// # Errors
    ///
    /// [`Failed`] if it was shorter than asked for.
    fn response(&self) -> Result<&[u8], Failed>;
    /// Stops a transfer that does not end.
    fn abort(&mut self);
    /// Whether the IRQ pin is high.
    fn irq(&mut self) -> bool;
    /// Starts the timer: `micros` µs from now.
    fn start_timer(&mut self, micros: u32);
    /// Whether that time is over.
    fn elapsed(&mut self) -> bool;
    /// A free-running counter, µs.
    fn now_us(&mut self) -> u32;
}

/// A transfer that the hardware did not complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Failed;

/// What the executor waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Waiting {
    Transfer,
    IrqOrTime,
    Time,
    /// The owner let it rest.
    Rest,
    /// The owner has an event in hand.
    Owner,
}

/// The executor: machine and port.
#[derive(Debug)]
pub struct Executor<P> {
    listener: Listener,
    port: P,
    waiting: Waiting,
    irq_us: u32,
    /// Where the read that runs or ran last starts, and its length.
    read: (usize, usize),
    arrived: usize,
}

impl<P: Port> Executor<P> {
    /// Nothing has happened yet; [`Executor::resume`] begins the bring-up.
    pub fn new(listener: Listener, port: P) -> Self {
        Self { listener, port, waiting: Waiting::Owner, irq_us: 0, read: (0, 0), arrived: 0 }
    }

    /// The port, to swap its buffer while an event is in hand.
    pub fn port(&mut self) -> &mut P {
        &mut self.port
    }

    /// The counter, µs, when the IRQ pin was last found high: for a frame, its end.
    pub fn irq_us(&self) -> u32 {
        self.irq_us
    }

    /// How many bytes of the frame that is being received are in the buffer, LEN included; 0 as soon as another begins or none is there.
    /// `None` while more are read: then nobody may look.
    pub fn arrived(&self) -> Option<usize> {
        let reading = self.waiting == Waiting::Transfer && self.arrived < self.read.0 + self.read.1;
        (!reading || self.arrived == 0).then_some(self.arrived)
    }

    /// Looks what has come and goes on as far as possible; with an event if there is one, after which [`Executor::resume`] or
    /// [`Executor::rest`] has to be called.
    pub fn poll(&mut self) -> Option<ListenerEvent> {
        let step = match self.waiting {
            Waiting::Transfer if self.port.ended() => {
                self.arrived = self.read.0 + self.read.1;
                let input = self.port.response().map_or(Input::Failed, Input::Done);
                self.listener.step(input)
            }
            Waiting::Transfer if self.port.elapsed() => {
                self.port.abort();
                self.listener.step(Input::Failed)
            }
            Waiting::IrqOrTime if self.port.irq() => self.irq(),
            Waiting::IrqOrTime | Waiting::Time if self.port.elapsed() => self.listener.step(Input::Timeout),
            Waiting::Rest if self.port.elapsed() => self.listener.step(Input::Start),
            Waiting::Rest | Waiting::Transfer | Waiting::IrqOrTime | Waiting::Time | Waiting::Owner => return None,
        };
        self.carry_out(step)
    }

    /// Goes on after an event.
    pub fn resume(&mut self) -> Option<ListenerEvent> {
        let step = self.listener.step(Input::Start);
        self.carry_out(step)
    }

    /// Goes on after a frame, but only [`REST_US`] later, so that the transfers that re-arm the chip do not interrupt the commit of the frame.
    pub fn rest(&mut self) {
        self.wait(Waiting::Rest, REST_US);
    }

    fn irq(&mut self) -> Step<ListenerEvent> {
        self.irq_us = self.port.now_us();
        self.listener.step(Input::Irq)
    }

    fn carry_out(&mut self, mut step: Step<ListenerEvent>) -> Option<ListenerEvent> {
        for _ in 0..STEPS {
            match step {
                Step::Transfer(Transfer::Short(short)) => {
                    self.wait(Waiting::Transfer, TRANSFER_US);
                    self.port.start_short(short.bytes());
                    return None;
                }
                Step::Transfer(Transfer::Read { offset, len }) => {
                    self.wait(Waiting::Transfer, TRANSFER_US);
                    self.read = (offset, len);
                    // The first read of a frame starts at its beginning.
                    self.arrived = offset;
                    self.port.start_read(offset, len);
                    return None;
                }
                // A listener sends nothing.
                Step::Transfer(Transfer::Load { .. }) => step = self.listener.step(Input::Failed),
                Step::Wait { micros } => {
                    self.wait(Waiting::IrqOrTime, micros);
                    // The pin is a level: it may be high already, or again, and then no edge comes.
                    if !self.port.irq() {
                        return None;
                    }
                    step = self.irq();
                }
                Step::Delay { micros } => {
                    self.wait(Waiting::Time, micros);
                    return None;
                }
                Step::Event(event) => {
                    self.waiting = Waiting::Owner;
                    self.read = (0, 0);
                    self.arrived = 0;
                    return Some(event);
                }
            }
        }
        self.wait(Waiting::Time, PAUSE_US);
        None
    }

    fn wait(&mut self, waiting: Waiting, micros: u32) {
        self.waiting = waiting;
        self.port.start_timer(micros);
    }
}
