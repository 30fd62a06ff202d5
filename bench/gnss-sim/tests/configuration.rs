//! Tests how a receiver applies its configuration, and what it answers.

use std::sync::Arc;

use gnss_sim::config::{
    ACK, CLASS_ACK, CLASS_CFG, MSGOUT_ESF_INS, MSGOUT_NAV_ATT, MSGOUT_NAV_PVT, NAK, NAVSPG_DYNMODEL, OUTPROT_NMEA,
    OUTPROT_UBX, RATE_MEAS, UART1_BAUDRATE, VALSET,
};
use gnss_sim::ubx::{self, Frame, NavPvt};
use gnss_sim::{Burst, Flight, Log, Port, Receiver};

const MS: u64 = 1_000_000;
const SECOND: u64 = 1_000 * MS;

fn receiver(index: usize, port: Port) -> Receiver {
    Receiver::generated(index, 1, Arc::new(Flight::new(1, 60.0))).connected_by(port)
}

/// Returns UBX-CFG-VALSET with these keys and values. Each value has the size that its key requires.
fn valset(layers: u8, items: &[(u32, u64)]) -> Vec<u8> {
    let mut payload = vec![0, layers, 0, 0];
    for (key, value) in items {
        payload.extend(key.to_le_bytes());
        let size = [0, 1, 1, 2, 4, 8, 0, 0][(key >> 28 & 7) as usize];
        payload.extend(&value.to_le_bytes()[..size]);
    }
    ubx::frame(CLASS_CFG, VALSET, &payload)
}

fn tell(receiver: &mut Receiver, at: u64, bytes: &[u8]) -> Vec<Vec<u8>> {
    bytes.iter().filter_map(|byte| receiver.hear(at, Some(*byte))).collect()
}

fn answer(id: u8) -> Vec<Vec<u8>> {
    vec![ubx::frame(CLASS_ACK, id, &[CLASS_CFG, VALSET])]
}

fn sent(receiver: &mut Receiver, end: u64) -> Vec<Burst> {
    std::iter::from_fn(|| if receiver.next_at()? < end { receiver.next() } else { None }).collect()
}

fn messages(burst: &Burst) -> Vec<(u8, u8)> {
    let (mut found, mut rest) = (vec![], &burst.bytes[..]);
    while !rest.is_empty() {
        let length = match Frame::at_start_of(rest) {
            Some(frame) => {
                found.push((frame.class, frame.id));
                frame.wire_len()
            }
            None => 1,
        };
        rest = &rest[length..];
    }
    found
}

const PVT: (u8, u8) = (ubx::CLASS_NAV, NavPvt::ID);
const ATT: (u8, u8) = (0x01, 0x05);
const INS: (u8, u8) = (0x10, 0x15);

#[test]
fn a_receiver_starts_as_horus_had_configured_it() {
    for (index, port, bursts) in [(1, Port::Uart1, 10), (2, Port::I2c, 8), (3, Port::Spi, 5)] {
        let mut saved = receiver(index, port);
        assert_eq!(saved.bit_rate(), 460_800);
        let sent = sent(&mut saved, SECOND + 80 * MS);
        assert!(sent.len().abs_diff(bursts) <= 1, "{index}: {}", sent.len());
        assert!(sent.iter().all(|burst| messages(burst)[0] == PVT && burst.bytes.starts_with(&ubx::SYNC)));
    }
}

#[test]
fn what_it_is_connected_by_makes_no_difference_to_what_it_says() {
    let flight = Arc::new(Flight::new(1, 60.0));
    for index in 1..=5 {
        let told: Vec<Burst> = Receiver::generated(index, 1, flight.clone()).take(20).collect();
        let over_bus = Receiver::generated(index, 1, flight.clone()).connected_by(Port::Spi);
        assert_eq!(told, over_bus.take(20).collect::<Vec<_>>());
    }
}

#[test]
fn it_keeps_the_factorys_dynamic_model_until_it_is_told_another() {
    for (index, factory) in [(1, 4), (2, 0), (3, 4), (4, 0), (5, 4)] {
        let mut receiver = receiver(index, Port::Spi);
        assert_eq!(receiver.dynamic_model(), Some(factory), "{index}: HORUS saves none");
        let before = sent(&mut receiver.clone(), SECOND);
        assert_eq!(tell(&mut receiver, 0, &valset(1, &[(NAVSPG_DYNMODEL, 7)])), answer(ACK));
        assert_eq!(receiver.dynamic_model(), Some(7));
        assert_eq!(sent(&mut receiver.clone(), SECOND), before, "it goes on with its solutions");
        for unknown in [1, 10, 255] {
            assert_eq!(tell(&mut receiver, 0, &valset(1, &[(NAVSPG_DYNMODEL, unknown)])), answer(NAK));
        }
        assert_eq!(receiver.dynamic_model(), Some(7));
        let mut forgetful = receiver.clone();
        forgetful.forget_dynamic_model();
        receiver.restart(SECOND, false);
        assert_eq!([forgetful.dynamic_model(), receiver.dynamic_model()], [Some(factory); 2]);
    }
}

