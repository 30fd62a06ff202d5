//! The measured figures of a run. An empty series has no figures, because zeros would look like good ones.

use std::collections::BTreeMap;

use profile::ReportedStatus;
use serde::Serialize;

/// The least and the greatest value of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Span {
    /// The least value of the series.
    pub min: u64,
    /// The greatest value of the series.
    pub max: u64,
}

impl Span {
    /// Returns the span of a series; `None` for an empty one.
    pub fn of(series: impl IntoIterator<Item = u64>) -> Option<Self> {
        series.into_iter().fold(None, |span: Option<Self>, value| {
            Some(span.map_or(Self { min: value, max: value }, |span| Self {
                min: span.min.min(value),
                max: span.max.max(value),
            }))
        })
    }

    /// Returns the difference of the greatest and the least value.
    #[must_use]
    pub const fn width(self) -> u64 {
        self.max - self.min
    }
}

/// Quantiles of a series by nearest rank.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Quantiles {
    /// The median of the series.
    pub p50: u64,
    /// The value that 99.9 % of the series do not exceed.
    pub p999: u64,
    /// The greatest value of the series.
    pub max: u64,
}

impl Quantiles {
    /// Returns the quantiles of a series; `None` for an empty one.
    pub fn of(series: impl IntoIterator<Item = u64>) -> Option<Self> {
        let mut sorted: Vec<u64> = series.into_iter().collect();
        sorted.sort_unstable();
        let rank = |per_mille: usize| {
            let position = (sorted.len() * per_mille).div_ceil(1000).saturating_sub(1);
            sorted.get(position).copied()
        };
        Some(Self { p50: rank(500)?, p999: rank(999)?, max: rank(1000)? })
    }
}

/// The greatest value of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Max {
    /// The greatest value of the series.
    pub max: u64,
}

impl Max {
    /// Returns the greatest value of a series; `None` for an empty one.
    pub fn of(series: impl IntoIterator<Item = u64>) -> Option<Self> {
        series.into_iter().max().map(|max| Self { max })
    }
}

/// The faults that were injected, and their consequences.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Faults {
    /// The number of injected faults of each kind.
    pub injected: BTreeMap<String, u64>,
    /// The number of objects that were read as valid although HORUS never sent them, or although they were out of
    /// sequence, stale or expired.
    pub invalid_shown_valid: u64,
    /// The longest recovery, in cycles of 10 ms, rounded up: from the end of a disturbance until an object that HORUS
    /// sent after that end is read as valid. `None` without disturbances.
    pub max_recovery_cycles: Option<u64>,
    /// The longest recovery, as in `max_recovery_cycles`, from a disturbance after which no front end had to be brought
    /// up again.
    pub max_recovery_cycles_without_bring_up: Option<u64>,
}

/// The exclusion of a receiver by the voter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Exclusion {
    /// The receiver's number, from 1.
    pub receiver: usize,
    /// The instant, ns, of the tick of the first cycle whose objects call the receiver excluded.
    pub from_ns: u64,
    /// The instant, ns, of the tick of the first cycle without the exclusion, or of the restart that ended it; `None`
    /// if the exclusion lasted until the end of the run.
    pub until_ns: Option<u64>,
    /// The horizontal distance, m, from the farthest other receiver when the exclusion began; `None` if not known.
    pub away_m: Option<f64>,
    /// The distance in height, m, from the farthest other receiver when the exclusion began; `None` if not known.
    pub height_m: Option<f64>,
}

/// The results of HORUS's voter in the profiles that HORUS sent.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Voter {
    /// For each number of agreeing receivers, the number of cycles in which that many agreed.
    pub agree: BTreeMap<u64, u64>,
    /// The number of cycles in which fewer receivers agreed than are fitted.
    pub degraded: u64,
    /// The number of cycles without a position.
    pub none: u64,
    /// The largest horizontal error, mm, of a valid position against the aircraft's true position; `None` without such
    /// a position.
    pub worst_mm: Option<u64>,
    /// The exclusions in order of time; only the first [`Voter::MOST_EXCLUSIONS`] are kept.
    pub exclusions: Vec<Exclusion>,
}

