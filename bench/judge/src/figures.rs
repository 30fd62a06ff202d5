//! What was measured. A series that is empty has no figures, so that absence does not look like a good value.

use std::collections::BTreeMap;

use profile::ReportedStatus;
use serde::Serialize;

/// The least and the greatest of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Span {
    /// The least value.
    pub min: u64,
    /// The greatest value.
    pub max: u64,
}

impl Span {
    /// The span of a series; nothing of an empty one.
    pub fn of(series: impl IntoIterator<Item = u64>) -> Option<Self> {
        series.into_iter().fold(None, |span: Option<Self>, value| {
            Some(span.map_or(Self { min: value, max: value }, |span| Self {
                min: span.min.min(value),
                max: span.max.max(value),
            }))
        })
    }

    /// Peak to peak.
    #[must_use]
    pub const fn width(self) -> u64 {
        self.max - self.min
    }
}

/// Quantiles of a series: nearest rank, so each is a value that occurred.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Quantiles {
    /// The median.
    pub p50: u64,
    /// 99.9 % of the series are at or below this.
    pub p999: u64,
    /// The greatest value.
    pub max: u64,
}

impl Quantiles {
    /// The quantiles of a series; nothing of an empty one.
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

/// A greatest value alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Max {
    /// The greatest value.
    pub max: u64,
}

impl Max {
    /// The greatest of a series; nothing of an empty one.
    pub fn of(series: impl IntoIterator<Item = u64>) -> Option<Self> {
        series.into_iter().max().map(|max| Self { max })
    }
}

/// What faults were injected, and what came of them.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Faults {
    /// How many of each kind.
    pub injected: BTreeMap<String, u64>,
    /// How many objects were read as valid that HORUS never sent so, that were out of sequence, stale or expired.
    pub invalid_shown_valid: u64,
    /// The longest from the end of a cause to the first valid object of a cycle that HORUS sent after it, in cycles of
    /// 10 ms begun; `None` without causes.
    pub max_recovery_cycles: Option<u64>,
    /// The same over the causes after which no front end had to be brought up again.
    pub max_recovery_cycles_without_bring_up: Option<u64>,
}

/// A receiver was excluded.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Exclusion {
    /// Which, from 1.
    pub receiver: usize,
    /// The tick with whose objects it began, ns.
    pub from_ns: u64,
    /// The tick with whose objects it was over, or the restart that ended it, ns; `None` if it lasted to the run's end.
    pub until_ns: Option<u64>,
    /// How far it was from the farthest of the others when it began, along the ground, m; `None` if that is not known.
    pub away_m: Option<f64>,
    /// The same in height.
    pub height_m: Option<f64>,
}

/// What HORUS's voter did, over the profiles that HORUS sent.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Voter {
    /// Cycles in which so many receivers agree.
    pub agree: BTreeMap<u64, u64>,
    /// Cycles with fewer than are fitted.
    pub degraded: u64,
    /// Cycles without a position.
    pub none: u64,
    /// How far a valid position was from where the aircraft was at its tick, along the ground, mm: the worst; `None`
    /// where there was no position, or nobody knows where the aircraft was.
    pub worst_mm: Option<u64>,
    /// Who was excluded, in order of their beginnings: the first [`Voter::MOST_EXCLUSIONS`].
    pub exclusions: Vec<Exclusion>,
}

impl Voter {
    /// So many exclusions are kept.
    pub const MOST_EXCLUSIONS: usize = 1_000;

    /// HORUS sent a Reported-Position with this status.
    pub(crate) fn reported(&mut self, status: ReportedStatus) {
        *self.agree.entry(status.receivers_agreeing().into()).or_default() += 1;
        self.degraded += u64::from(status.degraded());
        self.none += u64::from(!status.position_valid());
    }

    /// Receiver (from 0) is `excluded` at the tick `at`, or not, and so far away from the others.
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

/// Figures of a run, ns unless said otherwise.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Figures {
    /// Frames whose last bit was on the air.
    pub frames_sent: u64,
    /// Bits per second of the last frame; 0 if there was none.
    pub bit_rate: u64,
    /// From the first preamble bit to the last bit of the longest frame; 0 if there was none.
    pub air_time_ns: u64,
    /// Between the first frames of two cycles in a row.
    pub period_ns: Option<Span>,
    /// From the tick to the transmit command of the cycle's first frame.
    pub tick_to_command_ns: Option<Span>,
    /// From the tick to the first preamble bit of the cycle's first frame.
    pub tick_to_air_ns: Option<Span>,
    /// From the tick that stamps the objects to the image that holds them being what the next transaction gets.
    pub sample_to_readable: Option<Quantiles>,
    /// From the cycle's last bit on the air to the same.
    pub last_bit_to_readable: Option<Max>,
    /// From chip select rising to the DPR being able to serve the next transaction.
    pub ready_ns: Option<Max>,
    /// Cycles of HORUS whose Reported-Position was read and had a valid position.
    pub valid_cycles: u64,
    /// When chip select fell for the first of the transactions that brought no valid position any more, ns; `None` if
    /// the last one brought one, or none ever did.
    pub invalid_since_ns: Option<u64>,
    /// For each receiver, when the last byte of its last valid position had crossed its line, ns.
    pub last_solution_ns: Vec<Option<u64>>,
    /// The voter.
    pub voter: Voter,
    /// Faults.
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
