//! Integrity of what is stored, round the clock: flash, code in RAM, the surroundings of the statics, RAM in use.
//!
//! # Design
//!
//! The idle loop does one *slice* of work every [`SLICE_US`], so much later as it was kept from running, and not more
//! than [`MOST_SLICES`] at once ([`Pace`]). A slice does a fixed amount of each of four things:
//!
//! | what | how | a mismatch |
//! |---|---|---|
//! | flash, from the vector table on | its CRC, some words a slice; a verdict after each pass | [`Slice::flash`] |
//! | code that runs from RAM | compared with its load image in flash, some words a slice | [`Slice::code`] |
//! | around the statics, end of the stack | all guard words in each slice ([`guard`]) | [`Slice::guard`] |
//! | RAM in use: stack and statics | inverted and restored, some words a slice ([`ram`]) | [`Slice::ram`] |
//!
//! What a mismatch leads to is the board's decision; this module leaves everything as it finds it. CRC tables and
//! constants lie in flash or in the RAM of the code, and so are covered. Statics change and have no CRC: what other
//! code could overwrite is behind guard words and the memory protection unit ([`mpu`](crate::mpu)), what does not hold
//! its contents any more is found by the test of the RAM, and a bit that flips once is the business of the CRCs of the
//! objects and of the watchdog.
//!
//! # Time to detect
//!
//! With [`Rate`] words a slice and without starvation of the idle loop, from the change of a bit on:
//!
//! - flash: at the end of the first pass that begins after it, so two passes at most ([`Rate::flash_detect_us`]);
//! - code in RAM: when its word's turn comes, so one pass at most ([`Rate::code_detect_us`]);
//! - guard words: one slice;
//! - RAM in use: a bit that is stuck or does not change, when its word's turn comes, so one pass at most
//!   ([`Rate::ram_pass_us`]).

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

/// One slice is due every so many µs.
pub const SLICE_US: u32 = 2_500;

/// At most so many slices are made up for at once: those of 50 ms. What is more is dropped.
pub const MOST_SLICES: u32 = 20;

/// Words of memory, as the patrol sees them. The tests put faulty memory behind it.
pub trait Memory {
    /// The word at `address`.
    fn load(&self, address: u32) -> u32;
    /// The word at `address` of flash that the memory protection unit has shut.
    fn load_shut(&self, address: u32) -> u32;
    /// Stores `word` at `address`, which belongs to a guard.
    fn store(&mut self, address: u32, word: u32);
    /// Inverts the word at `address` of RAM and the one behind it and restores them, with nothing in between; the bits
    /// that did not read as they were written.
    fn exercise(&mut self, address: u32) -> u32;
}

/// Where things are. All addresses are multiples of four.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    /// The program in flash: from the vector table to the word that holds its CRC, which is not included.
    pub program: Range<u32>,
    /// The program is shut to ordinary loads from its start up to here.
    pub shut_end: u32,
    /// Where code in RAM runs.
    pub code: Range<u32>,
    /// Its load image in flash.
    pub code_load: u32,
    /// The guards: two words each.
    pub guards: [u32; guard::COUNT],
    /// RAM with stack and statics.
    pub used: Range<u32>,
    /// What of it is left out, since not the processor alone reads and writes it.
    pub apart: [Range<u32>; ram::APART],
}

/// How much a slice does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rate {
    /// Words of flash.
    pub flash_words: u32,
    /// Words of code in RAM.
    pub code_words: u32,
    /// Steps of the test of the RAM, each of which moves on by a word.
    pub ram_words: u32,
}

impl Rate {
    /// The longest from a change of a bit of flash to the verdict, µs, for a program of `bytes`: two passes, each a
    /// slice longer since it begins within one.
    #[must_use]
    pub const fn flash_detect_us(&self, bytes: u32) -> u32 {
        2 * (bytes.div_ceil(4).div_ceil(self.flash_words) + 1) * SLICE_US
    }

    /// The longest from a change of a bit of code in RAM to its finding, µs, for `bytes` of code.
    #[must_use]
    pub const fn code_detect_us(&self, bytes: u32) -> u32 {
        (bytes.div_ceil(4).div_ceil(self.code_words) + 1) * SLICE_US
    }

    /// One pass over `bytes` of RAM in use, µs, a slice longer since it begins within one.
    #[must_use]
    pub const fn ram_pass_us(&self, bytes: u32) -> u32 {
        (bytes.div_ceil(4).div_ceil(self.ram_words) + 1) * SLICE_US
    }
}

/// How many slices are due.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    last_us: u32,
}

impl Pace {
    /// From `now_us` on: a µs counter that may wrap, here and below.
    #[must_use]
    pub const fn new(now_us: u32) -> Self {
        Self { last_us: now_us }
    }

    /// Slices that are due at `now_us`, less than 71 minutes after the last call; they count as done.
    pub fn due(&mut self, now_us: u32) -> u32 {
        let due = now_us.wrapping_sub(self.last_us) / SLICE_US;
        if due > MOST_SLICES {
            self.last_us = now_us;
            return MOST_SLICES;
        }
        self.last_us = self.last_us.wrapping_add(due * SLICE_US);
        due
    }
}

/// What one slice found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Slice {
    /// A pass over flash is complete: what it came to.
    pub flash: Option<Comparison>,
    /// The address, where it runs, of a word of code in RAM that differs from its load image.
    pub code: Option<u32>,
    /// The number of a guard that has changed: its place in [`Layout::guards`].
    pub guard: Option<u32>,
    /// The address of two words of RAM in use of which one does not hold what is written.
    pub ram: Option<u32>,
    /// A pass over RAM in use is complete: whether all of it was sound.
    pub ram_pass: Option<bool>,
}

/// The patrol over a board's memory.
#[derive(Clone, Debug)]
pub struct Patrol {
    layout: Layout,
    rate: Rate,
    /// The next word of flash, and the CRC of those before it.
    flash_at: u32,
    crc: u32,
    /// The next word of code, from its start.
    code_at: u32,
    guards: Guards,
    ram: Walk,
}

impl Patrol {
    /// At the beginning of all passes. Writes the guard words, so to be called before anything can have changed them.
    pub fn new(layout: Layout, rate: Rate, memory: &mut impl Memory) -> Self {
        let guards = Guards::set(layout.guards, memory);
        Self { flash_at: layout.program.start, crc: 0, code_at: 0, guards, ram: Walk::new(), layout, rate }
    }

    /// Begins the passes over flash and RAM anew.
    pub fn restart(&mut self) {
        (self.flash_at, self.crc) = (self.layout.program.start, 0);
        self.ram.restart();
    }

    /// One slice. Its work is the same as long as memory holds what it should.
    pub fn slice(&mut self, memory: &mut impl Memory) -> Slice {
        let guard = self.guards.changed(memory);
        let flash = self.flash(memory);
        let code = self.code(memory);
        let Layout { used, apart, .. } = &self.layout;
        let ram::Found { fault: ram, pass: ram_pass } = self.ram.run(self.rate.ram_words, used, apart, memory);
        Slice { flash, code, guard, ram, ram_pass }
    }

    fn flash(&mut self, memory: &impl Memory) -> Option<Comparison> {
        let Layout { program, shut_end, .. } = &self.layout;
        let end = self.flash_at.saturating_add(4 * self.rate.flash_words).min(program.end);
        let words = (self.flash_at..end).step_by(4);
        self.crc = profile::crc::frame_of_words_after(
            self.crc,
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
