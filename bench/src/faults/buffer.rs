//! Faulty bits in the DPR's buffers, into which frames are received and from which images are read.
//!
//! A random number determines the faulty bit, uniformly over all buffers of a kind.

use bench_judge::disturbance::Memory;
use cortex_m4::Cost;
use emulator_part::{Part, StuckBit};

use super::Upset;
use emulator_node::{Board, Error, Node};

/// A kind of the DPR's buffers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Buffers {
    /// The DPR's buffers for received frames.
    Receive,
    /// The DPR's buffers for images, which the SSI reads.
    Image,
    /// The DPR's buffers for what the flight controller writes.
    Written,
    /// The buffers for frames of the hold, of a DPR with a second port. `--faults` draws no fault of these.
    HoldReceive,
}

impl Buffers {
    const fn variable(self) -> &'static str {
        match self {
            Self::Receive => "__rtic_internal_local_init_receive",
            Self::Image => "__rtic_internal_local_init_images",
            Self::Written => "__rtic_internal_local_init_ssi_rx",
            Self::HoldReceive => "__rtic_internal_local_init_hold_receive",
        }
    }
}

/// A fault of one bit of the DPR's buffers. The number in each variant determines the bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BufferFault {
    /// The bit flips once, at the beginning of the episode.
    Flips(Buffers, u64),
    /// The bit reads this value until the episode's end, even after a write of the other value.
    Stuck(Buffers, bool, u64),
}

impl BufferFault {
    /// Returns the fault's name in the event log.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Flips(Buffers::Receive, _) => "receive bit flips",
            Self::Flips(Buffers::Image, _) => "image bit flips",
            Self::Flips(Buffers::Written, _) => "written bit flips",
            Self::Flips(Buffers::HoldReceive, _) => "hold's receive bit flips",
            Self::Stuck(Buffers::Receive, ..) => "receive bit stuck",
            Self::Stuck(Buffers::Image, ..) => "image bit stuck",
            Self::Stuck(Buffers::Written, ..) => "written bit stuck",
            Self::Stuck(Buffers::HoldReceive, ..) => "hold's receive bit stuck",
        }
    }

    /// The kind of buffer that holds the faulty bit.
    #[must_use]
    pub const fn memory(self) -> Memory {
        match self {
            Self::Flips(Buffers::Receive, _) | Self::Stuck(Buffers::Receive, ..) => Memory::Receive,
            Self::Flips(Buffers::Image, _) | Self::Stuck(Buffers::Image, ..) => Memory::Images,
            Self::Flips(Buffers::Written | Buffers::HoldReceive, _)
            | Self::Stuck(Buffers::Written | Buffers::HoldReceive, ..) => Memory::Ram,
        }
    }

    /// Whether the fault lasts until the end of its episode. A flip occurs once, at the beginning.
    #[must_use]
    pub const fn lasts(self) -> bool {
        matches!(self, Self::Stuck(..))
    }

    /// Begins the fault on `node` now.
    ///
    /// # Errors
    ///
    /// [`Error::NoSymbol`] where the program has no buffers of this kind, [`Error::NotMemory`] where they are not in
    /// RAM.
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

    /// Ends the fault on `node` now. A bit that was stuck keeps its value until the next write.
    pub fn end<B: Board, C: Cost>(self, node: &mut Node<B, C>) {
        if self.lasts() {
            node.input(|part, _, _| part.stick(None));
        }
    }
}

fn place<B: Board, C: Cost>(node: &Node<B, C>, buffers: Buffers, word: u64) -> Result<(u32, u8), Error> {
    let symbol = buffers.variable();
    let missing = || Error::NoSymbol { firmware: node.firmware().name().to_owned(), symbol: symbol.to_owned() };
    let variable = node.firmware().variable_called(symbol).ok_or_else(missing)?;
    let bits = variable.size.max(1) * 8;
    let nth = word % bits;
    let address = u32::try_from(variable.address + nth / 8).unwrap_or(u32::MAX);
    Ok((address, (nth % 8) as u8))
}
