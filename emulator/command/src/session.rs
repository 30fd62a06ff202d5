//! A run of one firmware alone, with its script, its trace and its debugger.

use anyhow::Result;
use emulator_gdb::World;
use emulator_node::{AnyNode, AnyRun, Event, FromOutside, Outcome};

use crate::script::Script;
use crate::trace::PartTrace;

/// A run of one firmware alone on one microcontroller. A debugger may be connected ([`emulator_gdb::serve`]).
pub struct Session<'a> {
    run: Box<dyn AnyRun>,
    runs_on: bool,
    event: &'a mut dyn FnMut(Event<'_>),
    say: &'a mut dyn FnMut(&str),
    pub(crate) script: Option<Script>,
    pub(crate) trace: Option<PartTrace>,
}

impl<'a> Session<'a> {
    /// Makes a session of `run`. Events of the run are passed to `event`, and the answers of the script to `say`. With
    /// `runs_on` the firmware is meant to run for ever, so the limit of virtual time counts as a success.
    pub fn new(
        run: Box<dyn AnyRun>,
        runs_on: bool,
        event: &'a mut dyn FnMut(Event<'_>),
        say: &'a mut dyn FnMut(&str),
    ) -> Self {
        Self { run, runs_on, event, say, script: None, trace: None }
    }

    /// Ends the run. Returns its outcome, and the verdict of the script if there is one.
    ///
    /// # Errors
    ///
    /// The trace cannot be written.
    pub fn finish(self) -> Result<(Outcome, Option<std::result::Result<(), String>>)> {
        let outcome = self.run.finish();
        if let Some(trace) = self.trace {
            trace.finish()?;
        }
        let verdict = self.script.map(|script| script.verdict(&outcome));
        Ok((outcome, verdict))
    }
}

impl World for Session<'_> {
    type Error = anyhow::Error;

    fn node(&mut self) -> &mut dyn AnyNode {
        self.run.node()
    }

    fn go(&mut self) -> Result<()> {
        if self.is_over() {
            return Ok(());
        }
        let Self { run, event, say, script, trace, .. } = self;
        let mut tee = |happened: Event<'_>| {
            if let Some(trace) = trace.as_mut() {
                trace.take(&happened);
            }
            event(happened);
        };
        match script {
            Some(script) => script.go(run.as_mut(), &mut tee, say)?,
            None => run.go(&mut tee),
        }
        if let Some(trace) = trace {
            trace.go_on(run.node())?;
        }
        Ok(())
    }

    fn is_over(&self) -> bool {
        self.script.as_ref().map_or(self.run.is_over(), Script::is_over)
    }

    fn status(&mut self) -> u8 {
        match &self.script {
            Some(script) => u8::from(!script.has_passed() || self.run.status(true) != 0),
            None => self.run.status(self.runs_on).try_into().unwrap_or(1),
        }
    }

    fn end(&self) -> u64 {
        self.run.end()
    }

    fn now(&mut self) -> u64 {
        self.run.node().now()
    }

    fn pull_reset(&mut self) {
        self.run.node().restart(FromOutside::Pin);
    }
}
