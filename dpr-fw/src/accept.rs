//! Decides which objects of an air frame are accepted.
//!
//! # Design
//!
//! Each object is accepted or rejected by itself: the frame's length tells where each object lies, then the object's
//! CRCs, identifier and timestamp decide (black channel; paper, section 2.3). The errors that the front end reports of
//! a frame (CRC-16, framing, overflow) are only counted, elsewhere. A frame of a wrong length is rejected as a whole,
//! since its length does not tell where an object lies.
//!
//! A cycle has one frame for up to three receivers and two for five, all with one timestamp. The timestamp of a frame
//! is that of its first intact object; an intact object with another timestamp is rejected, so no image ever mixes
//! cycles. Objects are accepted only if their cycle is in sequence ([`profile::sequence`]).
//!
//! The sequence compares timestamps with the DPR's clock at the instant of the cycle's sample. This instant is the end
//! of the frame less the time from sample to last bit, which is a constant of each frame of the profile
//! ([`air::age_at_end_us`]). The verdict on the first frame of a cycle also holds for the second frame if three
//! conditions are met: the second frame has the same timestamp, carries objects that have not come yet, and was sampled
//! at the same instant within [`SAME_SAMPLE_US`]. The last condition keeps out a second frame that was held back. Any
//! other frame with a timestamp is judged as another cycle, even if it repeats the timestamp.
//!

use core::hint::black_box;

use profile::{
    air::{self, Place},
    crc::Begun,
    sequence::{self, Judgement, Sequence},
    Object, Profile, Rejection, MAX_RECEIVERS,
};

/// The largest number of objects that a profile can have.
pub const MAX_OBJECTS: usize = MAX_RECEIVERS + 1;

/// The largest number of objects that a frame carries: all of the profile of three receivers.
const FRAME_OBJECTS: usize = 4;

/// The largest difference between the sample instants of a cycle's two frames, µs. It is the sequence's tolerance.
pub const SAME_SAMPLE_US: u32 = sequence::TOLERANCE_US;

/// Whether two samples were taken at the same instant, within [`SAME_SAMPLE_US`]. Both instants are in µs.
#[must_use]
pub const fn same_sample(one_us: u64, other_us: u64) -> bool {
    one_us.wrapping_sub(other_us).cast_signed().unsigned_abs() <= SAME_SAMPLE_US as u64
}

/// A set of a profile's objects: bit 0 is Reported-Position, bits 1 to 5 are GPS1 to GPS5.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Objects(u8);

impl Objects {
    /// The empty set.
    pub const NONE: Self = Self(0);

    /// Returns the set of all objects of a profile with `receivers` receivers.
    #[must_use]
    pub const fn all(receivers: usize) -> Self {
        Self(((2_u16 << receivers) - 1) as u8)
    }

    /// Returns the set of the objects that a frame carries, given the place of these objects in the profile.
    #[must_use]
    pub const fn at(place: Place) -> Self {
        Self((((1_u16 << place.count()) - 1) << place.first()) as u8)
    }

    /// Whether object number `index` is in the set.
    #[must_use]
    pub const fn has(self, index: usize) -> bool {
        index < MAX_OBJECTS && self.0 >> index & 1 == 1
    }

    /// Returns the objects that are in at least one of the two sets.
    #[must_use]
    pub const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether the two sets have no object in common.
    #[must_use]
    pub const fn is_disjoint(self, other: Self) -> bool {
        self.0 & other.0 == 0
    }

    /// Returns the number of objects in the set.
    #[must_use]
    pub const fn count(self) -> u32 {
        self.0.count_ones()
    }

    const fn with(self, index: usize, on: bool) -> Self {
        Self(self.0 | (on as u8) << index)
    }
}

/// The relation of a frame to the frames received before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cycle {
    /// No object of the frame is intact, so no timestamp is known.
    Unknown,
    /// The frame belongs to the current cycle, so the verdict on the cycle's first frame holds for it too.
    Same,
    /// The frame belongs to another cycle than the frame before it. The value is the sequence's judgement on that
    /// cycle.
    Next(Judgement),
}

