//! Tests of loads, stores, exclusive accesses and bit-banding.

use super::{Case, check};
use crate::common::{RAM, Rig};

#[test]
fn loads_extend_and_write_their_base_back() {
    check(&[
        Case {
            name: "ldr r0, [r2, #4]",
            code: &[0x6850],
            steps: 1,
            before: &[(2, 0x20000100)],
            nzcv: None,
            after: &[(0, 0x87868584)],
            left: None,
        },
        Case {
            name: "ldrsb r0, [r2, #3]",
            code: &[0xF992, 0x0003],
            steps: 1,
            before: &[(2, 0x20000100)],
            nzcv: None,
            after: &[(0, 0xFFFFFF83)],
            left: None,
        },
        Case {
            name: "ldrsh.w r0, [r2, r3, lsl #1]",
            code: &[0xF932, 0x0013],
            steps: 1,
            before: &[(2, 0x20000100), (3, 2)],
            nzcv: None,
            after: &[(0, 0xFFFF8584)],
            left: None,
        },
        Case {
            name: "ldr r0, [r2], #8",
            code: &[0xF852, 0x0B08],
            steps: 1,
            before: &[(2, 0x20000100)],
            nzcv: None,
            after: &[(0, 0x83828180), (2, 0x20000108)],
            left: None,
        },
        Case {
            name: "ldrb r0, [r2, #-1]!",
            code: &[0xF812, 0x0D01],
            steps: 1,
            before: &[(2, 0x20000101)],
            nzcv: None,
            after: &[(0, 0x80), (2, 0x20000100)],
            left: None,
        },
        Case {
            name: "ldrt r0, [r2, #4]",
            code: &[0xF852, 0x0E04],
            steps: 1,
            before: &[(2, 0x20000100)],
            nzcv: None,
            after: &[(0, 0x87868584)],
            left: None,
        },
        Case {
            name: "ldr.w r0, [r2, #1]",
            code: &[0xF8D2, 0x0001],
            steps: 1,
            before: &[(2, 0x20000100)],
            nzcv: None,
            after: &[(0, 0x84838281)],
            left: None,
        },
        Case {
            name: "ldrd r0, r1, [r2, #8]!",
            code: &[0xE9F2, 0x0102],
            steps: 1,
            before: &[(2, 0x20000100)],
            nzcv: None,
            after: &[(0, 0x8B8A8988), (1, 0x8F8E8D8C), (2, 0x20000108)],
            left: None,
        },
        Case {
            name: "ldm r2!, {r0, r1}",
            code: &[0xCA03],
            steps: 1,
            before: &[(2, 0x20000100)],
            nzcv: None,
            after: &[(0, 0x83828180), (1, 0x87868584), (2, 0x20000108)],
            left: None,
        },
        Case {
            name: "ldm r2, {r1, r2}",
            code: &[0xCA06],
            steps: 1,
            before: &[(2, 0x20000100)],
            nzcv: None,
            after: &[(1, 0x83828180), (2, 0x87868584)],
            left: None,
        },
        Case {
            name: "ldmdb r2!, {r0, r1}",
            code: &[0xE932, 0x0003],
            steps: 1,
            before: &[(2, 0x20000108)],
            nzcv: None,
            after: &[(0, 0x83828180), (1, 0x87868584), (2, 0x20000100)],
            left: None,
        },
        Case {
            name: "ldr r0, [pc, #4]; nop; nop; nop; .word 0x12345678",
            code: &[0x4801, 0xBF00, 0xBF00, 0xBF00, 0x5678, 0x1234],
            steps: 1,
            before: &[],
            nzcv: None,
            after: &[(0, 0x12345678)],
            left: None,
        },
    ]);
}

#[test]
fn exclusive_stores_succeed_once() {
    check(&[
        Case {
            name: "ldrex r0, [r2]; strex r1, r3, [r2]; strex r4, r3, [r2]",
            code: &[0xE852, 0x0F00, 0xE842, 0x3100, 0xE842, 0x3400],
            steps: 3,
            before: &[(2, 0x20000100), (3, 9)],
            nzcv: None,
            after: &[(0, 0x83828180), (1, 0), (4, 1)],
            left: None,
        },
        Case {
            name: "ldrexb r0, [r2]; clrex; strexb r1, r3, [r2]",
            code: &[0xE8D2, 0x0F4F, 0xF3BF, 0x8F2F, 0xE8C2, 0x3F41],
            steps: 3,
            before: &[(2, 0x20000100)],
            nzcv: None,
            after: &[(0, 0x80), (1, 1)],
            left: None,
        },
    ]);
}

#[test]
fn stores_write_their_width_and_their_base_back() {
    // The code is: str r0, [r2]; strh r0, [r2, #6]; strb r0, [r2, #8]; str r0, [r2, #-4]!; strd r0, r1, [r2], #8; stmdb
    // r2!, {r0, r1}.
    let code = [0x6010, 0x80D0, 0x7210, 0xF842, 0x0D04, 0xE8E2, 0x0102, 0xE922, 0x0003];
    let mut rig = Rig::new(&code);
    rig.set(0, 0x1122_3344).set(1, 0x5566_7788).set(2, RAM + 0x100).steps(3);
    let words = |rig: &Rig<_>| [0, 4, 8].map(|offset| rig.board.word(RAM + 0x100 + offset));
    assert_eq!(words(&rig), [0x1122_3344, 0x3344_0000, 0x44]);
    rig.steps(1);
    assert_eq!((rig.r(2), rig.board.word(RAM + 0xFC)), (RAM + 0xFC, 0x1122_3344));
    rig.steps(1);
    assert_eq!((rig.r(2), rig.board.word(RAM + 0x100)), (RAM + 0x104, 0x5566_7788));
    rig.set(0, 1).set(1, 2).steps(1);
    assert_eq!((rig.r(2), rig.board.word(RAM + 0xFC), rig.board.word(RAM + 0x100)), (RAM + 0xFC, 1, 2));
}

#[test]
fn a_bit_band_alias_reaches_single_bits_where_the_part_has_it() {
    // The code is: str r0, [r2]; ldr r1, [r2].
    let mut rig = Rig::new(&[0x6010, 0x6811]);
    rig.board.bit_banding = true;
    rig.board.set_word(RAM + 0x100, 0xFFFF_0000);
    rig.set(0, 3).set(2, 0x2200_0000 + 0x100 * 32 + 5 * 4).steps(2);
    assert_eq!((rig.r(1), rig.board.word(RAM + 0x100)), (1, 0xFFFF_0020));
}
