//! The client's report after each transaction.
use crate::{LinkValues, ReportedStatus, ReportedValues};

/// The value of [`Report::age_us`] while no sample has been read, or when the sample's age is unknown.
pub const AGE_UNKNOWN: u32 = u32::MAX;

/// The result of a transaction for the position that is displayed.
///
/// The numbers are those of `horus_dpr_verdict_t` in C, where 0 means no verdict, in a report that is not filled yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Verdict {
    /// A new sample that is in sequence, valid, and not too old. [`Report::position`] is its position.
    Fresh = 1,
    /// The same sample as in the transaction before, intact: it is only older. A flight controller that reads more
    /// often than every 10 ms gets this result regularly.
    Same = 2,
    /// A new, intact sample, but the sequence is not found yet: the timestamp must advance [three
    /// times](super::SEARCH_CYCLES) in a row. The sample is not shown.
    Searching = 3,
    /// A sample that does not continue the samples before it: behind, irregular, too early or too late. The search for
    /// the sequence starts here, and the sample is not shown.
    OutOfSequence = 4,
    /// Link-Status is intact, but there is no Reported-Position: HORUS's frame was missed, or the DPR has lost the
    /// sequence. Link-Status shows which of the two happened.
    Empty = 5,
    /// A new sample in sequence whose position HORUS marks as invalid, or whose position is implausible
    /// ([`range`](crate::range)). The position is not shown; [`Report::status`] is.
    Invalid = 6,
    /// An intact sample in sequence, new or the same, that is older than [the limit](super::Config::age_limit_us) and
    /// is not shown.
    Stale = 7,
    /// Every byte is 0xFF, or there are no bytes: the DPR was busy. It has not received the request, which the client
    /// sends again.
    Busy = 8,
    /// Link-Status is not intact, or Reported-Position is neither intact nor vacant, or both were not read whole. The
    /// data are not used.
    Damaged = 9,
    /// A transaction that would be [`Busy`](Self::Busy) or [`Damaged`](Self::Damaged) after more than
    /// [`Config::silence_us`](super::Config::silence_us) without intact data: the DPR is off, hung or not connected.
    Silent = 10,
    /// The transaction read a requested window other than the default; [`view`](super::Client::view) has its objects.
    Window = 11,
}

impl Verdict {
    /// Every verdict, in the order of the numbers.
    pub const ALL: [Self; 11] = [
        Self::Fresh,
        Self::Same,
        Self::Searching,
        Self::OutOfSequence,
        Self::Empty,
        Self::Invalid,
        Self::Stale,
        Self::Busy,
        Self::Damaged,
        Self::Silent,
        Self::Window,
    ];
}

/// The client's report after a transaction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// The result of the transaction.
    pub verdict: Verdict,
    /// The position to fly by; `None` means that there is none, and the flight controller must use its own receiver.
    /// Values that are not valid are NaN. The position may be from an earlier transaction, as its age shows.
    pub position: Option<ReportedValues>,
    /// HORUS's own status: its state, which includes an emergency, and the number of agreeing receivers. It has the
    /// same sample and the same rules of sequence and age as the position, but is present also if that is invalid.
    pub status: Option<ReportedStatus>,
    /// The age of the last intact sample when the transaction began, µs: that of [`Report::position`], if there is a
    /// position. It is at least the true age, and [`AGE_UNKNOWN`] if there is no sample yet.
    pub age_us: u32,
    /// Link-Status, if this transaction read it intact.
    pub link: Option<LinkValues>,
}

impl Report {
    /// Whether there is no position to fly by, so that the flight controller must use its own receiver.
    #[must_use]
    pub const fn must_fall_back(&self) -> bool {
        self.position.is_none()
    }
}

/// A transaction that failed on the bus.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Failed<E> {
    /// The error of the bus.
    pub bus: E,
    /// The client's report of the failed transaction, with the position that is left to fly by.
    pub report: Report,
}
