//! Object-code coverage of the flight images: which instructions the bench has executed, and which branches went both
//! ways.
//!
//! # Design
//!
//! | step | where |
//! |---|---|
//! | the bench runs the release images, and each core notes what it executes | `cortex_m4::coverage`, `bench::sim::coverage` |
//! | the image's instructions are found without executing it | [`image`] |
//! | what leads only to a panic is told apart, and so is the log | [`paths`], [`gaps`] |
//! | instructions are led back to source lines, and their comments read | [`source`] |
//! | both are compared and printed | [`gaps`], [`report`] |

mod gaps;
mod image;
mod paths;
mod report;
mod source;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use bench::faults::{Faults, Kind};
use bench::sim::coverage::{Records, run};
use bench::sim::{Images, Setup};
use clap::Args;
use cortex_m4::coverage::Record;

use crate::output::Output;
use crate::workspace::{root, tracked};
use crate::{Receivers, firmware, sim};
use image::Image;
use report::Measured;

#[derive(Args)]
pub(crate) struct CoverageArgs {
    /// Virtual time of each run, in seconds.
    #[arg(long, default_value_t = 4.0, value_parser = sim::positive_seconds)]
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
    let mut flown = Vec::new();
    for &gps in &args.gps {
        flown.extend(fly(args, gps)?);
    }
    let sources = sources()?;
    let mut measured = Vec::new();
    for Flown { name, image, record } in flown {
        let origins = source::origins(&image).with_context(|| format!("{name} has no source lines"))?;
        let coverage = gaps::coverage(&image, &record, &origins, &sources);
        let executed = coverage.sum(|_| true).instructions.seen;
        ensure!(executed > 0, "{name} executed nothing, so this run shows nothing of it");
        measured.push(Measured { name, functions: image.functions, coverage });
    }
    print!("{}", report::text(&measured));
    if let Some(json) = json {
        let text = serde_json::to_string_pretty(&report::json(&measured)).context("the gaps do not serialise")?;
        std::fs::write(json.path(), text + "\n").context("could not write the gaps")?;
        json.finish()?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Runs the images for one number of receivers through all runs.
fn fly(args: &CoverageArgs, gps: Receivers) -> Result<Vec<Flown>> {
    let (horus_elf, dpr_elf) = firmware::build_pair(gps)?;
    let horus = Flown::read(&format!("horus-tx-fw, n = {gps}"), &horus_elf)?;
    let dpr = Flown::read(&format!("dpr-fw, n = {gps}"), &dpr_elf)?;
    let records = Records { horus: horus.record.clone(), dpr: dpr.record.clone(), hold: None };
    let duration_ns = (args.seconds * 1e9).round() as u64;
    for &seed in &args.seeds {
        let images = Images { horus: horus_elf.clone(), dpr: dpr_elf.clone() };
        let setup = Setup { seed, writes: true, ..Setup::new(images, gps.0, duration_ns) };
        let kinds = args.faults.clone().unwrap_or_else(|| Kind::ALL.to_vec());
        let kinds = kinds.into_iter().filter(|kind| !kind.is_upset() && *kind != Kind::Hold);
        for faults in std::iter::once(vec![]).chain(kinds.map(|kind| vec![kind])) {
            let what: Vec<_> = faults.iter().map(ToString::to_string).collect();
            let faults = Faults::drawn(&faults, gps.0, seed, duration_ns);
            eprintln!(
                "n = {gps}, seed {seed}, faults: {}",
                if what.is_empty() { "none".into() } else { what.join(",") }
            );
            let verdict = run(&Setup { faults, ..setup.clone() }, &records)?;
            if let Some(first) = verdict.violations.first() {
                bail!("a run with a violation is no evidence: {first}");
            }
        }
    }
    Ok(vec![horus, dpr])
}

/// Reads the sources of this workspace in Rust.
fn sources() -> Result<BTreeMap<String, source::Source>> {
    let files = tracked()?.into_iter().filter(|file| file.ends_with(".rs"));
    let read = |file: String| {
        let text = std::fs::read_to_string(root().join(&file)).with_context(|| format!("{file} cannot be read"))?;
        Ok((file, source::read(&text)))
    };
    files.map(read).collect()
}
