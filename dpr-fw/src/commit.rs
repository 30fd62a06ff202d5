//! How a frame becomes an image: deposits the accepted objects, and decides when an image is published.
//!
//! # Design
//!
//! Each image is built in a scrubbed buffer: accepted objects are copied in, and all other bytes stay zero, which no
//! CRC accepts. Nothing is carried over from the previous image.
//!
//! - With up to three receivers a cycle is one frame, so each frame is published at once, even if all its objects were
//!   rejected.
//! - With five receivers the image is published with the cycle's second frame. Two frames belong to one cycle if their
//!   ends give the same instant of the sample ([`accept::SAME_SAMPLE_US`](crate::accept::SAME_SAMPLE_US)). One of them
//!   may be damaged, so that its timestamp is unknown. If both timestamps are known, they must be equal. The first
//!   frame's objects are published alone when the second frame's deadline has passed
//!   ([`link::SECOND_FRAME_US`](crate::link::SECOND_FRAME_US)), or when a frame arrives that does not belong to the
//!   first. If the first frame was lost, the second is published at once.
//! - While no frames come, each deadline publishes an image without objects, so that the last objects do not stay
//!   readable.
//!
//! The deadline is an instant on the DPR's µs counter, counted from the end of the last frame. Two tasks do the same
//! work: a frame starts the one, and the timer starts the other. Each takes in the frames that wait, calls
//! [`Commit::check_deadline`], and sets the timer to [`Commit::deadline_us`]. A deadline that passed before a frame
//! ended is handled before that frame, so the images do not depend on the order of the two tasks.
//!

use core::hint::black_box;

use profile::{
    air,
    criticality::{Dpr, Horus, Writer},
    map, GpsObject, Rejection, ReportedPosition,
};

use crate::{
    accept::{same_sample, Acceptance, Cycle, Early, Objects, Verdict},
    link::{Health, Link, Monitor},
    ImageMemory,
};

/// The claim of HORUS's role: HORUS wrote the objects that come over the air.
const HORUS: Writer<Horus> = Writer::claim();
/// The claim of the DPR's role: the DPR writes Link-Status.
const DPR: Writer<Dpr> = Writer::claim();

/// The destination of the images that the commit task makes.
pub trait Images {
    /// Returns the image being filled. It holds only zeros at first, and stays the same image until it is published.
    fn filling(&mut self) -> &mut ImageMemory;
    /// Copies Port-Status and the uplinks to their place in the image being filled, in a map for `N` receivers.
    fn place_port<const N: usize>(&mut self);
    /// Publishes the image being filled, so that the next SSI transaction gets it.
    fn publish(&mut self);
}

/// A received frame in its receive buffer.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// The frame's payload, as received.
    pub payload: &'a [u8],
    /// The value of the µs counter at the frame's end.
    pub ended_us: u32,
    /// The results for the objects that were verified while the frame arrived.
    pub early: &'a Early,
}

/// The state of the commit task, for a profile of `N` receivers.
#[derive(Clone, Copy, Debug)]
pub struct Commit<const N: usize> {
    acceptance: Acceptance<N>,
    monitor: Monitor<N>,
    link: Link,
    shown: Objects,
    /// The instant of the sample, µs since start, of a cycle of which only the first frame has come.
    open: Option<u64>,
    /// Whether Port-Status and the uplinks have been copied into the image being filled.
    port_placed: bool,
}

/// Copies the bits of `from` that are set in `mask`. For speed the loop copies five words per turn.
fn copy_masked(to: &mut [u8], from: &[u8], mask: u32) {
    const TURN: usize = 20;
    let copy = |to: &mut [u8], from: &[u8]| {
        for (to, from) in to.as_chunks_mut().0.iter_mut().zip(from.as_chunks().0) {
            *to = (u32::from_ne_bytes(*from) & mask).to_ne_bytes();
        }
    };
    let (turns, rest) = to.as_chunks_mut::<TURN>();
    let (from_turns, from_rest) = from.as_chunks::<TURN>();
    for (to, from) in turns.iter_mut().zip(from_turns) {
        copy(to, from);
    }
    // The sizes of Reported-Position and of a GPS object are multiples of four, so no byte is left over.
    copy(rest, from_rest);
}

impl<const N: usize> Default for Commit<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Commit<N> {
    const OBJECTS: usize = N + 1;

