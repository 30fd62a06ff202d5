use profile::{LinkStatusBits, LinkValues, ResetReason};

use crate::disturbance::{Harm, Memory};
use crate::rules::shown::synthetic::{Air, Image, MS, Run, US};
use crate::testing::{DPR_FRONT_END, HORUS_FRONT_END, IMAGE_BIT, RECEIVE_BIT, in_order, injected};
use crate::{Board, Cause, Disturbance, Event, Violation, What, bounds};

const RECEIVERS: [usize; 3] = [1, 3, 5];

fn within(times: std::ops::Range<u64>, change: impl Fn(&mut LinkValues)) -> impl Fn(&mut Vec<Image>) {
    move |images| {
        let mut changed = 0;
        for image in images.iter_mut().filter(|image| times.contains(&image.at)) {
            change(&mut image.link);
            changed += 1;
        }
        assert!(changed > 0, "no image is published in {times:?}");
    }
}

fn of(run: &Run, cycle: u32, change: impl Fn(&mut LinkValues)) -> impl Fn(&mut Vec<Image>) {
    within(run.end(cycle)..run.end(cycle) + MS, change)
}

fn flip(values: &mut LinkValues, bit: u16) {
    values.status = LinkStatusBits::from_bits(values.status.bits() ^ 1 << bit);
}

/// What the judge finds if only this `bit` of the status is wrong, and is set: bits 0 and 1 say that the link is well,
/// the bits of the reset's reason are neither well nor a fault, and the other bits report faults.
fn wrongly_set(bit: u16) -> Violation {
    if matches!(bit, 0 | 1 | 6 | 12..=14) { Violation::LinkFlags } else { Violation::LinkFlagsOver }
}

/// The same if the bit is wrong and not set.
fn wrongly_clear(bit: u16) -> Violation {
    match wrongly_set(bit) {
        Violation::LinkFlags if matches!(bit, 0 | 1) => Violation::LinkFlagsOver,
        _ => Violation::LinkFlags,
    }
}

#[test]
fn an_age_that_is_off_by_more_than_its_bound_is_wrong() {
    for n in RECEIVERS {
        let run = Run::new(n);
        let wrong = |off: i16| match off {
            ..-3 => Some(Violation::LinkAge),
            2.. => Some(Violation::LinkAgeOver),
            _ => None,
        };
        for off in [-4, -2, 0, 1, 2, 30_000] {
            let change = |values: &mut LinkValues| values.age_100us = values.age_100us.wrapping_add_signed(off);
            let expected: Vec<_> = wrong(off).into_iter().collect();
            assert_eq!(run.broken(of(&run, 20, change)), expected, "{n} receivers, {off}");
        }
    }
}

#[test]
fn the_age_is_that_of_the_last_accepted_reported_position() {
    for n in RECEIVERS {
        let newer = |values: &mut LinkValues| values.age_100us -= 100;
        let run = Run::new(n).hit(20, 0, Air::Hit(vec![0]));
        assert_eq!(run.broken(of(&run, 20, newer)), [Violation::LinkAge], "{n} receivers");
        let run = Run::new(n).hit_all(20..28, &Air::Lost);
        assert_eq!(run.broken(within(run.end(25)..run.end(26), newer)), [Violation::LinkAge], "{n} receivers");
    }
}

#[test]
fn an_image_without_objects_has_the_age_of_the_last_sample() {
    for before in [vec![], vec![18]] {
        let run = Run::new(3).hit_all(before.clone(), &Air::Lost).hit_all(20..28, &Air::Lost);
        let older = |values: &mut LinkValues| values.age_100us += 100 + 100 * before.len() as u16;
        assert_eq!(run.broken(within(run.end(25)..run.end(26), older)), [Violation::LinkAgeOver], "{before:?}");
    }
}

#[test]
fn an_image_of_an_older_cycle_is_no_wrong_age() {
    for n in RECEIVERS {
        let run = Run::new(n);
        let broken = run.broken(|images| {
            let older = images.iter().rfind(|image| image.at < run.end(20)).unwrap().places.clone();
            let image = images.iter_mut().find(|image| image.at > run.end(20)).unwrap();
            image.places = older;
            image.link.age_100us += 500;
        });
        assert_eq!(broken, [Violation::NotShown], "{n} receivers");
    }
}

#[test]
fn the_age_is_saturated_until_an_object_is_accepted() {
    let run = Run::new(3);
    let change = |age| move |values: &mut LinkValues| values.age_100us = age;
    assert_eq!(run.broken(within(10 * MS..20 * MS, change(65_534))), [Violation::LinkAge]);
    assert_eq!(run.broken(of(&run, 20, change(u16::MAX))), [Violation::LinkAgeOver]);
    // The age counts up to 6.5535 s and then stays at its greatest value, 65535.
    let mut long = Run::new(3).hit_all(20..700, &Air::Lost);
    long.cycles = 710;
    long.control = 4 * MS;
    long.assert_flawless();
    let late = long.tick(19) + 6_600 * MS..long.tick(19) + 6_700 * MS;
    assert_eq!(long.broken(within(late, change(65_534))), [Violation::LinkAge]);
}

/// The log of a run with the tick of cycle 20 too early by 1 ms. HORUS sends at the usual instant.
fn with_an_early_tick(run: &Run) -> crate::Log {
    let mut log = run.log(|_| {});
    for event in log.events.iter_mut().filter(|event| event.what == What::Tick && event.at == run.tick(20)) {
        event.at -= MS;
    }
    in_order(&mut log.events);
    log
}

#[test]
fn the_age_counts_from_the_tick_and_not_from_the_frame() {
    let mut log = with_an_early_tick(&Run::new(3));
    assert!(crate::judge(&log).kinds().any(|kind| kind == Violation::LinkAge));
    // If the log has no ticks, the judge derives the instant of a sample from its frame.
    log.events.retain(|event| event.what != What::Tick);
    assert!(crate::judge(&log).kinds().all(|kind| kind != Violation::LinkAge));
}

