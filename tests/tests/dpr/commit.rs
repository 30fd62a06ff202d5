//! Measures the time from a frame's first bytes to a published image, and the time of the deadline without a frame.

use core::hint::black_box;

use dpr_fw::{
    accept::{Acceptance, Early, Objects},
    commit::{Commit, Frame},
    hold::Area,
    intake,
    link::{Health, Link, FRAME_DEADLINE_US},
    publish::{Doorbell, Mailbox, Outbox},
    rf::{FrameInfo, LEAD},
    telemetry::Telemetry,
    triple::{self, Filling, Rotation, IMAGES},
    ImageMemory, ReceiveMemory, IMAGE_WORDS, RECEIVERS, RECEIVE_WORDS,
};
use on_target_tests::cycles::{bounds, Cycles, Taken};
use profile::air;
use rtic_core::Mutex;

use super::frames::{Case, CASES, CLASSES, SIZE};

/// For each of the listener's three reads of its FIFO, the number of the frame's bytes, LEN included, that have
/// arrived.
const READS: [usize; 3] = [16, SIZE + 3 - st25r3916::listener::BODY, SIZE + 3 - st25r3916::listener::TAIL];
/// The number of cycles before the timed one. The fourth cycle finds the sequence.
const CYCLES_BEFORE: u32 = 6;

pub(crate) struct Own<'a, T>(pub(crate) &'a mut T);

impl<T> Mutex for Own<'_, T> {
    type T = T;
    fn lock<R>(&mut self, with: impl FnOnce(&mut T) -> R) -> R {
        with(self.0)
    }
}

/// The SSI as the commit task sees it. The field says whether a transaction is under way.
pub(crate) struct Bell(pub(crate) bool);

impl Doorbell for Bell {
    fn request(&mut self) -> bool {
        black_box(self.0)
    }
    fn announce(&mut self) {
        self.0 = black_box(false);
    }
}

type ImageBuffer<'a> = &'a mut ImageMemory;

struct Publishing<'a> {
    mailbox: Mailbox<ImageBuffer<'a>>,
    filling: Option<Filling<ImageBuffer<'a>>>,
    port: Area,
    telemetry: Telemetry,
}

impl<'a> Publishing<'a> {
    fn new(images: &'a mut [ImageMemory; IMAGES]) -> Self {
        let mailbox = Mailbox::new(images.each_mut());
        Self { mailbox, filling: None, port: Area::EMPTY, telemetry: Telemetry::new() }
    }

    fn outbox(&mut self, busy: bool) -> Outbox<'_, Own<'_, Mailbox<ImageBuffer<'a>>>, ImageBuffer<'a>, Bell> {
        Outbox {
            mailbox: Own(&mut self.mailbox),
            filling: &mut self.filling,
            doorbell: Bell(busy),
            port: &self.port,
            telemetry: &self.telemetry,
        }
    }

    /// Does what other tasks do before the end of a frame: scrubs images and prepares the next one.
    fn rest(&mut self, commit: &mut Commit<RECEIVERS>) {
        triple::scrub_waiting(Own(&mut self.mailbox));
        commit.prepare(&mut self.outbox(false));
    }
}

const TIMESTAMP: u32 = 70_000;
const HEALTH: fn() -> Health = Health::default;

/// Returns the instant at which cycle number `cycle` of the suite ends, µs.
fn ended_us(cycle: u32) -> u32 {
    let age = defmt::unwrap!(air::age_at_end_us::<RECEIVERS>(0));
    1_000_000 + 10_000 * cycle + age
}

fn timestamp(cycle: u32) -> u32 {
    TIMESTAMP + profile::CYCLE_MS * cycle
}

/// Returns a commit task that has processed [`CYCLES_BEFORE`] cycles, which were in sequence.
fn in_sequence(publishing: &mut Publishing<'_>) -> Commit<RECEIVERS> {
    let mut commit = Commit::new();
    commit.begin(ended_us(0) - 9_000, &HEALTH(), &mut publishing.outbox(false));
    for cycle in 0..CYCLES_BEFORE {
        publishing.rest(&mut commit);
        let payload = Case::Good.payload(timestamp(cycle));
        let frame = Frame { payload: &payload, ended_us: ended_us(cycle), early: &Early::default() };
        let published = commit.frame(frame, ended_us(cycle) + 20, &HEALTH(), &mut publishing.outbox(false));
        defmt::assert!(published == Ok(1));
    }
    commit
}

