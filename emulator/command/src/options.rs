//! Runs any ELF alone on one board: a cargo runner for the on-target tests and for other projects.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use emulator_gdb::{self as gdb, Ended, serve_alone};
use emulator_node::{Clock, Connected, Drive, Event, Firmware, Limits, LogLine, Outcome, Sending, SentByte};
use emulator_part::{Pad, Pin};

use crate::{Board, ProbeArgs};

#[derive(Args)]
pub(crate) struct RunArgs {
    /// The board on which the file runs.
    #[arg(long, value_enum)]
    board: Board,
    /// The ELF file.
    #[arg(value_name = "FILE.elf")]
    elf: PathBuf,
    /// Stop after this much virtual time, in seconds; an image that is still running then fails. Bench only.
    #[arg(long, default_value_t = 60.0, value_parser = crate::sim::positive_seconds, conflicts_with = "seconds")]
    limit: f64,
    /// The image is meant to run for ever: end after this much virtual time, in seconds, as a success. Bench only.
    #[arg(long, value_parser = crate::sim::positive_seconds)]
    seconds: Option<f64>,
    /// Print each change of a pin with its virtual time: P0.13 on the dpr board, PB7 on horus. Any number. Bench only.
    #[arg(long, value_name = "PIN")]
    pin: Vec<String>,
    /// Drive a pin from outside, from power-on or from this many milliseconds on: P0.11=0, PC13=1@250. Any number.
    /// Bench only.
    #[arg(long, value_name = "PIN=0|1[@MS]")]
    drive: Vec<String>,
    /// Join two pins by a wire: P0.02=P0.03. Levels and UART frames that the firmware puts on either arrive at the
    /// other. Any number. Bench only.
    #[arg(long, value_name = "PIN=PIN")]
    wire: Vec<String>,
    /// Write what the firmware sends from a UART's pin to a file, byte for byte, or with `-` to standard output, by
    /// lines with their virtual time: P0.06=out.bin. Any number. Bench only.
    #[arg(long, value_name = "PIN=FILE|-")]
    uart: Vec<String>,
    /// Send a file, or standard input with `-`, to a UART's pin, 8N1, so many bits a second, from 100 ms or so many
    /// milliseconds on: P0.08@115200=in.bin, P0.08@115200@2500=more.bin. Any number, also to one pin. Bench only.
    #[arg(long, value_name = "PIN@BAUD[@MS]=FILE|-")]
    uart_in: Vec<String>,
    /// The cost of processor time: fast, optimistic or pessimistic. The last two bound what silicon takes: on
    /// the optimistic one a delay loop takes the least that silicon may take. Bench only.
    #[arg(long, default_value_t = Clock::Optimistic)]
    clock: Clock,
    /// Halt the board at power-on and wait for gdb, or an editor that uses its protocol. Bench only.
    #[arg(long)]
    gdb: bool,
    /// The port on 127.0.0.1 to wait for gdb at; 0 selects a free one.
    #[arg(long, default_value_t = gdb::PORT, requires = "gdb")]
    port: u16,
    /// The place where the file runs.
    #[arg(long, value_enum, default_value_t = Place::Bench)]
    on: Place,
    #[command(flatten)]
    probe: ProbeArgs,
}

/// The place where code for the boards runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Place {
    /// The emulated boards: no hardware needed.
    Bench,
    /// A real board on a debug probe.
    Hardware,
}

pub(crate) fn run(args: &RunArgs) -> Result<ExitCode> {
    match args.on {
        Place::Bench => on_bench(args),
        Place::Hardware if args.gdb => {
            bail!("--gdb is for the bench: at a board, OpenOCD or `probe-rs gdb` wait for a debugger")
        }
        Place::Hardware => on_hardware(args),
    }
}

