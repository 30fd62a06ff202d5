//! Tests whether the flight controller makes transactions, and whether the DPR serves them. Each test changes a
//! flawless log in one way.

use crate::common;

use bench_judge::disturbance::{Conduct, Wire};
use bench_judge::{Board, Disturbance, Event, Max, Quantiles, SsiEvent, Violation::*, What, bounds};
use common::*;
use profile::LinkValues;

const MS: u64 = 1_000_000;
const CYCLE: u64 = 10 * MS;
/// The instant, ns, at which the DPR puts in an image, between two transactions.
const BACK: u64 = 344_950_000;

#[test]
fn a_flawless_run_has_its_figures_and_no_violation() {
    for (gps, ready) in [(1, TO_READY), (2, TO_READY), (3, TO_READY), (5, TO_READY)] {
        let plan = Plan::new(gps, 60);
        let log = plan.log();
        let verdict = judged(&log);
        assert_eq!(verdict.violations, [], "{gps}");
        let publication = &plan.publications[plan.showing(600)];
        let after = publication.at - FIRST_TICK - 59 * bounds::CYCLE;
        let figures = verdict.figures;
        assert_eq!(figures.sample_to_readable, Some(Quantiles { p50: after, p999: after, max: after }), "{gps}");
        assert_eq!(figures.last_bit_to_readable, Some(Max { max: TO_FRESH }));
        assert_eq!(figures.ready_ns, Some(Max { max: ready }));
        let busy = log.events.iter().any(|event| event.what == What::Ssi(SsiEvent::Busy));
        assert!(busy, "some transaction begins before the first image");
    }
}

#[test]
fn without_transactions_and_frames_there_are_no_figures() {
    let mut plan = Plan::new(3, 3);
    plan.selects.clear();
    plan.upstream.clear();
    let figures = judged(&plan.log()).figures;
    assert_eq!((figures.sample_to_readable, figures.last_bit_to_readable, figures.ready_ns), (None, None, None));
}

#[test]
fn an_answer_is_a_violation() {
    let mut log = Plan::new(3, 30).log();
    insert(&mut log, 100 * MS, What::Answer);
    insert(&mut log, 120 * MS, What::Answer);
    assert_eq!(found(&log), [(Answered, 2)]);
}

#[test]
fn a_restart_keeps_until_when_the_flight_controller_was_silent() {
    let (from, to) = (200 * MS, 400 * MS);
    for (until, violations) in [(to - bounds::NO_TRANSACTION, vec![]), (from, vec![(NoTransaction, 1)])] {
        let mut log = without_transactions(from, to).log();
        let silent = Disturbance::FlightController { conduct: Conduct::Silent };
        insert(&mut log, from, injected(silent, until));
        // An excuse that has ended is dropped when the next disturbance begins.
        insert(&mut log, until, injected(Disturbance::Air, until));
        let off = What::Power { board: Board::Horus, on: false };
        insert(&mut log, to - MS, off);
        let found: Vec<_> = found(&log).into_iter().filter(|(violation, _)| *violation == NoTransaction).collect();
        assert_eq!(found, violations, "{until}");
    }
}

fn without_transactions(from: u64, to: u64) -> Plan {
    let mut plan = Plan::new(3, 60);
    let took = plan.transaction_ns();
    plan.selects.retain(|selected| !(from..to).contains(&(selected + took)));
    plan.selects.extend([from, to].map(|ended| ended - took));
    plan.selects.sort_unstable();
    plan.selects.dedup();
    plan
}

#[test]
fn a_flight_controller_must_read_at_least_every_100_ms() {
    let from = 251 * MS;
    assert_eq!(found(&without_transactions(from, from + bounds::NO_TRANSACTION).log()), []);
    let verdict = judged(&without_transactions(from, from + bounds::NO_TRANSACTION + 1).log());
    assert_eq!(verdict.violations.len(), 1);
    assert_eq!((verdict.violations[0].violation, verdict.violations[0].first_at), (NoTransaction, 351 * MS));
    let mut log = without_transactions(from, from + 150 * MS).log();
    log.events.retain(|event| event.at < 450 * MS || !matches!(event.what, What::Selected | What::Transaction { .. }));
    log.events
        .retain(|event| event.at < 450 * MS || !matches!(event.what, What::Forwarded { .. } | What::Arrived { .. }));
    log.events.retain(|event| event.at < 450 * MS || !matches!(event.what, What::Ssi(SsiEvent::Busy)));
    assert_eq!(found(&log), [(NoTransaction, 2)]);
}

