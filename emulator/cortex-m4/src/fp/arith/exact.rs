//! The manual's floating-point functions in integer arithmetic, for all operands, rounding modes and flags.
//!
//! A finite number that is not zero is held as a sign, a mantissa and a power of two. Sums and products are exact in
//! 128 bits. If the operands are too far apart for that, the lowest bit stands for all lower bits.

use std::cmp::Ordering;

use super::{AHP, DN, DZC, FZ, IDC, IOC, IXC, Integer, OFC, RMODE, RMODE_SHIFT, SIGN, UFC};

const DEFAULT_NAN: u32 = 0x7FC0_0000;
const INFINITY: u32 = 0x7F80_0000;
/// The highest bit of a NaN's fraction, which is set in a quiet NaN.
const QUIET: u32 = 0x0040_0000;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Class {
    Zero,
    Finite,
    Infinity,
    QuietNan,
    SignallingNan,
}

/// An unpacked number (FPUnpack). A finite number that is not zero is `mantissa` times two to the power of `exponent`.
#[derive(Clone, Copy)]
struct Unpacked {
    class: Class,
    sign: u32,
    exponent: i32,
    mantissa: u32,
}

impl Unpacked {
    fn is_nan(self) -> bool {
        matches!(self.class, Class::QuietNan | Class::SignallingNan)
    }

    fn normalized(self) -> Self {
        let shift = self.mantissa.leading_zeros() - 8;
        Self { exponent: self.exponent - shift as i32, mantissa: self.mantissa << shift, ..self }
    }
}

fn unpack(a: u32, fpscr: &mut u32) -> Unpacked {
    let sign = a & SIGN;
    let fraction = a & 0x007F_FFFF;
    let biased = (a >> 23 & 0xFF) as i32;
    let (class, exponent, mantissa) = match (biased, fraction) {
        (0, 0) => (Class::Zero, 0, 0),
        (0, _) if *fpscr & FZ != 0 => {
            *fpscr |= IDC;
            (Class::Zero, 0, 0)
        }
        (0, _) => (Class::Finite, -149, fraction),
        (255, 0) => (Class::Infinity, 0, 0),
        (255, _) if fraction & QUIET != 0 => (Class::QuietNan, 0, 0),
        (255, _) => (Class::SignallingNan, 0, 0),
        _ => (Class::Finite, biased - 150, fraction | 0x0080_0000),
    };
    Unpacked { class, sign, exponent, mantissa }
}

/// Selects the NaN of a result (FPProcessNaNs, FPProcessNaNs3): the first signalling NaN, or else the first quiet one.
/// The result is that NaN made quiet, or the default NaN if FPSCR.DN is set.
fn process_nans(operands: &[(u32, Unpacked)], fpscr: &mut u32) -> Option<u32> {
    let signalling = operands.iter().find(|(_, unpacked)| unpacked.class == Class::SignallingNan);
    if signalling.is_some() {
        *fpscr |= IOC;
    }
    let (nan, _) = signalling.or_else(|| operands.iter().find(|(_, unpacked)| unpacked.is_nan()))?;
    Some(if *fpscr & DN != 0 { DEFAULT_NAN } else { nan | QUIET })
}

fn invalid(fpscr: &mut u32) -> u32 {
    *fpscr |= IOC;
    DEFAULT_NAN
}

/// The sign of an exact zero that is the sum of two numbers of opposite signs.
fn sign_of_zero_sum(fpscr: u32) -> u32 {
    if fpscr & RMODE == 2 << RMODE_SHIFT { SIGN } else { 0 }
}

/// A floating-point format: 32 or 16 bits.
#[derive(Clone, Copy)]
struct Format {
    minimum_exponent: i32,
    exponent_bits: u32,
    fraction_bits: u32,
}

const SINGLE: Format = Format { minimum_exponent: -126, exponent_bits: 8, fraction_bits: 23 };
const HALF: Format = Format { minimum_exponent: -14, exponent_bits: 5, fraction_bits: 10 };

