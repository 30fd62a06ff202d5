//! The patrol, which verifies memory all the time: flash, code in RAM, guard words, RAM in use.
//!
//! # Design
//!
//! The idle loop does one *slice* of work every [`SLICE_US`]. It makes up for missed slices, at most [`MOST_SLICES`] at
//! once ([`Pace`]). A slice does a fixed amount of work on each of four things:
//!
//! | what | how it is verified | how a mismatch is reported |
//! |---|---|---|
//! | flash, from the vector table on | its CRC, some words a slice; a verdict after each pass | [`Slice::flash`] |
//! | code that runs from RAM | compared with its load image in flash, some words a slice | [`Slice::code`] |
//! | around the statics, end of the stack | all guard words in each slice ([`guard`]) | [`Slice::guard`] |
//! | RAM in use: stack and statics | inverted and restored, some words a slice ([`ram`]) | [`Slice::ram`] |
//!
//! This module corrects nothing; the board reacts to a mismatch. CRC tables and constants lie in flash or in the RAM of
//! the code, and so are covered. Statics change and have no CRC: guard words and the memory protection unit
//! ([`mpu`](crate::mpu)) protect them from other code, and the test of the RAM finds memory that no longer holds its
//! contents. A bit that flips once is left to [`checked`](crate::checked) states, the CRCs of the objects and the
//! watchdog.
//!
//! # Time to detect
//!
//! The bounds below assume that the patrol verifies [`Rate`] words in each slice, and that the idle loop does every
//! slice:
//!
//! - A changed bit in flash is found at the end of the first pass that begins after the change, so within two passes
//!   ([`Rate::flash_detect_us`]).
//! - A changed bit of code in RAM is found when its word has its turn, so in one pass at most
//!   ([`Rate::code_detect_us`]).
//! - A changed guard word is found in one slice.
//! - A bit of RAM in use that is stuck or does not change is found in one pass at most ([`Rate::ram_pass_us`]).

use core::ops::Range;

pub mod guard;
#[cfg(target_os = "none")]
mod part;
pub mod ram;

use crate::program::Comparison;
use guard::Guards;
#[cfg(target_os = "none")]
pub use part::{layout, PartMemory};
use ram::Walk;

/// The time from one slice of the patrol to the next, µs.
pub const SLICE_US: u32 = 2_500;

/// The most missed slices that are made up for at once: those of 50 ms. Further slices are dropped.
pub const MOST_SLICES: u32 = 20;

/// Words of memory, as the patrol accesses them. The tests implement this trait for faulty memory.
pub trait Memory {
    /// Returns the word at `address`.
    fn load(&self, address: u32) -> u32;
    /// Returns the word at `address` of flash, although the memory protection unit denies access to it.
    fn load_shut(&self, address: u32) -> u32;
    /// Stores `word` at `address`, which belongs to a guard word.
    fn store(&mut self, address: u32, word: u32);
    /// Inverts and restores two words from `address` on, without interruption. Returns the bits that were read wrong.
    fn exercise(&mut self, address: u32) -> u32;
}

/// The memory of a board that the patrol verifies. All addresses are multiples of four.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    /// The program in flash: from the vector table up to the word that holds its CRC.
    pub program: Range<u32>,
    /// The end of the flash that the memory protection unit denies to ordinary loads. That flash begins with the
    /// program.
    pub shut_end: u32,
    /// The RAM from which code runs.
    pub code: Range<u32>,
    /// The address in flash of the load image of the code in RAM.
    pub code_load: u32,
    /// The addresses of the guards, which have two words each.
    pub guards: [u32; guard::COUNT],
    /// The RAM with stack and statics.
    pub used: Range<u32>,
    /// The ranges of `used` that the test leaves out, because other hardware than the processor accesses them.
    pub apart: [Range<u32>; ram::APART],
}

/// The amount of work in a slice of the patrol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rate {
    /// The number of words of flash in a slice.
    pub flash_words: u32,
    /// The number of words of code in RAM in a slice.
    pub code_words: u32,
    /// The number of steps of the test of the RAM in a slice, each of which moves on by a word.
    pub ram_words: u32,
}

impl Rate {
    /// Returns the longest time, µs, until a changed bit in flash is found, for a program of `bytes`. It is the time of
    /// two passes and of one more slice for each pass, since a pass begins in the middle of a slice.
    #[must_use]
    pub const fn flash_detect_us(&self, bytes: u32) -> u32 {
        2 * (bytes.div_ceil(4).div_ceil(self.flash_words) + 1) * SLICE_US
    }

    /// Returns the longest time, µs, until a changed bit of code in RAM is found, for `bytes` of code.
    #[must_use]
    pub const fn code_detect_us(&self, bytes: u32) -> u32 {
        (bytes.div_ceil(4).div_ceil(self.code_words) + 1) * SLICE_US
    }

    /// Returns the longest time of a pass over `bytes` of RAM in use, µs. It includes the slice in which the pass
    /// begins.
    #[must_use]
    pub const fn ram_pass_us(&self, bytes: u32) -> u32 {
        (bytes.div_ceil(4).div_ceil(self.ram_words) + 1) * SLICE_US
    }
}

