//! Checks what rustfmt and clippy do not: the width of each line, the length of each test's name, and the words with
//! which a comment begins.
//!
//! rustfmt limits code to 120 columns but leaves comments and string literals unchanged.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};

use crate::workspace::{root, tracked};

const COLUMNS: usize = 120;

/// Returns whether the file at `path` is checked. All hand-written sources are checked.
fn is_checked(path: &str) -> bool {
    let data = path.split('/').any(|folder| matches!(folder, "data" | "corpus"));
    let source = matches!(
        Path::new(path).extension().and_then(|end| end.to_str()),
        Some("rs" | "toml" | "sh" | "x" | "c" | "h" | "hpp")
    );
    (source || path == ".ci/run") && !data
}

const TEST_NAME: (usize, usize) = (12, 80);

/// The beginning of a comment that explains a gap of coverage. Its reason begins behind that.
const EXPLANATION: &str = "Not covered: ";

/// Words with which a comment may not begin, because they begin an incomplete sentence.
const OPENINGS: [&str; 7] = ["As", "Of", "Not", "Nothing of", "So long", "So many", "So much"];

/// Returns the names of tests in `text` that are too long, each with its line number, from 1.
fn long_names(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut is_test = false;
    text.lines().enumerate().filter_map(move |(index, line)| {
        let line = line.trim_start();
        let attribute = line.strip_prefix("#[").map(|rest| rest.split([']', '(']).next().unwrap_or(rest));
        is_test |= attribute.is_some_and(|name| name == "test" || name.ends_with("::test"));
        let (_, rest) = line.split_once("fn ").filter(|_| is_test && attribute.is_none())?;
        is_test = false;
        let name = rest.split(['(', '<']).next().unwrap_or(rest);
        (name.split('_').count() > TEST_NAME.0 || name.len() > TEST_NAME.1).then_some((index + 1, name))
    })
}

/// Returns the numbers, from 1, of lines in `text` at which a paragraph of a comment begins with one of [`OPENINGS`].
fn torn_openings(text: &str) -> impl Iterator<Item = usize> {
    let mut goes_on = false;
    text.lines().enumerate().filter_map(move |(index, line)| {
        let comment = line.trim_start().strip_prefix("//").map(|rest| rest.trim_start_matches(['/', '!']).trim_start());
        let begins = comment.filter(|_| !goes_on);
        goes_on = comment.is_some_and(|text| !text.is_empty());
        let begins = begins.map(|text| text.strip_prefix(EXPLANATION).unwrap_or(text));
        let begins_with = |opening: &&str| begins.is_some_and(|text| text.starts_with(&format!("{opening} ")));
        OPENINGS.iter().any(begins_with).then_some(index + 1)
    })
}

/// Returns the numbers, from 1, of lines in `text` that are too long, each with the line's width in characters.
fn too_long(text: &str) -> impl Iterator<Item = (usize, usize)> + '_ {
    text.lines()
        .enumerate()
        .map(|(index, line)| (index + 1, line.chars().count()))
        .filter(|&(_, width)| width > COLUMNS)
}

/// Checks every tracked file and prints each finding as `file:line: what`.
///
/// # Errors
///
/// A file has a finding, or git does not list the tracked files.
pub(crate) fn check() -> Result<()> {
    let (mut files, mut found) = (0, 0);
    for path in tracked()?.iter().filter(|path| is_checked(path)) {
        let text = std::fs::read_to_string(root().join(path)).with_context(|| format!("could not read {path}"))?;
        files += 1;
        let mut tell = |line: usize, what: String| {
            eprintln!("{path}:{line}: {what}");
            found += 1;
        };
        too_long(&text).for_each(|(line, width)| tell(line, format!("{width} columns, more than {COLUMNS}")));
        if path.ends_with(".rs") {
            let (words, characters) = TEST_NAME;
            let too_long = |name| format!("{name}: more than {words} words or {characters} characters");
            long_names(&text).for_each(|(line, name)| tell(line, too_long(name)));
            let openings = OPENINGS.join(", ");
            torn_openings(&text).for_each(|line| tell(line, format!("a comment begins with one of: {openings}")));
        }
    }
    ensure!(files > 0, "git lists no source file: is this a checkout?");
    if found > 0 {
        bail!("{found} lines are not as CONTRIBUTING.md wants them");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_too_long_from_121_characters_on_whatever_it_holds() {
        let fits = "x".repeat(120);
        let comment = format!("// {}", "x".repeat(118));
        let accents = "é".repeat(120);
        let text = format!("{fits}\n{comment}\r\n\n{accents}\n{accents}é");
        assert_eq!(too_long(&text).collect::<Vec<_>>(), [(2, 121), (5, 121)]);
    }

    #[test]
    fn a_tests_name_has_at_most_12_words_and_80_characters() {
        let [twelve, thirteen] = [12, 13].map(|words| vec!["a"; words].join("_"));
        let [fits, wide] = [80, 81].map(|length| "x".repeat(length));
        for (name, is_long) in [(&twelve, false), (&thirteen, true), (&fits, false), (&wide, true)] {
            for attribute in ["test", "tokio::test", "test(name)"] {
                let text = format!("mod tests {{\n    #[{attribute}]\n    #[ignore]\n    async fn {name}() {{}}\n}}\n");
                let expected = is_long.then_some((4, name.as_str()));
                assert_eq!(long_names(&text).next(), expected, "{attribute}: {name}");
            }
            assert_eq!(long_names(&format!("#[inline]\nfn {name}() {{}}\n")).next(), None);
        }
    }

    #[test]
    fn a_comment_does_not_begin_with_a_torn_word() {
        let text = [
            "/// Of this.",
            "/// Of that.",
            "fn f() {} // Of it",
            "    // So many of a kind.",
            "",
            "//! It.",
            "//!",
            "//! As it.",
        ];
        let text = format!("{}\n// Often so.\n", text.join("\n"));
        assert_eq!(torn_openings(&text).collect::<Vec<_>>(), [1, 4, 8]);
    }

    #[test]
    fn sources_and_scripts_are_checked_but_not_documents_or_data() {
        for path in ["xtask/src/lib.rs", "Cargo.toml", "dpr-fw/memory.x", "tools/install.sh", ".ci/run"] {
            assert!(is_checked(path), "{path}");
        }
        for path in
            ["Cargo.lock", "README.md", "docs/system.svg", "bench/data/flight.rs", "profile/fuzz/corpus/a.rs", ""]
        {
            assert!(!is_checked(path), "{path}");
        }
    }
}