#[test]
fn a_flight_controller_that_never_reads_is_a_violation() {
    let mut plan = Plan::new(3, 12);
    plan.selects.clear();
    assert_eq!(found(&plan.log()), [(NoTransaction, 1)]);
}

#[test]
fn no_transaction_is_expected_while_the_flight_controller_is_made_to_hang() {
    for (kind, until, violations) in [
        (MISUSE, 400 * MS, vec![]),
        (MISUSE, u64::MAX, vec![]),
        (MISUSE, 349 * MS, vec![(NoTransaction, 1)]),
        (Disturbance::Wire { wire: Wire::Fresh }, 400 * MS, vec![(NoTransaction, 1)]),
    ] {
        let mut log = without_transactions(251 * MS, 450 * MS).log();
        insert(&mut log, 260 * MS, injected(kind, until));
        assert_eq!(found(&log), violations, "{kind:?} until {until}");
    }
}

#[test]
fn a_dpr_that_never_gets_ready_is_a_violation_and_no_other() {
    let mut plan = Plan::new(3, 40);
    plan.publications.clear();
    let verdict = judged(&plan.log());
    assert_eq!(verdict.violations.len(), 1);
    assert_eq!((verdict.violations[0].violation, verdict.violations[0].first_at), (NeverReady, bounds::START));
    let mut plan = Plan::new(3, 8);
    plan.publications.clear();
    assert_eq!(plan.end, bounds::START);
    assert_eq!(found(&plan.log()), []);
}

#[test]
fn a_dpr_kept_selected_since_its_restart_is_ready_once_deselected() {
    // In the changed log, the DPR restarts just before the flight controller selects it, or while it is selected.
    for restart in [258 * MS, 265 * MS] {
        kept_selected_at_a_restart(restart);
    }
}

fn kept_selected_at_a_restart(restart: u64) {
    let mut plan = Plan::new(3, 60);
    let held = plan.selects.iter().copied().find(|selected| *selected > 260 * MS).unwrap();
    plan.selects.retain(|selected| *selected <= held || *selected > 450 * MS);
    let mut log = plan.log();
    let injected = injected(MISUSE, 450 * MS);
    insert(&mut log, held - 1, injected);
    insert(&mut log, restart, dpr_reset(true));
    let let_go = 450 * MS;
    blind(&mut log, 258 * MS, let_go);
    log.events.retain(|event| {
        !(258 * MS..let_go).contains(&event.at) || !matches!(event.what, What::Fresh { .. } | What::Ssi(_))
    });
    for event in &mut log.events {
        if matches!(event.what, What::Transaction { selected, .. } if selected == held) {
            event.at = let_go;
        }
    }
    sort(&mut log);
    insert(&mut log, let_go + bounds::SSI_READY, What::Ssi(SsiEvent::Ready));
    let never = |log: &bench_judge::Log| found(log).contains(&(NeverReady, 1));
    assert!(!never(&log), "it is selected until {let_go}");
    for event in &mut log.events {
        if matches!(event.what, What::Transaction { selected, .. } if selected == held) {
            event.at = 300 * MS;
        }
    }
    sort(&mut log);
    assert!(never(&log));
}

/// Returns the log of a run in which the DPR does nothing from `at` to `back`, with the events `what` at `at`.
fn restarted(at: u64, back: u64, what: &[What]) -> bench_judge::Log {
    restarted_in(&Plan::new(3, 60), at, back, what)
}

fn restarted_in(plan: &Plan, at: u64, back: u64, what: &[What]) -> bench_judge::Log {
    let mut log = plan.log();
    blind(&mut log, at, back);
    let of_dpr = |what: &What| matches!(what, What::Fresh { .. } | What::Ssi(_));
    log.events.retain(|event| !(at..back).contains(&event.at) || !of_dpr(&event.what));
    what.iter().for_each(|what| insert(&mut log, at, what.clone()));
    log
}

#[test]
fn a_dpr_must_get_ready_in_time_after_a_restart() {
    let power = |on| What::Power { board: Board::Dpr, on };
    let power_cycle = [power(false), power(true)];
    for what in [&[dpr_reset(true)][..], &[dpr_reset(false)], &power_cycle] {
        assert_eq!(found(&restarted(250 * MS, BACK, what)), [], "{what:?}");
        let log = restarted(250 * MS, BACK + CYCLE, what);
        let verdict = judged(&log);
        assert_eq!(found(&log), [(NeverReady, 1)], "{what:?}");
        assert_eq!(verdict.violations[0].first_at, 350 * MS);
    }
    // A DPR without a supply need not do anything.
    let mut log = restarted(250 * MS, BACK + 10 * CYCLE, &[power(false)]);
    insert(&mut log, 440 * MS, power(true));
    assert_eq!(found(&log), []);
    // If the log has no restart, the DPR should have been readable all the time.
    assert_eq!(found(&restarted(250 * MS, BACK, &[])), [(Silent, 1)]);
}

