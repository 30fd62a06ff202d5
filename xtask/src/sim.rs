//! Runs both firmwares against each other on the bench, and shows the result on one screen.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use bench::faults::{Faults, Kind};
use bench::report::{Exclusion, Report, Reported, Voter};
use bench::sim::flips::{Flips, flips};
use bench::sim::{Crystals, Flashed, FrontEndConfig, Images, Observer, Outcome, Setup, on_the_link};
use clap::Args;
use emulator_node::{Clock, Threads};
use indicatif::{ProgressBar, ProgressStyle};

use crate::output::Output;
use crate::{Receivers, bench_flash, firmware};

/// The greatest error of a crystal, ppm, that the command line accepts. Real crystals have tens of ppm.
const MAX_PPM: f64 = 1000.0;

/// The length of a step of the run, virtual ns. Ctrl-C ends the run after a step.
const PIECE: u64 = 500_000_000;

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

#[derive(Args)]
pub(crate) struct SimArgs {
    /// Virtual time to run, in seconds.
    #[arg(long, default_value_t = 10.0, allow_negative_numbers = true, value_parser = positive_seconds)]
    seconds: f64,
    /// Seed of everything random: flight, receivers' noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// GNSS receivers in the profile: 1, 2, 3 or 5.
    #[arg(long, default_value_t = Receivers::DEFAULT)]
    gps: Receivers,
    /// The first receiver's data: a log from a real receiver, instead of the generated flight.
    #[arg(long, value_name = "FILE")]
    ubx1: Option<PathBuf>,
    /// The second receiver's data.
    #[arg(long, value_name = "FILE")]
    ubx2: Option<PathBuf>,
    /// The third receiver's data.
    #[arg(long, value_name = "FILE")]
    ubx3: Option<PathBuf>,
    /// The number of solutions a second of every generated receiver, which then refuses another rate: 1 to 40, with a
    /// period of a whole number of milliseconds.
    #[arg(long, value_name = "HZ", value_parser = receiver_hz)]
    receiver_hz: Option<u32>,
    /// Every generated receiver starts with its factory settings: 38 400 bit/s where it has a UART, NMEA only, 1 Hz.
    #[arg(long)]
    factory_settings: bool,
    /// Write the report as JSON to a file, or to standard output with `-`.
    #[arg(long, value_name = "FILE|-")]
    json: Option<PathBuf>,
    /// Write the wires (SPI, IRQ, field, SSI, FRESH, TICK) and both boards' tasks: FILE.fst or FILE.vcd.
    #[arg(long, value_name = "FILE")]
    trace: Option<PathBuf>,
    /// Store the event log, which `cargo xtask judge` judges again.
    #[arg(long, value_name = "FILE")]
    events: Option<PathBuf>,
    /// Draw the flight: ground track, height, each receiver, the voted position, exclusions, time to readable.
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// Faults to inject: a list of air, gnss, fc, power, buffers, inputs, hang, chips, hold, hostile (drawn into the
    /// run from the seed), and of ram, flash, registers (each upset on a copy of the bench, see --upsets).
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    faults: Vec<Kind>,
    /// Flip every bit of every register of both front ends once, for both parts, each on a copy of the bench; with a
    /// number N, every N-th bit.
    #[arg(long, value_name = "EVERY", num_args = 0..=1, default_missing_value = "1")]
    flips: Option<std::num::NonZeroUsize>,
    /// The front ends are ST25R3916, instead of ST25R3916B.
    #[arg(long)]
    st25r3916: bool,
    /// HORUS's front end does not report the end of a transmission while its receiver is off.
    #[arg(long)]
    no_txe: bool,
    /// Put an active hold beside the DPR, which then has its second port.
    #[arg(long, conflicts_with = "from_flash")]
    hold: bool,
    /// Run the images in this folder, horus-tx-fw.elf and dpr-fw.elf (with --hold: dpr-fw-hold.elf and hold-fw.elf),
    /// instead of building them.
    #[arg(long, value_name = "FOLDER", conflicts_with = "from_flash")]
    images: Option<PathBuf>,
    /// Run what `flash --probe bench` wrote to both boards of the bench. It must equal the images as they are built
    /// now.
    #[arg(long)]
    from_flash: bool,
    /// Show both boards' defmt logs as they run.
    #[arg(long)]
    log: bool,
    /// The cost of processor time: fast, optimistic or pessimistic. The last two bound what silicon takes.
    #[arg(long, default_value_t)]
    clock: Clock,
    /// Threads to run on: 1 or 2. The outcome is the same, byte for byte.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=2))]
    threads: u8,
    /// Error of the HORUS board's crystal, in ppm.
    #[arg(long, value_name = "PPM", default_value_t = 8.0, allow_negative_numbers = true, value_parser = ppm)]
    horus_ppm: f64,
    /// Error of the DPR board's crystals, in ppm.
    #[arg(long, value_name = "PPM", default_value_t = -12.0, allow_negative_numbers = true, value_parser = ppm)]
    dpr_ppm: f64,
    /// Error of the flight controller's crystal, in ppm.
    #[arg(long, value_name = "PPM", default_value_t = 25.0, allow_negative_numbers = true, value_parser = ppm)]
    fc_ppm: f64,
}

