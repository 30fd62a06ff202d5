//! Tests how soon a cycle is readable. Each test changes a flawless log in one way.

use crate::common;

use bench_judge::{Violation::*, What, bounds};
use common::*;

const MS: u64 = 1_000_000;
const GPS: [usize; 4] = [1, 2, 3, 5];

#[test]
fn a_cycle_must_be_readable_soon_after_its_last_bit() {
    for gps in GPS {
        for (late, violations) in
            [(100_000, vec![]), (100_001, vec![(LateReadable, 1)]), (6_000_000, vec![(LateReadable, 1)])]
        {
            let mut plan = Plan::new(gps, 40);
            let number = plan.showing(200);
            plan.publications[number].at += late - TO_FRESH;
            let log = plan.log();
            assert_eq!(found(&log), violations, "{gps} {late}");
            assert_eq!(judged(&log).figures.last_bit_to_readable.unwrap().max, late, "{gps}");
        }
    }
}

#[test]
fn a_sample_that_is_readable_too_late_is_a_violation() {
    for (late, violations) in [(0, vec![]), (1, vec![(LateSample, 1)])] {
        let mut plan = Plan::new(3, 40);
        let number = plan.showing(200);
        let rose = plan.publications[number].at;
        let tick = FIRST_TICK + 19 * bounds::CYCLE;
        for event in plan.upstream.iter_mut().filter(|event| event.at == tick) {
            event.at = rose - bounds::SAMPLE_TO_READABLE - late;
        }
        let log = plan.log();
        let ours = [LateSample, LateReadable];
        let found: Vec<_> = found(&log).into_iter().filter(|(kind, _)| ours.contains(kind)).collect();
        assert_eq!(found, violations);
        assert_eq!(judged(&log).figures.sample_to_readable.unwrap().max, bounds::SAMPLE_TO_READABLE + late);
    }
}

#[test]
fn disturbed_frames_and_cycles_without_a_tick_are_not_measured() {
    let measured = |gps: usize, spoil: &dyn Fn(&mut Plan, u64)| {
        let mut plan = Plan::new(gps, 40);
        let number = plan.showing(200);
        let rose = plan.publications[number].at;
        plan.publications[number].at += 500_000;
        spoil(&mut plan, rose - TO_FRESH);
        let log = plan.log();
        let ours = [LateSample, LateReadable];
        judged(&log).kinds().filter(|kind| ours.contains(kind)).collect::<Vec<_>>()
    };
    for gps in GPS {
        assert_eq!(measured(gps, &|_, _| {}), [LateReadable]);
        let delay = |by: u64| {
            move |plan: &mut Plan, ended: u64| {
                for event in &mut plan.upstream {
                    if let What::Heard { started, .. } = &mut event.what
                        && event.at == ended
                    {
                        (event.at, *started) = (ended + by, *started + by);
                    }
                }
            }
        };
        assert_eq!(measured(gps, &delay(1_001)), []);
        assert_eq!(measured(gps, &delay(1_000)), [LateReadable]);
        assert_eq!(
            measured(gps, &|plan, ended| {
                plan.upstream.retain(|event| event.at != ended || !matches!(event.what, What::Heard { .. }));
            }),
            []
        );
        assert_eq!(
            measured(gps, &|plan, ended| {
                for event in plan.upstream.iter_mut().filter(|event| event.at == ended) {
                    if let What::Heard { whole, .. } = &mut event.what {
                        *whole = false;
                    }
                }
            }),
            []
        );
    }
    let mut plan = Plan::new(3, 40);
    plan.upstream.retain(|event| event.what != What::Tick);
    let figures = judged(&plan.log()).figures;
    assert_eq!((figures.sample_to_readable, figures.last_bit_to_readable.is_some()), (None, true));
    let mut plan = Plan::new(3, 40);
    plan.upstream.retain(|event| event.what != What::Tick || event.at < 200 * MS);
    assert_eq!(judged(&plan.log()).figures.sample_to_readable.unwrap().max, 4_960_000 + 14_659);
}

