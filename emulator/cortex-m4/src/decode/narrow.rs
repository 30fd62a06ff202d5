//! The decoder of 16-bit instructions, ARM ARM A5.2.

use super::{UNDEFINED, field};
use crate::Fault;
use crate::op::{Alu, Block, Carry, Do, Extend, Format, Shift, Unary};

pub(super) fn decode(address: u32, h: u16) -> Do {
    match h >> 10 {
        0x00..=0x0F => shift_add_move_compare(h),
        0x10 => data_processing(h),
        0x11 => special_data(address, h),
        0x12 | 0x13 => {
            let base = address.wrapping_add(4) & !3;
            Do::LdrLiteral { t: field(h, 8, 3), address: base.wrapping_add(u32::from(h & 0xFF) << 2) }
        }
        0x14..=0x17 => load_store_register(h),
        0x18..=0x27 => load_store_immediate(h),
        0x28 | 0x29 => {
            let base = address.wrapping_add(4) & !3;
            Do::MovImm { d: field(h, 8, 3), imm: base.wrapping_add(u32::from(h & 0xFF) << 2) }
        }
        0x2A | 0x2B => Do::AddImm { d: field(h, 8, 3), n: 13, imm: u32::from(h & 0xFF) << 2 },
        0x2C..=0x2F => miscellaneous(address, h),
        0x30..=0x33 => multiple(h),
        0x34..=0x37 => conditional_branch(address, h),
        0x38 | 0x39 => Do::B { target: address.wrapping_add(4).wrapping_add(signed(h, 11) << 1) },
        _ => UNDEFINED,
    }
}

fn signed(h: u16, bits: u32) -> u32 {
    let up = 32 - bits;
    ((u32::from(h) << up) as i32 >> up) as u32
}

/// The behaviour of a 16-bit instruction in an IT block. The instructions of ARM ARM A5.2.1 and A5.2.2, except for the
/// compares, set the flags outside of IT blocks only.
pub(super) fn block(h: u16, what: Do) -> Block {
    match what {
        Do::CmpImm { .. } | Do::CmpReg { .. } | Do::AluShift { alu: Alu::Tst | Alu::Cmn, .. } => Block::Same,
        _ if h < 0x4400 => Block::KeepsFlags,
        _ => super::block(what),
    }
}

fn shift_add_move_compare(h: u16) -> Do {
    let (low, mid, high, amount) = (field(h, 0, 3), field(h, 3, 3), field(h, 6, 3), field(h, 6, 5));
    let (wide, imm) = (field(h, 8, 3), u32::from(h & 0xFF));
    match h >> 11 {
        // LSLS #0 is MOVS, which leaves the carry as it is.
        0 => Do::LslsImm { d: low, m: mid, amount },
        1 if amount == 0 => shifted(Alu::Mov, low, 0, mid, Shift::Lsr, 32),
        1 => Do::LsrsImm { d: low, m: mid, amount },
        2 => shifted(Alu::Mov, low, 0, mid, Shift::Asr, if amount == 0 { 32 } else { amount }),
        3 => match field(h, 9, 2) {
            0 => Do::AddsReg { d: low, n: mid, m: high },
            1 => Do::SubsReg { d: low, n: mid, m: high },
            2 => Do::AddsImm { d: low, n: mid, imm: u32::from(high) },
            _ => Do::SubsImm { d: low, n: mid, imm: u32::from(high) },
        },
        4 => Do::MovsImm { d: wide, imm },
        5 => Do::CmpImm { n: wide, imm },
        6 => Do::AddsImm { d: wide, n: wide, imm },
        _ => Do::SubsImm { d: wide, n: wide, imm },
    }
}

fn shifted(alu: Alu, d: u8, n: u8, m: u8, shift: Shift, amount: u8) -> Do {
    Do::AluShift { alu, s: true, d, n, m, shift, amount }
}

