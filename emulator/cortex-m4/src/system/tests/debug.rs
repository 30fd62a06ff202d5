//! Tests of debug control, breakpoints, watchpoints and the cycle counter.

use super::super::*;
use super::*;

const DHCSR: u32 = 0xE000_EDF0;
const DCRSR: u32 = 0xE000_EDF4;
const DCRDR: u32 = 0xE000_EDF8;
const DEMCR: u32 = 0xE000_EDFC;
const DWT: u32 = 0xE000_1000;
const KEY: u32 = 0xA05F_0000;

fn debugged() -> (Core<Fast>, Board) {
    let (mut core, mut board) = machine();
    core.debug_write(&mut board, DHCSR, KEY | 1).unwrap();
    (core, board)
}

#[test]
fn only_a_debugger_with_the_key_enables_halting() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, DHCSR, KEY | 3);
    look(&mut core, &mut board);
    assert!(!core.halted);
    core.debug_write(&mut board, DHCSR, 3).unwrap();
    assert!(!core.halted);
    core.debug_write(&mut board, DHCSR, KEY | 3).unwrap();
    assert!(core.halted);
    let value = core.debug_read(&mut board, DHCSR).unwrap();
    assert_eq!(value & 0x0307_0003, 0x0203_0003);
    assert_eq!(core.debug_read(&mut board, DHCSR).unwrap() >> 25 & 1, 0, "S_RESET_ST cleared by the read");
    assert_eq!(core.system.scb.dfsr, DFSR_HALTED);
}

#[test]
fn a_breakpoint_halts_a_core_that_is_debugged() {
    let (mut core, mut board) = debugged();
    core.breakpoint(&mut board);
    assert_eq!((core.halted, core.ipsr, core.r[15], core.system.scb.dfsr), (true, 0, START, DFSR_BKPT));
}

#[test]
fn a_step_executes_one_instruction() {
    let (mut core, mut board) = debugged();
    core.debug_write(&mut board, DHCSR, KEY | 3).unwrap();
    core.debug_write(&mut board, DHCSR, KEY | 5).unwrap();
    assert!(!core.halted && core.attention);
    look(&mut core, &mut board);
    assert!(!core.halted && core.debug_stepping());
    core.retired += 1;
    look(&mut core, &mut board);
    assert!(core.halted && !core.debug_stepping());
}

#[test]
fn a_step_in_a_run_halts_after_one_instruction() {
    let (mut core, mut board) = debugged();
    core.debug_write(&mut board, DHCSR, KEY | 3).unwrap();
    let retired = core.retired;
    core.debug_write(&mut board, DHCSR, KEY | 5).unwrap();
    assert_eq!(core.run(&mut board, core.cycle + 100), crate::Exit::Halted);
    assert_eq!((core.halted, core.retired - retired), (true, 1));
}

#[test]
fn a_debugger_halts_steps_and_resets_a_core_that_hangs() {
    let (mut core, mut board) = debugged();
    core.hang();
    core.debug_write(&mut board, DHCSR, KEY | 3).unwrap();
    assert_eq!((core.halted, core.r[15]), (true, START));
    let retired = core.retired;
    core.debug_write(&mut board, DHCSR, KEY | 5).unwrap();
    look(&mut core, &mut board);
    assert_eq!((core.halted, core.debug_stepping(), core.r[15], core.retired), (true, false, START, retired));
    core.debug_write(&mut board, DHCSR, KEY | 1).unwrap();
    look(&mut core, &mut board);
    assert!(!core.halted && core.is_hung());
    core.debug_write(&mut board, AIRCR, 0x05FA_0004).unwrap();
    assert!(core.take_reset_request());
}

#[test]
fn a_step_ends_at_the_first_instruction_of_a_handler() {
    let (mut core, mut board) = debugged();
    enable(&mut core, &mut board, 0, 0);
    pend(&mut core, &mut board, 0);
    core.debug_write(&mut board, DHCSR, KEY | 3).unwrap();
    core.debug_write(&mut board, DHCSR, KEY | 5).unwrap();
    look(&mut core, &mut board);
    assert!(core.attention);
    look(&mut core, &mut board);
    assert_eq!((core.halted, core.r[15]), (true, handler(16)));
}

