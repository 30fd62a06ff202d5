//! The event log of a run of the link, and its verdict.
//!
//! Boards, chips and their environment write one [`Log`]: what a logic analyser, an antenna and a debug probe would
//! record, with the instant of each event. [`judge`] is a pure function of the log, so a log can be stored and judged
//! again without a bench. This crate uses the wire format (`profile`) and the design's bounds ([`bounds`]), and knows
//! nothing of the firmwares' code. A firmware's own counters supplement the observations from outside.
//!
//! # Where to add a violation
//!
//! A new violation needs a line in [`Violation`], a rule in [`rules`] that finds it, and a row in the bench's table of
//! violations (`bench/tests/violations/`). The run of the row must have this violation and no other. A test fails
//! without the row.
//!
//! # What is excused
//!
//! [`disturbance`] alone determines what each disturbance in the log excuses, and for how long.
//!
//! # How rules are kept apart
//!
//! One cause must lead to one violation. A rule therefore does not report what follows from an earlier fault. It
//! requires a frame only after a tick. It requires an object in the image only if the object reached the DPR's antenna
//! whole, and an object at the base station only if the flight controller has forwarded it.
#![forbid(unsafe_code)]

pub mod bounds;
mod calm;
mod context;
pub mod disturbance;
mod event;
pub mod expectation;
mod figures;
mod hold;
mod log;
pub mod read;
pub mod rules;
#[cfg(test)]
mod testing;
pub mod truth;
mod verdict;
mod violation;

pub use calm::Calm;
pub use context::Context;
pub use disturbance::{Disturbance, Disturbances};
pub use event::{Board, Bytes, Cause, Event, Header, SsiEvent, What};
pub use figures::{Exclusion, Faults, Figures, Max, Quantiles, Span, Voter};
pub use hold::{HoldEvent, HoldFrame};
pub use log::{Log, LogError, LogWriter};
use rules::Rule as _;
pub use verdict::{Broken, Findings, Verdict};
pub use violation::Violation;

/// Judges a log and returns the verdict.
#[must_use]
pub fn judge(log: &Log) -> Verdict {
    let mut judge = Judge::new(&log.header);
    for event in &log.events {
        judge.take(event);
    }
    judge.finish()
}

/// Judges a run like [`judge`], but one event at a time, so that the log need not be kept in memory.
#[derive(Clone, Debug)]
pub struct Judge {
    context: Context,
    rules: rules::Rules,
    findings: Findings,
}

impl Judge {
    /// Returns a judge for a run, before the run's first event.
    #[must_use]
    pub fn new(header: &Header) -> Self {
        Self { context: Context::new(header), rules: rules::Rules::new(header), findings: Findings::default() }
    }

    /// Processes the next event of the log; events must come in order of time.
    pub fn take(&mut self, event: &Event) {
        self.context.take(event);
        self.rules.take(event, &self.context, &mut self.findings);
    }

    /// Returns the violations that were found up to the last event, with their counts.
    #[must_use]
    pub fn findings(&self) -> &Findings {
        &self.findings
    }

    /// Ends the run and returns the verdict.
    #[must_use]
    pub fn finish(mut self) -> Verdict {
        let mut figures = Figures::default();
        self.rules.finish(&self.context, &mut self.findings, &mut figures);
        Verdict { violations: self.findings.into_broken(), figures }
    }
}
