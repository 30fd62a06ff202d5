//! Runs ten minutes of `cargo run -p base-station --example endurance`. The test is alone in its process, whose memory
//! it measures.

#[path = "../examples/endurance.rs"]
mod endurance;

#[test]
fn a_recording_holds_all_that_arrived_and_takes_no_memory_for_it() {
    let folder = std::env::temp_dir().join(format!("horus-base-endurance-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    // A leak of a hundred bytes per arrival would be 6 MB in ten minutes.
    let figures = endurance::run(60_000, &folder, |_| {}).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    assert!(figures.is_good(), "{figures:?}");
    assert!(figures.growth_kb() < 4 << 10, "{figures:?}");
    assert_eq!((figures.arrivals, figures.parts), (60_600, 1));
    // The 600 damaged messages lose one object each, because every flipped bit lies in a field that a CRC protects.
    assert_eq!(figures.refused, 600);
    assert_eq!(figures.shown, 60_000 * 5 - 600);
}
