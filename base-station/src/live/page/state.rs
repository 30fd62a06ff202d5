//! What the station knows, as the page reads it. Ages are those of the instant at which a state is made.

use profile::{FixType, ResetReason};
use serde::Serialize;

use super::super::playback::Player;
use super::super::{Known, Station, history};
use crate::drone::words;
use crate::{Alarm, Drone, DroneId, Severity};

#[derive(Serialize)]
struct State {
    /// µs since 1970.
    now_us: u64,
    playback: Option<Playback>,
    station: About,
    /// Of all drones, each half second.
    drones: Option<Vec<Line>>,
    drone: Option<Detail>,
    /// Of the drone, with the first state of a connection.
    #[serde(skip_serializing_if = "Option::is_none")]
    history: Option<Vec<Sample>>,
}

/// A drone at an instant: when (ms since 1970), the reported place, those of the receivers (degrees), the height (m),
/// the worst age (s) and the fewest receivers that agreed in the time before.
#[derive(Serialize)]
struct Sample(u64, Option<[f64; 2]>, Vec<Option<[f64; 2]>>, Option<f32>, Option<f32>, Option<u8>);

#[derive(Serialize)]
struct Playback {
    speed: f64,
    at_s: f64,
    length_s: f64,
    /// As the answer to whoever changes speed or place has it.
    changes: u64,
}

/// What is wrong with the station itself.
#[derive(Serialize)]
struct About {
    lines: Vec<(String, String)>,
    recorder: Option<String>,
    dropped: u64,
    refused: u64,
}

/// A drone in the list.
#[derive(Serialize)]
struct Line {
    id: String,
    age_ms: Option<u64>,
    critical: bool,
    alarms: usize,
}

#[derive(Serialize)]
struct Raised {
    code: &'static str,
    words: &'static str,
    critical: bool,
    since_ms: u64,
}

#[derive(Serialize)]
struct Detail {
    id: String,
    stale: bool,
    silent_ms: u64,
    /// ms since HORUS's start.
    time_ms: Option<u32>,
    receivers: usize,
    reported: Option<Reported>,
    gps: Vec<Option<Gps>>,
    link: Option<Link>,
    alarms: Vec<Raised>,
    counts: Counts,
}

#[derive(Serialize)]
struct Reported {
    age_ms: u64,
    state: &'static str,
    valid: bool,
    agree: u8,
    degraded: bool,
    /// Degrees, degrees, m.
    position: [f64; 3],
    /// Pitch, yaw, roll, degrees.
    attitude: Option<[f32; 3]>,
    acceleration: Option<[f32; 3]>,
}

#[derive(Serialize)]
struct Gps {
    age_ms: u64,
    fix: &'static str,
    valid: bool,
    heard: bool,
    stale: bool,
    excluded: bool,
    position: [f64; 3],
}

#[derive(Serialize)]
struct Link {
    age_ms: u64,
    up: bool,
    accepted: u32,
    rejected: u32,
    received: u32,
    missed: u32,
    violations: u16,
    /// Of Reported-Position when the image was made.
    sample_age_ms: f64,
    reset: &'static str,
}

#[derive(Serialize)]
struct Counts {
    messages: u64,
    shown: u64,
    duplicate: u64,
    older: u64,
    out_of_sequence: u64,
    vacant: u64,
    bad_crc: u64,
    misplaced: u64,
    missed: u64,
    restarts: u64,
}

/// What goes with a state beside the details of one drone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct With {
    /// All drones.
    pub(super) list: bool,
    /// The drone's last minutes.
    pub(super) history: bool,
}

/// The state, with the details of `drone`, or of the first one if none is asked for.
pub(super) fn json(station: &Station, player: Option<&Player>, drone: Option<&str>, with: With) -> String {
    let known = station.known();
    let state = state(&known, station.dropped(), player, drone, with);
    drop(known);
    serde_json::to_string(&state).unwrap_or_default()
}

