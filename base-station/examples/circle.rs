//! Simulates the flight controller of a drone that flies in a circle: sends MAVLink to UDP port 14550 of this machine.
//! The values are invented; objects, forwarder and messages are the real ones.
//!
//!     cargo run -p base-station --example circle -- [SYSTEM] [SECONDS] [ADDRESS:PORT]

use std::f64::consts::TAU;
use std::net::UdpSocket;
use std::thread::sleep;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use base_station::Bundle;
use base_station::carrier::mavlink::{Forwarder, Rates};
use profile::{
    FixType, GpsStatus, GpsValues, HorusState, LinkStatus, LinkStatusBits, LinkValues, Profile, ReportedStatus,
    ReportedValues,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let system = arguments.next().map_or(Ok(1), |argument| argument.parse())?;
    let seconds = arguments.next().map_or(Ok(60), |argument| argument.parse())?;
    let to = arguments.next().unwrap_or_else(|| "127.0.0.1:14550".into());
    let socket = UdpSocket::bind("0.0.0.0:0")?;
    let mut forwarder = Forwarder::new(system, 1, Rates { bytes_per_s: 6_000, ..Rates::default() });
    let began = Instant::now();
    for cycle in 0..seconds * 100_u32 {
        sleep((began + Duration::from_millis(10) * cycle).saturating_duration_since(Instant::now()));
        forwarder.offer(&Bundle::datagram(&image(10 * cycle)).ok_or("an image of three receivers")?);
        let now_us = u64::from(cycle) * 10_000;
        let unix_us = u64::try_from(SystemTime::now().duration_since(UNIX_EPOCH)?.as_micros())?;
        while let Some(message) = forwarder.poll(now_us, unix_us) {
            socket.send_to(&message, &to)?;
        }
    }
    Ok(())
}

/// Returns the DPR's image `ms` after HORUS's start. The drone circles at a radius of 150 m and rises and sinks by 20
/// m; a turn takes half a minute. From 20 to 40 s of each minute the third receiver drifts away and is excluded.
fn image(ms: u32) -> Vec<u8> {
    let seconds = f64::from(ms) / 1e3;
    let angle = TAU * seconds / 30.0;
    let (north, east, up) = (150.0 * angle.cos(), 150.0 * angle.sin(), 60.0 + 20.0 * (angle / 2.0).sin());
    let place = |north: f64, east: f64| (47.4979 + north / 111_200.0, 8.7290 + east / 75_200.0);
    let lost = seconds % 60.0 > 20.0 && seconds % 60.0 < 40.0;
    let gps = |offset: f64, excluded: bool| {
        let (latitude, longitude) = place(north + offset, east - offset / 2.0);
        let status = GpsStatus::new().with_fix_type(FixType::Fix3D).with_position_valid(true).with_heard(true);
        let status = status.with_solution_age_ms(Some(ms % 100));
        let altitude = 470.0 + up + offset / 3.0;
        GpsValues { status: status.with_excluded(excluded), latitude, longitude, altitude, ..GpsValues::absent(ms) }
    };
    let off = if lost { 3.0 * (seconds % 60.0 - 20.0) } else { 0.8 };
    let gps = [gps(0.6, false), gps(-0.7, false), gps(off, lost && off > 8.0)];
    let agreeing = if lost && off > 8.0 { 2 } else { 3 };
    let (latitude, longitude) = place(north, east);
    let status = ReportedStatus::new()
        .with_position_valid(true)
        .with_attitude_valid(true)
        .with_receivers_agreeing(agreeing)
        .with_degraded(agreeing < 3)
        .with_state(HorusState::Monitoring);
    let yaw = (angle + TAU / 4.0).rem_euclid(TAU) as f32;
    let altitude = 470.0 + up;
    let reported = ReportedValues {
        status,
        latitude,
        longitude,
        altitude,
        pitch: -0.05,
        yaw,
        roll: 0.2,
        ..ReportedValues::absent(ms)
    };
    let link = LinkValues {
        timestamp: ms + 4_321,
        status: LinkStatusBits::new().with_link_up(true).with_all_accepted(true),
        objects_accepted: ms / 10 * 4,
        frames_received: ms / 10,
        age_100us: 50,
        ..LinkValues::default()
    };
    [LinkStatus::seal(&link).as_bytes(), Profile::<3>::seal(&reported, &gps).as_bytes()].concat()
}
