//! The runs whose instructions count.
//!
//! | run | faults |
//! |---|---|
//! | plain | none |
//! | factory settings | receivers that start with their factory settings |
//! | each kind of fault, and all together | drawn from the seed, as `sim --faults` draws them |
//! | without crystal | HORUS's crystal is dead from its start |
//! | crystal fails | HORUS's crystal dies in flight |
//! | tasks out of order | each task of either board is dead, and then runs although nothing has called it |
//! | chips broken at the start | either board restarts beside each way in which its front end's chip can fail |
//! | all values | receivers state all kinds of values: [`super::values`] |
//! | every message | a receiver sends each UBX message that the parser knows, in many lengths |
//! | tasks that fault | each task of either board executes an undefined instruction, one after the other |
//! | wrong flash | either board starts with a program that its CRC does not fit |
//! | hold: ... | [`super::hold_runs`] |
//! | listener: ..., dpr: ... | [`super::dpr_runs`] |
//! | what fails in turn | each failure of air, a chip, the flight controller, a register, a buffer, RAM, a receiver |
//! | upsets | bits of RAM, flash and registers, each on a copy of the bench |
//!
//! In the plain run, with factory settings and with drawn faults, a violation makes the run worthless as evidence. The
//! others damage more at once than the link must bear, or the firmware itself, so the judge's verdict is not asked for.

use super::dpr_runs::dpr_runs;
use super::hold_runs::hold_runs;
use super::horus_runs::horus_runs;
use super::run::{Addresses, Run};
use super::{messages, scripted, values};
use bench::faults::{Board, ChipFault, Fault, Faults, ImageFault, Kind, PowerFault, tasks_of};

/// The time that a board has from one damage to the next, ns: for the watchdog's reset and the start after it.
const BETWEEN: u64 = 1_200_000_000;

/// How long the code of a task stays damaged, ns. It is mended before the watchdog restarts the board.
const DAMAGED: u64 = 60_000_000;

/// Beginnings of a handler that fault in other ways than by an undefined instruction: a breakpoint without a debugger;
/// a load from an address without memory; a write into the program; an undefined instruction without a stack.
const FAULTING: [&[u16]; 4] =
    [&[0xBE00], &[0x2006, 0x0700, 0x6800], &[0x2008, 0x0600, 0x6000], &[0x2006, 0x0700, 0x4685, 0xDE00]];

/// How long the program's CRC stays wrong, ns: over several starts.
const UNSEALED: u64 = 400_000_000;

/// The time in which a receiver has sent every message, ns.
const MESSAGES_NS: u64 = 25_000_000_000;

/// Returns the runs of `duration_ns` with faults of `kinds`, and with damaged programs and in turn if `addresses` are
/// given.
///
/// Beside a hold come only the runs that its DPR can notice: HORUS's image is the same with a hold and without.
pub(super) fn runs(
    kinds: &[Kind],
    gps: usize,
    seed: u64,
    duration_ns: u64,
    addresses: Option<Addresses>,
    hold: bool,
) -> Vec<Run> {
    let plain = Run {
        name: "plain".into(),
        faults: Faults::none(),
        duration_ns,
        factory_settings: false,
        recordings: vec![],
        judged: true,
    };
    let drawn = |name: String, kinds: &[Kind]| {
        // These two kinds have several times as many faults as any other.
        let many = matches!(kinds, [Kind::Gnss | Kind::Hold]);
        let duration_ns = if many { 3 * duration_ns } else { duration_ns };
        let faults = Faults::drawn(kinds, gps, seed, duration_ns);
        Run { name, faults, duration_ns, ..plain.clone() }
    };
    let of_horus = |kind: &Kind| matches!(kind, Kind::Gnss | Kind::Inputs);
    let kinds: Vec<Kind> = kinds.iter().copied().filter(|kind| !kind.is_upset() && !(hold && of_horus(kind))).collect();
    let boards: &[Board] = if hold { &[Board::Dpr] } else { &[Board::Horus, Board::Dpr] };
    let mut runs = vec![plain.clone()];
    runs.extend(kinds.iter().map(|kind| drawn(kind.to_string(), &[*kind])));
    let Some(addresses) = addresses else { return runs };
    let Addresses { crcs, handlers, .. } = addresses;
    runs.extend(scripted::runs(gps, seed, &addresses, hold));
    runs.push(drawn("all kinds".into(), &kinds));
    let unjudged = |name: &str, faults, duration_ns| {
        let name = name.to_owned();
        Run { name, faults, duration_ns, factory_settings: false, recordings: vec![], judged: false }
    };
    let (faults, end) = out_of_order(boards);
    runs.push(unjudged("tasks out of order", faults, end));
    let (faults, end) = broken_at_the_start(boards);
    runs.push(unjudged("chips broken at the start", faults, end));
    runs.extend(dpr_runs(&addresses, hold).into_iter().map(|(name, faults, end)| unjudged(name, faults, end)));
    if hold {
        runs.push(damaged(Board::Dpr, crcs[1], handlers[1]));
        runs.extend(hold_runs().into_iter().map(|(name, faults, end)| unjudged(&format!("hold: {name}"), faults, end)));
        return runs;
    }
    runs.push(Run { name: "factory settings".into(), factory_settings: true, ..plain.clone() });
    let more = horus_runs(&addresses.kept).into_iter();
    runs.extend(more.map(|(name, faults, end)| unjudged(&format!("horus: {name}"), faults, end + BETWEEN)));
    let dead = Fault::Power(Board::Horus, PowerFault::CrystalDead);
    runs.push(unjudged("without crystal", Faults::none().with(0, u64::MAX, dead.clone()), 3 * BETWEEN));
    runs.push(unjudged("crystal fails", Faults::none().with(BETWEEN, u64::MAX, dead), 3 * BETWEEN));
    let recordings = vec![messages::recording()];
    runs.push(Run { recordings, ..unjudged("every message", Faults::none(), MESSAGES_NS) });
    let recordings = values::recordings(gps, seed);
    runs.push(Run { recordings, ..unjudged("all values", Faults::none(), values::DURATION_NS) });
    for (nth, board) in [Board::Horus, Board::Dpr].into_iter().enumerate() {
        runs.push(damaged(board, crcs[nth], handlers[nth]));
    }
    runs
}

