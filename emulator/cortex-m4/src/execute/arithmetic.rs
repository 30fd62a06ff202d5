//! The arithmetic of instructions, as functions without state: ARM ARM A2.2.1, A7.4 and the pseudocode of A7.7.

use crate::op::{Extend, Lane, Lanes, Shift, Unary};

/// Adds with carry (AddWithCarry): returns the sum, the carry out, and whether the signed sum overflows.
#[inline(always)]
pub(crate) const fn add_with_carry(a: u32, b: u32, carry: bool) -> (u32, bool, bool) {
    let (sum, c1) = a.overflowing_add(b);
    let (sum, c2) = sum.overflowing_add(carry as u32);
    (sum, c1 || c2, ((a ^ sum) & (b ^ sum)) >> 31 != 0)
}

/// Shifts by any amount up to 255 (Shift_C): returns the value and the carry out.
#[inline(always)]
pub(crate) const fn shift(value: u32, shift: Shift, amount: u32, carry: bool) -> (u32, bool) {
    if amount == 0 {
        return (value, carry);
    }
    match shift {
        Shift::Lsl => match amount {
            1..=31 => (value << amount, value >> (32 - amount) & 1 != 0),
            32 => (0, value & 1 != 0),
            _ => (0, false),
        },
        Shift::Lsr => match amount {
            1..=31 => (value >> amount, value >> (amount - 1) & 1 != 0),
            32 => (0, value >> 31 != 0),
            _ => (0, false),
        },
        Shift::Asr => match amount {
            1..=31 => (((value as i32) >> amount) as u32, value >> (amount - 1) & 1 != 0),
            _ => (((value as i32) >> 31) as u32, value >> 31 != 0),
        },
        Shift::Ror => {
            let value = value.rotate_right(amount & 31);
            (value, value >> 31 != 0)
        }
        Shift::Rrx => ((carry as u32) << 31 | value >> 1, value & 1 != 0),
    }
}

/// Saturates to `bits` bits, signed (SignedSat), and tells whether it saturated.
pub(crate) fn signed_saturate(value: i64, bits: u32) -> (i32, bool) {
    let most = (1_i64 << (bits - 1)) - 1;
    let held = value.clamp(-most - 1, most);
    (held as i32, held != value)
}

/// Saturates to `bits` bits, unsigned (UnsignedSat), and tells whether it saturated.
pub(crate) fn unsigned_saturate(value: i64, bits: u32) -> (u32, bool) {
    let held = value.clamp(0, (1_i64 << bits) - 1);
    (held as u32, held != value)
}

/// Extends part of a register and adds it to `base`. The caller has already rotated the register.
pub(crate) const fn extend(kind: Extend, base: u32, value: u32) -> u32 {
    match kind {
        Extend::SignedByte => base.wrapping_add(value as i8 as u32),
        Extend::SignedHalf => base.wrapping_add(value as i16 as u32),
        Extend::UnsignedByte => base.wrapping_add(value & 0xFF),
        Extend::UnsignedHalf => base.wrapping_add(value & 0xFFFF),
        Extend::SignedBytes => {
            halves(base.wrapping_add(value as i8 as u32), (base >> 16).wrapping_add((value >> 16) as i8 as u32))
        }
        Extend::UnsignedBytes => halves(base.wrapping_add(value & 0xFF), (base >> 16).wrapping_add(value >> 16 & 0xFF)),
    }
}

const fn halves(low: u32, high: u32) -> u32 {
    high << 16 | low & 0xFFFF
}

pub(crate) const fn unary(kind: Unary, value: u32) -> u32 {
    match kind {
        Unary::Rev => value.swap_bytes(),
        Unary::Rev16 => value.swap_bytes().rotate_left(16),
        Unary::Revsh => (value as u16).swap_bytes() as i16 as u32,
        Unary::Rbit => value.reverse_bits(),
        Unary::Clz => value.leading_zeros(),
    }
}

/// Adds and subtracts lanes in parallel: returns the result, and APSR.GE where the operation sets it.
pub(crate) fn parallel(lanes: Lanes, lane: Lane, a: u32, b: u32) -> (u32, Option<u8>) {
    let sets = matches!(lane, Lane::Signed | Lane::Unsigned);
    let signed = matches!(lane, Lane::Signed | Lane::SignedSaturating | Lane::SignedHalving);
    let (mut result, mut ge) = (0, 0);
    let (width, count, flags) = if matches!(lanes, Lanes::Add8 | Lanes::Sub8) { (8, 4, 1_u8) } else { (16, 2, 3) };
    for index in 0..count {
        // The exchanging forms combine each half of `a` with the opposite half of `b`.
        let exchange = matches!(lanes, Lanes::Exchange16AddSub | Lanes::Exchange16SubAdd);
        let other = if exchange { 1 - index } else { index };
        let subtract = match lanes {
            Lanes::Add16 | Lanes::Add8 => false,
            Lanes::Sub16 | Lanes::Sub8 => true,
            // ASX adds in the upper half and subtracts in the lower half. SAX does the reverse.
            Lanes::Exchange16AddSub => index == 0,
            Lanes::Exchange16SubAdd => index == 1,
        };
        let (x, y) = (part(a, index, width, signed), part(b, other, width, signed));
        let value = if subtract { x - y } else { x + y };
        // GE is set for a signed lane that is not negative, an unsigned sum with a carry, and an unsigned difference
        // without borrow.
        let flag = if signed || subtract { value >= 0 } else { value >= 1 << width };
        if flag {
            ge |= flags << (index * flags.count_ones());
        }
        let out = match lane {
            Lane::Signed | Lane::Unsigned => value,
            Lane::SignedSaturating => i64::from(signed_saturate(value, width).0),
            Lane::UnsignedSaturating => i64::from(unsigned_saturate(value, width).0),
            Lane::SignedHalving | Lane::UnsignedHalving => value >> 1,
        };
        result |= (out as u32 & ((1 << width) - 1)) << (index * width);
    }
    (result, sets.then_some(ge))
}

fn part(value: u32, index: u32, width: u32, signed: bool) -> i64 {
    let value = value >> (index * width);
    match (width, signed) {
        (8, true) => i64::from(value as i8),
        (8, false) => i64::from(value as u8),
        (_, true) => i64::from(value as i16),
        (_, false) => i64::from(value as u16),
    }
}

/// The signed half of a register that the SMULxy family multiplies.
pub(crate) fn half(value: u32, top: bool) -> i64 {
    i64::from((if top { value >> 16 } else { value }) as i16)
}

/// Computes the two products of the SMLAD family, and their sum or difference.
pub(crate) fn dual(a: u32, b: u32, subtract: bool, exchange: bool) -> i64 {
    let b = if exchange { b.rotate_left(16) } else { b };
    let (first, second) = (half(a, false) * half(b, false), half(a, true) * half(b, true));
    if subtract { first - second } else { first + second }
}
