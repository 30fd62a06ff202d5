//! What an instance makes happen beyond its own registers, and what it found.

use std::collections::VecDeque;

use emulator_part::{Cycle, Finding, FindingKind, I2cEvent, Pad, UartFrame};

use crate::SpisEvent;
use crate::pin::Pin;

/// A peripheral ID, which is also the number of its interrupt where it has one (PS 6.1).
pub(crate) type Id = usize;

/// P0 and P1, which have no ID of their own.
pub(crate) const GPIO: Id = 0x30;
/// COMP and LPCOMP.
pub(crate) const COMP: Id = 0x13;

/// What a peripheral makes happen beyond its own registers.
#[derive(Clone, Debug)]
pub(crate) enum Act {
    /// The event register at this address was set: the PPI hears it.
    Event(u32),
    /// The task register at this address is triggered.
    Task(u32),
    /// A peripheral takes a pin over and drives it (`Some`), or gives it back to GPIO (`None`).
    Hold { pin: Pin, level: Option<bool> },
    /// A pad changed its level.
    Level { pin: Pin, level: bool },
    /// What the part does to a pad changed.
    Pad { pin: Pin, pad: Pad },
    /// A channel of GPIOTE starts to watch its pin.
    Sample { channel: usize },
    /// The DETECT signal rose (PS 6.9).
    Detect,
    /// The controller of the serial block `id` has clocked one byte, as it travels on the wire, begun at `begins`.
    Exchange { id: Id, mosi: u8, begins: Cycle },
    /// The two-wire controller of the serial block `id` acts on its bus.
    TwoWire { id: Id, event: I2cEvent },
    /// A frame left on `pin`.
    Sent { pin: Pin, frame: UartFrame },
    /// The converter wants the voltages of its inputs.
    Convert,
    /// The comparator wants the voltages of its inputs.
    Compare,
    /// An SPIS let the outside see something of its semaphore.
    Spis { id: Id, event: SpisEvent },
    /// The clock controller changed a source.
    Clock(Source),
    /// The watchdog wants LFCLK to run.
    DemandLfclk,
    /// The part restarts.
    Restart,
    /// The part enters System OFF.
    Off,
    /// The flash controller holds the core until then.
    Stall(Cycle),
}

/// A change of a clock's source, and the error it has from here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    /// HFINT.
    HighInternal,
    /// HFXO.
    HighCrystal,
    /// LFCLK from the RC oscillator.
    LowRc,
    /// LFCLK from the crystal.
    LowCrystal,
    /// LFCLK synthesised from HFCLK.
    LowSynthesised,
    /// No LFCLK.
    LowStopped,
}

/// Findings that are kept, so that a firmware in a loop does not fill the host's memory.
const MOST: usize = 200;

/// What the instances hand to the interconnect.
#[derive(Clone, Debug, Default)]
pub(crate) struct Outbox {
    pub(crate) acts: VecDeque<Act>,
    pub(crate) findings: Vec<Finding>,
    /// What each finding is known by: the same again only counts, and nothing is formatted.
    known: Vec<(FindingKind, &'static str, &'static str)>,
    /// The instruction whose access is being carried out.
    pub(crate) pc: Option<u32>,
}

impl Outbox {
    /// Notes `what` at `place`, with the first value that goes with it; the same again only counts.
    #[cold]
    pub(crate) fn find(&mut self, at: Cycle, kind: FindingKind, place: &'static str, what: &'static str, value: u32) {
        if let Some(n) = self.known.iter().position(|known| *known == (kind, place, what)) {
            self.findings[n].count = self.findings[n].count.saturating_add(1);
        } else if self.known.len() < MOST {
            self.known.push((kind, place, what));
            let text = format!("{what} {value:#x}");
            self.findings.push(Finding { kind, at, pc: self.pc, place, text, count: 1 });
        }
    }
}
