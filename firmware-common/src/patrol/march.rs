//! March C- over RAM that nothing uses.
//!
//! # Design
//!
//! March C- (A. J. van de Goor, *Testing Semiconductor Memories*, 1991) visits every cell six times, with `a` the
//! background and `b` its complement:
//!
//! ```text
//!   either way (write a); up (read a, write b); up (read b, write a);
//!   down (read a, write b); down (read b, write a); either way (read a)
//! ```
//!
//! It finds all stuck-at, transition and address decoder faults, and all unlinked coupling faults between cells of
//! different words. For those between two bits of one word a background must give them different values: each pass
//! takes the next of six backgrounds, log2(32) + 1 (van de Goor and Tlili, *March tests for word-oriented memories*,
//! DATE 1998).
//!
//! The test owns its memory and nothing else changes it, so it may stop after any word and go on later.

use core::ops::Range;

use super::Memory;

/// Elements of the test: visits of each word in one pass.
pub const ELEMENTS: u32 = 6;

/// The backgrounds, one for each pass.
pub const BACKGROUNDS: [u32; 6] = [0, 0x5555_5555, 0x3333_3333, 0x0F0F_0F0F, 0x00FF_00FF, 0x0000_FFFF];

/// What some steps found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// Bits that did not read as they were written.
    pub errors: u32,
    /// A pass is complete: how many wrong bits it has found.
    pub pass: Option<u32>,
}

/// Where the test is.
#[derive(Clone, Debug)]
pub struct March {
    range: Range<u32>,
    element: u32,
    /// Words of this element that were visited.
    visited: u32,
    background: usize,
    errors: u32,
}

impl March {
    /// At the beginning, over the words of `range`.
    #[must_use]
    pub const fn new(range: Range<u32>) -> Self {
        Self { range, element: 0, visited: 0, background: 0, errors: 0 }
    }

    /// Begins the pass anew.
    pub fn restart(&mut self) {
        (self.element, self.visited, self.errors) = (0, 0, 0);
    }

    /// Visits the next `steps` words.
    pub fn run(&mut self, steps: u32, memory: &mut impl Memory) -> Found {
        let words = (self.range.end - self.range.start) / 4;
        let mut found = Found::default();
        let mut left = if words == 0 { 0 } else { steps };
        while left > 0 {
            let some = left.min(words - self.visited);
            left -= some;
            let errors = self.visit(some, memory);
            found.errors += errors;
            self.errors = self.errors.saturating_add(errors);
            self.visited += some;
            if self.visited == words {
                (self.element, self.visited) = (self.element + 1, 0);
            }
            if self.element == ELEMENTS {
                found.pass = Some(self.errors);
                self.background = (self.background + 1) % BACKGROUNDS.len();
                self.restart();
            }
        }
        found
    }

    /// Visits the next `some` words of this element; bits that were wrong.
    fn visit(&self, some: u32, memory: &mut impl Memory) -> u32 {
        let a = BACKGROUNDS.get(self.background).copied().unwrap_or(0);
        let (expected, written, up) = match self.element {
            0 => (None, Some(a), true),
            1 => (Some(a), Some(!a), true),
            2 => (Some(!a), Some(a), true),
            3 => (Some(a), Some(!a), false),
            4 => (Some(!a), Some(a), false),
            _ => (Some(a), None, true),
        };
        let (mut address, step) = if up {
            (self.range.start + 4 * self.visited, 4)
        } else {
            (self.range.end - 4 - 4 * self.visited, 4_u32.wrapping_neg())
        };
        let mut errors = 0;
        for _ in 0..some {
            // The processor has no instruction that counts bits: they are counted where there are any.
            errors += match expected.map_or(0, |expected| memory.load(address) ^ expected) {
                0 => 0,
                wrong => wrong.count_ones(),
            };
            if let Some(word) = written {
                memory.store(address, word);
            }
            address = address.wrapping_add(step);
        }
        errors
    }
}
