//! Tests of the results and flags of arithmetic on random operands.
//!
//! The host computes the expected values. The host's `f32` operation rounds to nearest. Exact `f64` arithmetic tells on
//! which side of the rounded result the exact one lies. The result and the flags in each rounding mode follow from
//! these two. The host's arithmetic and the integer arithmetic in `arith` must both give them.

use std::cmp::Ordering;

use super::{INFINITY, LEAST_NORMAL, MAXIMUM, ONE, QUIET, SIGNALLING, TO_MINUS, TO_PLUS};
use crate::fp::arith::{self, AHP, DN, DZC, FZ, IDC, IOC, IXC, Integer, OFC, RMODE, SIGN, UFC, exact};

const CASES: u32 = if cfg!(debug_assertions) { 100_000 } else { 4_000_000 };

type Unary = fn(u32, &mut u32) -> u32;
type Binary = fn(u32, u32, &mut u32) -> u32;

/// A random generator: xorshift (G. Marsaglia) with a final multiplication.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    fn below(&mut self, limit: u64) -> u64 {
        (self.next() >> 32) % limit
    }

    /// Draws an operand: random bits, a number with an exponent close to that of others, or an edge case with a bit or
    /// two changed.
    fn operand(&mut self) -> u32 {
        const EDGES: [u32; 14] = [
            0,
            1,
            0x0040_0000,
            0x007F_FFFF,
            LEAST_NORMAL,
            0x0100_0000,
            ONE,
            0x3FFF_FFFF,
            0x4B7F_FFFF,
            0x4F00_0000,
            MAXIMUM,
            INFINITY,
            SIGNALLING,
            QUIET,
        ];
        let bits = self.next() as u32;
        let sign = bits & SIGN;
        match self.below(8) {
            0 => bits,
            1 => sign | EDGES[self.below(14) as usize],
            2 => sign | EDGES[self.below(14) as usize] ^ 1 << self.below(31),
            3 => bits & 0x80FF_FFFF,
            4 => bits & 0xFFFF_0000,
            5 => sign | (118 + self.below(20) as u32) << 23 | bits & 0x0070_0003,
            _ => sign | (110 + self.below(36) as u32) << 23 | bits & 0x007F_FFFF,
        }
    }

    fn fpscr(&mut self) -> u32 {
        let bits = self.next() as u32;
        match self.below(4) {
            0 => 0,
            1 => bits & (IOC | DZC | OFC | UFC | IXC | IDC),
            _ => bits & (0xF000_0000 | RMODE | FZ | DN | AHP | IXC),
        }
    }
}

struct Truth {
    nearest: f32,
    /// The order of the exact result relative to the result rounded to nearest.
    order: Ordering,
    /// Whether the exact magnitude is below the least normal number and not zero.
    tiny: bool,
    /// Whether the exact magnitude is 2^128 or more.
    huge: bool,
    /// Whether the result is a sum of terms of opposite signs. If this sum is zero, the rounding mode decides its sign.
    opposite: bool,
}

impl Truth {
    fn expected(&self, fpscr: u32) -> (u32, u32) {
        let Self { nearest, order, .. } = *self;
        let mode = fpscr & RMODE;
        if self.tiny && fpscr & FZ != 0 {
            let negative = if nearest == 0.0 { nearest.is_sign_negative() } else { nearest < 0.0 };
            return (if negative { SIGN } else { 0 }, fpscr | UFC);
        }
        if nearest == 0.0 && order == Ordering::Equal && self.opposite {
            return (if mode == TO_MINUS { SIGN } else { 0 }, fpscr);
        }
        let up = if order == Ordering::Greater { nearest.next_up() } else { nearest };
        let down = if order == Ordering::Less { nearest.next_down() } else { nearest };
        let result = match mode {
            0 => nearest,
            TO_PLUS => up,
            TO_MINUS => down,
            _ if nearest.is_sign_negative() => up,
            _ => down,
        };
        let mut flags = 0;
        if order != Ordering::Equal {
            flags |= IXC;
            if self.tiny {
                flags |= UFC;
            }
            if result.is_infinite() || self.huge {
                flags |= OFC;
            }
        }
        (result.to_bits(), fpscr | flags)
    }
}

fn sum(a: f64, b: f64) -> (f64, f64) {
    let (large, small) = if a.abs() >= b.abs() { (a, b) } else { (b, a) };
    let sum = large + small;
    (sum, small - (sum - large))
}

