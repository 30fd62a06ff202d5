//! Tests which images are published when frames arrive, deadlines pass or images are withdrawn.

use super::testing::{frames, profile};
use super::*;
use crate::link::{FRAME_DEADLINE_US, FRAME_DUE_US, SECOND_FRAME_US, SILENCE_US};
use crate::IMAGE_WORDS;
use profile::{
    image::{Image, ImageReading},
    map::{Map, PortArea},
    LinkStatusBits, LinkValues, Object,
};
use proptest::prelude::*;

/// Port-Status and the uplinks may be any bytes here, since the commit task copies them without reading them.
const PORT: [u8; PortArea::SIZE] = [0x5A; PortArea::SIZE];

struct Album {
    filling: ImageMemory,
    published: Vec<ImageMemory>,
}

impl Album {
    fn new() -> Self {
        Self { filling: [0; IMAGE_WORDS], published: Vec::new() }
    }
    fn last<const N: usize>(&self) -> ImageReading<'_, N> {
        let image = bytemuck::cast_slice(self.published.last().expect("an image was published"));
        Image::<N>::read(&image[..Image::<N>::LEN]).expect("the length is right")
    }
    fn link<const N: usize>(&self) -> LinkValues {
        self.last::<N>().link.expect("Link-Status is intact").values()
    }
    /// Returns number and timestamp of each of HORUS's objects in the newest image. All other bytes of HORUS's part
    /// must be zero.
    fn stamps<const N: usize>(&self) -> Vec<(usize, u32)> {
        let image: &[u8] = bytemuck::cast_slice(self.published.last().expect("an image was published"));
        let shown = (0..=N).filter_map(|index| {
            let bytes = &image[Image::<N>::place(index).expect("an object of the profile")];
            let object = Object::verify(index, bytes).ok().map(|object| (index, object.timestamp()));
            assert!(object.is_some() || bytes.iter().all(|&byte| byte == 0));
            object
        });
        shown.collect()
    }
    fn shown<const N: usize>(&self) -> Vec<usize> {
        let reading = self.last::<N>().profile;
        let gps = reading.gps.iter().enumerate().filter(|(_, object)| object.is_ok());
        reading.reported.is_ok().then_some(0).into_iter().chain(gps.map(|(index, _)| index + 1)).collect()
    }
}

impl Images for Album {
    fn filling(&mut self) -> &mut ImageMemory {
        &mut self.filling
    }
    fn place_port<const N: usize>(&mut self) {
        let image: &mut [u8] = bytemuck::cast_slice_mut(&mut self.filling);
        image[Map::<N>::port_area()].copy_from_slice(&PORT);
    }
    fn publish(&mut self) {
        self.published.push(self.filling);
        self.filling = [0; IMAGE_WORDS];
    }
}

fn end<const N: usize>(sampled_us: u32, frame: usize) -> u32 {
    sampled_us.wrapping_add(air::age_at_end_us::<N>(frame).expect("a frame of the cycle"))
}

const WAITED_US: u32 = 90;

struct Bench<const N: usize> {
    commit: Commit<N>,
    album: Album,
    health: Health,
}

impl<const N: usize> Bench<N> {
    fn new() -> Self {
        let mut bench = Self { commit: Commit::new(), album: Album::new(), health: Health::default() };
        bench.commit.begin(0, &bench.health, &mut bench.album);
        bench
    }
    fn in_sequence() -> Self {
        let mut bench = Self::new();
        for cycle in 1..=4 {
            bench.cycle(10 * cycle, 10_000 * cycle);
        }
        assert_eq!(bench.album.shown::<N>(), (0..=N).collect::<Vec<_>>());
        bench.album.published.clear();
        bench
    }
    fn take(&mut self, payload: &[u8], ended_us: u32, now_us: u32) -> Result<u32, Rejection> {
        let frame = Frame { payload, ended_us, early: &Early::default() };
        self.commit.frame(frame, now_us, &self.health, &mut self.album)
    }
    /// Sends frame number `frame` of the cycle with this timestamp, which is sampled at `sampled_us`. If `damaged` is
    /// true, none of the frame's objects is intact.
    fn frame(&mut self, timestamp: u32, frame: usize, sampled_us: u32, damaged: bool) -> u32 {
        let sent = profile::<N>(timestamp);
        let mut payload = air::split(&sent).nth(frame).expect("a frame of the cycle").to_vec();
        if damaged {
            payload.iter_mut().for_each(|byte| *byte ^= 0x10);
        }
        let ended_us = end::<N>(sampled_us, frame);
        self.take(&payload, ended_us, ended_us.wrapping_add(WAITED_US)).expect("the length is right")
    }
    fn cycle(&mut self, timestamp: u32, sampled_us: u32) {
        for frame in 0..air::frames(N) {
            self.frame(timestamp, frame, sampled_us, false);
        }
    }
    fn check(&mut self, now_us: u32) -> bool {
        self.commit.check_deadline(now_us, &self.health, &mut self.album)
    }
    fn missed(&self) -> u32 {
        self.commit.link().counters()[3]
    }
}

