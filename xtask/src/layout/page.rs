//! Writes the tables of docs/design.md that describe objects, map, status words and codes.
//!
//! Each table stands between `<!-- table: NAME -->` and `<!-- end -->`. The text around the tables is written by hand.

use std::fmt::Write as _;

use anyhow::{Context, Result, ensure};
use profile::{Command, Identifier, Layout, Violation};

use super::{identifiers, objects, places};
use crate::header::objects::{Field, Kind, Object};
use crate::header::status::{self, Bits, Code, Word};

pub(super) const PATH: &str = "docs/design.md";

/// Returns the page with new tables. Fails if a table is missing on the page, or is unknown.
pub(super) fn refreshed(page: &str) -> Result<String> {
    let tables = tables()?;
    let marks = page.matches("<!-- table: ").count();
    ensure!(marks == tables.len(), "{PATH} has {marks} places for the {} tables", tables.len());
    tables.into_iter().try_fold(page.to_owned(), |text, (name, table)| {
        let begin = format!("<!-- table: {name} -->\n");
        let place = || format!("{PATH} has no place for the table `{name}`");
        let (before, rest) = text.split_once(&begin).with_context(place)?;
        let (_, after) = rest.split_once("<!-- end -->").with_context(place)?;
        Ok(format!("{before}{begin}{table}<!-- end -->{after}"))
    })
}

fn tables() -> Result<Vec<(String, String)>> {
    let objects = objects()?;
    let object = |name: &str| objects.iter().find(|object| object.name == name).with_context(|| format!("no {name}"));
    let mut tables = vec![
        ("reported, gps".to_owned(), fields(&[object("reported")?, object("gps")?])),
        ("identifiers".to_owned(), identifiers_table(&objects)?),
        ("map".to_owned(), map()?),
    ];
    let others = objects.iter().filter(|object| !["reported", "gps"].contains(&object.name));
    tables.extend(others.map(|object| (object.name.to_owned(), fields(&[object]))));
    let words = status::words()?;
    let [reported, gps, others @ ..] = &words[..] else { anyhow::bail!("too few status words") };
    for words in [vec![reported, gps]].into_iter().chain(others.iter().map(|word| vec![word])) {
        let titles: Vec<_> = words.iter().map(|word| word.title).collect();
        tables.push((format!("status of {}", titles.join(", ")), bits(&words)));
    }
    for codes in status::codes() {
        let rows = codes.values.iter().map(|(name, value, what)| (value.to_string(), *name, *what));
        tables.push((codes.name.to_owned(), named("code", rows)));
    }
    let violations = (0..).zip(Violation::ALL).map(|(place, kind): (u8, _)| {
        let (name, what) = status::violation(kind);
        (place.to_string(), name, what)
    });
    tables.push(("violations".to_owned(), named("place", violations)));
    let commands = Command::ALL.map(|command| {
        let (name, what) = status::command(command);
        (format!("0x{:08X}", command.word()), name, what)
    });
    tables.push(("commands".to_owned(), named("word", commands)));
    let words = status::hold_words().map(|(name, word, what)| (word.to_string(), name, what));
    tables.push(("hold commands".to_owned(), named("word", words)));
    Ok(tables)
}

/// Returns a table of values with their names in C, Python and Wireshark.
fn named<'a>(number: &str, rows: impl IntoIterator<Item = (String, &'a str, &'a str)>) -> String {
    rows.into_iter().fold(format!("| {number} | name | meaning |\n|---|---|---|\n"), |mut text, (value, name, what)| {
        let _ = writeln!(text, "| {value} | `{name}` | {} |", symbols(what));
        text
    })
}

/// Returns the text with the symbols that this page uses for units; the comments of the C header are in ASCII.
fn symbols(text: &str) -> String {
    let text = text.replace("over all before", "over all bytes before");
    text.replace("m/s2", "m/s²").replace("100 us", "100 µs").replace("degrees Celsius", "°C")
}

