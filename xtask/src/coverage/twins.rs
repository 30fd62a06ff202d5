//! Sections of code that RTIC's lock has compiled twice.
//!
//! `rtic::export::lock` runs a section with the priority raised, or as it is if the task's priority is the resource's
//! ceiling already. A task always runs the same of the two copies, since its priority and the ceiling are constants,
//! but the compiler cannot know that and keeps both. A copy of which no instruction was executed, while the other was
//! executed, is that of another priority.

use std::collections::{BTreeMap, BTreeSet};

use super::image::Image;
use super::source::{Lock, Origin, Place};

/// The name that `explained.txt` calls these copies by.
pub(super) const NAME: &str = "other copy of a locked section";

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
}
