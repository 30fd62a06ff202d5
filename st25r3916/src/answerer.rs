//! The answerer: a listener that answers a frame from a buffer, at an instant of its owner's choice.
//!
//! A [`Listener`] within this machine receives the frames. An answer is sent like a poller's frame, but by load
//! modulation of the poller's field.
//!
//! # States
//!
//! The names in the diagram are states ([`AnswererState`]), which [`Answerer::state`] returns. A label at an arrow is
//! the cause of the transition: words in capitals are events that [`Answerer::step`] returns, `Start` and `Done` are
//! inputs, and `answer()` is a method. C4 is the transmit command.
//!
//! ```text
//!  ┌─► Listening: LISTENING, DROPPED, FIELDON, FIELDOFF and FAULT as of the listener
//!  │      │ FRAME
//!  │      ▼
//!  ├─── Delivered ── Start: no answer ──────────────────────────┐
//!  │      │ answer()                                            │
//!  │      ▼                                                     │
//!  │    Sending(PreparingClear .. LoadingHead) ── UNANSWERED ───┤
//!  │      │ LOADED                                              │
//!  │      ▼                                                     │
//!  │    Sending(Loaded) ── Start: the answer is given up ───────┤
//!  │      │ Done: C4 was sent                                   │
//!  │      ▼                                                     │
//!  │    Sending(LoadingRest .. ReadingIrqs) ── FAULT ──► Lost   │
//!  │      │ ANSWERED                              Stopping      │
//!  │      ▼                                          │          │
//!  │    Over ────────────────────────────────────────┴──────────┤
//!  └──────────────────── the listener is re-armed ◄─────────────┘
//! ```
//!
//! # An answer
//!
//! After [`AnswererEvent::Frame`] the owner calls [`Answerer::answer`], with the answer ready in its buffer. The
//! machine clears the FIFO, sets the length, checks that neither the field has gone nor another frame has begun, and
//! loads the first bytes of the answer. After [`AnswererEvent::Loaded`] the owner performs [`Answerer::transmit`] at an
//! instant that it chooses, and then gives [`Input::Done`]. A timer may start this transfer of one byte, so that the
//! instant does not depend on the data. The instant counts from the end of the frame (the edge of I_rxe, 5 µs after the
//! last bit). It must be at least [`EARLIEST_US`], and early enough for the exchange on the other side, which waits for
//! [`crate::exchange::WINDOW_US`].
//!
//! # Bounds
//!
//! | step | bytes on SPI | time, at 8 MHz |
//! |---|---|---|
//! | from [`Answerer::answer`] to [`AnswererEvent::Loaded`] | 1 + 3 + 8 + (1 + 16) | 29 µs |
//! | after the command | 1 + rest | rest of the load |
//! | from the answer's end to [`AnswererEvent::Answered`] | 8 | 8 µs, or 0.1 ms without I_txe |
//! | re-arm | 8 + 1 + 1 + (2 to 7) | 17 µs |
//!
//! # What goes wrong
//!
//! | trouble | reaction |
//! |---|---|
//! | the field goes before the answer is loaded | [`Unanswered::FieldLost`], re-arm |
//! | another frame begins before that | [`Unanswered::Overtaken`]; it is received |
//! | the owner misses its instant | it gives [`Input::Start`] instead; re-arm |
//! | the transmitter takes nothing, or runs dry | [`AnswererEvent::Fault`]; stop, re-arm; again in a row: bring-up |
//! | all others | as a [`Listener`] |
//!
//! No answer is repeated, and no frame is answered twice.
//!
//! ```compile_fail
//! // HORUS's listener has no transmit path.
//! let mut listener = st25r3916::Listener::new(st25r3916::ListenerConfig::new());
//! let _ = listener.answer(4);
//! ```
//!
//! ```compile_fail
//! let _ = st25r3916::Listener::transmit();
//! ```

use crate::bring_up::Role;
use crate::listener::{Dropped, FrameFlags, Listener, ListenerConfig, ListenerCounters, ListenerEvent, ListenerState};
use crate::machine::{Fault, Input, Short, Step, Transfer};
use crate::poller::Poller;
use crate::register as reg;
use crate::sender::{SendError, SendState, Sender, Sending, is_light};
use crate::status::Status;
use crate::{Variant, command};

/// The earliest first bit of an answer, µs after the end of the frame: 2672/fc, rounded up.
pub const EARLIEST_US: u32 = (reg::GUARD_FC * 100).div_ceil(1_356);

