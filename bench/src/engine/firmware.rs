//! A firmware image: what goes into memory, and what its addresses mean to a person.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use addr2line::gimli;
use object::{Object, ObjectSection, ObjectSymbol, SymbolKind};
use rigless::image::Image;

use super::Error;

/// A symbol of a firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Symbol {
    /// Its address; for a function that of its first instruction, with the Thumb bit clear.
    pub address: u64,
    /// Its size in bytes, zero where the image does not say.
    pub size: u64,
}

/// A function, for naming an address inside it.
#[derive(Clone, Debug)]
struct Function {
    start: u64,
    size: u64,
    name: String,
}

/// One firmware image, read once and shared by every node that runs it.
#[derive(Clone, Debug)]
pub struct Firmware(Arc<Contents>);

#[derive(Debug)]
struct Contents {
    name: String,
    elf: Vec<u8>,
    segments: Vec<(u64, Vec<u8>)>,
    symbols: BTreeMap<String, Symbol>,
    functions: Vec<Function>,
    log: Option<defmt_decoder::Table>,
}

impl Firmware {
    /// Reads the ELF file at `path`.
    ///
    /// # Errors
    ///
    /// A file that cannot be read, is no 32-bit Arm ELF file, or whose defmt section no decoder of this version reads.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let bytes = std::fs::read(path).map_err(|error| Error::Firmware(format!("{}: {error}", path.display())))?;
        let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        Self::parse(&name, bytes)
    }

    /// Takes the ELF file in `elf`, called `name` in reports.
    ///
    /// # Errors
    ///
    /// As [`Firmware::read`].
    pub fn parse(name: &str, elf: Vec<u8>) -> Result<Self, Error> {
        let refuse = |error: &dyn std::fmt::Display| Error::Firmware(format!("{name}: {error}"));
        let file = object::File::parse(&*elf).map_err(|error| refuse(&format!("not an ELF image ({error})")))?;
        let image = Image::new(Path::new(name), elf.clone(), None).map_err(|error| refuse(&error))?;
        let segments: Vec<_> = image.segments().map(|(at, bytes)| (at, bytes.to_vec())).collect();
        let mut symbols = BTreeMap::new();
        let mut functions = Vec::new();
        for symbol in file.symbols() {
            let Ok(name) = symbol.name() else { continue };
            // `$t` and `$d` mark code and data for disassemblers.
            if name.is_empty() || name.starts_with('$') || symbol.is_undefined() {
                continue;
            }
            let code = symbol.kind() == SymbolKind::Text;
            let address = if code { symbol.address() & !1 } else { symbol.address() };
            if code {
                let name = format!("{:#}", rustc_demangle::demangle(name));
                functions.push(Function { start: address, size: symbol.size(), name });
            }
            symbols.insert(name.to_owned(), Symbol { address, size: symbol.size() });
        }
        functions.sort_by(|a, b| (a.start, &a.name).cmp(&(b.start, &b.name)));
        let log = defmt_decoder::Table::parse(&elf).map_err(|error| refuse(&error))?;
        drop(file);
        Ok(Self(Arc::new(Contents { name: name.to_owned(), elf, segments, symbols, functions, log })))
    }

    /// Bytes at addresses, with no symbols: a few hand-assembled instructions for a test.
    #[must_use]
    pub fn raw(name: &str, segments: Vec<(u64, Vec<u8>)>) -> Self {
        Self(Arc::new(Contents {
            name: name.to_owned(),
            elf: Vec::new(),
            segments,
            symbols: BTreeMap::new(),
            functions: Vec::new(),
            log: None,
        }))
    }

    /// The name reports use, the ELF file's.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// What goes where before the first instruction: load addresses and bytes.
    #[must_use]
    pub fn segments(&self) -> &[(u64, Vec<u8>)] {
        &self.0.segments
    }

    /// The symbol called `name`, as the linker has it.
    #[must_use]
    pub fn symbol(&self, name: &str) -> Option<Symbol> {
        self.0.symbols.get(name).copied()
    }

    /// The addresses of every function whose demangled name ends in `name` as a whole path segment.
    pub(crate) fn functions_called(&self, name: &str) -> impl Iterator<Item = u64> {
        self.0
            .functions
            .iter()
            .filter(move |function| {
                function.name.strip_suffix(name).is_some_and(|path| path.is_empty() || path.ends_with("::"))
            })
            .map(|function| function.start)
    }

    /// The defmt table, where the firmware logs with defmt.
    pub(crate) fn log_table(&self) -> Option<&defmt_decoder::Table> {
        self.0.log.as_ref()
    }

    /// `address` as function and offset, like `horus_tx_fw::app::cycle+0x1c`.
    #[must_use]
    pub fn name_of(&self, address: u64) -> Option<String> {
        let address = address & !1;
        let after = self.0.functions.partition_point(|function| function.start <= address);
        let function = self.0.functions.get(after.checked_sub(1)?)?;
        let offset = address - function.start;
        (offset < function.size.max(2)).then(|| match offset {
            0 => function.name.clone(),
            _ => format!("{}+{offset:#x}", function.name),
        })
    }

    /// The source line of the instruction at `address`, like `src/main.rs:120`, where the image carries DWARF.
    #[must_use]
    pub fn line_of(&self, address: u64) -> Option<String> {
        let file = object::File::parse(&*self.0.elf).ok()?;
        let load = |section: gimli::SectionId| -> Result<Cow<'_, [u8]>, gimli::Error> {
            let section = file.section_by_name(section.name());
            Ok(section.and_then(|section| section.uncompressed_data().ok()).unwrap_or_default())
        };
        let sections = gimli::DwarfSections::load(load).ok()?;
        let dwarf = sections.borrow(|section| gimli::EndianSlice::new(section, gimli::LittleEndian));
        let context = addr2line::Context::from_dwarf(dwarf).ok()?;
        let location = context.find_location(address & !1).ok()??;
        Some(format!("{}:{}", location.file?, location.line?))
    }
}
