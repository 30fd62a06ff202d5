//! Cases with branches and IT blocks, ARM ARM A5.2.5, A5.2.6, A5.3.4, A7.7.38, and cases with faults of single
//! instructions.

use crate::{
    image::{Case, WINDOW},
    integer,
    random::Random,
    template::{Instruction, instance},
    thumb::{Code, branch_wide},
};

pub(crate) fn it_block(case: &mut Case, random: &mut Random) {
    let condition = random.below(14);
    let count = 1 + random.below(4);
    // The mask has, from the highest bit down, one bit (then or else) for each instruction but the first, and then the
    // stop bit.
    let mask = ((random.bits() & 0xF) >> (5 - count) << 1 | 1) << (4 - count) & 0xF;
    Instruction::Narrow((0xBF00 | condition << 4 | mask) as u16).append(&mut case.code);
    for _ in 0..count {
        let table = random.pick(&[integer::NARROW, integer::NARROW, integer::SHIFTED, integer::IMMEDIATE]);
        instance(&random.pick(table), random, &DATA).append(&mut case.code);
    }
}

/// The registers for data. In these cases they never hold an address.
const DATA: [u32; 8] = [0, 1, 2, 3, 4, 8, 9, 12];

fn filler(code: &mut Code, random: &mut Random) {
    for _ in 0..1 + random.below(2) {
        let table = random.pick(&[integer::IMMEDIATE, integer::SHIFTED, integer::FIELDS]);
        let mut halves = Vec::new();
        instance(&random.pick(table), random, &DATA).append(&mut halves);
        code.halves.extend(halves);
    }
}

pub(crate) fn branch(case: &mut Case, address: u32, random: &mut Random) {
    let mut code = Code::at(address);
    if random.once_in(2) {
        code.narrow(0xBF00); // NOP, so that branches are at either half of a word
    }
    if random.once_in(2) {
        filler(&mut code, random);
    }
    let mut skipped = Code::at(0);
    filler(&mut skipped, random);
    let length = 2 * skipped.halves.len() as u32;
    let condition = random.below(14);
    let register = 5 + random.below(3);
    let set = |case: &mut Case, value: u32| case.r[register as usize] = value;
    match random.below(16) {
        0 | 1 => {
            code.narrow(0xD000 | condition << 8 | ((length - 2) / 2));
        }
        2 => {
            code.wide(0xF000_8000 | condition << 22 | ((length) / 2));
        }
        3 | 4 => {
            set(case, random.below(3));
            code.narrow(0xB100 | random.below(2) << 11 | ((length - 2) / 2) << 3 | register);
        }
        5 => {
            code.narrow(0xE000 | ((length - 2) / 2));
        }
        6 => {
            code.wide(branch_wide(length) | 0x9000);
        }
        7 => {
            code.wide(branch_wide(length) | 0xD000);
        }
        8 => {
            // Some BX and BLX have no Thumb bit, so they fault at the target with UFSR.INVSTATE (ARM ARM B1.5.14). Only
            // targets at multiples of four are used for that, because QEMU reports UFSR.UNALIGNED at others.
            let target = code.here() + 2 + length;
            let thumb = u32::from(target & 2 != 0 || !random.once_in(8));
            set(case, target | thumb);
            code.narrow(0x4700 | random.below(2) << 7 | register << 3);
        }
        9 => {
            set(case, (code.here() + 2 + length) | random.below(2));
            code.narrow(0x4687 | register << 3);
        }
        10 => {
            set(case, (length - 2) | random.below(2));
            code.narrow(0x4487 | register << 3);
        }
        11 => {
            // TBB and TBH have four table entries after the instruction.
            let (wide, index) = (random.below(2), random.below(4));
            set(case, index);
            code.wide(0xE8DF_F000 | wide << 4 | register);
            let table = if wide == 1 { 8 } else { 4 };
            let entries = [table / 2, (table + length) / 2, table / 2, (table + length) / 2];
            if wide == 1 {
                code.halves.extend(entries.map(|e| e as u16));
            } else {
                code.halves.extend([0, 2].map(|i| (entries[i] | entries[i + 1] << 8) as u16));
            }
        }
        12 => {
            // POP, LDM or LDR reads pc from the memory window.
            let at = random.below(16);
            let form = random.below(5);
            let size = if form == 0 { 2 } else { 4 };
            case.window[at as usize] = (code.here() + size + length) | 1;
            case.sp = WINDOW + 4 * at;
            set(case, WINDOW + 4 * at);
            match form {
                0 => code.narrow(0xBD00),
                1 => {
                    case.window.swap(at as usize, at as usize + 1);
                    code.wide(0xE890_8001 | register << 16 | random.below(2) << 21)
                }
                2 => code.wide(0xF8D0_F000 | register << 16),
                3 => code.wide(0xF850_FB04 | register << 16),
                _ => {
                    case.window[at as usize + 1] = case.window[at as usize];
                    case.window[at as usize] = random.word();
                    code.wide(0xE8BD_8001)
                }
            };
        }
        13 => {
            code.narrow(0xBF08 | condition << 4);
            match random.below(3) {
                0 => code.narrow(0xE000 | ((length - 2) / 2)),
                1 => code.wide(branch_wide(length) | 0x9000),
                _ => {
                    set(case, (code.here() + 2 + length) | 1);
                    code.narrow(0x4700 | register << 3)
                }
            };
        }
        14 => {
            // The branch goes backwards: SUBS, BNE.
            set(case, 1 + random.below(6));
            let back = code.here();
            filler(&mut code, random);
            code.narrow(0x3801 | register << 8);
            let offset = back.wrapping_sub(code.here() + 4);
            code.narrow(0xD100 | (offset >> 1) & 0xFF);
        }
        _ => {
            // The literal of LDR pc follows the instruction, aligned to a word.
            if !code.here().is_multiple_of(4) {
                code.narrow(0xBF00);
            }
            code.wide(0xF8DF_F000);
            let target = (code.here() + 4 + length) | 1;
            code.halves.extend([target as u16, (target >> 16) as u16]);
        }
    }
    code.halves.extend(&skipped.halves);
    filler(&mut code, random);
    case.code.extend(code.halves);
}

