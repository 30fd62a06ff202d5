//! Replaces a constant that a program's code loads. The constant is found by its value and not by its address.
//!
//! | covered | not covered |
//! |---|---|
//! | MOVW; MOVW and MOVT in a row, or with one 16-bit instruction between | the halves farther apart |
//! | MOV with a modified immediate | MOVS and other 8-bit immediates |
//! | ADD and ORR with one, which set a field, if the new value is a modified immediate too | other arithmetic |
//! | an aligned word, between the code or in a table | a word that is put together at run time |

use cortex_m4::Cost;

use super::{Repair, seal};
use emulator_node::{Board, Error, Node};

/// Replaces the constant `of` by `value` in every instruction and table entry of `node`'s program, and corrects the
/// program's CRC.
///
/// # Errors
///
/// [`Error::NoSymbol`] if the program has no vector table, no CRC, or no such constant.
#[inline(never)]
pub(super) fn replace<B: Board, C: Cost>(node: &mut Node<B, C>, of: u32, value: u32) -> Result<Repair, Error> {
    let (first, end) = (node.address_of("__vector_table")?, node.address_of("__program_crc")?);
    let mut image = vec![0; usize::try_from(end.saturating_sub(first)).unwrap_or(0)];
    node.read(first, &mut image)?;
    let places = replaced(&image, of, value);
    if places.is_empty() {
        let firmware = node.firmware().name().to_owned();
        return Err(Error::NoSymbol { firmware, symbol: format!("for the constant {of:#x}") });
    }
    let mut repair = Repair::default();
    for (offset, bytes) in places {
        repair.0.extend(Repair::after_writing(node, first + offset as u64, &bytes)?.0);
    }
    repair.0.extend(seal(node)?.0);
    Ok(repair)
}

fn replaced(image: &[u8], of: u32, value: u32) -> Vec<(usize, Vec<u8>)> {
    let half = |at: usize| image.get(2 * at..2 * at + 2).map(|bytes| u16::from_le_bytes([bytes[0], bytes[1]]));
    let pair = |at| half(at).zip(half(at + 1));
    let mut places = vec![];
    let mut put = |at: usize, (one, two): (u16, u16)| {
        places.push((2 * at, [one.to_le_bytes(), two.to_le_bytes()].concat()));
    };
    for at in 0..image.len() / 2 {
        let Some(here) = pair(at) else { break };
        let register = here.1 >> 8 & 0xF;
        let top = (at + 2..=at + 3).find(|&at| pair(at).is_some_and(|it| is_half(it, MOVT, register)));
        if is_half(here, MOVW, register) && immediate(here) == of as u16 {
            match top {
                Some(top) if pair(top).map(immediate) == Some((of >> 16) as u16) => {
                    put(at, encoded(MOVW, register, value as u16));
                    put(top, encoded(MOVT, register, (value >> 16) as u16));
                }
                None if of <= 0xFFFF && value <= 0xFFFF => put(at, encoded(MOVW, register, value as u16)),
                _ => {}
            }
        } else if here.0 & 0xFBFF == MOV && here.1 & 0x8000 == 0 && expanded(here) == of && value <= 0xFFFF {
            put(at, encoded(MOVW, register, value as u16));
        } else if is_field(here)
            && expanded(here) == of
            && let Some((one, two)) = modified(value)
        {
            put(at, (here.0 & 0xFBFF | one, here.1 & 0x8F00 | two));
        } else if at % 2 == 0 && u32::from(here.0) | u32::from(here.1) << 16 == of {
            put(at, (value as u16, (value >> 16) as u16));
        }
    }
    places
}

/// The first halfwords of the instructions that load a constant: MOVW (MOV in encoding T3), MOVT and MOV (encoding T2),
/// ARMv7-M ARM A7.7.76 and A7.7.79.
const MOVW: u16 = 0xF240;
const MOVT: u16 = 0xF2C0;
const MOV: u16 = 0xF04F;

/// Whether the instruction is ORR or ADD in encoding T3 (A7.7.91, A7.7.3), and not MOV or CMN, which share their codes.
const fn is_field((one, two): (u16, u16)) -> bool {
    let without = one & 0xF == 0xF || two >> 8 & 0xF == 0xF;
    matches!(one & 0xFBE0, 0xF040 | 0xF100) && two & 0x8000 == 0 && !without
}

