//! See `tests/support/invariants.rs` for what is asserted.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../tests/support/mod.rs"]
mod support;

fuzz_target!(|input: &[u8]| support::invariants::hold(input));
