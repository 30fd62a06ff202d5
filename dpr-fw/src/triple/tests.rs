use std::{
    cell::{Cell, RefCell},
    collections::VecDeque,
    panic::AssertUnwindSafe,
    rc::Rc,
};

use proptest::prelude::*;

use super::*;

/// A set of buffers that a single task uses, so its lock does nothing.
struct Own<'a, S>(&'a mut S);

impl<S> Mutex for Own<'_, S> {
    type T = S;
    fn lock<R>(&mut self, with: impl FnOnce(&mut S) -> R) -> R {
        with(self.0)
    }
}

const WORDS: usize = 4;

/// Returns the result of scrubbing this many buffers without finding a stuck bit.
fn sound(buffers: u32) -> Scrubbed {
    Scrubbed { buffers, stuck_bits: 0, out_of_use: 0 }
}

/// Memory with stuck bits, given as (word, bit, level).
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
    let clean = Dirty::new([0x1234_5678_u32; 7]).scrub().expect("sound");
    assert_eq!(clean.receive().peek(), &[0; 7]);
}

#[test]
fn memory_behind_a_reference_is_scrubbed_as_well() {
    let mut ram = [0x1234_5678_u32; 7];
    assert!(Dirty::new(&mut ram).scrub().is_ok());
    assert_eq!(ram, [0; 7]);
    let address = (&raw const ram).addr();
    assert_eq!(Memory::address(&&mut ram), address);
    let received = Dirty::new(&mut ram).scrub().expect("sound").receive().received(());
    assert_eq!(received.address(), address);

    let mut ram = Ram::sound(0);
    ram.stuck = Some((1, 9, true));
    assert_eq!(Memory::words(&&mut ram), WORDS);
    assert_eq!(Dirty::new(&mut ram).scrub().expect_err("a bit is stuck").stuck_bits(), 1);
    assert_eq!(ram.words, [0, 1 << 9, 0, 0]);
}

// Shows IMG-6.
#[test]
fn a_scrub_fills_with_ones_and_with_zeros_and_reads_each_back() {
    #[derive(Debug, Default)]
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
    let faulty = Dirty::new(Log::default()).scrub().expect_err("each time three bits differ");
    assert_eq!(faulty.stuck_bits(), 6);
    assert_eq!(faulty.keep().receive().memory().0.take(), [('w', u32::MAX), ('r', u32::MAX), ('w', 0), ('r', 0)]);
}

// Shows SAFE-18.
#[test]
fn a_buffer_whose_address_has_changed_is_not_used() {
    #[derive(Clone, Debug)]
    struct Placed(Rc<Cell<usize>>);
    impl Memory for Placed {
        fn words(&self) -> usize {
            0
        }
        fn fill(&mut self, _: u32) {}
        fn differing_bits(&self, _: u32) -> u32 {
            0
        }
        fn address(&self) -> usize {
            self.0.get()
        }
    }
    let is_used = |bit: u32, by: fn(Clean<Placed>)| {
        let address = Rc::new(Cell::new(0x2000_1000));
        let clean = Dirty::new(Placed(address.clone())).scrub().expect("it is sound");
        address.set(address.get() ^ 1_usize.checked_shl(bit).unwrap_or(0));
        std::panic::catch_unwind(AssertUnwindSafe(|| by(clean))).is_ok()
    };
    let uses: [fn(Clean<Placed>); 3] = [
        |clean| assert!(clean.receive().discard().scrub().is_ok()),
        |clean| drop(clean.receive().memory().clone()),
        |clean| drop(clean.receive().received(()).memory().clone()),
    ];
    for by in uses {
        assert!(is_used(usize::BITS, by), "no bit has flipped");
        for bit in 0..usize::BITS {
            assert!(!is_used(bit, by), "bit {bit}");
        }
    }
}

#[test]
fn buffers_leave_a_queue_in_the_order_in_which_they_came() {
    let mut queue = Waiting::<u32, 3>::NONE;
    let mut model = VecDeque::new();
    for (number, pushes) in [true, true, false, true, true, false, false, true, false, false, false].iter().enumerate()
    {
        if *pushes {
            queue.push(number as u32);
            model.push_back(number as u32);
        } else {
            assert_eq!(queue.pop(), model.pop_front());
        }
    }
    assert_eq!((queue.pop(), queue.0), (None, [None; 3]));
}

#[test]
#[should_panic(expected = "each buffer has a place")]
fn a_buffer_too_many_is_not_lost() {
    let mut queue = Waiting::<u32, 2>::NONE;
    for buffer in 0..3 {
        queue.push(buffer);
    }
}

