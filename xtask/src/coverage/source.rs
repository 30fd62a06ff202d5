//! Source lines of instructions, and what the sources say of lines that are not covered.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::ops::RangeInclusive;

use addr2line::gimli;
use anyhow::{Context, Result};
use object::{Object, ObjectSection};

use super::image::Image;
use crate::workspace::root;

/// Which copy of a locked section an instruction belongs to.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Lock {
    /// The lines of this workspace that lock, from the innermost to the outermost.
    pub(super) site: Vec<Place>,
    /// Whether the priority is raised.
    pub(super) raises: bool,
}

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
    /// The names of the functions that are inlined here.
    pub(super) inlined: Vec<String>,
    /// Whether it belongs to the logger, whose code is inlined where a message is written.
    pub(super) logs: bool,
    /// The file of the innermost function if it is one of a library, inlined or not; else empty.
    pub(super) library: String,
    /// The copy of a locked section that it belongs to.
    pub(super) lock: Option<Lock>,
}

impl Origin {
    /// This origin, or `before` if the compiler names no line: it does so for a copy between registers and what else it
    /// adds between two lines.
    fn or_that_before(self, before: Option<Self>) -> Self {
        let is_known = !self.places.is_empty() || !self.library.is_empty() || self.logs;
        before.filter(|_| !is_known).unwrap_or(self)
    }
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
    let mut before: Option<(usize, Origin)> = None;
    for (&address, instruction) in &image.code {
        let mut origin = Origin::default();
        let mut frames = lines.find_frames(u64::from(address)).skip_all_loads()?;
        let mut names: Vec<String> = vec![];
        while let Some(frame) = frames.next()? {
            names.extend(frame.function.as_ref().and_then(|name| {
                let name = name.raw_name().ok()?;
                Some(format!("{:#}", rustc_demangle::demangle(&name)))
            }));
            let Some((file, line)) = frame.location.and_then(|place| Some((place.file?, place.line?))) else {
                continue;
            };
            origin.logs |= file.contains("/defmt");
            if let Some(raises) = names.last().and_then(|function| raises(file, function, line)) {
                // The outermost lock counts, so the lines that lock begin anew.
                origin.lock = Some(Lock { site: vec![], raises });
            }
            let own = file.strip_prefix(&root).filter(|file| !file.starts_with("target/"));
            if origin.places.is_empty() && origin.library.is_empty() && own.is_none() {
                origin.library = file.to_owned();
            }
            if let Some(file) = own {
                let place = Place { file: file.to_owned(), line };
                origin.lock.iter_mut().for_each(|lock| lock.site.push(place.clone()));
                origin.places.push(place);
            }
        }
        // The outermost function is that of the image's symbol.
        names.pop();
        origin.inlined = names;
        let function = instruction.function;
        before = Some((function, origin.or_that_before(before.filter(|(of, _)| *of == function).map(|it| it.1))));
        origins.extend(before.iter().map(|(_, origin)| (address, origin.clone())));
    }
    Ok(origins)
}

/// What the comments of one source say about its lines.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Source {
    /// The lines of calls of the logger's macros.
    pub(super) logs: BTreeSet<u32>,
    pub(super) explained: Vec<Explanation>,
}

/// A comment that says why lines are not covered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Explanation {
    /// The comment's own line.
    pub(super) at: u32,
    /// The lines that it explains.
    pub(super) lines: RangeInclusive<u32>,
    /// Whether it explains only the first of these lines, and nothing that is inlined there.
    pub(super) alone: bool,
    /// Whether these lines are a whole function.
    pub(super) function: bool,
}

impl Explanation {
    /// Whether it explains code of `line`, which is the innermost line of its instruction if `innermost`.
    pub(super) fn explains(&self, line: u32, innermost: bool) -> bool {
        if self.alone { innermost && line == *self.lines.start() } else { self.lines.contains(&line) }
    }
}

/// The beginning of a comment that explains why the item, statement or arm below it is not covered.
const EXPLANATION: &str = "// Not covered: ";

/// What follows it if only the line below is meant, such as a condition without what depends on it.
const ALONE: &str = "only this line, ";

