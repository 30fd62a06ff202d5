//! Freshness: what a timestamp says after the one before it.
use crate::CYCLE_MS;

/// What a timestamp says after the one before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Freshness {
    /// Nothing came before it.
    First,
    /// A later cycle.
    Fresh {
        /// Cycles in between that were not received.
        missed: u32,
    },
    /// The same again: HORUS is frozen.
    Frozen,
    /// A jump back: HORUS started again.
    Restarted,
    /// Forward, but not by a whole number of cycles: not fresh.
    Irregular,
}

impl Freshness {
    /// Whether what carries the timestamp is new data of a running HORUS.
    #[must_use]
    pub const fn is_fresh(self) -> bool {
        matches!(self, Self::First | Self::Fresh { .. })
    }
}

/// What timestamp `now` says after `previous`, both ms since HORUS start, wrapping.
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
        Freshness::Fresh {
            missed: step / CYCLE_MS - 1,
        }
    }
}