#[test]
fn the_age_counts_from_the_tick_if_only_reported_position_arrives() {
    let run = Run::new(3).hit(20, 0, Air::Hit(vec![1, 2, 3]));
    assert!(crate::judge(&with_an_early_tick(&run)).kinds().any(|kind| kind == Violation::LinkAge));
}

#[test]
fn each_counter_that_is_off_by_one_is_a_violation() {
    let counters: [fn(&mut LinkValues) -> &mut u32; 4] = [
        |values| &mut values.objects_accepted,
        |values| &mut values.objects_rejected,
        |values| &mut values.frames_received,
        |values| &mut values.frames_missed,
    ];
    for n in RECEIVERS {
        for (index, counter) in counters.iter().enumerate() {
            for by in [-1_i32, 1] {
                let change = |values: &mut LinkValues| *counter(values) = counter(values).wrapping_add_signed(by);
                let run = Run::new(n).hit_all(10..12, &Air::Lost);
                let once = run.verdict(of(&run, 25, change));
                let stays = run.verdict(within(run.end(25)..u64::MAX, change));
                for verdict in [once, stays] {
                    let words: Vec<String> = verdict.violations.iter().map(ToString::to_string).collect();
                    let counters = verdict.violations.iter().find(|it| it.violation == Violation::LinkCounters);
                    assert!(counters.is_some(), "{n} receivers, counter {index} by {by}: {words:?}");
                }
                assert_eq!(run.broken(of(&run, 25, change)), [Violation::LinkCounters]);
            }
        }
    }
}

#[test]
fn counters_that_go_on_wrongly_together_are_wrong() {
    for n in RECEIVERS {
        // In these runs Link-Status counts a damaged object as accepted, or a received frame as missed.
        let run = Run::new(n).hit(20, 0, Air::Hit(vec![1]));
        let change = |values: &mut LinkValues| {
            values.objects_accepted += 1;
            values.objects_rejected -= 1;
        };
        assert_eq!(run.broken(within(run.end(20)..u64::MAX, change)), [Violation::LinkCounters], "{n} receivers");
        let places = if n == 5 { 3 } else { n as u32 + 1 };
        let change = |values: &mut LinkValues| {
            values.objects_accepted -= places;
            values.frames_received -= 1;
            values.frames_missed += 1;
        };
        assert_eq!(run.broken(within(run.end(22)..u64::MAX, change)), [Violation::LinkCounters], "{n} receivers");
    }
}

#[test]
fn counters_that_add_up_and_are_wrong_from_the_start_are_wrong() {
    for n in RECEIVERS {
        let places = if n == 5 { 3 } else { n as u32 + 1 };
        let change = |values: &mut LinkValues| {
            values.objects_rejected += places;
            values.frames_received += 1;
        };
        assert_eq!(Run::new(n).broken(within(0..u64::MAX, change)), [Violation::LinkCounters], "{n} receivers");
    }
}

#[test]
fn a_frame_that_nobody_counts_as_missed_is_wrong() {
    for n in RECEIVERS {
        let frames = if n == 5 { 2 } else { 1 };
        let run = Run::new(n).hit_all([20], &Air::Lost);
        let change = |values: &mut LinkValues| values.frames_missed -= frames;
        assert_eq!(run.broken(within(run.end(21)..u64::MAX, change)), [Violation::LinkCounters], "{n} receivers");
        let run = Run::new(n).hit_all(20..35, &Air::Lost);
        let change = |values: &mut LinkValues| values.frames_missed -= 5 * frames;
        assert_eq!(run.broken(within(run.end(30)..run.end(31), change)), [Violation::LinkCounters], "{n} receivers");
    }
}

#[test]
fn an_image_just_after_the_second_frame_counts_both() {
    let run = Run { length: profile::LinkStatus::SIZE, ..Run::new(5) };
    let first_only = |values: &mut LinkValues| {
        values.objects_accepted -= 3;
        values.frames_received -= 1;
    };
    assert_eq!(run.broken(of(&run, 20, first_only)), [Violation::LinkCounters]);
}

#[test]
fn an_image_just_after_a_frame_may_be_of_a_later_deadline() {
    let without = |delay| {
        let run = Run { length: profile::LinkStatus::SIZE, ..Run::new(3) }.hit(20, 0, Air::Delayed(delay));
        let change = |values: &mut LinkValues| {
            values.objects_accepted -= 4;
            values.frames_received -= 1;
            values.age_100us += 100;
        };
        run.broken(within(run.end(20) + delay..run.end(20) + delay + 200 * US, change))
    };
    assert!(without(2_200 * US - 1).contains(&Violation::LinkCounters));
    assert!(!without(2_200 * US).contains(&Violation::LinkCounters));
    // The deadline has just passed.
    Run::new(3).hit(20, 0, Air::Delayed(2_505 * US)).assert_flawless();
}

#[test]
fn each_flag_that_contradicts_what_was_heard_and_shown_is_wrong() {
    for n in RECEIVERS {
        let run = Run::new(n);
        for bit in [0, 1, 2, 3, 4, 5, 8, 9, 10, 6, 12, 13, 14, 15] {
            let broken = run.broken(of(&run, 20, |values| flip(values, bit)));
            let wrong = if matches!(bit, 0 | 1) { wrongly_clear(bit) } else { wrongly_set(bit) };
            assert_eq!(broken, [wrong], "{n} receivers, bit {bit}");
        }
        // Bit 7 of Link-Status says that an uplink was rejected, which another rule judges.
        assert_eq!(run.broken(of(&run, 20, |values| flip(values, 7))), []);
        let run = Run::new(n).hit_all(20..25, &Air::Lost);
        for bit in [0, 1, 2, 3, 8, 9] {
            let broken = run.broken(within(run.end(22)..run.end(23), |values| flip(values, bit)));
            assert_eq!(broken, [wrongly_set(bit)], "{n} receivers, bit {bit}");
        }
        let mut run = Run::new(n).hit_all(20..58, &Air::Lost);
        run.cycles = 70;
        for (wrong, cycle) in [(wrongly_set(8), 44), (wrongly_clear(8), 48)] {
            let broken = run.broken(within(run.end(cycle)..run.end(cycle + 1), |values| flip(values, 8)));
            assert_eq!(broken, [wrong], "{n} receivers, cycle {cycle}");
        }
    }
}

