//! The instructions of a firmware image, found without executing it.
//!
//! The symbols `$t` and `$d` tell code from the data between it (AAELF32, "mapping symbols"). Bytes that lie in no
//! function are padding, and so is a `NOP` that execution cannot reach from the instruction before it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context, Result, ensure};
use cortex_m4::coverage::{Flow, conditional, flow};
use object::{Object, ObjectSection, ObjectSymbol, SectionKind, SymbolKind};

/// `NOP`, with which the compiler fills gaps.
const NOP: u16 = 0xBF00;

/// An instruction of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Instruction {
    /// Its size in bytes.
    pub(super) size: u32,
    pub(super) flow: Flow,
    /// Whether it is in an IT block, so that its condition can fail.
    pub(super) in_block: bool,
    /// Its function, as an index of [`Image::functions`].
    pub(super) function: usize,
    /// The targets of a jump by a table.
    pub(super) table: Vec<u32>,
}

/// A function of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Function {
    pub(super) name: String,
    pub(super) start: u32,
    pub(super) end: u32,
}

/// The code of an image, at the addresses at which it runs.
#[derive(Debug, Default)]
pub(super) struct Image {
    /// The areas that hold code, each with its address and its bytes.
    pub(super) areas: Vec<(u32, Vec<u8>)>,
    /// The functions, in order of their addresses.
    pub(super) functions: Vec<Function>,
    /// Each instruction by its address.
    pub(super) code: BTreeMap<u32, Instruction>,
    /// The address of the program's CRC, 0 if the image has none.
    pub(super) program_crc: u32,
    /// The address of the RAM that the firmware's test of RAM begins with, 0 if the image names none.
    pub(super) ram: u32,
    /// An address in each part of [`KEPT`].
    pub(super) kept: Vec<u32>,
    /// The address of a guard word, 0 if the image has none.
    pub(super) guard: u32,
    /// The end of the code that runs from RAM, 0 if the image has none.
    pub(super) hot: u32,
    /// The variable with the state of the task that receives frames: its address and its end; 0 if there is none.
    pub(super) receiver: [u32; 2],
    /// The functions whose address data or an instruction holds, so that a register may call them.
    pub(super) known: BTreeSet<u32>,
    /// The ELF file.
    pub(super) elf: Vec<u8>,
}

/// Parts of the names of what HORUS keeps and checks, and in how many parts it checks each: the state of its cycle, the
/// solutions of three receivers, the receivers' states, and the count of ticks.
const KEPT: [(&str, u32); 4] =
    [("shared_resource_cycle", 1), ("shared_resource_solutions", 3), ("local_resource_receivers", 1), ("5TICKS", 1)];

/// How far behind its beginning a kept value is upset, bytes.
const INSIDE: u32 = 20;