#[test]
fn from_the_factory_it_sends_nmea_alone_once_a_second_at_38400() {
    let mut receiver = receiver(1, Port::Uart1).with_factory_settings();
    assert_eq!(receiver.bit_rate(), 38_400);
    let sent = sent(&mut receiver, 4 * SECOND);
    assert!((3..=4).contains(&sent.len()), "{}", sent.len());
    for burst in &sent {
        let text = String::from_utf8(burst.bytes.clone()).unwrap();
        let kinds: Vec<&str> = text.lines().map(|line| &line[..6]).collect();
        assert_eq!(kinds, ["$GNRMC", "$GNVTG", "$GNGGA"]);
        for line in text.lines() {
            let (body, sum) = line[1..].split_once('*').unwrap();
            assert_eq!(u8::from_str_radix(sum, 16).unwrap(), body.bytes().fold(0, |sum, byte| sum ^ byte));
        }
        assert!(text.contains(",N,00") && text.contains(",E,"), "near Winterthur: {text}");
    }
}

#[test]
fn what_horus_sets_takes_it_from_the_factory_to_where_it_was() {
    for (index, port) in [(1, Port::Uart1), (2, Port::I2c), (3, Port::Spi)] {
        let mut receiver = receiver(index, port).with_factory_settings();
        receiver.next();
        if port == Port::Uart1 {
            assert_eq!(tell(&mut receiver, SECOND, &valset(1, &[(UART1_BAUDRATE, 460_800)])), answer(ACK));
            assert_eq!(receiver.bit_rate(), 460_800);
        }
        let period = [0, 100, 125, 200][index];
        let items = [
            (port.protocol_key(OUTPROT_UBX), 1),
            (port.protocol_key(OUTPROT_NMEA), 0),
            (port.output_key(MSGOUT_NAV_PVT), 1),
            (RATE_MEAS, period),
        ];
        assert_eq!(tell(&mut receiver, SECOND, &valset(1, &items)), answer(ACK));
        let att = valset(1, &[(port.output_key(MSGOUT_NAV_ATT), 1)]);
        let ins = valset(1, &[(port.output_key(MSGOUT_ESF_INS), 1)]);
        assert_eq!(tell(&mut receiver, SECOND, &att), answer(if index == 2 { NAK } else { ACK }));
        assert_eq!(tell(&mut receiver, SECOND, &ins), answer(if index == 2 { NAK } else { ACK }));
        let sent = sent(&mut receiver, 3 * SECOND);
        assert!(sent.len().abs_diff((2_000 / period) as usize) <= 1, "{index}: {}", sent.len());
        let expected: &[_] = [&[][..], &[PVT, ATT, INS], &[PVT], &[PVT, ATT, INS]][index];
        assert!(sent.iter().all(|burst| messages(burst) == expected), "{index}");
        assert!(sent[0].at_ns > SECOND && sent[0].at_ns < SECOND + (period + 100) * MS, "it begins at once");
        let itow = |burst: &Burst| Frame::at_start_of(&burst.bytes).unwrap().itow_ms().unwrap();
        assert!(sent.windows(2).all(|pair| u64::from(itow(&pair[1]) - itow(&pair[0])) == period));
    }
}

#[test]
fn a_message_with_a_key_that_is_not_known_is_refused_whole() {
    let mut receiver = receiver(1, Port::Uart1);
    let before = receiver.output();
    let refused = |receiver: &mut Receiver, items: &[(u32, u64)]| {
        assert_eq!(tell(receiver, 0, &valset(1, items)), answer(NAK), "{items:x?}");
        assert_eq!(receiver.output(), before);
    };
    refused(&mut receiver, &[(RATE_MEAS, 200), (0x2091_0FFF, 1)]);
    refused(&mut receiver, &[(RATE_MEAS, 0)]);
    refused(&mut receiver, &[(UART1_BAUDRATE, 123_456)]);
    refused(&mut receiver, &[(Port::Uart1.protocol_key(OUTPROT_UBX), 2)]);
    refused(&mut receiver, &[]);
    refused(&mut receiver, &[(RATE_MEAS, 200); 65]);
    // UBX-CFG-VALSET is refused without a layer, with an unknown version, and with an incomplete item.
    let cut = [0, 1, 0, 0, 1, 0, 0x21, 0x30, 5];
    assert_eq!(tell(&mut receiver, 0, &valset(0, &[(RATE_MEAS, 200)])), answer(NAK));
    assert_eq!(tell(&mut receiver, 0, &ubx::frame(CLASS_CFG, VALSET, &[7, 1, 0, 0])), answer(NAK));
    assert_eq!(tell(&mut receiver, 0, &ubx::frame(CLASS_CFG, VALSET, &cut)), answer(NAK));
    assert_eq!(receiver.output(), before);
    let other = tell(&mut receiver, 0, &ubx::frame(CLASS_CFG, 0x00, &[1; 20]));
    assert_eq!(other, [ubx::frame(CLASS_ACK, NAK, &[CLASS_CFG, 0x00])]);
    assert!(tell(&mut receiver, 0, &ubx::frame(0x0A, 0x04, &[])).is_empty());
}

