//! Formats the station's state for the page. Ages are stated for the instant `now_us`.

use profile::ResetReason;
use serde::Serialize;

use super::hold::{self, Hold};
use super::{StationData, history};
use crate::alarm::Alarms;
use crate::carrier::mavlink::Voice;
use crate::carrier::mavlink::voice::{Sending, State as Outcome};
use crate::drone::words;
use crate::{Alarm, Drone, DroneId, Fleet, Severity};

/// An alarm that began or ended: instant (ms since 1970), drone, alarm, whether it is critical, whether it began.
#[derive(Serialize)]
struct Change(u64, String, &'static str, bool, bool);

/// A sample of a drone: instant (ms since 1970), position that was reported and positions of the receivers (degrees),
/// height (m) and, since the last sample, the greatest age (s) and the least number of agreeing receivers.
#[derive(Serialize)]
struct Sample(u64, Option<[f64; 2]>, Vec<Option<[f64; 2]>>, Option<f32>, Option<f32>, Option<u8>);

/// The pace and the instant of a playback.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Playback {
    /// The pace as a multiple of real time.
    pub speed: f64,
    /// The playback's instant, s from the recording's start. During a jump back the shown data are still from an
    /// earlier instant.
    pub at_s: f64,
    /// The length of the recording, s.
    pub length_s: f64,
    /// The number of changes of pace or instant so far. A state with this number includes the changes up to it, also
    /// those that the page requested.
    pub changes: u64,
    /// The instant, µs since 1970.
    #[serde(skip)]
    pub now_us: u64,
}

#[derive(Serialize)]
struct About {
    lines: Vec<(String, String)>,
    recording: Option<String>,
    recorder: Option<String>,
    dropped: u64,
    refused: u64,
    forgotten: u64,
    stale_rank: usize,
    signed: bool,
    unread: Vec<(&'static str, u64)>,
    uplinks: bool,
    commands: bool,
}

#[derive(Serialize)]
struct Line {
    id: String,
    age_ms: Option<u64>,
    state: Option<&'static str>,
    worst: Option<Worst>,
    alarms: usize,
    place: Option<[f64; 2]>,
}

#[derive(Serialize)]
struct Worst {
    words: &'static str,
    critical: bool,
    rank: usize,
}

impl Worst {
    fn of(alarms: Alarms) -> Option<Self> {
        let alarm = alarms.iter().next()?;
        Some(Self { words: alarm.words(), critical: alarm.severity() == Severity::Critical, rank: alarm as usize })
    }
}

#[derive(Serialize)]
struct Raised {
    code: &'static str,
    words: &'static str,
    critical: bool,
    rank: usize,
    since_ms: u64,
}

#[derive(Serialize)]
struct Detail {
    id: String,
    from: String,
    signed: bool,
    stale: bool,
    silent_ms: u64,
    time_ms: Option<u32>,
    receivers: usize,
    reported: Option<Reported>,
    gps: Vec<Option<Gps>>,
    link: Option<Link>,
    port: Option<Port>,
    uplink: Option<Uplink>,
    hold: Hold,
    alarms: Vec<Raised>,
    counts: Counts,
}

#[derive(Serialize)]
struct Port {
    age_ms: u64,
    stored: u32,
    violations: u32,
    last_refused: bool,
}

#[derive(Serialize)]
struct Uplink {
    /// The uplink's timestamp, ms on this station's clock. It identifies the uplink.
    timestamp: u32,
    status: u16,
    payload: String,
    state: &'static str,
    why: Option<String>,
    times: u32,
    after_ms: u64,
    ago_ms: u64,
}

impl Uplink {
    fn of(sending: &Sending, now_us: u64) -> Self {
        let values = sending.uplink.values();
        let until_us = if sending.state == Outcome::Sent { now_us } else { sending.at_us };
        Self {
            timestamp: values.timestamp,
            status: values.status.bits(),
            payload: values.payload.iter().map(|byte| format!("{byte:02x}")).collect(),
            state: sending.state.code(),
            why: sending.state.why().map(str::to_owned),
            times: sending.times,
            after_ms: until_us.saturating_sub(sending.since_us) / 1_000,
            ago_ms: now_us.saturating_sub(sending.since_us) / 1_000,
        }
    }
}

#[derive(Serialize)]
struct Reported {
    age_ms: u64,
    state: &'static str,
    valid: bool,
    agree: u8,
    degraded: bool,
    memory_fault: bool,
    reset: &'static str,
    reset_usual: bool,
    /// Latitude (degrees), longitude (degrees) and height (m).
    position: [f64; 3],
    /// Pitch, yaw and roll, degrees.
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
    solution: String,
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
    /// The age of Reported-Position's sample when the DPR made the image, ms.
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

/// The parts of a state that are requested besides the details of one drone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct With {
    /// Whether the state has the list of all drones and of the alarms that began or ended.
    pub list: bool,
    /// Whether the state has the last minutes of the drone.
    pub history: bool,
}

/// The state as the page gets it.
#[derive(Serialize)]
pub struct State {
    now_us: u64,
    asked: String,
    playback: Option<Playback>,
    station: About,
    drones: Option<Vec<Line>>,
    log: Option<Vec<Change>>,
    drone: Option<Detail>,
    #[serde(skip_serializing_if = "Option::is_none")]
    history: Option<Vec<Sample>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    hold_history: Option<Vec<hold::Sample>>,
}

/// Returns the state as the answer to the query `asked`. It has the details of `drone`, or of the first drone if
/// `drone` is `None`. The number of arrivals that were dropped is `dropped`.
#[must_use]
pub fn state(
    known: &StationData,
    dropped: u64,
    playback: Option<Playback>,
    drone: Option<&str>,
    asked: &str,
    with: With,
) -> State {
    let now_us = playback.map_or(known.now_us, |playback| playback.now_us.max(known.now_us));
    let fleet = known.intake.fleet();
    let line = |(id, drone): (DroneId, &Drone)| {
        let alarms = drone.alarms_at(now_us);
        let reported = drone.reported();
        let valid = reported.filter(|held| held.values.status.position_valid() && !alarms.has(Alarm::Stale));
        Line {
            id: id.to_string(),
            age_ms: reported.map(|held| held.age_us(now_us) / 1_000),
            state: reported.map(|held| words::state(held.values.status.state())),
            worst: Worst::of(alarms),
            alarms: alarms.iter().count(),
            place: valid.map(|held| [held.values.latitude, held.values.longitude]),
        }
    };
    let shown = drone.map_or_else(|| fleet.iter().next(), |drone| named(fleet, drone));
    let refused = known.intake.refused();
    let change = |(id, change): &(DroneId, crate::Change)| {
        let (words, critical) = (change.alarm.words(), change.alarm.severity() == Severity::Critical);
        Change(change.at_us / 1_000, id.to_string(), words, critical, change.raised)
    };
    State {
        now_us,
        asked: asked.to_owned(),
        playback,
        station: About {
            lines: known.lines.clone(),
            recording: known
                .recording
                .as_ref()
                .map(|made| made.names().last().map_or_else(String::new, |name| name.display().to_string())),
            recorder: known.recorder.as_ref().map(|trouble| trouble.why.clone()),
            dropped,
            refused: fleet.refused(),
            forgotten: fleet.dropped(),
            stale_rank: Alarm::Stale as usize,
            signed: known.intake.is_signed(),
            unread: vec![
                ("not signed with this station's key", refused.unsigned),
                ("TUNNEL with another payload type or length", refused.malformed),
                ("TUNNEL damaged on the way", refused.bad_crc),
                ("MAVLink 1, in which TUNNEL cannot travel", refused.version_1),
                ("neither a profile nor an image", refused.damaged),
                ("longer than any datagram with objects", refused.oversized),
                ("other MAVLink messages", refused.foreign),
            ],
            uplinks: known.voice.as_ref().is_some_and(Voice::sends_uplinks),
            commands: known.voice.as_ref().is_some_and(Voice::sends_commands),
        },
        drones: with.list.then(|| fleet.iter().map(line).collect()),
        log: with.list.then(|| known.alarms.iter().map(change).collect()),
        drone: shown.map(|(id, drone)| detail(known, id, drone, now_us)),
        history: shown.filter(|_| with.history).map(|(id, drone)| {
            let sample = |sample: &history::Sample| {
                let gps = sample.gps(drone.receivers()).collect();
                Sample(sample.at_us / 1_000, sample.voted(), gps, sample.height(), sample.age(), sample.agree())
            };
            known.history.of(id).map(sample).collect()
        }),
        hold_history: shown.filter(|_| with.history).map(|(id, _)| hold::history(known, id)),
    }
}

/// Returns the drone of this name. If that drone is gone, returns another sender with its id.
fn named<'a>(fleet: &'a Fleet, name: &str) -> Option<(DroneId, &'a Drone)> {
    let who = |id: DroneId| id.who.to_string();
    fleet.iter().find(|(id, _)| id.to_string() == name).or_else(|| {
        let is_sender = |rest: &str| rest.strip_prefix('-').is_some_and(|number| number.parse::<u8>().is_ok());
        fleet.iter().find(|(id, _)| name.strip_prefix(&who(*id)).is_some_and(|rest| rest.is_empty() || is_sender(rest)))
    })
}

