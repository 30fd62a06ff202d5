//! Tests of transmission and reception, also with wrong baud rates.

use super::*;
use crate::rig::Rig;

const SR: u32 = 0x00;
const DR: u32 = 0x04;
const BRR: u32 = 0x08;
const CR1: u32 = 0x0C;
const CR3: u32 = 0x14;

/// Returns a USART at 115 107.9 baud from 16 MHz, so a bit takes 139 cycles.
fn rig() -> Rig<Usart> {
    let mut rig = Rig::new(Usart::new(4));
    rig.connect(Signal::Uart(4, UartPin::Tx), 0, 0);
    rig.write(BRR, 139);
    rig.write(CR1, UE | RE | TE);
    // After 1390 cycles the idle frame that TE sends has ended.
    rig.run(1390);
    rig
}

fn tell(rig: &mut Rig<Usart>, begins: Cycle, frame: &UartFrame) {
    rig.call(|uart, cx| uart.receive(begins, frame, cx));
}

#[test]
fn a_byte_is_received_at_the_last_sample_of_its_stop_bit() {
    let mut rig = rig();
    tell(&mut rig, 2000, &UartFrame::eight_n_one(0x5A, 115_200));
    let sampled = 2000 + 9 * 139 + 86;
    rig.run(sampled - 1);
    assert_eq!(rig.read(SR) & RXNE, 0);
    rig.run(sampled);
    assert_eq!(rig.read(SR) & (RXNE | FE | NF | PE | ORE), RXNE);
    assert_eq!(rig.read(DR), 0x5A);
    assert_eq!(rig.read(SR) & RXNE, 0);
}

#[test]
fn back_to_back_frames_are_all_received_without_an_idle_line() {
    let mut rig = rig();
    let frame = |byte| UartFrame::eight_n_one(byte, 115_200);
    let length = 1389;
    for byte in 0..100_u8 {
        let begins = 2000 + u64::from(byte) * length;
        rig.run(begins + length);
        tell(&mut rig, begins, &frame(byte));
        assert_eq!(rig.read(SR) & (RXNE | IDLE | FE | NF | ORE), RXNE, "{byte}");
        assert_eq!(rig.read(DR), u32::from(byte));
    }
    rig.run(rig.now + 1000);
    assert_eq!(rig.read(SR) & IDLE, 0);
    rig.run(rig.now + 1000);
    assert_ne!(rig.read(SR) & IDLE, 0);
    rig.read(DR);
    assert_eq!(rig.read(SR) & IDLE, 0);
    rig.run(rig.now + 100_000);
    assert_eq!(rig.read(SR) & IDLE, 0, "once for each idle line");
}

#[test]
fn a_frame_at_twice_the_baud_rate_arrives_wrong() {
    let mut rig = rig();
    tell(&mut rig, 2000, &UartFrame::eight_n_one(0x00, 230_400));
    rig.run(10_000);
    // The line is low for four and a half bits of the receiver. It rises between two samples of the fifth bit.
    assert_ne!(rig.read(SR) & NF, 0);
    assert_eq!(rig.read(DR), 0xF8);
}

#[test]
fn half_the_baud_rate_on_the_line_gives_a_framing_error() {
    let mut rig = rig();
    tell(&mut rig, 2000, &UartFrame::eight_n_one(0x00, 57_600));
    rig.run(3600);
    assert_eq!(rig.read(SR) & (RXNE | FE), RXNE | FE);
    assert_eq!(rig.read(DR), 0);
    assert_eq!(rig.read(SR) & FE, 0);
}

#[test]
fn a_sender_3_percent_off_is_received_but_6_is_not() {
    for (baud, right) in [(111_700, true), (118_600, true), (108_300, false), (122_200, false)] {
        let mut rig = rig();
        tell(&mut rig, 2000, &UartFrame::eight_n_one(0x80, baud));
        rig.run(3400);
        let clean = rig.read(SR) & (RXNE | FE | NF) == RXNE && rig.read(DR) == 0x80;
        assert_eq!(clean, right, "{baud}");
    }
}

#[test]
fn a_wrong_parity_is_flagged() {
    let mut rig = rig();
    rig.write(CR1, UE | RE | M | PCE);
    let mut frame = UartFrame::eight_n_one(0x03, 115_200);
    frame.parity = UartParity::Even;
    tell(&mut rig, 2000, &frame);
    rig.run(4000);
    assert_eq!(rig.read(SR) & (RXNE | PE | FE), RXNE);
    assert_eq!(rig.read(DR) & 0xFF, 3);
    frame.parity = UartParity::Odd;
    tell(&mut rig, 5000, &frame);
    rig.run(8000);
    assert_eq!(rig.read(SR) & (RXNE | PE | FE), RXNE | PE);
}

#[test]
fn an_unread_byte_stays_and_the_next_one_is_lost() {
    let mut rig = rig();
    tell(&mut rig, 2000, &UartFrame::eight_n_one(1, 115_200));
    tell(&mut rig, 4000, &UartFrame::eight_n_one(2, 115_200));
    rig.run(6000);
    assert_eq!(rig.read(SR) & (RXNE | ORE), RXNE | ORE);
    assert_eq!(rig.read(DR), 1);
    assert_eq!(rig.read(SR) & (RXNE | ORE), 0);
}

