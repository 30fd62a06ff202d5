//! Tests the poller against the stand-in for the chip.

use st25r3916::poller::rest_within_us;
use st25r3916::{
    Fault, Input, Poller, PollerConfig, PollerEvent, PollerState, ReceiverMode, SendError, SendState, Step, Variant,
};

use crate::stand_in::{Chip, Happening, Miso, Rig, told};

const SENT: PollerEvent = PollerEvent::Sent { confirmed: true };

fn ready(chip: Chip) -> (Rig, Poller) {
    let mut rig = Rig::new(chip);
    let mut poller = Poller::new(PollerConfig::new());
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
    rig.log();
    (rig, poller)
}

fn bring_up_log(variant: Variant, config: PollerConfig) -> Vec<String> {
    let mut rig = Rig::new(Chip::new(variant));
    let mut poller = Poller::new(config);
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
    assert_eq!(poller.variant(), Some(variant));
    rig.assert_no_misuse();
    rig.log()
}

#[test]
fn an_st25r3916_is_brought_up_byte_by_byte() {
    assert_eq!(
        bring_up_log(Variant::A, PollerConfig::new()),
        [
            "C1",
            "00 07 3C",
            "7F 00",
            "FC 04 10",
            "5A 00 00 00 00",
            "02 80",
            "5A 00 00 00 00", // I_osc
            "2C 80",
            "2C 00",
            "DF",
            "5A 00 00 00 00", // I_dct
            "65 00",
            "00 07 3C",
            "D6",
            "5A 00 00 00 00", // I_dct
            "03 1C 22",
            "07 00",
            "0A 00 13 2D 00 00 02",
            "FB 0C 54 00",
            "10 00 00",
            "26 82 82",
            "28 70",
            "FB 28 00",
            "FB 2A 80",
            "16 77 7F FF FB",
            "40 00 00", // read back, in the same order
            "6C 00",
            "43 00 00",
            "47 00",
            "4A 00 00 00 00 00 00",
            "FB 4C 00 00",
            "50 00 00",
            "66 00 00",
            "68 00",
            "FB 68 00",
            "FB 6A 00",
            "56 00 00 00 00",
            "02 88",
            "42 00 00 00",
        ]
    );
}

#[test]
fn an_st25r3916b_is_calibrated_and_has_its_own_am_depth() {
    assert_eq!(
        bring_up_log(Variant::B, PollerConfig::new()),
        [
            "C1",
            "00 07 3C",
            "7F 00",
            "5A 00 00 00 00",
            "02 80",
            "5A 00 00 00 00", // I_osc
            "EA",
            "5A 00 00 00 00", // I_dct
            "2C 80",
            "2C 00",
            "DF",
            "5A 00 00 00 00", // I_dct
            "65 00",
            "00 07 3C",
            "D6",
            "5A 00 00 00 00", // I_dct
            "03 1C 22",
            "07 00",
            "0A 00 13 2D 00 00 02",
            "FB 0C 54 00",
            "10 00 00",
            "26 C5 E3",
            "28 40",
            "FB 28 84",
            "FB 2A 80",
            "FB 2E 09 28",
            "FB 34 01 00 79 07",
            "16 77 7F FF FB",
            "40 00 00", // read back, in the same order
            "6C 00",
            "43 00 00",
            "47 00",
            "4A 00 00 00 00 00 00",
            "FB 4C 00 00",
            "50 00 00",
            "66 00 00",
            "68 00",
            "FB 68 00",
            "FB 6A 00",
            "FB 6E 00 00",
            "FB 74 00 00 00 00",
            "56 00 00 00 00",
            "02 88",
            "42 00 00 00",
        ]
    );
}

fn bring_up_log_at(supply_mv: u32) -> (Rig, Vec<String>) {
    let mut rig = Rig::new(Chip { supply_mv, ..Chip::new(Variant::B) });
    let mut poller = Poller::new(PollerConfig::new());
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
    let told = poller.supply_mv().expect("the supply was measured");
    assert!(told.abs_diff(supply_mv as u16) <= 12, "{told} mV for {supply_mv} mV");
    rig.assert_no_misuse();
    let log = rig.log();
    (rig, log)
}