fn arrived(case: Case) -> [u8; SIZE + 1] {
    let mut bytes = [0; SIZE + 1];
    bytes[0] = SIZE as u8 + 1;
    bytes[1..].copy_from_slice(&case.payload(timestamp(CYCLES_BEFORE)));
    bytes
}

pub(crate) fn follow(cycles: &Cycles) {
    let mut taken = [Taken::NONE; READS.len()];
    for case in CASES {
        let bytes = arrived(case);
        let mut early = Early::default();
        for (taken, read) in taken.iter_mut().zip(READS) {
            taken.note(cycles.of(|| early.follow::<RECEIVERS>(black_box(&bytes[..read]))));
        }
        defmt::assert_eq!(early.done(), RECEIVERS);
    }
    let [first, second, third] = taken;
    first.assert("Early::follow, first read", bounds(350, 260, 350, 0));
    // The time varies with the reason for a rejection, which the verdict reports. Two wrong identifiers take 14 cycles
    // less than a good frame, and a wrong position CRC takes 8 cycles more.
    second.assert("Early::follow, second read", bounds(2_800, 1_850, 2_600, 24));
    third.assert("Early::follow, third read", bounds(650, 450, 600, 8));
}

/// Times `Acceptance::judge` for a frame in which only the last object is still to be verified.
pub(crate) fn judge(cycles: &Cycles) {
    let mut before = Acceptance::<RECEIVERS>::new();
    for cycle in 0..CYCLES_BEFORE {
        let payload = Case::Good.payload(timestamp(cycle));
        let verdict = before.judge(&payload, &Early::default(), u64::from(ended_us(cycle)));
        defmt::assert!(verdict.is_ok());
    }
    let mut taken = [Taken::NONE; 3];
    for case in CASES {
        let bytes = arrived(case);
        let mut early = Early::default();
        READS.iter().for_each(|&read| early.follow::<RECEIVERS>(&bytes[..read]));
        let mut acceptance = before;
        let (took, verdict) = cycles
            .timed(|| acceptance.judge(black_box(&bytes[1..]), black_box(&early), u64::from(ended_us(CYCLES_BEFORE))));
        let verdict = defmt::unwrap!(verdict.ok());
        defmt::assert_eq!(verdict.accepted.count(), case.accepted(), "{}", case);
        taken[case.class()].note(took);
    }
    let [of_cycle, out, unknown] = taken;
    of_cycle.assert("Acceptance::judge, in sequence", bounds(650, 650, 800, 16));
    out.assert("Acceptance::judge, out of sequence", bounds(550, 550, 700, 24));
    unknown.assert("Acceptance::judge, no object intact", bounds(420, 480, 600, 8));
}

