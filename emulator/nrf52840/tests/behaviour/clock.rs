//! Tests of CLOCK, POWER, and registers of all blocks.
use crate::rig::*;
use cortex_m4::Width;
use emulator_part::{FindingKind, Part, Reset};
use nrf52840::Settings;

#[test]
fn the_crystals_start_after_their_time_and_say_so() {
    let mut rig = Rig::new();
    assert_eq!(rig.read(POWER + 0x40C), 1 << 16, "HFCLK runs from HFINT");
    rig.write_all(&[(POWER + 0x304, 0b11), (POWER, 1), (POWER + 0x518, 1), (POWER + 0x08, 1)]);
    assert_eq!(rig.read(POWER + 0x41C), 1, "the copy of LFCLKSRC");
    assert_eq!(rig.run_until_set(POWER + 0x100, MS), 360 * US);
    assert!(rig.line(0));
    assert_eq!(rig.read(POWER + 0x418), 1 << 16, "the RC oscillator stands in for the crystal");
    rig.write(POWER + 0x100, 0);
    assert!(!rig.line(0));
    assert_eq!(rig.run_until_set(POWER + 0x104, 300 * MS), 250 * MS);
    assert_eq!(rig.read(POWER + 0x418), 1 << 16 | 1);
    rig.assert_clean();
}

#[test]
fn tasks_read_zero_and_inten_is_one_register_behind_three() {
    let mut rig = Rig::new();
    rig.write(TIMER0, 1);
    assert_eq!(rig.read(TIMER0), 0);
    rig.write(EGU0 + 0x300, 0xF0F0);
    rig.write(EGU0 + 0x304, 0x000F);
    rig.write(EGU0 + 0x308, 0x8000);
    for offset in [0x300, 0x304, 0x308] {
        assert_eq!(rig.read(EGU0 + offset), 0x70FF);
    }
    rig.write(EGU0 + 0x100, 1);
    assert!(rig.line(20), "an event written 1 is set");
    rig.write(EGU0 + 0x100, 0);
    assert!(!rig.line(20));
    rig.assert_clean();
}

#[test]
fn what_is_not_modelled_is_listed_and_never_silent() {
    let mut rig = Rig::new();
    rig.write(0x4000_1000, 1); // RADIO.TASKS_TXEN
    assert_eq!(rig.read(0x4000_1508), 2, "RADIO.FREQUENCY has its reset value");
    rig.read(0x5002_A000);
    assert!(rig.try_write(0x4006_EC00, Width::Word, 0x9375), "USBD's test registers, which its workarounds unlock");
    let listed: Vec<_> = rig.findings(FindingKind::Unmodelled).iter().map(|found| (found.place, found.count)).collect();
    assert_eq!(listed, [("RADIO", 2), ("CRYPTOCELL", 1), ("USBD", 1)]);
    assert_eq!(rig.read(0x4000_8FFC), 0);
    assert_eq!(rig.findings(FindingKind::Undefined).len(), 1, "space of TIMER0 that no register covers");
    assert_eq!(rig.try_read(0x4003_0000, Width::Word), None);
    assert_eq!(rig.findings(FindingKind::Unmapped).len(), 1, "no block is there");
    rig.write(SPIM0 + 0x500, 9); // TWIS
    assert_eq!(rig.findings(FindingKind::Unmodelled).len(), 3);
    assert_eq!(rig.part.findings()[0].pc, Some(0x1000));
}

#[test]
fn a_narrow_write_to_a_register_is_reported() {
    let mut rig = Rig::new();
    rig.try_write(TIMER0 + 0x510, Width::Byte, 2);
    assert_eq!(rig.findings(FindingKind::Misuse).len(), 1);
    assert_eq!(rig.read(TIMER0 + 0x510), 2);
}

#[test]
fn a_soft_reset_puts_every_register_back_and_lowers_every_line() {
    let mut rig = Rig::new();
    rig.write_all(&[
        (P0 + 0x518, 1 << 13),
        (P0 + 0x508, 1 << 13),
        (EGU0 + 0x304, 1),
        (EGU0, 1),
        (TIMER0 + 0x540, 7),
        (TIMER0, 1),
        (POWER, 1),
    ]);
    assert!(rig.line(20));
    rig.reset(Reset::Software);
    assert_eq!(rig.read(EGU0 + 0x304), 0);
    assert_eq!(rig.read(TIMER0 + 0x540), 0);
    assert_eq!(rig.read(P0 + 0x514), 0);
    assert_eq!(rig.read(POWER + 0x408), 0);
    assert_eq!(rig.deadline(), u64::MAX);
    rig.write_all(&[(EGU0 + 0x304, 1), (EGU0, 1)]);
    assert!(rig.line(20), "a line that was high before the reset rises again");
}

