//! The seeds of the committed corpus: for each parser, valid inputs and inputs that are nearly valid. `cargo run -p
//! profile --example corpus` writes them.
use profile::{
    ABSENT_F32, Command, CommandObject, FixType, GpsObject, GpsStatus, GpsValues, HoldObject, HoldStatus,
    HoldStatusBits, HoldValues, HorusState, Identifier, Layout, LinkStatus, LinkStatusBits, LinkValues, PortStatus,
    PortStatusBits, PortValues, Profile, ReportedPosition, ReportedStatus, ReportedValues, ResetReason, Uplink,
    UplinkStatus, UplinkValues, Violation, air,
    criticality::{ActiveLoad, BaseStation, Dpr, FlightController, Writer},
    hold::{Acknowledged, Answer, Outcome},
    image::Image,
    map::{Map, PortArea},
    ssi::{self, Request, client::Config},
};

use super::reference::{self, flipped};
use super::tape::{NO_FRESH, Tape};

pub(crate) fn gps_values(timestamp: u32) -> GpsValues {
    GpsValues {
        timestamp,
        status: GpsStatus::new()
            .with_fix_type(FixType::Fix3D)
            .with_position_valid(true)
            .with_attitude_valid(true)
            .with_acceleration_valid(true)
            .with_heard(true)
            .with_solution_age_ms(Some(timestamp)),
        latitude: 47.497_912_3,
        longitude: 8.729_567_8,
        altitude: 493.217,
        pitch: 0.034,
        yaw: 2.25,
        roll: -0.125,
        acceleration: [0.25, -0.5, 9.75],
    }
}

pub(crate) fn reported_values(timestamp: u32) -> ReportedValues {
    let gps = gps_values(timestamp);
    ReportedValues {
        timestamp,
        status: ReportedStatus::new()
            .with_receivers_agreeing(3)
            .with_position_valid(true)
            .with_attitude_valid(true)
            .with_acceleration_valid(true)
            .with_state(HorusState::Monitoring)
            .with_reset_reason(ResetReason::Watchdog),
        latitude: gps.latitude,
        longitude: gps.longitude,
        altitude: gps.altitude,
        pitch: gps.pitch,
        yaw: gps.yaw,
        roll: gps.roll,
        acceleration: gps.acceleration,
    }
}

pub(crate) fn profile<const N: usize>(timestamp: u32) -> Profile<N> {
    let mut metres = 0.0;
    let gps = [(); N].map(|()| {
        metres += 1.0;
        GpsValues { altitude: metres, ..gps_values(timestamp) }
    });
    Profile::seal(&reported_values(timestamp), &gps)
}

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

pub(crate) fn port_values() -> PortValues {
    let mut values = PortValues {
        timestamp: 6_000,
        status: PortStatusBits::new().with_base_station_fresh(true).with_last_refused(true).with_self_test_passed(true),
        uplinks_accepted: 300,
        commands_carried_out: 2,
        last_command_timestamp: 5_500,
        last_command: Command::SelfTest.word(),
        base_station_age_ms: 40,
        flight_controller_age_ms: 501,
        integrity_faults: 11,
        flash_passes: 12,
        stuck_bits: 13,
        buffers_out_of_use: 14,
        last_stop: 0x0102_0304,
        ..PortValues::default()
    };
    for (times, kind) in (1..).zip(Violation::ALL) {
        values.violations.count(kind, times);
    }
    values
}

pub(crate) fn hold_values(timestamp: u32) -> HoldValues {
    HoldValues {
        timestamp,
        status: HoldStatusBits::from_bits(0x0083),
        temperature: 4.5,
        humidity: 42.5,
        set_point: 5.0,
        vibration: [0.25, 0.5, ABSENT_F32],
        greatest_shock: 38.5,
        supply: 12.125,
        output: -0.75,
        acknowledged: [Acknowledged::new(0x1234, Outcome::Done), Acknowledged::new(0x5678, Outcome::TooOld)],
        seconds: timestamp / 1_000,
    }
}

