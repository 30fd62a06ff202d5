//! Writes the description in JSON.

use anyhow::Result;
use profile::ssi::{client, client::Config, timing};
use profile::{ABSENT_F32, ABSENT_F64, Command, GpsStatus, Layout, Uplink, Violation, crc, hold, range};
use serde_json::{Value, json};

use super::{identifiers, objects, places};
use crate::header::objects::{Field, Kind, Object};
use crate::header::status::{self, Bits, Code, Enumeration, Word};

pub(super) fn description() -> Result<String> {
    let objects: Vec<_> = objects()?.iter().map(object).collect();
    let words: Vec<_> = status::words()?.iter().map(word).collect();
    let layouts = Layout::ALL.into_iter().chain(Layout::ALL.map(Layout::with_hold));
    let maps = layouts.map(map).collect::<Result<Vec<_>>>()?;
    let named = |(name, what): (&str, &str), value: u64| json!({ "name": name, "value": value, "what": what });
    let commands = Command::ALL.map(|command| named(status::command(command), command.word().into()));
    let hold_commands = status::hold_words().map(|(name, word, what)| named((name, what), word.into()));
    let violations: Vec<_> = (0..).zip(Violation::ALL).map(|(n, kind)| named(status::violation(kind), n)).collect();
    let identifiers: Vec<_> =
        identifiers().iter().map(|(name, identifier)| json!({ "name": name, "value": identifier.0 })).collect();
    let hex = |value: u32| format!("0x{value:08X}");
    let [frame, position] = [crc::FRAME, crc::POSITION].map(|algorithm| {
        json!({
            "width": algorithm.width,
            "polynomial": hex(algorithm.poly),
            "init": hex(algorithm.init),
            "xorout": hex(algorithm.xorout),
            "reflect_in": algorithm.refin,
            "reflect_out": algorithm.refout,
            "check": hex(algorithm.check),
            "residue": hex(algorithm.residue),
            "byte_order": "big-endian",
        })
    });
    let enumerations: Vec<_> =
        status::codes().iter().chain(&[status::verdicts(), status::hold_shown()]).map(enumeration).collect();
    let description = json!({
        "$schema": "layout.schema.json",
        "generated": "by `cargo xtask layout`. Do not edit.",
        "version": env!("CARGO_PKG_VERSION"),
        "byte_order": "little-endian",
        "cycle_ms": profile::CYCLE_MS,
        "absent": {
            "f32": hex(ABSENT_F32.to_bits()),
            "f64": format!("0x{:016X}", ABSENT_F64.to_bits()),
        },
        "crcs": { "frame": frame, "position": position },
        "identifiers": identifiers,
        "objects": objects,
        "status_words": words,
        "enumerations": enumerations,
        "commands": commands,
        "hold_commands": hold_commands,
        "violations": violations,
        "maps": maps,
        "range": {
            "max_latitude": range::MAX_LATITUDE,
            "max_longitude": range::MAX_LONGITUDE,
            "min_altitude": range::MIN_ALTITUDE,
            "max_altitude": range::MAX_ALTITUDE,
        },
        "solution_age": { "step_ms": GpsStatus::AGE_STEP_MS, "oldest_ms": GpsStatus::OLDEST_MS, "never": never() },
        "client": {
            "age_limit_us": Config::AGE_LIMIT_US,
            "silence_us": Config::SILENCE_US,
            "max_missed": client::MAX_MISSED,
            "search_cycles": client::SEARCH_CYCLES,
            "tolerance_us": client::TOLERANCE_US,
            "tolerance_share": client::TOLERANCE_SHARE,
            "expiry_us": client::EXPIRY_US,
            "uplink_expiry_ms": Uplink::EXPIRY_MS,
            "hold_expiry_us": 1_000 * u64::from(hold::EXPIRY_MS),
            "hold_frame_us": client::HOLD_FRAME_US,
        },
        "wire": {
            "max_clock_hz": timing::MAX_CLOCK_HZ,
            "csn_setup_ns": timing::CSN_SETUP_NS,
            "csn_hold_ns": timing::CSN_HOLD_NS,
            "gap_ns": timing::GAP_NS,
        },
    });
    Ok(serde_json::to_string_pretty(&description)? + "\n")
}

