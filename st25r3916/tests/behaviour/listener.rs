//! Tests the listener against the stand-in for the chip.

use st25r3916::listener::{BUFFER, TAIL};
use st25r3916::{
    Dropped, Fault, FrameFlags, Input, Listener, ListenerConfig, ListenerEvent, ListenerState, ReadMode, Step,
    Transfer, Variant,
};

use crate::stand_in::{CRC, Chip, EOF, EON, ERROR, Happening, MAIN, Miso, RXE, RXS, Rig, TIMER, told};

const STORE: ListenerConfig = ListenerConfig { read_mode: ReadMode::StoreAndForward, ..ListenerConfig::new() };
const FILLING: ListenerConfig = ListenerConfig::new();
const BOTH: [ListenerConfig; 2] = [STORE, FILLING];
const CLEAN: FrameFlags = FrameFlags::empty();

fn listening(chip: Chip, config: ListenerConfig) -> (Rig, Listener) {
    let mut rig = Rig::new(chip);
    let mut listener = Listener::new(config);
    assert_eq!(rig.listener(&mut listener), ListenerEvent::Listening);
    rig.log();
    (rig, listener)
}

fn payload(len: usize, seed: usize) -> Vec<u8> {
    (0..len).map(|index| (index * 31 + seed * 7 + 3) as u8).collect()
}

/// Sends a frame 1 ms from now, and checks that the listener delivers it whole. The listener may report the field
/// first.
fn hears(rig: &mut Rig, listener: &mut Listener, len: usize) {
    let bytes = payload(len, len);
    rig.chip.frame(rig.chip.now + 1_000, &bytes);
    let mut event = rig.listener(listener);
    if event == ListenerEvent::FieldOn {
        event = rig.listener(listener);
    }
    assert_eq!(event, ListenerEvent::Frame { len, flags: CLEAN });
    assert_eq!(rig.buffer[1..=len], bytes);
}

fn bring_up_log(chip: Chip) -> Vec<String> {
    let mut rig = Rig::new(chip);
    let mut listener = Listener::new(FILLING);
    assert_eq!(rig.listener(&mut listener), ListenerEvent::Listening);
    rig.assert_no_misuse();
    rig.log()
}

// Shows WAY-2.
#[test]
fn an_st25r3916_is_brought_up_byte_by_byte() {
    assert_eq!(
        bring_up_log(Chip::new(Variant::A)),
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
            "08 5D",
            "29 FF",
            "FB 28 00",
            "26 00 FF",
            "2A 13 02",
            "0A 00 13 2D 00 00 02",
            "FB 0C 54 00",
            "16 CF E7 0F FB",
            "03 A0 22",
            "40 00 00", // read back, in the same order
            "6C 00",
            "48 00",
            "69 00",
            "FB 68 00",
            "66 00 00",
            "6A 00 00",
            "4A 00 00 00 00 00 00",
            "FB 4C 00 00",
            "56 00 00 00 00",
            "43 00 00",
            "02 C3",
            "DB",
            "D1",
            "42 00 00 00",
            "71 00",
        ]
    );
}

#[test]
fn an_st25r3916b_is_calibrated_and_has_its_own_antenna_tuning() {
    assert_eq!(
        bring_up_log(Chip { supply_mv: 3_300, ..Chip::new(Variant::B) }),
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
            "00 07 BC",
            "D6",
            "5A 00 00 00 00", // I_dct
            "08 5D",
            "29 FF",
            "FB 28 00",
            "26 00 00",
            "2A 13 02",
            "0A 00 13 2D 00 00 02",
            "FB 0C 54 00",
            "16 CF E7 0F FB",
            "03 A0 22",
            "40 00 00", // read back, in the same order
            "6C 00",
            "48 00",
            "69 00",
            "FB 68 00",
            "66 00 00",
            "6A 00 00",
            "4A 00 00 00 00 00 00",
            "FB 4C 00 00",
            "56 00 00 00 00",
            "43 00 00",
            "02 C3",
            "DB",
            "D1",
            "42 00 00 00",
            "71 00",
        ]
    );
}

#[test]
fn a_listener_has_the_receive_chain_of_nfc_f() {
    for variant in [Variant::A, Variant::B] {
        let (rig, listener) = listening(Chip::new(variant), FILLING);
        assert_eq!(listener.variant(), Some(variant));
        assert_eq!(rig.chip.a[0x0B], 0x13, "hz_12_80khz and lp_600khz, not the subcarrier's hz_600_400khz");
        assert_eq!(rig.chip.a[0x0C], 0x2D);
        assert_eq!(rig.chip.a[0x0D..=0x0E], [0, 0], "gain is reduced");
        assert_eq!(rig.chip.b[0x0C..=0x0D], [0x54, 0]);
        assert_eq!(rig.chip.a[0x0A], 0, "the correlator is off");
    }
}

#[test]
fn the_receiver_goes_on_only_after_every_register_was_read_back() {
    // Each row names a register, by space and address, and one of its bits, which the chip stores inverted.
    let registers = [
        (0, 0x00, 0x80),
        (0, 0x01, 0x20),
        (0, 0x03, 0x80),
        (0, 0x04, 0x01),
        (0, 0x08, 0x04),
        (0, 0x0A, 0x80),
        (0, 0x0B, 0x08),
        (0, 0x0C, 0x40),
        (0, 0x0D, 0xD8),
        (0, 0x0E, 0x10),
        (0, 0x0F, 0x01),
        (0, 0x16, 0x20),
        (0, 0x17, 0x10),
        (0, 0x18, 0x80),
        (0, 0x19, 0x01),
        (0, 0x26, 0x80),
        (0, 0x27, 0x01),
        (0, 0x29, 0x0F),
        (0, 0x2A, 0x10),
        (0, 0x2B, 0x20),
        (1, 0x0C, 0x10),
        (1, 0x0D, 0x01),
        (1, 0x28, 0x10),
    ];
    for stuck in registers {
        let mut rig = Rig::new(Chip { stuck: Some(stuck), ..Chip::new(Variant::A) });
        let mut listener = Listener::new(FILLING);
        let ListenerEvent::Fault(fault) = rig.listener(&mut listener) else { panic!("{stuck:02x?}") };
        assert_eq!(told(fault), stuck, "{fault:02x?}");
        assert_eq!(rig.chip.a[2] & 0x40, 0, "the receiver is on, {stuck:02x?}");
        rig.chip.stuck = None;
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Listening);
        hears(&mut rig, &mut listener, 244);
    }
}

