//! Tries faults on copies of the running bench, each alone, and joins what parts of a campaign found.

use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use bench::campaign::{self, Class, Options, Scope, Shard, Tally};
use bench::faults::Kind;
use bench::faults::plan::BIT_ERROR;
use bench::sim::{Images, Setup};
use clap::{Args, Subcommand};
use emulator_node::Clock;
use indicatif::{ProgressBar, ProgressStyle};

use crate::output::Output;
use crate::{Receivers, firmware};

#[derive(Args)]
#[command(args_conflicts_with_subcommands = true)]
pub(crate) struct CampaignArgs {
    #[command(subcommand)]
    merge: Option<Merge>,
    /// Least number of cycles of HORUS (10 ms of virtual time) that all trials run together.
    #[arg(long, default_value_t = 20_000, value_parser = clap::value_parser!(u64).range(1..))]
    cycles: u64,
    /// Seed of the flight, the instants and the faults.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Number of threads; as many as there are cores by default. The outcome does not depend on it.
    #[arg(long, value_name = "N")]
    jobs: Option<NonZero<usize>>,
    /// Run one part of the campaign: the I-th of K. `merge` joins the parts.
    #[arg(long, value_name = "I/K", default_value = "1/1")]
    shard: Shard,
    /// GNSS receivers in the profile: 1, 2, 3 or 5.
    #[arg(long, default_value_t = Receivers::DEFAULT)]
    gps: Receivers,
    /// The cost of processor time: fast, optimistic or pessimistic.
    #[arg(long, default_value_t)]
    clock: Clock,
    /// Kinds of fault, which the trials use in turn: a list of air, gnss, fc, power, buffers, inputs, hang, chips (as
    /// `sim --faults` draws them), bits (bit errors on the air), spi (glitches between either board and its front end),
    /// drift (oscillators, up to 200 ppm), ram, flash, registers, peripherals (one flipped bit of either board). All by
    /// default.
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    kinds: Vec<Kind>,
    /// Bit error rate on the air of the faults of kind `bits`.
    #[arg(long, value_name = "RATE", default_value_t = BIT_ERROR, value_parser = bit_error_rate)]
    bit_error_rate: f64,
    /// Seconds of the flight from which the instants of the faults are drawn.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=3_600))]
    seconds: u64,
    /// Repeat the trial of this number alone, and print what it broke.
    #[arg(long, value_name = "NUMBER", value_parser = clap::value_parser!(u64).range(1..))]
    #[arg(conflicts_with_all = ["cycles", "shard", "jobs", "json"])]
    trial: Option<u64>,
    /// Write the outcome as JSON, for `merge`.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the outcome as a page in Markdown.
    #[arg(long, value_name = "FILE.md", conflicts_with = "trial")]
    page: Option<PathBuf>,
    /// Run the images in this folder, horus-tx-fw.elf and dpr-fw.elf, instead of building them.
    #[arg(long, value_name = "FOLDER")]
    images: Option<PathBuf>,
}

#[derive(Subcommand)]
enum Merge {
    /// Join the parts of a campaign, each a file that --json wrote.
    Merge {
        /// The files of the parts, in any order.
        #[arg(required = true)]
        parts: Vec<PathBuf>,
        /// Write the joined outcome as JSON.
        #[arg(long, value_name = "FILE")]
        json: Option<PathBuf>,
        /// Write the joined outcome as a page in Markdown.
        #[arg(long, value_name = "FILE.md")]
        page: Option<PathBuf>,
    },
}

fn bit_error_rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(rate) if rate > 0.0 && rate <= 0.5 => Ok(rate),
        _ => Err("expected a rate above 0, up to 0.5".to_owned()),
    }
}

pub(crate) fn campaign(args: &CampaignArgs) -> Result<ExitCode> {
    match &args.merge {
        Some(Merge::Merge { parts, json, page }) => show(&merged(parts)?, json.as_deref(), page.as_deref()),
        None => run(args),
    }
}

