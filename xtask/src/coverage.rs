//! Object-code coverage of the flight images: which instructions the bench has executed, and which branches went both
//! ways.
//!
//! # Design
//!
//! | step | where |
//! |---|---|
//! | the bench runs the release images, and each core notes what it executes | `coverage` of `cortex_m4` and `bench` |
//! | the image's instructions are found without executing it | [`image`] |
//! | the runs | [`runs`], [`scripted`], [`hold_runs`], [`dpr_runs`], [`messages`] |
//! | what leads only to a panic is told apart, and so is the log | [`paths`], [`callers`], [`gaps`] |
//! | instructions are led back to source lines, and their comments read | [`source`] |
//! | both are compared, and gaps explained | [`gaps`], [`twins`], [`explained`] |
//! | all is printed | [`report`] |
//!
//! A gap is closed by a test on the bench, or explained beside the code by a comment `Not covered`, a colon and the
//! reason above the statement, arm or item; if the reason begins with "only this line," it holds for the first line and
//! not for what is inlined there. Gaps in code of libraries are explained in a table ([`explained`]). The
//! command fails on a gap without explanation in code that decides or has a deadline, on an explanation of what is
//! covered, and on one of a whole function that is executed.

mod callers;
mod dpr_runs;
mod explained;
mod gaps;
mod hold_runs;
mod horus_runs;
mod image;
mod messages;
mod part;
mod paths;
mod report;
mod run;
mod runs;
mod scripted;
mod source;
mod twins;
mod values;

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use bench::campaign::{self, Options, Scope, Shard};
use bench::faults::Kind;
use bench::sim::coverage::{Records, run};
use bench::sim::{FrontEndConfig, Images, Setup, on_the_link};
use clap::Args;
use cortex_m4::coverage::Record;
use emulator_node::{Clock, Threads};
use rayon::prelude::*;
use tempfile::NamedTempFile;

use crate::output::Output;
use crate::workspace::{root, tracked};
use crate::{Receivers, firmware, sim};
use explained::{Measured, explain};
use image::Image;
use run::{Addresses, Run};
use source::Source;

/// The page with the totals.
const PAGE: &str = "docs/safety/coverage.md";

/// The least number of cycles of a trial with an upset (`bench::campaign`).
const CYCLES_OF_AN_UPSET: u64 = 40;

/// The length of the flight whose copies are upset, s.
const UPSET_FLIGHT: u64 = 6;

#[derive(Args)]
pub(crate) struct CoverageArgs {
    /// Virtual time of each run, in seconds.
    #[arg(long, default_value_t = 6.0, value_parser = sim::positive_seconds)]
    seconds: f64,
    /// The seeds: each kind of fault runs once with each.
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "1")]
    seeds: Vec<u64>,
    /// GNSS receivers in the profile: 1, 2, 3 or 5. Each number is a pair of images.
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "3")]
    gps: Vec<Receivers>,
    /// Run only these kinds of faults, and the flight without faults; all kinds by default.
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    faults: Option<Vec<Kind>>,
    /// Make only the runs whose name contains this word, and no upsets.
    #[arg(long, value_name = "WORD", conflicts_with_all = ["faults", "write", "check"])]
    only: Option<String>,
    /// The number of upsets of RAM, flash and registers, each on a copy of the bench.
    #[arg(long, value_name = "COUNT", default_value_t = 24)]
    upsets: usize,
    /// Write the totals into docs/safety/coverage.md.
    #[arg(long, conflicts_with = "faults")]
    write: bool,
    /// Write nothing; fail if docs/safety/coverage.md does not show these totals.
    #[arg(long, conflicts_with_all = ["faults", "write"])]
    check: bool,
    /// Write every gap as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// An image with its record.
struct Flown {
    name: String,
    image: Image,
    record: Arc<Record>,
}

impl Flown {
    fn read(name: &str, path: &std::path::Path) -> Result<Self> {
        let image = Image::read(path)?;
        let record = Arc::new(Record::new(image.areas.clone()));
        Ok(Self { name: name.to_owned(), image, record })
    }
}