/// Parses a duration of virtual time: from one cycle of HORUS, 10 ms, to a day.
pub(crate) fn positive_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.01..=86_400.0).contains(&seconds) => Ok(seconds),
        Ok(seconds) if seconds > 0.0 && seconds < 0.01 => Err("a cycle of HORUS takes 0.01 seconds".to_owned()),
        Ok(seconds) if seconds <= 0.0 => Err("no time passes in a run that short".to_owned()),
        Ok(seconds) if seconds > 86_400.0 => Err("a run takes a day at most, 86400 seconds".to_owned()),
        _ => Err("expected a number of seconds from 0.01 to 86400".to_owned()),
    }
}

fn receiver_hz(text: &str) -> Result<u32, String> {
    match text.parse::<u32>() {
        Ok(hz @ 1..=40) if 1_000 % hz == 0 => Ok(hz),
        _ => Err("expected 1, 2, 4, 5, 8, 10, 20, 25 or 40 solutions a second".to_owned()),
    }
}

fn ppm(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(ppm) if ppm.abs() <= MAX_PPM => Ok(ppm),
        _ => Err(format!("expected parts per million between -{MAX_PPM} and {MAX_PPM}")),
    }
}

pub(crate) struct Screen {
    bar: ProgressBar,
    log: bool,
}

impl Screen {
    pub(crate) fn say(&self, text: &str) {
        if self.bar.is_hidden() {
            eprintln!("{text}");
        } else {
            self.bar.println(text);
        }
    }
}

impl Observer for Screen {
    fn progress(&mut self, virtual_ns: u64) {
        self.bar.set_position(virtual_ns / 1_000_000);
    }

    fn log(&mut self, board: &str, line: &str) {
        if self.log {
            self.say(&format!("{board:>5} {line}"));
        }
    }

    fn piece_ns(&self) -> u64 {
        PIECE
    }

    fn ends(&mut self) -> bool {
        INTERRUPTED.load(Ordering::Relaxed)
    }
}

pub(crate) fn sim(args: &SimArgs) -> Result<ExitCode> {
    // A second Ctrl-C ends this program at once.
    let pressed = || {
        if INTERRUPTED.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    };
    ctrlc::set_handler(pressed).context("cannot wait for Ctrl-C")?;
    run(args, |setup, screen| Ok(Some(bench::sim::run(setup, screen)?)))
}

pub(crate) fn report(args: &SimArgs) -> Result<Report> {
    let (horus, dpr) = firmware::build_pair(args.gps)?;
    Ok(bench::sim::run(&setup(args, vec![], Images { horus, dpr }), &mut ())?.report)
}

