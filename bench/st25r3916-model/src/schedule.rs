//! The deadlines of the chip's own actions, one for each kind.

const NEVER: u64 = u64::MAX;

/// The kinds of deadlines. If several are due at one instant, they are carried out in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Due {
    /// The oscillator becomes stable.
    Osc,
    /// Collision avoidance ends, and the chip's own field goes on.
    FieldOn,
    /// The field detector's output changes.
    FieldDetect,
    /// An event of the air takes effect.
    Heard,
    /// A frame being sent begins on the air.
    TxStart,
    /// A frame being sent needs bytes that were loaded into the FIFO after its last chunk.
    TxMore,
    /// The FIFO falls below its water level for sending.
    TxLevel,
    /// The last bit of a frame being sent has left.
    TxEnd,
    /// The sync (NFC-F) or start of communication (NFC-A) of a received frame ends.
    RxStart,
    /// The FIFO reaches its water level for receiving.
    RxLevel,
    RxEnd,
    /// I_apon is due after the chip's own field was switched on.
    Apon,
    /// The field-on guard time ends, and I_cat is due.
    Guard,
    /// A measurement, an adjustment or a calibration is done.
    CommandDone,
    MaskReceive,
    NoResponse,
    GeneralPurpose,
    WakeUp,
    /// The automatic answer to a SENSF_REQ begins.
    Answer,
}

const DUES: [Due; 19] = [
    Due::Osc,
    Due::FieldOn,
    Due::FieldDetect,
    Due::Heard,
    Due::TxStart,
    Due::TxMore,
    Due::TxLevel,
    Due::TxEnd,
    Due::RxStart,
    Due::RxLevel,
    Due::RxEnd,
    Due::Apon,
    Due::Guard,
    Due::CommandDone,
    Due::MaskReceive,
    Due::NoResponse,
    Due::GeneralPurpose,
    Due::WakeUp,
    Due::Answer,
];

#[derive(Clone, Debug)]
pub(crate) struct Schedule {
    due: [u64; DUES.len()],
    next: u64,
}

impl Schedule {
    pub(crate) fn new() -> Self {
        Self { due: [NEVER; DUES.len()], next: NEVER }
    }

    /// Sets the deadline of kind `what` to `at`, and replaces an earlier one of this kind.
    pub(crate) fn plan(&mut self, what: Due, at: u64) {
        self.due[what as usize] = at;
        self.next = self.due.iter().copied().min().unwrap_or(NEVER);
    }

    pub(crate) fn cancel(&mut self, what: Due) {
        self.plan(what, NEVER);
    }

    pub(crate) fn running(&self, what: Due) -> bool {
        self.due[what as usize] != NEVER
    }

    /// Returns the instant of the first deadline, virtual ns; `None` if none is set.
    pub(crate) fn next(&self) -> Option<u64> {
        (self.next != NEVER).then_some(self.next)
    }

    /// Removes the first deadline if it is due at `now` or before, and returns it with its instant.
    pub(crate) fn take(&mut self, now: u64) -> Option<(u64, Due)> {
        if self.next > now {
            return None;
        }
        let mut first = Due::Osc;
        for what in DUES {
            if self.due[what as usize] < self.due[first as usize] {
                first = what;
            }
        }
        let at = self.due[first as usize];
        self.cancel(first);
        Some((at, first))
    }
}