fn is_half((one, two): (u16, u16), opcode: u16, register: u16) -> bool {
    one & 0xFBF0 == opcode && two & 0x8000 == 0 && two >> 8 & 0xF == register
}

fn immediate((one, two): (u16, u16)) -> u16 {
    (one & 0xF) << 12 | (one >> 10 & 1) << 11 | (two >> 12 & 7) << 8 | two & 0xFF
}

fn encoded(opcode: u16, register: u16, value: u16) -> (u16, u16) {
    (opcode | (value >> 11 & 1) << 10 | value >> 12, (value >> 8 & 7) << 12 | register << 8 | value & 0xFF)
}

/// Returns the bits of both halfwords that encode `value` as a modified immediate; `None` if none do.
fn modified(value: u32) -> Option<(u16, u16)> {
    let bits = |code: u16| ((code >> 11 & 1) << 10, (code >> 8 & 7) << 12 | code & 0xFF);
    (0..0x1000).map(bits).find(|bits| expanded(*bits) == value)
}

fn expanded((one, two): (u16, u16)) -> u32 {
    let (rotation, byte) = ((one >> 10 & 1) << 4 | two >> 11 & 0xE | two >> 7 & 1, u32::from(two & 0xFF));
    match rotation {
        0 | 1 => byte,
        2 | 3 => byte << 16 | byte,
        4 | 5 => byte << 24 | byte << 8,
        6 | 7 => byte << 24 | byte << 16 | byte << 8 | byte,
        _ => (byte | 0x80).rotate_right(u32::from(rotation)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(halves: &[u16]) -> Vec<u8> {
        halves.iter().flat_map(|half| half.to_le_bytes()).collect()
    }

    #[test]
    fn a_constant_of_16_bits_is_replaced_in_a_movw() {
        // The code is MOVW r1, #24480.
        let image = image(&[0xBF00, 0xF645, 0x71A0]);
        assert_eq!(replaced(&image, 24_480, 24_481), [(2, vec![0x45, 0xF6, 0xA1, 0x71])]);
        assert!(replaced(&image, 24_481, 0).is_empty());
    }

    #[test]
    fn a_constant_of_32_bits_is_replaced_in_movw_and_movt() {
        let of = 0x0004_C4A0;
        let (low, high) = (encoded(MOVW, 1, 0xC4A0), encoded(MOVT, 1, 4));
        let code = image(&[low.0, low.1, 0xBF00, high.0, high.1]);
        let (to_low, to_high) = (encoded(MOVW, 1, 0xFCC0), encoded(MOVT, 1, 6));
        let wanted = [(0, image(&[to_low.0, to_low.1])), (6, image(&[to_high.0, to_high.1]))];
        assert_eq!(replaced(&code, of, 0x0006_FCC0), wanted);
        assert!(replaced(&code, 0xC4A0, 1).is_empty());
    }

    #[test]
    fn a_constant_is_found_in_a_modified_immediate() {
        // The code is MOV.W r3, #0x4400.
        let (one, two) = encoded(MOVW, 3, 0x4401);
        assert_eq!(replaced(&image(&[0xF44F, 0x4388]), 0x4400, 0x4401), [(0, image(&[one, two]))]);
    }

    #[test]
    fn a_modified_immediate_is_replaced_in_an_add_or_orr() {
        // The code is ADD.W r1, r1, #0x4400; ORR r2, r6, #0x4400; CMN.W r1, #0x4400.
        let code = image(&[0xF501, 0x4188, 0xF446, 0x4288, 0xF511, 0x4F88]);
        let wanted = [(0, image(&[0xF501, 0x418A])), (4, image(&[0xF446, 0x428A]))];
        assert_eq!(replaced(&code, 0x4400, 0x4500), wanted);
        // No modified immediate can encode 0x4401.
        assert!(replaced(&code, 0x4400, 0x4401).is_empty());
    }

    #[test]
    fn a_constant_is_found_as_an_aligned_word() {
        let table = image(&[0, 0, 0xC4A0, 4, 0]);
        assert_eq!(replaced(&table, 0x0004_C4A0, 7), [(4, vec![7, 0, 0, 0])]);
        assert!(replaced(&table, 0xC4A0_0000, 7).is_empty());
    }
}
