//! Rows of the table of violations that compare the objects on the SSI with the frames at the DPR's antenna, and
//! Link-Status with the wires.

use std::mem::offset_of;

use bench::faults::{AirFaults, Board, ChipFault, Conduct, Fault, Faults, ImageFault, WireFault};
use bench_judge::{Event, Violation, What};
use dpr_fw::telemetry::Telemetry;

use super::images::{ALWAYS, instead, stores};
use super::{CONTROL_CYCLE, MS, Row, US, bench, breaks, breaks_with, reads, run, setup, table};

/// The length of HORUS's cycle, in which one frame begins, ns.
const CYCLE: u64 = 10 * MS;

fn lost(at: u64, until: u64) -> Faults {
    Faults::none().with(at, until, Fault::Air(AirFaults { lost: 1.0, ..AirFaults::default() }))
}

/// Adds a bridge in the SSI that hangs and so repeats the last image from `at` on.
fn hangs(faults: Faults, at: u64) -> Faults {
    let wire = |faults: Faults, fault| faults.with(at, u64::MAX, Fault::Wire(fault));
    wire(wire(faults, WireFault::FreshStuck), WireFault::MisoFrozen)
}

/// Returns faults by which a bridge in the SSI hangs with the last frame before a silence.
fn hangs_in_silence() -> Faults {
    hangs(lost(breaks(), u64::MAX), breaks() + 8 * MS)
}

fn of_wire(at: u64, until: u64, fault: WireFault) -> Faults {
    Faults::none().with(at, until, Fault::Wire(fault))
}

fn link_status(byte: usize, bits: u8) -> Faults {
    of_wire(breaks(), breaks() + CONTROL_CYCLE, WireFault::MisoForged { object: None, byte, bits })
}

fn regressed() -> Faults {
    // The fault makes the second transaction that reads an image repeat the bytes of an older transaction.
    let begins = reads() + CONTROL_CYCLE / 2;
    of_wire(begins, begins + CONTROL_CYCLE, WireFault::MisoReplay { age_ns: CYCLE })
}

/// The nRF52840's register that enables PPI channels (PS 6.16).
const PPI_CHENSET: u32 = 0x4001_F504;

/// Returns faults by which the DPR hangs with a new image, which the flight controller reads after its expiry.
fn hangs_with_an_image() -> Faults {
    let silent = Fault::FlightController(Conduct::Silent);
    Faults::none().with(breaks(), breaks() + 30 * MS, silent).with(
        breaks() + MS,
        breaks() + MS,
        Fault::Hang(Board::Dpr),
    )
}

