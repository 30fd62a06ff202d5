//! Bounds the response times of all tasks of the three firmwares, from a search on the bench.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use bench::sim::Images;
use bench_timing::bounds::{self, BoardFigures};
use bench_timing::chart;
use bench_timing::search::{self, TimingImages};
use clap::Args;
use emulator_node::Clock;

use crate::output::Output;
use crate::{Receivers, firmware};

#[derive(Args)]
pub(crate) struct TimingArgs {
    /// GNSS receivers in the profile: 1, 2, 3 or 5.
    #[arg(long, default_value_t = Receivers::DEFAULT)]
    gps: Receivers,
    /// The cost of processor time: fast, optimistic or pessimistic.
    #[arg(long, default_value_t = Clock::Pessimistic)]
    clock: Clock,
    /// Write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Draw one cycle, that with the longest time from a frame's last bit to FRESH: boards, air, SSI, hold.
    #[arg(long, value_name = "FILE.svg")]
    svg: Option<PathBuf>,
    /// Write 1.5 seconds of all tasks, the air and the SSI for Perfetto (ui.perfetto.dev), in Chrome's trace format.
    #[arg(long, value_name = "FILE.json")]
    trace: Option<PathBuf>,
}

pub(crate) fn timing(args: &TimingArgs) -> Result<ExitCode> {
    let output = |option, path: &Option<PathBuf>| path.as_deref().map(|path| Output::new(option, path)).transpose();
    let [json, svg, trace] =
        [output("--json", &args.json)?, output("--svg", &args.svg)?, output("--trace", &args.trace)?];
    let images = images(args.gps)?;
    let boards = figures(&images, args.gps, args.clock)?;
    print!("{}", bounds::text(&boards));
    if let Some(json) = json {
        write(json, &(serde_json::to_string_pretty(&boards).context("the figures do not serialise")? + "\n"))?;
    }
    if svg.is_some() || trace.is_some() {
        let (drawn, traced) = charts(&images, args.gps, args.clock)?;
        svg.map(|svg| write(svg, &drawn)).transpose()?;
        trace.map(|trace| write(trace, &traced)).transpose()?;
    }
    let faults: Vec<String> = boards.iter().flat_map(BoardFigures::all_faults).collect();
    for fault in &faults {
        eprintln!("error: {fault}");
    }
    println!("{}", if faults.is_empty() { "every response is bounded by its deadline" } else { "not all holds" });
    Ok(if faults.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn write(output: Output, text: &str) -> Result<()> {
    std::fs::write(output.path(), text).with_context(|| format!("could not write {}", output.path().display()))?;
    output.finish()
}

pub(crate) fn images(gps: Receivers) -> Result<TimingImages> {
    let (horus, dpr) = firmware::build_pair(gps)?;
    let dpr_with_hold = firmware::build_dpr_with_hold(gps)?;
    Ok(TimingImages { link: Images { horus, dpr }, dpr_with_hold, hold: firmware::build_hold()? })
}

/// Returns the figures of all boards. Fails if a run of the search violates a rule of the judge.
pub(crate) fn figures(images: &TimingImages, gps: Receivers, clock: Clock) -> Result<Vec<BoardFigures>> {
    let (boards, violations) = search::search(search::runs(images, gps.0, clock))?;
    ensure!(violations.is_empty(), "a run of the search violates a rule of the judge: {}", violations.join("; "));
    Ok(boards.iter().map(|(table, seen)| bounds::figures(table, seen)).collect())
}

/// Returns one cycle as SVG, and the whole run for Perfetto.
pub(crate) fn charts(images: &TimingImages, gps: Receivers, clock: Clock) -> Result<(String, String)> {
    let run = search::charted(images, gps.0, clock);
    let shown = search::observe(&run.setup, &run.tables(), true)?;
    let log = shown.log.as_ref().context("a run with spans keeps its log")?;
    let cycle = chart::worst_cycle(log).context("the DPR announced no frame")?;
    let lanes = chart::lanes(&run, &shown);
    let title = format!("One cycle of HORUS with a hold, {gps} receivers, {clock} clock");
    Ok((chart::svg(&lanes, cycle, &title), chart::chrome_trace(&lanes)))
}

const MARKS: [&str; 2] = ["<!-- response times, by `cargo xtask figures` -->\n", "<!-- end of response times -->\n"];

/// Returns `page` with the table of the present figures, and the chart.
///
/// # Errors
///
/// A bound exceeds its deadline, or the page has no place for the table.
pub(crate) fn page(page: &str, path: &Path) -> Result<(String, String)> {
    let images = images(Receivers::DEFAULT)?;
    eprintln!("-- cargo xtask timing");
    let boards = figures(&images, Receivers::DEFAULT, Clock::Pessimistic)?;
    let faults: Vec<String> = boards.iter().flat_map(BoardFigures::all_faults).collect();
    anyhow::ensure!(faults.is_empty(), "{}", faults.join("; "));
    let (svg, _) = charts(&images, Receivers::DEFAULT, Clock::Pessimistic)?;
    let [begin, end] = MARKS;
    let parts = page.split_once(begin).and_then(|(before, rest)| Some((before, rest.split_once(end)?.1)));
    let (before, after) = parts.with_context(|| format!("{} has no place for the table: {begin}", path.display()))?;
    Ok((format!("{before}{begin}\n{}{end}{after}", bounds::page(&boards)), svg))
}
