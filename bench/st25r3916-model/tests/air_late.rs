//! Tests faults of the air that change the time of frames: repetitions, delays, scatter, collisions, and a missing
//! field.

use crate::common;

use common::antenna::{Antenna, HEADER, MS, US, bits_ns, frame, start};
use st25r3916_model::{AirEvent, AirFaults, Chunk, Origin, Technology};

fn clean() -> AirFaults {
    AirFaults::default()
}

fn repeating(after_ns: u64) -> AirFaults {
    AirFaults { repeated: 1.0, repeat_after_ns: (after_ns, after_ns), ..clean() }
}

fn delaying(ns: u64) -> AirFaults {
    AirFaults { delayed: 1.0, delay_ns: (ns, ns), ..clean() }
}

fn heard(antenna: &mut Antenna) -> Vec<(u64, u64, bool, Origin)> {
    antenna.heard().iter().map(|heard| (heard.started_ns, heard.ended_ns, heard.whole, heard.origin)).collect()
}

#[test]
fn a_repetition_follows_once_after_its_delay_with_the_same_bytes() {
    let faults = AirFaults { burst: 1.0, burst_bits: 8, ..repeating(3 * MS) };
    let mut antenna = Antenna::new(1, faults);
    let end = antenna.send(10 * MS, &frame(20, 1));
    assert_eq!(antenna.air.next_event(), Some(end + 3 * MS));
    antenna.run_to(100 * MS);
    let all = antenna.heard();
    let took = end - 10 * MS;
    assert_eq!(all.len(), 2, "a repetition is not repeated");
    assert_eq!((all[0].started_ns, all[0].ended_ns, all[0].origin), (10 * MS, end, Origin::Poller));
    assert_eq!((all[1].started_ns, all[1].ended_ns), (end + 3 * MS, end + 3 * MS + took));
    assert_eq!((all[1].whole, all[1].origin, &all[1].bytes), (true, Origin::Repeated, &all[0].bytes));
    let twice: Vec<&AirEvent> = antenna.told[1..].iter().map(|(_, event)| event).collect();
    assert_eq!(twice[..2], twice[2..]);
    assert_eq!(antenna.injected("repeated"), [end + 3 * MS]);
    let counters = antenna.air.counters();
    assert_eq!((counters.sent, counters.repeated, antenna.ended()), (1, 1, (0, 1, 0)));
}

#[test]
fn a_repetition_comes_at_any_instant_of_its_range() {
    let mut antenna = Antenna::new(1, AirFaults { repeated: 1.0, repeat_after_ns: (100, 103), ..clean() });
    let mut after = [0; 4];
    for i in 1..=400 {
        let end = antenna.send(10 * i * MS, &frame(5, 1));
        antenna.run_to(end + MS);
        after[usize::try_from(antenna.injected("repeated")[0] - end - 100).unwrap()] += 1;
    }
    assert!(after.iter().all(|count| (60..140).contains(count)), "{after:?}");
    // The range of times ends before its beginning.
    antenna.set(5_000 * MS, AirFaults { repeated: 1.0, repeat_after_ns: (200, 100), ..clean() });
    let end = antenna.send(5_001 * MS, &frame(5, 1));
    antenna.run_to(6_000 * MS);
    assert_eq!(antenna.injected("repeated"), [end + 200]);
}

#[test]
fn a_repetition_waits_until_300_us_after_the_frame_on_the_air() {
    let mut antenna = Antenna::new(1, repeating(2 * MS));
    let first = antenna.send(10 * MS, &frame(20, 1));
    antenna.set(first + MS, clean());
    let second = antenna.send(first + 2 * MS - 50 * US, &frame(100, 2));
    assert!(second > first + 2 * MS);
    antenna.run_to(100 * MS);
    let took = first - 10 * MS;
    let again = second + 300 * US;
    let all = heard(&mut antenna);
    assert_eq!(all[2], (again, again + took, true, Origin::Repeated));
    assert_eq!((all.len(), antenna.ended()), (3, (2, 0, 0)));
    assert_eq!(antenna.injected("repeated"), [again]);
}