/// Builds both firmwares, runs the link with them by `go`, and shows the result. If `go` returns `None`, the run was
/// ended early and the command fails.
pub(crate) fn run(args: &SimArgs, go: impl FnOnce(&Setup, &mut Screen) -> Result<Option<Outcome>>) -> Result<ExitCode> {
    let recordings = vec![args.ubx1.clone(), args.ubx2.clone(), args.ubx3.clone()];
    if let Some(beyond) = recordings.iter().skip(args.gps.0).position(Option::is_some) {
        bail!("--ubx{}: this profile has {} receiver(s) only (--gps {})", args.gps.0 + beyond + 1, args.gps, args.gps);
    }
    // Inputs that cannot be read, and outputs that cannot be written, are reported before the build.
    for (option, path) in (1..).zip(&recordings).filter_map(|(number, path)| Some((number, path.as_ref()?))) {
        gnss_sim::Log::open(path).with_context(|| format!("--ubx{option}: {} cannot be played", path.display()))?;
    }
    needs_hold(&args.faults, args.hold)?;
    no_upsets(&args.faults)?;
    if let Some(plot) = args.plot.as_deref().filter(|plot| plot.extension().is_none_or(|ending| ending != "svg")) {
        bail!("--plot: the picture is SVG, and {} does not end in .svg", plot.display());
    }
    let output = |option, path: &Option<PathBuf>| path.as_deref().map(|path| Output::new(option, path)).transpose();
    let json = args.json.clone().filter(|path| path != Path::new("-"));
    let outputs = [
        output("--json", &json)?,
        output("--trace", &args.trace)?,
        output("--events", &args.events)?,
        output("--plot", &args.plot)?,
    ];
    let [json, trace, log, plot] = outputs.each_ref().map(|output| output.as_ref().map(|it| it.path().to_owned()));
    let (horus, dpr, hold) = match (&args.images, args.hold) {
        (Some(folder), true) => {
            let [horus, dpr, hold] =
                ["horus-tx-fw.elf", "dpr-fw-hold.elf", "hold-fw.elf"].map(|name| folder.join(name));
            (horus, dpr, Some(hold))
        }
        (Some(folder), false) => (folder.join("horus-tx-fw.elf"), folder.join("dpr-fw.elf"), None),
        (None, hold) => firmware::build_link(args.gps, hold)?,
    };
    let mut setup = Setup { trace, log, plot, hold, ..setup(args, recordings, Images { horus, dpr }) };
    if args.from_flash {
        setup.flashed = Some(Flashed { horus: flashed(crate::Board::Horus)?, dpr: flashed(crate::Board::Dpr)? });
    }
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} ms of virtual time, {eta} left")
        .expect("a constant template");
    let mut screen = Screen { bar: ProgressBar::new(setup.duration_ns / 1_000_000).with_style(style), log: args.log };
    let began = Instant::now();
    let outcome = go(&setup, &mut screen)?;
    let wall = began.elapsed().as_secs_f64();
    screen.bar.finish_and_clear();
    let Some(mut outcome) = outcome else { return Ok(ExitCode::FAILURE) };
    outcome.report.speed.times_real_time = outcome.report.virtual_seconds / wall;

    let cut = args.seconds - outcome.report.virtual_seconds > 1e-9;
    if cut {
        eprintln!("ended before its time, after {} of {} s", outcome.report.virtual_seconds, args.seconds);
    }
    let flipped = args.flips.filter(|_| !cut).map(|every| flip_all(&setup, every.get())).transpose()?;
    if let Some(flipped) = &flipped {
        eprint!("{flipped}");
    }
    let mut text = table(&outcome.report);
    let excluded = |receiver: usize| outcome.report.voter.exclusions.iter().any(|it| it.receiver == receiver);
    let recorded = |receiver: &usize| setup.recordings.get(receiver - 1).is_some_and(Option::is_some);
    for receiver in (1..=args.gps.0).filter(|receiver| recorded(receiver) && excluded(*receiver)) {
        text.push_str(&format!(
            "GPS{receiver} plays a recording, and the voter compares it with receivers that are elsewhere. \
             `--gps 1` plays it alone.\n"
        ));
    }
    text.push_str(&format!("{}\n", outcome.base));
    let mut report = serde_json::to_string_pretty(&outcome.report).context("the report does not serialise")?;
    report.push('\n');
    // A program may read the JSON from standard output, so the text goes to standard error.
    if args.json.as_deref() == Some(Path::new("-")) {
        eprint!("{text}");
        std::io::stdout().write_all(report.as_bytes()).context("could not write the report")?;
    } else {
        print!("{text}");
    }
    if let Some(path) = json {
        std::fs::write(&path, report).with_context(|| format!("could not write {}", path.display()))?;
    }
    outputs.into_iter().flatten().try_for_each(Output::finish)?;
    let broken = flipped.iter().flat_map(|flipped| &flipped.0).filter(|flip| !flip.holds() || flip.unsaid()).count();
    if outcome.report.violations.is_empty() && broken == 0 {
        return Ok(ExitCode::SUCCESS);
    }
    let violations = outcome.report.violations.len();
    eprintln!("error: {violations} violation(s), {broken} flip(s) not mended or not said");
    Ok(ExitCode::FAILURE)
}

