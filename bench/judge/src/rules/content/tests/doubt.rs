//! Tests messages that HORUS may have missed, restarts of HORUS, and irregular ticks.

use super::reported as reported_as;
use super::*;
use crate::disturbance::Memory;
use crate::testing::{COMMAND, injected};
use crate::{Board, Disturbance};

fn disturbed(number: usize, taken: bool) -> Vec<(Violation, u64)> {
    let mut scene = Scene::new(1);
    scene.receivers[0][number].clean = false;
    kinds(&taken_or_not(&scene, number, taken))
}

fn taken_or_not(scene: &Scene, number: usize, taken: bool) -> Events {
    let bursts = scene.receivers[0].clone();
    let (before, own) = (&bursts[number - 1], &bursts[number]);
    scene.events(|cycle, reported, gps| {
        let tick = tick(cycle);
        if !taken && tick >= own.arrived() + MS && tick < bursts[number + 1].arrived() + MS {
            let (stale, values) = (tick - before.arrived() >= 150 * MS, before.values(gps[0].timestamp));
            gps[0] = GpsValues { status: values.status.with_heard(true).with_stale(stale), ..values };
            *reported = reported_as(&gps[0]);
        }
    })
}

#[test]
fn a_message_on_a_disturbed_line_may_have_been_taken_or_not() {
    assert_eq!(disturbed(5, true), []);
    assert_eq!(disturbed(5, false), []);
}

#[test]
fn a_message_may_be_lost_while_it_waits_in_memory_that_flips() {
    let scene = Scene::new(1);
    let arrived = scene.receivers[0][5].arrived();
    let lost_after_a_flip = |at, board| {
        let mut events = taken_or_not(&scene, 5, false);
        events.add(at, injected(Disturbance::Memory { board, memory: Memory::Receive }, at));
        kinds(&events).is_empty()
    };
    for (at, may) in [
        (scene.receivers[0][5].at - bounds::CYCLE, false),
        (scene.receivers[0][5].at - bounds::CYCLE + 1, true),
        (arrived - 1, true),
        (scene.receivers[0][5].at + bounds::MESSAGE_TAKEN, true),
        (arrived + bounds::MESSAGE_TAKEN, false),
    ] {
        assert_eq!(lost_after_a_flip(at, Board::Horus), may, "{at}");
        assert!(!lost_after_a_flip(at, Board::Dpr), "{at}");
    }
}

#[test]
fn a_message_that_has_waited_for_12_ms_is_not_lost() {
    let mut scene = Scene::new(1);
    scene.receivers[0].iter_mut().for_each(|burst| (burst.att, burst.ins) = (None, None));
    let may_be_lost_after = |wait| {
        let at = scene.receivers[0][5].arrived() + wait;
        let flip = Disturbance::Memory { board: Board::Horus, memory: Memory::Receive };
        kinds(taken_or_not(&scene, 5, false).add(at, injected(flip, at))).is_empty()
    };
    assert!(may_be_lost_after(bounds::MESSAGE_TAKEN - 1));
    assert!(!may_be_lost_after(bounds::MESSAGE_TAKEN));
}

#[test]
fn values_without_any_message_are_wrong_even_on_a_disturbed_line() {
    let mut scene = Scene::new(1);
    scene.receivers[0].iter_mut().for_each(|burst| burst.clean = false);
    assert_eq!(scene.said(unchanged), []);
    assert_eq!(scene.gps1(STEADY, |gps| gps.latitude = gps.latitude.next_up()), CONTENT);
    let silent = |gps: &mut GpsValues| *gps = silent_gps(gps.timestamp);
    assert_eq!(scene.gps1(STEADY, silent), []);
    let old = scene.receivers[0][0].clone();
    scene.cycles = 150;
    let again = |gps: &mut GpsValues| {
        let values = old.values(gps.timestamp);
        *gps = GpsValues { status: values.status.with_stale(true).with_heard(true), ..values };
    };
    assert_eq!(scene.gps1(110, again), []);
    assert_eq!(scene.gps1(149, again), CONTENT);
}

