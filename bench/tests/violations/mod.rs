//! The table of violations. Each row makes the surroundings or a release program fail so that the judge reports one
//! violation. In addition, the judge may report only the firmware's own fault counter. Every violation has a row.
//!
//! The event log of each row is judged in pieces, as a whole, and after it was stored and read. The verdicts must be
//! equal.

use crate::boards;

mod base;
mod evidence;
mod hold;
mod images;
mod sending;
mod shown;
mod ssi;

use std::sync::OnceLock;

use bench::faults::Faults;
use bench::sim::{Bench, Finished, Images, Setup};
use bench_judge::{Log, Violation, What, judge};

const US: u64 = 1_000;
const MS: u64 = 1_000_000;

/// The instant, ns, at which the link has been up for 200 ms.
const SETTLED: u64 = 300 * MS;

/// The time from a tick of HORUS until the image of its cycle can be read, with three receivers, ns.
const READABLE: u64 = 5 * MS;

/// The flight controller's control cycle, ns. One transaction ends in any interval of this length.
const CONTROL_CYCLE: u64 = 4 * MS;

/// The instants after [`SETTLED`] at which faults begin and the flight controller reads ([`breaks_with`], [`reads`]).
struct Beat {
    breaks: u64,
    reads: u64,
}

/// Returns the instants at which faults begin in a link with `gps` receivers. They depend on the program, whose start
/// delays HORUS's first tick.
///
/// # Panics
///
/// Panics if the images were not built.
fn beat(gps: usize) -> &'static Beat {
    static BEATS: [OnceLock<Beat>; 6] = [const { OnceLock::new() }; 6];
    BEATS[gps].get_or_init(|| {
        let log = sound(gps, SETTLED + 40 * MS).expect("the images were built").log;
        let reads = |breaks: u64| {
            log.events.iter().find_map(|event| match event.what {
                What::Transaction { selected, .. } if selected > breaks => Some(selected),
                _ => None,
            })
        };
        let ticks = log.events.iter().filter(|event| event.what == What::Tick && event.at >= SETTLED);
        let mut beats = ticks.filter_map(|tick| {
            let breaks = tick.at + READABLE;
            reads(breaks).filter(|reads| reads - breaks < CONTROL_CYCLE / 2).map(|reads| Beat { breaks, reads })
        });
        beats.next().expect("of two cycles' images one is read soon")
    })
}

/// Returns the instant, ns, at which faults begin: [`READABLE`] after a tick of HORUS, and less than half a control
/// cycle before a transaction.
fn breaks_with(gps: usize) -> u64 {
    beat(gps).breaks
}

fn breaks() -> u64 {
    breaks_with(3)
}

fn reads() -> u64 {
    beat(3).reads
}

struct Row {
    /// The violation that the judge must report first.
    violation: Violation,
    /// The violation by the firmware's own fault counter, which the judge may report too.
    also: Option<Violation>,
    gps: usize,
    duration: fn() -> u64,
    setup: fn(&mut Setup),
    faults: fn() -> Faults,
    /// Faults that are added to the bench when both boards have reached [`breaks_with`].
    added: fn() -> Faults,
}

impl Row {
    const fn new(violation: Violation, faults: fn() -> Faults) -> Self {
        Self { violation, also: None, gps: 3, duration: || 600 * MS, setup: |_| {}, faults, added: Faults::none }
    }
}

fn setup(gps: usize, duration: u64) -> Option<Setup> {
    let image = |name| boards::image(gps, name);
    let images = Images { horus: image("horus-tx-fw.elf")?, dpr: image("dpr-fw.elf")? };
    Some(Setup::new(images, gps, duration))
}

fn bench(setup: &Setup) -> Bench {
    let mut bench = Bench::new(setup).unwrap_or_else(|error| panic!("{error}"));
    bench.keep_log();
    bench
}

fn sound(gps: usize, duration: u64) -> Option<Finished> {
    let setup = setup(gps, duration)?;
    let mut bench = bench(&setup);
    bench.run_to(duration, setup.threads);
    Some(bench.finish(duration))
}

fn run(row: &Row) -> Option<Finished> {
    let mut setup = setup(row.gps, 0)?;
    let duration = (row.duration)();
    setup.duration_ns = duration;
    setup.faults = (row.faults)();
    (row.setup)(&mut setup);
    let mut bench = bench(&setup);
    bench.run_to(breaks_with(row.gps).min(duration), setup.threads);
    bench.add_faults(&(row.added)());
    bench.run_to(duration, setup.threads);
    Some(bench.finish(duration))
}

fn holds(row: &Row) {
    let Some(finished) = run(row) else { return };
    let words: Vec<String> = finished.verdict.violations.iter().map(ToString::to_string).collect();
    let shown: Vec<Violation> = finished.verdict.kinds().collect();
    assert!(shown.iter().eq([row.violation].iter().chain(&row.also)), "{words:#?}");
    assert_eq!(judge(&finished.log), finished.verdict, "the same log judged again");
    let mut stored = vec![];
    finished.log.write(&mut stored).unwrap();
    let read = Log::read(stored.as_slice()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(judge(&read), finished.verdict, "a stored log judged again");
}

/// Makes a test of each row.
macro_rules! table {
    ($($name:ident => $row:expr;)*) => {
        pub(super) const ROWS: &[Row] = &[$($row,)*];

        $(#[test]
        fn $name() {
            super::holds(&$row);
        })*
    };
}
pub(crate) use table;

#[test]
fn every_violation_is_provoked_by_a_row() {
    let files = [sending::ROWS, shown::ROWS, ssi::ROWS, base::ROWS, evidence::ROWS, hold::ROWS];
    let provoked = |violation| files.iter().flat_map(|rows| rows.iter()).any(|row| row.violation == violation);
    let missing: Vec<_> = Violation::ALL.iter().filter(|violation| !provoked(**violation)).collect();
    assert!(missing.is_empty(), "no row provokes {missing:?}");
}

#[test]
fn the_world_breaks_when_the_image_of_a_cycle_is_readable() {
    let Some(finished) = sound(3, SETTLED + 40 * MS) else { return };
    let rises = finished.log.events.iter().filter(|event| matches!(event.what, What::Fresh { high: true, .. }));
    let nearest = rises.map(|event| event.at.abs_diff(breaks())).min().unwrap();
    assert!(nearest <= 200 * US, "{nearest} ns lie between them");
}

/// A run without faults must have no violation, so that a row's violation is due to its fault.
#[test]
fn a_sound_world_shows_no_violation() {
    for gps in [1, 2, 3, 5] {
        let Some(finished) = sound(gps, 600 * MS) else { return };
        let words: Vec<String> = finished.verdict.violations.iter().map(ToString::to_string).collect();
        assert!(words.is_empty(), "{gps} receivers: {words:#?}");
    }
}
