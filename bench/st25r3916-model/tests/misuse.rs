//! What a careless controller does: reported, never silently right, never a panic.

mod common;

use common::{Pair, Side, payload};
use proptest::prelude::*;
use st25r3916_model::{Air, Chip, Config, Faults, Kind, Space, Variant};

fn exchange(chip: &mut Chip, now: u64, mosi: &[u8]) -> Vec<u8> {
    chip.select(now);
    let miso = mosi.iter().map(|&b| chip.transfer(now, b)).collect();
    chip.deselect(now);
    miso
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
    let mut pair = Pair::new(Config::default(), Config::default(), Air::new(0, Faults::default()));
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
    let mut pair = Pair::new(Config::default(), Config::default(), Air::new(0, Faults::default()));
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
fn interrupts_set_behind_a_mask_move_the_pin_when_unmasked_and_are_cleared_by_what_was_read() {
    let mut chip = Chip::new(Config::default());
    exchange(&mut chip, 0, &[0x16, 0xFF]);
    exchange(&mut chip, 0, &[0x02, 0x80]);
    chip.advance(800_000);
    assert!(!chip.irq());
    exchange(&mut chip, 800_000, &[0x16, 0x00]);
    assert!(chip.irq());
    assert_eq!(exchange(&mut chip, 800_000, &[0x5A, 0]), [0, 0x80]);
    assert!(!chip.irq());
    // A bit that is set between the latching and the end of the read survives.
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
        let mut pair = Pair::started(poller, Config::default(), Air::new(0, Faults::default()));
        pair.load(&payload(10, 0));
        pair.fire();
        assert_eq!(pair.wait_irq(Side::Poller, 2_000_000), raises);
        assert_eq!(pair.air.counters().delivered, 1);
    }
}

#[test]
fn no_response_and_wake_up_timers_run_as_set() {
    let mut pair = Pair::started(Config::default(), Config::default(), Air::new(0, Faults::default()));
    pair.spi(Side::Poller, &[0x02, 0xC8]);
    pair.spi(Side::Poller, &[0x16, 0xFF, 0xBF, 0xF7, 0xFF]);
    pair.spi(Side::Poller, &[0x10, 0x00, 0x64]);
    pair.load(&payload(10, 0));
    pair.fire();
    assert!(pair.wait_irq(Side::Poller, 5_000_000));
    let end = pair.air.last_frame().expect("sent").end_ns;
    // 100 steps of 64 carrier cycles.
    assert_eq!(pair.now - end, 471_976 + pair.poller.config().no_response_extra_ns);
    assert_eq!(pair.irqs(Side::Poller)[1], 0x40);
    pair.spi(Side::Poller, &[0x32, 0x88]);
    pair.spi(Side::Poller, &[0xE1]);
    let from = pair.now;
    assert!(pair.wait_irq(Side::Poller, 20_000_000));
    assert_eq!((pair.now - from, pair.irqs(Side::Poller)[2]), (10_000_000, 0x08));
}

/// One thing a controller, a field or a supply does.
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
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, rng_seed: proptest::test_runner::RngSeed::Fixed(3916), ..ProptestConfig::default() })]

    #[test]
    fn no_sequence_of_bytes_panics_loops_or_goes_back_in_time(acts in prop::collection::vec(act(), 1..120), started: bool, seed: u64) {
        let faults = Faults { bit_error: 1e-3, lost: 0.1, truncated: 0.2 };
        let run = || {
            let air = Air::new(seed, faults);
            let config = Config { variant: Variant::St25r3916b, crystal_ppb: 20_000, ..Config::default() };
            let mut pair = if started { Pair::started(config.clone(), config.clone(), air) } else { Pair::new(config.clone(), config.clone(), air) };
            let mut heard = Vec::new();
            for a in &acts {
                match a {
                    Act::Spi(side, bytes) => heard.extend(pair.spi(*side, bytes)),
                    Act::Wait(ns) => pair.run_for(u64::from(*ns)),
                    Act::Supply(side, on) => {
                        let now = pair.now;
                        if *on { pair.chip(*side).power_on(now) } else { pair.chip(*side).power_off(now) }
                    }
                }
                heard.push(u8::from(pair.poller.irq()) | u8::from(pair.listener.irq()) << 1);
            }
            pair.run_for(50_000_000);
            let c = pair.air.counters();
            prop_assert!(c.delivered + c.damaged + c.lost <= c.sent);
            Ok((heard, c, pair.poller.reports().len(), pair.listener.reports().len()))
        };
        prop_assert_eq!(run()?, run()?);
    }
}
