//! Single-precision arithmetic, bit exact.
//!
//! | What | ARM ARM (DDI 0403E), A2.5 |
//! |---|---|
//! | Unpacking, flush-to-zero of operands | FPUnpack |
//! | NaN propagation, default NaN | FPProcessNaN, FPProcessNaNs, FPProcessNaNs3 |
//! | Rounding in four modes, underflow before rounding, overflow, flush-to-zero of results | FPRound |
//! | Sum, difference, product, quotient, square root | FPAdd, FPSub, FPMul, FPDiv, FPSqrt |
//! | Fused multiply and add; comparison | FPMulAdd; FPCompare |
//! | Integers and fixed point | FPToFixed, FixedToFP |
//! | Half precision, IEEE and alternative | FPHalfToSingle, FPSingleToHalf |
//!
//! Each result can be computed in two ways. [`exact`] uses integer arithmetic, which covers all cases. The functions of
//! this module first try the host's arithmetic, which is faster. They use its result if FPSCR asks for rounding to
//! nearest without flush-to-zero, and if the result is far inside the normal range. Then the host's operation is the
//! correctly rounded one of IEEE 754, and IXC is the only possible flag. Exact `f64` arithmetic tells whether to set
//! it.
//!
//! The Advanced SIMD forms of the manual's functions (the standard FPSCR value) do not exist on this core.

pub(super) mod exact;

pub(super) const SIGN: u32 = 0x8000_0000;

// Bits of FPSCR, A2.5.3.
pub(super) const IOC: u32 = 1;
pub(super) const DZC: u32 = 1 << 1;
pub(super) const OFC: u32 = 1 << 2;
pub(super) const UFC: u32 = 1 << 3;
pub(super) const IXC: u32 = 1 << 4;
pub(super) const IDC: u32 = 1 << 7;
/// The lowest bit of the field RMode: 0 rounds to nearest, 1 towards plus infinity, 2 towards minus infinity, 3 towards
/// zero.
pub(super) const RMODE_SHIFT: u32 = 22;
pub(super) const RMODE: u32 = 3 << RMODE_SHIFT;
pub(super) const FZ: u32 = 1 << 24;
pub(super) const DN: u32 = 1 << 25;
pub(super) const AHP: u32 = 1 << 26;

/// The format of the integer or fixed-point number of a conversion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Integer {
    /// The number of bits: 16 or 32.
    pub(super) size: u8,
    pub(super) unsigned: bool,
    pub(super) fraction_bits: u8,
}

/// Whether FPSCR asks for the host's arithmetic: rounding to nearest, and no flush-to-zero.
#[inline(always)]
fn host_rounding(fpscr: u32) -> bool {
    fpscr & (RMODE | FZ) == 0
}

/// Whether a rounded result is finite and above the least normal number. The manual detects underflow before rounding,
/// so the least normal number itself may be the rounded result of an underflow.
#[inline(always)]
fn well_inside(result: f32) -> bool {
    (result.to_bits() >> 23 & 0xFF).wrapping_sub(2) < 253
}

/// The exact rounding error of `a + b`, where `sum` is the rounded sum (Knuth's TwoSum). The operands come from `f32`
/// numbers and their products, so they are far from `f64`'s underflow and overflow.
#[inline(always)]
fn sum_error(a: f64, b: f64, sum: f64) -> f64 {
    let b_part = sum - a;
    (a - (sum - b_part)) + (b - b_part)
}

#[inline]
pub(super) fn add(a: u32, b: u32, fpscr: &mut u32) -> u32 {
    if host_rounding(*fpscr) {
        let (x, y) = (f32::from_bits(a), f32::from_bits(b));
        let result = x + y;
        if well_inside(result) {
            if *fpscr & IXC == 0 {
                let (x, y) = (f64::from(x), f64::from(y));
                let sum = x + y;
                if sum != f64::from(result) || sum_error(x, y, sum) != 0.0 {
                    *fpscr |= IXC;
                }
            }
            return result.to_bits();
        }
    }
    exact::add(a, b, fpscr)
}

/// Computes `a - b`. A NaN in `b` keeps its sign, so this is not the sum of `a` and a negated `b`.
#[inline]
pub(super) fn subtract(a: u32, b: u32, fpscr: &mut u32) -> u32 {
    if host_rounding(*fpscr) {
        let (x, y) = (f32::from_bits(a), f32::from_bits(b));
        let result = x - y;
        if well_inside(result) {
            if *fpscr & IXC == 0 {
                let (x, y) = (f64::from(x), -f64::from(y));
                let sum = x + y;
                if sum != f64::from(result) || sum_error(x, y, sum) != 0.0 {
                    *fpscr |= IXC;
                }
            }
            return result.to_bits();
        }
    }
    exact::subtract(a, b, fpscr)
}