fn on_bench(args: &RunArgs) -> Result<ExitCode> {
    let firmware = Firmware::read(&args.elf)?;
    if let Some(hint) = linked_elsewhere(args.board, &firmware) {
        eprintln!("{hint}");
    }
    let (connected, mut files) = leads(args)?;
    let seconds = args.seconds.unwrap_or(args.limit);
    let limits = Limits { virtual_time: (seconds * 1e9) as u64, ..Limits::default() };
    let mut output = Output { stdout: std::io::stdout(), closed: false, half: BTreeMap::new() };
    let began = Instant::now();
    let mut unwritten = None;
    let mut event = |event: Event<'_>| match event {
        Event::Line(line) => output.line(line),
        Event::Finding(finding) => eprintln!("{finding}"),
        Event::Reset(reset) => eprintln!("{:>14.6} ms  the part restarted {}", milliseconds(reset.at), reset.why()),
        Event::Pin(edge) => {
            let (name, does) = (pin_name(args.board, edge.pin), pad_text(edge.pad));
            output.text(format_args!("{:>14.6} ms  {name} {does}", milliseconds(edge.at)));
        }
        Event::Byte(heard) => match files.get_mut(&heard.pin) {
            Some((path, file)) => {
                if let Err(error) = file.write_all(&[heard.byte]) {
                    unwritten.get_or_insert_with(|| anyhow::Error::new(error).context(format!("--uart: {path}")));
                }
            }
            None => output.byte(heard),
        },
    };
    let target = args.board.on_bench();
    let outcome = if args.gdb {
        let run = target.start(args.clock, &firmware, connected, limits)?;
        let connection = gdb::wait(args.port, args.board.name(), &args.elf, &mut |text| eprintln!("{text}"))?;
        match serve_alone(run, args.seconds.is_some(), connection, &mut event, &mut |error| gdb::say_lost(&error)) {
            Ended::Finished(outcome) => Ok(*outcome),
            Ended::Killed(at) => Err(at),
        }
    } else {
        Ok(target.run_connected(args.clock, &firmware, connected, limits, event)?)
    };
    output.finish();
    for (path, file) in files.values_mut() {
        file.flush().with_context(|| format!("--uart: {path}"))?;
    }
    if let Some(error) = unwritten {
        return Err(error);
    }
    let outcome = match outcome {
        Ok(outcome) => outcome,
        Err(killed_at) => {
            gdb::say_killed(killed_at);
            return Ok(ExitCode::FAILURE);
        }
    };
    eprintln!("{}", summary(&outcome, args.clock));
    // With a debugger, the duration of a run does not show the speed of this machine.
    if !args.gdb {
        let seconds = began.elapsed().as_secs_f64();
        eprintln!("{:.0} million instructions a second of this machine", outcome.instructions as f64 / 1e6 / seconds);
    }
    if let Some(hint) = said_nothing(args, &firmware, &outcome) {
        eprintln!("{hint}");
    }
    Ok(ending(args, &outcome))
}

fn linked_elsewhere(board: Board, firmware: &Firmware) -> Option<String> {
    // A program for the nRF52840 is loaded at address 0, where the STM32 has flash too. But it was linked for other
    // addresses.
    const STM32_FLASH: u64 = 0x0800_0000;
    let lies_below = firmware.segments().iter().all(|(address, _)| *address < STM32_FLASH);
    (board == Board::Horus && lies_below).then(|| {
        let name = firmware.name();
        format!(
            "{name} has nothing at {STM32_FLASH:#010x}, where the STM32F429 has its flash: is it linked for this part?"
        )
    })
}

fn said_nothing(args: &RunArgs, firmware: &Firmware, outcome: &Outcome) -> Option<&'static str> {
    if !outcome.lines.is_empty() || !args.uart.is_empty() {
        return None;
    }
    Some(if firmware.has_defmt() {
        "It logged nothing. Which of its defmt messages are compiled in, DEFMT_LOG says as it is built: DEFMT_LOG=info."
    } else {
        "It printed nothing. Text comes over RTT, by semihosting, or from a UART with --uart PIN=-."
    })
}

fn ending(args: &RunArgs, outcome: &Outcome) -> ExitCode {
    let (says, status) = verdict(args.seconds, args.limit, outcome);
    if let Some(says) = says {
        eprintln!("{says}");
    }
    u8::try_from(status).map_or(ExitCode::FAILURE, ExitCode::from)
}

