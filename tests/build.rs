//! Gives each suite the memory layout of its board: the firmware's own `memory.x`, and the scripts that it includes.

use std::path::PathBuf;
use std::{env, fs};

/// The changes of the firmware's linker scripts for the DPR's suite: the script, the text in it, and the text that
/// replaces it. The suite needs more room for code in RAM. Its own crates contain generic and small functions that the
/// firmware has in its library, and these have to run from RAM as in the firmware.
const CHANGES: [(&str, &str, &str); 6] = [
    ("hot.x", "__shot = .;", "__shot = .;\n    *(.text.*3dpr* .text.*15on_target_tests*);"),
    ("memory.x", "FLASH : ORIGIN = 0x00000000, LENGTH = 96K", "FLASH : ORIGIN = 0x00000000, LENGTH = 256K"),
    ("memory.x", "HOT   : ORIGIN = 0x00800000, LENGTH = 64K", "HOT   : ORIGIN = 0x00800000, LENGTH = 128K"),
    ("memory.x", "RAM   : ORIGIN = 0x20010000, LENGTH = 32K", "RAM   : ORIGIN = 0x20020000, LENGTH = 64K"),
    ("memory.x", "__ram_start = 0x20010000;", "__ram_start = 0x20020000;"),
    ("memory.x", "__ram_end = 0x20018000;", "__ram_end = 0x20030000;"),
];

fn main() {
    let board = |feature: &str| env::var_os(format!("CARGO_FEATURE_{feature}")).is_some();
    let (firmware, scripts): (_, &[_]) = match (board("DPR"), board("HORUS"), board("HOLD")) {
        (true, false, false) => ("dpr-fw", &["memory.x", "hot.x"]),
        (false, true, false) => ("horus-tx-fw", &["memory.x"]),
        (false, false, true) => ("hold-fw", &["memory.x"]),
        // No suite is built for the host, and a build for several boards at once has no common layout.
        _ => return,
    };
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    for script in scripts {
        let from = PathBuf::from("..").join(firmware).join(script);
        let mut text = fs::read_to_string(&from).unwrap_or_else(|error| panic!("{}: {error}", from.display()));
        for (there, here) in
            CHANGES.iter().filter(|(of, _, _)| board("DPR") && of == script).map(|(_, there, here)| (there, here))
        {
            assert!(text.contains(there), "{}: no `{there}`", from.display());
            text = text.replacen(there, here, 1);
        }
        fs::write(out.join(script), text).expect("cargo's folder can be written");
        println!("cargo::rerun-if-changed={}", from.display());
    }
    println!("cargo::rustc-link-search={}", out.display());
}
