//! Tests of faults: status, escalation, derived exceptions and lockup.

use super::super::*;
use super::*;

const ALL_ON: u32 = 7 << 16;

#[test]
fn a_disabled_fault_becomes_a_forced_hard_fault() {
    let (mut core, mut board) = machine();
    core.take_fault(&mut board, Fault::Undefined);
    assert_eq!((core.ipsr, core.r[15]), (3, handler(3)));
    assert_eq!(board.word(TOP - 8), START);
    assert_eq!((read(&mut core, &mut board, CFSR), read(&mut core, &mut board, HFSR)), (CFSR_UNDEFINSTR, HFSR_FORCED));
}

#[test]
fn each_fault_that_is_on_has_its_handler_and_its_status_bit() {
    for (fault, number, status) in [
        (Fault::Undefined, 6, 1 << 16),
        (Fault::InvalidState, 6, 1 << 17),
        (Fault::InvalidPc, 6, 1 << 18),
        (Fault::NoCoprocessor, 6, 1 << 19),
        (Fault::Unaligned, 6, 1 << 24),
        (Fault::DivideByZero, 6, 1 << 25),
        (Fault::BusData(0x7000_0000), 5, 0x8200),
        (Fault::BusInstruction, 5, 0x100),
        (Fault::MemData(0x1234), 4, 0x82),
        (Fault::MemInstruction, 4, 1),
    ] {
        let (mut core, mut board) = machine();
        write(&mut core, &mut board, SHCSR, ALL_ON);
        core.take_fault(&mut board, fault);
        assert_eq!((core.ipsr, core.system.scb.cfsr, core.system.scb.hfsr), (number, status, 0), "{fault:?}");
    }
}

#[test]
fn fault_addresses_are_kept_and_status_is_cleared_by_ones() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, SHCSR, ALL_ON);
    core.take_fault(&mut board, Fault::BusData(0x7000_0004));
    assert_eq!(read(&mut core, &mut board, BFAR), 0x7000_0004);
    core.take_fault(&mut board, Fault::MemData(0x8));
    assert_eq!(read(&mut core, &mut board, MMFAR), 8);
    assert_eq!(read(&mut core, &mut board, HFSR), HFSR_FORCED, "at the same priority it escalates");
    let byte = access(&core, CFSR + 1, Width::Byte);
    core.system_write(&mut board, &byte, 0x80).unwrap();
    assert_eq!(read(&mut core, &mut board, CFSR), 0x0282, "BFARVALID went with the address");
    write(&mut core, &mut board, CFSR, u32::MAX);
    write(&mut core, &mut board, HFSR, u32::MAX);
    assert_eq!((read(&mut core, &mut board, CFSR), read(&mut core, &mut board, HFSR)), (0, 0));
}

#[test]
fn a_fault_escalates_where_its_priority_is_not_high_enough() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, SHCSR, ALL_ON);
    write(&mut core, &mut board, SHPR1, 0x0040_0000);
    core.msr(17, 0, 0x40);
    core.take_fault(&mut board, Fault::DivideByZero);
    assert_eq!((core.ipsr, core.system.scb.hfsr), (3, HFSR_FORCED));
}

#[test]
fn a_fault_in_hard_fault_or_under_faultmask_locks_up() {
    let (mut core, mut board) = machine();
    core.take_fault(&mut board, Fault::Undefined);
    assert!(!core.locked_up);
    core.take_fault(&mut board, Fault::Undefined);
    assert!(core.locked_up);
    let (mut core, mut board) = machine();
    core.cps(true, false, true);
    core.supervisor_call(&mut board);
    assert!(core.locked_up);
}

#[test]
fn only_nmi_leaves_a_lockup_in_hard_fault() {
    let (mut core, mut board) = machine();
    core.take_fault(&mut board, Fault::Undefined);
    core.take_fault(&mut board, Fault::Undefined);
    enable(&mut core, &mut board, 0, 0);
    board.line(0, true);
    assert!(!look(&mut core, &mut board));
    board.signals.drive_nmi(true);
    assert!(look(&mut core, &mut board));
    assert_eq!((core.ipsr, core.locked_up), (2, false));
    assert_eq!(board.word(core.r[13] + 24), 0xFFFF_FFFE);
}

#[test]
fn a_supervisor_call_returns_behind_itself_and_escalates_where_it_is_masked() {
    let (mut core, mut board) = machine();
    core.r[15] = START + 2;
    core.supervisor_call(&mut board);
    assert_eq!((core.ipsr, board.word(TOP - 8)), (11, START + 2));
    leave(&mut core, &mut board);
    core.cps(true, true, false);
    core.r[15] = START + 2;
    core.supervisor_call(&mut board);
    assert_eq!((core.ipsr, board.word(TOP - 8), core.system.scb.hfsr), (3, START + 2, HFSR_FORCED));
}

#[test]
fn a_stacking_fault_is_served_before_an_interrupt_of_lower_priority() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, SHCSR, ALL_ON);
    enable(&mut core, &mut board, 0, 0x80);
    pend(&mut core, &mut board, 0);
    core.r[13] = RAM + 8;
    look(&mut core, &mut board);
    assert_eq!((core.ipsr, core.system.scb.cfsr), (5, CFSR_STKERR));
    assert_eq!(core.r[13], RAM - 24, "the stack pointer has moved");
    assert!(contains(&core.system.nvic.pending, 16));
}

