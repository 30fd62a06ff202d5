//! Sequence: determines which arriving cycles continue the ones before them, and may therefore be shown.
//!
//! A CRC proves that an object is intact, an identifier that it is where it belongs. Neither proves that it is new: the
//! objects of a repeated, delayed, reordered or inserted frame verify. The timestamp and the receiver's own clock
//! protect against these errors (IEC 61784-3: unintended repetition, unacceptable delay, incorrect sequence,
//! insertion). A receiver keeps one [`Sequence`] and passes each cycle to it. A [`Sequence`] has no clock and allocates
//! nothing, and its work per cycle is bounded.
//!
//! A cycle is **in sequence** under two conditions. Its timestamp is that of the last cycle + 10 ms · (1 + missed),
//! with at most [`MAX_MISSED`] missed cycles. On the receiver's clock, the time between the two samples is the same
//! step, within [`TOLERANCE_US`] plus [2 %](TOLERANCE_SHARE) of the step. The last cycle is the last one that arrived,
//! whether it was in sequence or not.
//!
//! **Search.** A search begins at the start, and after any cycle that is not in sequence. It ends with the last of
//! [`SEARCH_CYCLES`] cycles in a row. The timestamp of each must advance by exactly 10 ms, and its sample must be 10 ms
//! ± [`SEARCH_TOLERANCE_US`] later. No cycle is shown before that. The first cycle of a search has no predecessor and
//! does not count. The last one is in sequence:
//!
//! | cycle since the start, or since HORUS restarted | [`Judgement`] |
//! |---|---|
//! | 1 | `Searching { found: 0 }`, or `Restarted` |
//! | 2 | `Searching { found: 1 }` |
//! | 3 | `Searching { found: 2 }` |
//! | 4 | `InSequence { missed: 0 }` |
//!
//! For example, no cycle of timestamps 20, 10, 20, 10, … is ever shown.
//!
//! **Clock.** A single step may deviate by up to 27 % (2.5 ms + 2 % of 10 ms), because one cycle may be late for many
//! reasons. The error of a wrong clock adds up. So while cycles are in sequence, the timestamps' advance is compared
//! with the receiver's clock over consecutive windows of [`CLOCK_WINDOW_US`]. A difference of more than 2 % makes
//! HORUS's clock implausible until a later window has no such difference. A window closes with the first cycle at least
//! 1 s after its start. A clock that becomes wrong, or right again, is detected within two windows: 2.1 s, or 2.6 s if
//! as many cycles as possible are missed. A window that ends because the sequence is lost has no result.
//!
//! Instants are u64 µs, which never wrap (584 000 years). A u32 counter wraps, so two cycles 71.6 minutes apart would
//! look like neighbours.
//!
//! # Example
//!
//! ```
//! use profile::sequence::{Judgement, Sequence};
//!
//! let mut sequence = Sequence::new();
//! // The arguments are the timestamp in ms, and the instant of the sample on the receiver's clock in µs.
//! assert_eq!(sequence.judge(500, 70_000), Judgement::Searching { found: 0 });
//! assert_eq!(sequence.judge(510, 80_004), Judgement::Searching { found: 1 });
//! assert_eq!(sequence.judge(520, 90_001), Judgement::Searching { found: 2 });
//! assert_eq!(sequence.judge(530, 100_003), Judgement::InSequence { missed: 0 });
//! assert_eq!(sequence.judge(560, 130_000), Judgement::InSequence { missed: 2 });
//! assert_eq!(sequence.judge(560, 140_000), Judgement::Frozen);
//! assert!(!sequence.is_held(140_000));
//! ```
use crate::{CYCLE_MS, Freshness, freshness};

/// The greatest number of missing cycles between two cycles that are in sequence.
pub const MAX_MISSED: u32 = 25;

