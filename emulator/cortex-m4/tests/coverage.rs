//! Tests of the record of executed instructions and outcomes, on small programs whose paths are known.

use std::sync::Arc;

use cortex_m4::Exit;
use cortex_m4::coverage::{Flow, Record, Seen, conditional, flow};

use crate::common::{Board, CODE, RAM, Rig};

const STAY: u16 = 0xE7FE;
const NEVER: Seen = Seen { executed: false, passed: false, failed: false };
const RUN: Seen = Seen { executed: true, ..NEVER };
const BOTH: Seen = Seen { executed: true, passed: true, failed: true };
const TAKEN: Seen = Seen { executed: true, passed: true, failed: false };
const NOT_TAKEN: Seen = Seen { executed: true, passed: false, failed: true };
const SKIPPED: Seen = Seen { executed: false, passed: false, failed: true };

fn bytes(code: &[u16]) -> Vec<u8> {
    code.iter().flat_map(|half| half.to_le_bytes()).collect()
}

/// Runs `code` for `cycles`, and returns what is known of each of its halfwords, and the board.
fn seen(code: &[u16], cycles: u64) -> (Vec<Seen>, Board) {
    let mut rig = Rig::new(code);
    let record = Arc::new(Record::new([(CODE, bytes(code))]));
    rig.core.set_record(Some(record.clone()));
    assert_eq!(rig.core.run(&mut rig.board, cycles), Exit::Until);
    ((0..code.len() as u32).map(|index| record.seen(CODE + 2 * index)).collect(), rig.board)
}

#[test]
fn a_loop_goes_both_ways_and_what_it_skips_never_executes() {
    // The code is: movs r0, #3; subs r0, #1; bne back to it; b over the next; nop; b .
    let (seen, _) = seen(&[0x2003, 0x3801, 0xD1FD, 0xE000, 0xBF00, STAY], 100);
    assert_eq!(seen, [RUN, RUN, BOTH, RUN, NEVER, RUN]);
}

#[test]
fn branches_that_go_one_way_only_are_told_apart() {
    // The code is: movs r0, #0; cbz r0 over the next; nop; cbnz r0 over the next; nop; cmp r0, #0; beq over the next;
    // nop; bne; b .
    let code = [0x2000, 0xB100, 0xBF00, 0xB900, 0xBF00, 0x2800, 0xD000, 0xBF00, 0xD100, STAY];
    let (seen, _) = seen(&code, 100);
    assert_eq!(seen, [RUN, TAKEN, NEVER, NOT_TAKEN, RUN, RUN, TAKEN, NEVER, NOT_TAKEN, RUN]);
}

#[test]
fn instructions_of_an_it_block_pass_or_are_skipped() {
    // The code is: movs r0, #1; cmp r0, #1; ite eq; moveq r1, #7; movne r1, #9; and again with r0 == 2; b .
    let block = [0x2801, 0xBF0C, 0x2107, 0x2109];
    let once = [&[0x2001][..], &block, &[STAY]].concat();
    assert_eq!(seen(&once, 100).0, [RUN, RUN, RUN, TAKEN, SKIPPED, RUN]);
    // The code is a block that is executed with r0 from 1 to 2: adds r0, #1; cmp r0, #3; bne back to the block; b .
    let twice = [&[0x2001][..], &block, &[0x3001, 0x2803, 0xD1F8, STAY]].concat();
    assert_eq!(seen(&twice, 100).0, [RUN, RUN, RUN, BOTH, BOTH, RUN, RUN, BOTH, RUN]);
}

#[test]
fn code_in_ram_is_recorded_where_it_runs_until_it_is_changed() {
    // The code at the start of RAM is: movs r1, #5; bx r14. Its caller is: blx r2; str r3, [r4], which changes the
    // first instruction in RAM; blx r2.
    let in_ram = [0x2105, 0x4770];
    let mut rig = Rig::new(&[0x4790, 0x6023, 0x4790, STAY]);
    rig.board.ram[..4].copy_from_slice(&bytes(&in_ram));
    rig.set(2, RAM | 1).set(3, 0x4770_2106).set(4, RAM);
    let record = Arc::new(Record::new([(RAM, bytes(&in_ram))]));
    rig.core.set_record(Some(record.clone()));
    rig.core.run(&mut rig.board, 3);
    assert_eq!([record.seen(RAM), record.seen(RAM + 2), record.seen(CODE)], [RUN, RUN, NEVER]);

    let record = Arc::new(Record::new([(RAM, bytes(&in_ram))]));
    rig.core.set_record(Some(record.clone()));
    rig.core.run(&mut rig.board, 100);
    assert_eq!(rig.r(1), 6, "the changed instruction was executed");
    assert_eq!([record.seen(RAM), record.seen(RAM + 2)], [NEVER, RUN]);
}

