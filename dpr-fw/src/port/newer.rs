//! Decides which timestamps of a writer are newer than those already accepted ([`profile::Uplink`] has the rule).

/// The number of refused timestamps in a row, each newer than the one before, after which the last one is accepted.
pub const ROW: u8 = 3;

/// The last timestamps of a writer's objects of one kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Timestamps {
    last: Option<u32>,
    /// The timestamp that was refused last, and the number of refused ones in a row, each newer than the one before.
    row: Option<(u32, u8)>,
}

/// Whether `timestamp` is newer than `than`: ahead of it by less than half of the 32-bit range.
const fn is_newer(timestamp: u32, than: u32) -> bool {
    let step = timestamp.wrapping_sub(than);
    step != 0 && step <= u32::MAX / 2
}

impl Timestamps {
    /// Returns the state in which no timestamp was accepted yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { last: None, row: None }
    }

    /// Records the timestamp, ms, of an intact object. Returns whether the object is accepted.
    pub fn accept(&mut self, timestamp: u32) -> bool {
        let row = match self.row {
            Some((before, row)) if is_newer(timestamp, before) => row + 1,
            _ => 1,
        };
        // Not covered: only this line, a row without an accepted timestamp: the first timestamp is always accepted, so
        // only a later one can begin a row.
        let accepted = self.last.is_none_or(|last| is_newer(timestamp, last)) || row == ROW;
        if accepted {
            *self = Self { last: Some(timestamp), row: None };
        } else {
            self.row = Some((timestamp, row));
        }
        accepted
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn accepted(timestamps: &[u32]) -> Vec<bool> {
        let mut known = Timestamps::new();
        timestamps.iter().map(|&timestamp| known.accept(timestamp)).collect()
    }

    // Shows PORT-5.
    #[test]
    fn only_a_newer_timestamp_is_accepted() {
        assert_eq!(accepted(&[700, 701, 701, 700, 690, 9_000]), [true, true, false, false, false, true]);
    }

    #[test]
    fn timestamps_wrap_and_half_of_their_range_and_more_ahead_is_back() {
        assert_eq!(accepted(&[u32::MAX, 0, 1]), [true; 3]);
        assert_eq!(accepted(&[5, 5 + (1 << 31) - 1]), [true, true]);
        assert_eq!(accepted(&[5, 5 + (1 << 31)]), [true, false]);
    }

    // Shows PORT-6.
    #[test]
    fn a_restarted_writer_is_accepted_at_its_third_object_in_a_row() {
        assert_eq!(accepted(&[9_000, 10, 20, 30, 40, 30]), [true, false, false, true, true, false]);
    }

    #[test]
    fn an_object_that_is_not_newer_begins_the_row_anew() {
        assert_eq!(accepted(&[9_000, 10, 20, 20, 30, 40]), [true, false, false, false, false, true]);
        assert_eq!(accepted(&[9_000, 10, 20, 9_001, 30, 40]), [true, false, false, true, false, false]);
        assert_eq!(accepted(&[9_000, 30, 20, 10, 5, 4]), [true, false, false, false, false, false]);
    }

    proptest! {
        #[test]
        fn a_replayed_timestamp_is_never_accepted(
            timestamps in prop::collection::vec(any::<u32>(), 1..30), replayed: prop::sample::Index,
        ) {
            let mut known = Timestamps::new();
            for &timestamp in &timestamps {
                if known.accept(timestamp) {
                    let mut replay = known;
                    prop_assert!(!replay.accept(timestamp));
                }
            }
            // An attacker repeats an accepted object again and again.
            let mut known = Timestamps::new();
            let mut last = 0;
            for (number, _) in (0_u32..).zip(&timestamps) {
                last = 1_000 + 10 * number;
                prop_assert!(known.accept(last));
            }
            let old = 1_000 + 10 * u32::try_from(replayed.index(timestamps.len())).expect("at most 30");
            for _ in 0..10 {
                prop_assert!(!known.accept(old), "{} after {}", old, last);
            }
        }
    }
}
