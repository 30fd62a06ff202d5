//! Tests that every misuse of the chip by its controller is a finding and causes no panic.

use crate::common;

use common::{Pair, Side, exact, nfc_a_answer, nfc_a_answer_begins, nfc_a_poller, payload};
use proptest::prelude::*;
use st25r3916_model::{Air, AirEvent, AirFaults, Chip, Config, Kind, Space, Variant};

fn exchange(chip: &mut Chip, now: u64, mosi: &[u8]) -> Vec<u8> {
    chip.select(now);
    let miso = mosi.iter().map(|&b| chip.transfer(now, b)).collect();
    chip.deselect(now);
    miso
}

fn clean() -> Air {
    Air::new(0, AirFaults::default())
}

fn found(chip: &Chip, kind: Kind) -> u64 {
    chip.reports().iter().find(|r| r.kind == kind).map_or(0, |r| r.count)
}

#[test]
fn without_an_oscillator_fifo_mode_and_commands_do_nothing_and_say_so() {
    let mut chip = Chip::new(Config::default());
    exchange(&mut chip, 10, &[0x80, 1, 2, 3]);
    assert_eq!(found(&chip, Kind::FifoWithoutOscillator), 3);
    assert_eq!(exchange(&mut chip, 20, &[0x9F, 0]), [0, 0]);
    exchange(&mut chip, 30, &[0x03, 0x1C]);
    assert_eq!(exchange(&mut chip, 40, &[0x43, 0]), [0, 0x08]);
    assert_eq!(found(&chip, Kind::ModeWithoutOscillator), 1);
    exchange(&mut chip, 50, &[0xC4]);
    assert_eq!(found(&chip, Kind::CommandWithoutOscillator(0xC4)), 1);
    assert_eq!(chip.reports()[0].first_ns, 10);
    assert!(!chip.has_air());
}

#[test]
fn transmitting_without_a_field_or_twice_is_refused() {
    let mut pair = Pair::new(Config::default(), Config::default(), Air::new(0, AirFaults::default()));
    pair.start(Side::Poller);
    pair.spi(Side::Poller, &[0x03, 0x1C, 0x22]);
    pair.load(&payload(10, 0));
    pair.fire();
    assert_eq!(found(&pair.poller, Kind::TransmitWithoutField), 1);
    assert!(!pair.poller.is_transmitting());
    pair.spi(Side::Poller, &[0x02, 0x88]);
    pair.fire();
    pair.fire();
    assert_eq!(found(&pair.poller, Kind::TransmitWhileBusy), 1);
    pair.run_for(2_000_000);
    assert_eq!(pair.air.counters().sent, 1);
}

#[test]
fn fifo_over_and_underflow_set_their_flags() {
    let mut pair = Pair::new(Config::default(), Config::default(), Air::new(0, AirFaults::default()));
    pair.start(Side::Poller);
    let mut load = vec![0x80];
    load.extend_from_slice(&payload(514, 1));
    pair.spi(Side::Poller, &load);
    assert_eq!(pair.fifo(Side::Poller), (512, 0x10));
    assert_eq!(found(&pair.poller, Kind::FifoOverflow), 2);
    assert_eq!(pair.read_fifo(Side::Poller, 512), payload(514, 1)[..512]);
    pair.read_fifo(Side::Poller, 1);
    assert_eq!(pair.fifo(Side::Poller).1 & 0x20, 0x20);
    pair.spi(Side::Poller, &[0xDB]);
    assert_eq!(pair.fifo(Side::Poller), (0, 0));
}

