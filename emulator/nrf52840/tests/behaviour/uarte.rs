//! Tests of UARTE and of the legacy UART.
use crate::rig::*;
use emulator_part::{FindingKind, Part, Pin, UartFrame, UartParity};
use nrf52840::Settings;

/// A part with UARTE0 at 1 Mbit/s (10 us a byte) on P0.06 and P0.08.
fn with_uart() -> Rig {
    let mut rig = Rig::new();
    rig.write_all(&[(P0 + 0x508, 1 << 6), (p0_cnf(6), OUTPUT), (p0_cnf(8), INPUT)]);
    rig.write_all(&[(UARTE0 + 0x50C, 6), (UARTE0 + 0x514, 8), (UARTE0 + 0x524, 0x1000_0000), (UARTE0 + 0x500, 8)]);
    rig
}

#[test]
fn a_uart_sends_a_buffer_byte_by_byte() {
    let mut rig = with_uart();
    rig.fill(TX, b"hi!");
    rig.write_all(&[(UARTE0 + 0x544, TX), (UARTE0 + 0x548, 3), (UARTE0 + 0x08, 1)]);
    assert_eq!(rig.run_until_set(UARTE0 + 0x120, MS), 30 * US);
    let frame = |byte| UartFrame::eight_n_one(byte, 1_000_000);
    let pin = Pin::new(0, 6);
    let wanted = [(10 * US, pin, frame(b'h')), (20 * US, pin, frame(b'i')), (30 * US, pin, frame(b'!'))];
    assert_eq!(rig.world.sent, wanted);
    assert_eq!(rig.read(UARTE0 + 0x54C), 3);
    rig.write(UARTE0 + 0x0C, 1);
    assert_eq!(rig.read(UARTE0 + 0x158), 1, "TXSTOPPED");
    rig.assert_clean();
}

#[test]
fn txd_rests_high_while_the_uart_is_enabled() {
    let mut rig = with_uart();
    rig.write(P0 + 0x50C, 1 << 6);
    assert!(rig.part.pin(Pin::new(0, 6)));
    rig.write(UARTE0 + 0x500, 0);
    assert!(!rig.part.pin(Pin::new(0, 6)));
}

#[test]
fn a_uart_whose_txd_is_no_output_sends_nothing() {
    let mut rig = with_uart();
    rig.write_all(&[(p0_cnf(6), INPUT), (UARTE0 + 0x544, TX), (UARTE0 + 0x548, 3), (UARTE0 + 0x08, 1)]);
    assert_eq!(rig.run_until_set(UARTE0 + 0x120, MS), 30 * US);
    assert_eq!(rig.world.sent, []);
    assert_eq!(rig.findings(FindingKind::Misuse).len(), 1);
}

const RXD: Pin = Pin::new(0, 8);

fn receive(rig: &mut Rig, bytes: &[u8]) {
    for &byte in bytes {
        receive_frame(rig, UartFrame::eight_n_one(byte, 1_000_000));
    }
}

fn receive_frame(rig: &mut Rig, frame: UartFrame) {
    let begins = rig.now;
    rig.run_for(frame.ns() * 64 / 1000);
    rig.part.receive(begins, RXD, frame, &mut rig.world);
    rig.run_for(0);
}

#[test]
fn a_uart_reports_the_errors_that_the_bits_show() {
    let frame = |data, baud| UartFrame::eight_n_one(data, baud);
    let even = UartFrame { parity: UartParity::Even, ..frame(0x07, 1_000_000) };
    let odd = UartFrame { parity: UartParity::Odd, ..frame(0x07, 1_000_000) };
    // Each case has CONFIG, the frame that arrives, the byte that is received, and ERRORSRC.
    let cases = [
        (0, frame(0x55, 1_000_000), 0x55, 0),
        (0, frame(0x55, 1_030_000), 0x55, 0),
        (0xE, even, 0x07, 0),
        (0xE, odd, 0x07, 1 << 1),
        // The receiver expects a stop bit where the frame has a parity bit.
        (0, UartFrame { parity: UartParity::Even, ..frame(0x03, 1_000_000) }, 0x03, 1 << 2),
        // A frame of half the rate has each of its bits sampled twice.
        (0, frame(0x0F, 500_000), 0b1111_1110, 0),
        (0, frame(0x00, 500_000), 0, 1 << 2 | 1 << 3),
    ];
    for (config, frame, received, errors) in cases {
        let mut rig = with_uart();
        rig.write_all(&[(UARTE0 + 0x56C, config), (UARTE0 + 0x534, RX), (UARTE0 + 0x538, 8), (UARTE0, 1)]);
        rig.run_for(10 * US);
        receive_frame(&mut rig, frame);
        rig.run_for(10 * US);
        assert_eq!(rig.memory(RX, 1), [received], "{frame:?}");
        assert_eq!(rig.read(UARTE0 + 0x480), errors, "{frame:?}");
        assert_eq!(rig.read(UARTE0 + 0x124), u32::from(errors != 0), "{frame:?}");
    }
}

