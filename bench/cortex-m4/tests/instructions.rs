//! Integer instructions: each encoding against the state it leaves.
//!
//! Each case is the assembly, its halfwords, how many instructions are executed, registers and NZCV before, and after.
//! RAM holds 0x80, 0x81 and so on from 0x2000_0100 on. The code is at 0x100.

mod common;

use common::{RAM, Rig};

struct Case {
    name: &'static str,
    code: &'static [u16],
    steps: usize,
    before: &'static [(u8, u32)],
    nzcv: Option<u32>,
    after: &'static [(u8, u32)],
    left: Option<u32>,
}

fn check(cases: &[Case]) {
    for case in cases {
        let mut rig = Rig::new(case.code);
        for offset in 0..16 {
            rig.board.ram[0x100 + usize::from(offset)] = 0x80 + offset;
        }
        for &(n, value) in case.before {
            rig.set(n, value);
        }
        rig.set_nzcv(case.nzcv.unwrap_or(0));
        rig.steps(case.steps);
        for &(n, value) in case.after {
            assert_eq!(rig.r(n), value, "{}: r{n} is {:#x}, not {value:#x}", case.name, rig.r(n));
        }
        if let Some(left) = case.left {
            assert_eq!(rig.nzcv(), left, "{}: NZCV", case.name);
        }
    }
}

#[test]
fn shifts_give_their_carry() {
    check(&[
        Case {
            name: "lsls r0, r1, #1",
            code: &[0x0048],
            steps: 1,
            before: &[(1, 0x80000001)],
            nzcv: Some(0b0000),
            after: &[(0, 2)],
            left: Some(0b0010),
        },
        Case {
            name: "lsrs r0, r1, #32",
            code: &[0x0808],
            steps: 1,
            before: &[(1, 0x80000001)],
            nzcv: Some(0b0000),
            after: &[(0, 0)],
            left: Some(0b0110),
        },
        Case {
            name: "asrs r0, r1, #32",
            code: &[0x1008],
            steps: 1,
            before: &[(1, 0x80000001)],
            nzcv: Some(0b0000),
            after: &[(0, 0xFFFFFFFF)],
            left: Some(0b1010),
        },
        Case {
            name: "movs.w r0, r1, rrx",
            code: &[0xEA5F, 0x0031],
            steps: 1,
            before: &[(1, 1)],
            nzcv: Some(0b0010),
            after: &[(0, 0x80000000)],
            left: Some(0b1010),
        },
        Case {
            name: "rors r0, r1",
            code: &[0x41C8],
            steps: 1,
            before: &[(0, 1), (1, 1)],
            nzcv: Some(0b0000),
            after: &[(0, 0x80000000)],
            left: Some(0b1010),
        },
        Case {
            name: "lsls r0, r1",
            code: &[0x4088],
            steps: 1,
            before: &[(0, 1), (1, 0x20)],
            nzcv: Some(0b0000),
            after: &[(0, 0)],
            left: Some(0b0110),
        },
        Case {
            name: "lsrs r0, r1",
            code: &[0x40C8],
            steps: 1,
            before: &[(0, 0xFFFFFFFF), (1, 0x21)],
            nzcv: Some(0b0010),
            after: &[(0, 0)],
            left: Some(0b0100),
        },
        Case {
            name: "lsls r0, r1",
            code: &[0x4088],
            steps: 1,
            before: &[(0, 5), (1, 0x100)],
            nzcv: Some(0b0010),
            after: &[(0, 5)],
            left: Some(0b0010),
        },
    ]);
}

