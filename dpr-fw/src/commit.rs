//! From frame to image: deposits what is accepted, decides when an image is published.
//!
//! # Design
//!
//! Each image is built from scratch in a scrubbed buffer: accepted objects are copied in, all else stays zero, which no
//! CRC accepts. Nothing is ever carried over from the image before.
//!
//! - Up to three receivers: a cycle is one frame, so each frame is published at once, also one of which no object was
//!   accepted.
//! - Five receivers: the image is published with the cycle's second frame. The two belong together if their ends say
//!   the same instant of the sample ([`accept::SAME_SAMPLE_US`](crate::accept::SAME_SAMPLE_US)), so also where one of
//!   them is damaged and its timestamp unknown; if both are known, their timestamps must be the same. If the second
//!   does not come, what there is is published when its deadline has passed
//!   ([`link::SECOND_FRAME_US`](crate::link::SECOND_FRAME_US)) or a frame arrives that does not belong to it. A second
//!   frame whose first was lost is published at once.
//! - Silence: at each deadline an image without objects is published, so that what was valid once does not stay
//!   readable.
//!
//! The deadline is an instant on the DPR's µs counter, counted from the end of the last frame. Whether it has passed is
//! decided here from that instant alone, never from the interrupt that reports it: the task that a frame starts and the
//! task that the timer starts do the same three things. They take in the frames that wait, call
//! [`Commit::check_deadline`], and set the timer to [`Commit::deadline_us`]. A deadline that passed before a frame
//! ended is dealt with before that frame, so the images are the same in either order of the two tasks.
//!
//! Objects are copied under a mask, so that copying costs the same whether they are accepted or not.

use core::hint::black_box;

use profile::{air, image::Image, GpsObject, Rejection, ReportedPosition};

use crate::{
    accept::{same_sample, Acceptance, Cycle, Early, Objects, Verdict},
    link::{Health, Link, Monitor},
    ImageMemory,
};

/// Where images go.
pub trait Images {
    /// The image being filled: the same one until it is published, scrubbed when it is first asked for.
    fn filling(&mut self) -> &mut ImageMemory;
    /// Makes what was filled the newest image.
    fn publish(&mut self);
}

/// A frame out of a receive buffer.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Its payload, as received.
    pub payload: &'a [u8],
    /// The counter, µs, when the front end reported its end: not after the frame is handed to [`Commit::frame`].
    pub ended_us: u32,
    /// What of it was verified while it arrived.
    pub early: Early,
}

/// The commit task's state, for a profile of `N` receivers.
#[derive(Clone, Copy, Debug)]
pub struct Commit<const N: usize> {
    acceptance: Acceptance<N>,
    monitor: Monitor<N>,
    link: Link,
    /// Objects in the image being filled.
    shown: Objects,
    /// If the image being filled waits for its cycle's second frame: when the cycle was sampled, µs since start.
    open: Option<u64>,
}

impl<const N: usize> Default for Commit<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Commit<N> {
    /// Objects in a profile.
    const OBJECTS: usize = N + 1;

