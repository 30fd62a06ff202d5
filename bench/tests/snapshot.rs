//! Tests that a bench is plain data. A copy gives the same result as the original, byte for byte, on one thread and on
//! two.

use crate::boards;

use bench::faults::{AirFaults, Fault, Faults};
use bench::sim::{AHEAD_NS, Bench, Images, Setup};
use bench_judge::Event;
use boards::image;
use cortex_m4::{Cost, Fast, Pessimistic};
use emulator_node::Threads;

const US: u64 = 1_000;
const MS: u64 = 1_000_000;
const END: u64 = 260 * MS;

fn setup() -> Option<Setup> {
    let images = Images { horus: image(3, "horus-tx-fw.elf")?, dpr: image(3, "dpr-fw.elf")? };
    let faults = Faults::of_air(AirFaults { lost: 0.1, ..AirFaults::default() });
    Some(Setup { seed: 5, faults, ..Setup::new(images, 3, END) })
}

fn outcome<C: Cost>(bench: Bench<C>) -> (String, [u64; 2]) {
    let digests = [bench.horus().digest(), bench.dpr().digest()];
    let finished = bench.finish(END);
    (format!("{:?}\n{:?}\n{}", finished.report, finished.verdict, finished.base), digests)
}

fn whole<C: Cost>(setup: &Setup, threads: Threads) -> (String, [u64; 2]) {
    let mut bench = Bench::<C>::new(setup).unwrap();
    bench.run_to(END, threads);
    outcome(bench)
}

#[test]
fn on_one_thread_and_on_two_a_run_leaves_the_same_bytes() {
    let Some(setup) = setup() else { return };
    assert_eq!(whole::<Fast>(&setup, Threads::One), whole::<Fast>(&setup, Threads::Two));
    assert_eq!(whole::<Pessimistic>(&setup, Threads::One), whole::<Pessimistic>(&setup, Threads::Two));
}

/// The instants, ns, at which the bench is copied: in the boards' start, between two frames, within a frame, at its
/// last bit, and in a publication.
const INSTANTS: [u64; 7] =
    [0, 6 * MS + 300 * US, 101 * MS, 147 * MS + 777, 149 * MS + 419 * US, 149 * MS + 503 * US, 213 * MS];

#[test]
fn a_copy_taken_at_any_instant_runs_on_like_the_original() {
    let Some(setup) = setup() else { return };
    let expected = whole::<Fast>(&setup, Threads::Two);
    let mut original = Bench::<Fast>::new(&setup).unwrap();
    for instant in INSTANTS {
        original.run_to(instant, Threads::One);
        let mut copy = original.clone();
        copy.run_to(END, Threads::Two);
        assert_eq!(outcome(copy), expected, "a copy at {instant} ns");
    }
    // The original is not changed by the runs of its copies.
    original.run_to(END, Threads::One);
    assert_eq!(outcome(original), expected);
}

#[test]
fn a_run_in_pieces_has_the_event_log_of_a_whole_run() {
    let Some(setup) = setup() else { return };
    // Repeated frames may reach the DPR in a later piece of a divided run.
    let faults = Faults::of_air(AirFaults { lost: 0.1, repeated: 0.5, ..AirFaults::default() });
    let setup = Setup { faults, ..setup };
    let log = |ends: &[u64]| {
        let mut bench = Bench::<Fast>::new(&setup).unwrap();
        bench.keep_log();
        ends.iter().chain([&END]).for_each(|end| bench.run_to(*end, Threads::One));
        bench.finish(END).log
    };
    // The base station's display is recorded every 10 ms, so a run is divided at multiples of 10 ms.
    let ends: Vec<u64> = (1..26).map(|cycle| cycle * 10 * MS).collect();
    assert!(log(&ends) == log(&[]));
}

#[test]
fn copies_of_one_instant_give_the_same_outcome() {
    let Some(setup) = setup() else { return };
    let mut original = Bench::<Fast>::new(&setup).unwrap();
    original.run_to(120 * MS, Threads::Two);
    let [first, second, third] = [(); 3].map(|()| original.clone());
    let run = |mut bench: Bench<Fast>, end| {
        bench.run_to(end, Threads::Two);
        outcome(bench)
    };
    assert_eq!(run(first, END), run(second, END));
    assert_ne!(run(third, END - 10 * MS).1, run(original, END).1);
}

#[test]
fn copies_behind_a_shared_horus_read_what_they_read_behind_their_own() {
    let Some(setup) = setup() else { return };
    let mut base = Bench::<Fast>::new(&setup).unwrap();
    base.run_to(INSTANTS[2] + 123_457, Threads::One);
    base.keep_log();
    let horus = base.share_horus();
    for seed in [1, 2] {
        let mut copy = base.clone();
        let lost = Fault::Air(AirFaults { bit_error: 1e-3, lost: 0.1 * seed as f64, ..AirFaults::default() });
        copy.add_faults(&Faults::none().with(base.now() + AHEAD_NS, END - 20 * MS, lost));
        let mut own = copy.clone();
        own.run_to(END, Threads::Two);
        copy.run_behind(&horus);
        copy.run_to(END - 33 * MS, Threads::One);
        copy.run_to(END, Threads::One);
        assert_eq!(copy.dpr().digest(), own.dpr().digest());
        let judged = [copy, own].map(|bench| {
            let finished = bench.finish(END);
            // HORUS's counters and load at the end are those of the instant at which it was shared.
            let events: Vec<Event> = finished.log.events.into_iter().filter(|event| event.at < END).collect();
            assert!(events.len() > 200);
            (events, finished.verdict.violations)
        });
        assert_eq!(judged[0], judged[1]);
    }
}
