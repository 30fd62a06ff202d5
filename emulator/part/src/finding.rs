//! What a part's models find wrong with the firmware's use of them.

use crate::Cycle;

/// The kind of a [`Finding`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FindingKind {
    /// An access where the part has nothing. The core took a bus fault.
    Unmapped,
    /// An access to a peripheral whose clock is off, or that the part refused.
    Refused,
    /// A register, a mode or a peripheral that is not modelled was used: what happened next is not what the part does.
    Unmodelled,
    /// An access inside a peripheral's block where the manual has no register. It read zero.
    Undefined,
    /// A state that the manual forbids or leaves undefined, which the part itself does not report.
    Misuse,
    /// Something was used that an erratum of the part spoils.
    Erratum,
    /// A bus controller was pointed where it cannot reach.
    Unreachable,
}

/// Something a run should answer for. The same words at the same place are listed once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// What it is.
    pub kind: FindingKind,
    /// The cycle it first came at.
    pub at: Cycle,
    /// The instruction whose access did it, where one did.
    pub pc: Option<u32>,
    /// The peripheral by its name in the manual, like `SPI1` or `TIMER0`.
    pub place: &'static str,
    /// What happened, in words.
    pub text: String,
    /// How often it came.
    pub count: u32,
}
