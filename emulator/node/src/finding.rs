//! What went wrong in a run, for a person and for a test.

use std::fmt;

/// The kind of a [`Finding`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FindingKind {
    /// The firmware's panic handler ran.
    Panic,
    /// The core took a HardFault.
    HardFault,
    /// An interrupt or exception without a handler of its own reached the default handler.
    UnhandledInterrupt,
    /// The core locked up: a fault inside the fault handler.
    Lockup,
    /// An access where the part has nothing. The core took a bus fault.
    Unmapped,
    /// An access the part refused: the peripheral's clock is off, or the bus answers with an error.
    Refused,
    /// An access to a register this bench does not model. Its value was stored or read back and nothing else happened.
    Unmodelled,
    /// An access inside a peripheral's block where the manual has no register. It read zero.
    Undefined,
    /// A state the manual forbids, which the part itself does not report.
    Misuse,
    /// Something was used that an erratum of the part spoils.
    Erratum,
    /// A bus controller was pointed at memory it cannot reach.
    Unreachable,
    /// The firmware's log lost bytes or carries a frame that does not decode.
    LogOverrun,
    /// The RTT control block holds what no firmware writes there, or a channel what its name does not promise.
    LogCorrupt,
    /// The firmware does nothing but restart.
    RestartLoop,
    /// The firmware ended the run itself with a status other than zero.
    ExitStatus,
    /// Something reached a board that was already past its instant: a message that took less time than the scheduler
    /// was told, or an actor beside the board that was not asked for its next instant. The run is not exact.
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
    /// Whether the firmware stopped doing its work, rather than doing something questionable on the way.
    #[must_use]
    pub fn is_fatal(self) -> bool {
        self.ends_run() || matches!(self, Self::Panic | Self::Unmapped | Self::ExitStatus)
    }

    /// Whether nothing more is to be expected of a firmware that runs alone.
    pub(crate) fn ends_run(self) -> bool {
        matches!(self, Self::HardFault | Self::UnhandledInterrupt | Self::Lockup | Self::RestartLoop)
    }
}

/// One thing that went wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// What it is.
    pub kind: FindingKind,
    /// When, in virtual nanoseconds.
    pub at: u64,
    /// The instruction that did it, where one did.
    pub pc: Option<u64>,
    /// That instruction as `function+offset (file:line)`, as far as the image says.
    pub symbol: Option<String>,
    /// What happened, in words.
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
