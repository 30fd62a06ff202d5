//! Damage to the code or the variables of a program in a board's memory.
//!
//! [`ImageFault::apply`] damages a board's memory while its core runs, as a debugger could, and returns the [`Repair`].
//! [`rewrite()`] changes the stores to peripheral registers that a [`Recording`] of the program has found.

mod constant;
mod record;
mod rewrite;

pub use record::{Recording, Stored};
pub use rewrite::{Change, RewriteError, To, rewrite};

use cortex_m4::Cost;

use emulator_node::{Board, Error, Node};

/// A defect of a program in a board's memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ImageFault {
    /// The handler of this vector, or the function of this name, returns at once.
    Dead(String),
    /// The handler of this vector, or the function of this name, never returns.
    Hung(String),
    /// The handler of this vector, or the function of this name, begins with an undefined instruction.
    Faulting(String),
    /// The instruction at this address is a branch to itself.
    Stopped(u32),
    /// A variable or table, given by its symbol, holds these bytes from this offset on.
    Poke {
        /// The variable's symbol as in the program's symbol table, or the end of its path: `cycle_timer::TICKS`.
        symbol: String,
        /// The offset of the changed bytes from the variable's first byte.
        offset: u32,
        /// The bytes that the variable holds at the offset while it is damaged.
        bytes: Vec<u8>,
    },
    /// A sequence of bytes, which must occur exactly once in a function's code and literals, is replaced.
    Replaced {
        /// The function: the symbol of a handler, or the end of a function's path.
        function: String,
        /// The original bytes, which begin at an even address.
        was: Vec<u8>,
        /// The new bytes, as many as the original ones.
        is: Vec<u8>,
    },
    /// Every comparison of a register with this constant in a function's code compares with another constant.
    Compared {
        /// The function: the symbol of a handler, or the end of a function's path.
        function: String,
        /// The constant in the original code.
        with: u8,
        /// The new constant.
        value: u8,
    },
    /// A constant is replaced wherever it occurs in the program's code and tables, and the program's CRC is corrected.
    Constant {
        /// The original constant.
        of: u32,
        /// The new constant.
        value: u32,
    },
    /// Given bytes are written to memory, which may be flash.
    Patch {
        /// The first byte's address.
        address: u32,
        /// The bytes that are written.
        bytes: Vec<u8>,
        /// Whether the program's CRC is corrected, so that the firmware's own check of its flash passes.
        sealed: bool,
    },
}

/// The instruction `BX LR`: a handler returns without any effect and without acknowledging its interrupt.
const RETURN: u16 = 0x4770;
const BRANCH_TO_ITSELF: u16 = 0xE7FE;
const UNDEFINED: u16 = 0xDE00;

impl ImageFault {
    /// Returns the fault's name in the event log.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Dead(handler) => format!("{handler} dead"),
            Self::Hung(handler) => format!("{handler} hung"),
            Self::Faulting(handler) => format!("{handler} faulting"),
            Self::Stopped(address) => format!("stopped at {address:#010x}"),
            Self::Poke { symbol, offset, .. } => format!("{symbol}+{offset:#x} overwritten"),
            Self::Replaced { function, .. } | Self::Compared { function, .. } => format!("{function} changed"),
            Self::Constant { of, value } => format!("{value:#x} for {of:#x}"),
            Self::Patch { address, .. } => format!("{address:#010x} overwritten"),
        }
    }

    /// Damages `node`'s memory now.
    ///
    /// # Errors
    ///
    /// [`Error::NoSymbol`] if the program has no such handler, function, variable or constant, [`Error::NotMemory`] if
    /// an address is outside the memory, [`Error::NoPlace`] if the bytes to replace do not occur exactly once.
    #[inline(never)]
    pub fn apply<B: Board, C: Cost>(&self, node: &mut Node<B, C>) -> Result<Repair, Error> {
        let code = |node: &mut Node<B, C>, address, instruction: u16| {
            Repair::after_writing(node, address, &instruction.to_le_bytes())
        };
        match self {
            Self::Dead(name) => code(node, entry(node, name)?, RETURN),
            Self::Hung(name) => code(node, entry(node, name)?, BRANCH_TO_ITSELF),
            Self::Faulting(name) => code(node, entry(node, name)?, UNDEFINED),
            Self::Stopped(address) => code(node, u64::from(*address), BRANCH_TO_ITSELF),
            Self::Poke { symbol, offset, bytes } => poke(node, symbol, *offset, bytes),
            Self::Replaced { function, was, is } => {
                let address = place_of(node, function, was)?;
                Repair::after_writing(node, address, is)
            }
            Self::Compared { function, with, value } => {
                let mut repair = Repair::default();
                for address in comparisons(node, function, *with)? {
                    repair.0.extend(Repair::after_writing(node, address, &[*value])?.0);
                }
                Ok(repair)
            }
            Self::Constant { of, value } => constant::replace(node, *of, *value),
            Self::Patch { address, bytes, sealed } => {
                let mut repair = Repair::after_writing(node, u64::from(*address), bytes)?;
                if *sealed {
                    repair.0.extend(seal(node)?.0);
                }
                Ok(repair)
            }
        }
    }
}

/// The original contents of the damaged memory.
#[must_use = "the damage stays without it"]
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Repair(Vec<(u64, Vec<u8>)>);