fn truth_of_sum(nearest: f32, a: f64, b: f64) -> Truth {
    let (value, error) = sum(a, b);
    let order = value.partial_cmp(&f64::from(nearest)).unwrap();
    let order = if order == Ordering::Equal { error.partial_cmp(&0.0).unwrap() } else { order };
    let least = f64::from(f32::MIN_POSITIVE);
    let limit = 2.0_f64.powi(128);
    // The rounded sum may equal `limit` or `least`. The sign of the rounding error then tells whether the exact sum is
    // above or below that value.
    let inwards = error != 0.0 && (error > 0.0) != (value > 0.0);
    Truth {
        nearest,
        order,
        tiny: (value != 0.0 && value.abs() < least) || (value.abs() == least && inwards),
        huge: value.abs() > limit || (value.abs() == limit && !inwards),
        opposite: a.is_sign_negative() != b.is_sign_negative(),
    }
}

fn flush(operand: u32, fpscr: &mut u32) -> u32 {
    if *fpscr & FZ != 0 && operand & INFINITY == 0 && operand & !SIGN != 0 {
        *fpscr |= IDC;
        operand & SIGN
    } else {
        operand
    }
}

fn finite(bits: u32) -> bool {
    f32::from_bits(bits).is_finite()
}

fn check_binary(seed: u64, ways: [Binary; 2], truth: fn(f32, f32) -> Option<Truth>) {
    let mut random = Random(seed);
    for _ in 0..CASES {
        let (a, b, before) = (random.operand(), random.operand(), random.fpscr());
        let results = ways.map(|way| {
            let mut fpscr = before;
            (way(a, b, &mut fpscr), fpscr)
        });
        assert_eq!(results[0], results[1], "{a:08x} {b:08x} {before:08x}");
        if finite(a) && finite(b) {
            let mut fpscr = before;
            let (x, y) = (f32::from_bits(flush(a, &mut fpscr)), f32::from_bits(flush(b, &mut fpscr)));
            if let Some(truth) = truth(x, y) {
                assert_eq!(results[1], truth.expected(fpscr), "{a:08x} {b:08x} {before:08x}");
            }
        }
    }
}

#[test]
fn sums_of_random_numbers_are_the_hosts_in_each_mode() {
    check_binary(1, [arith::add, exact::add], |x, y| Some(truth_of_sum(x + y, x.into(), y.into())));
    check_binary(2, [arith::subtract, exact::subtract], |x, y| Some(truth_of_sum(x - y, x.into(), -f64::from(y))));
}

#[test]
fn products_of_random_numbers_are_the_hosts_in_each_mode() {
    check_binary(3, [arith::multiply, exact::multiply], |x, y| {
        let product = f64::from(x) * f64::from(y);
        Some(Truth { opposite: false, ..truth_of_sum(x * y, product, 0.0) })
    });
}

#[test]
fn quotients_of_random_numbers_are_the_hosts_in_each_mode() {
    check_binary(4, [arith::divide, exact::divide], |x, y| {
        if y == 0.0 {
            return None;
        }
        let nearest = x / y;
        let order = if nearest.is_infinite() {
            if nearest > 0.0 { Ordering::Less } else { Ordering::Greater }
        } else {
            let order = f64::from(x).partial_cmp(&(f64::from(nearest) * f64::from(y))).unwrap();
            if y < 0.0 { order.reverse() } else { order }
        };
        let (dividend, divisor) = (f64::from(x).abs(), f64::from(y).abs());
        Some(Truth {
            nearest,
            order,
            tiny: dividend != 0.0 && dividend < f64::from(f32::MIN_POSITIVE) * divisor,
            huge: dividend >= 2.0_f64.powi(128) * divisor,
            opposite: false,
        })
    });
}

#[test]
fn square_roots_of_random_numbers_are_the_hosts_in_each_mode() {
    let ways: [Unary; 2] = [arith::square_root, exact::square_root];
    let mut random = Random(5);
    for _ in 0..CASES {
        let (a, before) = (random.operand(), random.fpscr());
        let results = ways.map(|way| {
            let mut fpscr = before;
            (way(a, &mut fpscr), fpscr)
        });
        assert_eq!(results[0], results[1], "{a:08x} {before:08x}");
        let mut fpscr = before;
        let x = f32::from_bits(flush(a, &mut fpscr));
        if x.is_finite() && x >= 0.0 {
            let nearest = x.sqrt();
            let order = f64::from(x).partial_cmp(&(f64::from(nearest) * f64::from(nearest))).unwrap();
            let truth = Truth { nearest, order, tiny: false, huge: false, opposite: false };
            assert_eq!(results[1], truth.expected(fpscr), "{a:08x} {before:08x}");
        }
    }
}

