//! Writes a program's CRC into its ELF file, so that the firmware can check its flash at the start.
//!
//! The linker script `firmware-common/program_crc.x` reserves one word, section `.program_crc`, after everything that
//! is loaded into flash. [`seal`] writes into it the frame CRC of all bytes from the vector table up to that word, most
//! significant byte first. A gap between two sections counts as 0xFF, as erased flash. `firmware_common::program`
//! checks the CRC.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use object::elf::{FileHeader32, PT_LOAD};
use object::read::elf::{FileHeader, ProgramHeader, SectionHeader};
use object::{Endianness, SectionIndex};

const CRC_SECTION: &str = ".program_crc";

const FIRST_SECTION: &str = ".vector_table";

const ERASED: u8 = 0xFF;

const CRC_SIZE: u64 = 4;

/// Bytes that a programmer writes to a board: their address in flash, and their range in the file.
#[derive(Clone, Copy)]
struct Loaded {
    address: u64,
    offset: u64,
    len: u64,
}

impl Loaded {
    const fn end(self) -> u64 {
        self.address + self.len
    }
}

/// # Errors
///
/// A file cannot be read or written, or is not an ELF file that [`seal`] accepts.
pub(crate) fn copy_sealed(from: &Path, to: &Path) -> Result<()> {
    let mut elf = std::fs::read(from).with_context(|| format!("could not read {}", from.display()))?;
    seal(&mut elf).with_context(|| format!("could not give {} its CRC", from.display()))?;
    std::fs::write(to, elf).with_context(|| format!("could not write {}", to.display()))
}

/// Writes the CRC into an ELF file in memory and returns the CRC.
///
/// # Errors
///
/// `elf` is not a 32-bit ELF file with a vector table and one word of `.program_crc` after everything else that is
/// loaded.
pub(crate) fn seal(elf: &mut [u8]) -> Result<u32> {
    let (image, word) = layout(elf)?;
    let crc = profile::crc::frame(&image);
    let field = usize::try_from(word)
        .ok()
        .and_then(|at| elf.get_mut(at..at + CRC_SIZE as usize))
        .context("the CRC's section lies outside of the file")?;
    field.copy_from_slice(&crc.to_be_bytes());
    Ok(crc)
}

