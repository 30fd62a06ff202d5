//! Tests the exact instants of the IRQ pin's edges, and the scatter of the start of transmission.

use crate::common;

use common::{Pair, exact, payload};
use st25r3916_model::{Air, AirFaults, Chip, Config, IrqEdge};

/// Returns a chip with I_osc pending and its IRQ pin high. Its oscillator became stable at about 700 µs.
fn with_irq(hz: u32) -> Chip {
    let mut chip = Chip::new(exact());
    chip.spi_clock_hz(hz);
    chip.select(0);
    chip.transfer(1_000, 0x02);
    chip.transfer(2_000, 0x80);
    chip.deselect(2_000);
    chip.advance(710_000);
    assert!(chip.irq());
    chip
}

#[test]
fn the_irq_pin_falls_at_the_first_edge_of_the_byte_read() {
    // The IRQ pin falls 31 ns after the first rising edge of a byte, which is eight clock periods before the byte's
    // end.
    for (hz, before_end) in [(10_000_000, 769), (8_000_000, 969), (1_000_000, 7_969)] {
        let mut chip = with_irq(hz);
        chip.select(720_000);
        chip.transfer(730_000, 0x5A);
        chip.transfer(740_000, 0x00);
        chip.transfer(750_000, 0x00);
        chip.deselect(751_000);
        assert!(!chip.irq());
        let fall = 740_000 - before_end;
        assert_eq!(chip.irq_since(), fall, "{hz} Hz");
        let edges: Vec<IrqEdge> = chip.take_irq_edges().collect();
        assert_eq!(edges, [IrqEdge { at_ns: 702_000, level: true }, IrqEdge { at_ns: fall, level: false }]);
        assert_eq!(chip.take_irq_edges().count(), 0);
    }
}

#[test]
fn a_clock_that_was_not_told_counts_as_the_fastest() {
    let mut chip = with_irq(0);
    chip.select(720_000);
    chip.transfer(730_000, 0x5A);
    chip.transfer(740_000, 0x00);
    assert_eq!(chip.irq_since(), 740_000 - 769);
}

#[test]
fn the_pin_never_falls_before_the_byte_that_was_read() {
    let mut chip = with_irq(1_000_000);
    chip.select(720_000);
    chip.transfer(730_000, 0x5A);
    chip.transfer(730_500, 0x00);
    assert_eq!(chip.irq_since(), 730_000);
}

#[test]
fn an_interrupt_within_the_byte_that_clears_another_makes_a_pulse() {
    // The controller reads I_osc in the byte that ends at 807.2 µs. The no-response timer expires in the middle of that
    // byte.
    let config = Config { no_response_extra_ns: 0, ..exact() };
    let mut chip = Chip::new(config);
    chip.spi_clock_hz(8_000_000);
    chip.select(0);
    chip.transfer(1_000, 0x02);
    chip.transfer(2_000, 0x80);
    chip.deselect(2_000);
    chip.advance(800_000);
    chip.select(800_000);
    for b in [0x10, 0x00, 0x01] {
        chip.transfer(801_000, b);
    }
    chip.deselect(801_000);
    chip.select(801_000);
    chip.transfer(802_000, 0xE3);
    chip.deselect(802_000);
    // The no-response timer takes 64 carrier cycles, 4.720 us.
    chip.select(804_000);
    chip.transfer(805_000, 0x5A);
    chip.advance(806_720);
    assert!(chip.irq());
    chip.transfer(807_200, 0x00);
    let edges: Vec<(u64, bool)> = chip.take_irq_edges().map(|e| (e.at_ns, e.level)).collect();
    assert_eq!(edges, [(702_000, true), (807_200 - 969, false), (806_720, true)]);
    assert!(chip.irq());
    assert_eq!(chip.irq_since(), 806_720);
}

#[test]
fn the_pin_stays_high_when_an_earlier_interrupt_is_left() {
    let mut chip = with_irq(10_000_000);
    // Register 1B has a second pending interrupt: I_dct, after Adjust regulators (D6).
    chip.select(711_000);
    chip.transfer(712_000, 0xD6);
    chip.deselect(712_000);
    chip.advance(5_000_000);
    chip.select(5_000_000);
    chip.transfer(5_001_000, 0x5A);
    chip.transfer(5_002_000, 0x00);
    assert!(chip.irq());
    chip.transfer(5_003_000, 0x00);
    assert!(!chip.irq());
    assert_eq!(chip.irq_since(), 5_003_000 - 769);
}

