//! The effects that an instance of a peripheral has beyond its own registers, and its findings.

use std::collections::VecDeque;

use emulator_part::{Cycle, Finding, FindingKind, I2cEvent, Pad, UartFrame};

use crate::SpisEvent;
use crate::pin::Pin;

/// A peripheral ID, which is also the number of the peripheral's interrupt where it has one (PS 6.1).
pub(crate) type Id = usize;

/// A made-up ID for P0 and P1, which have none in the part.
pub(crate) const GPIO: Id = 0x30;
/// The ID of COMP and LPCOMP.
pub(crate) const COMP: Id = 0x13;

/// An effect of a peripheral beyond its own registers.
#[derive(Clone, Debug)]
pub(crate) enum Act {
    /// The event register at this address was set, which is passed to the PPI.
    Event(u32),
    /// The task register at this address is triggered.
    Task(u32),
    /// A peripheral takes a pin over and drives it (`Some`), or returns it to GPIO (`None`).
    Hold { pin: Pin, level: Option<bool> },
    /// A pad changed its level.
    Level { pin: Pin, level: bool },
    /// The state in which the part holds a pad changed.
    Pad { pin: Pin, pad: Pad },
    /// A channel of GPIOTE starts to watch its pin, and needs the pin's level.
    Sample { channel: usize },
    /// The DETECT signal rose (PS 6.9).
    Detect,
    /// The SPI controller of the serial block `id` has clocked one byte, which began at `begins`. `mosi` has the bits
    /// in the order of the wire.
    Exchange { id: Id, mosi: u8, begins: Cycle },
    /// The two-wire controller of the serial block `id` acts on its bus.
    TwoWire { id: Id, event: I2cEvent },
    /// A UART frame was sent on `pin`.
    Sent { pin: Pin, frame: UartFrame },
    /// The SAADC needs the voltages of its inputs.
    Convert,
    /// The comparator needs the voltages of its inputs.
    Compare,
    /// The semaphore of an SPIS changed, or a transaction ended, which is recorded for the outside.
    Spis { id: Id, event: SpisEvent },
    /// The clock controller changed the source of a clock.
    Clock(Source),
    /// The watchdog needs LFCLK to run.
    DemandLfclk,
    /// The part restarts.
    Restart,
    /// The part enters System OFF.
    Off,
    /// The flash controller stalls the core until this cycle.
    Stall(Cycle),
}

/// The new source of a clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    /// HFCLK comes from HFINT.
    HighInternal,
    /// HFCLK comes from HFXO.
    HighCrystal,
    /// LFCLK comes from the RC oscillator.
    LowRc,
    /// LFCLK comes from the crystal.
    LowCrystal,
    /// LFCLK is synthesised from HFCLK.
    LowSynthesised,
    /// LFCLK has stopped.
    LowStopped,
}

/// The maximum number of findings that are kept, so that firmware in a loop does not fill the host's memory.
const MOST: usize = 200;

/// What the instances pass to the interconnect.
#[derive(Clone, Debug, Default)]
pub(crate) struct Outbox {
    pub(crate) acts: VecDeque<Act>,
    pub(crate) findings: Vec<Finding>,
    /// The key of each finding. A repeated finding is only counted and not formatted again.
    known: Vec<(FindingKind, &'static str, &'static str)>,
    /// The address of the instruction whose access is being carried out.
    pub(crate) pc: Option<u32>,
}

impl Outbox {
    /// Reports `what` at `place`, with the value that went with its first occurrence. Repetitions are only counted.
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
