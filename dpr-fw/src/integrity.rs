//! Verifies the image that the flight controller reads, and all memory that the firmware uses.
//!
//! # Design
//!
//! The idle loop verifies all of this memory, in one [slice](firmware_common::patrol) every 2.5 ms:
//!
//! - *The published image*, object by object ([`ImageCheck`]): an object must have a right CRC, or be zero throughout
//!   where no object was accepted. The idle loop reads the object's words once, and uses the result only if the image
//!   is of the same *generation* before and after. The SSI task increments the generation whenever it exchanges the
//!   image. So the idle loop needs no lock. A wrong object is read a second time before it counts as damaged, since the
//!   first reading may have been wrong.
//! - *Flash, code in RAM, guard words, RAM in use*: [`firmware_common::patrol`] verifies them.
//!
//! Each finding has a consequence:
//!
//! | finding | consequence |
//! |---|---|
//! | an object of the published image | the commit task publishes an image without objects, "RAM fault" set |
//! | flash | the commit task does so with "flash fault"; no object is shown until a pass finds flash intact |
//! | code in RAM | safe state, [`Cause::CodeInRam`] |
//! | a guard word | safe state, [`Cause::GuardWord`] |
//! | RAM in use does not hold what is written to it, also at the start | Link-Status says "RAM fault" |
//!
//! *Why faulty RAM does not stop the DPR:* every object in an image has a CRC, a timestamp and an identifier, which the
//! reader verifies. So faulty RAM can make the DPR lose objects, but cannot change one unnoticed. Buffers in faulty RAM
//! are taken out of use ([`triple`](crate::triple)); the test of RAM leaves out the RAM that DMA accesses.
//!
//! *Why the image that replaces a damaged one has no objects:* the other objects would have to come from the damaged
//! image or a copy of it. FRESH would then announce objects of an older cycle a second time, and they would stay
//! readable for longer than one image may. The loss is the rest of one cycle, 10 ms at most.
//!
//! # Time to detect
//!
//! The bounds are [`IMAGE_DETECT_US`], [`FLASH_DETECT_US`], [`CODE_DETECT_US`] and [`RAM_DETECT_US`]. They hold while
//! the idle loop runs; if it does not run for 100 ms, the watchdog resets the part.

use core::{
    ops::Range,
    sync::atomic::{AtomicBool, AtomicU32, Ordering},
};

use firmware_common::{
    last_stop::Cause,
    patrol::{Rate, Slice, SLICE_US},
};
use profile::{
    criticality::{BaseStation, FlightController},
    image::Image,
    map::Map,
    LinkStatus,
};

use crate::{link::FRAME_DEADLINE_US, protection::NULL_PAGE_END, telemetry::Telemetry};

/// The number of words of each memory that one slice verifies. This takes about 1 % of the time on the pessimistic
/// clock.
pub const RATE: Rate = Rate { flash_words: 8, code_words: 4, ram_words: 2 };

/// The number of slices that the idle loop does instead of one while a self-test runs. All but one verify flash and
/// RAM in use alone.
pub const SELF_TEST_SLICES: u32 = 3;

/// The end of the null page in flash, bytes. The memory protection unit denies all accesses to that page.
pub const SHUT_END: u32 = NULL_PAGE_END;

/// The sizes of program, RAM that holds code, and RAM for stack and statics, bytes, as in `memory.x`.
const FLASH_BYTES: u32 = 96 * 1024;
const CODE_BYTES: u32 = 64 * 1024;
const RAM_BYTES: u32 = 32 * 1024;

/// The number of objects of the published image that a slice verifies. With three receivers all eight objects take 10
/// ms.
pub const OBJECTS_PER_SLICE: u32 = 2;

/// The longest time from a flipped bit in the published image until another image replaces it, µs, for five receivers:
/// five slices of two objects, and a sleep of the idle loop until the next deadline.
pub const IMAGE_DETECT_US: u32 =
    (ImageCheck::<5>::OBJECTS as u32).div_ceil(OBJECTS_PER_SLICE) * SLICE_US + FRAME_DEADLINE_US;

