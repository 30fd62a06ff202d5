//! Tests what each disturbance excuses, and what it does not excuse.

use crate::common;

use bench_judge::{Board, Context, Disturbance, Event, Header, Log, Violation, What, bounds, judge};
use common::{DPR_FRONT_END, HORUS_FRONT_END, MISUSE, Plan, injected, insert, judged, sort, transactions};
use profile::Layout;
use profile::air::{CRC_BYTES, LEN_BYTES};

const MS: u64 = 1_000_000;

/// Returns the violations without `BaseChanged`, which follows because the tests change what was read but not what was
/// forwarded.
fn found(log: &Log) -> Vec<(Violation, u64)> {
    common::found(log).into_iter().filter(|(violation, _)| *violation != Violation::BaseChanged).collect()
}

fn read_by_wrong_clocks(from: u64, to: u64) -> Log {
    let mut log = Plan::new(3, 60).log();
    for (_, miso) in transactions(&mut log).filter(|(selected, _)| (from..to).contains(selected)) {
        miso.iter_mut().for_each(|byte| *byte ^= 0x10);
    }
    log
}

#[test]
fn misuse_of_the_ssi_excuses_damaged_reads_until_shortly_after_it() {
    let (from, until) = (300 * MS, 400 * MS);
    let over = until + bounds::MISUSE_OVER;
    let mut log = read_by_wrong_clocks(from, over);
    assert!(found(&log).contains(&(Violation::Damaged, 30)), "{:?}", found(&log));
    insert(&mut log, from, injected(MISUSE, until));
    assert_eq!(found(&log), []);
    let mut log = read_by_wrong_clocks(from, over + 5 * MS);
    insert(&mut log, from, injected(MISUSE, until));
    assert_eq!(found(&log), [(Violation::Damaged, 1)]);
    for (sooner, violations) in [(1, vec![]), (0, vec![(Violation::Damaged, 1)])] {
        let mut plan = Plan::new(3, 60);
        plan.selects.retain(|selected| selected.abs_diff(over) > 2 * MS);
        plan.selects.push(over - sooner);
        plan.selects.sort_unstable();
        let mut log = plan.log();
        for (_, miso) in transactions(&mut log).filter(|(selected, _)| *selected == over - sooner) {
            miso.iter_mut().for_each(|byte| *byte ^= 0x10);
        }
        insert(&mut log, from, injected(MISUSE, until));
        assert_eq!(found(&log), violations, "{sooner}");
    }
    // A disturbance of the air does not excuse damage on the SSI.
    let mut log = read_by_wrong_clocks(from, over);
    insert(&mut log, from, injected(Disturbance::Air, until));
    assert_eq!(found(&log), [(Violation::Damaged, 30)]);
}

#[test]
fn misuse_of_the_ssi_excuses_the_dprs_silence() {
    let silent = |kind: Option<Disturbance>| {
        let mut log = Plan::new(3, 60).log();
        for (selected, miso) in transactions(&mut log) {
            if (300 * MS..380 * MS).contains(&selected) {
                miso.fill(0xFF);
            }
        }
        if let Some(kind) = kind {
            insert(&mut log, 299 * MS, injected(kind, 380 * MS));
        }
        found(&log)
    };
    assert_eq!(silent(None), [(Violation::Silent, 1)]);
    assert_eq!(silent(Some(MISUSE)), []);
}

#[test]
fn a_transaction_begun_before_the_dpr_was_ready_demands_no_readiness() {
    let mut plan = Plan::new(3, 20);
    let took = plan.transaction_ns();
    let first = plan.publications[0].at;
    plan.selects.retain(|at| *at > first + 2 * MS);
    let mut log = plan.log();
    let selected = first - took / 2;
    let whole = vec![0xFF; 276];
    insert(&mut log, selected, What::Selected);
    let ended = What::Transaction { selected, mosi: vec![0; 276].into(), miso: whole.into() };
    insert(&mut log, selected + took, ended);
    sort(&mut log);
    assert_eq!(found(&log), []);
}

