//! Helpers that several tests use.
#![allow(dead_code, reason = "each test file uses what it needs")]

use profile::{GpsStatus, GpsValues, HorusState, LinkStatus, LinkValues, Profile, ReportedStatus, ReportedValues};

/// Prints that a test is not run because something is `missing`, and `how` to get it.
///
/// # Panics
///
/// Panics if the environment has `CI`, where nobody would notice that the test was not run.
pub(crate) fn not_run(missing: &str, how: &str) {
    assert!(std::env::var_os("CI").is_none(), "not run: {missing} ({how})");
    eprintln!("not run: {missing} ({how})");
}

pub(crate) fn image(timestamp: u32) -> Vec<u8> {
    let status = ReportedStatus::new()
        .with_position_valid(true)
        .with_attitude_valid(true)
        .with_receivers_agreeing(3)
        .with_state(HorusState::Monitoring);
    let (latitude, longitude) = (47.497_9 + f64::from(timestamp % 60_000) * 1e-8, 8.728_9);
    let altitude = 470.0 + f64::from(timestamp % 1_000) / 100.0;
    let (pitch, yaw, roll) = (-0.05, 1.25, 0.2);
    let absent = ReportedValues::absent(timestamp);
    let reported = ReportedValues { status, latitude, longitude, altitude, pitch, yaw, roll, ..absent };
    let status = GpsStatus::new().with_position_valid(true).with_heard(true);
    let gps = GpsValues { status, latitude, longitude, altitude, ..GpsValues::absent(timestamp) };
    let link = LinkStatus::seal(&LinkValues { timestamp: timestamp + 7, ..LinkValues::default() });
    [link.as_bytes(), Profile::<3>::seal(&reported, &[gps; 3]).as_bytes()].concat()
}

/// Pseudorandom numbers from a seed (SplitMix64).
pub(crate) struct Drawn(pub(crate) u64);

impl Drawn {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        x ^ (x >> 31)
    }

    pub(crate) fn below(&mut self, end: u64) -> u64 {
        self.next() % end
    }
}