#[test]
fn a_supply_of_3_3_volts_sets_sup3v_and_nothing_else() {
    let (_, at_5) = bring_up_log_at(5_000);
    let (rig, at_3) = bring_up_log_at(3_300);
    assert_eq!(rig.chip.a[1], 0xBC);
    let different: Vec<_> = at_5.iter().zip(&at_3).filter(|(five, three)| five != three).collect();
    assert_eq!(different, [(&"00 07 3C".to_owned(), &"00 07 BC".to_owned())]);
    assert_eq!(at_5.len(), at_3.len());
}

#[test]
fn every_allowed_supply_is_accepted_with_sup3v_below_3_6_volts() {
    for supply_mv in (2_400..=5_500).step_by(20) {
        let (rig, _) = bring_up_log_at(supply_mv);
        // A step of the measurement is 23.4 mV. Within one step of the threshold both settings are right.
        if supply_mv.abs_diff(3_600) > 23 {
            assert_eq!(rig.chip.a[1], if supply_mv < 3_600 { 0xBC } else { 0x3C }, "{supply_mv} mV");
        }
    }
}

// Shows FE-4.
#[test]
fn a_supply_out_of_range_keeps_the_field_off() {
    for (supply_mv, millivolts) in [(0, 0), (1_200, 1_193), (2_380, 2_387), (5_530, 5_522), (5_900, 5_897)] {
        let mut rig = Rig::new(Chip { supply_mv, ..Chip::new(Variant::A) });
        let mut poller = Poller::new(PollerConfig::new());
        let fault = PollerEvent::Fault(Fault::SupplyOutOfRange { millivolts });
        for _ in 0..3 {
            assert_eq!(rig.poller_next(&mut poller), fault);
            assert_eq!(poller.supply_mv(), None);
            assert_eq!(rig.chip.a[0x31] & 0x20, 0, "the field is on");
        }
        rig.chip.supply_mv = 3_300;
        assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
        assert!(poller.supply_mv().is_some_and(|told| told.abs_diff(3_300) <= 12));
    }
}

#[test]
fn the_supply_is_measured_anew_at_every_bring_up() {
    let (mut rig, mut poller) = ready(Chip::new(Variant::B));
    rig.chip.supply_mv = 3_300;
    rig.chip.at(rig.chip.now, Happening::PowerUpReset);
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Fault(Fault::Reset));
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
    assert_eq!(rig.chip.a[1], 0xBC);
    rig.assert_no_misuse();

    rig.chip.supply_mv = 2_000;
    rig.chip.at(rig.chip.now, Happening::PowerUpReset);
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Fault(Fault::Reset));
    let fault = PollerEvent::Fault(Fault::SupplyOutOfRange { millivolts: 1_989 });
    assert_eq!(rig.poller_next(&mut poller), fault);
    assert_eq!(poller.supply_mv(), None);
}

#[test]
fn a_supply_measurement_that_never_ends_is_given_up_in_time() {
    let mut rig = Rig::new(Chip { measurement_us: None, ..Chip::new(Variant::A) });
    let mut poller = Poller::new(PollerConfig::new());
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Fault(Fault::SupplyMeasurement));
    assert!((1_700..1_900).contains(&rig.chip.now), "{}", rig.chip.now);
    rig.chip.measurement_us = Some(25);
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
}

#[test]
fn an_rc_calibration_without_an_end_costs_6_ms_and_no_fault() {
    let mut spent = Vec::new();
    for calibration_us in [None, Some(5_000), Some(100)] {
        let mut rig = Rig::new(Chip { calibration_us, ..Chip::new(Variant::B) });
        let mut poller = Poller::new(PollerConfig::new());
        assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
        rig.assert_no_misuse();
        assert_eq!(rig.chip.a[0x25], 214, "the result read is not the measurement's");
        spent.push(rig.chip.now);
    }
    assert!((1_000..1_010).contains(&(spent[0] - spent[1])), "{spent:?}");
    assert_eq!(spent[1] - spent[2], 4_900);
}

#[test]
fn measuring_and_reading_back_cost_less_than_a_millisecond() {
    let mut rig = Rig::new(Chip::new(Variant::A));
    let mut poller = Poller::new(PollerConfig::new());
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
    // The bring-up takes 700 µs for the oscillator and 3 ms for the regulators. The rest is 25 µs of measurement and
    // transfers at 8 MHz.
    assert!(rig.chip.now < 700 + 3_000 + 1_000, "{} µs", rig.chip.now);
}