#[test]
fn a_supply_out_of_range_is_a_fault_that_tells_the_millivolts() {
    let mut rig = Rig::new(Chip { supply_mv: 2_000, ..Chip::new(Variant::B) });
    let mut listener = Listener::new(FILLING);
    let fault = ListenerEvent::Fault(Fault::SupplyOutOfRange { millivolts: 1_989 });
    assert_eq!(rig.listener(&mut listener), fault);
    assert_eq!(rig.listener(&mut listener), fault);
    assert_eq!(listener.supply_mv(), None);
    rig.chip.supply_mv = 5_100;
    assert_eq!(rig.listener(&mut listener), ListenerEvent::Listening);
    assert_eq!(listener.supply_mv(), Some(5_101));
    hears(&mut rig, &mut listener, 244);
    rig.assert_no_misuse();
}

#[test]
fn a_listener_tells_its_state() {
    let mut rig = Rig::new(Chip::new(Variant::A));
    let mut listener = Listener::new(STORE);
    assert_eq!(listener.state(), ListenerState::New);
    assert_eq!(rig.listener_within(&mut listener, 1), None);
    assert_eq!(listener.state(), ListenerState::BringingUp);
    assert_eq!(rig.listener(&mut listener), ListenerEvent::Listening);
    assert_eq!(listener.state(), ListenerState::Reported);
    rig.chip.frame(rig.chip.now + 1_000, &payload(50, 1));
    let mut seen = Vec::new();
    loop {
        let event = rig.listener_within(&mut listener, 1);
        seen.push(listener.state());
        if event.is_some() {
            break;
        }
    }
    assert_eq!(
        seen,
        [
            ListenerState::Listening,
            ListenerState::ReadingStatus { late: false },
            ListenerState::Receiving,
            ListenerState::ReadingStatus { late: false },
            ListenerState::ReadingFifo { count: 51, end: true },
            ListenerState::Delivered,
        ]
    );
    seen.clear();
    for _ in 0..5 {
        assert_eq!(rig.listener_within(&mut listener, 1), None);
        seen.push(listener.state());
    }
    assert_eq!(
        seen,
        [
            ListenerState::RearmStatus,
            ListenerState::RearmClear,
            ListenerState::RearmUnmask,
            ListenerState::CheckingSetting,
            ListenerState::Listening,
        ]
    );
    // After the supervision interval the listener checks the chip. A failed transfer of the check leads to a fault.
    assert_eq!(rig.listener_within(&mut listener, 1), None);
    assert_eq!(listener.state(), ListenerState::ReadingStatus { late: true });
    assert_eq!(rig.listener_within(&mut listener, 1), None);
    assert_eq!(listener.state(), ListenerState::CheckingConfiguration);
    assert_eq!(rig.listener_within(&mut listener, 1), None);
    assert_eq!(listener.state(), ListenerState::CheckingField { idle: true });
    assert_eq!(rig.listener_within(&mut listener, 1), None);
    assert_eq!(listener.state(), ListenerState::RearmStatus);
    let _ = listener.step(Input::Failed);
    assert_eq!(listener.state(), ListenerState::Faulted);
    let _ = listener.step(Input::Start);
    assert_eq!(listener.state(), ListenerState::BackingOff);
}

#[test]
fn a_frame_is_stored_and_forwarded_in_one_status_and_one_read() {
    let (mut rig, mut listener) = listening(Chip::new(Variant::B), STORE);
    let sync = rig.chip.now + 500;
    let end = rig.chip.frame(sync, &payload(244, 1));
    assert_eq!(rig.listener(&mut listener), ListenerEvent::Frame { len: 244, flags: CLEAN });
    assert_eq!(rig.buffer[0], 245);
    assert_eq!(rig.buffer[1..245], payload(244, 1));
    assert_eq!(rig.buffer[245..247], [0, 0], "the CRC-16 is not read");
    // At the stand-in's 8 MHz the read of the status takes 10 µs, and the read of the FIFO 248 µs.
    assert_eq!(rig.chip.now - end, 10 + 248);

    let log = rig.log();
    assert_eq!(log[..2], ["59 00 00 00 00 00 00 00"; 2]); // I_rxs, I_rxe
    assert!(log[2].starts_with("9F 00"));
    assert_eq!(log.len(), 3, "nothing is re-armed before the frame is delivered");
    assert_eq!(rig.listener_within(&mut listener, 5), None);
    assert_eq!(rig.log(), ["59 00 00 00 00 00 00 00", "DB", "D1", "40 00 00"]);
    rig.assert_no_misuse();
}

#[test]
fn only_few_bytes_are_left_to_read_at_a_frames_end() {
    let (mut rig, mut listener) = listening(Chip::new(Variant::B), FILLING);
    for len in [124, 184, 244, 254] {
        let end = rig.chip.frame(rig.chip.now + 2_000, &payload(len, len));
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Frame { len, flags: CLEAN });
        assert_eq!(rig.buffer[1..=len], payload(len, len));
        let left = rig.chip.log.iter().rev().find(|mosi| mosi[0] == 0x9F).unwrap().len() - 1;
        assert_eq!(left, TAIL - 2, "bytes read after I_rxe for {len}, without the CRC-16");
        assert!(rig.chip.now - end <= 17, "{} µs after the last bit for {len}", rig.chip.now - end);
        let reads = rig.chip.log.iter().filter(|mosi| mosi[0] == 0x9F).count();
        assert_eq!(reads, 4);
        assert_eq!(rig.listener_within(&mut listener, 5), None);
        rig.log();
    }
    rig.assert_no_misuse();
}

#[test]
fn the_last_early_read_leaves_a_byte_unless_another_arrives_meanwhile() {
    for (level, len) in [(1, None), (2, Some(1)), (23, Some(22)), (24, Some(24)), (25, Some(25))] {
        // A LEN of 40 makes the last early read follow right after the first.
        let mut listener = in_a_frame();
        let _ = listener.step(Input::Done(&status(0, 16)));
        let _ = listener.step(Input::Done(&[40; 15]));
        let _ = listener.step(Input::Timeout);
        let step = listener.step(Input::Done(&status(0, level)));
        match len {
            Some(len) => assert_eq!(step, Step::Transfer(Transfer::Read { offset: 15, len }), "{level}"),
            None => assert!(matches!(step, Step::Wait { .. }), "{step:?}"),
        }
    }
}

