//! The settings of the flight controller's reads.

use profile::Layout;

use crate::world::ssi::Pace;

/// The instants at which the flight controller's transactions begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Schedule {
    /// A transaction begins in each of the flight controller's own control cycles: [`Config::cycle_ns`].
    EveryCycle,
    /// Transactions begin only at the instants given with [`FlightController::place`](super::FlightController::place).
    Placed,
}

/// A transaction that is to begin at an instant that the bench chooses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Placed {
    /// The instant at which chip select falls, by the bench's clock, ns after reset.
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
    /// The length of the control cycle by the flight controller's own clock, ns.
    pub cycle_ns: u64,
    /// The instant of the first transaction after reset, by the flight controller's own clock, ns.
    pub first_ns: u64,
    /// The error of the flight controller's crystal, parts per billion; positive values are fast.
    pub crystal_ppb: i64,
    /// The pace of a transaction.
    pub pace: Pace,
    /// Whether the flight controller writes uplinks and commands, and now and then reads the whole map
    /// ([`super::uplinks`]); otherwise it only reads the image.
    pub writes: bool,
    /// Whether the base station's uplinks come by radio ([`FlightController::write`](super::FlightController::write)),
    /// so that the flight controller generates none of them itself.
    pub relays: bool,
    /// The seed of the commands to the active hold that the DPR shows; `None` without a hold.
    pub hold: Option<u64>,
    /// The seed of all random values while the flight controller misuses the SSI.
    pub seed: u64,
}

impl Config {
    /// Returns the ordinary settings: a control cycle of 4 ms, a perfect crystal, the first transaction one cycle after
    /// reset, and transactions as fast as [`profile::ssi::timing`] allows.
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

    /// The profile's layout.
    ///
    /// # Panics
    ///
    /// Panics if no profile has that number of receivers: the bench is set up wrongly.
    #[must_use]
    pub const fn layout(&self) -> Layout {
        let layout = Layout::for_receivers(self.receivers).expect("a profile has 1, 2, 3 or 5 receivers");
        if self.hold.is_some() { layout.with_hold() } else { layout }
    }

    /// The time from the fall of chip select to its rise in a transaction of `bytes` bytes, by the flight controller's
    /// own clock, ns.
    #[must_use]
    pub const fn transaction_ns(&self, bytes: usize) -> u64 {
        self.pace.transaction_ns(bytes)
    }
}
