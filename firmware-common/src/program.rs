//! Verifies whether the program in flash is the one that was built.
//!
//! # Design
//!
//! The linker script `program_crc.x` puts one word after all that is loaded into flash: vector table, code, constants,
//! and the initial values of variables. `cargo xtask build` writes into it the frame CRC ([`profile::crc::FRAME`]) of
//! all bytes before it, most significant byte first. A gap between two sections counts as erased flash, 0xFF. Each
//! firmware verifies the CRC before its work starts. The program with its CRC is a codeword, so every burst of up to 32
//! wrong bits is found, and other damage except in one case of 2^32.
//!
//! If the build has written no CRC, the word for the CRC is 0xFFFFFFFF, and the program does not pass.

#[cfg(target_os = "none")]
use crate::memory;

/// The word for the program's CRC. This crate defines it, so every firmware that links the crate has it once.
#[cfg(target_os = "none")]
#[allow(unsafe_code)] // The attribute names a section, which the compiler cannot check: it is that of `program_crc.x`.
#[used]
#[link_section = ".program_crc"]
static PROGRAM_CRC: u32 = u32::MAX;

/// The result of comparing the program's CRC with the CRC that the build wrote.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Comparison {
    /// The frame CRC that was computed over the program in flash.
    pub computed: u32,
    /// The frame CRC that the build wrote.
    pub expected: u32,
}

impl Comparison {
    /// Compares the CRC of the program's `words`, in the byte order of the processor, with the CRC that the build
    /// stored.
    pub fn of(words: impl Iterator<Item = u32>, stored: u32) -> Self {
        Self { computed: profile::crc::frame_of_words(words), expected: stored.swap_bytes() }
    }

    /// Whether the program is the one that was built.
    #[must_use]
    pub const fn is_intact(self) -> bool {
        self.computed == self.expected
    }
}

/// Compares the CRC of the running program. This takes about 14 processor cycles a byte. To be called before the memory
/// protection unit denies access to the vector table.
#[cfg(target_os = "none")]
#[must_use]
pub fn compare() -> Comparison {
    Comparison::of(memory::program().step_by(4).map(memory::load), memory::stored_crc())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn words(bytes: &[u8]) -> impl Iterator<Item = u32> + '_ {
        bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word))
    }

    fn sealed(bytes: &[u8]) -> u32 {
        u32::from_le_bytes(profile::crc::frame(bytes).to_be_bytes())
    }

    proptest! {
        #[test]
        fn a_program_passes_as_it_was_built_and_with_no_bit_changed(
            words_of_program in prop::collection::vec(any::<u32>(), 1..200), at: prop::sample::Index, bit in 0_u32..32,
        ) {
            let mut bytes: Vec<u8> = words_of_program.iter().flat_map(|word| word.to_le_bytes()).collect();
            let stored = sealed(&bytes);
            prop_assert!(Comparison::of(words(&bytes), stored).is_intact());
            prop_assert!(!Comparison::of(words(&bytes), stored ^ 1 << bit).is_intact());
            let at = at.index(bytes.len());
            bytes[at] ^= 1 << (bit % 8);
            prop_assert!(!Comparison::of(words(&bytes), stored).is_intact());
        }
    }

    #[test]
    fn a_program_that_the_build_did_not_seal_does_not_pass() {
        assert!(!Comparison::of([0x2000_8000, 0x0000_0401].into_iter(), u32::MAX).is_intact());
    }

    #[test]
    fn the_program_with_its_crc_most_significant_byte_first_is_a_codeword() {
        let mut bytes = *b"a program, of whole words, it is\0\0\0\0";
        let stored = sealed(&bytes[..32]);
        bytes[32..].copy_from_slice(&stored.to_le_bytes());
        assert!(profile::crc::frame_intact(&bytes));
        assert!(Comparison::of(words(&bytes[..32]), stored).is_intact());
    }
}
