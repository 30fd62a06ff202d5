//! Tests the driver's exchange (poller) against its answerer (listener), each on its own chip model. Driver and model
//! were written independently of each other.

use crate::common;

use common::two_way::{World, configs};
use common::{Side, payload};
use proptest::collection::vec;
use proptest::prelude::*;
use st25r3916::exchange::WINDOW_US;
use st25r3916::{AnswererEvent, Dropped, ExchangeEvent, FRAME_US, FrameFlags, NoAnswer};
use st25r3916_model::{AirFaults, AnswerFaults, Config, ForeignCard};

const MS: u64 = 1_000_000;
const CLEAN: ExchangeEvent = ExchangeEvent::Answer { len: 128, flags: FrameFlags::empty() };
const SILENT: ExchangeEvent = ExchangeEvent::NoAnswer(NoAnswer::Silent);
/// The duration on the air of a frame with 64 bytes of payload, ns.
const FRAME_NS: u64 = 1_415_930;

fn parts() -> [Config; 2] {
    [Config::default(), Config::st25r3916()]
}

fn strict(config: Config) -> Config {
    Config { unsuited_chain_receives: false, unsuited_modulation_reaches: false, ..config }
}

fn works(world: &mut World, seed: u64) {
    let sent = payload(64, seed);
    world.answer = payload(128, seed + 1);
    let event = world.cycle(&sent).map(|(event, _)| event);
    assert_eq!(event, Some(CLEAN), "{:?} {:?}", world.hold.events, world.port.events);
    assert_eq!((world.frames.last(), world.answers.last()), (Some(&sent), Some(&world.answer)));
}

#[test]
fn both_parts_on_either_side_exchange_frame_and_answer() {
    for hold in parts() {
        for port in parts() {
            let mut world = World::started(configs(strict(hold.clone()), strict(port)));
            for cycle in 0..20 {
                works(&mut world, cycle);
            }
            assert_eq!(world.findings(), Vec::<String>::new());
            assert_eq!((world.frames.len(), world.answers.len()), (20, 20));
            let (air, back) = (world.air.counters(), world.back.counters());
            assert_eq!((air.sent, air.delivered, air.answers, back.delivered), (20, 20, 20, 20));
        }
    }
}

#[test]
fn every_length_of_frame_and_answer_crosses() {
    let mut world = World::started(configs(Config::default(), Config::default()));
    for len in (1..=254).step_by(11) {
        let sent = payload(len, 3);
        world.answer = payload(255 - len, 4);
        let (event, _) = world.cycle(&sent).expect("it ends");
        assert_eq!(event, ExchangeEvent::Answer { len: 255 - len, flags: FrameFlags::empty() });
        assert_eq!((world.frames.last(), world.answers.last()), (Some(&sent), Some(&world.answer)));
    }
    assert_eq!(world.findings(), Vec::<String>::new());
}

#[test]
fn every_switch_of_the_part_is_survived() {
    for bits in 0..32_u32 {
        let on = |bit: u32| bits >> bit & 1 != 0;
        let config = |answers| Config {
            transmit_unmasks: on(0),
            unmask_clears_fifo: on(1),
            db_clears_irqs: on(2),
            target_rearms_by_command: on(3),
            stop_clears_irqs: on(4),
            answers,
            ..Config::default()
        };
        let mut world = World::started(configs(config(false), config(true)));
        for cycle in 0..4 {
            works(&mut world, cycle);
        }
        assert_eq!(world.findings(), Vec::<String>::new(), "{bits:05b}");
    }
}

#[test]
fn an_answer_leaves_at_a_fixed_instant_whatever_it_says() {
    let exact = || Config { transmit_scatter_ns: 0, ..Config::default() };
    let mut world = World::started(configs(exact(), exact()));
    let mut after = vec![];
    for fill in [0x00, 0xFF, 0x5A, 0x81] {
        world.answer = vec![fill; 128];
        let (event, _) = world.cycle(&[fill ^ 0x0F; 64]).expect("it ends");
        assert_eq!(event, CLEAN);
        let frame = world.air.take_heard().pop().expect("a frame was heard");
        let answer = world.back.take_heard().pop().expect("an answer was heard");
        after.push(answer.started_ns - frame.ended_ns);
    }
    // I_rxe comes 4.72 µs after the frame's end, and the transmit command 700 µs after I_rxe. The command takes one
    // byte, and the answer's first bit leaves 3.65 µs after the command.
    assert_eq!(after, [4_720 + 700_000 + 1_000 + 3_650; 4]);
}

