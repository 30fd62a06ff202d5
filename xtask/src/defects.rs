//! Runs a table of defects against the judge: each must lead to the violation that the table names.
//!
//! All changes of the table in `bench/tests/defects/table.rs` are made at once, in a copy of the workspace below the
//! target folder. A number selects the defect of a run. In a firmware the number is a constant in flash, which is
//! written into the built file. In the bench it is an environment variable. With number 0 the copy has no defect and
//! must pass every run.
//!
//! `cargo xtask test` runs a sample without the defects of the bench, which takes longest to build.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Context, Result, bail, ensure};
use bench_judge::Violation;
use clap::Args;

use crate::workspace::{cargo, check, root, target_dir};
use crate::{Board, Receivers, firmware, seal};

#[path = "../../bench/tests/defects/table.rs"]
mod table;

use table::{DEFECTS, Defect, Shows};

#[derive(Args)]
pub(crate) struct DefectsArgs {
    /// The defects' names; all defects if none is named.
    names: Vec<String>,
}

/// The suffix of the names of the copy's packages and binaries. It keeps the checkout's files from being replaced.
const SUFFIX: &str = "-with-defects";
/// The two words that precede the number of the chosen defect in a firmware's flash.
const MARK: [u32; 2] = [0x4445_4645, 0x4354_3A20];
const VARIABLE: &str = "HORUS_DEFECT";
const CHOICE: &str = "DEFECT";
const CRATES: [&str; 7] =
    ["profile", "st25r3916", "firmware-common", "horus-tx-fw", "horus-tx-fw/voter", "dpr-fw", "base-station/core"];
const LEFT_OUT: [&str; 3] = ["target", "docs", "fuzz"];
/// The defects that `cargo xtask test` tries: one of each kind in the firmwares, with a short run.
const SAMPLE: [&str; 8] = [
    "buses-not-polled",
    "latitude-for-longitude",
    "vote-not-taken",
    "every-other-cycle",
    "gps1-not-deposited",
    "age-in-ms",
    "fresh-not-raised",
    "uplink-ages-exchanged",
];

fn chooser() -> String {
    let [first, second] = MARK;
    format!(
        "#![no_std]\n\
         #[cfg(target_os = \"none\")]\n\
         #[used]\n\
         static CHOSEN: [u32; 3] = [{first:#x}, {second:#x}, 0];\n\
         #[cfg(target_os = \"none\")]\n\
         #[inline(always)]\n\
         pub fn is(number: u32) -> bool {{\n\
             core::hint::black_box(&CHOSEN)[2] == number\n\
         }}\n\
         #[cfg(not(target_os = \"none\"))]\n\
         extern crate std;\n\
         #[cfg(not(target_os = \"none\"))]\n\
         pub fn is(number: u32) -> bool {{\n\
             static CHOSEN: std::sync::OnceLock<u32> = std::sync::OnceLock::new();\n\
             let chosen = || std::env::var(\"{VARIABLE}\").ok().and_then(|text| text.parse().ok()).unwrap_or(0);\n\
             *CHOSEN.get_or_init(chosen) == number\n\
         }}\n"
    )
}

const fn number(place: usize) -> u32 {
    place as u32 + 1
}

fn changed(number: u32, old: &str, new: &str) -> String {
    let choice = format!("::defect::is({number})");
    if new.contains(CHOICE) {
        new.replace(CHOICE, &choice)
    } else if old.ends_with(';') {
        format!("if {choice} {{ {new} }} else {{ {old} }}")
    } else {
        format!("(if {choice} {{ {new} }} else {{ {old} }})")
    }
}

fn with_defects(file: &str, text: &str) -> Result<String> {
    let mut edits = vec![];
    for (place, defect) in DEFECTS.iter().enumerate().filter(|(_, defect)| defect.edit.file == file) {
        let old = defect.edit.old;
        let mut found = text.match_indices(old);
        let (Some((at, _)), None) = (found.next(), found.next()) else {
            bail!("{}: {file} has to have this exactly once: {old}", defect.name);
        };
        edits.push((at, place, defect));
    }
    edits.sort_by_key(|(at, ..)| *at);
    let (mut result, mut done) = (String::new(), 0);
    for (at, place, Defect { name, edit, .. }) in edits {
        ensure!(at >= done, "{name}: another defect changes the same text of {file}");
        result.push_str(&text[done..at]);
        result.push_str(&changed(number(place), edit.old, edit.new));
        done = at + edit.old.len();
    }
    result.push_str(&text[done..]);
    Ok(result)
}