#[test]
fn nobody_reads_a_dpr_without_supply() {
    let mut log = without_transactions(251 * MS, 450 * MS).log();
    insert(&mut log, 260 * MS, What::Power { board: Board::Dpr, on: false });
    insert(&mut log, 440 * MS, What::Power { board: Board::Dpr, on: true });
    log.events.retain(|event| !(260 * MS..440 * MS).contains(&event.at) || !matches!(event.what, What::Fresh { .. }));
    assert_eq!(found(&log), []);
}

#[test]
fn what_is_read_of_a_dpr_without_supply_is_not_judged() {
    let power = |on| What::Power { board: Board::Dpr, on };
    let mut log = restarted(250 * MS, BACK + 10 * CYCLE, &[power(false)]);
    insert(&mut log, 440 * MS, power(true));
    for (_, miso) in transactions(&mut log).filter(|(selected, _)| (300 * MS..400 * MS).contains(selected)) {
        miso.fill(0x5A);
    }
    assert_eq!(found(&log), []);
}

#[test]
fn a_dpr_that_restarts_counts_anew() {
    let mut plan = Plan::new(3, 60);
    let first = plan.publications.iter().position(|publication| publication.at >= BACK).unwrap();
    let at = plan.publications[first].at;
    // The first image after a restart has no objects, and its time and counters begin anew.
    plan.publications[first].image = plan.image(at - 250 * MS, None, LinkValues::default());
    assert_eq!(found(&restarted_in(&plan, 250 * MS, BACK, &[dpr_reset(true)])), []);
    let unasked = found(&restarted_in(&plan, 250 * MS, BACK, &[]));
    assert!(unasked.contains(&(FreshNotNew, 1)), "{unasked:?}");
}

#[test]
fn the_dpr_must_be_ready_again_once_misuse_is_over() {
    for (sooner, violations) in [(1, vec![]), (0, vec![(NotReady, 1)])] {
        let mut plan = Plan::new(3, 60);
        let over = plan.publications[plan.showing(300)].at + 3 * MS;
        let ended = over - sooner;
        plan.selects.retain(|selected| selected.abs_diff(over) > 5 * MS);
        plan.selects.push(ended - plan.transaction_ns());
        plan.selects.sort_unstable();
        let log = plan.log();
        let ready = [SsiEvent::Released, SsiEvent::Ready];
        let mut log = moved(&log, ended + TO_READY, ended + bounds::SSI_READY + 1, &ready);
        let until = over - bounds::MISUSE_OVER;
        insert(&mut log, until - MS, injected(MISUSE, until));
        assert_eq!(found(&log), violations, "{sooner}");
    }
}

#[test]
fn a_transaction_into_which_the_dpr_restarts_is_not_judged() {
    let mut log = Plan::new(3, 60).log();
    let place = repeats(&log)[40];
    miso(&mut log, place)[100..].fill(0xFF);
    let at = log.events[place].at;
    assert_eq!(found(&log), [(Torn, 1)]);
    insert(&mut log, at - 50_000, dpr_reset(true));
    let publication = |event: &Event| matches!(event.what, What::Fresh { high: true, .. });
    let next = log.events.iter().find(|event| event.at > at && publication(event)).unwrap().at;
    blind(&mut log, at + 1, next);
    log.events.retain(|event| !(at..next).contains(&event.at) || !matches!(event.what, What::Ssi(_)));
    assert_eq!(found(&log), []);
}

fn moved(log: &bench_judge::Log, from: u64, to: u64, which: &[SsiEvent]) -> bench_judge::Log {
    let mut log = log.clone();
    let mut count = 0;
    for event in &mut log.events {
        if let What::Ssi(what) = event.what
            && event.at == from
            && which.contains(&what)
        {
            event.at = to;
            count += 1;
        }
    }
    assert_eq!(count, which.len());
    sort(&mut log);
    log
}

