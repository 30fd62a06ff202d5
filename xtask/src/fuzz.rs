//! Fuzzes the parsers of the profile and of the base station.
//!
//! cargo-fuzz runs on the pinned toolchain: both crates forbid unsafe code, so neither a sanitizer nor a nightly
//! compiler is needed. The committed corpus seeds each run, and the ordinary tests replay it. New inputs stay below
//! `target/`. An input that causes a crash is written to the folder's `artifacts`, to be minimised into the corpus.

use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use clap::Args;

use crate::workspace::{CARGO_FUZZ, cargo, check, install, root, target_dir};

const FOLDERS: [&str; 2] = ["profile/fuzz", "base-station/fuzz"];

#[derive(Args)]
pub(crate) struct FuzzArgs {
    /// The fuzz target; all of them, one after the other, if none is named.
    target: Option<String>,
    /// The time for which each target is fuzzed, in seconds.
    #[arg(long, default_value_t = 60)]
    seconds: u32,
    /// The fuzzer's seed.
    #[arg(long, default_value_t = 1)]
    seed: u32,
}

pub(crate) fn fuzz(args: &FuzzArgs) -> Result<ExitCode> {
    install(&CARGO_FUZZ)?;
    let known = targets()?;
    let chosen = match &args.target {
        None => known,
        Some(name) if known.iter().any(|(_, target)| target == name) => {
            known.into_iter().filter(|(_, target)| target == name).collect()
        }
        Some(name) => {
            let names: Vec<_> = known.iter().map(|(_, target)| target.as_str()).collect();
            bail!("there is no fuzz target {name}; there are: {}", names.join(", "))
        }
    };
    for (folder, target) in chosen {
        eprintln!("-- fuzzing {target} for {} s", args.seconds);
        // libFuzzer reads both folders of inputs, and writes new inputs into the first.
        let found = target_dir().join("fuzz-corpus").join(&target);
        std::fs::create_dir_all(&found).with_context(|| format!("could not make {}", found.display()))?;
        let mut command = cargo();
        command
            .args(["fuzz", "run", "--fuzz-dir", folder, "--sanitizer", "none", &target])
            .arg(&found)
            .arg(format!("{folder}/corpus/{target}"))
            .arg("--")
            .arg(format!("-max_total_time={}", args.seconds))
            .arg(format!("-seed={}", args.seed));
        check(&format!("fuzzing {target}"), &mut command)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn targets() -> Result<Vec<(&'static str, String)>> {
    let mut targets = vec![];
    for folder in FOLDERS {
        let sources = root().join(folder).join("fuzz_targets");
        let entries = std::fs::read_dir(&sources).with_context(|| format!("could not read {}", sources.display()))?;
        let mut names = vec![];
        for entry in entries {
            let path = entry?.path();
            if path.extension().is_some_and(|extension| extension == "rs") {
                names.extend(path.file_stem().map(|stem| stem.to_string_lossy().into_owned()));
            }
        }
        names.sort();
        targets.extend(names.into_iter().map(|name| (folder, name)));
    }
    Ok(targets)
}
