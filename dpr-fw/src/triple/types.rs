//! The states of a buffer, and the scrub.

use core::{
    hint::black_box,
    ops::AddAssign,
    sync::atomic::{compiler_fence, Ordering},
};

/// Words of memory that can be scrubbed. The tests implement this trait for faulty memory.
pub trait Memory {
    /// Returns the number of 32-bit words.
    fn words(&self) -> usize;
    /// Sets every word to `pattern`.
    fn fill(&mut self, pattern: u32);
    /// Returns how many bits differ from `pattern`. They are read back from the memory itself.
    fn differing_bits(&self, pattern: u32) -> u32;
    /// Returns the address of memory behind a reference; 0 for memory that moves with its owner.
    fn address(&self) -> usize {
        0
    }
}

impl<M: Memory + ?Sized> Memory for &mut M {
    fn words(&self) -> usize {
        (**self).words()
    }
    fn fill(&mut self, pattern: u32) {
        (**self).fill(pattern);
    }
    fn differing_bits(&self, pattern: u32) -> u32 {
        (**self).differing_bits(pattern)
    }
    fn address(&self) -> usize {
        (&raw const **self).addr()
    }
}

/// Fill and read-back both pass through an optimisation barrier and a compiler fence, so that the compiler can drop
/// neither: the fill has to be in memory before it is read back, and the read-back has to load from there. The
/// on-target tests detect a dropped step by its clock cycles.
impl<const WORDS: usize> Memory for [u32; WORDS] {
    fn words(&self) -> usize {
        WORDS
    }

    fn fill(&mut self, pattern: u32) {
        let words = black_box(self);
        for word in words.iter_mut() {
            *word = pattern;
        }
        compiler_fence(Ordering::SeqCst);
        black_box(words);
    }

    fn differing_bits(&self, pattern: u32) -> u32 {
        compiler_fence(Ordering::SeqCst);
        let words = black_box(self);
        // Counting bits would take longer for stuck bits, so all words are compared first, with the same work for any
        // content.
        let differing = words.iter().fold(0, |differing, word| differing | (word ^ pattern));
        if differing == 0 {
            0
        } else {
            words.iter().map(|word| (word ^ pattern).count_ones()).sum()
        }
    }
}

/// A buffer with the complement of its address. A bit of either may flip while the buffer waits in RAM, and the buffer
/// would be other memory.
#[derive(Debug)]
struct Placed<B> {
    buffer: B,
    not_address: usize,
}

impl<B: Memory> Placed<B> {
    fn new(buffer: B) -> Self {
        Self { not_address: !buffer.address(), buffer }
    }

    fn check(&self) {
        if self.buffer.address() != !self.not_address {
            moved();
        }
    }

    fn get_mut(&mut self) -> &mut B {
        self.check();
        &mut self.buffer
    }
}

#[cold]
#[inline(never)]
fn moved() -> ! {
    panic!("the address of a buffer has changed")
}

/// A buffer that was scrubbed and not written since.
#[derive(Debug)]
pub struct Clean<B>(Placed<B>);

/// The buffer that is being written.
#[derive(Debug)]
pub struct Filling<B>(Placed<B>);

/// A buffer that holds a frame which no task has read yet.
#[derive(Debug)]
pub struct Received<B, I> {
    buffer: Placed<B>,
    about: I,
}

/// A buffer that may not be read any more. Every new buffer begins in this state.
#[derive(Debug)]
pub struct Dirty<B>(Placed<B>);

/// A buffer in which the scrub found stuck bits. Whoever drops it takes it out of use until the next start.
#[derive(Debug)]
pub struct Faulty<B> {
    buffer: Placed<B>,
    stuck_bits: u32,
}

/// The sums of the results of one scrub or several.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Scrubbed {
    /// The number of buffers that were scrubbed.
    pub buffers: u32,
    /// The number of bits that did not take a 1 or did not take a 0.
    pub stuck_bits: u32,
    /// The number of buffers that were taken out of use because of stuck bits.
    pub out_of_use: u32,
}

impl AddAssign for Scrubbed {
    fn add_assign(&mut self, other: Self) {
        self.buffers += other.buffers;
        self.stuck_bits += other.stuck_bits;
        self.out_of_use += other.out_of_use;
    }
}

impl<B> Clean<B> {
    /// Begins to write the buffer.
    pub fn receive(self) -> Filling<B> {
        Filling(self.0)
    }
}

impl<B: Memory> Filling<B> {
    /// Returns the memory to write.
    ///
    /// # Panics
    ///
    /// A bit of the buffer's address has flipped. [`Received::memory`] and [`Dirty::scrub`] panic likewise.
    pub fn memory(&mut self) -> &mut B {
        self.0.get_mut()
    }
}

impl<B> Filling<B> {
    /// Returns the memory to write, and does not verify its address: the caller has verified this buffer's state in
    /// RAM ([`Checked`](firmware_common::checked::Checked)).
    pub fn verified(&mut self) -> &mut B {
        &mut self.0.buffer
    }

    /// Returns the memory as written so far, for the task that writes it. Does not verify the address, since a CRC
    /// decides over what is read.
    pub fn peek(&self) -> &B {
        &self.0.buffer
    }

    /// Ends the writing: the buffer now holds a whole frame, which may be read once. `about` is kept with the frame.
    pub fn received<I>(self, about: I) -> Received<B, I> {
        Received { buffer: self.0, about }
    }

    /// Gives up the frame that was being written into this buffer.
    pub fn discard(self) -> Dirty<B> {
        Dirty(self.0)
    }
}

impl<B: Memory, I> Received<B, I> {
    /// Returns the address of the memory, which tells it from other buffers.
    pub fn address(&self) -> usize {
        self.buffer.buffer.address()
    }

    /// Returns the memory that holds the frame.
    pub fn memory(&self) -> &B {
        self.buffer.check();
        &self.buffer.buffer
    }
}

impl<B, I> Received<B, I> {
    /// Returns what the writer of the frame passed to [`Filling::received`] about it.
    pub fn about(&self) -> &I {
        &self.about
    }

    /// Ends the reading.
    pub fn done(self) -> Dirty<B> {
        Dirty(self.buffer)
    }
}

impl<B: Memory> Dirty<B> {
    /// Takes over a buffer with unknown contents.
    pub fn new(buffer: B) -> Self {
        Self(Placed::new(buffer))
    }

    /// Fills the buffer with 0xFF and with 0x00, and reads it back each time.
    ///
    /// # Errors
    ///
    /// [`Faulty`] if any bit that is read back differs.
    pub fn scrub(mut self) -> Result<Clean<B>, Faulty<B>> {
        let mut stuck_bits = 0;
        let memory = self.0.get_mut();
        for pattern in [u32::MAX, 0] {
            memory.fill(pattern);
            stuck_bits += memory.differing_bits(pattern);
        }
        if stuck_bits == 0 {
            Ok(Clean(self.0))
        } else {
            Err(Faulty { buffer: self.0, stuck_bits })
        }
    }
}

impl<B> Faulty<B> {
    /// Returns the number of bits that did not take a 1 or did not take a 0.
    #[must_use]
    pub fn stuck_bits(&self) -> u32 {
        self.stuck_bits
    }

    /// Returns the faulty buffer as clean, so that it stays in use.
    pub(super) fn keep(self) -> Clean<B> {
        Clean(self.buffer)
    }
}
