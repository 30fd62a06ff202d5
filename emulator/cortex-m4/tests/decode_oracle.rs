//! Compares which encodings are instructions with a recording of LLVM's disassembler.
//!
//! `cargo xtask oracle --record` makes the recording, and also compares the registers of each instruction. Every 16-bit
//! encoding is compared, and 16 encodings for each first halfword of a 32-bit instruction.

use core_oracle::decode::{Verdict, encodings, verdict};

#[test]
fn the_decoder_knows_the_instructions_that_llvm_knows() {
    let recorded = include_bytes!("data/decode.bin");
    let encodings = encodings();
    assert_eq!(recorded.len(), encodings.len().div_ceil(4));
    for (i, &encoding) in encodings.iter().enumerate() {
        let code = recorded[i / 4] >> (2 * (i % 4)) & 3;
        let known = code == Verdict::Both as u8 || code == Verdict::OursUndefined as u8;
        assert_eq!(verdict(known, encoding) as u8, code, "{:04x} {:04x}", encoding.0, encoding.1);
    }
}
