//! Determines which timestamps continue the earlier ones on a link that loses, reorders and delays messages.
//!
//! The DPR judges each cycle by its own clock, to a quarter of a cycle ([`profile::sequence`]). Behind a radio that is
//! impossible: a timestamp may skip any number of cycles and come [late](crate::age). But a timestamp must neither run
//! ahead of time nor go back.
//!
//! # Discontinuities
//!
//! A timestamp that neither continues the earlier ones nor can be late starts a search. When [`SEARCH_CYCLES`]
//! timestamps in a row continue one another, the result depends on the earlier sender:
//!
//! | the earlier sender | the new timestamps | result |
//! |---|---|---|
//! | continued meanwhile | any | a [stranger](Step::Stranger), since there are two senders |
//! | is quiet for [`QUIET_US`] | recent enough for a restart, or ahead | a [restart](Step::Restarted) |
//! | is quiet for [`QUIET_US`] | back by more than [`LATE_US`] | a stranger: perhaps a replayed recording |
//! | has sent less than [`QUIET_US`] ago, but does not continue | any | not known yet |
//!
//! A sender is replaced only in the cases of this table. So messages that arrive among those of the true sender cannot
//! replace it.

use profile::{Freshness, freshness};

/// The time, µs, by which a sender's first timestamps may come earlier than the shortest delay allows: the differences
/// of delay in one carrier.
pub const SLACK_US: u64 = 2_000_000;

/// The time, µs, by which later timestamps, after the first [`SEARCH_CYCLES`], may come earlier than the shortest delay
/// allows.
pub const AHEAD_US: u64 = 1_000_000;

/// The longest time for which a carrier holds a message back while it delivers others, µs.
pub const LATE_US: u64 = 10_000_000;

/// The longest time, µs, for which the earlier sender's newest message may have been on its way. A restarted sender may
/// have started when that message left, so its timestamp may exceed the time since the message's arrival by this much.
pub const RESTART_SLACK_US: u64 = 500_000;

/// A restart or another sender is accepted after this number of timestamps in a row, each newer than the one before.
pub const SEARCH_CYCLES: u8 = 3;

/// Within this time after a sender's last message, µs, no other sender can replace that sender. A sender slower than 4
/// Hz is [stale](super::STALE_US) between two messages.
pub const QUIET_US: u64 = 250_000;

/// The number of simultaneous searches. With more than one, unrelated messages cannot keep a sender from being found.
const SEARCHES: usize = 4;

/// The relation of a timestamp to the earlier ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// The timestamp is newer than all earlier ones.
    Newest {
        /// The number of cycles that did not arrive between this timestamp and the newest one before it.
        missed: u32,
    },
    /// The timestamp equals the newest one.
    Same,
    /// The timestamp is older than the newest timestamp that has arrived.
    Older,
    /// The timestamp does not continue the earlier ones, so the object is not shown.
    Search,
    /// The timestamp is of a sender that has restarted, so the earlier data are dropped.
    Restarted,
    /// The timestamp is of another sender with the same id, who sends beside the earlier sender or has replaced it.
    Stranger,
}

#[derive(Clone, Copy, Debug)]
struct Seen {
    timestamp: u32,
    at_us: u64,
}

#[derive(Clone, Copy, Debug)]
struct Search {
    began_us: u64,
    last: Seen,
    found: u8,
}

enum Kind {
    Newest {
        missed: u32,
    },
    Same,
    Older,
    /// The timestamp does not continue the earlier ones. `back` is true if the timestamp goes back and does not fit a
    /// sender that has restarted.
    Strange {
        back: bool,
    },
}

/// The state of one sender's timestamps. See the [module](self).
#[derive(Clone, Copy, Debug, Default)]
pub struct Order {
    newest: Option<Seen>,
    taken: u8,
    searches: [Option<Search>; SEARCHES],
}

impl Order {
    /// Judges the timestamp, ms, of an object that arrived at `at_us`. It arrived `early_us` earlier than with the
    /// shortest delay ([`Ages::early_us`](crate::age::Ages::early_us)). `grid` says whether the sender's timestamps
    /// advance by whole cycles.
    pub fn judge(&mut self, timestamp: u32, at_us: u64, grid: bool, early_us: i64) -> Step {
        let seen = Seen { timestamp, at_us };
        let back = match self.kind(seen, grid, early_us) {
            Kind::Newest { missed } => {
                self.newest = Some(seen);
                self.taken = SEARCH_CYCLES.min(self.taken + 1);
                return Step::Newest { missed };
            }
            Kind::Same => return Step::Same,
            Kind::Older => return Step::Older,
            Kind::Strange { back } => back,
        };
        let newest_us = self.newest.map_or(0, |newest| newest.at_us);
        let Some((place, search)) = self.search(seen, grid).filter(|(_, search)| search.found >= SEARCH_CYCLES) else {
            return Step::Search;
        };
        let both_speak = newest_us > search.began_us;
        if !both_speak && at_us.saturating_sub(newest_us) < QUIET_US {
            return Step::Search;
        }
        if both_speak || back {
            self.searches[place] = None;
            return Step::Stranger;
        }
        *self = Self { newest: Some(seen), taken: 1, ..Self::default() };
        Step::Restarted
    }

