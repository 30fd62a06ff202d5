//! Tests faults of the air event by event: the bits of frames, their length, and whether they are received at all.

use crate::common;

use common::antenna::{Antenna, HEADER, MS, US, bits_ns, frame, start, wrong_bits};
use st25r3916_model::{AirEvent, AirFaults, Chunk, Heard, Origin, Technology};

fn clean() -> AirFaults {
    AirFaults::default()
}

#[test]
fn clean_air_forwards_every_event_at_its_instant() {
    let mut antenna = Antenna::new(1, clean());
    let bytes = frame(20, 1);
    let end = antenna.send(10 * MS, &bytes);
    assert_eq!(antenna.air.next_event(), None);
    let start = AirEvent::FrameStart(start(Technology::NfcF, &bytes));
    let bits = 8 * bytes.len() as u32;
    assert_eq!(antenna.told, [(0, AirEvent::FieldOn), (10 * MS, start), (end, AirEvent::FrameEnd { bits })]);
    let heard = antenna.heard();
    let expected =
        Heard { started_ns: 10 * MS, ended_ns: end, bytes: bytes.clone(), whole: true, origin: Origin::Poller };
    assert_eq!(heard, [expected]);
    let sent = antenna.air.take_sent();
    assert_eq!((sent.len(), sent[0].started_ns, sent[0].ended_ns), (1, 10 * MS, end));
    assert_eq!((&sent[0].bytes, sent[0].whole, sent[0].bits_per_second), (&bytes, true, 424_000));
    assert_eq!(antenna.ended(), (1, 0, 0));
    assert_eq!((antenna.air.take_injected(), antenna.air.take_sent(), antenna.heard()), (vec![], vec![], vec![]));
}

#[test]
fn a_frame_that_the_poller_broke_off_is_not_delivered() {
    let bytes = frame(20, 1);
    // A case has the number of bytes that the air got from the poller, and the number of data bits on the air.
    let cases = [
        // The poller's FIFO ran dry after ten bytes.
        (10, 80),
        // The field went off during the frame.
        (23, 8 * 23 - 1),
        (23, 100),
        // The poller sent only preamble and sync.
        (23, 0),
        (0, 0),
    ];
    for (given, bits) in cases {
        let mut antenna = Antenna::new(1, AirFaults { repeated: 1.0, ..clean() });
        antenna.poller(MS, AirEvent::FrameStart(start(Technology::NfcF, &bytes[..given])));
        let end = MS + bits_ns(HEADER + u64::from(bits));
        antenna.poller(end, AirEvent::FrameEnd { bits });
        assert_eq!(antenna.ended(), (0, 1, 0), "{bits} bits of {given} bytes");
        let (sent, heard) = (antenna.air.take_sent().remove(0), antenna.heard().remove(0));
        assert!(!sent.whole && !heard.whole, "{bits} bits of {given} bytes");
        assert_eq!(sent.bytes, bytes[..bits as usize / 8]);
        assert_eq!(heard.bytes, sent.bytes);
        assert_eq!((heard.ended_ns, sent.ended_ns), (end, end));
        assert_eq!(antenna.air.next_event(), None, "what was not heard whole is not repeated");
    }
}

#[test]
fn an_nfc_a_frame_is_whole_only_with_its_end_of_communication() {
    for (bits, air, whole) in [(24, 27 + 2, true), (24, 27, false), (24, 27 + 1, false), (20, 18 + 4 + 2, true)] {
        let mut antenna = Antenna::new(1, clean());
        antenna.poller(MS, AirEvent::FrameStart(start(Technology::NfcA, &[1, 2, 3])));
        antenna.poller(MS + bits_ns(1 + air), AirEvent::FrameEnd { bits });
        assert_eq!(antenna.air.take_sent()[0].whole, whole, "{bits} bits, {air} on the air");
        assert_eq!(antenna.air.counters().delivered, u64::from(whole));
    }
}

#[test]
fn a_frame_without_an_end_is_broken_off_by_the_next_one() {
    let bytes = frame(20, 1);
    let mut antenna = Antenna::new(1, clean());
    antenna.poller(MS, AirEvent::FrameStart(start(Technology::NfcF, &bytes)));
    let next = MS + bits_ns(HEADER + 20);
    antenna.poller(next, AirEvent::FrameStart(start(Technology::NfcF, &bytes)));
    let off = next + bits_ns(HEADER + 44);
    antenna.poller(off, AirEvent::FieldOff);
    let heard: Vec<_> = antenna.heard().iter().map(|heard| (heard.ended_ns, heard.bytes.len(), heard.whole)).collect();
    assert_eq!(heard, [(next, 2, false), (off, 5, false)]);
    assert_eq!(antenna.ended(), (0, 2, 0));
    assert_eq!(antenna.told.last(), Some(&(off, AirEvent::FieldOff)));
}