/// Splits `mantissa` at bit `shift`. Returns the upper part, and the order of the lower bits relative to half a unit;
/// `None` if they are all zero.
fn split(mantissa: u128, shift: i32) -> (u128, Option<Ordering>) {
    if shift <= 0 {
        return (mantissa << -shift, None);
    }
    if shift >= 128 {
        return (0, (mantissa != 0).then_some(Ordering::Less));
    }
    let dropped = mantissa & ((1 << shift) - 1);
    let half = 1 << (shift - 1);
    (mantissa >> shift, (dropped != 0).then(|| dropped.cmp(&half)))
}

fn rounds_up(error: Option<Ordering>, odd: bool, sign: u32, mode: u32) -> bool {
    let Some(error) = error else { return false };
    match mode {
        0 => error == Ordering::Greater || (error == Ordering::Equal && odd),
        1 => sign == 0,
        2 => sign != 0,
        _ => false,
    }
}

/// Rounds `mantissa` times two to the power of `exponent` (FPRound). `mantissa` must not be zero. `sign` is in bit 31.
fn round(sign: u32, exponent: i32, mantissa: u128, format: Format, fpscr: &mut u32) -> u32 {
    let half = format.exponent_bits == 5;
    let sign_bit = if half { sign >> 16 } else { sign };
    let highest = exponent + 127 - mantissa.leading_zeros() as i32;
    if *fpscr & FZ != 0 && !half && highest < format.minimum_exponent {
        *fpscr |= UFC;
        return sign_bit;
    }
    let mut biased = (highest - format.minimum_exponent + 1).max(0);
    let unit = highest.max(format.minimum_exponent) - format.fraction_bits as i32;
    let (integer, error) = split(mantissa, unit - exponent);
    let mut integer = integer as u32;
    if biased == 0 && error.is_some() {
        *fpscr |= UFC;
    }
    let mode = (*fpscr & RMODE) >> RMODE_SHIFT;
    if rounds_up(error, integer & 1 != 0, sign, mode) {
        integer += 1;
        if integer == 1 << format.fraction_bits {
            biased = 1;
        }
        if integer == 2 << format.fraction_bits {
            biased += 1;
            integer >>= 1;
        }
    }
    let exponents = 1 << format.exponent_bits;
    let fraction = integer & ((1 << format.fraction_bits) - 1);
    let result = sign_bit | (biased as u32) << format.fraction_bits | fraction;
    if half && *fpscr & AHP != 0 {
        if biased >= exponents {
            *fpscr |= IOC;
            return sign_bit | 0x7FFF;
        }
    } else if biased >= exponents - 1 {
        *fpscr |= OFC | IXC;
        let infinity = (exponents as u32 - 1) << format.fraction_bits;
        let to_infinity = mode == 0 || mode == if sign == 0 { 1 } else { 2 };
        return sign_bit | if to_infinity { infinity } else { infinity - 1 };
    }
    if error.is_some() {
        *fpscr |= IXC;
    }
    result
}

/// One term of a sum: a sign, a mantissa of at most 48 bits that may be zero, and a power of two.
#[derive(Clone, Copy)]
struct Term {
    sign: u32,
    exponent: i32,
    mantissa: u64,
}

/// Adds and rounds two finite terms, which must not both be zeros of the same sign.
fn add_terms(a: Term, b: Term, fpscr: &mut u32) -> u32 {
    // A zero never counts as the higher term, because its exponent has no meaning.
    let (high, low) = match (a.mantissa, b.mantissa) {
        (_, 0) => (a, Term { exponent: a.exponent, ..b }),
        (0, _) => (b, Term { exponent: b.exponent, ..a }),
        _ if a.exponent >= b.exponent => (a, b),
        _ => (b, a),
    };
    // The higher term is shifted up by at most 70 bits, to 118 bits in all. If the terms are further apart, the lower
    // term is shifted down, and its lowest bit collects the bits that are shifted out. The collected bit cannot change
    // a rounding, because the higher term is at least 2^70 and the lower one less than 2^48.
    let distance = high.exponent - low.exponent;
    let up = distance.min(70);
    let down = distance - up;
    let (kept, dropped) = split(u128::from(low.mantissa), down);
    let low_mantissa = (kept | u128::from(dropped.is_some())) as i128;
    let high_mantissa = i128::from(high.mantissa) << up;
    let signed = |sign: u32, mantissa: i128| if sign == 0 { mantissa } else { -mantissa };
    let sum = signed(high.sign, high_mantissa) + signed(low.sign, low_mantissa);
    if sum == 0 {
        return sign_of_zero_sum(*fpscr);
    }
    round(if sum < 0 { SIGN } else { 0 }, high.exponent - up, sum.unsigned_abs(), SINGLE, fpscr)
}