#[test]
fn a_field_that_is_away_must_be_told_soon() {
    let mut run = Run::new(3).hit_all(20..35, &Air::Lost);
    run.cycles = 60;
    let (off, on) = (run.tick(20) - MS, run.tick(34));
    run.extra = [(off, false), (on, true)].map(|(at, on)| Event { at, what: What::FieldHeard { on } }).into();
    let tells = |values: &mut LinkValues| values.status = values.status.with_no_field(true);
    assert_eq!(run.broken(|_| ()), [Violation::LinkFlags], "never told");
    assert_eq!(run.broken(within(off + 20 * MS..on + 20 * MS, tells)), []);
    assert_eq!(run.broken(within(off + 45 * MS..on + 20 * MS, tells)), [Violation::LinkFlags], "late");
    assert_eq!(run.broken(within(off + 20 * MS..on + 75 * MS, tells)), [Violation::LinkFlagsOver], "too long");
}

#[test]
fn a_field_that_goes_away_twice_must_be_told_as_soon() {
    let mut run = Run::new(3).hit_all(20..35, &Air::Lost);
    let off = run.tick(20) - MS;
    let heard = |at, on| Event { at, what: What::FieldHeard { on } };
    run.extra = vec![heard(off, false), heard(off + 25 * MS, false), heard(run.tick(34), true)];
    let tells = |values: &mut LinkValues| values.status = values.status.with_no_field(true);
    assert_eq!(run.broken(within(off + 45 * MS..run.tick(36), tells)), [Violation::LinkFlags]);
}

#[test]
fn no_field_may_be_told_until_130_ms_after_the_start() {
    let run = Run { control: MS, ..Run::new(1) };
    let tells = |at| {
        run.broken(move |images: &mut Vec<Image>| {
            let image = images.iter_mut().find(|image| image.at > 116 * MS).unwrap();
            image.at = at;
            image.link.status = image.link.status.with_no_field(true);
        })
    };
    let over = |at| tells(at).contains(&Violation::LinkFlagsOver);
    assert_eq!((over(130 * MS - 1), over(130 * MS)), (false, true));
}

#[test]
fn no_field_may_be_told_until_30_ms_after_a_recovery() {
    let over = 220 * MS + bounds::FRONT_END_RECOVERY + bounds::FIELD_TOLD;
    let tells = |at| {
        let mut run = Run { cycles: 60, control: MS, ..Run::new(1) };
        run.extra.push(Event { at: 200 * MS, what: injected(DPR_FRONT_END, 220 * MS) });
        run.broken(move |images: &mut Vec<Image>| {
            let image = images.iter_mut().find(|image| image.at + 10 * MS > at).unwrap();
            image.at = at;
            image.link.status = image.link.status.with_no_field(true);
        })
        .contains(&Violation::LinkFlagsOver)
    };
    assert_eq!((tells(over - 1), tells(over)), (false, true));
}

#[test]
fn no_field_may_be_told_until_a_frame_was_certainly_received() {
    let broken = |heard: std::ops::Range<u32>, told: std::ops::Range<u64>| {
        let lost = (20..60).filter(|cycle| !heard.contains(cycle));
        let mut run = Run { cycles: 60, ..Run::new(3) }.hit_all(lost, &Air::Lost);
        let on = run.tick(34);
        run.extra =
            [(run.tick(20) - MS, false), (on, true)].map(|(at, on)| Event { at, what: What::FieldHeard { on } }).into();
        let tells = |values: &mut LinkValues| values.status = values.status.with_no_field(true);
        let from = run.tick(20) + 20 * MS;
        run.broken(|images| {
            within(from..on + told.start, tells)(images);
            within(on + told.start..on + told.end, tells)(images);
        })
    };
    assert_eq!(broken(50..60, 40 * MS..150 * MS), [], "no frame");
    assert_eq!(broken(35..38, 40 * MS..150 * MS), [], "the listener may not have been armed");
    assert_eq!(broken(50..60, 40 * MS..180 * MS), [Violation::LinkFlagsOver], "frames");
}

#[test]
fn the_flags_of_a_damaged_cycle_say_so() {
    for n in RECEIVERS {
        let run = Run::new(n).hit(20, 0, Air::Hit(vec![1]));
        let flipped = |bit| run.broken(of(&run, 20, |values| flip(values, bit)));
        assert_eq!(flipped(0), [wrongly_clear(0)], "the link is up");
        assert_eq!(flipped(1), [wrongly_set(1)], "an object is missing");
    }
}

#[test]
fn both_frames_that_may_be_received_may_have_all_objects() {
    // The transactions read Link-Status alone, so that no object tells what the DPR has received.
    let mut run = Run { length: profile::LinkStatus::SIZE, ..Run::new(5) };
    let heard = |before, on| Event { at: run.tick(20) - before, what: What::FieldHeard { on } };
    run.extra = vec![heard(4 * MS, false), heard(3 * MS, true)];
    run.assert_flawless();
}

/// What the judge finds of the flags of a Link-Status that is read alone, with these `bits`, if its image is published
/// the time `after` the end of the last frame: frame `number` of cycle 19.
fn after_frame(number: usize, run: Run, after: u64, bits: u16) -> Option<Violation> {
    let run = Run { length: profile::LinkStatus::SIZE, control: MS / 2, ..run }.hit_all(20..40, &Air::Lost);
    let end = run.tick(19) + crate::expectation::age_at_end(run.layout(), number) + 3 * US;
    let broken = run.broken(|images| {
        let image = images.iter_mut().find(|image| image.at > end + MS).unwrap();
        image.at = end + after;
        image.link.status = LinkStatusBits::from_bits(image.link.status.bits() & !0b11 | bits);
    });
    broken.into_iter().find(|kind| matches!(kind, Violation::LinkFlags | Violation::LinkFlagsOver))
}

