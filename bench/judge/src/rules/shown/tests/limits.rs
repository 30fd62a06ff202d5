//! Tests the limits of the rule `shown`, each on both sides.

use super::super::Shown;
use super::super::synthetic::{Air, Image, MS, Run, US, kinds};
use super::{RECEIVERS, hide, show};
use crate::disturbance::Harm;
use crate::rules::Rule as _;
use crate::testing::{DPR_FRONT_END, HORUS_FRONT_END, IMAGE_BIT, RECEIVE_BIT, in_order, injected};
use crate::{Board, Context, Disturbance, Event, Findings, Violation, What, bounds, judge};

#[test]
fn a_frame_lost_in_a_failing_front_end_is_excused() {
    let fault = |kind: Disturbance, at| Event { at, what: injected(kind, at + 3 * MS) };
    for (kind, after, must) in [
        (DPR_FRONT_END, 359_999, false),
        (DPR_FRONT_END, 360_000, true),
        (RECEIVE_BIT, 359_999, false),
        (RECEIVE_BIT, 360_000, true),
        (Disturbance::Air, 100_000, true),
        (HORUS_FRONT_END, 100_000, true),
    ] {
        let mut run = Run { cycles: 90, ..Run::new(3) };
        run.extra.push(fault(kind, run.end(20) + after));
        run.assert_flawless();
        assert_eq!(run.broken(hide(200)) == [Violation::NotShown], must, "{kind:?}, {after} ns after the last bit");
    }
}

#[test]
fn a_hit_image_bit_allows_the_dpr_to_withdraw_the_image() {
    for n in RECEIVERS {
        let mut run = Run { cycles: 90, ..Run::new(n) };
        let log = run.log(|_| {});
        let from = run.end(20) + bounds::LAST_BIT_TO_READABLE;
        let asked = log.events.iter().find(|event| match event.what {
            What::Transaction { selected, .. } => selected >= from,
            _ => false,
        });
        let asked = asked.unwrap().at;
        for (at, must) in [(asked - 1, false), (asked + 1, true)] {
            run.extra = vec![Event { at, what: injected(IMAGE_BIT, at) }];
            run.assert_flawless();
            assert_eq!(run.broken(hide(200)) == [Violation::NotShown], must, "{n} receivers, {at}");
        }
    }
}

/// Returns the violations of a run whose only transaction takes `took` ns and reads an object that HORUS never sent.
fn forged_in(took: u64) -> Vec<Violation> {
    let run = Run { cycles: 200, ..Run::new(3) };
    let run = Run { only: Some(run.end(20) + MS), ..run };
    let forged = Run { horus_starts: vec![1], ..run.clone() }.profile(20);
    let objects = run.layout().in_profile(1).unwrap();
    let mut log = run.log(|images| {
        images.iter_mut().find(|image| image.timestamp() == Some(200)).unwrap().places[1] =
            forged[objects.clone()].to_vec();
    });
    let selected = run.only.unwrap();
    let transaction = log.events.iter_mut().find(|event| matches!(event.what, What::Transaction { .. })).unwrap();
    transaction.at = selected + took;
    in_order(&mut log.events);
    kinds(&judge(&log))
}

#[test]
fn a_transaction_longer_than_a_second_is_not_judged() {
    assert_eq!(forged_in(1_000 * MS), [Violation::ShownNeverSent]);
    assert_eq!(forged_in(1_000 * MS + 1), []);
}

#[test]
fn a_transaction_that_reads_ones_throughout_is_not_asked() {
    for n in RECEIVERS {
        let gone = |images: &mut Vec<Image>| {
            images
                .iter_mut()
                .filter(|image| image.timestamp() == Some(200))
                .for_each(|image| image.expires = image.at - 1);
        };
        assert_eq!(Run::new(n).broken(gone), []);
    }
}