/// The verdict on a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Verdict {
    /// The place of the frame's objects in the profile.
    pub place: Place,
    /// The instant, µs on the DPR's clock, at which HORUS took the frame's sample. It is computed from the frame's end.
    pub sampled_us: u64,
    /// The relation of the frame to the frames before it.
    pub cycle: Cycle,
    /// The objects of the frame that were accepted.
    pub accepted: Objects,
}

impl Verdict {
    /// Returns the number of the frame in its cycle: 0 or 1.
    #[must_use]
    pub const fn frame(&self) -> usize {
        frame_number(self.place)
    }

    /// Returns the objects of the frame that were rejected.
    #[must_use]
    pub const fn rejected(&self) -> Objects {
        Objects(Objects::at(self.place).0 & !self.accepted.0)
    }
}

const fn frame_number(place: Place) -> usize {
    if place.first() == 0 {
        0
    } else {
        1
    }
}

/// The results of verifying a frame's objects while the frame is still arriving, so that less work is left at its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Early {
    /// The timestamps of the frame's objects, from the first one on.
    timestamps: [u32; FRAME_OBJECTS],
    /// The exclusive or of all timestamps, which finds a bit of them that flips until the frame's end.
    check: u32,
    /// The frame CRC of the next object to be verified, over the bytes of that object that have arrived.
    begun: Begun,
    /// The payload length that LEN announced, bytes; 0 if no byte has arrived.
    length: u8,
    /// The number of the frame's objects that are verified already, counted from the front.
    done: u8,
    intact: Objects,
}

impl Default for Early {
    fn default() -> Self {
        Self::of(0)
    }
}

const _: () = assert!(Profile::<3>::OBJECTS <= FRAME_OBJECTS);

impl Early {
    const fn of(length: u8) -> Self {
        Self { length, done: 0, intact: Objects::NONE, timestamps: [0; FRAME_OBJECTS], check: 0, begun: Begun::NOTHING }
    }

    /// Returns the number of verified objects.
    #[must_use]
    pub const fn done(&self) -> usize {
        self.done as usize
    }

    /// Verifies the objects that are complete and not verified yet. `arrived` is the frame so far, LEN included.
    pub fn follow<const N: usize>(&mut self, arrived: &[u8]) {
        let Some((&len, payload)) = arrived.split_first() else { return };
        if self.length == 0 {
            // LEN counts itself and the payload, so the payload has one byte less.
            *self = Self::of(len.saturating_sub(1));
        }
        self.advance::<N>(payload);
    }

    /// Gives the results up if a bit of a timestamp has flipped. All objects are then verified at the frame's end.
    pub fn verify(&mut self) {
        if self.timestamps.iter().fold(self.check, |check, timestamp| check ^ timestamp) != 0 {
            *self = Self::default();
        }
    }

    /// Verifies the objects that are complete in `payload`, the bytes of the frame's payload that have arrived.
    fn advance<const N: usize>(&mut self, payload: &[u8]) {
        let places = (0..air::frames(N)).filter_map(Place::of_frame::<N>);
        let Some(place) = places.into_iter().find(|place| place.length() == usize::from(self.length)) else { return };
        // Not covered: only this line, a call with all objects done: the last object is complete only at the frame's
        // end, with which `judge` makes the last call.
        while self.done() < place.count() {
            let index = place.first() + self.done();
            // Not covered: an object without its place or its bytes: each object of a frame has its place in the
            // profile, at or behind the frame's beginning, and what has arrived reaches that place, since the object
            // before it is complete.
            let Some((there, size)) = Profile::<N>::place(index).and_then(|range| {
                let start = range.start.checked_sub(place.offset())?;
                Some((payload.get(start..)?, range.len()))
            }) else {
                return;
            };
            // A timestamp is taken when the CRC takes its bytes, so that a bit of it that flips later is not used.
            if self.begun.bytes() == 0 {
                let Some(bytes) = there.first_chunk() else { return };
                if let Some(timestamp) = self.timestamps.get_mut(self.done as usize) {
                    // A damaged object's timestamp is stored too, but never used.
                    *timestamp = u32::from_le_bytes(*bytes);
                    self.check ^= *timestamp;
                }
            }
            let Some(bytes) = there.get(..size) else {
                self.begun.follow(there);
                return;
            };
            let begun = core::mem::replace(&mut self.begun, Begun::NOTHING);
            // The barrier keeps the compiler from branching on whether an object is intact, so the time does not depend
            // on it.
            // Not covered: only this line, in the copy of the CRC for fewer than four bytes to come: no read of a frame
            // ends within the last three bytes of an object.
            self.intact = self.intact.with(index, black_box(Object::verify_begun(index, bytes, begun).is_ok()));
            self.done += 1;
        }
    }
}