#[test]
fn the_link_is_up_until_the_deadline_of_the_next_frame() {
    let (up, down) = (0b11, 0);
    for (after, told, wrong) in [
        (12_150 * US, up, None),
        (12_200 * US, down, Some(Violation::LinkFlagsOver)),
        (12_200 * US + 1, down, None),
        (12_900 * US, up, None),
        (12_900 * US + 1, up, Some(Violation::LinkFlags)),
        (12_900 * US + 1, down, None),
    ] {
        assert_eq!(after_frame(0, Run::new(3), after, told), wrong, "{after} ns, {told}");
    }
}

#[test]
fn a_first_frame_must_be_told_when_the_second_is_overdue() {
    let run = Run::new(5).hit(19, 1, Air::Lost);
    let down = |after| after_frame(0, run.clone(), after, 0);
    assert_eq!((down(7_300 * US - 1), down(7_300 * US)), (None, Some(Violation::LinkFlagsOver)));
}

#[test]
fn what_an_image_lacks_is_not_also_a_wrong_flag() {
    // If an image lacks its objects, its flags may describe either the image or the frames that the DPR received.
    for bits in [LinkStatusBits::new().with_link_up(true).with_all_accepted(true), LinkStatusBits::new()] {
        let run = Run::new(3);
        let broken = run.broken(|images| {
            let image = images.iter_mut().find(|image| image.timestamp() == Some(200)).unwrap();
            image.places.iter_mut().for_each(|place| place.fill(0));
            image.link.status = bits;
        });
        assert_eq!(broken, [Violation::NotShown]);
    }
}

/// What the judge finds of an image that may be of cycle 19 or of cycle 22: it has no objects, the cycles between are
/// lost, and cycle 22 has just arrived.
fn of_cycle_19_or_22(run: Run, change: impl Fn(&mut LinkValues)) -> Vec<Violation> {
    let run = run.hit_all(20..22, &Air::Lost);
    let mut broken = run.broken(|images| {
        let image = images.iter_mut().find(|image| image.at > run.end(22)).unwrap();
        image.places.iter_mut().for_each(|place| place.fill(0));
        image.link.status = LinkStatusBits::from_bits(image.link.status.bits() & !0b11);
        change(&mut image.link);
    });
    broken.retain(|kind| (Violation::LinkAge..=Violation::LinkTime).contains(kind));
    broken
}

#[test]
fn an_age_is_too_great_beside_each_possible_cycle() {
    // The age is 5 ms or 35 ms.
    for (told, wrong) in [
        (30, Some(Violation::LinkAge)),
        (50, None),
        (200, Some(Violation::LinkAge)),
        (349, None),
        (400, Some(Violation::LinkAgeOver)),
    ] {
        let expected: Vec<_> = wrong.into_iter().collect();
        assert_eq!(of_cycle_19_or_22(Run::new(3), |values| values.age_100us = told), expected, "{told}");
    }
}

#[test]
fn the_link_looks_worse_only_beside_each_cycle_that_may_be_shown() {
    let fault = |values: &mut LinkValues| values.status = values.status.with_front_end_fault(true);
    assert_eq!(of_cycle_19_or_22(Run::new(3), fault), [Violation::LinkFlagsOver]);
    // Cycle 19 is frozen, which the image denies.
    let run = Run { frozen: vec![19], ..Run::new(3) };
    let denies = |values: &mut LinkValues| values.status = values.status.with_horus_frozen(false);
    assert_eq!(of_cycle_19_or_22(run.clone(), denies), []);
    let both = |values: &mut LinkValues| {
        denies(values);
        fault(values);
    };
    assert_eq!(of_cycle_19_or_22(run, both), [Violation::LinkFlags]);
}

#[test]
fn a_frozen_and_a_restarted_horus_are_told() {
    for n in RECEIVERS {
        let mut run = Run::new(n);
        run.frozen = vec![20];
        assert_eq!(run.broken(of(&run, 20, |values| flip(values, 2))), [wrongly_clear(2)], "{n} receivers");
        assert_eq!(run.broken(of(&run, 21, |values| flip(values, 2))), [wrongly_set(2)], "{n} receivers");
        let run = Run { cycles: 150, horus_starts: vec![20], ..Run::new(n) };
        run.assert_flawless();
        // Link-Status shows for one second that HORUS has restarted.
        for (cycle, wrong) in
            [(21, wrongly_clear(3)), (119, wrongly_clear(3)), (121, wrongly_set(3)), (140, wrongly_set(3))]
        {
            let broken = run.broken(of(&run, cycle, |values| flip(values, 3)));
            assert_eq!(broken, [wrong], "{n} receivers, {cycle}");
        }
    }
}

#[test]
fn a_restart_is_told_for_a_second() {
    let run = Run { cycles: 140, horus_starts: vec![20], control: MS / 2, ..Run::new(3) }.hit_all(24..=140, &Air::Lost);
    let broken = |after: u64, told: bool| {
        run.broken(|images| {
            let first = images.iter().position(|image| image.link.status.horus_restarted()).unwrap();
            let frame = (20..24).map(|cycle| run.end(cycle)).rfind(|end| *end < images[first].at).unwrap();
            let image = images.iter_mut().find(|image| image.at > frame + 990 * MS).unwrap();
            image.at = frame + after;
            image.link.status = image.link.status.with_horus_restarted(told);
        })
    };
    // The judge accepts either value within 2 ms.
    for (after, told, wrong) in [
        (998 * MS - 1, false, Some(Violation::LinkFlags)),
        (998 * MS, false, None),
        (1_002 * MS - 1, true, None),
        (1_002 * MS, true, Some(Violation::LinkFlagsOver)),
    ] {
        let flags = |kind: &Violation| matches!(kind, Violation::LinkFlags | Violation::LinkFlagsOver);
        assert_eq!(broken(after, told).into_iter().find(flags), wrong, "{after} ns");
    }
}

