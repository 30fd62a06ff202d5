//! The command `emulator`.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use emulator::{Options, run};
use emulator_node::Target;

/// Runs firmware for microcontrollers on a model of the part, in virtual time and exact to the cycle.
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Run an ELF file alone on a part.
    ///
    /// Exit codes: 0 passed, 1 the firmware or the script failed, 2 the command line, a file or a line of the script is
    /// wrong.
    Run(RunArgs),
}

#[derive(Args)]
struct RunArgs {
    /// The ELF file.
    #[arg(value_name = "FILE.elf")]
    elf: PathBuf,
    /// The part on which the file runs: nrf52840 or stm32f429zi.
    #[arg(long)]
    part: Target,
    #[command(flatten)]
    options: Options,
}

fn main() -> ExitCode {
    let Command::Run(RunArgs { elf, part, options }) = Cli::parse().command;
    match run(part, part.name(), &elf, &options) {
        Ok(0) => ExitCode::SUCCESS,
        Ok(_) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}
