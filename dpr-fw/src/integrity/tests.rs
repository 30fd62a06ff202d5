use super::*;
use crate::accept::Early;
use crate::commit::{testing::profile, Commit, Frame, Images};
use crate::port::{Diagnostics, WritePort};
use crate::{link::Health, ImageMemory, IMAGE_WORDS};
use core::cell::Cell;
use firmware_common::program::Comparison;
use profile::map::PortArea;
use proptest::prelude::*;

const N: usize = 3;

/// An image that is exchanged while it is read, after a given number of words.
struct Board {
    image: ImageMemory,
    generation: Cell<u32>,
    words_to_exchange: Cell<u32>,
    /// A word, and the bit in it that is wrong the first time this word is read.
    wrong_read: Cell<Option<(usize, u32)>>,
}

impl Shown for Board {
    fn generation(&self) -> u32 {
        self.generation.get()
    }
    fn copy(&self, first: usize, words: &mut [u32]) {
        for (index, word) in words.iter_mut().enumerate() {
            *word = self.word(first + index);
        }
    }
}

impl Board {
    fn word(&self, index: usize) -> u32 {
        let left = self.words_to_exchange.get();
        self.words_to_exchange.set(left.wrapping_sub(1));
        if left == 0 {
            self.generation.set(self.generation.get() + 1);
        }
        match self.wrong_read.get() {
            Some((word, bit)) if word == index => {
                self.wrong_read.set(None);
                self.image[index] ^ 1 << bit
            }
            _ => self.image[index],
        }
    }
}

struct Album(ImageMemory, Vec<ImageMemory>);

impl Images for Album {
    fn filling(&mut self) -> &mut ImageMemory {
        &mut self.0
    }
    fn place_port<const N: usize>(&mut self) {
        let mut area = PortArea::EMPTY;
        WritePort::new().prepare(&Diagnostics::default(), 0, &mut area);
        let image: &mut [u8] = bytemuck::cast_slice_mut(&mut self.0);
        image[Map::<N>::port_area()].copy_from_slice(area.as_bytes());
    }
    fn publish(&mut self) {
        self.1.push(self.0);
        self.0 = [0; IMAGE_WORDS];
    }
}

/// Returns the image that a commit publishes for cycle number `cycles`. The sequence is found after three cycles.
fn image(cycles: u32) -> ImageMemory {
    let mut album = Album([0; IMAGE_WORDS], vec![]);
    let mut commit = Commit::<N>::new();
    let health = Health::default();
    commit.begin(0, &health, &mut album);
    for cycle in 1..=cycles {
        let profile = profile::<N>(10 * cycle);
        let ended_us = 10_000 * cycle;
        let frame = Frame { payload: profile.as_bytes(), ended_us, early: &Early::default() };
        commit.frame(frame, ended_us + 90, &health, &mut album).expect("of the right length");
    }
    *album.1.last().expect("an image was published")
}

fn board(image: ImageMemory) -> Board {
    Board { image, generation: Cell::new(7), words_to_exchange: Cell::new(u32::MAX), wrong_read: Cell::new(None) }
}

fn round(check: &mut ImageCheck<N>, board: &Board) -> Vec<usize> {
    (0..ImageCheck::<N>::OBJECTS)
        .filter(|_| {
            let damaged = check.step(board);
            assert!(damaged.is_none_or(|generation| generation == board.generation.get()));
            damaged.is_some()
        })
        .collect()
}

fn object_of(byte: usize) -> usize {
    let at = |object: &usize| ImageCheck::<N>::place(*object).expect("an object").contains(&byte);
    (0..ImageCheck::<N>::OBJECTS).find(at).expect("every byte belongs to one")
}

#[test]
fn an_image_is_in_order_with_all_objects_and_with_none() {
    for cycles in [0, 1, 5] {
        let board = board(image(cycles));
        let mut check = ImageCheck::new();
        for _ in 0..3 {
            assert_eq!(round(&mut check, &board), [], "{cycles} cycles");
        }
    }
}

#[test]
fn a_slice_verifies_two_objects_and_four_slices_all_of_three_receivers() {
    for object in 0..ImageCheck::<N>::OBJECTS {
        let mut image = image(5);
        image[ImageCheck::<N>::place(object).expect("an object").start / 4] ^= 1;
        let (board, mut check) = (board(image), ImageCheck::<N>::new());
        let found: Vec<_> = (0..4).map(|_| check.slice(&board)).collect();
        let expected: Vec<_> = (0..4).map(|slice| (slice == object / 2).then_some(7)).collect();
        assert_eq!(found, expected, "object {object}");
    }
}

