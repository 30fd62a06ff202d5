//! Patches a program in flash so that it sets a register up wrongly. The caller names the register, not the code that
//! sets it up.
//!
//! A [`Recording`] of the unpatched board has every store to a peripheral register, with instruction, address and
//! value. [`rewrite`] replaces each instruction that stores to a given register by a branch to a stub in free flash.
//! The stub makes the same store with some bits changed, or omits it, and then returns. Finally the program's CRC is
//! corrected, so that the firmware's check of its flash passes. Code that did not run in the recording stays unchanged.
//!
//! | covered | not covered, and the symptom |
//! |---|---|
//! | STR, STRB, STRH, any offset without write-back | STRD, STM, write-back: nothing is stored there, an error |
//! | a 16-bit store: the instruction after it, or the one before, moves into the stub | if neither can: an error |
//! | a 16-bit store alone in an IT block | a longer IT block: an error |

use std::collections::{BTreeMap, BTreeSet};

use cortex_m4::Cost;
use firmware_common::mpu::Access;

use super::record::{Offset, Recording, Store, Stored, halves, is_wide};
use super::seal;
use emulator_node::{Board, Error, Node};

const ALIGNED: u32 = 0x100;
/// Branches to a store are searched for within this distance, bytes, of the store. No task has more code.
const NEAR: u32 = 0x2000;

/// A change of all stores of a program to one register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Change {
    /// The register's address.
    pub address: u32,
    /// The change of a store to the register at `address`.
    pub to: To,
}

/// The effect of a patch on a store.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum To {
    /// Bits of the stored value are changed.
    Bits {
        /// The mask of the changed bits.
        mask: u32,
        /// The new values of the changed bits, at the bits' own positions.
        value: u32,
    },
    /// A store of the value `of` stores `value` instead; other stores stay as they are.
    Instead {
        /// The value that the program stores.
        of: u32,
        /// The value that is stored instead.
        value: u32,
    },
    /// The store is omitted.
    Nothing,
}

impl To {
    fn changes(self, value: u32) -> bool {
        match self {
            Self::Bits { mask, value: bits } => value & mask != bits,
            Self::Instead { of, .. } => value == of,
            Self::Nothing => true,
        }
    }
}

/// The reason why a program cannot be changed as requested.
#[derive(Debug, thiserror::Error)]
pub enum RewriteError {
    /// The recording has no store that the change affects.
    #[error("nothing of the image is changed by {0:x?}")]
    NothingChanged(Change),
    /// The patch would have to move an instruction that depends on its address.
    #[error("at {at:#010x}: {why}")]
    Instruction {
        /// The instruction's address.
        at: u32,
        /// The reason why the instruction cannot be moved.
        why: &'static str,
    },
    /// The flash that the program may execute (by the memory protection unit) has too little free room for the patch.
    #[error("the image's changed instructions end at {0:#010x}, where it cannot execute them")]
    TooLong(u32),
    /// A symbol of the program is missing, or an address is outside the memory.
    #[error(transparent)]
    Node(#[from] Error),
}

struct Code {
    base: u32,
    halves: Vec<u16>,
}

const fn bl_imm(distance: i32, opcode: u16, link: bool) -> [u16; 2] {
    // Returns the bits of a branch: encoding T4 of B or T1 of BL, ARMv7-M ARM A7.7.12 and A7.7.18.
    let value = distance as u32;
    let s = (value >> 24 & 1) as u16;
    let j1 = (!(value >> 23) & 1) as u16 ^ s;
    let j2 = (!(value >> 22) & 1) as u16 ^ s;
    let kind = if link { 0xD000 } else { 0x9000 };
    [opcode | s << 10 | (value >> 12 & 0x3FF) as u16, kind | j1 << 13 | j2 << 11 | (value >> 1 & 0x7FF) as u16]
}

impl Code {
    fn here(&self) -> u32 {
        self.base + 2 * u32::try_from(self.halves.len()).expect("a stub is short")
    }

    fn raw(&mut self, halves: &[u16]) {
        self.halves.extend_from_slice(halves);
    }

