//! Compares what instructions do with a recording of QEMU in the same random cases.
//!
//! `cargo xtask oracle --record` makes the recording. The crate `core-oracle` makes the cases.

use core_oracle::recording::Recording;

#[test]
fn instructions_leave_registers_flags_memory_and_faults_as_qemu_does() {
    let recording = Recording::from_text(include_str!("data/execution.txt")).expect("the recording");
    let cases: usize = recording.classes.iter().map(|class| class.cases).sum();
    assert!(cases > 50_000, "{cases} cases");
    let differing = recording.check().expect("each image gets to its end");
    assert!(differing.is_empty(), "{} batches differ, the first: {:?}", differing.len(), differing.first());
}