#[test]
fn a_profile_lies_in_the_image_as_it_was_sent() {
    let mut bench = Bench::<3>::in_sequence();
    assert_eq!(bench.frame(50, 0, 50_000, false), 1);
    assert_eq!(bench.commit.deadline_us(), end::<3>(50_000, 0) + FRAME_DEADLINE_US);
    let image: &[u8] = bytemuck::cast_slice(&bench.album.published[0]);
    assert_eq!(&image[32..276], profile::<3>(50).as_bytes());
    assert_eq!(image[276..468], PORT);
    assert!(image[468..].iter().all(|&byte| byte == 0));
    let link = bench.album.link::<3>();
    assert_eq!(link.status, LinkStatusBits::new().with_link_up(true).with_all_accepted(true));
    // The frame's last bit comes 4.915 ms after its sample at 50 ms, and the commit another 0.09 ms later.
    assert_eq!((link.timestamp, link.age_100us), (55, 50));
    // The counts include three cycles of four objects each, which were rejected before the sequence was found.
    let counters = [link.objects_accepted, link.objects_rejected, link.frames_received, link.frames_missed];
    assert_eq!(counters, [8, 12, 5, 0]);
}

#[test]
fn the_first_image_shows_the_link_as_down() {
    let mut bench = Bench::<3>::new();
    bench.commit.begin(2_000, &Health::default(), &mut bench.album);
    assert_eq!(bench.album.shown::<3>(), []);
    let link = bench.album.link::<3>();
    assert_eq!((link.status, link.timestamp), (LinkStatusBits::new().with_out_of_sequence(true), 2));
    assert_eq!((link.age_100us, link.frames_missed, link.frames_received), (u16::MAX, 0, 0));
    assert_eq!(bench.commit.deadline_us(), 2_000 + FRAME_DEADLINE_US);
}

#[test]
fn silence_takes_everything_out_of_the_image_and_keeps_counting() {
    let mut bench = Bench::<2>::in_sequence();
    let ended_us = end::<2>(40_000, 0);
    assert!(!bench.check(ended_us + FRAME_DEADLINE_US - 1));
    assert!(bench.album.published.is_empty());
    assert!(bench.check(ended_us + FRAME_DEADLINE_US));
    assert_eq!(bench.commit.deadline_us(), ended_us + FRAME_DEADLINE_US + SILENCE_US);
    assert!(bench.check(ended_us + FRAME_DEADLINE_US + SILENCE_US));
    assert_eq!(bench.album.published.len(), 2);
    assert_eq!(bench.album.shown::<2>(), []);
    let link = bench.album.link::<2>();
    assert!(!link.status.link_up() && !link.status.all_accepted() && !link.status.out_of_sequence());
    // The frame's last bit comes 3.922 ms after its sample, and the image of the deadline another 22.5 ms later.
    assert_eq!((link.frames_missed, link.age_100us), (2, 262));
    bench.frame(70, 0, 70_000, false);
    assert_eq!(bench.album.shown::<2>(), [0, 1, 2]);
    assert_eq!(bench.missed(), 2);
}

#[test]
fn an_image_that_must_not_be_shown_is_replaced_at_once() {
    let mut bench = Bench::<3>::in_sequence();
    let deadline_us = bench.commit.deadline_us();
    let now_us = end::<3>(40_000, 0) + 4_000;
    let faulty = Health { ram_fault: true, ..Health::default() };
    assert!(bench.commit.withdraw(now_us, &faulty, &mut bench.album));
    assert_eq!((bench.album.published.len(), bench.album.shown::<3>()), (1, vec![]));
    let link = bench.album.link::<3>();
    assert!(link.status.ram_fault() && !link.status.link_up());
    assert_eq!((bench.commit.deadline_us(), bench.missed()), (deadline_us, 0));
    bench.frame(50, 0, 50_000, false);
    assert_eq!(bench.album.shown::<3>(), [0, 1, 2, 3]);
}

