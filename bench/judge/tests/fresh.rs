//! Tests whether transactions read the image that FRESH announced. Each test changes a flawless log in one way.

use crate::common;

use bench_judge::{Log, Violation::*, What, bounds};
use common::*;
use profile::{LinkStatus, LinkValues};

const MS: u64 = 1_000_000;

fn rises(log: &Log, after: u64) -> Vec<usize> {
    let rises = log.events.iter().enumerate();
    let rises = rises.filter(|(_, event)| event.at > after && matches!(event.what, What::Fresh { high: true, .. }));
    let falls = |at: u64| {
        log.events
            .iter()
            .any(|event| event.at == at + 2_000 && matches!(&event.what, What::Fresh { offered: Some(_), .. }))
    };
    rises.filter(|(_, event)| falls(event.at)).map(|(place, _)| place).collect()
}

fn offered(log: &mut Log, place: usize) -> &mut Option<bench_judge::Bytes> {
    let at = log.events[place].at + 2_000;
    let mut events = log.events.iter_mut().filter(|event| event.at == at);
    events
        .find_map(|event| match &mut event.what {
            What::Fresh { offered, .. } => Some(offered),
            _ => None,
        })
        .unwrap()
}

fn offering_at_once(log: &Log) -> Log {
    let mut log = log.clone();
    for place in rises(&log, 0) {
        let bytes = offered(&mut log, place).take();
        match &mut log.events[place].what {
            What::Fresh { offered, .. } => *offered = bytes,
            _ => unreachable!("a rise"),
        }
    }
    log
}

#[test]
fn the_verdict_does_not_depend_on_when_an_image_is_offered() {
    let (_, log, _) = run(3);
    let verdict = judged(&log);
    assert_eq!(judged(&offering_at_once(&log)), verdict);
    let mut unseen = log.clone();
    for place in rises(&log, 0) {
        *offered(&mut unseen, place) = None;
    }
    assert_eq!(judged(&unseen), verdict);
}

#[test]
fn fresh_with_an_unsound_image_is_exactly_one_violation() {
    let (plan, log, _) = run(3);
    let rise = rises(&log, 200 * MS)[0];
    for at_once in [false, true] {
        let log = if at_once { offering_at_once(&log) } else { log.clone() };
        for byte in [0, 32, 96, 275] {
            let mut log = log.clone();
            let rose = log.events[rise].at;
            let image = plan.publications.iter().find(|publication| publication.at == rose).unwrap().image.clone();
            let mut spoilt = image.clone();
            spoilt[byte] ^= 1;
            for event in &mut log.events {
                match &mut event.what {
                    What::Fresh { offered: Some(bytes), .. } if **bytes == *image => bytes.0.clone_from(&spoilt),
                    What::Transaction { miso, .. } if **miso == *image => miso.0.clone_from(&spoilt),
                    _ => {}
                }
            }
            log.events.retain(|event| {
                !matches!(&event.what, What::Forwarded { profile } | What::Arrived { profile, .. }
                if **profile == image[32..])
            });
            assert_eq!(found(&log), [(FreshUnreadable, 1)], "{byte}");
            assert_eq!(judged(&log).violations[0].first_at, rose);
        }
        let mut log = log.clone();
        let bytes = match &mut log.events[rise].what {
            What::Fresh { offered: Some(bytes), .. } => bytes,
            _ => offered(&mut log, rise).as_mut().unwrap(),
        };
        bytes.0.fill(0xFF);
        assert_eq!(found(&log), [(FreshUnreadable, 1)]);
    }
}

#[test]
fn fresh_while_the_dpr_is_busy_without_reason_is_a_violation() {
    let (_, log, place) = run(3);
    let quiet = log.events[place].at + 600_000;
    let mut log = log;
    insert(&mut log, quiet, What::Fresh { high: true, offered: None });
    assert_eq!(found(&log), [(FreshUnreadable, 1)]);
}

#[test]
fn fresh_may_not_announce_an_image_put_in_too_late() {
    let mut plan = Plan::new(3, 60);
    let from = plan.publications[plan.showing(300)].at;
    plan.publications.retain(|publication| !(from + 1..from + 34 * MS).contains(&publication.at));
    plan.selects.retain(|selected| !(from + 25 * MS..from + 41 * MS).contains(selected));
    let log = plan.log();
    assert_eq!(found(&log), []);
    let rose = plan.publications[plan.showing(340)].at;
    for (after, violations) in [(bounds::SSI_READY, vec![]), (bounds::SSI_READY + 1, vec![(FreshUnreadable, 1)])] {
        let mut log = log.clone();
        for event in log.events.iter_mut().filter(|event| event.at == rose + RELEASED_AFTER) {
            event.at = rose + after;
        }
        let rise = |event: &bench_judge::Event| event.at == rose && matches!(event.what, What::Fresh { .. });
        let place = log.events.iter().position(rise).unwrap();
        *offered(&mut log, place) = None;
        sort(&mut log);
        assert_eq!(found(&log), violations, "{after}");
    }
}

