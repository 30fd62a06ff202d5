//! The C header of the flight controller's client, generated from the layouts of `profile`.
//!
//! cbindgen cannot read these objects: they are arrays of bytes with private fields, and a macro defines their status
//! words. So this generator makes `profile` seal each object with a value that occurs in one field only, and searches
//! for the value's bytes. Nothing is generated unless fields fill their object and bits their status word, so a new
//! field or bit in Rust cannot be missing from the header.
//!
//! `profile/c/horus_dpr.h` is `template.h` with the measured values inserted. `profile/c/horus_dpr_crc.h` has the
//! tables of the two CRCs.

pub(crate) mod objects;
pub(crate) mod status;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use clap::Args;
use profile::criticality::{BaseStation, FlightController};
use profile::map::PortArea;
use profile::ssi::{self, client, client::Config, timing};
use profile::{Command, HoldObject, Identifier, Layout, Uplink, Violation, crc, hold, image, range};

/// The options of a command that writes generated files.
#[derive(Args)]
pub(crate) struct GeneratedArgs {
    /// Write nothing; fail if a file is not current.
    #[arg(long)]
    check: bool,
}

impl GeneratedArgs {
    /// Writes the files of `cargo xtask COMMAND`, or checks that they are current.
    pub(crate) fn apply(&self, command: &str, files: &[(PathBuf, String)]) -> Result<ExitCode> {
        for (path, text) in files {
            if self.check {
                check_one(command, path, text)?;
            } else {
                std::fs::write(path, text).with_context(|| format!("could not write {}", path.display()))?;
                println!("{}", path.display());
            }
        }
        Ok(ExitCode::SUCCESS)
    }
}

pub(crate) fn header(args: &GeneratedArgs) -> Result<ExitCode> {
    args.apply("header", &files()?)
}

pub(crate) fn check() -> Result<()> {
    files()?.iter().try_for_each(|(path, text)| check_one("header", path, text))
}

pub(crate) fn check_one(command: &str, path: &Path, text: &str) -> Result<()> {
    let found = std::fs::read_to_string(path).with_context(|| format!("could not read {}", path.display()))?;
    ensure!(found == text, "{} is not what the layouts say: run `cargo xtask {command}`", path.display());
    Ok(())
}

fn files() -> Result<[(PathBuf, String); 2]> {
    let folder = crate::workspace::root().join("profile/c");
    Ok([(folder.join("horus_dpr.h"), client_header()?), (folder.join("horus_dpr_crc.h"), crc_header())])
}

fn client_header() -> Result<String> {
    let mut text = include_str!("header/template.h").to_owned();
    let parts = [
        ("constants", constants()),
        ("layouts", layouts()),
        ("wire", objects::structs()?),
        ("status", status::definitions()?),
        ("verdicts", status::verdicts().definition()),
        ("hold", status::hold_shown().definition()),
    ];
    for (name, part) in parts {
        let mark = format!("@{name}@\n");
        ensure!(text.matches(&mark).count() == 1, "the template has no single {name}");
        text = text.replace(&mark, &part);
    }
    Ok(text)
}

fn defines(lines: &[(String, String, impl AsRef<str>)]) -> String {
    let name = lines.iter().map(|(name, _, _)| name.len()).max().unwrap_or(0);
    let value = lines.iter().map(|(_, value, _)| value.len()).max().unwrap_or(0);
    lines.iter().fold(String::new(), |mut text, (define, number, what)| {
        let _ = writeln!(text, "#define {define:name$} {number:value$} /* {} */", what.as_ref());
        text
    })
}