pub(crate) fn fault(case: &mut Case, random: &mut Random) {
    let mut halves = Vec::new();
    instance(&random.pick(integer::IMMEDIATE), random, &DATA).append(&mut halves);
    let it = random.once_in(3);
    let kind = random.below(12);
    // Some cases begin with CPSID i. After this instruction faults and SVC escalate to HardFault.
    if random.once_in(4) {
        halves.push(0xB672);
    }
    if it {
        // If there is a barrier, the IT block has two instructions.
        halves.push((0xBF00 | random.below(14) << 4 | if kind == 3 { 4 } else { 8 }) as u16);
    }
    let (d, n, m) = (random.pick(&DATA), 5 + random.below(2), random.pick(&DATA));
    let wild = random.pick(&[0x6000_0000_u32, 0x7000_0000, 0x9FFF_FFF0, 0xA000_0000, 0xDFFF_FFE0, 0xF000_0000]);
    let faulting = match kind {
        0 => Instruction::Narrow((0xDE00 | random.below(256)) as u16),
        1 => Instruction::Wide(0xF7F0_A000 | random.below(16) << 16 | random.below(4096)),
        2 => Instruction::Narrow((0xDF00 | random.below(256)) as u16),
        3 => {
            case.r[n as usize] = 0;
            case.ccr |= 0x10;
            // QEMU loses register writes before a trapped division in the same block (its division helper is declared
            // not to need the registers). The barrier begins a new block.
            Instruction::Wide(0xF3BF_8F6F).append(&mut halves);
            Instruction::Wide(random.pick(&[0xFB90_F0F0, 0xFBB0_F0F0]) | m << 16 | d << 8 | n)
        }
        4 => {
            case.r[n as usize] = WINDOW + 1 + random.below(3);
            case.ccr |= 8;
            Instruction::Wide(random.pick(&[0xF8D0_0000, 0xF8C0_0000, 0xF8B0_0000, 0xF9B0_0000]) | n << 16 | d << 12)
        }
        5 | 6 => {
            case.r[n as usize] = wild + 4 * random.below(4);
            let op = random.pick(&[0xF8D0_0000_u32, 0xF890_0000, 0xF8B0_0000, 0xF850_0B04, 0xF850_0F04]);
            Instruction::Wide(op | n << 16 | d << 12)
        }
        7 => {
            case.r[n as usize] = WINDOW + 2;
            Instruction::Wide(random.pick(&[0xE890_000F, 0xE880_000F, 0xE9D0_0100, 0xE9C0_0100]) | n << 16)
        }
        8 => {
            case.r[n as usize] = wild;
            Instruction::Wide(random.pick(&[0xE890_000F, 0xE9D0_0100, 0xED90_0A00, 0xECB0_0A04]) | n << 16)
        }
        // These instructions access absent coprocessors.
        9 => Instruction::Wide(0xEE00_0010 | random.pick(&[0_u32, 1, 5, 7, 8, 9, 12, 15]) << 8 | d << 12),
        10 => Instruction::Wide(0xEC90_0000 | random.pick(&[0_u32, 1, 5, 7, 8, 9, 12, 15]) << 8 | n << 16),
        // These instructions are of double precision, which is undefined in FPv4-SP.
        _ => Instruction::Wide(random.pick(&[0xEE30_0B00, 0xEE20_0B00, 0xEEB1_0BC0, 0xEEB7_0AC0, 0xEEBD_0BC0])),
    };
    faulting.append(&mut halves);
    instance(&random.pick(integer::IMMEDIATE), random, &DATA).append(&mut halves);
    case.code.extend(halves);
}

