//! The wire format written a second time, as plainly as possible: offsets are numbers, CRCs are computed bit by bit.
//! Only the type of the results is the crate's own.
use profile::Rejection;

pub(crate) const FRAME: u32 = 0xF192_2815;
pub(crate) const POSITION: u32 = 0x3AFF_2FAD;

/// The CRC register after `bytes`, from 0xFFFFFFFF, before the final XOR.
pub(crate) fn register(polynomial: u32, bytes: &[u8]) -> u32 {
    let mut register = 0xFFFF_FFFF_u32;
    for byte in bytes {
        for bit in (0..8).rev() {
            let feedback = (register >> 31) ^ u32::from(byte >> bit & 1);
            register = (register << 1) ^ (feedback * polynomial);
        }
    }
    register
}

pub(crate) fn crc(polynomial: u32, bytes: &[u8]) -> u32 {
    !register(polynomial, bytes)
}

fn seals(polynomial: u32, bytes: &[u8], at: usize) -> bool {
    bytes[at..at + 4] == crc(polynomial, &bytes[..at]).to_be_bytes()
}

pub(crate) fn object(bytes: &[u8], size: usize, identifier: u16) -> Option<Rejection> {
    if bytes.len() != size {
        Some(Rejection::Length)
    } else if !seals(FRAME, bytes, size - 4) {
        Some(Rejection::Crc)
    } else if identifier == 0x4800 && !seals(POSITION, &bytes[8..28], 16) {
        Some(Rejection::PositionCrc)
    } else if bytes[4..6] != identifier.to_le_bytes() {
        Some(Rejection::Identifier)
    } else {
        None
    }
}

/// Returns the reason why `bytes` are not object number `index` of a profile; `None` if they are.
pub(crate) fn object_of_profile(bytes: &[u8], index: usize) -> Option<Rejection> {
    let size = if index == 0 { 64 } else { 60 };
    object(bytes, size, 0x4800 + u16::try_from(index).unwrap())
}

pub(crate) fn repair(bytes: &mut [u8], index: usize) {
    let identifier = 0x4800 + u16::try_from(index).unwrap();
    bytes[4..6].copy_from_slice(&identifier.to_le_bytes());
    if index == 0 {
        let position = crc(POSITION, &bytes[8..24]);
        bytes[24..28].copy_from_slice(&position.to_be_bytes());
    }
    repair_frame_crc(bytes);
}

pub(crate) fn repair_frame_crc(bytes: &mut [u8]) {
    let at = bytes.len() - 4;
    let frame = crc(FRAME, &bytes[..at]);
    bytes[at..].copy_from_slice(&frame.to_be_bytes());
}

/// Returns `bytes` with these bits inverted. Bit 0 is sent first: it is the most significant bit of byte 0.
pub(crate) fn flipped(bytes: &[u8], bits: impl IntoIterator<Item = usize>) -> Vec<u8> {
    let mut damaged = bytes.to_vec();
    for bit in bits {
        damaged[bit / 8] ^= 0x80 >> (bit % 8);
    }
    damaged
}

pub(crate) fn places(n: usize) -> Vec<std::ops::Range<usize>> {
    let gps = (1..=n).map(|receiver| 4 + 60 * receiver..64 + 60 * receiver);
    std::iter::once(0..64).chain(gps).collect()
}

/// The frames of a profile of `n` receivers: the first object, the number of objects and the number of bytes of each.
pub(crate) fn frames(n: usize) -> &'static [(usize, usize, usize)] {
    match n {
        1 => &[(0, 2, 124)],
        2 => &[(0, 3, 184)],
        3 => &[(0, 4, 244)],
        5 => &[(0, 3, 184), (3, 3, 180)],
        _ => unreachable!("no such profile"),
    }
}
