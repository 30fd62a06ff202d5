//! The workspace's folders, and the calls of cargo and the necessary tools.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;
#[cfg(not(all(feature = "probe", feature = "live")))]
use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};

/// The target of both microcontrollers: Cortex-M4F.
pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// A pinned tool from crates.io that xtask installs for itself under `target/tools`.
pub(crate) struct Tool {
    name: &'static str,
    version: &'static str,
}

/// The linker wrapper that puts the stack below the statics, so that an overflow faults instead of corrupting.
pub(crate) const FLIP_LINK: Tool = Tool { name: "flip-link", version: "0.1.12" };

/// The libFuzzer front end.
pub(crate) const CARGO_FUZZ: Tool = Tool { name: "cargo-fuzz", version: "0.13.2" };

/// The workspace's root folder.
pub(crate) fn root() -> PathBuf {
    // This is xtask's own folder at build time, unless the checkout has moved since: then cargo reports its present
    // place.
    let manifest =
        std::env::var_os("CARGO_MANIFEST_DIR").map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")), PathBuf::from);
    manifest.parent().map_or(manifest.clone(), Path::to_path_buf)
}

/// The files that git tracks, by their paths from the root, without those that are deleted and not committed yet.
pub(crate) fn tracked() -> Result<Vec<String>> {
    let output = Command::new("git")
        .args(["ls-files", "-z"])
        .current_dir(root())
        .output()
        .context("could not start git, which tells which files are tracked")?;
    ensure!(output.status.success(), "git ls-files failed: {}", String::from_utf8_lossy(&output.stderr).trim());
    let listed = String::from_utf8(output.stdout).context("a tracked file's name is not UTF-8")?;
    let exists = |path: &&str| !path.is_empty() && root().join(path).exists();
    Ok(listed.split('\0').filter(exists).map(str::to_owned).collect())
}

/// The folder for the output of cargo and xtask.
pub(crate) fn target_dir() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), |dir| root().join(PathBuf::from(dir)))
}

/// `cargo`, in the workspace's root, with the tools on its PATH.
pub(crate) fn cargo() -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(root()).env("PATH", path_with_tools());
    // cargo's environment variables about this process's own package must not reach the next one.
    for (key, _) in std::env::vars_os() {
        let name = key.to_string_lossy();
        if name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_") || name == "CARGO_PRIMARY_PACKAGE" {
            command.env_remove(&key);
        }
    }
    command
}

/// Runs a command to its end; its failure is an error that names it.
pub(crate) fn check(what: &str, command: &mut Command) -> Result<()> {
    let status = command.status().with_context(|| format!("{what}: could not start {command:?}"))?;
    if !status.success() {
        bail!("{what} failed ({status})");
    }
    Ok(())
}

/// Installs a pinned tool under `target/tools` unless that version is there.
pub(crate) fn install(tool: &Tool) -> Result<()> {
    let tools = tools_dir();
    let stamp = tools.join(format!(".{}-{}", tool.name, tool.version));
    if stamp.exists() {
        return Ok(());
    }
    eprintln!("installing {} {} into {}", tool.name, tool.version, tools.display());
    let mut command = cargo();
    command
        .args(["install", "--quiet", "--locked", "--force", tool.name, "--version", tool.version, "--root"])
        .arg(&tools)
        .arg("--target-dir")
        .arg(tools.join("build"));
    check(&format!("installing {}", tool.name), &mut command)?;
    std::fs::write(&stamp, "").with_context(|| format!("could not write {}", stamp.display()))
}

/// Runs this same command line again with a feature of xtask compiled in. On Unix that process replaces this one, so
/// that an interrupt from the keyboard reaches only one.
#[cfg(not(all(feature = "probe", feature = "live")))]
pub(crate) fn again_with(feature: &str) -> Result<ExitCode> {
    let mut command = cargo();
    command.args(["run", "--quiet", "--package", "xtask", "--features", feature, "--"]);
    command.args(std::env::args_os().skip(1));
    #[cfg(unix)]
    {
        use std::os::unix::process::CommandExt;
        Err(command.exec()).context("could not start cargo")
    }
    #[cfg(not(unix))]
    {
        let status = command.status().context("could not start cargo")?;
        Ok(status.code().and_then(|code| u8::try_from(code).ok()).map_or(ExitCode::FAILURE, ExitCode::from))
    }
}

fn tools_dir() -> PathBuf {
    target_dir().join("tools")
}

fn path_with_tools() -> OsString {
    let old = std::env::var_os("PATH").unwrap_or_default();
    let parts = std::iter::once(tools_dir().join("bin")).chain(std::env::split_paths(&old));
    // A PATH that cannot be joined was not usable before either.
    std::env::join_paths(parts).unwrap_or(old)
}

/// cargo's metadata of the workspace's packages.
pub(crate) fn metadata() -> Result<serde_json::Value> {
    let output = cargo()
        .args(["metadata", "--no-deps", "--format-version", "1"])
        .output()
        .context("could not start cargo metadata")?;
    serde_json::from_slice(&output.stdout).context("cargo metadata printed something that is not JSON")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_emulator_depends_on_nothing_outside_its_folder() {
        let metadata = metadata().unwrap();
        let folder = root().join("emulator");
        let is_inside = |path: &str| Path::new(path).starts_with(&folder);
        let of = |value: &serde_json::Value, key: &str| value[key].as_str().map(str::to_owned);
        let packages = metadata["packages"].as_array().unwrap();
        let inside: Vec<_> =
            packages.iter().filter(|package| is_inside(package["manifest_path"].as_str().unwrap())).collect();
        assert_eq!(inside.len(), 6);
        for package in inside {
            for dependency in package["dependencies"].as_array().unwrap() {
                let outside = of(dependency, "path").filter(|path| !is_inside(path));
                assert_eq!(outside, None, "{} must not depend on it", package["name"]);
            }
        }
    }
}
