//! Implements [`Subject`] for the bench, so that a campaign can inject upsets into the bench's boards.

use bench_judge::What;
use cortex_m4::Cost;

use super::Bench;
use crate::faults::{Board, Fault, Faults, RunOutcome, Subject, Targets, Upset};
use emulator_node::{Digest, Threads};

impl<C: Cost> Subject for Bench<C> {
    fn run_to(&mut self, at: u64) {
        Bench::run_to(self, at, Threads::Two);
    }

    fn targets(&self, board: Board) -> Targets {
        let targets = match board {
            Board::Horus => Targets::of(self.horus()),
            Board::Dpr => Targets::of(self.dpr()),
        };
        // A program without the necessary symbols has no targets.
        targets.unwrap_or_default()
    }

    fn upset(&mut self, board: Board, upset: Upset) {
        let at = self.now();
        self.add_faults(&Faults::none().with(at, at, Fault::Upset(board, upset)));
    }

    fn outcome(mut self, for_ns: u64) -> RunOutcome {
        let end = self.now() + for_ns;
        self.keep_log();
        Bench::run_to(&mut self, end, Threads::One);
        let finished = self.finish(end);
        let mut digest = Digest::new();
        for event in &finished.log.events {
            if let What::Transaction { selected, miso, .. } = &event.what {
                digest.word(*selected);
                digest.bytes(miso);
            }
        }
        RunOutcome { verdict: finished.verdict, read_digest: digest.finish() }
    }
}
