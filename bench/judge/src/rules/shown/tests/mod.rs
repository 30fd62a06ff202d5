mod hang;
mod limits;

use super::synthetic::{Air, Image, MS, Run, US, kinds};
use crate::disturbance::Memory;
use crate::testing::{DPR_FRONT_END, HORUS_FRONT_END, in_order, injected};
use crate::{Board, Disturbance, Event, Violation, What, judge};

const RECEIVERS: [usize; 3] = [1, 3, 5];

#[test]
fn a_flawless_run_breaks_nothing() {
    for n in RECEIVERS {
        let verdict = Run::new(n).assert_flawless();
        // The first three of 40 cycles find the sequence and are not shown.
        assert_eq!(verdict.figures.valid_cycles, 37, "{n} receivers");
        assert_eq!(verdict.figures.faults.invalid_shown_valid, 0);
    }
}

#[test]
fn a_correct_dpr_breaks_no_rule_whatever_happens_on_the_air() {
    for n in RECEIVERS {
        for frame in 0..if n == 5 { 2 } else { 1 } {
            let objects = if n < 5 { 0..=n } else { 3 * frame..=3 * frame + 2 };
            let hits = [
                Air::Lost,
                Air::Cut,
                Air::Hit(vec![*objects.start()]),
                Air::Hit(objects.collect()),
                Air::Delayed(400 * US),
                Air::Delayed(1_800 * US),
                Air::Delayed(2_690 * US),
                Air::Delayed(2_700 * US),
                Air::Delayed(2_710 * US),
                Air::Delayed(3_500 * US),
                Air::Delayed(6_000 * US),
                Air::Delayed(54_000 * US),
                Air::Repeated(4_100 * US),
                Air::Repeated(5_300 * US),
                Air::Repeated(15_300 * US),
                Air::Repeated(95_300 * US),
            ];
            for hit in hits {
                Run::new(n).hit(20, frame, hit.clone()).assert_flawless();
                Run::new(n).hit(20, frame, hit.clone()).hit(22, frame, hit.clone()).assert_flawless();
                Run::new(n).hit_all(20..23, &hit).assert_flawless();
                // The DPR searches for the sequence when the air disturbs the frame.
                Run::new(n).hit_all(9..=35, &Air::Lost).hit(37, frame, hit.clone()).assert_flawless();
            }
        }
    }
}

#[test]
fn a_cycle_must_be_shown_after_at_most_25_missed_ones() {
    for n in RECEIVERS {
        for (missed, shown) in [(25, true), (26, false)] {
            let mut run = Run::new(n).hit_all(20..20 + missed, &Air::Lost);
            run.cycles = 60;
            run.assert_flawless();
            let next = run.timestamp(20 + missed);
            let expected: &[Violation] = if shown { &[Violation::NotShown] } else { &[] };
            assert_eq!(run.broken(hide(next)), expected, "{n} receivers, {missed} missed");
        }
    }
}

#[test]
fn a_restart_of_either_board_breaks_nothing() {
    for n in RECEIVERS {
        let mut run = Run::new(n);
        run.cycles = 80;
        run.horus_starts = vec![30];
        run.assert_flawless();
        run.horus_starts = vec![30, 60];
        run.assert_flawless();
        for since in [0, 3, 5, 7, 9] {
            let mut run = Run::new(n);
            run.cycles = 80;
            run.dpr_start = Some((200 * MS + since * MS, crate::Cause::Pin, profile::ResetReason::Pin));
            run.assert_flawless();
        }
    }
}

#[test]
fn a_frozen_horus_breaks_nothing() {
    for n in RECEIVERS {
        let mut run = Run::new(n);
        run.frozen = vec![20];
        run.assert_flawless();
        run.frozen = (20..28).collect();
        run.assert_flawless();
    }
}

fn hide(timestamp: u32) -> impl Fn(&mut Vec<Image>) {
    move |images| {
        for image in images.iter_mut().filter(|image| image.timestamp() == Some(timestamp)) {
            image.places.iter_mut().for_each(|place| place.fill(0));
        }
    }
}

fn show(run: &Run, at: u64, cycle: u32, objects: impl IntoIterator<Item = usize> + Clone) -> impl Fn(&mut Vec<Image>) {
    let (profile, layout) = (run.profile(cycle), run.layout());
    move |images| {
        let image = images.iter_mut().find(|image| image.at >= at).expect("an image is published");
        for index in objects.clone() {
            image.places[index] = profile[layout.in_profile(index).unwrap()].to_vec();
        }
    }
}

