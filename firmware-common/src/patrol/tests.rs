use super::*;
use proptest::prelude::*;
use std::collections::BTreeMap;

const PROGRAM: u32 = 0x0800_0000;
const PROGRAM_WORDS: u32 = 37;
const CODE: u32 = 0x0080_0000;
const CODE_WORDS: u32 = 10;
const USED: u32 = 0x2000_8000;
const USED_WORDS: u32 = 40;
/// The ranges of words, from [`USED`] on, that the test leaves out: two that touch, one of a few words, one at the end.
const APART_WORDS: [Range<u32>; 4] = [20..22, 5..9, 9..10, 38..40];
/// The bytes to leave out lie inside one word, so that the whole word is left out.
const APART_BYTES: Range<u32> = USED + 4 * 30 + 1..USED + 4 * 30 + 2;
const GUARDS: [u32; guard::COUNT] = [0x2000_0000, 0x2000_1000, 0x2000_1010, 0x2000_1020, 0x2000_1030];
const SHUT: u32 = 5;
const RATE: Rate = Rate { flash_words: 4, code_words: 3, ram_words: 7 };

/// A fault of one bit of a word.
#[derive(Clone, Copy, Debug)]
enum Fault {
    /// The bit always has this level.
    Stuck { address: u32, bit: u32, level: bool },
    /// The bit takes no 1 once it is 0, or no 0 once it is 1.
    Transition { address: u32, bit: u32, up: bool },
    /// When the first bit changes to 1, the second bit changes too.
    Coupled { from: (u32, u32), to: (u32, u32) },
}

#[derive(Clone, Debug, Default)]
struct Ram {
    words: BTreeMap<u32, u32>,
    faults: Vec<Fault>,
    stores: u32,
    loads: std::cell::Cell<u32>,
    exercised: std::collections::BTreeSet<u32>,
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
                _ => {}
            }
        }
    }
}

impl Memory for Ram {
    fn load(&self, address: u32) -> u32 {
        self.loads.set(self.loads.get() + 1);
        assert!(!(PROGRAM..PROGRAM + 4 * SHUT).contains(&address), "this is shut: {address:#x}");
        self.words.get(&address).copied().unwrap_or_else(|| panic!("nothing is at {address:#x}"))
    }
    fn load_shut(&self, address: u32) -> u32 {
        self.loads.set(self.loads.get() + 1);
        assert!((PROGRAM..PROGRAM + 4 * SHUT).contains(&address), "this is not shut: {address:#x}");
        self.words[&address]
    }
    fn store(&mut self, address: u32, word: u32) {
        self.stores += 1;
        let mine = GUARDS.iter().any(|guard| (*guard..guard + 8).contains(&address));
        assert!(mine, "no guard: {address:#x}");
        self.put(address, word);
    }
    /// The accesses have the order of [`crate::memory::exercise`], which the bench tests with stuck bits.
    fn exercise(&mut self, address: u32) -> u32 {
        let pair = [address, address + 4];
        assert!(
            pair.iter().all(|word| (USED..USED + 4 * USED_WORDS).contains(word) && !is_apart(*word)),
            "{address:#x}"
        );
        let found = pair.map(|word| self.load(word));
        let mut wrong = 0;
        for (word, found) in [(0, found), (1, found), (1, found.map(|it| !it)), (0, found.map(|it| !it))] {
            wrong |= self.load(pair[word]) ^ found[word];
            self.put(pair[word], !found[word]);
        }
        self.exercised.extend(pair);
        wrong | (self.load(pair[0]) ^ found[0]) | (self.load(pair[1]) ^ found[1])
    }
}

fn is_apart(address: u32) -> bool {
    APART_WORDS.iter().any(|words| words.contains(&((address - USED) / 4))) || address == APART_BYTES.start & !3
}

/// Returns the words of RAM that are tested: those that are not left out and have a neighbour to be tested with.
fn tested() -> Vec<u32> {
    let is_in = |word: u32| word < USED_WORDS && !is_apart(USED + 4 * word);
    (0..USED_WORDS).filter(|&word| is_in(word) && (is_in(word + 1) || word > 0 && is_in(word - 1))).collect()
}

fn apart() -> [Range<u32>; ram::APART] {
    let mut apart = [const { 0..0 }; ram::APART];
    for (to, words) in apart.iter_mut().skip(2).zip(APART_WORDS) {
        *to = USED + 4 * words.start..USED + 4 * words.end;
    }
    apart[ram::APART - 1] = APART_BYTES;
    apart
}

