//! Tests receivers on a UART, on I2C and on SPI. Their values are shown bit by bit. If one interface fails, HORUS still
//! sends every cycle and shows the other receivers, and the effect of the failure ends soon.

use crate::boards;

use std::sync::Arc;

use bench::boards::Horus;
use bench::faults::receivers::bus::BusFault;
use bench::faults::{Board, Fault, Faults, PowerFault, ReceiverFault, Rng};
use bench::sim::{Bench, Images, Outcome, Setup, run};
use bench::world::base_station::{Entry, Position};
use bench_judge::{What, bounds};
use boards::image;
use emulator_node::{Clock, Node, Threads};
use gnss_sim::Port;
use gnss_sim::{Log, ubx};

const MS: u64 = 1_000_000;

fn setup(milliseconds: u64) -> Option<Setup> {
    let images = Images { horus: image(3, "horus-tx-fw.elf")?, dpr: image(3, "dpr-fw.elf")? };
    Some(Setup::new(images, 3, milliseconds * MS))
}

fn sound(setup: &Setup) -> Outcome {
    let outcome = run(setup, &mut ()).unwrap_or_else(|error| panic!("{error}"));
    let what = || setup.faults.episodes().iter().map(|episode| episode.fault.name()).collect::<Vec<_>>();
    assert_eq!(outcome.report.violations, [""; 0], "{:?}", what());
    // HORUS's start takes up to four cycles on the pessimistic clock, and two on the others. The frames of these
    // cycles, and one more, may be missing.
    let started = if setup.clock == Clock::Pessimistic { 5 } else { 3 };
    let cycles = setup.duration_ns / (10 * MS);
    assert!(outcome.report.horus.frames_sent >= cycles - started, "{:?}: {:?}", what(), outcome.report.horus);
    assert_eq!((outcome.report.air.frames_lost, outcome.report.dpr.frames_missed), (0, 0), "{:?}", what());
    outcome
}

fn validity(outcome: &Outcome, receiver: usize) -> Vec<(u64, bool)> {
    let of = |gps: [Option<Position>; 5]| gps[receiver].is_some_and(|it| it.valid);
    outcome.base.history().map(|entry| (entry.at_ns, of(entry.gps))).collect()
}

fn log() -> Vec<u8> {
    (0..10_i32)
        .flat_map(|epoch| {
            let pvt = ubx::NavPvt {
                itow_ms: 100_000 + epoch as u32 * 100,
                fix_type: 3,
                flags: ubx::NavPvt::FLAG_FIX_OK,
                // The latitude contains bytes of value 0xFF, which are filler only between messages.
                latitude_1e7: 0x1C4F_FFFF + epoch * 7,
                longitude_1e7: 87_290_587 - epoch * 11,
                height_mm: 470_001 + epoch,
                horizontal_accuracy_mm: 1_200,
                vertical_accuracy_mm: 2_000,
                ..ubx::NavPvt::default()
            };
            let mut bytes = b"$GNTXT,01,01,02,u-blox AG - www.u-blox.com*4E\r\n".to_vec();
            bytes.extend(pvt.encode());
            if epoch == 4 {
                let damaged = bytes.len() - 9;
                bytes[damaged] ^= 0x10;
            }
            bytes.extend([0x00, 0xFF, 0xB5]);
            bytes
        })
        .collect()
}

#[test]
fn a_recorded_log_gives_bit_exact_gps_objects_on_each_interface() {
    let Some(mut setup) = setup(1_300) else { return };
    let path = std::env::temp_dir().join(format!("horus-receivers-{}.ubx", std::process::id()));
    std::fs::write(&path, log()).unwrap();
    setup.recordings = vec![Some(path.clone()); 3];
    let held = Arc::new(Log::open(&path).unwrap());
    let outcome = sound(&setup);
    std::fs::remove_file(path).unwrap();
    let held: Vec<[u64; 3]> = held
        .positions()
        .iter()
        .map(|position| [position.latitude(), position.longitude(), position.altitude()].map(f64::to_bits))
        .collect();
    assert_eq!(held.len(), 9, "one is damaged");
    for receiver in 0..3 {
        let mut shown: Vec<[u64; 3]> = outcome
            .base
            .history()
            .filter_map(|entry| entry.gps[receiver].filter(|position| position.valid))
            .map(|position| [position.latitude, position.longitude, position.altitude].map(f64::to_bits))
            .collect();
        shown.dedup();
        // On SPI, HORUS drops the first message, which may have waited. It also drops the second one if no filler has
        // shown that the receiver's buffer is empty.
        let first = if receiver == 2 { 1..=2 } else { 0..=0 };
        assert!(first.into_iter().any(|first| shown == held[first..]), "GPS{}: {shown:?} of {held:?}", receiver + 1);
    }
}

