//! Patches a release image in flash so that it sets a register up wrongly, without knowing where in the image it does.
//!
//! [`Recording`] runs an unpatched board instruction by instruction and keeps every store to a peripheral: which
//! instruction, to which address, with which value. [`patch`] then replaces each instruction that stores to a given
//! register by a branch to a stub in free flash. The stub does the same store with some bits changed, or leaves it out,
//! whenever the address is that register's, and goes back. At last the image is sealed again, as the build does, so
//! that the firmware's comparison of its flash passes. Code that the recording did not come through stays as it was.
//!
//! | covered | not covered, and how that shows |
//! |---|---|
//! | STR, STRB, STRH, immediate or register offset | STRD, STM, write-back: nothing is stored there, a panic |
//! | a 16-bit store: the instruction after it moves into the stub | one that begins an IT block: a panic |
//! | a 16-bit store alone in an IT block | a longer IT block: a panic |

use std::collections::{BTreeMap, BTreeSet};

use bench::engine::{Board, Node};

/// Where peripherals begin, the core's own included.
const PERIPHERALS: u32 = 0x4000_0000;

/// The stubs' distance from the vector table: behind every image, in flash of either part.
const STUBS: u32 = 0x4_0000;

/// An instruction that stores a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Store {
    /// The register stored.
    rt: u8,
    rn: u8,
    offset: Offset,
    /// How many bytes.
    size: u8,
    /// Whether the instruction has 32 bits.
    wide: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Offset {
    Immediate(u16),
    Register { rm: u8, shift: u8 },
}

impl Store {
    /// The store in `first` and `second`, if that is one: ARMv7-M ARM A7.7.161 (STR), A7.7.163 (STRB), A7.7.170 (STRH).
    fn decode(first: u16, second: u16) -> Option<Self> {
        let low = |at: u16| (first >> at & 7) as u8;
        let narrow = |size: u8, offset| Some(Self { rt: low(0), rn: low(3), offset, size, wide: false });
        let immediate = first >> 6 & 0x1F;
        match first >> 11 {
            0b01100 => return narrow(4, Offset::Immediate(immediate * 4)),
            0b01110 => return narrow(1, Offset::Immediate(immediate)),
            0b10000 => return narrow(2, Offset::Immediate(immediate * 2)),
            _ => {}
        }
        match first >> 9 {
            0b010_1000 => return narrow(4, Offset::Register { rm: low(6), shift: 0 }),
            0b010_1001 => return narrow(2, Offset::Register { rm: low(6), shift: 0 }),
            0b010_1010 => return narrow(1, Offset::Register { rm: low(6), shift: 0 }),
            _ => {}
        }
        let (rn, rt) = ((first & 0xF) as u8, (second >> 12) as u8);
        let (size, long) = match first & 0xFFF0 {
            0xF880 => (1, true),
            0xF8A0 => (2, true),
            0xF8C0 => (4, true),
            0xF800 => (1, false),
            0xF820 => (2, false),
            0xF840 => (4, false),
            _ => return None,
        };
        let offset = if long {
            Offset::Immediate(second & 0xFFF)
        } else if second & 0x0FC0 == 0 {
            Offset::Register { rm: (second & 0xF) as u8, shift: (second >> 4 & 3) as u8 }
        } else {
            return None;
        };
        Some(Self { rt, rn, offset, size, wide: true })
    }

    fn address<B: Board>(self, node: &Node<B>) -> u32 {
        let register = |number: u8| node.register(usize::from(number));
        let offset = match self.offset {
            Offset::Immediate(value) => u32::from(value),
            Offset::Register { rm, shift } => register(rm) << shift,
        };
        register(self.rn).wrapping_add(offset)
    }

    fn uses(self, register: u8) -> bool {
        let rm = if let Offset::Register { rm, .. } = self.offset { rm } else { self.rn };
        [self.rt, self.rn, rm].contains(&register)
    }
}

/// Whether an instruction that begins with `first` has 32 bits: ARMv7-M ARM A5.1.
const fn is_wide(first: u16) -> bool {
    first >> 11 >= 0b11101
}

/// A store that a board made to a peripheral.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Stored {
    pub(crate) address: u32,
    pub(crate) pc: u32,
    pub(crate) value: u32,
}

