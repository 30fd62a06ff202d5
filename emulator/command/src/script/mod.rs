//! Runs a script line by line. A line begins when the line before it is done.
//!
//! | what is looked at | from when |
//! |---|---|
//! | text of the log, of a UART; restarts | everything since what the last `expect` of it found |
//! | edges of a pin | since the last `drive`, `release`, `send`, `reset` or `run`, or the edge found last at this pin |

mod heard;
mod line;

use std::collections::{BTreeMap, VecDeque};
use std::io::BufRead;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use emulator_node::{AnyRun, Event, FindingKind, FromOutside, Outcome, PROBE_PERIOD, Target};
use emulator_part::Pin;

use crate::output::milliseconds;
use heard::Heard;
use line::{Command, Deed, code, parse};

/// The source of a script's lines. Lines of standard input are read as they come.
enum Source {
    File(VecDeque<Numbered>),
    Input(Box<dyn BufRead>),
}

struct Numbered {
    number: usize,
    text: String,
    command: Command,
}

struct Waiting {
    of: Numbered,
    until: u64,
}

/// A script and its progress.
pub(crate) struct Script {
    name: String,
    target: Target,
    source: Source,
    number: usize,
    /// The pins that the lines so far have connected to UARTs, with their rates in bits per second.
    uarts: BTreeMap<Pin, u32>,
    heard: Heard,
    waiting: Option<Waiting>,
    exited: bool,
    ended: Option<std::result::Result<(), String>>,
}

impl Script {
    /// Reads the script `path`. With `-` it begins to read standard input.
    ///
    /// # Errors
    ///
    /// The file cannot be read, or a line is wrong.
    pub(crate) fn open(path: &Path, target: Target, run: &mut dyn AnyRun) -> Result<Self> {
        let is_input = path.as_os_str() == "-";
        let mut script = Self {
            name: if is_input { "standard input".to_owned() } else { path.display().to_string() },
            target,
            source: Source::Input(Box::new(std::io::stdin().lock())),
            number: 0,
            uarts: BTreeMap::new(),
            heard: Heard::default(),
            waiting: None,
            exited: false,
            ended: None,
        };
        if !is_input {
            let text =
                std::fs::read_to_string(path).with_context(|| format!("--script: could not read {}", script.name))?;
            let mut lines = VecDeque::new();
            for (line, number) in text.lines().zip(1..) {
                let Some(numbered) = script.read(number, line)? else { continue };
                if let Some(Numbered { number: end, command: Command::Pass | Command::Fail(_), .. }) = lines.back() {
                    bail!("{} line {number}: the script ended with the verdict of line {end}", script.name);
                }
                if let Command::Watch(pin)
                | Command::Expect(Deed::Edge(pin, _), _)
                | Command::Never(Deed::Edge(pin, _), _) = numbered.command
                {
                    script.heard.watch(run, pin);
                }
                lines.push_back(numbered);
            }
            if !matches!(lines.back(), Some(Numbered { command: Command::Pass | Command::Fail(_), .. })) {
                bail!("{} line {}: expected pass or fail, and the script ends", script.name, text.lines().count() + 1);
            }
            script.source = Source::File(lines);
        }
        Ok(script)
    }

    fn read(&mut self, number: usize, line: &str) -> Result<Option<Numbered>> {
        let wrong = |error| anyhow!("{} line {number}: {error}", self.name);
        let pins = self.target.pins();
        let Some(command) = parse(line, &pins, self.target.name()).map_err(wrong)? else { return Ok(None) };
        match command {
            Command::Uart(pin, baud) => drop(self.uarts.insert(pin, baud)),
            Command::Send(pin, _) if !self.uarts.contains_key(&pin) => {
                let name = pins.name(pin);
                return Err(wrong(format!(
                    "expected a line like \"uart {name} 115200\" before what is sent to {name}"
                )));
            }
            _ => {}
        }
        Ok(Some(Numbered { number, text: code(line).to_owned(), command }))
    }

