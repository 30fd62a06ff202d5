use profile::criticality::{Dpr, Writer};
use profile::{
    Command, CommandObject, Identifier, LinkStatus, LinkValues, PortStatus, PortStatusBits, UplinkValues, Violations,
};

use super::*;
use crate::disturbance::Memory;
use crate::testing::{Events, IMAGE_BIT, MISUSE, MS, header, in_order, injected};
use crate::{Bytes, Disturbance, Header};

/// The time between two transactions, ns. FRESH rises every 10 ms.
const READS: u64 = 4 * MS;

fn uplink(timestamp: u32, byte: u8) -> Vec<u8> {
    let values = UplinkValues { timestamp, payload: [byte; Uplink::PAYLOAD], ..UplinkValues::default() };
    Uplink::seal(Writer::<FlightController>::claim(), &values).as_bytes().to_vec()
}

fn command(timestamp: u32, command: Command) -> Vec<u8> {
    CommandObject::seal(Writer::<FlightController>::claim(), timestamp, command).as_bytes().to_vec()
}

#[derive(Clone, Default)]
struct Shown {
    values: PortValues,
    stored: Option<(Vec<u8>, u64)>,
}

/// Returns a log in which the flight controller writes each object at its instant. `shown` returns the uplinks and
/// Port-Status of the images, which are published every 10 ms.
fn log(written: &[(u64, Vec<u8>)], shown: impl Fn(u64) -> Shown) -> crate::Log {
    log_of(written, &shown)
}

// This function is not generic, so that it is compiled once and not for each closure.
fn log_of(written: &[(u64, Vec<u8>)], shown: &dyn Fn(u64) -> Shown) -> crate::Log {
    let header: Header = header(3);
    let layout = Layout::for_receivers(3).unwrap();
    let mut events = Events::flawless(3, 0);
    for n in 1..40_u64 {
        events.add(n * 10 * MS, What::Fresh { high: true, offered: None });
    }
    for n in 1..98 {
        let selected = n * READS + MS;
        let deselected = selected + MS / 2;
        let published = (selected / (10 * MS)) * 10 * MS;
        let Shown { mut values, stored } = shown(published);
        values.flight_controller_age_ms = stored.as_ref().map_or(u16::MAX, |(_, at)| ((published - at) / MS) as u16);
        values.base_station_age_ms = u16::MAX;
        let fresh = values.flight_controller_age_ms < 500;
        values.status = values.status.with_flight_controller_fresh(fresh);
        let mut miso = vec![0; layout.map_len()];
        miso[layout.port_status()].copy_from_slice(PortStatus::seal(Writer::<Dpr>::claim(), &values).as_bytes());
        if let Some((bytes, _)) = stored.filter(|_| fresh) {
            miso[layout.uplink::<FlightController>()].copy_from_slice(&bytes);
        }
        let mut mosi = vec![0; layout.map_len()];
        for (at, object) in written {
            if (selected..selected + READS).contains(at) {
                mosi[8..8 + object.len()].copy_from_slice(object);
            }
        }
        events.add(deselected, What::Transaction { selected, mosi: Bytes(mosi), miso: Bytes(miso) });
    }
    events.end(395 * MS);
    assert_eq!(events.log().header, header);
    events.log()
}

fn broken(log: &crate::Log) -> Vec<(Violation, u64)> {
    let found = crate::testing::found(PortRule::new(&log.header), log).0;
    found.into_iter().map(|(violation, count, _)| (violation, count)).collect()
}

fn ends(at: u64) -> u64 {
    (at - MS) / READS * READS + MS + MS / 2
}

const AT: u64 = 101 * MS;

fn one(shown_after: u64, change: impl Fn(&mut Shown)) -> Vec<(Violation, u64)> {
    let written = [(AT, uplink(1_000, 7))];
    broken(&log(&written, |published| {
        let mut shown = Shown::default();
        if published >= ends(AT) + (shown_after - 1) * 10 * MS {
            shown.values.uplinks_accepted = 1;
            shown.stored = Some((uplink(1_000, 7), ends(AT)));
            change(&mut shown);
        }
        shown
    }))
}

#[test]
fn an_uplink_shows_in_the_first_or_the_second_image_after_it() {
    assert_eq!(one(1, |_| {}), []);
    assert_eq!(one(2, |_| {}), []);
    assert_eq!(one(3, |_| {})[0].0, Violation::PortStatusWrong);
    let early = log(&[(AT, uplink(1_000, 7))], |published| {
        let mut shown = Shown::default();
        shown.values.uplinks_accepted = u32::from(published >= 60 * MS);
        if published >= ends(AT) {
            shown.values.uplinks_accepted = 2;
            shown.stored = Some((uplink(1_000, 7), ends(AT)));
        }
        shown
    });
    assert_eq!(broken(&early), [(Violation::PortStatusWrong, 1)]);
}