    /// Returns whether a timestamp continues the earlier ones or may be late. The arguments are those of
    /// [`judge`](Self::judge).
    #[must_use]
    pub fn fits(&self, timestamp: u32, at_us: u64, grid: bool, early_us: i64) -> bool {
        !matches!(self.kind(Seen { timestamp, at_us }, grid, early_us), Kind::Strange { .. })
    }

    fn kind(&self, seen: Seen, grid: bool, early_us: i64) -> Kind {
        let Some(newest) = self.newest else { return Kind::Newest { missed: 0 } };
        let passed_us = seen.at_us.saturating_sub(newest.at_us);
        let ahead_us = if self.taken < SEARCH_CYCLES { SLACK_US } else { AHEAD_US };
        let in_time = early_us <= ahead_us.saturating_add(drift_us(passed_us)).cast_signed();
        match freshness(Some(newest.timestamp), seen.timestamp) {
            Freshness::Frozen => Kind::Same,
            Freshness::Fresh { missed } if in_time => Kind::Newest { missed },
            Freshness::Irregular if in_time && !grid => Kind::Newest { missed: 0 },
            Freshness::Restarted if u64::from(seen.timestamp) * 1_000 > passed_us.saturating_add(RESTART_SLACK_US) => {
                if early_us < -LATE_US.cast_signed() {
                    Kind::Strange { back: true }
                } else {
                    Kind::Older
                }
            }
            _ => Kind::Strange { back: false },
        }
    }

    fn search(&mut self, seen: Seen, grid: bool) -> Option<(usize, Search)> {
        let passed_us = |search: &Search| seen.at_us.saturating_sub(search.last.at_us);
        let continues = |search: &Search| match freshness(Some(search.last.timestamp), seen.timestamp) {
            Freshness::Fresh { .. } => passed_us(search) <= LATE_US && is_in_time(search.last, seen),
            Freshness::Irregular => !grid && passed_us(search) <= LATE_US && is_in_time(search.last, seen),
            _ => false,
        };
        let known = self.searches.iter().position(|search| search.as_ref().is_some_and(continues));
        if known.is_none() && self.searches.iter().flatten().any(|search| search.last.timestamp == seen.timestamp) {
            // An object of the same cycle has already continued a search with this timestamp.
            return None;
        }
        let oldest = || (0..SEARCHES).min_by_key(|place| self.searches[*place].map(|search| search.last.at_us));
        let place = known.or_else(oldest)?;
        let before = self.searches[place].filter(|_| known.is_some());
        let began = Search { began_us: seen.at_us, last: seen, found: 1 };
        let search =
            before.map_or(began, |before| Search { last: seen, found: SEARCH_CYCLES.min(before.found + 1), ..before });
        self.searches[place] = Some(search);
        Some((place, search))
    }

    /// Returns the newest timestamp, ms.
    #[must_use]
    pub fn newest(&self) -> Option<u32> {
        self.newest.map(|seen| seen.timestamp)
    }
}

fn is_in_time(before: Seen, now: Seen) -> bool {
    let step_us = u64::from(now.timestamp.wrapping_sub(before.timestamp)) * 1_000;
    let passed_us = now.at_us.saturating_sub(before.at_us);
    step_us <= passed_us.saturating_add(drift_us(passed_us)).saturating_add(SLACK_US)
}