#[test]
fn images_of_one_millisecond_with_different_counters_are_distinct() {
    let mut plan = Plan::new(3, 40);
    let place = plan.showing(200);
    let publication = plan.publications[place].clone();
    // The DPR publishes two images without objects, 300 µs apart. The second counts one more rejected object.
    let values = |rejected| profile::LinkValues { objects_rejected: rejected, ..profile::LinkValues::default() };
    let at = publication.at;
    plan.publications[place].image = plan.image(at, None, values(50));
    let mut second = publication.clone();
    second.at = at + 300_000;
    second.image = plan.image(at, None, values(51));
    plan.publications.insert(place + 1, second);
    assert_eq!(found(&plan.log()), []);
}

fn heard(log: &mut Log, at: u64, change: impl Fn(&mut Vec<u8>, &mut bool)) {
    let event = log.events.iter_mut().find(|event| event.at >= at && matches!(event.what, What::Heard { .. }));
    if let Some(Event { what: What::Heard { bytes, whole, .. }, .. }) = event {
        change(&mut bytes.0, whole);
    }
}

#[test]
fn a_damaged_length_allows_the_latency_of_a_frame_stored_whole() {
    for (gps, waits) in [(3, 0), (5, bounds::SECOND_FRAME)] {
        for (late, violations) in [(0, vec![]), (1, vec![(Violation::LateReadable, 1)])] {
            let mut plan = Plan::new(gps, 40);
            let place = plan.showing(200);
            let ended = plan.publications[place].at - common::TO_FRESH;
            plan.publications[place].at = ended + bounds::STORE_AND_FORWARD + waits + late;
            // A transaction close to the publication would delay it, so there is none.
            let at = plan.publications[place].at;
            plan.selects.retain(|selected| !(at - 2 * MS..at + MS).contains(selected));
            let mut log = plan.log();
            let sound = found(&log);
            assert_eq!(sound.first().map(|(violation, _)| *violation), Some(Violation::LateReadable), "{gps}");
            heard(&mut log, ended, |bytes, _| bytes[0] ^= 0x40);
            assert_eq!(found(&log), violations, "{gps} {late}");
            let figures = judged(&log).figures;
            assert!(figures.last_bit_to_readable.unwrap().max <= bounds::LAST_BIT_TO_READABLE, "it is no figure");
        }
    }
}

fn objects_of(bytes: usize, whole: bool) -> (Option<usize>, usize) {
    let layout = Layout::for_receivers(1).unwrap();
    let frame = common::frame(&common::profile(1, 70));
    assert_eq!(frame.len(), LEN_BYTES + layout.profile_len() + CRC_BYTES);
    let mut context =
        Context::new(&Header { version: Header::VERSION, gps: 1, seed: 0, clock: "fast".into(), hold: false });
    let what = What::Heard { started: 0, bytes: frame[..bytes].to_vec().into(), whole };
    context.take(&Event { at: 9, what });
    let frame = context.frame().unwrap();
    (frame.number, frame.objects.len())
}

#[test]
fn a_broken_off_frame_counts_if_every_announced_byte_arrived() {
    let layout = Layout::for_receivers(1).unwrap();
    let announced = LEN_BYTES + layout.profile_len();
    assert_eq!(objects_of(announced + CRC_BYTES, true), (Some(0), 2));
    assert_eq!(objects_of(announced + 1, false), (Some(0), 2));
    assert_eq!(objects_of(announced, false), (Some(0), 2));
    assert_eq!(objects_of(announced - 1, false), (None, 0));
    assert_eq!(objects_of(announced, true), (None, 0), "a whole frame ends with its CRC-16");
    assert_eq!(objects_of(0, false), (None, 0));
}

