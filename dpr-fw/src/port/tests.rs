use profile::{
    criticality::{BaseStation, FlightController, Writer, WritesUplink},
    CommandObject, Identifier, Rejection, UplinkStatus, UplinkValues,
};
use proptest::prelude::*;

use super::{
    areas::{Areas, HandedOver, AREAS},
    *,
};
use crate::{
    hold::Area,
    ssi::{Windows, RECEIVE_BYTES},
    triple::{Memory, Scrubbed},
};
use profile::ssi::{encode, Request};

const MAP: usize = 468;
const FC: Writer<FlightController> = Writer::claim();
const BASE: Writer<BaseStation> = Writer::claim();

fn uplink<W: WritesUplink>(writer: Writer<W>, timestamp: u32) -> Uplink {
    let payload = [timestamp.to_le_bytes()[0]; Uplink::PAYLOAD];
    Uplink::seal(writer, &UplinkValues { timestamp, status: UplinkStatus::from_bits(0xA5C3), payload })
}

fn command(timestamp: u32, command: Command) -> CommandObject {
    CommandObject::seal(FC, timestamp, command)
}

fn sealed(mut bytes: [u8; 64]) -> [u8; 64] {
    let crc = profile::crc::frame(&bytes[..60]);
    bytes[60..].copy_from_slice(&crc.to_be_bytes());
    bytes
}

struct Bench {
    port: WritePort,
    windows: Windows<MAP>,
    now_us: u32,
    diagnostics: Diagnostics,
}

impl Bench {
    fn new() -> Self {
        Self { port: WritePort::new(), windows: Windows::new(), now_us: 0, diagnostics: Diagnostics::default() }
    }

    fn clock(&mut self, mosi: &[u8]) -> bool {
        let mut area = ReceiveArea::default();
        let bytes = mosi.len().min(RECEIVE_BYTES);
        bytemuck::cast_slice_mut(&mut area)[..bytes].copy_from_slice(&mosi[..bytes]);
        let asked = self.windows.transaction(&mosi[..bytes]);
        self.port.transaction(Transaction { asked, bytes }, &area, self.now_us)
    }

    /// Makes a transaction that requests no window and writes `object`.
    fn write(&mut self, object: &[u8]) {
        self.clock(&[&[0; 8], object].concat());
    }

    fn wait_ms(&mut self, ms: u32) {
        self.now_us += 1_000 * ms;
    }

    fn area(&mut self) -> PortArea {
        let mut area = PortArea::EMPTY;
        self.port.prepare(&self.diagnostics, self.now_us, &mut area);
        area
    }

    fn values(&mut self) -> PortValues {
        self.area().verify().status.expect("Port-Status is intact").values()
    }

    /// Returns the kind of violation that was counted, and its number; `None` if none was counted. Only one kind may
    /// have been.
    #[track_caller]
    fn counted(&mut self) -> Option<(Violation, u16)> {
        let violations = self.values().violations;
        let counted: Vec<_> = Violation::ALL.map(|kind| (kind, violations.of(kind))).into_iter().collect();
        let counted: Vec<_> = counted.into_iter().filter(|&(_, count)| count > 0).collect();
        assert!(counted.len() <= 1, "{counted:?}");
        assert_eq!(self.port.access_violations(), violations.total());
        counted.first().copied()
    }
}

// Shows PORT-4.
#[test]
fn an_uplink_is_shown_in_its_writers_place_for_500_ms() {
    let mut bench = Bench::new();
    bench.wait_ms(1_000);
    let (base, own) = (uplink(BASE, 17), uplink(FC, 4_000_000_000));
    bench.write(base.as_bytes());
    bench.wait_ms(100);
    bench.write(own.as_bytes());
    bench.wait_ms(399);
    let area = bench.area();
    let reading = area.verify();
    assert_eq!((reading.base_station, reading.flight_controller), (Ok(&base), Ok(&own)));
    let values = reading.status.expect("intact").values();
    assert_eq!((values.timestamp, values.base_station_age_ms, values.flight_controller_age_ms), (1_499, 499, 399));
    let status = PortStatusBits::new().with_base_station_fresh(true).with_flight_controller_fresh(true);
    assert_eq!((values.status, values.uplinks_accepted, bench.port.uplinks_accepted()), (status, 2, 2));

    bench.wait_ms(1);
    let area = bench.area();
    assert_eq!(area.uplink::<BaseStation>(), &Uplink::EMPTY);
    assert_eq!(area.verify().flight_controller, Ok(&own));
    let values = bench.values();
    assert_eq!(values.status, PortStatusBits::new().with_flight_controller_fresh(true));
    assert_eq!((values.base_station_age_ms, values.flight_controller_age_ms), (500, 400));

    bench.wait_ms(70_000);
    let values = bench.values();
    assert_eq!(values.status, PortStatusBits::new());
    assert_eq!((values.base_station_age_ms, values.flight_controller_age_ms), (u16::MAX, u16::MAX));
    assert_eq!((bench.counted(), bench.port.access_violations()), (None, 0));
}

