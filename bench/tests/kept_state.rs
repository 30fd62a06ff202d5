//! Tests that a board stops when a bit flips in what it keeps from one task to the next, before the flip misleads.

use crate::boards;

use bench::faults::{Board, Fault, Faults, Upset};
use bench::sim::{Bench, Images, Setup};
use bench_judge::{Violation, bounds};
use boards::{counter, image};
use dpr_fw::telemetry::Telemetry as Dpr;
use emulator_node::{Firmware, ResetAt};
use emulator_part::Reset;
use firmware_common::last_stop::Cause;
use horus_tx_fw::telemetry::Telemetry as Horus;

const MS: u64 = 1_000_000;
/// The instant of the first flip, ns, at which the link is up, and the time from one to the next: in every phase of a
/// cycle.
const FLIPS: (u64, u64) = (603 * MS, 2_300_000);
/// The same, while the buses of the receivers rest: they are read in the first 6 ms after a tick.
const BETWEEN_READS: (u64, u64) = (607 * MS, 10 * MS);
const SENDS: u64 = 100 * MS;

/// How many places of each variable are flipped, at the same distance from each other.
const PLACES: u32 = 5;

/// Flips bits of the variable called `symbol` on `board`, each in a run of its own, at `flips`. Each flip must make the
/// board stop within `within` ns because of its RAM, and its watchdog restart it. Nothing but `restarts` may be
/// violated.
fn each_flip_stops(board: Board, symbol: &str, flips: (u64, u64), within: u64, restarts: &[Violation]) {
    let Some((sender, reader)) = image(3, "horus-tx-fw.elf").zip(image(3, "dpr-fw.elf")) else { return };
    let flipped = if board == Board::Horus { &sender } else { &reader };
    let kept = Firmware::read(flipped).unwrap().variable_called(symbol).expect("the variable is in the image");
    for place in 0..PLACES {
        let address = kept.address as u32 + (2 * place + 1) * kept.size as u32 / (2 * PLACES);
        let at = flips.0 + u64::from(place) * flips.1;
        let upset = Fault::Upset(board, Upset::Ram { address, bit: (3 * place % 8) as u8 });
        let images = Images { horus: sender.clone(), dpr: reader.clone() };
        let faults = Faults::none().with(at, at, upset);
        let setup = Setup { faults, writes: true, ..Setup::new(images, 3, at + SENDS + 300 * MS) };
        let mut bench: Bench = Bench::new(&setup).unwrap();
        bench.run_to(setup.duration_ns, setup.threads);
        let (resets, other, told) = match board {
            Board::Horus => {
                let told = counter(bench.horus(), "HORUS_TELEMETRY", std::mem::offset_of!(Horus, last_stop));
                (bench.horus().resets().to_vec(), bench.dpr().resets().len(), told)
            }
            Board::Dpr => {
                let told = counter(bench.dpr(), "DPR_TELEMETRY", std::mem::offset_of!(Dpr, last_stop));
                (bench.dpr().resets().to_vec(), bench.horus().resets().len(), told)
            }
        };
        let [ResetAt { at: bitten, cause: Reset::Watchdog(_) }] = resets[..] else {
            panic!("{symbol}, place {place}: {resets:?}");
        };
        assert!((at..at + within + bounds::WATCHDOG_LONGEST).contains(&bitten), "{symbol}, {place}: {bitten}");
        assert_eq!(told >> 24, Cause::Ram as u32, "{symbol}, place {place}: {told:#x}");
        assert_eq!(other, 0);
        let mut violations = bench.finish(setup.duration_ns).verdict.violations;
        violations.retain(|broken| !restarts.contains(&broken.violation));
        assert!(violations.is_empty(), "{symbol}, place {place}: {violations:?}");
    }
}

// Shows SAFE-17.
#[test]
fn a_bit_that_flips_in_kept_state_stops_horus_before_it_misleads() {
    const RESTARTS: [Violation; 2] = [Violation::FieldDropped, Violation::HorusRestarted];
    each_flip_stops(Board::Horus, "__rtic_internal_shared_resource_solutions", FLIPS, 10 * MS, &RESTARTS);
    each_flip_stops(Board::Horus, "__rtic_internal_shared_resource_cycle", FLIPS, 10 * MS, &RESTARTS);
    each_flip_stops(Board::Horus, "__rtic_internal_local_resource_receivers", FLIPS, SENDS, &RESTARTS);
    each_flip_stops(Board::Horus, "__rtic_internal_shared_resource_lines", BETWEEN_READS, 10 * MS, &RESTARTS);
}

// Shows SAFE-18.
#[test]
fn a_flipped_bit_of_kept_state_stops_the_dpr_before_it_misleads() {
    // The test of the RAM at the restart takes a great part of so short a run.
    const RESTARTS: [Violation; 2] = [Violation::DprRestarted, Violation::DprOverloaded];
    each_flip_stops(Board::Dpr, "__rtic_internal_shared_resource_committing", FLIPS, 10 * MS, &RESTARTS);
    each_flip_stops(Board::Dpr, "__rtic_internal_local_resource_port", FLIPS, 10 * MS, &RESTARTS);
}
