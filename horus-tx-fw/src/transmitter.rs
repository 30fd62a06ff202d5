//! The front end's side of a cycle: what the poller machine is told, and when
//!
//! # Design
//!
//! The [`Poller`] machine knows the chip and nothing of time slots; the SPI, the IRQ pin and a one-shot
//! timer know nothing of the chip. A [`Transmitter`] sits between: it carries out the machine's steps
//! through a [`Port`], whose every operation only *starts* something, and goes on when the interrupt
//! that ends it calls [`Transmitter::done`], [`Transmitter::edge`] or [`Transmitter::elapsed`]. No task ever waits
//! for the SPI.
//!
//! As soon as a frame was sent the chip is prepared for the next one, long before there is anything to send. So what is
//! left between the tick and the slot is to load the frame's head.
//!
//! The one transfer that must happen at its exact instant is the command that starts a frame. When the head is loaded
//! the transmitter *arms* a [`Ticket`], which says for which cycle and frame it was loaded, and starts no other
//! transfer. The slot's interrupt, above everything else, asks [`Ticket::due`], writes the command's byte, and reports
//! back through [`Transmitter::slot`], which starts the load of the rest. A slot that finds no ticket, or that of
//! another cycle or frame, sends nothing: a frame never goes out late, and never with data older than its cycle's.
//!
//! A fault of the chip is the machine's business to recover from; here it costs the frames of the
//! meantime, each counted, and nothing else. The cycle goes on.

use profile::{air::Place, Profile};
use st25r3916::{Fault, Input, Poller, PollerConfig, PollerEvent, Short, Step, Transfer};

use crate::{telemetry::Telemetry, timing::payload, FRAMES, RECEIVERS};

/// The right to fire one loaded frame, in one word that interrupts can pass on atomically.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ticket(u32);

impl Ticket {
    /// The ticket of no frame.
    pub const NONE: Self = Self(0);

    /// For frame `frame` of tick `tick`, fired by sending `command`.
    #[must_use]
    pub const fn new(tick: u32, frame: usize, command: u8) -> Self {
        Self((tick & 0xFFFF) << 16 | ((frame as u32 & 0xFF) << 8) | command as u32)
    }

    /// As one word; 0 is [`Ticket::NONE`].
    #[must_use]
    pub const fn word(self) -> u32 {
        self.0
    }

    /// From one word.
    #[must_use]
    pub const fn from_word(word: u32) -> Self {
        Self(word)
    }

    /// The command to send in slot `frame` of tick `tick`, if this ticket is for that slot.
    #[must_use]
    pub const fn due(self, tick: u32, frame: usize) -> Option<u8> {
        let command = (self.0 & 0xFF) as u8;
        if command != 0 && self.0 == Self::new(tick, frame, command).0 {
            Some(command)
        } else {
            None
        }
    }
}

/// What a slot came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot {
    /// Which frame of the cycle it was for.
    pub frame: usize,
    /// The byte clocked in while the command went out, or `None` if nothing was fired.
    pub fired: Option<u8>,
}

/// The hardware a transmitter works with. Every operation starts something and returns at once. The names are those of
/// the port of the DPR's executor, which does the same for a listener.
pub trait Port {
    /// Makes `profile` the one whose frames [`Port::start_load`] sends. Never called while a load is under way.
    fn deposit(&mut self, profile: &Profile<RECEIVERS>);
    /// Starts this SPI transfer, full duplex.
    fn start_short(&mut self, short: &Short);
    /// Starts an SPI transfer of the FIFO load command and the profile's bytes `start..start + len`.
    fn start_load(&mut self, start: usize, len: usize);
    /// Ends a transfer that did not end by itself; chip select is high afterwards.
    fn abort(&mut self);
    /// Whether the chip's IRQ pin is high.
    fn irq_is_high(&self) -> bool;
    /// Starts the one-shot timer: [`Transmitter::elapsed`] is due after `us` µs or a little more.
    fn start_timer(&mut self, us: u32);
    /// Stops the one-shot timer.
    fn stop_timer(&mut self);
    /// Hands a ticket to the slots.
    fn arm(&mut self, ticket: Ticket);
    /// Takes an unused ticket back; false if a slot has taken it already.
    fn disarm(&mut self) -> bool;
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Not started.
    Off,
    /// A short transfer or a FIFO load is under way.
    Transfer { loading: bool },
    /// For the IRQ pin or the timer.
    Wait,
    /// For the timer alone.
    Delay,
    /// The chip is prepared for a frame, and there is nothing to send.
    Prepared,
    /// A frame whose head is loaded waits for its slot.
    Armed,
}

