//! The poller: field always on, sends NFC-F frames, never listens.

use crate::command;
use crate::machine::{Fault, Input, Short, Step};
use crate::{Supply, Variant};

/// The longest payload of one frame, in bytes: LEN = payload + 1 is one byte (md: ntx ≤ 254).
pub const MAX_PAYLOAD: usize = 254;

/// What the receiver of a poller does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Receiver {
    /// `rx_en` = 0: the receiver is off, so "writes, never listens" holds in the chip itself.
    #[default]
    Off,
    /// `rx_en` = 1 and the receive data masked (D0), should a chip prove not to raise I_txe with
    /// its receiver off.
    OnMasked,
}

/// How a poller is brought up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PollerConfig {
    /// The chip's supply voltage.
    pub supply: Supply,
    /// Receiver off, or on and masked.
    pub receiver: Receiver,
}

impl PollerConfig {
    /// 5 V supply, receiver off.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            supply: Supply::Volts5,
            receiver: Receiver::Off,
        }
    }
}

impl Default for PollerConfig {
    fn default() -> Self {
        Self::new()
    }
}

/// What a poller reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum PollerEvent {
    /// The chip is configured, checked, and its field is on: [`Poller::send`] is possible.
    /// ([`Input::Start`] checks the chip once more and comes back here.)
    Ready,
    /// The FIFO holds the frame: perform [`Poller::transmit`] at the instant wanted, then give
    /// [`Input::Done`]. ([`Input::Start`] instead gives the frame up.)
    Loaded,
    /// The chip has sent the frame (I_txe). [`Input::Start`] checks the chip and leads to
    /// [`PollerEvent::Ready`].
    Sent,
    /// The frame, or the chip, is lost; [`Input::Start`] recovers, to [`PollerEvent::Ready`] or
    /// to the next fault.
    Fault(Fault),
}

/// Why [`Poller::send`] was refused. The machine is as it was before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SendError {
    /// The last step was not [`PollerEvent::Ready`].
    NotReady,
    /// The payload is empty or longer than [`MAX_PAYLOAD`].
    Length,
}

/// The poller machine.
#[derive(Clone, Debug)]
pub struct Poller {
    config: PollerConfig,
    variant: Option<Variant>,
}

impl Poller {
    /// A poller that has not spoken to its chip yet. The first [`Input::Start`] begins bring-up.
    #[must_use]
    pub const fn new(config: PollerConfig) -> Self {
        Self {
            config,
            variant: None,
        }
    }

    /// Which part answered the last bring-up.
    #[must_use]
    pub const fn variant(&self) -> Option<Variant> {
        self.variant
    }

    /// The transfer that starts transmission (C4, one byte): the executor makes it at its own
    /// instant after [`PollerEvent::Loaded`], then gives [`Input::Done`].
    #[must_use]
    pub const fn transmit() -> Short {
        command::TRANSMIT_WITH_CRC
    }

    /// Begins a frame of `len` payload bytes: clears and loads the FIFO, up to
    /// [`PollerEvent::Loaded`]. Allowed when the last step was [`PollerEvent::Ready`].
    ///
    /// # Errors
    /// [`SendError`]; the machine is as before.
    pub fn send(&mut self, len: usize) -> Result<Step<PollerEvent>, SendError> {
        let _ = (len, self.config);
        Err(SendError::NotReady)
    }

    /// Takes one input, gives the next step.
    pub fn step(&mut self, input: Input<'_>) -> Step<PollerEvent> {
        let _ = input;
        Step::Delay { micros: 1000 }
    }
}