fn manifest(folder: &str, text: &str) -> String {
    let dependencies = "[dependencies]\n";
    let mut text = text.to_owned();
    if CRATES.contains(&folder) {
        text = text.replacen(dependencies, &format!("{dependencies}defect.workspace = true\n"), 1);
    }
    let own = format!("name = \"{folder}\"\n");
    let other = format!("name = \"{folder}{SUFFIX}\"\n");
    match folder {
        // Cargo tells crates of equal name and version in one target directory apart by their place in the workspace
        // only, so without another version the copy's would replace the workspace's own.
        "" => text
            .replacen("\"\nedition = ", "+defects\"\nedition = ", 1)
            .replacen("[workspace.dependencies]\n", "[workspace.dependencies]\ndefect = { path = \"defect\" }\n", 1)
            .replacen("[workspace.lints.rust]\n", "[workspace.lints.rust]\nwarnings = \"allow\"\n", 1)
            .replacen("\nxtask = {", &format!("\nxtask{SUFFIX} = {{"), 1),
        "xtask" => text.replacen(&own, &other, 1),
        // The firmwares' libraries have the names of their packages, so only the binaries get other names.
        "horus-tx-fw" | "dpr-fw" => {
            let path = "path = \"src/main.rs\"\n";
            let (package, targets) = text.split_once("[[bin]]\n").unwrap_or((&text, ""));
            let targets = targets.replacen(path, "", 1).replacen(&own, &format!("{other}{path}"), 1);
            format!("{}[[bin]]\n{targets}", package.replacen("[package]\n", "[package]\nautobins = false\n", 1))
        }
        _ => text,
    }
}

fn copy_folder() -> PathBuf {
    target_dir().join("defects").join("copy")
}

/// Makes the copy of the workspace with all defects. Equal files are not written again, because cargo would rebuild
/// them.
fn copy() -> Result<()> {
    let (from, to) = (root(), copy_folder());
    let mut kept = vec![];
    copy_into(&from, &to, Path::new(""), &mut kept)?;
    for (path, text) in [
        ("defect/src/lib.rs", chooser()),
        ("defect/Cargo.toml", "[package]\nname = \"defect\"\nversion = \"0.0.0\"\nedition = \"2024\"\n".to_owned()),
    ] {
        write_changed(&to.join(path), text.as_bytes())?;
        kept.push(PathBuf::from(path));
    }
    let unknown = DEFECTS.iter().find(|defect| !kept.iter().any(|path| path == Path::new(defect.edit.file)));
    ensure!(unknown.is_none(), "no file {}", unknown.map_or("", |defect| defect.edit.file));
    Ok(())
}

fn copy_into(from: &Path, to: &Path, inside: &Path, kept: &mut Vec<PathBuf>) -> Result<()> {
    let folder = from.join(inside);
    for entry in fs::read_dir(&folder).with_context(|| format!("could not read {}", folder.display()))? {
        let entry = entry?;
        let name = entry.file_name();
        let path = inside.join(&name);
        let name = name.to_string_lossy();
        if name.starts_with('.') || LEFT_OUT.contains(&&*name) || from.join(&path) == target_dir() {
            continue;
        }
        if entry.file_type()?.is_dir() {
            copy_into(from, to, &path, kept)?;
            continue;
        }
        let bytes = fs::read(entry.path()).with_context(|| format!("could not read {}", path.display()))?;
        let bytes = match (path.extension().and_then(|it| it.to_str()), std::str::from_utf8(&bytes)) {
            (Some("rs"), Ok(text)) => with_defects(&path.to_string_lossy(), text)?.into_bytes(),
            (Some("toml"), Ok(text)) if name == "Cargo.toml" => manifest(&inside.to_string_lossy(), text).into_bytes(),
            _ => bytes,
        };
        write_changed(&to.join(&path), &bytes)?;
        kept.push(path);
    }
    Ok(())
}

fn write_changed(path: &Path, bytes: &[u8]) -> Result<()> {
    if fs::read(path).is_ok_and(|there| there == bytes) {
        return Ok(());
    }
    fs::create_dir_all(path.parent().unwrap_or(Path::new("."))).context("could not make a folder of the copy")?;
    fs::write(path, bytes).with_context(|| format!("could not write {}", path.display()))
}

struct Built(Vec<(Board, Vec<u8>)>);

impl Built {
    fn build() -> Result<Self> {
        let manifest = copy_folder().join("Cargo.toml");
        let (manifest, target) = (manifest.display().to_string(), target_dir().display().to_string());
        let built = Board::ALL.map(|board| {
            let (package, feature) = (board.package(), Receivers::DEFAULT.feature());
            let name = format!("{package}{SUFFIX}");
            let args = ["build", "--manifest-path", &manifest, "--target-dir", &target, "--package", package];
            let args = [&args[..], &["--bin", &name, "--no-default-features", "--features", &feature]].concat();
            let elf = firmware::build_for_target(&args, &name)?;
            let elf = fs::read(&elf).with_context(|| format!("could not read {}", elf.display()))?;
            Ok((board, elf))
        });
        Ok(Self(built.into_iter().collect::<Result<_>>()?))
    }