#[test]
fn a_cycle_that_is_published_nowhere_or_without_objects_is_not_shown() {
    for n in RECEIVERS {
        let run = Run::new(n);
        assert_eq!(run.broken(|images| images.retain(|image| image.timestamp() != Some(200))), [Violation::NotShown]);
        let verdict = run.verdict(hide(200));
        assert_eq!(kinds(&verdict), [Violation::NotShown]);
        let not_shown = verdict.violations.iter().find(|broken| broken.violation == Violation::NotShown);
        assert_eq!(not_shown.map(|broken| broken.count), Some(1));
        assert_eq!(verdict.figures.valid_cycles, 36);
    }
}

#[test]
fn a_window_without_the_objects_is_not_asked_for_them() {
    for (length, expected) in [(95, vec![]), (96, vec![Violation::NotShown])] {
        let run = Run { length, ..Run::new(3) };
        run.assert_flawless();
        assert_eq!(run.broken(hide(200)), expected);
    }
}

#[test]
fn a_cycle_must_be_shown_until_the_next_frame_or_deadline() {
    // The only transaction of the run begins `after` ns after the last bit of cycle 20.
    for (after, expected) in [(99_999, false), (100_000, true), (9_999_999, true), (10_000_000, false)] {
        let mut run = Run { cycles: 25, ..Run::new(3) };
        run.only = Some(run.end(20) + after);
        run.assert_flawless();
        let expected: &[Violation] = if expected { &[Violation::NotShown] } else { &[] };
        assert_eq!(run.broken(hide(200)), expected, "{after} ns");
    }
    for (after, expected) in [(12_199_999, true), (12_200_000, false)] {
        let mut run = Run { cycles: 25, ..Run::new(3) }.hit(21, 0, Air::Lost);
        run.only = Some(run.end(20) + after);
        let expected: &[Violation] = if expected { &[Violation::NotShown] } else { &[] };
        assert_eq!(run.broken(hide(200)), expected, "{after} ns");
    }
    // A cycle whose second frame is lost still has to be shown, after the wait for that frame.
    let ready = 3_802_000 + 3_000 + 7_000_000 + 100_000;
    for (after, expected) in [(ready - 1, false), (ready, true)] {
        let mut run = Run { cycles: 25, ..Run::new(5) }.hit(20, 1, Air::Lost);
        run.only = Some(run.tick(20) + after);
        let expected: &[Violation] = if expected { &[Violation::NotShown] } else { &[] };
        assert_eq!(run.broken(hide(200)), expected, "{after} ns");
    }
}

#[test]
fn a_transaction_that_spans_the_next_frames_end_is_judged() {
    let mut run = Run { cycles: 25, ..Run::new(3) };
    run.only = Some(run.end(20) + 9_900 * US);
    assert_eq!(run.broken(hide(200)), [Violation::NotShown]);
    run.assert_flawless();
}

#[test]
fn an_object_that_is_missing_where_its_cycle_is_shown_is_vacant() {
    for n in RECEIVERS {
        let run = Run::new(n);
        for index in 0..=n {
            for with in [0, 0xFF] {
                let vacate = |images: &mut Vec<Image>| {
                    let image = images.iter_mut().find(|image| image.timestamp() == Some(200)).unwrap();
                    image.places[index].fill(with);
                };
                assert_eq!(run.broken(vacate), [Violation::Vacant], "{n} receivers, object {index}");
                // An object that the air has damaged may be missing.
                let hit = run.clone().hit(20, usize::from(n == 5 && index > 2), Air::Hit(vec![index]));
                let verdict = hit.assert_flawless();
                assert_eq!(verdict.figures.valid_cycles, if index == 0 { 36 } else { 37 });
            }
        }
    }
}

#[test]
fn what_is_damaged_is_neither_vacant_nor_not_shown() {
    for n in RECEIVERS {
        for objects in [1..=1, 0..=n] {
            let damage = |images: &mut Vec<Image>| {
                let image = images.iter_mut().find(|image| image.timestamp() == Some(200)).unwrap();
                for index in objects.clone() {
                    image.places[index][30] ^= 1;
                }
            };
            assert_eq!(Run::new(n).broken(damage), []);
        }
    }
}

#[test]
fn an_object_that_horus_never_sent_is_shown_as_valid() {
    for n in RECEIVERS {
        let run = Run::new(n);
        let other = Run { horus_starts: vec![1], ..run.clone() };
        for index in 0..=n {
            let forged = other.profile(20)[run.layout().in_profile(index).unwrap()].to_vec();
            let forge = |images: &mut Vec<Image>| {
                images.iter_mut().find(|image| image.timestamp() == Some(200)).unwrap().places[index] = forged.clone();
            };
            assert_ne!(forged, run.profile(20)[run.layout().in_profile(index).unwrap()]);
            let verdict = run.verdict(forge);
            assert_eq!(kinds(&verdict), [Violation::ShownNeverSent], "{n} receivers, object {index}");
            // Five transactions read the forged object, and each of them counts.
            assert_eq!(verdict.figures.faults.invalid_shown_valid, 5);
        }
    }
}

