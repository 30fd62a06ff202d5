//! Faults of the base station: it shows wrong objects or wrong ages, or raises no alarm.

use profile::Layout;

/// A fault of the base station.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BaseFault {
    /// The base station shows every object of a profile as valid, even an invalid one.
    ShowsAll,
    /// The base station does not show this object: 0 for Reported-Position, n for GPSn.
    Hides(usize),
    /// The base station shows every object as new.
    Young,
    /// The base station raises no alarm.
    Calm,
}

impl BaseFault {
    /// Returns the fault's name in the event log.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::ShowsAll => "shows all",
            Self::Hides(_) => "hides one",
            Self::Young => "young",
            Self::Calm => "calm",
        }
    }

    /// Returns the objects that the faulty base station shows as valid, in place of `shown`: bit 0 is
    /// Reported-Position, bit n is GPSn.
    #[must_use]
    pub fn shows(self, shown: u8, layout: Layout) -> u8 {
        match self {
            Self::ShowsAll => (0..layout.objects()).fold(0, |all, object| all | 1 << object),
            Self::Young | Self::Calm => shown,
            Self::Hides(object) => shown & !1_u8.checked_shl(u32::try_from(object).unwrap_or(u32::MAX)).unwrap_or(0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_base_station_that_shows_all_shows_each_object_of_its_profile() {
        for (receivers, all) in [(1, 0b11), (3, 0b1111), (5, 0b11_1111)] {
            assert_eq!(BaseFault::ShowsAll.shows(0, Layout::for_receivers(receivers).unwrap()), all);
        }
    }

    #[test]
    fn a_base_station_that_hides_an_object_shows_the_others() {
        let layout = Layout::for_receivers(3).unwrap();
        assert_eq!(BaseFault::Hides(0).shows(0b1111, layout), 0b1110);
        assert_eq!(BaseFault::Hides(2).shows(0b0111, layout), 0b0011);
        assert_eq!(BaseFault::Hides(2).shows(0b1011, layout), 0b1011, "one that is not valid");
        assert_eq!(BaseFault::Hides(9).shows(0b1111, layout), 0b1111, "one that does not exist");
    }
}