#[test]
fn every_length_from_1_to_254_is_received_in_both_modes() {
    for config in BOTH {
        for db_clears_irqs in [false, true] {
            for end_masks_receiver in [false, true] {
                let chip = Chip { db_clears_irqs, end_masks_receiver, ..Chip::new(Variant::B) };
                let (mut rig, mut listener) = listening(chip, config);
                for len in 1..=254 {
                    hears(&mut rig, &mut listener, len);
                }
                assert_eq!(listener.counters().frames, 254);
                assert_eq!(listener.counters().dropped, 0);
                rig.assert_no_misuse();
            }
        }
    }
}

#[test]
fn a_busy_executor_gets_the_same_frame_only_later() {
    for config in BOTH {
        for lateness in [20, 100, 200, 400, 900, 3_000, 4_500] {
            let (mut rig, mut listener) = listening(Chip::new(Variant::B), config);
            rig.lateness = lateness;
            for len in [10, 124, 244] {
                hears(&mut rig, &mut listener, len);
                rig.lateness = 0;
                assert_eq!(rig.listener_within(&mut listener, 5), None);
                rig.lateness = lateness;
            }
            rig.assert_no_misuse();
        }
    }
}

/// The response to a status read that shows `main` in the main interrupt register and `level` bytes in the FIFO.
fn status(main: u8, level: u16) -> [u8; 8] {
    let [high, low] = level.to_be_bytes();
    [0, 0xFB, main, 0, 0, 0, low, high << 6]
}

/// Returns a listener that has received the sync of a frame and has waited for the frame's first bytes.
fn in_a_frame() -> Listener {
    let (_, mut listener) = listening(Chip::new(Variant::B), FILLING);
    let _ = listener.step(Input::Start);
    let _ = listener.step(Input::Irq);
    let _ = listener.step(Input::Done(&status(RXS, 0)));
    let _ = listener.step(Input::Timeout);
    listener
}

#[test]
fn a_frame_is_whole_however_much_of_its_crc_was_read_early() {
    let frame = [&[61], &payload(60, 1)[..], &[0xC1, 0xC2]].concat();
    for on_the_way in 1..=63 {
        let mut listener = in_a_frame();
        let way = Transfer::Read { offset: 0, len: on_the_way };
        assert_eq!(listener.step(Input::Done(&status(0, on_the_way as u16 + 1))), Step::Transfer(way));
        let _ = listener.step(Input::Done(&frame[..on_the_way]));
        let _ = listener.step(Input::Irq);
        let mut step = listener.step(Input::Done(&status(RXE, 63 - on_the_way as u16)));
        if on_the_way < 61 {
            let rest = Transfer::Read { offset: on_the_way, len: 61 - on_the_way };
            assert_eq!(step, Step::Transfer(rest));
            step = listener.step(Input::Done(&frame[on_the_way..61]));
        }
        let whole = ListenerEvent::Frame { len: 60, flags: CLEAN };
        assert_eq!(step, Step::Event(whole), "{on_the_way} bytes were read on the way");
        assert_eq!(listener.counters().frames, 1);
    }
}

#[test]
fn an_early_read_takes_no_more_than_the_buffer_holds() {
    let longest = Transfer::Read { offset: 0, len: BUFFER };
    assert_eq!(in_a_frame().step(Input::Done(&status(0, BUFFER as u16 + 1))), Step::Transfer(longest));
    let dropped = ListenerEvent::Dropped(Dropped::TooLong);
    assert_eq!(in_a_frame().step(Input::Done(&status(0, BUFFER as u16 + 2))), Step::Event(dropped));
}

#[test]
fn two_frames_300_microseconds_apart_are_both_received() {
    for config in BOTH {
        let (mut rig, mut listener) = listening(Chip::new(Variant::B), config);
        for _ in 0..5 {
            let end = rig.chip.frame(rig.chip.now + 4_000, &payload(184, 1));
            // After the gap of 300 µs come the preamble and the sync of the second frame: 64 bits, 151 µs.
            rig.chip.frame(end + 300 + 151, &payload(180, 2));
            assert_eq!(rig.listener(&mut listener), ListenerEvent::Frame { len: 184, flags: CLEAN });
            assert_eq!(rig.buffer[1..=184], payload(184, 1));
            assert_eq!(rig.listener(&mut listener), ListenerEvent::Frame { len: 180, flags: CLEAN });
            assert_eq!(rig.buffer[1..=180], payload(180, 2));
        }
        rig.assert_no_misuse();
    }
}

#[test]
fn a_frame_that_begins_before_the_re_arm_is_received_not_cleared() {
    for config in BOTH {
        // The model of the chip leaves its receiver unmasked after a frame's end.
        let chip = Chip { end_masks_receiver: false, ..Chip::new(Variant::B) };
        let (mut rig, mut listener) = listening(chip, config);
        rig.chip.frame(rig.chip.now + 1_000, &payload(100, 1));
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Frame { len: 100, flags: CLEAN });
        // The caller is slow: it continues when half of the next frame has arrived.
        rig.chip.frame(rig.chip.now + 10, &payload(120, 2));
        rig.chip.advance(rig.chip.now + 1_200);
        rig.log();
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Frame { len: 120, flags: CLEAN });
        assert_eq!(rig.buffer[1..=120], payload(120, 2));
        assert!(!rig.log().contains(&"DB".to_owned()));
        rig.assert_no_misuse();
    }
}

#[test]
fn a_sync_just_before_the_clear_costs_at_most_its_own_frame() {
    for db_clears_irqs in [false, true] {
        for offset in 0..40 {
            let chip = Chip { db_clears_irqs, end_masks_receiver: false, ..Chip::new(Variant::B) };
            let (mut rig, mut listener) = listening(chip, STORE);
            rig.chip.frame(rig.chip.now + 1_000, &payload(100, 1));
            assert!(matches!(rig.listener(&mut listener), ListenerEvent::Frame { .. }));
            rig.chip.frame(rig.chip.now + offset, &payload(120, 2));
            match rig.listener(&mut listener) {
                ListenerEvent::Frame { len, flags } if flags.is_clean() => {
                    assert_eq!(len, 120);
                    assert_eq!(rig.buffer[1..=120], payload(120, 2));
                }
                // The listener's command to clear the FIFO has damaged the frame. The frame's flags show the damage.
                ListenerEvent::Frame { flags, .. } => assert!(flags.contains(FrameFlags::LENGTH)),
                other => assert!(matches!(other, ListenerEvent::Dropped(_)), "{other:?}"),
            }
            hears(&mut rig, &mut listener, 244);
        }
    }
}

