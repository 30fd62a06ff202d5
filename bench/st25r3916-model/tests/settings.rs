//! Tests that unsuitable settings of supply, antenna tuning, receive chain and modulation are findings.

use crate::common;

use common::{Pair, Side, payload};
use st25r3916_model::{Air, AirFaults, Chip, Config, Kind, Space, Technology, Variant};

fn clean() -> Air {
    Air::new(0, AirFaults::default())
}

fn found(chip: &Chip, kind: Kind) -> u64 {
    chip.reports().iter().find(|r| r.kind == kind).map_or(0, |r| r.count)
}

#[test]
fn a_driver_can_measure_the_supply_and_set_its_range() {
    for (vdd_mv, steps, sup3v, out_of_range) in [
        (2_000, 85, true, true),
        (3_300, 141, true, false),
        (5_000, 213, false, false),
        (5_220, 223, false, false),
        // The A/D converter ends at 254 steps or 5.94 V, above the highest permitted supply voltage.
        (5_950, 254, false, true),
    ] {
        let config = Config { vdd_mv, ..Config::default() };
        let mut pair = Pair::new(config, Config::default(), clean());
        pair.spi(Side::Poller, &[0x02, 0x80]);
        assert!(pair.wait_irq(Side::Poller, 10_000_000), "oscillator");
        pair.irqs(Side::Poller);
        pair.spi(Side::Poller, &[0xDF]);
        let from = pair.now;
        assert!(pair.wait_irq(Side::Poller, 100_000), "measured");
        assert_eq!(pair.now - from, 25_000);
        assert_eq!(pair.irqs(Side::Poller), [0, 0x80, 0, 0], "I_dct");
        assert_eq!(pair.spi(Side::Poller, &[0x65, 0])[1], steps, "{vdd_mv} mV in steps of 23.4 mV");
        for set in [false, true] {
            let before = found(&pair.poller, Kind::SupplyMismatch);
            pair.spi(Side::Poller, &[0x01, if set { 0xBC } else { 0x3C }]);
            pair.spi(Side::Poller, &[0xD6]);
            let mismatch = found(&pair.poller, Kind::SupplyMismatch) - before;
            assert_eq!(mismatch, u64::from(set != sup3v), "sup3V {set} at {vdd_mv} mV");
        }
        assert_eq!(found(&pair.poller, Kind::SupplyOutOfRange(vdd_mv)) != 0, out_of_range, "{vdd_mv} mV");
    }
}

#[test]
fn a_supply_that_a_measurement_may_read_as_either_range_suits_both() {
    for (vdd_mv, io2, finds) in [
        (3_577, 0x3C, false),
        (3_623, 0xBC, false),
        (3_570, 0x3C, true),
        (3_630, 0xBC, true),
        (3_570, 0xBC, false),
        (3_630, 0x3C, false),
    ] {
        let mut pair = Pair::new(Config { vdd_mv, ..Config::default() }, Config::default(), clean());
        pair.spi(Side::Poller, &[0x02, 0x80]);
        pair.run_for(1_000_000);
        pair.spi(Side::Poller, &[0x01, io2]);
        pair.spi(Side::Poller, &[0xD6]);
        assert_eq!(found(&pair.poller, Kind::SupplyMismatch), u64::from(finds), "{vdd_mv} mV, 01 = {io2:02X}");
    }
}

#[test]
fn supply_and_tuning_are_looked_at_whatever_puts_the_part_to_work() {
    for operation in [[0x88, 0x88], [0x80, 0xC0]] {
        let mut pair = Pair::new(Config::default(), Config::default(), clean());
        pair.spi(Side::Poller, &[0x01, 0x9C]);
        pair.spi(Side::Poller, &[0x26, 0x00]);
        pair.spi(Side::Poller, &[0x02, operation[0]]);
        assert_eq!(pair.poller.reports(), []);
        pair.run_for(1_000_000);
        if operation[1] != operation[0] {
            assert_eq!(pair.poller.reports(), []);
            pair.spi(Side::Poller, &[0x02, operation[1]]);
        }
        assert_eq!(found(&pair.poller, Kind::SupplyMismatch), 1, "{operation:02X?}");
        assert_eq!(found(&pair.poller, Kind::AntennaTuningOff), u64::from(operation[1] == 0x88));
    }
}