#[test]
fn a_cycle_outside_the_sequence_may_not_be_shown() {
    for n in RECEIVERS {
        let lost = Run::new(n).hit_all([20], &Air::Lost);
        assert_eq!(lost.broken(show(&lost, lost.tick(21) - US, 20, 0..=n)), [Violation::ShownOutOfSequence]);
        // A step of 31 cycles loses the sequence. Cycles 40 to 42 find it again, so cycle 43 is shown.
        let mut search = Run::new(n).hit_all(10..40, &Air::Lost);
        search.cycles = 60;
        search.assert_flawless();
        for (cycle, never) in [(40, true), (41, true), (42, true), (43, false)] {
            let at = search.end(cycle);
            let broken = search.broken(show(&search, at, cycle, 0..=n));
            assert_eq!(broken == [Violation::ShownOutOfSequence], never, "{n} receivers, {cycle}: {broken:?}");
            assert_eq!(search.broken(hide(10 * cycle)) == [Violation::NotShown], !never);
        }
    }
}

#[test]
fn a_step_is_in_sequence_within_2_5_ms_and_2_percent() {
    for (by, must, never) in [(2_399, true, false), (2_401, false, false), (2_999, false, false), (3_001, false, true)]
    {
        let run = Run::new(3).hit(20, 0, Air::Delayed(by * US));
        run.assert_flawless();
        let shown = run.broken(|images| {
            show(&run, run.end(20) + by * US, 20, 0..=3)(images);
        });
        assert_eq!(shown == [Violation::ShownOutOfSequence], never, "{by}: {shown:?}");
        assert_eq!(run.broken(hide(200)) == [Violation::NotShown], must, "{by}");
    }
}

#[test]
fn a_repeated_frame_that_is_shown_again_is_out_of_sequence() {
    for n in RECEIVERS {
        for frame in 0..if n == 5 { 2 } else { 1 } {
            let run = Run::new(n).hit_all(21..24, &Air::Lost).hit(20, frame, Air::Repeated(12 * MS));
            run.assert_flawless();
            let objects = if n < 5 { 0..=n } else { 3 * frame..=3 * frame + 2 };
            let profile = run.profile(20);
            // Images still show cycle 20 after its repetition, or after a missing frame.
            let again = |images: &mut Vec<Image>| {
                for image in images.iter_mut().filter(|it| (run.end(20) + 8 * MS..run.end(24)).contains(&it.at)) {
                    for index in objects.clone() {
                        image.places[index] = profile[run.layout().in_profile(index).unwrap()].to_vec();
                    }
                }
            };
            assert_eq!(run.broken(again), [Violation::ShownOutOfSequence], "{n} receivers, frame {frame}");
        }
    }
}

#[test]
fn data_are_stale_past_the_deadline_and_expired_past_25_ms() {
    for n in RECEIVERS {
        let stay = |from: u64, to: u64| {
            move |images: &mut Vec<Image>| {
                images.retain(|image| image.timestamp().is_some() || !(from..to).contains(&image.at));
                for image in images.iter_mut() {
                    image.expires = to;
                }
            }
        };
        let run = Run::new(n).hit_all([20], &Air::Lost);
        let verdict = run.verdict(stay(run.end(19), run.end(21)));
        assert_eq!(kinds(&verdict), [Violation::ShownStale], "{n} receivers");
        assert_eq!(verdict.violations.iter().find(|it| it.violation == Violation::ShownStale).unwrap().count, 1);
        assert!(verdict.figures.faults.invalid_shown_valid >= 3);
        let run = Run::new(n).hit_all(20..24, &Air::Lost);
        assert_eq!(run.broken(stay(run.end(19), run.end(24))), [Violation::ShownExpired], "{n} receivers");
        // The air loses all frames for longer than the judge keeps frames.
        let mut run = Run::new(n).hit_all(20..300, &Air::Lost);
        run.cycles = 310;
        assert_eq!(run.broken(stay(run.end(19), run.end(300))), [Violation::ShownExpired], "{n} receivers");
    }
}

