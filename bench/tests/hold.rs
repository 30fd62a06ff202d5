//! Tests the link with an active hold beside the DPR: three boards, of which the first never hears the others.

use crate::boards;

use bench::faults::{Fault, Faults, HoldFault, Kind};
use bench::report::Report;
use bench::sim::{Bench, Finished, Images, Setup};
use boards::{hold_image, image};
use cortex_m4::{Cost, Fast, Pessimistic};
use emulator_node::Threads;

const MS: u64 = 1_000_000;

/// The setup of a link with a hold; `None` if the firmwares were not built.
fn setup(gps: usize, duration: u64) -> Option<Setup> {
    let images = Images { horus: image(gps, "horus-tx-fw.elf")?, dpr: image(gps, "dpr-fw-hold.elf")? };
    Some(Setup { hold: Some(hold_image()?), writes: true, ..Setup::new(images, gps, duration) })
}

fn run<C: Cost>(setup: &Setup, threads: Threads) -> Finished {
    let mut bench = Bench::<C>::new(setup).unwrap_or_else(|error| panic!("{error}"));
    bench.keep_log();
    bench.run_to(setup.duration_ns, threads);
    bench.finish(setup.duration_ns)
}

fn words(finished: &Finished) -> Vec<String> {
    finished.verdict.violations.iter().map(ToString::to_string).collect()
}

#[test]
fn what_the_hold_says_is_read_and_every_command_is_acknowledged() {
    for gps in [1, 3, 5] {
        let Some(setup) = setup(gps, 8_000 * MS) else { return };
        let finished = run::<Fast>(&setup, Threads::Two);
        assert_eq!(words(&finished), [""; 0], "{gps} receivers");
        let hold = finished.report.hold.expect("there is one");
        assert!((78..=80).contains(&hold.frames_sent), "{hold:?}");
        let counts = [hold.frames_delivered, hold.answers_sent, hold.answers_delivered];
        assert_eq!(counts, [hold.frames_sent; 3], "{hold:?}");
        assert!(hold.vacant <= 5 && hold.read >= 190, "{hold:?}");
        for commands in [hold.base_station, hold.flight_controller] {
            assert!(commands.sent >= 3 && commands.lost == 0, "{hold:?}");
            assert!(commands.acknowledged + 1 >= commands.sent, "{hold:?}");
        }
    }
}

#[test]
fn on_one_thread_and_on_two_a_hold_leaves_the_same_log() {
    let Some(mut setup) = setup(3, 6_000 * MS) else { return };
    setup.faults = Faults::drawn(&[Kind::Hold, Kind::Air, Kind::Power], 3, 4, setup.duration_ns);
    fn same<C: Cost>(setup: &Setup) {
        let [one, two] = [Threads::One, Threads::Two].map(|threads| run::<C>(setup, threads));
        assert_eq!(one.log, two.log);
        assert_eq!(format!("{:?}", one.report), format!("{:?}", two.report));
    }
    same::<Fast>(&setup);
    same::<Pessimistic>(&setup);
}

#[test]
fn a_copied_bench_with_a_hold_runs_on_like_the_original() {
    let Some(setup) = setup(3, 700 * MS) else { return };
    let whole = run::<Fast>(&setup, Threads::Two);
    let mut bench = Bench::<Fast>::new(&setup).unwrap();
    bench.keep_log();
    // At these instants the hold starts, sends a frame, is answered, and waits.
    for instant in [30 * MS, 241 * MS, 243 * MS + 777, 380 * MS] {
        bench.run_to(instant, Threads::One);
        let mut copy = bench.clone();
        copy.run_to(setup.duration_ns, Threads::Two);
        let copied = copy.finish(setup.duration_ns);
        assert!(copied.log == whole.log, "a copy at {instant} ns");
    }
}

/// What a hold may not change of HORUS's link: sample to readable, last bit to readable, ready, all at worst, ns.
fn of_horus(report: &Report) -> [u64; 3] {
    let (latency, ready) = (report.latency_ns, report.ssi.ready_ns);
    let (readable, last_bit) = (latency.sample_to_readable, latency.last_bit_to_readable);
    [readable.map_or(0, |it| it.max), last_bit.map_or(0, |it| it.max), ready.map_or(0, |it| it.max)]
}

#[test]
fn no_fault_of_the_hold_moves_a_figure_of_horus() {
    let Some(quiet) = setup(3, 3_000 * MS) else { return };
    let without = Setup {
        hold: None,
        images: Images { dpr: image(3, "dpr-fw.elf").expect("it was built"), ..quiet.images.clone() },
        ..quiet.clone()
    };
    let expected = of_horus(&run::<Fast>(&without, Threads::Two).report);
    let mut moved = vec![];
    let drawn = Faults::drawn(&[Kind::Hold], 3, 1, 400_000 * MS);
    let mut seen: Vec<String> = vec![];
    for fault in std::iter::once(None).chain(drawn.episodes().iter().map(|episode| Some(episode.fault.clone()))) {
        let name = fault.as_ref().map_or(String::new(), Fault::name);
        // A frame of the hold at HORUS's antenna may cost a frame of HORUS's.
        if fault == Some(Fault::Hold(HoldFault::Crosstalk)) || seen.contains(&name) {
            continue;
        }
        let faults = fault.map_or(Faults::none(), |fault| Faults::none().with(500 * MS, 2_500 * MS, fault));
        let finished = run::<Fast>(&Setup { faults, ..quiet.clone() }, Threads::Two);
        assert_eq!(words(&finished), [""; 0], "{name}");
        let found = of_horus(&finished.report);
        if found.iter().zip(expected).any(|(found, expected)| found.abs_diff(expected) * 100 > expected) {
            moved.push((name.clone(), found));
        }
        seen.push(name);
    }
    assert_eq!(seen.len(), 17, "{seen:?}");
    assert_eq!(moved, [], "{expected:?} without a hold");
}

#[test]
fn drawn_faults_of_the_hold_violate_nothing() {
    for (gps, seed) in [(3, 1), (1, 2), (5, 3)] {
        let Some(mut setup) = setup(gps, 20_000 * MS) else { return };
        setup.seed = seed;
        setup.faults = Faults::drawn(&[Kind::Hold], gps, seed, setup.duration_ns);
        let finished = run::<Fast>(&setup, Threads::Two);
        assert_eq!(words(&finished), [""; 0], "{gps} receivers, seed {seed}");
    }
}
