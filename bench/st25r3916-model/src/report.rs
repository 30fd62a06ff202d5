//! What a run must not pass over in silence.
use core::fmt;

/// One kind of finding, with when it was first seen and how often.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Report {
    /// Virtual time of the first occurrence, ns.
    pub first_ns: u64,
    /// Occurrences.
    pub count: u64,
    /// What was found.
    pub kind: Kind,
}

/// What can be found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// A direct command that is not modelled.
    UnmodelledCommand(u8),
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:?}: {} times, first at {} ns",
            self.kind, self.count, self.first_ns
        )
    }
}
