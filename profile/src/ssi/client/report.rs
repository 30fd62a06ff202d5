//! The client's report after each transaction.
use crate::{LinkValues, ReportedStatus, ReportedValues};

/// The value of [`Report::age_us`] if no sample has been read or the sample's age is unknown.
pub const AGE_UNKNOWN: u32 = u32::MAX;

/// The result of a transaction.
///
/// The numbers of the verdicts equal those of `horus_dpr_verdict_t` in C, where 0 stands for a report that is not
/// filled yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Verdict {
    /// A new sample that is in sequence, valid and not too old. [`Report::position`] is its position.
    Fresh = 1,
    /// The transaction read the same sample as the one before. This is usual for a flight controller that reads more
    /// often than every 10 ms.
    Same = 2,
    /// A new, intact sample that is not shown, because the sequence is not found yet: the timestamp must advance [three
    /// times](super::SEARCH_CYCLES) in a row.
    Searching = 3,
    /// A sample that does not continue the samples before it: behind, irregular, too early or too late. It is not
    /// shown, and the search for the sequence starts.
    OutOfSequence = 4,
    /// Link-Status is intact, but there is no Reported-Position. Link-Status says whether HORUS's frame was missed or
    /// the DPR has lost the sequence.
    Empty = 5,
    /// A new sample in sequence whose position is marked invalid by HORUS or is implausible ([`range`](crate::range)).
    /// [`Report::status`] is shown without a position.
    Invalid = 6,
    /// An intact sample in sequence that is older than [the limit](super::Config::age_limit_us) and is not shown.
    Stale = 7,
    /// Every byte is 0xFF, or there are no bytes: the DPR was busy and has not received the request, which the client
    /// sends again.
    Busy = 8,
    /// Link-Status is not intact, or Reported-Position is neither intact nor 0x00 or 0xFF throughout, or one of them
    /// was not read whole. The data are not used.
    Damaged = 9,
    /// There were no intact data for more than [`Config::silence_us`](super::Config::silence_us): the DPR is off, hung
    /// or not connected. This replaces [`Busy`](Self::Busy) and [`Damaged`](Self::Damaged).
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
    /// The position to fly by, possibly from an earlier transaction. `None` means that the flight controller must use
    /// its own receiver. Values that are not valid are NaN.
    pub position: Option<ReportedValues>,
    /// HORUS's own status: its state, which includes an emergency, and the number of agreeing receivers. It belongs to
    /// the same sample as the position. It is shown even if the position is invalid.
    pub status: Option<ReportedStatus>,
    /// An upper bound of the age of the last intact sample when the transaction began, µs; [`AGE_UNKNOWN`] if there is
    /// none. [`Report::position`], if any, is from this sample.
    pub age_us: u32,
    /// Link-Status, if this transaction read it intact.
    pub link: Option<LinkValues>,
}

impl Report {
    /// Whether there is no position, so that the flight controller must use its own receiver.
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
    /// The report of the failed transaction. Its position, if any, is that of an earlier transaction.
    pub report: Report,
}
