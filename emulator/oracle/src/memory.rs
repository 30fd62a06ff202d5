//! Cases with loads and stores of every form, ARM ARM A5.2.4, A5.3.5 to A5.3.10, A6.5, A6.6.
//!
//! Every access has its own base register, so that its address is in the memory window.

use crate::{
    image::{Case, WINDOW, WINDOW_WORDS},
    random::Random,
    template::Instruction,
};

/// The kind of a case's memory accesses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Accesses of one register.
    Single,
    /// Accesses of several registers: LDM, STM, PUSH, POP, LDRD, STRD.
    Multiple,
    /// Exclusive accesses: LDREX and STREX.
    Exclusive,
    /// Accesses to the window's bit-band alias.
    BitBand,
    /// FP accesses: VLDR, VSTR, VLDM, VSTM, VPUSH, VPOP.
    Floating,
}

struct Registers {
    /// The registers for addresses and indices. No instruction of the case loads them.
    kept: Vec<u32>,
    data: Vec<u32>,
}

/// Appends accesses to `case`, and sets the registers that hold their addresses.
pub(crate) fn append(case: &mut Case, kind: Kind, random: &mut Random) {
    let mut low: Vec<u32> = (0..8).collect();
    let mut high: Vec<u32> = (8..13).collect();
    random.shuffle(&mut low);
    random.shuffle(&mut high);
    // Addresses and indices are in four low and two high registers.
    let mut registers =
        Registers { kept: [&high[..2], &low[..4]].concat(), data: [&low[4..], &high[2..], &[14][..]].concat() };
    let count = 1 + random.below(3);
    for _ in 0..count {
        let Some(base) = registers.kept.pop() else { return };
        match kind {
            Kind::Single | Kind::BitBand => single(case, kind == Kind::BitBand, base, &mut registers, random),
            Kind::Multiple => multiple(case, base, &registers, random),
            Kind::Exclusive => exclusive(case, base, &registers, random),
            Kind::Floating => floating(case, base, random),
        }
    }
}

/// An address for `bytes` inside the window, usually a multiple of `align`.
fn target(bytes: u32, align: u32, random: &mut Random) -> u32 {
    let offset = random.below(WINDOW_WORDS as u32 * 4 - bytes + 1);
    WINDOW + if random.once_in(4) { offset } else { offset & !(align - 1) }
}

fn single(case: &mut Case, bit_band: bool, base: u32, registers: &mut Registers, random: &mut Random) {
    let mut size = random.below(3);
    let load = random.once_in(2);
    let signed = load && size < 2 && random.once_in(2);
    let bytes = 1 << size;
    let address = if bit_band {
        let alias = 0x2200_0000 + (WINDOW - 0x2000_0000) * 32;
        // The address in the alias is aligned, so no access covers the alias words of two bits. Silicon would split
        // such an access in two, and QEMU would make one access for each word.
        (alias + random.below(WINDOW_WORDS as u32 * 32) * 4 + random.below(4)) & !(bytes - 1)
    } else {
        target(4, bytes, random)
    };
    let t = random.pick(&registers.data);
    let low_t = random.pick(&registers.data[..4]);
    let base_is_low = base < 8;
    let mut code = Vec::new();
    let (l, s) = (u32::from(load), u32::from(signed));
    match random.below(if bit_band { 6 } else { 9 }) {
        // The instruction has 16 bits and an immediate.
        0 if base_is_low && !signed => {
            let imm5 = random.below(32);
            set(case, base, address.wrapping_sub(imm5 << size));
            let op = [0b01110, 0b10000, 0b01100][size as usize] | l;
            Instruction::Narrow((op << 11 | imm5 << 6 | base << 3 | low_t) as u16).append(&mut code);
        }
        // The instruction has 16 bits and a register offset.
        1 | 2 if base_is_low && registers.kept.last().is_some_and(|&r| r < 8) => {
            let index = registers.kept.pop().unwrap_or_default();
            let offset = random.word();
            set(case, index, offset);
            set(case, base, address.wrapping_sub(offset));
            let op = match (load, signed, size) {
                (false, _, 2) => 0,
                (false, _, 1) => 1,
                (false, _, _) => 2,
                (true, true, 0) => 3,
                (true, false, 2) => 4,
                (true, false, 1) => 5,
                (true, false, _) => 6,
                (true, true, _) => 7,
            };
            Instruction::Narrow((0x5000 | op << 9 | index << 6 | base << 3 | low_t) as u16).append(&mut code);
        }
        // The instruction has 32 bits and a 12-bit immediate.
        3 => {
            let imm12 = random.below(4096);
            set(case, base, address.wrapping_sub(imm12));
            let op = 0xF880_0000 | s << 24 | size << 21 | l << 20 | base << 16 | t << 12 | imm12;
            Instruction::Wide(op).append(&mut code);
        }
        // The instruction has 32 bits and an 8-bit immediate: offset, pre-indexed, post-indexed or unprivileged.
        4 | 6 => {
            let imm8 = random.below(256);
            let puw = random.pick(&[0b100, 0b101, 0b111, 0b001, 0b011, 0b110]);
            let offset = if puw & 0b010 != 0 { imm8 } else { imm8.wrapping_neg() };
            set(case, base, if puw & 0b100 != 0 { address.wrapping_sub(offset) } else { address });
            let op = 0xF800_0800 | s << 24 | size << 21 | l << 20 | base << 16 | t << 12 | puw << 8 | imm8;
            Instruction::Wide(op).append(&mut code);
        }
        // The instruction has 32 bits and a register offset.
        5 if registers.kept.len() > 1 => {
            let index = registers.kept.remove(0);
            let (offset, shift) = (random.word(), random.below(4));
            set(case, index, offset);
            set(case, base, address.wrapping_sub(offset << shift));
            let op = 0xF800_0000 | s << 24 | size << 21 | l << 20 | base << 16 | t << 12 | shift << 4 | index;
            Instruction::Wide(op).append(&mut code);
        }
        // The access is relative to SP, or is a PUSH or POP of one register.
        7 => {
            case.sp = WINDOW + 4 * random.below(WINDOW_WORDS as u32);
            let imm8 = random.below(32);
            match random.below(3) {
                0 => Instruction::Narrow((0x9000 | l << 11 | low_t << 8 | imm8) as u16),
                1 => Instruction::Wide(0xF84D_0D04 | t << 12),
                _ => Instruction::Wide(0xF85D_0B04 | t << 12),
            }
            .append(&mut code);
            size = 2;
        }
        // The access is a literal load, which reads the code around it.
        _ => {
            let imm12 = random.below(400);
            match random.below(3) {
                0 => Instruction::Narrow((0x4800 | low_t << 8 | imm12 & 0xFF) as u16),
                _ => {
                    let (u, s) = (random.below(2), if size < 2 { s } else { 0 });
                    Instruction::Wide(0xF81F_0000 | s << 24 | u << 23 | size << 21 | t << 12 | imm12)
                }
            }
            .append(&mut code);
        }
    }
    let _ = size;
    case.code.extend(code);
}

