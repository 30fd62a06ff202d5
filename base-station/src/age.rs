//! Determines the age of data whose delay on the way was not measured.
//!
//! A sample's timestamp is HORUS's time; its arrival is the base station's. Their difference is the offset of the two
//! clocks plus the delay on the way. Delays are never negative, so the smallest difference belongs to the sample with
//! the shortest delay. The age of any other sample is its difference minus the smallest one. So a sample that a radio
//! held back for two seconds gets an age two seconds above that of a sample that passed at once.
//!
//! One sample must not define the shortest delay: an attacker who inserts one early sample could make all others look
//! late, for hours. So the smallest difference only changes when [`AGREEING`] samples have smaller ones, over at least
//! [`AGREE_US`] and at most [`WITHIN_US`]. The new value is the largest of these. The first [`AGREEING`] samples count
//! at once.
//!
//! The shortest delay itself remains unknown. It consists of about 5 ms from sample to readable (docs/figures.md), up
//! to a control cycle of the flight controller, and the delay of the carrier. True ages exceed the ages here by the
//! shortest delay.
//!
//! **Drift.** Two crystals differ, so the smallest difference rises by [`CRYSTAL_DRIFT`] of the time that passes, or by
//! [`NO_CRYSTAL_DRIFT`] while HORUS reports that it runs without its crystal. If HORUS's clock differs by more, samples
//! seem to come ever later or ever earlier. This is reported as an [implausible clock](Ages::is_clock_implausible).

/// The greatest difference between HORUS's crystal and a computer's, parts per million: 100 for each of them.
pub const CRYSTAL_DRIFT: i64 = 200;

/// The greatest error of HORUS's clock without its crystal, parts per million: 2 %, as [`profile::sequence`] allows.
pub const NO_CRYSTAL_DRIFT: i64 = 1_000_000 / profile::sequence::TOLERANCE_SHARE as i64;

/// The length of the windows over which the two clocks are compared, µs.
pub const WINDOW_US: u64 = 30_000_000;

/// The number of samples that must have a smaller difference before the smallest difference changes.
pub const AGREEING: u8 = 3;

/// The shortest time, µs, from the first to the last of the [`AGREEING`] samples, so that a burst of messages does not
/// suffice.
pub const AGREE_US: u64 = 1_000_000;

/// The longest time, µs, from the first to the last of the [`AGREEING`] samples.
pub const WITHIN_US: u64 = 10_000_000;

/// The samples whose difference of arrival and timestamp is below the smallest one, kept while they are fewer than
/// [`AGREEING`].
#[derive(Clone, Copy, Debug)]
struct Lower {
    began_us: u64,
    count: u8,
    largest_us: i64,
}

/// The smallest difference of arrival and timestamp. From the instant `at_us` on, the drift of the clocks raises it.
#[derive(Clone, Copy, Debug)]
struct Floor {
    difference_us: i64,
    at_us: u64,
}

#[derive(Clone, Copy, Debug)]
struct Window {
    began_us: u64,
    least: Floor,
    before: Option<Floor>,
}

/// Compares the timestamps of one HORUS with the instants at which they arrive, from that HORUS's start on.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ages {
    /// The last timestamp, ms: as it arrived, and counted on without wrapping.
    last: Option<(u32, i64)>,
    floor: Option<Floor>,
    lower: Option<Lower>,
    taken: u8,
    window: Option<Window>,
    implausible: bool,
}

