//! The NUCLEO-F429ZI of HORUS with its front end and its receivers.

use emulator_part::{I2cAnswer, I2cEvent, Pad, Pin, SpiFrame, UartFrame};
use horus_tx_fw::timing::GNSS_BAUD;
use st25r3916_model::Chip;
use stm32f429::{Stm32f429, pin};

use super::front_end::{FrontEnd, Wires};
use super::receivers::Receivers;
use crate::faults::{InputFault, state_inputs::INPUTS};
use emulator_node::{Board, Input};

const HORUS_FRONT_END: Wires =
    Wires { sck: pin('A', 5), mosi: pin('A', 7), miso: pin('A', 6), cs: pin('D', 14), irq: pin('A', 3) };
/// The pin on which HORUS's 10 ms timer shows its ticks: the pin falls at each tick.
const TICK: Pin = pin('B', 10);

/// The two pins of each input: one is high while the input is active, the other while it is inactive.
const INPUT_PINS: [[Pin; 2]; INPUTS] =
    [[pin('E', 2), pin('E', 4)], [pin('E', 5), pin('E', 6)], [pin('D', 3), pin('D', 4)]];

#[derive(Clone, Copy, Debug)]
struct StateInput {
    /// The levels of the input's two pins. The first is high while the input is active.
    levels: (bool, bool),
    /// The instant of the next change and the time between two changes, ns, while the input's contact chatters.
    chatters: Option<(u64, u64)>,
}

/// A change of the levels of a state input's two pins.
#[derive(Clone, Copy, Debug)]
pub struct InputChange {
    /// The instant at which the levels changed, ns.
    pub at: u64,
    /// The input's index, from 0.
    pub input: usize,
    /// The new level of the pin that is high while the input is active.
    pub active: bool,
    /// The new level of the pin that is high while the input is inactive.
    pub inactive: bool,
}

/// HORUS's board.
#[derive(Clone, Debug)]
pub struct Horus {
    /// HORUS's front end.
    pub front_end: FrontEnd,
    /// The receivers' interfaces.
    pub receivers: Receivers,
    powered: bool,
    tick: bool,
    ticks: Vec<u64>,
    inputs: [StateInput; INPUTS],
    input_changes: Vec<InputChange>,
    /// The indices of the inputs whose new levels the part has yet to receive.
    untold: Vec<usize>,
}

impl Horus {
    /// Returns HORUS's board with `receivers` silent receivers. If `watched`, the front end's traffic is recorded.
    #[must_use]
    pub fn new(chip: Chip, receivers: usize, watched: bool) -> Self {
        Self {
            front_end: FrontEnd::new(chip, HORUS_FRONT_END, watched),
            receivers: Receivers::new(receivers),
            powered: false,
            tick: false,
            ticks: vec![],
            inputs: [StateInput { levels: (false, true), chatters: None }; INPUTS],
            input_changes: vec![],
            untold: vec![],
        }
    }

    /// Begins a fault of state input `input` at `at` (ns); `None` makes the input inactive.
    pub fn set_input(&mut self, at: u64, input: usize, says: Option<InputFault>) {
        let Some(state) = self.inputs.get_mut(input) else { return };
        state.chatters = match says {
            Some(InputFault::Chatters(after)) => Some((at + after, after)),
            _ => None,
        };
        self.drive_input(at, input, says.map_or((false, true), InputFault::levels));
    }

    fn drive_input(&mut self, at: u64, input: usize, levels: (bool, bool)) {
        self.inputs[input].levels = levels;
        self.input_changes.push(InputChange { at, input, active: levels.0, inactive: levels.1 });
        self.untold.push(input);
    }

    /// Takes the changes of the state inputs' pins since the last call.
    pub fn take_input_changes(&mut self) -> Vec<InputChange> {
        std::mem::take(&mut self.input_changes)
    }

    /// Passes `bytes` to receiver `index` (from 0). Over a UART the receiver sends them from `at` (ns) on; over a bus
    /// it offers them from then on. Returns the instant, ns, at which a UART begins the first byte.
    pub fn say(&mut self, at: u64, index: usize, bytes: &[u8]) -> u64 {
        let frames = bytes.iter().map(|&byte| UartFrame::eight_n_one(byte, GNSS_BAUD));
        self.receivers.offer(at, index, bytes);
        self.receivers.send(at, index, frames)
    }

    /// Takes the instants, ns, of the 10 ms timer's ticks since the last call.
    pub fn take_ticks(&mut self) -> Vec<u64> {
        std::mem::take(&mut self.ticks)
    }
}

impl Board for Horus {
    type Part = Stm32f429;

    fn pin(&mut self, at: u64, pin: Pin, pad: Pad) {
        if pin == TICK && pad.level() != self.tick {
            self.tick = pad.level();
            // The firmware drives TICK low at each tick. A reset only releases the pin, which is no tick.
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
        let chatter = self.inputs.iter().filter_map(|input| input.chatters).map(|(at, _)| at);
        let receivers = self.receivers.next_event();
        self.front_end.next_event().min(receivers).min(chatter.min().unwrap_or(u64::MAX))
    }

    fn settle(&mut self, at: u64, inputs: &mut Vec<Input>) {
        if !self.powered {
            self.powered = true;
            self.receivers.powered(inputs);
            self.untold = (0..INPUTS).collect();
        }
        for input in 0..INPUTS {
            while let Some((due, after)) = self.inputs[input].chatters
                && due <= at
            {
                let (active, inactive) = self.inputs[input].levels;
                self.inputs[input].chatters = Some((due + after, after));
                self.drive_input(due, input, (inactive, active));
            }
        }
        for input in self.untold.drain(..) {
            let (active, inactive) = self.inputs[input].levels;
            let levels = INPUT_PINS[input].into_iter().zip([active, inactive]);
            inputs.extend(levels.map(|(pin, level)| Input::Level(pin, Some(level))));
        }
        self.front_end.settle(at, inputs);
        self.receivers.settle(at, inputs);
    }

    fn outgoing(&self) -> bool {
        self.front_end.has_air() || self.receivers.has_sent()
    }
}
