//! Faults of a receiver's bus, I2C or SPI.
//!
//! | fault | what happens | it is over |
//! |---|---|---|
//! | `SdaUntilClocked` | the receiver holds SDA low, as if cut off in a zero | after nine clocks, or at the end |
//! | `SdaStuck`, `SclStuck` | the line is low, whatever the controller does | at the end of the episode |
//! | `NoAnswer` | no address is acknowledged | at the end |
//! | `Stretches` | the clock is held for 20 ms after each address, which the data sheet allows | at the end |
//! | `Glitches` | SDA is pulled low for 1 µs every now and then | at the end |
//! | `Pulses` | likewise, ten times as often; never drawn | at the end |
//! | `Noise` | one in [`super::NOISE_ONE_IN`] of the bits read, also of the length, is inverted | at the end |
//! | `Ones`, `Zeros`, `Random`, `Shifted` | MISO is high, low, random, or a bit late | at the end |

use gnss_sim::Port;

/// A fault of a receiver's bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusFault {
    /// The receiver holds SDA low until the controller has made nine clocks.
    SdaUntilClocked,
    /// SDA stays low, whatever the controller does.
    SdaStuck,
    /// SCL stays low, whatever the controller does.
    SclStuck,
    /// The receiver acknowledges no address.
    NoAnswer,
    /// The receiver holds the clock for [`STRETCHED`] after each address.
    Stretches,
    /// SDA is pulled low for the time [`GLITCH`], at intervals of [`GLITCHES`].
    Glitches,
    /// SDA is pulled low for the time [`GLITCH`], at intervals of [`PULSES`]. Faults that are drawn are never this one.
    Pulses,
    /// Bits that are read over I2C are inverted.
    Noise,
    /// Every bit that is read on MISO is high.
    Ones,
    /// Every bit that is read on MISO is low.
    Zeros,
    /// Every bit that is read on MISO is random.
    Random,
    /// Every bit that is read on MISO comes one bit late.
    Shifted,
}

/// The longest time for which a receiver holds the clock low, ns: ZED-F9R data sheet 5.3.
pub const STRETCHED: u64 = 20_000_000;
/// The duration of a glitch, in which SDA is low, ns: less than half a bit at 400 kHz.
pub const GLITCH: u64 = 1_000;
/// The shortest and the longest time from one glitch to the next, ns.
pub const GLITCHES: (u64, u64) = (5_000, 400_000);
/// The shortest and the longest time from one pulse to the next, ns: so many that a controller must not serve each.
pub const PULSES: (u64, u64) = (5_000, 25_000);
/// The number of clocks after which a receiver that holds SDA low releases it: UM10204 (I2C specification) 3.1.16.
pub const CLOCKS: u32 = 9;

impl BusFault {
    /// All faults of a receiver's bus that are drawn.
    pub const ALL: [Self; 11] = [
        Self::SdaUntilClocked,
        Self::SdaStuck,
        Self::SclStuck,
        Self::NoAnswer,
        Self::Stretches,
        Self::Glitches,
        Self::Noise,
        Self::Ones,
        Self::Zeros,
        Self::Random,
        Self::Shifted,
    ];

    /// The receiver's interface on which the fault can occur.
    #[must_use]
    pub const fn interface(self) -> Port {
        match self {
            Self::Ones | Self::Zeros | Self::Random | Self::Shifted => Port::Spi,
            _ => Port::I2c,
        }
    }

    /// The shortest and the longest time from one glitch on SDA to the next, ns; `None` without any.
    #[must_use]
    pub const fn glitches(self) -> Option<(u64, u64)> {
        match self {
            Self::Glitches => Some(GLITCHES),
            Self::Pulses => Some(PULSES),
            _ => None,
        }
    }

    /// Returns the fault's name in the event log.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::SdaUntilClocked => "holds SDA until it is clocked",
            Self::SdaStuck => "SDA stuck low",
            Self::SclStuck => "SCL stuck low",
            Self::NoAnswer => "acknowledges no address",
            Self::Stretches => "stretches the clock",
            Self::Glitches => "glitches on SDA",
            Self::Pulses => "pulses on SDA",
            Self::Noise => "I2C with bit errors",
            Self::Ones => "MISO stuck high",
            Self::Zeros => "MISO stuck low",
            Self::Random => "MISO random",
            Self::Shifted => "MISO a bit late",
        }
    }
}
