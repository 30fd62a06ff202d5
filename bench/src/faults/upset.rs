//! Upsets: single bits that flip.

use std::ops::Range;

use bench_judge::disturbance::Memory;
use cortex_m4::Cost;

use super::{Kind, Rng};
use emulator_node::{Board, Error, Node};

/// The bit that an upset flips.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Upset {
    /// A bit of RAM.
    Ram {
        /// The byte's address.
        address: u32,
        /// The bit's number, 0 to 7.
        bit: u8,
    },
    /// A bit of flash.
    Flash {
        /// The byte's address.
        address: u32,
        /// The bit's number, 0 to 7.
        bit: u8,
    },
    /// A bit of a core register, 0 to 15.
    Register {
        /// The register's number.
        number: u8,
        /// The bit's number, 0 to 31.
        bit: u8,
    },
}

impl Upset {
    /// Returns the upset's name in the event log.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Ram { .. } => "ram",
            Self::Flash { .. } => "flash",
            Self::Register { .. } => "register",
        }
    }

    /// The kind of memory that holds the upset bit.
    #[must_use]
    pub const fn memory(&self) -> Memory {
        match self {
            Self::Ram { .. } => Memory::Ram,
            Self::Flash { .. } => Memory::Flash,
            Self::Register { .. } => Memory::Registers,
        }
    }

    /// Returns the kind's name in `--faults`.
    #[must_use]
    pub const fn kind(&self) -> Kind {
        match self {
            Self::Ram { .. } => Kind::Ram,
            Self::Flash { .. } => Kind::Flash,
            Self::Register { .. } => Kind::Registers,
        }
    }

    /// Returns a uniformly drawn upset of `kind` among `targets`; `None` if there is none.
    pub fn drawn(kind: Kind, rng: &mut Rng, targets: &Targets) -> Option<Self> {
        match kind {
            Kind::Ram => {
                let (address, bit) = a_bit(rng, &targets.ram)?;
                Some(Self::Ram { address, bit })
            }
            Kind::Flash => {
                let (address, bit) = a_bit(rng, &targets.flash)?;
                Some(Self::Flash { address, bit })
            }
            Kind::Registers => {
                let number = rng.below(16) as u8;
                // The two lowest bits of SP and the lowest of PC always read zero (ARMv7-M ARM B1.4.1).
                let least = match number {
                    13 => 2,
                    15 => 1,
                    _ => 0,
                };
                Some(Self::Register { number, bit: rng.between(least, 31) as u8 })
            }
            Kind::Air
            | Kind::Gnss
            | Kind::FlightController
            | Kind::Power
            | Kind::Buffers
            | Kind::Inputs
            | Kind::Hang
            | Kind::Chips
            | Kind::Hold
            | Kind::Hostile => None,
        }
    }

    /// Flips the bit on `node` now.
    ///
    /// # Errors
    ///
    /// [`Error::NotMemory`] if there is no memory at the address.
    pub fn apply<B: Board, C: Cost>(&self, node: &mut Node<B, C>) -> Result<(), Error> {
        match *self {
            Self::Ram { address, bit } | Self::Flash { address, bit } => {
                let mut byte = [0];
                node.read(u64::from(address), &mut byte)?;
                node.write(u64::from(address), &[byte[0] ^ 1 << (bit & 7)])
            }
            Self::Register { number, bit } => {
                let number = usize::from(number & 15);
                let flipped = node.register(number) ^ 1 << (bit & 31);
                node.set_register(number, flipped);
                Ok(())
            }
        }
    }
}

impl std::fmt::Display for Upset {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Ram { address, bit } => write!(f, "RAM {address:#010x} bit {bit}"),
            Self::Flash { address, bit } => write!(f, "flash {address:#010x} bit {bit}"),
            Self::Register { number: 13, bit } => write!(f, "SP bit {bit}"),
            Self::Register { number: 14, bit } => write!(f, "LR bit {bit}"),
            Self::Register { number: 15, bit } => write!(f, "PC bit {bit}"),
            Self::Register { number, bit } => write!(f, "R{number} bit {bit}"),
        }
    }
}

fn a_bit(rng: &mut Rng, ranges: &[Range<u32>]) -> Option<(u32, u8)> {
    let bytes: u64 = ranges.iter().map(|range| u64::from(range.end.saturating_sub(range.start))).sum();
    let mut nth = rng.below(bytes);
    let bit = rng.below(8) as u8;
    for range in ranges {
        let length = u64::from(range.end.saturating_sub(range.start));
        if nth < length {
            return Some((range.start + nth as u32, bit));
        }
        nth -= length;
    }
    None
}

/// The memory that a firmware uses. An upset of other memory would have no effect.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Targets {
    /// The ranges of RAM: the statics, with the buffers of the DMA controllers, and the stack in use.
    pub ram: Vec<Range<u32>>,
    /// The ranges of flash: the program with its CRC.
    pub flash: Vec<Range<u32>>,
}

