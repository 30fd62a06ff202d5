//! What the last one shown does not lead to is held back for a second (decision 15, jumps)
//!
//! What was shown last is remembered until the next is shown, however long that takes, and what lies within reach of it
//! grows with the time. Beside it runs a row of what was held back: it goes on as long as there is something to show at
//! every tick and each leads to the next, and what goes on for [`HELD_BACK_MS`] is shown.

use crate::{HELD_BACK_MS, SPEED_MAX_MM_S};

/// The highest speed, m/s.
const SPEED_MAX_M_S: f32 = SPEED_MAX_MM_S as f32 / 1e3;

/// Something that moves from tick to tick.
pub(crate) trait Mark: Copy {
    /// Whether it can have become `next` so many seconds later.
    fn leads_to(&self, next: &Self, seconds: f32) -> bool;
}

/// Whether a distance is at most a limit and the way at [`SPEED_MAX_M_S`], of all three but the time the squares.
///
/// d ≤ l + w without a root: d² - l² - w² ≤ 2 l w.
pub(crate) fn is_within_reach(distance_squared: f32, limit_squared: f32, seconds: f32) -> bool {
    let way_squared = SPEED_MAX_M_S * SPEED_MAX_M_S * (seconds * seconds);
    let beyond = distance_squared - limit_squared - way_squared;
    (beyond <= 0.0) | (beyond * beyond <= 4.0 * limit_squared * way_squared)
}

/// What was shown last and what is held back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hold<T> {
    shown: Option<At<T>>,
    /// Since when the row goes on, ms, and its last.
    held: Option<(u32, At<T>)>,
}

/// Something and its tick, ms.
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
    /// Nothing was shown yet: whatever comes first is.
    pub(crate) const NEW: Self = Self { shown: None, held: None };

    /// Whether `mark` is shown at `now_ms`, if it is there at all, and if it may be shown for all that others say.
    pub(crate) fn take(&mut self, now_ms: u32, mark: T, is_there: bool, may_show: bool) -> bool {
        let next = At { ms: now_ms, mark };
        let is_near = self.shown.unwrap_or(next).leads_to(&next);
        let (since, before) = self.held.unwrap_or((now_ms, next));
        let since = if before.leads_to(&next) { since } else { now_ms };
        let has_held = now_ms.wrapping_sub(since) >= HELD_BACK_MS;
        let is_shown = is_there & may_show & (is_near | has_held);
        self.shown = if is_shown { Some(next) } else { self.shown };
        self.held = (is_there & !is_shown).then_some((since, next));
        is_shown
    }
}