/// A run in which each task of `board` faults, the task with the handler at the address `handler` in several ways, and
/// in which the board then starts with a wrong CRC at the address `crc`.
fn damaged(board: Board, crc: u32, handler: u32) -> Run {
    let mut faults = Faults::none();
    let mut at = BETWEEN;
    for (_, vector) in tasks_of(board) {
        faults = faults.with(at, at + DAMAGED, Fault::Image(board, ImageFault::Faulting((*vector).to_owned())));
        at += BETWEEN;
    }
    for code in FAULTING {
        let bytes = code.iter().flat_map(|half| half.to_le_bytes()).collect();
        let patch = ImageFault::Patch { address: handler, bytes, sealed: true };
        faults = faults.with(at, at + DAMAGED, Fault::Image(board, patch));
        at += BETWEEN / 2;
    }
    let wrong = ImageFault::Patch { address: crc, bytes: vec![0; 4], sealed: false };
    faults = faults.with(at, at + UNSEALED, Fault::Image(board, wrong));
    faults = faults.with(at + 1_000_000, at + 1_000_000, Fault::Power(board, PowerFault::Pin));
    let name = format!("damaged {}", bench::faults::name_of(board));
    let duration_ns = at + 2 * BETWEEN;
    Run { name, faults, duration_ns, factory_settings: false, recordings: vec![], judged: false }
}

/// Each task of `boards` dead, and then run without a call; and the end, ns.
fn out_of_order(boards: &[Board]) -> (Faults, u64) {
    let (mut faults, mut at) = (Faults::none(), BETWEEN);
    for &board in boards {
        for task in 0..tasks_of(board).len() as u8 {
            for fault in [Fault::DeadTask(board, task), Fault::Spurious(board, task)] {
                faults = faults.with(at, at, fault);
                at += BETWEEN / 2;
            }
        }
    }
    (faults, at + BETWEEN)
}

/// Each fault of a front end while its board restarts; and the end, ns.
fn broken_at_the_start(boards: &[Board]) -> (Faults, u64) {
    let (mut faults, mut at) = (Faults::none(), BETWEEN);
    for &board in boards {
        for fault in ChipFault::ALL {
            faults = faults.with(at, at + BETWEEN / 2, Fault::Chip(board, fault));
            faults = faults.with(at + 1_000_000, at + 1_000_000, Fault::Power(board, PowerFault::Pin));
            at += BETWEEN;
        }
    }
    (faults, at + BETWEEN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_that_can_be_drawn_into_a_run_has_a_run() {
        let runs = runs(&Kind::ALL, 3, 1, 12_000_000_000, Some(Addresses::EXAMPLE), false);
        for kind in Kind::ALL.into_iter().filter(|kind| !kind.is_upset()) {
            let run = runs.iter().find(|run| run.name == kind.to_string()).unwrap();
            assert!(!run.faults.episodes().is_empty() && run.judged, "{kind}");
        }
        let damaged: Vec<_> = runs.iter().filter(|run| run.name.starts_with("damaged")).collect();
        assert_eq!(damaged.len(), 2);
        for (run, board) in damaged.iter().zip([Board::Horus, Board::Dpr]) {
            assert_eq!(run.faults.episodes().len(), tasks_of(board).len() + FAULTING.len() + 2);
        }
    }
}
