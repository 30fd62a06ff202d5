//! Tests every kind of disturbance separately. While it lasts, nothing wrong is shown and Link-Status is correct.
//! Afterwards the link must work again within 5 cycles, or within 15 if a front end has to be brought up again. The
//! judge checks all of it.

use crate::boards;

use bench::faults::{AirFaults, Board, ChipFault, Conduct, Fault, Faults, PowerFault};
use bench::sim::{Images, Outcome, Setup, run};
use boards::image;
use emulator_node::Clock;

const MS: u64 = 1_000_000;
/// The instant, ns, at which the link has been up for 200 ms.
const BEGINS: u64 = 303 * MS;
/// The time from the end of a disturbance to the end of the run, ns: longer than the limit for a recovery.
const AFTER: u64 = 450 * MS;

const BOARDS: [Board; 2] = [Board::Horus, Board::Dpr];
const RESTARTS: [PowerFault; 3] = [PowerFault::Pin, PowerFault::BrownOut, PowerFault::Watchdog];

fn outcome(faults: Faults, length: u64) -> Option<Outcome> {
    let images = Images { horus: image(3, "horus-tx-fw.elf")?, dpr: image(3, "dpr-fw.elf")? };
    let setup = Setup { faults, ..Setup::new(images, 3, BEGINS + length + AFTER) };
    Some(run(&setup, &mut ()).unwrap_or_else(|error| panic!("{error}")))
}

fn recovers(faults: Faults, length: u64, cycles: u64) -> bool {
    let words = format!("{faults:?}");
    let Some(outcome) = outcome(faults, length) else { return false };
    let faults = &outcome.report.faults;
    assert_eq!(outcome.report.violations, [""; 0], "{words}");
    assert_eq!(faults.invalid_shown_valid, 0, "{words}");
    let took = faults.max_recovery_cycles.unwrap_or_else(|| panic!("{words}: no recovery was measured"));
    assert!((1..=cycles).contains(&took), "{words}: {took} cycles");
    assert_eq!(faults.max_recovery_cycles_without_bring_up.is_some(), cycles == 5, "{words}");
    true
}

fn one(fault: Fault, length: u64) -> Faults {
    Faults::none().with(BEGINS, BEGINS + length, fault)
}

// Shows TIME-9.
#[test]
fn the_link_recovers_from_any_fault_of_the_air_within_5_cycles() {
    let none = AirFaults::default();
    let frozen = AirFaults { frozen: true, ..none };
    for fault in [AirFaults { lost: 1.0, ..none }, frozen, AirFaults { field_off: true, ..none }] {
        // A sequence can continue after up to 25 missed cycles. The last fault is longer than 25 cycles.
        for length in [5 * MS, 57 * MS, 241 * MS, 400 * MS] {
            if !recovers(one(Fault::Air(fault), length), length, 5) {
                return;
            }
        }
    }
}

#[test]
fn the_link_recovers_from_misuse_of_the_ssi_within_5_cycles() {
    for conduct in Conduct::ALL {
        if !recovers(one(Fault::FlightController(conduct), 200 * MS), 200 * MS, 5) {
            return;
        }
    }
}

#[test]
fn the_link_recovers_from_each_front_end_fault_within_15_cycles() {
    for board in BOARDS {
        for fault in ChipFault::ALL {
            // The fault ends within a cycle, after the firmware has doubled its wait for the next bring-up, or in the
            // longest wait.
            for length in [4 * MS, 140 * MS, 390 * MS] {
                if !recovers(one(Fault::Chip(board, fault), length), length, 15) {
                    return;
                }
            }
        }
        for length in [4 * MS, 390 * MS] {
            if !recovers(one(Fault::Power(board, PowerFault::FrontEndOff), length), length, 15) {
                return;
            }
        }
    }
}

// Shows TIME-9.
#[test]
fn the_link_recovers_from_any_restart_of_a_board_within_15_cycles() {
    for board in BOARDS {
        for fault in RESTARTS {
            if !recovers(one(Fault::Power(board, fault), 0), 0, 15) {
                return;
            }
        }
        for length in [4 * MS, 300 * MS] {
            if !recovers(one(Fault::Power(board, PowerFault::Off(5)), length), length, 15) {
                return;
            }
        }
    }
}

#[test]
fn the_link_recovers_from_restarts_of_both_boards_within_15_cycles() {
    for [first, second] in [[Board::Horus, Board::Dpr], [Board::Dpr, Board::Horus]] {
        for (nth, of_first) in RESTARTS.into_iter().enumerate() {
            let of_second = RESTARTS[(nth + 1) % RESTARTS.len()];
            for after in [0, 3 * MS, 12 * MS, 35 * MS] {
                let faults = one(Fault::Power(first, of_first), 0).with(
                    BEGINS + after,
                    BEGINS + after,
                    Fault::Power(second, of_second),
                );
                if !recovers(faults, after, 15) {
                    return;
                }
            }
        }
    }
}

#[test]
fn the_link_recovers_from_a_front_end_fault_during_a_restart() {
    for (of_chip, other) in [(Board::Horus, Board::Dpr), (Board::Dpr, Board::Horus)] {
        for chip in ChipFault::ALL {
            let faults = one(Fault::Chip(of_chip, chip), 100 * MS).with(
                BEGINS + 60 * MS,
                BEGINS + 60 * MS,
                Fault::Power(other, PowerFault::Pin),
            );
            if !recovers(faults, 100 * MS, 15) {
                return;
            }
        }
    }
}

#[test]
fn a_field_that_goes_while_the_listener_re_arms_is_told() {
    // About 120 µs after a frame the DPR discards the FIFO, which takes up to 12 µs. If the field is lost in this time,
    // the DPR also discards the interrupt that reports the loss.
    for after in (1_000..1_200).step_by(4) {
        let at = BEGINS + after * 1_000;
        let faults = Faults::none().with(at, at + 90 * MS, Fault::Power(Board::Horus, PowerFault::FrontEndOff));
        let Some(outcome) = outcome(faults, 100 * MS) else { return };
        assert_eq!(outcome.report.violations, [""; 0], "{after} µs");
    }
}

#[test]
fn a_message_that_is_served_late_leaves_no_interrupt_on() {
    // HORUS's message to GPS1 ends 38 ms after a restart. Around that instant the line is stuck, which delays the
    // UART's interrupt.
    for after in (36_000..40_000).step_by(60) {
        let stuck = BEGINS + after * 1_000;
        let faults = one(Fault::Power(Board::Horus, PowerFault::Pin), 0).with(
            stuck,
            stuck + 20 * MS,
            Fault::Chip(Board::Horus, ChipFault::IrqHigh),
        );
        let (Some(horus), Some(dpr)) = (image(3, "horus-tx-fw.elf"), image(3, "dpr-fw.elf")) else { return };
        let setup =
            Setup { faults, clock: Clock::Pessimistic, ..Setup::new(Images { horus, dpr }, 3, stuck + 130 * MS) };
        let outcome = run(&setup, &mut ()).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(outcome.report.violations, [""; 0], "{after} µs");
    }
}