/// What a board stored to peripherals in a run without a patch.
#[derive(Clone, Debug, Default)]
pub(crate) struct Recording {
    stores: BTreeSet<Stored>,
    /// Instructions that something branched to.
    targets: BTreeSet<u32>,
    /// Stores inside IT blocks.
    conditional: BTreeSet<u32>,
    /// The instruction before each store.
    before: BTreeMap<u32, u32>,
}

impl Recording {
    /// Runs `node` to `until` (ns), and calls `drain` after every instruction.
    pub(crate) fn of<B: Board>(node: &mut Node<B>, until: u64, mut drain: impl FnMut(&mut Node<B>)) -> Self {
        let mut recording = Self::default();
        let mut before = 0;
        while node.now() < until {
            if node.is_asleep() {
                node.advance(node.earliest().max(node.now() + 1).min(until));
                drain(node);
                continue;
            }
            let (pc, retired) = (node.register(15), node.instructions());
            let (first, second) = halves(node, pc);
            let length = if is_wide(first) { 4 } else { 2 };
            // ICI/IT of EPSR, ARMv7-M ARM B1.4.2.
            let in_it_block = node.register(16) & 0x0600_FC00 != 0;
            let stored = Store::decode(first, second)
                .map(|store| (store.address(node), node.register(usize::from(store.rt)), store.size))
                .filter(|(address, ..)| *address >= PERIPHERALS);
            while node.instructions() == retired && node.now() < until && !node.is_asleep() {
                node.advance(node.now() + 1);
            }
            let next = node.register(15);
            if next != pc + length {
                recording.targets.insert(next);
            } else if let Some((address, register, size)) = stored {
                let value = if size == 4 { register } else { register & ((1 << (8 * size)) - 1) };
                recording.stores.insert(Stored { address, pc, value });
                recording.before.insert(pc, before);
                if in_it_block {
                    recording.conditional.insert(pc);
                }
            }
            before = pc;
            drain(node);
        }
        recording
    }

    /// What was stored to `address`.
    pub(crate) fn to(&self, address: u32) -> impl Iterator<Item = Stored> + '_ {
        self.stores.iter().copied().filter(move |stored| stored.address == address)
    }
}

/// The two halfwords at `address`.
fn halves<B: Board>(node: &Node<B>, address: u32) -> (u16, u16) {
    let mut bytes = [0; 4];
    if node.read(u64::from(address), &mut bytes).is_err() {
        // The last halfword of a memory.
        let _ = node.read(u64::from(address), &mut bytes[..2]);
    }
    (u16::from_le_bytes([bytes[0], bytes[1]]), u16::from_le_bytes([bytes[2], bytes[3]]))
}

/// What a patch makes of the stores to one register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Change {
    pub(crate) address: u32,
    pub(crate) to: To,
}

/// What becomes of a store.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum To {
    /// The bits of the mask take these values.
    Bits { mask: u32, value: u32 },
    /// This value is stored in place of that one; other values stay.
    Instead { of: u32, value: u32 },
    /// Nothing is stored.
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

/// Code under way, at its address.
struct Code {
    base: u32,
    halves: Vec<u16>,
}

