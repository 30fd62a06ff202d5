//! A flight controller's misuses of the SSI.
//!
//! The DPR must withstand all of these misuses. No frame is lost, and a flight controller that follows
//! docs/design.md#ssi again is served again. Times are by the flight controller's clock. Unless stated otherwise, a
//! transaction uses SPI mode 0 at 8 MHz with the design's times, and MOSI carries zeros.

use bench_judge::disturbance;
use emulator_part::SpiMode;

/// The flight controller's behaviour while an episode lasts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Conduct {
    /// The flight controller clocks one byte per transaction and pauses for only 1 µs: 200 000 transactions a second.
    Hammers,
    /// The flight controller selects and deselects the DPR 77 000 times a second without a clock, with the required gap
    /// between.
    ZeroBytes,
    /// The flight controller keeps the DPR selected without a clock until the episode's end.
    Hangs,
    /// The flight controller keeps the DPR selected and clocks noise until the episode's end: a million bytes a second.
    RunsAway,
    /// The flight controller reads 10 000 bytes in each transaction, which takes 10 ms.
    TenThousand,
    /// Chip select falls for 1 µs and rises for 1 µs without a clock, 500 000 times a second.
    TogglesCsn,
    /// The flight controller clocks noise while chip select is high: a million bytes a second outside any transaction.
    ClocksWithoutCsn,
    /// The flight controller reads whole images with only the gap between them: up to 3 460 transactions a second.
    BackToBack,
    /// The flight controller reads the whole image once in each control cycle, but in the given SPI mode.
    OtherMode(SpiMode),
    /// The flight controller reads the whole image once in each control cycle, with noise on MOSI throughout.
    RandomBytes,
    /// The flight controller reads 96 bytes in each control cycle. It requests windows that do not exist, sends half of
    /// a request, or sends noise in place of request and uplink object.
    Lies,
    /// The flight controller reads the whole image in each control cycle and always sends the same uplink object.
    ReplaysUplink,
    /// The flight controller writes a request or an object in each control cycle: in turn every one that the DPR must
    /// refuse, and every order of timestamps.
    WritesEach,
    /// The flight controller makes no transaction.
    Silent,
    /// Chip select falls and rises once in this period (ns) without a clock, and is low for half of it.
    Edges(u64),
    /// The flight controller reads `bytes` bytes (possibly none) once in `period_ns`. Chip select stays high for at
    /// least 0.3 µs between two reads.
    Every {
        /// The time from the beginning of one transaction to that of the next, ns.
        period_ns: u64,
        /// The number of bytes in each transaction.
        bytes: usize,
    },
}

impl Conduct {
    /// All kinds of misuse except [`Self::WritesEach`], and [`Self::Edges`] and [`Self::Every`], which have parameters.
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

    /// Returns the name of the misuse in the event log.
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
            Self::WritesEach => "writes each object",
            Self::Silent => "silent",
            Self::Edges(_) => "edges of chip select",
            Self::Every { .. } => "transactions at a rate",
        }
    }

    /// Returns the disturbance by which the judge determines what to excuse.
    #[must_use]
    pub const fn disturbs(self) -> disturbance::Conduct {
        match self {
            Self::Silent => disturbance::Conduct::Silent,
            _ => disturbance::Conduct::Misuse,
        }
    }
}
