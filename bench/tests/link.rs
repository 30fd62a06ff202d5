//! Tests the whole link with both release programs: figures must keep their bounds, and disturbances must be detected.
//!
//! `cargo xtask test` builds the programs and names their folder in `LINK_IMAGES`. Without that variable no test is
//! run, and each test fails if `CI` is set.

use crate::{boards, waves};

use std::path::PathBuf;

use bench::faults::{AirFaults, Faults};
use bench::sim::flips::flips;
use bench::sim::{Crystals, FrontEndConfig, Images, Outcome, Setup, on_the_link, run};
use bench_judge::Violation;
use boards::{image, not_run};
use gnss_sim::{Log, ubx};
use profile::sequence::SEARCH_CYCLES;

const MS: u64 = 1_000_000;

/// The number of cycles whose objects the DPR rejects because it searches for the sequence.
const SEARCHED: u64 = SEARCH_CYCLES as u64;

fn setup(gps: usize, milliseconds: u64) -> Option<Setup> {
    let images = Images { horus: image(gps, "horus-tx-fw.elf")?, dpr: image(gps, "dpr-fw.elf")? };
    Some(Setup::new(images, gps, milliseconds * MS))
}

fn outcome(setup: &Setup) -> Outcome {
    run(setup, &mut ()).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn with_any_number_of_receivers_every_object_arrives_in_time() {
    for gps in [1, 2, 3, 5] {
        let Some(setup) = setup(gps, 821) else { return };
        let report = outcome(&setup).report;
        assert_eq!(report.violations, [""; 0], "{gps} receivers");
        let frames_per_cycle = if gps == 5 { 2 } else { 1 };
        let cycles = report.air.frames_delivered / frames_per_cycle;
        // The first tick comes after the RAM's test (12 ms), the start (8 to 9 ms) and 10 ms.
        assert_eq!(cycles, 79, "{gps} receivers");
        assert_eq!(report.horus.frames_sent, report.air.frames_delivered);
        let objects = gps as u64 + 1;
        assert_eq!(report.dpr.objects_rejected, SEARCHED * objects);
        assert_eq!(report.dpr.objects_accepted, (cycles - SEARCHED) * objects);
        assert_eq!((report.dpr.frames_missed, report.dpr.scrub_faults), (0, 0));
        assert_eq!((report.base.profiles, report.base.bad_crc), (report.ssi.fresh, 0));
        let command = report.horus.tick_to_command_ns.unwrap();
        assert!(command.max > 0 && command.width() <= 100);
        assert!(report.horus.tick_to_air_ns.unwrap().width() <= 3_000);
        // HORUS's crystal is fast by 8 ppm.
        assert!(report.horus.period_ns.unwrap().min.abs_diff(9_999_920) <= 3_000, "{:?}", report.horus.period_ns);
        assert!(report.ssi.ready_ns.unwrap().max <= 10_000);
        assert!(report.horus.load <= 0.1 && report.dpr.load <= 0.1);
        assert!(report.latency_ns.last_bit_to_readable.unwrap().max <= 100_000);
        if gps == 3 {
            assert_eq!(report.air.bit_rate, 424_000);
            // A frame has 2040 bits of 32 / 13.56 MHz each. The front end's crystal is fast by 8 ppm.
            assert!(report.air.air_time_ns.abs_diff(4_814_159 - 39) <= 2, "{}", report.air.air_time_ns);
            assert!(report.latency_ns.sample_to_readable.unwrap().p999 <= 5_500_000);
        }
    }
}

#[test]
fn the_same_setup_gives_the_same_report_and_another_seed_another_flight() {
    let Some(mut setup) = setup(3, 200) else { return };
    let (first, second) = (outcome(&setup), outcome(&setup));
    assert_eq!(first.report, second.report);
    assert_eq!(first.logs, second.logs);
    let position =
        |outcome: &Outcome| outcome.base.history().last().map(|entry| entry.gps[0].map(|gps| gps.latitude.to_bits()));
    assert_eq!(position(&first), position(&second));
    setup.seed = 2;
    assert_ne!(position(&first), position(&outcome(&setup)));
}

#[test]
fn every_wire_of_the_trace_moves_and_no_instant_comes_before_another() {
    let Some(mut setup) = setup(3, 60) else { return };
    let mut traced = |ending: &str| {
        let file = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("link.{ending}"));
        setup.trace = Some(file.clone());
        (outcome(&setup).report, file)
    };
    let ((report, vcd), (again, fst)) = (traced("vcd"), traced("fst"));
    assert_eq!(report, again);
    setup.trace = None;
    assert_eq!(report, outcome(&setup).report, "a trace only watches");

    let waves = waves::read(&vcd);
    let others = waves::read(&fst);
    assert!(waves.keys().eq(others.keys()), "{:?} and {:?}", waves.keys(), others.keys());
    for (name, changes) in &waves {
        let differ = changes.iter().zip(&others[name]).position(|(one, other)| one != other);
        let at = differ.map(|place| (&changes[place], &others[name][place]));
        assert_eq!((at, changes.len()), (None, others[name].len()), "{name} differs");
    }
    let text = std::fs::read_to_string(vcd).unwrap();
    let instants: Vec<u64> = text.lines().filter_map(|line| line.strip_prefix('#')?.parse().ok()).collect();
    assert!(instants.is_sorted());
    let last = instants.last().unwrap();
    assert!((59 * MS..=60 * MS).contains(last), "{last}");

    // The interrupt pin falls 31 ns after the first clock edge of the byte that clears the interrupt, as on silicon.
    for board in ["horus", "dpr"] {
        let edges = |wire: &str, level: &str| -> Vec<u64> {
            let changes = waves[&format!("{board}.{board}_{wire}")].iter();
            changes.filter(|(at, value)| *at > 0 && value == level).map(|(at, _)| *at).collect()
        };
        let clocks = edges("sck", "1");
        let since_clock = |fall: u64| fall - clocks[clocks.partition_point(|&rise| rise <= fall) - 1];
        let falls: Vec<u64> = edges("irq", "0").into_iter().map(since_clock).collect();
        assert!(falls.len() >= 5, "{board}: {falls:?}");
        assert!(falls.iter().all(|after| (29..=33).contains(after)), "{board}: {falls:?}");
    }
    // The flight controller keeps MOSI low, and each exception belongs to a task. So these three signals do not change.
    let still = ["dpr.tasks.dpr_other", "horus.tasks.horus_other", "ssi.ssi_mosi"];
    let unmoved: Vec<&str> = waves.iter().filter(|(_, changes)| changes.len() < 2).map(|(name, _)| &**name).collect();
    assert_eq!(unmoved, still);
}