fn layout() -> Layout {
    Layout {
        program: PROGRAM..PROGRAM + 4 * PROGRAM_WORDS,
        shut_end: PROGRAM + 4 * SHUT,
        code: CODE..CODE + 4 * CODE_WORDS,
        code_load: PROGRAM + 4 * 12,
        guards: GUARDS,
        used: USED..USED + 4 * USED_WORDS,
        apart: apart(),
    }
}

fn board() -> (Patrol, Ram) {
    let mut ram = Ram::default();
    let program: Vec<u32> = (0..PROGRAM_WORDS).map(|word| word.wrapping_mul(0x0123_4567) ^ 0xDEAD_BEEF).collect();
    for (address, word) in (PROGRAM..).step_by(4).zip(&program) {
        ram.words.insert(address, *word);
    }
    let crc = profile::crc::frame_of_words(program.iter().copied());
    ram.words.insert(PROGRAM + 4 * PROGRAM_WORDS, crc.swap_bytes());
    for word in 0..CODE_WORDS {
        ram.words.insert(CODE + 4 * word, program[12 + word as usize]);
    }
    for word in 0..USED_WORDS {
        ram.words.insert(USED + 4 * word, word.wrapping_mul(0x9E37_79B9));
    }
    (Patrol::new(layout(), RATE, &mut ram), ram)
}

/// Does slices of the patrol until `found` returns true, at most `most` of them, and returns their number.
fn slices_until(patrol: &mut Patrol, ram: &mut Ram, most: u32, mut found: impl FnMut(&Slice) -> bool) -> u32 {
    (1..=most).find(|_| found(&patrol.slice(ram))).unwrap_or_else(|| panic!("not found within {most} slices"))
}

fn slices(us: u32) -> u32 {
    us / SLICE_US
}

#[test]
fn sound_memory_passes_round_after_round_and_is_left_as_it_was() {
    let (mut patrol, mut ram) = board();
    let before = ram.words.clone();
    let (mut flash, mut passes) = (0, 0);
    for _ in 0..500 {
        let slice = patrol.slice(&mut ram);
        assert_eq!((slice.code, slice.guard, slice.ram), (None, None, None));
        flash += u32::from(slice.flash.is_some_and(Comparison::is_intact));
        assert!(slice.flash.is_none_or(Comparison::is_intact));
        passes += u32::from(slice.ram_pass.is_some());
        assert!(slice.ram_pass.is_none_or(|sound| sound));
    }
    assert_eq!(flash, 500 / PROGRAM_WORDS.div_ceil(RATE.flash_words));
    // A pass over the 40 words takes at most 40 steps, and a slice has seven steps.
    assert!(passes >= 500 * RATE.ram_words / USED_WORDS, "{passes}");
    assert_eq!(ram.words, before);
}

#[test]
fn a_pass_tests_every_word_in_use_but_those_left_out() {
    let (mut patrol, mut ram) = board();
    let most = slices(RATE.ram_pass_us(4 * USED_WORDS));
    slices_until(&mut patrol, &mut ram, most, |slice| slice.ram_pass.is_some());
    let words: Vec<u32> = ram.exercised.iter().map(|address| (address - USED) / 4).collect();
    assert_eq!(words, tested());
    assert_eq!(words.len(), 30, "a word between two that are left out is not tested");
}