#[test]
fn every_way_to_move_the_pin_leaves_an_edge() {
    let mut chip = with_irq(10_000_000);
    let mut now = 720_000;
    let mut exchange = |chip: &mut Chip, bytes: &[u8]| {
        chip.select(now);
        for b in bytes {
            now += 1_000;
            chip.transfer(now, *b);
        }
        chip.deselect(now);
        now
    };
    let mut expected = vec![(702_000, true)];
    expected.push((exchange(&mut chip, &[0x16, 0xFF]), false));
    expected.push((exchange(&mut chip, &[0x16, 0x00]), true));
    expected.push((exchange(&mut chip, &[0xDB]), false));
    let end = exchange(&mut chip, &[0xD6]);
    chip.advance(end + 4_000_000);
    expected.push((end + 3_000_000, true));
    chip.power_off(end + 5_000_000);
    expected.push((end + 5_000_000, false));
    assert_eq!(chip.take_irq_edges().map(|e| (e.at_ns, e.level)).collect::<Vec<_>>(), expected);
}

#[test]
fn edges_that_nobody_takes_do_not_pile_up() {
    let mut chip = with_irq(10_000_000);
    let mut now = 720_000;
    for mask in [0xFF, 0x00].iter().cycle().take(1_000) {
        chip.select(now);
        chip.transfer(now + 1_000, 0x16);
        chip.transfer(now + 2_000, *mask);
        chip.deselect(now + 2_000);
        now += 3_000;
    }
    let edges: Vec<IrqEdge> = chip.take_irq_edges().collect();
    assert_eq!(edges.len(), 64);
    assert_eq!(edges.last(), Some(&IrqEdge { at_ns: now - 1_000, level: true }));
    assert!(edges.windows(2).all(|w| w[0].at_ns < w[1].at_ns && w[0].level != w[1].level));
}

fn starts(config: Config, frames: u64) -> Vec<u64> {
    let mut pair = Pair::started(config, exact(), Air::new(0, AirFaults::default()));
    (0..frames)
        .map(|i| {
            pair.load(&payload(4, i));
            pair.fire();
            let fired = pair.now;
            pair.run_for(1_000_000);
            pair.air.last_frame().expect("sent").start_ns - fired
        })
        .collect()
}

#[test]
fn the_start_of_transmission_scatters_over_what_is_set_around_its_mean() {
    for (scatter, mean) in [(2_300, 3_650), (100, 3_650), (2_300, 5_000)] {
        let config = Config { transmit_scatter_ns: scatter, transmit_latency_ns: mean, ..Config::default() };
        let seen = starts(config, 500);
        let (least, most) = (*seen.iter().min().expect("some"), *seen.iter().max().expect("some"));
        assert!(least >= mean - scatter / 2 && most <= mean + scatter / 2, "{least} to {most}");
        assert!(most - least > scatter * 95 / 100, "{least} to {most}");
        let average = seen.iter().sum::<u64>() / 500;
        assert!(average.abs_diff(mean) < scatter / 20, "{average}");
        // A uniform scatter has a quarter of the frames in each quarter of the range.
        let quarter = seen.iter().filter(|s| **s < mean - scatter / 4).count();
        assert!((90..=160).contains(&quarter), "{quarter} of 500 in the first quarter");
    }
}

#[test]
fn the_same_seed_scatters_the_same_and_another_does_not() {
    let run = |seed| starts(Config { seed, ..Config::default() }, 50);
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
}

#[test]
fn a_copy_of_a_chip_scatters_as_the_chip_does() {
    let mut pair = Pair::started(Config::default(), exact(), Air::new(0, AirFaults::default()));
    pair.load(&payload(4, 0));
    let mut copy = pair.poller.clone();
    pair.fire();
    let now = pair.now;
    copy.select(now - 1_000);
    copy.transfer(now, 0xC4);
    copy.deselect(now);
    assert_eq!(copy.next_event(), pair.poller.next_event());
}

#[test]
fn a_transmit_scatter_wider_than_the_latency_is_limited() {
    assert_eq!(starts(exact(), 3), [3_650; 3]);
    let wide = Config { transmit_latency_ns: 500, transmit_scatter_ns: 10_000, ..Config::default() };
    assert!(starts(wide, 50).iter().all(|s| *s <= 1_000));
}