#[test]
fn a_frame_without_end_is_dropped_6_ms_after_its_sync() {
    for config in BOTH {
        for bytes in [0, 1, 5, 100, 247] {
            let (mut rig, mut listener) = listening(Chip::new(Variant::B), config);
            let sync = rig.chip.now + 1_000;
            let mut frame = vec![245];
            frame.extend(payload(246, 1));
            rig.chip.raw_frame(sync, &frame[..bytes], None);
            assert_eq!(rig.listener(&mut listener), ListenerEvent::Dropped(Dropped::NoEnd));
            let after = rig.chip.now - sync;
            assert!((6_000..6_400).contains(&after), "{after} µs");
            rig.log();
            hears(&mut rig, &mut listener, 244);
            let log = rig.log();
            assert_eq!(log[0], "59 00 00 00 00 00 00 00");
            // The listener need not clear an empty FIFO.
            assert!(log[1] == "D1" || log[1..3] == ["DB", "D1"], "{log:?}");
            assert_eq!(listener.counters().no_end, 1);
            rig.assert_no_misuse();
        }
    }
}

#[test]
fn a_crc_error_is_a_flag_and_the_bytes_are_delivered() {
    for config in BOTH {
        let (mut rig, mut listener) = listening(Chip::new(Variant::B), config);
        let mut frame = vec![125];
        frame.extend(payload(124, 1));
        frame.extend([0, 0]);
        rig.chip.raw_frame(rig.chip.now + 1_000, &frame, Some(CRC));
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Frame { len: 124, flags: FrameFlags::CRC });
        assert_eq!(rig.buffer[1..=124], payload(124, 1));
        assert_eq!(listener.counters().crc, 1);
        hears(&mut rig, &mut listener, 244);
    }
}

#[test]
fn a_false_crc_flag_from_a_late_read_costs_no_frame() {
    let (mut rig, mut listener) = listening(Chip::new(Variant::B), STORE);
    let end = rig.chip.frame(rig.chip.now + 1_000, &payload(244, 1));
    rig.chip.at(end + 30, Happening::Irq(ERROR, CRC));
    rig.lateness = 60;
    assert_eq!(rig.listener(&mut listener), ListenerEvent::Frame { len: 244, flags: FrameFlags::CRC });
    assert_eq!(rig.buffer[1..=244], payload(244, 1));
    rig.lateness = 0;
    hears(&mut rig, &mut listener, 244);
}

#[test]
fn framing_errors_on_the_way_are_flags_of_that_frame_alone() {
    for config in BOTH {
        let (mut rig, mut listener) = listening(Chip::new(Variant::B), config);
        let sync = rig.chip.now + 1_000;
        rig.chip.frame(sync, &payload(244, 1));
        rig.chip.at(sync + 1_000, Happening::Irq(ERROR, 0x10));
        rig.chip.at(sync + 2_000, Happening::Irq(ERROR, 0x20));
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Frame { len: 244, flags: FrameFlags::FRAMING });
        assert_eq!(listener.counters().framing, 1);
        hears(&mut rig, &mut listener, 244);
    }
}

#[test]
fn a_damaged_len_is_flagged_whatever_it_claims() {
    for config in BOTH {
        for len_byte in [0, 1, 2, 30, 244, 246, 255] {
            let (mut rig, mut listener) = listening(Chip::new(Variant::B), config);
            let mut frame = vec![len_byte];
            frame.extend(payload(246, 1));
            rig.chip.raw_frame(rig.chip.now + 1_000, &frame, Some(0));
            assert_eq!(
                rig.listener(&mut listener),
                ListenerEvent::Frame { len: 244, flags: FrameFlags::LENGTH },
                "LEN {len_byte}"
            );
            assert_eq!(rig.buffer[1..=244], payload(246, 1)[..244]);
            hears(&mut rig, &mut listener, 244);
            rig.assert_no_misuse();
        }
    }
}

#[test]
fn frames_too_short_or_too_long_are_dropped_and_forgotten() {
    for config in BOTH {
        let (mut rig, mut listener) = listening(Chip::new(Variant::B), config);
        for (bytes, why) in [(0, Dropped::Runt), (1, Dropped::Runt), (3, Dropped::Runt), (300, Dropped::TooLong)] {
            let mut frame = payload(bytes, 1);
            if let Some(len) = frame.first_mut() {
                *len = 255;
            }
            rig.chip.raw_frame(rig.chip.now + 1_000, &frame, Some(0));
            assert_eq!(rig.listener(&mut listener), ListenerEvent::Dropped(why), "{bytes} bytes");
            hears(&mut rig, &mut listener, 244);
        }
        rig.assert_no_misuse();
    }
}

#[test]
fn a_fifo_overflow_and_a_partial_last_byte_are_flags() {
    // A last byte of fewer than eight bits does not count, so the length no longer agrees with LEN.
    let partial = FrameFlags::PARTIAL.union(FrameFlags::LENGTH);
    for (bits, len, flags) in [(0x10, 50, FrameFlags::OVERFLOW), (0x20, 50, FrameFlags::UNDERFLOW), (0x06, 49, partial)]
    {
        let (mut rig, mut listener) = listening(Chip::new(Variant::B), STORE);
        let sync = rig.chip.now + 1_000;
        rig.chip.frame(sync, &payload(50, 1));
        assert_eq!(rig.listener_within(&mut listener, 3), None); // I_rxs read, waiting for I_rxe
        assert!(rig.chip.now < sync + 50);
        rig.chip.fifo_flags = bits;
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Frame { len, flags });
        hears(&mut rig, &mut listener, 244);
    }
}

