//! Small changes of the sources, each of which a named test must find.
//!
//! The table is `docs/safety/mutants.md`. A row has the mutant's name, the requirements that it breaks, the file, the
//! item (a function or a constant), the text that is replaced, its replacement, and the name of the test that fails, or
//! `constant assertion`, which keeps the copy from compiling. The replaced text must occur once in the item.
//!
//! `cargo xtask trace --mutants` makes a copy of the workspace below the target folder and applies one change at a
//! time. The test must pass before, and fail with the change.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::{Context, Result, bail, ensure};

use super::{Evidence, Kind, Trace, cells, ids};
use crate::workspace::{cargo, root, target_dir, tracked};

/// The table of mutants.
pub(super) const TABLE: &str = "docs/safety/mutants.md";
/// The name of the finder of a mutant that does not compile.
const ASSERTION: &str = "constant assertion";

/// A mutant.
#[derive(Debug)]
pub(super) struct Mutant {
    pub(super) name: String,
    pub(super) breaks: Vec<String>,
    pub(super) file: String,
    item: String,
    old: String,
    new: String,
    pub(super) found_by: String,
}

impl Mutant {
    /// Reads a row of the table; `None` for any other line.
    pub(super) fn of(line: &str) -> Option<Self> {
        let row = cells(line)?.into_iter().map(|cell| cell.trim_matches('`').to_owned()).collect::<Vec<_>>();
        let [name, breaks, file, item, old, new, found_by] = <[String; 7]>::try_from(row).ok()?;
        Some(Self { breaks: ids(&format!("{breaks}."))?, name, file, item, old, new, found_by })
    }

    /// Returns whether this evidence finds the mutant.
    pub(super) fn is_found_by(&self, evidence: &Evidence) -> bool {
        match evidence.kind {
            Kind::Test => evidence.name == self.found_by,
            Kind::Assertion => self.found_by == ASSERTION,
            Kind::Rule => false,
        }
    }

    /// Returns the `text` of the file with the change.
    pub(super) fn applied(&self, text: &str) -> Result<String> {
        let Self { name, file, item, old, new, .. } = self;
        ensure!(old != new, "mutant {name} changes nothing");
        let (mut at, mut found, mut end) = (0, vec![], None::<String>);
        for line in text.split_inclusive('\n') {
            if end.is_none() && is_item(line, item) {
                end = Some(line[..line.len() - line.trim_start().len()].to_owned());
                if line.trim_end().ends_with(';') {
                    found.extend(line.match_indices(old).map(|(column, _)| at + column));
                    end = None;
                }
            }
            if let Some(indent) = &end {
                found.extend(line.match_indices(old).map(|(column, _)| at + column));
                if line
                    .strip_prefix(indent)
                    .is_some_and(|rest| rest.starts_with(['}', ']', ')']) && !rest.contains('{'))
                {
                    end = None;
                }
            }
            at += line.len();
        }
        let [place] = found[..] else {
            bail!("mutant {name}: `{item}` in {file} has to have `{old}` once, and has it {} times", found.len());
        };
        Ok(format!("{}{new}{}", &text[..place], &text[place + old.len()..]))
    }
}

/// Returns whether `line` begins the function, constant or static of this name.
fn is_item(line: &str, name: &str) -> bool {
    let named = |(before, after): (&str, &str)| {
        let own = before.split_whitespace().all(|word| word.starts_with("pub") || ["const", "unsafe"].contains(&word));
        own && after.strip_prefix(name).is_some_and(|rest| rest.starts_with(['(', '<', ':']))
    };
    ["fn ", "const ", "static "].iter().any(|kind| line.trim_start().split_once(kind).is_some_and(named))
}

/// The folder of the copy.
fn copy_folder() -> PathBuf {
    target_dir().join("mutants")
}

/// Writes a file of the copy unless it already has these contents.
fn write_changed(path: &Path, bytes: &[u8]) -> Result<()> {
    if fs::read(path).is_ok_and(|found| found == bytes) {
        return Ok(());
    }
    fs::create_dir_all(path.parent().unwrap_or(Path::new("."))).context("could not make a folder of the copy")?;
    fs::write(path, bytes).with_context(|| format!("could not write {}", path.display()))
}

