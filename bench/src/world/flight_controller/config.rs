//! The settings of the flight controller.

use profile::Layout;

use crate::world::ssi::Pace;

/// The instants at which the flight controller's transactions begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Schedule {
    /// A transaction begins in each control cycle of [`Config::cycle_ns`].
    EveryCycle,
    /// Transactions begin only at the instants given to [`FlightController::place`](super::FlightController::place).
    Placed,
}

/// A transaction that begins at an instant that the bench chooses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Placed {
    /// The instant at which chip select falls, in the bench's time, ns.
    pub at_ns: u64,
    /// The number of bytes that are clocked, at most those of the image.
    pub bytes: usize,
}

/// The settings of the flight controller's reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Config {
    /// The number of receivers in the profile: 1, 2, 3 or 5.
    pub receivers: usize,
    /// The instants at which transactions begin.
    pub schedule: Schedule,
    /// The length of the control cycle by the flight controller's own clock, ns.
    pub cycle_ns: u64,
    /// The instant of the first transaction after reset, by the flight controller's own clock, ns.
    pub first_ns: u64,
    /// The error of the flight controller's crystal, parts per billion; positive values are fast.
    pub crystal_ppb: i64,
    /// The pace of a transaction.
    pub pace: Pace,
    /// Whether the flight controller writes uplinks and commands, and reads the whole map ([`super::uplinks`]).
    pub writes: bool,
    /// Whether the base station's uplinks come by radio ([`FlightController::write`](super::FlightController::write)).
    /// Otherwise the flight controller makes them up.
    pub relays: bool,
    /// The seed of the commands to the active hold; `None` without a hold. With [`relays`](Self::relays) the base
    /// station's commands come by radio, and the flight controller generates none.
    pub hold: Option<u64>,
    /// The seed of all random values while the flight controller misuses the SSI.
    pub seed: u64,
}

impl Config {
    /// Returns the ordinary settings: a control cycle of 4 ms, a perfect crystal, and transactions as fast as allowed.
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
            hold: None,
            seed: 1,
        }
    }

    /// The size of the image, bytes.
    #[must_use]
    pub const fn image_len(&self) -> usize {
        self.layout().image_len()
    }

    /// The layout of the profile.
    ///
    /// # Panics
    ///
    /// Panics if a profile cannot have that number of receivers.
    #[must_use]
    pub const fn layout(&self) -> Layout {
        let layout = Layout::for_receivers(self.receivers).expect("a profile has 1, 2, 3 or 5 receivers");
        if self.hold.is_some() { layout.with_hold() } else { layout }
    }

    /// The time from the fall of chip select to its rise for `bytes` bytes, by the flight controller's clock, ns.
    #[must_use]
    pub const fn transaction_ns(&self, bytes: usize) -> u64 {
        self.pace.transaction_ns(bytes)
    }
}