#[test]
fn the_measured_supply_is_the_one_that_is_selected() {
    let mut pair = Pair::new(Config::default(), Config::default(), clean());
    pair.start(Side::Poller);
    // A case has the code of a supply (VDD, VDD_A, VDD_D, VDD_RF, VDD_AM, none) and the measured steps.
    for (mpsv, steps) in [(0, 213), (1, 128), (2, 128), (3, 128), (4, 115), (5, 0)] {
        pair.spi(Side::Poller, &[0x2C, mpsv]);
        pair.spi(Side::Poller, &[0xDF]);
        assert!(pair.wait_irq(Side::Poller, 100_000));
        pair.irqs(Side::Poller);
        assert_eq!(pair.spi(Side::Poller, &[0x65, 0])[1], steps, "mpsv {mpsv}");
    }
}

#[test]
fn only_the_reserved_bit_of_register_01_always_reads_0() {
    let mut pair = Pair::new(Config::default(), Config::default(), clean());
    pair.spi(Side::Poller, &[0x01, 0xFF]);
    assert_eq!(pair.spi(Side::Poller, &[0x41, 0]), [0, 0xFD]);
    pair.spi(Side::Poller, &[0x01, 0x01]);
    assert_eq!(pair.spi(Side::Poller, &[0x41, 0]), [0, 0x01]);
}

#[test]
fn antenna_tuning_without_aat_en_is_found_when_the_antenna_is_used() {
    for (io2, tuning, used, finds) in [
        (0x1C, 0x00, true, true),
        (0x1C, 0x00, false, false),
        (0x3C, 0x00, true, false),
        // With their reset value the tuning registers do not need aat_en.
        (0x1C, 0x80, true, false),
    ] {
        let mut pair = Pair::new(Config::default(), Config::default(), clean());
        pair.start(Side::Poller);
        pair.start(Side::Listener);
        for side in [Side::Poller, Side::Listener] {
            pair.spi(side, &[0x01, io2]);
            pair.spi(side, &[0x26, tuning, tuning]);
        }
        if used {
            pair.spi(Side::Poller, &[0x02, 0x88]);
            pair.spi(Side::Listener, &[0x03, 0xA0, 0x22]);
            pair.spi(Side::Listener, &[0x02, 0xC3]);
        }
        for side in [Side::Poller, Side::Listener] {
            assert_eq!(
                found(pair.chip(side), Kind::AntennaTuningOff) != 0,
                finds,
                "{side:?} 01 = {io2:02X} 26 = {tuning:02X}"
            );
        }
    }
    let mut pair = Pair::started(Config::default(), Config::default(), clean());
    pair.spi(Side::Listener, &[0x01, 0x1C]);
    assert_eq!(found(&pair.listener, Kind::AntennaTuningOff), 0);
    pair.spi(Side::Listener, &[0x27, 0xFF]);
    assert_eq!(found(&pair.listener, Kind::AntennaTuningOff), 1);
    let mut pair = Pair::new(Config::default(), Config::default(), clean());
    pair.start(Side::Listener);
    pair.spi(Side::Listener, &[0x01, 0x1C]);
    pair.spi(Side::Listener, &[0x26, 0x00]);
    pair.spi(Side::Listener, &[0x02, 0xC3]);
    pair.spi(Side::Listener, &[0x03, 0xA0, 0x22]);
    assert_eq!(found(&pair.listener, Kind::AntennaTuningOff), 0);
    pair.arm();
    assert_eq!(found(&pair.listener, Kind::AntennaTuningOff), 1);
}

#[test]
fn a_finding_names_register_value_and_technology() {
    let kind = Kind::ReceiveChain { technology: Technology::NfcF, space: Space::B, address: 0x0C, value: 0x93 };
    assert_eq!(kind.to_string(), "register B 0C = 93 does not suit reception of NfcF");
    assert_eq!(Kind::SupplyOutOfRange(5_950).to_string(), "supply of 5950 mV is outside 2400 to 5500 mV");
}

type Finding = (Space, u8, u8);

/// Lets the listener receive a frame after `writes` to a suitable receive chain. Returns the findings about the chain,
/// and the number of received frames.
fn listens_with(writes: &[&[u8]], config: Config) -> (Vec<Finding>, u64) {
    let mut pair = Pair::started(Config::default(), config, clean());
    for w in writes {
        pair.spi(Side::Listener, w);
    }
    pair.load(&payload(20, 1));
    pair.fire();
    pair.run_for(1_000_000);
    let mut chain = Vec::new();
    for r in pair.listener.reports() {
        match r.kind {
            Kind::ReceiveChain { technology, space, address, value } => {
                assert_eq!(technology, Technology::NfcF);
                chain.push((space, address, value));
            }
            other => panic!("{other}"),
        }
    }
    (chain, pair.listener.statistics().received)
}