#[test]
fn the_transmitter_goes_on_only_after_every_register_was_read_back() {
    // Each row names a register, by space and address, and one of its bits, which the chip stores inverted.
    let registers = [
        (0, 0x00, 0x80),
        (0, 0x01, 0x20),
        (0, 0x03, 0x04),
        (0, 0x04, 0x01),
        (0, 0x07, 0x01),
        (0, 0x0A, 0x80),
        (0, 0x0B, 0x08),
        (0, 0x0C, 0x40),
        (0, 0x0D, 0xD8),
        (0, 0x0E, 0x10),
        (0, 0x0F, 0x01),
        (0, 0x10, 0x01),
        (0, 0x11, 0x80),
        (0, 0x16, 0x08),
        (0, 0x17, 0x10),
        (0, 0x18, 0x80),
        (0, 0x19, 0x01),
        (0, 0x26, 0x80),
        (0, 0x27, 0x01),
        (0, 0x28, 0x10),
        (1, 0x0C, 0x10),
        (1, 0x0D, 0x01),
        (1, 0x28, 0x80),
        (1, 0x2A, 0x80),
        (1, 0x2E, 0x08),
        (1, 0x2F, 0x20),
        (1, 0x34, 0x01),
        (1, 0x35, 0x10),
        (1, 0x36, 0x40),
        (1, 0x37, 0x04),
    ];
    for stuck in registers {
        let mut rig = Rig::new(Chip { stuck: Some(stuck), ..Chip::new(Variant::B) });
        let mut poller = Poller::new(PollerConfig::new());
        let PollerEvent::Fault(fault) = rig.poller_next(&mut poller) else { panic!("{stuck:02x?}") };
        assert_eq!(told(fault), stuck, "{fault:02x?}");
        assert_eq!(rig.chip.a[0x31] & 0x20, 0, "the field is on, {stuck:02x?}");
        rig.chip.stuck = None;
        assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
    }
}

#[test]
fn an_operation_control_that_does_not_take_its_value_fails_bring_up() {
    let mut rig = Rig::new(Chip { stuck: Some((0, 0x02, 0x04)), ..Chip::new(Variant::B) });
    let mut poller = Poller::new(PollerConfig::new());
    let fault = Fault::Register { address: 0x02, expected: 0x88, found: 0x8C };
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Fault(fault));
    rig.chip.stuck = None;
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
}

#[test]
fn a_poller_tells_its_state() {
    let mut rig = Rig::new(Chip::new(Variant::A));
    let mut poller = Poller::new(PollerConfig::new());
    assert_eq!(poller.state(), PollerState::New);
    let step = poller.step(Input::Start);
    assert_eq!(poller.state(), PollerState::BringingUp);
    assert_eq!(rig.poller(&mut poller, step), PollerEvent::Ready);
    assert_eq!(poller.state(), PollerState::Ready);
    rig.payload = vec![1; 20];
    let step = poller.prepare(20).unwrap();
    assert_eq!(poller.state(), PollerState::Sending(SendState::PreparingClear));
    assert_eq!(rig.poller(&mut poller, step), PollerEvent::Prepared);
    assert_eq!(poller.state(), PollerState::Sending(SendState::Prepared));
    let _ = poller.step(Input::Start);
    assert_eq!(poller.state(), PollerState::Sending(SendState::LoadingHead));
    let _ = poller.step(Input::Done(&[]));
    assert_eq!(poller.state(), PollerState::Sending(SendState::Loaded));
    let _ = poller.step(Input::Done(&[0]));
    assert_eq!(poller.state(), PollerState::Sending(SendState::LoadingRest));
    let _ = poller.step(Input::Done(&[]));
    assert_eq!(poller.state(), PollerState::Sending(SendState::OnAir));
    let _ = poller.step(Input::Irq);
    assert_eq!(poller.state(), PollerState::Sending(SendState::ReadingIrqs { last: false }));
    let _ = poller.step(Input::Done(&[0, 0xFB, 0x08, 0, 0, 0, 0, 0]));
    assert_eq!(poller.state(), PollerState::Sent);
    let _ = poller.step(Input::Failed);
    assert_eq!(poller.state(), PollerState::Faulted);
    let _ = poller.step(Input::Start);
    assert_eq!(poller.state(), PollerState::BackingOff);
}