#[test]
fn the_times_to_detect_are_those_that_are_stated() {
    assert_eq!((IMAGE_DETECT_US, FLASH_DETECT_US), (25_000, 15_377_500));
    assert_eq!((CODE_DETECT_US, RAM_DETECT_US), (10_255_000, 10_255_000));
    assert_eq!(SELF_TEST_US, 3_430_833, "a third of a pass, and a deadline");
}

proptest! {
    // Shows IMG-8.
    #[test]
    fn any_bit_of_the_image_that_flips_is_found_within_one_round(
        byte in 0..Map::<N>::LEN, bit in 0_u32..8, shown: bool,
    ) {
        let mut image = image(if shown { 5 } else { 1 });
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut image);
        bytes[byte] ^= 1 << bit;
        let board = board(image);
        prop_assert_eq!(round(&mut ImageCheck::new(), &board), [object_of(byte)]);
    }

    #[test]
    fn while_the_image_is_exchanged_no_verdict_is_taken(byte in 0..Map::<N>::LEN, words in 0_u32..8) {
        let mut image = image(5);
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut image);
        bytes[byte] ^= 1;
        let board = board(image);
        let mut check = ImageCheck::<N> { next: object_of(byte) };
        board.words_to_exchange.set(words);
        prop_assert_eq!(check.step(&board), None);
        prop_assert_eq!(check.step(&board), Some(8));
    }

    #[test]
    fn a_word_that_was_read_wrongly_once_is_not_believed(word in 0..Map::<N>::LEN / 4, bit in 0_u32..32) {
        let board = board(image(5));
        board.wrong_read.set(Some((word, bit)));
        prop_assert_eq!(round(&mut ImageCheck::new(), &board), []);
        prop_assert_eq!(board.wrong_read.get(), None);
    }
}

#[test]
fn before_the_first_image_there_is_nothing_to_verify() {
    let board = board([0x5A5A_5A5A; IMAGE_WORDS]);
    board.generation.set(0);
    assert_eq!(round(&mut ImageCheck::new(), &board), []);
}

#[test]
fn only_link_status_and_port_status_of_zeros_count_as_damaged() {
    let board = board([0; IMAGE_WORDS]);
    assert_eq!(round(&mut ImageCheck::new(), &board), [0, N + 2]);
}

const INTACT: Comparison = Comparison { computed: 1, expected: 1 };
const CHANGED: Comparison = Comparison { computed: 1, expected: 2 };

#[test]
fn a_damaged_image_is_withdrawn_once_and_only_while_it_is_shown() {
    let (integrity, telemetry, mut judge) = (Integrity::new(), Telemetry::new(), Judge::new());
    assert_eq!(judge.judge(&Slice::default(), None, &integrity, &telemetry), Consequence::None);
    assert!(!integrity.take_withdrawal(4));
    assert_eq!(judge.judge(&Slice::default(), Some(4), &integrity, &telemetry), Consequence::Withdraw);
    assert!(integrity.take_withdrawal(4) && !integrity.take_withdrawal(4));
    judge.judge(&Slice::default(), Some(4), &integrity, &telemetry);
    assert!(!integrity.take_withdrawal(5), "it was replaced meanwhile");
    assert!(!integrity.take_withdrawal(4));
    assert_eq!(telemetry.image_faults.get(), 2);
    assert!(!integrity.take_withdrawal(0));
}

// Shows SAFE-10.
#[test]
fn changed_flash_withdraws_the_shown_image_once() {
    let (integrity, telemetry, mut judge) = (Integrity::new(), Telemetry::new(), Judge::new());
    let mut pass = |flash| judge.judge(&Slice { flash: Some(flash), ..Slice::default() }, None, &integrity, &telemetry);
    assert_eq!(pass(INTACT), Consequence::None);
    assert!(!integrity.flash_fault() && !integrity.take_withdrawal(1));
    assert_eq!(pass(CHANGED), Consequence::Withdraw);
    assert!(integrity.flash_fault() && integrity.take_withdrawal(1) && !integrity.take_withdrawal(1));
    pass(CHANGED);
    assert!(integrity.flash_fault() && !integrity.take_withdrawal(1), "nothing is shown that could be withdrawn");
    assert_eq!(pass(INTACT), Consequence::None);
    assert!(!integrity.flash_fault());
    pass(CHANGED);
    assert!(integrity.take_withdrawal(1));
    assert_eq!((telemetry.flash_passes.get(), telemetry.flash_faults.get()), (5, 3));
}

