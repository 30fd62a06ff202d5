//! Supply and reset of a board.

use cortex_m4::Cost;
use st25r3916_model::Chip;

use crate::boards::front_end::FrontEnd;
use crate::boards::{Dpr, Horus};
use crate::node::{Board, FromOutside, Node};

/// What happens to a board's supply or reset pin. The front end has the board's supply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PowerFault {
    /// The supply is off from the episode's beginning to its end; RAM comes up with noise that follows from this seed.
    Off(u64),
    /// The reset pin is pulled low for a moment. RAM keeps its contents, and the front end its registers.
    Pin,
    /// The supply dips below the part's brown-out threshold for a moment. RAM keeps its contents, and the front end,
    /// which works from a lower supply, its registers.
    BrownOut,
    /// The watchdog bites, whatever the firmware did. RAM keeps its contents, and the front end its registers.
    Watchdog,
    /// The front end alone is without supply from the episode's beginning to its end; its registers are lost.
    FrontEndOff,
}

impl PowerFault {
    /// What the event log calls it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Off(_) => "off",
            Self::Pin => "reset pin",
            Self::BrownOut => "brown-out",
            Self::Watchdog => "watchdog",
            Self::FrontEndOff => "front end off",
        }
    }

    /// Whether it lasts: the others are over as they begin.
    #[must_use]
    pub const fn lasts(self) -> bool {
        matches!(self, Self::Off(_) | Self::FrontEndOff)
    }

    /// It begins on `node`'s board now.
    pub fn begin<B: Powered, C: Cost>(self, node: &mut Node<B, C>) {
        match self {
            Self::Off(_) => {
                node.power_off();
                supply_front_end(node, false);
            }
            Self::FrontEndOff => supply_front_end(node, false),
            Self::Pin => node.restart(FromOutside::Pin),
            Self::BrownOut => node.restart(FromOutside::BrownOut),
            Self::Watchdog => node.restart(FromOutside::Watchdog),
        }
    }

    /// It ends on `node`'s board now.
    pub fn end<B: Powered, C: Cost>(self, node: &mut Node<B, C>) {
        match self {
            Self::Off(seed) => {
                supply_front_end(node, true);
                node.power_on(seed);
            }
            // Without the board's supply the front end has none either.
            Self::FrontEndOff if node.is_powered() => supply_front_end(node, true),
            Self::FrontEndOff | Self::Pin | Self::BrownOut | Self::Watchdog => {}
        }
    }
}

/// A board whose front end has a supply that can fail.
pub trait Powered: Board {
    /// The front end.
    fn front_end(&mut self) -> &mut FrontEnd;

    /// Its front end's chip, to look at.
    fn chip(&self) -> &Chip;
}

impl Powered for Horus {
    fn front_end(&mut self) -> &mut FrontEnd {
        &mut self.front_end
    }

    fn chip(&self) -> &Chip {
        self.front_end.chip()
    }
}

impl Powered for Dpr {
    fn front_end(&mut self) -> &mut FrontEnd {
        &mut self.front_end
    }

    fn chip(&self) -> &Chip {
        self.front_end.chip()
    }
}

fn supply_front_end<B: Powered, C: Cost>(node: &mut Node<B, C>, on: bool) {
    let now = node.now();
    node.board_mut(|board| {
        board.front_end().with(|chip| if on { chip.power_on(now) } else { chip.power_off(now) });
    });
}
