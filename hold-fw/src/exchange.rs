//! Drives the front end: in each cycle sends one frame and takes the DPR's answer.
//!
//! # Design
//!
//! The driver's [`Executor`] connects its state machine ([`Exchange`]) to the hardware. Each interrupt of the SPI, the
//! IRQ pin and the timer calls [`Link::poll`]. No task ever waits for the SPI.
//!
//! The transmit command is the only transfer that must happen at an exact instant. Once the chip's FIFO has the first
//! bytes of a frame (its head), the link *arms* a [`Ticket`] that names the frame's cycle. The slot's interrupt, which
//! has the highest priority, sends the command if [`Ticket::is_due`]. Without a ticket of the present cycle the slot
//! sends nothing, so no frame is sent late.
//!
//! After a fault of the chip the state machine brings the chip up again by itself.

use profile::{
    hold::{Answer, HoldObject},
    HoldStatus,
};
use st25r3916::{
    executor::{self, Executor},
    Exchange, ExchangeEvent, Fault, Input, NoAnswer, Step,
};

use crate::{telemetry::Telemetry, timing::BEATS};

/// The right to send one loaded frame, as one word that interrupts can pass on atomically.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ticket(u32);

impl Ticket {
    /// Returns the ticket for the frame of cycle `tick`.
    #[must_use]
    pub const fn new(tick: u32) -> Self {
        // Bit 31 is set, because the word 0 means that there is no ticket.
        Self(tick | 1 << 31)
    }

    /// Returns the ticket as one word, which is never 0.
    #[must_use]
    pub const fn word(self) -> u32 {
        self.0
    }

    /// Whether `word` is the ticket for the frame that is sent in beat `beat`. A frame is sent only in the first beat
    /// of its cycle. The timer raises the slot's interrupt after every beat, and in a later beat the frame would come
    /// late.
    #[must_use]
    pub const fn is_due(word: u32, beat: u32) -> bool {
        word == Self::new(beat / BEATS).0 && beat.is_multiple_of(BEATS)
    }
}

/// The hardware that a [`Link`] uses: the executor's port, with the frame, the answer and the ticket.
pub trait FrontEndPort: executor::Port {
    /// Sets the bytes of the next frame to load. This is never called during a load.
    fn deposit(&mut self, frame: &[u8; HoldObject::SIZE]);
    /// Hands a ticket to the slot's interrupt. From then on only that interrupt uses the SPI, until it has taken the
    /// ticket.
    fn arm(&mut self, ticket: Ticket);
    /// Takes the ticket back. Returns false if the slot's interrupt has taken the ticket already.
    fn disarm(&mut self) -> bool;
    /// Returns the payload of the last answer, `len` bytes; empty if the answer has fewer.
    fn answer(&self, len: usize) -> &[u8];
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Turn {
    /// A transfer or a delay has to end. The executor handles that end.
    Executor,
    /// [`Link::offer`] has to be called: the chip is prepared, and there is no frame to send.
    Cycle,
    /// The slot's interrupt has to come: a frame's head is loaded, or the transmit command is on the SPI.
    Slot,
}

/// Sends one frame in each cycle and takes the answers.
pub struct Link<'a, P> {
    executor: Executor<Exchange, P>,
    telemetry: &'a Telemetry,
    turn: Turn,
    /// The cycle of the last frame that was deposited. `is_due` says whether that frame still has to be loaded.
    tick: u32,
    is_due: bool,
    faulty: bool,
    fault: Option<Fault>,
    answer: Option<Answer>,
}

impl<'a, P: FrontEndPort> Link<'a, P> {
    /// Begins to bring up the chip and returns the link.
    pub fn start(telemetry: &'a Telemetry, port: P) -> Self {
        let mut link = Self {
            executor: Executor::new(Exchange::new(), port),
            telemetry,
            turn: Turn::Executor,
            tick: 0,
            is_due: false,
            faulty: false,
            fault: None,
            answer: None,
        };
        link.go_on(|exchange| exchange.step(Input::Start));
        link
    }

