//! Any ELF alone on one board: the cargo runner of the on-target tests.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use bench::node::{Clock, Event, Firmware, Limits};
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
    /// What processor time costs: fast, optimistic or pessimistic. The last two bound what silicon takes. Bench only.
    #[arg(long, default_value_t)]
    clock: Clock,
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

fn on_bench(args: &RunArgs) -> Result<ExitCode> {
    let firmware = Firmware::read(&args.elf)?;
    let limits = Limits { virtual_time: (args.limit * 1e9) as u64, ..Limits::default() };
    let outcome = args.board.on_bench().run(args.clock, &firmware, limits, |event| match event {
        Event::Line(line) => println!("{line}"),
        Event::Finding(finding) => eprintln!("{finding}"),
    })?;
    if outcome.exit.is_none() && !outcome.died {
        let restarts = match outcome.resets {
            0 => String::new(),
            1 => ", after a restart".to_owned(),
            count => format!(", after {count} restarts"),
        };
        eprintln!("error: still running after {} s of virtual time (--limit){restarts}: {}", args.limit, outcome.doing);
    }
    // A firmware that says it is well while the bench saw it do wrong is not well.
    let status = if outcome.status() == 0 && !outcome.passed() { 1 } else { outcome.status() };
    Ok(u8::try_from(status).map_or(ExitCode::FAILURE, ExitCode::from))
}

#[cfg(feature = "probe")]
fn on_hardware(args: &RunArgs) -> Result<ExitCode> {
    crate::probe::run(args.board, &args.elf, &args.probe)
}

#[cfg(not(feature = "probe"))]
fn on_hardware(_args: &RunArgs) -> Result<ExitCode> {
    crate::workspace::again_with("probe")
}
