//! The decoder of 32-bit instructions other than loads and stores, ARM ARM A5.3.

use super::{UNDEFINED, bad, field, transfer};
use crate::Fault;
use crate::fp;
use crate::op::{Alu, Carry, Do, Extend, Lane, Lanes, Long, Saturating, Shift, Unary};

/// Decodes a 32-bit instruction by ARM ARM A5.3, table A5-9.
pub(super) fn decode(address: u32, first: u16, second: u16) -> Do {
    if first & 0xEC00 == 0xEC00 {
        return coprocessor(first, second);
    }
    match (first >> 11, field(first, 9, 2)) {
        (0x1D, 0) if first & 0x40 == 0 => transfer::multiple(first, second),
        (0x1D, 0) => transfer::dual_exclusive(first, second),
        (0x1D, _) => shifted_register(first, second),
        (0x1E, _) if second & 0x8000 != 0 => branch_and_control(address, first, second),
        (0x1E, 0 | 2) => modified_immediate(first, second),
        (0x1E, _) => plain_immediate(address, first, second),
        (0x1F, 0) => transfer::single(address, first, second),
        (0x1F, _) => match field(first, 7, 3) {
            4 | 5 => data_processing_register(first, second),
            6 => multiply(first, second),
            _ => long_multiply(first, second),
        },
        _ => UNDEFINED,
    }
}

/// Decodes coprocessor instructions, ARM ARM A5.3.18.
fn coprocessor(first: u16, second: u16) -> Do {
    let opcode = field(first, 4, 6);
    if first & 0x0300 == 0x0300 || opcode >> 1 == 0 {
        return UNDEFINED;
    }
    match field(second, 8, 4) {
        10 | 11 => fp::decode(first, second).map_or(UNDEFINED, Do::Fp),
        _ => Do::Fault(Fault::NoCoprocessor),
    }
}

/// Expands a modified immediate (ThumbExpandImm_C, ARM ARM A5.3.2). Returns `None` where the encoding is unpredictable.
fn expand(first: u16, second: u16) -> Option<(u32, Carry)> {
    let imm12 = u32::from(field(first, 10, 1)) << 11 | u32::from(field(second, 12, 3)) << 8 | u32::from(second & 0xFF);
    let byte = imm12 & 0xFF;
    if imm12 >> 10 == 0 {
        let value = match imm12 >> 8 {
            0 => byte,
            _ if byte == 0 => return None,
            1 => byte << 16 | byte,
            2 => byte << 24 | byte << 8,
            _ => byte << 24 | byte << 16 | byte << 8 | byte,
        };
        return Some((value, Carry::Same));
    }
    let value = (0x80 | imm12 & 0x7F).rotate_right(imm12 >> 7);
    Some((value, if value >> 31 != 0 { Carry::Set } else { Carry::Clear }))
}

/// Decodes an immediate shift (DecodeImmShift, ARM ARM A7.4.2).
fn shift(kind: u8, amount: u8) -> (Shift, u8) {
    match (kind, amount) {
        (0, _) => (Shift::Lsl, amount),
        (1, 0) => (Shift::Lsr, 32),
        (1, _) => (Shift::Lsr, amount),
        (2, 0) => (Shift::Asr, 32),
        (2, _) => (Shift::Asr, amount),
        (_, 0) => (Shift::Rrx, 1),
        _ => (Shift::Ror, amount),
    }
}

fn imm5(second: u16) -> u8 {
    field(second, 12, 3) << 2 | field(second, 6, 2)
}

/// Finds the operation that the fields of ARM ARM A5.3.1 and A5.3.11 encode. Returns `None` where its registers are not
/// allowed.
fn alu(first: u16, d: u8, n: u8) -> Option<(Alu, bool)> {
    let s = first & 0x10 != 0;
    let compare = s && d == 15;
    let (alu, test) = match field(first, 5, 4) {
        0 if compare => (Alu::Tst, true),
        0 => (Alu::And, false),
        1 => (Alu::Bic, false),
        2 if n == 15 => (Alu::Mov, false),
        2 => (Alu::Orr, false),
        3 if n == 15 => (Alu::Mvn, false),
        3 => (Alu::Orn, false),
        4 if compare => (Alu::Teq, true),
        4 => (Alu::Eor, false),
        8 if compare => (Alu::Cmn, true),
        8 => (Alu::Add, false),
        10 => (Alu::Adc, false),
        11 => (Alu::Sbc, false),
        13 if compare => (Alu::Cmp, true),
        13 => (Alu::Sub, false),
        14 => (Alu::Rsb, false),
        _ => return None,
    };
    let stack_base = n == 13 && matches!(alu, Alu::Add | Alu::Sub | Alu::Cmn | Alu::Cmp);
    let base_fine = !bad(n) || stack_base || matches!(alu, Alu::Mov | Alu::Mvn);
    let stack_target = d == 13 && n == 13 && matches!(alu, Alu::Add | Alu::Sub);
    let target_fine = test || !bad(d) || stack_target;
    (base_fine && target_fine).then_some((alu, s))
}