impl Ages {
    /// Records a sample with this timestamp, ms, that arrived at `at_us`. `crystal` says whether HORUS runs on its
    /// crystal. Returns the sample's delay beyond the shortest delay, µs.
    pub fn take(&mut self, timestamp: u32, at_us: u64, crystal: bool) -> u64 {
        let (unwrapped, difference_us) = self.difference(timestamp, at_us);
        // Two objects with the same timestamp belong to one sample, so only the first counts.
        let another = self.last.is_none_or(|(last, _)| last != timestamp);
        self.last = Some((timestamp, unwrapped));
        let floor_us = self.floor_us(at_us, crystal);
        let here = Floor { difference_us, at_us };
        if another && floor_us.is_none_or(|floor_us| difference_us < floor_us) {
            self.lower(here);
        }
        self.taken = AGREEING.min(self.taken + u8::from(another));
        self.compare(Floor { difference_us: difference_us.max(floor_us.unwrap_or(difference_us)), at_us });
        floor_us.map_or(0, |floor_us| difference_us.saturating_sub(floor_us).max(0)).unsigned_abs()
    }

    /// Returns how much earlier, µs, this sample came than a sample with the shortest delay; negative if it came later.
    /// The arguments are those of [`take`](Self::take).
    #[must_use]
    pub fn early_us(&self, timestamp: u32, at_us: u64, crystal: bool) -> i64 {
        let (_, difference_us) = self.difference(timestamp, at_us);
        self.floor_us(at_us, crystal).map_or(0, |floor_us| floor_us.saturating_sub(difference_us))
    }

    fn difference(&self, timestamp: u32, at_us: u64) -> (i64, i64) {
        let unwrapped = match self.last {
            None => 0,
            // A timestamp is assumed to advance or go back by less than half of its range, as in `profile::freshness`.
            Some((last, unwrapped)) => unwrapped + i64::from(timestamp.wrapping_sub(last).cast_signed()),
        };
        (unwrapped, at_us.cast_signed().saturating_sub(unwrapped.saturating_mul(1_000)))
    }

    fn floor_us(&self, at_us: u64, crystal: bool) -> Option<i64> {
        let drift = if crystal { CRYSTAL_DRIFT } else { NO_CRYSTAL_DRIFT };
        self.floor.map(|floor| {
            let passed = i64::try_from(at_us.saturating_sub(floor.at_us)).unwrap_or(i64::MAX);
            floor.difference_us.saturating_add(passed.saturating_mul(drift) / 1_000_000)
        })
    }

    fn lower(&mut self, here: Floor) {
        let since = |lower: &Lower| here.at_us.saturating_sub(lower.began_us);
        let before = self.lower.filter(|lower| since(lower) <= WITHIN_US);
        let lower = before.map_or(Lower { began_us: here.at_us, count: 1, largest_us: here.difference_us }, |lower| {
            let largest_us = lower.largest_us.max(here.difference_us);
            Lower { count: AGREEING.min(lower.count + 1), largest_us, ..lower }
        });
        self.lower = Some(lower);
        if self.taken < AGREEING {
            self.floor = Some(here);
            self.lower = None;
        } else if lower.count >= AGREEING && since(&lower) >= AGREE_US {
            self.floor = Some(Floor { difference_us: lower.largest_us, ..here });
            self.lower = None;
        }
    }

