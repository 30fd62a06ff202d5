//! Formats the state of a drone as text.

use core::fmt::{self, Write as _};

use profile::{FixType, GpsStatus, HorusState, ResetReason};

use super::{Counts, Drone, Held};

/// Returns HORUS's state as text. A state of a later version has no name here.
#[must_use]
pub const fn state(state: Option<HorusState>) -> &'static str {
    match state {
        Some(HorusState::Starting) => "starting",
        Some(HorusState::Monitoring) => "monitoring",
        Some(HorusState::OutsideRange) => "OUTSIDE THE RANGE",
        Some(HorusState::SwitchedToRedundant) => "SWITCHED TO REDUNDANT FLIGHT CONTROLLER",
        Some(HorusState::MotorsCut) => "MOTORS CUT",
        Some(HorusState::EmergencyFired) => "EMERGENCY MEASURE FIRED",
        Some(HorusState::InputsContradict) => "STATE UNKNOWN: INPUTS CONTRADICT",
        Some(HorusState::PositionLost) => "POSITION LOST",
        None => "in an unknown state",
    }
}

/// Returns a receiver's fix as text.
#[must_use]
pub const fn fix(fix: Option<FixType>) -> &'static str {
    match fix {
        Some(FixType::NoFix) => "no fix",
        Some(FixType::DeadReckoning) => "dead reckoning",
        Some(FixType::Fix2D) => "2D",
        Some(FixType::Fix3D) => "3D",
        Some(FixType::GnssDeadReckoning) => "3D and dead reckoning",
        Some(FixType::TimeOnly) => "time only",
        None => "unknown",
    }
}

/// Returns, as text, the reason of HORUS's or the DPR's last start.
#[must_use]
pub const fn reset(reason: Option<ResetReason>) -> &'static str {
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

/// Returns the age, as text, that a receiver's solution had when HORUS sent it.
#[must_use]
pub fn solution_age(status: GpsStatus) -> String {
    match status.solution_age_ms() {
        None => "none yet".to_owned(),
        Some(GpsStatus::OLDEST_MS) => format!("{} ms or more", GpsStatus::OLDEST_MS),
        Some(ms) => format!("{ms} ms"),
    }
}

impl Drone {
    /// Returns the state at `now_us` as text: a line for each object with its age, the alarms, and the link's totals.
    #[must_use]
    pub fn words(&self, now_us: u64) -> String {
        let mut words = String::new();
        let _ = self.write(&mut words, now_us);
        words
    }

    fn write(&self, f: &mut String, now_us: u64) -> fmt::Result {
        match self.timestamp() {
            None => writeln!(f, "no profile received")?,
            Some(ms) => writeln!(f, "{} s after HORUS start", f64::from(ms) / 1e3)?,
        }
        write!(f, "  Reported  ")?;
        match &self.reported {
            None => writeln!(f, "not received")?,
            Some(held) => {
                let v = &held.values;
                row(f, v.status.position_valid(), [v.latitude, v.longitude, v.altitude], [v.pitch, v.roll, v.yaw])?;
                let degraded = if v.status.degraded() { ", degraded" } else { "" };
                let (doing, agreeing) = (state(v.status.state()), v.status.receivers_agreeing());
                let memory = if v.status.memory_fault() { ", MEMORY FAULT" } else { "" };
                let last = reset(v.status.reset_reason());
                write!(f, "  {doing}, {agreeing} of {} agree{degraded}{memory}, last reset: {last}", self.receivers)?;
                age(f, held, now_us)?;
            }
        }
        for (place, held) in self.gps.iter().take(self.receivers).enumerate() {
            write!(f, "  GPS{}      ", place + 1)?;
            let Some(held) = held else {
                writeln!(f, "not received")?;
                continue;
            };
            let v = &held.values;
            row(f, v.status.position_valid(), [v.latitude, v.longitude, v.altitude], [v.pitch, v.roll, v.yaw])?;
            let notes = [(!v.status.heard(), "silent"), (v.status.stale(), "stale"), (v.status.excluded(), "excluded")];
            for (_, note) in notes.into_iter().filter(|(applies, _)| *applies) {
                write!(f, "  {note}")?;
            }
            write!(f, "  solution: {}", solution_age(v.status))?;
            age(f, held, now_us)?;
        }
        for alarm in self.alarms_at(now_us).iter() {
            writeln!(f, "  ALARM     {alarm}")?;
        }
        let Counts { messages, missed, bad_crc, misplaced, vacant, .. } = self.counts;
        write!(
            f,
            "  {messages} profiles, {missed} cycles missed, {bad_crc} bad CRC, {misplaced} misplaced, {vacant} vacant"
        )
    }
}

fn age<T>(f: &mut String, held: &Held<T>, now_us: u64) -> fmt::Result {
    writeln!(f, "  {:.2} s ago", held.age_us(now_us) as f64 / 1e6)
}

fn row(f: &mut String, valid: bool, [latitude, longitude, altitude]: [f64; 3], attitude: [f32; 3]) -> fmt::Result {
    if !valid {
        return write!(f, "no position");
    }
    let (north, east) = (if latitude < 0.0 { 'S' } else { 'N' }, if longitude < 0.0 { 'W' } else { 'E' });
    write!(f, "{:11.7}° {north} {:12.7}° {east} {altitude:9.3} m", latitude.abs(), longitude.abs())?;
    let [pitch, roll, yaw] = attitude.map(f32::to_degrees);
    if pitch.is_nan() {
        return Ok(());
    }
    write!(f, "  pitch {pitch:5.1}° roll {roll:5.1}° yaw {:5.1}°", yaw.rem_euclid(360.0))
}
