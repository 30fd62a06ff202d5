use mavlink::dialects::common::{MavMessage, MavState, STATUSTEXT_DATA};
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MavlinkReader, MavlinkVersion, Message, MessageData};
use profile::criticality::{ActiveLoad, Writer};
use profile::image::Image;
use profile::{
    GpsValues, HoldStatus, HoldValues, HorusState, Layout, LinkStatus, LinkValues, Profile, ReportedStatus,
    ReportedValues,
};
use proptest::prelude::*;

use super::forwarder::*;
use super::tunnel::Tunnel;
use super::*;
use crate::{Bundle, Fleet, Place, Source, Verdict};

const SECOND: u64 = 1_000_000;

const NOW: u64 = 1_790_000_000 * SECOND;

fn image<const N: usize>(timestamp: u32) -> Vec<u8> {
    let status = ReportedStatus::new()
        .with_position_valid(true)
        .with_attitude_valid(true)
        .with_receivers_agreeing(3)
        .with_state(HorusState::Monitoring);
    let (latitude, longitude) = (47.497_9, 8.728_9);
    let known = ReportedValues { status, latitude, longitude, pitch: 0.1, yaw: 0.2, roll: 0.3, ..absent(timestamp) };
    let gps = GpsValues { latitude, longitude, ..GpsValues::absent(timestamp) };
    let mut image = Image::<N>::EMPTY;
    image.set_link(LinkStatus::seal(&LinkValues { timestamp: timestamp + 7, ..LinkValues::default() }));
    let mut bytes = image.as_bytes()[..32].to_vec();
    bytes.extend(Profile::<N>::seal(&known, &[gps; N]).as_bytes());
    bytes
}

fn absent(timestamp: u32) -> ReportedValues {
    ReportedValues::absent(timestamp)
}

fn image_of(receivers: usize, timestamp: u32) -> Vec<u8> {
    match receivers {
        1 => image::<1>(timestamp),
        2 => image::<2>(timestamp),
        3 => image::<3>(timestamp),
        _ => image::<5>(timestamp),
    }
}

fn offer(forwarder: &mut Forwarder, image: &[u8]) {
    forwarder.offer(&Bundle::datagram(image).unwrap());
}

fn drain(forwarder: &mut Forwarder, now_us: u64) -> Vec<Vec<u8>> {
    std::iter::from_fn(|| forwarder.poll(now_us, NOW + now_us)).collect()
}

fn free() -> Rates {
    Rates { bytes_per_s: 100_000, period_us: 0, standard_us: 0 }
}

#[test]
fn each_new_object_of_the_hold_is_sent_once_beside_the_others() {
    let mut forwarder = Forwarder::new(7, 1, free());
    let mut receiver = Receiver::default();
    let mut sent = |ms: u32, at: u64| {
        let hold = HoldStatus::seal(Writer::<ActiveLoad>::claim(), &HoldValues::absent(ms));
        offer(&mut forwarder, &image_of(1, 70_000 + ms));
        forwarder.offer(&Bundle::new(Place::Hold, 1, hold.as_bytes()).unwrap());
        forwarder.offer(&Bundle::new(Place::Hold, 1, &[0; 64]).unwrap());
        let frames = drain(&mut forwarder, at);
        let received = frames.iter().flat_map(|frame| receiver.datagram(NOW, frame)).collect::<Vec<_>>();
        let objects =
            received.iter().filter_map(Received::bundle).flat_map(|bundle| bundle.objects().collect::<Vec<_>>());
        let holds = objects.filter(|(place, _)| *place == Place::Hold).map(|(_, bytes)| bytes == hold.as_bytes());
        (received.len(), holds.collect::<Vec<_>>())
    };
    assert_eq!(sent(100, SECOND), (3, vec![true]), "Link-Status with Reported-Position, GPS1, Hold-Status");
    assert_eq!(sent(100, 2 * SECOND), (0, vec![]));
    assert_eq!(sent(200, 3 * SECOND), (3, vec![true]), "in a message of its own");
}

