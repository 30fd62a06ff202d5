//! Any ELF alone on one board: the cargo runner of the on-target tests.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use bench::node::{Clock, Event, Firmware, Limits, LogLine, Outcome};
use clap::{Args, ValueEnum};

use crate::{Board, ProbeArgs};

#[derive(Args)]
pub(crate) struct RunArgs {
    /// The board to run it on.
    #[arg(long, value_enum)]
    board: Board,
    /// The ELF file.
    #[arg(value_name = "FILE.elf")]
    elf: PathBuf,
    /// Stop after this much virtual time, in seconds; an image that is still running then fails. Bench only.
    #[arg(long, default_value_t = 60.0, value_parser = crate::sim::positive_seconds)]
    limit: f64,
    /// What processor time costs: fast, optimistic or pessimistic. The last two bound what silicon takes. Bench only.
    #[arg(long, default_value_t)]
    clock: Clock,
    /// Where it runs.
    #[arg(long, value_enum, default_value_t = Place::Bench)]
    on: Place,
    #[command(flatten)]
    probe: ProbeArgs,
}

/// Where target code runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Place {
    /// The emulated boards: no hardware needed.
    Bench,
    /// A board on a debug probe.
    Hardware,
}

pub(crate) fn run(args: &RunArgs) -> Result<ExitCode> {
    match args.on {
        Place::Bench => on_bench(args),
        Place::Hardware => on_hardware(args),
    }
}

fn on_bench(args: &RunArgs) -> Result<ExitCode> {
    let firmware = Firmware::read(&args.elf)?;
    let limits = Limits { virtual_time: (args.limit * 1e9) as u64, ..Limits::default() };
    let mut output = Output { stdout: std::io::stdout(), closed: false };
    let outcome = args.board.on_bench().run(args.clock, &firmware, limits, |event| match event {
        Event::Line(line) => output.line(line),
        Event::Finding(finding) => eprintln!("{finding}"),
        Event::Reset(reset) => eprintln!("{:>14.6} ms  the part restarted {}", milliseconds(reset.at), reset.why()),
    })?;
    eprintln!("{}", summary(&outcome));
    if outcome.exit.is_none() && !outcome.died {
        let restarts = match outcome.resets {
            0 => String::new(),
            1 => ", after a restart".to_owned(),
            count => format!(", after {count} restarts"),
        };
        eprintln!("error: still running after {} s of virtual time (--limit){restarts}: {}", args.limit, outcome.doing);
    }
    // A firmware that says it is well while the bench saw it do wrong is not well.
    let status = if outcome.status() == 0 && !outcome.passed() { 1 } else { outcome.status() };
    Ok(u8::try_from(status).map_or(ExitCode::FAILURE, ExitCode::from))
}

/// Where the firmware's log goes.
struct Output<W> {
    stdout: W,
    /// Who read it went away: a pipe into `head`, say. The run goes on, as its exit code still counts.
    closed: bool,
}

impl<W: Write> Output<W> {
    /// Shows a line. One without a time stamp of the firmware's gets virtual time: when the probe took it, up to 1 ms
    /// after it was written.
    fn line(&mut self, line: &LogLine) {
        if self.closed {
            return;
        }
        let written = if line.timestamp.is_empty() {
            writeln!(self.stdout, "{:>14.6} ms  {line}", milliseconds(line.at))
        } else {
            writeln!(self.stdout, "{line}")
        };
        self.closed = written.is_err();
    }
}

fn milliseconds(ns: u64) -> f64 {
    ns as f64 / 1e6
}

/// What came of a run, in a line.
fn summary(outcome: &Outcome) -> String {
    let findings = outcome.findings.len();
    let resets = outcome.resets;
    format!(
        "{:.3} ms of virtual time, load {:.1} %, {findings} finding{}, {resets} restart{}",
        milliseconds(outcome.virtual_time),
        outcome.load * 100.0,
        if findings == 1 { "" } else { "s" },
        if resets == 1 { "" } else { "s" },
    )
}

#[cfg(feature = "probe")]
fn on_hardware(args: &RunArgs) -> Result<ExitCode> {
    crate::probe::run(args.board, &args.elf, &args.probe)
}

#[cfg(not(feature = "probe"))]
fn on_hardware(_args: &RunArgs) -> Result<ExitCode> {
    crate::workspace::again_with("probe")
}

#[cfg(test)]
mod tests {
    use bench::node::LogLevel;

    use super::*;

    /// A reader that goes away after so many lines.
    struct Pipe(Vec<u8>, usize);

    impl Write for Pipe {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            if self.0.iter().filter(|byte| **byte == b'\n').count() >= self.1 {
                return Err(std::io::ErrorKind::BrokenPipe.into());
            }
            self.0.extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn text_gets_virtual_time_and_a_reader_that_goes_away_is_not_written_to_again() {
        let line = |timestamp: &str, text: &str| LogLine {
            at: 1_500_000,
            timestamp: timestamp.to_owned(),
            level: LogLevel::None,
            channel: String::new(),
            text: text.to_owned(),
        };
        let mut output = Output { stdout: Pipe(vec![], 2), closed: false };
        ["", "0.001"].into_iter().for_each(|timestamp| output.line(&line(timestamp, "hello")));
        assert!(!output.closed);
        output.line(&line("", "too late"));
        assert!(output.closed);
        output.stdout.1 = 9;
        output.line(&line("", "never"));
        assert_eq!(String::from_utf8(output.stdout.0).unwrap(), "      1.500000 ms  hello\n0.001 hello\n");
    }
}
