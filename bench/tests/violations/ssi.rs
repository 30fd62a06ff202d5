//! Rows of the table of violations: contents and instants on the SSI.

use bench::faults::{AirFaults, Board, Fault, Faults, ImageFault, WireFault};
use bench::sim::phases::{Edge, Placement, Sweep};
use bench_judge::Violation;
use profile::Identifier;

use super::images::{ALWAYS, instead, stores};
use super::{CONTROL_CYCLE, MS, Row, US, breaks, reads, table};

const SSI_END: &str = "SPIM1_SPIS1_TWIM1_TWIS1_SPI1_TWI1";
const COMMIT: &str = "SWI0_EGU0";
const DEADLINE: &str = "TIMER1";

/// CC[2], a compare register of the DPR's TIMER2 (PS 6.30).
const TIMER2_CC2: u32 = 0x4000_A548;

/// The frequency of the timer that fires HORUS's send slots, MHz.
const TICKS_PER_US: u32 = 72;
/// The slot of the second frame of five receivers, µs after HORUS's tick.
const SECOND_SLOT_US: u32 = 4_130;
/// HORUS checks its slots by SysTick, which runs at 18 MHz. The number of counts in a microsecond, as the check shifts
/// it by 8 bits.
const SYSTICK_COUNTS_PER_US: u32 = 18 << 8;

fn wire(at: u64, ns: u64, fault: WireFault) -> Faults {
    Faults::none().with(at, at + ns, Fault::Wire(fault))
}

fn dpr(at: u64, ns: u64, fault: ImageFault) -> Faults {
    Faults::none().with(at, at + ns, Fault::Image(Board::Dpr, fault))
}

/// Returns a sweep with one transaction in each of `frames` cycles: `ns` after the first frame's end, and 1 µs later in
/// each further cycle.
fn after_each_frame(ns: i64, frames: u32) -> Sweep {
    let read = Placement { edge: Edge::Falls, after_ns: 0, bytes: None };
    let to_ns = ns + i64::from(frames - 1) * 1_000;
    Sweep { frame: 0, from_ns: ns, to_ns, step_ns: US, patterns: vec![vec![read]] }
}