    /// Returns whether HORUS's clock and the base station's differed by more than 2 % over the last two windows. A
    /// carrier's delay that grows by more than 0.6 s for good has the same effect.
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
        assert_eq!(ages.take(1_000, 5_995_000, true), 999_804);
    }

    #[test]
    fn early_samples_make_others_late_only_if_several_agree() {
        let mut ages = Ages::default();
        for cycle in 0..10_u32 {
            ages.take(100 * cycle, 100_000 * u64::from(cycle), true);
        }
        for (at, timestamps) in [(1_000_000, &[2_900][..]), (1_100_000, &[2_980, 2_990, 3_000])] {
            for timestamp in timestamps {
                assert_eq!(ages.take(*timestamp, at, true), 0);
            }
            let own = u32::try_from(at / 1_000).unwrap();
            assert!(ages.take(own, at, true) < 1_000, "the true one is on time");
        }
        assert_eq!(ages.early_us(2_900, 1_200_000, true), 1_700_200, "and the drift of a second");
        // From now on samples come 200 or 210 ms earlier than before. After a second the shortest delay therefore
        // counts as 200 ms shorter.
        let mut late = vec![];
        for cycle in 130..150_u32 {
            let at = 100_000 * u64::from(cycle) - 200_000 - u64::from(cycle % 2) * 10_000;
            ages.take(100 * cycle, at, true);
            late.push(-ages.early_us(100 * cycle, at + 200_000, true) / 1_000);
        }
        let believed = late.iter().position(|late| *late > 100).unwrap();
        assert_eq!((believed, late[18]), (10, 199), "{late:?}");
    }

    #[test]
    fn smaller_differences_that_are_far_apart_are_no_agreement() {
        let mut ages = Ages::default();
        for second in 0..120_u32 {
            let at = 1_000_000 * u64::from(second) + 500_000;
            let early = if second % 6 == 5 { 300_000 } else { 0 };
            assert!(ages.take(1_000 * second, at - early, true) < 25_000, "{second}");
        }
    }

    #[test]
    fn a_clock_without_a_crystal_may_be_off_by_2_percent() {
        for (crystal, expected) in [(true, 990_000 - 2_000), (false, 990_000 - 200_000)] {
            let mut ages = Ages::default();
            ages.take(0, 0, crystal);
            assert_eq!(ages.take(10, 10_000_000 + 1_000_000 - 1_000_000, crystal), 9_990_000 - (990_000 - expected));
        }
    }

    #[test]
    fn a_window_is_compared_by_its_fastest_sample() {
        let mut ages = Ages::default();
        for cycle in 0..9_000_u32 {
            let held = if cycle % 4 == 3 && cycle > 3_000 && cycle < 6_000 { 900_000 } else { 0 };
            ages.take(10 * cycle, 10_000 * u64::from(cycle) + held, true);
            assert!(!ages.is_clock_implausible(), "{cycle}");
        }
    }

    #[test]
    fn a_rise_is_compared_with_the_time_between_the_two_fastest_samples() {
        let mut ages = Ages::default();
        for half in 0..=122_u32 {
            // The smallest delay is 0 at the start and 1 s after 58 s. This rise is less than 2 % of the time between
            // them.
            let late = match half {
                0 => 0,
                1..60 => 300_000,
                60..116 => 2_000_000,
                _ => 1_000_000,
            };
            ages.take(500 * half, 500_000 * u64::from(half) + late, true);
            assert!(!ages.is_clock_implausible(), "{half}");
        }
    }

    #[test]
    fn a_clock_off_by_just_2_percent_is_plausible() {
        // HORUS's clock falls behind by `more` ms in each window of 30 s. 600 ms are 2 % of a window.
        for (more, implausible) in [(600, false), (601, true)] {
            let mut ages = Ages::default();
            for window in 0..=2_u32 {
                ages.take(window * (30_000 - more), u64::from(window) * WINDOW_US, true);
            }
            assert_eq!(ages.is_clock_implausible(), implausible, "{more} ms");
        }
    }

    #[test]
    fn late_samples_among_the_first_make_none_early() {
        let mut ages = Ages::default();
        assert_eq!(ages.take(1_000, 5_000_000, true), 0);
        assert_eq!(ages.take(1_010, 5_030_000, true), 19_994);
        assert_eq!(ages.take(1_020, 5_040_000, true), 19_992);
        assert_eq!(ages.early_us(1_030, 5_030_000, true), 6);
    }

    #[test]
    fn timestamps_may_wrap() {
        let mut ages = Ages::default();
        assert_eq!(ages.take(u32::MAX - 5, 1_000_000, true), 0);
        assert_eq!(ages.take(4, 1_010_000, true), 0);
        assert_eq!(ages.take(14, 1_070_000, true), 49_988);
    }

    #[test]
    fn drift_within_tolerance_makes_no_sample_old() {
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
    fn a_clock_off_by_over_2_percent_is_reported_within_two_windows() {
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
