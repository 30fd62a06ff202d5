//! The committed corpus: for each parser, what is valid, and what is nearly so. `cargo run -p profile --example corpus`
//! writes it.
use profile::{
    FixType, GpsObject, GpsStatus, GpsValues, HorusState, Identifier, LinkStatus, LinkStatusBits, LinkValues, Profile,
    ReportedPosition, ReportedStatus, ReportedValues, air,
    image::Image,
    ssi::{self, Request},
};

use super::reference::{self, flipped};

/// A receiver's values with every field in use.
pub(crate) fn gps_values(timestamp: u32) -> GpsValues {
    GpsValues {
        timestamp,
        status: GpsStatus::new()
            .with_fix_type(FixType::Fix3D)
            .with_position_valid(true)
            .with_attitude_valid(true)
            .with_acceleration_valid(true)
            .with_heard(true),
        latitude: 47.497_912_3,
        longitude: 8.729_567_8,
        altitude: 493.217,
        pitch: 0.034,
        yaw: 2.25,
        roll: -0.125,
        acceleration: [0.25, -0.5, 9.75],
    }
}

/// A reported position with every field in use.
pub(crate) fn reported_values(timestamp: u32) -> ReportedValues {
    let gps = gps_values(timestamp);
    ReportedValues {
        timestamp,
        status: ReportedStatus::new()
            .with_receivers_agreeing(3)
            .with_position_valid(true)
            .with_attitude_valid(true)
            .with_acceleration_valid(true)
            .with_state(HorusState::Monitoring),
        latitude: gps.latitude,
        longitude: gps.longitude,
        altitude: gps.altitude,
        pitch: gps.pitch,
        yaw: gps.yaw,
        roll: gps.roll,
        acceleration: gps.acceleration,
    }
}

/// A profile whose receivers differ.
pub(crate) fn profile<const N: usize>(timestamp: u32) -> Profile<N> {
    let mut metres = 0.0;
    let gps = [(); N].map(|()| {
        metres += 1.0;
        GpsValues { altitude: metres, ..gps_values(timestamp) }
    });
    Profile::seal(&reported_values(timestamp), &gps)
}

/// Link-Status with every field in use.
pub(crate) fn link_values() -> LinkValues {
    LinkValues {
        timestamp: 5_000,
        status: LinkStatusBits::new().with_link_up(true).with_all_accepted(true),
        objects_accepted: 4_000,
        objects_rejected: 1,
        frames_received: 1_000,
        frames_missed: 2,
        age_100us: 53,
        access_violations: 7,
    }
}

type Seeds = Vec<(String, Vec<u8>)>;

/// The seeds of every fuzz target: target, then name and bytes of each.
pub(crate) fn all() -> Vec<(&'static str, Seeds)> {
    vec![
        ("reported_position", reported_position()),
        ("gps_object", gps_object()),
        ("link_status", link_status()),
        ("profile", profiles()),
        ("air_frame", air_frames()),
        ("image", images()),
        ("ssi_request", ssi_requests()),
    ]
}

/// `valid` as it is, and all the ways in which any object can be nearly that.
fn around(name: &str, valid: &[u8]) -> Seeds {
    let size = valid.len();
    let mut long = valid.to_vec();
    long.push(0);
    let mut unused_status = valid.to_vec();
    unused_status[7] |= 0xF0;
    reference::repair_frame_crc(&mut unused_status);
    let mut little_endian_crc = valid.to_vec();
    little_endian_crc[size - 4..].reverse();
    vec![
        (name.into(), valid.to_vec()),
        (format!("{name}-first-bit-flipped"), flipped(valid, [0])),
        (format!("{name}-last-bit-flipped"), flipped(valid, [8 * size - 1])),
        (format!("{name}-burst-across-the-crc"), flipped(valid, 8 * (size - 4) - 16..8 * (size - 4) + 16)),
        (format!("{name}-one-byte-short"), valid[..size - 1].to_vec()),
        (format!("{name}-one-byte-long"), long),
        (format!("{name}-unused-status-bits"), unused_status),
        (format!("{name}-crc-little-endian"), little_endian_crc),
    ]
}

/// What a scrub leaves behind, and nothing at all.
fn scrubbed(size: usize) -> Seeds {
    vec![("empty".into(), vec![]), ("scrubbed-00".into(), vec![0x00; size]), ("scrubbed-ff".into(), vec![0xFF; size])]
}

fn reported_position() -> Seeds {
    let mut seeds = around("valid", ReportedPosition::seal(&reported_values(1_230)).as_bytes());
    seeds.extend(scrubbed(ReportedPosition::SIZE));
    let absent = ReportedPosition::seal(&ReportedValues::absent(u32::MAX));
    seeds.push(("absent".into(), absent.as_bytes().to_vec()));
    let mut position = flipped(absent.as_bytes(), [64]);
    reference::repair_frame_crc(&mut position);
    seeds.push(("position-crc-wrong".into(), position));
    let mut other = absent.as_bytes().to_vec();
    other[4..6].copy_from_slice(&Identifier::LINK_STATUS.0.to_le_bytes());
    reference::repair_frame_crc(&mut other);
    seeds.push(("other-identifier".into(), other));
    seeds
}

