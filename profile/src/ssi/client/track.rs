//! Follows HORUS's sequence on the flight controller's clock, and determines which position may be shown.
use super::view::{Prefix, Shown};
use super::{AGE_UNKNOWN, Config, Report, Verdict};
use crate::sequence::{MAX_MISSED, SEARCH_CYCLES, TOLERANCE_SHARE};
use crate::{CYCLE_MS, Freshness, LinkStatus, ReportedPosition, ReportedValues, freshness};

/// The time after an image's publication at which the DPR stops showing the image, µs (docs/design.md#publication).
pub const EXPIRY_US: u32 = 25_000;

/// The tolerance, µs, between the instant at which a sample is read and its timestamp; 2 % of the step are added. It is
/// the sum of the time for which an image can be read and the link's tolerance in [`sequence`](crate::sequence).
pub const TOLERANCE_US: u32 = EXPIRY_US + crate::sequence::TOLERANCE_US;

#[derive(Clone, Copy, Debug)]
pub(super) struct Brought<'a> {
    pub(super) busy: bool,
    /// Whether the transaction read a window that does not begin with the map's first 96 bytes.
    pub(super) another: bool,
    pub(super) intact: bool,
    pub(super) prefix: Option<Prefix<'a>>,
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    timestamp: u32,
    /// The earliest instant, µs, at which the sample could have been read, judged by earlier samples.
    due_us: u64,
    read_us: u64,
    /// The age of the sample when it was read, at `read_us`, µs.
    age_us: u32,
}

impl Sample {
    fn age_us(&self, now_us: u64) -> u32 {
        // The subtraction fails if the flight controller's clock was set back. The age is then unknown.
        now_us.checked_sub(self.read_us).map_or(AGE_UNKNOWN, |since| sum_us(self.age_us, since))
    }
}

#[derive(Clone, Debug)]
pub(super) struct Track {
    last: Option<Sample>,
    found: u8,
    /// The last sample's values, if the sample may be shown. Its position need not be valid.
    shown: Option<ReportedValues>,
    /// The DPR's timestamp in the last intact Link-Status, and the instant of reading that Link-Status, µs. The
    /// timestamp identifies the image.
    image: Option<(u32, u64)>,
    /// The instant, µs, of the last reading with intact data. Before the first such reading, it is that of the first
    /// transaction.
    intact_us: Option<u64>,
}

impl Track {
    pub(super) const fn new() -> Self {
        Self { last: None, found: 0, shown: None, image: None, intact_us: None }
    }

    /// The report of a transaction that began at `began_us`, with the last edge of FRESH at `fresh_us`; both µs.
    pub(super) fn report(
        &mut self,
        config: &Config,
        brought: Brought<'_>,
        began_us: u64,
        fresh_us: Option<u64>,
    ) -> Report {
        let prefix = brought.prefix.filter(|_| !brought.another & !brought.busy);
        let link = prefix.and_then(|prefix| prefix.link.ok());
        let verdict = match (link, prefix.map(|prefix| prefix.reported)) {
            (Some(link), Some(Shown::Intact(reported))) => self.sample(config, link, reported, began_us, fresh_us),
            (Some(_), Some(Shown::Vacant)) => Verdict::Empty,
            _ if brought.busy => Verdict::Busy,
            _ if brought.another => Verdict::Window,
            _ => Verdict::Damaged,
        };
        if let Some(link) = link {
            self.image = Some((link.timestamp(), began_us));
        }
        if link.is_some() | (brought.another & brought.intact) | self.intact_us.is_none() {
            self.intact_us = Some(began_us);
        }
        let quiet_us = self.intact_us.map_or(0, |intact_us| began_us.saturating_sub(intact_us));
        let silent = quiet_us > u64::from(config.silence_us) && matches!(verdict, Verdict::Busy | Verdict::Damaged);
        let age_us = self.last.map_or(AGE_UNKNOWN, |last| last.age_us(began_us));
        if is_too_old(age_us, config) {
            self.shown = None;
        }
        Report {
            verdict: if silent { Verdict::Silent } else { verdict },
            position: self.shown.filter(|values| values.status.position_valid()),
            status: self.shown.map(|values| values.status),
            age_us,
            link: link.map(LinkStatus::values),
        }
    }