/// Returns the code for the age of a solution if there never was one.
pub(super) fn never() -> u16 {
    let age = GpsStatus::new().with_solution_age_ms(None).bits();
    age >> age.trailing_zeros()
}

fn object(object: &Object) -> Value {
    json!({
        "name": object.name,
        "title": object.title,
        "bytes": object.size,
        "identifiers": object.identifiers.iter().map(|identifier| identifier.0).collect::<Vec<_>>(),
        "fields": object.fields.iter().map(field).collect::<Vec<_>>(),
    })
}

fn field(field: &Field) -> Value {
    let (kind, size) = match field.kind {
        Kind::U16 | Kind::Identifier | Kind::Status(_) | Kind::Counts | Kind::Acknowledged => ("u16", 2),
        Kind::U32 | Kind::Word => ("u32", 4),
        Kind::F32 | Kind::Axes => ("f32", 4),
        Kind::F64 => ("f64", 8),
        Kind::Bytes => ("bytes", 1),
        Kind::Zero => ("zero", 1),
        Kind::Crc { .. } => ("crc", 4),
    };
    let mut value = json!({
        "name": field.name,
        "offset": field.place.start,
        "bytes": field.place.len(),
        "type": kind,
        "count": field.place.len() / size,
    });
    let mut put = |key: &str, more: Value| value[key] = more;
    match field.kind {
        Kind::Status(prefix) if !prefix.is_empty() => put("status_word", prefix.to_lowercase().into()),
        Kind::Counts => put("counts", "violations".into()),
        Kind::Word => put("one_of", "commands".into()),
        Kind::Identifier => put("one_of", "identifiers".into()),
        Kind::Crc { name, from } => {
            put("crc", name.into());
            put("covers", json!([from, field.place.start]));
        }
        _ => {}
    }
    for (key, text) in [("unit", field.unit), ("what", field.what)] {
        if !text.is_empty() {
            put(key, text.into());
        }
    }
    value
}

fn word(word: &Word) -> Value {
    let bits = word.bits.iter().map(|Bits { name, mask, what, code }| {
        let mut value = json!({
            "name": name.to_lowercase(),
            "mask": format!("0x{mask:04X}"),
            "shift": mask.trailing_zeros(),
            "what": what,
            "is_code": code.is_some(),
        });
        match code {
            Some(Code::Enumeration(name)) => value["enumeration"] = (*name).into(),
            Some(Code::Age) => value["unit"] = "solution_age".into(),
            Some(Code::Number) | None => {}
        }
        value
    });
    json!({
        "name": word.prefix.to_lowercase(),
        "title": word.title,
        "used": format!("0x{:04X}", word.used),
        "bits": bits.collect::<Vec<_>>(),
    })
}

fn enumeration(codes: &Enumeration) -> Value {
    let values = codes.values.iter().map(|(name, value, what)| json!({ "name": name, "value": value, "what": what }));
    json!({ "name": codes.name, "title": codes.title, "values": values.collect::<Vec<_>>() })
}

fn map(layout: Layout) -> Result<Value> {
    let place = |place: super::Place| {
        json!({
            "object": place.object,
            "identifier": place.identifier.0,
            "offset": place.bytes.start,
            "bytes": place.bytes.len(),
        })
    };
    Ok(json!({
        "receivers": layout.receivers(),
        "hold": layout.hold().is_some(),
        "profile_bytes": layout.profile_len(),
        "image_bytes": layout.image_len(),
        "map_bytes": layout.map_len(),
        "places": places(layout)?.into_iter().map(place).collect::<Vec<_>>(),
    }))
}
