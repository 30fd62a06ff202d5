//! Findings: reports of a part's models about the firmware's use of the part.

use crate::Cycle;

/// The kind of a [`Finding`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FindingKind {
    /// The firmware accessed an address at which the part has nothing. The core took a bus fault.
    Unmapped,
    /// The firmware accessed a peripheral whose clock is off, or the part refused the access.
    Refused,
    /// The firmware used a register, a mode or a peripheral without a model.
    Unmodelled,
    /// The firmware accessed an address inside a peripheral's block at which the manual has no register. It read zero.
    Undefined,
    /// The firmware brought about a state that the manual forbids or leaves undefined. The real part does not report
    /// it.
    Misuse,
    /// The firmware used a function of the part that does not work because of an erratum.
    Erratum,
    /// A bus controller was given an address that it cannot reach.
    Unreachable,
}

/// A report that matters for the result of a run. A finding that occurs again is only counted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The kind of the finding.
    pub kind: FindingKind,
    /// The cycle at which the finding first occurred.
    pub at: Cycle,
    /// The address of the instruction whose access caused the finding, if one did.
    pub pc: Option<u32>,
    /// The name of the peripheral in the manual, such as `SPI1` or `TIMER0`.
    pub place: &'static str,
    /// What happened, in words.
    pub text: String,
    /// The number of times that the finding occurred.
    pub count: u32,
}