#[test]
fn a_clock_3_percent_off_is_implausible_but_1_percent_is_not() {
    for (period, implausible) in [(9_700 * US, true), (9_900 * US, false), (10_100 * US, false), (10_300 * US, true)] {
        let run = Run { cycles: 450, control: 4 * MS, period, ..Run::new(3) };
        run.assert_flawless();
        let told = |images: &mut Vec<Image>| {
            let image = images.iter().find(|image| image.at > run.end(400)).unwrap();
            assert_eq!(image.link.status.horus_clock_implausible(), implausible);
        };
        assert_eq!(run.broken(told), []);
        let wrong = if implausible { wrongly_clear(9) } else { wrongly_set(9) };
        assert_eq!(run.broken(of(&run, 400, |values| flip(values, 9))), [wrong], "{period} ns");
    }
}

#[test]
fn the_reason_of_the_last_reset_is_what_happened() {
    let reasons = [
        (Cause::PowerOn, ResetReason::PowerOn),
        (Cause::BrownOut, ResetReason::BrownOutOrOther),
        (Cause::Pin, ResetReason::Pin),
        (Cause::Watchdog, ResetReason::Watchdog),
        (Cause::Lockup, ResetReason::Lockup),
        (Cause::Software, ResetReason::Software),
    ];
    for (cause, right) in reasons {
        for told in reasons.map(|(_, reason)| reason) {
            let run = Run { cycles: 60, dpr_start: Some((200 * MS, cause, told)), ..Run::new(1) };
            let power = [ResetReason::PowerOn, ResetReason::BrownOutOrOther];
            let fits = told == right || power.contains(&told) && power.contains(&right);
            let expected: &[Violation] = if fits { &[] } else { &[Violation::LinkFlags] };
            assert_eq!(run.broken(|_| {}), expected, "{cause:?}: {told:?}");
        }
    }
}

#[test]
fn a_fault_flag_is_excused_until_the_dprs_next_start() {
    let memory = |memory| Disturbance::Memory { board: Board::Dpr, memory };
    for (disturbs, may) in [
        (DPR_FRONT_END, None),
        (IMAGE_BIT, Some(4)),
        (RECEIVE_BIT, Some(4)),
        (memory(Memory::Ram), Some(4)),
        (memory(Memory::Flash), Some(10)),
        (memory(Memory::Registers), None),
        (HORUS_FRONT_END, None),
        (Disturbance::Air, None),
    ] {
        for bit in [4, 5, 10] {
            let fault = Event { at: 200 * MS, what: injected(disturbs, 200 * MS) };
            let run = Run { cycles: 120, extra: vec![fault], ..Run::new(3) };
            let set = |run: &Run| run.broken(of(run, 100, |values| flip(values, bit)));
            let expected: &[Violation] = if may == Some(bit) { &[] } else { &[Violation::LinkFlagsOver] };
            assert_eq!(set(&run), expected, "{disturbs:?}, bit {bit}");
            let restarted = Run { dpr_start: Some((400 * MS, Cause::Pin, ResetReason::Pin)), ..run };
            restarted.assert_flawless();
            assert_eq!(set(&restarted), [Violation::LinkFlagsOver], "{disturbs:?}, bit {bit}, restarted");
        }
    }
}

#[test]
fn after_a_front_end_fault_counters_are_compared_from_image_to_image() {
    let fault = Event { at: 200 * MS, what: injected(DPR_FRONT_END, 200 * MS) };
    let run = Run { cycles: 120, extra: vec![fault], ..Run::new(3) };
    let upset = |values: &mut LinkValues| values.objects_accepted ^= 1 << 20;
    assert_eq!(run.broken(within(200 * MS..u64::MAX, upset)), []);
    let missed = |values: &mut LinkValues| values.frames_missed += 1;
    assert_eq!(run.broken(of(&run, 100, missed)), [Violation::LinkCounters]);
    let restarted = Run { dpr_start: Some((400 * MS, Cause::Pin, ResetReason::Pin)), ..run };
    assert_eq!(restarted.broken(within(401 * MS..u64::MAX, upset)), [Violation::LinkCounters]);
}

#[test]
fn a_front_end_fault_excuses_neither_time_nor_reset_reason() {
    let deaf = Disturbance::FrontEnd { board: Board::Dpr, harm: Harm::Deaf };
    let fault = Event { at: 200 * MS, what: injected(deaf, 300 * MS) };
    let run = Run { cycles: 120, extra: vec![fault], ..Run::new(3) };
    for cycle in [25, 35, 100] {
        let early = |values: &mut LinkValues| values.timestamp -= 10;
        assert_eq!(run.broken(of(&run, cycle, early)), [Violation::LinkTime], "{cycle}");
        let pin = |values: &mut LinkValues| values.status = values.status.with_reset_reason(ResetReason::Pin);
        assert_eq!(run.broken(of(&run, cycle, pin)), [Violation::LinkFlags], "{cycle}");
    }
    let upset = |values: &mut LinkValues| values.timestamp ^= 1 << 20;
    assert_eq!(run.broken(within(201 * MS..u64::MAX, upset)), [Violation::LinkTime]);
}

/// Whether the judge finds a wrong flag if the DPR's front end does not answer from 200 to 400 ms, and the image at
/// `at` states `told`.
fn silent_front_end(run: Run, at: u64, told: LinkStatusBits) -> bool {
    let fault = Event { at: 200 * MS, what: injected(DPR_FRONT_END, 400 * MS) };
    let mut run = Run { cycles: 60, control: MS, ..run }.hit_all(18..=60, &Air::Lost);
    run.extra.push(fault);
    let broken = run.broken(|images| {
        for image in images.iter_mut().filter(|image| image.at > 200 * MS) {
            image.link.status = image.link.status.with_front_end_fault(true);
        }
        let image = images.iter_mut().find(|image| image.at + 6 * MS > at).unwrap();
        let reason = image.link.status.reset_reason().unwrap();
        image.at = at;
        image.link.status = told.with_reset_reason(reason).with_unasked_reset(image.link.status.unasked_reset());
    });
    broken.contains(&Violation::LinkFlags)
}

