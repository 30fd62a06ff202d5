//! Which gaps are explained, by a comment beside the code or by the table `explained.txt`.
//!
//! The table is for code of libraries, which can have no comment of this workspace. Each of its lines has four columns,
//! separated by ` | `:
//!
//! | column | meaning |
//! |---|---|
//! | images | the beginnings of the images' names, separated by commas, or `all` |
//! | code | a part of a function's name, or of the path of a library's source if it has a `/` or ends in `.rs` |
//! | gaps | `code` that is never executed, `ways` of a branch or condition that are never taken, or `both` |
//! | reason | why the link never executes it |
//!
//! A function is meant by its own name, and by the names of functions that the compiler has inlined into others.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;

use anyhow::{Context, Result, bail};

use super::gaps::{Counts, Coverage, Gap, Missing};
use super::image::Function;
use super::part::Part;
use super::source::{Place, Source};
use crate::workspace::root;

/// An image with its coverage.
#[derive(Debug)]
pub(super) struct Measured {
    pub(super) name: String,
    pub(super) functions: Vec<Function>,
    pub(super) coverage: Coverage,
    /// The source lines of which the image has code.
    pub(super) lines: BTreeSet<Place>,
    /// The source lines of which code was executed.
    pub(super) executed: BTreeSet<Place>,
}

/// The table, from the root of the workspace.
pub(super) const TABLE: &str = "xtask/src/coverage/explained.txt";

/// The reason why some gaps of libraries cannot be closed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Reason {
    images: Vec<String>,
    pub(super) code: String,
    unexecuted: bool,
    one_way: bool,
    pub(super) text: String,
    /// Its line in the table.
    line: u32,
}

impl Reason {
    fn is_of(&self, image: &str) -> bool {
        self.images.iter().any(|name| name == "all" || image.starts_with(name))
    }

    /// Whether the reason holds for `gap`, which is in a function of the name `function`.
    fn explains(&self, gap: &Gap, function: &str) -> bool {
        let kind = if gap.missing == Missing::Execution { self.unexecuted } else { self.one_way };
        let is_path = self.code.contains('/') || self.code.ends_with(".rs");
        let is_named = |name: &str| name.contains(&self.code);
        kind && if is_path {
            is_named(&gap.library)
        } else {
            is_named(function) || gap.inlined.iter().any(|name| is_named(name))
        }
    }
}

/// Reads the table.
///
/// # Errors
///
/// A line does not have the four columns.
pub(super) fn reasons() -> Result<Vec<Reason>> {
    let text = std::fs::read_to_string(root().join(TABLE)).with_context(|| format!("{TABLE} cannot be read"))?;
    parse(&text)
}

fn parse(text: &str) -> Result<Vec<Reason>> {
    let mut reasons = vec![];
    for (index, line) in text.lines().enumerate().filter(|(_, line)| !line.is_empty() && !line.starts_with('#')) {
        let line_number = index + 1;
        let columns: Vec<&str> = line.split(" | ").map(str::trim).collect();
        let [images, code, gaps, reason] = columns[..] else {
            bail!("{TABLE}:{line_number}: {} columns instead of images | code | gaps | reason", columns.len());
        };
        let (unexecuted, one_way) = match gaps {
            "code" => (true, false),
            "ways" => (false, true),
            "both" => (true, true),
            _ => bail!("{TABLE}:{line_number}: \"{gaps}\" is not code, ways or both"),
        };
        if [images, code, reason].contains(&"") {
            bail!("{TABLE}:{line_number}: a column is empty");
        }
        reasons.push(Reason {
            images: images.split(',').map(|name| name.trim().to_owned()).collect(),
            code: code.to_owned(),
            unexecuted,
            one_way,
            text: reason.to_owned(),
            line: u32::try_from(line_number)?,
        });
    }
    Ok(reasons)
}