#[test]
fn a_message_that_is_certain_ends_the_doubt() {
    let mut scene = Scene::new(1);
    scene.receivers[0][3].clean = false;
    let (doubtful, certain) = (scene.receivers[0][3].clone(), scene.receivers[0][4].clone());
    let late = |burst: &Burst| {
        let values = burst.clone();
        scene.gps1(cycle_after(&certain, bounds::MESSAGE_TAKEN), |gps| {
            *gps = GpsValues { status: gps.status, ..values.values(gps.timestamp) };
        })
    };
    assert_eq!(late(&certain), []);
    assert_eq!(late(&doubtful), []);
    let certain = scene.receivers[0][6].clone();
    let values = doubtful.clone();
    let said = scene.gps1(cycle_after(&certain, bounds::MESSAGE_TAKEN), |gps| {
        *gps = GpsValues { status: gps.status, ..values.values(gps.timestamp) };
    });
    assert_eq!(said, CONTENT);
}

fn after_doubt(doubtful: usize, age: u64, valid: bool) -> Vec<(Violation, u64)> {
    let mut scene = Scene::with_period(1, 40);
    scene.receivers[0].truncate(20);
    for burst in &mut scene.receivers[0] {
        (burst.att, burst.ins) = (None, None);
        burst.clean = true;
    }
    let number = cycle_after(&scene.receivers[0][19], age * MS);
    let last = scene.receivers[0][19].clone();
    let mut events = scene.events(|_, reported, gps| {
        let values = if valid { last.values(gps[0].timestamp) } else { GpsValues::absent(gps[0].timestamp) };
        let status = values.status.with_heard(age <= 250).with_stale(age > 90);
        gps[0] = GpsValues { status: aged(status, &gps[0]), ..values };
        *reported = reported_as(&gps[0]);
    });
    let own = tick(number)..tick(number + 1);
    events.without(|event| matches!(event.what, What::Sent { started, .. } if !own.contains(&started)));
    if doubtful < 20 {
        // HORUS may miss the burst, because the bytes just before it look like the beginning of a longer message.
        let at = scene.receivers[0][doubtful].at - 10 * BYTE_NS;
        events.fed(at, 0, [0xB5, 0x62, 1, 7, 80, 0, 1, 2, 3, 4].to_vec());
    }
    kinds(&events)
}

#[test]
fn after_a_doubt_the_period_is_known_again_after_four_steps() {
    assert_eq!(after_doubt(99, 230, true), STATUS, "190 ms is the end");
    assert_eq!(after_doubt(18, 230, true), [], "the period may be a second");
    assert_eq!(after_doubt(18, 230, false), [], "or what it was");
    assert_eq!(after_doubt(18, 120, false), STATUS);
    assert_eq!(after_doubt(15, 230, true), []);
    assert_eq!(after_doubt(14, 230, true), STATUS);
}

#[test]
fn horus_may_drop_a_message_from_before_its_first_tick() {
    let mut scene = Scene::new(1);
    scene.receivers[0].truncate(1);
    (scene.receivers[0][0].att, scene.receivers[0][0].ins) = (None, None);
    scene.receivers[0][0].at = 10 * MS;
    assert_eq!(scene.said(unchanged), []);
    scene.receivers[0][0].at = FIRST_TICK - 1;
    assert_eq!(scene.said(unchanged), []);
    let nothing = |scene: &Scene| {
        scene.said(|_, reported, gps| {
            gps[0] = silent_gps(gps[0].timestamp);
            *reported = reported_as(&gps[0]);
        })
    };
    assert_eq!(nothing(&scene), []);
    scene.receivers[0][0].at = FIRST_TICK;
    assert_eq!(nothing(&scene)[0].0, Violation::StatusWrong);
}

fn restarted(power: bool, remembers: bool) -> Vec<(Violation, u64)> {
    let mut scene = Scene::new(1);
    scene.receivers[0].truncate(6);
    let last = scene.receivers[0][5].clone();
    let mut events = scene.events(unchanged);
    let at = tick(56) + MS;
    let feeds = events.clone();
    events.without(|event| event.at > at || matches!(event.what, What::Fed { .. }));
    events.events.extend(feeds.events.into_iter().filter(|event| matches!(event.what, What::Fed { .. })));
    let board = Board::Horus;
    if power {
        events.add(at, What::Power { board, on: false }).add(at + MS, What::Power { board, on: true });
    } else {
        events.reset(at, board, false);
    }
    for number in 1..=20_u64 {
        let timestamp = number as u32 * 10;
        let gps = if remembers {
            let values = last.values(timestamp);
            GpsValues { status: values.status.with_heard(true), ..values }
        } else {
            silent_gps(timestamp)
        };
        events.cycle_of(600 * MS + number * bounds::CYCLE, &reported_as(&gps), &[gps]);
    }
    events.end(809 * MS);
    kinds(&events)
}