#[test]
fn two_repetitions_that_wait_for_the_same_frame_follow_in_turn() {
    let mut antenna = Antenna::new(1, repeating(10 * MS));
    let first = antenna.send(10 * MS, &frame(20, 1));
    let second = antenna.send(first + 400 * US, &frame(30, 2));
    antenna.set(second, clean());
    let third = antenna.send(first + 10 * MS - 50 * US, &frame(244, 3));
    assert!(third > second + 10 * MS);
    antenna.run_to(100 * MS);
    let all = heard(&mut antenna);
    let again = third + 300 * US;
    let next = again + (first - 10 * MS) + 300 * US;
    assert_eq!(all.iter().map(|(began, ..)| *began).collect::<Vec<_>>()[3..], [again, next]);
}

#[test]
fn when_the_poller_begins_during_a_repetition_neither_is_heard_whole() {
    let mut antenna = Antenna::new(1, repeating(2 * MS));
    let first = antenna.send(10 * MS, &frame(20, 1));
    antenna.set(first, clean());
    let meets = first + 2 * MS + bits_ns(HEADER + 83);
    let second = antenna.send(meets, &frame(30, 2));
    antenna.run_to(100 * MS);
    let all = antenna.heard();
    assert_eq!(all.len(), 2, "the poller's second frame is drowned");
    assert_eq!((all[1].origin, all[1].whole, all[1].ended_ns), (Origin::Repeated, false, meets));
    assert_eq!(all[1].bytes, frame(20, 1)[..10]);
    assert_eq!(antenna.told.last(), Some(&(meets, AirEvent::FrameEnd { bits: 83 })));
    assert_eq!((antenna.ended(), antenna.air.counters().collisions), ((1, 0, 1), 1));
    let sent = antenna.air.take_sent();
    assert_eq!((sent[1].whole, sent[1].ended_ns), (true, second), "the poller sent it, all the same");
    antenna.send(50 * MS, &frame(30, 3));
    assert_eq!(antenna.ended(), (2, 0, 1));
}

#[test]
fn a_frame_that_ends_when_another_begins_does_not_meet_it() {
    let mut antenna = Antenna::new(1, repeating(2 * MS));
    let first = antenna.send(10 * MS, &frame(20, 1));
    antenna.set(first, clean());
    let took = first - 10 * MS;
    antenna.send(first + 2 * MS + took, &frame(30, 2));
    assert_eq!((antenna.ended(), antenna.air.counters().collisions), ((2, 0, 0), 0));
}

#[test]
fn a_delayed_frame_is_heard_later_and_only_then() {
    let mut antenna = Antenna::new(1, delaying(7 * MS));
    let bytes = frame(100, 1);
    let end = antenna.send(10 * MS, &bytes);
    assert_eq!(antenna.told.len(), 1, "nothing at its own time");
    assert_eq!(antenna.ended(), (0, 0, 0), "not before it has ended at the listener");
    antenna.set(end, clean());
    antenna.send(13 * MS, &frame(20, 2));
    antenna.run_to(100 * MS);
    let all = antenna.heard();
    assert_eq!((all[0].started_ns, all[0].origin), (13 * MS, Origin::Poller));
    assert_eq!((all[1].started_ns, all[1].ended_ns, all[1].origin), (17 * MS, end + 7 * MS, Origin::Delayed));
    assert_eq!((&all[1].bytes, all[1].whole), (&bytes, true));
    assert_eq!((antenna.ended(), antenna.injected("delayed")), ((2, 0, 0), vec![10 * MS]));
}

