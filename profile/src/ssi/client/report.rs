//! What the client says after each transaction.
use crate::{LinkValues, ReportedStatus, ReportedValues};

/// [`Report::age_us`] while no sample has been read, or when its age cannot be told.
pub const AGE_UNKNOWN: u32 = u32::MAX;

/// What a transaction brought.
///
/// The numbers are those of `horus_dpr_verdict_t` in C, where 0 is none: a report that nobody filled says nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Verdict {
    /// A new sample: in sequence, valid, not too old. [`Report::position`] is its position.
    Fresh = 1,
    /// The same sample as before, intact: not new, and older by the time since. This is normal for a flight controller
    /// that reads more often than every 10 ms.
    Same = 2,
    /// A new sample, intact, but the sequence is not found yet: it must advance [three
    /// times](super::SEARCH_CYCLES) in a row. Not shown.
    Searching = 3,
    /// A sample that does not continue the ones before it: back, irregular, too early or too late. The sequence is
    /// searched for from here on. Not shown.
    OutOfSequence = 4,
    /// Link-Status is intact, and there is no Reported-Position: its frame was missed, or the DPR has lost the
    /// sequence; Link-Status says which.
    Empty = 5,
    /// A new sample in sequence, whose position HORUS calls invalid, or which cannot be one ([`range`](crate::range)).
    /// The position is not shown; [`Report::status`] is.
    Invalid = 6,
    /// An intact sample in sequence, new or the same, that is older than [the limit](super::Config::age_limit_us). Not
    /// shown.
    Stale = 7,
    /// 0xFF throughout, or nothing at all: the DPR was busy. It has not heard what was sent; the client sends it again.
    Busy = 8,
    /// Link-Status is not intact, or Reported-Position is neither intact nor vacant, or they were not read whole.
    /// Nothing of it is used.
    Damaged = 9,
    /// As [`Busy`](Self::Busy) or [`Damaged`](Self::Damaged), and nothing intact has been read for longer than
    /// [`Config::silence_us`](super::Config::silence_us): the DPR is off, hung or not connected.
    Silent = 10,
    /// The transaction showed another window, which was asked for; [`view`](super::Client::view) reads it.
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

/// What the client says after a transaction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// What the transaction brought.
    pub verdict: Verdict,
    /// The position to fly by, if there is one: `None` says to fall back on the flight controller's own receiver. What
    /// is not valid in it is NaN. It may be from an earlier transaction; its age says so.
    pub position: Option<ReportedValues>,
    /// What HORUS says of itself: its state, an emergency among them, and how many receivers agree. It is there whether
    /// the position is valid or not, from the same sample and under the same rules of sequence and age.
    pub status: Option<ReportedStatus>,
    /// Age of the last intact sample when the transaction began, µs: of [`Report::position`], if there is one. At
    /// least the true age. [`AGE_UNKNOWN`] if there is none yet.
    pub age_us: u32,
    /// Link-Status, if this transaction brought it intact.
    pub link: Option<LinkValues>,
}

impl Report {
    /// Whether there is no position to fly by, so that the flight controller's own receiver must serve.
    #[must_use]
    pub const fn must_fall_back(&self) -> bool {
        self.position.is_none()
    }
}

/// A transaction that the bus did not carry out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Failed<E> {
    /// What the bus says.
    pub bus: E,
    /// What is left to fly by.
    pub report: Report,
}
