//! Builds firmware images for the target.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::Stdio;

use anyhow::{Context, Result, bail};

use crate::workspace::{FLIP_LINK, TARGET, cargo, install, target_dir};
use crate::{Board, Receivers, seal};

/// The folder of the built firmwares. It has a subfolder for each profile with the name of the profile's cargo feature.
pub(crate) fn folder() -> PathBuf {
    target_dir().join("firmware")
}

/// Builds one board's firmware in release, writes its CRC into it, and returns the path of its ELF file. Later builds
/// for other profiles do not change that file.
pub(crate) fn build(board: Board, gps: Receivers) -> Result<PathBuf> {
    build_sealed(board.package(), &gps.feature(), &Path::new(&gps.feature()).join(board.package()))
}

/// Builds `package` with these features, writes its CRC into it, and returns the path of its ELF file, which is `kept`
/// in the folder of the built firmwares.
fn build_sealed(package: &str, features: &str, kept: &Path) -> Result<PathBuf> {
    let args = ["build", "--package", package, "--bin", package, "--no-default-features", "--features", features];
    let made = build_for_target(&args, package)?;
    let kept = folder().join(kept).with_extension("elf");
    std::fs::create_dir_all(kept.parent().unwrap_or(Path::new("."))).context("could not make the firmware folder")?;
    // The CRC is written into a copy, because cargo builds its own file again if another program has written to that
    // file.
    seal::copy_sealed(&made, &kept)?;
    Ok(kept)
}

/// Builds HORUS's firmware, the DPR's with its second port, and the hold's, and returns the paths of their ELF files.
pub(crate) fn build_with_hold(gps: Receivers) -> Result<(PathBuf, PathBuf, PathBuf)> {
    let horus = build(Board::Horus, gps)?;
    let features = format!("{},hold", gps.feature());
    let dpr = build_sealed(Board::Dpr.package(), &features, &Path::new(&gps.feature()).join("dpr-fw-hold"))?;
    Ok((horus, dpr, build_sealed("hold-fw", "", Path::new("hold-fw"))?))
}

/// Builds both boards' firmwares and returns the paths of their ELF files.
pub(crate) fn build_pair(gps: Receivers) -> Result<(PathBuf, PathBuf)> {
    Ok((build(Board::Horus, gps)?, build(Board::Dpr, gps)?))
}

/// Runs cargo for the target in release and returns the path of the executable with the given name.
pub(crate) fn build_for_target(args: &[&str], name: &str) -> Result<PathBuf> {
    install(&FLIP_LINK)?;
    let mut command = cargo();
    command
        .args(args)
        .args(["--release", "--target", TARGET, "--message-format", "json-render-diagnostics"])
        // defmt reads this environment variable when the firmware is compiled. It sets the level of the log.
        .env("DEFMT_LOG", "info")
        .stdout(Stdio::piped());
    let mut child = command.spawn().with_context(|| format!("could not start {command:?}"))?;
    let lines = BufReader::new(child.stdout.take().context("cargo has no standard output")?).lines();
    let mut executable = None;
    for line in lines {
        let message: serde_json::Value =
            serde_json::from_str(&line?).context("cargo printed something that is not JSON")?;
        if message["reason"] == "compiler-artifact"
            && message["target"]["name"] == name
            && let Some(path) = message["executable"].as_str()
        {
            executable = Some(PathBuf::from(path));
        }
    }
    if !child.wait()?.success() {
        bail!("building {name} for {TARGET} failed");
    }
    executable.with_context(|| format!("cargo built no executable called {name}"))
}