#[test]
fn a_delay_shorter_than_the_frame_moves_every_byte_by_as_much() {
    let bytes = frame(100, 1);
    let mut antenna = Antenna::new(1, delaying(150 * US));
    antenna.poller(MS, AirEvent::FrameStart(start(Technology::NfcF, &bytes[..40])));
    let data = bytes[40..].to_vec();
    antenna.run_to(MS + 700 * US);
    antenna.poller(MS + 700 * US, AirEvent::Bytes(Chunk { data, parity_error: false }));
    let end = MS + bits_ns(HEADER + 8 * 103);
    antenna.run_to(end);
    antenna.poller(end, AirEvent::FrameEnd { bits: 8 * 103 });
    antenna.run_to(10 * MS);
    let instants: Vec<u64> = antenna.told[1..].iter().map(|(at, _)| *at).collect();
    assert_eq!(instants, [MS + 150 * US, MS + 850 * US, end + 150 * US]);
    assert_eq!(antenna.heard()[0].bytes, bytes);
}

#[test]
fn a_delayed_frame_waits_for_the_frame_on_the_air() {
    let mut antenna = Antenna::new(1, delaying(2 * MS));
    antenna.poller(10 * MS, AirEvent::FrameStart(start(Technology::NfcF, &frame(20, 1))));
    antenna.poller(10 * MS + bits_ns(HEADER + 80), AirEvent::FrameEnd { bits: 80 });
    antenna.set(11 * MS, clean());
    let second = antenna.send(12 * MS - 100 * US, &frame(30, 2));
    antenna.run_to(100 * MS);
    let began = second + 300 * US;
    assert_eq!(heard(&mut antenna)[1], (began, began + bits_ns(HEADER + 80), false, Origin::Delayed));
    assert_eq!(antenna.ended(), (1, 1, 0));
}

#[test]
fn a_delayed_frame_may_be_repeated() {
    let faults = AirFaults { repeated: 1.0, repeat_after_ns: (MS, MS), ..delaying(3 * MS) };
    let mut antenna = Antenna::new(1, faults);
    antenna.send(10 * MS, &frame(20, 1));
    antenna.run_to(100 * MS);
    let origins: Vec<Origin> = antenna.heard().iter().map(|heard| heard.origin).collect();
    assert_eq!(origins, [Origin::Delayed, Origin::Repeated]);
}

#[test]
fn scatter_moves_a_frame_as_a_whole_within_its_bound() {
    let mut antenna = Antenna::new(1, AirFaults { scatter_ns: 3, ..clean() });
    let mut moved = [0; 4];
    for i in 1..=400 {
        let at = 10 * i * MS;
        let end = antenna.send(at, &frame(20, 1));
        antenna.run_to(end + 3);
        let (began, ended, whole, origin) = heard(&mut antenna)[0];
        assert_eq!((ended - began, whole, origin), (end - at, true, Origin::Poller));
        let by = usize::try_from(began - at).unwrap();
        moved[by] += 1;
        assert_eq!(antenna.injected("scatter"), if by == 0 { vec![] } else { vec![at] });
    }
    assert!(moved.iter().all(|count| (60..140).contains(count)), "{moved:?}");
    assert_eq!((antenna.ended().0, antenna.air.counters().scattered), (400, 400 - moved[0]));
}

#[test]
fn a_scattered_frame_and_a_repetition_that_overlap_damage_each_other() {
    let mut antenna = Antenna::new(1, repeating(2 * MS));
    let first = antenna.send(10 * MS, &frame(244, 1));
    antenna.set(first, AirFaults { scatter_ns: 1_000, ..clean() });
    antenna.send(first + 3 * MS, &frame(20, 2));
    antenna.run_to(100 * MS);
    let all = heard(&mut antenna);
    assert_eq!((all.len(), all[1].2, all[1].3), (2, false, Origin::Repeated));
    assert_eq!((antenna.ended(), antenna.air.counters().collisions), ((1, 0, 1), 1));
}

#[test]
fn without_a_field_the_listener_receives_no_frame() {
    let mut antenna = Antenna::new(1, clean());
    antenna.set(5 * MS, AirFaults { field_off: true, ..clean() });
    antenna.send(10 * MS, &frame(20, 1));
    antenna.set(15 * MS, AirFaults { field_off: true, lost: 0.5, ..clean() });
    antenna.set(20 * MS, clean());
    let end = antenna.send(30 * MS, &frame(20, 1));
    assert_eq!(antenna.told[1..3], [(5 * MS, AirEvent::FieldOff), (20 * MS, AirEvent::FieldOn)]);
    assert_eq!(heard(&mut antenna), [(30 * MS, end, true, Origin::Poller)]);
    assert_eq!((antenna.ended(), antenna.injected("field off")), ((1, 0, 1), vec![5 * MS]));
}