/// Times `Commit::frame` and the whole commit task, from the end of a frame to its publication.
pub(crate) fn frame(cycles: &Cycles) {
    let mut images = [[0; IMAGE_WORDS]; IMAGES];
    let mut receive: [ReceiveMemory; 3] = [[0; RECEIVE_WORDS]; 3];
    let mut publishing = Publishing::new(&mut images);
    let before = in_sequence(&mut publishing);
    let (filling, mut rotation, _) = Rotation::new(receive.each_mut());
    let mut filling = Some(filling);
    let (mut frame, mut task) = ([Taken::NONE; 3], [Taken::NONE; 3]);
    for busy in [false, true] {
        for case in CASES {
            let bytes = arrived(case);
            let mut early = Early::default();
            READS.iter().for_each(|&read| early.follow::<RECEIVERS>(&bytes[..read]));
            let (ended_us, now_us) = (ended_us(CYCLES_BEFORE), ended_us(CYCLES_BEFORE) + 20);

            let mut commit = before;
            publishing.rest(&mut commit);
            let (took, published) = cycles.timed(|| {
                let received = Frame { payload: black_box(&bytes[1..]), ended_us, early: black_box(&early) };
                commit.frame(received, now_us, &HEALTH(), &mut publishing.outbox(busy))
            });
            defmt::assert!(published == Ok(1));
            let [accepted, rejected, ..] = commit.link().counters();
            let shown = CYCLES_BEFORE * 4 - 12 + case.accepted();
            defmt::assert_eq!((accepted, rejected), (shown, 4 * (CYCLES_BEFORE + 1) - shown), "{}", case);
            frame[case.class()].note(took);

            // The whole commit task is timed here, with the same frame in a receive buffer.
            let mut written = defmt::unwrap!(filling.take());
            // LEN comes after LEAD bytes, and so is the last byte of the first word.
            written.memory()[0] = u32::from(bytes[0]) << (8 * LEAD);
            for (word, bytes) in written.memory()[1..].iter_mut().zip(bytes[1..].as_chunks().0) {
                *word = u32::from_le_bytes(*bytes);
            }
            let (next, _) = rotation.rotate(written, FrameInfo { len: SIZE, ended_us, early });
            filling = Some(next);
            let mut commit = before;
            publishing.rest(&mut commit);
            let Publishing { mailbox, filling: image, port, telemetry } = &mut publishing;
            let mut outbox =
                Outbox { mailbox: Own(mailbox), filling: image, doorbell: Bell(busy), port, telemetry: &*telemetry };
            let (took, called_for) = cycles.timed(|| {
                let now = || black_box(now_us);
                intake::take_in(&mut commit, Own(&mut rotation), now, &HEALTH(), &mut outbox, telemetry)
            });
            defmt::assert!(called_for);
            defmt::assert_eq!(commit.link().counters()[0], shown, "{}", case);
            task[case.class()].note(took);
            triple::scrub_waiting(Own(&mut rotation));
        }
    }
    for (class, (frame, task)) in CLASSES.iter().zip(frame.into_iter().zip(task)) {
        defmt::info!("{=str}:", class);
        frame.assert("Commit::frame", bounds(2_400, 2_100, 2_800, 32));
        task.assert("intake::take_in, one frame", bounds(2_700, 2_300, 3_100, 32));
    }
}

/// Times `Commit::check_deadline` before the deadline, at it and long after it, and the task's work without a frame.
pub(crate) fn deadline(cycles: &Cycles) {
    let mut images = [[0; IMAGE_WORDS]; IMAGES];
    let mut publishing = Publishing::new(&mut images);
    let before = in_sequence(&mut publishing);
    let at_us = before.deadline_us();
    defmt::assert_eq!(at_us, ended_us(CYCLES_BEFORE - 1) + FRAME_DEADLINE_US);
    let (mut waits, mut lapsed) = (Taken::NONE, Taken::NONE);
    for (now_us, passed) in [
        (at_us - 12_000, false),
        (at_us - 1, false),
        (at_us, true),
        (at_us + 1, true),
        (at_us + 10_000, true),
        (at_us + 1_000_000, true),
        (at_us + 1_000_000_000, true),
    ] {
        let mut commit = before;
        publishing.rest(&mut commit);
        let (took, published) =
            cycles.timed(|| commit.check_deadline(black_box(now_us), &HEALTH(), &mut publishing.outbox(false)));
        defmt::assert_eq!(published, passed);
        if passed { &mut lapsed } else { &mut waits }.note(took);
    }
    waits.assert("Commit::check_deadline, not yet", bounds(130, 120, 160, 8));
    lapsed.assert("Commit::check_deadline, passed", bounds(1_850, 1_750, 2_300, 8));
}

/// Returns the cycles of one `Link::seal`. The function is not inlined, so that the loops that call it add no
/// instructions between the two readings of the counter.
#[inline(never)]
fn seal_once(cycles: &Cycles, link: &Link, shown: Objects, health: &Health) -> u32 {
    cycles.of(|| link.seal(shown, Objects::all(RECEIVERS), health))
}

/// Times `Link::seal` with different objects shown and different counters.
pub(crate) fn seal(cycles: &Cycles) {
    let mut images = [[0; IMAGE_WORDS]; IMAGES];
    let mut publishing = Publishing::new(&mut images);
    let before = in_sequence(&mut publishing);
    let faulty = Health {
        ram_fault: true,
        front_end_fault: true,
        flash_fault: true,
        access_violations: u32::MAX,
        uplink_rejected: true,
        ..HEALTH()
    };
    let all = Objects::all(RECEIVERS);
    let mut taken = Taken::NONE;
    for commit in [before, Commit::new()] {
        for shown in [Objects::NONE, Objects::all(1), all] {
            for health in [HEALTH(), faulty] {
                taken.note(seal_once(cycles, commit.link(), shown, &health));
            }
        }
    }
    taken.assert("Link::seal", bounds(680, 480, 650, 24));
}
