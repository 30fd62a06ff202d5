//! Describes in words how the core decodes an encoding, for tests of the decoder.

use crate::decode;

/// Returns the size in bytes and a description of the instruction at `address`, with the operands as the core holds
/// them. The text is for comparison only: it is no assembler syntax, and its form may change. `second` counts only if
/// `first` begins a 32-bit instruction. An encoding that the core does not execute gives `Fault(...)`.
#[must_use]
pub fn describe(address: u32, first: u16, second: u16) -> (u8, String) {
    if decode::is_wide(first) {
        (4, format!("{:?}", decode::wide(address, first, second).what))
    } else {
        (2, format!("{:?}", decode::narrow(address, first).what))
    }
}
