//! Compares code executed in bursts with the same code executed instruction by instruction.

use std::sync::Arc;

use crate::common;

use common::{RAM, Rig};
use cortex_m4::coverage::Record;
use cortex_m4::{Cost, Exit, Fast, Optimistic, Pessimistic, Register};

fn next(state: &mut u64) -> u32 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let word = (*state ^ *state >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    (word ^ word >> 27).wrapping_mul(0x94D0_49BB_1331_11EB) as u32
}

/// Draws an instruction that may be anywhere in an IT block. It uses r0 to r5; r6 is an address in RAM.
fn anywhere(draw: u32) -> Vec<u16> {
    let operands = (draw >> 8) as u16;
    let (d, n) = (operands % 6, operands / 8 % 6);
    match draw % 10 {
        0 => vec![0x2000 | d << 8 | operands & 3],
        1 => vec![0x3000 | d << 8 | operands & 0xFF],
        2 => vec![0x1A00 | n << 3 | d],
        // The instruction is lsls or lsrs with an amount.
        3 => vec![operands & 0x0800 | (operands & 0x7C0 | 0x40) | n << 3 | d],
        // The instruction is ands, eors, adcs, tst, muls or mvns.
        4 => vec![0x4000 | [0, 1, 5, 8, 13, 15][usize::from(operands / 64 % 6)] << 6 | n << 3 | d],
        5 => vec![0x2800 | d << 8 | operands & 1],
        6 => vec![0x4280 | n << 3 | d],
        // The instruction is adds.w. Its second halfword is an instruction too.
        7 => vec![0xF110 | n, d << 8 | operands & 0x7F],
        8 => vec![0x6030 | operands & 0xC0 | d],
        _ => vec![0x6830 | operands & 0xC0 | d],
    }
}

/// Draws a program that ends in `b .`. It has IT blocks of all kinds, and branches into the middle of them.
fn program(state: &mut u64) -> Vec<u16> {
    let mut code = vec![];
    while code.len() < 60 {
        let draw = next(state);
        match draw % 8 {
            0..=2 => {
                let (condition, mask) = ((draw >> 4) as u16 % 14, (draw >> 8) as u16 % 15 + 1);
                code.push(0xBF00 | condition << 4 | mask);
                for _ in 0..4 - mask.trailing_zeros() {
                    code.extend(anywhere(next(state)));
                }
            }
            3 => code.push(0xD000 | ((draw >> 4) as u16 % 14) << 8 | ((draw >> 8) as u16 % 6)),
            _ => code.extend(anywhere(next(state))),
        }
    }
    code.extend([0xBF00; 10]);
    code.push(0xE7FE);
    code
}

fn state<C: Cost>(rig: &Rig<C>) -> (Vec<u32>, u64, u64, Vec<u8>) {
    let registers = (0..16).map(Register::R).chain([Register::Xpsr]).map(|register| rig.core.register(register));
    (registers.collect(), rig.core.cycle(), rig.core.retired(), rig.board.ram[..16].to_vec())
}

fn each_end_is_a_boundary<C: Cost>(waits: u32) {
    let mut random = 1;
    for _ in 0..60 {
        let mut start = Rig::<C>::with_clock(&program(&mut random));
        start.board.waits = waits;
        start.board.logs = false;
        start.set_nzcv(next(&mut random) & 0xF).set(6, RAM);
        let mut stepped = start.clone();
        let mut steps = 0;
        while steps < 200 {
            let before = stepped.core.cycle();
            stepped.steps(1);
            steps += 1;
            if stepped.core.cycle() == before {
                continue;
            }
            let mut run = start.clone();
            assert_eq!(run.core.run(&mut run.board, before + 1), Exit::Until);
            assert_eq!(state(&run), state(&stepped), "{} with {waits} after {steps} steps", C::NAME);
        }
    }
}

#[test]
fn a_run_that_ends_anywhere_is_where_single_steps_come_to() {
    each_end_is_a_boundary::<Fast>(0);
    each_end_is_a_boundary::<Optimistic>(0);
    each_end_is_a_boundary::<Optimistic>(1);
    each_end_is_a_boundary::<Pessimistic>(2);
}

#[test]
fn a_branch_to_itself_is_where_as_many_single_steps_come_to() {
    fn check<C: Cost>(waits: u32, recorded: bool) {
        // The branch is at a multiple of 4, behind it, or in an IT block (it al) after some cycles.
        for code in [&[0xE7FE][..], &[0xBF00, 0xE7FE], &[0x2101, 0xBFE8, 0xE7FE]] {
            let mut run = Rig::<C>::with_clock(code);
            run.board.waits = waits;
            let mut stepped = run.clone();
            if recorded {
                run.core.set_record(Some(Arc::new(Record::new([]))));
            }
            for (until, due) in [(300, u64::MAX), (1_000, 777), (1_001, u64::MAX)] {
                run.board.due = due;
                assert_eq!(run.core.run(&mut run.board, until), Exit::Until);
                stepped.board.due = due;
                while stepped.core.cycle() < until {
                    stepped.steps(1);
                }
                assert_eq!(state(&run), state(&stepped), "{} with {waits} to {until}: {code:x?}", C::NAME);
                assert_eq!(run.board.advanced, stepped.board.advanced);
            }
        }
    }
    for recorded in [false, true] {
        check::<Fast>(0, recorded);
        check::<Optimistic>(0, recorded);
        check::<Pessimistic>(2, recorded);
    }
}
