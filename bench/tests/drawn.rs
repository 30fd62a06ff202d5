//! Faults drawn from seeds, as `cargo xtask sim --faults` draws them: the link has no violation through any of them.

mod boards;

use bench::faults::{Faults, Kind};
use bench::sim::{Images, Setup, run};
use boards::image;

const MS: u64 = 1_000_000;

/// The report of six seconds with these kinds of faults; `None` where the images were not built.
fn report(gps: usize, kinds: &[Kind], seed: u64) -> Option<bench::report::Report> {
    let images = Images { horus: image(gps, "horus-tx-fw.elf")?, dpr: image(gps, "dpr-fw.elf")? };
    let mut setup = Setup { seed, ..Setup::new(images, gps, 6_000 * MS) };
    setup.faults = Faults::drawn(kinds, gps, seed, setup.duration_ns);
    Some(run(&setup, &mut ()).unwrap_or_else(|error| panic!("{error}")).report)
}

const ALL: [Kind; 4] = [Kind::Air, Kind::Receivers, Kind::FlightController, Kind::Power];

#[test]
fn faults_of_every_kind_at_once_violate_nothing_and_the_link_recovers() {
    for (gps, seed) in [(3, 1), (3, 2), (3, 3), (3, 4), (1, 5), (2, 6), (5, 7), (5, 8)] {
        let Some(report) = report(gps, &ALL, seed) else { return };
        assert_eq!(report.violations, [""; 0], "{gps} receivers, seed {seed}");
        assert_eq!(report.faults.invalid_shown_valid, 0);
        // Of each kind some faults were there, and each is in the log by its name.
        for kind in ["air", "receiver", "flight controller", "power"] {
            let injected = report.faults.injected.keys().any(|name| name.starts_with(kind));
            assert!(injected, "{kind} of {:?}", report.faults.injected);
        }
        // Within 15 cycles where a front end had to be brought up again.
        let recovery = report.faults.max_recovery_cycles.unwrap_or_else(|| panic!("seed {seed}: nothing was measured"));
        assert!((1..=15).contains(&recovery), "{gps} receivers, seed {seed}: {recovery} cycles");
    }
}

#[test]
fn a_kind_of_fault_alone_is_injected_alone() {
    for (kind, name) in [(Kind::Air, "air"), (Kind::Receivers, "receiver"), (Kind::Power, "power")] {
        let Some(report) = report(3, &[kind], 9) else { return };
        assert_eq!(report.violations, [""; 0], "{kind}");
        assert!(!report.faults.injected.is_empty());
        for injected in report.faults.injected.keys() {
            assert!(injected.starts_with(name), "{injected}");
        }
    }
}