#[test]
fn the_dpr_must_be_ready_10_us_after_a_transaction() {
    let log = Plan::new(3, 60).log();
    let ended = log.events[repeats(&log)[40]].at;
    let ready = [SsiEvent::Released, SsiEvent::Ready];
    let at = |after| moved(&log, ended + TO_READY, ended + after, &ready);
    assert_eq!(found(&at(bounds::SSI_READY)), []);
    assert_eq!(judged(&at(bounds::SSI_READY)).figures.ready_ns, Some(Max { max: 10_000 }));
    let verdict = judged(&at(bounds::SSI_READY + 1));
    assert_eq!(found(&at(bounds::SSI_READY + 1)), [(NotReady, 1)]);
    assert_eq!(verdict.violations[0].first_at, ended);
    assert_eq!(verdict.figures.ready_ns, Some(Max { max: 10_001 }));
    let mut late = at(2 * CONTROL_CYCLE + 100_000);
    blind(&mut late, ended + 1, ended + 2 * CONTROL_CYCLE + 200_000);
    late.events.retain(|event| {
        !(ended + 1..ended + 2 * CONTROL_CYCLE + 90_000).contains(&event.at)
            || !matches!(event.what, What::Ssi(SsiEvent::Held | SsiEvent::Released | SsiEvent::Ready))
    });
    assert_eq!(found(&late), [(NotReady, 1)]);
}

#[test]
fn buffers_taken_after_a_transaction_owed_nothing_are_not_held_back() {
    for (longer, violations) in [(MS, vec![]), (0, vec![(NotReady, 1)])] {
        let mut log = Plan::new(3, 60).log();
        let ended = log.events[repeats(&log)[40]].at;
        let shown = |event: &Event| matches!(event.what, What::Fresh { .. });
        assert!(!log.events.iter().any(|event| event.at.abs_diff(ended) < 500_000 && shown(event)));
        blind(&mut log, ended, ended + 1);
        log.events.retain(|event| event.at != ended || event.what != What::Ssi(SsiEvent::Held));
        let mut log = moved(&log, ended + TO_READY, ended + 400_000, &[SsiEvent::Released, SsiEvent::Ready]);
        insert(&mut log, ended + 20_000, What::Ssi(SsiEvent::Held));
        let until = ended + longer - bounds::MISUSE_OVER;
        insert(&mut log, until - MS, injected(MISUSE, until));
        assert_eq!(found(&log), violations, "{longer}");
    }
}

#[test]
fn a_dpr_that_is_ready_as_the_transaction_ends_needs_no_time() {
    let mut log = Plan::new(3, 60).log();
    let ends: Vec<_> = log.events.iter().filter(|event| matches!(event.what, What::Transaction { .. })).collect();
    let ends: Vec<_> = ends.iter().map(|event| event.at).collect();
    for event in &mut log.events {
        if let What::Ssi(_) = event.what
            && let Some(ended) = ends.iter().find(|ended| **ended + TO_READY == event.at)
        {
            event.at = *ended;
        }
    }
    sort(&mut log);
    assert_eq!(found(&log), []);
    assert_eq!(judged(&log).figures.ready_ns, Some(Max { max: 0 }));
}

#[test]
fn a_dpr_that_is_never_ready_again_is_one_violation() {
    let mut log = Plan::new(3, 60).log();
    let ended = log.events[*repeats(&log).last().unwrap()].at;
    log.events
        .retain(|event| event.at <= ended || !matches!(event.what, What::Ssi(SsiEvent::Released | SsiEvent::Ready)));
    assert!(log.events.last().unwrap().at > ended + bounds::SSI_READY);
    assert_eq!(found(&log), [(NotReady, 1)]);
    assert_eq!(judged(&log).figures.ready_ns, Some(Max { max: TO_READY }));
}

#[test]
fn a_transaction_too_soon_after_another_excuses_a_late_dpr() {
    let log = Plan::new(3, 60).log();
    let ended = log.events[repeats(&log)[40]].at;
    for (gap, violations) in [(9_000, vec![]), (10_000, vec![]), (10_001, vec![(NotReady, 1)])] {
        let mut log = moved(&log, ended + TO_READY, ended + 200_000, &[SsiEvent::Released, SsiEvent::Ready]);
        insert(&mut log, ended + gap, What::Selected);
        insert(&mut log, ended + gap, What::Ssi(SsiEvent::Busy));
        let what = What::Transaction { selected: ended + gap, mosi: vec![0; 96].into(), miso: vec![0xFF; 96].into() };
        insert(&mut log, ended + 195_000, what);
        assert_eq!(found(&log), violations, "{gap}");
    }
}