#[test]
fn the_port_task_exchanges_its_newest_area_for_the_one_before() {
    let mut bench = Bench::new();
    bench.wait_ms(30);
    let (first, second) = (Area::EMPTY, Area { port: bench.area(), ..Area::EMPTY });
    let mut prepared = Prepared::new(first);
    assert_eq!(prepared.newest(), &first);
    let mut spare = second;
    prepared.exchange(&mut spare);
    assert_eq!((prepared.newest(), &spare), (&second, &first));
}

#[test]
fn port_status_is_intact_and_empty_at_the_start() {
    let mut bench = Bench::new();
    let area = bench.area();
    assert_eq!((area.uplink::<BaseStation>(), area.uplink::<FlightController>()), (&Uplink::EMPTY, &Uplink::EMPTY));
    let nothing =
        PortValues { base_station_age_ms: u16::MAX, flight_controller_age_ms: u16::MAX, ..PortValues::default() };
    assert_eq!(bench.values(), nothing);
}

#[test]
fn an_idle_line_of_any_length_is_no_violation_and_changes_nothing() {
    for length in 0..=RECEIVE_BYTES + 3 {
        for idle in [0x00, 0xFF] {
            let mut bench = Bench::new();
            assert!(!bench.clock(&vec![idle; length]));
            assert_eq!(bench.counted(), None, "{length} bytes {idle:#04x}");
            assert!(!bench.port.last_refused());
        }
    }
    // The bytes of request and object, and those after the object, may each be idle at 0x00 or at 0xFF.
    let mut bench = Bench::new();
    assert!(!bench.clock(&[[0x00; 8].as_slice(), &[0xFF; 64], &[0x00; 8]].concat()));
    assert!(!bench.clock(&[[0xFF; 8].as_slice(), &[0x00; 64], &[0xFF; 8]].concat()));
    assert!(!bench.clock(&encode(Request { offset: 276, length: 192 })));
    assert_eq!(bench.counted(), None);
}

#[test]
fn each_kind_of_violation_counts_once_for_each_transaction() {
    let good = uplink(BASE, 900);
    let damaged = {
        let mut bytes = *good.as_bytes();
        bytes[20] ^= 1;
        bytes
    };
    let foreign = |identifier: Identifier| {
        let mut bytes = *good.as_bytes();
        bytes[4..6].copy_from_slice(&identifier.0.to_le_bytes());
        sealed(bytes)
    };
    let unknown = {
        let mut bytes = *command(1, Command::SelfTest).as_bytes();
        bytes[8] ^= 1;
        sealed(bytes)
    };
    let reserved = {
        let mut bytes = *command(1, Command::SelfTest).as_bytes();
        bytes[59] = 1;
        sealed(bytes)
    };
    let request = encode(Request { offset: 0, length: 96 });
    let behind = |object: &[u8]| [&request, object].concat();
    let beyond = |at: usize| {
        let mut mosi = vec![0; RECEIVE_BYTES];
        mosi[at] = 1;
        mosi
    };
    let cases: [(Violation, Vec<u8>); 15] = [
        (Violation::RequestDamaged, vec![1, 2, 3, 4, 5, 6, 7, 8]),
        (Violation::WindowOutside, encode(Request { offset: 468, length: 1 }).to_vec()),
        (Violation::WindowOutside, encode(Request { offset: 7, length: 0 }).to_vec()),
        (Violation::TooShort, request[..7].to_vec()),
        (Violation::TooShort, vec![0x00, 0xFF]),
        (Violation::TooShort, behind(&good.as_bytes()[..63])),
        (Violation::TooShort, behind(&[9])),
        (Violation::UplinkDamaged, behind(&damaged)),
        (Violation::UplinkIdentifier, behind(&foreign(Identifier::REPORTED_POSITION))),
        (Violation::UplinkIdentifier, behind(&foreign(Identifier::PORT_STATUS))),
        (Violation::UplinkIdentifier, behind(&foreign(Identifier::ACTIVE_LOAD))),
        (Violation::CommandUnknown, behind(&unknown)),
        (Violation::CommandUnknown, behind(&reserved)),
        (Violation::TooLong, beyond(RECEIVE_BYTES - 1)),
        (Violation::TooLong, beyond(RECEIVE_BYTES - 8)),
    ];
    for (kind, mosi) in &cases {
        let mut bench = Bench::new();
        for times in 1..=3 {
            assert!(bench.clock(mosi), "{kind:?}");
            assert_eq!(bench.counted(), Some((*kind, times)), "{mosi:02x?}");
        }
        assert_eq!(bench.values().uplinks_accepted, 0);
        let area = bench.area();
        assert_eq!(area.uplink::<BaseStation>(), &Uplink::EMPTY);
        let of_object = mosi.len() > 8 && *kind != Violation::TooLong;
        assert_eq!((bench.port.last_refused(), bench.values().status.last_refused()), (of_object, of_object));
    }
}

