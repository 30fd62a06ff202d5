//! Accounts for a run of the air: counters, frames sent and received, faults injected.

#[cfg(doc)]
use super::AirFaults;

/// Counters of what the air has carried from poller to listener. Once it has ended at the listener, a frame of the
/// poller counts in exactly one of delivered, damaged and lost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Frames the poller began.
    pub sent: u64,
    /// Frames that reached the listener whole and unchanged, at whatever time.
    pub delivered: u64,
    /// Frames that reached it changed or cut short, by the air or by the poller.
    pub damaged: u64,
    /// Frames that did not reach it.
    pub lost: u64,
    /// Bits that [`AirFaults::bit_error`] inverted.
    pub bit_errors: u64,
    /// Frames that a burst hit.
    pub bursts: u64,
    /// Frames that [`AirFaults::truncated`] cut.
    pub cut: u64,
    /// Repetitions that the listener received. They do not count as sent, delivered, damaged or lost.
    pub repeated: u64,
    /// Frames that [`AirFaults::delayed`] held back.
    pub delayed: u64,
    /// Frames whose start [`AirFaults::scatter_ns`] moved.
    pub scattered: u64,
    /// Frames that [`AirFaults::frozen`] replaced by an earlier one.
    pub frozen: u64,
    /// Times a frame began while another was on the air: both are damaged.
    pub collisions: u64,
    /// Times [`AirFaults::field_off`] took the field away.
    pub field_off: u64,
    /// Frames the listener sent: load modulation, an answer.
    pub answers: u64,
}

/// The last finished frame of the poller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LastFrame {
    /// First bit on the air, ns.
    pub start_ns: u64,
    /// End of the last bit, ns.
    pub end_ns: u64,
    /// Nominal bit rate, bit/s.
    pub bits_per_second: u32,
    /// Data bits: LEN, payload and CRC of NFC-F.
    pub data_bits: u32,
}

/// A frame as the poller sent it, regardless of its fate on the air.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SentFrame {
    /// First bit on the air, virtual ns.
    pub started_ns: u64,
    /// End of the last bit, virtual ns.
    pub ended_ns: u64,
    /// Nominal bit rate, bit/s.
    pub bits_per_second: u32,
    /// The bytes in NFC-F: LEN, payload, CRC-16; for a frame that broke off, those that were sent to their last bit.
    pub bytes: Vec<u8>,
    /// False for a frame that the poller broke off before the number of bytes in its LEN.
    pub whole: bool,
}

/// The way by which a frame reached the listener.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// Straight from the poller.
    Poller,
    /// The frame is a repetition ([`AirFaults::repeated`]).
    Repeated,
    /// The frame was delayed ([`AirFaults::delayed`]).
    Delayed,
}

/// A frame at the listener's antenna, whether or not the listener received it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Heard {
    /// First bit at the antenna, virtual ns.
    pub started_ns: u64,
    /// End of the last bit, virtual ns.
    pub ended_ns: u64,
    /// The bytes in NFC-F: LEN, payload, CRC-16, with every error of the air; for a frame that broke off, those that
    /// arrived to their last bit.
    pub bytes: Vec<u8>,
    /// Every byte of the poller's LEN arrived, correct or wrong.
    pub whole: bool,
    /// The way by which it came.
    pub origin: Origin,
}

/// A fault that was injected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fault {
    BitError,
    Burst,
    Lost,
    Cut,
    Repeated,
    Delayed,
    FieldOff,
    Scatter,
    Frozen,
}

impl Fault {
    fn name(self) -> &'static str {
        match self {
            Self::BitError => "bit error",
            Self::Burst => "burst",
            Self::Lost => "lost",
            Self::Cut => "cut",
            Self::Repeated => "repeated",
            Self::Delayed => "delayed",
            Self::FieldOff => "field off",
            Self::Scatter => "scatter",
            Self::Frozen => "frozen",
        }
    }
}

/// The outcome of a frame of the poller at the listener.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    Delivered,
    Damaged,
    Lost,
}

/// The account of a run.
#[derive(Clone, Debug, Default)]
pub(super) struct Account {
    pub(super) counters: Counters,
    pub(super) last: Option<LastFrame>,
    pub(super) sent: Vec<SentFrame>,
    pub(super) heard: Vec<Heard>,
    pub(super) injected: Vec<(u64, &'static str)>,
}

impl Account {
    pub(super) fn inject(&mut self, at: u64, fault: Fault) {
        self.injected.push((at, fault.name()));
        let counters = &mut self.counters;
        let count = match fault {
            Fault::BitError => &mut counters.bit_errors,
            Fault::Burst => &mut counters.bursts,
            // A lost frame is counted with those that are lost for other reasons.
            Fault::Lost => return,
            Fault::Cut => &mut counters.cut,
            Fault::Repeated => &mut counters.repeated,
            Fault::Delayed => &mut counters.delayed,
            Fault::FieldOff => &mut counters.field_off,
            Fault::Scatter => &mut counters.scattered,
            Fault::Frozen => &mut counters.frozen,
        };
        *count += 1;
    }

    /// A frame from `origin` has ended at the listener.
    pub(super) fn over(&mut self, origin: Origin, outcome: Outcome) {
        if origin == Origin::Repeated {
            return;
        }
        match outcome {
            Outcome::Delivered => self.counters.delivered += 1,
            Outcome::Damaged => self.counters.damaged += 1,
            Outcome::Lost => self.counters.lost += 1,
        }
    }
}
