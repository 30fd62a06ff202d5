//! Tests calls of `commit` and `deadline`: what they publish, what Link-Status then says, and when the next call is
//! due.

use std::cell::Cell;

use firmware_common::{patrol::Slice, program::Comparison};
use profile::{map::Map, LinkStatus, LinkStatusBits};
use st25r3916::Fault;

use super::*;
use crate::{
    accept::Early,
    commit::testing::profile,
    hold::Area,
    integrity::Judge,
    link::FRAME_DEADLINE_US,
    rf::LEAD,
    triple::{scrub_waiting, Filling, Received, IMAGES, RECEIVE_BUFFERS},
    ImageMemory, IMAGE_WORDS, RECEIVE_WORDS,
};

struct Own<'a, T>(&'a mut T);

impl<T> Mutex for Own<'_, T> {
    type T = T;

    fn lock<R>(&mut self, with: impl FnOnce(&mut T) -> R) -> R {
        with(self.0)
    }
}

struct Bell;

impl Doorbell for Bell {
    fn request(&mut self) -> bool {
        false
    }
    fn announce(&mut self) {}
}

struct Generation(u32);

impl Shown for Generation {
    fn generation(&self) -> u32 {
        self.0
    }
    fn words(&self, _: core::ops::Range<usize>) -> impl Iterator<Item = u32> {
        core::iter::empty()
    }
}

#[derive(Default)]
struct Time {
    now_us: Cell<u32>,
    set: Option<u32>,
}

impl Timer for Time {
    fn now_us(&self) -> u32 {
        self.now_us.get()
    }
    fn set(&mut self, at_us: u32) {
        self.set = Some(at_us);
    }
}

struct Dpr {
    intake: Intake<3>,
    rotation: Rotation<ReceiveMemory, FrameInfo>,
    receiving: Option<Filling<ReceiveMemory>>,
    mailbox: Mailbox<ImageMemory>,
    filling: Option<Filling<ImageMemory>>,
    streamed: Option<Received<ImageMemory, ()>>,
    port: Area,
    telemetry: Telemetry,
    integrity: Integrity,
    front_end: FrontEnd,
    frame_arrives: bool,
    timer: Time,
}

const LISTENING: FrontEnd = FrontEnd::Listening { field: true };

impl Dpr {
    fn new() -> Self {
        let (receiving, rotation, _) = Rotation::new([[0; RECEIVE_WORDS]; RECEIVE_BUFFERS]);
        let mut port = Area::EMPTY;
        bytemuck::bytes_of_mut(&mut port).fill(0x5A);
        Self {
            intake: Intake::new(ResetReason::Pin),
            rotation,
            receiving: Some(receiving),
            mailbox: Mailbox::new([[0; IMAGE_WORDS]; IMAGES]),
            filling: None,
            streamed: None,
            port,
            telemetry: Telemetry::new(),
            integrity: Integrity::new(),
            front_end: LISTENING,
            frame_arrives: false,
            timer: Time::default(),
        }
    }

    fn started() -> Self {
        let mut dpr = Self::new();
        assert!(dpr.serve_at(1_000));
        dpr.timer.set = None;
        dpr
    }

    fn serve_at(&mut self, now_us: u32) -> bool {
        self.timer.now_us.set(now_us);
        let notices = Notices {
            frame_arrives: self.frame_arrives,
            front_end: self.front_end,
            integrity: &self.integrity,
            shown: Generation(5),
        };
        let mut outbox = Outbox {
            mailbox: Own(&mut self.mailbox),
            filling: &mut self.filling,
            doorbell: Bell,
            port: &self.port,
            telemetry: &self.telemetry,
        };
        let called_for = self.intake.serve(Own(&mut self.rotation), &notices, &mut outbox, &mut self.timer);
        self.streamed = self.mailbox.take(self.streamed.take()).0;
        let _ = scrub_waiting(Own(&mut self.mailbox));
        called_for
    }

    fn frame(&mut self, ended_us: u32) {
        let mut written = self.receiving.take().expect("there is one");
        let profile = profile::<3>(70_000);
        let payload = profile.as_bytes();
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(written.memory());
        bytes[LEAD + 1..][..payload.len()].copy_from_slice(payload);
        let info = FrameInfo { len: payload.len(), ended_us, early: Early::default() };
        self.receiving = Some(self.rotation.rotate(written, info).0);
    }

    /// Records that the image of this generation is damaged, as the idle loop would.
    fn damaged(&self, generation: u32) {
        let _ = Judge::new().judge(&Slice::default(), Some(generation), &self.integrity, &self.telemetry);
    }

