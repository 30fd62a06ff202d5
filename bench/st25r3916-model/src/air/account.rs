//! Counts what the air has carried.

#[cfg(doc)]
use super::AirFaults;

/// Counters of the frames from poller to listener. Each frame of the poller that has ended at the listener is counted
/// in exactly one of `delivered`, `damaged` and `lost`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Frames that the poller began to send.
    pub sent: u64,
    /// Frames that reached the listener whole and unchanged, even if late.
    pub delivered: u64,
    /// Frames that reached the listener changed or cut short, by the air or by the poller.
    pub damaged: u64,
    /// Frames of the poller that did not reach the listener.
    pub lost: u64,
    /// Bits that [`AirFaults::bit_error`] inverted.
    pub bit_errors: u64,
    /// Frames that were hit by a burst of bit errors ([`AirFaults::burst`]).
    pub bursts: u64,
    /// Frames that [`AirFaults::truncated`] cut.
    pub cut: u64,
    /// Repeated frames ([`AirFaults::repeated`]) that reached the listener. No other counter includes them.
    pub repeated: u64,
    /// Frames that [`AirFaults::delayed`] delayed.
    pub delayed: u64,
    /// Frames whose start [`AirFaults::scatter_ns`] moved.
    pub scattered: u64,
    /// Frames that [`AirFaults::frozen`] replaced by an earlier one.
    pub frozen: u64,
    /// The number of frames that began during another frame. Both are lost or broken off.
    pub collisions: u64,
    /// The number of times that [`AirFaults::field_off`] switched the field off.
    pub field_off: u64,
    /// Answers that the listener sent by load modulation.
    pub answers: u64,
}

/// The poller's last complete or broken frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LastFrame {
    /// The instant of the frame's first bit, ns.
    pub start_ns: u64,
    /// The instant at which the frame's last bit ended, ns.
    pub end_ns: u64,
    /// The frame's nominal bit rate, bit/s.
    pub bits_per_second: u32,
    /// The number of data bits: in NFC-F those of LEN, payload and CRC.
    pub data_bits: u32,
}

/// A frame as the poller sent it, without the effects of the air.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SentFrame {
    /// The instant of the frame's first bit, virtual ns.
    pub started_ns: u64,
    /// The instant at which the frame's last bit ended, virtual ns.
    pub ended_ns: u64,
    /// The frame's nominal bit rate, bit/s.
    pub bits_per_second: u32,
    /// The frame's bytes, in NFC-F LEN, payload and CRC-16, as far as they were sent completely.
    pub bytes: Vec<u8>,
    /// Whether the frame was sent whole. It is false if the poller sent fewer bytes than LEN announces.
    pub whole: bool,
}

/// The way by which a frame reached the listener.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// The frame came straight from the poller.
    Poller,
    /// The frame is a repetition ([`AirFaults::repeated`]).
    Repeated,
    /// The frame was delayed ([`AirFaults::delayed`]).
    Delayed,
}

/// A frame at the listener's antenna, whether or not the listener received it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Heard {
    /// The instant at which the frame's first bit reached the antenna, virtual ns.
    pub started_ns: u64,
    /// The instant at which the frame's last bit ended, virtual ns.
    pub ended_ns: u64,
    /// The frame's bytes with every error of the air, as far as they arrived completely.
    pub bytes: Vec<u8>,
    /// Whether every byte that the poller's LEN announces arrived, even with errors.
    pub whole: bool,
    /// The way by which the frame reached the antenna.
    pub origin: Origin,
}

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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    Delivered,
    Damaged,
    Lost,
}

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
            // Lost frames are counted at their ends.
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
