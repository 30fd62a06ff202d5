//! Writes the Python package's module of the objects, their bits and their codes.

use std::fmt::Write as _;

use anyhow::{Context, Result};
use profile::ssi::{client, client::Config};
use profile::{Command, GpsStatus, Layout, Uplink, Violation, crc, hold, image, range};

use super::{identifiers, json, places};
use crate::header::objects::{self, Field, Kind, Object};
use crate::header::status::{self, Bits, Code, Enumeration, Word};

const HEAD: &str = r#"# SPDX-License-Identifier: MIT OR Apache-2.0
"""The objects of HORUS, their status words, codes and places.

Generated from the Rust crate `profile` by `cargo xtask layout`. Do not edit: `cargo xtask lint` fails if this file
differs from the generated one.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar, Dict, Optional, Tuple, Type

from ._base import Crc, Field, MapLayout, Object, Place, Word

"#;

pub(super) fn module() -> Result<String> {
    let mut text = HEAD.to_owned();
    text += &constants();
    let identifiers = identifiers();
    let identifiers = identifiers.iter().map(|(name, identifier)| (name.as_str(), identifier.0.into(), ""));
    text += &enumeration("Identifier", "The kind of an object.", identifiers);
    for codes in status::codes().into_iter().chain([status::verdicts(), status::hold_shown()]) {
        let Enumeration { name, title, values, .. } = codes;
        let values = values.iter().map(|(name, value, what)| (*name, (*value).into(), *what));
        text += &enumeration(&camel(name), title, values);
    }
    let commands = Command::ALL.map(|command| (status::command(command), command.word()));
    let commands = commands.iter().map(|((name, what), word)| (*name, *word, *what));
    text += &enumeration("CommandWord", "What a command asks of the DPR.", commands);
    let words = status::hold_words().map(|(name, word, what)| (name, word.into(), what));
    text += &enumeration("HoldWord", "What a command asks of the hold; 0 is none.", words.into_iter());
    let violations = (0..).zip(Violation::ALL.map(status::violation)).map(|(place, (name, what))| (name, place, what));
    text += &enumeration("Violation", "Places in `PortStatus.violations`.", violations);
    for word in status::words()? {
        text += &status_word(&word);
    }
    for object in objects::all()? {
        text += &class(&object);
    }
    text += "\n#: The map for each number of receivers.\n";
    text += &maps("MAPS", Layout::ALL)?;
    text += "\n#: The same where the DPR has an active hold.\n";
    text += &maps("MAPS_WITH_HOLD", Layout::ALL.map(Layout::with_hold))?;
    Ok(text)
}

fn maps(name: &str, layouts: [Layout; 4]) -> Result<String> {
    let mut text = format!("{name}: Dict[int, MapLayout] = {{\n");
    for layout in layouts {
        let (profile, image, map) = (layout.profile_len(), layout.image_len(), layout.map_len());
        let _ = writeln!(
            text,
            "    {}: MapLayout(\n        {profile},\n        {image},\n        {map},\n        (",
            layout.receivers()
        );
        for place in places(layout)? {
            let names = identifiers();
            let name = names.iter().find(|(_, identifier)| *identifier == place.identifier);
            let (name, _) = name.context("an identifier without a name")?;
            let class = class_name(place.object);
            let _ = writeln!(text, "            Place({class}, Identifier.{name}, {}),", place.bytes.start);
        }
        text += "        ),\n    ),\n";
    }
    Ok(text + "}\n")
}

fn constants() -> String {
    let mut text = String::new();
    for (name, algorithm) in [("FRAME", crc::FRAME), ("POSITION", crc::POSITION)] {
        let (poly, init, xorout, check) = (algorithm.poly, algorithm.init, algorithm.xorout, algorithm.check);
        let _ =
            writeln!(text, "{name} = Crc(0x{poly:08X}, init=0x{init:08X}, xorout=0x{xorout:08X}, check=0x{check:08X})");
    }
    let numbers = [
        ("CYCLE_MS", u64::from(profile::CYCLE_MS), "the cycle of HORUS: each timestamp is a multiple later"),
        ("PREFIX_BYTES", image::GPS as u64, "Link-Status and Reported-Position"),
        ("PAYLOAD_BYTES", Uplink::PAYLOAD as u64, "what an uplink carries"),
        ("AGE_LIMIT_US", Config::AGE_LIMIT_US.into(), "a position older than this is not shown"),
        ("SILENCE_US", Config::SILENCE_US.into(), "so long without anything intact, and the DPR is silent"),
        ("MAX_MISSED", client::MAX_MISSED.into(), "cycles between two samples in sequence"),
        ("SEARCH_CYCLES", client::SEARCH_CYCLES.into(), "so many samples in sequence before one is shown"),
        ("TOLERANCE_US", client::TOLERANCE_US.into(), "a sample may be read so much too early or too late"),
        ("TOLERANCE_SHARE", client::TOLERANCE_SHARE.into(), "and by one part in so many of the step"),
        ("EXPIRY_US", client::EXPIRY_US.into(), "the DPR does not show an image for longer than this"),
        (
            "HOLD_COMMAND_BYTES",
            hold::COMMAND_SIZE as u64,
            "a command to the hold, the beginning of an uplink's payload",
        ),
        ("HOLD_EXPIRY_US", 1_000 * u64::from(hold::EXPIRY_MS), "the DPR does not show Hold-Status for longer"),
        ("HOLD_FRAME_US", client::HOLD_FRAME_US.into(), "the age of Hold-Status when the DPR gets it"),
        ("AGE_STEP_MS", GpsStatus::AGE_STEP_MS.into(), "the step of the age of a receiver's solution"),
        ("AGE_NEVER", json::never().into(), "the code of that age: there was no solution since HORUS's start"),
    ];
    for (name, value, what) in numbers {
        let _ = writeln!(text, "#: {what}\n{name} = {value}");
    }
    let limits = [
        ("MAX_LATITUDE", range::MAX_LATITUDE, "degrees north and south"),
        ("MAX_LONGITUDE", range::MAX_LONGITUDE, "degrees east and west"),
        ("MIN_ALTITUDE", range::MIN_ALTITUDE, "m above the ellipsoid"),
        ("MAX_ALTITUDE", range::MAX_ALTITUDE, "m above the ellipsoid"),
    ];
    for (name, value, what) in limits {
        let _ = writeln!(text, "#: {what}\n{name} = {value:?}");
    }
    text
}

fn camel(name: &str) -> String {
    name.split('_').fold(String::new(), |text, part| {
        let (first, rest) = part.split_at(part.len().min(1));
        text + &first.to_uppercase() + rest
    })
}

fn class_name(object: &str) -> String {
    match object {
        "reported" => "ReportedPosition".to_owned(),
        "command" => "CommandObject".to_owned(),
        name => camel(name),
    }
}

fn enumeration<'a>(name: &str, title: &str, values: impl Iterator<Item = (&'a str, u32, &'a str)>) -> String {
    let mut text = format!("\n\nclass {name}(IntEnum):\n    \"\"\"{title}\"\"\"\n\n");
    for (value, number, what) in values {
        // A name in Python must not begin with a digit.
        let value =
            if value.starts_with(|first: char| first.is_ascii_digit()) { format!("FIX_{value}") } else { value.into() };
        let comment = if what.is_empty() { String::new() } else { format!("  #: {what}") };
        let number = if number > 0xFF { format!("0x{number:X}") } else { number.to_string() };
        let _ = writeln!(text, "    {value} = {number}{comment}");
    }
    text
}

fn word_name(prefix: &str) -> String {
    camel(&prefix.to_lowercase()) + "Bits"
}

fn status_word(word: &Word) -> String {
    let Word { prefix, title, used, bits } = word;
    let mut text = format!("\n\nclass {}(Word):\n    \"\"\"Status of {title}.\"\"\"\n\n", word_name(prefix));
    let _ = writeln!(text, "    USED: ClassVar[int] = 0x{used:04X}");
    for Bits { name, mask, .. } in bits {
        let _ = writeln!(text, "    {name}: ClassVar[int] = 0x{mask:04X}");
    }
    for Bits { name, mask, what, code } in bits {
        let property = name.to_lowercase();
        let shift = mask.trailing_zeros();
        let (kind, value) = match code {
            None => ("bool".to_owned(), format!("bool(self & self.{name})")),
            Some(Code::Number) => ("int".to_owned(), format!("(self & self.{name}) >> {shift}")),
            Some(Code::Enumeration(codes)) => {
                let codes = camel(codes);
                (format!("Optional[{codes}]"), format!("self._code({codes}, self.{name})"))
            }
            Some(Code::Age) => ("Optional[int]".to_owned(), format!("self._age(self.{name}, AGE_STEP_MS, AGE_NEVER)")),
        };
        let note = match code {
            Some(Code::Enumeration(_)) => "; None if the code is reserved",
            Some(Code::Age) => ", ms; None if there never was one",
            Some(Code::Number) | None => "",
        };
        let _ = writeln!(text, "\n    @property\n    def {property}(self) -> {kind}:");
        let _ = writeln!(text, "        \"\"\"{what}{note}\"\"\"\n        return {value}");
    }
    text
}

fn types(field: &Field) -> (&'static str, usize, String) {
    let bytes = field.place.len();
    match field.kind {
        Kind::U16 | Kind::Identifier => ("<u2", 1, "int".into()),
        Kind::Status("") => ("<u2", 1, "int".into()),
        Kind::Status(prefix) => ("<u2", 1, word_name(prefix)),
        Kind::U32 | Kind::Word => ("<u4", 1, "int".into()),
        Kind::F32 => ("<f4", 1, "float".into()),
        Kind::F64 => ("<f8", 1, "float".into()),
        Kind::Axes => ("<f4", 3, "Tuple[float, float, float]".into()),
        Kind::Acknowledged => ("<u2", bytes / 2, "Tuple[int, int, int, int]".into()),
        Kind::Counts => ("<u2", bytes / 2, "Tuple[int, ...]".into()),
        Kind::Bytes | Kind::Zero => ("u1", bytes, "bytes".into()),
        Kind::Crc { .. } => (">u4", 1, "int".into()),
    }
}

fn class(object: &Object) -> String {
    let Object { name, title, identifiers, size, fields, .. } = object;
    let mut text = format!("\n\n@dataclass(frozen=True)\nclass {}(Object):\n", class_name(name));
    let _ = writeln!(text, "    \"\"\"{title}, {size} bytes.\"\"\"\n\n    SIZE: ClassVar[int] = {size}");
    let list = |items: &[String]| {
        if items.len() == 1 { format!("({},)", items[0]) } else { format!("({})", items.join(", ")) }
    };
    let values: Vec<_> = identifiers.iter().map(|identifier| format!("0x{:04X}", identifier.0)).collect();
    let _ = writeln!(text, "    IDENTIFIERS: ClassVar[Tuple[int, ...]] = {}", list(&values));
    for field in fields {
        match field.kind {
            Kind::Status(prefix) if !prefix.is_empty() => {
                let _ = writeln!(text, "    BITS: ClassVar[Optional[Type[Word]]] = {}", word_name(prefix));
            }
            _ => {}
        }
    }
    text += "    FIELDS: ClassVar[Tuple[Field, ...]] = (\n";
    for field in fields {
        let (numpy, count, _) = types(field);
        let _ = writeln!(text, "        Field(\"{}\", \"{numpy}\", {count}, \"{}\"),", field.name, field.unit);
    }
    text += "    )\n    CRCS: ClassVar[Tuple[Tuple[str, Crc, int, int], ...]] = (\n";
    for field in fields {
        if let Kind::Crc { name, from } = field.kind {
            let end = field.place.start;
            let _ = writeln!(text, "        (\"{}\", {}, {from}, {end}),", field.name, name.to_uppercase());
        }
    }
    text += "    )\n\n";
    for field in fields {
        let (_, _, kind) = types(field);
        let comment = if field.what.is_empty() { String::new() } else { format!("  #: {}", field.what) };
        let _ = writeln!(text, "    {}: {kind}{comment}", field.name);
    }
    text
}