#[test]
fn what_port_status_says_otherwise_is_wrong_once() {
    let changes: [fn(&mut Shown); 5] = [
        |shown| shown.values.uplinks_accepted = 2,
        |shown| shown.values.commands_carried_out = 1,
        |shown| shown.values.last_command = 1,
        |shown| shown.values.violations.count(profile::Violation::TooLong, 1),
        |shown| shown.values.status = PortStatusBits::new().with_last_refused(true),
    ];
    for change in changes {
        assert_eq!(one(1, change), [(Violation::PortStatusWrong, 1)]);
    }
    // Each image that states a failed self-test is reported.
    let failed = one(1, |shown| shown.values.status = PortStatusBits::new().with_self_test_failed(true));
    assert_eq!(failed[0].0, Violation::PortStatusWrong);
}

#[test]
fn an_uplink_that_reads_otherwise_or_as_too_old_is_wrong() {
    for change in [
        (|shown: &mut Shown| shown.stored = Some((uplink(1_000, 8), ends(AT)))) as fn(&mut Shown),
        |shown| shown.stored = Some((uplink(1_000, 7), 10 * MS)),
        |shown| shown.stored = None,
    ] {
        let found = one(1, change);
        assert_eq!(found.iter().map(|(violation, _)| *violation).collect::<Vec<_>>(), [Violation::UplinkWrong]);
    }
}

#[test]
fn every_kind_of_violation_and_every_command_is_followed() {
    let mut damaged = uplink(3_000, 1);
    damaged[20] ^= 1;
    let mut foreign = uplink(3_000, 1);
    foreign[5] = 0x48;
    let seal = profile::crc::frame(&foreign[..60]).to_be_bytes();
    foreign[60..].copy_from_slice(&seal);
    let too_long = [uplink(3_001, 1), vec![1]].concat();
    let kinds = [
        (uplink(1_000, 1), None),
        (uplink(1_000, 1), Some(profile::Violation::UplinkNotNewer)),
        (damaged, Some(profile::Violation::UplinkDamaged)),
        (foreign, Some(profile::Violation::UplinkIdentifier)),
        (command(50, Command::SelfTest), None),
        (command(50, Command::SelfTest), Some(profile::Violation::UplinkNotNewer)),
    ];
    let written: Vec<(u64, Vec<u8>)> =
        (0..).zip(&kinds).map(|(n, (object, _))| (AT + n * 40 * MS, object.clone())).collect();
    let right = |published: u64, leave_out: usize| {
        let mut shown = Shown::default();
        let mut violations = Violations::new();
        let mut running = false;
        for (n, ((at, object), (_, kind))) in written.iter().zip(&kinds).enumerate() {
            if published < ends(*at) {
                break;
            }
            shown.values.status = PortStatusBits::new().with_last_refused(kind.is_some());
            match kind {
                Some(kind) if n != leave_out => violations.count(*kind, 1),
                Some(_) => {}
                None if n == 0 => {
                    shown.values.uplinks_accepted = 1;
                    shown.stored = Some((object.clone(), ends(*at)));
                }
                None => {
                    running = true;
                    shown.values.commands_carried_out = 1;
                    shown.values.last_command_timestamp = 50;
                    shown.values.last_command = Command::SelfTest.word();
                }
            }
        }
        shown.values.violations = violations;
        shown.values.status = shown.values.status.with_self_test_running(running);
        shown
    };
    assert_eq!(broken(&log(&written, |published| right(published, usize::MAX))), []);
    for left_out in [1, 2, 3, 5] {
        let found = broken(&log(&written, |published| right(published, left_out)));
        assert_eq!(found[0].0, Violation::PortStatusWrong, "{left_out}");
    }
    let model = Model::at_start().after(&[vec![0; 8], too_long].concat(), 0, 468);
    assert!(model.iter().all(|model| *model != Model::at_start()));
}

