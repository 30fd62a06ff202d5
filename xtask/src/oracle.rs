//! Compares the bench's core with QEMU and LLVM's disassembler.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use clap::Args;
use core_oracle::{Class, Options, RECORDED_CASES};

const RECORDINGS: &str = "emulator/cortex-m4/tests/data";

#[derive(Args)]
pub(crate) struct OracleArgs {
    /// A class of cases; all of them by default.
    #[arg(long, value_parser = class)]
    class: Vec<Class>,
    /// Random cases of each class.
    #[arg(long, default_value_t = RECORDED_CASES)]
    cases: usize,
    /// Seed of the cases.
    #[arg(long, default_value_t = 2026)]
    seed: u64,
    /// Replace the recordings that the ordinary tests replay.
    #[arg(long)]
    record: bool,
}

fn class(name: &str) -> Result<Class, String> {
    Class::from_name(name).ok_or_else(|| {
        let names: Vec<_> = Class::ALL.iter().map(|class| class.name()).collect();
        format!("the classes are {}", names.join(", "))
    })
}

pub(crate) fn oracle(args: &OracleArgs) -> Result<ExitCode> {
    let everything = args.class.is_empty();
    if args.record && (!everything || args.cases != RECORDED_CASES) {
        bail!("--record is for all classes with {RECORDED_CASES} cases each: leave --class and --cases out");
    }
    let record = args.record.then(|| PathBuf::from(RECORDINGS));
    let scratch = crate::workspace::root().join("target/oracle");
    std::fs::create_dir_all(&scratch).with_context(|| format!("could not create {}", scratch.display()))?;
    let options = Options {
        classes: args.class.clone(),
        cases: args.cases,
        seed: args.seed,
        decode: everything,
        record: record.map(|folder| crate::workspace::root().join(folder)),
        scratch,
    };
    let report = core_oracle::run(&options)?;
    print!("{report}");
    if report.differing() > 0 {
        eprintln!("error: {} case(s) differ", report.differing());
        return Ok(ExitCode::FAILURE);
    }
    Ok(ExitCode::SUCCESS)
}