table! {
    vacant => Row::new(Violation::Vacant, || of_wire(breaks(), u64::MAX, WireFault::MisoVacant { object: 2 }));
    // The faults remove each object for some cycles, although Link-Status calls all objects accepted.
    not_shown => Row::new(Violation::NotShown, || {
        let vacant = |faults: Faults, object| {
            faults.with(breaks(), breaks() + 3 * CYCLE, Fault::Wire(WireFault::MisoVacant { object }))
        };
        (0..=3).fold(Faults::none(), vacant)
    });
    // The front end fails, and no object is shown for longer than its bring-up may take.
    recovers_late => Row {
        duration: || 780 * MS,
        ..Row::new(Violation::RecoversLate, || {
            let ends = breaks() + 20 * MS;
            let chip = Fault::Chip(Board::Dpr, ChipFault::IrqLow);
            let silent = Fault::FlightController(Conduct::Silent);
            Faults::none().with(breaks(), ends, chip).with(ends, u64::MAX, silent)
        })
    };
    uplinks_that_nobody_counted => Row {
        setup: |setup| setup.writes = true,
        ..Row::new(Violation::PortStatusWrong, || {
            of_wire(breaks(), breaks() + 45 * MS, WireFault::MisoForgedPort { object: 0, byte: 8, bits: 0x10 })
        })
    };
    an_uplink_of_other_bytes => Row {
        setup: |setup| setup.writes = true,
        ..Row::new(Violation::UplinkWrong, || {
            of_wire(breaks(), breaks() + 45 * MS, WireFault::MisoForgedPort { object: 2, byte: 20, bits: 0x10 })
        })
    };
    shown_never_sent => Row::new(Violation::ShownNeverSent, || {
        of_wire(breaks(), u64::MAX, WireFault::MisoForged { object: Some(2), byte: 30, bits: 0x10 })
    });
    // A repeated frame makes the DPR remove its cycle from the image, but the bridge in the SSI still shows the cycle.
    shown_out_of_sequence => Row {
        gps: 1,
        duration: || breaks_with(1) + 2 * CYCLE,
        ..Row::new(Violation::ShownOutOfSequence, || {
            let repeated = AirFaults { repeated: 1.0, repeat_after_ns: (2 * MS, 2 * MS), ..AirFaults::default() };
            // The frame is repeated 2 ms after its end. The flight controller reads after the repetition and before the
            // next frame.
            let begins = breaks_with(1) + 750 * US;
            hangs(Faults::none().with(begins, begins + CYCLE, Fault::Air(repeated)), begins + CYCLE)
        })
    };
    shown_stale => Row { duration: || breaks() + 2 * CYCLE, ..Row::new(Violation::ShownStale, hangs_in_silence) };
    // The task that detects missing frames does nothing for a time that ends before the image expires.
    shown_stale_while_the_deadline_is_dead => Row::new(Violation::ShownStale, || {
        let dead = Fault::Image(Board::Dpr, ImageFault::Dead("TIMER1".into()));
        lost(breaks(), breaks() + 2 * CYCLE).with(breaks() + 8 * MS, breaks() + 21 * MS, dead)
    });
    shown_expired => Row::new(Violation::ShownExpired, hangs_in_silence);
    // The changed program disables the two PPI channels that let an image expire in hardware.
    shown_expired_by_a_dpr_that_hangs => Row {
        setup: |setup| stores(setup, Board::Dpr, ALWAYS, &[instead(PPI_CHENSET, 2, 0), instead(PPI_CHENSET, 4, 0)]),
        ..Row::new(Violation::ShownExpired, hangs_with_an_image)
    };
    // A transaction repeats the bytes of an earlier one. The flight controller's slow clock keeps transactions away
    // from the rises of FRESH.
    regression => Row {
        setup: |setup| setup.crystals.flight_controller_ppb = -1_000_000,
        ..Row::new(Violation::Regression, regressed)
    };
    // The age after a cycle is about 49 times 0.1 ms; its bit 5 is set.
    link_age => Row::new(Violation::LinkAge, || link_status(24, 0x20));
    link_age_over => Row::new(Violation::LinkAgeOver, || link_status(25, 0x10));
    link_counters => Row::new(Violation::LinkCounters, || link_status(8, 0x01));
    // The reason of the DPR's last reset.
    link_flags => Row::new(Violation::LinkFlags, || link_status(7, 0x10));
    link_flags_over => Row::new(Violation::LinkFlagsOver, || link_status(7, 0x02));
    // A fault changes the DPR's counter of RAM faults, which Link-Status reports.
    link_flags_of_a_ram_fault => Row {
        also: Some(Violation::DprComplains),
        ..Row::new(Violation::LinkFlagsOver, || {
            let offset = u32::try_from(offset_of!(Telemetry, scrub_faults)).unwrap();
            let bytes = vec![1, 0, 0, 0];
            let poke = ImageFault::Poke { symbol: "DPR_TELEMETRY".into(), offset, bytes };
            Faults::none().with(breaks(), u64::MAX, Fault::Image(Board::Dpr, poke))
        })
    };
    // The DPR's oscillator is slow by 0.6 %, as it may be without a crystal.
    link_time => Row {
        setup: |setup| setup.crystals.dpr_ppb = -6_000_000,
        ..Row::new(Violation::LinkTime, Faults::none)
    };
}

