//! A test board with one wire out and one wire in.

use emulator_node::{Board, Firmware, Input, Node};
use emulator_part::{Pad, Pin};
use stm32f429::{Oscillators, Stm32f429, pin};

pub(crate) const OUT: Pin = pin('D', 14);
#[allow(dead_code, reason = "every test binary uses its own part of it")]
pub(crate) const IN: Pin = pin('A', 3);

#[derive(Clone, Debug, Default)]
pub(crate) struct Player {
    level: bool,
    edges: Vec<(u64, bool)>,
}

impl Player {
    pub(crate) fn with(firmware: &Firmware) -> Node<Player> {
        Node::new(Stm32f429::new(Oscillators::default()), Self::default(), firmware).unwrap()
    }

    #[allow(dead_code, reason = "every test binary uses its own part of it")]
    pub(crate) fn take_edges(&mut self) -> Vec<(u64, bool)> {
        std::mem::take(&mut self.edges)
    }
}

impl Board for Player {
    type Part = Stm32f429;

    fn pin(&mut self, at: u64, pin: Pin, pad: Pad) {
        if pin == OUT && pad.level() != self.level {
            self.level = pad.level();
            self.edges.push((at, self.level));
        }
    }

    fn settle(&mut self, _at: u64, _inputs: &mut Vec<Input>) {}

    fn outgoing(&self) -> bool {
        !self.edges.is_empty()
    }
}
