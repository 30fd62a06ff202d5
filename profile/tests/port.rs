//! Tests Port-Status, uplinks, commands and the map against bytes written by hand, and what the DPR accepts.
use profile::{
    Command, CommandObject, Identifier, Layout, LinkStatus, LinkValues, PortStatus, PortStatusBits, PortValues,
    Rejection, Uplink, UplinkValues, Violation, Violations,
    criticality::{BaseStation, Dpr, FlightController, Horus, Writer, WritesUplink},
    image::Image,
    map::{self, Map, PortArea},
    uplink::Written,
};

use crate::support;

use support::{reference, seeds};

const DPR: Writer<Dpr> = Writer::claim();
const BASE: Writer<BaseStation> = Writer::claim();
const OWN: Writer<FlightController> = Writer::claim();

#[rustfmt::skip]
const PORT_STATUS: [u8; 60] = [
    0x70, 0x17, 0x00, 0x00, // 6000 ms
    0x01, 0x44,             // 0x4401: Port-Status
    0x15, 0x00,             // base station's uplink fresh, last refused, self-test passed
    0x2C, 0x01, 0x00, 0x00, // 300 uplinks accepted
    0x02, 0x00, 0x00, 0x00, // 2 commands carried out
    0x7C, 0x15, 0x00, 0x00, // the last at 5500 ms
    0x54, 0x45, 0x53, 0x54, // TEST
    0x28, 0x00,             // base station's uplink 40 ms old
    0xF5, 0x01,             // flight controller's uplink 501 ms old
    0x01, 0x00, 0x02, 0x00, // requests damaged, windows outside
    0x03, 0x00, 0x04, 0x00, // too short, uplinks damaged
    0x05, 0x00, 0x06, 0x00, // identifiers, not newer
    0x07, 0x00, 0x08, 0x00, // commands unknown, while busy
    0x09, 0x00, 0x0A, 0x00, // too many, too long
    0x0B, 0x00, 0x0C, 0x00, // integrity faults, passes over the flash
    0x0D, 0x00, 0x0E, 0x00, // stuck bits, buffers out of use
    0x04, 0x03, 0x02, 0x01, // last stop
];

#[test]
fn port_status_is_the_bytes_of_its_table() {
    let sealed = PortStatus::seal(DPR, &seeds::port_values());
    assert_eq!(sealed.as_bytes()[..60], PORT_STATUS);
    let crc = reference::crc(reference::FRAME, &PORT_STATUS).to_be_bytes();
    assert_eq!(sealed.as_bytes()[60..], crc);
    assert_eq!(PortStatus::verify(sealed.as_bytes()).unwrap().values(), seeds::port_values());
    assert_eq!(sealed.values().violations.total(), 55);
}

#[test]
fn each_kind_of_violation_has_two_bytes_of_its_own() {
    let places = [28, 30, 32, 34, 36, 38, 40, 42, 44, 46];
    for (kind, place) in Violation::ALL.into_iter().zip(places) {
        assert_eq!(kind.place(), place..place + 2);
        let mut violations = Violations::new();
        violations.count(kind, 0x0201);
        let bytes = *PortStatus::seal(DPR, &PortValues { violations, ..PortValues::default() }).as_bytes();
        assert_eq!(bytes[kind.place()], [0x01, 0x02]);
        assert!(bytes[8..60].iter().enumerate().all(|(at, &byte)| byte == 0 || kind.place().contains(&(at + 8))));
        assert_eq!((violations.of(kind), violations.total()), (0x0201, 0x0201));
        violations.count(kind, u16::MAX);
        assert_eq!(violations.of(kind), u16::MAX);
    }
}

#[test]
fn every_reason_of_a_rejection_has_its_kind() {
    use Rejection::{Crc, Identifier, Length, PositionCrc, Window};
    let request = [Length, Crc, Window].map(Violation::of_request);
    assert_eq!(request, [Violation::TooShort, Violation::RequestDamaged, Violation::WindowOutside]);
    let object = [Length, Crc, PositionCrc, Identifier, Rejection::Command].map(Violation::of_object);
    let damaged = Violation::UplinkDamaged;
    let others = [Violation::UplinkIdentifier, Violation::CommandUnknown];
    assert_eq!(object, [Violation::TooShort, damaged, damaged, others[0], others[1]]);
}

