//! The workspace's folders, and the calls of cargo and of the tools that xtask needs.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;
#[cfg(not(all(feature = "probe", feature = "live")))]
use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};

/// The target of both microcontrollers: Cortex-M4F.
pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

pub(crate) struct Tool {
    name: &'static str,
    version: &'static str,
}

/// The linker wrapper that puts the stack below the statics, so that an overflow leads to a fault.
pub(crate) const FLIP_LINK: Tool = Tool { name: "flip-link", version: "0.1.12" };

pub(crate) const CARGO_FUZZ: Tool = Tool { name: "cargo-fuzz", version: "0.13.2" };

pub(crate) const SEMVER_CHECKS: Tool = Tool { name: "cargo-semver-checks", version: "0.51.0" };

pub(crate) fn root() -> PathBuf {
    // Cargo states xtask's folder, whose parent is the workspace's root. Without cargo the folder at build time counts.
    let manifest =
        std::env::var_os("CARGO_MANIFEST_DIR").map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")), PathBuf::from);
    manifest.parent().map_or(manifest.clone(), Path::to_path_buf)
}

/// Returns the files that git tracks, by their paths from the root, without those that were deleted.
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

pub(crate) fn target_dir() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), |dir| root().join(PathBuf::from(dir)))
}

/// Returns the command `cargo`, which runs in the workspace's root with the installed tools on its PATH.
pub(crate) fn cargo() -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(root()).env("PATH", path_with_tools());
    // defmt's macros read the level of the log from this variable when a firmware is compiled, and cargo compiles them
    // again, with all that depends on them, where it differs.
    command.env("DEFMT_LOG", "info");
    // Cargo's variables for xtask's own package would be wrong for another package.
    for (key, _) in std::env::vars_os() {
        let name = key.to_string_lossy();
        if name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_") || name == "CARGO_PRIMARY_PACKAGE" {
            command.env_remove(&key);
        }
    }
    command
}

/// Runs a command to its end. The error of a failure has the name `what`.
pub(crate) fn check(what: &str, command: &mut Command) -> Result<()> {
    let status = command.status().with_context(|| format!("{what}: could not start {command:?}"))?;
    if !status.success() {
        bail!("{what} failed ({status})");
    }
    Ok(())
}

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

/// Runs this command line again in a binary with a further feature of xtask. On Unix that process replaces this one, so
/// that only one process receives an interrupt from the keyboard.
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
    std::env::join_paths(parts).unwrap_or(old)
}

