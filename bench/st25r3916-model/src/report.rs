//! Findings: uses of the chip that the model does not cover or that the data sheet does not allow.
use core::fmt;

use crate::event::Technology;

/// One of the chip's three register spaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Space {
    /// The space whose registers are addressed without a prefix.
    A,
    /// The space whose registers are addressed behind prefix FB.
    B,
    /// The space of the test registers, which are addressed behind prefix FC.
    Test,
}

/// One kind of finding, with its first instant and its count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Report {
    /// The instant at which the finding first occurred, virtual ns.
    pub first_ns: u64,
    /// The number of times that the finding occurred.
    pub count: u64,
    /// The kind of finding.
    pub kind: Kind,
}

/// The kinds of findings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// A direct command that is not modelled was sent and had no effect.
    UnmodelledCommand(u8),
    /// Measure amplitude (D3) or phase (D9) was used. Its result in the model is a constant of
    /// [`Config`](crate::Config).
    ConstantMeasurement(u8),
    /// An SPI mode byte was sent that the data sheet does not define.
    UnknownModeByte(u8),
    /// A register whose function is not modelled was set to a value other than its reset value.
    UnmodelledRegister(Space, u8),
    /// Bits that are not modelled were set in a register whose other bits are modelled: space, address, bits.
    UnmodelledBits(Space, u8, u8),
    /// A register was accessed that this variant does not have.
    NoSuchRegister(Space, u8),
    /// A read-only register was written.
    ReadOnlyWritten(Space, u8),
    /// A frame was to be sent or received in an operation mode (register 03) that is not modelled.
    UnmodelledMode(u8),
    /// A frame was to be sent or received at a bit rate (register 04) that is not modelled in its mode.
    UnmodelledBitRate(u8),
    /// The FIFO was accessed without a stable oscillator. Bytes written are lost, bytes read are 0.
    FifoWithoutOscillator,
    /// A command that needs a stable oscillator came without one and was ignored.
    CommandWithoutOscillator(u8),
    /// The mode register, 03, was written without a stable oscillator. The write was ignored.
    ModeWithoutOscillator,
    /// A transmission was requested without a field and was ignored.
    TransmitWithoutField,
    /// A transmission was requested during another one and was ignored.
    TransmitWhileBusy,
    /// A transmission of no bytes was requested in a mode that does not allow it, and was ignored.
    EmptyFrame,
    /// An NFC-F frame was longer than its length byte can express.
    FrameTooLong(u16),
    /// A transmission ran out of FIFO bytes and broke off.
    TransmitUnderflow,
    /// The FIFO was cleared or read during a transmission that still needed its bytes. Those bytes are not sent, and
    /// the frame breaks off by an underflow when the byte on the air ends. If no byte was on the air yet, bytes that
    /// are loaded in time are sent instead.
    FifoDisturbed,
    /// The mode (register 03) or the bit rate (register 04) was changed during a frame. No document describes what
    /// silicon does then. In the model a frame being sent continues, and a frame being received is dropped if the
    /// change concerns reception.
    ChangedInFrame(u8),
    /// More bytes were written than the FIFO can hold, and the excess was lost.
    FifoOverflow,
    /// The FIFO was read when it was empty.
    FifoUnderflow,
    /// A frame began to arrive while the FIFO still held unread bytes of the frame before, which were lost.
    FrameOverwritten,
    /// The SPI clock was above 10 MHz, the chip's highest: its rate in Hz.
    SpiTooFast(u32),
    /// The controller used another SPI mode than 1. In such a mode bits are sampled too early or too late.
    WrongSpiMode(u8),
    /// A transfer ended within a byte, whose bits were lost. The value is the number of its clocks, 1 to 7.
    BitsLost(u8),
    /// The SPI clock ran without chip select.
    NotSelected,
    /// Chip select was asserted twice.
    SelectedTwice,
    /// A transfer ended after a prefix or an address that requires more bytes.
    TransferCutShort,
    /// The chip was accessed without a supply.
    NotPowered,
    /// The bit sup3V (register 01, bit 7) does not suit the supply voltage.
    SupplyMismatch,
    /// The supply voltage, mV, is outside the chip's range.
    SupplyOutOfRange(u16),
    /// The antenna was used with tuning values (registers 26, 27) that have no effect, because aat_en (register 01, bit
    /// 5) is clear.
    AntennaTuningOff,
    /// A frame was received with a value of the receive chain that no public source uses for its technology.
    ReceiveChain {
        /// The frame's technology.
        technology: Technology,
        /// The register's space.
        space: Space,
        /// The register's address.
        address: u8,
        /// The register's value.
        value: u8,
    },
    /// A poller sent a frame of NFC-F with a register value that cannot modulate NFC-F or is undocumented.
    Modulation {
        /// The register's space.
        space: Space,
        /// The register's address.
        address: u8,
        /// The register's value.
        value: u8,
    },
    /// The field detector's lower threshold (registers 2A, 2B, peer detection) is not below its upper one.
    FieldWithoutHysteresis(u8, u8),
    /// Initial field on (C8) was sent while the field detector was off, so collision avoidance could not detect a
    /// field.
    CollisionAvoidanceBlind,
    /// A target was armed while register 08 enabled automatic answers and the load modulator was connected.
    AutomaticAnswersEnabled,
    /// The chip answered although [`Config::answers`](crate::Config::answers) does not permit it. The answer need not
    /// have reached the air.
    LoadModulation,
    /// The chip answered although it had received no frame since its last answer.
    AnswerUnasked,
    /// An answer began within the guard time of NFC-F, 2672 carrier cycles. The value is the time from the frame's end
    /// to the answer, ns.
    AnswerTooEarly(u64),
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnmodelledCommand(c) => write!(f, "direct command {c:02X} is not modelled"),
            Self::ConstantMeasurement(c) => {
                write!(
                    f,
                    "direct command {c:02X} reads a constant: the antenna is not measured, and no field is driven"
                )
            }
            Self::UnknownModeByte(b) => write!(f, "SPI mode byte {b:02X} is not defined"),
            Self::UnmodelledRegister(s, a) => write!(f, "register {s:?} {a:02X}: its function is not modelled"),
            Self::NoSuchRegister(s, a) => write!(f, "register {s:?} {a:02X} does not exist in this part"),
            Self::ReadOnlyWritten(s, a) => write!(f, "register {s:?} {a:02X} is read-only and was written"),
            Self::UnmodelledBits(s, a, b) => write!(f, "register {s:?} {a:02X}: bits {b:02X} are not modelled"),
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
            Self::FifoDisturbed => write!(f, "FIFO cleared or read during a transmission"),
            Self::ChangedInFrame(a) => write!(f, "register {a:02X} changed during a frame"),
            Self::FifoOverflow => write!(f, "FIFO overflow"),
            Self::FifoUnderflow => write!(f, "FIFO read when empty"),
            Self::FrameOverwritten => write!(f, "unread frame lost to its successor"),
            Self::SpiTooFast(hz) => write!(f, "SPI clock {hz} Hz is above 10 MHz"),
            Self::WrongSpiMode(mode) => write!(f, "clocked in SPI mode {mode}, the chip's is 1"),
            Self::BitsLost(bits) => write!(f, "{bits} bits that make no whole byte were lost"),
            Self::NotSelected => write!(f, "SPI clocks without chip select"),
            Self::SelectedTwice => write!(f, "chip select asserted twice"),
            Self::TransferCutShort => write!(f, "SPI transfer ended before what it announced"),
            Self::NotPowered => write!(f, "SPI access without supply"),
            Self::SupplyMismatch => write!(f, "sup3V does not suit the supply voltage"),
            Self::SupplyOutOfRange(mv) => write!(f, "supply of {mv} mV is outside 2400 to 5500 mV"),
            Self::AntennaTuningOff => write!(f, "antenna tuning (26, 27) written with aat_en clear"),
            Self::ReceiveChain { technology, space, address, value } => {
                write!(f, "register {space:?} {address:02X} = {value:02X} does not suit reception of {technology:?}")
            }
            Self::Modulation { space, address, value } => {
                write!(f, "register {space:?} {address:02X} = {value:02X} does not suit modulation in NFC-F")
            }
            Self::FieldWithoutHysteresis(on, off) => {
                write!(f, "field detector without hysteresis: 2A = {on:02X}, 2B = {off:02X}")
            }
            Self::CollisionAvoidanceBlind => write!(f, "collision avoidance with the field detector off"),
            Self::AutomaticAnswersEnabled => write!(f, "target armed with automatic answers enabled"),
            Self::LoadModulation => write!(f, "load modulation: the part answered"),
            Self::AnswerUnasked => write!(f, "answer without a frame to answer"),
            Self::AnswerTooEarly(ns) => write!(f, "answer {ns} ns after its frame, before the guard time"),
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({} times, first at {} ns)", self.kind, self.count, self.first_ns)
    }
}

/// The largest number of kinds of findings that are kept. Only noise on the bus can cause so many.
const KINDS: usize = 512;

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

    pub(crate) fn take(&mut self) -> Vec<Report> {
        std::mem::take(&mut self.0)
    }
}
