//! The exchange: a poller sends a frame and receives at most one answer within a fixed window.
//!
//! A [`Poller`], which is a part of this machine, carries out bring-up, checks and sending.
//!
//! # States
//!
//! The names in the diagram are states ([`ExchangeState`]), which [`Exchange::state`] returns. A label at an arrow is
//! the cause of the transition: words in capitals are events that [`Exchange::step`] returns, `prepare()` is a method,
//! and names with I_ are the chip's interrupts.
//!
//! ```text
//!  ┌─► Polling: READY, prepare(), PREPARED, LOADED and FAULT as of the poller
//!  │      │ the frame is sent
//!  │      ▼
//!  │    Guarding, Opening ───── an answer has begun ──┐
//!  │      │                                           │
//!  │      ▼                    I_rxs                  ▼
//!  │    Awaiting ◄──► ReadingStatus ────────────► Receiving ◄──► ReadingStatus
//!  │                    │ I_nre, or time              │ I_rxe, or time
//!  │                    │                             ▼
//!  │                    │                           ReadingFifo
//!  │                    ▼                             │
//!  │    Closing, ResettingGain, CheckingClosed ◄──────┘
//!  │      │ ANSWER, NOANSWER
//!  │      ▼
//!  └─── Over
//! ```
//!
//! # The window
//!
//! The receiver is masked (D0) outside the window. Otherwise a signal at the antenna could disturb the FIFO while a
//! frame is loaded, since the chip empties the FIFO at each I_rxs. After the frame the machine waits until the guard
//! time, in which no listener may answer, is nearly over ([`OPENS_US`]). Then it unmasks the receiver (D1). The chip's
//! no-response timer starts at the end of the frame. It raises I_nre if no sync has come within [`WINDOW_US`] and the
//! time of preamble and sync. The driver does not depend on I_nre: its own wait ends a little later.
//!
//! An answer is read once it has ended: LEN and the payload, at most 255 bytes. Then the receiver is masked again. A
//! second answer that begins before that may have emptied the FIFO during the read. Neither answer is delivered then.
//!
//! # Bounds
//!
//! | step | bytes on SPI | time, at 8 MHz |
//! |---|---|---|
//! | from the frame's end to the open receiver | 8 + 1 | [`OPENS_US`] and the executor's |
//! | no answer: to its event | 8 + 1 + 1 + 8 | [`WINDOW_US`], 0.25 ms and the executor's |
//! | an answer of n bytes: from its end to its event | 8 + (1 + 1 + n) + 1 + 1 + 8 | 20 µs + n µs |
//! | an answer without an end: from its sync to its event | 8 + 1 + 1 + 8 | [`crate::FRAME_US`] |
//! | after the event, to [`ExchangeEvent::Ready`] | 4 + 2 + (2 to 7) | 13 µs |
//!
//! The latest event comes [`WINDOW_US`] + [`crate::FRAME_US`] + 0.6 ms after the end of the frame.
//!
//! # What goes wrong
//!
//! | trouble | event |
//! |---|---|
//! | no answer, or one before the guard time | [`NoAnswer::Silent`] |
//! | an answer after the window | [`NoAnswer::Silent`], or [`NoAnswer::Late`] if it begins while the window closes |
//! | an answer that does not end | [`NoAnswer::Dropped`] with [`Dropped::NoEnd`] |
//! | too short, too long | [`NoAnswer::Dropped`] with [`Dropped::Runt`], [`Dropped::TooLong`] |
//! | a second answer within the window | [`NoAnswer::Dropped`] with [`Dropped::Overrun`], or it is not heard |
//! | damaged | [`ExchangeEvent::Answer`] with [`FrameFlags`]; the payload has its own checks |
//! | from a foreign card | [`ExchangeEvent::Answer`]: only the payload's own checks tell it |
//! | a fault of the chip or the bus | [`ExchangeEvent::Fault`], recovered from as by a [`Poller`] |
//!
//! No frame is sent a second time. After each event the next [`Input::Start`] leads to [`ExchangeEvent::Ready`].
//!
//! ```compile_fail
//! // HORUS's poller has no receive path: there is no event with an answer.
//! fn heard(event: st25r3916::PollerEvent) -> bool {
//!     matches!(event, st25r3916::PollerEvent::Answer { .. })
//! }
//! ```
//!
//! ```compile_fail
//! // Nor can its configuration open the receiver.
//! let config = st25r3916::PollerConfig { receiver: st25r3916::ReceiverMode::On, ..st25r3916::PollerConfig::new() };
//! ```

