//! Tests the hold's object, the exchange, and their offsets in map and answer, against bytes written by hand.
use profile::criticality::{ActiveLoad, BaseStation, FlightController, Writer};
use profile::hold::{self, Acknowledged, Answer, HoldObjectValues, Outcome};
use profile::map::{self, Map};
use profile::{
    HoldObject, HoldStatus, HoldStatusBits, HoldValues, Identifier, Layout, Rejection, Uplink, UplinkStatus, air,
};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngSeed};

use crate::support;

use support::{reference, seeds};

const HOLD: Writer<ActiveLoad> = Writer::claim();

#[rustfmt::skip]
const HOLD_STATUS: [u8; 60] = [
    0x10, 0x27, 0x00, 0x00, // 10 000 ms
    0x00, 0x41,             // 0x4100: Hold-Status
    0x83, 0x00,             // values valid, within limits; watchdog reset
    0x00, 0x00, 0x90, 0x40, // 4.5 °C
    0x00, 0x00, 0x2A, 0x42, // 42.5 %
    0x00, 0x00, 0xA0, 0x40, // set-point 5 °C
    0x00, 0x00, 0x80, 0x3E, // x 0.25 m/s²
    0x00, 0x00, 0x00, 0x3F, // y 0.5 m/s²
    0x00, 0x00, 0xC0, 0x7F, // z not known
    0x00, 0x00, 0x1A, 0x42, // greatest shock 38.5 m/s²
    0x00, 0x00, 0x42, 0x41, // 12.125 V
    0x00, 0x00, 0x40, 0xBF, // output -0.75: cooling
    0x34, 0x12, 0x01, 0x00, // the base station's 0x1234 is done
    0x78, 0x56, 0x04, 0x00, // the flight controller's 0x5678 was too old
    0x0A, 0x00, 0x00, 0x00, // 10 s
    0x00, 0x00, 0x00, 0x00,
];

fn values() -> HoldValues {
    seeds::hold_values(10_000)
}

#[test]
fn hold_status_is_the_bytes_of_its_table() {
    let sealed = HoldStatus::seal(HOLD, &values());
    assert_eq!(sealed.as_bytes()[..60], HOLD_STATUS);
    assert_eq!(sealed.as_bytes()[60..], reference::crc(reference::FRAME, &HOLD_STATUS).to_be_bytes());
    assert_eq!(HoldStatus::verify(sealed.as_bytes()), Ok(&sealed));
    let read = sealed.values();
    assert_eq!(HoldStatus::seal(HOLD, &read), sealed);
    assert_eq!((read.temperature, read.humidity, read.set_point), (4.5, 42.5, 5.0));
    assert_eq!((read.vibration[0], read.vibration[1], read.vibration[2].to_bits()), (0.25, 0.5, 0x7FC0_0000));
    assert_eq!((read.greatest_shock, read.supply, read.output, read.seconds), (38.5, 12.125, -0.75, 10));
    assert_eq!((read.timestamp, read.acknowledged), (10_000, values().acknowledged));
    assert!(format!("{sealed:?}").contains("supply: 12.125"), "{sealed:?}");
}

#[test]
fn what_a_starting_hold_does_not_know_is_nan() {
    let sealed = HoldStatus::seal(HOLD, &HoldValues::absent(0));
    assert_eq!(sealed.as_bytes()[8..40], [0x00, 0x00, 0xC0, 0x7F].repeat(8));
    assert_eq!(sealed.as_bytes()[40..60], [0; 20], "its output is off, and there was no command");
    assert_eq!(sealed.as_bytes()[..8], [0, 0, 0, 0, 0x00, 0x41, 0, 0]);
}

