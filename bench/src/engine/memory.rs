//! Guest memory: flash and RAM of one target, shared with the core that runs from it.
//!
//! The core's translated code reads and writes these bytes directly, so they live at a fixed place of the host's memory
//! that nothing else holds a reference to. This is the only module of the crate with `unsafe` code, and it hands out
//! bytes by value.
#![expect(unsafe_code, reason = "a rigless processor maps guest memory by raw pointer, see the SAFETY comments")]

use std::alloc::{Layout, alloc_zeroed, dealloc, handle_alloc_error};
use std::ptr::NonNull;

use rigless::emulator::{Alias, Processor, Queued};
use rigless::soc::{Region, RegionKind};

/// Alignment of every allocation: the largest page a rigless processor may map by.
const ALIGNMENT: usize = 4096;

/// One region of the target's memory map with every address it answers at.
#[derive(Debug)]
struct Area {
    starts: Vec<u64>,
    size: usize,
    bytes: NonNull<u8>,
    erased: u8,
    writable: bool,
    programmed: bool,
}

// SAFETY: an `Area` owns its allocation alone: the pointer is never copied out of this module but into the processor it
// is mapped to, which lives beside it in one `Node` and moves with it. No thread touches the bytes while another owns
// the node.
unsafe impl Send for Area {}

impl Area {
    fn new(region: &Region, aliases: &[Alias]) -> Self {
        let size = usize::try_from(region.size).expect("a region of a microcontroller");
        let layout = Self::layout(size);
        // SAFETY: every region of a memory map has a size above zero, which `layout` checks.
        let bytes = unsafe { alloc_zeroed(layout) };
        let Some(bytes) = NonNull::new(bytes) else { handle_alloc_error(layout) };
        let mut area = Self {
            starts: std::iter::once(region.base)
                .chain(aliases.iter().filter(|alias| alias.region == region.name).map(|alias| alias.at))
                .collect(),
            size,
            bytes,
            erased: region.erased,
            writable: region.kind == RegionKind::Ram,
            programmed: region.programmer.is_some(),
        };
        area.erase();
        area
    }

    fn layout(size: usize) -> Layout {
        assert!(size > 0, "a memory region holds bytes");
        Layout::from_size_align(size, ALIGNMENT).expect("a region of a microcontroller fits the host")
    }

    fn erase(&mut self) {
        // SAFETY: `bytes` is valid for `size` bytes, and no reference to them exists.
        unsafe { self.bytes.as_ptr().write_bytes(self.erased, self.size) }
    }

    fn offset(&self, address: u64, length: usize) -> Option<usize> {
        self.starts.iter().find_map(|&start| {
            let offset = usize::try_from(address.checked_sub(start)?).ok()?;
            (offset.checked_add(length)? <= self.size).then_some(offset)
        })
    }

    fn copy_out(&self, offset: usize, to: &mut [u8]) {
        assert!(offset + to.len() <= self.size);
        // SAFETY: the range was just checked to lie inside the allocation, `to` is a distinct Rust slice, and no
        // reference to the source exists.
        unsafe { self.bytes.as_ptr().add(offset).copy_to_nonoverlapping(to.as_mut_ptr(), to.len()) }
    }

    fn copy_in(&mut self, offset: usize, from: &[u8]) {
        assert!(offset + from.len() <= self.size);
        // SAFETY: as in `copy_out`, with the directions exchanged.
        unsafe { self.bytes.as_ptr().add(offset).copy_from_nonoverlapping(from.as_ptr(), from.len()) }
    }
}

impl Drop for Area {
    fn drop(&mut self) {
        // SAFETY: allocated in `new` with the same layout and freed here only. The processor that mapped it is gone:
        // `Node` declares its processor before its memory, so it is dropped first.
        unsafe { dealloc(self.bytes.as_ptr(), Self::layout(self.size)) }
    }
}

/// What an address of guest memory may be used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Use {
    /// RAM.
    Written,
    /// Flash whose model takes the firmware's stores itself.
    Programmed,
    /// Flash whose contents the engine changes as the part says ([`crate::engine::Part::flash`]).
    Stored,
}

/// The memory of one target.
#[derive(Debug)]
pub struct GuestMemory {
    areas: Vec<Area>,
    changed: Vec<Queued>,
}

