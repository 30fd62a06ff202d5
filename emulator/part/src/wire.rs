//! Signals and frames on a part's pins.

use crate::Cycle;

/// A pin of a part. The STM32's PA0 is pin 0 of port 0 and its PK15 pin 15 of port 10; the nRF52840's P1.05 is pin 5 of
/// port 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Pin {
    /// The number of the port, from 0.
    pub port: u8,
    /// The number of the pin in its port, from 0.
    pub number: u8,
}

impl Pin {
    /// Makes a pin of the number `number` in the port `port`.
    #[must_use]
    pub const fn new(port: u8, number: u8) -> Self {
        Self { port, number }
    }
}

/// The state in which a part holds a pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pad {
    /// The part drives the pin low or high.
    Driven(bool),
    /// The part only pulls the pin low or high with a resistor. Any other driver of the pin wins.
    Pulled(bool),
    /// The part lets the pin float.
    Floating,
}

impl Pad {
    /// The level of the pin if nothing outside drives it. A floating pin counts as low.
    #[must_use]
    pub const fn level(self) -> bool {
        matches!(self, Self::Driven(true) | Self::Pulled(true))
    }
}

/// The clock polarity and phase of SPI.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SpiMode {
    /// SCK is low between frames, and data are sampled at its first edge.
    Mode0,
    /// SCK is low between frames, and data are sampled at its second edge.
    Mode1,
    /// SCK is high between frames, and data are sampled at its first edge.
    Mode2,
    /// SCK is high between frames, and data are sampled at its second edge.
    Mode3,
}

/// One frame of a part's SPI controller, as it appears on the wires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpiFrame {
    /// The pins to which SCK is connected.
    pub sck: [Option<Pin>; 2],
    /// The pins to which MOSI is connected.
    pub mosi: [Option<Pin>; 2],
    /// The pin from which MISO is read.
    pub miso: Option<Pin>,
    /// The polarity and phase of the clock.
    pub mode: SpiMode,
    /// The number of bits, 4 to 32.
    pub bits: u8,
    /// The data. The first bit on the wire is the most significant of the low `bits` bits.
    pub data: u32,
    /// The cycle of the first clock edge.
    pub begins: Cycle,
    /// The cycle at which the last bit ends.
    pub ends: Cycle,
}

impl SpiFrame {
    /// The levels of SCK, each with its beginning in half bits after the first clock edge.
    pub fn clock_levels(&self) -> impl Iterator<Item = (u64, bool)> {
        let idle = matches!(self.mode, SpiMode::Mode2 | SpiMode::Mode3);
        (0..2 * u64::from(self.bits)).map(move |half| (half, (half % 2 == 0) != idle))
    }

    /// The levels of MOSI, each with its beginning in half bits after the first clock edge. If the first edge samples,
    /// the first bit begins half a bit earlier.
    pub fn mosi_levels(&self) -> impl Iterator<Item = (i64, bool)> {
        let early = i64::from(matches!(self.mode, SpiMode::Mode0 | SpiMode::Mode2));
        let (bits, data) = (self.bits, self.data);
        (0..bits).map(move |bit| (2 * i64::from(bit) - early, data >> (bits - 1 - bit) & 1 != 0))
    }
}

/// The parity of a UART frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UartParity {
    /// There is no parity bit.
    None,
    /// The number of ones is even, including the parity bit.
    Even,
    /// The number of ones is odd, including the parity bit.
    Odd,
}

/// One UART frame on a wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UartFrame {
    /// The data without parity. The least significant bit is sent first.
    pub data: u16,
    /// The number of data bits: 7, 8 or 9.
    pub bits: u8,
    /// The parity of the frame.
    pub parity: UartParity,
    /// The length of the stop bits, in half bits: 1, 2, 3 or 4.
    pub stop_halves: u8,
    /// The length of a bit in picoseconds.
    pub bit_ps: u64,
}

impl UartFrame {
    /// Makes an ordinary frame: eight bits, no parity, one stop bit.
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

    /// The levels of the line for start bit, data, parity and stop bits, each with its beginning in picoseconds after
    /// that of the frame. The line is high before and after the frame.
    pub fn levels(&self) -> impl Iterator<Item = (u64, bool)> {
        let data = self.data & ((1 << self.bits) - 1);
        let odd = data.count_ones() % 2 == 1;
        let parity = match self.parity {
            UartParity::None => None,
            UartParity::Even => Some(odd),
            UartParity::Odd => Some(!odd),
        };
        let bits = (0..self.bits).map(move |bit| data >> bit & 1 != 0);
        let levels = std::iter::once(false).chain(bits).chain(parity).chain([true]);
        (0..).zip(levels).map(|(nth, level)| (nth * self.bit_ps, level))
    }

    /// The length of the frame, with start and stop bits, in nanoseconds, to the nearest.
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

/// An action of an I2C controller on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum I2cEvent {
    /// The controller sends a start or repeated start, and then the address byte: seven bits of address, and 1 for
    /// reading.
    Start(u8),
    /// The controller sends a byte.
    Write(u8),
    /// The controller reads a byte. `true` means that it acknowledges the byte.
    Read(bool),
    /// The controller sends a stop.
    Stop,
}

/// The bus's answer to an action of an I2C controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct I2cAnswer {
    /// Whether a peripheral acknowledged a `Start` or a `Write`.
    pub acknowledged: bool,
    /// The byte of a `Read`, 0xFF if nobody drives the bus.
    pub data: u8,
    /// How long a peripheral stretches the clock, in nanoseconds.
    pub stretched_ns: u64,
}

impl I2cAnswer {
    /// The answer of an empty bus.
    pub const NOBODY: Self = Self { acknowledged: false, data: 0xFF, stretched_ns: 0 };
}