#[inline]
pub(super) fn multiply(a: u32, b: u32, fpscr: &mut u32) -> u32 {
    if host_rounding(*fpscr) {
        let (x, y) = (f32::from_bits(a), f32::from_bits(b));
        let result = x * y;
        if well_inside(result) {
            // The product of two 24-bit mantissas has 48 bits, so it is exact in f64.
            if *fpscr & IXC == 0 && f64::from(x) * f64::from(y) != f64::from(result) {
                *fpscr |= IXC;
            }
            return result.to_bits();
        }
    }
    exact::multiply(a, b, fpscr)
}

#[inline]
pub(super) fn divide(a: u32, b: u32, fpscr: &mut u32) -> u32 {
    if host_rounding(*fpscr) {
        let (x, y) = (f32::from_bits(a), f32::from_bits(b));
        let result = x / y;
        if well_inside(result) {
            // A quotient is exact if the product of quotient and divisor is the dividend. That product is exact in f64.
            if *fpscr & IXC == 0 && f64::from(result) * f64::from(y) != f64::from(x) {
                *fpscr |= IXC;
            }
            return result.to_bits();
        }
    }
    exact::divide(a, b, fpscr)
}

#[inline]
pub(super) fn square_root(a: u32, fpscr: &mut u32) -> u32 {
    if host_rounding(*fpscr) {
        let x = f32::from_bits(a);
        let result = x.sqrt();
        if well_inside(result) {
            if *fpscr & IXC == 0 && f64::from(result) * f64::from(result) != f64::from(x) {
                *fpscr |= IXC;
            }
            return result.to_bits();
        }
    }
    exact::square_root(a, fpscr)
}

#[inline]
pub(super) fn multiply_add(addend: u32, a: u32, b: u32, fpscr: &mut u32) -> u32 {
    if host_rounding(*fpscr) {
        let z = f64::from(f32::from_bits(addend));
        // The product is exact, so only the sum is rounded. The sum is rounded to odd in f64 and then to f32, which
        // gives the right result because 53 bits are more than 24 + 2 (S. Boldo, G. Melquiond: Emulation of FMA and
        // correctly rounded sums, 2008).
        let product = f64::from(f32::from_bits(a)) * f64::from(f32::from_bits(b));
        let sum = product + z;
        let error = sum_error(product, z, sum);
        let to_odd = if error != 0.0 && sum.to_bits() & 1 == 0 {
            // Rounding to odd moves the sum one step towards the exact sum. A larger magnitude has a larger bit
            // pattern, for either sign.
            let outwards = (error > 0.0) == (sum > 0.0);
            f64::from_bits(if outwards { sum.to_bits() + 1 } else { sum.to_bits() - 1 })
        } else {
            sum
        };
        let result = to_odd as f32;
        if well_inside(result) {
            if error != 0.0 || f64::from(result) != sum {
                *fpscr |= IXC;
            }
            return result.to_bits();
        }
    }
    exact::multiply_add(addend, a, b, fpscr)
}

/// Compares like VCMP, or like VCMPE if `signals`: sets N, Z, C and V of FPSCR.
#[inline]
pub(super) fn compare(a: u32, b: u32, signals: bool, fpscr: &mut u32) {
    let (x, y) = (f32::from_bits(a), f32::from_bits(b));
    // For flush-to-zero and NaNs the integer arithmetic is used.
    if *fpscr & FZ != 0 || x.is_nan() || y.is_nan() {
        exact::compare(a, b, signals, fpscr);
    } else {
        let flags = if x == y {
            0b0110
        } else if x < y {
            0b1000
        } else {
            0b0010
        };
        *fpscr = *fpscr & 0x0FFF_FFFF | flags << 28;
    }
}

/// Converts to an integer or a fixed-point number, extended to 32 bits. Values out of range saturate.
#[inline]
pub(super) fn to_integer(a: u32, target: Integer, toward_zero: bool, fpscr: &mut u32) -> u32 {
    let x = f32::from_bits(a);
    if toward_zero && *fpscr & FZ == 0 && target.size == 32 && target.fraction_bits == 0 {
        let truncated = if target.unsigned {
            // Every value between -1 and 0 rounds to zero.
            (x > -1.0 && x < 4_294_967_296.0).then(|| (x as u32, f64::from(x as u32)))
        } else {
            (-2_147_483_648.0..2_147_483_648.0).contains(&x).then(|| (x as i32 as u32, f64::from(x as i32)))
        };
        if let Some((result, value)) = truncated {
            if value != f64::from(x) {
                *fpscr |= IXC;
            }
            return result;
        }
    }
    exact::to_integer(a, target, toward_zero, fpscr)
}

/// Converts from an integer or a fixed-point number in the low bits of `a`.
#[inline]
pub(super) fn from_integer(a: u32, source: Integer, to_nearest: bool, fpscr: &mut u32) -> u32 {
    if (to_nearest || *fpscr & RMODE == 0) && source.size == 32 && source.fraction_bits == 0 {
        let (result, value) =
            if source.unsigned { (a as f32, f64::from(a)) } else { (a as i32 as f32, f64::from(a as i32)) };
        if f64::from(result) != value {
            *fpscr |= IXC;
        }
        return result.to_bits();
    }
    exact::from_integer(a, source, to_nearest, fpscr)
}

pub(super) use exact::{from_half, to_half};
