//! Upsets: single bits that flip.

use std::ops::Range;

use bench_judge::disturbance::Memory;
use cortex_m4::{Cost, Register};
use emulator_part::{Part, StuckBit};

use super::{Kind, Rng};
use emulator_node::{Board, Error, Firmware, Node};

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
    /// A bit of the RAM into which a board receives: its buffers of frames, or of what GNSS receivers send.
    Received {
        /// The byte's address.
        address: u32,
        /// The bit's number, 0 to 7.
        bit: u8,
    },
    /// A bit of RAM that reads this value from now on, even after a write of the other value. It releases any bit that
    /// was stuck before.
    Stuck {
        /// The byte's address.
        address: u32,
        /// The bit's number, 0 to 7.
        bit: u8,
        /// The value that the bit reads.
        value: bool,
    },
    /// A bit of flash.
    Flash {
        /// The byte's address.
        address: u32,
        /// The bit's number, 0 to 7.
        bit: u8,
    },
    /// A bit of a core register.
    Register {
        /// The register's index in [`CORE_REGISTERS`].
        number: u8,
        /// The bit's number, 0 to 31.
        bit: u8,
    },
    /// A bit of a register of a peripheral or of the core's system control space.
    Peripheral {
        /// The register's address, a multiple of 4.
        address: u32,
        /// The bit's number, 0 to 31.
        bit: u8,
    },
}

/// The core's registers in which bits flip, each with the mask of its bits: R0 to R15, the program status register, the
/// exception masks, CONTROL, the stack pointers, and the floating-point registers.
pub const CORE_REGISTERS: [(Register, u32); 56] = {
    let mut all = [(Register::Fpscr, 0xF7C0_009F); 56];
    let mut number = 0;
    while number < 16 {
        // The two lowest bits of SP and the lowest of PC always read zero (ARMv7-M ARM B1.4.1).
        let bits = match number {
            13 => !3,
            15 => !1,
            _ => u32::MAX,
        };
        all[number as usize] = (Register::R(number), bits);
        number += 1;
    }
    let special = [
        (Register::Xpsr, 0xF80F_0000),
        (Register::Primask, 1),
        (Register::Basepri, 0xE0),
        (Register::Faultmask, 1),
        (Register::Control, 7),
        (Register::Msp, !3),
        (Register::Psp, !3),
    ];
    let mut nth = 0;
    while nth < special.len() {
        all[16 + nth] = special[nth];
        nth += 1;
    }
    let mut number = 0;
    while number < 32 {
        all[23 + number as usize] = (Register::S(number), u32::MAX);
        number += 1;
    }
    all
};