/// A flight controller in another SPI mode samples MISO early, so the first bit that it reads is the level of the idle
/// line. A busy DPR is then read as 0xFF throughout, or as 0x7F and 0xFF bytes, which are damaged.
#[test]
fn ones_throughout_but_for_the_first_bit_are_damage_and_not_asked() {
    for n in RECEIVERS {
        let run = Run::new(n);
        for (first_byte, expected) in [(0x7F, vec![]), (0xFF, vec![Violation::NotShown])] {
            let mut log = run.log(hide(run.timestamp(20)));
            for event in &mut log.events {
                let What::Transaction { selected, miso, .. } = &mut event.what else { continue };
                if (run.end(20)..run.end(21)).contains(selected) && first_byte != 0xFF {
                    miso.0.fill(0xFF);
                    miso.0[0] = first_byte;
                }
            }
            let shown = [Violation::NotShown, Violation::Vacant];
            let found: Vec<_> = kinds(&judge(&log)).into_iter().filter(|found| shown.contains(found)).collect();
            assert_eq!(found, expected, "{n} receivers");
        }
    }
}

#[test]
fn a_read_across_a_restart_or_loss_of_supply_is_not_judged() {
    let restart = 300 * MS;
    let mut run = Run { dpr_start: Some((restart, crate::Cause::Pin, profile::ResetReason::Pin)), ..Run::new(3) };
    let forged = Run { horus_starts: vec![1], ..run.clone() }.profile(20);
    let object = run.layout().in_profile(1).unwrap();
    let forge = |images: &mut Vec<Image>| {
        for image in images {
            image.places[1] = forged[object.clone()].to_vec();
            (image.at, image.expires) = (image.at.min(restart - 9 * MS), u64::MAX);
        }
    };
    let judged = |run: &Run, selected| Run { only: Some(selected), ..run.clone() }.broken(forge);
    assert_eq!(judged(&run, restart - MS), [Violation::ShownNeverSent]);
    // Each transaction takes 0.3 ms, and the DPR restarts during the first one only.
    assert_eq!(judged(&run, restart - 1), []);
    assert_eq!(judged(&run, restart), [Violation::ShownNeverSent]);
    run.dpr_start = None;
    assert_eq!(judged(&run, restart), [Violation::ShownNeverSent]);
    run.extra.push(Event { at: restart - MS, what: What::Power { board: Board::Dpr, on: false } });
    assert_eq!(judged(&run, restart), []);
}

#[test]
fn what_reached_the_antenna_is_remembered_for_two_seconds_and_no_longer() {
    let run = Run { cycles: 600, ..Run::new(3) };
    let log = run.log(|_| {});
    let (mut context, mut shown, mut findings) =
        (Context::new(&log.header), Shown::new(&log.header), Findings::default());
    for event in &log.events {
        context.take(event);
        shown.take(event, &context, &mut findings);
        assert!(shown.deliveries.len() <= 201);
    }
    assert_eq!(shown.deliveries.len(), 201);
}

#[test]
fn of_one_transaction_each_kind_of_violation_is_told_once() {
    let run = Run::new(3).hit_all([20], &Air::Lost);
    let forged = Run { horus_starts: vec![1], ..run.clone() }.profile(19);
    let (lost, layout) = (run.profile(20), run.layout());
    let wrong = |images: &mut Vec<Image>| {
        let image = images.iter_mut().find(|image| image.at >= run.tick(21)).unwrap();
        for (index, profile) in [(0, &lost), (1, &forged), (2, &lost), (3, &forged)] {
            image.places[index] = profile[layout.in_profile(index).unwrap()].to_vec();
        }
        image.expires = image.at + 10 * US;
    };
    let at = run.log(wrong).events.iter().find_map(|event| match &event.what {
        What::Fresh { high: true, .. } if event.at >= run.tick(21) => Some(event.at),
        _ => None,
    });
    let verdict = Run { only: at, ..run.clone() }.verdict(wrong);
    let told = |kind| verdict.violations.iter().find(|it| it.violation == kind).map(|it| it.count);
    assert_eq!(told(Violation::ShownNeverSent), Some(1));
    assert_eq!(told(Violation::ShownOutOfSequence), Some(1));
    assert_eq!(verdict.figures.faults.invalid_shown_valid, 4);
}