#[test]
fn registers_of_a_halted_core_are_moved_through_dcrdr() {
    let (mut core, mut board) = debugged();
    core.debug_write(&mut board, DHCSR, KEY | 3).unwrap();
    core.debug_write(&mut board, DCRDR, 0x1234).unwrap();
    for register in [4, 18, 64] {
        core.debug_write(&mut board, DCRSR, 1 << 16 | register).unwrap();
    }
    assert_eq!((core.r[4], core.other_sp, core.s[0]), (0x1234, 0x1234, 0x1234));
    for (register, value) in [(15, START), (17, TOP), (13, TOP), (16, 0x0100_0000)] {
        core.debug_write(&mut board, DCRSR, register).unwrap();
        assert_eq!(core.debug_read(&mut board, DCRDR), Ok(value), "{register}");
    }
    core.debug_write(&mut board, DCRDR, 0x0200_8001).unwrap();
    core.debug_write(&mut board, DCRSR, 1 << 16 | 20).unwrap();
    assert_eq!((core.primask, core.basepri, core.control, core.r[13]), (true, 0x80, 2, 0x1234));
}

#[test]
fn c_maskints_holds_back_interrupts() {
    let (mut core, mut board) = debugged();
    enable(&mut core, &mut board, 0, 0);
    core.debug_write(&mut board, DHCSR, KEY | 9).unwrap();
    pend(&mut core, &mut board, 0);
    write(&mut core, &mut board, ICSR, 1 << 28 | 1 << 26);
    assert!(!look(&mut core, &mut board));
    core.debug_write(&mut board, DHCSR, KEY | 1).unwrap();
    assert!(look(&mut core, &mut board));
}

#[test]
fn vector_catch_halts_at_the_handler() {
    let (mut core, mut board) = debugged();
    core.debug_write(&mut board, DEMCR, 1 << 10).unwrap();
    core.take_fault(&mut board, Fault::Undefined);
    look(&mut core, &mut board);
    assert_eq!((core.halted, core.r[15], core.system.scb.dfsr), (true, handler(3), DFSR_VCATCH));
    core.debug_write(&mut board, DEMCR, 1).unwrap();
    core.reset(&mut board);
    assert_eq!((core.halted, core.r[15]), (true, START));
}

#[test]
fn timers_stand_still_while_the_core_is_halted() {
    let (mut core, mut board) = debugged();
    write(&mut core, &mut board, 0xE000_E014, 999);
    write(&mut core, &mut board, 0xE000_E010, 7);
    write(&mut core, &mut board, DEMCR, 1 << 24);
    write(&mut core, &mut board, DWT, 1);
    core.cycle += 100;
    core.debug_write(&mut board, DHCSR, KEY | 3).unwrap();
    assert_eq!(core.system_due(), u64::MAX);
    core.cycle += 5000;
    assert_eq!(core.debug_read(&mut board, 0xE000_E018), Ok(900));
    assert_eq!(core.debug_read(&mut board, DWT + 4), Ok(100));
    core.debug_write(&mut board, DHCSR, KEY | 1).unwrap();
    core.cycle += 1;
    assert_eq!(read(&mut core, &mut board, 0xE000_E018), 899);
    assert_eq!(read(&mut core, &mut board, DWT + 4), 101);
}

#[test]
fn the_cycle_counter_counts_while_it_and_tracing_are_on() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, DWT, 1);
    core.cycle += 10;
    assert_eq!(read(&mut core, &mut board, DWT + 4), 0);
    write(&mut core, &mut board, DEMCR, 1 << 24);
    core.cycle += 10;
    assert_eq!(read(&mut core, &mut board, DWT + 4), 10);
    write(&mut core, &mut board, DWT + 4, 0xFFFF_FFFF);
    core.cycle += 2;
    assert_eq!(read(&mut core, &mut board, DWT + 4), 1);
    write(&mut core, &mut board, DWT, 0);
    core.cycle += 2;
    assert_eq!(read(&mut core, &mut board, DWT + 4), 1);
    assert_eq!(read(&mut core, &mut board, DWT) >> 28, 4);
}