#[test]
fn unmodelled_things_are_recorded_with_first_instant_and_count() {
    let mut chip = Chip::new(Config::default());
    exchange(&mut chip, 5, &[0xE4]);
    exchange(&mut chip, 9, &[0xE4]);
    exchange(&mut chip, 11, &[0x09, 0x11]);
    exchange(&mut chip, 12, &[0xFB, 0x01, 0x11]);
    exchange(&mut chip, 13, &[0x3F, 0x11]);
    exchange(&mut chip, 14, &[0xFB]);
    let r = chip.reports().iter().find(|r| r.kind == Kind::UnmodelledCommand(0xE4)).expect("recorded");
    assert_eq!((r.first_ns, r.count), (5, 2));
    assert_eq!(r.to_string(), "direct command E4 is not modelled (2 times, first at 5 ns)");
    assert_eq!(found(&chip, Kind::UnmodelledRegister(Space::A, 0x09)), 1);
    assert_eq!(found(&chip, Kind::NoSuchRegister(Space::B, 0x01)), 1);
    assert_eq!(found(&chip, Kind::ReadOnlyWritten(Space::A, 0x3F)), 1);
    assert_eq!(found(&chip, Kind::TransferCutShort), 1);
}

#[test]
fn a_measurement_that_is_a_constant_is_reported_as_one() {
    let mut chip = Chip::new(Config { amplitude: 0x12, phase: 0x34, ..Config::default() });
    exchange(&mut chip, 0, &[0x02, 0x80]);
    chip.advance(10_000_000);
    for (code, result) in [(0xD3, 0x12), (0xD9, 0x34)] {
        let at = chip.now();
        exchange(&mut chip, at, &[code]);
        chip.advance(at + 1_000_000);
        assert_eq!(exchange(&mut chip, at + 1_000_000, &[0x40 | 0x25, 0])[1], result, "{code:02X}");
        assert_eq!(found(&chip, Kind::ConstantMeasurement(code)), 1);
    }
}

#[test]
fn spi_clock_and_chip_select_are_watched() {
    let mut chip = Chip::new(Config::default());
    chip.transfer(0, 0x40);
    assert_eq!(found(&chip, Kind::NotSelected), 1);
    chip.spi_clock_hz(10_000_000);
    exchange(&mut chip, 1, &[0x7F, 0]);
    chip.spi_clock_hz(18_000_000);
    exchange(&mut chip, 1, &[0x7F, 0]);
    assert_eq!(found(&chip, Kind::SpiTooFast(18_000_000)), 1);
    assert_eq!(chip.reports().len(), 2);
    chip.power_off(2);
    assert_eq!(exchange(&mut chip, 3, &[0x7F, 0]), [0, 0]);
    assert!(found(&chip, Kind::NotPowered) > 0);
}

#[test]
fn an_interrupt_set_behind_a_mask_raises_the_pin_when_unmasked() {
    let mut chip = Chip::new(Config::default());
    exchange(&mut chip, 0, &[0x16, 0xFF]);
    exchange(&mut chip, 0, &[0x02, 0x80]);
    chip.advance(800_000);
    assert!(!chip.irq());
    exchange(&mut chip, 800_000, &[0x16, 0x00]);
    assert!(chip.irq());
    assert_eq!(exchange(&mut chip, 800_000, &[0x5A, 0]), [0, 0x80]);
    assert!(!chip.irq());
    // The interrupt bit is set after the register's value was latched for the read.
    exchange(&mut chip, 800_000, &[0x02, 0x00]);
    exchange(&mut chip, 800_000, &[0x02, 0x80]);
    chip.select(1_499_000);
    chip.transfer(1_499_900, 0x5A);
    assert_eq!(chip.transfer(1_500_900, 0), 0);
    chip.deselect(1_500_900);
    assert!(chip.irq());
    assert_eq!(exchange(&mut chip, 1_501_000, &[0x5A, 0]), [0, 0x80]);
}

#[test]
fn the_switch_decides_whether_clearing_the_fifo_clears_interrupts() {
    for clears in [false, true] {
        let mut chip = Chip::new(Config { db_clears_irqs: clears, ..Config::default() });
        exchange(&mut chip, 0, &[0x02, 0x80]);
        exchange(&mut chip, 800_000, &[0xDB]);
        assert_eq!(chip.irq(), !clears);
    }
}

#[test]
fn end_of_transmission_without_a_receiver_is_a_switch() {
    for raises in [false, true] {
        let poller = Config { txe_with_rx_off: raises, ..Config::default() };
        let mut pair = Pair::started(poller, Config::default(), Air::new(0, AirFaults::default()));
        pair.load(&payload(10, 0));
        pair.fire();
        assert_eq!(pair.wait_irq(Side::Poller, 2_000_000), raises);
        assert_eq!(pair.air.counters().delivered, 1);
    }
}

