//! Link-Status, and the deadline that notices a missed frame.

use profile::{
    air,
    sequence::{Judgement, Sequence},
    LinkStatus, LinkStatusBits, LinkValues, ResetReason, CYCLE_MS,
};

use crate::accept::{Cycle, Objects, Verdict, SAME_SAMPLE_US};

/// The time from the end of one frame to the latest end of the next, µs: a cycle and a quarter, for drift and jitter.
pub const FRAME_DEADLINE_US: u32 = 12_500;
/// The time around the expected end of a frame in which the DPR publishes no image that can wait, µs. It is longer than
/// publishing takes (`commit_worst_cycles`, 100 µs on the pessimistic clock) and than two crystals drift apart in a
/// cycle.
pub const FRAME_DUE_US: u32 = 200;
/// While HORUS is silent, the period after which the frames of another cycle count as missed, µs: one cycle.
pub const SILENCE_US: u32 = 1_000 * CYCLE_MS;
/// The time from the end of a cycle's first frame to the latest end of its second frame, µs (five receivers). The
/// second frame ends 3.935 ms after the first, give or take [`SAME_SAMPLE_US`]. The next cycle's first frame ends 10 ms
/// after the first.
pub const SECOND_FRAME_US: u32 = 7_000;
/// How long Link-Status shows that HORUS has restarted, µs: long enough for every control cycle to see it.
pub const RESTART_SHOWN_US: u32 = 1_000_000;

const _: () = {
    let first = air::age_at_end_us::<5>(0).expect("the first frame of two");
    let second = air::age_at_end_us::<5>(1).expect("the second frame of two");
    // The deadline for second frames lies behind every second frame of the same cycle.
    assert!(second - first + SAME_SAMPLE_US < SECOND_FRAME_US && SECOND_FRAME_US < FRAME_DEADLINE_US);
};

/// The DPR's time in 64 bits of µs, extended from a free-running counter of 32 bits of µs.
#[derive(Clone, Copy, Debug, Default)]
pub struct Clock {
    counter_us: u32,
    us: u64,
    below_ms_us: u32,
    ms: u32,
}

impl Clock {
    /// Returns the clock at the DPR's start.
    #[must_use]
    pub const fn new() -> Self {
        Self { counter_us: 0, us: 0, below_ms_us: 0, ms: 0 }
    }

    /// Moves the clock on to counter value `now_us`, which must not be before that of the last call. To be called at
    /// least every 71 minutes.
    pub fn advance(&mut self, now_us: u32) {
        let passed = now_us.wrapping_sub(self.counter_us);
        self.counter_us = now_us;
        self.us = self.us.wrapping_add(u64::from(passed));
        let us = self.below_ms_us + passed % 1000;
        self.ms = self.ms.wrapping_add(passed / 1000 + us / 1000);
        self.below_ms_us = us % 1000;
    }

    /// Returns the ms since the DPR's start, which wrap after 49 days.
    #[must_use]
    pub const fn ms(&self) -> u32 {
        self.ms
    }

    /// Returns the µs since the DPR's start, which never wrap.
    #[must_use]
    pub const fn us(&self) -> u64 {
        self.us
    }

    /// Returns the instant, µs since start, at which the counter had the value `counter_us`, less than 71 minutes ago.
    #[must_use]
    pub const fn instant_us(&self, counter_us: u32) -> u64 {
        self.us.wrapping_sub(self.counter_us.wrapping_sub(counter_us) as u64)
    }
}

/// The frame that the deadline waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Due {
    /// The deadline waits for the first frame since start, and no frame counts as missed.
    Any,
    /// The deadline waits for the second frame of the current cycle.
    Second,
    /// The deadline waits for the first frame of the next cycle. The second frame of this cycle already counts as
    /// missed.
    First,
    /// The deadline waits for the next cycle.
    Cycle,
}

/// The sample instant and the number of a frame that was received.
#[derive(Clone, Copy, Debug)]
struct Slot {
    sampled_us: u64,
    frame: u32,
}

/// The result of the deadlines that have passed since the monitor was last asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lapse {
    /// The number of frames that the deadlines of this call count as missed.
    pub missed: u32,
    /// Whether no frame came in time, so that images must have no objects. If false, only the second frame of a cycle
    /// is late.
    pub silent: bool,
}

