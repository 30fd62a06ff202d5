//! Findings that must not pass unnoticed: accesses that the model does not cover, and accesses that the data sheet does
//! not allow.
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
    /// When the finding first occurred, virtual ns.
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
    /// The controller sent a direct command that is not modelled; the command had no effect.
    UnmodelledCommand(u8),
    /// Measure amplitude (D3) or Measure phase (D9) was used. The result is that of
    /// [`Config::amplitude`](crate::Config::amplitude) or [`Config::phase`](crate::Config::phase), whatever signal the
    /// antenna has. The field that silicon drives while it measures is not emitted.
    ConstantMeasurement(u8),
    /// The controller sent an SPI mode byte that the data sheet does not define.
    UnknownModeByte(u8),
    /// A register whose function is not modelled was set to another value than its reset value; the value is only
    /// stored.
    UnmodelledRegister(Space, u8),
    /// Bits whose function is not modelled (the third value) were set in a register that is modelled otherwise; the
    /// bits are only stored.
    UnmodelledBits(Space, u8, u8),
    /// A register that the part does not have was accessed.
    NoSuchRegister(Space, u8),
    /// A read-only register was written.
    ReadOnlyWritten(Space, u8),
    /// An operation mode (03) that is not modelled was in force when a frame was to be sent or received.
    UnmodelledMode(u8),
    /// A bit rate (04) that is not modelled in this mode was in force when a frame was to be sent or received.
    UnmodelledBitRate(u8),
    /// The FIFO was accessed without a stable oscillator: bytes written are lost, bytes read are 0.
    FifoWithoutOscillator,
    /// A command that needs a stable oscillator came without one; the command was ignored.
    CommandWithoutOscillator(u8),
    /// The mode register (03) was written without a stable oscillator; the write was ignored.
    ModeWithoutOscillator,
    /// A transmission was requested without a field; the request was ignored.
    TransmitWithoutField,
    /// A transmission was requested while another one was on the air; the request was ignored.
    TransmitWhileBusy,
    /// A transmission of no bytes was requested where the mode does not allow it; the request was ignored.
    EmptyFrame,
    /// An NFC-F frame was longer than its length byte can express.
    FrameTooLong(u16),
    /// A transmission ran out of FIFO bytes and broke off.
    TransmitUnderflow,
    /// The FIFO was cleared or read while a transmission still had to take bytes out of it. The bytes that were loaded
    /// for the transmission are not sent: the frame breaks off by an underflow when the byte on the air ends. If no
    /// byte of the frame was on the air yet, bytes that are loaded in time are sent instead.
    FifoDisturbed,
    /// The mode (03) or the bit rate (04) was changed during a frame. A frame being sent goes on unchanged, and one
    /// being received is dropped when the change concerns reception; no document describes silicon's behaviour.
    ChangedInFrame(u8),
    /// More bytes were written than the FIFO holds; the excess bytes were lost.
    FifoOverflow,
    /// The FIFO was read when it was empty.
    FifoUnderflow,
    /// A frame began to arrive while bytes of the frame before were unread in the FIFO; the unread bytes are lost.
    FrameOverwritten,
    /// The SPI clock was above the part's 10 MHz; the value is the clock rate, Hz.
    SpiTooFast(u32),
    /// The controller used another SPI mode than 1, so that bits are sampled one bit too early or too late.
    WrongSpiMode(u8),
    /// A transfer ended with fewer than eight clocks after its last byte; the bits of these clocks were lost.
    BitsLost(u8),
    /// The SPI clock ran without chip select.
    NotSelected,
    /// Chip select was asserted twice.
    SelectedTwice,
    /// A transfer ended after a prefix or an address that needs more bytes.
    TransferCutShort,
    /// The part was accessed without a supply.
    NotPowered,
    /// The setting of sup3V (01, bit 7) does not suit the supply voltage.
    SupplyMismatch,
    /// The supply voltage, mV, lies outside the part's range.
    SupplyOutOfRange(u16),
    /// Antenna tuning values (26, 27) were written and the antenna is used, but aat_en (01, bit 5) is clear, so they
    /// have no effect.
    AntennaTuningOff,
    /// A frame was received while a register of the receive chain had a value with which no public source receives its
    /// technology.
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
    /// A poller sent a frame of NFC-F while a register had a value with which the part cannot modulate NFC-F, or a
    /// combination that is not documented.
    Modulation {
        /// The register's space.
        space: Space,
        /// The register's address.
        address: u8,
        /// The register's value.
        value: u8,
    },
    /// The external field detector's lower threshold (2A, 2B, peer detection) is not below its upper one.
    FieldWithoutHysteresis(u8, u8),
    /// Initial field on (C8) came with the external field detector off, so collision avoidance cannot detect a field.
    CollisionAvoidanceBlind,
    /// A target was armed with automatic answers enabled (08) and its load modulator connected.
    AutomaticAnswersEnabled,
    /// The chip answered although it is not meant to ([`Config::answers`](crate::Config::answers)): load modulation
    /// was, or would have been, on the air.
    LoadModulation,
    /// The chip answered although it had received no frame since its last answer.
    AnswerUnasked,
    /// The first bit of an answer came before the guard time of NFC-F had passed, which is 2672 carrier cycles from the
    /// end of the frame. The value is the time from the end of the frame to the answer, ns.
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

/// The largest number of kinds of findings that are kept. One driver cannot cause more kinds; only noise on the bus
/// can.
const KINDS: usize = 512;

/// The list of findings, with one entry per kind.
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
