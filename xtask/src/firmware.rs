//! Builds firmware images for the target.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::Stdio;

use anyhow::{Context, Result, bail};

use crate::workspace::{FLIP_LINK, TARGET, cargo, install, metadata, target_dir};
use crate::{Board, Receivers, seal};

pub(crate) fn folder() -> PathBuf {
    target_dir().join("firmware")
}

/// Builds one board's firmware in release with its CRC, and returns the path of its ELF file. Builds for other profiles
/// do not change that file.
pub(crate) fn build(board: Board, gps: Receivers) -> Result<PathBuf> {
    let package = board.package();
    let feature = gps.feature();
    let args = ["build", "--package", package, "--bin", package, "--no-default-features", "--features", &feature];
    keep(&build_for_target(&args, package)?, &folder().join(gps.feature()).join(package).with_extension("elf"))
}

/// Builds the DPR's firmware with the port of a hold, as [`build`] does.
pub(crate) fn build_dpr_with_hold(gps: Receivers) -> Result<PathBuf> {
    let features = format!("{},hold", gps.feature());
    let package = Board::Dpr.package();
    let args = ["build", "--package", package, "--bin", package, "--no-default-features", "--features", &features];
    keep(&build_for_target(&args, package)?, &folder().join(gps.feature()).join("dpr-fw-hold.elf"))
}

/// Builds the firmware of the hold in release, writes its CRC into it, and returns the path of its ELF file.
pub(crate) fn build_hold() -> Result<PathBuf> {
    if !has_package(HOLD)? {
        bail!("this workspace has no package {HOLD}, the firmware of the hold");
    }
    let args = ["build", "--package", HOLD, "--bin", HOLD];
    keep(&build_for_target(&args, HOLD)?, &folder().join(HOLD).with_extension("elf"))
}

/// The package of the hold's firmware, which is also its binary's name.
pub(crate) const HOLD: &str = "hold-fw";

/// Whether the workspace has a package of this name.
pub(crate) fn has_package(name: &str) -> Result<bool> {
    let metadata = metadata()?;
    let packages = metadata["packages"].as_array().context("cargo metadata lists no packages")?;
    Ok(packages.iter().any(|package| package["name"] == name))
}

/// Copies a built firmware to `kept`, and writes the CRC into the copy. Cargo would rebuild a file that another program
/// has changed.
fn keep(made: &Path, kept: &Path) -> Result<PathBuf> {
    std::fs::create_dir_all(kept.parent().unwrap_or(Path::new("."))).context("could not make the firmware folder")?;
    seal::copy_sealed(made, kept)?;
    Ok(kept.to_owned())
}

pub(crate) fn build_pair(gps: Receivers) -> Result<(PathBuf, PathBuf)> {
    Ok((build(Board::Horus, gps)?, build(Board::Dpr, gps)?))
}

/// Builds the link's firmwares and returns the paths of their ELF files: HORUS's and the DPR's. With `hold` the DPR's
/// firmware has its second port, and the path of the hold's firmware is returned as well.
pub(crate) fn build_link(gps: Receivers, hold: bool) -> Result<(PathBuf, PathBuf, Option<PathBuf>)> {
    let horus = build(Board::Horus, gps)?;
    if hold {
        return Ok((horus, build_dpr_with_hold(gps)?, Some(build_hold()?)));
    }
    Ok((horus, build(Board::Dpr, gps)?, None))
}

/// Runs cargo for the target in release and returns the path of the executable with the given name.
pub(crate) fn build_for_target(args: &[&str], name: &str) -> Result<PathBuf> {
    install(&FLIP_LINK)?;
    let mut command = cargo();
    command
        .args(args)
        .args(["--release", "--target", TARGET, "--message-format", "json-render-diagnostics"])
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
