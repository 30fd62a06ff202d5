//! How a flight controller misuses the SSI.
//!
//! The DPR must bear all of it: no frame is lost, nothing else is upset, and it is served again when it reads as
//! docs/design.md#ssi wants it. Times are by the flight controller's own clock. Where nothing else is said, a
//! transaction has the set-up time, the bytes at 8 MHz, the hold time and the gap of that section in SPI mode 0, and
//! MOSI carries zeros, which ask for nothing.

use bench_judge::disturbance;
use emulator_part::SpiMode;

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