#[test]
fn what_was_read_of_the_dpr_arrives_as_it_was() {
    for receivers in [1, 2, 3, 5] {
        let mut forwarder = Forwarder::new(7, 1, free());
        let mut receiver = Receiver::default();
        let sent = image_of(receivers, 70_000);
        offer(&mut forwarder, &sent);
        let mut arrived = vec![];
        for frame in drain(&mut forwarder, SECOND) {
            for received in receiver.datagram(NOW, &frame) {
                assert_eq!((received.system, received.component), (7, 1));
                arrived.extend(received.bundle().unwrap().objects().map(|(place, bytes)| (place, bytes.to_vec())));
            }
        }
        arrived.sort();
        let expected = Bundle::datagram(&sent).unwrap().objects().map(|(place, bytes)| (place, bytes.to_vec()));
        assert_eq!(arrived, expected.collect::<Vec<_>>());
        assert_eq!(drain(&mut forwarder, 2 * SECOND), Vec::<Vec<u8>>::new(), "nothing is sent twice");
        offer(&mut forwarder, &sent);
        assert_eq!(drain(&mut forwarder, 3 * SECOND), Vec::<Vec<u8>>::new(), "not even if it is read again");
    }
}

#[test]
fn vacant_objects_are_not_sent() {
    let mut forwarder = Forwarder::new(7, 1, free());
    let mut sent = image_of(3, 70_000);
    sent[..32].fill(0);
    sent[96..156].fill(0xFF);
    offer(&mut forwarder, &sent);
    let mut receiver = Receiver::default();
    let frames = drain(&mut forwarder, SECOND);
    let received: Vec<_> = frames.iter().flat_map(|frame| receiver.datagram(NOW, frame)).collect();
    let places: Vec<_> = received
        .iter()
        .flat_map(|received| received.bundle().unwrap().objects().map(|(place, _)| place).collect::<Vec<_>>())
        .collect();
    assert_eq!(places, [Place::Reported, Place::Gps(2), Place::Gps(3)]);
}

#[test]
fn the_newest_goes_and_what_it_replaced_never_does() {
    let mut forwarder = Forwarder::new(7, 1, Rates { bytes_per_s: 1_000, period_us: 100_000, standard_us: 0 });
    let mut fleet = Fleet::default();
    let mut receiver = Receiver::default();
    for cycle in 0..1_000_u32 {
        let now = u64::from(cycle) * 10_000;
        offer(&mut forwarder, &image_of(5, 70_000 + 10 * cycle));
        for frame in drain(&mut forwarder, now) {
            for received in receiver.datagram(NOW, &frame) {
                for verdict in fleet.take(received.who(), Source::default(), now, &received.bundle().unwrap()).1 {
                    assert_eq!(verdict, Verdict::New);
                }
                let drone = fleet.get(received.who().first()).unwrap();
                assert_eq!(drone.timestamp(), Some(70_000 + 10 * cycle), "it is what was read last");
            }
        }
    }
}

#[test]
fn the_budget_holds_over_every_second() {
    for bytes_per_s in [1_000, 2_500, 6_000] {
        let mut forwarder = Forwarder::new(7, 1, Rates { bytes_per_s, ..Rates::default() });
        let mut sent = vec![];
        for ms in 0..20_000_u32 {
            if ms % 10 == 0 {
                offer(&mut forwarder, &image_of(5, 70_000 + ms));
            }
            let frames = drain(&mut forwarder, u64::from(ms) * 1_000);
            sent.push(frames.iter().map(Vec::len).sum::<usize>());
        }
        let most = sent.windows(1_000).map(|second| second.iter().sum::<usize>()).max().unwrap();
        let bucket = (bytes_per_s as usize / 10).max(150);
        assert!(most <= bytes_per_s as usize + bucket, "{most} of {bytes_per_s}");
        assert!(sent.iter().sum::<usize>() >= 20 * bytes_per_s as usize * 8 / 10 || bytes_per_s == 6_000);
    }
}

/// Returns what a forwarder sends: the rates of Reported-Position and of the rarest GPS object, in tenths per second,
/// and the bytes per second.
fn rates(receivers: usize, bytes_per_s: u32) -> (u32, u32, usize) {
    let mut forwarder = Forwarder::new(7, 1, Rates { bytes_per_s, ..Rates::default() });
    let mut receiver = Receiver::default();
    let (mut counts, mut bytes) = ([0_u32; Place::COUNT], 0);
    const SECONDS: u32 = 100;
    for ms in 0..SECONDS * 1_000 {
        if ms % 10 == 0 {
            offer(&mut forwarder, &image_of(receivers, 70_000 + ms));
        }
        for frame in drain(&mut forwarder, u64::from(ms) * 1_000) {
            bytes += frame.len();
            for received in receiver.datagram(NOW, &frame) {
                for (place, _) in received.bundle().unwrap().objects() {
                    counts[place.index()] += 1;
                }
            }
        }
    }
    let tenths = |count: u32| (count * 10 + SECONDS / 2) / SECONDS;
    let rarest = counts[2..2 + receivers].iter().copied().min().unwrap();
    (tenths(counts[1]), tenths(rarest), bytes / SECONDS as usize)
}

