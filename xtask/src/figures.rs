//! Writes the figures of docs/figures.md and README's sample of a run, from fresh runs.
//!
//! Each run is a command line of `sim`, which the page names. Real time is not among the figures, so that they do not
//! depend on the machine.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};
use bench::report::Report;
use clap::{Args, Parser};
use emulator_node::Clock;

use crate::size::{Footprint, footprint};
use crate::workspace::root;
use crate::{Board, Cli, Command, Receivers, firmware, sim, timing};

/// The beginnings of the report's lines that README shows.
const SAMPLE: [&str; 10] = [
    "HORUS ",
    "air ",
    "DPR ",
    "sample to readable ",
    "last bit to readable ",
    "SSI ",
    "Reported-Position ",
    "voter ",
    "base station ",
    "violations ",
];

const MARKS: [&str; 2] =
    ["<!-- written by `cargo xtask figures` -->\n", "<!-- end of what `cargo xtask figures` writes -->\n"];

const COMMAND: &str = "cargo xtask figures";

#[derive(Args)]
pub(crate) struct FiguresArgs {
    /// Write nothing; fail if a file is not current.
    #[arg(long)]
    check: bool,
}

pub(crate) fn figures(args: &FiguresArgs) -> Result<ExitCode> {
    let three = sound(on_all_clocks(&[])?)?;
    let page = include_str!("figures/template.txt")
        .replace("@three@\n", &table(&three, Some(&sound(on_all_clocks(&["--fc-ppm", "-1000"])?)?)))
        .replace("@five@\n", &table(&on_all_clocks(&["--gps", "5"])?, None))
        .replace("@memory@\n", &memory()?);
    write(args.check, root().join("docs/figures.md"), &page, COMMAND)?;
    let readme = root().join("README.md");
    let text = std::fs::read_to_string(&readme).with_context(|| format!("could not read {}", readme.display()))?;
    write(args.check, readme, &with_sample(&text, &sample(&three[0]))?, COMMAND)?;
    let path = root().join("docs/timing.md");
    let text = std::fs::read_to_string(&path).with_context(|| format!("could not read {}", path.display()))?;
    let (page, chart) = timing::page(&text, &path)?;
    write(args.check, path, &page, COMMAND)?;
    write(args.check, root().join("docs/timing.svg"), &chart, COMMAND)?;
    Ok(ExitCode::SUCCESS)
}

/// Writes what `command` found, or with `check` fails if the file shows something else.
pub(crate) fn write(check: bool, path: PathBuf, text: &str, command: &str) -> Result<()> {
    let current = std::fs::read_to_string(&path).is_ok_and(|found| found == text);
    if check {
        ensure!(current, "{} does not show what the link does now: run `{command}`", path.display());
    } else if !current {
        std::fs::write(&path, text).with_context(|| format!("could not write {}", path.display()))?;
        println!("{}", path.display());
    }
    Ok(())
}

fn sound(reports: Vec<Report>) -> Result<Vec<Report>> {
    for report in &reports {
        ensure!(report.violations.is_empty(), "the {} clock: {}", report.clock, report.violations.join("; "));
    }
    Ok(reports)
}

fn on_all_clocks(options: &[&str]) -> Result<Vec<Report>> {
    let run = |clock: Clock| {
        let clock = clock.to_string();
        let line = [&["cargo xtask", "sim", "--clock", &clock], options].concat();
        let Command::Sim(args) = Cli::try_parse_from(&line)?.command else { bail!("{line:?} is no run of the link") };
        eprintln!("-- {}", line.join(" "));
        sim::report(&args)
    };
    [Clock::Fast, Clock::Optimistic, Clock::Pessimistic].into_iter().map(run).collect()
}

