//! Tests the link with an active hold beside the DPR.

use crate::boards;

use std::collections::BTreeSet;

use bench::faults::hold::Hostile;
use bench::faults::power::{sag_length, shape};
use bench::faults::{Board, Fault, Faults, HoldFault, Kind, PowerFault};
use bench::report::Report;
use bench::sim::{Bench, Finished, Images, Setup};
use bench_judge::{Event, HoldEvent, Log, What};
use boards::{hold_image, image};
use cortex_m4::{Cost, Fast, Pessimistic};
use emulator_node::Threads;

const MS: u64 = 1_000_000;

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
    // The hold starts, sends a frame, receives an answer, and waits.
    for instant in [30 * MS, 241 * MS, 243 * MS + 777, 380 * MS] {
        bench.run_to(instant, Threads::One);
        let mut copy = bench.clone();
        copy.run_to(setup.duration_ns, Threads::Two);
        let copied = copy.finish(setup.duration_ns);
        assert!(copied.log == whole.log, "a copy at {instant} ns");
    }
}

/// Returns figures of HORUS's link that a hold may not change, ns: the worst times from sample to readable, from last
/// bit to readable, and until ready.
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
        // With crosstalk a frame of the hold may cost a frame of HORUS.
        if fault == Some(Fault::Hold(HoldFault::Crosstalk)) || seen.contains(&name) {
            continue;
        }
        let faults = fault.map_or(Faults::none(), |fault| Faults::none().with(500 * MS, 2_500 * MS, fault));
        let finished = run::<Fast>(&Setup { faults, ..quiet.clone() }, Threads::Two);
        assert_eq!(words(&finished), [""; 0], "{name}");
        let found = of_horus(&finished.report);
        // The DPR's firmware without a hold is another program, and the compiler may give the same code a few cycles
        // more.
        if found.iter().zip(expected).any(|(found, expected)| found.saturating_sub(expected) * 100 > expected) {
            moved.push((name.clone(), found));
        }
        seen.push(name);
    }
    assert_eq!(seen.len(), 17, "{seen:?}");
    assert_eq!(moved, [], "{expected:?} without a hold");
}

fn objects(finished: &Finished) -> (u64, u64) {
    (finished.report.dpr.objects_accepted, finished.report.dpr.objects_rejected)
}

/// A short form of `cargo xtask sim --hold --faults hostile --seconds 1030`.
#[test]
fn a_hostile_hold_costs_horus_no_object_and_adds_none() {
    for gps in [1, 3] {
        let Some(mut setup) = setup(gps, 9_000 * MS) else { return };
        let quiet = objects(&run::<Fast>(&setup, Threads::Two));
        setup.faults = Faults::drawn(&[Kind::Hostile], gps, 1, setup.duration_ns);
        let names: BTreeSet<String> = setup.faults.episodes().iter().map(|episode| episode.fault.name()).collect();
        assert_eq!(names.len(), 5, "{names:?}");
        let finished = run::<Fast>(&setup, Threads::Two);
        assert_eq!(words(&finished), [""; 0], "{gps} receivers");
        assert_eq!(objects(&finished), quiet, "{gps} receivers");
    }
}

/// The offset of the counter `rests` in the telemetry of the DPR's second port.
const RESTS: usize = 4 * 8;

#[test]
fn the_ports_tasks_check_in_while_the_port_rests() {
    let Some(mut setup) = setup(3, 4_000 * MS) else { return };
    let floods = Fault::Hold(HoldFault::Hostile(Hostile::Random, 5));
    setup.faults = Faults::none().with(500 * MS, 3_900 * MS, floods);
    let mut bench = Bench::<Fast>::new(&setup).unwrap();
    bench.run_to(setup.duration_ns, Threads::Two);
    assert_eq!(dpr_fw::hold::HoldTelemetry::NAMES[RESTS / 4], "rests");
    let rests = boards::counter(bench.dpr(), "DPR_HOLD_TELEMETRY", RESTS);
    eprintln!("the port rests {rests} times in 34 periods");
    assert!((20..=35).contains(&rests), "{rests}");
    // The watchdog bites if a task does not check in for 100 ms. It has not bitten.
    assert_eq!(bench.dpr().resets(), []);
}

/// Returns the seed of a sag that begins with a voltage between the DPR's warning and its brown-out threshold.
fn sag_at_once() -> u64 {
    let is_one = |seed: &u64| {
        let sag = 1_700_000..2_500_000;
        matches!(shape(*seed)[..], [_, (0, uv), (after, _), ..] if after > MS && sag.contains(&uv))
    };
    (0..).find(is_one).expect("a shape has a step in one of eight")
}

#[test]
fn a_dpr_in_its_safe_state_sends_the_hold_no_answer() {
    let Some(mut setup) = setup(1, 1_500 * MS) else { return };
    let quiet = run::<Fast>(&setup, Threads::Two).log;
    let heard = quiet.events.iter().find_map(|event| match event.what {
        What::Hold(HoldEvent::Heard(_)) if event.at > 1_000 * MS => Some(event.at),
        _ => None,
    });
    let heard = heard.expect("a frame of the hold");
    let answers = |log: &Log| {
        let is_one = |event: &&Event| match &event.what {
            What::Hold(HoldEvent::Answered(answer)) => (heard..heard + 50 * MS).contains(&answer.started),
            _ => false,
        };
        log.events.iter().filter(is_one).count()
    };
    assert_eq!(answers(&quiet), 1);
    let seed = sag_at_once();
    // The firmware loads the answer 0.3 ms after the frame, and a timer starts it at 2.0 ms. The supply falls before,
    // between and just before these instants.
    for after in [100, 400, 1_000, 1_950].map(|after| heard + after * 1_000) {
        let sag = Fault::Power(Board::Dpr, PowerFault::Sag(seed));
        setup.faults = Faults::none().with(after, after + sag_length(seed), sag);
        let finished = run::<Fast>(&setup, Threads::Two);
        assert_eq!(words(&finished), [""; 0]);
        assert_eq!(answers(&finished.log), 0, "the supply sags {} ns after the frame", after - heard);
    }
}

/// A hostile sender repeats frames of HORUS in place of the hold's frames.
const REPLAYS: Fault = Fault::Hold(HoldFault::Hostile(Hostile::Horus, 1));

#[test]
fn frames_of_horus_that_a_coupled_hold_repeats_are_rejected_by_sequence() {
    let Some(mut setup) = setup(1, 20_000 * MS) else { return };
    let crosstalk = Fault::Hold(HoldFault::Crosstalk);
    setup.faults = Faults::none().with(500 * MS, 19_000 * MS, crosstalk).with(1_000 * MS, 18_000 * MS, REPLAYS);
    let finished = run::<Fast>(&setup, Threads::Two);
    assert_eq!(words(&finished), [""; 0]);
    let (accepted, rejected) = objects(&finished);
    eprintln!("of two objects in each of 2000 cycles {accepted} were accepted; {rejected} were rejected");
    assert!(rejected > 2_000, "the listener hears them: {rejected}");
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
