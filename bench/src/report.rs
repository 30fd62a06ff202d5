//! What a run of the link showed: the figures, and what it broke.
//!
//! Everything here is a function of the images, the seed and the flags, so two runs give the same bytes, but for
//! [`Speed`], which is the host's. Times are virtual nanoseconds. Figures that contain processor time hold for the
//! run's clock ([`Report::clock`]): on the fast one they are estimates, the other two bound what silicon takes.

use serde::Serialize;

/// The least and the greatest of a series.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Span {
    /// The least value, 0 for an empty series.
    pub min: u64,
    /// The greatest value, 0 for an empty series.
    pub max: u64,
}

impl Span {
    /// The span of a series.
    pub fn of(series: impl IntoIterator<Item = u64>) -> Self {
        series
            .into_iter()
            .fold(None, |span: Option<Self>, value| {
                Some(span.map_or(Self { min: value, max: value }, |span| Self {
                    min: span.min.min(value),
                    max: span.max.max(value),
                }))
            })
            .unwrap_or_default()
    }

    /// Peak to peak.
    pub const fn width(self) -> u64 {
        self.max - self.min
    }
}

/// Quantiles of a series: nearest rank, so each is a value that occurred.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Quantiles {
    /// The median.
    pub p50: u64,
    /// 99.9 % of the series are at or below this.
    pub p999: u64,
    /// The greatest value.
    pub max: u64,
}

impl Quantiles {
    /// The quantiles of a series; all 0 for an empty one.
    pub fn of(series: impl IntoIterator<Item = u64>) -> Self {
        let mut sorted: Vec<u64> = series.into_iter().collect();
        sorted.sort_unstable();
        let rank = |per_mille: usize| {
            let position = (sorted.len() * per_mille).div_ceil(1000).saturating_sub(1);
            sorted.get(position).copied().unwrap_or(0)
        };
        Self { p50: rank(500), p999: rank(999), max: rank(1000) }
    }
}

/// A greatest value alone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Max {
    /// The greatest value, 0 for an empty series.
    pub max: u64,
}

impl Max {
    /// The greatest of a series.
    pub fn of(series: impl IntoIterator<Item = u64>) -> Self {
        Self { max: series.into_iter().max().unwrap_or(0) }
    }
}

/// How fast the host ran it: the one part of a report that differs between runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Speed {
    /// Virtual time over wall time.
    pub times_real_time: f64,
}

/// The sending side.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Horus {
    /// Frames whose preamble went on the air.
    pub frames_sent: u64,
    /// Between the first frames of two cycles in a row.
    pub period_ns: Span,
    /// From the 10 ms timer's tick to the transmit command of the cycle's first frame: chip select rising after its
    /// byte. Its jitter is the firmware's.
    pub tick_to_command_ns: Span,
    /// From the same tick to the first preamble bit of the cycle's first frame. Its jitter is the firmware's and the
    /// scatter with which the front end starts.
    pub tick_to_air_ns: Span,
    /// The part of the time in which the core was awake.
    pub load: f64,
}

/// Between the antennas.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Air {
    /// Bits per second of the last frame.
    pub bit_rate: u64,
    /// From the first preamble bit to the last bit of the longest frame.
    pub air_time_ns: u64,
    /// Frames that arrived whole.
    pub frames_delivered: u64,
    /// Frames that arrived with at least one wrong bit.
    pub frames_damaged: u64,
    /// Frames that did not arrive.
    pub frames_lost: u64,
}

/// The receiving side, by the DPR's own counters.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Dpr {
    /// Objects that passed CRC, identifier and freshness.
    pub objects_accepted: u64,
    /// Objects that did not.
    pub objects_rejected: u64,
    /// Expirations of the missed-frame deadline.
    pub frames_missed: u64,
    /// Receive buffers scrubbed.
    pub scrubs: u64,
    /// Scrubs that found a bit stuck.
    pub scrub_faults: u64,
    /// The part of the time in which the core was awake.
    pub load: f64,
}

/// How old data is when it can be read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Latency {
    /// From the tick that stamps the objects to the image that holds them being what the next SSI transaction gets.
    pub sample_to_readable: Quantiles,
    /// From the cycle's last bit on the air to the same.
    pub last_bit_to_readable: Max,
}

/// The flight controller's port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Ssi {
    /// Transactions of the flight controller.
    pub transactions: u64,
    /// Transactions that brought a profile not seen before.
    pub fresh: u64,
    /// Transactions that brought the last profile again.
    pub repeated: u64,
    /// Transactions that met the DPR busy and read 0xFF throughout.
    pub busy: u64,
    /// Transactions in which something that claimed to be valid failed its CRC.
    pub bad_crc: u64,
    /// From CSN rising to the DPR being able to serve the next transaction.
    pub ready_ns: Max,
}

/// Reported-Position as the flight controller read it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Reported {
    /// Cycles of HORUS whose Reported-Position was read and had a valid position.
    pub valid_cycles: u64,
    /// When chip select fell for the first of the transactions that brought no valid position any more, ns; `None` if
    /// the last one brought one, or none ever did.
    pub invalid_since_ns: Option<u64>,
    /// For each receiver in turn, when the last byte of its last valid position had arrived at HORUS, ns; `None` if it
    /// sent none.
    pub last_solution_ns: Vec<Option<u64>>,
}

/// The far end of the radio.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Base {
    /// Profiles received.
    pub profiles: u64,
    /// Objects that failed a CRC there.
    pub bad_crc: u64,
}

/// A run of the link.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// The seed of everything random.
    pub seed: u64,
    /// What the cores' time costs: `fast`, `optimistic` or `pessimistic`. The last two bound what silicon takes.
    pub clock: &'static str,
    /// How long the run was.
    pub virtual_seconds: f64,
    /// Receivers in the profile.
    pub gps: usize,
    /// How fast the host ran it.
    pub speed: Speed,
    /// The sending side.
    pub horus: Horus,
    /// Between the antennas.
    pub air: Air,
    /// The receiving side.
    pub dpr: Dpr,
    /// How old data is when it can be read.
    pub latency_ns: Latency,
    /// The flight controller's port.
    pub ssi: Ssi,
    /// Reported-Position as the flight controller read it.
    pub reported: Reported,
    /// The far end of the radio.
    pub base: Base,
    /// Broken invariants, in words.
    pub violations: Vec<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_that_occurred() {
        let series = Quantiles::of((1..=1000).rev());
        assert_eq!(series, Quantiles { p50: 500, p999: 999, max: 1000 });
        assert_eq!(Quantiles::of([7]), Quantiles { p50: 7, p999: 7, max: 7 });
        assert_eq!(Quantiles::of([]), Quantiles::default());
    }

    #[test]
    fn one_outlier_in_a_thousand_is_the_maximum_and_not_the_p999() {
        let series = Quantiles::of(std::iter::repeat_n(5, 999).chain([9]));
        assert_eq!((series.p999, series.max), (5, 9));
    }

    #[test]
    fn a_span_holds_its_series() {
        assert_eq!(Span::of([5, 3, 9]), Span { min: 3, max: 9 });
        assert_eq!(Span::of([]).width(), 0);
    }
}
