//! Determines which values the counters of Link-Status may have.

use profile::air::Place;
use profile::{Layout, LinkValues};

use crate::bounds;
use crate::expectation::{Certainty, Delivery};

/// The number of frames that a DPR must count as missed, given the frames that it has received.
#[derive(Clone, Copy, Debug)]
struct Missed {
    frames: u64,
    /// The last frame that was certainly received: the instant of its sample, ns, its end, ns, and its number in the
    /// cycle.
    last: Option<(u64, u64, u64)>,
    total: u64,
    /// The number of further frames that the DPR may have missed since the last frame certainly received.
    perhaps: u64,
    /// The last frame that may have been received: the instant of its sample, ns, and its number in the cycle.
    maybe: Option<(u64, u64)>,
}

impl Missed {
    const fn new(layout: Layout) -> Self {
        Self { frames: layout.frames() as u64, last: None, total: 0, perhaps: 0, maybe: None }
    }

    /// Returns how many frames are overdue at the instant `at`, ns, after the last frame certainly received. The next
    /// cycle's frames are overdue after [`bounds::FRAME_DEADLINE`], the same cycle's second frame after
    /// [`bounds::SECOND_FRAME`].
    fn overdue(&self, at: u64) -> u64 {
        let Some((_, ended, number)) = self.last else { return 0 };
        let passed = at.saturating_sub(ended);
        if let Some(more) = passed.checked_sub(bounds::FRAME_DEADLINE) {
            self.frames * (1 + more / bounds::CYCLE)
        } else {
            u64::from(number + 1 < self.frames && passed >= bounds::SECOND_FRAME)
        }
    }

    /// Returns how many frames were due between the last frame certainly received and `frame`. `more`, ns, is a
    /// tolerance that is added to the time between their samples.
    fn between(&self, frame: &Delivery, more: i64) -> u64 {
        self.last.map_or(0, |(sampled, _, number)| self.due((sampled, number), frame, more))
    }

    fn due(&self, (sampled, number): (u64, u64), frame: &Delivery, more: i64) -> u64 {
        let apart = frame.sampled.saturating_sub(sampled).saturating_add_signed(more);
        let cycles = (apart + bounds::CYCLE / 2) / bounds::CYCLE;
        (cycles * self.frames + frame.number as u64).saturating_sub(number + 1)
    }

    /// Returns the greatest number of frames that the DPR may count as missed before `frame`.
    fn at_most(&self, frame: &Delivery, more: i64) -> u64 {
        let since_maybe = self.maybe.map_or(0, |maybe| self.perhaps + self.due(maybe, frame, more));
        self.between(frame, more).max(since_maybe).max(self.perhaps)
    }

    fn frame(&mut self, frame: &Delivery, band: i64) {
        let overdue = self.overdue(frame.ended.saturating_add_signed(band));
        self.total += self.at_most(frame, band).max(overdue);
        self.last = Some((frame.sampled, frame.ended, frame.number as u64));
        (self.perhaps, self.maybe) = (0, None);
    }

    fn maybe(&mut self, frame: &Delivery, band: i64) {
        self.perhaps = self.at_most(frame, band);
        self.maybe = Some((frame.sampled, frame.number as u64));
    }
}

/// The least and the greatest value of each counter of Link-Status since the DPR's start.
#[derive(Clone, Copy, Debug)]
pub(super) struct Counters {
    layout: Layout,
    accepted: [u64; 2],
    rejected: [u64; 2],
    received: [u64; 2],
    missed: [Missed; 2],
    sure: bool,
    /// The number of times that it was uncertain what the DPR counted.
    doubts: u64,
}

/// The counters in an image that was read, and their possible values at that time. The counters of later images are
/// compared with these.
#[derive(Clone, Copy, Debug)]
pub(super) struct Baseline {
    values: LinkValues,
    counters: Counters,
}

const BAND: i64 = bounds::SEQUENCE_BAND as i64;

impl Counters {
    pub(super) fn new(layout: Layout) -> Self {
        Self {
            layout,
            accepted: [0; 2],
            rejected: [0; 2],
            received: [0; 2],
            missed: [Missed::new(layout); 2],
            sure: false,
            doubts: 0,
        }
    }

