use super::*;
use crate::testing::{HORUS_FRONT_END, injected};

#[test]
fn a_tick_without_frames_is_told_when_the_next_one_comes() {
    let silent = |events: &mut Events| _ = events.without(|event| of(5)(event) && !is_tick(event));
    for gps in [3, 5] {
        assert_eq!(changed(gps, silent), [(Violation::NoFrame, 1, tick(6))]);
    }
    let second =
        |event: &Event| of(5)(event) && event.at > tick(5) + 4 * MS && (is_command(event) || event.at == end(5, 5));
    assert_eq!(changed(5, |events| _ = events.without(second)), [(Violation::NoFrame, 1, tick(6))]);
    let first = |event: &Event| of(5)(event) && !is_tick(event) && event.at < tick(5) + 4_100_000;
    assert_eq!(changed(5, |events| _ = events.without(first)), [(Violation::NoFrame, 1, tick(6))]);
}

#[test]
fn only_the_last_tick_of_a_run_may_lack_its_frames() {
    let silent = |number| changed(3, |events| _ = events.without(|event| of(number)(event) && !is_tick(event)));
    // If the run ends early, frames of the last cycle may be missing.
    assert_eq!(silent(1), [(Violation::NoFrame, 1, tick(2))]);
    assert_eq!(changed(3, |events| _ = events.end(tick(CYCLES) + MS)), []);
}

#[test]
fn a_frame_that_its_cycle_does_not_have_is_extra() {
    let again = |from: u64, to: u64, after: u64| {
        let (gps, number) = (1, 0);
        let mut events = Events::flawless(gps, CYCLES);
        let own: Vec<_> = events.events.iter().filter(|event| of(from)(event)).cloned().collect();
        let sent: Vec<_> = own.iter().filter(|event| is_sent(event)).collect();
        let What::Sent { bytes, .. } = &sent[number].what else { unreachable!() };
        let payload = bytes[1..bytes.len() - 2].to_vec();
        let started = if to == 0 { FIRST_TICK - 8 * MS } else { tick(to) + after };
        events.add(started - LATENCY, What::Command).frame(started, &payload);
        broken(&events).into_iter().map(|(violation, count, _)| (violation, count)).collect::<Vec<_>>()
    };
    let extra = [(Violation::ExtraFrame, 1)];
    assert_eq!(again(5, 5, 5 * MS), extra, "the same again");
    assert_eq!(again(5, 5, 8 * MS), extra, "it ends after the next tick");
    assert_eq!(again(4, 5, 5 * MS), extra, "an old one again");
    assert_eq!(again(6, 5, 5 * MS), extra, "the next one before its tick");
    assert_eq!(again(1, 0, 5 * MS), extra, "before the first tick");
}

#[test]
fn frames_that_change_places_are_told_once() {
    let mut events = Events::flawless(5, CYCLES);
    let frames: Vec<Vec<u8>> = events
        .events
        .iter()
        .filter(|event| of(5)(event) && is_sent(event))
        .map(|event| match &event.what {
            What::Sent { bytes, .. } => bytes[1..bytes.len() - 2].to_vec(),
            _ => unreachable!(),
        })
        .collect();
    events.without(|event| of(5)(event) && is_sent(event));
    for (after, payload) in COMMAND.into_iter().zip(frames.iter().rev()) {
        events.frame(tick(5) + after + LATENCY, payload);
    }
    let kinds: Vec<_> = broken(&events).into_iter().map(|(violation, count, _)| (violation, count)).collect();
    assert_eq!(kinds, [(Violation::ExtraFrame, 1)]);
}

#[test]
fn a_command_that_no_frame_follows_is_told_alone() {
    let lost = |number| changed(3, |events| _ = events.without(|event| of(number)(event) && is_sent(event)));
    assert_eq!(lost(5), [(Violation::CommandWithoutFrame, 1, tick(5) + COMMAND[0])]);
    assert_eq!(lost(CYCLES), [], "its frame may have been on the air at the end of the run");
    let twice = |before: u64| changed(3, |events| _ = events.add(tick(5) + COMMAND[0] - before, What::Command));
    assert_eq!(twice(10_000), [(Violation::CommandWithoutFrame, 1, tick(5) + COMMAND[0] - 10_000)]);
    let before = Events::flawless(3, 0).add(10 * MS, What::Command).cycles(FIRST_TICK, 5).end(tick(6) - MS).clone();
    assert_eq!(broken(&before), [(Violation::CommandWithoutFrame, 1, 10 * MS)], "before the first tick");
}

