//! A flight controller's misuses of the SSI.
//!
//! The DPR must withstand all of them: no frame is lost, nothing else is disturbed, and the flight controller is served
//! again when it reads by the rules of docs/design.md#ssi. Times are by the flight controller's own clock. Unless
//! stated otherwise, a transaction has the set-up time, the bytes at 8 MHz, the hold time and the gap of that section
//! in SPI mode 0, and MOSI carries zeros, which request nothing.

use bench_judge::disturbance;
use emulator_part::SpiMode;

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