#[test]
fn the_limits_of_stale_and_expired() {
    for (after, clock, expected) in [
        (12_900_000, "fast", None),
        (12_900_001, "fast", Some(Violation::ShownStale)),
        (12_900_001, "pessimistic", None),
        (13_500_000, "pessimistic", None),
        (13_500_001, "pessimistic", Some(Violation::ShownStale)),
        (25_400_000, "fast", Some(Violation::ShownStale)),
        (25_400_001, "fast", Some(Violation::ShownExpired)),
        (26_000_000, "pessimistic", Some(Violation::ShownStale)),
        (26_000_001, "pessimistic", Some(Violation::ShownExpired)),
    ] {
        let mut run = Run::new(3).hit_all(20..30, &Air::Lost);
        run.clock = clock;
        run.only = Some(run.end(19) + after);
        let stay = |images: &mut Vec<Image>| {
            images.retain(|image| image.timestamp().is_some());
            images.iter_mut().for_each(|image| image.expires = u64::MAX);
        };
        assert_eq!(run.broken(stay), Vec::from_iter(expected), "{after} ns, {clock}");
    }
}

#[test]
fn an_older_image_after_a_younger_one_is_a_regression() {
    for n in RECEIVERS {
        let run = Run::new(n);
        let again = |images: &mut Vec<Image>| {
            let place = images.iter().position(|image| image.timestamp() == Some(200)).unwrap();
            let mut old = images[place - 1].clone();
            assert_eq!(old.timestamp(), Some(190));
            old.at = images[place].at + 3 * MS;
            images.insert(place + 1, old);
        };
        assert_eq!(run.broken(again), [Violation::Regression], "{n} receivers");
        assert_eq!(run.verdict(again).figures.faults.invalid_shown_valid, 0);
    }
}

#[test]
fn a_dpr_front_end_without_supply_excuses_missing_objects() {
    let fault = |kind: Disturbance, at, until| Event { at, what: injected(kind, until) };
    for (kind, at, asked) in [
        (DPR_FRONT_END, 200 * MS, false),
        (HORUS_FRONT_END, 200 * MS, true),
        (Disturbance::Memory { board: Board::Dpr, memory: Memory::Ram }, 200 * MS, true),
        (Disturbance::Code { board: Board::Dpr }, 200 * MS, true),
        (Disturbance::Air, 200 * MS, true),
    ] {
        for (cycle, asked) in [(20, asked), (45, true), (80, true)] {
            let mut run = Run { cycles: 90, ..Run::new(3) };
            run.extra.push(fault(kind, at, at + 3 * MS));
            run.assert_flawless();
            let expected: &[Violation] = if asked { &[Violation::NotShown] } else { &[] };
            assert_eq!(run.broken(hide(10 * cycle)), expected, "{kind:?}, {cycle}");
        }
    }
}

#[test]
fn a_listener_that_has_just_seen_the_carrier_may_miss_frames() {
    let mut run = Run { cycles: 60, ..Run::new(3) };
    let on = run.tick(20) - 3 * MS;
    run.extra.push(Event { at: run.tick(20) - 4 * MS, what: What::FieldHeard { on: false } });
    run.extra.push(Event { at: on, what: What::FieldHeard { on: true } });
    run.assert_flawless();
    let missed = run.clone().hit_all(20..25, &Air::Lost);
    // The log says that the frames of cycles 20 to 24 reached the antenna, but the DPR has received none of them.
    let mut log = missed.log(|_| {});
    let there = run.log(|_| {}).events.into_iter().filter(|event| matches!(event.what, What::Heard { .. }));
    log.events.retain(|event| !matches!(event.what, What::Heard { .. }));
    log.events.extend(there);
    in_order(&mut log.events);
    assert_eq!(kinds(&judge(&log)), []);
}