#[test]
fn no_response_and_wake_up_timers_run_as_set() {
    let mut pair = Pair::started(Config::default(), Config::default(), Air::new(0, AirFaults::default()));
    pair.spi(Side::Poller, &[0x02, 0xC8]);
    pair.spi(Side::Poller, &[0x16, 0xFF, 0xBF, 0xF7, 0xFF]);
    pair.spi(Side::Poller, &[0x10, 0x00, 0x64]);
    pair.load(&payload(10, 0));
    pair.fire();
    assert!(pair.wait_irq(Side::Poller, 5_000_000));
    let end = pair.air.last_frame().expect("sent").end_ns;
    // The write sets the no-response timer to 100 steps of 64 carrier cycles.
    assert_eq!(pair.now - end, 471_976 + pair.poller.config().no_response_extra_ns);
    assert_eq!(pair.irqs(Side::Poller)[1], 0x40);
    pair.spi(Side::Poller, &[0x32, 0x88]);
    pair.spi(Side::Poller, &[0xE1]);
    let from = pair.now;
    assert!(pair.wait_irq(Side::Poller, 20_000_000));
    assert_eq!((pair.now - from, pair.irqs(Side::Poller)[2]), (10_000_000, 0x08));
}

#[test]
fn clearing_the_fifo_in_mid_frame_never_lets_the_frame_arrive_whole() {
    for (at_ns, reload) in [(200_000, false), (1_000_000, false), (1_000_000, true), (4_500_000, false)] {
        let mut pair = Pair::started(exact(), exact(), clean());
        pair.load(&payload(244, 1));
        pair.fire();
        pair.run_for(at_ns);
        pair.spi(Side::Poller, &[0xDB]);
        assert_eq!(found(&pair.poller, Kind::FifoDisturbed), 1, "cleared after {at_ns} ns");
        if reload {
            let mut load = vec![0x80];
            load.extend_from_slice(&payload(244, 2));
            pair.spi(Side::Poller, &load);
        }
        pair.run_for(6_000_000);
        assert_eq!(pair.fifo(Side::Poller).0, if reload { 244 } else { 0 });
        assert_eq!(found(&pair.poller, Kind::TransmitUnderflow), 1);
        assert_eq!(pair.fifo(Side::Poller).1 & 0x20, 0x20, "fifo_unf");
        let irqs = pair.irqs(Side::Listener);
        assert_eq!((irqs[0] & 0x10, irqs[2] & 0x90), (0x10, 0x90), "I_rxe with I_crc and I_err1");
        let (n, _) = pair.fifo(Side::Listener);
        // The number of sent bytes follows from the instant of the clear. A byte takes 18.879 µs, and 64 bits precede
        // LEN.
        let begun = (at_ns as f64 / 1e3 - 3.65 + 1.0 - 151.0) / 18.879;
        assert!((n as f64 - begun).abs() <= 2.0, "{n} bytes, {begun:.1} had begun");
        assert_eq!(pair.read_fifo(Side::Listener, n)[1..], payload(244, 1)[..n - 1]);
        let c = pair.air.counters();
        assert_eq!((c.sent, c.delivered, c.damaged), (1, 0, 1));
        pair.arm();
        pair.irqs(Side::Poller);
        pair.load(&payload(10, 3));
        pair.fire();
        pair.run_for(2_000_000);
        assert_eq!(pair.irqs(Side::Listener), [0x30, 0, 0, 0]);
    }
}

#[test]
fn a_frame_loaded_in_parts_and_then_cleared_counts_as_damaged() {
    let mut pair = Pair::started(exact(), exact(), clean());
    pair.load(&payload(244, 1)[..16]);
    pair.spi(Side::Poller, &[0x22, 0x07, 0xA0]);
    pair.fire();
    pair.run_for(20_000);
    let mut load = vec![0x80];
    load.extend_from_slice(&payload(244, 1)[16..]);
    pair.spi(Side::Poller, &load);
    // The model of the air has only the first 16 bytes. About 40 bytes have been sent when the FIFO is cleared.
    pair.run_for(650_000);
    pair.spi(Side::Poller, &[0xDB]);
    pair.run_for(6_000_000);
    let c = pair.air.counters();
    assert_eq!((c.sent, c.delivered, c.damaged), (1, 0, 1));
}

