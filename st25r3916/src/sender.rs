//! The sending of one frame, from its preparation to its last bit, as a part of a larger state machine.
//!
//! Poller and answerer send a frame in the same steps, which [`crate::poller`] describes. The state machine around
//! these steps decides when a frame is prepared, and how it recovers from a failure.

use crate::bring_up::IDLE_IRQS;
use crate::machine::{Fault, Input, Short, Transfer};
use crate::register as reg;
use crate::status::{STATUS_READ, Status};
use crate::{air_time_us, command};

/// How long after a frame's air time its end counts as missing, µs. Recordings show the first bit 3 to 5 µs after the
/// command. If I_txe never comes, this margin and the preparation of the next frame must fit between two frames.
pub const TRANSMIT_MARGIN_US: u32 = 100;
/// The number of payload bytes that are loaded into the FIFO before the transmit command. The rest is loaded after the
/// command.
pub const HEAD: usize = 16;

/// The state of a frame that is being sent; the diagram in [`crate::poller`] has the order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SendState {
    /// The FIFO is being cleared.
    PreparingClear,
    /// The frame's length is being written.
    PreparingLength,
    /// The status is being read: the FIFO level, and interrupts from before the frame, which the read clears.
    CheckingFifo,
    /// The FIFO is empty and the length is set; the payload is loaded next.
    Prepared,
    /// The first bytes of the payload are being loaded.
    LoadingHead,
    /// The transmit command is due.
    Loaded,
    /// The rest of the payload is being loaded while the frame is on air.
    LoadingRest,
    /// The frame is on air, and the machine waits for I_txe.
    OnAir,
    /// The interrupt registers are being read while the frame is on air.
    ReadingIrqs {
        /// Whether the time for the frame is over. If so, the result of this read decides whether the frame was sent.
        last: bool,
    },
}

/// The reason why a frame cannot be prepared now. The machine stays unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SendError {
    /// The machine's last step was not an event after which a new frame may be sent.
    NotReady,
    /// The payload is empty or longer than [`crate::poller::MAX_PAYLOAD`].
    Length,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sending {
    Transfer(SendState, Transfer),
    /// The machine waits for the IRQ pin, at most this many µs.
    Wait(SendState, u32),
    Prepared,
    /// The FIFO holds the first bytes of the payload, and the transmit command is due.
    Loaded,
    Sent {
        confirmed: bool,
    },
    Failed(Fault),
}

#[derive(Clone, Debug)]
pub(crate) struct Sender {
    /// Whether bytes that are left in the FIFO after the frame are a failure.
    check_left_over: bool,
    len: u8,
    idle_irqs: u8,
}

impl Sender {
    pub(crate) const fn new(check_left_over: bool) -> Self {
        Self { check_left_over, len: 0, idle_irqs: 0 }
    }

    /// Begins a frame of `len` payload bytes. `ready` says whether the machine's state permits a new frame.
    ///
    /// # Errors
    /// [`SendError`] if no frame can begin. Then nothing is changed.
    pub(crate) fn prepare(&mut self, len: usize, ready: bool) -> Result<Sending, SendError> {
        // Not covered: a length of 0 or above 254: each owner sends an object or a frame, whose lengths are constants.
        let Ok(len @ 1..=254) = u8::try_from(len) else {
            return Err(SendError::Length);
        };
        if !ready {
            return Err(SendError::NotReady);
        }
        self.len = len;
        Ok(short(SendState::PreparingClear, command::CLEAR_FIFO))
    }

