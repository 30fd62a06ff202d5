//! Firmware images: contents of memory, and names of addresses.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use addr2line::gimli;
use object::elf::{ELFMAG, EM_ARM, ET_DYN, ET_EXEC, ET_REL, PT_LOAD};
use object::read::elf::{ElfFile32, FileHeader, ProgramHeader};
use object::{Architecture, LittleEndian, Object, ObjectSection, ObjectSymbol, SymbolKind};

use super::Error;

/// A symbol of a firmware image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "pack", derive(serde::Serialize, serde::Deserialize))]
pub struct Symbol {
    /// The symbol's address. For a function it is that of its first instruction, with the Thumb bit clear.
    pub address: u64,
    /// The symbol's size in bytes, zero where the image does not state one.
    pub size: u64,
}

#[derive(Clone, Debug)]
pub(crate) struct Function {
    pub(crate) start: u64,
    pub(crate) size: u64,
    pub(crate) name: String,
}

/// One firmware image, read once and shared by every node that runs it.
#[derive(Clone, Debug)]
pub struct Firmware(Arc<Contents>);

#[derive(Debug, Default)]
pub(crate) struct Contents {
    pub(crate) name: String,
    pub(crate) elf: Vec<u8>,
    pub(crate) segments: Vec<(u64, Vec<u8>)>,
    pub(crate) symbols: BTreeMap<String, Symbol>,
    pub(crate) functions: Vec<Function>,
    pub(crate) log: Option<defmt_decoder::Table>,
    /// Why the table of log messages cannot be read, if the image has one.
    pub(crate) log_error: Option<String>,
}