/// Adds two numbers (FPAdd).
pub(in crate::fp) fn add(a: u32, b: u32, fpscr: &mut u32) -> u32 {
    let (x, y) = (unpack(a, fpscr), unpack(b, fpscr));
    if let Some(nan) = process_nans(&[(a, x), (b, y)], fpscr) {
        return nan;
    }
    add_numbers(x, y, fpscr)
}

/// Subtracts two numbers (FPSub).
pub(in crate::fp) fn subtract(a: u32, b: u32, fpscr: &mut u32) -> u32 {
    let (x, y) = (unpack(a, fpscr), unpack(b, fpscr));
    if let Some(nan) = process_nans(&[(a, x), (b, y)], fpscr) {
        return nan;
    }
    add_numbers(x, Unpacked { sign: y.sign ^ SIGN, ..y }, fpscr)
}

fn add_numbers(x: Unpacked, y: Unpacked, fpscr: &mut u32) -> u32 {
    match (x.class, y.class) {
        (Class::Infinity, Class::Infinity) if x.sign != y.sign => invalid(fpscr),
        (Class::Infinity, _) => x.sign | INFINITY,
        (_, Class::Infinity) => y.sign | INFINITY,
        (Class::Zero, Class::Zero) if x.sign == y.sign => x.sign,
        _ => add_terms(
            Term { sign: x.sign, exponent: x.exponent, mantissa: x.mantissa.into() },
            Term { sign: y.sign, exponent: y.exponent, mantissa: y.mantissa.into() },
            fpscr,
        ),
    }
}

/// Multiplies two numbers (FPMul).
pub(in crate::fp) fn multiply(a: u32, b: u32, fpscr: &mut u32) -> u32 {
    let (x, y) = (unpack(a, fpscr), unpack(b, fpscr));
    if let Some(nan) = process_nans(&[(a, x), (b, y)], fpscr) {
        return nan;
    }
    let sign = x.sign ^ y.sign;
    match (x.class, y.class) {
        (Class::Infinity, Class::Zero) | (Class::Zero, Class::Infinity) => invalid(fpscr),
        (Class::Infinity, _) | (_, Class::Infinity) => sign | INFINITY,
        (Class::Zero, _) | (_, Class::Zero) => sign,
        _ => round(sign, x.exponent + y.exponent, u128::from(x.mantissa) * u128::from(y.mantissa), SINGLE, fpscr),
    }
}

/// Divides two numbers (FPDiv).
pub(in crate::fp) fn divide(a: u32, b: u32, fpscr: &mut u32) -> u32 {
    let (x, y) = (unpack(a, fpscr), unpack(b, fpscr));
    if let Some(nan) = process_nans(&[(a, x), (b, y)], fpscr) {
        return nan;
    }
    let sign = x.sign ^ y.sign;
    match (x.class, y.class) {
        (Class::Infinity, Class::Infinity) | (Class::Zero, Class::Zero) => invalid(fpscr),
        (Class::Infinity, _) => sign | INFINITY,
        (_, Class::Zero) => {
            *fpscr |= DZC;
            sign | INFINITY
        }
        (Class::Zero, _) | (_, Class::Infinity) => sign,
        _ => {
            let (x, y) = (x.normalized(), y.normalized());
            let dividend = u64::from(x.mantissa) << 40;
            let divisor = u64::from(y.mantissa);
            // The quotient has at least 40 bits. The lowest bit, below them, tells whether there is a remainder.
            let quotient = (dividend / divisor) << 1 | u64::from(!dividend.is_multiple_of(divisor));
            round(sign, x.exponent - y.exponent - 41, quotient.into(), SINGLE, fpscr)
        }
    }
}