#[test]
fn a_command_has_no_frame_when_the_longest_has_passed() {
    let at = tick(CYCLES) + COMMAND[0];
    let last = |passed: u64| {
        let mut events = Events::flawless(3, CYCLES);
        events.without(|event| of(CYCLES)(event) && is_sent(event));
        events.add(tick(CYCLES + 1), What::Tick).add(tick(CYCLES + 2), What::Tick);
        broken(events.end(at + passed)).into_iter().filter(|(kind, ..)| *kind != Violation::NoFrame).collect::<Vec<_>>()
    };
    assert_eq!(last(bounds::COMMAND_TO_END), []);
    assert_eq!(last(bounds::COMMAND_TO_END + 1), [(Violation::CommandWithoutFrame, 1, at)]);
}

#[test]
fn a_frame_that_no_command_began_is_told_alone() {
    let orphan = |by: i64| changed(3, |events| shift(events, -by, |event| of(5)(event) && is_command(event)));
    let longest = (bounds::COMMAND_TO_AIR - LATENCY) as i64;
    let alone = (Violation::FrameWithoutCommand, 1, end(3, 5));
    assert_eq!(orphan(longest)[0].0, Violation::CommandJitter);
    assert_eq!(
        orphan(longest + 1),
        [(Violation::CommandWithoutFrame, 1, tick(5) + COMMAND[0] + LATENCY - bounds::COMMAND_TO_AIR - 1), alone]
    );
    let none = changed(3, |events| _ = events.without(|event| of(5)(event) && is_command(event)));
    assert_eq!(none, [alone]);
}

#[test]
fn a_frame_that_is_broken_off_is_told_alone() {
    for gps in [3, 5] {
        let cut = changed(gps, |events| {
            for event in events.events.iter_mut().filter(|event| of(5)(event)) {
                if let What::Sent { whole, bytes, .. } = &mut event.what
                    && event.at == end(gps, 5)
                {
                    *whole = false;
                    bytes.0.truncate(40);
                }
            }
        });
        assert_eq!(cut, [(Violation::BrokenOff, 1, end(gps, 5))]);
    }
}

#[test]
fn what_is_not_whole_objects_is_told_alone() {
    let shorter = changed(3, |events| payload(events, 5, |payload| _ = payload.pop()));
    assert_eq!(shorter, [(Violation::SentNotWhole, 1, end(3, 5))]);
    let empty = changed(1, |events| payload(events, 5, Vec::clear));
    assert_eq!(empty, [(Violation::SentNotWhole, 1, end(1, 5))]);
}

#[test]
fn a_disturbed_front_end_may_send_a_frame_of_another_length() {
    let shorter = changed(3, |events| {
        payload(events, 5, |payload| _ = payload.pop());
        events.add(tick(5), injected(HORUS_FRONT_END, tick(5)));
    });
    assert_eq!(shorter, []);
}

#[test]
fn every_object_that_is_not_valid_is_told() {
    let one = changed(3, |events| payload(events, 5, |payload| payload[70] ^= 1));
    assert_eq!(one, [(Violation::SentInvalid, 1, end(3, 5))]);
    let all = changed(3, |events| payload(events, 5, |payload| payload.fill(0)));
    assert_eq!(all, [(Violation::SentInvalid, 4, end(3, 5))]);
}

#[test]
fn a_frame_with_a_wrong_timestamp_is_reported_once() {
    let wrong = (Violation::TimestampWrong, 1, end(3, 5));
    let stamps = |stamps| changed(3, |events| payload(events, 5, |payload| *payload = stamped(stamps)));
    assert_eq!(stamps([50; 4]), []);
    assert_eq!(stamps([60; 4]), [wrong], "from the future");
    assert_eq!(stamps([40; 4]), [wrong], "of the cycle before");
    assert_eq!(stamps([51; 4]), [wrong]);
    assert_eq!(stamps([50, 50, 40, 50]), [wrong], "one receiver's");
    assert_eq!(stamps([50, 50, 40, 60]), [wrong]);
    assert_eq!(stamps([40, 50, 50, 50]), [], "Reported-Position alone is judged beside the GPS objects");
}

#[test]
fn reported_positions_timestamp_is_judged_where_no_gps_object_is_valid() {
    let stamps = |reported| {
        changed(3, |events| {
            payload(events, 5, |payload| {
                *payload = stamped([reported, 50, 50, 50]);
                payload[64..].iter_mut().for_each(|byte| *byte ^= 0x55);
            });
        })
    };
    assert_eq!(stamps(50), [(Violation::SentInvalid, 3, end(3, 5))]);
    let wrong = (Violation::TimestampWrong, 1, end(3, 5));
    assert_eq!(
        stamps(60),
        [(Violation::SentInvalid, 3, end(3, 5)), wrong]
            .into_iter()
            .collect::<std::collections::BTreeSet<_>>()
            .into_iter()
            .collect::<Vec<_>>()
    );
}