/// The command that runs, in the copy, the test that this evidence is, or that compiles what asserts it.
fn test(evidence: &Evidence) -> Result<Command> {
    let file = Path::new(&evidence.file);
    let folder = file.ancestors().skip(1).find(|folder| root().join(folder).join("Cargo.toml").exists());
    let folder = folder.unwrap_or(Path::new(""));
    let mut command = cargo();
    command.args(["test", "--manifest-path"]).arg(copy_folder().join(folder).join("Cargo.toml"));
    command.arg("--target-dir").arg(target_dir());
    let suite = file.strip_prefix(folder)?.strip_prefix("tests").ok().and_then(|rest| rest.iter().next());
    match suite {
        Some(suite) => drop(command.args(["--test", suite.to_string_lossy().trim_end_matches(".rs")])),
        None if root().join(folder).join("src/lib.rs").exists() => drop(command.arg("--lib")),
        None => drop(command.arg("--bins")),
    }
    match evidence.kind {
        Kind::Assertion => drop(command.arg("--no-run")),
        _ => drop(command.args(["--", &evidence.name])),
    }
    Ok(command)
}

/// Runs a command, and returns whether it succeeded, and what it said.
fn said(mut command: Command) -> Result<(bool, String)> {
    let output = command.output().with_context(|| format!("could not start {command:?}"))?;
    let text = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    Ok((output.status.success(), text))
}

/// Tries a mutant. It is an error if its test does not pass without the change, or does not fail with it.
fn attempt(mutant: &Mutant, trace: &Trace) -> Result<()> {
    let Mutant { breaks, file, found_by, .. } = mutant;
    let finds = |it: &&Evidence| mutant.is_found_by(it) && breaks.iter().all(|id| it.ids.contains(id));
    let finder = trace.evidence.iter().find(finds);
    let finder = finder.with_context(|| format!("`{found_by}` does not show {}", breaks.join(", ")))?;
    let (passes, before) = said(test(finder)?)?;
    let last = |text: &str| text.lines().rev().take(9).collect::<Vec<_>>().join(" / ");
    ensure!(passes, "without the change: {}", last(&before));
    let ran = finder.kind == Kind::Assertion || before.contains(&format!("{found_by} ... ok"));
    ensure!(ran, "there is no test `{found_by}`: {}", last(&before));
    let text = fs::read_to_string(root().join(file)).with_context(|| format!("could not read {file}"))?;
    let copy = copy_folder().join(file);
    write_changed(&copy, mutant.applied(&text)?.as_bytes())?;
    let with = said(test(finder)?);
    write_changed(&copy, text.as_bytes())?;
    let (passes, with) = with?;
    let sign = if finder.kind == Kind::Assertion { "E0080".to_owned() } else { format!("{found_by} ... FAILED") };
    ensure!(!passes && with.contains(&sign), "not found by `{found_by}`: {}", last(&with));
    Ok(())
}

/// Tries the named mutants, or all if none is named.
pub(super) fn run(trace: &Trace, names: &[String]) -> Result<ExitCode> {
    let unknown = names.iter().find(|name| !trace.mutants.iter().any(|mutant| mutant.name == **name));
    ensure!(unknown.is_none(), "there is no mutant {}", unknown.map_or("", String::as_str));
    for path in tracked()? {
        let bytes = fs::read(root().join(&path)).with_context(|| format!("could not read {path}"))?;
        write_changed(&copy_folder().join(&path), &bytes)?;
    }
    let chosen = trace.mutants.iter().filter(|mutant| names.is_empty() || names.contains(&mutant.name));
    let (mut tried, mut wrong) = (0, 0);
    for mutant in chosen {
        tried += 1;
        match attempt(mutant, trace) {
            Ok(()) => println!("{:<32} found by {}", mutant.name, mutant.found_by),
            Err(error) => {
                wrong += 1;
                println!("{:<32} WRONG: {error:#}", mutant.name);
            }
        }
    }
    println!("{tried} mutants: {wrong} not as the table says");
    Ok(if wrong == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