#[test]
fn a_fused_multiply_add_matches_the_host_in_each_rounding_mode() {
    let mut random = Random(6);
    for case in 0..CASES {
        let (a, b, before) = (random.operand(), random.operand(), random.fpscr());
        let addend = if case & 1 == 0 {
            random.operand()
        } else {
            let product = f32::from_bits(a) * f32::from_bits(b);
            (-product).to_bits().wrapping_add(random.below(5) as u32).wrapping_sub(2)
        };
        let results = [arith::multiply_add, exact::multiply_add].map(|way| {
            let mut fpscr = before;
            (way(addend, a, b, &mut fpscr), fpscr)
        });
        let message = || format!("{addend:08x} + {a:08x} * {b:08x} {before:08x}");
        assert_eq!(results[0], results[1], "{}", message());
        if finite(a) && finite(b) && finite(addend) {
            let mut fpscr = before;
            let [z, x, y] = [addend, a, b].map(|operand| f32::from_bits(flush(operand, &mut fpscr)));
            let truth = truth_of_sum(x.mul_add(y, z), f64::from(x) * f64::from(y), z.into());
            assert_eq!(results[1], truth.expected(fpscr), "{}", message());
        }
    }
}

#[test]
fn comparisons_of_random_numbers_are_the_hosts() {
    let mut random = Random(7);
    for _ in 0..CASES {
        let (a, b, before) = (random.operand(), random.operand(), random.fpscr());
        let b = if random.below(4) == 0 { a ^ (random.next() as u32 & SIGN) } else { b };
        let signals = random.below(2) == 0;
        let (mut one, mut other) = (before, before);
        arith::compare(a, b, signals, &mut one);
        exact::compare(a, b, signals, &mut other);
        assert_eq!(one, other, "{a:08x} {b:08x} {before:08x}");
        let mut fpscr = before & 0x0FFF_FFFF;
        let (x, y) = (f32::from_bits(flush(a, &mut fpscr)), f32::from_bits(flush(b, &mut fpscr)));
        let flags = match x.partial_cmp(&y) {
            Some(Ordering::Less) => 0b1000,
            Some(Ordering::Equal) => 0b0110,
            Some(Ordering::Greater) => 0b0010,
            None => {
                let signalling = |bits: u32| f32::from_bits(bits).is_nan() && bits & 0x0040_0000 == 0;
                if signals || signalling(a) || signalling(b) {
                    fpscr |= IOC;
                }
                0b0011
            }
        };
        assert_eq!(one, fpscr | flags << 28, "{a:08x} {b:08x} {before:08x}");
    }
}

fn random_integer(random: &mut Random) -> Integer {
    let size = if random.below(3) == 0 { 16 } else { 32 };
    let fraction_bits = if random.below(2) == 0 { 0 } else { random.below(u64::from(size) + 1) as u8 };
    Integer { size, unsigned: random.below(2) == 0, fraction_bits }
}

#[test]
fn conversions_of_random_numbers_to_integers_are_the_hosts_in_each_mode() {
    let mut random = Random(8);
    for _ in 0..CASES {
        let (a, before, target) = (random.operand(), random.fpscr(), random_integer(&mut random));
        let toward_zero = random.below(2) == 0;
        let results = [arith::to_integer, exact::to_integer].map(|way| {
            let mut fpscr = before;
            (way(a, target, toward_zero, &mut fpscr), fpscr)
        });
        assert_eq!(results[0], results[1], "{a:08x} {target:?} {before:08x}");
        let mut fpscr = before;
        let x = f64::from(f32::from_bits(flush(a, &mut fpscr))) * 2.0_f64.powi(target.fraction_bits.into());
        let rounded = match before & RMODE {
            _ if toward_zero => x.trunc(),
            0 => x.round_ties_even(),
            TO_PLUS => x.ceil(),
            TO_MINUS => x.floor(),
            _ => x.trunc(),
        };
        let (least, most) = if target.unsigned {
            (0.0, 2.0_f64.powi(target.size.into()) - 1.0)
        } else {
            (-2.0_f64.powi(i32::from(target.size) - 1), 2.0_f64.powi(i32::from(target.size) - 1) - 1.0)
        };
        let result = if x.is_nan() { 0.0 } else { rounded.clamp(least, most) };
        if x.is_nan() || result != rounded {
            fpscr |= IOC;
        } else if rounded != x {
            fpscr |= IXC;
        }
        assert_eq!(results[1], (result as i64 as u32, fpscr), "{a:08x} {target:?} {before:08x} {toward_zero}");
    }
}

