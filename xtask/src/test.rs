//! Runs every test of the workspace, also after a failure, and lists the failures at the end.

pub(crate) mod jobs;

use std::path::Path;
use std::process::{Command, ExitCode};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use clap::Args;
use emulator_node::Clock;

use jobs::Job;

use crate::run::Place;
use crate::workspace::{TARGET, cargo, check, metadata};
use crate::{Image, ProbeArgs, Receivers, firmware};

#[derive(Args)]
pub(crate) struct TestArgs {
    /// The place where the on-target suites run.
    #[arg(long, value_enum, default_value_t = Place::Bench)]
    on: Place,
    /// The cost of processor time in the on-target suites on the bench: fast, optimistic or pessimistic. By default
    /// all three, one after the other.
    #[arg(long)]
    clock: Option<Clock>,
    /// Run the on-target suite of this board's image only, and no host test.
    #[arg(long, value_enum)]
    board: Option<Image>,
    /// Run the on-target suites only, and no host test.
    #[arg(long)]
    on_target: bool,
    /// Run one package's tests, or those of each test binary or file of tests of this name, and of these only those
    /// with TEST in their name.
    #[arg(long, num_args = 1..=2, value_names = ["NAME", "TEST"], conflicts_with_all = ["board", "on_target", "clock"])]
    only: Vec<String>,
    #[command(flatten)]
    probe: ProbeArgs,
}

/// The arguments of `cargo test` for all tests of the host.
const HOST: &[&str] = &["--workspace", "--features", "xtask/live,xtask/probe"];
/// The arguments for the tests of the DPR with the port of a hold. The search of interleavings is not repeated: it
/// covers the hold's tasks, and in the code that it searches only the length of a buffer depends on the feature.
const WITH_HOLD: &[&str] =
    &["--package", "dpr-fw", "--lib", "--test", "frames", "--test", "hold", "--features", "hold"];

/// The test binaries that mostly wait for other programs: browsers and a broker. They run one after the other, since
/// two browsers would disturb each other's measurements, beside those that compute.
const WAITING: [&str; 3] = ["base-station: test browser", "xtask: lib xtask", "base-station: test broker"];

/// Returns the packages that have tests called `name`: the name of a package, of a test binary or of a file of tests.
/// With each package come the arguments for `cargo test` before `--` and, if the file is part of a larger binary, the
/// module of the tests.
fn selected(metadata: &serde_json::Value, name: &str) -> Result<Vec<(Vec<String>, Option<String>)>> {
    let mut found = vec![];
    for package in metadata["packages"].as_array().into_iter().flatten() {
        let Some(of_package) = package["name"].as_str() else { continue };
        let mut args = vec!["--package".to_owned(), of_package.to_owned()];
        if of_package == "xtask" {
            args.extend(["--features".into(), "live,probe".into()]);
        }
        if of_package == name {
            return Ok(vec![(args, None)]);
        }
        for target in package["targets"].as_array().into_iter().flatten().filter(|target| target["kind"][0] == "test") {
            let (Some(binary), Some(source)) = (target["name"].as_str(), target["src_path"].as_str()) else { continue };
            let is_module = source.ends_with("tests/main.rs")
                && std::fs::read_to_string(source)?.lines().any(|line| line == format!("mod {name};"));
            if binary == name || is_module {
                let args = args.iter().cloned().chain(["--test".into(), binary.to_owned()]).collect();
                found.push((args, is_module.then(|| format!("{name}::"))));
            }
        }
    }
    ensure!(!found.is_empty(), "no package, no test binary and no file of tests is called {name}");
    Ok(found)
}