#[test]
fn keys_of_other_ports_are_known_and_change_nothing_here() {
    let mut receiver = receiver(1, Port::I2c);
    let before = receiver.output();
    let items = [(Port::Spi.output_key(MSGOUT_NAV_PVT), 0), (Port::Uart1.protocol_key(OUTPROT_UBX), 0)];
    assert_eq!(tell(&mut receiver, 0, &valset(1, &items)), answer(ACK));
    assert_eq!(receiver.output(), before);
    assert_eq!(tell(&mut receiver, 0, &valset(1, &[(Port::I2c.protocol_key(OUTPROT_UBX), 0)])), answer(ACK));
    assert!(sent(&mut receiver, SECOND).iter().all(|burst| burst.bytes.is_empty()));
}

#[test]
fn damaged_messages_are_not_answered_and_the_next_is_found() {
    let mut receiver = receiver(1, Port::Uart1);
    let good = valset(1, &[(RATE_MEAS, 200)]);
    let mut bad = good.clone();
    bad[8] ^= 1;
    let noise = [&bad[..], b"\xB5\xB5\x62\x06\x8A\xFF\xFF$GNGGA", &good].concat();
    assert_eq!(tell(&mut receiver, 0, &noise), answer(ACK));
    assert_eq!(receiver.output().unwrap().period_ms, 200);
    // An unreadable byte breaks its message.
    let half = good.len() / 2;
    assert!(tell(&mut receiver, 0, &good[..half]).is_empty());
    assert_eq!(receiver.hear(0, None), None);
    assert!(tell(&mut receiver, 0, &good[half..]).is_empty());
}

#[test]
fn a_restart_loses_what_was_not_saved() {
    let mut receiver = receiver(1, Port::Uart1);
    tell(&mut receiver, 0, &valset(1, &[(RATE_MEAS, 200)]));
    receiver.restart(SECOND, false);
    assert_eq!(receiver.output().unwrap().period_ms, 100);
    tell(&mut receiver, SECOND, &valset(2, &[(RATE_MEAS, 500)]));
    receiver.restart(2 * SECOND, false);
    assert_eq!(receiver.output().unwrap().period_ms, 500);
    receiver.restart(3 * SECOND, true);
    assert_eq!((receiver.output().unwrap().period_ms, receiver.bit_rate()), (1_000, 38_400));
    assert!(receiver.next_at().unwrap() > 3 * SECOND);
}

#[test]
fn a_receiver_with_a_fixed_period_refuses_another() {
    let mut receiver = receiver(1, Port::Uart1).with_fixed_period(40);
    assert!(sent(&mut receiver, SECOND + 48 * MS).len().abs_diff(25) <= 1);
    let items = [(Port::Uart1.output_key(MSGOUT_NAV_PVT), 0), (RATE_MEAS, 100)];
    assert_eq!(tell(&mut receiver, SECOND, &valset(1, &items)), answer(NAK));
    let output = receiver.output().unwrap();
    assert_eq!((output.period_ms, output.position), (40, 1));
}

#[test]
fn a_recorded_receiver_answers_nothing() {
    let pvt = NavPvt { itow_ms: 1_000, fix_type: 3, flags: NavPvt::FLAG_FIX_OK, ..NavPvt::default() };
    let log = Log::from_bytes("made.ubx", pvt.encode()).expect("it holds a position");
    let mut receiver = Receiver::recorded(Arc::new(log));
    let first = receiver.next_at();
    assert!(tell(&mut receiver, 0, &valset(1, &[(RATE_MEAS, 200)])).is_empty());
    receiver.restart(0, true);
    assert_eq!((receiver.next_at(), receiver.output()), (first, None));
}