/// Makes a case of interrupts 0 to 7, PendSV and SysTick with random priorities. Some are pending at first and make
/// others pending. BASEPRI is raised at first and lowered in an IT block and after it.
pub(crate) fn interrupt(case: &mut Case, random: &mut Random) {
    // There are only a few values, so that some priorities are equal.
    let levels = [0x00, 0x20, 0x40, 0x60, 0x61, 0x80, 0xA0, 0xE0];
    let priorities = |random: &mut Random| u32::from_le_bytes([0; 4].map(|_| random.pick(&levels)));
    case.window.fill(0);
    // Each exception from 14 to 23 has the word whose index is the exception's number modulo 16.
    for number in [0, 1, 2, 3, 4, 5, 6, 7, 14, 15] {
        if random.once_in(2) {
            let pend = random.bits() & random.bits() & random.bits() & 0x1400_00FF;
            let basepri = if random.once_in(4) { u32::from(random.pick(&levels)) } else { 0 };
            case.window[number] = pend | basepri << 8 | u32::from(random.once_in(4)) << 31;
        }
    }
    case.sp = WINDOW + 0x800 + 4 * random.below(2);
    case.r[0] = 0xE000_E100;
    case.r[1] = priorities(random);
    case.r[2] = priorities(random);
    case.r[3] = priorities(random) & 0xFFFF_0000;
    case.r[4] = 0x05FA_0000 | random.below(8) << 8;
    case.r[5] = u32::from(random.pick(&levels));
    case.r[6] = random.bits() & random.bits() & 0xFF;
    case.r[7] = random.bits() & random.bits() & 0x1400_0000;
    case.r[8] = 0x05FA_0000;
    case.r[9] = 0xFF;
    case.r[10] = u32::from(random.pick(&levels));
    case.r[11] = 0;
    let mut code = Code::at(0);
    code.narrow(0xB672); // CPSID i
    // The five stores write ISER, IPR0, IPR1, SHPR3 and AIRCR.
    code.store(9, 0, 0).store(1, 0, 0x300).store(2, 0, 0x304).store(3, 0, 0xC20).store(4, 0, 0xC0C);
    code.wide(0xF385_8811).store(6, 0, 0x100).store(7, 0, 0xC04); // MSR BASEPRI, r5; ISPR, ICSR
    code.wide(0xF3BF_8F4F).narrow(0xB662).wide(0xF3BF_8F6F); // DSB; CPSIE i; ISB
    // The IT block has four instructions. The first of them may lower BASEPRI.
    let condition = random.below(14);
    code.narrow(0xBF00 | condition << 4 | random.below(8) << 1 | 1);
    code.wide(0xF38A_8811); // MSR BASEPRI, r10
    let mut halves = Vec::new();
    for _ in 0..3 {
        let table = random.pick(&[integer::IMMEDIATE, integer::SHIFTED]);
        instance(&random.pick(table), random, &[12, 14]).append(&mut halves);
    }
    code.halves.extend(halves);
    code.wide(0xF38B_8811).wide(0xF3BF_8F6F).store(8, 0, 0xC0C); // MSR BASEPRI, r11; ISB; AIRCR
    case.code.extend(code.halves);
}