table! {
    a_front_end_whose_load_modulator_works_by_itself_answers =>
        Row::new(Violation::Answered, || wire(breaks(), 100 * MS, WireFault::AntennaAnswers));
    // Only the first three cycles have a transaction.
    a_flight_controller_that_stops_reading_makes_no_transaction => Row {
        setup: |setup| setup.sweep = Some(after_each_frame(200_000, 3)),
        ..Row::new(Violation::NoTransaction, Faults::none)
    };
    // The run ends after the longest time of a start, before the watchdog resets the DPR.
    a_firmware_whose_commit_task_does_nothing_never_gets_ready => Row {
        also: Some(Violation::DprComplains),
        duration: || 100 * MS + 3 * US,
        ..Row::new(Violation::NeverReady, || {
            let sealed = ImageFault::Patch { address: 0, bytes: vec![], sealed: true };
            let dead = |task: &str| Fault::Image(Board::Dpr, ImageFault::Dead(task.into()));
            // Both tasks that can publish an image are dead, because either of them alone would publish one.
            let both = Faults::none().with(0, u64::MAX, dead(COMMIT)).with(0, u64::MAX, dead(DEADLINE));
            both.with(0, u64::MAX, Fault::Image(Board::Dpr, sealed))
        })
    };
    an_ssi_task_that_is_held_up_after_a_transaction_is_not_ready_in_time =>
        Row::new(Violation::NotReady, || dpr(reads() + 2 * CONTROL_CYCLE, 350 * US, ImageFault::Hung(SSI_END.into())));
    a_miso_line_that_is_stuck_high_for_two_transactions_looks_busy_twice =>
        Row::new(Violation::BusyTwice, || wire(breaks(), 8 * MS, WireFault::MisoOnes));
    a_miso_line_that_stays_high_lets_nothing_be_read =>
        Row::new(Violation::Silent, || wire(breaks(), 200 * MS, WireFault::MisoOnes));
    a_transaction_whose_end_is_of_the_one_before_is_torn =>
        Row::new(Violation::Torn, || wire(breaks(), 100 * MS, WireFault::MisoSplice { at_byte: 250 }));
    a_bit_that_is_inverted_on_the_wire_is_damage =>
        Row::new(Violation::Damaged, || wire(breaks(), 100 * MS, WireFault::MisoBit { byte: 110, bit: 3 }));
    objects_in_each_others_places_are_misplaced =>
        Row::new(Violation::Misplaced, || wire(breaks(), 100 * MS, WireFault::MisoSwap));
    // The flight controller's slow clock keeps transactions away from the rises of FRESH.
    a_fresh_that_rises_without_a_new_image_announces_nothing_new => Row {
        setup: |setup| setup.crystals.flight_controller_ppb = -1_000_000,
        ..Row::new(Violation::FreshNotNew, || wire(breaks(), 100 * MS, WireFault::FreshGlitch))
    };
    a_fresh_that_rests_low_announces_no_image =>
        Row::new(Violation::FreshMissing, || wire(breaks(), 100 * MS, WireFault::FreshStuck));
    a_fresh_that_comes_late_makes_its_frame_late =>
        Row::new(Violation::LateReadable, || wire(breaks(), 100 * MS, WireFault::FreshLate(40 * US)));
    an_image_whose_link_status_has_a_wrong_identifier_is_announced_all_the_same =>
        Row {
            duration: || breaks() + 2 * MS,
            ..Row::new(Violation::FreshUnreadable, || {
                let other = Identifier(Identifier::LINK_STATUS.0 + 0x100);
                let (of, value) = (Identifier::LINK_STATUS.0.into(), other.0.into());
                // The fault gives the DPR another constant for Link-Status's identifier while a frame arrives.
                dpr(breaks() - 2 * MS, 100 * MS, ImageFault::Constant { of, value })
            })
        };
    // The late second frame ends just before the next tick, after which its image is published.
    a_second_frame_in_a_late_slot_makes_its_sample_late => Row {
        gps: 5,
        ..Row::new(Violation::LateSample, || {
            // The firmware checks its slots by SysTick, so the expected times are changed as well: 4010 µs between the
            // slots, and 5870 µs to the tick. The compiler adds either time in two parts.
            [
                (SECOND_SLOT_US * TICKS_PER_US, (SECOND_SLOT_US + 2_230) * TICKS_PER_US),
                (4_010 * SYSTICK_COUNTS_PER_US - 0x1_F400, 6_240 * SYSTICK_COUNTS_PER_US - 0xC000),
                (0x1_F400, 0xC000),
                (5_870 * SYSTICK_COUNTS_PER_US - 0xBC00, 3_640 * SYSTICK_COUNTS_PER_US - 0xF000),
                (0xBC00, 0xF000),
            ]
            .into_iter()
            .fold(Faults::none(), |faults, (of, value)| {
                faults.with(0, u64::MAX, Fault::Image(Board::Horus, ImageFault::Constant { of, value }))
            })
        })
    };
    // At the deadline of a lost frame, the DPR takes the buffers from the SPIS although no transaction has ended.
    a_processor_that_keeps_the_buffers_without_a_transaction_holds_the_ssi_back => Row {
        setup: |setup| setup.sweep = Some(after_each_frame(200_000, 60)),
        ..Row::new(Violation::HeldBack, || {
            let lost = AirFaults { lost: 1.0, ..AirFaults::default() };
            let hung = ImageFault::Hung(SSI_END.into());
            dpr(breaks() + 11 * MS, 3 * MS, hung).with(breaks(), breaks() + 9 * MS, Fault::Air(lost))
        })
    };
    a_miso_line_that_is_stuck_high_for_one_transaction_serves_nothing =>
        Row::new(Violation::Unserved, || wire(reads() - US, CONTROL_CYCLE / 2, WireFault::MisoOnes));
    // The changed program halves the compare value that ends FRESH's pulse.
    a_fresh_that_is_high_for_half_as_long_is_too_short => Row {
        setup: |setup| stores(setup, Board::Dpr, ALWAYS, &[instead(TIMER2_CC2, 2, 1)]),
        ..Row::new(Violation::FreshShort, Faults::none)
    };
}
