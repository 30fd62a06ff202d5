//! The verdict on a run.

use std::collections::BTreeMap;

use crate::{Figures, Violation};

/// A violation that occurred.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Broken {
    /// The violation.
    pub violation: Violation,
    /// How often the violation occurred.
    pub count: u64,
    /// The instant, ns, at which the violation first occurred.
    pub first_at: u64,
    /// A description of the first occurrence, with its measured values.
    pub words: String,
}

impl std::fmt::Display for Broken {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}, at {:.6} ms", self.violation, self.words, self.first_at as f64 / 1e6)?;
        if self.count > 1 {
            write!(f, " (and {} more)", self.count - 1)?;
        }
        Ok(())
    }
}

/// The violations found so far.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Findings(BTreeMap<Violation, Broken>);

impl Findings {
    /// Records a violation at the instant `at`, ns. `words` describes it, and is called only for the first occurrence.
    pub fn add(&mut self, violation: Violation, at: u64, words: impl FnOnce() -> String) {
        self.0.entry(violation).and_modify(|broken| broken.count += 1).or_insert_with(|| Broken {
            violation,
            count: 1,
            first_at: at,
            words: words(),
        });
    }

    /// Returns how often a violation has occurred so far.
    #[must_use]
    pub fn count(&self, violation: Violation) -> u64 {
        self.0.get(&violation).map_or(0, |broken| broken.count)
    }

    /// Returns the violations that have occurred so far, with their counts.
    pub fn counts(&self) -> impl Iterator<Item = (Violation, u64)> + '_ {
        self.0.values().map(|broken| (broken.violation, broken.count))
    }

    pub(crate) fn into_broken(self) -> Vec<Broken> {
        self.0.into_values().collect()
    }
}

/// The result of judging a log.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verdict {
    /// Every violation that occurred, in the order of [`Violation`].
    pub violations: Vec<Broken>,
    /// The measured figures of the run.
    pub figures: Figures,
}

impl Verdict {
    /// Returns the kinds of violations that occurred.
    pub fn kinds(&self) -> impl Iterator<Item = Violation> + '_ {
        self.violations.iter().map(|broken| broken.violation)
    }
}