impl Repair {
    /// Writes `bytes` to memory at `address`. If the firmware runs a copy of this code in RAM, both are written.
    fn after_writing<B: Board, C: Cost>(node: &mut Node<B, C>, address: u64, bytes: &[u8]) -> Result<Self, Error> {
        let mut repair = Self::default();
        for address in std::iter::once(address).chain(twin(node, address)) {
            let mut was = vec![0; bytes.len()];
            node.read(address, &mut was)?;
            node.write(address, bytes)?;
            repair.0.push((address, was));
        }
        Ok(repair)
    }

    /// Restores the overwritten bytes.
    ///
    /// # Errors
    ///
    /// [`Error::NotMemory`] if `node` has no memory at an address that is to be damaged.
    #[inline(never)]
    pub fn mend<B: Board, C: Cost>(&self, node: &mut Node<B, C>) -> Result<(), Error> {
        self.0.iter().rev().try_for_each(|(address, was)| node.write(*address, was))
    }
}

/// Returns the second address of code that the firmware copies from flash to RAM. For an address in flash it is the one
/// in RAM, and for an address in RAM the one in flash.
#[inline(never)]
fn twin<B: Board, C: Cost>(node: &Node<B, C>, address: u64) -> Option<u64> {
    let [start, end, load] = ["__shot", "__ehot", "__sihot"].map(|symbol| node.address_of(symbol).ok());
    let (start, end, load) = (start?, end?, load?);
    let from = |place: u64| address.checked_sub(place).filter(|offset| *offset < end - start);
    from(start).map(|offset| load + offset).or_else(|| from(load).map(|offset| start + offset))
}

/// Returns the address in flash of a byte at `address`, even if `address` is in the copy of the code in RAM.
fn stored<B: Board, C: Cost>(node: &Node<B, C>, address: u64) -> u64 {
    let runs = node.address_of("__shot").is_ok_and(|start| address >= start);
    twin(node, address).filter(|_| runs).unwrap_or(address)
}

/// Returns the address of the first instruction of the handler or function `name`, which is a symbol or the end of a
/// function's path.
fn entry<B: Board, C: Cost>(node: &Node<B, C>, name: &str) -> Result<u64, Error> {
    let called = node.firmware().functions_called(name).next();
    node.address_of(name).or_else(|error| called.ok_or(error)).map(|address| address & !1)
}

#[inline(never)]
fn place_of<B: Board, C: Cost>(node: &Node<B, C>, name: &str, bytes: &[u8]) -> Result<u64, Error> {
    let first = entry(node, name)?;
    let mut code = vec![0; node.firmware().size_at(first)];
    node.read(stored(node, first), &mut code)?;
    let mut places = (0..code.len()).step_by(2).filter(|place| code[*place..].starts_with(bytes));
    match (places.next(), places.next()) {
        (Some(place), None) => Ok(first + place as u64),
        (found, _) => Err(Error::NoPlace {
            function: name.to_owned(),
            bytes: bytes.to_vec(),
            found: if found.is_some() { "several places" } else { "no place" },
        }),
    }
}

/// Returns the addresses of the constant `with` in instructions of the function `name` that compare a register with it.
/// There is at least one.
#[inline(never)]
fn comparisons<B: Board, C: Cost>(node: &Node<B, C>, name: &str, with: u8) -> Result<Vec<u64>, Error> {
    let first = entry(node, name)?;
    let end = first + node.firmware().size_at(first) as u64;
    let (mut pc, mut places) = (first, vec![]);
    while pc < end {
        let (one, two) = record::halves(node, pc as u32);
        // CMP with a constant has encodings T1 and T2 (ARMv7-M ARM A7.7.27). The constant is the lowest byte of a
        // halfword.
        let (narrow, wide) = (one & 0xF8FF == 0x2800 | u16::from(with), two == 0x0F00 | u16::from(with));
        if narrow {
            places.push(pc);
        } else if one & 0xFFF0 == 0xF1B0 && wide {
            places.push(pc + 2);
        }
        pc += if record::is_wide(one) { 4 } else { 2 };
    }
    if places.is_empty() {
        return Err(Error::NoPlace { function: name.to_owned(), bytes: vec![with], found: "no place" });
    }
    Ok(places)
}

/// Overwrites the variable `symbol` from byte `offset` on.
///
/// # Errors
///
/// [`Error::NoSymbol`] if the program has no such variable, [`Error::NotMemory`] if the bytes reach beyond the memory.
pub fn poke<B: Board, C: Cost>(
    node: &mut Node<B, C>,
    symbol: &str,
    offset: u32,
    bytes: &[u8],
) -> Result<Repair, Error> {
    let called = node.firmware().symbol_called(symbol);
    let address = node.address_of(symbol).or_else(|error| called.ok_or(error))? + u64::from(offset);
    Repair::after_writing(node, address, bytes)
}

/// Corrects the CRC of `node`'s program to match the present contents of flash, as the build does.
///
/// # Errors
///
/// [`Error::NoSymbol`] if the program has no vector table or no CRC.
#[inline(never)]
pub fn seal<B: Board, C: Cost>(node: &mut Node<B, C>) -> Result<Repair, Error> {
    let (first, end) = (node.address_of("__vector_table")?, node.address_of("__program_crc")?);
    let mut image = vec![0; usize::try_from(end.saturating_sub(first)).unwrap_or(0)];
    node.read(first, &mut image)?;
    Repair::after_writing(node, end, &profile::crc::frame(&image).to_be_bytes())
}