#[test]
fn each_inverted_bit_is_noted_at_its_place_on_the_air() {
    let mut antenna = Antenna::new(3, AirFaults { bit_error: 0.01, ..clean() });
    let (bytes, mut errors) = (frame(60, 1), 0);
    for i in 0..200 {
        let at = (10 + 10 * i) * MS;
        antenna.send(at, &bytes);
        let injected = antenna.injected("bit error");
        errors += injected.len() as u64;
        match antenna.heard().pop() {
            Some(heard) => {
                let wrong = wrong_bits(&heard.bytes, &bytes).into_iter();
                let instants: Vec<u64> = wrong.map(|bit| at + bits_ns(HEADER + bit)).collect();
                assert_eq!(injected, instants);
                assert!(heard.whole);
            }
            None => assert!(!injected.is_empty() && injected.iter().all(|error| *error == at)),
        }
    }
    let counters = antenna.air.counters();
    assert_eq!(counters.bit_errors, errors);
    assert_eq!(counters.delivered + counters.damaged + counters.lost, 200);
    assert!(counters.damaged > 150 && counters.lost > 10, "{counters:?}");
}

#[test]
fn a_burst_inverts_its_first_and_its_last_bit() {
    let bytes = frame(5, 1);
    let bits = 8 * bytes.len() as u64;
    let mut antenna = Antenna::new(5, AirFaults { burst: 1.0, burst_bits: 6, ..clean() });
    let (mut lengths, mut firsts, mut lasts, mut inner) = ([0; 7], vec![], vec![], [0, 0]);
    for i in 0..2_000 {
        let at = (10 + i) * MS;
        antenna.send(at, &bytes);
        let wrong = wrong_bits(&antenna.heard()[0].bytes, &bytes);
        let (first, last) = (wrong[0], wrong[wrong.len() - 1]);
        assert_eq!(antenna.injected("burst"), [at + bits_ns(HEADER + first)]);
        let length = last - first + 1;
        lengths[length as usize] += 1;
        firsts.push(first);
        lasts.push(last);
        inner[0] += wrong.len() as u64 - 2;
        inner[1] += length - wrong.len() as u64;
    }
    assert_eq!(lengths[..2], [0, 0]);
    assert!(lengths[2..].iter().all(|count| (300..500).contains(count)), "{lengths:?}");
    assert_eq!((firsts.iter().min(), lasts.iter().max()), (Some(&0), Some(&(bits - 1))));
    assert!(inner[0].abs_diff(inner[1]) < 300, "{inner:?}");
    assert_eq!(antenna.ended(), (0, 2_000, 0));
    assert_eq!(antenna.air.counters().bursts, 2_000);
}

#[test]
fn a_burst_is_two_bits_to_a_whole_frame_long() {
    let bytes = frame(1, 1);
    for (burst_bits, longest) in [(0, 2), (1, 2), (2, 2), (u32::MAX, 32)] {
        let mut antenna = Antenna::new(5, AirFaults { burst: 1.0, burst_bits, ..clean() });
        let mut seen = 0;
        for i in 0..400 {
            antenna.send((10 + i) * MS, &bytes);
            let wrong = wrong_bits(&antenna.heard()[0].bytes, &bytes);
            let length = wrong[wrong.len() - 1] - wrong[0] + 1;
            assert!(length >= 2, "{length}");
            seen = seen.max(length);
        }
        assert_eq!(seen, longest, "{burst_bits}");
    }
}

#[test]
fn a_burst_reaches_bytes_that_the_poller_adds_later() {
    let bytes = frame(60, 1);
    let mut antenna = Antenna::new(5, AirFaults { burst: 1.0, burst_bits: 40, ..clean() });
    let (mut across, mut behind) = (0, 0);
    for i in 0..200 {
        let at = (10 + 10 * i) * MS;
        antenna.poller(at, AirEvent::FrameStart(start(Technology::NfcF, &bytes[..20])));
        let data = bytes[20..].to_vec();
        antenna.poller(at + 400 * US, AirEvent::Bytes(Chunk { data, parity_error: false }));
        let end = at + bits_ns(HEADER + 8 * bytes.len() as u64);
        antenna.poller(end, AirEvent::FrameEnd { bits: 8 * bytes.len() as u32 });
        let wrong = wrong_bits(&antenna.heard()[0].bytes, &bytes);
        let (first, last) = (wrong[0], wrong[wrong.len() - 1]);
        assert!(last - first < 40, "one burst: {wrong:?}");
        across += u64::from(first < 160 && last >= 160);
        behind += u64::from(first >= 160);
    }
    assert!(across > 2 && behind > 50, "{across} {behind}");
    assert_eq!(antenna.ended(), (0, 200, 0));
}

