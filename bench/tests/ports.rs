//! What the flight controller does on the SSI leaves the RFID side as it is: frames received, objects accepted, and how
//! soon after its sample each cycle is announced, differ by less than 1 % from those with a flight controller that
//! keeps to the rules.

mod boards;

use bench::faults::{Conduct, Fault, Faults};
use bench::sim::{Bench, Images, Setup, telemetry};
use bench_judge::{Log, Quantiles, What};
use boards::image;

const MS: u64 = 1_000_000;
/// From when to when the flight controller misuses the SSI, ns, and is looked at.
const EPISODE: std::ops::Range<u64> = 300 * MS..1_300 * MS;

/// What the RFID side did in [`EPISODE`].
#[derive(Debug)]
struct Figures {
    frames: u64,
    accepted: u64,
    rejected: u64,
    /// From HORUS's tick to FRESH, ns.
    announced: Quantiles,
}

/// From the last tick before each frame to the rise of FRESH that follows it, ns.
fn announced(log: &Log) -> impl Iterator<Item = u64> {
    let (mut tick, mut heard) = (None, None);
    log.events.iter().filter_map(move |event| match &event.what {
        What::Tick => {
            tick = Some(event.at);
            None
        }
        What::Heard { .. } => {
            heard = tick;
            None
        }
        What::Fresh { high: true, .. } => heard.take().map(|tick| event.at - tick),
        _ => None,
    })
}

/// The figures with a flight controller that behaves so; `None` where the images were not built.
fn figures(conduct: Option<Conduct>) -> Option<Figures> {
    let images = Images { horus: image(3, "horus-tx-fw.elf")?, dpr: image(3, "dpr-fw.elf")? };
    let mut setup = Setup::new(images, 3, EPISODE.end);
    if let Some(conduct) = conduct {
        setup.faults = Faults::none().with(EPISODE.start, u64::MAX, Fault::FlightController(conduct));
    }
    let mut bench: Bench = Bench::new(&setup).unwrap_or_else(|error| panic!("{error}"));
    bench.run_to(EPISODE.start, setup.threads);
    let counters = |bench: &Bench| {
        let of = |name| u64::from(telemetry::of_dpr(bench.dpr(), name).unwrap());
        ["frames_received", "objects_accepted", "objects_rejected"].map(of)
    };
    let before = counters(&bench);
    bench.keep_log();
    bench.run_to(EPISODE.end, setup.threads);
    let after = counters(&bench);
    let [frames, accepted, rejected] = std::array::from_fn(|nth| after[nth] - before[nth]);
    let finished = bench.finish(EPISODE.end);
    assert_eq!(finished.verdict.violations, [], "{conduct:?}");
    let announced = Quantiles::of(announced(&finished.log)).unwrap();
    Some(Figures { frames, accepted, rejected, announced })
}

#[test]
fn no_misconduct_of_the_flight_controller_changes_what_the_rfid_side_does() {
    let Some(well_behaved) = figures(None) else { return };
    assert!(well_behaved.frames >= 99 && well_behaved.accepted == 4 * well_behaved.frames, "{well_behaved:?}");
    let close = |a: u64, b: u64| a.abs_diff(b) * 100 < b.max(1);
    for conduct in Conduct::ALL {
        let Some(figures) = figures(Some(conduct)) else { return };
        let words = format!("{conduct:?}: {figures:?} instead of {well_behaved:?}");
        assert!(close(figures.frames, well_behaved.frames), "{words}");
        assert!(close(figures.accepted, well_behaved.accepted), "{words}");
        assert_eq!(figures.rejected, well_behaved.rejected, "{words}");
        assert!(close(figures.announced.p50, well_behaved.announced.p50), "{words}");
        assert!(close(figures.announced.p999, well_behaved.announced.p999), "{words}");
        assert!(close(figures.announced.max, well_behaved.announced.max), "{words}");
    }
}
