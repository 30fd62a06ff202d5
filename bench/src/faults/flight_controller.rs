//! A flight controller's misuses of the SSI.
//!
//! The DPR must withstand all of them: no frame is lost, nothing else is disturbed, and the flight controller is served
//! again when it reads by the rules of docs/design.md#ssi. Times are by the flight controller's own clock. Unless
//! stated otherwise, a transaction has the set-up time, the bytes at 8 MHz, the hold time and the gap of that section
//! in SPI mode 0, and MOSI carries zeros, which request nothing.

use bench_judge::disturbance;
use emulator_part::SpiMode;
use profile::ssi::{Request, encode};
use profile::{Identifier, crc};

use super::Rng;
use crate::world::flight_controller::Config;
use crate::world::ssi::{Filler, Order, Pace};

/// The flight controller's behaviour while an episode lasts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Conduct {
    /// Selects, clocks one byte and deselects, then selects again after 1 µs instead of the gap of 10 µs: 200 000
    /// transactions a second.
    Hammers,
    /// Selects and deselects without a clock, and keeps the gap: 77 000 transactions a second.
    ZeroBytes,
    /// Selects, and neither clocks nor deselects until the episode's end.
    Hangs,
    /// Selects and clocks noise until the episode's end: a million bytes a second.
    RunsAway,
    /// Reads 10 000 bytes in each transaction, in as many control cycles as that allows: one takes 10 ms.
    TenThousand,
    /// Lets chip select fall for 1 µs and rise for 1 µs without a clock: 500 000 times a second.
    TogglesCsn,
    /// Clocks noise with chip select high until the episode's end, a million bytes a second, so there is no
    /// transaction.
    ClocksWithoutCsn,
    /// Reads whole images back to back with only the gap between them: 3 460 transactions a second with three
    /// receivers.
    BackToBack,
    /// Reads the whole image once in each control cycle, but in this SPI mode.
    OtherMode(SpiMode),
    /// Reads the whole image once in each control cycle, with noise on MOSI throughout.
    RandomBytes,
    /// Reads 96 bytes in each control cycle. At random it requests windows that do not exist, sends the first half of a
    /// request, or sends noise for a request and an uplink object.
    Lies,
    /// Reads the whole image once in each control cycle, and sends the same intact uplink object again and again.
    ReplaysUplink,
    /// Makes no transaction at all.
    Silent,
    /// Lets chip select fall and rise without a clock, with this period in ns, half of it low.
    Edges(u64),
    /// Reads `bytes` bytes, possibly none, with the set-up and hold times, once in `period_ns`; where that is too
    /// short, as soon as chip select has been high for 0.3 µs.
    Every {
        /// The time from the beginning of one transaction to that of the next, ns.
        period_ns: u64,
        /// The number of bytes in each.
        bytes: usize,
    },
}

/// The instants at which a flight controller that misuses the SSI begins its transactions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rhythm {
    /// One begins in each of its control cycles if the one before is over.
    InCycle,
    /// Each begins once the one before it and the gap after that are over.
    AtOnce,
    /// There are no transactions.
    Never,
}

impl Conduct {
    /// All conducts but those with a rate, [`Self::Edges`] and [`Self::Every`].
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

    /// Returns the conduct's name in the event log.
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

    /// The facts about it that the judge needs.
    #[must_use]
    pub const fn disturbs(self) -> disturbance::Conduct {
        match self {
            Self::Silent => disturbance::Conduct::Silent,
            _ => disturbance::Conduct::Misuse,
        }
    }
}

/// The bytes that [`Conduct::TenThousand`] reads.
const MANY: usize = 10_000;

/// The bytes that [`Conduct::Lies`] reads: Link-Status and Reported-Position.
const PART: usize = 96;

/// The bytes that the DPR accepts: a request and an uplink object (docs/design.md#ssi).
const TAKEN_IN: usize = 72;

/// The time from one fall of chip select to the next with [`Conduct::TogglesCsn`], ns.
const TOGGLE: u64 = 2_000;

/// The shortest time for which chip select is high with [`Conduct::Every`], ns: the DPR's peripheral needs as much
/// (nRF52840 PS v1.7, 6.26.7, t<sub>SPIS,CSNH</sub>).
const CSN_HIGH: u64 = 300;

/// The gap that [`Conduct::Hammers`] leaves, ns.
const HAMMER_GAP: u64 = 1_000;

/// A [`Conduct`] that lasts.
#[derive(Clone, Debug)]
pub struct Misconduct {
    conduct: Conduct,
    config: Config,
    noise: Rng,
}

impl Misconduct {
    /// The conduct `conduct` of a flight controller with this configuration; `seed` decides everything random.
    #[must_use]
    pub const fn new(conduct: Conduct, config: Config, seed: u64) -> Self {
        Self { conduct, config, noise: Rng::new(seed) }
    }

    /// The instants at which its transactions begin.
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

    /// Returns its next transaction.
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

    /// Noise that differs in each transaction.
    fn noise(&mut self) -> Filler {
        Filler::Noise(Rng::new(self.noise.word()))
    }

    /// Bytes that are no request, or a request that the DPR must refuse.
    fn lie(&mut self) -> Vec<u8> {
        let image_len = self.config.image_len() as u64;
        let below = |noise: &mut Rng, bound| u16::try_from(noise.below(bound)).unwrap_or(u16::MAX);
        match self.noise.below(5) {
            0 => encode(Request { offset: 4_096, length: 64 }).to_vec(),
            1 => encode(Request { offset: 0, length: 0xFFFF }).to_vec(),
            // The window reaches from within the image to beyond its end.
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

/// Lets chip select fall and rise once in `period_ns`.
fn edges(pace: Pace, period_ns: u64) -> Order {
    let low = period_ns / 2;
    Order { pace: Pace { setup_ns: low, hold_ns: 0, gap_ns: period_ns - low, ..pace }, ..Order::read(0) }
}

/// An empty request, and an intact uplink object of the flight controller from the first second.
fn uplink() -> Vec<u8> {
    let mut object = vec![];
    object.extend(1_000_u32.to_le_bytes());
    object.extend(Identifier::UPLINK_FLIGHT_CONTROLLER.0.to_le_bytes());
    object.extend(0_u16.to_le_bytes());
    object.extend(0..52_u8);
    object.extend(crc::frame(&object).to_be_bytes());
    [vec![0; profile::ssi::REQUEST_SIZE], object].concat()
}