const fn drift_us(passed_us: u64) -> u64 {
    passed_us / profile::sequence::TOLERANCE_SHARE as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::age::Ages;

    const SECOND: u64 = 1_000_000;

    #[derive(Default)]
    struct Sender(Order, Ages);

    impl Sender {
        fn judge(&mut self, timestamp: u32, at_us: u64, grid: bool) -> Step {
            let early_us = self.1.early_us(timestamp, at_us, true);
            let step = self.0.judge(timestamp, at_us, grid, early_us);
            match step {
                Step::Restarted => self.1 = Ages::default(),
                Step::Newest { .. } => {}
                _ => return step,
            }
            self.1.take(timestamp, at_us, true);
            step
        }

        fn running() -> Self {
            let mut sender = Self::default();
            for tenth in 0..=600 {
                assert!(matches!(sender.judge(100 * tenth, 100_000 * u64::from(tenth), true), Step::Newest { .. }));
            }
            sender
        }
    }

    // Shows GND-8.
    #[test]
    fn forward_is_newer_back_is_older_and_the_same_is_the_same() {
        let mut order = Sender::default();
        let mut judge = |timestamp, at| order.judge(timestamp, at, true);
        assert_eq!(judge(60_000, 0), Step::Newest { missed: 0 });
        assert_eq!(judge(60_010, 10_000), Step::Newest { missed: 0 });
        assert_eq!(judge(60_050, 10_001), Step::Newest { missed: 3 });
        assert_eq!(judge(60_050, 10_002), Step::Same);
        assert_eq!(judge(60_040, 10_003), Step::Older);
        assert_eq!(judge(60_060, 10_004), Step::Newest { missed: 0 });
        assert_eq!(judge(53_100, 3 * SECOND), Step::Older, "10 s late or less: of before");
        assert_eq!(judge(50_000, 3 * SECOND), Step::Search, "no carrier holds anything back for so long");
    }

    #[test]
    fn a_restart_is_believed_after_three_cycles_in_a_row() {
        let mut order = Sender::default();
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
    fn no_inserted_timestamp_is_believed_and_none_keeps_the_right_ones_out() {
        let mut order = Sender::default();
        let mut at = 0;
        for cycle in 0..1_000_u32 {
            at += 10_000;
            let strange = [cycle * 10 + 3_600_000, 5, cycle * 10 + 7, 0][cycle as usize % 4];
            assert!(matches!(order.judge(10 * cycle + 70_000, at, true), Step::Newest { missed: 0 }), "{cycle}");
            let step = order.judge(strange, at, true);
            assert!(matches!(step, Step::Search | Step::Older | Step::Stranger), "{strange}: {step:?}");
        }
    }

    #[test]
    fn a_burst_between_two_messages_takes_nobodys_place() {
        for ahead in [1_900, 3_600_000] {
            let mut order = Sender::running();
            for burst in 0..5 {
                assert_eq!(order.judge(60_000 + ahead + 10 * burst, 60 * SECOND + 1, true), Step::Search, "{ahead}");
            }
            assert_eq!(order.judge(60_100, 60_100_000, true), Step::Newest { missed: 9 });
        }
        for (third, step) in [(QUIET_US - 1, Step::Search), (QUIET_US, Step::Restarted)] {
            let mut order = Sender::running();
            for burst in 1..=2_u32 {
                let at = 60 * SECOND + u64::from(burst);
                assert_eq!(order.judge(3_660_000 + 10 * burst, at, true), Step::Search, "{third}");
            }
            assert_eq!(order.judge(3_660_030, 60 * SECOND + third, true), step, "{third}");
        }
    }

    #[test]
    fn what_goes_back_is_a_restarts_or_late_up_to_the_limits() {
        let judged = |timestamp, early_us| {
            let mut order = Order::default();
            order.judge(60_000, 0, true, 0);
            order.judge(timestamp, SECOND, true, early_us)
        };
        // The earlier sender's last message may have been on its way for half a second. The restarted sender may have
        // started when that message left.
        assert_eq!([1_500, 1_510].map(|timestamp| judged(timestamp, -1)), [Step::Search, Step::Older]);
        let late = LATE_US.cast_signed();
        assert_eq!([-late, -late - 1].map(|early_us| judged(5_000, early_us)), [Step::Older, Step::Search]);
    }

    #[test]
    fn timestamps_off_the_grid_continue_no_search() {
        let mut order = Order::default();
        order.judge(60_000, 0, true, 0);
        let steps = [900_005, 900_012, 900_019].map(|timestamp| order.judge(timestamp, SECOND, true, 0));
        assert_eq!(steps, [Step::Search; 3]);
    }

    #[test]
    fn the_sample_that_proves_a_restart_counts_as_the_first() {
        for (more, step) in [(1, Step::Newest { missed: 0 }), (2, Step::Search)] {
            let mut order = Order::default();
            order.judge(60_000, 0, true, 0);
            let steps = [10, 20, 30].map(|ms| order.judge(ms, SECOND + u64::from(ms) * 1_000, true, 0));
            assert_eq!(steps[2], Step::Restarted);
            for nth in 1..=more {
                order.judge(30 + 10 * nth, SECOND + 40_000 + u64::from(nth), true, 0);
            }
            let early = AHEAD_US.cast_signed() + 500_000;
            assert_eq!(order.judge(40 + 10 * more, SECOND + 50_000, true, early), step, "{more}");
        }
    }

    #[test]
    fn who_speaks_beside_another_is_a_stranger_from_the_third_message_on() {
        for first in [10, 3_000_000] {
            let mut order = Sender::default();
            let mut found = vec![];
            for tenth in 0..20_u32 {
                let at = 100_000 * u64::from(tenth);
                assert!(matches!(order.judge(5_000_000 + 100 * tenth, at, true), Step::Newest { .. }));
                if tenth > 10 {
                    found.push(order.judge(first + 100 * (tenth - 10), at + 50_000, true));
                }
            }
            let expected = [Step::Search, Step::Search, Step::Stranger, Step::Search, Step::Search, Step::Stranger];
            assert_eq!(found[..6], expected, "{first}");
        }
    }

    #[test]
    fn an_old_recording_is_another_sender_even_in_silence() {
        let mut order = Sender::running();
        let steps = [30_000, 30_100, 30_200].map(|ms| order.judge(ms, 35 * SECOND + u64::from(ms) * 1_000, true));
        assert_eq!(steps, [Step::Search, Step::Search, Step::Stranger]);
        assert_eq!(order.judge(66_000, 66 * SECOND, true), Step::Newest { missed: 599 });
    }

    #[test]
    fn messages_that_continue_nothing_hide_no_stranger() {
        let mut order = Sender::running();
        let mut found = vec![];
        for tenth in 1..8_u32 {
            let at = 60 * SECOND + 100_000 * u64::from(tenth);
            order.judge(60_000 + 100 * tenth, at, true);
            for junk in 0..3 {
                order.judge(900_000_000 - 30_000_000 * (tenth * 3 + junk), at + 1, true);
            }
            found.push(order.judge(9_000_000 + 100 * tenth, at + 2, true));
        }
        assert!(found.contains(&Step::Stranger), "{found:?}");
    }

    #[test]
    fn two_strangers_that_speak_in_turn_are_both_found() {
        let mut order = Sender::running();
        let mut found = vec![];
        for tenth in 1..=3_u32 {
            let at = 60 * SECOND + 100_000 * u64::from(tenth);
            assert!(matches!(order.judge(60_000 + 100 * tenth, at, true), Step::Newest { .. }));
            found.extend([9_000_000, 19_000_000].map(|first| order.judge(first + 100 * tenth, at + 1, true)));
        }
        assert_eq!(found, [Step::Search, Step::Search, Step::Search, Step::Search, Step::Stranger, Step::Stranger]);
    }

    #[test]
    fn an_unexplained_step_is_believed_after_three_in_a_row() {
        let mut order = Sender::default();
        let mut judge = |timestamp, at| order.judge(timestamp, at, true);
        assert_eq!(judge(1_000, 0), Step::Newest { missed: 0 });
        let steps = [1_115, 1_225, 1_335].map(|timestamp| judge(timestamp, u64::from(timestamp - 1_000) * 1_000));
        assert_eq!(steps, [Step::Search, Step::Search, Step::Restarted]);
        let steps = [900_005, 900_015, 900_025].map(|timestamp| judge(timestamp, SECOND));
        assert_eq!(steps, [Step::Search, Step::Search, Step::Restarted]);
    }

    #[test]
    fn a_search_continues_only_within_the_clocks_drift_and_slack() {
        let seen = |timestamp, at_us| Seen { timestamp, at_us };
        assert!(is_in_time(seen(0, SECOND), seen(12_200, 11 * SECOND)));
        assert!(!is_in_time(seen(0, SECOND), seen(12_201, 11 * SECOND)));
    }

    #[test]
    fn a_clock_without_a_grid_may_advance_by_anything() {
        let mut order = Sender::default();
        assert_eq!(order.judge(1_000, 0, false), Step::Newest { missed: 0 });
        assert_eq!(order.judge(1_013, 1_000, false), Step::Newest { missed: 0 });
        let steps = [3, 7, 11].map(|timestamp| order.judge(timestamp, SECOND, false));
        assert_eq!(steps, [Step::Search, Step::Search, Step::Restarted]);
    }

    #[test]
    fn a_long_silence_explains_a_long_step_and_timestamps_may_wrap() {
        let mut order = Sender::default();
        assert_eq!(order.judge(u32::MAX - 5, 0, true), Step::Newest { missed: 0 });
        assert_eq!(order.judge(4, 10_000, true), Step::Newest { missed: 0 });
        assert_eq!(order.judge(3_600_004, 3_600 * SECOND, true), Step::Newest { missed: 359_999 });
    }
}
