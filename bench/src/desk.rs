//! Either board of the link alone on a desk, with its front end outside any RFID field and nothing else connected.
//!
//! The cores use the pessimistic clock, because the boards' test suites must meet their time bounds on it.

use cortex_m4::Pessimistic;
use nrf52840::{Nrf52840, Settings};
use st25r3916_model::{Chip, Config};
use stm32f429::{Oscillators, Stm32f429};

use crate::boards::{Dpr, Horus, SSI};
use emulator_debug_port::{Alone, DebugPort, Debugged, Wire, restore};
use emulator_node::Node;

/// One of the two boards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Desk {
    /// The nRF52840-DK. Its microcontroller has build code AAF0, so the debug port is locked while the microcontroller
    /// is new.
    Dpr,
    /// NUCLEO-F429ZI.
    Horus,
}

/// Switches a board on, and returns its debug port.
///
/// The microcontroller has the memory `kept`, the result of an earlier [`Wire::kept`], or is new if `kept` is `None`.
/// Returns `None` if `kept` does not have [`kept_bytes`] bytes.
#[must_use]
pub fn switch_on(desk: Desk, kept: Option<&[u8]>) -> Option<Box<dyn Wire>> {
    // Both boards supply the front end's chip with 5 V.
    let chip = Chip::new(Config { vdd_mv: 5000, ..Config::default() });
    Some(match desk {
        Desk::Dpr => {
            let mut part = Nrf52840::new(Settings::default());
            part.wire_spis(SSI);
            Box::new(port(part, Dpr::new(chip, false), kept)?)
        }
        Desk::Horus => {
            let part = Stm32f429::new(Oscillators::default());
            Box::new(port(part, Horus::new(chip, 3, false), kept)?)
        }
    })
}

/// The number of bytes that a board's microcontroller keeps without supply.
#[must_use]
pub fn kept_bytes(desk: Desk) -> usize {
    let kept = match desk {
        Desk::Dpr => Nrf52840::KEPT,
        Desk::Horus => Stm32f429::KEPT,
    };
    kept.iter().map(|(_, size)| size).sum()
}

fn port<B: Alone>(mut part: B::Part, board: B, kept: Option<&[u8]>) -> Option<DebugPort<B, Pessimistic>>
where
    B::Part: Debugged,
{
    if let Some(kept) = kept {
        restore(&mut part, kept)?;
    }
    Some(DebugPort::new(Node::programmed(part, board)))
}

impl Alone for Dpr {
    fn forget_outgoing(&mut self) {
        drop(self.front_end.take_air());
    }
}

impl Alone for Horus {
    fn forget_outgoing(&mut self) {
        drop(self.front_end.take_air());
        drop(self.receivers.take_sent());
    }
}