#[test]
fn link_status_counts_the_access_violations_of_all_kinds_and_clears_none() {
    const CLEARED: u64 = 201 * MS;
    let told = |before: u16, after: u16| {
        let clears = command(2_000, Command::ClearCounters);
        let mut log = log(&[(AT, uplink(1_000, 7)[..9].to_vec()), (CLEARED, clears)], |published| {
            let mut shown = Shown::default();
            let cleared = published >= ends(CLEARED);
            let counted = u16::from(published >= ends(AT) && !cleared);
            shown.values.violations.count(profile::Violation::UplinkDamaged, counted);
            shown.values.status = shown.values.status.with_last_refused(counted == 1);
            if cleared {
                shown.values.commands_carried_out = 1;
                shown.values.last_command_timestamp = 2_000;
                shown.values.last_command = Command::ClearCounters.word();
            }
            shown
        });
        for (from, total) in [(AT + 30 * MS, before), (CLEARED + 30 * MS, after), (CLEARED + 50 * MS, after)] {
            let values = LinkValues { access_violations: total, ..LinkValues::default() };
            let read = (from..).find(|at| at % READS == MS).unwrap();
            miso(&mut log, read)[..LinkStatus::SIZE].copy_from_slice(LinkStatus::seal(&values).as_bytes());
        }
        broken(&log)
    };
    assert_eq!(told(1, 1), []);
    assert_eq!(told(1, u16::MAX), [], "it may stay there");
    for (before, after) in [(0, 1), (2, 2), (0, 0)] {
        assert_eq!(told(before, after)[0].0, Violation::LinkCounters, "{before}, {after}");
    }
}

#[test]
fn after_misconduct_port_status_is_believed_once_and_held_against_what_follows() {
    let with = |jump: u32| {
        let mut log = log(&[(301 * MS, uplink(9, 1))], |published| {
            let mut shown = Shown::default();
            shown.values.uplinks_accepted = if published >= 150 * MS { 20 } else { 0 };
            if published >= ends(301 * MS) {
                shown.values.uplinks_accepted += jump;
                shown.stored = Some((uplink(9, 1), ends(301 * MS)));
            }
            shown
        });
        let injected = Event { at: 120 * MS, what: injected(MISUSE, 200 * MS) };
        let place = log.events.partition_point(|event| event.at < injected.at);
        log.events.insert(place, injected);
        broken(&log)
    };
    assert_eq!(with(1), []);
    assert_eq!(with(2), [(Violation::PortStatusWrong, 1)]);
}

#[test]
fn port_status_is_believed_from_the_second_image_after_misconduct_on() {
    // The flight controller's misuse is excused until 220 ms, and images show the effects of excused transactions until
    // 230 ms.
    let counted_from = |from: u64| {
        let mut log = log(&[], |published| {
            let mut shown = Shown::default();
            shown.values.violations.count(profile::Violation::TooMany, u16::from(published >= from * MS));
            shown
        });
        insert(&mut log, 120 * MS, injected(MISUSE, 200 * MS));
        broken(&log)
    };
    assert_eq!(counted_from(230), []);
    assert_eq!(counted_from(240), [(Violation::PortStatusWrong, 1)]);
}

#[test]
fn no_port_status_is_believed_while_an_images_bit_is_hit() {
    let with = |disturbs| {
        let mut log = log(&[], |published| {
            let mut shown = Shown::default();
            shown.values.violations.count(profile::Violation::TooMany, if published >= 240 * MS { 2 } else { 1 });
            shown
        });
        insert(&mut log, 5 * MS, injected(MISUSE, 200 * MS));
        insert(&mut log, 110 * MS, injected(disturbs, 245 * MS));
        broken(&log)
    };
    assert_eq!(with(IMAGE_BIT), []);
    assert_eq!(with(Disturbance::Air), [(Violation::PortStatusWrong, 1)]);
}

#[test]
fn after_misconduct_counters_are_bounded_by_the_transactions() {
    use profile::Violation::{TooLong, TooMany};
    let after = |change: &dyn Fn(&mut PortValues)| {
        let mut log = log(&[], |published| {
            let mut shown = Shown::default();
            if published >= 150 * MS {
                change(&mut shown.values);
            }
            shown
        });
        insert(&mut log, 120 * MS, injected(MISUSE, 200 * MS));
        broken(&log)
    };
    // At most 29 transactions fit between the end of the excuse and the first accepted Port-Status. The transactions
    // before, as many as the budget of two images allows, may be counted late.
    const MOST: u16 = 29 + 2 * bounds::SSI_BUDGET as u16;
    let wrong = [(Violation::PortStatusWrong, 1)];
    assert_eq!(after(&|values| values.violations.count(TooMany, 2 * MOST)), []);
    assert_eq!(after(&|values| values.violations.count(TooMany, 2 * MOST + 1)), wrong);
    assert_eq!(after(&|values| values.violations.count(TooLong, MOST)), []);
    assert_eq!(after(&|values| values.violations.count(TooLong, MOST + 1)), wrong);
    assert_eq!(after(&|values| values.uplinks_accepted = u32::from(MOST)), []);
    assert_eq!(after(&|values| values.uplinks_accepted = u32::from(MOST) + 1), wrong);
    assert_eq!(after(&|values| values.commands_carried_out = u32::from(MOST) + 1), wrong);
    // In this log Port-Status names a last command but counts no command.
    assert_eq!(after(&|values| values.last_command_timestamp = 7), wrong);
}

