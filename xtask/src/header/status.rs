//! Names the bits and codes of the status words, and the client's verdicts, and writes them for C.

use std::fmt::Write as _;

use anyhow::{Result, ensure};
use profile::hold::{Outcome, Words};
use profile::ssi::client::{HoldShown, Verdict};
use profile::{
    Command, FixType, GpsStatus, HoldCommand, HoldStatusBits, HorusState, LinkStatusBits, PortStatusBits,
    ReportedStatus, ResetReason, Violation,
};

use super::defines;

/// The bit's name, mask and meaning.
type Bit = (&'static str, u16, &'static str);

/// The meaning of the value in a status word's code of several bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Code {
    Number,
    /// The code is a value of the enumeration of this name.
    Enumeration(&'static str),
    /// The code is an age, stated in steps of a fixed duration.
    Age,
}

/// A code of several bits in a status word: name, mask, meaning, reading.
type Codes = (&'static str, u16, &'static str, Code);

pub(crate) struct Bits {
    pub(crate) name: &'static str,
    pub(crate) mask: u16,
    pub(crate) what: &'static str,
    /// The way in which the code is read; `None` for a single bit.
    pub(crate) code: Option<Code>,
}

/// A status word. Its bits are in order and fill the mask `used`.
pub(crate) struct Word {
    pub(crate) prefix: &'static str,
    pub(crate) title: &'static str,
    pub(crate) used: u16,
    pub(crate) bits: Vec<Bits>,
}

pub(crate) struct Enumeration {
    pub(crate) name: &'static str,
    pub(crate) title: &'static str,
    /// The prefix of the enumeration's values in C, after HORUS_DPR_.
    prefix: &'static str,
    pub(crate) values: Vec<(&'static str, u8, &'static str)>,
}

pub(super) fn definitions() -> Result<String> {
    let mut text = String::new();
    for word in words()? {
        text += &word.definitions();
        if word.bits.iter().any(|bits| bits.code == Some(Code::Age)) {
            text += &ages()?;
        }
    }
    Ok(codes().iter().fold(text, |text, codes| text + &codes.definition()))
}

