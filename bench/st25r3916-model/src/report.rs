//! What a run must not pass over in silence: accesses the model does not cover, and accesses the data sheet does not allow.
use core::fmt;

/// Which of the chip's three register spaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Space {
    /// Addressed directly.
    A,
    /// Behind prefix FB.
    B,
    /// Test registers, behind prefix FC.
    Test,
}

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
    /// A direct command whose effect is not modelled: nothing happened.
    UnmodelledCommand(u8),
    /// An SPI mode byte the data sheet does not define.
    UnknownModeByte(u8),
    /// A register whose function is not modelled was given a value other than its reset value: the value is kept, nothing more.
    UnmodelledRegister(Space, u8),
    /// A register the part does not have was accessed.
    NoSuchRegister(Space, u8),
    /// A read-only register was written.
    ReadOnlyWritten(Space, u8),
    /// An operation mode (03) that is not modelled was in force when a frame was to be sent or received.
    UnmodelledMode(u8),
    /// A bit rate (04) that is not modelled in this mode was in force when a frame was to be sent.
    UnmodelledBitRate(u8),
    /// The FIFO was accessed without a stable oscillator: bytes written are lost, bytes read are 0.
    FifoWithoutOscillator,
    /// A command that needs a stable oscillator came without one: ignored.
    CommandWithoutOscillator(u8),
    /// The mode (03) was written without a stable oscillator: ignored.
    ModeWithoutOscillator,
    /// A transmission was asked for without a field: ignored.
    TransmitWithoutField,
    /// A transmission was asked for while one was on the air: ignored.
    TransmitWhileBusy,
    /// A transmission of no bytes was asked for where the mode cannot: ignored.
    EmptyFrame,
    /// An NFC-F frame longer than its length byte can say.
    FrameTooLong(u16),
    /// A transmission ran out of FIFO bytes and broke off.
    TransmitUnderflow,
    /// More bytes than the FIFO holds: the excess was lost.
    FifoOverflow,
    /// The FIFO was read when it was empty.
    FifoUnderflow,
    /// A frame began to arrive while bytes of its predecessor were unread: they are lost.
    FrameOverwritten,
    /// SPI clock above the part's 10 MHz, Hz.
    SpiTooFast(u32),
    /// SPI clocks without chip select.
    NotSelected,
    /// Chip select asserted twice.
    SelectedTwice,
    /// A transfer ended after a prefix or an address that asked for more.
    TransferCutShort,
    /// An access while the part had no supply.
    NotPowered,
    /// sup3V (01, bit 7) does not suit the supply.
    SupplyMismatch,
    /// Initial field on (C8) with the external field detector off: collision avoidance sees nothing.
    CollisionAvoidanceBlind,
    /// A target was armed with automatic answers enabled (08) and its load modulator connected.
    AutomaticAnswersEnabled,
    /// The part answered: load modulation was, or would have been, on the air.
    LoadModulation,
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnmodelledCommand(c) => write!(f, "direct command {c:02X} is not modelled"),
            Self::UnknownModeByte(b) => write!(f, "SPI mode byte {b:02X} is not defined"),
            Self::UnmodelledRegister(s, a) => write!(f, "register {s:?} {a:02X}: its function is not modelled"),
            Self::NoSuchRegister(s, a) => write!(f, "register {s:?} {a:02X} does not exist in this part"),
            Self::ReadOnlyWritten(s, a) => write!(f, "register {s:?} {a:02X} is read-only and was written"),
            Self::UnmodelledMode(m) => write!(f, "mode (03) {m:02X} is not modelled"),
            Self::UnmodelledBitRate(r) => write!(f, "bit rate (04) {r:02X} is not modelled in this mode"),
            Self::FifoWithoutOscillator => write!(f, "FIFO access without a stable oscillator"),
            Self::CommandWithoutOscillator(c) => write!(f, "direct command {c:02X} without a stable oscillator"),
            Self::ModeWithoutOscillator => write!(f, "mode (03) written without a stable oscillator"),
            Self::TransmitWithoutField => write!(f, "transmission without a field"),
            Self::TransmitWhileBusy => write!(f, "transmission while another is on the air"),
            Self::EmptyFrame => write!(f, "transmission of no bytes"),
            Self::FrameTooLong(n) => write!(f, "NFC-F frame of {n} bytes does not fit its length byte"),
            Self::TransmitUnderflow => write!(f, "transmission ran out of FIFO bytes"),
            Self::FifoOverflow => write!(f, "FIFO overflow"),
            Self::FifoUnderflow => write!(f, "FIFO read when empty"),
            Self::FrameOverwritten => write!(f, "unread frame lost to its successor"),
            Self::SpiTooFast(hz) => write!(f, "SPI clock {hz} Hz is above 10 MHz"),
            Self::NotSelected => write!(f, "SPI clocks without chip select"),
            Self::SelectedTwice => write!(f, "chip select asserted twice"),
            Self::TransferCutShort => write!(f, "SPI transfer ended before what it announced"),
            Self::NotPowered => write!(f, "SPI access without supply"),
            Self::SupplyMismatch => write!(f, "sup3V does not suit the supply voltage"),
            Self::CollisionAvoidanceBlind => write!(f, "collision avoidance with the field detector off"),
            Self::AutomaticAnswersEnabled => write!(f, "target armed with automatic answers enabled"),
            Self::LoadModulation => write!(f, "load modulation: the part answered"),
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({} times, first at {} ns)", self.kind, self.count, self.first_ns)
    }
}

/// Distinct kinds kept; more cannot arise from one driver, only from noise on the bus.
const KINDS: usize = 512;

/// The list: one entry per kind.
#[derive(Clone, Debug, Default)]
pub(crate) struct Reports(Vec<Report>);

impl Reports {
    pub(crate) fn note(&mut self, at: u64, kind: Kind) {
        if let Some(r) = self.0.iter_mut().find(|r| r.kind == kind) {
            r.count += 1;
        } else if self.0.len() < KINDS {
            self.0.push(Report { first_ns: at, count: 1, kind });
        }
    }

    pub(crate) fn all(&self) -> &[Report] {
        &self.0
    }
}
