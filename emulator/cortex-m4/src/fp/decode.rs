//! The decoder of instructions of coprocessors 10 and 11.
//!
//! | Encodings | ARM ARM | Function |
//! |---|---|---|
//! | 0xEExx, bit 4 clear: data processing | A6.4 | `data_processing` |
//! | 0xECxx, 0xEDxx: loads and stores | A6.5 | `load_store` |
//! | 0xEExx, bit 4 set: transfers of 32 bits | A6.6 | `transfer` |
//! | 0xEC4x, 0xEC5x: transfers of 64 bits | A6.7 | `transfer_pair` |
//!
//! `None` means an encoding that is undefined in FPv4-SP or UNPREDICTABLE.

use super::FpOp;

pub(crate) fn decode(first: u16, second: u16) -> Option<FpOp> {
    if second & 0x0E00 != 0x0A00 {
        return None;
    }
    let double = second & 0x0100 != 0;
    match first >> 8 {
        0xEC | 0xED => {
            if first & 0xFFE0 == 0xEC40 {
                transfer_pair(first, second, double)
            } else {
                load_store(first, second, double)
            }
        }
        0xEE if second & 0x0010 != 0 => transfer(first, second, double),
        0xEE if !double => data_processing(first, second),
        _ => None,
    }
}

const fn bit(halfword: u16, number: u32) -> bool {
    halfword >> number & 1 != 0
}

const fn field(halfword: u16, low: u32) -> u8 {
    (halfword >> low & 15) as u8
}

/// The number of a register, encoded in four bits and a fifth. The fifth bit is the lowest bit of a single register's
/// number and the highest of a double register's. A double register is returned as the lower of its two single
/// registers. `None` stands for d16 and above, which do not exist.
fn register(four: u8, fifth: bool, double: bool) -> Option<u8> {
    match (double, fifth) {
        (false, fifth) => Some(four << 1 | u8::from(fifth)),
        (true, false) => Some(four << 1),
        (true, true) => None,
    }
}

/// A core register's number. SP and PC are UNPREDICTABLE in transfers, so they give `None`.
fn core_register(number: u8) -> Option<u8> {
    (number != 13 && number != 15).then_some(number)
}

fn data_processing(first: u16, second: u16) -> Option<FpOp> {
    let d = field(second, 12) << 1 | u8::from(bit(first, 6));
    let n = field(first, 0) << 1 | u8::from(bit(second, 7));
    let m = field(second, 0) << 1 | u8::from(bit(second, 5));
    // The first two numbers of each arm are bit 23 and bits 21:20 of the instruction: Opc1 without its bit for D.
    Some(match (bit(first, 7), first >> 4 & 3, bit(second, 6)) {
        (false, 0, false) => FpOp::Vmla { d, n, m },
        (false, 0, true) => FpOp::Vmls { d, n, m },
        (false, 1, false) => FpOp::Vnmls { d, n, m },
        (false, 1, true) => FpOp::Vnmla { d, n, m },
        (false, 2, false) => FpOp::Vmul { d, n, m },
        (false, 2, true) => FpOp::Vnmul { d, n, m },
        (false, _, false) => FpOp::Vadd { d, n, m },
        (false, _, true) => FpOp::Vsub { d, n, m },
        (true, 0, false) => FpOp::Vdiv { d, n, m },
        (true, 0, true) => return None,
        (true, 1, false) => FpOp::Vfnms { d, n, m },
        (true, 1, true) => FpOp::Vfnma { d, n, m },
        (true, 2, false) => FpOp::Vfma { d, n, m },
        (true, 2, true) => FpOp::Vfms { d, n, m },
        (true, _, false) => {
            if second & 0x00A0 != 0 {
                return None;
            }
            FpOp::VmovImmediate { d, imm8: field(first, 0) << 4 | field(second, 0) }
        }
        (true, _, true) => return other_data_processing(first, second, d, m),
    })
}

