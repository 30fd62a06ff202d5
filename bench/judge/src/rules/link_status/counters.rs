//! What Link-Status may count.

use profile::air::Place;
use profile::{Layout, LinkValues};

use crate::bounds;
use crate::expectation::{Certainty, Delivery};

/// Frames that did not come, if every frame that is told here came and no other.
#[derive(Clone, Copy, Debug)]
struct Missed {
    frames: u64,
    /// The last frame: its sample, its end, its number.
    last: Option<(u64, u64, u64)>,
    total: u64,
    /// How many more if frames were received since then that may have been, and the last of those: sample and number.
    perhaps: u64,
    maybe: Option<(u64, u64)>,
}

impl Missed {
    const fn new(layout: Layout) -> Self {
        Self { frames: layout.frames() as u64, last: None, total: 0, perhaps: 0, maybe: None }
    }

    /// How many have become overdue between the last frame and `at`, ns: after their deadline, which is
    /// [`bounds::FRAME_DEADLINE`] after that frame for the next cycle, and [`bounds::SECOND_FRAME`] for the second
    /// frame of the same.
    fn overdue(&self, at: u64) -> u64 {
        let Some((_, ended, number)) = self.last else { return 0 };
        let passed = at.saturating_sub(ended);
        if let Some(more) = passed.checked_sub(bounds::FRAME_DEADLINE) {
            self.frames * (1 + more / bounds::CYCLE)
        } else {
            u64::from(number + 1 < self.frames && passed >= bounds::SECOND_FRAME)
        }
    }

    /// How many were due between the last frame and this one; their samples are apart by so much more than they seem.
    fn between(&self, frame: &Delivery, more: i64) -> u64 {
        self.last.map_or(0, |(sampled, _, number)| self.due((sampled, number), frame, more))
    }

    fn due(&self, (sampled, number): (u64, u64), frame: &Delivery, more: i64) -> u64 {
        let apart = frame.sampled.saturating_sub(sampled).saturating_add_signed(more);
        let cycles = (apart + bounds::CYCLE / 2) / bounds::CYCLE;
        (cycles * self.frames + frame.number as u64).saturating_sub(number + 1)
    }

    /// The most that were due by this frame, whichever frames before it were received.
    fn at_most(&self, frame: &Delivery, more: i64) -> u64 {
        let since_maybe = self.maybe.map_or(0, |maybe| self.perhaps + self.due(maybe, frame, more));
        self.between(frame, more).max(since_maybe).max(self.perhaps)
    }

    /// This frame was received.
    fn frame(&mut self, frame: &Delivery, band: i64) {
        let overdue = self.overdue(frame.ended.saturating_add_signed(band));
        self.total += self.at_most(frame, band).max(overdue);
        self.last = Some((frame.sampled, frame.ended, frame.number as u64));
        (self.perhaps, self.maybe) = (0, None);
    }

    /// This frame may have been received.
    fn maybe(&mut self, frame: &Delivery, band: i64) {
        self.perhaps = self.at_most(frame, band);
        self.maybe = Some((frame.sampled, frame.number as u64));
    }
}

/// Least and most of what is counted since the DPR's start.
#[derive(Clone, Copy, Debug)]
pub(super) struct Counters {
    layout: Layout,
    accepted: [u64; 2],
    rejected: [u64; 2],
    received: [u64; 2],
    missed: [Missed; 2],
    /// Some frame was surely received.
    sure: bool,
    /// How often something was not certain.
    doubts: u64,
}

/// What an image says, to compare later ones with.
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
        // Before any frame was surely received, none need be missed.
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

    /// Least and most frames missed in an image of `at`, ns, which was caused up to `publication` earlier.
    fn missed(&self, at: u64, publication: u64) -> [u64; 2] {
        let [least, most] = &self.missed;
        let least = least.total + least.overdue(at.saturating_sub(publication + bounds::SEQUENCE_BAND));
        [least, most.total + most.overdue(at + bounds::SEQUENCE_BAND).max(most.perhaps)]
    }

    /// Whether `values` fit in an image of `at`. `next` is what is counted with the next frame, if that may have had a
    /// part in it.
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

    /// Whether every object of every frame was either accepted or rejected.
    pub(super) fn add_up(&self, values: &LinkValues) -> bool {
        let places = self.layout.frame(0).map_or(0, Place::count) as u64;
        u64::from(values.objects_accepted) + u64::from(values.objects_rejected)
            == places * u64::from(values.frames_received)
    }

    /// What later images can be compared with, if this is an image of `at` and nothing is overdue then.
    pub(super) fn baseline(&self, values: &LinkValues, at: u64) -> Option<Baseline> {
        let overdue = self.missed.iter().any(|missed| missed.overdue(at + bounds::SEQUENCE_BAND) > 0);
        (!overdue).then_some(Baseline { values: *values, counters: *self })
    }

    /// Whether `values` have advanced since an image as the frames since then say; true if something was not certain.
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
