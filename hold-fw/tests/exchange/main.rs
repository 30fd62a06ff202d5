//! Tests the hold's link with the front end's model, against a listener that answers.

mod world;

use firmware_common::counter::Counter;
use hold_fw::{
    kept::{Keeper, Memory, WORDS},
    sensors::Readings,
    state::Hold,
    telemetry::Telemetry,
    timing::{timestamp, SLOT_US},
};
use profile::{
    criticality::{ActiveLoad, BaseStation, FlightController, Writer},
    hold::{Acknowledged, Answer, Outcome, Sender},
    HoldCommand, HoldStatus, HoldValues, ResetReason, Uplink, UplinkValues,
};
use st25r3916_model::{AirFaults, AnswerFaults, Config, ForeignCard, SentFrame, Variant};
use std::sync::atomic::AtomicU32;
use world::{World, PERIOD_NS};

fn status(tick: u32) -> HoldStatus {
    HoldStatus::seal(Writer::<ActiveLoad>::claim(), &HoldValues::absent(timestamp(tick)))
}

/// Returns the tick of a sent frame. Panics if the frame is incomplete, has another tick's timestamp, or was not sent
/// in the slot.
fn check(frame: &SentFrame, config: &Config) -> u32 {
    let tick = (frame.started_ns / PERIOD_NS) as u32;
    let object = HoldStatus::verify(&frame.bytes[1..65]).expect("an intact object");
    assert_eq!(object.timestamp(), timestamp(tick));
    let after_tick = frame.started_ns % PERIOD_NS;
    assert_eq!(after_tick, u64::from(SLOT_US) * 1_000 + 1_000 + config.transmit_latency_ns, "in cycle {tick}");
    assert!(frame.whole);
    tick
}

fn ticks(frames: &[SentFrame], config: &Config) -> Vec<u32> {
    frames.iter().map(|frame| check(frame, config)).collect()
}

#[test]
fn each_cycle_sends_one_frame_and_gets_one_answer() {
    for config in [Config::default(), Config::st25r3916()] {
        let telemetry = Telemetry::new();
        let mut world = World::new(&telemetry, config.clone(), AnswerFaults::default());
        let frames = world.run(30, status);
        assert_eq!(ticks(&frames, &config), (1..=30).collect::<Vec<_>>());
        let heard: Vec<u32> = world.heard.iter().map(HoldStatus::timestamp).collect();
        assert_eq!(heard, (1..=30).map(timestamp).collect::<Vec<_>>());
        assert_eq!(world.answers.len(), 30);
        let counts = [&telemetry.frames_sent, &telemetry.answers, &telemetry.silences, &telemetry.frames_skipped];
        assert_eq!(counts.map(Counter::get), [30, 30, 0, 0]);
        assert_eq!((telemetry.rf_faults.get(), world.link.take_fault()), (0, None));
        assert_eq!(world.link.port().chip.reports(), &[]);
    }
}

#[test]
fn without_an_answer_the_frames_go_on_as_before() {
    let (telemetry, config) = (Telemetry::new(), Config::default());
    let mut world = World::new(&telemetry, config.clone(), AnswerFaults::default());
    world.answer = None;
    assert_eq!(ticks(&world.run(20, status), &config), (1..=20).collect::<Vec<_>>());
    assert_eq!((telemetry.silences.get(), telemetry.answers.get(), world.answers.len()), (20, 0, 0));
}

#[test]
fn answers_of_another_length_are_counted_and_not_taken() {
    let (telemetry, config) = (Telemetry::new(), Config::default());
    let mut world = World::new(&telemetry, config, AnswerFaults::default());
    for (len, foreign) in [(127, 5), (129, 10), (64, 15), (254, 20)] {
        world.answer = Some(vec![0x5A; len]);
        world.run(5, status);
        assert_eq!((telemetry.answers_foreign.get(), world.answers.len()), (foreign, 0), "{len}");
    }
}

