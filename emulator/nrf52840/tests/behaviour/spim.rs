//! Tests of SPIM with a chip on its bus.
use crate::rig::*;
use emulator_part::{FindingKind, Part, SpiMode};

/// Returns a part with SPIM0 at 8 MHz and a chip on P1.12 to P1.15. The chip records its bytes.
fn with_chip() -> Rig {
    let mut rig = Rig::new();
    rig.world.chip = Some(SpiMode::Mode1);
    set_up(&mut rig, SPIM0);
    rig
}

fn set_up(rig: &mut Rig, spim: u32) {
    rig.write_all(&[
        (P1 + 0x508, 1 << 12),
        (p1_cnf(12), OUTPUT),
        (p1_cnf(13), OUTPUT),
        (p1_cnf(14), INPUT),
        (p1_cnf(15), OUTPUT),
        (spim + 0x508, psel(1, 15)),
        (spim + 0x50C, psel(1, 13)),
        (spim + 0x510, psel(1, 14)),
        (spim + 0x524, 0x8000_0000),
        (spim + 0x554, 0b010),
        (spim + 0x500, 7),
        (spim + 0x544, TX),
        (spim + 0x534, RX),
    ]);
}

fn seen(rig: &mut Rig) -> Vec<Seen> {
    rig.world.seen.clone()
}

#[test]
fn a_transfer_clocks_each_byte_at_its_own_instant_both_ways() {
    let mut rig = with_chip();
    rig.fill(TX, &[0x11, 0x22, 0x33]);
    rig.write_all(&[(SPIM0 + 0x548, 3), (SPIM0 + 0x538, 3), (SPIM0 + 0x304, 1 << 6)]);
    rig.write(P1 + 0x50C, 1 << 12);
    rig.run_for(US);
    rig.write(SPIM0 + 0x10, 1);
    assert_eq!(rig.read(SPIM0 + 0x14C), 1, "STARTED");
    rig.run_to(4 * US - 1);
    assert_eq!(rig.memory(RX, 3), [0xA5, 0, 0], "the first byte is in RAM as it ends");
    rig.run_to(5 * US);
    assert!(rig.line(3));
    assert_eq!(rig.read(SPIM0 + 0x110) + rig.read(SPIM0 + 0x118) + rig.read(SPIM0 + 0x120), 3, "ENDRX, END, ENDTX");
    assert_eq!(rig.memory(RX, 3), [0xA5, 0xEE, 0xDD]);
    assert_eq!((rig.read(SPIM0 + 0x54C), rig.read(SPIM0 + 0x53C)), (3, 3));
    rig.write(P1 + 0x508, 1 << 12);
    let wanted = [
        Seen::Select(0),
        Seen::Byte(3 * US, 0x11), // 1 us of start-up, then 1 us a byte
        Seen::Byte(4 * US, 0x22),
        Seen::Byte(5 * US, 0x33),
        Seen::Deselect(5 * US),
    ];
    assert_eq!(seen(&mut rig), wanted);
    rig.assert_clean();
}

#[test]
fn a_short_transmit_buffer_is_padded_and_surplus_input_is_dropped() {
    let mut rig = with_chip();
    rig.fill(TX, &[0x11]);
    rig.write_all(&[(SPIM0 + 0x548, 1), (SPIM0 + 0x538, 3), (SPIM0 + 0x5C0, 0x77), (P1 + 0x50C, 1 << 12)]);
    rig.write(SPIM0 + 0x10, 1);
    rig.run_to(2 * US);
    assert_eq!((rig.read(SPIM0 + 0x120), rig.read(SPIM0 + 0x110)), (1, 0), "ENDTX first");
    rig.run_to(10 * US);
    assert_eq!(rig.memory(RX, 4), [0xA5, 0xEE, 0x88, 0]);
    rig.write_all(&[(SPIM0 + 0x548, 3), (SPIM0 + 0x538, 1), (SPIM0 + 0x534, RX + 8), (SPIM0 + 0x10, 1)]);
    rig.run_to(20 * US);
    assert_eq!((rig.read(SPIM0 + 0x53C), rig.read(SPIM0 + 0x54C)), (1, 3));
    assert_eq!(rig.memory(RX + 9, 2), [0, 0]);
    rig.assert_clean();
}

