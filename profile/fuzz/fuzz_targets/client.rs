//! Plays one tape (`tests/support/tape.rs`) to the flight controller's clients in Rust and in C. Both must write the
//! same output. `tests/support/invariants.rs` says what else must hold.
#![no_main]

use std::ffi::c_void;

use libfuzzer_sys::fuzz_target;

#[path = "../../tests/support/mod.rs"]
mod support;

use support::{invariants, tape};

type Sink = extern "C" fn(context: *mut c_void, text: *const u8, count: usize);

unsafe extern "C" {
    /// The player of tapes for the C client, as `profile/c/tests/tape.h` declares it.
    fn horus_dpr_play(tape: *const u8, count: usize, sink: Sink, context: *mut c_void);
}

extern "C" fn gather(context: *mut c_void, text: *const u8, count: usize) {
    // SAFETY: `context` is the vector that `c` passes, which is not used elsewhere meanwhile; `text` are `count`
    // characters.
    let (said, text) = unsafe { (&mut *context.cast::<Vec<u8>>(), std::slice::from_raw_parts(text, count)) };
    said.extend_from_slice(text);
}

fn c(tape: &[u8]) -> String {
    let mut said = Vec::<u8>::new();
    // SAFETY: the tape outlives the call, which reads `count` bytes of it and calls `gather` with the vector.
    unsafe { horus_dpr_play(tape.as_ptr(), tape.len(), gather, (&raw mut said).cast()) };
    String::from_utf8(said).expect("text")
}

fuzz_target!(|input: &[u8]| {
    invariants::client(input);
    assert_eq!(tape::play(input, |_| {}), c(input), "in Rust and in C");
});