#[test]
fn a_flight_controller_that_misuses_the_ssi_delays_no_image() {
    for (by, violations) in [(0, vec![]), (1, vec![(LateReadable, 1)])] {
        let mut plan = Plan::new(3, 40);
        let number = plan.showing(200);
        let ended = plan.publications[number].at - TO_FRESH;
        plan.publications[number].at = ended + bounds::LAST_BIT_TO_READABLE + by;
        let mut log = plan.log();
        insert(&mut log, ended - MS, injected(MISUSE, ended + MS));
        assert_eq!(found(&log), violations, "{by}");
    }
}

#[test]
fn a_frame_begun_during_a_front_end_fault_may_be_late() {
    for (kind, sooner, violations) in [
        (DPR_FRONT_END, 0, vec![]),
        (DPR_FRONT_END, 1, vec![(LateReadable, 1)]),
        (HORUS_FRONT_END, 0, vec![(LateReadable, 1)]),
    ] {
        let mut plan = Plan::new(3, 40);
        let number = plan.showing(200);
        let ended = plan.publications[number].at - TO_FRESH;
        plan.publications[number].at += 500_000;
        let started = plan.upstream.iter().find_map(|event| match event.what {
            What::Heard { started, .. } if event.at == ended => Some(started),
            _ => None,
        });
        let until = started.unwrap() - sooner;
        let mut log = plan.log();
        insert(&mut log, until - MS, injected(kind, until));
        assert_eq!(found(&log), violations, "{kind:?} {sooner}");
    }
}

/// The disturbed bit of the receive buffers may be in the frame's LEN. The DPR may then read the whole frame after its
/// end.
#[test]
fn a_hit_bit_allows_the_latency_of_storing_a_frame_whole() {
    for gps in [1, 3] {
        for (kind, after, violations) in [
            (RECEIVE_BIT, bounds::STORE_AND_FORWARD, vec![]),
            (RECEIVE_BIT, bounds::STORE_AND_FORWARD + 1, vec![(LateReadable, 1)]),
            (IMAGE_BIT, bounds::LAST_BIT_TO_READABLE + 1, vec![(LateReadable, 1)]),
        ] {
            let mut plan = Plan::new(gps, 40);
            let number = plan.showing(200);
            let ended = plan.publications[number].at - TO_FRESH;
            plan.publications[number].at = ended + after;
            plan.selects.retain(|selected| !(ended - MS..ended + MS).contains(selected));
            let mut log = plan.log();
            insert(&mut log, ended - 10 * MS, injected(kind, ended + MS));
            assert_eq!(found(&log), violations, "{gps} receivers, {kind:?}, {after} ns");
        }
    }
}

#[test]
fn a_frame_that_may_be_missed_is_timed_from_its_repetition() {
    for (fault, late, violations) in [
        (Some(DPR_FRONT_END), 0, vec![]),
        (Some(DPR_FRONT_END), 1, vec![(LateReadable, 1)]),
        (Some(HORUS_FRONT_END), 0, vec![(LateReadable, 1)]),
        (None, 0, vec![(LateReadable, 1)]),
    ] {
        let mut plan = Plan::new(3, 40);
        let number = plan.showing(200);
        let ended = plan.publications[number].at - TO_FRESH;
        let first = plan.upstream.iter().find(|event| event.at == ended && matches!(event.what, What::Heard { .. }));
        let mut again = first.unwrap().clone();
        let What::Heard { started, .. } = &mut again.what else { unreachable!("a frame that was heard") };
        // The front end's fault ends just before the frame, so the front end is being brought up while the frame
        // arrives.
        let until = *started - 1_000;
        *started += 850_000;
        again.at += 850_000;
        plan.publications[number].at = again.at + bounds::LAST_BIT_TO_READABLE + late;
        let mut log = plan.log();
        insert(&mut log, again.at, again.what);
        if let Some(fault) = fault {
            insert(&mut log, until - MS, injected(fault, until));
        }
        assert_eq!(found(&log), violations, "{fault:?} {late}");
    }
}

#[test]
fn a_frame_still_in_a_failing_front_end_may_be_late() {
    for gps in [3, 5] {
        for (kind, after, violations) in [
            (DPR_FRONT_END, 359_999, vec![]),
            (DPR_FRONT_END, 360_000, vec![(LateReadable, 1)]),
            (HORUS_FRONT_END, 359_999, vec![(LateReadable, 1)]),
        ] {
            let mut plan = Plan::new(gps, 40);
            let number = plan.showing(200);
            let ended = plan.publications[number].at - TO_FRESH;
            plan.publications[number].at += 3 * MS;
            let mut log = plan.log();
            insert(&mut log, ended + after, injected(kind, ended + after));
            assert_eq!(found(&log), violations, "{gps} receivers, {kind:?} {after}");
        }
    }
}