/// Decodes data processing with a modified immediate, ARM ARM A5.3.1.
fn modified_immediate(first: u16, second: u16) -> Do {
    let (d, n) = (field(second, 8, 4), field(first, 0, 4));
    let (Some((alu, s)), Some((imm, carry))) = (alu(first, d, n), expand(first, second)) else {
        return UNDEFINED;
    };
    match (alu, s) {
        (Alu::Cmp, _) => Do::CmpImm { n, imm },
        _ if d == 13 => Do::AluImm { alu, s, d, n, carry, imm },
        (Alu::Mov, false) => Do::MovImm { d, imm },
        (Alu::Add, false) => Do::AddImm { d, n, imm },
        (Alu::Add, true) => Do::AddsImm { d, n, imm },
        (Alu::Sub, false) => Do::SubImm { d, n, imm },
        (Alu::Sub, true) => Do::SubsImm { d, n, imm },
        (Alu::And, false) => Do::AndImm { d, n, imm },
        (Alu::Bic, false) => Do::AndImm { d, n, imm: !imm },
        _ => Do::AluImm { alu, s, d, n, carry, imm },
    }
}

/// Decodes data processing with a shifted register, ARM ARM A5.3.11.
fn shifted_register(first: u16, second: u16) -> Do {
    let (d, n, m) = (field(second, 8, 4), field(first, 0, 4), field(second, 0, 4));
    let (kind, amount) = (field(second, 4, 2), imm5(second));
    if second & 0x8000 != 0 {
        return UNDEFINED;
    }
    if field(first, 5, 4) == 6 {
        // PKH has neither the S bit nor the T bit set.
        return if first & 0x10 != 0 || kind & 1 != 0 || bad(d) || bad(n) || bad(m) {
            UNDEFINED
        } else if kind == 0 {
            Do::Pkhbt { d, n, m, amount }
        } else {
            Do::Pkhtb { d, n, m, amount: if amount == 0 { 32 } else { amount } }
        };
    }
    let Some((alu, s)) = alu_register(first, second, d, n, m) else {
        return UNDEFINED;
    };
    let (shift, amount) = shift(kind, amount);
    if d == 13 {
        // ADD and SUB that write the stack pointer shift left by at most three bits.
        let fine = matches!(alu, Alu::Mov) || (shift == Shift::Lsl && amount <= 3);
        return if fine { Do::AluShift { alu, s, d, n, m, shift, amount } } else { UNDEFINED };
    }
    match (alu, s, shift, amount) {
        (Alu::Mov, false, Shift::Lsl, 0) => Do::MovReg { d, m },
        (Alu::Mov, false, Shift::Lsl, _) => Do::LslImm { d, m, amount },
        (Alu::Mov, true, Shift::Lsl, _) => Do::LslsImm { d, m, amount },
        (Alu::Mov, false, Shift::Lsr, 1..=31) => Do::LsrImm { d, m, amount },
        (Alu::Mov, true, Shift::Lsr, 1..=31) => Do::LsrsImm { d, m, amount },
        (Alu::Add, false, Shift::Lsl, 0) => Do::AddReg { d, n, m },
        (Alu::Add, false, Shift::Lsl, _) => Do::AddLsl { d, n, m, amount },
        (Alu::Add, true, Shift::Lsl, 0) => Do::AddsReg { d, n, m },
        (Alu::Sub, false, Shift::Lsl, 0) => Do::SubReg { d, n, m },
        (Alu::Sub, true, Shift::Lsl, 0) => Do::SubsReg { d, n, m },
        (Alu::Cmp, _, Shift::Lsl, 0) => Do::CmpReg { n, m },
        (Alu::And, false, Shift::Lsl, 0) => Do::AndReg { d, n, m },
        (Alu::And, true, Shift::Lsl, 0) => Do::AndsReg { d, n, m },
        (Alu::Orr, false, Shift::Lsl, 0) => Do::OrrReg { d, n, m },
        (Alu::Orr, true, Shift::Lsl, 0) => Do::OrrsReg { d, n, m },
        (Alu::Eor, false, Shift::Lsl, 0) => Do::EorReg { d, n, m },
        (Alu::Eor, true, Shift::Lsl, 0) => Do::EorsReg { d, n, m },
        _ => Do::AluShift { alu, s, d, n, m, shift, amount },
    }
}

