//! The modified triple buffer (paper, section 2.2 and Figure 6).
//!
//! # Design
//!
//! Three receive buffers: one is written by the RFID side, one is read into the image, one is scrubbed. The roles
//! rotate at each frame. The purpose is a single sentence: *old data can never be read as new*. Here the compiler holds
//! it:
//!
//! ```text
//!            Clean::receive            Filling::received             Received::done
//!   Clean ───────────────────▶ Filling ─────────────────▶ Received ──────────────────▶ Dirty
//!     ▲                          │                                                      ▲ │
//!     │                          └───────────────── Filling::discard ──────────────────┘ │
//!     └──────────────────────────────── Dirty::scrub ────────────────────────────────────┘
//! ```
//!
//! Each state is a type that owns the buffer, none can be cloned, and the arrows above are the only ways from one to
//! the next. So a frame can only be received into a buffer of which every bit was just scrubbed, only what was received
//! can be read, and what was read cannot be read again: it is dirty, and a dirty buffer can only be scrubbed.
//!
//! [`Rotation`] holds the buffers that wait for a task: received ones for the commit task, dirty ones for the scrub
//! task, clean ones for the RFID task. Its operations move a few words, so they may stand in a critical section.
//!
//! # Scrub
//!
//! The paper fills with 0x00 or 0xFF; we fill with both in turn and read back each time, so a scrub also finds bits
//! that are stuck at either level. It ends with 0x00, which no CRC with initial value 0xFFFFFFFF accepts. A faulty
//! buffer stays in use: its objects are protected by their CRCs, an object hit by a stuck bit is rejected, and the
//! fault is shown in the Link-Status. The work is the same whatever the memory holds and however it is broken.

use core::{
    hint::black_box,
    sync::atomic::{compiler_fence, Ordering},
};

use heapless::Deque;
use rtic_core::Mutex;

/// Words of memory, as a scrub sees them. The tests put faulty memory behind it.
pub trait Memory {
    /// Number of 32-bit words.
    fn words(&self) -> usize;
    /// Sets every word to `pattern`.
    fn fill(&mut self, pattern: u32);
    /// The number of bits that differ from `pattern`, as they are read back from the memory itself.
    fn differing_bits(&self, pattern: u32) -> u32;
}

impl<M: Memory + ?Sized> Memory for &mut M {
    fn words(&self) -> usize {
        (**self).words()
    }
    fn fill(&mut self, pattern: u32) {
        (**self).fill(pattern);
    }
    fn differing_bits(&self, pattern: u32) -> u32 {
        (**self).differing_bits(pattern)
    }
}

/// RAM. Both halves pass through an optimisation barrier and a compiler fence: the fill must be in memory before it is
/// read back, and the read back must load it from there, since the compiler may assume nothing about a value that went
/// through [`black_box`]. The on-target tests bound the cycles of a scrub from below, so a dropped one would show.
impl<const WORDS: usize> Memory for [u32; WORDS] {
    fn words(&self) -> usize {
        WORDS
    }

    fn fill(&mut self, pattern: u32) {
        let words = black_box(self);
        for word in words.iter_mut() {
            *word = pattern;
        }
        compiler_fence(Ordering::SeqCst);
        black_box(words);
    }

    fn differing_bits(&self, pattern: u32) -> u32 {
        compiler_fence(Ordering::SeqCst);
        // The usual answer is "none", but the loop does not look for it: its work is constant.
        black_box(self).iter().map(|word| (word ^ pattern).count_ones()).sum()
    }
}

/// A buffer whose every bit was scrubbed since it was last written.
#[derive(Debug)]
pub struct Clean<B>(B);

/// The buffer that is being written.
#[derive(Debug)]
pub struct Filling<B>(B);

/// A buffer that holds a frame which nobody has read yet, with what is known of it.
#[derive(Debug)]
pub struct Received<B, I> {
    buffer: B,
    about: I,
}

