//! What an encoding means, in words, for those who check the decoder.

use crate::decode;

/// The size in bytes of the instruction at `address`, and the operation with its operands as the core holds them. The
/// text is for comparison: it is not an assembler's, and has no form that is kept. `second` counts where `first` begins
/// an instruction of 32 bits. What the core does not execute reads `Fault(...)`.
#[must_use]
pub fn describe(address: u32, first: u16, second: u16) -> (u8, String) {
    if decode::is_wide(first) {
        (4, format!("{:?}", decode::wide(address, first, second).what))
    } else {
        (2, format!("{:?}", decode::narrow(address, first).what))
    }
}
