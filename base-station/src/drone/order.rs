//! Which timestamps continue the ones before them, where the time of arrival says little.
//!
//! The DPR judges each cycle by its own clock, to a quarter of a cycle ([`profile::sequence`]). Behind a radio that
//! loses, reorders and holds back, nothing of that is left: here a timestamp may skip any number of cycles, and come
//! [late](crate::age). It may not run ahead of time, and it may not go back.

use profile::{Freshness, freshness};

/// So much earlier or later than it should a timestamp may arrive, µs: what a carrier may hold one message back longer
/// than another.
pub const SLACK_US: u64 = 2_000_000;

/// A restarted sender's timestamp is at most the time for which nothing newer came from it, and this much, µs: what its
/// last message may have been under way.
pub const RESTART_SLACK_US: u64 = 500_000;

/// So many timestamps in a row that each advance make a restart, or a step that nothing explains, believable.
pub const SEARCH_CYCLES: u8 = 3;

/// What a timestamp is after those before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Newer than all before it.
    Newest {
        /// Whole cycles in between that did not arrive.
        missed: u32,
    },
    /// The newest again.
    Same,
    /// Older than the newest.
    Older,
    /// It neither continues what was before nor is it believed yet. Nothing is to be shown of it.
    Search,
    /// The sender has started again: what was before it is forgotten.
    Restarted,
}

#[derive(Clone, Copy, Debug)]
struct Seen {
    timestamp: u32,
    at_us: u64,
}

/// The memory of one sender's timestamps. See the [module](self).
#[derive(Clone, Copy, Debug, Default)]
pub struct Order {
    newest: Option<Seen>,
    /// The last timestamp of a search, and how many in a row have advanced.
    search: Option<(Seen, u8)>,
}

impl Order {
    /// What the timestamp, ms, of something that arrived at `at_us` is. `grid` is whether the sender's timestamps
    /// advance by whole cycles.
    pub fn judge(&mut self, timestamp: u32, at_us: u64, grid: bool) -> Step {
        let seen = Seen { timestamp, at_us };
        let Some(newest) = self.newest else {
            self.newest = Some(seen);
            return Step::Newest { missed: 0 };
        };
        let candidate = match freshness(Some(newest.timestamp), timestamp) {
            Freshness::Frozen => return Step::Same,
            Freshness::Fresh { missed } if is_in_time(newest, seen) => {
                *self = Self { newest: Some(seen), search: None };
                return Step::Newest { missed };
            }
            Freshness::Irregular if !grid && is_in_time(newest, seen) => {
                *self = Self { newest: Some(seen), search: None };
                return Step::Newest { missed: 0 };
            }
            Freshness::Restarted => {
                let silent_us = at_us.saturating_sub(newest.at_us).saturating_add(RESTART_SLACK_US);
                u64::from(timestamp) * 1_000 <= silent_us
            }
            Freshness::First | Freshness::Fresh { .. } | Freshness::Irregular => true,
        };
        if !candidate {
            return Step::Older;
        }
        let found = match self.search {
            Some((last, found)) => match freshness(Some(last.timestamp), timestamp) {
                // Another object of the same cycle.
                Freshness::Frozen => return Step::Search,
                Freshness::Fresh { .. } if is_in_time(last, seen) => found + 1,
                Freshness::Irregular if !grid && is_in_time(last, seen) => found + 1,
                _ => 1,
            },
            None => 1,
        };
        if found < SEARCH_CYCLES {
            self.search = Some((seen, found));
            return Step::Search;
        }
        *self = Self { newest: Some(seen), search: None };
        Step::Restarted
    }

    /// The newest timestamp, ms.
    #[must_use]
    pub fn newest(&self) -> Option<u32> {
        self.newest.map(|seen| seen.timestamp)
    }
}

