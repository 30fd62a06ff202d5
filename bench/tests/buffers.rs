//! Tests bits of the DPR's receive and image buffers that flip or are stuck: nothing wrong is shown as valid, and a
//! scrub finds and reports a stuck bit.

use crate::boards;

use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};

use bench::faults::{BufferFault, Buffers, Fault, Faults, Kind};
use bench::sim::{Images, Outcome, Setup, run};
use bench_judge::{Log, What, bounds};
use boards::image;
use dpr_fw::RECEIVE_WORDS;
use dpr_fw::rf::LEAD;
use dpr_fw::triple::RECEIVE_BUFFERS;

const MS: u64 = 1_000_000;

fn outcome(faults: Faults, duration: u64) -> Option<Outcome> {
    outcome_of(faults, duration, None)
}

fn outcome_of(faults: Faults, duration: u64, log: Option<PathBuf>) -> Option<Outcome> {
    let images = Images { horus: image(3, "horus-tx-fw.elf")?, dpr: image(3, "dpr-fw.elf")? };
    let setup = Setup { faults, log, ..Setup::new(images, 3, duration) };
    Some(run(&setup, &mut ()).unwrap_or_else(|error| panic!("{error}")))
}

#[test]
fn bits_that_flip_in_any_cycle_are_never_shown_as_valid() {
    let mut faults = Faults::none();
    for (nth, at) in (300..900).step_by(7).enumerate() {
        // The multiplication spreads the flips over all buffers.
        let word = (nth as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 20;
        let buffers = if nth % 2 == 0 { Buffers::Receive } else { Buffers::Image };
        faults = faults.with(at * MS, at * MS, Fault::Buffer(BufferFault::Flips(buffers, word)));
    }
    let Some(outcome) = outcome(faults, 1_200 * MS) else { return };
    assert_eq!(outcome.report.violations, [""; 0]);
    assert_eq!(outcome.report.faults.invalid_shown_valid, 0);
    // Some flips changed an object that was read, and its CRC showed it.
    assert!(outcome.report.ssi.bad_crc > 0, "{:?}", outcome.report.ssi);
}

#[test]
fn a_scrub_finds_a_bit_stuck_at_either_value() {
    for buffers in [Buffers::Receive, Buffers::Image] {
        for value in [false, true] {
            let stuck = Fault::Buffer(BufferFault::Stuck(buffers, value, 1_234));
            let Some(outcome) = outcome(Faults::none().with(300 * MS, 500 * MS, stuck), 950 * MS) else { return };
            assert_eq!(outcome.report.violations, [""; 0], "{buffers:?}, {value}");
            assert!(outcome.report.dpr.scrub_faults > 0, "{buffers:?}, {value}");
        }
    }
    let Some(sound) = outcome(Faults::none(), 600 * MS) else { return };
    assert_eq!(sound.report.dpr.scrub_faults, 0);
}

/// If the length of a frame changes in the buffer, the DPR verifies the frame only after its last bit.
#[test]
fn a_bit_stuck_in_a_frames_length_only_makes_it_late() {
    let mut late = 0;
    for buffer in 0..RECEIVE_BUFFERS as u64 {
        let length = 8 * (buffer * 4 * RECEIVE_WORDS as u64 + LEAD as u64);
        // A frame for three receivers has LEN 245. The stuck bit is the lowest bit of LEN.
        let stuck = Fault::Buffer(BufferFault::Stuck(Buffers::Receive, false, length));
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("stuck-{buffer}.log"));
        let faults = Faults::none().with(300 * MS, 340 * MS, stuck);
        let Some(outcome) = outcome_of(faults, 600 * MS, Some(path.clone())) else { return };
        assert_eq!(outcome.report.violations, [""; 0], "buffer {buffer}");
        let log = Log::read(BufReader::new(File::open(&path).unwrap())).unwrap();
        fs::remove_file(path).unwrap();
        let mut ended = None;
        let latency = log.events.iter().filter_map(|event| match event.what {
            What::Heard { .. } => {
                ended = Some(event.at);
                None
            }
            What::Fresh { high: true, .. } => ended.take().map(|ended| event.at - ended),
            _ => None,
        });
        late += latency.filter(|latency| *latency > bounds::LAST_BIT_TO_READABLE).count();
    }
    // A scrub takes the buffer with the stuck bit out of use, so at most one frame per buffer is late.
    assert!((1..=RECEIVE_BUFFERS).contains(&late), "{late} frames were late");
}

#[test]
fn drawn_faults_of_the_buffers_violate_nothing() {
    for seed in [1, 2] {
        let drawn = Faults::drawn(&[Kind::Buffers], 3, seed, 6_000 * MS);
        let Some(outcome) = outcome(drawn, 6_000 * MS) else { return };
        assert_eq!(outcome.report.violations, [""; 0], "seed {seed}");
        assert_eq!(outcome.report.faults.invalid_shown_valid, 0);
        assert!(outcome.report.faults.injected.keys().all(|name| name.starts_with("buffer dpr")));
    }
}
