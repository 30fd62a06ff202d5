//! Measures how soon after its tick and its last bit a cycle is readable, and keeps the objects of the last cycles.

use std::collections::{BTreeMap, VecDeque};

use profile::Layout;
use profile::air::LEN_BYTES;

use crate::bounds;
use crate::read::Frame;
use crate::{Findings, Max, Quantiles, Violation};

/// The number of cycles that are kept. Together they last much longer than an image stays readable.
const REMEMBERED: usize = 100;

/// The number of ticks that are kept. A frame is sent within its cycle, so a few are enough.
const TICKS: usize = 4;

#[derive(Clone, Debug, Default)]
struct Cycle {
    stamp: u32,
    /// The instant, ns, of the cycle's tick; `None` if there was no tick before its first frame.
    tick: Option<u64>,
    started: [Option<u64>; 2],
    /// The instant, ns, at which the last bit of the cycle's last frame reached the DPR's antenna; `None` for a delayed
    /// frame.
    last_bit: Option<u64>,
    /// Whether the DPR may have missed the cycle's last frame.
    may_be_missed: bool,
    /// The longest time, ns, from the cycle's last bit until the cycle must be readable; `None` if the usual limit
    /// applies.
    ///
    /// The DPR needs longer if a damaged LEN keeps it from reading the frame early. It also needs longer if it missed
    /// the second frame and waits for it.
    longer: Option<u64>,
    readable: bool,
    late: bool,
    /// The objects of the cycle; bit 0 is Reported-Position, bit n is GPSn.
    objects: u8,
    profile: Vec<u8>,
}

#[derive(Clone, Debug, Default)]
pub(super) struct Cycles {
    cycles: VecDeque<Cycle>,
    ticks: VecDeque<u64>,
    samples: Series,
    last_bit: Option<u64>,
}

impl Cycles {
    pub(super) fn tick(&mut self, at: u64) {
        if self.ticks.len() == TICKS {
            self.ticks.pop_front();
        }
        self.ticks.push_back(at);
    }

    pub(super) fn sent(&mut self, layout: Layout, frame: &Frame, started: u64) {
        let (Some(stamp), Some(number)) = (frame.timestamp(), frame.number) else { return };
        if self.cycles.back().is_none_or(|cycle| cycle.stamp != stamp) {
            let mut profile = match self.cycles.len() {
                REMEMBERED => self.cycles.pop_front().unwrap_or_default().profile,
                _ => vec![],
            };
            profile.resize(layout.profile_len(), 0);
            self.cycles.push_back(Cycle { stamp, profile, ..Cycle::default() });
        }
        let Some(cycle) = self.cycles.back_mut() else { return };
        if let Some(begun) = cycle.started.get_mut(number) {
            begun.get_or_insert(started);
        }
        if number == 0 && cycle.tick.is_none() {
            let before = self.ticks.iter().rev().find(|tick| **tick <= started);
            cycle.tick = before.copied().filter(|tick| started - tick < bounds::CYCLE);
        }
        for object in frame.objects.iter().filter(|object| object.timestamp() == Some(stamp)) {
            let place = layout.in_profile(object.index).and_then(|place| cycle.profile.get_mut(place));
            if let Some(place) = place.filter(|place| place.len() == object.bytes.len()) {
                place.copy_from_slice(&object.bytes);
                cycle.objects |= 1 << object.index;
            }
        }
    }

    /// Records that the DPR's front end fails at `at`, ns, and so loses each frame that the DPR has not read.
    pub(super) fn front_end_fails(&mut self, at: u64) {
        let handed_over = |last_bit: &u64| last_bit + bounds::STORE_AND_FORWARD <= at;
        for cycle in &mut self.cycles {
            cycle.last_bit = cycle.last_bit.filter(handed_over);
        }
    }

