//! Tests of stacking, EXC_RETURN, the checks of a return, and the cycles that entry and return cost.

use super::*;
use crate::{Optimistic, Pessimistic};

fn interrupted<C: Cost>() -> (Core<C>, Board) {
    let (mut core, mut board) = machine_of::<C>();
    enable(&mut core, &mut board, 0, 0x80);
    enable(&mut core, &mut board, 1, 0x40);
    pend(&mut core, &mut board, 0);
    (core, board)
}

#[test]
fn a_reset_takes_stack_pointer_and_program_counter_from_the_vector_table() {
    let (core, _) = machine();
    assert_eq!((core.r[13], core.r[15], core.r[14], core.thumb), (TOP, START, 0xFFFF_FFFF, true));
    assert_eq!((core.ipsr, core.control, core.is_privileged()), (0, 0, true));
}

#[test]
fn a_basic_frame_holds_the_eight_words_in_the_architectures_order() {
    let (mut core, mut board) = interrupted::<Fast>();
    for index in 0..13 {
        core.r[index] = 100 + index as u32;
    }
    core.r[14] = 114;
    core.set_xpsr(0xF90F_0000);
    core.it = 0b0110_1101;
    let xpsr = core.xpsr();
    assert!(look(&mut core, &mut board));
    assert_eq!(core.r[13], TOP - 32);
    let frame: Vec<u32> = (0..8).map(|index| board.word(TOP - 32 + 4 * index)).collect();
    assert_eq!(frame, [100, 101, 102, 103, 112, 114, START, xpsr]);
    assert_eq!((core.it, core.thumb, core.r[14]), (0, true, 0xFFFF_FFF9));
    leave(&mut core, &mut board);
    assert_eq!((core.xpsr(), core.it), (xpsr, 0b0110_1101));
    assert_eq!((core.r[13], core.r[12], core.r[14], core.r[15]), (TOP, 112, 114, START));
}

#[test]
fn an_interrupted_load_multiple_keeps_its_progress_across_an_exception() {
    let (mut core, mut board) = interrupted::<Fast>();
    core.ici = 7;
    look(&mut core, &mut board);
    assert_eq!(core.ici, 0);
    leave(&mut core, &mut board);
    assert_eq!((core.ici, core.it), (7, 0));
}

#[test]
fn exception_entry_aligns_the_stack_and_the_return_restores_it() {
    let (mut core, mut board) = interrupted::<Fast>();
    core.r[13] = TOP - 4;
    look(&mut core, &mut board);
    assert_eq!(core.r[13], TOP - 40);
    assert_ne!(board.word(core.r[13] + 28) & 1 << 9, 0);
    leave(&mut core, &mut board);
    assert_eq!(core.r[13], TOP - 4);
    write(&mut core, &mut board, CCR, 0);
    pend(&mut core, &mut board, 0);
    look(&mut core, &mut board);
    assert_eq!(core.r[13], TOP - 36, "not without STKALIGN");
    leave(&mut core, &mut board);
    assert_eq!(core.r[13], TOP - 4);
}

#[test]
fn an_exception_from_the_process_stack_runs_on_the_main_stack() {
    let (mut core, mut board) = interrupted::<Fast>();
    core.msr(9, 0, PROCESS_TOP);
    core.msr(20, 0, 2);
    assert_eq!((core.r[13], core.mrs(8), core.mrs(9)), (PROCESS_TOP, TOP, PROCESS_TOP));
    look(&mut core, &mut board);
    assert_eq!((core.r[14], core.r[13], core.mrs(9)), (0xFFFF_FFFD, TOP, PROCESS_TOP - 32));
    assert_eq!(board.word(PROCESS_TOP - 8), START);
    core.msr(20, 0, 2);
    assert_eq!(core.mrs(20), 0, "SPSEL cannot be written in handler mode");
    leave(&mut core, &mut board);
    assert_eq!((core.r[13], core.mrs(20), core.mrs(8)), (PROCESS_TOP, 2, TOP));
}

#[test]
fn the_vector_table_can_be_moved() {
    let (mut core, mut board) = interrupted::<Fast>();
    write(&mut core, &mut board, VTOR, RAM | 0x17F);
    assert_eq!(read(&mut core, &mut board, VTOR), RAM | 0x100);
    board.set_word(RAM + 0x100 + 4 * 16, 0x3001);
    look(&mut core, &mut board);
    assert_eq!(core.r[15], 0x3000);
}

#[test]
fn a_vector_without_the_thumb_bit_clears_the_cores_thumb_state() {
    let (mut core, mut board) = interrupted::<Fast>();
    board.vector(16, 0x3000);
    look(&mut core, &mut board);
    assert!(!core.thumb);
}

