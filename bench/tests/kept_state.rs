//! Tests that HORUS stops before it sends wrong values if a bit flips in data that it keeps between two tasks.

use crate::boards;

use bench::faults::{Board, Fault, Faults, Upset};
use bench::sim::{Bench, Images, Setup};
use bench_judge::{Violation, bounds};
use boards::{counter, image};
use emulator_node::ResetAt;
use emulator_part::Reset;
use firmware_common::last_stop::Cause;
use horus_tx_fw::telemetry::Telemetry;

const MS: u64 = 1_000_000;
/// The instant of the flip, ns, at which the link is up.
const FLIPS: u64 = 603 * MS;
const SENDS: u64 = 100 * MS;

/// The kept variables, each with the longest time until HORUS finds the flip, ns.
const KEPT: [(&str, u64); 3] = [
    ("__rtic_internal_shared_resource_solutions", 10 * MS),
    ("__rtic_internal_shared_resource_cycle", 10 * MS),
    ("__rtic_internal_local_resource_receivers", SENDS),
];

/// The number of flipped addresses in each variable.
const PLACES: u32 = 5;

// Shows SAFE-17.
#[test]
fn a_bit_that_flips_in_kept_state_stops_horus_before_it_misleads() {
    let Some(horus) = boards::horus() else { return };
    let Some((sender, reader)) = image(3, "horus-tx-fw.elf").zip(image(3, "dpr-fw.elf")) else { return };
    for (symbol, within) in KEPT {
        let kept = horus.firmware().variable_called(symbol).expect("the variable is in the image");
        for place in 0..PLACES {
            let address = kept.address as u32 + (2 * place + 1) * kept.size as u32 / (2 * PLACES);
            let at = FLIPS + u64::from(place) * 2_300_000;
            let upset = Fault::Upset(Board::Horus, Upset::Ram { address, bit: (3 * place % 8) as u8 });
            let images = Images { horus: sender.clone(), dpr: reader.clone() };
            let faults = Faults::none().with(at, at, upset);
            let setup = Setup { faults, ..Setup::new(images, 3, at + SENDS + 300 * MS) };
            let mut bench: Bench = Bench::new(&setup).unwrap();
            bench.run_to(setup.duration_ns, setup.threads);
            let resets = bench.horus().resets().to_vec();
            let [ResetAt { at: bitten, cause: Reset::Watchdog(_) }] = resets[..] else {
                panic!("{symbol}, place {place}: {resets:?}");
            };
            assert!((at..at + within + bounds::WATCHDOG_LONGEST).contains(&bitten), "{symbol}, {place}: {bitten}");
            let told = counter(bench.horus(), "HORUS_TELEMETRY", std::mem::offset_of!(Telemetry, last_stop));
            assert_eq!(told >> 24, Cause::Ram as u32, "{symbol}, place {place}: {told:#x}");
            assert!(bench.dpr().resets().is_empty());
            let mut violations = bench.finish(setup.duration_ns).verdict.violations;
            violations
                .retain(|broken| !matches!(broken.violation, Violation::FieldDropped | Violation::HorusRestarted));
            assert!(violations.is_empty(), "{symbol}, place {place}: {violations:?}");
        }
    }
}
