//! Holds a result back for a second if it cannot be reached from the last result shown (decision 15, jumps)
//!
//! A result is within reach if its distance from the last one shown is small enough for the time since then. Results
//! out of reach are held back. They form a series, which goes on while every tick has a result within reach of the one
//! before it. After [`HELD_BACK_MS`] the last result of the series is shown.

use crate::{HELD_BACK_MS, SPEED_MAX_MM_S};

const SPEED_MAX_M_S: f32 = SPEED_MAX_MM_S as f32 / 1e3;

/// A place or an altitude that the vote has as its result, and that moves from tick to tick.
pub(crate) trait Mark: Copy {
    /// Whether this place or altitude can have become `next` after `seconds`.
    fn leads_to(&self, next: &Self, seconds: f32) -> bool;
}

/// Whether a distance d is at most a limit l plus the way w at [`SPEED_MAX_M_S`]. Distance and limit are given as
/// squares. The comparison needs no root: d² - l² - w² ≤ 2 l w.
pub(crate) fn is_within_reach(distance_squared: f32, limit_squared: f32, seconds: f32) -> bool {
    let way_squared = SPEED_MAX_M_S * SPEED_MAX_M_S * (seconds * seconds);
    let beyond = distance_squared - limit_squared - way_squared;
    (beyond <= 0.0) | (beyond * beyond <= 4.0 * limit_squared * way_squared)
}

/// The result that was shown last, and the series of results that are held back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hold<T> {
    shown: Option<At<T>>,
    /// The time at which the series of held-back results began, ms, and the last result of the series.
    held: Option<(u32, At<T>)>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct At<T> {
    ms: u32,
    mark: T,
}

impl<T: Mark> At<T> {
    fn leads_to(&self, next: &Self) -> bool {
        self.mark.leads_to(&next.mark, next.ms.wrapping_sub(self.ms) as f32 / 1e3)
    }
}

impl<T: Mark> Hold<T> {
    /// The state before any result was shown. The first result is shown at once.
    pub(crate) const NEW: Self = Self { shown: None, held: None };

    /// Takes the result `mark` of the tick at `now_ms`, if there is one (`is_there`), and returns whether it is shown.
    /// `may_show` says that all other rules allow it.
    pub(crate) fn take(&mut self, now_ms: u32, mark: T, is_there: bool, may_show: bool) -> bool {
        let next = At { ms: now_ms, mark };
        let is_near = self.shown.unwrap_or(next).leads_to(&next);
        let (since, before) = self.held.unwrap_or((now_ms, next));
        // Not covered: only this line, in the copy for altitudes, the result of the comparison with the root alone: no
        // run has an altitude that is held back and then steps, from one tick to the next, by more than the limit and
        // at most 2 m more. The copy for places, which has such a step, is the same code.
        let since = if before.leads_to(&next) { since } else { now_ms };
        let has_held = now_ms.wrapping_sub(since) >= HELD_BACK_MS;
        let is_shown = is_there & may_show & (is_near | has_held);
        self.shown = if is_shown { Some(next) } else { self.shown };
        self.held = (is_there & !is_shown).then_some((since, next));
        is_shown
    }
}