/// Returns the bytes in flash from the vector table to the CRC, and the offset of the CRC in the file.
fn layout(elf: &[u8]) -> Result<(Vec<u8>, u64)> {
    let header = FileHeader32::<Endianness>::parse(elf).context("not a 32-bit ELF file")?;
    let endian = header.endian()?;
    let loaded: Vec<Loaded> = header
        .program_headers(endian, elf)?
        .iter()
        .filter(|segment| segment.p_type(endian) == PT_LOAD && segment.p_filesz(endian) > 0)
        .map(|segment| Loaded {
            // The physical address is that in flash, where also the initial values of variables are.
            address: segment.p_paddr(endian).into(),
            offset: segment.p_offset(endian).into(),
            len: segment.p_filesz(endian).into(),
        })
        .collect();
    let sections = header.sections(endian, elf)?;
    let find = |name: &str| -> Result<Loaded> {
        let (_, section): (SectionIndex, _) = sections
            .section_by_name(endian, name.as_bytes())
            .with_context(|| format!("no section {name}: the firmware must be linked with program_crc.x"))?;
        let (offset, len) = (u64::from(section.sh_offset(endian)), u64::from(section.sh_size(endian)));
        let segment = loaded
            .iter()
            .find(|segment| segment.offset <= offset && offset + len <= segment.offset + segment.len)
            .with_context(|| format!("section {name} is not loaded into memory"))?;
        Ok(Loaded { address: segment.address + (offset - segment.offset), offset, len })
    };
    let crc = find(CRC_SECTION)?;
    let first = find(FIRST_SECTION)?.address;
    ensure!(crc.len == CRC_SIZE, "section {CRC_SECTION} has {} bytes instead of {CRC_SIZE}", crc.len);
    ensure!(first % 4 == 0 && crc.address % 4 == 0, "vector table or {CRC_SECTION} is not at a multiple of 4");
    ensure!(first < crc.address, "{CRC_SECTION} lies before the vector table");

    let mut image = vec![ERASED; usize::try_from(crc.address - first)?];
    for segment in &loaded {
        if segment.address < first || segment.end() > crc.end() {
            bail!(
                "{:#x}..{:#x} is loaded, but the CRC covers {first:#x}..{:#x} only",
                segment.address,
                segment.end(),
                crc.address
            );
        }
        let len = usize::try_from(segment.end().min(crc.address).saturating_sub(segment.address))?;
        let to = usize::try_from(segment.address - first)?.min(image.len());
        let from = usize::try_from(segment.offset)?;
        let bytes = elf.get(from..from + len).context("a segment lies outside of the file")?;
        image[to..to + len].copy_from_slice(bytes);
    }
    Ok((image, crc.offset))
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_common::program::Comparison;

    type Part<'a> = (&'a str, u32, &'a [u8]);

    fn elf(parts: &[Part<'_>]) -> Vec<u8> {
        let words = |words: &[u32]| -> Vec<u8> { words.iter().flat_map(|word| word.to_le_bytes()).collect() };
        let halves = |halves: &[u16]| -> Vec<u8> { halves.iter().flat_map(|half| half.to_le_bytes()).collect() };
        let count = parts.len() as u16;
        let body = 52 + 32 * u32::from(count);
        let mut names = b"\0.shstrtab\0".to_vec();
        let mut bytes = vec![];
        let (mut segments, mut sections) = (vec![], vec![0; 40]);
        for &(name, address, content) in parts {
            let (offset, len) = (body + bytes.len() as u32, content.len() as u32);
            // The words of a program header are: type, offset, virtual and physical address, size in file and in
            // memory, flags, alignment.
            segments.extend(words(&[1, offset, address, address, len, len, 5, 4]));
            // The words of a section header are: name, type, flags, address, offset, size, link, info, alignment, entry
            // size.
            sections.extend(words(&[names.len() as u32, 1, 2, address, offset, len, 0, 0, 4, 0]));
            names.extend(name.bytes().chain([0]));
            bytes.extend_from_slice(content);
        }
        let names_at = body + bytes.len() as u32;
        sections.extend(words(&[1, 3, 0, 0, names_at, names.len() as u32, 0, 0, 1, 0]));
        let mut file = b"\x7FELF\x01\x01\x01\0\0\0\0\0\0\0\0\0".to_vec();
        file.extend(halves(&[2, 40]));
        file.extend(words(&[1, 0, 52, names_at + names.len() as u32, 0]));
        file.extend(halves(&[52, 32, count, 40, count + 2, count + 1]));
        [file, segments, bytes, names, sections].concat()
    }

    const VECTORS: [u8; 8] = [0x00, 0x80, 0x00, 0x20, 0x09, 0x04, 0x00, 0x00];
    const CODE: [u8; 6] = [0x70, 0x47, 0x00, 0xBF, 0x12, 0x34];
    const UNSEALED: [u8; 4] = [0xFF; 4];

    fn image() -> Vec<u8> {
        elf(&[(FIRST_SECTION, 0x1000, &VECTORS), (".text", 0x1008, &CODE), (CRC_SECTION, 0x1010, &UNSEALED)])
    }

    fn flash() -> Vec<u8> {
        [&VECTORS[..], &CODE[..], &[0xFF, 0xFF]].concat()
    }

    fn words(bytes: &[u8]) -> impl Iterator<Item = u32> + '_ {
        bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word))
    }

    fn stored(elf: &[u8]) -> u32 {
        let at = layout(elf).unwrap().1 as usize;
        u32::from_le_bytes(elf[at..at + 4].try_into().unwrap())
    }

    #[test]
    fn only_a_sealed_image_passes_the_firmwares_check() {
        let mut elf = image();
        assert!(!Comparison::of(words(&flash()), stored(&elf)).is_intact());
        let crc = seal(&mut elf).unwrap();
        assert_eq!(crc, profile::crc::frame(&flash()));
        let comparison = Comparison::of(words(&flash()), stored(&elf));
        assert_eq!((comparison.computed, comparison.expected), (crc, crc));
    }

    #[test]
    fn sealing_changes_the_crc_alone_and_only_once() {
        let mut elf = image();
        let (_, at) = layout(&elf).unwrap();
        let before = elf.clone();
        seal(&mut elf).unwrap();
        let changed: Vec<usize> = (0..elf.len()).filter(|&i| elf[i] != before[i]).collect();
        assert!(!changed.is_empty() && changed.iter().all(|i| (at as usize..at as usize + 4).contains(i)));
        let once = elf.clone();
        seal(&mut elf).unwrap();
        assert_eq!(elf, once);
    }

    #[test]
    fn every_changed_bit_of_the_image_changes_the_crc() {
        let crc = seal(&mut image()).unwrap();
        for byte in 0..VECTORS.len() + CODE.len() {
            for bit in 0..8 {
                let mut elf = image();
                // The inverted bit is in a section's contents, after the file header and three program headers.
                elf[52 + 3 * 32 + byte] ^= 1 << bit;
                assert_ne!(seal(&mut elf).unwrap(), crc, "byte {byte}, bit {bit}");
            }
        }
    }

    #[test]
    fn the_order_of_the_segments_in_the_file_does_not_matter() {
        let mut elf =
            elf(&[(CRC_SECTION, 0x1010, &UNSEALED), (".text", 0x1008, &CODE), (FIRST_SECTION, 0x1000, &VECTORS)]);
        assert_eq!(seal(&mut elf).unwrap(), profile::crc::frame(&flash()));
    }

    #[test]
    fn an_image_without_the_crc_section_is_refused_with_the_reason() {
        let mut elf = elf(&[(FIRST_SECTION, 0x1000, &VECTORS), (".text", 0x1008, &CODE)]);
        let before = elf.clone();
        let message = format!("{:#}", seal(&mut elf).unwrap_err());
        assert!(message.contains(".program_crc") && message.contains("program_crc.x"), "{message}");
        assert_eq!(elf, before);
    }

    #[test]
    fn what_is_loaded_outside_of_the_range_of_the_crc_is_refused() {
        for outside in [0x0FF0, 0x1014, 0x1000_1208] {
            let mut elf = elf(&[
                (FIRST_SECTION, 0x1000, &VECTORS),
                (CRC_SECTION, 0x1010, &UNSEALED),
                (".outside", outside, &[0x5A, 0, 0, 0]),
            ]);
            let message = format!("{:#}", seal(&mut elf).unwrap_err());
            assert!(message.contains("is loaded, but the CRC covers"), "{message}");
        }
    }

    #[test]
    fn a_truncated_or_foreign_file_is_an_error_and_no_panic() {
        assert!(seal(&mut b"not an ELF file".to_vec()).is_err());
        let whole = image();
        for len in 0..whole.len() {
            assert!(seal(&mut whole[..len].to_vec()).is_err(), "cut after {len} bytes");
        }
    }

    #[test]
    fn a_crc_section_of_another_size_is_refused() {
        let mut elf = elf(&[(FIRST_SECTION, 0x1000, &VECTORS), (CRC_SECTION, 0x1008, &[0xFF; 8])]);
        assert!(format!("{:#}", seal(&mut elf).unwrap_err()).contains("8 bytes instead of 4"));
    }
}