#[test]
fn a_lockup_resets_with_its_own_reason() {
    let mut rig = Rig::new();
    rig.reset(Reset::Lockup);
    assert_eq!(rig.read(POWER + 0x400), 1 << 3);
}

#[test]
fn each_reset_adds_its_own_reason_until_it_is_cleared() {
    let mut rig = Rig::new();
    assert_eq!(rig.read(POWER + 0x400), 0, "power-on");
    rig.reset(Reset::Pin);
    assert_eq!(rig.read(POWER + 0x400), 1 << 0, "RESETPIN");
    rig.reset(Reset::Software);
    assert_eq!(rig.read(POWER + 0x400), 1 << 0 | 1 << 2, "SREQ");
    rig.reset(Reset::Lockup);
    assert_eq!(rig.read(POWER + 0x400), 1 << 0 | 1 << 2 | 1 << 3, "LOCKUP");
    rig.write_all(&[(WDT + 0x504, 32), (WDT, 1)]);
    rig.run_for(10 * MS);
    assert_eq!(rig.read(POWER + 0x400), 0b1111, "DOG");
    rig.write(POWER + 0x400, 1 << 2);
    assert_eq!(rig.read(POWER + 0x400), 0b1011, "only a one clears, and only its own bit");
    rig.reset(Reset::Software);
    assert_eq!(rig.read(POWER + 0x400), 0b1111);
    rig.write(POWER + 0x400, u32::MAX);
    assert_eq!(rig.read(POWER + 0x400), 0);
    rig.assert_clean();
}

#[test]
fn a_failed_supply_leaves_no_reset_reason_and_no_earlier_state() {
    for cause in [Reset::PowerOn, Reset::BrownOut] {
        let mut rig = Rig::new();
        rig.reset(Reset::Pin);
        rig.write_all(&[(POWER + 0x51C, 0xA7), (TIMER0 + 0x540, 7)]);
        rig.reset(cause);
        assert_eq!(rig.read(POWER + 0x400), 0);
        assert_eq!((rig.read(POWER + 0x51C), rig.read(TIMER0 + 0x540)), (0, 0));
        rig.reset(Reset::Pin);
        assert_eq!(rig.read(POWER + 0x400), 1, "the next one is a pin reset again");
    }
}

#[test]
fn system_off_ends_in_a_reset_when_a_pin_is_sensed() {
    let mut rig = Rig::new();
    let lines = Part::signals(&mut rig.part).stalled_until();
    assert_eq!(lines, 0);
    rig.fill(RAM, &[1; 16]);
    rig.fill(RAM + 0x1000, &[2; 16]);
    rig.write_all(&[(p1_cnf(5), 2 << 16), (p0_cnf(13), OUTPUT), (P0 + 0x508, 1 << 13)]);
    rig.write_all(&[(POWER + 0x904, 1 << 17), (POWER + 0x51C, 0x12), (TIMER0, 1), (POWER + 0x500, 1)]);
    assert_eq!(rig.part.signals().stalled_until(), u64::MAX, "the core has no clock");
    assert_eq!(rig.deadline(), u64::MAX);
    rig.run_to(10 * MS);
    assert_eq!(rig.restarts(), 0);
    rig.drive(emulator_part::Pin::new(1, 5), true);
    assert_eq!(rig.restarts(), 1);
    assert_eq!(rig.part.signals().stalled_until(), 0);
    assert_eq!(rig.read(POWER + 0x400), 1 << 16, "RESETREAS.OFF");
    assert_eq!(rig.read(POWER + 0x51C), 0x12, "GPREGRET is retained");
    assert!(rig.part.pin(emulator_part::Pin::new(0, 13)), "GPIO keeps what it drives");
    assert_ne!(rig.memory(RAM, 16), [1; 16], "section 0 of RAM0 was not retained");
    assert_eq!(rig.memory(RAM + 0x1000, 16), [2; 16], "section 1 was");
    rig.assert_clean();
}

#[test]
fn system_off_is_left_at_once_while_a_pin_is_sensed() {
    let mut rig = Rig::new();
    rig.drive(emulator_part::Pin::new(1, 5), true);
    rig.write_all(&[(p1_cnf(5), 2 << 16), (POWER + 0x500, 1)]);
    assert_eq!(rig.restarts(), 1);
}

