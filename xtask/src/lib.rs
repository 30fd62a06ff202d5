//! Workspace tasks: `cargo xtask <command>`.
//!
//! One program builds both firmwares, runs them against each other on the bench, tests everything, checks sizes against
//! budgets and flashes the boards. Each command has a module; this file has the command line.
//!
//! The exit codes are 0 for success, 1 for a failed check (reported on standard error), 2 for a wrong command line.

#[cfg(any(feature = "probe", test))]
mod access;
mod bench_flash;
#[cfg(feature = "probe")]
mod bench_probe;
mod campaign;
mod citations;
mod coverage;
mod defects;
#[cfg(test)]
mod design;
mod figures;
mod firmware;
mod fuzz;
mod gdb;
mod header;
mod judge;
mod layout;
mod lint;
#[cfg(feature = "live")]
mod live;
mod oracle;
mod output;
mod package;
#[cfg(feature = "probe")]
mod probe;
mod release;
mod residual;
mod run;
mod seal;
mod sim;
mod size;
mod speed;
mod style;
mod test;
mod timing;
mod trace;
mod web;
mod workspace;

use std::process::ExitCode;

use anyhow::Result;
use bench::faults::Kind;
use clap::{Args, Parser, Subcommand, ValueEnum};
use emulator_node::Target;

/// Builds, tests, flashes and simulates the HORUS link.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Build firmware images in release; both boards unless one is named.
    Build(BuildArgs),
    /// Build an image, write it to a board through a debug probe, verify it and show its log.
    Flash(FlashArgs),
    /// Run both firmware images against each other on the bench.
    Sim(sim::SimArgs),
    /// Try faults on copies of the running link, each alone: masked, recovered, stopped or dangerous, with bounds.
    Campaign(campaign::CampaignArgs),
    /// Run the link with gdb, or an editor that uses its protocol, at one of the boards.
    Gdb(gdb::GdbArgs),
    /// Run the link in real time, and show its base station's page.
    Live(LiveArgs),
    /// Write the whole system as a page without a server, into target/page.
    Web,
    /// Judge an event log again that `sim --events` stored.
    Judge(judge::JudgeArgs),
    /// Search for the longest executions of every task, and bound its response time against its deadline.
    Timing(timing::TimingArgs),
    /// Measure instructions per second of the core alone, and where the time of `sim` goes.
    Speed(speed::SpeedArgs),
    /// Run any ELF alone on one board of the bench: its log, its exit code, its faults.
    Run(run::RunArgs),
    /// Run every test: host, fuzz corpora, both images, on-target suites.
    Test(test::TestArgs),
    /// Print each image's flash and RAM against its budget; over budget fails.
    Size(SizeArgs),
    /// Check line length, citations, the C header, the layouts and formatting, then run clippy with warnings as errors,
    /// for host and target, and build the documentation likewise.
    Lint,
    /// Residual error of the profile's two CRCs: exact weights, probabilities, claims; writes docs/safety.
    Residual(residual::ResidualArgs),
    /// Write docs/figures.md and README's sample of a run from fresh runs, or check that they are current.
    Figures(figures::FiguresArgs),
    /// Write the C header of the flight controller's client from the profile's layouts, or check that it is current.
    Header(header::GeneratedArgs),
    /// Write the layout of all objects for machines, and the Python package's module of them, or check that both are
    /// current.
    Layout(header::GeneratedArgs),
    /// Fuzz the parsers of the profile and of the base station with cargo-fuzz.
    Fuzz(fuzz::FuzzArgs),
    /// Run a table of defects of the sources against the judge, each in a copy of the workspace.
    Defects(defects::DefectsArgs),
    /// Trace each requirement to its evidence and to what broke it; writes docs/safety/trace.md.
    Trace(trace::TraceArgs),
    /// Object-code coverage of the flight images: what the bench's runs executed of them, and which branches went both
    /// ways.
    Coverage(coverage::CoverageArgs),
    /// Package the crates that others can use, and build each from its tarball.
    Package,
    /// Compare the bench's core with QEMU (qemu-system-arm) and with LLVM's disassembler (llvm-tools), case by case.
    Oracle(oracle::OracleArgs),
}

/// One of the two boards of the link.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Board {
    /// The nRF52840-DK, which is the dual-ported RAM.
    Dpr,
    /// The NUCLEO-F429ZI, which is the HORUS side.
    Horus,
}

impl Board {
    pub(crate) const ALL: [Self; 2] = [Self::Dpr, Self::Horus];