#[test]
fn the_receiver_can_be_left_on_and_masked() {
    let log = bring_up_log(Variant::B, PollerConfig { receiver: ReceiverMode::OnMasked, ..PollerConfig::new() });
    assert_eq!(log[log.len() - 3..], ["02 C8", "D0", "42 00 00 00"]);
}

#[test]
fn a_frame_is_started_when_only_its_head_is_loaded() {
    let (mut rig, mut poller) = ready(Chip::new(Variant::B));
    let payload: Vec<u8> = (0..244).collect();
    assert_eq!(rig.send(&mut poller, &payload), SENT);
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);

    let log = rig.log();
    assert_eq!(log[..2], ["DB", "22 07 A0"]);
    assert_eq!(log[2], "59 00 00 00 00 00 00 00"); // interrupts of before, FIFO level
    assert_eq!(log[3], "80 00 01 02 03 04 05 06 07 08 09 0A 0B 0C 0D 0E 0F");
    assert_eq!(log[4], "C4");
    assert!(log[5].starts_with("80 10 11 12") && log[5].len() == 3 * (1 + 228) - 1, "{}", log[5]);
    assert_eq!(
        log[6..],
        [
            "59 00 00 00 00 00 00 00", // I_txe
            "42 00 00 00",
            "71 00",
            "40 00 00", // the first of the settings
        ]
    );
    assert_eq!(rig.chip.sent.len(), 1);
    assert_eq!(rig.chip.sent[0].1, payload);
    assert_eq!(poller.counters().sent, 1);
    rig.assert_no_misuse();
}

#[test]
fn every_length_from_1_to_254_is_sent_whole() {
    let (mut rig, mut poller) = ready(Chip::new(Variant::B));
    for len in 1..=254_usize {
        let payload: Vec<u8> = (0..len).map(|index| (index * 7 + len) as u8).collect();
        assert_eq!(rig.send(&mut poller, &payload), SENT);
        assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
        assert_eq!(rig.chip.sent.last().unwrap().1, payload);
    }
    rig.assert_no_misuse();
}

#[test]
fn a_frame_that_does_not_fit_or_comes_too_early_is_refused() {
    let mut fresh = Poller::new(PollerConfig::new());
    assert_eq!(fresh.prepare(10), Err(SendError::NotReady));
    let (mut rig, mut poller) = ready(Chip::new(Variant::B));
    assert_eq!(poller.prepare(0), Err(SendError::Length));
    assert_eq!(poller.prepare(255), Err(SendError::Length));
    assert_eq!(poller.prepare(usize::MAX), Err(SendError::Length));
    assert_eq!(rig.send(&mut poller, &[1; 254]), SENT);
    assert_eq!(poller.prepare(10), Err(SendError::NotReady));
}

#[test]
fn a_loaded_frame_can_be_given_up() {
    let (mut rig, mut poller) = ready(Chip::new(Variant::B));
    rig.payload = vec![1; 20];
    assert_eq!(rig.load(&mut poller, 20), PollerEvent::Loaded);
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
    assert_eq!(rig.send(&mut poller, &[2; 30]), SENT);
    assert_eq!(rig.chip.sent.len(), 1);
    assert_eq!(rig.chip.sent[0].1, [2; 30]);
}

#[test]
fn the_wait_for_the_end_is_the_air_time_and_a_margin() {
    let (mut rig, mut poller) = ready(Chip::new(Variant::B));
    rig.payload = vec![0; 244];
    assert_eq!(rig.load(&mut poller, 244), PollerEvent::Loaded);
    let _ = poller.step(Input::Done(&[0]));
    // The poller waits for the air time, 2040 bits · 32 / 13.56 MHz = 4814.2 µs, rounded up, and a margin of 100 µs.
    // The time of loading the other 228 bytes at 10 MHz is subtracted.
    assert_eq!(poller.step(Input::Done(&[])), Step::Wait { us: 4_815 + 100 - 182 });
}