#[test]
fn a_silent_front_end_must_be_told_after_40_ms() {
    let bits = LinkStatusBits::new();
    let wrong = |at| silent_front_end(Run::new(3), at, bits);
    assert_eq!([240 * MS - 1, 240 * MS, 400 * MS - 1, 400 * MS].map(wrong), [false, true, true, false]);
    let told = bits.with_front_end_fault(true);
    let wrong = |told| silent_front_end(Run::new(3), 300 * MS, told);
    assert_eq!(
        [told, told.with_link_up(true), told.with_all_accepted(true), bits].map(wrong),
        [false, true, true, true]
    );
}

#[test]
fn a_silent_front_end_must_be_told_40_ms_after_a_start() {
    let run = Run { dpr_start: Some((210 * MS, Cause::Pin, ResetReason::Pin)), ..Run::new(3) };
    let wrong = |at| silent_front_end(run.clone(), at, LinkStatusBits::new());
    assert_eq!([350 * MS - 1, 350 * MS].map(wrong), [false, true]);
}

#[test]
fn a_dead_task_may_not_tell_of_a_silent_front_end() {
    let dead = Disturbance::DeadTask { board: Board::Dpr, task: 0 };
    let extra = vec![Event { at: 300 * MS, what: injected(dead, 300 * MS) }];
    let wrong = |at| silent_front_end(Run { extra: extra.clone(), ..Run::new(3) }, at, LinkStatusBits::new());
    assert_eq!([300 * MS - 1, 300 * MS].map(wrong), [true, false]);
}

#[test]
fn the_time_starts_with_the_dpr_and_goes_on_with_it() {
    for n in RECEIVERS {
        let run = Run::new(n);
        for (by, wrong) in [(-3, true), (-1, false), (1, false), (4, true)] {
            let change = |values: &mut LinkValues| values.timestamp = values.timestamp.wrapping_add_signed(by);
            let broken = run.broken(of(&run, 20, change));
            assert_eq!(broken == [Violation::LinkTime], wrong, "{n} receivers, {by}: {broken:?}");
        }
        // In the first image, the time since the start may be too short by the time that a start takes.
        for (by, wrong) in [(3_i32, true), (-4, false)] {
            let change = |values: &mut LinkValues| values.timestamp = values.timestamp.saturating_add_signed(by);
            let broken = run.broken(within(0..u64::MAX, change));
            assert_eq!(broken == [Violation::LinkTime], wrong, "{n} receivers, {by}: {broken:?}");
        }
        let mut late = Run { cycles: 80, dpr_start: Some((300 * MS, Cause::Pin, ResetReason::Pin)), ..Run::new(n) };
        late.assert_flawless();
        let runs_on = |values: &mut LinkValues| values.timestamp += 300;
        assert_eq!(late.broken(within(301 * MS..u64::MAX, runs_on)), [Violation::LinkTime]);
        late.dpr_start = None;
        let stands = |values: &mut LinkValues| values.timestamp = 280;
        assert_eq!(late.broken(within(301 * MS..u64::MAX, stands)), [Violation::LinkTime]);
    }
}

#[test]
fn a_clock_that_drifts_is_wrong() {
    let run = Run { cycles: 600, control: 4 * MS, ..Run::new(1) };
    for (ppm, wrong) in [(100, false), (-100, false), (2_000, true), (-2_000, true)] {
        let drift = |images: &mut Vec<Image>| {
            for image in images {
                let ms = i64::from(image.link.timestamp);
                image.link.timestamp = (ms + ms * ppm / 1_000_000) as u32;
            }
        };
        let broken = run.broken(drift);
        assert_eq!(broken == [Violation::LinkTime], wrong, "{ppm} ppm: {broken:?}");
    }
}

#[test]
fn an_image_that_fresh_has_not_announced_is_not_asked() {
    let run = Run::new(3);
    let wrong = of(&run, 20, |values| values.age_100us += 50);
    let mut log = run.log(&wrong);
    // FRESH no longer changes after tick 15.
    log.events.retain(|event| !(matches!(event.what, What::Fresh { .. }) && event.at > run.tick(15)));
    let own = |kind: &Violation| *kind >= Violation::LinkAge && *kind <= Violation::LinkTime;
    assert_eq!(crate::judge(&log).kinds().filter(own).count(), 0);
    assert_eq!(run.broken(&wrong), [Violation::LinkAgeOver]);
}

#[test]
fn a_rise_of_fresh_announces_for_a_deadline_and_a_publication() {
    let run = Run::new(3);
    let rises = |event: &Event| matches!(event.what, What::Fresh { high: true, .. }) && event.at > run.end(20);
    let published = run.log(|_| {}).events.into_iter().find(rises).unwrap().at;
    let asked = |selected| {
        let run = Run { only: Some(selected), ..run.clone() };
        run.broken(|images| {
            images.retain(|image| image.at <= published);
            let last = images.last_mut().unwrap();
            (last.expires, last.link.age_100us) = (u64::MAX, last.link.age_100us + 50);
        })
        .contains(&Violation::LinkAgeOver)
    };
    let until = published + bounds::FRAME_DEADLINE + bounds::PUBLICATION;
    assert_eq!((asked(until), asked(until + 1)), (true, false));
}

#[test]
fn a_rise_of_fresh_for_the_same_image_is_no_publication() {
    // With a control cycle of 7 ms, FRESH has usually risen twice for an image before a transaction reads the image.
    let run = Run { control: 7 * MS, ..Run::new(3) };
    let own = |kind: &Violation| *kind >= Violation::LinkAge && *kind <= Violation::LinkTime;
    let broken = |another: u64| {
        let mut log = run.log(|_| {});
        let mut again = vec![];
        for (event, number) in log.events.iter_mut().filter(|event| event.at > run.tick(15)).zip(0..) {
            if let What::Fresh { high: true, offered } = &mut event.what {
                *offered = Some(u64::to_le_bytes(number).to_vec().into());
                let offered = Some(u64::to_le_bytes(number + another).to_vec().into());
                again.push(Event { at: event.at + 3 * MS, what: What::Fresh { high: true, offered } });
            }
        }
        assert!(again.len() > 5);
        log.events.extend(again);
        in_order(&mut log.events);
        crate::judge(&log).kinds().filter(own).collect::<Vec<_>>()
    };
    assert_eq!(broken(0), []);
    assert!(broken(1_000).contains(&Violation::LinkAge));
}