    pub(crate) const fn package(self) -> &'static str {
        match self {
            Self::Dpr => "dpr-fw",
            Self::Horus => "horus-tx-fw",
        }
    }

    /// The board's name on the command line and in the on-target test suite.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Dpr => "dpr",
            Self::Horus => "horus",
        }
    }

    pub(crate) const fn on_bench(self) -> Target {
        match self {
            Self::Dpr => Target::Nrf52840,
            Self::Horus => Target::Stm32f429,
        }
    }
}

/// An image that can be written to a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Image {
    /// The DPR's, for an nRF52840-DK.
    Dpr,
    /// HORUS's, for a NUCLEO-F429ZI.
    Horus,
    /// The active hold's, for a second nRF52840-DK.
    Hold,
}

impl Image {
    pub(crate) const ALL: [Self; 3] = [Self::Dpr, Self::Horus, Self::Hold];

    /// The name on the command line and of the on-target test suite.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Dpr => "dpr",
            Self::Horus => "horus",
            Self::Hold => "hold",
        }
    }

    /// The board whose microcontroller the image is for.
    pub(crate) const fn board(self) -> Board {
        match self {
            Self::Dpr | Self::Hold => Board::Dpr,
            Self::Horus => Board::Horus,
        }
    }
}

/// The number of GNSS receivers in the profile (1, 2, 3 or 5).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Receivers(pub(crate) usize);

impl Receivers {
    pub(crate) const ALL: [Self; 4] = [Self(1), Self(2), Self(3), Self(5)];
    pub(crate) const DEFAULT: Self = Self(3);

    pub(crate) fn feature(self) -> String {
        format!("gps-{}", self.0)
    }
}

impl std::fmt::Display for Receivers {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

impl std::str::FromStr for Receivers {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|n| n.0.to_string() == text)
            .ok_or_else(|| "the profile exists for 1, 2, 3 or 5 receivers".to_owned())
    }
}

#[derive(Args)]
struct BuildArgs {
    /// The board to build for; both if none is named.
    #[arg(value_enum)]
    board: Option<Board>,
    /// GNSS receivers in the profile: 1, 2, 3 or 5.
    #[arg(long, default_value_t = Receivers::DEFAULT)]
    gps: Receivers,
    /// Build the DPR's firmware with the port of an active hold, and the hold's firmware.
    #[arg(long, conflicts_with = "board")]
    hold: bool,
}

#[derive(Args)]
struct SizeArgs {
    /// GNSS receivers in the profile: 1, 2, 3 or 5.
    #[arg(long, default_value_t = Receivers::DEFAULT)]
    gps: Receivers,
}

#[derive(Args, Clone)]
pub(crate) struct FlashArgs {
    /// The firmware to write, to a board that it is for.
    #[arg(value_enum)]
    pub(crate) image: Image,
    /// With `dpr`: the image that has the port of an active hold.
    #[arg(long)]
    pub(crate) hold: bool,
    /// GNSS receivers in the profile: 1, 2, 3 or 5.
    #[arg(long, default_value_t = Receivers::DEFAULT)]
    pub(crate) gps: Receivers,
    /// End after showing the log for this many seconds: of virtual time on the bench, where the default is 1. A real
    /// board's log is shown until it is interrupted (Ctrl-C) by default.
    #[arg(long, value_parser = sim::positive_seconds)]
    pub(crate) seconds: Option<f64>,
    #[command(flatten)]
    pub(crate) probe: ProbeArgs,
}

/// The debug probe, and its speed.
#[derive(Args, Clone)]
pub(crate) struct ProbeArgs {
    /// The probe, as VID:PID or VID:PID:SERIAL; needed when more than one is connected. Or `bench`: that of the board
    /// on the bench, which keeps its flash below target/bench (`bench:dpr`, `bench:horus`: of that board's).
    #[arg(long, value_name = "VID:PID[:SERIAL]|bench")]
    pub(crate) probe: Option<String>,
    /// SWD clock in kHz; the probe's own default if absent.
    #[arg(long, value_name = "KHZ", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) speed: Option<u32>,
    /// If the board's debug port is locked, unlock it by erasing everything on it: flash, and an nRF52840's UICR.
    #[arg(long)]
    pub(crate) erase_all: bool,
}

