//! Tests how the bytes that transactions read are judged. Each test changes a flawless log in one way.

use crate::common;

use bench_judge::{Log, Violation::*, What};
use common::*;
use profile::ssi::{Request, encode};
use profile::{GpsObject, GpsValues, Identifier, LinkStatus, LinkValues, ReportedPosition, ReportedValues};

const GPS: [usize; 4] = [1, 2, 3, 5];

fn distance(a: &[u8], b: &[u8]) -> u32 {
    a.iter().zip(b).map(|(a, b)| (a ^ b).count_ones()).sum()
}

#[test]
fn a_read_spliced_from_two_images_is_torn() {
    for (gps, step) in [(1, 1), (5, 7)] {
        let (plan, log, place) = run(gps);
        let now = miso(&mut log.clone(), place).clone();
        let before = image_before(&log, place);
        let mut damaged = 0;
        for at in (1..now.len()).step_by(step) {
            for (first, second) in [(&now, &before), (&before, &now)] {
                let spliced = [&first[..at], &second[at..]].concat();
                let mut log = log.clone();
                *miso(&mut log, place) = spliced.clone();
                let objects = (0..plan.layout.objects()).map(|index| plan.layout.in_image(index).unwrap());
                let places: Vec<_> = std::iter::once(0..32).chain(objects).collect();
                let inside = places.iter().find(|place| place.contains(&at) && place.start < at);
                let near = inside.is_some_and(|inside| {
                    [&now, &before].iter().any(|image| distance(&image[inside.clone()], &spliced[inside.clone()]) == 1)
                });
                let whole = |image: &Vec<u8>| image[..] == spliced[..];
                let found = found(&log);
                damaged += usize::from(found == [(Damaged, 1)]);
                match found.as_slice() {
                    [(Torn, 1)] => {}
                    [(Damaged, 1)] => assert!(near, "{gps} {at}"),
                    // The images differ only on one side of the cut, so the transaction reads one of them unchanged.
                    [] => assert!(whole(&now), "{gps} {at}"),
                    [(FreshNotNew, 1)] => assert!(whole(&before), "{gps} {at}"),
                    other => panic!("{gps} {at}: {other:?}"),
                }
            }
        }
        assert!(damaged < 12, "{gps}: {damaged}");
    }
}

#[test]
fn a_place_that_is_scrubbed_while_it_is_read_is_torn() {
    let (_, log, place) = run(3);
    for fill in [0x00, 0xFF] {
        for range in [96..140, 40..96, 120..156, 8..32] {
            let mut log = log.clone();
            miso(&mut log, place)[range.clone()].fill(fill);
            assert_eq!(found(&log), [(Torn, 1)], "{range:?} {fill}");
        }
    }
    // The DPR scrubs the object during the transaction. The first bytes that are read have the fill value 0x00, and the
    // others 0xFF.
    let mut log = log.clone();
    miso(&mut log, place)[96..130].fill(0x00);
    miso(&mut log, place)[130..156].fill(0xFF);
    assert_eq!(found(&log), [(Torn, 1)]);
}

#[test]
fn any_flipped_bit_is_damage_and_no_tear() {
    for (gps, step) in [(1, 7), (3, 41), (5, 31)] {
        let (plan, log, place) = run(gps);
        for bit in (0..plan.layout.image_len() * 8).step_by(step) {
            let mut log = log.clone();
            miso(&mut log, place)[bit / 8] ^= 0x80 >> (bit % 8);
            assert_eq!(found(&log), [(Damaged, 1)], "{gps} bit {bit}");
        }
    }
}

#[test]
fn bytes_of_no_cycle_are_damage() {
    let (_, log, place) = run(3);
    for at in [3, 33, 97, 200] {
        let mut log = log.clone();
        miso(&mut log, place)[at] ^= 0x5A;
        miso(&mut log, place)[at + 7] ^= 0x5A;
        let verdict = judged(&log);
        assert_eq!(found(&log), [(Damaged, 1)], "{at}");
        let selected = match log.events[place].what {
            What::Transaction { selected, .. } => selected,
            _ => 0,
        };
        assert_eq!(verdict.violations[0].first_at, selected);
    }
}