#[test]
fn additions_and_subtractions_set_carry_and_overflow() {
    check(&[
        Case {
            name: "adds r0, r1, r2",
            code: &[0x1888],
            steps: 1,
            before: &[(1, 0x7FFFFFFF), (2, 1)],
            nzcv: Some(0b0000),
            after: &[(0, 0x80000000)],
            left: Some(0b1001),
        },
        Case {
            name: "subs r0, r1, r2",
            code: &[0x1A88],
            steps: 1,
            before: &[(1, 0), (2, 1)],
            nzcv: Some(0b0000),
            after: &[(0, 0xFFFFFFFF)],
            left: Some(0b1000),
        },
        Case {
            name: "subs r0, r1, #1",
            code: &[0x1E48],
            steps: 1,
            before: &[(1, 1)],
            nzcv: Some(0b0000),
            after: &[(0, 0)],
            left: Some(0b0110),
        },
        Case {
            name: "adcs r0, r1",
            code: &[0x4148],
            steps: 1,
            before: &[(0, 0xFFFFFFFF), (1, 0)],
            nzcv: Some(0b0010),
            after: &[(0, 0)],
            left: Some(0b0110),
        },
        Case {
            name: "sbcs r0, r1",
            code: &[0x4188],
            steps: 1,
            before: &[(0, 5), (1, 5)],
            nzcv: Some(0b0000),
            after: &[(0, 0xFFFFFFFF)],
            left: Some(0b1000),
        },
        Case {
            name: "rsbs r0, r1, #0",
            code: &[0x4248],
            steps: 1,
            before: &[(1, 0x80000000)],
            nzcv: Some(0b0000),
            after: &[(0, 0x80000000)],
            left: Some(0b1001),
        },
        Case {
            name: "cmn r0, r1",
            code: &[0x42C8],
            steps: 1,
            before: &[(0, 1), (1, 0xFFFFFFFF)],
            nzcv: Some(0b0000),
            after: &[],
            left: Some(0b0110),
        },
        Case {
            name: "rsb r0, r1, r2, lsl #2",
            code: &[0xEBC1, 0x0082],
            steps: 1,
            before: &[(1, 1), (2, 3)],
            nzcv: Some(0b0000),
            after: &[(0, 0xB)],
            left: Some(0b0000),
        },
        Case {
            name: "addw r0, r1, #4095",
            code: &[0xF601, 0x70FF],
            steps: 1,
            before: &[(1, 1)],
            nzcv: None,
            after: &[(0, 0x1000)],
            left: None,
        },
    ]);
}

#[test]
fn modified_immediates_give_their_carry_to_logical_operations() {
    check(&[
        Case {
            name: "ands r0, r1, #0x80000000",
            code: &[0xF011, 0x4000],
            steps: 1,
            before: &[(1, 0xFFFFFFFF)],
            nzcv: Some(0b0000),
            after: &[(0, 0x80000000)],
            left: Some(0b1010),
        },
        Case {
            name: "movs.w r0, #0x00FF0000",
            code: &[0xF45F, 0x007F],
            steps: 1,
            before: &[],
            nzcv: Some(0b0010),
            after: &[(0, 0xFF0000)],
            left: Some(0b0000),
        },
        Case {
            name: "tst r1, #0x00FF00FF",
            code: &[0xF011, 0x1FFF],
            steps: 1,
            before: &[(1, 0xFF00FF00)],
            nzcv: Some(0b0010),
            after: &[],
            left: Some(0b0110),
        },
        Case {
            name: "orn r0, r1, #0xFF",
            code: &[0xF061, 0x00FF],
            steps: 1,
            before: &[(1, 0)],
            nzcv: None,
            after: &[(0, 0xFFFFFF00)],
            left: None,
        },
        Case {
            name: "teq r0, r1, lsl #31",
            code: &[0xEA90, 0x7FC1],
            steps: 1,
            before: &[(0, 0x80000000), (1, 3)],
            nzcv: Some(0b0000),
            after: &[],
            left: Some(0b0110),
        },
        Case {
            name: "mvn r0, #0xAB00AB00",
            code: &[0xF06F, 0x20AB],
            steps: 1,
            before: &[],
            nzcv: None,
            after: &[(0, 0x54FF54FF)],
            left: None,
        },
        Case {
            name: "bic r0, r1, #0xFF000000",
            code: &[0xF021, 0x407F],
            steps: 1,
            before: &[(1, 0x12345678)],
            nzcv: None,
            after: &[(0, 0x345678)],
            left: None,
        },
    ]);
}

