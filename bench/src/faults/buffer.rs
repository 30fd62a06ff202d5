//! Bits of the DPR's buffers: the memory that frames are received into, and that images are read from.
//!
//! Which bit is drawn from a word of random numbers when the fault begins, over all buffers of a kind, each bit as
//! likely as the others. Where the buffers are is known from the image's symbols.

use bench_judge::disturbance::Memory;
use cortex_m4::Cost;
use emulator_part::{Part, StuckBit};

use super::Upset;
use emulator_node::{Board, Error, Node};

/// Which of the DPR's buffers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Buffers {
    /// Those that frames are received into.
    Receive,
    /// Those that the SSI reads images from.
    Image,
}

impl Buffers {
    /// The firmware's variable that holds all of them.
    const fn variable(self) -> &'static str {
        match self {
            Self::Receive => "__rtic_internal_local_init_receive",
            Self::Image => "__rtic_internal_local_init_images",
        }
    }
}

/// A fault of a bit of the DPR's buffers. The word says which bit it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BufferFault {
    /// It flips once.
    Flips(Buffers, u64),
    /// It reads this value, whatever is written, until the episode's end.
    Stuck(Buffers, bool, u64),
}

impl BufferFault {
    /// What the event log calls it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Flips(Buffers::Receive, _) => "receive bit flips",
            Self::Flips(Buffers::Image, _) => "image bit flips",
            Self::Stuck(Buffers::Receive, ..) => "receive bit stuck",
            Self::Stuck(Buffers::Image, ..) => "image bit stuck",
        }
    }

    /// Where the bit is.
    #[must_use]
    pub const fn memory(self) -> Memory {
        match self {
            Self::Flips(Buffers::Receive, _) | Self::Stuck(Buffers::Receive, ..) => Memory::Receive,
            Self::Flips(Buffers::Image, _) | Self::Stuck(Buffers::Image, ..) => Memory::Images,
        }
    }

    /// Whether it lasts: a bit that flips does so as the episode begins.
    #[must_use]
    pub const fn lasts(self) -> bool {
        matches!(self, Self::Stuck(..))
    }

    /// It begins on `node` now.
    ///
    /// # Errors
    ///
    /// [`Error::NoSymbol`] where the image has no such buffers, [`Error::NotMemory`] where they are not in RAM.
    pub fn begin<B: Board, C: Cost>(self, node: &mut Node<B, C>) -> Result<(), Error> {
        match self {
            Self::Flips(buffers, word) => {
                let (address, bit) = place(node, buffers, word)?;
                Upset::Ram { address, bit }.apply(node)
            }
            Self::Stuck(buffers, value, word) => {
                let (address, bit) = place(node, buffers, word)?;
                let stuck = Some(StuckBit { address, bit, value });
                let has = node.input(|part, _, _| part.stick(stuck));
                if has { Ok(()) } else { Err(Error::NotMemory { address: u64::from(address), length: 1 }) }
            }
        }
    }

    /// It ends on `node` now: the bit keeps its value until something is written there.
    pub fn end<B: Board, C: Cost>(self, node: &mut Node<B, C>) {
        if self.lasts() {
            node.input(|part, _, _| part.stick(None));
        }
    }
}

/// The byte's address, and the bit in it, that `word` picks of all `buffers`.
fn place<B: Board, C: Cost>(node: &Node<B, C>, buffers: Buffers, word: u64) -> Result<(u32, u8), Error> {
    let symbol = buffers.variable();
    let missing = || Error::NoSymbol { firmware: node.firmware().name().to_owned(), symbol: symbol.to_owned() };
    let variable = node.firmware().variable_called(symbol).ok_or_else(missing)?;
    let bits = variable.size.max(1) * 8;
    let nth = word % bits;
    let address = u32::try_from(variable.address + nth / 8).unwrap_or(u32::MAX);
    Ok((address, (nth % 8) as u8))
}