pub(crate) fn uplink_values(timestamp: u32) -> UplinkValues {
    let mut payload = [0; Uplink::PAYLOAD];
    (1..).zip(&mut payload).for_each(|(number, byte)| *byte = number);
    UplinkValues { timestamp, status: UplinkStatus::from_bits(0xF00F), payload }
}

pub(crate) fn port_area() -> PortArea {
    let mut area = PortArea::EMPTY;
    area.set_status(Writer::<Dpr>::claim(), PortStatus::seal(Writer::<Dpr>::claim(), &port_values()));
    let base = Writer::<BaseStation>::claim();
    area.set_uplink(base, Uplink::seal(base, &uplink_values(70)));
    let own = Writer::<FlightController>::claim();
    area.set_uplink(own, Uplink::seal(own, &uplink_values(80)));
    area
}

type Seeds = Vec<(String, Vec<u8>)>;

/// The seeds of each fuzz target, with its name; each seed has a name and bytes.
pub(crate) fn all() -> Vec<(&'static str, Seeds)> {
    vec![
        ("reported_position", reported_position()),
        ("gps_object", gps_object()),
        ("link_status", link_status()),
        ("profile", profiles()),
        ("air_frame", air_frames()),
        ("image", images()),
        ("ssi_request", ssi_requests()),
        ("client", tapes()),
        ("port_status", port_status()),
        ("written", written()),
        ("map", maps()),
        ("hold", hold()),
    ]
}

fn tapes() -> Seeds {
    let layout = Layout::for_receivers(3).unwrap();
    let image = |n: u32| {
        let link = LinkStatus::seal(&LinkValues { timestamp: 5_000 + 10 * n, ..link_values() });
        [link.as_bytes().as_slice(), profile::<3>(10 * n).as_bytes(), &[0; 192]].concat()
    };
    let started = || {
        let mut tape = Tape::default();
        tape.config(3, &Config::new(layout));
        (0..6).for_each(|n| tape.transaction(10_000 * u64::from(n), NO_FRESH, &image(n)[..96]));
        tape
    };
    let mut asking = started();
    asking.ask(96, 60);
    asking.transaction(60_000, 59_000, &image(6)[..96]);
    asking.transaction(64_000, 59_000, &image(6)[96..156]);
    asking.view();
    asking.transaction(68_000, 59_000, &[0xFF; 96]);
    let mut writing = started();
    writing.command(1, 1);
    writing.uplink(2, 3, &[4; 52]);
    writing.transaction(60_000, NO_FRESH, &image(6)[..96]);
    let mut commanding = Tape::default();
    commanding.config(3, &Config { read_bytes: 532, ..Config::new(layout.with_hold()) });
    for n in 0..4 {
        let status = HoldStatus::seal(Writer::<ActiveLoad>::claim(), &hold_values(100 * n));
        let map = [&image(n)[..], status.as_bytes()].concat();
        commanding.transaction(10_000 * u64::from(n), NO_FRESH, &map);
        commanding.send(n.to_le_bytes()[0], 4.5);
        commanding.commanding(n, 3, &[4; 52]);
    }
    commanding.give_up();
    commanding.view();
    let tapes = [("starting", started()), ("asking", asking), ("writing", writing), ("commanding", commanding)];
    tapes.map(|(name, tape)| (name.into(), tape.0)).into()
}

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
        ("port-status".into(), request(276, 64)),
        ("last-byte-of-the-map".into(), request(467, 1)),
        ("last-byte".into(), request(275, 1)),
        ("one-past-the-end".into(), request(276, 1)),
        ("empty-window".into(), request(32, 0)),
        ("wraps-16-bits".into(), request(0xFFFF, 2)),
        ("crc-wrong".into(), flipped(&request(32, 64), [63])),
        ("one-byte-short".into(), request(32, 64)[..7].to_vec()),
        ("zero-with-its-crc".into(), request(0, 0)),
    ]
}