/// Decodes as [`alu`] does, and checks the second operand register as well. MOV without flags and shift may read or
/// write the stack pointer (ARM ARM A7.7.77).
fn alu_register(first: u16, second: u16, d: u8, n: u8, m: u8) -> Option<(Alu, bool)> {
    if first & 0x1F0 == 0x40 && second & 0x70F0 == 0 && n == 15 && (d == 13) != (m == 13) && d != 15 && m != 15 {
        return Some((Alu::Mov, false));
    }
    alu(first, d, n).filter(|_| !bad(m))
}

/// Decodes data processing with a plain immediate, ARM ARM A5.3.3.
fn plain_immediate(address: u32, first: u16, second: u16) -> Do {
    let (d, n) = (field(second, 8, 4), field(first, 0, 4));
    let imm12 = u32::from(field(first, 10, 1)) << 11 | u32::from(field(second, 12, 3)) << 8 | u32::from(second & 0xFF);
    let imm16 = (u32::from(n) << 12 | imm12) as u16;
    let (lsb, low) = (imm5(second), field(second, 0, 5));
    let pc = address.wrapping_add(4) & !3;
    let stack = d == 13 && n == 13;
    // In the bit field instructions, bit 10 of the first and bit 5 of the second halfword should be zero.
    let spare = first & 0x400 != 0 || second & 0x20 != 0;
    let opcode = field(first, 4, 5);
    match opcode {
        0x00 | 0x0A if bad(d) && !stack => UNDEFINED,
        0x00 if n == 15 => Do::MovImm { d, imm: pc.wrapping_add(imm12) },
        0x0A if n == 15 => Do::MovImm { d, imm: pc.wrapping_sub(imm12) },
        0x00 if stack => Do::AluImm { alu: Alu::Add, s: false, d, n, carry: Carry::Same, imm: imm12 },
        0x0A if stack => Do::AluImm { alu: Alu::Sub, s: false, d, n, carry: Carry::Same, imm: imm12 },
        0x00 => Do::AddImm { d, n, imm: imm12 },
        0x0A => Do::SubImm { d, n, imm: imm12 },
        _ if bad(d) => UNDEFINED,
        0x04 => Do::MovImm { d, imm: u32::from(imm16) },
        0x0C => Do::Movt { d, imm: imm16 },
        _ if spare => UNDEFINED,
        // In BFI and BFC, `low` is the most significant bit of the field.
        0x16 if low < lsb || n == 13 => UNDEFINED,
        0x16 => {
            let mask = (u32::MAX >> (31 - (low - lsb))) << lsb;
            if n == 15 { Do::Bfc { d, mask } } else { Do::Bfi { d, n, lsb, mask } }
        }
        _ if bad(n) => UNDEFINED,
        0x12 | 0x1A if lsb == 0 => {
            let to = low & 0xF;
            match (low & 0x10, opcode) {
                (0, 0x12) => Do::Ssat16 { d, n, to: to + 1 },
                (0, _) => Do::Usat16 { d, n, to },
                _ => UNDEFINED,
            }
        }
        0x10 | 0x12 | 0x18 | 0x1A => {
            let (shift, amount) = if opcode & 2 == 0 { (Shift::Lsl, lsb) } else { (Shift::Asr, lsb) };
            if opcode & 8 == 0 {
                Do::Ssat { d, n, to: low + 1, shift, amount }
            } else {
                Do::Usat { d, n, to: low, shift, amount }
            }
        }
        // In SBFX and UBFX, `low` is the width of the field minus one.
        0x14 | 0x1C if lsb + low > 31 => UNDEFINED,
        0x14 => Do::Sbfx { d, n, left: 31 - lsb - low, right: 31 - low },
        0x1C => Do::Ubfx { d, n, lsb, mask: u32::MAX >> (31 - low) },
        _ => UNDEFINED,
    }
}