impl GuestMemory {
    pub(crate) fn new<'a>(regions: impl IntoIterator<Item = &'a Region>, aliases: &[Alias]) -> Self {
        Self { areas: regions.into_iter().map(|region| Area::new(region, aliases)).collect(), changed: Vec::new() }
    }

    /// Maps every whole page to `cpu`. The processor must be dropped before this memory.
    pub(crate) fn map_to(&self, cpu: &mut dyn Processor) {
        let page = cpu.page_size();
        for area in &self.areas {
            let length = area.size as u64;
            for &start in &area.starts {
                if start.is_multiple_of(page) && length.is_multiple_of(page) && cpu.maps(start, length) {
                    // SAFETY: `start` and `length` are whole pages, the allocation is aligned to at least one, is
                    // `length` bytes long and never moves. It outlives the processor (see `Drop`). This module hands
                    // out no reference to the bytes, so none is live while the processor runs, and one thread owns
                    // both.
                    unsafe { cpu.map(start, length, area.bytes.as_ptr(), area.writable) }
                }
            }
        }
    }

    fn find(&self, address: u64, length: usize) -> Option<(&Area, usize)> {
        self.areas.iter().find_map(|area| Some((area, area.offset(address, length)?)))
    }

    pub(crate) fn usage(&self, address: u64, length: usize) -> Option<Use> {
        let (area, _) = self.find(address, length)?;
        Some(match (area.writable, area.programmed) {
            (true, _) => Use::Written,
            (false, true) => Use::Programmed,
            (false, false) => Use::Stored,
        })
    }

    /// Fills `to` from `address` and answers whether all of it is memory.
    #[must_use]
    pub fn read(&self, address: u64, to: &mut [u8]) -> bool {
        let Some((area, offset)) = self.find(address, to.len()) else { return false };
        area.copy_out(offset, to);
        true
    }

    /// The little-endian value of `length` (1 to 8) bytes at `address`.
    #[must_use]
    pub fn value(&self, address: u64, length: usize) -> Option<u64> {
        let mut bytes = [0; 8];
        self.read(address, bytes.get_mut(..length)?).then(|| u64::from_le_bytes(bytes))
    }

    /// Writes `from` at `address`, flash included, and answers whether all of it is memory. Code translated from those
    /// bytes is dropped before the core's next instruction.
    pub fn write(&mut self, address: u64, from: &[u8]) -> bool {
        let found =
            self.areas.iter_mut().find_map(|area| area.offset(address, from.len()).map(|offset| (area, offset)));
        let Some((area, offset)) = found else { return false };
        area.copy_in(offset, from);
        let end = address + from.len() as u64;
        match self.changed.last_mut() {
            Some(Queued::Invalidate(_, last)) if *last == address => *last = end,
            _ => self.changed.push(Queued::Invalidate(address, end)),
        }
        true
    }

    pub(crate) fn put(&mut self, address: u64, length: usize, value: u64) -> bool {
        value.to_le_bytes().get(..length).is_some_and(|bytes| self.write(address, bytes))
    }

    /// Sets `from..to` to the value an erased cell reads.
    pub(crate) fn erase(&mut self, from: u64, to: u64) {
        let length = usize::try_from(to.saturating_sub(from)).unwrap_or(0);
        let Some(erased) = self.find(from, length).map(|(area, _)| area.erased) else { return };
        self.write(from, &vec![erased; length]);
    }

    /// Fills everything the guest can write with noise that follows from `seed` (SplitMix64), as RAM comes up.
    pub(crate) fn come_up(&mut self, seed: u64) {
        let mut state = seed;
        let writable: Vec<(u64, usize)> =
            self.areas.iter().filter(|area| area.writable).map(|area| (area.starts[0], area.size)).collect();
        for (start, size) in writable {
            let mut noise = Vec::with_capacity(size + 8);
            while noise.len() < size {
                state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
                let mut word = (state ^ state >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
                word = (word ^ word >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
                noise.extend_from_slice(&(word ^ word >> 31).to_le_bytes());
            }
            self.write(start, &noise[..size]);
        }
    }

    /// Changes since last asked, for the core to hear of.
    pub(crate) fn take_changed(&mut self) -> Vec<Queued> {
        std::mem::take(&mut self.changed)
    }

    /// Hashes what the guest can write into `hash`.
    pub(crate) fn digest(&self, hash: &mut super::Digest) {
        let mut block = [0; 4096];
        for area in self.areas.iter().filter(|area| area.writable) {
            let mut offset = 0;
            while offset < area.size {
                let length = block.len().min(area.size - offset);
                area.copy_out(offset, &mut block[..length]);
                hash.bytes(&block[..length]);
                offset += length;
            }
        }
    }
}
