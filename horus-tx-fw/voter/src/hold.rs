//! Holds back for a second any result that the last one shown does not lead to (decision 15, jumps)
//!
//! The result shown last is kept until the next one is shown, however long that takes, and what lies within reach of it
//! grows with the time. Beside it a row of held-back results goes on as long as there is a result at every tick and
//! each leads to the next. When the row has gone on for [`HELD_BACK_MS`], its last result is shown.

use crate::{HELD_BACK_MS, SPEED_MAX_MM_S};

/// The highest speed, m/s.
const SPEED_MAX_M_S: f32 = SPEED_MAX_MM_S as f32 / 1e3;

/// Something that moves from tick to tick.
pub(crate) trait Mark: Copy {
    /// Whether this can have become `next` after `seconds`.
    fn leads_to(&self, next: &Self, seconds: f32) -> bool;
}

/// Whether a distance is at most a limit and the way at [`SPEED_MAX_M_S`]. Distance and limit are given as squares.
///
/// The comparison d ≤ l + w is made without a root: d² - l² - w² ≤ 2 l w.
pub(crate) fn is_within_reach(distance_squared: f32, limit_squared: f32, seconds: f32) -> bool {
    let way_squared = SPEED_MAX_M_S * SPEED_MAX_M_S * (seconds * seconds);
    let beyond = distance_squared - limit_squared - way_squared;
    (beyond <= 0.0) | (beyond * beyond <= 4.0 * limit_squared * way_squared)
}

/// The result that was shown last, and the row that is held back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hold<T> {
    shown: Option<At<T>>,
    /// The time since which the row goes on, ms, and the row's last result.
    held: Option<(u32, At<T>)>,
}

/// A result and its tick, ms.
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
    /// A hold that has shown nothing yet: it shows whatever comes first.
    pub(crate) const NEW: Self = Self { shown: None, held: None };

    /// Whether `mark` is shown at `now_ms`. It must be there, and other rules must allow it (`may_show`).
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
