//! Copies the board's memory map to where the linker finds it, and generates the table of tasks.

use std::{env, error::Error, fs, path::PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::copy("memory.x", out.join("memory.x"))?;
    println!("cargo:rerun-if-changed=memory.x");
    println!("cargo:rustc-link-search={}", out.display());
    // The linker script that `firmware-common` writes reserves the last word of the program for the program's CRC.
    if env::var("CARGO_CFG_TARGET_OS")? == "none" {
        println!("cargo:rustc-link-arg-bins=-Tprogram_crc.x");
    }
    let application = fs::read_to_string("src/main.rs")?;
    fs::write(out.join("each_task.rs"), firmware_common::task_table::each_task(&application))?;
    println!("cargo:rerun-if-changed=src/main.rs");
    Ok(())
}
