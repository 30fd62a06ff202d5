//! How the flight controller reads, and when.

use profile::Layout;

use crate::world::ssi::Pace;

/// When the flight controller's transactions begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Schedule {
    /// One in each of its own control cycles: [`Config::cycle_ns`].
    EveryCycle,
    /// Each at the instant that it was given with [`FlightController::place`](super::FlightController::place), and no
    /// other.
    Placed,
}

/// A transaction that is to begin at an instant of the bench's choice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Placed {
    /// When chip select falls, ns after reset, by the bench's clock.
    pub at_ns: u64,
    /// How many bytes are clocked: as many as are wanted, or the whole image.
    pub bytes: usize,
}

/// How the flight controller reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Config {
    /// Receivers in the profile: 1, 2, 3 or 5.
    pub receivers: usize,
    /// When transactions begin.
    pub schedule: Schedule,
    /// Control cycle by its own clock, ns.
    pub cycle_ns: u64,
    /// First transaction after reset, by its own clock, ns.
    pub first_ns: u64,
    /// How much faster its crystal runs than it should, parts per billion.
    pub crystal_ppb: i64,
    /// How fast a transaction goes.
    pub pace: Pace,
    /// It writes uplinks and commands, and reads the whole map now and then ([`super::uplinks`]); otherwise it reads
    /// the image alone and writes nothing.
    pub writes: bool,
    /// The base station's uplinks come by radio ([`FlightController::write`](super::FlightController::write)): of those
    /// that it writes it makes up none of the base station's.
    pub relays: bool,
    /// What is random while it misuses the SSI follows from this.
    pub seed: u64,
}

impl Config {
    /// 4 ms control cycle, a perfect crystal, first transaction one cycle after reset. On the wire it is as fast as
    /// [`profile::ssi::timing`] allows.
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

    /// Bytes of the image.
    #[must_use]
    pub const fn image_len(&self) -> usize {
        self.layout().image_len()
    }

    /// The profile's layout.
    ///
    /// # Panics
    ///
    /// If there is no profile for so many receivers: a bench set up so is wrong.
    #[must_use]
    pub const fn layout(&self) -> Layout {
        Layout::for_receivers(self.receivers).expect("a profile has 1, 2, 3 or 5 receivers")
    }

    /// From chip select falling to chip select rising in a transaction of so many bytes, by its own clock, ns.
    #[must_use]
    pub const fn transaction_ns(&self, bytes: usize) -> u64 {
        self.pace.transaction_ns(bytes)
    }
}
