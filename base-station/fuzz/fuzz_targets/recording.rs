//! See `tests/parsers/bodies.rs` for what is asserted.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../tests/parsers/bodies.rs"]
mod bodies;

fuzz_target!(|input: &[u8]| bodies::recording(input));