#[test]
fn each_bit_of_hold_status_is_where_the_table_says() {
    let set: [fn(HoldStatusBits) -> HoldStatusBits; 6] = [
        |bits| bits.with_values_valid(true),
        |bits| bits.with_within_limits(true),
        |bits| bits.with_locked(true),
        |bits| bits.with_sensor_fault(true),
        |bits| bits.with_memory_fault(true),
        |bits| bits.with_safe_state(true),
    ];
    for (bit, set) in set.into_iter().enumerate() {
        assert_eq!(set(HoldStatusBits::new()).bits(), 1 << bit);
    }
    let reasons = (0..8).map(|code| HoldStatusBits::from_bits(0xFE3F | code << 6));
    for (code, status) in (0..).zip(reasons) {
        let Some(reason) = status.reset_reason() else {
            assert!(code > 5, "{code} is reserved");
            continue;
        };
        assert_eq!((reason as u16, status.bits()), (code, 0x003F | code << 6));
        assert_eq!(HoldStatusBits::from_bits(u16::MAX).with_reset_reason(reason), status);
    }
    assert_eq!(HoldStatusBits::from_bits(u16::MAX).bits(), 0x01FF);
}

#[test]
fn each_outcome_has_its_code_and_others_are_reserved() {
    let outcomes = [Outcome::Nothing, Outcome::Done, Outcome::Refused, Outcome::Unknown, Outcome::TooOld];
    let mut bytes = *HoldStatus::seal(HOLD, &values()).as_bytes();
    for code in 0..=u16::MAX {
        bytes[46..48].copy_from_slice(&code.to_le_bytes());
        reference::repair_frame_crc(&mut bytes);
        let acknowledged = HoldObject::verify(&bytes).expect("intact").acknowledged::<BaseStation>();
        assert_eq!(acknowledged.outcome(), outcomes.get(usize::from(code)).copied());
        assert_eq!((acknowledged.number(), acknowledged.code()), (0x1234, code));
        if let Some(outcome) = acknowledged.outcome() {
            assert_eq!(outcome.code(), code);
        }
    }
}

#[test]
fn an_object_of_any_maker_has_the_acknowledgements_in_one_place() {
    let theirs = HoldObjectValues {
        timestamp: 0x0403_0201,
        status: UplinkStatus::from_bits(0xF00F),
        values: [0x5A; HoldObject::VALUES],
        acknowledged: values().acknowledged,
        more: [0xC3; HoldObject::MORE],
    };
    let sealed = HoldObject::seal(HOLD, Identifier(0x41FF), &theirs);
    let mut bytes = [0; 64];
    bytes[..8].copy_from_slice(&[1, 2, 3, 4, 0xFF, 0x41, 0x0F, 0xF0]);
    bytes[8..44].fill(0x5A);
    bytes[44..52].copy_from_slice(&HOLD_STATUS[44..52]);
    bytes[52..60].fill(0xC3);
    reference::repair_frame_crc(&mut bytes);
    assert_eq!(sealed.as_bytes(), &bytes);
    assert_eq!((HoldObject::verify(&bytes), sealed.values()), (Ok(&sealed), theirs));
    assert_eq!(HoldStatus::verify(&bytes), Err(Rejection::Identifier));
    let ours = HoldStatus::seal(HOLD, &values());
    let object = HoldObject::verify(ours.as_bytes()).expect("an object of a hold");
    assert_eq!((object, object.values().acknowledged), (ours.as_object(), values().acknowledged));
    assert_eq!(object.acknowledged::<BaseStation>(), values().acknowledged[0]);
    assert_eq!(object.acknowledged::<FlightController>(), values().acknowledged[1]);
}

#[test]
fn of_all_identifiers_256_are_the_holds() {
    let mut bytes = *HoldStatus::seal(HOLD, &values()).as_bytes();
    for identifier in 0..=u16::MAX {
        bytes[4..6].copy_from_slice(&identifier.to_le_bytes());
        let crc = profile::crc::frame(&bytes[..60]);
        bytes[60..].copy_from_slice(&crc.to_be_bytes());
        let is_hold = (0x4100..=0x41FF).contains(&identifier);
        assert_eq!(HoldObject::verify(&bytes).err(), (!is_hold).then_some(Rejection::Identifier));
        let is_ours = identifier == 0x4100;
        assert_eq!(HoldStatus::verify(&bytes).err(), (!is_ours).then_some(Rejection::Identifier));
    }
    assert_eq!(Identifier::HOLD_STATUS.to_string(), "Hold-Status");
    assert_eq!(Identifier(0x4101).to_string(), "object 0x4101");
}