#[test]
fn counters_may_fall_during_misconduct_where_the_last_command_is_another() {
    let told = |uplinks_accepted, commands_carried_out, last_command_timestamp| PortValues {
        uplinks_accepted,
        commands_carried_out,
        last_command_timestamp,
        ..PortValues::default()
    };
    assert!(may_follow(&told(15, 1, 7), &told(1, 1, 8), 0));
    assert!(may_follow(&told(15, 2, 7), &told(1, 1, 8), 0));
    assert!(!may_follow(&told(15, 1, 7), &told(14, 1, 7), 0));
    assert!(!may_follow(&told(15, 1, 7), &told(0, 0, 8), 0));
}

fn insert(log: &mut crate::Log, at: u64, what: What) {
    let place = log.events.partition_point(|event| (event.at, event.what.rank()) <= (at, what.rank()));
    log.events.insert(place, Event { at, what });
}

fn miso(log: &mut crate::Log, at: u64) -> &mut Vec<u8> {
    let mut read = log.events.iter_mut().filter_map(|event| match &mut event.what {
        What::Transaction { selected, miso, .. } if *selected == at => Some(&mut miso.0),
        _ => None,
    });
    read.next().expect("a transaction")
}

fn uplink_shown_from(from: u64) -> crate::Log {
    log(&[(AT, uplink(1_000, 7))], |published| {
        let mut shown = Shown::default();
        if published >= from {
            shown.values.uplinks_accepted = 1;
            shown.stored = Some((uplink(1_000, 7), ends(AT)));
        }
        shown
    })
}

/// The instant, ns, at which chip select falls for a transaction that writes nothing.
const READ: u64 = 205 * MS;

#[test]
fn each_start_of_the_dpr_clears_what_it_has_accepted() {
    // Before its first start the DPR has received nothing, so every counter above zero is wrong.
    let counted = |accepted| {
        broken(&log(&[], |_| {
            let mut shown = Shown::default();
            shown.values.uplinks_accepted = accepted;
            shown
        }))
    };
    assert_eq!(counted(0), []);
    assert_eq!(counted(5), [(Violation::PortStatusWrong, 1)]);
    let restart = READ + MS;
    let forgotten = log(&[(AT, uplink(1_000, 7))], |published| {
        let mut shown = Shown::default();
        if (ends(AT)..restart).contains(&published) {
            shown.values.uplinks_accepted = 1;
            shown.stored = Some((uplink(1_000, 7), ends(AT)));
        }
        shown
    });
    assert_eq!(broken(&forgotten), [(Violation::PortStatusWrong, 1)]);
    for what in [
        What::Reset { board: Board::Dpr, cause: crate::Cause::Pin, asked: true },
        What::Power { board: Board::Dpr, on: true },
    ] {
        let mut log = forgotten.clone();
        insert(&mut log, restart, what);
        assert_eq!(broken(&log), []);
    }
}

#[test]
fn an_unserved_or_interrupted_transaction_counts_for_nothing() {
    let mut restarted = log(&[(READ, uplink(1_000, 7))], |_| Shown::default());
    assert_eq!(broken(&restarted), [(Violation::PortStatusWrong, 1)]);
    let reset = What::Reset { board: Board::Dpr, cause: crate::Cause::Pin, asked: true };
    insert(&mut restarted, READ + MS / 4, reset);
    assert_eq!(broken(&restarted), []);
    let mut silent = log(&[], |_| Shown::default());
    miso(&mut silent, READ).fill(0xFF);
    assert_eq!(broken(&silent), []);
    let place = Layout::for_receivers(3).unwrap().port_status();
    let mut vacant = log(&[], |_| Shown::default());
    miso(&mut vacant, READ)[place].fill(0xFF);
    assert_eq!(broken(&vacant), [(Violation::PortStatusWrong, 1)]);
}

