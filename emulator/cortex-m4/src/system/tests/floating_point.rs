//! Tests of the floating-point context in exceptions.

use super::super::*;
use super::*;
use crate::Optimistic;

fn floating<C: Cost>(fpccr: u32) -> (Core<C>, Board) {
    let (mut core, mut board) = machine_of::<C>();
    write(&mut core, &mut board, CPACR, 0xF << 20);
    write(&mut core, &mut board, FPCCR, fpccr);
    core.fp_ready(&mut board).unwrap();
    for index in 0..32 {
        core.s[index] = 1000 + index as u32;
    }
    core.fpscr = 0x0300_0011;
    enable(&mut core, &mut board, 0, 0x80);
    pend(&mut core, &mut board, 0);
    (core, board)
}

const LAZY: u32 = FPCCR_ASPEN | FPCCR_LSPEN;

#[test]
fn the_fpu_is_a_usage_fault_until_cpacr_allows_it() {
    let (mut core, mut board) = machine();
    assert_eq!(core.fp_ready(&mut board), Err(Fault::NoCoprocessor));
    write(&mut core, &mut board, CPACR, 0x5 << 20);
    assert_eq!(core.fp_ready(&mut board), Ok(()));
    core.msr(20, 0, 1);
    assert_eq!(core.fp_ready(&mut board), Err(Fault::NoCoprocessor), "privileged access only");
}

#[test]
fn the_first_use_begins_a_context_with_the_default_status() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, CPACR, 0xF << 20);
    write(&mut core, &mut board, 0xE000_EF3C, 0xFFFF_FFFF);
    core.fpscr = 0x1000_0001;
    core.fp_ready(&mut board).unwrap();
    assert_eq!((core.fpscr, core.control), (0x17C0_0001, 4));
    core.fpscr = 0;
    core.fp_ready(&mut board).unwrap();
    assert_eq!(core.fpscr, 0, "once for each context");
}

#[test]
fn without_automatic_state_there_is_no_context() {
    let (core, _) = floating::<Fast>(0);
    assert_eq!(core.control, 0);
}

#[test]
fn an_extended_frame_holds_the_registers_when_lazy_preservation_is_off() {
    let (mut core, mut board) = floating::<Optimistic>(FPCCR_ASPEN);
    let before = core.cycle;
    look(&mut core, &mut board);
    assert_eq!((core.r[14], core.r[13], core.control), (0xFFFF_FFE9, TOP - 104, 0));
    assert_eq!(core.cycle - before, 12 + 17);
    assert_eq!((board.word(TOP - 72), board.word(TOP - 12), board.word(TOP - 8)), (1000, 1015, 0x0300_0011));
    core.s = [0; 32];
    core.fpscr = 0;
    leave(&mut core, &mut board);
    assert_eq!((core.s[0], core.s[15], core.s[16], core.fpscr), (1000, 1015, 0, 0x0300_0011));
    assert_eq!((core.control, core.r[13]), (4, TOP));
}

#[test]
fn lazy_preservation_only_reserves_room_while_the_fpu_is_unused() {
    let (mut core, mut board) = floating::<Optimistic>(LAZY);
    let before = core.cycle;
    look(&mut core, &mut board);
    assert_eq!((core.r[13], core.cycle - before), (TOP - 104, 12));
    assert_eq!(board.word(TOP - 72), 0);
    assert_eq!(core.system.scb.fpcar, TOP - 72);
    assert_eq!(read(&mut core, &mut board, FPCCR), LAZY | FPCCR_LSPACT | FPCCR_THREAD | FPCCR_HFRDY);
    leave(&mut core, &mut board);
    assert_eq!((core.s[0], core.fpscr, core.control), (1000, 0x0300_0011, 4));
    assert_eq!(read(&mut core, &mut board, FPCCR) & 1, 0);
}

#[test]
fn a_handlers_first_fp_instruction_saves_the_state_for_the_return() {
    let (mut core, mut board) = floating::<Fast>(LAZY);
    look(&mut core, &mut board);
    core.fp_ready(&mut board).unwrap();
    assert_eq!((board.word(TOP - 72), board.word(TOP - 8)), (1000, 0x0300_0011));
    assert_eq!((core.fpscr, core.control), (0x11, 4));
    core.s[0] = 5;
    leave(&mut core, &mut board);
    assert_eq!((core.s[0], core.fpscr), (1000, 0x0300_0011));
}

#[test]
fn a_handler_with_a_context_of_its_own_is_stacked_with_it() {
    let (mut core, mut board) = floating::<Fast>(LAZY);
    look(&mut core, &mut board);
    core.fp_ready(&mut board).unwrap();
    enable(&mut core, &mut board, 1, 0);
    pend(&mut core, &mut board, 1);
    look(&mut core, &mut board);
    assert_eq!((core.r[14], core.r[13]), (0xFFFF_FFE1, TOP - 208));
    leave(&mut core, &mut board);
    assert_eq!((core.r[14], core.ipsr), (0xFFFF_FFE9, 16));
}

#[test]
fn a_lazy_preservation_fault_is_taken_at_the_fp_instruction() {
    let (mut core, mut board) = floating::<Fast>(LAZY);
    write(&mut core, &mut board, SHCSR, 1 << 17);
    look(&mut core, &mut board);
    assert_ne!(read(&mut core, &mut board, FPCCR) & FPCCR_BFRDY, 0);
    core.system.scb.fpcar = 0x7000_0000;
    let at = core.r[15];
    let fault = core.fp_ready(&mut board).unwrap_err();
    assert_eq!(fault, Fault::BusLazy);
    core.take_fault(&mut board, fault);
    assert_eq!((core.ipsr, core.system.scb.cfsr, board.word(core.r[13] + 24)), (5, CFSR_LSPERR, at));
}

#[test]
fn a_fault_of_lazy_preservation_that_cannot_be_taken_yet_waits() {
    let (mut core, mut board) = floating::<Fast>(LAZY);
    write(&mut core, &mut board, SHCSR, 1 << 17);
    write(&mut core, &mut board, SHPR1, 0xC000);
    look(&mut core, &mut board);
    core.system.scb.fpcar = 0x7000_0000;
    assert_eq!(core.fp_ready(&mut board), Ok(()));
    assert_eq!(read(&mut core, &mut board, FPCCR) & 1, 0);
    core.exception_return(&mut board, 0xFFFF_FFE9);
    assert_eq!(core.ipsr, 5);
}
