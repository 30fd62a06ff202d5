//! Holds the state of the hold, executes commands, and fills Hold-Status.

use profile::{
    criticality::{ActiveLoad, Function, Writer},
    hold::{Answer, Commands, Executed},
    HoldCommand, HoldStatus, HoldStatusBits, HoldValues, ResetReason, ABSENT_F32,
};

use crate::{
    climate::{Climate, WORKING},
    kept::{Keeper, Kept},
    sensors::Readings,
    supply::LIMITS as SUPPLY,
    telemetry::Telemetry,
    timing,
};

/// The upper limits of humidity, %, vibration along an axis, m/s², and shock, m/s². The limits of the temperature are
/// [`WORKING`], those of the supply [`SUPPLY`].
const MOST_HUMIDITY: f32 = 90.0;
const MOST_VIBRATION: f32 = 20.0;
const MOST_SHOCK: f32 = 60.0;

/// The states that heater, cooler and lock must take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outputs {
    /// The output of the control: 1 is the full power of the heater, -1 that of the cooler.
    pub output: f32,
    /// Whether the hold is locked.
    pub locked: bool,
}

/// The state of the hold: lock, set-point, acknowledged commands, temperature control, greatest shock, faults.
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
    /// Returns the state of the hold after a reset for `reason`. The second argument has the keeper of the records, and
    /// the record that outlived the reset.
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

    /// Records a fault of the memory. After that the output stays 0.
    pub fn found_memory_fault(&mut self) {
        self.memory_fault = true;
    }

    /// Executes the commands in `answer` that are due, in cycle `tick`. One write keeps the effect of a command
    /// together with its acknowledgement.
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

    /// Does one step of the temperature control in cycle `tick`. Returns Hold-Status and what heater, cooler and lock
    /// must do. Takes the greatest shock out of `readings`. The time is bounded (docs/timing.md#hold-64-mhz).
    pub fn cycle(&mut self, tick: u32, readings: &mut Readings, supply: Option<f32>) -> (HoldStatus, Outputs) {
        if let Some(shock) = readings.shock.take() {
            // Not covered: the result of `max` for a NaN, which no shock is.
            self.greatest_shock = Some(self.greatest_shock.unwrap_or(0.0).max(shock));
        }
        let Readings { climate, vibration, fault, .. } = *readings;
        let output = self.climate.step(climate.map(|[celsius, _]| celsius), !self.memory_fault);
        let [temperature, humidity] = climate.unwrap_or([ABSENT_F32; 2]);
        let vibration_or_nan = vibration.unwrap_or([ABSENT_F32; 3]);
        let (shock, volts) = (self.greatest_shock.unwrap_or(ABSENT_F32), supply.unwrap_or(ABSENT_F32));
        // A missing value is NaN. Every comparison with NaN is false, so a missing value counts as outside its limits.
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
