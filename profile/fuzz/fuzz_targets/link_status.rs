//! Fuzzes one parser of the crate. `tests/support/invariants.rs` says what must hold for every input.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../tests/support/mod.rs"]
mod support;

fuzz_target!(|input: &[u8]| support::invariants::link_status(input));