    /// Assembles a load of `value` into `register` by MOVW and MOVT, which do not change the flags.
    fn load(&mut self, register: u8, value: u32) {
        for (opcode, half) in [(0xF240_u16, value as u16), (0xF2C0, (value >> 16) as u16)] {
            let (imm4, i, imm3, imm8) = (half >> 12, half >> 11 & 1, half >> 8 & 7, half & 0xFF);
            self.raw(&[opcode | i << 10 | imm4, imm3 << 12 | u16::from(register) << 8 | imm8]);
        }
    }

    fn branch(&mut self, to: u32) {
        let distance = to.wrapping_sub(self.here() + 4).cast_signed();
        self.raw(&bl_imm(distance, 0xF000, false));
    }

    fn close(&mut self, hole: usize) {
        let from = self.base + 2 * u32::try_from(hole).expect("a stub is short");
        let distance = self.here().wrapping_sub(from + 4).cast_signed();
        let [first, second] = bl_imm(distance, 0xF000, false);
        self.halves[hole] = first;
        self.halves[hole + 1] = second;
    }

    fn write_to<B: Board, C: Cost>(&self, node: &mut Node<B, C>) -> Result<(), Error> {
        let bytes: Vec<u8> = self.halves.iter().flat_map(|half| half.to_le_bytes()).collect();
        node.write(super::stored(node, u64::from(self.base)), &bytes)
    }

    fn hole(&mut self) -> usize {
        self.raw(&[0xBF00, 0xBF00]);
        self.halves.len() - 2
    }

    /// Assembles `store`, and changes its effect if it stores to a register in `changes`.
    fn store(&mut self, store: Store, encoding: &[u16], changes: &[Change]) {
        let scratch: Vec<u8> = (0..8).filter(|register| !store.uses(*register)).take(3).collect();
        let [a, b, c] = scratch[..] else { unreachable!("a store uses three registers of eight at most") };
        let saved = 1 << a | 1 << b | 1 << c;
        let half = u16::from;
        let mut joins = vec![];
        for change in changes {
            // The code is PUSH {a, b, c}, and then sets b = APSR, a = address of the store, c = address of the changed
            // register.
            self.raw(&[0xB400 | saved, 0xF3EF, 0x8000 | half(b) << 8]);
            match store.offset {
                Offset::Immediate(value) => {
                    // The store's offset is added to its base register by ADDW, or subtracted by SUBW if it is
                    // negative.
                    let (opcode, value) = (if value < 0 { 0xF2A0 } else { 0xF200 }, value.unsigned_abs());
                    self.raw(&[
                        opcode | (value >> 11 & 1) << 10 | half(store.rn),
                        (value >> 8 & 7) << 12 | half(a) << 8 | value & 0xFF,
                    ]);
                }
                Offset::Register { rm, shift } => {
                    self.raw(&[0xEB00 | half(store.rn), half(a) << 8 | half(shift) << 6 | half(rm)]);
                }
            }
            self.load(c, change.address);
            // The code is CMP a, c, and BEQ over the branch to the next change.
            self.raw(&[0x4280 | half(c) << 3 | half(a), 0xD001]);
            let mut others = vec![self.hole()];
            if let To::Instead { of, .. } = change.to {
                self.load(c, of);
                // CMP Rt, c uses encoding T1 for a low register Rt, and T2 for a high one.
                let rt = half(store.rt);
                let compare = if rt < 8 { 0x4280 | half(c) << 3 | rt } else { 0x4580 | half(c) << 3 | rt & 7 };
                self.raw(&[compare, 0xD001]);
                others.push(self.hole());
            }
            // The code restores APSR from b, and copies Rt to a.
            self.raw(&[0xF380 | half(b), 0x8800, 0x4600 | half(store.rt) << 3 | half(a)]);
            let (mask, bits) = match change.to {
                To::Bits { mask, value } => (mask, value),
                To::Instead { value, .. } => (u32::MAX, value),
                To::Nothing => (0, 0),
            };
            if change.to != To::Nothing {
                let rt = half(store.rt);
                self.load(c, mask);
                self.raw(&[0xEA20 | rt, rt << 8 | half(c)]);
                self.load(c, bits);
                self.raw(&[0xEA40 | rt, rt << 8 | half(c)]);
                self.raw(encoding);
                // The code copies a to Rt.
                self.raw(&[0x4600 | u16::from(store.rt >> 3) << 7 | half(a) << 3 | half(store.rt & 7)]);
            }
            self.raw(&[0xBC00 | saved]);
            joins.push(self.hole());
            for other in others {
                self.close(other);
            }
            self.raw(&[0xF380 | half(b), 0x8800, 0xBC00 | saved]);
        }
        self.raw(encoding);
        for join in joins {
            self.close(join);
        }
    }