    /// Nothing received yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            acceptance: Acceptance::new(),
            monitor: Monitor::new(),
            link: Link::new(),
            shown: Objects::NONE,
            open: None,
        }
    }

    /// The DPR has started: publishes an image without objects, so that the flight controller can read Link-Status from
    /// now on. `now_us` is the value of the DPR's µs counter here and below; it never goes back from one call to the
    /// next.
    pub fn begin(&mut self, now_us: u32, health: &Health, images: &mut impl Images) {
        self.link.advance(now_us);
        self.monitor.begin(now_us);
        self.publish(health, images);
    }

    /// Takes a frame in, and restarts the deadline from its end. Frames are to be taken in in the order of their ends.
    /// How many images were published: one, none if the second frame of a cycle is waited for, one more if something
    /// else had to go out first.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if the frame has no place in this profile; then nothing has changed and the deadline
    /// stands.
    pub fn frame(
        &mut self,
        frame: Frame<'_>,
        now_us: u32,
        health: &Health,
        images: &mut impl Images,
    ) -> Result<u32, Rejection> {
        self.link.advance(now_us);
        let ended_us = self.link.clock().instant_us(frame.ended_us);
        let verdict = self.acceptance.judge(frame.payload, frame.early, ended_us)?;

        let mut published = u32::from(self.lapse(frame.ended_us, health, images));
        self.link.missed(self.monitor.frame(verdict.frame(), verdict.sampled_us, frame.ended_us));
        let first = verdict.frame() == 0;
        let last = verdict.place.first() + verdict.place.count() == Self::OBJECTS;
        if let Some(sampled_us) = self.open {
            let other_slot = first || !same_sample(sampled_us, verdict.sampled_us);
            let other_cycle = matches!(verdict.cycle, Cycle::Next(_)) && self.shown != Objects::NONE;
            if other_slot || other_cycle {
                // Still with the status of the cycle that it shows.
                self.publish(health, images);
                published += 1;
            }
        }
        self.link.frame(&verdict, self.acceptance.sequence());
        self.deposit(frame.payload, &verdict, images);
        if last {
            self.publish(health, images);
            published += 1;
        } else {
            self.open = Some(verdict.sampled_us);
        }
        Ok(published)
    }

    /// Publishes an image if the deadline has passed at `now_us`: what there is of a cycle whose second frame has not
    /// come, without objects if no frame has. Moves the deadline on. To be called at any time after the frames that
    /// wait were taken in; however long ago the deadline has passed, the work is the same. Whether an image was
    /// published.
    pub fn check_deadline(&mut self, now_us: u32, health: &Health, images: &mut impl Images) -> bool {
        self.link.advance(now_us);
        self.lapse(now_us, health, images)
    }

    /// The next deadline: a value of the DPR's µs counter, to be compared wrapping. It moves with each frame and with
    /// each deadline that passes.
    #[must_use]
    pub const fn deadline_us(&self) -> u32 {
        self.monitor.deadline_us()
    }

    /// What is counted and shown of the link.
    #[must_use]
    pub const fn link(&self) -> &Link {
        &self.link
    }

    /// Does what the deadlines that have passed until `until_us` demand; whether there was one, and an image was
    /// published.
    fn lapse(&mut self, until_us: u32, health: &Health, images: &mut impl Images) -> bool {
        let Some(lapse) = self.monitor.lapse(until_us) else { return false };
        self.link.missed(lapse.missed);
        if lapse.silent {
            // What waits for a second frame is too old by now.
            images.filling().fill(0);
            self.shown = Objects::NONE;
        }
        self.publish(health, images);
        true
    }

    /// Copies the accepted objects in, and zeros in the rejected ones' place, at the same cost.
    fn deposit(&mut self, payload: &[u8], verdict: &Verdict, images: &mut impl Images) {
        let image: &mut [u8] = bytemuck::cast_slice_mut(images.filling());
        let Ok(objects) = air::objects::<N>(payload) else { return };
        for (index, object) in objects {
            // Behind the barrier the compiler cannot tell the two masks apart, or it would copy or clear, at different
            // costs.
            let mask = black_box(if verdict.accepted.has(index) { u32::MAX } else { 0 });
            let Some(place) = Image::<N>::place(index).and_then(|place| image.get_mut(place)) else { return };
            // Both object sizes are multiples of four.
            let (to, _) = place.as_chunks_mut();
            let (from, _) = object.as_chunks();
            for (to, from) in to.iter_mut().zip(from) {
                *to = (u32::from_ne_bytes(*from) & mask).to_ne_bytes();
            }
        }
        self.shown = self.shown.union(verdict.accepted);
    }

    /// Seals Link-Status into the image and lets it go.
    fn publish(&mut self, health: &Health, images: &mut impl Images) {
        let status = self.link.seal(self.shown, Objects::all(N), health);
        let image: &mut [u8] = bytemuck::cast_slice_mut(images.filling());
        if let Some((place, _)) = image.split_first_chunk_mut() {
            *place = *status.as_bytes();
        }
        images.publish();
        self.shown = Objects::NONE;
        self.open = None;
    }
}

