//! Freshness: what a timestamp alone says after the one before it.
//!
//! Whether a cycle may be shown is for [`sequence`](crate::sequence) to say, which knows the receiver's clock as well.
//! This function is for those who read recorded or forwarded data, where the time of arrival says nothing.
use crate::CYCLE_MS;

/// What a timestamp says after the one before it (paper, section 2.3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Freshness {
    /// There was none before it.
    First,
    /// Forward by a whole number of cycles: new data.
    Fresh {
        /// Cycles in between that did not arrive.
        missed: u32,
    },
    /// The same again: HORUS is frozen, or a frame was repeated.
    Frozen,
    /// Back: HORUS has restarted and counts from 0, so what it sends does not continue what was before.
    Restarted,
    /// Forward, but not by a whole number of cycles: not what HORUS sends.
    Irregular,
}

impl Freshness {
    /// Whether the timestamp could continue what was before: [`First`](Self::First) or [`Fresh`](Self::Fresh).
    #[must_use]
    pub const fn is_fresh(self) -> bool {
        matches!(self, Self::First | Self::Fresh { .. })
    }
}

/// What timestamp `now` says after `previous`, the last one received; both ms since HORUS start.
///
/// Timestamps wrap after 49.7 days, which is no restart: forward is less than half of that ahead, back is the rest.
/// (2³² is no multiple of ten, so timestamps end in another digit after they wrapped; only differences count.) A HORUS
/// that restarts after more than 24.8 days therefore looks like one that went forward.
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
    } else if !step.is_multiple_of(CYCLE_MS) {
        Freshness::Irregular
    } else {
        Freshness::Fresh { missed: step / CYCLE_MS - 1 }
    }
}
