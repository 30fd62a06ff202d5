//! Puts this board's memory map where the linker finds it, and makes the table of the tasks.

use std::{env, error::Error, fs, path::PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::copy("memory.x", out.join("memory.x"))?;
    println!("cargo:rerun-if-changed=memory.x");
    println!("cargo:rustc-link-search={}", out.display());
    // The linker script has a place for the program's CRC behind the program; `firmware-common` writes the script.
    if env::var("CARGO_CFG_TARGET_OS")? == "none" {
        println!("cargo:rustc-link-arg-bins=-Tprogram_crc.x");
    }
    let application = fs::read_to_string("src/main.rs")?;
    fs::write(out.join("each_task.rs"), firmware_common::task_table::each_task(&application))?;
    println!("cargo:rerun-if-changed=src/main.rs");
    Ok(())
}