impl Firmware {
    /// Reads the ELF file at `path`.
    ///
    /// # Errors
    ///
    /// Returns an error for a file that cannot be read, or that is no linked 32-bit Arm ELF file.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let bytes = std::fs::read(path).map_err(|error| Error::Firmware(format!("{}: {error}", path.display())))?;
        let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        Self::parse(&name, bytes)
    }

    /// Parses the ELF file in `elf`. Reports call the image `name`.
    ///
    /// # Errors
    ///
    /// Returns the errors of [`Firmware::read`].
    pub fn parse(name: &str, elf: Vec<u8>) -> Result<Self, Error> {
        let refuse = |error: &dyn std::fmt::Display| Error::Firmware(format!("{name}: {error}"));
        if elf.is_empty() {
            return Err(refuse(&"the file is empty"));
        }
        if !elf.starts_with(&ELFMAG) {
            return Err(refuse(&"not an ELF file: name the one that the linker wrote, no .hex, .bin or source"));
        }
        // The kind of the file is checked first, because it determines the layout of everything else.
        if let Ok(any) = object::File::parse(&*elf)
            && (any.architecture() != Architecture::Arm || !any.is_little_endian())
        {
            let order = if any.is_little_endian() { "" } else { ", big-endian" };
            let words = "not for a Cortex-M: build it with --target thumbv7em-none-eabihf";
            return Err(refuse(&format!("an image for {:?}{order}, {words}", any.architecture())));
        }
        let file = ElfFile32::<LittleEndian>::parse(&*elf)
            .map_err(|error| refuse(&format!("a damaged or truncated ELF file ({error})")))?;
        match file.elf_header().e_type(LittleEndian) {
            ET_EXEC | ET_DYN => {}
            ET_REL => return Err(refuse(&"an object file: link it, its code has no addresses yet")),
            kind => return Err(refuse(&format!("an ELF file of type {kind}, which is no program"))),
        }
        if file.elf_header().e_machine(LittleEndian) != EM_ARM {
            return Err(refuse(&format!("an image for {:?}, not for a 32-bit Arm", file.architecture())));
        }
        let mut segments = Vec::new();
        for header in file.elf_program_headers() {
            if header.p_type(LittleEndian) != PT_LOAD || header.p_filesz(LittleEndian) == 0 {
                continue;
            }
            let bytes = header
                .data(LittleEndian, &*elf)
                .map_err(|()| refuse(&"a segment lies outside the file: is it truncated?"))?;
            segments.push((u64::from(header.p_paddr(LittleEndian)), bytes.to_vec()));
        }
        if segments.is_empty() {
            return Err(refuse(&"nothing in it goes into memory: was it linked with a linker script (-Tlink.x)?"));
        }
        let mut symbols = BTreeMap::new();
        let mut functions = Vec::new();
        for symbol in file.symbols() {
            let Ok(name) = symbol.name() else { continue };
            // The symbols `$t` and `$d` only tell disassemblers where code and data begin, so they are left out.
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
        // A crate in the image may log with defmt although the image has no log. Such an image runs too.
        let (log, log_error) = match defmt_decoder::Table::parse(&elf) {
            Ok(table) => (table, None),
            Err(error) => (None, Some(error.to_string())),
        };
        drop(file);
        Ok(Self(Arc::new(Contents { name: name.to_owned(), elf, segments, symbols, functions, log, log_error })))
    }

    /// Makes an image of bytes at addresses, without symbols, for tests with a few hand-assembled instructions.
    #[must_use]
    pub fn raw(name: &str, segments: Vec<(u64, Vec<u8>)>) -> Self {
        Self::of(Contents { name: name.to_owned(), segments, ..Contents::default() })
    }

    pub(crate) fn of(contents: Contents) -> Self {
        Self(Arc::new(contents))
    }

    #[cfg(feature = "pack")]
    pub(crate) fn contents(&self) -> &Contents {
        &self.0
    }

    /// The image's name in reports, which is that of the ELF file.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// The contents of memory before the first instruction: load addresses and bytes.
    #[must_use]
    pub fn segments(&self) -> &[(u64, Vec<u8>)] {
        &self.0.segments
    }

    /// The symbol whose linker name is `name`.
    #[must_use]
    pub fn symbol(&self, name: &str) -> Option<Symbol> {
        self.0.symbols.get(name).copied()
    }

    /// Returns the address of the variable or function whose demangled path ends with `name`, in whole path segments.
    /// The compiler's hash at the end of a symbol does not count.
    pub fn symbol_called(&self, name: &str) -> Option<u64> {
        self.variable_called(name).map(|symbol| symbol.address)
    }

    /// The symbol, with its size, whose address [`Firmware::symbol_called`] returns.
    pub fn variable_called(&self, name: &str) -> Option<Symbol> {
        // A mangled symbol has each name of its path as it is.
        let last = name.rsplit("::").next().unwrap_or(name);
        let mut symbols = self.0.symbols.iter().filter(|(symbol, _)| symbol.contains(last));
        let called = |symbol: &str| {
            let path = symbol.trim_end_matches(|end: char| end.is_ascii_digit()).strip_suffix('.').unwrap_or(symbol);
            let path = format!("{:#}", rustc_demangle::demangle(path));
            path.strip_suffix(name).is_some_and(|path| path.is_empty() || path.ends_with("::"))
        };
        symbols.find(|(symbol, _)| called(symbol)).map(|(_, symbol)| *symbol)
    }

    /// The size in bytes of the function that begins at `address`, 0 if none does.
    pub fn size_at(&self, address: u64) -> usize {
        let sizes = self.0.functions.iter().filter(|function| function.start == address).map(|function| function.size);
        sizes.max().and_then(|size| usize::try_from(size).ok()).unwrap_or(0)
    }

    /// Returns the end of the image's sections in RAM between `from` and `top`: `from` if there are none, and `None`
    /// for an image without sections.
    pub(crate) fn placed_below(&self, from: u32, top: u32) -> Option<u32> {
        let file = object::File::parse(&*self.0.elf).ok()?;
        let mut any = false;
        let mut end = u64::from(from);
        for section in file.sections() {
            any = true;
            let (first, behind) = (section.address(), section.address() + section.size());
            if first >= u64::from(from) && behind <= u64::from(top) {
                end = end.max(behind);
            }
        }
        u32::try_from(end).ok().filter(|_| any)
    }

    /// The addresses of all functions whose demangled name ends in `name`, as a whole path segment.
    pub fn functions_called(&self, name: &str) -> impl Iterator<Item = u64> {
        self.0
            .functions
            .iter()
            .filter(move |function| {
                function.name.strip_suffix(name).is_some_and(|path| path.is_empty() || path.ends_with("::"))
            })
            .map(|function| function.start)
    }

    pub(crate) fn is_a_file(&self) -> bool {
        !self.0.elf.is_empty()
    }

    /// Whether the image has a table of defmt messages.
    #[must_use]
    pub fn has_defmt(&self) -> bool {
        self.0.log.is_some()
    }

    pub(crate) fn log_table(&self) -> Option<&defmt_decoder::Table> {
        self.0.log.as_ref()
    }

    pub(crate) fn log_error(&self) -> Option<&str> {
        self.0.log_error.as_deref()
    }

    /// The name of `address` as function and offset, such as `horus_tx_fw::app::cycle+0x1c`.
    #[must_use]
    pub fn name_of(&self, address: u64) -> Option<String> {
        let address = address & !1;
        let function = self.function_at(address)?;
        Some(match address - function.start {
            0 => function.name.clone(),
            offset => format!("{}+{offset:#x}", function.name),
        })
    }

    fn function_at(&self, address: u64) -> Option<&Function> {
        let after = self.0.functions.partition_point(|function| function.start <= address);
        let function = self.0.functions.get(after.checked_sub(1)?)?;
        (address - function.start < function.size.max(2)).then_some(function)
    }

    /// The function and source line of the instruction at `address`, such as `horus_tx_fw::app::cycle+0x1c
    /// (src/main.rs:120)`. Code that was inlined from a library is described by its innermost caller in the firmware
    /// itself. If that caller was inlined too, the linker's function follows: `horus_tx_fw::clock::init
    /// (src/clock.rs:70), inlined in main+0x1c`.
    #[must_use]
    pub fn place_of(&self, address: u64) -> Option<String> {
        let name = self.name_of(address)?;
        let Some(source) = self.source_of(address) else { return Some(name) };
        let line = source.line;
        Some(match source.inlined {
            Some(function) => format!("{function} ({line}), inlined in {name}"),
            None => format!("{name} ({line})"),
        })
    }

    /// The source line of the instruction at `address`, such as `src/main.rs:120`, if the image has DWARF. Inlined code
    /// has several lines. The returned one is that which [`Firmware::place_of`] names.
    #[must_use]
    pub fn line_of(&self, address: u64) -> Option<String> {
        self.source_of(address).map(|source| source.line)
    }

    fn source_of(&self, address: u64) -> Option<Source> {
        let address = address & !1;
        let file = object::File::parse(&*self.0.elf).ok()?;
        let load = |section: gimli::SectionId| -> Result<Cow<'_, [u8]>, gimli::Error> {
            let section = file.section_by_name(section.name());
            Ok(section.and_then(|section| section.uncompressed_data().ok()).unwrap_or_default())
        };
        let sections = gimli::DwarfSections::load(load).ok()?;
        let dwarf = sections.borrow(|section| gimli::EndianSlice::new(section, gimli::LittleEndian));
        let context = addr2line::Context::from_dwarf(dwarf).ok()?;
        let unit = context.find_dwarf_and_unit(address).skip_all_loads();
        let directory = unit.and_then(|unit| unit.comp_dir).map(|directory| directory.to_string_lossy().into_owned());
        let mut frames = context.find_frames(address).skip_all_loads().ok()?;
        let mut found: Option<Source> = None;
        let mut own = false;
        let mut outermost = None;
        while let Ok(Some(frame)) = frames.next() {
            let function = frame.function.and_then(|function| {
                let raw = function.raw_name().ok()?;
                Some(format!("{:#}", rustc_demangle::demangle(&raw)))
            });
            // If there is an outer frame, the function of the inner frame is inlined into the outer frame's function.
            if let (Some(found), true) = (&mut found, outermost.is_some()) {
                found.inlined = found.inlined.take().or_else(|| found.function.take());
            }
            if let Some(location) = frame.location
                && let (Some(file), Some(line)) = (location.file, location.line)
                && !own
            {
                own = !is_library(file);
                if own || found.is_none() {
                    let line = format!("{}:{line}", within(file, directory.as_deref()));
                    found = Some(Source { function: function.clone(), inlined: None, line });
                }
            }
            outermost = function;
        }
        // The debug information still has code that the linker removed, at address 0. On a part whose flash begins at
        // 0, the removed code would hide the code that is there.
        let start = self.function_at(address)?.start;
        let is_there = |name: &String| {
            let bare = |name: &str| name.rsplit("::").next().unwrap_or_default().to_owned();
            let same = |function: &Function| function.start == start && bare(&function.name) == bare(name);
            self.0.functions.iter().any(same)
        };
        if outermost.as_ref().is_some_and(|name| !is_there(name)) {
            return None;
        }
        found
    }
}

#[derive(Debug)]
struct Source {
    /// The name of the function that contains the instruction, if the image has it.
    function: Option<String>,
    /// The name of the function that contains the instruction, if that function was inlined into another one.
    inlined: Option<String>,
    line: String,
}

/// Returns the path of `file` relative to the directory in which it was compiled.
fn within<'a>(file: &'a str, directory: Option<&str>) -> &'a str {
    directory.and_then(|directory| file.strip_prefix(directory)?.strip_prefix('/')).unwrap_or(file)
}

/// Whether a source file belongs to the language's libraries or to an external package.
fn is_library(file: &str) -> bool {
    ["/rustc/", "/rustlib/", "library/core/", "/registry/src/", "/git/checkouts/"]
        .iter()
        .any(|part| file.contains(part))
}