/// A buffer of which nothing may be read any more. New buffers begin here, so that none is used unscrubbed.
#[derive(Debug)]
pub struct Dirty<B>(B);

/// What a scrub found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Scrubbed {
    /// Bits that did not take a 1 or did not take a 0; 0 for sound memory.
    pub stuck_bits: u32,
}

impl<B> Clean<B> {
    /// Begins to write the buffer.
    pub fn receive(self) -> Filling<B> {
        Filling(self.0)
    }
}

impl<B> Filling<B> {
    /// The memory to write.
    pub fn memory(&mut self) -> &mut B {
        &mut self.0
    }

    /// What has been written so far, for the writer itself to look at.
    pub fn peek(&self) -> &B {
        &self.0
    }

    /// What was written is whole: it may be read, once. `about` goes with it.
    pub fn received<I>(self, about: I) -> Received<B, I> {
        Received { buffer: self.0, about }
    }

    /// What was written is given up: the buffer must be scrubbed before it is written again.
    pub fn discard(self) -> Dirty<B> {
        Dirty(self.0)
    }
}

impl<B, I> Received<B, I> {
    /// The memory, to be read.
    pub fn memory(&self) -> &B {
        &self.buffer
    }

    /// What was told of the frame when it was received.
    pub fn about(&self) -> &I {
        &self.about
    }

    /// Reading is over.
    pub fn done(self) -> Dirty<B> {
        Dirty(self.buffer)
    }
}

impl<B: Memory> Dirty<B> {
    /// A buffer with unknown content.
    pub fn new(buffer: B) -> Self {
        Self(buffer)
    }

    /// Fills with 0xFF and with 0x00, reading each back.
    pub fn scrub(mut self) -> (Clean<B>, Scrubbed) {
        let mut stuck_bits = 0;
        for pattern in [u32::MAX, 0] {
            self.0.fill(pattern);
            stuck_bits += self.0.differing_bits(pattern);
        }
        (Clean(self.0), Scrubbed { stuck_bits })
    }
}

/// The waiting buffers of a set of three, of which one is always being written.
#[derive(Debug)]
pub struct Rotation<B, I> {
    clean: Deque<Clean<B>, 2>,
    received: Deque<Received<B, I>, 2>,
    dirty: Deque<Dirty<B>, 2>,
}

/// What became of a frame at [`Rotation::rotate`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rotated {
    /// It waits to be read.
    Handed,
    /// No clean buffer was at hand, so the frame was scrubbed away where it stood: the tasks behind are late by a
    /// cycle. With what the scrub found.
    Overrun(Scrubbed),
}

impl<B: Memory, I> Rotation<B, I> {
    /// Scrubs three buffers and starts to write the first. Also gives what the scrubs found.
    pub fn new(buffers: [B; 3]) -> (Filling<B>, Self, Scrubbed) {
        let mut stuck_bits = 0;
        let [first, second, third] = buffers.map(|buffer| {
            let (clean, found) = Dirty::new(buffer).scrub();
            stuck_bits += found.stuck_bits;
            clean
        });
        let mut rotation = Self { clean: Deque::new(), received: Deque::new(), dirty: Deque::new() };
        put(&mut rotation.clean, second);
        put(&mut rotation.clean, third);
        (first.receive(), rotation, Scrubbed { stuck_bits })
    }

    /// A frame is whole: its buffer is handed on to be read, and a clean one is taken to be written.
    pub fn rotate(&mut self, filling: Filling<B>, about: I) -> (Filling<B>, Rotated) {
        match self.clean.pop_front() {
            Some(clean) => {
                put(&mut self.received, filling.received(about));
                (clean.receive(), Rotated::Handed)
            }
            None => {
                let (clean, found) = filling.discard().scrub();
                (clean.receive(), Rotated::Overrun(found))
            }
        }
    }