pub(crate) fn words() -> Result<Vec<Word>> {
    let reported = ReportedStatus::new();
    let gps = GpsStatus::new();
    let link = LinkStatusBits::new();
    let port = PortStatusBits::new();
    let hold = HoldStatusBits::new();
    Ok(vec![
        word(
            "REPORTED",
            "Reported-Position",
            ReportedStatus::USED,
            &[
                ("POSITION_VALID", reported.with_position_valid(true).bits(), "latitude and longitude are valid"),
                ("ATTITUDE_VALID", reported.with_attitude_valid(true).bits(), "pitch, yaw and roll are valid"),
                ("ACCELERATION_VALID", reported.with_acceleration_valid(true).bits(), "the accelerations are valid"),
                (
                    "DEGRADED",
                    reported.with_degraded(true).bits(),
                    "fewer receivers agree than configured, or on no altitude",
                ),
                ("WITHOUT_CRYSTAL", reported.with_without_crystal(true).bits(), "HORUS runs without its crystal"),
                ("MEMORY_FAULT", reported.with_memory_fault(true).bits(), "HORUS has found a fault of its memory"),
            ],
            &[
                ("AGREEING", reported.with_receivers_agreeing(7).bits(), "receivers that agree, 0 to 7", Code::Number),
                ("STATE", 0x0F00, "what HORUS is doing", Code::Enumeration("state")),
                ("RESET", 0xE000, "why HORUS last started", Code::Enumeration("reset")),
            ],
        )?,
        word(
            "GPS",
            "GPS1 to GPS5",
            GpsStatus::USED,
            &[
                ("POSITION_VALID", gps.with_position_valid(true).bits(), "latitude and longitude are valid"),
                ("ATTITUDE_VALID", gps.with_attitude_valid(true).bits(), "pitch, yaw and roll are valid"),
                ("ACCELERATION_VALID", gps.with_acceleration_valid(true).bits(), "the accelerations are valid"),
                ("HEARD", gps.with_heard(true).bits(), "heard in the last 250 ms"),
                ("STALE", gps.with_stale(true).bits(), "the solution is older than its period allows"),
                ("EXCLUDED", gps.with_excluded(true).bits(), "the voter excluded this receiver"),
            ],
            &[
                ("FIX", 0x000F, "UBX fixType", Code::Enumeration("fix")),
                ("AGE", gps.with_solution_age_ms(None).bits(), "age of its solution", Code::Age),
            ],
        )?,
        word(
            "LINK",
            "Link-Status",
            LinkStatusBits::USED,
            &[
                ("UP", link.with_link_up(true).bits(), "frames arrive within their deadline"),
                ("ALL_ACCEPTED", link.with_all_accepted(true).bits(), "every object of the last cycle was accepted"),
                ("HORUS_FROZEN", link.with_horus_frozen(true).bits(), "HORUS repeats its timestamp"),
                ("HORUS_RESTARTED", link.with_horus_restarted(true).bits(), "HORUS started again"),
                ("RAM_FAULT", link.with_ram_fault(true).bits(), "a scrub found a RAM fault"),
                ("FRONT_END_FAULT", link.with_front_end_fault(true).bits(), "the RFID front end has a fault"),
                ("UNASKED_RESET", link.with_unasked_reset(true).bits(), "nobody asked for the DPR's last reset"),
                ("UPLINK_REJECTED", link.with_uplink_rejected(true).bits(), "the last uplink was rejected"),
                ("OUT_OF_SEQUENCE", link.with_out_of_sequence(true).bits(), "nothing is shown until it is found again"),
                ("CLOCK_IMPLAUSIBLE", link.with_horus_clock_implausible(true).bits(), "HORUS's clock is off by > 2 %"),
                ("FLASH_FAULT", link.with_flash_fault(true).bits(), "the DPR's program memory is damaged"),
                ("NO_FIELD", link.with_no_field(true).bits(), "the front end works and senses no field of the sender"),
            ],
            &[("RESET", 0x7000, "why the DPR last started", Code::Enumeration("reset"))],
        )?,
        word(
            "PORT",
            "Port-Status",
            PortStatusBits::USED,
            &[
                ("BASE_STATION_FRESH", port.with_base_station_fresh(true).bits(), "its uplink is shown"),
                ("FLIGHT_CONTROLLER_FRESH", port.with_flight_controller_fresh(true).bits(), "its uplink is shown"),
                ("LAST_REFUSED", port.with_last_refused(true).bits(), "the last uplink or command was refused"),
                ("SELF_TEST_RUNNING", port.with_self_test_running(true).bits(), "a self-test is under way"),
                ("SELF_TEST_PASSED", port.with_self_test_passed(true).bits(), "the last one found nothing"),
                ("SELF_TEST_FAILED", port.with_self_test_failed(true).bits(), "the last one found a fault"),
                ("BUFFERS_OUT_OF_USE", port.with_buffers_out_of_use(true).bits(), "a buffer or image is out of use"),
                ("HOLD_HEARD", port.with_hold_heard(true).bits(), "a frame of the hold came in the last 300 ms"),
                ("HOLD_ACCEPTED", port.with_hold_accepted(true).bits(), "the last one was accepted"),
            ],
            &[
                (
                    "HOLD_ACCEPTED_COUNT",
                    port.with_hold_counts(15, 0).bits(),
                    "objects of the hold accepted, mod 16",
                    Code::Number,
                ),
                (
                    "HOLD_REJECTED_COUNT",
                    port.with_hold_counts(0, 7).bits(),
                    "frames of the hold rejected, mod 8",
                    Code::Number,
                ),
            ],
        )?,
        word(
            "HOLD_STATUS",
            "Hold-Status",
            HoldStatusBits::USED,
            &[
                ("VALUES_VALID", hold.with_values_valid(true).bits(), "the values are valid"),
                ("WITHIN_LIMITS", hold.with_within_limits(true).bits(), "the values are within the hold's limits"),
                ("LOCKED", hold.with_locked(true).bits(), "locked"),
                ("SENSOR_FAULT", hold.with_sensor_fault(true).bits(), "a sensor has a fault"),
                ("MEMORY_FAULT", hold.with_memory_fault(true).bits(), "the hold has found a fault of its memory"),
                ("SAFE_STATE", hold.with_safe_state(true).bits(), "the output is off, the lock stays as it is"),
            ],
            &[("RESET", 0x01C0, "why the hold last started", Code::Enumeration("reset"))],
        )?,
    ])
}