#[test]
fn recovery_counts_from_the_end_of_the_last_cause() {
    let fault = |at, until| Event { at, what: injected(Disturbance::Air, until) };
    let with = |extra: Vec<Event>, lost: std::ops::Range<u32>| {
        let run = Run { cycles: 120, extra, ..Run::new(3) }.hit_all(lost, &Air::Lost);
        run.verdict(|_| {}).figures.faults.max_recovery_cycles
    };
    assert_eq!(with(vec![], 0..0), None);
    assert_eq!(with(vec![fault(200 * MS, 220 * MS)], 0..0), Some(1));
    assert_eq!(with(vec![fault(200 * MS, 216 * MS)], 0..0), Some(1));
    assert_eq!(with(vec![fault(200 * MS, 215_999 * US)], 0..0), Some(2));
    assert_eq!(with(vec![fault(200 * MS, 220_400 * US)], 0..0), Some(2));
    assert_eq!(with(vec![fault(200 * MS, 220 * MS)], 20..25), Some(6));
    assert_eq!(with(vec![fault(200 * MS, 270 * MS), fault(220 * MS, 230 * MS)], 20..25), Some(1));
    assert_eq!(with(vec![fault(220 * MS, 220 * MS), fault(260 * MS, 260 * MS)], 20..25), Some(2));
    // A fault that ends in the last 400 ms of the run, or that never ends, is not measured.
    let end = Run { cycles: 120, ..Run::new(3) }.tick(121) + 300 * MS;
    assert_eq!(with(vec![fault(end - 400 * MS, end - 400 * MS)], 0..0), Some(1));
    assert_eq!(with(vec![fault(end - 400 * MS + 1, end - 400 * MS + 1)], 0..0), None);
    assert_eq!(with(vec![fault(200 * MS, u64::MAX)], 0..0), None);
    assert_eq!(with(vec![fault(200 * MS, u64::MAX), fault(210 * MS, 220 * MS)], 0..0), Some(1));
    // If the link does not recover, the time until the end of the run counts as the recovery.
    assert_eq!(with(vec![fault(250 * MS, 250 * MS)], 20..121), Some((end - 250 * MS).div_ceil(10 * MS)));
}

#[test]
fn every_start_but_a_boards_first_counts_as_a_cause() {
    let power = |at, board, on| Event { at, what: What::Power { board, on } };
    let with = |extra: Vec<Event>| {
        let run = Run { cycles: 120, extra, ..Run::new(3) };
        run.verdict(|_| {}).figures.faults.max_recovery_cycles
    };
    assert_eq!(with(vec![power(0, Board::Dpr, true)]), None);
    let off = power(200 * MS, Board::Horus, false);
    // After the supply has come back, HORUS's first frame is that of cycle 22.
    assert_eq!(with(vec![off.clone(), power(235 * MS, Board::Horus, true)]), Some(2));
    assert_eq!(with(vec![off]), None, "it never comes back");
    let reset = What::Reset { board: Board::Horus, cause: crate::Cause::Pin, asked: true };
    assert_eq!(with(vec![Event { at: 229 * MS, what: reset }]), Some(1));
}

#[test]
fn the_end_of_the_last_valid_position_is_reported() {
    let mut run = Run::new(3);
    let end = run.end(40);
    // The position can be read until the deadline's image is published, 12.55 ms after the last bit.
    let invalid = run.assert_flawless().figures.invalid_since_ns.unwrap();
    assert!((end + 12_550 * US..end + 14_550 * US).contains(&invalid), "{invalid}");
    run.only = Some(end + MS);
    assert_eq!(run.assert_flawless().figures.invalid_since_ns, None);
    run.only = Some(40 * MS);
    assert_eq!(run.assert_flawless().figures.invalid_since_ns, None, "there never was one");
}

#[test]
fn whatever_happens_to_any_frames_a_dpr_that_does_right_breaks_nothing() {
    // An earlier version of the judge reported false violations with the first of these seeds.
    for seed in [27, 480, 552, 2148, 2192, 2207, 2261].into_iter().chain(0..24_u64) {
        // The generator is linear congruential (Knuth, MMIX).
        let mut state = seed;
        let mut draw = |below: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) % below
        };
        let n = RECEIVERS[draw(3) as usize];
        let mut run = Run { cycles: 120, ..Run::new(n) };
        let one_in = 2 + draw(12);
        for cycle in 1..=run.cycles {
            for frame in 0..if n == 5 { 2 } else { 1 } {
                if draw(one_in) > 0 {
                    continue;
                }
                let hit = match draw(6) {
                    0 => Air::Lost,
                    1 => Air::Cut,
                    2 => Air::Hit((0..=n).filter(|_| draw(2) == 0).collect()),
                    3 => Air::Delayed(draw(3_500_000)),
                    4 => Air::Delayed(draw(60_000_000)),
                    _ => Air::Repeated(draw(60_000_000)),
                };
                run = run.hit(cycle, frame, hit);
            }
        }
        if draw(3) == 0 {
            run.horus_starts = vec![20 + draw(80) as u32];
        }
        if draw(3) == 0 {
            run.frozen = (0..draw(4)).map(|_| 20 + draw(80) as u32).collect();
        }
        if draw(3) == 0 {
            let at = 100 * MS + draw(1_000_000_000);
            run.dpr_start = Some((at, crate::Cause::Pin, profile::ResetReason::Pin));
        }
        run.control = 1_100 * US + draw(4_000_000);
        println!("seed {seed}");
        run.assert_flawless();
    }
}