fn constants() -> String {
    let number = |name: &str, value: u64, what| (format!("HORUS_DPR_{name}"), format!("{value}U"), what);
    let hex =
        |name: &str, value: u32, what| (format!("HORUS_DPR_{name}"), format!("{value:#X}U").replace("0X", "0x"), what);
    let size = |name: &str, value: usize, what| number(name, value as u64, what);
    let port = Layout::ALL[0].port_status().start;
    let in_port = |start: usize| start - port;
    let step_ms = profile::CYCLE_MS * (1 + client::MAX_MISSED);
    let mut text = defines(&[(
        "HORUS_DPR_VERSION".into(),
        format!(
            "{}U",
            env!("CARGO_PKG_VERSION")
                .split('.')
                .fold(0, |all, part| all * 1_000 + part.parse::<u32>().expect("a number"))
        ),
        "major, minor and patch, three digits each; horus_dpr.c is of the same",
    )]);
    text += "\n/* Bytes. */\n";
    text += &defines(&[
        size("REQUEST_BYTES", ssi::REQUEST_SIZE, "a request"),
        size("OBJECT_BYTES", Uplink::SIZE, "an uplink or a command"),
        size("PAYLOAD_BYTES", Uplink::PAYLOAD, "what an uplink carries"),
        size("RESERVED_BYTES", objects::COMMAND_RESERVED, "what a command reserves, zero"),
        size("MAX_WRITE", client::MAX_WRITE, "the longest MOSI that says something"),
        number("PREFIX_BYTES", client::PREFIX_BYTES.into(), "Link-Status and Reported-Position"),
        size("GPS_BYTES", profile::GpsObject::SIZE, "a receiver's object"),
        size("PORT_BYTES", PortArea::SIZE, "Port-Status and both uplinks"),
        size("HOLD_BYTES", HoldObject::SIZE, "the object of an active hold, behind them where there is one"),
        size("HOLD_COMMAND_BYTES", hold::COMMAND_SIZE, "a command to it, the beginning of an uplink's payload"),
        size("MAX_MAP_BYTES", client::MAX_MAP, "the longest map, that of five receivers with a hold"),
    ]);
    text += "\n/* Offsets in the map. */\n";
    text += &defines(&[
        size("LINK_STATUS_OFFSET", image::LINK_STATUS, "Link-Status"),
        size("REPORTED_POSITION_OFFSET", image::REPORTED_POSITION, "Reported-Position"),
        size("GPS_OFFSET", image::GPS, "GPS1; the others follow"),
    ]);
    text += "\n/* Offsets behind the image. */\n";
    text += &defines(&[
        size("PORT_STATUS_OFFSET", in_port(port), "Port-Status"),
        size(
            "UPLINK_BASE_STATION_OFFSET",
            in_port(Layout::ALL[0].uplink::<BaseStation>().start),
            "the base station's uplink, as stored",
        ),
        size(
            "UPLINK_FLIGHT_CONTROLLER_OFFSET",
            in_port(Layout::ALL[0].uplink::<FlightController>().start),
            "the flight controller's uplink, as stored",
        ),
        size(
            "HOLD_OFFSET",
            in_port(Layout::ALL[0].with_hold().hold().expect("the hold's").start),
            "the hold's object, where there is a hold",
        ),
    ]);
    text += "\n/* Identifiers. */\n";
    let id = |name: &str, identifier: Identifier, what| hex(&format!("ID_{name}"), identifier.0.into(), what);
    text += &defines(&[
        id("REPORTED_POSITION", Identifier::REPORTED_POSITION, "Reported-Position; GPS1 to GPS5 are 1 to 5 more"),
        id("LINK_STATUS", Identifier::LINK_STATUS, "Link-Status"),
        id("PORT_STATUS", Identifier::PORT_STATUS, "Port-Status"),
        id("UPLINK_BASE_STATION", Identifier::UPLINK_BASE_STATION, "uplink of the base station"),
        id("UPLINK_FLIGHT_CONTROLLER", Identifier::UPLINK_FLIGHT_CONTROLLER, "uplink of the flight controller"),
        id("COMMAND", Identifier::COMMAND, "command of the flight controller to the DPR"),
        id("HOLD_STATUS", Identifier::HOLD_STATUS, "Hold-Status; other makers' holds have up to 255 more"),
    ]);
    text += "\n/* Commands. */\n";
    text += &defines(&Command::ALL.map(|command| {
        let (name, what) = status::command(command);
        hex(&format!("COMMAND_{name}"), command.word(), what)
    }));
    text += "\n/* Words of commands to the hold; 0 is none. */\n";
    text +=
        &defines(&status::hold_words().map(|(name, word, what)| number(&format!("HOLD_{name}"), word.into(), what)));
    text += "\n/* Limits of the client, unless its configuration sets others. */\n";
    text += &defines(&[
        number("AGE_LIMIT_US", Config::AGE_LIMIT_US.into(), "a position older than this is not shown"),
        number("SILENCE_US", Config::SILENCE_US.into(), "so long without anything intact, and the DPR is silent"),
    ]);
    text += "\n/* Bounds that cannot be set. */\n";
    text += &defines(&[
        number("CYCLE_MS", profile::CYCLE_MS.into(), "the cycle of HORUS: each timestamp is a multiple later"),
        number("MAX_STEP_MS", step_ms.into(), "the longest step of timestamps in sequence"),
        number("SEARCH_CYCLES", client::SEARCH_CYCLES.into(), "so many samples in sequence before one is shown"),
        number("TOLERANCE_US", client::TOLERANCE_US.into(), "a sample may be read so much too early or too late"),
        number("TOLERANCE_SHARE", client::TOLERANCE_SHARE.into(), "and by one part in so many of the step"),
        number("EXPIRY_US", client::EXPIRY_US.into(), "the DPR does not show an image for longer than this"),
        number("UPLINK_EXPIRY_MS", Uplink::EXPIRY_MS.into(), "the DPR does not show an uplink for longer than this"),
        number("HOLD_EXPIRY_US", 1_000 * u64::from(hold::EXPIRY_MS), "the DPR does not show Hold-Status for longer"),
        number("HOLD_FRAME_US", client::HOLD_FRAME_US.into(), "the age of Hold-Status when the DPR gets it"),
        ("HORUS_DPR_AGE_UNKNOWN".into(), "UINT32_MAX".into(), "no sample yet, or its age cannot be told"),
        ("HORUS_DPR_NO_FRESH".into(), "UINT64_MAX".into(), "the FRESH line is not wired"),
    ]);
    text += "\n/* Limits of a position, as the bits of their doubles, in the numbers' order; NaN is above. */\n";
    let bits = |name: &str, limit: f64, what| {
        (format!("HORUS_DPR_{name}_BITS"), format!("0x{:016X}U", limit.abs().to_bits()), what)
    };
    text += &defines(&[
        bits("MAX_LATITUDE", range::MAX_LATITUDE, "degrees north and south"),
        bits("MAX_LONGITUDE", range::MAX_LONGITUDE, "degrees east and west"),
        bits("MIN_ALTITUDE", range::MIN_ALTITUDE, "m below the ellipsoid"),
        bits("MAX_ALTITUDE", range::MAX_ALTITUDE, "m above the ellipsoid"),
    ]);
    text += "\n/* The wire, at the DPR's pins; see docs/hardware.md for isolators. */\n";
    text += &defines(&[
        number("MAX_CLOCK_HZ", timing::MAX_CLOCK_HZ.into(), "SCK at most"),
        number("CSN_SETUP_NS", timing::CSN_SETUP_NS.into(), "CSN falls to first SCK edge at least"),
        number("CSN_HOLD_NS", timing::CSN_HOLD_NS.into(), "last SCK edge to CSN rises at least"),
        number("GAP_NS", timing::GAP_NS.into(), "CSN rises to CSN falls at least"),
    ]);
    text += "\n/* Registers of the CRCs after an intact object, before the final XOR. */\n";
    text += &defines(&[
        hex("FRAME_RESIDUE", crc::FRAME_RESIDUE, "frame CRC"),
        hex("POSITION_RESIDUE", crc::POSITION_RESIDUE, "CRC over latitude and longitude"),
    ]);
    text += "\n/* Access violations by kind: places in horus_dpr_port_t.violations. */\n";
    text += &defines(&Violation::ALL.map(|kind| {
        let (name, what) = status::violation(kind);
        let place = (kind.place().start - Violation::ALL[0].place().start) / 2;
        number(&format!("VIOLATION_{name}"), place as u64, what)
    }));
    text += &defines(&[size("VIOLATIONS", Violation::ALL.len(), "kinds")]);
    text += "\n";
    text
}