#[test]
fn a_lost_frame_leaves_no_trace_at_the_listener() {
    let mut antenna = Antenna::new(1, AirFaults { lost: 1.0, ..clean() });
    antenna.send(MS, &frame(20, 1));
    assert_eq!(antenna.told, [(0, AirEvent::FieldOn)]);
    assert_eq!((antenna.injected("lost"), antenna.heard(), antenna.ended()), (vec![MS], vec![], (0, 0, 1)));
    assert!(antenna.air.take_sent()[0].whole, "the poller sent all of it");
}

#[test]
fn a_cut_frame_ends_early_and_the_listener_is_told_when() {
    let bytes = frame(20, 1);
    let mut antenna = Antenna::new(1, AirFaults { truncated: 1.0, repeated: 1.0, ..clean() });
    let mut lengths = vec![];
    for i in 1..400 {
        let at = 2 * i * MS;
        antenna.send(at, &bytes);
        let heard = antenna.heard().remove(0);
        lengths.push(heard.bytes.len());
        assert_eq!(heard.bytes, bytes[..heard.bytes.len()]);
        assert_eq!((heard.whole, heard.origin), (false, Origin::Poller));
        assert_eq!(heard.ended_ns, at + bits_ns(HEADER + 8 * heard.bytes.len() as u64));
        assert_eq!(antenna.injected("cut"), [heard.ended_ns]);
        let bits = 8 * heard.bytes.len() as u32;
        assert_eq!(antenna.told.last(), Some(&(heard.ended_ns, AirEvent::FrameEnd { bits })));
        assert_eq!(antenna.air.next_event(), None, "what was cut is not repeated");
    }
    assert_eq!((lengths.iter().min(), lengths.iter().max()), (Some(&0), Some(&(bytes.len() - 1))));
    assert_eq!((antenna.ended(), antenna.air.counters().cut), ((0, 399, 0), 399));
}

#[test]
fn the_same_seed_brings_the_same_faults_and_another_seed_others() {
    let run = |seed| {
        let faults = AirFaults {
            bit_error: 1e-3,
            lost: 0.1,
            truncated: 0.1,
            burst: 0.2,
            burst_bits: 12,
            repeated: 0.3,
            repeat_after_ns: (MS, 25 * MS),
            delayed: 0.2,
            delay_ns: (0, 30 * MS),
            scatter_ns: 2 * MS,
            ..clean()
        };
        let mut antenna = Antenna::new(seed, faults);
        for i in 1..=300 {
            antenna.send(10 * i * MS, &frame(60, i as u8));
        }
        antenna.run_to(4_000 * MS);
        (antenna.heard(), antenna.air.take_injected(), antenna.air.counters(), antenna.told)
    };
    let once = run(8);
    assert_eq!(once, run(8));
    assert_ne!(once.0, run(9).0);
    let (heard, injected, counters, _) = once;
    assert_eq!(counters.delivered + counters.damaged + counters.lost, 300);
    assert!(heard.is_sorted_by_key(|heard| heard.ended_ns));
    assert!(heard.windows(2).all(|pair| pair[0].ended_ns <= pair[1].started_ns), "frames overlap");
    let count = |kind| injected.iter().filter(|(_, other)| *other == kind).count() as u64;
    assert_eq!(
        (count("bit error"), count("burst"), count("cut")),
        (counters.bit_errors, counters.bursts, counters.cut)
    );
    assert_eq!((count("repeated"), count("delayed")), (counters.repeated, counters.delayed));
    assert_eq!(count("scatter"), counters.scattered);
    let repeated = heard.iter().filter(|heard| heard.origin == Origin::Repeated).count() as u64;
    assert_eq!(repeated, counters.repeated);
    assert_eq!(heard.len() as u64, counters.delivered + counters.damaged + repeated);
    assert!(counters.collisions > 5 && repeated > 30 && counters.delayed > 30, "{counters:?}");
}

#[test]
fn a_frame_that_the_poller_sends_without_its_carrier_is_lost() {
    let mut antenna = Antenna::new(1, clean());
    antenna.poller(MS, AirEvent::FieldOff);
    antenna.send(2 * MS, &frame(20, 1));
    assert_eq!((antenna.told.len(), antenna.heard(), antenna.ended()), (2, vec![], (0, 0, 1)));
}

