//! Tests the rule of the hold on logs that are made by hand.

mod conduct;

use profile::UplinkValues;
use profile::criticality::{ActiveLoad, Writer as WriterOf};

use super::*;
use crate::Bytes;
use crate::disturbance::{Conduct, Disturbance, HoldPart};
use crate::testing::{self, Events};

/// Returns the violations of a hold that is unlocked with a set-point of 30 °C, restarts for `cause`, and then sends a
/// Hold-Status with the changes of `after`.
fn restarted(cause: Cause, after: impl FnOnce(&mut HoldValues)) -> Vec<Violation> {
    let mut before = HoldValues { set_point: 30.0, ..HoldValues::absent(1_000) };
    before.acknowledged[0] = Acknowledged::new(4, Outcome::Done);
    let mut now = HoldValues { timestamp: 0, ..before };
    after(&mut now);
    let mut events = Events::new(1);
    for (at, values) in [(100 * MS, before), (240 * MS, now)] {
        let object = HoldStatus::seal(WriterOf::<ActiveLoad>::claim(), &values);
        let bytes = [&[65], object.as_bytes().as_slice(), &[0; 2]].concat();
        events.add(at, What::Hold(HoldEvent::Sent(HoldFrame { started: at, bytes: Bytes(bytes), whole: true })));
    }
    events.add(200 * MS, What::Hold(HoldEvent::Reset { cause, asked: true }));
    events.hold = true;
    violations(&events)
}

#[test]
fn lock_set_point_and_acknowledgements_outlast_every_reset_but_power_on() {
    for cause in [Cause::Pin, Cause::Watchdog] {
        assert_eq!(restarted(cause, |_| {}), []);
        assert_eq!(restarted(cause, |now| now.set_point = 20.0), [Violation::HoldCommand]);
        assert_eq!(restarted(cause, |now| now.status = now.status.with_locked(true)), [Violation::HoldCommand]);
        assert_eq!(restarted(cause, |now| now.acknowledged = [Acknowledged::default(); 2]), [Violation::HoldCommand]);
    }
    assert_eq!(restarted(Cause::PowerOn, |now| *now = HoldValues::absent(0)), []);
}

fn came(at: u64, timestamp: u32, word: u16, value: f32) -> Came {
    Came { at, timestamp, number: 1, word, value, is_plain: true }
}

#[test]
fn a_set_point_is_done_within_the_limits_and_refused_otherwise() {
    let is = |value, outcome| is_outcome_of(&came(0, 0, 1, value), Acknowledged::new(1, outcome), 0);
    for value in [2.0, 20.0, 40.0] {
        assert!(is(value, Outcome::Done) && !is(value, Outcome::Refused), "{value}");
    }
    for value in [1.9, 40.1, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        assert!(!is(value, Outcome::Done) && is(value, Outcome::Refused), "{value}");
    }
}

#[test]
fn a_lock_is_never_refused_and_another_word_is_unknown() {
    let is = |word, outcome| is_outcome_of(&came(0, 0, word, f32::NAN), Acknowledged::new(1, outcome), 0);
    for word in 2..=4 {
        assert!(is(word, Outcome::Done) && !is(word, Outcome::Refused) && !is(word, Outcome::Unknown), "{word}");
    }
    assert!(is(5, Outcome::Unknown) && !is(5, Outcome::Done));
}

#[test]
fn a_command_is_too_old_if_its_timestamp_stayed_the_same() {
    let too_old = |came: &[Came]| {
        let writer = Writer { came: came.to_vec().into(), insists: None };
        is_outcome_of(&came[0], Acknowledged::new(1, Outcome::TooOld), writer.heard_for(1))
    };
    assert!(!too_old(&[came(0, 7, 2, 0.0), came(899 * MS, 7, 2, 0.0)]));
    assert!(too_old(&[came(0, 7, 2, 0.0), came(900 * MS, 7, 2, 0.0)]));
    assert!(!too_old(&[came(0, 7, 2, 0.0), came(900 * MS, 8, 2, 0.0)]));
}

fn run() -> Events {
    let mut events = Events::new(1);
    events.hold = true;
    events
}

fn violations(events: &Events) -> Vec<Violation> {
    let log = events.log();
    testing::found(Hold::new(&log.header), &log).0.into_iter().map(|(violation, ..)| violation).collect()
}

/// Returns a Hold-Status with the timestamp `timestamp` (ms).
fn status(timestamp: u32) -> Vec<u8> {
    HoldStatus::seal(WriterOf::<ActiveLoad>::claim(), &HoldValues::absent(timestamp)).as_bytes().to_vec()
}

fn frame(started: u64, payload: &[u8]) -> HoldFrame {
    let bytes = [&[payload.len() as u8 + 1], payload, &[0; 2]].concat();
    HoldFrame { started, bytes: Bytes(bytes), whole: true }
}