#[test]
fn moves_and_addresses_know_the_program_counter() {
    check(&[
        Case {
            name: "movw r0, #0xABCD; movt r0, #0x1234",
            code: &[0xF64A, 0x30CD, 0xF2C1, 0x2034],
            steps: 2,
            before: &[],
            nzcv: None,
            after: &[(0, 0x1234ABCD)],
            left: None,
        },
        Case {
            name: "mov r0, pc",
            code: &[0x4678],
            steps: 1,
            before: &[],
            nzcv: None,
            after: &[(0, 0x104)],
            left: None,
        },
        Case {
            name: "nop; adr r0, .+4; nop; nop",
            code: &[0xBF00, 0xF20F, 0x0002, 0xBF00, 0xBF00],
            steps: 2,
            before: &[],
            nzcv: None,
            after: &[(0, 0x106)],
            left: None,
        },
        Case {
            name: "add r0, pc",
            code: &[0x4478],
            steps: 1,
            before: &[(0, 0x1000)],
            nzcv: None,
            after: &[(0, 0x1104)],
            left: None,
        },
        Case {
            name: "mov sp, r0",
            code: &[0x4685],
            steps: 1,
            before: &[(0, 0x20000403)],
            nzcv: None,
            after: &[(13, 0x20000400)],
            left: None,
        },
    ]);
}

#[test]
fn bit_fields_are_inserted_and_extracted() {
    check(&[
        Case {
            name: "bfi r0, r1, #8, #12",
            code: &[0xF361, 0x2013],
            steps: 1,
            before: &[(0, 0xFFFFFFFF), (1, 0x123)],
            nzcv: None,
            after: &[(0, 0xFFF123FF)],
            left: None,
        },
        Case {
            name: "bfc r0, #0, #32",
            code: &[0xF36F, 0x001F],
            steps: 1,
            before: &[(0, 0xFFFFFFFF)],
            nzcv: None,
            after: &[(0, 0)],
            left: None,
        },
        Case {
            name: "sbfx r0, r1, #4, #8",
            code: &[0xF341, 0x1007],
            steps: 1,
            before: &[(1, 0xF80)],
            nzcv: None,
            after: &[(0, 0xFFFFFFF8)],
            left: None,
        },
        Case {
            name: "ubfx r0, r1, #4, #8",
            code: &[0xF3C1, 0x1007],
            steps: 1,
            before: &[(1, 0xF80)],
            nzcv: None,
            after: &[(0, 0xF8)],
            left: None,
        },
    ]);
}

#[test]
fn saturation_clamps() {
    check(&[
        Case {
            name: "ssat r0, #8, r1",
            code: &[0xF301, 0x0007],
            steps: 1,
            before: &[(1, 0xC8)],
            nzcv: None,
            after: &[(0, 0x7F)],
            left: None,
        },
        Case {
            name: "usat r0, #8, r1, asr #1",
            code: &[0xF3A1, 0x0048],
            steps: 1,
            before: &[(1, 0xFFFFFFF0)],
            nzcv: None,
            after: &[(0, 0)],
            left: None,
        },
        Case {
            name: "ssat16 r0, #4, r1",
            code: &[0xF321, 0x0003],
            steps: 1,
            before: &[(1, 0x7FFF8000)],
            nzcv: None,
            after: &[(0, 0x7FFF8)],
            left: None,
        },
        Case {
            name: "usat16 r0, #4, r1",
            code: &[0xF3A1, 0x0004],
            steps: 1,
            before: &[(1, 0x7FFF8000)],
            nzcv: None,
            after: &[(0, 0xF0000)],
            left: None,
        },
        Case {
            name: "qadd r0, r1, r2",
            code: &[0xFA82, 0xF081],
            steps: 1,
            before: &[(1, 0x7FFFFFFF), (2, 1)],
            nzcv: None,
            after: &[(0, 0x7FFFFFFF)],
            left: None,
        },
        Case {
            name: "qdsub r0, r1, r2",
            code: &[0xFA82, 0xF0B1],
            steps: 1,
            before: &[(1, 0), (2, 0x60000000)],
            nzcv: None,
            after: &[(0, 0x80000001)],
            left: None,
        },
    ]);
}

