//! Turns waiting frames into published images, for the tasks `commit` and `deadline`.
//!
//! # Design
//!
//! Both tasks run the same function at the same priority: first they take in every frame that waits, then they check
//! the deadline. A frame that came in time has moved the deadline before the check, even if the timer's interrupt came
//! first. A frame of a wrong length does not move the deadline.

use core::borrow::BorrowMut;

use profile::ResetReason;
use rtic_core::Mutex;

use crate::{
    commit::{Commit, Frame, Images},
    integrity::{Integrity, Shown},
    link::Health,
    publish::{Doorbell, ImageBuffer, Mailbox, Outbox},
    rf::{FrameInfo, FrontEnd},
    telemetry::Telemetry,
    triple::{Memory, Rotation},
    ReceiveMemory,
};

/// The DPR's µs counter, and the timer that calls the task `deadline`.
pub trait Timer {
    /// Returns the value of the µs counter.
    fn now_us(&self) -> u32;
    /// Makes the timer call the task `deadline` at counter value `at_us`, or at once if that value has passed.
    fn set(&mut self, at_us: u32);
}

/// What the tasks `commit` and `deadline` need to know from other tasks.
#[derive(Clone, Copy, Debug)]
pub struct Notices<'a, S> {
    /// Whether a frame is arriving. Its image is prepared only then: an image that is prepared earlier would lack what
    /// the flight controller writes before the frame.
    pub frame_arrives: bool,
    /// The state of the front end.
    pub front_end: FrontEnd,
    /// The findings of the idle loop, which verifies memory.
    pub integrity: &'a Integrity,
    /// The image that the flight controller reads at present.
    pub shown: S,
}

/// The state that the tasks `commit` and `deadline` share, for a profile of `N` receivers.
#[derive(Clone, Copy, Debug)]
pub struct Intake<const N: usize> {
    commit: Commit<N>,
    started: bool,
    reset_reason: ResetReason,
}

impl<const N: usize> Intake<N> {
    /// Returns the state after a start of the DPR, whose reason was `reset_reason`.
    #[must_use]
    pub const fn new(reset_reason: ResetReason) -> Self {
        Self { commit: Commit::new(), started: false, reset_reason }
    }

    /// Whether the deadline has passed at counter value `now_us`.
    #[must_use]
    pub const fn has_lapsed(&self, now_us: u32) -> bool {
        now_us.wrapping_sub(self.commit.deadline_us()).cast_signed() >= 0
    }

    /// Serves a call of the task `commit` or `deadline`. It publishes the first image at the first call, takes in the
    /// frames that wait, checks the deadline, and withdraws an image that the idle loop found damaged. Then it sets the
    /// timer and begins the next image. Returns whether there was any of this work. Without such work, it prepares an
    /// image at most.
    pub fn serve<B, I, M, D, S>(
        &mut self,
        rotation: impl Mutex<T = Rotation<B, FrameInfo>>,
        notices: &Notices<'_, S>,
        outbox: &mut Outbox<'_, M, I, D>,
        timer: &mut impl Timer,
    ) -> bool
    where
        B: Memory + BorrowMut<ReceiveMemory>,
        I: ImageBuffer,
        M: Mutex<T = Mailbox<I>>,
        D: Doorbell,
        S: Shown,
    {
        let telemetry = outbox.telemetry;
        let health = self.health(notices, telemetry);
        let mut called_for = !core::mem::replace(&mut self.started, true);
        if called_for {
            self.commit.begin(timer.now_us(), &health, outbox);
        }
        let before = telemetry.publications.get();
        called_for |= take_in(&mut self.commit, rotation, || timer.now_us(), &health, outbox, telemetry);
        // If another image was just published, the flight controller no longer reads the damaged one.
        let replaced = telemetry.publications.get() != before;
        // Not covered: only this line, a finding while a newer image was published: the idle loop calls this task at
        // once after a finding, so a frame would have to end within these few µs.
        if notices.integrity.take_withdrawal(notices.shown.generation()) && !replaced {
            called_for |= self.commit.withdraw(timer.now_us(), &health, outbox);
        }
        if called_for {
            timer.set(self.commit.deadline_us());
            outbox.prepare();
        } else if notices.frame_arrives {
            self.commit.prepare(outbox);
        }
        called_for
    }

    fn health<S>(&self, notices: &Notices<'_, S>, telemetry: &Telemetry) -> Health {
        Health {
            ram_fault: [&telemetry.scrub_faults, &telemetry.image_faults, &telemetry.ram_errors]
                .iter()
                .any(|faults| faults.get() > 0),
            front_end_fault: notices.front_end.is_out_of_order(),
            no_field: notices.front_end.senses_no_field(),
            flash_fault: notices.integrity.flash_fault(),
            reset_reason: self.reset_reason,
            access_violations: telemetry.access_violations.get(),
            uplink_rejected: telemetry.uplink_rejected.get() != 0,
        }
    }
}

/// Takes in every frame that waits in `rotation`, then publishes an image if the deadline has passed. `now_us` reads
/// the µs counter. Returns whether there was a frame or the deadline had passed.
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

#[cfg(test)]
mod tests;