impl Upset {
    /// Returns the upset's name in the event log.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Ram { .. } | Self::Received { .. } | Self::Stuck { .. } => "ram",
            Self::Flash { .. } => "flash",
            Self::Register { .. } => "register",
            Self::Peripheral { .. } => "peripheral",
        }
    }

    /// The kind of memory that holds the upset bit.
    #[must_use]
    pub const fn memory(&self) -> Memory {
        match self {
            Self::Ram { .. } | Self::Stuck { .. } => Memory::Ram,
            Self::Received { .. } => Memory::Receive,
            Self::Flash { .. } => Memory::Flash,
            Self::Register { .. } => Memory::Registers,
            Self::Peripheral { .. } => Memory::Peripherals,
        }
    }

    /// Returns the kind's name in `--faults`.
    #[must_use]
    pub const fn kind(&self) -> Kind {
        match self {
            Self::Ram { .. } | Self::Received { .. } | Self::Stuck { .. } => Kind::Ram,
            Self::Flash { .. } => Kind::Flash,
            Self::Register { .. } => Kind::Registers,
            Self::Peripheral { .. } => Kind::Peripherals,
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
                let bits: u32 = CORE_REGISTERS.iter().map(|(_, bits)| bits.count_ones()).sum();
                let mut nth = rng.below(u64::from(bits)) as u32;
                let (number, (_, bits)) = (0..).zip(CORE_REGISTERS).find(|(_, (_, bits))| {
                    let is_here = nth < bits.count_ones();
                    nth = if is_here { nth } else { nth - bits.count_ones() };
                    is_here
                })?;
                let bit = (0..32).filter(|bit| bits >> bit & 1 != 0).nth(nth as usize)?;
                Some(Self::Register { number, bit })
            }
            Kind::Peripherals => None,
            Kind::Air
            | Kind::Gnss
            | Kind::FlightController
            | Kind::Power
            | Kind::Buffers
            | Kind::Inputs
            | Kind::Hang
            | Kind::Chips
            | Kind::Hold
            | Kind::Bits
            | Kind::Spi
            | Kind::Drift
            | Kind::Hostile => None,
        }
    }

    /// Returns a uniformly drawn upset of `kind` in what `node`'s firmware uses now; `None` if there is none.
    #[inline(never)]
    pub fn drawn_on<B: Board, C: Cost>(kind: Kind, rng: &mut Rng, node: &Node<B, C>) -> Option<Self> {
        match kind {
            Kind::Peripherals => a_stored_bit(rng, node),
            _ => Some(match Self::drawn(kind, rng, &Targets::of(node).ok()?)? {
                Self::Ram { address, bit } if is_received(node.firmware(), address) => Self::Received { address, bit },
                upset => upset,
            }),
        }
    }

    /// Flips the bit on `node` now.
    ///
    /// # Errors
    ///
    /// [`Error::NotMemory`] if there is no memory at the address.
    #[inline(never)]
    pub fn apply<B: Board, C: Cost>(&self, node: &mut Node<B, C>) -> Result<(), Error> {
        match *self {
            Self::Ram { address, bit } | Self::Received { address, bit } | Self::Flash { address, bit } => {
                let mut byte = [0];
                node.read(u64::from(address), &mut byte)?;
                node.write(u64::from(address), &[byte[0] ^ 1 << (bit & 7)])
            }
            Self::Stuck { address, bit, value } => {
                let stuck = Some(StuckBit { address, bit, value });
                let has = node.input(|part, _, _| part.stick(stuck));
                if has { Ok(()) } else { Err(Error::NotMemory { address: u64::from(address), length: 1 }) }
            }
            Self::Register { number, bit } => {
                let (register, _) = CORE_REGISTERS[usize::from(number) % CORE_REGISTERS.len()];
                node.set_core_register(register, node.core_register(register) ^ 1 << (bit & 31));
                Ok(())
            }
            Self::Peripheral { address, bit } => {
                let mut word = [0; 4];
                let refused = Error::NotMemory { address: u64::from(address), length: word.len() };
                if node.peek(address, &mut word) < word.len() {
                    return Err(refused);
                }
                node.poke(address, &(u32::from_le_bytes(word) ^ 1 << (bit & 31)).to_le_bytes())
            }
        }
    }
}

impl std::fmt::Display for Upset {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Ram { address, bit } | Self::Received { address, bit } => write!(f, "RAM {address:#010x} bit {bit}"),
            Self::Stuck { address, bit, value } => {
                write!(f, "RAM {address:#010x} bit {bit} stuck at {}", u8::from(*value))
            }
            Self::Flash { address, bit } => write!(f, "flash {address:#010x} bit {bit}"),
            Self::Register { number, bit } => match CORE_REGISTERS[usize::from(*number) % CORE_REGISTERS.len()].0 {
                Register::R(13) => write!(f, "SP bit {bit}"),
                Register::R(14) => write!(f, "LR bit {bit}"),
                Register::R(15) => write!(f, "PC bit {bit}"),
                Register::R(number) => write!(f, "R{number} bit {bit}"),
                Register::S(number) => write!(f, "S{number} bit {bit}"),
                special => write!(f, "{special:?} bit {bit}"),
            },
            Self::Peripheral { address, bit } => write!(f, "register {address:#010x} bit {bit}"),
        }
    }
}

/// The variables into which the boards receive, as [`Firmware::variable_called`] takes their names.
pub const RECEIVED: [&str; 4] = ["__rtic_internal_local_init_receive", "buffers::RINGS", "spi::IN", "ddc::BYTES"];

fn is_received(firmware: &Firmware, address: u32) -> bool {
    let variables = RECEIVED.iter().filter_map(|name| firmware.variable_called(name));
    variables.into_iter().any(|it| (it.address..it.address + it.size).contains(&u64::from(address)))
}

/// The addresses of peripheral registers in both microcontrollers, and of the core's own registers.
const REGISTERS: [Range<u32>; 5] = [
    0x4000_0000..0x4003_0000,
    0x4003_0000..0x4003_0010,
    0x5000_0000..0x5000_1000,
    0x5006_0000..0x5006_0C00,
    0xE000_E000..0xE000_F000,
];