fn is_not_withdrawn_while_a_frame_is_due<const N: usize>() {
    let due_us = end::<N>(50_000, 0);
    for (at_us, withdrawn) in [
        (due_us - FRAME_DUE_US - 1, true),
        (due_us - FRAME_DUE_US, false),
        (due_us, false),
        (due_us + FRAME_DUE_US, false),
        (due_us + FRAME_DUE_US + 1, true),
    ] {
        let mut bench = Bench::<N>::in_sequence();
        assert_eq!(bench.commit.withdraw(at_us, &Health::default(), &mut bench.album), withdrawn, "{at_us}");
        assert_eq!(bench.album.published.len(), usize::from(withdrawn));
        assert!(bench.check(due_us + 2_500 + end::<N>(0, air::frames(N) - 1) - end::<N>(0, 0)));
        assert_eq!(bench.album.shown::<N>(), []);
    }
}

#[test]
fn an_image_is_not_withdrawn_while_a_frame_is_due() {
    is_not_withdrawn_while_a_frame_is_due::<1>();
    is_not_withdrawn_while_a_frame_is_due::<3>();
    is_not_withdrawn_while_a_frame_is_due::<5>();
    // Before the first cycle no frame is due. After the second frame of a cycle was missed, no frame is due either.
    let mut bench = Bench::<5>::new();
    assert!(bench.commit.withdraw(FRAME_DEADLINE_US - 2_500, &Health::default(), &mut bench.album));
    let mut bench = Bench::<5>::in_sequence();
    bench.frame(50, 0, 50_000, false);
    assert!(bench.check(end::<5>(50_000, 0) + SECOND_FRAME_US));
    assert!(bench.commit.withdraw(end::<5>(60_000, 0), &Health::default(), &mut bench.album));
}

#[test]
fn an_image_that_holds_a_newer_cycle_is_not_withdrawn() {
    let mut bench = Bench::<5>::in_sequence();
    bench.frame(50, 0, 50_000, false);
    let before = bench.album.published.len();
    assert!(!bench.commit.withdraw(end::<5>(50_000, 0) + 100, &Health::default(), &mut bench.album));
    assert_eq!(bench.album.published.len(), before);
    bench.frame(50, 1, 50_000, false);
    assert_eq!(bench.album.shown::<5>(), [0, 1, 2, 3, 4, 5]);
    // The image being filled waits for the cycle's second frame, so no image without objects replaces it, even if it
    // holds no object yet.
    bench.frame(60, 0, 60_000, true);
    assert!(!bench.commit.withdraw(end::<5>(60_000, 0) + 300, &Health::default(), &mut bench.album));
}

// Shows SAFE-10.
#[test]
fn while_flash_is_changed_every_object_is_rejected_and_none_is_shown() {
    let mut bench = Bench::<3>::in_sequence();
    bench.health.flash_fault = true;
    let [accepted, rejected, ..] = bench.commit.link().counters();
    bench.frame(50, 0, 50_000, false);
    assert_eq!(bench.album.shown::<3>(), []);
    assert!(bench.album.link::<3>().status.flash_fault());
    let [accepted_after, rejected_after, ..] = bench.commit.link().counters();
    assert_eq!((accepted_after, rejected_after), (accepted, rejected + 4));
    bench.health.flash_fault = false;
    bench.frame(60, 0, 60_000, false);
    assert_eq!(bench.album.shown::<3>(), [0, 1, 2, 3]);
}

#[test]
fn a_deadline_that_passed_long_ago_is_one_image_without_objects() {
    for n in [40_u32, 400_000] {
        let mut bench = Bench::<3>::in_sequence();
        let now_us = end::<3>(40_000, 0) + FRAME_DEADLINE_US + n * SILENCE_US + 1;
        assert!(bench.check(now_us) == (n < 200_000), "35 minutes");
        if n < 200_000 {
            assert_eq!((bench.missed(), bench.album.published.len()), (n + 1, 1));
            assert_eq!(bench.album.shown::<3>(), []);
            assert!(!bench.check(now_us + SILENCE_US - 2));
            assert!(bench.check(now_us + SILENCE_US - 1));
        }
    }
}

