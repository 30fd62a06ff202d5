//! Traces each requirement to what shows that it is met, and to what has broken it.
//!
//! # Design
//!
//! | what | where | form |
//! |---|---|---|
//! | requirement | `docs/safety/requirements.md` | a row of a table: identifier, requirement, source, reason, weight |
//! | evidence | any source in Rust | a comment `Shows`, a list of identifiers and a full stop, above an item |
//! | defect | `bench/tests/defects/table.rs` | a row; a comment `Breaks` of the same form may stand above it |
//! | mutant | `docs/safety/mutants.md` | a row of the table: see [`mutants`] |
//!
//! The item below a comment `Shows` is a test, a constant assertion, or a variant of `Violation` (a rule of the judge).
//! A defect breaks the requirements that its rule shows, or only those that a comment `Breaks` names. A defect that no
//! rule finds needs this comment.
//!
//! The trace has a gap if a requirement has no evidence, if evidence has no requirement, or if no defect or mutant
//! breaks a requirement. `docs/safety/trace.md` is written only without a gap.

mod mutants;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;

use crate::defects::shown;
use crate::workspace::{root, tracked};
use mutants::Mutant;

/// The requirements.
const REQUIREMENTS: &str = "docs/safety/requirements.md";
/// The matrix, which this command writes.
const MATRIX: &str = "docs/safety/trace.md";
/// The defects.
const DEFECTS: &str = "bench/tests/defects/table.rs";
/// The possible weights of a requirement in the table of requirements.
const WEIGHTS: [&str; 3] = ["safety", "mission", "none"];

#[derive(Args)]
pub(crate) struct TraceArgs {
    /// Write nothing; fail if docs/safety/trace.md is not current.
    #[arg(long, conflicts_with = "mutants")]
    check: bool,
    /// Instead of tracing, try recorded mutants in a copy of the workspace: those that are named, or all.
    #[arg(long, value_name = "NAME", num_args = 0..)]
    mutants: Option<Vec<String>>,
}

pub(crate) fn trace(args: &TraceArgs) -> Result<ExitCode> {
    if let Some(names) = &args.mutants {
        return mutants::run(&Trace::read()?, names);
    }
    let trace = Trace::read()?;
    print!("{}", trace.screen());
    trace.verdict()?;
    if args.check {
        return check_current(&trace).map(|()| ExitCode::SUCCESS);
    }
    let path = root().join(MATRIX);
    std::fs::write(&path, trace.page()).with_context(|| format!("could not write {}", path.display()))?;
    Ok(ExitCode::SUCCESS)
}

/// Fails if there is a gap, or if the matrix in docs/safety is not current.
pub(crate) fn check() -> Result<()> {
    let trace = Trace::read()?;
    trace.verdict()?;
    check_current(&trace)
}

fn check_current(trace: &Trace) -> Result<()> {
    let current = std::fs::read_to_string(root().join(MATRIX)).is_ok_and(|found| found == trace.page());
    ensure!(current, "{MATRIX} is not current: run `cargo xtask trace`");
    Ok(())
}

/// A requirement.
#[derive(Debug)]
struct Requirement {
    id: String,
    text: String,
    weight: String,
}

/// An item that shows requirements.
#[derive(Debug)]
struct Evidence {
    ids: Vec<String>,
    kind: Kind,
    /// The name of the test or of the variant of `Violation`; empty for a constant assertion.
    name: String,
    file: String,
}

/// The kinds of evidence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Rule,
    Test,
    Assertion,
}

impl Evidence {
    /// The item as the matrix names it.
    fn label(&self) -> String {
        match self.kind {
            Kind::Rule => format!("rule `{}`", self.name),
            Kind::Test => format!("`{}` ({})", self.name, self.file),
            Kind::Assertion => format!("constant assertion ({})", self.file),
        }
    }
}

/// The requirements, their evidence, the mutants, and the gaps.
#[derive(Debug, Default)]
struct Trace {
    requirements: Vec<Requirement>,
    evidence: Vec<Evidence>,
    mutants: Vec<Mutant>,
    /// For each requirement, the names of the defects and mutants that break it.
    broken: BTreeMap<String, Vec<String>>,
    gaps: Vec<String>,
}