pub(crate) fn needs_hold(faults: &[Kind], hold: bool) -> Result<()> {
    if let Some(kind) = faults.iter().find(|kind| kind.needs_hold())
        && !hold
    {
        bail!("--faults {kind}: there is none without --hold");
    }
    Ok(())
}

pub(crate) fn no_upsets(faults: &[Kind]) -> Result<()> {
    if let Some(kind) = faults.iter().find(|kind| kind.is_upset()) {
        bail!("--faults {kind}: upsets are tried on copies of the link, by `cargo xtask campaign --kinds {kind}`");
    }
    Ok(())
}

/// Flips each `every`-th bit of the front ends' registers, each on a copy of the bench.
fn flip_all(setup: &Setup, every: usize) -> Result<Flips> {
    let style = ProgressStyle::with_template("{spinner} {pos} bits flipped, {elapsed}").expect("a constant template");
    let bar = ProgressBar::new_spinner().with_style(style);
    let flipped = flips(setup, |place, _| place % every == 0, |_| bar.inc(1))?;
    bar.finish_and_clear();
    Ok(flipped)
}

fn flashed(board: crate::Board) -> Result<Vec<u8>> {
    let name = board.name();
    bench_flash::read(board, &bench_flash::file(board))?.with_context(|| {
        format!("nothing was ever flashed to the bench's {name} board: cargo xtask flash {name} --probe bench")
    })
}

pub(crate) fn setup(args: &SimArgs, recordings: Vec<Option<PathBuf>>, images: Images) -> Setup {
    let duration_ns = (args.seconds * 1e9).round() as u64;
    let to_ppb = |ppm: f64| (ppm * 1000.0).round() as i64;
    Setup {
        images,
        hold: None,
        flashed: None,
        gps: args.gps.0,
        duration_ns,
        clock: args.clock,
        threads: if args.threads == 1 { Threads::One } else { Threads::Two },
        seed: args.seed,
        recordings,
        receiver_hz: args.receiver_hz,
        factory_settings: args.factory_settings,
        crystals: Crystals {
            horus_ppb: to_ppb(args.horus_ppm),
            dpr_ppb: to_ppb(args.dpr_ppm),
            flight_controller_ppb: to_ppb(args.fc_ppm),
            hold_ppb: 17_000,
        },
        front_ends: on_the_link(FrontEndConfig {
            txe_with_rx_off: !args.no_txe,
            ..if args.st25r3916 { FrontEndConfig::st25r3916() } else { FrontEndConfig::default() }
        }),
        faults: Faults::drawn(&args.faults, args.gps.0, args.seed, duration_ns),
        writes: true,
        relays: false,
        sweep: None,
        trace: None,
        log: None,
        plot: None,
        wires: false,
    }
}

