//! Records which instructions of a program store which values to peripheral registers.

use std::collections::{BTreeMap, BTreeSet};

use cortex_m4::Cost;

use emulator_node::{Board, Node};

const PERIPHERALS: u32 = 0x4000_0000;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Store {
    pub(super) rt: u8,
    pub(super) rn: u8,
    pub(super) offset: Offset,
    size: u8,
    wide: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Offset {
    /// An immediate offset from -255 to 4095.
    Immediate(i16),
    Register {
        rm: u8,
        shift: u8,
    },
}

impl Store {
    /// Decodes a store instruction: STR, STRB or STRH (ARMv7-M ARM A7.7.161, A7.7.163, A7.7.170).
    pub(super) fn decode(first: u16, second: u16) -> Option<Self> {
        let low = |at: u16| (first >> at & 7) as u8;
        let narrow = |size: u8, offset| Some(Self { rt: low(0), rn: low(3), offset, size, wide: false });
        let immediate = (first >> 6 & 0x1F).cast_signed();
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
            Offset::Immediate((second & 0xFFF).cast_signed())
        } else if second & 0x0F00 == 0x0C00 {
            // STR (T4), STRB and STRH (T3) with these bits subtract the offset and keep the base register.
            Offset::Immediate(-(second & 0xFF).cast_signed())
        } else if second & 0x0FC0 == 0 {
            Offset::Register { rm: (second & 0xF) as u8, shift: (second >> 4 & 3) as u8 }
        } else {
            return None;
        };
        Some(Self { rt, rn, offset, size, wide: true })
    }

    fn address<B: Board, C: Cost>(self, node: &Node<B, C>) -> u32 {
        let register = |number: u8| node.register(usize::from(number));
        let offset = match self.offset {
            Offset::Immediate(value) => i32::from(value).cast_unsigned(),
            Offset::Register { rm, shift } => register(rm) << shift,
        };
        register(self.rn).wrapping_add(offset)
    }

    pub(super) fn uses(self, register: u8) -> bool {
        let rm = if let Offset::Register { rm, .. } = self.offset { rm } else { self.rn };
        [self.rt, self.rn, rm].contains(&register)
    }
}

/// Whether an instruction that begins with `first` has 32 bits: ARMv7-M ARM A5.1.
pub(super) const fn is_wide(first: u16) -> bool {
    first >> 11 >= 0b11101
}

/// A store that a board made to a peripheral.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stored {
    /// The register's address.
    pub address: u32,
    /// The address of the instruction that made the store.
    pub pc: u32,
    /// The stored value.
    pub value: u32,
}

/// The stores of a board's unpatched program to peripherals, in one run.
#[derive(Clone, Debug, Default)]
pub struct Recording {
    stores: BTreeSet<Stored>,
    pub(super) targets: BTreeSet<u32>,
    pub(super) conditional: BTreeSet<u32>,
    /// For each store, by address, the address of the instruction that was executed before it.
    pub(super) before: BTreeMap<u32, u32>,
    last: u32,
}

impl Recording {
    /// Runs `node` to `until` (ns) and records its stores. Calls `drain` after every step. `drain` must take the
    /// signals of the board.
    #[must_use]
    pub fn of<B: Board, C: Cost>(node: &mut Node<B, C>, until: u64, drain: impl FnMut(&mut Node<B, C>)) -> Self {
        let mut recording = Self::default();
        recording.go_on(node, until, drain);
        recording
    }

    /// Continues the recording to `until` (ns) as [`Recording::of`] does.
    pub fn go_on<B: Board, C: Cost>(
        &mut self,
        node: &mut Node<B, C>,
        until: u64,
        mut drain: impl FnMut(&mut Node<B, C>),
    ) {
        while node.now() < until {
            if node.is_asleep() {
                node.advance(node.earliest().max(node.now() + 1).min(until));
                drain(node);
                continue;
            }
            let (pc, retired) = (node.register(15), node.instructions());
            let (first, second) = halves(node, pc);
            let length = if is_wide(first) { 4 } else { 2 };
            // EPSR's field ICI/IT is not zero within an IT block (ARMv7-M ARM B1.4.2).
            let in_it_block = node.register(16) & 0x0600_FC00 != 0;
            let stored = Store::decode(first, second)
                .map(|store| (store.address(node), node.register(usize::from(store.rt)), store.size))
                .filter(|(address, ..)| *address >= PERIPHERALS);
            while node.instructions() == retired && node.now() < until && !node.is_asleep() {
                node.advance(node.now() + 1);
                // The node stops until the signals of the board are taken.
                drain(node);
            }
            let next = node.register(15);
            if next != pc + length {
                self.targets.insert(next);
            } else if let Some((address, register, size)) = stored {
                let value = if size == 4 { register } else { register & ((1 << (8 * size)) - 1) };
                self.stores.insert(Stored { address, pc, value });
                self.before.insert(pc, self.last);
                if in_it_block {
                    self.conditional.insert(pc);
                }
            }
            self.last = pc;
        }
    }

    /// The stores to `address`.
    pub fn to(&self, address: u32) -> impl Iterator<Item = Stored> + '_ {
        self.stores.iter().copied().filter(move |stored| stored.address == address)
    }
}

pub(super) fn halves<B: Board, C: Cost>(node: &Node<B, C>, address: u32) -> (u16, u16) {
    let mut bytes = [0; 4];
    let address = super::stored(node, u64::from(address));
    if node.read(address, &mut bytes).is_err() {
        // A read of four bytes fails at the last halfword of a memory.
        let _ = node.read(address, &mut bytes[..2]);
    }
    (u16::from_le_bytes([bytes[0], bytes[1]]), u16::from_le_bytes([bytes[2], bytes[3]]))
}
