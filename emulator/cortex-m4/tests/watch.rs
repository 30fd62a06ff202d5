//! Tests of the record of the active exception. Each handler, and the code returned to, begins with a store to the
//! device. The device logs the cycle of the store. The record must have the same cycle.

use crate::common;

use common::{Board, CODE, CONFIG, DEVICE, RAM, Rig};
use cortex_m4::{Core, Cost, Exit, Fast, Optimistic, Pessimistic, Register};

/// The instruction str r1, [r7], which stores to the device.
const MARK: u16 = 0x6039;
/// The instructions str r1, [r0] and str r2, [r0], which make interrupts 0 and 1 pending (NVIC_ISPR0).
const PEND_0: u16 = 0x6001;
const PEND_1: u16 = 0x6002;
/// The instructions str r4, [r3] and str r6, [r5], which enable both interrupts (NVIC_ISER0) and set their priorities
/// (NVIC_IPR0).
const SET_UP: [u16; 2] = [0x601C, 0x602E];
const RETURN: u16 = 0x4770;
const STAY: u16 = 0xE7FE;
const SVC: u16 = 0xDF00;

const HANDLERS: u32 = CODE + 0x100;

/// Makes a core that is about to execute `SET_UP` and then `thread`. `handlers` and `priorities` are those of
/// interrupts 0 and 1. SVC has the first handler.
fn rig<C: Cost>(thread: &[u16], handlers: [&[u16]; 2], priorities: [u8; 2]) -> Rig<C> {
    let mut board = Board::new(&[&SET_UP[..], thread].concat());
    for (index, code) in handlers.into_iter().enumerate() {
        let at = HANDLERS + 0x20 * index as u32;
        let mut put = |address: u32, bytes: &[u8]| {
            board.flash[address as usize..address as usize + bytes.len()].copy_from_slice(bytes);
        };
        put(4 * (16 + index as u32), &(at | 1).to_le_bytes());
        if index == 0 {
            put(4 * 11, &(at | 1).to_le_bytes());
        }
        for (nth, half) in code.iter().enumerate() {
            put(at + 2 * nth as u32, &half.to_le_bytes());
        }
    }
    let mut core = Core::new(CONFIG);
    core.reset(&mut board);
    let mut rig = Rig { core, board };
    rig.set(0, 0xE000_E200).set(1, 1).set(2, 2).set(3, 0xE000_E100).set(4, 3).set(5, 0xE000_E400).set(7, DEVICE);
    rig.set(6, u32::from(priorities[0]) | u32::from(priorities[1]) << 8);
    rig.core.watch_exceptions(true);
    rig
}

fn assert_record<C: Cost>(mut rig: Rig<C>, active: &[u16]) {
    assert_eq!(rig.core.run(&mut rig.board, 500), Exit::Until);
    let marks = rig.board.writes.iter().map(|&(.., cycle)| cycle);
    let expected: Vec<_> = marks.zip(active.iter().copied()).collect();
    assert_eq!(expected.len(), active.len(), "each handler and each return leaves a mark");
    assert_eq!(rig.core.take_exceptions(), expected, "{}", C::NAME);
    assert_eq!(rig.core.take_exceptions(), [], "what was taken is gone");
    assert_eq!(rig.core.exception_changes(), active.len() as u64);
    assert_eq!(rig.core.active_exception(), 0);
}

fn on_each_clock(thread: &[u16], handlers: [&[u16]; 2], priorities: [u8; 2], active: &[u16]) {
    assert_record(rig::<Fast>(thread, handlers, priorities), active);
    assert_record(rig::<Optimistic>(thread, handlers, priorities), active);
    assert_record(rig::<Pessimistic>(thread, handlers, priorities), active);
}

#[test]
fn a_nested_preemption_is_recorded_with_both_entries_and_both_returns() {
    let low: &[u16] = &[MARK, PEND_1, MARK, RETURN];
    on_each_clock(&[PEND_0, MARK, STAY], [low, &[MARK, RETURN]], [0x80, 0x40], &[16, 17, 16, 0]);
}

#[test]
fn a_tail_chained_handler_follows_in_the_record_without_thread_mode_between() {
    let first: &[u16] = &[MARK, PEND_1, RETURN];
    on_each_clock(&[PEND_0, MARK, STAY], [first, &[MARK, RETURN]], [0x40, 0x80], &[16, 17, 0]);
}

#[test]
fn a_handler_that_follows_itself_is_recorded_twice() {
    // The handler makes its own interrupt pending once: str r1, [r7]; cmp r8, r9; bne to the return; str r1, [r0]; mov
    // r8, r1; bx lr.
    let handler: &[u16] = &[MARK, 0x45C8, 0xD101, PEND_0, 0x4688, RETURN];
    let mut rig = rig::<Fast>(&[PEND_0, MARK, STAY], [handler, &[]], [0x40, 0x80]);
    rig.set(8, 0).set(9, 0);
    assert_record(rig, &[16, 16, 0]);
}

#[test]
fn a_supervisor_call_is_recorded_at_the_first_instruction_of_its_handler() {
    on_each_clock(&[SVC, MARK, STAY], [&[MARK, RETURN], &[]], [0x40, 0x80], &[11, 0]);
}

#[test]
fn changes_are_counted_and_not_recorded_where_nobody_watches() {
    let mut rig = rig::<Fast>(&[SVC, MARK, STAY], [&[MARK, RETURN], &[]], [0x40, 0x80]);
    rig.core.watch_exceptions(false);
    rig.core.run(&mut rig.board, 500);
    assert_eq!((rig.core.exception_changes(), rig.core.take_exceptions()), (2, vec![]));
}

#[test]
fn a_record_that_nobody_takes_keeps_its_first_4096_changes() {
    // The code is: svc; b back to the svc.
    let mut rig = rig::<Fast>(&[SVC, 0xE7FD], [&[RETURN], &[]], [0x40, 0x80]);
    rig.core.run(&mut rig.board, 200_000);
    assert!(rig.core.exception_changes() > 5000);
    let record = rig.core.take_exceptions();
    assert_eq!((record.len(), record[0].1, record[4095].1), (4096, 11, 0));
    assert!(record.is_sorted_by(|a, b| a.0 < b.0));
    rig.core.run(&mut rig.board, 200_200);
    assert!(!rig.core.take_exceptions().is_empty(), "there is room again");
}

#[test]
fn a_reset_in_a_handler_is_a_change_to_thread_mode() {
    let mut rig = rig::<Fast>(&[SVC, STAY], [&[STAY], &[]], [0x40, 0x80]);
    rig.core.run(&mut rig.board, 500);
    assert_eq!(rig.core.active_exception(), 11);
    rig.core.take_exceptions();
    let at = rig.core.cycle();
    rig.core.reset(&mut rig.board);
    assert_eq!(rig.core.take_exceptions(), [(at, 0)]);
    rig.core.reset(&mut rig.board);
    assert_eq!(rig.core.take_exceptions(), [], "it was in thread mode already");
}

#[test]
fn a_debugger_that_writes_the_exception_number_changes_it_once() {
    let mut rig = Rig::new(&[STAY]);
    rig.core.set_register(Register::Xpsr, 0xF100_0000);
    assert_eq!(rig.core.exception_changes(), 0, "flags alone");
    rig.core.set_register(Register::Xpsr, 0x0100_0010);
    assert_eq!((rig.core.exception_changes(), rig.core.active_exception()), (1, 16));
    assert_eq!(rig.r(13), RAM + 0x1000);
}