/// Decodes data processing, ARM ARM A5.2.2.
fn data_processing(h: u16) -> Do {
    let (d, m) = (field(h, 0, 3), field(h, 3, 3));
    let plain = |alu| shifted(alu, d, d, m, Shift::Lsl, 0);
    let by_register = |shift| Do::ShiftReg { shift, s: true, d, n: d, m };
    match field(h, 6, 4) {
        0 => Do::AndsReg { d, n: d, m },
        1 => Do::EorsReg { d, n: d, m },
        2 => by_register(Shift::Lsl),
        3 => by_register(Shift::Lsr),
        4 => by_register(Shift::Asr),
        5 => plain(Alu::Adc),
        6 => plain(Alu::Sbc),
        7 => by_register(Shift::Ror),
        8 => plain(Alu::Tst),
        9 => Do::AluImm { alu: Alu::Rsb, s: true, d, n: m, carry: Carry::Same, imm: 0 },
        10 => Do::CmpReg { n: d, m },
        11 => plain(Alu::Cmn),
        12 => Do::OrrsReg { d, n: d, m },
        13 => Do::Muls { d, n: d, m },
        14 => plain(Alu::Bic),
        _ => plain(Alu::Mvn),
    }
}

/// Decodes special data instructions and BX, ARM ARM A5.2.3.
fn special_data(address: u32, h: u16) -> Do {
    let (d, m) = (field(h, 0, 3) | field(h, 7, 1) << 3, field(h, 3, 4));
    let pc = address.wrapping_add(4);
    match field(h, 8, 2) {
        0 => match (d, m) {
            (15, 15) => UNDEFINED,
            (15, _) => Do::AddToPc { m },
            (13, _) => Do::AluShift { alu: Alu::Add, s: false, d, n: d, m, shift: Shift::Lsl, amount: 0 },
            (_, 15) => Do::AddImm { d, n: d, imm: pc },
            _ => Do::AddReg { d, n: d, m },
        },
        // CMP of two low registers in this form is UNPREDICTABLE (ARM ARM A7.7.28). Silicon compares them, and LLVM
        // relies on this in the atomic exchange of unoptimised code.
        1 if d == 15 || m == 15 => UNDEFINED,
        1 => Do::CmpReg { n: d, m },
        2 => match (d, m) {
            (15, 15) => Do::B { target: pc },
            (15, _) => Do::MovToPc { m },
            (13, 15) => Do::MovImm { d, imm: pc & !3 },
            (13, _) => Do::AluShift { alu: Alu::Mov, s: false, d, n: 0, m, shift: Shift::Lsl, amount: 0 },
            (_, 15) => Do::MovImm { d, imm: pc },
            _ => Do::MovReg { d, m },
        },
        _ if h & 7 != 0 => UNDEFINED,
        // BX PC would switch to ARM state, since bit 0 of its target is clear, so it faults with INVSTATE. BLX PC is
        // unpredictable.
        _ => match (field(h, 7, 1), m) {
            (0, _) => Do::Bx { m },
            (_, 15) => UNDEFINED,
            _ => Do::Blx { m },
        },
    }
}

fn load_store_register(h: u16) -> Do {
    let (t, n, m) = (field(h, 0, 3), field(h, 3, 3), field(h, 6, 3));
    let amount = 0;
    match field(h, 9, 3) {
        0 => Do::StrReg { t, n, m, amount },
        1 => Do::StoreReg { format: Format::Half, t, n, m, amount },
        2 => Do::StrbReg { t, n, m, amount },
        3 => Do::LoadReg { format: Format::SignedByte, t, n, m, amount },
        4 => Do::LdrReg { t, n, m, amount },
        5 => Do::LoadReg { format: Format::Half, t, n, m, amount },
        6 => Do::LdrbReg { t, n, m, amount },
        _ => Do::LoadReg { format: Format::SignedHalf, t, n, m, amount },
    }
}

fn load_store_immediate(h: u16) -> Do {
    let (t, n, imm) = (field(h, 0, 3), field(h, 3, 3), u32::from(field(h, 6, 5)));
    let (wide, stack) = (field(h, 8, 3), u32::from(h & 0xFF) << 2);
    match h >> 11 {
        0x0C => Do::StrImm { t, n, imm: imm << 2 },
        0x0D => Do::LdrImm { t, n, imm: imm << 2 },
        0x0E => Do::StrbImm { t, n, imm },
        0x0F => Do::LdrbImm { t, n, imm },
        0x10 => Do::StrhImm { t, n, imm: imm << 1 },
        0x11 => Do::LdrhImm { t, n, imm: imm << 1 },
        0x12 => Do::StrImm { t: wide, n: 13, imm: stack },
        _ => Do::LdrImm { t: wide, n: 13, imm: stack },
    }
}