#[test]
fn interrupts_survive_a_clear_that_clears_them_or_not() {
    for db_clears_irqs in [false, true] {
        let (mut rig, mut poller) = ready(Chip { db_clears_irqs, ..Chip::new(Variant::B) });
        for _ in 0..3 {
            // I_txe is still set from an earlier frame, and must not be taken for the end of this one.
            rig.chip.irqs[0] |= crate::stand_in::TXE;
            let start = rig.chip.now;
            assert_eq!(rig.send(&mut poller, &[9; 244]), SENT);
            assert!(rig.chip.now - start > 4_814, "Sent came before the frame was over");
            assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
        }
    }
}

#[test]
fn an_irq_pin_high_before_the_start_does_not_stop_bring_up() {
    let mut chip = Chip::new(Variant::B);
    chip.irqs = [0x7F, 0x7F, 0xFF, 0xFF];
    let (rig, _) = ready(chip);
    rig.assert_no_misuse();
}

#[test]
fn an_absent_chip_is_a_different_fault_from_a_wrong_chip() {
    for (miso, identity, fault) in [
        (Miso::StuckLow, 0x31, Fault::Absent),
        (Miso::StuckHigh, 0x31, Fault::Absent),
        (Miso::Driven, 0x15, Fault::Identity(0x15)),
    ] {
        let mut rig = Rig::new(Chip { miso, identity, ..Chip::new(Variant::B) });
        let mut poller = Poller::new(PollerConfig::new());
        for _ in 0..10 {
            assert_eq!(rig.poller_next(&mut poller), PollerEvent::Fault(fault));
        }
        rig.chip.miso = Miso::Driven;
        rig.chip.identity = 0x31;
        assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
    }
}

#[test]
fn another_revision_of_the_same_part_is_accepted() {
    let chip = Chip { identity: 0x32, ..Chip::new(Variant::B) };
    let (_, poller) = ready(chip);
    assert_eq!(poller.variant(), Some(Variant::B));
}

#[test]
fn back_off_grows_to_64_ms_and_starts_over_after_a_frame() {
    let mut rig = Rig::new(Chip { miso: Miso::StuckLow, ..Chip::new(Variant::B) });
    let mut poller = Poller::new(PollerConfig::new());
    let mut before = 0;
    let mut pauses = Vec::new();
    for _ in 0..10 {
        assert_eq!(rig.poller_next(&mut poller), PollerEvent::Fault(Fault::Absent));
        pauses.push((rig.chip.now - before) / 1_000);
        before = rig.chip.now;
    }
    assert_eq!(pauses, [0, 1, 2, 4, 8, 16, 32, 64, 64, 64]);

    rig.chip.miso = Miso::Driven;
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
    assert_eq!(rig.send(&mut poller, &[1; 10]), SENT);
    rig.chip.miso = Miso::StuckLow;
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Fault(Fault::Reset));
    before = rig.chip.now;
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Fault(Fault::Absent));
    assert_eq!((rig.chip.now - before) / 1_000, 1);
}

#[test]
fn an_oscillator_or_regulator_that_never_settles_is_a_fault_in_time() {
    let mut rig = Rig::new(Chip { oscillator_us: None, ..Chip::new(Variant::A) });
    let mut poller = Poller::new(PollerConfig::new());
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Fault(Fault::Oscillator));
    assert!((10_000..10_200).contains(&rig.chip.now), "{}", rig.chip.now);

    rig.chip.oscillator_us = Some(700);
    rig.chip.regulator_us = None;
    let start = rig.chip.now;
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Fault(Fault::Regulator));
    assert!((7_700..8_000).contains(&(rig.chip.now - start)), "{}", rig.chip.now - start);

    rig.chip.regulator_us = Some(5_000);
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
}

#[test]
fn a_lost_frame_costs_no_bring_up_and_keeps_the_field_on() {
    let (mut rig, mut poller) = ready(Chip { transmits: false, ..Chip::new(Variant::B) });
    assert_eq!(rig.send(&mut poller, &[3; 100]), PollerEvent::Fault(Fault::NoTransmitEnd));
    rig.log();
    rig.chip.transmits = true;
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
    assert_eq!(rig.log(), ["C2", "DB", "42 00 00 00", "71 00", "40 00 00"]);
    assert_eq!(rig.chip.a[2], 0x88);
    assert_eq!(rig.send(&mut poller, &[4; 100]), SENT);
    assert_eq!(rig.chip.sent.last().unwrap().1, [4; 100]);
}