    fn sample(
        &mut self,
        config: &Config,
        link: &LinkStatus,
        reported: &ReportedPosition,
        began_us: u64,
        fresh_us: Option<u64>,
    ) -> Verdict {
        let timestamp = reported.timestamp();
        if let Some(last) = self.last.filter(|last| last.timestamp == timestamp) {
            return if is_too_old(last.age_us(began_us), config) { Verdict::Stale } else { Verdict::Same };
        }
        let due_us = self.last.and_then(|last| due_us(&last, timestamp, began_us));
        let sample = Sample {
            timestamp,
            due_us: due_us.unwrap_or(began_us),
            read_us: began_us,
            age_us: self.age_us(link, began_us, fresh_us),
        };
        let first = self.last.is_none();
        self.last = Some(sample);
        self.found = if due_us.is_some() { SEARCH_CYCLES.min(self.found + 1) } else { 0 };
        let values = reported.values().checked();
        let verdict = if due_us.is_none() & !first {
            Verdict::OutOfSequence
        } else if self.found < SEARCH_CYCLES {
            Verdict::Searching
        } else if !values.status.position_valid() {
            Verdict::Invalid
        } else if is_too_old(sample.age_us, config) {
            Verdict::Stale
        } else {
            Verdict::Fresh
        };
        self.shown = matches!(verdict, Verdict::Fresh | Verdict::Invalid).then_some(values);
        verdict
    }

    /// The greatest possible age, µs, of the sample in an image that is read for the first time.
    fn age_us(&self, link: &LinkStatus, began_us: u64, fresh_us: Option<u64>) -> u32 {
        let units = link.values().age_100us;
        // The age in Link-Status is rounded down, so the true age is less than one unit above it. The highest value
        // stands for that age or more.
        let published_us = if units == u16::MAX { AGE_UNKNOWN } else { 100 * (u32::from(units) + 1) };
        // If the previous reading showed another image, the present image was published after that reading.
        let before_us = self.image.filter(|(image, _)| *image != link.timestamp()).map(|(_, read_us)| read_us);
        let since = |instant: Option<u64>| instant.and_then(|instant| began_us.checked_sub(instant));
        let bounds = [since(fresh_us), since(before_us)];
        let shown_us = bounds.into_iter().flatten().fold(u64::from(EXPIRY_US), u64::min);
        sum_us(published_us, shown_us)
    }
}

/// Returns the earliest instant, µs, at which the sample of `timestamp` could have been read. Returns `None` if this
/// sample, which was read at `read_us`, does not continue `last`.
fn due_us(last: &Sample, timestamp: u32, read_us: u64) -> Option<u64> {
    let Freshness::Fresh { missed: missed @ 0..=MAX_MISSED } = freshness(Some(last.timestamp), timestamp) else {
        return None;
    };
    let step_us = 1_000 * u64::from(CYCLE_MS) * (1 + u64::from(missed));
    let drift_us = step_us / u64::from(TOLERANCE_SHARE);
    let tolerance_us = u64::from(TOLERANCE_US) + drift_us;
    let due_us = last.due_us.saturating_add(step_us);
    if due_us.abs_diff(read_us) > tolerance_us {
        return None;
    }
    // If this sample is read earlier than expected, earlier samples were read late, so the expected instant moves to
    // this reading. It moves to a later instant by at most 2 % of the step, because HORUS's clock may be slower by that
    // much.
    Some(read_us.min(due_us.saturating_add(drift_us)))
}

fn is_too_old(age_us: u32, config: &Config) -> bool {
    age_us > config.age_limit_us || age_us == AGE_UNKNOWN
}

/// Adds `since_us` to the age `age_us`, µs; the sum is at most [`AGE_UNKNOWN`].
pub(super) fn sum_us(age_us: u32, since_us: u64) -> u32 {
    u32::try_from(u64::from(age_us).saturating_add(since_us)).unwrap_or(AGE_UNKNOWN)
}
