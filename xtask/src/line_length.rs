//! Checks that no source line is longer than 120 columns, comments included.
//!
//! rustfmt wraps code at that width but leaves comments and string literals unchanged, so it does not detect them.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};

use crate::workspace::{root, tracked};

/// The longest line, in characters.
const COLUMNS: usize = 120;

/// Names of checked files: hand-written sources. Documents in Markdown, recorded data, test corpora and generated files
/// are not checked.
fn is_checked(path: &str) -> bool {
    let data = path.split('/').any(|folder| matches!(folder, "data" | "corpus"));
    let source = matches!(
        Path::new(path).extension().and_then(|end| end.to_str()),
        Some("rs" | "toml" | "sh" | "x" | "c" | "h" | "hpp")
    );
    (source || path == ".ci/run") && !data
}

/// Lines of `text` that are too long, counted from 1, each with its width in characters.
fn too_long(text: &str) -> impl Iterator<Item = (usize, usize)> + '_ {
    text.lines()
        .enumerate()
        .map(|(index, line)| (index + 1, line.chars().count()))
        .filter(|&(_, width)| width > COLUMNS)
}

/// Checks every tracked file and prints each line that is too long as `file:line: width`.
///
/// # Errors
///
/// There is such a line, or git does not list the tracked files.
pub(crate) fn check() -> Result<()> {
    let (mut files, mut found) = (0, 0);
    for path in tracked()?.iter().filter(|path| is_checked(path)) {
        let text = std::fs::read_to_string(root().join(path)).with_context(|| format!("could not read {path}"))?;
        files += 1;
        for (line, width) in too_long(&text) {
            eprintln!("{path}:{line}: {width} columns");
            found += 1;
        }
    }
    ensure!(files > 0, "git lists no source file: is this a checkout?");
    if found > 0 {
        bail!("{found} lines are longer than {COLUMNS} columns");
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
        // The line has 120 characters of two bytes each.
        let accents = "é".repeat(120);
        let text = format!("{fits}\n{comment}\r\n\n{accents}\n{accents}é");
        assert_eq!(too_long(&text).collect::<Vec<_>>(), [(2, 121), (5, 121)]);
    }

    #[test]
    fn sources_and_scripts_are_checked_but_not_documents_or_data() {
        for path in ["xtask/src/main.rs", "Cargo.toml", "dpr-fw/memory.x", "tools/install.sh", ".ci/run"] {
            assert!(is_checked(path), "{path}");
        }
        for path in
            ["Cargo.lock", "README.md", "docs/system.svg", "bench/data/flight.rs", "profile/fuzz/corpus/a.rs", ""]
        {
            assert!(!is_checked(path), "{path}");
        }
    }
}