#[test]
fn two_images_offered_without_link_status_are_judged_as_two() {
    let run = Run { control: MS, ..Run::new(3) }.hit_all(20..23, &Air::Hit(vec![0, 1, 2, 3]));
    let mut log = run.log(|_| {});
    let mut request = vec![92, 0, 4, 0];
    request.extend(profile::crc::frame(&request).to_be_bytes());
    let mut rises = 0;
    for event in log.events.iter_mut().filter(|event| (run.tick(20)..run.end(21) + MS).contains(&event.at)) {
        match &mut event.what {
            What::Transaction { mosi, .. } if event.at < run.end(21) => mosi.0[..8].copy_from_slice(&request),
            What::Fresh { high: true, offered } => {
                *offered = Some(vec![0; 4].into());
                rises += 1;
            }
            _ => {}
        }
    }
    assert_eq!(rises, 2);
    let own = |kind: &Violation| *kind >= Violation::LinkAge && *kind <= Violation::LinkTime;
    assert_eq!(crate::judge(&log).kinds().filter(own).count(), 0);
}

#[test]
fn a_power_cycle_of_the_dpr_is_a_start() {
    let power = |at, on| Event { at, what: What::Power { board: Board::Dpr, on } };
    let mut run = Run { cycles: 80, dpr_start: Some((300 * MS, Cause::PowerOn, ResetReason::PowerOn)), ..Run::new(3) };
    run.extra = vec![power(250 * MS, false), power(300 * MS, true)];
    let mut log = run.log(|images| images.retain(|image| !(250 * MS..300 * MS).contains(&image.at)));
    // A DPR without a supply receives no frame and can be read by no transaction.
    for event in &mut log.events {
        if let What::Transaction { selected, miso, .. } = &mut event.what
            && (250 * MS..300 * MS).contains(selected)
        {
            miso.0.fill(0xFF);
        }
    }
    assert_eq!(crate::rules::shown::synthetic::kinds(&crate::judge(&log)), []);
}

fn published_late(after: u64, held: bool) -> bool {
    let run = Run { cycles: 60, ..Run::new(3) }.hit_all(21..=60, &Air::Lost);
    let sampled = run.tick(20) + 3 * US;
    let edit = |images: &mut Vec<Image>| {
        let image = images.iter_mut().find(|image| image.at > sampled + 260 * MS).unwrap();
        image.at = sampled + after;
        image.link.status = image.link.status.with_out_of_sequence(!held);
    };
    run.broken(edit).contains(&if held { Violation::LinkFlags } else { Violation::LinkFlagsOver })
}

#[test]
fn the_sequence_is_held_for_26_cycles_plus_the_clock_tolerance() {
    // The sequence is held for 260 + 2.5 + 5.2 ms. The judge accepts either value within 0.3 ms of this limit.
    assert!(published_late(267_400_000, false));
    assert!(!published_late(267_400_001, false));
    assert!(!published_late(267_400_001, true));
    assert!(!published_late(268_200_000, true));
    assert!(published_late(268_200_001, true));
    assert!(!published_late(268_200_001, false));
}

#[test]
fn no_age_is_asked_until_a_front_end_is_brought_up_again() {
    for (early, asked) in [(0, true), (1, false)] {
        let mut run = Run { cycles: 90, ..Run::new(3) };
        let published = run.log(|_| {}).events.into_iter().find_map(|event| {
            (event.at > run.end(80) && matches!(event.what, What::Fresh { high: true, .. })).then_some(event.at)
        });
        let until = published.unwrap() + early - bounds::FRONT_END_RECOVERY;
        let fault = injected(DPR_FRONT_END, until);
        run.extra.push(Event { at: until - 3 * MS, what: fault });
        run.assert_flawless();
        let wrong = |images: &mut Vec<Image>| {
            let image = images.iter_mut().find(|image| Some(image.at) == published).unwrap();
            image.link.age_100us -= 10;
        };
        assert_eq!(run.broken(wrong).contains(&Violation::LinkAge), asked, "{early} ns");
    }
}

#[test]
fn a_sample_whose_end_is_not_known_may_be_told_older() {
    let layout = Run::new(3).layout();
    let fits = |unsure, told| {
        let sample = super::Sample { at: 100 * MS, delay: 0, unsure };
        let snapshot = super::Snapshot { samples: vec![sample], none: false, ..super::LinkStatus::at_start(layout) };
        super::compare_age(told, &snapshot, 150 * MS + 50_000).is_eq()
    };
    for (told, known, unknown) in
        [(497, false, false), (498, true, true), (500, true, true), (501, false, true), (625, false, true)]
    {
        assert_eq!((fits(0, told), fits(bounds::FRAME_DEADLINE, told)), (known, unknown), "{told}");
    }
    assert!(!fits(bounds::FRAME_DEADLINE, 626));
}

#[test]
fn any_number_of_samples_may_follow_the_last_certain_one() {
    let layout = Run::new(3).layout();
    let mut snapshot = super::LinkStatus::at_start(layout);
    let sample = |nth: u64| super::Sample { at: nth * 10 * MS, delay: 0, unsure: 0 };
    snapshot.accept(sample(10), true);
    (11..100).for_each(|nth| snapshot.accept(sample(nth), false));
    let compare = |snapshot: &super::Snapshot, told| super::compare_age(told, snapshot, 1_000 * MS + 50_000);
    use std::cmp::Ordering::{Equal, Greater, Less};
    for (told, is) in [(9_001, Equal), (9_003, Greater), (8_950, Equal), (100, Equal), (150, Less), (96, Less)] {
        assert_eq!(compare(&snapshot, told), is, "{told}");
    }
    assert_eq!(compare(&snapshot, u16::MAX), Greater);
    snapshot.accept(sample(100), true);
    assert_eq!(compare(&snapshot, 9_000), Greater, "none of before");
    // Before the first sample there is no age but the greatest value.
    let none = super::LinkStatus::at_start(layout);
    assert_eq!((compare(&none, u16::MAX), compare(&none, u16::MAX - 1)), (Equal, Less));
}