#[test]
fn a_listener_with_the_receive_chain_of_a_reset_is_reported() {
    let reset: [&[u8]; 2] = [&[0x0B, 0x08, 0x2D, 0xD8, 0x00], &[0xFB, 0x0C, 0x93, 0x00]];
    let (chain, received) = listens_with(&reset, Config::default());
    assert_eq!(chain, [(Space::A, 0x0B, 0x08), (Space::A, 0x0D, 0xD8), (Space::B, 0x0C, 0x93)]);
    assert_eq!(received, 1, "on silicon some of it may get through");
    let strict = Config { unsuited_chain_receives: false, ..Config::default() };
    assert_eq!(listens_with(&reset, strict).1, 0);
}

#[test]
fn each_setting_that_a_public_driver_receives_nfc_f_with_is_accepted() {
    let strict = Config { unsuited_chain_receives: false, ..Config::default() };
    let settings: [&[&[u8]]; 5] = [
        // These are Flipper Zero's settings for a listener and for a poller.
        &[&[0x0B, 0x13, 0x2D, 0x00, 0x00], &[0xFB, 0x0C, 0x54, 0x00]],
        &[&[0x0B, 0x13], &[0xFB, 0x0C, 0x58, 0x00]],
        // These are ST's settings for a poller, on an ST25R3916 and on an ST25R3916B.
        &[&[0x0B, 0x13, 0x3D, 0x00, 0x00], &[0xFB, 0x0C, 0x54, 0x00]],
        &[&[0x0B, 0x13, 0xFD, 0x00, 0x00], &[0xFB, 0x0C, 0x54, 0x00]],
        // The filter and mixer have settings for a listener.
        &[&[0x0B, 0x01, 0x6D]],
    ];
    for writes in settings {
        assert_eq!(listens_with(writes, strict.clone()), (vec![], 1), "{writes:02X?}");
    }
}

#[test]
fn each_register_of_the_receive_chain_is_looked_at() {
    let cases: [(&[u8], Finding); 8] = [
        // The settings are a high-pass zero at 600 kHz, zeros at 60 and 400 kHz, a low-pass of 300 kHz, and an
        // undefined code.
        (&[0x0B, 0x18], (Space::A, 0x0B, 0x18)),
        (&[0x0B, 0x10], (Space::A, 0x0B, 0x10)),
        (&[0x0B, 0x23], (Space::A, 0x0B, 0x23)),
        (&[0x0B, 0x33], (Space::A, 0x0B, 0x33)),
        // 0D selects the low-frequency input, and 0E a reduced gain of the second stage.
        (&[0x0D, 0x03], (Space::A, 0x0D, 0x03)),
        (&[0x0E, 0x80], (Space::A, 0x0E, 0x80)),
        (&[0xFB, 0x0C, 0x51], (Space::B, 0x0C, 0x51)),
        (&[0xFB, 0x0D, 0x01], (Space::B, 0x0D, 0x01)),
    ];
    for (write, finding) in cases {
        assert_eq!(listens_with(&[write], Config::default()), (vec![finding], 1), "{write:02X?}");
    }
    // Settings of a correlator that is off cause no finding.
    assert_eq!(listens_with(&[&[0x0A, 0x04], &[0xFB, 0x0C, 0x51, 0x01]], Config::default()), (vec![], 1));
}

#[test]
fn an_nfc_a_poller_with_an_nfc_f_receive_chain_is_reported() {
    for (own, findings) in [(true, 0), (false, 2)] {
        let mut pair = common::nfc_a_poller(Config::default());
        if !own {
            pair.receive_nfc_f(Side::Poller);
        }
        common::nfc_a_answer(&mut pair, &[0x42, 0x00]);
        assert_eq!(pair.poller.statistics().received, 1);
        assert_eq!(pair.poller.reports().len(), findings, "{:?}", pair.poller.reports());
    }
}

fn strict(config: Config) -> Config {
    Config { unsuited_chain_receives: false, unsuited_modulation_reaches: false, ..config }
}

