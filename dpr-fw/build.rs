//! Copies the DPR's linker scripts, `memory.x` and `hot.x`, to where the linker finds them, and generates the table of
//! tasks.

use std::{env, error::Error, fs, path::PathBuf};

use firmware_common::task_table;

fn main() -> Result<(), Box<dyn Error>> {
    let out = PathBuf::from(env::var("OUT_DIR")?);
    for script in ["memory.x", "hot.x"] {
        fs::copy(script, out.join(script))?;
        println!("cargo:rerun-if-changed={script}");
    }
    println!("cargo:rustc-link-search={}", out.display());
    // The linker script that `firmware-common` writes reserves the last word of the program for the program's CRC.
    if env::var("CARGO_CFG_TARGET_OS")? == "none" {
        println!("cargo:rustc-link-arg-bins=-Tprogram_crc.x");
    }
    // The tasks of the second port have the lowest priorities, so they come last.
    let application = fs::read_to_string("src/main.rs")?;
    let (always, hold) =
        application.split_once("#[cfg(feature = \"hold\")]\n    #[task(").ok_or("no task of a hold")?;
    let hold = task_table::each_task(&format!("#[task({hold}"));
    let with_hold = env::var_os("CARGO_FEATURE_HOLD").is_some();
    fs::write(out.join("each_task.rs"), task_table::each_task(if with_hold { &application } else { always }))?;
    fs::write(out.join("each_hold_task.rs"), hold.replace("each_task", "each_hold_task"))?;
    println!("cargo:rerun-if-changed=src/main.rs");
    Ok(())
}