#[test]
fn objects_withdrawn_by_a_repeated_frame_are_readable_until_its_publication() {
    for (after, expected) in [(400_000, None), (400_001, Some(Violation::ShownOutOfSequence))] {
        let mut run = Run::new(3).hit_all(21..24, &Air::Lost).hit(20, 0, Air::Repeated(12 * MS));
        let repeated = run.end(20) + 12 * MS;
        run.only = Some(repeated + after);
        let profile = run.profile(20);
        let stays = |images: &mut Vec<Image>| {
            for image in images.iter_mut().filter(|image| (run.end(20)..run.end(24)).contains(&image.at)) {
                for index in 0..=3 {
                    image.places[index] = profile[run.layout().in_profile(index).unwrap()].to_vec();
                }
            }
        };
        assert_eq!(run.broken(stays), Vec::from_iter(expected), "{after} ns");
    }
}

#[test]
fn a_cycle_that_was_shown_once_need_not_be_shown_again() {
    for n in RECEIVERS {
        let run = Run::new(n);
        let withdraw = |images: &mut Vec<Image>, after: u64| {
            let place = images.iter().position(|image| image.timestamp() == Some(200)).unwrap();
            let mut empty = images[place].clone();
            empty.at += after;
            empty.places.iter_mut().for_each(|place| place.fill(0));
            images.insert(place + 1, empty);
        };
        // An image without objects is inserted. It repeats the Link-Status of the image before, which another rule
        // judges.
        let is_missed = |after| run.broken(|images| withdraw(images, after)).contains(&Violation::NotShown);
        assert!(!is_missed(4 * MS));
        assert!(is_missed(0));
    }
}

#[test]
fn a_second_frame_2500_us_late_still_belongs_to_its_cycle() {
    for (by, must, never) in [(2_199, true, false), (2_201, false, false), (2_799, false, false), (2_801, false, true)]
    {
        let run = Run::new(5).hit(20, 1, Air::Delayed(by * US));
        run.assert_flawless();
        let without = |images: &mut Vec<Image>| {
            for image in images.iter_mut().filter(|image| image.timestamp() == Some(200)) {
                image.places[3..].iter_mut().for_each(|place| place.fill(0));
            }
        };
        assert_eq!(run.broken(without) == [Violation::Vacant], must, "{by}");
        let shown = run.broken(show(&run, run.end(20) + (by + 60) * US, 20, 3..=5));
        assert_eq!(shown == [Violation::ShownOutOfSequence], never, "{by}: {shown:?}");
    }
}

#[test]
fn a_position_marked_invalid_is_not_counted_as_valid() {
    let run = Run::new(3);
    let absent = |images: &mut Vec<Image>| {
        let image = images.iter_mut().find(|image| image.timestamp() == Some(200)).unwrap();
        image.places[0] = profile::ReportedPosition::seal(&profile::ReportedValues::absent(200)).as_bytes().to_vec();
    };
    assert_eq!(run.assert_flawless().figures.valid_cycles, 37);
    assert_eq!(run.verdict(absent).figures.valid_cycles, 36);
}

#[test]
fn what_is_told_says_when() {
    let run = Run::new(3);
    let verdict = run.verdict(hide(200));
    let words = verdict.violations.iter().find(|it| it.violation == Violation::NotShown).unwrap().to_string();
    let ended = format!("{:.6} ms", run.end(20) as f64 / 1e6);
    assert!(words.contains("200 ms") && words.contains(&ended), "{words}");
}

fn heard_otherwise(run: &Run, edit: impl Fn(&mut u64, &mut Vec<u8>, &mut bool) -> Option<Event>) -> Vec<Violation> {
    let mut log = run.log(hide(200));
    let at = run.end(20);
    let frame = log.events.iter_mut().find(|event| event.at == at && matches!(event.what, What::Heard { .. }));
    let What::Heard { started, bytes, whole } = &mut frame.unwrap().what else { unreachable!() };
    let mut changed = bytes.to_vec();
    let extra = edit(started, &mut changed, whole);
    *bytes = changed.into();
    log.events.extend(extra);
    in_order(&mut log.events);
    kinds(&judge(&log))
}