#[test]
fn a_frame_broken_off_within_a_byte_keeps_the_bytes_before_it() {
    let sent: Vec<u8> = std::iter::once(185).chain(payload(184, 1)).chain([0xCC; 2]).collect();
    for config in BOTH {
        let (rig, listener) = listening(Chip::new(Variant::B), config);
        for whole in 0..sent.len() {
            // The frame breaks off at every µs within a byte, and also while the listener reads the status early.
            for into in 1..19 {
                let (mut rig, mut listener) = (rig.clone(), listener.clone());
                let over = rig.chip.raw_frame(rig.chip.now + 1_000, &sent[..whole], None);
                rig.chip.at(over + into, Happening::BrokenByte(1 + into as u8 / 3));
                let event = rig.listener(&mut listener);
                if whole < 4 {
                    assert_eq!(event, ListenerEvent::Dropped(Dropped::Runt), "{whole} bytes, {into} us");
                } else {
                    let ListenerEvent::Frame { len, flags } = event else {
                        panic!("{whole} bytes, {into} us: {event:?}")
                    };
                    let expected =
                        [FrameFlags::PARTIAL, FrameFlags::LENGTH].into_iter().all(|flag| flags.contains(flag));
                    assert!(len == whole - 3 && expected, "{whole} bytes, {into} us: {event:?}");
                    assert_eq!(rig.buffer[1..=len], sent[1..=len], "{whole} bytes, {into} us");
                }
                rig.assert_no_misuse();
            }
        }
    }
}

#[test]
fn a_fifo_level_that_lies_is_survived_and_flagged() {
    for config in BOTH {
        for level_error in [-250, -20, -1, 1, 5, 400, 900] {
            let (mut rig, mut listener) = listening(Chip::new(Variant::B), config);
            rig.chip.frame(rig.chip.now + 1_000, &payload(244, 1));
            rig.chip.level_error = level_error;
            match rig.listener(&mut listener) {
                ListenerEvent::Frame { flags, .. } => assert!(flags.contains(FrameFlags::LENGTH)),
                ListenerEvent::Dropped(_) | ListenerEvent::Fault(Fault::Bus) => {}
                other => panic!("{other:?}"),
            }
            rig.chip.level_error = 0;
            rig.chip.advance(rig.chip.now + 10_000);
            while rig.listener_within(&mut listener, 20).is_some() {}
            assert!(hears_again(&mut rig, &mut listener), "level error {level_error}");
        }
    }
}

/// Sends three frames to the listener. Returns whether it delivers one of them whole.
fn hears_again(rig: &mut Rig, listener: &mut Listener) -> bool {
    for seed in 0..3 {
        let bytes = payload(244, seed);
        rig.chip.frame(rig.chip.now + 2_000, &bytes);
        for _ in 0..3 {
            match rig.listener_within(listener, 60) {
                Some(ListenerEvent::Frame { len: 244, flags }) if flags.is_clean() => {
                    return rig.buffer[1..=244] == bytes;
                }
                Some(_) => {}
                None => break,
            }
        }
    }
    false
}

#[test]
fn the_field_coming_and_going_is_told() {
    for config in BOTH {
        let (mut rig, mut listener) = listening(Chip::new(Variant::B), config);
        rig.chip.at(rig.chip.now + 100, Happening::Irq(TIMER, EON));
        assert_eq!(rig.listener(&mut listener), ListenerEvent::FieldOn);
        hears(&mut rig, &mut listener, 244);
        rig.chip.at(rig.chip.now + 5_000, Happening::Irq(TIMER, EOF));
        assert_eq!(rig.listener(&mut listener), ListenerEvent::FieldOff);
        assert_eq!(rig.listener_within(&mut listener, 160), None);
        assert!(rig.chip.now > 400_000);
        assert_eq!(listener.counters().faults, 0);
    }
}

#[test]
fn a_field_lost_under_a_frame_drops_the_frame_and_recovers() {
    for config in BOTH {
        let (mut rig, mut listener) = listening(Chip::new(Variant::B), config);
        rig.chip.at(rig.chip.now + 100, Happening::Irq(TIMER, EON));
        assert_eq!(rig.listener(&mut listener), ListenerEvent::FieldOn);
        let sync = rig.chip.now + 1_000;
        rig.chip.raw_frame(sync, &payload(120, 1), None);
        rig.chip.at(sync + 2_300, Happening::Irq(TIMER, EOF));
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Dropped(Dropped::FieldLost));
        assert_eq!(rig.listener(&mut listener), ListenerEvent::FieldOff);
        rig.chip.at(rig.chip.now + 7_000, Happening::Irq(TIMER, EON));
        assert_eq!(rig.listener(&mut listener), ListenerEvent::FieldOn);
        hears(&mut rig, &mut listener, 244);
        assert_eq!(listener.counters().field_losses, 1);
    }
}

#[test]
fn a_short_drop_of_the_field_is_reported_in_order() {
    let (mut rig, mut listener) = listening(Chip::new(Variant::B), FILLING);
    rig.chip.at(rig.chip.now + 100, Happening::Irq(TIMER, EON));
    assert_eq!(rig.listener(&mut listener), ListenerEvent::FieldOn);
    rig.chip.at(rig.chip.now + 100, Happening::Irq(TIMER, EON | EOF));
    assert_eq!(rig.listener(&mut listener), ListenerEvent::FieldOff);
    assert_eq!(rig.listener(&mut listener), ListenerEvent::FieldOn);
    hears(&mut rig, &mut listener, 244);
}

#[test]
fn a_received_frame_implies_that_there_is_a_field() {
    let (mut rig, mut listener) = listening(Chip::new(Variant::B), FILLING);
    hears(&mut rig, &mut listener, 244);
    rig.chip.at(rig.chip.now + 1_000, Happening::Irq(TIMER, EON | EOF));
    assert_eq!(rig.listener(&mut listener), ListenerEvent::FieldOff);
    assert_eq!(rig.listener(&mut listener), ListenerEvent::FieldOn);
}

#[test]
fn a_change_of_field_without_its_interrupt_is_reported_within_25_ms() {
    let (mut rig, mut listener) = listening(Chip::new(Variant::B), FILLING);
    for event in [ListenerEvent::FieldOn, ListenerEvent::FieldOff, ListenerEvent::FieldOn] {
        rig.chip.senses_field(event == ListenerEvent::FieldOn);
        let changed = rig.chip.now;
        assert_eq!(rig.listener(&mut listener), event);
        assert!(rig.chip.now - changed < 25_000, "{} µs", rig.chip.now - changed);
    }
    assert_eq!(rig.listener_within(&mut listener, 100), None);
}

