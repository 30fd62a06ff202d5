//! What travels on a part's pins.

use crate::Cycle;

/// A pin of a part, by its port and number: the STM32's PA0 is port 0 pin 0, its PK15 port 10 pin 15; the nRF52840's
/// P1.05 is port 1 pin 5.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Pin {
    /// The port, from 0.
    pub port: u8,
    /// The pin in it, from 0.
    pub number: u8,
}

impl Pin {
    /// Pin `number` of port `port`.
    #[must_use]
    pub const fn new(port: u8, number: u8) -> Self {
        Self { port, number }
    }
}

/// What a part does to a pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pad {
    /// It drives it low or high.
    Driven(bool),
    /// It only pulls it low or high, with a resistor: whatever else drives the pin wins.
    Pulled(bool),
    /// It lets it float.
    Floating,
}

impl Pad {
    /// The level where nothing outside drives the pin; a floating pin reads low here.
    #[must_use]
    pub const fn level(self) -> bool {
        matches!(self, Self::Driven(true) | Self::Pulled(true))
    }
}

/// Clock polarity and phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SpiMode {
    /// Idle low, sampled on the first edge.
    Mode0,
    /// Idle low, sampled on the second edge.
    Mode1,
    /// Idle high, sampled on the first edge.
    Mode2,
    /// Idle high, sampled on the second edge.
    Mode3,
}

/// One frame that a part's SPI controller clocks, as it is on the wires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpiFrame {
    /// The pins that SCK is connected to: none where no pin carries it.
    pub sck: [Option<Pin>; 2],
    /// The pins that MOSI is connected to.
    pub mosi: [Option<Pin>; 2],
    /// The pin that MISO is read from.
    pub miso: Option<Pin>,
    /// Polarity and phase of the clock.
    pub mode: SpiMode,
    /// How many bits, 4 to 32.
    pub bits: u8,
    /// The bits in the order they travel: the first one is the most significant of the `bits` low bits.
    pub data: u32,
    /// The first clock edge.
    pub begins: Cycle,
    /// The end of the last bit.
    pub ends: Cycle,
}

/// Parity of a UART frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UartParity {
    /// No parity bit.
    None,
    /// An even number of ones, the parity bit included.
    Even,
    /// An odd number.
    Odd,
}

/// One UART frame on a wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UartFrame {
    /// The data, without parity, least significant bit first on the wire.
    pub data: u16,
    /// Data bits: 7, 8 or 9.
    pub bits: u8,
    /// Parity.
    pub parity: UartParity,
    /// Length of the stop, in half bits: 1, 2, 3 or 4.
    pub stop_halves: u8,
    /// Length of a bit in picoseconds.
    pub bit_ps: u64,
}

impl UartFrame {
    /// An ordinary frame: eight bits, no parity, one stop bit.
    #[must_use]
    pub const fn eight_n_one(data: u8, baud: u32) -> Self {
        Self {
            data: data as u16,
            bits: 8,
            parity: UartParity::None,
            stop_halves: 2,
            bit_ps: 1_000_000_000_000 / baud as u64,
        }
    }

    /// The length of the whole frame, start bit included, in nanoseconds, to the nearest.
    #[must_use]
    pub const fn ns(&self) -> u64 {
        let parity = match self.parity {
            UartParity::None => 0,
            UartParity::Even | UartParity::Odd => 2,
        };
        let halves = 2 + 2 * self.bits as u64 + parity + self.stop_halves as u64;
        (halves * self.bit_ps / 2 + 500) / 1000
    }
}

/// What an I2C controller does on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum I2cEvent {
    /// A start, or repeated start, and the address byte: seven bits of address, then 1 for reading.
    Start(u8),
    /// A byte from the controller.
    Write(u8),
    /// The controller clocks a byte in; `true` where it will acknowledge it.
    Read(bool),
    /// A stop.
    Stop,
}

/// What the bus answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct I2cAnswer {
    /// A peripheral acknowledged (of `Start` and `Write`).
    pub acknowledged: bool,
    /// The byte of a `Read`: 0xFF where nobody drives the bus.
    pub data: u8,
    /// How long the clock is stretched, in nanoseconds.
    pub stretched_ns: u64,
}

impl I2cAnswer {
    /// An empty bus.
    pub const NOBODY: Self = Self { acknowledged: false, data: 0xFF, stretched_ns: 0 };
}