/// Returns a line with the instant at which Reported-Position ceased to be valid, and the receivers that were silent
/// then.
fn reported_position(reported: &Reported) -> String {
    let seconds = |ns: u64| format!("{:.3} s", ns as f64 / 1e9);
    let cycles = reported.valid_cycles;
    let Some(since) = reported.invalid_since_ns else {
        let end = if cycles == 0 { "never valid" } else { "valid to the end" };
        return format!("{end}, valid in {cycles} cycles read");
    };
    let silent: Vec<String> = (1..)
        .zip(&reported.last_solution_ns)
        // A receiver with a solution after the instant `since` was not silent then.
        .filter(|(_, last)| last.is_none_or(|last| last < since))
        .map(|(receiver, last)| match last {
            Some(last) => format!("GPS{receiver} silent since {}", seconds(*last)),
            None => format!("GPS{receiver} never had a solution"),
        })
        .collect();
    format!("invalid since {} ({}), valid in {cycles} cycles read", seconds(since), silent.join(", "))
}

fn vote(voter: &Voter) -> String {
    let agree = voter.agree.iter().rev().filter(|(agree, cycles)| **agree > 0 && **cycles > 0);
    let agree: Vec<String> = agree
        .enumerate()
        .map(|(nth, (agree, cycles))| {
            format!("{agree}{} in {cycles}{}", [" agree", ""][nth.min(1)], [" cycles", ""][nth.min(1)])
        })
        .collect();
    let agree = if agree.is_empty() { "none ever agreed".to_owned() } else { agree.join(", ") };
    let error = voter.max_error_m.map(|metres| format!("; worst error {metres:.1} m")).unwrap_or_default();
    format!("{agree}; none in {}{error}", voter.none)
}

const MOST_EXCLUSIONS: usize = 5;

fn exclusions(voter: &Voter) -> String {
    let seconds = |ns: u64| format!("{:.2} s", ns as f64 / 1e9);
    let mut text = String::new();
    for exclusion in voter.exclusions.iter().take(MOST_EXCLUSIONS) {
        let until = exclusion.until_ns.map_or("the end".to_owned(), seconds);
        let away = match (exclusion.away_m, exclusion.height_m) {
            (Some(along), Some(height)) => format!(": {along:.0} m off, {height:.0} m in height"),
            (Some(along), None) => format!(": {along:.0} m off"),
            (None, _) => String::new(),
        };
        let Exclusion { receiver, from_ns, .. } = exclusion;
        text.push_str(&format!("  GPS{receiver} excluded       {} to {until}{away}\n", seconds(*from_ns)));
    }
    if let more @ 1.. = voter.exclusions.len().saturating_sub(MOST_EXCLUSIONS) {
        text.push_str(&format!("  and {more} more exclusions\n"));
    }
    text
}

fn hold_in_words(hold: &bench::report::Hold) -> String {
    let commands = |of: bench::report::Commands| {
        format!("{} commands, {} acknowledged, {} lost", of.sent, of.acknowledged, of.lost)
    };
    format!(
        "{:<21} {} frames, {} delivered; {} answers, {} delivered; load {:.1} %\n  {:<19} {} times valid, {} times \
         not\n  {:<19} {}\n  {:<19} {}\n",
        "hold",
        hold.frames_sent,
        hold.frames_delivered,
        hold.answers_sent,
        hold.answers_delivered,
        hold.load * 100.0,
        "read by the client",
        hold.read,
        hold.vacant,
        "base station",
        commands(hold.base_station),
        "flight controller",
        commands(hold.flight_controller),
    )
}

