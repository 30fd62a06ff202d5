//! The DPR: nRF52840-DK with its front end and the SSI.

use emulator_part::{Pad, Pin, SpiFrame};
use nrf52840::{Nrf52840, SpisWires};
use st25r3916_model::Chip;

use super::front_end::{FrontEnd, Wires};
use emulator_node::{Board, Input};

/// The SSI's wires at the DPR.
pub const SSI: SpisWires =
    SpisWires { sck: Pin::new(1, 1), mosi: Pin::new(1, 2), miso: Pin::new(1, 3), csn: Pin::new(1, 4) };
/// The pin FRESH, by which the DPR announces a new image.
pub const FRESH: Pin = Pin::new(1, 5);
/// The wires of a front end on an nRF52840-DK: that of the DPR for HORUS, and the hold's own.
pub(super) const NRF_FRONT_END: Wires = Wires {
    sck: Pin::new(1, 15),
    mosi: Pin::new(1, 13),
    miso: Pin::new(1, 14),
    cs: Pin::new(1, 12),
    irq: Pin::new(0, 3),
};
/// The wires of the DPR's second front end, which receives from the hold and answers.
const HOLD_PORT: Wires = Wires {
    sck: Pin::new(1, 8),
    mosi: Pin::new(1, 7),
    miso: Pin::new(1, 6),
    cs: Pin::new(1, 10),
    irq: Pin::new(1, 11),
};
/// The DPR's board.
#[derive(Clone, Debug)]
pub struct Dpr {
    /// The front end that receives frames of HORUS.
    pub front_end: FrontEnd,
    /// The front end that answers the hold; `None` without a hold.
    pub hold_port: Option<FrontEnd>,
    powered: bool,
    fresh: bool,
    fresh_changes: Vec<(u64, bool)>,
}

impl Dpr {
    /// Returns the DPR's board with its SSI deselected. If `watched`, the traffic on the front end's bus is recorded.
    #[must_use]
    pub fn new(chip: Chip, watched: bool) -> Self {
        Self {
            front_end: FrontEnd::new(chip, NRF_FRONT_END, watched),
            hold_port: None,
            powered: false,
            fresh: false,
            fresh_changes: vec![],
        }
    }

    /// Returns the board with a second front end of this chip. That front end answers a hold.
    #[must_use]
    pub fn with_hold_port(self, chip: Chip) -> Self {
        Self { hold_port: Some(FrontEnd::new(chip, HOLD_PORT, false)), ..self }
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
        if let Some(port) = &mut self.hold_port {
            port.pin(at, pin, pad);
        }
    }

    fn spi(&mut self, begins: u64, ends: u64, frame: &SpiFrame) -> Option<u32> {
        let port = self.hold_port.as_mut().filter(|port| port.is_clocked_by(frame));
        port.unwrap_or(&mut self.front_end).spi(begins, ends, frame)
    }

    fn next_event(&self) -> u64 {
        let port = self.hold_port.as_ref().map_or(u64::MAX, FrontEnd::next_event);
        self.front_end.next_event().min(port)
    }

    fn settle(&mut self, at: u64, inputs: &mut Vec<Input>) {
        if !self.powered {
            self.powered = true;
            inputs.push(Input::Level(SSI.csn, Some(true)));
        }
        self.front_end.settle(at, inputs);
        if let Some(port) = &mut self.hold_port {
            port.settle(at, inputs);
        }
    }

    fn outgoing(&self) -> bool {
        self.front_end.has_air() || self.hold_port.as_ref().is_some_and(FrontEnd::has_air)
    }
}
