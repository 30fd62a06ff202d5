//! Any ELF alone on one board: the cargo runner of the on-target tests.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::{Args, ValueEnum};

use crate::{Board, ProbeArgs};

#[derive(Args)]
pub(crate) struct RunArgs {
    /// The board to run it on.
    #[arg(long, value_enum)]
    board: Board,
    /// The ELF file.
    #[arg(value_name = "FILE.elf")]
    elf: PathBuf,
    /// Stop after this much virtual time, in seconds; an image that is still running then fails. Bench only.
    #[arg(long, default_value_t = 60.0, value_parser = crate::sim::positive_seconds)]
    limit: f64,
    /// Where it runs.
    #[arg(long, value_enum, default_value_t = Place::Bench)]
    on: Place,
    #[command(flatten)]
    probe: ProbeArgs,
}

/// Where target code runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Place {
    /// The emulated boards: no hardware needed.
    Bench,
    /// A board on a debug probe.
    Hardware,
}

pub(crate) fn run(args: &RunArgs) -> Result<ExitCode> {
    match args.on {
        Place::Bench => on_bench(args),
        Place::Hardware => on_hardware(args),
    }
}
