//! Tests of the NVIC: pending, enabled and active states, priorities, levels.

use super::*;

#[test]
fn a_pending_interrupt_is_taken_only_once_it_is_enabled() {
    let (mut core, mut board) = machine();
    pend(&mut core, &mut board, 5);
    assert!(!look(&mut core, &mut board));
    write(&mut core, &mut board, ISER, 1 << 5);
    assert!(core.attention);
    assert!(look(&mut core, &mut board));
    assert_eq!((core.ipsr, core.r[15]), (21, handler(21)));
}

#[test]
fn a_higher_priority_preempts_and_an_equal_one_waits() {
    let (mut core, mut board) = machine();
    enable(&mut core, &mut board, 0, 0xC0);
    enable(&mut core, &mut board, 1, 0x80);
    enable(&mut core, &mut board, 2, 0xC0);
    pend(&mut core, &mut board, 0);
    assert!(look(&mut core, &mut board));
    pend(&mut core, &mut board, 2);
    assert!(!look(&mut core, &mut board));
    pend(&mut core, &mut board, 1);
    assert!(look(&mut core, &mut board));
    assert_eq!((core.ipsr, core.r[14]), (17, 0xFFFF_FFF1));
    assert_eq!(read(&mut core, &mut board, IABR), 0b011);
    leave(&mut core, &mut board);
    assert_eq!(core.ipsr, 16);
    leave(&mut core, &mut board);
    assert_eq!((core.ipsr, core.r[14]), (18, 0xFFFF_FFF9), "tail-chained with the EXC_RETURN of the first");
    leave(&mut core, &mut board);
    assert_eq!((core.ipsr, core.r[15], core.r[13]), (0, START, TOP));
}

#[test]
fn of_equal_priorities_the_lowest_number_is_taken_first() {
    let (mut core, mut board) = machine();
    for line in [40, 7, 70] {
        enable(&mut core, &mut board, line, 0x40);
        pend(&mut core, &mut board, line);
    }
    let mut order = vec![];
    look(&mut core, &mut board);
    while core.ipsr != 0 {
        order.push(core.ipsr - 16);
        leave(&mut core, &mut board);
    }
    assert_eq!(order, [7, 40, 70]);
}

#[test]
fn the_subpriority_orders_what_is_pending_but_does_not_preempt() {
    let (mut core, mut board) = machine();
    // With PRIGROUP 6 a priority has one bit of group priority.
    write(&mut core, &mut board, AIRCR, 0x05FA_0600);
    enable(&mut core, &mut board, 0, 0x70);
    enable(&mut core, &mut board, 1, 0x20);
    enable(&mut core, &mut board, 2, 0x10);
    pend(&mut core, &mut board, 0);
    look(&mut core, &mut board);
    write(&mut core, &mut board, ISPR, 0b110);
    assert!(!look(&mut core, &mut board));
    leave(&mut core, &mut board);
    assert_eq!(core.ipsr, 18);
}

#[test]
fn a_line_that_stays_high_is_pending_again_after_the_return() {
    let (mut core, mut board) = machine();
    enable(&mut core, &mut board, 3, 0);
    board.line(3, true);
    assert!(look(&mut core, &mut board));
    assert_eq!(read(&mut core, &mut board, ISPR), 0, "not while its handler runs");
    leave(&mut core, &mut board);
    assert_eq!(core.ipsr, 19);
    board.line(3, false);
    leave(&mut core, &mut board);
    assert_eq!(core.ipsr, 0);
}

#[test]
fn a_pulse_is_latched_before_and_while_its_handler_runs() {
    let (mut core, mut board) = machine();
    board.line(3, true);
    look(&mut core, &mut board);
    board.line(3, false);
    look(&mut core, &mut board);
    assert_eq!(read(&mut core, &mut board, ISPR), 8);
    write(&mut core, &mut board, ISER, 8);
    assert!(look(&mut core, &mut board));
    board.line(3, true);
    look(&mut core, &mut board);
    board.line(3, false);
    look(&mut core, &mut board);
    leave(&mut core, &mut board);
    assert_eq!(core.ipsr, 19);
}

#[test]
fn clearing_pending_has_no_effect_while_the_line_is_high() {
    let (mut core, mut board) = machine();
    board.line(3, true);
    write(&mut core, &mut board, ICPR, 8);
    assert_eq!(read(&mut core, &mut board, ISPR), 8);
    board.line(3, false);
    write(&mut core, &mut board, ICPR, 8);
    assert_eq!(read(&mut core, &mut board, ISPR), 0);
}

