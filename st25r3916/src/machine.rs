//! The interface between a machine and its executor: the machine's steps and its inputs.

/// One register access or direct command: at most [`Short::MAX`] bytes, full duplex, with chip select low throughout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Short {
    bytes: [u8; Short::MAX],
    len: u8,
}

impl Short {
    /// The longest short transfer, bytes: enough for one register address and seven registers.
    pub const MAX: usize = 8;

    /// The bytes to clock out. The executor returns the same number of clocked-in bytes in [`Input::Done`].
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.len)).unwrap_or(&[])
    }

    /// The [`Short::bytes`], padded with zeros, for a copy whose cost does not depend on the number of bytes.
    #[must_use]
    pub const fn padded(&self) -> &[u8; Self::MAX] {
        &self.bytes
    }

    pub(crate) const fn new<const N: usize>(from: [u8; N]) -> Self {
        const { assert!(N >= 1 && N <= Self::MAX) };
        let mut bytes = [0; Self::MAX];
        let (head, _) = bytes.split_at_mut(N);
        head.copy_from_slice(&from);
        Self { bytes, len: N as u8 }
    }

    /// Returns a transfer of `head`, then `rest`: together at most [`Short::MAX`] bytes, further bytes are not sent.
    pub(crate) fn of(head: &[u8], rest: &[u8]) -> Self {
        let mut short = Self { bytes: [0; Self::MAX], len: 0 };
        // Not covered: the end of the slots, since a head and its rest fit, and the lengths of a rest that no setting
        // has, in the turns that the compiler has unrolled.
        for (slot, byte) in short.bytes.iter_mut().zip(head.iter().chain(rest)) {
            *slot = *byte;
            short.len += 1;
        }
        short
    }
}

/// One SPI transfer, with chip select low throughout: SPI mode 1 (CPOL 0, CPHA 1), most significant bit first, at most
/// 10 MHz (DS13541, SPI interface).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Transfer {
    /// Clock out [`Short::bytes`] and keep the bytes clocked in.
    Short(Short),
    /// FIFO load: clock out [`crate::command::FIFO_LOAD`] (one byte), then `frame[offset..offset + len]` of the
    /// caller's payload. The bytes clocked in are meaningless.
    Load {
        /// The offset of the first payload byte to clock out.
        offset: usize,
        /// The number of payload bytes, 1..=254.
        len: usize,
    },
    /// FIFO read: clock out [`crate::command::FIFO_READ`] (one byte), then clock `len` bytes into
    /// `buffer[offset..offset + len]` while zeros are clocked out.
    Read {
        /// The offset of the first byte in the caller's receive buffer.
        offset: usize,
        /// The number of bytes to read, ≥ 1; `offset + len` ≤ [`crate::listener::BUFFER`].
        len: usize,
    },
}

/// The executor's input to a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input<'a> {
    /// Begin, or continue after a [`Step::Event`].
    Start,
    /// The requested transfer has ended, and chip select is high again.
    ///
    /// After a [`Transfer::Short`] the bytes are those clocked in, as many as were sent (the first is meaningless).
    /// After a [`Transfer::Read`] they are the bytes just read. After a [`Transfer::Load`] there are none.
    Done(&'a [u8]),
    /// The IRQ pin is high. The input stands for the level, not for an edge: it is also due if the pin is already high
    /// when a machine returns [`Step::Wait`].
    Irq,
    /// The time of a [`Step::Wait`] or [`Step::Delay`] is over.
    Timeout,
    /// The executor could not carry out the requested transfer. The machine reports [`Fault::Bus`] and begins a
    /// bring-up.
    Failed,
}

/// A machine's request to its executor. Each call of a machine returns one step, in a bounded number of instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use = "the machine stands still until its step is carried out"]
pub enum Step<E> {
    /// Make this transfer, then give [`Input::Done`] or [`Input::Failed`].
    Transfer(Transfer),
    /// Give [`Input::Irq`] when the IRQ pin is or becomes high, or [`Input::Timeout`] after `us`, whichever is first.
    Wait {
        /// The time limit, µs. A late [`Input::Timeout`] is harmless, an early one is not.
        us: u32,
    },
    /// Give [`Input::Timeout`] after `us`, whatever the IRQ pin does.
    Delay {
        /// The duration, µs. A late [`Input::Timeout`] is harmless.
        us: u32,
    },
    /// An event for the caller, who gives [`Input::Start`] to continue.
    Event(E),
}

impl<E> Step<E> {
    /// Converts a step of one machine to a step of another. The function `event` converts the event, if the step has
    /// one.
    pub(crate) fn map<F>(self, event: impl FnOnce(E) -> Step<F>) -> Step<F> {
        // Not covered: the kinds of steps that a caller cannot have at its place, in the copies of this match that the
        // compiler has made for each of them.
        match self {
            Self::Transfer(transfer) => Step::Transfer(transfer),
            Self::Wait { us } => Step::Wait { us },
            Self::Delay { us } => Step::Delay { us },
            Self::Event(happened) => event(happened),
        }
    }
}

/// The reason why a state machine gave up its operation. After [`Input::Start`] the machine recovers by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Fault {
    /// The identity register read as 0x00 or 0xFF: no chip, no supply, or a broken MISO line.
    Absent,
    /// The identity register names another part; the value is the byte read.
    Identity(u8),
    /// No stable oscillator within [`crate::OSCILLATOR_US`].
    Oscillator,
    /// The supply measurement did not end within [`crate::MEASUREMENT_US`].
    SupplyMeasurement,
    /// The chip's supply (VDD) is below [`crate::SUPPLY_MIN_MV`] or above [`crate::SUPPLY_MAX_MV`].
    SupplyOutOfRange {
        /// The measured supply, mV, in steps of 23.4 mV.
        millivolts: u16,
    },
    /// The regulator adjustment did not end within [`crate::REGULATOR_US`].
    Regulator,
    /// A register differs from the driver's setting, at the end of bring-up or while the chip runs.
    Register {
        /// The address of the register, 0x00..=0x3F. In space B [`crate::register::SPACE_B`] is added.
        address: u8,
        /// The value that was set.
        expected: u8,
        /// The value that was read.
        found: u8,
    },
    /// The chip was reset since bring-up, by a power-up or a brown-out, and has lost its configuration.
    Reset,
    /// The fault of a listener or answerer: no frame was delivered for [`crate::listener::SILENCE_US`]. After each
    /// further silence in a row, that time is twice as long. A silent poller and a deaf listener look the same.
    Silence {
        /// Whether the chip detects the poller's field.
        field: bool,
    },
    /// The fault of a poller or exchange: the transmitter or the oscillator is off, although no command switched it
    /// off.
    FieldDropped,
    /// A response that no ST25R3916 gives (all ones, or of the wrong length), or a transfer that failed.
    Bus,
    /// A fault of sending: after the frame's air time and a margin, bytes are left in the FIFO and I_txe has not come.
    NoTransmitEnd,
    /// A fault of sending: the FIFO held a wrong number of bytes.
    FifoCount {
        /// The right number of bytes.
        expected: u16,
        /// The number of bytes in the FIFO.
        found: u16,
    },
    /// A fault of sending: the FIFO ran dry or over, so the frame is damaged.
    FifoFlow,
    /// The IRQ pin stays high although no interrupt bit is set.
    IrqStuck,
    /// The executor gave an input that does not answer the outstanding step.
    Executor,
}