#[test]
fn a_hit_image_bit_excuses_damage_until_its_buffer_is_replaced() {
    let layout = Layout::for_receivers(3).unwrap();
    for (place, violation) in [
        (layout.port_status().start + 8, Violation::Damaged),
        (layout.uplink::<FlightController>().start + 20, Violation::Damaged),
    ] {
        let mut damaged = uplink_shown_from(ends(AT));
        miso(&mut damaged, READ)[place] ^= 1;
        assert_eq!(broken(&damaged), [(violation, 1)]);
        for (longer, excused) in [(0, false), (1, true)] {
            let until = READ - bounds::BUFFER_REPLACED + longer;
            for (kind, excused) in [(IMAGE_BIT, excused), (Disturbance::Air, false)] {
                let mut log = damaged.clone();
                insert(&mut log, until, injected(kind, until));
                assert_eq!(broken(&log).is_empty(), excused, "{kind:?}, {longer}");
            }
        }
    }
}

#[test]
fn port_status_is_judged_again_once_misuse_is_over() {
    let mut damaged = log(&[], |_| Shown::default());
    miso(&mut damaged, READ)[Layout::for_receivers(3).unwrap().port_status().start + 8] ^= 1;
    for (longer, expected) in [(0, vec![(Violation::Damaged, 1)]), (1, vec![])] {
        let mut log = damaged.clone();
        let until = READ - bounds::MISUSE_OVER + longer;
        insert(&mut log, until, injected(MISUSE, until));
        assert_eq!(broken(&log), expected, "{longer}");
    }
}

#[test]
fn a_self_test_may_fail_after_memory_was_damaged_and_not_otherwise() {
    let failed = log(&[(AT, command(50, Command::SelfTest))], |published| {
        let mut shown = Shown::default();
        if published >= ends(AT) {
            shown.values.commands_carried_out = 1;
            shown.values.last_command_timestamp = 50;
            shown.values.last_command = Command::SelfTest.word();
        }
        let running = (ends(AT)..200 * MS).contains(&published);
        let status = PortStatusBits::new().with_self_test_running(running);
        shown.values.status = status.with_self_test_failed(published >= 200 * MS);
        shown
    });
    for (kinds, may) in [
        (&[][..], false),
        (&[Disturbance::Air], false),
        (&[Disturbance::Receiver { receiver: 0 }], false),
        (&[Disturbance::Memory { board: Board::Dpr, memory: Memory::Ram }], true),
        (&[Disturbance::Memory { board: Board::Dpr, memory: Memory::Flash }], true),
        (&[Disturbance::Memory { board: Board::Horus, memory: Memory::Flash }], false),
        (&[Disturbance::Code { board: Board::Dpr }], true),
        (&[IMAGE_BIT], true),
        (&[IMAGE_BIT, Disturbance::Air], true),
    ] {
        let mut log = failed.clone();
        for (kind, at) in kinds.iter().zip([50 * MS, 60 * MS]) {
            insert(&mut log, at, injected(*kind, at));
        }
        assert_eq!(broken(&log).is_empty(), may, "{kinds:?}");
    }
}

#[test]
fn a_map_without_a_timely_rise_of_fresh_is_not_judged() {
    for (clock, publication) in [("fast", bounds::PUBLICATION), ("pessimistic", bounds::PUBLICATION_PESSIMISTIC)] {
        for (late, expected) in [(0, vec![(Violation::PortStatusWrong, 1)]), (1, vec![])] {
            let mut log = log(&[], |published| {
                let mut shown = Shown::default();
                shown.values.uplinks_accepted = u32::from(published >= 200 * MS);
                shown
            });
            log.header.clock = clock.to_owned();
            log.events.retain(|event| match event.what {
                What::Fresh { .. } => event.at <= 200 * MS,
                What::Transaction { selected, .. } => selected < 200 * MS || selected == READ,
                _ => true,
            });
            for event in &mut log.events {
                if let What::Transaction { selected, .. } = &mut event.what
                    && *selected == READ
                {
                    *selected = 200 * MS + bounds::FRAME_DEADLINE + publication + late;
                    event.at = *selected + MS / 2;
                }
            }
            assert_eq!(broken(&log), expected, "{clock}, {late}");
        }
    }
}

fn ends_as_fresh_rises(from: u64) -> crate::Log {
    let mut log = uplink_shown_from(from);
    for event in log.events.iter_mut().filter(|event| event.at == 100 * MS) {
        event.at = ends(AT);
    }
    in_order(&mut log.events);
    log
}

