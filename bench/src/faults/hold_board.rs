//! Faults of the active hold's board and of its sensors that tests and the coverage script by hand. `--faults` draws
//! none of them.

use cortex_m4::{Cost, Register};
use emulator_node::{Error, Node};
use emulator_part::{Part, StuckBit};
use nrf52840::Nrf52840;

use super::hold::Sensor;
use super::image::Repair;
use super::power::RAILS_UV;
use super::{ChipFault, FIRST_INTERRUPT, ImageFault};
use crate::boards::{Hold, Powered, supply};

/// A fault of the hold's board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HoldBoardFault {
    /// A fault of the front end's chip, or of a line to it.
    Chip(ChipFault),
    /// A register's bit of the front end's chip flips once; the number is as in [`super::Fault::Flip`].
    Flip(u64),
    /// The interrupt of this vector is off, so that its task is dead.
    Dead(&'static str),
    /// The interrupt of this vector becomes pending once, although nothing has raised it.
    Spurious(&'static str),
    /// The handler of this vector, or the function of this name, begins with an undefined instruction.
    Faulting(&'static str),
    /// A word of the variable with this symbol, given by its offset in bytes, holds this value. The episode's end
    /// brings the original value back.
    Word(&'static str, u32, u32),
    /// A bit of the variable with this symbol, given by the byte's offset, reads as this value, whatever is written.
    Stuck(&'static str, u32, bool),
    /// The word at this address, of memory or of a peripheral's register, is written as by a debugger. A register is
    /// not restored.
    Poke(u32, u32),
    /// The general register of this number of the core holds this value once.
    Core(u8, u32),
    /// The supply has this voltage, µV.
    Supply(u32),
}

impl HoldBoardFault {
    /// Returns the fault's name in the event log.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Chip(fault) => format!("front end {}", fault.name()),
            Self::Flip(_) => "front end register flips".into(),
            Self::Dead(vector) => format!("dead task {vector}"),
            Self::Spurious(vector) => format!("spurious interrupt {vector}"),
            Self::Faulting(handler) => format!("{handler} faulting"),
            Self::Word(symbol, offset, _) => format!("{symbol}+{offset:#x} overwritten"),
            Self::Stuck(symbol, offset, _) => format!("{symbol}+{offset:#x} stuck"),
            Self::Poke(address, _) => format!("{address:#010x} written"),
            Self::Core(number, value) => format!("R{number} {value:#010x}"),
            Self::Supply(microvolts) => format!("supply {:.2} V", f64::from(microvolts) / 1e6),
        }
    }

    /// Begins the fault on `node` now, and returns what its end restores.
    ///
    /// # Errors
    ///
    /// [`Error::NoSymbol`] if the program has no such vector, function or variable.
    pub(crate) fn begin<C: Cost>(self, node: &mut Node<Hold, C>) -> Result<Repair, Error> {
        let now = node.now();
        match self {
            Self::Chip(fault) => node.board_mut(|board| board.front_end().begin_chip_fault(fault)),
            Self::Flip(place) => node.board_mut(|board| board.front_end().flip(now, place)),
            Self::Dead(vector) => {
                let line = line(node, vector)?;
                node.switch_interrupt_off(line);
            }
            Self::Spurious(vector) => {
                let line = line(node, vector)?;
                node.raise_interrupt(line);
            }
            Self::Faulting(handler) => return ImageFault::Faulting(handler.to_owned()).apply(node),
            Self::Word(symbol, offset, value) => {
                return super::image::poke(node, symbol, offset, &value.to_le_bytes());
            }
            Self::Stuck(symbol, offset, value) => {
                let variable = node.firmware().variable_called(symbol).ok_or_else(|| missing(node, symbol))?;
                let address = u32::try_from(variable.address).unwrap_or(u32::MAX).saturating_add(offset);
                node.input(|part, _, _| part.stick(Some(StuckBit { address, bit: 0, value })));
            }
            Self::Poke(address, value) => node.poke(address, &value.to_le_bytes())?,
            Self::Core(number, value) => node.set_core_register(Register::R(number), value),
            Self::Supply(microvolts) => supply(node, microvolts, 0),
        }
        Ok(Repair::default())
    }

    /// Ends the fault on `node` now. Damage to memory is not restored here.
    pub(crate) fn end<C: Cost>(self, node: &mut Node<Hold, C>) {
        match self {
            Self::Chip(fault) => node.board_mut(|board| board.front_end().end_chip_fault(fault)),
            Self::Stuck(..) => {
                node.input(|part, _, _| part.stick(None));
            }
            Self::Supply(_) => supply(node, RAILS_UV[0], 0),
            Self::Flip(_)
            | Self::Dead(_)
            | Self::Spurious(_)
            | Self::Faulting(_)
            | Self::Word(..)
            | Self::Poke(..)
            | Self::Core(..) => {}
        }
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

/// A fault of the hold's sensors, of their bus, or of what they measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorFault {
    /// A sensor acknowledges its address, but no byte that is written to it.
    Refuses(Sensor),
    /// No sensor acknowledges the address of this number, counted from 0, after a pause of the bus of 5 ms.
    Deaf(u8),
    /// Once it is addressed, a sensor holds SCL low.
    HoldsScl(Sensor),
    /// A sensor holds SDA low until it has received this many clocks, as after a transfer that was cut off.
    HoldsSda(u8),
    /// The accelerometer measures exactly 0 along each axis.
    Numb,
    /// The accelerometer is shaken so that each sample along each axis is any that it can measure.
    Shaken,
    /// The sensors lose their supply for a moment, and so their settings.
    Restart,
    /// The air in the box has this temperature at the beginning, °C.
    Celsius(i16),
}

impl SensorFault {
    /// Returns the fault's name in the event log.
    #[must_use]
    pub fn name(self) -> String {
        let word = |sensor: Sensor| format!("{sensor:?}").to_lowercase();
        match self {
            Self::Refuses(sensor) => format!("{} sensor refuses bytes", word(sensor)),
            Self::Deaf(nth) => format!("address {nth} not acknowledged"),
            Self::HoldsScl(sensor) => format!("{} sensor holds SCL", word(sensor)),
            Self::HoldsSda(clocks) => format!("SDA held for {clocks} clocks"),
            Self::Numb => "vibration sensor numb".into(),
            Self::Shaken => "vibration sensor shaken".into(),
            Self::Restart => "sensors restart".into(),
            Self::Celsius(celsius) => format!("box at {celsius} °C"),
        }
    }
}
