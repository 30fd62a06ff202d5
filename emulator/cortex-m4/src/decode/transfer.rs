//! The decoder of 32-bit loads and stores, ARM ARM A5.3.5 to A5.3.10.

use super::{UNDEFINED, bad, field};
use crate::op::{Do, Format, Index};

/// Decodes load/store multiple, ARM ARM A5.3.5.
pub(super) fn multiple(first: u16, list: u16) -> Do {
    let n = field(first, 0, 4);
    let (write_back, load) = (first & 0x20 != 0, first & 0x10 != 0);
    let down = match field(first, 7, 2) {
        1 => false,
        2 => true,
        _ => return UNDEFINED,
    };
    let both = list & 0xC000 == 0xC000;
    let base_listed = write_back && list & (1 << n) != 0;
    let wrong = n == 15 || list.count_ones() < 2 || list & 0x2000 != 0 || base_listed;
    if wrong || (load && both) || (!load && list & 0x8000 != 0) {
        return UNDEFINED;
    }
    if load { Do::Ldm { n, list, write_back, down } } else { Do::Stm { n, list, write_back, down } }
}

/// Decodes load/store dual and exclusive and table branches, ARM ARM A5.3.6.
pub(super) fn dual_exclusive(first: u16, second: u16) -> Do {
    let (n, t, t2, d) = (field(first, 0, 4), field(second, 12, 4), field(second, 8, 4), field(second, 0, 4));
    let imm = (second & 0xFF) << 2;
    match (field(first, 7, 2), field(first, 4, 2)) {
        (0, 0) => {
            if bad(t2) || bad(t) || n == 15 || t2 == n || t2 == t {
                return UNDEFINED;
            }
            Do::Strex { format: Format::Word, d: t2, t, n, imm }
        }
        (0, 1) => {
            if bad(t) || n == 15 || t2 != 15 {
                return UNDEFINED;
            }
            Do::Ldrex { format: Format::Word, t, n, imm }
        }
        (1, 0) => {
            let format = match field(second, 4, 4) {
                4 => Format::Byte,
                5 => Format::Half,
                _ => return UNDEFINED,
            };
            if t2 != 15 || bad(d) || bad(t) || n == 15 || d == n || d == t {
                return UNDEFINED;
            }
            Do::Strex { format, d, t, n, imm: 0 }
        }
        (1, 1) => match field(second, 4, 4) {
            op @ (0 | 1) => {
                if n == 13 || bad(d) || t != 15 || t2 != 0 {
                    return UNDEFINED;
                }
                Do::TableBranch { n, m: d, half: op == 1 }
            }
            op @ (4 | 5) => {
                if bad(t) || n == 15 || t2 != 15 || d != 15 {
                    return UNDEFINED;
                }
                Do::Ldrex { format: if op == 4 { Format::Byte } else { Format::Half }, t, n, imm: 0 }
            }
            _ => UNDEFINED,
        },
        _ => dual(first, second),
    }
}

fn dual(first: u16, second: u16) -> Do {
    let (n, t, t2) = (field(first, 0, 4), field(second, 12, 4), field(second, 8, 4));
    let (pre, up, write_back, load) = (first & 0x100 != 0, first & 0x80 != 0, first & 0x20 != 0, first & 0x10 != 0);
    let offset = u32::from(second & 0xFF) << 2;
    let imm = if up { offset } else { offset.wrapping_neg() };
    let index = match (pre, write_back) {
        (true, false) => Index::Offset,
        (true, true) => Index::Pre,
        _ => Index::Post,
    };
    let listed = write_back && (n == t || n == t2);
    if bad(t) || bad(t2) || listed || (n == 15 && (write_back || !load)) || (load && t == t2) {
        return UNDEFINED;
    }
    if load { Do::Ldrd { index, t, t2, n, imm } } else { Do::Strd { index, t, t2, n, imm } }
}