#[test]
fn a_write_as_fresh_rises_shows_two_images_later() {
    assert_eq!(broken(&ends_as_fresh_rises(110 * MS)), []);
    assert_eq!(broken(&ends_as_fresh_rises(120 * MS)), []);
    assert_eq!(broken(&ends_as_fresh_rises(130 * MS))[0].0, Violation::PortStatusWrong);
    // After a write, the judge accepts Port-Status as its reference only from the second image on.
    let over = ends(AT) - MS / 4;
    let mut log = ends_as_fresh_rises(120 * MS);
    insert(&mut log, 20 * MS, injected(MISUSE, over - bounds::MISUSE_OVER));
    assert_eq!(broken(&log), []);
}

#[test]
fn what_port_status_has_decided_stays_so() {
    let written = [(AT, command(50, Command::SelfTest)), (AT + 40 * MS, command(60, Command::SelfTest))];
    let decided = |over: Range<u64>| {
        broken(&log(&written, |published| {
            let mut shown = Shown::default();
            let (first, second) = (published >= ends(AT), published >= ends(AT + 40 * MS));
            let last = if second && over.contains(&published) { 60 } else { 50 };
            if first {
                shown.values.commands_carried_out = if last == 60 { 2 } else { 1 };
                shown.values.last_command_timestamp = last;
                shown.values.last_command = Command::SelfTest.word();
                shown.values.status = shown.values.status.with_self_test_running(true);
            }
            if second && last == 50 {
                shown.values.violations.count(profile::Violation::CommandBusy, 1);
                shown.values.status = shown.values.status.with_last_refused(true);
            }
            shown
        }))
    };
    assert_eq!(decided(0..u64::MAX), []);
    assert_eq!(decided(0..0), []);
    assert_eq!(decided(0..200 * MS), [(Violation::PortStatusWrong, 1)]);
    assert_eq!(decided(200 * MS..u64::MAX), [(Violation::PortStatusWrong, 1)]);
}

#[test]
fn the_limits_of_an_uplinks_age() {
    const PUBLISHED: u64 = 70_000 * MS;
    let bytes = uplink(1, 1);
    let zeros = vec![0; Uplink::SIZE];
    let expiry = u64::from(Uplink::EXPIRY_MS);
    let may = |ago: u64, age: u64| {
        let fresh = age < expiry;
        let read = if fresh { &bytes } else { &zeros };
        let place = Place::Stored(bytes.clone(), PUBLISHED - ago * MS);
        let age = u16::try_from(age).unwrap();
        assert!(!shows(&place, (!fresh, age), Some(read), PUBLISHED));
        assert!(!shows(&place, (fresh, age), Some(if fresh { &zeros } else { &bytes }), PUBLISHED));
        assert_eq!(
            shows(&place, (fresh, age), None, PUBLISHED),
            shows(&place, (fresh, age), Some(read), PUBLISHED),
            "a place that was not read says nothing"
        );
        shows(&place, (fresh, age), Some(read), PUBLISHED)
    };
    // The stated age may be 42 ms too small: Port-Status is made up to 40 ms before its publication, and the DPR judges
    // an uplink up to 2 ms after its transaction. It may be 1 ms too great, because the clock counts whole
    // milliseconds.
    for ago in [100, 300, 499, 540, 541, 542, 700, 60_000] {
        for (age, allowed) in [(ago - 43, false), (ago - 42, true), (ago, true), (ago + 1, true), (ago + 2, false)] {
            assert_eq!(may(ago, age), allowed, "{age} ms for {ago} ms");
        }
    }
    assert!(may(10, 0), "it cannot be younger than nothing");
    // The stated age grows to 65535 ms and then stays there.
    assert!(may(66_000, 65_535));
    assert!(may(65_534, 65_535));
    assert!(!may(65_533, 65_535));
    // If no uplink is stored, the map must have zeros in its place. If the stored uplink is not known, any bytes are
    // right.
    let empty = |told, read| shows(&Place::Empty, told, read, PUBLISHED);
    assert!(empty((false, u16::MAX), None));
    assert!(empty((false, u16::MAX), Some(&zeros)));
    assert!(!empty((false, u16::MAX), Some(&bytes)));
    assert!(!empty((false, 700), Some(&zeros)));
    assert!(!empty((true, u16::MAX), Some(&zeros)));
    assert!(!empty((true, 700), Some(&bytes)));
    assert!(shows(&Place::Unknown, (true, 7), Some(&bytes), PUBLISHED));
}

