//! Tests of frames in loopback.

use super::*;
use crate::rig::Rig;

/// Returns a controller in loopback at 16 cycles a bit. A mask filter accepts all frames into FIFO 0.
fn rig() -> Rig<Can> {
    let mut rig = Rig::new(Can::new());
    rig.write(0, INRQ);
    assert_eq!(rig.read(4) & 3, 1);
    rig.write(0x1C, LBKM | 13 << 16);
    rig.write(0x200, 0x0E01);
    rig.write(0x20C, 1);
    rig.write(0x21C, 1);
    rig.write(0x200, 0x0E00);
    rig.write(0, 0);
    assert_eq!(rig.read(4) & 3, 0);
    rig
}

#[test]
fn a_frame_comes_back_after_its_bits_with_the_stuffed_ones() {
    let mut rig = rig();
    rig.write(0x14, 3);
    rig.write(0x184, 1);
    rig.write(0x188, 0x55);
    // The frame has 19 bits of identifier and control, 8 of data, 15 of CRC, and stuff bits.
    rig.write(0x180, 0x2AA << 21 | TXRQ);
    assert_eq!(rig.read(8) >> 26, 6);
    let bits = rig.instance.mailboxes[0].stuffed_bits();
    assert!((42..=46).contains(&bits), "{bits}");
    let end = rig.instance.due();
    assert_eq!(end, rig.now + 16 * (bits + TAIL_BITS));
    rig.run(end - 1);
    assert_eq!((rig.read(0x0C), rig.instance.irq()), (0, 0));
    rig.run(end);
    assert_eq!((rig.read(0x0C), rig.instance.irq()), (1, 3));
    assert_eq!(rig.read(8) & 3, RQCP | TXOK);
    assert_eq!((rig.read(0x1B0), rig.read(0x1B4), rig.read(0x1B8)), (0x2AA << 21, 1, 0x55));
    rig.write(0x0C, RFOM);
    rig.write(8, RQCP);
    assert_eq!((rig.read(0x0C), rig.instance.irq()), (0, 0));
}

#[test]
fn a_frame_of_zeros_is_stuffed_after_every_five_bits() {
    // The frame begins with 34 zeros: SOF, identifier, RTR, IDE, r0, length 0 (19 bits) and a CRC of 15 zeros.
    let frame = Mailbox::default();
    assert_eq!(frame.stuffed_bits(), 34 + 6);
}

#[test]
fn the_lowest_identifier_is_sent_first_and_the_filters_choose() {
    let mut rig = rig();
    // Bank 0 is a list of two standard identifiers for FIFO 1.
    rig.write(0x200, 0x0E01);
    rig.write(0x204, 1);
    rig.write(0x214, 1);
    rig.write(0x240, 0x100 << 21);
    rig.write(0x244, 0x300 << 21);
    rig.write(0x200, 0x0E00);
    rig.write(0x180, 0x300 << 21 | TXRQ);
    rig.write(0x190, 0x200 << 21 | TXRQ);
    rig.write(0x1A0, 0x100 << 21 | TXRQ);
    rig.run(100_000);
    assert_eq!((rig.read(0x0C), rig.read(0x10)), (0, 2));
    assert_eq!((rig.read(0x1C0), rig.read(0x1C4)), (0x300 << 21, 1 << 8));
    rig.write(0x10, RFOM);
    assert_eq!((rig.read(0x1C0), rig.read(0x1C4)), (0x100 << 21, 0));
}

#[test]
fn outside_loopback_a_frame_waits_and_is_found() {
    let mut rig = rig();
    rig.write(0, INRQ);
    rig.write(0x1C, 12 << 16);
    rig.write(0, 0);
    rig.write(0x180, TXRQ);
    rig.run(100_000);
    assert_eq!(rig.read(8) & 3, 0);
    assert!(rig.found("no bus"));
    rig.write(8, ABRQ);
    assert_eq!(rig.read(8) & 3, RQCP);
}

#[test]
fn initialization_is_not_left_while_the_bus_is_dominant() {
    let mut rig = rig();
    rig.connect(Signal::Can(1, CanPin::Rx), 0, 11);
    rig.write(0, INRQ);
    rig.write(0x1C, 13 << 16);
    rig.write(0, 0);
    assert_eq!(rig.read(4) & 3, 1);
    rig.pads.levels[0] = 1 << 11;
    rig.input(Signal::Can(1, CanPin::Rx), true);
    assert_eq!(rig.read(4) & 3, 0);
}