/// What is kept of past cycles to judge the next frame, for a profile of `N` receivers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Acceptance<const N: usize> {
    sequence: Sequence,
    /// The objects that the frames of the current cycle carried, accepted or not.
    seen: Objects,
    in_sequence: bool,
}

impl<const N: usize> Acceptance<N> {
    /// The age of the sample at the end of each of a cycle's frames, µs. A profile whose cycle has one frame uses only
    /// the first value.
    const AGE_AT_END_US: [u32; 2] = {
        let first = air::age_at_end_us::<N>(0).expect("a cycle has at least one frame");
        let second = if air::frames(N) == 2 { air::age_at_end_us::<N>(1).expect("of two frames") } else { first };
        [first, second]
    };

    /// Returns the state before any frame was received.
    #[must_use]
    pub const fn new() -> Self {
        Self { sequence: Sequence::new(), seen: Objects::NONE, in_sequence: false }
    }

    /// Judges a frame with this `payload`, which ended at `ended_us` (µs on the DPR's clock). `early` holds the results
    /// for objects that were already verified. Frames must be judged in the order of their ends.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if no frame of this profile is that long; then nothing has changed.
    pub fn judge(&mut self, payload: &[u8], early: &Early, ended_us: u64) -> Result<Verdict, Rejection> {
        let place = air::place::<N>(payload)?;
        let sampled_us = ended_us.wrapping_sub(u64::from(Self::AGE_AT_END_US[frame_number(place)]));
        // If LEN announced another length than the whole frame has, all objects are verified anew. Every payload length
        // of this profile is below 256 bytes.
        let length = payload.len() as u8;
        let mut early = if early.length == length { *early } else { Early::of(length) };
        early.advance::<N>(payload);
        let Early { intact, timestamps, .. } = early;
        let mut of_frame = None;
        for (nth, timestamp) in timestamps.into_iter().enumerate().rev() {
            if intact.has(place.first() + nth) {
                of_frame = Some(timestamp);
            }
        }
        // Not covered: only this line, in the path of `Cycle::Same`, the second frame of a cycle, which only a profile
        // of five receivers has.
        let cycle = self.enter(of_frame, sampled_us, Objects::at(place));
        let mut accepted = Objects::NONE;
        for (nth, timestamp) in timestamps.into_iter().enumerate() {
            let index = place.first() + nth;
            let shown = self.in_sequence && Some(timestamp) == of_frame;
            accepted = accepted.with(index, shown && intact.has(index));
        }
        Ok(Verdict { place, sampled_us, cycle, accepted })
    }

    /// Returns the sequence of the cycles judged so far.
    #[must_use]
    pub const fn sequence(&self) -> &Sequence {
        &self.sequence
    }

