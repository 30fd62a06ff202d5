//! Faults of the active hold's board and of its sensors that tests and the coverage script by hand. `--faults` draws
//! none of them.

use super::ChipFault;

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
}

/// A sensor on the hold's I2C bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensor {
    /// The sensor of temperature and humidity.
    Climate,
    /// The accelerometer.
    Vibration,
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