type Row = (&'static str, fn(&Report) -> String);

const ROWS: [Row; 8] = [
    ("frames sent, delivered", |it| format!("{}, {}", it.horus.frames_sent, it.air.frames_delivered)),
    ("objects accepted; rejected while the sequence is searched", |it| {
        format!("{}; {}", it.dpr.objects_accepted, it.dpr.objects_rejected)
    }),
    ("tick to transmit command, peak to peak", |it| {
        or_none(it.horus.tick_to_command_ns.map(|span| format!("{} ns", span.width())))
    }),
    ("tick to first bit on the air, µs", |it| {
        or_none(it.horus.tick_to_air_ns.map(|span| format!("{} to {}", thousandths(span.min), thousandths(span.max))))
    }),
    ("sample to readable, median and 99.9 %, ms", |it| {
        let readable = it.latency_ns.sample_to_readable;
        or_none(readable.map(|it| format!("{:.3}, {:.3}", it.p50 as f64 / 1e6, it.p999 as f64 / 1e6)))
    }),
    ("processor load of HORUS, DPR", |it| format!("{:.1} %, {:.1} %", 100.0 * it.horus.load, 100.0 * it.dpr.load)),
    ("cycles in which receivers agree", |it| {
        let agree = it.voter.agree.iter().rev().filter(|&(_, &cycles)| cycles > 0);
        agree.map(|(receivers, cycles)| format!("{receivers}: {cycles}")).collect::<Vec<_>>().join(", ")
    }),
    ("voted position, worst error", |it| or_none(it.voter.max_error_m.map(|metres| format!("{metres:.1} m")))),
];

const ONE_FRAME: Row = ("sample to readable, 99.9 %, as a multiple of the air time", |it| {
    let readable = it.latency_ns.sample_to_readable;
    or_none(readable.map(|found| format!("{:.3}", found.p999 as f64 / it.air.air_time_ns as f64)))
});

/// The figures whose worst cases need transactions in all phases relative to HORUS's frames.
const MEETING: [Row; 2] = [
    ("last bit to readable, worst, µs", |it| {
        or_none(it.latency_ns.last_bit_to_readable.map(|it| thousandths(it.max)))
    }),
    ("SSI ready for the next transaction, worst, µs", |it| or_none(it.ssi.ready_ns.map(|it| thousandths(it.max)))),
];

/// Returns a table with a column for each report. The rows in [`MEETING`] come from the reports in `slipping`, if
/// given.
fn table(reports: &[Report], slipping: Option<&[Report]>) -> String {
    let mut text = String::from("| |");
    reports.iter().for_each(|report| text += &format!(" {} |", report.clock));
    text += &format!("\n|---|{}\n", "---|".repeat(reports.len()));
    let mut row = |what: &str, cell: fn(&Report) -> String, reports: &[Report]| {
        let cells: Vec<_> = reports.iter().map(cell).collect();
        text += &format!("| {what} | {} |\n", cells.join(" | "));
    };
    for (what, cell) in ROWS.into_iter().chain(slipping.map(|_| ONE_FRAME)).chain(MEETING) {
        row(what, cell, reports);
    }
    for (what, cell) in MEETING {
        if let Some(slipping) = slipping {
            row(&format!("{what}, in every phase"), cell, slipping);
        }
    }
    if reports.iter().any(|report| !report.violations.is_empty()) {
        row("violations", violations, reports);
    }
    text + "\n"
}

fn violations(report: &Report) -> String {
    if report.violations.is_empty() { "none".into() } else { report.violations.join("; ") }
}

fn thousandths(ns: u64) -> String {
    format!("{}.{:03}", ns / 1_000, ns % 1_000)
}

fn or_none(figure: Option<String>) -> String {
    figure.unwrap_or_else(|| "none".to_owned())
}

fn memory() -> Result<String> {
    let mut text = String::from("| | flash, bytes | static RAM, bytes | code in RAM, bytes |\n|---|---|---|---|\n");
    for board in Board::ALL {
        let Footprint { flash, ram, code_in_ram } = footprint(&firmware::build(board, Receivers::DEFAULT)?)?;
        text += &format!("| {} | {flash} | {ram} | {code_in_ram} |\n", board.package());
    }
    Ok(text)
}

fn sample(report: &Report) -> String {
    let text = sim::table(report);
    let lines = text.lines().filter(|line| SAMPLE.iter().any(|begin| line.starts_with(begin)));
    lines.fold(String::new(), |text, line| format!("{text}    {line}\n"))
}

fn with_sample(readme: &str, sample: &str) -> Result<String> {
    let [begin, end] = MARKS;
    let parts = readme.split_once(begin).and_then(|(before, rest)| Some((before, rest.split_once(end)?.1)));
    let (before, after) = parts.with_context(|| format!("README has no place for the sample: {begin}and {end}"))?;
    Ok(format!("{before}{begin}{sample}{end}{after}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bench::report::{Max, Span};

    fn report(clock: &'static str) -> Report {
        let mut report = Report { clock, ..Report::default() };
        report.horus.tick_to_command_ns = Some(Span { min: 100_000, max: 100_008 });
        report.latency_ns.last_bit_to_readable = Some(Max { max: 68_050 });
        report
    }

    #[test]
    fn a_table_has_a_column_for_each_clock() {
        let mut slipping = report("fast");
        slipping.latency_ns.last_bit_to_readable = Some(Max { max: 76_000 });
        let text = table(&[report("fast"), report("pessimistic")], Some(&[slipping.clone(), slipping]));
        for line in [
            "| | fast | pessimistic |\n|---|---|---|\n",
            "| tick to transmit command, peak to peak | 8 ns | 8 ns |\n",
            "| voted position, worst error | none | none |\n",
            "| last bit to readable, worst, µs | 68.050 | 68.050 |\n",
            "| last bit to readable, worst, µs, in every phase | 76.000 | 76.000 |\n",
        ] {
            assert!(text.contains(line), "{line}{text}");
        }
    }

    #[test]
    fn readme_shows_each_line_of_the_sample_once() {
        let lines = sample(&report("fast"));
        assert_eq!(lines.lines().count(), SAMPLE.len(), "{lines}");
        let [begin, end] = MARKS;
        let readme = format!("before\n{begin}old\n{end}after\n");
        let written = with_sample(&readme, &lines).unwrap();
        assert_eq!(written, format!("before\n{begin}{lines}{end}after\n"));
        assert_eq!(with_sample(&written, &lines).unwrap(), written);
        assert!(with_sample("before\nafter\n", &lines).is_err());
    }

    #[test]
    fn a_file_that_is_not_current_fails_the_check_with_the_remedy() {
        let error = write(true, root().join("docs/figures.md"), "another page", COMMAND).unwrap_err();
        assert!(error.to_string().contains("run `cargo xtask figures`"), "{error}");
    }
}