#[test]
fn a_bad_way_back_costs_no_frame() {
    let way = AirFaults { lost: 0.2, burst: 0.2, truncated: 0.2, ..AirFaults::default() };
    let foreign = ForeignCard { answers: 0.3, after_ns: (150_000, 3_500_000), payload: 64 };
    let (telemetry, config) = (Telemetry::new(), Config::default());
    let mut world = World::new(&telemetry, config.clone(), AnswerFaults { way, foreign });
    let sent = ticks(&world.run(300, status), &config);
    assert!(sent.len() >= 299, "{}", sent.len());
    assert!(world.answers.len() > 50, "{}", world.answers.len());
    let ended = [&telemetry.answers, &telemetry.silences, &telemetry.answers_dropped, &telemetry.rf_faults];
    assert_eq!(ended.map(Counter::get).iter().sum::<u32>(), 300);
}

// Shows HOLD-10.
#[test]
fn a_frame_that_is_offered_too_late_is_not_sent() {
    let (telemetry, config) = (Telemetry::new(), Config::default());
    let mut world = World::new(&telemetry, config.clone(), AnswerFaults::default());
    let mut sent = ticks(&world.run(3, status), &config);
    world.late_ns = u64::from(SLOT_US) * 1_000 + 1_000;
    sent.extend(ticks(&world.run(2, status), &config));
    world.late_ns = 50_000;
    sent.extend(ticks(&world.run(3, status), &config));
    assert_eq!(sent, [1, 2, 3, 6, 7, 8]);
    assert_eq!(telemetry.frames_skipped.get(), 2);
}

#[test]
fn a_frame_is_never_changed_while_it_is_loaded() {
    let (telemetry, config) = (Telemetry::new(), Config::default());
    let mut world = World::new(&telemetry, config.clone(), AnswerFaults::default());
    world.run(2, status);
    // The load of the first frame begins so late that it is not over when the second frame is offered.
    world.late_ns = PERIOD_NS - 10_000;
    world.run(1, status);
    world.late_ns = 0;
    assert_eq!(world.run(1, status).len(), 0);
    assert_eq!(telemetry.frames_skipped.get(), 2);
    world.late_ns = 50_000;
    assert_eq!(ticks(&world.run(3, status), &config), [5, 6, 7]);
    assert_eq!(telemetry.frames_skipped.get(), 2);
}

#[test]
fn a_chip_that_loses_its_supply_is_brought_up_again() {
    let (telemetry, config) = (Telemetry::new(), Config { variant: Variant::St25r3916b, ..Config::default() });
    let mut world = World::new(&telemetry, config.clone(), AnswerFaults::default());
    world.run(3, status);
    let now = u64::from(world.tick() + 1) * PERIOD_NS;
    world.link.port().chip.power_off(now);
    assert_eq!(world.run(5, status).len(), 0);
    let now = u64::from(world.tick() + 1) * PERIOD_NS;
    world.link.port().chip.power_on(now);
    let sent = ticks(&world.run(20, status), &config);
    assert_eq!(sent.last(), Some(&28));
    assert!(sent.len() > 8, "{sent:?}");
    assert!(telemetry.rf_recoveries.get() == 1 && telemetry.rf_faults.get() > 1);
    assert!(world.link.take_fault().is_some() && world.link.take_fault().is_none());
}

#[test]
fn a_frame_offered_shortly_before_a_bring_up_ends_is_sent() {
    for early_ns in (4_500_000..4_900_000).step_by(10_000) {
        let (telemetry, config) = (Telemetry::new(), Config::default());
        let mut world = World::new(&telemetry, config.clone(), AnswerFaults::default());
        world.run(3, status);
        world.restart_at = 5 * PERIOD_NS - early_ns;
        let sent = ticks(&world.run(3, status), &config);
        assert_eq!((sent, telemetry.frames_skipped.get()), (vec![4, 5, 6], 0), "{early_ns} ns before the tick");
    }
}

#[test]
fn whichever_transfer_hangs_the_frames_come_back_on_time() {
    let config = Config::default();
    for hang_in in 0..16 {
        let telemetry = Telemetry::new();
        let mut world = World::new(&telemetry, config.clone(), AnswerFaults::default());
        world.run(3, status);
        world.link.port().hang_in = Some(hang_in);
        let mut frames = world.run(12, status);
        // A frame whose load hangs is cut off on the air.
        frames.retain(|frame| frame.whole);
        let sent = ticks(&frames, &config);
        assert_eq!((world.link.port().aborted, telemetry.rf_faults.get()), (1, 1), "transfer {hang_in}");
        assert!(sent.len() >= 9 && sent.last() == Some(&15), "transfer {hang_in}: {sent:?}");
    }
}