#[test]
fn reading_back_counts_every_bit_that_differs() {
    let ram = [0x0000_0000, 0x8000_0001, 0xFFFF_FFFF];
    assert_eq!((ram.words(), ram.differing_bits(0), ram.differing_bits(u32::MAX)), (3, 34, 62));
    assert_eq!([1_u32, 1].differing_bits(0), 2, "the same bit of two words");
}

#[test]
fn a_frame_that_is_given_up_leaves_its_buffer_to_the_scrub() {
    let (mut filling, mut rotation, _) = Rotation::<Ram, u32>::new([0, 1, 2].map(Ram::sound));
    for _ in 0..2 {
        filling.memory().write(1);
        let (next, found) = rotation.replace(filling);
        assert_eq!(found, Scrubbed::default());
        filling = next;
        assert_eq!(filling.memory().words, [0; WORDS]);
    }
    assert_eq!(filling.memory().name, 2);
    // No clean buffer is left, so the buffer of the lost frame is scrubbed and used again.
    filling.memory().write(1);
    filling.memory().stuck = Some((0, 0, true));
    let (mut filling, found) = rotation.replace(filling);
    assert_eq!((filling.memory().name, found), (2, Scrubbed { buffers: 1, stuck_bits: 1, out_of_use: 0 }));
    assert_eq!(filling.memory().words, [1, 0, 0, 0], "but for its stuck bit");
    assert!(rotation.read().is_none(), "and none of them can be read");
    assert_eq!(scrub_waiting(Own(&mut rotation)), sound(2));
    let (mut filling, _) = rotation.replace(filling);
    assert_eq!((filling.memory().name, filling.memory().words), (0, [0; WORDS]));
}

#[test]
fn the_scrub_task_cleans_all_that_waits_and_tells_what_it_found() {
    let mut exchange = Exchange::new([0, 1, 2, 3].map(Ram::sound));
    assert_eq!(scrub_waiting(Own(&mut exchange)), sound(4));
    assert_eq!(scrub_waiting(Own(&mut exchange)), sound(0));
    for name in 0..4 {
        let Some(Blank::Clean(clean)) = exchange.begin() else { panic!("buffer {name} is clean") };
        assert_eq!(clean.receive().memory().name, name);
    }
    assert!(exchange.begin().is_none());
}

#[test]
fn an_image_that_is_replaced_unread_is_scrubbed() {
    let mut exchange = Exchange::new([0, 1, 2, 3].map(Ram::sound));
    scrub_waiting(Own(&mut exchange));
    let fill = |exchange: &mut Exchange<Ram>, what| {
        let (mut filling, _) = exchange.begin().expect("one is free").fill();
        filling.memory().write(what);
        exchange.publish(filling);
    };
    fill(&mut exchange, 1);
    fill(&mut exchange, 2);
    assert_eq!(scrub_waiting(Own(&mut exchange)), sound(1), "the first was never read");
    let (streamed, newer) = exchange.take(None);
    assert!(newer);
    fill(&mut exchange, 3);
    let (streamed, newer) = exchange.take(streamed);
    assert!(newer);
    assert_eq!(streamed.as_ref().map(|image| image.memory().words), Some([3; WORDS]));
    assert_eq!(scrub_waiting(Own(&mut exchange)), sound(1));
    let (streamed, newer) = exchange.take(streamed);
    assert_eq!((streamed.is_some(), newer), (true, false), "the same one again");
}

