//! Guard words: a write beyond the end of a static, or an overflow of the stack, changes them first.
//!
//! There are two guard words before `.data`, between `.data` and `.bss`, between `.bss` and `.uninit`, behind `.uninit`
//! (`guards.x`), and at the end of the stack. The value of each word follows from its address, so a copied block of
//! memory does not restore it. No value is 0 or that of erased flash.

use super::Memory;

/// The number of guards on a board.
pub const COUNT: usize = 5;

/// The number of words in a guard.
pub const WORDS: u32 = 2;

const fn value(address: u32) -> u32 {
    // The constant has as many ones as zeros, and its four bytes differ.
    !address ^ 0x9E37_79B9
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Guards([u32; COUNT]);

impl Guards {
    /// Writes guards at these addresses.
    pub(super) fn set(addresses: [u32; COUNT], memory: &mut impl Memory) -> Self {
        for address in words(&addresses) {
            memory.store(address, value(address));
        }
        Self(addresses)
    }

    /// Returns the number of a guard that has changed; `None` if none has. All guards are read, whatever is found.
    pub(super) fn changed(&self, memory: &impl Memory) -> Option<u32> {
        let mut changed = None;
        for (index, address) in words(&self.0).enumerate() {
            if memory.load(address) != value(address) {
                changed = Some(index as u32 / WORDS);
            }
        }
        changed
    }
}

fn words(addresses: &[u32; COUNT]) -> impl Iterator<Item = u32> + '_ {
    addresses.iter().flat_map(|address| (0..WORDS).map(move |word| address + 4 * word))
}