#[test]
fn extensions_and_packing_take_parts_of_words() {
    check(&[
        Case {
            name: "sxtb r0, r1",
            code: &[0xB248],
            steps: 1,
            before: &[(1, 0x80)],
            nzcv: None,
            after: &[(0, 0xFFFFFF80)],
            left: None,
        },
        Case {
            name: "uxtb.w r0, r1, ror #8",
            code: &[0xFA5F, 0xF091],
            steps: 1,
            before: &[(1, 0x1234)],
            nzcv: None,
            after: &[(0, 0x12)],
            left: None,
        },
        Case {
            name: "sxtah r0, r1, r2",
            code: &[0xFA01, 0xF082],
            steps: 1,
            before: &[(1, 1), (2, 0xFFFF)],
            nzcv: None,
            after: &[(0, 0)],
            left: None,
        },
        Case {
            name: "uxtb16 r0, r1",
            code: &[0xFA3F, 0xF081],
            steps: 1,
            before: &[(1, 0x11223344)],
            nzcv: None,
            after: &[(0, 0x220044)],
            left: None,
        },
        Case {
            name: "sxtab16 r0, r1, r2",
            code: &[0xFA21, 0xF082],
            steps: 1,
            before: &[(1, 0x10001), (2, 0xFF007F)],
            nzcv: None,
            after: &[(0, 0x80)],
            left: None,
        },
        Case {
            name: "pkhbt r0, r1, r2, lsl #16",
            code: &[0xEAC1, 0x4002],
            steps: 1,
            before: &[(1, 0x11112222), (2, 0x33334444)],
            nzcv: None,
            after: &[(0, 0x44442222)],
            left: None,
        },
        Case {
            name: "pkhtb r0, r1, r2, asr #16",
            code: &[0xEAC1, 0x4022],
            steps: 1,
            before: &[(1, 0x11112222), (2, 0x33334444)],
            nzcv: None,
            after: &[(0, 0x11113333)],
            left: None,
        },
        Case {
            name: "rev r0, r1",
            code: &[0xBA08],
            steps: 1,
            before: &[(1, 0x11223344)],
            nzcv: None,
            after: &[(0, 0x44332211)],
            left: None,
        },
        Case {
            name: "rev16 r0, r1",
            code: &[0xBA48],
            steps: 1,
            before: &[(1, 0x11223344)],
            nzcv: None,
            after: &[(0, 0x22114433)],
            left: None,
        },
        Case {
            name: "revsh r0, r1",
            code: &[0xBAC8],
            steps: 1,
            before: &[(1, 0x80)],
            nzcv: None,
            after: &[(0, 0xFFFF8000)],
            left: None,
        },
        Case {
            name: "rbit r0, r1",
            code: &[0xFA91, 0xF0A1],
            steps: 1,
            before: &[(1, 1)],
            nzcv: None,
            after: &[(0, 0x80000000)],
            left: None,
        },
        Case {
            name: "clz r0, r1",
            code: &[0xFAB1, 0xF081],
            steps: 1,
            before: &[(1, 0)],
            nzcv: None,
            after: &[(0, 0x20)],
            left: None,
        },
    ]);
}

#[test]
fn lanes_are_added_apart_and_select_by_their_flags() {
    check(&[
        Case {
            name: "sadd8 r0, r1, r2; sel r3, r1, r2",
            code: &[0xFA81, 0xF002, 0xFAA1, 0xF382],
            steps: 2,
            before: &[(1, 0x7F800102), (2, 0x1FF01FF)],
            nzcv: None,
            after: &[(0, 0x807F0201), (3, 0x7FFF0102)],
            left: None,
        },
        Case {
            name: "usub8 r0, r1, r2; sel r3, r1, r2",
            code: &[0xFAC1, 0xF042, 0xFAA1, 0xF382],
            steps: 2,
            before: &[(1, 0x10203040), (2, 0x11203041)],
            nzcv: None,
            after: &[(0, 0xFF0000FF), (3, 0x11203041)],
            left: None,
        },
        Case {
            name: "uadd16 r0, r1, r2; sel r3, r1, r2",
            code: &[0xFA91, 0xF042, 0xFAA1, 0xF382],
            steps: 2,
            before: &[(1, 0xFFFF0001), (2, 0x10001)],
            nzcv: None,
            after: &[(0, 2), (3, 0xFFFF0001)],
            left: None,
        },
        Case {
            name: "qsub8 r0, r1, r2",
            code: &[0xFAC1, 0xF012],
            steps: 1,
            before: &[(1, 0x80000000), (2, 0x1000000)],
            nzcv: None,
            after: &[(0, 0x80000000)],
            left: None,
        },
        Case {
            name: "shasx r0, r1, r2",
            code: &[0xFAA1, 0xF022],
            steps: 1,
            before: &[(1, 0x40008), (2, 0x20004)],
            nzcv: None,
            after: &[(0, 0x40003)],
            left: None,
        },
        Case {
            name: "uhsax r0, r1, r2",
            code: &[0xFAE1, 0xF062],
            steps: 1,
            before: &[(1, 0x40008), (2, 0x20004)],
            nzcv: None,
            after: &[(0, 5)],
            left: None,
        },
        Case {
            name: "usada8 r0, r1, r2, r3",
            code: &[0xFB71, 0x3002],
            steps: 1,
            before: &[(1, 0x1020304), (2, 0x4030201), (3, 0xA)],
            nzcv: None,
            after: &[(0, 0x12)],
            left: None,
        },
    ]);
}