const fn bl_imm(distance: i32, opcode: u16, link: bool) -> [u16; 2] {
    // Encodings T4 of B and T1 of BL, ARMv7-M ARM A7.7.12 and A7.7.18.
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

    /// `register` = `value`, by MOVW and MOVT, which leave the flags.
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

    /// The branch that was left open at `hole` leads here.
    fn close(&mut self, hole: usize) {
        let from = self.base + 2 * u32::try_from(hole).expect("a stub is short");
        let distance = self.here().wrapping_sub(from + 4).cast_signed();
        let [first, second] = bl_imm(distance, 0xF000, false);
        self.halves[hole] = first;
        self.halves[hole + 1] = second;
    }

    /// Leaves room for a branch.
    fn hole(&mut self) -> usize {
        self.raw(&[0xBF00, 0xBF00]);
        self.halves.len() - 2
    }

    /// `store`, which is `encoding`, changed where it goes to one of the registers in `changes`.
    fn store(&mut self, store: Store, encoding: &[u16], changes: &[Change]) {
        let scratch: Vec<u8> = (0..8).filter(|register| !store.uses(*register)).take(3).collect();
        let [a, b, c] = scratch[..] else { unreachable!("a store uses three registers of eight at most") };
        let saved = 1 << a | 1 << b | 1 << c;
        let half = u16::from;
        let mut joins = vec![];
        for change in changes {
            // PUSH {a, b, c}; b = APSR; a = the store's address; c = the register's.
            self.raw(&[0xB400 | saved, 0xF3EF, 0x8000 | half(b) << 8]);
            match store.offset {
                Offset::Immediate(value) => self.raw(&[
                    0xF200 | (value >> 11 & 1) << 10 | half(store.rn),
                    (value >> 8 & 7) << 12 | half(a) << 8 | value & 0xFF,
                ]),
                Offset::Register { rm, shift } => {
                    self.raw(&[0xEB00 | half(store.rn), half(a) << 8 | half(shift) << 6 | half(rm)]);
                }
            }
            self.load(c, change.address);
            // CMP a, c; BEQ over the branch to the next.
            self.raw(&[0x4280 | half(c) << 3 | half(a), 0xD001]);
            let mut others = vec![self.hole()];
            if let To::Instead { of, .. } = change.to {
                self.load(c, of);
                // CMP Rt, c: encoding T1 for low registers, T2 for high ones.
                let rt = half(store.rt);
                let compare = if rt < 8 { 0x4280 | half(c) << 3 | rt } else { 0x4580 | half(c) << 3 | rt & 7 };
                self.raw(&[compare, 0xD001]);
                others.push(self.hole());
            }
            // APSR = b; a = Rt.
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
                // Rt = a.
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

    /// The 16-bit or 32-bit instruction `encoding` from `pc`, so that it does the same here.
    fn moved(&mut self, pc: u32, encoding: &[u16], mut literal: impl FnMut(u32) -> u32) {
        let first = encoding[0];
        if let [_, second] = *encoding {
            if first & 0xF800 == 0xF000 && second & 0x8000 != 0 {
                assert_eq!(second & 0xD000, 0xD000, "{pc:#010x}: a wide branch other than BL");
                let target = pc.wrapping_add(4).wrapping_add_signed(bl_distance(first, second));
                let distance = target.wrapping_sub(self.here() + 4).cast_signed();
                self.raw(&bl_imm(distance, 0xF000, true));
                return;
            }
            assert!(first & 0xFF7F != 0xF85F && first & 0xFFF0 != 0xE8D0, "{pc:#010x}: {first:#06x} {second:#06x}");
            self.raw(encoding);
            return;
        }
        let signed = |value: u16, bits: u32| i32::from(value) << (32 - bits) >> (32 - bits);
        match first >> 12 {
            // B<cond>
            0xD if first >> 8 & 0xF < 0xE => {
                let target = pc.wrapping_add(4).wrapping_add_signed(2 * signed(first & 0xFF, 8));
                // The inverse condition leads past the 32-bit branch that follows.
                self.raw(&[(first & 0xFF00) ^ 0x0100 | 1]);
                self.branch(target);
            }
            0xE if first & 0xF800 == 0xE000 => {
                let target = pc.wrapping_add(4).wrapping_add_signed(2 * signed(first & 0x7FF, 11));
                self.branch(target);
            }
            0xB => {
                assert!(first & 0xFF00 != 0xBF00 || first & 0xF == 0, "{pc:#010x}: an IT block");
                if first & 0xF500 == 0xB100 {
                    // CBZ or CBNZ: its opposite leads past the branch.
                    self.raw(&[(first ^ 0x0800) & 0xFD07 | 1 << 3]);
                    self.branch(pc + 4 + u32::from((first >> 9 & 1) << 6 | (first >> 3 & 0x1F) << 1));
                } else {
                    self.raw(encoding);
                }
            }
            0x4 if first & 0xF800 == 0x4800 => {
                let at = ((pc + 4) & !3) + 4 * u32::from(first & 0xFF);
                self.load((first >> 8 & 7) as u8, literal(at));
            }
            0xA if first & 0xF800 == 0xA000 => {
                self.load((first >> 8 & 7) as u8, ((pc + 4) & !3) + 4 * u32::from(first & 0xFF));
            }
            _ => self.raw(encoding),
        }
    }
}

/// How far a B.W or BL leads.
fn bl_distance(first: u16, second: u16) -> i32 {
    let s = u32::from(first >> 10 & 1);
    let i1 = !(u32::from(second >> 13) ^ s) & 1;
    let i2 = !(u32::from(second >> 11) ^ s) & 1;
    let value = s << 24 | i1 << 23 | i2 << 22 | u32::from(first & 0x3FF) << 12 | u32::from(second & 0x7FF) << 1;
    (value << 7).cast_signed() >> 7
}

/// Patches `node`'s flash so that what it stored to the registers of `changes` in `recording` becomes what they say,
/// and seals the image again. The board must not have run yet.
///
/// # Panics
///
/// If a change changes nothing of what was recorded, or an instruction cannot be replaced.
pub(crate) fn patch<B: Board>(node: &mut Node<B>, recording: &Recording, changes: &[Change]) {
    let mut sites: BTreeMap<u32, Vec<Change>> = BTreeMap::new();
    for change in changes {
        let stores: Vec<Stored> =
            recording.to(change.address).filter(|stored| change.to.changes(stored.value)).collect();
        assert!(!stores.is_empty(), "nothing of the image is changed by {change:x?}");
        for stored in stores {
            let of_site = sites.entry(stored.pc).or_default();
            if !of_site.contains(change) {
                of_site.push(*change);
            }
        }
    }
    let first = u32::try_from(node.address_of("__vector_table").unwrap()).unwrap();
    let end = u32::try_from(node.address_of("__image_crc").unwrap()).unwrap();
    assert!(end + 4 <= first + STUBS, "the stubs lie behind the image");
    let mut stubs = Code { base: first + STUBS, halves: vec![] };
    let mut done = 0;
    if sites.is_empty() {
        return;
    }
    for &site in sites.keys() {
        if site < done {
            continue;
        }
        let stub = stubs.here();
        let narrow = !is_wide(halves(node, site).0);
        let mut skip = None;
        let start = if recording.conditional.contains(&site) {
            // IT and the one instruction in its block: the stub branches where the block would not be executed.
            let it = halves(node, site - 2).0;
            assert!(narrow && it & 0xFF0F == 0xBF08, "{site:#010x} is in an IT block of more than one instruction");
            stubs.raw(&[0xD001 | (it & 0xF0) << 4]);
            skip = Some(stubs.hole());
            site - 2
        } else if narrow && recording.targets.contains(&(site + 2)) {
            // Where the instruction after a 16-bit store is branched to, the one before the store moves with it.
            recording.before[&site]
        } else {
            site
        };
        assert!(start >= done && site - start <= 4, "{site:#010x}: no room for a branch");
        let mut pc = if skip.is_some() { site } else { start };
        while pc < start + 4 || pc <= site {
            let entry = pc == start || skip.is_some() && pc == site;
            assert!(entry || !recording.targets.contains(&pc), "{pc:#010x} is branched to");
            let (one, two) = halves(node, pc);
            let encoding = if is_wide(one) { vec![one, two] } else { vec![one] };
            let length = 2 * u32::try_from(encoding.len()).unwrap();
            match (Store::decode(one, two), sites.get(&pc)) {
                (Some(store), Some(changes)) => stubs.store(store, &encoding, changes),
                _ => stubs.moved(pc, &encoding, |at| node.word(u64::from(at)).expect("a literal in flash")),
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
        write(node, start, &jump.halves);
    }
    let (base, halves) = (stubs.base, stubs.halves);
    write(node, base, &halves);
    let mut image = vec![0; usize::try_from(end - first).unwrap()];
    node.read(u64::from(first), &mut image).unwrap();
    node.write(u64::from(end), &profile::crc::frame(&image).to_be_bytes()).unwrap();
}

fn write<B: Board>(node: &mut Node<B>, address: u32, halves: &[u16]) {
    let bytes: Vec<u8> = halves.iter().flat_map(|half| half.to_le_bytes()).collect();
    node.write(u64::from(address), &bytes).unwrap();
}
