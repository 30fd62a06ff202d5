//! Tests of GPIO and GPIOTE.
use crate::rig::*;
use emulator_part::{FindingKind, Pad, Part, Pin};

const LED: Pin = Pin::new(0, 13);
const BUTTON: Pin = Pin::new(1, 5);

#[test]
fn an_output_follows_out_set_and_clear() {
    let mut rig = Rig::new();
    rig.write(P0 + 0x508, 1 << 13);
    assert!(!rig.part.pin(LED), "an input is not driven by OUT");
    rig.run_for(US);
    rig.write(P0 + 0x518, 1 << 13);
    rig.run_for(US);
    rig.write(P0 + 0x50C, 1 << 13);
    assert_eq!(rig.world.pins, [(US, LED, Pad::Driven(true)), (2 * US, LED, Pad::Driven(false))]);
    rig.assert_clean();
}

#[test]
fn direction_is_one_bit_in_two_registers() {
    let mut rig = Rig::new();
    rig.write(P1 + 0x700 + 4 * 5, 1 | 3 << 2);
    assert_eq!(rig.read(P1 + 0x514), 1 << 5);
    rig.write(P1 + 0x51C, 1 << 5);
    assert_eq!(rig.read(P1 + 0x700 + 4 * 5), 3 << 2);
    rig.write(P1 + 0x514, 0xFFFF_FFFF);
    assert_eq!(rig.read(P1 + 0x514), 0xFFFF, "P1 has 16 pins");
}

#[test]
fn an_input_reads_only_with_its_buffer_connected() {
    let mut rig = Rig::new();
    rig.drive(BUTTON, true);
    assert_eq!(rig.read(P1 + 0x510), 0);
    rig.write(P1 + 0x700 + 4 * 5, 0);
    assert_eq!(rig.read(P1 + 0x510), 1 << 5);
    rig.release(BUTTON);
    assert_eq!(rig.read(P1 + 0x510), 0);
    rig.write(P1 + 0x700 + 4 * 5, 3 << 2);
    assert_eq!(rig.read(P1 + 0x510), 1 << 5, "pulled up");
}

#[test]
fn an_open_drain_output_lets_others_drive_its_line() {
    let mut rig = Rig::new();
    rig.write_all(&[(P1 + 0x508, 1 << 5), (P1 + 0x700 + 4 * 5, 1 | 3 << 2 | 6 << 8)]); // S0D1, pulled up
    assert!(rig.part.pin(BUTTON));
    rig.drive(BUTTON, false);
    assert!(!rig.part.pin(BUTTON));
    rig.assert_clean();
    rig.write(P1 + 0x700 + 4 * 5, 1); // S0S1 now, so both ends drive
    assert_eq!(rig.findings(FindingKind::Misuse).len(), 1);
}

#[test]
fn each_polarity_hears_its_edges_only() {
    for (polarity, on_rise, on_fall) in [(1, 1, 0), (2, 0, 1), (3, 1, 1)] {
        let mut rig = Rig::new();
        rig.write(p1_cnf(5), INPUT);
        rig.write_all(&[(GPIOTE + 0x510, 1 | psel(1, 5) << 8 | polarity << 16), (GPIOTE + 0x304, 1)]);
        rig.run_for(US);
        rig.drive(BUTTON, true);
        assert_eq!(rig.read(GPIOTE + 0x100), on_rise, "polarity {polarity}");
        assert_eq!(rig.line(6), on_rise == 1);
        rig.write(GPIOTE + 0x100, 0);
        rig.drive(BUTTON, true);
        assert_eq!(rig.read(GPIOTE + 0x100), 0, "the same level again is no edge");
        rig.drive(BUTTON, false);
        assert_eq!(rig.read(GPIOTE + 0x100), on_fall, "polarity {polarity}");
    }
}

#[test]
fn a_channel_set_up_on_a_high_pin_waits_for_an_edge() {
    let mut rig = Rig::new();
    rig.write(p1_cnf(5), INPUT);
    rig.drive(BUTTON, true);
    rig.write(GPIOTE + 0x510, 1 | psel(1, 5) << 8 | 1 << 16);
    assert_eq!(rig.read(GPIOTE + 0x100), 0);
    rig.drive(BUTTON, false);
    rig.drive(BUTTON, true);
    assert_eq!(rig.read(GPIOTE + 0x100), 1);
}

