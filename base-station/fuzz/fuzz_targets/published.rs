//! Fuzzes the parser of published messages; `tests/parsers/bodies.rs` says what must hold for every input.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../tests/parsers/bodies.rs"]
mod bodies;

fuzz_target!(|input: &[u8]| bodies::message(input));