    pub(super) fn frame(&mut self, frame: &Delivery) {
        let sure = frame.received == Certainty::Must;
        let of = |fate: Certainty| frame.objects.iter().filter(|(.., own)| *own >= fate).count() as u64;
        let (must, may, all) = (of(Certainty::Must), of(Certainty::May), u64::from(frame.places));
        self.accepted = [self.accepted[0] + must, self.accepted[1] + may];
        self.rejected = [self.rejected[0] + if sure { all - may } else { 0 }, self.rejected[1] + all - must];
        self.received = [self.received[0] + u64::from(sure), self.received[1] + 1];
        let [least, most] = &mut self.missed;
        let clear = least.between(frame, -BAND) == most.between(frame, BAND);
        self.sure |= sure;
        if self.sure {
            least.frame(frame, -BAND);
        }
        if sure || most.last.is_none() {
            most.frame(frame, BAND);
        } else {
            most.maybe(frame, BAND);
        }
        self.doubts += u64::from(!sure || must != may || !clear);
    }

    /// Returns the least and the greatest number of missed frames that an image published at `at`, ns, may state.
    fn missed(&self, at: u64, publication: u64) -> [u64; 2] {
        let [least, most] = &self.missed;
        let least = least.total + least.overdue(at.saturating_sub(publication + bounds::SEQUENCE_BAND));
        [least, most.total + most.overdue(at + bounds::SEQUENCE_BAND).max(most.perhaps)]
    }

    /// Returns whether an image published at `at`, ns, may have these counters. The image may also include one further
    /// frame, after which the counters are `next`.
    pub(super) fn fit(&self, values: &LinkValues, at: u64, publication: u64, next: Option<&Self>) -> bool {
        let missed = self.missed_until(at, publication, next);
        within(values.objects_accepted, self.accepted)
            && within(values.objects_rejected, self.rejected)
            && within(values.frames_received, self.received)
            && within(values.frames_missed, missed)
    }

    fn missed_until(&self, at: u64, publication: u64, next: Option<&Self>) -> [u64; 2] {
        let [least, most] = self.missed(at, publication);
        [least, next.map_or(most, |next| most.max(next.missed(at, publication)[1]))]
    }

    /// Returns whether the accepted and rejected objects add up to the objects of all frames received.
    pub(super) fn add_up(&self, values: &LinkValues) -> bool {
        let places = self.layout.frame(0).map_or(0, Place::count) as u64;
        u64::from(values.objects_accepted) + u64::from(values.objects_rejected)
            == places * u64::from(values.frames_received)
    }

    /// Returns the counters of this image, for the comparison with later images. Returns `None` if a frame was overdue
    /// at `at`, ns.
    pub(super) fn baseline(&self, values: &LinkValues, at: u64) -> Option<Baseline> {
        let overdue = self.missed.iter().any(|missed| missed.overdue(at + bounds::SEQUENCE_BAND) > 0);
        (!overdue).then_some(Baseline { values: *values, counters: *self })
    }

    /// Returns whether the counters may follow those in the earlier image `before`.
    pub(super) fn follow(
        &self,
        before: &Baseline,
        values: &LinkValues,
        at: u64,
        publication: u64,
        next: Option<&Self>,
    ) -> bool {
        let then = &before.counters;
        if then.doubts != self.doubts {
            return true;
        }
        let advance = |now: u32, was: u32| now.wrapping_sub(was);
        let bounds = |now: [u64; 2], was: [u64; 2]| [now[0].wrapping_sub(was[0]), now[1].wrapping_sub(was[1])];
        let was = &before.values;
        let missed = self.missed_until(at, publication, next);
        let totals = then.missed.map(|missed| missed.total);
        within(advance(values.objects_accepted, was.objects_accepted), bounds(self.accepted, then.accepted))
            && within(advance(values.objects_rejected, was.objects_rejected), bounds(self.rejected, then.rejected))
            && within(advance(values.frames_received, was.frames_received), bounds(self.received, then.received))
            && within(advance(values.frames_missed, was.frames_missed), bounds(missed, totals))
    }
}

fn within(value: u32, [least, most]: [u64; 2]) -> bool {
    (least..=most).contains(&u64::from(value))
}