// Shows HOLD-1.
#[test]
#[should_panic(expected = "GPS1 is no identifier of an active load")]
fn a_hold_cannot_seal_an_object_of_horus() {
    let theirs = HoldStatus::EMPTY.as_object().values();
    let _ = HoldObject::seal(HOLD, Identifier::gps(1), &theirs);
}

#[test]
fn any_damage_to_hold_status_is_rejected() {
    let good = *HoldStatus::seal(HOLD, &values()).as_bytes();
    for bit in 0..8 * 64 {
        let damaged = reference::flipped(&good, [bit]);
        assert_eq!(HoldStatus::verify(&damaged), Err(Rejection::Crc), "bit {bit}");
        assert_eq!(HoldObject::verify(&damaged), Err(Rejection::Crc), "bit {bit}");
    }
    for length in [0, 63, 65] {
        assert_eq!(HoldStatus::verify(&vec![0; length]), Err(Rejection::Length));
    }
    assert_eq!(HoldStatus::verify(HoldStatus::EMPTY.as_bytes()), Err(Rejection::Crc));
    assert_eq!(HoldObject::verify(&[0xFF; 64]), Err(Rejection::Crc));
}

proptest! {
    #![proptest_config(Config {
        cases: 512, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..Config::default()
    })]

    #[test]
    fn hold_status_reads_as_it_was_sealed_to_the_last_bit(
        timestamp: u32, status: u16, f32s: [u32; 9], acknowledged: [u16; 2], seconds: u32,
    ) {
        let [temperature, humidity, set_point, x, y, z, greatest_shock, supply, output] = f32s.map(f32::from_bits);
        let values = HoldValues {
            timestamp,
            status: HoldStatusBits::from_bits(status),
            temperature,
            humidity,
            set_point,
            vibration: [x, y, z],
            greatest_shock,
            supply,
            output,
            acknowledged: acknowledged.map(|number| Acknowledged::new(number, Outcome::Refused)),
            seconds,
        };
        let sealed = HoldStatus::seal(HOLD, &values);
        let read = HoldStatus::verify(sealed.as_bytes()).expect("intact").values();
        let [vx, vy, vz] = read.vibration;
        let again = [
            read.temperature, read.humidity, read.set_point, vx, vy, vz, read.greatest_shock, read.supply, read.output,
        ];
        prop_assert_eq!(again.map(f32::to_bits), f32s);
        prop_assert_eq!((read.timestamp, read.status, read.seconds), (timestamp, values.status, seconds));
        prop_assert_eq!(read.acknowledged, values.acknowledged);
    }
}

#[test]
fn an_answer_is_both_uplinks_as_they_were_written() {
    let (base, own) = (Writer::<BaseStation>::claim(), Writer::<FlightController>::claim());
    let [first, second] = [Uplink::seal(base, &seeds::uplink_values(70)), Uplink::seal(own, &seeds::uplink_values(80))];
    let mut answer = Answer::EMPTY;
    assert_eq!(answer.as_bytes(), &[0; 128]);
    answer.set_uplink(own, second);
    assert_eq!(answer.as_bytes()[..64], [0; 64]);
    assert_eq!(answer.uplink::<BaseStation>(), Err(Rejection::Crc));
    assert_eq!(answer.uplink::<FlightController>(), Ok(&second));
    answer.set_uplink(base, first);
    assert_eq!(answer.as_bytes()[..], [*first.as_bytes(), *second.as_bytes()].concat());
    let read = Answer::read(answer.as_bytes()).expect("128 bytes");
    assert_eq!(read.uplink::<BaseStation>(), Ok(&first));
    assert_eq!(read.uplink::<FlightController>(), Ok(&second));
    answer.set_uplink(base, Uplink::EMPTY);
    assert_eq!(answer.uplink::<BaseStation>(), Err(Rejection::Crc));
    for length in [0, 64, 127, 129] {
        assert_eq!(Answer::read(&vec![0; length]), Err(Rejection::Length));
    }
    let exchanged = [*second.as_bytes(), *first.as_bytes()].concat();
    let exchanged = Answer::read(&exchanged).expect("128 bytes");
    assert_eq!(exchanged.uplink::<BaseStation>(), Err(Rejection::Identifier));
    assert_eq!(exchanged.uplink::<FlightController>(), Err(Rejection::Identifier));
    assert!(format!("{answer:?}").contains("timestamp: 80"), "{answer:?}");
}

