//! Reports of what went wrong in a run, for a person and for a test.

use std::fmt;

/// The kind of a [`Finding`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FindingKind {
    /// The firmware's panic handler ran.
    Panic,
    /// The core took a HardFault.
    HardFault,
    /// An interrupt or exception without its own handler reached the default handler.
    UnhandledInterrupt,
    /// The core locked up: a fault occurred inside the fault handler.
    Lockup,
    /// The firmware accessed an address at which the part has nothing. The core took a bus fault.
    Unmapped,
    /// The part refused an access: the peripheral's clock is off, or the bus answered with an error.
    Refused,
    /// The firmware accessed a register without a model. The register only stores values.
    Unmodelled,
    /// The firmware accessed an address inside a peripheral's block at which the manual has no register. It read zero.
    Undefined,
    /// The firmware brought about a state that the manual forbids, and that the real part does not report.
    Misuse,
    /// The firmware used a function of the part that does not work because of an erratum.
    Erratum,
    /// A bus controller was given an address that it cannot reach.
    Unreachable,
    /// The firmware's log lost bytes, or carries a frame that does not decode.
    LogOverrun,
    /// The RTT control block, or the data of a channel, is invalid.
    LogCorrupt,
    /// The firmware did nothing but restart, again and again.
    RestartLoop,
    /// The firmware ended the run itself with a status other than zero.
    ExitStatus,
    /// An input reached a board after the instant at which it was due, so the run is not exact. A message took less
    /// time than the stated lookahead, or an actor beside the board stated its next instant too late.
    Late,
}

impl From<emulator_part::FindingKind> for FindingKind {
    fn from(kind: emulator_part::FindingKind) -> Self {
        use emulator_part::FindingKind as OfPart;
        match kind {
            OfPart::Unmapped => Self::Unmapped,
            OfPart::Refused => Self::Refused,
            OfPart::Unmodelled => Self::Unmodelled,
            OfPart::Undefined => Self::Undefined,
            OfPart::Misuse => Self::Misuse,
            OfPart::Erratum => Self::Erratum,
            OfPart::Unreachable => Self::Unreachable,
        }
    }
}

impl FindingKind {
    /// Whether the firmware stopped its work.
    #[must_use]
    pub fn is_fatal(self) -> bool {
        self.ends_run() || matches!(self, Self::Panic | Self::Unmapped | Self::ExitStatus)
    }

    /// Whether the finding ends the run of a firmware that runs alone.
    pub(crate) fn ends_run(self) -> bool {
        matches!(self, Self::HardFault | Self::UnhandledInterrupt | Self::Lockup | Self::RestartLoop)
    }
}

/// A report of one thing that went wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The kind of the finding.
    pub kind: FindingKind,
    /// The instant of the finding, in virtual nanoseconds.
    pub at: u64,
    /// The address of the instruction that caused the finding, if one did.
    pub pc: Option<u64>,
    /// The instruction at `pc` as `function+offset (file:line)`, as far as the image has this information.
    pub symbol: Option<String>,
    /// A description of what happened, in words.
    pub text: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { kind, at, pc, symbol, text } = self;
        write!(formatter, "{:>14.6} ms  {kind:?}: {text}", *at as f64 / 1e6)?;
        match (symbol, pc) {
            (Some(symbol), Some(pc)) => write!(formatter, "\n{:18}in {symbol} ({pc:#010x})", ""),
            (_, Some(pc)) => write!(formatter, "\n{:18}at {pc:#010x}", ""),
            _ => Ok(()),
        }
    }
}