/// Returns the identifiers in a list like `SEQ-1, SEQ-2.`, or `None` if `text` is no such list.
fn ids(text: &str) -> Option<Vec<String>> {
    let list = text.trim_end().strip_suffix('.')?.split(", ").map(str::to_owned).collect::<Vec<_>>();
    list.iter().all(|id| is_id(id)).then_some(list)
}

/// Returns whether `text` is an identifier: capital letters, a hyphen, and a number from 1.
fn is_id(text: &str) -> bool {
    text.split_once('-').is_some_and(|(group, number)| {
        !group.is_empty()
            && group.bytes().all(|letter| letter.is_ascii_uppercase())
            && !number.starts_with('0')
            && number.parse::<u16>().is_ok()
    })
}

/// Returns the cells of a row of a table in Markdown, without code marks, or `None` for any other line.
fn cells(line: &str) -> Option<Vec<String>> {
    let inner = line.trim().strip_prefix('|')?.strip_suffix('|')?;
    let bare = |cell: &str| cell.trim().replace('\u{0}', "|");
    Some(inner.replace("\\|", "\u{0}").split('|').map(bare).collect())
}

impl Trace {
    /// Reads everything from the workspace.
    fn read() -> Result<Self> {
        let read =
            |path: &str| std::fs::read_to_string(root().join(path)).with_context(|| format!("could not read {path}"));
        let mut sources = BTreeMap::new();
        for path in tracked()?.into_iter().filter(|path| path.ends_with(".rs")) {
            let text = read(&path)?;
            sources.insert(path, text);
        }
        let mut trace = Self::of(&read(REQUIREMENTS)?, &sources, &shown(), &read(mutants::TABLE)?);
        for page in tracked()?.iter().filter(|path| path.starts_with("docs/safety/") && path.ends_with(".md")) {
            trace.take_page(page, &read(page)?);
        }
        Ok(trace)
    }

    /// Makes the trace of `requirements` from the `sources` (path and text), the defects (name, and the variant of
    /// `Violation` that shows it) and the table of mutants.
    fn of(
        requirements: &str,
        sources: &BTreeMap<String, String>,
        defects: &[(&str, Option<String>)],
        mutants: &str,
    ) -> Self {
        let mut trace = Self::default();
        trace.take_requirements(requirements);
        sources.iter().for_each(|(path, text)| trace.take_evidence(path, text));
        trace.take_defects(sources.get(DEFECTS).map_or("", String::as_str), defects);
        trace.take_mutants(mutants, sources);
        let known: BTreeSet<&str> = trace.requirements.iter().map(|it| it.id.as_str()).collect();
        for Evidence { ids, file, .. } in &trace.evidence {
            let unknown = ids.iter().filter(|id| !known.contains(id.as_str()));
            trace.gaps.extend(unknown.map(|id| format!("{file} shows {id}, which is no requirement")));
        }
        for (id, names) in trace.broken.iter().filter(|(id, _)| !known.contains(id.as_str())) {
            trace.gaps.push(format!("{} breaks {id}, which is no requirement", names.join(", ")));
        }
        for Requirement { id, .. } in &trace.requirements {
            if !trace.evidence.iter().any(|it| it.ids.contains(id)) {
                trace.gaps.push(format!("nothing shows {id}"));
            }
            if !trace.broken.contains_key(id) {
                trace.gaps.push(format!("no defect and no mutant breaks {id}"));
            }
        }
        trace
    }

    fn take_requirements(&mut self, text: &str) {
        for line in text.lines() {
            let Some([id, text, source, reason, weight]) = cells(line).and_then(|it| <[String; 5]>::try_from(it).ok())
            else {
                continue;
            };
            if !is_id(&id) {
                continue;
            }
            if self.requirements.iter().any(|it| it.id == id) {
                self.gaps.push(format!("{id} is there twice"));
            }
            if !WEIGHTS.contains(&&*weight) || text.is_empty() || source.is_empty() || reason.is_empty() {
                self.gaps.push(format!("{id} lacks its text, source, reason or weight ({})", WEIGHTS.join(", ")));
            }
            self.requirements.push(Requirement { id, text, weight });
        }
        if self.requirements.is_empty() {
            self.gaps.push(format!("{REQUIREMENTS} has no requirement"));
        }
    }

