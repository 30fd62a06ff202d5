//! Tests Hold-Status and the effects of commands.

use std::sync::atomic::AtomicU32;

use hold_fw::{
    kept::{Keeper, Memory, WORDS},
    sensors::Readings,
    state::Hold,
    supply,
    telemetry::Telemetry,
};
use profile::{
    criticality::{BaseStation, Writer},
    hold::{Acknowledged, Answer, Outcome, Sender},
    HoldCommand, HoldStatus, HoldValues, ResetReason, Uplink, UplinkValues,
};
use proptest::prelude::*;

fn memory() -> &'static Memory {
    Box::leak(Box::new([[(); WORDS]; 2].map(|record| record.map(|()| AtomicU32::new(0)))))
}

fn hold() -> Hold {
    Hold::new(ResetReason::PowerOn, Keeper::take(memory()))
}

const READINGS: Readings =
    Readings { climate: Some([20.0, 40.0]), vibration: Some([1.0, 2.0, 3.0]), shock: Some(9.0), fault: false };

fn values(hold: &mut Hold, readings: Readings) -> HoldValues {
    hold.cycle(7, &mut readings.clone(), Some(3.0)).0.values()
}

#[test]
fn a_working_hold_says_what_it_measures_and_does() {
    let mut hold = hold();
    let mut readings = READINGS;
    let (status, outputs) = hold.cycle(123, &mut readings, Some(3.0));
    assert_eq!(readings.shock, None, "the shock is taken");
    let values = HoldStatus::verify(status.as_bytes()).expect("it is intact").values();
    assert_eq!((values.timestamp, values.seconds), (12_300, 12));
    assert_eq!((values.temperature, values.humidity, values.set_point), (20.0, 40.0, 20.0));
    assert_eq!((values.vibration, values.greatest_shock, values.supply), ([1.0, 2.0, 3.0], 9.0, 3.0));
    assert_eq!((values.output, outputs.output, outputs.locked), (0.0, 0.0, true));
    let bits = values.status;
    assert!(bits.values_valid() && bits.within_limits() && bits.locked());
    assert!(!bits.sensor_fault() && !bits.memory_fault() && !bits.safe_state());
    assert_eq!(bits.reset_reason(), Some(ResetReason::PowerOn));
    assert_eq!(values.acknowledged, [Acknowledged::default(); 2]);
}

#[test]
fn a_value_that_is_not_known_is_absent_and_outside_the_limits() {
    let supplies = [None, Some(3.0)];
    for (readings, supply) in [
        (Readings { climate: None, ..READINGS }, supplies[1]),
        (Readings { vibration: None, ..READINGS }, supplies[1]),
        (READINGS, supplies[0]),
    ] {
        let values = hold().cycle(0, &mut readings.clone(), supply).0.values();
        assert!(!values.status.values_valid() && !values.status.within_limits());
        assert_eq!(values.temperature.is_nan() && values.humidity.is_nan(), readings.climate.is_none());
        assert_eq!(values.vibration.iter().all(|axis| axis.is_nan()), readings.vibration.is_none());
        assert_eq!(values.supply.is_nan(), supply.is_none());
        assert_eq!(values.status.safe_state(), readings.climate.is_none());
    }
    let values = values(&mut hold(), Readings { shock: None, ..READINGS });
    assert!(values.greatest_shock.is_nan() && values.status.values_valid() && !values.status.within_limits());
}

#[test]
fn each_value_has_its_limits() {
    let all = |readings: Readings, supply| hold().cycle(0, &mut readings.clone(), Some(supply)).0.status();
    let cases = [
        (Readings { climate: Some([-0.1, 40.0]), ..READINGS }, 3.0),
        (Readings { climate: Some([45.1, 40.0]), ..READINGS }, 3.0),
        (Readings { climate: Some([20.0, 90.1]), ..READINGS }, 3.0),
        (Readings { vibration: Some([0.0, 0.0, 20.1]), ..READINGS }, 3.0),
        (Readings { shock: Some(60.1), ..READINGS }, 3.0),
        (READINGS, 2.89),
        (READINGS, 3.6),
    ];
    for (readings, supply) in cases {
        let bits = all(readings, supply);
        assert!(bits.values_valid() && !bits.within_limits(), "{readings:?} {supply}");
    }
    let bounds = Readings { climate: Some([45.0, 90.0]), vibration: Some([20.0; 3]), shock: Some(60.0), fault: true };
    assert!(all(bounds, 3.599).within_limits() && all(bounds, 2.9).sensor_fault());
}