/// Decodes branches and miscellaneous control, ARM ARM A5.3.4.
fn branch_and_control(address: u32, first: u16, second: u16) -> Do {
    let pc = address.wrapping_add(4);
    let s = u32::from(field(first, 10, 1));
    let (j1, j2) = (u32::from(field(second, 13, 1)), u32::from(field(second, 11, 1)));
    let low = u32::from(second & 0x7FF) << 1;
    if second & 0x1000 != 0 {
        // The instructions are B in encoding T4, and BL.
        let (i1, i2) = (1 ^ j1 ^ s, 1 ^ j2 ^ s);
        let offset = s << 24 | i1 << 23 | i2 << 22 | u32::from(first & 0x3FF) << 12 | low;
        let target = pc.wrapping_add(((offset << 7) as i32 >> 7) as u32);
        return if second & 0x4000 == 0 { Do::B { target } } else { Do::Bl { target } };
    }
    if second & 0x4000 != 0 {
        return UNDEFINED;
    }
    let opcode = field(first, 4, 7);
    if opcode & 0x38 != 0x38 {
        let offset = s << 20 | j2 << 19 | j1 << 18 | u32::from(first & 0x3F) << 12 | low;
        let target = pc.wrapping_add(((offset << 11) as i32 >> 11) as u32);
        return super::branch_if(field(first, 6, 4), target);
    }
    let (n, d) = (field(first, 0, 4), field(second, 8, 4));
    match opcode {
        0x38 if second & 0xF300 == 0x8000 && !bad(n) && second & 0x0C00 != 0 => {
            Do::Msr { n, mask: field(second, 10, 2), sysm: (second & 0xFF) as u8 }
        }
        0x3A if first == 0xF3AF && second & 0xFF00 == 0x8000 => match second & 0xFF {
            2 => Do::Wfe,
            3 => Do::Wfi,
            4 => Do::Sev,
            // NOP, YIELD, DBG and the unallocated hints do nothing.
            _ => Do::Nop,
        },
        0x3B if first == 0xF3BF && second & 0xFF00 == 0x8F00 => match second & 0xFF {
            0x2F => Do::Clrex,
            // DSB, DMB and ISB are accepted with any option.
            0x40..=0x6F => Do::Barrier,
            _ => UNDEFINED,
        },
        0x3E if first == 0xF3EF && second & 0xF000 == 0x8000 && !bad(d) => Do::Mrs { d, sysm: (second & 0xFF) as u8 },
        _ => UNDEFINED,
    }
}

/// Decodes data processing with registers, ARM ARM A5.3.12 to A5.3.15.
fn data_processing_register(first: u16, second: u16) -> Do {
    let (d, n, m) = (field(second, 8, 4), field(first, 0, 4), field(second, 0, 4));
    let (op1, op2) = (field(first, 4, 4), field(second, 4, 4));
    if field(second, 12, 4) != 15 || bad(d) || bad(m) {
        return UNDEFINED;
    }
    if op1 < 8 && op2 >= 8 {
        let kind = match op1 {
            0 => Extend::SignedHalf,
            1 => Extend::UnsignedHalf,
            2 => Extend::SignedBytes,
            3 => Extend::UnsignedBytes,
            4 => Extend::SignedByte,
            5 => Extend::UnsignedByte,
            _ => return UNDEFINED,
        };
        if n == 13 || op2 & 4 != 0 {
            return UNDEFINED;
        }
        return match (kind, n, op2 & 3) {
            (Extend::UnsignedByte, 15, 0) => Do::Uxtb { d, m },
            (Extend::UnsignedHalf, 15, 0) => Do::Uxth { d, m },
            (_, _, rotation) => Do::Extend { kind, d, n, m, rotation: rotation * 8 },
        };
    }
    if bad(n) {
        return UNDEFINED;
    }
    match (op1, op2) {
        (0..=7, 0) => {
            let shift = [Shift::Lsl, Shift::Lsr, Shift::Asr, Shift::Ror][usize::from(op1 >> 1)];
            Do::ShiftReg { shift, s: op1 & 1 != 0, d, n, m }
        }
        (8.., 0..=7) => {
            let lanes = match op1 {
                8 => Lanes::Add8,
                9 => Lanes::Add16,
                10 => Lanes::Exchange16AddSub,
                12 => Lanes::Sub8,
                13 => Lanes::Sub16,
                14 => Lanes::Exchange16SubAdd,
                _ => return UNDEFINED,
            };
            let lane = match op2 {
                0 => Lane::Signed,
                1 => Lane::SignedSaturating,
                2 => Lane::SignedHalving,
                4 => Lane::Unsigned,
                5 => Lane::UnsignedSaturating,
                6 => Lane::UnsignedHalving,
                _ => return UNDEFINED,
            };
            Do::Parallel { lanes, lane, d, n, m }
        }
        (8, 8..=11) => {
            let kind = [Saturating::Add, Saturating::DoubleAdd, Saturating::Sub, Saturating::DoubleSub];
            Do::Saturating { kind: kind[usize::from(op2 & 3)], d, n, m }
        }
        (9, 8..=11) if n == m => {
            let kind = [Unary::Rev, Unary::Rev16, Unary::Rbit, Unary::Revsh];
            Do::Unary { kind: kind[usize::from(op2 & 3)], d, m }
        }
        (10, 8) => Do::Sel { d, n, m },
        (11, 8) if n == m => Do::Unary { kind: Unary::Clz, d, m },
        _ => UNDEFINED,
    }
}