#[test]
fn without_the_receiver_nothing_comes_in() {
    let mut rig = rig();
    rig.write(CR1, UE | TE);
    tell(&mut rig, 2000, &UartFrame::eight_n_one(1, 115_200));
    rig.run(6000);
    assert_eq!(rig.read(SR) & (RXNE | IDLE), 0);
}

#[test]
fn requests_and_error_interrupts_need_the_dma_bit() {
    let mut rig = rig();
    tell(&mut rig, 2000, &UartFrame::eight_n_one(0, 57_600));
    rig.run(3600);
    rig.write(CR3, EIE);
    assert_eq!((rig.instance.dma(), rig.instance.irq()), (0, 0));
    rig.write(CR3, EIE | DMAR);
    assert_eq!((rig.instance.dma(), rig.instance.irq()), (1, 1));
}

#[test]
fn bytes_are_sent_back_to_back_and_tc_rises_after_the_last() {
    let mut rig = rig();
    rig.run(2000);
    rig.write(DR, 0x41);
    assert_eq!(rig.read(SR) & (TXE | TC), TXE);
    rig.write(DR, 0x42);
    assert_eq!(rig.read(SR) & (TXE | TC), 0);
    rig.run(2000 + 2 * 1390 - 1);
    assert_eq!(rig.read(SR) & (TXE | TC), TXE);
    rig.run(2000 + 2 * 1390);
    assert_eq!(rig.read(SR) & (TXE | TC), TXE | TC);
    let sent: Vec<_> = rig.lines.uart.iter().map(|(at, frame)| (*at, frame.data, frame.bit_ps)).collect();
    assert_eq!(sent, [(3390, 0x41, 8_687_500), (4780, 0x42, 8_687_500)]);
}

#[test]
fn the_first_byte_waits_for_the_transmitters_idle_frame() {
    let mut rig = Rig::new(Usart::new(1));
    rig.connect(Signal::Uart(1, UartPin::Tx), 0, 0);
    rig.write(BRR, 16);
    rig.write(CR1, UE | TE);
    rig.write(DR, 0x41);
    rig.run(1000);
    assert_eq!(rig.lines.uart[0].0, 320);
}

/// Settings made during the idle frame that `TE` sends are in time. During a data frame they are too late.
#[test]
fn a_change_of_length_or_baud_rate_during_data_is_reported() {
    let changes = [(CR1, UE | TE | M), (CR1, UE | TE | OVER8), (BRR, 32)];
    for (register, value) in changes {
        let mut rig = Rig::new(Usart::new(1));
        rig.connect(Signal::Uart(1, UartPin::Tx), 0, 0);
        rig.write(BRR, 16);
        rig.write(CR1, UE | TE);
        rig.write(register, value);
        assert!(!rig.found("under way"), "{register:#x} during the idle frame");
    }
    for (register, value) in changes {
        let mut rig = Rig::new(Usart::new(1));
        rig.connect(Signal::Uart(1, UartPin::Tx), 0, 0);
        rig.write(BRR, 16);
        rig.write(CR1, UE | TE);
        rig.run(200);
        rig.write(DR, 0x41);
        rig.write(register, value);
        assert!(rig.found("under way"), "{register:#x} during data");
    }
}

#[test]
fn without_a_baud_rate_nothing_is_sent() {
    let mut rig = Rig::new(Usart::new(1));
    rig.connect(Signal::Uart(1, UartPin::Tx), 0, 0);
    rig.write(CR1, UE | TE);
    rig.write(DR, 0x41);
    rig.run(100_000);
    assert!(rig.lines.uart.is_empty());
    assert_eq!(rig.read(SR) & TXE, 0);
}

#[test]
fn oversampling_by_eight_takes_three_bits_of_fraction() {
    let mut rig = Rig::new(Usart::new(4));
    rig.connect(Signal::Uart(4, UartPin::Tx), 0, 0);
    rig.write(BRR, 0x113);
    rig.write(CR1, OVER8 | UE | RE | TE);
    rig.run(1390);
    rig.write(DR, 0x41);
    tell(&mut rig, 1390, &UartFrame::eight_n_one(0xC3, 115_200));
    rig.run(4000);
    assert_eq!(rig.lines.uart[0].1.bit_ps, 139 * 62_500);
    assert_eq!((rig.read(SR) & (RXNE | FE | NF), rig.read(DR)), (RXNE, 0xC3));
}

#[test]
fn in_half_duplex_the_receiver_hears_what_is_sent() {
    let mut rig = rig();
    rig.write(CR3, HDSEL);
    rig.write(DR, 0x41);
    rig.run(rig.now + 1390);
    assert_eq!((rig.read(SR) & (RXNE | FE | NF), rig.read(DR)), (RXNE, 0x41));
}

#[test]
fn what_the_reference_sampling_gives_is_what_the_short_way_gives() {
    for baud in [113_000, 114_500, 115_200, 116_000, 117_500] {
        for data in [0x00, 0x01, 0x55, 0x80, 0xAA, 0xFF] {
            let mut rig = rig();
            tell(&mut rig, 2000, &UartFrame::eight_n_one(data, baud));
            let short = rig.instance.sampled(2000);
            let blank = Wave { begins: 2000, ends: 2000, bit: 1, levels: u32::MAX };
            rig.instance.waves.push_back(blank);
            assert_eq!(rig.instance.sampled(2000), short, "{baud} {data:#x}");
        }
    }
}