fn set(case: &mut Case, register: u32, value: u32) {
    match register {
        13 => case.sp = value & !3,
        14 => case.lr = value,
        _ => case.r[register as usize] = value,
    }
}

fn multiple(case: &mut Case, base: u32, registers: &Registers, random: &mut Random) {
    let load = random.once_in(2);
    let l = u32::from(load);
    let list = |random: &mut Random, low: bool, least: u32| loop {
        let bits = random.bits() & random.bits() | random.bits() & random.bits() & random.bits();
        let allowed = registers.data.iter().filter(|&&r| !low || r < 8).fold(0, |mask, &r| mask | 1 << r);
        if (bits & allowed).count_ones() >= least {
            break bits & allowed;
        }
    };
    let mut code = Vec::new();
    let middle = WINDOW + 48 + 4 * random.below(8);
    match random.below(6) {
        0 if base < 8 => {
            set(case, base, middle);
            let mut list = list(random, true, 1);
            // A load may have its base anywhere in the list. In a store the result is defined only if the base is the
            // lowest register.
            if random.once_in(4) && (load || list.trailing_zeros() > base) {
                list |= 1 << base;
            }
            Instruction::Narrow((0xC000 | l << 11 | base << 8 | list) as u16).append(&mut code);
        }
        1 => {
            case.sp = middle;
            let list = list(random, true, 1);
            let m = random.below(2) & u32::from(!load);
            Instruction::Narrow((if load { 0xBC00 } else { 0xB400 } | m << 8 | list) as u16).append(&mut code);
        }
        2 | 3 => {
            // In some cases the address is unaligned, which faults with UFSR.UNALIGNED.
            let n = if random.once_in(3) { 13 } else { base };
            set(case, n, middle + if random.once_in(16) { 1 + random.below(3) } else { 0 });
            let mode = random.pick(&[0xE880_0000_u32, 0xE900_0000]);
            let w = random.below(2);
            let list = list(random, false, 2);
            Instruction::Wide(mode | w << 21 | l << 20 | n << 16 | list).append(&mut code);
        }
        _ => {
            let imm8 = random.below(256);
            let puw = random.pick(&[0b100, 0b110, 0b101, 0b111, 0b001, 0b011]);
            let offset = if puw & 0b010 != 0 { imm8 * 4 } else { (imm8 * 4).wrapping_neg() };
            let address = WINDOW + 4 * random.below(WINDOW_WORDS as u32 - 1) + u32::from(random.once_in(16));
            set(case, base, if puw & 0b100 != 0 { address.wrapping_sub(offset) } else { address });
            let (t, t2) = loop {
                let pair = (random.pick(&registers.data), random.pick(&registers.data));
                if pair.0 != pair.1 {
                    break pair;
                }
            };
            let (p, u, w) = (puw >> 2, (puw >> 1) & 1, puw & 1);
            let op = 0xE840_0000 | p << 24 | u << 23 | w << 21 | l << 20 | base << 16 | t << 12 | t2 << 8 | imm8;
            Instruction::Wide(op).append(&mut code);
        }
    }
    case.code.extend(code);
}

