//! Checks that the crates which others can use build from their packages, without this workspace.

use std::fs;
use std::process::{Command, ExitCode};

use anyhow::{Context, Result, ensure};

use crate::workspace::{cargo, check, root, target_dir};

pub(crate) const PACKAGES: [&str; 12] = [
    "profile",
    "st25r3916",
    "horus-voter",
    "cortex-m4",
    "emulator-part",
    "nrf52840-part",
    "stm32f429-part",
    "emulator-node",
    "emulator-debug-port",
    "emulator-gdb",
    "emulator-trace",
    "emulator",
];

/// Packages [`PACKAGES`] and builds each from its tarball. Cargo needs publishable packages for this, so the packages
/// are made publishable in a copy of the committed files. Cargo reuses unpacked packages of an equal version, so each
/// run has a target folder of its own.
pub(crate) fn package() -> Result<ExitCode> {
    const OFF: &str = "publish = false";
    let folder = target_dir().join("package");
    let copy = folder.join("copy");
    if folder.exists() {
        fs::remove_dir_all(&folder).with_context(|| format!("could not remove {}", folder.display()))?;
    }
    check(
        "copying what is committed",
        Command::new("git").args(["clone", "--quiet", "--shared"]).arg(root()).arg(&copy),
    )?;
    let target = tempfile::tempdir_in(&folder).context("could not make a target folder")?.keep();
    let manifest = copy.join("Cargo.toml");
    let text = fs::read_to_string(&manifest).with_context(|| format!("could not read {}", manifest.display()))?;
    ensure!(text.contains(OFF), "{} does not say {OFF}", manifest.display());
    fs::write(&manifest, text.replace(OFF, "publish = true")).context("could not write the copy's manifest")?;
    let mut command = cargo();
    command.args(["package", "--allow-dirty", "--manifest-path"]).arg(&manifest);
    command.args(PACKAGES.iter().flat_map(|package| ["--package", package]));
    check("packaging", command.arg("--target-dir").arg(&target))?;
    println!("{} crates build from their packages, in {}", PACKAGES.len(), target.join("package").display());
    Ok(ExitCode::SUCCESS)
}