fn state(known: &Known, dropped: u64, player: Option<&Player>, drone: Option<&str>, with: With) -> State {
    let now_us = player.map_or(known.now_us, |player| player.now_us().max(known.now_us));
    let fleet = known.intake.fleet();
    let line = |(id, drone): (DroneId, &Drone)| {
        let alarms = drone.alarms_at(now_us);
        Line {
            id: id.to_string(),
            age_ms: drone.reported().map(|held| held.age_us(now_us) / 1_000),
            critical: alarms.iter().any(|alarm| alarm.severity() == Severity::Critical),
            alarms: alarms.iter().count(),
        }
    };
    let shown = fleet.iter().find(|(id, _)| drone.is_none_or(|drone| id.to_string() == drone));
    State {
        now_us,
        playback: player.map(|player| {
            let (first_us, last_us) = player.span_us();
            let seconds = |us: u64| us.saturating_sub(first_us) as f64 / 1e6;
            // First, so that what it counts is in the others.
            let changes = player.changes();
            // The player's place: the station is at the one before for as long as it takes to go back.
            let at_s = seconds(player.now_us());
            Playback { speed: player.speed(), at_s, length_s: seconds(last_us), changes }
        }),
        station: About {
            lines: known.lines.clone(),
            recorder: known.recorder.as_ref().map(|trouble| trouble.why.clone()),
            dropped,
            refused: fleet.refused(),
        },
        drones: with.list.then(|| fleet.iter().map(line).collect()),
        drone: shown.map(|(id, drone)| detail(id, drone, now_us)),
        history: shown.filter(|_| with.history).map(|(id, drone)| {
            let sample = |sample: &history::Sample| {
                let gps = sample.gps(drone.receivers()).collect();
                Sample(sample.at_us / 1_000, sample.voted(), gps, sample.height(), sample.age(), sample.agree())
            };
            known.history.of(id).map(sample).collect()
        }),
    }
}

fn detail(id: DroneId, drone: &Drone, now_us: u64) -> Detail {
    let alarms = drone.alarms_at(now_us);
    let since = |alarm| drone.raised().find(|raised| raised.alarm == alarm).map_or(now_us, |raised| raised.since_us);
    let counts = drone.counts();
    Detail {
        id: id.to_string(),
        stale: alarms.has(Alarm::Stale),
        silent_ms: now_us.saturating_sub(drone.heard_us()) / 1_000,
        time_ms: drone.timestamp(),
        receivers: drone.receivers(),
        reported: drone.reported().map(|held| {
            let v = &held.values;
            let attitude = [v.pitch, v.yaw, v.roll].map(f32::to_degrees);
            Reported {
                age_ms: held.age_us(now_us) / 1_000,
                state: words::state(v.status.state()),
                valid: v.status.position_valid(),
                agree: v.status.receivers_agreeing(),
                degraded: v.status.degraded(),
                position: [v.latitude, v.longitude, v.altitude],
                attitude: v.status.attitude_valid().then_some(attitude),
                acceleration: v.status.acceleration_valid().then_some(v.acceleration),
            }
        }),
        gps: (1..=drone.receivers()).map(|receiver| gps(drone, receiver, now_us)).collect(),
        link: drone.link().map(|held| {
            let v = &held.values;
            Link {
                age_ms: held.age_us(now_us) / 1_000,
                up: v.status.link_up(),
                accepted: v.objects_accepted,
                rejected: v.objects_rejected,
                received: v.frames_received,
                missed: v.frames_missed,
                violations: v.access_violations,
                sample_age_ms: f64::from(v.age_100us) / 10.0,
                reset: reset(v.status.reset_reason()),
            }
        }),
        alarms: alarms
            .iter()
            .map(|alarm| Raised {
                code: alarm.code(),
                words: alarm.words(),
                critical: alarm.severity() == Severity::Critical,
                since_ms: now_us.saturating_sub(since(alarm)) / 1_000,
            })
            .collect(),
        counts: Counts {
            messages: counts.messages,
            shown: counts.new,
            duplicate: counts.duplicate,
            older: counts.older,
            out_of_sequence: counts.out_of_sequence,
            vacant: counts.vacant,
            bad_crc: counts.bad_crc,
            misplaced: counts.misplaced,
            missed: counts.missed,
            restarts: counts.restarts,
        },
    }
}

fn gps(drone: &Drone, receiver: usize, now_us: u64) -> Option<Gps> {
    let held = drone.gps(receiver)?;
    let v = &held.values;
    Some(Gps {
        age_ms: held.age_us(now_us) / 1_000,
        fix: match v.status.fix_type() {
            Some(FixType::NoFix) => "no fix",
            Some(FixType::DeadReckoning) => "dead reckoning",
            Some(FixType::Fix2D) => "2D",
            Some(FixType::Fix3D) => "3D",
            Some(FixType::GnssDeadReckoning) => "3D and dead reckoning",
            Some(FixType::TimeOnly) => "time only",
            None => "unknown",
        },
        valid: v.status.position_valid(),
        heard: v.status.heard(),
        stale: v.status.stale(),
        excluded: v.status.excluded(),
        position: [v.latitude, v.longitude, v.altitude],
    })
}

const fn reset(reason: Option<ResetReason>) -> &'static str {
    match reason {
        Some(ResetReason::PowerOn) => "power on",
        Some(ResetReason::Pin) => "pin",
        Some(ResetReason::Watchdog) => "watchdog",
        Some(ResetReason::Lockup) => "lockup",
        Some(ResetReason::Software) => "software",
        Some(ResetReason::BrownOutOrOther) => "brown-out or other",
        None => "unknown",
    }
}