fn ages() -> Result<String> {
    let code = |age_ms| GpsStatus::new().with_solution_age_ms(age_ms).bits() >> 10;
    ensure!(code(Some(u32::from(GpsStatus::AGE_STEP_MS))) == 1, "the age of a solution has another step");
    let lines = [
        ("GPS_AGE_STEP_MS", GpsStatus::AGE_STEP_MS, "the step of that age, ms"),
        ("GPS_OLDEST_MS", GpsStatus::OLDEST_MS, "the age that stands for this or more, ms"),
        ("GPS_AGE_NEVER", code(None), "the code of an age: there was no solution since HORUS's start"),
        ("NO_SOLUTION", u16::MAX, "what horus_dpr_solution_age_ms says to that code"),
    ];
    Ok(defines(&lines.map(|(name, value, what)| (format!("HORUS_DPR_{name}"), format!("{value}U"), what))) + "\n")
}

fn word(prefix: &'static str, title: &'static str, used: u16, flags: &[Bit], codes: &[Codes]) -> Result<Word> {
    let flags = flags.iter().map(|&(name, mask, what)| Bits { name, mask, what, code: None });
    let codes = codes.iter().map(|&(name, mask, what, code)| Bits { name, mask, what, code: Some(code) });
    let mut bits: Vec<_> = flags.chain(codes).collect();
    bits.sort_by_key(|bits| bits.mask);
    let mut seen = 0;
    for Bits { name, mask, .. } in &bits {
        ensure!(*mask != 0 && seen & mask == 0, "{prefix}_{name} is {mask:#06X}, of which some is another's");
        seen |= mask;
    }
    ensure!(seen == used, "the bits of {title} are {used:#06X}, those named here {seen:#06X}");
    Ok(Word { prefix, title, used, bits })
}

impl Word {
    fn definitions(&self) -> String {
        let Self { prefix, title, used, bits } = self;
        let name = |bits: &Bits, end: &str| format!("HORUS_DPR_{prefix}_{}{end}", bits.name);
        let line = |bits: &Bits| {
            let end = if bits.code.is_some() { "_MASK" } else { "" };
            let reading = match bits.code {
                Some(Code::Enumeration(name)) => format!(": horus_dpr_{name}_t"),
                Some(Code::Age) => ": horus_dpr_solution_age_ms".to_owned(),
                Some(Code::Number) | None => String::new(),
            };
            (name(bits, end), format!("0x{:04X}U", bits.mask), format!("{}{reading}", bits.what))
        };
        let mut lines: Vec<_> = bits.iter().map(line).collect();
        lines.push((
            format!("HORUS_DPR_{prefix}_USED"),
            format!("0x{used:04X}U"),
            "the bits that have a meaning".into(),
        ));
        for bits in bits.iter().filter(|bits| bits.code.is_some()) {
            let shift = format!("{}U", bits.mask.trailing_zeros());
            lines.push((name(bits, "_SHIFT"), shift, "how far to shift that code down".into()));
        }
        format!("/* {title}. */\n{}\n", defines(&lines))
    }
}

impl Enumeration {
    pub(super) fn definition(&self) -> String {
        let Self { name, title, prefix, values } = self;
        let width = values.iter().map(|(value, ..)| value.len()).max().unwrap_or(0) + prefix.len() + 16;
        let mut text = format!("/* {title} */\ntypedef enum {{\n");
        for (index, (value, number, what)) in values.iter().enumerate() {
            let comma = if index + 1 == values.len() { "" } else { "," };
            let line = format!("HORUS_DPR_{prefix}{value} = {number}{comma}");
            let _ = writeln!(text, "    {line:width$} /* {what} */");
        }
        let _ = writeln!(text, "}} horus_dpr_{name}_t;\n");
        text
    }
}