#[test]
fn a_transaction_counts_once_for_each_part_that_is_wrong() {
    let mut bench = Bench::new();
    bench.clock(&[0xA5; 10_000]);
    let violations = bench.values().violations;
    for kind in Violation::ALL {
        let wrong = [Violation::RequestDamaged, Violation::UplinkDamaged, Violation::TooLong].contains(&kind);
        assert_eq!(violations.of(kind), u16::from(wrong), "{kind:?}");
    }
    assert_eq!(bench.port.access_violations(), 3);
}

#[test]
fn what_the_ssi_task_refused_is_counted_as_too_many_once() {
    let mut bench = Bench::new();
    bench.diagnostics.too_many = 3;
    assert_eq!(bench.counted(), Some((Violation::TooMany, 3)));
    assert_eq!(bench.counted(), Some((Violation::TooMany, 3)));
    bench.diagnostics.too_many = 5;
    assert_eq!(bench.counted(), Some((Violation::TooMany, 5)));
}

// Shows PORT-5.
#[test]
fn a_repeated_or_older_uplink_is_refused_and_the_newest_stays() {
    let mut bench = Bench::new();
    bench.write(uplink(FC, 100).as_bytes());
    bench.wait_ms(10);
    for old in [100, 99, 99, 5] {
        bench.write(uplink(FC, old).as_bytes());
        assert!(bench.values().status.last_refused());
    }
    assert_eq!(bench.counted(), Some((Violation::UplinkNotNewer, 4)));
    assert_eq!(bench.area().uplink::<FlightController>(), &uplink(FC, 100));
    assert_eq!(bench.values().flight_controller_age_ms, 10);
    bench.write(uplink(FC, 101).as_bytes());
    let values = bench.values();
    assert!(!values.status.last_refused());
    assert_eq!((values.uplinks_accepted, values.flight_controller_age_ms), (2, 0));
}

#[test]
fn the_timestamps_of_each_writer_and_of_commands_are_judged_apart() {
    let mut bench = Bench::new();
    for object in
        [*uplink(FC, 900).as_bytes(), *uplink(BASE, 5).as_bytes(), *command(2, Command::ClearCounters).as_bytes()]
    {
        bench.write(&object);
        assert!(!bench.port.last_refused());
    }
    assert_eq!(bench.counted(), None);
}

#[test]
fn a_writer_that_has_restarted_is_stored_again_with_its_third_uplink() {
    let mut bench = Bench::new();
    bench.write(uplink(BASE, 80_000).as_bytes());
    for (timestamp, stored) in [(20, false), (40, false), (60, true), (80, true)] {
        bench.write(uplink(BASE, timestamp).as_bytes());
        assert_eq!(bench.area().uplink::<BaseStation>() == &uplink(BASE, timestamp), stored, "{timestamp}");
    }
    assert_eq!(bench.counted(), Some((Violation::UplinkNotNewer, 2)));
}

#[test]
fn a_writer_that_was_silent_for_long_goes_on_where_it_was() {
    let mut bench = Bench::new();
    bench.write(uplink(FC, 100).as_bytes());
    bench.wait_ms(2_000);
    assert_eq!(bench.area().uplink::<FlightController>(), &Uplink::EMPTY);
    // The expired uplink comes again. Its timestamp is not newer than the last one, so it is refused.
    bench.write(uplink(FC, 100).as_bytes());
    assert_eq!(bench.area().uplink::<FlightController>(), &Uplink::EMPTY);
    bench.write(uplink(FC, 2_100).as_bytes());
    assert_eq!(bench.area().uplink::<FlightController>(), &uplink(FC, 2_100));
}