/// Adds a frame with Hold-Status that ends at the DPR's antenna at `at`, and the DPR's answer without uplinks.
fn exchange(events: &mut Events, at: u64, timestamp: u32) {
    events.add(at, What::Hold(HoldEvent::Heard(frame(at - MS, &status(timestamp)))));
    let answer = frame(at + 2 * MS, &[0; Answer::SIZE]);
    events.add(at + 4 * MS, What::Hold(HoldEvent::Answered(answer)));
}

fn read(events: &mut Events, at: u64, object: &[u8]) {
    let place = testing::header(1).layout().with_hold().hold().unwrap();
    let mut miso = vec![0; place.end];
    miso[place].copy_from_slice(object);
    events.add(at + MS, What::Transaction { selected: at, mosi: Bytes(vec![0; 8]), miso: Bytes(miso) });
}

#[test]
fn after_its_start_the_dpr_takes_an_object_that_it_had_before() {
    let after = |restarts: bool| {
        let mut events = run();
        exchange(&mut events, 100 * MS, 700);
        if restarts {
            events.reset(150 * MS, Board::Dpr, true);
        }
        exchange(&mut events, 300 * MS, 700);
        read(&mut events, 500 * MS, &status(700));
        violations(&events)
    };
    assert_eq!(after(true), []);
    assert_eq!(after(false), [Violation::HoldShown, Violation::HoldAnswer], "a repetition");
    let mut events = run();
    for (at, timestamp) in [(100, 700), (200, 800), (300, 800)] {
        exchange(&mut events, at * MS, timestamp);
    }
    assert_eq!(violations(&events), [Violation::HoldAnswer], "a repetition of the second object");
}

fn shown_from_damaged(damaged: usize) -> Vec<Violation> {
    let mut events = run();
    let mut heard = frame(200 * MS, &status(200));
    heard.bytes.0[damaged] ^= 8;
    events.add(201 * MS, What::Hold(HoldEvent::Heard(heard)));
    let answer = frame(203 * MS, &[0; Answer::SIZE]);
    events.add(205 * MS, What::Hold(HoldEvent::Answered(answer)));
    read(&mut events, 220 * MS, &status(200));
    violations(&events)
}

#[test]
fn the_dpr_may_take_an_intact_object_behind_a_damaged_length_byte() {
    assert_eq!(shown_from_damaged(0), []);
    assert_eq!(shown_from_damaged(20), [Violation::HoldShown, Violation::HoldAnswer]);
}

#[test]
fn a_reading_that_a_flight_controller_spoils_shows_nothing_of_the_hold() {
    let shown = |misused: bool| {
        let mut events = run();
        if misused {
            let disturbs = Disturbance::FlightController { conduct: Conduct::Misuse };
            let kind = "flight controller lies".into();
            events.add(150 * MS, What::Injected { kind, disturbs, until: 199 * MS });
        }
        read(&mut events, 200 * MS, &status(200));
        violations(&events)
    };
    assert_eq!(shown(true), []);
    assert_eq!(shown(false), [Violation::HoldShown]);
}

#[test]
fn what_came_before_the_dprs_start_is_not_shown_after_it() {
    let mut events = run();
    exchange(&mut events, 100 * MS, 700);
    events.reset(150 * MS, Board::Dpr, true);
    read(&mut events, 149 * MS + 500_000, &[&status(700)[..32], &[0xFF; 32]].concat());
    assert_eq!(violations(&events), [], "the start cut the transaction off");
    let mut at_its_start = events.clone();
    read(&mut at_its_start, 150 * MS, &status(700));
    assert_eq!(violations(&at_its_start), [Violation::HoldShown]);
    read(&mut events, 180 * MS, &status(700));
    assert_eq!(violations(&events), [Violation::HoldShown]);
}

#[test]
fn a_dpr_that_hangs_may_leave_an_answer_without_its_bytes() {
    let underrun = || What::Hold(HoldEvent::PortMisuse { text: "transmission ran out of FIFO bytes".into() });
    let mut events = run();
    events.add(100 * MS, underrun());
    assert_eq!(violations(&events), [Violation::FrontEndMisuse]);
    events.add(99 * MS, What::Hung { board: Board::Dpr });
    assert_eq!(violations(&events), []);
}

fn uplink(writer: usize, timestamp: u32) -> Vec<u8> {
    let values = UplinkValues { timestamp, ..UplinkValues::default() };
    let object = match writer {
        0 => Uplink::seal(WriterOf::<BaseStation>::claim(), &values),
        _ => Uplink::seal(WriterOf::<FlightController>::claim(), &values),
    };
    object.as_bytes().to_vec()
}

fn write(events: &mut Events, at: u64, object: &[u8], served: bool) {
    let mosi = [&[0; 8], object].concat();
    let miso = vec![if served { 0 } else { 0xFF }; mosi.len()];
    events.add(at, What::Transaction { selected: at - MS / 2, mosi: Bytes(mosi), miso: Bytes(miso) });
}

fn answers(after: u64, uplinks: [Vec<u8>; 2], written: &[(usize, u32, u64, bool)]) -> Vec<Violation> {
    let mut events = run();
    for (writer, timestamp, at, served) in written {
        write(&mut events, at * MS, &uplink(*writer, *timestamp), *served);
    }
    events.add(1_000 * MS, What::Hold(HoldEvent::Heard(frame(999 * MS, &status(700)))));
    let answer = frame(1_000 * MS + after, &uplinks.concat());
    events.add(1_010 * MS, What::Hold(HoldEvent::Answered(answer)));
    violations(&events)
}