pub(crate) fn codes() -> [Enumeration; 4] {
    use {FixType as F, HorusState as S, ResetReason as R};
    let states = [
        S::Starting,
        S::Monitoring,
        S::OutsideRange,
        S::SwitchedToRedundant,
        S::MotorsCut,
        S::EmergencyFired,
        S::InputsContradict,
        S::PositionLost,
    ];
    let states = states.map(|state| {
        let (name, what) = match state {
            S::Starting => ("STARTING", "no position since HORUS's start"),
            S::Monitoring => ("MONITORING", "there is a position now"),
            S::OutsideRange => ("OUTSIDE_RANGE", "the position is outside the flight range"),
            S::SwitchedToRedundant => ("SWITCHED", "switched to the redundant flight controller"),
            S::MotorsCut => ("MOTORS_CUT", "motors cut"),
            S::EmergencyFired => ("EMERGENCY_FIRED", "emergency measure fired"),
            S::InputsContradict => ("INPUTS_CONTRADICT", "an input that tells the state contradicts itself"),
            S::PositionLost => ("POSITION_LOST", "there was a position, and there is none now"),
        };
        (name, state as u8, what)
    });
    let fixes = [F::NoFix, F::DeadReckoning, F::Fix2D, F::Fix3D, F::GnssDeadReckoning, F::TimeOnly].map(|fix| {
        let (name, what) = match fix {
            F::NoFix => ("NONE", "no fix"),
            F::DeadReckoning => ("DEAD_RECKONING", "dead reckoning only"),
            F::Fix2D => ("2D", "two-dimensional fix"),
            F::Fix3D => ("3D", "three-dimensional fix"),
            F::GnssDeadReckoning => ("COMBINED", "GNSS and dead reckoning combined"),
            F::TimeOnly => ("TIME_ONLY", "time only"),
        };
        (name, fix as u8, what)
    });
    let resets = [R::PowerOn, R::Pin, R::Watchdog, R::Lockup, R::Software, R::BrownOutOrOther].map(|reason| {
        let (name, what) = match reason {
            R::PowerOn => ("POWER_ON", "its supply came on"),
            R::Pin => ("PIN", "its reset pin was low"),
            R::Watchdog => ("WATCHDOG", "its watchdog was not fed"),
            R::Lockup => ("LOCKUP", "a fault while it handled a fault"),
            R::Software => ("SOFTWARE", "software or a debugger asked for it"),
            R::BrownOutOrOther => ("OTHER", "its supply dipped, or something else"),
        };
        (name, reason as u8, what)
    });
    let outcomes = [Outcome::Nothing, Outcome::Done, Outcome::Refused, Outcome::Unknown, Outcome::TooOld];
    let outcomes = outcomes.map(|outcome| {
        let (name, what) = match outcome {
            Outcome::Nothing => ("NOTHING", "there was no command since the hold's start"),
            Outcome::Done => ("DONE", "it was carried out"),
            Outcome::Refused => ("REFUSED", "the hold's own limits forbid it"),
            Outcome::Unknown => ("UNKNOWN", "its word is unknown"),
            Outcome::TooOld => ("TOO_OLD", "its uplink had the same timestamp for more than 1 s"),
        };
        (name, outcome.code() as u8, what)
    });
    let reasons = "Why the DPR, HORUS or the hold last started. Other codes are reserved.";
    let became = "What became of a command to the hold. Other codes are reserved.";
    [
        enumeration("state", "What HORUS is doing. Other codes are reserved.", "STATE_", &states),
        enumeration("fix", "A receiver's fix. Other codes are reserved.", "FIX_", &fixes),
        enumeration("reset", reasons, "RESET_", &resets),
        enumeration("outcome", became, "OUTCOME_", &outcomes),
    ]
}

fn enumeration(
    name: &'static str,
    title: &'static str,
    prefix: &'static str,
    values: &[(&'static str, u8, &'static str)],
) -> Enumeration {
    Enumeration { name, title, prefix, values: values.to_vec() }
}