fn may(sent: &[Vec<u8>], change: impl FnOnce(&mut PortValues)) -> bool {
    let map_len = Layout::for_receivers(3).unwrap().map_len();
    let models = sent.iter().fold(vec![Model::at_start()], |models, mosi| step(&models, mosi, 0, map_len));
    let mut values = PortValues::default();
    change(&mut values);
    models.iter().any(|model| model.fits(&values, 0))
}

fn writing(object: &[u8]) -> Vec<u8> {
    [&[0; 8], object].concat()
}

#[test]
fn an_uplink_must_be_newer_or_third_of_a_rising_row() {
    for (timestamps, accepted, refused) in [
        (&[10, 20][..], 2, false),
        (&[10, 20, 20], 2, true),
        (&[10, 9], 1, true),
        (&[u32::MAX, 3], 2, false),
        (&[0, (1 << 31) - 1], 2, false),
        (&[0, 1 << 31], 1, true),
        (&[1_000, 1, 2], 1, true),
        (&[1_000, 1, 2, 3], 2, false),
        (&[1_000, 1, 2, 3, 4], 3, false),
        // A timestamp that is not newer ends the series of newer timestamps, and begins a new one.
        (&[1_000, 1, 1, 2], 1, true),
        (&[1_000, 1, 1, 2, 3], 2, false),
        (&[1_000, 1, 2, 2_000, 3, 4], 2, true),
    ] {
        let sent: Vec<_> = timestamps.iter().map(|timestamp| writing(&uplink(*timestamp, 1))).collect();
        let says = |accepted: u32| {
            may(&sent, |values| {
                values.uplinks_accepted = accepted;
                let not_newer = timestamps.len() as u16 - accepted as u16;
                values.violations.count(profile::Violation::UplinkNotNewer, not_newer);
                values.status = PortStatusBits::new().with_last_refused(refused);
            })
        };
        for count in 0..=timestamps.len() as u32 {
            assert_eq!(says(count), count == accepted, "{timestamps:?}: {count}");
        }
    }
}

#[test]
fn each_part_of_a_transaction_is_judged_by_itself() {
    let kinds = |mosi: Vec<u8>| {
        let sent = [mosi];
        let may = |kind: Option<profile::Violation>| {
            may(&sent, |values| kind.iter().for_each(|kind| values.violations.count(*kind, 1)))
        };
        [None].into_iter().chain(profile::Violation::ALL.map(Some)).filter(|kind| may(*kind)).collect::<Vec<_>>()
    };
    for idle in [0x00, 0xFF] {
        for bytes in [0, 1, 7, 8, 9, 72, 80, 300] {
            assert_eq!(kinds(vec![idle; bytes]), [None], "{bytes} bytes {idle:#x}");
        }
    }
    assert_eq!(kinds(vec![0, 1, 0]), [Some(profile::Violation::TooShort)]);
    assert_eq!(kinds(vec![0xFF, 0]), [Some(profile::Violation::TooShort)]);
    assert_eq!(kinds(vec![0, 0, 1, 0, 0, 0, 0, 0]), [Some(profile::Violation::RequestDamaged)]);
    // The DPR receives only eight bytes after the written object.
    for (behind, kind) in [(0, Some(profile::Violation::TooLong)), (7, Some(profile::Violation::TooLong)), (8, None)] {
        let mut mosi = vec![0; 100];
        mosi[72 + behind] = 1;
        assert_eq!(kinds(mosi), [kind], "{behind}");
    }
}

#[test]
fn both_writers_may_store_an_uplink() {
    for identifier in [Identifier::UPLINK_BASE_STATION, Identifier::UPLINK_FLIGHT_CONTROLLER] {
        let mut object = uplink(1_000, 1);
        object[4..6].copy_from_slice(&identifier.0.to_le_bytes());
        let seal = profile::crc::frame(&object[..60]).to_be_bytes();
        object[60..].copy_from_slice(&seal);
        assert!(may(&[writing(&object)], |values| values.uplinks_accepted = 1), "{identifier:?}");
    }
}

#[test]
fn a_command_is_unknown_where_a_byte_behind_its_word_is_set() {
    for place in 12..60 {
        let mut object = command(1_000, Command::SelfTest);
        object[place] = 1;
        let seal = profile::crc::frame(&object[..60]).to_be_bytes();
        object[60..].copy_from_slice(&seal);
        let unknown = |values: &mut PortValues| {
            values.violations.count(profile::Violation::CommandUnknown, 1);
            values.status = PortStatusBits::new().with_last_refused(true);
        };
        assert!(may(&[writing(&object)], unknown), "byte {place}");
    }
}