#[test]
fn a_field_fault_is_reported_only_where_it_changes_the_listeners_field() {
    let off = AirFaults { field_off: true, ..clean() };
    let mut antenna = Antenna::new(1, clean());
    antenna.poller(MS, AirEvent::FieldOff);
    antenna.set(2 * MS, off);
    antenna.set(3 * MS, clean());
    assert_eq!(antenna.told.len(), 2, "the poller's field was off throughout");
    antenna.set(4 * MS, off);
    antenna.poller(5 * MS, AirEvent::FieldOn);
    assert_eq!(antenna.told.len(), 2);
    antenna.set(6 * MS, clean());
    antenna.set(7 * MS, off);
    antenna.poller(8 * MS, AirEvent::FieldOff);
    antenna.set(9 * MS, clean());
    assert_eq!(antenna.told[2..], [(6 * MS, AirEvent::FieldOn), (7 * MS, AirEvent::FieldOff)]);
    assert_eq!(antenna.injected("field off"), [2 * MS, 4 * MS, 7 * MS]);
    // The field is off from the start.
    let mut antenna = Antenna::new(1, off);
    antenna.set(MS, clean());
    assert_eq!(antenna.told, [(MS, AirEvent::FieldOn)]);
    assert_eq!((antenna.injected("field off"), antenna.air.counters().field_off), (vec![0], 1));
}

#[test]
fn a_field_that_drops_within_a_frame_breaks_it_off() {
    let bytes = frame(100, 1);
    let mut antenna = Antenna::new(1, clean());
    antenna.poller(10 * MS, AirEvent::FrameStart(start(Technology::NfcF, &bytes)));
    let off = 10 * MS + bits_ns(HEADER + 44);
    antenna.set(off, AirFaults { field_off: true, ..clean() });
    antenna.set(off + 100 * US, clean());
    let end = 10 * MS + bits_ns(HEADER + 8 * 103);
    antenna.run_to(end);
    antenna.poller(end, AirEvent::FrameEnd { bits: 8 * 103 });
    let told = [(off, AirEvent::FrameEnd { bits: 44 }), (off, AirEvent::FieldOff), (off + 100 * US, AirEvent::FieldOn)];
    assert_eq!(antenna.told[2..], told);
    let all = antenna.heard();
    assert_eq!((all.len(), all[0].ended_ns, all[0].whole, &all[0].bytes), (1, off, false, &bytes[..5].to_vec()));
    assert_eq!((antenna.ended(), antenna.air.take_sent()[0].whole), ((0, 1, 0), true));
}

#[test]
fn late_frames_are_lost_when_they_are_due_without_a_carrier() {
    let off = AirFaults { field_off: true, ..clean() };
    for faults in [repeating(5 * MS), delaying(5 * MS)] {
        for poller in [false, true] {
            let mut antenna = Antenna::new(1, faults);
            let end = antenna.send(10 * MS, &frame(20, 1));
            if poller {
                antenna.poller(end + MS, AirEvent::FieldOff);
            } else {
                antenna.set(end + MS, off);
            }
            let told = antenna.told.len();
            antenna.run_to(50 * MS);
            assert_eq!(antenna.told.len(), told);
            let delayed = u64::from(faults.delayed > 0.0);
            assert_eq!(antenna.ended(), (1 - delayed, 0, delayed));
            assert_eq!(antenna.injected("repeated"), []);
        }
    }
}