fn strict_pair(config: &Config) -> Pair {
    let mut pair = Pair::started(strict(config.clone()), strict(config.clone()), clean());
    let [a, b] = config.tuning[1];
    pair.spi(Side::Listener, &[0x26, a, b]);
    pair
}

fn arrives(pair: &mut Pair) -> bool {
    let before = pair.listener.statistics().received;
    pair.arm();
    pair.load(&payload(20, 1));
    pair.fire();
    pair.run_for(1_000_000);
    pair.irqs(Side::Poller);
    pair.irqs(Side::Listener);
    pair.listener.statistics().received > before
}

const BOTH: fn() -> [Config; 2] = || [Config::default(), Config::st25r3916()];

#[test]
fn a_poller_that_cannot_modulate_nfc_f_is_not_heard() {
    let b = Variant::St25r3916b;
    // A case has the chip's variant, the write, and the register that the write makes unsuitable.
    type Written = (Space, u8, u8);
    let cases: [(Variant, &[u8], Written); 9] = [
        (b, &[0x03, 0x18], (Space::A, 0x03, 0x18)),
        (b, &[0x28, 0x00], (Space::A, 0x28, 0x00)),
        (b, &[0x28, 0xC0], (Space::A, 0x28, 0xC0)),
        (b, &[0x28, 0x4F], (Space::A, 0x28, 0x4F)),
        // These writes lead to undocumented combinations of dis_reg_am and act_amsink.
        (b, &[0xFB, 0x28, 0x04], (Space::B, 0x28, 0x04)),
        (b, &[0x01, 0x3D], (Space::B, 0x28, 0x84)),
        (b, &[0xFB, 0x2E, 0x01], (Space::B, 0x2E, 0x01)),
        (Variant::St25r3916, &[0x28, 0x00], (Space::A, 0x28, 0x00)),
        (Variant::St25r3916, &[0x28, 0xF0], (Space::A, 0x28, 0xF0)),
    ];
    for (variant, write, (space, address, value)) in cases {
        let config = if variant == b { Config::default() } else { Config::st25r3916() };
        let kind = Kind::Modulation { space, address, value };
        for reaches in [true, false] {
            let mut pair = strict_pair(&Config { unsuited_modulation_reaches: reaches, ..config.clone() });
            assert!(arrives(&mut pair), "as it is set up");
            if reaches {
                pair = Pair::started(config.clone(), config.clone(), clean());
            }
            pair.spi(Side::Poller, write);
            assert_eq!(arrives(&mut pair), reaches, "{write:02X?}");
            assert_eq!(found(&pair.poller, kind), 1, "{write:02X?}: {:?}", pair.poller.reports());
        }
    }
    assert_eq!(
        Kind::Modulation { space: Space::B, address: 0x28, value: 0x04 }.to_string(),
        "register B 28 = 04 does not suit modulation in NFC-F"
    );
}

#[test]
fn a_b_that_leaves_its_am_mode_at_reset_is_found_out() {
    let mut pair = Pair::new(Config::default(), Config::default(), clean());
    pair.start(Side::Poller);
    for write in [&[0x03, 0x1C, 0x22][..], &[0x28, 0x40], &[0x16, 0x77], &[0x02, 0x88]] {
        pair.spi(Side::Poller, write);
    }
    pair.load(&payload(20, 1));
    pair.fire();
    pair.run_for(1_000_000);
    let registers: Vec<_> = pair.poller.reports().iter().map(|report| report.kind).collect();
    let of = |address, value| Kind::Modulation { space: Space::B, address, value };
    assert_eq!(registers, [of(0x28, 0x10), of(0x2E, 0x00)]);
}

#[test]
fn an_antenna_out_of_tune_neither_sends_nor_hears() {
    for config in BOTH() {
        for (role, side) in [Side::Poller, Side::Listener].into_iter().enumerate() {
            for register in 0..2 {
                let wanted = config.tuning[role][register];
                for (off, reaches) in [(0x20, true), (0x21, false), (0x80, false)] {
                    let mut pair = strict_pair(&config);
                    pair.spi(
                        side,
                        &[0x26 + register as u8, wanted.checked_add(off).unwrap_or(wanted.wrapping_sub(off))],
                    );
                    assert_eq!(arrives(&mut pair), reaches, "{side:?}, {register}, {off:02X}");
                }
            }
            let mut pair = strict_pair(&config);
            pair.spi(side, &[0x01, 0x1C]);
            assert!(!arrives(&mut pair), "{side:?} without aat_en");
        }
    }
}