#[test]
fn lines_across_the_words_reach_their_registers() {
    let (mut core, mut board) = machine();
    for line in [31, 32, 47, 48, 63, 64, 89] {
        board.line(line, true);
        look(&mut core, &mut board);
        let register = u32::from(line / 32);
        assert_eq!(read(&mut core, &mut board, ISPR + 4 * register), 1 << (line % 32), "{line}");
        board.line(line, false);
        write(&mut core, &mut board, ICPR + 4 * register, u32::MAX);
        assert_eq!(read(&mut core, &mut board, ISPR + 4 * register), 0);
    }
}

#[test]
fn lines_and_priority_bits_that_the_part_does_not_have_read_zero() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, ISER + 8, u32::MAX);
    assert_eq!(read(&mut core, &mut board, ISER + 8), 0x03FF_FFFF);
    write(&mut core, &mut board, ISER + 12, u32::MAX);
    assert_eq!(read(&mut core, &mut board, ISER + 12), 0);
    write(&mut core, &mut board, IPR + 88, u32::MAX);
    assert_eq!(read(&mut core, &mut board, IPR + 88), 0x0000_F0F0);
    board.line(90, true);
    assert_eq!(read(&mut core, &mut board, ISPR + 8), 0);
    assert_eq!(read(&mut core, &mut board, 0xE000_E004), 2, "ICTR");
}

#[test]
fn a_priority_is_written_by_bytes_halfwords_and_words() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, IPR, 0x1020_3040);
    let half = access(&core, IPR + 2, Width::Half);
    core.system_write(&mut board, &half, 0xA0B0).unwrap();
    let byte = access(&core, IPR + 1, Width::Byte);
    core.system_write(&mut board, &byte, 0xC0).unwrap();
    assert_eq!(read(&mut core, &mut board, IPR), 0xA0B0_C040);
    assert_eq!(core.system_read(&mut board, &half), Ok(0xA0B0));
    assert!(core.take_unmodelled().is_empty());
}

#[test]
fn stir_pends_an_interrupt_and_is_for_unprivileged_code_only_if_allowed() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, STIR, 33);
    assert_eq!(read(&mut core, &mut board, ISPR + 4), 2);
    core.msr(20, 0, 1);
    assert_eq!(try_write(&mut core, &mut board, STIR, 34), Err(Fault::BusData(STIR)));
    core.system.scb.ccr |= super::super::CCR_USERSETMPEND;
    assert_eq!(try_write(&mut core, &mut board, STIR, 34), Ok(()));
    assert!(contains(&core.system.nvic.pending, 16 + 34));
}

#[test]
fn primask_basepri_and_faultmask_hold_back_what_they_mask() {
    let (mut core, mut board) = machine();
    enable(&mut core, &mut board, 0, 0x80);
    pend(&mut core, &mut board, 0);
    core.msr(16, 0, 1);
    assert_eq!(core.execution_priority(), 0);
    assert!(!look(&mut core, &mut board));
    assert_eq!(read(&mut core, &mut board, ICSR) >> 12 & 0x1FF, 16, "PRIMASK does not hide VECTPENDING");
    core.msr(16, 0, 0);
    core.msr(17, 0, 0x8F);
    assert_eq!(core.mrs(17), 0x80, "bits that are not implemented read zero");
    assert!(!look(&mut core, &mut board));
    assert_eq!(read(&mut core, &mut board, ICSR) >> 12 & 0x1FF, 0);
    core.msr(17, 0, 0x90);
    core.cps(true, false, true);
    assert_eq!((core.execution_priority(), core.mrs(19)), (-1, 1));
    assert!(!look(&mut core, &mut board));
    core.cps(false, false, true);
    assert!(core.attention);
    assert!(look(&mut core, &mut board));
}

#[test]
fn basepri_max_only_raises_the_priority() {
    let (mut core, _) = machine();
    core.msr(18, 0, 0x80);
    core.msr(18, 0, 0xC0);
    assert_eq!(core.mrs(18), 0x80);
    core.msr(18, 0, 0x40);
    core.msr(18, 0, 0);
    assert_eq!(core.mrs(17), 0x40);
}

#[test]
fn nmi_preempts_hard_fault_and_ignores_faultmask() {
    let (mut core, mut board) = machine();
    core.cps(true, true, true);
    write(&mut core, &mut board, ICSR, 1 << 31);
    assert!(look(&mut core, &mut board));
    assert_eq!((core.ipsr, core.execution_priority()), (2, -2));
    leave(&mut core, &mut board);
    assert!(core.faultmask, "NMI's return leaves FAULTMASK");
    core.cps(false, false, true);
    board.signals.drive_nmi(true);
    assert!(look(&mut core, &mut board), "the input does it too");
}

