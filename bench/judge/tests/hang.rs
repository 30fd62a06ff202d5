//! Tests the judge of a DPR that hangs. The DPR need not serve the SSI, but the bytes that are read must be right.

use crate::common;

use bench_judge::{Board, Disturbance, Event, Log, SsiEvent, Violation, Violation::*, What, bounds};
use common::*;

const MS: u64 = 1_000_000;
const RESTARTS: u64 = 330 * MS;
const BACK: u64 = 344_950_000;

fn hung() -> What {
    What::Hung { board: Board::Dpr }
}

fn silent(plan: &Plan, from: u64) -> Log {
    let mut log = plan.log();
    blind(&mut log, from, BACK);
    let of_dpr = |what: &What| matches!(what, What::Fresh { .. } | What::Ssi(_));
    log.events.retain(|event| !(from..BACK).contains(&event.at) || !of_dpr(&event.what));
    insert(&mut log, RESTARTS, dpr_reset(true));
    log
}

const DEAD: Disturbance = Disturbance::DeadTask { board: Board::Dpr, task: 0 };

fn judged_at(log: &Log, at: u64) -> Vec<(Violation, u64)> {
    judged_with(log, at, hung())
}

fn judged_dead_at(log: &Log, at: u64) -> Vec<(Violation, u64)> {
    judged_with(log, at, What::Injected { kind: "dead task".into(), disturbs: DEAD, until: at })
}

fn judged_with(log: &Log, at: u64, what: What) -> Vec<(Violation, u64)> {
    let mut log = log.clone();
    insert(&mut log, at, what);
    found(&log)
}

#[test]
fn a_hang_of_the_dpr_excuses_what_it_does_not_serve() {
    for from in [250 * MS, 253 * MS, 256 * MS, 259 * MS] {
        let mut log = silent(&Plan::new(3, 60), from);
        assert_eq!(judged_at(&log, from), [], "{from}");
        let horus = What::Hung { board: Board::Horus };
        let restart =
            log.events.iter().position(|event| event.at == RESTARTS && event.what == dpr_reset(true)).unwrap();
        log.events.remove(restart);
        insert(&mut log, from, horus);
        assert_eq!(found(&log), [(Silent, 1)], "{from}");
    }
}

#[test]
fn a_hang_excuses_unserved_transactions_until_the_run_ends() {
    let mut plan = Plan::new(3, 60);
    let first = last_end(&plan.log(), 258 * MS);
    plan.end = first + 90 * MS;
    plan.selects.retain(|selected| *selected < plan.end - MS);
    let mut log = plan.log();
    blind(&mut log, first + 1, plan.end);
    log.events.retain(|event| event.at < first || !matches!(event.what, What::Fresh { .. } | What::Ssi(_)));
    assert_eq!(judged_at(&log, first - MS), []);
    let told: Vec<Violation> = found(&log).into_iter().map(|(violation, _)| violation).collect();
    assert!(told.contains(&Silent), "{told:?}");
    log.events.retain(|event| {
        event.at <= first || !matches!(event.what, What::Selected | What::Transaction { .. } | What::Ssi(_))
    });
    assert_eq!(judged_at(&log, first - MS), []);
    assert_eq!(found(&log), [(NotReady, 1)]);
}

fn last_end(log: &Log, before: u64) -> u64 {
    let is_end = |event: &&Event| matches!(event.what, What::Transaction { .. }) && event.at < before;
    log.events.iter().rfind(is_end).unwrap().at
}

#[test]
fn what_had_waited_too_long_when_the_dpr_hung_is_told() {
    // In the changed log, the DPR keeps the buffers too long, after a transaction or without one.
    let log = Plan::new(3, 60).log();
    let ended = last_end(&log, 258 * MS);
    let unready = silent(&Plan::new(3, 60), ended + 1);
    for judged in [judged_at, judged_dead_at] {
        assert_eq!(judged(&unready, ended + bounds::SSI_READY), []);
        assert_eq!(judged(&unready, ended + bounds::SSI_READY + 1), [(NotReady, 1)]);
    }
    let mut held = silent(&Plan::new(3, 60), ended + 100_000);
    insert(&mut held, ended + 110_000, What::Ssi(SsiEvent::Held));
    for judged in [judged_at, judged_dead_at] {
        assert_eq!(judged(&held, ended + 110_000 + bounds::SSI_READY), []);
        assert_eq!(judged(&held, ended + 110_000 + bounds::SSI_READY + 1), [(HeldBack, 1)]);
    }
}

