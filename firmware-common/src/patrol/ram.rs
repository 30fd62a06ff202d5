//! The test of the RAM in use, which runs beside the program and restores the contents.
//!
//! # Design
//!
//! A step tests two neighbouring words and moves on by one word, so each word is tested with both of its neighbours.
//! The processor keeps the two words in registers meanwhile ([`Memory::exercise`]):
//!
//! ```text
//!   read both; up (read c, write not c); down (read not c, write c); read both
//! ```
//!
//! Here `c` stands for the contents. The sequence is MATS++ (A. J. van de Goor, *Testing Semiconductor Memories*, 1991)
//! with the contents for the background (M. Nicolaidis, *Theory of transparent BIST for RAMs*, IEEE Transactions on
//! Computers, 1996). It finds every bit that is stuck or does not change, and a bit that changes together with a bit of
//! the neighbouring word. The [march at the start](crate::start_test) covers bits that are coupled over a greater
//! distance, and address decoders.
//!
//! No task may read a word while it is inverted, so a step masks all interrupts, for [`MASKED_CYCLES`] at most.
//!
//! The test leaves out memory that DMA controllers or a debug probe access ([`Layout::apart`](super::Layout)), since
//! their accesses cannot be masked. All data that DMA moves carry a CRC or a checksum that is verified later; the DPR's
//! buffers are also scrubbed with zeros and ones.

use core::ops::Range;

use super::Memory;

/// The number of ranges of memory that the test can leave out.
pub const APART: usize = 12;

/// The longest time for which a step masks interrupts, processor cycles. It has eight loads and four stores of three
/// cycles each at most (two by the Cortex-M4 TRM, "Instruction set summary", and one for a bus that a DMA controller is
/// on), 15 other instructions, and six lines with four wait states each if the instructions come from flash. From RAM,
/// as on the DPR, it is 51 cycles, 0.8 µs.
pub const MASKED_CYCLES: u32 = 75;

/// The result of some steps of the test of RAM.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// The address of two words, one of which does not hold the value that is written to it.
    pub fault: Option<u32>,
    /// Whether the pass that ended in these steps found all words sound.
    pub pass: Option<bool>,
}

/// The position of the test of RAM in memory.
#[derive(Clone, Debug)]
pub struct Walk {
    at: u32,
    /// The first of the left-out ranges that still lies ahead.
    next: Range<u32>,
    sound: bool,
}

impl Default for Walk {
    fn default() -> Self {
        Self::new()
    }
}

impl Walk {
    /// Returns the position before the first pass of the test.
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
        // Not covered: the ranges are constants, so that at each place where the test looks for the next range, most
        // comparisons have only one outcome. The compiler has unrolled the loop for each such place.
        for range in apart {
            if range.end > self.at && range.start < self.next.start {
                self.next = range.clone();
            }
        }
    }

    /// Makes the next `steps` steps of the test in `used`. The ranges `apart`, in any order, are left out. Skipping one
    /// of these ranges takes one step.
    pub fn run(&mut self, steps: u32, used: &Range<u32>, apart: &[Range<u32>], memory: &mut impl Memory) -> Found {
        let mut found = Found::default();
        // Not covered: only this line, a slice without steps: the rate is a constant above 0.
        for _ in 0..steps {
            if self.at < used.start {
                self.at = used.start;
                // Not covered: only this line, the search from the beginning, in the copies in which its constant
                // ranges have one outcome, as in `seek`.
                self.seek(apart);
            }
            if self.at + 8 > self.next.start {
                // The test goes on at the first whole word after the left-out range.
                self.at = (self.next.end + 3) & !3;
                self.seek(apart);
            // Not covered: no room for two words: the step before begins the pass anew then.
            } else if self.at + 8 <= used.end {
                if memory.exercise(self.at) != 0 {
                    found.fault = Some(self.at);
                    self.sound = false;
                }
                self.at += 4;
            }
            // Not covered: an end behind a left-out range: no such range reaches the end of the RAM in use.
            if self.at + 8 > used.end {
                found.pass = Some(self.sound);
                self.restart();
            }
        }
        found
    }
}