/// The longest time until Link-Status reports a flipped bit in flash, µs: two passes over all 96 KiB of flash, and the
/// comparison at once that follows.
pub const FLASH_DETECT_US: u32 = RATE.flash_detect_us(FLASH_BYTES) + COMPARISON_US + FRAME_DEADLINE_US;

/// The longest time of a comparison of all flash at once, µs: 96 KiB at 50 cycles a word.
const COMPARISON_US: u32 = FLASH_BYTES / 4 * 50 / 64;

/// The longest time from a flipped bit of code in RAM to the safe state, µs: one pass over all RAM that holds code.
pub const CODE_DETECT_US: u32 = RATE.code_detect_us(CODE_BYTES) + FRAME_DEADLINE_US;

/// The longest time until Link-Status reports a bit of RAM in use that gets stuck, µs: one pass over that RAM.
pub const RAM_DETECT_US: u32 = RATE.ram_pass_us(RAM_BYTES) + FRAME_DEADLINE_US;

/// The longest duration of a self-test, µs: a pass over flash or one over RAM, whichever takes longer.
pub const SELF_TEST_US: u32 = {
    let (flash, ram) = (FLASH_DETECT_US / 2, RAM_DETECT_US);
    (if flash > ram { flash } else { ram }) / SELF_TEST_SLICES + FRAME_DEADLINE_US
};

// Shows IMG-8, SAFE-4, SAFE-5, SAFE-6.
const _: () = {
    assert!(IMAGE_DETECT_US <= 25_000);
    assert!(FLASH_DETECT_US <= 15_400_000);
    assert!(CODE_DETECT_US <= 10_300_000);
    assert!(RAM_DETECT_US <= 10_300_000);
};

/// The image that the flight controller reads at present. The SSI task may exchange it at any time.
pub trait Shown {
    /// Returns how many images were streamed so far; 0 before the first. Two calls that return the same number saw the
    /// same image.
    fn generation(&self) -> u32;

    /// Returns these words of the image. If the image is exchanged meanwhile, they are arbitrary.
    fn words(&self, places: Range<usize>) -> impl Iterator<Item = u32>;
}

/// Verifies the objects of the published map for `N` receivers in turn.
#[derive(Clone, Copy, Debug, Default)]
pub struct ImageCheck<const N: usize> {
    next: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Found {
    Intact,
    Damaged,
    /// The image was exchanged while it was read, or there is no image.
    Unknown,
}

impl<const N: usize> ImageCheck<N> {
    /// The number of objects: Link-Status, Reported-Position, GPS1 to GPSn, Port-Status, two uplinks.
    pub const OBJECTS: usize = N + 5;

    const PORT_STATUS: usize = N + 2;

    /// Returns a check that begins with Link-Status.
    #[must_use]
    pub const fn new() -> Self {
        Self { next: 0 }
    }

    /// Verifies the next [`OBJECTS_PER_SLICE`] objects of the image. Returns the image's generation if one of these
    /// objects is damaged.
    pub fn slice(&mut self, shown: &impl Shown) -> Option<u32> {
        (0..OBJECTS_PER_SLICE).fold(None, |damaged, _| damaged.or_else(|| self.step(shown)))
    }

    /// Verifies the next object of the image. Returns the image's generation if the object is damaged.
    pub fn step(&mut self, shown: &impl Shown) -> Option<u32> {
        let generation = shown.generation();
        let object = self.next;
        // Not covered: only this line, the results for generation 0, in the copies of `look` for objects behind
        // Link-Status, which are verified only when there is an image.
        let found = Self::look(object, generation, shown);
        if found != Found::Unknown {
            self.next = (object + 1) % Self::OBJECTS;
        }
        // Not covered: a second look that finds otherwise than the first one: the image would have to be exchanged
        // within these few µs.
        let damaged = found == Found::Damaged && Self::look(object, generation, shown) == Found::Damaged;
        damaged.then_some(generation)
    }

    fn place(object: usize) -> Option<Range<usize>> {
        if object == 0 {
            return Some(0..LinkStatus::SIZE);
        }
        match object.checked_sub(Self::PORT_STATUS) {
            None => Image::<N>::place(object - 1),
            Some(0) => Some(Map::<N>::port_status()),
            Some(1) => Some(Map::<N>::uplink::<BaseStation>()),
            Some(_) => Some(Map::<N>::uplink::<FlightController>()),
        }
    }

