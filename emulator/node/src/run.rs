//! Runs one firmware alone on one board to its end.
//!
//! The run ends when the firmware exits through semihosting, when it dies (a HardFault, an exception without a handler,
//! a lock-up), when it only restarts, or at a limit of virtual time. After a fault the handler runs on for
//! [`LAST_WORDS`], so that its output is received. defmt-test exits with `SYS_EXIT_EXTENDED`; panic-probe ends a failed
//! test in a HardFault.

use std::collections::BTreeMap;
use std::str::FromStr;

use cortex_m4::{Cost, Fast, Optimistic, Pessimistic};
use emulator_part::{Part, Pins};
use nrf52840::Nrf52840;
#[cfg(feature = "target")]
use nrf52840::Settings;
#[cfg(feature = "target")]
use stm32f429::Oscillators;
use stm32f429::Stm32f429;

#[cfg(feature = "target")]
use super::AnyRun;
use super::finding::{Finding, FindingKind};
use super::rtt::LogLine;
use super::{Connected, DrivenEdge, Error, Firmware, Halt, Leads, Node, PinEdge, ResetAt, SentByte, Stack};

/// The clock of the core: what its instructions and exceptions cost, see [`cortex_m4::Cost`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Clock {
    /// A fixed cost, see [`cortex_m4::Fast`].
    #[default]
    Fast,
    /// The fewest cycles of a real Cortex-M4, see [`cortex_m4::Optimistic`].
    Optimistic,
    /// The most cycles of a real Cortex-M4, see [`cortex_m4::Pessimistic`].
    Pessimistic,
}

impl FromStr for Clock {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        match name {
            "fast" => Ok(Self::Fast),
            "optimistic" => Ok(Self::Optimistic),
            "pessimistic" => Ok(Self::Pessimistic),
            _ => Err(format!("no clock called {name}: take fast, optimistic or pessimistic")),
        }
    }
}

impl std::fmt::Display for Clock {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Fast => Fast::NAME,
            Self::Optimistic => Optimistic::NAME,
            Self::Pessimistic => Pessimistic::NAME,
        })
    }
}

/// How long, virtual ns, a firmware runs on after a HardFault or an exception without a handler. In this time a UART at
/// 115 200 baud sends 1 150 bytes.
const LAST_WORDS: u64 = 100_000_000;

/// A part on which a firmware can run alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// The nRF52840.
    Nrf52840,
    /// The STM32F429ZI, whose option bytes set brown-out level 3.
    Stm32f429,
}

impl FromStr for Target {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        match name.to_ascii_lowercase().as_str() {
            "nrf52840" => Ok(Self::Nrf52840),
            "stm32f429zi" => Ok(Self::Stm32f429),
            _ => Err(format!("there is no model of a part called {name}: take nrf52840 or stm32f429zi")),
        }
    }
}

impl Target {
    /// The part's name, as its maker writes it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Nrf52840 => Nrf52840::NAME,
            Self::Stm32f429 => Stm32f429::NAME,
        }
    }

    /// The part's pins.
    #[must_use]
    pub const fn pins(self) -> Pins {
        match self {
            Self::Nrf52840 => Nrf52840::PINS,
            Self::Stm32f429 => Stm32f429::PINS,
        }
    }
}