#[test]
fn a_second_lost_frame_in_a_row_costs_a_bring_up() {
    let (mut rig, mut poller) = ready(Chip { transmits: false, ..Chip::new(Variant::B) });
    for _ in 0..2 {
        assert_eq!(rig.send(&mut poller, &[3; 100]), PollerEvent::Fault(Fault::NoTransmitEnd));
        assert_eq!(poller.counters().bring_ups, 1);
        rig.log();
        assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
    }
    assert_eq!(poller.counters().bring_ups, 2);
    assert_eq!(rig.log()[0], "C1");
}

#[test]
fn a_frame_is_prepared_again_for_another_length() {
    let (mut rig, mut poller) = ready(Chip::new(Variant::B));
    let step = poller.prepare(244).unwrap();
    assert_eq!(rig.poller(&mut poller, step), PollerEvent::Prepared);
    rig.log();
    assert_eq!(rig.send(&mut poller, &[2; 16]), SENT);
    assert_eq!(rig.log()[3..5], ["80 02 02 02 02 02 02 02 02 02 02 02 02 02 02 02 02", "C4"]);
    assert_eq!(rig.chip.sent[0].1, [2; 16]);
}

#[test]
fn a_fifo_that_is_not_empty_before_a_frame_is_a_fault() {
    let (mut rig, mut poller) = ready(Chip { level_error: 3, ..Chip::new(Variant::B) });
    let step = poller.prepare(244).unwrap();
    assert_eq!(rig.poller(&mut poller, step), PollerEvent::Fault(Fault::FifoCount { expected: 0, found: 3 }));
    assert_eq!(rig.chip.sent.len(), 0);
    rig.chip.level_error = 0;
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
    assert_eq!(rig.send(&mut poller, &[1; 244]), SENT);
}

#[test]
fn after_a_fifo_that_ran_dry_the_next_frame_is_sent() {
    let (mut rig, mut poller) = ready(Chip::new(Variant::B));
    rig.payload = vec![1; 244];
    assert_eq!(rig.load(&mut poller, 244), PollerEvent::Loaded);
    rig.chip.fifo.pop_back();
    let transmit = Step::Transfer(st25r3916::Transfer::Short(Poller::transmit()));
    assert_eq!(rig.poller(&mut poller, transmit), PollerEvent::Fault(Fault::FifoFlow));
    assert_eq!(poller.counters().flow, 1);
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
    assert_eq!(rig.send(&mut poller, &[1; 244]), SENT);
    assert_eq!(poller.counters().bring_ups, 1);
}

#[test]
fn bytes_left_in_the_fifo_are_a_fault_where_they_are_checked() {
    for check_left_over in [true, false] {
        let mut rig = Rig::new(Chip::new(Variant::B));
        let mut poller = Poller::new(PollerConfig { check_left_over, ..PollerConfig::new() });
        assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
        rig.payload = vec![1; 244];
        assert_eq!(rig.load(&mut poller, 244), PollerEvent::Loaded);
        rig.chip.fifo.push_back(1);
        let left_over = PollerEvent::Fault(Fault::FifoCount { expected: 0, found: 1 });
        let expected = if check_left_over { left_over } else { SENT };
        let transmit = Step::Transfer(st25r3916::Transfer::Short(Poller::transmit()));
        assert_eq!(rig.poller(&mut poller, transmit), expected);
        assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
        assert_eq!(rig.send(&mut poller, &[1; 244]), SENT);
        assert_eq!(poller.counters().bring_ups, 1);
    }
}

#[test]
fn the_rest_of_a_frame_is_due_two_spi_bytes_early() {
    // Before the first byte of the rest there are 64 + 8 · 17 bits, which take 471.98 µs at 423.75 kbit/s. Two bytes
    // take 1.78 µs on an SPI of 9 MHz, and 16 µs on one of 1 MHz.
    assert_eq!(rest_within_us(9_000_000), Some(471 - 2));
    assert_eq!(rest_within_us(1_000_000), Some(471 - 16));
    assert_eq!((rest_within_us(423_750), rest_within_us(423_751).is_some()), (None, true));
}