#[test]
fn nfc_a_reports_an_odd_number_of_wrong_bits_by_parity() {
    for (technology, parity) in [(Technology::NfcA, true), (Technology::NfcF, false)] {
        let mut antenna = Antenna::new(1, AirFaults { burst: 1.0, burst_bits: 2, ..clean() });
        let mut errors = 0;
        for i in 1..=200 {
            antenna.poller(i * MS, AirEvent::FrameStart(start(technology, &frame(2, 1))));
            let Some((_, AirEvent::FrameStart(heard))) = antenna.told.last() else { panic!("not heard") };
            let bytes = heard.chunk.data.iter().zip(frame(2, 1));
            let odd = bytes.into_iter().any(|(heard, sent)| (heard ^ sent).count_ones() == 1);
            assert_eq!(heard.chunk.parity_error, parity && odd);
            errors += u64::from(odd);
            antenna.poller(i * MS + 500 * US, AirEvent::FrameEnd { bits: 40 });
        }
        assert!((5..60).contains(&errors), "two bits lie in two bytes at 4 places of 39: {errors}");
    }
}

#[test]
fn nothing_of_a_frame_is_heard_after_it_was_cut() {
    let bytes = frame(60, 1);
    let mut antenna = Antenna::new(2, AirFaults { truncated: 1.0, ..clean() });
    antenna.poller(MS, AirEvent::FrameStart(start(Technology::NfcF, &bytes[..30])));
    let data = bytes[30..].to_vec();
    antenna.poller(MS + 300 * US, AirEvent::Bytes(Chunk { data, parity_error: false }));
    let end = MS + bits_ns(HEADER + 8 * 63);
    antenna.run_to(end);
    antenna.poller(end, AirEvent::FrameEnd { bits: 8 * 63 });
    antenna.run_to(10 * MS);
    let heard = antenna.heard().remove(0);
    assert!(heard.bytes.len() < 30);
    assert!(matches!(antenna.told[..], [_, (_, AirEvent::FrameStart(_)), (_, AirEvent::FrameEnd { .. })]));
    let sent = antenna.air.take_sent().remove(0);
    assert_eq!((sent.bytes, sent.whole), (bytes, true));
}

#[test]
fn a_frame_longer_than_its_len_needs_all_its_bytes() {
    // A payload of 255 bytes makes LEN overflow to 0.
    let mut bytes = frame(254, 1);
    bytes[0] = 0;
    for (bits, whole) in [(8 * 100, false), (8 * 257, true)] {
        let mut antenna = Antenna::new(1, clean());
        antenna.poller(MS, AirEvent::FrameStart(start(Technology::NfcF, &bytes)));
        antenna.poller(MS + bits_ns(HEADER + u64::from(bits)), AirEvent::FrameEnd { bits });
        assert_eq!(antenna.air.take_sent()[0].whole, whole, "{bits} bits");
    }
}

#[test]
fn a_len_of_0_announces_as_much_as_a_len_of_1() {
    for (bytes, whole) in [(&[0, 1][..], false), (&[0, 1, 2], true)] {
        let (mut antenna, bits) = (Antenna::new(1, clean()), 8 * bytes.len() as u32);
        antenna.poller(MS, AirEvent::FrameStart(start(Technology::NfcF, bytes)));
        antenna.poller(MS + bits_ns(HEADER + u64::from(bits)), AirEvent::FrameEnd { bits });
        assert_eq!(antenna.air.take_sent()[0].whole, whole, "{bytes:?}");
    }
}

#[test]
fn only_nfc_f_has_a_sync_to_lose() {
    for (technology, heard) in [(Technology::NfcA, 1), (Technology::NfcF, 0)] {
        let mut antenna = Antenna::new(1, AirFaults { bit_error: 1.0, ..clean() });
        antenna.poller(MS, AirEvent::FrameStart(start(technology, &[2, 3])));
        antenna.poller(2 * MS, AirEvent::FrameEnd { bits: 16 });
        assert_eq!(antenna.heard().len(), heard, "{technology:?}");
    }
}

#[test]
fn frozen_air_repeats_the_last_frame_of_the_same_length() {
    let mut antenna = Antenna::new(1, clean());
    let (long, short) = (|seed| frame(20, seed), |seed| frame(12, seed));
    for (nth, bytes) in [long(1), short(2), long(3)].into_iter().enumerate() {
        antenna.send((1 + 2 * nth as u64) * MS, &bytes);
    }
    antenna.set(8 * MS, AirFaults { frozen: true, ..clean() });
    let end = antenna.send(10 * MS, &long(4));
    antenna.send(12 * MS, &short(5));
    // No earlier frame has this length, so the fault has no effect.
    antenna.send(14 * MS, &frame(16, 6));
    antenna.set(16 * MS, clean());
    antenna.send(17 * MS, &long(7));
    let heard: Vec<_> = antenna.heard().into_iter().map(|heard| heard.bytes).collect();
    assert_eq!(heard, [long(1), short(2), long(3), long(3), short(2), frame(16, 6), long(7)]);
    assert_eq!(antenna.injected("frozen"), [10 * MS, 12 * MS]);
    let sent = antenna.air.take_sent();
    assert_eq!((&sent[3].bytes, sent[3].ended_ns), (&long(4), end));
    assert_eq!(antenna.ended(), (5, 2, 0));
}