fn log_that_jumps() -> Vec<u8> {
    let epoch = |epoch: u32| ubx::NavPvt {
        itow_ms: 100_000 + epoch * 40,
        fix_type: 3,
        flags: ubx::NavPvt::FLAG_FIX_OK,
        latitude_1e7: 474_979_123 + if epoch < 30 { 0 } else { 89_930 },
        longitude_1e7: 87_290_587,
        height_mm: 470_001,
        horizontal_accuracy_mm: 1_200,
        vertical_accuracy_mm: 2_000,
        ..ubx::NavPvt::default()
    };
    (0..75).flat_map(|number| epoch(number).encode()).collect()
}

fn reported_from(outcome: &Outcome, from: u64) -> Vec<(u64, Position)> {
    let history = outcome.base.history().filter_map(|entry| Some((entry.at_ns / MS, entry.reported?)));
    history.filter(|(at, _)| *at >= from).collect()
}

#[test]
fn a_log_that_jumps_by_1_km_is_shown_a_second_later() {
    let Some(mut setup) = setup(2_900) else { return };
    let path = std::env::temp_dir().join(format!("horus-jump-{}.ubx", std::process::id()));
    std::fs::write(&path, log_that_jumps()).unwrap();
    setup.recordings = vec![Some(path.clone()); 3];
    let outcome = sound(&setup);
    std::fs::remove_file(path).unwrap();
    let shown: Vec<_> = reported_from(&outcome, 300);
    let is_far = |position: &Position| position.latitude > 47.502;
    let last_near = shown.iter().rfind(|(_, position)| position.valid && !is_far(position)).expect("shown").0;
    let first_far = shown.iter().find(|(_, position)| position.valid && is_far(position)).expect("shown").0;
    println!("from {last_near} to {first_far} ms nothing is shown");
    assert!((1_000..1_100).contains(&(first_far - last_near)), "{last_near} {first_far}");
    for (at, position) in shown {
        assert_eq!(position.valid, at <= last_near || at >= first_far, "at {at} ms");
    }
}

#[test]
fn one_receiver_in_3d_beside_two_in_2d_shows_no_altitude() {
    let Some(mut setup) = setup(1_400) else { return };
    let (from, until) = (500 * MS, 900 * MS);
    let high = ReceiverFault::Offset { north: 0, east: 0, up: 500 };
    setup.faults = [ReceiverFault::Flat, ReceiverFault::Flat, high]
        .into_iter()
        .zip(0..)
        .fold(Faults::none(), |faults, (fault, receiver)| faults.with(from, until, Fault::Receiver(receiver, fault)));
    let outcome = sound(&setup);
    let altitudes = reported_from(&outcome, 300);
    assert!(
        altitudes
            .iter()
            .all(|(_, position)| position.valid && (position.altitude.is_nan() || position.altitude <= 800.0))
    );
    let during = altitudes.iter().filter(|(at, _)| (770..900).contains(at));
    assert!(during.clone().count() > 10 && during.clone().all(|(_, position)| position.altitude.is_nan()));
    assert!(altitudes.iter().any(|(at, position)| *at > 1_200 && position.altitude > 400.0), "it is back");
}

#[test]
fn an_attitude_that_two_receivers_contradict_each_other_in_is_not_shown() {
    let Some(mut setup) = setup(1_400) else { return };
    let turned = Fault::Receiver(2, ReceiverFault::Turned { degrees: 180 });
    setup.faults = Faults::none().with(500 * MS, 900 * MS, turned);
    let outcome = sound(&setup);
    let oriented = |from: u64, until: u64| {
        let mut shown = reported_from(&outcome, from);
        shown.retain(|(at, _)| *at < until);
        shown.iter().filter(|(_, position)| position.oriented).count() as f64 / shown.len() as f64
    };
    assert!(oriented(350, 500) > 0.9 && oriented(1_200, 1_400) > 0.9);
    assert!(oriented(770, 900) < 1e-9);
}