/// Appends a pair of exclusive accesses of the same size at the same address, or a store alone. Other combinations are
/// not compared: the M4's monitor holds no address (TRM 5.8 / 3.8), and QEMU's monitor compares address and value.
fn exclusive(case: &mut Case, base: u32, registers: &Registers, random: &mut Random) {
    let size = random.below(3);
    let mut address = target(4, 1 << size, random) & !((1 << size) - 1);
    // Only a load may be unaligned. A store alone would fault by ExclusiveMonitorsPass (ARM ARM B2.3.7), but on QEMU it
    // fails without a fault.
    let paired = !random.once_in(4);
    if size > 0 && paired && random.once_in(16) {
        address += 1;
    }
    let imm8 = if size == 2 { random.below(256) } else { 0 };
    set(case, base, address.wrapping_sub(imm8 * 4));
    let mut data = registers.data.clone();
    random.shuffle(&mut data);
    let (loaded, stored, status) = (data[0], data[1], data[2]);
    let load = [0xE8D0_0F4F, 0xE8D0_0F5F, 0xE850_0F00 | imm8][size as usize] | base << 16 | loaded << 12;
    let store = match size {
        2 => 0xE840_0000 | base << 16 | stored << 12 | status << 8 | imm8,
        _ => [0xE8C0_0F40, 0xE8C0_0F50][size as usize] | base << 16 | stored << 12 | status,
    };
    let mut code = Vec::new();
    if paired {
        Instruction::Wide(load).append(&mut code);
        if random.once_in(4) {
            Instruction::Wide(0xF3BF_8F2F).append(&mut code); // CLREX
        }
    } else {
        Instruction::Wide(0xF3BF_8F2F).append(&mut code);
    }
    Instruction::Wide(store).append(&mut code);
    // If the store is repeated, the repeated one fails, because the first one has cleared the monitor.
    if random.once_in(3) {
        Instruction::Wide(store).append(&mut code);
    }
    case.code.extend(code);
}

fn floating(case: &mut Case, base: u32, random: &mut Random) {
    let l = random.below(2);
    let double = random.below(2);
    // The number of an s register is Vd:D, that of a d register D:Vd.
    let first = random.below(if double == 1 { 16 } else { 32 });
    let (d, vd) = if double == 1 { (0, first) } else { (first & 1, first >> 1) };
    let common = 0xEC00_0A00 | d << 22 | l << 20 | vd << 12 | double << 8;
    let mut code = Vec::new();
    let n = if random.once_in(4) { 13 } else { base };
    let stray = if random.once_in(16) && n != 13 { 1 + random.below(3) } else { 0 };
    if random.once_in(2) {
        let imm8 = random.below(256);
        let u = random.below(2);
        let address = WINDOW + 4 * random.below(WINDOW_WORDS as u32 - 1) + stray;
        if l == 1 && random.once_in(4) {
            Instruction::Wide(common | 0x010F_0000 | u << 23 | random.below(32)).append(&mut code);
        } else if n == 13 {
            case.sp = address;
            Instruction::Wide(common | 0x0180_0000 | n << 16 | random.below(8)).append(&mut code);
        } else {
            set(case, n, if u == 1 { address.wrapping_sub(imm8 * 4) } else { address.wrapping_add(imm8 * 4) });
            Instruction::Wide(common | 0x0100_0000 | u << 23 | n << 16 | imm8).append(&mut code);
        }
    } else {
        let most = if double == 1 { 16 - first } else { 32 - first };
        let registers = 1 + random.below(most.min(if double == 1 { 8 } else { 16 }));
        set(case, n, WINDOW + 64 + stray);
        // The modes are IA, IA with write-back, and DB with write-back.
        let mode = random.pick(&[0x0080_0000, 0x00A0_0000, 0x0120_0000]);
        let words = if double == 1 { 2 * registers } else { registers };
        Instruction::Wide(common | mode | n << 16 | words).append(&mut code);
    }
    case.code.extend(code);
}