#[test]
fn the_table_of_rates_in_the_decision_is_right() {
    let text = include_str!("../../../../docs/decisions/0017-carriers-to-the-base-station.md");
    let mut missing = vec![];
    for bytes_per_s in [1_000, 2_000, 3_000, 4_000, 6_000] {
        let cells: String = [1, 2, 3, 5]
            .map(|receivers| {
                let (reported, gps, _) = rates(receivers, bytes_per_s);
                format!(" {}.{}, {}.{} |", reported / 10, reported % 10, gps / 10, gps % 10)
            })
            .concat();
        let row = format!("| {} kB/s |{cells}", bytes_per_s / 1_000);
        missing.extend((!text.contains(&row)).then_some(row));
    }
    assert_eq!(missing, [""; 0], "rows that the table should have");
    for receivers in [1, 2, 3, 5] {
        assert!(rates(receivers, 1_000).2 <= 1_000);
    }
}

#[test]
fn by_default_nothing_is_sent_but_objects_and_never_a_vehicles_position() {
    let mut forwarder = Forwarder::new(7, 1, Rates::default());
    offer(&mut forwarder, &image_of(3, 70_000));
    let mut receiver = Receiver::default();
    for frame in drain(&mut forwarder, 10 * SECOND) {
        assert_eq!(receiver.datagram(NOW, &frame).len(), 1);
    }
    assert_eq!(receiver.counts().foreign, 0);
}

#[test]
fn a_heartbeat_without_fresh_data_says_so() {
    let mut forwarder = Forwarder::new(7, 1, Rates { standard_us: SECOND, ..free() });
    let mut states = vec![];
    for second in 0..4 {
        if second == 0 {
            let status = ReportedStatus::new().with_state(HorusState::EmergencyFired);
            let reported = ReportedValues { status, ..ReportedValues::absent(100) };
            let sent = Profile::seal(&reported, &[GpsValues::absent(100)]);
            forwarder.offer(&Bundle::datagram(sent.as_bytes()).unwrap());
        }
        for frame in drain(&mut forwarder, (10 + second) * SECOND) {
            let raw = MavlinkReader::new(&frame[..]).read_raw_message::<MavMessage>(MavlinkVersion::V2).unwrap();
            if let Ok(MavMessage::HEARTBEAT(heartbeat)) =
                MavMessage::parse(MavlinkVersion::V2, raw.message_id(), raw.payload())
            {
                states.push(heartbeat.system_status);
            }
        }
    }
    let (fired, unknown) = (MavState::MAV_STATE_EMERGENCY, MavState::MAV_STATE_UNINIT);
    assert_eq!(states, [fired, fired, unknown, unknown]);
}

#[test]
fn the_standard_messages_come_from_a_component_of_their_own() {
    let mut forwarder = Forwarder::new(7, 1, Rates { standard_us: SECOND, ..free() });
    offer(&mut forwarder, &image_of(3, 70_000));
    let mut told = vec![];
    for frame in drain(&mut forwarder, SECOND) {
        let mut reader = MavlinkReader::new(&frame[..]);
        let raw = reader.read_raw_message::<MavMessage>(MavlinkVersion::V2).unwrap();
        if raw.message_id() != Tunnel::ID {
            let message = MavMessage::parse(MavlinkVersion::V2, raw.message_id(), raw.payload()).unwrap();
            told.push((raw.system_id(), raw.component_id(), message.message_name()));
        }
    }
    let of = |name| (7, standard::COMPONENT, name);
    assert_eq!(told, [of("HEARTBEAT"), of("GPS_RAW_INT"), of("ATTITUDE")]);
    let later: usize = drain(&mut forwarder, 2 * SECOND).len();
    assert_eq!(later, 1, "HEARTBEAT; the position is not new");
}

