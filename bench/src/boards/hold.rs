//! The active hold: nRF52840-DK with its own front end, its sensors and its outputs.

use emulator_part::{I2cAnswer, I2cEvent, Pad, Pin, SpiFrame};
use nrf52840::Nrf52840;
use st25r3916_model::Chip;

use super::dpr::NRF_FRONT_END;
use super::front_end::FrontEnd;
use crate::payload::Payload;
use emulator_node::{Board, Input};

/// The I2C bus, which has pull-ups.
const SDA: Pin = Pin::new(0, 26);
const SCL: Pin = Pin::new(0, 27);
/// The hold's outputs. Drivers with pull-downs switch heater and cooler, so that an undriven pin is off.
const HEATER: Pin = Pin::new(1, 5);
const COOLER: Pin = Pin::new(1, 6);
/// The lock's actuator keeps its state while the pin is not driven.
const LOCK: Pin = Pin::new(1, 7);

/// The levels of the hold's outputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outputs {
    /// Whether the heater is on.
    pub heater: bool,
    /// Whether the cooler is on.
    pub cooler: bool,
    /// Whether the payload is locked; `None` before the pin was first driven.
    pub locked: Option<bool>,
}

/// The hold's board.
#[derive(Clone, Debug)]
pub struct Hold {
    /// The hold's front end.
    pub front_end: FrontEnd,
    /// The payload: box, vibration and sensors.
    pub payload: Payload,
    /// The levels of SCL and SDA that the microcontroller received last; `None` at the beginning.
    lines: [Option<bool>; 2],
    outputs: Outputs,
    locked: Vec<(u64, bool)>,
}

impl Hold {
    /// Returns the hold's board with a payload that is drawn from `seed`.
    #[must_use]
    pub fn new(chip: Chip, seed: u64) -> Self {
        Self {
            front_end: FrontEnd::new(chip, NRF_FRONT_END, false),
            payload: Payload::new(seed),
            lines: [None; 2],
            outputs: Outputs::default(),
            locked: vec![],
        }
    }

    /// The present levels of the hold's outputs.
    #[must_use]
    pub fn outputs(&self) -> Outputs {
        self.outputs
    }

    /// Takes the changes of the lock's pin since the last call, each with its instant, ns.
    pub fn take_locked(&mut self) -> Vec<(u64, bool)> {
        std::mem::take(&mut self.locked)
    }
}

impl Board for Hold {
    type Part = Nrf52840;

    fn pin(&mut self, at: u64, pin: Pin, pad: Pad) {
        let high = pad == Pad::Driven(true);
        match pin {
            HEATER => self.outputs.heater = high,
            COOLER => self.outputs.cooler = high,
            LOCK => {
                let Pad::Driven(locked) = pad else { return };
                if self.outputs.locked.replace(locked) != Some(locked) {
                    self.locked.push((at, locked));
                }
                return;
            }
            SCL => return self.payload.clock(pad != Pad::Driven(false)),
            _ => return self.front_end.pin(at, pin, pad),
        }
        self.payload.climate.switch(at, self.outputs.heater, self.outputs.cooler);
    }

    fn spi(&mut self, begins: u64, ends: u64, frame: &SpiFrame) -> Option<u32> {
        self.front_end.spi(begins, ends, frame)
    }

    fn i2c(&mut self, at: u64, scl: Pin, sda: Pin, event: I2cEvent) -> I2cAnswer {
        if (scl, sda) == (SCL, SDA) { self.payload.i2c(at, event) } else { I2cAnswer::NOBODY }
    }

    fn next_event(&self) -> u64 {
        self.front_end.next_event()
    }

    fn settle(&mut self, at: u64, inputs: &mut Vec<Input>) {
        for ((pin, low), last) in [SCL, SDA].into_iter().zip(self.payload.holds()).zip(&mut self.lines) {
            if last.replace(!low) != Some(!low) {
                inputs.push(Input::Level(pin, Some(!low)));
            }
        }
        self.front_end.settle(at, inputs);
    }

    fn outgoing(&self) -> bool {
        self.front_end.has_air()
    }
}
