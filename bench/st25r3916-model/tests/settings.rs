//! Settings that the board or the technology contradicts: supply, antenna tuning, receive chain. Each is a finding.

mod common;

use common::{Pair, Side, payload};
use st25r3916_model::{Air, AirFaults, Chip, Config, Kind, Space, Technology};

fn clean() -> Air {
    Air::new(0, AirFaults::default())
}

fn found(chip: &Chip, kind: Kind) -> u64 {
    chip.reports().iter().find(|r| r.kind == kind).map_or(0, |r| r.count)
}

#[test]
fn a_driver_can_measure_the_supply_and_choose_its_range_or_refuse_it() {
    for (vdd_mv, steps, sup3v, out_of_range) in [
        (2_000, 85, true, true),
        (3_300, 141, true, false),
        (5_000, 213, false, false),
        (5_220, 223, false, false),
        // 254 steps are 5.94 V: the converter's end, not the part's.
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
    // The field comes on with the oscillator; the receiver without adjusting the regulators.
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
    // VDD, VDD_A, VDD_D, VDD_RF, VDD_AM, and one that does not exist.
    for (mpsv, steps) in [(0, 213), (1, 128), (2, 128), (3, 128), (4, 115), (5, 0)] {
        pair.spi(Side::Poller, &[0x2C, mpsv]);
        pair.spi(Side::Poller, &[0xDF]);
        assert!(pair.wait_irq(Side::Poller, 100_000));
        pair.irqs(Side::Poller);
        assert_eq!(pair.spi(Side::Poller, &[0x65, 0])[1], steps, "mpsv {mpsv}");
    }
}

#[test]
fn the_reserved_bit_of_register_01_reads_0_and_all_others_are_kept() {
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
        // Reset values need no driver.
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
    // The order does not matter: tuned while it listens.
    let mut pair = Pair::started(Config::default(), Config::default(), clean());
    pair.spi(Side::Listener, &[0x01, 0x1C]);
    assert_eq!(found(&pair.listener, Kind::AntennaTuningOff), 0);
    pair.spi(Side::Listener, &[0x27, 0xFF]);
    assert_eq!(found(&pair.listener, Kind::AntennaTuningOff), 1);
    // It becomes a target last.
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

/// Space, address and value of a register that does not suit.
type Finding = (Space, u8, u8);

/// The listener receives a frame with these writes on top of a suitable chain; what it finds about the chain.
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
fn a_listener_with_the_reset_values_of_the_receive_chain_is_found_out() {
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
        // Flipper Zero, listener; poller.
        &[&[0x0B, 0x13, 0x2D, 0x00, 0x00], &[0xFB, 0x0C, 0x54, 0x00]],
        &[&[0x0B, 0x13], &[0xFB, 0x0C, 0x58, 0x00]],
        // ST, poller: ST25R3916; ST25R3916B.
        &[&[0x0B, 0x13, 0x3D, 0x00, 0x00], &[0xFB, 0x0C, 0x54, 0x00]],
        &[&[0x0B, 0x13, 0xFD, 0x00, 0x00], &[0xFB, 0x0C, 0x54, 0x00]],
        // Filter and mixer of a listener.
        &[&[0x0B, 0x01, 0x6D]],
    ];
    for writes in settings {
        assert_eq!(listens_with(writes, strict.clone()), (vec![], 1), "{writes:02X?}");
    }
}

#[test]
fn each_register_of_the_receive_chain_is_looked_at() {
    let cases: [(&[u8], Finding); 8] = [
        // A zero at 600 kHz; at 60 and 400 kHz; a low-pass of 300 kHz; a code that does not exist.
        (&[0x0B, 0x18], (Space::A, 0x0B, 0x18)),
        (&[0x0B, 0x10], (Space::A, 0x0B, 0x10)),
        (&[0x0B, 0x23], (Space::A, 0x0B, 0x23)),
        (&[0x0B, 0x33], (Space::A, 0x0B, 0x33)),
        // The low-frequency input; gain reduced in the second stage.
        (&[0x0D, 0x03], (Space::A, 0x0D, 0x03)),
        (&[0x0E, 0x80], (Space::A, 0x0E, 0x80)),
        (&[0xFB, 0x0C, 0x51], (Space::B, 0x0C, 0x51)),
        (&[0xFB, 0x0D, 0x01], (Space::B, 0x0D, 0x01)),
    ];
    for (write, finding) in cases {
        assert_eq!(listens_with(&[write], Config::default()), (vec![finding], 1), "{write:02X?}");
    }
    // The correlator is off.
    assert_eq!(listens_with(&[&[0x0A, 0x04], &[0xFB, 0x0C, 0x51, 0x01]], Config::default()), (vec![], 1));
}

#[test]
fn an_nfc_a_poller_is_told_of_an_nfc_f_chain_and_not_of_its_own() {
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