#[test]
fn crystals_at_their_worst_against_each_other_change_nothing() {
    let Some(mut setup) = setup(3, 300) else { return };
    for (horus_ppb, dpr_ppb) in [(100_000, -100_000), (-100_000, 100_000)] {
        setup.crystals = Crystals { horus_ppb, dpr_ppb, flight_controller_ppb: dpr_ppb, hold_ppb: 0 };
        let report = outcome(&setup).report;
        assert_eq!(report.violations, [""; 0]);
        assert_eq!(report.dpr.objects_accepted, (report.air.frames_delivered - SEARCHED) * 4);
        assert_eq!(report.dpr.objects_rejected, SEARCHED * 4);
    }
}

/// The crystal's error moves the transactions through all phases of HORUS's cycle within 2 s.
#[test]
fn a_flight_controller_that_reads_at_every_phase_delays_nothing() {
    let Some(mut setup) = setup(3, 2_200) else { return };
    for ppb in [-1_000_000, 1_000_000] {
        setup.crystals.flight_controller_ppb = ppb;
        let report = outcome(&setup).report;
        assert_eq!(report.violations, [""; 0], "{ppb} ppb");
        assert_eq!(report.dpr.objects_accepted, (report.air.frames_delivered - SEARCHED) * 4);
        assert_eq!(report.dpr.objects_rejected, SEARCHED * 4);
        assert_eq!(report.ssi.fresh, report.base.profiles);
        // The DPR is busy in its memory test, and while it puts in an image.
        assert!(report.ssi.busy <= 5, "{:?}", report.ssi);
        assert!(report.ssi.ready_ns.unwrap().max <= 10_000, "{:?}", report.ssi);
        assert!(report.latency_ns.last_bit_to_readable.unwrap().max <= 100_000, "{:?}", report.latency_ns);
    }
}

#[test]
fn bit_errors_cost_the_objects_they_hit_and_nothing_invalid_is_shown() {
    let Some(mut setup) = setup(3, 600) else { return };
    // About one frame in three is damaged, mostly in one object.
    setup.faults = Faults::of_air(AirFaults { bit_error: 2e-4, ..AirFaults::default() });
    let report = outcome(&setup).report;
    assert!(report.air.frames_damaged >= 5, "{:?}", report.air);
    assert!(report.dpr.objects_rejected >= 5, "{:?}", report.dpr);
    assert!(
        report.dpr.objects_rejected < 2 * report.air.frames_damaged,
        "a hit on one object cost others: {:?}",
        report.dpr
    );
    assert_eq!(report.base.bad_crc, 0);
    assert_eq!(report.violations, [""; 0]);
}

