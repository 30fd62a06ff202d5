//! Builds ELF files for the tests.

use crate::thumb::FLASH;

pub(crate) const ET_EXEC: u16 = 2;
pub(crate) const EM_ARM: u16 = 40;

pub(crate) fn elf(kind: u16, machine: u16, segments: &[(u64, Vec<u8>)], symbols: &[(&str, u32)]) -> Vec<u8> {
    const HEADER: usize = 52;
    const PROGRAM_HEADER: usize = 32;
    const SECTION_HEADER: u32 = 40;
    let mut headers = Vec::new();
    let mut body = Vec::new();
    let data = HEADER + PROGRAM_HEADER * segments.len();
    let at = |body: &Vec<u8>| u32::try_from(data + body.len()).unwrap();
    let words = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
    for (address, bytes) in segments {
        let (address, length) = (u32::try_from(*address).unwrap(), u32::try_from(bytes.len()).unwrap());
        headers.extend(words(&[1, at(&body), address, address, length, length, 5, 4]));
        body.extend(bytes);
    }
    let mut names = vec![0];
    let symbol_table = at(&body);
    body.extend([0; 16]);
    for (name, address) in symbols {
        // The symbol is global and absolute (SHN_ABS, 0xFFF1).
        body.extend(words(&[u32::try_from(names.len()).unwrap(), *address, 4, 0xFFF1_0011]));
        names.extend(name.bytes().chain([0]));
    }
    let (symbols_end, names_at) = (at(&body), at(&body));
    body.extend(&names);
    let sections = at(&body);
    let size = u32::try_from(names.len()).unwrap();
    body.extend([0; SECTION_HEADER as usize]);
    body.extend(words(&[0, 2, 0, 0, symbol_table, symbols_end - symbol_table, 2, 1, 4, 16]));
    body.extend(words(&[0, 3, 0, 0, names_at, size, 0, 0, 1, 0]));
    let mut file = b"\x7FELF\x01\x01\x01\0\0\0\0\0\0\0\0\0".to_vec();
    file.extend([kind, machine].iter().flat_map(|half| half.to_le_bytes()));
    file.extend(words(&[1, FLASH, u32::try_from(HEADER).unwrap(), sections, 0x0500_0400]));
    let halves = [HEADER, PROGRAM_HEADER, segments.len(), 40, 3, 2].map(|half| u16::try_from(half).unwrap());
    file.extend(halves.iter().flat_map(|half| half.to_le_bytes()));
    file.extend(headers);
    file.extend(body);
    file
}
