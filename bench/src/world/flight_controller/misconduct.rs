//! The transactions of a flight controller that misuses the SSI.

use profile::criticality::{FlightController, Writer};
use profile::ssi::{Request, encode};
use profile::{Command, CommandObject, Identifier, crc};

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
    /// The number of transactions that [`Conduct::WritesEach`] has made.
    written: usize,
}

impl Misconduct {
    #[must_use]
    pub(super) const fn new(conduct: Conduct, config: Config, seed: u64) -> Self {
        Self { conduct, config, noise: Rng::new(seed), written: 0 }
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
            | Conduct::ReplaysUplink
            | Conduct::WritesEach => Rhythm::InCycle,
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
            Conduct::WritesEach => {
                let all = each();
                let (round, nth) = (self.written / all.len(), self.written % all.len());
                self.written += 1;
                let mosi = all[nth].clone();
                // A transaction may end with what is written, or read on.
                let bytes = if round % 2 == 0 { whole } else { mosi.len() };
                Order { mosi, ..read(bytes) }
            }
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

/// The timestamp of the objects that [`uplink`] and [`each`] write, ms.
const EARLY: u32 = 1_000;

/// Returns an empty request with an intact uplink object of the flight controller. The object's timestamp never
/// changes.
fn uplink() -> Vec<u8> {
    object(EARLY, Identifier::UPLINK_FLIGHT_CONTROLLER)
}

/// Returns an empty request, followed by an intact object.
fn object(timestamp: u32, identifier: Identifier) -> Vec<u8> {
    let mut object = vec![];
    object.extend(timestamp.to_le_bytes());
    object.extend(identifier.0.to_le_bytes());
    object.extend(0_u16.to_le_bytes());
    object.extend(0..52_u8);
    object.extend(crc::frame(&object).to_be_bytes());
    after_request(&object)
}

fn after_request(object: &[u8]) -> Vec<u8> {
    [&[0; profile::ssi::REQUEST_SIZE][..], object].concat()
}

fn command(timestamp: u32, command: Command) -> Vec<u8> {
    after_request(CommandObject::seal(Writer::<FlightController>::claim(), timestamp, command).as_bytes())
}

/// The timestamps of a writer, ms after the first: newer, equal, older, and three refused ones of which each is newer
/// than the one before, so that the last is accepted.
const STEPS: [u32; 10] = [0, 1, 1, 1, 0, (1 << 31) + 1, u32::MAX - 9, u32::MAX - 7, u32::MAX - 5, 2];

/// Returns every request and object that the DPR must refuse, and every order of timestamps.
fn each() -> Vec<Vec<u8>> {
    let mut all = vec![];
    for identifier in [Identifier::UPLINK_BASE_STATION, Identifier::UPLINK_FLIGHT_CONTROLLER] {
        all.extend(STEPS.map(|step| object(EARLY.wrapping_add(step), identifier)));
    }
    all.extend(STEPS.map(|step| command(EARLY.wrapping_add(step), Command::ClearCounters)));
    // The second self-test comes while the first runs.
    all.extend([10, 11].map(|step| command(EARLY + step, Command::SelfTest)));
    let damaged = |at: usize| {
        let mut bytes = uplink();
        bytes[at] ^= 1;
        bytes
    };
    all.extend([8, 12, 40, 71].map(damaged));
    all.push(object(EARLY, Identifier::GPS[0]));
    // An object of the flight controller's with the identifier of a command has no known word.
    all.push(object(EARLY + 20, Identifier::COMMAND));
    // A command with a byte behind its word.
    let mut with_more = command(EARLY + 21, Command::ClearCounters);
    with_more[8 + 20] = 1;
    let crc = crc::frame(&with_more[8..68]).to_be_bytes();
    with_more[68..].copy_from_slice(&crc);
    all.push(with_more);
    let too_long = |byte: u8| [uplink(), vec![byte; 5]].concat();
    all.extend([too_long(1), too_long(0xFF), [uplink(), vec![0; 7], vec![9]].concat()]);
    all.extend([1, 2, 3, 4, 6, 7].map(|beyond| [uplink(), vec![0x5A; beyond]].concat()));
    let outside = [Request { offset: 4_096, length: 64 }, Request { offset: 0, length: 0xFFFF }];
    all.extend(outside.map(|request| encode(request).to_vec()));
    let mut request = encode(Request { offset: 96, length: 60 });
    request[7] ^= 1;
    all.push(request.to_vec());
    all.extend([1, 2, 3, 4, 5, 6, 7].map(|length| request[..length].to_vec()));
    all.extend([1, 2, 8, 9, 12, 40, 72, 73].map(|length| vec![0xFF; length]));
    all.extend([9, 12, 16, 20, 24, 40, 41, 42, 43, 71].map(|length| uplink()[..length].to_vec()));
    all
}
