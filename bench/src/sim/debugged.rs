//! Runs the whole link with a debugger at one board. When that board halts, the whole run halts.

use std::io::Write;

use bench_judge::LogWriter;
use cortex_m4::Cost;
use st25r3916_model::AirEvent;

use super::{Bench, Error, Observer, Outcome, Outputs, Programs, STEP, Setup, unwritten};
use crate::boards::{Dpr, Horus};
use crate::faults::Faults;
use emulator_node::{Course, Node, Way};

/// A run of the link whose boards a debugger may halt. A halt does not change the outcome, but the debugger may.
pub struct Debugged<C: Cost> {
    bench: Bench<C>,
    course: Course<AirEvent>,
    kept: Outputs,
    end: u64,
}

impl<C: Cost> Debugged<C> {
    /// Returns the bench at power-on. It uses only one thread, because a halted board also halts the other.
    ///
    /// # Errors
    ///
    /// The errors are those of [`super::run`].
    pub fn new(setup: &Setup) -> Result<Self, Error> {
        Self::begin(setup, Bench::new(setup)?)
    }

    /// Returns the bench at power-on with these firmwares in place of the ELF files of `setup`. The event log is
    /// written to `log`.
    ///
    /// # Errors
    ///
    /// The errors are those of [`Bench::with`], and those of writing to `log`.
    pub fn with(setup: &Setup, programs: &Programs, log: Box<dyn Write>) -> Result<Self, Error> {
        let mut bench = Bench::with(setup, programs)?;
        bench.keep_log();
        let log = LogWriter::new(log, bench.relay.downstream.header()).map_err(|source| unwritten(setup, source))?;
        let mut run = Self::begin(setup, bench)?;
        run.kept.stored = Some(log);
        Ok(run)
    }

    fn begin(setup: &Setup, mut bench: Bench<C>) -> Result<Self, Error> {
        let kept = Outputs::begin(setup, &mut bench)?;
        let course = Course::new(bench.relay.b.now(), setup.duration_ns, STEP);
        Ok(Self { bench, course, kept, end: setup.duration_ns })
    }

    /// Runs until a board halts, for at most another 10 ms of virtual time, or to the end of the run.
    ///
    /// # Errors
    ///
    /// A file that the run writes cannot be written.
    pub fn run(&mut self, observer: &mut dyn Observer) -> Result<Way, Error> {
        if self.course.is_over() {
            return Ok(Way::Reached(self.end));
        }
        let way = self.bench.relay.run_course(&mut self.course);
        if let Way::Reached(reached) = way {
            let (dpr, link) = (&mut self.bench.relay.b, &mut self.bench.relay.downstream);
            link.come_to(reached, dpr);
            self.kept.take(reached, dpr, link, observer)?;
        }
        Ok(way)
    }

    /// Whether the run is over.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.course.is_over()
    }

    /// The end of the run, virtual ns.
    #[must_use]
    pub fn end(&self) -> u64 {
        self.end
    }

    /// HORUS's board.
    pub fn horus(&mut self) -> &mut Node<Horus, C> {
        &mut self.bench.relay.a
    }

    /// The DPR's board.
    pub fn dpr(&mut self) -> &mut Node<Dpr, C> {
        &mut self.bench.relay.b
    }

    /// The instant that both boards have reached, ns. HORUS may be ahead of the DPR by up to 2 ms.
    #[must_use]
    pub fn now(&self) -> u64 {
        self.bench.now()
    }

    /// Adds faults to those of the setup during the run; see [`Bench::add_faults`].
    pub fn add_faults(&mut self, faults: &Faults) {
        self.bench.add_faults(faults);
    }

    /// Returns the outcome of the run, which must be over.
    ///
    /// # Errors
    ///
    /// A file that the run writes cannot be written.
    pub fn finish(self) -> Result<Outcome, Error> {
        self.kept.finish(self.bench, self.end)
    }
}
