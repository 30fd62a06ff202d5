//! Gives the linker this firmware's own `memory.x` and the script that adds the program's CRC, and generates the table
//! of tasks. The firmwares share one target directory, so each must say which `memory.x` is its own.

use std::{env, error::Error, fs, path::PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::copy("memory.x", out.join("memory.x"))?;
    println!("cargo:rustc-link-search={}", out.display());
    // The linker script of the CRC comes from `firmware-common`. A build for the host needs no linker script.
    if env::var("CARGO_CFG_TARGET_OS")? == "none" {
        println!("cargo:rustc-link-arg-bins=-Tprogram_crc.x");
    }
    println!("cargo:rerun-if-changed=memory.x");
    println!("cargo:rerun-if-changed=build.rs");
    let application = fs::read_to_string("src/main.rs")?;
    fs::write(out.join("each_task.rs"), firmware_common::task_table::each_task(&application))?;
    println!("cargo:rerun-if-changed=src/main.rs");
    Ok(())
}
