use super::*;
use proptest::prelude::*;
use std::collections::BTreeMap;

const IMAGE: u32 = 0x0800_0000;
const IMAGE_WORDS: u32 = 37;
const CODE: u32 = 0x0080_0000;
const CODE_WORDS: u32 = 10;
const FREE: u32 = 0x2000_8000;
const FREE_WORDS: u32 = 21;
const GUARDS: [u32; guard::COUNT] = [0x2000_0000, 0x2000_1000, 0x2000_1010, 0x2000_1020, 0x2000_1030];
const SHUT: u32 = 5;
const RATE: Rate = Rate { flash_words: 4, code_words: 3, march_words: 7 };

/// A fault of one bit of a word.
#[derive(Clone, Copy, Debug)]
enum Fault {
    /// It has this level always.
    Stuck { address: u32, bit: u32, level: bool },
    /// It takes no 1 once it is 0, or no 0 once it is 1.
    Transition { address: u32, bit: u32, up: bool },
    /// A change of the first bit to 1 changes the second.
    Coupled { from: (u32, u32), to: (u32, u32) },
    /// A store to the one address also goes to the other.
    Decoder { from: u32, to: u32 },
}

#[derive(Clone, Debug, Default)]
struct Ram {
    words: BTreeMap<u32, u32>,
    faults: Vec<Fault>,
    stores: u32,
    loads: std::cell::Cell<u32>,
}

impl Ram {
    fn flip(&mut self, address: u32, bit: u32) {
        *self.words.get_mut(&address).expect("a word") ^= 1 << bit;
    }
    fn put(&mut self, address: u32, word: u32) {
        let before = self.words.insert(address, word).unwrap_or(0);
        for fault in self.faults.clone() {
            let now = self.words[&address];
            match fault {
                Fault::Stuck { address: at, bit, level } if at == address => {
                    self.words.insert(at, now & !(1 << bit) | u32::from(level) << bit);
                }
                Fault::Transition { address: at, bit, up } if at == address => {
                    let refused = if up { !before & now } else { before & !now } & 1 << bit;
                    self.words.insert(at, now ^ refused);
                }
                Fault::Coupled { from, to } if from.0 == address && !before & now & 1 << from.1 != 0 => {
                    *self.words.entry(to.0).or_insert(0) ^= 1 << to.1;
                }
                Fault::Decoder { from, to } if from == address => {
                    self.words.insert(to, word);
                }
                _ => {}
            }
        }
    }
}

impl Memory for Ram {
    fn load(&self, address: u32) -> u32 {
        self.loads.set(self.loads.get() + 1);
        assert!(!(IMAGE..IMAGE + 4 * SHUT).contains(&address), "this is shut: {address:#x}");
        self.words.get(&address).copied().unwrap_or_else(|| panic!("nothing is at {address:#x}"))
    }
    fn load_shut(&self, address: u32) -> u32 {
        self.loads.set(self.loads.get() + 1);
        assert!((IMAGE..IMAGE + 4 * SHUT).contains(&address), "this is not shut: {address:#x}");
        self.words[&address]
    }
    fn store(&mut self, address: u32, word: u32) {
        self.stores += 1;
        let mine = GUARDS.iter().any(|guard| (*guard..guard + 8).contains(&address));
        assert!(mine || (FREE..FREE + 4 * FREE_WORDS).contains(&address), "not free: {address:#x}");
        self.put(address, word);
    }
}

fn layout() -> Layout {
    Layout {
        image: IMAGE..IMAGE + 4 * IMAGE_WORDS,
        shut_end: IMAGE + 4 * SHUT,
        code: CODE..CODE + 4 * CODE_WORDS,
        code_load: IMAGE + 4 * 12,
        guards: GUARDS,
        free: FREE..FREE + 4 * FREE_WORDS,
    }
}

/// A sealed image with the code's load image in it, the code, and noise elsewhere.
fn board() -> (Patrol, Ram) {
    let mut ram = Ram::default();
    let image: Vec<u32> = (0..IMAGE_WORDS).map(|word| word.wrapping_mul(0x0123_4567) ^ 0xDEAD_BEEF).collect();
    for (address, word) in (IMAGE..).step_by(4).zip(&image) {
        ram.words.insert(address, *word);
    }
    let crc = profile::crc::frame_of_words(image.iter().copied());
    ram.words.insert(IMAGE + 4 * IMAGE_WORDS, crc.swap_bytes());
    for word in 0..CODE_WORDS {
        ram.words.insert(CODE + 4 * word, image[12 + word as usize]);
    }
    for word in 0..FREE_WORDS {
        ram.words.insert(FREE + 4 * word, word ^ 0xA5A5_0000);
    }
    (Patrol::new(layout(), RATE, &mut ram), ram)
}