#[test]
fn buffers_that_are_held_for_longer_than_10_us_are_a_violation() {
    let plan = Plan::new(3, 60);
    let log = plan.log();
    let publication = |after: u64| {
        let free =
            |at: u64| !log.events.iter().any(|event| event.at.abs_diff(at) < 30_000 && event.what == What::Selected);
        let mut publications = plan.publications.iter().map(|publication| publication.at);
        let held = |at: u64| log.events.iter().any(|event| event.at == at && event.what == What::Ssi(SsiEvent::Held));
        publications.find(|at| *at > after && free(*at) && held(*at - HELD_BEFORE)).unwrap()
    };
    let at = publication(200 * MS);
    let released = at + RELEASED_AFTER;
    let held_for = |ns: u64| moved(&log, at - HELD_BEFORE, released - ns, &[SsiEvent::Held]);
    assert_eq!(found(&held_for(bounds::SSI_READY)), []);
    assert_eq!(found(&held_for(bounds::SSI_READY + 1)), [(HeldBack, 1)]);
    assert_eq!(judged(&held_for(bounds::SSI_READY + 1)).violations[0].first_at, released - bounds::SSI_READY - 1);
    let mut held = log.clone();
    let last = publication(plan.end - 12 * MS);
    held.events.retain(|event| event.at < last || event.what == What::End);
    assert_eq!(found(&held), [(HeldBack, 1)]);
    held.events.last_mut().unwrap().at = last - HELD_BEFORE + bounds::SSI_READY;
    assert_eq!(found(&held), []);
}

#[test]
fn one_transaction_may_meet_the_dpr_busy_and_its_successor_may_not() {
    let log = Plan::new(3, 60).log();
    let ended = log.events[repeats(&log)[40]].at;
    for (transactions, violations) in [
        (1, vec![]),
        (2, vec![(BusyTwice, 1)]),
        (7, vec![(BusyTwice, 1)]),
        (8, vec![(Silent, 1)]),
        (40, vec![(Silent, 1)]),
    ] {
        let mut log = log.clone();
        blind(&mut log, ended, ended + transactions * CONTROL_CYCLE);
        assert_eq!(found(&log), violations, "{transactions}");
    }
    let mut log = log.clone();
    blind(&mut log, ended, ended + 1);
    blind(&mut log, ended + 2 * CONTROL_CYCLE, ended + 2 * CONTROL_CYCLE + 1);
    assert_eq!(found(&log), []);
}

#[test]
fn a_silence_without_a_timely_restart_is_a_violation() {
    let log = Plan::new(3, 60).log();
    let ended = log.events[repeats(&log)[40]].at;
    for (cycles, violations) in [(4, vec![(BusyTwice, 1)]), (9, vec![(Silent, 1)])] {
        let mut log = log.clone();
        blind(&mut log, ended, u64::MAX);
        let over = ended + cycles * CONTROL_CYCLE;
        log.events.retain(|event| event.at <= over || event.what == What::End);
        log.events.last_mut().unwrap().at = over;
        assert_eq!(found(&log), violations, "{cycles}");
    }
    let first = log.events[repeats(&log)[10]].at;
    for (silence, violations) in [(120 * MS, vec![]), (140 * MS, vec![(Silent, 1)])] {
        let mut log = log.clone();
        blind(&mut log, first, first + silence);
        insert(&mut log, first + silence - 2 * MS, dpr_reset(false));
        assert_eq!(found(&log), violations, "{silence}");
    }
}

#[test]
fn a_dpr_that_stops_publishing_falls_silent_and_that_is_one_violation() {
    for (gap, violations) in [(24, vec![]), (36, vec![(BusyTwice, 1)]), (70, vec![(Silent, 1)])] {
        let mut plan = Plan::new(3, 60);
        let from = plan.publications[plan.showing(300)].at;
        plan.publications.retain(|publication| !(from + 1..from + gap * MS).contains(&publication.at));
        assert_eq!(found(&plan.log()), violations, "{gap}");
    }
}

#[test]
fn the_dpr_may_hold_its_buffers_once_an_image_has_expired() {
    let mut plan = Plan::new(3, 60);
    let from = plan.publications[plan.showing(300)].at;
    plan.publications.retain(|publication| !(from + 1..from + 34 * MS).contains(&publication.at));
    plan.selects.retain(|selected| !(from + 20 * MS..from + 39 * MS).contains(selected));
    let log = plan.log();
    assert_eq!(found(&log), []);
    // The DPR's clock may be fast, so the image may expire `bounds::EXPIRY_EARLIEST` after FRESH, but no earlier.
    for (after, violations) in [(bounds::EXPIRY_EARLIEST, vec![]), (bounds::EXPIRY_EARLIEST - 1, vec![(HeldBack, 1)])] {
        let log = moved(&log, from + bounds::EXPIRY, from + after, &[SsiEvent::Held]);
        assert_eq!(found(&log), violations, "{after}");
    }
}

