//! Access to the boards of a bench as processors, for an observer of their schedules.

use cortex_m4::{Cost, Fast, Optimistic, Pessimistic};
use emulator_node::{AnyNode, Clock};

use super::{Bench, Error, Finished, Setup};

impl<C: Cost> Bench<C> {
    /// HORUS's board, the DPR's, and the hold's if there is one. Whoever acts on one of them changes the run.
    pub fn processors(&mut self) -> Vec<&mut dyn AnyNode> {
        let hold = self.relay.downstream.hold_board().map(|node| -> &mut dyn AnyNode { node });
        let two: [&mut dyn AnyNode; 2] = [&mut self.relay.a, &mut self.relay.b];
        two.into_iter().chain(hold).collect()
    }
}

/// A function that gets the instant (virtual ns) and the boards ([`Bench::processors`]).
pub type Each<'a> = dyn FnMut(u64, Vec<&mut dyn AnyNode>) + 'a;

/// Runs `setup` on its clock. Calls `each` before the first instruction, every `piece` ns, and at the end. If `logs` is
/// set, the event log is kept.
///
/// # Errors
///
/// An ELF file cannot be loaded, or a recording cannot be played.
pub fn watch(setup: &Setup, piece: u64, logs: bool, each: &mut Each<'_>) -> Result<Finished, Error> {
    match setup.clock {
        Clock::Fast => watch_on::<Fast>(setup, piece, logs, each),
        Clock::Optimistic => watch_on::<Optimistic>(setup, piece, logs, each),
        Clock::Pessimistic => watch_on::<Pessimistic>(setup, piece, logs, each),
    }
}

fn watch_on<C: Cost>(setup: &Setup, piece: u64, logs: bool, each: &mut Each<'_>) -> Result<Finished, Error> {
    let mut bench = Bench::<C>::new(setup)?;
    if logs {
        bench.keep_log();
    }
    let mut reached = 0;
    each(reached, bench.processors());
    while reached < setup.duration_ns {
        reached = reached.saturating_add(piece).min(setup.duration_ns);
        bench.run_to(reached, setup.threads);
        each(reached, bench.processors());
    }
    Ok(bench.finish(reached))
}