#[test]
fn two_busy_transactions_before_a_hang_are_still_a_violation() {
    let log = Plan::new(3, 60).log();
    let first = last_end(&log, 258 * MS);
    let second = last_end(&log, first + 5 * MS);
    let mut busy = log.clone();
    blind(&mut busy, first, BACK);
    let hangs = |at: u64| {
        let mut busy = busy.clone();
        let of_dpr = |what: &What| {
            matches!(what, What::Fresh { .. } | What::Ssi(SsiEvent::Held | SsiEvent::Released | SsiEvent::Ready))
        };
        busy.events.retain(|event| !(at..BACK).contains(&event.at) || !of_dpr(&event.what));
        insert(&mut busy, RESTARTS, dpr_reset(true));
        judged_at(&busy, at)
    };
    assert_eq!(hangs(first + MS), [], "one may");
    assert_eq!(hangs(second + MS), [(BusyTwice, 1)]);
}

#[test]
fn what_is_read_of_a_dpr_that_hangs_is_judged() {
    let plan = Plan::new(3, 60);
    let from = 258 * MS;
    let torn = |change: fn(&mut Vec<u8>)| {
        let mut log = plan.log();
        let place =
            log.events.iter().position(|event| event.at > from && matches!(event.what, What::Transaction { .. }));
        let (at, place) = (log.events[place.unwrap()].at, place.unwrap());
        let mut bytes = miso(&mut log, place).clone();
        change(&mut bytes);
        let mut silenced = silent(&plan, at + 1);
        silenced.events.retain(|event| {
            !matches!(event.what, What::Forwarded { .. } | What::Arrived { .. }) || event.at < from || event.at > BACK
        });
        for (_, miso) in transactions(&mut silenced).filter(|(selected, _)| *selected > from && *selected < at) {
            miso.clone_from(&bytes);
        }
        judged_at(&silenced, from)
    };
    assert_eq!(torn(|_| {}), []);
    assert_eq!(torn(|miso| miso[40] ^= 0x10), [(Damaged, 1)]);
}

#[test]
fn a_dpr_that_hangs_during_its_start_need_not_get_ready() {
    let mut plan = Plan::new(3, 40);
    plan.publications.clear();
    let log = plan.log();
    assert_eq!(found(&log), [(NeverReady, 1)]);
    assert_eq!(judged_at(&log, 50 * MS), []);
    for judged in [judged_at, judged_dead_at] {
        assert_eq!(judged(&log, bounds::START), []);
        assert_eq!(judged(&log, bounds::START + 1), [(NeverReady, 1)]);
    }
    let mut log = log.clone();
    insert(&mut log, 130 * MS, dpr_reset(true));
    assert_eq!(judged_at(&log, 50 * MS), [(NeverReady, 1)], "after its restart");
}

#[test]
fn a_missing_transaction_is_a_violation_even_while_the_dpr_hangs() {
    let mut log = silent(&Plan::new(3, 60), 200 * MS);
    log.events.retain(|event| {
        !(200 * MS..BACK).contains(&event.at)
            || !matches!(event.what, What::Selected | What::Transaction { .. } | What::Ssi(SsiEvent::Busy))
    });
    assert_eq!(judged_at(&log, 200 * MS), [(NoTransaction, 1)]);
}

#[test]
fn a_dpr_that_has_no_supply_does_not_hang() {
    let power = |on| What::Power { board: Board::Dpr, on };
    let mut log = silent(&Plan::new(3, 60), 250 * MS);
    insert(&mut log, 250 * MS, power(false));
    insert(&mut log, 260 * MS, power(true));
    let restart = log.events.iter().position(|event| event.what == dpr_reset(true)).unwrap();
    log.events.remove(restart);
    log.events.retain(|event| event.at < BACK || event.at > 900 * MS || !matches!(event.what, What::Ssi(_)));
    assert_eq!(judged_at(&log, 255 * MS), found(&log), "as if nothing had been said");
}