impl Targets {
    /// The memory that `node`'s firmware uses now.
    ///
    /// # Errors
    ///
    /// [`Error::NoSymbol`] if the program lacks the symbol of its CRC or one that cortex-m-rt's linker script defines.
    pub fn of<B: Board, C: Cost>(node: &Node<B, C>) -> Result<Self, Error> {
        let address = |symbol| node.address_of(symbol).map(|address| u32::try_from(address).unwrap_or(u32::MAX));
        let mut ram = vec![];
        for (start, end) in [("__sdata", "__edata"), ("__sbss", "__ebss"), ("__suninit", "__euninit")] {
            ram.push(address(start)?..address(end)?);
        }
        ram.push(node.register(13)..address("_stack_start")?);
        ram.retain(|range| !range.is_empty());
        let flash = std::iter::once(address("__vector_table")?..address("__program_crc")? + 4).collect();
        Ok(Self { ram, flash })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use stm32f429::{Oscillators, Stm32f429};

    use super::*;
    use emulator_node::{Bare, Firmware};

    fn node() -> Node<Bare<Stm32f429>> {
        let table: Vec<u8> = [0x2000_1000_u32, 0x0800_0009].iter().flat_map(|word| word.to_le_bytes()).collect();
        let image = Firmware::raw("idle", vec![(0x0800_0000, table), (0x0800_0008, vec![0xFE, 0xE7])]);
        Node::new(Stm32f429::new(Oscillators::default()), Bare::new(), &image).unwrap()
    }

    fn byte(node: &Node<Bare<Stm32f429>>, address: u64) -> u8 {
        let mut byte = [0];
        node.read(address, &mut byte).unwrap();
        byte[0]
    }

    #[test]
    fn an_upset_of_memory_flips_one_bit_and_flips_it_back() {
        let mut node = node();
        for (upset, address) in [
            (Upset::Ram { address: 0x2000_0123, bit: 6 }, 0x2000_0123),
            (Upset::Flash { address: 0x0800_0008, bit: 6 }, 0x0800_0008),
        ] {
            let before = byte(&node, address);
            upset.apply(&mut node).unwrap();
            assert_eq!(byte(&node, address), before ^ 0x40);
            upset.apply(&mut node).unwrap();
            assert_eq!(byte(&node, address), before);
        }
    }

    #[test]
    fn an_upset_of_a_register_flips_one_bit_of_it_alone() {
        for number in 0..16 {
            let mut node = node();
            let before: Vec<u32> = (0..16).map(|number| node.register(number)).collect();
            Upset::Register { number, bit: 8 }.apply(&mut node).unwrap();
            for (other, before) in before.into_iter().enumerate() {
                let flipped = if other == usize::from(number) { 0x100 } else { 0 };
                assert_eq!(node.register(other), before ^ flipped, "r{other} after an upset of r{number}");
            }
        }
    }

    #[test]
    fn an_upset_where_there_is_no_memory_is_refused() {
        let upset = Upset::Ram { address: 0x1000_0000 - 1, bit: 0 };
        assert!(matches!(upset.apply(&mut node()), Err(Error::NotMemory { .. })));
    }

    #[test]
    fn an_image_without_symbols_is_refused_with_the_symbol_it_lacks() {
        assert!(matches!(Targets::of(&node()), Err(Error::NoSymbol { symbol, .. }) if symbol == "__sdata"));
    }

    #[test]
    fn drawn_upsets_reach_every_byte_of_their_targets_and_no_other() {
        let targets =
            Targets { ram: vec![0x100..0x104, 0x200..0x202], flash: std::iter::once(0x8000..0x8004).collect() };
        let mut rng = Rng::new(1);
        let mut seen = BTreeSet::new();
        for _ in 0..2_000 {
            match Upset::drawn(Kind::Ram, &mut rng, &targets).unwrap() {
                Upset::Ram { address, bit } => seen.insert((address, bit)),
                other => panic!("{other:?}"),
            };
        }
        let bytes: BTreeSet<u32> = seen.iter().map(|&(address, _)| address).collect();
        assert_eq!(bytes.into_iter().collect::<Vec<_>>(), [0x100, 0x101, 0x102, 0x103, 0x200, 0x201]);
        assert_eq!(seen.len(), 48);
        for _ in 0..100 {
            let flash = Upset::drawn(Kind::Flash, &mut rng, &targets).unwrap();
            assert!(matches!(flash, Upset::Flash { address: 0x8000..0x8004, bit: 0..8 }), "{flash:?}");
        }
    }

    #[test]
    fn drawn_upsets_reach_every_bit_of_every_register_that_is_there() {
        let mut rng = Rng::new(1);
        let seen: BTreeSet<(u8, u8)> = (0..20_000)
            .map(|_| match Upset::drawn(Kind::Registers, &mut rng, &Targets::default()).unwrap() {
                Upset::Register { number, bit } => (number, bit),
                other => panic!("{other:?}"),
            })
            .collect();
        assert_eq!(seen.len(), 16 * 32 - 3);
        assert!(!seen.contains(&(13, 1)) && !seen.contains(&(15, 0)));
    }

    #[test]
    fn nothing_is_drawn_where_there_is_nothing_to_hit() {
        let mut rng = Rng::new(1);
        assert_eq!(Upset::drawn(Kind::Ram, &mut rng, &Targets::default()), None);
        assert_eq!(Upset::drawn(Kind::Air, &mut rng, &Targets::default()), None);
    }
}
