//! Minutes of what `cargo run -p base-station --example endurance` does for a day. Alone in its process, whose memory
//! it looks at.

#[path = "../examples/endurance.rs"]
mod endurance;

#[test]
fn a_recording_holds_all_that_arrived_and_takes_no_memory_for_it() {
    let folder = std::env::temp_dir().join(format!("horus-base-endurance-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    // Ten minutes: a hundred bytes that each arrival leaves behind would be 6 MB.
    let figures = endurance::run(60_000, &folder, |_| {}).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    assert!(figures.is_good(), "{figures:?}");
    assert!(figures.growth_kb() < 4 << 10, "{figures:?}");
    assert_eq!((figures.arrivals, figures.parts), (60_600, 1));
    // Of the damaged ones an object each, or the field between two that nothing protects.
    assert_eq!(figures.refused, 600);
    assert_eq!(figures.shown, 60_000 * 5 - 600);
}
