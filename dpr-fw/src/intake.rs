//! From frames that wait to images that are published: what the tasks `commit` and `deadline` both do.
//!
//! # Design
//!
//! Both tasks run the same function at the same priority: first every frame that waits is taken in, then the deadline
//! is looked at. So it does not matter which of the two was called. A frame that came in time has moved the deadline
//! before it is looked at, even if the timer's interrupt was first, and a frame of a wrong length, which moves nothing,
//! cannot keep the deadline from being noticed.

use core::borrow::BorrowMut;

use rtic_core::Mutex;

use crate::{
    commit::{Commit, Frame, Images},
    link::Health,
    rf::FrameInfo,
    telemetry::Telemetry,
    triple::{Memory, Rotation},
    ReceiveMemory,
};

/// Takes in every frame that waits in `rotation`, then publishes an image without objects if the deadline has passed.
/// `now_us` reads the counter, µs. The next deadline is [`Commit::deadline_us`]. Whether there was a frame or the
/// deadline had passed.
pub fn take_in<const N: usize, B: Memory + BorrowMut<ReceiveMemory>>(
    commit: &mut Commit<N>,
    mut rotation: impl Mutex<T = Rotation<B, FrameInfo>>,
    now_us: impl Fn() -> u32,
    health: &Health,
    images: &mut impl Images,
    telemetry: &Telemetry,
) -> bool {
    let mut called_for = false;
    while let Some(received) = rotation.lock(Rotation::read) {
        let info = received.about();
        let memory: &ReceiveMemory = received.memory().borrow();
        let payload = info.payload(bytemuck::cast_slice(memory.as_slice()));
        let frame = Frame { payload, ended_us: info.ended_us, early: &info.early };
        match commit.frame(frame, now_us(), health, images) {
            Ok(0) => {}
            Ok(_) => {
                let passed = now_us().wrapping_sub(info.ended_us);
                telemetry.rxe_to_publish_us.set(passed);
                telemetry.rxe_to_publish_worst_us.record_max(passed);
            }
            Err(_) => telemetry.wrong_length.add(1),
        }
        rotation.lock(|rotation| rotation.done(received));
        called_for = true;
    }
    called_for |= commit.check_deadline(now_us(), health, images);
    let [accepted, rejected, received, missed] = commit.link().counters();
    telemetry.objects_accepted.set(accepted);
    telemetry.objects_rejected.set(rejected);
    telemetry.frames_received.set(received);
    telemetry.frames_missed.set(missed);
    called_for
}