    /// Records a frame that carries the objects `places`, and whose first intact object has `timestamp`.
    fn enter(&mut self, timestamp: Option<u32>, sampled_us: u64, places: Objects) -> Cycle {
        let Some(timestamp) = timestamp else { return Cycle::Unknown };
        let current = self.sequence.last();
        let same = |last: sequence::Sample| last.timestamp == timestamp && same_sample(last.sampled_us, sampled_us);
        // Not covered: the second frame of a cycle, which only a profile of five receivers has: a cycle of three has
        // one frame.
        if current.is_some_and(same) && self.seen.is_disjoint(places) {
            self.seen = self.seen.union(places);
            return Cycle::Same;
        }
        let judgement = self.sequence.judge(timestamp, sampled_us);
        self.seen = places;
        self.in_sequence = judgement.is_in_sequence();
        Cycle::Next(judgement)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commit::testing::{frames, profile};
    use proptest::prelude::*;

    fn end<const N: usize>(sampled_us: u64, frame: usize) -> u64 {
        sampled_us + u64::from(air::age_at_end_us::<N>(frame).expect("a frame of the cycle"))
    }

    fn judge<const N: usize>(acceptance: &mut Acceptance<N>, timestamp: u32, frame: usize, sampled_us: u64) -> Verdict {
        let sent = profile::<N>(timestamp);
        let payload = air::split(&sent).nth(frame).expect("a frame of the cycle");
        acceptance.judge(payload, &Early::default(), end::<N>(sampled_us, frame)).expect("the length is right")
    }

    /// Returns a state that is in sequence: the last cycle had timestamp 40 and was sampled at 40 ms.
    fn in_sequence<const N: usize>() -> Acceptance<N> {
        let mut acceptance = Acceptance::new();
        for cycle in 1..=4_u32 {
            for frame in 0..air::frames(N) {
                let accepted = judge(&mut acceptance, 10 * cycle, frame, 10_000 * u64::from(cycle)).accepted;
                assert_eq!(accepted != Objects::NONE, cycle == 4);
            }
        }
        acceptance
    }

    #[test]
    fn a_set_of_objects_knows_its_members() {
        assert_eq!([1, 2, 3, 5].map(|receivers| Objects::all(receivers).0), [0b11, 0b111, 0b1111, 0b11_1111]);
        let place = |frame| Objects::at(Place::of_frame::<5>(frame).expect("a frame"));
        assert_eq!((place(0), place(1)), (Objects(0b111), Objects(0b11_1000)));
        let set = Objects(0b0110);
        assert_eq!([0, 1, 2, 3, 6, 8, 9].map(|index| set.has(index)), [false, true, true, false, false, false, false]);
        assert!(!Objects(1 << 6).has(6));
        assert_eq!(set.union(Objects(0b1010)), Objects(0b1110));
        assert!(set.is_disjoint(Objects(0b1001)) && !set.is_disjoint(Objects(0b0100)));
        assert_eq!((set.count(), Objects::NONE.count()), (2, 0));
        assert_eq!((set.with(0, true), set.with(1, true), set.with(0, false)), (Objects(0b0111), set, set));
    }

    #[test]
    fn a_sound_frame_in_sequence_is_accepted_whole() {
        let verdict = judge(&mut in_sequence::<3>(), 50, 0, 50_000);
        assert_eq!(verdict.accepted, Objects::all(3));
        assert_eq!(verdict.rejected(), Objects::NONE);
        assert_eq!(verdict.cycle, Cycle::Next(Judgement::InSequence { missed: 0 }));
        assert_eq!((verdict.sampled_us, verdict.frame()), (50_000, 0));
    }

    #[test]
    fn out_of_sequence_every_object_is_rejected_until_the_sequence_is_found() {
        let mut acceptance = in_sequence::<1>();
        let in_sequence = |missed| Judgement::InSequence { missed };
        let searching = |found| Judgement::Searching { found };
        for (timestamp, sampled_us, expected) in [
            (50, 50_000, in_sequence(0)),
            (50, 60_000, Judgement::Frozen),
            (60, 70_000, searching(1)),
            (70, 80_000, searching(2)),
            (80, 90_000, in_sequence(0)),
            (110, 120_000, in_sequence(2)),
            (117, 127_000, Judgement::Irregular),
            (127, 137_000, searching(1)),
            (137, 147_000, searching(2)),
            (147, 157_000, in_sequence(0)),
            (157, 158_000, Judgement::Early),
            (0, 500_000, Judgement::Restarted),
            (10, 510_000, searching(1)),
            (20, 520_000, searching(2)),
            (30, 530_000, in_sequence(0)),
            (40, 543_000, Judgement::Late),
        ] {
            let verdict = judge(&mut acceptance, timestamp, 0, sampled_us);
            assert_eq!(verdict.cycle, Cycle::Next(expected), "at {timestamp}");
            let accepted = if expected.is_in_sequence() { Objects::all(1) } else { Objects::NONE };
            assert_eq!(verdict.accepted, accepted, "at {timestamp}");
            assert_eq!(acceptance.sequence().is_held(sampled_us), expected.is_in_sequence());
        }
    }

    #[test]
    fn two_frames_in_turn_are_never_accepted() {
        let mut acceptance = Acceptance::<3>::new();
        for turn in 1..200_u64 {
            let verdict = judge(&mut acceptance, if turn % 2 == 1 { 20 } else { 10 }, 0, 10_000 * turn);
            assert_eq!(verdict.accepted, Objects::NONE, "turn {turn}");
        }
    }

    #[test]
    fn the_second_frame_of_a_cycle_shares_the_verdict_on_the_first() {
        let mut acceptance = in_sequence::<5>();
        assert_eq!(judge(&mut acceptance, 50, 0, 50_000).accepted, Objects(0b00_0111));
        let second = judge(&mut acceptance, 50, 1, 50_010);
        assert_eq!((second.cycle, second.accepted, second.frame()), (Cycle::Same, Objects(0b11_1000), 1));
        for frame in [0, 1] {
            let mut again = acceptance;
            let verdict = judge(&mut again, 50, frame, 50_000);
            assert_eq!((verdict.cycle, verdict.accepted), (Cycle::Next(Judgement::Frozen), Objects::NONE));
        }
    }

    // Shows SEQ-7.
    #[test]
    fn a_second_frame_that_was_held_back_is_not_accepted_however_long() {
        for (off, same) in [(-2_501_i64, false), (-2_500, true), (2_500, true), (2_501, false), (10_000, false)] {
            let mut acceptance = in_sequence::<5>();
            judge(&mut acceptance, 50, 0, 50_000);
            let verdict = judge(&mut acceptance, 50, 1, 50_000_u64.wrapping_add_signed(off));
            assert_eq!(verdict.cycle == Cycle::Same, same, "{off} µs");
            assert_eq!(verdict.accepted != Objects::NONE, same, "{off} µs");
        }
        let mut acceptance = in_sequence::<5>();
        judge(&mut acceptance, 50, 0, 50_000);
        assert_eq!(judge(&mut acceptance, 50, 1, 50_000 + (1 << 32)).accepted, Objects::NONE);
    }

    #[test]
    fn two_frames_of_a_cycle_in_the_wrong_order_are_not_accepted() {
        let mut acceptance = in_sequence::<5>();
        assert_eq!(judge(&mut acceptance, 50, 1, 50_000).accepted, Objects(0b11_1000));
        // The first frame's timestamp comes again, but its sample instant is too late for the same cycle.
        let sampled_us = 50_000 + u64::from(air::send_slot_us::<5>(1).expect("a second frame"));
        let verdict = judge(&mut acceptance, 50, 0, sampled_us);
        assert_eq!((verdict.cycle, verdict.accepted), (Cycle::Next(Judgement::Frozen), Objects::NONE));
    }

    #[test]
    fn it_does_not_matter_which_frames_of_a_cycle_are_heard() {
        // Whichever frames of the first four cycles are received (the first, the second or both), these cycles find the
        // sequence.
        for heard in 0..3_usize.pow(6) {
            let mut acceptance = Acceptance::<5>::new();
            for cycle in 1..=6_u32 {
                let which = heard / 3_usize.pow(cycle - 1) % 3;
                for frame in (0..2).filter(|&frame| which == 2 || frame == which) {
                    let verdict = judge(&mut acceptance, 10 * cycle, frame, 10_000 * u64::from(cycle));
                    assert_eq!(verdict.accepted != Objects::NONE, cycle >= 4, "{heard}: frame {frame} of {cycle}");
                }
            }
        }
    }

    #[test]
    fn the_second_frame_of_a_cycle_out_of_sequence_is_rejected_too() {
        let mut acceptance = in_sequence::<5>();
        assert_eq!(judge(&mut acceptance, 57, 0, 57_000).accepted, Objects::NONE);
        let verdict = judge(&mut acceptance, 57, 1, 57_000);
        assert_eq!((verdict.cycle, verdict.accepted), (Cycle::Same, Objects::NONE));
    }

    // Shows SEQ-8.
    #[test]
    fn objects_of_another_cycle_in_one_frame_are_rejected_by_themselves() {
        let mut payload = profile::<3>(50).as_bytes().to_vec();
        payload[124..184].copy_from_slice(&profile::<3>(40).as_bytes()[124..184]);
        let verdict = in_sequence::<3>().judge(&payload, &Early::default(), end::<3>(50_000, 0));
        assert_eq!(verdict.expect("the length is right").rejected(), Objects(1 << 2));
    }

    #[test]
    fn a_frame_without_an_intact_object_leaves_the_sequence_unchanged() {
        for fill in [0x00, 0xFF] {
            let mut acceptance = in_sequence::<3>();
            let before = *acceptance.sequence();
            let verdict = acceptance.judge(&[fill; 244], &Early::default(), end::<3>(50_000, 0)).expect("the length");
            assert_eq!((verdict.cycle, verdict.accepted), (Cycle::Unknown, Objects::NONE));
            assert_eq!(*acceptance.sequence(), before);
            assert_eq!(judge(&mut acceptance, 60, 0, 60_000).accepted, Objects::all(3));
        }
    }

    proptest! {
        // Shows OBJ-9.
        #[test]
        fn a_hit_costs_the_object_it_hits_and_no_other(byte in 0_usize..244, flip in 1_u8..) {
            let mut payload = profile::<3>(50).as_bytes().to_vec();
            payload[byte] ^= flip;
            let hit = if byte < 64 { 0 } else { 1 + (byte - 64) / 60 };
            let verdict = in_sequence::<3>().judge(&payload, &Early::default(), end::<3>(50_000, 0));
            prop_assert_eq!(verdict.expect("the length is right").rejected(), Objects(1 << hit));
        }

        // Shows OBJ-10.
        #[test]
        fn no_other_length_is_judged(length in 0_usize..300) {
            let payload = vec![0; length];
            let early = &Early::default();
            prop_assert_eq!(Acceptance::<1>::new().judge(&payload, early, 0).is_ok(), length == 124);
            prop_assert_eq!(Acceptance::<2>::new().judge(&payload, early, 0).is_ok(), length == 184);
            prop_assert_eq!(Acceptance::<3>::new().judge(&payload, early, 0).is_ok(), length == 244);
            prop_assert_eq!(Acceptance::<5>::new().judge(&payload, early, 0).is_ok(), length == 184 || length == 180);
        }

        #[test]
        fn what_was_verified_early_changes_no_verdict(
            byte in 0_usize..370, flip: u8, reads in prop::collection::vec(1_usize..246, 0..4),
            announced in prop::option::of(any::<u8>()),
        ) {
            let sent = profile::<5>(50);
            for (frame, mut payload) in air::split(&sent).map(<[u8]>::to_vec).enumerate() {
                if let Some(byte) = payload.get_mut(byte) {
                    *byte ^= flip;
                }
                let mut arrived = vec![announced.unwrap_or(payload.len() as u8 + 1)];
                arrived.extend(&payload);
                let mut early = Early::default();
                let mut reads = reads.clone();
                reads.sort_unstable();
                for read in reads {
                    early.follow::<5>(&arrived[..read.min(arrived.len())]);
                }
                let ended_us = end::<5>(50_000, frame);
                let verdict = in_sequence::<5>().judge(&payload, &early, ended_us);
                prop_assert_eq!(verdict, in_sequence::<5>().judge(&payload, &Early::default(), ended_us));
            }
        }
    }

    #[test]
    fn all_but_the_last_object_are_verified_before_the_last_bytes_arrive() {
        let mut arrived = vec![245];
        arrived.extend(profile::<3>(10).as_bytes());
        let mut early = Early::default();
        early.follow::<3>(&arrived[..16]);
        assert_eq!(early.done, 0);
        early.follow::<3>(&arrived[..222]);
        assert_eq!((early.done, early.intact), (3, Objects(0b0111)));
        assert_eq!(early.timestamps, [10, 10, 10, 10]);
    }

    // Shows SAFE-18.
    #[test]
    fn a_timestamp_that_changes_after_its_crc_has_begun_is_not_used() {
        let sent = profile::<3>(50);
        let mut arrived = vec![245];
        arrived.extend(&sent.as_bytes()[..16]);
        let mut early = Early::default();
        early.follow::<3>(&arrived);
        arrived[4] ^= 0x40;
        arrived.extend(&sent.as_bytes()[16..100]);
        early.follow::<3>(&arrived);
        assert_eq!((early.done, early.timestamps[0]), (1, 50));
    }

    // Shows SAFE-18.
    #[test]
    fn a_flipped_bit_of_a_timestamp_has_the_frame_verified_anew() {
        let sent = profile::<3>(50);
        let mut arrived = vec![245];
        arrived.extend(&sent.as_bytes()[..200]);
        let mut early = Early::default();
        for (length, done) in [(100, 1), (140, 2), (201, 3)] {
            early.follow::<3>(&arrived[..length]);
            early.verify();
            assert_eq!(early.done, done, "of {length} bytes");
        }
        early.timestamps[0] ^= 1 << 30;
        early.verify();
        assert_eq!(early, Early::default());
        let verdict = in_sequence::<3>().judge(sent.as_bytes(), &early, end::<3>(50_000, 0)).expect("the length");
        assert_eq!(verdict.accepted, Objects::all(3));
    }

    #[test]
    fn the_objects_of_a_second_frame_are_verified_early_too() {
        let [_, second] = frames(70);
        let mut arrived = vec![181];
        arrived.extend(&second);
        let mut early = Early::default();
        early.follow::<5>(&arrived[..60]);
        assert_eq!(early.done, 0);
        early.follow::<5>(&arrived[..61]);
        assert_eq!((early.done, early.intact), (1, Objects(0b1000)));
        early.follow::<5>(&arrived[..181]);
        assert_eq!((early.done, early.intact), (3, Objects(0b11_1000)));
        assert_eq!(early.timestamps, [70, 70, 70, 0]);
    }

    #[test]
    fn bytes_beyond_the_length_of_a_frame_are_no_objects() {
        // The bytes beyond the first frame's length are GPS3, intact and at the right offset, but the first frame does
        // not carry GPS3.
        let sent = profile::<5>(70);
        let mut arrived = vec![185];
        arrived.extend(&sent.as_bytes()[..244]);
        let mut early = Early::default();
        early.follow::<5>(&arrived);
        assert_eq!((early.done, early.intact), (3, Objects(0b0111)));
        assert_eq!(early.timestamps, [70, 70, 70, 0]);
    }

    #[test]
    fn an_object_that_was_found_intact_early_is_not_verified_again() {
        let sent = profile::<3>(50);
        let mut arrived = vec![245];
        arrived.extend(sent.as_bytes());
        let mut early = Early::default();
        early.follow::<3>(&arrived[..65]);
        // A byte of an object that was already verified is changed now, so the object is still accepted.
        let mut payload = sent.as_bytes().to_vec();
        payload[63] ^= 1;
        let verdict = in_sequence::<3>().judge(&payload, &early, end::<3>(50_000, 0)).expect("the length is right");
        assert_eq!(verdict.accepted, Objects::all(3));
    }
}
