//! The event log of a run of the link, and what is judged of it.
//!
//! Boards, chips and the world beside them write one [`Log`]: what a logic analyser on the wires, an antenna between
//! the boards and a debug probe would see, each with its instant. [`judge`] is a pure function of that log, so a log
//! can be stored, judged again and tested without a bench. It knows the wire format (`profile`) and the design's bounds
//! ([`bounds`]), and nothing of how a firmware is made: what a firmware counts about itself is evidence beside what was
//! seen from outside, never instead of it.
//!
//! # Where to add a violation
//!
//! A line in [`Violation`] says what it is; the rule that finds it is in one of the files of [`rules`]; a row of the
//! bench's table of violations (`bench/tests/violations/`) provokes it and no other. A violation without a row fails
//! that table.
//!
//! # What is excused
//!
//! What the bench does wrong on purpose is in the log with its type, and what each type excuses, from when until when,
//! is in [`disturbance`] alone.
//!
//! # How rules are kept apart
//!
//! One cause shall show as one violation. So each rule asks of a stage only what the stage before it has brought: a
//! frame is asked for where there was a tick, an object is asked to be shown where it reached the DPR's antenna whole,
//! the base station is asked for what the flight controller has forwarded. What is missing at a stage is that stage's
//! violation alone: absence is one, too.
#![forbid(unsafe_code)]

pub mod bounds;
mod context;
pub mod disturbance;
mod event;
pub mod expectation;
mod figures;
mod log;
pub mod read;
pub mod rules;
#[cfg(test)]
mod testing;
pub mod truth;
mod verdict;
mod violation;

pub use context::Context;
pub use disturbance::{Disturbance, Disturbances};
pub use event::{Board, Bytes, Cause, Event, Header, SsiEvent, What};
pub use figures::{Exclusion, Faults, Figures, Max, Quantiles, Span, Voter};
pub use log::{Log, LogError, LogWriter};
use rules::Rule as _;
pub use verdict::{Broken, Findings, Verdict};
pub use violation::Violation;

/// Judges a log.
#[must_use]
pub fn judge(log: &Log) -> Verdict {
    let mut judge = Judge::new(&log.header);
    for event in &log.events {
        judge.take(event);
    }
    judge.finish()
}

/// [`judge`], an event at a time, for a run that is too long to be kept.
#[derive(Clone, Debug)]
pub struct Judge {
    context: Context,
    rules: rules::Rules,
    findings: Findings,
}

impl Judge {
    /// Nothing has happened yet.
    #[must_use]
    pub fn new(header: &Header) -> Self {
        Self { context: Context::new(header), rules: rules::Rules::new(header), findings: Findings::default() }
    }

    /// Takes the next event: events come in order of time.
    pub fn take(&mut self, event: &Event) {
        self.context.take(event);
        self.rules.take(event, &self.context, &mut self.findings);
    }

    /// What was broken so far: how often each violation occurred.
    #[must_use]
    pub fn findings(&self) -> &Findings {
        &self.findings
    }

    /// The run is over.
    #[must_use]
    pub fn finish(mut self) -> Verdict {
        let mut figures = Figures::default();
        self.rules.finish(&self.context, &mut self.findings, &mut figures);
        Verdict { violations: self.findings.into_broken(), figures }
    }
}
