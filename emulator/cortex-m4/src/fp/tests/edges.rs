//! Tests of arithmetic on edge cases: NaNs, infinities, zeros, overflow, underflow (ARM ARM A2.5).

use super::{INFINITY, LEAST_NORMAL, MAXIMUM, ONE, QUIET, SIGNALLING, TO_MINUS, TO_PLUS};
use crate::fp::arith::{self, AHP, DN, DZC, FZ, IDC, IOC, IXC, Integer, OFC, RMODE_SHIFT, SIGN, UFC};

const TO_ZERO: u32 = 3 << RMODE_SHIFT;

const DEFAULT_NAN: u32 = 0x7FC0_0000;
const OTHER_QUIET: u32 = 0x7FC5_4321;
const OTHER_SIGNALLING: u32 = 0xFF85_4321;

/// An edge case: the operation, FPSCR before it, the expected result, and the FPSCR bits that the operation must set.
type Edge = (fn(&mut u32) -> u32, u32, u32, u32);

fn check_edges(edges: &[Edge]) {
    for (number, &(operation, before, result, flags)) in edges.iter().enumerate() {
        let mut fpscr = before;
        let got = operation(&mut fpscr);
        assert_eq!((got, fpscr), (result, before | flags), "case {number}: {got:08x} {fpscr:08x}");
    }
}

#[test]
fn nans_pass_through_as_the_manual_says() {
    check_edges(&[
        (|f| arith::add(QUIET, OTHER_QUIET, f), 0, QUIET, 0),
        (|f| arith::add(ONE, OTHER_QUIET, f), 0, OTHER_QUIET, 0),
        (|f| arith::add(QUIET, SIGNALLING, f), 0, SIGNALLING | 0x0040_0000, IOC),
        (|f| arith::add(OTHER_SIGNALLING, SIGNALLING, f), 0, OTHER_SIGNALLING | 0x0040_0000, IOC),
        (|f| arith::add(QUIET, ONE, f), DN, DEFAULT_NAN, 0),
        (|f| arith::multiply(ONE, SIGNALLING, f), DN, DEFAULT_NAN, IOC),
        // If a NaN is subtracted, the result keeps the NaN's sign.
        (|f| arith::subtract(ONE, QUIET, f), 0, QUIET, 0),
        (|f| arith::divide(QUIET, 0, f), 0, QUIET, 0),
        (|f| arith::square_root(OTHER_SIGNALLING, f), 0, OTHER_SIGNALLING | 0x0040_0000, IOC),
        (|f| arith::square_root(QUIET, f), 0, QUIET, 0),
        // If the other operand is a NaN, a denormal operand is still flushed and IDC is set.
        (|f| arith::add(QUIET, 1, f), FZ, QUIET, IDC),
        // In a fused operation the NaN of the addend comes before those of the factors. Signalling NaNs come before
        // quiet ones.
        (|f| arith::multiply_add(QUIET, OTHER_QUIET, ONE, f), 0, QUIET, 0),
        (|f| arith::multiply_add(QUIET, ONE, SIGNALLING, f), 0, SIGNALLING | 0x0040_0000, IOC),
        (|f| arith::multiply_add(ONE, OTHER_QUIET, QUIET, f), 0, OTHER_QUIET, 0),
        (|f| arith::multiply_add(QUIET, INFINITY, 0, f), 0, DEFAULT_NAN, IOC),
        (|f| arith::multiply_add(SIGNALLING, INFINITY, 0, f), 0, SIGNALLING | 0x0040_0000, IOC),
        (|f| u32::from(arith::to_half(QUIET, f)), 0, 0xFE09, 0),
        (|f| u32::from(arith::to_half(SIGNALLING, f)), 0, 0x7E09, IOC),
        (|f| u32::from(arith::to_half(QUIET, f)), DN, 0x7E00, 0),
        (|f| u32::from(arith::to_half(QUIET, f)), AHP, 0x8000, IOC),
        (|f| arith::from_half(0xFE01, f), 0, 0xFFC0_2000, 0),
        (|f| arith::from_half(0x7C01, f), 0, 0x7FC0_2000, IOC),
        (|f| arith::from_half(0xFC01, f), DN, DEFAULT_NAN, IOC),
        (|f| arith::from_half(0xFC00, f), 0, 0xFF80_0000, 0),
        (|f| arith::from_half(0x7FFF, f), AHP, 131_008.0_f32.to_bits(), 0),
    ]);
}

