//! The client's report after each transaction.
use crate::{LinkValues, ReportedStatus, ReportedValues};

/// The value of [`Report::age_us`] while no sample has been read, or when its age is unknown.
pub const AGE_UNKNOWN: u32 = u32::MAX;

/// The result of a transaction.
///
/// The numbers are those of `horus_dpr_verdict_t` in C, where 0 is none, the value of an unfilled report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Verdict {
    /// A new sample: in sequence, valid, not too old. [`Report::position`] is its position.
    Fresh = 1,
    /// The same sample as before, intact: not new, and older by the time since. This is normal for a flight controller
    /// that reads more often than every 10 ms.
    Same = 2,
    /// A new, intact sample, but the sequence is not found yet: it must advance [three times](super::SEARCH_CYCLES) in
    /// a row. The sample is not shown.
    Searching = 3,
    /// A sample that does not continue the ones before it: behind, irregular, too early or too late. The search for the
    /// sequence starts here, and the sample is not shown.
    OutOfSequence = 4,
    /// Link-Status is intact, but there is no Reported-Position: its frame was missed, or the DPR has lost the
    /// sequence. Link-Status shows which.
    Empty = 5,
    /// A new sample in sequence, whose position HORUS marks as invalid, or which is implausible
    /// ([`range`](crate::range)). The position is not shown; [`Report::status`] is.
    Invalid = 6,
    /// An intact sample in sequence, new or the same, that is older than [the limit](super::Config::age_limit_us) and
    /// is not shown.
    Stale = 7,
    /// Every byte is 0xFF, or there are none: the DPR was busy. It has not received the request; the client sends it
    /// again.
    Busy = 8,
    /// Link-Status is not intact, or Reported-Position is neither intact nor vacant, or they were not read whole. The
    /// data are not used.
    Damaged = 9,
    /// A transaction that would be [`Busy`](Self::Busy) or [`Damaged`](Self::Damaged) after more than
    /// [`Config::silence_us`](super::Config::silence_us) without intact data: the DPR is off, hung or not connected.
    Silent = 10,
    /// The transaction read another, requested window; [`view`](super::Client::view) has its objects.
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
    /// The position to fly by, if there is one; `None` means that the flight controller must use its own receiver.
    /// Values that are not valid are NaN. It may be from an earlier transaction, which its age shows.
    pub position: Option<ReportedValues>,
    /// HORUS's own status: its state, which includes an emergency, and the number of agreeing receivers. It is present
    /// whether the position is valid or not, from the same sample and under the same rules of sequence and age.
    pub status: Option<ReportedStatus>,
    /// Age of the last intact sample when the transaction began, µs: that of [`Report::position`], if there is one. It
    /// is at least the true age, and [`AGE_UNKNOWN`] if there is no sample yet.
    pub age_us: u32,
    /// Link-Status, if this transaction brought it intact.
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
    /// The bus's error.
    pub bus: E,
    /// The report, with the position that is left to fly by.
    pub report: Report,
}