#[test]
fn a_chip_that_resets_between_frames_is_brought_up_again() {
    let (mut rig, mut poller) = ready(Chip::new(Variant::A));
    assert_eq!(rig.send(&mut poller, &[1; 10]), SENT);
    rig.chip.at(rig.chip.now, Happening::PowerUpReset);
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Fault(Fault::Reset));
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
    assert_eq!(rig.send(&mut poller, &[1; 10]), SENT);
}

#[test]
fn a_chip_that_resets_under_a_frame_is_brought_up_again() {
    let (mut rig, mut poller) = ready(Chip::new(Variant::A));
    rig.chip.at(rig.chip.now + 3_000, Happening::PowerUpReset);
    assert_eq!(rig.send(&mut poller, &[1; 244]), PollerEvent::Fault(Fault::Reset));
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
    assert_eq!(rig.send(&mut poller, &[1; 244]), SENT);
}

#[test]
fn a_field_that_dropped_is_noticed_between_frames() {
    for lost in [0x10, 0x20] {
        let (mut rig, mut poller) = ready(Chip::new(Variant::B));
        rig.chip.a[0x31] &= !lost;
        assert_eq!(rig.poller_next(&mut poller), PollerEvent::Fault(Fault::FieldDropped));
        assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
        assert_eq!(rig.chip.a[0x31], 0x30);
    }
}

#[test]
fn a_write_that_does_not_stick_fails_bring_up() {
    let mut rig = Rig::new(Chip::new(Variant::B));
    let mut poller = Poller::new(PollerConfig::new());
    let mut step = Step::Event(PollerEvent::Ready);
    let event = loop {
        let given = rig.carry_out(step);
        rig.chip.a[4] = 0x21;
        step = poller.step(rig.input(given));
        if let Step::Event(event) = step {
            break event;
        }
    };
    assert_eq!(event, PollerEvent::Fault(Fault::Register { address: 0x04, expected: 0x22, found: 0x21 }));
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
}

#[test]
fn a_stuck_irq_pin_ends_in_a_fault_not_in_a_loop() {
    let (mut rig, mut poller) = ready(Chip::new(Variant::B));
    rig.chip.pin_stuck = true;
    rig.transfers = 0;
    assert_eq!(rig.send(&mut poller, &[1; 244]), PollerEvent::Fault(Fault::IrqStuck));
    assert!(rig.transfers < 20);
    rig.chip.pin_stuck = false;
    assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
}

#[test]
fn a_failed_transfer_is_a_bus_fault_wherever_it_happens() {
    for transfers in 0..30 {
        let mut rig = Rig::new(Chip::new(Variant::A));
        rig.payload = vec![5; 50];
        let mut poller = Poller::new(PollerConfig::new());
        let mut step = Step::Event(PollerEvent::Ready);
        for _ in 0..transfers {
            let given = rig.carry_out(step);
            step = match poller.step(rig.input(given)) {
                Step::Event(PollerEvent::Ready) => poller.prepare(50).unwrap(),
                Step::Event(PollerEvent::Loaded) => Step::Transfer(st25r3916::Transfer::Short(Poller::transmit())),
                other => other,
            };
        }
        assert_eq!(poller.step(Input::Failed), Step::Event(PollerEvent::Fault(Fault::Bus)));
        assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
        assert_eq!(rig.send(&mut poller, &[1; 20]), SENT);
    }
}

#[test]
fn a_frame_lost_now_and_then_never_costs_a_bring_up() {
    let (mut rig, mut poller) = ready(Chip::new(Variant::B));
    for _ in 0..5 {
        rig.chip.transmits = false;
        assert_eq!(rig.send(&mut poller, &[3; 100]), PollerEvent::Fault(Fault::NoTransmitEnd));
        rig.chip.transmits = true;
        assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
        assert_eq!(rig.send(&mut poller, &[3; 100]), SENT);
        assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
    }
    assert_eq!(poller.counters().bring_ups, 1);
    assert_eq!(poller.counters().faults, 5);
}

