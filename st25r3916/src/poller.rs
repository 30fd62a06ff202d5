//! The poller keeps its field on, sends NFC-F frames, and never listens.
//!
//! # States
//!
//! The names in the diagram are states ([`PollerState`], [`SendState`]), which [`Poller::state`] returns. Words in
//! capitals are events; after an event the machine waits for [`Input::Start`]. `prepare()` is a method, and C4 is the
//! transmit command. A comma separates successive states.
//!
//! ```text
//!        New                                    any state
//!         │ Start                                   │ FAULT
//!         ▼                                         ▼
//!     BringingUp ◄── time ── BackingOff ◄── Start ── Faulted
//!         │ READY
//!         ▼
//!  ┌──► Ready ─────────── Start ─────────────────────────────────┐
//!  │      │ prepare()                                            │
//!  │      ▼                                                      │
//!  │    PreparingClear, PreparingLength, CheckingFifo ───────────┼─ FAULT: not empty ───┐
//!  │      │ PREPARED                                             │                      │
//!  │      ▼                                                      │                      │
//!  │    Prepared ── prepare(): another length                    │                      │
//!  │      │ Start                                                │                      │
//!  │      ▼                                                      │                      │
//!  │    LoadingHead                                              │                      │
//!  │      │ LOADED                                               │                      │
//!  │      ▼                                                      │                      │
//!  │    Loaded ────────── Start: the frame is given up ──────────┤                      │
//!  │      │ Done: C4 was sent                                    │                      │
//!  │      ▼                                                      │                      │
//!  │    LoadingRest                                              │                      │
//!  │      │                                                      │                      │
//!  │      ▼                                                      │                      │
//!  │    OnAir ◄──► ReadingIrqs ─── FAULT: underflow, bytes left ─┼──────────────────────┤
//!  │                 │ I_txe, or its time is over: SENT          │                      ▼
//!  │                 ▼                                           │                  FrameLost
//!  │               Sent ─ Start ─────────────────────────────────┤                      │ Start
//!  │                                                             ▼                      ▼
//!  └── READY ── CheckingSetting ◄── CheckingField ◄── CheckingConfiguration ◄── Clearing ◄── Stopping
//! ```
//!
//! A second lost frame in a row leads to Faulted instead of FrameLost.
//!
//! # A frame
//!
//! [`Poller::prepare`] clears the FIFO, sets the length, and reads the status, so that no earlier interrupt is taken
//! for one of this frame. The payload need not be known yet. The next [`Input::Start`] loads the first [`HEAD`] bytes
//! of the payload. After [`PollerEvent::Loaded`] only one byte on the bus is left, [`Poller::transmit`], which the
//! executor sends at an instant of its choice (a timer's compare event may start it). The rest is loaded directly
//! afterwards, while the chip sends preamble and sync. Then the machine waits for I_txe, at most the frame's air time
//! and [`TRANSMIT_MARGIN_US`], and returns [`PollerEvent::Sent`]. The next [`Input::Start`] checks the chip
//! (configuration in place, oscillator and transmitter on, and one of the settings of bring-up, in turn) and leads to
//! [`PollerEvent::Ready`]. The field stays on from bring-up on.
//!
//! The data sheet implies that the chip raises I_txe while its receiver is off, but no public driver sends with the
//! receiver off. So the driver does not depend on I_txe: if I_txe has not come in time and the FIFO is empty, the chip
//! has sent the frame, and [`PollerEvent::Sent`] reports it as unconfirmed.
//!
//! The FIFO cannot run dry if the executor begins to load the frame's remaining bytes within [`rest_within_us`] of the
//! transmit command. If the chip reports an empty FIFO all the same, the frame is lost ([`Fault::FifoFlow`]), and the
//! next frame is sent. The number of loaded bytes is not checked before the frame is sent: with a byte too few the FIFO
//! runs dry, and a byte too many is left over ([`Fault::FifoCount`]).
//!
//! # Recovery
//!
//! | fault | first | again, with no frame sent in between |
//! |---|---|---|
//! | [`Fault::NoTransmitEnd`], [`Fault::FifoFlow`], [`Fault::FifoCount`] | stop, clear, check | bring-up |
//! | all others | bring-up after a back-off of 1 ms, doubled each time up to 64 ms | the same |
//!
//! A register that loses a bit while the chip runs is [`Fault::Register`] within 15 frames, when it is read back.
//!
//! A bring-up takes the chip about 6 ms (ST25R3916) or up to 11 ms (ST25R3916B, whose RC calibration takes up to 5 ms)
//! and drops the field meanwhile. Therefore a single lost frame does not cause a bring-up.