/// An answerer's event. On any event the caller may exchange the frame buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum AnswererEvent {
    /// The chip listens, see [`ListenerEvent::Listening`].
    Listening,
    /// A frame was received, see [`ListenerEvent::Frame`]. The owner may call [`Answerer::answer`]; [`Input::Start`]
    /// listens again without an answer.
    Frame {
        /// Payload length in bytes, 1..=254.
        len: usize,
        /// The chip's flags about the frame.
        flags: FrameFlags,
    },
    /// The FIFO holds the first bytes of the answer. The owner performs [`Answerer::transmit`] at its chosen instant,
    /// then gives [`Input::Done`]. [`Input::Start`] gives the answer up instead.
    Loaded,
    /// The chip has sent the answer. [`Input::Start`] listens again.
    Answered {
        /// Whether the interrupt I_txe confirmed the end of the answer. If not, the answer's time is over and the FIFO
        /// is empty.
        confirmed: bool,
    },
    /// The answer was given up before its transmit command. [`Input::Start`] listens again.
    Unanswered(Unanswered),
    /// A frame was dropped, see [`ListenerEvent::Dropped`].
    Dropped(Dropped),
    /// A field has come on, see [`ListenerEvent::FieldOn`].
    FieldOn,
    /// The field has gone, see [`ListenerEvent::FieldOff`].
    FieldOff,
    /// The answer is lost, or the chip has failed. [`Input::Start`] begins the recovery.
    Fault(Fault),
}

/// The reason why an answerer gives up an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Unanswered {
    /// The poller's field went off before the answer.
    FieldLost,
    /// Another frame began before the answer.
    Overtaken,
}

/// An answerer's state; the module's documentation has the diagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum AnswererState {
    /// The listener within the answerer is at work; [`Answerer::listener_state`] returns its state.
    Listening,
    /// A frame was delivered, so that [`Answerer::answer`] may be called.
    Delivered,
    /// An answer is being prepared or loaded, or is on air.
    Sending(SendState),
    /// The answer was sent or given up, and the owner has got the event about it.
    Over,
    /// The answer was lost and reported as a fault; the chip needs to be stopped.
    Lost,
    /// The stop command is under way.
    Stopping,
}

/// The counts of what has happened since the answerer was made; each count wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AnswererCounters {
    /// The counts of the listener within the answerer.
    pub listener: ListenerCounters,
    /// Answers sent.
    pub answered: u32,
    /// Answers of which the interrupt I_txe did not confirm the end.
    pub unconfirmed: u32,
    /// Frames without an answer, because the answer was given up or lost.
    pub unanswered: u32,
}

/// The state machine of an answerer.
#[derive(Clone, Debug)]
pub struct Answerer {
    listener: Listener,
    sender: Sender,
    state: AnswererState,
    lost: bool,
    answered: u32,
    unconfirmed: u32,
    unanswered: u32,
}

impl Answerer {
    /// Returns an answerer that has not accessed its chip yet. The first [`Input::Start`] begins bring-up.
    #[must_use]
    pub const fn new(config: ListenerConfig) -> Self {
        Self {
            listener: Listener::with_role(Role::Answerer, config),
            sender: Sender::new(true),
            state: AnswererState::Listening,
            lost: false,
            answered: 0,
            unconfirmed: 0,
            unanswered: 0,
        }
    }

    /// The chip's type, as the last bring-up read it; `None` before that.
    #[must_use]
    pub const fn variant(&self) -> Option<Variant> {
        self.listener.variant()
    }

    /// The chip's supply voltage as the last bring-up measured it; see [`Listener::supply_mv`].
    #[must_use]
    pub const fn supply_mv(&self) -> Option<u16> {
        self.listener.supply_mv()
    }

    /// The answerer's state.
    #[must_use]
    pub const fn state(&self) -> AnswererState {
        self.state
    }

    /// The state of the listener within the answerer. The listener is at work in [`AnswererState::Listening`].
    #[must_use]
    pub const fn listener_state(&self) -> ListenerState {
        self.listener.state()
    }

    /// The counts of what has happened since the answerer was made.
    #[must_use]
    pub const fn counters(&self) -> AnswererCounters {
        AnswererCounters {
            listener: self.listener.counters(),
            answered: self.answered,
            unconfirmed: self.unconfirmed,
            unanswered: self.unanswered,
        }
    }

    /// The transfer that starts the answer: one byte, the command C4. The owner makes it after
    /// [`AnswererEvent::Loaded`], at an instant that it chooses, and then gives [`Input::Done`].
    #[must_use]
    pub const fn transmit() -> Short {
        Poller::transmit()
    }

    /// Begins an answer of `len` payload bytes, 1..=254, which must be in the caller's buffer already. Allowed when the
    /// last step was [`AnswererEvent::Frame`].
    ///
    /// # Errors
    /// [`SendError`] if the machine cannot answer now. Then it is unchanged.
    pub fn answer(&mut self, len: usize) -> Result<Step<AnswererEvent>, SendError> {
        let begun = self.sender.prepare(len, self.state == AnswererState::Delivered)?;
        Ok(self.sending(begun))
    }

