//! Small changes of the sources, each of which a named test must find.
//!
//! The table is `docs/safety/mutants.md`. A row has the mutant's name, the broken requirements, the file, the item (a
//! function or a constant), the replaced text, its replacement, and the name of the test that must fail. `constant
//! assertion` in place of a test means that the mutant must not compile. The replaced text must occur exactly once in
//! the item.
//!
//! `cargo xtask trace --mutants` makes a copy of the workspace below the target folder and applies the changes one by
//! one. The test must pass without the change, and fail with it.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};

use super::{Evidence, Kind, Trace, cells, ids};
use crate::workspace::{cargo, root, target_dir, tracked};

/// The table of mutants.
pub(super) const TABLE: &str = "docs/safety/mutants.md";
/// The name in place of a test, for a mutant that does not compile.
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

    pub(super) fn is_found_by(&self, evidence: &Evidence) -> bool {
        match evidence.kind {
            Kind::Test => evidence.name == self.found_by,
            Kind::Assertion => self.found_by == ASSERTION,
            Kind::Rule => false,
        }
    }

    /// Returns the text of the file with the mutant's change.
    pub(super) fn applied(&self, text: &str) -> Result<String> {
        let Self { name, file, item, old, new, .. } = self;
        ensure!(old != new, "mutant {name} changes nothing");
        let (mut at, mut found, mut inside) = (0, vec![], None::<(&str, bool)>);
        for line in text.split_inclusive('\n') {
            let indent = &line[..line.len() - line.trim_start().len()];
            if inside.is_none() && is_item(line, item) {
                let has_body = line.contains("fn ") || line.trim_end().ends_with('{');
                inside = Some((indent, has_body));
            }
            if let Some((outer, has_body)) = inside {
                found.extend(line.match_indices(old).map(|(column, _)| at + column));
                let is_last = if has_body {
                    indent == outer && line[indent.len()..].starts_with('}')
                } else {
                    line.trim_end().ends_with(';')
                };
                inside = inside.filter(|_| !is_last);
            }
            at += line.len();
        }
        let [place] = found[..] else {
            bail!("mutant {name}: `{item}` in {file} has to have `{old}` once, and has it {} times", found.len());
        };
        Ok(format!("{}{new}{}", &text[..place], &text[place + old.len()..]))
    }
}

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

fn write_changed(path: &Path, bytes: &[u8]) -> Result<()> {
    if fs::read(path).is_ok_and(|found| found == bytes) {
        return Ok(());
    }
    fs::create_dir_all(path.parent().unwrap_or(Path::new("."))).context("could not make a folder of the copy")?;
    fs::write(path, bytes).with_context(|| format!("could not write {}", path.display()))
}

/// The arguments for cargo to build a piece of evidence: the package's folder, and the selection of the target.
type Suite = (PathBuf, Vec<String>);

/// The suite that has this evidence.
fn suite(evidence: &Evidence) -> Result<Suite> {
    let file = Path::new(&evidence.file);
    let folder = file.ancestors().skip(1).find(|folder| root().join(folder).join("Cargo.toml").exists());
    let folder = folder.unwrap_or(Path::new(""));
    let package = root().join(folder);
    let within = file.strip_prefix(folder)?.strip_prefix("tests").ok().and_then(|rest| rest.iter().next());
    let target = match within.map(|name| name.to_string_lossy()) {
        // A file beside tests/main.rs is a module of that target.
        Some(name) if name.ends_with(".rs") && package.join("tests/main.rs").exists() => {
            let manifest = fs::read_to_string(package.join("Cargo.toml")).context("could not read a manifest")?;
            let before = manifest.split("\"\npath = \"tests/main.rs\"").next().filter(|before| *before != manifest);
            before.and_then(|before| before.rsplit('"').next()).unwrap_or("main").to_owned()
        }
        Some(name) => name.trim_end_matches(".rs").to_owned(),
        None if package.join("src/lib.rs").exists() => return Ok((folder.to_owned(), vec!["--lib".into()])),
        None => return Ok((folder.to_owned(), vec!["--bins".into()])),
    };
    Ok((folder.to_owned(), vec!["--test".into(), target]))
}

