//! The table of violations: each is provoked by a broken world or a broken release image, and by that it and no other
//! violation shows. A violation that no row provokes fails the table, so there is none that cannot occur.
//!
//! Each row's event log is judged twice, and once more after it was stored and read again: the verdict is the same.

#[path = "../boards/mod.rs"]
mod boards;

mod base;
mod evidence;
mod images;
mod sending;
mod shown;
mod ssi;

use bench::faults::Faults;
use bench::sim::{Bench, Finished, Images, Setup};
use bench_judge::{Event, Log, Violation, What, judge};

const US: u64 = 1_000;
const MS: u64 = 1_000_000;

/// From when on the world is broken: both boards have started, and the link has been up for 200 ms. It lies 5 ms after
/// one of HORUS's ticks, which come as long after the start as the test of HORUS's RAM and the comparison of its image
/// with its CRC take, and less than 2 ms before the flight controller reads, every 4 ms.
const BREAKS: u64 = 315_900_000;

/// A row of the table.
struct Row {
    /// What must show, and nothing else.
    violation: Violation,
    /// Receivers in the profile.
    gps: usize,
    /// How long the run is, ns.
    duration: u64,
    /// What else of the set-up is other than in a sound run.
    setup: fn(&mut Setup),
    /// What is broken.
    faults: fn() -> Faults,
    /// What is broken besides, told to the bench when both boards have come to [`BREAKS`].
    added: fn() -> Faults,
}

impl Row {
    /// With three receivers, for 600 ms.
    const fn new(violation: Violation, faults: fn() -> Faults) -> Self {
        Self { violation, gps: 3, duration: 600 * MS, setup: |_| {}, faults, added: Faults::none }
    }
}

/// The run of a row; `None` where the images were not built.
fn run(row: &Row) -> Option<Finished> {
    let image = |name| boards::image(row.gps, name);
    let images = Images { horus: image("horus-tx-fw.elf")?, dpr: image("dpr-fw.elf")? };
    let mut setup = Setup::new(images, row.gps, row.duration);
    setup.faults = (row.faults)();
    (row.setup)(&mut setup);
    let mut bench: Bench = Bench::new(&setup).unwrap_or_else(|error| panic!("{error}"));
    bench.keep_log();
    bench.run_to(BREAKS.min(row.duration), setup.threads);
    bench.add_faults(&(row.added)());
    bench.run_to(row.duration, setup.threads);
    Some(bench.finish(row.duration))
}

/// Holds a row against what it must show.
fn holds(row: &Row) {
    let Some(finished) = run(row) else { return };
    let words: Vec<String> = finished.verdict.violations.iter().map(ToString::to_string).collect();
    let shown: Vec<Violation> = finished.verdict.kinds().collect();
    assert_eq!(shown, [row.violation], "{words:#?}");
    assert_eq!(judge(&finished.log), finished.verdict, "the same log judged again");
    let mut stored = vec![];
    finished.log.write(&mut stored).unwrap();
    let read = Log::read(stored.as_slice()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(judge(&read), finished.verdict, "a stored log judged again");
}

/// Rows, each with a test of its own.
macro_rules! table {
    ($($name:ident => $row:expr;)*) => {
        /// The rows of this file.
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
    let files = [sending::ROWS, shown::ROWS, ssi::ROWS, base::ROWS, evidence::ROWS];
    let provoked = |violation| files.iter().flat_map(|rows| rows.iter()).any(|row| row.violation == violation);
    let missing: Vec<_> = Violation::ALL.iter().filter(|violation| !provoked(**violation)).collect();
    assert!(missing.is_empty(), "no row provokes {missing:?}");
}

#[test]
fn the_world_breaks_when_the_image_of_a_cycle_is_readable() {
    let Some(finished) = run(&Row::new(Violation::NoTick, Faults::none)) else { return };
    let is_tick = |event: &&Event| event.what == What::Tick && event.at <= BREAKS;
    let tick = finished.log.events.iter().rfind(is_tick).unwrap().at;
    assert!((BREAKS - tick).abs_diff(5 * MS) <= 200 * US, "it comes {} ns after the tick", BREAKS - tick);
}

/// In a sound world nothing is violated, with any number of receivers: what a row shows comes from what it breaks.
#[test]
fn a_sound_world_shows_no_violation() {
    for gps in [1, 2, 3, 5] {
        let row = Row { gps, ..Row::new(Violation::NoTick, Faults::none) };
        let Some(finished) = run(&row) else { return };
        let words: Vec<String> = finished.verdict.violations.iter().map(ToString::to_string).collect();
        assert!(words.is_empty(), "{gps} receivers: {words:#?}");
    }
}