#[test]
fn a_frame_of_wrong_length_does_not_postpone_the_deadline() {
    let mut bench = Bench::<3>::in_sequence();
    let deadline_us = bench.commit.deadline_us();
    let wrong = profile::<2>(50);
    for ended_us in [deadline_us - 1, deadline_us] {
        assert_eq!(bench.take(wrong.as_bytes(), ended_us, deadline_us), Err(Rejection::Length));
    }
    assert_eq!((bench.commit.deadline_us(), bench.album.published.len()), (deadline_us, 0));
    assert!(bench.check(deadline_us));
    assert_eq!(bench.album.shown::<3>(), []);
    assert_eq!(bench.commit.link().counters(), [4, 12, 4, 1]);
}

// Shows IMG-1.
#[test]
fn the_deadline_counts_from_the_end_of_the_frame() {
    let mut bench = Bench::<1>::in_sequence();
    let sent = profile::<1>(50);
    let ended_us = end::<1>(50_000, 0);
    assert_eq!(bench.take(sent.as_bytes(), ended_us, ended_us + 3_000), Ok(1));
    assert_eq!(bench.commit.deadline_us(), ended_us + FRAME_DEADLINE_US);
    assert_eq!(bench.album.link::<1>().age_100us, ((ended_us + 3_000 - 50_000) / 100) as u16);
}

#[test]
fn a_frame_and_a_deadline_give_the_same_images_in_either_order() {
    // A frame that ends at the deadline or later is late, so an image without objects comes first. `after_us` is the
    // time from the deadline to the frame's end, µs.
    for after_us in [-1_i32, 0, 1, 150] {
        let mut images = Vec::new();
        for timer_first in [false, true] {
            let mut bench = Bench::<3>::in_sequence();
            let deadline_us = bench.commit.deadline_us();
            let sent = profile::<3>(50);
            let ended_us = deadline_us.wrapping_add_signed(after_us);
            let now_us = ended_us + 200;
            if timer_first && after_us >= 0 {
                assert!(bench.check(now_us));
            }
            let published = bench.take(sent.as_bytes(), ended_us, now_us).expect("the length is right");
            assert_eq!(published, if timer_first || after_us < 0 { 1 } else { 2 });
            assert!(!bench.check(now_us));
            images.push(bench.album.published);
            if timer_first || after_us < 0 {
                continue;
            }
            assert_eq!(images[0].len(), 2);
        }
        assert_eq!(images[0], images[1], "{after_us} µs");
    }
}

#[test]
fn a_frozen_horus_shows_no_object_and_says_why() {
    let mut bench = Bench::<1>::in_sequence();
    bench.frame(40, 0, 50_000, false);
    assert_eq!(bench.album.shown::<1>(), []);
    let status = bench.album.link::<1>().status;
    assert_eq!(status, LinkStatusBits::new().with_out_of_sequence(true).with_horus_frozen(true));
    bench.frame(50, 0, 60_000, false);
    assert_eq!(bench.album.link::<1>().status, LinkStatusBits::new().with_out_of_sequence(true));
}

fn shows_again_after_a_restart<const N: usize>() {
    let mut bench = Bench::<N>::in_sequence();
    let mut restarted = 0;
    let mut first_shown = None;
    for cycle in 1..=200 {
        bench.cycle(10 * cycle - 10, 500_000 + 10_000 * cycle);
        restarted += u32::from(bench.album.link::<N>().status.horus_restarted());
        if bench.album.shown::<N>().len() == N + 1 {
            first_shown.get_or_insert(cycle);
        }
    }
    assert_eq!((first_shown, restarted), (Some(4), 100));
}

#[test]
fn data_are_shown_from_the_fourth_cycle_after_a_restart_of_horus() {
    shows_again_after_a_restart::<1>();
    shows_again_after_a_restart::<3>();
    shows_again_after_a_restart::<5>();
}

#[test]
fn the_wrap_of_the_counter_is_no_break() {
    let mut bench = Bench::<5>::new();
    let start_us = u32::MAX - 95_000;
    bench.commit.begin(start_us, &Health::default(), &mut bench.album);
    for cycle in 1..=20 {
        bench.cycle(10 * cycle, start_us.wrapping_add(10_000 * cycle));
        assert_eq!(bench.album.shown::<5>().len(), if cycle < 4 { 0 } else { 6 });
        assert!(!bench.check(end::<5>(start_us.wrapping_add(10_000 * cycle), 1).wrapping_add(100)));
    }
    assert_eq!(bench.missed(), 0);
}