    /// Assembles an instruction from `pc` so that it has the same effect at its new address.
    fn moved(
        &mut self,
        pc: u32,
        encoding: &[u16],
        mut literal: impl FnMut(u32) -> Result<u32, Error>,
    ) -> Result<(), RewriteError> {
        let refuse = |why| Err(RewriteError::Instruction { at: pc, why });
        let first = encoding[0];
        if let [_, second] = *encoding {
            // Encodings of the group "branches and miscellaneous control" are in ARMv7-M ARM A5.3.4.
            if first & 0xF800 == 0xF000 && second & 0x8000 != 0 {
                match (second & 0xD000, first >> 6 & 0xF) {
                    (0xD000, _) => {
                        let target = pc.wrapping_add(4).wrapping_add_signed(bl_distance(first, second));
                        let distance = target.wrapping_sub(self.here() + 4).cast_signed();
                        self.raw(&bl_imm(distance, 0xF000, true));
                    }
                    (0x9000, _) => self.branch(pc.wrapping_add(4).wrapping_add_signed(bl_distance(first, second))),
                    (0x8000, condition @ 0..0xE) => {
                        let target = pc.wrapping_add(4).wrapping_add_signed(conditional_distance(first, second));
                        // A 32-bit branch replaces the short one. A conditional branch with the inverse condition skips
                        // it.
                        self.raw(&[0xD000 | (condition ^ 1) << 8 | 1]);
                        self.branch(target);
                    }
                    (0x8000, _) => self.raw(encoding),
                    _ => return refuse("a branch to another instruction set cannot be moved"),
                }
                return Ok(());
            }
            if is_relative(first) {
                return refuse("a wide literal load or address, or a table branch, cannot be moved");
            }
            self.raw(encoding);
            return Ok(());
        }
        match first >> 12 {
            // The instruction is B<cond>.
            0xD if first >> 8 & 0xF < 0xE => {
                let target = pc.wrapping_add(4).wrapping_add_signed(2 * signed(first & 0xFF, 8));
                // A 32-bit branch replaces the short one. A conditional branch with the inverse condition skips it.
                self.raw(&[(first & 0xFF00) ^ 0x0100 | 1]);
                self.branch(target);
            }
            0xE if first & 0xF800 == 0xE000 => {
                let target = pc.wrapping_add(4).wrapping_add_signed(2 * signed(first & 0x7FF, 11));
                self.branch(target);
            }
            0xB => {
                if first & 0xFF00 == 0xBF00 && first & 0xF != 0 {
                    return refuse("an IT block cannot be moved");
                }
                if first & 0xF500 == 0xB100 {
                    // A 32-bit branch replaces CBZ or CBNZ. The opposite instruction skips it.
                    self.raw(&[(first ^ 0x0800) & 0xFD07 | 1 << 3]);
                    self.branch(pc + 4 + u32::from((first >> 9 & 1) << 6 | (first >> 3 & 0x1F) << 1));
                } else {
                    self.raw(encoding);
                }
            }
            0x4 if first & 0xF800 == 0x4800 => {
                let at = ((pc + 4) & !3) + 4 * u32::from(first & 0xFF);
                self.load((first >> 8 & 7) as u8, literal(at)?);
            }
            0xA if first & 0xF800 == 0xA000 => {
                self.load((first >> 8 & 7) as u8, ((pc + 4) & !3) + 4 * u32::from(first & 0xFF));
            }
            _ => self.raw(encoding),
        }
        Ok(())
    }
}

/// Whether a 32-bit instruction that begins with `first` depends on its own address: TBB, TBH, and literal loads.
const fn is_relative(first: u16) -> bool {
    let table = first & 0xFFF0 == 0xE8D0;
    let load = first & 0xFE1F == 0xF81F || first & 0xFE5F == 0xE85F || first & 0xFF3F == 0xED1F;
    table || load || first & 0xFB5F == 0xF20F
}

/// Whether the instruction at `pc` has the same effect at any other address.
fn can_move<B: Board, C: Cost>(node: &Node<B, C>, pc: u32) -> bool {
    let (one, two) = halves(node, pc);
    let encoding = if is_wide(one) { &[one, two][..] } else { &[one] };
    Code { base: 0, halves: vec![] }.moved(pc, encoding, |_| Ok(0)).is_ok()
}

fn signed(value: u16, bits: u32) -> i32 {
    i32::from(value) << (32 - bits) >> (32 - bits)
}

fn bl_distance(first: u16, second: u16) -> i32 {
    let s = u32::from(first >> 10 & 1);
    let i1 = !(u32::from(second >> 13) ^ s) & 1;
    let i2 = !(u32::from(second >> 11) ^ s) & 1;
    let value = s << 24 | i1 << 23 | i2 << 22 | u32::from(first & 0x3FF) << 12 | u32::from(second & 0x7FF) << 1;
    (value << 7).cast_signed() >> 7
}

/// Returns the targets of all direct branches within [`NEAR`] bytes of `site`, including branches that did not run in
/// the recording.
fn near_targets<B: Board, C: Cost>(node: &Node<B, C>, site: u32) -> BTreeSet<u32> {
    let mut targets = BTreeSet::new();
    let mut pc = site.saturating_sub(NEAR) & !3;
    while pc < site + NEAR {
        let (first, second) = halves(node, pc);
        let after = pc.wrapping_add(4);
        let target = match first >> 12 {
            0xD if first >> 8 & 0xF < 0xE => Some(after.wrapping_add_signed(2 * signed(first & 0xFF, 8))),
            0xE if first & 0xF800 == 0xE000 => Some(after.wrapping_add_signed(2 * signed(first & 0x7FF, 11))),
            0xB if first & 0xF500 == 0xB100 => {
                Some(after + u32::from((first >> 9 & 1) << 6 | (first >> 3 & 0x1F) << 1))
            }
            0xF if first & 0xF800 == 0xF000 && second & 0xD000 == 0x9000 => {
                Some(after.wrapping_add_signed(bl_distance(first, second)))
            }
            0xF if first & 0xF800 == 0xF000 && second & 0xD000 == 0x8000 && first >> 7 & 7 != 7 => {
                Some(after.wrapping_add_signed(conditional_distance(first, second)))
            }
            _ => None,
        };
        targets.extend(target);
        pc += if is_wide(first) { 4 } else { 2 };
    }
    targets
}

/// The distance from a conditional B.W to its target, bytes: encoding T3, ARMv7-M ARM A7.7.12.
fn conditional_distance(first: u16, second: u16) -> i32 {
    let (s, j1, j2) = (u32::from(first >> 10 & 1), u32::from(second >> 13 & 1), u32::from(second >> 11 & 1));
    let value = s << 20 | j2 << 19 | j1 << 18 | u32::from(first & 0x3F) << 12 | u32::from(second & 0x7FF) << 1;
    (value << 11).cast_signed() >> 11
}

/// Patches `node`'s flash so that the stores in `recording` to the registers of `changes` have the changed effect, and
/// corrects the program's CRC. The board must not have executed an instruction yet.
///
/// # Errors
///
/// [`RewriteError`] if a change affects no store in the recording, or if an instruction cannot be replaced.
pub fn rewrite<B: Board, C: Cost>(
    node: &mut Node<B, C>,
    recording: &Recording,
    changes: &[Change],
) -> Result<(), RewriteError> {
    let sites = sites(recording, changes)?;
    if sites.is_empty() {
        return Ok(());
    }
    let refuse = |at, why| Err(RewriteError::Instruction { at, why });
    // The stubs begin just behind the program, because the firmware may not execute all of its free flash.
    let end = node.address_of("__program_crc")? as u32 + 4;
    let mut stubs = Code { base: end.next_multiple_of(ALIGNED), halves: vec![] };
    let mut done = 0;
    for &site in sites.keys() {
        if site < done {
            continue;
        }
        let stub = stubs.here();
        let targets = &near_targets(node, site) | &recording.targets;
        let narrow = !is_wide(halves(node, site).0);
        let mut skip = None;
        let start = if recording.conditional.contains(&site) {
            // The IT block contains only the store. If its condition is false, the stub returns at once.
            let it = halves(node, site - 2).0;
            if !narrow || it & 0xFF0F != 0xBF08 {
                return refuse(site, "a store in an IT block of more than one instruction cannot be replaced");
            }
            stubs.raw(&[0xD001 | (it & 0xF0) << 4]);
            skip = Some(stubs.hole());
            site - 2
        } else if narrow && (targets.contains(&(site + 2)) || !can_move(node, site + 2)) {
            // A branch takes four bytes, and this store has two. If the next instruction is a branch target or cannot
            // be moved, the branch replaces the previous one instead.
            recording.before[&site]
        } else {
            site
        };
        if start < done || start > site || site - start > 4 {
            return refuse(site, "there is no room for a branch");
        }
        let mut pc = if skip.is_some() { site } else { start };
        while pc < start + 4 || pc <= site {
            let entry = pc == start || skip.is_some() && pc == site;
            if !entry && targets.contains(&pc) {
                return refuse(pc, "an instruction that is branched to cannot be moved");
            }
            let (one, two) = halves(node, pc);
            let encoding = if is_wide(one) { vec![one, two] } else { vec![one] };
            let length = 2 * encoding.len() as u32;
            match (Store::decode(one, two), sites.get(&pc)) {
                (Some(store), Some(changes)) => stubs.store(store, &encoding, changes),
                _ => stubs.moved(pc, &encoding, |at| {
                    let mut word = [0; 4];
                    node.read(super::stored(node, u64::from(at)), &mut word).map(|()| u32::from_le_bytes(word))
                })?,
            }
            pc += length;
        }
        if let Some(skip) = skip {
            stubs.close(skip);
        }
        stubs.branch(pc);
        done = pc;
        let mut jump = Code { base: start, halves: vec![] };
        jump.branch(stub);
        while jump.here() < pc {
            jump.raw(&[0xBF00]);
        }
        jump.write_to(node)?;
    }
    if !may_execute(stubs.base) || !may_execute(stubs.here() - 2) {
        return Err(RewriteError::TooLong(stubs.here()));
    }
    stubs.write_to(node)?;
    let _ = seal(node)?;
    Ok(())
}

/// Whether either firmware's memory protection permits execution at `address`. The two boards' flash has different
/// addresses.
fn may_execute(address: u32) -> bool {
    let (horus, dpr) = (horus_tx_fw::protection::TASKS, dpr_fw::protection::TASKS);
    horus.allows(address, Access::Execute) || dpr.allows(address, Access::Execute)
}

fn sites(recording: &Recording, changes: &[Change]) -> Result<BTreeMap<u32, Vec<Change>>, RewriteError> {
    let mut sites: BTreeMap<u32, Vec<Change>> = BTreeMap::new();
    for change in changes {
        let stores: Vec<Stored> =
            recording.to(change.address).filter(|stored| change.to.changes(stored.value)).collect();
        if stores.is_empty() {
            return Err(RewriteError::NothingChanged(*change));
        }
        for stored in stores {
            let of_site = sites.entry(stored.pc).or_default();
            if !of_site.contains(change) {
                of_site.push(*change);
            }
        }
    }
    Ok(sites)
}

#[cfg(test)]
mod tests {
    use cortex_m4::describe;

