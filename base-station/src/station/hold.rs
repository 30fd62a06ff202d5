//! Formats the state of a drone's active hold for the page.

use profile::ResetReason;
use profile::hold::Outcome;
use serde::Serialize;

use super::{StationData, history};
use crate::carrier::mavlink::commander::{self, CommandRecord};
use crate::drone::hold::{HoldState, Presence};
use crate::drone::words;
use crate::{Drone, DroneId};

/// The number of commands on the page.
const SHOWN: usize = 5;

/// A sample of a hold: instant (ms since 1970), temperature and set-point (°C), output, vibration along x, y, z (m/s²).
#[derive(Serialize)]
pub(super) struct Sample(u64, Option<f32>, Option<f32>, Option<f32>, [Option<f32>; 3]);

#[derive(Serialize)]
pub(super) struct Hold {
    shown: &'static str,
    values: Option<Values>,
    notices: Vec<&'static str>,
    damaged: u64,
    restarts: u64,
    /// The last commands of this station, the newest first.
    commands: Vec<Command>,
}

#[derive(Serialize)]
struct Values {
    age_ms: u64,
    temperature: Option<f32>,
    humidity: Option<f32>,
    set_point: Option<f32>,
    vibration: [Option<f32>; 3],
    shock: Option<f32>,
    supply: Option<f32>,
    output: Option<f32>,
    valid: bool,
    within_limits: bool,
    locked: bool,
    sensor_fault: bool,
    memory_fault: bool,
    safe_state: bool,
    reset: &'static str,
    reset_unasked: bool,
    /// The last command that the hold acknowledged to the base station, and to the flight controller.
    acknowledged: [Acknowledged; 2],
    seconds: u32,
}

#[derive(Serialize)]
struct Acknowledged {
    number: u16,
    outcome: &'static str,
}

#[derive(Serialize)]
struct Command {
    number: u16,
    name: &'static str,
    value: Option<f32>,
    state: &'static str,
    /// The time from the command to its present state, ms. For a command whose outcome is not known, the time until
    /// now.
    after_ms: u64,
    ago_ms: u64,
}

impl Hold {
    pub(super) fn of(known: &StationData, id: DroneId, drone: &Drone, now_us: u64) -> Self {
        let hold = drone.hold();
        let name = id.to_string();
        let own = known.commands.iter().rev().filter(|told| told.drone == name);
        Self {
            shown: hold.map_or(Presence::Never, |hold| hold.presence(now_us)).code(),
            values: hold.and_then(|hold| values(hold, now_us)),
            notices: hold.into_iter().flat_map(HoldState::notices).collect(),
            damaged: hold.map_or(0, HoldState::damaged),
            restarts: hold.map_or(0, HoldState::restarts),
            commands: own.take(SHOWN).map(|told| command(told, now_us)).collect(),
        }
    }
}

fn values(hold: &HoldState, now_us: u64) -> Option<Values> {
    let held = hold.held()?;
    let v = &held.values;
    let status = v.status;
    Some(Values {
        age_ms: held.age_us(now_us) / 1_000,
        temperature: known(v.temperature),
        humidity: known(v.humidity),
        set_point: known(v.set_point),
        vibration: v.vibration.map(known),
        shock: known(v.greatest_shock),
        supply: known(v.supply),
        output: known(v.output),
        valid: status.values_valid(),
        within_limits: status.within_limits(),
        locked: status.locked(),
        sensor_fault: status.sensor_fault(),
        memory_fault: status.memory_fault(),
        safe_state: status.safe_state(),
        reset: words::reset(status.reset_reason()),
        reset_unasked: status.reset_reason().is_some_and(ResetReason::is_unasked),
        acknowledged: v.acknowledged.map(|last| {
            let outcome = match last.outcome() {
                Some(Outcome::Nothing) => "none yet",
                Some(Outcome::Done) => "done",
                Some(Outcome::Refused) => "refused",
                Some(Outcome::Unknown) => "unknown",
                Some(Outcome::TooOld) => "too old",
                None => "an outcome that this station does not know",
            };
            Acknowledged { number: last.number(), outcome }
        }),
        seconds: v.seconds,
    })
}

fn command(told: &CommandRecord, now_us: u64) -> Command {
    let (name, value) = commander::name(&told.command);
    let until_us = if told.state == commander::CommandState::Pending { now_us } else { told.at_us };
    Command {
        number: told.number,
        name,
        value,
        state: told.state.code(),
        after_ms: until_us.saturating_sub(told.since_us) / 1_000,
        ago_ms: now_us.saturating_sub(told.since_us) / 1_000,
    }
}

/// Returns the samples of a drone's hold.
pub(super) fn history(known_data: &StationData, id: DroneId) -> Vec<Sample> {
    let sample = |sample: &history::HoldSample| {
        let history::HoldSample { at_us, temperature, set_point, output, vibration } = *sample;
        Sample(at_us / 1_000, known(temperature), known(set_point), known(output), vibration.map(known))
    };
    known_data.history.of_hold(id).map(sample).collect()
}

fn known(value: f32) -> Option<f32> {
    Some(value).filter(|value| value.is_finite())
}
