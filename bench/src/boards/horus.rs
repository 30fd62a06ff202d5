//! The HORUS side: NUCLEO-F429ZI with its front end and its receivers.

use bench_seam::{I2cAnswer, I2cEvent, Pad, Pin, SpiFrame, UartFrame};
use horus_tx_fw::timing::GNSS_BAUD;
use st25r3916_model::Chip;
use stm32f429::{Stm32f429, pin};

use super::front_end::{FrontEnd, Wires};
use super::receivers::Receivers;
use crate::node::{Board, Input};

/// The front end's wires on the HORUS side.
const HORUS_FRONT_END: Wires =
    Wires { sck: pin('A', 5), mosi: pin('A', 7), miso: pin('A', 6), cs: pin('D', 14), irq: pin('A', 3) };
/// Where the 10 ms timer shows its ticks: the pin falls with each.
const TICK: Pin = pin('B', 10);

/// The HORUS side.
#[derive(Clone, Debug)]
pub struct Horus {
    /// The front end.
    pub front_end: FrontEnd,
    /// The receivers' interfaces.
    pub receivers: Receivers,
    /// The lines rest high, which the part was told.
    powered: bool,
    /// The level of the pin TICK.
    tick: bool,
    ticks: Vec<u64>,
}

impl Horus {
    /// The board with so many receivers, of which none sends yet.
    #[must_use]
    pub fn new(chip: Chip, receivers: usize, watched: bool) -> Self {
        Self {
            front_end: FrontEnd::new(chip, HORUS_FRONT_END, watched),
            receivers: Receivers::new(receivers),
            powered: false,
            tick: false,
            ticks: vec![],
        }
    }

    /// Receiver `index` (from 0) says `bytes` at `at` (ns): on a UART they begin then, or when it has sent what it
    /// sends then, which is the answer; over a bus they can be read from then on.
    pub fn say(&mut self, at: u64, index: usize, bytes: &[u8]) -> u64 {
        let frames = bytes.iter().map(|&byte| UartFrame::eight_n_one(byte, GNSS_BAUD));
        self.receivers.offer(at, index, bytes);
        self.receivers.send(at, index, frames)
    }

    /// The 10 ms timer's ticks since the last call: each the instant at which the pin TICK was driven low, in ns.
    pub fn take_ticks(&mut self) -> Vec<u64> {
        std::mem::take(&mut self.ticks)
    }
}

impl Board for Horus {
    type Part = Stm32f429;

    fn pin(&mut self, at: u64, pin: Pin, pad: Pad) {
        if pin == TICK && pad.level() != self.tick {
            self.tick = pad.level();
            // A pin that a restart lets go of shows no tick.
            if pad == Pad::Driven(false) {
                self.ticks.push(at);
            }
        }
        self.front_end.pin(at, pin, pad);
        self.receivers.pin(at, pin, pad);
    }

    fn spi(&mut self, begins: u64, ends: u64, frame: &SpiFrame) -> Option<u32> {
        self.receivers.spi(begins, ends, frame).or_else(|| self.front_end.spi(begins, ends, frame))
    }

    fn uart(&mut self, at: u64, pin: Pin, frame: &UartFrame) {
        self.receivers.uart(at, pin, frame);
    }

    fn i2c(&mut self, at: u64, scl: Pin, sda: Pin, event: I2cEvent) -> I2cAnswer {
        self.receivers.i2c(at, scl, sda, event)
    }

    fn next_event(&self) -> u64 {
        self.front_end.next_event().min(self.receivers.next_event())
    }

    fn settle(&mut self, at: u64, inputs: &mut Vec<Input>) {
        if !self.powered {
            self.powered = true;
            self.receivers.powered(inputs);
        }
        self.front_end.settle(at, inputs);
        self.receivers.settle(at, inputs);
    }

    fn outgoing(&self) -> bool {
        self.front_end.has_air() || self.receivers.has_heard()
    }
}