#[test]
fn each_bit_of_port_status_is_where_the_table_says() {
    let set: [fn(PortStatusBits) -> PortStatusBits; 9] = [
        |bits| bits.with_base_station_fresh(true),
        |bits| bits.with_flight_controller_fresh(true),
        |bits| bits.with_last_refused(true),
        |bits| bits.with_self_test_running(true),
        |bits| bits.with_self_test_passed(true),
        |bits| bits.with_self_test_failed(true),
        |bits| bits.with_buffers_out_of_use(true),
        |bits| bits.with_hold_heard(true),
        |bits| bits.with_hold_accepted(true),
    ];
    for (bit, set) in set.into_iter().enumerate() {
        assert_eq!(set(PortStatusBits::new()).bits(), 1 << bit);
    }
    for (accepted, rejected, bits) in
        [(1, 0, 0x0200), (15, 0, 0x1E00), (16, 8, 0), (0, 1, 0x2000), (0x0100_0100, 7, 0xE000), (0x1F, 0xF, 0xFE00)]
    {
        assert_eq!(PortStatusBits::new().with_hold_counts(accepted, rejected).bits(), bits);
        let others = PortStatusBits::from_bits(u16::MAX).with_hold_counts(accepted, rejected);
        assert_eq!(others.bits(), bits | 0x01FF);
        let read = (others.hold_objects_accepted(), others.hold_objects_rejected());
        assert_eq!((u32::from(read.0), u32::from(read.1)), (accepted % 16, rejected % 8));
    }
    assert_eq!(PortStatusBits::from_bits(u16::MAX).bits(), 0xFFFF);
}

#[test]
fn an_uplink_has_the_bytes_of_its_table_and_its_writers_identifier() {
    fn of<W: WritesUplink>(writer: Writer<W>, identifier: u16) {
        let sealed = Uplink::seal(writer, &seeds::uplink_values(0x0403_0201));
        let mut bytes = [0; 64];
        bytes[..4].copy_from_slice(&[1, 2, 3, 4]);
        bytes[4..6].copy_from_slice(&identifier.to_le_bytes());
        bytes[6..8].copy_from_slice(&[0x0F, 0xF0]);
        (8..60).for_each(|at| bytes[at] = u8::try_from(at - 7).unwrap());
        reference::repair_frame_crc(&mut bytes);
        assert_eq!(sealed.as_bytes(), &bytes);
        assert_eq!(Uplink::verify::<W>(&bytes), Ok(&sealed));
        assert_eq!(sealed.values(), seeds::uplink_values(0x0403_0201));
        let [base, own] = [Uplink::verify::<BaseStation>(&bytes), Uplink::verify::<FlightController>(&bytes)];
        assert_eq!(base.is_ok(), identifier == 0x4200);
        assert_eq!(own.is_ok(), identifier == 0x4300);
    }
    of(BASE, 0x4200);
    of(OWN, 0x4300);
    assert_eq!(Uplink::seal(BASE, &UplinkValues::default()).values(), UplinkValues::default());
}

#[test]
fn a_command_with_any_other_bit_is_unknown() {
    let words = [(Command::ClearCounters, *b"CLRC"), (Command::SelfTest, *b"TEST")];
    assert_eq!(words.map(|(command, _)| command), Command::ALL);
    for (command, word) in words {
        let sealed = CommandObject::seal(OWN, 77, command);
        let mut bytes = [0; 64];
        bytes[..6].copy_from_slice(&[77, 0, 0, 0, 0x01, 0x43]);
        bytes[8..12].copy_from_slice(&word);
        reference::repair_frame_crc(&mut bytes);
        assert_eq!(sealed.as_bytes(), &bytes);
        assert_eq!((sealed.values().timestamp, sealed.values().word), (77, u32::from_le_bytes(word)));
        assert_eq!(Written::verify(&bytes), Ok(Written::Command(command, &sealed)));
        for bit in 8 * 8..8 * 60 {
            let mut other = reference::flipped(&bytes, [bit]);
            reference::repair_frame_crc(&mut other);
            assert_eq!(Written::verify(&other), Err(Rejection::Command), "bit {bit}");
            assert_eq!(CommandObject::verify(&other), Err(Rejection::Command), "bit {bit}");
        }
    }
    // The words of the commands differ in many bits, so that a few flipped bits do not turn one command into another.
    assert!((Command::ClearCounters.word() ^ Command::SelfTest.word()).count_ones() >= 8);
}

#[test]
fn of_all_identifiers_three_may_be_written() {
    let mut bytes = *Uplink::EMPTY.as_bytes();
    bytes[8..12].copy_from_slice(b"TEST");
    for identifier in 0..=u16::MAX {
        bytes[4..6].copy_from_slice(&identifier.to_le_bytes());
        let crc = profile::crc::frame(&bytes[..60]);
        bytes[60..].copy_from_slice(&crc.to_be_bytes());
        let written = Written::verify(&bytes);
        match identifier {
            0x4200 => assert!(matches!(written, Ok(Written::BaseStation(_)))),
            0x4300 => assert!(matches!(written, Ok(Written::FlightController(_)))),
            0x4301 => assert!(matches!(written, Ok(Written::Command(Command::SelfTest, _)))),
            _ => assert_eq!(written, Err(Rejection::Identifier)),
        }
    }
    assert_eq!((Identifier::COMMAND.0, Identifier::PORT_STATUS.0), (0x4301, 0x4401));
}