fn merged(parts: &[PathBuf]) -> Result<Tally> {
    let mut joined: Option<Tally> = None;
    for path in parts {
        let text = std::fs::read_to_string(path).with_context(|| format!("could not read {}", path.display()))?;
        let tally: Tally = serde_json::from_str(&text)
            .with_context(|| format!("{} is not what `campaign --json` writes", path.display()))?;
        match &mut joined {
            Some(joined) => joined.merge(tally).with_context(|| format!("{} cannot be joined", path.display()))?,
            None => joined = Some(tally),
        }
    }
    joined.context("there is nothing to join")
}

fn run(args: &CampaignArgs) -> Result<ExitCode> {
    // A hold is not part of a campaign. It has tests and `sim --hold --faults hold` of its own.
    if let Some(kind) = args.kinds.iter().find(|kind| kind.needs_hold()) {
        bail!("--kinds {kind}: there is no hold in a campaign; `cargo xtask sim --hold --faults {kind}` has one");
    }
    let wanted = |kind: &Kind| !kind.needs_hold() && (args.kinds.is_empty() || args.kinds.contains(kind));
    let kinds = Kind::ALL.into_iter().filter(wanted).collect();
    let scope = Scope {
        kinds,
        seed: args.seed,
        gps: args.gps.0,
        clock: args.clock,
        bit_error: args.bit_error_rate,
        seconds: args.seconds,
    };
    let jobs = match args.jobs {
        Some(jobs) => jobs.get(),
        None => std::thread::available_parallelism().context("could not tell how many cores there are")?.get(),
    };
    let options = Options { scope, cycles: args.cycles, jobs, shard: args.shard };
    let images = match &args.images {
        Some(folder) => Images { horus: folder.join("horus-tx-fw.elf"), dpr: folder.join("dpr-fw.elf") },
        None => {
            let (horus, dpr) = firmware::build_pair(args.gps)?;
            Images { horus, dpr }
        }
    };
    let setup = Setup { clock: args.clock, seed: args.seed, writes: true, ..Setup::new(images, args.gps.0, 0) };
    if let Some(number) = args.trial {
        let trial = campaign::repeat(&setup, &options, number)?;
        println!("{trial}");
        let is_good = trial.class != Class::Dangerous && (trial.is_upset || trial.violations.is_empty());
        return Ok(if is_good && trial.injected { ExitCode::SUCCESS } else { ExitCode::FAILURE });
    }
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} cycles, {eta} left").expect("a constant template");
    let bar = ProgressBar::new(options.cycles / options.shard.of).with_style(style);
    let tally = campaign::run(&setup, &options, None, &|cycles| bar.inc(cycles))?;
    bar.finish_and_clear();
    show(&tally, args.json.as_deref(), args.page.as_deref())
}

fn show(tally: &Tally, json: Option<&Path>, page: Option<&Path>) -> Result<ExitCode> {
    print!("{tally}");
    let text = serde_json::to_string_pretty(tally).context("the outcome does not serialise")? + "\n";
    for (option, path, text) in [("--json", json, text), ("--page", page, to_page(tally))] {
        let Some(path) = path else { continue };
        let output = Output::new(option, path)?;
        std::fs::write(output.path(), text).with_context(|| format!("could not write {}", path.display()))?;
        output.finish()?;
    }
    let flaws = tally.flaws();
    flaws.iter().for_each(|flaw| eprintln!("error: {flaw}"));
    if !tally.found.is_empty() {
        eprintln!("error: {} dangerous faults or broken rules", tally.found.len());
    }
    Ok(if tally.is_clean() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn to_page(tally: &Tally) -> String {
    let Tally { cycles, scope, .. } = tally;
    let sum = tally.sum();
    let mut text = format!(
        "# Campaign of faults\n\nWritten by `cargo xtask campaign --page`; [campaign](../campaign.md) says what the \
         classes mean. It is repeated by\n\n    cargo xtask campaign --cycles {cycles} {scope}\n\n{} cycles of HORUS \
         (10 ms each) of virtual time, {} readings of the flight controller.\n\n",
        sum.cycles, sum.readings
    );
    text += &tally.table();
    text += "\n## Dangerous faults and broken rules\n\n";
    if tally.found.is_empty() {
        text += "None.\n";
    }
    for (number, words) in &tally.found {
        text += &format!("- {words}; repeated by `--trial {number}` in place of `--cycles {cycles}`\n");
    }
    text
}