#[test]
fn fresh_that_offers_the_image_of_before_is_a_violation() {
    let (plan, log, place) = run(3);
    let quiet = log.events[place].at + 600_000;
    let image = miso(&mut log.clone(), place).clone();
    let mut again = log.clone();
    insert(&mut again, quiet, What::Fresh { high: true, offered: Some(image.clone().into()) });
    assert_eq!(found(&again), [(FreshNotNew, 1)]);
    assert_eq!(judged(&again).violations[0].first_at, quiet);
    let mut plan = plan;
    let first = plan.publications[1].clone();
    plan.publications.insert(2, Publication { at: first.at + 900_000, ..first.clone() });
    assert_eq!(found(&plan.log()), [(FreshNotNew, 1)]);
    plan.publications[2].image = plan.publications[0].image.clone();
    assert_eq!(found(&plan.log()), [(FreshNotNew, 1)]);
    // After a disturbance of a bit, FRESH may announce an image with the same content, but not an older image.
    for (shows, violations) in [(1, vec![]), (0, vec![(FreshNotNew, 1)])] {
        plan.publications[2].image = plan.publications[shows].image.clone();
        let mut log = plan.log();
        let rose = plan.publications[2].at;
        insert(&mut log, rose - 1_000, injected(IMAGE_BIT, rose));
        assert_eq!(found(&log), violations, "{shows}");
        // The bytes of the announced image may come to the log only with a transaction.
        let rise = log.events.iter().position(|event| event.at == rose && matches!(event.what, What::Fresh { .. }));
        *offered(&mut log, rise.unwrap()) = None;
        let is_old = found(&log).iter().any(|(violation, _)| *violation == FreshNotNew);
        assert_eq!(is_old, shows == 0, "read: {shows}");
    }
    // Two images with equal times and counts but different status are different images.
    let values = LinkStatus::verify(&first.image[..LinkStatus::SIZE]).unwrap().values();
    let known = LinkValues { age_100us: 300, ..values };
    let old = LinkValues { age_100us: 299, ..values };
    for (before, now, violation) in [
        (values, LinkValues { status: values.status.with_ram_fault(true), ..values }, false),
        (old, known, false),
        (known, old, true),
        (known, known, true),
    ] {
        for (number, values) in [(1, before), (2, now)] {
            plan.publications[number].image = first.image.clone();
            plan.publications[number].image[..LinkStatus::SIZE].copy_from_slice(LinkStatus::seal(&values).as_bytes());
        }
        let found = found(&plan.log());
        assert_eq!(found.iter().any(|(violation, _)| *violation == FreshNotNew), violation, "{before:?} {now:?}");
    }
}

#[test]
fn fresh_after_which_an_older_image_is_read_is_a_violation() {
    // The log does not state which image FRESH announced, so the judge learns it from the next transaction.
    let (plan, log, _) = run(3);
    let rise = rises(&log, 200 * MS)[0];
    let rose = log.events[rise].at;
    for (open, reads) in [(true, 1), (false, 1), (true, 3), (false, 3)] {
        let mut log = log.clone();
        if open {
            *offered(&mut log, rise) = None;
        }
        let number = plan.publications.iter().position(|publication| publication.at == rose).unwrap();
        let [before, now] = [number - 1, number].map(|number| plan.publications[number].image.clone());
        for (_, miso) in transactions(&mut log).filter(|(_, miso)| **miso == now).take(reads) {
            miso.clone_from(&before);
        }
        log.events.retain(|event| {
            !matches!(&event.what, What::Forwarded { profile } | What::Arrived { profile, .. }
                if **profile == now[32..])
        });
        assert_eq!(found(&log), [(FreshNotNew, 1)], "{open} {reads}");
        assert_eq!(judged(&log).violations[0].first_at, rose);
    }
}

