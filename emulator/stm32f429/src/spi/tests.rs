//! Tests of frames, flags, requests and pins.

use emulator_part::Pin;

use super::*;
use crate::rig::Rig;

const CR1: u32 = 0x00;
const CR2: u32 = 0x04;
const SR: u32 = 0x08;
const DR: u32 = 0x0C;
/// Mode 1, master, PCLK / 8, slave select by software.
const MASTER: u32 = CPHA | MSTR | 2 << 3 | SSM | SSI;

fn rig() -> Rig<Spi> {
    let mut rig = Rig::new(Spi::new(1));
    rig.change_clocks(|clocks| clocks.pclk2 = 2);
    rig.connect(Signal::Spi(1, SpiPin::Sck), 0, 5);
    rig.connect(Signal::Spi(1, SpiPin::Miso), 0, 6);
    rig.connect(Signal::Spi(1, SpiPin::Mosi), 0, 7);
    rig
}

#[test]
fn a_byte_and_its_answer_take_eight_sck_periods() {
    let mut rig = rig();
    rig.write(CR1, MASTER | SPE);
    rig.lines.spi_answers.push_back(0xA5);
    rig.run(101);
    rig.write(DR, 0x3C);
    assert_eq!(rig.read(SR), TXE | BSY);
    // The frame begins at the next PCLK edge, which is cycle 102. A bit takes 8 PCLK cycles of 2 core cycles.
    rig.run(102 + 127);
    assert_eq!(rig.read(SR), TXE | BSY);
    rig.run(102 + 128);
    assert_eq!(rig.read(SR), TXE | RXNE);
    assert_eq!(rig.read(DR), 0xA5);
    assert_eq!(rig.read(SR), TXE);
    let frame = rig.lines.spi[0];
    assert_eq!((frame.data, frame.bits, frame.mode), (0x3C, 8, SpiMode::Mode1));
    assert_eq!((frame.begins, frame.ends, frame.miso), (102, 230, Some(Pin::new(0, 6))));
}

#[test]
fn a_second_byte_follows_the_first_without_a_gap() {
    let mut rig = rig();
    rig.write(CR1, MASTER | SPE);
    rig.write(DR, 1);
    rig.write(DR, 2);
    assert_eq!(rig.read(SR), BSY);
    rig.run(128);
    assert_eq!(rig.read(SR), TXE | BSY | RXNE);
    rig.run(256);
    assert_eq!(rig.lines.spi[1].begins, 128);
    assert_eq!(rig.lines.spi[1].ends, 256);
    assert_eq!(rig.read(SR) & BSY, 0);
}

#[test]
fn an_unread_byte_stays_and_the_next_one_is_lost() {
    let mut rig = rig();
    rig.write(CR1, MASTER | SPE);
    rig.lines.spi_answers.extend([0x11, 0x22]);
    rig.write(DR, 1);
    rig.write(DR, 2);
    rig.run(256);
    assert_eq!(rig.read(SR), TXE | RXNE | OVR);
    assert_eq!(rig.read(DR), 0x11);
    assert_eq!(rig.read(SR), TXE | OVR);
    assert_eq!(rig.read(SR), TXE);
}

#[test]
fn a_byte_waits_in_the_data_register_until_spe_is_set() {
    let mut rig = rig();
    rig.write(CR1, MASTER);
    rig.write(DR, 0x55);
    rig.run(10_000);
    assert!(rig.lines.spi.is_empty());
    assert_eq!(rig.read(SR), 0);
    rig.write(CR1, MASTER | SPE);
    rig.run(20_000);
    assert_eq!(rig.lines.spi[0].begins, 10_000);
}

#[test]
fn a_master_with_slave_select_low_loses_its_mode() {
    let mut rig = rig();
    rig.write(CR1, (MASTER | SPE) & !SSI);
    assert_eq!(rig.read(CR1) & (MSTR | SPE), 0);
    rig.write(DR, 1);
    rig.run(1000);
    assert!(rig.lines.spi.is_empty());
    assert_ne!(rig.read(SR) & MODF, 0);
    rig.write(CR1, MASTER);
    assert_eq!(rig.read(SR) & MODF, 0);
    rig.write(CR1, MASTER | SPE);
    assert_eq!(rig.read(CR1) & (MSTR | SPE), MSTR | SPE);
}

#[test]
fn dma_requests_need_their_enable_bits() {
    let mut rig = rig();
    rig.write(CR1, MASTER | SPE);
    assert_eq!(rig.instance.dma(), 0);
    rig.write(CR2, TXDMAEN);
    assert_eq!(rig.instance.dma(), 2);
    rig.write(DR, 1);
    rig.write(DR, 1);
    assert_eq!(rig.instance.dma(), 0);
    rig.run(128);
    assert_eq!(rig.instance.dma(), 2, "no request for what came in");
    rig.write(CR2, RXDMAEN);
    assert_eq!(rig.instance.dma(), 1);
    rig.read(DR);
    assert_eq!(rig.instance.dma(), 0);
}

#[test]
fn lsbfirst_reverses_the_bits_of_a_byte_on_the_wire() {
    let mut rig = rig();
    rig.write(CR1, MASTER | SPE | LSBFIRST);
    rig.lines.spi_answers.push_back(0x01);
    rig.write(DR, 0x0F);
    rig.run(200);
    assert_eq!(rig.lines.spi[0].data, 0xF0);
    assert_eq!(rig.read(DR), 0x80);
}

#[test]
fn an_undriven_pin_reads_as_its_level_in_every_bit() {
    let mut rig = rig();
    rig.write(CR1, MASTER | SPE | DFF);
    rig.pads.levels[0] = 1 << 6;
    rig.write(DR, 0);
    rig.run(300);
    assert_eq!(rig.read(DR), 0xFFFF);
}

#[test]
fn a_receiver_only_clocks_until_it_is_disabled_and_drives_no_mosi() {
    let mut rig = rig();
    rig.write(CR1, MASTER | SPE | RXONLY);
    rig.run(300);
    assert_eq!(rig.lines.spi.len(), 2);
    assert_eq!(rig.lines.spi[0].mosi, [None; 2]);
    rig.write(CR1, MASTER | RXONLY);
    rig.run(10_000);
    assert_eq!(rig.lines.spi.len(), 3, "the frame under way ends");
    assert!(!rig.found("lost"));
}

#[test]
fn the_crc_follows_the_last_byte_and_is_checked_on_reception() {
    let mut rig = rig();
    rig.write(0x10, 0x07);
    rig.write(CR1, MASTER | CRCEN);
    rig.write(CR1, MASTER | CRCEN | SPE);
    // The byte 0x31 has the CRC-8 0x97, so 0x96 is a wrong CRC.
    rig.lines.spi_answers.extend([0x31, 0x96]);
    rig.write(DR, 0x31);
    rig.write(CR1, MASTER | CRCEN | SPE | CRCNEXT);
    rig.run(128);
    rig.read(DR);
    rig.run(1000);
    assert_eq!(rig.lines.spi.len(), 2);
    assert_eq!(rig.lines.spi[1].data, 0x97);
    assert_ne!(rig.read(SR) & CRCERR, 0);
    rig.write(SR, 0);
    assert_eq!(rig.read(SR) & CRCERR, 0);
}

#[test]
fn changing_the_phase_under_a_frame_is_found() {
    let mut rig = rig();
    rig.write(CR1, MASTER | SPE);
    rig.write(DR, 1);
    rig.write(CR1, MASTER | SPE);
    assert!(!rig.found("CR1 changed"));
    rig.write(CR1, (MASTER | SPE) & !CPHA);
    assert!(rig.found("CR1 changed"));
}
