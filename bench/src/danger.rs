//! Tells which violations of the judge's rules mislead a reader.

use bench_judge::Violation;

/// Whether `violation` means that invalid data were shown as valid to the flight controller or at the base station.
///
/// Wrong content of an object counts, because the judge does not report whether the object was shown. Wrong flags of
/// Link-Status, a wrong state of HORUS, a wrong flag of its crystal, a wrong timestamp and a wrong number of uplinks
/// count as well, because readers act on them; so does a valid position of a receiver whose dynamic model limits what
/// it can say. An age and flags by which the link looks worse than it is do not count: a DPR that has lost a frame
/// tells that, and nobody uses what is old or wrong because of it.
#[must_use]
pub(crate) const fn is_dangerous(violation: Violation) -> bool {
    matches!(
        violation,
        Violation::ContentWrong
            | Violation::StatusWrong
            | Violation::ReportedWrong
            | Violation::VoteWrong
            | Violation::ExclusionWrong
            | Violation::NotAirborne
            | Violation::ShownNeverSent
            | Violation::ShownOutOfSequence
            | Violation::ShownStale
            | Violation::ShownExpired
            | Violation::Regression
            | Violation::Torn
            | Violation::LinkAge
            | Violation::LinkFlags
            | Violation::StateWrong
            | Violation::CrystalWrong
            | Violation::TimestampWrong
            | Violation::UplinkWrong
            | Violation::PositionOff
            | Violation::ClientWrong
            | Violation::ClientAge
            | Violation::StationAge
            | Violation::BaseInvalid
            | Violation::BaseMixed
    )
}
