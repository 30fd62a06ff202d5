//! Applies the faults of the active hold's board that are scripted by hand.

use cortex_m4::{Cost, Register};
use emulator_node::{Error, Node};
use emulator_part::{Part, StuckBit};
use nrf52840::Nrf52840;

use crate::boards::{Hold, Powered, supply};
use crate::faults::image::{Repair, poke};
use crate::faults::power::RAILS_UV;
use crate::faults::{FIRST_INTERRUPT, HoldBoardFault, ImageFault};

/// Begins `fault` on `node` now, and returns what its end restores.
///
/// # Errors
///
/// [`Error::NoSymbol`] if the program has no such vector, function or variable.
#[inline(never)]
pub(super) fn begin<C: Cost>(fault: HoldBoardFault, node: &mut Node<Hold, C>) -> Result<Repair, Error> {
    let now = node.now();
    match fault {
        HoldBoardFault::Chip(fault) => node.board_mut(|board| board.front_end().begin_chip_fault(fault)),
        HoldBoardFault::Flip(place) => node.board_mut(|board| board.front_end().flip(now, place)),
        HoldBoardFault::Dead(vector) => {
            let line = line(node, vector)?;
            node.switch_interrupt_off(line);
        }
        HoldBoardFault::Spurious(vector) => {
            let line = line(node, vector)?;
            node.raise_interrupt(line);
        }
        HoldBoardFault::Faulting(handler) => return ImageFault::Faulting(handler.to_owned()).apply(node),
        HoldBoardFault::Word(symbol, offset, value) => {
            return poke(node, symbol, offset, &value.to_le_bytes());
        }
        HoldBoardFault::Stuck(symbol, offset, value) => {
            let variable = node.firmware().variable_called(symbol).ok_or_else(|| missing(node, symbol))?;
            let address = u32::try_from(variable.address).unwrap_or(u32::MAX).saturating_add(offset);
            node.input(|part, _, _| part.stick(Some(StuckBit { address, bit: 0, value })));
        }
        HoldBoardFault::Poke(address, value) => node.poke(address, &value.to_le_bytes())?,
        HoldBoardFault::Core(number, value) => node.set_core_register(Register::R(number), value),
        HoldBoardFault::Supply(microvolts) => supply(node, microvolts, 0),
    }
    Ok(Repair::default())
}

/// Ends `fault` on `node` now. Damage to memory is not restored here.
pub(super) fn end<C: Cost>(fault: HoldBoardFault, node: &mut Node<Hold, C>) {
    match fault {
        HoldBoardFault::Chip(fault) => node.board_mut(|board| board.front_end().end_chip_fault(fault)),
        HoldBoardFault::Stuck(..) => {
            node.input(|part, _, _| part.stick(None));
        }
        HoldBoardFault::Supply(_) => supply(node, RAILS_UV[0], 0),
        HoldBoardFault::Flip(_)
        | HoldBoardFault::Dead(_)
        | HoldBoardFault::Spurious(_)
        | HoldBoardFault::Faulting(_)
        | HoldBoardFault::Word(..)
        | HoldBoardFault::Poke(..)
        | HoldBoardFault::Core(..) => {}
    }
}

/// The number of the interrupt with the vector `vector`.
fn line<C: Cost>(node: &Node<Hold, C>, vector: &str) -> Result<u16, Error> {
    let exception = Nrf52840::exception(vector).and_then(|number| number.checked_sub(FIRST_INTERRUPT));
    exception.ok_or_else(|| missing(node, vector))
}

fn missing<C: Cost>(node: &Node<Hold, C>, symbol: &str) -> Error {
    Error::NoSymbol { firmware: node.firmware().name().to_owned(), symbol: symbol.to_owned() }
}
