//! Builds firmware images for the target.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::Stdio;

use anyhow::{Context, Result, bail};

use crate::workspace::{FLIP_LINK, TARGET, cargo, install, target_dir};
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
    let made = build_for_target(&args, package)?;
    let kept = folder().join(gps.feature()).join(board.package()).with_extension("elf");
    std::fs::create_dir_all(kept.parent().unwrap_or(Path::new("."))).context("could not make the firmware folder")?;
    // The CRC is written into a copy, because cargo builds its own file again if another program has changed it.
    seal::copy_sealed(&made, &kept)?;
    Ok(kept)
}

pub(crate) fn build_pair(gps: Receivers) -> Result<(PathBuf, PathBuf)> {
    Ok((build(Board::Horus, gps)?, build(Board::Dpr, gps)?))
}

pub(crate) fn build_for_target(args: &[&str], name: &str) -> Result<PathBuf> {
    install(&FLIP_LINK)?;
    let mut command = cargo();
    command
        .args(args)
        .args(["--release", "--target", TARGET, "--message-format", "json-render-diagnostics"])
        // defmt reads its level from this environment variable when the firmware is compiled.
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
