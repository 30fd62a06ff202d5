//! Tests that faults drawn from seeds, as by `cargo xtask sim --faults`, lead to no violation.

use crate::boards;

use bench::faults::{Faults, Kind};
use bench::sim::{Images, Setup, run};
use boards::image;
use emulator_node::Clock;

const MS: u64 = 1_000_000;

fn report(gps: usize, kinds: &[Kind], seed: u64) -> Option<bench::report::Report> {
    report_of(6_000 * MS, gps, kinds, seed)
}

fn report_of(duration: u64, gps: usize, kinds: &[Kind], seed: u64) -> Option<bench::report::Report> {
    report_of_setup(duration, gps, kinds, seed, |_| {})
}

fn report_of_setup(
    duration: u64,
    gps: usize,
    kinds: &[Kind],
    seed: u64,
    change: impl FnOnce(&mut Setup),
) -> Option<bench::report::Report> {
    let images = Images { horus: image(gps, "horus-tx-fw.elf")?, dpr: image(gps, "dpr-fw.elf")? };
    let mut setup = Setup { seed, ..Setup::new(images, gps, duration) };
    change(&mut setup);
    setup.faults = Faults::drawn(kinds, gps, seed, setup.duration_ns);
    Some(run(&setup, &mut ()).unwrap_or_else(|error| panic!("{error}")).report)
}

const ALL: [Kind; 7] =
    [Kind::Air, Kind::Gnss, Kind::FlightController, Kind::Power, Kind::Buffers, Kind::Inputs, Kind::Hang];

#[test]
fn faults_of_every_kind_at_once_violate_nothing_and_the_link_recovers() {
    for (gps, seed) in [(3, 1), (3, 2), (3, 3), (3, 4), (1, 5), (2, 6), (5, 7), (5, 8)] {
        let Some(report) = report(gps, &ALL, seed) else { return };
        assert_eq!(report.violations, [""; 0], "{gps} receivers, seed {seed}");
        assert_eq!(report.faults.invalid_shown_valid, 0);
        // The log must name faults of each kind.
        for kind in ["air", "receiver", "flight controller", "power", "buffer", "input", "hang"] {
            let injected = report.faults.injected.keys().any(|name| name.starts_with(kind));
            assert!(injected, "{kind} of {:?}", report.faults.injected);
        }
        let recovery = report.faults.max_recovery_cycles.unwrap_or_else(|| panic!("seed {seed}: nothing was measured"));
        assert!((1..=15).contains(&recovery), "{gps} receivers, seed {seed}: {recovery} cycles");
        let plain = report.faults.max_recovery_cycles_without_bring_up;
        assert!(plain.is_none_or(|cycles| cycles <= 5), "{gps} receivers, seed {seed}: {plain:?} cycles");
    }
}

#[test]
fn a_kind_of_fault_alone_is_injected_alone() {
    for (kind, names) in [
        (Kind::Air, &["air", "horus front end", "dpr front end"][..]),
        (Kind::Gnss, &["receiver"]),
        (Kind::Power, &["power"]),
        (Kind::Buffers, &["buffer"]),
        (Kind::Inputs, &["input"]),
        // For a hang during a start, the board is restarted first.
        (Kind::Hang, &["hang", "dead task", "spurious interrupt", "power horus", "power dpr"]),
        (Kind::Chips, &["horus front end register", "dpr front end register"]),
    ] {
        let Some(report) = report(3, &[kind], 9) else { return };
        assert_eq!(report.violations, [""; 0], "{kind}");
        assert!(!report.faults.injected.is_empty());
        for injected in report.faults.injected.keys() {
            assert!(names.iter().any(|name| injected.starts_with(name)), "{injected}");
        }
    }
}

/// This test is a short form of `cargo xtask sim --seconds 1000 --faults air,fc,power,buffers --seed 7`, with every
/// fault.
#[test]
fn thirty_seconds_of_all_that_disturbs_the_dpr_violate_nothing() {
    let kinds = [Kind::Air, Kind::FlightController, Kind::Power, Kind::Buffers];
    let Some(report) = report_of(30_000 * MS, 3, &kinds, 7) else { return };
    assert_eq!(report.violations, [""; 0]);
    assert_eq!(report.faults.invalid_shown_valid, 0);
    assert!(report.faults.injected.len() > 40, "{:?}", report.faults.injected);
    assert!(report.faults.max_recovery_cycles.is_some_and(|cycles| cycles <= 15), "{:?}", report.faults);
    let plain = report.faults.max_recovery_cycles_without_bring_up;
    assert!(plain.is_some_and(|cycles| cycles <= 5), "{:?}", report.faults);
}

/// The boards hang, alone and together with other disturbances of the DPR. The test runs with each number of receivers
/// and on each clock.
#[test]
fn the_link_recovers_from_drawn_hangs_without_a_violation() {
    let among = [Kind::Air, Kind::FlightController, Kind::Power, Kind::Buffers, Kind::Hang];
    for (clock, gps, kinds, seed) in [
        (Clock::Fast, 3, &[Kind::Hang][..], 1),
        (Clock::Optimistic, 1, &[Kind::Hang], 2),
        (Clock::Pessimistic, 2, &[Kind::Hang], 3),
        (Clock::Fast, 5, &among, 4),
        (Clock::Optimistic, 2, &among, 5),
        (Clock::Pessimistic, 3, &among, 6),
    ] {
        let change = |setup: &mut Setup| (setup.clock, setup.writes) = (clock, true);
        let Some(report) = report_of_setup(15_000 * MS, gps, kinds, seed, change) else { return };
        let faults = &report.faults;
        assert_eq!(report.violations, [""; 0], "{clock} clock, {gps} receivers, seed {seed}");
        assert_eq!(faults.invalid_shown_valid, 0);
        for board in ["hang horus", "hang dpr"] {
            assert!(faults.injected.get(board).is_some_and(|count| *count >= 3), "{board}: {:?}", faults.injected);
        }
        assert!(faults.max_recovery_cycles.is_some_and(|cycles| cycles <= 15), "{faults:?}");
    }
}

#[test]
fn bits_that_flip_in_either_front_end_violate_nothing() {
    let among = [Kind::Air, Kind::Power, Kind::Hang, Kind::Chips];
    for (gps, kinds, seed) in [(3, &[Kind::Chips][..], 1), (5, &[Kind::Chips], 2), (1, &among, 3), (2, &among, 4)] {
        let Some(report) = report_of(12_000 * MS, gps, kinds, seed) else { return };
        assert_eq!(report.violations, [""; 0], "{gps} receivers, seed {seed}");
        assert_eq!(report.faults.invalid_shown_valid, 0);
        for board in ["horus", "dpr"] {
            let name = format!("{board} front end register flips");
            assert!(report.faults.injected.contains_key(&name), "{:?}", report.faults.injected);
        }
    }
}