#[test]
fn a_front_end_fault_excuses_misuse_and_field_drops_until_recovery() {
    let kinds = |log: &Log| judge(log).kinds().collect::<Vec<_>>();
    const ENDS: u64 = 100 * MS;
    for (kind, horus, dpr) in [
        (HORUS_FRONT_END, true, false),
        (DPR_FRONT_END, false, true),
        (Disturbance::Supply { board: Board::Horus }, true, false),
        (Disturbance::Restart { board: Board::Horus }, false, false),
        (Disturbance::Air, false, false),
    ] {
        for (board, excused) in [(Board::Horus, horus), (Board::Dpr, dpr)] {
            for (at, excused) in
                [(ENDS + bounds::FRONT_END_RECOVERY - 1, excused), (ENDS + bounds::FRONT_END_RECOVERY, false)]
            {
                let mut log = Plan::new(3, 40).log();
                insert(&mut log, ENDS, injected(kind, ENDS));
                insert(&mut log, at, What::Misuse { board, text: "SPI access without supply".into() });
                let found = kinds(&log).contains(&Violation::FrontEndMisuse);
                assert_eq!(!found, excused, "{kind:?}: {board:?} at {at}");
            }
        }
    }
    let dropped = |kind: Disturbance, until| {
        let mut log = Plan::new(3, 40).log();
        insert(&mut log, 299 * MS, injected(kind, until));
        // The field goes off for a moment between two frames, just before the tick at 300 ms.
        insert(&mut log, 299 * MS + 1, What::Field { on: false });
        insert(&mut log, 299 * MS + 2, What::Field { on: true });
        kinds(&log).contains(&Violation::FieldDropped)
    };
    assert!(dropped(DPR_FRONT_END, 299 * MS));
    assert!(!dropped(HORUS_FRONT_END, 299 * MS));
    // A fault of the front end is excused until the firmware has brought the front end up again.
    let before = |ns| 299 * MS + 1 - bounds::FRONT_END_RECOVERY - ns;
    let mut log = Plan::new(3, 40).log();
    for (ns, blamed) in [(0, true), (1, true)] {
        let mut log = log.clone();
        insert(&mut log, before(ns), injected(HORUS_FRONT_END, before(ns)));
        insert(&mut log, 299 * MS + 1, What::Field { on: false });
        assert_eq!(kinds(&log).contains(&Violation::FieldDropped), blamed, "{ns}");
    }
    insert(&mut log, before(0) + 1, injected(HORUS_FRONT_END, before(0) + 1));
    insert(&mut log, 299 * MS + 1, What::Field { on: false });
    assert!(!kinds(&log).contains(&Violation::FieldDropped));
}

#[test]
fn broken_code_of_a_firmware_explains_none_of_its_complaints() {
    let complaint = || What::Counter { board: Board::Horus, name: "rf_faults".into(), value: Some(2) };
    for (kind, blamed) in [
        (Disturbance::Code { board: Board::Horus }, true),
        (Disturbance::Air, true),
        (HORUS_FRONT_END, false),
        (Disturbance::Receiver { receiver: 0 }, false),
    ] {
        let mut log = Plan::new(3, 40).log();
        insert(&mut log, 100 * MS, injected(kind, 100 * MS));
        let end = log.events.last().unwrap().at;
        insert(&mut log, end, complaint());
        let complains = judge(&log).kinds().any(|violation| violation == Violation::HorusComplains);
        assert_eq!(complains, blamed, "{kind:?}");
    }
}

#[test]
fn a_frame_lost_with_the_front_ends_supply_is_excused() {
    let lost = |after: u64, kind: Disturbance| {
        let plan = Plan::new(3, 60);
        let place = plan.showing(300);
        let ended = plan.publications[place].at - common::TO_FRESH;
        let mut log = plan.log();
        // The frames with the timestamp 300 ms reach the antenna, but no image contains their objects.
        let layout = Layout::for_receivers(3).unwrap();
        let shown = |bytes: &[u8]| bytes[layout.in_image(0).unwrap()].starts_with(&300_u32.to_le_bytes());
        for (_, miso) in transactions(&mut log).filter(|(_, miso)| shown(miso)) {
            miso[32..].fill(0);
        }
        insert(&mut log, ended + after, injected(kind, ended + after));
        judge(&log).kinds().any(|violation| violation == Violation::NotShown || violation == Violation::Vacant)
    };
    assert!(!lost(10_000, DPR_FRONT_END));
    assert!(!lost(bounds::STORE_AND_FORWARD - 1, DPR_FRONT_END));
    assert!(lost(bounds::STORE_AND_FORWARD, DPR_FRONT_END));
    assert!(lost(10_000, Disturbance::Air));
}
