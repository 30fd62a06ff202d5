//! What instructions do, compared with what QEMU was recorded to do with the same random cases.
//!
//! The recording is made by `cargo xtask oracle --record`; the crate `core-oracle` makes the cases from its seed.

use core_oracle::recording::Recording;

#[test]
fn instructions_leave_registers_flags_memory_and_faults_as_qemu_does() {
    let recording = Recording::from_text(include_str!("data/execution.txt")).expect("the recording");
    let cases: usize = recording.classes.iter().map(|class| class.cases).sum();
    assert!(cases > 50_000, "{cases} cases");
    let differing = recording.check().expect("each image gets to its end");
    assert!(differing.is_empty(), "{} batches differ, the first: {:?}", differing.len(), differing.first());
}