/// Counts how many slices are due.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    last_us: u32,
}

impl Pace {
    /// Returns a count without due slices at `now_us`, the value of a µs counter that may wrap.
    #[must_use]
    pub const fn new(now_us: u32) -> Self {
        Self { last_us: now_us }
    }

    /// Returns the number of slices due at `now_us`, and counts them as done. Calls must be less than 71 minutes apart.
    pub fn due(&mut self, now_us: u32) -> u32 {
        let due = now_us.wrapping_sub(self.last_us) / SLICE_US;
        // Not covered: a loop that is 50 ms late: it has the time that all tasks leave, and they take less than a tenth
        // of it.
        if due > MOST_SLICES {
            self.last_us = now_us;
            return MOST_SLICES;
        }
        self.last_us = self.last_us.wrapping_add(due * SLICE_US);
        due
    }
}

/// The findings of one slice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Slice {
    /// The result of the pass over flash that ended in this slice.
    pub flash: Option<Comparison>,
    /// The address, in RAM, of a word of code that differs from its load image.
    pub code: Option<u32>,
    /// The number of a guard that has changed, which is its index in [`Layout::guards`].
    pub guard: Option<u32>,
    /// The address of two words of RAM in use, one of which does not hold the value that is written to it.
    pub ram: Option<u32>,
    /// Whether all RAM in use was sound in the pass that ended in this slice.
    pub ram_pass: Option<bool>,
}

/// The state of the patrol over a board's memory.
#[derive(Clone, Debug)]
pub struct Patrol {
    layout: Layout,
    rate: Rate,
    /// The address of the next word of flash that the patrol reads.
    flash_at: u32,
    crc: u32,
    code_at: u32,
    guards: Guards,
    ram: Walk,
}

impl Patrol {
    /// Returns a patrol that is at the start of all passes, and writes the guard words. No guard word may have changed
    /// before.
    pub fn new(layout: Layout, rate: Rate, memory: &mut impl Memory) -> Self {
        let guards = Guards::set(layout.guards, memory);
        Self { flash_at: layout.program.start, crc: 0, code_at: 0, guards, ram: Walk::new(), layout, rate }
    }

    /// Makes the passes over flash and RAM begin again.
    pub fn restart(&mut self) {
        (self.flash_at, self.crc) = (self.layout.program.start, 0);
        self.ram.restart();
    }

    /// Does one slice of the patrol. Every slice does the same work, unless memory differs from what it should hold.
    pub fn slice(&mut self, memory: &mut impl Memory) -> Slice {
        let guard = self.guards.changed(memory);
        // Not covered: only this line, no words of code in a slice: the rate is a constant above 0, and without code in
        // RAM, as in the hold, the compiler has left copies that never run.
        let code = self.code(memory);
        // Not covered: only this line, no words of RAM in a slice: the rate is a constant above 0.
        Slice { code, guard, ..self.passes(memory) }
    }

    /// Does what a slice does on flash and RAM in use alone, so that their passes end sooner.
    pub fn passes(&mut self, memory: &mut impl Memory) -> Slice {
        let flash = self.flash(memory);
        let Layout { used, apart, .. } = &self.layout;
        // Not covered: only this line, an end of the search in `Walk::seek` that its constant ranges do not reach.
        let ram::Found { fault: ram, pass: ram_pass } = self.ram.run(self.rate.ram_words, used, apart, memory);
        Slice { flash, ram, ram_pass, ..Slice::default() }
    }

    fn flash(&mut self, memory: &impl Memory) -> Option<Comparison> {
        let Layout { program, shut_end, .. } = &self.layout;
        // Not covered: the limit of the sum: no program ends near the end of the address space.
        let end = self.flash_at.saturating_add(4 * self.rate.flash_words).min(program.end);
        // Not covered: a slice without words: a pass begins anew as soon as its last word is read, so there is always
        // one to read.
        let words = (self.flash_at..end).step_by(4);
        self.crc = profile::crc::frame_of_words_after(
            self.crc,
            // Not covered: the other kind of load: HORUS's memory protection unit denies no loads from flash, so its
            // `shut_end` is 0.
            words.map(|at| if at < *shut_end { memory.load_shut(at) } else { memory.load(at) }),
        );
        self.flash_at = end;
        if end < program.end {
            return None;
        }
        let found = Comparison { computed: self.crc, expected: memory.load(program.end).swap_bytes() };
        (self.flash_at, self.crc) = (program.start, 0);
        Some(found)
    }

    fn code(&mut self, memory: &impl Memory) -> Option<u32> {
        let Layout { code, code_load, .. } = &self.layout;
        let len = code.end - code.start;
        let mut differs = None;
        // Not covered: a slice without words, since the rate is a constant above 0; and on HORUS and the hold, which
        // have no code in RAM, all turns of the loop. On the DPR they are covered.
        for _ in 0..self.rate.code_words {
            if self.code_at >= len {
                self.code_at = 0;
                break;
            }
            let (runs, loaded) = (code.start + self.code_at, code_load + self.code_at);
            if memory.load(runs) != memory.load(loaded) {
                differs = Some(runs);
            }
            self.code_at += 4;
        }
        differs
    }
}

#[cfg(test)]
mod tests;