#[test]
fn a_supply_at_the_end_of_its_scale_is_outside_the_limits() {
    let within = |count| {
        let volts = supply::volts(count).expect("it is a voltage");
        hold().cycle(0, &mut READINGS.clone(), Some(volts)).0.status().within_limits()
    };
    assert!(within(3_300) && within(4_094));
    // The SAADC does not count beyond 4095, however high the supply is.
    assert!(!within(4_095) && !within(3_299));
    assert_eq!(supply::volts(4_095), Some(3.6));
    assert_eq!([2_844, 0, -1].map(supply::volts), [None; 3]);
}

#[test]
fn a_memory_fault_switches_the_output_off_for_good() {
    let mut hold = hold();
    let cold = Readings { climate: Some([5.0, 40.0]), ..READINGS };
    for _ in 0..5 {
        values(&mut hold, cold);
    }
    assert!(values(&mut hold, cold).output > 0.2);
    hold.found_memory_fault();
    for _ in 0..20 {
        let values = values(&mut hold, cold);
        assert_eq!(values.output, 0.0);
        assert!(values.status.memory_fault() && values.status.safe_state() && values.status.locked());
    }
}

/// A hold, and a base station whose uplinks reach it in each cycle.
struct Link {
    hold: Hold,
    memory: &'static Memory,
    sender: Sender<BaseStation>,
    telemetry: Telemetry,
    tick: u32,
}

impl Link {
    fn new() -> Self {
        let memory = memory();
        let hold = Hold::new(ResetReason::PowerOn, Keeper::take(memory));
        let mut link = Self { hold, memory, sender: Sender::new(), telemetry: Telemetry::new(), tick: 0 };
        link.cycle();
        link.cycle();
        link
    }

    fn cycle(&mut self) -> HoldValues {
        self.tick += 1;
        let (status, outputs) = self.hold.cycle(self.tick, &mut READINGS.clone(), Some(3.0));
        self.sender.observe(status.as_object());
        let mut uplink = UplinkValues { timestamp: 80 * self.tick, ..UplinkValues::default() };
        self.sender.fill(&mut uplink.payload);
        let (mut answer, writer) = (Answer::EMPTY, Writer::<BaseStation>::claim());
        answer.set_uplink(writer, Uplink::seal(writer, &uplink));
        self.hold.command(&answer, self.tick, &self.telemetry);
        assert_eq!(outputs.locked, status.values().status.locked());
        status.values()
    }

    fn send(&mut self, command: HoldCommand) -> HoldValues {
        let before = self.cycle().acknowledged[0].number();
        self.sender.send(&command);
        for _ in 0..3 {
            let values = self.cycle();
            if values.acknowledged[0].number() != before {
                return values;
            }
        }
        panic!("{command:?} is not acknowledged")
    }
}

#[test]
fn each_command_is_done_within_its_limits_or_refused() {
    let mut link = Link::new();
    let done = |values: &HoldValues| values.acknowledged[0].outcome() == Some(Outcome::Done);
    let refused = |values: &HoldValues| values.acknowledged[0].outcome() == Some(Outcome::Refused);
    for celsius in [2.0, 40.0, 21.5] {
        let values = link.send(HoldCommand::SetPoint(celsius));
        assert!(done(&values) && values.set_point == celsius);
    }
    for celsius in [1.9, 40.1, f32::NAN, f32::INFINITY, -5.0] {
        let values = link.send(HoldCommand::SetPoint(celsius));
        assert!(refused(&values) && values.set_point == 21.5, "{celsius}");
    }
    let values = link.send(HoldCommand::Unlock);
    assert!(done(&values) && !values.status.locked());
    let values = link.send(HoldCommand::Lock);
    assert!(done(&values) && values.status.locked());
    assert_eq!((link.telemetry.commands_done.get(), link.telemetry.commands_refused.get()), (5, 5));
}