proptest! {
    // Shows SAFE-4.
    #[test]
    fn a_bit_of_flash_that_flips_is_found_in_time(
        word in 0..=PROGRAM_WORDS, bit in 0_u32..32, after in 0_u32..40,
    ) {
        let (mut patrol, mut ram) = board();
        (0..after).for_each(|_| { patrol.slice(&mut ram); });
        ram.flip(PROGRAM + 4 * word, bit);
        let most = slices(RATE.flash_detect_us(4 * PROGRAM_WORDS));
        slices_until(&mut patrol, &mut ram, most, |slice| slice.flash.is_some_and(|found| !found.is_intact()));
        ram.flip(PROGRAM + 4 * word, bit);
        slices_until(&mut patrol, &mut ram, most, |slice| slice.flash.is_some_and(Comparison::is_intact));
    }

    // Shows SAFE-6.
    #[test]
    fn a_bit_of_code_in_ram_that_flips_is_found_in_time(
        word in 0..CODE_WORDS, bit in 0_u32..32, after in 0_u32..40,
    ) {
        let (mut patrol, mut ram) = board();
        (0..after).for_each(|_| { patrol.slice(&mut ram); });
        ram.flip(CODE + 4 * word, bit);
        let most = slices(RATE.code_detect_us(4 * CODE_WORDS));
        slices_until(&mut patrol, &mut ram, most, |slice| slice.code == Some(CODE + 4 * word));
    }

    // Shows SAFE-7.
    #[test]
    fn a_guard_that_changes_is_found_by_the_next_slice(
        which in 0..guard::COUNT, word in 0_u32..2, bit in 0_u32..32, after in 0_u32..40,
    ) {
        let (mut patrol, mut ram) = board();
        (0..after).for_each(|_| { patrol.slice(&mut ram); });
        ram.flip(GUARDS[which] + 4 * word, bit);
        prop_assert_eq!(patrol.slice(&mut ram).guard, Some(which as u32));
    }

    // Shows SAFE-5.
    #[test]
    fn a_faulty_bit_of_ram_is_found_within_a_pass(
        word in prop::sample::select(tested()), bit in 0_u32..32, level: bool, stuck: bool, after in 0_u32..40,
    ) {
        let (mut patrol, mut ram) = board();
        (0..after).for_each(|_| { patrol.slice(&mut ram); });
        let address = USED + 4 * word;
        ram.faults.push(if stuck {
            Fault::Stuck { address, bit, level }
        } else {
            Fault::Transition { address, bit, up: level }
        });
        let most = slices(RATE.ram_pass_us(4 * USED_WORDS));
        let mut found = None;
        slices_until(&mut patrol, &mut ram, most, |slice| { found = found.or(slice.ram); slice.ram.is_some() });
        prop_assert!((address - 4..=address).contains(&found.unwrap()));
        slices_until(&mut patrol, &mut ram, most, |slice| slice.ram_pass == Some(false));
        ram.faults.clear();
        slices_until(&mut patrol, &mut ram, 2 * most, |slice| slice.ram_pass == Some(true));
    }

    #[test]
    fn bits_of_neighbouring_words_that_are_coupled_are_found_within_a_pass(
        word in 10_u32..19, bits in (0_u32..32, 0_u32..32), up: bool,
    ) {
        let (mut patrol, mut ram) = board();
        let [one, other] = [USED + 4 * word, USED + 4 * word + 4];
        let (from, to) = if up { (one, other) } else { (other, one) };
        ram.faults.push(Fault::Coupled { from: (from, bits.0), to: (to, bits.1) });
        let most = slices(RATE.ram_pass_us(4 * USED_WORDS));
        slices_until(&mut patrol, &mut ram, most, |slice| slice.ram.is_some());
    }
}

#[test]
fn a_restart_begins_both_passes_anew() {
    let (mut patrol, mut ram) = board();
    let flash = PROGRAM_WORDS.div_ceil(RATE.flash_words);
    (0..flash - 1).for_each(|_| assert_eq!(patrol.slice(&mut ram).flash, None));
    patrol.restart();
    (0..flash - 1).for_each(|_| assert_eq!(patrol.slice(&mut ram).flash, None));
    assert!(patrol.slice(&mut ram).flash.is_some_and(Comparison::is_intact));
    patrol.restart();
    let pass = |patrol: &mut Patrol, ram: &mut Ram| slices_until(patrol, ram, 9, |slice| slice.ram_pass.is_some());
    let whole = pass(&mut patrol, &mut ram);
    patrol.slice(&mut ram);
    patrol.restart();
    assert_eq!(pass(&mut patrol, &mut ram), whole);
}

#[test]
fn the_work_of_a_slice_does_not_depend_on_what_it_finds() {
    let work = |broken: bool| {
        let (mut patrol, mut ram) = board();
        if broken {
            ram.flip(GUARDS[0], 3);
            ram.flip(CODE, 3);
            ram.flip(PROGRAM + 40, 3);
            ram.faults.push(Fault::Stuck { address: USED, bit: 1, level: true });
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
fn the_patrol_checks_the_rest_without_code_in_ram() {
    let (_, mut ram) = board();
    let layout = Layout { code: 0..0, code_load: 0, used: USED..USED, ..layout() };
    let mut patrol = Patrol::new(layout, RATE, &mut ram);
    let found = (0..PROGRAM_WORDS).filter(|_| patrol.slice(&mut ram).flash.is_some_and(Comparison::is_intact)).count();
    assert_eq!(found as u32, PROGRAM_WORDS / PROGRAM_WORDS.div_ceil(RATE.flash_words));
}

#[test]
fn slices_keep_their_rate_and_missed_ones_are_made_up_for() {
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
    // A pass over flash has 37 words at 4 a slice, so 10 slices; over code 10 words at 3, so 4 slices; over RAM 40
    // words at 7, so 6 slices.
    assert_eq!(RATE.flash_detect_us(4 * PROGRAM_WORDS), 22 * SLICE_US);
    assert_eq!(RATE.code_detect_us(4 * CODE_WORDS), 5 * SLICE_US);
    assert_eq!(RATE.ram_pass_us(4 * USED_WORDS), 7 * SLICE_US);
}
