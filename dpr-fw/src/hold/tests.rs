//! Tests the second port's budget, what the image has of the hold, and the answers to the hold.

use profile::{
    criticality::{ActiveLoad, BaseStation, Dpr, FlightController, Writer},
    hold::COMMAND_AGE_MS,
    map::Map,
    HoldStatus, HoldValues, PortStatus, PortValues, Rejection, Uplink, UplinkStatus, UplinkValues,
};

use super::{
    budget::{Budget, Turn},
    shared::intact,
    Area, Shared, SHOWN,
};

const BASE: Writer<BaseStation> = Writer::claim();
const FC: Writer<FlightController> = Writer::claim();
const VALUES: UplinkValues =
    UplinkValues { timestamp: 5, status: UplinkStatus::from_bits(0xA5C3), payload: [7; Uplink::PAYLOAD] };

fn object(timestamp: u32) -> HoldStatus {
    HoldStatus::seal(Writer::<ActiveLoad>::claim(), &HoldValues::absent(timestamp))
}

/// Asks the budget for a call every `every_us` µs from `from_us` to `until_us`. Returns how many of these calls may
/// work.
fn flood(budget: &mut Budget, from_us: u32, until_us: u32, every_us: usize) -> u32 {
    let works = |at_us| matches!(budget.call(at_us), Turn::Work | Turn::Begin { .. });
    (from_us..until_us).step_by(every_us).map(works).map(u32::from).sum()
}

// Shows HOLD-7.
#[test]
fn calls_without_end_are_served_up_to_the_budget_of_each_window() {
    for every_us in [1, 7, 99] {
        let mut budget = Budget::new(0);
        for window in 0..5 {
            let from_us = window * Budget::WINDOW_US;
            let worked = flood(&mut budget, from_us, from_us + Budget::WINDOW_US, every_us);
            assert!((Budget::CALLS - 1..=Budget::CALLS).contains(&worked), "{worked} in window {window}");
        }
    }
}

#[test]
fn an_answer_begins_only_with_the_calls_and_bytes_that_it_takes() {
    let (calls, bytes) = Budget::ANSWER;
    let mut budget = Budget::new(0);
    for _ in calls..Budget::CALLS {
        assert!(budget.has_answer());
        budget.call(1);
    }
    assert!(budget.has_answer());
    budget.carry(Budget::BYTES - bytes);
    assert!(budget.has_answer());
    budget.carry(1);
    assert!(!budget.has_answer(), "a byte is missing");
    let mut budget = Budget::new(0);
    for _ in calls..=Budget::CALLS {
        budget.call(1);
    }
    assert!(!budget.has_answer(), "a call is missing");
}

// Shows HOLD-8.
#[test]
fn the_port_rests_once_and_wakes_in_the_next_window() {
    let mut budget = Budget::new(u32::MAX - 10);
    for _ in 0..Budget::CALLS {
        assert_eq!(budget.call(5), Turn::Work);
    }
    assert_eq!(budget.call(6), Turn::Rest);
    assert_eq!(budget.call(7), Turn::Resting);
    assert_eq!(budget.call(Budget::WINDOW_US - 12), Turn::Resting);
    assert_eq!(budget.call(Budget::WINDOW_US - 11), Turn::Begin { rested: true });
    assert_eq!(budget.call(Budget::WINDOW_US), Turn::Work);
    assert_eq!(budget.call(2 * Budget::WINDOW_US), Turn::Begin { rested: false });
}

// Shows HOLD-7.
#[test]
fn bytes_without_end_make_the_port_rest() {
    let mut budget = Budget::new(0);
    budget.carry(Budget::BYTES - 1);
    assert_eq!(budget.call(1), Turn::Work);
    budget.carry(1);
    assert_eq!(budget.call(2), Turn::Rest);
    assert_eq!(budget.spent(), (1, Budget::BYTES));
}

fn bits(shared: &mut Shared, now_us: u32) -> (bool, bool, u8, u8) {
    let status = shared.show(now_us, &mut [0; SHOWN]);
    (status.hold_heard(), status.hold_accepted(), status.hold_objects_accepted(), status.hold_objects_rejected())
}

