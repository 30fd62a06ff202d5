//! The memories of a part.

use std::sync::Arc;

use cortex_m4::Width;

/// Memory that is rarely written. Copies of it share their contents until one of them is written.
#[derive(Clone, Debug)]
pub struct Flash {
    bytes: Arc<Vec<u8>>,
}

impl Flash {
    /// Makes a flash of `size` erased bytes (all ones).
    #[must_use]
    pub fn new(size: usize) -> Self {
        Self { bytes: Arc::new(vec![0xFF; size]) }
    }

    /// The whole contents.
    #[must_use]
    #[inline]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The whole contents, for loaders and flash controllers. After a change the caller calls
    /// [`cortex_m4::Signals::forget_code`].
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        Arc::make_mut(&mut self.bytes).as_mut_slice()
    }

    /// Reads at `offset`, `None` past the end.
    #[must_use]
    #[inline]
    pub fn read(&self, offset: u32, width: Width) -> Option<u32> {
        read(&self.bytes, offset, width)
    }

    /// Reads as [`Flash::read`] does, but returns `None` if `offset` is not a multiple of the width.
    #[must_use]
    #[inline(always)]
    pub fn read_aligned(&self, offset: u32, width: Width) -> Option<u32> {
        if offset & (width as u32 - 1) != 0 { None } else { read(&self.bytes, offset, width) }
    }
}

/// A bit of memory that keeps its value whatever is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StuckBit {
    /// The address of the bit's byte.
    pub address: u32,
    /// The number of the bit, 0 to 7.
    pub bit: u8,
    /// The value that the bit always has.
    pub value: bool,
}

/// The binary logarithm of the size of a watched page. It equals that of the core's pages of decoded code.
const PAGE_BITS: u32 = 10;

/// Memory that the core and bus controllers write.
///
/// A core may execute from this memory. The pages with its code are then watched ([`Ram::watch`]). A change of a byte
/// ends the watch of its page, so that the core decodes the page again.
#[derive(Clone, Debug)]
pub struct Ram {
    bytes: Vec<u8>,
    watched: Vec<u64>,
    /// The range in which a write may change a watched page or the stuck bit: first offset and length.
    delicate: (usize, usize),
    rewritten: u64,
    stuck_at: usize,
    stuck: (u8, u8),
}

impl Ram {
    /// Makes a RAM of `size` bytes of zero.
    #[must_use]
    pub fn new(size: usize) -> Self {
        Self {
            bytes: vec![0; size],
            watched: vec![0; size.div_ceil(64 << PAGE_BITS)],
            delicate: (0, 0),
            rewritten: 0,
            stuck_at: usize::MAX,
            stuck: (0, 0),
        }
    }

    /// Watches the page of 1 KiB that has `offset`, until a byte in it is written. Returns whether the page exists.
    pub fn watch(&mut self, offset: u32) -> bool {
        let page = (offset >> PAGE_BITS) as usize;
        let there = offset < self.bytes.len() as u32;
        if there {
            self.watched[page / 64] |= 1 << (page % 64);
            self.settle_delicate();
        }
        there
    }

    /// Whether the page that has `offset` is watched and was not written since.
    #[must_use]
    pub fn is_watched(&self, offset: u32) -> bool {
        let page = (offset >> PAGE_BITS) as usize;
        self.watched.get(page / 64).is_some_and(|word| word >> (page % 64) & 1 != 0)
    }

    /// The number of watches that a write has ended so far.
    #[must_use]
    #[inline(always)]
    pub fn rewritten(&self) -> u64 {
        self.rewritten
    }