#[test]
fn clear_counters_clears_what_the_port_counts_and_nothing_else() {
    let mut bench = Bench::new();
    bench.diagnostics = Diagnostics {
        too_many: 2,
        integrity_faults: 3,
        flash_passes: 4,
        stuck_bits: 5,
        buffers_out_of_use: 1,
        last_stop: 0xDEAD_BEEF,
        #[cfg(feature = "hold")]
        hold: PortStatusBits::new(),
    };
    bench.write(uplink(BASE, 7).as_bytes());
    bench.clock(&[1; 9]);
    assert_eq!((bench.values().violations.total(), bench.port.access_violations()), (4, 4));
    bench.write(command(70, Command::ClearCounters).as_bytes());
    let values = bench.values();
    assert_eq!((values.violations, bench.port.access_violations()), (Violations::new(), 4));
    assert_eq!((values.uplinks_accepted, values.commands_carried_out), (0, 1));
    assert_eq!((values.last_command_timestamp, values.last_command), (70, u32::from_le_bytes(*b"CLRC")));
    let counters = [values.integrity_faults, values.flash_passes, values.stuck_bits, values.buffers_out_of_use];
    assert_eq!((counters, values.last_stop), ([3, 4, 5, 1], 0xDEAD_BEEF));
    assert!(values.status.base_station_fresh() && values.status.buffers_out_of_use());
    assert_eq!(bench.area().uplink::<BaseStation>(), &uplink(BASE, 7), "an uplink is no counter");
}

// Shows PORT-5.
#[test]
fn a_repeated_command_is_not_carried_out_again() {
    let mut bench = Bench::new();
    let clear = command(70, Command::ClearCounters);
    bench.write(clear.as_bytes());
    bench.clock(&[1; 8]);
    for times in 1..=5 {
        bench.write(clear.as_bytes());
        assert_eq!(bench.values().violations.of(Violation::UplinkNotNewer), times);
        assert_eq!(bench.values().violations.of(Violation::RequestDamaged), 1, "they were not cleared again");
    }
    assert_eq!(bench.values().commands_carried_out, 1);
    bench.write(command(71, Command::ClearCounters).as_bytes());
    assert_eq!((bench.values().violations, bench.port.access_violations()), (Violations::new(), 6));
}

#[test]
fn a_second_self_test_is_refused_while_the_first_runs() {
    let mut bench = Bench::new();
    assert!(!bench.port.self_test_requested());
    bench.port.self_test_done(false);
    assert_eq!(bench.values().status, PortStatusBits::new(), "nobody asked for it");
    for (round, passed) in [(0, true), (1, false), (2, true)] {
        let before = bench.values().status;
        bench.write(command(10 * round + 1, Command::SelfTest).as_bytes());
        assert!(bench.port.self_test_requested());
        assert_eq!(bench.values().status, before.with_last_refused(false).with_self_test_running(true));
        bench.write(command(10 * round + 2, Command::SelfTest).as_bytes());
        assert_eq!(bench.values().violations.of(Violation::CommandBusy), u16::try_from(round).expect("few") + 1);
        // A command that was refused during a self-test is not carried out after the self-test, whatever its result.
        bench.port.self_test_done(passed);
        bench.write(command(10 * round + 2, Command::SelfTest).as_bytes());
        assert!(!bench.port.self_test_requested());
        let done = PortStatusBits::new().with_last_refused(true);
        assert_eq!(bench.values().status, done.with_self_test_passed(passed).with_self_test_failed(!passed));
    }
    assert_eq!((bench.values().commands_carried_out, bench.values().last_command_timestamp), (3, 21));
}

#[test]
fn counters_of_faults_and_violations_stay_at_their_end() {
    let mut bench = Bench::new();
    bench.diagnostics = Diagnostics {
        too_many: 70_000,
        integrity_faults: 65_536,
        flash_passes: 65_535,
        stuck_bits: u32::MAX,
        buffers_out_of_use: 65_537,
        last_stop: 0,
        #[cfg(feature = "hold")]
        hold: PortStatusBits::new(),
    };
    let values = bench.values();
    let counters = [values.integrity_faults, values.flash_passes, values.stuck_bits, values.buffers_out_of_use];
    assert_eq!((counters, values.violations.of(Violation::TooMany)), ([u16::MAX; 4], u16::MAX));
    assert_eq!(bench.port.access_violations(), 70_000, "Link-Status's total is not that of the kinds");
}

