//! Link-Status, and the deadline that notices a missed frame.

use profile::{
    air,
    sequence::{Judgement, Sequence},
    LinkStatus, LinkStatusBits, LinkValues, ResetReason, CYCLE_MS,
};

use crate::accept::{Cycle, Objects, Verdict, SAME_SAMPLE_US};

/// From the end of one frame to the latest end of the next, µs: the cycle and a quarter of it, for the drift of two
/// crystals and the jitter of a start-up; measured from each frame anew, not by a local tick, so that drift never adds
/// up.
pub const FRAME_DEADLINE_US: u32 = 12_500;
/// While HORUS is silent a frame counts as missed this often, µs: the cycle.
pub const SILENCE_US: u32 = 1_000 * CYCLE_MS;
/// From the end of a cycle's first frame to the latest end of its second, µs (five receivers): the second ends 3.935 ms
/// after the first, give or take [`SAME_SAMPLE_US`], and the next cycle's first 10 ms after this cycle's.
pub const SECOND_FRAME_US: u32 = 7_000;
/// A restart of HORUS stays shown for so long, µs, that no control cycle can overlook it.
pub const RESTART_SHOWN_US: u32 = 1_000_000;

const _: () = {
    let first = air::age_at_end_us::<5>(0).expect("the first frame of two");
    let second = air::age_at_end_us::<5>(1).expect("the second frame of two");
    // A second frame that belongs to the first is never later than its deadline.
    assert!(second - first + SAME_SAMPLE_US < SECOND_FRAME_US && SECOND_FRAME_US < FRAME_DEADLINE_US);
};

/// The DPR's time: a free-running counter of µs, taken further.
#[derive(Clone, Copy, Debug, Default)]
pub struct Clock {
    counter_us: u32,
    us: u64,
    below_ms_us: u32,
    ms: u32,
}

impl Clock {
    /// At start.
    #[must_use]
    pub const fn new() -> Self {
        Self { counter_us: 0, us: 0, below_ms_us: 0, ms: 0 }
    }

    /// Moves on to counter value `now_us`, which must not be before that of the last call. To be called at least every
    /// 71 minutes; it is called every 12.5 ms.
    pub fn advance(&mut self, now_us: u32) {
        let passed = now_us.wrapping_sub(self.counter_us);
        self.counter_us = now_us;
        self.us = self.us.wrapping_add(u64::from(passed));
        let us = self.below_ms_us + passed % 1000;
        self.ms = self.ms.wrapping_add(passed / 1000 + us / 1000);
        self.below_ms_us = us % 1000;
    }

    /// ms since start, wraps after 49 days.
    #[must_use]
    pub const fn ms(&self) -> u32 {
        self.ms
    }

    /// µs since start, never wraps.
    #[must_use]
    pub const fn us(&self) -> u64 {
        self.us
    }

    /// The instant at which the counter had the value `counter_us`, less than 71 minutes ago: µs since start.
    #[must_use]
    pub const fn instant_us(&self, counter_us: u32) -> u64 {
        self.us.wrapping_sub(self.counter_us.wrapping_sub(counter_us) as u64)
    }
}

/// What the deadline waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Due {
    /// Any frame; nothing was heard yet, so none is missed.
    Any,
    /// The second frame of the current cycle.
    Second,
    /// The next cycle's first frame; the current cycle's second is counted as missed.
    First,
    /// A whole cycle.
    Cycle,
}

/// A frame's place in time.
#[derive(Clone, Copy, Debug)]
struct Slot {
    sampled_us: u64,
    /// The number of the frame in its cycle.
    frame: u32,
}

/// What deadlines that have passed mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lapse {
    /// Frames that are missed now.
    pub missed: u32,
    /// No frame came in time after the last one, so that nothing may be shown any more. Otherwise only a cycle's second
    /// frame is late.
    pub silent: bool,
}