impl Voter {
    /// The number of exclusions that are kept in [`Voter::exclusions`].
    pub const MOST_EXCLUSIONS: usize = 1_000;

    /// Counts the status of a Reported-Position that HORUS sent.
    pub(crate) fn reported(&mut self, status: ReportedStatus) {
        *self.agree.entry(status.receivers_agreeing().into()).or_default() += 1;
        self.degraded += u64::from(status.degraded());
        self.none += u64::from(!status.position_valid());
    }

    /// Records whether a receiver (from 0) is excluded at the tick `at`. Records its horizontal and vertical distance,
    /// m, from the other receivers too.
    pub(crate) fn excluded(&mut self, receiver: usize, at: u64, excluded: bool, away: Option<(f64, Option<f64>)>) {
        let of_this = |exclusion: &Exclusion| exclusion.receiver == receiver + 1 && exclusion.until_ns.is_none();
        match self.exclusions.iter().rposition(of_this) {
            Some(last) if !excluded => self.exclusions[last].until_ns = Some(at),
            None if excluded && self.exclusions.len() < Self::MOST_EXCLUSIONS => self.exclusions.push(Exclusion {
                receiver: receiver + 1,
                from_ns: at,
                until_ns: None,
                away_m: away.map(|(along, _)| along),
                height_m: away.and_then(|(_, height)| height),
            }),
            _ => {}
        }
    }
}

/// The figures of a run. Times are in ns unless stated otherwise.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Figures {
    /// The number of frames that HORUS sent to their last bit.
    pub frames_sent: u64,
    /// The bit rate of the last frame, bit/s; 0 if there was none.
    pub bit_rate: u64,
    /// The time from the first preamble bit to the last bit of the longest frame; 0 if there was none.
    pub air_time_ns: u64,
    /// The time between the first frames of two consecutive cycles.
    pub period_ns: Option<Span>,
    /// The time from the tick to the transmit command of the cycle's first frame.
    pub tick_to_command_ns: Option<Span>,
    /// The time from the tick to the first preamble bit of the cycle's first frame.
    pub tick_to_air_ns: Option<Span>,
    /// The time from a tick until a transaction could read the image that has the objects of that tick.
    pub sample_to_readable: Option<Quantiles>,
    /// The time from a cycle's last bit on the air until a transaction could read the image with the cycle's objects.
    pub last_bit_to_readable: Option<Max>,
    /// The time from the end of a transaction until the DPR can serve the next one.
    pub ready_ns: Option<Max>,
    /// The number of cycles whose Reported-Position was read with a valid position.
    pub valid_cycles: u64,
    /// If the last transactions read no valid position, the instant, ns, at which the first of them began. `None` if
    /// the last transaction read a valid position, or if no transaction ever did.
    pub invalid_since_ns: Option<u64>,
    /// The arrival of each receiver's last valid position, ns; `None` without one.
    pub last_solution_ns: Vec<Option<u64>>,
    /// The results of HORUS's voter.
    pub voter: Voter,
    /// The injected faults and their consequences.
    pub faults: Faults,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_that_occurred() {
        assert_eq!(Quantiles::of((1..=1000).rev()), Some(Quantiles { p50: 500, p999: 999, max: 1000 }));
        assert_eq!(Quantiles::of([7]), Some(Quantiles { p50: 7, p999: 7, max: 7 }));
    }

    #[test]
    fn one_outlier_in_a_thousand_is_the_maximum_and_not_the_p999() {
        let series = Quantiles::of(std::iter::repeat_n(5, 999).chain([9])).unwrap();
        assert_eq!((series.p999, series.max), (5, 9));
    }

    #[test]
    fn an_empty_series_has_no_figures() {
        assert_eq!((Span::of([]), Quantiles::of([]), Max::of([])), (None, None, None));
        assert_eq!(Span::of([5, 3, 9]).map(|span| (span.min, span.max, span.width())), Some((3, 9, 6)));
    }
}