fn detail(known: &StationData, id: DroneId, drone: &Drone, now_us: u64) -> Detail {
    let fleet = known.intake.fleet();
    let alarms = drone.alarms_at(now_us);
    let since = |alarm| drone.raised().find(|raised| raised.alarm == alarm).map_or(now_us, |raised| raised.since_us);
    let counts = drone.counts();
    let source = fleet.source(id).unwrap_or_default();
    Detail {
        id: id.to_string(),
        from: source.from.map_or_else(|| format!("line {}", source.line), |from| from.to_string()),
        signed: source.signed,
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
                memory_fault: v.status.memory_fault(),
                reset: words::reset(v.status.reset_reason()),
                reset_usual: matches!(v.status.reset_reason(), Some(ResetReason::PowerOn | ResetReason::Pin)),
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
                reset: words::reset(v.status.reset_reason()),
            }
        }),
        port: drone.port_status().map(|held| Port {
            age_ms: held.age_us(now_us) / 1_000,
            stored: held.values.uplinks_accepted,
            violations: held.values.violations.total(),
            last_refused: held.values.status.last_refused(),
        }),
        uplink: known.voice.as_ref().and_then(|voice| voice.sending(id)).map(|sending| Uplink::of(sending, now_us)),
        hold: Hold::of(known, id, drone, now_us),
        alarms: alarms
            .iter()
            .map(|alarm| Raised {
                code: alarm.code(),
                words: alarm.words(),
                critical: alarm.severity() == Severity::Critical,
                rank: alarm as usize,
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
        fix: words::fix(v.status.fix_type()),
        valid: v.status.position_valid(),
        heard: v.status.heard(),
        stale: v.status.stale(),
        excluded: v.status.excluded(),
        solution: words::solution_age(v.status),
        position: [v.latitude, v.longitude, v.altitude],
    })
}