#[test]
fn a_silence_as_long_as_the_counter_is_no_cycle() {
    let mut bench = Bench::<1>::in_sequence();
    // Since the last sample, the 32-bit µs counter has wrapped once and then counted one more cycle. So it has the
    // value that the next cycle would have had.
    for _ in 0..4_294 {
        let now_us = bench.commit.deadline_us().wrapping_add(987_500);
        assert!(bench.check(now_us));
    }
    bench.album.published.clear();
    bench.frame(50, 0, 50_000, false);
    assert_eq!(bench.album.shown::<1>(), []);
    assert!(bench.album.link::<1>().status.out_of_sequence());
}

#[test]
fn five_receivers_are_published_with_the_second_frame() {
    let mut bench = Bench::<5>::in_sequence();
    for sampled_us in [50_000, 60_000] {
        assert_eq!(bench.frame(sampled_us / 1_000, 0, sampled_us, false), 0);
        assert_eq!(bench.commit.deadline_us(), end::<5>(sampled_us, 0) + SECOND_FRAME_US);
        assert_eq!(bench.frame(sampled_us / 1_000, 1, sampled_us, false), 1);
        assert_eq!(bench.commit.deadline_us(), end::<5>(sampled_us, 1) + FRAME_DEADLINE_US);
        assert_eq!(bench.album.shown::<5>(), [0, 1, 2, 3, 4, 5]);
    }
    assert!(bench.album.link::<5>().status.all_accepted());
    assert_eq!(bench.missed(), 0);
}

#[test]
fn a_damaged_first_frame_waits_for_its_second() {
    let mut bench = Bench::<5>::in_sequence();
    assert_eq!(bench.frame(50, 0, 50_000, true), 0);
    assert_eq!(bench.frame(50, 1, 50_000, false), 1);
    assert_eq!(bench.album.published.len(), 1);
    assert_eq!(bench.album.shown::<5>(), [3, 4, 5]);
    assert_eq!(bench.commit.link().counters(), [9, 21, 10, 0]);
    bench.cycle(60, 60_000);
    assert_eq!(bench.album.shown::<5>().len(), 6);
    assert_eq!(bench.missed(), 0);
}

#[test]
fn five_receivers_a_damaged_second_frame_goes_out_with_its_first() {
    let mut bench = Bench::<5>::in_sequence();
    assert_eq!(bench.frame(50, 0, 50_000, false), 0);
    assert_eq!(bench.frame(50, 1, 50_000, true), 1);
    assert_eq!(bench.album.shown::<5>(), [0, 1, 2]);
    assert_eq!((bench.missed(), bench.album.published.len()), (0, 1));
}

#[test]
fn a_damaged_first_frame_whose_second_is_lost_shows_nothing() {
    let mut bench = Bench::<5>::in_sequence();
    bench.frame(50, 0, 50_000, true);
    assert!(bench.check(end::<5>(50_000, 0) + SECOND_FRAME_US));
    assert_eq!((bench.album.shown::<5>(), bench.missed()), (vec![], 1));
    bench.cycle(60, 60_000);
    assert_eq!((bench.album.shown::<5>().len(), bench.missed()), (6, 1));
}

#[test]
fn a_damaged_first_frame_is_not_joined_with_another_cycles_second() {
    let mut bench = Bench::<5>::in_sequence();
    bench.frame(50, 0, 50_000, true);
    // The deadline of the cycle's second frame passes, but is only checked when the next frame comes.
    assert_eq!(bench.frame(60, 1, 60_000, false), 2);
    assert_eq!((bench.album.shown::<5>(), bench.missed()), (vec![3, 4, 5], 2));
}

#[test]
fn five_receivers_a_lost_second_frame_costs_its_own_objects_only() {
    let mut bench = Bench::<5>::in_sequence();
    bench.frame(50, 0, 50_000, false);
    assert!(bench.check(end::<5>(50_000, 0) + SECOND_FRAME_US));
    assert_eq!(bench.commit.deadline_us(), end::<5>(50_000, 0) + FRAME_DEADLINE_US);
    assert_eq!(bench.album.shown::<5>(), [0, 1, 2]);
    let link = bench.album.link::<5>();
    assert!(link.status.link_up() && !link.status.all_accepted());
    assert_eq!(link.frames_missed, 1);
}