#[test]
fn products_are_accumulated() {
    check(&[
        Case {
            name: "muls r0, r1, r0",
            code: &[0x4348],
            steps: 1,
            before: &[(0, 0x10000), (1, 0x10000)],
            nzcv: Some(0b0000),
            after: &[(0, 0)],
            left: Some(0b0100),
        },
        Case {
            name: "mla r0, r1, r2, r3",
            code: &[0xFB01, 0x3002],
            steps: 1,
            before: &[(1, 3), (2, 4), (3, 5)],
            nzcv: None,
            after: &[(0, 0x11)],
            left: None,
        },
        Case {
            name: "mls r0, r1, r2, r3",
            code: &[0xFB01, 0x3012],
            steps: 1,
            before: &[(1, 3), (2, 4), (3, 5)],
            nzcv: None,
            after: &[(0, 0xFFFFFFF9)],
            left: None,
        },
        Case {
            name: "smlabt r0, r1, r2, r3",
            code: &[0xFB11, 0x3012],
            steps: 1,
            before: &[(1, 0xFFFF), (2, 0x20000), (3, 5)],
            nzcv: None,
            after: &[(0, 3)],
            left: None,
        },
        Case {
            name: "smulwb r0, r1, r2",
            code: &[0xFB31, 0xF002],
            steps: 1,
            before: &[(1, 0x30000), (2, 0xFFFE)],
            nzcv: None,
            after: &[(0, 0xFFFFFFFA)],
            left: None,
        },
        Case {
            name: "smladx r0, r1, r2, r3",
            code: &[0xFB21, 0x3012],
            steps: 1,
            before: &[(1, 0x20003), (2, 0x50007), (3, 1)],
            nzcv: None,
            after: &[(0, 0x1E)],
            left: None,
        },
        Case {
            name: "smusd r0, r1, r2",
            code: &[0xFB41, 0xF002],
            steps: 1,
            before: &[(1, 0x20003), (2, 0x50007)],
            nzcv: None,
            after: &[(0, 0xB)],
            left: None,
        },
        Case {
            name: "smmlar r0, r1, r2, r3",
            code: &[0xFB51, 0x3012],
            steps: 1,
            before: &[(1, 0x40000000), (2, 2), (3, 1)],
            nzcv: None,
            after: &[(0, 2)],
            left: None,
        },
        Case {
            name: "smmls r0, r1, r2, r3",
            code: &[0xFB61, 0x3002],
            steps: 1,
            before: &[(1, 0x40000000), (2, 2), (3, 1)],
            nzcv: None,
            after: &[(0, 0)],
            left: None,
        },
        Case {
            name: "umull r0, r3, r1, r2",
            code: &[0xFBA1, 0x0302],
            steps: 1,
            before: &[(1, 0xFFFFFFFF), (2, 0xFFFFFFFF)],
            nzcv: None,
            after: &[(0, 1), (3, 0xFFFFFFFE)],
            left: None,
        },
        Case {
            name: "smull r0, r3, r1, r2",
            code: &[0xFB81, 0x0302],
            steps: 1,
            before: &[(1, 0xFFFFFFFF), (2, 2)],
            nzcv: None,
            after: &[(0, 0xFFFFFFFE), (3, 0xFFFFFFFF)],
            left: None,
        },
        Case {
            name: "umaal r0, r3, r1, r2",
            code: &[0xFBE1, 0x0362],
            steps: 1,
            before: &[(0, 0xFFFFFFFF), (3, 0xFFFFFFFF), (1, 0xFFFFFFFF), (2, 0xFFFFFFFF)],
            nzcv: None,
            after: &[(0, 0xFFFFFFFF), (3, 0xFFFFFFFF)],
            left: None,
        },
        Case {
            name: "smlal r0, r3, r1, r2",
            code: &[0xFBC1, 0x0302],
            steps: 1,
            before: &[(0, 1), (3, 0), (1, 0xFFFFFFFF), (2, 1)],
            nzcv: None,
            after: &[(0, 0), (3, 0)],
            left: None,
        },
        Case {
            name: "smlaltb r0, r3, r1, r2",
            code: &[0xFBC1, 0x03A2],
            steps: 1,
            before: &[(0, 0xFFFFFFFF), (3, 0), (1, 0x10000), (2, 1)],
            nzcv: None,
            after: &[(0, 0), (3, 1)],
            left: None,
        },
        Case {
            name: "smlsld r0, r3, r1, r2",
            code: &[0xFBD1, 0x03C2],
            steps: 1,
            before: &[(0, 0), (3, 0), (1, 0x10002), (2, 0x30001)],
            nzcv: None,
            after: &[(0, 0xFFFFFFFF), (3, 0xFFFFFFFF)],
            left: None,
        },
    ]);
}