pub use crate::bring_up::WINDOW_US;
use crate::bring_up::{IDLE_IRQS, Role};
use crate::listener::{Dropped, Frame, FrameFlags, ReadMode};
use crate::machine::{Fault, Input, Short, Step, Transfer};
use crate::poller::{Poller, PollerConfig, PollerCounters, PollerEvent, PollerState};
use crate::register as reg;
use crate::sender::{SendError, SendState};
use crate::status::{STATUS_READ, Status};
use crate::{FRAME_US, Variant, command};

/// The wait from I_txe until the receiver is unmasked, µs. By then the mask-receive timer, 189 µs, has run out. The
/// sync of the earliest answer begins later, 197 + 113 µs after the frame.
pub const OPENS_US: u32 = 190;
/// The driver's own limit for I_rxs, µs from the opening of the receiver: window, preamble and sync (152 µs), and a
/// margin in which I_nre comes.
const AWAIT_US: u32 = WINDOW_US + 152 + 50 - OPENS_US;

/// An event of an exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ExchangeEvent {
    /// The chip is configured and checked, and its field is on: [`Exchange::prepare`] is possible.
    Ready,
    /// The chip is prepared for the next frame, see [`PollerEvent::Prepared`].
    Prepared,
    /// The FIFO holds the first bytes of the frame, see [`PollerEvent::Loaded`]. The owner performs
    /// [`Exchange::transmit`], then gives [`Input::Done`].
    Loaded,
    /// An answer is in the buffer: `buffer[1..1 + len]` is its payload, as in [`crate::ListenerEvent::Frame`].
    Answer {
        /// Payload length in bytes, 1..=254.
        len: usize,
        /// The chip's flags about the answer.
        flags: FrameFlags,
    },
    /// The frame was sent, and there is no answer.
    NoAnswer(NoAnswer),
    /// The frame is lost, or the chip has failed. [`Input::Start`] begins the recovery.
    Fault(Fault),
}

/// The reason why an exchange delivers no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum NoAnswer {
    /// No answer began within the window.
    Silent,
    /// An answer began while the window was closing.
    Late,
    /// An answer began within the window, but cannot be delivered.
    Dropped(Dropped),
}

/// An exchange's state; the module's documentation has the diagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ExchangeState {
    /// The poller within the exchange is at work; [`Exchange::poller_state`] returns its state.
    Polling,
    /// The frame is sent, and the guard time runs.
    Guarding,
    /// The receiver is being unmasked.
    Opening,
    /// Waiting for an answer.
    Awaiting,
    /// Waiting for the end of an answer.
    Receiving,
    /// The status is being read.
    ReadingStatus {
        /// Whether the wait before this read timed out.
        late: bool,
    },
    /// The bytes of the answer are being read.
    ReadingFifo {
        /// The number of bytes that are read.
        count: u16,
    },
    /// The receiver is being masked.
    Closing,
    /// The receiver's gain is being reset.
    ResettingGain,
    /// The status is being read after the receiver was masked.
    CheckingClosed,
    /// The result of the exchange was reported.
    Over,
}

/// The counts of what has happened since the exchange was made; each count wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ExchangeCounters {
    /// The counts of the poller within the exchange.
    pub poller: PollerCounters,
    /// Answers that were delivered, with or without flags.
    pub answers: u32,
    /// Answers delivered with at least one of the chip's flags.
    pub flagged: u32,
    /// Windows without an answer.
    pub silent: u32,
    /// Answers that began and were not delivered, and answers that began too late.
    pub dropped: u32,
}