/// Draws the bytes of a transaction. Most of them hold an intact object.
fn mosi() -> impl Strategy<Value = Vec<u8>> {
    let request = prop_oneof![
        Just(vec![0; 8]),
        Just(vec![0xFF; 8]),
        (0_u16..500, 0_u16..500).prop_map(|(offset, length)| encode(Request { offset, length }).to_vec()),
        prop::collection::vec(any::<u8>(), 8),
    ];
    let object = prop_oneof![
        Just(vec![0; 64]),
        (0_u32..50).prop_map(|timestamp| uplink(BASE, timestamp).as_bytes().to_vec()),
        (0_u32..50).prop_map(|timestamp| uplink(FC, timestamp).as_bytes().to_vec()),
        (0_u32..50, prop::sample::select(Command::ALL.to_vec()))
            .prop_map(|(timestamp, what)| command(timestamp, what).as_bytes().to_vec()),
        (prop::collection::vec(any::<u8>(), 64)).prop_map(|bytes| sealed(bytes.try_into().expect("64")).to_vec()),
        prop::collection::vec(any::<u8>(), 64),
    ];
    (request, object, prop::collection::vec(any::<u8>(), 0..12), 0_usize..=90).prop_map(
        |(request, object, beyond, length)| {
            let mut mosi = [request, object, beyond].concat();
            if length < mosi.len() && length % 3 == 0 {
                mosi.truncate(length);
            }
            mosi
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]
    /// Where an image has an uplink, there are zeros, or an intact uplink of its own writer that was written less than
    /// 500 ms before. No other bytes that were written can be read back.
    #[test]
    fn whatever_is_clocked_in_only_the_uplinks_and_the_counters_change(
        transactions in prop::collection::vec((mosi(), 0_u32..300), 0..40),
    ) {
        let mut bench = Bench::new();
        let mut written: Vec<(u32, Vec<u8>)> = Vec::new();
        for (mosi, wait_ms) in transactions {
            bench.wait_ms(wait_ms);
            let before = bench.values();
            bench.clock(&mosi);
            let window = bench.windows.window();
            prop_assert!(window.start < window.end && window.end <= MAP);
            if let Some(object) = mosi.get(8..72) {
                written.push((bench.now_us, object.to_vec()));
            }
            let area = bench.area();
            let values = bench.values();
            let reading = area.verify();
            for (place, verified, fresh) in [
                (area.uplink::<BaseStation>(), reading.base_station, values.status.base_station_fresh()),
                (
                    area.uplink::<FlightController>(),
                    reading.flight_controller,
                    values.status.flight_controller_fresh(),
                ),
            ] {
                prop_assert_eq!(verified.is_ok(), fresh);
                let now_us = bench.now_us;
                let recent = |(at, object): &(u32, Vec<u8>)| object == place.as_bytes() && now_us - at < 500_000;
                prop_assert_eq!(fresh, place != &Uplink::EMPTY && written.iter().any(recent));
                prop_assert!(fresh || (place == &Uplink::EMPTY && verified == Err(Rejection::Crc)));
            }
            // Nothing that the flight controller writes changes the DPR's counts of its own faults. A transaction
            // counts as three violations at most.
            let faults = [values.integrity_faults, values.flash_passes, values.stuck_bits, values.buffers_out_of_use];
            prop_assert_eq!((faults, values.last_stop), ([0; 4], 0));
            let cleared = values.last_command == Command::ClearCounters.word();
            prop_assert!(cleared || values.violations.total() <= before.violations.total() + 3);
            prop_assert!(bench.port.access_violations() >= values.violations.total());
        }
    }

    /// The SSI task and the port task run in any order. Either all bytes of a transaction are judged as they came, or
    /// all are dropped.
    #[test]
    fn areas_rotate_clean_and_nothing_is_read_twice(
        steps in prop::collection::vec(prop::option::of(0_usize..=80), 0..60),
    ) {
        let mut areas = Areas::new();
        let (mut area, mut ssi, mut port, found) = areas.split([ReceiveArea::default(); AREAS]);
        prop_assert_eq!(found, Scrubbed { buffers: 3, ..Scrubbed::default() });
        let mut waiting = std::collections::VecDeque::new();
        let mut number = 0;
        for step in steps {
            if let Some(bytes) = step {
                let memory: &mut [u8] = bytemuck::cast_slice_mut(area.memory());
                prop_assert!(memory.iter().all(|&byte| byte == 0), "an area that was not scrubbed is lent");
                number = number % 254 + 1;
                memory[..bytes].fill(number);
                let transaction = Transaction { asked: Asked::Nothing, bytes };
                let (next, handed_over) = ssi.hand_over(area, transaction);
                area = next;
                let expected = match (bytes, waiting.len()) {
                    (0, _) => HandedOver::Empty,
                    (_, 0 | 1) => HandedOver::Waits,
                    (16.., _) => HandedOver::Dropped,
                    _ => HandedOver::DroppedIdle,
                };
                prop_assert_eq!(handed_over, expected);
                prop_assert_eq!(ssi.pass_on(), expected == HandedOver::Waits);
                if expected == HandedOver::Waits {
                    waiting.push_back((number, bytes));
                }
            } else {
                let brought = port.take();
                prop_assert_eq!(brought.is_some(), !waiting.is_empty());
                if let (Some(brought), Some((number, bytes))) = (brought, waiting.pop_front()) {
                    prop_assert_eq!(*brought.about(), Transaction { asked: Asked::Nothing, bytes });
                    let memory: &[u8] = bytemuck::cast_slice(brought.memory());
                    let mut expected = [0; RECEIVE_BYTES];
                    expected[..bytes].fill(number);
                    prop_assert_eq!(memory, &expected);
                    prop_assert_eq!(port.done(brought), Scrubbed { buffers: 1, ..Scrubbed::default() });
                }
            }
        }
    }
}

#[test]
fn an_object_that_is_dropped_is_told_by_its_identifier_and_status() {
    for (header, expected) in
        [(0, HandedOver::DroppedIdle), (u32::MAX, HandedOver::DroppedIdle), (0x4200, HandedOver::Dropped)]
    {
        let mut areas = Areas::new();
        let (mut area, mut ssi, _port, _) = areas.split([ReceiveArea::default(); AREAS]);
        let transaction = Transaction { asked: Asked::Nothing, bytes: 16 };
        for _ in 0..2 {
            let (next, handed_over) = ssi.hand_over(area, transaction);
            area = next;
            assert_eq!((handed_over, ssi.pass_on()), (HandedOver::Waits, true));
        }
        area.memory()[3] = header;
        let (area, handed_over) = ssi.hand_over(area, transaction);
        assert_eq!((handed_over, area.peek()), (expected, &ReceiveArea::default()));
    }
}

struct Stuck {
    area: ReceiveArea,
    mask: u32,
}

impl Memory for Stuck {
    fn words(&self) -> usize {
        self.area.words()
    }
    fn fill(&mut self, pattern: u32) {
        self.area.fill(pattern | self.mask);
    }
    fn differing_bits(&self, pattern: u32) -> u32 {
        Memory::differing_bits(&self.area, pattern)
    }
}

impl core::borrow::Borrow<ReceiveArea> for Stuck {
    fn borrow(&self) -> &ReceiveArea {
        &self.area
    }
}

impl core::borrow::BorrowMut<ReceiveArea> for Stuck {
    fn borrow_mut(&mut self) -> &mut ReceiveArea {
        &mut self.area
    }
}

#[test]
fn an_area_with_a_stuck_bit_leaves_use_while_two_are_left() {
    let mut areas = Areas::new();
    let all = [1, 0, 4].map(|mask| Stuck { area: ReceiveArea::default(), mask });
    let (mut area, mut ssi, mut port, found) = areas.split(all);
    assert_eq!(found, Scrubbed { buffers: 3, stuck_bits: 40, out_of_use: 0 });
    let transaction = Transaction { asked: Asked::Nothing, bytes: RECEIVE_BYTES };
    let mut out_of_use = 0;
    for _ in 0..6 {
        let (next, handed_over) = ssi.hand_over(area, transaction);
        assert_eq!((handed_over, ssi.pass_on()), (HandedOver::Waits, true));
        area = next;
        let brought = port.take().expect("it waits");
        out_of_use += port.done(brought).out_of_use;
    }
    assert_eq!(out_of_use, 1);
}