#[test]
fn an_spis_that_serves_0xff_throughout_is_silent_too() {
    let mut log = Plan::new(3, 60).log();
    let ended = log.events[repeats(&log)[40]].at;
    blind(&mut log, ended, ended + 40 * MS);
    log.events.retain(|event| event.at < 20 * MS || event.what != What::Ssi(SsiEvent::Busy));
    assert_eq!(found(&log), [(Silent, 1)]);
}

#[test]
fn a_short_transaction_counts_as_busy_only_with_a_busy_event() {
    let plan = Plan::new(3, 60);
    for (bytes, busy, violations) in
        [(31, false, vec![]), (0, false, vec![]), (32, false, vec![(BusyTwice, 1)]), (1, true, vec![(BusyTwice, 1)])]
    {
        let mut log = plan.log();
        let ended = log.events[repeats(&log)[40]].at;
        let quiet = ended + 500_000..ended + CONTROL_CYCLE - 500_000;
        for count in 0..2 {
            let at = quiet.start + 100_000 * count;
            insert(&mut log, at, What::Selected);
            if busy {
                insert(&mut log, at, What::Ssi(SsiEvent::Busy));
            }
            let miso = vec![0xFF; bytes].into();
            insert(&mut log, at + 40_000, What::Ssi(SsiEvent::Held));
            insert(&mut log, at + 40_000, What::Transaction { selected: at, mosi: vec![].into(), miso });
            insert(&mut log, at + 42_000, What::Ssi(SsiEvent::Released));
            insert(&mut log, at + 42_000, What::Ssi(SsiEvent::Ready));
        }
        assert_eq!(found(&log), violations, "{bytes}");
    }
}

#[test]
fn readiness_is_owed_from_the_end_of_the_pause() {
    let log = Plan::new(3, 60).log();
    let ready = log.events[repeats(&log)[40]].at + TO_READY;
    for (ended_after, ready_after, violations) in [
        (1, bounds::SSI_PAUSE + bounds::SSI_READY, vec![]),
        (1, bounds::SSI_PAUSE + bounds::SSI_READY + 1, vec![(NotReady, 1)]),
        (bounds::SSI_PAUSE, bounds::SSI_PAUSE + bounds::SSI_READY, vec![]),
        (bounds::SSI_PAUSE + 1, bounds::SSI_PAUSE + bounds::SSI_READY + 2, vec![(NotReady, 1)]),
    ] {
        let mut log = log.clone();
        let ended = ready + ended_after;
        insert(&mut log, ready, What::Selected);
        insert(&mut log, ended, What::Ssi(SsiEvent::Held));
        insert(&mut log, ended, What::Transaction { selected: ready, mosi: vec![].into(), miso: vec![].into() });
        for event in [SsiEvent::Released, SsiEvent::Ready] {
            insert(&mut log, ready + ready_after, What::Ssi(event));
        }
        assert_eq!(found(&log), violations, "{ended_after} {ready_after}");
    }
}

#[test]
fn a_runaway_flight_controller_must_be_served_up_to_the_budget() {
    let plan = Plan::new(1, 60);
    let gap = plan.publications[plan.showing(300)].at + 400_000;
    for (served, violations) in [(bounds::SSI_BUDGET, vec![]), (bounds::SSI_BUDGET - 1, vec![(NotReady, 1)])] {
        let mut plan = plan.clone();
        plan.selects.retain(|selected| !(gap - 800_000..gap + 10 * MS).contains(selected));
        let mut log = plan.log();
        let image = plan.publications[plan.showing(300)].image.clone();
        let at = |number: u32| gap + 180_000 * u64::from(number);
        for number in 0..served {
            let (at, ended) = (at(number), at(number) + 160_000);
            insert(&mut log, at, What::Selected);
            insert(&mut log, ended, What::Ssi(SsiEvent::Held));
            let what = What::Transaction { selected: at, mosi: vec![0; 8].into(), miso: image.clone().into() };
            insert(&mut log, ended, what);
            if number + 1 < served {
                insert(&mut log, ended + TO_READY, What::Ssi(SsiEvent::Released));
                insert(&mut log, ended + TO_READY, What::Ssi(SsiEvent::Ready));
            }
        }
        for number in served..served + 10 {
            let at = at(number);
            insert(&mut log, at, What::Selected);
            insert(&mut log, at, What::Ssi(SsiEvent::Busy));
            let what = What::Transaction { selected: at, mosi: vec![0; 8].into(), miso: vec![0xFF; 156].into() };
            insert(&mut log, at + 160_000, what);
        }
        let profile = image[32..].to_vec();
        log.events.retain(|event| match &event.what {
            What::Forwarded { profile: other } | What::Arrived { profile: other, .. } => **other != *profile,
            _ => true,
        });
        assert_eq!(found(&log), violations, "{served}");
    }
}

