//! Compares the public interfaces of the crates which others can use with those of the last release.
//!
//! A release is a heading with a date in CHANGELOG.md, and the git tag `v` with the same version. Before the first
//! release there is no interface to compare with.

use std::fs;
use std::process::Command;

use anyhow::{Context, Result, bail};

use crate::package::PACKAGES;
use crate::workspace::{SEMVER_CHECKS, cargo, check, install, root};

/// Returns the newest version with a date in a changelog's text. The newest version comes first: `## [1.2.3] -
/// 2027-01-31`.
fn released(changelog: &str) -> Option<&str> {
    let mut headings = changelog.lines().filter_map(|line| line.strip_prefix("## [")?.split_once("] - "));
    headings.next().map(|(version, _)| version)
}

/// Fails if a public interface changed since the last release more than the versions in the manifests allow.
pub(crate) fn check_interfaces() -> Result<()> {
    let path = root().join("CHANGELOG.md");
    let changelog = fs::read_to_string(&path).with_context(|| format!("could not read {}", path.display()))?;
    let Some(version) = released(&changelog) else {
        eprintln!("-- no version in CHANGELOG.md has a date, so no public interface has a baseline");
        return Ok(());
    };
    let tag = format!("v{version}");
    let known = Command::new("git")
        .args(["rev-parse", "--quiet", "--verify", &format!("{tag}^{{commit}}")])
        .current_dir(root())
        .output()
        .context("could not start git, which knows the releases' tags")?;
    if !known.status.success() {
        bail!("CHANGELOG.md has released {version}, but git has no tag {tag} to compare with (a shallow clone?)");
    }
    install(&SEMVER_CHECKS)?;
    let mut command = cargo();
    command.args(["semver-checks", "--baseline-rev", &tag]);
    command.args(PACKAGES.iter().flat_map(|package| ["--package", package]));
    check("cargo semver-checks", &mut command)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_heading_with_a_date_is_the_last_release() {
        let changelog =
            "# Changelog\n\n## [Unreleased]\n\n## [0.2.0] - 2027-01-31\n\ntext\n\n## [0.1.0] - 2026-12-01\n";
        assert_eq!(released(changelog), Some("0.2.0"));
    }

    #[test]
    fn a_changelog_without_a_date_has_no_release() {
        assert_eq!(released("# Changelog\n\n## [Unreleased]\n\n## [0.1.0]\n"), None);
    }
}