    fn next(&mut self) -> Result<Option<Numbered>> {
        loop {
            let line = match &mut self.source {
                Source::File(lines) => return Ok(lines.pop_front()),
                Source::Input(input) => {
                    let mut line = String::new();
                    match input.read_line(&mut line).context("--script: could not read standard input")? {
                        0 => return Ok(None),
                        _ => line,
                    }
                }
            };
            self.number += 1;
            if let Some(numbered) = self.read(self.number, &line)? {
                return Ok(Some(numbered));
            }
        }
    }

    pub(crate) fn is_over(&self) -> bool {
        self.ended.is_some()
    }

    pub(crate) fn has_passed(&self) -> bool {
        self.ended == Some(Ok(()))
    }

    /// Returns the verdict of the script on a run with this outcome: what has failed, if anything.
    pub(crate) fn verdict(&self, outcome: &Outcome) -> std::result::Result<(), String> {
        self.ended.clone().unwrap_or_else(|| Err("the script did not come to its end".to_owned()))?;
        let is_meant = |kind| self.exited && kind == FindingKind::ExitStatus;
        match outcome.findings.iter().filter(|finding| !is_meant(finding.kind)).count() {
            0 => Ok(()),
            1 => Err("the script passed, but the run has a finding".to_owned()),
            count => Err(format!("the script passed, but the run has {count} findings")),
        }
    }