#[test]
fn a_restart_forgets_everything() {
    for power in [true, false] {
        assert_eq!(restarted(power, false), []);
        assert!(!restarted(power, true).is_empty());
    }
}

#[test]
fn the_frame_that_a_restart_overtakes_is_not_judged() {
    let scene = Scene::new(1);
    let events = scene.events(|cycle, _, gps| {
        if cycle == STEADY {
            gps[0].latitude = 0.0;
        }
    });
    assert_eq!(kinds(&events), CONTENT);
    for after in [COMMAND[0] + 1_000, MS] {
        let mut events = events.clone();
        events.reset(tick(STEADY) + after, Board::Horus, true).without(|event| event.at > tick(STEADY) + 8 * MS);
        assert_eq!(kinds(&events), []);
    }
}

#[test]
fn the_dprs_restart_forgets_nothing() {
    let mut events = Scene::new(1).events(unchanged);
    events.reset(tick(STEADY) + MS, Board::Dpr, true).add(tick(70), What::Power { board: Board::Dpr, on: false });
    assert_eq!(kinds(&events), []);
}

#[test]
fn an_object_whose_timestamp_is_not_its_ticks_is_not_judged() {
    let wrong = |gps: usize| {
        Scene::new(gps).said(|cycle, reported, all| {
            if cycle == STEADY {
                reported.timestamp += 10;
                for gps in all.iter_mut() {
                    gps.timestamp += 10;
                    gps.latitude = 0.0;
                }
            }
        })
    };
    for gps in [1, 3, 5] {
        assert_eq!(wrong(gps), []);
    }
}

#[test]
fn timestamps_that_stay_ahead_do_not_end_the_judging() {
    let said = Scene::new(1).said(|cycle, reported, gps| {
        if cycle > 30 {
            reported.timestamp += 20;
            gps[0].timestamp += 20;
        }
        if cycle == STEADY {
            gps[0].latitude = 0.0;
        }
    });
    assert_eq!(said, CONTENT);
}

fn still_valid(moved: i64, silent: bool, last: u64) -> Vec<(Violation, u64)> {
    let mut scene = Scene::new(1);
    scene.receivers[0].truncate(4);
    let burst = scene.receivers[0][3].clone();
    scene.cycles = 300;
    let mut events = scene.events(|cycle, reported, gps| {
        if cycle >= 65 {
            let values = if silent { silent_gps(gps[0].timestamp) } else { burst.values(gps[0].timestamp) };
            gps[0] = GpsValues { status: aged(values.status.with_heard(!silent), &gps[0]), ..values };
        }
        *reported = reported_as(&gps[0]);
    });
    for event in events.events.iter_mut().filter(|event| event.at == tick(60) && event.what == What::Tick) {
        event.at = event.at.checked_add_signed(moved).unwrap();
    }
    events.without(|event| matches!(event.what, What::Sent { .. }) && (event.at < tick(65) || event.at > tick(last)));
    kinds(&events)
}

#[test]
fn ages_are_not_judged_for_two_seconds_after_irregular_ticks() {
    let bound = bounds::TICK_TOLERANCE as i64;
    assert_eq!(still_valid(0, true, 70), []);
    assert_eq!(still_valid(0, false, 66), STATUS);
    assert_eq!(still_valid(bound, false, 66), STATUS);
    assert_eq!(still_valid(bound + 1, false, 66), []);
    assert_eq!(still_valid(bound + 1, true, 66), []);
    let until = 61 + UNTIMED / bounds::CYCLE;
    assert_eq!(still_valid(bound + 1, false, until), []);
    assert_eq!(still_valid(bound + 1, false, until + 1), STATUS);
}

