//! SPIM with a chip on its bus, SPIS with a controller on its, UARTE with a far end.
use crate::rig::*;
use nrf52840_model::{Finding, FindingKind, Nrf52840, Pin, Settings, SpiBus, SpiMode, SpisEvent};
use rigless::time::VirtualNanos;

const TX: u32 = RAM + 0x100;
const RX: u32 = RAM + 0x200;
const CSN: Pin = Pin::p1(4);

/// A part with a recording chip on P1.12 to P1.15, wanting mode 1, and SPIM0 set up for it at 8 MHz.
fn with_chip() -> Rig {
    let mut part = Nrf52840::new(Settings { hfint_ppb: 0, ..Settings::default() });
    let bus = SpiBus { sck: SCK, mosi: MOSI, miso: MISO, cs: CS, mode: SpiMode::Mode1 };
    assert_eq!(part.attach_spi(bus, Recorder::new()), 0);
    let mut rig = Rig::of(part);
    set_up(&mut rig, SPIM0);
    rig
}

fn set_up(rig: &mut Rig, spim: u32) {
    rig.write_all(&[
        (P1 + 0x508, 1 << 12),
        (P1 + 0x518, 1 << 12),
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
    rig.part().chip_mut::<Recorder>(0).expect("the chip is a recorder").seen.clone()
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
    rig.run_to(3_999);
    assert_eq!(rig.ram(RX, 3), [0xA5, 0, 0], "the first byte is in RAM as it ends");
    rig.run_to(5_000);
    assert!(rig.line(3));
    assert_eq!(rig.read(SPIM0 + 0x110) + rig.read(SPIM0 + 0x118) + rig.read(SPIM0 + 0x120), 3, "ENDRX, END, ENDTX");
    assert_eq!(rig.ram(RX, 3), [0xA5, 0xEE, 0xDD]);
    assert_eq!((rig.read(SPIM0 + 0x54C), rig.read(SPIM0 + 0x53C)), (3, 3));
    rig.write(P1 + 0x508, 1 << 12);
    let wanted = [
        Seen::Select(0),
        Seen::Byte(3_000, 0x11), // 1 us of start-up, then 1 us a byte
        Seen::Byte(4_000, 0x22),
        Seen::Byte(5_000, 0x33),
        Seen::Deselect(5_000),
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
    assert_eq!(rig.ram(RX, 4), [0xA5, 0xEE, 0x88, 0]);
    rig.write_all(&[(SPIM0 + 0x548, 3), (SPIM0 + 0x538, 1), (SPIM0 + 0x534, RX + 8), (SPIM0 + 0x10, 1)]);
    rig.run_to(20 * US);
    assert_eq!((rig.read(SPIM0 + 0x53C), rig.read(SPIM0 + 0x54C)), (1, 3));
    assert_eq!(rig.ram(RX + 9, 2), [0, 0]);
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
    assert_eq!(rig.ram(RX, 4), [0xA5, !1, !2, !3]);
}

#[test]
fn stop_ends_after_the_byte_under_way_and_ends_both_buffers() {
    let mut rig = with_chip();
    rig.write_all(&[(SPIM0 + 0x548, 100), (SPIM0 + 0x538, 100), (P1 + 0x50C, 1 << 12), (SPIM0 + 0x10, 1)]);
    rig.run_to(4_500);
    rig.write(SPIM0 + 0x14, 1);
    assert_eq!(rig.run_until_set(SPIM0 + 0x104, MS), 5 * US);
    assert_eq!((rig.read(SPIM0 + 0x110), rig.read(SPIM0 + 0x120), rig.read(SPIM0 + 0x118)), (1, 1, 0));
    assert_eq!(rig.read(SPIM0 + 0x53C), 4);
}

#[test]
fn suspend_holds_between_two_bytes_until_resume() {
    let mut rig = with_chip();
    rig.write_all(&[(SPIM0 + 0x548, 2), (SPIM0 + 0x538, 2), (P1 + 0x50C, 1 << 12), (SPIM0 + 0x10, 1)]);
    rig.run_to(1_500);
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
    assert_eq!(rig.ram(RX, 1), [0xA5_u8.reverse_bits()]);
}

#[test]
fn a_chip_on_other_pins_or_not_selected_hears_nothing() {
    let mut rig = with_chip();
    rig.write_all(&[(SPIM0 + 0x548, 1), (SPIM0 + 0x538, 1), (SPIM0 + 0x10, 1)]);
    rig.run_to(10 * US);
    assert_eq!(seen(&mut rig), []);
    rig.write_all(&[(P1 + 0x50C, 1 << 12), (SPIM0 + 0x500, 0), (SPIM0 + 0x508, psel(0, 2)), (SPIM0 + 0x500, 7)]);
    rig.write(SPIM0 + 0x10, 1);
    rig.run_to(20 * US);
    assert_eq!(seen(&mut rig), [Seen::Select(10 * US)]);
    rig.assert_clean();
}

#[test]
fn misuse_of_the_controller_is_reported() {
    let cases: [(&str, &[(u32, u32)]); 4] = [
        ("another SPI mode", &[(SPIM0 + 0x554, 0), (P1 + 0x50C, 1 << 12), (SPIM0 + 0x10, 1)]),
        ("outside data RAM", &[(SPIM0 + 0x544, 0x1000), (SPIM0 + 0x10, 1)]),
        ("not enabled", &[(SPIM0 + 0x500, 0), (SPIM0 + 0x10, 1)]),
        ("FREQUENCY", &[(SPIM0 + 0x524, 0x0A00_0000), (SPIM0 + 0x10, 1)]),
    ];
    for (what, writes) in cases {
        let mut rig = with_chip();
        rig.write_all(&[(SPIM0 + 0x548, 1), (SPIM0 + 0x538, 1)]);
        rig.write_all(writes);
        rig.run_to(10 * US);
        let found = rig.findings(FindingKind::Misuse);
        assert!(matches!(found[..], [Finding { what: said, .. }] if said.contains(what)), "{what}: {found:?}");
    }
}

#[test]
fn spim3_runs_at_32_mhz_drives_its_select_and_its_anomaly_is_named() {
    let mut rig = with_chip();
    rig.fill(TX, &[9, 8]);
    rig.write(SPIM0 + 0x500, 0);
    rig.write(P1 + 0x51C, 1 << 12);
    set_up(&mut rig, SPIM3);
    rig.write_all(&[
        (SPIM3 + 0x500, 0),
        (SPIM3 + 0x514, psel(1, 12)),
        (SPIM3 + 0x524, 0x1400_0000),
        (SPIM3 + 0x500, 7),
    ]);
    rig.write_all(&[(SPIM3 + 0x548, 2), (SPIM3 + 0x538, 2), (SPIM3 + 0x10, 1)]);
    rig.run_to(5 * US);
    let wanted = [Seen::Select(0), Seen::Byte(1_250, 9), Seen::Byte(1_500, 8), Seen::Deselect(1_500)];
    assert_eq!(seen(&mut rig), wanted);
    assert_eq!(rig.findings(FindingKind::Anomaly).len(), 1);
}

/// SPIS1 on P1.01 to P1.04, with 8 bytes each way, still the CPU's.
fn with_spis() -> Rig {
    let mut rig = Rig::new();
    rig.write_all(&[
        (SPIS1 + 0x508, psel(1, 1)),
        (SPIS1 + 0x50C, psel(1, 3)),
        (SPIS1 + 0x510, psel(1, 2)),
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
    rig.input(|part, at| part.ssi_deselect(at, CSN));
    rig
}

/// One transaction of `mosi` at 8 MHz, and what came back.
fn transact(rig: &mut Rig, mosi: &[u8]) -> Vec<Option<u8>> {
    rig.run_for(10 * US);
    rig.input(|part, at| part.ssi_select(at, CSN));
    rig.run_for(US);
    let miso = clock(rig, mosi);
    rig.run_for(US);
    rig.input(|part, at| part.ssi_deselect(at, CSN));
    miso
}

fn clock(rig: &mut Rig, mosi: &[u8]) -> Vec<Option<u8>> {
    mosi.iter()
        .map(|&byte| {
            rig.run_for(US);
            rig.input(|part, at| part.ssi_clock(at, byte))
        })
        .collect()
}

fn said(rig: &mut Rig) -> Vec<SpisEvent> {
    rig.part()
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
    assert_eq!(rig.ram(RX, 4), [0xA0, 0xA1, 0xA2, 0]);
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
        together.input(|part, at| part.ssi_select(at, CSN));
        let began = together.now + US;
        let (mut miso, mut left, mut runs) = (vec![], &mosi[..], vec![]);
        while !left.is_empty() {
            let quiet = together.input(|part, _| part.ssi_quiet());
            let (run, rest) = left.split_at(left.len().min(quiet));
            together.run_for(US * run.len() as u64 + if miso.is_empty() { US } else { 0 });
            together.input_with_memory(|part, memory, _| {
                for &byte in run {
                    let ends = began + US * (miso.len() as u64 + 1);
                    miso.push(part.ssi_exchange(VirtualNanos(ends), byte, memory));
                }
            });
            runs.push(run.len());
            left = rest;
        }
        together.run_for(US);
        together.input(|part, at| part.ssi_deselect(at, CSN));

        // RXD takes 8, and ENDRX comes with the eighth.
        assert_eq!(runs, if granted { vec![8, 3] } else { vec![11] });
        assert_eq!(miso, alone);
        assert_eq!(together.ram(RX, 9), one_by_one.ram(RX, 9));
        for register in [0x104, 0x110, 0x400, 0x440, 0x53C, 0x54C] {
            assert_eq!(together.read(SPIS1 + register), one_by_one.read(SPIS1 + register), "{register:#x}");
        }
        assert_eq!(said(&mut together), said(&mut one_by_one));
        together.assert_clean();
    }
}

#[test]
fn a_transaction_that_meets_the_cpu_reads_the_default_character_to_its_end() {
    let mut rig = with_spis();
    assert_eq!(rig.read(SPIS1 + 0x400), 1, "the CPU's after it is enabled");
    rig.run_for(10 * US);
    rig.input(|part, at| part.ssi_select(at, CSN));
    rig.run_for(US);
    assert_eq!(clock(&mut rig, &[0xA0]), [Some(0xFF)]);
    rig.write(SPIS1 + 0x28, 1); // RELEASE in the middle: arbitration was at the edge of CSN
    assert_eq!(clock(&mut rig, &[0xA1, 0xA2]), [Some(0xFF), Some(0xFF)]);
    rig.input(|part, at| part.ssi_deselect(at, CSN));
    assert_eq!(rig.ram(RX, 3), [0, 0, 0]);
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
            rig.input(|part, at| part.ssi_select(at, CSN));
        }
        if from == pending {
            rig.write(SPIS1 + ACQUIRE, 1);
        }
        assert_eq!(rig.read(SPIS1 + 0x400), from);
        rig.write(SPIS1 + task, 1);
        assert_eq!((rig.read(SPIS1 + 0x400), rig.read(SPIS1 + 0x128)), (to, acquired), "from {from} by {task:#x}");
        // And when a transaction under way ends.
        rig.run_for(10 * US);
        rig.input(|part, at| part.ssi_deselect(at, CSN));
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
        rig.input(|part, at| part.ssi_select(at, CSN));
        if !shortcut {
            rig.write(SPIS1 + 0x24, 1);
        }
        assert!(!rig.line(4));
        rig.run_for(10 * US);
        rig.input(|part, at| part.ssi_deselect(at, CSN));
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
    rig.input(|part, at| part.ssi_select(at, CSN));
    rig.run_for(US);
    assert_eq!(clock(&mut rig, &[0, 0, 0, 0]), [Some(1), Some(2), Some(3), Some(4)], "it goes on to its end");
    assert_eq!((rig.read(SPIS1 + 0x400), rig.read(SPIS1 + 0x128)), (3, 0), "CPU pending");
    rig.run_for(US);
    rig.input(|part, at| part.ssi_deselect(at, CSN));
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
    assert_eq!(rig.ram(RX, 4), [0xA0, 0xA1, 0, 0]);
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
    assert_eq!(rig.findings(FindingKind::Misuse).len(), 1);
}

#[test]
fn buffers_changed_without_the_semaphore_are_reported() {
    let mut rig = with_spis();
    rig.write(SPIS1 + 0x28, 1);
    rig.write(SPIS1 + 0x544, TX + 4);
    assert_eq!(rig.findings(FindingKind::Misuse).len(), 1);
}

#[test]
fn a_controller_that_breaks_the_timing_or_the_mode_is_reported() {
    let mut rig = with_spis();
    rig.write(SPIS1 + 0x28, 1);
    rig.input(|part, at| part.ssi_select(at, CSN));
    rig.run_for(1_899);
    rig.input(|part, at| part.ssi_clock(at, 0)); // set-up time
    rig.run_for(899);
    rig.input(|part, at| part.ssi_clock(at, 0)); // rate
    rig.input(|part, at| part.ssi_deselect(at, CSN));
    rig.write(SPIS1 + 0x554, 0b010);
    rig.input(|part, at| part.ssi_select(at, CSN)); // mode
    assert_eq!(rig.findings(FindingKind::Misuse).len(), 3);
}

#[test]
fn a_controller_that_keeps_the_timing_but_for_a_cycle_of_the_core_is_not_reported() {
    let mut rig = with_spis();
    rig.write(SPIS1 + 0x28, 1);
    rig.run_for(10 * US);
    rig.input(|part, at| part.ssi_select(at, CSN));
    for ns in [1_985, 985, 1_015] {
        rig.run_for(ns);
        rig.input(|part, at| part.ssi_clock(at, 0));
    }
    rig.assert_clean();
}

#[test]
fn another_chip_select_reaches_no_spis() {
    let mut rig = with_spis();
    rig.write(SPIS1 + 0x28, 1);
    rig.input(|part, at| part.ssi_select(at, Pin::p1(6)));
    assert_eq!(rig.input(|part, at| part.ssi_clock(at, 0)), None);
}

/// UARTE0 at 1 Mbit/s, 10 us a byte.
fn with_uart() -> Rig {
    let mut rig = Rig::new();
    rig.write_all(&[(UARTE0 + 0x50C, 6), (UARTE0 + 0x514, 8), (UARTE0 + 0x524, 0x1000_0000), (UARTE0 + 0x500, 8)]);
    rig
}

#[test]
fn a_uart_sends_a_buffer_byte_by_byte() {
    let mut rig = with_uart();
    rig.fill(TX, b"hi!");
    rig.write_all(&[(UARTE0 + 0x544, TX), (UARTE0 + 0x548, 3), (UARTE0 + 0x08, 1)]);
    assert_eq!(rig.run_until_set(UARTE0 + 0x120, MS), 30 * US);
    let sent: Vec<_> = rig.part().take_uart_sent().iter().map(|sent| (sent.at, sent.byte)).collect();
    assert_eq!(sent, [(10 * US, b'h'), (20 * US, b'i'), (30 * US, b'!')]);
    assert_eq!(rig.read(UARTE0 + 0x54C), 3);
    rig.write(UARTE0 + 0x0C, 1);
    assert_eq!(rig.read(UARTE0 + 0x158), 1, "TXSTOPPED");
    rig.assert_clean();
}

fn receive(rig: &mut Rig, bytes: &[u8]) {
    for &byte in bytes {
        rig.run_for(10 * US);
        rig.input(|part, at: VirtualNanos| part.uart_receive(at, 0, byte));
    }
}

#[test]
fn a_uart_receives_across_two_buffers_and_times_out_after_stop() {
    let mut rig = with_uart();
    rig.write_all(&[(UARTE0 + 0x534, RX), (UARTE0 + 0x538, 2), (UARTE0, 1)]);
    receive(&mut rig, b"abc");
    assert_eq!(rig.read(UARTE0 + 0x110), 1, "ENDRX");
    rig.write_all(&[(UARTE0 + 0x110, 0), (UARTE0 + 0x534, RX + 2), (UARTE0 + 0x538, 4), (UARTE0, 1)]);
    receive(&mut rig, b"d");
    assert_eq!(rig.ram(RX, 5), b"abcd\0", "the FIFO bridged the gap");
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