#[test]
fn a_first_frame_that_waited_too_long_is_not_shown() {
    let mut bench = Bench::<5>::in_sequence();
    bench.frame(50, 0, 50_000, false);
    let too_late_us = end::<5>(50_000, 0) + FRAME_DEADLINE_US;
    let mut late = Bench { commit: bench.commit, album: Album::new(), health: bench.health };
    late.album.filling = bench.album.filling;
    assert!(late.check(too_late_us));
    assert!(late.album.published[0][8..99].iter().all(|&word| word == 0));
    assert_eq!(late.album.shown::<5>(), []);
    assert!(bench.check(too_late_us - 1));
    assert_eq!(bench.album.shown::<5>(), [0, 1, 2]);
}

#[test]
fn five_receivers_a_lost_first_frame_costs_its_own_objects_only() {
    let mut bench = Bench::<5>::in_sequence();
    assert_eq!(bench.frame(50, 1, 50_000, false), 1);
    assert_eq!(bench.album.shown::<5>(), [3, 4, 5]);
    assert_eq!(bench.missed(), 1);
}

// Shows SEQ-8.
#[test]
fn five_receivers_the_halves_of_two_cycles_are_never_shown_together() {
    let mut bench = Bench::<5>::in_sequence();
    bench.frame(50, 0, 50_000, false);
    // The second frame of one cycle and the first frame of the next were lost, and the deadline was checked late.
    assert_eq!(bench.frame(60, 1, 60_000, false), 2);
    assert_eq!(bench.album.published.len(), 2);
    assert_eq!(bench.album.shown::<5>(), [3, 4, 5]);
    assert_eq!(bench.missed(), 2);
}

#[test]
fn a_second_frame_of_another_cycle_is_not_shown_with_the_first() {
    let mut bench = Bench::<5>::in_sequence();
    bench.frame(50, 0, 50_000, false);
    assert_eq!(bench.frame(40, 1, 50_000, false), 2);
    let first: &[u8] = bytemuck::cast_slice(&bench.album.published[0]);
    let first = Image::<5>::read(&first[..Image::<5>::LEN]).expect("the length is right");
    assert!(first.profile.reported.is_ok() && first.profile.gps[2].is_err());
    assert!(!first.link.expect("Link-Status is intact").values().status.out_of_sequence());
    assert_eq!((bench.album.shown::<5>(), bench.missed()), (vec![], 0));
    assert!(bench.album.link::<5>().status.out_of_sequence());
}

#[test]
fn five_receivers_a_first_frame_soon_after_another_closes_its_cycle() {
    let mut bench = Bench::<5>::in_sequence();
    bench.frame(50, 0, 50_000, false);
    assert_eq!(bench.frame(60, 0, 55_000, false), 1);
    assert_eq!(bench.album.shown::<5>(), [0, 1, 2]);
    assert_eq!(bench.frame(60, 1, 55_000, false), 1);
    assert_eq!(bench.album.shown::<5>(), []);
}

#[test]
fn a_repeated_first_frame_closes_its_cycle() {
    let mut bench = Bench::<5>::in_sequence();
    bench.frame(50, 0, 50_000, false);
    assert_eq!(bench.frame(50, 0, 52_000, false), 1);
    assert_eq!(bench.album.shown::<5>(), [0, 1, 2]);
    assert_eq!(bench.frame(50, 1, 50_000, false), 1);
    assert_eq!(bench.album.shown::<5>(), []);
}

#[test]
fn five_receivers_a_damaged_first_frame_is_not_repeated_either() {
    let mut bench = Bench::<5>::in_sequence();
    bench.frame(50, 0, 50_000, true);
    assert_eq!(bench.frame(50, 0, 50_500, true), 1);
    assert_eq!(bench.album.shown::<5>(), []);
}

/// A frame that was sent, and the instant of its end. The test derives from all such frames which images must be shown.
struct Sent {
    second: bool,
    /// The timestamps of the frame's intact objects, with the number of each object in the profile.
    intact: Vec<(usize, u32)>,
    ended_us: i128,
    sampled_us: i128,
}