/// The most steps carried out in one call. The longest run without a transfer or a wait in between is of three steps;
/// the rest is margin. A machine that asks for more is told to wait a millisecond.
const STEPS_PER_CALL: usize = 12;

/// Executes the poller machine for one cycle after the other.
pub struct Transmitter<'a> {
    poller: Poller,
    telemetry: &'a Telemetry,
    phase: Phase,
    /// The cycle whose profile is deposited.
    tick: u32,
    /// The frame to load next; [`FRAMES`] if there is none.
    next: usize,
    /// The frame that the chip is prepared for.
    prepared: usize,
    /// The tick and frame whose head was loaded last.
    sending: (u32, usize),
    /// Transfers started so far (wraps), and how many there were at the last offer: one that is still
    /// under way a cycle later will not end by itself.
    transfers: u32,
    transfers_at_offer: u32,
    faulty: bool,
    fault: Option<Fault>,
}

impl<'a> Transmitter<'a> {
    /// A transmitter that has not spoken to its chip.
    #[must_use]
    pub fn new(config: PollerConfig, telemetry: &'a Telemetry) -> Self {
        Self {
            poller: Poller::new(config),
            telemetry,
            phase: Phase::Off,
            tick: 0,
            next: FRAMES,
            prepared: 0,
            sending: (0, FRAMES),
            transfers: 0,
            transfers_at_offer: 0,
            faulty: false,
            fault: None,
        }
    }

    /// Begins the chip's bring-up.
    pub fn start(&mut self, port: &mut impl Port) {
        if self.phase == Phase::Off {
            let step = self.poller.step(Input::Start);
            self.run(step, port);
        }
    }

    /// Offers the profile of tick `tick`. It replaces what was not sent of the one before; if the chip is
    /// not prepared, its frames are loaded as soon as it is, if that is in time for their slots.
    ///
    /// Gives false, and takes nothing, if a frame of an earlier cycle is being loaded or was fired just now (so late
    /// that this cycle's slot is lost anyway): the bytes under it must not change.
    pub fn offer(&mut self, tick: u32, profile: &Profile<RECEIVERS>, port: &mut impl Port) -> bool {
        let started = core::mem::replace(&mut self.transfers_at_offer, self.transfers);
        if matches!(self.phase, Phase::Transfer { .. }) && started == self.transfers {
            port.abort();
            self.failed(port);
        }
        let kept = match self.phase {
            Phase::Transfer { loading } => loading,
            // Without its ticket it was fired.
            Phase::Armed => !port.disarm(),
            _ => false,
        };
        if kept {
            self.next = FRAMES;
            return false;
        }
        port.deposit(profile);
        self.tick = tick;
        self.next = 0;
        match self.phase {
            Phase::Prepared => {
                let step = self.prepared();
                self.run(step, port);
            }
            // A frame of an earlier cycle that missed its slot: give it up.
            Phase::Armed => {
                let step = self.poller.step(Input::Start);
                self.run(step, port);
            }
            _ => {}
        }
        true
    }

    /// The SPI transfer is over; `response` is what a short one clocked in, empty for a load.
    pub fn done(&mut self, response: &[u8], port: &mut impl Port) {
        self.finish(Input::Done(response), port);
    }

    /// The SPI transfer could not be made.
    pub fn failed(&mut self, port: &mut impl Port) {
        self.finish(Input::Failed, port);
    }

    fn finish(&mut self, input: Input<'_>, port: &mut impl Port) {
        if matches!(self.phase, Phase::Transfer { .. }) {
            let step = self.poller.step(input);
            self.run(step, port);
        }
    }

    /// The IRQ pin has risen, or may have.
    pub fn edge(&mut self, port: &mut impl Port) {
        if self.phase == Phase::Wait && port.irq_is_high() {
            port.stop_timer();
            let step = self.poller.step(Input::Irq);
            self.run(step, port);
        }
    }

    /// The one-shot timer has run out.
    pub fn elapsed(&mut self, port: &mut impl Port) {
        let input = match self.phase {
            Phase::Wait if port.irq_is_high() => Input::Irq,
            Phase::Wait | Phase::Delay => Input::Timeout,
            _ => return,
        };
        let step = self.poller.step(input);
        self.run(step, port);
    }

