//! Checks that everything that code and pages cite exists: files below docs/, headings of pages, and decisions by their
//! numbers.
//!
//! # Citations
//!
//! | where | form | must exist |
//! |---|---|---|
//! | every text file | `docs/` and a path, perhaps with `#` and an anchor | the file or folder, and the heading |
//! | pages in Markdown | a link to no other site | likewise; a path counts from the page's folder |
//! | every text file | `decision` and a number | the page of that decision |
//!
//! The anchor of a heading follows GitHub's rule: lower case, without punctuation, with hyphens for spaces. Citing a
//! section of the design by a number is an error, because the headings have none.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

use anyhow::{Result, ensure};

use crate::workspace::{root, tracked};

const DECISIONS: &str = "docs/decisions/";

/// Whether a tracked file is checked: hand-written text is, recorded data and test corpora are not.
fn is_checked(path: &str) -> bool {
    let data = path.split('/').any(|folder| matches!(folder, "data" | "corpus" | "recorded"));
    let text = matches!(
        Path::new(path).extension().and_then(|end| end.to_str()),
        Some("rs" | "md" | "toml" | "yml" | "sh" | "x" | "c" | "h" | "hpp")
    );
    (text || path == ".ci/run") && !data
}

/// Checks every tracked file, and prints each citation of something missing as `file:line: what`.
///
/// # Errors
///
/// The target of a citation is missing, or git does not list the tracked files.
pub(crate) fn check() -> Result<()> {
    let mut files = BTreeMap::new();
    for path in tracked()? {
        let text = is_checked(&path).then(|| std::fs::read_to_string(root().join(&path)).ok()).flatten();
        files.insert(path, text.unwrap_or_default());
    }
    let broken = broken(&files);
    for line in &broken {
        eprintln!("{line}");
    }
    ensure!(broken.is_empty(), "{} citations of what does not exist", broken.len());
    Ok(())
}

fn broken(files: &BTreeMap<String, String>) -> Vec<String> {
    let mut broken = vec![];
    for (path, text) in files {
        let mut before = "";
        for (number, line) in (1..).zip(text.lines()) {
            let mut say = |what: String| broken.push(format!("{path}:{number}: {what}"));
            if is_by_number(before, line) {
                say("a section of the design by its number: cite it as docs/design.md#...".into());
            }
            before = line;
            for number in decisions(line) {
                let page = format!("{DECISIONS}{number:04}-");
                if !files.keys().any(|file| file.starts_with(&page)) {
                    say(format!("there is no decision {number}"));
                }
            }
            let links = if path.ends_with(".md") { links(path, line) } else { vec![] };
            let cited: BTreeSet<_> = paths(line).into_iter().chain(links).collect();
            for (file, anchor) in cited {
                let folder = format!("{file}/");
                if !files.contains_key(&file) && !files.keys().any(|other| other.starts_with(&folder)) {
                    say(format!("there is no {file}"));
                } else if let Some(anchor) = anchor.filter(|_| file.ends_with(".md"))
                    && !anchors(&files[&file]).contains(&anchor)
                {
                    say(format!("{file} has no heading with the anchor #{anchor}"));
                }
            }
        }
    }
    broken
}

/// Whether a line cites a section of the design by its number. Such a citation may begin at the end of the line
/// `before`.
fn is_by_number(before: &str, line: &str) -> bool {
    let ends = |text: &str| text.to_lowercase().trim_end_matches([' ', ',']).ends_with("design");
    let begins = |text: &str| text.starts_with("section ");
    let wrapped = ends(before) && begins(line.trim_start_matches(['/', '!', ' ']));
    wrapped || line.match_indices("section ").any(|(at, _)| line[..at].ends_with(' ') && ends(&line[..at]))
}

type Cited = (String, Option<String>);

fn paths(line: &str) -> Vec<Cited> {
    let belongs = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.' | '/' | '#');
    line.match_indices("docs/")
        .filter(|(at, _)| {
            // Within the workspace the folder may be cited as `../docs/`. A folder docs/ of another project does not
            // count.
            let before = line[..*at].trim_end_matches("../");
            !before.ends_with(belongs)
        })
        .filter_map(|(at, _)| {
            let rest = &line[at..];
            let end = rest.find(|c| !belongs(c)).unwrap_or(rest.len());
            // A citation with a pattern, such as `docs/*.md`, names more than one file, so it is not checked.
            let pattern = rest[end..].starts_with(['*', '{', '<']);
            let (file, anchor) = split(rest[..end].trim_end_matches(['.', '-', '#']));
            (!pattern && file != "docs/").then(|| (file.trim_end_matches('/').to_owned(), anchor))
        })
        .collect()
}

fn links(page: &str, line: &str) -> Vec<Cited> {
    let folder = Path::new(page).parent().unwrap_or(Path::new(""));
    line.split("](")
        .skip(1)
        .filter_map(|rest| rest.split_once(')').map(|(target, _)| target))
        .filter(|target| !target.contains(':') && !target.contains(' '))
        .map(|target| {
            let (file, anchor) = split(target);
            let file = if file.is_empty() { page.to_owned() } else { normal(&folder.join(file)) };
            (file, anchor)
        })
        .collect()
}

fn split(target: &str) -> Cited {
    match target.split_once('#') {
        Some((file, anchor)) => (file.to_owned(), Some(anchor.to_owned())),
        None => (target.to_owned(), None),
    }
}