    /// Records a whole frame whose last bit reached the antenna at `ended`. `len` is the frame's LEN, or `None` if the
    /// DPR may be unable to read it. `may_be_missed` states whether the DPR may miss the frame.
    pub(super) fn heard(
        &mut self,
        layout: Layout,
        frame: &Frame,
        len: Option<u8>,
        (started, ended): (u64, u64),
        may_be_missed: bool,
    ) {
        let fits = len.is_some_and(|len| usize::from(len) == frame.payload.len() + LEN_BYTES);
        let (Some(stamp), Some(number)) = (frame.timestamp(), frame.number) else { return };
        let Some(cycle) = self.cycle(stamp) else { return };
        let sent = cycle.started.get(number).copied().flatten();
        let undelayed = sent.is_some_and(|sent| sent.abs_diff(started) <= bounds::AIR_DELAY);
        let again = cycle.may_be_missed && cycle.last_bit.is_some();
        if (undelayed || again) && number + 1 == layout.frames() {
            cycle.may_be_missed = may_be_missed;
            cycle.last_bit = cycle.last_bit.filter(|_| !again).or(Some(ended));
            let waits = if layout.frames() > 1 { bounds::SECOND_FRAME } else { 0 };
            let first_alone = may_be_missed && layout.frames() > 1;
            cycle.longer = (!fits || first_alone).then_some(bounds::STORE_AND_FORWARD + waits);
        }
    }

    fn cycle(&mut self, stamp: u32) -> Option<&mut Cycle> {
        self.cycles.iter_mut().rev().find(|cycle| cycle.stamp == stamp)
    }

    /// Records that FRESH rose at `rose` and announced the cycle with the timestamp `stamp`.
    pub(super) fn readable(&mut self, stamp: u32, rose: u64, findings: &mut Findings) {
        let Some(cycle) = self.cycle(stamp).filter(|cycle| !cycle.readable) else { return };
        cycle.readable = true;
        let tick = cycle.tick;
        let Some(last_bit) = cycle.last_bit else { return };
        let Some(after_bit) = rose.checked_sub(last_bit) else { return };
        let longer = cycle.longer;
        let late = after_bit > longer.unwrap_or(bounds::LAST_BIT_TO_READABLE);
        cycle.late = late;
        if longer.is_none() {
            self.last_bit = self.last_bit.max(Some(after_bit));
        }
        if late {
            findings.add(Violation::LateReadable, rose, || format!("the cycle of {stamp} ms, after {after_bit} ns"));
        }
        if longer.is_some() {
            return;
        }
        let Some(after_tick) = tick.and_then(|tick| rose.checked_sub(tick)) else { return };
        self.samples.push(after_tick);
        if after_tick > bounds::SAMPLE_TO_READABLE && !late {
            findings.add(Violation::LateSample, rose, || format!("the cycle of {stamp} ms, after {after_tick} ns"));
        }
    }

    /// Records that a cycle was read before FRESH announced it. Returns whether the late announcement was already
    /// reported.
    pub(super) fn unannounced(&mut self, stamp: u32) -> bool {
        let Some(cycle) = self.cycle(stamp) else { return false };
        cycle.readable = true;
        cycle.late
    }

    /// Returns the bytes of object `index` in the last cycles.
    pub(super) fn objects(&self, layout: Layout, index: usize) -> impl Iterator<Item = &[u8]> + Clone {
        let place = layout.in_profile(index).unwrap_or_default();
        let sent = self.cycles.iter().filter(move |cycle| cycle.objects >> index & 1 == 1);
        sent.filter_map(move |cycle| cycle.profile.get(place.clone()))
    }

    pub(super) fn sample_to_readable(&self) -> Option<Quantiles> {
        self.samples.quantiles()
    }

    pub(super) fn last_bit_to_readable(&self) -> Option<Max> {
        Max::of(self.last_bit)
    }
}

/// A series of durations, ns. Each distinct value is stored once, with the number of times that it occurred.
#[derive(Clone, Debug, Default)]
struct Series {
    counts: BTreeMap<u64, u64>,
    length: u64,
}

impl Series {
    fn push(&mut self, value: u64) {
        *self.counts.entry(value).or_default() += 1;
        self.length += 1;
    }

    fn quantiles(&self) -> Option<Quantiles> {
        let rank = |per_mille: u64| {
            let mut left = (self.length * per_mille).div_ceil(1000);
            self.counts.iter().find_map(|(value, count)| {
                let found = left <= *count;
                left = left.saturating_sub(*count);
                found.then_some(*value)
            })
        };
        Some(Quantiles { p50: rank(500)?, p999: rank(999)?, max: rank(1000)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_counted_values_are_those_of_the_series() {
        let mut random = 1_u64;
        for length in [0, 1, 2, 3, 10, 999, 1000, 1001, 2500] {
            let mut series = Series::default();
            let values: Vec<u64> = (0..length)
                .map(|_| {
                    random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                    random >> 56
                })
                .collect();
            values.iter().for_each(|value| series.push(*value));
            assert_eq!(series.quantiles(), Quantiles::of(values), "{length}");
        }
    }
}