/// The missed-frame monitor: a deadline restarted by each frame, and the count of the frames that did not come.
///
/// A frame is missed if its time has passed. During silence the deadlines count; when a frame arrives, the instants of
/// the samples say how many frames were due between it and the one before, and those that no deadline has counted are
/// added. So the count does not depend on whether a damaged frame could be told apart from its neighbours: it is one
/// that was received.
#[derive(Clone, Copy, Debug)]
pub struct Monitor<const N: usize> {
    due: Due,
    deadline_us: u32,
    last: Option<Slot>,
    /// Frames counted as missed since the last one arrived.
    counted: u32,
}

impl<const N: usize> Default for Monitor<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Monitor<N> {
    /// Frames in a cycle.
    const FRAMES: u32 = air::frames(N) as u32;
    const CYCLE_US: u32 = 1_000 * CYCLE_MS;

    /// Waits for the first frame. As long as nothing was heard nothing is expected, so nothing counts as missed.
    #[must_use]
    pub const fn new() -> Self {
        Self { due: Due::Any, deadline_us: 0, last: None, counted: 0 }
    }

    /// The next deadline: value of the DPR's µs counter.
    #[must_use]
    pub const fn deadline_us(&self) -> u32 {
        self.deadline_us
    }

    /// The DPR has started at counter value `now_us`: the first deadline is [`FRAME_DEADLINE_US`] later.
    pub fn begin(&mut self, now_us: u32) {
        self.deadline_us = now_us.wrapping_add(FRAME_DEADLINE_US);
    }

    /// Frame number `frame` of a cycle that was sampled at `sampled_us` on the DPR's clock has ended at counter value
    /// `ended_us`: restarts the deadline. How many frames were missed before it that no deadline has counted.
    pub fn frame(&mut self, frame: usize, sampled_us: u64, ended_us: u32) -> u32 {
        let frame = frame as u32;
        let missed = self.last.map_or(0, |last| {
            let apart_us = sampled_us.wrapping_sub(last.sampled_us).cast_signed().max(0);
            let apart_us = u32::try_from(apart_us).unwrap_or(u32::MAX).saturating_add(Self::CYCLE_US / 2);
            let slots = apart_us / Self::CYCLE_US * Self::FRAMES + frame;
            slots.saturating_sub(last.frame + 1).saturating_sub(self.counted)
        });
        let complete = frame + 1 == Self::FRAMES;
        let (due, after_us) = if complete { (Due::Cycle, FRAME_DEADLINE_US) } else { (Due::Second, SECOND_FRAME_US) };
        *self = Self {
            due,
            deadline_us: ended_us.wrapping_add(after_us),
            last: Some(Slot { sampled_us, frame }),
            counted: 0,
        };
        missed
    }

    /// Whether the deadline has passed at counter value `now_us`, itself included: it is less than 35 minutes ago.
    #[must_use]
    pub const fn has_lapsed(&self, now_us: u32) -> bool {
        now_us.wrapping_sub(self.deadline_us).cast_signed() >= 0
    }

    /// At counter value `now_us`: `None` if the deadline has not passed. If it has, and however many others since, what
    /// that means; the next deadline is after `now_us`.
    pub fn lapse(&mut self, now_us: u32) -> Option<Lapse> {
        if !self.has_lapsed(now_us) {
            return None;
        }
        let mut missed = 0;
        if self.due == Due::Second {
            missed = 1;
            self.due = Due::First;
            self.deadline_us = self.deadline_us.wrapping_add(FRAME_DEADLINE_US - SECOND_FRAME_US);
        }
        let silent = self.has_lapsed(now_us);
        if silent {
            // One deadline, and one for each further period.
            let more = now_us.wrapping_sub(self.deadline_us) / SILENCE_US;
            self.deadline_us = self.deadline_us.wrapping_add((more + 1) * SILENCE_US);
            let (due, frames) = match self.due {
                Due::Any => (Due::Any, 0),
                Due::First | Due::Second => (Due::Cycle, 1 + more * Self::FRAMES),
                Due::Cycle => (Due::Cycle, (1 + more) * Self::FRAMES),
            };
            self.due = due;
            missed += frames;
        }
        self.counted = self.counted.saturating_add(missed);
        Some(Lapse { missed, silent })
    }
}