/// The tolerance, µs, for the difference between the receiver's time from one cycle to the next and the timestamps'
/// step; [`TOLERANCE_SHARE`] is added. It is a quarter of a cycle: enough for a late transmission and a late interrupt,
/// and too short to mistake one step for another.
pub const TOLERANCE_US: u32 = 2_500;

/// The timestamps' step is divided by this number for a second tolerance, 2 %. HORUS without its crystal deviates by 1
/// %.
pub const TOLERANCE_SHARE: u32 = 50;

/// The tolerance, µs in both directions, for the 10 ms between two cycles during a search.
pub const SEARCH_TOLERANCE_US: u32 = 500;

/// The number of cycles in a row that must each advance by exactly one cycle before cycles are shown.
pub const SEARCH_CYCLES: u8 = 3;

/// The least length, µs, of the windows over which HORUS's clock is compared with the receiver's.
pub const CLOCK_WINDOW_US: u32 = 1_000_000;

/// The time without a cycle after which the sequence is lost, µs: the longest step with its tolerance.
pub const HOLD_US: u32 = step_us(MAX_MISSED) + tolerance_us(MAX_MISSED);

/// The time between two cycles with `missed` missing ones between them, µs.
const fn step_us(missed: u32) -> u32 {
    1_000 * CYCLE_MS * (1 + missed)
}

/// The tolerance for the receiver's time between two cycles with `missed` missing ones between them, µs.
const fn tolerance_us(missed: u32) -> u32 {
    TOLERANCE_US + step_us(missed) / TOLERANCE_SHARE
}

/// The judgement of a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Judgement {
    /// The cycle continues the cycles before it, and may be shown.
    InSequence {
        /// The number of cycles that did not arrive between the last cycle and this one, at most [`MAX_MISSED`].
        missed: u32,
    },
    /// The cycle is the first of all, or comes while the sequence is searched for.
    Searching {
        /// The number of cycles in a row, including this one, that have advanced as the search requires: less than
        /// [`SEARCH_CYCLES`].
        found: u8,
    },
    /// The cycle repeats the last timestamp: HORUS is frozen, or a frame is repeated.
    Frozen,
    /// The cycle's timestamp is before the last one: HORUS has restarted, or frames are reordered.
    Restarted,
    /// The timestamp is ahead of the last one, but not by a whole number of cycles, or by so much that more than
    /// [`MAX_MISSED`] cycles are missing.
    Irregular,
    /// The timestamp is ahead of the last one by a possible step, but the cycle comes too early for that step.
    Early,
    /// The timestamp is ahead of the last one by a possible step, but the cycle comes too late for that step.
    Late,
}

impl Judgement {
    /// Whether the cycle may be shown.
    #[must_use]
    pub const fn is_in_sequence(self) -> bool {
        matches!(self, Self::InSequence { .. })
    }
}

/// A cycle's sample: its timestamp, and its instant on the receiver's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Sample {
    /// The timestamp that HORUS gave the sample, ms, wraps.
    pub timestamp: u32,
    /// The instant of the sample on the receiver's clock, µs, never wraps.
    pub sampled_us: u64,
}

impl Sample {
    /// The time on the receiver's clock from this sample to `to_us`, µs; negative if `to_us` is earlier.
    #[must_use]
    pub const fn elapsed_us(&self, to_us: u64) -> i64 {
        to_us.wrapping_sub(self.sampled_us).cast_signed()
    }
}

/// What a receiver keeps about the cycles that have arrived, to judge the next cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sequence {
    last: Option<Sample>,
    /// The number of cycles in a row that have advanced as the search requires; [`SEARCH_CYCLES`] while cycles are in
    /// sequence.
    found: u8,
    /// The first sample of the window over which the clocks are compared. It has no meaning while cycles are not in
    /// sequence.
    window: Sample,
    /// Whether the clocks differed over the last complete window; false unless cycles are in sequence.
    clock_implausible: bool,
}

impl Sequence {
    /// The state before any cycle has arrived.
    #[must_use]
    pub const fn new() -> Self {
        Self { last: None, found: 0, window: Sample { timestamp: 0, sampled_us: 0 }, clock_implausible: false }
    }

