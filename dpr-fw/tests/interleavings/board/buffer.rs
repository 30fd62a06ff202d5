//! The buffers of the model. The processor sees a store at once, and DMA sees it when it reaches the RAM.

use std::{
    borrow::{Borrow, BorrowMut},
    fmt,
};

use dpr_fw::{triple::Memory, ImageMemory, IMAGE_WORDS};

use super::{At, Board, Task};
use crate::{explorer::holds, Mutation};

/// A buffer, with its number in RAM and the words that the processor sees in it.
pub(crate) struct Buffer {
    place: usize,
    words: ImageMemory,
    at: At,
}

impl Buffer {
    pub(super) fn new(place: usize, at: At) -> Self {
        // All words begin with 0xEE, which no image has as its number.
        Self { place, words: [0xEE; IMAGE_WORDS], at }
    }

    pub(super) fn place(&self) -> usize {
        self.place
    }
}

impl fmt::Debug for Buffer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.place)
    }
}

impl Borrow<ImageMemory> for Buffer {
    fn borrow(&self) -> &ImageMemory {
        &self.words
    }
}

impl BorrowMut<ImageMemory> for Buffer {
    fn borrow_mut(&mut self) -> &mut ImageMemory {
        &mut self.words
    }
}

impl Memory for Buffer {
    fn words(&self) -> usize {
        IMAGE_WORDS
    }

    fn fill(&mut self, pattern: u32) {
        let Board { bounds, hw, .. } = &*self.at.0;
        if bounds.mutation == Mutation::NoScrub {
            return;
        }
        self.words.fill(pattern);
        if let Some(frame) = self.at.0.frames.borrow_mut().last_mut() {
            frame.scrubbed = true;
        }
        hw.borrow_mut().ram[self.place][0] = pattern;
        self.at.point("scrub: fills the upper half");
        hw.borrow_mut().held_back[self.place] = None;
        hw.borrow_mut().ram[self.place][1] = pattern;
    }

    fn differing_bits(&self, pattern: u32) -> u32 {
        let Board { bounds, hw, frames, .. } = &*self.at.0;
        if bounds.mutation == Mutation::NoScrub {
            return 0;
        }
        let in_scrub_task = frames.borrow().last().is_some_and(|frame| frame.task == Task::Scrub);
        let mut hw = hw.borrow_mut();
        holds(hw.ram[self.place] == [pattern; 2], "a buffer is written while it is scrubbed");
        let stuck = hw.stuck == Some(self.place);
        if stuck && in_scrub_task && hw.found.is_none() {
            hw.found = Some(self.place);
        }
        drop(hw);
        self.at.see(stuck);
        u32::from(stuck && bounds.mutation != Mutation::FaultyUsedAgain)
    }
}