    /// Takes each comment `Shows` and the item below it as evidence.
    fn take_evidence(&mut self, path: &str, text: &str) {
        let lines: Vec<&str> = text.lines().map(str::trim_start).collect();
        for (index, line) in lines.iter().enumerate() {
            let Some(list) = line.strip_prefix("// Shows ") else { continue };
            let mut wrong = |what: &str| self.gaps.push(format!("{path}:{}: {what}", index + 1));
            let Some(ids) = ids(list) else {
                // A comment may begin with `Shows` in its ordinary sense.
                if list.split([',', '.', ' ']).next().is_some_and(is_id) {
                    wrong("expected `Shows`, identifiers with commas between them, and a full stop");
                }
                continue;
            };
            let is_above = |line: &&&str| line.starts_with("//") || line.starts_with("#[");
            let above = lines[index + 1..].iter().take_while(is_above);
            let is_test = above.clone().any(|line| matches!(*line, "#[test]" | "#[tokio::test]"));
            let item = lines.get(index + 1 + above.count()).copied().unwrap_or_default();
            let name: String =
                item.trim_start_matches("fn ").chars().take_while(|&c| c.is_alphanumeric() || c == '_').collect();
            let kind = match item {
                _ if is_test && item.starts_with("fn ") => Kind::Test,
                _ if item.starts_with("const _: () =") || item.starts_with("const { assert!") => Kind::Assertion,
                _ if path.ends_with("judge/src/violation.rs") && item.contains(" = \"") => Kind::Rule,
                _ => {
                    wrong("below `Shows` there is no test, no constant assertion and no rule");
                    continue;
                }
            };
            let name = if kind == Kind::Assertion { String::new() } else { name };
            self.evidence.push(Evidence { ids, kind, name, file: path.to_owned() });
        }
    }

    fn take_defects(&mut self, table: &str, defects: &[(&str, Option<String>)]) {
        let lines: Vec<&str> = table.lines().map(str::trim_start).collect();
        for (name, rule) in defects {
            let row = format!("row(\"{name}\",");
            let chosen = lines
                .windows(2)
                .find_map(|pair| pair[0].strip_prefix("// Breaks ").filter(|_| pair[1].starts_with(&row)));
            let by_rule: Vec<String> = match rule {
                Some(rule) => self
                    .evidence
                    .iter()
                    .filter(|it| it.kind == Kind::Rule && it.name == *rule)
                    .flat_map(|it| it.ids.clone())
                    .collect(),
                None => vec![],
            };
            let broken = match (chosen, &by_rule[..]) {
                (None, [] | [_]) => by_rule,
                (None, several) => {
                    self.gaps.push(format!("{name}: write above the row which of {} it breaks", several.join(", ")));
                    continue;
                }
                (Some(list), _) => match ids(list) {
                    Some(ids) if rule.is_none() || ids.iter().all(|id| by_rule.contains(id)) => ids,
                    _ => {
                        self.gaps.push(format!("{name} breaks `{list}`, which its rule does not show"));
                        continue;
                    }
                },
            };
            for id in broken {
                self.broken.entry(id).or_default().push(format!("defect `{name}`"));
            }
        }
    }

    fn take_mutants(&mut self, table: &str, sources: &BTreeMap<String, String>) {
        for mutant in table.lines().filter_map(Mutant::of) {
            let killers = self.evidence.iter().filter(|it| mutant.is_found_by(it));
            let shows: BTreeSet<&str> = killers.flat_map(|it| it.ids.iter().map(String::as_str)).collect();
            if let Some(id) = mutant.breaks.iter().find(|id| !shows.contains(id.as_str())) {
                self.gaps.push(format!("{}: `{}` does not show {id}", mutant.name, mutant.found_by));
            }
            if let Err(error) = mutant.applied(sources.get(&mutant.file).map_or("", String::as_str)) {
                self.gaps.push(format!("{error:#}"));
            }
            for id in &mutant.breaks {
                self.broken.entry(id.clone()).or_default().push(format!("mutant `{}`", mutant.name));
            }
            self.mutants.push(mutant);
        }
    }