/// Computes a square root (FPSqrt).
pub(in crate::fp) fn square_root(a: u32, fpscr: &mut u32) -> u32 {
    let x = unpack(a, fpscr);
    if let Some(nan) = process_nans(&[(a, x)], fpscr) {
        return nan;
    }
    match x.class {
        Class::Zero => x.sign,
        _ if x.sign != 0 => invalid(fpscr),
        Class::Infinity => INFINITY,
        _ => {
            let x = x.normalized();
            // The shift makes the exponent even and the mantissa 62 or 63 bits long. The root then has 31 or 32 bits.
            // The lowest bit, below them, tells whether there is a remainder.
            let shift = 38 + (x.exponent & 1);
            let square = u64::from(x.mantissa) << shift;
            let root = square.isqrt();
            let mantissa = root << 1 | u64::from(root * root != square);
            round(0, (x.exponent - shift) / 2 - 1, mantissa.into(), SINGLE, fpscr)
        }
    }
}

/// Computes `addend + a * b` (FPMulAdd).
pub(in crate::fp) fn multiply_add(addend: u32, a: u32, b: u32, fpscr: &mut u32) -> u32 {
    let (z, x, y) = (unpack(addend, fpscr), unpack(a, fpscr), unpack(b, fpscr));
    let nan = process_nans(&[(addend, z), (a, x), (b, y)], fpscr);
    let invalid_product = matches!((x.class, y.class), (Class::Infinity, Class::Zero) | (Class::Zero, Class::Infinity));
    // A product of infinity and zero is invalid even if the addend is a quiet NaN.
    if invalid_product && matches!(z.class, Class::QuietNan) {
        return invalid(fpscr);
    }
    if let Some(nan) = nan {
        return nan;
    }
    let sign = x.sign ^ y.sign;
    let infinite_product = matches!(x.class, Class::Infinity) || matches!(y.class, Class::Infinity);
    let zero_product = matches!(x.class, Class::Zero) || matches!(y.class, Class::Zero);
    let infinite_addend = matches!(z.class, Class::Infinity);
    if invalid_product || (infinite_product && infinite_addend && sign != z.sign) {
        return invalid(fpscr);
    }
    if infinite_addend {
        return z.sign | INFINITY;
    }
    if infinite_product {
        return sign | INFINITY;
    }
    if zero_product && matches!(z.class, Class::Zero) && sign == z.sign {
        return sign;
    }
    add_terms(
        Term { sign: z.sign, exponent: z.exponent, mantissa: z.mantissa.into() },
        Term { sign, exponent: x.exponent + y.exponent, mantissa: u64::from(x.mantissa) * u64::from(y.mantissa) },
        fpscr,
    )
}

/// Compares two numbers (FPCompare): sets N, Z, C and V of FPSCR.
pub(in crate::fp) fn compare(a: u32, b: u32, signals: bool, fpscr: &mut u32) {
    let (x, y) = (unpack(a, fpscr), unpack(b, fpscr));
    let flags = if x.is_nan() || y.is_nan() {
        if signals || matches!(x.class, Class::SignallingNan) || matches!(y.class, Class::SignallingNan) {
            *fpscr |= IOC;
        }
        0b0011
    } else {
        // Numbers of one sign are in the order of their bit patterns. An operand that is flushed counts as zero.
        let ordered = |bits: u32, unpacked: Unpacked| {
            let magnitude = if unpacked.class == Class::Zero { 0 } else { (bits & !SIGN) as i32 };
            if unpacked.sign == 0 { magnitude } else { -magnitude }
        };
        match ordered(a, x).cmp(&ordered(b, y)) {
            Ordering::Equal => 0b0110,
            Ordering::Less => 0b1000,
            Ordering::Greater => 0b0010,
        }
    };
    *fpscr = *fpscr & 0x0FFF_FFFF | flags << 28;
}