    fn settle_delicate(&mut self) {
        let pages = 0..64 * self.watched.len();
        let is_watched = |page: &usize| self.watched[page / 64] >> (page % 64) & 1 != 0;
        let watched = pages.clone().find(is_watched).zip(pages.rev().find(is_watched));
        let watched = watched.map(|(first, last)| (first << PAGE_BITS, (last + 1) << PAGE_BITS));
        let stuck = (self.stuck_at < self.bytes.len()).then(|| (self.stuck_at, self.stuck_at + 1));
        let ranges = watched.into_iter().chain(stuck);
        let range = ranges.reduce(|one, other| (one.0.min(other.0), one.1.max(other.1)));
        self.delicate = range.map_or((0, 0), |(first, end)| {
            let first = first.saturating_sub(3);
            (first, end - first)
        });
    }

    /// Ends the watch of each page in which `size` bytes from `at` on change.
    #[cold]
    #[inline(never)]
    fn rewrite(&mut self, at: usize, size: usize) {
        let last = at.saturating_add(size).min(self.bytes.len());
        if last <= at {
            return;
        }
        let before = self.rewritten;
        for page in at >> PAGE_BITS..=(last - 1) >> PAGE_BITS {
            let (word, bit) = (page / 64, 1 << (page % 64));
            self.rewritten += u64::from(self.watched[word] & bit != 0);
            self.watched[word] &= !bit;
        }
        if self.rewritten != before {
            self.settle_delicate();
        }
    }

    #[inline(always)]
    fn is_delicate(&self, at: usize) -> bool {
        at.wrapping_sub(self.delicate.0) < self.delicate.1
    }

    /// Makes one bit stuck, and releases any bit that was stuck before. `address` counts from the start of this memory.
    /// With `None` no bit is stuck.
    pub fn stick(&mut self, stuck: Option<StuckBit>) {
        self.stuck_at = stuck.map_or(usize::MAX, |stuck| stuck.address as usize);
        self.stuck = stuck.map_or((0, 0), |stuck| (1 << (stuck.bit & 7), u8::from(stuck.value) << (stuck.bit & 7)));
        self.settle_delicate();
        self.keep_stuck();
    }

    #[cold]
    fn keep_stuck(&mut self) {
        let (mask, value) = self.stuck;
        self.rewrite(self.stuck_at, 1);
        if let Some(byte) = self.bytes.get_mut(self.stuck_at) {
            *byte = *byte & !mask | value;
        }
    }

    /// The whole contents.
    #[must_use]
    #[inline]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The whole contents, for changes. A stuck bit takes a value that is written in this way, until the next
    /// [`Ram::write`] to its byte.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        self.rewrite(0, self.bytes.len());
        &mut self.bytes
    }

    /// Returns `size` bytes from `offset` on, for the caller to change, as [`Ram::bytes_mut`] does; `None` past the
    /// end.
    pub fn slice_mut(&mut self, offset: u32, size: usize) -> Option<&mut [u8]> {
        let at = offset as usize;
        self.rewrite(at, size);
        self.bytes.get_mut(at..at.checked_add(size)?)
    }

    /// Reads at `offset`, `None` past the end.
    #[must_use]
    #[inline]
    pub fn read(&self, offset: u32, width: Width) -> Option<u32> {
        read(&self.bytes, offset, width)
    }

    /// Reads as [`Ram::read`] does, but returns `None` if `offset` is not a multiple of the width.
    #[must_use]
    #[inline(always)]
    pub fn read_aligned(&self, offset: u32, width: Width) -> Option<u32> {
        if offset & (width as u32 - 1) != 0 { None } else { read(&self.bytes, offset, width) }
    }

    /// Writes as [`Ram::write`] does. Returns `false` and writes nothing if a watched page or a stuck bit may be near,
    /// or if `offset` is not a multiple of the width.
    #[must_use]
    #[inline(always)]
    pub fn write_aligned(&mut self, offset: u32, width: Width, value: u32) -> bool {
        offset & (width as u32 - 1) == 0
            && !self.is_delicate(offset as usize)
            && self.put(offset as usize, width, value)
    }

    /// Writes the low bytes of `value` at `offset`. Returns `false` past the end.
    #[must_use]
    #[inline(always)]
    pub fn write(&mut self, offset: u32, width: Width, value: u32) -> bool {
        let at = offset as usize;
        if self.is_delicate(at) {
            return self.write_delicate(at, width, value);
        }
        self.put(at, width, value)
    }

    #[cold]
    #[inline(never)]
    fn write_delicate(&mut self, at: usize, width: Width, value: u32) -> bool {
        self.rewrite(at, width.bytes() as usize);
        let written = self.put(at, width, value);
        if self.stuck_at.wrapping_sub(at) < 4 {
            self.keep_stuck();
        }
        written
    }

    // The bytes are written as arrays. In debug builds `copy_from_slice` would check that source and destination do not
    // overlap.
    #[inline(always)]
    fn put(&mut self, at: usize, width: Width, value: u32) -> bool {
        let bytes = &mut self.bytes;
        let written = match width {
            Width::Byte => bytes.get_mut(at).map(|to| *to = value as u8),
            Width::Half => array(bytes.get_mut(at..at + 2)).map(|to| *to = (value as u16).to_le_bytes()),
            Width::Word => array(bytes.get_mut(at..at + 4)).map(|to| *to = value.to_le_bytes()),
        };
        written.is_some()
    }
}

