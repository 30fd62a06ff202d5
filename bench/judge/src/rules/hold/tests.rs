//! Tests the rule of the hold on logs that are made by hand.

use profile::criticality::{ActiveLoad, Writer as WriterOf};

use super::*;
use crate::Bytes;
use crate::testing::{self, Events};

/// Returns the violations of a hold that is open at 30 °C, restarts for `cause`, and then says `after`.
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

/// A run with a hold, in which nothing has happened yet.
fn run() -> Events {
    let mut events = Events::new(1);
    events.hold = true;
    events
}

fn violations(events: &Events) -> Vec<Violation> {
    let log = events.log();
    testing::found(Hold::new(&log.header), &log).0.into_iter().map(|(violation, ..)| violation).collect()
}

/// The bytes of Hold-Status of the hold's instant `timestamp`, ms.
fn status(timestamp: u32) -> Vec<u8> {
    HoldStatus::seal(WriterOf::<ActiveLoad>::claim(), &HoldValues::absent(timestamp)).as_bytes().to_vec()
}

/// A whole frame on the air, of which `payload` is between LEN and CRC-16.
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

/// Adds a transaction that reads the whole map at `at`, and in it this object of the hold.
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
}

#[test]
fn what_came_before_the_dprs_start_is_not_shown_after_it() {
    let mut events = run();
    exchange(&mut events, 100 * MS, 700);
    events.reset(150 * MS, Board::Dpr, true);
    read(&mut events, 149 * MS, &status(700));
    assert_eq!(violations(&events), [], "the transaction began before the start");
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