fn the_map_is_the_image_and_then_the_port<const N: usize>() {
    let len = 96 + 60 * N;
    let mut image = Image::<N>::EMPTY;
    image.set_link(LinkStatus::seal(&seeds::link_values()));
    let port = seeds::port_area();
    let map = Map::new(image, port);
    assert_eq!((Map::<N>::PORT_STATUS, Map::<N>::LEN, size_of_val(&map)), (len, len + 192, len + 192));
    assert_eq!(&map.as_bytes()[..len], image.as_bytes());
    assert_eq!((map.image(), map.port()), (&image, &port));
    let layout = Layout::for_receivers(N).expect("a profile");
    assert_eq!((layout.image_len(), layout.map_len()), (len, len + 192));
    assert_eq!((Map::<N>::port_area(), Map::<N>::port_status()), (len..len + 192, len..len + 64));
    assert_eq!(layout.port_status(), Map::<N>::port_status());
    assert_eq!(layout.uplink::<BaseStation>(), len + 64..len + 128);
    assert_eq!(layout.uplink::<FlightController>(), len + 128..len + 192);
    let bytes = map.as_bytes();
    assert_eq!(&bytes[Map::<N>::port_status()], port.status().as_bytes());
    assert_eq!(&bytes[Map::<N>::uplink::<BaseStation>()], port.uplink::<BaseStation>().as_bytes());
    assert_eq!(&bytes[Map::<N>::uplink::<FlightController>()], port.uplink::<FlightController>().as_bytes());
    assert_eq!(port.uplink::<BaseStation>().timestamp(), 70);
    assert_eq!(port.uplink::<FlightController>().timestamp(), 80);

    let reading = Map::<N>::read(bytes).expect("the length is right");
    assert_eq!(reading.image.link.expect("intact").values(), seeds::link_values());
    assert_eq!(reading.port.status.expect("intact").values(), seeds::port_values());
    assert_eq!(reading.port.base_station.expect("intact").timestamp(), 70);
    assert_eq!(reading.port.flight_controller.expect("intact").timestamp(), 80);
    assert_eq!(Map::<N>::read(&bytes[1..]), Err(Rejection::Length));
    assert_eq!(Map::<N>::EMPTY, Map::new(Image::EMPTY, PortArea::EMPTY));
    assert_ne!(map, Map::EMPTY);

    let mut written = vec![0; len + 192];
    *map::port_area_mut::<_, N>(DPR, &mut written).expect("in the map") = *port.as_bytes();
    *map::link_status_mut(DPR, &mut written).expect("in the map") = *LinkStatus::seal(&seeds::link_values()).as_bytes();
    assert_eq!(written, bytes);
    for index in 0..=N {
        let place = map::profile_object_mut::<_, N>(Writer::<Horus>::claim(), &mut written, index).expect("an object");
        place.fill(0xA5);
    }
    assert!(written[32..len].iter().all(|&byte| byte == 0xA5));
    assert_eq!((&written[..32], &written[len..]), (&bytes[..32], &bytes[len..]));
    assert_eq!(map::profile_object_mut::<_, N>(Writer::<Horus>::claim(), &mut written, N + 1), None);
    assert_eq!(map::port_area_mut::<_, N>(DPR, &mut written[1..]), None);
    assert_eq!(map::link_status_mut(DPR, &mut written[..31]), None);
}

#[test]
fn the_map_is_the_image_and_then_the_port_area() {
    the_map_is_the_image_and_then_the_port::<1>();
    the_map_is_the_image_and_then_the_port::<2>();
    the_map_is_the_image_and_then_the_port::<3>();
    the_map_is_the_image_and_then_the_port::<5>();
}

#[test]
fn an_uplink_leaves_the_rest_of_the_port_area_unchanged() {
    let mut area = seeds::port_area();
    area.set_uplink(BASE, Uplink::EMPTY);
    assert_eq!(area.as_bytes()[64..128], [0; 64]);
    assert_eq!(area.as_bytes()[..64], seeds::port_area().as_bytes()[..64]);
    assert_eq!(area.as_bytes()[128..], seeds::port_area().as_bytes()[128..]);
    area.set_uplink(OWN, Uplink::EMPTY);
    assert_eq!(area.as_bytes()[64..], [0; 128]);
    let reading = area.verify();
    assert_eq!((reading.base_station, reading.flight_controller), (Err(Rejection::Crc), Err(Rejection::Crc)));
}

#[test]
fn a_person_can_read_what_the_map_holds() {
    let mut image = Image::<1>::EMPTY;
    image.set_link(LinkStatus::seal(&LinkValues::default()));
    let shown = format!("{:?}", Map::new(image, seeds::port_area()));
    assert!(shown.contains("base_station_age_ms: 40") && shown.contains("frames_missed: 0"), "{shown}");
}