/// Runs the tests that [`selected`] selects, with both images. If `test` is given, only those run that have this text
/// in their names.
fn only(name: &str, test: Option<&String>) -> Result<ExitCode> {
    let selected = selected(&metadata()?, name)?;
    for gps in Receivers::ALL {
        firmware::build_pair(gps)?;
        firmware::build_dpr_with_hold(gps)?;
    }
    firmware::build_hold()?;
    if name == "xtask" {
        crate::web::write()?;
    }
    for (args, module) in selected {
        let cargo_test = || {
            let mut command = cargo();
            command.args(["test", "--quiet"]).args(&args).arg("--").env("LINK_IMAGES", firmware::folder());
            command.env("LINK_WEB", crate::web::folder());
            command
        };
        let mut command = cargo_test();
        match (&module, test) {
            // The test runner takes only one text as a filter. To select by module and by name, this program lists the
            // tests and passes their names.
            (Some(module), Some(test)) => {
                let listed = cargo_test().args([module, "--list"]).output().context("cargo did not start")?;
                let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
                let names = listed.lines().filter_map(|line| line.strip_suffix(": test"));
                let names: Vec<&str> = names.filter(|name| name.starts_with(module) && name.contains(test)).collect();
                ensure!(!names.is_empty(), "no test of {name} has {test} in its name");
                command.arg("--exact").args(names);
            }
            _ => {
                command.args(module).args(test);
            }
        }
        check("cargo test", &mut command)?;
    }
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
    // The build replaces the running program's file. The system would then append " (deleted)" to the path, so the path
    // is read before.
    let runner = std::env::current_exe().context("could not find out where this program is")?;
    let mut steps = Steps::default();
    let (mut waiting, mut computing) = (vec![], vec![]);
    if args.on == Place::Bench && args.board.is_none() && !args.on_target {
        // A firmware is linked on one thread. The others compile the host tests meanwhile, in a folder of their own.
        // If the compilation fails, the host tests say so.
        let compiler = std::thread::spawn(|| {
            for args in [HOST, WITH_HOLD] {
                let _ = cargo().args(["test", "--quiet", "--no-run"]).args(args).status();
            }
        });
        for gps in Receivers::ALL {
            steps.run(&format!("both images build with {gps} receivers"), || firmware::build_pair(gps).map(drop));
        }
        for gps in Receivers::ALL {
            let what = format!("the DPR's image with the port of a hold builds with {gps} receivers");
            steps.run(&what, || firmware::build_dpr_with_hold(gps).map(drop));
        }
        steps.run("the hold's image builds", || firmware::build_hold().map(drop));
        steps.run("image sizes", || match crate::size::size(Receivers::DEFAULT)? {
            code if code == ExitCode::SUCCESS => Ok(()),
            _ => anyhow::bail!("over budget"),
        });
        steps.run("the page without a server builds", || crate::web::write().map(drop));
        steps.run("host tests compile", || {
            compiler.join().expect("it does not panic");
            let (with_hold, tests) =
                (jobs::binaries(WITH_HOLD, ", with the port of a hold")?, jobs::binaries(HOST, "")?);
            jobs::is_complete(&metadata()?, &tests)?;
            let mut doctests = cargo();
            doctests.args(["test", "--quiet", "--no-fail-fast", "--doc"]).args(HOST);
            let doctests = Job { what: "examples in documentation".into(), command: doctests };
            for mut job in tests.into_iter().chain(with_hold).chain([doctests]) {
                // Tests that run both firmwares need the firmwares' folder. Without it they would be skipped, or fail
                // if CI is set.
                job.command.env("LINK_IMAGES", firmware::folder()).env("LINK_WEB", crate::web::folder());
                let waits = WAITING.contains(&job.what.as_str());
                if waits { &mut waiting } else { &mut computing }.push(job);
            }
            Ok(())
        });
        steps.run("the speed of the bench", crate::speed::check);
        steps.run("a sample of the defects", || crate::defects::sample(&runner));
    }
    crate::workspace::install(&crate::workspace::FLIP_LINK)?;
    for suite in args.board.map_or(Image::ALL.to_vec(), |suite| vec![suite]) {
        let all = vec![Some(Clock::Fast), Some(Clock::Optimistic), Some(Clock::Pessimistic)];
        let clocks = match args.on {
            Place::Hardware => vec![None],
            Place::Bench => args.clock.map_or(all, |clock| vec![Some(clock)]),
        };
        for clock in clocks {
            let clock_words = clock.map_or(String::new(), |clock| format!(", {clock} clock"));
            let what = format!("on-target suite of {}{clock_words}", suite.name());
            let mut command = on_target(&runner, suite, clock, &args.probe)?;
            // A suite alone prints while it runs.
            if computing.is_empty() {
                steps.run(&what, || check("the suite", &mut command));
            } else {
                waiting.push(Job { what, command });
            }
        }
    }
    jobs::run(&mut steps, [waiting, computing]);
    Ok(steps.verdict("test"))
}