/// Reads a source. An explanation stands on lines of its own above the statement, arm or item that it explains, which
/// ends where its brackets close.
pub(super) fn read(text: &str) -> Source {
    let lines: Vec<&str> = text.lines().collect();
    let mut source = Source::default();
    for (index, line) in lines.iter().enumerate() {
        let number = index as u32 + 1;
        if let Some(reason) = line.trim_start().strip_prefix(EXPLANATION) {
            let more = lines[index + 1..].iter().take_while(|line| line.trim_start().starts_with("//"));
            let from = index + 1 + more.count();
            let function =
                lines[from..].iter().find(|line| !line.trim_start().starts_with("#[")).is_some_and(is_function);
            let (lines, alone) = (from as u32 + 1..=end_of(&lines, from), reason.starts_with(ALONE));
            source.explained.push(Explanation { at: number, lines, alone, function: function && !alone });
        }
        if line.contains("defmt::") && line.contains("!(") {
            source.logs.extend(number..=end_of(&lines, index));
        }
    }
    source
}

/// Whether a line begins a function.
fn is_function(line: &&str) -> bool {
    let mut words = line.split_whitespace();
    words.find(|word| !["const", "unsafe"].contains(word) && !word.starts_with("pub")) == Some("fn")
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

/// Returns which copy of a section of RTIC's lock an instruction belongs to, at `line` of the library's `file`: the
/// section without a raise is the last expression of the function. `None` for what surrounds the sections.
fn raises(file: &str, function: &str, line: u32) -> Option<bool> {
    // The lines are those of version 1.1.4, which Cargo.lock names.
    let is_lock = file.ends_with("cortex-m-rtic-1.1.4/src/export.rs") && function.contains("lock");
    match line {
        221..=232 if is_lock => Some(true),
        235 if is_lock => Some(false),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_sections_of_rtic_s_lock_have_copies() {
        let file = "registry/cortex-m-rtic-1.1.4/src/export.rs";
        assert_eq!(raises(file, "rtic::export::lock", 229), Some(true));
        assert_eq!(raises(file, "rtic::export::lock", 235), Some(false));
        assert_eq!(raises(file, "rtic::export::lock", 220), None);
        assert_eq!(raises(file, "rtic::export::run", 229), None);
        assert_eq!(raises("dpr-fw/src/main.rs", "lock", 229), None);
    }

    #[test]
    fn an_explanation_holds_to_the_end_of_what_stands_below_it() {
        let text = "fn f() {\n    // Not covered: no test can.\n    // It takes a year.\n    if x {\n        y();\n\
                    \x20   }\n    z();\n    // Not covered: of the arm.\n    A => 1,\n}\n";
        let explained = read(text).explained;
        assert_eq!(explained[0], Explanation { at: 2, lines: 4..=6, alone: false, function: false });
        assert_eq!(explained[1], Explanation { at: 8, lines: 9..=9, alone: false, function: false });
        assert_eq!(explained.len(), 2);
    }

    #[test]
    fn an_explanation_above_a_function_is_of_the_whole_function() {
        for head in ["fn f() {", "    pub(super) const fn f() {", "#[inline(never)]\nfn f() {"] {
            assert!(read(&format!("// Not covered: it hangs.\n{head}\n}}\n")).explained[0].function, "{head}");
        }
        assert!(!read("// Not covered: it hangs.\ncall(fn_of(x));\n").explained[0].function);
        assert!(!read("// Not covered: only this line, it hangs.\nfn f() {\n}\n").explained[0].function);
    }

    #[test]
    fn an_explanation_of_one_line_leaves_out_what_depends_on_it() {
        let explained = &read("// Not covered: only this line, since x is true.\nif x {\n    y();\n}\n").explained[0];
        assert!(explained.explains(2, true) && !explained.explains(2, false) && !explained.explains(3, true));
    }

    #[test]
    fn an_instruction_without_a_line_belongs_to_the_one_before() {
        let of = |line| Origin { places: vec![Place { file: "a.rs".into(), line }], ..Origin::default() };
        let library = Origin { library: "mem.rs".into(), ..Origin::default() };
        assert_eq!(Origin::default().or_that_before(Some(of(3))), of(3));
        assert_eq!(Origin::default().or_that_before(None), Origin::default());
        assert_eq!(of(4).or_that_before(Some(of(3))), of(4));
        assert_eq!(library.clone().or_that_before(Some(of(3))), library);
    }

    #[test]
    fn the_lines_of_a_message_are_those_of_the_macro() {
        let text = "a();\ndefmt::warn!(\n    \"{=u32}\",\n    b()\n);\nc();\ndefmt::info!(\"d\");\n";
        assert_eq!(read(text).logs, [2, 3, 4, 5, 7].into());
    }
}
