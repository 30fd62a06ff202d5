//! The profile's two CRC-32, and the reasons for their byte order.
//!
//! **Polynomials** are the paper's (section 2.3), in Koopman's notation: the frame CRC 0xF8C9140A with Hamming distance
//! 8, the position CRC 0x9D7F97D6 with Hamming distance 9. The paper states the first distance for 56 bytes of payload;
//! it also holds for the 60 bytes of Reported-Position. This crate's tests prove both by exhaustion. Koopman's notation
//! leaves out the lowest coefficient, which is always 1; the usual notation leaves out the highest. The `crc` crate,
//! [`FRAME`] and [`POSITION`] use the usual notation: 0xF1922815 and 0x3AFF2FAD. With Koopman's numbers that crate
//! would compute other, untested polynomials. Round-trip tests would still pass; only the check values reveal the
//! mistake.
//!
//! **Start value and final XOR 0xFFFFFFFF.** If both were 0, a buffer scrubbed to 0x00 would be a codeword wherever an
//! object lies in it. With 0xFFFFFFFF, neither 0x00 nor 0xFF throughout is a codeword at the length of any object.
//! (Eight bytes of 0xFF are a codeword, the only length at which this happens; see [`ssi`](crate::ssi).)
//!
//! **Most significant byte first.** NFC-F sends each byte's most significant bit first, and these CRCs are not
//! reflected. So an object with a big-endian CRC field is a codeword in the order in which its bits are sent. Every
//! burst of up to 32 bits is then detected; with a little-endian field, bursts of 28 bits across the payload's end
//! would not be. One pass over the whole object with its CRC also ends in a [fixed residue](FRAME_RESIDUE), so
//! [`frame_intact`] is one pass and one comparison.
//!
//! **The frame CRC uses four tables of 256 words** (`FourTables`, 4 KiB of flash), so that one step processes four
//! bytes. On a Cortex-M4 that takes about 20 cycles instead of 32. Both boards check every object and their flash with
//! this CRC. The position CRC covers only 20 bytes of a profile, so it has one table (1 KiB).
//!
//! A CRC takes the same number of operations for any data of one length. Its processor cycles may still vary with the
//! misses of a cache before the flash, such as the STM32F4's ART accelerator (RM0090, section 3).
use ::crc::{Algorithm, Crc, Table};

/// The frame CRC, which closes every object: Koopman 0xF8C9140A, Hamming distance 8 over any object (paper, section
/// 2.3).
pub const FRAME: Algorithm<u32> = Algorithm {
    width: 32,
    poly: 0xF192_2815,
    init: 0xFFFF_FFFF,
    refin: false,
    refout: false,
    xorout: 0xFFFF_FFFF,
    check: 0x12D3_A0B1,
    residue: FRAME_RESIDUE,
};

/// The position CRC over Reported-Position's latitude and longitude: Koopman 0x9D7F97D6, Hamming distance 9 over those
/// 16 bytes (paper, section 2.3).
pub const POSITION: Algorithm<u32> = Algorithm {
    width: 32,
    poly: 0x3AFF_2FAD,
    init: 0xFFFF_FFFF,
    refin: false,
    refout: false,
    xorout: 0xFFFF_FFFF,
    check: 0xEA87_07AB,
    residue: POSITION_RESIDUE,
};

/// The register of the frame CRC after one pass over an intact object and its CRC, before the final XOR.
pub const FRAME_RESIDUE: u32 = 0x9D18_E2E0;

/// The register of the position CRC after one pass over latitude, longitude and their intact CRC, before the final XOR.
pub const POSITION_RESIDUE: u32 = 0x3C13_9B22;

// The tables are a static, because a constant would be copied into every function that uses them.
static FRAME_TABLE: FourTables = FourTables::new(&FRAME);
static POSITION_TABLE: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&POSITION);

/// The tables of a 32-bit CRC that is not reflected. Entry `b` of table number `n` is the CRC register, starting from
/// 0, after byte `b` and `n` bytes 0x00.
struct FourTables([[u32; 256]; 4]);

#[expect(clippy::indexing_slicing, reason = "a table has an entry for each value of a byte, which every index is")]
impl FourTables {
    #[expect(clippy::as_conversions, reason = "u32::from is no const fn; the value is below 256")]
    const fn new(algorithm: &Algorithm<u32>) -> Self {
        let mut tables = [[0; 256]; 4];
        let mut byte = 0;
        while byte < 256 {
            let mut register = (byte as u32) << 24;
            let mut bit = 0;
            while bit < 32 {
                let carry = register >> 31;
                register = (register << 1) ^ (carry * algorithm.poly);
                bit += 1;
                if bit % 8 == 0 {
                    tables[bit / 8 - 1][byte] = register;
                }
            }
            byte += 1;
        }
        Self(tables)
    }

    fn update(&self, mut register: u32, bytes: &[u8]) -> u32 {
        let [behind_0, behind_1, behind_2, behind_3] = &self.0;
        let (words, rest) = bytes.as_chunks();
        // Not covered: only this line, in the copies for the objects of a frame, a number of words or a rest that their
        // reads do not bring: each object has a constant size, and only the first read of a frame has a varying length,
        // since the DPR may begin it late.
        for word in words {
            let [first, second, third, fourth] = (register ^ u32::from_be_bytes(*word)).to_be_bytes().map(usize::from);
            register = behind_3[first] ^ behind_2[second] ^ behind_1[third] ^ behind_0[fourth];
        }
        // Not covered: only this line, a rest of bytes in the copies for the objects of a frame, as above.
        for &byte in rest {
            let [first, ..] = register.to_be_bytes();
            register = (register << 8) ^ behind_0[usize::from(first ^ byte)];
        }
        register
    }
}

