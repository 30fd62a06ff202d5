//! Writes the description for Kaitai Struct, which makes parsers in eleven languages and shows the fields of a file.

use std::fmt::Write as _;

use anyhow::{Result, ensure};
use profile::{Command, Layout};

use super::{identifiers, objects};
use crate::header::objects::{Field, Kind, Object};
use crate::header::status::{self, Bits, Code, Word};

const HEAD: &str = "# SPDX-License-Identifier: MIT OR Apache-2.0
# Generated from the Rust crate `profile` by `cargo xtask layout`. Do not edit.
#
# An image of the DPR, or its whole map, by its length. Each object is a type of its own. Kaitai Struct does not verify
# the CRCs: objects that are damaged, or places that are vacant, are parsed like any others.
meta:
  id: horus_profile
  title: HORUS image or map
  license: MIT OR Apache-2.0
  endian: le
seq:
  - id: link_status
    type: link_status
  - id: reported
    type: reported
  - id: gps
    type: gps
    repeat: expr
    repeat-expr: receivers
";

const ACKNOWLEDGEMENT: &str = "  acknowledgement:
    doc: of the last command to the hold
    seq:
      - id: number
        type: u2
      - id: outcome
        type: u2
        enum: outcome
";

pub(super) fn description() -> Result<String> {
    let mut text = HEAD.to_owned();
    let [first, ..] = Layout::ALL;
    let start = first.in_image(1).map_or(0, |gps| gps.start);
    let gps = first.in_image(1).map_or(0, |gps| gps.len());
    let port = first.map_len() - first.image_len();
    for (name, kind) in [("port_status", "port_status"), ("base_station", "uplink"), ("flight_controller", "uplink")] {
        let _ = writeln!(text, "  - id: {name}\n    type: {kind}\n    if: is_map");
    }
    let _ = writeln!(text, "  - id: hold_status\n    type: hold_status\n    if: has_hold");
    let with_hold = first.with_hold().map_len() - first.image_len();
    let rests = [0, port, with_hold].map(|bytes| bytes % gps);
    ensure!(rests[0] != rests[1] && !rests[..2].contains(&rests[2]), "the length does not tell image and map");
    let behind = format!("(has_hold ? {with_hold} : is_map ? {port} : 0)");
    let instances = [
        ("is_map", format!("(_io.size - {start}) % {gps} != 0")),
        ("has_hold", format!("(_io.size - {start}) % {gps} == {}", rests[2])),
        ("receivers", format!("'(_io.size - {start} - {behind}) / {gps}'")),
    ];
    text += "instances:\n";
    for (name, value) in instances {
        let _ = writeln!(text, "  {name}:\n    value: {value}");
    }
    text += "types:\n";
    let words = status::words()?;
    for object in objects()? {
        text += &structure(&object, &words);
    }
    text += ACKNOWLEDGEMENT;
    text += "enums:\n";
    let named: Vec<_> = identifiers().iter().map(|(name, identifier)| (identifier.0.into(), name.clone())).collect();
    text += &enumeration("identifier", &named);
    let commands = Command::ALL.map(|command| (command.word(), status::command(command).0.to_owned()));
    text += &enumeration("command_word", &commands);
    for codes in status::codes() {
        let values: Vec<_> =
            codes.values.iter().map(|(name, value, _)| ((*value).into(), (*name).to_owned())).collect();
        text += &enumeration(codes.name, &values);
    }
    Ok(text)
}

fn enumeration(name: &str, values: &[(u32, String)]) -> String {
    values.iter().fold(format!("  {name}:\n"), |mut text, (value, word)| {
        // A name in Kaitai Struct must not begin with a digit.
        let digit = word.starts_with(|first: char| first.is_ascii_digit());
        let _ = writeln!(text, "    {value}: {}{}", if digit { "fix_" } else { "" }, word.to_lowercase());
        text
    })
}

fn structure(object: &Object, words: &[Word]) -> String {
    let mut text = format!("  {}:\n    doc: {}, {} bytes\n    seq:\n", object.name, object.title, object.size);
    for field in &object.fields {
        let _ = writeln!(text, "      - id: {}", field.name);
        text += &kind(field);
        if !field.what.is_empty() {
            let _ = writeln!(text, "        doc: \"{}\"", field.what);
        }
    }
    let status = object.fields.iter().find_map(|field| match field.kind {
        Kind::Status(prefix) => words.iter().find(|word| word.prefix == prefix),
        _ => None,
    });
    if let Some(word) = status {
        text += "    instances:\n";
        for Bits { name, mask, what, code } in &word.bits {
            let shift = mask.trailing_zeros();
            let value = match code {
                None => format!("(status & 0x{mask:04x}) != 0"),
                Some(_) => format!("(status & 0x{mask:04x}) >> {shift}"),
            };
            // The prefix `status_` distinguishes a bit of Port-Status from the field of the same name.
            let _ = writeln!(text, "      status_{}:\n        value: {value}", name.to_lowercase());
            if let Some(Code::Enumeration(name)) = code {
                let _ = writeln!(text, "        enum: {name}");
            }
            let _ = writeln!(text, "        doc: \"{what}\"");
        }
    }
    text
}

fn kind(field: &Field) -> String {
    let bytes = field.place.len();
    let repeated = |kind: &str, count: usize| {
        format!("        type: {kind}\n        repeat: expr\n        repeat-expr: {count}\n")
    };
    match field.kind {
        Kind::U16 | Kind::Status(_) => "        type: u2\n".into(),
        Kind::Identifier => "        type: u2\n        enum: identifier\n".into(),
        Kind::U32 => "        type: u4\n".into(),
        Kind::Word => "        type: u4\n        enum: command_word\n".into(),
        Kind::F32 => "        type: f4\n".into(),
        Kind::F64 => "        type: f8\n".into(),
        Kind::Axes => repeated("f4", 3),
        Kind::Acknowledged => repeated("acknowledgement", bytes / 4),
        Kind::Counts => repeated("u2", bytes / 2),
        Kind::Bytes | Kind::Zero => format!("        size: {bytes}\n"),
        Kind::Crc { .. } => "        type: u4be\n".into(),
    }
}
