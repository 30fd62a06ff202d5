//! The front end's part of a cycle: what the poller's state machine has to do, and when
//!
//! # Design
//!
//! The [`Poller`], a state machine, handles the chip and no time slots. The driver's [`Executor`] stands between it and
//! the hardware, whose interrupts call [`Transmitter::poll`]. The transmitter owns the executor: it decides which frame
//! the state machine prepares and loads, and when. No task ever waits for the SPI.
//!
//! Once a frame was sent, the chip is prepared for the next one. So after the tick only the frame's head has to
//! be loaded.
//!
//! The command that starts a frame must be sent at an exact instant. When the frame's head is loaded, the transmitter
//! *arms* a [`Ticket`] and starts no other transfer. The ticket says for which cycle and frame the head was loaded. The
//! slot's interrupt has the highest priority. It asks [`Ticket::due`], writes the command's byte, and reports to
//! [`Transmitter::slot`], which starts the load of the rest. A slot without a ticket, or with that of another cycle or
//! frame, sends nothing. So no frame is sent late, or with data older than its cycle's.
//!
//! The state machine recovers from a fault of the chip by itself. Only the frames that fall into the recovery are lost.

use core::ops::Range;

use profile::{air::Place, Profile};
use st25r3916::{
    executor::{self, Executor},
    Fault, Input, Poller, PollerConfig, PollerEvent,
};

use crate::{telemetry::Telemetry, timing::payload, FRAMES, RECEIVERS};

/// The right to fire one loaded frame, in one word that interrupts can pass on atomically.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ticket(u32);

impl Ticket {
    /// The ticket that allows no frame to be fired.
    pub const NONE: Self = Self(0);

    /// Returns the ticket for frame `frame` of tick `tick`, which is fired by sending `command`.
    #[must_use]
    pub const fn new(tick: u32, frame: usize, command: u8) -> Self {
        Self((tick & 0xFFFF) << 16 | ((frame as u32 & 0xFF) << 8) | command as u32)
    }

    /// Returns the ticket as one word; 0 is [`Ticket::NONE`].
    #[must_use]
    pub const fn word(self) -> u32 {
        self.0
    }

    /// Makes a ticket from its word, which [`word`](Self::word) returned.
    #[must_use]
    pub const fn from_word(word: u32) -> Self {
        Self(word)
    }

    /// Returns the command to send in slot `frame` of tick `tick`, if this ticket is for that slot.
    #[must_use]
    pub const fn due(self, tick: u32, frame: usize) -> Option<u8> {
        let command = (self.0 & 0xFF) as u8;
        // Not covered: only this line, a ticket for another slot: with one frame in a cycle, a ticket is for the slot
        // that comes, or there is none.
        if command != 0 && self.0 == Self::new(tick, frame, command).0 {
            Some(command)
        } else {
            None
        }
    }
}

/// What happened in a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot {
    /// The number of the slot's frame within its cycle.
    pub frame: usize,
    /// The byte that came in while the command was sent; `None` if no frame was fired.
    pub fired: Option<u8>,
}

/// The hardware of a transmitter: the executor's port, which loads frames from a profile, and the slot's ticket.
pub trait FrontEndPort: executor::Port {
    /// Makes `profile` the one from which frames are loaded. Never called while a load is under way.
    fn deposit(&mut self, profile: &Profile<RECEIVERS>);
    /// Makes the range `frame` of the profile's bytes the frame to load.
    fn point_at(&mut self, frame: Range<usize>);
    /// Hands a ticket to the slot's interrupt.
    fn arm(&mut self, ticket: Ticket);
    /// Takes an unused ticket back. Returns false if a slot has taken the ticket already.
    fn disarm(&mut self) -> bool;
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Turn {
    /// A transfer or a wait of the executor is in progress.
    Executor,
    /// The chip is prepared for a frame, and waits until a cycle has one to send.
    Cycle,
    /// A frame whose head is loaded waits for the interrupt of its slot.
    Slot,
}

/// Makes the poller's state machine send the frames of one cycle after the other.
pub struct Transmitter<'a, P> {
    executor: Executor<Poller, P>,
    telemetry: &'a Telemetry,
    turn: Turn,
    tick: u32,
    /// The index of the next frame to load; [`FRAMES`] if all frames of the cycle were loaded.
    next: usize,
    prepared: usize,
    /// The tick and the index of the frame whose head was loaded last.
    sending: (u32, usize),
    faulty: bool,
    fault: Option<Fault>,
}