    fn choose(&self, number: u32, folder: &Path) -> Result<()> {
        fs::create_dir_all(folder).with_context(|| format!("could not make {}", folder.display()))?;
        for (board, elf) in &self.0 {
            let mut elf = elf.clone();
            let mark: Vec<u8> = MARK.iter().flat_map(|word| word.to_le_bytes()).collect();
            let places: Vec<usize> = (0..elf.len()).filter(|at| elf[*at..].starts_with(&mark)).collect();
            let [at] = places[..] else { bail!("{}: the mark is there {} times", board.name(), places.len()) };
            let place = at + mark.len();
            elf[place..place + 4].copy_from_slice(&number.to_le_bytes());
            seal::seal(&mut elf)?;
            let path = folder.join(board.package()).with_extension("elf");
            fs::write(&path, elf).with_context(|| format!("could not write {}", path.display()))?;
        }
        Ok(())
    }
}

fn build_bench() -> Result<PathBuf> {
    let package = format!("xtask{SUFFIX}");
    let mut command = cargo();
    command.args(["build", "--package", &package, "--manifest-path"]).arg(copy_folder().join("Cargo.toml"));
    command.arg("--target-dir").arg(target_dir());
    check("building the bench of the copy", &mut command)?;
    Ok(target_dir().join("debug").join(package))
}

fn violations(bench: &Path, images: &Path, number: u32, run: &str) -> Result<Vec<String>> {
    let output = Command::new(bench)
        .args(["sim", "--threads", "1", "--json", "-", "--images"])
        .arg(images)
        .args(run.split(' '))
        .env(VARIABLE, number.to_string())
        .current_dir(root())
        .stdin(Stdio::null())
        .output()
        .with_context(|| format!("could not start {}", bench.display()))?;
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).with_context(|| {
        let said = String::from_utf8_lossy(&output.stderr);
        format!("the run gave no report: {}", said.lines().rev().take(3).collect::<Vec<_>>().join(" / "))
    })?;
    let violations = report["violations"].as_array().context("the report has no violations")?;
    Ok(violations.iter().filter_map(|violation| violation.as_str().map(str::to_owned)).collect())
}

fn kinds(violations: &[String]) -> Vec<Violation> {
    let of = |text: &String| Violation::ALL.iter().copied().find(|kind| text.starts_with(kind.words()));
    violations.iter().filter_map(of).collect()
}

struct Case {
    name: String,
    number: u32,
    run: &'static str,
    defect: Option<&'static Defect>,
}

struct Outcome {
    line: String,
    holds: bool,
}

