//! Compares the bounds of a search with a run that is not part of the search.

use std::path::{Path, PathBuf};

use bench::faults::{Faults, Kind};
use bench::sim::{Images, Setup, processors};
use bench_timing::bounds::figures;
use bench_timing::chart;
use bench_timing::search::{TimingImages, charted, observe, runs, search};
use emulator_node::{AnyNode, Clock, Threads};

const MS: u64 = 1_000_000;

/// The images with three receivers; `None` and a message if they were not built.
fn images() -> Option<TimingImages> {
    let folder = std::env::var_os("LINK_IMAGES").map(PathBuf::from);
    let Some(folder) = folder.filter(|folder| folder.join("gps-3/dpr-fw-hold.elf").is_file()) else {
        assert!(std::env::var_os("CI").is_none(), "LINK_IMAGES does not lead to the images");
        eprintln!("not run: `cargo xtask test` builds the images and says in LINK_IMAGES where they are");
        return None;
    };
    let of = |name: &str| folder.join("gps-3").join(name);
    let link = Images { horus: of("horus-tx-fw.elf"), dpr: of("dpr-fw.elf") };
    Some(TimingImages { link, dpr_with_hold: of("dpr-fw-hold.elf"), hold: folder.join(Path::new("hold-fw.elf")) })
}

#[test]
fn no_response_of_another_run_with_faults_is_above_its_bound() {
    let Some(images) = images() else { return };
    let mut of_search = runs(&images, 3, Clock::Pessimistic);
    of_search.retain(|run| run.setup.hold.is_none());
    let (boards, _) = search(of_search).unwrap();
    let faults = Faults::drawn(&[Kind::Air, Kind::Gnss, Kind::FlightController], 3, 77, 3_000 * MS);
    let link = images.link.clone();
    let setup = Setup {
        clock: Clock::Pessimistic,
        seed: 77,
        faults,
        threads: Threads::Two,
        writes: true,
        ..Setup::new(link, 3, 3_000 * MS)
    };
    let tables: Vec<_> = boards.iter().map(|(table, _)| table.clone()).collect();
    let shown = observe(&setup, &tables, false).unwrap();
    for ((table, seen), shown) in boards.iter().zip(&shown.boards) {
        for (task, shown) in figures(table, seen).tasks.iter().zip(&shown.observations.tasks) {
            let bound = task.bound_ns.unwrap_or_else(|| panic!("{}, {}: no bound", table.board, task.task));
            assert!(shown.jobs > 0 && shown.response > 0, "{}, {}: it did not run", table.board, task.task);
            assert!(shown.response <= bound, "{}, {}: {} > {bound}", table.board, task.task, shown.response);
        }
    }
}

#[test]
fn the_chart_shows_boards_air_ssi_and_hold_in_one_cycle() {
    let Some(images) = images() else { return };
    let run = charted(&images, 3, Clock::Fast);
    let shown = observe(&run.setup, &run.tables(), true).unwrap();
    let (from, to) = chart::worst_cycle(shown.log.as_ref().unwrap()).unwrap();
    let lanes = chart::lanes(&run, &shown);
    for group in ["HORUS", "DPR", "SSI", "hold", "air"] {
        let bars = lanes.iter().filter(|lane| lane.group == group).flat_map(|lane| &lane.bars);
        let within = bars.clone().filter(|bar| bar.from < to && bar.to > from).count();
        assert!(bars.count() > 0 && (within > 0 || group == "hold"), "{group}");
    }
    let trace: serde_json::Value = serde_json::from_str(&chart::chrome_trace(&lanes)).unwrap();
    let bars = trace["traceEvents"].as_array().unwrap().iter().filter(|event| event["ph"] == "X").count();
    assert_eq!(bars, lanes.iter().map(|lane| lane.bars.len()).sum::<usize>());
}

#[test]
fn an_observed_run_is_the_one_without_an_observer() {
    let Some(images) = images() else { return };
    for clock in [Clock::Fast, Clock::Pessimistic] {
        let setup = Setup { duration_ns: 600 * MS, ..charted(&images, 3, clock).setup };
        let report = |observed: bool| {
            let watch = &mut |_: u64, nodes: Vec<&mut dyn AnyNode>| {
                nodes.into_iter().filter(|_| observed).for_each(|node| {
                    node.watch_schedule(true);
                    node.take_schedule();
                });
            };
            let finished = processors::watch(&setup, 100 * MS, true, watch).unwrap();
            (finished.report, finished.log.events)
        };
        assert_eq!(report(true), report(false), "{clock}");
    }
}