fn invalid_return(core: &Core<Fast>, board: &Board) {
    assert_eq!(core.ipsr, 3, "UsageFault is off: HardFault");
    assert_eq!(core.system.scb.cfsr, 1 << 18);
    assert_ne!(core.system.scb.hfsr & 1 << 30, 0);
    let _ = board;
}

#[test]
fn a_return_with_reserved_bits_is_an_invalid_pc() {
    for value in [0xFFFF_FFF0, 0xFFFF_FFF5, 0xFFFF_FFFF, 0xF000_0009] {
        let (mut core, mut board) = interrupted::<Fast>();
        look(&mut core, &mut board);
        core.exception_return(&mut board, value);
        invalid_return(&core, &board);
        assert_eq!((core.r[13], core.r[14]), (TOP - 32, value), "nothing was unstacked or stacked");
    }
}

#[test]
fn a_return_from_an_inactive_exception_is_an_invalid_pc() {
    let (mut core, mut board) = interrupted::<Fast>();
    look(&mut core, &mut board);
    core.ipsr = 20;
    leave(&mut core, &mut board);
    invalid_return(&core, &board);
}

#[test]
fn a_return_to_thread_mode_under_another_handler_needs_nonbasethrdena() {
    let (mut core, mut board) = interrupted::<Fast>();
    look(&mut core, &mut board);
    pend(&mut core, &mut board, 1);
    look(&mut core, &mut board);
    let mut allowed = (core.clone(), board.clone());
    core.exception_return(&mut board, 0xFFFF_FFF9);
    invalid_return(&core, &board);
    let (core, board) = (&mut allowed.0, &mut allowed.1);
    write(core, board, CCR, 0x201);
    // The frame on top of the stack would return to handler mode. The test changes it so that it returns to thread
    // mode.
    let xpsr = core.r[13] + 28;
    board.set_word(xpsr, 0x0100_0000);
    core.exception_return(board, 0xFFFF_FFF9);
    assert_eq!(core.ipsr, 0);
}

#[test]
fn a_return_into_another_mode_is_an_invalid_pc() {
    let (mut core, mut board) = interrupted::<Fast>();
    look(&mut core, &mut board);
    board.set_word(TOP - 4, 0x0100_0010);
    leave(&mut core, &mut board);
    invalid_return(&core, &board);
    assert_eq!(core.r[14], 0xFFFF_FFF9);
}

#[test]
fn a_usage_fault_that_is_on_takes_the_invalid_return() {
    let (mut core, mut board) = interrupted::<Fast>();
    write(&mut core, &mut board, SHCSR, 1 << 18);
    look(&mut core, &mut board);
    core.exception_return(&mut board, 0xFFFF_FFF0);
    assert_eq!((core.ipsr, core.system.scb.hfsr), (6, 0));
}

#[test]
fn entry_return_and_tail_chain_cost_what_the_manual_says() {
    fn cost<C: Cost>() -> [u64; 3] {
        let (mut core, mut board) = interrupted::<C>();
        let before = core.cycle;
        look(&mut core, &mut board);
        let entry = core.cycle - before;
        write(&mut core, &mut board, IPR, 0x8080_8080);
        pend(&mut core, &mut board, 1);
        let before = core.cycle;
        leave(&mut core, &mut board);
        let chain = core.cycle - before;
        let before = core.cycle;
        leave(&mut core, &mut board);
        [entry, chain, core.cycle - before]
    }
    assert_eq!(cost::<Fast>(), [0, 0, 0]);
    assert_eq!(cost::<Optimistic>(), [12, 6, 10]);
    assert_eq!(cost::<Pessimistic>(), [12, 6, 12]);
}

#[test]
fn a_late_higher_exception_is_taken_first_with_the_same_frame() {
    let (mut core, mut board) = interrupted::<Optimistic>();
    board.later = Some((core.cycle + 5, 1));
    look(&mut core, &mut board);
    assert_eq!((core.ipsr, core.r[13]), (17, TOP - 32));
    board.line(1, false);
    leave(&mut core, &mut board);
    assert_eq!((core.ipsr, core.r[13]), (16, TOP - 32));
}

#[test]
fn unprivileged_code_reaches_only_what_it_may_of_the_special_registers() {
    let (mut core, _) = machine();
    core.set_xpsr(0xF90F_0000);
    core.msr(20, 0, 1);
    core.msr(16, 0, 1);
    core.cps(true, true, true);
    core.msr(20, 0, 0);
    core.msr(8, 0, 0);
    assert_eq!((core.primask, core.faultmask, core.control, core.r[13]), (false, false, 1, TOP));
    assert_eq!((core.mrs(8), core.mrs(9), core.mrs(16), core.mrs(20)), (0, 0, 0, 1));
    assert_eq!(core.mrs(0), 0xF80F_0000);
    core.msr(0, 2, 0);
    assert_eq!(core.mrs(3), 0x000F_0000);
    core.msr(0, 1, 0);
    assert_eq!(core.mrs(0), 0);
}