#[test]
fn pointers_are_taken_at_start_and_list_moves_them_on() {
    let mut rig = with_chip();
    rig.fill(TX, &[1, 2, 3, 4]);
    rig.write_all(&[(SPIM0 + 0x548, 2), (SPIM0 + 0x538, 2), (SPIM0 + 0x540, 1), (SPIM0 + 0x550, 1)]);
    rig.write_all(&[(P1 + 0x50C, 1 << 12), (SPIM0 + 0x200, 1 << 17), (SPIM0 + 0x10, 1)]);
    rig.run_to(4 * US);
    rig.write(SPIM0 + 0x200, 0); // the second transfer began at END; no third
    rig.run_to(20 * US);
    let bytes: Vec<_> = seen(&mut rig)
        .iter()
        .filter_map(|seen| if let Seen::Byte(at, byte) = seen { Some((*at, *byte)) } else { None })
        .collect();
    assert_eq!(bytes, [(2 * US, 1), (3 * US, 2), (5 * US, 3), (6 * US, 4)]);
    assert_eq!(rig.read(SPIM0 + 0x544), TX + 4);
    assert_eq!(rig.memory(RX, 4), [0xA5, !1, !2, !3]);
}

#[test]
fn stop_ends_after_the_byte_under_way_and_ends_both_buffers() {
    let mut rig = with_chip();
    rig.write_all(&[(SPIM0 + 0x548, 100), (SPIM0 + 0x538, 100), (P1 + 0x50C, 1 << 12), (SPIM0 + 0x10, 1)]);
    rig.run_to(4 * US + 32);
    rig.write(SPIM0 + 0x14, 1);
    assert_eq!(rig.run_until_set(SPIM0 + 0x104, MS), 5 * US);
    assert_eq!((rig.read(SPIM0 + 0x110), rig.read(SPIM0 + 0x120), rig.read(SPIM0 + 0x118)), (1, 1, 0));
    assert_eq!(rig.read(SPIM0 + 0x53C), 4);
}

#[test]
fn suspend_holds_between_two_bytes_until_resume() {
    let mut rig = with_chip();
    rig.write_all(&[(SPIM0 + 0x548, 2), (SPIM0 + 0x538, 2), (P1 + 0x50C, 1 << 12), (SPIM0 + 0x10, 1)]);
    rig.run_to(96);
    rig.write(SPIM0 + 0x1C, 1);
    rig.run_to(50 * US);
    assert_eq!(seen(&mut rig).len(), 2, "the byte under way was finished");
    rig.write(SPIM0 + 0x20, 1);
    assert_eq!(rig.run_until_set(SPIM0 + 0x118, MS), 51 * US);
}

#[test]
fn a_suspend_between_transfers_stands_until_resume() {
    let mut rig = with_chip();
    rig.write_all(&[(SPIM0 + 0x548, 1), (SPIM0 + 0x538, 1), (P1 + 0x50C, 1 << 12), (SPIM0 + 0x1C, 1)]);
    rig.write(SPIM0 + 0x10, 1);
    rig.run_to(50 * US);
    assert_eq!(rig.read(SPIM0 + 0x118), 0);
    assert_eq!(rig.findings(FindingKind::Misuse).len(), 1);
    rig.write(SPIM0 + 0x20, 1);
    assert_eq!(rig.run_until_set(SPIM0 + 0x118, MS), 51 * US);
}

#[test]
fn bit_order_reverses_what_travels() {
    let mut rig = with_chip();
    rig.fill(TX, &[0b0000_0001]);
    rig.write_all(&[(SPIM0 + 0x554, 0b011), (SPIM0 + 0x548, 1), (SPIM0 + 0x538, 1)]);
    rig.write_all(&[(P1 + 0x50C, 1 << 12), (SPIM0 + 0x10, 1)]);
    rig.run_to(3 * US);
    assert_eq!(seen(&mut rig)[1], Seen::Byte(2 * US, 0b1000_0000));
    assert_eq!(rig.memory(RX, 1), [0xA5_u8.reverse_bits()]);
}

#[test]
fn a_chip_on_other_pins_or_not_selected_hears_nothing() {
    let mut rig = with_chip();
    rig.write_all(&[(SPIM0 + 0x548, 1), (SPIM0 + 0x538, 1), (SPIM0 + 0x10, 1)]);
    rig.run_to(10 * US);
    assert_eq!(seen(&mut rig), []);
    rig.write_all(&[
        (P1 + 0x50C, 1 << 12),
        (SPIM0 + 0x500, 0),
        (p0_cnf(2), OUTPUT),
        (SPIM0 + 0x508, psel(0, 2)),
        (SPIM0 + 0x500, 7),
    ]);
    rig.write(SPIM0 + 0x10, 1);
    rig.run_to(20 * US);
    assert_eq!(seen(&mut rig), [Seen::Select(10 * US)]);
    rig.assert_clean();
}

