//! Runs every test of the workspace, also after a failure, and lists the failures at the end.

use std::path::Path;
use std::process::{Command, ExitCode};

use anyhow::{Context, Result, ensure};
use clap::Args;
use emulator_node::Clock;

use crate::run::Place;
use crate::workspace::{TARGET, cargo, check, metadata};
use crate::{Board, ProbeArgs, Receivers, firmware};

#[derive(Args)]
pub(crate) struct TestArgs {
    /// The place where the on-target suites run.
    #[arg(long, value_enum, default_value_t = Place::Bench)]
    on: Place,
    /// The cost of processor time in the on-target suites on the bench: fast, optimistic or pessimistic. By default
    /// fast and pessimistic, one after the other.
    #[arg(long)]
    clock: Option<Clock>,
    /// Run the on-target suite of this board only, and no host test.
    #[arg(long, value_enum)]
    board: Option<Board>,
    /// Run the on-target suites only, and no host test.
    #[arg(long)]
    on_target: bool,
    /// Run one package's tests, or those of each test binary of this name, and of these only those with TEST in their
    /// name.
    #[arg(long, num_args = 1..=2, value_names = ["NAME", "TEST"], conflicts_with_all = ["board", "on_target", "clock"])]
    only: Vec<String>,
    #[command(flatten)]
    probe: ProbeArgs,
}

/// The arguments of `cargo test` that select the package called `name`, or all test binaries of that name.
fn selected(metadata: &serde_json::Value, name: &str) -> Result<Vec<String>> {
    let packages: Vec<_> = metadata["packages"].as_array().into_iter().flatten().collect();
    let called = |value: &serde_json::Value| value["name"] == name;
    let is_test = |target: &serde_json::Value| target["kind"][0] == "test" && called(target);
    let has_test = |package: &&&serde_json::Value| package["targets"].as_array().into_iter().flatten().any(is_test);
    let package = packages.iter().find(|package| called(package));
    let of_tests: Vec<_> = packages.iter().filter(has_test).collect();
    ensure!(package.is_some() || !of_tests.is_empty(), "no package and no test binary is called {name}");
    let chosen: Vec<_> = package.map_or(of_tests, |package| vec![package]);
    let names = chosen.iter().filter_map(|package| package["name"].as_str());
    let mut args: Vec<String> = names.flat_map(|name| ["--package", name]).map(str::to_owned).collect();
    if package.is_none() {
        args.extend(["--test".into(), name.to_owned()]);
    }
    // A test of xtask may need code that only these features include.
    if args.iter().any(|arg| arg == "xtask") {
        args.extend(["--features".into(), "live,probe".into()]);
    }
    Ok(args)
}

/// Runs the tests that [`selected`] selects, with both firmwares built.
fn only(name: &str, test: Option<&String>) -> Result<ExitCode> {
    let args = selected(&metadata()?, name)?;
    for gps in Receivers::ALL {
        firmware::build_pair(gps)?;
    }
    let mut command = cargo();
    command.args(["test", "--quiet"]).args(args).arg("--").args(test).env("LINK_IMAGES", firmware::folder());
    check("cargo test", &mut command)?;
    Ok(ExitCode::SUCCESS)
}