impl<'a, P: FrontEndPort> Transmitter<'a, P> {
    /// Begins to bring up the chip, and returns the transmitter.
    pub fn start(config: PollerConfig, telemetry: &'a Telemetry, port: P) -> Self {
        let mut transmitter = Self {
            executor: Executor::new(Poller::new(config), port),
            telemetry,
            turn: Turn::Executor,
            tick: 0,
            next: FRAMES,
            prepared: 0,
            sending: (0, FRAMES),
            faulty: false,
            fault: None,
        };
        let event = transmitter.executor.resume();
        transmitter.serve(event);
        transmitter
    }

    /// Offers the profile of tick `tick`, whose frames replace the unsent frames of the previous profile. If the chip
    /// is not prepared yet, the profile's frames are loaded later, if that is in time for their slots.
    ///
    /// Returns false, and takes nothing, while an earlier cycle's frame is being loaded or has just been fired, because
    /// that frame's bytes must not change. This cycle's slot is lost then.
    pub fn offer(&mut self, tick: u32, profile: &Profile<RECEIVERS>) -> bool {
        // Not covered: only this line, a frame that is armed: its slot passes before the next cycle's profile is
        // offered.
        let kept = match self.turn {
            Turn::Executor => self.executor.is_loading(),
            // A ticket that cannot be taken back has already fired its frame.
            // Not covered: a frame that is armed, as above.
            Turn::Slot => !self.executor.port().disarm(),
            Turn::Cycle => false,
        };
        // Not covered: a load under way, or a frame that has fired: a load ends and a slot passes before the next
        // profile is offered.
        if kept {
            self.next = FRAMES;
            return false;
        }
        self.executor.port().deposit(profile);
        self.tick = tick;
        self.next = 0;
        // Not covered: only this line, a frame that is armed when a profile is offered, as above.
        let event = match self.turn {
            Turn::Executor => None,
            Turn::Cycle => self.prepared(),
            // The frame of an earlier cycle has missed its slot and is dropped.
            // Not covered: a frame that is armed when a profile is offered, as above.
            Turn::Slot => self.executor.resume(),
        };
        self.serve(event);
        true
    }

    /// Serves an interrupt: a transfer has ended, the IRQ pin has risen, or the timer has run out.
    pub fn poll(&mut self) {
        let event = self.executor.poll();
        self.serve(event);
    }

    /// Takes the result of a slot that has passed: which frame the slot was for, and whether a command was sent.
    pub fn slot(&mut self, slot: Slot) {
        self.next = self.next.max(slot.frame + 1);
        // Not covered: only this line, a slot that fires without an armed frame, and an armed frame that does not fire:
        // a frame is armed only for the next slot, which fires it.
        match (slot.fired, self.turn) {
            (Some(response), Turn::Slot) => {
                let event = self.executor.go_on(|poller| poller.step(Input::Done(&[response])));
                self.serve(event);
            }
            // The loaded frame was meant for another slot, so it is dropped, and the next frame follows.
            // Not covered: a frame that is armed for another slot: it is armed only for the next slot, which fires it.
            (None, Turn::Slot) if self.sending != (self.tick, self.next) => {
                self.executor.port().disarm();
                let event = self.executor.resume();
                self.serve(event);
            }
            // Every slot polls the executor, even without an event, so that a lost edge of the front end's IRQ is
            // noticed.
            _ => self.poll(),
        }
    }