#[test]
fn a_task_channel_drives_its_pin_and_gives_it_back() {
    let mut rig = Rig::new();
    rig.write(GPIOTE + 0x514, 3 | psel(0, 13) << 8 | 3 << 16 | 1 << 20); // channel 1, toggle, starts high
    assert!(rig.part.pin(LED));
    rig.write(GPIOTE + 0x04, 1);
    assert!(!rig.part.pin(LED));
    rig.write(GPIOTE + 0x34, 1);
    assert!(rig.part.pin(LED));
    rig.write(GPIOTE + 0x64, 1);
    assert!(!rig.part.pin(LED));
    rig.write_all(&[(P0 + 0x508, 1 << 13), (P0 + 0x518, 1 << 13)]);
    assert!(!rig.part.pin(LED), "OUT has no say while the channel has the pin");
    rig.write(GPIOTE + 0x514, 0);
    assert!(rig.part.pin(LED));
    rig.assert_clean();
}

#[test]
fn a_timer_toggles_a_pin_through_ppi_at_exact_instants() {
    let mut rig = Rig::new();
    rig.write_all(&[
        (GPIOTE + 0x510, 3 | psel(0, 13) << 8 | 3 << 16),
        (PPI + 0x510, TIMER0 + 0x140),
        (PPI + 0x514, GPIOTE),
        (PPI + 0x504, 1),
        (TIMER0 + 0x508, 3),
        (TIMER0 + 0x510, 0),
        (TIMER0 + 0x540, 8),
        (TIMER0 + 0x200, 1),
        (TIMER0, 1),
    ]);
    rig.run_to(2 * US);
    let changes: Vec<_> = rig.world.pins.iter().map(|&(at, _, pad)| (at, pad.level())).collect();
    assert_eq!(changes, [(0, false), (32, true), (64, false), (96, true), (128, false)]);
}

#[test]
fn sense_latches_and_raises_port_once_until_detect_falls() {
    let mut rig = Rig::new();
    rig.write_all(&[(P1 + 0x700 + 4 * 5, 2 << 16), (P0 + 0x700 + 4 * 3, 2 << 16)]);
    rig.drive(BUTTON, true);
    assert_eq!(rig.read(GPIOTE + 0x17C), 1);
    assert_eq!(rig.read(P1 + 0x520), 1 << 5);
    rig.write(GPIOTE + 0x17C, 0);
    rig.drive(Pin::new(0, 3), true);
    assert_eq!(rig.read(GPIOTE + 0x17C), 0, "DETECT was high already");
    assert_eq!(rig.read(P0 + 0x520), 1 << 3);
    rig.write(P1 + 0x520, 1 << 5);
    assert_eq!(rig.read(P1 + 0x520), 1 << 5, "still sensed, so latched again");
    rig.drive(BUTTON, false);
    rig.write(P1 + 0x520, 1 << 5);
    assert_eq!(rig.read(P1 + 0x520), 0);
    rig.assert_clean();
}

#[test]
fn detect_from_latch_rises_again_for_what_is_left() {
    let mut rig = Rig::new();
    rig.write_all(&[(P1 + 0x524, 1), (P1 + 0x700 + 4 * 5, 2 << 16), (P1 + 0x700 + 4 * 6, 2 << 16)]);
    rig.drive(BUTTON, true);
    rig.drive(Pin::new(1, 6), true);
    rig.drive(BUTTON, false);
    rig.drive(Pin::new(1, 6), false);
    rig.write(GPIOTE + 0x17C, 0);
    rig.write(P1 + 0x520, 1 << 5);
    assert_eq!(rig.read(GPIOTE + 0x17C), 1, "pin 6 is latched still");
    rig.write(GPIOTE + 0x17C, 0);
    rig.write(P1 + 0x520, 1 << 6);
    assert_eq!(rig.read(GPIOTE + 0x17C), 0);
}