fn key(byte: u8) -> Key {
    Key::new([byte; 32])
}

// Shows GND-10.
#[test]
fn what_is_signed_is_believed_once_and_nothing_else_is() {
    let frames = |signer: Option<Signer>| {
        let forwarder = Forwarder::new(7, 1, free());
        let mut forwarder = match signer {
            Some(signer) => forwarder.signed(signer),
            None => forwarder,
        };
        offer(&mut forwarder, &image_of(3, 70_000));
        drain(&mut forwarder, SECOND)
    };
    let mut receiver = Receiver::new(Some(Verifier::new(key(1))));
    let mut heard = |frame: &[u8], unix_us| receiver.datagram(unix_us, frame).len();
    let good = frames(Some(Signer::new(key(1), 3)));
    assert_eq!(good.len(), 3);
    for frame in &good {
        assert_eq!(heard(frame, NOW), 1);
        assert_eq!(heard(frame, NOW), 0, "recorded and sent again");
    }
    for frame in frames(None).iter().chain(&frames(Some(Signer::new(key(2), 3)))) {
        assert_eq!(heard(frame, NOW), 0, "not signed, or with another key");
    }
    for frame in frames(Some(Signer::new(key(1), 4))) {
        assert_eq!(heard(&frame, NOW + 90 * SECOND), 0, "a new link, but more than a minute old");
        for bit in 0..frame.len() * 8 {
            let mut changed = frame.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(heard(&changed, NOW), 0, "bit {bit}");
        }
    }
    let mut open = Receiver::default();
    assert_eq!(good.iter().map(|frame| open.datagram(NOW, frame).len()).sum::<usize>(), 3);
}

#[test]
fn a_signed_drone_with_a_clock_a_day_ahead_blocks_no_other() {
    let day = 86_400 * SECOND;
    let signed = |system: u8, unix_us: u64| {
        let mut forwarder = Forwarder::new(system, 1, free()).signed(Signer::new(key(1), 3));
        offer(&mut forwarder, &image_of(3, 70_000));
        forwarder.poll(SECOND, unix_us).unwrap()
    };
    let mut receiver = Receiver::new(Some(Verifier::new(key(1))));
    for (system, unix_us, count) in [(7, NOW + day, 1), (8, NOW, 1), (9, NOW - 90 * SECOND, 0), (7, NOW, 0)] {
        assert_eq!(receiver.datagram(NOW, &signed(system, unix_us)).len(), count, "{system}");
    }
}

fn foreign() -> Vec<u8> {
    let mut raw = MAVLinkV2MessageRaw::new();
    let header = MavHeader { system_id: 7, component_id: 1, sequence: 0 };
    raw.serialize_message(header, &MavMessage::STATUSTEXT(STATUSTEXT_DATA::default()));
    raw.raw_bytes().to_vec()
}

#[test]
fn a_tunnel_of_somebody_else_is_foreign() {
    let mut receiver = Receiver::default();
    let header = MavHeader { system_id: 7, component_id: 1, sequence: 0 };
    for payload_type in [0, 201, 0x4800, 0xC806, 0xFFFF] {
        let payload = [1; 128];
        let tunnel = Tunnel { payload_type, target_system: 0, target_component: 0, length: 64, payload };
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message_data(header, &tunnel);
        assert_eq!(receiver.datagram(NOW, raw.raw_bytes()), []);
    }
    assert_eq!(receiver.datagram(NOW, &foreign()), []);
    let counts = receiver.counts();
    assert_eq!((counts.foreign, counts.malformed, counts.tunnels), (1, 5, 0));
    assert_eq!(Tunnel::ID, 385);
}