#[test]
fn each_field_of_port_status_is_judged() {
    // A row has a field of Port-Status, the index of one of its bytes, and the inverted bits.
    let fields = [
        ("time", 1, 0x10),
        ("uplink of the base station fresh", 6, 0x01),
        ("last uplink refused", 6, 0x04),
        ("self-test under way", 6, 0x08),
        ("self-test passed", 6, 0x10),
        ("self-test failed", 6, 0x20),
        ("buffers out of use", 6, 0x40),
        ("uplinks accepted", 8, 0x10),
        ("commands carried out", 12, 0x01),
        ("time of the last command", 16, 0x01),
        ("last command", 20, 0x01),
        ("age of the base station's uplink", 25, 0x10),
        ("age of the flight controller's uplink", 27, 0x10),
        ("violations of the first kind", 28, 0x01),
        ("violations of the last kind", 46, 0x01),
        ("integrity faults", 48, 0x01),
        ("passes over the flash", 50, 0x04),
        ("stuck bits", 52, 0x01),
        ("buffers out of use, their number", 54, 0x01),
        ("reason of the last safe state", 59, 0x01),
    ];
    for (name, byte, bits) in fields {
        let Some(mut setup) = setup(3, breaks() + 100 * MS) else { return };
        setup.writes = true;
        setup.faults = of_wire(breaks(), u64::MAX, WireFault::MisoForgedPort { object: 0, byte, bits });
        let mut bench = bench(&setup);
        bench.run_to(setup.duration_ns, setup.threads);
        let found: Vec<_> =
            bench.finish(setup.duration_ns).verdict.violations.iter().map(|broken| broken.violation).collect();
        assert!(matches!(found[..], [Violation::PortStatusWrong | Violation::UplinkWrong, ..]), "{name}: {found:?}");
    }
}

#[test]
fn a_dpr_that_hangs_with_its_hardware_expiry_shows_no_expired_image() {
    let Some(finished) = run(&Row::new(Violation::ShownExpired, hangs_with_an_image)) else { return };
    assert_eq!(finished.verdict.violations, []);
    assert!(finished.log.events.iter().any(|event| event.what == What::Hung { board: Board::Dpr }));
}

fn figures(duration: fn() -> u64, faults: fn() -> Faults) -> Option<(bench_judge::Faults, bench_judge::Log)> {
    let finished = run(&Row { duration, ..Row::new(Violation::NotShown, faults) })?;
    Some((finished.verdict.figures.faults, finished.log))
}

#[test]
fn recovery_lasts_from_a_causes_end_until_a_later_frame_is_read() {
    // After 10 missed cycles the DPR shows the first frame.
    let Some((short, _)) = figures(|| 1_000 * MS, || lost(breaks(), breaks() + 10 * CYCLE)) else { return };
    assert!((1..=2).contains(&short.max_recovery_cycles.unwrap()), "{short:?}");
    // After 30 missed cycles the DPR has to find the sequence again, and shows the fourth frame.
    let (long, _) = figures(|| 1_200 * MS, || lost(breaks(), breaks() + 30 * CYCLE)).unwrap();
    assert!((4..=5).contains(&long.max_recovery_cycles.unwrap()), "{long:?}");
    // Without 400 ms between its end and the run's end, a disturbance is not measured.
    for until in [breaks() + 10 * CYCLE, u64::MAX] {
        let faults: fn() -> Faults =
            if until == u64::MAX { || lost(breaks(), u64::MAX) } else { || lost(breaks(), breaks() + 10 * CYCLE) };
        let (recent, _) = figures(|| 790 * MS, faults).unwrap();
        assert_eq!(recent.max_recovery_cycles, None, "{until}");
    }
}

#[test]
fn every_invalid_object_that_is_read_as_valid_is_counted() {
    fn ends() -> u64 {
        breaks() + 5 * CYCLE
    }
    let forged = || {
        let forged = |object| Fault::Wire(WireFault::MisoForged { object: Some(object), byte: 30, bits: 1 });
        Faults::none().with(breaks(), ends(), forged(1)).with(breaks(), ends(), forged(3))
    };
    let Some((faults, log)) = figures(|| 400 * MS, forged) else { return };
    let during =
        |event: &&Event| matches!(event.what, What::Transaction { .. }) && (breaks()..ends()).contains(&event.at);
    let transactions = log.events.iter().filter(during).count() as u64;
    assert!(transactions >= 12, "{transactions}");
    assert_eq!(faults.invalid_shown_valid, 2 * transactions);
    // An object that is older than one read before has been valid, so it does not count.
    let (regressed, _) = figures(|| 400 * MS, regressed).unwrap();
    assert_eq!(regressed.invalid_shown_valid, 0);
    let (sound, _) = figures(|| 400 * MS, Faults::none).unwrap();
    assert_eq!(sound.invalid_shown_valid, 0);
    assert_eq!(sound.max_recovery_cycles, None);
}
