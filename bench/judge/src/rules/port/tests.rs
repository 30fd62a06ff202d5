use profile::criticality::{Dpr, Writer};
use profile::{Command, CommandObject, PortStatus, PortStatusBits, UplinkValues, Violations};

use super::*;
use crate::testing::{Events, MS, header};
use crate::{Bytes, Header};

/// The flight controller reads every 4 ms, FRESH rises every 10 ms.
const READS: u64 = 4 * MS;

fn uplink(timestamp: u32, byte: u8) -> Vec<u8> {
    let values = UplinkValues { timestamp, payload: [byte; Uplink::PAYLOAD], ..UplinkValues::default() };
    Uplink::seal(Writer::<FlightController>::claim(), &values).as_bytes().to_vec()
}

fn command(timestamp: u32, command: Command) -> Vec<u8> {
    CommandObject::seal(Writer::<FlightController>::claim(), timestamp, command).as_bytes().to_vec()
}

/// A DPR that does right, as far as these tests need it: what it shows at a publication.
#[derive(Clone, Default)]
struct Shown {
    values: PortValues,
    stored: Option<(Vec<u8>, u64)>,
}

/// A log in which `written` is sent at its instants, and the map of an image of 10 ms · n is what `shown` says of n.
fn log(written: &[(u64, Vec<u8>)], shown: impl Fn(u64) -> Shown) -> crate::Log {
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
    let found = crate::testing::found(Port::new(&header(3)), log).0;
    found.into_iter().map(|(violation, count, _)| (violation, count)).collect()
}

/// The transaction in which an object that is written at `at` goes out ends then.
fn ends(at: u64) -> u64 {
    (at - MS) / READS * READS + MS + MS / 2
}

const AT: u64 = 101 * MS;

/// One uplink at [`AT`]; the images from so many after its end on show it as `change` has it.
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
    // Before it was written it cannot show.
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
    // A test that failed is told of each image.
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
        for (n, ((at, object), (_, kind))) in written.iter().zip(&kinds).enumerate() {
            if published < ends(*at) {
                break;
            }
            shown.values.status = shown.values.status.with_last_refused(kind.is_some());
            match kind {
                Some(kind) if n != leave_out => violations.count(*kind, 1),
                Some(_) => {}
                None if n == 0 => {
                    shown.values.uplinks_accepted = 1;
                    shown.stored = Some((object.clone(), ends(*at)));
                }
                None => {
                    shown.values.commands_carried_out = 1;
                    shown.values.last_command_timestamp = 50;
                    shown.values.last_command = Command::SelfTest.word();
                }
            }
        }
        shown.values.violations = violations;
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
        let kind = "flight controller lies".to_owned();
        let injected = Event { at: 120 * MS, what: What::Injected { kind, until: 200 * MS } };
        let place = log.events.partition_point(|event| event.at < injected.at);
        log.events.insert(place, injected);
        broken(&log)
    };
    assert_eq!(with(1), []);
    assert_eq!(with(2), [(Violation::PortStatusWrong, 1)]);
}