#[test]
fn a_watchpoint_makes_the_monitor_pending_after_the_access() {
    let (mut core, mut board) = machine();
    assert!(!core.watching());
    write(&mut core, &mut board, DEMCR, 1 << 24 | 1 << 16);
    write(&mut core, &mut board, DWT + 0x20, RAM + 0x10);
    write(&mut core, &mut board, DWT + 0x24, 2);
    write(&mut core, &mut board, DWT + 0x28, 6);
    assert!(core.watching());
    core.watch(RAM + 0x11, false, Width::Byte, 0);
    core.watch(RAM + 0x14, true, Width::Word, 0);
    assert!(!look(&mut core, &mut board));
    core.watch(RAM + 0x11, true, Width::Byte, 0);
    assert!(look(&mut core, &mut board));
    assert_eq!((core.ipsr, read(&mut core, &mut board, DFSR)), (12, DFSR_DWTTRAP));
    assert_eq!(read(&mut core, &mut board, DWT + 0x28), 1 << 24 | 6);
    assert_eq!(read(&mut core, &mut board, DWT + 0x28), 6);
}

#[test]
fn a_watchpoint_can_ask_for_a_value() {
    let (mut core, mut board) = debugged();
    write(&mut core, &mut board, DEMCR, 1 << 24);
    write(&mut core, &mut board, DWT + 0x20, RAM + 8);
    write(&mut core, &mut board, DWT + 0x30, 42);
    // Comparator 1 compares the value of words, and comparator 0 their address.
    write(&mut core, &mut board, DWT + 0x38, 2 << 10 | 1 << 8 | 6);
    core.watch(RAM + 8, true, Width::Word, 41);
    core.watch(RAM + 12, true, Width::Word, 42);
    look(&mut core, &mut board);
    assert!(!core.halted);
    core.watch(RAM + 8, true, Width::Word, 42);
    look(&mut core, &mut board);
    assert!(core.halted);
}

#[test]
fn breakpoints_of_both_units_are_told_and_taken() {
    let (mut core, mut board) = machine();
    core.take_breakpoints_changed();
    write(&mut core, &mut board, 0xE000_2008, 1 << 30 | START | 1);
    write(&mut core, &mut board, 0xE000_200C, 2 << 30 | START | 1);
    write(&mut core, &mut board, 0xE000_2000, 3);
    assert!(core.take_breakpoints_changed());
    assert_eq!(core.fpb_breakpoints().collect::<Vec<_>>(), [START, START + 2]);
    write(&mut core, &mut board, DEMCR, 1 << 24 | 1 << 16);
    write(&mut core, &mut board, DWT + 0x40, START + 8);
    write(&mut core, &mut board, DWT + 0x44, 2);
    write(&mut core, &mut board, DWT + 0x48, 4);
    assert_eq!(core.fpb_breakpoints().count(), 4);
    core.r[15] = START + 6;
    assert!(!core.hardware_breakpoint(&mut board));
    core.r[15] = START + 10;
    assert!(core.hardware_breakpoint(&mut board));
    assert_eq!((core.ipsr, board.word(TOP - 8)), (12, START + 10));
    core.exception_return(&mut board, 0xFFFF_FFF9);
    core.r[15] = START;
    assert!(core.hardware_breakpoint(&mut board));
    assert_eq!(core.system.scb.dfsr, DFSR_BKPT | DFSR_DWTTRAP);
    assert!(core.take_unmodelled().is_empty());
    write(&mut core, &mut board, 0xE000_2010, START | 1);
    assert_eq!(core.take_unmodelled().len(), 1, "remapping is not modelled");
}

#[test]
fn a_cycle_match_is_due_at_its_cycle() {
    let (mut core, mut board) = debugged();
    write(&mut core, &mut board, DEMCR, 1 << 24);
    write(&mut core, &mut board, DWT, 1);
    write(&mut core, &mut board, DWT + 0x20, 50);
    write(&mut core, &mut board, DWT + 0x28, 1 << 7 | 4);
    assert_eq!(core.system_due(), 50);
    core.cycle = 50;
    look(&mut core, &mut board);
    assert!(core.halted);
}

#[test]
fn the_monitor_is_pended_and_steps_by_demcr() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, DEMCR, 1 << 16 | 1 << 17 | 1 << 18);
    assert!(look(&mut core, &mut board));
    assert_eq!((core.ipsr, read(&mut core, &mut board, DEMCR)), (12, 5 << 16));
    leave(&mut core, &mut board);
    assert!(!look(&mut core, &mut board));
    core.retired += 1;
    assert!(look(&mut core, &mut board));
    assert_eq!(core.ipsr, 12);
}