#[test]
fn a_uart_without_the_crystal_has_the_internal_oscillators_error() {
    let mut rig = with_uart();
    let mut fast = Rig::with(Settings { hfint_ppb: 15_000_000, ..Settings::default() });
    for rig in [&mut rig, &mut fast] {
        rig.write_all(&[(P0 + 0x508, 1 << 6), (p0_cnf(6), OUTPUT), (UARTE0 + 0x50C, 6)]);
        rig.write_all(&[(UARTE0 + 0x524, 0x1000_0000), (UARTE0 + 0x500, 8)]);
        rig.write_all(&[(UARTE0 + 0x544, TX), (UARTE0 + 0x548, 1), (UARTE0 + 0x08, 1)]);
        rig.run_to(MS);
    }
    assert_eq!((rig.world.sent[0].2.bit_ps, fast.world.sent[0].2.bit_ps), (1_000_000, 985_221));
}

#[test]
fn a_legacy_uart_sends_and_receives_through_its_data_registers() {
    let mut rig = with_uart();
    rig.write_all(&[(UARTE0 + 0x500, 4), (UARTE0, 1), (UARTE0 + 0x08, 1), (UARTE0 + 0x51C, 0x41)]);
    assert_eq!(rig.run_until_set(UARTE0 + 0x11C, MS), 10 * US);
    assert_eq!(rig.world.sent.len(), 1);
    receive(&mut rig, b"xy");
    assert_eq!((rig.read(UARTE0 + 0x108), rig.read(UARTE0 + 0x518)), (1, u32::from(b'x')));
    assert_eq!(rig.read(UARTE0 + 0x518), u32::from(b'y'));
    rig.assert_clean();
}

#[test]
fn a_uart_receives_across_two_buffers_and_times_out_after_stop() {
    let mut rig = with_uart();
    rig.write_all(&[(UARTE0 + 0x534, RX), (UARTE0 + 0x538, 2), (UARTE0, 1)]);
    receive(&mut rig, b"abc");
    assert_eq!(rig.read(UARTE0 + 0x110), 1, "ENDRX");
    rig.write_all(&[(UARTE0 + 0x110, 0), (UARTE0 + 0x534, RX + 2), (UARTE0 + 0x538, 4), (UARTE0, 1)]);
    receive(&mut rig, b"d");
    assert_eq!(rig.memory(RX, 5), b"abcd\0", "the FIFO bridged the gap");
    let stopped = rig.now;
    rig.write(UARTE0 + 0x04, 1);
    assert_eq!(rig.run_until_set(UARTE0 + 0x144, MS), stopped + 40 * US);
    assert_eq!((rig.read(UARTE0 + 0x110), rig.read(UARTE0 + 0x53C)), (1, 2));
    rig.assert_clean();
}

#[test]
fn a_uart_with_no_buffer_overruns_after_six_bytes() {
    let mut rig = with_uart();
    rig.write_all(&[(UARTE0 + 0x534, RX), (UARTE0 + 0x538, 1), (UARTE0, 1)]);
    receive(&mut rig, b"1234567");
    assert_eq!(rig.read(UARTE0 + 0x124), 0);
    receive(&mut rig, b"8");
    assert_eq!((rig.read(UARTE0 + 0x124), rig.read(UARTE0 + 0x480)), (1, 1));
}

#[test]
fn cts_holds_bytes_back_and_rts_reports_room() {
    let (cts, rts) = (Pin::new(0, 7), Pin::new(0, 5));
    let mut rig = with_uart();
    rig.drive(cts, true);
    rig.write_all(&[(P0 + 0x508, 1 << 5), (p0_cnf(5), OUTPUT), (p0_cnf(7), INPUT)]);
    rig.write_all(&[(UARTE0 + 0x508, 5), (UARTE0 + 0x510, 7), (UARTE0 + 0x56C, 1)]);
    assert!(rig.part.pin(rts), "no receiver yet");
    rig.fill(TX, b"hi!");
    rig.write_all(&[(UARTE0 + 0x544, TX), (UARTE0 + 0x548, 3), (UARTE0 + 0x08, 1)]);
    rig.run_for(MS);
    assert_eq!(rig.world.sent, []);
    rig.drive(cts, false);
    rig.run_for(15 * US);
    rig.drive(cts, true); // in the second byte, which is sent all the same
    rig.run_for(MS);
    let sent: Vec<_> = rig.world.sent.iter().map(|(at, _, frame)| (*at - MS, frame.data as u8)).collect();
    assert_eq!(sent, [(10 * US, b'h'), (20 * US, b'i')]);
    assert_eq!((rig.read(UARTE0 + 0x100), rig.read(UARTE0 + 0x104)), (1, 1), "CTS, NCTS");
    // The buffer holds one byte, and the FIFO two more. The FIFO has room for another four.
    rig.write_all(&[(UARTE0 + 0x534, RX), (UARTE0 + 0x538, 1), (UARTE0, 1)]);
    assert!(!rig.part.pin(rts));
    for (byte, ready) in [(b'a', true), (b'b', true), (b'c', false), (b'd', false)] {
        receive(&mut rig, &[byte]);
        assert_eq!(rig.part.pin(rts), !ready, "{byte}");
    }
    rig.assert_clean();
}
