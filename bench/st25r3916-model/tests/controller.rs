//! Tests the chip's reactions to a controller's chip select, clock and frames.

use crate::common;

use common::{Pair, Side, payload};
use st25r3916_model::{Air, AirFaults, Chip, Config, Kind, SpiFrame, SpiMode};

fn found(chip: &Chip, kind: Kind) -> u64 {
    chip.reports().iter().find(|report| report.kind == kind).map_or(0, |report| report.count)
}

/// Clocks a frame of `bits` bits at 8 MHz from `begins_ns` on. Returns the whole bytes (end, MOSI, MISO), and the bits
/// that the controller read.
fn clock(chip: &mut Chip, begins_ns: u64, mode: SpiMode, bits: u8, mosi: u32) -> (Vec<(u64, u8, u8)>, u32) {
    let frame = SpiFrame { begins_ns, ends_ns: begins_ns + 125 * u64::from(bits), mode, bits, mosi };
    let mut crossed = vec![];
    let miso = chip.clock_frame(&frame, |_, at, mosi, miso| crossed.push((at, mosi, miso)));
    (crossed, miso)
}

#[test]
fn it_knows_whether_it_is_selected() {
    let mut chip = Chip::new(Config::default());
    assert!(!chip.is_selected());
    chip.select(10);
    assert!(chip.is_selected());
    chip.deselect(20);
    assert!(!chip.is_selected());
    chip.select(30);
    chip.power_off(40);
    assert!(!chip.is_selected(), "without supply nothing is");
}

#[test]
fn it_tells_when_chip_select_rose_after_a_command_to_transmit() {
    let mut pair = Pair::started(Config::default(), Config::default(), Air::new(1, AirFaults::default()));
    pair.load(&payload(20, 1));
    assert_eq!(pair.poller.take_transmits(), []);
    pair.fire();
    let first = pair.now;
    // The transfer has two commands, DA (clear) and C4 (transmit). The second is refused during a transmission.
    pair.run_for(10_000);
    pair.spi(Side::Poller, &[0xDA, 0xC4]);
    let second = pair.now;
    assert_eq!(pair.poller.take_transmits(), [first, second]);
    assert_eq!(found(&pair.poller, Kind::TransmitWhileBusy), 1);
    // The byte C4 is no command if it is a register's value or a FIFO byte.
    pair.spi(Side::Poller, &[0x13, 0xC4, 0xC4]);
    pair.spi(Side::Poller, &[0x80, 0xC4, 0xC4]);
    pair.spi(Side::Poller, &[0xDB]);
    pair.spi(Side::Poller, &[0xD6]);
    assert_eq!(pair.poller.take_transmits(), []);
}

#[test]
fn it_tells_of_a_change_of_the_irq_pin_once() {
    let mut chip = Chip::new(Config::default());
    assert_eq!([chip.take_irq_change(), chip.take_irq_change()], [Some(false), None]);
    chip.select(0);
    chip.transfer(1_000, 0x02);
    chip.transfer(2_000, 0x80);
    chip.deselect(2_000);
    assert_eq!(chip.take_irq_change(), None);
    chip.advance(702_000);
    assert_eq!([chip.take_irq_change(), chip.take_irq_change()], [Some(true), None]);
    chip.select(703_000);
    chip.transfer(704_000, 0x5A);
    assert_eq!(chip.take_irq_change(), None);
    chip.transfer(705_000, 0);
    assert_eq!([chip.take_irq_change(), chip.take_irq_change()], [Some(false), None]);
}

#[test]
fn a_frame_of_whole_bytes_in_mode_1_is_its_bytes() {
    let mut chip = Chip::new(Config::default());
    chip.select(0);
    assert_eq!(clock(&mut chip, 1_000, SpiMode::Mode1, 8, 0x7F), (vec![(2_000, 0x7F, 0)], 0));
    assert_eq!(clock(&mut chip, 2_000, SpiMode::Mode1, 8, 0), (vec![(3_000, 0, 0x31)], 0x31));
    chip.deselect(3_000);
    chip.select(4_000);
    // The controller clocks the mode byte 7F and the value in one frame of 16 bits.
    let crossed = vec![(6_000, 0x7F, 0), (7_000, 0, 0x31)];
    assert_eq!(clock(&mut chip, 5_000, SpiMode::Mode1, 16, 0x7F00), (crossed, 0x0031));
    chip.deselect(7_000);
    assert_eq!(chip.reports(), []);
}

#[test]
fn a_clock_of_another_phase_shifts_the_bytes_by_a_bit() {
    for mode in [SpiMode::Mode0, SpiMode::Mode2] {
        let mut chip = Chip::new(Config::default());
        chip.select(0);
        // The controller reads MISO one bit late.
        let read = [0x7F, 0, 0].map(|mosi| clock(&mut chip, 1_000, mode, 8, mosi).1);
        assert_eq!(read, [0, 0x31 >> 1, 0x80], "{mode:?}");
        assert_eq!(found(&chip, Kind::WrongSpiMode(mode as u8)), 3);
    }
    let mut chip = Chip::new(Config::default());
    chip.select(0);
    let taken = [0x7F, 0x01, 0xFF].map(|mosi| clock(&mut chip, 1_000, SpiMode::Mode3, 8, mosi).0[0].1);
    assert_eq!(taken, [0x3F, 0x80, 0xFF]);
    assert_eq!(found(&chip, Kind::WrongSpiMode(3)), 3);
}

#[test]
fn bits_that_make_no_whole_byte_are_lost() {
    let mut chip = Chip::new(Config::default());
    chip.select(0);
    let (crossed, read) = clock(&mut chip, 1_000, SpiMode::Mode1, 8, 0x7F);
    assert_eq!((crossed.len(), read), (1, 0));
    let (crossed, read) = clock(&mut chip, 2_000, SpiMode::Mode1, 11, 0);
    assert_eq!((crossed, read), (vec![(3_000, 0, 0x31)], 0x31 << 3));
    assert_eq!(found(&chip, Kind::BitsLost(3)), 1);
    assert_eq!(chip.now(), 2_000 + 11 * 125);
}

#[test]
fn frames_tell_the_clock_to_a_hundredth() {
    let frame = |ns| SpiFrame { begins_ns: 0, ends_ns: ns, mode: SpiMode::Mode1, bits: 8, mosi: 0 };
    let mut chip = Chip::new(Config::default());
    // 8 bits in 793 ns are 10.09 MHz, within one percent of the permitted 10 MHz. In 792 ns they are 10.101 MHz, which
    // is a finding.
    for (ns, told) in [(800, None), (793, None), (792, Some(10_101_010)), (444, Some(18_018_018)), (1_000, None)] {
        let before = chip.reports().len();
        chip.select(0);
        chip.clock_frame(&frame(ns), |_, _, _, _| {});
        chip.deselect(0);
        // The chip checks the clock rate only at the next transfer.
        chip.select(0);
        chip.deselect(0);
        let new: Vec<Kind> = chip.reports()[before..].iter().map(|report| report.kind).collect();
        let expected: Vec<Kind> = told.map(Kind::SpiTooFast).into_iter().collect();
        let new: Vec<Kind> = new.into_iter().filter(|kind| matches!(kind, Kind::SpiTooFast(_))).collect();
        assert_eq!(new, expected, "8 bits in {ns} ns");
    }
}