#[test]
fn only_an_answer_within_the_window_is_received() {
    for (after, heard) in [(200, true), (376, true), (1_500, true), (2_990, true), (3_060, false), (5_000, false)] {
        let mut world = World::started(configs(Config::default(), Config::default()));
        world.answers_after_ns = after * 1_000;
        let (event, _) = world.cycle(&[1; 64]).expect("it ends");
        assert_eq!(event, if heard { CLEAN } else { SILENT }, "{after} us");
        world.answers_after_ns = 700_000;
        works(&mut world, 1);
    }
}

type Case = (AnswerFaults, fn(ExchangeEvent) -> bool);

#[test]
fn each_fault_of_an_answer_is_told_and_the_next_cycle_works() {
    let way = |way: AirFaults| AnswerFaults { way, ..AnswerFaults::default() };
    let foreign =
        |after_us: u64| ForeignCard { answers: 1.0, after_ns: (after_us * 1_000, after_us * 1_000), payload: 128 };
    let cases: [(&str, Case); 7] = [
        ("none", (way(AirFaults { lost: 1.0, ..AirFaults::default() }), |event| event == SILENT)),
        (
            "late",
            (way(AirFaults { delayed: 1.0, delay_ns: (3 * MS, 60 * MS), ..AirFaults::default() }), |event| {
                event == SILENT
            }),
        ),
        (
            "damaged",
            (
                way(AirFaults { burst: 1.0, burst_bits: 16, ..AirFaults::default() }),
                |event| matches!(event, ExchangeEvent::Answer { flags, .. } if flags.contains(FrameFlags::CRC)),
            ),
        ),
        (
            "cut",
            (way(AirFaults { truncated: 1.0, ..AirFaults::default() }), |event| match event {
                ExchangeEvent::Answer { len, flags } => len < 128 && flags.contains(FrameFlags::FRAMING),
                event => event == ExchangeEvent::NoAnswer(NoAnswer::Dropped(Dropped::Runt)) || event == SILENT,
            }),
        ),
        (
            "twice",
            (way(AirFaults { repeated: 1.0, repeat_after_ns: (10_000, 10_000), ..AirFaults::default() }), |event| {
                event == CLEAN || event == ExchangeEvent::NoAnswer(NoAnswer::Dropped(Dropped::Overrun))
            }),
        ),
        (
            "foreign first",
            (AnswerFaults { foreign: foreign(300), ..AnswerFaults::default() }, |event| {
                !matches!(event, ExchangeEvent::Fault(_)) && event != CLEAN
            }),
        ),
        (
            "foreign second",
            (AnswerFaults { foreign: foreign(1_500), ..AnswerFaults::default() }, |event| {
                !matches!(event, ExchangeEvent::Fault(_)) && event != CLEAN
            }),
        ),
    ];
    for (name, (faults, told)) in cases {
        let mut world = World::started(configs(Config::default(), Config::st25r3916()));
        for cycle in 0..30 {
            let now = world.now;
            world.back.set_faults(now, faults, &mut |_, _| {});
            world.answer = payload(128, cycle);
            let (event, _) = world.cycle(&payload(64, cycle)).expect("it ends");
            assert!(told(event), "{name}: {event:?}");
            if event == CLEAN {
                assert_eq!(world.answers.last(), Some(&world.answer));
            }
            let now = world.now;
            world.back.set_faults(now, AnswerFaults::default(), &mut |_, _| {});
            works(&mut world, cycle);
        }
        assert_eq!(world.findings(), Vec::<String>::new(), "{name}");
    }
}