/// Returns the command that runs the defmt-test suite of one image: on the bench with `clock`, for which the suite is
/// built because its bounds depend on the clock, or on the real board without a clock. `runner` is the path of this
/// program.
fn on_target(runner: &Path, suite: Image, clock: Option<Clock>, probe: &ProbeArgs) -> Result<Command> {
    let runner = runner.to_str().with_context(|| format!("{} is not Unicode", runner.display()))?;
    let mut runner = vec![runner.to_owned(), "run".into(), "--board".into(), suite.board().name().into()];
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
            suite.name(),
            "--release",
            "--target",
            TARGET,
            "--features",
            suite.name(),
        ])
        // The runner is given as a list, because its path may contain a space. JSON and TOML write such a list in the
        // same way.
        .arg("--config")
        .arg(format!("target.{TARGET}.runner={}", serde_json::to_string(&runner)?));
    match clock {
        Some(clock) => command.env("ON_TARGET_CLOCK", clock.to_string()),
        None => command.env_remove("ON_TARGET_CLOCK"),
    };
    Ok(command)
}

/// The steps of a command that goes on after a failure.
#[derive(Default)]
pub(crate) struct Steps {
    ran: usize,
    failed: Vec<String>,
}

impl Steps {
    /// Runs a step, tells how long it took if that was long, and keeps its failure for the verdict.
    pub(crate) fn run(&mut self, what: &str, step: impl FnOnce() -> Result<()>) {
        eprintln!("-- {what}");
        let began = Instant::now();
        let result = step();
        self.keep(what, began.elapsed(), result);
    }

    /// Keeps what came of a step that has run.
    fn keep(&mut self, what: &str, took: Duration, result: Result<()>) {
        if let Err(error) = result {
            self.failed.push(format!("{what}: {error:#}"));
        }
        self.ran += 1;
        let seconds = took.as_secs();
        if seconds >= 5 {
            eprintln!("   took {seconds} s");
        }
    }

    /// Prints the failed steps and the counts of the command `name`, and returns its exit code.
    pub(crate) fn verdict(self, name: &str) -> ExitCode {
        for failure in &self.failed {
            eprintln!("FAILED {failure}");
        }
        println!("{name}: {} passed, {} failed", self.ran - self.failed.len(), self.failed.len());
        if self.failed.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn with_a_hold_all_tests_of_the_dpr_run_but_the_interleavings() {
        let metadata = metadata().unwrap();
        let dpr = metadata["packages"].as_array().unwrap().iter().find(|package| package["name"] == "dpr-fw").unwrap();
        let targets = dpr["targets"].as_array().unwrap().iter().filter(|target| target["kind"][0] == "test");
        let names = targets.map(|target| target["name"].as_str().unwrap());
        let left_out: Vec<_> = names.filter(|name| !WITH_HOLD.contains(name)).collect();
        assert_eq!(left_out, ["interleavings"]);
    }

    /// What the interleavings search must be the same with a hold and without, since it is searched without one only.
    #[test]
    fn what_the_interleavings_search_depends_on_the_hold_in_one_length() {
        let sources = crate::workspace::root().join("dpr-fw/src");
        let mut files = ["rf.rs", "intake.rs"].map(|file| sources.join(file)).to_vec();
        for folder in ["triple", "publish", "hold", "intake"] {
            files.extend(std::fs::read_dir(sources.join(folder)).unwrap().map(|file| file.unwrap().path()));
        }
        let texts = files.iter().filter(|file| !file.ends_with("tests.rs")).map(std::fs::read_to_string);
        let texts: Vec<String> = texts.collect::<Result<_, _>>().unwrap();
        let depend: Vec<&str> =
            texts.iter().flat_map(|text| text.lines()).filter(|line| line.contains("\"hold\"")).collect();
        assert_eq!(depend, ["pub const SHOWN: usize = if cfg!(feature = \"hold\") { HoldObject::SIZE } else { 0 };"]);
    }

    #[test]
    fn a_name_selects_a_package_a_binary_or_a_file() {
        let metadata = metadata().unwrap();
        let args = |name| {
            let selected = selected(&metadata, name).unwrap();
            let texts =
                selected.into_iter().map(|(args, module)| format!("{} {}", args.join(" "), module.unwrap_or_default()));
            texts.collect::<Vec<_>>()
        };
        assert_eq!(args("profile"), ["--package profile "]);
        assert_eq!(args("broker"), ["--package base-station --test broker "]);
        assert_eq!(args("phases"), ["--package bench --test all phases::"]);
        assert_eq!(args("violations"), ["--package bench --test all violations::"]);
        let mut hang = args("hang");
        hang.sort();
        assert_eq!(hang, ["--package bench --test all hang::", "--package bench-judge --test all hang::"]);
        assert_eq!(args("xtask"), ["--package xtask --features live,probe "]);
        let error = selected(&metadata, "nothing").unwrap_err().to_string();
        assert_eq!(error, "no package, no test binary and no file of tests is called nothing");
    }
}