    /// Returns the state before any frame was received.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            acceptance: Acceptance::new(),
            monitor: Monitor::new(),
            link: Link::new(),
            shown: Objects::NONE,
            open: None,
            port_placed: false,
        }
    }

    /// Publishes an image without objects at the DPR's start. `now_us` is the value of the DPR's µs counter in all
    /// methods, and never goes back from one call to the next.
    pub fn begin(&mut self, now_us: u32, health: &Health, images: &mut impl Images) {
        self.link.advance(now_us);
        self.monitor.begin(now_us);
        self.publish(health, images);
    }

    /// Takes in a frame, and restarts the deadline from the frame's end. Frames must be given in the order of their
    /// ends. Returns how many images were published: usually one, none if the cycle's second frame is awaited, and one
    /// more if an earlier image had to be published first.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if no frame of this profile has that length; then nothing has changed.
    pub fn frame(
        &mut self,
        frame: Frame<'_>,
        now_us: u32,
        health: &Health,
        images: &mut impl Images,
    ) -> Result<u32, Rejection> {
        self.link.advance(now_us);
        let ended_us = self.link.clock().instant_us(frame.ended_us);
        let mut verdict = self.acceptance.judge(frame.payload, frame.early, ended_us)?;
        if health.flash_fault {
            // The code that judges objects cannot be trusted after a flash fault, so no object is accepted.
            verdict.accepted = Objects::NONE;
        }

        // Not covered: a deadline that has passed before the frame's end, in this copy of `lapse`: the commit task also
        // runs at the deadline itself, so a frame that ends later finds the deadline handled.
        let mut published = u32::from(self.lapse(frame.ended_us, health, images));
        self.link.missed(self.monitor.frame(verdict.frame(), verdict.sampled_us, frame.ended_us));
        let first = verdict.frame() == 0;
        let last = verdict.place.first() + verdict.place.count() == Self::OBJECTS;
        // Not covered: an image that waits for the second frame of its cycle, which only a profile of five receivers
        // has.
        if let Some(sampled_us) = self.open {
            let other_slot = first || !same_sample(sampled_us, verdict.sampled_us);
            let other_cycle = matches!(verdict.cycle, Cycle::Next(_)) && self.shown != Objects::NONE;
            if other_slot || other_cycle {
                // The image of the previous cycle gets the Link-Status of that cycle, so it is published before the new
                // frame counts.
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

    /// Publishes an image if the deadline has passed at `now_us`, and moves the deadline on. The image has the objects
    /// of a cycle whose second frame has not come, or no objects if no frame has come. To be called after all waiting
    /// frames were taken in. Returns whether an image was published.
    pub fn check_deadline(&mut self, now_us: u32, health: &Health, images: &mut impl Images) -> bool {
        self.link.advance(now_us);
        self.lapse(now_us, health, images)
    }

    /// Copies Port-Status and the uplinks into the image being filled. A call while a frame arrives leaves less work
    /// for the frame's end.
    pub fn prepare(&mut self, images: &mut impl Images) {
        if !self.port_placed {
            images.place_port::<N>();
            self.port_placed = true;
        }
    }

    /// Publishes an image without objects at once, because the image that the flight controller reads was found
    /// damaged. Returns false, and publishes none, if another image is about to replace the damaged one:
    ///
    /// - No image is published while the image being filled holds objects of a newer cycle, because that image is
    ///   published within [`link::SECOND_FRAME_US`](crate::link::SECOND_FRAME_US).
    /// - No image is published while a frame is about to end, because publishing would delay that frame. The frame
    ///   brings the next image, or else its deadline does, 2.7 ms later.
    pub fn withdraw(&mut self, now_us: u32, health: &Health, images: &mut impl Images) -> bool {
        self.link.advance(now_us);
        // Not covered: only this line, an image that waits for a second frame (`open`, `shown`), which only a profile
        // of five receivers has.
        if self.open.is_some() || self.shown != Objects::NONE || self.monitor.is_frame_due(now_us) {
            return false;
        }
        self.publish(health, images);
        true
    }

    /// Returns the next deadline as a value of the DPR's µs counter, which wraps.
    #[must_use]
    pub const fn deadline_us(&self) -> u32 {
        self.monitor.deadline_us()
    }

    /// Returns the counters and states for Link-Status.
    #[must_use]
    pub const fn link(&self) -> &Link {
        &self.link
    }

    fn lapse(&mut self, until_us: u32, health: &Health, images: &mut impl Images) -> bool {
        // Not covered: only this line, in the path behind a missed second frame, which only a profile of five receivers
        // has (`Monitor::lapse`).
        let Some(lapse) = self.monitor.lapse(until_us) else { return false };
        self.link.missed(lapse.missed);
        if lapse.silent {
            // When the link is silent, the first frame's objects are too old to be published.
            images.filling().fill(0);
            self.port_placed = false;
            self.shown = Objects::NONE;
        }
        self.publish(health, images);
        true
    }

    /// Copies the accepted objects into the image. Rejected objects become zeros, which takes the same time.
    fn deposit(&mut self, payload: &[u8], verdict: &Verdict, images: &mut impl Images) {
        let image: &mut [u8] = bytemuck::cast_slice_mut(images.filling());
        let Ok(objects) = air::objects::<N>(payload) else { return };
        for (index, object) in objects {
            // Without the barrier the compiler might copy accepted objects and clear rejected ones, which would take
            // different times.
            let mask = black_box(if verdict.accepted.has(index) { u32::MAX } else { 0 });
            let Some(place) = map::profile_object_mut::<_, N>(HORUS, image, index) else { return };
            copy_masked(place, object, mask);
        }
        self.shown = self.shown.union(verdict.accepted);
    }

    fn publish(&mut self, health: &Health, images: &mut impl Images) {
        let status = self.link.seal(self.shown, Objects::all(N), health);
        let image: &mut [u8] = bytemuck::cast_slice_mut(images.filling());
        if let Some(place) = map::link_status_mut(DPR, image) {
            *place = *status.as_bytes();
        }
        self.prepare(images);
        images.publish();
        self.shown = Objects::NONE;
        self.open = None;
        self.port_placed = false;
    }
}

const _: () = assert!(GpsObject::SIZE.is_multiple_of(4) && ReportedPosition::SIZE.is_multiple_of(4));

#[cfg(test)]
pub(crate) mod testing {
    use profile::{air, GpsStatus, GpsValues, Profile, ReportedStatus, ReportedValues};

    /// Returns a sealed profile whose values depend on its timestamp and, in the GPS objects, on the receiver's number.
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

    pub(crate) fn frames(timestamp: u32) -> [Vec<u8>; 2] {
        let profile = profile::<5>(timestamp);
        let frames: Vec<_> = air::split(&profile).map(<[u8]>::to_vec).collect();
        frames.try_into().expect("two frames")
    }
}

#[cfg(test)]
mod tests;