/// Decodes the miscellaneous instructions, ARM ARM A5.2.5.
fn miscellaneous(address: u32, h: u16) -> Do {
    let (d, m) = (field(h, 0, 3), field(h, 3, 3));
    let rotation = 0;
    match field(h, 8, 4) {
        0 => {
            let imm = u32::from(h & 0x7F) << 2;
            if h & 0x80 == 0 { Do::AddImm { d: 13, n: 13, imm } } else { Do::SubImm { d: 13, n: 13, imm } }
        }
        1 | 3 | 9 | 11 => {
            let offset = u32::from(field(h, 3, 5)) << 1 | u32::from(field(h, 9, 1)) << 6;
            let target = address.wrapping_add(4).wrapping_add(offset);
            if h & 0x800 == 0 { Do::Cbz { n: d, target } } else { Do::Cbnz { n: d, target } }
        }
        2 => match field(h, 6, 2) {
            0 => Do::Extend { kind: Extend::SignedHalf, d, n: 15, m, rotation },
            1 => Do::Extend { kind: Extend::SignedByte, d, n: 15, m, rotation },
            2 => Do::Uxth { d, m },
            _ => Do::Uxtb { d, m },
        },
        4 | 5 => {
            let list = h & 0xFF | (h & 0x100) << 6;
            if list == 0 { UNDEFINED } else { Do::Stm { n: 13, list, write_back: true, down: true } }
        }
        // Bits 3 and 2 of CPS should be zero.
        6 if h & 0xFFE0 == 0xB660 && h & 0xC == 0 && h & 3 != 0 => {
            Do::Cps { disable: h & 0x10 != 0, primask: h & 2 != 0, faultmask: h & 1 != 0 }
        }
        10 => match field(h, 6, 2) {
            0 => Do::Unary { kind: Unary::Rev, d, m },
            1 => Do::Unary { kind: Unary::Rev16, d, m },
            3 => Do::Unary { kind: Unary::Revsh, d, m },
            _ => UNDEFINED,
        },
        12 | 13 => {
            let list = h & 0xFF | (h & 0x100) << 7;
            if list == 0 { UNDEFINED } else { Do::Ldm { n: 13, list, write_back: true, down: false } }
        }
        14 if h & 0xFF == 0xAB => Do::HostCall,
        14 => Do::Bkpt,
        15 => if_then_and_hints(h),
        _ => UNDEFINED,
    }
}

/// Decodes IT and the hints, ARM ARM A5.2.5 and A7.7.38.
fn if_then_and_hints(h: u16) -> Do {
    let (condition, mask) = (field(h, 4, 4), field(h, 0, 4));
    if mask == 0 {
        return match condition {
            2 => Do::Wfe,
            3 => Do::Wfi,
            4 => Do::Sev,
            // NOP and YIELD do nothing, and unallocated hints behave like NOP.
            _ => Do::Nop,
        };
    }
    // An IT block with the condition AL cannot have an "else".
    if condition == 15 || condition == 14 && mask.count_ones() != 1 {
        return UNDEFINED;
    }
    Do::It { state: (h & 0xFF) as u8 }
}

fn multiple(h: u16) -> Do {
    let (n, list) = (field(h, 8, 3), h & 0xFF);
    if list == 0 {
        return UNDEFINED;
    }
    if h & 0x800 == 0 {
        // STM stores an unknown value for a base that is in the list but not first.
        if list & (1 << n) != 0 && list.trailing_zeros() != u32::from(n) {
            return UNDEFINED;
        }
        Do::Stm { n, list, write_back: true, down: false }
    } else {
        Do::Ldm { n, list, write_back: list & (1 << n) == 0, down: false }
    }
}

fn conditional_branch(address: u32, h: u16) -> Do {
    match field(h, 8, 4) {
        14 => Do::Fault(Fault::Undefined),
        15 => Do::Svc,
        condition => super::branch_if(condition, address.wrapping_add(4).wrapping_add(signed(h, 8) << 1)),
    }
}