/// Converts to an integer or a fixed-point number (FPToFixed), then extends it to 32 bits.
pub(in crate::fp) fn to_integer(a: u32, target: Integer, toward_zero: bool, fpscr: &mut u32) -> u32 {
    let x = unpack(a, fpscr);
    let (least, most) = if target.unsigned {
        (0, (1_i128 << target.size) - 1)
    } else {
        (-(1_i128 << (target.size - 1)), (1_i128 << (target.size - 1)) - 1)
    };
    let limit = if x.sign == 0 { most } else { least };
    let exponent = x.exponent + i32::from(target.fraction_bits);
    match x.class {
        Class::Zero => return 0,
        Class::QuietNan | Class::SignallingNan => {
            *fpscr |= IOC;
            return 0;
        }
        Class::Infinity => {
            *fpscr |= IOC;
            return limit as u32;
        }
        // A number with this exponent is out of range, and a shift by the exponent would exceed 128 bits.
        Class::Finite if exponent > 64 => {
            *fpscr |= IOC;
            return limit as u32;
        }
        Class::Finite => {}
    }
    let mode = if toward_zero { 3 } else { (*fpscr & RMODE) >> RMODE_SHIFT };
    let (integer, error) = split(x.mantissa.into(), -exponent);
    let magnitude = integer as i128 + i128::from(rounds_up(error, integer & 1 != 0, x.sign, mode));
    let value = if x.sign == 0 { magnitude } else { -magnitude };
    if value < least || value > most {
        *fpscr |= IOC;
        return limit as u32;
    }
    if error.is_some() {
        *fpscr |= IXC;
    }
    value as u32
}

/// Converts the low bits of `a` from an integer or a fixed-point number (FixedToFP).
pub(in crate::fp) fn from_integer(a: u32, source: Integer, to_nearest: bool, fpscr: &mut u32) -> u32 {
    let value = match (source.size, source.unsigned) {
        (16, true) => i64::from(a as u16),
        (16, false) => i64::from(a as u16 as i16),
        (_, true) => i64::from(a),
        (_, false) => i64::from(a as i32),
    };
    if value == 0 {
        return 0;
    }
    let mut scratch = if to_nearest { *fpscr & !RMODE } else { *fpscr };
    let sign = if value < 0 { SIGN } else { 0 };
    let result = round(sign, -i32::from(source.fraction_bits), value.unsigned_abs().into(), SINGLE, &mut scratch);
    *fpscr |= scratch;
    result
}

/// Converts from half precision (FPHalfToSingle). Denormal half-precision operands are never flushed.
pub(in crate::fp) fn from_half(half: u16, fpscr: &mut u32) -> u32 {
    let sign = u32::from(half & 0x8000) << 16;
    let fraction = u32::from(half & 0x03FF);
    let biased = i32::from(half >> 10 & 0x1F);
    match (biased, fraction) {
        (0, 0) => sign,
        // This conversion rounds nothing, because each half-precision number is a normal single-precision one.
        (0, _) => round(sign, -24, fraction.into(), SINGLE, fpscr),
        (31, 0) if *fpscr & AHP == 0 => sign | INFINITY,
        (31, _) if *fpscr & AHP == 0 => {
            if fraction & 0x200 == 0 {
                *fpscr |= IOC;
            }
            if *fpscr & DN != 0 { DEFAULT_NAN } else { sign | INFINITY | QUIET | fraction << 13 }
        }
        _ => round(sign, biased - 25, (fraction | 0x400).into(), SINGLE, fpscr),
    }
}

/// Converts to half precision (FPSingleToHalf).
pub(in crate::fp) fn to_half(a: u32, fpscr: &mut u32) -> u16 {
    let x = unpack(a, fpscr);
    let alternative = *fpscr & AHP != 0;
    let sign = x.sign >> 16;
    let result = match x.class {
        Class::QuietNan | Class::SignallingNan => {
            if alternative || x.class == Class::SignallingNan {
                *fpscr |= IOC;
            }
            if alternative {
                sign
            } else if *fpscr & DN != 0 {
                0x7E00
            } else {
                sign | 0x7E00 | a >> 13 & 0x01FF
            }
        }
        Class::Infinity if alternative => {
            *fpscr |= IOC;
            sign | 0x7FFF
        }
        Class::Infinity => sign | 0x7C00,
        Class::Zero => sign,
        Class::Finite => round(x.sign, x.exponent, x.mantissa.into(), HALF, fpscr),
    };
    result as u16
}