fn normal(path: &Path) -> String {
    let mut parts = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => drop(parts.pop()),
            Component::CurDir => {}
            part => parts.push(part),
        }
    }
    parts.components().map(|part| part.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/")
}

fn decisions(line: &str) -> Vec<u32> {
    let line = line.to_lowercase();
    let number = |rest: &str| {
        let rest = rest.strip_prefix('s').unwrap_or(rest).strip_prefix(' ')?;
        let end = rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len());
        rest[..end].parse().ok()
    };
    line.split("decision").skip(1).filter_map(number).collect()
}

fn anchors(page: &str) -> BTreeSet<String> {
    let mut in_code = false;
    let mut seen = BTreeMap::new();
    let mut anchors = BTreeSet::new();
    for line in page.lines() {
        in_code ^= line.starts_with("```");
        let Some(heading) = line.strip_prefix('#').filter(|_| !in_code) else { continue };
        let Some(heading) = heading.trim_start_matches('#').strip_prefix(' ') else { continue };
        let anchor: String = text_of(heading)
            .to_lowercase()
            .chars()
            .filter(|&c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'))
            .map(|c| if c == ' ' { '-' } else { c })
            .collect();
        let times = seen.entry(anchor.clone()).and_modify(|times| *times += 1).or_insert(0);
        anchors.insert(if *times == 0 { anchor } else { format!("{anchor}-{times}") });
    }
    anchors
}

fn text_of(heading: &str) -> String {
    let mut text = String::new();
    let mut rest = heading.trim();
    while let Some((before, link)) = rest.split_once("](") {
        text += before;
        rest = link.split_once(')').map_or("", |(_, after)| after);
    }
    text + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the broken citations in a file. Beside it there are a page of the design and a decision. Each `^` is
    /// removed from the text, so that this source has no broken citation of its own.
    fn broken_in(path: &str, text: &str) -> Vec<String> {
        let mut files = BTreeMap::from([
            ("docs/design.md".to_owned(), "# Design\n\n## Air frame\n\n```\n# no heading\n```\n".to_owned()),
            ("docs/decisions/0015-one-voted-position.md".to_owned(), String::new()),
        ]);
        files.insert(path.to_owned(), text.replace('^', ""));
        broken(&files)
    }

    #[test]
    fn every_citation_of_this_workspace_leads_somewhere() {
        check().unwrap();
    }

    #[test]
    fn a_citation_of_what_is_missing_is_found() {
        for (text, what) in [
            ("/// As do^cs/designs.md says.", "there is no do^cs/designs.md"),
            ("see (do^cs/decisions/0099-x.md).", "there is no do^cs/decisions/0099-x.md"),
            ("// do^cs/design.md#air-frames", "do^cs/design.md has no heading with the anchor #air-frames"),
            ("// `do^cs/design.md#no-heading`.", "do^cs/design.md has no heading with the anchor #no-heading"),
            ("include_str!(\"../../do^cs/guide.md\")", "there is no do^cs/guide.md"),
            ("/// Deci^sion 14 has the rules.", "there is no deci^sion 14"),
            ("(des^ign, section 6)", "a section of the design by its number"),
            ("/// Des^ign section 6.", "a section of the design by its number"),
            ("//! See des^ign,\n//! section 6.", "a section of the design by its number"),
        ] {
            let found = broken_in("bench/src/lib.rs", text);
            let what = format!("bench/src/lib.rs:{}: {}", text.lines().count(), what.replace('^', ""));
            assert!(matches!(&found[..], [one] if one.starts_with(&what)), "{text}: {found:?}");
        }
    }

    #[test]
    fn a_citation_of_what_is_there_or_is_others_is_not_found() {
        for text in [
            "// do^cs/design.md#air-frame, and decision 15.",
            "include_str!(\"../../do^cs/design.md\")",
            "https://example.org/do^cs/nothing.md, their/do^cs/nothing.md, do^cs/*.md, do^cs/",
            "do^cs/decisions has them all; this decision has no number",
        ] {
            assert_eq!(broken_in("bench/src/lib.rs", text), [""; 0], "{text}");
        }
    }

    #[test]
    fn a_link_of_a_page_counts_from_its_folder() {
        let text = "[a](design.md) [b](design.md#air-frame) [c](../docs) [d](#here) [e](https://x.y/z.md)\n# Here!\n";
        assert_eq!(broken_in("docs/bench.md", text), [""; 0]);
        let found = broken_in("docs/bench.md", "[a](designs.md)\n[b](#there)\n[c](../do^cs/decisions/0001-x.md)");
        let what = [
            "do^cs/bench.md:1: there is no do^cs/designs.md",
            "do^cs/bench.md:2: do^cs/bench.md has no heading with the anchor #there",
            "do^cs/bench.md:3: there is no do^cs/decisions/0001-x.md",
        ];
        assert_eq!(found, what.map(|what| what.replace('^', "")));
    }

    #[test]
    fn the_second_heading_of_a_name_has_a_number() {
        let page = "# `a` and [b](c.md), d\n## x\n## x\n#no heading\n";
        assert_eq!(anchors(page).into_iter().collect::<Vec<_>>(), ["a-and-b-d", "x", "x-1"]);
    }
}