    /// Returns the last fault of the front end that was not returned before, for the log.
    pub fn take_fault(&mut self) -> Option<Fault> {
        self.fault.take()
    }

    /// Returns the port, for the flags of its interrupts, and for tests.
    pub fn port(&mut self) -> &mut P {
        self.executor.port()
    }

    /// Prepares the chip for the next frame: one of this cycle, or the first one of the next cycle.
    fn prepare(&mut self) -> Option<PollerEvent> {
        self.prepared = if self.next < FRAMES { self.next } else { 0 };
        let length = payload(self.prepared);
        // A state machine that refuses the frame gets the input of a failed transfer, which it reports and recovers
        // from.
        // Not covered: a refusal: the length is that of a frame, and a preparation comes only between two frames.
        self.executor.go_on(|poller| poller.prepare(length).unwrap_or_else(|_| poller.step(Input::Failed)))
    }

    /// Starts the load of the next frame. To be called when the chip is prepared for a frame; does nothing if there is
    /// none to send.
    fn prepared(&mut self) -> Option<PollerEvent> {
        // Not covered: only this line, a chip that is prepared for another frame, and no frame: with one frame in a
        // cycle it is always prepared for that frame.
        if self.prepared != self.next {
            // Not covered: a chip that is prepared for another frame, as above.
            return self.prepare();
        }
        self.sending = (self.tick, self.next);
        let place = Place::of_frame::<RECEIVERS>(self.next);
        let frame = place.map_or(0..0, |place| place.offset()..place.offset() + place.length());
        self.executor.port().point_at(frame);
        self.executor.resume()
        // Not covered: only this line, the return from the two paths above that no run takes.
    }

    /// Serves an event of the state machine, and the events that this causes at once: three at most, because the state
    /// machine requests a transfer or a wait after every event but a fault.
    fn serve(&mut self, mut event: Option<PollerEvent>) {
        // Not covered: only this line, another event behind `prepared`, which requests a transfer.
        while let Some(happened) = event {
            event = match happened {
                PollerEvent::Ready => {
                    if self.faulty {
                        self.faulty = false;
                        self.telemetry.rf_recoveries.add(1);
                    }
                    self.prepare()
                }
                PollerEvent::Prepared if self.next >= FRAMES => {
                    self.turn = Turn::Cycle;
                    return;
                }
                // Not covered: only this line, where the compiler has put the path of a machine that still waits, as in
                // `Executor::go_on`.
                PollerEvent::Prepared => self.prepared(),
                // Not covered: only this line, a frame that is loaded too late for its slot: a frame is loaded at the
                // beginning of its own cycle.
                PollerEvent::Loaded if self.sending == (self.tick, self.next) => {
                    self.turn = Turn::Slot;
                    let (tick, frame) = self.sending;
                    let command = Poller::transmit().bytes().first().copied().unwrap_or(0);
                    self.executor.port().arm(Ticket::new(tick, frame, command));
                    return;
                }
                // This frame was loaded too late for its slot, so it is dropped.
                PollerEvent::Loaded => self.executor.resume(),
                PollerEvent::Sent { confirmed } => {
                    self.telemetry.frames_sent.add(1);
                    self.telemetry.frames_unconfirmed.add(u32::from(!confirmed));
                    self.executor.resume()
                }
                PollerEvent::Fault(fault) => {
                    self.telemetry.rf_faults.add(1);
                    self.telemetry.fifo_errors.set(self.executor.machine().counters().flow);
                    if let Fault::Register { address, expected, found } = fault {
                        self.telemetry.rf_register.set(u32::from_be_bytes([0, address, expected, found]));
                    }
                    // Not covered: only this line, to which the debug information leads the question of
                    // `Executor::go_on`, as above.
                    self.faulty = true;
                    self.fault = Some(fault);
                    self.executor.resume()
                }
            };
            self.turn = Turn::Executor;
        }
        // Not covered: only this line, the return from the path above that no run takes.
    }
}