use crate::bring_up::{BringUp, CONFIGURATION_READ, DISPLAY_READ, Progress, ReceiverMode, Role};
use crate::machine::{Fault, Input, Short, Step, Transfer};
use crate::register as reg;
pub use crate::sender::{HEAD, SendError, SendState, TRANSMIT_MARGIN_US};
use crate::sender::{Sender, Sending, is_light};
use crate::{Variant, command};

/// The longest payload of one frame, bytes: LEN, which counts itself as well, is one byte.
pub const MAX_PAYLOAD: usize = 254;

/// The load of the rest of the payload must begin within this time after the transmit command, µs, on an SPI of
/// `spi_hz`. Otherwise the FIFO may run dry. `None` if the SPI is not faster than the air, 53 kB/s.
///
/// The chip takes byte `n` of the payload (from 0) after `64 + 8 · (n + 1)` bits of 32 / 13.56 MHz: preamble, sync, LEN
/// and `n` bytes. The SPI has loaded byte `n` after `n - HEAD + 2` bytes, the first of them the FIFO load command.
/// Since the SPI is faster than the air, all bytes are in time if the first byte of the rest is.
#[must_use]
pub const fn rest_within_us(spi_hz: u32) -> Option<u32> {
    const AIR_BITS: u64 = 64 + 8 * (HEAD as u64 + 1);
    // A byte takes 256 carrier periods on the air and 8 clocks on the SPI.
    if spi_hz as u64 * 256 <= 8 * 13_560_000 {
        return None;
    }
    let needed_us = AIR_BITS * 32 * 100 / 1_356;
    let brought_us = (2 * 8 * 1_000_000_u64).div_ceil(spi_hz as u64);
    Some((needed_us - brought_us) as u32)
}

/// The configuration of a poller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PollerConfig {
    /// The state of the receiver: off, or on and masked.
    pub receiver: ReceiverMode,
    /// Whether the poller fails with [`Fault::FifoCount`] if bytes are left in the FIFO after a frame.
    pub check_left_over: bool,
    /// Whether the poller fails with [`Fault::FieldDropped`] if oscillator or transmitter is off between frames.
    pub check_field: bool,
}

impl PollerConfig {
    /// The default has the receiver off and all checks on.
    #[must_use]
    pub const fn new() -> Self {
        Self { receiver: ReceiverMode::Off, check_left_over: true, check_field: true }
    }
}

impl Default for PollerConfig {
    fn default() -> Self {
        Self::new()
    }
}

/// An event of a poller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum PollerEvent {
    /// The chip is configured and checked, and its field is on: [`Poller::prepare`] is possible. [`Input::Start`]
    /// checks the chip once more.
    Ready,
    /// The FIFO is empty and the length is set. [`Input::Start`] loads the first bytes of the payload, which must be
    /// ready by then; [`Poller::prepare`] prepares a frame of another length instead.
    Prepared,
    /// The FIFO holds the first bytes of the frame. The owner performs [`Poller::transmit`] at its chosen instant, then
    /// gives [`Input::Done`]. [`Input::Start`] gives the frame up instead.
    Loaded,
    /// The chip has sent the frame. [`Input::Start`] makes the poller check the chip, which leads to
    /// [`PollerEvent::Ready`].
    Sent {
        /// Whether the interrupt I_txe confirmed the end of the frame. If not, the frame's time is over and the FIFO is
        /// empty.
        confirmed: bool,
    },
    /// The frame is lost, or the chip has failed. [`Input::Start`] begins the recovery, which leads to
    /// [`PollerEvent::Ready`] or to the next fault.
    Fault(Fault),
}

/// A poller's state; the module's documentation has the diagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum PollerState {
    /// The chip needs its first bring-up, which the next step begins.
    New,
    /// A fault was reported, and the chip needs a bring-up.
    Faulted,
    /// A lost frame was reported as a fault, and the chip needs to be stopped and checked.
    FrameLost,
    /// The poller waits before the next bring-up.
    BackingOff,
    /// The chip is being brought up.
    BringingUp,
    /// The stop command is under way after a lost frame.
    Stopping,
    /// The FIFO is being cleared after a lost frame.
    Clearing,
    /// Operation control, mode and bit rate are being read between two frames.
    CheckingConfiguration,
    /// The auxiliary display is being read between two frames.
    CheckingField,
    /// One of the settings of bring-up is being read back between two frames.
    CheckingSetting,
    /// The chip is configured and checked, so that [`Poller::prepare`] is possible.
    Ready,
    /// A frame is being prepared or loaded, or is on air.
    Sending(SendState),
    /// The frame was sent, and the owner has got the event about it.
    Sent,
}

/// The counts of what has happened since the poller was made; each count wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PollerCounters {
    /// Frames sent.
    pub sent: u32,
    /// Frames of which the interrupt I_txe did not confirm the end.
    pub unconfirmed: u32,
    /// Faults reported.
    pub faults: u32,
    /// Bring-ups that succeeded.
    pub bring_ups: u32,
    /// Frames during which the FIFO ran dry or over.
    pub flow: u32,
}