#[test]
fn lost_frames_are_missed_counted_and_their_successors_arrive() {
    // The run ends between two frames, so a lost frame counts as missed.
    let Some(mut setup) = setup(3, 595) else { return };
    setup.faults = Faults::of_air(AirFaults { lost: 0.2, ..AirFaults::default() });
    let report = outcome(&setup).report;
    assert_eq!(report.violations, [""; 0]);
    assert!(report.air.frames_lost >= 3, "{:?}", report.air);
    assert_eq!(report.dpr.frames_missed, report.air.frames_lost, "{report:?}");
    // None of the frames with which the DPR finds the sequence is lost.
    assert_eq!(report.dpr.objects_accepted, (report.air.frames_delivered - SEARCHED) * 4);
    assert_eq!(report.dpr.objects_rejected, SEARCHED * 4);
    assert_eq!(report.ssi.bad_crc, 0);
}

#[test]
fn frames_that_break_off_leave_the_link_working() {
    let Some(mut setup) = setup(3, 600) else { return };
    setup.faults = Faults::of_air(AirFaults { truncated: 0.2, ..AirFaults::default() });
    let report = outcome(&setup).report;
    assert_eq!(report.violations, [""; 0]);
    assert!(report.air.frames_damaged >= 3, "{:?}", report.air);
    // The DPR rejects a broken frame by its length.
    assert_eq!(report.dpr.objects_accepted, (report.air.frames_delivered - SEARCHED) * 4, "{report:?}");
    assert_eq!(report.dpr.objects_rejected, SEARCHED * 4, "{report:?}");
    assert_eq!((report.ssi.bad_crc, report.base.bad_crc), (0, 0));
}

#[test]
fn an_image_for_another_profile_is_noticed() {
    let (Some(mut setup), Some(other)) = (setup(3, 200), setup(1, 0)) else { return };
    setup.images.dpr = other.images.dpr;
    let Outcome { report, verdict, .. } = outcome(&setup);
    assert_eq!(report.dpr.objects_accepted, 0);
    assert!(verdict.kinds().any(|violation| violation == Violation::FreshUnreadable), "{:?}", report.violations);
}

fn recording(name: &str) -> Option<PathBuf> {
    let log = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/ubx").join(name);
    if log.exists() {
        return Some(log);
    }
    not_run(&format!("there is no recording {}", log.display()), "it comes with the project's shared data");
    None
}

/// Asserts that the base station shows the positions of the recorded `log` bit by bit, if every receiver sends it.
fn shows_what_the_log_holds(mut setup: Setup, log: PathBuf, at_least: usize) {
    let held = Log::open(&log).unwrap();
    setup.recordings = vec![Some(log); 3];
    let outcome = outcome(&setup);
    assert_eq!(outcome.report.violations, [""; 0]);
    let mut shown: Vec<[u64; 3]> = vec![];
    for entry in outcome.base.history() {
        // Only the GPS objects have the receivers' own values.
        for position in entry.gps.iter().flatten().filter(|position| position.valid) {
            let bits = [position.latitude, position.longitude, position.altitude].map(f64::to_bits);
            if !shown.contains(&bits) {
                shown.push(bits);
            }
        }
    }
    assert!(shown.len() >= at_least, "{} positions shown", shown.len());
    let mut held = held.positions().iter().map(|position| {
        [
            f64::from(position.latitude_1e7) / 1e7,
            f64::from(position.longitude_1e7) / 1e7,
            f64::from(position.height_mm) / 1e3,
        ]
        .map(f64::to_bits)
    });
    for bits in &shown {
        assert!(
            held.any(|position| position == *bits),
            "{:?} is not in the log, or out of order",
            bits.map(f64::from_bits)
        );
    }
}

fn one_hertz(epochs: u32) -> Vec<u8> {
    let fix = |epoch| ubx::NavPvt {
        itow_ms: 100_000 + epoch * 1_000,
        fix_type: 3,
        flags: ubx::NavPvt::FLAG_FIX_OK,
        latitude_1e7: 474_979_123,
        longitude_1e7: 87_290_587,
        height_mm: 470_001,
        horizontal_accuracy_mm: 1_200,
        vertical_accuracy_mm: 2_000,
        ..ubx::NavPvt::default()
    };
    (0..epochs).flat_map(|epoch| fix(epoch).encode()).collect()
}