/// Slices until `found` tells, at most so many.
fn slices_until(patrol: &mut Patrol, ram: &mut Ram, most: u32, found: impl Fn(&Slice) -> bool) -> u32 {
    (1..=most).find(|_| found(&patrol.slice(ram))).unwrap_or_else(|| panic!("not found within {most} slices"))
}

fn slices(us: u32) -> u32 {
    us / SLICE_US
}

#[test]
fn sound_memory_passes_round_after_round() {
    let (mut patrol, mut ram) = board();
    let (mut flash, mut passes) = (0, 0);
    for _ in 0..500 {
        let slice = patrol.slice(&mut ram);
        assert_eq!((slice.code, slice.guard, slice.ram_errors), (None, None, 0));
        flash += u32::from(slice.flash.is_some_and(Comparison::is_intact));
        assert!(slice.flash.is_none_or(Comparison::is_intact));
        passes += u32::from(slice.ram_pass.is_some());
        assert!(slice.ram_pass.is_none_or(|errors| errors == 0));
    }
    assert_eq!(flash, 500 / IMAGE_WORDS.div_ceil(RATE.flash_words));
    assert_eq!(passes, 500 * RATE.march_words / (march::ELEMENTS * FREE_WORDS));
}

proptest! {
    #[test]
    fn a_bit_of_flash_is_found_in_time_wherever_and_whenever_it_flips(
        word in 0..=IMAGE_WORDS, bit in 0_u32..32, after in 0_u32..40,
    ) {
        let (mut patrol, mut ram) = board();
        (0..after).for_each(|_| { patrol.slice(&mut ram); });
        ram.flip(IMAGE + 4 * word, bit);
        let most = slices(RATE.flash_detect_us(4 * IMAGE_WORDS));
        slices_until(&mut patrol, &mut ram, most, |slice| slice.flash.is_some_and(|found| !found.is_intact()));
        // Flash that is as it was passes again, with the pass that begins after that.
        ram.flip(IMAGE + 4 * word, bit);
        slices_until(&mut patrol, &mut ram, most, |slice| slice.flash.is_some_and(Comparison::is_intact));
    }

    #[test]
    fn a_bit_of_code_in_ram_is_found_in_time_with_its_address(
        word in 0..CODE_WORDS, bit in 0_u32..32, after in 0_u32..40,
    ) {
        let (mut patrol, mut ram) = board();
        (0..after).for_each(|_| { patrol.slice(&mut ram); });
        ram.flip(CODE + 4 * word, bit);
        let most = slices(RATE.code_detect_us(4 * CODE_WORDS));
        slices_until(&mut patrol, &mut ram, most, |slice| slice.code == Some(CODE + 4 * word));
    }

    #[test]
    fn a_guard_that_changes_is_found_by_the_next_slice(
        which in 0..guard::COUNT, word in 0_u32..2, bit in 0_u32..32, after in 0_u32..40,
    ) {
        let (mut patrol, mut ram) = board();
        (0..after).for_each(|_| { patrol.slice(&mut ram); });
        ram.flip(GUARDS[which] + 4 * word, bit);
        prop_assert_eq!(patrol.slice(&mut ram).guard, Some(which as u32));
    }

    #[test]
    fn a_stuck_bit_or_one_that_does_not_change_is_found_within_a_pass(
        word in 0..FREE_WORDS, bit in 0_u32..32, level: bool, stuck: bool, after in 0_u32..40,
    ) {
        let (mut patrol, mut ram) = board();
        (0..after).for_each(|_| { patrol.slice(&mut ram); });
        let address = FREE + 4 * word;
        ram.faults.push(if stuck {
            Fault::Stuck { address, bit, level }
        } else {
            Fault::Transition { address, bit, up: level }
        });
        // One that is under way, and a whole one.
        let most = 2 * slices(RATE.ram_pass_us(4 * FREE_WORDS)) + 2;
        slices_until(&mut patrol, &mut ram, most, |slice| slice.ram_errors > 0);
        slices_until(&mut patrol, &mut ram, most, |slice| slice.ram_pass.is_some_and(|errors| errors > 0));
    }

    #[test]
    fn bits_of_two_words_that_are_coupled_are_found_within_a_pass(
        from in (0..FREE_WORDS, 0_u32..32), to in (0..FREE_WORDS, 0_u32..32), decoder: bool,
    ) {
        prop_assume!(from.0 != to.0);
        let (mut patrol, mut ram) = board();
        let at = |(word, bit): (u32, u32)| (FREE + 4 * word, bit);
        ram.faults.push(if decoder {
            Fault::Decoder { from: at(from).0, to: at(to).0 }
        } else {
            Fault::Coupled { from: at(from), to: at(to) }
        });
        let most = slices(RATE.ram_pass_us(4 * FREE_WORDS)) + 1;
        slices_until(&mut patrol, &mut ram, most, |slice| slice.ram_errors > 0);
    }

    #[test]
    fn bits_of_one_word_that_are_coupled_are_found_within_six_passes(
        word in 0..FREE_WORDS, from in 0_u32..32, to in 0_u32..32,
    ) {
        prop_assume!(from != to);
        let (mut patrol, mut ram) = board();
        let address = FREE + 4 * word;
        ram.faults.push(Fault::Coupled { from: (address, from), to: (address, to) });
        let most = 6 * slices(RATE.ram_pass_us(4 * FREE_WORDS)) + 1;
        slices_until(&mut patrol, &mut ram, most, |slice| slice.ram_errors > 0);
    }
}