#[test]
fn an_image_older_than_what_was_read_before_is_another_rules() {
    let (_, log, place) = run(3);
    let mut log = log;
    let next = repeats(&log).into_iter().find(|other| *other > place).unwrap();
    let before = image_before(&log, place);
    *miso(&mut log, next) = before;
    let ours = [FreshNotNew, FreshMissing, Torn];
    assert!(!judged(&log).kinds().any(|kind| ours.contains(&kind)), "{:?}", found(&log));
}

#[test]
fn an_image_that_is_readable_without_fresh_is_a_violation() {
    let (_, log, _) = run(3);
    for missing in [2, 3, 20, 25] {
        let mut log = log.clone();
        let rose = log.events[rises(&log, 0)[missing]].at;
        log.events
            .retain(|event| !(rose..=rose + 2_000).contains(&event.at) || !matches!(event.what, What::Fresh { .. }));
        assert_eq!(found(&log), [(FreshMissing, 1)], "{missing}");
    }
}

#[test]
fn every_image_is_readable_without_fresh_where_fresh_is_stuck() {
    let (plan, log, _) = run(3);
    let mut stuck = log.clone();
    stuck.events.retain(|event| !matches!(event.what, What::Fresh { .. }));
    let images = plan.publications.len() as u64;
    let verdict = judged(&stuck);
    assert_eq!(found(&stuck), [(FreshMissing, images)]);
    assert_eq!(verdict.figures.last_bit_to_readable, None);
    let mut stuck = log.clone();
    stuck.events.retain(|event| !(200 * MS..300 * MS).contains(&event.at) || !matches!(event.what, What::Fresh { .. }));
    assert_eq!(found(&stuck), [(FreshMissing, 10)]);
}

#[test]
fn fresh_that_rises_after_the_image_is_readable_is_one_violation() {
    let (_, log, _) = run(3);
    let next = |at: u64| log.events.iter().find(|event| event.at > at && event.what == What::Selected).unwrap().at;
    let soon = |place: &usize| next(log.events[*place].at) < log.events[*place].at + 2 * MS;
    let place = rises(&log, 200 * MS).into_iter().find(soon).unwrap();
    let at = log.events[place].at;
    // In the changed log, FRESH rises too late: during the first transaction that reads the image, or after it.
    for (after, violations) in [(1, [(LateReadable, 1)]), (400_000, [(FreshMissing, 1)])] {
        let mut log = log.clone();
        let image = offered(&mut log, place).clone();
        log.events.retain(|event| !(at..=at + 2_000).contains(&event.at) || !matches!(event.what, What::Fresh { .. }));
        let rises = next(at) + after;
        let during = if after == 1 { None } else { image.clone() };
        insert(&mut log, rises, What::Fresh { high: true, offered: during });
        insert(&mut log, rises + 2_000, What::Fresh { high: false, offered: image });
        assert_eq!(found(&log), violations, "{after}");
    }
}

#[test]
fn a_transaction_outlasting_the_kept_announcements_is_not_judged_by_them() {
    let mut plan = Plan::new(3, 110);
    let from = plan.publications[plan.showing(200)].at + 4 * MS;
    plan.selects.retain(|selected| !(from - 2 * MS..from + 750 * MS).contains(selected));
    let mut log = plan.log();
    let image = plan.publications[plan.showing(200)].image.clone();
    insert(&mut log, from, What::Selected);
    let over = from + 740 * MS;
    insert(&mut log, over, What::Ssi(bench_judge::SsiEvent::Ready));
    let miso = image.into();
    insert(&mut log, over, What::Transaction { selected: from, mosi: vec![].into(), miso });
    assert_eq!(found(&log), [(NoTransaction, 1)]);
    insert(&mut log, from, injected(MISUSE, over));
    assert_eq!(found(&log), []);
}

#[test]
fn a_hit_bit_excuses_unsound_images_until_its_buffer_is_replaced() {
    for (longer, hit) in [(0, false), (1, true)] {
        let from = |at: u64| at - bounds::BUFFER_REPLACED + longer;
        let inject = |log: &mut Log, at: u64| insert(log, from(at), injected(IMAGE_BIT, from(at)));
        // In the changed log, FRESH announces an unsound image, and no transaction reads it.
        let mut plan = Plan::new(3, 40);
        let number = plan.showing(200);
        let rose = plan.publications[number].at;
        plan.selects.retain(|selected| !(rose - MS..rose + bounds::CYCLE).contains(selected));
        plan.publications[number].image[100] ^= 1;
        let mut log = plan.log();
        inject(&mut log, rose + 2_000);
        let violations = if hit { vec![] } else { vec![(FreshUnreadable, 1)] };
        assert_eq!(found(&log), violations, "offered, {longer}");
        let (_, mut log, place) = run(3);
        miso(&mut log, place)[100] ^= 1;
        let What::Transaction { selected, .. } = log.events[place].what else { unreachable!("a transaction") };
        inject(&mut log, selected);
        let violations = if hit { vec![] } else { vec![(Damaged, 1)] };
        assert_eq!(found(&log), violations, "read, {longer}");
        let (_, mut log, place) = run(3);
        let quiet = log.events[place].at + 600_000;
        let image = miso(&mut log, place).clone();
        insert(&mut log, quiet, What::Fresh { high: true, offered: Some(image.into()) });
        inject(&mut log, quiet);
        let violations = if hit { vec![] } else { vec![(FreshNotNew, 1)] };
        assert_eq!(found(&log), violations, "again, {longer}");
    }
}