    /// Takes one input and returns the next step.
    pub fn step(&mut self, input: Input<'_>) -> Step<AnswererEvent> {
        match (self.state, input) {
            (AnswererState::Listening | AnswererState::Delivered | AnswererState::Over, input) => self.listen(input),
            // Not covered: a transfer that has failed: none does on the bench.
            (_, Input::Failed) => self.fault(Fault::Bus),
            (AnswererState::Sending(SendState::Loaded), Input::Start) => self.listen(input),
            (AnswererState::Sending(state), input) => {
                if let Input::Done(response) = input
                    && let Some(step) = self.overtaken(state, response)
                {
                    return step;
                }
                let sending = self.sender.step(state, input);
                self.sending(sending)
            }
            (AnswererState::Lost, _) => {
                self.state = AnswererState::Stopping;
                Step::Transfer(Transfer::Short(command::STOP))
            }
            (AnswererState::Stopping, Input::Done(_)) => self.listen(Input::Start),
            // Not covered: an input that the state does not wait for, which the executor never gives.
            (AnswererState::Stopping, _) => self.fault(Fault::Executor),
        }
    }

    fn listen(&mut self, input: Input<'_>) -> Step<AnswererEvent> {
        let step = self.listener.step(input);
        self.state = AnswererState::Listening;
        // Not covered: the events that a caller cannot have at its place, in the copies of this match that the compiler
        // has made for each of them.
        step.map(|event| {
            Step::Event(match event {
                ListenerEvent::Listening => AnswererEvent::Listening,
                ListenerEvent::Frame { len, flags } => {
                    self.state = AnswererState::Delivered;
                    AnswererEvent::Frame { len, flags }
                }
                ListenerEvent::Dropped(why) => AnswererEvent::Dropped(why),
                ListenerEvent::FieldOn => AnswererEvent::FieldOn,
                ListenerEvent::FieldOff => AnswererEvent::FieldOff,
                ListenerEvent::Fault(fault) => AnswererEvent::Fault(fault),
            })
        })
    }

    /// Evaluates a status that was read while an answer is sent. Returns the next step if the loss of the field or
    /// another frame ends the answer.
    fn overtaken(&mut self, state: SendState, response: &[u8]) -> Option<Step<AnswererEvent>> {
        let loads = match state {
            SendState::CheckingFifo => true,
            SendState::ReadingIrqs { .. } => false,
            _ => return None,
        };
        let status = Status::parse(response).ok()?;
        let overtaken = self.listener.overtaken(status);
        let why = match (loads, overtaken) {
            (true, true) => Unanswered::Overtaken,
            (true, false) if status.timer & reg::IRQ_EOF != 0 => Unanswered::FieldLost,
            // The chip receives no frame before it has sent its answer. So the answer was sent, and the bytes in the
            // FIFO are those of the next frame.
            (false, true) => return Some(self.sending(Sending::Sent { confirmed: status.is_set(reg::IRQ_TXE) })),
            (_, false) => return None,
        };
        self.state = AnswererState::Over;
        self.unanswered = self.unanswered.wrapping_add(1);
        Some(Step::Event(AnswererEvent::Unanswered(why)))
    }

    fn sending(&mut self, sending: Sending) -> Step<AnswererEvent> {
        let (state, step) = match sending {
            Sending::Transfer(state, transfer) => (AnswererState::Sending(state), Step::Transfer(transfer)),
            Sending::Wait(state, us) => (AnswererState::Sending(state), Step::Wait { us }),
            Sending::Prepared => {
                let sending = self.sender.head();
                return self.sending(sending);
            }
            Sending::Loaded => (AnswererState::Sending(SendState::Loaded), Step::Event(AnswererEvent::Loaded)),
            Sending::Sent { confirmed } => {
                self.lost = false;
                self.answered = self.answered.wrapping_add(1);
                self.unconfirmed = self.unconfirmed.wrapping_add(u32::from(!confirmed));
                (AnswererState::Over, Step::Event(AnswererEvent::Answered { confirmed }))
            }
            Sending::Failed(fault) => return self.fault(fault),
        };
        self.state = state;
        step
    }

    /// Reports a lost answer. The chip is brought up again if the fault is severe, or if the previous answer was lost
    /// too.
    fn fault(&mut self, fault: Fault) -> Step<AnswererEvent> {
        self.unanswered = self.unanswered.wrapping_add(1);
        if is_light(fault) && !self.lost {
            (self.lost, self.state) = (true, AnswererState::Lost);
            return Step::Event(AnswererEvent::Fault(fault));
        }
        (self.lost, self.state) = (false, AnswererState::Listening);
        let _ = self.listener.fault(fault);
        Step::Event(AnswererEvent::Fault(fault))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_keeps_the_guard_time_of_nfc_f() {
        assert_eq!(EARLIEST_US, 198);
    }
}