const _: () = assert!(GpsObject::SIZE.is_multiple_of(4) && ReportedPosition::SIZE.is_multiple_of(4));

#[cfg(test)]
pub(crate) mod testing {
    use profile::{air, GpsStatus, GpsValues, Profile, ReportedStatus, ReportedValues};

    /// A sealed profile whose every value tells its timestamp and its place.
    pub(crate) fn profile<const N: usize>(timestamp: u32) -> Profile<N> {
        let reported = ReportedValues {
            timestamp,
            status: ReportedStatus::new().with_position_valid(true),
            latitude: 47.0 + f64::from(timestamp) * 1e-6,
            longitude: 8.0 + f64::from(timestamp) * 1e-6,
            altitude: 400.0,
            pitch: 0.1,
            yaw: 0.2,
            roll: 0.3,
            acceleration: [0.0, 1.0, 2.0],
        };
        let mut place = 0.0;
        let gps = [(); N].map(|()| {
            place += 1.0;
            GpsValues {
                timestamp,
                status: GpsStatus::new().with_heard(true),
                latitude: 47.0 + f64::from(timestamp) * 1e-6,
                longitude: 8.0,
                altitude: 400.0 + place,
                pitch: 0.1,
                yaw: 0.2,
                roll: 0.3,
                acceleration: [0.0, 1.0, 2.0],
            }
        });
        Profile::seal(&reported, &gps)
    }

    /// The two frames of a profile with five receivers.
    pub(crate) fn frames(timestamp: u32) -> [Vec<u8>; 2] {
        let profile = profile::<5>(timestamp);
        let frames: Vec<_> = air::split(&profile).map(<[u8]>::to_vec).collect();
        frames.try_into().expect("two frames")
    }
}

#[cfg(test)]
mod tests {
    use super::testing::{frames, profile};
    use super::*;
    use crate::link::{FRAME_DEADLINE_US, SECOND_FRAME_US, SILENCE_US};
    use crate::IMAGE_WORDS;
    use profile::{image::ImageReading, LinkValues, Object};
    use proptest::prelude::*;

