//! Freshness: what a timestamp says, compared with the one before it.
//!
//! This module is for recorded or forwarded data, whose time of arrival has no meaning. For data on arrival,
//! [`sequence`](crate::sequence) decides whether a cycle may be shown; it also uses the receiver's clock.
use crate::CYCLE_MS;

/// The relation of a timestamp to the one before it (paper, section 2.3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Freshness {
    /// The timestamp is the first one; there is none to compare it with.
    First,
    /// The timestamp is ahead by a whole number of cycles: the data are new.
    Fresh {
        /// The number of cycles that did not arrive between the two timestamps.
        missed: u32,
    },
    /// The timestamp repeats the last one: HORUS is frozen, or a frame was repeated.
    Frozen,
    /// The timestamp is behind the last one: HORUS has restarted and counts from 0.
    Restarted,
    /// The timestamp is ahead of the last one, but not by a whole number of cycles. HORUS never sends such a timestamp.
    Irregular,
}

impl Freshness {
    /// Whether the timestamp can continue the earlier ones: [`First`](Self::First) or [`Fresh`](Self::Fresh).
    #[must_use]
    pub const fn is_fresh(self) -> bool {
        matches!(self, Self::First | Self::Fresh { .. })
    }
}

/// The relation of timestamp `now` to `previous`, the timestamp before it; both in ms since HORUS's start.
///
/// Timestamps wrap after 49.7 days. A step of less than 24.8 days, half of that, counts as an advance, and a larger one
/// as a step back. So a HORUS that restarts after more than 24.8 days looks like one whose timestamp advanced.
///
/// ```
/// use profile::{Freshness, freshness};
///
/// assert_eq!(freshness(None, 500), Freshness::First);
/// assert_eq!(freshness(Some(500), 510), Freshness::Fresh { missed: 0 });
/// assert_eq!(freshness(Some(500), 540), Freshness::Fresh { missed: 3 });
/// assert_eq!(freshness(Some(500), 500), Freshness::Frozen);
/// assert_eq!(freshness(Some(500), 0), Freshness::Restarted);
/// assert_eq!(freshness(Some(500), 515), Freshness::Irregular);
/// ```
#[must_use]
pub const fn freshness(previous: Option<u32>, now: u32) -> Freshness {
    let Some(previous) = previous else {
        return Freshness::First;
    };
    let step = now.wrapping_sub(previous);
    if step == 0 {
        Freshness::Frozen
    } else if step > u32::MAX / 2 {
        Freshness::Restarted
    // Not covered: only this line, its true outcome: HORUS's timestamps are ticks of 10 ms, and a timestamp is judged
    // only if its object is intact by its CRC.
    } else if !step.is_multiple_of(CYCLE_MS) {
        Freshness::Irregular
    } else {
        Freshness::Fresh { missed: step / CYCLE_MS - 1 }
    }
}
