//! Runs commands in two lanes at once, and lists the test binaries of the workspace as such commands.

use std::collections::{BTreeSet, VecDeque};
use std::io::{Read, Seek, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use serde_json::Value;

use super::Steps;
use crate::workspace::{cargo, check};

/// A command that is a step by itself.
pub(crate) struct Job {
    pub(crate) what: String,
    pub(crate) command: Command,
}

/// Runs the jobs of each lane one after the other, both lanes at once. A lane that has ended takes jobs of the second
/// lane. What a job prints comes in one piece when the job ends.
pub(crate) fn run(steps: &mut Steps, lanes: [Vec<Job>; 2]) {
    let [first, second] = lanes.map(|jobs| Mutex::new(VecDeque::from(jobs)));
    let take = |lane: &Mutex<VecDeque<Job>>| lane.lock().expect("no job panics").pop_front();
    let steps = Mutex::new(steps);
    let work = |lanes: &[&Mutex<VecDeque<Job>>]| {
        while let Some(Job { what, mut command }) = lanes.iter().find_map(|lane| take(lane)) {
            let began = Instant::now();
            let (printed, result) = printed_by(&what, &mut command);
            let mut steps = steps.lock().expect("no job panics");
            eprintln!("-- {what}");
            let written = std::io::stdout().write_all(&printed).context("could not print what a job printed");
            steps.keep(&what, began.elapsed(), result.and(written));
        }
    };
    std::thread::scope(|scope| {
        scope.spawn(|| work(&[&first, &second]));
        work(&[&second]);
    });
}

/// Runs a command to its end. What it prints goes into a file, and not into a pipe, which a process that outlives the
/// command would keep open.
fn printed_by(what: &str, command: &mut Command) -> (Vec<u8>, Result<()>) {
    let mut printed = vec![];
    let mut to_its_end = || {
        let mut file = tempfile::tempfile().context("could not make a file for the output")?;
        command.stdin(Stdio::null()).stdout(file.try_clone()?).stderr(file.try_clone()?);
        let result = check(what, command);
        file.rewind()?;
        file.read_to_end(&mut printed)?;
        result
    };
    let result = to_its_end();
    (printed, result)
}

/// Compiles tests with these arguments of `cargo test`, and returns a job for each test binary. Its environment is that
/// of `cargo test` as far as tests of this workspace look at it.
pub(super) fn binaries(args: &[&str], suffix: &str) -> Result<Vec<Job>> {
    let mut command = cargo();
    command.arg("test").args(args).args(["--no-run", "--message-format", "json-render-diagnostics"]);
    let output = command.stderr(Stdio::inherit()).output().context("cargo did not start")?;
    ensure!(output.status.success(), "cargo test --no-run failed ({})", output.status);
    listed(&String::from_utf8_lossy(&output.stdout), suffix)
}

/// Returns the jobs for what cargo says it has compiled: one JSON object a line.
fn listed(messages: &str, suffix: &str) -> Result<Vec<Job>> {
    let mut jobs = vec![];
    for message in messages.lines() {
        let message: Value = serde_json::from_str(message).context("cargo printed something that is not JSON")?;
        let text = |value: &Value| value.as_str().map(str::to_owned);
        let (Some(manifest), Some(program), true) =
            (text(&message["manifest_path"]), text(&message["executable"]), message["profile"]["test"] == true)
        else {
            continue;
        };
        let folder = Path::new(&manifest).parent().context("a manifest is in no folder")?;
        let mut command = Command::new(program);
        command.arg("--quiet").current_dir(folder).env("CARGO_MANIFEST_DIR", folder);
        jobs.push(Job { what: format!("{}{suffix}", name(&manifest, &message["target"])), command });
    }
    jobs.sort_by(|one, other| one.what.cmp(&other.what));
    Ok(jobs)
}

fn name(manifest: &str, target: &Value) -> String {
    let root = crate::workspace::root();
    let folder = Path::new(manifest).parent().unwrap_or(Path::new(""));
    let folder = folder.strip_prefix(root).unwrap_or(folder).display();
    let part = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    // A test of a library is compiled with all of its kinds.
    let kind = if part(&target["kind"][0]).ends_with("lib") { "lib".to_owned() } else { part(&target["kind"][0]) };
    format!("{folder}: {kind} {}", part(&target["name"]))
}

/// Fails if the workspace has a target with tests for the host of which there is no job.
pub(super) fn is_complete(metadata: &Value, jobs: &[Job]) -> Result<()> {
    let there: BTreeSet<&str> = jobs.iter().map(|job| job.what.as_str()).collect();
    let packages = metadata["packages"].as_array().into_iter().flatten();
    // Suites for a board are no tests of the host.
    let tested = packages.filter(|package| package["name"] != "on-target-tests").flat_map(|package| {
        let targets = package["targets"].as_array().into_iter().flatten();
        let manifest = package["manifest_path"].as_str().unwrap_or_default();
        targets.filter(|target| target["test"] == true).map(move |target| name(manifest, target))
    });
    let left_out: Vec<String> = tested.filter(|name| !there.contains(name.as_str())).collect();
    ensure!(left_out.is_empty(), "cargo compiled no tests of {}", left_out.join(", "));
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::process::ExitCode;

    use super::*;
    use crate::workspace::metadata;

    /// Returns a job for every target with tests, as cargo would list them, without compiling them.
    fn all() -> Vec<Job> {
        let metadata = metadata().unwrap();
        let mut messages = String::new();
        for package in metadata["packages"].as_array().unwrap() {
            for target in package["targets"].as_array().unwrap().iter().filter(|target| target["test"] == true) {
                let manifest = &package["manifest_path"];
                let message = serde_json::json!({
                    "manifest_path": manifest, "executable": "/", "target": target, "profile": { "test": true }
                });
                messages += &format!("{message}\n");
            }
        }
        messages += "{\"reason\":\"build-finished\",\"success\":true}\n";
        listed(&messages, "").unwrap()
    }

    #[test]
    fn a_test_binary_that_was_not_compiled_is_named() {
        let metadata = metadata().unwrap();
        let mut jobs = all();
        assert!(jobs.len() > 50);
        is_complete(&metadata, &jobs).unwrap();
        jobs.retain(|job| job.what != "base-station: test broker" && job.what != "bench: lib bench");
        let error = is_complete(&metadata, &jobs).unwrap_err().to_string();
        assert_eq!(error, "cargo compiled no tests of base-station: test broker, bench: lib bench");
    }

    #[test]
    fn jobs_of_both_lanes_run_and_failures_are_counted() {
        let folder = tempfile::tempdir().unwrap();
        let job = |what: &str, code: u8| {
            let mut command = Command::new("/bin/sh");
            command.arg("-c").arg(format!("touch {what}; exit {code}")).current_dir(folder.path());
            Job { what: what.to_owned(), command }
        };
        let mut steps = Steps::default();
        run(&mut steps, [vec![job("a", 0), job("b", 3)], vec![job("c", 101), job("d", 0), job("e", 0)]]);
        assert!(["a", "b", "c", "d", "e"].iter().all(|what| folder.path().join(what).exists()));
        assert_eq!(steps.ran, 5);
        steps.failed.sort();
        assert_eq!(steps.failed.len(), 2, "{:?}", steps.failed);
        assert!(steps.failed[0].starts_with("b: ") && steps.failed[1].starts_with("c: "), "{:?}", steps.failed);
        assert_eq!(steps.verdict("test"), ExitCode::FAILURE);
    }

    #[test]
    fn a_binary_that_cannot_start_is_a_failure() {
        let mut steps = Steps::default();
        let what = "nothing".to_owned();
        run(&mut steps, [vec![], vec![Job { what, command: Command::new("/nowhere/nothing") }]]);
        assert_eq!((steps.ran, steps.failed.len()), (1, 1));
    }
}