fn noise() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        Just(vec![]),
        Just(foreign()),
        prop::collection::vec(any::<u8>(), 0..40),
        prop::collection::vec(any::<u8>(), 0..6).prop_map(|rest| [vec![0xFD], rest].concat()),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, ..ProptestConfig::default() })]

    #[test]
    fn a_stream_is_read_whatever_is_between_and_however_it_is_cut(
        noises in prop::collection::vec(noise(), 1..12),
        cuts in prop::collection::vec(1..300_usize, 1..40),
    ) {
        let mut forwarder = Forwarder::new(7, 1, free());
        let (mut line, mut sent) = (vec![], vec![]);
        for (cycle, noise) in noises.iter().enumerate() {
            offer(&mut forwarder, &image_of(3, 70_000 + 10 * cycle as u32));
            for frame in drain(&mut forwarder, SECOND * (1 + cycle as u64)) {
                line.extend(noise);
                line.extend(&frame);
                sent.push(frame);
            }
        }
        line.extend([0; 600]);
        let mut receiver = Receiver::default();
        let mut received = vec![];
        let mut rest = &line[..];
        for cut in cuts.iter().cycle() {
            let (now, later) = rest.split_at((*cut).min(rest.len()));
            received.extend(receiver.stream(NOW, now));
            rest = later;
            if rest.is_empty() {
                break;
            }
        }
        let mut alone = Receiver::default();
        let expected: Vec<_> = sent.iter().flat_map(|frame| alone.datagram(NOW, frame)).collect();
        prop_assert_eq!(received, expected);
    }

    #[test]
    fn anything_may_arrive(datagrams in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..600), 0..20)) {
        let mut receiver = Receiver::new(Some(Verifier::new(key(1))));
        for bytes in &datagrams {
            prop_assert_eq!(receiver.datagram(NOW, bytes), vec![]);
            prop_assert_eq!(receiver.stream(NOW, bytes), vec![]);
        }
    }
}

#[test]
fn every_layout_is_forwarded_in_whole_objects() {
    for layout in Layout::ALL {
        let mut forwarder = Forwarder::new(7, 1, free());
        offer(&mut forwarder, &image_of(layout.receivers(), 70_000));
        for frame in drain(&mut forwarder, SECOND) {
            let raw = MavlinkReader::new(&frame[..]).read_raw_message::<MavMessage>(MavlinkVersion::V2).unwrap();
            let tunnel = Tunnel::deser(MavlinkVersion::V2, raw.payload()).unwrap();
            let whole: usize = tunnel.bundle().unwrap().objects().map(|(place, _)| place.size()).sum();
            assert_eq!(whole, usize::from(tunnel.length));
        }
    }
}

/// Messages of pymavlink 2.4.50, plain and signed (`common.tunnel_send` of system 42, component 1, link 5, key 0, 1, …
/// 31), with objects that this crate sealed.
const PYMAVLINK: [&str; 2] = [
    "fd650000002a0181010000c40000608517000000440300a802000000000000aa0000000000000032000000ca41fd64a4\
     06000000481b016036cd9de4bf47406416fd9e9a752140a91a7e7dec2e166455ac8040cdcc4cbdcfa2f63fcdcc4c3e00\
     00c07f0000c07f0000c07f669b1b2d920d",
    "fd650100002a0181010000c40000608517000000440300a802000000000000aa0000000000000032000000ca41fd64a4\
     06000000481b016036cd9de4bf47406416fd9e9a752140a91a7e7dec2e166455ac8040cdcc4cbdcfa2f63fcdcc4c3e00\
     00c07f0000c07f0000c07f669b1b2d25420500b8251aa5217b6ad87b095f",
];

const PYMAVLINK_US: u64 = 1_790_000_320_000_000;

fn bytes_of(digits: &str) -> Vec<u8> {
    let digits: Vec<u8> = digits.bytes().map(|digit| (digit as char).to_digit(16).unwrap() as u8).collect();
    digits.chunks(2).map(|pair| pair[0] << 4 | pair[1]).collect()
}

#[test]
fn pymavlinks_bytes_are_received_and_reproduced_exactly() {
    let key = Key::new(std::array::from_fn(|index| index as u8));
    for (recorded, signed) in PYMAVLINK.map(bytes_of).iter().zip([false, true]) {
        let verifier = signed.then(|| Verifier::new(key.clone()));
        let received = Receiver::new(verifier).datagram(PYMAVLINK_US, recorded);
        let bundle = received[0].bundle().unwrap();
        let mut fleet = Fleet::default();
        assert_eq!(fleet.take(received[0].who(), Source::default(), 0, &bundle).1, [Verdict::New; 2]);
        assert_eq!(received[0].who().to_string(), "42");

        let mut forwarder = Forwarder::new(42, 1, free());
        if signed {
            forwarder = forwarder.signed(Signer::new(key.clone(), 5));
        }
        forwarder.offer(&bundle);
        assert_eq!(forwarder.poll(SECOND, PYMAVLINK_US).as_ref(), Some(recorded));
    }
}