    /// What was written is no whole frame: its buffer waits to be scrubbed, and a clean one is taken to be written. If
    /// no clean one is at hand the same one is scrubbed here; with what that scrub found.
    pub fn replace(&mut self, filling: Filling<B>) -> (Filling<B>, Scrubbed) {
        match self.clean.pop_front() {
            Some(clean) => {
                put(&mut self.dirty, filling.discard());
                (clean.receive(), Scrubbed::default())
            }
            None => {
                let (clean, found) = filling.discard().scrub();
                (clean.receive(), found)
            }
        }
    }

    /// The oldest frame that waits to be read.
    pub fn read(&mut self) -> Option<Received<B, I>> {
        self.received.pop_front()
    }

    /// Reading is over: the buffer waits to be scrubbed.
    pub fn done(&mut self, received: Received<B, I>) {
        put(&mut self.dirty, received.done());
    }
}

/// Buffers of an [`Exchange`]. Each of four tasks of a buffer can be under way at once, whatever the order in which the
/// firmware's tasks preempt each other: one is streamed, one waits to be streamed, one is scrubbed, one is filled.
pub const IMAGES: usize = 4;

/// The same mechanism between the image's builder and the SSI. Unlike frames, images do not queue: the newest wins.
#[derive(Debug)]
pub struct Exchange<B> {
    newest: Option<Received<B, ()>>,
    clean: Deque<Clean<B>, IMAGES>,
    dirty: Deque<Dirty<B>, IMAGES>,
}

/// A buffer to fill, as it was found.
#[derive(Debug)]
pub enum Blank<B> {
    /// The usual case: the scrub task has been there.
    Clean(Clean<B>),
    /// It has not: [`Blank::fill`] scrubs.
    Dirty(Dirty<B>),
}

impl<B: Memory> Blank<B> {
    /// Begins to fill it, scrubbed in any case; with what a scrub now found.
    pub fn fill(self) -> (Filling<B>, Scrubbed) {
        let (clean, found) = match self {
            Self::Clean(clean) => (clean, Scrubbed::default()),
            Self::Dirty(dirty) => dirty.scrub(),
        };
        (clean.receive(), found)
    }
}

impl<B: Memory> Exchange<B> {
    /// Buffers none of which holds anything.
    pub fn new(buffers: [B; IMAGES]) -> Self {
        let mut exchange = Self { newest: None, clean: Deque::new(), dirty: Deque::new() };
        for buffer in buffers {
            put(&mut exchange.dirty, Dirty::new(buffer));
        }
        exchange
    }

    /// A buffer to fill. While at most one buffer each is streamed, is scrubbed and is being filled, there is one.
    pub fn begin(&mut self) -> Option<Blank<B>> {
        let clean = self.clean.pop_front().map(Blank::Clean);
        clean.or_else(|| self.dirty.pop_front().map(Blank::Dirty))
    }

    /// What was filled is the newest image from now on.
    pub fn publish(&mut self, filling: Filling<B>) {
        if let Some(unread) = self.newest.replace(filling.received(())) {
            put(&mut self.dirty, unread.done());
        }
    }

    /// The image to stream next, given the one streamed so far: the newest if it is newer. Tells whether it is.
    pub fn take(&mut self, streamed: Option<Received<B, ()>>) -> (Option<Received<B, ()>>, bool) {
        match (self.newest.take(), streamed) {
            (Some(newest), streamed) => {
                if let Some(streamed) = streamed {
                    put(&mut self.dirty, streamed.done());
                }
                (Some(newest), true)
            }
            (None, streamed) => (streamed, false),
        }
    }
}

/// Buffers of which some wait to be scrubbed.
pub trait Scrubbable {
    /// A buffer.
    type Buffer: Memory;

    /// The buffer that has waited longest to be scrubbed.
    fn take_dirty(&mut self) -> Option<Dirty<Self::Buffer>>;
    /// Takes back a buffer that was scrubbed.
    fn cleaned(&mut self, clean: Clean<Self::Buffer>);
}