#[test]
fn reading_the_fifo_in_mid_frame_takes_bytes_from_the_frame() {
    let mut pair = Pair::started(exact(), exact(), clean());
    pair.load(&payload(244, 1));
    pair.fire();
    pair.run_for(1_000_000);
    pair.read_fifo(Side::Poller, 1);
    assert_eq!(found(&pair.poller, Kind::FifoDisturbed), 1);
    pair.run_for(6_000_000);
    assert_eq!(pair.irqs(Side::Listener)[2], 0x90);
    assert_eq!(pair.air.counters().delivered, 0);
}

#[test]
fn a_fifo_cleared_in_time_sends_the_bytes_loaded_after_it() {
    let mut pair = Pair::started(exact(), exact(), clean());
    pair.load(&payload(40, 1));
    pair.fire();
    let now = pair.now;
    pair.poller.select(now);
    pair.poller.transfer(now + 1_000, 0xDB);
    pair.poller.deselect(now + 1_000);
    pair.run_for(20_000);
    let mut load = vec![0x80];
    load.extend_from_slice(&payload(40, 2));
    pair.spi(Side::Poller, &load);
    pair.run_for(2_000_000);
    assert_eq!(found(&pair.poller, Kind::FifoDisturbed), 1);
    assert_eq!(pair.irqs(Side::Listener), [0x30, 0, 0, 0]);
    assert_eq!(pair.read_fifo(Side::Listener, 43)[1..41], payload(40, 2));
}

#[test]
fn clearing_the_fifo_when_its_last_byte_has_left_harms_nothing() {
    let mut pair = Pair::started(exact(), exact(), clean());
    pair.load(&payload(20, 1));
    pair.fire();
    // The CRC follows 64 bits of preamble and sync, LEN and 20 bytes.
    pair.run_for(3_650 + (64 + 21 * 8 + 4) * 2_360);
    assert!(pair.poller.is_transmitting());
    pair.spi(Side::Poller, &[0xDB]);
    pair.run_for(1_000_000);
    assert_eq!(pair.irqs(Side::Listener), [0x30, 0, 0, 0]);
    assert_eq!(pair.poller.reports(), []);
}

#[test]
fn the_water_level_comes_again_each_time_a_reception_reaches_it() {
    let mut pair = nfc_a_poller(exact());
    pair.spi(Side::Poller, &[0x16, 0xBF]);
    let sent = payload(1_100, 7);
    nfc_a_answer_begins(&mut pair, &sent);
    let mut data = Vec::new();
    let mut levels = 0;
    while data.len() < 1_050 {
        if !pair.wait_irq(Side::Poller, 40_000_000) {
            break;
        }
        assert_eq!(pair.irqs(Side::Poller)[0] & 0x40, 0x40);
        let (n, _) = pair.fifo(Side::Poller);
        assert!((300..=301).contains(&n), "{n} bytes at I_wl");
        levels += 1;
        // After the controller has read the FIFO, 50 bytes are left. So I_wl comes again after 250 further bytes.
        data.extend(pair.read_fifo(Side::Poller, 250));
    }
    assert_eq!(levels, 4, "at 300, 550, 800 and 1050 bytes");
    assert_eq!(data, sent[..1_000]);
    pair.run_for(10_000_000);
    assert_eq!(pair.irqs(Side::Poller)[0] & 0x50, 0x10, "the end, and no level");
    assert_eq!(pair.poller.reports(), []);
}