impl Image {
    /// Reads the ELF file at `path`.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let elf = std::fs::read(path).with_context(|| format!("{} cannot be read", path.display()))?;
        Self::parse(elf).with_context(|| format!("{} has no code to measure", path.display()))
    }

    fn parse(elf: Vec<u8>) -> Result<Self> {
        let file = object::File::parse(&*elf)?;
        let mut areas = Vec::new();
        for section in file.sections() {
            if section.kind() == SectionKind::Text && section.size() > 0 {
                areas.push((u32::try_from(section.address())?, section.data()?.to_vec()));
            }
        }
        let mut marks = Vec::new();
        let mut functions = Vec::new();
        let mut image = Self::default();
        for symbol in file.symbols() {
            let (Ok(name), address) = (symbol.name(), u32::try_from(symbol.address())?) else { continue };
            match name.split('.').next() {
                Some("$t") => marks.push((address, true)),
                Some("$d") => marks.push((address, false)),
                Some("__program_crc") => image.program_crc = address,
                Some("_stack_end") => image.ram = address,
                Some("__guard_data") => image.guard = address,
                Some("__ehot") => image.hot = address,
                Some(name) if name.ends_with("__rtic_internal_shared_resource_receiver") => {
                    image.receiver = [address, address + u32::try_from(symbol.size())?];
                }
                _ if symbol.kind() == SymbolKind::Data => {
                    for (_, parts) in KEPT.into_iter().filter(|(kept, _)| name.contains(kept)) {
                        let part = u32::try_from(symbol.size())? / parts;
                        image.kept.extend((0..parts).map(|nth| address + nth * part + INSIDE.min(part / 2)));
                    }
                }
                _ if symbol.kind() == SymbolKind::Text && symbol.size() > 0 => {
                    let (start, size) = (address & !1, u32::try_from(symbol.size())?);
                    let name = format!("{:#}", rustc_demangle::demangle(name));
                    functions.push(Function { name, start, end: start + size });
                }
                _ => {}
            }
        }
        marks.sort_unstable();
        functions.sort_by(|a, b| (a.start, &a.name).cmp(&(b.start, &b.name)));
        functions.dedup_by_key(|function| function.start);
        (image.areas, image.functions) = (areas, functions);
        image.decode(&marks);
        let loaded = [SectionKind::Text, SectionKind::Data, SectionKind::ReadOnlyData];
        for section in file.sections().filter(|section| loaded.contains(&section.kind())) {
            image.know_addresses_in(section.data()?);
        }
        drop(file);
        ensure!(!image.code.is_empty(), "no function in it has symbols");
        Ok(Self { elf, ..image })
    }

    /// Makes an image of one function at `start`, for a test.
    #[cfg(test)]
    pub(super) fn of(start: u32, code: &[u16], data: &[u32]) -> Self {
        let bytes: Vec<u8> = code.iter().flat_map(|half| half.to_le_bytes()).collect();
        let end = start + bytes.len() as u32;
        let function = Function { name: "all".to_owned(), start, end };
        let mut image = Self { areas: vec![(start, bytes)], functions: vec![function], ..Self::default() };
        let marks = std::iter::once(start).chain(data.iter().copied()).zip([true, false].into_iter().cycle());
        image.decode(&marks.collect::<Vec<_>>());
        image
    }

    /// The address of the function of this name, 0 if there is none.
    pub(super) fn start_of(&self, name: &str) -> u32 {
        self.functions.iter().find(|function| function.name == name).map_or(0, |function| function.start)
    }

    /// Notes each function whose address, with bit 0 set, is in `bytes`: as a word, or as the low half in a `MOVW`.
    fn know_addresses_in(&mut self, bytes: &[u8]) {
        let halves: Vec<u32> = bytes.as_chunks().0.iter().map(|half| u16::from_le_bytes(*half).into()).collect();
        let mut words = BTreeSet::new();
        let mut lows = BTreeSet::new();
        for pair in halves.windows(2) {
            let (first, second) = (pair[0], pair[1]);
            words.insert(second << 16 | first);
            // MOVW, encoding T3 (ARMv7-M ARM A7.7.76).
            if first & 0xFBF0 == 0xF240 && second & 0x8000 == 0 {
                lows.insert((first & 15) << 12 | (first >> 10 & 1) << 11 | (second >> 12 & 7) << 8 | second & 0xFF);
            }
        }
        let starts = self.functions.iter().map(|function| function.start);
        self.known
            .extend(starts.filter(|start| words.contains(&(start | 1)) || lows.contains(&((start | 1) & 0xFFFF))));
    }

    /// The halfword at `address`, if there is code.
    fn half(&self, address: u32) -> Option<u16> {
        self.areas.iter().find_map(|(start, bytes)| {
            let bytes = bytes.get(address.checked_sub(*start)? as usize..)?;
            bytes.first_chunk().map(|bytes| u16::from_le_bytes(*bytes))
        })
    }

    /// The function that has `address`, as an index.
    fn function_at(&self, address: u32) -> Option<usize> {
        let index = self.functions.partition_point(|function| function.start <= address).checked_sub(1)?;
        (address < self.functions[index].end).then_some(index)
    }

    /// Decodes the code that `marks` tell, each an address and whether instructions begin there, or data.
    fn decode(&mut self, marks: &[(u32, bool)]) {
        let mut found = BTreeMap::new();
        for (index, &(from, code)) in marks.iter().enumerate().filter(|(_, (_, code))| *code) {
            debug_assert!(code);
            let end = marks[index + 1..].iter().map(|(next, _)| *next).find(|next| *next > from).unwrap_or(u32::MAX);
            let (mut address, mut block, mut reached) = (from, 0, true);
            while address < end
                && let Some(first) = self.half(address)
            {
                let (size, flow) = flow(address, first, self.half(address + 2).unwrap_or(0));
                let (in_block, rest) = conditional(block);
                block = if let Flow::Block(state) = flow { state } else { rest };
                let table = if let Flow::Table(half) = flow { self.table(address + size, half, marks) } else { vec![] };
                if let Some(function) = self.function_at(address).filter(|_| reached || first != NOP) {
                    found.insert(address, Instruction { size, flow, in_block, function, table });
                    reached = in_block || !matches!(flow, Flow::To(_) | Flow::Elsewhere | Flow::Stop | Flow::Table(_));
                }
                address += size;
            }
        }
        self.code = found;
    }

    /// The targets in the table at `start`. The table ends where code begins again.
    fn table(&self, start: u32, halves: bool, marks: &[(u32, bool)]) -> Vec<u32> {
        let end = marks.iter().find(|(address, code)| *code && *address > start).map_or(start, |(address, _)| *address);
        let entry = |address: u32| {
            let half = self.half(address & !1)?;
            Some(start + 2 * u32::from(if halves { half } else { half.to_le_bytes()[address as usize & 1].into() }))
        };
        let mut targets: Vec<u32> = (start..end).step_by(1 + usize::from(halves)).filter_map(entry).collect();
        targets.retain(|target| *target >= end);
        targets
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn code_is_told_from_data_and_from_padding() {
        // b to the code behind the data; nop, which is padding; data; nop, which is reached; bx lr.
        let image = Image::of(0x100, &[0xE003, 0xBF00, 0xD1FD, 0xD1FD, 0xBF00, 0x4770], &[0x104, 0x108]);
        assert_eq!(image.code.keys().copied().collect::<Vec<_>>(), [0x100, 0x108, 0x10A]);
        assert_eq!(image.code[&0x100].flow, Flow::To(0x10A));
    }

    #[test]
    fn the_instructions_of_a_block_are_conditional_and_those_behind_are_not() {
        // cmp r0, #1; ite eq; moveq r1, #7; movne r1, #9; bx lr.
        let image = Image::of(0x100, &[0x2801, 0xBF0C, 0x2107, 0x2109, 0x4770], &[]);
        let in_block: Vec<_> = image.code.values().map(|instruction| instruction.in_block).collect();
        assert_eq!(in_block, [false, false, true, true, false]);
    }

    #[test]
    fn an_address_is_known_from_a_word_and_from_a_movw() {
        // The function is at 0x8100. movw r0, #0x8101 is F248 1001.
        let known = |bytes: &[u8]| {
            let mut image = Image::of(0x8100, &[0x4770], &[]);
            image.know_addresses_in(bytes);
            image.known.contains(&0x8100)
        };
        assert!(known(&[0x01, 0x81, 0, 0]) && known(&[0, 0, 0x01, 0x81, 0, 0]));
        assert!(known(&[0x48, 0xF2, 0x01, 0x10]));
        assert!(!known(&[0x00, 0x81, 0, 0]) && !known(&[0x48, 0xF2, 0x03, 0x10]));
    }

    #[test]
    fn a_file_without_functions_is_refused() {
        assert!(Image::parse(b"no ELF".to_vec()).is_err());
    }
}
