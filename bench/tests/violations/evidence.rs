//! Rows of the table of violations: restarts, findings, misuse, load, counters, and faults that are added too late.

use bench::faults::{AirFaults, Board, Fault, Faults, ImageFault, Upset};
use bench_judge::Violation;
use dpr_fw::telemetry::Telemetry as DprTelemetry;
use horus_tx_fw::telemetry::Telemetry as HorusTelemetry;

use super::images::{ALWAYS, awake, bits, instead, never, stores, without_telemetry};
use super::{MS, Row, US, breaks, table};

/// The STM32's SPI1_CR1; bits 5 to 3 are the prescaler of the front end's clock (RM0090 28.5.1).
const SPI1_CR1: u32 = 0x4001_3000;
/// IWDG_KR, the key register of the STM32's watchdog (RM0090 21.4.1).
const IWDG_KR: u32 = 0x4000_3000;
const IWDG_RELOAD: u32 = 0xAAAA;

const IWDG_START: u32 = 0xCCCC;
/// The address of the nRF52840's watchdog (PS 6.36), whose first register starts it.
const WDT: u32 = 0x4001_0000;

fn counts(board: Board, symbol: &str, offset: usize) -> Faults {
    let offset = u32::try_from(offset).unwrap();
    let poke = ImageFault::Poke { symbol: symbol.into(), offset, bytes: vec![1, 0, 0, 0] };
    Faults::none().with(breaks(), u64::MAX, Fault::Image(board, poke))
}

fn log_destroyed(board: Board) -> Faults {
    let poke = ImageFault::Poke { symbol: "_SEGGER_RTT".into(), offset: 16, bytes: vec![0xFF; 4] };
    Faults::none().with(breaks(), u64::MAX, Fault::Image(board, poke))
}

/// Returns upsets that flip a bit of flash and flip it back 1 µs later, before the firmware checks the bit.
fn flash_flips(board: Board, address: u32) -> Faults {
    let flip = || Fault::Upset(board, Upset::Flash { address, bit: 1 });
    Faults::none().with(breaks(), breaks(), flip()).with(breaks() + US, breaks() + US, flip())
}

fn hangs(board: Board) -> Faults {
    Faults::none().with(breaks(), breaks(), Fault::Hang(board))
}

table! {
    a_horus_that_hangs_and_never_started_its_watchdog => Row {
        setup: |setup| stores(setup, Board::Horus, ALWAYS, &[instead(IWDG_KR, IWDG_START, 0)]),
        ..Row::new(Violation::HorusStaysHung, || hangs(Board::Horus))
    };
    a_dpr_that_hangs_and_never_started_its_watchdog => Row {
        setup: |setup| stores(setup, Board::Dpr, ALWAYS, &[never(WDT)]),
        ..Row::new(Violation::DprStaysHung, || hangs(Board::Dpr))
    };
    a_horus_that_does_not_feed_its_watchdog => Row {
        setup: |setup| {
            let while_broken = (breaks(), breaks() + 120 * MS);
            stores(setup, Board::Horus, while_broken, &[instead(IWDG_KR, IWDG_RELOAD, 0)]);
        },
        duration: || 1_000 * MS,
        ..Row::new(Violation::HorusRestarted, Faults::none)
    };
    // The stack pointer leads outside the memory, so the next interrupt causes a fault and the watchdog resets the DPR.
    a_dpr_whose_stack_pointer_lost_a_bit => Row {
        duration: || 3_000 * MS,
        ..Row::new(Violation::DprRestarted, || {
            let upset = Fault::Upset(Board::Dpr, Upset::Register { number: 13, bit: 30 });
            Faults::none().with(breaks(), breaks(), upset)
        })
    };
    a_front_end_of_horus_that_is_clocked_too_fast => Row {
        setup: |setup| stores(setup, Board::Horus, ALWAYS, &[bits(SPI1_CR1, 0x38, 0x08)]),
        ..Row::new(Violation::FrontEndMisuse, Faults::none)
    };
    a_horus_whose_log_is_none => Row::new(Violation::HorusFinding, || log_destroyed(Board::Horus));
    a_dpr_whose_log_is_none => Row::new(Violation::DprFinding, || log_destroyed(Board::Dpr));
    a_horus_that_does_not_sleep => Row {
        setup: |setup| awake(setup, Board::Horus, breaks()),
        ..Row::new(Violation::HorusOverloaded, Faults::none)
    };
    a_dpr_that_does_not_sleep => Row {
        setup: |setup| awake(setup, Board::Dpr, breaks()),
        ..Row::new(Violation::DprOverloaded, Faults::none)
    };
    a_horus_that_counts_a_fault_that_nobody_sees => Row::new(Violation::HorusComplains, || {
        counts(Board::Horus, "HORUS_TELEMETRY", std::mem::offset_of!(HorusTelemetry, cycle_overruns))
    });
    a_dpr_that_counts_a_fault_that_nobody_sees => Row::new(Violation::DprComplains, || {
        counts(Board::Dpr, "DPR_TELEMETRY", std::mem::offset_of!(DprTelemetry, overruns))
    });
    an_image_of_horus_without_telemetry => Row {
        setup: |setup| without_telemetry(setup, Board::Horus),
        ..Row::new(Violation::NoTelemetry, Faults::none)
    };
    an_image_of_the_dpr_without_telemetry => Row {
        setup: |setup| without_telemetry(setup, Board::Dpr),
        ..Row::new(Violation::NoTelemetry, Faults::none)
    };
    a_fault_that_is_added_behind_the_boards => Row {
        added: || Faults::none().with(breaks() - 100 * MS, breaks() - 50 * MS, Fault::Air(AirFaults::default())),
        ..Row::new(Violation::Late, Faults::none)
    };
    // The log states a changed bit of flash that the firmware cannot find.
    flash_of_horus_that_nobody_finds_changed => Row {
        duration: || breaks() + 10_050 * MS,
        ..Row::new(Violation::FaultUnnoticed, || flash_flips(Board::Horus, 0x0800_0004))
    };
}
