//! Tests ten minutes, in virtual time, on carriers that lose half of all messages, and repeat, reorder and damage
//! others.

use std::collections::HashSet;

use base_station::carrier::mavlink::{Forwarder, Rates, Receiver};
use base_station::{Bundle, Fleet, Place, Source, Verdict, Who};
use profile::{GpsStatus, GpsValues, LinkStatus, LinkStatusBits, LinkValues, Profile, ReportedStatus, ReportedValues};

const SECOND: u64 = 1_000_000;

/// Pseudorandom numbers (SplitMix64: Steele, Lea, Flood, *Fast Splittable Pseudorandom Number Generators*, 2014).
struct Drawn(u64);

impl Drawn {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    }

    fn below(&mut self, limit: u64) -> u64 {
        self.next() % limit
    }

    fn chance(&mut self, percent: u64) -> bool {
        self.below(100) < percent
    }
}

fn image(timestamp: u32) -> Vec<u8> {
    let wave = f64::from(timestamp).sin();
    let (latitude, longitude) = (47.5 + wave / 1e3, 8.7 - wave / 1e3);
    let status = ReportedStatus::new().with_position_valid(true).with_receivers_agreeing(3);
    let reported = ReportedValues { status, latitude, longitude, ..ReportedValues::absent(timestamp) };
    let status = GpsStatus::new().with_position_valid(true).with_heard(true);
    let gps = |offset| GpsValues { status, latitude: latitude + offset, longitude, ..GpsValues::absent(timestamp) };
    let link = LinkValues {
        timestamp: timestamp + 77,
        status: LinkStatusBits::new().with_link_up(true),
        ..LinkValues::default()
    };
    [LinkStatus::seal(&link).as_bytes(), Profile::<3>::seal(&reported, &[1e-6, 2e-6, 3e-6].map(gps)).as_bytes()]
        .concat()
}

struct Message {
    arrives_us: u64,
    bytes: Vec<u8>,
    damaged: bool,
    foreign: bool,
}

fn carry(drawn: &mut Drawn, now_us: u64, bytes: &[u8], on_the_way: &mut Vec<Message>) {
    let copies = if drawn.chance(15) { 2 } else { 1 };
    for _ in 0..copies {
        if drawn.chance(50) {
            continue;
        }
        let delay_us = if drawn.chance(20) { drawn.below(3 * SECOND) } else { drawn.below(20_000) };
        let original = bytes;
        let mut bytes = bytes.to_vec();
        if drawn.chance(10) {
            for _ in 0..=drawn.below(4) {
                let bit = drawn.below(bytes.len() as u64 * 8) as usize;
                bytes[bit / 8] ^= 1 << (bit % 8);
            }
        }
        // A bit that was flipped twice leaves the message intact.
        let damaged = bytes != original;
        on_the_way.push(Message { arrives_us: now_us + delay_us, bytes, damaged, foreign: false });
    }
    if drawn.chance(10) {
        let bytes = (0..drawn.below(400)).map(|_| drawn.next() as u8).collect();
        on_the_way.push(Message { arrives_us: now_us, bytes, damaged: true, foreign: true });
    }
}

fn flight(seed: u64, mavlink: bool) -> (Vec<Message>, HashSet<(Place, Vec<u8>)>) {
    let mut drawn = Drawn(seed);
    let (mut on_the_way, mut sent) = (vec![], HashSet::new());
    let mut forwarder = Forwarder::new(7, 1, Rates { bytes_per_s: 6_000, ..Rates::default() });
    for cycle in 0..60_000_u32 {
        let now_us = u64::from(cycle) * 10_000;
        let image = image(600_000 + 10 * cycle);
        let bundle = Bundle::datagram(&image).unwrap();
        sent.extend(bundle.objects().map(|(place, bytes)| (place, bytes.to_vec())));
        if mavlink {
            forwarder.offer(&bundle);
            while let Some(frame) = forwarder.poll(now_us, 0) {
                carry(&mut drawn, now_us, &frame, &mut on_the_way);
            }
        } else if cycle % 10 == 0 {
            carry(&mut drawn, now_us, &image, &mut on_the_way);
        }
    }
    on_the_way.sort_by_key(|message| message.arrives_us);
    (on_the_way, sent)
}

struct Judge {
    fleet: Fleet,
    sent: HashSet<(Place, Vec<u8>)>,
    new: u64,
    refused: u64,
    newest: u32,
}

impl Judge {
    fn take(&mut self, message: &Message, bundle: &Bundle<'_>) {
        let who = Who::System(7);
        let (id, verdicts) = self.fleet.take(who, Source::default(), message.arrives_us, bundle);
        assert_eq!(id, who.first(), "there is one sender");
        for ((place, bytes), verdict) in bundle.objects().zip(verdicts) {
            if verdict.is_intact() {
                assert!(self.sent.contains(&(place, bytes.to_vec())), "{place} was not sent, and is {verdict:?}");
            } else {
                assert!(message.damaged, "{place} arrived whole, and is {verdict:?}");
                self.refused += 1;
            }
            self.new += u64::from(verdict == Verdict::New);
            assert_ne!(verdict, Verdict::OutOfSequence);
        }
        let shown = self.fleet.get(id).and_then(|drone| drone.reported()).map(|held| held.timestamp);
        assert!(shown.is_none_or(|shown| shown >= self.newest), "an older position took the place of a newer one");
        self.newest = shown.unwrap_or(self.newest);
    }
}

#[test]
fn over_mavlink_exactly_the_intact_objects_are_accepted() {
    let (messages, sent) = flight(1, true);
    let mut judge = Judge { fleet: Fleet::default(), sent, new: 0, refused: 0, newest: 0 };
    let mut receiver = Receiver::default();
    let mut whole = 0_u64;
    for message in &messages {
        let received = receiver.datagram(0, &message.bytes);
        // MAVLink's checksum misses some damage, which the objects' own CRCs detect.
        whole += u64::from(!message.damaged);
        for received in received {
            judge.take(message, &received.bundle().unwrap());
        }
    }
    let counts = receiver.counts();
    assert_eq!(counts.tunnels + counts.foreign, whole, "of the whole ones each is ours or a standard message");
    assert!(judge.new > 10_000 && judge.refused == 0, "{} new, {} refused", judge.new, judge.refused);
}

#[test]
fn as_datagrams_exactly_the_intact_objects_are_accepted() {
    let (messages, sent) = flight(2, false);
    let mut judge = Judge { fleet: Fleet::default(), sent, new: 0, refused: 0, newest: 0 };
    for message in messages.iter().filter(|message| !message.foreign) {
        judge.take(message, &Bundle::datagram(&message.bytes).unwrap());
    }
    assert!(judge.new > 10_000 && judge.refused > 200, "{} new, {} refused", judge.new, judge.refused);
}