impl<B: Memory, I> Scrubbable for Rotation<B, I> {
    type Buffer = B;

    fn take_dirty(&mut self) -> Option<Dirty<B>> {
        self.dirty.pop_front()
    }

    fn cleaned(&mut self, clean: Clean<B>) {
        put(&mut self.clean, clean);
    }
}

impl<B: Memory> Scrubbable for Exchange<B> {
    type Buffer = B;

    fn take_dirty(&mut self) -> Option<Dirty<B>> {
        self.dirty.pop_front()
    }

    fn cleaned(&mut self, clean: Clean<B>) {
        put(&mut self.clean, clean);
    }
}

/// Scrubs every buffer that waits for it. `buffers` are locked only while one is taken or put back. Gives how many were
/// scrubbed, and the stuck bits found in all of them.
pub fn scrub_waiting<S: Scrubbable>(mut buffers: impl Mutex<T = S>) -> (u32, u32) {
    let (mut scrubbed, mut stuck_bits) = (0, 0);
    while let Some(dirty) = buffers.lock(Scrubbable::take_dirty) {
        let (clean, found) = dirty.scrub();
        scrubbed += 1;
        stuck_bits += found.stuck_bits;
        buffers.lock(|buffers| buffers.cleaned(clean));
    }
    (scrubbed, stuck_bits)
}