    /// Judges a cycle. Call this for each cycle in the order of arrival. `timestamp` is HORUS's, ms. `sampled_us` is
    /// the instant of the sample on the receiver's clock, µs, from a counter that never wraps. The instant of arrival
    /// may be used instead if it is a constant time later.
    pub fn judge(&mut self, timestamp: u32, sampled_us: u64) -> Judgement {
        // Not covered: only this line, in the path behind the second frame of a cycle (`Acceptance::enter`), which only
        // a profile of five receivers has.
        let judgement = self.classify(timestamp, sampled_us);
        let sample = Sample { timestamp, sampled_us };
        let held = self.found == SEARCH_CYCLES;
        self.last = Some(sample);
        self.found = match judgement {
            Judgement::InSequence { .. } => SEARCH_CYCLES,
            Judgement::Searching { found } => found,
            _ => 0,
        };
        if held && judgement.is_in_sequence() {
            self.compare_clocks(sample);
        } else {
            self.window = sample;
            self.clock_implausible = false;
        }
        judgement
    }

    /// Whether the sequence is found and not lost at `now_us`. It is false during the search, and after [`HOLD_US`]
    /// without a cycle.
    #[must_use]
    pub fn is_held(&self, now_us: u64) -> bool {
        let in_time = |last: Sample| last.elapsed_us(now_us) <= i64::from(HOLD_US);
        // Not covered: only this line, a sequence that is found without a last cycle: `judge` sets both at once, so
        // only a flipped bit leaves one without the other.
        self.found == SEARCH_CYCLES && self.last.is_some_and(in_time)
    }

    /// Whether HORUS's clock differed from the receiver's by more than 2 % over the last complete window. False during
    /// the search.
    #[must_use]
    pub const fn is_clock_implausible(&self) -> bool {
        self.clock_implausible
    }

    /// The sample of the last cycle that arrived, whatever its judgement was.
    #[must_use]
    pub const fn last(&self) -> Option<Sample> {
        self.last
    }

    fn classify(&self, timestamp: u32, sampled_us: u64) -> Judgement {
        let Some(last) = self.last else { return Judgement::Searching { found: 0 } };
        let missed = match freshness(Some(last.timestamp), timestamp) {
            Freshness::Frozen => return Judgement::Frozen,
            Freshness::Restarted => return Judgement::Restarted,
            Freshness::Fresh { missed } if missed <= MAX_MISSED => missed,
            Freshness::Fresh { .. } | Freshness::Irregular | Freshness::First => return Judgement::Irregular,
        };
        // Not covered: only this line, the limits of the subtraction: both numbers are µs since a start, far below the
        // range of 64 bits.
        let late_us = last.elapsed_us(sampled_us).saturating_sub(i64::from(step_us(missed)));
        let deviation_us = late_us.unsigned_abs();
        if deviation_us > u64::from(tolerance_us(missed)) {
            return if late_us.is_negative() { Judgement::Early } else { Judgement::Late };
        }
        let exact = missed == 0 && deviation_us <= u64::from(SEARCH_TOLERANCE_US);
        let found = if exact { self.found.saturating_add(1) } else { 0 };
        if self.found == SEARCH_CYCLES || found == SEARCH_CYCLES {
            Judgement::InSequence { missed }
        } else {
            Judgement::Searching { found }
        }
    }

    fn compare_clocks(&mut self, sample: Sample) {
        let receiver_us = self.window.elapsed_us(sample.sampled_us);
        if receiver_us >= i64::from(CLOCK_WINDOW_US) {
            let horus_us = 1_000 * i64::from(sample.timestamp.wrapping_sub(self.window.timestamp));
            let difference_us = (horus_us - receiver_us).saturating_abs();
            self.clock_implausible = difference_us * i64::from(TOLERANCE_SHARE) > receiver_us;
            self.window = sample;
        }
    }
}