#[test]
fn the_last_64_frames_are_remembered() {
    let mut queue = std::collections::VecDeque::new();
    (0..64).for_each(|frame| super::remember(&mut queue, frame));
    assert_eq!((queue.front(), queue.len()), (Some(&0), 64));
    super::remember(&mut queue, 64);
    assert_eq!((queue.front(), queue.len()), (Some(&1), 64));
}

#[test]
fn samples_are_merged_only_beyond_64() {
    let mut snapshot = super::LinkStatus::at_start(Run::new(3).layout());
    let sample = |nth: u64| super::Sample { at: nth * 10 * MS, delay: 0, unsure: 0 };
    (1..=64).for_each(|nth| snapshot.accept(sample(nth), false));
    let between_the_first_two = |snapshot: &super::Snapshot| super::compare_age(9_850, snapshot, 1_000 * MS).is_eq();
    assert!(!between_the_first_two(&snapshot));
    snapshot.accept(sample(65), false);
    assert!(between_the_first_two(&snapshot));
}

#[test]
fn merged_samples_may_be_as_young_as_the_newest() {
    let sample = |at, delay| super::Sample { at, delay, unsure: 0 };
    let merged = sample(100 * MS, 0).or(sample(110 * MS, 4 * MS));
    let layout = Run::new(3).layout();
    let snapshot = super::Snapshot { samples: vec![merged], none: false, ..super::LinkStatus::at_start(layout) };
    let fits = |told| super::compare_age(told, &snapshot, 200 * MS + 50_000).is_eq();
    assert_eq!((fits(857), fits(858)), (false, true));
}

#[test]
fn a_front_end_is_called_at_fault_only_after_long_silence() {
    let run = Run { cycles: 100, ..Run::new(3).hit_all(20..90, &Air::Lost) };
    run.assert_flawless();
    let told = |times: std::ops::Range<u64>| run.broken(within(times, |values| flip(values, 5)));
    let heard = run.end(19);
    assert_eq!(told(heard + 430 * MS..heard + 450 * MS), [wrongly_set(5)]);
    assert_eq!(told(heard + 455 * MS..run.end(89)), []);
    // Link-Status may report the front end's fault until the image of the first frame after the silence is published.
    assert_eq!(told(run.end(90)..run.end(90) + 15 * MS), []);
    assert_eq!(told(run.end(93)..run.end(94)), [wrongly_set(5)]);
}

#[test]
fn frames_that_a_deaf_front_end_may_have_missed_end_no_silence() {
    let run = Run { cycles: 100, ..Run::new(3).hit_all(20..90, &Air::Lost) };
    let told = |mut run: Run| {
        let deaf = Disturbance::FrontEnd { board: Board::Dpr, harm: Harm::Deaf };
        run.extra.push(Event { at: run.tick(10), what: injected(deaf, run.tick(50) - bounds::FRONT_END_RECOVERY) });
        let silent = run.end(9) + bounds::SILENCE;
        run.broken(within(silent + 5 * MS..run.end(19) + bounds::SILENCE, |values| flip(values, 5)))
    };
    assert_eq!(told(run), []);
}

#[test]
fn a_frame_that_ended_just_before_a_fault_may_be_missed() {
    for (after, wrong) in [(bounds::LAST_BIT_TO_READABLE - 1, false), (bounds::LAST_BIT_TO_READABLE, true)] {
        let mut run = Run { cycles: 100, ..Run::new(3).hit_all(20..90, &Air::Lost) };
        run.extra.push(Event { at: run.end(19) + after, what: injected(DPR_FRONT_END, run.tick(30)) });
        let older = within(run.tick(60)..run.tick(80), |values| values.age_100us += 100);
        assert_eq!(run.broken(older).contains(&Violation::LinkAgeOver), wrong, "{after} ns");
    }
}

#[test]
fn a_frame_just_before_a_fault_of_horus_is_not_missed() {
    let mut run = Run { cycles: 100, ..Run::new(3).hit_all(20..90, &Air::Lost) };
    run.extra.push(Event { at: run.end(19) + 1, what: injected(HORUS_FRONT_END, run.tick(30)) });
    let older = within(run.tick(60)..run.tick(80), |values| values.age_100us += 100);
    assert!(run.broken(older).contains(&Violation::LinkAgeOver));
}

#[test]
fn the_first_frame_may_be_missed_too() {
    let mut rule = <super::LinkStatus as super::Rule>::new(&crate::testing::header(3));
    let mut first = rule.snapshots.back().unwrap().clone();
    first.accept(super::Sample { at: 0, delay: 0, unsure: 0 }, true);
    rule.snapshots.push_back(first);
    let none = |rule: &super::LinkStatus| super::compare_age(u16::MAX, rule.snapshots.back().unwrap(), 50 * MS).is_eq();
    assert!(!none(&rule));
    rule.may_have_missed(0);
    assert!(none(&rule));
}

#[test]
fn a_front_end_that_fails_again_and_again_multiplies_no_sample() {
    let mut rule = <super::LinkStatus as super::Rule>::new(&crate::testing::header(3));
    for at in 1..1_000 {
        let mut next = rule.snapshots.back().unwrap().clone();
        next.accept(super::Sample { at, delay: 0, unsure: 0 }, false);
        rule.snapshots.push_back(next);
        rule.may_have_missed(0);
    }
    assert!(rule.snapshots.back().unwrap().samples.len() <= super::REMEMBERED + 2);
}
