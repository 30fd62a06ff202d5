//! The front end's part of a cycle: what the exchange's state machine has to do, and when.
//!
//! # Design
//!
//! The driver's [`Executor`] stands between its state machine ([`Exchange`]) and the hardware; each interrupt of the
//! SPI, the IRQ pin and the timer calls [`Link::poll`]. The link decides which frame is prepared and loaded, and takes
//! the answers. No task ever waits for the SPI.
//!
//! The command that starts a frame is the one transfer that must happen at an exact instant. When the frame's head is
//! loaded, the link *arms* a [`Ticket`], which says for which cycle the head was loaded. The slot's interrupt, which
//! has the highest priority, asks [`Ticket::is_due`] and makes the transfer of the command. A slot without a ticket, or
//! with that of another cycle, sends nothing: no frame is sent late.
//!
//! The state machine recovers from a fault of the chip by itself, and the cycle goes on.

use profile::{
    hold::{Answer, HoldObject},
    HoldStatus,
};
use st25r3916::{
    executor::{self, Executor},
    Exchange, ExchangeEvent, Fault, Input, NoAnswer, Step,
};

use crate::telemetry::Telemetry;

/// The right to fire one loaded frame, in one word that interrupts can pass on atomically.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ticket(u32);

impl Ticket {
    /// The ticket for the frame of cycle `tick`.
    #[must_use]
    pub const fn new(tick: u32) -> Self {
        // Bit 31 makes the word different from 0, which is no ticket.
        Self(tick | 1 << 31)
    }

    /// Returns the ticket as one word, which is never 0.
    #[must_use]
    pub const fn word(self) -> u32 {
        self.0
    }

    /// Whether `word` is the ticket that allows a frame in cycle `tick`.
    #[must_use]
    pub const fn is_due(word: u32, tick: u32) -> bool {
        word == Self::new(tick).0
    }
}

/// The hardware of a link: the executor's port, which loads the frame and reads the answer, and the slot's ticket.
pub trait FrontEndPort: executor::Port {
    /// Makes these bytes the frame that is loaded. Never called while a load is under way.
    fn deposit(&mut self, frame: &[u8; HoldObject::SIZE]);
    /// Hands a ticket to the slot's interrupt, which alone uses the SPI until it has taken the ticket.
    fn arm(&mut self, ticket: Ticket);
    /// Takes an unused ticket back; returns false if the slot has taken the ticket already.
    fn disarm(&mut self) -> bool;
    /// Returns the `len` bytes of payload of the answer that was read last; empty if there are fewer.
    fn answer(&self, len: usize) -> &[u8];
}

/// Who has to act before the state machine can go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Turn {
    /// The executor: a transfer or a wait is under way.
    Executor,
    /// The cycle: the chip is prepared for a frame, and there is nothing to send.
    Cycle,
    /// The slot's interrupt: a frame whose head is loaded waits for its slot, or its command is on the SPI.
    Slot,
}

/// Makes the state machine send one frame in each cycle, and takes the answers.
pub struct Link<'a, P> {
    executor: Executor<Exchange, P>,
    telemetry: &'a Telemetry,
    turn: Turn,
    /// The cycle of the frame that was deposited last. The next field is whether that frame is still to be loaded.
    tick: u32,
    is_due: bool,
    faulty: bool,
    fault: Option<Fault>,
    answer: Option<Answer>,
}

impl<'a, P: FrontEndPort> Link<'a, P> {
    /// Begins to bring up the chip, and returns the link.
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

    /// Offers the frame of cycle `tick`, which replaces one that was not sent. If the chip is not prepared yet, the
    /// frame is loaded as soon as it is, and sent if that is in time for the slot.
    pub fn offer(&mut self, tick: u32, status: &HoldStatus) {
        if self.turn == Turn::Slot && !self.executor.port().disarm() {
            // The command of the cycle before has not ended until now, so the transfer is given up.
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
            // A frame of the cycle before that has missed its slot is dropped.
            self.go_on(|exchange| exchange.step(Input::Start));
        }
    }

    /// Serves an interrupt: a transfer has ended, the IRQ pin has risen, or the timer has run out. Returns whether an
    /// answer has come.
    pub fn poll(&mut self) -> bool {
        if self.turn != Turn::Slot {
            let event = self.executor.poll();
            self.serve(event);
        } else if self.executor.port().ended() {
            self.go_on(|exchange| exchange.step(Input::Done(&[])));
        }
        self.answer.is_some()
    }

    /// Returns the answer that has come since the last call.
    pub fn take_answer(&mut self) -> Option<Answer> {
        self.answer.take()
    }

    /// Returns the last fault of the front end since the last call, for the log.
    pub fn take_fault(&mut self) -> Option<Fault> {
        self.fault.take()
    }

    /// Returns the port, for the flags of its interrupts, and for tests.
    pub fn port(&mut self) -> &mut P {
        self.executor.port()
    }

    /// Makes the state machine take a step after an event, and serves what follows.
    fn go_on(&mut self, take: impl FnOnce(&mut Exchange) -> Step<ExchangeEvent>) {
        self.turn = Turn::Executor;
        let event = self.executor.go_on(take);
        self.serve(event);
    }

    /// Prepares the chip for the next frame. If the state machine refuses, it is given a failure, from which it
    /// recovers.
    fn prepare(&mut self) -> Option<ExchangeEvent> {
        let length = HoldObject::SIZE;
        self.executor.go_on(|exchange| exchange.prepare(length).unwrap_or_else(|_| exchange.step(Input::Failed)))
    }

    /// Serves an event and the events that follow from it at once; the state machine asks for a transfer or a wait
    /// after every event but a fault.
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
                    // The chip's flags decide nothing: each uplink has a CRC of its own.
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