#[test]
fn a_silence_is_longer_than_an_image_lives() {
    for (longer, violation) in [(0, BusyTwice), (1, Silent)] {
        let mut plan = Plan::new(3, 60);
        let from = plan.publications[plan.showing(300)].at + MS;
        plan.selects.retain(|selected| !(from - 500_000..from + 26 * MS).contains(selected));
        let silent = [from, from + 12 * MS, from + bounds::EXPIRY + longer];
        plan.selects.extend(silent);
        plan.selects.sort_unstable();
        let mut log = plan.log();
        blind(&mut log, from, from + bounds::EXPIRY + MS);
        assert_eq!(found(&log), [(violation, 1)], "{longer}");
        let words = &judged(&log).violations[0].words;
        assert!(violation == BusyTwice || words.starts_with("3 transactions in 25000001 ns"), "{words}");
    }
}

#[test]
fn a_silence_before_a_restart_may_last_expiry_plus_start() {
    for (longer, violations) in [(0, vec![]), (1, vec![(Silent, 1)])] {
        let mut plan = Plan::new(3, 60);
        let first = plan.publications[plan.showing(300)].at + MS;
        let last = first + bounds::EXPIRY + bounds::START + longer;
        plan.selects.retain(|selected| [first, last].iter().all(|at| selected.abs_diff(*at) > MS));
        plan.selects.extend([first, last]);
        plan.selects.sort_unstable();
        let mut log = plan.log();
        let over = last + plan.transaction_ns() + 1;
        blind(&mut log, first, over);
        log.events.retain(|event| event.at <= over);
        insert(&mut log, over, dpr_reset(false));
        insert(&mut log, over, What::End);
        assert_eq!(found(&log), violations, "{longer}");
    }
}

fn never_ready(events: impl IntoIterator<Item = (u64, What)>) -> bool {
    let mut log = Plan::new(3, 0).log();
    log.events.clear();
    events.into_iter().for_each(|(at, what)| insert(&mut log, at, what));
    found(&log).contains(&(NeverReady, 1))
}

#[test]
fn a_dpr_selected_for_over_a_cycle_need_not_get_ready() {
    let transaction =
        |selected: u64| What::Transaction { selected, mosi: vec![0; 96].into(), miso: vec![0xFF; 96].into() };
    let due = bounds::START;
    for (longer, blamed) in [(0, true), (1, false)] {
        // In the changed log, the flight controller keeps the DPR selected until after the longest time for the DPR's
        // start.
        let began = due + 1 - CYCLE - longer;
        let selected = [(began, What::Selected), (due + 1, What::Tick), (due + MS, What::End)];
        assert_eq!(never_ready(selected), blamed, "selected, {longer}");
        let ended = due - 5_000;
        let began = ended - CYCLE - longer;
        let let_go = |after: u64| {
            never_ready([(began, What::Selected), (ended, transaction(began)), (ended + after, What::End)])
        };
        assert_eq!(let_go(bounds::SSI_READY), blamed, "let go, {longer}");
        assert!(let_go(bounds::SSI_READY + 1), "it has to be ready after that");
    }
}

#[test]
fn a_transaction_at_the_first_readiness_must_be_followed_by_readiness() {
    let mut plan = Plan::new(3, 20);
    let ready = FIRST_IMAGE + RELEASED_AFTER;
    plan.selects.retain(|selected| *selected > ready + MS);
    plan.selects.insert(0, ready);
    let log = plan.log();
    assert_eq!(found(&log), []);
    let ended = ready + plan.transaction_ns();
    let late = ended + bounds::SSI_READY + 1;
    let log = moved(&log, ended + TO_READY, late, &[SsiEvent::Released, SsiEvent::Ready]);
    assert_eq!(found(&log), [(NotReady, 1)]);
}

