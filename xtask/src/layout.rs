//! The layout of all objects: a description in JSON, a Kaitai Struct file, the Python package's module, a dissector for
//! Wireshark, and the tables of docs/design.md.
//!
//! These files and tables are made from the measurements of `header::objects` and the names of `header::status`, so
//! that a new field or bit in the Rust code is in all of them. Only the JSON Schema,
//! `python/horus_profile/layout.schema.json`, is written by hand.

mod json;
mod kaitai;
mod page;
mod python;
mod wireshark;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use profile::criticality::{BaseStation, FlightController};
use profile::{Identifier, Layout, image};

use crate::header::objects::Object;
use crate::header::{GeneratedArgs, check_one};

pub(crate) fn layout(args: &GeneratedArgs) -> Result<ExitCode> {
    args.apply("layout", &files()?)
}

pub(crate) fn check() -> Result<()> {
    files()?.iter().try_for_each(|(path, text)| check_one("layout", path, text))
}

fn files() -> Result<[(PathBuf, String); 5]> {
    let root = crate::workspace::root();
    let folder = root.join("python/horus_profile");
    let page = root.join(page::PATH);
    let text = std::fs::read_to_string(&page).with_context(|| format!("could not read {}", page.display()))?;
    Ok([
        (folder.join("layout.json"), json::description()?),
        (folder.join("profile.ksy"), kaitai::description()?),
        (folder.join("objects.py"), python::module()?),
        (root.join(wireshark::PATH), wireshark::dissector()?),
        (page, page::refreshed(&text)?),
    ])
}

struct Place {
    object: &'static str,
    identifier: Identifier,
    bytes: std::ops::Range<usize>,
}

/// Returns the objects of this layout's map, in order. Fails if there is a gap between two of them.
fn places(layout: Layout) -> Result<Vec<Place>> {
    let profile = (0..layout.objects()).map(|index| {
        let object = if index == 0 { "reported" } else { "gps" };
        Some(Place { object, identifier: Identifier::of_object(index)?, bytes: layout.in_image(index)? })
    });
    let profile: Option<Vec<_>> = profile.collect();
    let link = image::LINK_STATUS..image::REPORTED_POSITION;
    let mut places = vec![Place { object: "link_status", identifier: Identifier::LINK_STATUS, bytes: link }];
    places.extend(profile.context("a profile without one of its objects")?);
    places.extend([
        Place { object: "port_status", identifier: Identifier::PORT_STATUS, bytes: layout.port_status() },
        Place { object: "uplink", identifier: Identifier::UPLINK_BASE_STATION, bytes: layout.uplink::<BaseStation>() },
        Place {
            object: "uplink",
            identifier: Identifier::UPLINK_FLIGHT_CONTROLLER,
            bytes: layout.uplink::<FlightController>(),
        },
    ]);
    let hold = |bytes| Place { object: "hold_status", identifier: Identifier::HOLD_STATUS, bytes };
    places.extend(layout.hold().map(hold));
    let ends = std::iter::once(0).chain(places.iter().map(|place| place.bytes.end));
    let whole = ends.zip(&places).all(|(end, place)| end == place.bytes.start);
    let end = places.last().map(|place| place.bytes.end);
    ensure!(whole && end == Some(layout.map_len()), "the places of {} receivers have a gap", layout.receivers());
    Ok(places)
}

fn identifiers() -> Vec<(String, Identifier)> {
    let gps = Identifier::GPS.iter().zip(1..).map(|(identifier, receiver)| (format!("GPS{receiver}"), *identifier));
    let others = [
        ("LINK_STATUS", Identifier::LINK_STATUS),
        ("REPORTED_POSITION", Identifier::REPORTED_POSITION),
        ("PORT_STATUS", Identifier::PORT_STATUS),
        ("UPLINK_BASE_STATION", Identifier::UPLINK_BASE_STATION),
        ("UPLINK_FLIGHT_CONTROLLER", Identifier::UPLINK_FLIGHT_CONTROLLER),
        ("COMMAND", Identifier::COMMAND),
        ("HOLD_STATUS", Identifier::HOLD_STATUS),
    ];
    others.map(|(name, identifier)| (name.to_owned(), identifier)).into_iter().chain(gps).collect()
}

fn objects() -> Result<Vec<Object>> {
    let mut objects = crate::header::objects::all()?;
    objects.push(crate::header::objects::request()?);
    Ok(objects)
}

#[cfg(test)]
mod tests {
    use std::process::{Command, Stdio};

    use super::*;

    #[test]
    fn the_committed_layouts_are_what_the_types_say() {
        check().unwrap();
    }

    /// Returns the Python interpreter that has the packages `numpy` and `pymavlink`. If none is found, returns the
    /// system's.
    fn python() -> PathBuf {
        let named = std::env::var_os("PYMAVLINK_PYTHON").map(PathBuf::from);
        let own = crate::workspace::root().join("target/pymavlink/bin/python");
        let has_them = |python: &PathBuf| {
            let asked = Command::new(python).args(["-c", "import numpy, pymavlink"]).stderr(Stdio::null()).status();
            asked.is_ok_and(|status| status.success())
        };
        named.into_iter().chain([own]).find(has_them).unwrap_or_else(|| "python3".into())
    }

    #[test]
    fn the_python_package_passes_its_tests_and_plays_the_tapes() {
        let mut command = Command::new(python());
        command.current_dir(crate::workspace::root().join("python"));
        // The tests import the package of this checkout, and write no compiled files.
        command.env("PYTHONPATH", ".").env_remove("HORUS_TAPES").args(["-B", "-m", "unittest", "--verbose"]);
        let Ok(output) = command.output() else {
            let words = "not run: there is no python3 (apt-get install python3)";
            assert!(std::env::var_os("CI").is_none(), "{words}");
            eprintln!("{words}");
            return;
        };
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{text}");
        for test in ["every_tape_gives_the_recorded_output", "each_object_of_the_tapes_is_shown", "a_fresh_environment"]
        {
            assert!(text.contains(test), "{text}");
        }
        text.lines().filter(|line| line.contains("not run")).for_each(|line| eprintln!("{line}"));
    }
}