#[test]
fn an_ages_bounds_allow_for_clock_error_and_message_delay() {
    let age = |tick: u64, born| {
        let Age { least, most } = Age::at(tick, born);
        (least, most)
    };
    let taken = bounds::MESSAGE_TAKEN;
    assert_eq!(age(470 * MS, (0, 0)), (470 * MS - taken - (470 * MS - taken) / 47 - MS, 481 * MS));
    assert_eq!(age(taken + 48 * MS, (MS, MS)), (47 * MS - MS - MS, 59 * MS + 59 * MS / 47 + MS));
    assert_eq!(age(taken + 48 * MS, (MS, 48 * MS)), (0, 59 * MS + 59 * MS / 47 + MS));
    assert_eq!(age(5, (6, 6)), (0, MS));
    let age = Age { least: 10, most: 20 };
    assert_eq!(age.within(9, 9), [false, true]);
    assert_eq!(age.within(9, 10), [true, true]);
    assert_eq!(age.within(19, 19), [true, true]);
    assert_eq!(age.within(20, 20), [true, false]);
}

#[test]
fn a_message_of_a_disturbed_line_may_have_been_found_late() {
    let mut scene = Scene::new(1);
    scene.receivers[0].truncate(6);
    scene.receivers[0][5].clean = false;
    let last = scene.receivers[0][5].clone();
    let at = |age: u64, heard: bool| {
        scene.gps1(cycle_after(&last, age * MS), |gps| gps.status = gps.status.with_heard(heard))
    };
    assert_eq!(at(400, true), []);
    assert_eq!(at(480, true), STATUS);
    // HORUS may assume a period of up to one second. A position is valid for that period, for 150 ms more, and for
    // HORUS's delay.
    let mut scene = scene.clone();
    scene.cycles = 300;
    let valid = |age: u64| {
        scene.gps1(cycle_after(&last, age * MS), |gps| {
            let values = last.values(gps.timestamp);
            *gps = GpsValues { status: values.status.with_stale(true), ..values };
        })
    };
    assert_eq!(valid(1_340), []);
    assert_eq!(valid(1_410), STATUS);
}

#[test]
fn a_message_with_a_doubtful_time_of_week_may_be_old() {
    let mut scene = Scene::new(1);
    scene.receivers[0].truncate(7);
    for burst in &mut scene.receivers[0] {
        (burst.att, burst.ins) = (None, None);
    }
    let itow = scene.receivers[0][5].pvt.unwrap().itow_ms;
    scene.receivers[0][6].pvt.as_mut().unwrap().itow_ms = itow;
    let last = scene.receivers[0][6].clone();
    scene.cycles = 300;
    let at = |scene: &Scene, age: u64, valid: bool| {
        let number = cycle_after(&last, age * MS);
        let mut events = scene.events(|_, reported, gps| {
            let values = if valid { last.values(gps[0].timestamp) } else { GpsValues::absent(gps[0].timestamp) };
            let status = values.status.with_stale(true).with_heard(true);
            let age_ms = u32::from(last.values(gps[0].timestamp).status.solution_age_ms().unwrap());
            let age_ms = if scene.receivers[0][5].clean { age_ms + 100 } else { age_ms };
            gps[0] = GpsValues { status: status.with_solution_age_ms(Some(age_ms)), ..values };
            *reported = reported_as(&gps[0]);
        });
        let own = tick(number)..tick(number + 1);
        events.without(|event| matches!(event.what, What::Sent { started, .. } if !own.contains(&started)));
        kinds(&events)
    };
    assert_eq!(at(&scene, 180, true), STATUS, "it is as old as the one before, 280 ms");
    assert_eq!(at(&scene, 180, false), []);
    scene.receivers[0][5].clean = false;
    assert_eq!(at(&scene, 180, true), []);
    assert_eq!(at(&scene, 180, false), [], "the period may be 20 ms, and HORUS may have taken the first");
}

#[test]
fn a_late_frame_is_judged_by_its_own_ticks_data() {
    let late = |wrong: bool| {
        let mut events = Scene::new(5).events(|cycle, _, gps| {
            if cycle == STEADY && wrong {
                gps[0].latitude = 0.0;
            }
        });
        for event in &mut events.events {
            if let What::Sent { started, .. } = &mut event.what {
                event.at += 5 * MS;
                *started += 5 * MS;
            }
        }
        kinds(&events)
    };
    assert_eq!(late(false), []);
    assert_eq!(late(true), CONTENT);
}

#[test]
fn another_receiver_than_those_of_the_profile_is_none_of_it() {
    let mut events = Scene::new(1).events(unchanged);
    let bytes = Burst::new(0, 7, 100).bytes();
    events.fed(500 * MS, 1, bytes);
    assert_eq!(kinds(&events), []);
}