#[test]
fn conversions_of_random_integers_are_the_hosts_in_each_mode() {
    let mut random = Random(9);
    for _ in 0..CASES {
        let (a, before, source) = (random.next() as u32, random.fpscr(), random_integer(&mut random));
        let a = a >> random.below(32);
        let to_nearest = random.below(2) == 0;
        let results = [arith::from_integer, exact::from_integer].map(|way| {
            let mut fpscr = before;
            (way(a, source, to_nearest, &mut fpscr), fpscr)
        });
        assert_eq!(results[0], results[1], "{a:08x} {source:?} {before:08x}");
        let value = match (source.size, source.unsigned) {
            (16, true) => f64::from(a as u16),
            (16, false) => f64::from(a as i16),
            (_, true) => f64::from(a),
            (_, false) => f64::from(a as i32),
        } / 2.0_f64.powi(source.fraction_bits.into());
        let truth = Truth { opposite: false, ..truth_of_sum(value as f32, value, 0.0) };
        let mode = if to_nearest { before & !RMODE } else { before };
        let (result, flags) = truth.expected(mode);
        assert_eq!(results[1], (result, before | flags), "{a:08x} {source:?} {before:08x}");
    }
}

fn half_magnitude(half: u16) -> f64 {
    let (exponent, fraction) = (i32::from(half >> 10 & 31), f64::from(half & 0x3FF));
    if exponent == 0 { fraction * 2.0_f64.powi(-24) } else { (1024.0 + fraction) * 2.0_f64.powi(exponent - 25) }
}

#[test]
fn each_half_precision_number_converts_exactly_and_back() {
    for half in 0..=u16::MAX {
        for base in [0, AHP, FZ, DN, TO_PLUS, TO_MINUS | FZ] {
            let special = half & 0x7C00 == 0x7C00 && base & AHP == 0;
            let mut fpscr = base;
            let single = exact::from_half(half, &mut fpscr);
            if special {
                continue;
            }
            assert_eq!(fpscr, base, "{half:04x}");
            assert_eq!(f64::from(f32::from_bits(single & !SIGN)), half_magnitude(half), "{half:04x}");
            assert_eq!(single >> 31, u32::from(half >> 15), "{half:04x}");
            assert_eq!(exact::to_half(single, &mut fpscr), half, "{half:04x}");
            assert_eq!(fpscr, base, "{half:04x}");
        }
    }
}

#[test]
fn conversions_of_random_numbers_to_half_precision_round_to_a_neighbour() {
    let mut random = Random(10);
    for _ in 0..CASES {
        let before = random.fpscr();
        let bits = random.next() as u32;
        let a = match random.below(4) {
            0 => random.operand(),
            1 => bits & 0x807F_F000 | (100 + random.below(46) as u32) << 23,
            _ => bits & 0x807F_FFFF | (100 + random.below(46) as u32) << 23,
        };
        if !finite(a) {
            continue;
        }
        let mut after = before;
        let result = exact::to_half(a, &mut after);

        let mut fpscr = before;
        let flushed = flush(a, &mut fpscr);
        let x = f64::from(f32::from_bits(flushed & !SIGN));
        let alternative = before & AHP != 0;
        // `top` is the code after that of the greatest finite number: infinity in the IEEE format, out of range in the
        // alternative one.
        let top: u16 = if alternative { 0x8000 } else { 0x7C00 };
        let magnitude = |half: u16| if half == 0x8000 { 131_072.0 } else { half_magnitude(half) };
        let (mut below, mut above) = (0, top);
        while above - below > 1 {
            let middle = below + (above - below) / 2;
            if magnitude(middle) <= x { below = middle } else { above = middle }
        }
        let error = x - magnitude(below);
        let gap = magnitude(above) - magnitude(below);
        let beyond = x >= magnitude(top);
        let up = match before & RMODE {
            0 => error > gap / 2.0 || (error == gap / 2.0 && below & 1 != 0),
            TO_PLUS => error != 0.0 && a & SIGN == 0,
            TO_MINUS => error != 0.0 && a & SIGN != 0,
            _ => false,
        };
        let magnitude_bits = if up { above } else { below };
        let expected = if alternative {
            if magnitude_bits == 0x8000 || beyond {
                fpscr |= IOC;
                0x7FFF
            } else {
                magnitude_bits
            }
        } else {
            if magnitude_bits == top || beyond {
                fpscr |= OFC;
            }
            magnitude_bits
        };
        if error != 0.0 && fpscr & IOC == before & IOC {
            fpscr |= IXC;
            if x < 2.0_f64.powi(-14) {
                fpscr |= UFC;
            }
        }
        if beyond && !alternative {
            fpscr |= IXC;
        }
        if before & IOC != 0 && alternative {
            continue; // the flag that shows an invalid operation is already set
        }
        assert_eq!((result, after), ((flushed >> 16) as u16 & 0x8000 | expected, fpscr), "{a:08x} {before:08x}");
    }
}
