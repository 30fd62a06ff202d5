//! How old data are whose way here nobody timed.
//!
//! # Design
//!
//! A sample's timestamp is HORUS's time; its arrival is the base station's. What lies between is the offset of the two
//! clocks and the delay of the way, and one number cannot tell them apart. But a delay only ever adds: the smallest
//! difference of arrival and timestamp that was seen belongs to the fastest way, and what a later sample exceeds it by
//! is delay. So a sample that a radio has held back for two seconds is two seconds older than one that it passed on at
//! once, and is told so when it arrives.
//!
//! What remains unknown is the fastest way's own delay: about 5 ms from sample to readable (README), up to a control
//! cycle of the flight controller, and the carrier's. Each age here is *at least* so much, and that much more.
//!
//! **Drift.** Two crystals differ, so the smallest difference must not be kept for ever: it is let rise by
//! [`CRYSTAL_DRIFT`] of the time that passes, and by [`NO_CRYSTAL_DRIFT`] while HORUS says that it runs without its
//! crystal. A HORUS whose clock is slower than that looks ever later, one that is faster ever earlier; both come out as
//! an [implausible clock](Ages::is_clock_implausible).

/// The most that a crystal of HORUS and one of a computer may differ by, parts per million: 100 each.
pub const CRYSTAL_DRIFT: i64 = 200;

/// The most that HORUS differs by without its crystal, parts per million: what [`profile::sequence`] allows, 2 %.
pub const NO_CRYSTAL_DRIFT: i64 = 1_000_000 / profile::sequence::TOLERANCE_SHARE as i64;

/// Over windows so long the two clocks are compared, µs.
pub const WINDOW_US: u64 = 30_000_000;

/// The smallest difference that was seen, and since when it may have risen.
#[derive(Clone, Copy, Debug)]
struct Floor {
    difference_us: i64,
    at_us: u64,
}

/// The smallest difference within a window.
#[derive(Clone, Copy, Debug)]
struct Window {
    began_us: u64,
    /// The smallest so far, and when.
    least: Floor,
    /// That of the window before, if there was one.
    before: Option<Floor>,
}

/// The memory of one HORUS's samples since it started.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ages {
    /// The last timestamp, and the same without wrapping, ms since the first.
    last: Option<(u32, i64)>,
    floor: Option<Floor>,
    window: Option<Window>,
    implausible: bool,
}

impl Ages {
    /// Takes a sample with this timestamp, ms, that arrived at `at_us`. `crystal` is whether HORUS runs on its crystal.
    /// Answers how much later it came than the fastest one, µs.
    pub fn take(&mut self, timestamp: u32, at_us: u64, crystal: bool) -> u64 {
        let unwrapped = match self.last {
            None => 0,
            // Less than half of the range either way, as `profile::freshness` has it.
            Some((last, unwrapped)) => unwrapped + i64::from(timestamp.wrapping_sub(last).cast_signed()),
        };
        self.last = Some((timestamp, unwrapped));
        let difference_us = at_us.cast_signed().saturating_sub(unwrapped.saturating_mul(1_000));
        let drift = if crystal { CRYSTAL_DRIFT } else { NO_CRYSTAL_DRIFT };
        let risen = self.floor.map(|floor| {
            let passed = i64::try_from(at_us.saturating_sub(floor.at_us)).unwrap_or(i64::MAX);
            floor.difference_us.saturating_add(passed.saturating_mul(drift) / 1_000_000)
        });
        let here = Floor { difference_us, at_us };
        let late_us = risen.map_or(0, |risen| difference_us.saturating_sub(risen).max(0));
        if late_us == 0 {
            self.floor = Some(here);
        }
        self.compare(here);
        late_us.unsigned_abs()
    }

    /// Whether HORUS's clock and the base station's differed by more than 2 % over the last two windows. A delay of the
    /// carrier that grows by more than 0.6 s and stays looks the same.
    #[must_use]
    pub const fn is_clock_implausible(&self) -> bool {
        self.implausible
    }

    fn compare(&mut self, here: Floor) {
        let window = self.window.get_or_insert(Window { began_us: here.at_us, least: here, before: None });
        if here.difference_us <= window.least.difference_us {
            window.least = here;
        }
        if here.at_us.saturating_sub(window.began_us) < WINDOW_US {
            return;
        }
        let least = window.least;
        if let Some(before) = window.before {
            let rise = least.difference_us.saturating_sub(before.difference_us).unsigned_abs();
            let passed = least.at_us.saturating_sub(before.at_us).max(WINDOW_US);
            self.implausible = rise.saturating_mul(u64::from(profile::sequence::TOLERANCE_SHARE)) > passed;
        }
        self.window = Some(Window { began_us: here.at_us, least: here, before: Some(least) });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_is_as_late_as_it_came_after_the_fastest() {
        let mut ages = Ages::default();
        assert_eq!(ages.take(1_000, 5_000_000, true), 0);
        assert_eq!(ages.take(1_010, 5_030_000, true), 19_994, "20 ms, less 200 ppm of 30 ms");
        assert_eq!(ages.take(1_020, 5_015_000, true), 0, "5 ms earlier than any before");
        assert_eq!(ages.take(1_030, 5_030_000, true), 4_997);
        // Held back: reordered samples are judged by their own timestamps.
        assert_eq!(ages.take(1_000, 5_995_000, true), 999_804);
    }

    #[test]
    fn timestamps_may_wrap() {
        let mut ages = Ages::default();
        assert_eq!(ages.take(u32::MAX - 5, 1_000_000, true), 0);
        assert_eq!(ages.take(4, 1_010_000, true), 0);
        assert_eq!(ages.take(14, 1_070_000, true), 49_988);
    }

    #[test]
    fn crystals_may_drift_apart_for_hours_and_without_a_crystal_by_2_percent() {
        for (ppm, crystal) in [(190, true), (-190, true), (19_000, false), (-19_000, false)] {
            let mut ages = Ages::default();
            for cycle in 0..720_000_u32 {
                let at = 10_000 * u64::from(cycle);
                let at = at.saturating_add_signed(at.cast_signed() / 1_000_000 * ppm);
                let late = ages.take(cycle * 10, at, crystal);
                assert!(late < 21_000, "{ppm} ppm, cycle {cycle}: {late}");
                assert!(!ages.is_clock_implausible(), "{ppm} ppm, cycle {cycle}");
            }
        }
    }

    #[test]
    fn a_clock_that_is_wrong_by_more_than_2_percent_is_found_within_two_windows_and_forgiven_later() {
        for sign in [1, -1] {
            let mut ages = Ages::default();
            let mut at = 0;
            let mut first = None;
            for cycle in 0..18_000_u32 {
                let step: i64 = if cycle < 9_000 { 10_000 + 250 * sign } else { 10_000 };
                at += step.unsigned_abs();
                ages.take(cycle * 10, at, true);
                if ages.is_clock_implausible() {
                    first.get_or_insert(at);
                }
            }
            assert!(first.is_some_and(|first| first <= 2 * WINDOW_US + 20_500), "{first:?}");
            assert!(!ages.is_clock_implausible());
        }
    }
}