#[test]
fn interrupts_without_a_cause_are_counted_anew_for_each_wait() {
    let mut rig = Rig::new(Chip::new(Variant::B));
    let mut poller = Poller::new(PollerConfig::new());
    rig.payload = vec![1; 50];
    let mut step = Step::Event(PollerEvent::Ready);
    let mut false_alarms = 0;
    for _ in 0..1_000 {
        // During each wait seven interrupts come without a cause, one less than make a fault.
        let given = if matches!(step, Step::Wait { .. }) && false_alarms < 7 {
            false_alarms += 1;
            crate::stand_in::Given::Irq
        } else {
            let given = rig.carry_out(step);
            if given == crate::stand_in::Given::Irq {
                false_alarms = 0;
            }
            given
        };
        step = match poller.step(rig.input(given)) {
            Step::Event(PollerEvent::Ready) => poller.prepare(50).unwrap(),
            Step::Event(PollerEvent::Loaded) => Step::Transfer(st25r3916::Transfer::Short(Poller::transmit())),
            Step::Event(PollerEvent::Fault(fault)) => panic!("{fault:?}"),
            other => other,
        };
    }
    assert!(poller.counters().sent > 10);
}

#[test]
fn a_chip_that_never_raises_i_txe_sends_every_frame_unconfirmed() {
    for receiver in [ReceiverMode::Off, ReceiverMode::OnMasked] {
        let mut rig = Rig::new(Chip { transmit_ends: false, ..Chip::new(Variant::B) });
        let mut poller = Poller::new(PollerConfig { receiver, ..PollerConfig::new() });
        assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
        for len in [1, 16, 17, 124, 184, 244, 254] {
            let payload = vec![len as u8; len];
            assert_eq!(rig.send(&mut poller, &payload), PollerEvent::Sent { confirmed: false });
            let (began, sent) = rig.chip.sent.last().unwrap();
            assert_eq!(*sent, payload);
            // The event Sent must come after the frame's last bit, and early enough to prepare the next frame.
            let air = (48 + 16 + 8 * (len as u64 + 3)) * 3_200 / 1_356;
            let late = rig.chip.now - began - air;
            assert!((50..170).contains(&late), "{len} bytes: {late} µs after the last bit");
            assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
        }
        let counters = poller.counters();
        assert_eq!((counters.sent, counters.unconfirmed, counters.faults, counters.bring_ups), (7, 7, 0, 1));
        rig.assert_no_misuse();
    }
}

#[test]
fn a_frame_that_the_chip_did_not_take_is_no_unconfirmed_one() {
    for check_left_over in [true, false] {
        let mut rig = Rig::new(Chip { transmits: false, ..Chip::new(Variant::B) });
        let mut poller = Poller::new(PollerConfig { check_left_over, ..PollerConfig::new() });
        assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
        assert_eq!(rig.send(&mut poller, &[3; 1]), PollerEvent::Fault(Fault::NoTransmitEnd));
        assert_eq!((poller.counters().sent, poller.counters().unconfirmed), (0, 0));
    }
}

// Shows FE-1.
#[test]
fn every_flipped_setting_is_told_within_one_rotation() {
    for (variant, settings) in [(Variant::A, 13), (Variant::B, 15)] {
        let (rig, poller) = ready(Chip::new(variant));
        let written = rig.chip.written();
        assert!(written.len() >= 24, "{written:02x?}");
        for (space, address) in written {
            for bit in 0..8 {
                let (mut rig, mut poller) = (rig.clone(), poller.clone());
                rig.chip.flip(space, address, bit);
                let mut frames = 0;
                let fault = loop {
                    match rig.poller_next(&mut poller) {
                        PollerEvent::Fault(fault) => break fault,
                        event => assert_eq!(event, PollerEvent::Ready, "{space} {address:02x} {bit}"),
                    }
                    frames += 1;
                    assert!(frames <= settings, "{space} {address:02x} {bit} was not told");
                };
                match fault {
                    Fault::Reset => assert_eq!((space, address, bit), (0, 0x02, 7)),
                    fault => assert_eq!(told(fault), (space, address, 1 << bit), "{fault:02x?}"),
                }
                assert_eq!(rig.poller_next(&mut poller), PollerEvent::Ready);
                assert_eq!(rig.send(&mut poller, &[1; 244]), SENT);
            }
        }
    }
}