#[test]
fn faultmask_is_cleared_by_the_return_of_other_exceptions() {
    let (mut core, mut board) = machine();
    enable(&mut core, &mut board, 0, 0);
    pend(&mut core, &mut board, 0);
    look(&mut core, &mut board);
    core.cps(true, false, true);
    leave(&mut core, &mut board);
    assert!(!core.faultmask);
}

#[test]
fn icsr_tells_what_is_active_pending_and_whether_it_is_the_last() {
    let (mut core, mut board) = machine();
    enable(&mut core, &mut board, 0, 0x80);
    enable(&mut core, &mut board, 1, 0x40);
    pend(&mut core, &mut board, 0);
    look(&mut core, &mut board);
    assert_eq!(read(&mut core, &mut board, ICSR), 1 << 11 | 16);
    write(&mut core, &mut board, SHPR3, 0x00F0_0000);
    write(&mut core, &mut board, ICSR, 1 << 28);
    assert_eq!(read(&mut core, &mut board, ICSR), 1 << 28 | 14 << 12 | 1 << 11 | 16);
    write(&mut core, &mut board, ICSR, 1 << 27);
    pend(&mut core, &mut board, 1);
    assert_eq!(read(&mut core, &mut board, ICSR), 1 << 22 | 17 << 12 | 1 << 11 | 16);
    look(&mut core, &mut board);
    assert_eq!(read(&mut core, &mut board, ICSR), 17);
}

#[test]
fn wfi_wakes_for_an_interrupt_that_primask_masks_without_taking_it() {
    let (mut core, mut board) = machine();
    enable(&mut core, &mut board, 0, 0x80);
    core.cps(true, true, false);
    core.waiting = Some(false);
    assert!(!look(&mut core, &mut board));
    assert_eq!(core.waiting, Some(false));
    board.line(0, true);
    assert!(!look(&mut core, &mut board));
    assert_eq!(core.waiting, None);
    core.cps(false, true, false);
    assert!(look(&mut core, &mut board));
}

#[test]
fn wfi_does_not_wake_for_what_basepri_masks() {
    let (mut core, mut board) = machine();
    enable(&mut core, &mut board, 0, 0x80);
    core.msr(17, 0, 0x80);
    core.waiting = Some(false);
    board.line(0, true);
    assert!(!look(&mut core, &mut board));
    assert!(core.waiting.is_some());
}

#[test]
fn wfe_wakes_for_events_and_by_sevonpend_for_pending_interrupts() {
    let (mut core, mut board) = machine();
    core.waiting = Some(true);
    board.signals.raise_event();
    look(&mut core, &mut board);
    assert_eq!((core.waiting, core.event, board.signals.take_event()), (None, false, false));
    core.waiting = Some(true);
    board.line(0, true);
    look(&mut core, &mut board);
    assert!(core.waiting.is_some(), "a disabled interrupt is no event");
    write(&mut core, &mut board, SCR, 1 << 4);
    board.line(1, true);
    look(&mut core, &mut board);
    assert_eq!(core.waiting, None);
}

#[test]
fn exception_entry_and_return_set_event_and_clear_the_exclusive_monitor() {
    let (mut core, mut board) = machine();
    enable(&mut core, &mut board, 0, 0x80);
    pend(&mut core, &mut board, 0);
    core.exclusive = Some(RAM);
    look(&mut core, &mut board);
    assert!(core.event && core.exclusive.is_none());
    core.event = false;
    core.exclusive = Some(RAM);
    leave(&mut core, &mut board);
    assert!(core.event && core.exclusive.is_none());
}

#[test]
fn sleep_on_exit_sleeps_after_the_last_handler() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, SCR, 2 | 4);
    assert!(core.sleep_deep());
    enable(&mut core, &mut board, 0, 0x80);
    enable(&mut core, &mut board, 1, 0x40);
    pend(&mut core, &mut board, 0);
    look(&mut core, &mut board);
    pend(&mut core, &mut board, 1);
    look(&mut core, &mut board);
    leave(&mut core, &mut board);
    assert_eq!(core.waiting, None, "back in the other handler");
    leave(&mut core, &mut board);
    assert_eq!((core.waiting, core.r[15]), (Some(false), START));
    look(&mut core, &mut board);
    assert!(core.waiting.is_some());
    pend(&mut core, &mut board, 1);
    assert!(look(&mut core, &mut board));
    assert_eq!(board.word(core.r[13] + 24), START);
}
