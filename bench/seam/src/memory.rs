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

    /// All of it, to change: for loaders and flash controllers, which raise [`cortex_m4::Signals::code_changed`].
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

/// Memory that the core and bus controllers write.
#[derive(Clone, Debug)]
pub struct Ram {
    bytes: Vec<u8>,
}

impl Ram {
    /// `size` bytes of zero.
    #[must_use]
    pub fn new(size: usize) -> Self {
        Self { bytes: vec![0; size] }
    }

    /// All of it.
    #[must_use]
    #[inline]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// All of it, to change.
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
        match width {
            Width::Byte => self.bytes.get_mut(at).map(|to| *to = value as u8),
            Width::Half => self.bytes.get_mut(at..at + 2).map(|to| to.copy_from_slice(&(value as u16).to_le_bytes())),
            Width::Word => self.bytes.get_mut(at..at + 4).map(|to| to.copy_from_slice(&value.to_le_bytes())),
        }
        .is_some()
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
