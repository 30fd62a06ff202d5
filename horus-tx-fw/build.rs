//! Gives the linker this firmware's own `memory.x`, since two firmwares share one target directory, and the script of
//! the program's CRC. Makes the table of the tasks.

use std::{env, error::Error, fs, path::PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::copy("memory.x", out.join("memory.x"))?;
    println!("cargo:rustc-link-search={}", out.display());
    // The script is that of `firmware-common`. The host's binary needs none, since it only prints what the firmware is.
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
