//! Keeps lock, set-point and acknowledged commands over each reset that leaves the RAM powered.
//!
//! There are two records, which are written in turn. Each has a number and a CRC; the newer of the intact records
//! counts. A command is executed by writing the next record, which holds the effect of the command and its
//! acknowledgement. If a reset interrupts the write, the record before still counts: the command was not executed, and
//! its writer repeats it. So a reset at any instant lets each command be executed once.
//!
//! After power-on neither record is intact, except by a chance of 1 in 2^32.

use core::sync::atomic::{AtomicU32, Ordering};

use profile::hold::{Acknowledged, Outcome};

use crate::climate::DEFAULT_SET_POINT;

/// The words of a record: number, lock, set-point, both acknowledgements, CRC.
pub const WORDS: usize = 6;

/// The memory of both records.
pub type Memory = [[AtomicU32; WORDS]; 2];

/// The values that a record keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kept {
    /// Whether the hold is locked.
    pub locked: bool,
    /// The set-point, °C.
    pub set_point: f32,
    /// The acknowledgements of the base station's and of the flight controller's last command.
    pub acknowledged: [Acknowledged; 2],
}

impl Default for Kept {
    /// Returns the state after power-on: locked, with the default set-point and no acknowledged command.
    fn default() -> Self {
        Self { locked: true, set_point: DEFAULT_SET_POINT, acknowledged: [Acknowledged::default(); 2] }
    }
}

/// Writes the records that outlive a reset.
#[derive(Debug)]
pub struct Keeper {
    memory: &'static Memory,
    /// The number of the newest record. Its lowest bit is the index of the record in memory.
    number: u32,
}

impl Keeper {
    /// Returns the keeper of `memory` and what the newest intact record holds; `None` after power-on.
    #[must_use]
    pub fn take(memory: &'static Memory) -> (Self, Option<Kept>) {
        let [even, odd] = memory.each_ref().map(read);
        let newest = match (even, odd) {
            (Some((even, _)), Some((number, _))) if number.wrapping_sub(even).cast_signed() > 0 => odd,
            (Some(_), _) => even,
            (None, odd) => odd,
        };
        (Self { memory, number: newest.map_or(0, |(number, _)| number) }, newest.map(|(_, kept)| kept))
    }

    /// Writes `kept` into the older record, which becomes the newest.
    pub fn keep(&mut self, kept: &Kept) {
        self.number = self.number.wrapping_add(1);
        let [base_station, flight_controller] = kept
            .acknowledged
            .map(|acknowledged| u32::from(acknowledged.number()) << 16 | u32::from(acknowledged.code()));
        let mut words =
            [self.number, u32::from(kept.locked), kept.set_point.to_bits(), base_station, flight_controller, 0];
        words[WORDS - 1] = check_word(&words);
        for (to, from) in self.memory[self.number as usize % 2].iter().zip(words) {
            to.store(from, Ordering::Relaxed);
        }
    }
}

/// Returns the number and the contents of a record if its CRC is right.
fn read(record: &[AtomicU32; WORDS]) -> Option<(u32, Kept)> {
    let words = record.each_ref().map(|word| word.load(Ordering::Relaxed));
    let [number, locked, set_point, base_station, flight_controller, check] = words;
    let acknowledged = [base_station, flight_controller].map(|word| {
        let outcome = match word & 0xFFFF {
            1 => Outcome::Done,
            2 => Outcome::Refused,
            3 => Outcome::Unknown,
            4 => Outcome::TooOld,
            _ => Outcome::Nothing,
        };
        Acknowledged::new((word >> 16) as u16, outcome)
    });
    let kept = Kept { locked: locked != 0, set_point: f32::from_bits(set_point), acknowledged };
    (check == check_word(&words)).then_some((number, kept))
}

fn check_word(words: &[u32; WORDS]) -> u32 {
    profile::crc::frame_of_words(words.iter().take(WORDS - 1).copied())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn memory(fill: u32) -> &'static Memory {
        Box::leak(Box::new([[(); WORDS]; 2].map(|record| record.map(|()| AtomicU32::new(fill)))))
    }

    fn kept(number: u16) -> Kept {
        let outcomes = [Outcome::Done, Outcome::Refused, Outcome::Unknown, Outcome::TooOld];
        let outcome = outcomes[usize::from(number) % outcomes.len()];
        Kept {
            locked: number.is_multiple_of(3),
            set_point: f32::from(number),
            acknowledged: [Acknowledged::new(number, outcome), Acknowledged::new(number + 7, Outcome::Refused)],
        }
    }

    #[test]
    fn nothing_is_kept_from_memory_after_power_on() {
        for fill in [0, u32::MAX, 0x5A5A_5A5A] {
            assert_eq!(Keeper::take(memory(fill)).1, None);
        }
    }

    #[test]
    fn the_last_record_counts_after_any_number_of_them() {
        let (first, memory) = (memory(0), memory(0));
        for number in 1..9 {
            Keeper::take(first).0.keep(&kept(number));
            assert_eq!(Keeper::take(first).1, Some(kept(number)));
        }
        let mut keeper = Keeper { memory, number: u32::MAX - 2 };
        for number in 1..9 {
            keeper.keep(&kept(number));
            assert_eq!(Keeper::take(memory).1, Some(kept(number)), "the numbers wrap");
        }
    }

    #[test]
    fn a_record_that_a_reset_cuts_off_leaves_the_one_before() {
        for whole in 0..WORDS {
            let (memory, after) = (memory(0), memory(0));
            for number in [1, 2] {
                Keeper::take(memory).0.keep(&kept(number));
                Keeper::take(after).0.keep(&kept(number));
            }
            Keeper::take(after).0.keep(&kept(3));
            for (to, from) in memory.iter().flatten().zip(after.iter().flatten()).skip(WORDS).take(whole) {
                to.store(from.load(Ordering::Relaxed), Ordering::Relaxed);
            }
            assert_eq!(Keeper::take(memory).1, Some(kept(2)), "{whole} words");
        }
    }

    #[test]
    fn a_flipped_bit_makes_a_record_worthless() {
        for bit in 0..32 * WORDS {
            let memory = memory(0);
            let mut keeper = Keeper::take(memory).0;
            keeper.keep(&kept(1));
            keeper.keep(&kept(2));
            memory[0][bit / 32].fetch_xor(1 << (bit % 32), Ordering::Relaxed);
            assert_eq!(Keeper::take(memory).1, Some(kept(1)), "bit {bit}");
        }
    }
}
