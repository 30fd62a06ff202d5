//! RAM that is in use: tested while the program runs, and left as it was found.
//!
//! # Design
//!
//! A step tests two neighbouring words and moves on by one, so each word is tested beside both of its neighbours. The
//! processor keeps the two words in registers meanwhile ([`Memory::exercise`]):
//!
//! ```text
//!   read both; up (read c, write not c); down (read not c, write c); read both
//! ```
//!
//! with `c` what was found. That is MATS++ (A. J. van de Goor, *Testing Semiconductor Memories*, 1991) with the
//! contents for the background (M. Nicolaidis, *Theory of transparent BIST for RAMs*, IEEE Transactions on Computers,
//! 1996). It finds every bit that is stuck or does not change, in either direction, and one that changes with a bit of
//! the word beside it. What is coupled over a greater distance, and address decoders, are the business of the [march at
//! the start](crate::start_test).
//!
//! No task may see a word while it is inverted, so a step masks all interrupts. What it takes is the longest time for
//! which the patrol holds an interrupt up: [`MASKED_CYCLES`].
//!
//! Memory that something else than the processor reads or writes is left out ([`Layout::apart`](super::Layout)), since
//! nothing masks that: what DMA controllers reach, and what a debug probe reads. What DMA brings or takes carries a CRC
//! or a checksum that is verified behind it; the DPR's buffers are scrubbed with zeros and ones besides.

use core::ops::Range;

use super::Memory;

/// Memory that is left out: so many ranges.
pub const APART: usize = 12;

/// The longest for which a step masks interrupts, cycles: eight loads and four stores of three cycles each at most
/// (Cortex-M4 TRM, "Instruction set summary", and one for a bus that a DMA controller is on), 15 other instructions,
/// and where they come from flash six lines with four wait states each. From RAM, as on the DPR, it is 51 cycles, 0.8
/// µs.
pub const MASKED_CYCLES: u32 = 75;

/// What a step found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// The address of two words of which one does not hold what is written.
    pub fault: Option<u32>,
    /// A pass is complete: whether all words were sound.
    pub pass: Option<bool>,
}

/// Where the test is.
#[derive(Clone, Debug)]
pub struct Walk {
    at: u32,
    /// The first memory that is left out and is not behind.
    next: Range<u32>,
    sound: bool,
}

impl Default for Walk {
    fn default() -> Self {
        Self::new()
    }
}

impl Walk {
    /// Before the first pass.
    #[must_use]
    pub const fn new() -> Self {
        Self { at: 0, next: 0..0, sound: true }
    }

    /// Begins the pass anew.
    pub fn restart(&mut self) {
        *self = Self::new();
    }

    fn seek(&mut self, apart: &[Range<u32>]) {
        self.next = u32::MAX..u32::MAX;
        for range in apart {
            if range.end > self.at && range.start < self.next.start {
                self.next = range.clone();
            }
        }
    }

    /// The next `steps` steps in `used`, but for the ranges `apart`, which come in any order. One over memory that is
    /// left out counts as one.
    pub fn run(&mut self, steps: u32, used: &Range<u32>, apart: &[Range<u32>], memory: &mut impl Memory) -> Found {
        let mut found = Found::default();
        for _ in 0..steps {
            if self.at < used.start {
                self.at = used.start;
                self.seek(apart);
            }
            if self.at + 8 > self.next.start {
                // To the next whole word.
                self.at = (self.next.end + 3) & !3;
                self.seek(apart);
            } else if self.at + 8 <= used.end {
                if memory.exercise(self.at) != 0 {
                    found.fault = Some(self.at);
                    self.sound = false;
                }
                self.at += 4;
            }
            if self.at + 8 > used.end {
                found.pass = Some(self.sound);
                self.restart();
            }
        }
        found
    }
}
