//! The vocabulary between a machine and its executor: what a machine asks for and what it is told.

/// One register access or direct command: at most [`Short::MAX`] bytes, full duplex, within one
/// chip-select-low period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Short {
    bytes: [u8; Short::MAX],
    len: u8,
}

impl Short {
    /// The longest short transfer, in bytes: enough for one register address and seven registers.
    pub const MAX: usize = 8;

    /// The bytes to clock out; the executor gives the machine as many bytes clocked in, in
    /// [`Input::Done`].
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.len)).unwrap_or(&[])
    }

    /// [`Short::bytes`] and zeros behind them: to be copied at a cost that does not depend on their number.
    #[must_use]
    pub const fn padded(&self) -> &[u8; Self::MAX] {
        &self.bytes
    }

    /// `N` bytes to send; checked at compile time to fit.
    pub(crate) const fn new<const N: usize>(from: [u8; N]) -> Self {
        const { assert!(N >= 1 && N <= Self::MAX) };
        let mut bytes = [0; Self::MAX];
        let (head, _) = bytes.split_at_mut(N);
        head.copy_from_slice(&from);
        Self { bytes, len: N as u8 }
    }

    /// `head`, then `rest`; together at most [`Short::MAX`] bytes, what is more is not sent.
    pub(crate) fn of(head: &[u8], rest: &[u8]) -> Self {
        let mut short = Self { bytes: [0; Self::MAX], len: 0 };
        for (slot, byte) in short.bytes.iter_mut().zip(head.iter().chain(rest)) {
            *slot = *byte;
            short.len += 1;
        }
        short
    }
}

/// One SPI transfer with chip select low from its first bit to its last.
///
/// SPI mode 1 (CPOL 0, CPHA 1), most significant bit first, at most 10 MHz (DS13541, SPI
/// interface).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Transfer {
    /// Clock out [`Short::bytes`], keep what comes in.
    Short(Short),
    /// FIFO load: clock out [`crate::command::FIFO_LOAD`] (one byte), then
    /// `frame[offset..offset + len]` of the payload the caller wants sent; what comes in means
    /// nothing.
    Load {
        /// First byte of the payload to clock out.
        offset: usize,
        /// Number of payload bytes, 1..=254.
        len: usize,
    },
    /// FIFO read: clock out [`crate::command::FIFO_READ`] (one byte), then clock `len` bytes into
    /// `buffer[offset..offset + len]`; what goes out meanwhile means nothing (send zeros).
    Read {
        /// Where the first byte lands in the caller's receive buffer.
        offset: usize,
        /// Number of bytes to read, ≥ 1; `offset + len` ≤ [`crate::listener::BUFFER`].
        len: usize,
    },
}

/// What the executor tells a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input<'a> {
    /// Begin, or go on after a [`Step::Event`].
    Start,
    /// The transfer asked for is over and chip select is high again.
    ///
    /// After a [`Transfer::Short`]: the bytes clocked in, as many as were sent (the first means
    /// nothing). After a [`Transfer::Read`]: the bytes just read, `buffer[offset..offset + len]`.
    /// After a [`Transfer::Load`]: nothing, `&[]`.
    Done(&'a [u8]),
    /// The IRQ pin is high (a level, not an edge: if it still is, or is again, when a machine asks
    /// for [`Step::Wait`], this input is due at once).
    Irq,
    /// The time of a [`Step::Wait`] or [`Step::Delay`] is over.
    Timeout,
    /// The transfer asked for could not be made (a DMA or bus error). Leads to [`Fault::Bus`] and
    /// a new bring-up.
    Failed,
}

/// What a machine asks of its executor. Every call to a machine returns exactly one step and costs
/// a constant number of instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use = "the machine stands still until its step is carried out"]
pub enum Step<E> {
    /// Make this transfer, then give [`Input::Done`] (or [`Input::Failed`]).
    Transfer(Transfer),
    /// Give [`Input::Irq`] when the IRQ pin is, or becomes, high, or [`Input::Timeout`] after
    /// `us`, whichever is first. Every wait has a bound: there is no wait for ever.
    Wait {
        /// The bound, in microseconds; being late is harmless, being early is not.
        us: u32,
    },
    /// Give [`Input::Timeout`] after `us`, whatever the IRQ pin does.
    Delay {
        /// How long, in microseconds; being late is harmless.
        us: u32,
    },
    /// Something the caller wants to know. Give [`Input::Start`] to go on.
    Event(E),
}

/// Why a machine gave up what it was doing. Every fault is followed by a recovery that the machine
/// does by itself once it is given [`Input::Start`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Fault {
    /// The identity register read as 0x00 or 0xFF: no chip, no supply, or a broken MISO line.
    Absent,
    /// The identity register names another part; the byte read.
    Identity(u8),
    /// No stable oscillator within [`crate::OSCILLATOR_US`].
    Oscillator,
    /// The supply measurement did not end within [`crate::MEASUREMENT_US`].
    SupplyMeasurement,
    /// The chip's supply (VDD) is below [`crate::SUPPLY_MIN_MV`] or above [`crate::SUPPLY_MAX_MV`].
    SupplyOutOfRange {
        /// As the chip measured it, in millivolts, in steps of 23.4 mV.
        millivolts: u16,
    },
    /// The regulator adjustment did not end within [`crate::REGULATOR_US`].
    Regulator,
    /// A register does not read as this driver has set it, at the end of bring-up or while the chip runs.
    Register {
        /// Its address, 0x00..=0x3F; in space B with [`crate::register::SPACE_B`] added.
        address: u8,
        /// What it was set to.
        expected: u8,
        /// What it reads as.
        found: u8,
    },
    /// The chip has lost its configuration since bring-up: a power-up reset or a brown-out.
    Reset,
    /// Listener: no frame was delivered for [`crate::listener::SILENCE_US`], or, after the first of these in a row, for
    /// twice as long each time. Whether the poller is silent or this chip is deaf cannot be told from here.
    Silence {
        /// The poller's field is there, as far as the chip says.
        field: bool,
    },
    /// Poller: the transmitter or the oscillator is off although nothing switched it off.
    FieldDropped,
    /// A response no ST25R3916 gives (all ones, or of the wrong length), or a transfer the executor
    /// reported as failed.
    Bus,
    /// Poller: bytes are left in the FIFO, and there was no I_txe, after the frame's air time and a margin.
    NoTransmitEnd,
    /// Poller: after a frame the FIFO held another number of bytes than it should.
    FifoCount {
        /// Bytes that it should hold.
        expected: u16,
        /// Bytes the FIFO says it holds.
        found: u16,
    },
    /// Poller: the FIFO ran dry or over: what was sent is damaged.
    FifoFlow,
    /// The IRQ pin stays high although no interrupt bit is set.
    IrqStuck,
    /// The executor gave an input that does not answer the step it was asked for.
    Executor,
}