#[test]
fn a_frame_keeps_the_fate_that_it_had_when_it_began() {
    let bytes = frame(60, 1);
    let wrong = AirFaults { bit_error: 0.5, lost: 1.0, ..clean() };
    let mut antenna = Antenna::new(1, repeating(10 * MS));
    antenna.poller(MS, AirEvent::FrameStart(start(Technology::NfcF, &bytes[..20])));
    antenna.set(MS + 100 * US, wrong);
    let data = bytes[20..].to_vec();
    antenna.poller(MS + 200 * US, AirEvent::Bytes(Chunk { data, parity_error: false }));
    let end = MS + bits_ns(HEADER + 8 * 63);
    antenna.run_to(end);
    antenna.poller(end, AirEvent::FrameEnd { bits: 8 * 63 });
    antenna.set(end + MS, clean());
    antenna.run_to(50 * MS);
    let all = antenna.heard();
    assert_eq!(all.iter().map(|heard| heard.started_ns).collect::<Vec<_>>(), [MS, end + 10 * MS]);
    assert!(all.iter().all(|heard| heard.bytes == bytes));
}

#[test]
fn a_repetition_that_is_due_when_a_frame_ends_does_not_wait() {
    let mut antenna = Antenna::new(1, repeating(2 * MS));
    let first = antenna.send(10 * MS, &frame(20, 1));
    antenna.set(first, clean());
    let took = first - 10 * MS;
    assert_eq!(antenna.send(first + 2 * MS - took, &frame(20, 2)), first + 2 * MS);
    antenna.run_to(100 * MS);
    assert_eq!(heard(&mut antenna)[2], (first + 2 * MS, first + 2 * MS + took, true, Origin::Repeated));
}

#[test]
fn a_late_frame_breaks_off_with_the_carrier_that_it_travels_on() {
    for poller in [false, true] {
        let mut antenna = Antenna::new(1, delaying(5 * MS));
        antenna.send(10 * MS, &frame(100, 1));
        let off = 15 * MS + bits_ns(HEADER + 80);
        antenna.run_to(off);
        if poller {
            antenna.poller(off, AirEvent::FieldOff);
        } else {
            antenna.set(off, AirFaults { field_off: true, ..clean() });
        }
        antenna.run_to(50 * MS);
        assert_eq!(antenna.told[2..], [(off, AirEvent::FrameEnd { bits: 80 }), (off, AirEvent::FieldOff)]);
        let all = antenna.heard();
        assert_eq!((all[0].bytes.len(), all[0].whole, all[0].origin), (10, false, Origin::Delayed));
        assert_eq!(antenna.ended(), (0, 1, 0));
    }
}

#[test]
fn a_frame_that_begins_without_a_field_is_lost() {
    let mut antenna = Antenna::new(1, AirFaults { field_off: true, ..delaying(5 * MS) });
    antenna.send(10 * MS, &frame(20, 1));
    antenna.set(12 * MS, clean());
    antenna.run_to(50 * MS);
    assert_eq!((antenna.heard(), antenna.ended()), (vec![], (0, 0, 1)));
    assert_eq!(antenna.injected("delayed"), []);
}

#[test]
fn what_was_due_before_the_faults_change_is_heard_before_they_do() {
    let mut antenna = Antenna::new(1, delaying(5 * MS));
    let end = antenna.send(10 * MS, &frame(20, 1));
    antenna.set(20 * MS, AirFaults { field_off: true, ..clean() });
    assert_eq!(heard(&mut antenna), [(15 * MS, end + 5 * MS, true, Origin::Delayed)]);
    assert_eq!(antenna.told.last(), Some(&(20 * MS, AirEvent::FieldOff)));
}

#[test]
fn a_fault_is_told_when_the_air_has_come_to_it() {
    let mut antenna = Antenna::new(1, AirFaults { burst: 1.0, burst_bits: 2, ..clean() });
    antenna.poller(MS, AirEvent::FrameStart(start(Technology::NfcF, &frame(100, 1))));
    antenna.run_to(MS + bits_ns(HEADER) - 1);
    assert_eq!(antenna.injected("burst"), []);
    antenna.run_to(MS + bits_ns(HEADER + 8 * 103));
    assert_eq!(antenna.injected("burst").len(), 1);
}