/// The options of the link in real time.
#[derive(Args, Clone)]
pub(crate) struct LiveArgs {
    /// Virtual time to run, in seconds; without it, until it is interrupted (Ctrl-C), at most a day.
    #[arg(long, value_parser = sim::positive_seconds)]
    pub(crate) seconds: Option<f64>,
    /// GNSS receivers in the profile: 1, 2, 3 or 5.
    #[arg(long, default_value_t = Receivers::DEFAULT)]
    pub(crate) gps: Receivers,
    /// Seed of everything random: flight, receivers' noise, faults.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Faults to inject, drawn from the seed: a list of air, gnss, fc, power, buffers, inputs, hang, hold.
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub(crate) faults: Vec<Kind>,
    /// TCP port of the page on 127.0.0.1; 0 selects a free one.
    #[arg(long, default_value_t = 8480)]
    pub(crate) port: u16,
    /// TCP port on 127.0.0.1 of the panel that injects faults; 0 selects a free one.
    #[arg(long, default_value_t = 8481)]
    pub(crate) panel_port: u16,
    /// Virtual time divided by real time, up to 100; 0 runs as fast as possible.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = pace)]
    pub(crate) pace: f64,
    /// Allow users of the page to send uplinks of the base station to the DPR.
    #[arg(long)]
    pub(crate) uplink: bool,
    /// Put an active hold beside the DPR, which then has its second port, and allow users of the page to command it.
    #[arg(long, conflicts_with = "uplink")]
    pub(crate) hold: bool,
    /// The percentage of messages that the radio between flight controller and base station loses, each way.
    #[arg(long, value_name = "PERCENT", default_value_t = 0, value_parser = clap::value_parser!(u64).range(0..=90))]
    pub(crate) loss: u64,
}

fn pace(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(pace) if pace == 0.0 || (0.01..=100.0).contains(&pace) => Ok(pace),
        _ => Err("expected a factor from 0.01 to 100, or 0".to_owned()),
    }
}

/// Runs the command that the command line names, and returns its exit code.
#[must_use]
pub fn main() -> ExitCode {
    match dispatch(Cli::parse().command) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn dispatch(command: Command) -> Result<ExitCode> {
    match command {
        Command::Build(args) => {
            for board in args.board.map_or(Board::ALL.to_vec(), |board| vec![board]) {
                println!("{}", firmware::build(board, args.gps)?.display());
            }
            if args.hold {
                println!("{}", firmware::build_dpr_with_hold(args.gps)?.display());
                println!("{}", firmware::build_hold()?.display());
            }
            Ok(ExitCode::SUCCESS)
        }
        Command::Flash(args) => flash(&args),
        Command::Sim(args) => sim::sim(&args),
        Command::Campaign(args) => campaign::campaign(&args),
        Command::Gdb(args) => gdb::gdb(&args),
        Command::Live(args) => live(&args),
        Command::Web => web::web(),
        Command::Judge(args) => judge::run(&args),
        Command::Timing(args) => timing::timing(&args),
        Command::Speed(args) => speed::speed(&args),
        Command::Run(args) => run::run(&args),
        Command::Test(args) => test::test(&args),
        Command::Size(args) => size::size(args.gps),
        Command::Lint => lint::lint(),
        Command::Package => package::package(),
        Command::Residual(args) => residual::residual(&args),
        Command::Figures(args) => figures::figures(&args),
        Command::Header(args) => header::header(&args),
        Command::Layout(args) => layout::layout(&args),
        Command::Fuzz(args) => fuzz::fuzz(&args),
        Command::Defects(args) => defects::defects(&args),
        Command::Trace(args) => trace::trace(&args),
        Command::Coverage(args) => coverage::coverage(&args),
        Command::Oracle(args) => oracle::oracle(&args),
    }
}

#[cfg(feature = "probe")]
fn flash(args: &FlashArgs) -> Result<ExitCode> {
    probe::flash(args)
}

#[cfg(not(feature = "probe"))]
fn flash(_args: &FlashArgs) -> Result<ExitCode> {
    workspace::again_with("probe")
}

#[cfg(feature = "live")]
fn live(args: &LiveArgs) -> Result<ExitCode> {
    live::live(args)
}

#[cfg(not(feature = "live"))]
fn live(_args: &LiveArgs) -> Result<ExitCode> {
    workspace::again_with("live")
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn a_pace_is_a_factor_or_as_fast_as_it_goes() {
        for text in ["-1", "0.001", "101", "nan", "inf", "fast"] {
            assert!(pace(text).is_err(), "{text}");
        }
        assert_eq!((pace("0"), pace("0.5"), pace("100")), (Ok(0.0), Ok(0.5), Ok(100.0)));
    }

    #[test]
    fn receivers_other_than_the_profiles_are_refused_with_the_choice() {
        for text in ["0", "4", "6", "three", "03", ""] {
            assert!(text.parse::<Receivers>().unwrap_err().contains("1, 2, 3 or 5"));
        }
        assert_eq!("5".parse(), Ok(Receivers(5)));
    }
}