/// Returns two lists: the timestamp and instant of each frame that begins a cycle, and the cycle of each frame.
fn cycles(sent: &[Sent]) -> (Vec<(u32, i128)>, Vec<Option<usize>>) {
    let mut cycles: Vec<(u32, i128)> = Vec::new();
    let mut places: Vec<Vec<bool>> = Vec::new();
    let mut of_frame = Vec::new();
    for frame in sent {
        let Some(&(_, timestamp)) = frame.intact.first() else {
            of_frame.push(None);
            continue;
        };
        let joins =
            cycles.last().is_some_and(|&(last, at)| last == timestamp && (frame.sampled_us - at).abs() <= 2_500)
                && places.last().is_some_and(|places| !places.contains(&frame.second));
        if joins {
            places.last_mut().expect("a cycle").push(frame.second);
        } else {
            cycles.push((timestamp, frame.sampled_us));
            places.push(vec![frame.second]);
        }
        of_frame.push(Some(cycles.len() - 1));
    }
    (cycles, of_frame)
}

fn in_sequence(cycles: &[(u32, i128)]) -> bool {
    let step = |pair: &[(u32, i128)]| (i128::from(pair[1].0) - i128::from(pair[0].0)).rem_euclid(1 << 32);
    let off = |pair: &[(u32, i128)]| (pair[1].1 - pair[0].1 - 1_000 * step(pair)).abs();
    let exact = |pair: &[(u32, i128)]| step(pair) == 10 && off(pair) <= 500;
    let goes_on = |pair: &[(u32, i128)]| {
        step(pair) % 10 == 0 && (10..=260).contains(&step(pair)) && off(pair) <= 2_500 + 20 * step(pair)
    };
    let steps: Vec<_> = cycles.windows(2).collect();
    (3..=steps.len()).any(|end| {
        steps[end - 3..end].iter().all(|&pair| exact(pair)) && steps[end..].iter().all(|&pair| goes_on(pair))
    })
}

/// Returns the number and timestamp of each object that frame number `number` brings and an image may show.
fn may_be_shown(sent: &[Sent], number: usize) -> Vec<(usize, u32)> {
    let (cycles, of_frame) = cycles(&sent[..=number]);
    match of_frame[number] {
        Some(cycle) if in_sequence(&cycles[..=cycle]) => {
            let timestamp = cycles[cycle].0;
            sent[number].intact.iter().copied().filter(|&(_, of)| of == timestamp).collect()
        }
        _ => Vec::new(),
    }
}

/// Returns what the newest image shows at the instant `now`, which depends on the last frame before `now`.
fn newest(sent: &[Sent], receivers: usize, now: i128) -> Vec<(usize, u32)> {
    let Some(number) = sent.iter().rposition(|frame| frame.ended_us <= now) else { return Vec::new() };
    let (frame, passed) = (&sent[number], now - sent[number].ended_us);
    let alone = may_be_shown(sent, number);
    if passed >= 12_500 {
        return Vec::new();
    }
    if receivers == 5 && !frame.second {
        // A cycle's first frame waits for the second. Until the second frame's deadline the newest image stays the one
        // from before the first frame.
        return if passed >= 7_000 { alone } else { before(sent, receivers, number) };
    }
    let Some(first) = number
        .checked_sub(1)
        .map(|number| &sent[number])
        .filter(|first| frame.second && !first.second && (first.sampled_us - frame.sampled_us).abs() <= 2_500)
    else {
        return alone;
    };
    let with_it = may_be_shown(sent, number - 1);
    let (_, of_frame) = cycles(&sent[..=number]);
    let contradicts = of_frame[number].is_some() && of_frame[number] != of_frame[number - 1];
    if contradicts && !with_it.is_empty() || first.ended_us + 7_000 <= frame.ended_us {
        return alone;
    }
    with_it.into_iter().chain(alone).collect()
}

/// Returns what the newest image shows while frame `number`, the first of its cycle, waits for its second frame. If the
/// previous frame still waited for its own second frame, it is published when frame `number` ends.
fn before(sent: &[Sent], receivers: usize, number: usize) -> Vec<(usize, u32)> {
    let Some(previous) = number.checked_sub(1) else { return Vec::new() };
    let passed = sent[number].ended_us - sent[previous].ended_us;
    if receivers == 5 && !sent[previous].second && passed < 7_000 {
        return may_be_shown(sent, previous);
    }
    newest(&sent[..=previous], receivers, sent[number].ended_us)
}