#[test]
fn a_change_of_field_during_a_bring_up_is_reported_after_it() {
    for there in [true, false] {
        let (mut rig, mut listener) = listening(Chip::new(Variant::B), FILLING);
        if !there {
            rig.chip.field(true);
        }
        silences(&mut rig, &mut listener, 1, !there);
        rig.chip.senses_field(there);
        let changed = rig.chip.now;
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Listening);
        let told = if there { ListenerEvent::FieldOn } else { ListenerEvent::FieldOff };
        assert_eq!(rig.listener(&mut listener), told);
        assert!(rig.chip.now - changed < 8_000, "{} µs", rig.chip.now - changed);
    }
}

#[test]
fn a_start_in_the_middle_of_frames_hears_the_next_whole_one() {
    for config in BOTH {
        for shift in (0..10_000).step_by(487) {
            let mut rig = Rig::new(Chip::new(Variant::B));
            rig.chip.at(0, Happening::Irq(TIMER, EON));
            for cycle in 0..6 {
                rig.chip.frame(shift + cycle * 10_000, &payload(244, cycle as usize));
                // A real chip whose receiver is unmasked in the middle of a frame reports errors, and so does this
                // model.
                rig.chip.at(shift + cycle * 10_000 + 2_000, Happening::Irq(ERROR, 0x30));
            }
            let mut listener = Listener::new(config);
            let mut good = 0;
            while rig.chip.now < 60_000 {
                if let Some(ListenerEvent::Frame { len: 244, .. }) = rig.listener_within(&mut listener, 20) {
                    good += 1;
                }
            }
            assert!(good >= 4, "{good} frames, {shift}");
            assert_eq!(listener.counters().faults, 0);
        }
    }
}

#[test]
fn an_irq_pin_high_before_the_start_does_not_stop_bring_up() {
    let mut chip = Chip::new(Variant::B);
    chip.irqs = [0x7F, 0x7F, 0xFF, 0xFF];
    let (mut rig, mut listener) = listening(chip, FILLING);
    hears(&mut rig, &mut listener, 244);
}

#[test]
fn a_frame_over_before_its_sync_was_read_is_received() {
    for config in BOTH {
        let (mut rig, mut listener) = listening(Chip::new(Variant::B), config);
        rig.lateness = 6_000;
        hears(&mut rig, &mut listener, 244);
    }
}

#[test]
fn a_second_sync_without_an_end_drops_the_first_frame_only() {
    for config in BOTH {
        let (mut rig, mut listener) = listening(Chip::new(Variant::B), config);
        let sync = rig.chip.now + 1_000;
        rig.chip.raw_frame(sync, &payload(60, 1), None);
        rig.chip.frame(sync + 2_000, &payload(124, 2));
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Dropped(Dropped::Overrun));
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Frame { len: 124, flags: CLEAN });
        assert_eq!(rig.buffer[1..=124], payload(124, 2));
        rig.assert_no_misuse();
    }
}

#[test]
fn an_end_and_a_new_sync_in_one_read_drop_the_frame() {
    let (mut rig, mut listener) = listening(Chip::new(Variant::B), STORE);
    rig.chip.frame(rig.chip.now + 1_000, &payload(50, 1));
    assert_eq!(rig.listener_within(&mut listener, 3), None); // I_rxs read, waiting for I_rxe
    rig.chip.advance(rig.chip.now + 2_000);
    assert_eq!(rig.chip.irqs[MAIN], RXE);
    rig.chip.irqs[MAIN] |= RXS;
    assert_eq!(rig.listener(&mut listener), ListenerEvent::Dropped(Dropped::Overrun));
    hears(&mut rig, &mut listener, 244);
}

#[test]
fn a_chip_that_resets_is_noticed_at_the_next_interrupt_or_supervision() {
    for config in BOTH {
        let (mut rig, mut listener) = listening(Chip::new(Variant::A), config);
        hears(&mut rig, &mut listener, 244);
        let start = rig.chip.now;
        rig.chip.at(start + 3_000, Happening::PowerUpReset);
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Fault(Fault::Reset));
        assert!(rig.chip.now - start <= 21_000);
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Listening);
        hears(&mut rig, &mut listener, 244);
    }
}

#[test]
fn a_configuration_lost_behind_the_masks_is_noticed_by_supervision() {
    for (register, expected, found) in [(2, 0xC3, 0x83), (3, 0xA0, 0x08), (4, 0x22, 0x00)] {
        let (mut rig, mut listener) = listening(Chip::new(Variant::B), FILLING);
        rig.chip.a[register] = found;
        let fault = Fault::Register { address: register as u8, expected, found };
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Fault(fault));
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Listening);
        hears(&mut rig, &mut listener, 244);
    }
}

#[test]
fn a_receiver_left_masked_is_unmasked_by_supervision() {
    let (mut rig, mut listener) = listening(Chip::new(Variant::B), FILLING);
    rig.chip.transfer(&[0xD0]);
    assert_eq!(rig.listener_within(&mut listener, 10), None);
    hears(&mut rig, &mut listener, 244);
}

#[test]
fn a_frame_that_begins_while_an_idle_chip_is_checked_is_received() {
    for config in BOTH {
        for db_clears_irqs in [false, true] {
            let chip = Chip { db_clears_irqs, ..Chip::new(Variant::B) };
            let (mut rig, mut listener) = listening(chip, config);
            hears(&mut rig, &mut listener, 244);
            // The sync of a frame comes at every µs of the check after 20 ms without a frame, and of the re-arming
            // after that check.
            for sync in 19_950..20_150 {
                let (mut rig, mut listener) = (rig.clone(), listener.clone());
                let sent = payload(244, sync);
                rig.chip.frame(rig.chip.now + sync as u64, &sent);
                // The stand-in's executor needs 4 µs from one step of the machine to the next.
                let event = loop {
                    if let Some(event) = rig.listener_within(&mut listener, 1) {
                        break event;
                    }
                    rig.chip.advance(rig.chip.now + 4);
                };
                let ListenerEvent::Frame { len: 244, .. } = event else { panic!("{config:?}, {sync} us: {event:?}") };
                assert_eq!(rig.buffer[1..=244], sent, "{config:?}, {sync} us");
                // The last read of the FIFO is short, which shows that the listener read most of the frame while it
                // arrived.
                let left = rig.chip.log.iter().rev().find(|mosi| mosi[0] == 0x9F).unwrap().len() - 1;
                assert!(config != FILLING || left <= TAIL - 2, "{left} bytes after the end, {sync} us");
                rig.assert_no_misuse();
            }
        }
    }
}

