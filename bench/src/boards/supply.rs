//! Applies a [`PowerFault`] to the supply, the reset pin or the crystal of a board.

use cortex_m4::Cost;
use emulator_node::{Board, FromOutside, Node};
use st25r3916_model::Chip;

use super::front_end::FrontEnd;
use super::{Dpr, Hold, Horus};
use crate::faults::PowerFault;
use crate::faults::power::RAILS_UV;

/// The lowest supply of a front end, µV (DS13541, operating conditions). The model switches the chip off below it.
const FRONT_END_UV: u32 = 2_400_000;

/// A board whose front end has a supply that can fail.
pub trait Powered: Board {
    /// The board's front end.
    fn front_end(&mut self) -> &mut FrontEnd;

    /// Switches the supply of all chips except the microcontroller on or off at `at` (ns).
    fn supply_chips(&mut self, at: u64, on: bool) {
        self.front_end().supply(at, on);
    }

    /// Read access to the chip of the board's front end.
    fn chip(&self) -> &Chip;

    /// Makes the board's crystal work (`works`) or fail from now on.
    fn crystal<C: Cost>(node: &mut Node<Self, C>, works: bool);

    /// Makes the microcontroller's crystals faster by `ppb` parts per billion from now on.
    fn drift<C: Cost>(node: &mut Node<Self, C>, ppb: i64);

    /// Whether the firmware of `part` does not start after a reset and waits for the watchdog to bite.
    fn cannot_start(part: &Self::Part) -> bool;
}

const CRYSTAL_STARTS: u64 = 360_000;

impl Powered for Horus {
    fn crystal<C: Cost>(node: &mut Node<Self, C>, works: bool) {
        node.input(|part, view, at| if works { part.restore_hse(at, view) } else { part.fail_hse(at, view) });
    }

    fn drift<C: Cost>(node: &mut Node<Self, C>, ppb: i64) {
        node.input(|part, view, at| part.drift_hse(at, ppb, view));
    }

    /// The DPR always starts, because its firmware uses the internal oscillator if the crystal does not start.
    fn cannot_start(_: &Self::Part) -> bool {
        false
    }

    fn front_end(&mut self) -> &mut FrontEnd {
        &mut self.front_end
    }

    fn chip(&self) -> &Chip {
        self.front_end.chip()
    }
}

impl Powered for Dpr {
    fn crystal<C: Cost>(node: &mut Node<Self, C>, works: bool) {
        node.input(|part, _, _| part.set_hfxo_startup(works.then_some(CRYSTAL_STARTS)));
    }

    fn drift<C: Cost>(node: &mut Node<Self, C>, ppb: i64) {
        node.input(|part, view, at| part.drift(at, ppb, view));
    }

    fn cannot_start(part: &Self::Part) -> bool {
        !part.has_hfxo()
    }

    fn front_end(&mut self) -> &mut FrontEnd {
        &mut self.front_end
    }

    fn supply_chips(&mut self, at: u64, on: bool) {
        self.front_end.supply(at, on);
        if let Some(port) = &mut self.hold_port {
            port.supply(at, on);
        }
    }

    fn chip(&self) -> &Chip {
        self.front_end.chip()
    }
}

impl Powered for Hold {
    fn crystal<C: Cost>(node: &mut Node<Self, C>, works: bool) {
        node.input(|part, _, _| part.set_hfxo_startup(works.then_some(CRYSTAL_STARTS)));
    }

    fn drift<C: Cost>(node: &mut Node<Self, C>, ppb: i64) {
        node.input(|part, view, at| part.drift(at, ppb, view));
    }

    fn cannot_start(part: &Self::Part) -> bool {
        !part.has_hfxo()
    }

    fn front_end(&mut self) -> &mut FrontEnd {
        &mut self.front_end
    }

    fn supply_chips(&mut self, at: u64, on: bool) {
        self.front_end.supply(at, on);
        if on {
            self.payload.power_on(at);
        }
    }

    fn chip(&self) -> &Chip {
        self.front_end.chip()
    }
}

impl PowerFault {
    /// Begins this fault of supply, reset or crystal on `node`'s board now.
    pub fn begin<B: Powered, C: Cost>(self, node: &mut Node<B, C>) {
        match self {
            Self::Off(_) => {
                node.power_off();
                supply_front_end(node, false);
            }
            Self::CrystalDead => B::crystal(node, false),
            Self::FrontEndOff => supply_front_end(node, false),
            // The voltages of a sag are applied later, each as an event of its own.
            Self::Sag(_) => {}
            Self::Pin => node.restart(FromOutside::Pin),
            Self::BrownOut => node.restart(FromOutside::BrownOut),
            Self::Watchdog => node.restart(FromOutside::Watchdog),
        }
    }

    /// Ends this fault on `node`'s board now.
    pub fn end<B: Powered, C: Cost>(self, node: &mut Node<B, C>) {
        match self {
            Self::Off(seed) => {
                supply_front_end(node, true);
                node.power_on(seed);
            }
            Self::CrystalDead => B::crystal(node, true),
            // The front end stays without supply for as long as the whole board does.
            Self::FrontEndOff if node.is_powered() => supply_front_end(node, true),
            Self::Sag(seed) => supply(node, RAILS_UV[0], seed),
            Self::FrontEndOff | Self::Pin | Self::BrownOut | Self::Watchdog => {}
        }
    }
}

/// Sets the supply of `node`'s board to `microvolts` from now on; see [`Node::supply`].
pub fn supply<B: Powered, C: Cost>(node: &mut Node<B, C>, microvolts: u32, seed: u64) {
    node.supply(microvolts, seed);
    supply_front_end(node, microvolts >= FRONT_END_UV);
}

fn supply_front_end<B: Powered, C: Cost>(node: &mut Node<B, C>, on: bool) {
    let now = node.now();
    node.board_mut(|board| board.supply_chips(now, on));
}
