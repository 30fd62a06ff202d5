//! Rows of the sending side: HORUS's ticks, commands and frames, and what its objects say.

use bench::faults::{Board, Fault, Faults, FrontEndFault, ImageFault, WireFault};
use bench_judge::Violation;

use super::{BREAKS, MS, Row, US, table};

/// A wire is broken for so long.
fn wire(fault: WireFault, duration: u64) -> Faults {
    Faults::none().with(BREAKS, BREAKS + duration, Fault::Wire(fault))
}

/// HORUS's front end is broken for so long.
fn front_end(fault: FrontEndFault, duration: u64) -> Faults {
    Faults::none().with(BREAKS, BREAKS + duration, Fault::FrontEnd(fault))
}

/// HORUS's image is broken for so long.
fn image(fault: ImageFault, duration: u64) -> Faults {
    Faults::none().with(BREAKS, BREAKS + duration, Fault::Image(Board::Horus, fault))
}

/// A variable or table of HORUS holds other bytes.
fn poke(symbol: &str, bytes: &[u8]) -> ImageFault {
    ImageFault::Poke { symbol: symbol.into(), offset: 0, bytes: bytes.into() }
}

/// A function of HORUS holds other bytes.
fn replaced(function: &str, was: &[u8], is: &[u8]) -> ImageFault {
    ImageFault::Replaced { function: function.into(), was: was.into(), is: is.into() }
}

/// The upper word of the float64 1e7, by which HORUS divides latitude and longitude, and that of 2e7.
const DIVISOR: (u32, u32) = (0x4163_12D0, 0x4173_12D0);

/// `CMP r2, #251` with which HORUS decides whether a receiver was heard within 250 ms, and `CMP r2, #1`.
const HEARD: ([u8; 2], [u8; 2]) = ([0xFB, 0x2A], [0x01, 0x2A]);

/// `ADDS r0, #64; STRH.W r0`: Reported-Position's status gets the bit *degraded* and goes into the object. And `#70`,
/// which adds 6 receivers that agree.
const STATUS: ([u8; 4], [u8; 4]) = ([0x40, 0x30, 0xAD, 0xF8], [0x46, 0x30, 0xAD, 0xF8]);

table! {
    // The wire TICK.
    a_tick_that_is_not_seen => Row::new(Violation::NoTick, || wire(WireFault::TickStuck, 5 * MS));
    ticks_that_are_not_seen => Row::new(Violation::NoTick, || wire(WireFault::TickStuck, 45 * MS));
    a_tick_too_many => Row::new(Violation::TickIrregular, || wire(WireFault::TickGlitch, 5 * MS));
    an_oscillator_that_is_off_by_more_than_any_may_be => Row {
        setup: |setup| setup.crystals.horus_ppb = 25_000_000,
        ..Row::new(Violation::TickIrregular, Faults::none)
    };
    // A task that does nothing for a while.
    the_cycles_task_is_dead => Row::new(Violation::NoFrame, || image(ImageFault::Dead("CAN1_RX0".into()), 35 * MS));
    // HORUS's front end.
    a_command_that_is_given_again => Row {
        gps: 1,
        ..Row::new(Violation::ExtraFrame, || front_end(FrontEndFault::CommandAgain(2 * MS), 15 * MS))
    };
    a_front_end_that_sends_again => Row {
        gps: 1,
        ..Row::new(Violation::FrameWithoutCommand, || front_end(FrontEndFault::FrameAgain(2 * MS), 15 * MS))
    };
    a_mute_front_end => Row::new(Violation::CommandWithoutFrame, || front_end(FrontEndFault::Mute, 15 * MS));
    a_front_end_that_breaks_off => Row::new(Violation::BrokenOff, || front_end(FrontEndFault::BreaksOff, 15 * MS));
    a_front_end_with_a_wrong_length => {
        Row::new(Violation::SentNotWhole, || front_end(FrontEndFault::Shortened, 15 * MS))
    };
    a_front_end_without_an_antenna => {
        Row::new(Violation::FieldDropped, || front_end(FrontEndFault::NoCarrier, 15 * MS))
    };
    a_front_end_that_scatters => Row::new(Violation::AirJitter, || {
        front_end(FrontEndFault::Scatters(5 * US), u64::MAX / 2)
    });
    a_chip_select_that_scatters => {
        Row::new(Violation::CommandJitter, || front_end(FrontEndFault::SelectLate(500), u64::MAX / 2))
    };
    // What HORUS computes.
    a_wrong_table_of_the_frame_crc => Row::new(Violation::SentInvalid, || {
        image(poke("crc::FRAME_TABLE", &[0; 1024]), 45 * MS)
    });
    a_wrong_table_of_the_position_crc => {
        Row::new(Violation::SentInvalid, || image(poke("crc::POSITION_TABLE", &[0; 1024]), 45 * MS))
    };
    a_count_of_ticks_that_jumps => {
        Row::new(Violation::TimestampWrong, || Faults::none().with(
            BREAKS,
            BREAKS,
            Fault::Image(Board::Horus, poke("cycle_timer::TICKS", &1_000_u32.to_le_bytes())),
        ))
    };
    a_wrong_divisor => Row::new(Violation::ContentWrong, || {
        image(replaced("Receiver>::parse", &DIVISOR.0.to_le_bytes(), &DIVISOR.1.to_le_bytes()), 100 * MS)
    });
    a_receiver_that_counts_as_not_heard => {
        Row::new(Violation::StatusWrong, || image(replaced("cycle::gps_values", &HEARD.0, &HEARD.1), 45 * MS))
    };
    more_receivers_that_agree_than_there_are => {
        Row::new(Violation::ReportedWrong, || image(replaced("CAN1_RX0", &STATUS.0, &STATUS.1), 45 * MS))
    };
}