const FAILS: std::ops::Range<u64> = 500 * MS..900 * MS;
/// The longest time from the end of a bus's fault to a valid position, ns. HORUS tries the bus again within 110 ms
/// (decision 16), a solution comes within 200 ms, and the way to the base station takes 50 ms.
const BACK: u64 = 360 * MS;

fn of_bus(clock: Clock) {
    for fault in BusFault::ALL {
        let Some(mut setup) = setup(1_600) else { return };
        let receiver = if fault.interface() == Port::I2c { 1 } else { 2 };
        setup.clock = clock;
        let injected = Fault::Receiver(receiver, ReceiverFault::Bus(fault));
        setup.faults = Faults::none().with(FAILS.start, FAILS.end, injected);
        let outcome = sound(&setup);
        for other in (0..3).filter(|other| *other != receiver) {
            let lost: Vec<_> =
                validity(&outcome, other).into_iter().filter(|(at, valid)| *at > 450 * MS && !valid).collect();
            assert_eq!(lost, [], "{fault:?}: GPS{}", other + 1);
        }
        let of = validity(&outcome, receiver);
        assert!(of.iter().any(|(at, valid)| *at < FAILS.start && *valid), "{fault:?}: it worked before");
        let after: Vec<_> = of.iter().filter(|(at, _)| *at > FAILS.end + BACK).collect();
        assert!(after.len() > 20 && after.iter().all(|(_, valid)| *valid), "{fault:?}: it is not back");
        let back = of.iter().rev().take_while(|(_, valid)| *valid).last().unwrap().0;
        println!("{clock} {fault:?}: valid to the end from {} ms after its end on", back as i64 / 1_000_000 - 900);
    }
}

#[test]
fn a_bus_fault_costs_no_other_receiver_on_the_fast_clock() {
    of_bus(Clock::Fast);
}

#[test]
fn a_bus_fault_costs_no_other_receiver_on_the_optimistic_clock() {
    of_bus(Clock::Optimistic);
}

#[test]
fn a_bus_fault_costs_no_other_receiver_on_the_pessimistic_clock() {
    of_bus(Clock::Pessimistic);
}

#[test]
fn endless_bus_errors_take_at_most_two_percent_of_the_processor() {
    let Some(mut horus) = boards::horus() else { return };
    let run = |node: &mut Node<Horus>, to: u64, errors: bool| {
        while node.now() < to {
            let next = (node.now() + 2_000).min(to);
            while node.now() < next {
                node.advance(next);
                drop(node.board_mut(|board| board.front_end.take_air()));
            }
            if errors {
                node.input(|part, view, at| part.spurious_bus_error(2, at, view));
            }
        }
    };
    run(&mut horus, 100 * MS, false);
    let mut disturbed = horus.clone();
    run(&mut horus, 200 * MS, false);
    run(&mut disturbed, 200 * MS, true);
    let more = disturbed.usage().awake - horus.usage().awake;
    println!("50 000 bus errors in 100 ms cost {} us", more / 1_000);
    assert!(more <= 2 * MS, "{more} ns");
    assert_eq!(disturbed.resets().len(), 0);
}

#[derive(Clone, Copy, Debug, Default)]
struct Table {
    failures: u64,
    silenced: u64,
    longest: u64,
    latest: u64,
    apart: u64,
}

/// Returns whether these two receivers may be too far apart to agree, by the least limits of decision 15.
fn may_disagree(one: Position, other: Position) -> bool {
    let north = (one.latitude - other.latitude).to_radians() * 6_371_000.0;
    let east = (one.longitude - other.longitude).to_radians() * 6_371_000.0 * one.latitude.to_radians().cos();
    north.hypot(east) > 5.0 - 1.0 || (one.altitude - other.altitude).abs() > 8.0 - 0.5
}