#[test]
fn the_water_level_comes_again_after_the_fifo_was_cleared() {
    let mut pair = nfc_a_poller(exact());
    pair.spi(Side::Poller, &[0x16, 0xBF]);
    nfc_a_answer_begins(&mut pair, &payload(700, 7));
    for _ in 0..2 {
        assert!(pair.wait_irq(Side::Poller, 40_000_000), "I_wl");
        assert_eq!(pair.irqs(Side::Poller)[0] & 0x40, 0x40);
        assert!((300..=301).contains(&pair.fifo(Side::Poller).0));
        pair.spi(Side::Poller, &[0xDB]);
    }
}

#[test]
fn a_mode_or_rate_that_is_not_modelled_is_reported() {
    for (writes, kind) in [
        // Mode 88 is an NFC-A target with anticollision, mode B8 is active communication.
        (&[&[0x03u8, 0x88, 0x22][..]], Kind::UnmodelledMode(0x88)),
        (&[&[0x03, 0xB8, 0x22]], Kind::UnmodelledMode(0xB8)),
        // At the bit rate 20, 106 kbit/s, a target receives no NFC-F.
        (&[&[0x03, 0xA0, 0x20]], Kind::UnmodelledBitRate(0x20)),
    ] {
        let mut pair = Pair::started(exact(), exact(), clean());
        for w in writes {
            pair.spi(Side::Listener, w);
        }
        pair.arm();
        assert_eq!(pair.listener.reports(), []);
        pair.load(&payload(20, 1));
        pair.fire();
        pair.run_for(2_000_000);
        assert_eq!(found(&pair.listener, kind), 1);
        assert_eq!(pair.listener.statistics().missed, 1);
    }
    for (mode, rate, kind) in [
        // Mode 10 is NFC-B. Mode 08 with rate 01 is NFC-A at 212 kbit/s.
        (0x10, 0x00, Kind::UnmodelledMode(0x10)),
        (0x08, 0x01, Kind::UnmodelledBitRate(0x01)),
    ] {
        let mut pair = nfc_a_poller(exact());
        pair.spi(Side::Poller, &[0x03, mode, rate]);
        nfc_a_answer(&mut pair, &[1, 2, 3]);
        assert_eq!(found(&pair.poller, kind), 1);
        // A poller whose receiver is off reports nothing when an answer arrives.
        pair.spi(Side::Poller, &[0x02, 0x88]);
        nfc_a_answer(&mut pair, &[1, 2, 3]);
        assert_eq!(found(&pair.poller, kind), 1);
    }
}

#[test]
fn bits_that_are_kept_without_effect_are_reported_and_others_are_not() {
    let mut chip = Chip::new(exact());
    exchange(&mut chip, 0, &[0x02, 0x80]);
    chip.advance(700_000);
    let harmless: [&[u8]; 5] = [&[0x03, 0x1C], &[0x05, 0x80], &[0x05, 0x1E], &[0x12, 0x29], &[0x12, 0x48]];
    for w in harmless {
        exchange(&mut chip, 700_000, w);
    }
    assert_eq!(chip.reports(), []);
    for (address, value, bits) in [
        (0x03, 0x1D, 0x01),
        (0x03, 0x1E, 0x02),
        (0x05, 0x81, 0x01),
        (0x05, 0x20, 0x20),
        (0x05, 0x40, 0x40),
        (0x12, 0x02, 0x02),
        (0x12, 0x25, 0x04),
        (0x12, 0x60, 0x60),
        (0x12, 0xE0, 0xE0),
    ] {
        exchange(&mut chip, 700_000, &[address, value]);
        assert_eq!(found(&chip, Kind::UnmodelledBits(Space::A, address, bits)), 1, "{address:02X} = {value:02X}");
        assert_eq!(chip.peek(Space::A, address), value);
    }
}