fn memory() -> &'static Memory {
    Box::leak(Box::new([[(); WORDS]; 2].map(|record| record.map(|()| AtomicU32::new(0)))))
}

/// Base station and flight controller, with their uplinks in the form in which a DPR passes them on.
struct Writers {
    base_station: Sender<BaseStation>,
    flight_controller: Sender<FlightController>,
    now_ms: u32,
}

impl Writers {
    fn new() -> Self {
        Self { base_station: Sender::new(), flight_controller: Sender::new(), now_ms: 7 }
    }

    fn answer(&mut self) -> Vec<u8> {
        self.now_ms += 100;
        let mut answer = Answer::EMPTY;
        let mut values = UplinkValues { timestamp: self.now_ms, ..UplinkValues::default() };
        self.base_station.fill(&mut values.payload);
        let writer = Writer::<BaseStation>::claim();
        answer.set_uplink(writer, Uplink::seal(writer, &values));
        values.payload.fill(0);
        self.flight_controller.fill(&mut values.payload);
        let writer = Writer::<FlightController>::claim();
        answer.set_uplink(writer, Uplink::seal(writer, &values));
        answer.as_bytes().to_vec()
    }

    fn observe(&mut self, status: &HoldStatus) {
        self.base_station.observe(status.as_object());
        self.flight_controller.observe(status.as_object());
    }
}

#[test]
fn a_command_goes_the_whole_way_and_its_acknowledgement_comes_back() {
    let (telemetry, memory) = (Telemetry::new(), memory());
    let mut hold = Hold::new(ResetReason::PowerOn, Keeper::take(memory));
    let mut writers = Writers::new();
    let mut world = World::new(&telemetry, Config::default(), AnswerFaults::default());
    let cycle = |world: &mut World<'_>, writers: &mut Writers, hold: &mut Hold| {
        world.answer = Some(writers.answer());
        world.run(1, |tick| hold.cycle(tick, &mut Readings::default(), None).0);
        let tick = world.tick();
        world.answers.drain(..).for_each(|answer| hold.command(&answer, tick, &telemetry));
        let status = *world.heard.last().expect("it hears the frames");
        writers.observe(&status);
        status.values()
    };
    for _ in 0..3 {
        cycle(&mut world, &mut writers, &mut hold);
    }
    writers.base_station.send(&HoldCommand::SetPoint(8.5));
    writers.flight_controller.send(&HoldCommand::Unlock);
    cycle(&mut world, &mut writers, &mut hold);
    let values = cycle(&mut world, &mut writers, &mut hold);
    assert_eq!((values.set_point, values.status.locked()), (8.5, false));
    assert_eq!(values.acknowledged, [Acknowledged::new(1, Outcome::Done); 2]);
    writers.base_station.send(&HoldCommand::SetPoint(80.0));
    cycle(&mut world, &mut writers, &mut hold);
    let values = cycle(&mut world, &mut writers, &mut hold);
    assert_eq!((values.set_point, values.acknowledged[0]), (8.5, Acknowledged::new(2, Outcome::Refused)));
    assert_eq!((telemetry.commands_done.get(), telemetry.commands_refused.get()), (2, 1));
    // Lock, set-point and acknowledgements must outlive a reset that keeps the RAM.
    let mut restarted = Hold::new(ResetReason::Watchdog, Keeper::take(memory));
    let values = restarted.cycle(0, &mut Readings::default(), None).0.values();
    assert_eq!((values.set_point, values.status.locked()), (8.5, false));
    assert_eq!(values.acknowledged, [Acknowledged::new(2, Outcome::Refused), Acknowledged::new(1, Outcome::Done)]);
    assert_eq!(values.status.reset_reason(), Some(ResetReason::Watchdog));
}