#[test]
fn a_field_detector_without_hysteresis_is_a_finding() {
    for (on, off, finds) in [(0x13, 0x02, 0), (0x11, 0x00, 0), (0x00, 0x00, 1), (0x13, 0x12, 1), (0x13, 0x20, 1)] {
        let mut pair = Pair::started(Config::default(), Config::default(), clean());
        pair.spi(Side::Listener, &[0x2A, on, off]);
        pair.arm();
        assert_eq!(found(&pair.listener, Kind::FieldWithoutHysteresis(on, off)), finds, "{on:02X} {off:02X}");
    }
}

#[test]
fn the_field_detector_has_hysteresis() {
    // The field has 350 mV at the detector, whose threshold trg selects.
    for (trg, seen) in [(1, true), (4, true), (5, false), (7, false)] {
        let mut pair = Pair::new(Config::default(), Config::default(), clean());
        pair.start_listener();
        pair.spi(Side::Listener, &[0x2A, trg << 4, 0x00]);
        pair.start_poller();
        assert_eq!(pair.wait_irq(Side::Listener, 1_000_000), seen, "{trg}");
    }
    let mut pair = strict_pair(&Config::default());
    pair.spi(Side::Listener, &[0x2A, 0x73]);
    assert!(arrives(&mut pair), "it is there already");
    pair.spi(Side::Listener, &[0x2B, 0x62]);
    pair.run_for(100_000);
    assert_eq!(pair.irqs(Side::Listener)[1], 0x08, "I_eof");
    assert!(!arrives(&mut pair));
}

#[test]
fn a_bit_that_flips_takes_effect_without_a_finding() {
    for config in BOTH() {
        let mut pair = strict_pair(&config);
        for (side, space, address, bit) in [
            (Side::Listener, Space::A, 0x0B, 3),
            (Side::Listener, Space::B, 0x0C, 6),
            (Side::Listener, Space::A, 0x02, 6),
            (Side::Listener, Space::A, 0x03, 5),
            (Side::Listener, Space::A, 0x04, 0),
            (Side::Listener, Space::A, 0x26, 7),
            // The flip changes the modulation depth from 12 % to 40 % on the ST25R3916 and to 50 % on the ST25R3916B.
            (Side::Poller, Space::A, 0x28, 7),
            (Side::Poller, Space::A, 0x27, 6),
            (Side::Poller, Space::A, 0x02, 3),
            (Side::Poller, Space::A, 0x04, 4),
            (Side::Poller, Space::A, 0x01, 5),
        ] {
            assert!(arrives(&mut pair), "before {side:?} {address:02X}.{bit}");
            pair.chip(side).flip(space, address, bit);
            pair.run_for(100_000);
            assert!(!arrives(&mut pair), "{side:?} {address:02X}.{bit}");
            pair.chip(side).flip(space, address, bit);
            pair.run_for(1_000_000);
            pair.irqs(Side::Listener);
        }
        assert!(arrives(&mut pair));
    }
}

#[test]
fn a_mask_or_an_interrupt_that_flips_moves_the_pin() {
    let mut pair = Pair::started(Config::default(), Config::default(), clean());
    assert!(!pair.listener.irq());
    pair.listener.flip(Space::A, 0x1A, 5);
    assert!(pair.listener.irq(), "I_rxs");
    pair.listener.flip(Space::A, 0x16, 5);
    assert!(!pair.listener.irq(), "masked");
    pair.listener.flip(Space::A, 0x16, 5);
    pair.listener.flip(Space::A, 0x1A, 5);
    assert!(!pair.listener.irq());
    // These bits cannot be flipped: bits of a result register, of a missing register, a reserved bit, and any bit of a
    // chip without supply.
    for (space, address, bit) in [(Space::A, 0x3F, 0), (Space::A, 0x30, 0), (Space::B, 0x01, 0), (Space::A, 0x19, 2)] {
        assert_eq!(pair.listener.flippable(space, address) >> bit & 1, 0);
        let before = pair.listener.peek(space, address);
        pair.listener.flip(space, address, bit);
        assert_eq!(pair.listener.peek(space, address), before, "{address:02X}");
    }
    pair.listener.power_off(pair.now);
    pair.listener.flip(Space::A, 0x0B, 0);
    pair.listener.power_on(pair.now);
    assert_eq!(pair.listener.peek(Space::A, 0x0B), 0x08);
    assert_eq!(pair.poller.reports(), []);
}
