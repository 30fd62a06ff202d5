//! How a flight controller misuses the SSI.
//!
//! The DPR must bear all of it: no frame is lost, nothing else is upset, and it is served again when it reads as
//! docs/design.md#ssi wants it. Times are by the flight controller's own clock. Where nothing else is said, a
//! transaction has the set-up time, the bytes at 8 MHz, the hold time and the gap of that section in SPI mode 0, and
//! MOSI carries zeros, which ask for nothing.

use bench_judge::disturbance;
use emulator_part::SpiMode;
use profile::ssi::{Request, encode};
use profile::{Identifier, crc};

use super::Rng;
use crate::world::flight_controller::Config;
use crate::world::ssi::{Filler, Order, Pace};

/// How the flight controller behaves while an episode lasts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Conduct {
    /// Selects, clocks one byte and lets go, then selects again after 1 µs instead of the gap of 10 µs: 200 000
    /// transactions a second.
    Hammers,
    /// Selects and lets go without a clock, and keeps the gap: 77 000 transactions a second.
    ZeroBytes,
    /// Selects, and neither clocks nor lets go until the episode's end.
    Hangs,
    /// Selects and clocks noise until the episode's end: a million bytes a second.
    RunsAway,
    /// Reads 10 000 bytes in each transaction, in its control cycle as far as that leaves room: one takes 10 ms.
    TenThousand,
    /// Lets chip select fall for 1 µs and rise for 1 µs without a clock: 500 000 times a second.
    TogglesCsn,
    /// Clocks noise with chip select high until the episode's end: a million bytes a second. No transaction.
    ClocksWithoutCsn,
    /// Reads whole images one after the other with nothing but the gap between them: with three receivers 3 460
    /// transactions a second.
    BackToBack,
    /// Reads the whole image once in each control cycle, but in this SPI mode.
    OtherMode(SpiMode),
    /// Reads the whole image once in each control cycle, with noise on MOSI throughout.
    RandomBytes,
    /// Reads 96 bytes in each control cycle, and asks in turn at random for windows that do not exist, sends the first
    /// half of a request, and noise for a request and an uplink object.
    Lies,
    /// Reads the whole image once in each control cycle, and sends the same intact uplink object again and again.
    ReplaysUplink,
    /// No transaction at all.
    Silent,
    /// Lets chip select fall and rise without a clock, once in so many ns, each for half of them.
    Edges(u64),
    /// Reads so many bytes, none or more, with the set-up and hold times: once in so many ns, or where they do not
    /// suffice as soon as chip select was high for 0.3 µs.
    Every {
        /// From the beginning of one transaction to that of the next, ns.
        period_ns: u64,
        /// Bytes of each.
        bytes: usize,
    },
}

/// When a flight controller that misuses the SSI begins its transactions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rhythm {
    /// One in each of its control cycles in which the one before is over.
    InCycle,
    /// Each as soon as the one before is over, and the gap after it.
    AtOnce,
    /// There are none.
    Never,
}

impl Conduct {
    /// Each of them but those that have a rate, [`Self::Edges`] and [`Self::Every`].
    pub const ALL: [Self; 15] = [
        Self::Hammers,
        Self::ZeroBytes,
        Self::Hangs,
        Self::RunsAway,
        Self::TenThousand,
        Self::TogglesCsn,
        Self::ClocksWithoutCsn,
        Self::BackToBack,
        Self::OtherMode(SpiMode::Mode1),
        Self::OtherMode(SpiMode::Mode2),
        Self::OtherMode(SpiMode::Mode3),
        Self::RandomBytes,
        Self::Lies,
        Self::ReplaysUplink,
        Self::Silent,
    ];

    /// What the event log calls it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Hammers => "hammers",
            Self::ZeroBytes => "zero bytes",
            Self::Hangs => "hangs",
            Self::RunsAway => "runs away",
            Self::TenThousand => "ten thousand bytes",
            Self::TogglesCsn => "toggles chip select",
            Self::ClocksWithoutCsn => "clocks without chip select",
            Self::BackToBack => "back to back",
            Self::OtherMode(SpiMode::Mode0) => "mode 0",
            Self::OtherMode(SpiMode::Mode1) => "mode 1",
            Self::OtherMode(SpiMode::Mode2) => "mode 2",
            Self::OtherMode(SpiMode::Mode3) => "mode 3",
            Self::RandomBytes => "random bytes",
            Self::Lies => "lies",
            Self::ReplaysUplink => "replays uplink",
            Self::Silent => "silent",
            Self::Edges(_) => "edges of chip select",
            Self::Every { .. } => "transactions at a rate",
        }
    }

    /// What of it the judge has to know.
    #[must_use]
    pub const fn disturbs(self) -> disturbance::Conduct {
        match self {
            Self::Silent => disturbance::Conduct::Silent,
            _ => disturbance::Conduct::Misuse,
        }
    }
}

/// Bytes of [`Conduct::TenThousand`].
const MANY: usize = 10_000;

/// Bytes of [`Conduct::Lies`]: Link-Status and Reported-Position.
const PART: usize = 96;

/// Bytes that the DPR takes in: a request and an uplink object (docs/design.md#ssi).
const TAKEN_IN: usize = 72;