    /// Takes the identifiers of requirements that a page cites.
    fn take_page(&mut self, path: &str, text: &str) {
        let group = |id: &str| id.split_once('-').map_or(String::new(), |(group, _)| group.to_owned());
        let groups: BTreeSet<String> = self.requirements.iter().map(|it| group(&it.id)).collect();
        let words = text.split(|c: char| !c.is_ascii_alphanumeric() && c != '-').filter(|word| is_id(word));
        let cited: BTreeSet<&str> = words.filter(|word| groups.contains(&group(word))).collect();
        let unknown = cited.into_iter().filter(|id| !self.requirements.iter().any(|it| it.id == **id));
        self.gaps.extend(unknown.map(|id| format!("{path} cites {id}, which is no requirement")));
    }

    /// Prints each gap, and fails if there is one.
    fn verdict(&self) -> Result<()> {
        self.gaps.iter().for_each(|gap| eprintln!("error: {gap}"));
        match self.gaps.len() {
            0 => Ok(()),
            gaps => bail!("{gaps} gaps between requirements, evidence and what broke them"),
        }
    }

    /// Returns the labels of a requirement's evidence: first the rules, then the tests.
    fn shown_by(&self, id: &str) -> Vec<String> {
        let mut all: Vec<_> = self.evidence.iter().filter(|it| it.ids.iter().any(|one| one == id)).collect();
        all.sort_by_key(|it| (it.kind, &it.file, &it.name));
        all.into_iter().map(Evidence::label).collect()
    }

    /// What broke a requirement.
    fn broken_by(&self, id: &str) -> &[String] {
        self.broken.get(id).map_or(&[], Vec::as_slice)
    }

    /// Returns a sentence with the numbers of requirements, pieces of evidence, defects and mutants.
    fn summary(&self) -> String {
        let count = |kind| self.evidence.iter().filter(|it| it.kind == kind).count();
        let weigh = |weight: &str| self.requirements.iter().filter(|it| it.weight == weight).count();
        let names: BTreeSet<&String> = self.broken.values().flatten().collect();
        let mutants = names.iter().filter(|name| name.starts_with("mutant")).count();
        format!(
            "{} requirements ({} of safety, {} of the mission, {} of neither), shown by {} rules of the judge, {} \
                 tests \
             and {} constant assertions; broken by {} defects and {} mutants.",
            self.requirements.len(),
            weigh("safety"),
            weigh("mission"),
            weigh("none"),
            count(Kind::Rule),
            count(Kind::Test),
            count(Kind::Assertion),
            names.len() - mutants,
            mutants
        )
    }

    /// The matrix as text.
    fn screen(&self) -> String {
        let mut text = String::new();
        for Requirement { id, text: words, weight } in &self.requirements {
            let _ = writeln!(text, "{id} ({weight}): {words}");
            let lines = [("shown by", self.shown_by(id)), ("broken by", self.broken_by(id).to_vec())];
            for (what, items) in lines {
                for item in items {
                    let _ = writeln!(text, "    {what} {}", item.replace('`', ""));
                }
            }
        }
        let _ = writeln!(text, "{}", self.summary());
        text
    }

    /// The page in docs/safety.
    fn page(&self) -> String {
        let mut page = format!(
            "# Requirements, what shows them, what broke them\n\n`cargo xtask trace` writes this page, and fails on \
                 any \
             gap in it. The requirements: [requirements.md](requirements.md);\nthe mutants: [mutants.md](mutants.md); \
             the defects: `cargo xtask defects NAME` repeats each.\n\n{}\n\n| requirement | weight | shown by | broken \
             by |\n|---|---|---|---|\n",
            self.summary()
        );
        for Requirement { id, weight, .. } in &self.requirements {
            let (shown, broken) = (self.shown_by(id).join("<br>"), self.broken_by(id).join("<br>"));
            let _ = writeln!(page, "| {id} | {weight} | {shown} | {broken} |");
        }
        page
    }
}

#[cfg(test)]
mod tests;