type Step = (u8, u32, u8);

fn images_are_as_the_definition_says<const N: usize>(start_us: u32, steps: &[Step]) -> Result<(), TestCaseError> {
    let mut bench = Bench::<N>::new();
    bench.commit.begin(start_us, &Health::default(), &mut bench.album);
    let mut sent: Vec<Sent> = Vec::new();
    let origin = i128::from(start_us);
    let (mut timestamp, mut sampled_us) = (u32::MAX - 300, origin);
    let mut now = origin;
    for &(kind, number, hits) in steps {
        // In most steps HORUS's cycles come in order. In the others the timestamp, HORUS's clock or the channel has a
        // fault.
        let (ms, us) = match kind {
            0..=19 => (10, 10_000),
            20 | 21 => (10, 9_500 + i128::from(number % 1_002)),
            22 => (10, 7_200 + i128::from(number % 5_600)),
            23 => (10 * (1 + number % 28), 10_000 * (1 + i128::from(number % 28))),
            24 => (0, 10_000),
            25 => (10_u32.wrapping_neg(), 10_000),
            26 => (number % 100, 10_000),
            27 => (10, 5_000 + i128::from(number % 60_000)),
            28 => (number, 10_000),
            _ => (20, 20_000),
        };
        (timestamp, sampled_us) = (timestamp.wrapping_add(ms), sampled_us + us);
        let profile = profile::<N>(timestamp);
        for (frame, payload) in air::split(&profile).enumerate() {
            // A random number decides for each frame whether it is lost, damaged, or the second frame of another cycle.
            if number >> 8 & 0xF == frame as u32 + 1 {
                continue;
            }
            let mut payload = payload.to_vec();
            let mut of = timestamp;
            if frame == 1 && number >> 16 & 0xF == 3 {
                of = timestamp.wrapping_sub(10);
                payload = frames(of)[1].clone();
            }
            let hits = if number >> 12 & 0x3 == 0 { hits } else { 0 };
            let place = air::place::<N>(&payload).expect("a frame");
            let mut intact = Vec::new();
            for (index, object) in air::objects::<N>(&payload.clone()).expect("a frame") {
                let from = object.len() * (index - place.first()) + if place.first() == 0 && index > 0 { 4 } else { 0 };
                if hits >> index & 1 == 1 {
                    payload[from + 9] ^= 4;
                } else {
                    intact.push((index, of));
                }
            }
            let ended = sampled_us + i128::from(air::age_at_end_us::<N>(frame).expect("a frame of the cycle"));
            if ended <= now {
                continue;
            }
            // The random number also decides whether the frame's deadline is checked in time or only when the next
            // frame comes.
            if number >> 20 & 0x3 != 0 {
                let mut deadline = now;
                while deadline < ended {
                    let wait = bench.commit.deadline_us().wrapping_sub(deadline as u32).cast_signed();
                    deadline += i128::from(wait.max(0));
                    if deadline < ended {
                        prop_assert!(bench.check(deadline as u32));
                        let expected = newest(&sent, N, deadline);
                        prop_assert_eq!(bench.album.stamps::<N>(), expected, "at the deadline {}", deadline);
                    }
                }
            }
            prop_assert!(bench.take(&payload, ended as u32, ended as u32).is_ok());
            sent.push(Sent { second: frame == 1, intact, ended_us: ended, sampled_us });
            now = ended;
            prop_assert_eq!(bench.album.stamps::<N>(), newest(&sent, N, now), "frame {} at {}", frame, now);
            prop_assert!(!bench.check(now as u32));
            let (cycles, _) = cycles(&sent);
            prop_assert_eq!(
                bench.commit.link.seal(Objects::NONE, Objects::NONE, &bench.health).status().out_of_sequence(),
                !in_sequence(&cycles) || now - cycles.last().map_or(0, |last| last.1) > 267_700
            );
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(192))]
    #[test]
    fn any_sequence_of_frames_gives_the_images_of_the_definition(
        start_us: u32, steps in prop::collection::vec((0_u8..30, any::<u32>(), any::<u8>()), 1..50),
    ) {
        images_are_as_the_definition_says::<1>(start_us, &steps)?;
        images_are_as_the_definition_says::<3>(start_us, &steps)?;
        images_are_as_the_definition_says::<5>(start_us, &steps)?;
    }
}