/// Injects faults of buses, one a second. Asserts that there is no violation, that no cycle is lost, and that the other
/// receivers stay valid. While the other receivers agree, Reported-Position must be valid. Returns its greatest error,
/// m.
fn drawn_failures(clock: Clock, seed: u64, failures: u64, table: &mut [Table; BusFault::ALL.len()]) -> Option<f64> {
    const SECOND: u64 = 1_000 * MS;
    const SETTLED: u64 = SECOND;
    let mut setup = setup((failures + 1) * 1_000 + 500)?;
    (setup.clock, setup.seed) = (clock, seed);
    let mut rng = Rng::stream(seed, 11);
    let mut drawn = vec![];
    for number in 0..failures {
        let kind = rng.below(BusFault::ALL.len() as u64) as usize;
        let from = SETTLED + number * SECOND + rng.below(240 * MS);
        let until = from + rng.between(MS, 400 * MS);
        let receiver = if BusFault::ALL[kind].interface() == Port::I2c { 1 } else { 2 };
        let fault = Fault::Receiver(receiver, ReceiverFault::Bus(BusFault::ALL[kind]));
        setup.faults = setup.faults.with(from, until, fault);
        drawn.push((kind, receiver, from, until));
    }
    let outcome = sound(&setup);
    let history: Vec<_> = outcome.base.history().filter(|entry| entry.at_ns > SETTLED).collect();
    let of = |entry: &Entry, receiver: usize| entry.gps[receiver].is_some_and(|position| position.valid);
    for (kind, receiver, from, until) in drawn {
        let end = from - from % SECOND + SECOND;
        let during = history.iter().filter(|entry| (from..end).contains(&entry.at_ns));
        let what = || format!("{:?} from {from} to {until}, seed {seed}, {clock}", BusFault::ALL[kind]);
        let (mut first, mut last) = (None, None);
        let row = &mut table[kind];
        row.failures += 1;
        for entry in during {
            let others: Vec<usize> = (0..3).filter(|other| *other != receiver).collect();
            for other in &others {
                assert!(of(entry, *other), "{}: GPS{} at {}", what(), other + 1, entry.at_ns);
            }
            // The two receivers without a fault may disagree, so HORUS cannot tell which is right.
            let apart = may_disagree(entry.gps[others[0]].unwrap(), entry.gps[others[1]].unwrap());
            row.apart += u64::from(apart);
            assert!(apart || entry.reported.is_some_and(|reported| reported.valid), "{}: at {}", what(), entry.at_ns);
            if !of(entry, receiver) {
                first.get_or_insert(entry.at_ns);
                last = Some(entry.at_ns);
            }
        }
        if let (Some(first), Some(last)) = (first, last) {
            assert!(last <= until + BACK, "{}: not back at {last}", what());
            row.silenced += 1;
            row.longest = row.longest.max(last - first);
            row.latest = row.latest.max(last.saturating_sub(until));
        }
    }
    outcome.report.voter.max_error_m
}

fn tell(table: &[Table; BusFault::ALL.len()]) {
    println!(
        "{:16} failures  not valid for a while  for ms at most  ms after its end at most  profiles: others apart",
        "kind"
    );
    for (kind, row) in BusFault::ALL.iter().zip(table) {
        let Table { failures, silenced, longest, latest, apart } = row;
        let kind = format!("{kind:?}");
        println!("{kind:16} {failures:8} {silenced:22} {:15} {:24} {apart:30}", longest / MS, latest / MS);
    }
}

/// The greatest error, m, that Reported-Position may have (`horus-tx-fw/tests/voted.rs`).
const RIGHT_M: f64 = 9.0;

#[test]
fn whatever_bus_fails_at_whatever_instant_the_position_stays_valid_and_right() {
    let mut table = [Table::default(); BusFault::ALL.len()];
    for (clock, seed) in [(Clock::Fast, 1), (Clock::Optimistic, 2), (Clock::Pessimistic, 3)] {
        let Some(worst) = drawn_failures(clock, seed, 12, &mut table) else { return };
        assert!(worst <= RIGHT_M, "{worst} m");
    }
    tell(&table);
    assert!(table.iter().any(|row| row.silenced > 0), "some last long enough to be seen");
    assert_eq!(table.iter().map(|row| row.apart).sum::<u64>(), 0, "the others agree all the time in these");
}

#[test]
#[ignore = "takes two minutes: cargo xtask build && \
            LINK_IMAGES=$PWD/target/firmware cargo test -p bench --test all receivers:: -- --ignored --nocapture"]
fn a_thousand_failures_of_buses() {
    let mut table = [Table::default(); BusFault::ALL.len()];
    let mut worst: f64 = 0.0;
    for seed in 0..12 {
        let clock = [Clock::Fast, Clock::Optimistic, Clock::Pessimistic][seed as usize % 3];
        let Some(of_run) = drawn_failures(clock, seed, 84, &mut table) else { return };
        worst = worst.max(of_run);
    }
    tell(&table);
    println!("greatest error {worst:.2} m");
    assert!(worst <= RIGHT_M, "{worst} m");
}