#[test]
fn collision_avoidance_sees_a_field_at_any_instant_of_its_window() {
    // Collision avoidance listens for 302 µs. A foreign field appears and disappears within that time.
    for (on, off) in [(100_000, 150_000), (250_000, 290_000)] {
        let mut pair = Pair::new(exact(), exact(), clean());
        pair.start(Side::Listener);
        pair.spi(Side::Listener, &[0x02, 0x83]);
        let now = pair.now;
        pair.listener.hear(now + 1_000 + on, &AirEvent::FieldOn);
        pair.listener.hear(now + 1_000 + off, &AirEvent::FieldOff);
        pair.spi(Side::Listener, &[0xC8]);
        pair.run_for(1_000_000);
        let irqs = pair.irqs(Side::Listener);
        assert_eq!(irqs, [0, 0x1C, 0, 0], "I_eon, I_eof and I_cac, no I_apon");
        assert!(!pair.listener.field_on());
    }
    let mut pair = Pair::new(exact(), exact(), clean());
    pair.start(Side::Listener);
    pair.spi(Side::Listener, &[0x02, 0x83]);
    let now = pair.now;
    pair.listener.hear(now, &AirEvent::FieldOn);
    pair.run_for(50_000);
    pair.spi(Side::Listener, &[0xC8]);
    let now = pair.now;
    pair.listener.hear(now, &AirEvent::FieldOff);
    pair.run_for(1_000_000);
    assert_eq!(pair.irqs(Side::Listener), [0, 0x1C, 0, 0]);
    assert!(!pair.listener.field_on());
}

#[test]
fn only_a_request_for_its_own_system_code_is_answered() {
    for (asked, answered) in [
        ([0x12, 0xFC], true),
        ([0xFF, 0xFF], true),
        ([0x12, 0xFF], true),
        ([0xFF, 0xFC], true),
        ([0x12, 0xFD], false),
        ([0x88, 0xB4], false),
    ] {
        let mut pair = Pair::started(exact(), exact(), clean());
        pair.spi(Side::Listener, &[0x08, 0x50]);
        pair.spi(Side::Listener, &[0xFB, 0x28, 0x10]);
        pair.spi(Side::Listener, &[0xA8, 0x12, 0xFC, 0x01, 2, 3, 4, 5, 6, 7, 8]);
        pair.arm();
        pair.load(&[0x00, asked[0], asked[1], 0x00, 0x00]);
        pair.fire();
        pair.run_for(6_000_000);
        assert_eq!(pair.air.counters().answers, u64::from(answered), "{asked:02X?}");
        let expected = if answered { [0x28, 0, 0, 0x18] } else { [0x30, 0, 0, 0] };
        assert_eq!(pair.irqs(Side::Listener), expected);
    }
}

#[test]
fn mode_and_rate_changed_in_mid_frame_are_found_on_either_side() {
    for (write, register, lost) in [
        (&[0x03u8, 0xA4][..], 0x03, true),
        (&[0x04, 0x21], 0x04, true),
        // A write of 12 to register 04 changes only the bit rate of transmission.
        (&[0x04, 0x12], 0x04, false),
    ] {
        let mut pair = Pair::started(exact(), exact(), clean());
        pair.load(&payload(200, 1));
        pair.fire();
        pair.run_for(2_000_000);
        pair.spi(Side::Listener, write);
        pair.run_for(5_000_000);
        assert_eq!(found(&pair.listener, Kind::ChangedInFrame(register)), 1);
        assert_eq!(pair.irqs(Side::Listener)[0] & 0x10 == 0, lost, "{write:02X?}");
    }
    for write in [[0x03, 0x08], [0x04, 0x11]] {
        let mut pair = Pair::started(exact(), exact(), clean());
        pair.load(&payload(200, 1));
        pair.fire();
        pair.run_for(2_000_000);
        pair.spi(Side::Poller, &write);
        pair.run_for(5_000_000);
        assert_eq!(found(&pair.poller, Kind::ChangedInFrame(write[0])), 1);
        assert_eq!(pair.irqs(Side::Listener), [0x30, 0, 0, 0]);
    }
    // A write of the present value is no finding, nor is a change between two frames.
    let mut pair = Pair::started(exact(), exact(), clean());
    pair.load(&payload(200, 1));
    pair.fire();
    pair.run_for(2_000_000);
    pair.spi(Side::Poller, &[0x03, 0x1C, 0x22]);
    pair.run_for(5_000_000);
    pair.spi(Side::Poller, &[0x04, 0x11]);
    assert_eq!(pair.poller.reports(), []);
}

#[derive(Clone, Debug)]
enum Act {
    Spi(Side, Vec<u8>),
    Wait(u32),
    Supply(Side, bool),
}

