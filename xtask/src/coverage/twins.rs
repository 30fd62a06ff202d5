//! Sections of code that RTIC's lock has compiled twice.
//!
//! `rtic::export::lock` runs a section with the priority raised, or as it is if the task's priority is the resource's
//! ceiling already. A task always runs the same of the two copies, since its priority and the ceiling are constants,
//! but the compiler cannot know that and keeps both. A copy of which no instruction was executed, while the other was
//! executed, is that of another priority.

use std::collections::{BTreeMap, BTreeSet};

use super::image::Image;
use super::source::{Origin, Place};

/// The name that `explained.txt` calls these copies by.
pub(super) const NAME: &str = "other copy of a locked section";

/// Which copy of a locked section an instruction belongs to.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Lock {
    /// The lines of this workspace that lock, from the innermost to the outermost.
    pub(super) site: Vec<Place>,
    /// Whether the priority is raised.
    pub(super) raises: bool,
}

/// Returns which copy of a section of RTIC's lock an instruction belongs to, at `line` of the library's `file`: the
/// section without a raise is the last expression of the function. `None` for what surrounds the sections.
pub(super) fn raises(file: &str, function: &str, line: u32) -> Option<bool> {
    // The lines are those of version 1.1.4, which Cargo.lock names.
    let is_lock = file.ends_with("cortex-m-rtic-1.1.4/src/export.rs") && function.contains("lock");
    match line {
        221..=232 if is_lock => Some(true),
        235 if is_lock => Some(false),
        _ => None,
    }
}

/// Returns the addresses of the copies that belong to another priority.
pub(super) fn others(
    image: &Image,
    origins: &BTreeMap<u32, Origin>,
    is_executed: impl Fn(u32) -> bool,
) -> BTreeSet<u32> {
    let mut copies: BTreeMap<(usize, &[Place]), [Vec<u32>; 2]> = BTreeMap::new();
    for (&address, instruction) in &image.code {
        let Some(Lock { site, raises }) = &origins[&address].lock else { continue };
        copies.entry((instruction.function, site)).or_default()[usize::from(*raises)].push(address);
    }
    let mut others = BTreeSet::new();
    for [one, other] in copies.into_values() {
        let runs = |copy: &[u32]| copy.iter().any(|address| is_executed(*address));
        match (runs(&one), runs(&other)) {
            (true, false) => others.extend(other),
            (false, true) => others.extend(one),
            _ => {}
        }
    }
    others
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four instructions: two of the copy that raises the priority, two of the one that does not.
    fn others_if(executed: &[u32]) -> Vec<u32> {
        let image = Image::of(0x100, &[0xBF00, 0xBF00, 0xBF00, 0x4770], &[]);
        let site = vec![Place { file: "dpr-fw/src/main.rs".into(), line: 7 }];
        let lock = |address| Some(Lock { site: site.clone(), raises: address < 0x104 });
        let origin = |address| Origin { lock: lock(address), ..Origin::default() };
        let origins = image.code.keys().map(|address| (*address, origin(*address))).collect();
        others(&image, &origins, |address| executed.contains(&address)).into_iter().collect()
    }

    #[test]
    fn a_copy_that_never_runs_counts_if_its_twin_runs() {
        assert_eq!(others_if(&[0x100]), [0x104, 0x106]);
        assert_eq!(others_if(&[0x106]), [0x100, 0x102]);
        assert!(others_if(&[]).is_empty() && others_if(&[0x100, 0x106]).is_empty());
    }

    #[test]
    fn only_the_sections_of_rtic_s_lock_have_copies() {
        let file = "registry/cortex-m-rtic-1.1.4/src/export.rs";
        assert_eq!(raises(file, "rtic::export::lock", 229), Some(true));
        assert_eq!(raises(file, "rtic::export::lock", 235), Some(false));
        assert_eq!(raises(file, "rtic::export::lock", 220), None);
        assert_eq!(raises(file, "rtic::export::run", 229), None);
        assert_eq!(raises("dpr-fw/src/main.rs", "lock", 229), None);
    }
}