pub(crate) fn test(args: &TestArgs) -> Result<ExitCode> {
    #[cfg(not(feature = "probe"))]
    if args.on == Place::Hardware {
        return crate::workspace::again_with("probe");
    }
    if let Some(name) = args.only.first() {
        return only(name, args.only.get(1));
    }
    // The path of this program is read before anything is built. The host tests are built with all features of xtask,
    // which replaces the file of the running program, and the system then reports its path with " (deleted)" appended.
    let runner = std::env::current_exe().context("could not find out where this program is")?;
    let mut ran = 0;
    let mut failed = vec![];
    let mut step = |what: &str, result: &mut dyn FnMut() -> Result<()>| {
        eprintln!("-- {what}");
        ran += 1;
        if let Err(error) = result() {
            failed.push(format!("{what}: {error:#}"));
        }
    };
    if args.on == Place::Bench && args.board.is_none() && !args.on_target {
        for gps in Receivers::ALL {
            step(&format!("both images build with {gps} receivers"), &mut || firmware::build_pair(gps).map(drop));
        }
        step("image sizes", &mut || match crate::size::size(Receivers::DEFAULT)? {
            code if code == ExitCode::SUCCESS => Ok(()),
            _ => anyhow::bail!("over budget"),
        });
        step("a sample of the defects", &mut crate::defects::sample);
        // The tests that run both firmwares are given the firmwares' folder. Without it they would not be run, and
        // would fail where CI is set.
        let images = firmware::folder();
        step("host tests", &mut || {
            let args = ["test", "--quiet", "--no-fail-fast", "--workspace", "--features", "xtask/live,xtask/probe"];
            check("cargo test", cargo().args(args).env("LINK_IMAGES", &images))
        });
    }
    for board in args.board.map_or(Board::ALL.to_vec(), |board| vec![board]) {
        if args.on == Place::Hardware {
            let what = format!("on-target suite of {}", board.name());
            step(&what, &mut || on_target(&runner, board, None, &args.probe));
            continue;
        }
        for clock in args.clock.map_or(vec![Clock::Fast, Clock::Pessimistic], |clock| vec![clock]) {
            let what = format!("on-target suite of {}, {clock} clock", board.name());
            step(&what, &mut || on_target(&runner, board, Some(clock), &args.probe));
        }
    }
    Ok(verdict("test", ran, &failed))
}

/// Runs one board's defmt-test suite, which is the same code on the bench and on the board. It is built for the clock
/// of the bench on which it runs, because its bounds depend on the clock; without a clock it is built for the board.
/// `runner` is the path of this program.
fn on_target(runner: &Path, board: Board, clock: Option<Clock>, probe: &ProbeArgs) -> Result<()> {
    crate::workspace::install(&crate::workspace::FLIP_LINK)?;
    let runner = runner.to_str().with_context(|| format!("{} is not Unicode", runner.display()))?;
    let mut runner = vec![runner.to_owned(), "run".into(), "--board".into(), board.name().into()];
    match clock {
        Some(clock) => runner.extend(["--clock".into(), clock.to_string()]),
        None => {
            runner.extend(["--on".into(), "hardware".into()]);
            if let Some(probe) = &probe.probe {
                runner.extend(["--probe".into(), probe.to_string()]);
            }
            if let Some(speed) = probe.speed {
                runner.extend(["--speed".into(), speed.to_string()]);
            }
            if probe.erase_all {
                runner.push("--erase-all".into());
            }
        }
    }
    let mut command: Command = cargo();
    command
        .args([
            "test",
            "--quiet",
            "--package",
            "on-target-tests",
            "--test",
            board.name(),
            "--release",
            "--target",
            TARGET,
            "--features",
            board.name(),
        ])
        // cargo gets its runner as a list, so that a space in the runner's path does not split it. A list of strings is
        // written alike in JSON and in TOML.
        .arg("--config")
        .arg(format!("target.{TARGET}.runner={}", serde_json::to_string(&runner)?))
        .env("DEFMT_LOG", "info");
    match clock {
        Some(clock) => command.env("ON_TARGET_CLOCK", clock.to_string()),
        None => command.env_remove("ON_TARGET_CLOCK"),
    };
    check("the suite", &mut command)
}

/// Prints which tests failed, or that none did.
pub(crate) fn verdict(name: &str, ran: usize, failed: &[String]) -> ExitCode {
    for failure in failed {
        eprintln!("FAILED {failure}");
    }
    println!("{name}: {} passed, {} failed", ran - failed.len(), failed.len());
    if failed.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_selects_its_package_or_each_test_binary_of_that_name() {
        let metadata = metadata().unwrap();
        let args = |name| selected(&metadata, name).unwrap().join(" ");
        assert_eq!(args("profile"), "--package profile");
        assert_eq!(args("phases"), "--package bench --test phases");
        let hang = args("hang");
        assert!(hang.contains("--package bench ") && hang.contains("--package bench-judge "), "{hang}");
        assert_eq!(args("xtask"), "--package xtask --features live,probe");
        let error = selected(&metadata, "nothing").unwrap_err().to_string();
        assert_eq!(error, "no package and no test binary is called nothing");
    }
}