#[test]
fn supervision_clears_a_fifo_that_ran_over() {
    let (mut rig, mut listener) = listening(Chip::new(Variant::B), FILLING);
    rig.chip.fifo_flags = 0x10;
    assert_eq!(rig.listener_within(&mut listener, 10), None);
    assert_eq!(rig.chip.fifo_flags, 0);
    hears(&mut rig, &mut listener, 244);
}

#[test]
fn supervision_costs_nothing_while_frames_come() {
    let (mut rig, mut listener) = listening(Chip::new(Variant::B), FILLING);
    for cycle in 0..50 {
        rig.chip.frame(rig.chip.now + 5_000, &payload(244, cycle));
        assert!(matches!(rig.listener(&mut listener), ListenerEvent::Frame { .. }));
    }
    // A frame came in every supervision interval, so operation control, mode and bit rate are read only in their turn.
    assert_eq!(rig.log().iter().filter(|read| *read == "42 00 00 00").count(), 4);
}

#[test]
fn a_dead_bus_is_a_fault_until_the_chip_is_back() {
    for (miso, fault) in [(Miso::StuckHigh, Fault::Bus), (Miso::StuckLow, Fault::Reset)] {
        let (mut rig, mut listener) = listening(Chip::new(Variant::B), FILLING);
        rig.chip.miso = miso;
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Fault(fault));
        for _ in 0..12 {
            rig.transfers = 0;
            assert_eq!(rig.listener(&mut listener), ListenerEvent::Fault(Fault::Absent));
            assert!(rig.transfers < 10);
        }
        rig.chip.miso = Miso::Driven;
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Listening);
        hears(&mut rig, &mut listener, 244);
    }
}

#[test]
fn a_stuck_irq_pin_ends_in_a_fault_not_in_a_loop() {
    for config in BOTH {
        for in_frame in [false, true] {
            let (mut rig, mut listener) = listening(Chip::new(Variant::B), config);
            if in_frame {
                rig.chip.raw_frame(rig.chip.now + 10, &payload(20, 1), None);
            }
            rig.chip.pin_stuck = true;
            rig.transfers = 0;
            assert_eq!(rig.listener(&mut listener), ListenerEvent::Fault(Fault::IrqStuck));
            assert!(rig.transfers < 20, "{}", rig.transfers);
            rig.chip.pin_stuck = false;
            assert_eq!(rig.listener(&mut listener), ListenerEvent::Listening);
            hears(&mut rig, &mut listener, 244);
        }
    }
}

#[test]
fn an_executor_out_of_step_is_a_fault_and_recovers() {
    let (mut rig, mut listener) = listening(Chip::new(Variant::B), FILLING);
    assert!(matches!(listener.step(Input::Start), Step::Wait { .. }));
    rig.outstanding = listener.step(Input::Done(&[0; 8]));
    assert_eq!(rig.outstanding, Step::Event(ListenerEvent::Fault(Fault::Executor)));
    assert_eq!(rig.listener(&mut listener), ListenerEvent::Listening);
    hears(&mut rig, &mut listener, 244);
}

#[test]
fn an_executor_that_keeps_a_reads_bytes_to_itself_gets_frames_flagged() {
    let (mut rig, mut listener) = listening(Chip::new(Variant::B), STORE);
    rig.chip.frame(rig.chip.now + 1_000, &payload(50, 1));
    let mut step = listener.step(Input::Start);
    loop {
        let given = rig.carry_out(step);
        let read = matches!(step, Step::Transfer(Transfer::Read { .. }));
        step = listener.step(if read { Input::Done(&[]) } else { rig.input(given) });
        if let Step::Event(event) = step {
            assert_eq!(event, ListenerEvent::Frame { len: 50, flags: FrameFlags::LENGTH });
            break;
        }
    }
}

#[test]
fn an_error_outside_a_frame_re_arms_the_receiver() {
    let (mut rig, mut listener) = listening(Chip::new(Variant::B), FILLING);
    rig.chip.at(rig.chip.now + 100, Happening::Irq(ERROR, 0x20));
    assert_eq!(rig.listener_within(&mut listener, 6), None);
    assert_eq!(rig.log(), ["59 00 00 00 00 00 00 00", "DB", "D1", "40 00 00"]);
}

#[test]
fn back_off_grows_to_64_ms_and_starts_over_after_a_frame() {
    let (mut rig, mut listener) = listening(Chip::new(Variant::B), FILLING);
    for _ in 0..2 {
        hears(&mut rig, &mut listener, 244);
        rig.chip.miso = Miso::StuckLow;
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Fault(Fault::Reset));
        let mut pauses = Vec::new();
        for _ in 0..9 {
            let before = rig.chip.now;
            assert_eq!(rig.listener(&mut listener), ListenerEvent::Fault(Fault::Absent));
            pauses.push((rig.chip.now - before) / 1_000);
        }
        assert_eq!(pauses, [1, 2, 4, 8, 16, 32, 64, 64, 64]);
        rig.chip.miso = Miso::Driven;
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Listening);
    }
}

#[test]
fn the_buffer_holds_the_longest_frame_and_no_byte_more() {
    for config in BOTH {
        let (mut rig, mut listener) = listening(Chip::new(Variant::B), config);
        let mut frame = vec![255];
        frame.extend(payload(257, 1));
        rig.chip.raw_frame(rig.chip.now + 1_000, &frame[..257], Some(0));
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Frame { len: 254, flags: CLEAN });
        rig.chip.advance(rig.chip.now + 5);
        // A frame with bytes beyond its CRC-16 is too long, although the CRC-16 itself is not read into the buffer.
        for more in 1..=3 {
            frame.resize(257 + more, 0);
            rig.chip.raw_frame(rig.chip.now + 1_000, &frame, Some(0));
            assert_eq!(rig.listener(&mut listener), ListenerEvent::Dropped(Dropped::TooLong), "{more} bytes more");
        }
    }
}

