//! Follows Hold-Status on the flight controller's clock.
use super::{AGE_UNKNOWN, Shown, View, track::sum_us};
use crate::HoldValues;
use crate::hold::{EXPIRY_MS, FRAME_NS};

/// The time after which an unchanged Hold-Status is old, µs: the DPR shows none for longer.
const EXPIRY_US: u32 = 1_000 * EXPIRY_MS;

/// The air time of the hold's frame, µs, rounded up: the age of its object on arrival at the DPR.
pub const HOLD_FRAME_US: u32 = {
    let [b0, b1, b2, b3, ..] = FRAME_NS.div_ceil(1_000).to_le_bytes();
    u32::from_le_bytes([b0, b1, b2, b3])
};

/// Whether the flight controller has a Hold-Status to use.
///
/// The numbers of the cases equal those of `horus_dpr_hold_shown_t` in C.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum HoldShown {
    /// The DPR shows no Hold-Status, or none was read yet.
    Absent = 0,
    /// The last Hold-Status is unchanged for over 300 ms: it was not read again, or the hold or the DPR hangs.
    Old = 1,
    /// The flight controller has a Hold-Status that is not old.
    Valid = 2,
}

impl HoldShown {
    /// All cases, in the order of their numbers.
    pub const ALL: [Self; 3] = [Self::Absent, Self::Old, Self::Valid];
}

/// What is known of the hold after a transaction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HoldReport {
    /// Whether there is a Hold-Status.
    pub shown: HoldShown,
    /// The last Hold-Status, if it is [valid](HoldShown::Valid). Unknown values in it are NaN.
    pub values: Option<HoldValues>,
    /// An upper bound of the age of the last Hold-Status when the transaction began, µs, counted from the first bit of
    /// the hold's frame. Without a Hold-Status it is [`AGE_UNKNOWN`].
    pub age_us: u32,
}

#[derive(Clone, Copy, Debug)]
struct Last {
    values: HoldValues,
    read_us: u64,
    /// The greatest possible age, µs, of this Hold-Status when it was read at `read_us`.
    age_us: u32,
}

/// Follows Hold-Status from transaction to transaction; to be used with a [`Client`](super::Client).
#[derive(Clone, Debug, Default)]
pub struct HoldTrack {
    last: Option<Last>,
    /// The instant, µs, of the last reading that showed an intact Hold-Status, or 0x00 or 0xFF throughout in its place.
    looked_us: Option<u64>,
}

