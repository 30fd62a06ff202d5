//! SPIM with a chip on its bus, SPIS with a controller on its, UARTE with a far end, TWIS with a controller.
use crate::rig::*;
use bench_seam::{FindingKind, I2cEvent, Part, Pin, SpiMode, UartFrame, UartParity};
use nrf52840::{Settings, SpisEvent};

const TX: u32 = RAM + 0x100;
const RX: u32 = RAM + 0x200;

/// A part with a recording chip on P1.12 to P1.15, and SPIM0 set up for it at 8 MHz.
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
fn the_over_read_character_fills_in_for_a_short_buffer_and_surplus_reception_is_dropped() {
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
    // What is written before START; whether SCK and MOSI carry something; what is received from the chip; findings.
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
fn spim3_runs_at_32_mhz_drives_its_select_and_its_anomaly_is_named() {
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

/// SPIS1 on P1.01 to P1.04, with 8 bytes each way, still the CPU's.
fn with_spis() -> Rig {
    let mut rig = Rig::new();
    rig.write_all(&[
        (p1_cnf(1), INPUT),
        (p1_cnf(3), INPUT),
        (p1_cnf(4), PULLED_UP),
        (SPIS1 + 0x508, psel(1, 1)),
        (SPIS1 + 0x50C, psel(1, 2)),
        (SPIS1 + 0x510, psel(1, 3)),
        (SPIS1 + 0x514, psel(1, 4)),
        (SPIS1 + 0x55C, 0xFF),
        (SPIS1 + 0x5C0, 0x5A),
        (SPIS1 + 0x500, 2),
        (SPIS1 + 0x534, RX),
        (SPIS1 + 0x538, 8),
        (SPIS1 + 0x544, TX),
        (SPIS1 + 0x548, 8),
    ]);
    rig.fill(TX, &[1, 2, 3, 4, 5, 6, 7, 8]);
    rig.deselect(CSN);
    rig
}

/// One transaction of `mosi` at 8 MHz, and what came back.
fn transact(rig: &mut Rig, mosi: &[u8]) -> Vec<Option<u8>> {
    rig.run_for(10 * US);
    rig.select(CSN);
    rig.run_for(US);
    let miso = clock(rig, mosi);
    rig.run_for(US);
    rig.deselect(CSN);
    miso
}

fn clock(rig: &mut Rig, mosi: &[u8]) -> Vec<Option<u8>> {
    mosi.iter()
        .map(|&byte| {
            rig.run_for(US);
            rig.clock(byte)
        })
        .collect()
}

fn said(rig: &mut Rig) -> Vec<SpisEvent> {
    rig.part
        .take_spis_events()
        .into_iter()
        .map(|(_, number, event)| (number, event))
        .map(|(number, event)| {
            assert_eq!(number, 1);
            event
        })
        .collect()
}

#[test]
fn a_released_spis_exchanges_its_buffers_and_says_end() {
    let mut rig = with_spis();
    rig.write(SPIS1 + 0x304, 1 << 1);
    rig.write(SPIS1 + 0x28, 1);
    assert_eq!(rig.read(SPIS1 + 0x400), 0, "free");
    let miso = transact(&mut rig, &[0xA0, 0xA1, 0xA2]);
    assert_eq!(miso, [Some(1), Some(2), Some(3)]);
    assert_eq!(rig.memory(RX, 4), [0xA0, 0xA1, 0xA2, 0]);
    assert_eq!((rig.read(SPIS1 + 0x53C), rig.read(SPIS1 + 0x54C)), (3, 3));
    assert!(rig.line(4));
    assert_eq!((rig.read(SPIS1 + 0x104), rig.read(SPIS1 + 0x128), rig.read(SPIS1 + 0x440)), (1, 0, 0));
    assert_eq!(
        said(&mut rig),
        [SpisEvent::Released, SpisEvent::Ready, SpisEvent::End { rx: 3, tx: 3 }, SpisEvent::Ready]
    );
    rig.assert_clean();
}

#[test]
fn the_outside_sees_the_cpu_take_the_semaphore_and_give_it_back() {
    let mut rig = with_spis();
    rig.write(SPIS1 + 0x28, 1);
    rig.write(SPIS1 + 0x24, 1);
    rig.write(SPIS1 + 0x28, 1);
    let around = [SpisEvent::Released, SpisEvent::Ready];
    assert_eq!(said(&mut rig), [&around[..], &[SpisEvent::Held], &around].concat());
    // By END_ACQUIRE at the end of a transaction.
    rig.write(SPIS1 + 0x200, 1 << 2);
    transact(&mut rig, &[0xA0]);
    assert_eq!(said(&mut rig), [SpisEvent::End { rx: 1, tx: 1 }, SpisEvent::Held]);
    rig.assert_clean();
}

/// Granted or not, within the buffers and past their ends: what crosses in runs is what crosses byte by byte.
#[test]
fn bytes_exchanged_together_are_those_exchanged_one_by_one() {
    for granted in [true, false] {
        let mosi: Vec<u8> = (0xA0..0xAB).collect();
        let ready = || {
            let mut rig = with_spis();
            if granted {
                rig.write(SPIS1 + 0x28, 1);
            }
            rig
        };
        let mut one_by_one = ready();
        let alone = transact(&mut one_by_one, &mosi);

        let mut together = ready();
        together.run_for(10 * US);
        together.select(CSN);
        let began = together.now + US;
        let (mut miso, mut runs) = (vec![0; mosi.len()], vec![]);
        let mut done = 0;
        while done < mosi.len() {
            let run = (mosi.len() - done).min(together.part.ssi_quiet());
            let first = began + US * (done as u64 + 1);
            let (sent, got) = (&mosi[done..done + run], &mut miso[done..done + run]);
            let driven = together.part.ssi_exchange(first, US << 16, SpiMode::Mode0, sent, got, &mut together.world);
            assert!(driven);
            done += run;
            runs.push(run);
        }
        together.run_to(began + US * (mosi.len() as u64 + 1));
        together.deselect(CSN);

        // RXD takes 8, and ENDRX comes with the eighth.
        assert_eq!(runs, if granted { vec![8, 3] } else { vec![11] });
        assert_eq!(miso.into_iter().map(Some).collect::<Vec<_>>(), alone);
        assert_eq!(together.memory(RX, 9), one_by_one.memory(RX, 9));
        for register in [0x104, 0x110, 0x400, 0x440, 0x53C, 0x54C] {
            assert_eq!(together.read(SPIS1 + register), one_by_one.read(SPIS1 + register), "{register:#x}");
        }
        assert_eq!(said(&mut together), said(&mut one_by_one));
        together.assert_clean();
    }
}

#[test]
fn an_spis_on_other_pins_than_the_controllers_exchanges_nothing() {
    // PSEL register, and what comes back then: without SCK a constant, MOSI matters to the reception only.
    for (register, back, received) in [(0x508, Some(0), 0), (0x510, Some(1), 0), (0x50C, None, 0xA0)] {
        let mut rig = with_spis();
        rig.write_all(&[(SPIS1 + register, psel(0, 20)), (SPIS1 + 0x28, 1)]);
        assert_eq!(transact(&mut rig, &[0xA0]), [back], "{register:#x}");
        assert_eq!(rig.memory(RX, 1), [received], "{register:#x}");
    }
    let mut rig = with_spis();
    rig.write_all(&[(SPIS1 + 0x514, psel(0, 20)), (SPIS1 + 0x28, 1)]);
    assert_eq!(transact(&mut rig, &[0xA0]), [None]);
}

#[test]
fn an_spis_whose_inputs_are_disconnected_hears_nothing_and_is_reported() {
    for (pin, back, received) in [(1, Some(0), 0), (3, Some(1), 0), (4, None, 0)] {
        let mut rig = with_spis();
        rig.write_all(&[(p1_cnf(pin), 2), (SPIS1 + 0x28, 1)]);
        assert_eq!(transact(&mut rig, &[0xA0]), [back], "P1.{pin:02}");
        assert_eq!(rig.memory(RX, 1), [received], "P1.{pin:02}");
        assert!(!rig.findings(FindingKind::Misuse).is_empty(), "P1.{pin:02}");
    }
}

#[test]
fn a_controller_in_another_mode_exchanges_shifted_bits() {
    // The SPIS is in mode 0.
    for (mode, back, received) in [
        (SpiMode::Mode0, [0xC1, 0x02], [0x81, 0x03]),
        (SpiMode::Mode3, [0x60, 0x81], [0x81, 0x03]),
        (SpiMode::Mode1, [0x60, 0x81], [0x40, 0x81]),
        (SpiMode::Mode2, [0x60, 0x81], [0x40, 0x81]),
    ] {
        let mut rig = with_spis();
        rig.fill(TX, &[0xC1, 0x02]);
        rig.write(SPIS1 + 0x28, 1);
        rig.run_for(10 * US);
        rig.select(CSN);
        rig.run_for(US);
        for (byte, wanted) in [0x81, 0x03].into_iter().zip(back) {
            rig.run_for(US);
            assert_eq!(rig.part.ssi_clock(rig.now, byte, mode, &mut rig.world), Some(wanted), "{mode:?}");
        }
        assert_eq!(rig.memory(RX, 2), received, "{mode:?}");
        assert_eq!(rig.findings(FindingKind::Misuse).len(), usize::from(mode != SpiMode::Mode0));
    }
}

#[test]
fn a_transaction_that_meets_the_cpu_reads_the_default_character_to_its_end() {
    let mut rig = with_spis();
    assert_eq!(rig.read(SPIS1 + 0x400), 1, "the CPU's after it is enabled");
    rig.run_for(10 * US);
    rig.select(CSN);
    rig.run_for(US);
    assert_eq!(clock(&mut rig, &[0xA0]), [Some(0xFF)]);
    rig.write(SPIS1 + 0x28, 1); // RELEASE in the middle: arbitration was at the edge of CSN
    assert_eq!(clock(&mut rig, &[0xA1, 0xA2]), [Some(0xFF), Some(0xFF)]);
    rig.deselect(CSN);
    assert_eq!(rig.memory(RX, 3), [0, 0, 0]);
    assert_eq!(rig.read(SPIS1 + 0x104), 0, "no END");
    assert_eq!(said(&mut rig), [SpisEvent::Busy, SpisEvent::Released, SpisEvent::Ready]);
    assert_eq!(transact(&mut rig, &[0xA0]), [Some(1)], "the next one is granted");
    rig.assert_clean();
}

#[test]
fn the_semaphore_goes_from_hand_to_hand_as_specified() {
    // What the CPU does in each state, and the state and ACQUIRED after it.
    const ACQUIRE: u32 = 0x24;
    const RELEASE: u32 = 0x28;
    let (free, cpu, spis, pending) = (0, 1, 2, 3);
    let table = [
        (cpu, ACQUIRE, cpu, 1),
        (cpu, RELEASE, free, 0),
        (free, ACQUIRE, cpu, 1),
        (free, RELEASE, free, 0),
        (spis, ACQUIRE, pending, 0),
        (spis, RELEASE, spis, 0),
        (pending, ACQUIRE, pending, 0),
        (pending, RELEASE, spis, 0),
    ];
    for (from, task, to, acquired) in table {
        let mut rig = with_spis();
        if from != cpu {
            rig.write(SPIS1 + RELEASE, 1);
        }
        if from == spis || from == pending {
            rig.select(CSN);
        }
        if from == pending {
            rig.write(SPIS1 + ACQUIRE, 1);
        }
        assert_eq!(rig.read(SPIS1 + 0x400), from);
        rig.write(SPIS1 + task, 1);
        assert_eq!((rig.read(SPIS1 + 0x400), rig.read(SPIS1 + 0x128)), (to, acquired), "from {from} by {task:#x}");
        // And when a transaction under way ends.
        rig.run_for(10 * US);
        rig.deselect(CSN);
        let after = if to == pending {
            cpu
        } else if to == spis {
            free
        } else {
            to
        };
        assert_eq!(rig.read(SPIS1 + 0x400), after, "from {from} by {task:#x}, after CSN");
        assert_eq!(rig.read(SPIS1 + 0x104), u32::from(from >= spis), "END");
    }
}

#[test]
fn end_and_acquired_come_together_with_the_shortcut_and_with_a_pending_acquire() {
    for shortcut in [true, false] {
        let mut rig = with_spis();
        rig.write_all(&[
            (SPIS1 + 0x200, u32::from(shortcut) << 2),
            (SPIS1 + 0x304, 1 << 1 | 1 << 10),
            (SPIS1 + 0x28, 1),
        ]);
        rig.run_for(10 * US);
        rig.select(CSN);
        if !shortcut {
            rig.write(SPIS1 + 0x24, 1);
        }
        assert!(!rig.line(4));
        rig.run_for(10 * US);
        rig.deselect(CSN);
        assert!(rig.line(4));
        assert_eq!((rig.read(SPIS1 + 0x104), rig.read(SPIS1 + 0x128)), (1, 1));
        assert_eq!(rig.read(SPIS1 + 0x400), 1, "the CPU's");
        rig.assert_clean();
    }
}

/// TIMER1 takes the SPIS from the controller `ticks` of 62.5 ns after it was started, through PPI alone.
fn expire_after(rig: &mut Rig, ticks: u32) {
    rig.write_all(&[
        (TIMER1 + 0x508, 3),
        (TIMER1 + 0x510, 0),
        (TIMER1 + 0x540, ticks),
        (PPI + 0x510, TIMER1 + 0x140),
        (PPI + 0x514, SPIS1 + 0x24), // ACQUIRE
        (PPI + 0x504, 1),
        (TIMER1, 1),
    ]);
}

#[test]
fn a_timer_takes_a_free_spis_through_ppi_and_what_is_read_from_then_on_is_the_default_character() {
    let mut rig = with_spis();
    rig.write(SPIS1 + 0x28, 1);
    expire_after(&mut rig, 16_000);
    assert_eq!(transact(&mut rig, &[0, 0]), [Some(1), Some(2)]);
    rig.run_to(MS - 1);
    assert_eq!((rig.read(SPIS1 + 0x400), rig.read(SPIS1 + 0x128)), (0, 0), "free");
    rig.run_to(MS);
    assert_eq!((rig.read(SPIS1 + 0x400), rig.read(SPIS1 + 0x128)), (1, 1), "the CPU's, ACQUIRED");
    for _ in 0..3 {
        assert_eq!(transact(&mut rig, &[0xA0, 0xA1]), [Some(0xFF); 2]);
    }
    assert_eq!(rig.read(SPIS1 + 0x440), 0, "a transaction that is not answered reads past nothing");
    assert_eq!((rig.read(SPIS1 + 0x53C), rig.read(SPIS1 + 0x54C)), (2, 2), "as the last one answered left them");
    // DEF is what the register says, not a constant of the part.
    rig.write(SPIS1 + 0x55C, 0x3C);
    assert_eq!(transact(&mut rig, &[0]), [Some(0x3C)]);
    rig.assert_clean();
}

#[test]
fn a_timer_that_takes_an_spis_in_mid_transaction_gets_it_at_the_end() {
    let mut rig = with_spis();
    rig.write(SPIS1 + 0x28, 1);
    expire_after(&mut rig, 16 * 14); // 14 us: in the third byte
    rig.run_for(10 * US);
    rig.select(CSN);
    rig.run_for(US);
    assert_eq!(clock(&mut rig, &[0, 0, 0, 0]), [Some(1), Some(2), Some(3), Some(4)], "it goes on to its end");
    assert_eq!((rig.read(SPIS1 + 0x400), rig.read(SPIS1 + 0x128)), (3, 0), "CPU pending");
    rig.run_for(US);
    rig.deselect(CSN);
    assert_eq!((rig.read(SPIS1 + 0x104), rig.read(SPIS1 + 0x128), rig.read(SPIS1 + 0x400)), (1, 1, 1));
    assert_eq!(transact(&mut rig, &[0, 0]), [Some(0xFF); 2]);
    rig.assert_clean();
}

#[test]
fn a_timer_started_anew_before_it_is_due_leaves_the_spis_alone() {
    let mut rig = with_spis();
    rig.write(SPIS1 + 0x28, 1);
    expire_after(&mut rig, 16_000);
    for _ in 0..10 {
        rig.run_for(900 * US);
        rig.write(TIMER1 + 0x0C, 1); // CLEAR
    }
    assert_eq!(transact(&mut rig, &[0]), [Some(1)]);
    rig.run_for(MS);
    assert_eq!(transact(&mut rig, &[0]), [Some(0xFF)]);
    rig.assert_clean();
}

#[test]
fn each_status_bit_is_set_by_its_own_buffer_and_cleared_by_a_one_alone() {
    // RXD.MAXCNT, TXD.MAXCNT, and STATUS after a transaction of four bytes: OVERREAD is bit 0, OVERFLOW bit 1.
    for (rx, tx, status) in [(4, 4, 0), (4, 3, 0b01), (3, 4, 0b10), (3, 3, 0b11), (0, 0, 0b11)] {
        let mut rig = with_spis();
        rig.write_all(&[(SPIS1 + 0x538, rx), (SPIS1 + 0x548, tx), (SPIS1 + 0x28, 1)]);
        transact(&mut rig, &[0; 4]);
        assert_eq!(rig.read(SPIS1 + 0x440), status, "{rx} {tx}");
        rig.write(SPIS1 + 0x440, 0);
        assert_eq!(rig.read(SPIS1 + 0x440), status, "a zero clears nothing");
        // They stand through a transaction that fits.
        transact(&mut rig, &[]);
        assert_eq!(rig.read(SPIS1 + 0x440), status);
        for bit in [0b01, 0b10] {
            rig.write(SPIS1 + 0x440, bit);
            assert_eq!(rig.read(SPIS1 + 0x440) & bit, 0);
        }
        assert_eq!(rig.read(SPIS1 + 0x440), 0);
        rig.assert_clean();
    }
}

#[test]
fn over_read_and_overflow_are_prevented_and_told() {
    let mut rig = with_spis();
    rig.write_all(&[(SPIS1 + 0x538, 2), (SPIS1 + 0x548, 3), (SPIS1 + 0x28, 1)]);
    let miso = transact(&mut rig, &[0xA0, 0xA1, 0xA2, 0xA3]);
    assert_eq!(miso, [Some(1), Some(2), Some(3), Some(0x5A)]);
    assert_eq!(rig.memory(RX, 4), [0xA0, 0xA1, 0, 0]);
    assert_eq!((rig.read(SPIS1 + 0x53C), rig.read(SPIS1 + 0x54C), rig.read(SPIS1 + 0x110)), (2, 3, 1));
    assert_eq!(rig.read(SPIS1 + 0x440), 0b11);
    rig.write(SPIS1 + 0x440, 0b01);
    assert_eq!(rig.read(SPIS1 + 0x440), 0b10);
    rig.assert_clean();
}

#[test]
fn a_buffer_in_flash_reads_the_over_read_character_and_is_reported() {
    let mut rig = with_spis();
    rig.write_all(&[(SPIS1 + 0x544, 0x0000_1000), (SPIS1 + 0x28, 1)]);
    assert_eq!(transact(&mut rig, &[0]), [Some(0x5A)]);
    assert_eq!(rig.findings(FindingKind::Unreachable).len(), 1);
}

#[test]
fn buffers_changed_without_the_semaphore_are_reported() {
    let mut rig = with_spis();
    rig.write(SPIS1 + 0x28, 1);
    rig.write(SPIS1 + 0x544, TX + 4);
    assert_eq!(rig.findings(FindingKind::Misuse).len(), 1);
}

#[test]
fn a_controller_that_breaks_the_timing_is_reported() {
    let mut rig = with_spis();
    rig.write(SPIS1 + 0x28, 1);
    rig.select(CSN);
    rig.run_for(2 * US - 8);
    rig.clock(0); // set-up time
    rig.run_for(US - 8);
    rig.clock(0); // rate
    rig.deselect(CSN);
    assert_eq!(rig.findings(FindingKind::Misuse).len(), 2);
}

#[test]
fn a_controller_that_keeps_the_timing_but_for_a_few_cycles_is_not_reported() {
    let mut rig = with_spis();
    rig.write(SPIS1 + 0x28, 1);
    rig.run_for(10 * US);
    rig.select(CSN);
    for cycles in [2 * US - 1, US - 1, US + 1] {
        rig.run_for(cycles);
        rig.clock(0);
    }
    rig.assert_clean();
}

#[test]
fn another_chip_select_reaches_no_spis() {
    let mut rig = with_spis();
    rig.write(SPIS1 + 0x28, 1);
    rig.select(Pin::new(1, 6));
    assert_eq!(rig.clock(0), None);
}

/// UARTE0 at 1 Mbit/s, 10 us a byte, on P0.06 and P0.08.
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
    // CONFIG, what arrives, what is received, ERRORSRC.
    let cases = [
        (0, frame(0x55, 1_000_000), 0x55, 0),
        (0, frame(0x55, 1_030_000), 0x55, 0),
        (0xE, even, 0x07, 0),
        (0xE, odd, 0x07, 1 << 1),
        // A parity bit where a stop bit is expected.
        (0, UartFrame { parity: UartParity::Even, ..frame(0x03, 1_000_000) }, 0x03, 1 << 2),
        // Half the rate: each bit is seen twice, the start bit as well.
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
fn a_uart_without_the_crystal_is_as_far_off_as_the_internal_oscillator() {
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
fn with_flow_control_cts_holds_the_next_byte_back_and_rts_says_there_is_room() {
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
    rig.drive(cts, true); // in the second byte, which leaves all the same
    rig.run_for(MS);
    let sent: Vec<_> = rig.world.sent.iter().map(|(at, _, frame)| (*at - MS, frame.data as u8)).collect();
    assert_eq!(sent, [(10 * US, b'h'), (20 * US, b'i')]);
    assert_eq!((rig.read(UARTE0 + 0x100), rig.read(UARTE0 + 0x104)), (1, 1), "CTS, NCTS");
    // Three bytes into a buffer of one: with two in the FIFO there is room for four.
    rig.write_all(&[(UARTE0 + 0x534, RX), (UARTE0 + 0x538, 1), (UARTE0, 1)]);
    assert!(!rig.part.pin(rts));
    for (byte, ready) in [(b'a', true), (b'b', true), (b'c', true), (b'd', false)] {
        receive(&mut rig, &[byte]);
        assert_eq!(rig.part.pin(rts), !ready, "{byte}");
    }
    rig.assert_clean();
}

/// TWIS0 at 0x1A and 0x1B on P0.14 and P0.16, with 2 bytes each way.
fn with_target() -> Rig {
    let mut rig = Rig::new();
    rig.write_all(&[(p0_cnf(14), INPUT), (p0_cnf(16), INPUT), (SPIM0 + 0x508, 14), (SPIM0 + 0x50C, 16)]);
    rig.write_all(&[(SPIM0 + 0x588, 0x1A), (SPIM0 + 0x58C, 0x1B), (SPIM0 + 0x594, 3), (SPIM0 + 0x5C0, 0x5A)]);
    rig.write_all(&[(SPIM0 + 0x534, RX), (SPIM0 + 0x538, 2), (SPIM0 + 0x544, TX), (SPIM0 + 0x548, 2)]);
    rig.fill(TX, &[7, 8]);
    rig.write(SPIM0 + 0x500, 9);
    rig
}

/// What the TWIS answers: whether it acknowledges, and the byte; `None` while it holds SCL.
fn bus(rig: &mut Rig, event: I2cEvent) -> Option<(bool, u8)> {
    rig.run_for(90 * US);
    let answer = rig.part.two_wire(rig.now, Pin::new(0, 14), Pin::new(0, 16), event, &mut rig.world);
    answer.map(|answer| (answer.acknowledged, answer.data))
}

#[test]
fn a_target_answers_its_addresses_from_the_buffers_it_was_given_and_holds_scl_until_then() {
    use I2cEvent::{Read, Start, Stop, Write};
    const NOBODY: Option<(bool, u8)> = Some((false, 0xFF));
    const YES: Option<(bool, u8)> = Some((true, 0xFF));
    let mut rig = with_target();
    assert_eq!(bus(&mut rig, Start(0x19 << 1)), NOBODY);
    assert_eq!(bus(&mut rig, Start(0x1B << 1)), YES);
    assert_eq!((rig.read(SPIM0 + 0x4D4), rig.read(SPIM0 + 0x164), rig.read(SPIM0 + 0x14C)), (1, 1, 0));
    assert_eq!(bus(&mut rig, Write(0x11)), None, "no buffer");
    rig.write(SPIM0 + 0x30, 1);
    assert_eq!(rig.read(SPIM0 + 0x14C), 1, "RXSTARTED");
    assert_eq!([0x11, 0x22].map(|byte| bus(&mut rig, Write(byte))), [YES, YES]);
    assert_eq!(rig.read(SPIM0 + 0x124), 0);
    assert_eq!(bus(&mut rig, Write(0x33)), NOBODY, "RXD is full");
    assert_eq!((rig.read(SPIM0 + 0x124), rig.read(SPIM0 + 0x4D0)), (1, 0b101), "ERROR: OVERFLOW, DNACK");
    // A repeated start; SHORTS READ_SUSPEND.
    rig.write(SPIM0 + 0x4D0, 0b101);
    rig.write_all(&[(SPIM0 + 0x200, 1 << 14), (SPIM0 + 0x34, 1)]);
    assert_eq!(bus(&mut rig, Start(0x1A << 1 | 1)), YES);
    assert_eq!(rig.memory(RX, 3), [0x11, 0x22, 0]);
    assert_eq!(rig.read(SPIM0 + 0x53C), 2, "RXD.AMOUNT");
    assert_eq!((rig.read(SPIM0 + 0x168), rig.read(SPIM0 + 0x150), rig.read(SPIM0 + 0x104)), (1, 0, 0));
    assert_eq!(bus(&mut rig, Read(true)), None, "suspended");
    rig.write(SPIM0 + 0x20, 1);
    assert_eq!(rig.read(SPIM0 + 0x150), 1, "TXSTARTED");
    assert_eq!([7, 8, 0x5A].map(|_| bus(&mut rig, Read(true))), [7, 8, 0x5A].map(|byte| Some((true, byte))));
    assert_eq!(rig.read(SPIM0 + 0x4D0), 0b1000, "OVERREAD");
    assert_eq!(bus(&mut rig, Stop), NOBODY);
    assert_eq!((rig.read(SPIM0 + 0x54C), rig.read(SPIM0 + 0x104)), (2, 1), "TXD.AMOUNT, STOPPED");
    rig.assert_clean();
}