/// What other tasks know and Link-Status shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Health {
    /// A scrub has found a stuck bit since start.
    pub ram_fault: bool,
    /// The RFID front end is lost at the moment.
    pub front_end_fault: bool,
    /// The program memory does not have the CRC that the build gave it.
    pub flash_fault: bool,
    /// Why the DPR last started.
    pub reset_reason: ResetReason,
    /// Accesses over SSI that were refused since start.
    pub access_violations: u32,
}

/// What Link-Status tells, kept from publication to publication.
#[derive(Clone, Copy, Debug)]
pub struct Link {
    clock: Clock,
    /// When the sample was taken of the last Reported-Position that was accepted, µs since start.
    reported_us: Option<u64>,
    accepted: u32,
    rejected: u32,
    received: u32,
    missed: u32,
    sequence: Sequence,
    frozen: bool,
    /// When a restart of HORUS was last noticed, µs since start.
    restarted_us: Option<u64>,
}

impl Default for Link {
    fn default() -> Self {
        Self::new()
    }
}

impl Link {
    /// Nothing received: the age is saturated, and the sequence is searched for.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            clock: Clock::new(),
            reported_us: None,
            accepted: 0,
            rejected: 0,
            received: 0,
            missed: 0,
            sequence: Sequence::new(),
            frozen: false,
            restarted_us: None,
        }
    }

    /// Time has come to counter value `now_us`.
    pub fn advance(&mut self, now_us: u32) {
        self.clock.advance(now_us);
    }

    /// The DPR's clock.
    #[must_use]
    pub const fn clock(&self) -> &Clock {
        &self.clock
    }

    /// Counts a frame; `sequence` is what it has come to with this frame.
    pub fn frame(&mut self, verdict: &Verdict, sequence: &Sequence) {
        self.received = self.received.wrapping_add(1);
        self.accepted = self.accepted.wrapping_add(verdict.accepted.count());
        self.rejected = self.rejected.wrapping_add(verdict.rejected().count());
        if verdict.accepted.has(0) {
            self.reported_us = Some(verdict.sampled_us);
        }
        if let Cycle::Next(judgement) = verdict.cycle {
            self.sequence = *sequence;
            self.frozen = judgement == Judgement::Frozen;
            if judgement == Judgement::Restarted {
                self.restarted_us = Some(self.clock.us());
            }
        }
    }

    /// Counts missed frames.
    pub fn missed(&mut self, frames: u32) {
        self.missed = self.missed.wrapping_add(frames);
    }

    /// Link-Status for an image that shows `shown` of the `expected` objects, and that is published now.
    ///
    /// The link is up if the cycle that the image shows brought at least one object that may be shown. The age is that
    /// of the sample of the last Reported-Position that was accepted.
    #[must_use]
    pub fn seal(&self, shown: Objects, expected: Objects, health: &Health) -> LinkStatus {
        let held = self.sequence.is_held(self.clock.us());
        let status = LinkStatusBits::new()
            .with_link_up(shown != Objects::NONE)
            .with_all_accepted(shown == expected)
            .with_horus_frozen(self.frozen)
            .with_horus_restarted(self.since_us(self.restarted_us) < RESTART_SHOWN_US)
            .with_ram_fault(health.ram_fault)
            .with_front_end_fault(health.front_end_fault)
            .with_out_of_sequence(!held)
            .with_horus_clock_implausible(held && self.sequence.is_clock_implausible())
            .with_flash_fault(health.flash_fault)
            .with_reset_reason(health.reset_reason);
        LinkStatus::seal(&LinkValues {
            timestamp: self.clock.ms(),
            status,
            objects_accepted: self.accepted,
            objects_rejected: self.rejected,
            frames_received: self.received,
            frames_missed: self.missed,
            age_100us: LinkValues::age(self.since_us(self.reported_us)),
            access_violations: u16::try_from(health.access_violations).unwrap_or(u16::MAX),
        })
    }

    /// Objects accepted, objects rejected, frames received, frames missed; since start, wrapping.
    #[must_use]
    pub const fn counters(&self) -> [u32; 4] {
        [self.accepted, self.rejected, self.received, self.missed]
    }

    /// µs since `instant_us`; saturates, as it does if there was no such instant.
    fn since_us(&self, instant_us: Option<u64>) -> u32 {
        let passed = instant_us.map_or(u64::MAX, |instant| self.clock.us().wrapping_sub(instant));
        u32::try_from(passed).unwrap_or(u32::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_clock_loses_nothing_over_any_steps_and_wraps(start: u32, steps in prop::collection::vec(0_u32..20_000_000, 0..200)) {
            let mut clock = Clock::default();
            let mut total = u64::from(clock.advance(start));
            let mut counter = start;
            for step in steps {
                counter = counter.wrapping_add(step);
                prop_assert_eq!(clock.advance(counter), step);
                total += u64::from(step);
                prop_assert_eq!(u64::from(clock.ms()), total / 1000 % (1 << 32));
            }
        }
    }

    #[test]
    fn before_the_first_frame_nothing_is_missed() {
        let mut monitor = Monitor::<3>::new();
        assert_eq!(monitor.expired(), (0, SILENCE_US));
        assert_eq!(monitor.expired(), (0, SILENCE_US));
        monitor.frame(true);
        assert_eq!(monitor.expired(), (1, SILENCE_US));
    }

    #[test]
    fn one_frame_a_cycle_silence_counts_one_frame_each_cycle() {
        let mut monitor = Monitor::<3>::new();
        assert_eq!(monitor.frame(true), FRAME_DEADLINE_US);
        assert_eq!(monitor.expired(), (1, SILENCE_US));
        assert_eq!(monitor.expired(), (1, SILENCE_US));
        assert_eq!(monitor.frame(true), FRAME_DEADLINE_US);
    }

    /// Frames that end at 0 (first), then nothing: lost are the second (3.9 ms), and both of every later cycle.
    #[test]
    fn two_frames_a_cycle_every_lost_frame_is_counted_once_its_time_has_passed() {
        let mut monitor = Monitor::<5>::new();
        let mut now = monitor.frame(false);
        let mut missed = 0;
        while now < 100_000 {
            let (frames, next) = monitor.expired();
            missed += frames;
            let due = (0..20).filter(|cycle| cycle * 10_000 + 3_900 <= now).count() as u32
                + (1..20).filter(|cycle| cycle * 10_000 <= now).count() as u32;
            // The deadline after a lost cycle stands before its second frame is due, so one may already be counted.
            assert!(missed == due || missed == due + 1, "{missed} of {due} at {now} µs");
            now += next;
        }
        assert_eq!(missed, 1 + 1 + 2 * 8);
    }

    #[test]
    fn the_age_starts_saturated_counts_in_100_us_and_saturates_again() {
        let mut link = Link::new();
        let health = Health::default();
        let age = |link: &mut Link| link.seal(Objects::NONE, Objects::all(3), &health).values().age_100us;
        link.advance(5_000);
        assert_eq!(age(&mut link), u16::MAX);
        link.age_us = 40;
        assert_eq!(age(&mut link), 0);
        link.advance(5_000 + 12_500);
        assert_eq!(age(&mut link), 125);
        for minutes in 1..200_u32 {
            link.advance(minutes.wrapping_mul(60_000_000));
        }
        assert_eq!(age(&mut link), u16::MAX);
    }

    #[test]
    fn every_fault_that_others_report_has_its_bit() {
        let mut link = Link::new();
        let health =
            Health { ram_fault: true, front_end_fault: false, watchdog_reset: true, access_violations: 70_000 };
        let values = link.seal(Objects::all(2), Objects::all(2), &health).values();
        let bits = LinkStatusBits::new()
            .with_link_up(true)
            .with_all_accepted(true)
            .with_ram_fault(true)
            .with_unasked_reset(true);
        assert_eq!(values.status, bits);
        assert_eq!(values.access_violations, u16::MAX);
        let values =
            link.seal(Objects::NONE, Objects::all(2), &Health { front_end_fault: true, ..Health::default() }).values();
        assert_eq!(values.status, LinkStatusBits::new().with_front_end_fault(true));
    }
}