    /// Begins the script's next line, or runs the firmware for a part of the time for which the present line waits.
    /// Passes the answer to each finished line to `say`.
    ///
    /// # Errors
    ///
    /// A line of standard input is wrong.
    pub(crate) fn go(
        &mut self,
        run: &mut dyn AnyRun,
        event: &mut dyn FnMut(Event<'_>),
        say: &mut dyn FnMut(&str),
    ) -> Result<()> {
        let waiting = match self.waiting.take() {
            Some(waiting) => waiting,
            None => match self.next()? {
                Some(of) => {
                    let until = run.node().now() + self.begin(&of.command, run);
                    Waiting { of, until }
                }
                None => {
                    self.fail(run, self.number + 1, "expected pass or fail, and the script ends", say);
                    return Ok(());
                }
            },
        };
        // The firmware may have done what the line expects before the line began.
        let mut done = self.done(&waiting, run);
        if done.is_none() {
            self.run_piece(&waiting, run, event);
            done = self.done(&waiting, run);
        }
        let Waiting { of, until } = waiting;
        match done {
            Some(Ok(at)) => {
                say(&format!("ok {} at {:.6} ms: {}", of.number, milliseconds(at), of.text));
                if of.command == Command::Pass {
                    self.ended = Some(Ok(()));
                }
            }
            Some(Err(text)) => self.fail(run, of.number, &text, say),
            None => self.waiting = Some(Waiting { of, until }),
        }
        Ok(())
    }

    fn fail(&mut self, run: &mut dyn AnyRun, number: usize, text: &str, say: &mut dyn FnMut(&str)) {
        say(&format!("failed {number} at {:.6} ms: {text}", milliseconds(run.node().now())));
        self.ended = Some(Err(format!("{} line {number}: {text}", self.name)));
    }

    /// Carries out the immediate effect of a command. Returns the time, ns, for which the command waits.
    fn begin(&mut self, command: &Command, run: &mut dyn AnyRun) -> u64 {
        self.heard.begin_line();
        match command {
            Command::Drive(..) | Command::Release(_) | Command::Send(..) | Command::Reset | Command::Run(_) => {
                self.heard.forget_edges();
            }
            _ => {}
        }
        match command {
            Command::Watch(pin) => self.heard.watch(run, *pin),
            Command::Drive(pin, level) => run.drive(*pin, Some(*level)),
            Command::Release(pin) => run.drive(*pin, None),
            Command::Uart(pin, _) => run.drive(*pin, Some(true)),
            Command::Send(pin, bytes) => {
                if let Some(baud) = self.uarts.get(pin) {
                    run.send(*pin, *baud, bytes);
                }
            }
            Command::Reset => run.node().restart(FromOutside::Pin),
            Command::Run(time) => return *time,
            Command::Expect(deed, time) | Command::Never(deed, time) => {
                if let Deed::Edge(pin, _) = deed {
                    self.heard.watch(run, *pin);
                }
                return *time;
            }
            Command::Check(..) | Command::Pass | Command::Fail(_) => {}
        }
        0
    }

    fn run_piece(&mut self, waiting: &Waiting, run: &mut dyn AnyRun, event: &mut dyn FnMut(Event<'_>)) {
        let (awaited, period) = match &waiting.of.command {
            Command::Expect(deed, _) | Command::Never(deed, _) => match deed {
                Deed::Edge(pin, _) | Deed::Sent(pin, _) => (Some(*pin), u64::MAX),
                Deed::Logged(_) | Deed::Exit(_) => (None, PROBE_PERIOD),
                Deed::Restart => (None, u64::MAX),
            },
            _ => (None, u64::MAX),
        };
        let to = waiting.until.min(run.node().now().saturating_add(period));
        run.wait_for(awaited);
        run.go_to(to, &mut |happened| {
            self.heard.take(&happened);
            event(happened);
        });
        run.wait_for(None);
    }

    /// Returns the instant (ns) at which a line was done, or what has failed; `None` while it waits.
    fn done(&mut self, waiting: &Waiting, run: &mut dyn AnyRun) -> Option<std::result::Result<u64, String>> {
        let pins = self.target.pins();
        let now = run.node().now();
        let over = run.is_over() || now >= waiting.until;
        let cannot_go_on = |run: &mut dyn AnyRun, heard: &Heard| match run.node().exit_status() {
            Some(status) => format!("the firmware exited with status {status}"),
            None => heard.end(now, &run.node().doing()),
        };
        match &waiting.of.command {
            Command::Expect(deed, time) => {
                if let Some(at) = self.heard.find(deed, run).filter(|at| *at <= waiting.until) {
                    self.exited |= matches!(deed, Deed::Exit(_));
                    return Some(Ok(at));
                }
                let shown = deed.shown(&pins);
                over.then(|| {
                    let (came, end) = (self.heard.came(deed, run), cannot_go_on(run, &self.heard));
                    Err(format!("expected {shown} within {}: {came}; {end}", duration(*time)))
                })
            }
            Command::Never(deed, time) => {
                if let Some(at) = self.heard.find(deed, run).filter(|at| *at <= waiting.until) {
                    let (shown, time) = (deed.shown(&pins), duration(*time));
                    return Some(Err(format!(
                        "expected not {shown} for {time}: it came at {:.6} ms",
                        milliseconds(at)
                    )));
                }
                match over {
                    true if run.is_over() => Some(Err(cannot_go_on(run, &self.heard))),
                    true => Some(Ok(now)),
                    false => None,
                }
            }
            Command::Check(pin, level) => {
                let is = run.node().pin(*pin);
                let word = |level| if level { "high" } else { "low" };
                let wrong = || format!("expected {} {}: it is {}", pins.name(*pin), word(*level), word(is));
                Some(if is == *level { Ok(now) } else { Err(wrong()) })
            }
            Command::Fail(text) => Some(Err(text.clone())),
            Command::Run(_) if run.is_over() => Some(Err(cannot_go_on(run, &self.heard))),
            _ => over.then_some(Ok(now)),
        }
    }
}

/// Formats a time in the unit that makes it a small number.
fn duration(ns: u64) -> String {
    match ns {
        0..1_000 => format!("{ns} ns"),
        1_000..1_000_000 => format!("{} us", ns as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{} ms", ns as f64 / 1e6),
        _ => format!("{} s", ns as f64 / 1e9),
    }
}