pub(crate) fn metadata() -> Result<serde_json::Value> {
    let output = cargo()
        .args(["metadata", "--no-deps", "--format-version", "1"])
        .output()
        .context("could not start cargo metadata")?;
    serde_json::from_slice(&output.stdout).context("cargo metadata printed something that is not JSON")
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

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
        assert_eq!(inside.len(), 10);
        for package in inside {
            for dependency in package["dependencies"].as_array().unwrap() {
                let outside = of(dependency, "path").filter(|path| !is_inside(path));
                assert_eq!(outside, None, "{} must not depend on it", package["name"]);
            }
        }
    }

    fn modules(folder: &str) -> BTreeMap<Vec<String>, String> {
        let of_file = |file: String| {
            let within = file
                .strip_prefix(folder)?
                .strip_suffix(".rs")
                .filter(|within| !["tests", "testing"].iter().any(|name| within.ends_with(name)))?;
            let path = within.split('/').filter(|name| !["mod", "lib", "main"].contains(name)).map(str::to_owned);
            let text = std::fs::read_to_string(root().join(&file)).unwrap();
            let code: Vec<&str> = text.lines().map(|line| line.split("//").next().unwrap()).collect();
            Some((path.collect(), code.join("\n").split("#[cfg(test)]\nmod tests {").next().unwrap().to_owned()))
        };
        tracked().unwrap().into_iter().filter_map(of_file).collect()
    }

    /// Returns all paths in `code`. A path with braces counts once for each name in the braces.
    fn paths(code: &str) -> Vec<Vec<&str>> {
        let (mut all, mut groups, mut path, mut rest) = (vec![], vec![], vec![], code);
        while let Some(first) = rest.chars().next() {
            let name = rest.find(|letter: char| !letter.is_alphanumeric() && letter != '_').unwrap_or(rest.len());
            let (token, behind) = rest.split_at(name.max(first.len_utf8()));
            rest = behind.trim_start();
            if name > 0 {
                path.push(token);
            }
            if let Some(group) = rest.strip_prefix("::{").filter(|_| name > 0) {
                (groups, rest) = ([groups, vec![path.clone()]].concat(), group.trim_start());
            } else if let Some(more) = rest.strip_prefix("::").filter(|_| name > 0) {
                rest = more;
            } else {
                if token == "}" {
                    groups.pop();
                }
                all.push(std::mem::replace(&mut path, groups.last().cloned().unwrap_or_default()));
            }
        }
        all
    }

    /// Returns the dependencies between modules of one folder that lead into a circle. A folder counts as one module,
    /// and a module does not depend on the module that contains it.
    fn circles(modules: &BTreeMap<Vec<String>, String>) -> BTreeSet<String> {
        let mut arrows = BTreeSet::new();
        for (module, code) in modules {
            for path in paths(code).iter().filter(|path| ["crate", "super"].contains(path.first().unwrap_or(&""))) {
                let ups = path.iter().take_while(|name| **name == "super").count();
                let base = if ups == 0 { &[] } else { &module[..module.len().saturating_sub(ups)] };
                let names = path[ups.max(1)..].iter().map(|name| (*name).to_owned());
                let to: Vec<String> = base.iter().cloned().chain(names).collect();
                let same = module.iter().zip(&to).take_while(|(one, other)| one == other).count();
                if module.len() > same && to.len() > same && modules.keys().any(|it| it.starts_with(&to[..=same])) {
                    arrows.insert((module[..=same].join("::"), to[..=same].join("::")));
                }
            }
        }
        while let Some(last) = arrows.iter().find(|(_, to)| arrows.iter().all(|(from, _)| from != to)).cloned() {
            arrows.remove(&last);
        }
        arrows.into_iter().map(|(from, to)| format!("{from} > {to}")).collect()
    }

    /// Returns a line for each crate that a command with these arguments needs, with the features that it has there.
    fn with_features(args: &[&str]) -> BTreeSet<String> {
        let mut command = cargo();
        command.args(["tree", "--quiet", "--prefix", "none", "--format", "{p} [{f}]"]).args(args);
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8(output.stdout).unwrap();
        text.lines().map(|line| line.trim_end_matches(" (*)").to_owned()).collect()
    }

    #[test]
    fn crates_have_the_same_features_for_the_link_and_for_tests() {
        let of_tests = with_features(&["--workspace", "--features", "xtask/live,xtask/probe"]);
        let of_the_link = with_features(&["--package", "xtask", "--edges", "normal,build"]);
        let of_the_hold = with_features(&["--package", "dpr-fw", "--features", "hold"]);
        for (mut again, package) in [(of_the_link, "xtask "), (of_the_hold, "dpr-fw ")] {
            assert!(again.len() > 50, "{again:?}");
            again.retain(|line| !of_tests.contains(line) && !line.starts_with(package));
            assert!(again.is_empty(), "compiled again, so to be named in xtask/same-features: {again:#?}");
        }
    }

    #[test]
    fn no_modules_of_a_crate_import_each_other_in_a_circle() {
        let manifests = tracked().unwrap().into_iter().filter(|file| file.ends_with("/Cargo.toml"));
        let folders = manifests.filter_map(|file| Some(format!("{}/src/", file.strip_suffix("/Cargo.toml")?)));
        let found: Vec<_> = folders.map(|folder| (circles(&modules(&folder)), folder)).collect();
        let in_a_circle = found.iter().filter(|(circles, _)| !circles.is_empty()).collect::<Vec<_>>();
        assert!(in_a_circle.is_empty(), "{in_a_circle:#?}");
        assert!(found.len() > 20);
    }

    #[test]
    fn a_circle_is_found_through_folders_and_braces() {
        let circles_with = |last: &str| {
            let modules = [
                ("a", "use crate::{c, b::inner::{self, Thing}, Other};"),
                ("b::inner", "use super::Thing; fn f() { super::other::go() }"),
                ("b::other", "crate::c::call(); use super::super::c;"),
                ("c", last),
            ];
            let owned = |path: &str| path.split("::").map(str::to_owned).collect();
            circles(&modules.map(|(path, code)| (owned(path), code.to_owned())).into())
        };
        assert_eq!(circles_with("use core::a;"), BTreeSet::new());
        let found = ["a > b", "a > c", "b > c", "c > a"].map(str::to_owned);
        assert_eq!(circles_with("use crate::a;"), found.into());
        assert!(circles_with("use crate::b::{x::{y}, other};").contains("c > b"));
    }
}