#[test]
fn divisions_round_to_zero_and_by_zero_give_zero() {
    check(&[
        Case {
            name: "sdiv r0, r1, r2",
            code: &[0xFB91, 0xF0F2],
            steps: 1,
            before: &[(1, 0xFFFFFFF9), (2, 2)],
            nzcv: None,
            after: &[(0, 0xFFFFFFFD)],
            left: None,
        },
        Case {
            name: "sdiv r0, r1, r2",
            code: &[0xFB91, 0xF0F2],
            steps: 1,
            before: &[(1, 0x80000000), (2, 0xFFFFFFFF)],
            nzcv: None,
            after: &[(0, 0x80000000)],
            left: None,
        },
        Case {
            name: "udiv r0, r1, r2",
            code: &[0xFBB1, 0xF0F2],
            steps: 1,
            before: &[(1, 7), (2, 0)],
            nzcv: None,
            after: &[(0, 0)],
            left: None,
        },
    ]);
}

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
fn branches_go_where_they_say() {
    check(&[
        Case {
            name: "b 1f",
            code: &[0xE002, 0xBF00, 0xBF00, 0xBF00],
            steps: 1,
            before: &[],
            nzcv: None,
            after: &[(15, 0x108)],
            left: None,
        },
        Case {
            name: "beq 1f",
            code: &[0xD002, 0xBF00, 0xBF00, 0xBF00],
            steps: 1,
            before: &[],
            nzcv: Some(0b0000),
            after: &[(15, 0x102)],
            left: None,
        },
        Case {
            name: "bl #0x3FC",
            code: &[0xF000, 0xF9FE],
            steps: 1,
            before: &[],
            nzcv: None,
            after: &[(14, 0x105), (15, 0x500)],
            left: None,
        },
        Case {
            name: "b.w #0xFFFFC",
            code: &[0xF0FF, 0xBFFE],
            steps: 1,
            before: &[],
            nzcv: None,
            after: &[(15, 0x100100)],
            left: None,
        },
        Case {
            name: "bne.w #-0x84",
            code: &[0xF47F, 0xAFBE],
            steps: 1,
            before: &[],
            nzcv: Some(0b0000),
            after: &[(15, 0x80)],
            left: None,
        },
        Case {
            name: "blx r0",
            code: &[0x4780],
            steps: 1,
            before: &[(0, 0x201)],
            nzcv: None,
            after: &[(14, 0x103), (15, 0x200)],
            left: None,
        },
        Case {
            name: "bx r0",
            code: &[0x4700],
            steps: 1,
            before: &[(0, 0x201)],
            nzcv: None,
            after: &[(15, 0x200)],
            left: None,
        },
        Case {
            name: "mov pc, r0",
            code: &[0x4687],
            steps: 1,
            before: &[(0, 0x200)],
            nzcv: None,
            after: &[(15, 0x200)],
            left: None,
        },
        Case {
            name: "cbz r0, 1f",
            code: &[0xB110, 0xBF00, 0xBF00, 0xBF00],
            steps: 1,
            before: &[(0, 0)],
            nzcv: None,
            after: &[(15, 0x108)],
            left: None,
        },
        Case {
            name: "cbnz r0, 1f",
            code: &[0xB910, 0xBF00, 0xBF00, 0xBF00],
            steps: 1,
            before: &[(0, 0)],
            nzcv: None,
            after: &[(15, 0x102)],
            left: None,
        },
        Case {
            name: "tbb [pc, r0]; .byte 2,3,4,5",
            code: &[0xE8DF, 0xF000, 0x0302, 0x0504],
            steps: 1,
            before: &[(0, 1)],
            nzcv: None,
            after: &[(15, 0x10A)],
            left: None,
        },
        Case {
            name: "tbh [pc, r0, lsl #1]; .short 2,3",
            code: &[0xE8DF, 0xF010, 0x0002, 0x0003],
            steps: 1,
            before: &[(0, 1)],
            nzcv: None,
            after: &[(15, 0x10A)],
            left: None,
        },
        Case {
            name: "push {r0, lr}; pop {r1, pc}",
            code: &[0xB501, 0xBD02],
            steps: 2,
            before: &[(0, 7), (14, 0x201)],
            nzcv: None,
            after: &[(1, 7), (13, 0x20001000), (15, 0x200)],
            left: None,
        },
    ]);
}

