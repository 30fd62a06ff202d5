//! Counts how many bytes a circular DMA transfer has written, and how many were read
//!
//! # Design
//!
//! A DMA stream in circular mode shows only its position in the ring (NDTR counts down from the ring's size, RM0090
//! "DMA controller", circular mode). A [`Writer`] turns that position into a count of all bytes ever written. The
//! firmware calls it when half or all of the ring was written and at every idle line, so the stream writes less than a
//! ring between two calls. A [`Reader`] counts all bytes ever read. When the difference of both counts exceeds the
//! ring's size, the writer has overwritten unread bytes, which are counted as lost instead of being read as new.

/// The producer's side of one ring, which counts the bytes ever written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Writer {
    position: usize,
    total: u32,
}

impl Writer {
    /// Returns the writer of a ring into which no byte was written.
    #[must_use]
    pub const fn new() -> Self {
        Self { position: 0, total: 0 }
    }

    /// Takes the DMA stream's NDTR (the bytes left until the ring's end, 1..=`size`) of a ring of `size` bytes. Returns
    /// how many bytes were ever written (wraps).
    pub fn advance(&mut self, left: usize, size: usize) -> u32 {
        // The DMA stream's NDTR reads 0 only between the last byte of the ring and the reload.
        // Not covered: a number above the ring's size, which the DMA stream never has: it counts down from the size.
        let position = (size - left.min(size)) % size;
        let step = (position + size - self.position) % size;
        self.position = position;
        // The writer moves by less than a ring between two positions, and a ring is smaller than 64 KiB (NDTR has 16
        // bits).
        self.total = self.total.wrapping_add(step as u32);
        self.total
    }
}

/// A contiguous range of a ring that may be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// The index of the range's first byte in the ring.
    pub start: usize,
    /// The number of bytes.
    pub len: usize,
}

/// The consumer's side of one ring, which counts the bytes ever read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reader {
    total: u32,
    lost: u32,
}

impl Reader {
    /// Returns a reader that has read nothing yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { total: 0, lost: 0 }
    }

    /// Returns the next range to read when `written` bytes were ever written into a ring of `size` bytes. The range has
    /// at most `limit` bytes and never crosses the ring's end. Its bytes then count as read.
    ///
    /// If unread bytes were overwritten, the ring mixes old and new bytes: all are skipped and count as
    /// [`Reader::lost`].
    pub fn take(&mut self, written: u32, size: usize, limit: usize) -> Span {
        let waiting = written.wrapping_sub(self.total) as usize;
        if waiting > size {
            self.total = written;
            self.lost = self.lost.wrapping_add(waiting as u32);
        }
        let start = self.total as usize % size;
        let len = (written.wrapping_sub(self.total) as usize).min(limit).min(size - start);
        self.total = self.total.wrapping_add(len as u32);
        Span { start, len }
    }

    /// Returns the number of bytes that wait to be read when `written` bytes were ever written.
    #[must_use]
    pub const fn waiting(&self, written: u32) -> u32 {
        written.wrapping_sub(self.total)
    }

    /// Returns the number of bytes lost since the start because the writer overwrote them unread (wraps).
    #[must_use]
    pub const fn lost(&self) -> u32 {
        self.lost
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    const SIZE: usize = 16;

    #[test]
    fn a_lapped_reader_skips_what_it_lost_and_says_how_much() {
        let mut reader = Reader::new();
        assert_eq!(reader.take(17, SIZE, 64), Span { start: 1, len: 0 });
        assert_eq!(reader.lost(), 17);
        assert_eq!(reader.take(20, SIZE, 64), Span { start: 1, len: 3 });
        assert_eq!(reader.lost(), 17);
    }

    #[test]
    fn a_full_ring_is_not_a_lapped_one() {
        let mut reader = Reader::new();
        assert_eq!(reader.take(16, SIZE, 64), Span { start: 0, len: 16 });
        assert_eq!(reader.lost(), 0);
    }

    #[test]
    fn the_counts_wrap_without_losing_a_byte() {
        let mut reader = Reader { total: u32::MAX - 7, lost: 0 };
        assert_eq!(reader.take(8, SIZE, 64), Span { start: 8, len: 8 }, "up to the wrap, which is the ring's end");
        assert_eq!(reader.take(8, SIZE, 64), Span { start: 0, len: 8 });
        assert_eq!(reader.waiting(8), 0);
        assert_eq!(reader.lost(), 0);
    }

    proptest! {
        #[test]
        fn every_byte_is_read_once_in_order(
            steps in proptest::collection::vec((0usize..SIZE, 1usize..20), 1..200),
        ) {
            let mut ring = [0u8; SIZE];
            let (mut writer, mut reader) = (Writer::new(), Reader::new());
            let (mut next, mut at, mut expected) = (0u8, 0usize, 0u8);
            for (count, limit) in steps {
                for _ in 0..count {
                    ring[at] = next;
                    next = next.wrapping_add(1);
                    at = (at + 1) % SIZE;
                }
                let written = writer.advance(SIZE - at, SIZE);
                let mut seen = Vec::new();
                while reader.waiting(written) > 0 {
                    let span = reader.take(written, SIZE, limit);
                    prop_assert!(span.len > 0 && span.len <= limit);
                    seen.extend_from_slice(&ring[span.start..span.start + span.len]);
                }
                for byte in seen {
                    prop_assert_eq!(byte, expected);
                    expected = expected.wrapping_add(1);
                }
            }
            prop_assert_eq!(reader.lost(), 0);
        }
    }
}