    /// Keeps every image that was published.
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
        /// Which objects the newest image shows.
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
        fn publish(&mut self) {
            self.published.push(self.filling);
            self.filling = [0; IMAGE_WORDS];
        }
    }

    struct Bench<const N: usize> {
        commit: Commit<N>,
        album: Album,
        now: u32,
    }

    impl<const N: usize> Bench<N> {
        fn new() -> Self {
            Self { commit: Commit::new(), album: Album::new(), now: 0 }
        }
        fn frame(&mut self, payload: &[u8], after_us: u32) -> Result<Committed, Rejection> {
            self.now += after_us;
            let frame = Frame { payload, ended_us: self.now, early: Early::default() };
            self.commit.frame(frame, self.now + 90, &Health::default(), &mut self.album)
        }
        fn expired(&mut self, after_us: u32) -> Committed {
            self.now += after_us;
            self.commit.expired(self.now, &Health::default(), &mut self.album)
        }
    }

    #[test]
    fn a_profile_lies_in_the_image_as_it_was_sent() {
        let mut bench = Bench::<3>::new();
        let sent = profile::<3>(10);
        let committed = bench.frame(sent.as_bytes(), 10_000).expect("the length is right");
        assert_eq!(committed, Committed { published: 1, deadline_us: FRAME_DEADLINE_US });
        let image: &[u8] = bytemuck::cast_slice(&bench.album.published[0]);
        assert_eq!(&image[32..276], sent.as_bytes());
        assert!(image[276..].iter().all(|&byte| byte == 0));
        let link = bench.album.link::<3>();
        assert!(link.status.link_up() && link.status.all_accepted() && !link.status.horus_frozen());
        assert_eq!((link.timestamp, link.age_100us), (10, 0));
        assert_eq!(
            (link.objects_accepted, link.objects_rejected, link.frames_received, link.frames_missed),
            (4, 0, 1, 0)
        );
    }

    #[test]
    fn from_the_start_there_is_an_image_that_says_the_link_is_down() {
        let mut bench = Bench::<3>::new();
        bench.commit.begin(2_000, &Health::default(), &mut bench.album);
        assert_eq!(bench.album.shown::<3>(), []);
        let link = bench.album.link::<3>();
        assert_eq!((link.status, link.timestamp), (Default::default(), 2));
        assert_eq!((link.age_100us, link.frames_missed, link.frames_received), (u16::MAX, 0, 0));
    }

    #[test]
    fn silence_takes_everything_out_of_the_image_and_keeps_counting() {
        let mut bench = Bench::<2>::new();
        bench.frame(profile::<2>(10).as_bytes(), 10_000).expect("the length is right");
        assert_eq!(bench.expired(12_500).deadline_us, SILENCE_US);
        bench.expired(10_000);
        assert_eq!(bench.album.shown::<2>(), []);
        let link = bench.album.link::<2>();
        assert!(!link.status.link_up() && !link.status.all_accepted());
        assert_eq!((link.frames_missed, link.age_100us), (2, 225));
        bench.frame(profile::<2>(40).as_bytes(), 7_500).expect("the length is right");
        assert_eq!(bench.album.shown::<2>(), [0, 1, 2]);
        assert!(bench.album.link::<2>().status.link_up());
    }

    #[test]
    fn a_frozen_horus_shows_no_object_and_says_why() {
        let mut bench = Bench::<1>::new();
        for _ in 0..2 {
            bench.frame(profile::<1>(10).as_bytes(), 10_000).expect("the length is right");
        }
        assert_eq!(bench.album.shown::<1>(), []);
        let link = bench.album.link::<1>();
        assert!(link.status.horus_frozen() && !link.status.link_up());
        assert_eq!((link.objects_accepted, link.objects_rejected, link.frames_received), (2, 2, 2));
        bench.frame(profile::<1>(20).as_bytes(), 10_000).expect("the length is right");
        assert!(!bench.album.link::<1>().status.horus_frozen());
    }

    #[test]
    fn a_restart_of_horus_stays_shown_for_a_second() {
        let mut bench = Bench::<1>::new();
        bench.frame(profile::<1>(5_000).as_bytes(), 10_000).expect("the length is right");
        let shown = (1..=200).filter(|cycle| {
            bench.frame(profile::<1>(cycle * 10).as_bytes(), 10_000).expect("the length is right");
            bench.album.link::<1>().status.horus_restarted()
        });
        assert_eq!(shown.count(), 100);
    }

    #[test]
    fn a_wrong_length_changes_nothing() {
        let mut bench = Bench::<3>::new();
        assert_eq!(bench.frame(profile::<2>(10).as_bytes(), 10_000), Err(Rejection::Length));
        assert!(bench.album.published.is_empty());
        assert_eq!(bench.commit.link().counters(), [0; 4]);
    }

    #[test]
    fn five_receivers_are_published_with_the_second_frame() {
        let mut bench = Bench::<5>::new();
        for timestamp in [10, 20] {
            let [first, second] = frames(timestamp);
            assert_eq!(bench.frame(&first, 6_000), Ok(Committed { published: 0, deadline_us: SECOND_FRAME_US }));
            assert_eq!(bench.frame(&second, 4_000), Ok(Committed { published: 1, deadline_us: FRAME_DEADLINE_US }));
            assert_eq!(bench.album.shown::<5>(), [0, 1, 2, 3, 4, 5]);
        }
        assert_eq!(bench.album.link::<5>().frames_missed, 0);
        assert!(bench.album.link::<5>().status.all_accepted());
    }

    #[test]
    fn five_receivers_a_lost_second_frame_costs_its_own_objects_only() {
        let mut bench = Bench::<5>::new();
        bench.frame(&frames(10)[0], 6_000).expect("the length is right");
        assert_eq!(bench.expired(SECOND_FRAME_US).deadline_us, FRAME_DEADLINE_US - SECOND_FRAME_US);
        assert_eq!(bench.album.shown::<5>(), [0, 1, 2]);
        let link = bench.album.link::<5>();
        assert!(link.status.link_up() && !link.status.all_accepted());
        assert_eq!(link.frames_missed, 1);
    }

    #[test]
    fn five_receivers_a_lost_first_frame_costs_its_own_objects_only() {
        let mut bench = Bench::<5>::new();
        assert_eq!(bench.frame(&frames(10)[1], 10_000).map(|committed| committed.published), Ok(1));
        assert_eq!(bench.album.shown::<5>(), [3, 4, 5]);
        assert_eq!(bench.album.link::<5>().frames_missed, 1);
    }

    #[test]
    fn five_receivers_the_halves_of_two_cycles_are_never_shown_together() {
        let mut bench = Bench::<5>::new();
        bench.frame(&frames(10)[0], 6_000).expect("the length is right");
        // Both frames between them were lost, and the deadline was late.
        assert_eq!(bench.frame(&frames(20)[1], 13_900).map(|committed| committed.published), Ok(2));
        assert_eq!(bench.album.published.len(), 2);
        assert_eq!(bench.album.shown::<5>(), [3, 4, 5]);
        assert_eq!(bench.album.link::<5>().frames_missed, 2);
    }

    fn never_old_data_as_new<const N: usize>(steps: Vec<(u8, u32)>) -> Result<(), TestCaseError> {
        let mut bench = Bench::<N>::new();
        let mut newest = None::<u32>;
        let mut timestamp = 0_u32;
        for (step, number) in steps {
            match step {
                0..=4 => timestamp = timestamp.wrapping_add(10),
                5 => timestamp = timestamp.wrapping_add(number % 100),
                6 => {}
                _ => {
                    bench.expired(10_000);
                    prop_assert_eq!(bench.album.shown::<N>(), Vec::<usize>::new());
                    continue;
                }
            }
            let sent = profile::<N>(timestamp);
            for frame in air::split(&sent) {
                let mut payload = frame.to_vec();
                if number % 3 == 0 {
                    let at = number as usize % payload.len();
                    payload[at] ^= 1 << (number % 8);
                }
                bench.frame(&payload, 5_000).expect("the length is right");
            }
            let image: &[u8] = bytemuck::cast_slice(bench.album.published.last().expect("an image was published"));
            let stamps: Vec<u32> = (0..=N)
                .filter_map(|index| {
                    let place = Image::<N>::place(index)?;
                    Object::verify(index, &image[place]).ok().map(Object::timestamp)
                })
                .collect();
            // What is shown is of this cycle, and its timestamp was not shown before.
            prop_assert!(stamps.iter().all(|&stamp| stamp == timestamp));
            if !stamps.is_empty() {
                prop_assert!(newest != Some(timestamp), "shown twice");
                newest = Some(timestamp);
            }
            // What is not shown is zero to the last byte.
            for index in 0..=N {
                let bytes = &image[Image::<N>::place(index).expect("an object of the profile")];
                prop_assert!(Object::verify(index, bytes).is_ok() || bytes.iter().all(|&byte| byte == 0));
            }
        }
        Ok(())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn no_sequence_of_frames_damage_and_silence_shows_old_data_as_new(steps in prop::collection::vec((0_u8..8, any::<u32>()), 1..60)) {
            never_old_data_as_new::<1>(steps.clone())?;
            never_old_data_as_new::<3>(steps.clone())?;
            never_old_data_as_new::<5>(steps)?;
        }
    }
}