    /// Takes one input in state `state`. After [`SendState::Prepared`] the machine continues with [`Sender::head`].
    #[inline(always)]
    pub(crate) fn step(&mut self, state: SendState, input: Input<'_>) -> Sending {
        // Not covered: only this line, inputs that a state does not wait for, which the executor never gives; the
        // owners serve some states themselves before they call this.
        match (state, input) {
            (SendState::PreparingClear, Input::Done(_)) => {
                let length = Short::new([command::WRITE | reg::TRANSMIT_LENGTH, self.len >> 5, self.len << 3]);
                short(SendState::PreparingLength, length)
            }
            (SendState::PreparingLength, Input::Done(_)) => short(SendState::CheckingFifo, STATUS_READ),
            // Not covered: only this line, in the copy for the second port, a status that is refused just at this check
            // before a frame.
            (SendState::CheckingFifo, Input::Done(response)) => match Status::parse(response) {
                Ok(Status { count: 0, .. }) => Sending::Prepared,
                // Not covered: bytes in the FIFO right after it was cleared, in the copy for the second port.
                Ok(Status { count, .. }) => Sending::Failed(Fault::FifoCount { expected: 0, found: count }),
                Err(fault) => Sending::Failed(fault),
            },
            (SendState::LoadingHead, Input::Done(_)) => {
                self.idle_irqs = 0;
                Sending::Loaded
            }
            // Not covered: the load of the rest, which the owner makes itself before it calls this.
            (SendState::Loaded, Input::Done(_)) => self.rest(),
            (SendState::LoadingRest, Input::Done(_)) => self.wait(),
            (SendState::Loaded | SendState::OnAir, Input::Irq) => read_irqs(false),
            // Not covered: only this line, the end of a time while a frame is loaded: no timer runs then.
            (SendState::Loaded | SendState::OnAir, Input::Timeout) => read_irqs(true),
            (SendState::ReadingIrqs { last }, Input::Done(response)) => self.irqs(response, last),
            // Not covered: an input that a state does not wait for, as above.
            _ => Sending::Failed(Fault::Executor),
        }
    }

    #[inline(always)]
    pub(crate) fn head(&self) -> Sending {
        // Not covered: a frame that is shorter than a head: each frame is longer.
        load(SendState::LoadingHead, 0, usize::from(self.len).min(HEAD))
    }

    /// Continues after the transmit command: loads the rest of the payload, if there is one.
    #[inline(always)]
    pub(crate) fn rest(&self) -> Sending {
        // Not covered: a frame without a rest: each frame is longer than a head.
        match usize::from(self.len).checked_sub(HEAD) {
            None | Some(0) => self.wait(),
            Some(rest) => load(SendState::LoadingRest, HEAD, rest),
        }
    }

    /// Waits for the end of the frame. The time of the load counts as part of the wait. An SPI of 10 MHz, the fastest,
    /// is assumed for that time.
    fn wait(&self) -> Sending {
        // Not covered: the limit at 0, for a frame without a rest: each frame is longer than a head.
        let rest = u32::from(self.len).saturating_sub(HEAD as u32);
        // Not covered: an air time without a remainder in the division to µs, which no length of these frames has.
        Sending::Wait(SendState::OnAir, air_time_us(self.len) + TRANSMIT_MARGIN_US - rest * 8 / 10)
    }

    fn irqs(&mut self, response: &[u8], last: bool) -> Sending {
        let status = match Status::parse(response) {
            Ok(status) => status,
            Err(fault) => return Sending::Failed(fault),
        };
        if status.flow_error() {
            return Sending::Failed(Fault::FifoFlow);
        }
        let confirmed = status.is_set(reg::IRQ_TXE);
        if confirmed && self.check_left_over && status.count != 0 {
            return Sending::Failed(Fault::FifoCount { expected: 0, found: status.count });
        }
        if confirmed || last && status.count == 0 {
            return Sending::Sent { confirmed };
        }
        if last {
            return Sending::Failed(Fault::NoTransmitEnd);
        }
        self.idle_irqs += 1;
        if self.idle_irqs >= IDLE_IRQS {
            return Sending::Failed(Fault::IrqStuck);
        }
        self.wait()
    }
}

/// Whether the fault lost one frame and, as far as is known, nothing else. Then the chip is stopped and cleared. It is
/// brought up again only if the next frame is lost too.
pub(crate) const fn is_light(fault: Fault) -> bool {
    matches!(fault, Fault::NoTransmitEnd | Fault::FifoFlow | Fault::FifoCount { .. })
}

const fn short(state: SendState, short: Short) -> Sending {
    Sending::Transfer(state, Transfer::Short(short))
}

const fn load(state: SendState, offset: usize, len: usize) -> Sending {
    Sending::Transfer(state, Transfer::Load { offset, len })
}

const fn read_irqs(last: bool) -> Sending {
    short(SendState::ReadingIrqs { last }, STATUS_READ)
}