#[test]
fn an_object_that_is_cut_off_is_too_short() {
    let object = uplink(1_000, 1);
    for len in [8, 59, 63] {
        let too_short = |values: &mut PortValues| {
            values.violations.count(profile::Violation::TooShort, 1);
            values.status = PortStatusBits::new().with_last_refused(true);
        };
        assert!(may(&[writing(&object[..len])], too_short), "{len} bytes");
    }
}

#[test]
fn only_a_self_test_may_be_refused_while_another_runs() {
    let test = |timestamp| writing(&command(timestamp, Command::SelfTest));
    let clear = |timestamp| writing(&command(timestamp, Command::ClearCounters));
    let says = |sent: &[Vec<u8>], carried_out: u32, last: (u32, Command), busy: bool, running: bool| {
        may(sent, |values| {
            values.commands_carried_out = carried_out;
            values.last_command_timestamp = last.0;
            values.last_command = last.1.word();
            values.violations.count(profile::Violation::CommandBusy, u16::from(busy));
            let over = !running && sent[0] == test(1);
            let status = PortStatusBits::new().with_last_refused(busy).with_self_test_running(running);
            values.status = status.with_self_test_passed(over);
        })
    };
    let runs = |at: u64| {
        let status = PortStatusBits::new().with_self_test_running(true);
        let last_command = Command::SelfTest.word();
        let known = PortValues { commands_carried_out: 1, last_command_timestamp: 1, ..PortValues::default() };
        let values = PortValues { status, last_command, ..known };
        Model::at_start().after(&test(1), 0, 500).iter().any(|model| model.fits(&values, at))
    };
    assert!(runs(bounds::SELF_TEST - 1) && !runs(bounds::SELF_TEST));
    let sent = [test(1)];
    assert!(says(&sent, 1, (1, Command::SelfTest), false, true));
    assert!(says(&sent, 1, (1, Command::SelfTest), false, false));
    assert!(!says(&sent, 0, (0, Command::SelfTest), true, true));
    assert!(!may(&sent, |values| {
        values.violations.count(profile::Violation::CommandBusy, 1);
        values.status = PortStatusBits::new().with_last_refused(true);
    }));
    let sent = [test(1), test(2)];
    assert!(says(&sent, 2, (2, Command::SelfTest), false, true));
    assert!(says(&sent, 1, (1, Command::SelfTest), true, true));
    let sent = [test(1), clear(2)];
    assert!(says(&sent, 1, (2, Command::ClearCounters), false, true));
    assert!(!says(&sent, 1, (1, Command::SelfTest), true, true));
    assert!(!says(&sent, 2, (2, Command::ClearCounters), false, true));
    // The command that clears the counters also clears those of uplinks and violations, and begins no self-test.
    let sent = [writing(&uplink(5, 1)), writing(&uplink(5, 1)), clear(1)];
    assert!(says(&sent, 1, (1, Command::ClearCounters), false, false));
    assert!(!says(&sent, 1, (1, Command::ClearCounters), false, true));
    assert!(!may(&sent, |values| {
        values.uplinks_accepted = 1;
        values.commands_carried_out = 1;
        values.last_command_timestamp = 1;
        values.last_command = Command::ClearCounters.word();
    }));
}

#[test]
fn a_self_test_that_is_over_has_one_result_which_stays() {
    let values = |running, passed, failed| {
        let status = PortStatusBits::new().with_self_test_running(running);
        let status = status.with_self_test_passed(passed).with_self_test_failed(failed);
        PortValues { status, ..PortValues::default() }
    };
    let (passed, failed) = (values(false, true, false), values(false, false, true));
    let mut model = Model::of(&values(true, false, false), 0);
    assert!(model.fits(&values(true, false, false), bounds::SELF_TEST - 1));
    assert!(!model.fits(&values(true, false, false), bounds::SELF_TEST), "it takes too long");
    for at in [0, 2 * bounds::SELF_TEST] {
        assert!(model.fits(&passed, at) && model.fits(&failed, at));
        assert!(!model.fits(&values(false, false, false), at) && !model.fits(&values(false, true, true), at));
    }
    model.told(&passed);
    assert!(model.fits(&passed, 0));
    assert!(!model.fits(&failed, 0) && !model.fits(&values(true, false, false), 0), "it was told");
}
