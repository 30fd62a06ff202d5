//! Runs any ELF alone on one board: a cargo runner for the on-target tests and for other projects. On the bench it does
//! the same as the command `emulator`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
use emulator::Options;

use crate::{Board, ProbeArgs};

#[derive(Args)]
pub(crate) struct RunArgs {
    /// The board on which the file runs.
    #[arg(long, value_enum)]
    board: Board,
    /// The ELF file.
    #[arg(value_name = "FILE.elf")]
    elf: PathBuf,
    /// The place where the file runs. A real board takes the options of the probe only.
    #[arg(long, value_enum, default_value_t = Place::Bench)]
    on: Place,
    #[command(flatten)]
    options: Options,
    #[command(flatten)]
    probe: ProbeArgs,
}

/// The place where code for the boards runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Place {
    /// The emulated boards: no hardware needed.
    Bench,
    /// A real board on a debug probe.
    Hardware,
}

pub(crate) fn run(args: &RunArgs) -> Result<ExitCode> {
    match args.on {
        Place::Bench => {
            let status = emulator::run(args.board.on_bench(), args.board.name(), &args.elf, &args.options)?;
            Ok(u8::try_from(status).map_or(ExitCode::FAILURE, ExitCode::from))
        }
        Place::Hardware if args.options.gdb => {
            bail!("--gdb is for the bench: at a board, OpenOCD or `probe-rs gdb` wait for a debugger")
        }
        Place::Hardware => on_hardware(args),
    }
}

#[cfg(feature = "probe")]
fn on_hardware(args: &RunArgs) -> Result<ExitCode> {
    crate::probe::run(args.board, &args.elf, &args.probe)
}

#[cfg(not(feature = "probe"))]
fn on_hardware(_args: &RunArgs) -> Result<ExitCode> {
    crate::workspace::again_with("probe")
}