impl HoldTrack {
    /// Returns the state in which no Hold-Status was read yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { last: None, looked_us: None }
    }

    /// The report of a transaction that began at `began_us` and read `view`. If the transaction did not read
    /// Hold-Status, met a busy DPR or read damaged bytes, the last Hold-Status only becomes older.
    pub fn read(&mut self, view: &View<'_>, began_us: u64) -> HoldReport {
        let place = view.hold().filter(|_| !view.is_busy());
        match place {
            Some(Shown::Intact(status))
                if self.last.is_some_and(|last| last.values.timestamp == status.timestamp()) => {}
            Some(Shown::Intact(status)) => {
                // The DPR published this Hold-Status after the previous reading, and at most [`EXPIRY_US`] before this
                // one.
                let since_us = self.looked_us.and_then(|looked_us| began_us.checked_sub(looked_us));
                let shown_us = since_us.map_or(u64::from(EXPIRY_US), |since_us| since_us.min(EXPIRY_US.into()));
                let age_us = sum_us(HOLD_FRAME_US, shown_us);
                self.last = Some(Last { values: status.values(), read_us: began_us, age_us });
            }
            Some(Shown::Vacant) => self.last = None,
            Some(Shown::Damaged(_)) | None => {}
        }
        if matches!(place, Some(Shown::Intact(_) | Shown::Vacant)) {
            self.looked_us = Some(began_us);
        }
        let Some(last) = self.last else {
            return HoldReport { shown: HoldShown::Absent, values: None, age_us: AGE_UNKNOWN };
        };
        // The subtraction fails if the flight controller's clock was set back. The age is then unknown.
        let since_us = began_us.checked_sub(last.read_us);
        let is_valid = since_us.is_some_and(|since_us| since_us <= EXPIRY_US.into());
        HoldReport {
            shown: if is_valid { HoldShown::Valid } else { HoldShown::Old },
            values: is_valid.then_some(last.values),
            age_us: since_us.map_or(AGE_UNKNOWN, |since_us| sum_us(last.age_us, since_us)),
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::{vec, vec::Vec};

    use super::*;
    use crate::criticality::{ActiveLoad, Writer};
    use crate::ssi::Request;
    use crate::{HoldStatus, Layout};

    fn object(timestamp: u32) -> [u8; 64] {
        *HoldStatus::seal(Writer::<ActiveLoad>::claim(), &HoldValues::absent(timestamp)).as_bytes()
    }

    fn read(track: &mut HoldTrack, bytes: &[u8], began_us: u64) -> (HoldShown, Option<u32>, u32) {
        let layout = Layout::for_receivers(3).expect("a profile").with_hold();
        let window = Request { offset: 468, length: 64 };
        let report = track.read(&View::new(layout, window, bytes), began_us);
        (report.shown, report.values.map(|values| values.timestamp), report.age_us)
    }

    #[test]
    fn there_is_none_before_the_first_and_in_a_vacant_place() {
        let mut track = HoldTrack::new();
        assert_eq!(read(&mut track, &[0; 64], 0), (HoldShown::Absent, None, AGE_UNKNOWN));
        assert_eq!(read(&mut track, &object(0), 40_000), (HoldShown::Valid, Some(0), 41_416));
        assert_eq!(read(&mut track, &[0; 64], 80_000), (HoldShown::Absent, None, AGE_UNKNOWN));
        assert_eq!(read(&mut track, &object(0), 90_000), (HoldShown::Valid, Some(0), 11_416));
    }

    #[test]
    fn the_age_is_bounded_by_the_reading_before_and_by_the_expiry() {
        let mut track = HoldTrack::new();
        assert_eq!(read(&mut track, &object(0), 5), (HoldShown::Valid, Some(0), 301_416));
        assert_eq!(read(&mut track, &object(100), 250_005), (HoldShown::Valid, Some(100), 251_416));
        assert_eq!(read(&mut track, &object(200), 900_005), (HoldShown::Valid, Some(200), 301_416));
        assert_eq!(read(&mut track, &object(200), 950_005), (HoldShown::Valid, Some(200), 351_416));
    }

    #[test]
    fn one_that_stays_the_same_for_more_than_300_ms_is_old() {
        let mut track = HoldTrack::new();
        read(&mut track, &object(100), 1_000_000);
        assert_eq!(read(&mut track, &object(100), 1_300_000), (HoldShown::Valid, Some(100), 601_416));
        assert_eq!(read(&mut track, &object(100), 1_300_001), (HoldShown::Old, None, 601_417));
        assert_eq!(read(&mut track, &object(200), 1_310_001), (HoldShown::Valid, Some(200), 11_416));
        assert_eq!(read(&mut track, &object(200), u64::MAX), (HoldShown::Old, None, AGE_UNKNOWN));
    }

    #[test]
    fn a_transaction_that_does_not_show_its_place_lets_it_age() {
        let mut damaged = object(200);
        damaged.reverse();
        let others: [Vec<u8>; 4] = [vec![0xFF; 64], damaged.to_vec(), vec![], vec![0; 63]];
        for other in others {
            let mut track = HoldTrack::new();
            read(&mut track, &[0; 64], 0);
            read(&mut track, &object(100), 10_000);
            assert_eq!(read(&mut track, &other, 100_000), (HoldShown::Valid, Some(100), 101_416));
            assert_eq!(read(&mut track, &object(200), 110_000), (HoldShown::Valid, Some(200), 101_416));
            assert_eq!(read(&mut track, &other, 410_001), (HoldShown::Old, None, 401_417));
        }
    }

    #[test]
    fn a_clock_that_is_set_back_makes_the_age_unknown() {
        let mut track = HoldTrack::new();
        read(&mut track, &object(100), 500_000);
        assert_eq!(read(&mut track, &object(100), 499_999), (HoldShown::Old, None, AGE_UNKNOWN));
        assert_eq!(read(&mut track, &object(200), 400_000), (HoldShown::Valid, Some(200), 301_416));
    }

    #[test]
    fn a_layout_without_a_hold_has_none() {
        let layout = Layout::for_receivers(3).expect("a profile");
        let report = HoldTrack::new().read(&View::new(layout, Request { offset: 468, length: 64 }, &object(0)), 0);
        assert_eq!((report.shown, report.values, report.age_us), (HoldShown::Absent, None, AGE_UNKNOWN));
    }
}