/// Decodes the instructions with Opc1 = 1x11 and Opc3 = x1. The low four bits of the first halfword are Opc2, ARM ARM
/// A6.4.
fn other_data_processing(first: u16, second: u16, d: u8, m: u8) -> Option<FpOp> {
    let high = bit(second, 7);
    let opc2 = field(first, 0);
    Some(match (opc2, high) {
        (0b0000, false) => FpOp::Vmov { d, m },
        (0b0000, true) => FpOp::Vabs { d, m },
        (0b0001, false) => FpOp::Vneg { d, m },
        (0b0001, true) => FpOp::Vsqrt { d, m },
        (0b0010, top) => FpOp::VcvtFromHalf { d, m, top },
        (0b0011, top) => FpOp::VcvtToHalf { d, m, top },
        (0b0100, signals) => FpOp::Vcmp { d, m, signals },
        (0b0101, signals) if m == 0 => FpOp::VcmpZero { d, signals },
        (0b1000, signed) => FpOp::VcvtFromInteger { d, m, unsigned: !signed },
        (0b1100, toward_zero) => FpOp::VcvtToInteger { d, m, unsigned: true, toward_zero },
        (0b1101, toward_zero) => FpOp::VcvtToInteger { d, m, unsigned: false, toward_zero },
        (0b1010 | 0b1011 | 0b1110 | 0b1111, word) => {
            let size = if word { 32 } else { 16 };
            let fraction_bits = u8::checked_sub(size, field(second, 0) << 1 | u8::from(bit(second, 5)))?;
            let unsigned = opc2 & 1 != 0;
            if opc2 & 4 != 0 {
                FpOp::VcvtToFixed { d, unsigned, size, fraction_bits }
            } else {
                FpOp::VcvtFromFixed { d, unsigned, size, fraction_bits }
            }
        }
        _ => return None,
    })
}

fn load_store(first: u16, second: u16, double: bool) -> Option<FpOp> {
    let d = register(field(second, 12), bit(first, 6), double)?;
    let base = field(first, 0);
    let imm8 = (second & 0xFF) as u8;
    let (before, add, write_back, load) = (bit(first, 8), bit(first, 7), bit(first, 5), bit(first, 4));
    if before && !write_back {
        let words = if double { 2 } else { 1 };
        return match (load, base) {
            (true, _) => Some(FpOp::Vldr { d, words, base, add, imm8 }),
            (false, 15) => None,
            (false, _) => Some(FpOp::Vstr { d, words, base, add, imm8 }),
        };
    }
    // FPv4-SP has increment after, with or without write-back, and decrement before with write-back.
    if before == add {
        return None;
    }
    let words = if double { imm8 & !1 } else { imm8 };
    if base == 15 || words == 0 || words > 32 - d {
        return None;
    }
    Some(if load {
        FpOp::Vldm { d, words, base, add, write_back, imm8 }
    } else {
        FpOp::Vstm { d, words, base, add, write_back, imm8 }
    })
}

fn transfer(first: u16, second: u16, double: bool) -> Option<FpOp> {
    let to_core = bit(first, 4);
    let t = field(second, 12);
    if second & 0x006F != 0 {
        return None;
    }
    match (double, first >> 5 & 7) {
        (false, 0b000) => {
            let t = core_register(t)?;
            let n = register(field(first, 0), bit(second, 7), false)?;
            Some(if to_core { FpOp::VmovToCore { n, t } } else { FpOp::VmovFromCore { n, t } })
        }
        (true, half @ (0b000 | 0b001)) => {
            let t = core_register(t)?;
            let n = register(field(first, 0), bit(second, 7), true)? | (half & 1) as u8;
            Some(if to_core { FpOp::VmovToCore { n, t } } else { FpOp::VmovFromCore { n, t } })
        }
        // FPSCR is the only FP system register of an M profile core.
        (false, 0b111) if field(first, 0) == 1 && !bit(second, 7) => {
            if to_core {
                (t != 13).then_some(FpOp::Vmrs { t })
            } else {
                core_register(t).map(|t| FpOp::Vmsr { t })
            }
        }
        _ => None,
    }
}

fn transfer_pair(first: u16, second: u16, double: bool) -> Option<FpOp> {
    if second & 0x00D0 != 0x0010 {
        return None;
    }
    let m = register(field(second, 0), bit(second, 5), double)?;
    let t = core_register(field(second, 12))?;
    let t2 = core_register(field(first, 0))?;
    let to_core = bit(first, 4);
    if m == 31 || (to_core && t == t2) {
        return None;
    }
    Some(if to_core { FpOp::VmovToCorePair { m, t, t2 } } else { FpOp::VmovFromCorePair { m, t, t2 } })
}
