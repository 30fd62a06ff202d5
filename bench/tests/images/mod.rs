//! Where the release images are, which `cargo xtask test` builds before it runs these tests.

use std::path::PathBuf;

/// The image called `name` for so many receivers, or `None` (said) where the images were not built.
pub(crate) fn image(receivers: usize, name: &str) -> Option<PathBuf> {
    let Some(folder) = std::env::var_os("LINK_IMAGES").map(PathBuf::from) else {
        eprintln!("skipped: LINK_IMAGES is not set; `cargo xtask test` builds the images and sets it");
        return None;
    };
    Some(folder.join(format!("gps-{receivers}")).join(name))
}