    use super::*;

    fn moved(pc: u32, base: u32, encoding: &[u16]) -> Vec<String> {
        let mut code = Code { base, halves: vec![] };
        code.moved(pc, encoding, |at| Ok(at ^ 0xFFFF_0000)).unwrap();
        let (mut words, mut at) = (vec![], 0);
        while at < code.halves.len() {
            let second = code.halves.get(at + 1).copied().unwrap_or_default();
            let address = base + 2 * u32::try_from(at).unwrap();
            words.push(describe(address, code.halves[at], second).1);
            at += if is_wide(code.halves[at]) { 2 } else { 1 };
        }
        words
    }

    fn unmoved(pc: u32, encoding: &[u16]) -> String {
        describe(pc, encoding[0], encoding.get(1).copied().unwrap_or_default()).1
    }

    #[test]
    fn distances_of_wide_branches_have_their_sign_and_both_ends() {
        for distance in [-0x100_0000, -0x5A_5A5A, -4, 0, 2, 0x12_3456, 0xFF_FFFE] {
            let [first, second] = bl_imm(distance, 0xF000, true);
            assert_eq!(bl_distance(first, second), distance);
        }
        assert_eq!(conditional_distance(0xF000, 0x8000), 0);
        assert_eq!(conditional_distance(0xF03F, 0xAFFF), 0xF_FFFE);
        assert_eq!(conditional_distance(0xF43F, 0xAFFE), -4);
    }