#[cfg(feature = "target")]
impl Target {
    /// Runs `firmware` on this part with nothing around it, see [`run`].
    ///
    /// # Errors
    ///
    /// Returns the errors of [`run`].
    pub fn run(
        self,
        clock: Clock,
        firmware: &Firmware,
        limits: Limits,
        event: impl FnMut(Event<'_>),
    ) -> Result<Outcome, Error> {
        self.run_connected(clock, firmware, Connected::default(), limits, event)
    }

    /// Runs `firmware` on this part with leads to its pins.
    ///
    /// # Errors
    ///
    /// Returns the errors of [`run`].
    pub fn run_connected(
        self,
        clock: Clock,
        firmware: &Firmware,
        connected: Connected,
        limits: Limits,
        mut event: impl FnMut(Event<'_>),
    ) -> Result<Outcome, Error> {
        let mut running = self.start(clock, firmware, connected, limits)?;
        while !running.is_over() {
            running.go(&mut event);
        }
        Ok(running.finish())
    }

    /// Makes a run of `firmware` on this part with leads to its pins, at power-on. The function has no type parameter,
    /// so that the core is compiled with the options of this crate and not of the caller.
    ///
    /// # Errors
    ///
    /// Returns the errors of [`run`].
    pub fn start(
        self,
        clock: Clock,
        firmware: &Firmware,
        connected: Connected,
        limits: Limits,
    ) -> Result<Box<dyn AnyRun>, Error> {
        match clock {
            Clock::Fast => self.start_on::<Fast>(firmware, connected, limits),
            Clock::Optimistic => self.start_on::<Optimistic>(firmware, connected, limits),
            Clock::Pessimistic => self.start_on::<Pessimistic>(firmware, connected, limits),
        }
    }

    fn start_on<C: Cost>(
        self,
        firmware: &Firmware,
        connected: Connected,
        limits: Limits,
    ) -> Result<Box<dyn AnyRun>, Error> {
        Ok(match self {
            Self::Nrf52840 => {
                let part = Nrf52840::new(Settings::default());
                Box::new(Running::<_, C>::new(part, firmware, connected, limits)?)
            }
            Self::Stm32f429 => {
                let part = Stm32f429::new(Oscillators::default()).with_brown_out_level_3();
                Box::new(Running::<_, C>::new(part, firmware, connected, limits)?)
            }
        })
    }
}

/// The limits of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// The virtual time at which the run ends if the firmware does not end it first, in nanoseconds.
    pub virtual_time: u64,
    /// The interval at which output is reported, in virtual nanoseconds.
    pub step: u64,
    /// The number of restarts at which the run ends.
    pub restarts: usize,
}

impl Default for Limits {
    /// The default limits: a minute of virtual time, output every 10 ms, and a hundred restarts.
    fn default() -> Self {
        Self { virtual_time: 60_000_000_000, step: 10_000_000, restarts: 100 }
    }
}

/// What a run reports.
#[derive(Debug)]
pub enum Event<'a> {
    /// The firmware logged a line.
    Line(&'a LogLine),
    /// Something went wrong.
    Finding(&'a Finding),
    /// The part restarted.
    Reset(&'a ResetAt),
    /// A watched pin changed.
    Pin(&'a PinEdge),
    /// The level driven from outside onto a watched pin changed.
    Driven(&'a DrivenEdge),
    /// The part sent a byte from a pin whose UART frames are collected.
    Byte(SentByte),
}

/// The outcome of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The status with which the firmware exited, or `None` if it did not exit.
    pub exit: Option<u32>,
    /// Whether the firmware died in a HardFault, an exception without a handler or a lock-up, or only restarted.
    pub died: bool,
    /// The virtual time that the run took, in nanoseconds.
    pub virtual_time: u64,
    /// All lines that the firmware logged.
    pub lines: Vec<LogLine>,
    /// All findings of the run.
    pub findings: Vec<Finding>,
    /// The number of the part's restarts.
    pub resets: usize,
    /// The share of the time in which the core was awake, from 0 to 1.
    pub load: f64,
    /// The number of instructions that the core executed.
    pub instructions: u64,
    /// The most stack, bytes, that was used, and the size of the stack; `None` if the stack's address is not known.
    pub stack: Option<(usize, usize)>,
    /// What the core was doing at the end, in words.
    pub doing: String,
    /// Whether the firmware had stopped itself for good, see [`Node::stopped_itself`].
    pub stopped_itself: bool,
}

impl Outcome {
    /// Whether the firmware exited with status 0 and without findings.
    #[must_use]
    pub fn passed(&self) -> bool {
        self.exit == Some(0) && self.findings.is_empty()
    }

    /// The exit status for a host process: the firmware's own status, 101 if the firmware died (as for a panic), or 124
    /// if the run reached the limit (as for `timeout`).
    #[must_use]
    pub fn status(&self) -> u32 {
        status(self.exit, self.died)
    }
}

fn status(exit: Option<u32>, died: bool) -> u32 {
    match exit {
        _ if died => 101,
        Some(status) => status,
        None => 124,
    }
}

/// Runs `firmware` on `part` with nothing around it, and reports to `event` as the run goes on.
///
/// # Errors
///
/// Returns the errors of [`Node::new`].
pub fn run<P: Part, C: Cost>(
    part: P,
    firmware: &Firmware,
    limits: Limits,
    mut event: impl FnMut(Event<'_>),
) -> Result<Outcome, Error> {
    let mut running = Running::<P, C>::new(part, firmware, Connected::default(), limits)?;
    while !running.is_over() {
        running.go(&mut event);
    }
    Ok(running.finish())
}

/// A run of one firmware alone on one board, in pieces. A debugger's halt interrupts a piece and does not change the
/// outcome.
pub struct Running<P: Part, C: Cost> {
    node: Node<Leads<P>, C>,
    limits: Limits,
    stack: Option<Stack>,
    piece: u64,
    told: usize,
    lines: Vec<LogLine>,
    findings: Vec<Finding>,
    died: bool,
    last: u64,
    over: bool,
}

impl<P: Part, C: Cost> Running<P, C> {
    /// Makes the board at power-on.
    ///
    /// # Errors
    ///
    /// Returns the errors of [`Node::new`].
    pub fn new(part: P, firmware: &Firmware, connected: Connected, limits: Limits) -> Result<Self, Error> {
        let mut node = Node::<_, C>::new(part, Leads::new(connected), firmware)?.with_semihosting();
        let stack = Stack::of(firmware, node.part());
        if let Some(stack) = stack {
            node.input(|part, _, _| stack.paint(part));
        }
        let piece = limits.step.min(limits.virtual_time);
        let (lines, findings) = (Vec::new(), Vec::new());
        Ok(Self { node, limits, stack, piece, told: 0, lines, findings, died: false, last: u64::MAX, over: false })
    }

    /// Runs to the end of the piece or to a halt of the board, and reports what happened.
    pub fn go(&mut self, event: &mut dyn FnMut(Event<'_>)) {
        // The run stops at every restart. Otherwise a step could contain very many restarts before their number is
        // checked.
        let restarted = self.node.advance_to_restart(self.piece);
        let halted = self.node.halted().filter(|_| !restarted);
        if let Some(why) = halted {
            self.hand_over(event);
            // The findings of the firmware's end are reported now, so that the debugger's user learns why the firmware
            // has ended.
            if why == Halt::Ended {
                self.take_findings(event);
            }
            return;
        }
        if self.node.resets().len() >= self.limits.restarts && !self.died {
            let text = restart_loop(self.node.resets());
            self.node.find(FindingKind::RestartLoop, None, text);
        }
        let found = self.node.take_findings();
        found.iter().for_each(|finding| self.note_end(finding));
        let ended = self.died && (restarted || self.node.now() >= self.last);
        self.over = ended || self.node.exit_status().is_some() || self.node.now() >= self.limits.virtual_time;
        self.hand_over(event);
        // The lines were logged before the restart, so they are reported first.
        self.node.resets()[self.told..].iter().for_each(|reset| event(Event::Reset(reset)));
        self.told = self.node.resets().len();
        for finding in found {
            event(Event::Finding(&finding));
            self.findings.push(finding);
        }
        if self.over {
            self.take_findings(event);
        }
        self.piece = (self.node.now() + self.limits.step).min(self.limits.virtual_time).min(self.last);
    }

    /// Runs as [`Running::go`] does, but at most to `to` (virtual ns), or to the change or byte for which the leads
    /// wait ([`Leads::wait_for`]).
    pub fn go_to(&mut self, to: u64, event: &mut dyn FnMut(Event<'_>)) {
        self.piece = self.piece.min(to);
        self.go(event);
    }

    fn hand_over(&mut self, event: &mut dyn FnMut(Event<'_>)) {
        let take = |board: &mut Leads<P>| (board.take_edges(), board.take_driven(), board.take_sent());
        let (edges, driven, heard) = self.node.board_mut(take);
        driven.iter().for_each(|edge| event(Event::Driven(edge)));
        heard.into_iter().for_each(|heard| event(Event::Byte(heard)));
        let mut edges = edges.into_iter().peekable();
        for line in if self.over { self.node.finish_log() } else { self.node.take_log() } {
            while let Some(edge) = edges.next_if(|edge| edge.at <= line.at) {
                event(Event::Pin(&edge));
            }
            event(Event::Line(&line));
            self.lines.push(line);
        }
        edges.for_each(|edge| event(Event::Pin(&edge)));
    }

    fn note_end(&mut self, finding: &Finding) {
        if finding.kind.ends_run() {
            self.died = true;
            self.last = self.last.min(match finding.kind {
                FindingKind::HardFault | FindingKind::UnhandledInterrupt => finding.at + LAST_WORDS,
                _ => finding.at,
            });
        }
    }

    fn take_findings(&mut self, event: &mut dyn FnMut(Event<'_>)) {
        for finding in self.node.take_findings() {
            self.note_end(&finding);
            event(Event::Finding(&finding));
            self.findings.push(finding);
        }
    }

    /// Whether the run has ended.
    pub fn is_over(&self) -> bool {
        self.over
    }

    /// The board that runs the firmware.
    pub fn node(&mut self) -> &mut Node<Leads<P>, C> {
        &mut self.node
    }

    /// The status of the run so far, as in [`Outcome::status`]. If there are findings, 1 takes the place of a zero.
    /// `runs_on` says that the firmware is meant to run for ever. A firmware that has not exited then has the exit
    /// status 0.
    pub fn status(&self, runs_on: bool) -> u32 {
        let exit = self.node.exit_status().or(runs_on.then_some(0));
        match status(exit, self.died) {
            0 if !self.findings.is_empty() => 1,
            status => status,
        }
    }

    /// The latest instant at which the run ends, in virtual ns.
    pub fn end(&self) -> u64 {
        self.limits.virtual_time
    }

    /// Ends the run and returns the outcome.
    pub fn finish(self) -> Outcome {
        let Self { node, stack, lines, findings, died, .. } = self;
        Outcome {
            exit: node.exit_status(),
            died,
            virtual_time: node.now(),
            lines,
            findings,
            resets: node.resets().len(),
            load: node.usage().load(),
            instructions: node.instructions(),
            stack: stack.map(|stack| (stack.used(node.part()), stack.size())),
            doing: node.doing(),
            stopped_itself: node.stopped_itself(),
        }
    }
}

fn restart_loop(resets: &[ResetAt]) -> String {
    let mut causes = BTreeMap::<String, usize>::new();
    for reset in resets {
        *causes.entry(reset.why()).or_default() += 1;
    }
    let causes: Vec<String> = causes.iter().map(|(cause, times)| format!("{times} times {cause}")).collect();
    let count = resets.len();
    let causes = causes.join(", ");
    format!("the part restarted {count} times ({causes}): the run ends here, as nothing else is to be expected")
}