/// Returns a message about the run, if one is needed, and the run's status. The run was meant to take `seconds`, or
/// else at most `limit`.
fn verdict(seconds: Option<f64>, limit: f64, outcome: &Outcome) -> (Option<String>, u32) {
    if outcome.exit.is_none() && !outcome.died {
        let restarts = match outcome.resets {
            0 => String::new(),
            1 => ", after a restart".to_owned(),
            count => format!(", after {count} restarts"),
        };
        let doing = &outcome.doing;
        if let Some(seconds) = seconds {
            let well = outcome.findings.is_empty() && !outcome.stopped_itself;
            let (error, whether) = if well { ("", "") } else { ("error: ", "not ") };
            let says = format!(
                "{error}still running after {seconds} s of virtual time, {whether}as it should (--seconds){restarts}: \
                 {doing}"
            );
            return (Some(says), u32::from(!well));
        }
        let says = format!(
            "error: still running after {limit} s of virtual time (--limit){restarts}: {doing}\n\
             If it is meant to run on for ever, say --seconds instead."
        );
        return (Some(says), outcome.status());
    }
    // If the bench has found an error, the run fails even if the firmware reports success.
    (None, if outcome.status() == 0 && !outcome.passed() { 1 } else { outcome.status() })
}

type Files = BTreeMap<Pin, (String, BufWriter<File>)>;

fn leads(args: &RunArgs) -> Result<(Connected, Files)> {
    let pin = |option: &str, name: &str| {
        pin_called(args.board, name).with_context(|| {
            let example = match args.board {
                Board::Dpr => "P0.13",
                Board::Horus => "PB7",
            };
            format!("--{option}: {name} is no pin of the {} board; one is called like {example}", args.board.name())
        })
    };
    let mut connected = Connected::default();
    let mut files = Files::new();
    for name in &args.pin {
        connected.watched.push(pin("pin", name)?);
    }
    for text in &args.drive {
        let (name, level) = text.split_once('=').with_context(|| format!("--drive {text}: expected PIN=0 or PIN=1"))?;
        let (level, ms) = level.split_once('@').unwrap_or((level, "0"));
        let level = match level {
            "0" => false,
            "1" => true,
            _ => bail!("--drive {text}: expected PIN=0 or PIN=1"),
        };
        let ms: f64 = ms
            .parse()
            .ok()
            .filter(|ms| (0.0..1e9).contains(ms))
            .with_context(|| format!("--drive {text}: expected a number of milliseconds behind the @"))?;
        connected.driven.push(Drive { at: (ms * 1e6) as u64, pin: pin("drive", name)?, level });
    }
    for text in &args.uart {
        let (name, path) = text.split_once('=').with_context(|| format!("--uart {text}: expected PIN=FILE"))?;
        let pin = pin("uart", name)?;
        connected.listened.push(pin);
        if path != "-" {
            let file = File::create(path).with_context(|| format!("--uart: could not write {path}"))?;
            files.insert(pin, (path.to_owned(), BufWriter::new(file)));
        }
    }
    for text in &args.wire {
        let (one, other) = text.split_once('=').with_context(|| format!("--wire {text}: expected PIN=PIN"))?;
        let ends = [pin("wire", one)?, pin("wire", other)?];
        if ends[0] == ends[1] {
            bail!("--wire {text}: expected two pins");
        }
        connected.wires.push(ends);
    }
    for text in &args.uart_in {
        let parts = text.split_once('=').and_then(|(lead, path)| Some((lead.split_once('@')?, path)));
        let ((name, rest), path) = parts.with_context(|| format!("--uart-in {text}: expected PIN@BAUD=FILE"))?;
        let (baud, ms) = rest.split_once('@').unwrap_or((rest, "100"));
        let ms = ms.parse().ok().filter(|ms| (0.0..1e9).contains(ms));
        let ms: f64 = ms.with_context(|| format!("--uart-in {text}: expected a number of milliseconds"))?;
        let baud = baud.parse().ok().filter(|baud| (1..=10_000_000).contains(baud));
        let baud = baud.with_context(|| format!("--uart-in {text}: expected 1 to 10000000 bits a second"))?;
        let read = match path {
            "-" => std::io::read_to_string(std::io::stdin()).map(String::into_bytes),
            path => std::fs::read(path),
        };
        let bytes = read.with_context(|| format!("--uart-in: could not read {path}"))?;
        connected.sent.push(Sending { at: (ms * 1e6) as u64, pin: pin("uart-in", name)?, baud, bytes });
    }
    Ok((connected, files))
}