#[test]
fn a_foreign_card_alone_is_delivered_as_what_it_says() {
    let mut world = World::started(configs(Config::default(), Config::default()));
    let foreign = ForeignCard { answers: 1.0, after_ns: (400_000, 2_900_000), payload: 128 };
    let faults = AnswerFaults { foreign, ..AnswerFaults::default() };
    world.back.set_faults(world.now, faults, &mut |_, _| {});
    // The DPR's answer comes after the time in which the poller accepts an answer.
    world.answers_after_ns = 20 * MS;
    for cycle in 0..20 {
        let (event, _) = world.cycle(&payload(64, cycle)).expect("it ends");
        assert_eq!(event, CLEAN, "only the content tells it");
    }
    assert_eq!((world.answers.len(), world.back.foreign_answers(), world.back.collisions()), (20, 20, 0));
    assert!(world.answers.iter().all(|answer| *answer != world.answer));
    world.back.set_faults(world.now, AnswerFaults::default(), &mut |_, _| {});
    world.answers_after_ns = 700_000;
    works(&mut world, 1);
}

#[test]
fn a_frame_that_is_lost_is_not_answered() {
    let mut world = World::started(configs(Config::default(), Config::default()));
    let [_, port] = &mut world.chips;
    let lost = AirFaults { lost: 1.0, ..AirFaults::default() };
    world.air.set_faults(world.now, lost, &mut |at, event| port.hear(at, event));
    let (event, _) = world.cycle(&[1; 64]).expect("it ends");
    assert_eq!((event, world.air.counters().answers), (SILENT, 0));
    let [_, port] = &mut world.chips;
    world.air.set_faults(world.now, AirFaults::default(), &mut |at, event| port.hear(at, event));
    works(&mut world, 1);
}

#[test]
fn an_exchange_recovers_from_a_carrier_lost_during_an_answer() {
    // The carrier is lost at another instant of the exchange in each run.
    for after_us in (0..4_850).step_by(150) {
        let mut world = World::started(configs(Config::default(), Config::default()));
        world.begin(&[1; 64]);
        let from = world.now;
        world.run_to(from + after_us * 1_000);
        let now = world.now;
        world.chip(Side::Poller).power_off(now);
        world.run_to(now + 2 * MS);
        let now = world.now;
        world.chip(Side::Poller).power_on(now);
        world.run_to(now + 200 * MS);
        assert!(world.hold.events.iter().any(|(_, event)| matches!(event, ExchangeEvent::Fault(_))), "{after_us}");
        assert!(world.hold.executor.machine().is_ready(), "{after_us}: {:?}", world.hold.events);
        works(&mut world, after_us);
    }
}

#[test]
fn an_answerer_that_loses_its_supply_is_missed_and_answers_again() {
    for after_us in (0..6_000).step_by(170) {
        let mut world = World::started(configs(Config::default(), Config::default()));
        world.begin(&[1; 64]);
        let from = world.now;
        world.run_to(from + after_us * 1_000);
        let now = world.now;
        world.chip(Side::Listener).power_off(now);
        world.run_to(now + 2 * MS);
        let now = world.now;
        world.chip(Side::Listener).power_on(now);
        world.run_to(now + 200 * MS);
        assert!(world.hold.executor.machine().is_ready());
        assert!(!world.hold.events.iter().any(|(_, event)| matches!(event, ExchangeEvent::Fault(_))), "{after_us}");
        works(&mut world, after_us);
    }
}

#[test]
fn an_exchange_ends_within_its_bound() {
    let mut world = World::started(configs(Config::default(), Config::default()));
    world.answer = payload(254, 1);
    world.answers_after_ns = 2_980_000;
    let (event, took) = world.cycle(&[1; 64]).expect("it ends");
    assert_eq!(event, ExchangeEvent::Answer { len: 254, flags: FrameFlags::empty() });
    assert!(took < FRAME_NS + (3_000 + 5_003 + 254 + 150) * 1_000, "{took} ns");
    world.answers_after_ns = 50 * MS;
    let (event, took) = world.cycle(&[1; 64]).expect("it ends");
    assert_eq!(event, SILENT);
    assert!(took < FRAME_NS + (u64::from(WINDOW_US) + 300) * 1_000, "{took} ns");
}