const NOTHING: fn() -> Vec<u8> = || vec![0; 64];

#[test]
fn an_answer_has_each_writers_newest_stored_uplink() {
    let written = [(0, 1, 700, true), (0, 2, 900, true), (1, 5, 500, true), (1, 6, 960, false)];
    let of = |base, controller| answers(2 * MS, [base, controller], &written);
    assert_eq!(of(uplink(0, 2), uplink(1, 5)), []);
    let wrong = [Violation::HoldAnswer];
    assert_eq!(of(uplink(0, 1), uplink(1, 5)), wrong, "an older one");
    assert_eq!(of(NOTHING(), uplink(1, 5)), wrong, "none");
    assert_eq!(of(uplink(0, 3), uplink(1, 5)), wrong, "one that nobody wrote");
    assert_eq!(of(uplink(1, 5), uplink(0, 2)), wrong, "each in the other's place");
}

#[test]
fn an_uplink_is_due_to_900_ms_and_right_for_a_second() {
    let of = |object: Vec<u8>, at| answers(2 * MS, [object, NOTHING()], &[(0, 1, at, true)]);
    let wrong = [Violation::HoldAnswer];
    assert_eq!((of(NOTHING(), 973), of(NOTHING(), 972)), (vec![], wrong.to_vec()));
    let mut late = run();
    write(&mut late, 100 * MS, &uplink(0, 1), true);
    let answer = |at: u64, object: &[u8]| {
        let mut events = late.clone();
        events.add(at * MS, What::Hold(HoldEvent::Heard(frame((at - 1) * MS, &status(700)))));
        let answer = frame((at + 2) * MS, &[object, &NOTHING()].concat());
        events.add((at + 4) * MS, What::Hold(HoldEvent::Answered(answer)));
        violations(&events)
    };
    assert_eq!((answer(998, &NOTHING()), answer(999, &NOTHING())), (wrong.to_vec(), vec![]));
    assert_eq!((answer(1_208, &uplink(0, 1)), answer(1_209, &uplink(0, 1))), (vec![], wrong.to_vec()));
}

#[test]
fn an_answer_waits_for_its_instant_and_needs_a_new_object() {
    let at = |after| answers(after, [NOTHING(), NOTHING()], &[]);
    assert_eq!((at(ANSWERS.0), at(ANSWERS.1)), (vec![], vec![]));
    assert_eq!(at(ANSWERS.0 - 1), [Violation::HoldAnswer]);
    assert_eq!(at(ANSWERS.1 + 1), [Violation::HoldAnswer]);
    let mut events = run();
    events.add(100 * MS, What::Hold(HoldEvent::Heard(frame(99 * MS, &[7; 64]))));
    events.add(104 * MS, What::Hold(HoldEvent::Answered(frame(102 * MS, &[0; Answer::SIZE]))));
    assert_eq!(violations(&events), [Violation::HoldAnswer], "no object");
    let mut events = run();
    exchange(&mut events, 100 * MS, 700);
    events.add(105 * MS, What::Hold(HoldEvent::Answered(frame(102_500_000, &[0; Answer::SIZE]))));
    assert_eq!(violations(&events), [Violation::HoldAnswer], "a second one");
}

#[test]
fn a_disturbed_hold_excuses_only_that_its_carrier_ends_before_an_answer() {
    let misuse = |text: &str, disturbed: bool| {
        let mut events = run();
        if disturbed {
            let disturbs = Disturbance::Hold { part: HoldPart::Air };
            events.add(50 * MS, testing::injected(disturbs, 150 * MS));
        }
        events.add(100 * MS, What::Hold(HoldEvent::PortMisuse { text: text.into() }));
        violations(&events)
    };
    assert_eq!(misuse("the DPR's second front end: transmission without a field (1 times)", true), []);
    let wrong = [Violation::FrontEndMisuse];
    assert_eq!(misuse("the DPR's second front end: transmission without a field (1 times)", false), wrong);
    assert_eq!(misuse("the DPR's second front end: SPI access without supply", true), wrong);
}

#[test]
fn two_frames_of_the_hold_begin_99_ms_apart() {
    let second = |began: u64, restarts: bool| {
        let mut events = run();
        for (began, timestamp) in [(100 * MS, 100), (began, 200)] {
            let sent = HoldFrame { started: began, ..frame(began, &status(timestamp)) };
            events.add(began + MS, What::Hold(HoldEvent::Sent(sent)));
        }
        if restarts {
            events.add(150 * MS, What::Hold(HoldEvent::Reset { cause: Cause::Pin, asked: true }));
        }
        violations(&events)
    };
    assert_eq!(second(199 * MS, false), []);
    assert_eq!(second(199 * MS - 1, false), [Violation::HoldEarly]);
    assert_eq!(second(180 * MS, true), [], "the first one after a start");
}