#[test]
fn a_core_with_a_record_runs_as_one_without() {
    let code = [0x2003, 0x3801, 0xBF18, 0x1C49, 0xD1FB, 0xE7F9];
    let (mut plain, mut noted) = (Rig::new(&code), Rig::new(&code));
    let record = Arc::new(Record::new([(CODE, bytes(&code))]));
    noted.core.set_record(Some(record.clone()));
    for until in [1, 7, 100, 1_003] {
        for rig in [&mut plain, &mut noted] {
            rig.core.run(&mut rig.board, until);
        }
        let state = |rig: &Rig<_>| (rig.core.cycle(), rig.core.retired(), rig.core.pc(), rig.r(0), rig.r(1));
        assert_eq!(state(&plain), state(&noted));
    }
    assert_eq!(record.seen(CODE + 6), BOTH);
}

#[test]
fn a_burst_notes_what_single_steps_note() {
    // The code is: 511 times movs r1, #1, so that the next page begins; movs r0, #3; subs r0, #1; it eq; moveq r1, #7;
    // bne back to subs; cbz r0 over the next; nop; ldr r0, [r2] where nothing answers; nop.
    let loops = [0x2003, 0x3801, 0xBF08, 0x2107, 0xD1FB, 0xB100, 0xBF00, 0x6810, 0xBF00];
    let code = [&[0x2101; 511][..], &loops].concat();
    let record = || Arc::new(Record::new([(CODE, bytes(&code))]));
    let (of_bursts, of_steps) = (record(), record());
    let mut rig = Rig::new(&code);
    rig.set(2, 0x6000_0000);
    let mut stepped = rig.clone();
    rig.core.set_record(Some(of_bursts.clone()));
    stepped.core.set_record(Some(of_steps.clone()));
    // Bursts end at the run's end, wherever that is.
    for until in (3..700).step_by(3) {
        rig.core.run(&mut rig.board, until);
    }
    stepped.steps(525);
    for place in 0..code.len() as u32 {
        let address = CODE + 2 * place;
        assert_eq!(of_bursts.seen(address), of_steps.seen(address), "{place}");
    }
    let seen: Vec<Seen> = (510..520).map(|place| of_bursts.seen(CODE + 2 * place)).collect();
    assert_eq!(seen, [RUN, RUN, RUN, RUN, BOTH, BOTH, TAKEN, NEVER, NEVER, NEVER]);
}

#[test]
fn an_instruction_that_faults_is_not_executed() {
    // ldr r0, [r1] where nothing answers.
    let code = [0x6808, STAY];
    let mut rig = Rig::new(&code);
    let record = Arc::new(Record::new([(CODE, bytes(&code))]));
    rig.core.set_record(Some(record.clone()));
    rig.set(1, 0x6000_0000);
    rig.core.run(&mut rig.board, 20);
    assert_eq!(record.seen(CODE), NEVER);
}

#[test]
fn the_flow_of_an_instruction_tells_where_it_leads() {
    for (first, second, expected) in [
        (0x2000, 0, (2, Flow::On)),
        (0xD1FD, 0, (2, Flow::Either(0xFE))),
        (0xB100, 0, (2, Flow::Either(0x104))),
        (0xE000, 0, (2, Flow::To(0x104))),
        (0xF000, 0xF801, (4, Flow::Call(0x106))),
        (0x4790, 0, (2, Flow::CallRegister)),
        (0x4770, 0, (2, Flow::Elsewhere)),
        (0xBD10, 0, (2, Flow::Elsewhere)),
        (0xBC10, 0, (2, Flow::On)),
        (0xE8DF, 0xF000, (4, Flow::Table(false))),
        (0xE8DF, 0xF010, (4, Flow::Table(true))),
        (0xDE00, 0, (2, Flow::Stop)),
        (0xBE00, 0, (2, Flow::Stop)),
    ] {
        assert_eq!(flow(0x100, first, second), expected, "{first:04X} {second:04X}");
    }
    // ITE EQ: two conditional instructions.
    assert_eq!(flow(0x100, 0xBF0C, 0), (2, Flow::Block(0x0C)));
    assert_eq!(conditional(0x0C), (true, 0x18));
    assert_eq!(conditional(0x18), (true, 0));
    assert_eq!(conditional(0), (false, 0));
    // IT AL has no condition.
    assert_eq!(conditional(0xE8), (false, 0));
}