/// The longest time, ns, from the loss of a receiver's settings on a UART to its recovery. HORUS tries the usual bit
/// rate first, and then 38 400 baud (decision 16).
const CONFIGURED: u64 = 2_500 * MS;

/// The longest time, ns, from the end of a stuck MISO to a valid position. The first message comes within 200 ms and
/// only shows that the receiver's buffer was empty (decision 16). The second comes 200 ms later.
const PROVED: u64 = 450 * MS;

#[test]
fn bytes_that_waited_behind_a_stuck_line_are_not_taken_for_new() {
    for reads in 0..6 {
        let Some(mut setup) = setup(2_600) else { return };
        let stuck = Fault::Receiver(2, ReceiverFault::Bus(BusFault::Ones));
        let off = Fault::Power(Board::Horus, PowerFault::Off(1));
        let ends = (1_825 + 10 * reads) * MS;
        setup.faults = Faults::none().with(590 * MS, ends, stuck).with(600 * MS, 1_800 * MS, off);
        let outcome = run(&setup, &mut ()).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(outcome.report.violations, [""; 0], "{reads} reads");
        let of = validity(&outcome, 2);
        assert!(
            of.iter().filter(|(at, _)| *at > ends + PROVED).all(|(_, valid)| *valid),
            "{reads} reads: it is not back"
        );
    }
}

#[test]
fn a_receiver_that_loses_its_settings_is_configured_again_on_each_interface() {
    for receiver in 0..3 {
        let Some(mut setup) = setup(4_000) else { return };
        let lost = 500 * MS;
        let fault = Fault::Receiver(receiver, ReceiverFault::LosesSettings);
        setup.faults = Faults::none().with(lost, lost + MS, fault);
        let outcome = sound(&setup);
        let of = validity(&outcome, receiver);
        assert!(of.iter().any(|(at, valid)| *at > lost + 300 * MS && !valid), "GPS{} went on", receiver + 1);
        let back = of.iter().rev().take_while(|(_, valid)| *valid).last().map_or(u64::MAX, |(at, _)| *at);
        println!("GPS{}: back {} ms after it lost its settings", receiver + 1, back.saturating_sub(lost) / MS);
        assert!(back <= lost + CONFIGURED, "GPS{}: {back}", receiver + 1);
    }
}

#[test]
fn each_receiver_is_told_that_it_flies() {
    for factory_settings in [false, true] {
        let Some(mut setup) = setup(3_000) else { return };
        setup.factory_settings = factory_settings;
        let mut bench: Bench = Bench::new(&setup).unwrap();
        bench.keep_log();
        bench.run_to(setup.duration_ns, Threads::Two);
        let log = bench.finish(setup.duration_ns).log;
        for receiver in 0..3 {
            let model = log.events.iter().rev().find_map(|event| match event.what {
                What::Settings { receiver: of, model, .. } if of == receiver => Some(model),
                _ => None,
            });
            assert_eq!(model, Some(bounds::DYNAMIC_MODEL), "GPS{}, as delivered: {factory_settings}", receiver + 1);
        }
    }
}

#[test]
fn receivers_as_delivered_are_configured_at_the_start() {
    let Some(mut setup) = setup(3_000) else { return };
    setup.factory_settings = true;
    let outcome = sound(&setup);
    for receiver in 0..3 {
        let of = validity(&outcome, receiver);
        let back = of.iter().rev().take_while(|(_, valid)| *valid).last().map_or(u64::MAX, |(at, _)| *at);
        println!("GPS{}: valid to the end from {} ms on", receiver + 1, back / MS);
        assert!(back <= CONFIGURED, "GPS{}: {back}", receiver + 1);
    }
}

#[test]
fn three_receivers_at_25_hz_take_under_a_tenth_of_the_processor() {
    let Some(mut setup) = setup(2_000) else { return };
    setup.receiver_hz = Some(25);
    setup.clock = Clock::Pessimistic;
    let report = sound(&setup).report;
    println!("load {}", report.horus.load);
    assert!(report.horus.load <= 0.1, "{:?}", report.horus);
    assert!(report.horus.load > 0.05, "the receivers say something: {:?}", report.horus);
}
