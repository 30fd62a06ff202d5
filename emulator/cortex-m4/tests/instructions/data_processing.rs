//! Tests of shifts, sums, immediates, moves and bit fields with their flags.

use super::{Case, check};

#[test]
fn a_comparison_in_the_high_registers_form_takes_low_ones() {
    let case = |before, left| Case {
        name: "cmp r0, r1",
        code: &[0x4508],
        steps: 1,
        before,
        nzcv: Some(0b0000),
        after: &[(0, 5)],
        left: Some(left),
    };
    check(&[case(&[(0, 5), (1, 5)], 0b0110), case(&[(0, 5), (1, 6)], 0b1000)]);
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
