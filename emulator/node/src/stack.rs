//! The amount of stack that a firmware used.
//!
//! The stack is filled with a pattern before the first instruction. Bytes that no longer hold the pattern were used.
//! Bytes that were reserved and never written do not count, nor does a process stack in other memory.

use cortex_m4::Cost;
use emulator_part::Part;

use super::{Board, Firmware, Node, memory};

const PATTERN: u8 = 0xA5;

/// The address range of a firmware's stack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stack {
    /// The lowest address of the stack: the end of what the image has below it, or the start of RAM.
    pub bottom: u32,
    /// The initial stack pointer.
    pub top: u32,
}

impl Stack {
    /// Finds the stack of an image on this part. Returns `None` if the image has no symbols for RAM, or has a stack
    /// pointer outside RAM.
    #[must_use]
    pub fn of<P: Part>(firmware: &Firmware, part: &P) -> Option<Self> {
        let vectors = u64::from(part.core().vector_table);
        let top = u32::try_from(memory::value(part, vectors, 4)?).ok()?;
        let &(ram, _) = P::RAM.iter().find(|&&(start, size)| top > start && (top - start) as usize <= size)?;
        // With flip-link the stack is lowest in RAM.
        let bottom = firmware.placed_below(ram, top)?;
        (bottom < top).then_some(Self { bottom, top })
    }

    /// Fills the stack with the pattern.
    pub fn paint<P: Part>(self, part: &mut P) {
        if let Some(bytes) = part.memory_mut(self.bottom, self.size()) {
            bytes.fill(PATTERN);
        }
    }

    /// The number of bytes from the bottom to the top.
    #[must_use]
    pub const fn size(self) -> usize {
        (self.top - self.bottom) as usize
    }

    /// The number of bytes from the top to the lowest byte that was written.
    #[must_use]
    pub fn used<P: Part>(self, part: &P) -> usize {
        self.used_of(part, PATTERN)
    }

    fn used_of<P: Part>(self, part: &P, filled: u8) -> usize {
        let bytes = part.memory(self.bottom, self.size()).unwrap_or_default();
        let unused = bytes.iter().take_while(|&&byte| byte == filled).count();
        bytes.len() - unused
    }
}

impl<B: Board, C: Cost> Node<B, C> {
    /// The stack of this node's firmware, see [`Stack::of`].
    #[must_use]
    pub fn stack(&self) -> Option<Stack> {
        Stack::of(&self.firmware, &self.side.part)
    }

    /// The number of bytes from the top of `stack` to the lowest byte that is not zero, for a firmware that clears its
    /// stack at the start. The `guard` bytes at the bottom do not count.
    #[must_use]
    pub fn stack_touched(&self, stack: Stack, guard: u32) -> usize {
        Stack { bottom: stack.bottom + guard, ..stack }.used_of(&self.side.part, 0)
    }
}