/// Decodes loads and stores of one register and memory hints, ARM ARM A5.3.7 to A5.3.10.
pub(super) fn single(address: u32, first: u16, second: u16) -> Do {
    let (n, t) = (field(first, 0, 4), field(second, 12, 4));
    let (signed, load) = (first & 0x100 != 0, first & 0x10 != 0);
    let format = match (field(first, 5, 2), signed) {
        (0, false) => Format::Byte,
        (0, true) => Format::SignedByte,
        (1, false) => Format::Half,
        (1, true) => Format::SignedHalf,
        (2, false) => Format::Word,
        _ => return UNDEFINED,
    };
    if !load && (signed || n == 15) {
        return UNDEFINED;
    }
    let word = format == Format::Word;
    // PLD, PLI and the unallocated memory hints do nothing, since the core has no cache.
    let hint = load && t == 15 && !word;
    let target_bad = if word { t == 15 && !load } else { bad(t) };
    if n == 15 {
        let base = address.wrapping_add(4) & !3;
        let offset = u32::from(second & 0xFFF);
        let address = if first & 0x80 != 0 { base.wrapping_add(offset) } else { base.wrapping_sub(offset) };
        return if hint {
            Do::Nop
        } else if target_bad {
            UNDEFINED
        } else if word && t < 13 {
            Do::LdrLiteral { t, address }
        } else {
            Do::LoadLiteral { format, t, address }
        };
    }
    if first & 0x80 != 0 {
        return if hint {
            Do::Nop
        } else if target_bad {
            UNDEFINED
        } else {
            immediate(load, format, Index::Offset, t, n, u32::from(second & 0xFFF))
        };
    }
    if second & 0x800 == 0 {
        let (m, amount) = (field(second, 0, 4), field(second, 4, 2));
        return if second & 0x7C0 != 0 || bad(m) || (target_bad && !hint) {
            UNDEFINED
        } else if hint {
            Do::Nop
        } else {
            register(load, format, t, n, m, amount)
        };
    }
    let (pre, up, write_back) = (second & 0x400 != 0, second & 0x200 != 0, second & 0x100 != 0);
    let offset = u32::from(second & 0xFF);
    let imm = if up { offset } else { offset.wrapping_neg() };
    match (pre, up, write_back) {
        (true, true, false) if bad(t) => UNDEFINED,
        (true, true, false) => immediate(load, format, Index::Unprivileged, t, n, imm),
        (true, false, false) if hint => Do::Nop,
        (true, false, false) if target_bad => UNDEFINED,
        (true, false, false) => immediate(load, format, Index::Offset, t, n, imm),
        (false, _, false) => UNDEFINED,
        _ if target_bad || n == t => UNDEFINED,
        (true, _, true) => immediate(load, format, Index::Pre, t, n, imm),
        (false, _, true) => immediate(load, format, Index::Post, t, n, imm),
    }
}

fn immediate(load: bool, format: Format, index: Index, t: u8, n: u8, imm: u32) -> Do {
    if index == Index::Offset && t < 13 {
        return match (load, format) {
            (true, Format::Word) => Do::LdrImm { t, n, imm },
            (true, Format::Byte) => Do::LdrbImm { t, n, imm },
            (true, Format::Half) => Do::LdrhImm { t, n, imm },
            (false, Format::Word) => Do::StrImm { t, n, imm },
            (false, Format::Byte) => Do::StrbImm { t, n, imm },
            (false, Format::Half) => Do::StrhImm { t, n, imm },
            _ => Do::Load { format, index, t, n, imm },
        };
    }
    if load { Do::Load { format, index, t, n, imm } } else { Do::Store { format, index, t, n, imm } }
}

fn register(load: bool, format: Format, t: u8, n: u8, m: u8, amount: u8) -> Do {
    if t < 13 {
        match (load, format) {
            (true, Format::Word) => return Do::LdrReg { t, n, m, amount },
            (true, Format::Byte) => return Do::LdrbReg { t, n, m, amount },
            (false, Format::Word) => return Do::StrReg { t, n, m, amount },
            (false, Format::Byte) => return Do::StrbReg { t, n, m, amount },
            _ => {}
        }
    }
    if load { Do::LoadReg { format, t, n, m, amount } } else { Do::StoreReg { format, t, n, m, amount } }
}