/// Returns the fields of objects, beside one another.
fn fields(objects: &[&Object]) -> String {
    let mut text = String::new();
    for Object { title, size, identifiers, .. } in objects {
        let each = if identifiers.len() > 2 { " each" } else { "" };
        let _ = write!(text, "| offset | {title}, {size} bytes{each} ");
    }
    text += "|\n";
    text += &"|---".repeat(2 * objects.len());
    text += "|\n";
    for row in 0..objects.iter().map(|object| object.fields.len()).max().unwrap_or(0) {
        for object in objects {
            match object.fields.get(row) {
                Some(field) => {
                    let _ = write!(text, "| {} | {} ", field.place.start, cell(field));
                }
                None => text += "| | ",
            }
        }
        text += "|\n";
    }
    text
}

fn cell(field: &Field) -> String {
    let Field { name, place, kind, what, .. } = field;
    let each = |size| {
        let offsets: Vec<_> = place.clone().step_by(size).map(|at: usize| at.to_string()).collect();
        offsets.join(", ")
    };
    let kind = match kind {
        Kind::U16 | Kind::Identifier | Kind::Status(_) => "u16".to_owned(),
        Kind::U32 | Kind::Word => "u32".to_owned(),
        Kind::F32 => "f32".to_owned(),
        Kind::F64 => "f64".to_owned(),
        Kind::Axes => "f32".to_owned(),
        Kind::Counts => format!("{} × u16", place.len() / 2),
        Kind::Acknowledged => "2 × {u16, u16}".to_owned(),
        Kind::Bytes | Kind::Zero => format!("{} bytes", place.len()),
        Kind::Crc { .. } => "u32, big-endian,".to_owned(),
    };
    let what = match field.kind {
        Kind::Axes => format!("x, y, z ({}), {what}", each(4)),
        Kind::Crc { name, .. } => format!("{name} CRC {what}"),
        _ => (*what).to_owned(),
    };
    let says_more = !what.is_empty() && what != name.replace('_', " ");
    let colon = if says_more { format!(": {}", symbols(&what)) } else { String::new() };
    format!("{kind} `{name}`{colon}")
}

/// Returns a table of the bits of several status words, with one column for each word.
fn bits(words: &[&Word]) -> String {
    let mut text = "| bit ".to_owned();
    for word in words {
        let _ = write!(text, "| {} ", word.title);
    }
    text += "|\n";
    text += &"|---".repeat(1 + words.len());
    text += "|\n";
    for bit in 0..u16::BITS {
        let cells: Vec<_> =
            words.iter().map(|word| word.bits.iter().find(|bits| bits.mask.trailing_zeros() == bit)).collect();
        if cells.iter().all(Option::is_none) {
            continue;
        }
        let _ = write!(text, "| {bit} ");
        for cell in cells {
            let _ = write!(text, "| {}", cell.map(meaning).unwrap_or_default());
        }
        text += "|\n";
    }
    text
}

fn meaning(bits: &Bits) -> String {
    let Bits { name, mask, what, code } = bits;
    let name = name.to_lowercase();
    let last = 15 - mask.leading_zeros();
    let span = format!(" (bits {} to {last})", mask.trailing_zeros());
    let codes = match code {
        None => String::new(),
        Some(Code::Number | Code::Age) => span,
        Some(Code::Enumeration(_)) => format!("{span}, a code"),
    };
    let what = if *what == name { String::new() } else { format!(": {}", symbols(what)) };
    format!("`{name}`{what}{codes} ")
}

fn identifiers_table(objects: &[Object]) -> Result<String> {
    let mut text = "| identifier | object | who writes it |\n|---|---|---|\n".to_owned();
    let mut named = 0;
    let hex = |identifier: &Identifier| format!("0x{:04X}", identifier.0);
    for Object { title, identifiers, .. } in objects {
        named += identifiers.len();
        let rows = match identifiers {
            [Identifier::UPLINK_BASE_STATION, Identifier::UPLINK_FLIGHT_CONTROLLER] => {
                identifiers.iter().map(|identifier| (hex(identifier), *identifier)).collect()
            }
            [only] => vec![(hex(only), *only)],
            [first, .., last] => vec![(format!("{} to {}", hex(first), hex(last)), *first)],
            [] => vec![],
        };
        for (range, identifier) in rows {
            let _ = writeln!(text, "| {range} | {title} | {} |", writer(identifier)?);
        }
    }
    ensure!(named == identifiers().len(), "an identifier belongs to no object");
    Ok(text)
}

