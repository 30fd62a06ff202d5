//! Receivers on a UART, on I2C and on SPI against the release image: what each says is shown to the last bit, and
//! whatever is wrong with one interface costs neither a cycle nor another receiver, and is over soon after its end.

mod boards;

use std::sync::Arc;

use bench::faults::receivers::bus::BusFault;
use bench::faults::{Fault, Faults, ReceiverFault};
use bench::node::Clock;
use bench::sim::{Images, Outcome, Setup, run};
use boards::image;
use gnss_sim::{Log, ubx};

const MS: u64 = 1_000_000;

/// The setup of a run with three receivers, or `None` where the images were not built.
fn setup(milliseconds: u64) -> Option<Setup> {
    let images = Images { horus: image(3, "horus-tx-fw.elf")?, dpr: image(3, "dpr-fw.elf")? };
    Some(Setup::new(images, 3, milliseconds * MS))
}

/// A run in which nothing is violated and no cycle is lost.
fn sound(setup: &Setup) -> Outcome {
    let outcome = run(setup, &mut ()).unwrap_or_else(|error| panic!("{error}"));
    let what = || setup.faults.episodes().iter().map(|episode| episode.fault.name()).collect::<Vec<_>>();
    assert_eq!(outcome.report.violations, [""; 0], "{:?}", what());
    // HORUS starts within two cycles.
    let cycles = setup.duration_ns / (10 * MS);
    assert!(outcome.report.horus.frames_sent >= cycles - 3, "{:?}: {:?}", what(), outcome.report.horus);
    assert_eq!((outcome.report.air.frames_lost, outcome.report.dpr.frames_missed), (0, 0), "{:?}", what());
    outcome
}

/// When each receiver's position was shown as valid (`true`) or not, ns.
fn validity(outcome: &Outcome, receiver: usize) -> Vec<(u64, bool)> {
    let of = |gps: [Option<bench::world::base_station::Position>; 5]| gps[receiver].is_some_and(|it| it.valid);
    outcome.base.history().map(|entry| (entry.at_ns, of(entry.gps))).collect()
}

/// A log of ten epochs, with NMEA, noise, and a damaged message.
fn log() -> Vec<u8> {
    (0..10_i32)
        .flat_map(|epoch| {
            let pvt = ubx::NavPvt {
                itow_ms: 100_000 + epoch as u32 * 100,
                fix_type: 3,
                flags: ubx::NavPvt::FLAG_FIX_OK,
                // 0xFF within a message is no filler.
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
        assert_eq!(shown, held, "GPS{}", receiver + 1);
    }
}

/// From when to when a bus fails.
const FAILS: std::ops::Range<u64> = 500 * MS..900 * MS;
/// So long after the end of any fault of a bus its receiver's position is valid again: HORUS looks at a bus that was
/// stuck at the latest 110 ms after the last time (decision 16), the receiver's next solution comes within 200 ms and
/// what it kept meanwhile is read before it, and 50 ms for a cycle, the air and the way to the base station.
const BACK: u64 = 360 * MS;

fn of_bus(clock: Clock) {
    for fault in BusFault::ALL {
        let Some(mut setup) = setup(1_600) else { return };
        let receiver = if fault.interface() == bench::boards::receivers::Interface::I2c { 1 } else { 2 };
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
fn no_fault_of_a_bus_costs_a_cycle_or_another_receiver_and_each_is_over_soon_on_the_fast_clock() {
    of_bus(Clock::Fast);
}

#[test]
fn no_fault_of_a_bus_costs_a_cycle_or_another_receiver_and_each_is_over_soon_on_the_optimistic_clock() {
    of_bus(Clock::Optimistic);
}

#[test]
fn no_fault_of_a_bus_costs_a_cycle_or_another_receiver_and_each_is_over_soon_on_the_pessimistic_clock() {
    of_bus(Clock::Pessimistic);
}

/// So long after a receiver on a UART has lost its settings it is back: it starts (0.3 s), HORUS hears nothing it can
/// read, tries the usual rate, waits half a second, sets the rate from 38 400 baud, waits 100 ms and more for the
/// receiver, and configures it (decision 16).
const CONFIGURED: u64 = 2_500 * MS;

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
fn three_receivers_at_25_hz_take_no_more_than_a_tenth_of_the_processor_on_the_pessimistic_clock() {
    let Some(mut setup) = setup(2_000) else { return };
    setup.receiver_hz = Some(25);
    setup.clock = Clock::Pessimistic;
    let report = sound(&setup).report;
    println!("load {}", report.horus.load);
    assert!(report.horus.load <= 0.1, "{:?}", report.horus);
    assert!(report.horus.load > 0.05, "the receivers say something: {:?}", report.horus);
}