fn layouts() -> String {
    Layout::ALL.iter().fold(String::new(), |mut text, layout| {
        let n = layout.receivers();
        let assert = |expression: String, value: usize| {
            format!("HORUS_DPR_ASSERT({expression} == {value}U, \"layout of {n} receivers\");\n")
        };
        text += &assert(format!("HORUS_DPR_IMAGE_BYTES({n}U)"), layout.image_len());
        text += &assert(format!("HORUS_DPR_MAP_BYTES({n}U)"), layout.map_len());
        text += &assert(format!("HORUS_DPR_GPS_AT({n}U)"), layout.in_image(n).expect("the last receiver's").start);
        text += &assert(format!("HORUS_DPR_PORT_STATUS_AT({n}U)"), layout.port_status().start);
        let with_hold = layout.with_hold();
        text += &assert(format!("HORUS_DPR_HOLD_AT({n}U)"), with_hold.hold().expect("the hold's").start);
        text += &assert(format!("HORUS_DPR_HOLD_AT({n}U) + HORUS_DPR_HOLD_BYTES"), with_hold.map_len());
        text
    }) + "\n"
}

fn crc_header() -> String {
    let mut text = String::from(
        "/* SPDX-License-Identifier: MIT OR Apache-2.0\n \
         *\n * Tables of the two CRC-32 of horus_dpr.c: most significant bit first, one entry for each byte.\n \
         *\n * Generated by `cargo xtask header`. Do not edit.\n */\n\
         #ifndef HORUS_DPR_CRC_H\n#define HORUS_DPR_CRC_H\n\n\
         #include <stdint.h>\n",
    );
    for (name, polynomial) in [("frame", crc::FRAME.poly), ("position", crc::POSITION.poly)] {
        let table = (0..256_u32).map(|byte| {
            (0..8).fold(byte << 24, |register, _| (register << 1) ^ if register >> 31 == 1 { polynomial } else { 0 })
        });
        let entries: Vec<_> = table.map(|entry| format!("0x{entry:08X}U")).collect();
        let _ = write!(
            text,
            "\n/* Polynomial 0x{polynomial:08X}. */\nstatic const uint32_t horus_dpr_{name}_table[256] = {{\n"
        );
        let rows: Vec<_> = entries.chunks(8).map(|row| format!("    {}", row.join(", "))).collect();
        text += &rows.join(",\n");
        text += "\n};\n";
    }
    text + "\n#endif\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_committed_header_is_what_the_layouts_say() {
        check().unwrap();
    }

    #[test]
    fn an_outdated_header_is_refused_with_the_remedy() {
        let path = crate::workspace::root().join("profile/c/horus_dpr.h");
        let error = check_one("header", &path, &client_header().unwrap().replace("GAP_NS", "GAP")).unwrap_err();
        assert!(error.to_string().contains("run `cargo xtask header`"), "{error}");
    }
}