    fn look(object: usize, generation: u32, shown: &impl Shown) -> Found {
        // Not covered: an object without a place: `next` is below the number of objects, of which each has its place.
        let Some(place) = Self::place(object) else { return Found::Unknown };
        // Not covered: only this line, generation 0 in the copies for objects behind Link-Status, object 0: the check
        // waits there until the first image is shown.
        if generation == 0 {
            return Found::Unknown;
        }
        // The words are read once, so that the CRC and the comparison with zero judge the same values.
        let mut any = 0;
        let words = shown.words(place.start / 4..place.end / 4).inspect(|word| any |= word);
        let intact = profile::crc::frame_of_words_intact(words);
        if shown.generation() != generation {
            return Found::Unknown;
        }
        // Link-Status and Port-Status must not be zero, since every image has them.
        let vacant = object != 0 && object != Self::PORT_STATUS && any == 0;
        if vacant || intact {
            Found::Intact
        } else {
            Found::Damaged
        }
    }
}

/// The findings of the idle loop, for the commit task and the port task.
#[derive(Debug)]
pub struct Integrity {
    /// The generation of the image that was found damaged; 0 if no image was.
    damaged: AtomicU32,
    /// [`CHANGED`] if the last pass found flash changed. One flipped bit makes no other value of it.
    flash: AtomicU32,
    /// Whether flash was found changed since the commit task last asked. The commit task then publishes an image
    /// without objects.
    withdraw: AtomicBool,
    self_test: AtomicU32,
}

const UNCHANGED: u32 = 0x5A5A_5A5A;
const CHANGED: u32 = !UNCHANGED;

/// The states of a self-test.
const NONE: u32 = 0;
const REQUESTED: u32 = 1;
const RUNNING: u32 = 2;
const PASSED: u32 = 3;
const FAILED: u32 = 4;

impl Default for Integrity {
    fn default() -> Self {
        Self::new()
    }
}

impl Integrity {
    /// Returns the state in which nothing was found and no self-test was asked for.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            damaged: AtomicU32::new(0),
            flash: AtomicU32::new(UNCHANGED),
            withdraw: AtomicBool::new(false),
            self_test: AtomicU32::new(NONE),
        }
    }

    /// Whether the last pass found flash changed. If so, images must have no objects.
    #[must_use]
    pub fn flash_fault(&self) -> bool {
        self.flash.load(Ordering::Relaxed) == CHANGED
    }

    /// Whether the image of `generation`, which is read at present, has to be withdrawn. True only once for each
    /// finding.
    pub fn take_withdrawal(&self, generation: u32) -> bool {
        let damaged = self.damaged.swap(0, Ordering::Relaxed);
        self.withdraw.swap(false, Ordering::Relaxed) || damaged != 0 && damaged == generation
    }

    /// Requests a self-test: a whole pass over flash and one over the RAM in use. A self-test in progress begins again.
    pub fn request_self_test(&self) {
        self.self_test.store(REQUESTED, Ordering::Relaxed);
    }

    /// Whether a self-test was requested and has not ended.
    #[must_use]
    pub fn is_self_test_running(&self) -> bool {
        matches!(self.self_test.load(Ordering::Relaxed), REQUESTED | RUNNING)
    }

    /// Returns whether the last self-test has passed, once for each self-test; `None` if none has ended since.
    pub fn take_result(&self) -> Option<bool> {
        let state = self.self_test.load(Ordering::Relaxed);
        let ended = state == PASSED || state == FAILED;
        // If a self-test was requested after the load, this compare-and-exchange fails, so the request is kept.
        // Not covered: only this line, an exchange that fails, since only the task that calls this changes an ended
        // state; and a second try of the exclusive access, for which an interrupt would have to come between its two
        // instructions.
        let taken = ended && self.self_test.compare_exchange(state, NONE, Ordering::Relaxed, Ordering::Relaxed).is_ok();
        // Not covered: only this line, an exchange that fails, as above.
        taken.then_some(state == PASSED)
    }

    /// Requests a self-test if `wanted` and none runs. Returns whether the last self-test has passed, once for each
    /// self-test.
    pub fn serve_self_test(&self, wanted: bool) -> Option<bool> {
        if !wanted || self.is_self_test_running() {
            return None;
        }
        let result = self.take_result();
        if result.is_none() {
            self.request_self_test();
        }
        result
    }

    fn image_damaged(&self, generation: u32) {
        self.damaged.store(generation, Ordering::Relaxed);
    }

    fn flash_pass(&self, intact: bool) {
        if !intact && !self.flash_fault() {
            self.withdraw.store(true, Ordering::Relaxed);
        }
        self.flash.store(if intact { UNCHANGED } else { CHANGED }, Ordering::Relaxed);
    }
}