#[test]
fn a_torn_frame_or_a_damaged_length_may_be_dropped() {
    let run = Run::new(3);
    let nothing = |_: &mut u64, _: &mut Vec<u8>, _: &mut bool| None;
    assert_eq!(heard_otherwise(&run, nothing), [Violation::NotShown]);
    let torn = |_: &mut u64, _: &mut Vec<u8>, whole: &mut bool| {
        *whole = false;
        None
    };
    assert_eq!(heard_otherwise(&run, torn), []);
    let damaged = |_: &mut u64, bytes: &mut Vec<u8>, _: &mut bool| {
        bytes[0] ^= 0x10;
        None
    };
    assert_eq!(heard_otherwise(&run, damaged), []);
}

#[test]
fn a_frame_that_follows_another_within_300_us_need_not_be_received() {
    let run = Run::new(3);
    for (gap, must) in [(299_999, false), (300_000, true)] {
        let foreign = |started: &mut u64, _: &mut Vec<u8>, _: &mut bool| {
            let at = *started - gap;
            Some(Event { at, what: What::Heard { started: at - MS, bytes: vec![3, 1, 2, 0, 0].into(), whole: true } })
        };
        assert_eq!(heard_otherwise(&run, foreign) == [Violation::NotShown], must, "{gap} ns");
    }
}

#[test]
fn a_dpr_that_has_started_must_show_what_follows_100_ms_later() {
    let mut run =
        Run { cycles: 80, dpr_start: Some((300 * MS, crate::Cause::Pin, profile::ResetReason::Pin)), ..Run::new(3) };
    run.assert_flawless();
    let first = (30..80).find(|cycle| run.broken(hide(run.timestamp(*cycle))) == [Violation::NotShown]);
    assert_eq!(first, Some(41));
    run.dpr_start = None;
    assert_eq!(run.broken(hide(run.timestamp(30))), [Violation::NotShown]);
}

#[test]
fn a_disturbed_front_end_may_still_have_received_frozen_frames() {
    let mut run = Run { cycles: 90, frozen: (20..90).collect(), ..Run::new(5) };
    let deaf = Disturbance::FrontEnd { board: Board::Dpr, harm: Harm::Deaf };
    let fault = injected(deaf, run.tick(70) + 2 * MS - bounds::FRONT_END_RECOVERY);
    run.extra.push(Event { at: 200 * MS, what: fault });
    run.assert_flawless();
}

#[test]
fn a_missed_frame_does_not_end_the_dprs_sequence() {
    let missed = Run::new(3).hit_all([20], &Air::Lost);
    let mut log = missed.log(|_| {});
    let at = missed.end(20) + 5 * MS;
    let late = missed.log(|_| {}).events.into_iter().find_map(|event| match event.what {
        What::Sent { started, bytes, .. } if event.at == missed.end(20) => {
            Some(Event { at, what: What::Heard { started: started + 5 * MS, bytes, whole: false } })
        }
        _ => None,
    });
    log.events.extend(late);
    in_order(&mut log.events);
    assert_eq!(kinds(&judge(&log)), []);
}

#[test]
fn a_possibly_missed_repeated_frame_may_leave_the_sequence_intact() {
    for hit in [true, false] {
        let run = Run::new(1);
        let again = run.end(20) + MS;
        let mut log = run.log(|_| {});
        let repeated = log.events.iter().find_map(|event| match &event.what {
            What::Heard { started, bytes, whole } if event.at == run.end(19) => {
                let what = What::Heard { started: again, bytes: bytes.clone(), whole: *whole };
                Some(Event { at: again + event.at - started, what })
            }
            _ => None,
        });
        log.events.extend(repeated);
        if hit {
            let until = again + 1 - bounds::FRONT_END_RECOVERY;
            log.events.push(Event { at: until, what: injected(DPR_FRONT_END, until) });
        }
        in_order(&mut log.events);
        let found = kinds(&judge(&log));
        assert!(
            if hit { found.is_empty() } else { found.contains(&Violation::ShownOutOfSequence) },
            "{hit}: {found:?}"
        );
    }
}