    fn published(&self) -> u32 {
        self.telemetry.publications.get()
    }

    fn status(&self) -> LinkStatusBits {
        let image: &[u8] = bytemuck::cast_slice(self.streamed.as_ref().expect("one was published").memory());
        LinkStatus::verify(&image[..LinkStatus::SIZE]).expect("it is intact").values().status
    }
}

#[test]
fn the_first_call_publishes_an_image_and_sets_the_timer() {
    let mut dpr = Dpr::new();
    assert!(dpr.serve_at(1_000));
    assert_eq!((dpr.published(), dpr.timer.set), (1, Some(1_000 + FRAME_DEADLINE_US)));
    assert_eq!(dpr.status(), LinkStatusBits::new().with_out_of_sequence(true).with_reset_reason(ResetReason::Pin));
    assert!(!dpr.serve_at(1_100));
    assert_eq!(dpr.published(), 1);
}

#[test]
fn a_frame_or_a_passed_deadline_publishes_and_sets_the_timer() {
    let mut dpr = Dpr::started();
    dpr.frame(5_000);
    assert!(dpr.serve_at(5_020));
    assert_eq!((dpr.published(), dpr.timer.set), (2, Some(5_000 + FRAME_DEADLINE_US)));
    let deadline = 5_000 + FRAME_DEADLINE_US;
    assert!(!dpr.intake.has_lapsed(deadline - 1) && !dpr.serve_at(deadline - 1));
    assert!(dpr.intake.has_lapsed(deadline) && dpr.serve_at(deadline));
    assert_eq!((dpr.published(), dpr.timer.set), (3, Some(15_000 + FRAME_DEADLINE_US)));
}

#[test]
fn what_the_port_has_is_placed_early_only_if_a_frame_arrives() {
    let mut dpr = Dpr::started();
    for frame_arrives in [false, true] {
        dpr.frame_arrives = frame_arrives;
        assert!(!dpr.serve_at(2_000));
        let image: &[u8] = bytemuck::cast_slice(dpr.filling.as_ref().expect("one is begun").peek());
        assert_eq!(image[Map::<3>::port_area()].iter().all(|byte| *byte == 0x5A), frame_arrives);
        assert_eq!((dpr.published(), dpr.timer.set), (1, None));
    }
}

#[test]
fn a_damaged_image_is_withdrawn_while_it_is_shown_and_not_replaced() {
    let mut dpr = Dpr::started();
    dpr.damaged(4);
    assert!(!dpr.serve_at(2_000));
    dpr.damaged(5);
    assert!(dpr.serve_at(2_100));
    assert_eq!((dpr.published(), dpr.timer.set.is_some()), (2, true));
    assert!(!dpr.serve_at(2_200), "told once");
    dpr.damaged(5);
    dpr.frame(5_000);
    assert!(dpr.serve_at(5_020));
    assert_eq!(dpr.published(), 3, "the frame's image has replaced it");
}

#[test]
fn link_status_says_what_others_have_found() {
    let before = Dpr::started().status();
    let status_with = |found: &dyn Fn(&mut Dpr)| {
        let mut dpr = Dpr::new();
        found(&mut dpr);
        dpr.serve_at(1_000);
        dpr.status()
    };
    assert_eq!(status_with(&|dpr| dpr.telemetry.scrub_faults.add(1)), before.with_ram_fault(true));
    assert_eq!(status_with(&|dpr| dpr.telemetry.image_faults.add(1)), before.with_ram_fault(true));
    assert_eq!(status_with(&|dpr| dpr.telemetry.ram_errors.add(1)), before.with_ram_fault(true));
    assert_eq!(status_with(&|dpr| dpr.telemetry.uplink_rejected.set(1)), before.with_uplink_rejected(true));
    assert_eq!(status_with(&|dpr| dpr.front_end = FrontEnd::Starting), before.with_no_field(true));
    let lost = FrontEnd::Lost(Fault::Silence { field: true });
    assert_eq!(status_with(&|dpr| dpr.front_end = lost), before.with_front_end_fault(true));
    let changed = Slice { flash: Some(Comparison { computed: 1, expected: 2 }), ..Slice::default() };
    let flash_fault = |dpr: &mut Dpr| {
        let _ = Judge::new().judge(&changed, None, &dpr.integrity, &dpr.telemetry);
    };
    assert_eq!(status_with(&flash_fault), before.with_flash_fault(true));
}
