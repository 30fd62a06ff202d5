//! The record of excluded receivers, which is kept over a reset
//!
//! # Design
//!
//! Without this record, a wrong receiver would have a vote again after every reset by the watchdog, until it is
//! outvoted anew. If another receiver is missing, it may not be outvoted. So after each vote the mask of the excluded
//! receivers is written into memory that the start-up code does not initialise, with the number of receivers and a
//! frame CRC.
//!
//! A start after power-on destroys the record (`hw::start_up`). After any other reset, the receivers of the mask have
//! to agree for a second before they return (decision 15). A record counts as empty if it is not intact, if a program
//! with another number of receivers wrote it, or if no vote can lead to its mask
//! ([`Voter::excluding`](horus_voter::Voter::excluding)).

use profile::{crc, ResetReason};

use crate::RECEIVERS;

/// The number of words in a record.
pub const WORDS: usize = 2;

/// Returns the record of the receivers whose bits in `excluded` are set; bit 0 is GPS1.
#[must_use]
pub fn to_words(excluded: u8) -> [u32; WORDS] {
    let record = u32::from(excluded) | (RECEIVERS as u32) << 8;
    [record, crc::frame_of_words([record].into_iter())]
}

/// Returns the receivers that `words` record as excluded: none after power-on, or if `words` are not a valid record.
#[must_use]
pub fn from_words(words: [u32; WORDS], reason: ResetReason) -> u8 {
    let [excluded, ..] = words[0].to_le_bytes();
    let is_kept = words == to_words(excluded) && reason != ResetReason::PowerOn;
    if is_kept {
        excluded
    } else {
        0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Shows VOTE-9.
    #[test]
    fn what_was_written_is_read_after_every_reset_but_power_on() {
        for excluded in 0..=u8::MAX {
            let words = to_words(excluded);
            for reason in [ResetReason::Pin, ResetReason::Watchdog, ResetReason::Lockup, ResetReason::Software] {
                assert_eq!(from_words(words, reason), excluded);
            }
            assert_eq!(from_words(words, ResetReason::BrownOutOrOther), excluded);
            assert_eq!(from_words(words, ResetReason::PowerOn), 0);
        }
    }

    #[test]
    fn a_record_with_any_bit_changed_is_none() {
        for bit in 0..64 {
            let mut words = to_words(0b0000_0100);
            words[bit / 32] ^= 1 << (bit % 32);
            assert_eq!(from_words(words, ResetReason::Watchdog), 0, "bit {bit}");
        }
        for words in [[0; WORDS], [u32::MAX; WORDS]] {
            assert_eq!(from_words(words, ResetReason::Watchdog), 0);
        }
    }

    #[test]
    fn a_record_that_begins_with_the_flags_of_power_on_is_invalid() {
        for excluded in 0..=u8::MAX {
            for flags in [0x0E00_0000, 0x0E00_0003, 0xFF00_0003] {
                assert_eq!(from_words([flags, to_words(excluded)[1]], ResetReason::Watchdog), 0, "{flags:#x}");
            }
        }
    }

    #[test]
    fn a_record_of_another_number_of_receivers_is_none() {
        let record = 0b0000_0001 | (RECEIVERS as u32 + 1) << 8;
        let words = [record, crc::frame_of_words([record].into_iter())];
        assert_eq!(from_words(words, ResetReason::Watchdog), 0);
    }
}