fn writer(identifier: Identifier) -> Result<&'static str> {
    Ok(match identifier {
        Identifier::REPORTED_POSITION => "HORUS",
        gps if Identifier::GPS.contains(&gps) => "HORUS",
        Identifier::LINK_STATUS | Identifier::PORT_STATUS => "DPR",
        Identifier::UPLINK_BASE_STATION => "base station, through the flight controller",
        Identifier::UPLINK_FLIGHT_CONTROLLER | Identifier::COMMAND => "flight controller",
        Identifier::HOLD_STATUS => "[active hold](#active-hold); other makers' holds use up to 0x41FF",
        other => anyhow::bail!("nobody writes {other:?}"),
    })
}

/// Returns the places of the map, with their offsets as functions of the number n of receivers.
fn map() -> Result<String> {
    let [one, .., most] = Layout::ALL.map(Layout::with_hold);
    let (first, last) = (places(one)?, places(most)?);
    let more = most.receivers() - one.receivers();
    let mut text = "| offset | object | bytes |\n|---|---|---|\n".to_owned();
    for place in &first {
        let far = last.iter().find(|far| far.identifier == place.identifier).context("a place of one layout only")?;
        let each = (far.bytes.start - place.bytes.start) / more;
        let offset = match each {
            0 => place.bytes.start.to_string(),
            each => format!("{} + {each} n", place.bytes.start - each * one.receivers()),
        };
        let (object, bytes) = match place.identifier {
            Identifier::LINK_STATUS => ("Link-Status", ""),
            Identifier::REPORTED_POSITION => ("Reported-Position", ""),
            Identifier::PORT_STATUS => ("Port-Status", ""),
            Identifier::UPLINK_BASE_STATION => ("uplink of the base station, as it was stored", ""),
            Identifier::UPLINK_FLIGHT_CONTROLLER => ("uplink of the flight controller, as it was stored", ""),
            Identifier::HOLD_STATUS => ("object of the [active hold](#the-hold-in-the-dpr), where there is one", ""),
            _ => ("GPS1 to GPSn", " each"),
        };
        let _ = writeln!(text, "| {offset} | {object} | {}{bytes} |", place.bytes.len());
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places() -> String {
        tables().unwrap().iter().map(|(name, _)| format!("<!-- table: {name} -->\noutdated\n<!-- end -->\n")).collect()
    }

    #[test]
    fn tables_are_replaced_and_the_text_around_them_stays() {
        let page = format!("before\n{}after\n", places());
        let written = refreshed(&page).unwrap();
        assert!(written.starts_with("before\n<!-- table:") && written.ends_with("<!-- end -->\nafter\n"), "{written}");
        assert!(!written.contains("outdated"));
        assert!(written.contains("| 96 + 60 n | Port-Status | 64 |"), "{written}");
        assert!(written.contains("| 0x4801 to 0x4805 | GPS1 to GPS5 | HORUS |"), "{written}");
        assert_eq!(refreshed(&written).unwrap(), written);
    }

    #[test]
    fn a_page_that_lacks_a_table_or_has_another_is_refused() {
        let without = places().replacen("<!-- table: map -->\n", "", 1);
        let error = refreshed(&without).unwrap_err().to_string();
        assert!(error.contains("places for the"), "{error}");
        let renamed = places().replacen("table: map ", "table: maps ", 1);
        let error = refreshed(&renamed).unwrap_err().to_string();
        assert_eq!(error, "docs/design.md has no place for the table `map`");
    }
}