proptest! {
    #[test]
    fn a_scrub_finds_any_stuck_bit_at_either_level(word in 0..WORDS, bit in 0_u32..32, level: bool) {
        let mut ram = Ram::sound(0);
        ram.stuck = Some((word, bit, level));
        prop_assert_eq!(Dirty::new(ram).scrub().expect_err("a bit is stuck").stuck_bits(), 1);
    }

    /// The tasks run in any order, and each of them may be late. Every frame that is read must have been received
    /// exactly once, in order, into a buffer that was clean when the frame began.
    #[test]
    fn no_order_of_the_tasks_reads_a_frame_twice_or_overwrites_one(
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
                    let spare = 3 - 1 - waiting.len() - in_hand - rotation.dirty.0.iter().flatten().count();
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
                // A frame begins to arrive in the buffer, but is never delivered.
                5 => {
                    filling.memory().write(u32::MAX);
                    let (next, found) = rotation.replace(filling);
                    prop_assert_eq!(found.stuck_bits, 0);
                    filling = next;
                }
                _ => if let Some(dirty) = scrubbing.take() {
                    prop_assert_eq!(rotation.scrubbed(dirty.scrub()), sound(1));
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
        assert_eq!(scrub_waiting(Own(&mut rotation)), sound(1));
    }
    assert_eq!(written, [0, 1, 2, 0, 1, 2, 0]);
}

/// Receives, reads and scrubs a frame. Returns the name of the frame's buffer, and the scrub's result.
fn cycle(rotation: &mut Rotation<Ram, u32>, mut filling: Filling<Ram>, frame: u32) -> (Filling<Ram>, usize, Scrubbed) {
    let name = filling.memory().name;
    filling.memory().write(frame);
    let (next, rotated) = rotation.rotate(filling, frame);
    assert_eq!(rotated, Rotated::Handed);
    let read = rotation.read().expect("a frame waits");
    assert_eq!(*read.about(), frame);
    rotation.done(read);
    let found = scrub_waiting(Own(rotation));
    (next, name, found)
}

/// Returns memories. Those whose numbers are in `stuck` have a bit that is stuck at 1.
fn rams<const OF: usize>(stuck: &[usize]) -> [Ram; OF] {
    std::array::from_fn(|name| Ram { stuck: stuck.contains(&name).then_some((2, 17, true)), ..Ram::sound(name) })
}

#[test]
fn a_receive_buffer_with_a_stuck_bit_at_start_is_never_written() {
    for stuck in 0..3 {
        let (mut filling, mut rotation, found) = Rotation::<Ram, u32>::new(rams(&[stuck]));
        assert_eq!(found, Scrubbed { buffers: 3, stuck_bits: 1, out_of_use: 1 });
        let mut written = Vec::new();
        for frame in 1..=4 {
            let (next, name, found) = cycle(&mut rotation, filling, frame);
            assert_eq!(found, sound(1));
            written.push(name);
            filling = next;
        }
        let [first, second] = [[1, 2], [0, 2], [0, 1]][stuck];
        assert_eq!(written, [first, second, first, second]);
        assert_eq!(rotation.out_of_use(), 1);
    }
}

#[test]
fn a_receive_buffer_whose_bit_gets_stuck_leaves_use_once_read() {
    let (mut filling, mut rotation, found) = Rotation::<Ram, u32>::new(rams(&[]));
    assert_eq!((found, rotation.out_of_use()), (sound(3), 0));
    filling.memory().stuck = Some((1, 3, false));
    let mut written = Vec::new();
    let mut all = Scrubbed::default();
    for frame in 1..=5 {
        let (next, name, found) = cycle(&mut rotation, filling, frame);
        written.push(name);
        all += found;
        filling = next;
    }
    assert_eq!(written, [0, 1, 2, 1, 2]);
    assert_eq!((all, rotation.out_of_use()), (Scrubbed { buffers: 5, stuck_bits: 1, out_of_use: 1 }, 1));
}

#[test]
fn the_last_two_receive_buffers_stay_in_use_despite_stuck_bits() {
    let (mut filling, mut rotation, found) = Rotation::<Ram, u32>::new(rams(&[0, 1, 2]));
    assert_eq!(found, Scrubbed { buffers: 3, stuck_bits: 3, out_of_use: 1 });
    for frame in 1..=4 {
        let (next, name, found) = cycle(&mut rotation, filling, frame);
        assert_eq!((name, found), (2 - (frame as usize % 2), Scrubbed { buffers: 1, stuck_bits: 1, out_of_use: 0 }));
        filling = next;
    }
    assert_eq!(rotation.out_of_use(), 1);
}

#[test]
fn with_two_receive_buffers_a_frame_during_a_read_is_given_up() {
    let (mut filling, mut rotation, _) = Rotation::<Ram, u32>::new(rams(&[1]));
    filling.memory().write(1);
    let (filling, rotated) = rotation.rotate(filling, 1);
    assert_eq!(rotated, Rotated::Handed);
    let read = rotation.read().expect("a frame waits");

    // The commit task is still reading the first frame when the second and the third frame arrive.
    let mut filling = filling;
    for frame in 2..=3 {
        filling.memory().write(frame);
        let (next, rotated) = rotation.rotate(filling, frame);
        assert_eq!(rotated, Rotated::Overrun(sound(1)));
        filling = next;
        assert_eq!((filling.memory().name, filling.memory().words), (2, [0; WORDS]));
        assert_eq!((read.memory().name, read.memory().words), (0, [1; WORDS]));
    }
    // A frame that is not delivered leaves the buffer that is being read unchanged, too.
    let (next, found) = rotation.replace(filling);
    assert_eq!(found, sound(1));
    filling = next;

    rotation.done(read);
    assert_eq!(scrub_waiting(Own(&mut rotation)), sound(1));
    let (filling, name, _) = cycle(&mut rotation, filling, 4);
    assert_eq!(name, 2);
    assert_eq!(cycle(&mut rotation, filling, 5).1, 0);
}

#[test]
fn the_last_three_images_stay_in_use_despite_stuck_bits() {
    for stuck in [&[1][..], &[0, 3], &[0, 1, 2, 3]] {
        let mut exchange = Exchange::new(rams(stuck));
        assert_eq!(exchange.out_of_use(), 0, "nothing is known yet");
        let found = scrub_waiting(Own(&mut exchange));
        assert_eq!(found.out_of_use, 1, "{stuck:?}");
        assert_eq!(exchange.out_of_use(), 1);
        // With only three images left in use, the scrub task gets none to scrub.
        assert_eq!(scrub_waiting(Own(&mut exchange)), sound(0));
        let mut used = Vec::new();
        let mut streamed = None;
        for generation in 1..=6 {
            let (mut filling, _) = exchange.begin().expect("one is free").fill();
            used.push(filling.memory().name);
            filling.memory().write(generation);
            exchange.publish(filling);
            if generation % 2 == 0 {
                streamed = exchange.take(streamed).0;
            }
        }
        used.sort_unstable();
        used.dedup();
        let left: Vec<_> = (0..4).filter(|name| *name != stuck[0]).collect();
        assert_eq!(used, left, "{stuck:?}: all but the first that was found");
    }
}

#[test]
fn with_three_images_one_can_always_be_filled() {
    let mut exchange = Exchange::new(rams(&[2]));
    scrub_waiting(Own(&mut exchange));
    let mut streamed = None;
    for generation in 1..=9 {
        for _ in 0..2 {
            let (mut filling, _) = exchange.begin().expect("one is free").fill();
            assert_eq!(filling.memory().words, [0; WORDS], "filled over old data");
            filling.memory().write(generation);
            exchange.publish(filling);
            assert!(exchange.take_dirty().is_none(), "the scrub task would hold what the next commit needs");
        }
        streamed = exchange.take(streamed).0;
        assert_eq!(streamed.as_ref().map(|image| image.memory().words), Some([generation; WORDS]));
    }
}

#[test]
fn a_stuck_bit_found_while_filling_an_image_leaves_it_in_use() {
    let mut exchange = Exchange::new(rams(&[0]));
    let (filling, found) = exchange.begin().expect("one is free").fill();
    assert_eq!(found, Scrubbed { buffers: 1, stuck_bits: 1, out_of_use: 0 });
    exchange.publish(filling);
    let (streamed, _) = exchange.take(None);
    assert_eq!(scrub_waiting(Own(&mut exchange)), sound(3));
    let (filling, _) = exchange.begin().expect("one is free").fill();
    exchange.publish(filling);
    let (_streamed, _) = exchange.take(streamed);
    assert_eq!(scrub_waiting(Own(&mut exchange)), Scrubbed { buffers: 1, stuck_bits: 1, out_of_use: 1 });
}

#[test]
fn the_third_frame_that_nobody_reads_is_an_overrun() {
    let (mut filling, mut rotation, _) = Rotation::<Ram, u32>::new([0, 1, 2].map(Ram::sound));
    let mut results = Vec::new();
    for frame in 1..=3 {
        filling.memory().write(frame);
        let (next, rotated) = rotation.rotate(filling, frame);
        results.push(rotated);
        filling = next;
    }
    assert_eq!(results, [Rotated::Handed, Rotated::Handed, Rotated::Overrun(sound(1))]);
    assert_eq!(rotation.read().map(|frame| *frame.about()), Some(1));
    assert_eq!(rotation.read().map(|frame| *frame.about()), Some(2));
    assert!(rotation.read().is_none());
}

proptest! {
    /// The commit, SSI and scrub tasks run in any order. The streamed image must be whole, must have been the newest
    /// when it was taken, and must never be older than the one before. There must always be a buffer to fill.
    // Shows IMG-7.
    #[test]
    fn the_streamed_image_is_whole_and_never_older_than_the_last(
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
                _ => if let Some(dirty) = scrubbing.take() {
                    prop_assert_eq!(exchange.scrubbed(dirty.scrub()), sound(1));
                },
            }
            if let Some(image) = &streaming {
                prop_assert_eq!(image.memory().words, [shown; WORDS], "torn");
            }
        }
    }
}