/// Returns the pin with this name of the chip's maker: P0.13, P1.02 on the nRF52840; PB7, PC13 on the STM32.
fn pin_called(board: Board, name: &str) -> Option<Pin> {
    let rest = name.strip_prefix(['P', 'p'])?;
    let (port, number) = match board {
        Board::Dpr => {
            let (port, number) = rest.split_once('.')?;
            (port.parse().ok().filter(|port| *port < 2)?, number.parse().ok()?)
        }
        Board::Horus => {
            let port = rest.chars().next()?.to_ascii_uppercase();
            let number = rest.get(1..)?.parse().ok()?;
            (u8::try_from(u32::from(port).checked_sub(u32::from('A'))?).ok().filter(|port| *port < 11)?, number)
        }
    };
    // The nRF52840's P1 ends at P1.15, and the STM32's ports in this package have at most 16 pins.
    let pins = if board == Board::Dpr && port == 0 { 32 } else { 16 };
    (number < pins).then(|| Pin::new(port, number))
}

fn pin_name(board: Board, pin: Pin) -> String {
    match board {
        Board::Dpr => format!("P{}.{:02}", pin.port, pin.number),
        Board::Horus => format!("P{}{}", char::from(b'A' + pin.port), pin.number),
    }
}

const fn pad_text(pad: Pad) -> &'static str {
    match pad {
        Pad::Driven(true) => "high",
        Pad::Driven(false) => "low",
        Pad::Pulled(true) => "pulled high",
        Pad::Pulled(false) => "pulled low",
        Pad::Floating => "floats",
    }
}

struct Output<W> {
    stdout: W,
    /// Whether the reader has closed the output, as `head` does. The run continues, because its exit code is still
    /// needed.
    closed: bool,
    /// For each UART, the bytes of the unfinished line and the instant of the first one, ns.
    half: BTreeMap<Pin, (u64, Vec<u8>)>,
}

const LONGEST_LINE: usize = 4096;

impl<W: Write> Output<W> {
    /// Shows a line of the log. A line without a time stamp gets the virtual time at which the probe read it, up to 1
    /// ms after it was written.
    fn line(&mut self, line: &LogLine) {
        if line.timestamp.is_empty() {
            self.text(format_args!("{:>14.6} ms  {line}", milliseconds(line.at)));
        } else {
            self.text(format_args!("{line}"));
        }
    }

    fn byte(&mut self, SentByte { at, pin, byte }: SentByte) {
        let (_, bytes) = self.half.entry(pin).or_insert((at, vec![]));
        if byte != b'\n' {
            bytes.push(byte);
        }
        if (byte == b'\n' || bytes.len() == LONGEST_LINE)
            && let Some((at, bytes)) = self.half.remove(&pin)
        {
            self.half_line(at, &bytes);
        }
    }

    fn half_line(&mut self, at: u64, bytes: &[u8]) {
        let line = String::from_utf8_lossy(bytes);
        self.text(format_args!("{:>14.6} ms  {}", milliseconds(at), line.trim_end_matches('\r')));
    }

    fn finish(&mut self) {
        for (at, bytes) in std::mem::take(&mut self.half).into_values() {
            self.half_line(at, &bytes);
        }
    }

    fn text(&mut self, text: std::fmt::Arguments<'_>) {
        self.closed = self.closed || writeln!(self.stdout, "{text}").is_err();
    }
}

fn milliseconds(ns: u64) -> f64 {
    ns as f64 / 1e6
}