#[test]
fn a_dpr_that_restarts_while_selected_may_hold_its_buffers() {
    for (longer, violations) in [(0, vec![]), (1, vec![(HeldBack, 1)])] {
        let mut plan = Plan::new(3, 60);
        let held = plan.selects.iter().copied().find(|selected| *selected > 260 * MS).unwrap();
        let let_go = 400 * MS;
        plan.selects.retain(|selected| *selected <= held || *selected > let_go + MS);
        let mut log = plan.log();
        insert(&mut log, held - 1, injected(MISUSE, let_go));
        blind(&mut log, held, let_go);
        let of_dpr = |what: &What| matches!(what, What::Fresh { .. } | What::Ssi(_));
        log.events.retain(|event| !(held..let_go).contains(&event.at) || !of_dpr(&event.what));
        for event in &mut log.events {
            if matches!(event.what, What::Transaction { selected, .. } if selected == held) {
                event.at = let_go - MS;
            }
        }
        sort(&mut log);
        insert(&mut log, held + MS, dpr_reset(true));
        insert(&mut log, held + 20 * MS, What::Ssi(SsiEvent::Ready));
        insert(&mut log, held + 30 * MS, What::Ssi(SsiEvent::Held));
        let released = held + 30 * MS + bounds::SSI_READY + longer;
        insert(&mut log, released, What::Ssi(SsiEvent::Released));
        insert(&mut log, released, What::Ssi(SsiEvent::Ready));
        let found: Vec<_> = found(&log).into_iter().filter(|(violation, _)| *violation == HeldBack).collect();
        assert_eq!(found, violations, "{longer}");
    }
}

#[test]
fn a_restart_of_the_dpr_keeps_supply_violations_and_figures() {
    let power = |on| What::Power { board: Board::Dpr, on };
    let mut log = restarted(250 * MS, BACK + 10 * CYCLE, &[power(false)]);
    insert(&mut log, 260 * MS, dpr_reset(true));
    insert(&mut log, 440 * MS, power(true));
    assert_eq!(found(&log), []);
    // A restart in a period without transactions causes no second violation.
    let mut log = without_transactions(251 * MS, 450 * MS).log();
    insert(&mut log, 400 * MS, dpr_reset(true));
    assert_eq!(found(&log), [(NoTransaction, 1)]);
    let log = restarted(250 * MS, BACK, &[dpr_reset(true)]);
    let place = repeats(&log)[10];
    let ended = log.events[place].at;
    assert!(ended < 250 * MS);
    let log = moved(&log, ended + TO_READY, ended + 9_000, &[SsiEvent::Released, SsiEvent::Ready]);
    assert_eq!(judged(&log).figures.ready_ns, Some(Max { max: 9_000 }));
}

fn is_unserved(log: &bench_judge::Log) -> bool {
    bench_judge::judge(log).kinds().any(|kind| kind == Unserved)
}

#[test]
fn a_transaction_must_be_served_while_an_image_is_readable() {
    let nothing = || {
        let log = Plan::new(3, 40).log();
        let rises: Vec<u64> = log
            .events
            .iter()
            .filter(|event| matches!(event.what, What::Fresh { high: true, .. }))
            .map(|event| event.at)
            .collect();
        let since = |at: u64| rises.iter().filter(|rose| **rose <= at).map(|rose| at - rose).min();
        let mut log = log;
        let repeats = |event: &Event| match event.what {
            What::Transaction { selected, .. } if selected > 200 * MS => since(selected).is_some_and(|it| it > 4 * MS),
            _ => false,
        };
        let place = log.events.iter().position(repeats).unwrap();
        let What::Transaction { selected, miso, .. } = &mut log.events[place].what else { unreachable!("it is one") };
        miso.0.fill(0xFF);
        let selected = *selected;
        (log, selected)
    };
    let (log, _) = nothing();
    assert!(is_unserved(&log) && !is_unserved(&Plan::new(3, 40).log()));
    // In the changed log, FRESH rises again just before or within a transaction that finds the DPR busy.
    for (apart, unserved) in [(bounds::SSI_READY, false), (bounds::SSI_READY + 1, true)] {
        for within in [false, true] {
            let (mut log, selected) = nothing();
            let at = if within { selected + apart } else { selected - apart };
            insert(&mut log, at, What::Fresh { high: true, offered: None });
            assert_eq!(is_unserved(&log), unserved, "{apart} ns, within: {within}");
        }
    }
}
