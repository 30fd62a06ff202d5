//! Tests of SPIS with a controller: buffers, semaphore, PPI, misuse.
use crate::rig::*;
use emulator_part::{FindingKind, Pin, SpiMode};
use nrf52840::SpisEvent;

/// Returns a part with SPIS1 on P1.01 to P1.04 and buffers of 8 bytes. The CPU still holds the semaphore.
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

/// Makes one transaction of `mosi` at 8 MHz. Returns the bytes from the SPIS.
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
    // With the shortcut END_ACQUIRE the CPU gets the semaphore when a transaction ends.
    rig.write(SPIS1 + 0x200, 1 << 2);
    transact(&mut rig, &[0xA0]);
    assert_eq!(said(&mut rig), [SpisEvent::End { rx: 1, tx: 1 }, SpisEvent::Held]);
    rig.assert_clean();
}

/// Bytes that are exchanged many at a time must equal bytes exchanged one by one, in granted and other transactions,
/// within the buffers and past their ends.
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
            let run = (mosi.len() - done).min(together.part.spis_quiet());
            let first = began + US * (done as u64 + 1);
            let (sent, got) = (&mosi[done..done + run], &mut miso[done..done + run]);
            let driven = together.part.spis_exchange(first, US << 16, SpiMode::Mode0, sent, got, &mut together.world);
            assert!(driven);
            done += run;
            runs.push(run);
        }
        together.run_to(began + US * (mosi.len() as u64 + 1));
        together.deselect(CSN);

        // RXD has 8 bytes, so an exchange of many bytes stops at the eighth, which raises ENDRX.
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
    // Each row has the PSEL register that is set wrongly, the byte that the SPIS sends, and the byte that it receives.
    // An SPIS without SCK sends a constant byte. A wrong MOSI changes only the received byte.
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
            assert_eq!(rig.part.spis_clock(rig.now, byte, mode, &mut rig.world), Some(wanted), "{mode:?}");
        }
        assert_eq!(rig.memory(RX, 2), received, "{mode:?}");
        assert_eq!(rig.findings(FindingKind::Misuse).len(), usize::from(mode != SpiMode::Mode0));
    }
}

#[test]
fn an_spis_held_by_the_cpu_answers_the_default_character_throughout() {
    let mut rig = with_spis();
    assert_eq!(rig.read(SPIS1 + 0x400), 1, "the CPU's after it is enabled");
    rig.run_for(10 * US);
    rig.select(CSN);
    rig.run_for(US);
    assert_eq!(clock(&mut rig, &[0xA0]), [Some(0xFF)]);
    rig.write(SPIS1 + 0x28, 1); // RELEASE in the middle: CSN's edge has already arbitrated
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
    // Each row has a state, an action of the CPU in it, the next state, and whether ACQUIRED is raised.
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
        // When the transaction has ended, the row's next state must change to the state `after`.
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
fn end_and_acquired_come_together_with_shortcut_or_pending_acquire() {
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

/// Makes TIMER1 take the SPIS from the controller through PPI, `ticks` of 62.5 ns after the timer's start.
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
fn a_free_spis_taken_by_a_timer_answers_the_default_character() {
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
    // A different DEF shows that the answer comes from this register.
    rig.write(SPIS1 + 0x55C, 0x3C);
    assert_eq!(transact(&mut rig, &[0]), [Some(0x3C)]);
    rig.assert_clean();
}

#[test]
fn a_timer_takes_a_busy_spis_after_its_transaction() {
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
fn each_status_bit_stays_until_a_one_clears_it() {
    // Each row has RXD.MAXCNT, TXD.MAXCNT, and STATUS after a transaction of four bytes, with OVERREAD in bit 0 and
    // OVERFLOW in bit 1.
    for (rx, tx, status) in [(4, 4, 0), (4, 3, 0b01), (3, 4, 0b10), (3, 3, 0b11), (0, 0, 0b11)] {
        let mut rig = with_spis();
        rig.write_all(&[(SPIS1 + 0x538, rx), (SPIS1 + 0x548, tx), (SPIS1 + 0x28, 1)]);
        transact(&mut rig, &[0; 4]);
        assert_eq!(rig.read(SPIS1 + 0x440), status, "{rx} {tx}");
        rig.write(SPIS1 + 0x440, 0);
        assert_eq!(rig.read(SPIS1 + 0x440), status, "a zero clears nothing");
        // A transaction that fits the buffers leaves the status bits as they are.
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
fn a_controller_a_cycle_off_the_timing_is_not_reported() {
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
fn chip_select_without_a_clock_ends_a_granted_transaction_of_no_bytes() {
    let mut rig = with_spis();
    // The shortcut from END to ACQUIRE is set. The SPIS holds the semaphore.
    rig.write_all(&[(SPIS1 + 0x200, 1 << 2), (SPIS1 + 0x28, 1)]);
    for ended in [1, 0, 0] {
        rig.select(CSN);
        rig.run_for(10);
        rig.deselect(CSN);
        let seen = [0x104, 0x128, 0x400, 0x53C, 0x54C].map(|offset| rig.read(SPIS1 + offset));
        assert_eq!(seen, [ended, ended, 1, 0, 0], "END, ACQUIRED, SEMSTAT (the CPU), AMOUNT of RXD and TXD");
        rig.write_all(&[(SPIS1 + 0x104, 0), (SPIS1 + 0x128, 0)]);
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