#[test]
fn every_two_bits_of_a_word_differ_in_one_of_the_backgrounds() {
    for one in 0..32 {
        for other in 0..one {
            let differ = |background: &u32| background >> one & 1 != background >> other & 1;
            assert!(march::BACKGROUNDS.iter().any(differ), "{one} {other}");
        }
    }
}

#[test]
fn a_restart_begins_both_passes_anew() {
    let (mut patrol, mut ram) = board();
    let flash = IMAGE_WORDS.div_ceil(RATE.flash_words);
    (0..flash - 1).for_each(|_| assert_eq!(patrol.slice(&mut ram).flash, None));
    patrol.restart();
    (0..flash - 1).for_each(|_| assert_eq!(patrol.slice(&mut ram).flash, None));
    assert!(patrol.slice(&mut ram).flash.is_some_and(Comparison::is_intact));
    patrol.restart();
    let pass = slices(RATE.ram_pass_us(4 * FREE_WORDS));
    assert_eq!(slices_until(&mut patrol, &mut ram, pass, |slice| slice.ram_pass.is_some()), pass);
}

#[test]
fn the_work_of_a_slice_does_not_depend_on_what_it_finds() {
    let work = |broken: bool| {
        let (mut patrol, mut ram) = board();
        if broken {
            ram.flip(GUARDS[0], 3);
            ram.flip(CODE, 3);
            ram.flip(IMAGE + 40, 3);
            ram.faults.push(Fault::Stuck { address: FREE, bit: 1, level: true });
        }
        let mut counts = vec![];
        for _ in 0..100 {
            patrol.slice(&mut ram);
            counts.push((ram.loads.get(), ram.stores));
        }
        counts
    };
    assert_eq!(work(true), work(false));
}

#[test]
fn without_code_in_ram_and_without_free_ram_the_rest_is_checked() {
    let (_, mut ram) = board();
    let layout = Layout { code: 0..0, code_load: 0, free: FREE..FREE, ..layout() };
    let mut patrol = Patrol::new(layout, RATE, &mut ram);
    let found = (0..IMAGE_WORDS).filter(|_| patrol.slice(&mut ram).flash.is_some_and(Comparison::is_intact)).count();
    assert_eq!(found as u32, IMAGE_WORDS / IMAGE_WORDS.div_ceil(RATE.flash_words));
}

#[test]
fn slices_come_at_their_rate_however_often_idle_asks_and_what_was_missed_is_made_up_for_within_bounds() {
    let start = u32::MAX - 3_000;
    let mut pace = Pace::new(start);
    let mut done = 0;
    for us in (0..1_000_000).step_by(137) {
        done += pace.due(start.wrapping_add(us));
    }
    assert_eq!(done, 999_963 / SLICE_US);
    assert_eq!(pace.due(start.wrapping_add(1_000_000 + 19 * SLICE_US)), 20);
    let late = start.wrapping_add(50_000_000);
    assert_eq!(pace.due(late), MOST_SLICES);
    assert_eq!(pace.due(late.wrapping_add(SLICE_US - 1)), 0);
    assert_eq!(pace.due(late.wrapping_add(SLICE_US)), 1);
}

#[test]
fn times_to_detect_follow_from_the_rates() {
    // 37 words at 4 a slice are 10 slices; 10 at 3 are 4; 6 times 21 at 7 are 18.
    assert_eq!(RATE.flash_detect_us(4 * IMAGE_WORDS), 22 * SLICE_US);
    assert_eq!(RATE.code_detect_us(4 * CODE_WORDS), 5 * SLICE_US);
    assert_eq!(RATE.ram_pass_us(4 * FREE_WORDS), 18 * SLICE_US);
}