/// Builds a suite in the copy and runs its tests of these names; without names it only builds. Returns whether that
/// succeeded, and the output. Nothing is optimised, because building takes longer than running.
fn cargo_test((folder, target): &Suite, names: &[&str]) -> Result<(bool, String)> {
    let mut command = cargo();
    command.args(["test", "--manifest-path"]).arg(copy_folder().join(folder).join("Cargo.toml")).args(target);
    command.arg("--target-dir").arg(target_dir().join("mutants-target"));
    command.envs([("CARGO_INCREMENTAL", "1"), ("CARGO_PROFILE_DEV_OPT_LEVEL", "0"), ("CARGO_PROFILE_DEV_DEBUG", "0")]);
    match names {
        [] => command.arg("--no-run"),
        names => command.arg("--").args(names),
    };
    let output = command.output().with_context(|| format!("could not start {command:?}"))?;
    let text = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    Ok((output.status.success(), text))
}

/// The last lines of `text`, in one.
fn last(text: &str) -> String {
    let lines: Vec<&str> = text.lines().collect();
    lines[lines.len().saturating_sub(9)..].join(" / ")
}

fn names(evidence: &Evidence) -> Vec<&str> {
    if evidence.kind == Kind::Assertion { vec![] } else { vec![&evidence.name] }
}

/// Applies a mutant's change in the copy. It is an error if the evidence does not fail.
fn attempt(mutant: &Mutant, finder: &Evidence) -> Result<()> {
    let Mutant { file, found_by, .. } = mutant;
    let text = fs::read_to_string(root().join(file)).with_context(|| format!("could not read {file}"))?;
    let copy = copy_folder().join(file);
    write_changed(&copy, mutant.applied(&text)?.as_bytes())?;
    let with = cargo_test(&suite(finder)?, &names(finder));
    write_changed(&copy, text.as_bytes())?;
    let (passes, with) = with?;
    let failed = |line: &str| line.contains(found_by.as_str()) && line.ends_with("FAILED");
    let found = if finder.kind == Kind::Assertion { with.contains("E0080") } else { with.lines().any(failed) };
    ensure!(!passes && found, "not found by `{found_by}`: {}", last(&with));
    Ok(())
}

pub(super) fn run(trace: &Trace, names: &[String]) -> Result<ExitCode> {
    let unknown = names.iter().find(|name| !trace.mutants.iter().any(|mutant| mutant.name == **name));
    ensure!(unknown.is_none(), "there is no mutant {}", unknown.map_or("", String::as_str));
    for path in tracked()? {
        let bytes = fs::read(root().join(&path)).with_context(|| format!("could not read {path}"))?;
        write_changed(&copy_folder().join(&path), &bytes)?;
    }
    let mut suites: BTreeMap<Suite, Vec<(&Mutant, &Evidence)>> = BTreeMap::new();
    for mutant in trace.mutants.iter().filter(|mutant| names.is_empty() || names.contains(&mutant.name)) {
        let finds = |it: &&Evidence| mutant.is_found_by(it) && mutant.breaks.iter().all(|id| it.ids.contains(id));
        let finder = trace.evidence.iter().find(finds);
        let finder = finder.with_context(|| format!("{}: `{}` does not show it", mutant.name, mutant.found_by))?;
        suites.entry(suite(finder)?).or_default().push((mutant, finder));
    }
    let (mut tried, mut wrong) = (0, 0);
    for (suite, mutants) in suites {
        let all: Vec<&str> = mutants.iter().flat_map(|(_, finder)| self::names(finder)).collect();
        let (passes, said) = cargo_test(&suite, &all)?;
        ensure!(passes, "without any change {} fails: {}", suite.0.display(), last(&said));
        let ran = |name: &&str| said.lines().any(|line| line.contains(name) && line.ends_with("ok"));
        let missing = all.iter().find(|name| !ran(name));
        ensure!(missing.is_none(), "there is no test {} in {}", missing.unwrap_or(&""), suite.0.display());
        for (mutant, finder) in mutants {
            tried += 1;
            match attempt(mutant, finder) {
                Ok(()) => println!("{:<32} found by {}", mutant.name, mutant.found_by),
                Err(error) => {
                    wrong += 1;
                    println!("{:<32} WRONG: {error:#}", mutant.name);
                }
            }
        }
    }
    println!("{tried} mutants: {wrong} not as the table says");
    Ok(if wrong == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
