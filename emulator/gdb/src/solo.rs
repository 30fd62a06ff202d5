//! A board that runs one firmware alone, with a debugger.

use emulator_node::{AnyNode, AnyRun, Event, FromOutside, Outcome};
use gdbstub::conn::ConnectionExt;

use super::{Ended, World, serve};

struct Solo<'a> {
    run: Box<dyn AnyRun>,
    runs_on: bool,
    event: &'a mut dyn FnMut(Event<'_>),
}

/// Runs one firmware alone on one board to its end, with the debugger on `connection`. The board is halted until the
/// debugger lets it run. The board's events are passed to `event`. An error of the connection is passed to `lost`, and
/// the run continues without a debugger. With `runs_on` the firmware is meant to run for ever, so that the limit of
/// virtual time counts as a success.
///
/// Halts do not change the outcome; only a debugger that changes a register, memory or a pin does.
pub fn serve_alone<T>(
    run: Box<dyn AnyRun>,
    runs_on: bool,
    connection: T,
    event: &mut dyn FnMut(Event<'_>),
    lost: &mut dyn FnMut(String),
) -> Ended<Outcome>
where
    T: ConnectionExt,
    T::Error: std::fmt::Display,
{
    let mut solo = Solo { run, runs_on, event };
    solo.node().halt_at_end(true);
    match serve(solo, connection, lost) {
        Ok(Ended::Finished(solo)) => Ended::Finished(Box::new(solo.run.finish())),
        Ok(Ended::Killed(at)) => Ended::Killed(at),
        Err(never) => match never {},
    }
}

impl World for Solo<'_> {
    type Error = std::convert::Infallible;

    fn node(&mut self) -> &mut dyn AnyNode {
        self.run.node()
    }

    fn go(&mut self) -> Result<(), Self::Error> {
        if !self.run.is_over() {
            self.run.go(self.event);
        }
        Ok(())
    }

    fn is_over(&self) -> bool {
        self.run.is_over()
    }

    fn status(&mut self) -> u8 {
        self.run.status(self.runs_on).try_into().unwrap_or(1)
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