// Shows SAFE-9.
#[test]
fn changed_code_or_guard_words_stop_the_board() {
    let (integrity, telemetry, mut judge) = (Integrity::new(), Telemetry::new(), Judge::new());
    let mut of = |slice| judge.judge(&slice, Some(1), &integrity, &telemetry);
    let code = Slice { code: Some(0x0080_0010), ..Slice::default() };
    assert_eq!(of(code), Consequence::Stop(Cause::CodeInRam, 0x0080_0010));
    let guard = Slice { guard: Some(3), ..code };
    assert_eq!(of(guard), Consequence::Stop(Cause::GuardWord, 3));
    assert_eq!(of(Slice { ram: Some(0x2001_0040), ..Slice::default() }), Consequence::Withdraw);
    assert_eq!(telemetry.ram_errors.get(), 1);
}

#[test]
fn a_self_test_ends_after_a_whole_pass_of_flash_and_ram() {
    for (flash, ram, passed) in
        [(INTACT, true, true), (CHANGED, true, false), (INTACT, false, false), (CHANGED, false, false)]
    {
        for ram_first in [false, true] {
            let (integrity, telemetry, mut judge) = (Integrity::new(), Telemetry::new(), Judge::new());
            assert!(!judge.begin_self_test(&integrity) && !integrity.is_self_test_running());
            // A self-test counts only passes that end after it was requested.
            let both = Slice { flash: Some(CHANGED), ram_pass: Some(false), ..Slice::default() };
            judge.judge(&both, None, &integrity, &telemetry);
            assert_eq!(integrity.take_result(), None);
            integrity.request_self_test();
            assert!(integrity.is_self_test_running() && judge.begin_self_test(&integrity));
            assert!(integrity.is_self_test_running() && !judge.begin_self_test(&integrity));
            let of_flash = Slice { flash: Some(flash), ..Slice::default() };
            let of_ram = Slice { ram_pass: Some(ram), ..Slice::default() };
            let (first, second) = if ram_first { (of_ram, of_flash) } else { (of_flash, of_ram) };
            judge.judge(&first, None, &integrity, &telemetry);
            judge.judge(&Slice { flash: None, ram_pass: None, ..first }, None, &integrity, &telemetry);
            assert_eq!(integrity.take_result(), None);
            judge.judge(&second, None, &integrity, &telemetry);
            assert!(!integrity.is_self_test_running());
            assert_eq!(integrity.take_result(), Some(passed), "{flash:?} {ram}");
            assert_eq!(integrity.take_result(), None);
            judge.judge(&both, None, &integrity, &telemetry);
            assert_eq!(integrity.take_result(), None);
        }
    }
}

#[test]
fn a_requested_self_test_runs_once_and_gives_its_result_once() {
    let (integrity, telemetry, mut judge) = (Integrity::new(), Telemetry::new(), Judge::new());
    assert_eq!(integrity.serve_self_test(false), None);
    assert!(!integrity.is_self_test_running());
    assert_eq!(integrity.serve_self_test(true), None);
    assert!(judge.begin_self_test(&integrity));
    assert_eq!(integrity.serve_self_test(true), None);
    assert!(!judge.begin_self_test(&integrity), "it was asked for once");
    let both = Slice { flash: Some(INTACT), ram_pass: Some(true), ..Slice::default() };
    judge.judge(&both, None, &integrity, &telemetry);
    assert_eq!(integrity.serve_self_test(true), Some(true));
    assert_eq!(integrity.serve_self_test(false), None);
    assert!(!integrity.is_self_test_running());
}

#[test]
fn a_request_during_a_self_test_begins_it_anew() {
    let (integrity, telemetry, mut judge) = (Integrity::new(), Telemetry::new(), Judge::new());
    integrity.request_self_test();
    assert!(judge.begin_self_test(&integrity));
    let both = Slice { flash: Some(CHANGED), ram_pass: Some(true), ..Slice::default() };
    integrity.request_self_test();
    judge.judge(&both, None, &integrity, &telemetry);
    assert_eq!(integrity.take_result(), None);
    assert!(judge.begin_self_test(&integrity));
    judge.judge(&Slice { flash: Some(INTACT), ..both }, None, &integrity, &telemetry);
    assert_eq!(integrity.take_result(), Some(true));
}
