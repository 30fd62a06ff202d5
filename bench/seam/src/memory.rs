//! Memory of a part.

use std::sync::Arc;

use cortex_m4::Width;

/// Memory that is rarely written: copies share it until one of them is.
#[derive(Clone, Debug)]
pub struct Flash {
    bytes: Arc<Vec<u8>>,
}

impl Flash {
    /// `size` erased bytes: all ones.
    #[must_use]
    pub fn new(size: usize) -> Self {
        Self { bytes: Arc::new(vec![0xFF; size]) }
    }

    /// All of it.
    #[must_use]
    #[inline]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// All of it, to change: for loaders and flash controllers, which raise [`cortex_m4::Signals::forget_code`].
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        Arc::make_mut(&mut self.bytes).as_mut_slice()
    }

    /// Reads at `offset`, `None` past the end.
    #[must_use]
    #[inline]
    pub fn read(&self, offset: u32, width: Width) -> Option<u32> {
        read(&self.bytes, offset, width)
    }

    /// As [`Flash::read`], and `None` where `offset` is not a multiple of the width.
    #[must_use]
    #[inline(always)]
    pub fn read_aligned(&self, offset: u32, width: Width) -> Option<u32> {
        if offset & (width as u32 - 1) != 0 { None } else { read(&self.bytes, offset, width) }
    }
}

/// A bit of memory that keeps its value whatever is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StuckBit {
    /// Of its byte.
    pub address: u32,
    /// 0 to 7.
    pub bit: u8,
    /// What it reads.
    pub value: bool,
}

/// Memory that the core and bus controllers write.
#[derive(Clone, Debug)]
pub struct Ram {
    bytes: Vec<u8>,
    /// The byte of which a bit is stuck; [`usize::MAX`] if none is.
    stuck_at: usize,
    /// The stuck bits of that byte, and what they read.
    stuck: (u8, u8),
}

impl Ram {
    /// `size` bytes of zero.
    #[must_use]
    pub fn new(size: usize) -> Self {
        Self { bytes: vec![0; size], stuck_at: usize::MAX, stuck: (0, 0) }
    }

    /// A bit is stuck from now on, and no other; `address` counts from this memory's start. `None`: every bit takes
    /// what is written to it.
    pub fn stick(&mut self, stuck: Option<StuckBit>) {
        self.stuck_at = stuck.map_or(usize::MAX, |stuck| stuck.address as usize);
        self.stuck = stuck.map_or((0, 0), |stuck| (1 << (stuck.bit & 7), u8::from(stuck.value) << (stuck.bit & 7)));
        self.keep_stuck();
    }

    /// The stuck bit reads what it reads.
    #[cold]
    fn keep_stuck(&mut self) {
        let (mask, value) = self.stuck;
        if let Some(byte) = self.bytes.get_mut(self.stuck_at) {
            *byte = *byte & !mask | value;
        }
    }

    /// All of it.
    #[must_use]
    #[inline]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// All of it, to change. What is written so a stuck bit takes until the next [`Ram::write`] there.
    #[inline]
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        &mut self.bytes
    }

    /// Reads at `offset`, `None` past the end.
    #[must_use]
    #[inline]
    pub fn read(&self, offset: u32, width: Width) -> Option<u32> {
        read(&self.bytes, offset, width)
    }

    /// As [`Ram::read`], and `None` where `offset` is not a multiple of the width.
    #[must_use]
    #[inline(always)]
    pub fn read_aligned(&self, offset: u32, width: Width) -> Option<u32> {
        if offset & (width as u32 - 1) != 0 { None } else { read(&self.bytes, offset, width) }
    }

    /// As [`Ram::write`], and `false` where `offset` is not a multiple of the width.
    #[must_use]
    #[inline(always)]
    pub fn write_aligned(&mut self, offset: u32, width: Width, value: u32) -> bool {
        offset & (width as u32 - 1) == 0 && self.write(offset, width, value)
    }

    /// Writes the low bytes of `value` at `offset`; `false` past the end.
    #[must_use]
    #[inline(always)]
    pub fn write(&mut self, offset: u32, width: Width, value: u32) -> bool {
        let at = offset as usize;
        let written = match width {
            Width::Byte => self.bytes.get_mut(at).map(|to| *to = value as u8),
            Width::Half => self.bytes.get_mut(at..at + 2).map(|to| to.copy_from_slice(&(value as u16).to_le_bytes())),
            Width::Word => self.bytes.get_mut(at..at + 4).map(|to| to.copy_from_slice(&value.to_le_bytes())),
        };
        if self.stuck_at.wrapping_sub(at) < 4 {
            self.keep_stuck();
        }
        written.is_some()
    }
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