/// The missed-frame monitor: a deadline that each frame restarts, and the count of the missed frames.
///
/// While HORUS is silent, each deadline that passes counts. When a frame arrives, the instants of the samples tell how
/// many frames were due before it, and those that no deadline has counted are added. A damaged frame counts as
/// received.
#[derive(Clone, Copy, Debug)]
pub struct Monitor<const N: usize> {
    due: Due,
    deadline_us: u32,
    last: Option<Slot>,
    /// The number of missed frames that deadlines have counted since the last frame arrived.
    counted: u32,
}

impl<const N: usize> Default for Monitor<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Monitor<N> {
    const FRAMES: u32 = air::frames(N) as u32;
    const CYCLE_US: u32 = 1_000 * CYCLE_MS;

    /// Returns a monitor that waits for the first frame.
    #[must_use]
    pub const fn new() -> Self {
        Self { due: Due::Any, deadline_us: 0, last: None, counted: 0 }
    }

    /// Returns the next deadline, a value of the DPR's µs counter.
    #[must_use]
    pub const fn deadline_us(&self) -> u32 {
        self.deadline_us
    }

    /// Starts at counter value `now_us`: the first deadline is [`FRAME_DEADLINE_US`] later.
    pub fn begin(&mut self, now_us: u32) {
        self.deadline_us = now_us.wrapping_add(FRAME_DEADLINE_US);
    }