fn faults_in_words(faults: &bench::report::Faults) -> String {
    if faults.injected.is_empty() {
        return "none injected".to_owned();
    }
    let count: u64 = faults.injected.values().sum();
    let cycles = |cycles: Option<u64>| cycles.map_or("none measured".to_owned(), |cycles| format!("{cycles} cycles"));
    let (all, plain) = (cycles(faults.max_recovery_cycles), cycles(faults.max_recovery_cycles_without_bring_up));
    format!(
        "{count} injected of {} kinds; {} invalid shown as valid; longest recovery {all}, {plain} where no front \
         end had to be brought up again",
        faults.injected.len(),
        faults.invalid_shown_valid
    )
}

pub(crate) fn table(report: &Report) -> String {
    let ms = |ns: u64| format!("{:.3} ms", ns as f64 / 1e6);
    let us = |ns: u64| format!("{:.3} us", ns as f64 / 1e3);
    let or_none = |text: Option<String>| text.unwrap_or_else(|| "none".to_owned());
    let Report { horus, air, dpr, latency_ns: latency, ssi, reported, base, .. } = report;
    let since = match dpr.since_ns {
        0 => String::new(),
        since => format!(" since its start at {:.3} s", since as f64 / 1e9),
    };
    let rows = [
        (
            "run",
            format!(
                "{} s, {} receiver(s), seed {}, {} clock, {:.1} x real time",
                report.virtual_seconds, report.gps, report.seed, report.clock, report.speed.times_real_time
            ),
        ),
        ("HORUS", format!("{} frames sent, load {:.1} %", horus.frames_sent, horus.load * 100.0)),
        ("  period", or_none(horus.period_ns.map(|span| format!("{} .. {}", ms(span.min), ms(span.max))))),
        (
            "  tick to command",
            or_none(horus.tick_to_command_ns.map(|span| {
                format!("{} .. {} (jitter {} ns, the firmware's)", us(span.min), us(span.max), span.width())
            })),
        ),
        (
            "  tick to air",
            or_none(horus.tick_to_air_ns.map(|span| {
                format!(
                    "{} .. {} (jitter {} ns, with the front end's scatter)",
                    us(span.min),
                    us(span.max),
                    span.width()
                )
            })),
        ),
        (
            "air",
            format!(
                "{} bit/s, {} a frame; {} delivered, {} damaged, {} lost",
                air.bit_rate,
                ms(air.air_time_ns),
                air.frames_delivered,
                air.frames_damaged,
                air.frames_lost
            ),
        ),
        (
            "DPR",
            format!(
                "{} objects accepted, {} rejected, {} frames missed{since}, load {:.1} %",
                dpr.objects_accepted,
                dpr.objects_rejected,
                dpr.frames_missed,
                dpr.load * 100.0
            ),
        ),
        ("  scrubs", format!("{}, {} found a stuck bit{since}", dpr.scrubs, dpr.scrub_faults)),
        (
            "sample to readable",
            or_none(
                latency
                    .sample_to_readable
                    .map(|it| format!("median {}, 99.9 % {}, worst {}", ms(it.p50), ms(it.p999), ms(it.max))),
            ),
        ),
        ("last bit to readable", or_none(latency.last_bit_to_readable.map(|it| format!("worst {}", us(it.max))))),
        (
            "SSI",
            format!(
                "{} transactions: {} fresh, {} repeated, {} busy, {} bad CRC; ready again at worst in {}",
                ssi.transactions,
                ssi.fresh,
                ssi.repeated,
                ssi.busy,
                ssi.bad_crc,
                or_none(ssi.ready_ns.map(|it| us(it.max)))
            ),
        ),
        ("Reported-Position", reported_position(reported)),
        ("voter", vote(&report.voter)),
        ("faults", faults_in_words(&report.faults)),
        ("base station", format!("{} profiles, {} bad CRC", base.profiles, base.bad_crc)),
    ];
    let mut text = String::new();
    for (name, value) in rows {
        text.push_str(&format!("{name:<21} {value}\n"));
        if name == "voter" {
            text.push_str(&exclusions(&report.voter));
        }
        if let Some(hold) = report.hold.as_ref().filter(|_| name == "voter") {
            text.push_str(&hold_in_words(hold));
        }
    }
    match report.violations.as_slice() {
        [] => text.push_str("violations            none\n"),
        violations => {
            text.push_str(&format!("violations            {}\n", violations.len()));
            for violation in violations {
                text.push_str(&format!("  ! {violation}\n"));
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_names_every_violation() {
        let report = Report { violations: vec!["a torn read at 12 ms".into()], ..Report::default() };
        assert!(table(&report).contains("! a torn read at 12 ms"));
        assert!(table(&Report::default()).contains("violations            none"));
    }

    #[test]
    fn the_table_shows_when_reported_position_became_invalid_and_why() {
        let mut report = Report::default();
        assert!(table(&report).contains("never valid"), "{}", table(&report));
        report.reported.valid_cycles = 500;
        assert!(table(&report).contains("valid to the end, valid in 500 cycles read"), "{}", table(&report));
        report.reported.invalid_since_ns = Some(12_345_000_000);
        report.reported.last_solution_ns = vec![Some(11_195_000_000), None, Some(19_900_000_000)];
        let line = "Reported-Position     invalid since 12.345 s (GPS1 silent since 11.195 s, \
                    GPS2 never had a solution), \
                    valid in 500 cycles read\n";
        assert!(table(&report).contains(line), "{}", table(&report));
    }

    #[test]
    fn the_table_tells_how_many_receivers_agreed_and_who_was_excluded() {
        let mut report = Report::default();
        assert!(table(&report).contains("voter                 none ever agreed; none in 0\n"), "{}", table(&report));
        let exclusion = Exclusion {
            receiver: 2,
            from_ns: 3_210_000_000,
            until_ns: Some(5_000_000_000),
            away_m: Some(51.4),
            height_m: Some(2.4),
        };
        report.voter = Voter {
            agree: [(0, 14), (1, 0), (2, 4), (3, 980)].into(),
            degraded: 18,
            none: 14,
            max_error_m: Some(1.94),
            exclusions: vec![exclusion],
        };
        let lines = "voter                 3 agree in 980 cycles, 2 in 4; none in 14; worst error 1.9 m\n  \
                     GPS2 excluded       3.21 s to 5.00 s: 51 m off, 2 m in height\n";
        assert!(table(&report).contains(lines), "{}", table(&report));
        let last = Exclusion { until_ns: None, away_m: None, height_m: None, ..exclusion };
        report.voter.exclusions = vec![last; 7];
        let text = table(&report);
        assert_eq!(text.matches("GPS2 excluded       3.21 s to the end\n").count(), 5, "{text}");
        assert!(text.contains("  and 2 more exclusions\n"), "{text}");
    }

    #[test]
    fn lengths_of_time_outside_a_day_are_refused() {
        for (text, why) in [
            ("0", "no time passes"),
            ("-1", "no time passes"),
            ("0.001", "a cycle of HORUS"),
            ("nan", "expected a number"),
            ("inf", "a day at most"),
            ("86401", "a day at most"),
            ("ten", "expected a number"),
        ] {
            let error = positive_seconds(text).unwrap_err();
            assert!(error.starts_with(why) || error.contains(why), "{text}: {error}");
        }
        assert_eq!(["0.01", "0.5", "86400"].map(positive_seconds), [Ok(0.01), Ok(0.5), Ok(86_400.0)]);
    }

    #[test]
    fn the_table_tells_since_when_a_restarted_dpr_counts() {
        let mut report = Report::default();
        assert!(!table(&report).contains("since its start"));
        report.dpr.since_ns = 12_345_000_000;
        assert_eq!(table(&report).matches(" since its start at 12.345 s").count(), 2);
    }
}