pub(crate) fn coverage(args: &CoverageArgs) -> Result<ExitCode> {
    let json = args.json.as_deref().map(|path| Output::new("--json", path)).transpose()?;
    let (sources, reasons) = (sources()?, explained::reasons()?);
    let mut flown = Vec::new();
    for &gps in &args.gps {
        flown.extend(fly(args, gps)?);
    }
    let measured = flown.iter().map(|flown| measure(flown, &sources)).collect::<Result<Vec<_>>>()?;
    let explained = explain(&measured, &sources, reasons);
    let summary = report::summary(&measured, &explained);
    print!("{}\n{summary}", report::text(&measured, &explained));
    if let Some(json) = json {
        let text = serde_json::to_string_pretty(&report::json(&measured)).context("the gaps do not serialise")?;
        std::fs::write(json.path(), text + "\n").context("could not write the gaps")?;
        json.finish()?;
    }
    if args.write || args.check {
        let command = command(args);
        let page = report::page(&command, &summary, &report::missing(&measured, &explained));
        crate::figures::write(args.check, root().join(PAGE), &page, &command)?;
    }
    if args.only.is_some() {
        return Ok(ExitCode::SUCCESS);
    }
    for place in &explained.needless {
        eprintln!("error: {place}: all that this explains is covered");
    }
    for place in &explained.wide {
        eprintln!("error: {place}: this explains a whole function that is executed, and so its next gap too");
    }
    if explained.open > 0 {
        eprintln!("error: {} gaps in deciding code and the deadline path are not explained", explained.open);
    }
    let holds = explained.needless.is_empty() && explained.wide.is_empty() && explained.open == 0;
    Ok(if holds { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// The command line that repeats these runs.
fn command(args: &CoverageArgs) -> String {
    let list = |items: Vec<String>| items.join(",");
    let seeds = list(args.seeds.iter().map(ToString::to_string).collect());
    let gps = list(args.gps.iter().map(ToString::to_string).collect());
    let CoverageArgs { seconds, upsets, .. } = args;
    format!("cargo xtask coverage --seconds {seconds} --seeds {seeds} --gps {gps} --upsets {upsets} --write")
}

/// Compares an image with its record.
///
/// # Errors
///
/// It executed nothing: a run that does not run is no evidence.
fn measure(flown: &Flown, sources: &BTreeMap<String, Source>) -> Result<Measured> {
    let Flown { name, image, record } = flown;
    let origins = source::origins(image).with_context(|| format!("{name} has no source lines"))?;
    let coverage = gaps::coverage(image, record, &origins, sources).with_context(|| name.clone())?;
    let executed = origins.iter().filter(|(address, _)| record.seen(**address).executed);
    let executed = executed.filter_map(|(_, origin)| origin.places.first().cloned()).collect();
    let lines = origins.into_values().flat_map(|origin| origin.places).collect();
    Ok(Measured { name: name.clone(), functions: image.functions.clone(), coverage, lines, executed })
}

/// Runs the images for one number of receivers through all runs, without a hold and with one.
fn fly(args: &CoverageArgs, gps: Receivers) -> Result<Vec<Flown>> {
    let (horus_elf, dpr_elf) = firmware::build_pair(gps)?;
    let (with_port, hold_elf) = (firmware::build_dpr_with_hold(gps)?, firmware::build_hold()?);
    let horus = Flown::read(&format!("horus-tx-fw, n = {gps}"), &horus_elf)?;
    let dpr = Flown::read(&format!("dpr-fw, n = {gps}"), &dpr_elf)?;
    let dpr_with_port = Flown::read(&format!("dpr-fw with hold, n = {gps}"), &with_port)?;
    let hold = Flown::read("hold-fw", &hold_elf)?;
    let beside = Some((hold_elf, hold.record.clone()));
    let (mut benches, mut flights) = (vec![], vec![]);
    for (flown_dpr, elf, hold) in [(&dpr, dpr_elf, None), (&dpr_with_port, with_port, beside)] {
        let images = Images { horus: horus_elf.clone(), dpr: elf };
        let (hold_elf, hold_record) = hold.unzip();
        let records = Records { horus: horus.record.clone(), dpr: flown_dpr.record.clone(), hold: hold_record };
        let of_both = |address: fn(&Image) -> u32| [address(&horus.image), address(&flown_dpr.image)];
        let addresses = Addresses {
            crcs: of_both(|image| image.program_crc),
            ram: of_both(|image| image.ram),
            guards: of_both(|image| image.guard),
            hot: of_both(|image| image.hot),
            handlers: [horus.image.start_of("TIM2"), flown_dpr.image.start_of("TIMER1")],
            kept: horus.image.kept.clone(),
            receiver: flown_dpr.image.receiver,
        };
        for &seed in &args.seeds {
            let new = Setup::new(images.clone(), gps.0, 0);
            let setup = Setup { seed, writes: true, hold: hold_elf.clone(), threads: Threads::One, ..new };
            flights.extend(flights_of(args, &setup, &records, addresses.clone()));
            benches.push((setup, records.clone()));
        }
    }
    if let Some(word) = &args.only {
        flights.retain(|flight| flight.run.name.contains(word));
        benches.clear();
        ensure!(!flights.is_empty(), "no run has \"{word}\" in its name");
    }
    let is_flown = |flown: &Flown| {
        let of = |records: &Records| {
            let all = [Some(&records.horus), Some(&records.dpr), records.hold.as_ref()];
            all.into_iter().flatten().any(|record| Arc::ptr_eq(record, &flown.record))
        };
        args.only.is_none() || flights.iter().any(|flight| of(&flight.records))
    };
    let flown = [horus, dpr, dpr_with_port, hold].into_iter().filter(is_flown).collect();
    // The longest first, so that all threads end at about the same time.
    flights.sort_by_key(|flight| Reverse(flight.run.duration_ns));
    flights.into_iter().par_bridge().try_for_each(Flight::fly)?;
    for (setup, records) in benches {
        upset(args, setup, &records)?;
    }
    Ok(flown)
}

/// A run, what it runs on, and where it is recorded.
struct Flight {
    run: Run,
    setup: Setup,
    records: Records,
}

/// Returns all runs of one seed with the images of `setup`.
fn flights_of(args: &CoverageArgs, setup: &Setup, records: &Records, addresses: Addresses) -> Vec<Flight> {
    let duration_ns = (args.seconds * 1e9).round() as u64;
    let addresses = args.faults.is_none().then_some(addresses);
    let runs = runs::runs(&kinds(args, setup), setup.gps, setup.seed, duration_ns, addresses, setup.hold.is_some());
    // Each run of the hold has a seed of its own, and so sensors of its own: one samples faster, another slower than it
    // says.
    let seed = |run: &Run| if run.name.starts_with("hold: ") { setup.seed + run.name.len() as u64 } else { setup.seed };
    let flight = |run: Run| {
        // The older of the two chips is on the boards in these runs.
        let is_older = ["hold: memory", "hold: starts", "misreads"].contains(&run.name.as_str());
        let older = || on_the_link(FrontEndConfig::st25r3916());
        let front_ends = match run.name.as_str() {
            _ if is_older => older(),
            dpr_runs::OTHER_CHIP => dpr_runs::other_chip(),
            _ => setup.front_ends.clone(),
        };
        let setup = Setup { seed: seed(&run), front_ends, ..setup.clone() };
        Flight { run, setup, records: records.clone() }
    };
    runs.into_iter().map(flight).collect()
}

/// The kinds of faults that are asked for and that a bench with this setup can have.
fn kinds(args: &CoverageArgs, setup: &Setup) -> Vec<Kind> {
    let kinds = args.faults.clone().unwrap_or_else(|| Kind::ALL.to_vec());
    kinds.into_iter().filter(|kind| !kind.needs_hold() || setup.hold.is_some()).collect()
}

impl Flight {
    fn fly(self) -> Result<()> {
        let began = Instant::now();
        let Self { run: Run { name, faults, duration_ns, factory_settings, recordings, judged }, setup, records } =
            self;
        let with = if setup.hold.is_some() { "with hold" } else { "without hold" };
        let files = recordings.iter().map(|bytes| recorded(bytes)).collect::<Result<Vec<_>>>()?;
        let recordings = files.iter().map(|file| Some(file.path().to_owned())).collect();
        let verdict = run(&Setup { faults, duration_ns, factory_settings, recordings, ..setup.clone() }, &records)?;
        let (took, virtual_s) = (began.elapsed().as_secs_f64(), duration_ns as f64 / 1e9);
        eprintln!("n = {}, seed {}, {with}: {name}, {virtual_s:.1} s in {took:.1} s", setup.gps, setup.seed);
        let refused =
            verdict.violations.iter().map(ToString::to_string).find(|it| it.contains("could not be injected"));
        if let Some(refused) = refused {
            bail!("a run without its faults is no evidence ({name}, {with}): {refused}");
        }
        if let Some(first) = verdict.violations.first().filter(|_| judged) {
            bail!("a run with a violation is no evidence ({name}, {with}): {first}");
        }
        Ok(())
    }
}

/// Writes a receiver's recording into a file that is deleted when it is dropped.
fn recorded(bytes: &[u8]) -> Result<NamedTempFile> {
    let mut file = NamedTempFile::new().context("a recording could not be made")?;
    file.write_all(bytes).context("a recording could not be written")?;
    Ok(file)
}

/// Upsets copies of the bench, each alone.
fn upset(args: &CoverageArgs, setup: Setup, records: &Records) -> Result<()> {
    let kinds: Vec<Kind> = kinds(args, &setup).into_iter().filter(|kind| kind.is_upset()).collect();
    if kinds.is_empty() || args.upsets == 0 {
        return Ok(());
    }
    let with = if setup.hold.is_some() { "with hold" } else { "without hold" };
    // The bench that is copied flies without faults, which the runs have had.
    let (seed, gps, clock, seconds) = (setup.seed, setup.gps, Clock::Fast, UPSET_FLIGHT);
    let scope = Scope { kinds, seed, gps, clock, bit_error: 0.0, seconds };
    let cycles = CYCLES_OF_AN_UPSET * args.upsets as u64;
    let options = Options { scope, cycles, jobs: 2, shard: Shard::WHOLE };
    let tally = campaign::run(&Setup { clock, ..setup }, &options, Some(records), &|_| ())?;
    eprintln!("{with}: {} upsets", tally.sum().injected());
    Ok(())
}

/// Reads the sources of this workspace in Rust.
fn sources() -> Result<BTreeMap<String, Source>> {
    let files = tracked()?.into_iter().filter(|file| file.ends_with(".rs"));
    let read = |file: String| {
        let text = std::fs::read_to_string(root().join(&file)).with_context(|| format!("{file} cannot be read"))?;
        Ok((file, source::read(&text)))
    };
    files.map(read).collect()
}