/// The state machine of an exchange.
#[derive(Clone, Debug)]
pub struct Exchange {
    poller: Poller,
    state: ExchangeState,
    frame: Option<Frame>,
    /// The result of the exchange, kept until the receiver is masked and the result is reported.
    result: Result<(usize, FrameFlags), NoAnswer>,
    idle_irqs: u8,
    answers: u32,
    flagged: u32,
    silent: u32,
    dropped: u32,
}

impl Exchange {
    /// Returns an exchange that has not accessed its chip yet. The first [`Input::Start`] begins bring-up.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            poller: Poller::with_role(Role::Exchange, PollerConfig::new()),
            state: ExchangeState::Polling,
            frame: None,
            result: Err(NoAnswer::Silent),
            idle_irqs: 0,
            answers: 0,
            flagged: 0,
            silent: 0,
            dropped: 0,
        }
    }

    /// The chip's type, as the last bring-up read it; `None` before that.
    #[must_use]
    pub const fn variant(&self) -> Option<Variant> {
        self.poller.variant()
    }

    /// The chip's supply voltage as the last bring-up measured it; see [`Poller::supply_mv`].
    #[must_use]
    pub const fn supply_mv(&self) -> Option<u16> {
        self.poller.supply_mv()
    }

    /// The exchange's state.
    #[must_use]
    pub const fn state(&self) -> ExchangeState {
        self.state
    }

    /// The state of the poller within the exchange. The poller is at work in [`ExchangeState::Polling`].
    #[must_use]
    pub const fn poller_state(&self) -> PollerState {
        self.poller.state()
    }

    /// The counts of what has happened since the exchange was made.
    #[must_use]
    pub const fn counters(&self) -> ExchangeCounters {
        ExchangeCounters {
            poller: self.poller.counters(),
            answers: self.answers,
            flagged: self.flagged,
            silent: self.silent,
            dropped: self.dropped,
        }
    }

    /// Whether [`Exchange::prepare`] may be called: after [`ExchangeEvent::Ready`] or [`ExchangeEvent::Prepared`].
    #[must_use]
    pub const fn is_ready(&self) -> bool {
        matches!(self.state, ExchangeState::Polling) && self.poller.is_ready()
    }

    /// Returns the transmit command, see [`Poller::transmit`].
    #[must_use]
    pub const fn transmit() -> Short {
        Poller::transmit()
    }

    /// Prepares the chip for a frame, see [`Poller::prepare`].
    ///
    /// # Errors
    /// [`SendError`] if the chip is not prepared or the length is wrong. Then the machine is unchanged.
    pub fn prepare(&mut self, len: usize) -> Result<Step<ExchangeEvent>, SendError> {
        if self.state != ExchangeState::Polling {
            return Err(SendError::NotReady);
        }
        let step = self.poller.prepare(len)?;
        Ok(self.poll(step))
    }

    /// Takes one input and returns the next step.
    pub fn step(&mut self, input: Input<'_>) -> Step<ExchangeEvent> {
        // Not covered: only this line, inputs that a state does not wait for, which the executor never gives.
        match (self.state, input) {
            (ExchangeState::Polling, input) => {
                // Not covered: a status of another length than its transfer; and an answer that begins although the end
                // of the frame was not read before, of which few runs have each order.
                if let Some(status) = self.answer_before(input) {
                    let _ = self.poller.sent(status.is_set(reg::IRQ_TXE));
                    self.idle_irqs = 0;
                    return self.status(status, false);
                }
                let step = self.poller.step(input);
                self.poll(step)
            }
            (ExchangeState::Over, _) => {
                self.state = ExchangeState::Polling;
                let step = self.poller.step(input);
                self.poll(step)
            }
            (_, Input::Failed) => self.fault(Fault::Bus),

            (ExchangeState::Guarding, Input::Timeout) => {
                self.short(ExchangeState::Opening, command::UNMASK_RECEIVE_DATA)
            }
            // Not covered: only this line, another input, as above.
            (ExchangeState::Opening, Input::Done(_)) => self.wait(),
            (ExchangeState::Awaiting | ExchangeState::Receiving, Input::Irq) => self.read_status(false),
            (ExchangeState::Awaiting | ExchangeState::Receiving, Input::Timeout) => self.read_status(true),
            (ExchangeState::ReadingStatus { late }, Input::Done(response)) => match Status::parse(response) {
                Ok(status) => self.status(status, late),
                Err(fault) => self.fault(fault),
            },
            (ExchangeState::ReadingFifo { count }, Input::Done(bytes)) => {
                // Not covered: only this line, an answer that is read without its frame: the state is entered only with
                // one.
                let result = match &mut self.frame {
                    Some(frame) => {
                        // Not covered: only this line, a read without a byte: an answer has at least one.
                        frame.was_read(count, bytes.first().copied());
                        Ok(frame.delivered())
                    }
                    None => Err(NoAnswer::Silent),
                };
                self.close(result)
            }
            (ExchangeState::Closing, Input::Done(_)) => {
                self.short(ExchangeState::ResettingGain, command::RESET_RECEIVER_GAIN)
            }
            (ExchangeState::ResettingGain, Input::Done(_)) => self.short(ExchangeState::CheckingClosed, STATUS_READ),
            // Not covered: only this line, a response of another length than its transfer, as in `Status::parse`.
            (ExchangeState::CheckingClosed, Input::Done(response)) => match Status::parse(response) {
                Ok(status) => self.closed(status),
                Err(fault) => self.fault(fault),
            },
            // Not covered: an input that a state does not wait for, as above.
            _ => self.fault(Fault::Executor),
        }
        // Not covered: only this line, the return from arms above that no run takes.
    }

    fn poll(&mut self, step: Step<PollerEvent>) -> Step<ExchangeEvent> {
        // Not covered: the events that a caller cannot have at its place, in the copies of this match that the compiler
        // has made for each of them: a fault leads to no other event.
        step.map(|event| match event {
            PollerEvent::Ready => Step::Event(ExchangeEvent::Ready),
            PollerEvent::Prepared => Step::Event(ExchangeEvent::Prepared),
            PollerEvent::Loaded => Step::Event(ExchangeEvent::Loaded),
            PollerEvent::Fault(fault) => Step::Event(ExchangeEvent::Fault(fault)),
            PollerEvent::Sent { .. } => self.sent(),
        })
    }

    /// Returns the status that the poller has read, if that status shows the begin of an answer. This happens when the
    /// executor is late: the frame has been sent, and the FIFO already holds the answer.
    fn answer_before(&self, input: Input<'_>) -> Option<Status> {
        let PollerState::Sending(SendState::ReadingIrqs { .. }) = self.poller.state() else { return None };
        let Input::Done(response) = input else { return None };
        Status::parse(response).ok().filter(|status| status.is_set(reg::IRQ_RXS | reg::IRQ_RXE))
    }

    fn begin(&mut self, status: Status) {
        // Not covered: an end without a beginning, which only a lost interrupt leaves, and errors at a beginning, since
        // no byte has come by then.
        self.frame.insert(Frame::new(ReadMode::StoreAndForward)).note(status);
    }

    /// Begins the guard time after the frame was sent.
    fn sent(&mut self) -> Step<ExchangeEvent> {
        self.idle_irqs = 0;
        self.state = ExchangeState::Guarding;
        Step::Delay { us: OPENS_US }
    }

    fn short(&mut self, state: ExchangeState, short: Short) -> Step<ExchangeEvent> {
        self.state = state;
        Step::Transfer(Transfer::Short(short))
    }

    fn read_status(&mut self, late: bool) -> Step<ExchangeEvent> {
        self.short(ExchangeState::ReadingStatus { late }, STATUS_READ)
    }

    fn wait(&mut self) -> Step<ExchangeEvent> {
        let (state, us) = match self.frame {
            None => (ExchangeState::Awaiting, AWAIT_US),
            Some(_) => (ExchangeState::Receiving, FRAME_US),
        };
        self.state = state;
        Step::Wait { us }
    }

    fn fault(&mut self, fault: Fault) -> Step<ExchangeEvent> {
        self.state = ExchangeState::Polling;
        self.frame = None;
        let step = self.poller.fault(fault);
        self.poll(step)
        // Not covered: steps of the poller other than the event of the fault: `Poller::fault` returns no other.
    }

    fn status(&mut self, status: Status, late: bool) -> Step<ExchangeEvent> {
        let (begins, ends) = (status.is_set(reg::IRQ_RXS), status.is_set(reg::IRQ_RXE));
        let another = self.frame.is_some() && begins;
        if begins || ends && self.frame.is_none() {
            self.begin(status);
        }
        let Some(frame) = &mut self.frame else {
            let over = late || status.timer & reg::IRQ_NRE != 0;
            return if over { self.close(Err(NoAnswer::Silent)) } else { self.idle() };
        };
        if another {
            return self.close(Err(NoAnswer::Dropped(Dropped::Overrun)));
        }
        frame.note(status);
        if ends {
            return match frame.ends(status) {
                Err(why) => self.close(Err(NoAnswer::Dropped(why))),
                Ok(count) => {
                    self.state = ExchangeState::ReadingFifo { count };
                    Step::Transfer(Transfer::Read { offset: 0, len: usize::from(count) })
                }
            };
        }
        if late {
            self.close(Err(NoAnswer::Dropped(Dropped::NoEnd)))
        } else if begins {
            self.idle_irqs = 0;
            self.wait()
        } else {
            self.idle()
        }
    }

    /// Waits again after an interrupt for which the status shows no cause.
    fn idle(&mut self) -> Step<ExchangeEvent> {
        self.idle_irqs += 1;
        if self.idle_irqs >= IDLE_IRQS {
            return self.fault(Fault::IrqStuck);
        }
        self.wait()
    }

    fn close(&mut self, result: Result<(usize, FrameFlags), NoAnswer>) -> Step<ExchangeEvent> {
        self.frame = None;
        self.result = result;
        self.short(ExchangeState::Closing, command::MASK_RECEIVE_DATA)
    }

    /// Reports the result of the exchange. An answer that began after the last status read may have emptied the FIFO
    /// during a read.
    fn closed(&mut self, status: Status) -> Step<ExchangeEvent> {
        self.state = ExchangeState::Over;
        let begun = status.is_set(reg::IRQ_RXS | reg::IRQ_RXE);
        let result = match self.result {
            Ok(_) if begun => Err(NoAnswer::Dropped(Dropped::Overrun)),
            Err(NoAnswer::Silent) if begun => Err(NoAnswer::Late),
            result => result,
        };
        let counter = match result {
            Ok(_) => &mut self.answers,
            Err(NoAnswer::Silent) => &mut self.silent,
            Err(_) => &mut self.dropped,
        };
        *counter = counter.wrapping_add(1);
        Step::Event(match result {
            Ok((len, flags)) => {
                self.flagged = self.flagged.wrapping_add(u32::from(!flags.is_clean()));
                ExchangeEvent::Answer { len, flags }
            }
            Err(why) => ExchangeEvent::NoAnswer(why),
        })
    }
}

impl Default for Exchange {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bring_up::NO_RESPONSE_STEPS;

    #[test]
    fn the_no_response_timer_covers_window_preamble_and_sync() {
        // 3 ms are 40 680 carrier periods. With preamble, sync (2 048) and one step of jitter, they are 669 steps of
        // 64.
        assert_eq!(NO_RESPONSE_STEPS, 669);
        let after_us = u32::from(NO_RESPONSE_STEPS) * 64 * 100 / 1_356;
        assert!(after_us < OPENS_US + AWAIT_US, "I_nre comes before the driver's own limit");
    }

    #[test]
    fn the_receiver_opens_between_mask_timer_and_earliest_sync() {
        let mask_ns = u32::from(reg::MASK_RECEIVE_GUARD) * 64 * 100_000 / 1_356;
        let sync_ns = (reg::GUARD_FC + 48 * 32) * 100_000 / 1_356;
        assert!((mask_ns..sync_ns).contains(&(OPENS_US * 1_000)), "{mask_ns} {sync_ns}");
    }
}
