//! Counts which errors the profile's two CRCs detect, compares the counts with the committed ones, and writes the
//! safety report.

use std::io::Write as _;
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use residual::report::{self, Analysis, Report};
use residual::{Code, DualWeights, codes};

use crate::workspace;

const PARTS: f64 = 1000.0;

#[derive(Args)]
pub(crate) struct ResidualArgs {
    /// Write all results as JSON to a file, or to standard output with `-`.
    #[arg(long, value_name = "FILE|-")]
    json: Option<PathBuf>,
    /// Take the committed weights of the dual codes instead of counting their words again.
    #[arg(long)]
    committed: bool,
    /// Replace the committed weights by the counted ones, instead of comparing them.
    #[arg(long, conflicts_with = "committed")]
    store: bool,
    /// Number of threads; as many as there are cores by default.
    #[arg(long, value_name = "N")]
    threads: Option<NonZero<usize>>,
}

pub(crate) fn residual(args: &ResidualArgs) -> Result<ExitCode> {
    let threads = match args.threads {
        Some(threads) => threads,
        None => std::thread::available_parallelism().context("could not tell how many cores there are")?,
    };
    let root = workspace::root();
    let duals = if args.committed { committed()? } else { count(threads) };
    let mut different: Vec<Code> = Vec::new();
    if args.store {
        write(&root.join(codes::COMMITTED_PATH), &codes::committed_text(&duals))?;
    } else {
        different
            .extend(duals.iter().filter(|(code, dual)| code.committed().as_ref() != Some(dual)).map(|(code, _)| *code));
    }

    let analysis =
        Analysis::new(&duals).map_err(|(code, error)| anyhow!("{} at {} bits: {error}", code.named.name, code.bits))?;
    let working = ProgressBar::new_spinner()
        .with_message("searching for codewords of both CRCs, injecting errors into sealed objects");
    working.enable_steady_tick(Duration::from_millis(200));
    let report = Report::new(analysis, threads);
    working.finish_and_clear();

    let plot = report.analysis.svg().map_err(|error| anyhow!("could not draw the plot: {error}"))?;
    write(&root.join(report::PLOT_PATH), &plot)?;
    let page = root.join(report::REPORT_PATH);
    let text = std::fs::read_to_string(&page).with_context(|| format!("could not read {}", page.display()))?;
    write(&page, &report.refresh(&text).map_err(anyhow::Error::msg)?)?;

    // A program may read the JSON from standard output, so the screen goes to standard error.
    let json_on_stdout = args.json.as_deref() == Some(Path::new("-"));
    let screen = report.screen();
    if json_on_stdout {
        eprint!("{screen}");
    } else {
        print!("{screen}");
    }
    if let Some(path) = &args.json {
        let json = serde_json::to_string_pretty(&report).context("the report does not serialise")? + "\n";
        if json_on_stdout {
            std::io::stdout().write_all(json.as_bytes()).context("could not write the report")?;
        } else {
            write(path, &json)?;
        }
    }

    for code in &different {
        eprintln!(
            "error: {} at {} bits: the words counted are not those committed in {}",
            code.named.name,
            code.bits,
            codes::COMMITTED_PATH
        );
    }
    for check in report.unexplained() {
        eprintln!(
            "error: {}: {}: {} of {} passed the CRCs, against the theory",
            check.object,
            check.patterns,
            check.injected.accepted + check.injected.identifier,
            check.injected.tried
        );
    }
    let sound = different.is_empty() && report.unexplained().next().is_none();
    Ok(if sound { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn committed() -> Result<Vec<(Code, DualWeights)>> {
    let dual = |code: Code| {
        let dual = code.committed().with_context(|| {
            format!(
                "{} has no line for {} at {} bits: count it with --store",
                codes::COMMITTED_PATH,
                code.named.name,
                code.bits
            )
        })?;
        Ok((code, dual))
    };
    Code::all().into_iter().map(dual).collect()
}

fn count(threads: NonZero<usize>) -> Vec<(Code, DualWeights)> {
    let all = Code::all();
    let style = ProgressStyle::with_template("{bar:40} {percent} % of {msg}, {eta} left").expect("a constant template");
    let bar = ProgressBar::new((all.len() as f64 * PARTS) as u64).with_style(style);
    let began = Instant::now();
    let mut longest = (Duration::ZERO, "");
    let duals = all
        .iter()
        .enumerate()
        .map(|(i, code)| {
            bar.set_message(format!("the dual codes' words: {} at {} bits", code.named.name, code.bits));
            let began = Instant::now();
            let dual = code.count(threads, &|part| bar.set_position(((i as f64 + part) * PARTS) as u64));
            if began.elapsed() > longest.0 {
                longest = (began.elapsed(), code.named.name);
            }
            (*code, dual)
        })
        .collect();
    bar.finish_and_clear();
    eprintln!(
        "counted the words of {} dual codes in {:.0} s on {threads} thread(s), {:.1} s for the longest ({})",
        all.len(),
        began.elapsed().as_secs_f64(),
        longest.0.as_secs_f64(),
        longest.1
    );
    duals
}

fn write(path: &Path, text: &str) -> Result<()> {
    std::fs::write(path, text).with_context(|| format!("could not write {}", path.display()))
}