/// The queues are as long as there can be buffers in them, so the push cannot fail.
fn put<T, const LEN: usize>(queue: &mut Deque<T, LEN>, item: T) {
    let full = queue.push_back(item).is_err();
    debug_assert!(!full, "a buffer too many has appeared");
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::{cell::RefCell, collections::VecDeque};

    /// Buffers that no other task uses.
    struct Own<'a, S>(&'a mut S);

    impl<S> Mutex for Own<'_, S> {
        type T = S;
        fn lock<R>(&mut self, with: impl FnOnce(&mut S) -> R) -> R {
            with(self.0)
        }
    }

    const WORDS: usize = 4;

    /// Memory with stuck bits: (word, bit, level).
    #[derive(Debug)]
    struct Ram {
        name: usize,
        words: [u32; WORDS],
        stuck: Option<(usize, u32, bool)>,
    }

    impl Ram {
        fn sound(name: usize) -> Self {
            Self { name, words: [0xDEAD_BEEF; WORDS], stuck: None }
        }
        fn settle(&mut self) {
            if let Some((word, bit, level)) = self.stuck {
                let mask = 1 << bit;
                self.words[word] = if level { self.words[word] | mask } else { self.words[word] & !mask };
            }
        }
        fn write(&mut self, frame: u32) {
            self.words = [frame; WORDS];
            self.settle();
        }
    }

    impl Memory for Ram {
        fn words(&self) -> usize {
            WORDS
        }
        fn fill(&mut self, pattern: u32) {
            self.words.fill(pattern);
            self.settle();
        }
        fn differing_bits(&self, pattern: u32) -> u32 {
            self.words.differing_bits(pattern)
        }
    }

    #[test]
    fn a_scrub_of_sound_memory_ends_in_zeros_and_finds_nothing() {
        let (Clean(ram), found) = Dirty::new([0x1234_5678_u32; 7]).scrub();
        assert_eq!(found, Scrubbed { stuck_bits: 0 });
        assert_eq!(ram, [0; 7]);
    }

    #[test]
    fn memory_behind_a_reference_the_form_that_the_firmware_uses_is_scrubbed_alike() {
        let mut ram = [0x1234_5678_u32; 7];
        let (_, found) = Dirty::new(&mut ram).scrub();
        assert_eq!(found, Scrubbed { stuck_bits: 0 });
        assert_eq!(ram, [0; 7]);

        let mut ram = Ram::sound(0);
        ram.stuck = Some((1, 9, true));
        assert_eq!(Memory::words(&&mut ram), WORDS);
        let (_, found) = Dirty::new(&mut ram).scrub();
        assert_eq!(found, Scrubbed { stuck_bits: 1 });
        assert_eq!(ram.words, [0, 1 << 9, 0, 0]);
    }

    #[test]
    fn a_scrub_fills_with_ones_and_with_zeros_and_reads_each_back() {
        /// Notes what is done to it.
        #[derive(Default)]
        struct Log(RefCell<Vec<(char, u32)>>);
        impl Memory for Log {
            fn words(&self) -> usize {
                1
            }
            fn fill(&mut self, pattern: u32) {
                self.0.borrow_mut().push(('w', pattern));
            }
            fn differing_bits(&self, pattern: u32) -> u32 {
                self.0.borrow_mut().push(('r', pattern));
                3
            }
        }
        let (Clean(log), found) = Dirty::new(Log::default()).scrub();
        assert_eq!(found, Scrubbed { stuck_bits: 6 });
        assert_eq!(log.0.into_inner(), [('w', u32::MAX), ('r', u32::MAX), ('w', 0), ('r', 0)]);
    }

    #[test]
    fn reading_back_counts_every_bit_that_differs() {
        let ram = [0x0000_0000, 0x8000_0001, 0xFFFF_FFFF];
        assert_eq!((ram.words(), ram.differing_bits(0), ram.differing_bits(u32::MAX)), (3, 34, 62));
    }

    #[test]
    fn a_frame_that_is_given_up_leaves_its_buffer_to_the_scrub_and_a_clean_one_is_written() {
        let (mut filling, mut rotation, _) = Rotation::<Ram, u32>::new([0, 1, 2].map(Ram::sound));
        for _ in 0..2 {
            filling.memory().write(1);
            let (next, found) = rotation.replace(filling);
            assert_eq!(found, Scrubbed { stuck_bits: 0 });
            filling = next;
            assert_eq!(filling.memory().words, [0; WORDS]);
        }
        assert_eq!(filling.memory().name, 2);
        // No clean one is left: the same one goes on, scrubbed.
        filling.memory().write(1);
        filling.memory().stuck = Some((0, 0, true));
        let (mut filling, found) = rotation.replace(filling);
        assert_eq!((filling.memory().name, found), (2, Scrubbed { stuck_bits: 1 }));
        assert_eq!(filling.memory().words, [1, 0, 0, 0], "but for its stuck bit");
        assert!(rotation.read().is_none(), "and none of them can be read");
        assert_eq!(scrub_waiting(Own(&mut rotation)), (2, 0));
        let (mut filling, _) = rotation.replace(filling);
        assert_eq!((filling.memory().name, filling.memory().words), (0, [0; WORDS]));
    }

    #[test]
    fn the_scrub_task_cleans_all_that_waits_and_tells_what_it_found() {
        let mut rams = [0, 1, 2, 3].map(Ram::sound);
        rams[3].stuck = Some((3, 31, false));
        let mut exchange = Exchange::new(rams);
        assert_eq!(scrub_waiting(Own(&mut exchange)), (4, 1));
        assert_eq!(scrub_waiting(Own(&mut exchange)), (0, 0));
        for name in 0..4 {
            let Some(Blank::Clean(clean)) = exchange.begin() else { panic!("buffer {name} is clean") };
            assert_eq!(clean.receive().memory().name, name);
        }
        assert!(exchange.begin().is_none());
    }

    #[test]
    fn an_image_that_is_replaced_unread_is_scrubbed_like_one_that_was_streamed() {
        let mut exchange = Exchange::new([0, 1, 2, 3].map(Ram::sound));
        scrub_waiting(Own(&mut exchange));
        let fill = |exchange: &mut Exchange<Ram>, what| {
            let (mut filling, _) = exchange.begin().expect("one is free").fill();
            filling.memory().write(what);
            exchange.publish(filling);
        };
        fill(&mut exchange, 1);
        fill(&mut exchange, 2);
        assert_eq!(scrub_waiting(Own(&mut exchange)), (1, 0), "the first was never read");
        let (streamed, newer) = exchange.take(None);
        assert!(newer);
        fill(&mut exchange, 3);
        let (streamed, newer) = exchange.take(streamed);
        assert!(newer);
        assert_eq!(streamed.as_ref().map(|image| image.memory().words), Some([3; WORDS]));
        assert_eq!(scrub_waiting(Own(&mut exchange)), (1, 0));
        let (streamed, newer) = exchange.take(streamed);
        assert_eq!((streamed.is_some(), newer), (true, false), "the same one again");
    }

    proptest! {
        #[test]
        fn a_scrub_finds_any_stuck_bit_at_either_level(word in 0..WORDS, bit in 0_u32..32, level: bool) {
            let mut ram = Ram::sound(0);
            ram.stuck = Some((word, bit, level));
            let (_, found) = Dirty::new(ram).scrub();
            prop_assert_eq!(found, Scrubbed { stuck_bits: 1 });
        }

        /// The tasks run in any order and any of them may be late. Against the model of a queue of frames: what is read
        /// was received exactly once, in order, out of a buffer that was clean when it began to be written.
        #[test]
        fn no_order_of_the_tasks_reads_a_frame_twice_or_writes_over_an_old_one(
            steps in prop::collection::vec(0_u8..7, 0..400),
        ) {
            let (mut filling, mut rotation, found) = Rotation::<Ram, u32>::new([0, 1, 2].map(Ram::sound));
            prop_assert_eq!(found.stuck_bits, 0);
            let mut waiting = VecDeque::new();
            let (mut reading, mut scrubbing) = (None::<Received<Ram, u32>>, None::<Dirty<Ram>>);
            let mut frame = 0;
            for step in steps {
                match step {
                    // A frame arrives.
                    0 | 1 => {
                        frame += 1;
                        let in_hand = usize::from(reading.is_some()) + usize::from(scrubbing.is_some());
                        let spare = 3 - 1 - waiting.len() - in_hand - rotation.dirty.len();
                        prop_assert_eq!(filling.memory().words, [0; WORDS], "written over old data");
                        filling.memory().write(frame);
                        let (next, rotated) = rotation.rotate(filling, frame);
                        filling = next;
                        match rotated {
                            Rotated::Handed => { prop_assert!(spare > 0); waiting.push_back(frame); }
                            Rotated::Overrun(found) => {
                                prop_assert_eq!(spare, 0);
                                prop_assert_eq!(found.stuck_bits, 0);
                            }
                        }
                    }
                    2 => if reading.is_none() {
                        reading = rotation.read();
                        prop_assert_eq!(reading.as_ref().map(|frame| *frame.about()), waiting.pop_front());
                        if let Some(read) = &reading {
                            prop_assert_eq!(read.memory().words, [*read.about(); WORDS]);
                        }
                    },
                    3 => if let Some(read) = reading.take() { rotation.done(read); },
                    4 => if scrubbing.is_none() { scrubbing = rotation.take_dirty(); },
                    // A frame begins to arrive and is given up.
                    5 => {
                        filling.memory().write(u32::MAX);
                        let (next, found) = rotation.replace(filling);
                        prop_assert_eq!(found.stuck_bits, 0);
                        filling = next;
                    }
                    _ => if let Some(dirty) = scrubbing.take() {
                        let (clean, found) = dirty.scrub();
                        prop_assert_eq!(found.stuck_bits, 0);
                        rotation.cleaned(clean);
                    },
                }
            }
        }
    }

    #[test]
    fn on_time_the_three_roles_rotate_at_each_frame() {
        let (mut filling, mut rotation, _) = Rotation::<Ram, u32>::new([0, 1, 2].map(Ram::sound));
        let mut written = Vec::new();
        for frame in 1..=7 {
            written.push(filling.memory().name);
            filling.memory().write(frame);
            let (next, rotated) = rotation.rotate(filling, frame);
            filling = next;
            assert_eq!(rotated, Rotated::Handed);
            let read = rotation.read().expect("a frame waits");
            assert_eq!(*read.about(), frame);
            rotation.done(read);
            let (clean, _) = rotation.take_dirty().expect("a buffer waits").scrub();
            rotation.cleaned(clean);
        }
        assert_eq!(written, [0, 1, 2, 0, 1, 2, 0]);
    }

    #[test]
    fn a_buffer_with_a_stuck_bit_reports_it_at_every_scrub() {
        let mut rams = [0, 1, 2].map(Ram::sound);
        rams[1].stuck = Some((2, 17, true));
        let (mut filling, mut rotation, found) = Rotation::<Ram, u32>::new(rams);
        assert_eq!(found.stuck_bits, 1);
        let mut faults = 0;
        for frame in 1..=6 {
            let (next, _) = rotation.rotate(filling, frame);
            filling = next;
            let read = rotation.read().expect("a frame waits");
            rotation.done(read);
            let (clean, found) = rotation.take_dirty().expect("a buffer waits").scrub();
            faults += found.stuck_bits;
            rotation.cleaned(clean);
        }
        assert_eq!(faults, 2);
    }

    #[test]
    fn with_nobody_reading_the_third_frame_is_an_overrun_and_the_first_two_are_kept() {
        let (mut filling, mut rotation, _) = Rotation::<Ram, u32>::new([0, 1, 2].map(Ram::sound));
        let mut results = Vec::new();
        for frame in 1..=3 {
            filling.memory().write(frame);
            let (next, rotated) = rotation.rotate(filling, frame);
            results.push(rotated);
            filling = next;
        }
        assert_eq!(results, [Rotated::Handed, Rotated::Handed, Rotated::Overrun(Scrubbed { stuck_bits: 0 })]);
        assert_eq!(rotation.read().map(|frame| frame.about), Some(1));
        assert_eq!(rotation.read().map(|frame| frame.about), Some(2));
        assert!(rotation.read().is_none());
    }

    proptest! {
        /// Builder, SSI and scrub in any order: what is streamed is whole, is the newest there was when it was taken,
        /// never goes back, and there is always a buffer to fill.
        #[test]
        fn the_image_that_is_streamed_is_never_the_one_being_filled_and_never_older_than_the_last(
            steps in prop::collection::vec(0_u8..5, 0..400),
        ) {
            let mut exchange = Exchange::new([0, 1, 2, 3].map(Ram::sound));
            let (mut streaming, mut scrubbing) = (None::<Received<Ram, ()>>, None::<Dirty<Ram>>);
            let (mut published, mut shown) = (0, 0);
            for step in steps {
                match step {
                    0 | 1 => {
                        let blank = exchange.begin();
                        prop_assert!(blank.is_some(), "nothing to fill");
                        if let Some(blank) = blank {
                            let (mut filling, found) = blank.fill();
                            prop_assert_eq!(found.stuck_bits, 0);
                            prop_assert_eq!(filling.memory().words, [0; WORDS], "filled over old data");
                            published += 1;
                            filling.memory().write(published);
                            exchange.publish(filling);
                        }
                    }
                    2 => {
                        let (taken, fresh) = exchange.take(streaming.take());
                        prop_assert_eq!(fresh, published > shown);
                        if let Some(image) = &taken {
                            prop_assert_eq!(image.memory().words, [published; WORDS]);
                        }
                        prop_assert_eq!(taken.is_some(), published > 0);
                        shown = published;
                        streaming = taken;
                    }
                    3 => if scrubbing.is_none() { scrubbing = exchange.take_dirty(); },
                    _ => if let Some(dirty) = scrubbing.take() { exchange.cleaned(dirty.scrub().0); },
                }
                if let Some(image) = &streaming {
                    prop_assert_eq!(image.memory().words, [shown; WORDS], "torn");
                }
            }
        }
    }
}
