//! The runs whose instructions count.
//!
//! | run | faults |
//! |---|---|
//! | plain | none |
//! | factory settings | receivers that start with their factory settings |
//! | each kind of fault, and all together | drawn from the seed, as `sim --faults` draws them |
//! | without crystal | HORUS's crystal is dead from its start |
//! | tasks that fault | each task of either board executes an undefined instruction, one after the other |
//! | wrong flash | either board starts with a program that its CRC does not fit |
//! | upsets | bits of RAM, flash and registers, each on a copy of the bench |
//!
//! The last three damage the firmware itself, so the judge's verdict on them is not asked for. In all others a
//! violation makes the run worthless as evidence.

use bench::faults::{Board, Fault, Faults, ImageFault, Kind, PowerFault, tasks_of};

/// The time that a board has from one damage to the next, ns: for the watchdog's reset and the start after it.
const BETWEEN: u64 = 1_200_000_000;

/// How long the code of a task stays damaged, ns. It is mended before the watchdog restarts the board.
const DAMAGED: u64 = 60_000_000;

/// How long the program's CRC stays wrong, ns: over several starts.
const UNSEALED: u64 = 400_000_000;

/// A run of the link.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Run {
    pub(super) name: String,
    pub(super) faults: Faults,
    pub(super) duration_ns: u64,
    pub(super) factory_settings: bool,
    /// Whether a violation makes the run worthless.
    pub(super) judged: bool,
}

/// The addresses of the programs' CRCs: HORUS's and the DPR's.
pub(super) type ProgramCrcs = [u32; 2];

/// Returns the runs of `duration_ns` with faults of `kinds`, and with damaged programs if `crcs` is given.
pub(super) fn runs(kinds: &[Kind], gps: usize, seed: u64, duration_ns: u64, crcs: Option<ProgramCrcs>) -> Vec<Run> {
    let plain =
        Run { name: "plain".into(), faults: Faults::none(), duration_ns, factory_settings: false, judged: true };
    let drawn = |name: String, kinds: &[Kind]| {
        let faults = Faults::drawn(kinds, gps, seed, duration_ns);
        Run { name, faults, ..plain.clone() }
    };
    let kinds: Vec<Kind> = kinds.iter().copied().filter(|kind| !kind.is_upset()).collect();
    let mut runs = vec![plain.clone()];
    runs.extend(kinds.iter().map(|kind| drawn(kind.to_string(), &[*kind])));
    let Some(crcs) = crcs else { return runs };
    runs.push(Run { name: "factory settings".into(), factory_settings: true, ..plain.clone() });
    runs.push(drawn("all kinds".into(), &kinds));
    let dead = Fault::Power(Board::Horus, PowerFault::CrystalDead);
    runs.push(Run {
        name: "without crystal".into(),
        faults: Faults::none().with(0, u64::MAX, dead),
        judged: false,
        ..plain.clone()
    });
    for (board, crc) in [Board::Horus, Board::Dpr].into_iter().zip(crcs) {
        runs.push(damaged(board, crc));
    }
    runs
}

/// A run in which each task of `board` faults, and in which the board then starts with a wrong CRC at the address
/// `crc`.
fn damaged(board: Board, crc: u32) -> Run {
    let mut faults = Faults::none();
    let mut at = BETWEEN;
    for (_, vector) in tasks_of(board) {
        faults = faults.with(at, at + DAMAGED, Fault::Image(board, ImageFault::Faulting((*vector).to_owned())));
        at += BETWEEN;
    }
    let wrong = ImageFault::Patch { address: crc, bytes: vec![0; 4], sealed: false };
    faults = faults.with(at, at + UNSEALED, Fault::Image(board, wrong));
    faults = faults.with(at + 1_000_000, at + 1_000_000, Fault::Power(board, PowerFault::Pin));
    let name = format!("damaged {}", bench::faults::name_of(board));
    Run { name, faults, duration_ns: at + 2 * BETWEEN, factory_settings: false, judged: false }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_that_can_be_drawn_into_a_run_has_a_run() {
        let runs = runs(&Kind::ALL, 3, 1, 4_000_000_000, Some([0x100, 0x200]));
        for kind in Kind::ALL.into_iter().filter(|kind| !kind.is_upset()) {
            let run = runs.iter().find(|run| run.name == kind.to_string()).unwrap();
            assert!(!run.faults.episodes().is_empty() && run.judged, "{kind}");
        }
        let damaged: Vec<_> = runs.iter().filter(|run| run.name.starts_with("damaged")).collect();
        assert_eq!(damaged.len(), 2);
        for (run, board) in damaged.iter().zip([Board::Horus, Board::Dpr]) {
            assert_eq!(run.faults.episodes().len(), tasks_of(board).len() + 2);
        }
    }
}
