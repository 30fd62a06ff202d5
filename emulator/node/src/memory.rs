//! Access to a part's memory without timing or side effects.

use emulator_part::Part;

/// The little-endian value of `length` (1 to 8) bytes at `address`; `None` if a byte is not memory.
pub(crate) fn value<P: Part>(part: &P, address: u64, length: usize) -> Option<u64> {
    let bytes = part.memory(u32::try_from(address).ok()?, length)?;
    let mut word = [0; 8];
    word.get_mut(..length)?.copy_from_slice(bytes);
    Some(u64::from_le_bytes(word))
}

/// Fills `to` from `address`. Returns whether all of it is memory.
pub(crate) fn read<P: Part>(part: &P, address: u64, to: &mut [u8]) -> bool {
    let found = u32::try_from(address).ok().and_then(|address| part.memory(address, to.len()));
    found.map(|bytes| to.copy_from_slice(bytes)).is_some()
}

/// Writes `from` at `address`, flash included. Returns whether all of it is memory.
pub(crate) fn write<P: Part>(part: &mut P, address: u64, from: &[u8]) -> bool {
    let found = u32::try_from(address).ok().and_then(|address| part.memory_mut(address, from.len()));
    found.map(|bytes| bytes.copy_from_slice(from)).is_some()
}
