//! Rows of the table of violations: HORUS's ticks, transmit commands, frames and objects.

use bench::faults::{Board, Fault, Faults, FrontEndFault, ImageFault, InputFault, ReceiverFault, WireFault};
use bench_judge::Violation;
use horus_tx_fw::receiver::HEARD_MS;

use super::images::{ALWAYS, bits, stores};
use super::{MS, Row, US, breaks, breaks_with, table};

/// The mode register of the STM32's port E (RM0090 8.4.1).
const GPIOE_MODER: u32 = 0x4002_1000;
/// The mode register of the STM32's port D (RM0090 8.4.1).
const GPIOD_MODER: u32 = 0x4002_0C00;
/// The STM32's clock control register; bit 16 is HSEON (RM0090 6.3.1).
const RCC_CR: u32 = 0x4002_3800;

fn wire(fault: WireFault, duration: u64) -> Faults {
    Faults::none().with(breaks(), breaks() + duration, Fault::Wire(fault))
}

fn front_end(fault: FrontEndFault, duration: u64) -> Faults {
    front_end_with(3, fault, duration)
}

fn front_end_with(gps: usize, fault: FrontEndFault, duration: u64) -> Faults {
    Faults::none().with(breaks_with(gps), breaks_with(gps) + duration, Fault::FrontEnd(fault))
}

fn image(fault: ImageFault, duration: u64) -> Faults {
    Faults::none().with(breaks(), breaks() + duration, Fault::Image(Board::Horus, fault))
}

fn poke(symbol: &str, bytes: &[u8]) -> ImageFault {
    ImageFault::Poke { symbol: symbol.into(), offset: 0, bytes: bytes.into() }
}

fn replaced(function: &str, was: &[u8], is: &[u8]) -> ImageFault {
    ImageFault::Replaced { function: function.into(), was: was.into(), is: is.into() }
}

/// The upper words of the float64 numbers 1e7 and 2e7. HORUS divides latitude and longitude by 1e7.
const DIVISOR: (u32, u32) = (0x4163_12D0, 0x4173_12D0);

/// The time, ms, without a message after which HORUS reports that no messages arrive from a receiver.
const NOT_HEARD: u8 = {
    assert!(HEARD_MS < 0xFF);
    HEARD_MS as u8 + 1
};

/// Constants of the voter (float32), and their replacements. They are the squares of limits (30 m, 8 m, 50 m, 200 m/s),
/// and the number of 1/256 of 1e-7 degrees in a radian.
const CEILING: u32 = 0x4461_0000;
const CEILING_HEIGHT: u32 = 0x451C_4000;
const FLOOR_HEIGHT: u32 = 0x4280_0000;
const SPEED: u32 = 0x471C_4000;
const PARTS_PER_RAD: u32 = 0x5208_9A92;
const TWICE_PARTS_PER_RAD: u32 = 0x5288_9A92;
const MINUS_ONE: u32 = 0xBF80_0000;
const TWO: u32 = 0x4000_0000;
const MILLION_MILLIONS: u32 = 0x5368_D4A5;

fn voter(constants: &[(u32, u32)]) -> Faults {
    let constants = constants.iter().map(|(of, value)| ImageFault::Constant { of: *of, value: *value });
    constants
        .fold(Faults::none(), |faults, fault| faults.with(breaks(), u64::MAX / 2, Fault::Image(Board::Horus, fault)))
}

fn with_offset(faults: Faults, north: i32) -> Faults {
    let fault = ReceiverFault::Offset { north, east: 0, up: 0 };
    faults.with(breaks() - 200 * MS, u64::MAX / 2, Fault::Receiver(1, fault))
}