#[test]
fn port_status_counts_the_frames_of_the_hold() {
    let mut shared = Shared::new();
    assert_eq!(bits(&mut shared, 1_000), (false, false, 0, 0));
    assert_eq!(shared.receive(object(100).as_bytes(), 9_000, 9_100), Ok(()));
    assert_eq!(bits(&mut shared, 10_000), (true, true, 1, 0));
    assert_eq!(shared.receive(object(100).as_bytes(), 12_000, 12_000), Err(Rejection::Repeated));
    assert_eq!(bits(&mut shared, 13_000), (true, false, 1, 1));
    assert_eq!(bits(&mut shared, 311_999), (true, false, 1, 1));
    assert_eq!(bits(&mut shared, 312_000), (false, false, 1, 1));
}

#[cfg(feature = "hold")]
#[test]
fn the_image_shows_the_object_of_the_hold_for_300_ms() {
    let mut shared = Shared::new();
    let mut place = [0xEE; SHOWN];
    shared.show(1_000, &mut place);
    assert_eq!(place, [0; SHOWN]);
    shared.receive(object(100).as_bytes(), 9_000, 9_100).unwrap();
    shared.receive(&[0x5A; 64], 20_000, 20_000).unwrap_err();
    shared.show(308_999, &mut place);
    assert_eq!(&place, object(100).as_bytes());
    shared.show(309_000, &mut place);
    assert_eq!(place, [0; SHOWN]);
}

#[test]
fn the_hold_gets_each_uplink_as_it_was_stored_for_a_second() {
    const STORED_US: u64 = 2_000_000;
    let base_station = Uplink::seal(BASE, &VALUES);
    let flight_controller = Uplink::seal(FC, &UplinkValues { timestamp: 6, ..VALUES });
    let mut shared = Shared::new();
    let parts = |shared: &mut Shared, now_us| {
        let answer = intact(shared.answer(now_us));
        (answer.uplink::<BaseStation>().copied().ok(), answer.uplink::<FlightController>().copied().ok())
    };
    assert_eq!(parts(&mut shared, 1_000_000), (None, None));
    shared.keep::<BaseStation>(&base_station, Some(STORED_US));
    assert_eq!(parts(&mut shared, 2_000_100), (Some(base_station), None));
    shared.keep::<FlightController>(&flight_controller, Some(STORED_US + 10));
    // The port task hands on an empty uplink 500 ms after the last one. The copy for the hold must not change.
    shared.keep::<BaseStation>(&Uplink::EMPTY, Some(STORED_US));
    let last_us = 2_000_000 + 1_000 * COMMAND_AGE_MS;
    assert_eq!(parts(&mut shared, last_us), (Some(base_station), Some(flight_controller)));
    assert_eq!(parts(&mut shared, last_us + 1), (None, Some(flight_controller)));
    assert_eq!(parts(&mut shared, last_us + 11), (None, None));
}

#[test]
fn an_uplink_that_memory_has_damaged_becomes_zeros() {
    let mut damaged = *Uplink::seal(BASE, &VALUES).as_bytes();
    damaged[20] ^= 4;
    let good = Uplink::seal(FC, &VALUES);
    let mut shared = Shared::new();
    shared.keep::<BaseStation>(bytemuck::from_bytes(&damaged), Some(0));
    shared.keep::<FlightController>(&good, Some(0));
    let answer = intact(shared.answer(1));
    assert_eq!(answer.as_bytes()[..64], [0; 64]);
    assert_eq!(answer.as_bytes()[64..], *good.as_bytes());
    // An uplink of the wrong writer is intact, but must be replaced by zeros in the answer.
    shared.keep::<FlightController>(&Uplink::seal(BASE, &VALUES), Some(2));
    assert_eq!(intact(shared.answer(3)), profile::hold::Answer::EMPTY);
}

#[test]
fn the_objects_of_port_and_hold_lie_behind_the_image() {
    let mut area = Area::EMPTY;
    let status = PortStatus::seal(Writer::<Dpr>::claim(), &PortValues::default());
    area.port.set_status(Writer::<Dpr>::claim(), status);
    area.hold.fill(0x5A);
    let mut map = [0; Map::<3>::LEN_WITH_HOLD];
    area.place::<3>(Writer::<Dpr>::claim(), &mut map);
    assert_eq!(map[Map::<3>::port_status()], *status.as_bytes());
    assert!(map[..Map::<3>::PORT_STATUS].iter().all(|byte| *byte == 0));
    assert_eq!(map[Map::<3>::hold()].iter().filter(|byte| **byte == 0x5A).count(), SHOWN);
}
