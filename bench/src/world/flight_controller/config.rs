//! The settings of the flight controller's reads.

use profile::Layout;

use crate::world::ssi::Pace;

/// The instants at which the flight controller's transactions begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Schedule {
    /// One begins in each of its own control cycles: [`Config::cycle_ns`].
    EveryCycle,
    /// Each begins at an instant given with [`FlightController::place`](super::FlightController::place), and there are
    /// no others.
    Placed,
}

/// A transaction that is to begin at an instant of the bench's choice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Placed {
    /// The instant at which chip select falls, ns after reset, by the bench's clock.
    pub at_ns: u64,
    /// The number of bytes that are clocked, up to the whole image.
    pub bytes: usize,
}

/// The settings of the flight controller's reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Config {
    /// The number of receivers in the profile: 1, 2, 3 or 5.
    pub receivers: usize,
    /// The instants at which transactions begin.
    pub schedule: Schedule,
    /// The control cycle by its own clock, ns.
    pub cycle_ns: u64,
    /// The first transaction after reset, by its own clock, ns.
    pub first_ns: u64,
    /// The error of its crystal, parts per billion; positive values are fast.
    pub crystal_ppb: i64,
    /// The pace of a transaction.
    pub pace: Pace,
    /// It writes uplinks and commands, and reads the whole map now and then ([`super::uplinks`]); otherwise it only
    /// reads the image.
    pub writes: bool,
    /// The base station's uplinks come by radio ([`FlightController::write`](super::FlightController::write)), and it
    /// generates none of them itself.
    pub relays: bool,
    /// The seed of everything random while it misuses the SSI.
    pub seed: u64,
}

impl Config {
    /// A 4 ms control cycle, a perfect crystal, and the first transaction one cycle after reset. On the wire it is as
    /// fast as [`profile::ssi::timing`] allows.
    #[must_use]
    pub const fn new(receivers: usize) -> Self {
        Self {
            receivers,
            schedule: Schedule::EveryCycle,
            cycle_ns: 4_000_000,
            first_ns: 4_000_000,
            crystal_ppb: 0,
            pace: Pace::FASTEST,
            writes: false,
            relays: false,
            seed: 1,
        }
    }

    /// The size of the image, bytes.
    #[must_use]
    pub const fn image_len(&self) -> usize {
        self.layout().image_len()
    }

    /// The profile's layout.
    ///
    /// # Panics
    ///
    /// Panics if no profile has that number of receivers: the bench is set up wrongly.
    #[must_use]
    pub const fn layout(&self) -> Layout {
        Layout::for_receivers(self.receivers).expect("a profile has 1, 2, 3 or 5 receivers")
    }

    /// The time from chip select falling to chip select rising in a transaction of `bytes` bytes, by its own clock, ns.
    #[must_use]
    pub const fn transaction_ns(&self, bytes: usize) -> u64 {
        self.pace.transaction_ns(bytes)
    }
}
