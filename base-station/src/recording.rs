//! What a station knows of its recording. The recorder itself is left out of a page without a server.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

/// The names of the files that were made so far.
#[derive(Clone, Debug, Default)]
pub struct Made(Arc<Mutex<Vec<PathBuf>>>);

impl Made {
    /// Adds the name of a file that was made.
    #[cfg(feature = "recorder")]
    pub(crate) fn add(&self, name: PathBuf) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(name);
    }

    /// Returns the names of the files, in the order in which they were made.
    #[must_use]
    pub fn names(&self) -> Vec<PathBuf> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// The reason why nothing is recorded at present.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Trouble {
    /// The recorder's error as text.
    pub why: String,
    /// The instant since which nothing is recorded, µs.
    pub since_us: u64,
}
