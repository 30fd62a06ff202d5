//! Access to the part's own memory, as the linker has laid it out (target only).

use core::ops::Range;

use super::{ram::APART, Layout, Memory};
use crate::{
    memory::{self, address},
    program::Comparison,
};

/// The memory of the microcontroller on which the firmware runs.
#[derive(Debug)]
pub struct PartMemory(());

impl PartMemory {
    /// Returns the access to memory. To be called once. This call and every slice of the patrol must be in thread mode
    /// with no interrupt masked.
    #[must_use]
    pub fn take() -> Self {
        Self(())
    }

    /// Compares the program in flash with its CRC at once, without the state of a patrol. This takes at most 50
    /// processor cycles a word, and does not need that the memory protection unit allows loads.
    #[must_use]
    pub fn compare(&self) -> Comparison {
        Comparison::of(memory::program().step_by(4).map(memory::load_shut), memory::stored_crc())
    }
}

impl Memory for PartMemory {
    fn load(&self, address: u32) -> u32 {
        memory::load(address)
    }

    fn load_shut(&self, address: u32) -> u32 {
        memory::load_shut(address)
    }

    fn store(&mut self, address: u32, word: u32) {
        memory::store(address, word);
    }

    fn exercise(&mut self, address: u32) -> u32 {
        memory::exercise(address)
    }
}

/// Returns the log's control block and buffer, which a debug probe accesses. `defmt-rtt` has one channel.
fn log() -> [Range<u32>; 2] {
    /// The length of SEGGER's control block, bytes: 16 of name, two counts, and a channel of six words. The channel's
    /// second word is the buffer's address, and its third word is the buffer's size.
    const BLOCK: u32 = 48;
    const BUFFER: u32 = 28;
    let block = address!(_SEGGER_RTT);
    let buffer = memory::load(block + BUFFER);
    [block..block + BLOCK, buffer..buffer + memory::load(block + BUFFER + 4)]
}

/// Returns the layout of the memory that the patrol verifies. `shut_end` is the end of the flash that the memory
/// protection unit has shut. `apart` are the ranges of RAM, besides the log, that other hardware than the processor
/// accesses.
#[must_use]
pub fn layout(shut_end: u32, apart: [Range<u32>; APART - 2]) -> Layout {
    let mut all = [const { 0..0 }; APART];
    for (to, from) in all.iter_mut().zip(apart.into_iter().chain(log())) {
        *to = from;
    }
    #[cfg(feature = "hot")]
    let (code, code_load) = (address!(__shot)..address!(__ehot), address!(__sihot));
    #[cfg(not(feature = "hot"))]
    let (code, code_load) = (0..0, 0);
    Layout {
        program: memory::program(),
        shut_end,
        code,
        code_load,
        guards: [
            address!(_stack_end),
            address!(__guard_data),
            address!(__guard_bss),
            address!(__guard_uninit),
            address!(__guard_end),
        ],
        used: address!(__ram_start)..address!(__ram_end),
        apart: all,
    }
}