#[test]
fn the_debug_port_opens_only_if_uicr_and_firmware_allow_it() {
    const FORCEPROTECT: u32 = POWER + 0x550;
    const DISABLE: u32 = POWER + 0x558;
    let mut rig = Rig::new();
    let open = |rig: &mut Rig, uicr| rig.part.debug_port_open(uicr);
    assert!(!open(&mut rig, 0xFFFF_FF5A), "the firmware has not written DISABLE");
    rig.write(DISABLE, 0xA5);
    assert!(!open(&mut rig, 0xFFFF_FF5A), "another value than SwDisable");
    rig.write(DISABLE, 0x5A);
    assert_eq!(rig.read(DISABLE), 0x5A);
    assert!(open(&mut rig, 0xFFFF_FF5A));
    assert!(!open(&mut rig, 0xFFFF_FFFF), "UICR as it leaves the factory or an erase");
    assert!(!open(&mut rig, 0xFFFF_FF00), "UICR.APPROTECT enabled");
    rig.reset(Reset::Pin);
    assert!(!open(&mut rig, 0xFFFF_FF5A), "a reset closes it");
    rig.write_all(&[(FORCEPROTECT, 0), (FORCEPROTECT, 0xFF), (DISABLE, 0x5A)]);
    assert!(!open(&mut rig, 0xFFFF_FF5A), "forced shut until the next reset");
    rig.reset(Reset::Pin);
    rig.write(DISABLE, 0x5A);
    assert!(open(&mut rig, 0xFFFF_FF5A));
    rig.assert_clean();
}

#[test]
fn the_factory_registers_say_the_revision_whose_debug_port_starts_locked() {
    let mut rig = Rig::new();
    assert_eq!(rig.read(0x1000_0104).to_be_bytes(), *b"AAF0");
    assert_eq!((rig.read(0x1000_0130), rig.read(0x1000_0134)), (8, 3));
    assert_eq!((rig.read(0xF000_0FE0) & 0xFF, rig.read(0xF000_0FE4) & 0xF), (8, 0));
    assert_eq!((rig.read(0xF000_0FE8) & 0xF0, rig.read(0xF000_0FEC) & 0xF0), (0x30, 0));
    rig.assert_clean();
}

#[test]
fn the_factory_registers_say_what_part_this_is() {
    let mut rig = Rig::with(Settings { device_id: 0x1122_3344_5566_7788, ..Settings::default() });
    assert_eq!(rig.read(0x1000_0100), 0x0005_2840);
    assert_eq!((rig.read(0x1000_0060), rig.read(0x1000_0064)), (0x5566_7788, 0x1122_3344));
    assert_eq!(rig.read(0x1000_0010) * rig.read(0x1000_0014), 1 << 20);
    rig.write(0x1000_0060, 0);
    assert_eq!(rig.read(0x1000_0060), 0x5566_7788);
    assert_eq!(rig.findings(FindingKind::Misuse).len(), 1);
}

#[test]
fn ram_power_and_general_purpose_registers_hold_what_they_are_given() {
    let mut rig = Rig::new();
    assert_eq!(rig.read(POWER + 0x900), 0xFFFF);
    rig.write_all(&[(POWER + 0x908, 0b10), (POWER + 0x904, 1 << 16), (POWER + 0x578, 1), (POWER + 0x520, 0x1FF)]);
    assert_eq!(rig.read(POWER + 0x900), 0x1_FFFD);
    assert_eq!(rig.read(POWER + 0x578), 1);
    assert_eq!(rig.read(POWER + 0x520), 0xFF);
    rig.assert_clean();
}

#[test]
fn sleep_is_an_event() {
    let mut rig = Rig::new();
    rig.part.sleeps(US, true, false, &mut rig.world);
    rig.part.sleeps(2 * US, false, false, &mut rig.world);
    assert_eq!((rig.read(POWER + 0x114), rig.read(POWER + 0x118)), (1, 1));
}

#[test]
fn system_off_ends_in_a_reset_when_the_low_power_comparator_detects() {
    const LPCOMP: u32 = 0x4001_3000;
    let input = emulator_part::Pin::new(0, 4);
    let mut rig = Rig::new();
    rig.world.microvolts.insert(input, 2_000_000);
    // LPCOMP detects that its input rises above half of the 3 V supply.
    rig.write_all(&[(LPCOMP + 0x504, 2), (LPCOMP + 0x508, 3), (LPCOMP + 0x520, 1), (LPCOMP + 0x500, 1), (LPCOMP, 1)]);
    rig.run_for(MS);
    rig.write_all(&[(TIMER0 + 0x508, 3), (TIMER0, 1), (POWER + 0x500, 1)]);
    rig.world.microvolts.insert(input, 1_000_000);
    rig.run_for(10 * MS);
    assert_eq!(rig.restarts(), 0, "the other way");
    rig.world.microvolts.insert(input, 2_000_000);
    rig.run_for(MS);
    assert_eq!(rig.restarts(), 1);
    assert_eq!(rig.part.signals().stalled_until(), 0);
    assert_eq!(rig.read(POWER + 0x400), 1 << 17, "RESETREAS.LPCOMP");
    rig.assert_clean();
}