/// What the idle loop has to do after a slice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Consequence {
    /// There is nothing to do.
    None,
    /// The commit task has to be called, because an image has to be withdrawn.
    Withdraw,
    /// The DPR has to enter the safe state for this cause, with this detail.
    Stop(Cause, u32),
}

#[derive(Clone, Copy, Debug, Default)]
struct SelfTest {
    flash: Option<bool>,
    ram: Option<bool>,
}

/// Evaluates the idle loop's slices, and keeps the results of a self-test.
#[derive(Debug, Default)]
pub struct Judge {
    self_test: SelfTest,
}

impl Judge {
    /// Returns a judge without a self-test in progress.
    #[must_use]
    pub const fn new() -> Self {
        Self { self_test: SelfTest { flash: None, ram: None } }
    }

    /// Starts a self-test that was requested. Returns whether one starts; the patrol then has to begin its passes
    /// again.
    pub fn begin_self_test(&mut self, integrity: &Integrity) -> bool {
        let state = &integrity.self_test;
        // Not covered: only this line, a second try of the exclusive access, as in `take_result`.
        let begins = state.compare_exchange(REQUESTED, RUNNING, Ordering::Relaxed, Ordering::Relaxed).is_ok();
        if begins {
            self.self_test = SelfTest::default();
        }
        begins
    }

    /// Evaluates a slice. `damaged` is what [`ImageCheck::slice`] returned in that slice.
    pub fn judge(
        &mut self,
        slice: &Slice,
        damaged: Option<u32>,
        integrity: &Integrity,
        telemetry: &Telemetry,
    ) -> Consequence {
        telemetry.ram_errors.add(u32::from(slice.ram.is_some()));
        telemetry.image_faults.add(u32::from(damaged.is_some()));
        if let Some(sound) = slice.ram_pass {
            telemetry.ram_passes.add(1);
            // Not covered: only this line, the result of a second pass over RAM since the start or since a self-test
            // began, which `or` drops: no run leaves the patrol so much time.
            self.self_test.ram = self.self_test.ram.or(Some(sound));
        }
        let mut consequence = Consequence::None;
        if let Some(generation) = damaged {
            integrity.image_damaged(generation);
            consequence = Consequence::Withdraw;
        }
        if let Some(flash) = slice.flash {
            let intact = flash.is_intact();
            telemetry.flash_passes.add(1);
            telemetry.flash_faults.add(u32::from(!intact));
            integrity.flash_pass(intact);
            // Not covered: only this line, the result of a second pass over flash in the image with hold, as above: the
            // runs beside the hold end before.
            self.self_test.flash = self.self_test.flash.or(Some(intact));
            if !intact {
                consequence = Consequence::Withdraw;
            }
        }
        self.end_self_test(integrity);
        // If a slice has several findings, the one that is evaluated last counts. So the most severe ones come last.
        if let Some(address) = slice.code {
            consequence = Consequence::Stop(Cause::CodeInRam, address);
        }
        if let Some(guard) = slice.guard {
            consequence = Consequence::Stop(Cause::GuardWord, guard);
        }
        consequence
    }

    fn end_self_test(&mut self, integrity: &Integrity) {
        let SelfTest { flash: Some(flash), ram: Some(ram) } = self.self_test else { return };
        let result = if flash && ram { PASSED } else { FAILED };
        // If another self-test was requested meanwhile, this compare-and-exchange fails, so the new request is kept.
        // Not covered: only this line, a second try of the exclusive access, as in `take_result`.
        let _ = integrity.self_test.compare_exchange(RUNNING, result, Ordering::Relaxed, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests;
