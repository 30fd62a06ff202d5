//! The parts into which the code of an image is divided.

/// What an instruction is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Part {
    /// It leads only to a panic, or is part of one.
    Panic,
    /// It formats a message of the log, or hands it to the debug probe.
    Log,
    /// It decides what is valid, shown, or safe.
    Deciding,
    /// It is in the path from the tick to the answer on the SSI.
    Deadline,
    /// It is other code of this workspace.
    Other,
    /// It is code of a library that is not inlined into this workspace's.
    Library,
}

impl Part {
    /// The parts that count; panics and the log do not.
    pub(super) const COUNTED: [Self; 4] = [Self::Deciding, Self::Deadline, Self::Other, Self::Library];

    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Panic => "panics",
            Self::Log => "log",
            Self::Deciding => "deciding",
            Self::Deadline => "deadline path",
            Self::Other => "other own code",
            Self::Library => "libraries",
        }
    }

    /// Whether each gap needs an explanation.
    pub(super) const fn must_be_explained(self) -> bool {
        matches!(self, Self::Deciding | Self::Deadline)
    }
}