/// The state machine of a poller.
#[derive(Clone, Debug)]
pub struct Poller {
    config: PollerConfig,
    bring_up: BringUp,
    state: PollerState,
    sender: Sender,
    /// Whether the last frame was lost, and the chip has not been brought up since.
    lost: bool,
    counters: PollerCounters,
}

impl Poller {
    /// Returns a poller that has not accessed its chip yet. The first [`Input::Start`] begins bring-up.
    #[must_use]
    pub const fn new(config: PollerConfig) -> Self {
        Self::with_role(Role::Poller(config.receiver), config)
    }

    pub(crate) const fn with_role(role: Role, config: PollerConfig) -> Self {
        Self {
            config,
            bring_up: BringUp::new(role),
            state: PollerState::New,
            sender: Sender::new(config.check_left_over),
            lost: false,
            counters: PollerCounters { sent: 0, unconfirmed: 0, faults: 0, bring_ups: 0, flow: 0 },
        }
    }

    /// The chip's type, as the last bring-up read it; `None` before that.
    #[must_use]
    pub const fn variant(&self) -> Option<Variant> {
        self.bring_up.variant()
    }

    /// The chip's supply voltage (VDD) as the last bring-up measured it, mV, in steps of 23.4 mV, within
    /// [`crate::SUPPLY_MIN_MV`]..=[`crate::SUPPLY_MAX_MV`].
    #[must_use]
    pub const fn supply_mv(&self) -> Option<u16> {
        self.bring_up.supply_mv()
    }

    /// The poller's state.
    #[must_use]
    pub const fn state(&self) -> PollerState {
        self.state
    }

    /// The counts of what has happened since the poller was made.
    #[must_use]
    pub const fn counters(&self) -> PollerCounters {
        self.counters
    }

    /// Whether [`Poller::prepare`] may be called: after [`PollerEvent::Ready`] or [`PollerEvent::Prepared`].
    #[must_use]
    pub const fn is_ready(&self) -> bool {
        matches!(self.state, PollerState::Ready | PollerState::Sending(SendState::Prepared))
    }

    /// The transfer that starts the transmission: one byte, the command C4. The owner makes it after
    /// [`PollerEvent::Loaded`], at an instant that it chooses, and then gives [`Input::Done`].
    #[must_use]
    pub const fn transmit() -> Short {
        command::TRANSMIT_WITH_CRC
    }

    /// Prepares a frame of `len` payload bytes, 1..=254, up to [`PollerEvent::Prepared`]. Allowed when the last step
    /// was [`PollerEvent::Ready`] or [`PollerEvent::Prepared`].
    ///
    /// # Errors
    /// [`SendError`] if no frame can be prepared now. Then the machine is unchanged.
    pub fn prepare(&mut self, len: usize) -> Result<Step<PollerEvent>, SendError> {
        let begun = self.sender.prepare(len, self.is_ready())?;
        Ok(self.sending(begun))
    }