/// From one fall of chip select to the next with [`Conduct::TogglesCsn`], ns.
const TOGGLE: u64 = 2_000;

/// How long chip select is high at least with [`Conduct::Every`], ns: as long as the DPR's peripheral needs (nRF52840
/// PS v1.7, 6.26.7, t<sub>SPIS,CSNH</sub>).
const CSN_HIGH: u64 = 300;

/// What [`Conduct::Hammers`] leaves of the gap, ns.
const HAMMER_GAP: u64 = 1_000;

/// A [`Conduct`] that lasts.
#[derive(Clone, Debug)]
pub struct Misconduct {
    conduct: Conduct,
    config: Config,
    noise: Rng,
}

impl Misconduct {
    /// `conduct` of the flight controller with this configuration; what is random follows from `seed`.
    #[must_use]
    pub const fn new(conduct: Conduct, config: Config, seed: u64) -> Self {
        Self { conduct, config, noise: Rng::new(seed) }
    }

    /// When its transactions begin.
    #[must_use]
    pub const fn rhythm(&self) -> Rhythm {
        match self.conduct {
            Conduct::Hammers
            | Conduct::ZeroBytes
            | Conduct::Hangs
            | Conduct::RunsAway
            | Conduct::TogglesCsn
            | Conduct::ClocksWithoutCsn
            | Conduct::BackToBack
            | Conduct::Edges(_)
            | Conduct::Every { .. } => Rhythm::AtOnce,
            Conduct::TenThousand
            | Conduct::OtherMode(_)
            | Conduct::RandomBytes
            | Conduct::Lies
            | Conduct::ReplaysUplink => Rhythm::InCycle,
            Conduct::Silent => Rhythm::Never,
        }
    }

    /// Its next transaction.
    pub fn order(&mut self) -> Order {
        let pace = self.config.pace;
        let read = |bytes| Order { pace, ..Order::read(bytes) };
        let whole = self.config.image_len();
        match self.conduct {
            Conduct::Hammers => Order { pace: Pace { gap_ns: HAMMER_GAP, ..pace }, ..read(1) },
            Conduct::ZeroBytes => read(0),
            Conduct::Hangs | Conduct::Silent => Order { lets_go: false, ..read(0) },
            Conduct::RunsAway => Order { filler: self.noise(), ..read(Order::ENDLESS) },
            Conduct::TenThousand => read(MANY),
            Conduct::TogglesCsn => edges(pace, TOGGLE),
            Conduct::Edges(period_ns) => edges(pace, period_ns),
            Conduct::Every { period_ns, bytes } => {
                let gap_ns = period_ns.saturating_sub(pace.transaction_ns(bytes)).max(CSN_HIGH);
                Order { pace: Pace { gap_ns, ..pace }, ..Order::read(bytes) }
            }
            Conduct::ClocksWithoutCsn => Order { selects: false, filler: self.noise(), ..read(Order::ENDLESS) },
            Conduct::BackToBack => read(whole),
            Conduct::OtherMode(mode) => Order { mode, ..read(whole) },
            Conduct::RandomBytes => Order { filler: self.noise(), ..read(whole) },
            Conduct::Lies => Order { mosi: self.lie(), ..read(PART) },
            Conduct::ReplaysUplink => Order { mosi: uplink(), ..read(whole) },
        }
    }

    /// Noise that is another one in each transaction.
    fn noise(&mut self) -> Filler {
        Filler::Noise(Rng::new(self.noise.word()))
    }

    /// What is no request, or one that the DPR must refuse.
    fn lie(&mut self) -> Vec<u8> {
        let image_len = self.config.image_len() as u64;
        let below = |noise: &mut Rng, bound| u16::try_from(noise.below(bound)).unwrap_or(u16::MAX);
        match self.noise.below(5) {
            0 => encode(Request { offset: 4_096, length: 64 }).to_vec(),
            1 => encode(Request { offset: 0, length: 0xFFFF }).to_vec(),
            // From within the image to beyond its end.
            2 => {
                let offset = below(&mut self.noise, image_len);
                let length = below(&mut self.noise, 1_000) + 1;
                let rest = u16::try_from(image_len).unwrap_or(u16::MAX) - offset;
                encode(Request { offset, length: rest + length }).to_vec()
            }
            3 => encode(Request { offset: 96, length: 60 })[..4].to_vec(),
            _ => (0..TAKEN_IN).map(|_| self.noise.byte()).collect(),
        }
    }
}

/// Chip select falls and rises, once in `period_ns`.
fn edges(pace: Pace, period_ns: u64) -> Order {
    let low = period_ns / 2;
    Order { pace: Pace { setup_ns: low, hold_ns: 0, gap_ns: period_ns - low, ..pace }, ..Order::read(0) }
}

/// A request for nothing, and an intact uplink object of the flight controller from the first second.
fn uplink() -> Vec<u8> {
    let mut object = vec![];
    object.extend(1_000_u32.to_le_bytes());
    object.extend(Identifier::UPLINK_FLIGHT_CONTROLLER.0.to_le_bytes());
    object.extend(0_u16.to_le_bytes());
    object.extend(0..52_u8);
    object.extend(crc::frame(&object).to_be_bytes());
    [vec![0; profile::ssi::REQUEST_SIZE], object].concat()
}