#[test]
fn an_exchange_takes_less_than_a_tenth_of_its_period() {
    assert_eq!((hold::FRAME_NS, hold::ANSWER_NS), (air::air_time_ns(64), air::air_time_ns(128)));
    assert_eq!(hold::EXCHANGE_NS, 1_415_929 + 3_000_000 + 2_624_189);
    assert_eq!((hold::PERIOD_MS, hold::EXPIRY_MS, hold::COMMAND_AGE_MS), (100, 300, 1_000));
}

#[test]
fn the_holds_object_follows_both_uplinks_in_the_map() {
    fn of<const N: usize>() {
        let len = 288 + 60 * N;
        assert_eq!((Map::<N>::LEN, Map::<N>::LEN_WITH_HOLD, Map::<N>::hold()), (len, len + 64, len..len + 64));
        let layout = Layout::for_receivers(N).expect("a profile");
        assert_eq!((layout.map_len(), layout.hold()), (len, None), "without a hold");
        let layout = layout.with_hold();
        assert_eq!((layout.map_len(), layout.hold()), (len + 64, Some(len..len + 64)));
        assert_eq!(layout.uplink::<FlightController>().end, len);
        let mut map = vec![0; len + 64];
        *map::hold_mut::<_, N>(HOLD, &mut map).expect("in the map") = [0xA5; 64];
        assert!(map[..len].iter().all(|byte| *byte == 0) && map[len..].iter().all(|byte| *byte == 0xA5));
        assert_eq!(map::hold_mut::<_, N>(HOLD, &mut map[1..]), None);
    }
    of::<1>();
    of::<2>();
    of::<3>();
    of::<5>();
    assert!(Layout::ALL.iter().all(|layout| layout.hold().is_none()));
}

#[test]
fn the_design_states_the_numbers_of_the_hold() {
    let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let page = words(include_str!("../../docs/design.md"));
    let ms = |ns: u64| format!("{:.3}", ns as f64 / 1e6);
    let window_ms = hold::ANSWER_WINDOW_US / 1_000;
    for number in [
        format!("with a period of {} ms", hold::PERIOD_MS),
        format!("{{Hold-Status}}, of {} bytes", HoldObject::SIZE),
        format!("of {} bytes, which begins within {window_ms} ms of", Answer::SIZE),
        format!("none that is intact and at most {} s old", hold::COMMAND_AGE_MS / 1_000),
        format!("{} ms of air time for the frame, {} ms for", ms(hold::FRAME_NS), ms(hold::ANSWER_NS)),
        format!("one exchange takes {} ms at most", ms(hold::EXCHANGE_NS)),
        format!("| offset | Hold-Status, {} bytes |", HoldStatus::SIZE),
        format!("first {} of an uplink's {} payload bytes", hold::COMMAND_SIZE, Uplink::PAYLOAD),
        format!("**expires** {} ms after it came", hold::EXPIRY_MS),
        format!("stayed the same for more than {} s of the hold's time", hold::COMMAND_AGE_MS / 1_000),
        format!("stayed the same for more than {} ms since", hold::EXPIRY_MS),
        format!(
            "| 288 + 60 n | object of the [active hold](#the-hold-in-the-dpr), where there is one | {}",
            HoldObject::SIZE
        ),
    ] {
        assert_eq!(page.matches(&words(&number)).count(), 1, "docs/design.md does not have once: {number}");
    }
    assert_eq!(Map::<1>::hold().start, 288 + 60);
}