    /// Records a frame that ended at counter value `ended_us`, and restarts the deadline. `frame` is the frame's number
    /// in its cycle, `sampled_us` the instant of its sample. Returns how many frames were missed before it that no
    /// deadline has counted.
    pub fn frame(&mut self, frame: usize, sampled_us: u64, ended_us: u32) -> u32 {
        let frame = frame as u32;
        let missed = self.last.map_or(0, |last| {
            // Not covered: only this line, the limit at 0: frames are judged in the order of their ends, and in a
            // profile of three receivers all samples have the same age then, so no sample is older than the one before.
            let apart_us = sampled_us.wrapping_sub(last.sampled_us).cast_signed().max(0);
            // Not covered: the limits of the conversion and of the sum, which two frames 71 minutes apart reach: no run
            // is so long.
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

    /// Whether a cycle's first frame is expected to end within [`FRAME_DUE_US`] before or after counter value `now_us`.
    /// More than a cycle after the last frame this may be true although no frame is due.
    #[must_use]
    pub const fn is_frame_due(&self, now_us: u32) -> bool {
        if !matches!(self.due, Due::Cycle) {
            return false;
        }
        // The interval from the end of a cycle's first frame to the end of its last, µs; 0 if a cycle has one frame.
        let frames_us = match (air::age_at_end_us::<N>(0), air::age_at_end_us::<N>(air::frames(N) - 1)) {
            (Some(first), Some(last)) => last - first,
            _ => 0,
        };
        let due_us = self.deadline_us.wrapping_sub(FRAME_DEADLINE_US - Self::CYCLE_US + frames_us);
        // Not covered: only this line, in the copy for `Commit::withdraw`, a finding in the 2.7 ms between the instant
        // at which a frame is due that does not come, and its deadline.
        now_us.wrapping_sub(due_us).cast_signed().unsigned_abs() <= FRAME_DUE_US
    }

    /// Whether the deadline has passed at counter value `now_us`. It must have passed less than 35 minutes ago.
    #[must_use]
    pub const fn has_lapsed(&self, now_us: u32) -> bool {
        now_us.wrapping_sub(self.deadline_us).cast_signed() >= 0
    }

    /// Handles all deadlines that have passed by counter value `now_us`, and moves the deadline on; `None` if none has
    /// passed.
    pub fn lapse(&mut self, now_us: u32) -> Option<Lapse> {
        if !self.has_lapsed(now_us) {
            return None;
        }
        let mut missed = 0;
        // Not covered: the deadline of a second frame, which only a profile of five receivers has: the cycle of three
        // has one frame.
        if self.due == Due::Second {
            missed = 1;
            self.due = Due::First;
            self.deadline_us = self.deadline_us.wrapping_add(FRAME_DEADLINE_US - SECOND_FRAME_US);
        }
        // Not covered: the question after a missed second frame, which only a profile of five receivers has: without
        // one the compiler reuses the answer of the question above.
        let silent = self.has_lapsed(now_us);
        // Not covered: only this line, in the path behind a missed second frame, as above.
        if silent {
            // A passed deadline counts as one missed frame or cycle. Each further period that has passed counts as
            // another one.
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
        // Not covered: the limit of the sum, which 500 days of silence reach; and the copies behind a missed second
        // frame, and for a deadline that has passed before a frame's end (`Commit::frame`).
        self.counted = self.counted.saturating_add(missed);
        Some(Lapse { missed, silent })
    }
}

/// The values for Link-Status that other tasks hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Health {
    /// Whether a fault of RAM was found since start.
    pub ram_fault: bool,
    /// Whether the RFID front end is out of order, so that no frame can be received.
    pub front_end_fault: bool,
    /// Whether the RFID front end works but senses no field of HORUS.
    pub no_field: bool,
    /// Whether flash differs from the program that was built.
    pub flash_fault: bool,
    /// The reason why the DPR last started.
    pub reset_reason: ResetReason,
    /// The number of accesses over SSI that were refused since start.
    pub access_violations: u32,
    /// Whether the last uplink or command that came in was refused.
    pub uplink_rejected: bool,
}

/// The values of Link-Status that are kept from one publication to the next.
#[derive(Clone, Copy, Debug)]
pub struct Link {
    clock: Clock,
    /// The instant, µs since start, at which the sample of the last accepted Reported-Position was taken.
    reported_us: Option<u64>,
    accepted: u32,
    rejected: u32,
    received: u32,
    missed: u32,
    sequence: Sequence,
    frozen: bool,
    /// The instant, µs since start, at which a restart of HORUS was last noticed.
    restarted_us: Option<u64>,
}

impl Default for Link {
    fn default() -> Self {
        Self::new()
    }
}

impl Link {
    /// Returns the state before any frame was received: the age has its greatest value, and the link is out of
    /// sequence.
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

    /// Moves the clock on to counter value `now_us`.
    pub fn advance(&mut self, now_us: u32) {
        self.clock.advance(now_us);
    }

    /// Returns the DPR's clock.
    #[must_use]
    pub const fn clock(&self) -> &Clock {
        &self.clock
    }

    /// Counts a frame. `sequence` is the state of the sequence after the frame.
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
        // Not covered: only this line, in the copies behind a missed second frame, and for a deadline that has passed
        // before a frame's end (`Commit::frame`).
        self.missed = self.missed.wrapping_add(frames);
    }

    /// Returns the Link-Status of an image that is published now, with the objects `shown` out of those `expected`.
    ///
    /// The link is up if the image has an object. The age is that of the last accepted Reported-Position's sample.
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
            .with_uplink_rejected(health.uplink_rejected)
            .with_out_of_sequence(!held)
            .with_horus_clock_implausible(held & self.sequence.is_clock_implausible())
            .with_flash_fault(health.flash_fault)
            .with_reset_reason(health.reset_reason)
            .with_no_field(health.no_field);
        LinkStatus::seal(&LinkValues {
            timestamp: self.clock.ms(),
            status,
            objects_accepted: self.accepted,
            objects_rejected: self.rejected,
            frames_received: self.received,
            frames_missed: self.missed,
            age_100us: LinkValues::age(self.since_us(self.reported_us)),
            // Not covered: only this line, the limit: no run has 65 536 refused accesses.
            access_violations: u16::try_from(health.access_violations).unwrap_or(u16::MAX),
        })
    }

    /// Returns the numbers of objects accepted, objects rejected, frames received and frames missed since the start.
    /// They wrap.
    #[must_use]
    pub const fn counters(&self) -> [u32; 4] {
        [self.accepted, self.rejected, self.received, self.missed]
    }

    /// Returns the µs since `instant_us`, at most `u32::MAX`; `u32::MAX` if there was no such instant.
    fn since_us(&self, instant_us: Option<u64>) -> u32 {
        // The code has no branch, so that it takes the same time whether there is an instant or not.
        let never = u64::from(instant_us.is_none()).wrapping_neg();
        let passed = self.clock.us().wrapping_sub(instant_us.unwrap_or_default()) | never;
        u32::try_from(passed).unwrap_or(u32::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use profile::air::Place;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_clock_loses_nothing_over_any_steps_and_wraps(
            start: u32, steps in prop::collection::vec(0_u32..20_000_000, 0..200), ago in 0_u32..4_000_000,
        ) {
            let mut clock = Clock::default();
            clock.advance(start);
            let mut total = u64::from(start);
            let mut counter = start;
            for step in steps {
                counter = counter.wrapping_add(step);
                clock.advance(counter);
                total += u64::from(step);
                prop_assert_eq!(u64::from(clock.ms()), total / 1000 % (1 << 32));
                prop_assert_eq!(clock.us(), total);
                prop_assert_eq!(clock.instant_us(counter.wrapping_sub(ago)), total.wrapping_sub(u64::from(ago)));
            }
        }

        #[test]
        fn a_late_check_of_the_deadline_counts_the_same_missed_frames(
            first: bool, ended_us: u32, late_us in 0_u32..500_000,
        ) {
            let mut at_once = Monitor::<5>::new();
            at_once.frame(usize::from(!first), 1_000_000, ended_us);
            let mut late = at_once;
            let now = at_once.deadline_us().wrapping_add(late_us);
            let mut missed = 0;
            let mut silent = false;
            while at_once.has_lapsed(now) {
                let lapse = at_once.lapse(at_once.deadline_us()).expect("it has passed");
                missed += lapse.missed;
                silent |= lapse.silent;
            }
            prop_assert_eq!(late.lapse(now), Some(Lapse { missed, silent }));
            prop_assert_eq!(late.deadline_us(), at_once.deadline_us());
            prop_assert_eq!(late.lapse(now), None);
        }
    }

    const OVERDUE: fn(u32, bool) -> Option<Lapse> = |missed, silent| Some(Lapse { missed, silent });

    #[test]
    fn before_the_first_frame_nothing_is_missed() {
        let mut monitor = Monitor::<3>::new();
        monitor.begin(7_000);
        assert_eq!(monitor.deadline_us(), 7_000 + FRAME_DEADLINE_US);
        assert_eq!(monitor.lapse(19_499), None);
        assert_eq!(monitor.lapse(19_500), OVERDUE(0, true));
        assert_eq!(monitor.lapse(1_019_500), OVERDUE(0, true));
        assert_eq!(monitor.frame(0, 1_015_000, 1_020_000), 0);
        assert_eq!(monitor.lapse(1_032_500), OVERDUE(1, true));
    }

    #[test]
    fn one_frame_a_cycle_silence_counts_one_frame_each_cycle() {
        let mut monitor = Monitor::<3>::new();
        assert_eq!(monitor.frame(0, 5_000, 10_000), 0);
        assert_eq!(monitor.deadline_us(), 22_500);
        assert_eq!(monitor.lapse(22_500), OVERDUE(1, true));
        assert_eq!(monitor.deadline_us(), 32_500);
        assert_eq!(monitor.lapse(32_499), None);
        assert_eq!(monitor.lapse(32_500), OVERDUE(1, true));
        // Frames were due at 20, 30 and 40 ms. The deadlines have counted two of them, so one is left.
        assert_eq!(monitor.frame(0, 45_000, 50_000), 1);
        assert_eq!(monitor.frame(0, 55_000, 60_000), 0);
        assert_eq!(monitor.deadline_us(), 72_500);
    }

    #[test]
    fn frames_that_were_due_between_two_are_counted_by_their_slots() {
        // Each row has the number and sample instant (µs) of two frames, and the frames that were missed between them.
        for (one, other, missed) in [
            ((0, 0), (1, 0), 0),
            ((1, 0), (0, 10_000), 0),
            ((0, 0), (0, 10_000), 1),
            ((1, 0), (1, 10_000), 1),
            ((0, 0), (1, 10_000), 2),
            ((1, 0), (0, 20_000), 2),
            ((0, 0), (0, 14_999), 1),
            ((0, 0), (0, 15_000), 3),
            ((0, 0), (0, 0), 0),
            ((1, 0), (0, 0), 0),
            ((0, 50_000), (0, 49_000), 0),
            ((0, 50_000), (1, 20_000), 0),
        ] {
            let mut monitor = Monitor::<5>::new();
            monitor.frame(one.0, one.1, 0);
            assert_eq!(monitor.frame(other.0, other.1, 0), missed, "{one:?}, {other:?}");
        }
        let mut monitor = Monitor::<1>::new();
        monitor.frame(0, 0, 0);
        assert_eq!(monitor.frame(0, 40_000, 0), 3);
        // Missed frames that deadlines have counted are subtracted once, from those missed before the next frame.
        let mut monitor = Monitor::<1>::new();
        monitor.frame(0, 0, 5_000);
        assert_eq!(monitor.lapse(37_500), OVERDUE(3, true));
        assert_eq!(monitor.frame(0, 40_000, 45_000), 0);
        assert_eq!(monitor.frame(0, 80_000, 85_000), 3);
    }

    /// A cycle's first frame ends at 0. Its second frame, due at 3.9 ms, and all frames of later cycles are lost.
    #[test]
    fn each_lost_frame_is_counted_when_its_time_has_passed() {
        let mut monitor = Monitor::<5>::new();
        monitor.frame(0, 0, 0);
        assert_eq!(monitor.deadline_us(), SECOND_FRAME_US);
        let mut missed = 0;
        for now in 0..100_000 {
            if let Some(lapse) = monitor.lapse(now) {
                missed += lapse.missed;
                assert_eq!(lapse.silent, now >= FRAME_DEADLINE_US);
                let due = (0..20).filter(|cycle| cycle * 10_000 + 3_935 <= now).count() as u32
                    + (1..20).filter(|cycle| cycle * 10_000 <= now).count() as u32;
                assert_eq!(missed, due, "at {now} µs");
            }
        }
        assert_eq!(missed, 1 + 1 + 2 * 8);
        // Two more frames are missed: the second one of the previous cycle and the first one of this cycle.
        assert_eq!(monitor.frame(1, 100_000, 103_935), 2);
    }

    fn verdict(accepted: Objects, cycle: Cycle, sampled_us: u64) -> Verdict {
        Verdict { place: Place::of_frame::<3>(0).expect("a frame"), sampled_us, cycle, accepted }
    }

    fn values(link: &Link) -> LinkValues {
        link.seal(Objects::NONE, Objects::all(3), &Health::default()).values()
    }

    #[test]
    fn the_age_is_that_of_the_sample_and_saturates() {
        let mut link = Link::new();
        let sequence = Sequence::new();
        link.advance(50_000);
        assert_eq!(values(&link).age_100us, u16::MAX);
        link.frame(&verdict(Objects::all(3), Cycle::Same, 44_850), &sequence);
        assert_eq!(values(&link).age_100us, 51);
        link.advance(50_000 + 12_500);
        assert_eq!(values(&link).age_100us, 176);
        // The age in Link-Status keeps growing until a Reported-Position is accepted.
        link.frame(&verdict(Objects::NONE, Cycle::Same, 60_000), &sequence);
        assert_eq!(values(&link).age_100us, 176);
        for minutes in 1..200_u32 {
            link.advance(minutes.wrapping_mul(60_000_000));
        }
        assert_eq!(values(&link).age_100us, u16::MAX);
    }

    #[test]
    fn frames_and_objects_are_counted_and_shown_each_in_its_place() {
        let mut link = Link::new();
        let sequence = Sequence::new();
        link.frame(&verdict(Objects::all(3), Cycle::Same, 0), &sequence);
        link.frame(&verdict(Objects::all(2), Cycle::Same, 0), &sequence);
        link.frame(&verdict(Objects::NONE, Cycle::Unknown, 0), &sequence);
        link.missed(7);
        link.missed(0);
        assert_eq!(link.counters(), [7, 5, 3, 7]);
        link.missed(4);
        assert_eq!(link.counters(), [7, 5, 3, 11]);
        let values = values(&link);
        let shown = [values.objects_accepted, values.objects_rejected, values.frames_received, values.frames_missed];
        assert_eq!(shown, link.counters());
    }

    // Shows LNK-10.
    #[test]
    fn the_link_is_out_of_sequence_until_the_sequence_is_found() {
        let mut link = Link::new();
        assert_eq!(values(&link).status, LinkStatusBits::new().with_out_of_sequence(true));
        let mut sequence = Sequence::new();
        let mut judged = |link: &mut Link, timestamp: u32, at_us: u32| {
            link.advance(at_us);
            let judgement = sequence.judge(timestamp, u64::from(at_us));
            link.frame(&verdict(Objects::NONE, Cycle::Next(judgement), u64::from(at_us)), &sequence);
            values(link).status
        };
        for (cycle, out) in [(0, true), (1, true), (2, true), (3, false), (4, false)] {
            let status = judged(&mut link, 10 * cycle, 10_000 * cycle);
            assert_eq!(status, LinkStatusBits::new().with_out_of_sequence(out), "cycle {cycle}");
        }
        // The sequence is lost only after 267.7 ms without a frame.
        link.advance(40_000 + 267_700);
        assert!(!values(&link).status.out_of_sequence());
        link.advance(40_000 + 267_701);
        assert!(values(&link).status.out_of_sequence());
        // A repeated timestamp makes HORUS count as frozen until the next cycle comes.
        let frozen = LinkStatusBits::new().with_out_of_sequence(true).with_horus_frozen(true);
        assert_eq!(judged(&mut link, 40, 400_000), frozen);
        assert_eq!(judged(&mut link, 50, 410_000), LinkStatusBits::new().with_out_of_sequence(true));
        assert!(!judged(&mut link, 60, 420_000).horus_restarted());
        assert!(judged(&mut link, 70, 430_000) == LinkStatusBits::new());
    }

    #[test]
    fn a_clock_that_is_wrong_is_shown_while_the_sequence_is_held() {
        let mut link = Link::new();
        let mut sequence = Sequence::new();
        for cycle in 0..400_u32 {
            let at_us = 10_300 * cycle;
            link.advance(at_us);
            let judgement = sequence.judge(10 * cycle, u64::from(at_us));
            link.frame(&verdict(Objects::NONE, Cycle::Next(judgement), u64::from(at_us)), &sequence);
            let status = values(&link).status;
            assert_eq!(status.horus_clock_implausible(), cycle >= 3 + 98, "cycle {cycle}");
        }
        link.advance(10_300 * 399 + 267_701);
        let status = values(&link).status;
        assert!(status.out_of_sequence() && !status.horus_clock_implausible());
    }

    #[test]
    fn a_restart_stays_shown_for_one_second() {
        let mut link = Link::new();
        link.advance(5_000_000);
        let restarted = verdict(Objects::NONE, Cycle::Next(Judgement::Restarted), 0);
        link.frame(&restarted, &Sequence::new());
        assert!(values(&link).status.horus_restarted());
        link.frame(&verdict(Objects::NONE, Cycle::Next(Judgement::Frozen), 0), &Sequence::new());
        link.advance(5_999_999);
        assert!(values(&link).status.horus_restarted());
        link.advance(6_000_000);
        assert!(!values(&link).status.horus_restarted());
    }

    #[test]
    fn every_fault_that_others_report_has_its_bit() {
        let link = Link::new();
        let none = LinkStatusBits::new().with_out_of_sequence(true);
        let shown = |health| link.seal(Objects::NONE, Objects::all(2), &health).values();
        let health = Health::default();
        assert_eq!(shown(health).status, none);
        assert_eq!(shown(Health { ram_fault: true, ..health }).status, none.with_ram_fault(true));
        assert_eq!(shown(Health { front_end_fault: true, ..health }).status, none.with_front_end_fault(true));
        assert_eq!(shown(Health { no_field: true, ..health }).status, none.with_no_field(true));
        assert_eq!(shown(Health { flash_fault: true, ..health }).status, none.with_flash_fault(true));
        for (reset_reason, unasked) in [
            (ResetReason::PowerOn, false),
            (ResetReason::Pin, false),
            (ResetReason::Watchdog, true),
            (ResetReason::Lockup, true),
            (ResetReason::Software, false),
            (ResetReason::BrownOutOrOther, true),
        ] {
            let status = shown(Health { reset_reason, ..health }).status;
            assert_eq!((status.reset_reason(), status.unasked_reset()), (Some(reset_reason), unasked));
        }
        assert_eq!(shown(Health { access_violations: 70_000, ..health }).access_violations, u16::MAX);
        assert_eq!(shown(Health { access_violations: 7, ..health }).access_violations, 7);
        let all = link.seal(Objects::all(2), Objects::all(2), &health).values().status;
        assert_eq!(all, none.with_link_up(true).with_all_accepted(true));
        let some = link.seal(Objects::all(1), Objects::all(2), &health).values().status;
        assert_eq!(some, none.with_link_up(true));
    }
}
