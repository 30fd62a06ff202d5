//! The two CRC-32 of the profile.
use ::crc::{Algorithm, Crc, Table};

/// Frame CRC: Koopman 0xF8C9140A, Hamming distance 8 over a 56-byte payload (paper, section 2.3).
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

/// Position CRC: Koopman 0x9D7F97D6, Hamming distance 9 over latitude and longitude (paper, section 2.3).
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

/// What the frame register holds (before the final XOR) after one pass over an intact object, its CRC included.
pub const FRAME_RESIDUE: u32 = 0x9D18_E2E0;

/// What the position register holds (before the final XOR) after one pass over latitude, longitude and their CRC.
pub const POSITION_RESIDUE: u32 = 0x3C13_9B22;

static FRAME_TABLE: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&FRAME);
static POSITION_TABLE: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&POSITION);

/// Frame CRC of `bytes`. Stored most significant byte first.
#[must_use]
pub fn frame(bytes: &[u8]) -> u32 {
    FRAME_TABLE.checksum(bytes)
}

/// Position CRC of `bytes`. Stored most significant byte first.
#[must_use]
pub fn position(bytes: &[u8]) -> u32 {
    POSITION_TABLE.checksum(bytes)
}

/// Whether `bytes`, of which the last four are a frame CRC, are intact: one pass, one comparison.
#[must_use]
pub fn frame_intact(bytes: &[u8]) -> bool {
    frame(bytes) ^ FRAME.xorout == FRAME_RESIDUE
}

/// Whether `bytes`, of which the last four are a position CRC, are intact: one pass, one comparison.
#[must_use]
pub fn position_intact(bytes: &[u8]) -> bool {
    position(bytes) ^ POSITION.xorout == POSITION_RESIDUE
}