    /// A slot has passed.
    pub fn slot(&mut self, slot: Slot, port: &mut impl Port) {
        self.next = self.next.max(slot.frame + 1);
        match (slot.fired, self.phase) {
            (Some(response), Phase::Armed) => {
                let step = self.poller.step(Input::Done(&[response]));
                self.run(step, port);
            }
            // Its ticket was for another slot: give the frame up and go on with the next.
            (None, Phase::Armed) if self.sending != (self.tick, self.next) => {
                port.disarm();
                let step = self.poller.step(Input::Start);
                self.run(step, port);
            }
            _ => {}
        }
    }

    /// The last fault since this was last asked, for the log.
    pub fn take_fault(&mut self) -> Option<Fault> {
        self.fault.take()
    }

    /// Has the chip prepared for the frame that is due next: of this cycle, or the first of the next one.
    fn prepare(&mut self) -> Step<PollerEvent> {
        self.prepared = if self.next < FRAMES { self.next } else { 0 };
        // A machine that refuses is told of a failure, which it reports and recovers from.
        self.poller.prepare(payload(self.prepared)).unwrap_or_else(|_| self.poller.step(Input::Failed))
    }

    /// What comes next when the chip is prepared for a frame and there is one to send.
    fn prepared(&mut self) -> Step<PollerEvent> {
        if self.prepared == self.next {
            self.sending = (self.tick, self.next);
            self.poller.step(Input::Start)
        } else {
            self.prepare()
        }
    }

    fn run(&mut self, mut step: Step<PollerEvent>, port: &mut impl Port) {
        for _ in 0..STEPS_PER_CALL {
            step = match step {
                Step::Transfer(Transfer::Short(short)) => {
                    self.phase = Phase::Transfer { loading: false };
                    self.transfers = self.transfers.wrapping_add(1);
                    port.start_short(&short);
                    return;
                }
                Step::Transfer(Transfer::Load { offset, len }) => {
                    let (_, frame) = self.sending;
                    match Place::of_frame::<RECEIVERS>(frame) {
                        Some(place) if offset + len <= place.length() => {
                            self.phase = Phase::Transfer { loading: true };
                            self.transfers = self.transfers.wrapping_add(1);
                            port.start_load(place.offset() + offset, len);
                            return;
                        }
                        _ => self.poller.step(Input::Failed),
                    }
                }
                // A poller reads no FIFO.
                Step::Transfer(Transfer::Read { .. }) => self.poller.step(Input::Failed),
                Step::Wait { .. } if port.irq_is_high() => self.poller.step(Input::Irq),
                Step::Wait { us } => {
                    self.phase = Phase::Wait;
                    port.start_timer(us);
                    return;
                }
                Step::Delay { us } => {
                    self.phase = Phase::Delay;
                    port.start_timer(us);
                    return;
                }
                Step::Event(PollerEvent::Ready) => {
                    if self.faulty {
                        self.faulty = false;
                        self.telemetry.rf_recoveries.add(1);
                    }
                    self.prepare()
                }
                Step::Event(PollerEvent::Prepared) if self.next >= FRAMES => {
                    self.phase = Phase::Prepared;
                    return;
                }
                Step::Event(PollerEvent::Prepared) => self.prepared(),
                Step::Event(PollerEvent::Loaded) if self.sending == (self.tick, self.next) => {
                    self.phase = Phase::Armed;
                    let (tick, frame) = self.sending;
                    let command = Poller::transmit().bytes().first().copied().unwrap_or(0);
                    port.arm(Ticket::new(tick, frame, command));
                    return;
                }
                // Loaded too late for its slot: give it up.
                Step::Event(PollerEvent::Loaded) => self.poller.step(Input::Start),
                Step::Event(PollerEvent::Sent) => {
                    self.telemetry.frames_sent.add(1);
                    self.poller.step(Input::Start)
                }
                Step::Event(PollerEvent::Fault(fault)) => {
                    self.telemetry.rf_faults.add(1);
                    self.telemetry.fifo_errors.set(self.poller.counters().flow);
                    self.faulty = true;
                    self.fault = Some(fault);
                    self.poller.step(Input::Start)
                }
            };
        }
        self.phase = Phase::Delay;
        port.start_timer(1_000);
    }
}
