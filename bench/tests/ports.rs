//! Tests that the flight controller's use or misuse of the SSI changes nothing for HORUS's frames: the numbers of
//! frames and objects and the time from sample to announcement differ by less than 1 %. The tasks of the SSI may delay
//! a frame's image twice.

use crate::boards;

use bench::faults::{Conduct, Fault, Faults};
use bench::sim::{Bench, Images, Setup, telemetry};
use bench_judge::{Log, Quantiles, What};
use boards::image;
use cortex_m4::{Cost, Fast, Pessimistic};
use profile::image::Image;

const MS: u64 = 1_000_000;
/// The interval, ns, of the flight controller's misuse.
const EPISODE: std::ops::Range<u64> = 300 * MS..900 * MS;

/// The longest time, ns, by which the SSI's tasks delay a frame (`sums.rs`). It adds the end of a pause, the end of a
/// transaction, and another end of a transaction within the publication.
const FAST_SHARE: u64 = 14_000;
/// The longest time by which the SSI's tasks delay a frame on the pessimistic clock, ns (`sums.rs`: 17.2 µs).
const PESSIMISTIC_SHARE: u64 = 22_500;

#[derive(Debug)]
struct Figures {
    frames: u64,
    accepted: u64,
    rejected: u64,
    announced: Quantiles,
    last_bit: u64,
}

/// Returns for each frame the time to the next rise of FRESH, ns, from the tick and from the frame's last bit.
fn announced(log: &Log) -> impl Iterator<Item = (u64, u64)> {
    let (mut tick, mut heard) = (None, None);
    log.events.iter().filter_map(move |event| match &event.what {
        What::Tick => {
            tick = Some(event.at);
            None
        }
        What::Heard { .. } => {
            heard = tick.map(|tick| (tick, event.at));
            None
        }
        What::Fresh { high: true, .. } => heard.take().map(|(tick, last_bit)| (event.at - tick, event.at - last_bit)),
        _ => None,
    })
}

fn warm<C: Cost>() -> Option<(Setup, Bench<C>)> {
    let images = Images { horus: image(3, "horus-tx-fw.elf")?, dpr: image(3, "dpr-fw.elf")? };
    let setup = Setup::new(images, 3, EPISODE.end);
    let mut bench = Bench::new(&setup).unwrap_or_else(|error| panic!("{error}"));
    bench.run_to(EPISODE.start, setup.threads);
    Some((setup, bench))
}

