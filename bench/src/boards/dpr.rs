//! The DPR: nRF52840-DK with its front end and the SSI.

use emulator_part::{Pad, Pin, SpiFrame};
use nrf52840::{Nrf52840, SpisWires};
use st25r3916_model::Chip;

use super::front_end::{FrontEnd, Wires};
use emulator_node::{Board, Input};

/// The SSI's wires at the DPR.
pub const SSI: SpisWires =
    SpisWires { sck: Pin::new(1, 1), mosi: Pin::new(1, 2), miso: Pin::new(1, 3), csn: Pin::new(1, 4) };
/// The pin on which the DPR announces a new image.
pub const FRESH: Pin = Pin::new(1, 5);
const DPR_FRONT_END: Wires = Wires {
    sck: Pin::new(1, 15),
    mosi: Pin::new(1, 13),
    miso: Pin::new(1, 14),
    cs: Pin::new(1, 12),
    irq: Pin::new(0, 3),
};
/// The DPR's board.
#[derive(Clone, Debug)]
pub struct Dpr {
    /// The DPR's front end.
    pub front_end: FrontEnd,
    powered: bool,
    fresh: bool,
    fresh_changes: Vec<(u64, bool)>,
}

impl Dpr {
    /// Returns the DPR's board with its SSI deselected. With `watched` the front end's bus traffic is recorded.
    #[must_use]
    pub fn new(chip: Chip, watched: bool) -> Self {
        Self {
            front_end: FrontEnd::new(chip, DPR_FRONT_END, watched),
            powered: false,
            fresh: false,
            fresh_changes: vec![],
        }
    }

    /// Takes the changes of FRESH's level since the last call, each with its instant, ns.
    pub fn take_fresh(&mut self) -> Vec<(u64, bool)> {
        std::mem::take(&mut self.fresh_changes)
    }
}

impl Board for Dpr {
    type Part = Nrf52840;

    fn pin(&mut self, at: u64, pin: Pin, pad: Pad) {
        if pin == FRESH && pad.level() != self.fresh {
            self.fresh = pad.level();
            self.fresh_changes.push((at, self.fresh));
        }
        self.front_end.pin(at, pin, pad);
    }

    fn spi(&mut self, begins: u64, ends: u64, frame: &SpiFrame) -> Option<u32> {
        self.front_end.spi(begins, ends, frame)
    }

    fn next_event(&self) -> u64 {
        self.front_end.next_event()
    }

    fn settle(&mut self, at: u64, inputs: &mut Vec<Input>) {
        if !self.powered {
            self.powered = true;
            inputs.push(Input::Level(SSI.csn, Some(true)));
        }
        self.front_end.settle(at, inputs);
    }

    fn outgoing(&self) -> bool {
        self.front_end.has_air()
    }
}
