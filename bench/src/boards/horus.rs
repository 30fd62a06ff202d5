//! The HORUS side: NUCLEO-F429ZI with its front end and its receivers.

use std::collections::VecDeque;

use bench_seam::{Pad, Pin, SpiFrame, UartFrame};
use horus_tx_fw::timing::GNSS_BAUD;
use st25r3916_model::Chip;
use stm32f429::{Stm32f429, pin};

use super::front_end::{FrontEnd, Wires};
use crate::node::{Board, Input};

/// The front end's wires on the HORUS side.
const HORUS_FRONT_END: Wires =
    Wires { sck: pin('A', 5), mosi: pin('A', 7), miso: pin('A', 6), cs: pin('D', 14), irq: pin('A', 3) };
/// Where the lines of receivers 1 to 5 arrive.
const RECEIVER_PINS: [Pin; 5] = [pin('D', 6), pin('C', 7), pin('C', 11), pin('D', 2), pin('E', 7)];
/// Where the 10 ms timer shows its ticks: the pin falls with each.
const TICK: Pin = pin('B', 10);

/// The wire from a receiver: frames wait here until the line takes them, back to back.
#[derive(Clone, Debug)]
struct Line {
    pin: Pin,
    waiting: VecDeque<UartFrame>,
    /// When the line is free again, ns.
    free_at: u64,
}

/// The HORUS side.
#[derive(Clone, Debug)]
pub struct Horus {
    /// The front end.
    pub front_end: FrontEnd,
    lines: Vec<Line>,
    /// The least of the lines' next instants.
    next_byte: u64,
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
        let line = |&pin| Line { pin, waiting: VecDeque::new(), free_at: 0 };
        Self {
            front_end: FrontEnd::new(chip, HORUS_FRONT_END, watched),
            lines: RECEIVER_PINS.iter().take(receivers).map(line).collect(),
            next_byte: u64::MAX,
            powered: false,
            tick: false,
            ticks: vec![],
        }
    }

    /// Receiver `index` (from 0) begins to send these frames at `at` (ns), or when it has sent what it sends then: that
    /// instant is the answer.
    pub fn send(&mut self, at: u64, index: usize, frames: impl IntoIterator<Item = UartFrame>) -> u64 {
        let Some(line) = self.lines.get_mut(index) else { return at };
        if line.waiting.is_empty() {
            line.free_at = line.free_at.max(at);
        }
        let before: u64 = line.waiting.iter().map(UartFrame::ns).sum();
        let begins = line.free_at + before;
        line.waiting.extend(frames);
        self.plan();
        begins
    }

    /// As [`Horus::send`], for bytes at the receivers' bit rate, 8N1.
    pub fn send_bytes(&mut self, at: u64, index: usize, bytes: &[u8]) -> u64 {
        self.send(at, index, bytes.iter().map(|&byte| UartFrame::eight_n_one(byte, GNSS_BAUD)))
    }

    fn plan(&mut self) {
        let sending = self.lines.iter().filter(|line| !line.waiting.is_empty());
        self.next_byte = sending.map(|line| line.free_at).min().unwrap_or(u64::MAX);
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
    }

    fn spi(&mut self, begins: u64, ends: u64, frame: &SpiFrame) -> Option<u32> {
        self.front_end.spi(begins, ends, frame)
    }

    fn next_event(&self) -> u64 {
        self.front_end.next_event().min(self.next_byte)
    }

    fn settle(&mut self, at: u64, inputs: &mut Vec<Input>) {
        if !self.powered {
            self.powered = true;
            inputs.extend(self.lines.iter().map(|line| Input::Level(line.pin, Some(true))));
        }
        self.front_end.settle(at, inputs);
        if at >= self.next_byte {
            for line in &mut self.lines {
                while line.free_at <= at
                    && let Some(frame) = line.waiting.pop_front()
                {
                    inputs.push(Input::Frame(line.pin, line.free_at, frame));
                    line.free_at += frame.ns();
                }
            }
            self.plan();
        }
    }

    fn outgoing(&self) -> bool {
        self.front_end.has_air()
    }
}
