//! How deep a firmware's stack went.
//!
//! The memory between the stack's bottom and its top is filled with a pattern before the first instruction, as a
//! debugger does it on a board; what no longer holds it was used. Bytes that were reserved and never written do not
//! count, nor does a stack that the process stack pointer has elsewhere.

use emulator_part::Part;

use super::{Firmware, memory};

/// What unused stack holds.
const PATTERN: u8 = 0xA5;

/// Where a firmware's stack is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stack {
    /// Its lowest address: the end of what the image places below it, or the start of RAM.
    pub bottom: u32,
    /// What the stack pointer starts with.
    pub top: u32,
}

impl Stack {
    /// The stack of an image on this part; `None` where the image has no symbols that say what is in RAM, or a stack
    /// pointer outside RAM.
    #[must_use]
    pub fn of<P: Part>(firmware: &Firmware, part: &P) -> Option<Self> {
        let vectors = u64::from(part.core().vector_table);
        let top = u32::try_from(memory::value(part, vectors, 4)?).ok()?;
        let &(ram, _) = P::RAM.iter().find(|&&(start, size)| top > start && (top - start) as usize <= size)?;
        // With flip-link nothing is below it, and the bottom is where RAM begins.
        let bottom = firmware.placed_below(ram, top)?;
        (bottom < top).then_some(Self { bottom, top })
    }

    /// Fills it with the pattern.
    pub fn paint<P: Part>(self, part: &mut P) {
        if let Some(bytes) = part.memory_mut(self.bottom, self.size()) {
            bytes.fill(PATTERN);
        }
    }

    /// Bytes from the bottom to the top.
    #[must_use]
    pub const fn size(self) -> usize {
        (self.top - self.bottom) as usize
    }

    /// Bytes from the top to the lowest that was written.
    #[must_use]
    pub fn used<P: Part>(self, part: &P) -> usize {
        let bytes = part.memory(self.bottom, self.size()).unwrap_or_default();
        let unused = bytes.iter().take_while(|&&byte| byte == PATTERN).count();
        bytes.len() - unused
    }
}
