//! A gdb server for one board of the running link: [`emulator_gdb`] at a run of [`crate::sim`].

use std::fmt::Write as _;

use bench_judge::Board as Side;
use cortex_m4::{Cost, Fast, Optimistic, Pessimistic};
use emulator_gdb::{Ended, World};
use emulator_node::{AnyNode, Clock};
use gdbstub::conn::ConnectionExt;

use crate::faults::plan::LAST_BEFORE_END;
use crate::faults::{Episode, Fault, Faults, Kind, PowerFault};
use crate::sim::{Debugged, Error, Observer, Outcome, Setup};

/// A connection to a debugger. It is boxed, so that the server is compiled here, once for each clock.
pub type Connection = Box<dyn ConnectionExt<Error = std::io::Error>>;

/// Runs the link to its end, with a debugger on `connection` at the board `side`. The board is halted at power-on until
/// the debugger starts it. If the connection fails, `lost` is called with the error, and the run continues without a
/// debugger.
///
/// # Errors
///
/// The errors are those of [`crate::sim::run`].
pub fn serve(
    setup: &Setup,
    side: Side,
    connection: Connection,
    observer: &mut dyn Observer,
    lost: &mut dyn FnMut(String),
) -> Result<Ended<Outcome>, Error> {
    match setup.clock {
        Clock::Fast => serve_on::<Fast>(setup, side, connection, observer, lost),
        Clock::Optimistic => serve_on::<Optimistic>(setup, side, connection, observer, lost),
        Clock::Pessimistic => serve_on::<Pessimistic>(setup, side, connection, observer, lost),
    }
}

fn serve_on<C: Cost>(
    setup: &Setup,
    side: Side,
    connection: Connection,
    observer: &mut dyn Observer,
    lost: &mut dyn FnMut(String),
) -> Result<Ended<Outcome>, Error> {
    let run = Debugged::<C>::new(setup)?;
    let link = Link { run, side, observer, gps: setup.gps, seed: setup.seed };
    Ok(match emulator_gdb::serve(link, connection, lost)? {
        Ended::Finished(link) => Ended::Finished(Box::new(link.run.finish()?)),
        Ended::Killed(at) => Ended::Killed(at),
    })
}

struct Link<'a, C: Cost> {
    run: Debugged<C>,
    side: Side,
    observer: &'a mut dyn Observer,
    gps: usize,
    seed: u64,
}

impl<C: Cost> World for Link<'_, C> {
    type Error = Error;

    const HELP: &'static str = "\
monitor faults LIST             what goes wrong from now on, drawn from the seed as --faults does:
                                of air, gnss, fc, power, buffers, inputs, hang
";

    fn node(&mut self) -> &mut dyn AnyNode {
        match self.side {
            Side::Horus => self.run.horus(),
            Side::Dpr => self.run.dpr(),
        }
    }

    fn go(&mut self) -> Result<(), Error> {
        self.run.run(self.observer).map(drop)
    }

    fn is_over(&self) -> bool {
        self.run.is_over()
    }

    fn status(&mut self) -> u8 {
        0
    }

    fn end(&self) -> u64 {
        self.run.end()
    }

    fn now(&mut self) -> u64 {
        self.run.now()
    }

    /// A fault injects the reset, so that the event log has the reset.
    fn pull_reset(&mut self) {
        let now = self.node().now();
        let fault = Fault::Power(self.side, PowerFault::Pin);
        self.run.add_faults(&Faults::none().with(now, now, fault));
    }

    fn monitor(&mut self, words: &[&str]) -> Option<String> {
        match words {
            ["faults", list] => Some(self.faults(list)),
            _ => None,
        }
    }
}

impl<C: Cost> Link<'_, C> {
    /// Adds faults of the listed kinds from now on. Returns a message for the user.
    fn faults(&mut self, list: &str) -> String {
        let kinds: Result<Vec<Kind>, _> = list.split(',').map(str::parse).collect();
        let kinds = match kinds {
            Ok(kinds) => kinds,
            Err(error) => return format!("{error}\n"),
        };
        if let Some(upset) = kinds.iter().find(|kind| kind.is_upset()) {
            return format!(
                "{upset}: upsets are tried on copies of the bench, by `cargo xtask campaign --kinds {upset}`\n"
            );
        }
        let now = self.run.now();
        let left = self.run.end().saturating_sub(now);
        let drawn = Faults::drawn(&kinds, self.gps, self.seed, left);
        let mut faults = Faults::none();
        for Episode { at, until, fault } in drawn.episodes().iter().cloned() {
            faults.add(Episode { at: now + at, until: until.saturating_add(now), fault });
        }
        self.run.add_faults(&faults);
        let mut text = format!("{} episodes from now to the end\n", faults.episodes().len());
        for Episode { at, fault, .. } in faults.episodes() {
            let _ = writeln!(text, "{:>12.3} ms  {}", *at as f64 / 1e6, fault.name());
        }
        if faults.episodes().is_empty() {
            let _ = writeln!(
                text,
                "too little of the run is left: none lasts into its last {} ms",
                LAST_BEFORE_END / 1_000_000
            );
        }
        text
    }
}
