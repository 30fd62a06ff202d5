//! The options of a run, and what they connect to the part's pins.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use clap::Args;
use emulator_node::{Clock, Connected, Drive, Sending, Target};
use emulator_part::Pin;

/// The options of a run of one firmware alone on one part.
#[derive(Args, Clone, Debug)]
pub struct Options {
    /// Run the lines of this script, or of standard input with `-`: they set pins, send text, wait for what the
    /// firmware does, and end with a verdict.
    #[arg(long, value_name = "FILE|-", conflicts_with_all = ["limit", "seconds"])]
    pub script: Option<PathBuf>,
    /// Stop after this much virtual time, in seconds; an image that is still running then fails.
    #[arg(long, default_value_t = 60.0, value_parser = seconds, conflicts_with = "seconds")]
    pub limit: f64,
    /// The image is meant to run for ever: end after this much virtual time, in seconds, as a success.
    #[arg(long, value_parser = seconds)]
    pub seconds: Option<f64>,
    /// Print each change of a pin with its virtual time: P0.13 on the nRF52840, PB7 on the STM32F429. Any number.
    #[arg(long, value_name = "PIN")]
    pub pin: Vec<String>,
    /// Drive a pin from outside, from power-on or from this many milliseconds on: P0.11=0, PC13=1@250. Any number.
    #[arg(long, value_name = "PIN=0|1[@MS]")]
    pub drive: Vec<String>,
    /// Join two pins by a wire: P0.02=P0.03. Levels and UART frames that the firmware puts on either arrive at the
    /// other. Any number.
    #[arg(long, value_name = "PIN=PIN")]
    pub wire: Vec<String>,
    /// Write what the firmware sends from a UART's pin to a file, byte for byte, or with `-` to standard output, by
    /// lines with their virtual time: P0.06=out.bin. Any number.
    #[arg(long, value_name = "PIN=FILE|-")]
    pub uart: Vec<String>,
    /// Send a file, or standard input with `-`, to a UART's pin, 8N1, so many bits a second, from 100 ms or so many
    /// milliseconds on: P0.08@115200=in.bin, P0.08@115200@2500=more.bin. Any number, also to one pin.
    #[arg(long, value_name = "PIN@BAUD[@MS]=FILE|-")]
    pub uart_in: Vec<String>,
    /// Write the levels of all pins, and when which interrupt's handler runs, to a file for GTKWave or Surfer.
    #[arg(long, value_name = "FILE.fst|FILE.vcd")]
    pub trace: Option<PathBuf>,
    /// The cost of processor time: fast, optimistic or pessimistic. The last two bound what silicon takes: on
    /// the optimistic one a delay loop takes the least that silicon may take.
    #[arg(long, default_value_t = Clock::Optimistic)]
    pub clock: Clock,
    /// Halt the part at power-on and wait for gdb, or an editor that uses its protocol.
    #[arg(long)]
    pub gdb: bool,
    /// The port on 127.0.0.1 to wait for gdb at; 0 selects a free one.
    #[arg(long, default_value_t = emulator_gdb::PORT, requires = "gdb")]
    pub port: u16,
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| (1e-6..=86_400.0).contains(seconds));
    seconds.ok_or_else(|| "expected a number of seconds from 0.000001 to 86400".to_owned())
}

/// Files, one for each UART pin, into which the bytes go that a firmware sends.
#[derive(Default)]
pub(crate) struct Files {
    files: BTreeMap<Pin, (String, BufWriter<File>)>,
    failed: Option<anyhow::Error>,
}

impl Files {
    /// Takes a byte that the firmware sent from `pin`. Returns `false` if there is no file for the pin.
    pub(crate) fn take(&mut self, pin: Pin, byte: u8) -> bool {
        let Some((path, file)) = self.files.get_mut(&pin) else { return false };
        if let Err(error) = file.write_all(&[byte]) {
            self.failed.get_or_insert_with(|| anyhow::Error::new(error).context(format!("--uart: {path}")));
        }
        true
    }

    pub(crate) fn finish(mut self) -> Result<()> {
        for (path, file) in self.files.values_mut() {
            file.flush().with_context(|| format!("--uart: {path}"))?;
        }
        self.failed.map_or(Ok(()), Err)
    }
}

/// Which pins the options connect, and to what.
pub(crate) struct Leads {
    pub(crate) connected: Connected,
    pub(crate) files: Files,
    /// The pins whose changes are printed.
    pub(crate) shown: BTreeSet<Pin>,
    /// The pins of UARTs whose lines are printed.
    pub(crate) printed: BTreeSet<Pin>,
}

pub(crate) fn leads(args: &Options, target: Target) -> Result<Leads> {
    let pins = target.pins();
    let pin = |option: &str, name: &str| {
        let found = pins.find(name);
        found.with_context(|| format!("--{option}: the {} has no pin {name}: it has {pins}", target.name()))
    };
    let mut connected = Connected::default();
    let (mut files, mut shown, mut printed) = (Files::default(), BTreeSet::new(), BTreeSet::new());
    for name in &args.pin {
        let pin = pin("pin", name)?;
        connected.watched.push(pin);
        shown.insert(pin);
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
            files.files.insert(pin, (path.to_owned(), BufWriter::new(file)));
        } else {
            printed.insert(pin);
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
    Ok(Leads { connected, files, shown, printed })
}
