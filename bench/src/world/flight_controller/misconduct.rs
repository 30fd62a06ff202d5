//! The transactions of a flight controller that misuses the SSI.

use profile::ssi::{Request, encode};
use profile::{Identifier, crc};

use super::Config;
use crate::faults::{Conduct, Rng};
use crate::world::ssi::{Filler, Order, Pace};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rhythm {
    /// A transaction begins in each control cycle, unless the transaction before is still under way.
    InCycle,
    /// Each transaction begins as soon as the gap after the previous one is over.
    AtOnce,
    /// There are no transactions.
    Never,
}

/// The number of bytes that [`Conduct::TenThousand`] reads in a transaction.
const MANY: usize = 10_000;

/// The number of bytes that [`Conduct::Lies`] reads in a transaction: Link-Status and Reported-Position.
const PART: usize = 96;

/// The most bytes that the DPR accepts in a transaction: a request and an uplink object (docs/design.md#ssi).
const TAKEN_IN: usize = 72;

/// The time from one fall of chip select to the next with [`Conduct::TogglesCsn`], ns.
const TOGGLE: u64 = 2_000;

/// The shortest time for which chip select is high, ns, with [`Conduct::Every`] (nRF52840 PS v1.7, 6.26.7,
/// t<sub>SPIS,CSNH</sub>).
const CSN_HIGH: u64 = 300;

/// How long [`Conduct::Hammers`] leaves chip select high between two transactions, ns.
const HAMMER_GAP: u64 = 1_000;

#[derive(Clone, Debug)]
pub(super) struct Misconduct {
    conduct: Conduct,
    config: Config,
    noise: Rng,
}

impl Misconduct {
    #[must_use]
    pub(super) const fn new(conduct: Conduct, config: Config, seed: u64) -> Self {
        Self { conduct, config, noise: Rng::new(seed) }
    }

    #[must_use]
    pub(super) const fn rhythm(&self) -> Rhythm {
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

    pub(super) fn order(&mut self) -> Order {
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

    fn noise(&mut self) -> Filler {
        Filler::Noise(Rng::new(self.noise.word()))
    }

    /// Returns an invalid request: it requests nothing, or a window that the DPR must refuse.
    fn lie(&mut self) -> Vec<u8> {
        let image_len = self.config.image_len() as u64;
        let below = |noise: &mut Rng, bound| u16::try_from(noise.below(bound)).unwrap_or(u16::MAX);
        match self.noise.below(5) {
            0 => encode(Request { offset: 4_096, length: 64 }).to_vec(),
            1 => encode(Request { offset: 0, length: 0xFFFF }).to_vec(),
            // The requested window begins within the image and ends beyond it.
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

/// Returns a transaction without a byte: chip select falls and rises once in `period_ns`.
fn edges(pace: Pace, period_ns: u64) -> Order {
    let low = period_ns / 2;
    Order { pace: Pace { setup_ns: low, hold_ns: 0, gap_ns: period_ns - low, ..pace }, ..Order::read(0) }
}

/// Returns an empty request with an intact uplink object of the flight controller. The object's timestamp never
/// changes.
fn uplink() -> Vec<u8> {
    let mut object = vec![];
    object.extend(1_000_u32.to_le_bytes());
    object.extend(Identifier::UPLINK_FLIGHT_CONTROLLER.0.to_le_bytes());
    object.extend(0_u16.to_le_bytes());
    object.extend(0..52_u8);
    object.extend(crc::frame(&object).to_be_bytes());
    [vec![0; profile::ssi::REQUEST_SIZE], object].concat()
}