/// What is known of all gaps.
#[derive(Debug, Default)]
pub(super) struct Explained {
    /// For each image, by its number, and part: the gaps.
    pub(super) parts: BTreeMap<(usize, Part), Gaps>,
    /// The explained gaps, each by the number of its image, its address and its kind.
    pub(super) gaps: BTreeSet<(usize, u32, Missing)>,
    /// The reasons of the table, each with the number of gaps that it explains.
    pub(super) reasons: Vec<(Reason, u64)>,
    /// The number of gaps that need an explanation and have none.
    pub(super) open: u64,
    /// Explanations of what is covered.
    pub(super) needless: Vec<Place>,
    /// Explanations of a whole function that is executed, which would also explain its next gap.
    pub(super) wide: Vec<Place>,
}

/// The gaps of one part of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Gaps {
    pub(super) all: u64,
    /// The number that comments explain.
    pub(super) beside: u64,
    /// The number that the table explains.
    pub(super) by_table: u64,
    /// What would be covered if all explained gaps were.
    pub(super) explained: Counts,
}

impl std::ops::AddAssign for Gaps {
    fn add_assign(&mut self, other: Self) {
        self.all += other.all;
        self.beside += other.beside;
        self.by_table += other.by_table;
        self.explained += other.explained;
    }
}

impl Explained {
    /// The gaps of an image, by its number, in the parts for which `counted` is true.
    pub(super) fn sum(&self, image: usize, counted: impl Fn(Part) -> bool) -> Gaps {
        let mut sum = Gaps::default();
        let parts = self.parts.iter().filter(|((of, part), _)| *of == image && counted(*part));
        parts.for_each(|(_, gaps)| sum += *gaps);
        sum
    }
}

/// Finds which gaps the sources and the table explain.
pub(super) fn explain(measured: &[Measured], sources: &BTreeMap<String, Source>, reasons: Vec<Reason>) -> Explained {
    let reasons = reasons.into_iter().map(|reason| (reason, 0)).collect();
    let mut explained = Explained { reasons, ..Explained::default() };
    let mut used = BTreeSet::new();
    let gaps = measured.iter().enumerate();
    let gaps = gaps.flat_map(|(image, measured)| measured.coverage.gaps.iter().map(move |gap| (image, measured, gap)));
    for (image, of, gap) in gaps {
        let of_place = |(depth, place): (usize, &Place)| {
            let all = sources.get(&place.file)?.explained.iter();
            let mut fitting = all.filter(|explanation| explanation.explains(place.line, depth == 0));
            fitting.next().map(|explanation| Place { file: place.file.clone(), line: explanation.at })
        };
        let beside = gap.places.iter().enumerate().find_map(of_place);
        let counted = Part::COUNTED.contains(&gap.part);
        let function = &of.functions[gap.function].name;
        let fits = |(reason, _): &&mut (Reason, u64)| reason.is_of(&of.name) && reason.explains(gap, function);
        let by_table = if counted && beside.is_none() { explained.reasons.iter_mut().find(fits) } else { None };
        let known = beside.is_some() || by_table.is_some();
        if counted {
            let gaps = explained.parts.entry((image, gap.part)).or_default();
            gaps.all += 1;
            gaps.beside += u64::from(beside.is_some());
            gaps.by_table += u64::from(by_table.is_some());
            if known {
                gaps.explained += gap.lost;
            }
        }
        if let Some((_, count)) = by_table {
            *count += 1;
        }
        used.extend(beside);
        if known {
            explained.gaps.insert((image, gap.address, gap.missing));
        } else if gap.part.must_be_explained() {
            explained.open += 1;
        }
    }
    for (file, source) in sources {
        for explanation in &source.explained {
            let at = Place { file: file.clone(), line: explanation.at };
            let is_flown = |line: u32| {
                let place = Place { file: file.clone(), line };
                measured.iter().any(|measured| measured.lines.contains(&place))
            };
            if !used.contains(&at) && explanation.lines.clone().any(is_flown) {
                explained.needless.push(at);
            } else if explanation.function && is_any_executed(measured, file, &explanation.lines) {
                explained.wide.push(at);
            }
        }
    }
    let stale = explained.reasons.iter().filter(|(_, count)| *count == 0);
    let stale = stale.map(|(reason, _)| Place { file: TABLE.to_owned(), line: reason.line });
    explained.needless.extend(stale);
    explained
}