table! {
    a_tick_that_is_not_seen => Row::new(Violation::NoTick, || wire(WireFault::TickStuck, 6 * MS));
    ticks_that_are_not_seen => Row::new(Violation::NoTick, || wire(WireFault::TickStuck, 45 * MS));
    a_tick_too_many => Row::new(Violation::TickIrregular, || wire(WireFault::TickGlitch, 6 * MS));
    an_oscillator_that_is_off_by_more_than_any_may_be => Row {
        setup: |setup| setup.crystals.horus_ppb = 25_000_000,
        ..Row::new(Violation::TickIrregular, Faults::none)
    };
    // The fault keeps the task that loads frames over SPI from doing anything for 35 ms.
    the_transfers_task_is_dead => Row {
        also: Some(Violation::HorusComplains),
        ..Row::new(Violation::NoFrame, || image(ImageFault::Dead("DMA2_STREAM0".into()), 35 * MS))
    };
    a_command_that_is_given_again => Row {
        gps: 1,
        ..Row::new(Violation::ExtraFrame, || front_end_with(1, FrontEndFault::CommandAgain(2 * MS), 15 * MS))
    };
    a_front_end_that_sends_again => Row {
        gps: 1,
        ..Row::new(Violation::FrameWithoutCommand, || front_end_with(1, FrontEndFault::FrameAgain(2 * MS), 15 * MS))
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
    a_wrong_table_of_the_frame_crc => Row::new(Violation::SentInvalid, || {
        image(poke("crc::FRAME_TABLE", &[0; 1024]), 45 * MS)
    });
    a_wrong_table_of_the_position_crc => {
        Row::new(Violation::SentInvalid, || image(poke("crc::POSITION_TABLE", &[0; 1024]), 45 * MS))
    };
    // The fault changes HORUS's count of ticks before the first tick. After it, HORUS compares the count with the tick
    // of its vote and would stop.
    a_count_of_ticks_that_does_not_begin_with_zero => Row {
        also: Some(Violation::HorusComplains),
        ..Row::new(Violation::TimestampWrong, || Faults::none().with(
            17 * MS,
            17 * MS,
            Fault::Image(Board::Horus, poke("cycle_timer::TICKS", &1_000_u32.to_le_bytes())),
        ))
    };
    a_wrong_divisor => Row::new(Violation::ContentWrong, || {
        image(replaced("Receiver>::parse", &DIVISOR.0.to_le_bytes(), &DIVISOR.1.to_le_bytes()), 100 * MS)
    });
    a_receiver_that_counts_as_not_heard => {
        Row::new(Violation::StatusWrong, || {
            image(ImageFault::Compared { function: "CAN1_RX0".into(), with: NOT_HEARD, value: 1 }, 45 * MS)
        })
    };
    a_vote_that_is_moved_twice_as_far => {
        Row::new(Violation::ReportedWrong, || voter(&[(PARTS_PER_RAD, TWICE_PARTS_PER_RAD)]))
    };
    a_voter_to_whom_nobody_agrees => Row::new(Violation::VoteMissing, || voter(&[(CEILING, MINUS_ONE)]));
    a_voter_that_does_not_look_at_heights => Row::new(Violation::VoteWrong, || {
        let blind = voter(&[(FLOOR_HEIGHT, MILLION_MILLIONS), (CEILING_HEIGHT, MILLION_MILLIONS)]);
        let offset = ReceiverFault::Offset { north: 0, east: 0, up: 120 };
        blind.with(breaks() + 50 * MS, u64::MAX / 2, Fault::Receiver(1, offset))
    });
    a_voter_that_takes_a_jump_at_once => Row::new(Violation::VoteWrong, || {
        (0..3).fold(voter(&[(SPEED, MILLION_MILLIONS)]), |faults, receiver| {
            let jump = Fault::Receiver(receiver, ReceiverFault::Jumps { metres: 1_000 });
            faults.with(breaks() + 50 * MS, u64::MAX / 2, jump)
        })
    });
    a_receiver_that_takes_itself_for_a_car => Row {
        duration: || 6_000 * MS,
        ..Row::new(Violation::NotAirborne, || {
            Faults::none().with(breaks(), breaks(), Fault::Receiver(0, ReceiverFault::ForgetsModel))
        })
    };
    a_relay_that_switches_unseen => Row::new(Violation::StateWrong, || {
        let switches = Fault::Input(0, InputFault::Active);
        wire(WireFault::InputsUnseen, 300 * MS).with(breaks() + MS, breaks() + 61 * MS, switches)
    });
    // In the changed program, PE3, chip select of the receiver on SPI, stays an input.
    a_receiver_that_is_never_selected => Row {
        duration: || 1_800 * MS,
        setup: |setup| stores(setup, Board::Horus, ALWAYS, &[bits(GPIOE_MODER, 0xC0, 0)]),
        ..Row::new(Violation::NotRead, Faults::none)
    };
    a_voter_that_is_too_strict => {
        Row::new(Violation::ExclusionWrong, || with_offset(voter(&[(CEILING, TWO)]), 3))
    };
    // In the changed program, PD5, on which HORUS sends to GPS1, stays an input.
    a_receiver_that_hears_nothing_keeps_its_factory_settings => Row {
        gps: 1,
        duration: || 5_600 * MS,
        setup: |setup| {
            setup.factory_settings = true;
            stores(setup, Board::Horus, ALWAYS, &[bits(GPIOD_MODER, 0xC00, 0)]);
        },
        ..Row::new(Violation::NotConfigured, Faults::none)
    };
    receivers_that_never_have_a_fix => Row {
        duration: || 7_500 * MS,
        ..Row::new(Violation::NoPosition, || {
            Faults::none().with(1, u64::MAX, Fault::Wire(WireFault::Sky(ReceiverFault::NoFix)))
        })
    };
    receivers_that_are_all_off_by_as_much => Row::new(Violation::PositionOff, || {
        let off = ReceiverFault::Offset { north: 40, east: 0, up: 0 };
        Faults::none().with(1, u64::MAX, Fault::Wire(WireFault::Sky(off)))
    });
    a_horus_that_does_not_use_its_crystal => Row {
        setup: |setup| stores(setup, Board::Horus, ALWAYS, &[bits(RCC_CR, 0x1_0000, 0)]),
        ..Row::new(Violation::CrystalWrong, Faults::none)
    };
}