#[test]
fn a_stacking_fault_waits_for_an_interrupt_of_higher_priority() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, SHCSR, ALL_ON);
    write(&mut core, &mut board, SHPR1, 0x0080_8080);
    enable(&mut core, &mut board, 0, 0x40);
    pend(&mut core, &mut board, 0);
    core.r[13] = RAM + 8;
    look(&mut core, &mut board);
    assert_eq!(core.ipsr, 16);
    assert!(contains(&core.system.nvic.pending, 5));
}

#[test]
fn an_unstacking_fault_is_entered_without_unstacking() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, SHCSR, ALL_ON);
    enable(&mut core, &mut board, 0, 0x80);
    pend(&mut core, &mut board, 0);
    look(&mut core, &mut board);
    core.r[13] = RAM - 32;
    leave(&mut core, &mut board);
    assert_eq!((core.ipsr, core.system.scb.cfsr), (5, CFSR_UNSTKERR));
    assert_eq!((core.r[14], core.r[13]), (0xFFFF_FFF9, RAM - 32));
}

#[test]
fn an_unreadable_vector_raises_a_hard_fault_or_locks_up() {
    let (mut core, mut board) = machine();
    enable(&mut core, &mut board, 0, 0x80);
    pend(&mut core, &mut board, 0);
    write(&mut core, &mut board, VTOR, 0xFF80);
    board.flash.truncate(0xFF80 + 64);
    look(&mut core, &mut board);
    assert_eq!((core.ipsr, core.system.scb.hfsr), (3, HFSR_VECTTBL));
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, VTOR, 0x1000_0000);
    core.take_fault(&mut board, Fault::Undefined);
    assert!(core.locked_up);
}

#[test]
fn bus_faults_are_ignored_in_hard_fault_with_bfhfnmign() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, CCR, 0x300);
    assert!(!core.ignores_bus_fault(0x7000_0000));
    assert_eq!(core.system.scb.cfsr, 0, "the status is the exception's to set");
    core.cps(true, false, true);
    core.it = 0b0000_0110;
    core.take_fault(&mut board, Fault::BusData(0x7000_0000));
    assert_eq!((core.r[15], core.it, core.locked_up), (START + 2, 0b0000_1100, false));
    core.take_fault(&mut board, Fault::MemData(0x7000_0000));
    assert!(core.locked_up);
}

/// Firmware uses an ignored bus fault to find out whether anything is at an address.
#[test]
fn an_ignored_bus_fault_is_told_by_cfsr_and_bfar() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, CCR, 0x300);
    core.cps(true, false, true);
    assert_eq!(core.load(&mut board, 0x7000_0004, Width::Word, Purpose::Data), Ok(0));
    let told = CFSR_PRECISERR | CFSR_BFARVALID;
    assert_eq!((core.system.scb.cfsr, core.system.scb.fault_address), (told, 0x7000_0004));
    core.system.scb.cfsr = 0;
    assert_eq!(core.store_as(&mut board, 0x7000_0008, Width::Word, 1, Purpose::Data, true), Ok(()));
    assert_eq!((core.system.scb.cfsr, core.system.scb.fault_address), (told, 0x7000_0008));
    assert!(!core.locked_up);
}

#[test]
fn a_breakpoint_without_a_debugger_raises_hard_fault_or_debug_monitor() {
    let (mut core, mut board) = machine();
    core.breakpoint(&mut board);
    assert_eq!((core.ipsr, core.system.scb.hfsr, board.word(TOP - 8)), (3, HFSR_DEBUGEVT, START));
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, 0xE000_EDFC, 1 << 16);
    core.breakpoint(&mut board);
    assert_eq!((core.ipsr, read(&mut core, &mut board, DFSR)), (12, DFSR_BKPT));
}

#[test]
fn system_handlers_are_pended_activated_and_enabled_by_shcsr() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, SHCSR, 1 << 14);
    assert!(!look(&mut core, &mut board), "pending, but off");
    write(&mut core, &mut board, SHCSR, 1 << 14 | 1 << 17);
    assert!(look(&mut core, &mut board));
    assert_eq!((core.ipsr, read(&mut core, &mut board, SHCSR)), (5, 1 << 1 | 1 << 17));
    write(&mut core, &mut board, SHPR2, 0xF0 << 24);
    write(&mut core, &mut board, SHCSR, 1 << 15);
    assert_eq!(core.execution_priority(), 256, "its active bit was cleared");
    assert!(look(&mut core, &mut board));
    assert_eq!((core.ipsr, core.execution_priority()), (11, 0xF0));
}

#[test]
fn a_stacking_fault_from_hard_fault_to_nmi_locks_up_for_good() {
    let (mut core, mut board) = machine();
    core.take_fault(&mut board, Fault::Undefined);
    core.r[13] = RAM + 8;
    board.signals.drive_nmi(true);
    look(&mut core, &mut board);
    assert_eq!((core.locked_up, core.execution_priority()), (true, -2));
    assert!(!look(&mut core, &mut board) && core.locked_up);
}

#[test]
fn an_unstacking_fault_from_nmi_to_hard_fault_locks_up() {
    let (mut core, mut board) = machine();
    core.take_fault(&mut board, Fault::Undefined);
    write(&mut core, &mut board, ICSR, 1 << 31);
    look(&mut core, &mut board);
    core.r[13] = RAM - 32;
    leave(&mut core, &mut board);
    assert_eq!((core.locked_up, core.execution_priority()), (true, -1));
}

#[test]
fn a_reset_without_a_vector_table_locks_up() {
    let (mut core, mut board) = machine();
    board.flash.clear();
    core.reset(&mut board);
    assert_eq!((core.locked_up, core.system.scb.hfsr), (true, HFSR_VECTTBL));
}