/// A position is valid for its receiver's period and 150 ms (1.15 s at 1 Hz). HORUS's cycle, the air and the control
/// cycle delay the change.
#[test]
fn reported_position_turns_invalid_in_time_if_all_receivers_fall_silent() {
    for gps in [1, 3] {
        let Some(mut setup) = setup(gps, 5_500) else { return };
        let path = std::env::temp_dir().join(format!("horus-link-silence-{gps}-{}.ubx", std::process::id()));
        std::fs::write(&path, one_hertz(4)).unwrap();
        setup.recordings = vec![Some(path.clone()); gps];
        let report = outcome(&setup).report;
        std::fs::remove_file(path).unwrap();
        assert_eq!(report.violations, [""; 0]);
        let reported = &report.reported;
        // The log's first burst begins 100 ms after reset, and its last one 3 s later.
        let last = reported.last_solution_ns[0].unwrap();
        assert!((3_100 * MS..3_105 * MS).contains(&last), "{reported:?}");
        assert!(reported.valid_cycles >= 300, "{reported:?}");
        let invalid = reported.invalid_since_ns.unwrap_or_else(|| panic!("valid to the end: {reported:?}"));
        let valid_for = invalid - last;
        assert!(
            (1_149 * MS..1_180 * MS).contains(&valid_for),
            "{gps} receivers: valid for {valid_for} ns, {reported:?}"
        );
    }
}

#[test]
fn a_recording_with_nmea_and_damage_is_shown_to_the_last_bit() {
    let Some(setup) = setup(3, 1_200) else { return };
    let mut bytes = vec![];
    for epoch in 0..10_i32 {
        let itow_ms = 100_000 + epoch as u32 * 100;
        let pvt = ubx::NavPvt {
            itow_ms,
            fix_type: 3,
            flags: ubx::NavPvt::FLAG_FIX_OK,
            latitude_1e7: 474_979_123 + epoch * 3,
            longitude_1e7: -87_290_587 - epoch * 7,
            height_mm: 470_001 + epoch,
            horizontal_accuracy_mm: 1_200,
            vertical_accuracy_mm: 2_000,
            ..ubx::NavPvt::default()
        };
        bytes.extend_from_slice(b"$GNGLL,4729.87,N,00843.74,E,110200.00,A,A*78\r\n");
        let mut damaged = ubx::NavPvt { latitude_1e7: 1, ..pvt }.encode();
        damaged[40] ^= 0x10;
        bytes.extend(damaged);
        bytes.extend(pvt.encode());
    }
    let path = std::env::temp_dir().join(format!("horus-link-recording-{}.ubx", std::process::id()));
    std::fs::write(&path, bytes).unwrap();
    shows_what_the_log_holds(setup, path.clone(), 8);
    std::fs::remove_file(path).unwrap();
}

#[test]
fn the_log_of_a_real_receiver_is_shown_to_the_last_bit() {
    let (Some(setup), Some(log)) = (setup(3, 5_000), recording("pygpsdata-MIXED.log")) else { return };
    shows_what_the_log_holds(setup, log, 4);
}

#[test]
fn either_part_carries_the_link_with_and_without_i_txe() {
    for config in [FrontEndConfig::default(), FrontEndConfig::st25r3916()] {
        for txe_with_rx_off in [true, false] {
            for gps in [1, 3, 5] {
                let Some(mut setup) = setup(gps, 821) else { return };
                setup.front_ends = on_the_link(FrontEndConfig { txe_with_rx_off, ..config.clone() });
                let report = outcome(&setup).report;
                let told = format!("{gps} receivers, {:?}, I_txe {txe_with_rx_off}", config.variant);
                assert_eq!(report.violations, [""; 0], "{told}");
                assert_eq!(report.horus.frames_sent, 79 * if gps == 5 { 2 } else { 1 }, "{told}");
                assert!(report.horus.tick_to_command_ns.unwrap().width() <= 100, "{told}");
                assert!(report.latency_ns.last_bit_to_readable.unwrap().max <= 100_000, "{told}");
            }
        }
    }
}

/// Flips one bit of each of several registers, some with and some without an effect. `cargo xtask sim --flips` tries
/// more.
#[test]
fn a_bit_that_flips_in_a_front_end_costs_under_1500_ms() {
    let Some(setup) = setup(3, 100) else { return };
    const BITS: [(bool, u8, u8); 12] = [
        (false, 0x01, 5),
        (false, 0x02, 6),
        (false, 0x05, 3),
        (false, 0x0B, 3),
        (false, 0x0D, 3),
        (false, 0x16, 4),
        (false, 0x26, 7),
        (false, 0x28, 6),
        (false, 0x2A, 4),
        (true, 0x0C, 6),
        (true, 0x28, 7),
        (true, 0x2E, 3),
    ];
    let takes = |_, bit: bench::faults::RegisterBit| BITS.contains(&(bit.in_space_b, bit.address, bit.bit));
    let flips = flips(&setup, takes, |_| ()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(flips.0.len(), 4 * BITS.len() - 2);
    for flip in &flips.0 {
        assert!(flip.holds() && !flip.unsaid(), "{flip}");
    }
    let lost = flips.0.iter().filter(|flip| flip.back_after != Some(0)).count();
    assert!(lost >= 6, "some cost data: {flips}");
}
