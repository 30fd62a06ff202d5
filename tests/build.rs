//! Gives each suite its board's memory layout: the firmware's own `memory.x`.

use std::path::PathBuf;
use std::{env, fs};

fn main() {
    let board = |feature: &str| env::var_os(format!("CARGO_FEATURE_{feature}")).is_some();
    let firmware = match (board("DPR"), board("HORUS")) {
        (true, false) => "dpr-fw",
        (false, true) => "horus-tx-fw",
        // On the host no suite is built; two boards at once have no common layout.
        _ => return,
    };
    let layout = PathBuf::from("..").join(firmware).join("memory.x");
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::copy(&layout, out.join("memory.x")).unwrap_or_else(|error| panic!("{}: {error}", layout.display()));
    println!("cargo::rustc-link-search={}", out.display());
    println!("cargo::rerun-if-changed={}", layout.display());
}
