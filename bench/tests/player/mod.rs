//! A board with one wire out and one wire in.

use bench::engine::Wiring;
use bench::stm32f427::{Oscillators, PinId, Stm32f427Part};

/// The pin that leaves the board.
pub(crate) const OUT: PinId = PinId::new('D', 14);
/// The pin that is driven from outside.
pub(crate) const IN: PinId = PinId::new('A', 3);

/// The board.
#[derive(Debug)]
pub(crate) struct Player {
    pub(crate) part: Stm32f427Part,
}

impl Player {
    pub(crate) fn new() -> Self {
        let mut part = Stm32f427Part::new(Oscillators::default());
        part.watch_pin(OUT);
        Self { part }
    }
}

impl Wiring for Player {
    type Part = Stm32f427Part;

    fn part(&self) -> &Stm32f427Part {
        &self.part
    }

    fn part_mut(&mut self) -> &mut Stm32f427Part {
        &mut self.part
    }

    fn outgoing(&self) -> bool {
        !self.part.edges().is_empty()
    }
}