    #[test]
    fn an_instruction_that_means_the_same_everywhere_is_copied() {
        // The instructions are ADDS r0, #1; DSB; MSR PRIMASK, r0; MOVW r1, #0.
        for encoding in [&[0x3001_u16][..], &[0xF3BF, 0x8F4F], &[0xF380, 0x8810], &[0xF240, 0x0100]] {
            assert_eq!(moved(0x800_0100, 0x804_0000, encoding), [unmoved(0x800_0100, encoding)]);
        }
    }

    #[test]
    fn an_instruction_that_cannot_be_moved_is_refused_with_its_address() {
        // The tested instructions are IT EQ; LDR.W r0, [pc, #4]; TBB [pc, r1]; LDRH.W r0, [pc, #4]; LDRD r0, r1, [pc,
        // #4]; VLDR s0, [pc, #4]; ADR.W r0, forwards and backwards.
        let [table, load] = [[0xE8DF_u16, 0xF001], [0xF8DF, 0x0004]];
        let [half, two, float] = [[0xF8BF, 0x0004], [0xE9DF, 0x0101], [0xED9F, 0x0A01]];
        let [forwards, backwards] = [[0xF20F, 0x0004], [0xF2AF, 0x0004]];
        let wide = [table, load, half, two, float, forwards, backwards];
        for encoding in [&[0xBF08_u16][..]].into_iter().chain(wide.iter().map(|it| &it[..])) {
            let refused = Code { base: 0x804_0000, halves: vec![] }.moved(0x800_0100, encoding, |_| Ok(0));
            assert!(matches!(refused, Err(RewriteError::Instruction { at: 0x800_0100, .. })), "{encoding:x?}");
        }
    }

    #[test]
    fn a_branch_leads_where_it_led() {
        let branches: [&[u16]; 5] = [&[0xE010], &[0xD010], &[0xB910], &[0xF000, 0x8010], &[0xF000, 0xB810]];
        for encoding in branches {
            let words = moved(0x800_0100, 0x804_0000, encoding);
            let target = |word: &String| {
                let (_, after) = word.split_once("target: ").unwrap_or_else(|| panic!("{word}"));
                after.trim_end_matches([' ', '}']).to_owned()
            };
            assert_eq!(target(words.last().unwrap()), target(&unmoved(0x800_0100, encoding)), "{words:?}");
        }
    }
}
