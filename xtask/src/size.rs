//! Compares the sizes of all firmwares with the budgets in each firmware's `Cargo.toml`.
//!
//! Flash counts code, constants and the initial values of statics. RAM counts all statics; the rest of the RAM budget
//! is for the stack, which flip-link places so that an overflow leads to a fault. Code that is copied to RAM counts in
//! flash and has a separate column; the linker limits its own RAM region.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result};
use object::elf::{PF_X, PT_LOAD, ProgramHeader32, SHF_ALLOC, SHF_WRITE};
use object::read::elf::{FileHeader, ProgramHeader, SectionHeader};

use crate::workspace::metadata;
use crate::{Board, Receivers, firmware};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Footprint {
    pub(crate) flash: u64,
    pub(crate) ram: u64,
    /// The size of the code that is copied from flash to RAM at the start, bytes. This code counts in flash too.
    pub(crate) code_in_ram: u64,
}

struct Budget {
    flash: u64,
    ram: u64,
}

pub(crate) fn size(gps: Receivers) -> Result<ExitCode> {
    let budgets = metadata()?;
    let mut over = false;
    println!(
        "{:<12} {:>9} {:>9} {:>5}   {:>9} {:>9} {:>5}   {:>13}",
        "image", "flash B", "budget", "", "RAM B", "budget", "", "code in RAM B"
    );
    let mut images = Vec::new();
    for board in Board::ALL {
        images.push((board.package(), board.package(), firmware::build(board, gps)?));
    }
    images.push(("dpr-fw +hold", Board::Dpr.package(), firmware::build_dpr_with_hold(gps)?));
    if firmware::has_package(firmware::HOLD)? {
        images.push((firmware::HOLD, firmware::HOLD, firmware::build_hold()?));
    }
    for (name, package, elf) in images {
        let used = footprint(&elf)?;
        let budget = budget(&budgets, package)?;
        println!(
            "{:<12} {:>9} {:>9} {:>4}%   {:>9} {:>9} {:>4}%   {:>13}",
            name,
            used.flash,
            budget.flash,
            used.flash * 100 / budget.flash,
            used.ram,
            budget.ram,
            used.ram * 100 / budget.ram,
            used.code_in_ram
        );
        over |= used.flash > budget.flash || used.ram > budget.ram;
    }
    if over {
        eprintln!("error: an image is over its budget (package.metadata.budget of its Cargo.toml)");
        return Ok(ExitCode::FAILURE);
    }
    Ok(ExitCode::SUCCESS)
}

fn budget(metadata: &serde_json::Value, name: &str) -> Result<Budget> {
    let packages = metadata["packages"].as_array().context("cargo metadata lists no packages")?;
    let budget = packages.iter().find(|package| package["name"] == name).map(|package| &package["metadata"]["budget"]);
    let bytes = |kind: &str| {
        budget
            .and_then(|budget| budget[kind].as_u64())
            .with_context(|| format!("{name} has no package.metadata.budget.{kind}"))
    };
    Ok(Budget { flash: bytes("flash")?, ram: bytes("ram")? })
}

pub(crate) fn footprint(elf: &Path) -> Result<Footprint> {
    let data = std::fs::read(elf).with_context(|| format!("could not read {}", elf.display()))?;
    measure(&data).with_context(|| format!("{} is not a 32-bit ELF image", elf.display()))
}

fn measure(data: &[u8]) -> Result<Footprint> {
    let header = object::elf::FileHeader32::<object::Endianness>::parse(data)?;
    let endian = header.endian()?;
    let segments = header.program_headers(endian, data)?;
    let loaded = || segments.iter().filter(|segment| segment.p_type(endian) == PT_LOAD);
    let flash = loaded().map(|segment| u64::from(segment.p_filesz(endian))).sum();
    // The start copies a code segment with different run and load addresses to RAM.
    let is_code = |segment: &&ProgramHeader32<_>| segment.p_flags(endian) & PF_X == PF_X;
    let code_in_ram = loaded()
        .filter(|segment| is_code(segment) && segment.p_vaddr(endian) != segment.p_paddr(endian))
        .map(|segment| u64::from(segment.p_memsz(endian)))
        .sum();
    let ram = header
        .section_headers(endian, data)?
        .iter()
        .filter(|section| section.sh_flags(endian) & (SHF_ALLOC | SHF_WRITE) == SHF_ALLOC | SHF_WRITE)
        .map(|section| u64::from(section.sh_size(endian)))
        .sum();
    Ok(Footprint { flash, ram, code_in_ram })
}