    /// Takes one input and returns the next step.
    pub fn step(&mut self, input: Input<'_>) -> Step<PollerEvent> {
        // Not covered: only this line, a transfer that has failed: none does on the bench.
        if matches!(input, Input::Failed) {
            return self.fault(Fault::Bus);
        }
        // The loads of the frame's head and rest come first, because the owner makes them at exact instants.
        let at_once = match (self.state, input) {
            (PollerState::Sending(SendState::Prepared), _) => Some(self.sender.head()),
            (PollerState::Sending(SendState::Loaded), Input::Done(_)) => Some(self.sender.rest()),
            _ => None,
        };
        if let Some(sending) = at_once {
            // Not covered: the ends and events that the load of a head or a rest, which is a transfer or a wait, never
            // leads to.
            return self.sending(sending);
        }
        // Not covered: only this line, inputs that a state does not wait for, which the executor never gives.
        match (self.state, input) {
            (PollerState::New, _) => self.begin_bring_up(),
            (PollerState::FrameLost, _) => self.short(PollerState::Stopping, command::STOP),
            (PollerState::Ready | PollerState::Sent, _) | (PollerState::Sending(SendState::Loaded), Input::Start) => {
                self.short(PollerState::CheckingConfiguration, CONFIGURATION_READ)
            }
            (PollerState::Sending(state), input) => {
                let sending = self.sender.step(state, input);
                // Not covered: the results that an arm of `Sender::step` does not have, in the copy of `sending` behind
                // each of them.
                self.sending(sending)
            }

            (PollerState::BackingOff, Input::Timeout) => self.begin_bring_up(),
            (PollerState::Faulted | PollerState::BackingOff, _) => {
                self.state = PollerState::BackingOff;
                Step::Delay { us: self.bring_up.back_off_us() }
            }
            (PollerState::BringingUp, input) => {
                // Not covered: an event at a bring-up's inputs that the executor never gives, as in `BringUp::step`.
                let progress = self.bring_up.step(input);
                self.progress(progress)
            }

            (PollerState::Stopping, Input::Done(_)) => self.short(PollerState::Clearing, command::CLEAR_FIFO),
            (PollerState::Clearing, Input::Done(_)) => {
                self.short(PollerState::CheckingConfiguration, CONFIGURATION_READ)
            }
            (PollerState::CheckingConfiguration, Input::Done(response)) => {
                // Not covered: a response of another length than its transfer, as in `Status::parse`, and a register
                // that has lost the bit for the oscillator.
                match self.bring_up.role().check_configuration(response) {
                    Ok(()) if self.config.check_field => self.short(PollerState::CheckingField, DISPLAY_READ),
                    Ok(()) => self.check_setting(),
                    Err(fault) => self.fault(fault),
                }
            }
            // Not covered: only this line, another input, as above.
            (PollerState::CheckingField, Input::Done(response)) => {
                const ON: u8 = reg::DISPLAY_OSC_OK | reg::DISPLAY_TX_ON;
                match response {
                    // Not covered: only this line, a display of another length, as above.
                    [_, display] if display & ON == ON => self.check_setting(),
                    _ => self.fault(Fault::FieldDropped),
                }
            }
            // Not covered: only this line, a response of another length, as above.
            (PollerState::CheckingSetting, Input::Done(response)) => match self.bring_up.check_next(response) {
                Ok(()) => self.ready(),
                Err(fault) => self.fault(fault),
            },

            // Not covered: an input that a state does not wait for, as above.
            _ => self.fault(Fault::Executor),
        }
        // Not covered: only this line, the return from arms above that no run takes.
    }

    fn short(&mut self, state: PollerState, short: Short) -> Step<PollerEvent> {
        self.state = state;
        Step::Transfer(Transfer::Short(short))
    }

    fn begin_bring_up(&mut self) -> Step<PollerEvent> {
        self.state = PollerState::BringingUp;
        let progress = self.bring_up.begin();
        self.progress(progress)
    }

    fn progress(&mut self, progress: Progress) -> Step<PollerEvent> {
        // Not covered: the ends of a bring-up at its beginning, in the copy for `begin_bring_up`: it begins with a
        // transfer.
        match progress {
            Progress::Transfer(short) => Step::Transfer(Transfer::Short(short)),
            Progress::Wait(us) => Step::Wait { us },
            Progress::Failed(fault) => self.fault(fault),
            Progress::Finished => {
                self.counters.bring_ups = self.counters.bring_ups.wrapping_add(1);
                self.ready()
            }
        }
    }

    fn check_setting(&mut self) -> Step<PollerEvent> {
        self.short(PollerState::CheckingSetting, self.bring_up.read_next())
    }

    fn ready(&mut self) -> Step<PollerEvent> {
        self.state = PollerState::Ready;
        Step::Event(PollerEvent::Ready)
    }

    #[cold]
    #[inline(never)]
    pub(crate) fn fault(&mut self, fault: Fault) -> Step<PollerEvent> {
        self.state = if is_light(fault) && !self.lost {
            self.lost = true;
            PollerState::FrameLost
        } else {
            self.lost = false;
            self.bring_up.failed();
            PollerState::Faulted
        };
        self.counters.faults = self.counters.faults.wrapping_add(1);
        Step::Event(PollerEvent::Fault(fault))
    }

    #[inline(always)]
    fn sending(&mut self, sending: Sending) -> Step<PollerEvent> {
        let (state, step) = match sending {
            Sending::Transfer(state, transfer) => (state, Step::Transfer(transfer)),
            Sending::Wait(state, us) => (state, Step::Wait { us }),
            Sending::Prepared => (SendState::Prepared, Step::Event(PollerEvent::Prepared)),
            Sending::Loaded => (SendState::Loaded, Step::Event(PollerEvent::Loaded)),
            Sending::Sent { confirmed } => return self.sent(confirmed),
            Sending::Failed(fault) => {
                self.counters.flow = self.counters.flow.wrapping_add(u32::from(fault == Fault::FifoFlow));
                return self.fault(fault);
            }
        };
        self.state = PollerState::Sending(state);
        step
    }

    pub(crate) fn sent(&mut self, confirmed: bool) -> Step<PollerEvent> {
        self.state = PollerState::Sent;
        self.lost = false;
        self.bring_up.works();
        self.counters.sent = self.counters.sent.wrapping_add(1);
        self.counters.unconfirmed = self.counters.unconfirmed.wrapping_add(u32::from(!confirmed));
        Step::Event(PollerEvent::Sent { confirmed })
    }
}
