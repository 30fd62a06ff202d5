//! Source lines of instructions, and what the sources say of lines that are not covered.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use addr2line::gimli;
use anyhow::{Context, Result};
use object::{Object, ObjectSection};

use super::image::Image;
use crate::workspace::root;

/// A line of a source of this workspace.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Place {
    pub(super) file: String,
    pub(super) line: u32,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.file, self.line)
    }
}

/// Where an instruction comes from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Origin {
    /// The lines of this workspace, from the innermost inlined function to the outermost. Empty for code of libraries.
    pub(super) places: Vec<Place>,
    /// Whether it belongs to the logger, whose code is inlined where a message is written.
    pub(super) logs: bool,
}

/// Returns the origin of each instruction, by its address.
pub(super) fn origins(image: &Image) -> Result<BTreeMap<u32, Origin>> {
    let file = object::File::parse(&*image.elf)?;
    let load = |section: gimli::SectionId| -> Result<Cow<'_, [u8]>, gimli::Error> {
        let section = file.section_by_name(section.name());
        Ok(section.and_then(|section| section.uncompressed_data().ok()).unwrap_or_default())
    };
    let sections = gimli::DwarfSections::load(load)?;
    let dwarf = sections.borrow(|section| gimli::EndianSlice::new(section, gimli::LittleEndian));
    let lines = addr2line::Context::from_dwarf(dwarf).context("the debug information cannot be read")?;
    let root = format!("{}/", root().display());
    let mut origins = BTreeMap::new();
    for &address in image.code.keys() {
        let mut origin = Origin::default();
        let mut frames = lines.find_frames(u64::from(address)).skip_all_loads()?;
        while let Some(frame) = frames.next()? {
            let Some((file, line)) = frame.location.and_then(|place| Some((place.file?, place.line?))) else {
                continue;
            };
            origin.logs |= file.contains("/defmt");
            if let Some(file) = file.strip_prefix(&root).filter(|file| !file.starts_with("target/")) {
                origin.places.push(Place { file: file.to_owned(), line });
            }
        }
        origins.insert(address, origin);
    }
    Ok(origins)
}

/// What the comments of one source say about its lines.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Source {
    /// The lines of calls of the logger's macros.
    pub(super) logs: BTreeSet<u32>,
    /// Each explanation: its own line, the lines that it explains, and the reason.
    pub(super) explained: Vec<(u32, std::ops::RangeInclusive<u32>, String)>,
}

/// The beginning of a comment that explains why the item, statement or arm below it is not covered.
const EXPLANATION: &str = "// Not covered: ";

/// Reads a source. An explanation stands on lines of its own above the statement, arm or item that it explains, which
/// ends where its brackets close.
pub(super) fn read(text: &str) -> Source {
    let lines: Vec<&str> = text.lines().collect();
    let mut source = Source::default();
    for (index, line) in lines.iter().enumerate() {
        let number = index as u32 + 1;
        if let Some(reason) = line.trim_start().strip_prefix(EXPLANATION) {
            let more = lines[index + 1..].iter().map_while(|line| line.trim_start().strip_prefix("// "));
            let more: Vec<&str> = more.collect();
            let from = index + 1 + more.len();
            let reason = std::iter::once(reason).chain(more).collect::<Vec<_>>().join(" ");
            source.explained.push((number, from as u32 + 1..=end_of(&lines, from), reason));
        }
        if line.contains("defmt::") && line.contains("!(") {
            source.logs.extend(number..=end_of(&lines, index));
        }
    }
    source
}

/// The number of the line, from 1, on which the brackets close that are opened from line `from` (counted from 0) on.
fn end_of(lines: &[&str], from: usize) -> u32 {
    let mut depth = 0_i32;
    for (index, line) in lines.iter().enumerate().skip(from) {
        let code = line.split("//").next().unwrap_or(line);
        depth += code.chars().filter(|letter| "([{".contains(*letter)).count() as i32;
        depth -= code.chars().filter(|letter| ")]}".contains(*letter)).count() as i32;
        // An attribute belongs to the item below it.
        if depth <= 0 && !code.trim_start().starts_with("#[") && !code.trim().is_empty() {
            return index as u32 + 1;
        }
    }
    lines.len() as u32
}