/// The frame CRC of `bytes`, to be stored most significant byte first.
///
/// ```
/// assert_eq!(profile::crc::frame(b"123456789"), 0x12D3_A0B1);
/// ```
#[must_use]
pub fn frame(bytes: &[u8]) -> u32 {
    FRAME_TABLE.update(FRAME.init, bytes) ^ FRAME.xorout
}

/// The frame CRC of words in the order of their addresses. Each word counts as its bytes in a little-endian memory.
///
/// ```
/// let words = [u32::from_le_bytes(*b"1234"), u32::from_le_bytes(*b"5678")];
/// assert_eq!(profile::crc::frame_of_words(words.into_iter()), profile::crc::frame(b"12345678"));
/// ```
#[must_use]
pub fn frame_of_words(words: impl Iterator<Item = u32>) -> u32 {
    frame_of_words_after(0, words)
}

/// Continues the frame CRC `crc` over `words` and returns the result. A `crc` of 0 stands for no data before them.
///
/// ```
/// use profile::crc::{frame_of_words, frame_of_words_after};
///
/// let words = [0x1234_5678, 0x9ABC_DEF0, 0];
/// let first = frame_of_words(words[..1].iter().copied());
/// assert_eq!(frame_of_words_after(first, words[1..].iter().copied()), frame_of_words(words.into_iter()));
/// ```
#[must_use]
pub fn frame_of_words_after(crc: u32, words: impl Iterator<Item = u32>) -> u32 {
    // Not covered: only this line, the end of the loop before the first word: no caller has an empty range. The
    // compiler has inlined this into each check of flash, RAM and images.
    let register = words.fold(crc ^ FRAME.xorout, |register, word| FRAME_TABLE.update(register, &word.to_le_bytes()));
    register ^ FRAME.xorout
}

/// The position CRC of `bytes`, to be stored most significant byte first.
///
/// ```
/// assert_eq!(profile::crc::position(b"123456789"), 0xEA87_07AB);
/// ```
#[must_use]
pub fn position(bytes: &[u8]) -> u32 {
    POSITION_TABLE.checksum(bytes)
}

/// The state of a frame CRC over an object of which the bytes arrive in pieces.
///
/// ```
/// use profile::crc::Begun;
///
/// let codeword = *b"123456789\x12\xD3\xA0\xB1";
/// let mut begun = Begun::NOTHING;
/// begun.follow(&codeword[..5]);
/// begun.follow(&codeword[..11]);
/// assert_eq!(begun.bytes(), 11);
/// assert!(begun.is_intact(&codeword));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Begun {
    register: u32,
    bytes: u16,
}

impl Begun {
    /// The state before the first byte.
    pub const NOTHING: Self = Self { register: FRAME.init, bytes: 0 };

    /// The number of bytes that the CRC covers so far.
    #[must_use]
    pub fn bytes(&self) -> usize {
        usize::from(self.bytes)
    }

    /// Extends the CRC to all of `bytes`, the part of an object that has been received so far. `bytes` begin with those
    /// that the CRC already covers, and are shorter than 64 KiB.
    pub fn follow(&mut self, bytes: &[u8]) {
        let Ok(there) = u16::try_from(bytes.len()) else { return };
        // Not covered: only this line, the limit of the slice and the empty slice: each caller gives at least as many
        // bytes as before, since a frame's bytes only become more.
        let register = FRAME_TABLE.update(self.register, bytes.get(self.bytes()..).unwrap_or(&[]));
        *self = Self { register, bytes: self.bytes.max(there) };
    }

    /// Whether the object `bytes` is intact by the frame CRC in its last four bytes. The bytes that this CRC already
    /// covers must be the beginning of `bytes`.
    #[must_use]
    pub fn is_intact(mut self, bytes: &[u8]) -> bool {
        self.follow(bytes);
        self.register == FRAME_RESIDUE
    }
}

/// Whether `bytes` are intact by the frame CRC in their last four bytes.
///
/// Fewer than four bytes are never intact. Four zeros are intact, because 0 is the CRC of no data.
///
/// ```
/// use profile::crc;
///
/// let mut codeword = *b"123456789\x12\xD3\xA0\xB1";
/// assert!(crc::frame_intact(&codeword));
/// codeword[12] ^= 1;
/// assert!(!crc::frame_intact(&codeword));
/// ```
#[must_use]
pub fn frame_intact(bytes: &[u8]) -> bool {
    frame(bytes) ^ FRAME.xorout == FRAME_RESIDUE
}

/// Whether words in the order of their addresses are intact, as [`frame_intact`] says of their bytes.
///
/// ```
/// use profile::crc;
///
/// let words = [u32::from_le_bytes(*b"1234"), crc::frame(b"1234").swap_bytes()];
/// assert!(crc::frame_of_words_intact(words.into_iter()));
/// assert!(!crc::frame_of_words_intact([0x3433_3230, words[1]].into_iter()));
/// ```
#[must_use]
pub fn frame_of_words_intact(words: impl Iterator<Item = u32>) -> bool {
    frame_of_words(words) ^ FRAME.xorout == FRAME_RESIDUE
}

/// Whether `bytes` are intact by the position CRC in their last four bytes.
///
/// Fewer than four bytes are never intact. Four zeros are intact, because 0 is the CRC of no data.
#[must_use]
pub fn position_intact(bytes: &[u8]) -> bool {
    position(bytes) ^ POSITION.xorout == POSITION_RESIDUE
}
