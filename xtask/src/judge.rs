//! Judges a stored event log again.

use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result};
use bench_judge::{Log, judge};
use clap::Args;

#[derive(Args)]
pub(crate) struct JudgeArgs {
    /// The log, as stored by `cargo xtask sim --events FILE`.
    log: PathBuf,
}

pub(crate) fn run(args: &JudgeArgs) -> Result<ExitCode> {
    let file = File::open(&args.log).with_context(|| format!("cannot open {}", args.log.display()))?;
    let log = Log::read(BufReader::new(file)).with_context(|| format!("{} is no event log", args.log.display()))?;
    let verdict = judge(&log);
    let seconds = log.events.last().map_or(0, |event| event.at) as f64 / 1e9;
    println!("{} receiver(s), seed {}, {} clock, {seconds} s", log.header.gps, log.header.seed, log.header.clock);
    if !log.is_whole() {
        println!("The log is cut off there, and judged up to there.");
    }
    if verdict.violations.is_empty() {
        println!("violations            none");
        return Ok(ExitCode::SUCCESS);
    }
    println!("violations            {}", verdict.violations.len());
    for broken in &verdict.violations {
        println!("  ! {broken}");
    }
    eprintln!("error: {} violation(s)", verdict.violations.len());
    Ok(ExitCode::FAILURE)
}