#[test]
fn invalid_operations_give_the_default_nan() {
    check_edges(&[
        (|f| arith::add(INFINITY, INFINITY | SIGN, f), 0, DEFAULT_NAN, IOC),
        (|f| arith::subtract(INFINITY, INFINITY, f), 0, DEFAULT_NAN, IOC),
        (|f| arith::multiply(INFINITY, SIGN, f), 0, DEFAULT_NAN, IOC),
        (|f| arith::multiply(INFINITY, 1, f), FZ, DEFAULT_NAN, IOC | IDC),
        (|f| arith::divide(0, SIGN, f), 0, DEFAULT_NAN, IOC),
        (|f| arith::divide(INFINITY, INFINITY, f), 0, DEFAULT_NAN, IOC),
        (|f| arith::square_root(ONE | SIGN, f), 0, DEFAULT_NAN, IOC),
        (|f| arith::multiply_add(INFINITY, INFINITY, ONE | SIGN, f), 0, DEFAULT_NAN, IOC),
        (|f| arith::multiply_add(ONE, 0, INFINITY, f), 0, DEFAULT_NAN, IOC),
    ]);
}

#[test]
fn infinities_and_zeros_are_exact() {
    check_edges(&[
        (|f| arith::add(INFINITY, MAXIMUM | SIGN, f), 0, INFINITY, 0),
        (|f| arith::multiply(INFINITY, ONE | SIGN, f), 0, INFINITY | SIGN, 0),
        (|f| arith::divide(ONE, SIGN, f), 0, INFINITY | SIGN, DZC),
        (|f| arith::divide(INFINITY, 0, f), 0, INFINITY, 0),
        (|f| arith::divide(ONE, 1, f), FZ, INFINITY, DZC | IDC),
        (|f| arith::divide(ONE | SIGN, INFINITY, f), 0, SIGN, 0),
        (|f| arith::square_root(SIGN, f), 0, SIGN, 0),
        (|f| arith::square_root(1 | SIGN, f), FZ, SIGN, IDC),
        (|f| arith::square_root(INFINITY, f), 0, INFINITY, 0),
        (|f| arith::add(ONE, ONE | SIGN, f), 0, 0, 0),
        (|f| arith::add(ONE, ONE | SIGN, f), TO_MINUS, SIGN, 0),
        (|f| arith::add(SIGN, SIGN, f), 0, SIGN, 0),
        (|f| arith::add(0, SIGN, f), TO_MINUS, SIGN, 0),
        (|f| arith::multiply_add(INFINITY | SIGN, ONE, ONE, f), 0, INFINITY | SIGN, 0),
        (|f| arith::multiply_add(ONE, INFINITY, ONE | SIGN, f), 0, INFINITY | SIGN, 0),
        (|f| arith::multiply_add(SIGN, ONE | SIGN, 0, f), 0, SIGN, 0),
        (|f| arith::multiply_add(ONE, ONE, ONE | SIGN, f), TO_MINUS, SIGN, 0),
    ]);
}

#[test]
fn an_overflow_gives_infinity_or_the_greatest_number_by_rounding_mode() {
    for sign in [0, SIGN] {
        for (mode, infinite) in [(0, true), (TO_PLUS, sign == 0), (TO_MINUS, sign != 0), (TO_ZERO, false)] {
            let mut fpscr = mode;
            let result = arith::add(MAXIMUM | sign, MAXIMUM | sign, &mut fpscr);
            assert_eq!(result, sign | if infinite { INFINITY } else { MAXIMUM });
            assert_eq!(fpscr, mode | OFC | IXC);
        }
    }
}

#[test]
fn underflow_is_judged_before_rounding() {
    // (1 - 2^-24) * 2^-126 rounds up to the least normal number. It underflows nevertheless.
    const BELOW_ONE: u32 = 0x3F7F_FFFF;
    check_edges(&[
        (|f| arith::multiply(BELOW_ONE, LEAST_NORMAL, f), 0, LEAST_NORMAL, UFC | IXC),
        (|f| arith::multiply(BELOW_ONE, LEAST_NORMAL, f), TO_ZERO, 0x007F_FFFF, UFC | IXC),
        // A result that is flushed to zero is not inexact, and is not rounded up to the least normal number.
        (|f| arith::multiply(BELOW_ONE, LEAST_NORMAL, f), FZ, 0, UFC),
        // A denormal result that is exact does not underflow.
        (|f| arith::multiply(0x3F00_0000, LEAST_NORMAL, f), 0, 0x0040_0000, 0),
        (|f| arith::add(LEAST_NORMAL, 0x8000_0001, f), 0, 0x007F_FFFF, 0),
        (|f| arith::add(LEAST_NORMAL | SIGN, 0x0080_0001, f), FZ, 0, UFC),
        (|f| arith::multiply(1, 0x3F00_0000, f), 0, 0, UFC | IXC),
        (|f| arith::multiply(1, 0x3F00_0000, f), TO_PLUS, 1, UFC | IXC),
        (|f| arith::add(1, 1, f), FZ, 0, IDC),
    ]);
}

