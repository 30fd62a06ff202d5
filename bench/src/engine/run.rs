//! One firmware alone on one board, to its end: what `cargo xtask run` and on-target test suites go through.
//!
//! The run ends when the firmware exits through semihosting, when it dies (a panic whose handler faults, a HardFault, a
//! lock-up), or at a limit of virtual time. defmt-test exits with `SYS_EXIT_EXTENDED`; panic-probe ends a failed test
//! in a HardFault.

use std::str::FromStr;

use nrf52840_model::{Nrf52840, Settings};

use super::finding::{Finding, FindingKind};
use super::rtt::LogLine;
use super::{Bare, Error, Firmware, Node, Part};
use crate::stm32f427::{Oscillators, Stm32f427Part};

/// A board a firmware can run on alone, with nothing on its pins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// The DPR's nRF52840.
    Dpr,
    /// The HORUS side's STM32F429.
    Horus,
}

impl FromStr for Target {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        match name {
            "dpr" => Ok(Self::Dpr),
            "horus" => Ok(Self::Horus),
            _ => Err(format!("no board called {name}: take dpr or horus")),
        }
    }
}

impl Target {
    /// Runs `firmware` on this board with nothing around it. See [`run`].
    ///
    /// # Errors
    ///
    /// As [`run`].
    pub fn run(self, firmware: &Firmware, limits: Limits, event: impl FnMut(Event<'_>)) -> Result<Outcome, Error> {
        match self {
            Self::Dpr => run(Nrf52840::new(Settings::default()), firmware, limits, event),
            Self::Horus => run(Stm32f427Part::new(Oscillators::default()), firmware, limits, event),
        }
    }
}

/// How far a run may go, in virtual nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// The run ends here if the firmware does not end it first.
    pub virtual_time: u64,
    /// How often output is handed over.
    pub step: u64,
}

impl Default for Limits {
    /// A minute of virtual time, output every 10 ms.
    fn default() -> Self {
        Self { virtual_time: 60_000_000_000, step: 10_000_000 }
    }
}

/// What a run hands over as it goes.
#[derive(Debug)]
pub enum Event<'a> {
    /// The firmware logged a line.
    Line(&'a LogLine),
    /// Something went wrong.
    Finding(&'a Finding),
}

/// How a run ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// The status the firmware exited with, or `None` where it did not exit.
    pub exit: Option<u32>,
    /// Whether the firmware died: see [`FindingKind::is_fatal`].
    pub died: bool,
    /// The virtual time the run took, in nanoseconds.
    pub virtual_time: u64,
    /// Every line the firmware logged.
    pub lines: Vec<LogLine>,
    /// What went wrong.
    pub findings: Vec<Finding>,
    /// How often the part restarted.
    pub resets: usize,
}

impl Outcome {
    /// Whether the firmware exited with status 0 and did nothing that a person should look at.
    #[must_use]
    pub fn passed(&self) -> bool {
        self.exit == Some(0) && self.findings.is_empty()
    }

    /// The status for a process that stands for this run: the firmware's own, 101 where it died (as a panic of a host
    /// process gives), 124 where it ran into the limit (as `timeout` gives).
    #[must_use]
    pub fn status(&self) -> u32 {
        match self.exit {
            Some(status) if !self.died => status,
            _ if self.died => 101,
            _ => 124,
        }
    }
}

/// Runs `firmware` on `part` with nothing around it, and hands what it says to `event` as it goes.
///
/// # Errors
///
/// What [`Node::new`] refuses.
pub fn run<P: Part>(
    part: P,
    firmware: &Firmware,
    limits: Limits,
    mut event: impl FnMut(Event<'_>),
) -> Result<Outcome, Error> {
    let mut node = Node::new(Bare(part), firmware)?.with_semihosting();
    let (mut lines, mut findings) = (Vec::new(), Vec::new());
    let mut died = false;
    while node.exit_status().is_none() && !died && node.now() < limits.virtual_time {
        node.advance((node.now() + limits.step).min(limits.virtual_time));
        for line in node.take_log() {
            event(Event::Line(&line));
            lines.push(line);
        }
        for finding in node.take_findings() {
            event(Event::Finding(&finding));
            died |=
                matches!(finding.kind, FindingKind::HardFault | FindingKind::UnhandledInterrupt | FindingKind::Lockup);
            findings.push(finding);
        }
    }
    Ok(Outcome {
        exit: node.exit_status(),
        died,
        virtual_time: node.now(),
        lines,
        findings,
        resets: node.resets().len(),
    })
}