    /// Offers the frame of cycle `tick`, which replaces a frame that was not sent. If the chip is not prepared yet, the
    /// frame is loaded once the chip is prepared, and it is sent if its load ends before the slot.
    pub fn offer(&mut self, tick: u32, status: &HoldStatus) {
        if self.turn == Turn::Slot && !self.executor.port().disarm() {
            // The transmit command of the previous cycle has still not ended, so its transfer is aborted.
            self.executor.port().abort();
            self.go_on(|exchange| exchange.step(Input::Failed));
        }
        self.telemetry.frames_skipped.add(u32::from(self.is_due || self.turn == Turn::Slot));
        if self.executor.is_loading() {
            self.telemetry.frames_skipped.add(1);
            self.is_due = false;
            return;
        }
        self.executor.port().deposit(status.as_bytes());
        (self.tick, self.is_due) = (tick, true);
        if self.turn != Turn::Executor {
            // A frame of the previous cycle has missed its slot. This step drops it.
            self.go_on(|exchange| exchange.step(Input::Start));
        }
    }

    /// Handles an interrupt: the end of a transfer, an edge of the IRQ pin, or the end of a delay. Returns whether an
    /// answer has arrived.
    pub fn poll(&mut self) -> bool {
        if self.turn != Turn::Slot {
            let event = self.executor.poll();
            self.serve(event);
        } else if self.executor.port().ended() {
            self.go_on(|exchange| exchange.step(Input::Done(&[])));
        }
        self.answer.is_some()
    }

    /// Returns the answer that has arrived since the last call, if any.
    pub fn take_answer(&mut self) -> Option<Answer> {
        self.answer.take()
    }

    /// Returns the last fault of the front end that was not returned before, if any.
    pub fn take_fault(&mut self) -> Option<Fault> {
        self.fault.take()
    }

    /// Returns the port of the link.
    pub fn port(&mut self) -> &mut P {
        self.executor.port()
    }

    fn go_on(&mut self, take: impl FnOnce(&mut Exchange) -> Step<ExchangeEvent>) {
        self.turn = Turn::Executor;
        let event = self.executor.go_on(take);
        self.serve(event);
    }

    /// Prepares the chip for the next frame. A state machine that refuses the frame gets the input of a failed transfer
    /// instead, and recovers from that.
    fn prepare(&mut self) -> Option<ExchangeEvent> {
        let length = HoldObject::SIZE;
        // Not covered: a refusal: the machine has just said that it is ready, and the length is a constant that a frame
        // can have.
        self.executor.go_on(|exchange| exchange.prepare(length).unwrap_or_else(|_| exchange.step(Input::Failed)))
    }

    fn serve(&mut self, mut event: Option<ExchangeEvent>) {
        while let Some(happened) = event {
            self.turn = Turn::Executor;
            event = match happened {
                ExchangeEvent::Ready => {
                    if self.faulty {
                        self.faulty = false;
                        self.telemetry.rf_recoveries.add(1);
                    }
                    self.prepare()
                }
                ExchangeEvent::Prepared if !self.is_due => {
                    self.turn = Turn::Cycle;
                    return;
                }
                ExchangeEvent::Loaded if self.is_due => {
                    (self.turn, self.is_due) = (Turn::Slot, false);
                    self.executor.port().arm(Ticket::new(self.tick));
                    return;
                }
                ExchangeEvent::Prepared | ExchangeEvent::Loaded => self.executor.resume(),
                ExchangeEvent::Answer { len, .. } => {
                    self.telemetry.frames_sent.add(1);
                    self.telemetry.answers.add(1);
                    // An answer with error flags is accepted too, because each uplink in it has a CRC of its own.
                    match Answer::read(self.executor.port().answer(len)) {
                        Ok(answer) => self.answer = Some(*answer),
                        Err(_) => self.telemetry.answers_foreign.add(1),
                    }
                    self.executor.resume()
                }
                ExchangeEvent::NoAnswer(why) => {
                    self.telemetry.frames_sent.add(1);
                    match why {
                        NoAnswer::Silent => self.telemetry.silences.add(1),
                        NoAnswer::Late | NoAnswer::Dropped(_) => self.telemetry.answers_dropped.add(1),
                    }
                    self.executor.resume()
                }
                ExchangeEvent::Fault(fault) => {
                    self.telemetry.rf_faults.add(1);
                    if let Fault::Register { address, expected, found } = fault {
                        self.telemetry.rf_register.set(u32::from_be_bytes([0, address, expected, found]));
                    }
                    self.faulty = true;
                    self.fault = Some(fault);
                    self.executor.resume()
                }
            };
        }
    }
}