impl Case {
    fn of(chosen: &[(usize, &'static Defect)]) -> Vec<Self> {
        let runs: BTreeMap<&str, ()> = chosen.iter().map(|(_, defect)| (defect.run, ())).collect();
        let control = |run: &'static str| Self { name: "none".into(), number: 0, run, defect: None };
        let mut cases: Vec<Self> = runs.into_keys().map(control).collect();
        cases.extend(chosen.iter().map(|(place, defect)| Self {
            name: defect.name.to_owned(),
            number: number(*place),
            run: defect.run,
            defect: Some(defect),
        }));
        cases
    }

    fn outcome(&self, bench: &Path, built: &Built, folder: &Path) -> Outcome {
        let shown = built.choose(self.number, folder).and_then(|()| violations(bench, folder, self.number, self.run));
        let Self { name, run, .. } = self;
        let shown = match shown {
            Ok(shown) => shown,
            Err(error) => return Outcome { line: format!("{name:<36} FAILED: {error:#}\n"), holds: false },
        };
        let kinds = kinds(&shown);
        let words = || shown.first().map_or("nothing".to_owned(), |first| format!("\"{first}\""));
        let (holds, verdict) = match self.defect.map(|defect| &defect.shows) {
            None if shown.is_empty() => (true, "nothing shown, as it has to be".to_owned()),
            None => (false, format!("WRONG: {} without a defect", words())),
            Some(Shows::By(wanted)) if kinds.contains(wanted) => (true, wanted.words().to_owned()),
            Some(Shows::By(wanted)) => (false, format!("WRONG: {} instead of \"{}\"", words(), wanted.words())),
            Some(Shows::Not(why)) if shown.is_empty() => (true, format!("not noticed: {why}")),
            Some(Shows::Not(_)) => (false, format!("NOW NOTICED, which the table does not say: {}", words())),
        };
        let mut line = format!("{name:<36} {verdict}\n");
        if let Some(defect) = self.defect {
            let _ = writeln!(line, "{:<36}   {} ({run})", "", defect.does);
        } else {
            let _ = writeln!(line, "{:<36}   ({run})", "");
        }
        Outcome { line, holds }
    }
}

/// Runs these defects, and each of their runs without a defect, on all processors. Prints the outcomes, and returns how
/// many of them differ from the table.
fn run(chosen: &[(usize, &'static Defect)], bench: &Path, built: &Built) -> Result<usize> {
    let cases = Case::of(chosen);
    let (next, wrong) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let printing = Mutex::new(());
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for thread in 0..threads {
            let (next, wrong, printing, cases) = (&next, &wrong, &printing, &cases);
            let folder = target_dir().join("defects").join(format!("images-{thread}"));
            scope.spawn(move || {
                while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let outcome = case.outcome(bench, built, &folder);
                    wrong.fetch_add(usize::from(!outcome.holds), Ordering::Relaxed);
                    let _one_at_a_time = printing.lock();
                    print!("{}", outcome.line);
                }
            });
        }
    });
    Ok(wrong.into_inner())
}

fn chosen(is_chosen: impl Fn(&Defect) -> bool) -> Vec<(usize, &'static Defect)> {
    DEFECTS.iter().enumerate().filter(|(_, defect)| is_chosen(defect)).collect()
}

/// Returns the name of each defect, and the name of the violation that it must show, if any.
pub(crate) fn shown() -> Vec<(&'static str, Option<String>)> {
    let rule = |shows: &Shows| match shows {
        Shows::By(violation) => Some(format!("{violation:?}")),
        Shows::Not(_) => None,
    };
    DEFECTS.iter().map(|defect| (defect.name, rule(&defect.shows))).collect()
}

pub(crate) fn defects(args: &DefectsArgs) -> Result<ExitCode> {
    let chosen = chosen(|defect| args.names.is_empty() || args.names.iter().any(|name| name == defect.name));
    let unknown = args.names.iter().find(|name| !chosen.iter().any(|(_, defect)| defect.name == **name));
    ensure!(unknown.is_none(), "there is no defect {}", unknown.map_or("", String::as_str));
    copy()?;
    let built = Built::build()?;
    let wrong = run(&chosen, &build_bench()?, &built)?;
    let unnoticed = chosen.iter().filter(|(_, defect)| matches!(defect.shows, Shows::Not(_))).count();
    println!("{} defects: {unnoticed} are not noticed by any run, {wrong} runs not as the table says", chosen.len());
    Ok(if wrong == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Runs the sample of the defects on the bench of this program, whose path is `own`.
pub(crate) fn sample(own: &Path) -> Result<()> {
    let chosen = chosen(|defect| SAMPLE.contains(&defect.name));
    copy()?;
    match run(&chosen, own, &Built::build()?)? {
        0 => Ok(()),
        wrong => bail!("{wrong} runs are not as the table of defects says"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_old_text_of_the_table_is_in_its_file_once() {
        for Defect { edit, .. } in DEFECTS {
            let text = fs::read_to_string(root().join(edit.file)).expect(edit.file);
            let changed = with_defects(edit.file, &text).unwrap();
            assert_ne!(changed, text, "{}", edit.file);
        }
    }

    #[test]
    fn an_error_names_the_defect_whose_text_is_not_found() {
        let Defect { name, edit, .. } = &DEFECTS[0];
        for text in ["", &format!("{} {}", edit.old, edit.old)] {
            let error = with_defects(edit.file, text).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains(edit.file), "{error}");
        }
    }

    #[test]
    fn at_least_sixty_defects_have_names_of_their_own() {
        let names: BTreeMap<&str, &str> = DEFECTS.iter().map(|defect| (defect.name, defect.does)).collect();
        assert!(names.len() == DEFECTS.len() && names.len() >= 60, "{}", names.len());
        assert!(SAMPLE.iter().all(|name| names.contains_key(name)));
    }

    #[test]
    fn the_sample_needs_no_bench_of_its_own() {
        for defect in DEFECTS.iter().filter(|defect| SAMPLE.contains(&defect.name)) {
            let file = defect.edit.file;
            assert!(!file.starts_with("profile/") && !file.starts_with("base-station/"), "{}", defect.name);
        }
    }

    #[test]
    fn an_edit_becomes_a_choice_of_old_and_new() {
        assert_eq!(changed(7, "go();", "stay();"), "if ::defect::is(7) { stay(); } else { go(); }");
        assert_eq!(changed(7, "a + b", "a"), "(if ::defect::is(7) { a } else { a + b })");
        assert_eq!(changed(7, "a", "!DEFECT && a"), "!::defect::is(7) && a");
    }
}
