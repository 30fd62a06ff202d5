//! The chip's own actions as a table of deadlines, with one entry for each kind.

/// No deadline.
const NEVER: u64 = u64::MAX;

/// The kinds of deadlines. Their order decides between two at the same instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Due {
    /// The oscillator is stable.
    Osc,
    /// Collision avoidance is over: the own field goes on.
    FieldOn,
    /// The field detector's output changes.
    FieldDetect,
    /// An event of the air takes effect.
    Heard,
    /// The first bit of a frame leaves.
    TxStart,
    /// A frame needs bytes that were not in the FIFO when the last ones were taken.
    TxMore,
    /// The FIFO falls below its level for sending.
    TxLevel,
    /// A frame has left.
    TxEnd,
    /// A frame's sync, or its start of communication, was received.
    RxStart,
    /// The FIFO reaches its level for receiving.
    RxLevel,
    /// A frame was received.
    RxEnd,
    /// I_apon: the field is on.
    Apon,
    /// I_cat: the guard time is over.
    Guard,
    /// A measurement, an adjustment or a calibration is done.
    CommandDone,
    /// The mask-receive timer.
    MaskReceive,
    /// The no-response timer.
    NoResponse,
    /// The general purpose timer.
    GeneralPurpose,
    /// The wake-up timer.
    WakeUp,
    /// The automatic answer begins.
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

/// The deadlines, virtual ns.
#[derive(Clone, Debug)]
pub(crate) struct Schedule {
    due: [u64; DUES.len()],
    next: u64,
}

impl Schedule {
    /// A table without deadlines.
    pub(crate) fn new() -> Self {
        Self { due: [NEVER; DUES.len()], next: NEVER }
    }

    /// Schedules `what` at `at`, in place of its earlier deadline.
    pub(crate) fn plan(&mut self, what: Due, at: u64) {
        self.due[what as usize] = at;
        self.next = self.due.iter().copied().min().unwrap_or(NEVER);
    }

    /// Cancels the deadline of `what`.
    pub(crate) fn cancel(&mut self, what: Due) {
        self.plan(what, NEVER);
    }

    /// Whether `what` has a deadline.
    pub(crate) fn running(&self, what: Due) -> bool {
        self.due[what as usize] != NEVER
    }

    /// The first deadline.
    pub(crate) fn next(&self) -> Option<u64> {
        (self.next != NEVER).then_some(self.next)
    }

    /// Takes the first deadline, if it is not after `now`, with its instant.
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