#[test]
fn a_sample_dates_from_the_tick_just_before_its_first_frame() {
    let cycle = FIRST_TICK + 19 * bounds::CYCLE;
    let started = |plan: &Plan, from: u64| {
        plan.upstream.iter().find_map(|event| match event.what {
            What::Sent { started, .. } if event.at > from => Some(started),
            _ => None,
        })
    };
    let samples = |plan: &Plan| judged(&plan.log()).figures.sample_to_readable;
    let mut plan = Plan::new(3, 40);
    let number = plan.showing(200);
    let later = 5_200_000;
    for event in plan.upstream.iter_mut().filter(|event| (cycle + 1..cycle + bounds::CYCLE).contains(&event.at)) {
        event.at += later;
        if let What::Sent { started, .. } | What::Heard { started, .. } = &mut event.what {
            *started += later;
        }
    }
    plan.publications[number].at += later;
    let after = plan.publications[number].at - cycle;
    assert!(after > bounds::SAMPLE_TO_READABLE);
    assert_eq!(samples(&plan).unwrap().max, after);
    assert!(found(&plan.log()).contains(&(LateSample, 1)));
    for (less, measured) in [(0, false), (1, true)] {
        let mut plan = Plan::new(3, 40);
        let began = started(&plan, cycle).unwrap();
        plan.upstream.retain(|event| event.what != What::Tick || event.at == cycle);
        for event in plan.upstream.iter_mut().filter(|event| event.what == What::Tick) {
            event.at = began - bounds::CYCLE + less;
        }
        plan.upstream.sort_by_key(|event| event.at);
        let longest = samples(&plan).map_or(0, |samples| samples.max);
        assert_eq!(longest > bounds::CYCLE, measured, "{less}: {longest}");
    }
    for (after, measured) in [(0, true), (1, false)] {
        let mut plan = Plan::new(5, 20);
        let began = started(&plan, cycle).unwrap();
        plan.upstream.retain(|event| event.what != What::Tick || event.at == cycle);
        for event in plan.upstream.iter_mut().filter(|event| event.what == What::Tick) {
            event.at = began + after;
        }
        plan.upstream.sort_by_key(|event| event.at);
        assert_eq!(samples(&plan).is_some(), measured, "{after}");
    }
}

#[test]
fn a_cycle_awaiting_its_lost_second_frame_is_not_late() {
    let mut plan = Plan::new(5, 40);
    let number = plan.showing(200);
    let ended = plan.publications[number].at - TO_FRESH;
    plan.upstream.retain(|event| event.at != ended || !matches!(event.what, What::Heard { .. }));
    let mut image = plan.publications[number].image.clone();
    image[216..].fill(0);
    plan.publications[number] = Publication { at: ended + 4 * MS, image };
    let ours = [LateSample, LateReadable, Torn, Damaged, FreshMissing, FreshNotNew];
    assert!(!judged(&plan.log()).kinds().any(|kind| ours.contains(&kind)));
}

#[test]
fn a_possibly_missed_second_frame_allows_a_late_cycle() {
    let allowed = bounds::STORE_AND_FORWARD + bounds::SECOND_FRAME;
    for (hit, after, violations) in [
        (true, allowed, vec![]),
        (true, allowed + 1, vec![(LateReadable, 1)]),
        (false, bounds::LAST_BIT_TO_READABLE + 1, vec![(LateReadable, 1)]),
    ] {
        let mut plan = Plan::new(5, 40);
        let number = plan.showing(200);
        let ended = plan.publications[number].at - TO_FRESH;
        plan.publications[number].at = ended + after;
        let mut log = plan.log();
        if hit {
            insert(&mut log, ended - 10 * MS, injected(RECEIVE_BIT, ended + MS));
        }
        let late: Vec<_> = found(&log).into_iter().filter(|(violation, _)| *violation == LateReadable).collect();
        assert_eq!(late, violations, "{hit} {after}");
    }
}