#[test]
fn half_precision_overflows_by_format() {
    let beyond = 65_536.0_f32.to_bits();
    let rounds_to_infinity = 65_520.0_f32.to_bits();
    let mut fpscr = 0;
    assert_eq!((arith::to_half(beyond, &mut fpscr), fpscr), (0x7C00, OFC | IXC));
    fpscr = TO_ZERO;
    assert_eq!((arith::to_half(beyond, &mut fpscr), fpscr), (0x7BFF, TO_ZERO | OFC | IXC));
    fpscr = 0;
    assert_eq!((arith::to_half(rounds_to_infinity, &mut fpscr), fpscr), (0x7C00, OFC | IXC));
    fpscr = AHP;
    assert_eq!((arith::to_half(beyond, &mut fpscr), fpscr), (0x7C00, AHP));
    fpscr = AHP;
    assert_eq!((arith::to_half(INFINITY | SIGN, &mut fpscr), fpscr), (0xFFFF, AHP | IOC));
    fpscr = AHP;
    assert_eq!((arith::to_half(131_072.0_f32.to_bits(), &mut fpscr), fpscr), (0x7FFF, AHP | IOC));
    // Flush-to-zero flushes single-precision operands, but not half-precision results.
    fpscr = FZ;
    assert_eq!((arith::to_half(2.0_f32.powi(-24).to_bits(), &mut fpscr), fpscr), (1, FZ));
    fpscr = FZ;
    assert_eq!((arith::to_half(1, &mut fpscr), fpscr), (0, FZ | IDC));
}

#[test]
fn conversions_to_integers_saturate_and_round_as_told() {
    const WORD: Integer = Integer { size: 32, unsigned: false, fraction_bits: 0 };
    const UNSIGNED: Integer = Integer { size: 32, unsigned: true, fraction_bits: 0 };
    const HALFWORD: Integer = Integer { size: 16, unsigned: false, fraction_bits: 8 };
    check_edges(&[
        (|f| arith::to_integer(INFINITY, WORD, true, f), 0, 0x7FFF_FFFF, IOC),
        (|f| arith::to_integer(INFINITY | SIGN, WORD, true, f), 0, 0x8000_0000, IOC),
        (|f| arith::to_integer(QUIET, WORD, true, f), 0, 0, IOC),
        (|f| arith::to_integer(0xCF00_0000, WORD, true, f), 0, 0x8000_0000, 0),
        (|f| arith::to_integer(0x4F00_0000, WORD, true, f), 0, 0x7FFF_FFFF, IOC),
        (|f| arith::to_integer((-0.5_f32).to_bits(), UNSIGNED, true, f), 0, 0, IXC),
        (|f| arith::to_integer((-1.0_f32).to_bits(), UNSIGNED, true, f), 0, 0, IOC),
        (|f| arith::to_integer((-0.5_f32).to_bits(), UNSIGNED, false, f), TO_MINUS, 0, IOC),
        (|f| arith::to_integer(2.5_f32.to_bits(), WORD, false, f), 0, 2, IXC),
        (|f| arith::to_integer(3.5_f32.to_bits(), WORD, false, f), 0, 4, IXC),
        (|f| arith::to_integer((-2.5_f32).to_bits(), WORD, false, f), TO_PLUS, (-2_i32) as u32, IXC),
        (|f| arith::to_integer((-2.5_f32).to_bits(), WORD, false, f), TO_MINUS, (-3_i32) as u32, IXC),
        (|f| arith::to_integer((-2.5_f32).to_bits(), WORD, true, f), TO_MINUS, (-2_i32) as u32, IXC),
        (|f| arith::to_integer(1, WORD, true, f), FZ, 0, IDC),
        (|f| arith::to_integer((-1.5_f32).to_bits(), HALFWORD, true, f), 0, 0xFFFF_FE80, 0),
        (|f| arith::to_integer(128.0_f32.to_bits(), HALFWORD, true, f), 0, 0x7FFF, IOC),
    ]);
}