/// Whether no more time passes in the timestamps than has passed here.
fn is_in_time(before: Seen, now: Seen) -> bool {
    let step_us = u64::from(now.timestamp.wrapping_sub(before.timestamp)) * 1_000;
    let passed_us = now.at_us.saturating_sub(before.at_us);
    let drift_us = passed_us / u64::from(profile::sequence::TOLERANCE_SHARE);
    step_us <= passed_us.saturating_add(drift_us).saturating_add(SLACK_US)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: u64 = 1_000_000;

    #[test]
    fn forward_is_newer_back_is_older_and_the_same_is_the_same() {
        let mut order = Order::default();
        let mut judge = |timestamp, at| order.judge(timestamp, at, true);
        assert_eq!(judge(60_000, 0), Step::Newest { missed: 0 });
        assert_eq!(judge(60_010, 10_000), Step::Newest { missed: 0 });
        assert_eq!(judge(60_050, 10_001), Step::Newest { missed: 3 });
        assert_eq!(judge(60_050, 10_002), Step::Same);
        assert_eq!(judge(60_040, 10_003), Step::Older);
        assert_eq!(judge(60_060, 10_004), Step::Newest { missed: 0 });
        assert_eq!(judge(5_000, 3 * SECOND), Step::Older, "5 s ago it was running, so it cannot be that young");
    }

    #[test]
    fn a_restart_is_believed_after_three_cycles_in_a_row() {
        let mut order = Order::default();
        let mut judge = |timestamp, at| order.judge(timestamp, at, true);
        assert_eq!(judge(60_000, 0), Step::Newest { missed: 0 });
        assert_eq!(judge(30, SECOND), Step::Search);
        assert_eq!(judge(30, SECOND), Step::Search, "another object of the same cycle");
        assert_eq!(judge(130, SECOND + 100_000), Step::Search);
        assert_eq!(judge(230, SECOND + 200_000), Step::Restarted);
        assert_eq!(judge(240, SECOND + 210_000), Step::Newest { missed: 0 });
        assert_eq!(judge(60_010, SECOND + 210_000), Step::Search, "what was before cannot come back at once");
    }

    #[test]
    fn no_single_inserted_timestamp_is_believed_and_none_keeps_the_right_ones_out() {
        let mut order = Order::default();
        let mut at = 0;
        for cycle in 0..1_000_u32 {
            at += 10_000;
            let strange = [cycle * 10 + 3_600_000, 5, cycle * 10 + 7, 0][cycle as usize % 4];
            assert!(matches!(order.judge(10 * cycle + 70_000, at, true), Step::Newest { missed: 0 }), "{cycle}");
            assert!(matches!(order.judge(strange, at, true), Step::Search | Step::Older), "{strange}");
        }
    }

    #[test]
    fn a_step_that_nothing_explains_is_believed_after_three_in_a_row() {
        let mut order = Order::default();
        let mut judge = |timestamp, at| order.judge(timestamp, at, true);
        assert_eq!(judge(1_000, 0), Step::Newest { missed: 0 });
        let steps = [1_015, 1_025, 1_035].map(|timestamp| judge(timestamp, u64::from(timestamp - 1_000) * 1_000));
        assert_eq!(steps, [Step::Search, Step::Search, Step::Restarted]);
        let steps = [900_005, 900_015, 900_025].map(|timestamp| judge(timestamp, SECOND));
        assert_eq!(steps, [Step::Search, Step::Search, Step::Restarted]);
    }

    #[test]
    fn a_clock_without_a_grid_may_advance_by_anything() {
        let mut order = Order::default();
        assert_eq!(order.judge(1_000, 0, false), Step::Newest { missed: 0 });
        assert_eq!(order.judge(1_013, 1_000, false), Step::Newest { missed: 0 });
        let steps = [3, 7, 11].map(|timestamp| order.judge(timestamp, SECOND, false));
        assert_eq!(steps, [Step::Search, Step::Search, Step::Restarted]);
    }

    #[test]
    fn a_long_silence_explains_a_long_step_and_timestamps_may_wrap() {
        let mut order = Order::default();
        assert_eq!(order.judge(u32::MAX - 5, 0, true), Step::Newest { missed: 0 });
        assert_eq!(order.judge(4, 10_000, true), Step::Newest { missed: 0 });
        assert_eq!(order.judge(3_600_004, 3_600 * SECOND, true), Step::Newest { missed: 359_999 });
    }
}