fn port_status() -> Seeds {
    let mut seeds = around("valid", PortStatus::seal(Writer::<Dpr>::claim(), &port_values()).as_bytes());
    seeds.extend(scrubbed(PortStatus::SIZE));
    let start = PortStatus::seal(Writer::<Dpr>::claim(), &PortValues::default());
    seeds.push(("at-start".into(), start.as_bytes().to_vec()));
    seeds
}

fn written() -> Seeds {
    let own = Writer::<FlightController>::claim();
    let uplink = Uplink::seal(Writer::<BaseStation>::claim(), &uplink_values(70));
    let mut seeds = around("uplink-base-station", uplink.as_bytes());
    seeds.extend(scrubbed(Uplink::SIZE));
    seeds.push(("uplink-flight-controller".into(), Uplink::seal(own, &uplink_values(80)).as_bytes().to_vec()));
    for (name, command) in [("clear-counters", Command::ClearCounters), ("self-test", Command::SelfTest)] {
        let valid = CommandObject::seal(own, 90, command);
        for (nearly, bit) in [("word", 8 * 8), ("first-reserved", 8 * 12), ("last-reserved", 8 * 59 + 7)] {
            let mut bytes = flipped(valid.as_bytes(), [bit]);
            reference::repair_frame_crc(&mut bytes);
            seeds.push((format!("{name}-{nearly}-bit-flipped"), bytes));
        }
        seeds.push((name.into(), valid.as_bytes().to_vec()));
    }
    seeds
}

fn maps() -> Seeds {
    let mut seeds = scrubbed(468);
    let mut image = Image::<3>::EMPTY;
    image.set_link(LinkStatus::seal(&link_values()));
    let port = port_area();
    let map = Map::new(image, port);
    seeds.push(("gps3".into(), map.as_bytes().to_vec()));
    seeds.push(("gps3-image-only".into(), Map::new(image, PortArea::EMPTY).as_bytes().to_vec()));
    seeds.push(("gps1".into(), Map::new(Image::<1>::EMPTY, port).as_bytes().to_vec()));
    let (before, uplinks) = map.as_bytes().split_at(276 + 64);
    seeds.push(("gps3-uplinks-exchanged".into(), [before, &uplinks[64..], &uplinks[..64]].concat()));
    seeds.push(("gps3-one-byte-short".into(), map.as_bytes()[..467].to_vec()));
    seeds
}

fn hold() -> Seeds {
    let writer = Writer::<ActiveLoad>::claim();
    let mut seeds = around("valid", HoldStatus::seal(writer, &hold_values(10_000)).as_bytes());
    seeds.extend(scrubbed(HoldObject::SIZE));
    let start = HoldStatus::seal(writer, &HoldValues::absent(0));
    seeds.push(("at-start".into(), start.as_bytes().to_vec()));
    let theirs = HoldObject::seal(writer, Identifier(0x41FF), &start.as_object().values());
    seeds.push(("of-another-maker".into(), theirs.as_bytes().to_vec()));
    let step = |time: u8, timestamp: u32, number: u8, word: u8| {
        let mut values = UplinkValues { timestamp, ..UplinkValues::default() };
        values.payload[..8].copy_from_slice(&[number, 0, word, 0, 0, 0, 0x90, 0x40]);
        let mut answer = Answer::EMPTY;
        let (base, own) = (Writer::<BaseStation>::claim(), Writer::<FlightController>::claim());
        answer.set_uplink(base, Uplink::seal(base, &values));
        answer.set_uplink(own, Uplink::seal(own, &values));
        [&[time][..], answer.as_bytes()].concat()
    };
    let words: Vec<_> = (0..6).map(|n| step(12, 100 * u32::from(n), n, n)).collect();
    seeds.push(("commands".into(), words.concat()));
    let late = [step(0, 0, 0, 0), step(12, 100, 1, 2), step(12, 200, 1, 2), step(254, 200, 2, 2)];
    seeds.push(("commands-repeated-and-too-late".into(), late.concat()));
    let behind = [step(0, 500, 0, 0), step(13, 600, 1, 2), step(13, 100, 2, 3), step(13, 200, 2, 3)];
    seeds.push(("commands-after-a-restart".into(), behind.concat()));
    seeds
}