#[inline(always)]
fn array<const N: usize>(bytes: Option<&mut [u8]>) -> Option<&mut [u8; N]> {
    bytes?.try_into().ok()
}

#[inline(always)]
fn read(bytes: &[u8], offset: u32, width: Width) -> Option<u32> {
    let at = offset as usize;
    Some(match width {
        Width::Byte => u32::from(*bytes.get(at)?),
        Width::Half => u32::from(u16::from_le_bytes(bytes.get(at..at + 2)?.try_into().ok()?)),
        Width::Word => u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const KIB: u32 = 1 << PAGE_BITS;

    #[test]
    fn every_change_of_a_byte_ends_its_pages_watch() {
        let ways: [fn(&mut Ram); 7] = [
            |ram| assert!(ram.write(2 * KIB, Width::Byte, 1)),
            |ram| assert!(ram.write(3 * KIB - 1, Width::Byte, 1)),
            |ram| assert!(ram.write(2 * KIB - 2, Width::Word, 1)),
            |ram| assert!(ram.write(2 * KIB + 4, Width::Word, 1)),
            |ram| assert!(ram.slice_mut(2 * KIB - 2, 3).is_some()),
            |ram| ram.stick(Some(StuckBit { address: 2 * KIB, bit: 0, value: true })),
            |ram| assert!(ram.bytes_mut().len() == 8 * KIB as usize),
        ];
        for (index, way) in ways.iter().enumerate() {
            let mut ram = Ram::new(8 * KIB as usize);
            assert!(ram.watch(2 * KIB + 7) && ram.watch(5 * KIB) && !ram.watch(8 * KIB));
            assert!(!ram.write_aligned(3 * KIB, Width::Byte, 1), "it may be near a page that is watched");
            assert!(ram.write_aligned(KIB, Width::Word, 1) && ram.write_aligned(6 * KIB, Width::Word, 1));
            assert!(ram.write(3 * KIB, Width::Word, 1) && ram.write(KIB, Width::Half, 1));
            assert_eq!((ram.is_watched(2 * KIB), ram.is_watched(5 * KIB), ram.rewritten()), (true, true, 0));
            way(&mut ram);
            let all = index == 6;
            assert_eq!((ram.is_watched(2 * KIB), ram.is_watched(5 * KIB)), (false, !all), "way {index}");
            assert_eq!(ram.rewritten(), if all { 2 } else { 1 });
            let stuck = index == 5;
            assert_eq!(ram.write_aligned(2 * KIB, Width::Word, 0), !stuck, "nothing is watched there any more");
            assert!(ram.write(2 * KIB, Width::Word, 0));
            assert_eq!(ram.read(2 * KIB, Width::Word), Some(u32::from(stuck)), "a stuck bit keeps its value");
        }
    }
}
