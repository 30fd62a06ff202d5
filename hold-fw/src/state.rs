//! The state of the hold: what it was commanded, what it controls, and what Hold-Status says of it.

use profile::{
    criticality::{ActiveLoad, Function, Writer},
    hold::{Answer, Commands, Executed},
    HoldCommand, HoldStatus, HoldStatusBits, HoldValues, ResetReason, ABSENT_F32,
};

use crate::{
    climate::{Climate, WORKING},
    kept::{Keeper, Kept},
    sensors::Readings,
    telemetry::Telemetry,
    timing,
};

/// The greatest humidity, %, vibration along an axis and shock, m/s², that are within the hold's limits; the
/// temperatures are those of [`WORKING`].
const MOST_HUMIDITY: f32 = 90.0;
const MOST_VIBRATION: f32 = 20.0;
const MOST_SHOCK: f32 = 60.0;
/// The supply, V, that is within the hold's limits: above the threshold at which it stops, and up to what the part
/// bears (PS v1.7, 5.3.1).
const SUPPLY: core::ops::RangeInclusive<f32> = 2.9..=3.6;

/// What the outputs have to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outputs {
    /// The output of the control: 1 is all of the heater, -1 all of the cooler.
    pub output: f32,
    /// Whether the hold is locked.
    pub locked: bool,
}

/// The state of the hold.
#[derive(Debug)]
pub struct Hold {
    kept: Kept,
    keeper: Keeper,
    commands: Commands,
    climate: Climate,
    greatest_shock: Option<f32>,
    reason: ResetReason,
    memory_fault: bool,
}

impl Hold {
    /// Returns the state at a start for `reason`. `kept` was kept over the reset, if anything was.
    #[must_use]
    pub fn new(reason: ResetReason, (keeper, kept): (Keeper, Option<Kept>)) -> Self {
        let kept = kept.unwrap_or_default();
        Self {
            kept,
            keeper,
            commands: Commands::resume(kept.acknowledged),
            climate: Climate::new(kept.set_point),
            greatest_shock: None,
            reason,
            memory_fault: false,
        }
    }

    /// Records that the hold has found a fault of its memory. From then on the output is off.
    pub fn found_memory_fault(&mut self) {
        self.memory_fault = true;
    }

    /// Executes the commands in `answer` that are due, at cycle `tick`. All of a command's effect is kept at once with
    /// its acknowledgement.
    pub fn command(&mut self, answer: &Answer, tick: u32, telemetry: &Telemetry) {
        let Self { kept, climate, commands, greatest_shock, .. } = self;
        let now_ms = u64::from(tick) * u64::from(profile::hold::PERIOD_MS);
        commands.take(answer, now_ms, |_: Function, command| {
            let done = match command {
                HoldCommand::SetPoint(celsius) => climate.set(celsius),
                HoldCommand::Lock => {
                    kept.locked = true;
                    true
                }
                HoldCommand::Unlock => {
                    kept.locked = false;
                    true
                }
                HoldCommand::ClearShock => {
                    *greatest_shock = greatest_shock.and(Some(0.0));
                    true
                }
            };
            if done {
                telemetry.commands_done.add(1);
                Executed::Done
            } else {
                telemetry.commands_refused.add(1);
                Executed::Refused
            }
        });
        let acknowledged = self.commands.acknowledged();
        if acknowledged != self.kept.acknowledged {
            self.kept = Kept { set_point: self.climate.set_point(), acknowledged, ..self.kept };
            self.keeper.keep(&self.kept);
        }
    }

    /// Does the control's step of cycle `tick` and returns Hold-Status and what the outputs have to do. Takes the
    /// greatest shock out of `readings`. The work is the same whatever the values are.
    pub fn cycle(&mut self, tick: u32, readings: &mut Readings, supply: Option<f32>) -> (HoldStatus, Outputs) {
        if let Some(shock) = readings.shock.take() {
            self.greatest_shock = Some(self.greatest_shock.unwrap_or(0.0).max(shock));
        }
        let Readings { climate, vibration, fault, .. } = *readings;
        let output = self.climate.step(climate.map(|[celsius, _]| celsius), !self.memory_fault);
        let [temperature, humidity] = climate.unwrap_or([ABSENT_F32; 2]);
        let vibration_or_nan = vibration.unwrap_or([ABSENT_F32; 3]);
        let (shock, volts) = (self.greatest_shock.unwrap_or(ABSENT_F32), supply.unwrap_or(ABSENT_F32));
        // A value that is not known is not within a limit, since no comparison with NaN is true.
        let within = WORKING.contains(&temperature)
            & (humidity <= MOST_HUMIDITY)
            & vibration_or_nan.iter().all(|axis| *axis <= MOST_VIBRATION)
            & (shock <= MOST_SHOCK)
            & SUPPLY.contains(&volts);
        let values = HoldValues {
            status: HoldStatusBits::new()
                .with_values_valid(climate.is_some() & vibration.is_some() & supply.is_some())
                .with_within_limits(within)
                .with_locked(self.kept.locked)
                .with_sensor_fault(fault)
                .with_memory_fault(self.memory_fault)
                .with_safe_state(self.climate.is_safe())
                .with_reset_reason(self.reason),
            temperature,
            humidity,
            set_point: self.climate.set_point(),
            vibration: vibration_or_nan,
            greatest_shock: shock,
            supply: volts,
            output,
            acknowledged: self.kept.acknowledged,
            seconds: tick / timing::CYCLES_PER_SECOND,
            ..HoldValues::absent(timing::timestamp(tick))
        };
        let outputs = Outputs { output, locked: self.kept.locked };
        (HoldStatus::seal(Writer::<ActiveLoad>::claim(), &values), outputs)
    }
}