/// Draws addresses and bits until one is a bit of a register that can be written and read back. All attempts are made
/// on a copy of `node`.
fn a_stored_bit<B: Board, C: Cost>(rng: &mut Rng, node: &Node<B, C>) -> Option<Upset> {
    const TRIES: usize = 20_000;
    let mut copy = node.clone();
    (0..TRIES).find_map(|_| {
        let (byte, _) = a_bit(rng, &REGISTERS)?;
        let (address, bit) = (byte & !3, rng.below(32) as u8);
        let before = copy.read_word(address)?;
        let flipped = before ^ 1 << bit;
        copy.poke(address, &flipped.to_le_bytes()).ok()?;
        (copy.read_word(address) == Some(flipped)).then_some(Upset::Peripheral { address, bit })
    })
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

/// The memory that a firmware uses, in which an upset may have an effect.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Targets {
    /// The ranges of RAM with the statics, the buffers of the DMA controllers, and the stack in use.
    pub ram: Vec<Range<u32>>,
    /// The ranges of flash that hold the program and its CRC.
    pub flash: Vec<Range<u32>>,
}

impl Targets {
    /// The memory that `node`'s firmware uses now.
    ///
    /// # Errors
    ///
    /// [`Error::NoSymbol`] if the program lacks the symbol of its CRC or one that cortex-m-rt's linker script defines.
    #[inline(never)]
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
    fn a_stuck_bit_reads_its_value_and_lies_in_ram() {
        let mut node = node();
        let address = 0x2000_0123;
        for value in [true, false] {
            Upset::Stuck { address, bit: 6, value }.apply(&mut node).unwrap();
            assert_eq!(byte(&node, u64::from(address)) >> 6 & 1 == 1, value);
        }
        let nowhere = Upset::Stuck { address: 0x1FFF_FFFF, bit: 6, value: true };
        assert!(matches!(nowhere.apply(&mut node), Err(Error::NotMemory { .. })));
    }

    #[test]
    fn an_upset_of_a_register_flips_one_bit_of_it_alone() {
        for (number, (register, bits)) in (0..).zip(CORE_REGISTERS) {
            let bit = 31 - bits.leading_zeros() as u8;
            let mut node = node();
            let values = |node: &Node<_>| CORE_REGISTERS.map(|(register, _)| node.core_register(register));
            let before = values(&node);
            Upset::Register { number, bit }.apply(&mut node).unwrap();
            assert_eq!(node.core_register(register), before[usize::from(number)] ^ 1 << bit, "{register:?}");
            // R13 is MSP or PSP, depending on CONTROL.
            let is_alone = |other: Register| !matches!(other, Register::R(13) | Register::Msp | Register::Psp);
            for ((other, _), (was, is)) in CORE_REGISTERS.into_iter().zip(before.into_iter().zip(values(&node))) {
                assert!(other == register || !is_alone(other) || was == is, "{other:?} after an upset of {register:?}");
            }
        }
    }

    #[test]
    fn a_drawn_upset_of_a_peripheral_can_be_read_back() {
        let (mut rng, node) = (Rng::new(1), node());
        let mut blocks = BTreeSet::new();
        for _ in 0..20 {
            let upset = Upset::drawn_on(Kind::Peripherals, &mut rng, &node).unwrap();
            let Upset::Peripheral { address, bit } = upset else { panic!("{upset:?}") };
            let mut copy = node.clone();
            upset.apply(&mut copy).unwrap();
            let word = |node: &Node<_>| {
                let mut word = [0; 4];
                assert_eq!(node.peek(address, &mut word), 4);
                u32::from_le_bytes(word)
            };
            assert_eq!(word(&copy), word(&node) ^ 1 << bit, "{upset}");
            blocks.insert(address >> 16);
        }
        assert!(blocks.len() > 1, "{blocks:x?}");
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
        let bits: BTreeSet<(u8, u8)> = (0..)
            .zip(CORE_REGISTERS)
            .flat_map(|(number, (_, bits))| {
                (0..32).filter(move |bit| bits >> bit & 1 != 0).map(move |bit| (number, bit))
            })
            .collect();
        assert_eq!(seen, bits);
        assert!(!seen.contains(&(13, 1)) && !seen.contains(&(15, 0)));
    }

    #[test]
    fn nothing_is_drawn_where_there_is_nothing_to_hit() {
        let mut rng = Rng::new(1);
        assert_eq!(Upset::drawn(Kind::Ram, &mut rng, &Targets::default()), None);
        assert_eq!(Upset::drawn(Kind::Air, &mut rng, &Targets::default()), None);
    }
}