fn act() -> impl Strategy<Value = Act> {
    let side = || prop_oneof![Just(Side::Poller), Just(Side::Listener)];
    let meaningful = prop_oneof![
        Just(vec![0xC4]),
        Just(vec![0xC5]),
        Just(vec![0xC6]),
        Just(vec![0xC2]),
        Just(vec![0xC8]),
        Just(vec![0xD0]),
        Just(vec![0xD1]),
        Just(vec![0xDB]),
        Just(vec![0x5A, 0, 0, 0, 0, 0, 0]),
        (any::<u8>(), 0u8..4).prop_map(|(l, h)| vec![0x22, h, l]),
        prop_oneof![Just(0x80u8), Just(0x88), Just(0xC3), Just(0xC8), any::<u8>()].prop_map(|v| vec![0x02, v]),
        prop_oneof![Just(0x1Cu8), Just(0x08), Just(0xA0), Just(0xE8), any::<u8>()].prop_map(|v| vec![0x03, v]),
        any::<u8>().prop_map(|v| vec![0x04, v]),
        prop::collection::vec(any::<u8>(), 1..200).prop_map(|mut v| {
            v[0] = 0x80;
            v
        }),
        (1usize..300).prop_map(|n| {
            let mut v = vec![0; n];
            v[0] = 0x9F;
            v
        }),
    ];
    prop_oneof![
        8 => (side(), meaningful).prop_map(|(s, v)| Act::Spi(s, v)),
        4 => (side(), prop::collection::vec(any::<u8>(), 0..24)).prop_map(|(s, v)| Act::Spi(s, v)),
        4 => (0u32..3_000_000).prop_map(Act::Wait),
        1 => (side(), any::<bool>()).prop_map(|(s, on)| Act::Supply(s, on)),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 200,
        failure_persistence: None,
        rng_seed: proptest::test_runner::RngSeed::Fixed(3916),
        ..ProptestConfig::default()
    })]

    #[test]
    fn no_sequence_of_bytes_panics_loops_or_goes_back_in_time(
        acts in prop::collection::vec(act(), 1..120),
        started: bool,
        seed: u64,
    ) {
        let faults = AirFaults { bit_error: 1e-3, lost: 0.1, truncated: 0.2, ..AirFaults::default() };
        let run = || {
            let air = Air::new(seed, faults);
            let config = Config { variant: Variant::St25r3916b, crystal_ppb: 20_000, ..Config::default() };
            let make = if started { Pair::started } else { Pair::new };
            let mut pair = make(config.clone(), config.clone(), air);
            let mut heard = Vec::new();
            let mut pins = [Side::Poller, Side::Listener].map(|side| {
                let chip = pair.chip(side);
                chip.take_irq_edges().for_each(drop);
                (chip.irq(), chip.irq_since())
            });
            for a in &acts {
                match a {
                    Act::Spi(side, bytes) => heard.extend(pair.spi(*side, bytes)),
                    Act::Wait(ns) => pair.run_for(u64::from(*ns)),
                    Act::Supply(side, on) => {
                        let now = pair.now;
                        if *on { pair.chip(*side).power_on(now) } else { pair.chip(*side).power_off(now) }
                    }
                }
                for (i, side) in [Side::Poller, Side::Listener].into_iter().enumerate() {
                    let (now, chip) = (pair.now, pair.chip(side));
                    for edge in chip.take_irq_edges() {
                        prop_assert!(edge.level != pins[i].0 && edge.at_ns >= pins[i].1 && edge.at_ns <= now);
                        pins[i] = (edge.level, edge.at_ns);
                    }
                    prop_assert_eq!(pins[i], (chip.irq(), chip.irq_since()));
                    heard.push(u8::from(chip.irq()));
                }
            }
            pair.run_for(50_000_000);
            let c = pair.air.counters();
            prop_assert!(c.delivered + c.damaged + c.lost <= c.sent);
            Ok((heard, c, pair.poller.reports().len(), pair.listener.reports().len()))
        };
        prop_assert_eq!(run()?, run()?);
    }
}