fn gps_object() -> Seeds {
    let mut seeds = around("gps1", GpsObject::seal(Identifier::gps(1), &gps_values(1_230)).as_bytes());
    seeds.extend(scrubbed(GpsObject::SIZE));
    for receiver in 2..=5 {
        let absent = GpsObject::seal(Identifier::gps(receiver), &GpsValues::absent(u32::MAX));
        seeds.push((format!("gps{receiver}-absent"), absent.as_bytes().to_vec()));
    }
    let uplink = GpsObject::seal(Identifier::UPLINK_BASE_STATION, &gps_values(0));
    seeds.push(("other-identifier".into(), uplink.as_bytes().to_vec()));
    seeds
}

fn link_status() -> Seeds {
    let mut seeds = around("valid", LinkStatus::seal(&link_values()).as_bytes());
    seeds.extend(scrubbed(LinkStatus::SIZE));
    let start = LinkStatus::seal(&LinkValues::default());
    seeds.push(("at-start".into(), start.as_bytes().to_vec()));
    seeds
}

fn profiles() -> Seeds {
    let mut seeds = scrubbed(244);
    for (n, bytes) in every_profile() {
        seeds.push((format!("gps{n}"), bytes.clone()));
        seeds.push((format!("gps{n}-one-byte-short"), bytes[..bytes.len() - 1].to_vec()));
        // The last 16 bits of Reported-Position and the first 16 of GPS1.
        seeds.push((format!("gps{n}-burst-across-objects"), flipped(&bytes, 8 * 64 - 16..8 * 64 + 16)));
    }
    seeds.push(("gps3-gps1-and-gps2-exchanged".into(), exchanged(profile::<3>(70).as_bytes())));
    seeds
}

fn every_profile() -> [(usize, Vec<u8>); 4] {
    [
        (1, profile::<1>(10).as_bytes().to_vec()),
        (2, profile::<2>(20).as_bytes().to_vec()),
        (3, profile::<3>(30).as_bytes().to_vec()),
        (5, profile::<5>(50).as_bytes().to_vec()),
    ]
}

/// GPS1 in the place of GPS2 and the other way round.
fn exchanged(profile: &[u8]) -> Vec<u8> {
    let (reported, gps) = profile.split_at(64);
    [reported, &gps[60..120], &gps[..60], &gps[120..]].concat()
}

fn air_frames() -> Seeds {
    let mut seeds = scrubbed(244);
    seeds.push(("longest-possible".into(), vec![0x5A; air::MAX_PAYLOAD]));
    for (n, bytes) in every_profile() {
        if n < 5 {
            seeds.push((format!("gps{n}"), bytes.clone()));
            seeds.push((format!("gps{n}-last-object-hit"), flipped(&bytes, [8 * bytes.len() - 240])));
            seeds.push((format!("gps{n}-one-byte-short"), bytes[..bytes.len() - 1].to_vec()));
            seeds.push((format!("gps{n}-one-byte-long"), [&bytes[..], &[0]].concat()));
        } else {
            let (first, second) = bytes.split_at(184);
            seeds.push(("gps5-first".into(), first.to_vec()));
            seeds.push(("gps5-second".into(), second.to_vec()));
            seeds.push(("gps5-second-one-byte-short".into(), second[..179].to_vec()));
            seeds.push(("gps5-second-with-the-first-objects".into(), first[..180].to_vec()));
        }
    }
    seeds
}

fn images() -> Seeds {
    let mut seeds = scrubbed(276);
    let link = LinkStatus::seal(&link_values());
    for (n, bytes) in every_profile() {
        let image = [link.as_bytes(), &bytes[..]].concat();
        seeds.push((format!("gps{n}-one-byte-short"), image[..image.len() - 1].to_vec()));
        seeds.push((format!("gps{n}"), image));
    }
    let mut nothing_yet = Image::<3>::EMPTY;
    nothing_yet.set_link(link);
    seeds.push(("gps3-link-status-only".into(), nothing_yet.as_bytes().to_vec()));
    seeds
}

fn ssi_requests() -> Seeds {
    let request = |offset, length| ssi::encode(Request { offset, length }).to_vec();
    vec![
        ("nothing".into(), vec![0; 8]),
        ("idle-high".into(), vec![0xFF; 8]),
        ("reported-position".into(), request(32, 64)),
        ("whole-image".into(), request(0, 276)),
        ("last-byte".into(), request(275, 1)),
        ("one-past-the-end".into(), request(276, 1)),
        ("empty-window".into(), request(32, 0)),
        ("wraps-16-bits".into(), request(0xFFFF, 2)),
        ("crc-wrong".into(), flipped(&request(32, 64), [63])),
        ("one-byte-short".into(), request(32, 64)[..7].to_vec()),
        ("zero-with-its-crc".into(), request(0, 0)),
    ]
}