#[test]
fn an_unsound_image_offered_twice_is_one_violation() {
    let (plan, log, _) = run(3);
    let rise = rises(&log, 200 * MS)[0];
    let rose = log.events[rise].at;
    let mut log = log;
    let image = offered(&mut log, rise).as_mut().unwrap();
    image.0[100] ^= 1;
    let spoilt = image.clone();
    match &mut log.events[rise].what {
        What::Fresh { offered, .. } => *offered = Some(spoilt.clone()),
        _ => unreachable!("a rise"),
    }
    let image = plan.publications.iter().find(|publication| publication.at == rose).unwrap().image.clone();
    for (_, miso) in transactions(&mut log).filter(|(_, miso)| **miso == image) {
        miso.clone_from(&spoilt.0);
    }
    log.events.retain(|event| {
        !matches!(&event.what, What::Forwarded { profile } | What::Arrived { profile, .. } if **profile == image[32..])
    });
    assert_eq!(found(&log), [(FreshUnreadable, 1)]);
}

#[test]
fn an_unannounced_link_status_is_a_missing_fresh_and_no_tear() {
    let (_, mut log, place) = run(3);
    let image = miso(&mut log, place);
    let values = LinkStatus::verify(&image[..LinkStatus::SIZE]).unwrap().values();
    let other = LinkValues { timestamp: values.timestamp + 1, frames_received: values.frames_received + 1, ..values };
    image[..LinkStatus::SIZE].copy_from_slice(LinkStatus::seal(&other).as_bytes());
    let found = found(&log);
    assert!(found.iter().any(|(violation, _)| *violation == FreshMissing), "{found:?}");
    assert!(found.iter().all(|(violation, _)| *violation != Torn), "{found:?}");
}

#[test]
fn a_first_image_read_without_fresh_is_a_violation_too() {
    let mut plan = Plan::new(3, 20);
    plan.selects = plan.publications.iter().map(|publication| publication.at + MS).collect();
    let log = plan.log();
    assert_eq!(found(&log), []);
    let mut stuck = log.clone();
    stuck.events.retain(|event| !matches!(event.what, What::Fresh { .. }));
    assert_eq!(found(&stuck), [(FreshMissing, plan.publications.len() as u64)]);
    let mut late = log.clone();
    late.events.retain(|event| event.at > FIRST_IMAGE + 2_000 || !matches!(event.what, What::Fresh { .. }));
    let image = plan.publications[0].image.clone();
    insert(&mut late, FIRST_IMAGE + 3 * MS, What::Fresh { high: true, offered: Some(image.into()) });
    assert_eq!(found(&late), [(FreshMissing, 1)]);
}

#[test]
fn a_fresh_pulse_shorter_than_its_bound_is_a_violation() {
    for (width, violations) in [(bounds::FRESH_WIDTH, 0), (bounds::FRESH_WIDTH - 1, 1)] {
        let mut log = Plan::new(3, 40).log();
        let rises = log.events.iter().enumerate().filter(|(_, it)| matches!(it.what, What::Fresh { high: true, .. }));
        let (place, rose) = rises.map(|(place, it)| (place, it.at)).nth(20).unwrap();
        let is_fall = |event: &&mut bench_judge::Event| matches!(event.what, What::Fresh { high: false, .. });
        match log.events[place..].iter_mut().find(is_fall).filter(|fall| fall.at < rose + MS) {
            Some(fall) => fall.at = rose + width,
            None => insert(&mut log, rose + width, What::Fresh { high: false, offered: None }),
        }
        sort(&mut log);
        let found = bench_judge::judge(&log).violations.into_iter().filter(|it| it.violation == FreshShort);
        assert_eq!(found.map(|it| it.count).sum::<u64>(), violations, "{width}");
    }
}
