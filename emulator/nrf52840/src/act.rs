//! The effects that an instance of a peripheral has beyond its own registers, and its findings.

use std::collections::VecDeque;

use emulator_part::{Cycle, Finding, FindingKind, I2cEvent, Pad, UartFrame};

use crate::SpisEvent;
use crate::pin::Pin;

/// A peripheral ID. It is also the number of the peripheral's interrupt, if it has one (PS 6.1).
pub(crate) type Id = usize;

/// The ID of P0 and P1 in this model. The real part gives them none.
pub(crate) const GPIO: Id = 0x30;
pub(crate) const COMP: Id = 0x13;

#[derive(Clone, Debug)]
pub(crate) enum Act {
    /// The event register at this address was set. The event goes to the PPI.
    Event(u32),
    /// The task register at this address is triggered.
    Task(u32),
    /// A peripheral takes a pin over and drives it (`Some`), or returns the pin to GPIO (`None`).
    Hold {
        pin: Pin,
        level: Option<bool>,
    },
    Level {
        pin: Pin,
        level: bool,
    },
    /// The part holds a pin in a new state.
    Pad {
        pin: Pin,
        pad: Pad,
    },
    /// A channel of GPIOTE starts to watch its pin and needs the pin's level.
    Sample {
        channel: usize,
    },
    /// The DETECT signal rose (PS 6.9).
    Detect,
    /// The SPI controller of the serial block `id` has clocked one byte, which began at `begins`. `mosi` is in the
    /// order of the wire.
    Exchange {
        id: Id,
        mosi: u8,
        begins: Cycle,
    },
    /// The two-wire controller of the serial block `id` acts on its bus.
    TwoWire {
        id: Id,
        event: I2cEvent,
    },
    Sent {
        pin: Pin,
        frame: UartFrame,
    },
    /// The SAADC needs the voltages of its inputs.
    Convert,
    /// The comparator needs the voltages of its inputs.
    Compare,
    /// The semaphore of an SPIS changed, or a transaction ended. This act only informs the outside of the part.
    Spis {
        id: Id,
        event: SpisEvent,
    },
    Clock(Source),
    /// The watchdog needs LFCLK to run.
    DemandLfclk,
    Restart,
    Off,
    /// The flash controller stalls the core until this cycle.
    Stall(Cycle),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    HighInternal,
    HighCrystal,
    LowRc,
    LowCrystal,
    /// LFCLK is synthesised from HFCLK.
    LowSynthesised,
    LowStopped,
}

/// The maximum number of findings that are kept, since firmware in a loop could make very many.
const MOST: usize = 200;

#[derive(Clone, Debug, Default)]
pub(crate) struct Outbox {
    pub(crate) acts: VecDeque<Act>,
    pub(crate) findings: Vec<Finding>,
    known: Vec<(FindingKind, &'static str, &'static str)>,
    pub(crate) pc: Option<u32>,
}

impl Outbox {
    /// Reports `what` at `place`. If the finding is known, only its count increases, and the finding keeps its first
    /// value.
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
