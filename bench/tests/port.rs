//! Tests what a flight controller writes to the DPR: uplinks and commands can be read back, and forbidden writes are
//! counted by kind.

use crate::{boards, reader};

use bench::boards::Dpr;
use bench::world::ssi::Order;
use boards::counter;
use dpr_fw::telemetry::Telemetry;
use emulator_node::Node;
use profile::criticality::{BaseStation, FlightController, Writer};
use profile::map::{Map, MapReading};
use profile::ssi::{Request, encode};
use profile::{Command, CommandObject, Identifier, Uplink, UplinkValues, Violation};
use reader::{MS, carry, transact};

const BASE: Writer<BaseStation> = Writer::claim();
const OWN: Writer<FlightController> = Writer::claim();

fn pass(node: &mut Node<Dpr>, ns: u64) {
    let end = node.now() + ns;
    while node.now() < end {
        node.advance(end);
    }
}

/// Writes `parts` in one transaction, and waits until an image shows the effect.
fn write(node: &mut Node<Dpr>, parts: &[&[u8]]) {
    let mosi = parts.concat();
    let bytes = mosi.len();
    carry(node, Order { mosi, ..Order::read(bytes) });
    pass(node, 21 * MS);
}

fn map(node: &mut Node<Dpr>) -> Vec<u8> {
    transact(node, Map::<3>::LEN, 0)
}

fn reading(map: &[u8]) -> MapReading<'_, 3> {
    Map::read(map).expect("the whole map")
}

const IDLE: &[u8] = &[0; 8];

#[test]
fn uplinks_are_read_back_as_they_were_written_until_they_are_old() {
    let Some(mut node) = boards::dpr() else { return };
    pass(&mut node, 50 * MS);
    let payload = core::array::from_fn(|at| u8::try_from(at).unwrap());
    let base = Uplink::seal(BASE, &UplinkValues { timestamp: 5, payload, ..UplinkValues::default() });
    let own = Uplink::seal(OWN, &UplinkValues { timestamp: 9, payload, ..UplinkValues::default() });
    write(&mut node, &[IDLE, base.as_bytes()]);
    write(&mut node, &[&encode(Request { offset: 276, length: 192 }), own.as_bytes()]);
    let window = transact(&mut node, 192, 0);
    let whole = map(&mut node);
    assert_eq!(whole[276 + 64..], window[64..]);
    let port = reading(&whole).port;
    assert_eq!((port.base_station, port.flight_controller), (Ok(&base), Ok(&own)));
    let status = port.status.expect("Port-Status").values();
    assert_eq!((status.uplinks_accepted, status.violations.total()), (2, 0));
    assert!(status.status.base_station_fresh() && status.status.flight_controller_fresh());
    assert!((20..=45).contains(&status.base_station_age_ms), "{status:?}");
    write(&mut node, &[IDLE, own.as_bytes()]);
    let whole = map(&mut node);
    let status = reading(&whole).port.status.expect("Port-Status").values();
    assert_eq!((status.violations.of(Violation::UplinkNotNewer), status.violations.total()), (1, 1));
    assert!(status.status.last_refused());
    assert!(reading(&whole).image.link.expect("Link-Status").status().uplink_rejected());
    pass(&mut node, 500 * MS);
    let whole = map(&mut node);
    assert!(whole[276 + 64..].iter().all(|&byte| byte == 0));
    assert!(reading(&whole).port.status.is_ok());
}

#[test]
fn each_kind_of_violation_is_counted_and_a_command_clears_them() {
    let Some(mut node) = boards::dpr() else { return };
    pass(&mut node, 50 * MS);
    let uplink = Uplink::seal(BASE, &UplinkValues { timestamp: 5, ..UplinkValues::default() });
    let mut damaged = *uplink.as_bytes();
    damaged[30] ^= 0x10;
    let mut foreign = *uplink.as_bytes();
    foreign[4..6].copy_from_slice(&Identifier::REPORTED_POSITION.0.to_le_bytes());
    let crc = profile::crc::frame(&foreign[..60]);
    foreign[60..].copy_from_slice(&crc.to_be_bytes());
    write(&mut node, &[&[1, 2, 3, 4, 5, 6, 7, 8]]);
    write(&mut node, &[&encode(Request { offset: 400, length: 100 })]);
    write(&mut node, &[&[1, 2, 3]]);
    write(&mut node, &[IDLE, &uplink.as_bytes()[..40]]);
    write(&mut node, &[IDLE, &damaged]);
    write(&mut node, &[IDLE, &foreign]);
    write(&mut node, &[IDLE, &[0; 64], &[7; 8], &[9; 1_000]]);
    let own = |timestamp, command| CommandObject::seal(OWN, timestamp, command);
    write(&mut node, &[IDLE, own(70, Command::SelfTest).as_bytes()]);
    let whole = map(&mut node);
    let status = reading(&whole).port.status.expect("Port-Status").values();
    let kinds = Violation::ALL.map(|kind| status.violations.of(kind));
    assert_eq!(kinds, [1, 1, 2, 1, 1, 0, 0, 0, 0, 1]);
    assert_eq!((status.commands_carried_out, status.last_command), (1, Command::SelfTest.word()));
    write(&mut node, &[IDLE, own(71, Command::ClearCounters).as_bytes()]);
    let whole = map(&mut node);
    let status = reading(&whole).port.status.expect("Port-Status").values();
    assert_eq!((status.violations.total(), status.commands_carried_out), (0, 1));
    assert_eq!(reading(&whole).image.link.expect("Link-Status").values().access_violations, 7);
    let count = |offset| counter(&node, "DPR_TELEMETRY", offset);
    assert_eq!(count(std::mem::offset_of!(Telemetry, access_violations)), 7);
    println!(
        "SSI task at worst {} cycles, port task {}",
        count(std::mem::offset_of!(Telemetry, ssi_worst_cycles)),
        count(std::mem::offset_of!(Telemetry, port_worst_cycles))
    );
}
