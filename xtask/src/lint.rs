//! Checks style (width, names of tests, openings of comments), citations, the C header, the layouts, the trace of
//! requirements and formatting. Then runs clippy and rustdoc with warnings as errors, for host and target, and checks
//! the dependencies if cargo-deny is installed.

use std::process::{ExitCode, Stdio};

use anyhow::{Result, ensure};

use crate::test::Steps;
use crate::test::jobs::{self, Job};
use crate::workspace::{FLIP_LINK, TARGET, cargo, install, metadata};
use crate::{Board, Image, Receivers, citations, style};

pub(crate) fn lint() -> Result<ExitCode> {
    install(&FLIP_LINK)?;
    let mut jobs: Vec<Job> = vec![];
    let mut step = |what: String, args: &[&str]| {
        let mut command = cargo();
        command.args(args);
        jobs.push(Job { what, command });
    };
    step("formatting".into(), &["fmt", "--all", "--check"]);
    for manifest in ["profile/fuzz/Cargo.toml", "base-station/fuzz/Cargo.toml"] {
        step("formatting of the fuzz targets".into(), &["fmt", "--manifest-path", manifest, "--check"]);
    }
    let host = [
        "clippy",
        "--quiet",
        "--workspace",
        "--all-targets",
        "--features",
        "xtask/live,xtask/probe",
        "--",
        "-D",
        "warnings",
    ];
    step("clippy (host)".into(), &host);
    let with_hold = ["clippy", "--quiet", "--package", "dpr-fw", "--all-targets", "--features", "hold"];
    let what = "clippy (host, the DPR with the port of a hold)";
    step(what.into(), &[&with_hold[..], &["--", "-D", "warnings"]].concat());
    for (board, more) in [(Board::Dpr, ""), (Board::Horus, ""), (Board::Dpr, ",hold")] {
        for gps in Receivers::ALL {
            let features = gps.feature() + more;
            let on_target = ["--release", "--target", TARGET, "--no-default-features", "--features"];
            let mut args = vec!["clippy", "--quiet", "--package", board.package()];
            args.extend(on_target);
            args.extend([&features, "--", "-D", "warnings"]);
            step(format!("clippy ({} for {TARGET}, {features})", board.package()), &args);
        }
    }
    let hold = ["clippy", "--quiet", "--package", "hold-fw", "--release", "--target", TARGET, "--", "-D", "warnings"];
    step(format!("clippy (hold-fw for {TARGET})"), &hold);
    // Each suite has a feature with the suite's name; the last suite fails on purpose.
    for name in Image::ALL.map(Image::name).into_iter().chain(["failing"]) {
        let args = [
            "clippy",
            "--quiet",
            "--package",
            "on-target-tests",
            "--test",
            name,
            "--release",
            "--target",
            TARGET,
            "--features",
            name,
        ];
        step(format!("clippy (on-target tests, {name})"), &[&args[..], &["--", "-D", "warnings"]].concat());
    }
    let mut documentation = cargo();
    documentation
        .args(["doc", "--quiet", "--no-deps", "--workspace", "--features", "xtask/live,xtask/probe"])
        // With the examples, the features of all dependencies are those of clippy, which has checked them already.
        .args(["--lib", "--examples"])
        .args(programs(&metadata()?))
        .env("RUSTDOCFLAGS", "-D warnings");
    jobs.push(Job { what: "documentation".into(), command: documentation });
    let mut steps = Steps::default();
    // cargo-deny takes minutes to compile and needs a network to read the list of advisories, so only `.ci/run`
    // installs it.
    if has_cargo_deny() {
        let mut command = cargo();
        command.args(["deny", "--log-level", "error", "check", "licenses", "bans", "sources"]);
        jobs.push(Job { what: "licences, duplicates and sources of the dependencies (deny.toml)".into(), command });
    } else {
        steps.run("dependencies", || {
            const WORDS: &str =
                "the dependencies were not checked: cargo-deny is not installed (cargo install cargo-deny --locked)";
            ensure!(std::env::var_os("CI").is_none(), WORDS);
            eprintln!("   {WORDS}");
            Ok(())
        });
    }
    steps.run("style", style::check);
    steps.run("citations", citations::check);
    steps.run("C header", crate::header::check);
    steps.run("layouts", crate::layout::check);
    steps.run("requirements", crate::trace::check);
    steps.run("public interfaces", crate::release::check_interfaces);
    // Cargo runs one command at a time in a folder of the target directory, and each target has its own.
    let (on_target, host) = jobs.into_iter().partition(|job| job.command.get_args().any(|arg| arg == TARGET));
    jobs::run(&mut steps, [host, on_target]);
    Ok(steps.verdict("lint"))
}

/// Returns the arguments that name each program of the workspace, except those with the same name as their library.
/// rustdoc would write both to the same folder, so cargo leaves them out by default as well.
fn programs(metadata: &serde_json::Value) -> Vec<String> {
    let packages = metadata["packages"].as_array().into_iter().flatten();
    let of_package = |package: &serde_json::Value| {
        let targets = package["targets"].as_array().into_iter().flatten();
        let of_kind = |kind| {
            let found = targets.clone().filter(move |target| target["kind"][0] == kind);
            found.filter_map(|target| Some(target["name"].as_str()?.replace('-', "_"))).collect::<Vec<_>>()
        };
        let (programs, libraries) = (of_kind("bin"), of_kind("lib"));
        programs.into_iter().filter(|name| !libraries.contains(name)).collect::<Vec<_>>()
    };
    packages.flat_map(of_package).flat_map(|name| ["--bin".to_owned(), name.replace('_', "-")]).collect()
}

fn has_cargo_deny() -> bool {
    let mut command = cargo();
    command.args(["deny", "--version"]).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}