#[test]
fn a_byte_not_whole_on_the_way_is_no_flag() {
    let (mut rig, mut listener) = listening(Chip::new(Variant::B), FILLING);
    let sync = rig.chip.now + 1_000;
    rig.chip.frame(sync, &payload(244, 1));
    while rig.chip.now < sync + 250 {
        assert_eq!(rig.listener_within(&mut listener, 1), None);
        rig.chip.fifo_flags = if rig.chip.now >= sync { 0x06 } else { 0 };
    }
    assert_eq!(rig.listener_within(&mut listener, 1), None); // status, 16 bytes after the sync
    rig.chip.fifo_flags = 0;
    assert_eq!(rig.listener(&mut listener), ListenerEvent::Frame { len: 244, flags: CLEAN });
}

// Shows FE-1.
#[test]
fn every_flipped_setting_is_told_within_one_rotation() {
    for variant in [Variant::A, Variant::B] {
        let (mut rig, mut listener) = listening(Chip::new(variant), FILLING);
        hears(&mut rig, &mut listener, 244);
        let written = rig.chip.written();
        assert!(written.len() >= 22, "{written:02x?}");
        for (space, address) in written {
            for bit in 0..8 {
                let (mut rig, mut listener) = (rig.clone(), listener.clone());
                rig.chip.flip(space, address, bit);
                let mut frames = 0;
                let fault = loop {
                    rig.chip.frame(rig.chip.now + 5_000, &payload(244, 1));
                    match rig.listener(&mut listener) {
                        ListenerEvent::Fault(fault) => break fault,
                        ListenerEvent::Frame { .. } => frames += 1,
                        event => panic!("{space} {address:02x} {bit}: {event:?}"),
                    }
                    assert!(frames <= 12, "{space} {address:02x} {bit} was not told");
                };
                match fault {
                    Fault::Reset => assert_eq!((space, address, bit), (0, 0x02, 7)),
                    fault => assert_eq!(told(fault), (space, address, 1 << bit), "{fault:02x?}"),
                }
                rig.chip.clear_air();
                assert_eq!(rig.listener(&mut listener), ListenerEvent::Listening);
                hears(&mut rig, &mut listener, 244);
            }
        }
    }
}

/// Returns the instants, ms from now, of the next bring-ups for silence.
fn silences(rig: &mut Rig, listener: &mut Listener, count: usize, field: bool) -> Vec<u64> {
    let start = rig.chip.now;
    let mut instants = vec![];
    while instants.len() < count {
        match rig.listener_within(listener, 400) {
            Some(ListenerEvent::Fault(fault)) => {
                assert_eq!(fault, Fault::Silence { field });
                instants.push((rig.chip.now - start) / 1_000);
            }
            Some(ListenerEvent::Listening) if field => rig.chip.field(true),
            _ => {}
        }
    }
    instants
}

// Shows FE-2.
#[test]
fn a_listener_that_hears_nothing_is_brought_up_anew_ever_more_rarely() {
    for field in [true, false] {
        let (mut rig, mut listener) = listening(Chip::new(Variant::B), FILLING);
        if field {
            rig.chip.field(true);
        }
        let mut before = 0;
        for (instant, after) in silences(&mut rig, &mut listener, 7, field).iter().zip([500, 1_000, 2_000, 4_000]) {
            let waited = instant - before;
            assert!((after * 9 / 10..=after + 20).contains(&waited), "{waited} ms");
            before = *instant;
        }
        // The last bring-up for silence came after the longest interval, so the interval does not grow any more.
        let instants = silences(&mut rig, &mut listener, 2, field);
        assert!((7_200..=8_020).contains(&(instants[1] - instants[0])), "{instants:?}");
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Listening);
        hears(&mut rig, &mut listener, 244);
        rig.chip.field(field);
        let instants = silences(&mut rig, &mut listener, 1, field);
        assert!((450..=530).contains(&instants[0]), "{instants:?}");
        let before = rig.chip.now;
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Listening);
        assert!(rig.chip.now - before < 8_000, "{} µs", rig.chip.now - before);
    }
}

#[test]
fn no_back_off_of_earlier_faults_delays_the_bring_up_for_silence() {
    let (mut rig, mut listener) = listening(Chip::new(Variant::B), FILLING);
    // Ten faults in a row raise the back-off to 64 ms. A further fault would be followed by that back-off.
    rig.chip.miso = Miso::StuckLow;
    assert_eq!(rig.listener(&mut listener), ListenerEvent::Fault(Fault::Reset));
    for _ in 0..9 {
        assert_eq!(rig.listener(&mut listener), ListenerEvent::Fault(Fault::Absent));
    }
    rig.chip.miso = Miso::Driven;
    assert_eq!(rig.listener(&mut listener), ListenerEvent::Listening);
    silences(&mut rig, &mut listener, 1, false);
    let before = rig.chip.now;
    assert_eq!(rig.listener(&mut listener), ListenerEvent::Listening);
    assert!(rig.chip.now - before < 8_000, "{} µs", rig.chip.now - before);
}

#[test]
fn a_deaf_listener_notices_whatever_interrupts_come_without_a_frame() {
    for disturbance in 0..3 {
        let (mut rig, mut listener) = listening(Chip::new(Variant::B), FILLING);
        let start = rig.chip.now;
        let fault = loop {
            let now = rig.chip.now;
            match disturbance {
                0 => rig.chip.at(now + 700, Happening::Irq(TIMER, EON | EOF)),
                1 => rig.chip.at(now + 700, Happening::Irq(ERROR, 0x20)),
                _ => rig.chip.at(now + 700, Happening::Irq(MAIN, RXS)),
            }
            if let Some(ListenerEvent::Fault(fault)) = rig.listener_within(&mut listener, 8) {
                break fault;
            }
            assert!(rig.chip.now - start < 2_000_000, "{disturbance}");
        };
        assert!(matches!(fault, Fault::Silence { .. }), "{fault:?}");
    }
}

#[test]
fn frames_that_come_keep_a_listener_from_ever_being_brought_up() {
    let (mut rig, mut listener) = listening(Chip::new(Variant::B), FILLING);
    for _ in 0..150 {
        rig.chip.advance(rig.chip.now + 8_000);
        hears(&mut rig, &mut listener, 244);
    }
    assert_eq!((listener.counters().bring_ups, listener.counters().faults), (1, 0));
}