#[test]
fn misuse_of_the_controller_is_reported() {
    let cases: [(&str, &[(u32, u32)]); 3] = [
        ("outside data RAM", &[(SPIM0 + 0x544, 0x1000), (SPIM0 + 0x10, 1)]),
        ("not enabled", &[(SPIM0 + 0x500, 0), (SPIM0 + 0x10, 1)]),
        ("FREQUENCY", &[(SPIM0 + 0x524, 0x0A00_0000), (SPIM0 + 0x10, 1)]),
    ];
    for (what, writes) in cases {
        let mut rig = with_chip();
        rig.write_all(&[(SPIM0 + 0x548, 1), (SPIM0 + 0x538, 1)]);
        rig.write_all(writes);
        rig.run_to(10 * US);
        let found = rig.part.findings();
        assert!(found.len() == 1 && found[0].text.contains(what), "{what}: {found:?}");
    }
}

#[test]
fn a_frame_says_where_when_and_how_it_was_clocked() {
    let mut rig = with_chip();
    rig.fill(TX, &[0x3C]);
    rig.write_all(&[(SPIM0 + 0x548, 1), (SPIM0 + 0x524, 0x4000_0000), (SPIM0 + 0x10, 1)]);
    rig.run_to(10 * US);
    let [frame] = rig.world.frames[..] else { panic!("{:?}", rig.world.frames) };
    assert_eq!((frame.sck, frame.mosi, frame.miso), ([Some(SCK), None], [Some(MOSI), None], Some(MISO)));
    assert_eq!((frame.mode, frame.bits, frame.data), (SpiMode::Mode1, 8, 0x3C));
    assert_eq!((frame.begins, frame.ends), (US, 3 * US));
}

#[test]
fn a_wire_that_psel_or_gpio_leaves_out_carries_nothing() {
    // A case has the writes before START, whether SCK and MOSI carry a signal, the byte received from the chip, and the
    // number of findings.
    type Case<'a> = (&'a [(u32, u32)], bool, bool, u8, usize);
    let cases: [Case<'_>; 6] = [
        (&[], true, true, 0xA5, 0),
        (&[(SPIM0 + 0x508, u32::MAX)], false, true, 0, 0),
        (&[(SPIM0 + 0x50C, u32::MAX)], true, false, 0xA5, 0),
        (&[(p1_cnf(15), INPUT)], false, true, 0, 1),
        (&[(p1_cnf(13), INPUT)], true, false, 0xA5, 1),
        (&[(p1_cnf(14), 2)], true, true, 0, 1),
    ];
    for (writes, sck, mosi, received, findings) in cases {
        let mut rig = with_chip();
        rig.fill(TX, &[0x11]);
        rig.write_all(writes);
        rig.write_all(&[(SPIM0 + 0x548, 1), (SPIM0 + 0x538, 1), (P1 + 0x50C, 1 << 12), (SPIM0 + 0x10, 1)]);
        rig.run_to(10 * US);
        let frame = rig.world.frames[0];
        assert_eq!((frame.sck[0].is_some(), frame.mosi[0].is_some()), (sck, mosi), "{writes:x?}");
        assert_eq!(rig.memory(RX, 1), [received], "{writes:x?}");
        assert_eq!(rig.findings(FindingKind::Misuse).len(), findings, "{writes:x?}");
    }
}

#[test]
fn nothing_on_miso_reads_as_its_pull_resistor() {
    for (cnf, received) in [(INPUT, 0), (PULLED_UP, 0xFF)] {
        let mut rig = with_chip();
        rig.world.chip = None;
        rig.write_all(&[(p1_cnf(14), cnf), (SPIM0 + 0x538, 1), (SPIM0 + 0x10, 1)]);
        rig.run_to(10 * US);
        assert_eq!(rig.memory(RX, 1), [received]);
    }
}

#[test]
fn spim3_at_32_mhz_drives_its_select_and_reports_its_erratum() {
    let mut rig = with_chip();
    rig.fill(TX, &[9, 8]);
    rig.write(SPIM0 + 0x500, 0);
    set_up(&mut rig, SPIM3);
    rig.write_all(&[
        (SPIM3 + 0x500, 0),
        (SPIM3 + 0x514, psel(1, 12)),
        (SPIM3 + 0x524, 0x1400_0000),
        (SPIM3 + 0x500, 7),
    ]);
    rig.write_all(&[(SPIM3 + 0x548, 2), (SPIM3 + 0x538, 2), (SPIM3 + 0x10, 1)]);
    rig.run_to(5 * US);
    let wanted = [Seen::Select(0), Seen::Byte(80, 9), Seen::Byte(96, 8), Seen::Deselect(96)];
    assert_eq!(seen(&mut rig), wanted);
    assert_eq!(rig.findings(FindingKind::Erratum).len(), 1);
}