#[test]
fn an_it_block_executes_by_its_conditions_and_sets_no_flags() {
    check(&[
        Case {
            name: "ite eq; moveq r0, #1; movne r0, #2; nop",
            code: &[0xBF0C, 0x2001, 0x2002, 0xBF00],
            steps: 3,
            before: &[(0, 0)],
            nzcv: Some(0b0100),
            after: &[(0, 1)],
            left: Some(0b0100),
        },
        Case {
            name: "ite eq; moveq r0, #1; movne r0, #2; nop",
            code: &[0xBF0C, 0x2001, 0x2002, 0xBF00],
            steps: 3,
            before: &[(0, 0)],
            nzcv: Some(0b0000),
            after: &[(0, 2)],
            left: Some(0b0000),
        },
        Case {
            name: "itt ne; addne r0, r0, #1; lslne r0, r0, #1",
            code: &[0xBF1C, 0x1C40, 0x0040],
            steps: 3,
            before: &[(0, 0x7FFFFFFF)],
            nzcv: Some(0b0001),
            after: &[(0, 0)],
            left: Some(0b0001),
        },
        Case {
            name: "itt ne; cmpne r0, #0; movne r1, #5",
            code: &[0xBF1C, 0x2800, 0x2105],
            steps: 3,
            before: &[(0, 0), (1, 1)],
            nzcv: Some(0b0000),
            after: &[(1, 1)],
            left: Some(0b0110),
        },
        Case {
            name: "it ne; bne 1f",
            code: &[0xBF18, 0xE002, 0xBF00, 0xBF00, 0xBF00, 0xBF00],
            steps: 2,
            before: &[],
            nzcv: Some(0b0000),
            after: &[(15, 0x10A)],
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
    // str r0, [r2]; strh r0, [r2, #6]; strb r0, [r2, #8]; str r0, [r2, #-4]!; strd r0, r1, [r2], #8
    // stmdb r2!, {r0, r1}
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
    // str r0, [r2]; ldr r1, [r2]
    let mut rig = Rig::new(&[0x6010, 0x6811]);
    rig.board.bit_banding = true;
    rig.board.set_word(RAM + 0x100, 0xFFFF_0000);
    rig.set(0, 3).set(2, 0x2200_0000 + 0x100 * 32 + 5 * 4).steps(2);
    assert_eq!((rig.r(1), rig.board.word(RAM + 0x100)), (1, 0xFFFF_0020));
}
