//! Image sizes against the budgets written in each firmware's `Cargo.toml`.
//!
//! Flash is what the image occupies there: code, constants and the initial values of statics. RAM is every static,
//! initialised or not; what remains below the budget is the stack's, which flip-link puts where an overflow faults.
//! Code that is copied to RAM has a region of its own there, which the linker bounds, and counts in flash.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result};
use object::elf::{PT_LOAD, SHF_ALLOC, SHF_WRITE};
use object::read::elf::{FileHeader, ProgramHeader, SectionHeader};

use crate::workspace::cargo;
use crate::{Board, Receivers, firmware};

/// Bytes in each kind of memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Footprint {
    flash: u64,
    ram: u64,
}

pub(crate) fn size(gps: Receivers) -> Result<ExitCode> {
    let budgets = budgets()?;
    let mut over = false;
    println!("{:<12} {:>9} {:>9} {:>5}   {:>9} {:>9} {:>5}", "image", "flash B", "budget", "", "RAM B", "budget", "");
    for board in Board::ALL {
        let elf = firmware::build(board, gps)?;
        let used = footprint(&elf)?;
        let budget = budget(&budgets, board)?;
        println!(
            "{:<12} {:>9} {:>9} {:>4}%   {:>9} {:>9} {:>4}%",
            board.package(),
            used.flash,
            budget.flash,
            used.flash * 100 / budget.flash,
            used.ram,
            budget.ram,
            used.ram * 100 / budget.ram
        );
        over |= used.flash > budget.flash || used.ram > budget.ram;
    }
    if over {
        eprintln!("error: an image is over its budget (package.metadata.budget of its Cargo.toml)");
        return Ok(ExitCode::FAILURE);
    }
    Ok(ExitCode::SUCCESS)
}

fn budgets() -> Result<serde_json::Value> {
    let output = cargo()
        .args(["metadata", "--no-deps", "--format-version", "1"])
        .output()
        .context("could not start cargo metadata")?;
    serde_json::from_slice(&output.stdout).context("cargo metadata printed something that is not JSON")
}

fn budget(metadata: &serde_json::Value, board: Board) -> Result<Footprint> {
    let packages = metadata["packages"].as_array().context("cargo metadata lists no packages")?;
    let budget = packages
        .iter()
        .find(|package| package["name"] == board.package())
        .map(|package| &package["metadata"]["budget"]);
    let bytes = |kind: &str| {
        budget
            .and_then(|budget| budget[kind].as_u64())
            .with_context(|| format!("{} has no package.metadata.budget.{kind}", board.package()))
    };
    Ok(Footprint { flash: bytes("flash")?, ram: bytes("ram")? })
}

fn footprint(elf: &Path) -> Result<Footprint> {
    let data = std::fs::read(elf).with_context(|| format!("could not read {}", elf.display()))?;
    measure(&data).with_context(|| format!("{} is not a 32-bit ELF image", elf.display()))
}

fn measure(data: &[u8]) -> Result<Footprint> {
    let header = object::elf::FileHeader32::<object::Endianness>::parse(data)?;
    let endian = header.endian()?;
    // What a programmer writes: the file's bytes of each loadable segment.
    let flash = header
        .program_headers(endian, data)?
        .iter()
        .filter(|segment| segment.p_type(endian) == PT_LOAD)
        .map(|segment| u64::from(segment.p_filesz(endian)))
        .sum();
    // What the statics take: every writable section that has an address at run time.
    let ram = header
        .section_headers(endian, data)?
        .iter()
        .filter(|section| section.sh_flags(endian) & (SHF_ALLOC | SHF_WRITE) == SHF_ALLOC | SHF_WRITE)
        .map(|section| u64::from(section.sh_size(endian)))
        .sum();
    Ok(Footprint { flash, ram })
}