pub(crate) fn verdicts() -> Enumeration {
    let none = ("NONE", 0, "no transaction has ended: nobody filled the report");
    let verdicts = Verdict::ALL.map(|verdict| {
        let (name, what) = match verdict {
            Verdict::Fresh => ("FRESH", "a new sample, in sequence, valid, not too old: its position is shown"),
            Verdict::Same => ("SAME", "the same sample again, intact: not new, only older"),
            Verdict::Searching => ("SEARCHING", "a new sample; the sequence is not found yet. Not shown"),
            Verdict::OutOfSequence => ("OUT_OF_SEQUENCE", "a sample that does not continue the others. Not shown"),
            Verdict::Empty => ("EMPTY", "Link-Status is intact; there is no Reported-Position"),
            Verdict::Invalid => ("INVALID", "a new sample whose position is not valid and not shown; its status is"),
            Verdict::Stale => ("STALE", "an intact sample that is older than the limit. Not shown"),
            Verdict::Busy => ("BUSY", "0xFF throughout, or nothing: not heard; what was sent is sent again"),
            Verdict::Damaged => ("DAMAGED", "damaged, or not read whole: nothing of it is used"),
            Verdict::Silent => ("SILENT", "busy or damaged, and nothing intact for too long"),
            Verdict::Window => ("OTHER_WINDOW", "the window that was asked for: see horus_dpr_view_..."),
        };
        (name, verdict as u8, what)
    });
    enumeration("verdict", "What a transaction brought.", "", &[&[none][..], &verdicts].concat())
}

pub(crate) fn hold_shown() -> Enumeration {
    let cases = HoldShown::ALL.map(|shown| {
        let (name, what) = match shown {
            HoldShown::Absent => ("ABSENT", "the DPR shows none, or none was read yet"),
            HoldShown::Old => ("OLD", "the last one has not changed for more than HORUS_DPR_HOLD_EXPIRY_US"),
            HoldShown::Valid => ("VALID", "there is one"),
        };
        (name, shown as u8, what)
    });
    enumeration("hold_shown", "Whether there is a Hold-Status.", "HOLD_", &cases)
}

pub(crate) fn hold_words() -> [(&'static str, u16, &'static str); 4] {
    let commands = [HoldCommand::SetPoint(0.0), HoldCommand::Lock, HoldCommand::Unlock, HoldCommand::ClearShock];
    commands.map(|command| {
        let (name, what) = match command {
            HoldCommand::SetPoint(_) => ("SET_POINT", "the value is the temperature to keep, degrees Celsius"),
            HoldCommand::Lock => ("LOCK", "locks it"),
            HoldCommand::Unlock => ("UNLOCK", "unlocks it"),
            HoldCommand::ClearShock => ("CLEAR_SHOCK", "sets the greatest shock to 0"),
        };
        (name, command.encode().0, what)
    })
}

pub(crate) fn command(command: Command) -> (&'static str, &'static str) {
    match command {
        Command::ClearCounters => ("CLEAR_COUNTERS", "sets Port-Status's counters to 0"),
        Command::SelfTest => ("SELF_TEST", "one whole pass over flash and RAM in use"),
        _ => unreachable!("a command that C has no name for"),
    }
}

pub(crate) fn violation(kind: Violation) -> (&'static str, &'static str) {
    match kind {
        Violation::RequestDamaged => ("REQUEST_DAMAGED", "a request whose CRC is wrong"),
        Violation::WindowOutside => ("WINDOW_OUTSIDE", "a window that is empty or not in the map"),
        Violation::TooShort => ("TOO_SHORT", "a request or an object that ended in the middle"),
        Violation::UplinkDamaged => ("UPLINK_DAMAGED", "an object whose CRC is wrong"),
        Violation::UplinkIdentifier => ("UPLINK_IDENTIFIER", "an object that nobody may write"),
        Violation::UplinkNotNewer => ("UPLINK_NOT_NEWER", "an uplink or a command that is repeated or old"),
        Violation::CommandUnknown => ("COMMAND_UNKNOWN", "an unknown command, or reserved bytes that are not zero"),
        Violation::CommandBusy => ("COMMAND_BUSY", "a self-test while one is under way"),
        Violation::TooMany => ("TOO_MANY", "more transactions or objects than the DPR grants"),
        Violation::TooLong => ("TOO_LONG", "something was driven behind the object"),
    }
}