fn summary(outcome: &Outcome, clock: Clock) -> String {
    let findings = outcome.findings.len();
    let resets = outcome.resets;
    let stack = match outcome.stack {
        // The firmware's own RAM test writes to the whole stack, so the use of the stack is not known.
        Some((used, size)) if used == size => format!(", all {size} bytes of the stack written"),
        Some((used, size)) => format!(", stack {used} of {size} bytes at worst"),
        None => String::new(),
    };
    format!(
        "{:.3} ms of virtual time, load {:.1} %{stack}, {findings} finding{}, {resets} restart{}, \
         {:.3} million instructions on the {clock} clock",
        milliseconds(outcome.virtual_time),
        outcome.load * 100.0,
        if findings == 1 { "" } else { "s" },
        if resets == 1 { "" } else { "s" },
        outcome.instructions as f64 / 1e6,
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
    use emulator_node::LogLevel;

    use super::*;

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
    fn a_pin_is_called_as_its_maker_calls_it() {
        for (board, name, pin) in [
            (Board::Dpr, "P0.13", Some(Pin::new(0, 13))),
            (Board::Dpr, "P1.05", Some(Pin::new(1, 5))),
            (Board::Dpr, "P1.16", None),
            (Board::Dpr, "P2.00", None),
            (Board::Dpr, "PA5", None),
            (Board::Horus, "PA5", Some(Pin::new(0, 5))),
            (Board::Horus, "pc13", Some(Pin::new(2, 13))),
            (Board::Horus, "PA16", None),
            (Board::Horus, "PZ1", None),
            (Board::Horus, "P0.13", None),
            (Board::Horus, "P", None),
        ] {
            assert_eq!(pin_called(board, name), pin, "{board:?} {name}");
            if let Some(pin) = pin {
                assert_eq!(pin_name(board, pin), name.to_uppercase());
            }
        }
    }

    #[test]
    fn a_firmware_that_has_stopped_itself_is_not_running_as_it_should() {
        let outcome = Outcome {
            exit: None,
            died: false,
            virtual_time: 1_000_000_000,
            lines: vec![],
            findings: vec![],
            resets: 0,
            load: 1.0,
            instructions: 0,
            stack: None,
            doing: "it runs in main".to_owned(),
            stopped_itself: false,
        };
        let (says, status) = verdict(Some(1.0), 60.0, &outcome);
        assert_eq!(says.unwrap(), "still running after 1 s of virtual time, as it should (--seconds): it runs in main");
        assert_eq!(status, 0);
        let (says, status) = verdict(Some(1.0), 60.0, &Outcome { stopped_itself: true, ..outcome.clone() });
        assert!(says.unwrap().starts_with("error: still running after 1 s of virtual time, not as it should"));
        assert_eq!(status, 1);
        assert_eq!(verdict(None, 60.0, &outcome).1, 124);
    }

    #[test]
    fn text_gets_virtual_time_and_stops_when_its_reader_closes() {
        let line = |timestamp: &str, text: &str| LogLine {
            at: 1_500_000,
            timestamp: timestamp.to_owned(),
            level: LogLevel::None,
            channel: String::new(),
            text: text.to_owned(),
        };
        let mut output = Output { stdout: Pipe(vec![], 2), closed: false, half: BTreeMap::new() };
        ["", "0.001"].into_iter().for_each(|timestamp| output.line(&line(timestamp, "hello")));
        assert!(!output.closed);
        output.line(&line("", "too late"));
        assert!(output.closed);
        output.stdout.1 = 9;
        output.line(&line("", "never"));
        assert_eq!(String::from_utf8(output.stdout.0).unwrap(), "      1.500000 ms  hello\n0.001 hello\n");
    }

    #[test]
    fn lines_of_a_uart_get_the_time_of_their_first_byte() {
        let mut output = Output { stdout: vec![], closed: false, half: BTreeMap::new() };
        let (one, other) = (Pin::new(0, 6), Pin::new(0, 8));
        for (at, pin, byte) in [(1, one, b'a'), (2, other, b'x'), (3, one, b'b'), (4, one, b'\r'), (5, one, b'\n')] {
            output.byte(SentByte { at: at * 1_000_000, pin, byte });
        }
        output.byte(SentByte { at: 6_000_000, pin: one, byte: b'\n' });
        output.finish();
        let text = String::from_utf8(output.stdout).unwrap();
        assert_eq!(text, "      1.000000 ms  ab\n      6.000000 ms  \n      2.000000 ms  x\n");
    }
}