#[test]
fn an_answerer_that_is_late_gives_up_nothing_but_its_answer() {
    let mut world = World::started(configs(Config::default(), Config::default()));
    for cycle in 0..10 {
        world.answers_after_ns = if cycle % 2 == 0 { 98 * MS } else { 700_000 };
        let (event, _) = world.cycle(&payload(64, cycle)).expect("it ends");
        // The late answer is still on the air when the poller sends its next frame, which the answering chip cannot
        // receive.
        assert!(matches!(event, ExchangeEvent::NoAnswer(_)) || cycle % 2 == 1 && event == CLEAN, "{event:?}");
    }
    world.answers_after_ns = 700_000;
    world.cycle(&[1; 64]);
    works(&mut world, 1);
    assert!(world.port.events.iter().all(|(_, event)| !matches!(event, AnswererEvent::Fault(_))));
}

fn air_faults() -> impl Strategy<Value = AirFaults> {
    let some = || prop_oneof![3 => Just(0.0), 1 => 0.0..1.0, 1 => Just(1.0)];
    (some(), some(), some(), some(), some(), (0..90 * MS, 0..5 * MS), any::<bool>()).prop_map(
        |(lost, truncated, burst, repeated, delayed, (delay, repeat), errors)| AirFaults {
            bit_error: if errors { 0.001 } else { 0.0 },
            lost,
            truncated,
            burst,
            burst_bits: 40,
            repeated,
            repeat_after_ns: (10_000, repeat),
            delayed,
            delay_ns: (10_000, delay),
            ..AirFaults::default()
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 96,
        failure_persistence: None,
        rng_seed: prop::test_runner::RngSeed::Fixed(26),
        ..ProptestConfig::default()
    })]

    #[test]
    fn any_fault_on_the_air_leaves_the_next_exchange_intact(
        hold_is_b in any::<bool>(),
        port_is_b in any::<bool>(),
        there in air_faults(),
        way in air_faults(),
        foreign in (0.0..1.0, 0..6 * MS, any::<u8>()),
        after_us in 150..5_000_u64,
        cycles in vec((1..255_usize, 1..255_usize), 1..6),
    ) {
        let part = |b: bool| if b { Config::default() } else { Config::st25r3916() };
        let mut world = World::started(configs(part(hold_is_b), part(port_is_b)));
        let [_, port] = &mut world.chips;
        world.air.set_faults(world.now, there, &mut |at, event| port.hear(at, event));
        let (answers, after, payload_len) = foreign;
        let foreign = ForeignCard { answers, after_ns: (0, after), payload: payload_len.min(254) };
        world.back.set_faults(world.now, AnswerFaults { way, foreign }, &mut |_, _| {});
        world.answers_after_ns = after_us * 1_000;
        for (cycle, (frame, answer)) in cycles.into_iter().enumerate() {
            world.answer = payload(answer, cycle as u64);
            let ended = world.cycle(&payload(frame, cycle as u64));
            prop_assert!(ended.is_some(), "{:?}", world.hold.events);
            let (event, took) = ended.expect("it has ended");
            prop_assert!(!matches!(event, ExchangeEvent::Fault(_)), "{:?}", event);
            let air = (64 + 8 * (frame as u64 + 3)) * 2_360;
            prop_assert!(took <= air + u64::from(WINDOW_US + FRAME_US + 600) * 1_000, "{} ns", took);
        }
        let [_, port] = &mut world.chips;
        world.air.set_faults(world.now, AirFaults::default(), &mut |at, event| port.hear(at, event));
        world.back.set_faults(world.now, AnswerFaults::default(), &mut |_, _| {});
        world.answers_after_ns = 700_000;
        // All delayed frames and answers arrive in these 200 ms.
        let now = world.now;
        world.run_to(now + 200 * MS);
        works(&mut world, 7);
    }
}