fn figures<C: Cost>((setup, bench): &(Setup, Bench<C>), conduct: Option<Conduct>) -> Figures {
    let mut bench = bench.clone();
    if let Some(conduct) = conduct {
        bench.add_faults(&Faults::none().with(EPISODE.start + MS, u64::MAX, Fault::FlightController(conduct)));
    }
    let counters = |bench: &Bench<C>| {
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
    let last_bit = announced(&finished.log).map(|(_, after)| after).max().unwrap();
    let announced = Quantiles::of(announced(&finished.log).map(|(after, _)| after)).unwrap();
    Figures { frames, accepted, rejected, announced, last_bit }
}

/// Asserts that these misuses change no figure, except for delays of at most `share_ns`.
fn changes_nothing<C: Cost>(conducts: impl IntoIterator<Item = Conduct>, share_ns: u64) {
    let Some(warm) = warm::<C>() else { return };
    let quiet = figures(&warm, Some(Conduct::Silent));
    println!("{} clock: {quiet:?}", C::NAME);
    assert!(quiet.frames >= 59 && quiet.accepted == 4 * quiet.frames, "{quiet:?}");
    let close = |a: u64, b: u64| a.abs_diff(b) * 100 < b.max(1);
    for conduct in conducts.into_iter().map(Some).chain([None]) {
        let figures = figures(&warm, conduct);
        println!("{conduct:?}: {:?}, last bit {}", figures.announced, figures.last_bit);
        let words = format!("{conduct:?}: {figures:?} instead of {quiet:?}");
        assert_eq!(
            (figures.frames, figures.accepted, figures.rejected),
            (quiet.frames, quiet.accepted, quiet.rejected),
            "{words}"
        );
        assert!(close(figures.announced.p50, quiet.announced.p50), "{words}");
        assert!(close(figures.announced.p999, quiet.announced.p999), "{words}");
        assert!(close(figures.announced.max, quiet.announced.max), "{words}");
        assert!(figures.last_bit <= quiet.last_bit + share_ns, "{words}");
    }
}

/// Returns edges of chip select and transactions with many periods. None divides HORUS's cycle, so that each meets
/// frames in many phases.
fn rates() -> impl Iterator<Item = Conduct> {
    let edges = [997_000, 293_000, 117_000, 97_000, 53_000, 11_300, 2_000, 1_000, 250].map(Conduct::Edges);
    let each =
        |bytes| [997_000, 293_000, 117_000, 97_000, 53_000, 0].map(|period_ns| Conduct::Every { period_ns, bytes });
    edges.into_iter().chain([0, 1, 8, 96, Image::<3>::LEN].into_iter().flat_map(each))
}

/// Makes as many transactions as the DPR serves for one image, at all times after a frame's end. Asserts that they
/// delay the frame's image by at most `share_ns`.
fn begins_in_every_phase<C: Cost>(share_ns: u64) {
    let Some((setup, bench)) = warm::<C>() else { return };
    let silent = |until| Faults::none().with(EPISODE.start + MS, until, Fault::FlightController(Conduct::Silent));
    let last_bits = |faults: &Faults, end: u64| {
        let mut bench = bench.clone();
        bench.add_faults(faults);
        bench.keep_log();
        bench.run_to(end, setup.threads);
        bench.finish(end).log
    };
    let log = last_bits(&silent(u64::MAX), EPISODE.start + 30 * MS);
    let heard = log.events.iter().filter(|event| matches!(event.what, What::Heard { .. })).map(|event| event.at);
    let last_bit = heard.filter(|at| *at > EPISODE.start + 5 * MS).min().expect("a frame");
    let (_, quiet) = announced(&log).last().expect("a frame");
    let conducts = [250, 1_000, 2_000].map(Conduct::Edges);
    let each = [0, 1, 8].map(|bytes| Conduct::Every { period_ns: 0, bytes });
    let mut worst = 0;
    for conduct in conducts.into_iter().chain(each) {
        for phase in (-180_000..60_000).step_by(7_300) {
            let begins = last_bit.saturating_add_signed(phase);
            let faults = silent(begins).with(begins, u64::MAX, Fault::FlightController(conduct));
            let (_, after) = announced(&last_bits(&faults, last_bit + MS)).last().expect("the frame");
            assert!(after <= quiet + share_ns, "{conduct:?} from {phase} ns on: {after} ns instead of {quiet}");
            worst = worst.max(after);
        }
    }
    println!("{} clock: {worst} ns at worst, {quiet} without", C::NAME);
    assert!(worst > quiet, "some phase meets the frame");
}

#[test]
fn selecting_beside_a_frames_end_delays_it_by_a_bounded_share() {
    begins_in_every_phase::<Fast>(FAST_SHARE);
    begins_in_every_phase::<Pessimistic>(PESSIMISTIC_SHARE);
}

// Shows WAY-3, WAY-4.
#[test]
fn no_misconduct_of_the_flight_controller_changes_what_the_rfid_side_does() {
    changes_nothing::<Fast>(Conduct::ALL, FAST_SHARE);
}

#[test]
fn no_rate_of_the_flight_controller_changes_the_rfid_side() {
    changes_nothing::<Fast>(rates(), FAST_SHARE);
}

#[test]
fn on_the_pessimistic_clock_it_does_not_either() {
    changes_nothing::<Pessimistic>(rates().chain(Conduct::ALL), PESSIMISTIC_SHARE);
}