#[test]
fn a_vacant_place_is_neither_torn_nor_damaged() {
    let (_, log, place) = run(3);
    for fill in [0x00, 0xFF] {
        let mut log = log.clone();
        miso(&mut log, place)[96..156].fill(fill);
        let ours = [Torn, Damaged, Misplaced, FreshMissing, FreshNotNew];
        assert!(!judged(&log).kinds().any(|kind| ours.contains(&kind)));
    }
}

#[test]
fn a_valid_object_in_the_place_of_another_is_misplaced() {
    let (_, log, place) = run(3);
    let image = miso(&mut log.clone(), place).clone();
    let stamp = u32::from_le_bytes(image[32..36].try_into().unwrap());
    let link = LinkStatus::seal(&LinkValues::default());
    let uplink = GpsObject::seal(Identifier(0x4200), &GpsValues::absent(stamp));
    let gps = GpsObject::seal(Identifier::GPS[2], &GpsValues::absent(stamp));
    let reported = ReportedPosition::seal(&ReportedValues::absent(stamp));
    for (at, object) in [
        (96, &image[156..216]),
        (216, &image[96..156]),
        (32, gps.as_bytes().as_slice()),
        (32, link.as_bytes()),
        (96, uplink.as_bytes()),
        (156, link.as_bytes()),
        (212, reported.as_bytes()),
        (0, &image[96..128]),
    ] {
        let mut log = log.clone();
        miso(&mut log, place)[at..at + object.len()].copy_from_slice(object);
        let violations = match at {
            // Bytes before the first object, or a piece of an object, do not count as an object.
            0 | 212 => [(Damaged, 1)],
            _ => [(Misplaced, 1)],
        };
        assert_eq!(found(&log), violations, "{at}");
    }
    let mut log = log.clone();
    let mut other = LinkStatus::seal(&LinkValues::default()).as_bytes().to_vec();
    other[4..6].copy_from_slice(&Identifier::GPS[0].0.to_le_bytes());
    let crc = profile::crc::frame(&other[..28]).to_be_bytes();
    other[28..].copy_from_slice(&crc);
    miso(&mut log, place)[..32].copy_from_slice(&other);
    assert_eq!(found(&log), [(Misplaced, 1)]);
}

#[test]
fn objects_of_two_cycles_in_one_read_are_torn() {
    for gps in GPS {
        let (plan, log, place) = run(gps);
        let before = image_before(&log, place);
        for index in 0..plan.layout.objects() {
            let mut log = log.clone();
            let object = plan.layout.in_image(index).unwrap();
            miso(&mut log, place)[object.clone()].copy_from_slice(&before[object]);
            assert_eq!(found(&log), [(Torn, 1)], "{gps} {index}");
        }
    }
}

#[test]
fn link_status_of_one_image_with_the_objects_of_another_is_torn() {
    let (_, log, place) = run(3);
    let before = image_before(&log, place);
    let mut log = log;
    miso(&mut log, place)[..32].copy_from_slice(&before[..32]);
    assert_eq!(found(&log), [(Torn, 1)]);
}

#[test]
fn a_requested_window_of_the_image_is_judged_as_such() {
    let (_, log, place) = run(3);
    let selected = |log: &Log, place: usize| match log.events[place].what {
        What::Transaction { selected, .. } => selected,
        _ => 0,
    };
    let mut log = log;
    let window = Request { offset: 156, length: 60 };
    match &mut log.events[place].what {
        What::Transaction { mosi, .. } => mosi.0[..8].copy_from_slice(&encode(window)),
        other => panic!("{other:?}"),
    }
    let next = (place + 1..log.events.len()).find(|place| selected(&log, *place) > 0).unwrap();
    let (asked, read) = (log.events[place].at, log.events[next].at);
    for event in log.events.iter_mut().filter(|event| (asked + 1..=read).contains(&event.at)) {
        match &mut event.what {
            What::Fresh { offered: Some(bytes), .. } | What::Transaction { miso: bytes, .. } => {
                bytes.0 = bytes[window.window()].to_vec();
            }
            _ => {}
        }
    }
    let forwarded = |event: &bench_judge::Event| matches!(event.what, What::Forwarded { .. } | What::Arrived { .. });
    log.events.retain(|event| event.at != read || !forwarded(event));
    assert_eq!(found(&log), []);
    miso(&mut log, next)[7] ^= 0x10;
    assert_eq!(found(&log), [(Damaged, 1)]);
}