/// Decodes multiplication, ARM ARM A5.3.16.
fn multiply(first: u16, second: u16) -> Do {
    let (d, n, m, a) = (field(second, 8, 4), field(first, 0, 4), field(second, 0, 4), field(second, 12, 4));
    let (op1, op2) = (field(first, 4, 3), field(second, 4, 4));
    if bad(d) || bad(n) || bad(m) || a == 13 || op2 > 3 {
        return UNDEFINED;
    }
    let (high_bit, low_bit) = (op2 & 2 != 0, op2 & 1 != 0);
    match (op1, op2) {
        (0, 0) if a == 15 => Do::Mul { d, n, m },
        (0, 0) => Do::Mla { d, n, m, a },
        (0, 1) if a != 15 => Do::Mls { d, n, m, a },
        (1, _) => Do::SmlaHalf { d, n, m, a, n_top: high_bit, m_top: low_bit },
        (2 | 4, 0 | 1) => Do::SmlaDual { d, n, m, a, subtract: op1 == 4, exchange: low_bit },
        (3, 0 | 1) => Do::SmlaWide { d, n, m, a, m_top: low_bit },
        (5, 0 | 1) => Do::SmmlaTop { d, n, m, a, subtract: false, round: low_bit },
        (6, 0 | 1) if a != 15 => Do::SmmlaTop { d, n, m, a, subtract: true, round: low_bit },
        (7, 0) => Do::Usada8 { d, n, m, a },
        _ => UNDEFINED,
    }
}

/// Decodes long multiplication and division, ARM ARM A5.3.17.
fn long_multiply(first: u16, second: u16) -> Do {
    let (n, m, high, low) = (field(first, 0, 4), field(second, 0, 4), field(second, 8, 4), field(second, 12, 4));
    let (op1, op2) = (field(first, 4, 3), field(second, 4, 4));
    if bad(n) || bad(m) || bad(high) {
        return UNDEFINED;
    }
    match (op1, op2) {
        (1, 15) if low == 15 => return Do::Sdiv { d: high, n, m },
        (3, 15) if low == 15 => return Do::Udiv { d: high, n, m },
        _ if bad(low) || low == high => return UNDEFINED,
        _ => {}
    }
    let (second_bit, low_bit) = (op2 & 2 != 0, op2 & 1 != 0);
    match (op1, op2) {
        (0, 0) => Do::LongMultiply { kind: Long::Smull, low, high, n, m },
        (2, 0) => Do::LongMultiply { kind: Long::Umull, low, high, n, m },
        (4, 0) => Do::LongMultiply { kind: Long::Smlal, low, high, n, m },
        (6, 0) => Do::LongMultiply { kind: Long::Umlal, low, high, n, m },
        (6, 6) => Do::LongMultiply { kind: Long::Umaal, low, high, n, m },
        (4, 8..=11) => Do::SmlalHalf { low, high, n, m, n_top: second_bit, m_top: low_bit },
        (4 | 5, 12 | 13) => Do::SmlalDual { low, high, n, m, subtract: op1 == 5, exchange: low_bit },
        _ => UNDEFINED,
    }
}