/// Whether code of any of these lines of `file` was executed.
fn is_any_executed(measured: &[Measured], file: &str, lines: &RangeInclusive<u32>) -> bool {
    let all = measured.iter().flat_map(|measured| &measured.executed);
    all.into_iter().any(|place| place.file == file && lines.contains(&place.line))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coverage::gaps::{Count, Coverage};
    use crate::coverage::image::Function;

    fn gap(missing: Missing) -> Gap {
        let lost = Counts { instructions: Count { seen: 1, all: 0 }, ..Counts::default() };
        Gap {
            address: 0x100,
            function: 0,
            part: Part::Library,
            missing,
            places: vec![],
            inlined: vec!["core::cmp::min".into()],
            library: "/registry/heapless-0.8.0/src/deque.rs".into(),
            lost,
        }
    }

    fn explained_by(table: &str, gap: Gap) -> Explained {
        let coverage = Coverage { counts: BTreeMap::new(), gaps: vec![gap] };
        let functions = vec![Function { name: "compiler_builtins::mem::memmove".into(), start: 0x100, end: 0x200 }];
        let (lines, executed) = (BTreeSet::new(), BTreeSet::new());
        let measured = [Measured { name: "hold-fw".into(), functions, coverage, lines, executed }];
        explain(&measured, &BTreeMap::new(), parse(table).unwrap())
    }

    #[test]
    fn an_explanation_of_a_function_that_is_executed_is_too_wide() {
        let source = crate::coverage::source::read("// Not covered: it hangs.\nfn f() {\n    g();\n}\n");
        let place = |line| Place { file: "rf.rs".into(), line };
        let wide_if = |executed: &[u32]| {
            let functions = vec![Function { name: "f".into(), start: 0x100, end: 0x200 }];
            let gap = Gap { places: vec![place(3)], library: String::new(), ..gap(Missing::Execution) };
            let coverage = Coverage { counts: BTreeMap::new(), gaps: vec![gap] };
            let executed = executed.iter().map(|line| place(*line)).collect();
            let measured = [Measured { name: "f".into(), functions, coverage, lines: [place(3)].into(), executed }];
            explain(&measured, &[("rf.rs".to_owned(), source.clone())].into(), vec![]).wide
        };
        assert_eq!(wide_if(&[2]), [place(1)]);
        assert!(wide_if(&[]).is_empty() && wide_if(&[9]).is_empty());
    }

    #[test]
    fn a_line_explains_by_function_inlined_function_and_source() {
        for code in ["mem::memmove", "cmp::min", "heapless-0.8.0/src/", "deque.rs"] {
            for images in ["all", "hold", "dpr-fw,hold-fw"] {
                let table = format!("# images | code\n\n{images} | {code} | code | It never overlaps.\n");
                let explained = explained_by(&table, gap(Missing::Execution));
                assert_eq!(explained.gaps, [(0, 0x100, Missing::Execution)].into(), "{images} {code}");
                let gaps = explained.parts[&(0, Part::Library)];
                assert_eq!((gaps.by_table, gaps.explained.instructions.seen), (1, 1));
                assert!(explained.needless.is_empty());
            }
        }
    }

    #[test]
    fn a_line_that_explains_nothing_is_needless() {
        for line in ["dpr | memmove | both | x", "all | memcpy | both | x", "all | memmove | ways | x"] {
            let explained = explained_by(line, gap(Missing::Execution));
            assert_eq!(explained.needless, [Place { file: TABLE.into(), line: 1 }], "{line}");
            assert!(explained.gaps.is_empty());
        }
        assert_eq!(explained_by("all | memmove | ways | x", gap(Missing::Taken)).gaps.len(), 1);
    }

    #[test]
    fn a_line_without_its_columns_is_refused() {
        let error = |line: &str| parse(line).unwrap_err().to_string();
        assert_eq!(error("all | f | code"), format!("{TABLE}:1: 3 columns instead of images | code | gaps | reason"));
        assert_eq!(error("\nall | f | often | x"), format!("{TABLE}:2: \"often\" is not code, ways or both"));
        assert_eq!(error("all | f | code | "), format!("{TABLE}:1: a column is empty"));
    }

    #[test]
    fn the_table_of_the_workspace_can_be_read() {
        assert!(!reasons().unwrap().is_empty());
    }
}