#[test]
fn a_command_is_too_old_after_a_second_of_the_same_uplink() {
    let (mut hold, telemetry, writer) = (hold(), Telemetry::new(), Writer::<BaseStation>::claim());
    let mut sender = Sender::<BaseStation>::new();
    sender.observe(hold.cycle(0, &mut READINGS.clone(), Some(3.0)).0.as_object());
    sender.send(&HoldCommand::Unlock);
    let (mut uplink, mut answer) = (UplinkValues::default(), Answer::EMPTY);
    sender.fill(&mut uplink.payload);
    answer.set_uplink(writer, Uplink::seal(writer, &uplink));
    for tick in 1..=12 {
        hold.command(&answer, tick, &telemetry);
        let values = hold.cycle(tick, &mut READINGS.clone(), Some(3.0)).0.values();
        let expected = if tick < 12 { Outcome::Nothing } else { Outcome::TooOld };
        assert_eq!(values.acknowledged[0].outcome(), Some(expected), "in cycle {tick}");
        assert!(values.status.locked());
    }
}

#[test]
fn a_cleared_shock_is_zero_until_the_next_one() {
    let mut link = Link::new();
    assert_eq!(link.cycle().greatest_shock, 9.0);
    link.sender.send(&HoldCommand::ClearShock);
    link.cycle();
    let calm = Readings { shock: None, ..READINGS };
    assert_eq!(link.hold.cycle(9, &mut calm.clone(), None).0.values().greatest_shock, 0.0);
    let small = Readings { shock: Some(2.0), ..READINGS };
    assert_eq!(link.hold.cycle(9, &mut small.clone(), None).0.values().greatest_shock, 2.0);
}

#[test]
fn a_hold_that_restarts_after_any_command_goes_on_from_there() {
    let mut link = Link::new();
    for command in [HoldCommand::Unlock, HoldCommand::SetPoint(7.0), HoldCommand::SetPoint(99.0), HoldCommand::Lock] {
        let before = link.send(command);
        link.hold = Hold::new(ResetReason::Watchdog, Keeper::take(link.memory));
        let after = link.hold.cycle(0, &mut READINGS.clone(), Some(3.0)).0.values();
        assert_eq!(
            (after.set_point, after.status.locked(), after.acknowledged),
            (before.set_point, before.status.locked(), before.acknowledged),
            "{command:?}"
        );
    }
}

fn any_value() -> impl Strategy<Value = Option<f32>> {
    prop_oneof![Just(None), (-100.0_f32..200.0).prop_map(Some), prop::num::f32::ANY.prop_map(Some)]
}

proptest! {
    #[test]
    fn whatever_the_sensors_say_the_object_is_intact_and_consistent(
        steps in prop::collection::vec((any_value(), any_value(), any_value(), any_value(), any::<bool>()), 1..50)
    ) {
        let mut hold = hold();
        for (tick, (celsius, axis, shock, supply, fault)) in (0_u32..).zip(steps) {
            let vibration = axis.map(|axis| [axis; 3]);
            let readings = Readings { climate: celsius.map(|celsius| [celsius, 50.0]), vibration, shock, fault };
            let (status, outputs) = hold.cycle(tick, &mut readings.clone(), supply);
            let values = HoldStatus::verify(status.as_bytes()).expect("it is intact").values();
            let bits = values.status;
            prop_assert_eq!(values.timestamp, 100 * tick);
            prop_assert!(values.output == outputs.output && (-1.0..=0.8).contains(&values.output));
            prop_assert!(!bits.safe_state() || values.output == 0.0);
            prop_assert!(!bits.within_limits() || bits.values_valid() && values.greatest_shock >= 0.0);
            prop_assert_eq!(bits.sensor_fault(), fault);
        }
    }
}
